//! Rays of one subgroup in turn. What they have in common is done once.

use lanes::LaneMask;
#[cfg(target_arch = "x86_64")]
use lanes::Tier;

use super::children::LARGE;
use super::entry::Entry;
use super::facts::InstanceFacts;
use super::kernel::Kernel;
use super::level::{Entered, Level, only_instance};
use super::level_rays::WorldRays;
use super::meter::{Meter, Unmetered};
use super::opaque::{End, Nearest, Opaque, Pending};
use super::options::Specialisation;
use super::portable::PortableKernel;
use super::rows::{HitRows, RayRows};
use super::{Event, PACKET, Verdict, Walk, WalkState, Walker, run};
use crate::layout::{InstanceRecord, instance_state};
use crate::ray::{Ray, ray_flags};
use crate::structure::Kind;

/// Fewer rays are set up one by one for less.
const ENOUGH: u32 = 4;

/// Takes over a walk that stopped at an event, by changing places with it: `(lane, walk, event)`.
pub(crate) type Suspend<'a> = dyn FnMut(usize, &mut Walk, Event) + 'a;

impl Walker {
    /// Walks the rays of `lanes` to their ends, one after the other, and writes their hits to
    /// `hits`. Those about which something has to be decided outside, or that run out of fuel, are
    /// handed to `suspend` instead, which may change places with the walk to keep it.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    pub(crate) unsafe fn trace_in_turn(
        &mut self,
        rays: &RayRows,
        lanes: LaneMask,
        hits: &mut HitRows,
        fuel: &mut u64,
        suspend: &mut Suspend<'_>,
    ) {
        hits.start(rays, lanes);
        let mut turns = Turns {
            rays,
            lanes,
            hits,
            walk: Walk::OVER,
            suspend,
            meters: &mut [const { Unmetered }; PACKET],
        };
        match self.options.tier {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a walker has this tier only on machines that have the instruction set.
            Tier::Avx512 => unsafe { run_avx512(&mut turns, self, fuel) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a walker has this tier only on machines that have the instruction set.
            Tier::Avx2 => unsafe { run_avx2(&mut turns, self, fuel) },
            // SAFETY: every machine has plain Rust.
            _ => unsafe { turns.run::<PortableKernel>(self, fuel) },
        }
    }

    /// The same, with the visits of each ray told to its meter.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    pub(crate) unsafe fn meter_in_turn<M: Meter>(
        &mut self,
        rays: &RayRows,
        lanes: LaneMask,
        hits: &mut HitRows,
        fuel: &mut u64,
        meters: &mut [M; PACKET],
        suspend: &mut Suspend<'_>,
    ) {
        hits.start(rays, lanes);
        let mut turns = Turns {
            rays,
            lanes,
            hits,
            walk: Walk::OVER,
            suspend,
            meters,
        };
        match self.options.tier {
            // One kernel for both: reports are no reason for more code.
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a walker has these tiers only on machines that have AVX2.
            Tier::Avx512 | Tier::Avx2 => unsafe { run_avx2(&mut turns, self, fuel) },
            // SAFETY: every machine has plain Rust.
            _ => unsafe { turns.run::<PortableKernel>(self, fuel) },
        }
    }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn run_avx512(turns: &mut Turns<'_, '_, Unmetered>, walker: &mut Walker, fuel: &mut u64) {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { turns.run::<super::avx::Avx<true>>(walker, fuel) }
}

/// # Safety
/// The machine has these features.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn run_avx2<M: Meter>(turns: &mut Turns<'_, '_, M>, walker: &mut Walker, fuel: &mut u64) {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { turns.run::<super::avx::Avx<false>>(walker, fuel) }
}

/// Rays to be traced in turn.
struct Turns<'a, 's, M> {
    rays: &'a RayRows,
    lanes: LaneMask,
    hits: &'a mut HitRows,
    /// The walk of the lane at hand.
    walk: Walk,
    suspend: &'a mut Suspend<'s>,
    meters: &'a mut [M; PACKET],
}

impl<M: Meter> Turns<'_, '_, M> {
    /// # Safety
    /// The machine has the kernel's instruction set; the contract of [`Walk::new`].
    #[inline(always)]
    unsafe fn run<K: Kernel>(&mut self, walker: &mut Walker, fuel: &mut u64) {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set, and
        // keeps the contract of `Walk::new`.
        let done = unsafe { self.run_opaque::<K>(walker, fuel) };
        let mut entered = Entered::NOTHING;
        for lane in self.lanes - done {
            self.start(lane);
            let walk = &mut self.walk;
            let verdict = Verdict::Continue;
            let event = if M::COUNTS {
                let meter = &mut self.meters[lane];
                run::run_metered(walk, verdict, walker, &mut entered, fuel, meter)
            } else {
                // SAFETY: the caller guarantees that the machine has the kernel's instruction set,
                // and keeps the contract of `Walk::new`.
                unsafe { run::run_with::<K>(walk, verdict, walker, &mut entered, fuel) }
            };
            if event != Event::Done {
                (self.suspend)(lane, walk, event);
            } else if let Some(hit) = walk.committed() {
                self.hits.set(lane, hit);
            }
        }
    }

    /// The walk of a lane, which has not started.
    #[inline(always)]
    fn start(&mut self, lane: usize) {
        // SAFETY: the promise that was made for the rays.
        unsafe { (self.walk).restart(self.rays.top_level[lane], &self.rays.ray(lane)) };
        self.walk.time = self.rays.time[lane];
    }

    /// Traces those rays to their ends that have a top level whose only instance holds triangles
    /// that all count. Returns which those are.
    ///
    /// # Safety
    /// The machine has the kernel's instruction set; the contract of [`Walk::new`].
    #[inline(always)]
    unsafe fn run_opaque<K: Kernel>(&mut self, walker: &mut Walker, fuel: &mut u64) -> LaneMask {
        let without = walker.without();
        let by_itself = self.lanes.count() < ENOUGH
            || without.contains(Specialisation::OneInstance)
            || without.contains(Specialisation::Opaque);
        if by_itself {
            return LaneMask::NONE;
        }
        let Walker {
            stack,
            top,
            bottom,
            instance,
            hits: found,
            level_rays,
            ..
        } = walker;
        let rays = self.rays;
        let first = self.lanes.first();
        let (address, ray) = (rays.top_level[first], rays.ray(first));
        // SAFETY: the contract of `Walk::new`.
        let only = unsafe { enter_only_opaque(address, &ray, top, bottom, instance) };
        let Some((index, record)) = only else {
            return LaneMask::NONE;
        };
        let alike = rays.alike(first, self.lanes);
        let sound = level_rays.set_up(&WorldRays::new(rays, alike), &record);
        let fetches_ahead =
            bottom.structure.node_count() > LARGE && !without.contains(Specialisation::Prefetch);
        let any = ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
        for lane in sound {
            let way = Opaque {
                structure: &bottom.structure,
                instance,
                level_rays,
                lane,
                committed: None,
                fetches_ahead,
            };
            stack[0] = Entry::ROOT;
            let mut pending = Pending {
                stack,
                floor: 0,
                length: 1,
            };
            let mut best = Nearest::none_in(rays.t_min[lane], rays.t_max[lane]);
            let (near, rest, meter) = (&mut best, &mut pending, &mut self.meters[lane]);
            // SAFETY: the caller guarantees that the machine has the kernel's instruction set, and
            // keeps the contract of `Walk::new`.
            let end = unsafe {
                match (M::COUNTS, any) {
                    (true, true) => {
                        K::walk_opaque_metered::<M, true>(&way, near, rest, found, fuel, meter)
                    }
                    (true, false) => {
                        K::walk_opaque_metered::<M, false>(&way, near, rest, found, fuel, meter)
                    }
                    (false, true) => K::walk_opaque::<true>(&way, near, rest, found, fuel),
                    (false, false) => K::walk_opaque::<false>(&way, near, rest, found, fuel),
                }
            };
            let hit = way.hit(&best);
            if end != End::OutOfFuel {
                if let Some(hit) = hit {
                    self.hits.set(lane, &hit);
                }
                continue;
            }
            let length = pending.length;
            self.start(lane);
            let walk = &mut self.walk;
            if let Some(hit) = hit {
                (walk.hit, walk.has_hit) = (hit, true);
            }
            (walk.state, walk.instance) = (WalkState::OutOfFuel, index);
            walk.pending.extend_from_slice(&stack[..length]);
            (self.suspend)(lane, walk, Event::OutOfFuel);
        }
        sound
    }
}

/// Enters the only instance of a top level, with its index and record, if it holds triangles that
/// all count.
///
/// # Safety
/// The contract of [`Walk::new`] for the ray.
#[inline(always)]
unsafe fn enter_only_opaque(
    address: u64,
    ray: &Ray,
    top: &mut Level,
    bottom: &mut Level,
    instance: &mut InstanceFacts,
) -> Option<(u32, InstanceRecord)> {
    // SAFETY: the caller keeps the contract of `Walk::new` for the ray.
    let index = unsafe { top.enter_top(address) }
        .then(|| only_instance(top))
        .flatten()?;
    // SAFETY: the caller keeps the contract of `Walk::new` for the ray.
    if !unsafe { bottom.admit(instance, top, index, ray) } {
        return None;
    }
    let record = top.structure.instance(index)?;
    let fits = instance.all_opaque
        && bottom.structure.kind() == Kind::Triangles
        && record.words.state & instance_state::MOVING == 0;
    fits.then_some((index, record))
}
