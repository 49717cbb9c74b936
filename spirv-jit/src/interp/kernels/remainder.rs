//! `frem` and `fmod` of f32. Their definition is exact for any quotient and therefore a loop; as
//! long as the quotients of all lanes are moderate, a division in f64 gives the same bits in
//! straight code.

use std::marker::PhantomData;

use super::lane::{Binary, Map2};
use super::ops;
use crate::SUBGROUP_SIZE;
use crate::interp::machine::{Instr, Machine};
use crate::interp::tier::Kernel;

/// Quotients below this (2^28) and f32 operands: an inexact quotient in f64 is never rounded onto
/// an integer, since it is at least 2^-24 away from one, and its product with the divisor is exact.
const MODERATE: f64 = 268_435_456.0;

/// The correction of the remainder towards zero.
pub(super) trait Sign {
    fn fix(remainder: f32, divisor: f32) -> f32;
}

impl Sign for ops::frem {
    #[inline(always)]
    fn fix(remainder: f32, _: f32) -> f32 {
        remainder
    }
}

impl Sign for ops::fmod {
    #[inline(always)]
    fn fix(remainder: f32, divisor: f32) -> f32 {
        if remainder != 0.0 && (remainder < 0.0) != (divisor < 0.0) {
            remainder + divisor
        } else {
            remainder
        }
    }
}

pub(super) struct Remainder<O>(PhantomData<O>);

impl<O: Sign + Binary<f32, f32, f32>> Kernel for Remainder<O> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: operands are the program's.
        unsafe {
            // First only a question, because the result may lie where an operand does.
            let mut moderate = true;
            for &subgroup in m.listed() {
                let x = *m.block::<f32>(i.a, subgroup);
                let y = *m.block::<f32>(i.b, subgroup);
                let mut outside = 0u32;
                for k in 0..SUBGROUP_SIZE {
                    let quotient = x[k] as f64 / y[k] as f64;
                    let inside = quotient.abs() < MODERATE && y[k].is_finite();
                    outside |= !inside as u32;
                }
                moderate &= outside == 0;
            }
            if !moderate {
                return <Map2<O, f32, f32, f32> as Kernel>::run(m, i);
            }
            for &subgroup in m.listed() {
                let x = *m.block::<f32>(i.a, subgroup);
                let y = *m.block::<f32>(i.b, subgroup);
                let mut r = [0.0; SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    let (x, y) = (x[k] as f64, y[k] as f64);
                    let quotient = (x / y).trunc();
                    let remainder = (-quotient).mul_add(y, x) as f32;
                    r[k] = O::fix(remainder.copysign(x as f32), y as f32);
                }
                *m.block::<f32>(i.d, subgroup) = r;
            }
        }
    }
}
