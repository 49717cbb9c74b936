//! Two operations in one pass over the lanes, where the first one's result goes nowhere else: it
//! need not be stored.

use std::marker::PhantomData;

use lanes::Tier as TierKind;

use super::lane::{Binary, Blocks, Lane, Unary};
use super::ops;
use crate::SUBGROUP_SIZE;
use crate::interp::machine::{Handler, Instr, Machine};
use crate::interp::tier::{Kernel, Portable, Tier};
use crate::ir::{Op, Type};

/// How the second operation takes the first one's result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::interp) enum Side {
    Left,
    Right,
}

/// The kernel of `second(first(a, b), c)`, or of `second(c, first(a, b))`, all of one type (`ty` is
/// that of the first one's result); an operation of one operand leaves out `b`, or `c`. `None`:
/// these two have none.
pub(in crate::interp) fn fused(
    tier: TierKind,
    first: &Op,
    second: &Op,
    side: Side,
    ty: Type,
) -> Option<Handler> {
    match tier {
        TierKind::Portable => in_tier::<Portable>(first, second, side, ty),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => in_tier::<crate::interp::tier::Avx2>(first, second, side, ty),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<crate::interp::tier::Avx512>(first, second, side, ty),
        #[cfg(not(target_arch = "x86_64"))]
        _ => in_tier::<Portable>(first, second, side, ty),
    }
}

/// The second operation of a pair whose first is `$first`: `$sub` takes the first one's result on
/// either side, the next few are commutative, the last few take it on the left.
macro_rules! seconds {
    ($t:ident, $first:ty, $ty:ty, $second:expr, $side:expr; $sub:ident $sub_name:ident; $($op:ident $name:ident),*; $($ordered:ident $ordered_name:ident),*) => {
        match ($second, $side) {
            (Op::$sub, Side::Left) => $t::handler::<Pair<$first, ops::$sub_name, $ty>>(),
            (Op::$sub, Side::Right) => $t::handler::<PairRight<$first, ops::$sub_name, $ty>>(),
            $((Op::$op, _) => $t::handler::<Pair<$first, ops::$name, $ty>>(),)*
            $((Op::$ordered, Side::Left) => $t::handler::<Pair<$first, ops::$ordered_name, $ty>>(),)*
            _ => return None,
        }
    };
}

fn in_tier<T: Tier>(first: &Op, second: &Op, side: Side, ty: Type) -> Option<Handler> {
    Some(match (first, ty) {
        (Op::FAdd, Type::F32) => float::<T, ops::fadd>(second, side)?,
        (Op::FSub, Type::F32) => float::<T, ops::fsub>(second, side)?,
        (Op::FMul, Type::F32) => float::<T, ops::fmul>(second, side)?,
        (Op::IAdd, Type::I32) => int::<T, ops::iadd>(second, side)?,
        (Op::IMul, Type::I32) => int::<T, ops::imul>(second, side)?,
        (Op::And, Type::I32) => int::<T, ops::and>(second, side)?,
        (Op::Or, Type::I32) => int::<T, ops::or>(second, side)?,
        (Op::Xor, Type::I32) => int::<T, ops::xor>(second, side)?,
        (Op::Shl, Type::I32) => int::<T, ops::shl>(second, side)?,
        (Op::LShr, Type::I32) => match second {
            Op::UToF => T::handler::<BinaryUnary<ops::lshr, ops::uto_f>>(),
            _ => int::<T, ops::lshr>(second, side)?,
        },
        (Op::UToF, Type::F32) if *second == Op::FMul => {
            T::handler::<UnaryBinary<ops::uto_f, ops::fmul>>()
        }
        (Op::UConvert, Type::I8) => match second {
            Op::UToF => T::handler::<ByteToFloat<ops::uto_f>>(),
            Op::SToF => T::handler::<ByteToFloat<ops::sto_f>>(),
            _ => return None,
        },
        _ => return None,
    })
}

fn float<T: Tier, O: Binary<f32, f32, f32> + 'static>(second: &Op, side: Side) -> Option<Handler> {
    Some(seconds!(T, O, f32, second, side; FSub fsub; FAdd fadd, FMul fmul; FMin fmin, FMax fmax))
}

fn int<T: Tier, O: Binary<u32, u32, u32> + 'static>(second: &Op, side: Side) -> Option<Handler> {
    Some(
        seconds!(T, O, u32, second, side; ISub isub; IAdd iadd, IMul imul, And and, Or or, Xor xor; Shl shl, LShr lshr),
    )
}

/// `second(first(a, b), c)`.
struct Pair<O1, O2, X>(PhantomData<(O1, O2, X)>);
/// `second(c, first(a, b))`.
struct PairRight<O1, O2, X>(PhantomData<(O1, O2, X)>);
/// `second(first(a, b))`.
struct BinaryUnary<O1, O2>(PhantomData<(O1, O2)>);
/// `second(first(a), c)`.
struct UnaryBinary<O1, O2>(PhantomData<(O1, O2)>);
/// `second(uconvert(a))` by way of a byte.
struct ByteToFloat<O>(PhantomData<O>);

/// A function of three words over the lanes of each subgroup: of `a`, `b` and `c`, or of two of
/// them twice.
macro_rules! kernel {
    ([$($generic:tt)*] $kernel:ty, $x:ty, $($operand:ident $var:ident: $slot:ty),*; $value:expr) => {
        impl<$($generic)*> Kernel for $kernel {
            #[inline(always)]
            unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
                // SAFETY: rows are the program's; a block is read before it is written, so that
                // in-place is sound.
                unsafe {
                    let d = m.row(i.d);
                    $(let $operand = m.row(i.$operand);)*
                    let (runs, count) = m.runs();
                    for &subgroup in runs {
                        $(let mut $operand = Blocks::<<$slot as Lane>::Slot>::new($operand, subgroup);)*
                        let mut d = Blocks::<<$x as Lane>::Slot>::new(d, subgroup);
                        for _ in 0..count {
                            $(let $var = *$operand.at;)*
                            let mut r = [<$x as Lane>::Slot::default(); SUBGROUP_SIZE];
                            for k in 0..SUBGROUP_SIZE {
                                $(let $var = <$slot as Lane>::read($var[k]);)*
                                r[k] = Lane::write($value);
                            }
                            *d.at = r;
                            $($operand.go_on();)*
                            d.go_on();
                        }
                    }
                }
            }
        }
    };
}
kernel!([O1: Binary<X, X, X>, O2: Binary<X, X, X>, X: Lane] Pair<O1, O2, X>, X, a x: X, b y: X, c z: X; O2::call(O1::call(x, y), z));
kernel!([O1: Binary<X, X, X>, O2: Binary<X, X, X>, X: Lane] PairRight<O1, O2, X>, X, a x: X, b y: X, c z: X; O2::call(z, O1::call(x, y)));
kernel!([O1: Binary<u32, u32, u32>, O2: Unary<u32, f32>] BinaryUnary<O1, O2>, f32, a x: u32, b y: u32; O2::call(O1::call(x, y)));
kernel!([O: Unary<u8, f32>] ByteToFloat<O>, f32, a x: u32; O::call(<ops::uconvert as Unary<u32, u8>>::call(x)));
kernel!([O1: Unary<u32, f32>, O2: Binary<f32, f32, f32>] UnaryBinary<O1, O2>, f32, a x: u32, c z: f32; O2::call(O1::call(x), z));
