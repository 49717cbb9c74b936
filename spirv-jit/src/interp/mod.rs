//! The vector interpreter: each operation runs over the lanes of a wave.
//!
//! ```text
//! plan ──> fusion, slots (rows by live ranges) ──> emit ──> code: instructions that point at their kernels
//! ```
//!
//! * [`machine`]: a running wave; [`tier`]: instruction sets; [`kernels`]: pure operations;
//!   [`access`] by [`gather`], [`memory`], [`descriptors`], [`atomics`], [`subgroup`], [`matrix`],
//!   [`vector_product`], [`images`]: the others; [`control`]: masks and jumps; [`yields`]:
//!   suspending and resuming.

mod aborts;
mod access;
mod atomics;
mod code;
mod control;
mod descriptors;
mod emit;
mod fusion;
mod gather;
mod images;
mod kernels;
mod machine;
mod matrix;
mod memory;
pub mod modulate;
mod native;
mod operand;
mod prints;
mod region;
mod slots;
mod subgroup;
mod tier;
mod vector_product;
mod yields;

#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::collections::TryReserveError;

use lanes::{AlignedRow, LaneMask};

use crate::native as native_code;
use crate::plan::Plan;
use crate::state::{Event, Wave};
pub(crate) use code::PrintPlan;
pub(crate) use emit::emit;
pub(crate) use machine::Code;
pub use machine::MAX_SUBGROUPS;
use machine::{Machine, Mask, NO_LANES};

/// The size of a frame's rows, in bytes, that fits the nearest cache.
const FRAME_BYTES: usize = 40 << 10;

/// A worker's hot memory: slots of the program that is running. One per thread, reused for every
/// program.
#[derive(Default)]
pub struct Frame {
    /// By program, those that share a number's last digits in turn; the last for programs with many
    /// rows.
    uniforms: Vec<Uniforms>,
    vectors: Vec<AlignedRow>,
    masks: Vec<Mask>,
    returns: Vec<u32>,
    /// Goes with the messages of shaders: see [`Record::order`](crate::printf::Record::order).
    pub order: u64,
    /// Rows of outputs that the caller reads, where those are not all: the first ones.
    pub outputs: Option<usize>,
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

impl Code {
    /// Subgroups that one run may take: follows from the frame's size.
    pub fn max_wave_subgroups(&self) -> usize {
        let subgroup_bytes = self.vector_rows * size_of::<AlignedRow>();
        (FRAME_BYTES / subgroup_bytes).clamp(4, MAX_SUBGROUPS)
    }

    /// Bytes of rows that a frame needs for a wave of that many subgroups.
    pub fn frame_bytes(&self, subgroups: usize) -> usize {
        (self.vector_rows * subgroups + self.uniform_rows) * size_of::<AlignedRow>()
    }

    /// Whether stretches of it are native code.
    pub fn has_native_code(&self) -> bool {
        self.native.is_some()
    }

    /// Counts of its native code; zeros if it has none.
    pub fn native_counts(&self) -> native_code::NativeCounts {
        let code = self.native.as_ref().map(|native| native.bytes());
        code.map_or_else(Default::default, |code| {
            native_code::count(code, &self.listed)
        })
    }

    /// The text of its native code, if it has any.
    pub fn native_text(&self) -> Option<String> {
        let code = self.native.as_ref()?.bytes();
        Some(native_code::text(code, &self.listed))
    }

    /// Loops that are native code.
    #[cfg(test)]
    pub fn native_loops(&self) -> usize {
        let run: machine::Handler = native::run_loop;
        let is_loop = |i: &&machine::Instr| std::ptr::fn_addr_eq(i.handler, run);
        self.instrs.iter().filter(is_loop).count()
    }

    /// Operands of the yield at a point that are uniform in a dispatch, a bit each.
    pub fn uniform_operands(&self, point: usize) -> u16 {
        self.points[point].uniform_operands
    }

    /// The SPIR-V instruction, by its word offset, of an access through a physical pointer, and
    /// whether it writes. Accesses are known by the instruction behind them.
    pub fn physical_access(&self, behind: usize) -> Option<(u32, bool)> {
        let index = (self.physical).binary_search_by_key(&behind, |access| access.pc as usize);
        let access = &self.physical[index.ok()?];
        Some((access.source, access.writes))
    }

    /// The messages of its shader, by site.
    pub fn prints(&self) -> &[PrintPlan] {
        &self.prints
    }

    /// Runs a wave of program `number`, whose plan this was emitted from, to its next event.
    ///
    /// # Safety
    /// As for [`Program::run`](crate::Program::run); states are large enough.
    ///
    /// # Errors
    /// The frame's memory was refused; nothing was run.
    #[inline]
    pub unsafe fn run(
        &self,
        plan: &Plan,
        (number, shared_size_bytes): (u64, u32),
        frame: &mut Frame,
        wave: &mut Wave<'_>,
        fuel: &mut u64,
    ) -> Result<Event, TryReserveError> {
        let subgroups = wave.states.len();
        let mut states = [std::ptr::null_mut(); MAX_SUBGROUPS];
        for (pointer, state) in states.iter_mut().zip(wave.states.iter_mut()) {
            *pointer = state.as_mut_ptr().cast::<u32>();
        }
        let uniforms = frame.prepare(self, plan, number, subgroups)?;
        // The prologue runs once for an environment.
        let is_computed = uniforms.environment == wave.environment.number;
        uniforms.environment = wave.environment.number;
        let uniforms = uniforms.rows.as_mut_ptr();
        let mut machine = Machine {
            plan,
            code: self,
            program: number,
            shared_size_bytes,
            environment: wave.environment,
            uniforms: uniforms.cast(),
            vectors: frame.vectors.as_mut_ptr().cast(),
            frame_bytes: self.vector_rows * size_of::<AlignedRow>(),
            list: [0; MAX_SUBGROUPS],
            list_len: 0,
            occupied: 0,
            active: NO_LANES,
            helpers: NO_LANES,
            masks: frame.masks.as_mut_ptr(),
            pc: if is_computed { self.prologue_end } else { 0 },
            running: true,
            event: Event::End,
            fuel: *fuel,
            context: 0,
            returns: frame.returns.as_mut_ptr(),
            states,
            subgroups,
            shared: wave.shared,
            is_whole: wave.is_whole,
            outputs_to: wave.outputs_to,
            order: frame.order,
            outputs: frame.outputs.unwrap_or(usize::MAX),
            near: Cell::new(wave.environment.reach.likely()),
        };
        // SAFETY: the frame and the states have the sizes that the program asks for, and stay put
        // during the run; what the environment points to is kept by the caller.
        unsafe {
            // The prologue computes uniform rows in the place of the first subgroup.
            let mut first = NO_LANES;
            first[0] = LaneMask::ALL;
            machine.set_active(first);
            machine.go();
        }
        *fuel = machine.fuel;
        Ok(machine.event)
    }
}

impl Frame {
    /// Bytes of the rows that it holds, besides the uniform rows of small programs.
    pub fn bytes(&self) -> usize {
        let large = self.uniforms.get(KEPT_PROGRAMS);
        let rows = self.vectors.capacity() + large.map_or(0, |uniforms| uniforms.rows.capacity());
        rows * size_of::<AlignedRow>()
    }

    /// Makes room for a program and a wave length, and gives the program's uniform rows, with its
    /// constants in them.
    fn prepare(
        &mut self,
        code: &Code,
        plan: &Plan,
        program: u64,
        subgroups: usize,
    ) -> Result<&mut Uniforms, TryReserveError> {
        grow(&mut self.vectors, code.vector_rows * subgroups)?;
        grow(&mut self.masks, plan.masks)?;
        grow(&mut self.returns, plan.functions())?;
        let place = match code.uniform_rows {
            0..=KEPT_ROWS => program as usize % KEPT_PROGRAMS,
            _ => KEPT_PROGRAMS,
        };
        grow(&mut self.uniforms, place + 1)?;
        let uniforms = &mut self.uniforms[place];
        if uniforms.program != program {
            uniforms.environment = 0;
            grow(&mut uniforms.rows, code.uniform_rows)?;
            uniforms.rows[..code.constants.len()].copy_from_slice(&code.constants);
            uniforms.program = program;
        }
        Ok(uniforms)
    }
}

fn grow<T: Default>(rows: &mut Vec<T>, len: usize) -> Result<(), TryReserveError> {
    if rows.len() < len {
        rows.try_reserve_exact(len - rows.len())?;
        rows.resize_with(len, T::default);
    }
    Ok(())
}
