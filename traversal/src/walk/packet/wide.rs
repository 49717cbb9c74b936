//! Packets with AVX-512.

use std::arch::x86_64::*;

use lanes::{LaneMask, vector};

use super::Packet;
use super::candidates;
use super::kernel::{PacketKernel, compiled};
use super::rays::Rays;
use super::stack::Stack;
use super::triangle;
use crate::layout::{InstanceRecord, NodeAt, TriangleGroup, WIDTH};
use crate::structure::Structure;
use crate::walk::Walker;
use crate::walk::facts::InstanceFacts;
use crate::walk::found::Found;
use crate::walk::level::Level;
use crate::walk::rows::{HitRows, RayRows};
use crate::walk::suspended::{Progress, Suspended, SuspendedLeaf};

/// AVX-512: a row is one vector.
pub(super) struct Avx512;

impl PacketKernel for Avx512 {
    type V = vector::Avx512;

    #[inline(always)]
    unsafe fn least(row: __m512, lanes: LaneMask) -> f32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_mask_reduce_min_ps(lanes.bits(), row) }
    }

    #[inline(always)]
    unsafe fn greatest(row: __m512, lanes: LaneMask) -> f32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_mask_reduce_max_ps(lanes.bits(), row) }
    }

    #[inline(always)]
    unsafe fn test_interval(
        rays: &Rays,
        node: NodeAt<'_>,
        t_far: f32,
        near: &mut [f32; WIDTH],
    ) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { rays.test_interval(node, t_far, near) }
    }

    #[inline(always)]
    unsafe fn test_triangles(rays: &Rays, groups: [&TriangleGroup; 2], t_far: f32) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { rays.test_triangles(groups, t_far) }
    }

    #[inline(always)]
    unsafe fn test_leaf(
        rays: &Rays,
        structure: &Structure,
        (word, lanes): (u32, LaneMask),
        t_far: f32,
        found: &mut Found,
    ) {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { triangle::test_leaf(rays, structure, word, lanes, t_far, found) }
    }

    #[inline(always)]
    unsafe fn test_some(
        rays: &mut Rays,
        level: &Level,
        facts: &InstanceFacts,
        leaf: (u32, LaneMask),
        t_far: f32,
        found: &mut Found,
    ) -> SuspendedLeaf {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { candidates::test_some(rays, level, facts, leaf, t_far, found) }
    }

    #[inline(always)]
    unsafe fn next_candidates(
        rays: &Rays,
        structure: &Structure,
        facts: &InstanceFacts,
        leaf: &mut SuspendedLeaf,
        live: LaneMask,
        found: &Found,
        candidates: &mut HitRows,
    ) {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            candidates::next_candidates(rays, structure, facts, leaf, live, found, candidates);
        }
    }

    compiled! {
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")] as Avx512;
    }
}
