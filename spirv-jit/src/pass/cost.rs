//! The cost of an operation in all lanes, in units of a simple operation. Only comparisons of sums
//! are meaningful.

use crate::ir::Op;

/// The cost of one operation.
pub fn cost(op: &Op) -> u32 {
    match op {
        // Computed once, if at all.
        Op::Const(_) | Op::Uniform(_) | Op::PushConstants | Op::VarAddress(_) => 0,
        Op::FDiv | Op::FSqrt | Op::FInverseSqrt | Op::IMul | Op::Descriptor(_) => 2,
        Op::UDiv | Op::SDiv | Op::URem | Op::SRem | Op::SMod | Op::FRem | Op::FMod => 8,
        Op::UMulHi | Op::SMulHi | Op::FQuantizeF16 | Op::FLdexp | Op::FFrexpMantissa => 4,
        Op::FPow
        | Op::FAtan2
        | Op::FSin
        | Op::FCos
        | Op::FTan
        | Op::FAsin
        | Op::FAcos
        | Op::FAtan
        | Op::FSinh
        | Op::FCosh
        | Op::FTanh
        | Op::FAsinh
        | Op::FAcosh
        | Op::FAtanh
        | Op::FExp
        | Op::FLog
        | Op::FExp2
        | Op::FLog2 => 16,
        Op::FSinFast
        | Op::FCosFast
        | Op::FTanFast
        | Op::FAtanFast
        | Op::FExpFast
        | Op::FExp2Fast
        | Op::FLogFast
        | Op::FLog2Fast
        | Op::FInverseSqrtFast
        | Op::FPowFast
        | Op::FAtan2Fast => 10,
        _ => 1,
    }
}
