//! Rays of one group through boxes, from candidate to candidate.
//!
//! Each ray is walked as it is alone, so it has the same candidates in the same order. The rays in
//! an instance are set up once for all their candidates there ([`Slabs`](super::slabs::Slabs)), and
//! the structure is looked up once for all rays that go on.

use lanes::LaneMask;
#[cfg(target_arch = "x86_64")]
use lanes::Tier;

use super::children::{LARGE, fetch};
use super::entry::{Entry, STACK};
use super::facts::InstanceFacts;
use super::kernel::Kernel;
use super::level::only_instance;
use super::level_rays::WorldRays;
use super::options::Specialisation;
use super::portable::PortableKernel;
use super::rows::{HitRows, RayRows};
use super::slabs::Common;
use super::suspended::{Decided, Suspended};
use super::{Event, WalkState, Walker};
use crate::layout::{InstanceRecord, WIDTH, child, geometry_word, instance_state};
use crate::ray::{Hit, Ray, ray_flags};
use crate::structure::{Kind, Structure};

/// Rays that stand in one instance of several: fewer are set up one by one for less.
const ENOUGH: u32 = 3;

/// Rays of which it is found out first which meet any box: fewer walk for less.
const MANY: u32 = 6;

impl Walker {
    /// Walks rays to candidates or to their ends that have a top level whose only instance holds
    /// boxes. Returns which those are.
    ///
    /// # Safety
    /// As for [`Walk::new`](super::Walk::new), for every ray.
    pub(crate) unsafe fn start_in_boxes(
        &mut self,
        rays: &RayRows,
        lanes: LaneMask,
        hits: &mut HitRows,
        suspended: &mut Suspended,
        fuel: &mut u64,
    ) -> LaneMask {
        if lanes.is_empty() {
            return LaneMask::NONE;
        }
        let first = lanes.first();
        let (address, ray) = (rays.top_level[first], rays.ray(first));
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
        let Some(index) = (unsafe { self.enter_boxes(address, &ray) }) else {
            return LaneMask::NONE;
        };
        let Some(record) = self.top.structure.instance(index) else {
            return LaneMask::NONE;
        };
        let common = Common::new(address, &ray, index);
        let task = ResumedRays {
            decided: Decided::going_on(rays.alike(first, lanes)),
            set_up: Some((rays, &record, common)),
            starts: true,
        };
        // There is no other instance.
        self.go_on_in_boxes(&task, hits, suspended, fuel).walked
    }

    /// Goes on with rays of a group after decisions about them, as far as they stand at boxes of
    /// one instance and stay there. Returns the rays that are left, with the decisions that remain.
    pub(crate) fn resume_in_boxes(
        &mut self,
        mut decided: Decided,
        hits: &mut HitRows,
        suspended: &mut Suspended,
        fuel: &mut u64,
    ) -> Decided {
        let mut rest = decided.lanes;
        while !rest.is_empty() {
            let (lanes, common) = suspended.in_same_instance(rest);
            rest -= lanes;
            let ray = *suspended.walk(lanes.first()).ray();
            let is_set_up = suspended.slabs.holds(lanes, &common);
            if !is_set_up && lanes.count() < ENOUGH {
                continue;
            }
            // SAFETY: the promise that was made for the rays.
            let is_there = unsafe { self.top.enter_top(common.top_level) }
                && unsafe { self.enter_boxes_of(common.instance, &ray) };
            if !is_there {
                continue;
            }
            let (mut rows, mut record) = (None, None);
            if !is_set_up {
                rows = Some(suspended.rays(lanes));
                record = self.top.structure.instance(common.instance);
                if record.is_none() {
                    continue;
                }
            }
            let set_up =
                (rows.as_ref().zip(record.as_ref())).map(|(rays, record)| (rays, record, common));
            let task = ResumedRays {
                decided: Decided { lanes, ..decided },
                set_up,
                starts: false,
            };
            let Gone { walked, through } = self.go_on_in_boxes(&task, hits, suspended, fuel);
            // Decisions about rays that are through have been applied.
            decided.lanes -= walked - through;
            decided.accepted -= through;
            decided.ended -= through;
        }
        decided
    }

    /// Enters the only instance of a top level if it has only boxes, without motion.
    ///
    /// # Safety
    /// As for [`Walk::new`](super::Walk::new).
    pub(crate) unsafe fn enter_boxes(&mut self, address: u64, ray: &Ray) -> Option<u32> {
        if self.without().contains(Specialisation::OneInstance) {
            return None;
        }
        // SAFETY: the caller keeps the contract of `Walk::new`.
        if !unsafe { self.top.enter_top(address) } {
            return None;
        }
        let index = only_instance(&self.top)?;
        // SAFETY: the caller keeps the contract of `Walk::new`.
        unsafe { self.enter_boxes_of(index, ray) }.then_some(index)
    }

    /// Enters an instance of the top level that was entered, if a ray meets nothing but boxes
    /// there, and they do not move.
    ///
    /// # Safety
    /// As for [`Walk::new`](super::Walk::new).
    unsafe fn enter_boxes_of(&mut self, index: u32, ray: &Ray) -> bool {
        let Walker {
            top,
            bottom,
            instance,
            ..
        } = self;
        // SAFETY: the caller keeps the contract of `Walk::new`.
        let is_admitted = unsafe { bottom.admit(instance, top, index, ray) };
        let words = top.structure.instance_words(index);
        let moves = words.is_none_or(|words| words.state & instance_state::MOVING != 0);
        is_admitted && bottom.structure.kind() == Kind::Aabbs && !moves
    }

    /// Walks rays on in the bottom level that was entered.
    fn go_on_in_boxes(
        &mut self,
        task: &ResumedRays<'_>,
        hits: &mut HitRows,
        suspended: &mut Suspended,
        fuel: &mut u64,
    ) -> Gone {
        match self.options.tier {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a walker has this tier only on machines that have the instruction set.
            Tier::Avx512 => unsafe { go_avx512(self, task, hits, suspended, fuel) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a walker has this tier only on machines that have the instruction set.
            Tier::Avx2 => unsafe { go_avx2(self, task, hits, suspended, fuel) },
            // SAFETY: every machine has plain Rust.
            _ => unsafe { go::<PortableKernel>(self, task, hits, suspended, fuel) },
        }
    }
}

/// Rays to be walked on in the bottom level that was entered.
struct ResumedRays<'a> {
    decided: Decided,
    /// The rays and the instance, if they are not set up there.
    set_up: Option<(&'a RayRows, &'a InstanceRecord, Common)>,
    /// They start.
    starts: bool,
}

/// How far rays have come.
struct Gone {
    /// Those that could be set up, and were walked on.
    walked: LaneMask,
    /// Of those, the ones that are through with the bottom level, but not with the top level.
    through: LaneMask,
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn go_avx512(
    walker: &mut Walker,
    task: &ResumedRays<'_>,
    hits: &mut HitRows,
    suspended: &mut Suspended,
    fuel: &mut u64,
) -> Gone {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { go::<super::avx::Avx<true>>(walker, task, hits, suspended, fuel) }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn go_avx2(
    walker: &mut Walker,
    task: &ResumedRays<'_>,
    hits: &mut HitRows,
    suspended: &mut Suspended,
    fuel: &mut u64,
) -> Gone {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { go::<super::avx::Avx<false>>(walker, task, hits, suspended, fuel) }
}

/// [`Walker::go_on_in_boxes`] with a kernel.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn go<K: Kernel>(
    walker: &mut Walker,
    task: &ResumedRays<'_>,
    hits: &mut HitRows,
    suspended: &mut Suspended,
    fuel: &mut u64,
) -> Gone {
    let prefetches = !walker.without().contains(Specialisation::Prefetch);
    let Walker {
        stack,
        bottom,
        instance,
        level_rays,
        ..
    } = walker;
    let ResumedRays {
        decided, starts, ..
    } = task;
    if let Some((rays, record, common)) = &task.set_up {
        let world_rays = WorldRays::new(rays, decided.lanes);
        suspended
            .slabs
            .set_up(level_rays, &world_rays, record, *common);
    }
    let walked = decided.lanes & suspended.slabs.lanes;
    let way = BoxLevel {
        structure: &bottom.structure,
        instance,
        fetches_ahead: prefetches && bottom.structure.node_count() > LARGE,
    };
    let any = suspended.slabs.common.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
    let (mut left, mut through) = (*fuel, LaneMask::NONE);
    let mut lanes = walked;
    if let (true, Some((rays, ..))) = (*starts, &task.set_up) {
        hits.start(rays, lanes);
        if any && lanes.count() >= MANY {
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
            lanes =
                unsafe { way.hits_any_box::<K>(&suspended.slabs, lanes, &rays.t_max, &mut left) };
        }
        for lane in lanes {
            let walk = suspended.room(lane);
            // SAFETY: the promise that was made for the rays.
            unsafe { walk.restart(rays.top_level[lane], &rays.ray(lane)) };
            walk.time = rays.time[lane];
            walk.pending.push(Entry::ROOT);
        }
    }
    for lane in lanes {
        let (walk, slabs) = suspended.walk_in_boxes(lane);
        if walk.is_over(decided.verdict(lane)) {
            suspended.finish(lane, hits);
            continue;
        }
        let mut length = walk.pending.len().min(STACK - WIDTH);
        stack[..length].copy_from_slice(&walk.pending[..length]);
        let (t_far, floor) = (walk.hit.t, (walk.floor as usize).min(length));
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let (event, candidate) = unsafe {
            let box_ray = K::load_slabs(slabs, lane, t_far);
            match any {
                true => {
                    way.next::<K, true>(&box_ray, t_far, stack, (floor, &mut length), &mut left)
                }
                false => {
                    way.next::<K, false>(&box_ray, t_far, stack, (floor, &mut length), &mut left)
                }
            }
        };
        if event == Event::Done {
            // Entries of the top level that are beyond the ray's end are dropped.
            while length > 0 && !any && walk.is_beyond(stack[length - 1]) {
                length -= 1;
            }
            if length == 0 {
                suspended.finish(lane, hits);
                continue;
            }
            walk.go_up(&stack[..length]);
            through.insert(lane);
            continue;
        }
        walk.pending.clear();
        walk.pending.extend_from_slice(&stack[..length]);
        (walk.instance, walk.floor, walk.leaf) = (instance.index, floor as u32, None);
        walk.state = WalkState::after(event);
        walk.candidate = Hit {
            t: walk.ray.t_min,
            ..candidate
        };
        suspended.stop_in_boxes(lane, event);
    }
    *fuel = left;
    Gone { walked, through }
}

/// A bottom level of boxes.
pub(super) struct BoxLevel<'a> {
    pub structure: &'a Structure,
    instance: &'a InstanceFacts,
    fetches_ahead: bool,
}

impl BoxLevel<'_> {
    /// Goes on with the entries on the stack from `floor` on, up to the next candidate, the end, or
    /// the end of fuel.
    /// Of the candidate, all is known but `t`. `ANY`: as for [`super::descend::run`].
    ///
    /// # Safety
    /// The machine has the kernel's instruction set.
    #[inline(always)]
    unsafe fn next<K: Kernel, const ANY: bool>(
        &self,
        box_ray: &K::BoxRay,
        t_far: f32,
        stack: &mut [Entry; STACK],
        (floor, length): (usize, &mut usize),
        left: &mut u64,
    ) -> (Event, Hit) {
        let node_count = self.structure.node_count();
        'next: while *length > floor {
            *length -= 1;
            // SAFETY: `length` is below `STACK` wherever an entry is pushed.
            let entry = unsafe { *stack.get_unchecked(*length) };
            if !ANY && entry.near() > t_far {
                continue;
            }
            let mut word = entry.word();
            loop {
                if *left == 0 {
                    stack[*length] = Entry::new(word, 0.0);
                    *length += 1;
                    return (Event::OutOfFuel, Hit::NONE);
                }
                *left -= 1;
                // Words of leaves are above every index of a node.
                if word >= node_count {
                    break;
                }
                // SAFETY: below the count.
                let node = unsafe { self.structure.node_at(word) };
                if *length > STACK - WIDTH {
                    // Deeper than any structure that was built: corrupt.
                    continue 'next;
                }
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
                let (mask, near) = unsafe { K::intersect_node::<true>(box_ray, node) };
                if mask == 0 {
                    continue 'next;
                }
                if self.fetches_ahead && mask & (mask - 1) != 0 {
                    fetch(mask, node, self.structure);
                }
                // SAFETY: there is room for all children; the caller guarantees that the machine
                // has the kernel's instruction set.
                unsafe {
                    let place = stack.as_mut_ptr().add(*length);
                    let pushed;
                    (word, pushed) = K::push::<ANY>(near, mask, node, place);
                    *length += pushed;
                }
            }
            if word & child::LEAF == 0 || word == child::NONE {
                continue;
            }
            if let Some(hit) = self.candidate(word) {
                return (Event::ProceduralCandidate, hit);
            }
        }
        (Event::Done, Hit::NONE)
    }

    /// The box of a leaf as a candidate, if it is one.
    #[inline(always)]
    pub fn candidate(&self, word: u32) -> Option<Hit> {
        let entry = self.structure.box_entry(word & child::INDEX)?;
        Some(Hit {
            geometry_index: entry.geometry & geometry_word::INDEX,
            primitive_index: entry.primitive,
            opaque: self.instance.opacity(entry.geometry)?,
            ..self.instance.hit()
        })
    }
}
