//! The children of a node: prefetching them, and pushing them on the stack.

use lanes::prefetch_lines;

use super::entry::Entry;
use crate::layout::{NodeAt, WIDTH};
use crate::structure::Structure;

/// Nodes of a structure that does not fit a core's second cache (with its leaves, some 800 KB), so
/// that children are worth fetching ahead.
pub(super) const LARGE: u32 = 256;

/// Asks for the memory of the children in `mask`.
#[inline(always)]
pub(super) fn fetch(mask: u32, node: NodeAt<'_>, structure: &Structure) {
    let mut rest = mask;
    while rest != 0 {
        let word = node.child(rest.trailing_zeros() as usize);
        rest &= rest - 1;
        prefetch_lines(structure.child_address(word), 4);
    }
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
            // SAFETY: the caller guarantees that `mask` is not 0, and there is room for eight
            // entries; `pushed` is below eight.
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
    // SAFETY: the caller guarantees that `mask` is not 0, and there is room for eight entries.
    unsafe { places.write(farther) };
    while rest != 0 {
        let next = entry(node, near, rest);
        rest &= rest - 1;
        let mut place = pushed;
        pushed += 1;
        let (close, far) = nearest.ordered(next);
        nearest = close;
        // SAFETY: the caller guarantees that `mask` is not 0, and there is room for eight entries.
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
