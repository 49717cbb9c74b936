//! Packets with AVX-512 and AVX2.

use std::arch::x86_64::*;

use lanes::LaneMask;
use lanes::vector::{self, Vector};

use super::Packet;
use super::candidates;
use super::kernel::{PacketKernel, compiled};
use super::rays::Rays;
use super::stack::Stack;
use super::triangle;
use super::vectors;
use crate::layout::{InstanceRecord, NodeAt, TriangleGroup, WIDTH};
use crate::structure::Structure;
use crate::walk::Walker;
use crate::walk::facts::InstanceFacts;
use crate::walk::found::Found;
use crate::walk::level::Level;
use crate::walk::rows::{HitRows, RayRows};
use crate::walk::suspended::{Progress, Suspended, SuspendedLeaf};

/// AVX-512: a row is one register.
pub(super) struct Avx512;

/// AVX2: a row is two registers.
pub(super) struct Avx2Packets;

macro_rules! wide {
    ($name:ident, $register:ty, $vector:ty, $least:path, $greatest:path, #[$feature:meta]) => {
        impl PacketKernel for $name {
            type V = $vector;
            const BY_RAYS: bool = false;

            #[inline(always)]
            unsafe fn least(row: <$vector as Vector>::F, lanes: LaneMask) -> f32 {
                // SAFETY: the caller guarantees that the machine has the instruction set.
                unsafe { $least(row, lanes) }
            }

            #[inline(always)]
            unsafe fn greatest(row: <$vector as Vector>::F, lanes: LaneMask) -> f32 {
                // SAFETY: the caller guarantees that the machine has the instruction set.
                unsafe { $greatest(row, lanes) }
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

            #[$feature]
            unsafe fn test_leaf(
                rays: &Rays,
                structure: &Structure,
                leaf: (u32, LaneMask),
                t_far: f32,
                found: &mut Found,
            ) {
                // SAFETY: the caller guarantees that the machine has the instruction set.
                unsafe { triangle::test_leaf::<$register>(rays, structure, leaf, t_far, found) }
            }

            #[$feature]
            unsafe fn test_some(
                rays: &mut Rays,
                level: &Level,
                facts: &InstanceFacts,
                leaf: (u32, LaneMask),
                t_far: f32,
                found: &mut Found,
            ) -> SuspendedLeaf {
                // SAFETY: the caller guarantees that the machine has the instruction set.
                unsafe {
                    candidates::test_some::<$register>(rays, level, facts, leaf, t_far, found)
                }
            }

            #[$feature]
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
                    candidates::next_candidates::<$register>(
                        rays, structure, facts, leaf, live, found, candidates,
                    );
                }
            }

            compiled! { #[$feature] as $name; }
        }
    };
}

/// The least number of some lanes.
///
/// # Safety
/// The machine has AVX-512.
#[inline(always)]
unsafe fn least(row: __m512, lanes: LaneMask) -> f32 {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe { _mm512_mask_reduce_min_ps(lanes.bits(), row) }
}

/// The greatest number of some lanes.
///
/// # Safety
/// The machine has AVX-512.
#[inline(always)]
unsafe fn greatest(row: __m512, lanes: LaneMask) -> f32 {
    // SAFETY: the caller guarantees that the machine has the instruction set.
    unsafe { _mm512_mask_reduce_max_ps(lanes.bits(), row) }
}

wide!(
    Avx512,
    __m512,
    vector::Avx512,
    least,
    greatest,
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
);

wide!(
    Avx2Packets,
    __m256,
    vector::Avx2,
    vectors::least,
    vectors::greatest,
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
);
