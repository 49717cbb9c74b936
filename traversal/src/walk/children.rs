//! The children of a node: fetching them, and putting them down to be visited.

use super::entry::Entry;
use crate::layout::{NodeAt, WIDTH};
use crate::structure::Structure;

/// Nodes of a structure that does not fit a core's second cache (with its leaves, some 800 KB), so
/// that children are worth fetching ahead.
pub(super) const LARGE: u32 = 256;

/// Asks for the memory of the children in `mask`.
#[inline(always)]
pub(super) fn fetch(mask: u32, node: NodeAt<'_>, structure: &Structure) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let mut rest = mask;
        while rest != 0 {
            let word = node.child(rest.trailing_zeros() as usize);
            rest &= rest - 1;
            let address = structure.child_address(word);
            for line in 0..4 {
                // SAFETY: a hint; addresses need not be valid.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64 * line).cast()) };
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (mask, node, structure);
}

/// Pushes the children of a node in `mask` down from `places` on, farthest first, except the
/// nearest. Returns the nearest child's word and the number of pushed children. With `ANY`, the
/// last child counts as the nearest: an order that does not depend on the ray.
///
/// # Safety
/// `mask` is not 0, and there is room for eight entries.
#[inline(always)]
pub(super) unsafe fn push_children<const ANY: bool>(
    mask: u32,
    node: NodeAt<'_>,
    near: &[f32; WIDTH],
    places: *mut Entry,
) -> (u32, usize) {
    let first = entry(node, near, mask);
    let mut rest = mask & (mask - 1);
    if rest == 0 {
        return (first.word(), 0);
    }
    if ANY {
        let (mut last, mut pushed) = (first, 0);
        while rest != 0 {
            // SAFETY: the caller's promise; `pushed` is below eight.
            unsafe { places.add(pushed).write(last) };
            pushed += 1;
            last = entry(node, near, rest);
            rest &= rest - 1;
        }
        return (last.word(), pushed);
    }
    let mut pushed = 1;
    let second = entry(node, near, rest);
    rest &= rest - 1;
    let (mut nearest, farther) = first.ordered(second);
    // SAFETY: as above.
    unsafe { places.write(farther) };
    while rest != 0 {
        let next = entry(node, near, rest);
        rest &= rest - 1;
        let mut place = pushed;
        pushed += 1;
        let (close, far) = nearest.ordered(next);
        nearest = close;
        // SAFETY: as above.
        unsafe {
            while place > 0 && *places.add(place - 1) < far {
                places.add(place).write(*places.add(place - 1));
                place -= 1;
            }
            places.add(place).write(far);
        }
    }
    (nearest.word(), pushed)
}

/// The entry of the first child in a mask.
#[inline(always)]
fn entry(node: NodeAt<'_>, near: &[f32; WIDTH], mask: u32) -> Entry {
    let lane = mask.trailing_zeros() as usize & (WIDTH - 1);
    Entry::new(node.child(lane), near[lane])
}
