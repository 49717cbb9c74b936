//! The running state of a wave, and how an instruction's operands become pointers.
//!
//! A value of 32 bits or less is a *row* of lanes of 32 bits (narrow integers zero-extended,
//! booleans 0 or all ones), 64-bit values take two consecutive rows holding lanes of 64 bits. Each
//! subgroup of the wave has a frame of *vector* rows of its own, one frame behind another;
//! *uniform* rows have 16 equal lanes and serve all subgroups: from one to the next it is 0 bytes,
//! so that every kernel takes either kind for each operand.

use std::cell::Cell;

use lanes::{AlignedRow, LaneMask};

use super::code::{
    AccessPlan, AtomicPlan, ImagePlan, LoopPlan, PhysicalAccess, PrintPlan, ProductPlan, Remade,
    ResumeTarget, Return, Saved, SubgroupPlan, VectorPlan,
};
use super::operand::Operand;
use crate::SUBGROUP_SIZE;
use crate::environment::Environment;
use crate::ir::op::DescriptorBinding;
use crate::native::{Executable, Listed};
use crate::plan::Plan;
use crate::reach::Range;
use crate::state::Event;

/// Subgroups in the longest wave.
pub const MAX_SUBGROUPS: usize = 16;

/// The lanes of a wave, by subgroup.
pub(super) type Mask = [LaneMask; MAX_SUBGROUPS];

pub(super) const NO_LANES: Mask = [LaneMask::NONE; MAX_SUBGROUPS];

/// Performs one instruction. `pc` already stands behind it.
pub(super) type Handler = for<'a, 'i, 'p> unsafe fn(&'a mut Machine<'p>, &'i Instr);

/// An instruction: what performs it, destination, sources, and two words whose meaning is the
/// handler's.
#[derive(Clone, Copy)]
pub(super) struct Instr {
    pub handler: Handler,
    pub d: Operand,
    pub a: Operand,
    pub b: Operand,
    pub c: Operand,
    pub x: u32,
    pub y: u32,
}

/// Instructions and the tables they refer to.
#[derive(Default)]
pub(crate) struct Code {
    pub(super) instrs: Vec<Instr>,
    pub(super) operands: Vec<Operand>,
    pub(super) accesses: Vec<AccessPlan>,
    pub(super) atomics: Vec<AtomicPlan>,
    pub(super) bindings: Vec<DescriptorBinding>,
    pub(super) subgroups: Vec<SubgroupPlan>,
    pub(super) products: Vec<ProductPlan>,
    pub(super) vector_products: Vec<VectorPlan>,
    pub(super) images: Vec<ImagePlan>,
    pub(super) prints: Vec<PrintPlan>,
    /// As many as the plan keeps, in the same order.
    pub(super) saved: Vec<Saved>,
    pub(super) remade: Vec<Remade>,
    /// In the plan's order.
    pub(super) points: Vec<ResumeTarget>,
    pub(super) calls: Vec<Return>,
    pub(super) loops: Vec<LoopPlan>,
    /// Ascending by `pc`.
    pub(super) physical: Vec<PhysicalAccess>,
    /// Words of tables, and zeros behind them.
    pub(super) tables: Vec<Vec<u32>>,
    /// The pages of native stretches.
    pub(super) native: Option<Executable>,
    /// Its stretches and loops, for tools.
    pub(super) listed: Vec<Listed>,
    /// Constants: the first uniform rows.
    pub(super) constants: Vec<AlignedRow>,
    /// Behind the instructions that compute uniform rows.
    pub(super) prologue_end: usize,
    /// Uniform rows.
    pub(super) uniform_rows: usize,
    /// Vector rows of a subgroup: an odd number.
    pub(super) vector_rows: usize,
}

/// A wave while it runs.
pub(super) struct Machine<'p> {
    pub plan: &'p Plan,
    pub code: &'p Code,
    /// Its number.
    pub program: u64,
    pub shared_size_bytes: u32,
    pub environment: &'p Environment,
    /// Rows of 64 bytes.
    pub uniforms: *mut u8,
    /// A frame of `frame_bytes` for each subgroup.
    pub vectors: *mut u8,
    pub frame_bytes: usize,
    /// The subgroups that have active lanes, ascending.
    pub list: [u16; MAX_SUBGROUPS],
    pub list_len: usize,
    /// The same subgroups, a bit each.
    pub occupied: u16,
    pub active: Mask,
    /// Helper invocations of a fragment program, active or not.
    pub helpers: Mask,
    /// Parked and pending masks.
    pub masks: *mut Mask,
    pub pc: usize,
    pub running: bool,
    pub event: Event,
    pub fuel: u64,
    /// Number of the call path: see `calls`.
    pub context: u32,
    /// Return address of each function that is being called.
    pub returns: *mut u32,
    /// First words of the states.
    pub states: [*mut u32; MAX_SUBGROUPS],
    pub subgroups: usize,
    /// Workgroup memory by subgroup, if there is any.
    pub shared: &'p [*mut u8],
    /// See [`Wave::is_whole`](crate::state::Wave::is_whole).
    pub is_whole: bool,
    /// See [`Wave::outputs_to`](crate::state::Wave::outputs_to).
    pub outputs_to: &'p [*mut AlignedRow],
    /// Of the frame.
    pub order: u64,
    /// Rows of outputs that are read, the first ones.
    pub outputs: usize,
    /// Where the last physical pointer led that was looked up.
    pub near: Cell<Range>,
}

impl Machine<'_> {
    /// Sets the active lanes; true if there are any.
    #[inline]
    pub fn set_active(&mut self, mask: Mask) -> bool {
        self.active = mask;
        self.list_occupied(occupied(&mask))
    }

    /// Lists the subgroups with active lanes, of which there is a bit each; true if there are any.
    #[inline(always)]
    pub fn list_occupied(&mut self, occupied: u16) -> bool {
        // Mostly control flow takes lanes from subgroups, but no subgroup from the wave.
        if occupied != self.occupied {
            self.occupied = occupied;
            let (mut len, mut rest) = (0, occupied);
            while rest != 0 {
                self.list[len] = rest.trailing_zeros() as u16;
                rest &= rest - 1;
                len += 1;
            }
            self.list_len = len;
        }
        occupied != 0
    }

    /// Subgroups with active lanes.
    #[inline(always)]
    pub fn listed(&self) -> &[u16] {
        // SAFETY: `set_active` counts at most `MAX_SUBGROUPS`.
        unsafe { self.list.get_unchecked(..self.list_len) }
    }

    /// Runs of neighbours among the subgroups with active lanes: where each begins, and how many
    /// subgroups each has. One run where all are neighbours, as mostly, else a run for each.
    #[inline(always)]
    pub fn runs(&self) -> (&[u16], usize) {
        let listed = self.listed();
        match listed {
            [first, .., last] if (last - first) as usize == listed.len() - 1 => {
                (&listed[..1], listed.len())
            }
            _ => (listed, 1),
        }
    }

    /// The active lanes of a subgroup that may change memory: all but helper invocations.
    #[inline(always)]
    pub fn effective(&self, subgroup: u16) -> LaneMask {
        let s = subgroup as usize;
        self.active[s] - self.helpers[s]
    }

    /// The workgroup memory of a subgroup: first byte and size.
    #[inline(always)]
    pub fn workgroup_memory(&self, subgroup: u16) -> (*mut u8, u64) {
        let memory = self.shared.get(subgroup as usize).copied();
        let size_bytes = self.shared_size_bytes.into();
        (memory.unwrap_or(std::ptr::null_mut()), size_bytes)
    }

    /// A row's first byte, in the first subgroup's frame, and how many bytes it is from one
    /// subgroup to the next: 0 for uniform rows.
    ///
    /// # Safety
    /// `operand` is one of the running program's.
    #[inline(always)]
    pub unsafe fn row(&self, operand: Operand) -> (*mut u8, usize) {
        // SAFETY: the frame holds every row that the program names.
        unsafe {
            if operand.is_uniform() {
                (self.uniforms.add(operand.index() * 64), 0)
            } else {
                (self.vectors.add(operand.index() * 64), self.frame_bytes)
            }
        }
    }

    /// Lanes of type `S` (4 or 8 bytes) of a row of a subgroup.
    ///
    /// # Safety
    /// As [`Self::row`]; `S` has the width that the program gave the operand.
    #[inline(always)]
    pub unsafe fn block<S>(&self, operand: Operand, subgroup: u16) -> *mut [S; SUBGROUP_SIZE] {
        // SAFETY: as for `row`; the subgroup is one that the wave has.
        unsafe {
            let (base, step) = self.row(operand);
            base.add(subgroup as usize * step).cast()
        }
    }

    /// One lane of an operand, extended with zeros.
    ///
    /// # Safety
    /// As [`Self::block`]; `wide` tells 64-bit operands.
    #[inline(always)]
    pub unsafe fn lane(&self, operand: Operand, subgroup: u16, lane: usize, wide: bool) -> u64 {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if wide {
                (*self.block::<u64>(operand, subgroup))[lane]
            } else {
                (*self.block::<u32>(operand, subgroup))[lane] as u64
            }
        }
    }

    /// Writes one lane.
    ///
    /// # Safety
    /// As [`Self::block`].
    #[inline(always)]
    pub unsafe fn set_lane(
        &self,
        operand: Operand,
        subgroup: u16,
        lane: usize,
        wide: bool,
        value: u64,
    ) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if wide {
                (*self.block::<u64>(operand, subgroup))[lane] = value;
            } else {
                (*self.block::<u32>(operand, subgroup))[lane] = value as u32;
            }
        }
    }

    /// The 64-bit number that all lanes of a subgroup's mask have, if they do: the address of a
    /// descriptor, say. The mask is not empty.
    ///
    /// # Safety
    /// As [`Self::block`].
    #[inline(always)]
    pub unsafe fn common(&self, operand: Operand, subgroup: u16, mask: LaneMask) -> Option<u64> {
        // SAFETY: the caller keeps the contract of this function.
        let lanes = unsafe { &*self.block::<u64>(operand, subgroup) };
        let first = lanes[mask.first() & (SUBGROUP_SIZE - 1)];
        if operand.is_uniform() {
            return Some(first);
        }
        let mut same = 0u16;
        for (lane, &number) in lanes.iter().enumerate() {
            same |= ((number == first) as u16) << lane;
        }
        (mask - LaneMask::from_bits(same))
            .is_empty()
            .then_some(first)
    }

    /// A row of a subgroup's state.
    ///
    /// # Safety
    /// `row` is inside the state.
    #[inline(always)]
    pub unsafe fn state_row(&self, subgroup: usize, row: usize) -> *mut [u32; SUBGROUP_SIZE] {
        // SAFETY: `run` checked the states' lengths.
        unsafe { self.states[subgroup].add(row * SUBGROUP_SIZE).cast() }
    }

    /// The row that takes an output of a subgroup.
    ///
    /// # Safety
    /// The program has that output.
    #[inline(always)]
    pub unsafe fn output_row(&self, subgroup: usize, row: usize) -> *mut [u32; SUBGROUP_SIZE] {
        // SAFETY: `run` checked the states' lengths, and its caller has rows for all outputs.
        unsafe {
            match self.outputs_to.get(subgroup) {
                Some(rows) if !rows.is_null() => rows.add(row).cast(),
                _ => self.state_row(subgroup, self.plan.layout.io + row),
            }
        }
    }

    /// Runs until an event.
    ///
    /// # Safety
    /// The machine was set up by `Code::run`.
    pub unsafe fn go(&mut self) {
        let code = self.code.instrs.as_slice();
        while self.running {
            // SAFETY: code addresses come from the emitter, and each path ends in an instruction
            // that stops.
            unsafe {
                let instr = code.get_unchecked(self.pc);
                self.pc += 1;
                (instr.handler)(self, instr);
            }
        }
    }
}

/// The subgroups that have lanes in a mask, a bit each.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn occupied(mask: &Mask) -> u16 {
    use std::arch::x86_64::*;
    // SAFETY: every x86-64 processor has SSE2; a mask is two registers long.
    unsafe {
        let at = mask.as_ptr().cast::<__m128i>();
        let zero = _mm_setzero_si128();
        let low = _mm_cmpeq_epi16(_mm_loadu_si128(at), zero);
        let high = _mm_cmpeq_epi16(_mm_loadu_si128(at.add(1)), zero);
        !(_mm_movemask_epi8(_mm_packs_epi16(low, high)) as u16)
    }
}

/// The subgroups that have lanes in a mask, a bit each.
#[cfg(not(target_arch = "x86_64"))]
pub(super) fn occupied(mask: &Mask) -> u16 {
    (0..MAX_SUBGROUPS).fold(0, |bits, s| bits | (!mask[s].is_empty() as u16) << s)
}
