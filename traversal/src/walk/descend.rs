//! The loop: from nodes down to leaves.

use super::children::{LARGE, fetch};
use super::entry::{Entry, STACK};
use super::kernel::Kernel;
use super::leaf::{Leaf, Triangles};
use super::level::{Entered, Level, only_instance};
use super::meter::Meter;
use super::opaque::{End, Nearest, Opaque, Pending};
use super::options::Specialisation;
use super::{Event, Walk, Walker, test_leaf};
use crate::layout::{WIDTH, child};
use crate::structure::Kind;

/// Runs a walk until something has to be decided outside. `ANY`: its first hit ends it, so the
/// order of children does not matter.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
pub(crate) unsafe fn run<K: Kernel, M: Meter, const ANY: bool>(
    walk: &mut Walk,
    walker: &mut Walker,
    entered: &mut Entered,
    fuel: &mut u64,
    meter: &mut M,
) -> Event {
    let without = walker.without();
    let Walker {
        stack,
        top,
        bottom,
        instance,
        hits,
        level_rays,
        ..
    } = walker;
    let mut in_bottom = true;
    if let Some(index) = entered.again(walk.top_level, &walk.ray) {
        if !bottom.place(top, index, &walk.ray, walk.time) {
            return Event::Done;
        }
    } else {
        // SAFETY: the contract of `Walk::new`.
        if !unsafe { top.enter_top(walk.top_level) } {
            return Event::Done;
        }
        // A top level of one instance is nothing to walk: straight to the bottom.
        let only = only_instance(top).filter(|_| !without.contains(Specialisation::OneInstance));
        if only.is_none() {
            top.set_up_top(&walk.ray);
        }
        entered.set(0, &walk.ray, None);
        let index = only.unwrap_or(walk.instance);
        if index == Walk::NO_INSTANCE {
            in_bottom = false;
        } else {
            // SAFETY: the contract of `Walk::new`.
            let entered =
                unsafe { bottom.enter_bottom(instance, top, index, &walk.ray, walk.time) };
            if !entered {
                return Event::Done;
            }
        }
        entered.set(walk.top_level, &walk.ray, only);
    }
    let mut length;
    // Entries of the stack that belong to the top level, while the walk is in a bottom level.
    let mut floor = 0;
    if walk.is_fresh() {
        stack[0] = Entry::new(0, 0.0);
        length = 1;
    } else {
        length = walk.pending.len().min(STACK - WIDTH);
        stack[..length].copy_from_slice(&walk.pending[..length]);
        floor = (walk.floor as usize).min(length);
    }
    let mut left = *fuel;
    // The rest of a leaf that a verdict interrupted.
    if let Some((word, first_lane)) = walk.leaf.take() {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        match unsafe { test_leaf::finish::<K>(walk, bottom, instance, word, first_lane) } {
            Leaf::Finished => {}
            Leaf::Over => return Event::Done,
            Leaf::Ask(event, lane) => {
                walk.leaf = Some((word, lane + 1));
                return event;
            }
        }
    }

    let event = 'level: loop {
        let level: &Level = if in_bottom { bottom } else { top };
        let level_ray = &level.ray;
        let node_count = level.structure.node_count();
        let fetch_ahead = node_count > LARGE && !without.contains(Specialisation::Prefetch);
        let is_triangles = level.structure.kind() == Kind::Triangles;
        let all_opaque = in_bottom
            && is_triangles
            && instance.all_opaque
            && level_ray.scale == 1.0
            && !without.contains(Specialisation::Opaque);
        if all_opaque {
            level_rays.set(0, level_ray);
            let way = Opaque {
                structure: &level.structure,
                instance,
                level_rays,
                lane: 0,
                committed: walk.committed(),
                fetches_ahead: fetch_ahead,
            };
            let mut best = Nearest::none_in(walk.ray.t_min, walk.hit.t);
            let mut pending = Pending {
                stack,
                floor,
                length,
            };
            let (best, pending) = (&mut best, &mut pending);
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let end = unsafe {
                match M::COUNTS {
                    true => K::walk_opaque_metered::<M, ANY>(
                        &way, best, pending, hits, &mut left, meter,
                    ),
                    false => K::walk_opaque::<ANY>(&way, best, pending, hits, &mut left),
                }
            };
            length = pending.length;
            if let Some(hit) = way.hit(best) {
                (walk.hit, walk.has_hit) = (hit, true);
            }
            match end {
                End::Over => break 'level Event::Done,
                End::OutOfFuel => break 'level Event::OutOfFuel,
                End::Finished if length == 0 => break 'level Event::Done,
                End::Finished => {}
            }
            in_bottom = false;
            floor = 0;
            continue 'level;
        }
        let mut t_far = level_ray.scaled_up(walk.hit.t);
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let mut ray = unsafe { K::load_level_ray(level_ray, t_far) };

        let entered = 'next: loop {
            // The nearest pending child that is still near enough.
            let mut word = loop {
                if length == floor {
                    if length == 0 {
                        break 'level Event::Done;
                    }
                    in_bottom = false;
                    floor = 0;
                    continue 'level;
                }
                length -= 1;
                // SAFETY: `length` is below `STACK` wherever an entry is pushed.
                let entry = unsafe { *stack.get_unchecked(length) };
                if ANY || entry.near() <= t_far {
                    break entry.word();
                }
            };
            // Down to a leaf.
            loop {
                if left == 0 {
                    stack[length] = Entry::new(word, 0.0);
                    length += 1;
                    break 'level Event::OutOfFuel;
                }
                left -= 1;
                // Words of leaves are above every index of a node.
                if word >= node_count {
                    meter.visit_leaf(&level.structure, word);
                    break;
                }
                // SAFETY: below the count.
                let node = unsafe { level.structure.node_at(word) };
                meter.visit_node(node);
                if length > STACK - WIDTH {
                    // Deeper than any structure that was built: corrupt.
                    continue 'next;
                }
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                let (mask, near) = unsafe { K::intersect_node::<true>(&ray, node) };
                if mask == 0 {
                    continue 'next;
                }
                if fetch_ahead && mask & (mask - 1) != 0 {
                    fetch(mask, node, &level.structure);
                }
                // SAFETY: there is room for all children.
                unsafe {
                    let place = stack.as_mut_ptr().add(length);
                    let pushed;
                    (word, pushed) = K::push::<ANY>(near, mask, node, place);
                    length += pushed;
                }
            }

            if word & child::LEAF == 0 || word == child::NONE {
                continue 'next;
            }
            if !in_bottom {
                break 'next word & child::INDEX;
            }
            if !is_triangles {
                match test_leaf::test_other(walk, level, instance, word, &mut t_far) {
                    Leaf::Finished => {
                        // SAFETY: the caller guarantees that the machine has the kernel's
                        // instruction set.
                        unsafe { K::shorten(&mut ray, t_far) };
                        continue 'next;
                    }
                    Leaf::Over => break 'level Event::Done,
                    Leaf::Ask(event, lane) => {
                        walk.leaf = Some((word, lane + 1));
                        break 'level event;
                    }
                }
            }
            let leaf = Triangles {
                level,
                instance,
                word,
                first_lane: 0,
            };
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            match unsafe { K::test_leaf(&leaf, walk, &mut t_far) } {
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                Leaf::Finished => unsafe { K::shorten(&mut ray, t_far) },
                Leaf::Over => break 'level Event::Done,
                Leaf::Ask(event, lane) => {
                    walk.leaf = Some((word, lane + 1));
                    break 'level event;
                }
            }
        };
        // SAFETY: the contract of `Walk::new`.
        if unsafe { bottom.enter_bottom(instance, top, entered, &walk.ray, walk.time) } {
            in_bottom = true;
            floor = length;
            stack[length] = Entry::new(0, 0.0);
            length += 1;
        }
    };
    *fuel = left;
    if event != Event::Done {
        walk.instance = if in_bottom {
            instance.index
        } else {
            Walk::NO_INSTANCE
        };
        walk.floor = floor as u32;
        walk.pending.clear();
        walk.pending.extend_from_slice(&stack[..length]);
    }
    event
}
