//! Atomics of whole subgroups against a loop over the lanes: every operation and width, in every
//! kind of memory.

use std::sync::Arc;

use lanes::LaneMask;

use super::numbers::Random;
use super::{Bench, on_tiers};
use crate::environment::{Descriptor, DescriptorSet};
use crate::eval::{self, f16};
use crate::reach::{Range, Reach};

/// Words of memory.
const WORDS: usize = 16;

/// The new contents of a cell, by the names of the operation and the type. Bits are zero-extended.
fn update(op: &str, ty: &str, old: u64, value: u64, comparator: u64) -> u64 {
    macro_rules! of_integers {
        ($t:ty) => {{
            let (a, b) = (old as $t, value as $t);
            let new = match op {
                "load" => a,
                "store" | "exchange" => b,
                "compare_exchange" if a == comparator as $t => b,
                "compare_exchange" => a,
                "iadd" => eval::iadd(a, b),
                "isub" => eval::isub(a, b),
                "smin" => eval::smin(a, b),
                "umin" => eval::umin(a, b),
                "smax" => eval::smax(a, b),
                "umax" => eval::umax(a, b),
                "and" => eval::and(a, b),
                "or" => eval::or(a, b),
                _ => eval::xor(a, b),
            };
            new as u64
        }};
    }
    macro_rules! of_floats {
        ($t:ty, $bits:ty) => {{
            let [a, b] = [old, value].map(|bits| <$t>::from_bits(bits as $bits));
            let new = match op {
                "fadd" => eval::fadd(a, b),
                "fmin" => eval::fmin(a, b),
                _ => eval::fmax(a, b),
            };
            new.to_bits() as u64
        }};
    }
    match ty {
        "i16" => of_integers!(u16),
        "i32" => of_integers!(u32),
        "i64" => of_integers!(u64),
        "f16" => of_floats!(f16, u16),
        "f32" => of_floats!(f32, u32),
        _ => of_floats!(f64, u64),
    }
}

/// Lines that make a value of a type from two words.
fn from_words(to: &str, ty: &str, [low, high]: [&str; 2]) -> String {
    match ty {
        "i32" => format!("{to}: i32 = iadd {low}, v0\n"),
        "f32" => format!("{to}: f32 = bitcast {low}\n"),
        "i16" => format!("{to}: i16 = uconvert {low}\n"),
        "f16" => format!("{to}0: i16 = uconvert {low}\n{to}: f16 = bitcast {to}0\n"),
        _ => format!("{to}: {ty} = pack64 {low}, {high}\n"),
    }
}

/// Lines that make two words from a value of a type.
fn to_words([low, high]: [&str; 2], ty: &str, from: &str) -> String {
    let is_zero = format!("{high}: i32 = const 0\n");
    match ty {
        "i32" => format!("{low}: i32 = iadd {from}, v0\n{is_zero}"),
        "f32" => format!("{low}: i32 = bitcast {from}\n{is_zero}"),
        "i16" => format!("{low}: i32 = uconvert {from}\n{is_zero}"),
        "f16" => format!("{low}0: i16 = bitcast {from}\n{low}: i32 = uconvert {low}0\n{is_zero}"),
        _ => format!("{low}: i32, {high}: i32 = unpack64 {from}\n"),
    }
}

/// A program that performs an atomic in lanes whose input 5 is not zero: at the offset in input 0,
/// with operands in the other inputs.
fn program(op: &str, ty: &str, space: &str, base: u64) -> String {
    let address = match space {
        "shared" => "v10",
        "buffer" => "v1, v10",
        "buffer64" => "v1, v17",
        _ => "v19",
    };
    let operands = match op {
        "load" => "",
        "compare_exchange" => ", v30, v40",
        _ => ", v30",
    };
    let (value, comparator) = (
        from_words("v30", ty, ["v11", "v12"]),
        from_words("v40", ty, ["v13", "v14"]),
    );
    let atomic = match op {
        "store" => format!(
            "atomic.{op}.{space} {address}{operands}\nv50: i32 = const 0\nv51: i32 = const 0\n"
        ),
        _ => format!(
            "v60: {ty} = atomic.{op}.{space} {address}{operands}\n{}",
            to_words(["v50", "v51"], ty, "v60")
        ),
    };
    format!(
        "module compute
        inputs local_invocation_index.0, local_invocation_id.0, local_invocation_id.1, local_invocation_id.2, launch_id.0, launch_id.1
        output_rows 2
        shared {}
        func f0 {{
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v10: i32 = input[0]
            v11: i32 = input[1]
            v12: i32 = input[2]
            v13: i32 = input[3]
            v14: i32 = input[4]
            v15: i32 = input[5]
            v16: i1 = ine v15, v0
            v17: i64 = uconvert v10
            v18: i64 = const {base}
            v19: i64 = iadd v17, v18
            {value}
            {comparator}
            if v16, L0 -> (v20: i32, v21: i32) {{
                {atomic}
                br L0(v50, v51)
            }} else {{
                br L0(v0, v0)
            }}
            end(v20, v21)
        }}",
        4 * WORDS
    )
}

/// Runs an atomic at random offsets, often the same ones, and compares results and memory with
/// those of a loop over the lanes.
fn check(op: &str, ty: &str, size: usize, space: &str) {
    const SUBGROUPS: usize = 3;
    on_tiers(|tier| {
        let mut random = Random(size as u64);
        let mut memory = vec![0u64; WORDS / 2];
        let base = memory.as_mut_ptr() as u64;
        let mut bench = Bench::new(&program(op, ty, space, base), tier, SUBGROUPS);
        let entry = Descriptor {
            address: base,
            size_bytes: 4 * WORDS as u64,
            ..Descriptor::NULL
        };
        bench.environment.sets[0] = DescriptorSet {
            entries: &raw const entry,
            count: 1,
            ..DescriptorSet::NONE
        };
        bench.environment.reach = Arc::new(Reach::new(vec![Range {
            start: base,
            size_bytes: 4 * WORDS as u64,
        }]));
        for round in 0..12 {
            for state in &mut bench.states {
                bench.program.start(state, LaneMask::ALL);
            }
            let places = [1, 2, 4 * WORDS / size + 1][round % 3] as u64;
            let moderate = |random: &mut Random| match ty {
                "f16" => f16::from_f32(random.below(2000) as f32 / 64.0)
                    .to_bits()
                    .into(),
                "f32" => (random.below(1 << 20) as f32 / 640.0).to_bits().into(),
                "f64" => (random.below(1 << 50) as f64 / 640.0).to_bits(),
                _ if op == "compare_exchange" => random.below(3),
                _ => random.next(),
            };
            let lanes: Vec<[u64; 4]> = (0..16 * SUBGROUPS)
                .map(|_| {
                    let mut offset = random.below(places) * size as u64;
                    if round % 4 == 3 && random.below(8) == 0 {
                        offset += 1;
                    }
                    let is_active = round < 3 || random.below(3) > 0;
                    let (value, comparator) = (moderate(&mut random), moderate(&mut random));
                    [offset, value, comparator, is_active.into()]
                })
                .collect();
            let old: Vec<u8> = (0..4 * WORDS / size)
                .flat_map(|_| moderate(&mut random).to_le_bytes()[..size].to_vec())
                .collect();
            let words = || {
                old.chunks_exact(8)
                    .map(|word| u64::from_le_bytes(word.try_into().unwrap()))
            };
            memory
                .iter_mut()
                .zip(words())
                .for_each(|(to, word)| *to = word);
            bench.shared = words().collect();
            bench.input(0, |lane| lanes[lane][0] as u32);
            bench.input(1, |lane| lanes[lane][1] as u32);
            bench.input(2, |lane| (lanes[lane][1] >> 32) as u32);
            bench.input(3, |lane| lanes[lane][2] as u32);
            bench.input(4, |lane| (lanes[lane][2] >> 32) as u32);
            bench.input(5, |lane| lanes[lane][3] as u32);
            bench.run_to_end();

            let mut expected = old.clone();
            let (low, high) = (bench.io(0), bench.io(1));
            for (lane, &[offset, value, comparator, is_active]) in lanes.iter().enumerate() {
                let offset = offset as usize;
                let mut before = 0;
                let is_inside = offset + size <= 4 * WORDS && offset.is_multiple_of(size);
                if is_active != 0 && is_inside {
                    let place = &mut expected[offset..offset + size];
                    let mut word = [0; 8];
                    word[..size].copy_from_slice(place);
                    before = u64::from_le_bytes(word);
                    let new = update(op, ty, before, value, comparator);
                    place.copy_from_slice(&new.to_le_bytes()[..size]);
                }
                let given = low[lane] as u64 | (high[lane] as u64) << 32;
                let wanted = if op == "store" { 0 } else { before };
                assert_eq!(given, wanted, "{tier:?} {op} {ty} {space} lane {lane}");
            }
            let given: Vec<u8> = match space {
                "shared" => bench
                    .shared
                    .iter()
                    .flat_map(|word| word.to_le_bytes())
                    .collect(),
                _ => memory.iter().flat_map(|word| word.to_le_bytes()).collect(),
            };
            assert_eq!(given, expected, "{tier:?} {op} {ty} {space}");
        }
    });
}

#[test]
fn lanes_go_one_after_another() {
    for space in ["buffer", "buffer64", "shared", "global"] {
        for (ty, size) in [("i16", 2), ("i32", 4), ("i64", 8)] {
            for op in [
                "load",
                "store",
                "exchange",
                "compare_exchange",
                "iadd",
                "isub",
            ] {
                check(op, ty, size, space);
            }
            for op in ["smin", "umin", "smax", "umax", "and", "or", "xor"] {
                check(op, ty, size, space);
            }
        }
        for (ty, size) in [("f16", 2), ("f32", 4), ("f64", 8)] {
            for op in ["fadd", "fmin", "fmax"] {
                check(op, ty, size, space);
            }
        }
    }
}
