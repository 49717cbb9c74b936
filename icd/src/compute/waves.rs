//! Subgroups of one program, run to their end: waves of those that stand at one resume point, in turns.
//!
//! Runs a program's invocations without rays of their own: dispatches, vertices, fragments. The
//! caller owns a [`Runner`], calls [`Runner::begin`], starts each of [`Runner::states`] and fills
//! its inputs, calls [`Runner::run`], and reads the outputs there.

use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::environment::Environment;
use spirv_jit::interp::Frame;
use spirv_jit::program::{AlignedRow, Event, Events, ResumePoint, SiteKind, Wave};
use traversal::Walker;

use crate::settings::settings;
use crate::trace::{Owned, Queries};
use crate::wave::{Limits, Stopped, StoppedAt};

/// Fuel of a wave between two looks at the limits.
const FUEL: u64 = 1 << 16;

/// Fuel of each subgroup of a wave that ran dry, alone: a subgroup that spins until another one of its wave has gone on sees it go on.
const FUEL_ALONE: u64 = 64;

/// Minimum fuel that a wave costs between two checks of the limits: a wave that always yields burns
/// none.
const WAVE_FUEL: u64 = FUEL / 1024;

/// Subgroups of a wave, at most.
const MAX_WAVE: usize = 32;

/// Where a subgroup stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Status {
    Ready,
    /// Part of the wave that runs.
    InWave,
    AtBarrier,
    Ended,
}

/// One worker's memory for running a program's subgroups, kept from one set of them to the next: nothing is allocated for each.
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
    shared: Vec<AlignedRow>,
    /// Made by the first shader with a ray query.
    walker: Option<Box<Walker>>,
    queries: Queries,
    /// The rays of these subgroups' queries that wait.
    waiting: Vec<Owned>,
    /// Fuel since the last look at the limits.
    burnt: u64,
}

impl Runner {
    /// Makes room for that many subgroups of a program, which share what a workgroup shares. Their states hold what earlier ones left there
    /// until [`Program::start`].
    ///
    /// # Errors
    /// When there is no memory for them.
    pub fn begin(&mut self, program: &Program, subgroups: usize) -> Result<(), Stopped> {
        self.program = program.number();
        self.rows = program.layout().rows;
        resize(&mut self.states, subgroups * self.rows)?;
        self.status.clear();
        self.status.resize(subgroups, Status::Ready);
        for left in &mut self.waiting {
            self.queries.release(left);
        }
        self.waiting.resize_with(subgroups, Owned::default);
        // Undefined by the specification; zeros, so that even a faulty shader gives the same result twice.
        self.shared.clear();
        let shared_bytes = program.shared_size_bytes() as usize;
        resize(
            &mut self.shared,
            shared_bytes.div_ceil(size_of::<AlignedRow>()),
        )
    }

    /// The states of all subgroups.
    pub fn states(&mut self) -> std::slice::ChunksExactMut<'_, AlignedRow> {
        self.states.chunks_exact_mut(self.rows)
    }

    /// The state of one subgroup.
    pub fn state(&mut self, subgroup: usize) -> &mut [AlignedRow] {
        &mut self.states[subgroup * self.rows..][..self.rows]
    }

    /// Runs all subgroups to their end. They have been started and given their inputs; their outputs stand in their `io` rows then.
    ///
    /// # Panics
    /// When the program is not the one that the subgroups were begun with.
    ///
    /// # Errors
    /// When a limit stopped them; what they wrote so far stays written.
    pub fn run(
        &mut self,
        program: &Program,
        environment: &Environment,
        limits: &Limits,
    ) -> Result<(), Stopped> {
        assert_eq!(self.program, program.number(), "begun with another program");
        let run = Run {
            program,
            environment,
            limits,
        };
        if self.run_at_once(&run)? {
            return Ok(());
        }
        let mut from = 0;
        loop {
            // Taking turns: a subgroup that spins must not keep the others from running.
            let ready = |index: &usize| self.status[*index] == Status::Ready;
            let next = (from..self.status.len()).chain(0..from).find(ready);
            match next {
                Some(leader) => {
                    self.form_wave(program, leader);
                    let ran = self.run_wave(&run);
                    ran.inspect_err(|_| self.note_stop(&run, leader))?;
                    from = leader + 1;
                }
                None if !self.pass_barrier() => return Ok(()),
                None => from = 0,
            }
        }
    }

    /// Runs all subgroups, which stand at the entry, as one wave, if they are few enough for one and it never yields. False where there is more to do.
    fn run_at_once(&mut self, run: &Run<'_>) -> Result<bool, Stopped> {
        let program = run.program;
        let room = program.max_wave_subgroups().min(settings().wave);
        if self.status.len() > room.min(MAX_WAVE) || !program.sites().is_empty() {
            return Ok(false);
        }
        self.status.fill(Status::InWave);
        if !self.status.is_empty() {
            self.run_wave(run).inspect_err(|_| self.note_stop(run, 0))?;
        }
        Ok(self.status.iter().all(|status| *status == Status::Ended))
    }

    /// Takes `leader` and the ready subgroups that stand where it stands.
    fn form_wave(&mut self, program: &Program, leader: usize) {
        let point = self.resume_point(program, leader);
        let room = program.max_wave_subgroups().min(settings().wave);
        let mut room = room.clamp(1, MAX_WAVE);
        for index in (leader..self.status.len()).chain(0..leader) {
            if room == 0 {
                break;
            }
            if self.status[index] == Status::Ready && self.resume_point(program, index) == point {
                self.status[index] = Status::InWave;
                room -= 1;
            }
        }
    }

    /// Notes where a subgroup stands that was given up.
    #[cold]
    fn note_stop(&self, run: &Run<'_>, index: usize) {
        let state = &self.states[index * self.rows..][..self.rows];
        run.limits.note(|| StoppedAt {
            place: run.program.place_of(state),
            depth: 0,
        });
    }

    fn resume_point(&self, program: &Program, index: usize) -> ResumePoint {
        program.resume_point(&self.states[index * self.rows..][..self.rows])
    }

    /// Runs the wave to its next event and notes where its subgroups stand then.
    fn run_wave(&mut self, run: &Run<'_>) -> Result<(), Stopped> {
        let mut fuel = FUEL;
        let events = self.run_members(run, &mut fuel)?;
        if !events.contains(Event::OutOfFuel) {
            self.burnt += FUEL - fuel + WAVE_FUEL;
            if self.burnt >= FUEL {
                self.burnt = 0;
                run.limits.check()?;
            }
            return self.settle(run, events);
        }
        run.limits.check()?;
        let members: SmallVec<[usize; 16]> = self.in_wave().collect();
        self.settle(run, events)?;
        if members.len() > 1 {
            for member in members {
                self.status[member] = Status::InWave;
                let mut fuel = FUEL_ALONE;
                let events = self.run_members(run, &mut fuel)?;
                self.settle(run, events)?;
            }
        }
        Ok(())
    }

    fn in_wave(&self) -> impl Iterator<Item = usize> {
        (0..self.status.len()).filter(|&index| self.status[index] == Status::InWave)
    }

    fn run_members(&mut self, run: &Run<'_>, fuel: &mut u64) -> Result<Events, Stopped> {
        let mut states: [&mut [AlignedRow]; MAX_WAVE] = std::array::from_fn(|_| &mut [][..]);
        let members = self
            .states
            .chunks_exact_mut(self.rows)
            .zip(&self.status)
            .filter(|(_, status)| **status == Status::InWave);
        let mut count = 0;
        for (place, (state, _)) in states.iter_mut().zip(members) {
            *place = state;
            count += 1;
        }
        // SAFETY: the commands' bindings keep what the environment names, and the application keeps what those name; `shared` has the
        // program's size; the states are the program's.
        let events = unsafe {
            run.program.run(
                &mut self.frame,
                &mut Wave {
                    states: &mut states[..count],
                    shared: self.shared.as_mut_ptr().cast(),
                    environment: run.environment,
                },
                fuel,
            )
        };
        events.map_err(|_| Stopped::OutOfMemory)
    }

    fn settle(&mut self, run: &Run<'_>, events: Events) -> Result<(), Stopped> {
        let program = run.program;
        let members = (self.states)
            .chunks_exact_mut(self.rows)
            .zip(self.status.iter_mut().zip(&mut self.waiting))
            .filter(|(_, (status, _))| **status == Status::InWave);
        for ((state, (status, waiting)), event) in members.zip(events.iter()) {
            *status = match event {
                Event::End => Status::Ended,
                Event::OutOfFuel => Status::Ready,
                Event::Yield(site) => match program.sites()[site.0 as usize] {
                    // A subgroup none of whose lanes has come to the barrier does not wait there.
                    SiteKind::Barrier if program.event_mask(state).is_empty() => Status::Ready,
                    SiteKind::Barrier => Status::AtBarrier,
                    SiteKind::RayQueryProceed => {
                        self.queries.proceed(
                            self.walker.get_or_insert_with(|| settings().walker()),
                            program,
                            state,
                            waiting,
                            run.limits,
                        )?;
                        Status::Ready
                    }
                    kind => unreachable!("{kind:?} outside ray tracing pipelines"),
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

/// The program, states and environment of one run.
struct Run<'a> {
    program: &'a Program,
    environment: &'a Environment,
    limits: &'a Limits,
}

/// Resizes, keeping what is there.
fn resize(rows: &mut Vec<AlignedRow>, len: usize) -> Result<(), Stopped> {
    rows.try_reserve(len.saturating_sub(rows.len()))
        .map_err(|_| Stopped::OutOfMemory)?;
    rows.resize(len, AlignedRow::default());
    Ok(())
}
