//! Extended instructions: GLSL.std.450 is lowered to operations of the IR; non-semantic sets are
//! skipped.

use rspirv::spirv::GlslStd450Op as GLOp;

use super::Lowerer;
use super::values::Values;
use crate::Error;
use crate::accuracy::{self, Accuracy};
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction, only_informs};

/// Extended instructions that are one operation, component by component.
fn elementwise(op: GLOp) -> Option<ir::Op> {
    Some(match op {
        GLOp::Round => ir::Op::FRound,
        GLOp::RoundEven => ir::Op::FRoundEven,
        GLOp::Trunc => ir::Op::FTrunc,
        GLOp::FAbs => ir::Op::FAbs,
        GLOp::SAbs => ir::Op::IAbs,
        GLOp::FSign => ir::Op::FSign,
        GLOp::SSign => ir::Op::ISign,
        GLOp::Floor => ir::Op::FFloor,
        GLOp::Ceil => ir::Op::FCeil,
        GLOp::Fract => ir::Op::FFract,
        GLOp::Sin => ir::Op::FSin,
        GLOp::Cos => ir::Op::FCos,
        GLOp::Tan => ir::Op::FTan,
        GLOp::Asin => ir::Op::FAsin,
        GLOp::Acos => ir::Op::FAcos,
        GLOp::Atan => ir::Op::FAtan,
        GLOp::Sinh => ir::Op::FSinh,
        GLOp::Cosh => ir::Op::FCosh,
        GLOp::Tanh => ir::Op::FTanh,
        GLOp::Asinh => ir::Op::FAsinh,
        GLOp::Acosh => ir::Op::FAcosh,
        GLOp::Atanh => ir::Op::FAtanh,
        GLOp::Atan2 => ir::Op::FAtan2,
        GLOp::Pow => ir::Op::FPow,
        GLOp::Exp => ir::Op::FExp,
        GLOp::Log => ir::Op::FLog,
        GLOp::Exp2 => ir::Op::FExp2,
        GLOp::Log2 => ir::Op::FLog2,
        GLOp::Sqrt => ir::Op::FSqrt,
        GLOp::InverseSqrt => ir::Op::FInverseSqrt,
        GLOp::FMin | GLOp::NMin => ir::Op::FMin,
        GLOp::FMax | GLOp::NMax => ir::Op::FMax,
        GLOp::UMin => ir::Op::UMin,
        GLOp::UMax => ir::Op::UMax,
        GLOp::SMin => ir::Op::SMin,
        GLOp::SMax => ir::Op::SMax,
        GLOp::Fma => ir::Op::FFma,
        GLOp::FindILsb => ir::Op::FindLsb,
        GLOp::FindSMsb => ir::Op::FindSMsb,
        GLOp::FindUMsb => ir::Op::FindUMsb,
        _ => return None,
    })
}

/// Extended instructions of one to three operands that are composed for each component.
fn composed(op: GLOp) -> bool {
    matches!(
        op,
        GLOp::Radians
            | GLOp::Degrees
            | GLOp::FClamp
            | GLOp::NClamp
            | GLOp::UClamp
            | GLOp::SClamp
            | GLOp::FMix
            | GLOp::Step
            | GLOp::SmoothStep
            | GLOp::Ldexp
    )
}

/// Largest integer exponent that is expanded to multiplications.
const GREATEST_MULTIPLIED_EXPONENT: u32 = 5;

impl Lowerer<'_> {
    pub(super) fn lower_extended(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let set = self.module.instruction_sets.get(&operands[0]);
        let number = operands[1];
        match set.map(String::as_str) {
            Some("GLSL.std.450") => {}
            Some(super::debug_printf::SET) => return self.lower_debug_printf(instruction),
            // Debug information.
            Some(name) if only_informs(name) => return Ok(()),
            Some(name) => {
                let message = format!("the instruction set {name} is not supported");
                return Err(Error::unsupported(instruction.offset, message));
            }
            None => return Err(self.b.invalid("this is not an instruction set")),
        }
        let Some(op) = GLOp::from_u32(number) else {
            return Err(self
                .b
                .invalid(format!("GLSL.std.450 has no instruction {number}")));
        };
        let operands = &operands[2..];
        let wanted = operand_count(op);
        if operands.len() != wanted {
            return Err(self.b.invalid(format!("{op:?} takes {wanted} operands")));
        }
        if elementwise(op).is_some() || composed(op) {
            return self.lower_elementwise(instruction, op, operands);
        }
        let values = match op {
            GLOp::InterpolateAtCentroid | GLOp::InterpolateAtSample | GLOp::InterpolateAtOffset => {
                let values = self.lower_interpolate_at(op, operands)?;
                return self.define_typed(instruction, values);
            }
            GLOp::Modf | GLOp::ModfStruct => return self.lower_modf(instruction, op, operands),
            GLOp::Frexp | GLOp::FrexpStruct => return self.lower_frexp(instruction, op, operands),
            GLOp::Determinant => {
                let m = self.matrix(operands[0])?;
                vec![self.determinant(&m)?]
            }
            GLOp::MatrixInverse => {
                let m = self.matrix(operands[0])?;
                self.inverse(&m)?
            }
            GLOp::PackDouble2x32 | GLOp::UnpackDouble2x32 => {
                let parts = self.leaves(operands[0])?;
                let types = self.types.leaves(instruction.result_type)?;
                match (op, &parts[..]) {
                    (GLOp::PackDouble2x32, &[low, high]) => {
                        vec![self.b.pack64(low, high, Type::F64)?]
                    }
                    _ => self.bitcast(&parts, &types)?,
                }
            }
            GLOp::PackSnorm4x8
            | GLOp::PackUnorm4x8
            | GLOp::PackSnorm2x16
            | GLOp::PackUnorm2x16
            | GLOp::PackHalf2x16 => vec![self.pack(op, operands[0])?],
            GLOp::UnpackSnorm4x8
            | GLOp::UnpackUnorm4x8
            | GLOp::UnpackSnorm2x16
            | GLOp::UnpackUnorm2x16
            | GLOp::UnpackHalf2x16 => self.unpack(op, operands[0])?,
            _ => self.geometric(instruction, op, operands)?,
        };
        self.define_typed(instruction, values)
    }

    pub(super) fn lower_elementwise(
        &mut self,
        instruction: &Instruction,
        op: GLOp,
        operands: &[Id],
    ) -> Result<(), Error> {
        let mut arguments = Vec::with_capacity(operands.len());
        for &id in operands {
            arguments.push(self.leaves(id)?);
        }
        let count = arguments[0].len();
        if arguments.iter().any(|argument| argument.len() != count) {
            return Err(self
                .b
                .invalid("operands have different numbers of components"));
        }
        let mut values = Values::with_capacity(count);
        for index in 0..count {
            let parts: Values = arguments.iter().map(|argument| argument[index]).collect();
            values.push(match elementwise(op) {
                Some(op) => self.accurate(op, &parts)?,
                None => self.component(op, &parts)?,
            });
        }
        self.define_typed(instruction, values)
    }

    /// One operation with the requested accuracy.
    fn accurate(&mut self, op: ir::Op, parts: &[Value]) -> Result<Value, Error> {
        let ty = self.b.ty(parts[0]);
        if op == ir::Op::FPow && self.request.accuracy != Accuracy::Exact {
            let exponents = 1..=GREATEST_MULTIPLIED_EXPONENT;
            if let Some(n) = exponents
                .into_iter()
                .find(|&n| self.b.is_float(parts[1], n as f64))
            {
                return self.multiplied(parts[0], n);
            }
            if self.b.is_float(parts[0], 2.0) {
                return self.accurate(ir::Op::FExp2, &parts[1..]);
            }
        }
        match self.request.accuracy {
            Accuracy::Fast if ty == Type::F32 => {
                let op = accuracy::fast(&op).unwrap_or(op);
                self.b.emit(op, parts, ty)
            }
            Accuracy::Exact if ty == Type::F32 && accuracy::gains_from_f64(&op) => {
                let mut wide = Vec::with_capacity(parts.len());
                for &part in parts {
                    wide.push(self.b.emit(ir::Op::FConvert, &[part], Type::F64)?);
                }
                let value = self.b.emit(op, &wide, Type::F64)?;
                self.b.emit(ir::Op::FConvert, &[value], ty)
            }
            _ => self.b.emit(op, parts, ty),
        }
    }

    /// A power by squaring: within 3 ULP for exponents up to 5, where Vulkan allows the error of
    /// `exp2(n * log2(x))`.
    fn multiplied(&mut self, x: Value, n: u32) -> Result<Value, Error> {
        let mut square = x;
        let mut power = None;
        for bit in 0..=n.ilog2() {
            if bit > 0 {
                square = self.b.binary(ir::Op::FMul, square, square)?;
            }
            if n >> bit & 1 == 1 {
                power = Some(match power {
                    Some(power) => self.b.binary(ir::Op::FMul, square, power)?,
                    None => square,
                });
            }
        }
        Ok(power.unwrap_or(x))
    }

    /// One component of a composed instruction.
    fn component(&mut self, op: GLOp, parts: &[Value]) -> Result<Value, Error> {
        let x = parts[0];
        let ty = self.b.ty(x);
        let float = matches!(
            op,
            GLOp::Radians
                | GLOp::Degrees
                | GLOp::FMix
                | GLOp::Step
                | GLOp::SmoothStep
                | GLOp::Ldexp
        );
        if float && !ty.is_float() {
            return Err(self.b.invalid(format!("{op:?} takes floats")));
        }
        match op {
            GLOp::Radians | GLOp::Degrees => {
                let degree = std::f64::consts::PI / 180.0;
                let factor = if op == GLOp::Radians {
                    degree
                } else {
                    1.0 / degree
                };
                let factor = self.b.float(ty, factor);
                self.b.binary(ir::Op::FMul, x, factor)
            }
            GLOp::FClamp | GLOp::NClamp => self.clamp(ir::Op::FMax, ir::Op::FMin, parts),
            GLOp::UClamp => self.clamp(ir::Op::UMax, ir::Op::UMin, parts),
            GLOp::SClamp => self.clamp(ir::Op::SMax, ir::Op::SMin, parts),
            GLOp::FMix => {
                let one = self.b.float(ty, 1.0);
                let rest = self.b.binary(ir::Op::FSub, one, parts[2])?;
                let left = self.b.binary(ir::Op::FMul, x, rest)?;
                let right = self.b.binary(ir::Op::FMul, parts[1], parts[2])?;
                self.b.binary(ir::Op::FAdd, left, right)
            }
            GLOp::Step => {
                let (zero, one) = (self.b.float(ty, 0.0), self.b.float(ty, 1.0));
                let below = self.b.compare(ir::Op::FOLt, parts[1], x)?;
                self.b.select(below, zero, one)
            }
            GLOp::SmoothStep => self.smooth_step(ty, [parts[0], parts[1], parts[2]]),
            _ => {
                let exponent = self.ldexp_exponent(parts[1])?;
                self.b.emit(ir::Op::FLdexp, &[x, exponent], ty)
            }
        }
    }

    /// The exponent as i32. A 64-bit exponent is clamped to values that already turn every float to
    /// 0 or infinity.
    fn ldexp_exponent(&mut self, exponent: Value) -> Result<Value, Error> {
        let mut exponent = exponent;
        if self.b.ty(exponent) == Type::I64 {
            let least = self.b.constant(Type::I64, i64::from(i32::MIN) as u64);
            let most = self.b.constant(Type::I64, i32::MAX as u64);
            exponent = self.clamp(ir::Op::SMax, ir::Op::SMin, &[exponent, least, most])?;
        }
        self.b.i32_of(exponent, true)
    }

    fn clamp(&mut self, max: ir::Op, min: ir::Op, parts: &[Value]) -> Result<Value, Error> {
        let raised = self.b.binary(max, parts[0], parts[1])?;
        self.b.binary(min, raised, parts[2])
    }

    /// Hermite interpolation: `t * t * (3 - 2 * t)` with t clamped to 0..1.
    fn smooth_step(&mut self, ty: Type, [low, high, x]: [Value; 3]) -> Result<Value, Error> {
        let (zero, one) = (self.b.float(ty, 0.0), self.b.float(ty, 1.0));
        let (two, three) = (self.b.float(ty, 2.0), self.b.float(ty, 3.0));
        let above = self.b.binary(ir::Op::FSub, x, low)?;
        let width = self.b.binary(ir::Op::FSub, high, low)?;
        let t = self.b.binary(ir::Op::FDiv, above, width)?;
        let t = self.clamp(ir::Op::FMax, ir::Op::FMin, &[t, zero, one])?;
        let twice = self.b.binary(ir::Op::FMul, two, t)?;
        let slope = self.b.binary(ir::Op::FSub, three, twice)?;
        let square = self.b.binary(ir::Op::FMul, t, t)?;
        self.b.binary(ir::Op::FMul, square, slope)
    }

    /// Integral and fractional part, both with the argument's sign.
    fn lower_modf(
        &mut self,
        instruction: &Instruction,
        op: GLOp,
        operands: &[Id],
    ) -> Result<(), Error> {
        let parts = self.leaves(operands[0])?;
        let (mut fractions, mut wholes) = (Vec::new(), Vec::new());
        for &x in parts.iter() {
            let whole = self.b.unary(ir::Op::FTrunc, x)?;
            let fraction = self.b.binary(ir::Op::FSub, x, whole)?;
            // The fraction of an infinity is zero.
            let infinite = self.b.emit(ir::Op::FIsInf, &[x], Type::I1)?;
            let zero = self.b.float(self.b.ty(x), 0.0);
            let fraction = self.b.select(infinite, zero, fraction)?;
            fractions.push(self.with_sign_of(fraction, x)?);
            wholes.push(whole);
        }
        self.define_parts(instruction, op == GLOp::Modf, fractions, wholes, operands)
    }

    /// A float with the sign of another one. It has that sign already, or is +0.
    fn with_sign_of(&mut self, size: Value, signed: Value) -> Result<Value, Error> {
        let ty = self.b.ty(size);
        let [size, signed] = [self.b.as_integer(size)?, self.b.as_integer(signed)?];
        let integer = self.b.ty(size);
        let sign_bit = self.b.constant(integer, 1 << (integer.bits() - 1));
        let sign = self.b.binary(ir::Op::And, signed, sign_bit)?;
        let bits = self.b.binary(ir::Op::Or, size, sign)?;
        self.b.emit(ir::Op::Bitcast, &[bits], ty)
    }

    fn lower_frexp(
        &mut self,
        instruction: &Instruction,
        op: GLOp,
        operands: &[Id],
    ) -> Result<(), Error> {
        let parts = self.leaves(operands[0])?;
        let (mut mantissas, mut exponents) = (Vec::new(), Vec::new());
        for &x in parts.iter() {
            mantissas.push(self.b.unary(ir::Op::FFrexpMantissa, x)?);
            exponents.push(self.b.emit(ir::Op::FFrexpExponent, &[x], Type::I32)?);
        }
        self.define_parts(
            instruction,
            op == GLOp::Frexp,
            mantissas,
            exponents,
            operands,
        )
    }

    /// Two results: through a pointer operand, or as a structure.
    fn define_parts(
        &mut self,
        instruction: &Instruction,
        through_pointer: bool,
        first: Vec<Value>,
        second: Vec<Value>,
        operands: &[Id],
    ) -> Result<(), Error> {
        if through_pointer {
            let pointer = self.pointer(operands[1])?;
            let types = self.types.leaves(pointer.pointee)?;
            let mut stored = Vec::with_capacity(second.len());
            for (&value, &ty) in second.iter().zip(types.iter()) {
                let same = self.b.ty(value) == ty;
                stored.push(if same {
                    value
                } else {
                    self.b.emit(ir::Op::SConvert, &[value], ty)?
                });
            }
            self.store(&pointer, &stored)?;
            return self.define_typed(instruction, first);
        }
        let mut values = first;
        let types = self.types.leaves(instruction.result_type)?;
        for value in second {
            let ty = types.get(values.len()).copied().unwrap_or(Type::I32);
            let same = self.b.ty(value) == ty;
            values.push(if same {
                value
            } else {
                self.b.emit(ir::Op::SConvert, &[value], ty)?
            });
        }
        self.define_typed(instruction, values)
    }

    /// The square root of a vector's product with itself; of a scalar, its magnitude.
    fn length(&mut self, x: &[Value]) -> Result<Value, Error> {
        if let [x] = *x {
            return self.b.unary(ir::Op::FAbs, x);
        }
        let square = self.dot(x, x)?;
        self.b.unary(ir::Op::FSqrt, square)
    }

    fn subtract(&mut self, a: &[Value], b: &[Value]) -> Result<Vec<Value>, Error> {
        if a.len() != b.len() {
            return Err(self
                .b
                .invalid("operands have different numbers of components"));
        }
        let pairs = a.iter().zip(b);
        pairs
            .map(|(&a, &b)| self.b.binary(ir::Op::FSub, a, b))
            .collect()
    }

    fn scaled(&mut self, a: &[Value], factor: Value) -> Result<Vec<Value>, Error> {
        a.iter()
            .map(|&a| self.b.binary(ir::Op::FMul, a, factor))
            .collect()
    }

    /// Instructions on vectors as a whole.
    fn geometric(
        &mut self,
        instruction: &Instruction,
        op: GLOp,
        operands: &[Id],
    ) -> Result<Vec<Value>, Error> {
        let a = self.leaves(operands[0])?;
        let b = match operands.get(1) {
            Some(&id) => self.leaves(id)?,
            None => a.clone(),
        };
        let ty = match a.first() {
            Some(&x) if self.b.ty(x).is_float() => self.b.ty(x),
            _ => return Err(self.b.invalid(format!("{op:?} takes floats"))),
        };
        match op {
            GLOp::Length => Ok(vec![self.length(&a)?]),
            GLOp::Distance => {
                let between = self.subtract(&a, &b)?;
                Ok(vec![self.length(&between)?])
            }
            GLOp::Cross => {
                let (&[ax, ay, az], &[bx, by, bz]) = (&a[..], &b[..]) else {
                    return Err(self.b.invalid("a cross product takes three components"));
                };
                let mut part = |a: Value, b: Value, c: Value, d: Value| {
                    let left = self.b.binary(ir::Op::FMul, a, b)?;
                    let right = self.b.binary(ir::Op::FMul, c, d)?;
                    self.b.binary(ir::Op::FSub, left, right)
                };
                Ok(vec![
                    part(ay, bz, by, az)?,
                    part(az, bx, bz, ax)?,
                    part(ax, by, bx, ay)?,
                ])
            }
            GLOp::Normalize => {
                if let [x] = a[..] {
                    return Ok(vec![self.b.unary(ir::Op::FSign, x)?]);
                }
                let square = self.dot(&a, &a)?;
                let factor = self.accurate(ir::Op::FInverseSqrt, &[square])?;
                self.scaled(&a, factor)
            }
            GLOp::FaceForward => {
                let reference = self.leaves(operands[2])?;
                let facing = self.dot(&reference, &b)?;
                let zero = self.b.float(ty, 0.0);
                let keep = self.b.compare(ir::Op::FOLt, facing, zero)?;
                let mut values = Vec::new();
                for &x in a.iter() {
                    let turned = self.b.unary(ir::Op::FNeg, x)?;
                    values.push(self.b.select(keep, x, turned)?);
                }
                Ok(values)
            }
            GLOp::Reflect => {
                let along = self.dot(&b, &a)?;
                let two = self.b.float(ty, 2.0);
                let twice = self.b.binary(ir::Op::FMul, two, along)?;
                let part = self.scaled(&b, twice)?;
                self.subtract(&a, &part)
            }
            GLOp::Refract => self.refract(ty, &a, &b, operands[2]),
            _ => Err(Error::unsupported(
                instruction.offset,
                format!("GLSL.std.450 {op:?} is not supported"),
            )),
        }
    }

    /// `eta * i - (eta * dot(n, i) + sqrt(k)) * n` where `k = 1 - eta² (1 - dot(n, i)²)`; zero for
    /// negative k.
    fn refract(
        &mut self,
        ty: Type,
        i: &[Value],
        n: &[Value],
        eta: Id,
    ) -> Result<Vec<Value>, Error> {
        let eta = self.scalar(eta)?;
        let eta = match self.b.ty(eta) {
            from if from == ty => eta,
            _ => self.b.emit(ir::Op::FConvert, &[eta], ty)?,
        };
        let (zero, one) = (self.b.float(ty, 0.0), self.b.float(ty, 1.0));
        let along = self.dot(n, i)?;
        let square = self.b.binary(ir::Op::FMul, along, along)?;
        let across = self.b.binary(ir::Op::FSub, one, square)?;
        let eta_square = self.b.binary(ir::Op::FMul, eta, eta)?;
        let bent = self.b.binary(ir::Op::FMul, eta_square, across)?;
        let k = self.b.binary(ir::Op::FSub, one, bent)?;
        let total = self.b.compare(ir::Op::FOLt, k, zero)?;
        let root = self.b.unary(ir::Op::FSqrt, k)?;
        let scaled = self.b.binary(ir::Op::FMul, eta, along)?;
        let factor = self.b.binary(ir::Op::FAdd, scaled, root)?;
        let forward = self.scaled(i, eta)?;
        let sideways = self.scaled(n, factor)?;
        let refracted = self.subtract(&forward, &sideways)?;
        refracted
            .iter()
            .map(|&x| self.b.select(total, zero, x))
            .collect()
    }

    /// Width of a field and the largest value of a normalised one.
    fn field(op: GLOp) -> (u32, f64, bool) {
        match op {
            GLOp::PackSnorm4x8 | GLOp::UnpackSnorm4x8 => (8, 127.0, true),
            GLOp::PackUnorm4x8 | GLOp::UnpackUnorm4x8 => (8, 255.0, false),
            GLOp::PackSnorm2x16 | GLOp::UnpackSnorm2x16 => (16, 32767.0, true),
            _ => (16, 65535.0, false),
        }
    }

    fn pack(&mut self, op: GLOp, id: Id) -> Result<Value, Error> {
        let parts = self.leaves(id)?;
        let (width, most, signed) = Self::field(op);
        if parts.len() != 32 / width as usize {
            return Err(self
                .b
                .invalid(format!("{op:?} takes {} components", 32 / width)));
        }
        let mut word = self.b.i32(0);
        for (index, &x) in parts.iter().enumerate() {
            let bits = if op == GLOp::PackHalf2x16 {
                let half = self.b.emit(ir::Op::FConvert, &[x], Type::F16)?;
                let bits = self.b.emit(ir::Op::Bitcast, &[half], Type::I16)?;
                self.b.i32_of(bits, false)?
            } else {
                let low = self.b.f32(if signed { -1.0 } else { 0.0 });
                let (high, most) = (self.b.f32(1.0), self.b.f32(most as f32));
                let x = self.clamp(ir::Op::FMax, ir::Op::FMin, &[x, low, high])?;
                let scaled = self.b.binary(ir::Op::FMul, x, most)?;
                let rounded = self.b.unary(ir::Op::FRoundEven, scaled)?;
                let bits = self.b.emit(ir::Op::FToS, &[rounded], Type::I32)?;
                let mask = self.b.i32((1 << width) - 1);
                self.b.binary(ir::Op::And, bits, mask)?
            };
            let count = self.b.i32(index as u32 * width);
            let placed = self.b.binary(ir::Op::Shl, bits, count)?;
            word = self.b.binary(ir::Op::Or, word, placed)?;
        }
        Ok(word)
    }

    fn unpack(&mut self, op: GLOp, id: Id) -> Result<Vec<Value>, Error> {
        let word = self.scalar(id)?;
        if self.b.ty(word) != Type::I32 {
            return Err(self.b.invalid(format!("{op:?} takes a 32-bit integer")));
        }
        let (width, most, signed) = Self::field(op);
        let mut values = Vec::new();
        for index in 0..32 / width {
            let (offset, count) = (self.b.i32(index * width), self.b.i32(width));
            if op == GLOp::UnpackHalf2x16 {
                let shifted = self.b.binary(ir::Op::LShr, word, offset)?;
                let bits = self.b.emit(ir::Op::UConvert, &[shifted], Type::I16)?;
                let half = self.b.emit(ir::Op::Bitcast, &[bits], Type::F16)?;
                values.push(self.b.emit(ir::Op::FConvert, &[half], Type::F32)?);
                continue;
            }
            let (extract, convert) = match signed {
                true => (ir::Op::BitfieldSExtract, ir::Op::SToF),
                false => (ir::Op::BitfieldUExtract, ir::Op::UToF),
            };
            let field = self.b.emit(extract, &[word, offset, count], Type::I32)?;
            let x = self.b.emit(convert, &[field], Type::F32)?;
            let most = self.b.f32(most as f32);
            let x = self.b.binary(ir::Op::FDiv, x, most)?;
            // The most negative number lies below -1.
            values.push(if signed {
                let low = self.b.f32(-1.0);
                self.b.binary(ir::Op::FMax, x, low)?
            } else {
                x
            });
        }
        Ok(values)
    }
}

fn operand_count(op: GLOp) -> usize {
    match op {
        GLOp::Atan2
        | GLOp::Pow
        | GLOp::Modf
        | GLOp::FMin
        | GLOp::UMin
        | GLOp::SMin
        | GLOp::FMax
        | GLOp::UMax
        | GLOp::SMax
        | GLOp::NMin
        | GLOp::NMax
        | GLOp::Step
        | GLOp::Frexp
        | GLOp::Ldexp
        | GLOp::Distance
        | GLOp::Cross
        | GLOp::Reflect
        | GLOp::InterpolateAtSample
        | GLOp::InterpolateAtOffset => 2,
        GLOp::FClamp
        | GLOp::UClamp
        | GLOp::SClamp
        | GLOp::NClamp
        | GLOp::FMix
        | GLOp::IMix
        | GLOp::SmoothStep
        | GLOp::Fma
        | GLOp::FaceForward
        | GLOp::Refract => 3,
        _ => 1,
    }
}
