//! Compute dispatches: workgroups in order, handed to workers in chunks; in each, subgroups in waves.
//!
//! ```text
//! dispatch ──> chunks (to whichever worker is free) ──> steps: one workgroup, or several that share nothing
//!                                                          └─> waves: subgroups of the step at one resume point
//! ```
//!
//! Which invocations share a subgroup follows from the dispatch alone: sixteen consecutive ones by `LocalInvocationIndex`. Workgroups start
//! in order and a worker holds one step at a time, so that a workgroup may wait for an earlier one.

#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;
use rayon::prelude::*;
use smallvec::SmallVec;
use spirv_jit::environment::Environment;
use spirv_jit::interp::Frame;
use spirv_jit::program::{AlignedRow, Builtin, Event, InputRow, ResumePoint, Row, SiteKind, Wave};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::Walker;

use crate::settings::settings;
use crate::trace::{Owned, Queries};
use crate::wave::{Limits, Stopped};

/// Fuel of a wave between two looks at the limits.
const FUEL: u64 = 1 << 16;

/// Fuel of each subgroup of a wave that ran dry, alone: a subgroup that spins until another one of its wave has gone on sees it go on.
const FUEL_ALONE: u64 = 64;

/// What a wave costs at the least between two looks at the limits, in fuel: one that always yields burns none.
const WAVE_FUEL: u64 = FUEL / 1024;

/// Subgroups of a wave, at most.
const MAX_WAVE: usize = 32;

/// Steps that a worker takes at once, at most.
const MAX_CHUNK_STEPS: u64 = 64;

/// Chunks that each worker would get if all took the same time.
const CHUNKS_PER_WORKER: u64 = 8;

/// One `vkCmdDispatch*`, whatever command it came from.
pub struct Dispatch<'a> {
    pub program: &'a Program,
    /// The first workgroup's id.
    pub base: [u32; 3],
    /// Workgroups per dimension.
    pub count: [u32; 3],
    pub environment: &'a Environment,
    pub limits: &'a Limits,
}

/// The workers' memory, kept from one dispatch to the next.
#[derive(Default)]
pub struct Dispatcher {
    idle: Mutex<Vec<Worker>>,
}

impl Dispatcher {
    /// Executes a dispatch and returns when it is complete. What a single worker would do anyway is done on this thread.
    ///
    /// # Errors
    /// When a limit stopped it; what it wrote so far stays written.
    pub fn run(&self, workers: &rayon::ThreadPool, dispatch: &Dispatch<'_>) -> Result<(), Stopped> {
        let plan = Plan::new(dispatch);
        let workers_count = workers.current_num_threads();
        let chunk_steps =
            (plan.steps / (workers_count as u64 * CHUNKS_PER_WORKER)).clamp(1, MAX_CHUNK_STEPS);
        let chunks = plan.steps.div_ceil(chunk_steps);
        let next_chunk = AtomicU64::new(0);
        let work = || {
            let mut worker = self.idle.lock().pop().unwrap_or_default();
            loop {
                let chunk = next_chunk.fetch_add(1, Ordering::Relaxed);
                if chunk >= chunks {
                    break;
                }
                let first = chunk * chunk_steps;
                for step in first..(first + chunk_steps).min(plan.steps) {
                    worker
                        .run_step(&plan, step)
                        .inspect_err(|_| next_chunk.store(chunks, Ordering::Relaxed))?;
                }
            }
            self.idle.lock().push(worker);
            Ok(())
        };
        match chunks.min(workers_count as u64) as usize {
            0 | 1 => work(),
            tasks => workers.install(|| {
                (0..tasks)
                    .into_par_iter()
                    .with_max_len(1)
                    .try_for_each(|_| work())
            }),
        }
    }
}

/// How a dispatch is cut up.
struct Plan<'a> {
    dispatch: &'a Dispatch<'a>,
    workgroups: u64,
    subgroups_per_workgroup: usize,
    /// Workgroups that are executed together. More than one only where they share nothing that a wave has one of.
    workgroups_per_step: u64,
    steps: u64,
    /// Lanes of a workgroup's last subgroup.
    last_lanes: u16,
    /// Rows of a subgroup's state.
    rows: usize,
    first_input: usize,
    /// What each input row is made of.
    inputs: Vec<Input>,
    /// Input rows of each subgroup of the workgroup with id 0.
    local_rows: Vec<Row>,
}

/// How an input row follows from its workgroup's id: the local row, plus this.
#[derive(Clone, Copy)]
enum Input {
    Local,
    /// A component of the id, times a factor.
    Workgroup {
        component: usize,
        factor: u32,
    },
}

impl<'a> Plan<'a> {
    fn new(dispatch: &'a Dispatch<'a>) -> Self {
        let program = dispatch.program;
        let local_size = program.local_size();
        let invocations = local_size.iter().map(|&n| n as usize).product::<usize>();
        let subgroups_per_workgroup = invocations.div_ceil(SUBGROUP_SIZE).max(1);
        let alone = program.shared_size_bytes() > 0 || program.sites().contains(&SiteKind::Barrier);
        let workgroups_per_step = if alone {
            1
        } else {
            (program.max_wave_subgroups() / subgroups_per_workgroup).max(1) as u64
        };
        let workgroups = dispatch
            .count
            .iter()
            .fold(1u64, |product, &n| product.saturating_mul(n.into()));
        let last = invocations - (subgroups_per_workgroup - 1) * SUBGROUP_SIZE;
        let inputs = program.inputs();
        let local_rows = (0..subgroups_per_workgroup)
            .flat_map(|subgroup| {
                inputs.iter().map(move |&input| {
                    local_row(
                        input,
                        subgroup,
                        subgroups_per_workgroup,
                        local_size,
                        program.quads(),
                    )
                })
            })
            .collect();
        Self {
            dispatch,
            workgroups,
            subgroups_per_workgroup,
            workgroups_per_step,
            steps: workgroups.div_ceil(workgroups_per_step),
            last_lanes: lanes_below(last),
            rows: program.layout().rows,
            first_input: program.layout().inputs,
            inputs: inputs
                .iter()
                .map(|&input| workgroup_input(input, local_size))
                .collect(),
            local_rows,
        }
    }

    /// Workgroup id of a linear index, x fastest.
    fn workgroup_id(&self, index: u64) -> [u32; 3] {
        let [x, y, _] = self.dispatch.count.map(u64::from);
        let [base_x, base_y, base_z] = self.dispatch.base;
        [
            base_x.wrapping_add((index % x) as u32),
            base_y.wrapping_add((index / x % y) as u32),
            base_z.wrapping_add((index / x / y) as u32),
        ]
    }

    /// Puts a subgroup of a workgroup at the program's entry.
    fn start(&self, state: &mut [AlignedRow], workgroup_id: [u32; 3], subgroup: usize) {
        let is_last = subgroup + 1 == self.subgroups_per_workgroup;
        let lanes = if is_last { self.last_lanes } else { u16::MAX };
        self.dispatch.program.start(state, lanes);
        let local = &self.local_rows[subgroup * self.inputs.len()..];
        for ((row, input), local) in state[self.first_input..]
            .iter_mut()
            .zip(&self.inputs)
            .zip(local)
        {
            row.0 = match *input {
                Input::Local => *local,
                Input::Workgroup { component, factor } => {
                    let first = workgroup_id[component].wrapping_mul(factor);
                    local.map(|word| word.wrapping_add(first))
                }
            };
        }
    }
}

fn lanes_below(count: usize) -> u16 {
    ((1u32 << count.min(SUBGROUP_SIZE)) - 1) as u16
}

fn workgroup_input(input: InputRow, local_size: [u32; 3]) -> Input {
    match input {
        InputRow::Builtin(Builtin::WorkgroupId, component) => Input::Workgroup {
            component: component as usize,
            factor: 1,
        },
        InputRow::Builtin(Builtin::GlobalInvocationId, component) => Input::Workgroup {
            component: component as usize,
            factor: local_size[component as usize],
        },
        _ => Input::Local,
    }
}

/// `LocalInvocationIndex` of the `count`th invocation where those of a quad, two by two, follow each other.
fn index_in_quads(count: u32, size_x: u32, size_y: u32) -> u32 {
    let (quad, corner) = (count / 4, count % 4);
    let (quads_x, quads_y) = ((size_x / 2).max(1), (size_y / 2).max(1));
    let x = quad % quads_x * 2 + corner % 2;
    let y = quad / quads_x % quads_y * 2 + corner / 2;
    let z = quad / (quads_x * quads_y);
    (z * size_y + y) * size_x + x
}

/// An input row in the workgroup with id 0.
fn local_row(
    input: InputRow,
    subgroup: usize,
    subgroup_count: usize,
    local_size: [u32; 3],
    quads: bool,
) -> Row {
    let [size_x, size_y, _] = local_size.map(|n| n.max(1));
    std::array::from_fn(|lane| {
        let mut index = (subgroup * SUBGROUP_SIZE + lane) as u32;
        if quads {
            index = index_in_quads(index, size_x, size_y);
        }
        match input {
            InputRow::Builtin(
                Builtin::LocalInvocationId | Builtin::GlobalInvocationId,
                component,
            ) => match component {
                0 => index % size_x,
                1 => index / size_x % size_y,
                _ => index / (size_x * size_y),
            },
            InputRow::Builtin(Builtin::LocalInvocationIndex, _) => index,
            InputRow::Builtin(Builtin::SubgroupId, _) => subgroup as u32,
            InputRow::Builtin(Builtin::NumSubgroups, _) => subgroup_count as u32,
            _ => 0,
        }
    })
}

/// Where a subgroup of the running step stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Status {
    Ready,
    /// Part of the wave that runs.
    InWave,
    AtBarrier,
    Ended,
}

/// A worker's memory: nothing is allocated per workgroup.
#[derive(Default)]
struct Worker {
    frame: Frame,
    /// States of the step's subgroups, one after the other.
    states: Vec<AlignedRow>,
    status: Vec<Status>,
    shared: Vec<AlignedRow>,
    /// Made by the first shader with a ray query.
    walker: Option<Box<Walker>>,
    queries: Queries,
    /// The suspended walks of the step.
    suspended: Owned,
    /// Fuel since the last look at the limits.
    burnt: u64,
}

impl Worker {
    /// Executes workgroups to their end.
    fn run_step(&mut self, plan: &Plan<'_>, step: u64) -> Result<(), Stopped> {
        self.start_step(plan, step)?;
        let mut from = 0;
        loop {
            // Taking turns: a subgroup that spins must not keep the others from running.
            let ready = |index: &usize| self.status[*index] == Status::Ready;
            let next = (from..self.status.len()).chain(0..from).find(ready);
            match next {
                Some(leader) => {
                    self.form_wave(plan, leader);
                    self.run_wave(plan)?;
                    from = leader + 1;
                }
                None if !self.pass_barrier() => return Ok(()),
                None => from = 0,
            }
        }
    }

    fn start_step(&mut self, plan: &Plan<'_>, step: u64) -> Result<(), Stopped> {
        let first = step * plan.workgroups_per_step;
        let last = (first + plan.workgroups_per_step).min(plan.workgroups);
        let subgroups = (last - first) as usize * plan.subgroups_per_workgroup;
        resize(&mut self.states, subgroups * plan.rows)?;
        self.status.clear();
        self.status.resize(subgroups, Status::Ready);
        self.queries.clear();
        self.suspended.clear();
        // Undefined by the specification; zeros, so that even a faulty shader gives the same result twice.
        self.shared.clear();
        let shared_bytes = plan.dispatch.program.shared_size_bytes() as usize;
        resize(
            &mut self.shared,
            shared_bytes.div_ceil(size_of::<AlignedRow>()),
        )?;
        let mut states = self.states.chunks_exact_mut(plan.rows);
        for workgroup in first..last {
            let id = plan.workgroup_id(workgroup);
            for (subgroup, state) in states
                .by_ref()
                .take(plan.subgroups_per_workgroup)
                .enumerate()
            {
                plan.start(state, id, subgroup);
            }
        }
        Ok(())
    }

    /// Takes `leader` and the ready subgroups that stand where it stands.
    fn form_wave(&mut self, plan: &Plan<'_>, leader: usize) {
        let program = plan.dispatch.program;
        let point = self.resume_point(plan, leader);
        let room = program.max_wave_subgroups().min(settings().wave);
        let mut room = room.clamp(1, MAX_WAVE);
        for index in (leader..self.status.len()).chain(0..leader) {
            if room == 0 {
                break;
            }
            if self.status[index] == Status::Ready && self.resume_point(plan, index) == point {
                self.status[index] = Status::InWave;
                room -= 1;
            }
        }
    }

    fn resume_point(&self, plan: &Plan<'_>, index: usize) -> ResumePoint {
        let state = &self.states[index * plan.rows..][..plan.rows];
        plan.dispatch.program.resume_point(state)
    }

    /// Runs the wave to its next event and notes where its subgroups stand then.
    fn run_wave(&mut self, plan: &Plan<'_>) -> Result<(), Stopped> {
        let mut fuel = FUEL;
        let event = self.run_members(plan, &mut fuel);
        if event != Event::OutOfFuel {
            self.burnt += FUEL - fuel + WAVE_FUEL;
            if self.burnt >= FUEL {
                self.burnt = 0;
                plan.dispatch.limits.check()?;
            }
            return self.settle(plan, event);
        }
        plan.dispatch.limits.check()?;
        let members: SmallVec<[usize; 16]> = self.in_wave().collect();
        self.settle(plan, event)?;
        if members.len() > 1 {
            for member in members {
                self.status[member] = Status::InWave;
                let mut fuel = FUEL_ALONE;
                let event = self.run_members(plan, &mut fuel);
                self.settle(plan, event)?;
            }
        }
        Ok(())
    }

    fn in_wave(&self) -> impl Iterator<Item = usize> {
        (0..self.status.len()).filter(|&index| self.status[index] == Status::InWave)
    }

    fn run_members(&mut self, plan: &Plan<'_>, fuel: &mut u64) -> Event {
        let mut states: [&mut [AlignedRow]; MAX_WAVE] = std::array::from_fn(|_| &mut [][..]);
        let members = self
            .states
            .chunks_exact_mut(plan.rows)
            .zip(&self.status)
            .filter(|(_, status)| **status == Status::InWave);
        let mut count = 0;
        for (place, (state, _)) in states.iter_mut().zip(members) {
            *place = state;
            count += 1;
        }
        // SAFETY: the command's bindings keep what the environment names, and the application keeps what those name; `shared` has the
        // program's size; the states are the program's.
        unsafe {
            plan.dispatch.program.run(
                &mut self.frame,
                &mut Wave {
                    states: &mut states[..count],
                    shared: self.shared.as_mut_ptr().cast(),
                    environment: plan.dispatch.environment,
                },
                fuel,
            )
        }
    }

    fn settle(&mut self, plan: &Plan<'_>, event: Event) -> Result<(), Stopped> {
        let program = plan.dispatch.program;
        for (state, status) in self
            .states
            .chunks_exact_mut(plan.rows)
            .zip(&mut self.status)
            .filter(|(_, status)| **status == Status::InWave)
        {
            *status = match event {
                Event::End => Status::Ended,
                Event::OutOfFuel => Status::Ready,
                Event::OutOfMemory => return Err(Stopped::OutOfMemory),
                Event::Yield(site) => match program.sites()[site.0 as usize] {
                    // A subgroup none of whose lanes has come to the barrier does not wait there.
                    SiteKind::Barrier if program.event_mask(state) == 0 => Status::Ready,
                    SiteKind::Barrier => Status::AtBarrier,
                    SiteKind::RayQueryProceed => {
                        self.queries.proceed(
                            self.walker.get_or_insert_with(|| settings().walker()),
                            program,
                            state,
                            &mut self.suspended,
                            plan.dispatch.limits,
                        )?;
                        Status::Ready
                    }
                    kind => unreachable!("{kind:?} in a compute shader"),
                },
            };
        }
        Ok(())
    }

    /// When no subgroup can run: lets all go on from the barrier. False if none is there, because all have ended.
    fn pass_barrier(&mut self) -> bool {
        let mut any = false;
        for status in &mut self.status {
            if *status == Status::AtBarrier {
                *status = Status::Ready;
                any = true;
            }
        }
        any
    }
}

/// Resizes, keeping what is there.
fn resize(rows: &mut Vec<AlignedRow>, len: usize) -> Result<(), Stopped> {
    rows.try_reserve(len.saturating_sub(rows.len()))
        .map_err(|_| Stopped::OutOfMemory)?;
    rows.resize(len, AlignedRow::default());
    Ok(())
}
