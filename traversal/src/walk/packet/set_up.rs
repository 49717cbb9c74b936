//! Sets up the rays of a packet for one level: in the registers of the instruction set, sixteen
//! rays at once.
//!
//! Along each axis the rays of a packet have directions other than 0 and of one sign, and all are
//! longest along one axis. So what `LevelRays` has for other rays is not needed here.

use lanes::LaneMask;
use lanes::vector::Vector;

use super::kernel::PacketKernel;
use super::rays::{Rays, STEEP};
use crate::layout::{InstanceRecord, instance_state};
use crate::walk::PACKET;
use crate::walk::level_ray::{MARGIN, MODEST};
use crate::walk::level_rays::{AXIS, INFINITE, LevelRays, ROW, longest};
use crate::walk::rows::{Lanes, RayRows, bits_of_mut, load_row};

/// Directions differ by at most this, relative to the longest component.
pub(super) const SPREAD: f32 = 0.125;

/// Origins differ by at most this, relative to their distance from the origin of space.
const WIDTH_OF_BEAM: f32 = 1.0 / 64.0;

/// The same for directions and origins of rays that are nearly parallel: to one light far away, for
/// instance.
const SPREAD_OF_PARALLEL: f32 = 1.0 / 256.0;
const WIDTH_OF_PARALLEL: f32 = 1.0 / 4.0;

/// The bits of a number but its sign.
const SIZE: i32 = i32::MAX;

#[inline(always)]
fn store<V: Vector>(v: V, numbers: V::F, row: &mut Lanes) {
    v.store(numbers, bits_of_mut(row));
}

/// The bits of numbers without their signs: in the order of sizes, NaN last.
#[inline(always)]
fn sizes<V: Vector>(v: V, numbers: V::F) -> V::I {
    v.and_i(v.bits_of(numbers), v.splat_i(SIZE))
}

#[inline(always)]
fn negated<V: Vector>(v: V, numbers: V::F) -> V::F {
    v.bits_to_f(v.xor_i(v.bits_of(numbers), v.splat_i(i32::MIN)))
}

/// Lanes whose word is less than a constant; all are positive.
#[inline(always)]
fn less<V: Vector>(v: V, words: V::I, constant: u32) -> LaneMask {
    let constant = v.splat_i(constant as i32);
    LaneMask::from_bits(v.ne_i(v.max_i(words, constant), words))
}

/// How far vectors are from the first one, along the axis where they are farthest.
#[inline(always)]
fn distance_from_first<V: Vector>(v: V, rows: &[Lanes; 3]) -> V::F {
    let [x, y, z] = [
        v.sub(load_row(v, &rows[0]), v.splat(rows[0][0])),
        v.sub(load_row(v, &rows[1]), v.splat(rows[1][0])),
        v.sub(load_row(v, &rows[2]), v.splat(rows[2][0])),
    ];
    let [x, y, z] = [
        v.bits_to_f(sizes(v, x)),
        v.bits_to_f(sizes(v, y)),
        v.bits_to_f(sizes(v, z)),
    ];
    v.max(x, v.max(y, z))
}

/// The size of the greatest of some vectors' components.
#[inline(always)]
fn greatest_sizes<V: Vector>(v: V, [x, y, z]: [V::F; 3]) -> V::I {
    v.max_i(sizes(v, x), v.max_i(sizes(v, y), sizes(v, z)))
}

#[inline(always)]
fn load_three<V: Vector>(v: V, rows: &[Lanes; 3]) -> [V::F; 3] {
    [
        load_row(v, &rows[0]),
        load_row(v, &rows[1]),
        load_row(v, &rows[2]),
    ]
}

/// The longest component.
#[inline]
pub(super) fn most(vector: &[f32; 3]) -> f32 {
    vector.iter().fold(0f32, |most, c| most.max(c.abs()))
}

/// Lanes whose number is at most another.
#[inline(always)]
fn at_most<V: Vector>(v: V, numbers: V::F, most: f32) -> u16 {
    v.ge(v.splat(most), numbers)
}

/// Whether all of some rays, those of `lanes` and others like the first, are rays that can hit
/// anything, start near each other (by the size of their distances from the origin of space), and
/// go the same way.
#[inline(always)]
pub(super) fn cohere<V: Vector>(v: V, rays: &RayRows, lanes: LaneMask) -> bool {
    let (o, d) = (&rays.origin, &rays.direction);
    let longest = most(&[d[0][0], d[1][0], d[2][0]]);
    let farthest = most(&[o[0][0], o[1][0], o[2][0]]);
    let turned = distance_from_first(v, d);
    let moved = distance_from_first(v, o);
    let close = at_most(v, turned, SPREAD * longest) & at_most(v, moved, WIDTH_OF_BEAM * farthest)
        | at_most(v, turned, SPREAD_OF_PARALLEL * longest)
            & at_most(v, moved, WIDTH_OF_PARALLEL * farthest);
    let sizes = v.max_i(
        greatest_sizes(v, load_three(v, o)),
        greatest_sizes(v, load_three(v, d)),
    );
    let has_length = v.ge(load_row(v, &rays.t_max), load_row(v, &rays.t_min));
    (lanes - (less(v, sizes, INFINITE) & LaneMask::from_bits(close & has_length))).is_empty()
}

/// Three rows of numbers times the 3 × 3 part of a row-major 3 × 4 matrix.
#[inline(always)]
fn turn<V: Vector>(v: V, m: &[f32; 12], [x, y, z]: [V::F; 3]) -> [V::F; 3] {
    let mut turned = [x, y, z];
    for (row, turned) in turned.iter_mut().enumerate() {
        let of_x = v.mul(v.splat(m[4 * row]), x);
        let of_y = v.mul(v.splat(m[4 * row + 1]), y);
        let of_z = v.mul(v.splat(m[4 * row + 2]), z);
        *turned = v.add(v.add(of_x, of_y), of_z);
    }
    turned
}

/// Lanes whose directions have their longest component along an axis.
#[inline(always)]
fn longest_along<V: Vector>(v: V, axis: usize, d: [V::F; 3]) -> LaneMask {
    let [x, y, z] = [
        v.bits_to_f(sizes(v, d[0])),
        v.bits_to_f(sizes(v, d[1])),
        v.bits_to_f(sizes(v, d[2])),
    ];
    let is_x = v.gt(x, y) & v.gt(x, z);
    let is_y = v.ge(y, x) & v.gt(y, z);
    LaneMask::from_bits(match axis {
        0 => is_x,
        1 => is_y,
        _ => !(is_x | is_y),
    })
}

/// The octant of a packet's rays: their longest axis, and the signs of their directions.
struct Octant {
    /// The rays' own axes: two that follow the longest one in turn, and that.
    own_axes: [usize; 3],
    /// By axis: directions are negative.
    is_backward: [bool; 3],
}

impl Octant {
    /// The octant of a ray with a direction.
    #[inline(always)]
    fn of(direction: [f32; 3]) -> Octant {
        let own_axes = match longest(direction[0], direction[1], direction[2]) {
            (true, _) => [1, 2, 0],
            (_, true) => [2, 0, 1],
            _ => [0, 1, 2],
        };
        let [x, y, z] = direction;
        let is_backward = [x < 0.0, y < 0.0, z < 0.0];
        Octant {
            own_axes: match is_backward[own_axes[2]] {
                true => [own_axes[1], own_axes[0], own_axes[2]],
                false => own_axes,
            },
            is_backward,
        }
    }

    /// Which of the own axes an axis is.
    #[inline(always)]
    fn place_of(&self, axis: usize) -> usize {
        let [first, second, _] = self.own_axes;
        match axis {
            _ if axis == first => 0,
            _ if axis == second => 1,
            _ => 2,
        }
    }

    /// Lanes whose rays lie in this octant and have this longest axis.
    #[inline(always)]
    fn goes<V: Vector>(&self, v: V, d: [V::F; 3]) -> LaneMask {
        let zero = v.splat(0.0);
        let mut alike = longest_along(v, self.own_axes[2], d);
        for (d, is_backward) in d.into_iter().zip(self.is_backward) {
            let negative = LaneMask::from_bits(v.gt(zero, d));
            alike &= match is_backward {
                true => negative,
                false => !negative,
            };
        }
        alike
    }
}

/// Sets up what tests of triangles need, but the inverse of directions along the longest axis.
/// Returns which rays are of ordinary length.
#[inline(always)]
fn set_up_shear<V: Vector>(v: V, level_rays: &mut LevelRays, own_axes: [usize; 3]) -> LaneMask {
    let direction_z = load_row(v, &level_rays.space_direction[own_axes[2]]);
    for k in 0..2 {
        let direction = load_row(v, &level_rays.space_direction[own_axes[k]]);
        store(v, v.div(direction, direction_z), &mut level_rays.shear[k]);
    }
    store(v, negated(v, direction_z), &mut level_rays.direction_z);
    let length = v.bits_to_f(sizes(v, direction_z));
    let is_short = v.ge(v.splat(*MODEST.end()), length);
    LaneMask::from_bits(v.ge(length, v.splat(*MODEST.start())) & is_short)
}

/// Origins for near and for far planes, so that boxes are larger by an error relative to the size
/// of the origin.
#[inline(always)]
fn widened<V: Vector>(
    v: V,
    origin: V::F,
    size: V::F,
    error: Option<f32>,
    is_backward: bool,
) -> (V::F, V::F) {
    let Some(error) = error else {
        return (origin, origin);
    };
    let toward = v.mul(size, v.splat(if is_backward { -error } else { error }));
    (v.add(origin, toward), v.sub(origin, toward))
}

impl Rays {
    /// Sets up the rays of `lanes` for a top level. Returns the rays whose signs and longest axis
    /// are those of the first one, or none if the numbers of some ray are too large or its inverses
    /// too steep. The set-up is complete only if all rays are returned.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn set_up_top<K: PacketKernel>(
        &mut self,
        rays: &RayRows,
        origin_error: f32,
        lanes: LaneMask,
    ) -> LaneMask {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe {
            let v = K::V::new();
            let (o, d) = (load_three(v, &rays.origin), load_three(v, &rays.direction));
            self.set_up::<K>((o, d), &rays.t_min, Some(origin_error), (lanes, true))
        }
    }

    /// The same for an instance that does not move; with or without bounds of all rays.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn set_up_instance<K: PacketKernel>(
        &mut self,
        rays: &RayRows,
        record: &InstanceRecord,
        (lanes, has_bounds): (LaneMask, bool),
    ) -> LaneMask {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe {
            let v = K::V::new();
            let (mut o, mut d) = (load_three(v, &rays.origin), load_three(v, &rays.direction));
            if record.words.state & instance_state::IDENTITY == 0 {
                // As `Level::place` does.
                let (to_world, to_object) = (&record.object_to_world, &record.world_to_object);
                let from = [
                    v.sub(o[0], v.splat(to_world[3])),
                    v.sub(o[1], v.splat(to_world[7])),
                    v.sub(o[2], v.splat(to_world[11])),
                ];
                (o, d) = (turn(v, to_object, from), turn(v, to_object, d));
            }
            self.set_up::<K>((o, d), &rays.t_min, None, (lanes, has_bounds))
        }
    }

    /// Sets up rays that are in the space of a level, and their common signs, axis and bounds.
    /// Returns the same lanes as [`Self::set_up_top`]. `origin_error`: the growth of boxes in a top
    /// level, relative to the distance of the rays' origins from that of space.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn set_up<K: PacketKernel>(
        &mut self,
        (o, d): ([<K::V as Vector>::F; 3], [<K::V as Vector>::F; 3]),
        t_min: &Lanes,
        origin_error: Option<f32>,
        (lanes, has_bounds): (LaneMask, bool),
    ) -> LaneMask {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let v = unsafe { K::V::new() };
        self.hits_of = 0;
        self.has_bounds = has_bounds;
        let first = lanes.first();
        let level_rays = &mut self.level_rays;
        for axis in 0..3 {
            store(v, o[axis], &mut level_rays.space_origin[axis]);
            store(v, d[axis], &mut level_rays.space_direction[axis]);
        }
        let space = &level_rays.space_direction;
        let octant = Octant::of([space[0][first], space[1][first], space[2][first]]);
        let alike = octant.goes(v, d) & lanes;
        if alike != lanes {
            return alike;
        }
        let reach = greatest_sizes(v, o);
        if !(lanes - less(v, reach, INFINITE)).is_empty() {
            return LaneMask::NONE;
        }
        let reach = v.bits_to_f(reach);
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let steep = unsafe {
            // Written out, so that each has known places.
            let x = self.set_up_axis::<K>(0, (o[0], d[0]), &octant, (reach, origin_error), lanes);
            let y = self.set_up_axis::<K>(1, (o[1], d[1]), &octant, (reach, origin_error), lanes);
            let z = self.set_up_axis::<K>(2, (o[2], d[2]), &octant, (reach, origin_error), lanes);
            v.max_i(x, v.max_i(y, z))
        };
        let level_rays = &mut self.level_rays;
        let is_modest = set_up_shear(v, level_rays, octant.own_axes);
        let t_min = v.max(load_row(v, t_min), v.splat(0.0));
        store(v, t_min, &mut level_rays.t_min);
        if has_bounds {
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            self.interval.t_min = unsafe { K::least(t_min, lanes) };
        }
        let is_sound = less(v, steep, STEEP.to_bits()) & is_modest;
        match (lanes - is_sound).is_empty() {
            true => lanes,
            false => LaneMask::NONE,
        }
    }

    /// Sets rays up along an axis of space. Returns how steep they are to its planes.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn set_up_axis<K: PacketKernel>(
        &mut self,
        axis: usize,
        (origin, direction): (<K::V as Vector>::F, <K::V as Vector>::F),
        octant: &Octant,
        (reach, origin_error): (<K::V as Vector>::F, Option<f32>),
        lanes: LaneMask,
    ) -> <K::V as Vector>::I {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let v = unsafe { K::V::new() };
        let (k, is_backward) = (octant.place_of(axis), octant.is_backward[axis]);
        let row = axis * 2 * ROW as usize + if is_backward { ROW as usize } else { 0 };
        (self.near_rows[k], self.axes[k]) = (row, axis * AXIS as usize);
        let level_rays = &mut self.level_rays;
        if K::BY_RAYS || self.has_bounds {
            level_rays.axes[k] = [axis as u32 * AXIS; PACKET];
        }
        if K::BY_RAYS {
            level_rays.near_rows[k] = [row as u32; PACKET];
        }
        let inverse = v.div(v.splat(1.0), direction);
        let near_inverse = v.mul(inverse, v.splat(-(1.0 - MARGIN)));
        let far_inverse = v.mul(inverse, v.splat(-(1.0 + MARGIN)));
        store(v, near_inverse, &mut level_rays.near_inverse[k]);
        store(v, far_inverse, &mut level_rays.far_inverse[k]);
        if k == 2 {
            store(v, negated(v, inverse), &mut level_rays.inverse_z);
        }
        let (near, far) = widened(v, origin, reach, origin_error, is_backward);
        store(v, near, &mut level_rays.origin[k]);
        store(v, far, &mut level_rays.far_origin[k]);
        if self.has_bounds {
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            unsafe { self.set_bounds::<K>(k, (near, far), near_inverse, is_backward, lanes) };
        }
        sizes(v, near_inverse)
    }

    /// Finds the bounds of all rays along one of their own axes.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn set_bounds<K: PacketKernel>(
        &mut self,
        k: usize,
        (near, far): (<K::V as Vector>::F, <K::V as Vector>::F),
        near_inverse: <K::V as Vector>::F,
        is_backward: bool,
        lanes: LaneMask,
    ) {
        let (interval, level_rays) = (&mut self.interval, &self.level_rays);
        // Rays of a camera have one origin.
        let first = lanes.first();
        let one = level_rays.origin[k][first];
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe {
            let v = K::V::new();
            let others = v.ne_i(v.bits_of(near), v.bits_of(v.splat(one)));
            (interval.near_origin[k], interval.far_origin[k]) = match (others, is_backward) {
                (0, _) => (one, level_rays.far_origin[k][first]),
                (_, true) => (K::least(near, lanes), K::greatest(far, lanes)),
                (_, false) => (K::greatest(near, lanes), K::least(far, lanes)),
            };
            let [low, high] = [
                K::least(near_inverse, lanes),
                K::greatest(near_inverse, lanes),
            ];
            interval.near_inverse[k] = [low, high];
            // Those of far planes are larger by two margins and some roundings.
            let wider = 1.0 + 4.0 * MARGIN;
            interval.far_inverse[k] = match is_backward {
                true => [low, high * wider],
                false => [low * wider, high],
            };
        }
    }
}
