//! Suspending a wave into its subgroups' states, and resuming it: control rows are as
//! [`plan`](crate::plan) has them.

use std::ptr::null_mut;

use lanes::{LaneMask, Row};

use super::descriptors;
use super::machine::{Instr, MAX_SUBGROUPS, Machine, NO_LANES};
use super::operand::Operand;
use super::tier::Kernel;
use crate::SUBGROUP_SIZE;
use crate::plan::{CONTROL_WORDS, HeldOperands, List, Live};
use crate::state::{Event, IO_DATA_ROW};

/// Saves masks and live values as point `point` says, and stops with `event`.
///
/// # Safety
/// `point` is one of the program's, and control stands there.
#[inline(always)]
unsafe fn suspend(m: &mut Machine<'_>, point: u32, event: Event) {
    let id = m.plan.bases[point as usize] + m.context;
    let point = &m.code.points[point as usize];
    // SAFETY: the states have the program's layout.
    unsafe {
        for s in 0..m.subgroups {
            let control = m.states[s];
            *control = id;
            *control.add(1) = m.active[s].bits().into();
            *control.add(2) = m.helpers[s].bits().into();
            let masks = control.add(CONTROL_WORDS).cast::<LaneMask>();
            for k in 0..point.masks as usize {
                *masks.add(k) = (*m.masks.add(k))[s];
            }
        }
        save(m, point.live.saved);
        for (index, _) in m.plan.path(point.function, m.context) {
            save(m, m.code.calls[index].live.saved);
        }
    }
    m.event = event;
    m.running = false;
}

/// Where fuel is out: [`suspend`] for handlers outside of a tier.
///
/// # Safety
/// As [`suspend`].
#[cold]
#[inline(never)]
pub(super) unsafe fn suspend_without_fuel(m: &mut Machine<'_>, point: u32) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe { suspend(m, point, Event::OutOfFuel) };
}

/// Copies a row from the frame of each subgroup to its state.
///
/// # Safety
/// Row and operand are the program's.
#[inline(always)]
unsafe fn save_row(m: &Machine<'_>, operand: Operand, row: usize) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let (base, step) = m.row(operand);
        for s in 0..m.subgroups.min(MAX_SUBGROUPS) {
            *m.state_row(s, row) = *base.add(s * step).cast();
        }
    }
}

/// Copies a row from the state of each subgroup to its frame.
///
/// # Safety
/// Row and operand are the program's.
#[inline(always)]
unsafe fn restore_row(m: &Machine<'_>, row: usize, operand: Operand) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let (base, step) = m.row(operand);
        for s in 0..m.subgroups.min(MAX_SUBGROUPS) {
            *base.add(s * step).cast() = *m.state_row(s, row);
        }
    }
}

/// Copies a row from the state of each subgroup with active lanes to its frame.
///
/// # Safety
/// Row and operand are the program's.
#[inline(always)]
unsafe fn read_row(m: &Machine<'_>, row: usize, operand: Operand) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        if m.list_len == m.subgroups {
            return restore_row(m, row, operand);
        }
        let (base, step) = m.row(operand);
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            *base.add(s * step).cast() = *m.state_row(s, row);
        }
    }
}

/// Whether all lanes of the wave are active.
#[inline(always)]
fn is_whole(m: &Machine<'_>) -> bool {
    let mut active = m.active.iter().take(m.subgroups);
    m.list_len == m.subgroups && active.all(|&lanes| lanes == LaneMask::ALL)
}

/// # Safety
/// The states have the program's layout, the lists are the program's.
#[inline(always)]
unsafe fn save(m: &Machine<'_>, saved: List) {
    for range in m.plan.kept.values.ranges(saved) {
        for value in &m.code.saved[range] {
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                let row = value.row as usize;
                if !value.wide {
                    save_row(m, value.operand, row);
                    continue;
                }
                let (base, step) = m.row(value.operand);
                for s in 0..m.subgroups {
                    let to = m.state_row(s, row).cast::<[u64; SUBGROUP_SIZE]>();
                    *to = *base.add(s * step).cast();
                }
            }
        }
    }
}

/// # Safety
/// As [`save`].
#[inline(always)]
unsafe fn restore(m: &Machine<'_>, saved: List) {
    for range in m.plan.kept.values.ranges(saved) {
        for value in &m.code.saved[range] {
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                let row = value.row as usize;
                if !value.wide {
                    restore_row(m, row, value.operand);
                    continue;
                }
                let (base, step) = m.row(value.operand);
                for s in 0..m.subgroups {
                    let from = m.state_row(s, row).cast::<[u64; SUBGROUP_SIZE]>();
                    *base.add(s * step).cast() = *from;
                }
            }
        }
    }
}

/// # Safety
/// As [`save`].
#[inline(always)]
unsafe fn restore_values(m: &Machine<'_>, live: &Live) {
    // SAFETY: the caller guarantees that the states have the program's layout, the lists are the
    // program's; what descriptors are made of was restored before.
    unsafe {
        restore(m, live.saved);
        restore(m, live.inputs);
        for range in m.plan.kept.descriptors.ranges(live.remade) {
            descriptors::make_again(m, &m.code.remade[range]);
        }
    }
}

/// The end of the prologue: the wave, whose states stand at one point as [`suspend`] or
/// `Program::start` left them, goes on there.
pub(super) struct Resume;

impl Kernel for Resume {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, _: &Instr) {
        // SAFETY: the states have the program's layout.
        unsafe {
            let (index, context) = m.plan.point_of(*m.states[0]);
            let point = &m.code.points[index];
            m.context = context;
            m.pc = point.pc as usize;
            let mut active = NO_LANES;
            for (s, lanes) in active[..m.subgroups].iter_mut().enumerate() {
                *lanes = LaneMask::from_bits(*m.states[s].add(1) as u16);
                m.helpers[s] = LaneMask::from_bits(*m.states[s].add(2) as u16);
            }
            for k in 0..point.masks as usize {
                let mask = &mut *m.masks.add(k);
                *mask = NO_LANES;
                for (s, lanes) in mask[..m.subgroups].iter_mut().enumerate() {
                    *lanes = *m.states[s].add(CONTROL_WORDS).cast::<LaneMask>().add(k);
                }
            }
            restore_values(m, &point.live);
            for (index, site) in m.plan.path(point.function, context) {
                let place = &m.code.calls[index];
                *m.returns.add(site.callee as usize) = place.pc;
                restore_values(m, &place.live);
            }
            m.set_active(active);
        }
    }
}

/// Writes active lanes of an operand to an io row; `is_whole`: all lanes are.
///
/// # Safety
/// Row and operand are the program's.
#[inline(always)]
unsafe fn write_io(m: &Machine<'_>, operand: Operand, row: usize, is_whole: bool) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let row = m.plan.layout.io + row;
        if is_whole {
            return save_row(m, operand, row);
        }
        let (base, step) = m.row(operand);
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            let from = &*base.add(subgroup as usize * step).cast::<Row>();
            blend(&mut *m.state_row(s, row), from, m.active[s]);
        }
    }
}

/// The lanes of a mask from another row.
#[inline(always)]
pub(super) fn blend(to: &mut Row, from: &Row, mask: LaneMask) {
    if mask == LaneMask::ALL {
        *to = *from;
        return;
    }
    // From masks of whole words, so that it becomes a vector instead of sixteen branches.
    let mut taken = [0; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        let bit = 1 << k;
        taken[k] = if u32::from(mask.bits()) & bit == bit {
            u32::MAX
        } else {
            0
        };
    }
    for k in 0..SUBGROUP_SIZE {
        to[k] = from[k] & taken[k] | to[k] & !taken[k];
    }
}

/// A yield: operands `x..` (count in `b`) go to the io rows, the first `c` from row 0, the others
/// from [`IO_DATA_ROW`]; then the wave is suspended at point `y`.
pub(super) struct Yield;

impl Kernel for Yield {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let first = i.x as usize;
        let (count, fixed) = (i.b.raw() as usize, i.c.raw() as usize);
        let is_whole = is_whole(m);
        // SAFETY: the caller keeps the contract of `Kernel::run`.
        unsafe {
            for (k, &operand) in m.code.operands[first..first + count].iter().enumerate() {
                let row = if k < fixed {
                    k
                } else {
                    IO_DATA_ROW + k - fixed
                };
                write_io(m, operand, row, is_whole);
            }
            for &subgroup in m.listed() {
                *HeldOperands::of(m.states[subgroup as usize]) = HeldOperands::default();
            }
            suspend_at_site(m, i.y);
        }
    }
}

/// # Safety
/// As [`suspend`].
#[inline(always)]
unsafe fn suspend_at_site(m: &mut Machine<'_>, point: u32) {
    let site = m.code.points[point as usize].site;
    let event = site.map_or(Event::OutOfFuel, Event::Yield);
    // SAFETY: the caller keeps the contract of this function.
    unsafe { suspend(m, point, event) };
}

/// As [`Yield`], for yields that leave their first `c` operands in the io rows, in programs without
/// outputs: those that are uniform in the dispatch are written where they do not stand yet.
pub(super) struct YieldAgain;

impl Kernel for YieldAgain {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let first = i.x as usize;
        let (count, fixed) = (i.b.raw() as usize, i.c.raw() as usize);
        let (operands, data) = m.code.operands[first..first + count].split_at(fixed);
        let is_whole = is_whole(m);
        let here = HeldOperands {
            program: m.program,
            environment: m.environment.number,
            point: i.y.into(),
        };
        // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and the
        // machine runs its program. Nothing else is written to the io rows of such a program while
        // a state holds its operands.
        unsafe {
            let stand = |&s: &u16| *HeldOperands::of(m.states[s as usize]) == here;
            let all_stand = m.listed().iter().all(stand);
            for (row, &operand) in operands.iter().enumerate() {
                if !operand.is_uniform() {
                    write_io(m, operand, row, is_whole);
                } else if !all_stand {
                    // In all lanes: others may be active when it is not written.
                    let from = &*m.row(operand).0.cast::<Row>();
                    for &subgroup in m.listed() {
                        *m.state_row(subgroup as usize, m.plan.layout.io + row) = *from;
                    }
                }
            }
            for (row, &operand) in data.iter().enumerate() {
                write_io(m, operand, IO_DATA_ROW + row, is_whole);
            }
            if !all_stand {
                for &subgroup in m.listed() {
                    *HeldOperands::of(m.states[subgroup as usize]) = here;
                }
            }
            suspend_at_site(m, i.y);
        }
    }
}

/// A barrier of the workgroup, or a half of one, in the place of a [`Yield`] without operands. If
/// all subgroups of the wave's workgroups that have not ended are in the wave and have come to it,
/// all have met: they go on without an event. Each has come once more to a split barrier then,
/// which leaves their counts as far apart as they were.
pub(super) struct Barrier;

impl Kernel for Barrier {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        if !(m.is_whole && m.list_len == m.subgroups) {
            // SAFETY: the caller keeps the contract of `Kernel::run`.
            unsafe { Yield::run(m, i) };
        }
    }
}

/// After a yield: operands `x..` (count in `b`) are read from the io rows, from row `c` on.
pub(super) struct ReadIo;

impl Kernel for ReadIo {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let first = i.x as usize;
        let count = i.b.raw() as usize;
        for (k, &operand) in m.code.operands[first..first + count].iter().enumerate() {
            let row = m.plan.layout.io + i.c.raw() as usize + k;
            // SAFETY: the caller keeps the contract of `Kernel::run`.
            unsafe { read_row(m, row, operand) };
        }
    }
}

/// After a reported intersection: `d` is whether it was accepted; lanes whose search is over end.
/// After a query's event, which ends none: whether there is a candidate.
pub(super) struct ReadVerdict;

impl Kernel for ReadVerdict {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let mut active = m.active;
        for &subgroup in m.listed() {
            // SAFETY: the caller keeps the contract of `Kernel::run`.
            unsafe {
                let s = subgroup as usize;
                let verdict = &*m.state_row(s, m.plan.layout.io);
                let accepted = &mut *m.block::<u32>(i.d, subgroup);
                for k in 0..SUBGROUP_SIZE {
                    accepted[k] = if verdict[k] != 0 { !0 } else { 0 };
                    if verdict[k] == 2 {
                        active[s].remove(k);
                    }
                }
            }
        }
        m.set_active(active);
    }
}

/// Writes outputs that are read: operands `x..` (count in `b`) to the rows of outputs from 0 in
/// active lanes; without operands, zeros to `c` rows.
pub(super) struct WriteOutputs;

impl Kernel for WriteOutputs {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let first = i.x as usize;
        let count = (i.b.raw() as usize).min(m.outputs);
        let end = (i.c.raw() as usize).min(m.outputs);
        let operands = &m.code.operands[first..first + count];
        let is_whole = is_whole(m);
        let mut rows = [null_mut(); MAX_SUBGROUPS];
        // SAFETY: the caller keeps the contract of `Kernel::run`.
        unsafe {
            for &subgroup in m.listed() {
                rows[subgroup as usize] = m.output_row(subgroup as usize, 0);
            }
            for (row, &operand) in operands.iter().enumerate() {
                let (base, step) = m.row(operand);
                if is_whole {
                    for (s, to) in rows.iter().enumerate().take(m.subgroups) {
                        *to.add(row) = *base.add(s * step).cast::<Row>();
                    }
                    continue;
                }
                for &subgroup in m.listed() {
                    let s = subgroup as usize;
                    let from = &*base.add(s * step).cast::<Row>();
                    blend(&mut *rows[s].add(row), from, m.active[s]);
                }
            }
            for row in count..end {
                for &subgroup in m.listed() {
                    let s = subgroup as usize;
                    blend(&mut *rows[s].add(row), &[0; SUBGROUP_SIZE], m.active[s]);
                }
            }
        }
    }
}

/// Reads input row `x`.
pub(super) struct Input;

impl Kernel for Input {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let row = m.plan.layout.inputs + i.x as usize;
        // SAFETY: the caller keeps the contract of `Kernel::run`.
        unsafe { read_row(m, row, i.d) };
    }
}
