//! Rules that follow from bits that are known to be zero: masks and bounds that change nothing,
//! shifts there and back, and parts that make up one value.

use super::{Is, Outcome, Simplifier, mask};
use crate::ir::{Op, Type, Value};

/// Operations that are looked through, at most, one behind another.
const MOST_DEEP: u32 = 4;

impl Simplifier<'_> {
    /// `a op k`.
    pub(super) fn bit_rules(&mut self, op: &Op, a: Value, k: u64, ty: Type) -> Option<Outcome> {
        if ty == Type::I1 {
            return None;
        }
        match op {
            Op::And if self.possible_bits(a, MOST_DEEP) & !k == 0 => Some(Is(a)),
            Op::UMin if self.most(a) <= k => Some(Is(a)),
            Op::Shl | Op::LShr if k < u64::from(ty.bits()) => self.shift_rules(op, a, k, ty),
            _ => None,
        }
    }

    /// Parts of one value, as by masks of its lower and its upper bits.
    pub(super) fn joined_parts(
        &mut self,
        op: &Op,
        a: Value,
        b: Value,
        ty: Type,
    ) -> Option<Outcome> {
        if !matches!(op, Op::IAdd | Op::Or | Op::Xor) || ty == Type::I1 {
            return None;
        }
        let (Op::And, [x, m, _]) = self.pure(a)? else {
            return None;
        };
        let (Op::And, [y, n, _]) = self.pure(b)? else {
            return None;
        };
        let (m, n) = (self.constant(m)?, self.constant(n)?);
        if x != y || m & n != 0 {
            return None;
        }
        self.with_constant(Op::And, x, m | n, ty)
    }

    /// Shifts of what was shifted back, and of what was masked: a mask keeps all bits that stay.
    fn shift_rules(&mut self, op: &Op, a: Value, k: u64, ty: Type) -> Option<Outcome> {
        let (inner, [x, y, _]) = self.pure(a)?;
        let y = self.constant(y)?;
        let ones = mask(ty);
        // The bits that stay, in the result and in the operand.
        let (after, before) = match op {
            Op::Shl => (ones << k & ones, ones >> k),
            _ => (ones >> k, ones << k & ones),
        };
        match (op, inner) {
            (Op::Shl, Op::LShr) | (Op::LShr, Op::Shl) if y == k => {
                self.with_constant(Op::And, x, after, ty)
            }
            (_, Op::And) if before & !y == 0 => self.with_constant(*op, x, k, ty),
            _ => None,
        }
    }

    /// A number that a value is not greater than.
    fn most(&self, value: Value) -> u64 {
        let bits = self.possible_bits(value, MOST_DEEP);
        match self.pure(value) {
            Some((Op::UMin, [_, bound, _])) => self.constant(bound).map_or(bits, |k| bits.min(k)),
            _ => bits,
        }
    }

    /// The bits of a value that may be set.
    fn possible_bits(&self, value: Value, depth: u32) -> u64 {
        let ty = self.ty(value);
        let ones = mask(ty);
        if let Some(k) = self.constant(value) {
            return k;
        }
        let Some((op, [x, y, z])) = self.pure(value).filter(|_| depth > 0) else {
            return ones;
        };
        let bits = |value| self.possible_bits(value, depth - 1);
        let count = || self.constant(y).filter(|&k| k < u64::from(ty.bits()));
        // All bits from the lowest one on.
        let from = |lowest: u32| ones & u64::MAX.checked_shl(lowest).unwrap_or(0);
        match op {
            Op::Shl => count().map_or(ones, |k| bits(x) << k & ones),
            Op::LShr => count().map_or(ones, |k| bits(x) >> k),
            Op::And => bits(x) & bits(y),
            Op::Or | Op::Xor => bits(x) | bits(y),
            Op::Select => bits(y) | bits(z),
            Op::IAdd => from((bits(x) | bits(y)).trailing_zeros()),
            Op::IMul => from(bits(x).trailing_zeros() + bits(y).trailing_zeros()),
            Op::UConvert => bits(x) & ones,
            Op::UMin => {
                let either = bits(x) | bits(y);
                let top = bits(x).leading_zeros().max(bits(y).leading_zeros());
                either & u64::MAX.checked_shr(top).unwrap_or(0)
            }
            _ => ones,
        }
    }
}
