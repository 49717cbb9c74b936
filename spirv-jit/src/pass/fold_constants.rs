//! Evaluates operations on constants with the definitions in [`eval`](crate::eval).

use crate::eval::{self, f16};
use crate::ir::{Op, Type};

/// Evaluates `$value` with `$t` the type of integers of type `$ty`.
macro_rules! with_int {
    ($ty:expr, |$t:ident| $value:expr) => {
        match $ty {
            Type::I8 => {
                type $t = u8;
                Some($value)
            }
            Type::I16 => {
                type $t = u16;
                Some($value)
            }
            Type::I32 => {
                type $t = u32;
                Some($value)
            }
            Type::I64 => {
                type $t = u64;
                Some($value)
            }
            _ => None,
        }
    };
}

/// As `with_int`, of floats.
macro_rules! with_float {
    ($ty:expr, |$t:ident| $value:expr) => {
        match $ty {
            Type::F16 => {
                type $t = f16;
                Some($value)
            }
            Type::F32 => {
                type $t = f32;
                Some($value)
            }
            Type::F64 => {
                type $t = f64;
                Some($value)
            }
            _ => None,
        }
    };
}

/// As `with_int`, of integers and booleans.
macro_rules! with_bits {
    ($ty:expr, |$t:ident| $value:expr) => {
        match $ty {
            Type::I1 => {
                type $t = bool;
                Some($value)
            }
            ty => with_int!(ty, |$t| $value),
        }
    };
}

/// The bits of a scalar in a constant.
trait Scalar {
    fn read(bits: u64) -> Self;
    fn bits(self) -> u64;
}

macro_rules! scalar {
    ($($t:ty: $bits:ident => $read:expr, $value:ident => $write:expr;)*) => {$(
        impl Scalar for $t {
            fn read($bits: u64) -> Self {
                $read
            }

            fn bits(self) -> u64 {
                let $value = self;
                $write
            }
        }
    )*};
}
scalar! {
    bool: bits => bits != 0, value => value.into();
    u8: bits => bits as u8, value => value.into();
    u16: bits => bits as u16, value => value.into();
    u32: bits => bits as u32, value => value.into();
    u64: bits => bits, value => value;
    f16: bits => f16::from_bits(bits as u16), value => value.to_bits().into();
    f32: bits => f32::from_bits(bits as u32), value => value.to_bits().into();
    f64: bits => f64::from_bits(bits), value => value.to_bits();
}

/// The bits of the result of an elementwise operation, by its signature.
macro_rules! fold {
    ($from:ident $to:ident $args:ident $name:ident BitsUnary) => {
        with_bits!($from, |T| eval::$name(T::read($args[0])).bits())
    };
    ($from:ident $to:ident $args:ident $name:ident BitsBinary) => {
        with_bits!($from, |T| eval::$name(T::read($args[0]), T::read($args[1]))
            .bits())
    };
    ($from:ident $to:ident $args:ident $name:ident BitsCompare) => {
        with_bits!($from, |T| eval::$name(T::read($args[0]), T::read($args[1]))
            .bits())
    };
    ($from:ident $to:ident $args:ident $name:ident IntUnary) => {
        with_int!($from, |T| eval::$name(T::read($args[0])).bits())
    };
    ($from:ident $to:ident $args:ident $name:ident IntBinary) => {
        with_int!($from, |T| eval::$name(T::read($args[0]), T::read($args[1]))
            .bits())
    };
    ($from:ident $to:ident $args:ident $name:ident IntCompare) => {
        with_int!($from, |T| eval::$name(T::read($args[0]), T::read($args[1]))
            .bits())
    };
    ($from:ident $to:ident $args:ident $name:ident FloatBinary) => {
        with_float!($from, |T| eval::$name(T::read($args[0]), T::read($args[1]))
            .bits())
    };
    ($from:ident $to:ident $args:ident $name:ident FloatCompare) => {
        with_float!($from, |T| eval::$name(T::read($args[0]), T::read($args[1]))
            .bits())
    };
    ($from:ident $to:ident $args:ident $name:ident FloatTernary) => {
        with_float!($from, |T| {
            eval::$name(T::read($args[0]), T::read($args[1]), T::read($args[2])).bits()
        })
    };
    ($from:ident $to:ident $args:ident $name:ident FloatToInt) => {
        with_float!($from, |A| with_int!($to, |B| {
            eval::$name::<A, B>(A::read($args[0])).bits()
        })?)
    };
    ($from:ident $to:ident $args:ident $name:ident IntToFloat) => {
        with_int!($from, |A| with_float!($to, |B| {
            eval::$name::<A, B>(A::read($args[0])).bits()
        })?)
    };
    ($from:ident $to:ident $args:ident $name:ident FloatToFloat) => {
        with_float!($from, |A| with_float!($to, |B| {
            eval::$name::<A, B>(A::read($args[0])).bits()
        })?)
    };
    ($from:ident $to:ident $args:ident $name:ident IntToInt) => {
        with_int!($from, |A| with_int!($to, |B| {
            eval::$name::<A, B>(A::read($args[0])).bits()
        })?)
    };
    ($from:ident $to:ident $args:ident $name:ident Bitcast) => {
        Some($args[0])
    };
    ($from:ident $to:ident $args:ident $name:ident $of_one_float:ident) => {
        with_float!($from, |T| eval::$name(T::read($args[0])).bits())
    };
}

macro_rules! define_fold {
    ($(($variant:ident, $name:ident, $signature:ident))*) => {
        /// The bits of the result of a pure operation with one result on constants; `None` for
        /// other operations. `from` is the type of the main operand (for `select`, of the selected
        /// ones), `to` the result's.
        pub fn fold(op: &Op, from: Type, to: Type, args: &[u64]) -> Option<u64> {
            match op {
                $(Op::$variant => fold!(from to args $name $signature),)*
                _ => fold_other(op, from, args),
            }
        }
    };
}
crate::elementwise_ops!(define_fold);

fn fold_other(op: &Op, from: Type, args: &[u64]) -> Option<u64> {
    let number = |index: usize| args[index] as u32;
    match op {
        Op::Select => Some(if args[0] != 0 { args[1] } else { args[2] }),
        Op::Pack64 => Some(eval::pack64(number(0), number(1))),
        Op::FLdexp => with_float!(from, |T| eval::fldexp(T::read(args[0]), number(1)).bits()),
        Op::BitfieldInsert => with_int!(from, |T| {
            let (base, insert) = (T::read(args[0]), T::read(args[1]));
            eval::bitfield_insert(base, insert, number(2), number(3)).bits()
        }),
        Op::BitfieldSExtract => with_int!(from, |T| {
            eval::bitfield_sextract(T::read(args[0]), number(1), number(2)).bits()
        }),
        Op::BitfieldUExtract => with_int!(from, |T| {
            eval::bitfield_uextract(T::read(args[0]), number(1), number(2)).bits()
        }),
        _ => None,
    }
}
