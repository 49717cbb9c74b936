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
use spirv_jit::program::{AlignedRow, Event, Events, MAX_SUBGROUPS, SiteKind, Wave};
use spirv_jit::{Program, SUBGROUP_SIZE, interp::Frame};
use traversal::Walker;

use super::Dispatch;
use super::batch_memory::BatchMemory;
use super::calls::{Calls, Records};
use super::fill_plan::{FillPlan, start_tile};
use super::grid::Grid;
use super::inputs::{Callee, Sources, fill};
use super::line::{Line, LineLists};
use super::rays::RayGroup;
use super::ready::{Ready, ReadyLists};
use super::slab::Slab;
use super::subgroup::{Role, Subgroup, SubgroupIndex, Turn};
use super::walk_lists::WalkLists;
use super::walked::Counting;
use crate::os::memory::trim_heap;
use crate::settings::settings;
use crate::wave::Stopped;
use crate::wave::binding_table::ProgramIndex;
use crate::wave::observer::{Observer, StartedWave};
use crate::wave::queries::Queries;

/// Fuel of one run between two looks at the limits.
const FUEL: u64 = 1 << 16;

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

/// A batch being turned.
pub struct Batch<'a> {
    pub(super) dispatch: &'a Dispatch<'a>,
    pub(super) grid: &'a Grid,
    /// The layer of its launches.
    pub(super) layer: u32,
    pub(super) worker: &'a mut Worker,
    pub(super) ready: ReadyLists,
    /// Groups of rays that are to walk.
    pub(super) walks: WalkLists,
    /// Calls of shaders that decide on candidates.
    pub(super) deciding: Calls,
    /// Calls of hit, miss and callable shaders.
    pub(super) calls: Calls,
    /// Subgroups that stand at a reorder instruction.
    pub(super) reordering: Vec<SubgroupIndex>,
    /// Subgroups of lines.
    pub(super) lines: LineLists,
    /// An observer takes events of rays or keeps counts.
    pub(super) is_watched: bool,
    /// An observer takes events of rays. Lines are then not taken on directly.
    pub(super) takes_events: bool,
    pub(super) memory: BatchMemory,
    /// The observer, if it takes events of waves.
    wave_observer: Option<&'a dyn Observer>,
    /// Counts of each invocation, where a capture keeps them.
    pub(super) counting: Option<Counting<'a>>,
}

impl Drop for Batch<'_> {
    fn drop(&mut self) {
        if self.memory.bytes() > KEPT_BYTES {
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
        let takes_events = (dispatch.observer).is_some_and(|it| it.watches_rays());
        let counting = Counting::new(dispatch.observer);
        Self {
            dispatch,
            grid,
            layer: 0,
            worker,
            ready: ReadyLists::default(),
            walks: WalkLists::default(),
            deciding: Calls::default(),
            calls: Calls::default(),
            reordering: Vec::new(),
            lines: LineLists::new(settings().direct && !takes_events),
            is_watched: takes_events || counting.is_some(),
            takes_events,
            memory: BatchMemory::default(),
            wave_observer: (dispatch.observer).filter(|it| it.interests().waves),
            counting,
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
            let Subgroup { launch, rows, .. } = &mut self.worker.subgroups[subgroup];
            let (tier, common) = (self.dispatch.tier, (self.layer, record));
            let inputs = &mut rows[inputs..];
            let mut lanes = start_tile(tier, grid, place, launch, plan.as_ref(), common, inputs);
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
            if plan.is_none() {
                self.fill_inputs(subgroup, &[record; SUBGROUP_SIZE]);
            }
            if !self.lines.is_direct {
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
        match self.lines.is_direct {
            true => self.finish_start(others),
            false => self.run_launches(),
        }
    }

    /// Gives the place of a subgroup back.
    pub(super) fn give_back(&mut self, index: SubgroupIndex) {
        let subgroup = &mut self.worker.subgroups[index];
        subgroup.lanes = LaneMask::NONE;
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let bytes = program.layout().rows * size_of::<AlignedRow>();
        self.memory.remove_state(bytes);
        self.worker.subgroups.remove(index);
    }

    /// Something other than a reordering is to be done.
    fn is_busy(&self) -> bool {
        let is_called = !(self.calls.is_empty() && self.deciding.is_empty());
        let is_idle = self.ready.is_empty() && self.walks.is_empty() && self.lines.is_empty();
        is_called || !is_idle
    }

    /// Walks all rays to their ends, with the shaders that decide on their candidates.
    fn trace_rays_to_their_ends(&mut self) -> Result<(), Stopped> {
        loop {
            self.advance_walks()?;
            if self.ready.has_none(Turn::Deciders) {
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

    /// Counts a subgroup's state.
    pub(super) fn take_state_bytes(&mut self, bytes: usize) -> Result<(), Stopped> {
        self.memory.add_state(bytes, self.dispatch.limits)
    }

    /// Makes room for states of callees in a line.
    pub(super) fn make_line_room(
        &mut self,
        depth: usize,
        rows: usize,
        states: &mut Vec<AlignedRow>,
    ) -> Result<(), Stopped> {
        let bytes = rows * size_of::<AlignedRow>();
        (self.memory).add_line(depth, bytes, self.dispatch.limits)?;
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
        (self.ready).add(subgroup.role.turn(), program, point, index);
    }

    /// Runs all whose turn it is until each waits or has ended.
    fn run_ready(&mut self, turn: Turn) -> Result<(), Stopped> {
        while let Some(ready) = self.ready.take_fullest(turn) {
            self.run_subgroups(ready)?;
        }
        Ok(())
    }

    /// Runs ray generation shaders until each waits or has ended. Those that come back from a
    /// shader call are moved together first.
    pub(super) fn run_launches(&mut self) -> Result<(), Stopped> {
        for mut ready in self.ready.take(Turn::Launches) {
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
        self.ready.recycle(subgroups);
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
        (self.memory).add_frame(frame_bytes, self.dispatch.limits)?;
        if let Some(observer) = self.wave_observer {
            show_wave(observer, (program, compiled), states);
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
                    kind if self.is_for_line(index, kind) => self.lines.standing.push(index),
                    kind => self.act_on_yield(index, kind)?,
                }
            }
        }
        Ok(())
    }

    /// Looks at the limits after a wave, now and then and where fuel has run out.
    pub(super) fn look_at_limits(&mut self, events: &Events) -> Result<(), Stopped> {
        self.memory.check_after(events, self.dispatch.limits)
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

/// A wave of a program is about to run.
#[cold]
fn show_wave(
    observer: &dyn Observer,
    (index, program): (ProgramIndex, &Program),
    states: &[&mut [AlignedRow]],
) {
    let lanes = states.iter().map(|state| program.event_mask(state).count());
    observer.wave(&StartedWave {
        program: index,
        subgroups: states.len() as u32,
        lanes: lanes.sum(),
    });
}
