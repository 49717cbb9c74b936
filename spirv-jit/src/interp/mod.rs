//! The vector interpreter: each operation runs over the lanes of a wave.
//!
//! ```text
//! ir ──> uniformity, slots (rows by live ranges) ──> emit ──> code: instructions that point at their kernels
//! ```
//!
//! * [`machine`]: a running wave; [`tier`]: instruction sets; [`kernels`]: pure operations; [`access`], [`memory`], [`descriptors`], [`atomics`],
//!   [`subgroup`], [`images`]: the others; [`control`]: masks and jumps; [`yields`]: suspending and resuming.

mod access;
mod atomics;
mod coalesce;
mod code;
mod control;
mod descriptors;
mod emit;
mod fusion;
pub(crate) mod images;
mod kernels;
mod machine;
mod memory;
mod region;
mod slots;
mod subgroup;
mod tier;
mod uniformity;
mod yields;

#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::collections::TryReserveError;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::ir::interface::{FragmentFacts, OutputRow};
use crate::ir::passed::{Passed, passed};
use crate::ir::stage::Stage;
use crate::ir::{self, InputRow};
use crate::query::QueryWord;
use crate::row::AlignedRow;
use crate::state::{Event, ResumePoint, SiteKind, StateLayout, Wave};
pub use crate::tier::{NAMES as TIER_NAMES, TierKind, limit as limit_tier};
use crate::{Error, SUBGROUP_SIZE};
use code::Code;
use machine::{MAX_SUBGROUPS, Machine, Mask};

/// What a frame's rows may take, in bytes, before they leave the nearest cache.
const FRAME_BYTES: usize = 40 << 10;

/// A worker's hot memory: slots of the program that is running. One per thread, reused for every program.
#[derive(Default)]
pub struct Frame {
    /// By program, those that share a number's last digits in turn; the last for programs with many rows.
    uniforms: Vec<Uniforms>,
    vectors: Vec<AlignedRow>,
    masks: Vec<Mask>,
    returns: Vec<u32>,
}

/// Uniform rows: a program's constants, and what its prologue computed.
#[derive(Default)]
struct Uniforms {
    rows: Vec<AlignedRow>,
    /// Whose they are.
    program: u64,
    /// The environment that the prologue computed them for, or 0.
    environment: u64,
}

/// Programs whose uniform rows a frame keeps, and the most that each of them may have.
const KEPT_PROGRAMS: usize = 64;
const KEPT_ROWS: usize = 256;

/// A compiled shader. Immutable and shared between threads.
pub struct Program {
    /// Differs from every other program's in the process, and is not 0.
    number: u64,
    stage: Stage,
    code: Code,
    inputs: Vec<InputRow>,
    query_words: Vec<QueryWord>,
    local_size: [u32; 3],
    quads: bool,
    shared_size_bytes: u32,
    layout: StateLayout,
    /// First private row of the state.
    private: usize,
    private_rows: usize,
    live_rows: usize,
    sites: Vec<SiteKind>,
    output_rows: u32,
    outputs: Vec<OutputRow>,
    passed: Option<Vec<Passed>>,
    fragment: Option<FragmentFacts>,
    functions: usize,
}

impl Program {
    /// Compiles a verified, optimised module.
    ///
    /// # Errors
    /// Budget; operations on types that have none.
    pub fn new(module: &ir::Module) -> Result<Program, Error> {
        Self::with_tier(module, TierKind::best())
    }

    /// As [`Self::new`], for a tier that is not the best: for tests and measurements. The tier is one that the machine has.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_tier(module: &ir::Module, tier: TierKind) -> Result<Program, Error> {
        assert!(TierKind::present().contains(&tier), "not on this machine");
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let emitted = emit::emit(module, tier)?;
        Ok(Program {
            number: NUMBER.fetch_add(1, Ordering::Relaxed),
            stage: module.stage,
            code: emitted.code,
            inputs: module.inputs.clone(),
            query_words: module.query_words.clone(),
            local_size: module.local_size,
            quads: module.quads,
            shared_size_bytes: module.shared_size_bytes,
            layout: emitted.layout,
            private: emitted.private,
            private_rows: emitted.private_rows,
            live_rows: emitted.live_rows,
            sites: emitted.sites,
            output_rows: module.output_rows,
            outputs: module.outputs.clone(),
            passed: passed(module),
            fragment: module.fragment,
            functions: module.functions.len(),
        })
    }

    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Input rows the program reads, in order; row `i` of the state's inputs is `inputs()[i]`.
    #[inline]
    pub fn inputs(&self) -> &[InputRow] {
        &self.inputs
    }

    /// Compute: the workgroup's size per dimension.
    pub fn local_size(&self) -> [u32; 3] {
        self.local_size
    }

    /// Compute: four consecutive lanes are two by two invocations of the workgroup, instead of four in a row.
    pub fn quads(&self) -> bool {
        self.quads
    }

    /// Compute: workgroup memory in bytes.
    pub fn shared_size_bytes(&self) -> u32 {
        self.shared_size_bytes
    }

    /// Rows of a subgroup's state.
    #[inline]
    pub fn layout(&self) -> StateLayout {
        self.layout
    }

    /// Subgroups that one run may take (wave length / 16): follows from the frame's size.
    pub fn max_wave_subgroups(&self) -> usize {
        let subgroup_bytes = self.code.vector_rows.max(1) * size_of::<AlignedRow>();
        (FRAME_BYTES / subgroup_bytes).clamp(4, MAX_SUBGROUPS)
    }

    /// What yields ask for, by `SiteId`.
    #[inline]
    pub fn sites(&self) -> &[SiteKind] {
        &self.sites
    }

    /// What the objects of its ray queries hold behind their fixed rows.
    pub fn query_words(&self) -> &[QueryWord] {
        &self.query_words
    }

    /// The per-lane memory of a state.
    ///
    /// # Panics
    /// The state is smaller than [`StateLayout::rows`].
    pub fn private_rows<'s>(&self, state: &'s mut [AlignedRow]) -> &'s mut [AlignedRow] {
        &mut state[self.private..self.private + self.private_rows]
    }

    /// Words the program leaves in the `io` rows at its end (see `ir::Module::output_rows`).
    #[inline]
    pub fn output_rows(&self) -> u32 {
        self.output_rows
    }

    /// Vertex and fragment: what each word is that the program leaves.
    #[inline]
    pub fn outputs(&self) -> &[OutputRow] {
        &self.outputs
    }

    /// Vertex and fragment: where each of those words comes from, if the program computes none of them.
    #[inline]
    pub fn passed(&self) -> Option<&[Passed]> {
        self.passed.as_deref()
    }

    /// Fragment: what the rasterizer must know.
    #[inline]
    pub fn fragment(&self) -> Option<&FragmentFacts> {
        self.fragment.as_ref()
    }

    /// Bytes of one lane's state: what `vkGetRayTracingShaderGroupStackSizeKHR` reports.
    pub fn stack_size_bytes(&self) -> u32 {
        ((self.private_rows + self.live_rows) * 4) as u32
    }

    /// Puts a state at the program's entry with these lanes active. Inputs may be filled before or after; `io` rows are zeroed.
    ///
    /// # Panics
    /// The state is smaller than [`StateLayout::rows`].
    pub fn start(&self, state: &mut [AlignedRow], active: u16) {
        let state = &mut state[..self.layout.rows];
        state[..self.layout.inputs].fill(AlignedRow::default());
        // Private memory too: what is undefined is at least the same on every run.
        state[self.layout.io..self.private + self.private_rows].fill(AlignedRow::default());
        state[0].0[1] = active as u32;
    }

    /// As [`Self::start`] for a fragment program: `helpers`, some of the active lanes, are helper invocations.
    ///
    /// # Panics
    /// As [`Self::start`].
    pub fn start_fragments(&self, state: &mut [AlignedRow], active: u16, helpers: u16) {
        self.start(state, active);
        state[0].0[2] = helpers as u32;
    }

    /// Lanes of a fragment program's ended state that are helper invocations: from the start, or since they were demoted or killed.
    #[inline]
    pub fn helpers(&self, state: &[AlignedRow]) -> u16 {
        state[0].0[2] as u16
    }

    /// Where a state stands.
    #[inline]
    pub fn resume_point(&self, state: &[AlignedRow]) -> ResumePoint {
        ResumePoint(state[0].0[0])
    }

    /// Lanes of a yielded state that take part in its event (may be none: such a subgroup is ready at once). Only their columns
    /// of the `io` rows are the event's: the others may hold outputs of lanes that have ended.
    #[inline]
    pub fn event_mask(&self, state: &[AlignedRow]) -> u16 {
        state[0].0[1] as u16
    }

    /// Differs from every other program's in the process.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// What was asked for where a state stands; `None` at the entry and where fuel ran out.
    pub fn site_of(&self, point: ResumePoint) -> Option<SiteKind> {
        let (point, _) = self.code.point_of(point.0);
        point.site.map(|site| self.sites[site.0 as usize])
    }

    /// Whether lanes of a yielded state wait in an enclosing construct for those that take part in the event.
    pub fn has_parked_lanes(&self, state: &[AlignedRow]) -> bool {
        let (point, _) = self.code.point_of(state[0].0[0]);
        yields::has_parked_lanes(state, point.masks)
    }

    /// Makes up a yielded state from lanes of other states, all of which stand at one point: lane `k` is column `from[k].1` of
    /// `from[k].0`. Lanes that are not `active` may be anything; lanes that wait for others in enclosing constructs stay behind.
    ///
    /// # Panics
    /// A state is smaller than [`StateLayout::rows`].
    pub fn gather_lanes(
        &self,
        state: &mut [AlignedRow],
        active: u16,
        from: &[(&[AlignedRow], usize); SUBGROUP_SIZE],
    ) {
        let inputs = self.layout.inputs;
        state[..inputs].fill(AlignedRow::default());
        state[0].0[0] = from[0].0[0].0[0];
        state[0].0[1] = active as u32;
        let from = from.map(|(source, lane)| (&source[..self.layout.rows], lane));
        for (row, to) in state[..self.layout.rows]
            .iter_mut()
            .enumerate()
            .skip(inputs)
        {
            to.0 = from.map(|(source, lane)| source[row].0[lane]);
        }
        // Values of 64 bits are saved as such, over two rows.
        let (point, context) = self.code.point_of(state[0].0[0]);
        let callers = self.code.path(point.function, context);
        let saved = std::iter::once(&point.live).chain(callers.map(|site| &site.live));
        for value in saved
            .flat_map(|live| &live.saved)
            .filter(|value| value.wide && !value.input)
        {
            let place = |word: usize| {
                (
                    value.row as usize + word / SUBGROUP_SIZE,
                    word % SUBGROUP_SIZE,
                )
            };
            for (k, (source, lane)) in from.iter().enumerate() {
                for half in 0..2 {
                    let (row, column) = place(2 * lane + half);
                    let word = source[row].0[column];
                    let (row, column) = place(2 * k + half);
                    state[row].0[column] = word;
                }
            }
        }
    }

    /// Takes the lanes of a yielded state's event out of it: they go on elsewhere, those that wait for them go on without them.
    pub fn leave_parked_lanes(&self, state: &mut [AlignedRow]) {
        state[0].0[1] = 0;
    }

    /// Runs a wave of subgroups that stand at one resume point until the next event. `fuel` is burnt at loop back-edges and calls, by the
    /// length of the code and for the whole wave.
    ///
    /// # Safety
    /// Until it returns, `wave.shared` points to [`Self::shared_size_bytes`] bytes, and in `wave.environment` every table has as many
    /// descriptors as it says, each of them as [`Descriptor`](crate::environment::Descriptor) has it, with memory, images and samplers
    /// that are there; `reach` holds memory that may be read and written. Other threads may write all that meanwhile, but for descriptors.
    /// States hold what [`Self::start`] and earlier runs of this program left there, besides inputs and answers.
    ///
    /// # Panics
    /// The wave is empty or longer than [`Self::max_wave_subgroups`], or a state is too small or stands elsewhere.
    pub unsafe fn run(&self, frame: &mut Frame, wave: &mut Wave<'_>, fuel: &mut u64) -> Event {
        let subgroups = wave.states.len();
        assert!((1..=MAX_SUBGROUPS).contains(&subgroups), "wave length");
        let mut states = [std::ptr::null_mut(); MAX_SUBGROUPS];
        let point = wave.states[0][0].0[0];
        for (pointer, state) in states.iter_mut().zip(wave.states.iter_mut()) {
            assert!(state.len() >= self.layout.rows, "state too small");
            assert_eq!(state[0].0[0], point, "subgroups at different points");
            *pointer = state.as_mut_ptr().cast::<u32>();
        }
        assert!(point < self.code.points_end(), "state of another program");
        let Ok(uniforms) = frame.prepare(self, subgroups) else {
            return Event::OutOfMemory;
        };
        // The prologue runs once for an environment.
        let is_computed = uniforms.environment == wave.environment.number;
        uniforms.environment = wave.environment.number;
        let uniforms = uniforms.rows.as_mut_ptr();
        let mut machine = Machine {
            program: self,
            environment: wave.environment,
            uniforms: uniforms.cast(),
            vectors: frame.vectors.as_mut_ptr().cast(),
            row_bytes: subgroups * size_of::<[u32; SUBGROUP_SIZE]>(),
            list: [0; MAX_SUBGROUPS],
            list_len: 0,
            active: [0; MAX_SUBGROUPS],
            helpers: [0; MAX_SUBGROUPS],
            masks: frame.masks.as_mut_ptr(),
            pc: if is_computed {
                self.code.prologue_end
            } else {
                0
            },
            running: true,
            event: Event::End,
            fuel: *fuel,
            context: 0,
            returns: frame.returns.as_mut_ptr(),
            states,
            subgroups,
            shared: wave.shared,
            near: Cell::new(wave.environment.reach.likely()),
        };
        // SAFETY: the frame and the states have the sizes that the program asks for, and stay put during the run; what
        // the environment points to is kept by the caller.
        unsafe {
            // The prologue computes uniform rows in the place of the first subgroup.
            let mut first = [0; MAX_SUBGROUPS];
            first[0] = !0;
            machine.set_active(first);
            machine.go();
        }
        *fuel = machine.fuel;
        machine.event
    }
}

impl Frame {
    /// Makes room for a program and a wave length, and gives the program's uniform rows, with its constants in them.
    fn prepare(
        &mut self,
        program: &Program,
        subgroups: usize,
    ) -> Result<&mut Uniforms, TryReserveError> {
        let code = &program.code;
        grow(&mut self.vectors, code.vector_rows * subgroups)?;
        grow(&mut self.masks, code.masks)?;
        grow(&mut self.returns, program.functions)?;
        let place = match code.uniform_rows {
            0..=KEPT_ROWS => program.number as usize % KEPT_PROGRAMS,
            _ => KEPT_PROGRAMS,
        };
        grow(&mut self.uniforms, place + 1)?;
        let uniforms = &mut self.uniforms[place];
        if uniforms.program != program.number {
            uniforms.environment = 0;
            grow(&mut uniforms.rows, code.uniform_rows)?;
            uniforms.rows[..code.constants.len()].copy_from_slice(&code.constants);
            uniforms.program = program.number;
        }
        Ok(uniforms)
    }
}

fn grow<T: Default>(rows: &mut Vec<T>, len: usize) -> Result<(), TryReserveError> {
    if rows.len() < len {
        rows.try_reserve(len - rows.len())?;
        rows.resize_with(len, T::default);
    }
    Ok(())
}
