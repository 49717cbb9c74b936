//! The builders' input: a box around each active primitive, and the primitive's index.

use super::motion::motion_bounds;
use super::swept_sphere::swept_bounds;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use super::corners::Corners;
use super::vertex::sanitized_triangle_bounds;
use crate::input::{AabbGeometry, BuildFlags, Geometries, InstanceSource, TriangleGeometry};
use crate::layout::Bounds;
use crate::pool::in_pool;

/// A primitive and its box, limited to [`FAR`]; laid out as [`Corners`] are.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Primitive {
    min: [f32; 3],
    /// Index of the geometry; [`INACTIVE`] while collecting.
    pub geometry: u32,
    negative_max: [f32; 3],
    /// Index within the geometry; for instances, of the instance.
    pub index: u32,
}

const INACTIVE: u32 = u32::MAX;

/// Coordinates are clamped to this while primitives are sorted, so that all intermediate results
/// are finite. The exact boxes are stored at the end.
pub(crate) const FAR: f32 = 1.0e37;

impl Primitive {
    /// Clamps the box, and records in `limited` whether that changed it.
    fn new(bounds: Bounds, geometry: u32, index: u32, limited: &AtomicBool) -> Primitive {
        let mut primitive = Primitive {
            min: bounds.min,
            geometry,
            negative_max: bounds.max.map(|c| -c),
            index,
        };
        let most = |corner: &[f32; 3]| corner.iter().fold(0f32, |most, c| most.max(c.abs()));
        if most(&primitive.min).max(most(&primitive.negative_max)) > FAR {
            let limit = |corner: [f32; 3]| corner.map(|c| c.clamp(-FAR, FAR));
            primitive.min = limit(primitive.min);
            primitive.negative_max = limit(primitive.negative_max);
            limited.store(true, Relaxed);
        }
        primitive
    }

    pub const HOLE: Primitive = Primitive {
        min: [0.0; 3],
        geometry: INACTIVE,
        negative_max: [0.0; 3],
        index: 0,
    };

    /// The box.
    pub fn bounds(&self) -> Bounds {
        self.corners().bounds()
    }

    /// Twice the center on an axis.
    #[inline(always)]
    pub fn center(&self, axis: usize) -> f32 {
        self.min[axis] - self.negative_max[axis]
    }

    /// The box, with zeros in place of the indices: as floats they would be denormal, which is a
    /// hundred times slower.
    #[inline(always)]
    pub fn corners(&self) -> Corners {
        // SAFETY: of the same size and alignment, and any bits are a u32.
        let mut words = unsafe { std::ptr::from_ref(self).cast::<[u32; 8]>().read() };
        for (word, mask) in words.iter_mut().zip(COORDINATES) {
            *word &= mask;
        }
        Corners(words.map(f32::from_bits))
    }
}

/// The float words of a primitive.
const COORDINATES: [u32; 8] = [!0, !0, !0, 0, !0, !0, !0, 0];

/// Primitives handled by one task.
pub(crate) const CHUNK: usize = 4096;

/// The result of [`collect`].
pub(crate) struct Collected {
    /// Number of active primitives.
    pub count: usize,
    /// Some boxes extend past [`FAR`].
    pub limited: bool,
}

/// Fills the front of `primitives` with the active ones, in order. `primitives` has an element for
/// each primitive, active or not.
///
/// # Safety
/// The memory of `geometries` must be readable and unchanged.
pub(crate) unsafe fn collect(
    geometries: &Geometries<'_>,
    flags: BuildFlags,
    primitives: &mut [Primitive],
) -> Collected {
    let updatable = flags.contains(BuildFlags::ALLOW_UPDATE);
    match geometries {
        Geometries::Triangles(list) => {
            let counts = list.iter().map(|geometry| geometry.primitive_count);
            fill(primitives, counts, |g, i| {
                // SAFETY: the caller guarantees that the memory of `geometries` is readable and
                // unchanged.
                unsafe { triangle_bounds(&list[g], i, updatable) }
            })
        }
        Geometries::Aabbs(list) => {
            let counts = list.iter().map(|geometry| geometry.primitive_count);
            // SAFETY: the caller guarantees that the memory of `geometries` is readable and
            // unchanged.
            fill(primitives, counts, |g, i| unsafe { aabb(&list[g], i) })
        }
        Geometries::Swept(list) => {
            let counts = list.iter().map(|geometry| geometry.primitive_count);
            fill(primitives, counts, |g, i| {
                // SAFETY: the caller guarantees that the memory of `geometries` is readable and
                // unchanged.
                unsafe { swept_bounds(&list[g], i, updatable) }
            })
        }
        Geometries::Motion(list) => {
            let counts = list.iter().map(|geometry| geometry.start.primitive_count);
            fill(primitives, counts, |g, i| {
                // SAFETY: the caller guarantees that the memory of `geometries` is readable and
                // unchanged.
                unsafe { list[g].triangles(i) }.map(|both| motion_bounds(&both))
            })
        }
        Geometries::Instances(source) => fill(primitives, [source.count].into_iter(), |_, i| {
            // SAFETY: the caller guarantees that the memory of `geometries` is readable and
            // unchanged.
            unsafe { instance_bounds(source, i) }
        }),
    }
}

/// Fills in the boxes geometry by geometry, then closes the gaps that inactive primitives leave.
fn fill(
    primitives: &mut [Primitive],
    counts: impl Iterator<Item = u32>,
    bounds: impl Fn(usize, u32) -> Option<Bounds> + Sync,
) -> Collected {
    let limited = AtomicBool::new(false);
    let holes = AtomicBool::new(false);
    let mut start = 0;
    let mut length = 0;
    for (geometry, count) in counts.enumerate() {
        let end = start + count as usize;
        let places = &mut primitives[start..end];
        let fill_chunk = |(chunk, places): (usize, &mut [Primitive])| {
            for (i, place) in places.iter_mut().enumerate() {
                let index = (chunk * CHUNK + i) as u32;
                *place = match bounds(geometry, index) {
                    Some(bounds) => Primitive::new(bounds, geometry as u32, index, &limited),
                    None => {
                        holes.store(true, Relaxed);
                        Primitive::HOLE
                    }
                };
            }
        };
        if in_pool() && places.len() > CHUNK {
            places
                .par_chunks_mut(CHUNK)
                .enumerate()
                .for_each(fill_chunk);
        } else {
            places.chunks_mut(CHUNK).enumerate().for_each(fill_chunk);
        }
        if !holes.load(Relaxed) {
            length = end;
        }
        for i in length.max(start)..end {
            if primitives[i].geometry != INACTIVE {
                primitives[length] = primitives[i];
                length += 1;
            }
        }
        start = end;
    }
    Collected {
        count: length,
        limited: limited.into_inner(),
    }
}

const SIGN: u32 = 1 << 31;

/// The box of an active triangle. A triangle with an infinite coordinate can never be hit, so it is
/// left out, unless an update might move it: then its box is the finite part.
///
/// # Safety
/// The geometry's memory must be readable and unchanged.
#[inline(always)]
unsafe fn triangle_bounds(
    geometry: &TriangleGeometry,
    index: u32,
    updatable: bool,
) -> Option<Bounds> {
    // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
    let triangle = unsafe { geometry.triangle(index) }?;
    let most = (triangle.as_flattened().iter()).fold(0, |most, c| most.max(c.to_bits() & !SIGN));
    if f32::from_bits(most).is_finite() {
        // There are no NaNs, so comparisons suffice, which are faster than `min` and `max`.
        let [a, b, c] = triangle;
        let lesser = |a: f32, b: f32| if a < b { a } else { b };
        let greater = |a: f32, b: f32| if a > b { a } else { b };
        Some(Bounds {
            min: std::array::from_fn(|i| lesser(lesser(a[i], b[i]), c[i])),
            max: std::array::from_fn(|i| greater(greater(a[i], b[i]), c[i])),
        })
    } else if updatable {
        Some(sanitized_triangle_bounds(&triangle))
    } else {
        None
    }
}

/// An active box: `min x` is no NaN, and no maximum is below its minimum.
///
/// # Safety
/// The geometry's memory must be readable and unchanged.
pub(crate) unsafe fn aabb(geometry: &AabbGeometry, index: u32) -> Option<Bounds> {
    let offset = u64::from(index).checked_mul(geometry.stride_bytes)?;
    // SAFETY: the caller guarantees that the geometry's memory is readable and unchanged.
    let bytes = unsafe { geometry.boxes.read::<24>(offset) }?;
    let float = |i: usize| f32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap());
    let bounds = Bounds {
        min: [float(0), float(1), float(2)],
        max: [float(3), float(4), float(5)],
    };
    (0..3)
        .all(|i| bounds.min[i] <= bounds.max[i])
        .then_some(bounds)
}

/// # Safety
/// As for [`collect`].
unsafe fn instance_bounds(source: &InstanceSource<'_>, index: u32) -> Option<Bounds> {
    // SAFETY: the caller keeps the promises of `collect`.
    let instance = unsafe { super::instance::read(source, index) }?;
    // SAFETY: references are 0 or built bottom levels; the caller guarantees that the memory of
    // `geometries` is readable and unchanged.
    unsafe { instance.place(source.live) }.map(|placed| placed.bounds)
}

const _: () = assert!(size_of::<Primitive>() == size_of::<Corners>());
