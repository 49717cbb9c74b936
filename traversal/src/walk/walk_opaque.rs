//! The loop of walks through triangles that all count.

use super::PACKET;
use super::children::fetch;
use super::entry::{Entry, STACK};
use super::group_hits::GroupHits;
use super::kernel::Kernel;
use super::meter::Meter;
use super::opaque::{End, Nearest, Opaque, Pending};
use crate::layout::{LEAF_TRIANGLES, WIDTH, child};

impl Opaque<'_> {
    /// Walks the pending nodes, for triangles in the interval of `best`, which is the nearest hit
    /// at the end.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn run<K: Kernel, M: Meter, const ANY: bool>(
        &self,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
        meter: &mut M,
    ) -> End {
        let node_count = self.structure.node_count();
        let mut room = None;
        let lane = self.lane % PACKET;
        let t_min = best.t_min;
        let mut nearest = *best;
        let mut left = *fuel;
        let stack = pending.stack.as_mut_ptr();
        // SAFETY: `floor` and `length` are inside the stack.
        let (base, mut top, brim) = unsafe {
            (
                stack.add(pending.floor),
                stack.add(pending.length),
                stack.add(STACK - WIDTH),
            )
        };
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let mut box_ray = unsafe { K::load_lane(self.level_rays, lane, nearest.t) };
        let mut limit = Entry::last_at(nearest.t);
        let end = 'next: loop {
            // The nearest pending child that is still near enough.
            let mut word = loop {
                if top == base {
                    break 'next End::Finished;
                }
                // SAFETY: above the base, and below the end wherever an entry is pushed.
                let entry = unsafe {
                    top = top.sub(1);
                    *top
                };
                if ANY || entry <= limit {
                    break entry.word();
                }
            };
            // Down to a leaf.
            loop {
                if left == 0 {
                    // SAFETY: there is room for what was popped.
                    unsafe {
                        *top = Entry::new(word, 0.0);
                        top = top.add(1);
                    }
                    break 'next End::OutOfFuel;
                }
                left -= 1;
                // Words of leaves are above every index of a node.
                if word >= node_count {
                    break;
                }
                // SAFETY: below the count; the caller guarantees that the machine has the kernel's
                // instruction set.
                let (node, (mask, near)) = unsafe {
                    let node = self.structure.node_at(word);
                    meter.visit_node(node);
                    (node, K::intersect_node::<false>(&box_ray, node))
                };
                if mask == 0 {
                    continue 'next;
                }
                if mask & (mask - 1) == 0 {
                    word = node.child(mask.trailing_zeros() as usize);
                    continue;
                }
                if top > brim {
                    // Deeper than any structure that was built: corrupt.
                    continue 'next;
                }
                if self.fetches_ahead {
                    fetch(mask, node, self.structure);
                }
                // SAFETY: there is room for all children; the caller guarantees that the machine
                // has the kernel's instruction set.
                unsafe {
                    let pushed;
                    (word, pushed) = K::push::<ANY>(near, mask, node, top);
                    top = top.add(pushed);
                }
            }
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let groups = self
                .structure
                .leaf_groups(word, &mut room, |block, room| unsafe {
                    K::expand(block, room)
                });
            // Of no child there is none.
            let Some((groups, lanes)) = groups else {
                continue 'next;
            };
            meter.visit_triangles(lanes.count_ones());
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let mut mask = unsafe {
                K::intersect_leaf(
                    self.level_rays,
                    lane,
                    &box_ray,
                    groups,
                    lanes,
                    [t_min, nearest.t],
                    found,
                )
            };
            while mask != 0 {
                let i = mask.trailing_zeros() as usize % LEAF_TRIANGLES;
                mask &= mask - 1;
                let t = found.t[i];
                let slot = self.structure.first_slot(word & child::INDEX) + i as u32;
                if t > nearest.t || t == nearest.t && !self.wins_tie(nearest, slot) {
                    continue;
                }
                let [second, third] = &found.barycentrics;
                nearest = Nearest {
                    t_min,
                    t,
                    slot,
                    barycentrics: [second[i], third[i]],
                    front: found.front >> i & 1 != 0,
                };
                if ANY {
                    break 'next End::Over;
                }
                limit = Entry::last_at(t);
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                unsafe { K::shorten(&mut box_ray, t) };
            }
        };
        // SAFETY: both are in the stack.
        pending.length = unsafe { top.offset_from(stack) } as usize;
        *fuel = left;
        *best = nearest;
        end
    }
}
