//! Sixteen rays at once, while they visit the same nodes, as rays of one picture tile do.
//!
//! Each lane performs the operations of a single walk in the same order, and the hit does not
//! depend on the order of nodes, so the hits have the same bits. (A ray that ends with its first
//! hit may find another one first.) A first test of all eight children, against the interval of all
//! rays, leaves one or two of them for the test of each ray.
//!
//! Rays whose directions differ in their signs or in their longest axis are packets of their own,
//! one after another, where none stop for candidates. In one of several instances where the rays
//! diverge, each ray is walked alone. Anything unusual ends the attempt, and every walk starts
//! anew. Where a [`Suspended`] keeps them, packets stop for candidates that shaders are to decide
//! on: the next one of each ray in a leaf of triangles, or a box with all rays that meet it. Once
//! they have, what is unusual splits them into single walks.

mod candidates;
mod instances;
mod kernel;
mod plain;
mod portable;
mod rays;
#[cfg(target_arch = "x86_64")]
mod register;
mod set_up;
mod stack;
#[cfg(target_arch = "x86_64")]
mod triangle;
#[cfg(target_arch = "x86_64")]
mod vectors;
#[cfg(target_arch = "x86_64")]
mod wide;

use super::children::{LARGE, fetch};
use super::entry::{Entry, STACK};
use super::facts::InstanceFacts;
use super::found::Found;
use super::level::{Level, only_instance};
use super::rows::{HitRows, Lanes, RayRows, Words, blend, load_row};
use super::suspended::{Progress, Suspended};
use super::{Event, PACKET, Verdict, Walk, WalkState, Walker};
use crate::layout::{WIDTH, child};
use crate::ray::{Ray, ray_flags};
use crate::structure::{Kind, Structure};
use instances::Entering;
use kernel::PacketKernel;
use lanes::LaneMask;
#[cfg(target_arch = "x86_64")]
use lanes::Tier;
use lanes::vector::Vector;
use rays::Rays;
pub(crate) use stack::{PacketSpace, Stack};

/// Fewer rays are not worth it.
const ENOUGH: u32 = 6;

/// Steps after which an attempt is given up, or rays part, if fuel lasts as long: few structures
/// that are not corrupt take so many.
const PATIENCE: u32 = 1 << 16;

/// Traces rays together if they cohere: to their ends or, with a [`Suspended`] to keep them, to
/// candidates. `are_alike`, here and below: see
/// [`Start::are_alike`](super::group_walks::Start::are_alike).
///
/// # Safety
/// The contract of [`Walk::new`], for every ray.
pub(crate) unsafe fn run(
    rays: &RayRows,
    (lanes, are_alike): (LaneMask, bool),
    hits: &mut HitRows,
    walker: &mut Walker,
    suspended: Option<&mut Suspended>,
) -> Progress {
    if !may_cohere(rays, lanes) {
        return Progress::Singly;
    }
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
    unsafe {
        match trace(rays, (lanes, are_alike), hits, walker, suspended) {
            Progress::Apart(alike) => run_apart(rays, (lanes, alike), hits, walker),
            progress => progress,
        }
    }
}

/// Traces rays of which some go the same way, and then the others, each way by itself. None of them
/// stop for candidates.
///
/// # Safety
/// The contract of [`Walk::new`], for every ray.
#[cold]
unsafe fn run_apart(
    rays: &RayRows,
    (mut rest, mut part): (LaneMask, LaneMask),
    hits: &mut HitRows,
    walker: &mut Walker,
) -> Progress {
    loop {
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        match unsafe { trace(rays, (part, false), hits, walker, None) } {
            Progress::Apart(alike) if alike != part => part = alike,
            Progress::Done if rest == part => return Progress::Done,
            Progress::Done => {
                rest -= part;
                part = rest;
            }
            _ => return Progress::Singly,
        }
    }
}

/// Traces rays together if all go the same way.
///
/// # Safety
/// The contract of [`Walk::new`], for every ray.
#[inline(always)]
unsafe fn trace(
    rays: &RayRows,
    lanes: (LaneMask, bool),
    hits: &mut HitRows,
    walker: &mut Walker,
    suspended: Option<&mut Suspended>,
) -> Progress {
    let filled;
    let rays = match lanes.0 {
        LaneMask::ALL => rays,
        there => {
            filled = rays.filled(there);
            &filled
        }
    };
    match walker.options.tier {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray; a walker has this
        // tier only on machines that have the instruction set.
        Tier::Avx512 => unsafe { wide::Avx512::trace_packet(rays, lanes, hits, walker, suspended) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        Tier::Avx2 => unsafe {
            wide::Avx2Packets::trace_packet(rays, lanes, hits, walker, suspended)
        },
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray; every machine has
        // plain Rust.
        _ => unsafe { plain::PortablePackets::trace_packet(rays, lanes, hits, walker, suspended) },
    }
}

/// Goes on with rays after decisions about their candidates.
///
/// # Safety
/// The contract of [`Walk::new`], for every ray.
pub(crate) unsafe fn resume(
    rays: &RayRows,
    hits: &mut HitRows,
    walker: &mut Walker,
    suspended: &mut Suspended,
) -> Progress {
    let filled;
    let rays = match suspended.started {
        LaneMask::ALL => rays,
        started => {
            filled = rays.filled(started);
            &filled
        }
    };
    match walker.options.tier {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        Tier::Avx512 => unsafe { wide::Avx512::resume_packet(rays, hits, walker, suspended) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        Tier::Avx2 => unsafe { wide::Avx2Packets::resume_packet(rays, hits, walker, suspended) },
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        _ => unsafe { plain::PortablePackets::resume_packet(rays, hits, walker, suspended) },
    }
}

/// Steps that a packet may take: no more than single rays take before they look at whether they may
/// go on.
fn patience(walker: &Walker) -> u32 {
    let fuel = u32::try_from(walker.options.fuel);
    fuel.map_or(PATIENCE, |fuel| fuel.min(PATIENCE))
}

/// Whether rays are enough, and the first and the last go the same way.
#[inline]
fn may_cohere(rays: &RayRows, lanes: LaneMask) -> bool {
    if lanes.count() < ENOUGH {
        return false;
    }
    let first = lanes.first();
    let last = lanes.bits().ilog2() as usize % PACKET;
    let [x, y, z] = &rays.direction;
    let most = set_up::SPREAD * set_up::most(&[x[first], y[first], z[first]]);
    let turned = |row: &Lanes| (row[last] - row[first]).abs() <= most;
    turned(x) && turned(y) && turned(z)
}

/// # Safety
/// The contract of [`Walk::new`], for every ray; the machine has the instruction set.
#[inline(always)]
unsafe fn trace_packet<K: PacketKernel>(
    rays: &RayRows,
    (lanes, are_alike): (LaneMask, bool),
    hits: &mut HitRows,
    walker: &mut Walker,
    suspended: Option<&mut Suspended>,
) -> Progress {
    // SAFETY: the caller guarantees a machine with the instruction set.
    let v = unsafe { K::V::new() };
    if !(are_alike || rays.are_alike()) || !set_up::cohere(v, rays, lanes) {
        return Progress::Singly;
    }
    let first = lanes.first();
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with the
    // instruction set.
    if !unsafe { walker.top.enter_top(rays.top_level[first]) } {
        return Progress::Singly;
    }
    if walker.top.structure.kind() != Kind::Instances {
        return Progress::Singly;
    }
    let first = rays.ray(first);
    let mut found = Found::new(rays);
    let mut packet = Packet {
        lanes,
        any: first.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0,
        patience: patience(walker),
        found: &mut found,
        first,
        rays,
        has_asked: false,
        suspended,
    };
    let only = only_instance(&walker.top).map(|index| (index, lanes));
    if only.is_none() {
        let origin_error = walker.top.structure.origin_error();
        let ways = &mut walker.packet.ways;
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // the instruction set.
        let alike = unsafe { K::set_up_top(ways, rays, origin_error, lanes) };
        if alike != lanes {
            return Progress::apart(alike);
        }
        walker.packet.top.start(lanes);
    }
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with the
    // instruction set.
    unsafe { packet.go::<K>(walker, hits, only) }
}

/// # Safety
/// The contract of [`Walk::new`], for every ray; the machine has the instruction set.
#[inline(always)]
unsafe fn resume_packet<K: PacketKernel>(
    rays: &RayRows,
    hits: &mut HitRows,
    walker: &mut Walker,
    suspended: &mut Suspended,
) -> Progress {
    let started = suspended.started;
    let first = started.first();
    let mut found = suspended.found.clone();
    let mut packet = Packet {
        lanes: suspended.lanes - suspended.ended,
        any: suspended.any,
        patience: suspended.patience,
        found: &mut found,
        first: rays.ray(first),
        rays,
        has_asked: true,
        suspended: None,
    };
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with the
    // instruction set.
    if !unsafe { walker.top.enter_top(rays.top_level[first]) } {
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // the instruction set.
        return unsafe { K::finish(&packet, hits, &walker.top) };
    }
    if only_instance(&walker.top).is_none() {
        let origin_error = walker.top.structure.origin_error();
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // the instruction set.
        unsafe { K::set_up_top(&mut walker.packet.ways, rays, origin_error, started) };
        walker.packet.top.restore(&suspended.top);
    }
    if let Some((index, lanes)) = suspended.instance {
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // the instruction set.
        let entering = unsafe { packet.enter::<K>(walker, index, lanes, true) };
        let Entering::Inside(way) = entering else {
            // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine
            // with the instruction set.
            return unsafe { K::finish(&packet, hits, &walker.top) };
        };
        walker.packet.bottom.restore(&suspended.bottom);
        let leaf = suspended.leaf;
        packet.suspended = Some(suspended);
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // the instruction set.
        if unsafe { packet.walk_instance::<K>(walker, way, (index, lanes), leaf) } {
            return Progress::Candidates;
        }
        if packet.patience == 0 {
            // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine
            // with the instruction set.
            return unsafe { packet.split::<K>(walker, hits, (index, lanes)) };
        }
        if only_instance(&walker.top).is_some() {
            // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine
            // with the instruction set.
            return unsafe { K::finish(&packet, hits, &walker.top) };
        }
    }
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with the
    // instruction set.
    unsafe { packet.go::<K>(walker, hits, None) }
}

/// Lanes with this word.
#[inline(always)]
fn equal<V: Vector>(v: V, row: &Words, word: u32) -> LaneMask {
    !LaneMask::from_bits(v.ne_i(v.load_i(row), v.splat_i(word as i32)))
}

/// Rays on their way.
struct Packet<'a> {
    /// In lanes without one, the first.
    rays: &'a RayRows,
    /// One of them, for what they have in common.
    first: Ray,
    lanes: LaneMask,
    /// The first hit of a ray ends it.
    any: bool,
    patience: u32,
    found: &'a mut Found,
    /// Shaders have decided on candidates: there is no way back.
    has_asked: bool,
    /// Keeps them while shaders decide.
    suspended: Option<&'a mut Suspended>,
}

impl Packet<'_> {
    /// Rays that are not over.
    fn live(&self) -> LaneMask {
        if self.any {
            self.lanes - (self.found.hit | self.found.outside)
        } else {
            self.lanes
        }
    }

    /// Down from what is pending to the next leaf, and the rays that may meet it.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn next_leaf<K: PacketKernel>(
        &mut self,
        rays: &Rays,
        structure: &Structure,
        stack: &mut Stack,
    ) -> Option<(u32, LaneMask, f32)> {
        let Stack {
            entries,
            lanes,
            length,
        } = stack;
        let live = self.live();
        let fetches_ahead = structure.node_count() > LARGE;
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let v = unsafe { K::V::new() };
        let t = load_row(v, &self.found.t);
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let t_far = unsafe { K::greatest(t, live) };
        while *length > 0 && !live.is_empty() && self.patience > 0 {
            self.patience -= 1;
            *length -= 1;
            let entry = entries[*length];
            let near_enough = v.ge(t, v.splat(entry.near()));
            let here = lanes[*length] & live & LaneMask::from_bits(near_enough);
            if here.is_empty() {
                continue;
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
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let mut rest = unsafe { K::test_interval(rays, node, t_far, &mut near) };
            if fetches_ahead && rest != 0 {
                fetch(rest, node, structure);
            }
            while rest != 0 {
                let child = rest.trailing_zeros() as usize % WIDTH;
                rest &= rest - 1;
                let mask = rays.test_box(v, node, child, t) & here;
                if mask.is_empty() {
                    continue;
                }
                let entry = Entry::new(node.child(child), near[child]);
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

    /// Takes each ray of `lanes` through an instance of a top level of several; false if a walk has
    /// a question or does not end.
    #[cold]
    fn go_singly(&mut self, walker: &mut Walker, index: u32, lanes: LaneMask) -> bool {
        let mut walk = Walk::OVER;
        for lane in lanes & self.live() {
            // SAFETY: the promise that was made for the rays.
            unsafe { walk.restart(self.rays.top_level[lane], &self.rays.ray(lane)) };
            walk.time = self.rays.time[lane];
            if let Some((facts, structure)) = self.place(lane, &walker.top) {
                (walk.hit, walk.has_hit) = (self.found.hit(lane, &structure, &facts), true);
            }
            let before = (walk.has_hit, walk.hit);
            (walk.state, walk.instance) = (WalkState::OutOfFuel, index);
            walk.pending.push(Entry::ROOT);
            // A corrupt structure may lead in circles: then the walk that starts anew runs out of
            // its fuel.
            let mut fuel = patience(walker).into();
            if walk.resume(walker, Verdict::Continue, &mut fuel) != Event::Done {
                return false;
            }
            if (walk.has_hit, walk.hit) != before {
                self.found.set(lane, &walk.hit, &walker.instance);
            }
        }
        true
    }

    /// Makes the rows of hits those of these rays: from here on there is no way back.
    #[inline(always)]
    fn open(&self, hits: &mut HitRows) {
        if !self.has_asked {
            hits.start(self.rays, self.lanes);
        }
    }

    /// Writes the hits.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn finish<K: PacketKernel>(&self, hits: &mut HitRows, top: &Level) -> Progress {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let v = unsafe { K::V::new() };
        self.open(hits);
        let found = &*self.found;
        let mut rest = found.hit;
        if rest.is_empty() {
            return Progress::Done;
        }
        blend(&mut hits.t, &found.t, rest);
        for (weights, found) in hits.barycentrics.iter_mut().zip(&found.barycentrics) {
            blend(weights, found, rest);
        }
        blend(&mut hits.slot, &found.slots, rest);
        blend(&mut hits.instance_index, &found.instances, rest);
        while !rest.is_empty() {
            let first = rest.first();
            let there = equal(v, &found.instances, found.instances[first]) & rest;
            rest -= there;
            let Some((facts, structure)) = self.place(first, top) else {
                continue;
            };
            hits.set_instance(there, &facts.hit());
            hits.found |= there;
            let mut slot = found.slots[first];
            let (mut geometry, mut primitive) = structure.identity(slot);
            let kinds = [false, true].map(|front| facts.hit_kind(front));
            // Neighbours often hit the same.
            if equal(v, &found.slots, slot) & there == there {
                hits.set_opaque_triangles(there, found.front, geometry, primitive, kinds);
                continue;
            }
            for lane in there {
                if found.slots[lane] != slot {
                    slot = found.slots[lane];
                    (geometry, primitive) = structure.identity(slot);
                }
                let kind = kinds[usize::from(found.front.contains(lane))];
                hits.set_opaque_triangle(lane, geometry, primitive, kind);
            }
        }
        Progress::Done
    }

    /// The instance in which a lane has its hit, and what is there; `None` without a hit.
    fn place(&self, lane: usize, top: &Level) -> Option<(InstanceFacts, Structure)> {
        if !self.found.hit.contains(lane) {
            return None;
        }
        let index = self.found.instances[lane];
        let words = top.structure.instance_words(index)?;
        // SAFETY: the contract of `Walk::new`.
        let structure = unsafe { Structure::at(top.structure.reference(index), top.live()) }?;
        Some((InstanceFacts::new(index, &words, &self.first), structure))
    }
}
