//! The rays of a packet, set up for one level: a vector of sixteen for each number.

use std::arch::x86_64::*;

use crate::layout::{InstanceRecord, Node, WIDTH, instance_state};
use crate::walk::space::{MARGIN, MODEST};
use crate::walk::{PACKET, Step};

/// Inverses of directions that are not along a plane.
const STEEP: f32 = 1.0e30;

/// A number of each ray.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Lanes(pub [f32; PACKET]);

impl Lanes {
    pub const ZERO: Lanes = Lanes([0.0; PACKET]);

    #[inline]
    #[target_feature(enable = "avx512f")]
    pub fn load(&self) -> __m512 {
        // SAFETY: sixteen numbers, aligned.
        unsafe { _mm512_load_ps(self.0.as_ptr()) }
    }

    #[inline]
    #[target_feature(enable = "avx512f")]
    pub fn store(&mut self, value: __m512) {
        // SAFETY: as above.
        unsafe { _mm512_store_ps(self.0.as_mut_ptr(), value) }
    }
}

/// Rays as they were given, in world space.
pub(super) struct Given {
    origin: [Lanes; 3],
    direction: [Lanes; 3],
    t_min: Lanes,
}

/// What [`Space`](crate::walk::space::Space) is for one ray.
pub(crate) struct Rays {
    pub origin: [Lanes; 3],
    pub direction: [Lanes; 3],
    near_origin: [Lanes; 3],
    far_origin: [Lanes; 3],
    pub near_inverse: [Lanes; 3],
    pub far_inverse: [Lanes; 3],
    pub shear: [Lanes; 2],
    pub inverse_z: Lanes,
    pub axes: [usize; 3],
    /// Whether directions are negative.
    pub signs: [bool; 3],
    pub t_min: Lanes,
    interval: Interval,
}

/// What all rays have in common, for a test of eight boxes: lower and upper ends.
struct Interval {
    /// The origin for near planes and for far planes.
    near_origin: [f32; 3],
    far_origin: [f32; 3],
    near_inverse: [[f32; 2]; 3],
    far_inverse: [[f32; 2]; 3],
    t_min: f32,
}

impl Given {
    pub fn new(steps: &[Step<'_>]) -> Given {
        let mut given = Given {
            origin: [Lanes::ZERO; 3],
            direction: [Lanes::ZERO; 3],
            t_min: Lanes::ZERO,
        };
        for (lane, step) in steps.iter().enumerate() {
            let ray = step.walk.ray();
            for axis in 0..3 {
                given.origin[axis].0[lane] = ray.origin[axis];
                given.direction[axis].0[lane] = ray.direction[axis];
            }
            given.t_min.0[lane] = crate::walk::space::max(ray.t_min, 0.0);
        }
        given
    }
}

impl Rays {
    pub const NOWHERE: Rays = Rays {
        origin: [Lanes::ZERO; 3],
        direction: [Lanes::ZERO; 3],
        near_origin: [Lanes::ZERO; 3],
        far_origin: [Lanes::ZERO; 3],
        near_inverse: [Lanes::ZERO; 3],
        far_inverse: [Lanes::ZERO; 3],
        shear: [Lanes::ZERO; 2],
        inverse_z: Lanes::ZERO,
        axes: [0, 1, 2],
        signs: [false; 3],
        t_min: Lanes::ZERO,
        interval: Interval {
            near_origin: [0.0; 3],
            far_origin: [0.0; 3],
            near_inverse: [[0.0; 2]; 3],
            far_inverse: [[0.0; 2]; 3],
            t_min: 0.0,
        },
    };

    /// Sets the rays of `lanes` up for a top level; false if they are not alike.
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
    pub fn set_up(&mut self, given: &Given, origin_error: f32, lanes: u16) -> bool {
        let origin = [0, 1, 2].map(|axis: usize| given.origin[axis].load());
        let direction = [0, 1, 2].map(|axis: usize| given.direction[axis].load());
        let reach = _mm512_max_ps(
            _mm512_max_ps(_mm512_abs_ps(origin[0]), _mm512_abs_ps(origin[1])),
            _mm512_abs_ps(origin[2]),
        );
        let uncertainty = _mm512_mul_ps(reach, _mm512_set1_ps(origin_error));
        self.store(origin, direction, given, uncertainty, lanes)
    }

    /// As [`Level::place`](crate::walk::level::Level::place) for one ray; false if rays of `lanes` are not alike.
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
    pub fn set_up_instance(&mut self, given: &Given, record: &InstanceRecord, lanes: u16) -> bool {
        let mut origin = [0, 1, 2].map(|axis: usize| given.origin[axis].load());
        let mut direction = [0, 1, 2].map(|axis: usize| given.direction[axis].load());
        if record.state & instance_state::IDENTITY == 0 {
            let m = &record.object_to_world;
            let position = [m[3], m[7], m[11]];
            for (origin, position) in origin.iter_mut().zip(position) {
                *origin = _mm512_sub_ps(*origin, _mm512_set1_ps(position));
            }
            origin = turn(&record.world_to_object, origin);
            direction = turn(&record.world_to_object, direction);
        }
        self.store(origin, direction, given, _mm512_setzero_ps(), lanes)
    }

    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
    fn store(
        &mut self,
        origin: [__m512; 3],
        direction: [__m512; 3],
        given: &Given,
        uncertainty: __m512,
        lanes: u16,
    ) -> bool {
        let size = direction.map(|d| _mm512_abs_ps(d));
        // The longest component is that of `Space::set`: the first of equals is not taken.
        let longest = |z: usize| {
            [1, 2].into_iter().fold(lanes, |alike, i| {
                let axis = (z + i) % 3;
                let longer = if z > axis {
                    _mm512_cmp_ps_mask::<_CMP_GE_OQ>(size[z], size[axis])
                } else {
                    _mm512_cmp_ps_mask::<_CMP_GT_OQ>(size[z], size[axis])
                };
                alike & longer
            })
        };
        let Some(z) = (0..3).find(|&z| longest(z) == lanes) else {
            return false;
        };
        let mut alike = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(size[z], _mm512_set1_ps(*MODEST.start()))
            & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(size[z], _mm512_set1_ps(*MODEST.end()));
        let ends = |v: __m512| {
            [
                _mm512_mask_reduce_min_ps(lanes, v),
                _mm512_mask_reduce_max_ps(lanes, v),
            ]
        };
        self.t_min = given.t_min;
        self.interval.t_min = _mm512_mask_reduce_min_ps(lanes, given.t_min.load());
        for axis in 0..3 {
            let d = direction[axis];
            let negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(d, _mm512_setzero_ps()) & lanes;
            if negative != 0 && negative != lanes {
                return false;
            }
            let sign = negative != 0;
            self.signs[axis] = sign;
            let inverse = _mm512_div_ps(_mm512_set1_ps(1.0), d);
            let near = _mm512_mul_ps(inverse, _mm512_set1_ps(1.0 - MARGIN));
            let far = _mm512_mul_ps(inverse, _mm512_set1_ps(1.0 + MARGIN));
            alike &= _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(far), _mm512_set1_ps(STEEP));
            let (toward, away) = (
                _mm512_add_ps(origin[axis], uncertainty),
                _mm512_sub_ps(origin[axis], uncertainty),
            );
            let (near_origin, far_origin) = if sign { (away, toward) } else { (toward, away) };
            self.origin[axis].store(origin[axis]);
            self.direction[axis].store(d);
            self.near_origin[axis].store(near_origin);
            self.far_origin[axis].store(far_origin);
            self.near_inverse[axis].store(near);
            self.far_inverse[axis].store(far);
            let interval = &mut self.interval;
            interval.near_origin[axis] = ends(near_origin)[usize::from(!sign)];
            interval.far_origin[axis] = ends(far_origin)[usize::from(sign)];
            interval.near_inverse[axis] = ends(near);
            interval.far_inverse[axis] = ends(far);
            if axis == z {
                self.inverse_z.store(inverse);
            }
        }
        let [x, y] = match self.signs[z] {
            false => [(z + 1) % 3, (z + 2) % 3],
            true => [(z + 2) % 3, (z + 1) % 3],
        };
        self.axes = [x, y, z];
        let inverse_z = self.inverse_z.load();
        for (place, axis) in self.shear.iter_mut().zip([x, y]) {
            place.store(_mm512_mul_ps(direction[axis], inverse_z));
        }
        alike & lanes == lanes
    }

    /// Which children's boxes any of the rays might meet.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
    pub fn test_interval(&self, node: &Node, t_far: f32) -> u32 {
        let interval = &self.interval;
        let mut near = _mm256_set1_ps(interval.t_min);
        let mut far = _mm256_set1_ps(t_far);
        for axis in 0..3 {
            let sign = usize::from(self.signs[axis]);
            // SAFETY: eight numbers each.
            let (first, last) = unsafe {
                (
                    _mm256_loadu_ps(node.bounds[2 * axis + sign].as_ptr()),
                    _mm256_loadu_ps(node.bounds[2 * axis + 1 - sign].as_ptr()),
                )
            };
            let enter = _mm256_sub_ps(first, _mm256_set1_ps(interval.near_origin[axis]));
            let leave = _mm256_sub_ps(last, _mm256_set1_ps(interval.far_origin[axis]));
            let [low, high] = interval.near_inverse[axis];
            let enter = _mm256_min_ps(
                _mm256_mul_ps(enter, _mm256_set1_ps(low)),
                _mm256_mul_ps(enter, _mm256_set1_ps(high)),
            );
            let [low, high] = interval.far_inverse[axis];
            let leave = _mm256_max_ps(
                _mm256_mul_ps(leave, _mm256_set1_ps(low)),
                _mm256_mul_ps(leave, _mm256_set1_ps(high)),
            );
            near = _mm256_max_ps(enter, near);
            far = _mm256_min_ps(leave, far);
        }
        u32::from(_mm256_cmp_ps_mask::<_CMP_LE_OQ>(near, far))
    }

    /// Which rays meet a child's box before `t_far`, and where they enter it.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
    pub fn test_box(&self, node: &Node, child: usize, t_far: __m512) -> (u16, __m512) {
        let child = child % WIDTH;
        let mut near = self.t_min.load();
        let mut far = t_far;
        for axis in 0..3 {
            let sign = usize::from(self.signs[axis]);
            let first = _mm512_set1_ps(node.bounds[2 * axis + sign][child]);
            let last = _mm512_set1_ps(node.bounds[2 * axis + 1 - sign][child]);
            let enter = _mm512_mul_ps(
                _mm512_sub_ps(first, self.near_origin[axis].load()),
                self.near_inverse[axis].load(),
            );
            let leave = _mm512_mul_ps(
                _mm512_sub_ps(last, self.far_origin[axis].load()),
                self.far_inverse[axis].load(),
            );
            near = _mm512_max_ps(enter, near);
            far = _mm512_min_ps(leave, far);
        }
        (_mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far), near)
    }
}

/// As [`turn`](crate::walk::level::turn) for one ray.
#[inline]
#[target_feature(enable = "avx512f")]
fn turn(m: &[f32; 12], v: [__m512; 3]) -> [__m512; 3] {
    [0, 4, 8].map(|row: usize| {
        let product = |i: usize| _mm512_mul_ps(_mm512_set1_ps(m[row + i]), v[i]);
        _mm512_add_ps(_mm512_add_ps(product(0), product(1)), product(2))
    })
}
