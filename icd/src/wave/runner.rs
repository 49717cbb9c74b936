//! Runs subgroups of one program to their end, in waves of subgroups at the same resume point.
//!
//! Runs a program's invocations without rays of their own: dispatches, vertices, fragments. The
//! caller owns a [`Runner`], calls [`Runner::begin`], starts each of [`Runner::states`] and fills
//! its inputs, calls [`Runner::run`], and reads the outputs there.

use std::time::Instant;

use lanes::LaneMask;
use spirv_jit::Program;
use spirv_jit::environment::Environment;
use spirv_jit::interp::Frame;
use spirv_jit::program::{AlignedRow, Event, Events, MAX_SUBGROUPS, ResumePoint, SiteKind, Wave};
use traversal::Walker;

use super::budget::Share;
use super::fault::{Stopped, StoppedAt};
use super::launch_counts::{Cells, LaunchCounts};
use super::limits::Limits;
use super::observer::Observer;
use super::queries::{Counted, Owned, Queries, Seen};
use crate::os::memory::trim_heap;
use crate::settings::settings;

/// Fuel of a wave between two checks of the limits.
const FUEL: u64 = 1 << 16;

/// Fuel of each subgroup, alone, after its wave has run out of fuel. So a subgroup that spins until
/// another one of its wave proceeds sees it proceed.
const FUEL_ALONE: u64 = 64;

/// Minimum fuel that a wave counts: a wave that yields at once uses none, and the limits must still
/// be checked.
const WAVE_FUEL: u64 = FUEL / 1024;

/// Rows that are cleared in the time of one unit of fuel.
const ROWS_PER_FUEL: usize = 16;

/// Rows by which states grow between two checks of the limits.
const ROWS_BETWEEN_LOOKS: usize = FUEL as usize * ROWS_PER_FUEL;

/// Largest size of the states that a caller runs together, if it can choose.
const BYTES_AT_ONCE: usize = 4 << 20;

/// Largest memory that a runner keeps between uses.
const KEPT_BYTES: usize = 16 << 20;

/// The status of a subgroup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Status {
    /// Ready, or part of the wave that runs.
    Ready,
    /// Ready at a barrier that none of its lanes has reached: all are past it or have ended. It
    /// runs apart from subgroups that have reached the barrier, which may return to it forever
    /// while they wait for other workgroups.
    Past,
    AtBarrier,
    /// At the second half of a split barrier.
    AtWait,
    Ended,
}

/// The grouping of subgroups that run together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Subgroups {
    pub count: usize,
    /// Consecutive subgroups of a workgroup, which share memory and wait for each other at
    /// barriers.
    pub of_workgroup: usize,
}

impl Subgroups {
    /// Subgroups of a program without workgroup memory and barriers.
    pub fn apart(count: usize) -> Self {
        Self {
            count,
            of_workgroup: count.max(1),
        }
    }

    /// Workgroups with the same number of subgroups each.
    pub fn of_workgroups(workgroups: usize, of_workgroup: usize) -> Self {
        Self {
            count: workgroups * of_workgroup,
            of_workgroup,
        }
    }
}

/// Subgroups of a workgroup that meet at barriers.
#[derive(Clone, Copy, Debug)]
struct Workgroup {
    /// Subgroups that have not ended.
    running: usize,
    /// Subgroups at a barrier.
    waiting: usize,
}

/// One worker's memory to run a program's subgroups. It is reused for the next subgroups without
/// allocation.
#[derive(Default)]
pub struct Runner {
    frame: Frame,
    /// [`Program::number`] of the program that the states are for.
    program: u64,
    /// Rows of a subgroup's state.
    rows: usize,
    /// States of the subgroups, one after the other.
    states: Vec<AlignedRow>,
    status: Vec<Status>,
    /// The status of each subgroup after its last run.
    points: Vec<ResumePoint>,
    /// The subgroups of the running wave, ascending.
    members: Vec<usize>,
    /// Subgroups of a workgroup.
    of_workgroup: usize,
    /// Used by programs with barriers.
    workgroups: Vec<Workgroup>,
    /// The memory of all workgroups, one after the other.
    shared: Vec<AlignedRow>,
    /// Rows of one workgroup's memory.
    shared_rows: usize,
    /// For each subgroup, its arrivals at the first half of split barriers, without those of its
    /// whole workgroup in one wave. Used by programs with split barriers.
    arrivals: Vec<u32>,
    /// The program has barriers.
    has_barriers: bool,
    /// Created by the first shader with a ray query.
    walker: Option<Box<Walker>>,
    queries: Queries,
    /// Pending rays of these subgroups' ray queries, up to the last subgroup that ever had one.
    waiting: Vec<Owned>,
    /// Fuel used since the last check of the limits.
    burnt: u64,
    /// The runner's share of the device's budget.
    share: Share,
}

/// The best number of subgroups for a caller to run together: a wave, or fewer if states are large.
pub fn subgroups_at_once(program: &Program) -> usize {
    let state_bytes = program.layout().rows * size_of::<AlignedRow>();
    (BYTES_AT_ONCE / state_bytes.max(1)).clamp(1, wave_length(program))
}

/// Subgroups that a wave of a program takes.
fn wave_length(program: &Program) -> usize {
    let most = program.max_wave_subgroups().min(settings().wave);
    most.clamp(1, MAX_SUBGROUPS)
}

impl Runner {
    /// Distinguishes runs of the same invocations, for the messages of their shader.
    pub fn set_order(&mut self, order: u64) {
        self.frame.order = order;
    }

    /// Sets the number of output rows that are read, from the first; `None` means all.
    pub fn set_outputs(&mut self, outputs: Option<usize>) {
        self.frame.outputs = outputs;
    }

    /// Reserves memory for subgroups of a program in the device's budget.
    ///
    /// # Errors
    /// The budget is exhausted, or a limit was reached.
    pub fn reserve(
        &mut self,
        program: &Program,
        subgroups: Subgroups,
        limits: &Limits,
    ) -> Result<(), Stopped> {
        let row_bytes = size_of::<AlignedRow>();
        let state_rows = subgroups.count * program.layout().rows;
        let workgroups = subgroups.count.div_ceil(subgroups.of_workgroup);
        let shared_rows = workgroups * shared_rows(program);
        let frame_bytes = program.frame_bytes(subgroups.count.min(wave_length(program)));
        let rows = state_rows.max(self.states.capacity()) + shared_rows.max(self.shared.capacity());
        let bytes = rows * row_bytes + frame_bytes.max(self.frame.bytes());
        self.share.grow_to(bytes, &limits.memory)?;
        resize(&mut self.states, state_rows, limits)?;
        resize(&mut self.shared, shared_rows, limits)
    }

    /// Allocates the states of a program's subgroups. They hold old values until
    /// [`Program::start`].
    ///
    /// # Errors
    /// Memory is exhausted, or a limit was reached.
    pub fn begin(
        &mut self,
        program: &Program,
        subgroups: Subgroups,
        limits: &Limits,
    ) -> Result<(), Stopped> {
        self.reserve(program, subgroups, limits)?;
        self.program = program.number();
        self.rows = program.layout().rows;
        self.of_workgroup = subgroups.of_workgroup;
        self.shared_rows = shared_rows(program);
        self.has_barriers = has_barriers(program);
        // The caller starts each state, which clears it.
        let cleared = (self.states.len() + self.shared.len()) / ROWS_PER_FUEL;
        self.burn(cleared as u64, limits)?;
        self.status.clear();
        self.status.resize(subgroups.count, Status::Ready);
        self.points.clear();
        self.points.resize(subgroups.count, ResumePoint::default());
        self.workgroups.clear();
        self.arrivals.clear();
        if self.has_barriers {
            if program.sites().contains(&SiteKind::BarrierArrive) {
                self.arrivals.resize(subgroups.count, 0);
            }
            let workgroup = Workgroup {
                running: subgroups.of_workgroup,
                waiting: 0,
            };
            let count = subgroups.count / subgroups.of_workgroup;
            self.workgroups.resize(count, workgroup);
        }
        for left in &mut self.waiting {
            self.queries.release(left);
        }
        // The specification leaves the values undefined. Zeros make the results of faulty shaders
        // repeatable.
        self.shared.fill(AlignedRow::default());
        Ok(())
    }

    /// Ends a piece of work: returns its bytes to the budget, and frees memory above the size to
    /// keep.
    pub fn rest(&mut self) {
        if self.share.bytes() > KEPT_BYTES {
            *self = Self::default();
            trim_heap();
        }
        self.share.give_back();
    }

    /// Counts fuel, and checks the limits after each quota.
    fn burn(&mut self, fuel: u64, limits: &Limits) -> Result<(), Stopped> {
        self.burnt += fuel;
        if self.burnt >= FUEL {
            self.burnt = 0;
            limits.check()?;
        }
        Ok(())
    }

    /// The states of all subgroups.
    pub fn states(&mut self) -> std::slice::ChunksExactMut<'_, AlignedRow> {
        self.states.chunks_exact_mut(self.rows)
    }

    /// The states of all subgroups, one after the other, and the rows of one.
    pub fn all_states(&self) -> (&[AlignedRow], usize) {
        (&self.states, self.rows)
    }

    /// The same, to be written.
    pub fn all_states_mut(&mut self) -> (&mut [AlignedRow], usize) {
        (&mut self.states, self.rows)
    }

    /// The state of one subgroup.
    pub fn state(&mut self, subgroup: usize) -> &mut [AlignedRow] {
        &mut self.states[subgroup * self.rows..][..self.rows]
    }

    /// The memory of one workgroup.
    pub fn shared(&mut self, workgroup: usize) -> &mut [AlignedRow] {
        &mut self.shared[workgroup * self.shared_rows..][..self.shared_rows]
    }

    /// Runs all subgroups to their end. The caller has started them and written their inputs. Their
    /// outputs are in their `io` rows afterwards.
    ///
    /// # Panics
    /// If the program is not the one passed to [`Self::begin`].
    ///
    /// # Errors
    /// A limit stopped them. Their writes so far remain.
    pub fn run(
        &mut self,
        program: &Program,
        environment: &Environment,
        limits: &Limits,
    ) -> Result<(), Stopped> {
        self.run_seen(program, environment, limits, None)
    }

    /// Like [`Self::run`], with an observer of the subgroups.
    ///
    /// # Panics
    /// As [`Self::run`].
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_seen(
        &mut self,
        program: &Program,
        environment: &Environment,
        limits: &Limits,
        seen: Option<&SeenSubgroups<'_>>,
    ) -> Result<(), Stopped> {
        assert_eq!(self.program, program.number(), "begun with another program");
        let run = Run {
            program,
            environment,
            limits,
            seen,
        };
        if self.run_at_once(&run)? {
            return Ok(());
        }
        let mut from = 0;
        loop {
            // Round robin: a subgroup that spins must not starve the others.
            let ready = |index: &usize| matches!(self.status[*index], Status::Ready | Status::Past);
            let next = (from..self.status.len()).chain(0..from).find(ready);
            match next {
                Some(leader) => {
                    self.form_wave(program, leader);
                    self.run_wave(&run, leader)?;
                    from = leader + 1;
                }
                None => return Ok(()),
            }
        }
    }

    /// Runs all subgroups, from the entry, as one wave if they fit in one and it does not yield.
    /// Returns false if work remains.
    fn run_at_once(&mut self, run: &Run<'_>) -> Result<bool, Stopped> {
        let program = run.program;
        if self.status.len() > wave_length(program) || !program.sites().is_empty() {
            return Ok(false);
        }
        self.members.clear();
        self.members.extend(0..self.status.len());
        if !self.status.is_empty() {
            self.run_wave(run, 0)?;
        }
        Ok(self.status.iter().all(|status| *status == Status::Ended))
    }

    /// Forms a wave of `leader` and the ready subgroups at the same point.
    fn form_wave(&mut self, program: &Program, leader: usize) {
        let (status, point) = (self.status[leader], self.points[leader]);
        let room = wave_length(program);
        let mut members = std::mem::take(&mut self.members);
        members.clear();
        for index in (leader..self.status.len()).chain(0..leader) {
            if members.len() == room {
                break;
            }
            if self.status[index] == status && self.points[index] == point {
                members.push(index);
            }
        }
        members.sort_unstable();
        self.members = members;
    }

    /// Records the position of an abandoned subgroup, for the fault report.
    #[cold]
    fn note_stop(&self, run: &Run<'_>, index: usize) {
        let state = &self.states[index * self.rows..][..self.rows];
        run.limits.note(|| StoppedAt {
            place: run.program.place_of(state),
            depth: 0,
        });
    }

    /// Runs the wave to its next event and records the status of its subgroups.
    fn run_wave(&mut self, run: &Run<'_>, leader: usize) -> Result<(), Stopped> {
        let members = std::mem::take(&mut self.members);
        let ran = self.run_to_event(run, &members);
        self.members = members;
        ran.inspect_err(|_| self.note_stop(run, leader))
    }

    fn run_to_event(&mut self, run: &Run<'_>, members: &[usize]) -> Result<(), Stopped> {
        let mut fuel = FUEL;
        let events = self.run_members(run, members, &mut fuel)?;
        if !events.contains(Event::OutOfFuel) {
            self.burn(FUEL - fuel + WAVE_FUEL, run.limits)?;
            return self.settle(run, members, events);
        }
        run.limits.check()?;
        self.settle(run, members, events)?;
        if members.len() > 1 {
            for member in members.chunks(1) {
                let mut fuel = FUEL_ALONE;
                let events = self.run_members(run, member, &mut fuel)?;
                self.settle(run, member, events)?;
            }
        }
        Ok(())
    }

    /// Runs subgroups at one point, in ascending order.
    fn run_members(
        &mut self,
        run: &Run<'_>,
        members: &[usize],
        fuel: &mut u64,
    ) -> Result<Events, Stopped> {
        let is_whole = self.has_barriers && self.is_whole(members);
        let mut states: [&mut [AlignedRow]; MAX_SUBGROUPS] = std::array::from_fn(|_| &mut [][..]);
        let mut all = self.states.chunks_exact_mut(self.rows);
        let mut next = 0;
        for (place, &member) in states.iter_mut().zip(members) {
            *place = all.nth(member - next).expect("one of the subgroups");
            next = member + 1;
        }
        let mut shared = [std::ptr::null_mut(); MAX_SUBGROUPS];
        if self.shared_rows > 0 {
            let base = self.shared.as_mut_ptr();
            let mut places = shared.iter_mut();
            for (workgroup, members) in by_workgroup(members, self.of_workgroup) {
                for place in places.by_ref().take(members.len()) {
                    // SAFETY: `begin` has allocated the memory of each workgroup.
                    *place = unsafe { base.add(workgroup * self.shared_rows) }.cast();
                }
            }
        }
        let shared: &[*mut u8] = match self.shared_rows {
            0 => &[],
            _ => &shared[..members.len()],
        };
        let started = run.seen.map(|_| Instant::now());
        // SAFETY: the command's bindings keep the environment's data alive, and the application
        // keeps the memory that the data points to. Each workgroup's memory has the program's size,
        // and the states are the program's.
        let events = unsafe {
            run.program.run(
                &mut self.frame,
                &mut Wave {
                    states: &mut states[..members.len()],
                    shared,
                    is_whole,
                    outputs_to: &[],
                    environment: run.environment,
                },
                fuel,
            )
        };
        if let Some((seen, started)) = run.seen.zip(started) {
            seen.count_time(started, members);
        }
        events.map_err(|_| Stopped::OutOfMemory)
    }

    /// Records the status of subgroups after a run.
    fn settle(&mut self, run: &Run<'_>, members: &[usize], events: Events) -> Result<(), Stopped> {
        let program = run.program;
        if events.contains(Event::End) {
            for &member in members {
                self.status[member] = Status::Ended;
            }
            if self.has_barriers {
                self.pass_barriers(members);
            }
            return Ok(());
        }
        for (&member, event) in members.iter().zip(events.iter()) {
            let state = &mut self.states[member * self.rows..][..self.rows];
            self.points[member] = program.resume_point(state);
            self.status[member] = match event {
                Event::End => Status::Ended,
                Event::OutOfFuel => Status::Ready,
                Event::Yield(site) => match program.sites()[site.0 as usize] {
                    SiteKind::Barrier | SiteKind::BarrierArrive | SiteKind::BarrierWait
                        if program.event_mask(state).is_empty() =>
                    {
                        Status::Past
                    }
                    SiteKind::Barrier => Status::AtBarrier,
                    SiteKind::BarrierArrive => {
                        self.arrivals[member] = self.arrivals[member].wrapping_add(1);
                        Status::Ready
                    }
                    // Without an arrival there is nothing to wait for.
                    SiteKind::BarrierWait if self.arrivals.is_empty() => Status::Ready,
                    SiteKind::BarrierWait => Status::AtWait,
                    SiteKind::RayQueryProceed => {
                        if self.waiting.len() <= member {
                            self.waiting.resize_with(member + 1, Owned::default);
                        }
                        self.queries.proceed(
                            self.walker.get_or_insert_with(|| settings().walker()),
                            program,
                            state,
                            &mut self.waiting[member],
                            run.limits,
                            run.seen.map(|seen| seen.of(member)),
                        )?;
                        Status::Ready
                    }
                    kind => unreachable!("{kind:?} outside ray tracing pipelines"),
                },
            };
        }
        if self.has_barriers {
            self.pass_barriers(members);
        }
        Ok(())
    }

    /// Whether the members include all live subgroups of their workgroups, and those of each
    /// workgroup have the same number of arrivals: they may be at one point in different iterations
    /// of a loop.
    fn is_whole(&self, members: &[usize]) -> bool {
        by_workgroup(members, self.of_workgroup).all(|(workgroup, members)| {
            let arrivals = |&member: &usize| self.arrivals.get(member);
            members.len() == self.workgroups[workgroup].running
                && (members.windows(2)).all(|pair| arrivals(&pair[0]) == arrivals(&pair[1]))
        })
    }

    /// Releases the subgroups of a workgroup whose split barrier is complete: every live subgroup
    /// has arrived at least as often. The subgroup with the fewest arrivals never waits, so at
    /// least one can run.
    fn pass_waits(&mut self, workgroup: usize) {
        let range = workgroup * self.of_workgroup..(workgroup + 1) * self.of_workgroup;
        let (status, arrivals) = (&mut self.status[range.clone()], &self.arrivals[range]);
        if !status.contains(&Status::AtWait) {
            return;
        }
        let running = status.iter().zip(arrivals);
        let running = running.filter(|(status, _)| **status != Status::Ended);
        let least = running.map(|(_, &count)| count).min().unwrap_or(0);
        for (status, &count) in status.iter_mut().zip(arrivals) {
            if *status == Status::AtWait && count <= least {
                *status = Status::Ready;
            }
        }
    }

    /// Counts members that have ended or reached a barrier. The subgroups of a workgroup continue
    /// once all of its live subgroups have reached it. A workgroup waits only for its own
    /// subgroups, since another one may wait for it.
    fn pass_barriers(&mut self, members: &[usize]) {
        for (index, members) in by_workgroup(members, self.of_workgroup) {
            let count = |status| {
                let of_status = |&&member: &&usize| self.status[member] == status;
                members.iter().filter(of_status).count()
            };
            let (ended, arrived) = (count(Status::Ended), count(Status::AtBarrier));
            let workgroup = &mut self.workgroups[index];
            workgroup.running -= ended;
            workgroup.waiting += arrived;
            if workgroup.waiting > 0 && workgroup.waiting == workgroup.running {
                workgroup.waiting = 0;
                let first = index * self.of_workgroup;
                for status in &mut self.status[first..][..self.of_workgroup] {
                    if *status == Status::AtBarrier {
                        *status = Status::Ready;
                    }
                }
            }
            if !self.arrivals.is_empty() {
                self.pass_waits(index);
            }
        }
    }
}

/// Splits ascending subgroups by their workgroups: each workgroup's index and members.
fn by_workgroup(members: &[usize], of_workgroup: usize) -> impl Iterator<Item = (usize, &[usize])> {
    let mut left = members;
    std::iter::from_fn(move || {
        let workgroup = left.first()? / of_workgroup;
        let end = (workgroup + 1) * of_workgroup;
        let of_one = left.iter().take_while(|&&member| member < end).count();
        let (members, others) = left.split_at(of_one);
        left = others;
        Some((workgroup, members))
    })
}

/// Whether subgroups of a workgroup wait for each other at barriers.
pub fn has_barriers(program: &Program) -> bool {
    (program.sites().iter()).any(|site| {
        matches!(
            site,
            SiteKind::Barrier | SiteKind::BarrierArrive | SiteKind::BarrierWait
        )
    })
}

/// The number of rows of a workgroup's memory.
fn shared_rows(program: &Program) -> usize {
    (program.shared_size_bytes() as usize).div_ceil(size_of::<AlignedRow>())
}

/// The program, states and environment of one run.
struct Run<'a> {
    program: &'a Program,
    environment: &'a Environment,
    limits: &'a Limits,
    seen: Option<&'a SeenSubgroups<'a>>,
}

/// An observer's view of subgroups.
pub struct SeenSubgroups<'a> {
    /// The observed subgroup and its lane.
    pub one: Option<(usize, &'a dyn Observer, usize)>,
    /// Counts of invocations, and the cells of each subgroup's lanes.
    pub counted: Option<(&'a LaunchCounts, Vec<Cells>)>,
}

impl SeenSubgroups<'_> {
    fn of(&self, subgroup: usize) -> Seen<'_> {
        let one = self.one.filter(|(observed, ..)| *observed == subgroup);
        let counted = self.counted.as_ref();
        Seen {
            one: one.map(|(_, observer, lane)| (observer, lane)),
            counted: counted.map(|(counts, cells)| Counted {
                counts,
                cells: cells[subgroup],
            }),
        }
    }

    /// Members of a wave have run: their lanes share the time.
    #[cold]
    fn count_time(&self, started: Instant, members: &[usize]) {
        let Some((counts, cells)) = &self.counted else {
            return;
        };
        let time = started.elapsed();
        let lanes_of = |cells: &Cells| LaneMask::from_fn(|lane| cells[lane].is_some());
        let counted = members.iter().map(|&member| &cells[member]);
        let lanes = counted.clone().map(|cells| lanes_of(cells).count()).sum();
        counts.add_time(time, lanes, |add| {
            counted.for_each(|cells| add(cells, lanes_of(cells)));
        });
    }
}

/// Resizes and keeps the contents. Checks the limits meanwhile, since new memory takes time that
/// fuel does not count.
fn resize(rows: &mut Vec<AlignedRow>, len: usize, limits: &Limits) -> Result<(), Stopped> {
    rows.truncate(len);
    rows.try_reserve_exact(len - rows.len())
        .map_err(|_| Stopped::OutOfMemory)?;
    while len - rows.len() > ROWS_BETWEEN_LOOKS {
        rows.resize(rows.len() + ROWS_BETWEEN_LOOKS, AlignedRow::default());
        limits.check()?;
    }
    rows.resize(len, AlignedRow::default());
    Ok(())
}
