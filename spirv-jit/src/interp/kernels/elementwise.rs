//! From an operation and its types to the kernel that performs it.

use std::marker::PhantomData;

use half::f16;

use super::lane::{Lane, Map1, Map2, Map3};
use super::ops;
use super::remainder::Remainder;
use crate::SUBGROUP_SIZE;
use crate::eval::{self, Int};
use crate::interp::machine::{Handler, Instr, Machine};
use crate::interp::tier::{Kernel, Portable, Tier};
use crate::ir::{Op, Type};
use crate::tier::TierKind;

/// Instantiates `$kernel<ops::$op, …>` for the integer type `$ty`: 32 and 64 bits in the tier, narrow ones once.
macro_rules! by_int {
    ($t:ident, $ty:expr, |$x:ident| $kernel:ty) => {{
        match $ty {
            Type::I8 => {
                type $x = u8;
                Portable::handler::<$kernel>()
            }
            Type::I16 => {
                type $x = u16;
                Portable::handler::<$kernel>()
            }
            Type::I32 => {
                type $x = u32;
                $t::handler::<$kernel>()
            }
            Type::I64 => {
                type $x = u64;
                $t::handler::<$kernel>()
            }
            _ => return None,
        }
    }};
}

/// As `by_int`, with booleans.
macro_rules! by_bits {
    ($t:ident, $ty:expr, |$x:ident| $kernel:ty) => {{
        match $ty {
            Type::I1 => {
                type $x = bool;
                $t::handler::<$kernel>()
            }
            other => by_int!($t, other, |$x| $kernel),
        }
    }};
}

/// As `by_bits`, for bitwise operations: booleans are all zeros or all ones, so that they need no conversion.
macro_rules! by_mask {
    ($t:ident, $ty:expr, |$x:ident| $kernel:ty) => {{
        match $ty {
            Type::I1 => {
                type $x = u32;
                $t::handler::<$kernel>()
            }
            other => by_int!($t, other, |$x| $kernel),
        }
    }};
}

macro_rules! by_float {
    ($t:ident, $ty:expr, |$x:ident| $kernel:ty) => {{
        match $ty {
            Type::F16 => {
                type $x = f16;
                Portable::handler::<$kernel>()
            }
            Type::F32 => {
                type $x = f32;
                $t::handler::<$kernel>()
            }
            Type::F64 => {
                type $x = f64;
                $t::handler::<$kernel>()
            }
            _ => return None,
        }
    }};
}

/// The kernel of a pure operation in a tier: `from` is the type of its (last) operand, `to` of its result. The instruction takes the
/// operands in `a`, `b`, `c` (the fourth of a bit-field insertion in `x`). `None`: there is no such operation on those types.
pub(in crate::interp) fn elementwise(
    tier: TierKind,
    op: &Op,
    from: Type,
    to: Type,
) -> Option<Handler> {
    match tier {
        TierKind::Portable => in_tier::<Portable>(op, from, to),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => in_tier::<crate::interp::tier::Avx2>(op, from, to),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<crate::interp::tier::Avx512>(op, from, to),
        #[cfg(not(target_arch = "x86_64"))]
        _ => in_tier::<Portable>(op, from, to),
    }
}

fn in_tier<T: Tier>(op: &Op, from: Type, to: Type) -> Option<Handler> {
    Some(match op {
        Op::IAdd => by_int!(T, to, |X| Map2<ops::iadd, X, X, X>),
        Op::ISub => by_int!(T, to, |X| Map2<ops::isub, X, X, X>),
        Op::IMul => by_int!(T, to, |X| Map2<ops::imul, X, X, X>),
        Op::UMulHi => by_int!(T, to, |X| Map2<ops::umul_hi, X, X, X>),
        Op::SMulHi => by_int!(T, to, |X| Map2<ops::smul_hi, X, X, X>),
        Op::UDiv => by_int!(T, to, |X| Map2<ops::udiv, X, X, X>),
        Op::SDiv => by_int!(T, to, |X| Map2<ops::sdiv, X, X, X>),
        Op::URem => by_int!(T, to, |X| Map2<ops::urem, X, X, X>),
        Op::SRem => by_int!(T, to, |X| Map2<ops::srem, X, X, X>),
        Op::SMod => by_int!(T, to, |X| Map2<ops::smod, X, X, X>),
        Op::Shl => by_int!(T, to, |X| Map2<ops::shl, X, X, X>),
        Op::LShr => by_int!(T, to, |X| Map2<ops::lshr, X, X, X>),
        Op::AShr => by_int!(T, to, |X| Map2<ops::ashr, X, X, X>),
        Op::SMin => by_int!(T, to, |X| Map2<ops::smin, X, X, X>),
        Op::SMax => by_int!(T, to, |X| Map2<ops::smax, X, X, X>),
        Op::UMin => by_int!(T, to, |X| Map2<ops::umin, X, X, X>),
        Op::UMax => by_int!(T, to, |X| Map2<ops::umax, X, X, X>),
        Op::And => by_mask!(T, to, |X| Map2<ops::and, X, X, X>),
        Op::Or => by_mask!(T, to, |X| Map2<ops::or, X, X, X>),
        Op::Xor => by_mask!(T, to, |X| Map2<ops::xor, X, X, X>),
        Op::Not => by_mask!(T, to, |X| Map1<ops::not, X, X>),
        Op::INeg => by_int!(T, to, |X| Map1<ops::ineg, X, X>),
        Op::IAbs => by_int!(T, to, |X| Map1<ops::iabs, X, X>),
        Op::ISign => by_int!(T, to, |X| Map1<ops::isign, X, X>),
        Op::BitReverse => by_int!(T, to, |X| Map1<ops::bit_reverse, X, X>),
        Op::BitCount => by_int!(T, to, |X| Map1<ops::bit_count, X, X>),
        Op::FindLsb => by_int!(T, to, |X| Map1<ops::find_lsb, X, X>),
        Op::FindSMsb => by_int!(T, to, |X| Map1<ops::find_smsb, X, X>),
        Op::FindUMsb => by_int!(T, to, |X| Map1<ops::find_umsb, X, X>),
        Op::IEq => by_bits!(T, from, |X| Map2<ops::ieq, X, X, bool>),
        Op::INe => by_bits!(T, from, |X| Map2<ops::ine, X, X, bool>),
        Op::ULt => by_int!(T, from, |X| Map2<ops::ult, X, X, bool>),
        Op::ULe => by_int!(T, from, |X| Map2<ops::ule, X, X, bool>),
        Op::SLt => by_int!(T, from, |X| Map2<ops::slt, X, X, bool>),
        Op::SLe => by_int!(T, from, |X| Map2<ops::sle, X, X, bool>),
        Op::FAdd => by_float!(T, to, |X| Map2<ops::fadd, X, X, X>),
        Op::FSub => by_float!(T, to, |X| Map2<ops::fsub, X, X, X>),
        Op::FMul => by_float!(T, to, |X| Map2<ops::fmul, X, X, X>),
        Op::FDiv => by_float!(T, to, |X| Map2<ops::fdiv, X, X, X>),
        Op::FRem if to == Type::F32 => T::handler::<Remainder<ops::frem>>(),
        Op::FMod if to == Type::F32 => T::handler::<Remainder<ops::fmod>>(),
        Op::FRem => by_float!(T, to, |X| Map2<ops::frem, X, X, X>),
        Op::FMod => by_float!(T, to, |X| Map2<ops::fmod, X, X, X>),
        Op::FMin => by_float!(T, to, |X| Map2<ops::fmin, X, X, X>),
        Op::FMax => by_float!(T, to, |X| Map2<ops::fmax, X, X, X>),
        Op::FPow => by_float!(T, to, |X| Map2<ops::fpow, X, X, X>),
        Op::FAtan2 => by_float!(T, to, |X| Map2<ops::fatan2, X, X, X>),
        Op::FNeg => by_float!(T, to, |X| Map1<ops::fneg, X, X>),
        Op::FAbs => by_float!(T, to, |X| Map1<ops::fabs, X, X>),
        Op::FSign => by_float!(T, to, |X| Map1<ops::fsign, X, X>),
        Op::FFloor => by_float!(T, to, |X| Map1<ops::ffloor, X, X>),
        Op::FCeil => by_float!(T, to, |X| Map1<ops::fceil, X, X>),
        Op::FTrunc => by_float!(T, to, |X| Map1<ops::ftrunc, X, X>),
        Op::FRoundEven => by_float!(T, to, |X| Map1<ops::fround_even, X, X>),
        Op::FRound => by_float!(T, to, |X| Map1<ops::fround, X, X>),
        Op::FFract => by_float!(T, to, |X| Map1<ops::ffract, X, X>),
        Op::FSqrt => by_float!(T, to, |X| Map1<ops::fsqrt, X, X>),
        Op::FInverseSqrt => by_float!(T, to, |X| Map1<ops::finverse_sqrt, X, X>),
        Op::FSin => by_float!(T, to, |X| Map1<ops::fsin, X, X>),
        Op::FCos => by_float!(T, to, |X| Map1<ops::fcos, X, X>),
        Op::FTan => by_float!(T, to, |X| Map1<ops::ftan, X, X>),
        Op::FAsin => by_float!(T, to, |X| Map1<ops::fasin, X, X>),
        Op::FAcos => by_float!(T, to, |X| Map1<ops::facos, X, X>),
        Op::FAtan => by_float!(T, to, |X| Map1<ops::fatan, X, X>),
        Op::FSinh => by_float!(T, to, |X| Map1<ops::fsinh, X, X>),
        Op::FCosh => by_float!(T, to, |X| Map1<ops::fcosh, X, X>),
        Op::FTanh => by_float!(T, to, |X| Map1<ops::ftanh, X, X>),
        Op::FAsinh => by_float!(T, to, |X| Map1<ops::fasinh, X, X>),
        Op::FAcosh => by_float!(T, to, |X| Map1<ops::facosh, X, X>),
        Op::FAtanh => by_float!(T, to, |X| Map1<ops::fatanh, X, X>),
        Op::FExp => by_float!(T, to, |X| Map1<ops::fexp, X, X>),
        Op::FLog => by_float!(T, to, |X| Map1<ops::flog, X, X>),
        Op::FExp2 => by_float!(T, to, |X| Map1<ops::fexp2, X, X>),
        Op::FLog2 => by_float!(T, to, |X| Map1<ops::flog2, X, X>),
        Op::FQuantizeF16 => by_float!(T, to, |X| Map1<ops::fquantize_f16, X, X>),
        Op::FFrexpMantissa => by_float!(T, to, |X| Map1<ops::ffrexp_mantissa, X, X>),
        Op::FSinFast => by_float!(T, to, |X| Map1<ops::fsin_fast, X, X>),
        Op::FCosFast => by_float!(T, to, |X| Map1<ops::fcos_fast, X, X>),
        Op::FTanFast => by_float!(T, to, |X| Map1<ops::ftan_fast, X, X>),
        Op::FAtanFast => by_float!(T, to, |X| Map1<ops::fatan_fast, X, X>),
        Op::FExpFast => by_float!(T, to, |X| Map1<ops::fexp_fast, X, X>),
        Op::FExp2Fast => by_float!(T, to, |X| Map1<ops::fexp2_fast, X, X>),
        Op::FLogFast => by_float!(T, to, |X| Map1<ops::flog_fast, X, X>),
        Op::FLog2Fast => by_float!(T, to, |X| Map1<ops::flog2_fast, X, X>),
        Op::FInverseSqrtFast => by_float!(T, to, |X| Map1<ops::finverse_sqrt_fast, X, X>),
        Op::FPowFast => by_float!(T, to, |X| Map2<ops::fpow_fast, X, X, X>),
        Op::FAtan2Fast => by_float!(T, to, |X| Map2<ops::fatan2_fast, X, X, X>),
        Op::FFma => by_float!(T, to, |X| Map3<ops::ffma, X, X, X, X>),
        Op::FOEq => by_float!(T, from, |X| Map2<ops::foeq, X, X, bool>),
        Op::FONe => by_float!(T, from, |X| Map2<ops::fone, X, X, bool>),
        Op::FOLt => by_float!(T, from, |X| Map2<ops::folt, X, X, bool>),
        Op::FOLe => by_float!(T, from, |X| Map2<ops::fole, X, X, bool>),
        Op::FUEq => by_float!(T, from, |X| Map2<ops::fueq, X, X, bool>),
        Op::FUNe => by_float!(T, from, |X| Map2<ops::fune, X, X, bool>),
        Op::FULt => by_float!(T, from, |X| Map2<ops::fult, X, X, bool>),
        Op::FULe => by_float!(T, from, |X| Map2<ops::fule, X, X, bool>),
        Op::FIsNan => by_float!(T, from, |X| Map1<ops::fis_nan, X, bool>),
        Op::FIsInf => by_float!(T, from, |X| Map1<ops::fis_inf, X, bool>),
        Op::FFrexpExponent => by_float!(T, from, |X| Map1<ops::ffrexp_exponent, X, u32>),
        Op::FToS => return float_to_int::<T, ops::fto_s>(from, to),
        Op::FToU => return float_to_int::<T, ops::fto_u>(from, to),
        Op::SToF => return int_to_float::<T, ops::sto_f>(from, to),
        Op::UToF => return int_to_float::<T, ops::uto_f>(from, to),
        Op::FConvert => return convert_float::<T>(from, to),
        Op::SConvert => return convert_int::<T, ops::sconvert>(from, to),
        Op::UConvert => return convert_int::<T, ops::uconvert>(from, to),
        Op::Bitcast if from.bits() == to.bits() => match to.rows() {
            1 => T::handler::<Copy<u32>>(),
            _ => T::handler::<Copy<u64>>(),
        },
        Op::Select => match to.rows() {
            1 => T::handler::<Map3<ops::select, bool, u32, u32, u32>>(),
            _ => T::handler::<Map3<ops::select, bool, u64, u64, u64>>(),
        },
        Op::FLdexp => by_float!(T, to, |X| Map2<ops::fldexp, X, u32, X>),
        Op::BitfieldInsert => by_int!(T, to, |X| BitfieldInsert<X>),
        Op::BitfieldSExtract => by_int!(T, to, |X| Map3<ops::bitfield_sextract, X, u32, u32, X>),
        Op::BitfieldUExtract => by_int!(T, to, |X| Map3<ops::bitfield_uextract, X, u32, u32, X>),
        Op::Pack64 => T::handler::<Map2<ops::pack64, u32, u32, u64>>(),
        _ => return None,
    })
}

/// One kernel of a conversion.
macro_rules! pairs {
    ($op:ty, $from:ident, $to:ident; $($a:ident $at:ty => $($b:ident $bt:ty),*;)*) => {
        match ($from, $to) {
            $($((Type::$a, Type::$b) => Some(T::handler::<Map1<$op, $at, $bt>>()),)*)*
            _ => None,
        }
    };
}

fn float_to_int<T: Tier, O>(from: Type, to: Type) -> Option<Handler>
where
    O: FloatToInt,
{
    pairs!(O, from, to;
        F16 f16 => I8 u8, I16 u16, I32 u32, I64 u64;
        F32 f32 => I8 u8, I16 u16, I32 u32, I64 u64;
        F64 f64 => I8 u8, I16 u16, I32 u32, I64 u64;
    )
}

fn int_to_float<T: Tier, O>(from: Type, to: Type) -> Option<Handler>
where
    O: IntToFloat,
{
    pairs!(O, from, to;
        I8 u8 => F16 f16, F32 f32, F64 f64;
        I16 u16 => F16 f16, F32 f32, F64 f64;
        I32 u32 => F16 f16, F32 f32, F64 f64;
        I64 u64 => F16 f16, F32 f32, F64 f64;
    )
}

fn convert_float<T: Tier>(from: Type, to: Type) -> Option<Handler> {
    pairs!(ops::fconvert, from, to;
        F16 f16 => F16 f16, F32 f32, F64 f64;
        F32 f32 => F16 f16, F32 f32, F64 f64;
        F64 f64 => F16 f16, F32 f32, F64 f64;
    )
}

fn convert_int<T: Tier, O>(from: Type, to: Type) -> Option<Handler>
where
    O: IntToInt,
{
    pairs!(O, from, to;
        I8 u8 => I8 u8, I16 u16, I32 u32, I64 u64;
        I16 u16 => I8 u8, I16 u16, I32 u32, I64 u64;
        I32 u32 => I8 u8, I16 u16, I32 u32, I64 u64;
        I64 u64 => I8 u8, I16 u16, I32 u32, I64 u64;
    )
}

/// A set of `Unary` instances, to name it once.
macro_rules! family {
    ($name:ident: $($a:ty => $($b:ty),*;)*) => {
        trait $name: $($(super::lane::Unary<$a, $b> +)*)* 'static {}
        impl<O: $($(super::lane::Unary<$a, $b> +)*)* 'static> $name for O {}
    };
}
family!(FloatToInt:
    f16 => u8, u16, u32, u64;
    f32 => u8, u16, u32, u64;
    f64 => u8, u16, u32, u64;
);
family!(IntToFloat:
    u8 => f16, f32, f64;
    u16 => f16, f32, f64;
    u32 => f16, f32, f64;
    u64 => f16, f32, f64;
);
family!(IntToInt:
    u8 => u8, u16, u32, u64;
    u16 => u8, u16, u32, u64;
    u32 => u8, u16, u32, u64;
    u64 => u8, u16, u32, u64;
);

/// A row copied as it is.
pub(in crate::interp) type Copy<S> = Map1<ops::copy, S, S>;

/// The two halves of a 64-bit row: low to `d`, high to `b`.
pub(in crate::interp) struct Unpack64;

impl Kernel for Unpack64 {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let high = Instr { d: i.b, ..*i };
        // SAFETY: operands are the program's; the emitter keeps `a` apart from `d` and `b`.
        unsafe {
            <Map1<ops::unpack_low, u64, u32> as Kernel>::run(m, i);
            <Map1<ops::unpack_high, u64, u32> as Kernel>::run(m, &high);
        }
    }
}

/// The fourth operand comes in the instruction's `x`.
struct BitfieldInsert<T>(PhantomData<T>);

impl<T: Lane + Int> Kernel for BitfieldInsert<T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: operands are the program's.
        unsafe {
            for &offset in m.listed() {
                let base = *m.block::<T::Slot>(i.a, offset);
                let insert = *m.block::<T::Slot>(i.b, offset);
                let first = *m.block::<u32>(i.c, offset);
                let count = *m.block::<u32>(m.code.operands[i.x as usize], offset);
                let mut r = [T::Slot::default(); SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    r[k] = eval::bitfield_insert(
                        T::read(base[k]),
                        T::read(insert[k]),
                        first[k],
                        count[k],
                    )
                    .write();
                }
                *m.block::<T::Slot>(i.d, offset) = r;
            }
        }
    }
}

/// A row copied in active lanes only.
pub(in crate::interp) struct MaskedCopy<S>(PhantomData<S>);

impl<S: Lane<Slot = S> + Default> Kernel for MaskedCopy<S> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        // SAFETY: operands are the program's.
        unsafe {
            for &offset in m.listed() {
                let mask = m.active[offset as usize / 64];
                let new = *m.block::<S>(i.a, offset);
                let d = m.block::<S>(i.d, offset);
                if mask == !0 {
                    *d = new;
                    continue;
                }
                let old = *d;
                let mut r = [S::default(); SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    r[k] = if mask & 1 << k != 0 { new[k] } else { old[k] };
                }
                *d = r;
            }
        }
    }
}
