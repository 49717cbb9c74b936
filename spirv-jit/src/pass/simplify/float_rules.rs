//! Rules for floats. They give the same bits for every operand, infinities, zeros of both signs and
//! denormals included. A NaN must stay a NaN.

use super::{Is, Outcome, Simplifier, becomes};
use crate::ir::{Op, Type, Value};

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
