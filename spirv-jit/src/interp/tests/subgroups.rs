//! Operations across the lanes of a subgroup, in every tier, against their definition in `eval`.

use std::fmt::Write;

use lanes::LaneMask;

use super::kernels::{Scalar, make};
use super::numbers::Random;
use super::{Bench, on_tiers};
use crate::SUBGROUP_SIZE;
use crate::eval::subgroup::{self, Combination, Lanes};
use crate::eval::{self, Int, f16};
use crate::ir::Type;

/// A program that performs an operation in lanes whose input 3 is not zero: on a scalar from inputs
/// 0 and 1, and on input 2 if the operation has two operands.
fn program(op: &str, from: Type, takes_lanes: bool, to: Type) -> String {
    let mut text = String::from(
        "module closest_hit
        inputs payload.0, payload.1, payload.2, payload.3
        output_rows 2
        func f0 {\n",
    );
    let mut next = 0;
    let scalar = make(&mut text, &mut next, from, 0);
    let operands = match () {
        _ if op == "elect" => String::new(),
        _ if takes_lanes => format!("v{scalar}, v100"),
        _ => format!("v{scalar}"),
    };
    let bits = match to {
        Type::I32 => "v106: i32 = iadd v105, v102",
        Type::F32 => "v106: i32 = bitcast v105",
        Type::I1 => "v106: i32 = select v105, v107, v102",
        Type::I8 | Type::I16 => "v106: i32 = uconvert v105",
        Type::F16 => "v108: i16 = bitcast v105\nv106: i32 = uconvert v108",
        Type::I64 | Type::F64 => "v106: i32, v109: i32 = unpack64 v105",
        Type::Descriptor => unreachable!("no operand of these operations"),
    };
    let high = if to.rows() == 2 { "v109" } else { "v102" };
    writeln!(
        text,
        "v100: i32 = input[2]
        v101: i32 = input[3]
        v102: i32 = const 0
        v107: i32 = const 1
        v103: i1 = ine v101, v102
        if v103, L0 -> (v110: i32, v111: i32) {{
            v105: {to} = subgroup.{op} {operands}
            {bits}
            br L0(v106, {high})
        }} else {{
            br L0(v102, v102)
        }}
        end(v110, v111)
        }}"
    )
    .unwrap();
    text
}

impl Random {
    /// Scalars of a type: two different ones, moderate ones whose sums round, or corner cases and
    /// random bits.
    fn scalars(&mut self, ty: Type) -> Lanes<u64> {
        let kind = self.below(3);
        let few = [self.next(), self.next()];
        std::array::from_fn(|_| {
            let random = self.next();
            let number = (random as i32) as f64 / f64::from(1 << 24);
            let corners = [
                0.0,
                -0.0,
                f64::INFINITY,
                f64::NEG_INFINITY,
                f64::NAN,
                1e-310,
                1e-41,
            ];
            let number = match kind {
                0 => return few[self.below(2) as usize],
                1 => number,
                _ => match self.below(2 * corners.len() as u64) as usize {
                    k if k < corners.len() => corners[k],
                    _ => return random,
                },
            };
            match ty {
                Type::F16 => f16::from_f64(number).to_bits().into(),
                Type::F32 => (number as f32).to_bits().into(),
                Type::F64 => number.to_bits(),
                _ => random,
            }
        })
    }

    /// The second operand: numbers of lanes, some past the last; or disjoint parts, one bit for
    /// each lane of the part.
    fn lanes(&mut self, are_parts: bool) -> Lanes<u32> {
        if are_parts {
            let parts: Lanes<u64> = std::array::from_fn(|_| self.below(4));
            let part = |lane: usize| LaneMask::from_fn(|other| parts[other] == parts[lane]);
            return std::array::from_fn(|lane| part(lane).bits().into());
        }
        std::array::from_fn(|_| match self.below(20) {
            0 => [16, 17, 31, 32, 33, u32::MAX][self.below(6) as usize],
            _ => self.below(16) as u32,
        })
    }

    fn active(&mut self) -> LaneMask {
        match self.below(4) {
            0 => LaneMask::ALL,
            1 => LaneMask::of(self.below(16) as usize),
            _ => LaneMask::from_bits(1 + self.below(u16::MAX.into()) as u16),
        }
    }
}

/// Runs an operation in every tier and compares active lanes with what `reference` gives, NaN
/// payloads aside.
fn check<T: Scalar, R: Scalar>(
    op: &str,
    lanes: Option<bool>,
    reference: impl Fn(&Lanes<T>, &Lanes<u32>, LaneMask) -> Lanes<R>,
) {
    check_with(op, lanes, &reference);
}

/// Lanes' expected results.
type Reference<'r, T, R> = &'r dyn Fn(&Lanes<T>, &Lanes<u32>, LaneMask) -> Lanes<R>;

/// [`check`], compiled once for types.
fn check_with<T: Scalar, R: Scalar>(op: &str, lanes: Option<bool>, reference: Reference<'_, T, R>) {
    const SUBGROUPS: usize = 5;
    let text = program(op, T::TYPE, lanes.is_some(), R::TYPE);
    let is_nan = |bits: u64| match R::TYPE {
        Type::F16 => f16::from_bits(bits as u16).is_nan(),
        Type::F32 => f32::from_bits(bits as u32).is_nan(),
        Type::F64 => f64::from_bits(bits).is_nan(),
        _ => false,
    };
    on_tiers(|tier| {
        let mut random = Random(3);
        let mut bench = Bench::new(&text, tier, SUBGROUPS);
        for _ in 0..8 {
            for state in &mut bench.states {
                bench.program.start(state, LaneMask::ALL);
            }
            let scalars: [_; SUBGROUPS] = std::array::from_fn(|_| random.scalars(T::TYPE));
            let taken: [_; SUBGROUPS] = std::array::from_fn(|_| random.lanes(lanes == Some(true)));
            let active: [_; SUBGROUPS] = std::array::from_fn(|_| random.active());
            bench.input(0, |lane| scalars[lane / 16][lane % 16] as u32);
            bench.input(1, |lane| (scalars[lane / 16][lane % 16] >> 32) as u32);
            bench.input(2, |lane| taken[lane / 16][lane % 16]);
            bench.input(3, |lane| active[lane / 16].contains(lane % 16).into());
            bench.run_to_end();
            let (low, high) = (bench.io(0), bench.io(1));
            for s in 0..SUBGROUPS {
                let typed = scalars[s].map(T::of);
                let expected = reference(&typed, &taken[s], active[s]).map(R::bits);
                for k in active[s] {
                    let at = s * SUBGROUP_SIZE + k;
                    let given = low[at] as u64 | (high[at] as u64) << 32;
                    assert!(
                        given == expected[k] || is_nan(given) && is_nan(expected[k]),
                        "{tier:?} {op} {} of {:x?} in {:?}, lane {k}: {given:x}, not {:x}",
                        T::TYPE,
                        scalars[s],
                        active[s],
                        expected[k]
                    );
                }
            }
        }
    });
}

/// All reductions and scans by an operation on a type.
fn combinations<T: Scalar>(name: &str, combine: fn(T, T) -> T, identity: T) {
    let of = Combination { combine, identity };
    for cluster in [1, 2, 4, 8, 16] {
        check::<T, T>(
            &format!("reduce[{name}, {cluster}]"),
            None,
            |a, _, active| of.reduce(a, active, cluster),
        );
    }
    check::<T, T>(&format!("inclusive_scan[{name}]"), None, |a, _, active| {
        of.inclusive_scan(a, active)
    });
    check::<T, T>(&format!("exclusive_scan[{name}]"), None, |a, _, active| {
        of.exclusive_scan(a, active)
    });
    let parts = Some(true);
    check::<T, T>(
        &format!("partitioned_reduce[{name}]"),
        parts,
        |a, b, active| of.partitioned(a, b, active, |_| LaneMask::ALL),
    );
    check::<T, T>(
        &format!("partitioned_inclusive_scan[{name}]"),
        parts,
        |a, b, active| of.partitioned(a, b, active, |lane| LaneMask::full(lane + 1)),
    );
    check::<T, T>(
        &format!("partitioned_exclusive_scan[{name}]"),
        parts,
        |a, b, active| of.partitioned(a, b, active, LaneMask::full),
    );
}

#[test]
fn integers_combine() {
    macro_rules! of_types {
        ($($t:ty)*) => {$(
            combinations::<$t>("iadd", eval::iadd, 0);
            combinations::<$t>("imul", eval::imul, 1);
            combinations::<$t>("smin", eval::smin, <$t>::MAX >> 1);
            combinations::<$t>("umin", eval::umin, <$t>::MAX);
            combinations::<$t>("smax", eval::smax, 1 << (<$t as Int>::BITS - 1));
            combinations::<$t>("umax", eval::umax, 0);
            combinations::<$t>("and", eval::and, <$t>::MAX);
            combinations::<$t>("or", eval::or, 0);
            combinations::<$t>("xor", eval::xor, 0);
        )*};
    }
    of_types!(u8 u16 u32 u64);
    combinations::<bool>("and", eval::and, true);
    combinations::<bool>("or", eval::or, false);
    combinations::<bool>("xor", eval::xor, false);
}

#[test]
fn floats_combine_in_the_order_of_lanes() {
    macro_rules! of_types {
        ($($t:ty: $zero:expr, $one:expr, $infinity:expr;)*) => {$(
            combinations::<$t>("fadd", eval::fadd, -$zero);
            combinations::<$t>("fmul", eval::fmul, $one);
            combinations::<$t>("fmin", eval::fmin, $infinity);
            combinations::<$t>("fmax", eval::fmax, -$infinity);
        )*};
    }
    of_types! {
        f16: f16::ZERO, f16::ONE, f16::INFINITY;
        f32: 0.0, 1.0, f32::INFINITY;
        f64: 0.0, 1.0, f64::INFINITY;
    }
}

#[test]
fn lanes_vote() {
    check::<u32, bool>("elect", None, |_, _, active| subgroup::elect(active));
    check::<bool, bool>("all", None, |a, _, active| {
        [subgroup::all(a, active); SUBGROUP_SIZE]
    });
    check::<bool, bool>("any", None, |a, _, active| {
        [subgroup::any(a, active); SUBGROUP_SIZE]
    });
    check::<bool, u32>("ballot", None, |a, _, active| {
        [subgroup::ballot(a, active); SUBGROUP_SIZE]
    });
    macro_rules! equal {
        ($($t:ty: $equal:ident;)*) => {$(
            check::<$t, bool>("all_equal", None, |a, _, active| {
                [subgroup::all_equal(a, active, eval::$equal); SUBGROUP_SIZE]
            });
        )*};
    }
    equal! {
        bool: ieq; u8: ieq; u16: ieq; u32: ieq; u64: ieq;
        f16: foeq; f32: foeq; f64: foeq;
    }
    check::<u8, u32>("match", None, |a, _, active| subgroup::matching(a, active));
    check::<u32, u32>("match", None, |a, _, active| subgroup::matching(a, active));
    check::<u64, u32>("match", None, |a, _, active| subgroup::matching(a, active));
}

#[test]
fn lanes_take_from_others() {
    macro_rules! of_types {
        ($($t:ty)*) => {$(
            check::<$t, $t>("shuffle", Some(false), |a, b, _| subgroup::shuffle(a, b));
            check::<$t, $t>("quad_shuffle", Some(false), subgroup::quad_shuffle);
            check::<$t, $t>("broadcast_first", None, |a, _, active| {
                [subgroup::broadcast_first(a, active); SUBGROUP_SIZE]
            });
        )*};
    }
    of_types!(u8 u16 u32 u64 f16 f32 f64);
}
