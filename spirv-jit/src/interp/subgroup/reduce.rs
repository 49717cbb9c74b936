//! Reductions and scans: a kernel for each combining operation and type.
//!
//! Sums and products of floats combine lanes in ascending order, since the order shows: a chain of
//! fifteen operations. The chains of several subgroups overlap. Other operations combine lanes by
//! halves, in registers.

use std::marker::PhantomData;

use half::f16;
use lanes::LaneMask;

use super::participants;
use crate::SUBGROUP_SIZE;
use crate::eval::subgroup::Lanes;
use crate::eval::{Float, Int};
use crate::interp::kernels::{Binary, Lane, ops};
use crate::interp::machine::{Handler, Instr, Machine};
use crate::interp::tier::{Kernel, Portable, Tier};
use crate::ir::Type;
use crate::ir::op::{ReduceOp, SubgroupOp};

/// A combining operation on scalars of a type.
trait Combining<T>: Binary<T, T, T> + 'static {
    /// Another order of lanes could give other bits.
    const IS_ORDERED: bool = false;
    /// The result for no lanes.
    fn identity() -> T;
    /// A scalar that changes no other when combined with it.
    fn neutral() -> T {
        Self::identity()
    }
}

macro_rules! of_integers {
    ($($op:ident => $identity:expr;)*) => {$(
        impl<T: Int> Combining<T> for ops::$op
        where
            ops::$op: Binary<T, T, T>,
        {
            #[inline(always)]
            fn identity() -> T {
                $identity
            }
        }
    )*};
}
of_integers! {
    iadd => T::ZERO;
    imul => T::ONE;
    smin => T::ONES.shr(1);
    umin => T::ONES;
    smax => T::ONES.xor(T::ONES.shr(1));
    umax => T::ZERO;
    and => T::ONES;
    or => T::ZERO;
    xor => T::ZERO;
}

macro_rules! of_floats {
    ($($op:ident => $identity:expr, $neutral:expr, $is_ordered:expr;)*) => {$(
        impl<T: Float> Combining<T> for ops::$op {
            const IS_ORDERED: bool = $is_ordered;
            #[inline(always)]
            fn identity() -> T {
                T::from_f64($identity)
            }
            #[inline(always)]
            fn neutral() -> T {
                T::from_f64($neutral)
            }
        }
    )*};
}
of_floats! {
    fadd => -0.0, -0.0, true;
    fmul => 1.0, 1.0, true;
    // NaN is neutral: `fmin` and `fmax` return the operand that is a number.
    fmin => f64::INFINITY, f64::NAN, false;
    fmax => f64::NEG_INFINITY, f64::NAN, false;
}

/// A kind of kernel.
#[derive(Clone, Copy)]
pub(super) enum Family {
    Reduce,
    ReduceClusters,
    /// Inclusive and exclusive scans.
    Scan,
    /// Reductions and scans of parts.
    Partitioned,
}

/// The kernel of a reduction or scan of a type in a tier.
pub(super) fn handler<T: Tier>(family: Family, op: ReduceOp, ty: Type) -> Handler {
    match op {
        ReduceOp::IAdd => of_integer::<T, ops::iadd>(family, ty),
        ReduceOp::IMul => of_integer::<T, ops::imul>(family, ty),
        ReduceOp::SMin => of_integer::<T, ops::smin>(family, ty),
        ReduceOp::UMin => of_integer::<T, ops::umin>(family, ty),
        ReduceOp::SMax => of_integer::<T, ops::smax>(family, ty),
        ReduceOp::UMax => of_integer::<T, ops::umax>(family, ty),
        ReduceOp::And => of_integer::<T, ops::and>(family, ty),
        ReduceOp::Or => of_integer::<T, ops::or>(family, ty),
        ReduceOp::Xor => of_integer::<T, ops::xor>(family, ty),
        ReduceOp::FAdd => of_float::<T, ops::fadd>(family, ty),
        ReduceOp::FMul => of_float::<T, ops::fmul>(family, ty),
        ReduceOp::FMin => of_float::<T, ops::fmin>(family, ty),
        ReduceOp::FMax => of_float::<T, ops::fmax>(family, ty),
    }
}

/// Narrow types share one kernel between tiers; booleans are words of zeros or ones.
fn of_integer<T: Tier, O>(family: Family, ty: Type) -> Handler
where
    O: Combining<u8> + Combining<u16> + Combining<u32> + Combining<u64>,
{
    match ty.bits() {
        8 => of_type::<Portable, O, u8>(family),
        16 => of_type::<Portable, O, u16>(family),
        64 => of_type::<T, O, u64>(family),
        _ => of_type::<T, O, u32>(family),
    }
}

fn of_float<T: Tier, O>(family: Family, ty: Type) -> Handler
where
    O: Combining<f16> + Combining<f32> + Combining<f64>,
{
    match ty.bits() {
        16 => of_type::<Portable, O, f16>(family),
        64 => of_type::<T, O, f64>(family),
        _ => of_type::<T, O, f32>(family),
    }
}

fn of_type<T: Tier, O: Combining<S>, S: Lane + 'static>(family: Family) -> Handler {
    match family {
        Family::Reduce => T::handler::<Reduce<O, S, true>>(),
        Family::ReduceClusters => T::handler::<Reduce<O, S, false>>(),
        Family::Scan => T::handler::<Scan<O, S>>(),
        Family::Partitioned => Portable::handler::<Partitioned<O, S>>(),
    }
}

/// The scalars of the mask's lanes; `other` in the rest.
#[inline(always)]
fn masked<T: Lane>(slots: &Lanes<T::Slot>, mask: LaneMask, other: T) -> Lanes<T> {
    let mut scalars = [other; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        let scalar = T::read(slots[k]);
        scalars[k] = if mask.contains(k) { scalar } else { other };
    }
    scalars
}

#[inline(always)]
fn slots<T: Lane>(scalars: &Lanes<T>) -> Lanes<T::Slot> {
    let mut slots = [T::Slot::default(); SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        slots[k] = scalars[k].write();
    }
    slots
}

/// Combines each lane with the lane whose number differs in one bit.
#[inline(always)]
fn combine_pairs<O: Combining<T>, T: Copy, const BIT: usize>(scalars: &mut Lanes<T>) {
    let before = *scalars;
    for k in 0..SUBGROUP_SIZE {
        scalars[k] = O::call(before[k], before[k ^ BIT]);
    }
}

/// Combines the lanes of each cluster of `CLUSTER` lanes, a power of two.
#[inline(always)]
fn combine_clusters<O: Combining<T>, T: Copy, const CLUSTER: usize>(scalars: &mut Lanes<T>) {
    if !O::IS_ORDERED {
        if CLUSTER > 8 {
            combine_pairs::<O, T, 8>(scalars);
        }
        if CLUSTER > 4 {
            combine_pairs::<O, T, 4>(scalars);
        }
        if CLUSTER > 2 {
            combine_pairs::<O, T, 2>(scalars);
        }
        if CLUSTER > 1 {
            combine_pairs::<O, T, 1>(scalars);
        }
        return;
    }
    let before = *scalars;
    if CLUSTER == SUBGROUP_SIZE {
        let mut total = before[0];
        for k in 1..SUBGROUP_SIZE {
            total = O::call(total, before[k]);
        }
        *scalars = [total; SUBGROUP_SIZE];
        return;
    }
    // The chains of all clusters run side by side.
    for k in 0..SUBGROUP_SIZE {
        scalars[k] = before[k & !(CLUSTER - 1)];
    }
    for other in 1..CLUSTER {
        for k in 0..SUBGROUP_SIZE {
            scalars[k] = O::call(scalars[k], before[k & !(CLUSTER - 1) | other]);
        }
    }
}

/// Combines the mask's lanes in each cluster of `cluster` lanes.
#[inline(always)]
fn reduce<O: Combining<T>, T: Lane>(
    row: &Lanes<T::Slot>,
    mask: LaneMask,
    cluster: usize,
) -> Lanes<T::Slot> {
    let mut scalars = masked(row, mask, O::neutral());
    match cluster {
        0 | 1 => {}
        2 => combine_clusters::<O, T, 2>(&mut scalars),
        4 => combine_clusters::<O, T, 4>(&mut scalars),
        8 => combine_clusters::<O, T, 8>(&mut scalars),
        _ => combine_clusters::<O, T, SUBGROUP_SIZE>(&mut scalars),
    }
    slots(&scalars)
}

/// Combines each lane with the lane `STEP` before it.
#[inline(always)]
fn combine_steps<O: Combining<T>, T: Copy, const STEP: usize>(scalars: &mut Lanes<T>) {
    let mut before = [O::neutral(); SUBGROUP_SIZE];
    before[STEP..].copy_from_slice(&scalars[..SUBGROUP_SIZE - STEP]);
    for k in 0..SUBGROUP_SIZE {
        scalars[k] = O::call(before[k], scalars[k]);
    }
}

/// Combines the mask's lanes up to each lane; without the lane itself unless `inclusive`.
#[inline(always)]
fn scan<O: Combining<T>, T: Lane>(
    row: &Lanes<T::Slot>,
    mask: LaneMask,
    inclusive: bool,
) -> Lanes<T::Slot> {
    let mut scalars = masked(row, mask, O::neutral());
    if O::IS_ORDERED {
        for k in 1..SUBGROUP_SIZE {
            scalars[k] = O::call(scalars[k - 1], scalars[k]);
        }
    } else {
        combine_steps::<O, T, 1>(&mut scalars);
        combine_steps::<O, T, 2>(&mut scalars);
        combine_steps::<O, T, 4>(&mut scalars);
        combine_steps::<O, T, 8>(&mut scalars);
    }
    if !inclusive {
        let mut before = [O::identity(); SUBGROUP_SIZE];
        before[1..].copy_from_slice(&scalars[..SUBGROUP_SIZE - 1]);
        // No lane precedes the first. The identity may differ from the neutral scalar.
        let preceded = LaneMask::from_bits(u16::MAX << 1 << mask.first());
        for k in 0..SUBGROUP_SIZE {
            scalars[k] = match preceded.contains(k) {
                true => before[k],
                false => O::identity(),
            };
        }
    }
    slots(&scalars)
}

/// Combines the lanes of each lane's part in ascending order.
#[inline(always)]
fn combine_parts<O: Combining<T>, T: Lane>(
    row: &Lanes<T::Slot>,
    parts: &Lanes<u16>,
) -> Lanes<T::Slot> {
    let mut totals = [O::neutral(); SUBGROUP_SIZE];
    for other in 0..SUBGROUP_SIZE {
        let scalar = T::read(row[other]);
        for k in 0..SUBGROUP_SIZE {
            let with = O::call(totals[k], scalar);
            totals[k] = if parts[k] >> other & 1 != 0 {
                with
            } else {
                totals[k]
            };
        }
    }
    for k in 0..SUBGROUP_SIZE {
        totals[k] = if parts[k] != 0 {
            totals[k]
        } else {
            O::identity()
        };
    }
    slots(&totals)
}

/// A reduction by plan `x`: `d` from `a`, of `WHOLE` subgroups or of the plan's clusters.
struct Reduce<O, T, const WHOLE: bool>(PhantomData<(O, T)>);

impl<O: Combining<T>, T: Lane, const WHOLE: bool> Kernel for Reduce<O, T, WHOLE> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        let cluster = match plan.op {
            SubgroupOp::Reduce { cluster, .. } if !WHOLE => cluster.into(),
            _ => SUBGROUP_SIZE,
        };
        for &subgroup in m.listed() {
            let mask = participants(m, &plan, subgroup);
            // SAFETY: the caller guarantees that the instruction was emitted for this kernel, and
            // the machine runs its program; a block is read before it is written.
            unsafe {
                let row = *m.block::<T::Slot>(i.a, subgroup);
                *m.block::<T::Slot>(i.d, subgroup) = reduce::<O, T>(&row, mask, cluster);
            }
        }
    }
}

/// A scan by plan `x`: `d` from `a`.
struct Scan<O, T>(PhantomData<(O, T)>);

impl<O: Combining<T>, T: Lane> Kernel for Scan<O, T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        let inclusive = matches!(plan.op, SubgroupOp::InclusiveScan(_));
        for &subgroup in m.listed() {
            let mask = participants(m, &plan, subgroup);
            // SAFETY: as for `Reduce`.
            unsafe {
                let row = *m.block::<T::Slot>(i.a, subgroup);
                *m.block::<T::Slot>(i.d, subgroup) = scan::<O, T>(&row, mask, inclusive);
            }
        }
    }
}

/// A reduction or scan of parts by plan `x`: `d` from `a`, in the parts in `b`.
struct Partitioned<O, T>(PhantomData<(O, T)>);

impl<O: Combining<T>, T: Lane> Kernel for Partitioned<O, T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = m.code.subgroups[i.x as usize];
        for &subgroup in m.listed() {
            let mask = participants(m, &plan, subgroup);
            // SAFETY: as for `Reduce`.
            unsafe {
                let row = *m.block::<T::Slot>(i.a, subgroup);
                let named = *m.block::<u32>(i.b, subgroup);
                let mut parts = [0; SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    let seen = match plan.op {
                        SubgroupOp::PartitionedInclusiveScan(_) => LaneMask::full(k + 1),
                        SubgroupOp::PartitionedExclusiveScan(_) => LaneMask::full(k),
                        _ => LaneMask::ALL,
                    };
                    parts[k] = named[k] as u16 & (mask & seen).bits();
                }
                *m.block::<T::Slot>(i.d, subgroup) = combine_parts::<O, T>(&row, &parts);
            }
        }
    }
}
