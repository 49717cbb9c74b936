//! Operations across the lanes of a subgroup.

use half::f16;
use lanes::LaneMask;

use super::code::SubgroupPlan;
use super::machine::{Instr, Machine};
use super::tier::Kernel;
use crate::SUBGROUP_SIZE;
use crate::eval;
use crate::ir::Type;
use crate::ir::op::{ReduceOp, SubgroupOp};
use crate::row::Row;

type Lanes = [u64; SUBGROUP_SIZE];

/// The subgroup operation by plan `x`: `d` from `a` and `b`.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs.
pub(super) unsafe fn subgroup(m: &mut Machine<'_>, i: &Instr) {
    let plan = m.code.subgroups[i.x as usize];
    let wide_operand = plan.ty.rows() == 2;
    let (has_a, has_b, wide_result) = shape(&plan);
    for &subgroup in m.listed() {
        let mask = lanes(m, &plan, subgroup);
        // SAFETY: as the caller promises.
        unsafe {
            let read = |has: bool, operand, wide| -> Lanes {
                std::array::from_fn(|k| match has {
                    true => m.lane(operand, subgroup, k, wide),
                    false => 0,
                })
            };
            let a = read(has_a, i.a, wide_operand);
            let b = read(has_b, i.b, false);
            let result = perform(&plan, &a, &b, mask);
            for (k, &value) in result.iter().enumerate() {
                m.set_lane(i.d, subgroup, k, wide_result, value);
            }
        }
    }
}

/// The lanes that take part.
#[inline(always)]
fn lanes(m: &Machine<'_>, plan: &SubgroupPlan, subgroup: u16) -> LaneMask {
    // Where all are helpers they are by themselves: a loop that waits to be elected ends.
    match m.effective(subgroup) {
        others if !others.is_empty() && !plan.with_helpers => others,
        _ => m.active[subgroup as usize],
    }
}

/// Whether an operation gives one word, which [`word`] finds in vectors, to all lanes.
pub(super) fn is_word(plan: &SubgroupPlan) -> bool {
    match plan.op {
        SubgroupOp::All | SubgroupOp::Any | SubgroupOp::Ballot => true,
        SubgroupOp::BroadcastFirst => plan.ty.rows() == 1,
        SubgroupOp::Reduce { op, cluster } => {
            let is_float = matches!(
                op,
                ReduceOp::FAdd | ReduceOp::FMul | ReduceOp::FMin | ReduceOp::FMax
            );
            plan.ty == Type::I32 && !is_float && cluster as usize >= SUBGROUP_SIZE
        }
        _ => false,
    }
}

/// [`subgroup`] of an operation that [`is_word`].
pub(super) struct Word;

impl Kernel for Word {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let mask = lanes(m, &plan, subgroup);
            // SAFETY: as the caller promises; such an operation has one operand, of 32 bits as its result.
            unsafe {
                let word = word(&plan, &*m.block::<u32>(i.a, subgroup), mask);
                *m.block::<u32>(i.d, subgroup) = [word; SUBGROUP_SIZE];
            }
        }
    }
}

/// The word that [`perform`] gives to every lane.
#[inline(always)]
fn word(plan: &SubgroupPlan, a: &Row, mask: LaneMask) -> u32 {
    match plan.op {
        SubgroupOp::All => boolean(ballot(a) & mask == mask) as u32,
        SubgroupOp::Any => boolean(!(ballot(a) & mask).is_empty()) as u32,
        SubgroupOp::Ballot => (ballot(a) & mask).bits().into(),
        SubgroupOp::Reduce { op, .. } => {
            let identity = identity(op, plan.ty) as u32;
            match op {
                ReduceOp::IAdd => total(a, mask, identity, eval::iadd),
                ReduceOp::IMul => total(a, mask, identity, eval::imul),
                ReduceOp::SMin => total(a, mask, identity, eval::smin),
                ReduceOp::UMin => total(a, mask, identity, eval::umin),
                ReduceOp::SMax => total(a, mask, identity, eval::smax),
                ReduceOp::UMax => total(a, mask, identity, eval::umax),
                ReduceOp::And => total(a, mask, identity, eval::and),
                ReduceOp::Or => total(a, mask, identity, eval::or),
                _ => total(a, mask, identity, eval::xor),
            }
        }
        _ => a[mask.first()],
    }
}

/// A bit for each lane that is not zero.
#[inline(always)]
fn ballot(a: &Row) -> LaneMask {
    let mut bits = [0u32; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        bits[k] = if a[k] != 0 { 1 << k } else { 0 };
    }
    LaneMask::from_bits(bits.iter().fold(0, |all, bit| all | bit) as u16)
}

/// The lanes of the mask combined, in any order.
#[inline(always)]
fn total(a: &Row, mask: LaneMask, identity: u32, combine: impl Fn(u32, u32) -> u32) -> u32 {
    let mut rest = [identity; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        rest[k] = if mask.contains(k) { a[k] } else { identity };
    }
    for k in 0..8 {
        rest[k] = combine(rest[k], rest[k + 8]);
    }
    for k in 0..4 {
        rest[k] = combine(rest[k], rest[k + 4]);
    }
    combine(combine(rest[0], rest[2]), combine(rest[1], rest[3]))
}

/// Whether there is a first and a second operand, and whether the result has 64 bits.
fn shape(plan: &SubgroupPlan) -> (bool, bool, bool) {
    let wide = plan.ty.rows() == 2;
    match plan.op {
        SubgroupOp::Elect => (false, false, false),
        SubgroupOp::All
        | SubgroupOp::Any
        | SubgroupOp::AllEqual
        | SubgroupOp::Ballot
        | SubgroupOp::Match => (true, false, false),
        SubgroupOp::Shuffle
        | SubgroupOp::QuadShuffle
        | SubgroupOp::PartitionedReduce(_)
        | SubgroupOp::PartitionedInclusiveScan(_)
        | SubgroupOp::PartitionedExclusiveScan(_) => (true, true, wide),
        _ => (true, false, wide),
    }
}

fn boolean(holds: bool) -> u64 {
    if holds { u32::MAX as u64 } else { 0 }
}

fn perform(plan: &SubgroupPlan, a: &Lanes, b: &Lanes, mask: LaneMask) -> Lanes {
    let first = mask.first();
    let all = |value: u64| [value; SUBGROUP_SIZE];
    match plan.op {
        SubgroupOp::Elect => std::array::from_fn(|k| boolean(k == first)),
        SubgroupOp::All | SubgroupOp::Any | SubgroupOp::Ballot => {
            unreachable!("they are words")
        }
        SubgroupOp::AllEqual => {
            let same = mask.iter().all(|k| equal(plan.ty, a[k], a[first]));
            all(boolean(same))
        }
        SubgroupOp::Shuffle => std::array::from_fn(|k| a.get(b[k] as usize).copied().unwrap_or(0)),
        SubgroupOp::QuadShuffle => std::array::from_fn(|k| {
            let from = b[k] as usize;
            let is_active = from < SUBGROUP_SIZE && mask.contains(from);
            if is_active { a[from] } else { a[k] }
        }),
        SubgroupOp::BroadcastFirst => all(a[first]),
        SubgroupOp::Reduce { op, cluster } => {
            let cluster = (cluster as usize).clamp(1, SUBGROUP_SIZE);
            let mut result = [0; SUBGROUP_SIZE];
            for start in (0..SUBGROUP_SIZE).step_by(cluster) {
                let end = (start + cluster).min(SUBGROUP_SIZE);
                let total = mask
                    .iter()
                    .filter(|k| (start..end).contains(k))
                    .map(|k| a[k])
                    .reduce(|x, y| combine(op, plan.ty, x, y))
                    .unwrap_or_else(|| identity(op, plan.ty));
                result[start..end].fill(total);
            }
            result
        }
        SubgroupOp::InclusiveScan(op) => scan(op, plan.ty, a, mask, true),
        SubgroupOp::ExclusiveScan(op) => scan(op, plan.ty, a, mask, false),
        SubgroupOp::Match => std::array::from_fn(|k| {
            let same = mask.iter().filter(|&other| a[other] == a[k]);
            same.collect::<LaneMask>().bits().into()
        }),
        SubgroupOp::PartitionedReduce(op) => partitioned(mask, b, |part, k| {
            scan(op, plan.ty, a, part, true)[last_lane(part).unwrap_or(k)]
        }),
        SubgroupOp::PartitionedInclusiveScan(op) => {
            partitioned(mask, b, |part, k| scan(op, plan.ty, a, part, true)[k])
        }
        SubgroupOp::PartitionedExclusiveScan(op) => {
            partitioned(mask, b, |part, k| scan(op, plan.ty, a, part, false)[k])
        }
    }
}

/// For each active lane, what is computed over the part that it names, and for it.
fn partitioned(mask: LaneMask, parts: &Lanes, of: impl Fn(LaneMask, usize) -> u64) -> Lanes {
    let mut result = [0; SUBGROUP_SIZE];
    for k in mask {
        result[k] = of(mask & LaneMask::from_bits(parts[k] as u16), k);
    }
    result
}

fn last_lane(part: LaneMask) -> Option<usize> {
    part.iter().last()
}

fn scan(op: ReduceOp, ty: Type, a: &Lanes, mask: LaneMask, inclusive: bool) -> Lanes {
    let mut result = [0; SUBGROUP_SIZE];
    let mut total = None;
    for k in mask {
        let before = total.unwrap_or_else(|| identity(op, ty));
        let with = total.map_or(a[k], |t| combine(op, ty, t, a[k]));
        result[k] = if inclusive { with } else { before };
        total = Some(with);
    }
    result
}

fn equal(ty: Type, x: u64, y: u64) -> bool {
    match ty {
        Type::F16 => eval::foeq(f16::from_bits(x as u16), f16::from_bits(y as u16)),
        Type::F32 => f32::from_bits(x as u32) == f32::from_bits(y as u32),
        Type::F64 => f64::from_bits(x) == f64::from_bits(y),
        _ => x == y,
    }
}

/// One step of a reduction on the bits of two scalars.
fn combine(op: ReduceOp, ty: Type, x: u64, y: u64) -> u64 {
    macro_rules! ints {
        ($f:path) => {
            match ty.bits() {
                8 => $f(x as u8, y as u8) as u64,
                16 => $f(x as u16, y as u16) as u64,
                32 => $f(x as u32, y as u32) as u64,
                _ => $f(x, y),
            }
        };
    }
    macro_rules! floats {
        ($f:path) => {
            match ty {
                Type::F16 => {
                    $f(f16::from_bits(x as u16), f16::from_bits(y as u16)).to_bits() as u64
                }
                Type::F64 => $f(f64::from_bits(x), f64::from_bits(y)).to_bits(),
                _ => $f(f32::from_bits(x as u32), f32::from_bits(y as u32)).to_bits() as u64,
            }
        };
    }
    match op {
        ReduceOp::IAdd => ints!(eval::iadd),
        ReduceOp::IMul => ints!(eval::imul),
        ReduceOp::SMin => ints!(eval::smin),
        ReduceOp::UMin => ints!(eval::umin),
        ReduceOp::SMax => ints!(eval::smax),
        ReduceOp::UMax => ints!(eval::umax),
        ReduceOp::And => x & y,
        ReduceOp::Or => x | y,
        ReduceOp::Xor => x ^ y,
        ReduceOp::FAdd => floats!(eval::fadd),
        ReduceOp::FMul => floats!(eval::fmul),
        ReduceOp::FMin => floats!(eval::fmin),
        ReduceOp::FMax => floats!(eval::fmax),
    }
}

/// The identity element of the operation.
fn identity(op: ReduceOp, ty: Type) -> u64 {
    let ones = match ty.bits() {
        1 => u32::MAX as u64,
        64 => u64::MAX,
        bits => (1 << bits) - 1,
    };
    let float = |value: f64| match ty {
        Type::F16 => f16::from_f64(value).to_bits() as u64,
        Type::F64 => value.to_bits(),
        _ => (value as f32).to_bits() as u64,
    };
    match op {
        ReduceOp::IAdd | ReduceOp::Or | ReduceOp::Xor | ReduceOp::UMax => 0,
        ReduceOp::IMul => 1,
        ReduceOp::SMin => ones >> 1,
        ReduceOp::SMax => ones ^ (ones >> 1),
        ReduceOp::UMin | ReduceOp::And => ones,
        ReduceOp::FAdd => float(-0.0),
        ReduceOp::FMul => float(1.0),
        ReduceOp::FMin => float(f64::INFINITY),
        ReduceOp::FMax => float(f64::NEG_INFINITY),
    }
}
