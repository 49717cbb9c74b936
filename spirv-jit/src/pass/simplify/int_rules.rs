//! Rules for integers and booleans.

use super::{Becomes, Definition, Is, Outcome, Simplifier, becomes, mask};
use crate::ir::{Op, Type, Value};
use crate::pass::fold_constants::fold;
use smallvec::{SmallVec, smallvec};

/// Terms of a sum in which some may cancel, at most.
const MOST_TERMS: usize = 6;

/// Terms that are replaced by theirs, at most.
const MOST_REPLACED: usize = 8;

impl Simplifier<'_> {
    pub(super) fn apply_int_rules(&mut self, op: &Op, args: &[Value], ty: Type) -> Option<Outcome> {
        let a = *args.first()?;
        match op {
            Op::Not => return self.not_rules(a),
            Op::INeg | Op::BitReverse => return self.operand_of(a, op).map(Is),
            Op::BitfieldUExtract | Op::BitfieldSExtract => return self.extract_rules(op, args, ty),
            _ => {}
        }
        let b = *args.get(1)?;
        if a == b
            && let Some(outcome) = same_operands(op, a)
        {
            return Some(outcome);
        }
        if let Some(outcome) = self.cancel_terms(op, a, b, ty) {
            return Some(outcome);
        }
        if let Some(outcome) = self.joined_parts(op, a, b, ty) {
            return Some(outcome);
        }
        let k = self.constant(b);
        let comparison = matches!(
            op,
            Op::IEq | Op::INe | Op::ULt | Op::ULe | Op::SLt | Op::SLe
        );
        if comparison {
            return self.comparison_rules(op, a, b, k);
        }
        self.constant_operand(op, a, k?, ty)
    }

    /// A sum or difference of sums and differences with terms that cancel. Of the terms, that which
    /// was computed last is replaced by its own terms: no other can have been computed from it.
    fn cancel_terms(&mut self, op: &Op, a: Value, b: Value, ty: Type) -> Option<Outcome> {
        if !matches!(op, Op::IAdd | Op::ISub) || ty == Type::I1 {
            return None;
        }
        let mut terms: SmallVec<[(Value, bool); MOST_TERMS]> = SmallVec::new();
        let mut more: SmallVec<[(Value, bool); 2]> = smallvec![(a, true), (b, *op == Op::IAdd)];
        for _ in 0..MOST_REPLACED {
            for (value, is_positive) in more {
                let opposite = (value, !is_positive);
                match terms.iter().position(|&term| term == opposite) {
                    Some(index) => drop(terms.swap_remove(index)),
                    None => terms.push((value, is_positive)),
                }
            }
            match terms[..] {
                [] => return Some(Outcome::Constant(0)),
                [(value, true)] => return Some(Is(value)),
                [(value, false)] => return becomes(Op::INeg, &[value]),
                _ if terms.len() >= MOST_TERMS => return None,
                _ => {}
            }
            let (_, last) = (terms.iter().enumerate())
                .filter_map(|(index, &(value, _))| Some((self.place_of_sum(value)?, index)))
                .max()?;
            let (value, is_positive) = terms.swap_remove(last);
            more = self.terms(value);
            (more.iter_mut()).for_each(|(_, is_added)| *is_added = *is_added == is_positive);
        }
        None
    }

    /// Where a sum stands among pure operations.
    fn place_of_sum(&self, value: Value) -> Option<u32> {
        match self.definition(value) {
            Definition::Pure(place) => {
                let (op, _) = self.pure[*place as usize];
                matches!(op, Op::IAdd | Op::ISub | Op::INeg).then_some(*place)
            }
            _ => None,
        }
    }

    /// The terms of a value, and whether each is added or subtracted.
    fn terms(&self, value: Value) -> SmallVec<[(Value, bool); 2]> {
        match self.pure(value) {
            Some((Op::IAdd, [x, y, _])) => smallvec![(x, true), (y, true)],
            Some((Op::ISub, [x, y, _])) => smallvec![(x, true), (y, false)],
            Some((Op::INeg, [x, ..])) => smallvec![(x, false)],
            _ => smallvec![(value, true)],
        }
    }

    fn not_rules(&mut self, a: Value) -> Option<Outcome> {
        let (op, args) = self.pure(a)?;
        let (x, y) = (args[0], args.get(1).copied());
        let inverse = match op {
            Op::Not => return Some(Is(x)),
            Op::IEq => Op::INe,
            Op::INe => Op::IEq,
            Op::ULt => Op::ULe,
            Op::ULe => Op::ULt,
            Op::SLt => Op::SLe,
            Op::SLe => Op::SLt,
            Op::FOEq => Op::FUNe,
            Op::FUNe => Op::FOEq,
            Op::FONe => Op::FUEq,
            Op::FUEq => Op::FONe,
            Op::FOLt => Op::FULe,
            Op::FOLe => Op::FULt,
            Op::FULt => Op::FOLe,
            Op::FULe => Op::FOLt,
            _ => return None,
        };
        // not (x < y) is y <= x; equality keeps its operands.
        match inverse {
            Op::IEq | Op::INe | Op::FOEq | Op::FUNe | Op::FONe | Op::FUEq => {
                becomes(inverse, &[x, y?])
            }
            _ => becomes(inverse, &[y?, x]),
        }
    }

    /// A field at a constant offset is a shift and a mask.
    fn extract_rules(&mut self, op: &Op, args: &[Value], ty: Type) -> Option<Outcome> {
        let offset = self.constant(args[1])?;
        let count = self.constant(args[2])?;
        let width = ty.bits() as u64;
        if count == 0 {
            return Some(Outcome::Constant(0));
        }
        if offset + count > width {
            return None;
        }
        let base = args[0];
        if *op == Op::BitfieldUExtract {
            let shifted = if offset == 0 {
                base
            } else {
                let by = self.emit_constant(offset, ty);
                self.emit(Op::LShr, &[base, by], ty)
            };
            if offset + count == width {
                return Some(Is(shifted));
            }
            let field = self.emit_constant(mask(ty) >> (width - count), ty);
            return becomes(Op::And, &[shifted, field]);
        }
        let up = self.emit_constant(width - offset - count, ty);
        let down = self.emit_constant(width - count, ty);
        let shifted = self.emit(Op::Shl, &[base, up], ty);
        becomes(Op::AShr, &[shifted, down])
    }

    fn comparison_rules(&mut self, op: &Op, a: Value, b: Value, k: Option<u64>) -> Option<Outcome> {
        let k = k?;
        let operands = self.ty(a);
        if operands == Type::I1 {
            return match (op, k) {
                (Op::IEq, 1) | (Op::INe, 0) => Some(Is(a)),
                (Op::IEq, 0) | (Op::INe, 1) => becomes(Op::Not, &[a]),
                _ => None,
            };
        }
        match (op, k) {
            // No unsigned value is below zero, and only zero is not above it.
            (Op::ULt, 0) => return Some(Outcome::Constant(0)),
            (Op::ULe, 0) => return becomes(Op::IEq, &[a, b]),
            (Op::ULt, 1) => {
                let zero = self.emit_constant(0, operands);
                return becomes(Op::IEq, &[a, zero]);
            }
            _ => {}
        }
        // A comparison of a select between constants: a boolean that was converted to an integer.
        let (Op::Select, choice) = self.pure(a)? else {
            return None;
        };
        let on_true = self.constant(choice[1])?;
        let on_false = self.constant(choice[2])?;
        let compare = |value| fold(op, operands, Type::I1, &[value, k]);
        match (compare(on_true)?, compare(on_false)?) {
            (1, 0) => Some(Is(choice[0])),
            (0, 1) => becomes(Op::Not, &[choice[0]]),
            (both, _) => Some(Outcome::Constant(both)),
        }
    }

    fn constant_operand(&mut self, op: &Op, a: Value, k: u64, ty: Type) -> Option<Outcome> {
        if let Some(outcome) = self.bit_rules(op, a, k, ty) {
            return Some(outcome);
        }
        let ones = mask(ty);
        let power = (k.count_ones() == 1).then(|| k.trailing_zeros() as u64);
        match (op, k) {
            (
                Op::IAdd | Op::ISub | Op::Or | Op::Xor | Op::Shl | Op::LShr | Op::AShr | Op::UMax,
                0,
            ) => Some(Is(a)),
            (Op::IMul | Op::And | Op::UMulHi | Op::SMulHi | Op::UMin, 0) => {
                Some(Outcome::Constant(0))
            }
            (Op::IMul | Op::UDiv | Op::SDiv, 1) if ty != Type::I1 => Some(Is(a)),
            (Op::URem | Op::SRem | Op::SMod, 1) if ty != Type::I1 => Some(Outcome::Constant(0)),
            (Op::And | Op::UMin, _) if k == ones => Some(Is(a)),
            (Op::Or | Op::UMax, _) if k == ones => Some(Outcome::Constant(ones)),
            (Op::Xor, _) if k == ones => becomes(Op::Not, &[a]),
            // Counts are modulo the width.
            (Op::Shl | Op::LShr | Op::AShr, _) if k >= ty.bits() as u64 => {
                let count = self.emit_constant(k % ty.bits() as u64, ty);
                becomes(*op, &[a, count])
            }
            (Op::ISub, _) if ty != Type::I1 => {
                let negative = self.emit_constant(k.wrapping_neg() & ones, ty);
                becomes(Op::IAdd, &[a, negative])
            }
            (Op::IMul, _) if power.is_some() && ty != Type::I1 => {
                self.with_constant(Op::Shl, a, power?, ty)
            }
            (Op::UDiv, _) if power.is_some() && ty != Type::I1 => {
                self.with_constant(Op::LShr, a, power?, ty)
            }
            (Op::URem, _) if power.is_some() && ty != Type::I1 => {
                self.with_constant(Op::And, a, k - 1, ty)
            }
            (Op::IAdd | Op::IMul | Op::And | Op::Or | Op::Xor, _) => self.chain_rules(op, a, k, ty),
            (Op::Shl | Op::LShr, _) => self.shift_chain(op, a, k, ty),
            _ => None,
        }
    }

    pub(super) fn with_constant(&mut self, op: Op, a: Value, k: u64, ty: Type) -> Option<Outcome> {
        let k = self.emit_constant(k, ty);
        Some(Becomes(op, smallvec![a, k]))
    }

    /// `(x op c) op k` is `x op (c op k)` for associative operations.
    fn chain_rules(&mut self, op: &Op, a: Value, k: u64, ty: Type) -> Option<Outcome> {
        let (inner, args) = self.pure(a)?;
        if inner != *op {
            return None;
        }
        let c = self.constant(args[1])?;
        let both = fold(op, ty, ty, &[c, k])?;
        self.with_constant(*op, args[0], both, ty)
    }

    fn shift_chain(&mut self, op: &Op, a: Value, k: u64, ty: Type) -> Option<Outcome> {
        let (inner, args) = self.pure(a)?;
        if inner != *op {
            return None;
        }
        let width = ty.bits() as u64;
        let both = self.constant(args[1])? % width + k;
        if both >= width {
            return Some(Outcome::Constant(0));
        }
        self.with_constant(*op, args[0], both, ty)
    }
}

/// `x op x`.
fn same_operands(op: &Op, a: Value) -> Option<Outcome> {
    match op {
        Op::And | Op::Or | Op::SMin | Op::SMax | Op::UMin | Op::UMax => Some(Is(a)),
        Op::ISub | Op::Xor | Op::INe | Op::ULt | Op::SLt => Some(Outcome::Constant(0)),
        Op::IEq | Op::ULe | Op::SLe => Some(Outcome::Constant(1)),
        _ => None,
    }
}
