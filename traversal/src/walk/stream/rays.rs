//! Rays of a stream: two lines of memory each.

use std::arch::x86_64::*;
use std::mem::MaybeUninit;

use crate::walk::PACKET;
use crate::walk::level_ray::min;
use crate::walk::level_rays::{AXIS, BoxRays, LevelRays, ROW, WorldRays};
use crate::walk::rows::{Lanes, Words};
use crate::walk::triangle_ray::TriangleRay;

/// A ray in its bottom level: a line for boxes, by the axes of space, and a line for triangles, by
/// its own; see [`LevelRays`].
#[derive(Clone, Copy)]
#[repr(C, align(128))]
pub(super) struct StreamRay {
    pub minus_origin: [f32; 3],
    pub t_min: f32,
    pub near_inverse: [f32; 3],
    /// The end of the interval, or one of the marks below: so one comparison sees both. Only what
    /// is here writes it.
    t_far: f32,
    pub minus_far_origin: [f32; 3],
    pub far_inverse: [f32; 3],
    octant: u32,
    /// Who it is: group and lane, or where it lies in the top level.
    pub name: u32,

    pub own_origin: [f32; 3],
    own_near_inverse: [f32; 3],
    own_far_inverse: [f32; 3],
    pub shear: [f32; 2],
    inverse_z: f32,
    /// Offsets in bytes of its axes in a vertex.
    pub axes: [u8; 4],
    direction: [f32; 3],
}

const _: () = assert!(size_of::<StreamRay>() == 128);
const _: () = assert!(std::mem::offset_of!(StreamRay, own_origin) == 64);

/// Where a ray lies, in bytes.
pub(super) const fn offset(index: usize) -> u32 {
    (index * size_of::<StreamRay>()) as u32
}

/// Which ray lies somewhere.
pub(super) const fn index(offset: u32) -> usize {
    offset as usize / size_of::<StreamRay>()
}

/// A mark in [`StreamRay::t_far`]: the ray has ended with its first hit. Marks are below every
/// distance, so a ray with a mark has no more hits.
const OVER: f32 = -1.0;

/// Mark of a ray whose hit in the stream is not final: the ray must be traced alone, from its
/// start.
const SINGLE: f32 = -2.0;

/// The name of a lane's ray.
pub(super) fn name(group: u32, lane: usize) -> u32 {
    group * PACKET as u32 + lane as u32
}

impl StreamRay {
    /// Group and lane.
    pub fn lane(&self) -> (u32, usize) {
        (self.name / PACKET as u32, self.name as usize % PACKET)
    }

    /// The end of the interval; below 0 for a ray that has a mark.
    #[inline(always)]
    pub fn t_far(&self) -> f32 {
        self.t_far
    }

    /// Whether the stream takes the ray on.
    #[inline(always)]
    pub fn is_on_its_way(&self) -> bool {
        self.t_far >= 0.0
    }

    /// Whether the ray is to be traced by itself.
    pub fn goes_singly(&self) -> bool {
        self.t_far == SINGLE
    }

    /// Ends the interval at a hit. A mark is less than `t`, so it stays.
    #[inline(always)]
    pub fn shorten(&mut self, t: f32) {
        self.t_far = min(t, self.t_far);
    }

    /// Ends the ray with its first hit.
    #[inline(always)]
    pub fn end(&mut self) {
        self.mark(OVER);
    }

    /// Leaves the ray to a walk by itself, unless it is over.
    #[inline(always)]
    pub fn leave(&mut self) {
        self.mark(SINGLE);
    }

    /// Takes a mark. The first one stays.
    #[inline(always)]
    fn mark(&mut self, mark: f32) {
        if self.is_on_its_way() {
            self.t_far = mark;
        }
    }

    /// Takes over what has become of the same ray in an instance: its mark, or the end of its
    /// interval. Distances are the same in both spaces.
    #[inline(always)]
    pub fn follow(&mut self, inner: &StreamRay) {
        if self.is_on_its_way() {
            self.t_far = inner.t_far;
        }
    }

    /// Sets a lane up as this ray is.
    pub fn put(&self, level_rays: &mut LevelRays, lane: usize) {
        for k in 0..3 {
            let axis = usize::from(self.axes[k] / AXIS as u8) % 3;
            level_rays.origin[k][lane] = self.own_origin[k];
            level_rays.far_origin[k][lane] = -self.minus_far_origin[axis];
            level_rays.near_inverse[k][lane] = self.own_near_inverse[k];
            level_rays.far_inverse[k][lane] = self.own_far_inverse[k];
            level_rays.near_rows[k][lane] =
                axis as u32 * (2 * ROW) + (self.octant >> axis & 1) * ROW;
            level_rays.axes[k][lane] = self.axes[k].into();
            level_rays.space_origin[k][lane] = -self.minus_origin[k];
            level_rays.space_direction[k][lane] = self.direction[k];
        }
        level_rays.shear[0][lane] = self.shear[0];
        level_rays.shear[1][lane] = self.shear[1];
        level_rays.inverse_z[lane] = self.inverse_z;
        level_rays.direction_z[lane] = View(self, 0.0).direction_z();
        level_rays.t_min[lane] = self.t_min;
    }
}

/// A ray of a stream, and [`Accuracy::tolerance`](crate::walk::options::Accuracy::reach).
#[derive(Clone, Copy)]
pub(super) struct View<'a>(pub &'a StreamRay, pub f32);

impl TriangleRay for View<'_> {
    #[inline(always)]
    fn origin(self, axis: usize) -> f32 {
        self.0.own_origin[axis]
    }

    #[inline(always)]
    fn near_inverse(self, axis: usize) -> f32 {
        self.0.own_near_inverse[axis]
    }

    #[inline(always)]
    fn far_inverse(self, axis: usize) -> f32 {
        self.0.own_far_inverse[axis]
    }

    #[inline(always)]
    fn axis(self, axis: usize) -> usize {
        self.0.axes[axis].into()
    }

    #[inline(always)]
    fn shear(self, axis: usize) -> f32 {
        self.0.shear[axis]
    }

    #[inline(always)]
    fn inverse_z(self) -> f32 {
        self.0.inverse_z
    }

    #[inline(always)]
    fn direction_z(self) -> f32 {
        -self.0.direction[usize::from(self.0.axes[2] / AXIS as u8) % 3]
    }

    #[inline(always)]
    fn tolerance(self) -> f32 {
        self.1
    }

    #[inline(always)]
    fn world_ray(self) -> ([f32; 3], [f32; 3]) {
        (self.0.minus_origin.map(|c| -c), self.0.direction)
    }
}

/// Puts rays that were set up together down one after the other; returns their octants.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
pub(super) fn put(
    level_rays: &LevelRays,
    t_far: &Lanes,
    names: &Words,
    places: &mut [MaybeUninit<StreamRay>; PACKET],
) -> Words {
    let boxes = level_rays.by_axes(None);
    let mut axes = [0; PACKET];
    for i in 0..PACKET {
        axes[i] = level_rays.axes[0][i] | level_rays.axes[1][i] << 8 | level_rays.axes[2][i] << 16;
    }
    let last = transpose([
        load(&level_rays.origin[0]),
        load(&level_rays.origin[1]),
        load(&level_rays.origin[2]),
        load(&level_rays.near_inverse[0]),
        load(&level_rays.near_inverse[1]),
        load(&level_rays.near_inverse[2]),
        load(&level_rays.far_inverse[0]),
        load(&level_rays.far_inverse[1]),
        load(&level_rays.far_inverse[2]),
        load(&level_rays.shear[0]),
        load(&level_rays.shear[1]),
        load(&level_rays.inverse_z),
        load_words(&axes),
        load(&level_rays.space_direction[0]),
        load(&level_rays.space_direction[1]),
        load(&level_rays.space_direction[2]),
    ]);
    with_boxes(level_rays, &boxes, t_far, names, last, places)
}

/// Puts rays that were set up together in a top level down one after the other; returns their
/// octants. What instances have of them is in the second line: see [`world_rays`].
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
pub(super) fn put_at_top(
    level_rays: &LevelRays,
    origin_error: f32,
    t_far: &Lanes,
    names: &Words,
    places: &mut [MaybeUninit<StreamRay>; PACKET],
) -> Words {
    let boxes = level_rays.by_axes(Some(origin_error));
    let mut last = [[_mm256_setzero_ps(); 2]; PACKET];
    for axis in 0..3 {
        last[axis] = load(&level_rays.space_origin[axis]);
        last[13 + axis] = load(&level_rays.space_direction[axis]);
    }
    with_boxes(level_rays, &boxes, t_far, names, transpose(last), places)
}

/// The rays of a list in a top level, for the places of an instance; there are sixteen at most.
/// Lanes without a ray repeat the first.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
pub(super) fn world_rays(rays: &[StreamRay], offsets: &[u32]) -> (WorldRays, Lanes, Words) {
    let (mut t_min, mut t_far) = ([0.0; PACKET], [0.0; PACKET]);
    let (mut names, mut sound) = ([0; PACKET], [0; PACKET]);
    let lines: [RayHalves; PACKET] = std::array::from_fn(|lane| {
        let offset = *offsets.get(lane).unwrap_or(&offsets[0]);
        let ray = &rays[index(offset)];
        sound[lane] = u32::from(lane < offsets.len());
        (t_min[lane], t_far[lane], names[lane]) = (ray.t_min, ray.t_far, offset);
        let line = ray.own_origin.as_ptr();
        // SAFETY: the second line of a ray.
        unsafe { [0, 8].map(|i| _mm256_load_ps(line.add(i))) }
    });
    let rows = transpose(lines);
    let row = |i: usize| {
        let mut row = [0.0; PACKET];
        // SAFETY: sixteen numbers.
        unsafe {
            _mm256_storeu_ps(row.as_mut_ptr(), rows[i][0]);
            _mm256_storeu_ps(row.as_mut_ptr().add(8), rows[i][1]);
        }
        row
    };
    let world_rays = WorldRays {
        origin: [row(0), row(1), row(2)],
        direction: [row(13), row(14), row(15)],
        t_min,
        sound,
    };
    (world_rays, t_far, names)
}

/// Puts rays down of which the second line is there; returns their octants.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn with_boxes(
    level_rays: &LevelRays,
    boxes: &BoxRays,
    t_far: &Lanes,
    names: &Words,
    last: [RayHalves; PACKET],
    places: &mut [MaybeUninit<StreamRay>; PACKET],
) -> Words {
    let mut octants = [0; PACKET];
    for i in 0..PACKET {
        let d = &level_rays.space_direction;
        octants[i] = u32::from(d[0][i] < 0.0)
            | u32::from(d[1][i] < 0.0) << 1
            | u32::from(d[2][i] < 0.0) << 2;
    }
    let first = transpose([
        minus(&boxes.origin[0]),
        minus(&boxes.origin[1]),
        minus(&boxes.origin[2]),
        load(&level_rays.t_min),
        load(&boxes.near_inverse[0]),
        load(&boxes.near_inverse[1]),
        load(&boxes.near_inverse[2]),
        load(t_far),
        minus(&boxes.far_origin[0]),
        minus(&boxes.far_origin[1]),
        minus(&boxes.far_origin[2]),
        load(&boxes.far_inverse[0]),
        load(&boxes.far_inverse[1]),
        load(&boxes.far_inverse[2]),
        load_words(&octants),
        load_words(names),
    ]);
    for (i, place) in places.iter_mut().enumerate() {
        let place = place.as_mut_ptr().cast::<f32>();
        // SAFETY: two lines of sixteen plain numbers.
        unsafe {
            for half in 0..2 {
                _mm256_store_ps(place.add(8 * half), first[i][half]);
                _mm256_store_ps(place.add(PACKET + 8 * half), last[i][half]);
            }
        }
    }
    octants
}

/// Sixteen numbers.
type RayHalves = [__m256; 2];

#[inline]
#[target_feature(enable = "avx2")]
fn minus(row: &Lanes) -> RayHalves {
    load(row).map(|half| _mm256_xor_ps(half, _mm256_set1_ps(-0.0)))
}

#[inline]
#[target_feature(enable = "avx2")]
fn load(row: &Lanes) -> RayHalves {
    // SAFETY: sixteen numbers.
    unsafe { [0, 8].map(|i| _mm256_loadu_ps(row.as_ptr().add(i))) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_words(row: &Words) -> RayHalves {
    // SAFETY: sixteen words.
    unsafe { [0, 8].map(|i| _mm256_loadu_ps(row.as_ptr().add(i).cast())) }
}

/// Rows become columns.
#[inline]
#[target_feature(enable = "avx2")]
fn transpose(rows: [RayHalves; PACKET]) -> [RayHalves; PACKET] {
    let mut columns = [[_mm256_setzero_ps(); 2]; PACKET];
    for upper in 0..2 {
        for right in 0..2 {
            let quarter = std::array::from_fn(|i| rows[8 * upper + i][right]);
            for (i, column) in transpose_eight(quarter).into_iter().enumerate() {
                columns[8 * right + i][upper] = column;
            }
        }
    }
    columns
}

/// The same of eight rows of eight.
#[inline]
#[target_feature(enable = "avx2")]
fn transpose_eight(rows: [__m256; 8]) -> [__m256; 8] {
    let zero = _mm256_setzero_ps();
    // Of four rows each, in both halves of vectors: columns j and 4 + j.
    let mut quads = [[zero; 4]; 2];
    for q in 0..2 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| _mm256_castps_pd(rows[4 * q + i]));
        let low = |p, q| _mm256_unpacklo_ps(_mm256_castpd_ps(p), _mm256_castpd_ps(q));
        let high = |p, q| _mm256_unpackhi_ps(_mm256_castpd_ps(p), _mm256_castpd_ps(q));
        let [ab_low, ab_high] = [low(a, b), high(a, b)].map(|v| _mm256_castps_pd(v));
        let [cd_low, cd_high] = [low(c, d), high(c, d)].map(|v| _mm256_castps_pd(v));
        quads[q] = [
            _mm256_castpd_ps(_mm256_unpacklo_pd(ab_low, cd_low)),
            _mm256_castpd_ps(_mm256_unpackhi_pd(ab_low, cd_low)),
            _mm256_castpd_ps(_mm256_unpacklo_pd(ab_high, cd_high)),
            _mm256_castpd_ps(_mm256_unpackhi_pd(ab_high, cd_high)),
        ];
    }
    let mut columns = [zero; 8];
    for j in 0..4 {
        columns[j] = _mm256_permute2f128_ps::<0x20>(quads[0][j], quads[1][j]);
        columns[4 + j] = _mm256_permute2f128_ps::<0x31>(quads[0][j], quads[1][j]);
    }
    columns
}
