//! Walks through triangles that all count: opaque, not culled, in a space that is not scaled. Nothing there suspends a
//! walk but want of fuel, so the loop is small.

use super::beams::Beams;
use super::facts::InstanceFacts;
use super::kernel::{GroupHits, Kernel};
use super::walker::{Entry, STACK};
use super::{PACKET, descend};
use crate::layout::{LEAF_TRIANGLES, WIDTH, child};
use crate::ray::Hit;
use crate::structure::Structure;

/// Nodes of a structure that does not fit a core's caches, so that children are worth fetching
/// ahead.
pub(super) const LARGE: u32 = 4096;

/// Why a walk left a bottom level.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// All of it is done.
    Finished,
    /// The walk ends.
    Over,
    OutOfFuel,
}

/// What is still to be visited: entries from `floor` on are of this bottom level.
pub(crate) struct Pending<'a> {
    pub stack: &'a mut [Entry; STACK],
    pub floor: usize,
    pub length: usize,
}

/// A ray in a bottom level.
pub(crate) struct Opaque<'a> {
    pub structure: &'a Structure,
    pub instance: &'a InstanceFacts,
    pub beams: &'a Beams,
    pub lane: usize,
    /// What was found before.
    pub committed: Option<&'a Hit>,
    pub fetches_ahead: bool,
}

impl Opaque<'_> {
    /// Goes on with what is pending, for triangles in the interval of `best`: that is the nearest then.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn run<K: Kernel, const ANY: bool>(
        &self,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
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
        // SAFETY: the caller's promise.
        let mut beam = unsafe { K::load_beam(self.beams, lane, nearest.t) };
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
                // SAFETY: below the count, and the caller's promise.
                let (node, (mask, near)) = unsafe {
                    let node = self.structure.node_at(word);
                    (node, K::meet(&beam, node))
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
                    descend::fetch(mask, node, self.structure);
                }
                // SAFETY: there is room for all children; the caller's promise.
                unsafe {
                    let pushed;
                    (word, pushed) = K::push::<ANY>(near, mask, node, top);
                    top = top.add(pushed);
                }
            }
            // SAFETY: the caller's promise.
            let groups = self
                .structure
                .leaf_groups(word, &mut room, |block, room| unsafe {
                    K::expand(block, room)
                });
            // Of no child there is none.
            let Some((groups, lanes)) = groups else {
                continue 'next;
            };
            // SAFETY: the caller's promise.
            let mut mask = unsafe {
                K::intersect_leaf(
                    self.beams,
                    lane,
                    &beam,
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
                if t > nearest.t || t == nearest.t && !self.wins_tie(&nearest, slot) {
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
                // SAFETY: the caller's promise.
                unsafe { K::shorten(&mut beam, t) };
            }
        };
        // SAFETY: both are in the stack.
        pending.length = unsafe { top.offset_from(stack) } as usize;
        *fuel = left;
        *best = nearest;
        end
    }

    /// What was found, as a hit; `None` if nothing was.
    #[inline(always)]
    pub fn hit(&self, nearest: &Nearest) -> Option<Hit> {
        if nearest.slot == Hit::UNKNOWN_SLOT {
            return None;
        }
        Some(nearest.hit(self.instance, self.structure))
    }

    /// Whether a triangle at the distance of the nearest one, or of what was found before, or at the end of the ray, comes
    /// before that.
    #[cold]
    #[inline(never)]
    pub fn wins_tie(&self, nearest: &Nearest, slot: u32) -> bool {
        if nearest.slot != Hit::UNKNOWN_SLOT {
            return self.structure.identity(slot) < self.structure.identity(nearest.slot);
        }
        let hit = self.hit(&Nearest { slot, ..*nearest });
        (hit.zip(self.committed)).is_some_and(|(hit, committed)| hit.wins_tie(committed))
    }
}

/// The nearest triangle so far.
#[derive(Clone, Copy)]
pub(crate) struct Nearest {
    /// The ray's interval; `t` is the distance of what was found.
    pub t_min: f32,
    pub t: f32,
    /// Where it lies, as in [`Hit::slot`]; [`Hit::UNKNOWN_SLOT`] if there is none.
    pub slot: u32,
    pub barycentrics: [f32; 2],
    pub front: bool,
}

impl Nearest {
    /// None yet in an interval.
    pub const fn none_in(t_min: f32, t_max: f32) -> Nearest {
        Nearest {
            t_min,
            t: t_max,
            slot: Hit::UNKNOWN_SLOT,
            barycentrics: [0.0; 2],
            front: false,
        }
    }

    /// As a hit; there is one.
    #[inline(always)]
    pub fn hit(&self, instance: &InstanceFacts, structure: &Structure) -> Hit {
        let (geometry_index, primitive_index) = structure.identity(self.slot);
        Hit {
            t: self.t,
            barycentrics: self.barycentrics,
            geometry_index,
            primitive_index,
            slot: self.slot,
            hit_kind: instance.hit_kind(self.front),
            opaque: true,
            triangle: true,
            ..instance.hit()
        }
    }
}
