//! Pure operations on what is there.

use spirv_jit::ir::op::Signature;
use spirv_jit::ir::{Node, Op, Type, Value};

use super::{Generator, Random};

macro_rules! list_ops {
    ($(($variant:ident, $text:ident, $signature:ident))*) => {
        const ELEMENTWISE: &[Op] = &[$(Op::$variant),*];
    };
}
spirv_jit::elementwise_ops!(list_ops);

const INTEGERS: [Type; 6] = [
    Type::I32,
    Type::I32,
    Type::I32,
    Type::I64,
    Type::I16,
    Type::I8,
];
const FLOATS: [Type; 5] = [Type::F32, Type::F32, Type::F32, Type::F64, Type::F16];

/// Small numbers, powers of two, extremes, and anything.
pub fn random_constant(random: &mut Random, ty: Type) -> u64 {
    let mask = u64::MAX >> (64 - ty.bits());
    let any = random.next();
    let choice = random.below(8);
    if ty.is_float() {
        let number = match choice {
            0 => 0.0,
            1 => -0.0,
            2 => 1.0,
            3 => -1.0,
            4 => 2f64.powi((any % 9) as i32 - 4),
            5 => f64::INFINITY,
            _ => (any % 1000) as f64 / 8.0 - 60.0,
        };
        return match ty {
            Type::F64 => number.to_bits(),
            Type::F32 => (number as f32).to_bits() as u64,
            // Half precision of what is exact in it.
            _ => match choice {
                0 => 0,
                1 => 0x8000,
                2 => 0x3c00,
                3 => 0xbc00,
                5 => 0x7c00,
                _ => 0x3800 + any % 0x1000,
            },
        };
    }
    let bits = match choice {
        0 | 1 => any % 16,
        2 => 1 << (any % ty.bits() as u64),
        3 => mask,
        4 => mask >> 1,
        5 => 0,
        6 => 1,
        _ => any,
    };
    bits & mask
}

impl Generator<'_> {
    pub fn operation(&mut self, nodes: &mut Vec<Node>) {
        if self.random.one_in(4) {
            return self.unlike_operation(nodes);
        }
        let op = ELEMENTWISE[self.random.below(ELEMENTWISE.len())];
        // Few of the functions that no rule looks into.
        if super::operations::is_transcendental(&op) && !self.random.one_in(8) {
            return self.operation(nodes);
        }
        let int = INTEGERS[self.random.below(INTEGERS.len())];
        let float = FLOATS[self.random.below(FLOATS.len())];
        let bits = if self.random.one_in(4) { Type::I1 } else { int };
        let (types, result): (&[Type], Type) = match op.signature() {
            Signature::BitsUnary => (&[bits], bits),
            Signature::BitsBinary => (&[bits, bits], bits),
            Signature::BitsCompare => (&[bits, bits], Type::I1),
            Signature::IntUnary => (&[int], int),
            Signature::IntBinary => (&[int, int], int),
            Signature::IntCompare => (&[int, int], Type::I1),
            Signature::FloatUnary | Signature::FloatFunction => (&[float], float),
            Signature::FloatBinary => (&[float, float], float),
            Signature::FloatTernary => (&[float, float, float], float),
            Signature::FloatCompare => (&[float, float], Type::I1),
            Signature::FloatTest => (&[float], Type::I1),
            _ => return self.conversion(op, nodes),
        };
        let mut args: Vec<Value> = types.iter().map(|&ty| self.pick(ty, nodes)).collect();
        // Most rules look at a constant on one side.
        if args.len() > 1 && self.random.one_in(2) {
            let bits = random_constant(self.random, types[0]);
            let side = if self.random.one_in(4) { 0 } else { 1 };
            args[side] = self.constant(bits, types[0], nodes);
        }
        let value = self.emit_one(op, &args, result, nodes);
        self.show(value);
    }

    fn conversion(&mut self, op: Op, nodes: &mut Vec<Node>) {
        let int = INTEGERS[self.random.below(INTEGERS.len())];
        let other = INTEGERS[self.random.below(INTEGERS.len())];
        let float = FLOATS[self.random.below(FLOATS.len())];
        let narrow = FLOATS[self.random.below(FLOATS.len())];
        let (from, to) = match op {
            Op::FToS | Op::FToU => (float, int),
            Op::SToF | Op::UToF => (int, float),
            Op::FConvert => (float, narrow),
            Op::FFrexpExponent => (float, Type::I32),
            Op::Bitcast if self.random.one_in(2) => {
                let float = self.pick(float, nodes);
                let bits = self.canonical_bits(float, nodes);
                return self.show(bits);
            }
            Op::Bitcast => (float.as_integer(), float),
            _ => (int, other),
        };
        let value = self.pick(from, nodes);
        // The exponent of infinity or NaN is unspecified.
        let value = match op {
            Op::FFrexpExponent => self.emit_one(Op::FFract, &[value], from, nodes),
            _ => value,
        };
        let result = self.emit_one(op, &[value], to, nodes);
        self.show(result);
    }

    /// A float's bits, those of NaN made one.
    pub fn canonical_bits(&mut self, float: Value, nodes: &mut Vec<Node>) -> Value {
        let ty = self.function.ty(float);
        let is_nan = self.emit_one(Op::FIsNan, &[float], Type::I1, nodes);
        let bits = self.emit_one(Op::Bitcast, &[float], ty.as_integer(), nodes);
        let zero = self.constant(0, ty.as_integer(), nodes);
        self.emit_one(Op::Select, &[is_nan, zero, bits], ty.as_integer(), nodes)
    }

    fn unlike_operation(&mut self, nodes: &mut Vec<Node>) {
        let int = INTEGERS[self.random.below(INTEGERS.len())];
        let ty = [Type::I32, Type::F32, Type::I1, Type::I64, Type::F16][self.random.below(5)];
        let value = match self.random.below(8) {
            0..3 => {
                let condition = self.pick(Type::I1, nodes);
                let args = [condition, self.pick(ty, nodes), self.pick(ty, nodes)];
                self.emit_one(Op::Select, &args, ty, nodes)
            }
            3 => {
                let args = [self.pick(Type::I32, nodes), self.pick(Type::I32, nodes)];
                self.emit_one(Op::Pack64, &args, Type::I64, nodes)
            }
            4 => {
                let value = self.pick(Type::I64, nodes);
                let words = self.emit(Op::Unpack64, &[value], &[Type::I32; 2], nodes);
                self.show(words[0]);
                words[1]
            }
            5 => {
                let op = [Op::BitfieldSExtract, Op::BitfieldUExtract][self.random.below(2)];
                let base = self.pick(int, nodes);
                let range = self.bit_range(int, nodes);
                self.emit_one(op, &[base, range[0], range[1]], int, nodes)
            }
            6 => {
                let args = [self.pick(int, nodes), self.pick(int, nodes)];
                let range = self.bit_range(int, nodes);
                let args = [args[0], args[1], range[0], range[1]];
                self.emit_one(Op::BitfieldInsert, &args, int, nodes)
            }
            _ => {
                let args = [self.pick(Type::F32, nodes), self.pick(Type::I32, nodes)];
                self.emit_one(Op::FLdexp, &args, Type::F32, nodes)
            }
        };
        self.show(value);
    }

    /// Offset and count inside a width.
    fn bit_range(&mut self, ty: Type, nodes: &mut Vec<Node>) -> [Value; 2] {
        let offset = self.random.below(ty.bits() as usize) as u64;
        let count = self.random.below(ty.bits() as usize - offset as usize + 1) as u64;
        [
            self.constant(offset, Type::I32, nodes),
            self.constant(count, Type::I32, nodes),
        ]
    }
}

fn is_transcendental(op: &Op) -> bool {
    let name = op.text();
    ["pow", "sin", "cos", "tan", "exp", "log", "frem", "fmod"]
        .iter()
        .any(|part| name.contains(part))
}
