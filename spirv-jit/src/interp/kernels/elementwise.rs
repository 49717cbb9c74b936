//! From an operation and its types to the kernel that performs it.

use std::marker::PhantomData;

use half::f16;
use lanes::{LaneMask, Tier as TierKind};

use super::half::Halves;
use super::lane::{Lane, Map1, Map2, Map3};
use super::ops;
use super::remainder::Remainder;
use crate::SUBGROUP_SIZE;
use crate::eval::{self, Int};
use crate::interp::machine::{Handler, Instr, Machine};
use crate::interp::tier::{Kernel, Portable, Tier};
use crate::ir::{Op, Type};

/// Instantiates `$kernel<ops::$op, …>` for the integer type `$ty`: 32 and 64 bits in the tier,
/// narrow ones once.
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

/// As `by_bits`, for bitwise operations: booleans are all zeros or all ones, so that they need no
/// conversion.
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

/// Instantiates a kernel for a float type, which its arguments name `X`.
macro_rules! by_float {
    ($t:ident, $ty:expr, $kernel:ident<$op:ty, $($x:ident),*>) => {
        match $ty {
            Type::F16 => $t::handler::<$kernel<$op, $(argument!($x, $t::Half)),*>>(),
            other => by_wide_float!($t, other, $kernel<$op, $($x),*>),
        }
    };
}

/// As `by_float`, without 16-bit floats.
macro_rules! by_wide_float {
    ($t:ident, $ty:expr, $kernel:ident<$op:ty, $($x:ident),*>) => {
        match $ty {
            Type::F32 => $t::handler::<$kernel<$op, $(argument!($x, f32)),*>>(),
            Type::F64 => $t::handler::<$kernel<$op, $(argument!($x, f64)),*>>(),
            _ => return None,
        }
    };
}

/// The type that an argument of a kernel names.
macro_rules! argument {
    (X, $x:ty) => {
        $x
    };
    ($other:ident, $x:ty) => {
        $other
    };
}

/// The kernel of a pure operation in a tier: `from` is the type of its (last) operand, `to` of its
/// result. The instruction takes the operands in `a`, `b`, `c` (the fourth of a bit-field insertion
/// in `x`). `None`: there is no such operation on those types.
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

/// The kernel of a row of the table, by its signature.
macro_rules! kernel {
    ($t:ident $from:ident $to:ident $name:ident BitsUnary) => {
        by_mask!($t, $to, |X| Map1<ops::$name, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident BitsBinary) => {
        by_mask!($t, $to, |X| Map2<ops::$name, X, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident BitsCompare) => {
        by_bits!($t, $from, |X| Map2<ops::$name, X, X, bool>)
    };
    ($t:ident $from:ident $to:ident $name:ident IntUnary) => {
        by_int!($t, $to, |X| Map1<ops::$name, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident IntBinary) => {
        by_int!($t, $to, |X| Map2<ops::$name, X, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident IntCompare) => {
        by_int!($t, $from, |X| Map2<ops::$name, X, X, bool>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatUnary) => {
        by_float!($t, $to, Map1<ops::$name, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatFunction) => {
        by_wide_float!($t, $to, Map1<ops::$name, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatBinary) => {
        by_float!($t, $to, Map2<ops::$name, X, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatTernary) => {
        by_float!($t, $to, Map3<ops::$name, X, X, X, X>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatCompare) => {
        by_float!($t, $from, Map2<ops::$name, X, X, bool>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatTest) => {
        by_float!($t, $from, Map1<ops::$name, X, bool>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatExponent) => {
        by_float!($t, $from, Map1<ops::$name, X, u32>)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatToInt) => {
        return float_to_int::<$t, ops::$name>($from, $to)
    };
    ($t:ident $from:ident $to:ident $name:ident IntToFloat) => {
        return int_to_float::<$t, ops::$name>($from, $to)
    };
    ($t:ident $from:ident $to:ident $name:ident FloatToFloat) => {
        return convert_float::<$t>($from, $to)
    };
    ($t:ident $from:ident $to:ident $name:ident IntToInt) => {
        return convert_int::<$t, ops::$name>($from, $to)
    };
    ($t:ident $from:ident $to:ident $name:ident Bitcast) => {
        match $to.rows() {
            1 => $t::handler::<Map1<ops::$name, u32, u32>>(),
            _ => $t::handler::<Map1<ops::$name, u64, u64>>(),
        }
    };
}

macro_rules! define_in_tier {
    ($(($variant:ident, $name:ident, $signature:ident))*) => {
        fn in_tier<T: Halves>(op: &Op, from: Type, to: Type) -> Option<Handler> {
            Some(match op {
                Op::FRem if to == Type::F32 => T::handler::<Remainder<ops::frem>>(),
                Op::FMod if to == Type::F32 => T::handler::<Remainder<ops::fmod>>(),
                // These change one bit, for which no conversion is needed.
                Op::FNeg if to == Type::F16 => T::handler::<Map1<ops::fneg, f16, f16>>(),
                Op::FAbs if to == Type::F16 => T::handler::<Map1<ops::fabs, f16, f16>>(),
                $(Op::$variant => kernel!(T from to $name $signature),)*
                _ => return other::<T>(op, to),
            })
        }
    };
}
crate::elementwise_ops!(define_in_tier);

/// Pure operations whose operands are of several types.
fn other<T: Halves>(op: &Op, to: Type) -> Option<Handler> {
    Some(match op {
        Op::Select => match to.rows() {
            1 => T::handler::<Map3<ops::select, bool, u32, u32, u32>>(),
            _ => T::handler::<Map3<ops::select, bool, u64, u64, u64>>(),
        },
        Op::FLdexp => by_float!(T, to, Map2<ops::fldexp, X, u32, X>),
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

fn float_to_int<T: Halves, O>(from: Type, to: Type) -> Option<Handler>
where
    O: FloatToInt<T::Half>,
{
    pairs!(O, from, to;
        F16 T::Half => I8 u8, I16 u16, I32 u32, I64 u64;
        F32 f32 => I8 u8, I16 u16, I32 u32, I64 u64;
        F64 f64 => I8 u8, I16 u16, I32 u32, I64 u64;
    )
}

fn int_to_float<T: Halves, O>(from: Type, to: Type) -> Option<Handler>
where
    O: IntToFloat<T::Half>,
{
    pairs!(O, from, to;
        I8 u8 => F16 T::Half, F32 f32, F64 f64;
        I16 u16 => F16 T::Half, F32 f32, F64 f64;
        I32 u32 => F16 T::Half, F32 f32, F64 f64;
        I64 u64 => F16 T::Half, F32 f32, F64 f64;
    )
}

fn convert_float<T: Halves>(from: Type, to: Type) -> Option<Handler> {
    pairs!(ops::fconvert, from, to;
        F16 T::Half => F16 T::Half, F32 f32, F64 f64;
        F32 f32 => F16 T::Half, F32 f32, F64 f64;
        F64 f64 => F16 T::Half, F32 f32, F64 f64;
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
    ($name:ident $(<$half:ident>)?: $($a:ty => $($b:ty),*;)*) => {
        trait $name$(<$half>)?: $($(super::lane::Unary<$a, $b> +)*)* 'static {}
        impl<$($half,)? O: $($(super::lane::Unary<$a, $b> +)*)* 'static> $name$(<$half>)? for O {}
    };
}
family!(FloatToInt<H>:
    H => u8, u16, u32, u64;
    f32 => u8, u16, u32, u64;
    f64 => u8, u16, u32, u64;
);
family!(IntToFloat<H>:
    u8 => H, f32, f64;
    u16 => H, f32, f64;
    u32 => H, f32, f64;
    u64 => H, f32, f64;
);
family!(IntToInt:
    u8 => u8, u16, u32, u64;
    u16 => u8, u16, u32, u64;
    u32 => u8, u16, u32, u64;
    u64 => u8, u16, u32, u64;
);

/// A row copied as it is.
pub(in crate::interp) type Copy<S> = Map1<ops::bitcast, S, S>;

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
            for &subgroup in m.listed() {
                let base = *m.block::<T::Slot>(i.a, subgroup);
                let insert = *m.block::<T::Slot>(i.b, subgroup);
                let first = *m.block::<u32>(i.c, subgroup);
                let count = *m.block::<u32>(m.code.operands[i.x as usize], subgroup);
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
                *m.block::<T::Slot>(i.d, subgroup) = r;
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
            for &subgroup in m.listed() {
                let mask = m.active[subgroup as usize];
                let new = *m.block::<S>(i.a, subgroup);
                let d = m.block::<S>(i.d, subgroup);
                if mask == LaneMask::ALL {
                    *d = new;
                    continue;
                }
                let old = *d;
                let mut r = [S::default(); SUBGROUP_SIZE];
                for k in 0..SUBGROUP_SIZE {
                    r[k] = if mask.contains(k) { new[k] } else { old[k] };
                }
                *d = r;
            }
        }
    }
}
