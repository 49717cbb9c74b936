//! Atomics on real memory, in lane order.

use std::sync::atomic::{AtomicU16, AtomicU32, AtomicU64, Ordering};

use half::f16;

use super::code::AtomicPlan;
use super::machine::{Instr, Machine};
use super::region::region;
use crate::eval;
use crate::ir::Type;
use crate::ir::op::AtomicOp;

/// The atomic by plan `x`, its result in `d`. What lies outside its memory or is misaligned reads zero and changes nothing, and so does a helper
/// invocation.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs.
pub(super) unsafe fn atomic(m: &mut Machine<'_>, i: &Instr) {
    let plan: AtomicPlan = m.code.atomics[i.x as usize];
    let operands = &m.code.operands[plan.operands as usize..];
    let (address, values) = operands.split_at(plan.space.address_operands());
    let wide = plan.ty.rows() == 2;
    let size = plan.ty.size_bytes() as u64;
    for &subgroup in m.listed() {
        let active = m.active[subgroup as usize];
        let lanes = match plan.op {
            AtomicOp::Load => active,
            _ => m.effective(subgroup),
        };
        if plan.op != AtomicOp::Store {
            for lane in active - lanes {
                // SAFETY: as the caller promises.
                unsafe { m.set_lane(i.d, subgroup, lane, wide, 0) };
            }
        }
        for lane in lanes {
            // SAFETY: as the caller promises; the region is checked, and its memory is only shared with other shader threads.
            unsafe {
                let at = region(m, plan.space, address, subgroup, lane).at(0, size);
                let at = at.filter(|at| (*at as u64).is_multiple_of(size));
                let value = match value_count(plan.op) {
                    0 => 0,
                    _ => m.lane(values[0], subgroup, lane, wide),
                };
                let comparator = match value_count(plan.op) {
                    2 => m.lane(values[1], subgroup, lane, wide),
                    _ => 0,
                };
                let old = match at {
                    None => 0,
                    Some(at) if wide => {
                        let cell = AtomicU64::from_ptr(at.cast());
                        perform_64(cell, plan.op, plan.ty, value, comparator)
                    }
                    Some(at) if size == 2 => {
                        let cell = AtomicU16::from_ptr(at.cast());
                        perform_16(cell, plan.op, plan.ty, value as u16, comparator as u16) as u64
                    }
                    Some(at) => {
                        let cell = AtomicU32::from_ptr(at.cast());
                        perform_32(cell, plan.op, plan.ty, value as u32, comparator as u32) as u64
                    }
                };
                if plan.op != AtomicOp::Store {
                    m.set_lane(i.d, subgroup, lane, wide, old);
                }
            }
        }
    }
}

/// Value operands of an atomic.
pub(super) fn value_count(op: AtomicOp) -> usize {
    match op {
        AtomicOp::Load => 0,
        AtomicOp::CompareExchange => 2,
        _ => 1,
    }
}

macro_rules! perform {
    ($name:ident, $cell:ty, $u:ident, $f:ident) => {
        /// Performs the operation on a cell; returns the old value (0 for a store).
        fn $name(cell: &$cell, op: AtomicOp, ty: Type, value: $u, comparator: $u) -> $u {
            const ORDER: Ordering = Ordering::SeqCst;
            let update = |f: fn($u, $u) -> $u| {
                cell.fetch_update(ORDER, ORDER, |old| Some(f(old, value)))
                    .unwrap_or(0)
            };
            match op {
                AtomicOp::Load => cell.load(ORDER),
                AtomicOp::Store => {
                    cell.store(value, ORDER);
                    0
                }
                AtomicOp::Exchange => cell.swap(value, ORDER),
                AtomicOp::CompareExchange => cell
                    .compare_exchange(comparator, value, ORDER, ORDER)
                    .unwrap_or_else(|old| old),
                AtomicOp::IAdd => cell.fetch_add(value, ORDER),
                AtomicOp::ISub => cell.fetch_sub(value, ORDER),
                AtomicOp::UMin => cell.fetch_min(value, ORDER),
                AtomicOp::UMax => cell.fetch_max(value, ORDER),
                AtomicOp::And => cell.fetch_and(value, ORDER),
                AtomicOp::Or => cell.fetch_or(value, ORDER),
                AtomicOp::Xor => cell.fetch_xor(value, ORDER),
                AtomicOp::SMin => update(eval::smin),
                AtomicOp::SMax => update(eval::smax),
                AtomicOp::FAdd if ty.is_float() => {
                    update(|a, b| eval::fadd($f::from_bits(a), $f::from_bits(b)).to_bits())
                }
                AtomicOp::FMin if ty.is_float() => {
                    update(|a, b| eval::fmin($f::from_bits(a), $f::from_bits(b)).to_bits())
                }
                AtomicOp::FMax if ty.is_float() => {
                    update(|a, b| eval::fmax($f::from_bits(a), $f::from_bits(b)).to_bits())
                }
                AtomicOp::FAdd | AtomicOp::FMin | AtomicOp::FMax => 0,
            }
        }
    };
}
perform!(perform_16, AtomicU16, u16, f16);
perform!(perform_32, AtomicU32, u32, f32);
perform!(perform_64, AtomicU64, u64, f64);
