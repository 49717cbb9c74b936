//! Counts of each invocation of a batch, where a capture keeps them. Nothing here runs otherwise.

use std::time::Instant;

use super::batch::Batch;
use super::subgroup::{Role, SubgroupIndex};
use crate::wave::Stopped;
use crate::wave::launch_counts::{Cells, Counter, LaunchCounts, WalkedRay};
use crate::wave::queries::Counted;

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
        counts.kept.cells(&launch.x, &launch.y, self.layer)
    }

    /// Rays of a group begin.
    #[cold]
    pub(super) fn count_rays(&self, index: u32) {
        let Some(counts) = self.launch_counts() else {
            return;
        };
        let group = &self.worker.ray_groups[index];
        let caller = &self.worker.subgroups[group.caller];
        let cells = self.cells(counts, group.caller);
        let operands = group.operands(&self.worker.subgroups);
        let rays = group.rays(operands, self.dispatch);
        counts.note_structures(group.in_flight.iter().map(|lane| rays.top_level[lane]));
        for lane in group.in_flight {
            if let Some(cell) = cells[lane] {
                let depth = 1 + self.depth(caller.role, caller.of[lane]);
                counts.start_ray(cell, &rays.ray(lane), depth);
            }
        }
    }

    /// The walks of a group are over; they are counted behind those of the others.
    #[cold]
    pub(super) fn note_walks(&mut self, index: u32) {
        let Some(mut counting) = self.counting.take() else {
            return;
        };
        let group = &self.worker.ray_groups[index];
        if !group.is_recorded() {
            let cells = self.cells(counting.counts, group.caller);
            let operands = group.operands(&self.worker.subgroups);
            let rays = group.rays(operands, self.dispatch);
            for lane in group.in_flight {
                if let Some(cell) = cells[lane] {
                    counting.walked.push(WalkedRay {
                        cell,
                        structure: rays.top_level[lane],
                        ray: rays.ray(lane),
                        time: rays.time[lane],
                        hit: group.flight.hits.get(lane),
                    });
                }
            }
        }
        self.counting = Some(counting);
    }

    /// Counts the walks that are over. Their time is shared by their steps.
    pub(super) fn count_walks(&mut self, started: Option<Instant>) -> Result<(), Stopped> {
        let (Some(counting), Some(started)) = (&mut self.counting, started) else {
            return Ok(());
        };
        let time = started.elapsed();
        let walker = self.worker.walker.as_mut().expect("no rays are traced now");
        counting.count_walks(time, walker, self.dispatch.limits)
    }

    /// A wave has run: its lanes share the time.
    pub(super) fn count_wave(&self, started: Option<Instant>, wave: &[SubgroupIndex]) {
        let (Some(counting), Some(started)) = (&self.counting, started) else {
            return;
        };
        let (time, counts) = (started.elapsed(), counting.counts);
        let lanes = |&index: &SubgroupIndex| self.worker.subgroups[index].lanes;
        let all = wave.iter().map(|index| lanes(index).count()).sum();
        let cells = wave.iter().flat_map(|index| {
            let cells = self.cells(counts, *index);
            lanes(index).iter().filter_map(move |lane| cells[lane])
        });
        counts.add_time(time, cells, all);
    }

    /// A called subgroup begins.
    #[cold]
    pub(super) fn count_call(&self, index: SubgroupIndex) {
        let Some(counts) = self.launch_counts() else {
            return;
        };
        let subgroup = &self.worker.subgroups[index];
        let counter = match subgroup.role {
            Role::RayGeneration => return,
            Role::AnyHit | Role::AnyHitOfReport => Counter::AnyHitShaders,
            Role::Intersection => Counter::IntersectionShaders,
            Role::ClosestHit => Counter::ClosestHits,
            Role::Miss => Counter::Misses,
            Role::Callable => Counter::Callables,
        };
        let cells = self.cells(counts, index);
        for cell in subgroup.lanes.iter().filter_map(|lane| cells[lane]) {
            counts.add(counter, cell, 1);
        }
    }
}
