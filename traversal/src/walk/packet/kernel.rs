//! The arithmetic of packets, one implementation for each instruction set. All give the same bits
//! and visit the same nodes in the same order.

use lanes::LaneMask;
use lanes::vector::Vector;

use super::rays::Rays;
use super::{Packet, Stack};
use crate::layout::{InstanceRecord, NodeAt, TriangleGroup, WIDTH};
use crate::structure::Structure;
use crate::walk::Walker;
use crate::walk::facts::InstanceFacts;
use crate::walk::found::Found;
use crate::walk::level::Level;
use crate::walk::rows::{HitRows, RayRows};
use crate::walk::suspended::{Progress, Suspended, SuspendedLeaf};

/// The tests of packets with one instruction set, and the functions that are made of them.
///
/// Functions that are to be calls are compiled for the instruction set; the others are inlined into
/// those.
pub(super) trait PacketKernel: Sized {
    /// Sixteen lanes in the registers of the instruction set.
    type V: Vector;
    /// Triangles are tested one ray after the other.
    const BY_RAYS: bool;

    /// The least number of some lanes.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn least(row: <Self::V as Vector>::F, lanes: LaneMask) -> f32;

    /// The greatest number of some lanes.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn greatest(row: <Self::V as Vector>::F, lanes: LaneMask) -> f32;

    /// Which children's boxes any of the rays might meet, and where at the soonest.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_interval(
        rays: &Rays,
        node: NodeAt<'_>,
        t_far: f32,
        near: &mut [f32; WIDTH],
    ) -> u32;

    /// Which triangles' boxes any of the rays might meet, of two groups (or one twice).
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_triangles(rays: &Rays, groups: [&TriangleGroup; 2], t_far: f32) -> u32;

    /// Tests the opaque triangles of a leaf, a word and the rays that come there.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_leaf(
        rays: &Rays,
        structure: &Structure,
        leaf: (u32, LaneMask),
        t_far: f32,
        found: &mut Found,
    );

    /// Tests the opaque triangles of a leaf, and the opaque parts of triangles with micromaps;
    /// notes at which others rays have to look.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn test_some(
        rays: &mut Rays,
        level: &Level,
        facts: &InstanceFacts,
        leaf: (u32, LaneMask),
        t_far: f32,
        found: &mut Found,
    ) -> SuspendedLeaf;

    /// Looks for one candidate for each of the rays of `live`, in the leaf where they stand.
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn next_candidates(
        rays: &Rays,
        structure: &Structure,
        facts: &InstanceFacts,
        leaf: &mut SuspendedLeaf,
        live: LaneMask,
        found: &Found,
        candidates: &mut HitRows,
    );

    /// [`Packet::next_leaf`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn next_leaf(
        packet: &mut Packet<'_>,
        rays: &Rays,
        structure: &Structure,
        stack: &mut Stack,
    ) -> Option<(u32, LaneMask, f32)>;

    /// [`Packet::finish`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn finish(packet: &Packet<'_>, hits: &mut HitRows, top: &Level) -> Progress;

    /// [`Rays::set_up_top`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn set_up_top(
        rays: &mut Rays,
        ray_rows: &RayRows,
        origin_error: f32,
        lanes: LaneMask,
    ) -> LaneMask;

    /// [`Rays::set_up_instance`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn set_up_instance(
        rays: &mut Rays,
        ray_rows: &RayRows,
        record: &InstanceRecord,
        lanes: (LaneMask, bool),
    ) -> LaneMask;

    /// [`super::trace_packet`].
    ///
    /// # Safety
    /// As above; the contract of [`Walk::new`](crate::walk::Walk::new), for every ray.
    unsafe fn trace_packet(
        rays: &RayRows,
        lanes: (LaneMask, bool),
        hits: &mut HitRows,
        walker: &mut Walker,
        suspended: Option<&mut Suspended>,
    ) -> Progress;

    /// [`super::resume_packet`].
    ///
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn resume_packet(
        rays: &RayRows,
        hits: &mut HitRows,
        walker: &mut Walker,
        suspended: &mut Suspended,
    ) -> Progress;
}

/// Defines the functions of a kernel that are compiled for its instruction set, each with the
/// kernel's own tests inside.
macro_rules! compiled {
    ($($(#[$feature:meta])? as $kernel:ty;)*) => {$(
        $(#[$feature])?
        #[inline]
        unsafe fn next_leaf(
            packet: &mut Packet<'_>,
            rays: &Rays,
            structure: &Structure,
            stack: &mut Stack,
        ) -> Option<(u32, LaneMask, f32)> {
            // SAFETY: the caller guarantees that the machine has the instruction set.
            unsafe { packet.next_leaf::<$kernel>(rays, structure, stack) }
        }

        $(#[$feature])?
        unsafe fn finish(packet: &Packet<'_>, hits: &mut HitRows, top: &Level) -> Progress {
            // SAFETY: the caller guarantees that the machine has the instruction set.
            unsafe { packet.finish::<$kernel>(hits, top) }
        }

        $(#[$feature])?
        unsafe fn set_up_top(
            rays: &mut Rays,
            ray_rows: &RayRows,
            origin_error: f32,
            lanes: LaneMask,
        ) -> LaneMask {
            // SAFETY: the caller guarantees that the machine has the instruction set.
            unsafe { rays.set_up_top::<$kernel>(ray_rows, origin_error, lanes) }
        }

        $(#[$feature])?
        unsafe fn set_up_instance(
            rays: &mut Rays,
            ray_rows: &RayRows,
            record: &InstanceRecord,
            lanes: (LaneMask, bool),
        ) -> LaneMask {
            // SAFETY: the caller guarantees that the machine has the instruction set.
            unsafe { rays.set_up_instance::<$kernel>(ray_rows, record, lanes) }
        }

        $(#[$feature])?
        unsafe fn trace_packet(
            rays: &RayRows,
            lanes: (LaneMask, bool),
            hits: &mut HitRows,
            walker: &mut Walker,
            suspended: Option<&mut Suspended>,
        ) -> Progress {
            // SAFETY: the caller guarantees that the machine has the instruction set.
            unsafe { crate::walk::packet::trace_packet::<$kernel>(rays, lanes, hits, walker, suspended) }
        }

        $(#[$feature])?
        unsafe fn resume_packet(
            rays: &RayRows,
            hits: &mut HitRows,
            walker: &mut Walker,
            suspended: &mut Suspended,
        ) -> Progress {
            // SAFETY: the caller guarantees that the machine has the instruction set.
            unsafe { crate::walk::packet::resume_packet::<$kernel>(rays, hits, walker, suspended) }
        }
    )*};
}
pub(super) use compiled;
