//! Sets up the rays of a packet for one level.

use super::kernel::PacketKernel;
use super::rays::Rays;
use crate::layout::InstanceRecord;
use crate::walk::PACKET;
use crate::walk::beams::{Given, ROW};
use crate::walk::space::MARGIN;

impl Rays {
    /// Sets the rays of `lanes` up for a top level; false if they are not alike.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn set_up_top<K: PacketKernel>(
        &mut self,
        given: &Given,
        origin_error: f32,
        lanes: u16,
    ) -> bool {
        let sound = self.beams.set_up_top(given, origin_error);
        // SAFETY: the caller's promise.
        unsafe { self.join::<K>(sound, lanes) }
    }

    /// Sets the rays of `lanes` up for an instance; false if they are not alike.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn set_up_instance<K: PacketKernel>(
        &mut self,
        given: &Given,
        record: &InstanceRecord,
        lanes: u16,
    ) -> bool {
        let sound = self.beams.set_up(given, record);
        // SAFETY: the caller's promise.
        unsafe { self.join::<K>(sound, lanes) }
    }

    /// Finds what the rays have in common.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn join<K: PacketKernel>(&mut self, sound: u32, lanes: u16) -> bool {
        self.hits_of = 0;
        if sound as u16 & lanes != lanes {
            return false;
        }
        let first = lanes.trailing_zeros() as usize % PACKET;
        let (beams, interval) = (&self.beams, &mut self.interval);
        let mut alike = lanes;
        for k in 0..3 {
            let row = beams.near_rows[k][first];
            self.near_rows[k] = row as usize;
            self.axes[k] = beams.axes[k][first] as usize;
            let upper = row & ROW != 0;
            let (origin, far_origin) = (&beams.origin[k], &beams.far_origin[k]);
            let inverse = &beams.near_inverse[k];
            // SAFETY: the caller's promise.
            let [low, high] = unsafe {
                alike &= K::equal(&beams.near_rows[k], row) & K::flat(inverse);
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
        // SAFETY: the caller's promise.
        interval.t_min = unsafe { K::least(&beams.t_min, lanes) };
        alike == lanes
    }
}
