//! Each operation of `eval` as a type, under its own name, so that kernels can be generic over it.
#![allow(non_camel_case_types)]

use super::lane::{Binary, Ternary, Unary};
use crate::eval::{self, Bits, Float, Int};

macro_rules! operation {
    ($($name:ident)*) => {
        $(pub(in crate::interp) struct $name;)*
    };
}

macro_rules! unary {
    ($bound:ident: $($name:ident)*) => {$(
        operation!($name);
        impl<T: $bound> Unary<T, T> for $name {
            #[inline(always)]
            fn call(a: T) -> T {
                eval::$name(a)
            }
        }
    )*};
}

macro_rules! binary {
    ($bound:ident: $($name:ident)*) => {$(
        operation!($name);
        impl<T: $bound> Binary<T, T, T> for $name {
            #[inline(always)]
            fn call(a: T, b: T) -> T {
                eval::$name(a, b)
            }
        }
    )*};
}

macro_rules! compare {
    ($bound:ident: $($name:ident)*) => {$(
        operation!($name);
        impl<T: $bound> Binary<T, T, bool> for $name {
            #[inline(always)]
            fn call(a: T, b: T) -> bool {
                eval::$name(a, b)
            }
        }
    )*};
}

binary!(Int: iadd isub imul umul_hi smul_hi udiv sdiv urem srem smod shl lshr ashr smin smax umin umax);
binary!(Bits: and or xor);
unary!(Bits: not);
unary!(Int: ineg iabs isign bit_reverse bit_count find_lsb find_smsb find_umsb);
compare!(Bits: ieq ine);
compare!(Int: ult ule slt sle);
binary!(Float: fadd fsub fmul fdiv frem fmod fmin fmax fpow fatan2 fpow_fast fatan2_fast);
unary!(Float: fneg fabs fsign ffloor fceil ftrunc fround_even fround ffract fsqrt finverse_sqrt fsin fcos ftan fasin facos fatan fsinh fcosh ftanh fasinh facosh fatanh fexp flog fexp2 flog2 fquantize_f16 ffrexp_mantissa);
unary!(Float: fsin_fast fcos_fast ftan_fast fatan_fast fexp_fast fexp2_fast flog_fast flog2_fast finverse_sqrt_fast);
compare!(Float: foeq fone folt fole fueq fune fult fule);

operation!(ffma select bitfield_sextract bitfield_uextract fldexp pack64 unpack_low unpack_high);
operation!(fis_nan fis_inf fto_s fto_u sto_f uto_f fconvert sconvert uconvert ffrexp_exponent copy);

impl<T: Float> Ternary<T, T, T, T> for ffma {
    #[inline(always)]
    fn call(a: T, b: T, c: T) -> T {
        eval::ffma(a, b, c)
    }
}

impl<T> Ternary<bool, T, T, T> for select {
    #[inline(always)]
    fn call(condition: bool, a: T, b: T) -> T {
        eval::select(condition, a, b)
    }
}

impl<T: Int> Ternary<T, u32, u32, T> for bitfield_sextract {
    #[inline(always)]
    fn call(base: T, offset: u32, count: u32) -> T {
        eval::bitfield_sextract(base, offset, count)
    }
}

impl<T: Int> Ternary<T, u32, u32, T> for bitfield_uextract {
    #[inline(always)]
    fn call(base: T, offset: u32, count: u32) -> T {
        eval::bitfield_uextract(base, offset, count)
    }
}

impl<T: Float> Binary<T, u32, T> for fldexp {
    #[inline(always)]
    fn call(a: T, exponent: u32) -> T {
        eval::fldexp(a, exponent)
    }
}

impl Binary<u32, u32, u64> for pack64 {
    #[inline(always)]
    fn call(low: u32, high: u32) -> u64 {
        eval::pack64(low, high)
    }
}

impl Unary<u64, u32> for unpack_low {
    #[inline(always)]
    fn call(value: u64) -> u32 {
        eval::unpack64(value).0
    }
}

impl Unary<u64, u32> for unpack_high {
    #[inline(always)]
    fn call(value: u64) -> u32 {
        eval::unpack64(value).1
    }
}

impl<T> Unary<T, T> for copy {
    #[inline(always)]
    fn call(value: T) -> T {
        value
    }
}

macro_rules! convert {
    ($($name:ident: $from:ident, $to:ident;)*) => {$(
        impl<A: $from, B: $to> Unary<A, B> for $name {
            #[inline(always)]
            fn call(a: A) -> B {
                eval::$name(a)
            }
        }
    )*};
}
convert! {
    fto_s: Float, Int;
    fto_u: Float, Int;
    sto_f: Int, Float;
    uto_f: Int, Float;
    sconvert: Int, Int;
    uconvert: Int, Int;
    fconvert: Float, Float;
}

macro_rules! test {
    ($($name:ident -> $result:ty;)*) => {$(
        impl<T: Float> Unary<T, $result> for $name {
            #[inline(always)]
            fn call(a: T) -> $result {
                eval::$name(a)
            }
        }
    )*};
}
test! {
    fis_nan -> bool;
    fis_inf -> bool;
    ffrexp_exponent -> u32;
}
