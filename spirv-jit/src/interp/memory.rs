//! Private memory, and what a dispatch is given as words.

use std::marker::PhantomData;

use lanes::{LaneMask, Row, Tier as TierKind};

use super::access::operands;
use super::gather::{Gather, Layout};
use super::machine::{Handler, Instr, Machine};
use super::tier::{Kernel, Portable};
use super::yields::blend;
use crate::SUBGROUP_SIZE;
use crate::ir::Type;
use crate::ir::op::MAX_TABLE_RESULTS;

/// The kernel of a load from private memory or a store to it, in a tier.
pub(super) fn private(tier: TierKind, ty: Type, store: bool) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => private_in::<super::tier::Avx2>(ty, store),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => private_in::<super::tier::Avx512>(ty, store),
        _ => private_in::<Portable>(ty, store),
    }
}

fn private_in<G: Gather>(ty: Type, store: bool) -> Handler {
    match (ty.rows(), store) {
        (1, false) => G::handler::<LoadPrivate<G, 1>>(),
        (1, true) => G::handler::<StorePrivate<G, 1>>(),
        (_, false) => G::handler::<LoadPrivate<G, 2>>(),
        (_, true) => G::handler::<StorePrivate<G, 2>>(),
    }
}

/// The private rows that lanes access.
enum PrivateRows {
    /// All lanes access this row.
    One(u32),
    /// Byte offsets of the lanes' words from the first private row, and the lanes whose row exists.
    /// Offsets in other lanes are valid, too.
    Apart(Row, LaneMask),
    /// No lane's row exists.
    Missing,
}

/// Finds the private rows of some lanes, at least one. Each access takes `count` consecutive rows,
/// all of which must exist.
///
/// # Safety
/// As for [`Gather`].
#[inline(always)]
unsafe fn find_rows<G: Gather>(
    m: &Machine<'_>,
    rows: &Row,
    lanes: LaneMask,
    count: u32,
) -> PrivateRows {
    let Some(last) = (m.plan.private_rows as u32).checked_sub(count) else {
        return PrivateRows::Missing;
    };
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let mut filled = G::fill(rows, lanes);
        let mut inside = lanes;
        match G::layout(&filled, last, 0) {
            Layout::Outside(lanes) => {
                inside &= lanes;
                if inside.is_empty() {
                    return PrivateRows::Missing;
                }
                filled = G::fill(&filled, inside);
            }
            Layout::Same => return PrivateRows::One(filled[0]),
            _ => {}
        }
        for k in 0..SUBGROUP_SIZE {
            filled[k] = filled[k] * size_of::<Row>() as u32 + k as u32 * size_of::<u32>() as u32;
        }
        PrivateRows::Apart(filled, inside)
    }
}

/// A load from private memory by plan `x`, of scalars of `ROWS` rows each. Row numbers count from
/// the first private row; rows past the last read zero.
struct LoadPrivate<G, const ROWS: usize>(PhantomData<G>);

impl<G: Gather, const ROWS: usize> Kernel for LoadPrivate<G, ROWS> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.accesses[i.x as usize];
        let (address, results) = operands(m, &plan);
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; rows are checked.
            unsafe {
                let base = m.state_row(s, m.plan.private);
                let first = *m.block::<u32>(address[0], subgroup);
                for (k, &result) in results.iter().enumerate() {
                    let mut rows = first;
                    for row in &mut rows {
                        *row = row.wrapping_add((k * ROWS) as u32);
                    }
                    let mut words = [[0; SUBGROUP_SIZE]; ROWS];
                    match find_rows::<G>(m, &rows, m.active[s], ROWS as u32) {
                        PrivateRows::One(row) => {
                            for (part, words) in words.iter_mut().enumerate() {
                                *words = *base.add(row as usize + part);
                            }
                        }
                        PrivateRows::Apart(offsets, inside) => {
                            let offsets = std::hint::black_box(&raw const offsets);
                            for (part, words) in words.iter_mut().enumerate() {
                                let to = [words.as_mut_ptr().cast::<u8>()];
                                let from = base.add(part).cast();
                                G::load_apart::<u32, 1>(from, &*offsets, to);
                                if inside != m.active[s] {
                                    blend(words, &[0; SUBGROUP_SIZE], !inside);
                                }
                            }
                        }
                        PrivateRows::Missing => {}
                    }
                    if ROWS == 1 {
                        *m.block::<u32>(result, subgroup) = words[0];
                    } else {
                        let d = &mut *m.block::<u64>(result, subgroup);
                        for k in 0..SUBGROUP_SIZE {
                            d[k] = words[0][k] as u64 | (words[ROWS - 1][k] as u64) << 32;
                        }
                    }
                }
            }
        }
    }
}

/// A store to private memory by plan `x`, of scalars of `ROWS` rows each. Rows past the last are
/// not stored.
struct StorePrivate<G, const ROWS: usize>(PhantomData<G>);

impl<G: Gather, const ROWS: usize> Kernel for StorePrivate<G, ROWS> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.accesses[i.x as usize];
        let (address, values) = operands(m, &plan);
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; rows are checked.
            unsafe {
                let base = m.state_row(s, m.plan.private);
                let first = *m.block::<u32>(address[0], subgroup);
                for (k, &value) in values.iter().enumerate() {
                    let mut rows = first;
                    for row in &mut rows {
                        *row = row.wrapping_add((k * ROWS) as u32);
                    }
                    let mut words = [[0; SUBGROUP_SIZE]; ROWS];
                    if ROWS == 1 {
                        words[0] = *m.block::<u32>(value, subgroup);
                    } else {
                        let pairs = &*m.block::<u64>(value, subgroup);
                        for k in 0..SUBGROUP_SIZE {
                            words[0][k] = pairs[k] as u32;
                            words[ROWS - 1][k] = (pairs[k] >> 32) as u32;
                        }
                    }
                    match find_rows::<G>(m, &rows, m.active[s], ROWS as u32) {
                        PrivateRows::One(row) => {
                            for (part, words) in words.iter().enumerate() {
                                blend(&mut *base.add(row as usize + part), words, m.active[s]);
                            }
                        }
                        PrivateRows::Apart(offsets, inside) => {
                            let offsets = &*std::hint::black_box(&raw const offsets);
                            for (part, words) in words.iter().enumerate() {
                                let to = base.add(part).cast::<u8>();
                                // Written out where there is no need to look for lanes.
                                if inside == LaneMask::ALL {
                                    for lane in 0..SUBGROUP_SIZE {
                                        *to.add(offsets[lane] as usize).cast() = words[lane];
                                    }
                                    continue;
                                }
                                for lane in inside {
                                    *to.add(offsets[lane] as usize).cast() = words[lane];
                                }
                            }
                        }
                        PrivateRows::Missing => {}
                    }
                }
            }
        }
    }
}

/// Keeps the words of a vertex that a geometry invocation emits: `y` operands from `x` on, the
/// vertex first.
pub(super) struct Emit;

impl Kernel for Emit {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let operands = &m.code.operands[i.x as usize..][..i.y as usize];
        let (vertex, words) = (operands[0], &operands[1..]);
        let slots = m.plan.emitted_slots;
        // Vertices past the last share a slot.
        let spare = slots as u32 - 1;
        for &subgroup in m.listed() {
            let s = subgroup as usize;
            let active = m.active[s];
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; the plan made room for a row for each word of each
            // slot, and the verifier counted the words.
            unsafe {
                let base = m.state_row(s, m.plan.emitted);
                let slot = (*m.block::<u32>(vertex, subgroup)).map(|vertex| vertex.min(spare));
                let Some(first) = active.into_iter().next() else {
                    continue;
                };
                let is_same = active.into_iter().all(|lane| slot[lane] == slot[first]);
                for (k, &word) in words.iter().enumerate() {
                    let rows = base.add(k * slots);
                    let from = *m.block::<u32>(word, subgroup);
                    if is_same {
                        blend(&mut *rows.add(slot[first] as usize), &from, active);
                    } else {
                        for lane in active {
                            (*rows.add(slot[lane] as usize))[lane] = from[lane];
                        }
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
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; the emitter checked the row.
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
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; the emitter checked the row.
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
            // SAFETY: the caller keeps the contract of `load_private`; the emitter checked the
            // rows.
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
            // SAFETY: operands are the program's; zeros stand behind the table for as many results
            // as there may be.
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
        // SAFETY: the caller keeps the contract of this function.
        unsafe { *m.block::<u32>(i.d, subgroup) = [word; SUBGROUP_SIZE] };
    }
}

/// The lane's number.
///
/// # Safety
/// As [`load_private`].
pub(super) unsafe fn lane_index(m: &mut Machine<'_>, i: &Instr) {
    for &subgroup in m.listed() {
        // SAFETY: the caller keeps the contract of this function.
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
        // SAFETY: the caller keeps the contract of this function.
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
