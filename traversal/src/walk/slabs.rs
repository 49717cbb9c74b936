//! The rays of a group in a bottom level of boxes: set up at once, as
//! [`LevelRay`](super::level_ray::LevelRay) sets up each for tests of boxes, and kept while they
//! wait for decisions.

use lanes::LaneMask;

use super::PACKET;
use super::level_ray::{MARGIN, MODEST, max};
use super::level_rays::{LevelRays, ROW, WorldRays};
use super::rows::{Lanes, Words};
use crate::layout::InstanceRecord;
use crate::ray::Ray;

/// The properties that the rays have in common.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Common {
    pub top_level: u64,
    pub flags: u32,
    pub cull_mask: u32,
    /// The instance where they are.
    pub instance: u32,
}

impl Common {
    pub const NONE: Common = Common {
        top_level: 0,
        flags: 0,
        cull_mask: 0,
        instance: 0,
    };

    pub fn new(top_level: u64, ray: &Ray, instance: u32) -> Common {
        Common {
            top_level,
            flags: ray.flags,
            cull_mask: ray.cull_mask,
            instance,
        }
    }
}

/// Rays by rows; the fields of [`LevelRay`](super::level_ray::LevelRay) that tests of boxes need.
#[repr(C, align(64))]
pub(crate) struct Slabs {
    pub near_origin: [Lanes; 3],
    pub far_origin: [Lanes; 3],
    pub near_inverse: [Lanes; 3],
    pub far_inverse: [Lanes; 3],
    /// Offsets in bytes of the rows of a node with the near planes.
    pub near_rows: [Words; 3],
    pub t_min: Lanes,
    /// Rays that are set up.
    pub lanes: LaneMask,
    pub common: Common,
}

impl Slabs {
    /// No rays.
    pub const NONE: Slabs = Slabs {
        near_origin: [[0.0; PACKET]; 3],
        far_origin: [[0.0; PACKET]; 3],
        near_inverse: [[0.0; PACKET]; 3],
        far_inverse: [[0.0; PACKET]; 3],
        near_rows: [[0; PACKET]; 3],
        t_min: [0.0; PACKET],
        lanes: LaneMask::NONE,
        common: Common::NONE,
    };

    /// Sets rays up in an instance that does not move: those that are sound there, of ordinary
    /// length, and whose reciprocals do not overflow. The others need a space of their own.
    #[inline(always)]
    pub fn set_up(
        &mut self,
        level_rays: &mut LevelRays,
        world_rays: &WorldRays,
        record: &InstanceRecord,
        common: Common,
    ) {
        level_rays.start_instance(world_rays, record);
        let (o, d) = (&level_rays.space_origin, &level_rays.space_direction);
        let mut sound = world_rays.sound;
        for i in 0..PACKET {
            let length = max(d[0][i].abs(), max(d[1][i].abs(), d[2][i].abs()));
            sound[i] &= u32::from((*MODEST.start() <= length) & (length <= *MODEST.end()));
            self.t_min[i] = max(world_rays.t_min[i], 0.0);
        }
        for axis in 0..3 {
            for i in 0..PACKET {
                let (origin, direction) = (o[axis][i], d[axis][i]);
                let inverse = 1.0 / direction;
                let nothing = 0f32.copysign(direction);
                let far_inverse = inverse * (1.0 + MARGIN);
                self.near_origin[axis][i] = origin + nothing;
                self.far_origin[axis][i] = origin - nothing;
                self.near_inverse[axis][i] = inverse * (1.0 - MARGIN);
                self.far_inverse[axis][i] = far_inverse;
                self.near_rows[axis][i] =
                    axis as u32 * (2 * ROW) + (direction.to_bits() >> 31) * ROW;
                let reaches = (far_inverse.abs() < f32::INFINITY) | (direction == 0.0);
                sound[i] &= u32::from(reaches & (origin.abs() < f32::INFINITY));
            }
        }
        let lanes = (0..PACKET).fold(0, |mask, i| mask | sound[i] << i) as u16;
        self.lanes = LaneMask::from_bits(lanes);
        self.common = common;
    }

    /// Whether rays are set up that have this in common.
    #[inline(always)]
    pub fn holds(&self, lanes: LaneMask, common: &Common) -> bool {
        self.common == *common && (lanes - self.lanes).is_empty()
    }

    /// Takes over the ray of a lane, if it has in common with the others here what they have.
    pub fn take(&mut self, from: &Slabs, lane: usize, to_lane: usize) {
        self.lanes.remove(to_lane);
        if self.lanes.is_empty() {
            self.common = from.common;
        }
        if !from.lanes.contains(lane) || from.common != self.common {
            return;
        }
        for axis in 0..3 {
            for (to, from) in [
                (&mut self.near_origin, &from.near_origin),
                (&mut self.far_origin, &from.far_origin),
                (&mut self.near_inverse, &from.near_inverse),
                (&mut self.far_inverse, &from.far_inverse),
            ] {
                to[axis][to_lane] = from[axis][lane];
            }
            self.near_rows[axis][to_lane] = from.near_rows[axis][lane];
        }
        self.t_min[to_lane] = from.t_min[lane];
        self.lanes.insert(to_lane);
    }
}
