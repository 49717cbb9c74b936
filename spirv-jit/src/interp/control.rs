//! Control flow: masks of lanes that are active, parked at a label, or pending for an `else`.
//!
//! In `x` or `y` an instruction has the index of a mask or a code address, as each says.

#[cfg(not(target_arch = "x86_64"))]
use lanes::LaneMask;

use super::kernels::sign_bits;
use super::machine::{Instr, MAX_SUBGROUPS, Machine, Mask, NO_LANES, occupied};
use super::operand::Operand;
use super::tier::Kernel;
use crate::SUBGROUP_SIZE;
use crate::state::Event;

/// A parked or pending mask.
///
/// # Safety
/// `index` is one of the program's.
#[inline(always)]
pub(super) unsafe fn mask<'m>(m: &Machine<'_>, index: u32) -> &'m mut Mask {
    // SAFETY: the frame holds every mask that the program names, and nothing else refers to it
    // meanwhile.
    unsafe { &mut *m.masks.add(index as usize) }
}

/// Enters a construct: no lane is parked at label `x`.
///
/// # Safety
/// As for every handler: the instruction was emitted for the program that the machine runs.
pub(super) unsafe fn enter(m: &mut Machine<'_>, i: &Instr) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe { *mask(m, i.x) = NO_LANES };
}

/// Parks the active lanes at label `x` and goes to `y`, the end of the body.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn park(m: &mut Machine<'_>, i: &Instr) {
    // SAFETY: the caller keeps the contract of this function.
    let parked = unsafe { mask(m, i.x) };
    for (parked, active) in parked.iter_mut().zip(&m.active) {
        *parked |= *active;
    }
    m.pc = i.y as usize;
}

/// The lanes parked at label `x` go on together, and the mask is empty then; if there are none, to
/// `y`, the end of the enclosing body.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn join(m: &mut Machine<'_>, i: &Instr) {
    // SAFETY: the caller keeps the contract of this function.
    let parked = std::mem::take(unsafe { mask(m, i.x) });
    if !m.set_active(parked) {
        m.pc = i.y as usize;
    }
}

/// `if a`: lanes where it does not hold become pending in mask `x + 1`; none is parked at `x`.
/// Without lanes for the first body, on to `y`.
pub(super) struct Branch;

impl Kernel for Branch {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: as for every handler.
        unsafe {
            *mask(m, i.x) = NO_LANES;
            let pending = mask(m, i.x + 1);
            let words = sign_words(m, i.a);
            split(&mut m.active, pending, words);
            if !m.list_occupied(occupied(&m.active)) {
                m.pc = i.y as usize;
            }
        }
    }
}

/// The sign bits of a row, of subgroups with active lanes: those of four subgroups to a word.
///
/// # Safety
/// As [`Machine::block`]; the lanes are words.
#[inline(always)]
unsafe fn sign_words(m: &Machine<'_>, row: Operand) -> [u64; MAX_SUBGROUPS / 4] {
    let mut words = [0; MAX_SUBGROUPS / 4];
    for (four, word) in words.iter_mut().enumerate() {
        for k in 0..4 {
            let subgroup = 4 * four + k;
            if m.occupied >> subgroup & 1 != 0 {
                // SAFETY: the caller keeps the contract of this function.
                let signs = unsafe { sign_bits(&*m.block::<u32>(row, subgroup as u16)) };
                *word |= u64::from(signs.bits()) << (16 * k);
            }
        }
    }
    words
}

/// Leaves those of the active lanes active that are in `words`; the others become pending.
///
/// Half a mask at a time: one that is read right after smaller parts of it were written would have
/// to wait for those.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn split(active: &mut Mask, pending: &mut Mask, words: [u64; MAX_SUBGROUPS / 4]) {
    use std::arch::x86_64::*;
    let active = active.as_mut_ptr().cast::<__m128i>();
    let pending = pending.as_mut_ptr().cast::<__m128i>();
    for half in 0..2 {
        // SAFETY: every x86-64 processor has SSE2; a mask is two registers long.
        unsafe {
            let holds = _mm_set_epi64x(words[2 * half + 1] as i64, words[2 * half] as i64);
            let before = _mm_loadu_si128(active.add(half));
            _mm_storeu_si128(pending.add(half), _mm_andnot_si128(holds, before));
            _mm_storeu_si128(active.add(half), _mm_and_si128(holds, before));
        }
    }
}

/// Leaves those of the active lanes active that are in `words`; the others become pending.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn split(active: &mut Mask, pending: &mut Mask, words: [u64; MAX_SUBGROUPS / 4]) {
    for s in 0..MAX_SUBGROUPS {
        let holds = LaneMask::from_bits((words[s / 4] >> (16 * (s % 4))) as u16);
        pending[s] = active[s] - holds;
        active[s] = active[s] & holds;
    }
}

/// A loop's end: lanes parked at its label `x` start the next iteration at `y`, for `b` fuel,
/// unless that is out: then the wave is suspended at point `a`. Without lanes, control falls
/// through.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn back_edge(m: &mut Machine<'_>, i: &Instr) {
    // SAFETY: the caller keeps the contract of this function.
    let parked = unsafe { *mask(m, i.x) };
    if !m.set_active(parked) {
        return;
    }
    if m.fuel == 0 {
        // SAFETY: the point's number was emitted with the instruction, after the code address.
        unsafe { super::yields::suspend_without_fuel(m, i.a.raw()) };
        return;
    }
    m.fuel = m.fuel.saturating_sub(i.b.raw().into());
    m.pc = i.y as usize;
}

/// Where a function begins: takes `b` fuel, or suspends the wave at point `a` if there is none.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn burn(m: &mut Machine<'_>, i: &Instr) {
    if m.fuel == 0 {
        // SAFETY: the point's number was emitted with the instruction.
        unsafe { super::yields::suspend_without_fuel(m, i.a.raw()) };
        return;
    }
    m.fuel = m.fuel.saturating_sub(i.b.raw().into());
}

/// Goes to `y` if no lane is active.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn jump_if_empty(m: &mut Machine<'_>, i: &Instr) {
    if m.list_len == 0 {
        m.pc = i.y as usize;
    }
}

/// Goes to `y`.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn jump(m: &mut Machine<'_>, i: &Instr) {
    m.pc = i.y as usize;
}

/// The active lanes are gone for ever; on to `y`, the end of the body.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn kill(m: &mut Machine<'_>, i: &Instr) {
    m.pc = i.y as usize;
}

/// Calls through call site `x`, to `y`.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn call(m: &mut Machine<'_>, i: &Instr) {
    let site = &m.plan.calls[i.x as usize];
    // SAFETY: there is a return address for every function.
    unsafe { *m.returns.add(site.callee as usize) = m.pc as u32 };
    m.context += site.context;
    m.pc = i.y as usize;
}

/// Leaves function `x` with the lanes parked in mask `y`.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn ret(m: &mut Machine<'_>, i: &Instr) {
    // SAFETY: as for `call`; the function was called.
    unsafe {
        let parked = *mask(m, i.y);
        m.set_active(parked);
        m.pc = *m.returns.add(i.x as usize) as usize;
        // The call stands before the return address.
        let call = &m.code.instrs[m.pc - 1];
        m.context -= m.plan.calls[call.x as usize].context;
    }
}

/// The active lanes become helper invocations.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn demote(m: &mut Machine<'_>, _: &Instr) {
    for (helpers, active) in m.helpers.iter_mut().zip(&m.active) {
        *helpers |= *active;
    }
}

/// `d`: whether a lane is a helper invocation.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn is_helper(m: &mut Machine<'_>, i: &Instr) {
    for &subgroup in m.listed() {
        let helpers = m.helpers[subgroup as usize];
        for k in 0..SUBGROUP_SIZE {
            let word = if helpers.contains(k) { u32::MAX } else { 0 };
            // SAFETY: the caller keeps the contract of this function.
            unsafe { m.set_lane(i.d, subgroup, k, false, word.into()) };
        }
    }
}

/// The end of the entry function.
///
/// # Safety
/// As [`enter`].
pub(super) unsafe fn finish(m: &mut Machine<'_>, _: &Instr) {
    for s in 0..m.subgroups {
        // SAFETY: a state begins with its control words.
        unsafe { *m.states[s].add(2) = m.helpers[s].bits().into() };
    }
    m.event = Event::End;
    m.running = false;
}
