//! Floating-point operations: IEEE 754, one rounding each, except the transcendental ones.

// Comparisons are phrased so that NaN falls on the side that the operation's name says.
#![allow(clippy::double_comparisons)]

use half::f16;

use super::fast::Fast;
use super::int::Int;
use super::{narrow, transcendental as t, wide};

/// A type that arithmetic is done in: `f32` or `f64`.
pub trait Native: Fast + Copy + PartialOrd + std::fmt::Debug + 'static {
    const ZERO: Self;
    const ONE: Self;
    fn add(self, b: Self) -> Self;
    fn sub(self, b: Self) -> Self;
    fn mul(self, b: Self) -> Self;
    fn div(self, b: Self) -> Self;
    fn rem(self, b: Self) -> Self;
    fn fma(self, b: Self, c: Self) -> Self;
    fn floor(self) -> Self;
    fn ceil(self) -> Self;
    fn trunc(self) -> Self;
    fn round_even(self) -> Self;
    fn round(self) -> Self;
    fn sqrt(self) -> Self;
    fn copysign(self, sign: Self) -> Self;
    fn quantize_f16(self) -> Self;
    fn flush_denormal(self) -> Self;
    fn frexp(self) -> (Self, i32);
    fn ldexp(self, exponent: i32) -> Self;
    fn pow(self, b: Self) -> Self;
    fn atan2(self, x: Self) -> Self;
    fn sin(self) -> Self;
    fn cos(self) -> Self;
    fn tan(self) -> Self;
    fn asin(self) -> Self;
    fn acos(self) -> Self;
    fn atan(self) -> Self;
    fn sinh(self) -> Self;
    fn cosh(self) -> Self;
    fn tanh(self) -> Self;
    fn asinh(self) -> Self;
    fn acosh(self) -> Self;
    fn atanh(self) -> Self;
    fn exp(self) -> Self;
    fn log(self) -> Self;
    fn exp2(self) -> Self;
    fn log2(self) -> Self;
}

/// A floating-point scalar: its bits, and the type that it is computed in.
///
/// For `f16` that is `f32`. Where an operation's exact result is rounded to `f32` first and to
/// `f16` then, the second result is that of one rounding: `f32` has p = 24 bits of significand,
/// `f16` has q = 11, and p ≥ 2q + 2 suffices for sums, differences, products, quotients and square
/// roots (Figueroa 1995, "When is double rounding innocuous?"). Products are exact; a sum has more
/// than 24 bits only where the smaller operand is below a quarter of the greater one's last place,
/// so that it decides no tie; quotients and roots that are not exact lie further than 2^-24 of
/// their size from all that has 12 bits. Subnormal results have fewer bits than q, and the same
/// holds: sums are exact there, quotients keep their distance. A fused product and sum needs more
/// ([`fma`](Float::fma)).
pub trait Float: Copy + std::fmt::Debug + 'static {
    type Bits: Int;
    type Native: Native;
    fn bits(self) -> Self::Bits;
    fn from_bits(bits: Self::Bits) -> Self;
    fn widen(self) -> Self::Native;
    fn narrow(value: Self::Native) -> Self;
    fn fma(self, b: Self, c: Self) -> Self;
    fn to_f64(self) -> f64;
    /// Rounds once.
    fn from_f64(value: f64) -> Self;
    /// Rounds once.
    fn from_f32(value: f32) -> Self;
}

macro_rules! impl_native {
    ($f:ident, $u:ident, $t:ident, $mantissa:literal, $bias:literal) => {
        impl Native for $f {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                self + b
            }
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                self - b
            }
            #[inline(always)]
            fn mul(self, b: Self) -> Self {
                self * b
            }
            #[inline(always)]
            fn div(self, b: Self) -> Self {
                self / b
            }
            #[inline(always)]
            fn rem(self, b: Self) -> Self {
                self % b
            }
            #[inline(always)]
            fn fma(self, b: Self, c: Self) -> Self {
                self.mul_add(b, c)
            }
            #[inline(always)]
            fn floor(self) -> Self {
                $f::floor(self)
            }
            #[inline(always)]
            fn ceil(self) -> Self {
                $f::ceil(self)
            }
            #[inline(always)]
            fn trunc(self) -> Self {
                $f::trunc(self)
            }
            #[inline(always)]
            fn round_even(self) -> Self {
                self.round_ties_even()
            }
            #[inline(always)]
            fn round(self) -> Self {
                $f::round(self)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $f::sqrt(self)
            }
            #[inline(always)]
            fn copysign(self, sign: Self) -> Self {
                $f::copysign(self, sign)
            }
            #[inline(always)]
            fn quantize_f16(self) -> Self {
                let rounded = narrow::f16_from_f64(self as f64).to_bits();
                // `OpQuantizeToF16`: what is not representable as a normal number is zero.
                let flushed = if rounded & 0x7c00 == 0 { rounded & 0x8000 } else { rounded };
                narrow::f32_from_f16(f16::from_bits(flushed)) as $f
            }
            #[inline(always)]
            fn flush_denormal(self) -> Self {
                const EXPONENT: $u = ((1 << ($u::BITS - 1 - $mantissa)) - 1) << $mantissa;
                const SIGN: $u = 1 << ($u::BITS - 1);
                let bits = self.to_bits();
                $f::from_bits(if bits & EXPONENT == 0 { bits & SIGN } else { bits })
            }
            #[inline(always)]
            fn frexp(self) -> (Self, i32) {
                const EXPONENT: $u = ((1 << ($u::BITS - 1 - $mantissa)) - 1) << $mantissa;
                // Denormals are brought into the normal range first.
                let scale = (1u64 << ($mantissa + 1)) as $f;
                let tiny = self.to_bits() & EXPONENT == 0;
                let x = if tiny { self * scale } else { self };
                let shift = if tiny { $mantissa + 1 } else { 0 };
                let bits = x.to_bits();
                let exponent = ((bits & EXPONENT) >> $mantissa) as i32 - ($bias - 1) - shift;
                let mantissa = $f::from_bits(bits & !EXPONENT | ($bias - 1) << $mantissa);
                let special = self == 0.0 || !self.is_finite();
                (
                    if special { self } else { mantissa },
                    if special { 0 } else { exponent },
                )
            }
            #[inline(always)]
            fn ldexp(self, exponent: i32) -> Self {
                wide::ldexp(self as f64, exponent, $f::MANTISSA_DIGITS == 53) as $f
            }
            #[inline(always)]
            fn pow(self, b: Self) -> Self {
                $t::pow(self, b)
            }
            #[inline(always)]
            fn atan2(self, x: Self) -> Self {
                $t::atan2(self, x)
            }
            impl_native!(@unary $t sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log exp2 log2);
        }
    };
    (@unary $t:ident $($name:ident)*) => {$(
        #[inline(always)]
        fn $name(self) -> Self {
            $t::$name(self)
        }
    )*};
}
impl_native!(f32, u32, t, 23, 127);
impl_native!(f64, u64, wide, 52, 1023);

impl Float for f32 {
    type Bits = u32;
    type Native = f32;
    #[inline(always)]
    fn bits(self) -> u32 {
        self.to_bits()
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> f32 {
        f32::from_bits(bits)
    }
    #[inline(always)]
    fn widen(self) -> f32 {
        self
    }
    #[inline(always)]
    fn narrow(value: f32) -> f32 {
        value
    }
    #[inline(always)]
    fn fma(self, b: f32, c: f32) -> f32 {
        self.mul_add(b, c)
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self as f64
    }
    #[inline(always)]
    fn from_f64(value: f64) -> f32 {
        value as f32
    }
    #[inline(always)]
    fn from_f32(value: f32) -> f32 {
        value
    }
}

impl Float for f64 {
    type Bits = u64;
    type Native = f64;
    #[inline(always)]
    fn bits(self) -> u64 {
        self.to_bits()
    }
    #[inline(always)]
    fn from_bits(bits: u64) -> f64 {
        f64::from_bits(bits)
    }
    #[inline(always)]
    fn widen(self) -> f64 {
        self
    }
    #[inline(always)]
    fn narrow(value: f64) -> f64 {
        value
    }
    #[inline(always)]
    fn fma(self, b: f64, c: f64) -> f64 {
        self.mul_add(b, c)
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn from_f64(value: f64) -> f64 {
        value
    }
    #[inline(always)]
    fn from_f32(value: f32) -> f64 {
        value as f64
    }
}

impl Float for f16 {
    type Bits = u16;
    type Native = f32;
    #[inline(always)]
    fn bits(self) -> u16 {
        self.to_bits()
    }
    #[inline(always)]
    fn from_bits(bits: u16) -> f16 {
        f16::from_bits(bits)
    }
    #[inline(always)]
    fn widen(self) -> f32 {
        narrow::f32_from_f16(self)
    }
    #[inline(always)]
    fn narrow(value: f32) -> f16 {
        narrow::f16_from_f32(value)
    }
    /// The product is exact in `f64`, and the sum rounds there only when one side is too small to
    /// matter for the second rounding.
    #[inline(always)]
    fn fma(self, b: f16, c: f16) -> f16 {
        narrow::f16_from_f64(Float::to_f64(self).mul_add(Float::to_f64(b), Float::to_f64(c)))
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        narrow::f32_from_f16(self) as f64
    }
    #[inline(always)]
    fn from_f64(value: f64) -> f16 {
        narrow::f16_from_f64(value)
    }
    #[inline(always)]
    fn from_f32(value: f32) -> f16 {
        narrow::f16_from_f32(value)
    }
}

macro_rules! float_unary {
    ($($name:ident $method:ident)*) => {$(
        #[inline(always)]
        pub fn $name<T: Float>(a: T) -> T {
            T::narrow(a.widen().$method())
        }
    )*};
}
float_unary! {
    ffloor floor
    fceil ceil
    ftrunc trunc
    fround_even round_even
    fround round
    fsqrt sqrt
    fsin sin
    fcos cos
    ftan tan
    fasin asin
    facos acos
    fatan atan
    fsinh sinh
    fcosh cosh
    ftanh tanh
    fasinh asinh
    facosh acosh
    fatanh atanh
    fexp exp
    flog log
    fexp2 exp2
    flog2 log2
    fquantize_f16 quantize_f16
    fflush_denormal flush_denormal
    fsin_fast sin_fast
    fcos_fast cos_fast
    ftan_fast tan_fast
    fatan_fast atan_fast
    fexp_fast exp_fast
    fexp2_fast exp2_fast
    flog_fast log_fast
    flog2_fast log2_fast
    finverse_sqrt_fast inverse_sqrt_fast
}

macro_rules! float_binary {
    ($($name:ident $method:ident)*) => {$(
        #[inline(always)]
        pub fn $name<T: Float>(a: T, b: T) -> T {
            T::narrow(a.widen().$method(b.widen()))
        }
    )*};
}
float_binary! {
    fadd add
    fsub sub
    fmul mul
    fdiv div
    frem rem
    fpow pow
    fatan2 atan2
    fpow_fast pow_fast
    fatan2_fast atan2_fast
}

/// The result has the divisor's sign.
#[inline(always)]
pub fn fmod<T: Float>(a: T, b: T) -> T {
    let (x, y) = (a.widen(), b.widen());
    let zero = T::Native::ZERO;
    let r = x.rem(y);
    T::narrow(if r != zero && (r < zero) != (y < zero) {
        r.add(y)
    } else {
        r
    })
}

/// The number if one is NaN; −0 below +0.
#[inline(always)]
pub fn fmin<T: Float>(a: T, b: T) -> T {
    let (x, y) = (a.widen(), b.widen());
    let bits = if x < y { a.bits() } else { b.bits() };
    // Equal: the same bits, or zeros of either sign.
    let bits = if x == y { a.bits().or(b.bits()) } else { bits };
    T::from_bits(if fis_nan(b) { a.bits() } else { bits })
}

#[inline(always)]
pub fn fmax<T: Float>(a: T, b: T) -> T {
    let (x, y) = (a.widen(), b.widen());
    let bits = if x > y { a.bits() } else { b.bits() };
    let bits = if x == y { a.bits().and(b.bits()) } else { bits };
    T::from_bits(if fis_nan(b) { a.bits() } else { bits })
}

/// `a * b + c`, rounded once.
#[inline(always)]
pub fn ffma<T: Float>(a: T, b: T, c: T) -> T {
    a.fma(b, c)
}

#[inline(always)]
fn sign_bit<T: Float>() -> T::Bits {
    T::Bits::ONE.shl(T::Bits::BITS - 1)
}

#[inline(always)]
pub fn fneg<T: Float>(a: T) -> T {
    T::from_bits(a.bits().xor(sign_bit::<T>()))
}

#[inline(always)]
pub fn fabs<T: Float>(a: T) -> T {
    T::from_bits(a.bits().and(sign_bit::<T>().not()))
}

/// −1, ±0 or 1 (`GLSL.std.450`, `FSign`: the result is one of these); +0 for NaN, whose sign is not
/// the same on all machines.
#[inline(always)]
pub fn fsign<T: Float>(a: T) -> T {
    let x = a.widen();
    let is_signed = x < T::Native::ZERO || x > T::Native::ZERO;
    let size = if is_signed {
        T::Native::ONE
    } else {
        T::Native::ZERO
    };
    let sign = if fis_nan(a) { T::Native::ONE } else { x };
    T::narrow(size.copysign(sign))
}

/// `x - floor(x)`.
#[inline(always)]
pub fn ffract<T: Float>(a: T) -> T {
    let x = a.widen();
    T::narrow(x.sub(x.floor()))
}

#[inline(always)]
pub fn finverse_sqrt<T: Float>(a: T) -> T {
    T::narrow(T::Native::ONE.div(a.widen().sqrt()))
}

#[inline(always)]
pub fn ffrexp_mantissa<T: Float>(a: T) -> T {
    T::narrow(a.widen().frexp().0)
}

#[inline(always)]
pub fn ffrexp_exponent<T: Float>(a: T) -> u32 {
    a.widen().frexp().1 as u32
}

/// `a * 2^exponent`, rounded once.
#[inline(always)]
pub fn fldexp<T: Float>(a: T, exponent: u32) -> T {
    T::from_f64(wide::ldexp(
        a.to_f64(),
        exponent as i32,
        T::Bits::BITS == 64,
    ))
}

macro_rules! float_compare {
    ($($name:ident($x:ident, $y:ident) = $value:expr;)*) => {$(
        #[inline(always)]
        pub fn $name<T: Float>(a: T, b: T) -> bool {
            let ($x, $y) = (a.widen(), b.widen());
            $value
        }
    )*};
}
float_compare! {
    foeq(x, y) = x == y;
    fone(x, y) = x < y || x > y;
    folt(x, y) = x < y;
    fole(x, y) = x <= y;
    fueq(x, y) = !(x < y || x > y);
    fune(x, y) = x != y;
    fult(x, y) = !(x >= y);
    fule(x, y) = !(x > y);
}

#[inline(always)]
#[allow(clippy::eq_op)]
pub fn fis_nan<T: Float>(a: T) -> bool {
    a.widen() != a.widen()
}

#[inline(always)]
pub fn fis_inf<T: Float>(a: T) -> bool {
    let x = a.widen();
    // Infinity is its own double, and neither zero nor NaN.
    x == x.add(x) && x != T::Native::ZERO
}
