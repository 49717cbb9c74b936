//! Operations across the lanes of a subgroup: a kernel for each operation and type, on rows.
//!
//! [`eval::subgroup`](crate::eval::subgroup) defines the results. Results in inactive lanes are
//! undefined.

mod permute;
mod reduce;

use std::marker::PhantomData;

use half::f16;
use lanes::{LaneMask, Row, Tier as TierKind};

use self::permute::Permute;
use self::reduce::Family;
use super::code::SubgroupPlan;
use super::kernels::{Binary, Lane, ops};
use super::machine::{Handler, Instr, Machine};
use super::tier::{Kernel, Portable, Tier};
use crate::SUBGROUP_SIZE;
use crate::ir::Type;
use crate::ir::op::SubgroupOp;

/// The kernel of a subgroup operation on values of a type: `d` from `a` and `b` by plan `x`.
pub(super) fn handler(tier: TierKind, op: SubgroupOp, ty: Type) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => in_tier::<super::tier::Avx2>(op, ty),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<super::tier::Avx512>(op, ty),
        _ => in_tier::<Portable>(op, ty),
    }
}

fn in_tier<T: Permute>(op: SubgroupOp, ty: Type) -> Handler {
    let is_wide = ty.rows() == 2;
    match op {
        SubgroupOp::Elect => T::handler::<Elect>(),
        SubgroupOp::All | SubgroupOp::Any | SubgroupOp::Ballot => T::handler::<Vote>(),
        SubgroupOp::AllEqual => match ty {
            Type::F16 => Portable::handler::<AllEqual<ops::foeq, f16>>(),
            Type::F32 => T::handler::<AllEqual<ops::foeq, f32>>(),
            Type::F64 => T::handler::<AllEqual<ops::foeq, f64>>(),
            _ if is_wide => T::handler::<AllEqual<ops::ieq, u64>>(),
            _ => T::handler::<AllEqual<ops::ieq, u32>>(),
        },
        SubgroupOp::Match if is_wide => T::handler::<Match<u64>>(),
        SubgroupOp::Match => T::handler::<Match<u32>>(),
        SubgroupOp::BroadcastFirst if is_wide => T::handler::<BroadcastFirst<u64>>(),
        SubgroupOp::BroadcastFirst => T::handler::<BroadcastFirst<u32>>(),
        SubgroupOp::Shuffle if is_wide => T::handler::<Shuffle<T, u64>>(),
        SubgroupOp::Shuffle => T::handler::<Shuffle<T, u32>>(),
        SubgroupOp::QuadShuffle if is_wide => T::handler::<QuadShuffle<T, u64>>(),
        SubgroupOp::QuadShuffle => T::handler::<QuadShuffle<T, u32>>(),
        SubgroupOp::Reduce { op, cluster } => {
            let is_whole = cluster as usize >= SUBGROUP_SIZE;
            let family = if is_whole {
                Family::Reduce
            } else {
                Family::ReduceClusters
            };
            reduce::handler::<T>(family, op, ty)
        }
        SubgroupOp::InclusiveScan(op) | SubgroupOp::ExclusiveScan(op) => {
            reduce::handler::<T>(Family::Scan, op, ty)
        }
        SubgroupOp::PartitionedReduce(op)
        | SubgroupOp::PartitionedInclusiveScan(op)
        | SubgroupOp::PartitionedExclusiveScan(op) => {
            reduce::handler::<T>(Family::Partitioned, op, ty)
        }
    }
}

/// The lanes that take part.
#[inline(always)]
fn participants(m: &Machine<'_>, plan: &SubgroupPlan, subgroup: u16) -> LaneMask {
    // Where all are helpers they are by themselves: a loop that waits to be elected ends.
    match m.effective(subgroup) {
        others if !others.is_empty() && !plan.with_helpers => others,
        _ => m.active[subgroup as usize],
    }
}

/// A boolean as rows hold it.
#[inline(always)]
fn boolean(holds: bool) -> u32 {
    if holds { u32::MAX } else { 0 }
}

/// `elect`.
struct Elect;

impl Kernel for Elect {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let first = participants(m, &plan, subgroup).first();
            let mut row = [0; SUBGROUP_SIZE];
            for k in 0..SUBGROUP_SIZE {
                row[k] = boolean(k as u32 == first as u32);
            }
            // SAFETY: the caller keeps the contract of `Kernel::run`.
            unsafe { *m.block::<u32>(i.d, subgroup) = row };
        }
    }
}

/// `all`, `any` and `ballot`.
struct Vote;

impl Kernel for Vote {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let mask = participants(m, &plan, subgroup);
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; the operand is a boolean.
            unsafe {
                let holds = LaneMask::with_any(&*m.block::<u32>(i.a, subgroup), u32::MAX) & mask;
                let word = match plan.op {
                    SubgroupOp::All => boolean(holds == mask),
                    SubgroupOp::Any => boolean(!holds.is_empty()),
                    _ => holds.bits().into(),
                };
                *m.block::<u32>(i.d, subgroup) = [word; SUBGROUP_SIZE];
            }
        }
    }
}

/// `all_equal` by a comparison of type `T`.
struct AllEqual<O, T>(PhantomData<(O, T)>);

impl<O: Binary<T, T, bool>, T: Lane> Kernel for AllEqual<O, T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let mask = participants(m, &plan, subgroup);
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; a block is read before it is written.
            unsafe {
                let row = *m.block::<T::Slot>(i.a, subgroup);
                let first = T::read(row[mask.first()]);
                let mut same = [0; SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    same[k] = boolean(O::call(T::read(row[k]), first));
                }
                let same = LaneMask::with_any(&same, u32::MAX);
                let word = boolean((mask - same).is_empty());
                *m.block::<u32>(i.d, subgroup) = [word; SUBGROUP_SIZE];
            }
        }
    }
}

/// `match`.
struct Match<S>(PhantomData<S>);

impl<S: Lane<Slot = S> + PartialEq> Kernel for Match<S> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let mask = participants(m, &plan, subgroup);
            // SAFETY: as for `AllEqual`.
            unsafe {
                let row = *m.block::<S>(i.a, subgroup);
                let mut same: Row = [0; SUBGROUP_SIZE];
                for other in 0..SUBGROUP_SIZE {
                    let bit = u32::from(mask.bits()) & 1 << other;
                    for k in 0..SUBGROUP_SIZE {
                        same[k] |= if row[k] == row[other] { bit } else { 0 };
                    }
                }
                *m.block::<u32>(i.d, subgroup) = same;
            }
        }
    }
}

/// `broadcast_first`.
struct BroadcastFirst<S>(PhantomData<S>);

impl<S: Lane<Slot = S>> Kernel for BroadcastFirst<S> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let first = participants(m, &plan, subgroup).first();
            // SAFETY: the caller keeps the contract of `Kernel::run`.
            unsafe {
                let scalar = (*m.block::<S>(i.a, subgroup))[first];
                *m.block::<S>(i.d, subgroup) = [scalar; SUBGROUP_SIZE];
            }
        }
    }
}

/// `shuffle`, from the lanes in `b`.
struct Shuffle<P, S>(PhantomData<(P, S)>);

impl<P: Permute, S: permute::Word> Kernel for Shuffle<P, S> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        for &subgroup in m.listed() {
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; blocks are read before one is written.
            unsafe {
                let (row, from) = (*m.block::<S>(i.a, subgroup), *m.block::<u32>(i.b, subgroup));
                *m.block::<S>(i.d, subgroup) = S::shuffled::<P>(&row, &from);
            }
        }
    }
}

/// `quad_shuffle`, from the lanes in `b`.
struct QuadShuffle<P, S>(PhantomData<(P, S)>);

impl<P: Permute, S: permute::Word> Kernel for QuadShuffle<P, S> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let active = u32::from(participants(m, &plan, subgroup).bits());
            // SAFETY: as for `Shuffle`.
            unsafe {
                let row = *m.block::<S>(i.a, subgroup);
                let mut from = *m.block::<u32>(i.b, subgroup);
                for k in 0..SUBGROUP_SIZE {
                    // Numbers past the last lane have no bit.
                    let is_active = active.checked_shr(from[k]).unwrap_or(0) & 1 != 0;
                    from[k] = if is_active { from[k] } else { k as u32 };
                }
                *m.block::<S>(i.d, subgroup) = S::shuffled::<P>(&row, &from);
            }
        }
    }
}
