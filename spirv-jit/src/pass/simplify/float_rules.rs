//! Rules for floats. They give the same bits for every operand, infinities, zeros of both signs and
//! denormals included. A NaN must stay a NaN.

use super::{Is, Outcome, Simplifier, becomes};
use crate::ir::{Op, Type, Value};

/// Operations between a flush and the operation whose result is never denormal.
const FLUSH_DEPTH: u32 = 4;

impl Simplifier<'_> {
    pub(super) fn apply_float_rules(
        &mut self,
        op: &Op,
        args: &[Value],
        ty: Type,
    ) -> Option<Outcome> {
        let a = *args.first()?;
        match op {
            Op::FNeg => self.operand_of(a, &Op::FNeg).map(Is),
            Op::FAbs => match self.pure(a)? {
                (Op::FAbs, _) => Some(Is(a)),
                (Op::FNeg, inner) => becomes(Op::FAbs, &[inner[0]]),
                _ => None,
            },
            Op::FFloor | Op::FCeil | Op::FTrunc | Op::FRoundEven | Op::FRound => {
                match self.pure(a)?.0 {
                    Op::FFloor | Op::FCeil | Op::FTrunc | Op::FRoundEven | Op::FRound => {
                        Some(Is(a))
                    }
                    _ => None,
                }
            }
            // A 16-bit float is computed as f32, where it is not denormal.
            Op::FFlushDenormal if ty == Type::F16 => Some(Is(a)),
            Op::FFlushDenormal if self.is_never_denormal(a, FLUSH_DEPTH) => Some(Is(a)),
            Op::FMin | Op::FMax if a == args[1] => Some(Is(a)),
            Op::FAdd | Op::FSub => self.sum_rules(op, a, args[1], ty),
            Op::FMul | Op::FDiv => self.product_rules(op, a, args[1], ty),
            Op::FFma => {
                let x = self.operand_of(a, &Op::FNeg)?;
                let y = self.operand_of(args[1], &Op::FNeg)?;
                becomes(Op::FFma, &[x, y, args[2]])
            }
            _ => None,
        }
    }

    /// Whether an f32 or f64 is known not to be denormal. `depth` bounds the operations that are
    /// looked at one behind another.
    fn is_never_denormal(&self, value: Value, depth: u32) -> bool {
        let ty = self.ty(value);
        if let Some(bits) = self.constant(value) {
            let magnitude = bits & !sign_bit(ty);
            return magnitude == 0 || magnitude >> significand_bits(ty) != 0;
        }
        let Some((op, args)) = self.pure(value) else {
            return false;
        };
        let is_one_of = |values: &[Value]| {
            depth > 0 && (values.iter()).all(|&value| self.is_never_denormal(value, depth - 1))
        };
        match op {
            // Whole numbers.
            Op::FFloor | Op::FCeil | Op::FTrunc | Op::FRoundEven | Op::FRound | Op::FSign => true,
            Op::SToF | Op::UToF => true,
            Op::FFlushDenormal | Op::FQuantizeF16 => true,
            // The root of the least denormal number is normal, as is the inverse of the greatest
            // number's.
            Op::FSqrt | Op::FInverseSqrt | Op::FFrexpMantissa => true,
            Op::FConvert => ty.bits() > self.ty(args[0]).bits(),
            // Numbers that nearly cancel a greater one are multiples of the least normal number.
            Op::FAdd | Op::FSub => args[..2].iter().any(|&it| self.is_above_tiny(it)),
            // No smaller than the operand.
            Op::FMul => self.is_at_least_one(args[1], false) && is_one_of(&args[..1]),
            Op::FDiv => self.is_at_least_one(args[1], true) && is_one_of(&args[..1]),
            Op::FNeg | Op::FAbs | Op::FFract => is_one_of(&args[..1]),
            Op::FMin | Op::FMax => is_one_of(&args[..2]),
            Op::Select => is_one_of(&args[1..]),
            _ => false,
        }
    }

    /// A constant whose last place is twice the least normal number or more.
    fn is_above_tiny(&self, value: Value) -> bool {
        let ty = self.ty(value);
        let magnitude = self.constant(value).map(|bits| bits & !sign_bit(ty));
        let above = u64::from(significand_bits(ty) + 2) << significand_bits(ty);
        magnitude.is_some_and(|magnitude| magnitude >= above)
    }

    /// A constant of magnitude 1 or more, or the inverse of such.
    fn is_at_least_one(&self, value: Value, is_inverse: bool) -> bool {
        let ty = self.ty(value);
        let magnitude = self.constant(value).map(|bits| bits & !sign_bit(ty));
        magnitude.is_some_and(|magnitude| match is_inverse {
            true => magnitude <= one(ty),
            false => magnitude >= one(ty),
        })
    }

    fn sum_rules(&mut self, op: &Op, a: Value, b: Value, ty: Type) -> Option<Outcome> {
        let adds = *op == Op::FAdd;
        let negative_zero = sign_bit(ty);
        // x + -0 and x - 0 keep every x, zeros included; x + 0 would turn -0 into 0.
        match self.constant(b) {
            Some(bits) if adds && bits == negative_zero => return Some(Is(a)),
            Some(0) if !adds => return Some(Is(a)),
            _ => {}
        }
        if !adds && self.constant(a) == Some(negative_zero) {
            return becomes(Op::FNeg, &[b]);
        }
        if let Some(x) = self.operand_of(b, &Op::FNeg) {
            return becomes(if adds { Op::FSub } else { Op::FAdd }, &[a, x]);
        }
        if adds && let Some(x) = self.operand_of(a, &Op::FNeg) {
            return becomes(Op::FSub, &[b, x]);
        }
        None
    }

    fn product_rules(&mut self, op: &Op, a: Value, b: Value, ty: Type) -> Option<Outcome> {
        if let Some(bits) = self.constant(b) {
            if bits == one(ty) {
                return Some(Is(a));
            }
            if bits == one(ty) | sign_bit(ty) {
                return becomes(Op::FNeg, &[a]);
            }
            if *op == Op::FDiv
                && let Some(inverse) = exact_inverse(bits, ty)
            {
                let inverse = self.emit_constant(inverse, ty);
                return becomes(Op::FMul, &[a, inverse]);
            }
        }
        let x = self.operand_of(a, &Op::FNeg)?;
        let y = self.operand_of(b, &Op::FNeg)?;
        becomes(*op, &[x, y])
    }
}

fn sign_bit(ty: Type) -> u64 {
    1 << (ty.bits() - 1)
}

/// Explicit bits of the significand.
fn significand_bits(ty: Type) -> u32 {
    match ty {
        Type::F16 => 10,
        Type::F32 => 23,
        _ => 52,
    }
}

/// The largest finite exponent, which is also the bias.
fn bias(ty: Type) -> u64 {
    match ty {
        Type::F16 => 15,
        Type::F32 => 127,
        _ => 1023,
    }
}

fn one(ty: Type) -> u64 {
    bias(ty) << significand_bits(ty)
}

/// 1/x for a normal power of two with a normal inverse.
fn exact_inverse(bits: u64, ty: Type) -> Option<u64> {
    let sign = bits & sign_bit(ty);
    let magnitude = bits ^ sign;
    let exponent = magnitude >> significand_bits(ty);
    let is_power = magnitude == exponent << significand_bits(ty);
    let inverse = (2 * bias(ty)).checked_sub(exponent)?;
    (is_power && exponent > 0 && inverse > 0).then_some(sign | inverse << significand_bits(ty))
}
