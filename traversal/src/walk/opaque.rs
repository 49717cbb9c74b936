//! Walks through triangles that all count: opaque, not culled, in a space that is not scaled. Nothing there suspends a
//! walk but want of fuel, so the loop is small.

use super::beams::{Beams, Given};
use super::facts::InstanceFacts;
use super::kernel::{GroupHits, Kernel};
use super::options::Specialisation;
use super::walker::{Entry, STACK};
use super::{Event, PACKET, State, Step, Verdict, Walk, Walker, descend};
use crate::layout::{Form, GROUP, LEAF_TRIANGLES, TriangleGroup, WIDTH, child, instance_state};
use crate::ray::Hit;
use crate::structure::{Kind, Structure};

/// Nodes of a structure that does not fit a core's caches, so that children are worth fetching
/// ahead.
pub(super) const LARGE: u32 = 4096;

/// Fewer rays are set up one by one for less.
const ENOUGH: usize = 4;

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
    pub fetches_ahead: bool,
}

/// Takes the walks of a list to their ends that have just begun in a top level whose only instance is of this kind. Returns
/// which those are.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
pub(crate) unsafe fn run_list<K: Kernel>(
    steps: &mut [Step<'_>],
    walker: &mut Walker,
    fuel: &mut u64,
) -> u32 {
    let without = walker.without();
    let by_itself = steps.len() < ENOUGH
        || without.contains(Specialisation::OneInstance)
        || without.contains(Specialisation::Opaque);
    if by_itself {
        return 0;
    }
    let Walker {
        stack,
        top,
        bottom,
        instance,
        hits,
        beams,
        ..
    } = walker;
    let first = &*steps[0].walk;
    let (address, flags, cull_mask) = (first.top_level, first.ray.flags, first.ray.cull_mask);
    // SAFETY: the contract of `Walk::new`.
    let index = unsafe { top.enter_top(address) }
        .then(|| descend::only_instance(top))
        .flatten();
    let Some(index) = index else { return 0 };
    // SAFETY: as above.
    if !unsafe { bottom.admit(instance, top, index, &first.ray) } {
        return 0;
    }
    let Some(record) = top.structure.instance(index) else {
        return 0;
    };
    if !instance.takes_all
        || bottom.structure.kind() != Kind::Triangles
        || record.state & instance_state::MOVING != 0
    {
        return 0;
    }
    let mut alike = 0;
    for (lane, step) in steps.iter().enumerate() {
        let walk = &*step.walk;
        let same = walk.top_level == address
            && walk.ray.flags == flags
            && walk.ray.cull_mask == cull_mask
            && walk.state == State::Fresh
            && step.verdict == Verdict::Continue;
        alike |= u32::from(same) << lane;
    }
    alike &= beams.set_up(&Given::new(steps), record);
    let fetches_ahead =
        bottom.structure.node_count() > LARGE && !without.contains(Specialisation::Prefetch);
    let any = steps[0].walk.terminates_on_first_hit();
    for (lane, step) in steps.iter_mut().enumerate().take(PACKET) {
        if alike >> lane & 1 == 0 {
            continue;
        }
        let walk = &mut *step.walk;
        let way = Opaque {
            structure: &bottom.structure,
            instance,
            beams,
            lane,
            fetches_ahead,
        };
        stack[0] = Entry::ROOT;
        let mut pending = Pending {
            stack,
            floor: 0,
            length: 1,
        };
        // SAFETY: the caller's promise.
        let end = unsafe {
            if any {
                K::walk_opaque::<true>(&way, walk, &mut pending, hits, fuel)
            } else {
                K::walk_opaque::<false>(&way, walk, &mut pending, hits, fuel)
            }
        };
        step.event = Event::Done;
        if end == End::OutOfFuel {
            walk.instance = index;
            walk.floor = 0;
            walk.pending.clear();
            let length = pending.length;
            walk.pending.extend_from_slice(&stack[..length]);
            step.event = Event::OutOfFuel;
        }
        walk.state = State::after(step.event);
    }
    alike
}

impl Opaque<'_> {
    /// Goes on with what is pending.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    pub unsafe fn run<K: Kernel, const ANY: bool>(
        &self,
        walk: &mut Walk,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
    ) -> End {
        let (nodes, node_count) = (self.structure.nodes(), self.structure.node_count());
        let (all_groups, group_count) = self.structure.groups();
        let is_blocks = self.structure.form() == Form::Blocks;
        let mut place = None;
        let lane = self.lane % PACKET;
        let (t_min, mut t_far) = (walk.ray.t_min, walk.hit.t);
        let mut nearest = Nearest::NONE;
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
        let mut beam = unsafe { K::load_beam(self.beams, lane, t_far) };
        let mut limit = Entry::last_at(t_far);
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
                // SAFETY: below the count, so inside the part; parts are aligned. The caller's promise.
                let (node, (mask, near)) = unsafe {
                    let node = &*nodes.add(word as usize);
                    (node, K::meet(&beam, node))
                };
                if mask == 0 {
                    continue 'next;
                }
                if mask & (mask - 1) == 0 {
                    word = node.children[mask.trailing_zeros() as usize % WIDTH];
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
                    (word, pushed) = K::push::<ANY>(near, mask, &node.children, top);
                    top = top.add(pushed);
                }
            }
            let index = word & child::INDEX;
            let (groups, lanes);
            if is_blocks {
                let Some(block) = self.structure.block(index) else {
                    continue 'next;
                };
                let [first, last] = &mut *place.get_or_insert([TriangleGroup::EMPTY; 2]);
                // SAFETY: the caller's promise.
                lanes = unsafe { K::expand(block, [first, last]) };
                groups = [&*first, &*last];
            } else {
                let two = word & child::TWO_GROUPS != 0;
                let last = index + u32::from(two);
                // Of no child there is no group.
                if last >= group_count {
                    continue 'next;
                }
                // SAFETY: below the count, so inside the part; parts are aligned.
                let [first, last] = unsafe {
                    [
                        &*all_groups.add(index as usize),
                        &*all_groups.add(last as usize),
                    ]
                };
                let others = if two { last.lanes & 0xF } else { 0 };
                lanes = first.lanes & 0xF | others << GROUP;
                groups = [first, last];
            }
            // SAFETY: the caller's promise.
            let mut mask = unsafe {
                K::intersect_leaf(
                    self.beams,
                    lane,
                    &beam,
                    groups,
                    lanes,
                    [t_min, t_far],
                    found,
                )
            };
            while mask != 0 {
                let i = mask.trailing_zeros() as usize % LEAF_TRIANGLES;
                mask &= mask - 1;
                let t = found.t[i];
                let slot = self.structure.first_slot(index) + i as u32;
                if t > t_far || t == t_far && !self.wins_tie(walk, nearest.slot, slot) {
                    continue;
                }
                let [second, third] = &found.barycentrics;
                nearest = Nearest {
                    slot,
                    barycentrics: [second[i], third[i]],
                    front: found.front >> i & 1 != 0,
                };
                t_far = t;
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
        if nearest.slot != Hit::UNKNOWN_SLOT {
            walk.hit = self.hit(t_far, &nearest);
            walk.has_hit = true;
        }
        end
    }

    #[inline(always)]
    fn hit(&self, t: f32, nearest: &Nearest) -> Hit {
        let (geometry_index, primitive_index) = self.structure.identity(nearest.slot);
        Hit {
            t,
            barycentrics: nearest.barycentrics,
            geometry_index,
            primitive_index,
            slot: nearest.slot,
            hit_kind: self.instance.hit_kind(nearest.front),
            opaque: true,
            triangle: true,
            ..self.instance.hit()
        }
    }

    /// Whether a triangle at the distance of the nearest one, or of what is committed, or at the end of the ray, comes
    /// before that.
    #[cold]
    #[inline(never)]
    fn wins_tie(&self, walk: &Walk, nearest: u32, slot: u32) -> bool {
        if nearest != Hit::UNKNOWN_SLOT {
            return self.structure.identity(slot) < self.structure.identity(nearest);
        }
        let nearest = Nearest {
            slot,
            ..Nearest::NONE
        };
        walk.is_nearer(&self.hit(walk.hit.t, &nearest))
    }
}

/// The nearest triangle so far.
struct Nearest {
    /// Where it lies, as in [`Hit::slot`].
    slot: u32,
    barycentrics: [f32; 2],
    front: bool,
}

impl Nearest {
    const NONE: Nearest = Nearest {
        slot: Hit::UNKNOWN_SLOT,
        barycentrics: [0.0; 2],
        front: false,
    };
}
