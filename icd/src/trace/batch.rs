//! One batch: run ready waves, advance walks, form waves of the calls; until nothing is left.

use smallvec::SmallVec;
use spirv_jit::program::{AlignedRow, Event, ResumePoint, SiteKind, Wave};
use spirv_jit::{SUBGROUP_SIZE, interp::Frame};
use traversal::{Company, RayRows, Verdict, Walk, Walker};

use super::Dispatch;
use super::calls::{Call, Calls, Records};
use super::grid::Grid;
use super::inputs::Sources;
use super::queries::Queries;
use super::rays::RayGroup;
use super::slab::Slab;
use super::stats::Tally;
use super::subgroup::{LaneRef, Role, Subgroup, SubgroupIndex, lanes_of};
use crate::settings::settings;
use crate::wave::Stopped;
use crate::wave::table::ProgramIndex;

/// Fuel of one run or walk between two looks at the limits.
pub(super) const FUEL: u64 = 1 << 16;

/// Subgroups in a wave of most shaders, at most.
const USUAL_WAVE: usize = 16;

/// Waves between two looks at the limits.
const PATIENCE: u32 = 256;

/// Subgroup states that a batch may have in flight, in bytes: recursion ends in a device loss there, not in an abort.
const MAX_STATE_BYTES: usize = 1 << 30;

/// A worker's memory, kept warm from batch to batch.
pub struct Worker {
    frame: Frame,
    pub(super) walker: Box<Walker>,
    pub(super) subgroups: Slab<Subgroup>,
    pub(super) ray_groups: Slab<RayGroup>,
    /// Walks that wait for a shader.
    pub(super) walks: Slab<Walk>,
    /// Rays that wait together.
    pub(super) companies: Slab<Box<Company>>,
    /// Rays that set out together.
    pub(super) company: Box<Company>,
    /// The rays that are being started.
    pub(super) rays: RayRows,
    pub(super) records: Records,
    /// States without a subgroup, for their memory.
    pub(super) spare_rows: Vec<Vec<AlignedRow>>,
    pub(super) queries: Queries,
}

impl Default for Worker {
    fn default() -> Self {
        Self {
            frame: Frame::default(),
            walker: settings().walker(),
            subgroups: Slab::default(),
            ray_groups: Slab::default(),
            walks: Slab::default(),
            companies: Slab::default(),
            company: Box::default(),
            rays: RayRows::NONE,
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
    grid: &'a Grid,
    pub(super) worker: &'a mut Worker,
    ready: Vec<Ready>,
    /// Groups of rays whose walks begin.
    pub(super) starting: Vec<u32>,
    /// Rays that the walker has taken up, by groups.
    pub(super) enlisted: Vec<(u32, u16)>,
    /// Rays whose walk can go on.
    pub(super) walking: Vec<(LaneRef, Verdict)>,
    /// Groups of rays that can go on together.
    pub(super) going_on: Vec<u32>,
    pub(super) calls: Calls,
    /// Subgroups that stand at a reorder instruction.
    pub(super) reordering: Vec<SubgroupIndex>,
    pub(super) state_bytes: usize,
    /// Waves until the next look at the limits: a shader that always yields never runs out of fuel.
    patience: u32,
    tally: Option<Tally>,
}

impl<'a> Batch<'a> {
    /// An empty batch of a dispatch.
    pub fn new(dispatch: &'a Dispatch<'a>, grid: &'a Grid, worker: &'a mut Worker) -> Self {
        worker.subgroups.clear();
        worker.ray_groups.clear();
        worker.walks.clear();
        worker.companies.clear();
        worker.records = Records::default();
        worker.queries.clear();
        worker.walker.dismiss();
        Self {
            dispatch,
            grid,
            worker,
            ready: Vec::new(),
            starting: Vec::new(),
            enlisted: Vec::new(),
            walking: Vec::new(),
            going_on: Vec::new(),
            calls: Calls::default(),
            reordering: Vec::new(),
            state_bytes: 0,
            patience: PATIENCE,
            tally: Tally::new(dispatch.shaders.programs.len()),
        }
    }

    /// Runs the invocations of batch `index` to their end.
    ///
    /// # Errors
    /// A limit was reached.
    pub fn run(mut self, raygen: ProgramIndex, record: u64, index: usize) -> Result<(), Stopped> {
        for mut tile in self.grid.tiles(index) {
            if let Some(mask) = &self.dispatch.mask {
                for lane in lanes_of(tile.mask) {
                    let [x, y, _] = self.grid.launch_id(tile.launch[lane]);
                    tile.mask &= !(u16::from(mask.excludes(x, y)) << lane);
                }
                if tile.mask == 0 {
                    continue;
                }
            }
            let subgroup = self.new_subgroup(raygen, Role::RayGeneration, tile.mask)?;
            self.worker.subgroups[subgroup].launch = tile.launch;
            self.start(subgroup, &[record; SUBGROUP_SIZE]);
        }
        loop {
            while self.is_busy() {
                self.run_ready_waves()?;
                self.advance_walks()?;
                self.form_waves()?;
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
        let walks = self.starting.is_empty() && self.walking.is_empty() && self.going_on.is_empty();
        !(self.ready.is_empty() && walks && self.calls.is_empty())
    }

    /// Takes a place for a subgroup at its program's entry.
    fn new_subgroup(
        &mut self,
        program: ProgramIndex,
        role: Role,
        lanes: u16,
    ) -> Result<SubgroupIndex, Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        self.take_state_bytes(compiled.layout().rows * size_of::<AlignedRow>())?;
        let index = self.worker.subgroups.take();
        self.worker.subgroups[index].start(program, compiled, role, lanes);
        Ok(index)
    }

    /// Counts a subgroup's state.
    pub(super) fn take_state_bytes(&mut self, bytes: usize) -> Result<(), Stopped> {
        self.state_bytes += bytes;
        if self.state_bytes > MAX_STATE_BYTES {
            return Err(Stopped::OutOfMemory);
        }
        Ok(())
    }

    /// Fills a new subgroup's inputs and makes it ready.
    fn start(&mut self, index: SubgroupIndex, records: &[u64; SUBGROUP_SIZE]) {
        // Out of the list, for the others to be read meanwhile.
        let mut rows = std::mem::take(&mut self.worker.subgroups[index].rows);
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let sources = Sources {
            dispatch: self.dispatch,
            grid: self.grid,
            subgroups: &self.worker.subgroups,
            ray_groups: &self.worker.ray_groups,
            walks: &self.worker.walks,
            companies: &self.worker.companies,
        };
        sources.fill(program, subgroup, records, &mut rows);
        self.worker.subgroups[index].rows = rows;
        self.make_ready(index);
    }

    pub(super) fn make_ready(&mut self, index: SubgroupIndex) {
        let subgroup = &self.worker.subgroups[index];
        let program = subgroup.program;
        let point = self.dispatch.shaders.programs[program as usize].resume_point(&subgroup.rows);
        match self
            .ready
            .iter_mut()
            .find(|ready| (ready.program, ready.point) == (program, point))
        {
            Some(ready) => ready.subgroups.push(index),
            None => self.ready.push(Ready {
                program,
                point,
                subgroups: vec![index],
            }),
        }
    }

    /// Runs until every subgroup waits for a ray, a verdict or a callee.
    fn run_ready_waves(&mut self) -> Result<(), Stopped> {
        while let Some(fullest) =
            (0..self.ready.len()).max_by_key(|&i| self.ready[i].subgroups.len())
        {
            let Ready {
                program,
                point,
                mut subgroups,
            } = self.ready.swap_remove(fullest);
            let width = self.dispatch.shaders.programs[program as usize]
                .max_wave_subgroups()
                .max(1);
            subgroups.sort_unstable();
            self.compact(program, point, &mut subgroups)?;
            for wave in subgroups.chunks(width) {
                self.run_wave(program, wave)?;
            }
        }
        Ok(())
    }

    fn run_wave(&mut self, program: ProgramIndex, wave: &[SubgroupIndex]) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let mut rows: SmallVec<[_; USUAL_WAVE]> = wave
            .iter()
            .map(|&index| std::mem::take(&mut self.worker.subgroups[index].rows))
            .collect();
        if let Some(tally) = &mut self.tally {
            tally.count(program, compiled, &rows);
        }
        let mut states: Vec<&mut [AlignedRow]> =
            rows.iter_mut().map(|rows| &mut rows[..]).collect();
        let mut fuel = FUEL;
        let event = compiled.run(
            &mut self.worker.frame,
            &mut Wave {
                states: &mut states,
                shared: std::ptr::null_mut(),
                environment: self.dispatch.environment,
            },
            &mut fuel,
        );
        for (&index, rows) in wave.iter().zip(rows) {
            self.worker.subgroups[index].rows = rows;
        }
        for &index in wave {
            match event {
                Event::End => self.end(index),
                Event::OutOfFuel => self.make_ready(index),
                Event::Yield(site) => match compiled.sites()[site.0 as usize] {
                    SiteKind::RayQueryProceed => self.proceed(index)?,
                    kind => self.answer(index, kind),
                },
            }
        }
        self.patience -= 1;
        if event == Event::OutOfFuel || self.patience == 0 {
            self.patience = PATIENCE;
            self.dispatch.limits.check()
        } else {
            Ok(())
        }
    }

    /// Advances the ray queries of a subgroup, which then goes on.
    fn proceed(&mut self, index: SubgroupIndex) -> Result<(), Stopped> {
        let worker = &mut *self.worker;
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        worker.queries.proceed(
            &mut worker.walker,
            program,
            &mut subgroup.rows,
            &mut subgroup.queries,
            self.dispatch.limits,
        )?;
        self.make_ready(index);
        Ok(())
    }

    /// Makes subgroups of the waiting calls: full ones of one shader each, whatever the divergence of those who called.
    fn form_waves(&mut self) -> Result<(), Stopped> {
        let mut calls = std::mem::take(&mut self.calls);
        for bucket in calls.sorted() {
            let (program, role) = (bucket.program, bucket.role);
            for calls in bucket.sorted().chunks(SUBGROUP_SIZE) {
                self.form_subgroup(program, role, calls)?;
            }
            bucket.clear();
        }
        self.calls = calls;
        Ok(())
    }

    /// Makes a subgroup of rays of a group, each in its own lane.
    pub(super) fn form_in_place(
        &mut self,
        (program, role, record): (ProgramIndex, Role, u64),
        group: u32,
        lanes: u16,
    ) -> Result<(), Stopped> {
        let of = std::array::from_fn(|lane| LaneRef::new(group, lane));
        if let Some(traced) = self.dispatch.checks {
            for lane in lanes_of(lanes) {
                self.check_call(traced, program, role, of[lane]);
            }
        }
        let index = self.new_subgroup(program, role, lanes)?;
        let worker = &mut *self.worker;
        let launch = worker.subgroups[worker.ray_groups[group].caller].launch;
        let subgroup = &mut worker.subgroups[index];
        (subgroup.of, subgroup.launch) = (of, launch);
        self.start(index, &[record; SUBGROUP_SIZE]);
        Ok(())
    }

    fn form_subgroup(
        &mut self,
        program: ProgramIndex,
        role: Role,
        calls: &[Call],
    ) -> Result<(), Stopped> {
        if let Some(traced) = self.dispatch.checks {
            for &(_, of) in calls {
                self.check_call(traced, program, role, of);
            }
        }
        let lanes = u16::MAX >> (SUBGROUP_SIZE - calls.len());
        let index = self.new_subgroup(program, role, lanes)?;
        let (mut records, mut of) = ([calls[0].0; SUBGROUP_SIZE], [calls[0].1; SUBGROUP_SIZE]);
        for (lane, call) in calls.iter().enumerate() {
            (records[lane], of[lane]) = *call;
        }
        let worker = &mut *self.worker;
        let launch = of.map(|of| {
            let caller = match role {
                Role::Callable => of.index(),
                _ => worker.ray_groups[of.index()].caller,
            };
            worker.subgroups[caller].launch[of.lane()]
        });
        let subgroup = &mut worker.subgroups[index];
        (subgroup.of, subgroup.launch) = (of, launch);
        self.start(index, &records);
        Ok(())
    }
}
