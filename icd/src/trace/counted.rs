//! Counts of each invocation of a batch, where a capture keeps them. Nothing here runs otherwise.

use std::time::Instant;

use lanes::LaneMask;
use traversal::{GroupWalks, PACKET, RayCost, RayCosts, RayRows};

use super::batch::Batch;
use super::line::{InPlace, Nested};
use super::rays::{load_rays, structures_in};
use super::subgroup::{Role, SubgroupIndex};
use crate::wave::Stopped;
use crate::wave::launch_counts::{Cells, Counter, LaunchCounts, WalkedRay};
use crate::wave::queries::Counted;

/// Groups of rays that walk by themselves between two looks at the limits.
const GROUPS_BETWEEN_LOOKS: usize = 16;

impl<'a> Batch<'a> {
    /// When something begins whose time counts.
    pub(super) fn start_clock(&self) -> Option<Instant> {
        self.counting.as_ref().map(|_| Instant::now())
    }

    fn launch_counts(&self) -> Option<&'a LaunchCounts> {
        self.counting.as_ref().map(|counting| counting.counts)
    }

    /// The counts, and where the lanes of a subgroup are among them.
    pub(super) fn counted(&self, index: SubgroupIndex) -> Option<Counted<'a>> {
        let counts = self.launch_counts()?;
        Some(Counted {
            counts,
            cells: self.cells(counts, index),
        })
    }

    fn cells(&self, counts: &LaunchCounts, index: SubgroupIndex) -> Cells {
        let launch = &self.worker.subgroups[index].launch;
        counts.cells(&launch.x, &launch.y, self.layer)
    }

    /// Counts rays of groups that start, and walks each by itself: that is its first walk and the
    /// one that is counted. Groups with rays that are not over then, and those that a line has put
    /// off, stay in the list.
    ///
    /// # Errors
    /// A limit was reached.
    #[cold]
    pub(super) fn walk_alone(&mut self, groups: &mut Vec<u32>) -> Result<(), Stopped> {
        let Some(counts) = self.launch_counts() else {
            return Ok(());
        };
        let walker = self.worker.walker.take();
        let mut walker = walker.expect("it is there between traces");
        // SAFETY: the memory is there until the dispatch is complete, and no walk goes on after it.
        let mut costs = unsafe { RayCosts::new(&mut walker, &self.dispatch.limits.live) };
        let (mut kept, mut walked) = (0, Ok(()));
        for at in 0..groups.len() {
            let index = groups[at];
            if at % GROUPS_BETWEEN_LOOKS == 0 {
                walked = self.out_of_fuel(index);
            }
            if walked.is_ok() && self.walk_group_alone(index, counts, &mut costs) {
                walked = self.end_walks(index);
            } else {
                groups[kept] = index;
                kept += 1;
            }
            if walked.is_err() {
                break;
            }
        }
        groups.truncate(kept);
        self.worker.walker = Some(walker);
        walked
    }

    /// The same for one group. Returns whether all its rays are over.
    fn walk_group_alone(
        &mut self,
        index: u32,
        counts: &LaunchCounts,
        costs: &mut RayCosts<'_>,
    ) -> bool {
        let group = &self.worker.ray_groups[index];
        if group.walked_alone.is_some() {
            return false;
        }
        let (tier, lanes) = (self.dispatch.tier, group.in_flight);
        let operands = group.operands(&self.worker.subgroups);
        counts.note_structures(structures_in(operands, lanes));
        let cells = self.cells(counts, group.caller);
        let is_kept = LaneMask::from_fn(|lane| cells[lane].is_some()) & lanes;
        if is_kept.is_empty() {
            return false;
        }
        let mut rays = RayRows::NONE;
        load_rays(tier, group, operands, self.dispatch, &mut rays);
        let caller = &self.worker.subgroups[group.caller];
        let depth = |lane: usize| 1 + self.depth(caller.role, caller.of[lane]);
        counts.start_rays(&cells, is_kept, &rays, depth);
        let group = &mut self.worker.ray_groups[index];
        let mut found = [RayCost::default(); PACKET];
        let started = Instant::now();
        // SAFETY: the application keeps the structures that a trace may reach built and bound until
        // the dispatch is complete, as for other walks of the batch.
        let over = unsafe { costs.walk_to_ends(&rays, is_kept, &mut group.group_walk, &mut found) };
        // With fewer rays, those that meet candidates and end at their first hit may find another.
        let is_over = over == is_kept;
        if is_over {
            counts.add_walks(started.elapsed(), &cells, over, &found);
        }
        group.walked_alone = Some(if is_over { over } else { LaneMask::NONE });
        is_over && over == lanes
    }

    /// The walks of a group are over; those that were not counted are counted behind those of the
    /// others.
    #[cold]
    pub(super) fn note_walks(&mut self, index: u32) {
        let Some(mut counting) = self.counting.take() else {
            return;
        };
        let group = &self.worker.ray_groups[index];
        let lanes = group.in_flight - group.walked_alone.unwrap_or_default();
        if !group.is_recorded() && !lanes.is_empty() {
            let cells = self.cells(counting.counts, group.caller);
            let operands = group.operands(&self.worker.subgroups);
            let rays = group.rays(operands, self.dispatch);
            for lane in lanes {
                if let Some(cell) = cells[lane] {
                    counting.walked.push(WalkedRay {
                        cell,
                        structure: rays.top_level[lane],
                        ray: rays.ray(lane),
                        time: rays.time[lane],
                        hit: group.group_walk.hits.get(lane),
                    });
                }
            }
        }
        self.counting = Some(counting);
    }

    /// Counts the walks that are over. Their time is shared by their steps.
    #[inline(always)]
    pub(super) fn count_walks(&mut self, started: Option<Instant>) -> Result<(), Stopped> {
        match started {
            Some(started) => self.count_walks_since(started),
            None => Ok(()),
        }
    }

    #[cold]
    fn count_walks_since(&mut self, started: Instant) -> Result<(), Stopped> {
        let Some(counting) = &mut self.counting else {
            return Ok(());
        };
        let time = started.elapsed();
        let walker = self.worker.walker.as_mut().expect("no rays are traced now");
        counting.count_walks(time, walker, self.dispatch.limits)
    }

    /// A wave has run: its lanes share the time.
    #[inline(always)]
    pub(super) fn count_wave(&self, started: Option<Instant>, wave: &[SubgroupIndex]) {
        if let Some(started) = started {
            self.count_wave_since(started, wave);
        }
    }

    #[cold]
    fn count_wave_since(&self, started: Instant, wave: &[SubgroupIndex]) {
        let Some(counting) = &self.counting else {
            return;
        };
        let (time, counts) = (started.elapsed(), counting.counts);
        let lanes = |&index: &SubgroupIndex| self.worker.subgroups[index].lanes;
        let all = wave.iter().map(|index| lanes(index).count()).sum();
        counts.add_time(time, all, |add| {
            for index in wave {
                add(&self.cells(counts, *index), lanes(index));
            }
        });
    }

    /// Shaders in place have run: their lanes share the time. `calls`: their groups of rays and
    /// lanes.
    #[inline(always)]
    pub(super) fn count_in_place(
        &self,
        started: Option<Instant>,
        calls: impl Iterator<Item = (u32, LaneMask)> + Clone,
    ) {
        if let Some(started) = started {
            self.count_in_place_since(started, calls);
        }
    }

    #[cold]
    fn count_in_place_since(
        &self,
        started: Instant,
        calls: impl Iterator<Item = (u32, LaneMask)> + Clone,
    ) {
        let Some(counting) = &self.counting else {
            return;
        };
        let (time, counts) = (started.elapsed(), counting.counts);
        let all = calls.clone().map(|(_, lanes)| lanes.count()).sum();
        counts.add_time(time, all, |add| {
            for (group, lanes) in calls.clone() {
                add(&self.cells_of_rays(counts, group), lanes);
            }
        });
    }

    /// Callables in place have run, which shaders in place have called.
    #[inline(always)]
    pub(super) fn count_nested(
        &self,
        started: Option<Instant>,
        nested: &[Nested],
        callers: &[InPlace],
    ) {
        if let Some(started) = started {
            self.count_nested_since(started, nested, callers);
        }
    }

    #[cold]
    fn count_nested_since(&self, started: Instant, nested: &[Nested], callers: &[InPlace]) {
        let calls = nested
            .iter()
            .map(|call| (callers[call.caller].group, call.lanes));
        self.count_in_place_since(started, calls.clone());
        let Some(counts) = self.launch_counts() else {
            return;
        };
        for (group, lanes) in calls {
            let cells = self.cells_of_rays(counts, group);
            counts.add_one(Counter::Callables, &cells, lanes);
        }
    }

    fn cells_of_rays(&self, counts: &LaunchCounts, group: u32) -> Cells {
        self.cells(counts, self.worker.ray_groups[group].caller)
    }

    /// Hit and miss shaders begin in place.
    #[inline(always)]
    pub(super) fn count_calls(&self, calls: &[InPlace]) {
        if self.counting.is_some() {
            self.count_each(calls);
        }
    }

    #[cold]
    fn count_each(&self, calls: &[InPlace]) {
        let Some(counts) = self.launch_counts() else {
            return;
        };
        for call in calls {
            if let Some(counter) = counter_of(call.role) {
                counts.add_one(counter, &self.cells_of_rays(counts, call.group), call.lanes);
            }
        }
    }

    /// A called subgroup begins.
    #[cold]
    pub(super) fn count_call(&self, index: SubgroupIndex) {
        let subgroup = &self.worker.subgroups[index];
        if let Some(counts) = self.launch_counts()
            && let Some(counter) = counter_of(subgroup.role)
        {
            counts.add_one(counter, &self.cells(counts, index), subgroup.lanes);
        }
    }
}

/// The count of invocations of a shader.
fn counter_of(role: Role) -> Option<Counter> {
    Some(match role {
        Role::RayGeneration => return None,
        Role::AnyHit | Role::AnyHitOfReport => Counter::AnyHitShaders,
        Role::Intersection => Counter::IntersectionShaders,
        Role::ClosestHit => Counter::ClosestHits,
        Role::Miss => Counter::Misses,
        Role::Callable => Counter::Callables,
    })
}
