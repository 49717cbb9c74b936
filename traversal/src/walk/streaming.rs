//! Rays of many lists, traced together: see [`stream`](super::stream).

use lanes::{LaneMask, Tier};

use super::options::Specialisation;
use super::rows::{HitRows, RayRows};
use super::{Event, Walk, Walker};
use crate::ray::Hit;

/// Who has rays traced by [`Walker::trace_streams`], and hears of them by group and lane.
#[cfg_attr(
    not(target_arch = "x86_64"),
    expect(dead_code, reason = "streams are for AVX2 and AVX-512")
)]
pub(crate) trait Caller {
    /// A ray has met something.
    fn hit(&mut self, group: u32, lane: usize, hit: &Hit);

    /// The rays of a group once more, as they were given.
    fn rays(&mut self, group: u32, rays: &mut RayRows);

    /// Takes over the walk of a ray that ran out of fuel, by changing places with it.
    fn suspend(&mut self, group: u32, lane: usize, walk: &mut Walk, event: Event);
}

impl Walker {
    /// Rays of a stream, at most.
    pub(crate) const STREAM_RAYS: usize = 4096;

    /// Adds rays to a stream, to be traced with others by [`Self::trace_streams`]; returns which.
    /// Those are rays of ordinary length through the same top level as those in it, with the same
    /// flags and mask; where it has one instance, that holds triangles that all count, or by their
    /// micromaps. None are added where the machine has no AVX2. Their hits are none so far.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray, until they are traced.
    pub(crate) unsafe fn add_to_stream(
        &mut self,
        rays: &RayRows,
        lanes: LaneMask,
        hits: &mut HitRows,
        group: u32,
    ) -> LaneMask {
        let without = self.without();
        let needed = [
            Specialisation::Streams,
            Specialisation::OneInstance,
            Specialisation::Opaque,
        ];
        if lanes.is_empty()
            || self.options.tier == Tier::Portable
            || needed.into_iter().any(|one| without.contains(one))
        {
            return LaneMask::NONE;
        }
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, until they are
        // traced; a walker has this tier only on machines that have the instruction set.
        return unsafe { self.add(rays, lanes, hits, group) };
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = (rays, hits, group);
            LaneMask::NONE
        }
    }

    /// Forgets the rays of the stream.
    pub(crate) fn clear_streams(&mut self) {
        #[cfg(target_arch = "x86_64")]
        self.streams.clear();
    }

    /// Traces the rays of the stream, and forgets them. The hits are those of each ray by itself,
    /// bit for bit.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    pub(crate) unsafe fn trace_streams(&mut self, fuel: &mut u64, caller: &mut dyn Caller) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        unsafe {
            self.run_streams(fuel, caller);
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = (fuel, caller);
    }
}
