//! Replaces operations with cheaper ones of the same results: constant folding, identities that
//! hold bit for bit (IEEE included, NaN payloads excepted), and inverse packing and casting.

mod bit_rules;
mod float_rules;
mod int_rules;
mod move_rules;

use smallvec::{SmallVec, smallvec};

use super::edit::{Edit, edit_body};
use super::fold_constants::fold;
use super::substitution::Substitution;
use crate::ir::{Body, Function, Inst, Node, Op, Type, Value};

/// Simplifies operations in one walk, in which operands are final before their uses.
pub fn simplify(function: &mut Function) {
    let mut body = std::mem::take(&mut function.body);
    let mut simplifier = Simplifier {
        substitution: Substitution::identity(function),
        definitions: vec![Definition::Opaque; function.value_types.len()],
        pure: Vec::with_capacity(function.value_types.len()),
        function,
        emitted: Vec::new(),
    };
    edit_body(&mut body, &mut simplifier);
    simplifier.function.body = body;
}

/// The definition of a value, for the rules.
#[derive(Clone, Copy, Debug)]
enum Definition {
    Opaque,
    Constant(u64),
    /// A word of the input record.
    Input(u32),
    /// A pure operation with one result, by its index.
    Pure(u32),
    /// A word of a 64-bit value.
    Word {
        of: Value,
        high: bool,
    },
}

/// The outcome of a rule for an operation.
enum Outcome {
    /// The result is this value.
    Is(Value),
    /// The result is this constant.
    Constant(u64),
    /// The result is that of this operation, which is simplified again.
    Becomes(Op, SmallVec<[Value; 4]>),
}

use Outcome::{Becomes, Is};

struct Simplifier<'a> {
    function: &'a mut Function,
    substitution: Substitution,
    definitions: Vec<Definition>,
    /// Pure operations with one result and up to three operands.
    pure: Vec<(Op, [Value; 3])>,
    /// Instructions to insert before the current one.
    emitted: Vec<Node>,
}

impl Edit for Simplifier<'_> {
    fn inst(&mut self, inst: &mut Inst, before: &mut Vec<Node>) -> bool {
        let stays = self.simplify_inst(inst);
        before.append(&mut self.emitted);
        stays
    }

    fn open(&mut self, construct: &mut Node) {
        self.substitution.resolve_all(construct.operands_mut());
    }

    fn end(&mut self, body: &mut Body) {
        self.substitution.resolve_terminator(&mut body.end);
    }
}

impl Simplifier<'_> {
    /// Whether the instruction stays.
    #[inline(never)]
    fn simplify_inst(&mut self, inst: &mut Inst) -> bool {
        self.substitution.resolve_all(&mut inst.args);
        if !inst.op.is_pure() {
            return true;
        }
        if inst.op == Op::Unpack64 {
            return self.simplify_unpack(inst);
        }
        let result = inst.results[0];
        // Each rule brings an operation closer to its normal form. The bound stops rules that
        // contradict each other.
        for _ in 0..8 {
            let ty = self.function.ty(result);
            let outcome = self
                .fold_inst(inst, ty)
                .or_else(|| self.apply_rules(inst, ty));
            match outcome {
                Some(Is(value)) => {
                    self.substitution.replace(result, value);
                    return false;
                }
                Some(Outcome::Constant(bits)) => {
                    inst.op = Op::Const(bits);
                    inst.args.clear();
                    break;
                }
                Some(Becomes(op, args)) => {
                    inst.op = op;
                    inst.args = args;
                }
                None => break,
            }
        }
        self.define(result, &inst.op, &inst.args);
        true
    }

    fn define(&mut self, result: Value, op: &Op, args: &[Value]) {
        let definition = match op {
            Op::Const(bits) => Definition::Constant(*bits),
            Op::Input(row) => Definition::Input(*row),
            _ if args.len() <= 3 && !args.is_empty() => {
                let mut operands = [args[0]; 3];
                operands[..args.len()].copy_from_slice(args);
                self.pure.push((*op, operands));
                Definition::Pure(self.pure.len() as u32 - 1)
            }
            _ => Definition::Opaque,
        };
        if self.definitions.len() <= result.index() {
            self.definitions
                .resize(result.index() + 1, Definition::Opaque);
        }
        self.definitions[result.index()] = definition;
    }

    fn simplify_unpack(&mut self, inst: &mut Inst) -> bool {
        if let Some((Op::Bitcast, args)) = self.pure(inst.args[0]) {
            inst.args[0] = args[0];
        }
        let (low, high) = (inst.results[0], inst.results[1]);
        let words = match self.pure(inst.args[0]) {
            Some((Op::Pack64, args)) => Some((args[0], args[1])),
            Some((Op::UConvert, args)) if self.ty(args[0]) == Type::I32 => {
                Some((args[0], self.emit_constant(0, Type::I32)))
            }
            _ => self.constant(inst.args[0]).map(|bits| {
                let low = self.emit_constant(bits & 0xffff_ffff, Type::I32);
                (low, self.emit_constant(bits >> 32, Type::I32))
            }),
        };
        if let Some((low_word, high_word)) = words {
            self.substitution.replace(low, low_word);
            self.substitution.replace(high, high_word);
            return false;
        }
        let of = inst.args[0];
        self.definitions[low.index()] = Definition::Word { of, high: false };
        self.definitions[high.index()] = Definition::Word { of, high: true };
        true
    }

    fn fold_inst(&self, inst: &Inst, ty: Type) -> Option<Outcome> {
        if inst.args.is_empty() {
            return None;
        }
        let mut bits: SmallVec<[u64; 4]> = smallvec![];
        for &arg in &inst.args {
            bits.push(self.constant(arg)?);
        }
        let main = match inst.op {
            Op::Select => inst.args[1],
            _ => inst.args[0],
        };
        fold(&inst.op, self.ty(main), ty, &bits).map(Outcome::Constant)
    }

    fn apply_rules(&mut self, inst: &Inst, ty: Type) -> Option<Outcome> {
        let args = &inst.args;
        if is_commutative(&inst.op)
            && self.constant(args[0]).is_some()
            && self.constant(args[1]).is_none()
        {
            let swapped = smallvec![args[1], args[0]];
            return Some(Becomes(inst.op, swapped));
        }
        self.apply_int_rules(&inst.op, args, ty)
            .or_else(|| self.apply_float_rules(&inst.op, args, ty))
            .or_else(|| self.apply_move_rules(&inst.op, args, ty))
    }

    fn ty(&self, value: Value) -> Type {
        self.function.ty(value)
    }

    fn definition(&self, value: Value) -> &Definition {
        self.definitions
            .get(value.index())
            .unwrap_or(&Definition::Opaque)
    }

    fn constant(&self, value: Value) -> Option<u64> {
        match self.definition(value) {
            Definition::Constant(bits) => Some(*bits),
            _ => None,
        }
    }

    /// The pure operation and operands that define a value.
    fn pure(&self, value: Value) -> Option<(Op, [Value; 3])> {
        match self.definition(value) {
            Definition::Pure(place) => Some(self.pure[*place as usize]),
            _ => None,
        }
    }

    /// The operand of the unary operation that defines a value.
    fn operand_of(&self, value: Value, wanted: &Op) -> Option<Value> {
        let (op, args) = self.pure(value)?;
        (op == *wanted).then_some(args[0])
    }

    fn emit_constant(&mut self, bits: u64, ty: Type) -> Value {
        self.emit(Op::Const(bits), &[], ty)
    }

    fn emit(&mut self, op: Op, args: &[Value], ty: Type) -> Value {
        let result = self.function.new_value(ty);
        self.define(result, &op, args);
        self.emitted.push(Node::Inst(Inst {
            op,
            args: SmallVec::from_slice(args),
            results: smallvec![result],
            source: 0,
        }));
        result
    }
}

fn becomes(op: Op, args: &[Value]) -> Option<Outcome> {
    Some(Becomes(op, SmallVec::from_slice(args)))
}

fn is_commutative(op: &Op) -> bool {
    matches!(
        op,
        Op::IAdd
            | Op::IMul
            | Op::UMulHi
            | Op::SMulHi
            | Op::And
            | Op::Or
            | Op::Xor
            | Op::SMin
            | Op::SMax
            | Op::UMin
            | Op::UMax
            | Op::IEq
            | Op::INe
            | Op::FAdd
            | Op::FMul
            | Op::FOEq
            | Op::FONe
            | Op::FUEq
            | Op::FUNe
    )
}

/// The bits of a type's width.
fn mask(ty: Type) -> u64 {
    u64::MAX >> (64 - ty.bits())
}
