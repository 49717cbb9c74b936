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
use super::rows::{HitRows, RayRows, blend, lanes_of};
use super::space::max;
use super::walker::{Entry, STACK};
use super::{Event, PACKET, State, Verdict, Walk, Walker, descend};
use crate::layout::{WIDTH, child};
use crate::ray::{Ray, ray_flags};
use crate::structure::{Kind, Structure};
use found::Found;
use rays::{Rays, load};
use triangle::test_leaf;

/// Fewer rays are not worth it.
const ENOUGH: u32 = 6;

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

/// Traces rays to their ends together if they cohere. Otherwise returns false, and nothing has happened.
///
/// # Safety
/// The contract of [`Walk::new`], for every ray; the machine has AVX-512.
pub(crate) unsafe fn run(
    rays: &RayRows,
    lanes: u16,
    hits: &mut HitRows,
    walker: &mut Walker,
) -> bool {
    // SAFETY: the caller's promise.
    may_cohere(rays, lanes) && unsafe { run_avx512(rays, lanes, hits, walker) }
}

/// Whether rays are enough, have structure, flags and mask in common, and the first and the last go the same way.
fn may_cohere(rays: &RayRows, lanes: u16) -> bool {
    if lanes.count_ones() < ENOUGH {
        return false;
    }
    let first = lanes.trailing_zeros() as usize % PACKET;
    let last = lanes.ilog2() as usize % PACKET;
    let direction = |lane: usize| rays.direction.map(|row| row[lane]);
    let (from, to) = (direction(first), direction(last));
    let longest = most(&from);
    let close = (0..3).all(|i| (to[i] - from[i]).abs() <= SPREAD * longest);
    close && rays.alike(first, lanes) == lanes
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

/// Whether the rays were traced to their ends.
///
/// # Safety
/// The contract of [`Walk::new`], for every ray; the machine has the instruction set.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn run_avx512(rays: &RayRows, lanes: u16, hits: &mut HitRows, walker: &mut Walker) -> bool {
    let given = Given::new(rays, lanes);
    if !cohere(&given, lanes) {
        return false;
    }
    let first = rays.ray(lanes.trailing_zeros() as usize % PACKET);
    // SAFETY: the caller's promise, here and below.
    if !unsafe {
        walker
            .top
            .enter_top(rays.top_level[lanes.trailing_zeros() as usize % PACKET])
    } {
        return false;
    }
    let structure = walker.top.structure;
    if structure.kind() != Kind::Instances {
        return false;
    }
    let mut packet = Packet {
        lanes,
        any: first.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0,
        patience: PATIENCE,
        found: Found::new(rays),
        given,
        first,
        rays,
    };
    if let Some(index) = descend::only_instance(&walker.top) {
        if packet.visit_instance(walker, index, lanes) != Visit::Done {
            return false;
        }
    } else {
        let mut ways = Rays::NOWHERE;
        let origin_error = structure.header().origin_error;
        if !ways.set_up(&packet.given, origin_error, lanes) {
            return false;
        }
        walker.packet.top.start(lanes);
        while let Some((word, lanes, _)) =
            packet.next_leaf(&ways, &structure, &mut walker.packet.top)
        {
            let index = word & child::INDEX;
            let done = match packet.visit_instance(walker, index, lanes) {
                Visit::Done => true,
                Visit::Unusual => false,
                Visit::Apart => packet.go_singly(walker, index, lanes),
            };
            if !done {
                return false;
            }
        }
    }
    packet.patience > 0 && packet.finish(hits, &walker.top)
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
struct Packet<'a> {
    rays: &'a RayRows,
    /// One of them, for what they have in common.
    first: Ray,
    lanes: u16,
    /// The first hit of a ray ends it.
    any: bool,
    patience: u32,
    found: Found,
    given: Given,
}

impl Packet<'_> {
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
    fn visit_instance(&mut self, walker: &mut Walker, index: u32, lanes: u16) -> Visit {
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
        if !unsafe { bottom.admit(instance, top, index, &self.first) } {
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
    fn go_singly(&mut self, walker: &mut Walker, index: u32, lanes: u16) -> bool {
        let mut walk = Walk::OVER;
        for lane in lanes_of(lanes & self.live()) {
            // SAFETY: the promise that was made for the rays.
            unsafe { walk.restart(self.rays.top_level[lane], &self.rays.ray(lane)) };
            walk.time = self.rays.time[lane];
            if let Some((facts, structure)) = self.place(lane, &walker.top) {
                (walk.hit, walk.has_hit) = (self.found.hit(lane, &structure, &facts), true);
            }
            let before = (walk.has_hit, walk.hit);
            (walk.state, walk.instance) = (State::OutOfFuel, index);
            walk.pending.push(Entry::ROOT);
            if walk.resume(walker, Verdict::Continue, &mut { u64::MAX }) != Event::Done {
                return false;
            }
            if (walk.has_hit, walk.hit) != before {
                self.found.set(lane, &walk.hit, &walker.instance);
            }
        }
        true
    }

    /// Puts down what was found.
    fn finish(&self, hits: &mut HitRows, top: &Level) -> bool {
        let found = &self.found;
        hits.start(self.rays, self.lanes);
        let mut rest = found.hit;
        blend(&mut hits.t, &found.t, rest);
        for (weights, found) in hits.barycentrics.iter_mut().zip(&found.barycentrics) {
            blend(weights, found, rest);
        }
        blend(&mut hits.slot, &found.slots, rest);
        blend(&mut hits.instance_index, &found.instances, rest);
        while rest != 0 {
            let first = rest.trailing_zeros() as usize % PACKET;
            let there = found.instances_alike(first) & rest;
            rest &= !there;
            let Some((facts, structure)) = self.place(first, top) else {
                continue;
            };
            hits.set_instance(there, &facts.hit());
            hits.found |= there;
            for lane in lanes_of(there) {
                let (geometry, primitive) = structure.identity(found.slots[lane]);
                hits.geometry_index[lane] = geometry;
                hits.primitive_index[lane] = primitive;
                hits.set_opaque_triangle(lane, facts.hit_kind(found.front >> lane & 1 != 0));
            }
        }
        true
    }

    /// The instance in which a lane has its hit, and what is there; `None` without a hit.
    fn place(&self, lane: usize, top: &Level) -> Option<(InstanceFacts, Structure)> {
        if self.found.hit >> lane & 1 == 0 {
            return None;
        }
        let index = self.found.instances[lane];
        let record = top.structure.instance(index)?;
        // SAFETY: the contract of `Walk::new`.
        let structure = unsafe { Structure::at(top.structure.reference(index)) }?;
        Some((InstanceFacts::new(index, record, &self.first), structure))
    }
}
