//! Messages of invocations that abort, for the device's [`Aborts`](crate::abort::Aborts).

use super::machine::{Instr, Machine};
use crate::SUBGROUP_SIZE;
use crate::abort::{AbortedAt, NO_PLACE};

/// Reserves room for messages of `a` bytes; the places go to row `d`.
///
/// # Safety
/// As [`Kernel::run`](super::tier::Kernel::run).
#[cold]
pub(super) unsafe fn abort_message(m: &mut Machine<'_>, i: &Instr) {
    for &subgroup in m.listed() {
        let mut places = [NO_PLACE; SUBGROUP_SIZE];
        if let Some(aborts) = &m.environment.aborts {
            // SAFETY: the caller keeps the contract of `Kernel::run`; operands are rows of the
            // program's words.
            let sizes = unsafe { *m.block::<u32>(i.a, subgroup) };
            for lane in m.effective(subgroup) {
                places[lane] = aborts.reserve(sizes[lane]);
            }
        }
        // SAFETY: the caller keeps the contract of `Kernel::run`; operands are rows of the
        // program's words.
        let out = unsafe { &mut *m.block::<u32>(i.d, subgroup) };
        for lane in m.active[subgroup as usize] {
            out[lane] = places[lane];
        }
    }
}

/// Commits the messages at the places in row `a`; `x`: word offset of the instruction.
///
/// # Safety
/// As [`abort_message`].
#[cold]
pub(super) unsafe fn abort(m: &mut Machine<'_>, i: &Instr) {
    let Some(aborts) = &m.environment.aborts else {
        return;
    };
    let at = AbortedAt {
        program: m.program,
        source: i.x,
    };
    for &subgroup in m.listed() {
        // SAFETY: the caller keeps the contract of `Kernel::run`; operands are rows of the
        // program's words.
        let places = unsafe { *m.block::<u32>(i.a, subgroup) };
        for lane in m.effective(subgroup) {
            aborts.commit(places[lane], at);
        }
    }
}
