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

use lanes::LaneMask;
use spirv_jit::program::{AlignedRow, Event, MAX_SUBGROUPS, ResumePoint, SiteKind, Wave};
use spirv_jit::{SUBGROUP_SIZE, interp::Frame};
use traversal::Walker;

use super::Dispatch;
use super::calls::{Calls, Records};
use super::grid::Grid;
use super::inputs::{Sources, fill};
use super::queries::Queries;
use super::rays::RayGroup;
use super::slab::Slab;
use super::stats::Tally;
use super::subgroup::{Role, Subgroup, SubgroupIndex, Turn};
use crate::settings::settings;
use crate::wave::table::ProgramIndex;
use crate::wave::{Share, Stopped, trim_heap};

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
        }
    }
}

/// Subgroups of one program that stand at one point.
struct Ready {
    program: ProgramIndex,
    point: ResumePoint,
    subgroups: Vec<SubgroupIndex>,
}

/// A batch being turned.
pub struct Batch<'a> {
    pub(super) dispatch: &'a Dispatch<'a>,
    pub(super) grid: &'a Grid,
    /// The layer of its launches.
    layer: u32,
    pub(super) worker: &'a mut Worker,
    /// By [`Turn`].
    ready: [Vec<Ready>; Turn::COUNT],
    /// By [`Turn`]: where the last one came, if that list is still there.
    latest: [usize; Turn::COUNT],
    /// Lists of ready subgroups that are not in use, for their memory.
    spare: Vec<Vec<SubgroupIndex>>,
    /// Groups of rays whose walks begin.
    pub(super) starting: Vec<u32>,
    /// Groups of rays about all of whose candidates shaders have decided.
    pub(super) going_on: Vec<u32>,
    /// Calls of shaders that decide on candidates.
    pub(super) deciding: Calls,
    /// Calls of hit, miss and callable shaders.
    pub(super) calls: Calls,
    /// Subgroups that stand at a reorder instruction.
    pub(super) reordering: Vec<SubgroupIndex>,
    /// Of subgroup states in flight.
    pub(super) state_bytes: usize,
    /// Of the longest frame of a wave so far.
    frame_bytes: usize,
    /// Their share of the device's budget.
    share: Share,
    /// Bytes of states made since the last look at the limits.
    unchecked_bytes: usize,
    /// Waves until the next look at the limits: a shader that always yields never runs out of fuel.
    patience: u32,
    tally: Option<Tally>,
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
            going_on: Vec::new(),
            deciding: Calls::default(),
            calls: Calls::default(),
            reordering: Vec::new(),
            state_bytes: 0,
            frame_bytes: 0,
            share: Share::default(),
            unchecked_bytes: 0,
            patience: PATIENCE,
            tally: Tally::new(dispatch.shaders.programs.len()),
        }
    }

    /// Runs the invocations of batch `index` to their end.
    ///
    /// # Errors
    /// A limit was reached.
    pub fn run(mut self, raygen: ProgramIndex, record: u64, index: usize) -> Result<(), Stopped> {
        self.layer = self.grid.layer(index);
        for mut tile in self.grid.tiles(index) {
            if let Some(mask) = &self.dispatch.mask {
                for lane in tile.mask {
                    let (x, y) = (tile.launch.x[lane], tile.launch.y[lane]);
                    tile.mask.set(lane, !mask.excludes(x, y));
                }
                if tile.mask.is_empty() {
                    continue;
                }
            }
            let subgroup = self.new_subgroup(raygen, Role::RayGeneration, tile.mask)?;
            self.worker.subgroups[subgroup].launch = tile.launch;
            self.start(subgroup, &[record; SUBGROUP_SIZE]);
        }
        loop {
            while self.is_busy() {
                self.trace_rays_to_their_ends()?;
                self.form_callees()?;
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

    /// Something other than a reordering is to be done.
    fn is_busy(&self) -> bool {
        let waits = self.ready.iter().all(Vec::is_empty) && self.starting.is_empty();
        !(waits && self.calls.is_empty())
    }

    /// Walks all rays to their ends, with the shaders that decide on their candidates.
    fn trace_rays_to_their_ends(&mut self) -> Result<(), Stopped> {
        loop {
            self.advance_walks()?;
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
        let bytes = self.state_bytes + self.frame_bytes;
        self.share.grow_to(bytes, &self.dispatch.limits.memory)
    }

    /// Fills a new subgroup's inputs and makes it ready.
    pub(super) fn start(&mut self, index: SubgroupIndex, records: &[u64; SUBGROUP_SIZE]) {
        // Out of the list, for the others to be read meanwhile.
        let mut rows = std::mem::take(&mut self.worker.subgroups[index].rows);
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let sources = Sources {
            dispatch: self.dispatch,
            layer: self.layer,
            subgroups: &self.worker.subgroups,
            ray_groups: &self.worker.ray_groups,
        };
        fill(
            self.dispatch.tier,
            &sources,
            program,
            subgroup,
            records,
            &mut rows,
        );
        self.worker.subgroups[index].rows = rows;
        self.make_ready(index);
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
    fn run_launches(&mut self) -> Result<(), Stopped> {
        let turn = Turn::Launches as usize;
        for mut ready in std::mem::take(&mut self.ready[turn]) {
            self.compact(ready.program, ready.point, &mut ready.subgroups)?;
            self.run_subgroups(ready)?;
        }
        self.run_ready(Turn::Launches)
    }

    /// Runs subgroups that stand at one point, in waves.
    fn run_subgroups(&mut self, ready: Ready) -> Result<(), Stopped> {
        let Ready {
            program,
            mut subgroups,
            ..
        } = ready;
        let width = self.dispatch.shaders.programs[program as usize]
            .max_wave_subgroups()
            .min(settings().wave)
            .max(1);
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

    fn run_wave(&mut self, program: ProgramIndex, wave: &[SubgroupIndex]) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let frame_bytes = compiled.frame_bytes(wave.len());
        if frame_bytes > self.frame_bytes {
            self.frame_bytes = frame_bytes;
            self.take_bytes().inspect_err(|_| self.note_stop(wave[0]))?;
        }
        debug_assert!(wave.is_sorted_by(|a, b| a < b), "a subgroup twice");
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
        let states = &mut states[..wave.len()];
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
                    environment: self.dispatch.environment,
                },
                &mut fuel,
            )
        };
        let events = events.map_err(|_| {
            self.note_stop(wave[0]);
            Stopped::OutOfMemory
        })?;
        for (&index, event) in wave.iter().zip(events.iter()) {
            match event {
                Event::End => self.end(index),
                Event::OutOfFuel => self.make_ready(index),
                Event::Yield(site) => match compiled.sites()[site.0 as usize] {
                    SiteKind::RayQueryProceed => self.proceed(index)?,
                    kind => self.answer(index, kind)?,
                },
            }
        }
        self.patience -= 1;
        if events.contains(Event::OutOfFuel) || self.patience == 0 {
            self.patience = PATIENCE;
            let checked = self.dispatch.limits.check();
            checked.inspect_err(|_| self.note_stop(wave[0]))
        } else {
            Ok(())
        }
    }

    /// Advances the ray queries of a subgroup, which then goes on.
    fn proceed(&mut self, index: SubgroupIndex) -> Result<(), Stopped> {
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
        );
        proceeded.inspect_err(|_| self.note_stop(index))?;
        self.make_ready(index);
        Ok(())
    }
}
