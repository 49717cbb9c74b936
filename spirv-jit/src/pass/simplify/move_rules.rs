//! Rules for operations that move bits: selects, casts, widths, packing; and for references to
//! descriptors.

use super::{Definition, Is, Outcome, Simplifier, becomes};
use crate::environment::reference;
use crate::ir::{Op, Type, Value};

impl Simplifier<'_> {
    pub(super) fn apply_move_rules(
        &mut self,
        op: &Op,
        args: &[Value],
        ty: Type,
    ) -> Option<Outcome> {
        let a = *args.first()?;
        match op {
            Op::Select => self.select_rules(a, args[1], args[2], ty),
            Op::Bitcast => self.bitcast_rules(a, ty),
            Op::Pack64 => self.pack_rules(a, args[1], ty),
            Op::UConvert | Op::SConvert => self.width_rules(op, a, ty),
            Op::FConvert => {
                if self.ty(a) == ty {
                    return Some(Is(a));
                }
                // A conversion to a wider type and back.
                let x = self.operand_of(a, &Op::FConvert)?;
                let wider = self.ty(a).bits() > ty.bits();
                (wider && self.ty(x) == ty).then_some(Is(x))
            }
            Op::DescriptorAt => self.descriptor_rules(a),
            _ => None,
        }
    }

    /// The descriptor that a reference names, if known.
    fn descriptor_rules(&mut self, reference: Value) -> Option<Outcome> {
        const PUSH_CONSTANTS: u64 = reference::of(reference::PUSH_CONSTANTS, 0);
        if self.constant(reference) == Some(PUSH_CONSTANTS) {
            return becomes(Op::PushConstants, &[]);
        }
        match self.pure(reference)? {
            (Op::DescriptorReference(binding), args) => {
                becomes(Op::Descriptor(binding), &[args[0]])
            }
            _ => None,
        }
    }

    fn select_rules(&mut self, condition: Value, x: Value, y: Value, ty: Type) -> Option<Outcome> {
        if x == y {
            return Some(Is(x));
        }
        if let Some(chosen) = self.constant(condition) {
            return Some(Is(if chosen != 0 { x } else { y }));
        }
        if let Some(inner) = self.operand_of(condition, &Op::Not) {
            return becomes(Op::Select, &[inner, y, x]);
        }
        if ty == Type::I1 {
            match (self.constant(x), self.constant(y)) {
                (Some(1), Some(0)) => return Some(Is(condition)),
                (Some(0), Some(1)) => return becomes(Op::Not, &[condition]),
                (Some(1), None) => return becomes(Op::Or, &[condition, y]),
                (None, Some(0)) => return becomes(Op::And, &[condition, x]),
                _ => {}
            }
            if x == condition {
                return becomes(Op::Or, &[condition, y]);
            }
            if y == condition {
                return becomes(Op::And, &[condition, x]);
            }
        }
        // A nested select with the same condition.
        match self.pure(x) {
            Some((Op::Select, inner)) if inner[0] == condition => {
                return becomes(Op::Select, &[condition, inner[1], y]);
            }
            _ => {}
        }
        match self.pure(y) {
            Some((Op::Select, inner)) if inner[0] == condition => {
                becomes(Op::Select, &[condition, x, inner[2]])
            }
            _ => None,
        }
    }

    fn bitcast_rules(&mut self, a: Value, ty: Type) -> Option<Outcome> {
        if self.ty(a) == ty {
            return Some(Is(a));
        }
        match self.pure(a) {
            Some((Op::Bitcast, inner)) => return becomes(Op::Bitcast, &[inner[0]]),
            Some((Op::Pack64, inner)) => return becomes(Op::Pack64, &[inner[0], inner[1]]),
            _ => {}
        }
        match self.definition(a) {
            // Inputs are words of either kind.
            Definition::Input(row) if ty.bits() == 32 => becomes(Op::Input(*row), &[]),
            _ => None,
        }
    }

    fn pack_rules(&mut self, low: Value, high: Value, ty: Type) -> Option<Outcome> {
        if let (
            Definition::Word { of, high: false },
            Definition::Word {
                of: same,
                high: true,
            },
        ) = (self.definition(low), self.definition(high))
            && of == same
        {
            return becomes(Op::Bitcast, &[*of]);
        }
        if ty == Type::I64 && self.constant(high) == Some(0) {
            return becomes(Op::UConvert, &[low]);
        }
        None
    }

    fn width_rules(&mut self, op: &Op, a: Value, ty: Type) -> Option<Outcome> {
        let from = self.ty(a);
        if from == ty {
            return Some(Is(a));
        }
        let (inner, args) = self.pure(a)?;
        let narrows = ty.bits() < from.bits();
        match inner {
            Op::Pack64 if narrows => {
                let low = args[0];
                if ty == Type::I32 {
                    return Some(Is(low));
                }
                becomes(Op::UConvert, &[low])
            }
            Op::UConvert | Op::SConvert => {
                let x = args[0];
                let origin = self.ty(x).bits();
                if narrows {
                    // Truncation removes the bits of an extension above the result's width.
                    return match ty.bits() {
                        width if width == origin => Some(Is(x)),
                        width if width < origin => becomes(Op::UConvert, &[x]),
                        _ => becomes(inner, &[x]),
                    };
                }
                // Two extensions of the same kind. After a zero extension the sign is zero.
                let extended = origin < from.bits();
                if extended && (inner == *op || inner == Op::UConvert) {
                    return becomes(inner, &[x]);
                }
                None
            }
            _ => None,
        }
    }
}
