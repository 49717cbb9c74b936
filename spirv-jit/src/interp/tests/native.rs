//! Native code against the interpreter: straight programs on every tier, as native code and
//! interpreted, give what the interpreter gives on the portable one.

mod chains;
mod listed;
mod loops;
mod random;
mod refused;

use std::fmt::Write;

use lanes::{LaneMask, Tier as TierKind};

use super::Bench;
use crate::environment::Descriptor;
use crate::eval::f16;
use crate::ir::text::parse_module;
use crate::ir::verify::verify;
use crate::ir::{Module, Type};
use crate::program::Program;
use crate::state::Event;

/// A word of an input row; those of floats have exponents of all kinds, and special ones.
fn word(seed: u64, row: usize, lane: usize) -> u32 {
    const SPECIAL: [u32; 24] = [
        0,
        1,
        2,
        7,
        8,
        31,
        32,
        33,
        64,
        u32::MAX,
        i32::MAX as u32,
        0x8000_0000,
        0x7f80_0000,
        0xff80_0000,
        // Quiet and signalling.
        0x7fc0_0000,
        0xffc1_2345,
        0x7f80_0001,
        0xffa0_0000,
        // Denormal, least normal, greatest.
        0x8000_0123,
        0x007f_ffff,
        0x0080_0000,
        0x7f7f_ffff,
        // Where conversions to integers end.
        0x4f00_0000,
        0x4f80_0000,
    ];
    let mut x = seed ^ (row as u64) << 40 ^ (lane as u64) << 20;
    x = (x ^ x >> 30).wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^= x >> 31;
    match x >> 61 {
        0..2 => SPECIAL[x as usize % SPECIAL.len()],
        // Halves, in both halves of a word.
        2 => {
            const HALVES: [u16; 8] = [
                0x8000, 0x7c00, 0xfc00, 0x7e00, 0x7d01, 0x0001, 0x83ff, 0x7bff,
            ];
            HALVES[x as usize % 8] as u32 | (HALVES[x as usize / 8 % 8] as u32) << 16
        }
        3 => x as u32 % 70,
        4..6 => ((x as u32 >> 8) as f32 / 1e4 - 700.0).to_bits(),
        _ => x as u32,
    }
}

/// Memory of programs that load: no multiple of any scalar's size.
fn memory() -> Descriptor {
    static BYTES: [u8; 203] = {
        let mut bytes = [0; 203];
        let mut k = 0;
        while k < bytes.len() {
            bytes[k] = (k * 37 + k * k / 5) as u8;
            k += 1;
        }
        bytes
    };
    Descriptor {
        address: BYTES.as_ptr() as u64,
        size_bytes: BYTES.len() as u64,
        ..Descriptor::NULL
    }
}

/// The lanes with which a subgroup starts: all, some, or those of one half.
fn lanes_of(seed: u64, subgroup: usize) -> LaneMask {
    let some = word(!seed, 99, subgroup) as u16;
    let lanes = match (seed / 3) % 4 {
        0 => some & 0xff00 | 0x1000,
        1 => some & 0x00ff | 0x0001,
        2 => some | 0x0010,
        _ => u16::MAX,
    };
    (0..16).filter(|lane| lanes >> lane & 1 != 0).collect()
}

/// The results of a program in each active lane, by output row; zero in others.
type Outputs = Vec<Vec<u32>>;

fn run(program: Program, seed: u64, subgroups: usize) -> Outputs {
    let subgroups = subgroups.min(program.max_wave_subgroups());
    let mut bench = Bench::of(program, subgroups);
    bench.environment.push_constants = memory();
    for (s, state) in bench.states.iter_mut().enumerate() {
        bench.program.start(state, lanes_of(seed, s));
    }
    for (k, word) in bench.shared.iter_mut().enumerate() {
        *word = (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    for row in 0..bench.program.inputs().len() {
        bench.input(row, |lane| word(seed, row, lane));
    }
    // Some are suspended now and then.
    let fuel = [1_000_000, 1, 3][seed as usize % 3];
    while bench.run(&mut fuel.clone()) == Event::OutOfFuel {}
    let rows = 0..bench.program.output_rows() as usize;
    let active = |lane: usize| lanes_of(seed, lane / 16).contains(lane % 16);
    let shown = |(lane, word)| if active(lane) { word } else { 0 };
    rows.map(|row| bench.io(row).into_iter().enumerate().map(shown).collect())
        .collect()
}

/// NaN payloads aside, in output rows that are floats.
fn assert_alike(given: &Outputs, expected: &Outputs, floats: &[bool], what: impl Fn() -> String) {
    for (row, (given, expected)) in given.iter().zip(expected).enumerate() {
        for (lane, (&a, &b)) in given.iter().zip(expected).enumerate() {
            let is_nan = |word: u32| f32::from_bits(word).is_nan();
            assert!(
                a == b || floats[row] && is_nan(a) && is_nan(b),
                "lane {lane} of output {row}: {a:#x} instead of {b:#x}, {}",
                what()
            );
        }
    }
}

const WAVES: [usize; 5] = [16, 1, 2, 3, 7];

/// Runs a program in all ways; true if it has native code wherever there is such.
fn agrees(module: &Module, floats: &[bool], seed: u64, text: &str) -> bool {
    let portable = Program::with_tier_interpreted(module, TierKind::Portable).unwrap();
    let expected = run(portable, seed, WAVES[0]);
    let mut is_native = true;
    for &tier in TierKind::available() {
        for interpreted in [false, true] {
            for subgroups in WAVES {
                let program = match interpreted {
                    true => Program::with_tier_interpreted(module, tier),
                    false => Program::with_tier(module, tier),
                }
                .unwrap();
                let has_native_code = program.has_native_code();
                assert!(!has_native_code || !interpreted && tier != TierKind::Portable);
                is_native &= has_native_code || interpreted || tier == TierKind::Portable;
                let given = run(program, seed, subgroups);
                assert_alike(&given, &expected, floats, || {
                    format!(
                        "{tier:?}, interpreted {interpreted}, {subgroups} subgroups, seed {seed}:\n{text}"
                    )
                });
            }
        }
    }
    is_native
}

/// Text of a straight program that is being written.
struct Writer {
    text: String,
    next: u32,
}

impl Writer {
    fn new(inputs: usize, outputs: usize) -> Writer {
        let rows: Vec<String> = (0..inputs).map(|k| format!("payload.{k}")).collect();
        let text = format!(
            "module closest_hit\ninputs {}\noutput_rows {outputs}\nfunc f0 {{\n",
            rows.join(", ")
        );
        Writer { text, next: 0 }
    }

    /// Writes an operation; its result's name.
    fn line(&mut self, ty: Type, operation: &str) -> String {
        let name = format!("v{}", self.next);
        self.next += 1;
        writeln!(self.text, "{name}: {ty} = {operation}").unwrap();
        name
    }

    fn op(&mut self, ty: Type, name: &str, operands: &[&String]) -> String {
        let operands: Vec<&str> = operands.iter().map(|operand| operand.as_str()).collect();
        self.line(ty, &format!("{name} {}", operands.join(", ")))
    }

    fn constant(&mut self, ty: Type, bits: u64) -> String {
        match ty.is_float() {
            true => self.line(ty, &format!("const {bits:#x}")),
            false => self.line(ty, &format!("const {bits}")),
        }
    }

    /// The two words of a value of 64 bits.
    fn words(&mut self, wide: &String) -> [String; 2] {
        let [low, high] = [0, 1].map(|k| format!("v{}", self.next + k));
        self.next += 2;
        writeln!(self.text, "{low}: i32, {high}: i32 = unpack64 {wide}").unwrap();
        [low, high]
    }

    /// The bits of a float as an integer of its width; 0 for NaN, whose payload nothing says.
    fn bits(&mut self, ty: Type, float: &String) -> String {
        let integer = ty.as_integer();
        let is_nan = self.op(Type::I1, "fis_nan", &[float]);
        let bits = self.op(integer, "bitcast", &[float]);
        let zero = self.constant(integer, 0);
        self.op(integer, "select", &[&is_nan, &zero, &bits])
    }

    fn end(mut self, outputs: &[String]) -> (Module, String) {
        writeln!(self.text, "end({})\n}}", outputs.join(", ")).unwrap();
        let module = parse_module(&self.text).unwrap_or_else(|e| panic!("{e:?}\n{}", self.text));
        verify(&module).unwrap_or_else(|e| panic!("{e:?}\n{}", self.text));
        (module, self.text)
    }
}

/// Asserts that a program has native code and gives the same in all ways.
fn check(writer: Writer, outputs: &[String], floats: &[bool]) {
    let (module, text) = writer.end(outputs);
    for seed in 0..4 {
        let is_native = agrees(&module, floats, seed, &text);
        let is_possible = TierKind::available().len() > 1;
        assert!(is_native || !is_possible, "no native code:\n{text}");
    }
}

/// More floats live than there are registers in either encoding.
#[test]
fn more_words_than_registers() {
    let mut w = Writer::new(8, 2);
    let inputs: Vec<String> = (0..8)
        .map(|k| w.line(Type::F32, &format!("input[{k}]")))
        .collect();
    let values: Vec<String> = (0..40)
        .map(|k| {
            w.op(
                Type::F32,
                "fmax",
                &[&inputs[k % 8], &inputs[(k / 8 + k + 1) % 8]],
            )
        })
        .collect();
    // Each is used twice, so that none waits for the operation that takes it; first the oldest,
    // then the newest.
    let mut sums = [inputs[0].clone(), inputs[1].clone()];
    for k in 0..40 {
        sums[0] = w.op(
            Type::F32,
            "ffma",
            &[&values[k], &values[(k + 20) % 40], &sums[0]],
        );
    }
    for value in values.iter().rev() {
        sums[1] = w.op(Type::F32, "fadd", &[value, &sums[1]]);
    }
    check(w, &sums, &[true, true]);
}

/// Products and sums in one rounding, with every pattern of operands that are used later or are
/// each other.
#[test]
fn multiply_add_overwrites_none_but_the_dying() {
    for pattern in 0..64u32 {
        for equal in 0..5 {
            let mut w = Writer::new(4, 5);
            let mut v: Vec<String> = (0..4)
                .map(|k| w.line(Type::F32, &format!("input[{k}]")))
                .collect();
            // Some operands are in registers before, some are not.
            for (k, v) in v.iter_mut().enumerate().take(3) {
                if pattern >> k & 1 != 0 {
                    *v = w.op(Type::F32, "fneg", &[v]);
                }
            }
            let [a, b, c] = match equal {
                0 => [0, 1, 2],
                1 => [0, 0, 2],
                2 => [0, 1, 0],
                3 => [0, 1, 1],
                _ => [0, 0, 0],
            };
            let result = w.op(Type::F32, "ffma", &[&v[a], &v[b], &v[c]]);
            let mut outputs = vec![w.op(Type::F32, "fadd", &[&result, &v[3]])];
            for k in 0..3 {
                outputs.push(match pattern >> (3 + k) & 1 {
                    0 => w.constant(Type::F32, 0),
                    _ => w.op(Type::F32, "fmul", &[&v[k], &v[3]]),
                });
            }
            outputs.push(result);
            let (module, text) = w.end(&outputs);
            agrees(&module, &[true; 5], pattern as u64, &text);
        }
    }
}

/// Products with a constant near a power of two, on either side.
#[test]
fn factors_near_powers_of_two() {
    for (ty, bits) in [
        (Type::I8, 8),
        (Type::I16, 16),
        (Type::I32, 32),
        (Type::I64, 64u32),
    ] {
        let all = u64::MAX >> (64 - bits);
        for power in (0..bits).map(|k| 1u64 << k).chain([0]) {
            let mut w = Writer::new(2, 4);
            let [x, y] = [0, 1].map(|k| w.line(Type::I32, &format!("input[{k}]")));
            let x = match ty {
                Type::I32 => x,
                Type::I64 => w.op(ty, "pack64", &[&x, &y]),
                _ => w.op(ty, "uconvert", &[&x]),
            };
            let [below, above] = [power.wrapping_sub(1), power + 1].map(|c| c & all);
            let [below, above] = [below, above].map(|factor| w.constant(ty, factor));
            let products = [
                w.op(ty, "imul", &[&x, &below]),
                w.op(ty, "imul", &[&above, &x]),
            ];
            let outputs: Vec<String> = (products.iter())
                .flat_map(|product| match ty {
                    Type::I64 => w.words(product).to_vec(),
                    Type::I32 => vec![product.clone()],
                    _ => vec![w.op(Type::I32, "uconvert", &[product])],
                })
                .collect();
            let zero = w.constant(Type::I32, 0);
            let mut outputs = outputs;
            outputs.resize(4, zero);
            check(w, &outputs, &[false; 4]);
        }
    }
}

/// More conditions live than there are mask registers.
#[test]
fn more_conditions_than_registers() {
    let mut w = Writer::new(6, 2);
    let words: Vec<String> = (0..6)
        .map(|k| w.line(Type::I32, &format!("input[{k}]")))
        .collect();
    let floats: Vec<String> = words
        .iter()
        .map(|word| w.op(Type::F32, "bitcast", &[word]))
        .collect();
    let conditions: Vec<String> = (0..12)
        .map(|k| {
            let (a, b) = (k % 6, (k / 6 + k + 1) % 6);
            match k % 4 {
                0 => w.op(Type::I1, "slt", &[&words[a], &words[b]]),
                1 => w.op(Type::I1, "fule", &[&floats[a], &floats[b]]),
                2 => w.op(Type::I1, "ule", &[&words[a], &words[b]]),
                _ => w.op(Type::I1, "folt", &[&floats[a], &floats[b]]),
            }
        })
        .collect();
    let mut all = conditions[11].clone();
    for (k, condition) in conditions.iter().enumerate() {
        let name = ["xor", "and", "or", "ieq", "ine"][k % 5];
        all = w.op(Type::I1, name, &[condition, &all]);
    }
    let mut chosen = words[0].clone();
    for (k, condition) in conditions.iter().enumerate() {
        chosen = w.op(Type::I32, "select", &[condition, &words[k % 6], &chosen]);
        chosen = w.op(Type::I32, "iadd", &[&chosen, &words[(k + 1) % 6]]);
    }
    for k in 0..6 {
        let (a, b) = (&conditions[k], &conditions[11 - k]);
        all = w.op(Type::I1, "select", &[&all, a, b]);
    }
    let last = w.op(Type::I32, "select", &[&all, &words[0], &words[1]]);
    check(w, &[chosen, last], &[false, false]);
}

/// Lanes of 64 bits take two registers each; halves, words and conditions among them.
#[test]
fn more_wide_values_than_registers() {
    let mut w = Writer::new(8, 4);
    let words: Vec<String> = (0..8)
        .map(|k| w.line(Type::I32, &format!("input[{k}]")))
        .collect();
    let wide: Vec<String> = (0..18)
        .map(|k| match k % 3 {
            0 => w.op(Type::I64, "pack64", &[&words[k % 8], &words[(k + 3) % 8]]),
            1 => w.op(Type::I64, "sconvert", &[&words[k % 8]]),
            _ => w.op(Type::I64, "uconvert", &[&words[k % 8]]),
        })
        .collect();
    let narrow: Vec<String> = words
        .iter()
        .map(|word| w.op(Type::I16, "uconvert", &[word]))
        .collect();
    let count = w.constant(Type::I64, 13);
    let mut sums = [wide[0].clone(), wide[1].clone()];
    for k in 0..18 {
        sums[0] = w.op(Type::I64, "iadd", &[&wide[k], &sums[0]]);
        sums[0] = w.op(Type::I64, "xor", &[&wide[(k + 9) % 18], &sums[0]]);
        let shifted = w.op(Type::I64, ["shl", "lshr"][k % 2], &[&wide[17 - k], &count]);
        sums[1] = w.op(Type::I64, "isub", &[&shifted, &sums[1]]);
    }
    let mut small = narrow[0].clone();
    for (k, value) in narrow.iter().enumerate() {
        small = w.op(Type::I16, ["imul", "isub", "iadd"][k % 3], &[value, &small]);
    }
    let small = w.op(Type::I32, "sconvert", &[&small]);
    let [a, b] = w.words(&sums[0]);
    let [c, d] = w.words(&sums[1]);
    let d = w.op(Type::I32, "xor", &[&d, &small]);
    check(w, &[a, b, c, d], &[false; 4]);
}

/// Copies at branches change active lanes alone: words, conditions and floats out of both sides of
/// an `if`, some of them where the other side has them; parameters of a loop that change places,
/// and one that follows another; an early way out of a block.
#[test]
fn branches_copy_in_active_lanes() {
    let text = "module closest_hit
        inputs payload.0, payload.1, payload.2
        output_rows 6
        func f0 {
            v0: i32 = input[0]
            v1: i32 = input[1]
            v2: f32 = input[2]
            v3: i32 = const 7
            v4: i32 = and v0, v3
            v5: i1 = ult v4, v1
            v6: i32 = const 1
            v7: i32 = const 0
            if v5, L0 -> (v8: i32, v9: f32, v10: i1, v11: i32) {
                v12: i32 = iadd v0, v1
                v13: f32 = fadd v2, v2
                v14: i1 = ult v12, v0
                br L0(v12, v13, v14, v3)
            } else {
                v15: i32 = isub v1, v0
                v16: f32 = fneg v2
                v17: i1 = ule v15, v0
                br L0(v15, v16, v17, v1)
            }
            block L1 -> (v18: i32, v19: i32, v20: i32, v21: i1) {
                loop L2 (v22: i32, v23: i32, v24: i32, v25: i32, v26: i1) = (v8, v11, v0, v7, v10) {
                    v27: i32 = iadd v25, v6
                    v28: i1 = ult v4, v27
                    if v28, L3 {
                        br L1(v22, v23, v24, v26)
                    } else {
                        br L3
                    }
                    v29: i32 = xor v22, v25
                    v30: i1 = ult v29, v23
                    br L2(v23, v22, v29, v27, v30)
                }
                unreachable
            }
            v31: i32 = const 4
            v32: i32 = select v21, v31, v20
            v33: i1 = fis_nan v9
            v34: i32 = bitcast v9
            v35: i32 = select v33, v7, v34
            v36: i32 = select v10, v6, v7
            end(v18, v19, v32, v35, v36, v11)
        }";
    let module = parse_module(text).unwrap();
    verify(&module).unwrap();
    for seed in 0..16 {
        let is_native = agrees(&module, &[false; 6], seed, text);
        assert!(is_native || TierKind::available().len() == 1);
    }
}

/// Of one operation nothing becomes native code: the interpreter's is as good.
#[test]
fn one_operation_is_interpreted() {
    let mut w = Writer::new(2, 1);
    let a = w.line(Type::F32, "input[0]");
    let b = w.line(Type::F32, "input[1]");
    let sum = w.op(Type::F32, "fadd", &[&a, &b]);
    let (module, _) = w.end(&[sum]);
    let program = Program::with_tier(&module, TierKind::best()).unwrap();
    assert!(!program.has_native_code());
}

#[test]
fn special_words_are_among_the_inputs() {
    let words: Vec<u32> = (0..4096).map(|lane| word(1, 0, lane)).collect();
    let has = |test: &dyn Fn(u32) -> bool| words.iter().any(|&word| test(word));
    assert!(has(&|w| f32::from_bits(w).is_nan() && w & 1 << 22 == 0));
    assert!(has(&|w| f32::from_bits(w).is_nan() && w & 1 << 22 != 0));
    assert!(has(&|w| f32::from_bits(w).is_infinite()));
    assert!(has(&|w| f32::from_bits(w).is_subnormal()));
    assert!(has(&|w| f16::from_bits(w as u16).is_nan()));
    assert!(has(&|w| (32..64).contains(&w)));
}
