//! Compute dispatches. Workers take workgroups in order, in chunks, and run their subgroups in
//! waves.
//!
//! ```text
//! dispatch ──> chunks (to whichever worker is free) ──> steps: one workgroup, or a wave of them
//!                                                          └─> waves: subgroups at one point
//! ```
//!
//! Each workgroup of a step has its own memory and waits at barriers alone. Workgroups with memory
//! or barriers that may wait for each other in loops ([`Program::workgroups_may_wait`]) get a step
//! each: in a shared wave, the waiting workgroup would delay the other one until its fuel runs out.
//!
//! The dispatch alone decides which invocations share a subgroup: sixteen consecutive ones by
//! `LocalInvocationIndex`. A subgroup continues with the next workgroups if it would have empty
//! lanes and no invocation can observe the difference. A worker holds one step at a time.
//! Workgroups that may wait for others start in order, so that one may wait for any that started
//! before it.

#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;
use spirv_jit::environment::Environment;
use spirv_jit::program::AlignedRow;
use spirv_jit::{Program, SUBGROUP_SIZE};

use crate::timeline;
use crate::wave::launch_counts::{Cells, LaunchCounts};
use crate::wave::observer::Observer;
use crate::wave::runner::{Runner, SeenSubgroups, Subgroups, has_barriers};
use crate::wave::workgroups::{
    DrawParameters, STEP_SHARED_BYTES, Starter, index_in_quads, workgroup_id,
};
use crate::wave::{Limits, Stopped, StoppedAt, Workers};

/// Largest number of steps that a worker takes at once.
const MAX_CHUNK_STEPS: u64 = 64;

/// Chunks per worker, if all took the same time.
const CHUNKS_PER_WORKER: u64 = 8;

/// Largest number of invocations of workgroups that share subgroups: that of the largest workgroup.
const PACKED_INVOCATIONS: usize = 1024;

/// A dispatch of any `vkCmdDispatch*` command.
pub struct Dispatch<'a> {
    pub program: &'a Program,
    /// The first workgroup's id.
    pub base: [u32; 3],
    /// Workgroups per dimension.
    pub count: [u32; 3],
    pub environment: &'a Environment,
    pub limits: &'a Limits,
    /// The capture, if there is one.
    pub observer: Option<&'a dyn Observer>,
}

/// The workers' memory, reused by the next dispatch.
#[derive(Default)]
pub struct Dispatcher {
    idle: Mutex<Vec<Runner>>,
}

impl Dispatcher {
    /// Executes a dispatch and returns when it is complete. Work for a single worker runs on this
    /// thread. A worker whose step does not fit in the device's budget leaves the work to the
    /// others.
    ///
    /// # Errors
    /// A limit stopped the dispatch. Its writes so far remain.
    pub fn run(&self, workers: &Workers, dispatch: &Dispatch<'_>) -> Result<(), Stopped> {
        let workers_count = workers.current_num_threads();
        let plan = Plan::new(dispatch, workers_count);
        let chunk_steps = plan.chunk_steps(workers_count);
        let chunks = plan.steps.div_ceil(chunk_steps);
        let next_chunk = AtomicU64::new(0);
        let work = || {
            let _span = timeline::work("workgroups");
            let mut runner = self.idle.lock().pop().unwrap_or_default();
            match plan.reserve(&mut runner) {
                Err(Stopped::OutOfMemory) => return Ok(()),
                reserved => reserved?,
            }
            loop {
                let chunk = next_chunk.fetch_add(1, Ordering::Relaxed);
                if chunk >= chunks {
                    break;
                }
                let first = chunk * chunk_steps;
                for step in first..(first + chunk_steps).min(plan.steps) {
                    plan.run_step(&mut runner, step)
                        .inspect_err(|_| next_chunk.store(chunks, Ordering::Relaxed))?;
                }
            }
            runner.rest();
            self.idle.lock().push(runner);
            Ok(())
        };
        workers.share(chunks.min(workers_count as u64) as usize, work)?;
        match next_chunk.into_inner() >= chunks {
            true => Ok(()),
            // The budget had room for no worker.
            false => {
                dispatch.limits.note(|| StoppedAt {
                    place: dispatch.program.place_of(&[]),
                    depth: 0,
                });
                Err(Stopped::OutOfMemory)
            }
        }
    }
}

/// The division of a dispatch into steps and chunks.
struct Plan<'a> {
    dispatch: &'a Dispatch<'a>,
    workgroups: u64,
    /// Invocations of a workgroup.
    invocations: usize,
    starter: Starter,
    /// Workgroups of a step share subgroups: their invocations are consecutive, without gaps.
    packed: bool,
    /// Workgroups that are executed together.
    workgroups_per_step: u64,
    steps: u64,
}

/// An invocation of a dispatch.
struct Invocation {
    /// Linear index, x fastest.
    workgroup: u64,
    /// `LocalInvocationIndex`.
    index: usize,
}

impl<'a> Plan<'a> {
    fn new(dispatch: &'a Dispatch<'a>, workers: usize) -> Self {
        let program = dispatch.program;
        let local_size = program.local_size();
        let invocations = local_size.iter().map(|&n| n as usize).product::<usize>();
        let starter = Starter::new(program);
        let subgroups_per_workgroup = starter.subgroups_per_workgroup;
        let shared_bytes = program.shared_size_bytes() as usize;
        let meets = shared_bytes > 0 || has_barriers(program);
        // This many workgroups fill subgroups without empty lanes.
        let filling = SUBGROUP_SIZE >> invocations.trailing_zeros().min(SUBGROUP_SIZE.ilog2());
        let packed = filling > 1
            && filling * invocations <= PACKED_INVOCATIONS
            && program.workgroups_may_share_subgroups();
        let workgroups = dispatch
            .count
            .iter()
            .fold(1u64, |product, &n| product.saturating_mul(n.into()));
        let wave = program.max_wave_subgroups();
        let in_wave = (wave / subgroups_per_workgroup).max(1);
        let workgroups_per_step = match () {
            () if meets && program.workgroups_may_wait() => 1,
            () if meets => {
                let in_cache = (STEP_SHARED_BYTES / shared_bytes.max(1)).max(1);
                // Enough steps for all workers.
                let of_worker = workgroups.div_ceil(workers as u64).max(1);
                (in_wave.min(in_cache) as u64).min(of_worker)
            }
            // Steps end where subgroups do, so that the step size does not change the subgroups.
            () if packed => {
                ((wave * SUBGROUP_SIZE / (filling * invocations)).max(1) * filling) as u64
            }
            () => in_wave as u64,
        };
        Self {
            dispatch,
            workgroups,
            invocations,
            starter,
            packed,
            workgroups_per_step,
            steps: workgroups.div_ceil(workgroups_per_step),
        }
    }

    /// Steps that a worker takes at once: one where workgroups may wait for others. In a longer
    /// chunk, the workgroup that is waited for could come after the waiting one, and never start.
    fn chunk_steps(&self, workers: usize) -> u64 {
        match self.dispatch.program.workgroups_may_wait() {
            true => 1,
            false => (self.steps / (workers as u64 * CHUNKS_PER_WORKER)).clamp(1, MAX_CHUNK_STEPS),
        }
    }

    /// Workgroup id of a linear index, x fastest.
    fn workgroup_id(&self, index: u64) -> [u32; 3] {
        workgroup_id(index, self.dispatch.base, self.dispatch.count)
    }

    /// The number of subgroups of a step's workgroups.
    fn subgroups(&self, workgroups: usize) -> Subgroups {
        match self.packed {
            true => Subgroups::apart((workgroups * self.invocations).div_ceil(SUBGROUP_SIZE)),
            false => Subgroups::of_workgroups(workgroups, self.starter.subgroups_per_workgroup),
        }
    }

    /// Allocates the memory of the largest step.
    fn reserve(&self, runner: &mut Runner) -> Result<(), Stopped> {
        let workgroups = self.workgroups_per_step.min(self.workgroups) as usize;
        let Dispatch {
            program, limits, ..
        } = self.dispatch;
        runner.reserve(program, self.subgroups(workgroups), limits)
    }

    /// Executes the workgroups of a step.
    fn run_step(&self, runner: &mut Runner, step: u64) -> Result<(), Stopped> {
        let Dispatch {
            program,
            environment,
            limits,
            ..
        } = self.dispatch;
        let first = step * self.workgroups_per_step;
        let last = (first + self.workgroups_per_step).min(self.workgroups);
        let seen = (self.dispatch.observer).map(|observer| self.seen(observer, first, last));
        runner.begin(program, self.subgroups((last - first) as usize), limits)?;
        let mut states = runner.states();
        if self.packed {
            let mut next = Invocation {
                workgroup: first,
                index: 0,
            };
            for state in states {
                self.start_packed(state, &mut next, last);
            }
            return runner.run_seen(program, environment, limits, seen.as_ref());
        }
        for workgroup in first..last {
            let id = self.workgroup_id(workgroup);
            for (subgroup, state) in states
                .by_ref()
                .take(self.starter.subgroups_per_workgroup)
                .enumerate()
            {
                let given = DrawParameters::default();
                self.starter.start(program, state, id, subgroup, &given);
            }
        }
        runner.run_seen(program, environment, limits, seen.as_ref())
    }

    /// The observer's view of a step's workgroups.
    #[cold]
    fn seen(&self, observer: &'a dyn Observer, first: u64, last: u64) -> SeenSubgroups<'a> {
        let one = self.place_of(observer.invocation(), first, last);
        SeenSubgroups {
            one: one.map(|(subgroup, lane)| (subgroup, observer, lane)),
            counted: (observer.counts()).map(|counts| (counts, self.cells(counts, first, last))),
        }
    }

    /// The cells of the invocations of a step's workgroups, by subgroup.
    fn cells(&self, counts: &LaunchCounts, first: u64, last: u64) -> Vec<Cells> {
        let size = self.dispatch.program.local_size();
        let of_workgroup = match self.packed {
            true => self.invocations,
            false => self.starter.subgroups_per_workgroup * SUBGROUP_SIZE,
        };
        let subgroups = self.subgroups((last - first) as usize).count;
        let mut cells = vec![[None; SUBGROUP_SIZE]; subgroups];
        for (place, cell) in cells.as_flattened_mut().iter_mut().enumerate() {
            let workgroup = first + (place / of_workgroup) as u64;
            let index = place % of_workgroup;
            if workgroup >= last || index >= self.invocations {
                continue;
            }
            let index = match self.dispatch.program.quads() {
                true => index_in_quads(index as u32, size[0], size[1]),
                false => index as u32,
            };
            let local = [
                index % size[0],
                index / size[0] % size[1],
                index / (size[0] * size[1]),
            ];
            let id = self.workgroup_id(workgroup);
            let invocation = [0, 1, 2].map(|axis: usize| {
                let before = id[axis].wrapping_mul(size[axis]);
                before.wrapping_add(local[axis])
            });
            *cell = counts.kept.cell(invocation);
        }
        cells
    }

    /// The subgroup and the lane of an invocation, if it is one of a step's workgroups.
    fn place_of(
        &self,
        invocation: Option<[u32; 3]>,
        first: u64,
        last: u64,
    ) -> Option<(usize, usize)> {
        let invocation = invocation?;
        let size = self.dispatch.program.local_size();
        let mut workgroup = 0u64;
        for axis in [2, 1, 0] {
            let id = (invocation[axis] / size[axis]).checked_sub(self.dispatch.base[axis])?;
            if id >= self.dispatch.count[axis] {
                return None;
            }
            workgroup = workgroup * u64::from(self.dispatch.count[axis]) + u64::from(id);
        }
        if !(first..last).contains(&workgroup) {
            return None;
        }
        let [x, y, z] = [0, 1, 2].map(|axis: usize| invocation[axis] % size[axis]);
        let index = (z * size[1] + y) * size[0] + x;
        let place = (0..self.invocations as u32).find(|&place| {
            let placed = match self.dispatch.program.quads() {
                true => index_in_quads(place, size[0], size[1]),
                false => place,
            };
            placed == index
        })? as usize;
        let before = (workgroup - first) as usize;
        Some(match self.packed {
            true => {
                let place = before * self.invocations + place;
                (place / SUBGROUP_SIZE, place % SUBGROUP_SIZE)
            }
            false => (
                before * self.starter.subgroups_per_workgroup + place / SUBGROUP_SIZE,
                place % SUBGROUP_SIZE,
            ),
        })
    }

    /// Starts a subgroup of the next invocations of the workgroups before `last`.
    fn start_packed(&self, state: &mut [AlignedRow], next: &mut Invocation, last: u64) {
        let mut lanes = 0;
        let mut indices = [0; SUBGROUP_SIZE];
        let mut ids = [[0; 3]; SUBGROUP_SIZE];
        let mut id = self.workgroup_id(next.workgroup);
        while lanes < SUBGROUP_SIZE && next.workgroup < last {
            (indices[lanes], ids[lanes]) = (next.index, id);
            lanes += 1;
            next.index += 1;
            if next.index == self.invocations {
                next.index = 0;
                next.workgroup += 1;
                id = self.workgroup_id(next.workgroup);
            }
        }
        let (indices, ids) = (&indices[..lanes], &ids[..lanes]);
        let program = self.dispatch.program;
        self.starter.start_packed(program, state, indices, ids);
    }
}
