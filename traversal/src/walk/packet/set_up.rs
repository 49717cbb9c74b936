//! Sets up the rays of a packet for one level.

use lanes::LaneMask;

use super::kernel::PacketKernel;
use super::rays::Rays;
use crate::layout::InstanceRecord;
use crate::walk::level_ray::MARGIN;
use crate::walk::level_rays::{ROW, WorldRays};

impl Rays {
    /// Sets the rays of `lanes` up for a top level; false if they are not alike.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn set_up_top<K: PacketKernel>(
        &mut self,
        world_rays: &WorldRays,
        origin_error: f32,
        lanes: LaneMask,
    ) -> bool {
        self.level_rays.start_top(world_rays);
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe { self.set_up::<K>(world_rays, Some(origin_error), lanes) }
    }

    /// Sets the rays of `lanes` up for an instance; false if they are not alike.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn set_up_instance<K: PacketKernel>(
        &mut self,
        world_rays: &WorldRays,
        record: &InstanceRecord,
        lanes: LaneMask,
    ) -> bool {
        self.level_rays.start_instance(world_rays, record);
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        unsafe { self.set_up::<K>(world_rays, None, lanes) }
    }

    /// Sets rays up that `LevelRays` has taken, and finds what they have in common.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn set_up<K: PacketKernel>(
        &mut self,
        world_rays: &WorldRays,
        origin_error: Option<f32>,
        lanes: LaneMask,
    ) -> bool {
        self.hits_of = 0;
        let first = lanes.first();
        let ways = self.level_rays.ways();
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        if unsafe { K::equal(&ways, ways[first]) } & lanes != lanes {
            return false;
        }
        let sound = self.level_rays.set_up_together(world_rays, first);
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        if unsafe { K::equal(&sound, 1) } & lanes != lanes {
            return false;
        }
        if let Some(origin_error) = origin_error {
            self.level_rays.widen(world_rays, origin_error);
        }
        let (level_rays, interval) = (&self.level_rays, &mut self.interval);
        let mut flat = lanes;
        for k in 0..3 {
            let row = level_rays.near_rows[k][first];
            self.near_rows[k] = row as usize;
            self.axes[k] = level_rays.axes[k][first] as usize;
            let upper = row & ROW != 0;
            let (origin, far_origin) = (&level_rays.origin[k], &level_rays.far_origin[k]);
            let inverse = &level_rays.near_inverse[k];
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let [low, high] = unsafe {
                flat &= K::flat(inverse);
                (interval.near_origin[k], interval.far_origin[k]) = match upper {
                    true => (K::least(origin, lanes), K::greatest(far_origin, lanes)),
                    false => (K::greatest(origin, lanes), K::least(far_origin, lanes)),
                };
                [K::least(inverse, lanes), K::greatest(inverse, lanes)]
            };
            interval.near_inverse[k] = [low, high];
            // Those of far planes are larger by two margins and some roundings.
            let wider = 1.0 + 4.0 * MARGIN;
            interval.far_inverse[k] = if upper {
                [low, high * wider]
            } else {
                [low * wider, high]
            };
        }
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        interval.t_min = unsafe { K::least(&level_rays.t_min, lanes) };
        flat == lanes
    }
}
