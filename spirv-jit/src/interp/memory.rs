//! Private memory, and what a dispatch is given as words.

use super::access::operands;
use super::machine::{Instr, Machine};
use super::operand::Operand;
use super::tier::Kernel;
use super::yields::blend;
use crate::SUBGROUP_SIZE;
use crate::ir::Type;
use crate::ir::op::MAX_TABLE_RESULTS;

/// A load from private memory by plan `x`: row numbers count from the first private row; past the end they read zero.
pub(super) struct LoadPrivate;

impl Kernel for LoadPrivate {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.accesses[i.x as usize];
        let (address, results) = operands(m, &plan);
        let rows = plan.ty.rows() as u64;
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            let common = match rows {
                // SAFETY: as the caller promises.
                1 => unsafe { common_row(m, address[0], subgroup) },
                _ => None,
            };
            if let Some(first) = common {
                for (k, &result) in results.iter().enumerate() {
                    let row = first.wrapping_add(k as u32) as usize;
                    // SAFETY: as above.
                    unsafe {
                        *m.block::<u32>(result, subgroup) = match row < m.plan.private_rows {
                            true => *m.state_row(s, m.plan.private + row),
                            false => [0; SUBGROUP_SIZE],
                        };
                    }
                }
                continue;
            }
            for lane in m.active[s] {
                // SAFETY: as the caller promises; rows are checked.
                unsafe {
                    let first = m.lane(address[0], subgroup, lane, false);
                    for (k, &result) in results.iter().enumerate() {
                        let value = read_private(
                            m,
                            s,
                            (first + k as u64 * rows) as u32 as u64,
                            lane,
                            plan.ty,
                        );
                        m.set_lane(result, subgroup, lane, rows == 2, value);
                    }
                }
            }
        }
    }
}

/// The private row that an access of all active lanes is to, where it is one: an index that counts a loop, say.
///
/// # Safety
/// The operand is the program's, the subgroup one that has active lanes.
#[inline(always)]
unsafe fn common_row(m: &Machine<'_>, row: Operand, subgroup: u16) -> Option<u32> {
    let active = m.active[subgroup as usize];
    // SAFETY: as the caller promises.
    let rows = unsafe { &*m.block::<u32>(row, subgroup) };
    let first = rows[active.first()];
    let mut others = 0;
    for (lane, &row) in rows.iter().enumerate() {
        let is_active = active.contains(lane);
        others |= (is_active & (row != first)) as u32;
    }
    (others == 0).then_some(first)
}

/// # Safety
/// The subgroup is one of the wave's.
#[inline(always)]
unsafe fn read_private(m: &Machine<'_>, subgroup: usize, row: u64, lane: usize, ty: Type) -> u64 {
    if row + ty.rows() as u64 > m.plan.private_rows as u64 {
        return 0;
    }
    // SAFETY: the row is a private one.
    unsafe {
        let row = m.plan.private + row as usize;
        let low = (*m.state_row(subgroup, row))[lane] as u64;
        if ty.rows() == 2 {
            low | ((*m.state_row(subgroup, row + 1))[lane] as u64) << 32
        } else {
            low
        }
    }
}

/// # Safety
/// As [`read_private`].
#[inline(always)]
unsafe fn write_private(
    m: &Machine<'_>,
    subgroup: usize,
    row: u64,
    lane: usize,
    ty: Type,
    value: u64,
) {
    if row + ty.rows() as u64 > m.plan.private_rows as u64 {
        return;
    }
    // SAFETY: the row is a private one.
    unsafe {
        let row = m.plan.private + row as usize;
        (*m.state_row(subgroup, row))[lane] = value as u32;
        if ty.rows() == 2 {
            (*m.state_row(subgroup, row + 1))[lane] = (value >> 32) as u32;
        }
    }
}

/// A store to private memory by plan `x`.
pub(super) struct StorePrivate;

impl Kernel for StorePrivate {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.accesses[i.x as usize];
        let (address, values) = operands(m, &plan);
        let rows = plan.ty.rows() as u64;
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            let common = match rows {
                // SAFETY: as the caller promises.
                1 => unsafe { common_row(m, address[0], subgroup) },
                _ => None,
            };
            if let Some(first) = common {
                for (k, &value) in values.iter().enumerate() {
                    let row = first.wrapping_add(k as u32) as usize;
                    if row < m.plan.private_rows {
                        // SAFETY: as above.
                        unsafe {
                            let to = &mut *m.state_row(s, m.plan.private + row);
                            blend(to, &*m.block::<u32>(value, subgroup), m.active[s]);
                        }
                    }
                }
                continue;
            }
            for lane in m.active[s] {
                // SAFETY: as the caller promises; rows are checked.
                unsafe {
                    let first = m.lane(address[0], subgroup, lane, false);
                    for (k, &value) in values.iter().enumerate() {
                        let value = m.lane(value, subgroup, lane, rows == 2);
                        write_private(
                            m,
                            s,
                            (first + k as u64 * rows) as u32 as u64,
                            lane,
                            plan.ty,
                            value,
                        );
                    }
                }
            }
        }
    }
}

/// Reads a variable at the fixed private row `x` into `d`; `y`: 64 bits.
pub(super) struct VariableLoad;

impl Kernel for VariableLoad {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let row = m.plan.private + i.x as usize;
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            // SAFETY: as the caller promises; the emitter checked the row.
            unsafe {
                let low = *m.state_row(s, row);
                if i.y == 0 {
                    *m.block::<u32>(i.d, subgroup) = low;
                } else {
                    let high = *m.state_row(s, row + 1);
                    let d = &mut *m.block::<u64>(i.d, subgroup);
                    for k in 0..SUBGROUP_SIZE {
                        d[k] = low[k] as u64 | (high[k] as u64) << 32;
                    }
                }
            }
        }
    }
}

/// Writes active lanes of `a` to the fixed private row `x`; `y`: 64 bits.
pub(super) struct VariableStore;

impl Kernel for VariableStore {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let row = m.plan.private + i.x as usize;
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            let mask = m.active[s];
            // SAFETY: as the caller promises; the emitter checked the row.
            unsafe {
                let low = &mut *m.state_row(s, row);
                if i.y == 0 {
                    blend(low, &*m.block::<u32>(i.a, subgroup), mask);
                } else {
                    let high = &mut *m.state_row(s, row + 1);
                    let a = &*m.block::<u64>(i.a, subgroup);
                    for k in 0..SUBGROUP_SIZE {
                        if mask.contains(k) {
                            low[k] = a[k] as u32;
                            high[k] = (a[k] >> 32) as u32;
                        }
                    }
                }
            }
        }
    }
}

/// Zeroes private rows `x..y` in active lanes.
///
/// # Safety
/// As [`load_private`].
pub(super) unsafe fn zero_private(m: &mut Machine<'_>, i: &Instr) {
    for row in i.x..i.y {
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            // SAFETY: as the caller promises; the emitter checked the rows.
            let words = unsafe { &mut *m.state_row(s, m.plan.private + row as usize) };
            for (k, word) in words.iter_mut().enumerate() {
                *word = if m.active[s].contains(k) { 0 } else { *word };
            }
        }
    }
}

/// Words of table `y` from index `a` on, to operands `x..` (count in `b`).
pub(super) struct LoadTable;

impl Kernel for LoadTable {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let words = m.code.tables[i.y as usize].as_slice();
        let end = (words.len() - MAX_TABLE_RESULTS) as u32;
        let (first, count) = (i.x as usize, i.b.raw() as usize);
        let results = &m.code.operands[first..first + count];
        for &subgroup in m.listed() {
            // SAFETY: operands are the program's; zeros stand behind the table for as many results as there may be.
            unsafe {
                let index = (*m.block::<u32>(i.a, subgroup)).map(|index| index.min(end) as usize);
                for (k, &result) in results.iter().enumerate() {
                    let row = index.map(|index| *words.get_unchecked(index + k));
                    *m.block::<u32>(result, subgroup) = row;
                }
            }
        }
    }
}

/// A dispatch-wide word.
///
/// # Safety
/// As [`load_private`].
pub(super) unsafe fn uniform(m: &mut Machine<'_>, i: &Instr) {
    let uniforms = &m.environment.uniforms;
    let word = uniforms.get(i.x as usize).copied().unwrap_or(0);
    for &subgroup in m.listed() {
        // SAFETY: as the caller promises.
        unsafe { *m.block::<u32>(i.d, subgroup) = [word; SUBGROUP_SIZE] };
    }
}

/// The lane's number.
///
/// # Safety
/// As [`load_private`].
pub(super) unsafe fn lane_index(m: &mut Machine<'_>, i: &Instr) {
    for &subgroup in m.listed() {
        // SAFETY: as the caller promises.
        unsafe { *m.block::<u32>(i.d, subgroup) = std::array::from_fn(|k| k as u32) };
    }
}

/// Nanoseconds since the first reading in this process.
///
/// # Safety
/// As [`load_private`].
pub(super) unsafe fn read_clock(m: &mut Machine<'_>, i: &Instr) {
    use std::sync::OnceLock;
    use std::time::Instant;
    static START: OnceLock<Instant> = OnceLock::new();
    let now = START.get_or_init(Instant::now).elapsed().as_nanos() as u64;
    for &subgroup in m.listed() {
        // SAFETY: as the caller promises.
        unsafe { *m.block::<u64>(i.d, subgroup) = [now; SUBGROUP_SIZE] };
    }
}

/// Orders memory between invocations.
///
/// # Safety
/// As [`load_private`].
pub(super) unsafe fn memory_barrier(_: &mut Machine<'_>, _: &Instr) {
    std::sync::atomic::fence(std::sync::atomic::Ordering::SeqCst);
}
