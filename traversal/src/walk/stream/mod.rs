//! Many rays at once, node by node (Barringer and Akenine-Möller 2014).
//!
//! Rays of one octant make a stream: a list of them enters the root, and each node sorts its list
//! into one for each child. Nothing that is computed for a ray depends on the ray before, so the
//! tests of many overlap; what follows from them is done without branches, sixteen rays at a time.
//! Up to eight streams take turns, node by node, so that the memory of the next node is on its way
//! while others are at theirs. A list that reaches an instance starts separate streams there.
//!
//! Each ray is tested as by itself, with the same operations. The hit does not depend on the order
//! of the walk; and rays that end with their first hit visit children in the same order as by
//! themselves. So the hits are the same bits.
//!
//! Triangles with micromaps are looked up where they are met. Cases that a stream does not handle
//! (candidates, boxes, motion, rays of unusual length, an end of fuel) go to single walks, which
//! restart the ray.

mod instances;
mod leaf;
mod lists;
mod nodes;
mod octant_stacks;
mod rays;
mod waiting;

use super::children::LARGE;
use super::facts::InstanceFacts;
use super::level::only_instance;
use super::level_rays::WorldRays;
use super::opaque::Nearest;
use super::options::Specialisation;
use super::rows::{HitRows, RayRows, Words};
use super::streaming::Caller;
use super::{Event, Walk, Walker};
use crate::layout::instance_state;
use crate::ray::{Hit, Ray, ray_flags};
use crate::structure::{Kind, Structure};
use instances::Top;
use lanes::{LaneMask, Tier};
use leaf::Bottom;
pub(crate) use waiting::Streams;

/// Fewer rays say nothing about others.
const ENOUGH: usize = 256;

/// Times that rays are not added to streams after many of them were in vain.
const PAUSE: u32 = 1 << 13;

impl Walker {
    /// [`Walker::add_to_stream`].
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray, until they are traced; the machine has AVX2.
    pub(super) unsafe fn add(
        &mut self,
        rays: &RayRows,
        lanes: LaneMask,
        hits: &mut HitRows,
        group: u32,
    ) -> LaneMask {
        let first = lanes.first();
        let (address, ray) = (rays.top_level[first], rays.ray(first));
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, until they are
        // traced, and a machine with AVX2.
        if !self.streams.admits(address, &ray) || !unsafe { self.top.enter_top(address) } {
            return LaneMask::NONE;
        }
        let only = only_instance(&self.top);
        let enters = match only {
            // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, until they are
            // traced, and a machine with AVX2.
            Some(index) => unsafe { self.enter_only(index, &ray) },
            None => self.top.structure.kind() == Kind::Instances,
        };
        if !enters {
            return LaneMask::NONE;
        }
        let streams = &mut self.streams;
        (streams.address, streams.ray, streams.only) = (address, ray, only);
        let alike = rays.alike(first, lanes);
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, until they are
        // traced, and a machine with AVX2.
        let taken = unsafe { self.set_up(rays, alike, group) };
        hits.start(rays, taken);
        taken
    }

    /// Sets rays up where they begin; returns those that are sound.
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn set_up(&mut self, rays: &RayRows, lanes: LaneMask, group: u32) -> LaneMask {
        let Walker {
            top,
            level_rays,
            streams,
            ..
        } = self;
        let world_rays = WorldRays::new(rays, lanes);
        let names: Words = std::array::from_fn(|lane| rays::name(group, lane));
        let found = |lane: usize| (Nearest::none_in(rays.t_min[lane], rays.t_max[lane]), 0);
        let t_far = &rays.t_max;
        if let Some(index) = streams.only {
            let Some(record) = top.structure.instance(index) else {
                return LaneMask::NONE;
            };
            let sound = level_rays.set_up(&world_rays, &record);
            let put = |places: &mut _| rays::put(level_rays, t_far, &names, places);
            streams.outer.add(sound, put, found);
            sound
        } else {
            let origin_error = top.structure.origin_error();
            let sound = level_rays.set_up_top(&world_rays, 0.0);
            let put =
                |places: &mut _| rays::put_at_top(level_rays, origin_error, t_far, &names, places);
            streams.outer.add(sound, put, found);
            sound
        }
    }

    /// Enters an instance, if a ray has business there and its triangles all count, or by their
    /// micromaps.
    ///
    /// # Safety
    /// As for [`Walk::new`].
    unsafe fn enter_only(&mut self, index: u32, ray: &Ray) -> bool {
        let Walker {
            top,
            bottom,
            instance,
            ..
        } = self;
        // SAFETY: the caller keeps the contract of `Walk::new`.
        let admits = unsafe { bottom.admit(instance, top, index, ray) };
        admits
            && instance.suits_streams()
            && bottom.structure.kind() == Kind::Triangles
            && (top.structure.instance_words(index))
                .is_some_and(|words| words.state & instance_state::MOVING == 0)
    }

    /// [`Walker::trace_streams`].
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    pub(super) unsafe fn run_streams(&mut self, fuel: &mut u64, caller: &mut dyn Caller) {
        if self.streams.outer.rays.is_empty() {
            return;
        }
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray; rays were added only
        // by a tier that has the instruction set.
        unsafe {
            self.run_outer(fuel);
            self.tell(caller);
        }
        self.trace_singles(fuel, caller);
        self.streams.clear();
    }

    /// Takes the rays to their ends, or as far as streams go.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray; the machine has AVX2.
    unsafe fn run_outer(&mut self, fuel: &mut u64) {
        let (address, ray, only) = (self.streams.address, self.streams.ray, self.streams.only);
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // AVX2.
        let enters = unsafe {
            self.top.enter_top(address) && only.is_none_or(|index| self.enter_only(index, &ray))
        };
        if !enters {
            return;
        }
        let wide = self.options.tier == Tier::Avx512;
        let fetches_ahead = !self.without().contains(Specialisation::Prefetch);
        let Walker {
            stack,
            top,
            bottom,
            instance,
            hits,
            level_rays,
            streams,
            ..
        } = self;
        let Streams {
            outer,
            inner,
            instances,
            ..
        } = streams;
        let any = ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
        if only.is_some() {
            let mut place = Bottom {
                stack,
                bottom,
                instance,
                hits,
                level_rays,
                fetches_ahead: fetches_ahead && bottom.structure.node_count() > LARGE,
            };
            // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine
            // with AVX2.
            unsafe { outer.run(&mut place, any, wide, fuel) };
            return;
        }
        instances.clear();
        instances.resize(outer.rays.len(), 0);
        let mut place = Top {
            stack,
            top,
            bottom,
            instance,
            hits,
            level_rays,
            inner,
            instances,
            ray: &ray,
            fetches_ahead,
        };
        // SAFETY: the caller keeps the contract of `Walk::new`, for every ray, and a machine with
        // AVX2.
        unsafe { outer.run(&mut place, any, wide, fuel) };
    }

    /// Tells what was found, and finds out which rays are not at their ends.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    unsafe fn tell(&mut self, caller: &mut dyn Caller) {
        let Walker { top, streams, .. } = self;
        streams.singles.clear();
        // Neighbours mostly hit the same instance.
        let mut last: Option<(u32, InstanceFacts, Structure)> = None;
        let outer = &streams.outer;
        for (i, (ray, best)) in outer.rays.iter().zip(&outer.best).enumerate() {
            let (group, lane) = ray.lane();
            if ray.goes_singly() {
                match streams.singles.last_mut() {
                    Some((last, lanes)) if *last == group => lanes.insert(lane),
                    _ => streams.singles.push((group, LaneMask::of(lane))),
                }
                continue;
            }
            if best.slot == Hit::UNKNOWN_SLOT {
                continue;
            }
            let index = match streams.only {
                Some(index) => index,
                None => streams.instances[i],
            };
            if last.as_ref().is_none_or(|(known, ..)| *known != index) {
                // SAFETY: the caller keeps the contract of `Walk::new`, for every ray.
                last = (top.structure.instance_words(index)).and_then(|words| unsafe {
                    let structure = Structure::at(top.structure.reference(index), top.live())?;
                    let facts = InstanceFacts::new(index, &words, &streams.ray);
                    Some((index, facts, structure))
                });
            }
            if let Some((_, facts, structure)) = &last {
                caller.hit(group, lane, &best.hit(facts, structure));
            }
        }
    }

    /// Traces rays in turn that streams have left over.
    fn trace_singles(&mut self, fuel: &mut u64, caller: &mut dyn Caller) {
        let singles = std::mem::take(&mut self.streams.singles);
        let mut rows = RayRows::NONE;
        let mut hits = HitRows::default();
        let mut count = 0;
        for &(group, lanes) in &singles {
            caller.rays(group, &mut rows);
            let mut suspend = |lane: usize, walk: &mut Walk, event: Event| {
                caller.suspend(group, lane, walk, event);
            };
            // SAFETY: the promise that was made for the rays.
            unsafe { self.trace_in_turn(&rows, lanes, &mut hits, fuel, &mut suspend) };
            for lane in lanes & hits.found {
                caller.hit(group, lane, &hits.hit(lane));
            }
            count += lanes.count() as usize;
        }
        let streams = &mut self.streams;
        let all = streams.outer.rays.len();
        if all >= ENOUGH && 4 * count > all && *fuel > 0 {
            (streams.unsuited, streams.pause) = (streams.address, PAUSE);
        }
        streams.singles = singles;
    }
}
