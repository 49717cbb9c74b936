//! The rays of a list in a bottom level, set up at once: an array of sixteen for each number.
//!
//! The counterpart of [`LevelRay`] for sixteen rays of ordinary length, in structures whose
//! distances are not scaled. Loops over lanes are written so that compilers vectorize them.

use lanes::LaneMask;

use super::PACKET;
use super::level_ray::{LevelRay, MARGIN, MODEST, max};
use super::options::Accuracy;
use super::rows::{Lanes, RayRows, Words, blend};
use crate::layout::{GROUP, InstanceRecord, WIDTH, instance_state};

/// Bits of infinity without the sign: larger values are not finite.
pub(super) const INFINITE: u32 = f32::INFINITY.to_bits();

/// The bits of a number without its sign: in the order of sizes.
#[inline(always)]
fn magnitude(v: f32) -> u32 {
    v.to_bits() & !(1 << 31)
}

/// The next lower number; of what is none, anything.
#[inline(always)]
fn lower(v: f32) -> f32 {
    let bits = v.to_bits() as i32;
    let next = if v > 0.0 {
        bits - 1
    } else {
        bits.wrapping_add(1)
    };
    f32::from_bits(if v == 0.0 { 0x8000_0001 } else { next as u32 })
}

/// The number of an axis. By masks: of a choice between numbers in memory, compilers make a choice
/// between addresses, and gather.
#[inline(always)]
fn pick(axis: u32, x: f32, y: f32, z: f32) -> f32 {
    let only_if = |wanted: bool, v: f32| v.to_bits() & 0u32.wrapping_sub(u32::from(wanted));
    let bits = only_if(axis == 0, x) | only_if(axis == 1, y) | only_if(axis == 2, z);
    f32::from_bits(bits)
}

/// Bytes from one axis of a vertex to the next.
pub(crate) const AXIS: u32 = size_of::<[f32; GROUP]>() as u32;

/// Bytes of a row of a node.
pub(crate) const ROW: u32 = size_of::<[f32; WIDTH]>() as u32;

/// The values of a ray that box tests need along an axis; see [`LevelRays`].
struct Terms {
    far_origin: f32,
    near_inverse: f32,
    far_inverse: f32,
}

impl Terms {
    #[inline(always)]
    fn new(origin: f32, direction: f32) -> Terms {
        // A zero counts as positive.
        let inverse = 1.0 / (direction + 0.0);
        Terms {
            far_origin: if direction == 0.0 {
                lower(origin)
            } else {
                origin
            },
            near_inverse: -(inverse * (1.0 - MARGIN)),
            far_inverse: -(inverse * (1.0 + MARGIN)),
        }
    }

    /// Whether numbers are such that tests say what is.
    #[inline(always)]
    fn is_sound(&self, origin: f32, direction: f32) -> bool {
        let reaches = (magnitude(self.far_inverse) < INFINITE) | (direction == 0.0);
        reaches & (magnitude(origin) < INFINITE)
    }
}

/// Whether a direction is longest along x, or along y, as `LevelRay::set` finds it; else it is
/// along z.
#[inline(always)]
pub(super) fn longest(x: f32, y: f32, z: f32) -> (bool, bool) {
    let [x, y, z] = [x.abs(), y.abs(), z.abs()];
    ((x > y) & (x > z), (y >= x) & (y > z))
}

/// The values of rays that box tests need, by the axes of space.
#[cfg(target_arch = "x86_64")]
#[repr(C, align(64))]
pub(crate) struct BoxRays {
    pub origin: [Lanes; 3],
    pub far_origin: [Lanes; 3],
    pub near_inverse: [Lanes; 3],
    pub far_inverse: [Lanes; 3],
}

/// Rays in world space.
#[repr(C, align(64))]
pub(crate) struct WorldRays {
    pub origin: [Lanes; 3],
    pub direction: [Lanes; 3],
    pub t_min: Lanes,
    /// 1 where there is a ray that can hit anything.
    pub sound: Words,
}

impl WorldRays {
    /// The rays of some lanes. Other lanes repeat the first of them, so that they compute no
    /// exceptional values.
    #[inline(always)]
    pub fn new(rays: &RayRows, lanes: LaneMask) -> WorldRays {
        let first = lanes.first();
        let pick = |row: &Lanes| {
            let mut picked = [row[first]; PACKET];
            blend(&mut picked, row, lanes);
            picked
        };
        let mut world_rays = WorldRays {
            origin: [
                pick(&rays.origin[0]),
                pick(&rays.origin[1]),
                pick(&rays.origin[2]),
            ],
            direction: [
                pick(&rays.direction[0]),
                pick(&rays.direction[1]),
                pick(&rays.direction[2]),
            ],
            t_min: pick(&rays.t_min),
            sound: [0; PACKET],
        };
        let (o, d) = (&world_rays.origin, &world_rays.direction);
        for i in 0..PACKET {
            let most = magnitude(o[0][i]).max(magnitude(o[1][i]).max(magnitude(o[2][i])));
            let most = magnitude(d[0][i]).max(magnitude(d[1][i]).max(magnitude(d[2][i]).max(most)));
            let there = lanes.contains(i);
            let sound = (most < INFINITE) & (world_rays.t_min[i] <= rays.t_max[i]) & there;
            world_rays.sound[i] = u32::from(sound);
        }
        world_rays
    }
}

/// Rays by their own axes: two, then the one along which the direction is longest; the first two
/// are swapped if that is negative. See [`LevelRay::axes`].
#[repr(C, align(64))]
pub(crate) struct LevelRays {
    pub origin: [Lanes; 3],
    /// The origin for far planes. The next lower number where the direction is 0: so a plane
    /// through the origin, which it meets everywhere, is beyond it, not at 0 · ∞.
    pub far_origin: [Lanes; 3],
    /// One over the direction, made smaller for near planes and larger for far ones, with the
    /// opposite sign: distances are `(o − p) · −(1/d)`.
    pub near_inverse: [Lanes; 3],
    pub far_inverse: [Lanes; 3],
    /// Offsets in bytes of the rows of a node with the near planes.
    pub near_rows: [Words; 3],
    /// Offsets in bytes of the axes in a vertex.
    pub axes: [Words; 3],
    /// The direction's first two over its third component.
    pub shear: [Lanes; 2],
    /// One over the third component, with the opposite sign.
    pub inverse_z: Lanes,
    /// The third component, with the opposite sign.
    pub direction_z: Lanes,
    /// Lower ends of the intervals; not negative.
    pub t_min: Lanes,
    /// As given, by the axes of space.
    pub space_origin: [Lanes; 3],
    pub space_direction: [Lanes; 3],
    /// [`Accuracy::tolerance`].
    pub tolerance: f32,
}

impl LevelRays {
    /// No rays.
    pub const EMPTY: LevelRays = LevelRays {
        origin: [[0.0; PACKET]; 3],
        far_origin: [[0.0; PACKET]; 3],
        near_inverse: [[0.0; PACKET]; 3],
        far_inverse: [[0.0; PACKET]; 3],
        near_rows: [[0; PACKET]; 3],
        axes: [[0; PACKET]; 3],
        shear: [[0.0; PACKET]; 2],
        inverse_z: [0.0; PACKET],
        direction_z: [0.0; PACKET],
        t_min: [0.0; PACKET],
        space_origin: [[0.0; PACKET]; 3],
        space_direction: [[0.0; PACKET]; 3],
        tolerance: Accuracy::Spec.tolerance(),
    };

    /// Sets rays up in an instance that does not move; returns the lanes for which the set-up is
    /// complete: rays without NaN and of ordinary length.
    #[inline(always)]
    pub fn set_up(&mut self, world_rays: &WorldRays, record: &InstanceRecord) -> LaneMask {
        self.start_instance(world_rays, record);
        self.derive(world_rays)
    }

    /// Sets rays up in a top level; returns what [`Self::set_up`] does. `origin_error`: as for
    /// [`Self::widen`].
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn set_up_top(&mut self, world_rays: &WorldRays, origin_error: f32) -> LaneMask {
        self.start_top(world_rays);
        let sound = self.derive(world_rays);
        self.widen(world_rays, origin_error);
        sound
    }

    /// Takes rays as they are in a top level.
    #[inline(always)]
    fn start_top(&mut self, world_rays: &WorldRays) {
        self.space_origin = world_rays.origin;
        self.space_direction = world_rays.direction;
    }

    /// Takes rays to an instance that does not move.
    #[inline(always)]
    pub fn start_instance(&mut self, world_rays: &WorldRays, record: &InstanceRecord) {
        self.start_top(world_rays);
        if record.words.state & instance_state::IDENTITY == 0 {
            self.turn(record);
        }
    }

    /// Makes boxes larger by how far off rays may be in a top level, relative to how far from the
    /// origin of space they start.
    #[inline(always)]
    pub fn widen(&mut self, world_rays: &WorldRays, origin_error: f32) {
        let o = &world_rays.origin;
        for i in 0..PACKET {
            let reach = max(o[0][i].abs(), max(o[1][i].abs(), o[2][i].abs()));
            let uncertainty = reach * origin_error;
            for k in 0..3 {
                let toward = uncertainty.copysign(-self.near_inverse[k][i]);
                self.far_origin[k][i] -= toward;
                self.origin[k][i] += toward;
            }
        }
    }

    /// Moves rays to the space of an instance, as [`Level::place`](super::level::Level::place)
    /// does.
    #[inline(always)]
    fn turn(&mut self, record: &InstanceRecord) {
        let (to_world, m) = (&record.object_to_world, &record.world_to_object);
        let (o, d) = (&mut self.space_origin, &mut self.space_direction);
        for i in 0..PACKET {
            let (x, y, z) = (
                o[0][i] - to_world[3],
                o[1][i] - to_world[7],
                o[2][i] - to_world[11],
            );
            o[0][i] = m[0] * x + m[1] * y + m[2] * z;
            o[1][i] = m[4] * x + m[5] * y + m[6] * z;
            o[2][i] = m[8] * x + m[9] * y + m[10] * z;
            let (x, y, z) = (d[0][i], d[1][i], d[2][i]);
            d[0][i] = m[0] * x + m[1] * y + m[2] * z;
            d[1][i] = m[4] * x + m[5] * y + m[6] * z;
            d[2][i] = m[8] * x + m[9] * y + m[10] * z;
        }
    }

    /// Sets up from origins and directions; returns the lanes that this is for.
    #[inline(always)]
    fn derive(&mut self, world_rays: &WorldRays) -> LaneMask {
        let mut sound = world_rays.sound;
        let d = &self.space_direction;
        // The longest axis, as `LevelRay::set` finds it, and the two that follow in turn.
        let mut axes = [[0u32; PACKET]; 3];
        for i in 0..PACKET {
            let (is_x, is_y) = longest(d[0][i], d[1][i], d[2][i]);
            let longest = if is_x {
                0
            } else if is_y {
                1
            } else {
                2
            };
            let direction = pick(longest, d[0][i], d[1][i], d[2][i]);
            let first = if is_x {
                1
            } else if is_y {
                2
            } else {
                0
            };
            let second = if is_x {
                2
            } else if is_y {
                0
            } else {
                1
            };
            let backward = direction < 0.0;
            axes[0][i] = if backward { second } else { first };
            axes[1][i] = if backward { first } else { second };
            axes[2][i] = longest;
        }
        // Written out, so that each is a loop of its own with known places.
        let directions = [
            self.derive_axis(0, &axes[0], &mut sound),
            self.derive_axis(1, &axes[1], &mut sound),
            self.derive_axis(2, &axes[2], &mut sound),
        ];
        self.derive_shear(world_rays, &directions, &mut sound);
        LaneMask::from_bits((0..PACKET).fold(0, |mask, i| mask | sound[i] << i) as u16)
    }

    /// Sets up what tests of triangles need, from directions along the rays' own axes.
    #[inline(always)]
    fn derive_shear(&mut self, world_rays: &WorldRays, directions: &[Lanes; 3], sound: &mut Words) {
        for i in 0..PACKET {
            let length = directions[2][i].abs();
            self.shear[0][i] = directions[0][i] / directions[2][i];
            self.shear[1][i] = directions[1][i] / directions[2][i];
            self.inverse_z[i] = -(1.0 / directions[2][i]);
            self.direction_z[i] = -directions[2][i];
            self.t_min[i] = max(world_rays.t_min[i], 0.0);
            sound[i] &= u32::from((*MODEST.start() <= length) & (length <= *MODEST.end()));
        }
    }

    /// Sets up the `k`th of the rays' own axes; returns the directions along it.
    #[inline(always)]
    fn derive_axis(&mut self, k: usize, axes: &Words, sound: &mut Words) -> Lanes {
        let (o, d) = (self.space_origin, self.space_direction);
        let mut directions = [0.0; PACKET];
        for i in 0..PACKET {
            let axis = axes[i];
            let origin = pick(axis, o[0][i], o[1][i], o[2][i]);
            let direction = pick(axis, d[0][i], d[1][i], d[2][i]);
            let terms = Terms::new(origin, direction);
            let upper = if direction < 0.0 { ROW } else { 0 };
            directions[i] = direction;
            self.origin[k][i] = origin;
            self.far_origin[k][i] = terms.far_origin;
            self.near_inverse[k][i] = terms.near_inverse;
            self.far_inverse[k][i] = terms.far_inverse;
            self.near_rows[k][i] = axis * (2 * ROW) + upper;
            self.axes[k][i] = axis * AXIS;
            sound[i] &= u32::from(terms.is_sound(origin, direction));
        }
        directions
    }

    /// The values that box tests need, by the axes of space, for rays that were set up together.
    /// `origin_error`: as for [`Self::set_up_top`].
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn by_axes(&self, origin_error: Option<f32>) -> BoxRays {
        let o = &self.space_origin;
        let mut boxes = BoxRays {
            origin: *o,
            far_origin: [[0.0; PACKET]; 3],
            near_inverse: [[0.0; PACKET]; 3],
            far_inverse: [[0.0; PACKET]; 3],
        };
        for axis in 0..3 {
            let d = &self.space_direction[axis];
            for i in 0..PACKET {
                let terms = Terms::new(o[axis][i], d[i]);
                boxes.far_origin[axis][i] = terms.far_origin;
                boxes.near_inverse[axis][i] = terms.near_inverse;
                boxes.far_inverse[axis][i] = terms.far_inverse;
            }
        }
        let Some(origin_error) = origin_error else {
            return boxes;
        };
        for axis in 0..3 {
            for i in 0..PACKET {
                let reach = max(o[0][i].abs(), max(o[1][i].abs(), o[2][i].abs()));
                let toward = (reach * origin_error).copysign(-boxes.near_inverse[axis][i]);
                boxes.far_origin[axis][i] -= toward;
                boxes.origin[axis][i] += toward;
            }
        }
        boxes
    }

    /// Sets a lane up as a ray is in a space that is not scaled.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, level_ray: &LevelRay) {
        for (k, axis) in level_ray.axes().into_iter().enumerate() {
            // A zero counts as positive.
            let (mut near, mut far) = (-level_ray.near_inverse[axis], -level_ray.far_inverse[axis]);
            let mut far_origin = level_ray.origin[axis];
            if level_ray.direction[axis] == 0.0 {
                (near, far) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
                far_origin = lower(far_origin);
            } else if far.is_nan() {
                // Not tested: as integers, one is below and the other above all distances.
                (near, far) = (-f32::NAN.abs(), f32::NAN.abs());
            }
            let upper = u32::from(level_ray.direction[axis] < 0.0);
            self.origin[k][lane] = level_ray.origin[axis];
            self.far_origin[k][lane] = far_origin;
            self.near_inverse[k][lane] = near;
            self.far_inverse[k][lane] = far;
            self.near_rows[k][lane] = axis as u32 * (2 * ROW) + upper * ROW;
            self.axes[k][lane] = axis as u32 * AXIS;
            self.space_origin[k][lane] = level_ray.origin[k];
            self.space_direction[k][lane] = level_ray.direction[k];
        }
        self.shear[0][lane] = level_ray.shear[0];
        self.shear[1][lane] = level_ray.shear[1];
        self.inverse_z[lane] = -level_ray.inverse_z;
        self.direction_z[lane] = -level_ray.direction[level_ray.axes()[2]];
        self.t_min[lane] = level_ray.t_min;
    }

    /// Origin and direction of a lane, by the axes of space.
    #[inline(always)]
    pub fn world_ray(&self, lane: usize) -> ([f32; 3], [f32; 3]) {
        let (o, d) = (&self.space_origin, &self.space_direction);
        (
            [o[0][lane], o[1][lane], o[2][lane]],
            [d[0][lane], d[1][lane], d[2][lane]],
        )
    }

    /// A ray as it is set up by itself.
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> LevelRay {
        let mut level_ray = LevelRay::EMPTY;
        level_ray.tolerance = self.tolerance;
        let (origin, direction) = self.world_ray(lane);
        level_ray.set(origin, direction, self.t_min[lane], 0.0);
        level_ray
    }
}
