//! Combined instructions of the emitter: fused pairs, and values computed where a branch would copy
//! them to.

use lanes::Tier as TierKind;

use super::super::kernels::{Side, fused};
use super::{Bench, on_tiers, outputs};
use crate::ir::{Op, Type};

/// Bits of all kinds: any, small integers, ordinary floats, special ones.
fn bits(lane: usize, row: usize) -> u32 {
    let any = ((lane * 3 + row) as u32).wrapping_mul(2_654_435_761) ^ 0x5bd1_e995;
    match (lane + row) % 4 {
        0 => any,
        1 => any % 40,
        2 => ((any >> 8) as f32 / 1e4 - 700.0).to_bits(),
        _ => [0, 1 << 31, 0x7f80_0000, 0xff80_0000, 1, 0x7f7f_ffff][any as usize % 6],
    }
}

/// `second(first(v0, v1), v2)`: fused if nothing else uses the first one's result.
fn run(
    tier: TierKind,
    [first, second]: [(&str, Type, usize); 2],
    side: Side,
    also: u32,
) -> Vec<u32> {
    let from = |(_, to, operands): (&str, Type, usize)| if operands == 1 { Type::I32 } else { to };
    let (a, c) = (from(first), second.1);
    let args = match (second.2, side) {
        (1, _) => "v3",
        (_, Side::Left) => "v3, v2",
        (_, Side::Right) => "v2, v3",
    };
    let firsts = if first.2 == 1 { "v0" } else { "v0, v1" };
    let text = format!(
        "module closest_hit
        inputs payload.0, payload.1, payload.2
        output_rows 2
        func f0 {{
            v0: {a} = input[0]
            v1: {a} = input[1]
            v2: {c} = input[2]
            v3: {} = {} {firsts}
            v4: {c} = {} {args}
            end(v4, v{also})
        }}",
        first.1, first.0, second.0,
    );
    let mut bench = Bench::new(&text, tier, 3);
    for row in 0..3 {
        bench.input(row, |lane| bits(lane, row));
    }
    bench.run_to_end();
    bench.io(0)
}

#[test]
fn pairs_are_as_their_parts() {
    let float = [
        (Op::FAdd, "fadd"),
        (Op::FSub, "fsub"),
        (Op::FMul, "fmul"),
        (Op::FMin, "fmin"),
        (Op::FMax, "fmax"),
    ];
    let int = [
        (Op::IAdd, "iadd"),
        (Op::ISub, "isub"),
        (Op::IMul, "imul"),
        (Op::And, "and"),
        (Op::Or, "or"),
        (Op::Xor, "xor"),
        (Op::Shl, "shl"),
        (Op::LShr, "lshr"),
    ];
    let convert = [(Op::UToF, "uto_f")];
    let all = (float.iter().map(|op| (op, Type::F32, 2)))
        .chain(int.iter().map(|op| (op, Type::I32, 2)))
        .chain(convert.iter().map(|op| (op, Type::F32, 1)));
    let mut count = 0;
    for ((first, first_name), ty, first_operands) in all.clone() {
        for ((second, second_name), second_ty, second_operands) in all.clone() {
            for side in [Side::Left, Side::Right] {
                let takes = if second_operands == 1 {
                    Type::I32
                } else {
                    second_ty
                };
                if takes != ty || fused(TierKind::Portable, first, second, side, ty).is_none() {
                    continue;
                }
                count += 1;
                let pair = [
                    (*first_name, ty, first_operands),
                    (*second_name, second_ty, second_operands),
                ];
                let apart = run(TierKind::Portable, pair, side, 3);
                on_tiers(|tier| {
                    for (&a, b) in apart.iter().zip(run(tier, pair, side, 0)) {
                        let is_nan =
                            |word: u32| second_ty == Type::F32 && f32::from_bits(word).is_nan();
                        assert!(
                            a == b || is_nan(a) && is_nan(b),
                            "{first_name} {second_name} {side:?} {tier:?}: {a:x} {b:x}"
                        );
                    }
                });
            }
        }
    }
    assert!(count > 80, "{count}");
}

/// A loop's parameters that take each other's values: neither may be overwritten before both are
/// read.
#[test]
fn parameters_that_are_still_read_keep_their_rows() {
    let text = "module closest_hit
        inputs payload.0
        output_rows 1
        func f0 {
            v0: i32 = input[0]
            v1: i32 = const 1
            v2: i32 = const 0
            block L0 -> (v3: i32) {
                loop L1 (v4: i32, v5: i32, v6: i32) = (v0, v2, v1) {
                    v7: i1 = ieq v4, v2
                    if v7, L2 { br L0(v5) } else { br L2 }
                    v8: i32 = isub v4, v1
                    v9: i32 = iadd v5, v6
                    br L1(v8, v6, v9)
                }
                unreachable
            }
            end(v3)
        }";
    let fibonacci = |n| {
        (0..n)
            .fold((0u32, 1u32), |(a, b), _| (b, a.wrapping_add(b)))
            .0
    };
    for (lane, word) in outputs(text, |lane| lane as u32 % 37)
        .into_iter()
        .enumerate()
    {
        assert_eq!(word, fibonacci(lane as u32 % 37), "lane {lane}");
    }
}
