//! One batch, in rounds, until nothing is left:
//!
//! 1. rays walk to their ends, with the shaders that decide on their candidates
//!    ([`Turn::Deciders`]);
//! 2. hit, miss and callable shaders run until each has ended or waits ([`Turn::Callees`]);
//! 3. so do ray generation shaders ([`Turn::Launches`]), whose lanes are moved together first where
//!    many have ended.
//!
//! A step ends when nothing in it can go on. What it leaves does not depend on what was done first
//! in it, as no subgroup's shader can tell: so who meets in the subgroups that the next step forms
//! follows from the launch alone, whatever the order of answers, the length of waves or the way
//! that rays walk.
//!
//! Waves that need no partners are taken on directly ([`direct`](super::direct)), within the round.

use lanes::LaneMask;
use spirv_jit::program::{AlignedRow, Event, Events, MAX_SUBGROUPS, ResumePoint, SiteKind, Wave};
use spirv_jit::{SUBGROUP_SIZE, interp::Frame};
use traversal::Walker;

use super::Dispatch;
use super::calls::{Calls, Records};
use super::fill_plan::FillPlan;
use super::grid::Grid;
use super::inputs::{Callee, Sources, fill};
use super::line::{Line, Noted};
use super::rays::RayGroup;
use super::slab::Slab;
use super::stats::Tally;
use super::subgroup::{Role, Subgroup, SubgroupIndex, Turn};
use super::walked::Counting;
use crate::os::memory::trim_heap;
use crate::settings::settings;
use crate::wave::queries::Queries;
use crate::wave::table::ProgramIndex;
use crate::wave::{Share, Stopped};

/// Fuel of one run between two looks at the limits.
const FUEL: u64 = 1 << 16;

/// Waves between two looks at the limits.
const PATIENCE: u32 = 256;

/// Bytes of new subgroup states between two looks at the limits: clearing them burns no fuel.
const STATE_BYTES: usize = 64 << 20;

/// Memory that a worker may keep between batches, in bytes of subgroup states; memory beyond that
/// is released after a deep recursion.
const KEPT_BYTES: usize = 64 << 20;

/// A worker's memory, kept warm from batch to batch.
pub struct Worker {
    frame: Frame,
    /// Away while it traces.
    pub(super) walker: Option<Box<Walker>>,
    pub(super) subgroups: Slab<Subgroup>,
    pub(super) ray_groups: Slab<RayGroup>,
    pub(super) records: Records,
    /// States without a subgroup, for their memory.
    pub(super) spare_rows: Vec<Vec<AlignedRow>>,
    pub(super) queries: Queries,
    pub(super) line: Line,
}

impl Default for Worker {
    fn default() -> Self {
        Self {
            frame: Frame::default(),
            walker: Some(settings().walker()),
            subgroups: Slab::default(),
            ray_groups: Slab::default(),
            records: Records::default(),
            spare_rows: Vec::new(),
            queries: Queries::default(),
            line: Line::default(),
        }
    }
}

/// Subgroups of one program that stand at one point.
pub(super) struct Ready {
    program: ProgramIndex,
    point: ResumePoint,
    subgroups: Vec<SubgroupIndex>,
}

/// A batch being turned.
pub struct Batch<'a> {
    pub(super) dispatch: &'a Dispatch<'a>,
    pub(super) grid: &'a Grid,
    /// The layer of its launches.
    pub(super) layer: u32,
    pub(super) worker: &'a mut Worker,
    /// By [`Turn`].
    pub(super) ready: [Vec<Ready>; Turn::COUNT],
    /// By [`Turn`]: where the last one came, if that list is still there.
    latest: [usize; Turn::COUNT],
    /// Lists of ready subgroups that are not in use, for their memory.
    spare: Vec<Vec<SubgroupIndex>>,
    /// Groups of rays whose walks begin.
    pub(super) starting: Vec<u32>,
    /// The same, of rays that are known not to go together.
    pub(super) apart: Vec<u32>,
    /// Groups of rays about all of whose candidates shaders have decided.
    pub(super) going_on: Vec<u32>,
    /// Calls of shaders that decide on candidates.
    pub(super) deciding: Calls,
    /// Calls of hit, miss and callable shaders.
    pub(super) calls: Calls,
    /// Subgroups that stand at a reorder instruction.
    pub(super) reordering: Vec<SubgroupIndex>,
    /// Whether lines of ray generation shaders are taken on directly; see
    /// [`direct`](super::direct).
    pub(super) is_direct: bool,
    /// Validation or an observer sees what happens.
    pub(super) is_watched: bool,
    /// A line is being answered.
    pub(super) in_line: bool,
    /// Subgroups at traces and calls that are to be answered as lines.
    pub(super) standing: Vec<SubgroupIndex>,
    /// How far subgroups of lines came in this round.
    pub(super) noted: Vec<Noted>,
    /// The same, of hit and miss shaders.
    pub(super) noted_callees: Vec<Noted>,
    /// Of subgroup states in flight.
    pub(super) state_bytes: usize,
    /// Of the longest frame of a wave so far.
    frame_bytes: usize,
    /// Of the most states of a line's callees so far, by depth.
    line_bytes: [usize; 2],
    /// Their share of the device's budget.
    share: Share,
    /// Bytes of states made since the last look at the limits.
    unchecked_bytes: usize,
    /// Waves until the next look at the limits: a shader that always yields never runs out of fuel.
    patience: u32,
    tally: Option<Tally>,
    /// Counts of each invocation, where a capture keeps them.
    pub(super) counting: Option<Counting<'a>>,
}

impl Drop for Batch<'_> {
    fn drop(&mut self) {
        if self.share.bytes() > KEPT_BYTES {
            *self.worker = Worker::default();
            trim_heap();
        }
    }
}

impl<'a> Batch<'a> {
    /// An empty batch of a dispatch.
    pub fn new(dispatch: &'a Dispatch<'a>, grid: &'a Grid, worker: &'a mut Worker) -> Self {
        worker.subgroups.clear();
        worker.ray_groups.clear();
        worker.records = Records::default();
        worker.queries.clear();
        worker.line.clear();
        let walker = worker.walker.get_or_insert_with(|| settings().walker());
        walker.clear();
        // SAFETY: the memory is there until the dispatch is complete, and no walk goes on after it.
        unsafe { walker.set_live(&dispatch.limits.live) };
        Self {
            dispatch,
            grid,
            layer: 0,
            worker,
            ready: Default::default(),
            latest: [0; Turn::COUNT],
            spare: Vec::new(),
            starting: Vec::new(),
            apart: Vec::new(),
            going_on: Vec::new(),
            deciding: Calls::default(),
            calls: Calls::default(),
            reordering: Vec::new(),
            is_direct: settings().direct && !dispatch.is_watched(),
            is_watched: dispatch.is_watched(),
            in_line: false,
            standing: Vec::new(),
            noted: Vec::new(),
            noted_callees: Vec::new(),
            state_bytes: 0,
            frame_bytes: 0,
            line_bytes: [0; 2],
            share: Share::default(),
            unchecked_bytes: 0,
            patience: PATIENCE,
            tally: Tally::new(dispatch.shaders.programs.len()),
            counting: Counting::new(dispatch.observer),
        }
    }

    /// Runs the invocations of batch `index` to their end.
    ///
    /// # Errors
    /// A limit was reached.
    pub fn run(mut self, raygen: ProgramIndex, record: u64, index: usize) -> Result<(), Stopped> {
        self.layer = self.grid.layer(index);
        self.start_launches(raygen, record, index)?;
        loop {
            while self.is_busy() {
                self.answer_lines()?;
                self.trace_rays_to_their_ends()?;
                self.form_callees()?;
                self.act_on_noted_callees()?;
                self.run_ready(Turn::Callees)?;
                self.run_launches()?;
            }
            if self.reordering.is_empty() {
                break;
            }
            self.reorder_threads()?;
        }
        debug_assert!(
            self.worker.subgroups.is_empty() && self.worker.ray_groups.is_empty(),
            "a batch ends with invocations in flight"
        );
        if let Some(tally) = &mut self.tally {
            tally.close(|index| &self.dispatch.shaders.programs[index]);
        }
        Ok(())
    }

    /// Starts a ray generation shader's invocations.
    fn start_launches(
        &mut self,
        raygen: ProgramIndex,
        record: u64,
        index: usize,
    ) -> Result<(), Stopped> {
        let grid = self.grid;
        let width = self.wave_width(raygen);
        let (mut line, mut others) = (Vec::with_capacity(width), Vec::new());
        let program = &self.dispatch.shaders.programs[raygen as usize];
        let (plan, inputs) = (FillPlan::new(program), program.layout().inputs);
        for place in grid.tiles(index) {
            let subgroup = self.new_subgroup(raygen, Role::RayGeneration, LaneMask::ALL)?;
            let launch = &mut self.worker.subgroups[subgroup].launch;
            let mut lanes = grid.write_tile(place, launch);
            if let Some(mask) = &self.dispatch.mask {
                for lane in lanes {
                    lanes.set(lane, !mask.excludes(launch.x[lane], launch.y[lane]));
                }
            }
            if lanes != LaneMask::ALL {
                let started = &mut self.worker.subgroups[subgroup];
                started.lanes = lanes;
                program.start(&mut started.rows, lanes);
            }
            if lanes.is_empty() {
                self.give_back(subgroup);
                continue;
            }
            match &plan {
                Some(plan) => {
                    let started = &mut self.worker.subgroups[subgroup];
                    let rows = &mut started.rows[inputs..];
                    plan.fill_launches(&started.launch, (self.layer, record), rows);
                }
                None => self.fill_inputs(subgroup, &[record; SUBGROUP_SIZE]),
            }
            if !self.is_direct {
                self.make_ready(subgroup);
                continue;
            }
            line.push(subgroup);
            if line.len() == width {
                self.start_line(raygen, &mut line, &mut others)?;
            }
        }
        if !line.is_empty() {
            self.start_line(raygen, &mut line, &mut others)?;
        }
        match self.is_direct {
            true => self.finish_start(others),
            false => self.run_launches(),
        }
    }

    /// Gives the place of a subgroup back.
    pub(super) fn give_back(&mut self, index: SubgroupIndex) {
        let subgroup = &mut self.worker.subgroups[index];
        subgroup.lanes = LaneMask::NONE;
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        self.state_bytes -= program.layout().rows * size_of::<AlignedRow>();
        self.worker.subgroups.remove(index);
    }

    /// Something other than a reordering is to be done.
    fn is_busy(&self) -> bool {
        let is_ready = self.ready.iter().any(|ready| !ready.is_empty());
        let walks = [&self.starting, &self.apart, &self.going_on];
        let has_walks = walks.iter().any(|groups| !groups.is_empty());
        let is_called = !(self.calls.is_empty() && self.deciding.is_empty());
        let noted = [&self.noted, &self.noted_callees];
        let has_lines = !self.standing.is_empty() || noted.iter().any(|noted| !noted.is_empty());
        is_ready || has_walks || is_called || has_lines
    }

    /// Walks all rays to their ends, with the shaders that decide on their candidates.
    fn trace_rays_to_their_ends(&mut self) -> Result<(), Stopped> {
        loop {
            let started = self.start_clock();
            self.advance_walks()?;
            self.count_walks(started)?;
            if self.ready[Turn::Deciders as usize].is_empty() {
                if self.deciding.is_empty() {
                    return Ok(());
                }
                self.form_deciders()?;
            }
            self.run_ready(Turn::Deciders)?;
        }
    }

    /// Takes a place for a subgroup at its program's entry.
    pub(super) fn new_subgroup(
        &mut self,
        program: ProgramIndex,
        role: Role,
        lanes: LaneMask,
    ) -> Result<SubgroupIndex, Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        self.take_state_bytes(compiled.layout().rows * size_of::<AlignedRow>())?;
        let index = self.worker.subgroups.take();
        self.worker.subgroups[index].start(program, compiled, role, lanes)?;
        Ok(index)
    }

    /// Counts a subgroup's state, and looks at the limits now and then.
    pub(super) fn take_state_bytes(&mut self, bytes: usize) -> Result<(), Stopped> {
        self.state_bytes += bytes;
        self.take_bytes()?;
        self.unchecked_bytes += bytes;
        if self.unchecked_bytes > STATE_BYTES {
            self.unchecked_bytes = 0;
            self.dispatch.limits.check()?;
        }
        Ok(())
    }

    /// Takes bytes of the device's budget for states and frame.
    fn take_bytes(&mut self) -> Result<(), Stopped> {
        let bytes = self.state_bytes + self.frame_bytes + self.line_bytes.iter().sum::<usize>();
        self.share.grow_to(bytes, &self.dispatch.limits.memory)
    }

    /// Makes room for states of callees in a line.
    pub(super) fn make_line_room(
        &mut self,
        depth: usize,
        rows: usize,
        states: &mut Vec<AlignedRow>,
    ) -> Result<(), Stopped> {
        let bytes = rows * size_of::<AlignedRow>();
        if bytes > self.line_bytes[depth] {
            self.line_bytes[depth] = bytes;
            self.take_bytes()?;
        }
        if rows > states.len() {
            let room = states.try_reserve(rows - states.len());
            room.map_err(|_| Stopped::OutOfMemory)?;
            states.resize(rows, AlignedRow::default());
        }
        Ok(())
    }

    /// Fills a new subgroup's inputs.
    pub(super) fn fill_inputs(&mut self, index: SubgroupIndex, records: &[u64; SUBGROUP_SIZE]) {
        // Out of the list, for the others to be read meanwhile.
        let mut rows = std::mem::take(&mut self.worker.subgroups[index].rows);
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let callee = Callee {
            role: subgroup.role,
            lanes: subgroup.lanes,
            launch: &subgroup.launch,
            of: &subgroup.of,
            is_in_place: subgroup.is_in_place,
            records,
        };
        let (sources, tier) = (self.sources(), self.dispatch.tier);
        fill(tier, &sources, program, &callee, &mut rows);
        self.worker.subgroups[index].rows = rows;
    }

    /// The sources of inputs.
    pub(super) fn sources(&self) -> Sources<'_> {
        Sources {
            dispatch: self.dispatch,
            layer: self.layer,
            subgroups: &self.worker.subgroups,
            ray_groups: &self.worker.ray_groups,
        }
    }

    pub(super) fn make_ready(&mut self, index: SubgroupIndex) {
        let subgroup = &self.worker.subgroups[index];
        let program = subgroup.program;
        let point = self.dispatch.shaders.programs[program as usize].resume_point(&subgroup.rows);
        let turn = subgroup.role.turn() as usize;
        let (ready, latest) = (&mut self.ready[turn], &mut self.latest[turn]);
        let is_there = |r: &Ready| (r.program, r.point) == (program, point);
        // Most come where the one before came.
        if !ready.get(*latest).is_some_and(is_there) {
            *latest = ready.iter().position(is_there).unwrap_or_else(|| {
                ready.push(Ready {
                    program,
                    point,
                    subgroups: self.spare.pop().unwrap_or_default(),
                });
                ready.len() - 1
            });
        }
        ready[*latest].subgroups.push(index);
    }

    /// Runs all whose turn it is until each waits or has ended.
    fn run_ready(&mut self, turn: Turn) -> Result<(), Stopped> {
        let turn = turn as usize;
        while let Some(fullest) =
            (0..self.ready[turn].len()).max_by_key(|&i| self.ready[turn][i].subgroups.len())
        {
            let ready = self.ready[turn].swap_remove(fullest);
            self.run_subgroups(ready)?;
        }
        Ok(())
    }

    /// Runs ray generation shaders until each waits or has ended. Those that come back from a
    /// shader call are moved together first.
    pub(super) fn run_launches(&mut self) -> Result<(), Stopped> {
        let turn = Turn::Launches as usize;
        for mut ready in std::mem::take(&mut self.ready[turn]) {
            self.compact(ready.program, ready.point, &mut ready.subgroups)?;
            self.run_subgroups(ready)?;
        }
        self.act_on_noted()?;
        self.run_ready(Turn::Launches)
    }

    /// Runs subgroups that stand at one point, in waves.
    fn run_subgroups(&mut self, ready: Ready) -> Result<(), Stopped> {
        let Ready {
            program,
            mut subgroups,
            ..
        } = ready;
        let width = self.wave_width(program);
        if !subgroups.is_sorted() {
            subgroups.sort_unstable();
        }
        for wave in subgroups.chunks(width) {
            self.run_wave(program, wave)?;
        }
        subgroups.clear();
        self.spare.push(subgroups);
        Ok(())
    }

    /// Subgroups of a program's waves, at most.
    pub(super) fn wave_width(&self, program: ProgramIndex) -> usize {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        (compiled.max_wave_subgroups())
            .min(settings().wave)
            .clamp(1, MAX_SUBGROUPS)
    }

    fn run_wave(&mut self, program: ProgramIndex, wave: &[SubgroupIndex]) -> Result<(), Stopped> {
        let started = self.start_clock();
        let events = self.run_to_events(program, wave)?;
        self.count_wave(started, wave);
        for (&index, event) in wave.iter().zip(events.iter()) {
            self.act_on(index, event)?;
        }
        self.look_at_limits(&events)
            .inspect_err(|_| self.note_stop(wave[0]))
    }

    /// Runs a wave of subgroups that stand at one point until each has come to an event.
    pub(super) fn run_to_events(
        &mut self,
        program: ProgramIndex,
        wave: &[SubgroupIndex],
    ) -> Result<Events, Stopped> {
        let is_once = |(place, index)| !wave[..place].contains(index);
        debug_assert!(wave.iter().enumerate().all(is_once), "a subgroup twice");
        let subgroups = &mut self.worker.subgroups;
        let mut states: [&mut [AlignedRow]; MAX_SUBGROUPS] =
            std::array::from_fn(|place| match wave.get(place) {
                None => &mut [][..],
                Some(&index) => {
                    let rows = &mut subgroups[index].rows;
                    // SAFETY: each subgroup is in the list once, and none is touched otherwise
                    // until the run is over.
                    unsafe { std::slice::from_raw_parts_mut(rows.as_mut_ptr(), rows.len()) }
                }
            });
        self.run_states(program, &mut states[..wave.len()], &[])
            .inspect_err(|_| self.note_stop(wave[0]))
    }

    /// The same for states of a program; `outputs_to`: see [`Wave::outputs_to`], rows of callers
    /// that wait.
    pub(super) fn run_states<'s>(
        &mut self,
        program: ProgramIndex,
        states: &'s mut [&'s mut [AlignedRow]],
        outputs_to: &'s [*mut AlignedRow],
    ) -> Result<Events, Stopped>
    where
        'a: 's,
    {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let frame_bytes = compiled.frame_bytes(states.len());
        if frame_bytes > self.frame_bytes {
            self.frame_bytes = frame_bytes;
            self.take_bytes()?;
        }
        if let Some(tally) = &mut self.tally {
            tally.count(program, compiled, states);
        }
        let mut fuel = FUEL;
        // SAFETY: the command's bindings keep what the environment names, and the application keeps
        // what those name; only compute shaders have workgroup memory; the states are this
        // program's.
        let events = unsafe {
            compiled.run(
                &mut self.worker.frame,
                &mut Wave {
                    states,
                    shared: &[],
                    is_whole: false,
                    outputs_to,
                    environment: self.dispatch.environment,
                },
                &mut fuel,
            )
        };
        events.map_err(|_| Stopped::OutOfMemory)
    }

    /// Does what the event of a subgroup calls for.
    pub(super) fn act_on(&mut self, index: SubgroupIndex, event: Event) -> Result<(), Stopped> {
        match event {
            Event::End => self.end(index),
            Event::OutOfFuel => self.make_ready(index),
            Event::Yield(site) => {
                let subgroup = &self.worker.subgroups[index];
                let program = &self.dispatch.shaders.programs[subgroup.program as usize];
                match program.sites()[site.0 as usize] {
                    SiteKind::RayQueryProceed => self.proceed(index)?,
                    kind if self.is_for_line(index, kind) => self.standing.push(index),
                    kind => self.act_on_yield(index, kind)?,
                }
            }
        }
        Ok(())
    }

    /// Looks at the limits after a wave, now and then and where fuel has run out.
    pub(super) fn look_at_limits(&mut self, events: &Events) -> Result<(), Stopped> {
        self.patience -= 1;
        if events.contains(Event::OutOfFuel) || self.patience == 0 {
            self.patience = PATIENCE;
            self.dispatch.limits.check()
        } else {
            Ok(())
        }
    }

    /// Advances the ray queries of a subgroup, which then goes on.
    fn proceed(&mut self, index: SubgroupIndex) -> Result<(), Stopped> {
        let seen = match self.is_watched {
            true => Some(self.seen(index)),
            false => None,
        };
        let worker = &mut *self.worker;
        let walker = worker.walker.as_mut().expect("no rays are traced now");
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let proceeded = worker.queries.proceed(
            walker,
            program,
            &mut subgroup.rows,
            &mut subgroup.queries,
            self.dispatch.limits,
            seen,
        );
        proceeded.inspect_err(|_| self.note_stop(index))?;
        self.make_ready(index);
        Ok(())
    }
}
