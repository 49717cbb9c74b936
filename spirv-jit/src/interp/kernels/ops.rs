//! Each operation of `eval` as a type, under its own name, so that kernels can be generic over it.
#![allow(non_camel_case_types)]

use super::lane::{Binary, Ternary, Unary};
use crate::eval::{self, Bits, Float, Int};

macro_rules! operation {
    ($($name:ident)*) => {
        $(pub(in crate::interp) struct $name;)*
    };
}

/// Implements an operation of the table by its signature.
macro_rules! implement {
    ($name:ident [$($generics:tt)*] $trait:ty, ($($arg:ident: $ty:ty),*) -> $result:ty) => {
        impl<$($generics)*> $trait for $name {
            #[inline(always)]
            fn call($($arg: $ty),*) -> $result {
                eval::$name($($arg),*)
            }
        }
    };
    ($name:ident BitsUnary) => { implement!($name [T: Bits] Unary<T, T>, (a: T) -> T); };
    ($name:ident BitsBinary) => { implement!($name [T: Bits] Binary<T, T, T>, (a: T, b: T) -> T); };
    ($name:ident BitsCompare) => {
        implement!($name [T: Bits] Binary<T, T, bool>, (a: T, b: T) -> bool);
    };
    ($name:ident IntUnary) => { implement!($name [T: Int] Unary<T, T>, (a: T) -> T); };
    ($name:ident IntBinary) => { implement!($name [T: Int] Binary<T, T, T>, (a: T, b: T) -> T); };
    ($name:ident IntCompare) => {
        implement!($name [T: Int] Binary<T, T, bool>, (a: T, b: T) -> bool);
    };
    ($name:ident FloatUnary) => { implement!($name [T: Float] Unary<T, T>, (a: T) -> T); };
    ($name:ident FloatFunction) => { implement!($name FloatUnary); };
    ($name:ident FloatBinary) => {
        implement!($name [T: Float] Binary<T, T, T>, (a: T, b: T) -> T);
    };
    ($name:ident FloatTernary) => {
        implement!($name [T: Float] Ternary<T, T, T, T>, (a: T, b: T, c: T) -> T);
    };
    ($name:ident FloatCompare) => {
        implement!($name [T: Float] Binary<T, T, bool>, (a: T, b: T) -> bool);
    };
    ($name:ident FloatTest) => { implement!($name [T: Float] Unary<T, bool>, (a: T) -> bool); };
    ($name:ident FloatExponent) => { implement!($name [T: Float] Unary<T, u32>, (a: T) -> u32); };
    ($name:ident FloatToInt) => {
        implement!($name [A: Float, B: Int] Unary<A, B>, (a: A) -> B);
    };
    ($name:ident IntToFloat) => {
        implement!($name [A: Int, B: Float] Unary<A, B>, (a: A) -> B);
    };
    ($name:ident FloatToFloat) => {
        implement!($name [A: Float, B: Float] Unary<A, B>, (a: A) -> B);
    };
    ($name:ident IntToInt) => { implement!($name [A: Int, B: Int] Unary<A, B>, (a: A) -> B); };
    ($name:ident Bitcast) => {
        impl<T> Unary<T, T> for $name {
            #[inline(always)]
            fn call(value: T) -> T {
                value
            }
        }
    };
}

macro_rules! implement_all {
    ($(($variant:ident, $name:ident, $signature:ident))*) => {
        operation!($($name)*);
        $(implement!($name $signature);)*
    };
}
crate::elementwise_ops!(implement_all);

operation!(select bitfield_sextract bitfield_uextract fldexp pack64 unpack_low unpack_high);

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
