//! Operations on constants, computed now by the definitions in [`eval`](crate::eval).

use crate::eval::{self, Float, Int, f16};
use crate::ir::op::Signature;
use crate::ir::{Op, Type};

/// The result's bits of a pure operation with one result on constants; `None` where there is no such thing. `from` is the type of the
/// operation's main operand (for `select`, the chosen ones), `to` the result's.
pub fn fold(op: &Op, from: Type, to: Type, args: &[u64]) -> Option<u64> {
    match op.signature() {
        Signature::IntUnary | Signature::IntBinary | Signature::IntCompare => match from {
            Type::I1 => fold_boolean(op, args),
            Type::I8 => fold_int::<u8>(op, args),
            Type::I16 => fold_int::<u16>(op, args),
            Type::I32 => fold_int::<u32>(op, args),
            _ => fold_int::<u64>(op, args),
        },
        Signature::Convert => fold_conversion(op, from, to, args[0]),
        Signature::Other => fold_other(op, from, args),
        _ => match from {
            Type::F16 => fold_float::<f16>(op, args),
            Type::F32 => fold_float::<f32>(op, args),
            _ => fold_float::<f64>(op, args),
        },
    }
}

/// Dispatch on an operation of one table: `Variant = name`.
macro_rules! unary_table {
    ($op:expr, $a:expr, $wrap:expr; $($variant:ident = $name:ident),* $(,)?) => {
        match $op {
            $(Op::$variant => return Some($wrap(eval::$name($a))),)*
            _ => {}
        }
    };
}

macro_rules! binary_table {
    ($op:expr, $a:expr, $b:expr, $wrap:expr; $($variant:ident = $name:ident),* $(,)?) => {
        match $op {
            $(Op::$variant => return Some($wrap(eval::$name($a, $b))),)*
            _ => {}
        }
    };
}

fn fold_boolean(op: &Op, args: &[u64]) -> Option<u64> {
    let a = args[0] != 0;
    let bit = |value: bool| value as u64;
    unary_table!(op, a, bit; Not = not);
    let b = *args.get(1)? != 0;
    binary_table!(op, a, b, bit; And = and, Or = or, Xor = xor, IEq = ieq, INe = ine);
    None
}

fn fold_int<T: Int + eval::Bits>(op: &Op, args: &[u64]) -> Option<u64> {
    let a = T::from_u64(args[0]);
    let bits = |value: T| value.to_u64();
    let bit = |value: bool| value as u64;
    unary_table!(op, a, bits; Not = not, INeg = ineg, IAbs = iabs, ISign = isign, BitReverse = bit_reverse,
        BitCount = bit_count, FindLsb = find_lsb, FindSMsb = find_smsb, FindUMsb = find_umsb);
    let b = T::from_u64(*args.get(1)?);
    binary_table!(op, a, b, bits; IAdd = iadd, ISub = isub, IMul = imul, UMulHi = umul_hi, SMulHi = smul_hi,
        UDiv = udiv, SDiv = sdiv, URem = urem, SRem = srem, SMod = smod, And = and, Or = or, Xor = xor,
        Shl = shl, LShr = lshr, AShr = ashr, SMin = smin, SMax = smax, UMin = umin, UMax = umax);
    binary_table!(op, a, b, bit; IEq = ieq, INe = ine, ULt = ult, ULe = ule, SLt = slt, SLe = sle);
    None
}

fn fold_float<T: Float>(op: &Op, args: &[u64]) -> Option<u64> {
    let float = |bits: u64| T::from_bits(T::Bits::from_u64(bits));
    let a = float(args[0]);
    let bits = |value: T| value.bits().to_u64();
    let bit = |value: bool| value as u64;
    unary_table!(op, a, bits; FNeg = fneg, FAbs = fabs, FSign = fsign, FFloor = ffloor, FCeil = fceil, FTrunc = ftrunc,
        FRoundEven = fround_even, FRound = fround, FFract = ffract, FSqrt = fsqrt, FInverseSqrt = finverse_sqrt,
        FSin = fsin, FCos = fcos, FTan = ftan, FAsin = fasin, FAcos = facos, FAtan = fatan, FSinh = fsinh,
        FCosh = fcosh, FTanh = ftanh, FAsinh = fasinh, FAcosh = facosh, FAtanh = fatanh, FExp = fexp, FLog = flog,
        FExp2 = fexp2, FLog2 = flog2, FQuantizeF16 = fquantize_f16, FFrexpMantissa = ffrexp_mantissa);
    unary_table!(op, a, bits; FSinFast = fsin_fast, FCosFast = fcos_fast, FTanFast = ftan_fast, FAtanFast = fatan_fast, FExpFast = fexp_fast, FExp2Fast = fexp2_fast, FLogFast = flog_fast, FLog2Fast = flog2_fast, FInverseSqrtFast = finverse_sqrt_fast);
    unary_table!(op, a, bit; FIsNan = fis_nan, FIsInf = fis_inf);
    let b = float(*args.get(1)?);
    binary_table!(op, a, b, bits; FAdd = fadd, FSub = fsub, FMul = fmul, FDiv = fdiv, FRem = frem, FMod = fmod,
        FMin = fmin, FMax = fmax, FPow = fpow, FAtan2 = fatan2, FPowFast = fpow_fast, FAtan2Fast = fatan2_fast);
    binary_table!(op, a, b, bit; FOEq = foeq, FONe = fone, FOLt = folt, FOLe = fole, FUEq = fueq, FUNe = fune,
        FULt = fult, FULe = fule);
    match op {
        Op::FFma => Some(bits(eval::ffma(a, b, float(*args.get(2)?)))),
        _ => None,
    }
}

fn fold_conversion(op: &Op, from: Type, to: Type, bits: u64) -> Option<u64> {
    if *op == Op::Bitcast {
        return Some(bits);
    }
    match from {
        Type::I1 | Type::Descriptor => None,
        Type::I8 => convert_int::<u8>(op, to, bits),
        Type::I16 => convert_int::<u16>(op, to, bits),
        Type::I32 => convert_int::<u32>(op, to, bits),
        Type::I64 => convert_int::<u64>(op, to, bits),
        Type::F16 => convert_float::<f16>(op, to, bits),
        Type::F32 => convert_float::<f32>(op, to, bits),
        Type::F64 => convert_float::<f64>(op, to, bits),
    }
}

fn convert_int<A: Int>(op: &Op, to: Type, bits: u64) -> Option<u64> {
    fn to_int<A: Int, B: Int>(op: &Op, a: A) -> Option<u64> {
        match op {
            Op::SConvert => Some(eval::sconvert::<A, B>(a).to_u64()),
            Op::UConvert => Some(eval::uconvert::<A, B>(a).to_u64()),
            _ => None,
        }
    }
    fn to_float<A: Int, B: Float>(op: &Op, a: A) -> Option<u64> {
        match op {
            Op::SToF => Some(eval::sto_f::<A, B>(a).bits().to_u64()),
            Op::UToF => Some(eval::uto_f::<A, B>(a).bits().to_u64()),
            _ => None,
        }
    }
    let a = A::from_u64(bits);
    match to {
        Type::I1 | Type::Descriptor => None,
        Type::I8 => to_int::<A, u8>(op, a),
        Type::I16 => to_int::<A, u16>(op, a),
        Type::I32 => to_int::<A, u32>(op, a),
        Type::I64 => to_int::<A, u64>(op, a),
        Type::F16 => to_float::<A, f16>(op, a),
        Type::F32 => to_float::<A, f32>(op, a),
        Type::F64 => to_float::<A, f64>(op, a),
    }
}

fn convert_float<A: Float>(op: &Op, to: Type, bits: u64) -> Option<u64> {
    fn to_int<A: Float, B: Int>(op: &Op, a: A) -> Option<u64> {
        match op {
            Op::FToS => Some(eval::fto_s::<A, B>(a).to_u64()),
            Op::FToU => Some(eval::fto_u::<A, B>(a).to_u64()),
            _ => None,
        }
    }
    fn to_float<A: Float, B: Float>(op: &Op, a: A) -> Option<u64> {
        (*op == Op::FConvert).then(|| eval::fconvert::<A, B>(a).bits().to_u64())
    }
    let a = A::from_bits(A::Bits::from_u64(bits));
    if *op == Op::FFrexpExponent {
        return Some(eval::ffrexp_exponent(a) as u64);
    }
    match to {
        Type::I1 | Type::Descriptor => None,
        Type::I8 => to_int::<A, u8>(op, a),
        Type::I16 => to_int::<A, u16>(op, a),
        Type::I32 => to_int::<A, u32>(op, a),
        Type::I64 => to_int::<A, u64>(op, a),
        Type::F16 => to_float::<A, f16>(op, a),
        Type::F32 => to_float::<A, f32>(op, a),
        Type::F64 => to_float::<A, f64>(op, a),
    }
}

fn fold_other(op: &Op, from: Type, args: &[u64]) -> Option<u64> {
    match op {
        Op::Select => Some(if args[0] != 0 { args[1] } else { args[2] }),
        Op::Pack64 => Some(eval::pack64(args[0] as u32, args[1] as u32)),
        Op::FLdexp => match from {
            Type::F16 => Some(fold_ldexp::<f16>(args)),
            Type::F32 => Some(fold_ldexp::<f32>(args)),
            _ => Some(fold_ldexp::<f64>(args)),
        },
        Op::BitfieldInsert | Op::BitfieldSExtract | Op::BitfieldUExtract => match from {
            Type::I8 => fold_bitfield::<u8>(op, args),
            Type::I16 => fold_bitfield::<u16>(op, args),
            Type::I32 => fold_bitfield::<u32>(op, args),
            _ => fold_bitfield::<u64>(op, args),
        },
        _ => None,
    }
}

fn fold_ldexp<T: Float>(args: &[u64]) -> u64 {
    let value = T::from_bits(T::Bits::from_u64(args[0]));
    eval::fldexp(value, args[1] as u32).bits().to_u64()
}

fn fold_bitfield<T: Int>(op: &Op, args: &[u64]) -> Option<u64> {
    let base = T::from_u64(args[0]);
    let number = |index: usize| args[index] as u32;
    let value = match op {
        Op::BitfieldInsert => {
            eval::bitfield_insert(base, T::from_u64(args[1]), number(2), number(3))
        }
        Op::BitfieldSExtract => eval::bitfield_sextract(base, number(1), number(2)),
        _ => eval::bitfield_uextract(base, number(1), number(2)),
    };
    Some(value.to_u64())
}
