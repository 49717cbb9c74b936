//! Sixteen rays at once, while they visit the same nodes, as rays of one picture tile do.
//!
//! Each lane performs the operations of a single walk in the same order, and the hit does not
//! depend on the order of nodes, so the hits have the same bits. (A ray that ends with its first
//! hit may find another one first.) A first test of all eight children, against the interval of all
//! rays, leaves one or two of them for the test of each ray.
//!
//! In an instance where the rays diverge, each ray is walked alone. Anything unusual ends the
//! attempt, and every walk starts anew. Where a [`Suspended`] keeps them, packets stop for
//! candidates that shaders are to decide on: the next one of each ray in a leaf of triangles, or a
//! box with all rays that meet it. Once they have, what is unusual splits them into single walks.

mod candidates;
mod instances;
mod kernel;
mod plain;
mod portable;
mod rays;
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
use super::level_ray::max;
use super::level_rays::WorldRays;
use super::rows::{HitRows, RayRows, blend};
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
use rays::Rays;
pub(crate) use stack::{PacketSpace, Stack};

/// Fewer rays are not worth it.
const ENOUGH: u32 = 6;

/// Steps after which an attempt is given up, or rays part, if fuel lasts as long: few structures
/// that are not corrupt take so many.
const PATIENCE: u32 = 1 << 16;

/// Directions differ by at most this, relative to the longest component.
const SPREAD: f32 = 0.125;

/// Origins differ by at most this, relative to their distance from the origin of space.
const WIDTH_OF_BEAM: f32 = 1.0 / 64.0;

/// The same for directions and origins of rays that are nearly parallel: to one light far away, for
/// instance.
const SPREAD_OF_PARALLEL: f32 = 1.0 / 256.0;
const WIDTH_OF_PARALLEL: f32 = 1.0 / 4.0;

/// Traces rays together if they cohere: to their ends or, with a [`Suspended`] to keep them, to
/// candidates.
///
/// # Safety
/// The contract of [`Walk::new`], for every ray.
pub(crate) unsafe fn run(
    rays: &RayRows,
    lanes: LaneMask,
    hits: &mut HitRows,
    walker: &mut Walker,
    suspended: Option<&mut Suspended>,
) -> Progress {
    if !may_cohere(rays, lanes) {
        return Progress::Singly;
    }
    match walker.options.tier {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray; a walker has this
        // tier only on machines that have the instruction set.
        Tier::Avx512 => unsafe { wide::Avx512::trace_packet(rays, lanes, hits, walker, suspended) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        Tier::Avx2 => unsafe {
            plain::Avx2Packets::trace_packet(rays, lanes, hits, walker, suspended)
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
    match walker.options.tier {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        Tier::Avx512 => unsafe { wide::Avx512::resume_packet(rays, hits, walker, suspended) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        Tier::Avx2 => unsafe { plain::Avx2Packets::resume_packet(rays, hits, walker, suspended) },
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
    let direction = |lane: usize| rays.direction.map(|row| row[lane]);
    let (from, to) = (direction(first), direction(last));
    let longest = most(&from);
    (0..3).all(|i| (to[i] - from[i]).abs() <= SPREAD * longest)
}

/// Whether rays have structure, flags and mask in common.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn are_alike<K: PacketKernel>(rays: &RayRows, lanes: LaneMask) -> bool {
    let first = lanes.first();
    let (flags, mask) = (rays.flags[first], rays.cull_mask[first]);
    let top_level = rays.top_level[first];
    let mut differences = [0u32; PACKET];
    for i in 0..PACKET {
        let apart = rays.top_level[i] ^ top_level;
        differences[i] = (rays.flags[i] ^ flags)
            | (rays.cull_mask[i] ^ mask)
            | apart as u32
            | (apart >> 32) as u32;
    }
    // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
    (lanes - unsafe { K::equal(&differences, 0) }).is_empty()
}

/// Whether rays start near each other (by the size of their distances from the origin of space),
/// and go the same way.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn cohere<K: PacketKernel>(world_rays: &WorldRays, lanes: LaneMask) -> bool {
    let (o, d) = (&world_rays.origin, &world_rays.direction);
    let longest = most(&[d[0][0], d[1][0], d[2][0]]);
    let farthest = most(&[o[0][0], o[1][0], o[2][0]]);
    let (spread, width) = (SPREAD * longest, WIDTH_OF_BEAM * farthest);
    let (spread_of_parallel, width_of_parallel) =
        (SPREAD_OF_PARALLEL * longest, WIDTH_OF_PARALLEL * farthest);
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
        let close = (turned <= spread) & (moved <= width)
            | (turned <= spread_of_parallel) & (moved <= width_of_parallel);
        near[i] = u32::from(close) & world_rays.sound[i];
    }
    // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
    (lanes - unsafe { K::equal(&near, 1) }).is_empty()
}

/// The longest component.
fn most(v: &[f32; 3]) -> f32 {
    v.iter().fold(0f32, |most, c| most.max(c.abs()))
}

/// # Safety
/// The contract of [`Walk::new`], for every ray; the machine has the instruction set.
#[inline(always)]
unsafe fn trace_packet<K: PacketKernel>(
    rays: &RayRows,
    lanes: LaneMask,
    hits: &mut HitRows,
    walker: &mut Walker,
    suspended: Option<&mut Suspended>,
) -> Progress {
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with the
    // instruction set.
    if !unsafe { are_alike::<K>(rays, lanes) } {
        return Progress::Singly;
    }
    let world_rays = WorldRays::new(rays, lanes);
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with the
    // instruction set.
    if !unsafe { cohere::<K>(&world_rays, lanes) } {
        return Progress::Singly;
    }
    let first = lanes.first();
    // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with the
    // instruction set.
    if !unsafe { walker.top.enter_top(rays.top_level[first]) } {
        return Progress::Singly;
    }
    let structure = walker.top.structure;
    if structure.kind() != Kind::Instances {
        return Progress::Singly;
    }
    let first = rays.ray(first);
    let mut packet = Packet {
        lanes,
        any: first.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0,
        patience: patience(walker),
        found: Found::new(rays),
        world_rays,
        first,
        rays,
        has_asked: false,
        suspended,
    };
    let only = only_instance(&walker.top).map(|index| (index, lanes));
    if only.is_none() {
        let (ways, origin_error) = (&mut walker.packet.ways, structure.origin_error());
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // the instruction set.
        if !unsafe { K::set_up_top(ways, &packet.world_rays, origin_error, lanes) } {
            return Progress::Singly;
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
    let mut packet = Packet {
        lanes: suspended.lanes - suspended.ended,
        any: suspended.any,
        patience: suspended.patience,
        found: suspended.found.clone(),
        world_rays: WorldRays::new(rays, started),
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
        unsafe {
            K::set_up_top(
                &mut walker.packet.ways,
                &packet.world_rays,
                origin_error,
                started,
            )
        };
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

/// Rays on their way.
struct Packet<'a> {
    rays: &'a RayRows,
    /// One of them, for what they have in common.
    first: Ray,
    lanes: LaneMask,
    /// The first hit of a ray ends it.
    any: bool,
    patience: u32,
    found: Found,
    world_rays: WorldRays,
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
        let (t, t_far) = unsafe { (K::load(&self.found.t), K::greatest(&self.found.t, live)) };
        while *length > 0 && !live.is_empty() && self.patience > 0 {
            self.patience -= 1;
            *length -= 1;
            let entry = entries[*length];
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let near_enough = unsafe { K::at_least(t, entry.near()) };
            let here = lanes[*length] & live & near_enough;
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
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                let mask = unsafe { K::test_box(rays, node, child, t) } & here;
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
        self.open(hits);
        let found = &self.found;
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
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            let there = unsafe { K::equal(&found.instances, found.instances[first]) } & rest;
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
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            if unsafe { K::equal(&found.slots, slot) } & there == there {
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
