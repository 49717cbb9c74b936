//! Sixteen rays at once, where they go the same way: what rays of one picture tile do.
//!
//! Each lane computes what a walk by itself would, with the same operations in the same order, and
//! the hit does not depend on the order of the walk: so the hits are the same bits. (A ray that ends
//! with its first hit may find another one first.) A first test of all eight children, against the interval of
//! all rays, leaves one or two of them for the test of each ray.
//!
//! In an instance where rays no longer go the same way, each goes by itself. Anything unusual ends
//! the attempt, and every walk starts anew.

mod found;
mod rays;
mod triangle;

use std::arch::x86_64::*;

use super::beams::Given;
use super::facts::InstanceFacts;
use super::level::Level;
use super::opaque::LARGE;
use super::space::max;
use super::walker::{Entry, STACK};
use super::{Event, PACKET, State, Step, Verdict, Walk, Walker, descend, walker};
use crate::layout::{WIDTH, child};
use crate::ray::ray_flags;
use crate::structure::{Kind, Structure};
use found::Found;
use rays::{Rays, load};
use triangle::test_leaf;

/// Fewer rays are not worth it.
const ENOUGH: usize = 6;

/// Steps after which an attempt is given up: only a corrupt structure takes so many.
const PATIENCE: u32 = 1 << 16;

/// Directions differ by at most this, relative to the longest component.
const SPREAD: f32 = 0.125;

/// Origins differ by at most this, relative to their distance from the origin of space.
const WIDTH_OF_BEAM: f32 = 1.0 / 64.0;

/// Children still to be visited, and by which rays.
pub(crate) struct Stack {
    entries: [Entry; STACK],
    lanes: [u16; STACK],
    length: usize,
}

impl Stack {
    pub const EMPTY: Stack = Stack {
        entries: [Entry::ROOT; STACK],
        lanes: [0; STACK],
        length: 0,
    };

    /// Nothing but the root.
    fn start(&mut self, lanes: u16) {
        self.entries[0] = Entry::ROOT;
        self.lanes[0] = lanes;
        self.length = 1;
    }
}

/// What a packet needs of a walker beyond what walks need.
pub(crate) struct PacketSpace {
    top: Stack,
    bottom: Stack,
    /// In the instance that is being visited.
    rays: Rays,
}

impl PacketSpace {
    pub const EMPTY: PacketSpace = PacketSpace {
        top: Stack::EMPTY,
        bottom: Stack::EMPTY,
        rays: Rays::NOWHERE,
    };
}

/// Walks on to their ends together, if they have not started and their rays cohere. Otherwise
/// returns false, and nothing has happened.
pub(crate) fn run(steps: &mut [Step<'_>], walker: &mut Walker) -> bool {
    if steps.len() < ENOUGH || steps.len() > PACKET || !may_cohere(steps) {
        return false;
    }
    // SAFETY: packets are for walkers with this instruction set.
    match unsafe { run_avx512(steps, walker) } {
        Some(true) => return true,
        Some(false) => {}
        None => return false,
    }
    for step in steps {
        let (ray, top_level, time) = (step.walk.ray, step.walk.top_level, step.walk.time);
        // SAFETY: the promise that was made for the walk.
        unsafe { step.walk.restart(top_level, &ray) };
        step.walk.time = time;
    }
    false
}

/// Whether walks are alike but for their rays, and the first and the last ray are.
fn may_cohere(steps: &[Step<'_>]) -> bool {
    let (first, last) = (&steps[0].walk, &steps[steps.len() - 1].walk.ray);
    let longest = most(&first.ray.direction);
    let close =
        (0..3).all(|i| (last.direction[i] - first.ray.direction[i]).abs() <= SPREAD * longest);
    close
        && steps.iter().all(|step| {
            let walk = &*step.walk;
            walk.state == State::Fresh
                && step.verdict == Verdict::Continue
                && walk.top_level == first.top_level
                && walk.ray.flags == first.ray.flags
                && walk.ray.cull_mask == first.ray.cull_mask
        })
}

/// Whether rays start near each other (by the size of their distances from the origin of space), and go
/// the same way.
#[inline(always)]
fn cohere(given: &Given, lanes: u16) -> bool {
    let (o, d) = (&given.origin, &given.direction);
    let spread = SPREAD * most(&[d[0][0], d[1][0], d[2][0]]);
    let width = WIDTH_OF_BEAM * most(&[o[0][0], o[1][0], o[2][0]]);
    let mut near = [0u32; PACKET];
    for i in 0..PACKET {
        let turned = max(
            (d[0][i] - d[0][0]).abs(),
            max((d[1][i] - d[1][0]).abs(), (d[2][i] - d[2][0]).abs()),
        );
        let moved = max(
            (o[0][i] - o[0][0]).abs(),
            max((o[1][i] - o[1][0]).abs(), (o[2][i] - o[2][0]).abs()),
        );
        near[i] = u32::from((turned <= spread) & (moved <= width)) & given.sound[i];
    }
    let near = (0..PACKET).fold(0, |mask, i| mask | (near[i] as u16) << i);
    near & lanes == lanes
}

/// The longest component.
fn most(v: &[f32; 3]) -> f32 {
    v.iter().fold(0f32, |most, c| most.max(c.abs()))
}

/// Whether the walks were taken to their ends; `None` if nothing has happened.
///
/// # Safety
/// The machine has the instruction set.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn run_avx512(steps: &mut [Step<'_>], walker: &mut Walker) -> Option<bool> {
    let given = Given::new(steps);
    let lanes = u16::MAX >> (PACKET - steps.len());
    // SAFETY: the caller's promise.
    cohere(&given, lanes).then(|| unsafe { run_together(steps, walker, given, lanes) })
}

/// # Safety
/// The machine has the instruction set.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn run_together(
    steps: &mut [Step<'_>],
    walker: &mut Walker,
    given: Given,
    lanes: u16,
) -> bool {
    let ray = steps[0].walk.ray;
    let any = ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
    // SAFETY: the contract of `Walk::new`, here and below.
    if !unsafe { walker.top.enter_top(steps[0].walk.top_level) } {
        return false;
    }
    let structure = walker.top.structure;
    if structure.kind() != Kind::Instances {
        return false;
    }
    let mut packet = Packet {
        lanes,
        any,
        patience: PATIENCE,
        found: Found::new(steps),
        given,
    };
    if let Some(index) = descend::only_instance(&walker.top) {
        if packet.visit_instance(steps, walker, index, lanes) != Visit::Done {
            return false;
        }
    } else {
        let mut rays = Rays::NOWHERE;
        let origin_error = structure.header().origin_error;
        if !rays.set_up(&packet.given, origin_error, lanes) {
            return false;
        }
        walker.packet.top.start(lanes);
        while let Some((word, lanes, _)) =
            packet.next_leaf(&rays, &structure, &mut walker.packet.top)
        {
            let index = word & child::INDEX;
            let done = match packet.visit_instance(steps, walker, index, lanes) {
                Visit::Done => true,
                Visit::Unusual => false,
                Visit::Apart => packet.go_singly(steps, walker, index, lanes),
            };
            if !done {
                return false;
            }
        }
    }
    packet.patience > 0 && packet.finish(steps, &walker.top)
}

/// What became of an instance.
#[derive(PartialEq, Eq)]
enum Visit {
    Done,
    /// The rays do not go the same way there.
    Apart,
    /// It holds something that a packet does not do.
    Unusual,
}

/// Rays on their way.
struct Packet {
    lanes: u16,
    /// The first hit of a ray ends it.
    any: bool,
    patience: u32,
    found: Found,
    given: Given,
}

impl Packet {
    /// Rays that are not over.
    fn live(&self) -> u16 {
        if self.any {
            self.lanes & !self.found.hit
        } else {
            self.lanes
        }
    }

    /// Down from what is pending to the next leaf, and the rays that may meet it.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
    fn next_leaf(
        &mut self,
        rays: &Rays,
        structure: &Structure,
        stack: &mut Stack,
    ) -> Option<(u32, u16, f32)> {
        let Stack {
            entries,
            lanes,
            length,
        } = stack;
        let live = self.live();
        let fetches_ahead = structure.node_count() > LARGE;
        let t = load(&self.found.t);
        let t_far = _mm512_mask_reduce_max_ps(live, t);
        while *length > 0 && live != 0 {
            *length -= 1;
            let (entry, here) = (entries[*length], lanes[*length] & live);
            if entry.near() > t_far || here == 0 {
                continue;
            }
            self.patience = self.patience.saturating_sub(1);
            if self.patience == 0 {
                return None;
            }
            let word = entry.word();
            if word & child::LEAF != 0 {
                if word != child::NONE {
                    return Some((word, here, t_far));
                }
                continue;
            }
            let Some(node) = structure.node(word) else {
                continue;
            };
            if *length > STACK - WIDTH {
                continue;
            }
            let base = *length;
            let mut near = [0.0; WIDTH];
            let mut rest = rays.test_interval(node, t_far, &mut near);
            if fetches_ahead && rest != 0 {
                descend::fetch(rest, node, structure);
            }
            while rest != 0 {
                let child = rest.trailing_zeros() as usize % WIDTH;
                rest &= rest - 1;
                let mask = rays.test_box(node, child, t) & here;
                if mask == 0 {
                    continue;
                }
                let entry = Entry::new(node.children[child], near[child]);
                // The nearest goes last.
                let mut place = *length;
                while place > base && entries[place - 1] < entry {
                    entries[place] = entries[place - 1];
                    lanes[place] = lanes[place - 1];
                    place -= 1;
                }
                entries[place] = entry;
                lanes[place] = mask;
                *length += 1;
            }
        }
        None
    }

    /// Takes the rays of `lanes` through an instance.
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
    fn visit_instance(
        &mut self,
        steps: &[Step<'_>],
        walker: &mut Walker,
        index: u32,
        lanes: u16,
    ) -> Visit {
        let Walker {
            top,
            bottom,
            instance,
            packet:
                PacketSpace {
                    bottom: stack,
                    rays,
                    ..
                },
            ..
        } = walker;
        // SAFETY: the contract of `Walk::new`.
        if !unsafe { bottom.admit(instance, top, index, &steps[0].walk.ray) } {
            return Visit::Done;
        }
        let structure = bottom.structure;
        let Some(record) = top.structure.instance(index) else {
            return Visit::Done;
        };
        if !instance.takes_all || structure.kind() != Kind::Triangles {
            return Visit::Unusual;
        }
        if !rays.set_up_instance(&self.given, record, lanes) {
            return Visit::Apart;
        }
        self.found.instance = index;
        stack.start(lanes);
        while let Some((word, here, t_far)) = self.next_leaf(rays, &structure, stack) {
            test_leaf(rays, &structure, word, here, t_far, &mut self.found);
        }
        Visit::Done
    }

    /// Takes each ray of `lanes` through an instance of a top level of several; false if a walk has a question.
    #[cold]
    fn go_singly(
        &mut self,
        steps: &mut [Step<'_>],
        walker: &mut Walker,
        index: u32,
        lanes: u16,
    ) -> bool {
        for lane in lanes_of(lanes & self.live()) {
            let walk = &mut *steps[lane].walk;
            self.settle(lane, walk, &walker.top, &mut None);
            let (before, had_hit) = (walk.hit, walk.has_hit);
            (walk.state, walk.instance) = (State::OutOfFuel, index);
            walk.pending.clear();
            walk.pending.push(Entry::ROOT);
            let mut step = [Step::new(walk, Verdict::Continue)];
            walker::run(&mut step, walker, &mut { u64::MAX });
            if step[0].event != Event::Done {
                return false;
            }
            let walk = &*step[0].walk;
            if walk.has_hit && !(had_hit && walk.hit == before) {
                self.found.set(lane, &walk.hit, &walker.instance);
            }
        }
        true
    }

    /// Ends all walks with what was found.
    fn finish(&self, steps: &mut [Step<'_>], top: &Level) -> bool {
        let mut place = None;
        for (lane, step) in steps.iter_mut().enumerate() {
            self.settle(lane, step.walk, top, &mut place);
            step.walk.state = State::Done;
            step.event = Event::Done;
        }
        true
    }

    /// Puts down in a lane's walk what was found for it. `place` is the instance of the lane before.
    fn settle(
        &self,
        lane: usize,
        walk: &mut Walk,
        top: &Level,
        place: &mut Option<(InstanceFacts, Structure)>,
    ) {
        if self.found.hit >> lane & 1 == 0 {
            return;
        }
        let index = self.found.instances[lane];
        if place.is_none_or(|(facts, _)| facts.index != index) {
            let facts = (top.structure.instance(index))
                .map(|record| InstanceFacts::new(index, record, &walk.ray));
            // SAFETY: the contract of `Walk::new`.
            *place = facts.zip(unsafe { Structure::at(top.structure.reference(index)) });
        }
        if let Some((facts, structure)) = place {
            walk.hit = self.found.hit(lane, structure, facts);
            walk.has_hit = true;
        }
    }
}

/// The lanes of a mask.
fn lanes_of(mask: u16) -> impl Iterator<Item = usize> {
    (0..PACKET).filter(move |&lane| mask >> lane & 1 != 0)
}
