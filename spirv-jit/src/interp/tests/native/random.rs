//! Random straight programs, of operations that have native code and of some that have none.
//!
//! `TUFF_CASES=N` sets how many are made, `TUFF_SEED=N` the first one's seed.

use fastrand::Rng;

use super::{Writer, agrees};
use crate::ir::{Module, Type};
use crate::program::Program;
use lanes::Tier as TierKind;

use Type::{F16, F32, F64, I1, I8, I16, I32, I64};

const INTEGERS: [Type; 4] = [I8, I16, I32, I64];
const ALL: [Type; 8] = [I1, I8, I16, I32, I64, F16, F32, F64];

/// Of integers. The last ones of each list have no native code for any type.
const INT_UNARY: &[&str] = &["not", "ineg", "iabs", "bit_count", "isign"];
const COUNTS: &[&str] = &["bit_count", "find_lsb", "find_umsb", "find_smsb"];
const INT_BINARY: &[&str] = &[
    "iadd", "isub", "imul", "and", "or", "xor", "shl", "lshr", "ashr", "smin", "smax", "umin",
    "umax", "umul_hi", "udiv",
];
const INT_COMPARE: &[&str] = &["ieq", "ine", "ult", "ule", "slt", "sle"];
const LOGIC: &[&str] = &["and", "or", "xor", "ieq", "ine"];
/// Combining operations of subgroups.
const REDUCTIONS: &[&str] = &[
    "iadd", "imul", "smin", "umin", "smax", "umax", "and", "or", "xor",
];
const FLOAT_UNARY: &[&str] = &[
    "fneg",
    "fabs",
    "fsqrt",
    "finverse_sqrt",
    "fround_even",
    "ffloor",
    "fceil",
    "ftrunc",
    "ffract",
    "fsign",
    "fround",
];
const FLOAT_BINARY: &[&str] = &["fadd", "fsub", "fmul", "fdiv", "fmin", "fmax"];
const FLOAT_COMPARE: &[&str] = &[
    "foeq", "fone", "folt", "fole", "fueq", "fune", "fult", "fule",
];
const FLOAT_TEST: &[&str] = &["fis_nan", "fis_inf"];

/// The descriptor of the memory that is there to load from.
const MEMORY: &str = "v0";

/// The types of scalars in private variables of [`VARIABLE_ROWS`] rows each.
const VARIABLES: [Type; 4] = [I32, F32, I16, I64];
const VARIABLE_ROWS: usize = 10;
const SHARED_BYTES: usize = 236;
/// Inputs of a stage with workgroup memory.
const WORKGROUP_INPUTS: [&str; INPUTS] = [
    "global_invocation_id.0",
    "global_invocation_id.1",
    "global_invocation_id.2",
    "local_invocation_id.0",
    "local_invocation_id.1",
    "local_invocation_id.2",
    "local_invocation_index.0",
];

const INPUTS: usize = 7;
const OUTPUTS: usize = 8;

struct Maker {
    random: Rng,
    w: Writer,
    values: Vec<(Type, String)>,
    /// How far back operands come from, at most: few values live at once, or many.
    reach: usize,
    /// Words and floats alone, and operations that have native code.
    is_plain: bool,
    /// Loops have operations across lanes, and count bits.
    is_across: bool,
    /// Loops access private memory and workgroup memory.
    is_private: bool,
    /// Loads of loops are from places that depend on lanes' numbers.
    is_spaced: bool,
    is_counted: bool,
}

/// The last operations of a list left out, which have no native code.
fn plain<'l>(list: &'l [&'l str], is_plain: bool) -> &'l [&'l str] {
    &list[..list.len() - if is_plain { 2 } else { 0 }]
}

impl Maker {
    fn new(seed: u64) -> Self {
        let mut random = Rng::with_seed(seed);
        let reach = [4, 12, 1000][random.usize(..3)];
        Self {
            random,
            w: Writer::new(INPUTS, OUTPUTS),
            values: Vec::new(),
            reach,
            is_plain: false,
            is_across: false,
            is_private: false,
            is_spaced: false,
            is_counted: false,
        }
    }

    fn choose<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.random.usize(..list.len())]
    }

    fn show(&mut self, ty: Type, name: String) {
        self.values.push((ty, name));
    }

    /// An operand: a value, now and then a constant.
    fn pick(&mut self, ty: Type) -> String {
        let first = self.values.len().saturating_sub(self.reach);
        let near: Vec<&String> = (self.values[first..].iter())
            .filter(|(other, _)| *other == ty)
            .map(|(_, name)| name)
            .collect();
        if !near.is_empty() && self.random.u32(..5) != 0 {
            return near[self.random.usize(..near.len())].clone();
        }
        let any = self.values.iter().rev().find(|(other, _)| *other == ty);
        match any {
            Some((_, name)) if self.random.u32(..3) == 0 => name.clone(),
            _ => self.constant(ty),
        }
    }

    fn constant(&mut self, ty: Type) -> String {
        let any = self.random.u64(..);
        let mask = u64::MAX >> (64 - ty.bits());
        let bits = match (ty, self.random.u32(..4)) {
            (F32, 0) => self.choose(&[0, 1 << 31, 0x7f80_0000, 0xff80_0000, 0x7fc0_0000, 1]),
            (F32, 1..3) => ((any % 1000) as f32 / 8.0 - 60.0).to_bits() as u64,
            (F64, 0..3) => ((any % 1000) as f64 / 8.0 - 60.0).to_bits(),
            (F16, 0..3) => self.choose(&[0, 0x8000, 0x3c00, 0xbc00, 0x7c00, 0x7e00, 1, 0x4900]),
            (_, 0) => any % 70,
            (_, 1) => mask >> (any % 3),
            _ => any,
        };
        self.w.constant(ty, bits & mask)
    }

    fn emit(&mut self, to: Type, name: &str, from: &[Type]) {
        let operands: Vec<String> = from.iter().map(|&ty| self.pick(ty)).collect();
        let operands: Vec<&String> = operands.iter().collect();
        let result = self.w.op(to, name, &operands);
        self.show(to, result);
    }

    fn operation(&mut self) {
        let is_plain = self.is_plain;
        // Half of them are of the types that have most native code.
        let int = match is_plain || self.random.bool() {
            true => I32,
            false => self.choose(&INTEGERS),
        };
        let is_half = self.random.u32(..5) == 0 && !is_plain;
        let float = match self.random.u32(..5) {
            _ if is_half => F16,
            0 if !is_plain => F64,
            _ => F32,
        };
        match self.random.u32(..20) {
            0..5 => {
                let name = self.choose(plain(INT_BINARY, is_plain));
                self.emit(int, name, &[int; 2]);
            }
            5 => {
                let name = self.choose(plain(INT_UNARY, is_plain));
                self.emit(int, name, &[int]);
            }
            6 | 7 => {
                let name = self.choose(INT_COMPARE);
                self.emit(I1, name, &[int; 2]);
            }
            8 => {
                let name = self.choose(LOGIC);
                self.emit(I1, name, &[I1; 2]);
            }
            9 if self.random.bool() => self.emit(I1, "not", &[I1]),
            9 => {
                let name = self.choose(FLOAT_TEST);
                self.emit(I1, name, &[float]);
            }
            10..13 if is_plain && self.random.u32(..4) == 0 => {
                let name = self.choose(&FLOAT_BINARY[..4]);
                self.emit(F64, name, &[F64; 2]);
            }
            10..13 => {
                let name = self.choose(FLOAT_BINARY);
                self.emit(float, name, &[float; 2]);
            }
            13 => {
                let name = self.choose(plain(FLOAT_UNARY, is_plain));
                self.emit(float, name, &[float]);
            }
            14 => self.emit(float, "ffma", &[float; 3]),
            15 => {
                let name = self.choose(FLOAT_COMPARE);
                self.emit(I1, name, &[float; 2]);
            }
            16 | 17 => {
                let ty = self.choose(&ALL);
                self.emit(ty, "select", &[I1, ty, ty]);
            }
            _ => self.conversion(int, float),
        }
    }

    fn conversion(&mut self, int: Type, float: Type) {
        match self.random.u32(..8) {
            0 | 1 => {
                let to = match self.is_plain {
                    true => self.choose(&[I32, I64]),
                    false => self.choose(&INTEGERS),
                };
                let name = self.choose(&["uconvert", "sconvert"]);
                // Between equal types, too: a copy.
                self.emit(to, name, &[int]);
            }
            2 => {
                let name = self.choose(&["sto_f", "uto_f"]);
                self.emit(float, name, &[int]);
            }
            3 => {
                let name = self.choose(&["fto_s", "fto_u"]);
                self.emit(int, name, &[float]);
            }
            4 => {
                let (from, to) = self.choose(&[(F16, F32), (F32, F16)]);
                self.emit(to, "fconvert", &[from]);
            }
            5 if self.random.bool() => self.emit(float, "bitcast", &[float.as_integer()]),
            5 => {
                let value = self.pick(float);
                let bits = self.w.bits(float, &value);
                self.show(float.as_integer(), bits);
            }
            6 => self.emit(I64, "pack64", &[I32; 2]),
            _ => {
                let wide = self.pick(I64);
                let [low, high] = self.w.words(&wide);
                self.show(I32, low);
                self.show(I32, high);
            }
        }
    }

    /// Values of all types, from words of the input.
    fn inputs(&mut self) {
        let w = &mut self.w;
        w.text += "v0: descriptor = push_constants\n";
        w.next += 1;
        let words: Vec<String> = (0..INPUTS - 2)
            .map(|k| w.line(I32, &format!("input[{k}]")))
            .collect();
        let floats = [INPUTS - 2, INPUTS - 1].map(|k| w.line(F32, &format!("input[{k}]")));
        let byte = w.op(I8, "uconvert", &[&words[0]]);
        let short = w.op(I16, "uconvert", &[&words[1]]);
        let half = w.op(I16, "uconvert", &[&words[2]]);
        let half = w.op(F16, "bitcast", &[&half]);
        let wide = w.op(I64, "pack64", &[&words[3], &words[4]]);
        let one = w.constant(I32, 1);
        let bit = w.op(I32, "and", &[&words[4], &one]);
        let condition = w.op(I1, "ieq", &[&bit, &one]);
        let made = [
            (I8, byte),
            (I16, short),
            (F16, half),
            (I64, wide),
            (I1, condition),
        ];
        self.values.extend(made);
        self.values
            .extend(words.into_iter().map(|word| (I32, word)));
        self.values.extend(floats.map(|float| (F32, float)));
    }

    /// A value as a word of the output, and whether that is a float's.
    fn output(&mut self, ty: Type, value: &String) -> (String, bool) {
        let w = &mut self.w;
        let word = match ty {
            I32 => value.clone(),
            F32 => return (value.clone(), true),
            I1 => {
                let (one, zero) = (w.constant(I32, 1), w.constant(I32, 0));
                w.op(I32, "select", &[value, &one, &zero])
            }
            I64 => {
                let [low, high] = w.words(value);
                w.op(I32, "xor", &[&low, &high])
            }
            F64 => {
                let bits = w.bits(F64, value);
                let [low, high] = w.words(&bits);
                w.op(I32, "xor", &[&low, &high])
            }
            F16 => {
                let bits = w.bits(F16, value);
                w.op(I32, "uconvert", &[&bits])
            }
            _ => w.op(I32, "uconvert", &[value]),
        };
        (word, false)
    }

    /// The outputs' words: of the newest values, or of any.
    fn outputs(&mut self) -> (Vec<String>, Vec<bool>) {
        if self.random.bool() {
            // Values of all types cross the end of a stretch.
            self.emit(I32, "isign", &[I32]);
        }
        let mut outputs = Vec::new();
        let newest = self.random.bool();
        for k in 0..OUTPUTS {
            let at = match newest {
                true => self.values.len().saturating_sub(1 + k),
                false => self.random.usize(..self.values.len()),
            };
            let (ty, value) = self.values[at].clone();
            outputs.push(self.output(ty, &value));
        }
        outputs.into_iter().unzip()
    }
}

impl Maker {
    /// Names of values that a construct defines, of some types, and their text behind the label.
    fn defined(&mut self, types: &[Type]) -> (Vec<String>, String) {
        let names: Vec<String> = (0..types.len())
            .map(|k| format!("v{}", self.w.next + k as u32))
            .collect();
        self.w.next += types.len() as u32;
        let typed = names.iter().zip(types);
        let text: Vec<String> = typed.map(|(name, ty)| format!("{name}: {ty}")).collect();
        (names, text.join(", "))
    }

    fn types(&mut self, most: usize) -> Vec<Type> {
        let count = self.random.usize(..=most);
        (0..count)
            .map(|_| self.choose(&[I1, I8, I32, I32, F32, F32, F64, I64, F16]))
            .collect()
    }

    fn operations(&mut self, most: usize) {
        for _ in 0..self.random.usize(..=most) {
            match self.random.u32(..if self.is_across { 12 } else { 8 }) {
                1 if self.is_private => self.private(),
                0 => self.load(),
                8..11 => self.across(),
                11 => {
                    let ty = self.choose(&INTEGERS[..3]);
                    let name = self.choose(COUNTS);
                    self.emit(ty, name, &[ty]);
                }
                _ => self.operation(),
            }
        }
    }

    /// An operation across the lanes that come to it.
    fn across(&mut self) {
        let int = match self.random.u32(..3) {
            0 => self.choose(&INTEGERS),
            _ => I32,
        };
        match self.random.u32(..12) {
            0 => self.emit(I1, "subgroup.elect", &[]),
            1 => self.emit(I1, "subgroup.all", &[I1]),
            2 => self.emit(I1, "subgroup.any", &[I1]),
            3 => self.emit(I32, "subgroup.ballot", &[I1]),
            4 => {
                let ty = self.choose(&[I8, I32, F32, F16]);
                self.emit(I1, "subgroup.all_equal", &[ty]);
            }
            5 => {
                let ty = self.choose(&[I16, I32, F32, F16]);
                self.emit(ty, "subgroup.broadcast_first", &[ty]);
            }
            6 => {
                let name = self.choose(&["fmin", "fmax", "fadd", "fmul"]);
                let name = format!("subgroup.reduce[{name}, {}]", 1 << self.random.u32(..5));
                self.emit(F32, &name, &[F32]);
            }
            7 | 8 => {
                let name = self.choose(REDUCTIONS);
                let name = format!("subgroup.reduce[{name}, {}]", 1 << self.random.u32(..5));
                self.emit(int, &name, &[int]);
            }
            9 => {
                let kind = self.choose(&["inclusive", "exclusive"]);
                let name = self.choose(REDUCTIONS);
                self.emit(int, &format!("subgroup.{kind}_scan[{name}]"), &[int]);
            }
            _ => self.shuffle(),
        }
    }

    /// The value of another lane: zero where that one does not come here, or is none.
    fn shuffle(&mut self) {
        let index = self.w.line(I32, "lane_index");
        let other = match self.random.u32(..6) {
            0 | 1 => self.pick(I32),
            // Each lane's own.
            2 => self.w.constant(I32, 0),
            _ => self.constant(I32),
        };
        let few = self.w.constant(I32, self.random.u64(..4) * 8 + 7);
        let other = self.w.op(I32, "and", &[&other, &few]);
        let name = self.choose(&["xor", "iadd", "isub", "or"]);
        let from = self.w.op(I32, name, &[&index, &other]);
        let ty = self.choose(&[I32, I32, F32, I16, I64]);
        let value = self.pick(ty);
        if self.random.bool() {
            let result = self.w.op(ty, "subgroup.quad_shuffle", &[&value, &from]);
            return self.show(ty, result);
        }
        let all = self.w.constant(I1, 1);
        let active = self.w.op(I32, "subgroup.ballot", &[&all]);
        let (one, zero) = (self.w.constant(I32, 1), self.w.constant(I32, 0));
        let bit = self.w.op(I32, "lshr", &[&active, &from]);
        let bit = self.w.op(I32, "and", &[&bit, &one]);
        let is_active = self.w.op(I1, "ine", &[&bit, &zero]);
        let result = self.w.op(ty, "subgroup.shuffle", &[&value, &from]);
        let nothing = self.w.constant(ty, 0);
        let result = self.w.op(ty, "select", &[&is_active, &result, &nothing]);
        self.show(ty, result);
    }

    /// An access to private memory: to rows that lanes name, mostly such that exist, or to one that
    /// is fixed. Each variable holds scalars of one type.
    fn private(&mut self) {
        let variable = self.random.usize(..VARIABLES.len());
        let ty = VARIABLES[variable];
        if self.random.u32(..3) == 0 {
            let row = self.random.u32(..4) * 2;
            if self.random.bool() {
                let value = self.pick(ty);
                return self.write(&format!("var.store[var{variable}, {row}] {value}\n"));
            }
            let (names, text) = self.defined(&[ty]);
            self.write(&format!("{text} = var.load[var{variable}, {row}]\n"));
            return self.show(ty, names[0].clone());
        }
        let mut row = self.pick(I32);
        if self.random.u32(..8) != 0 {
            let some = self.w.constant(I32, 6);
            row = self.w.op(I32, "and", &[&row, &some]);
        } else {
            let past = self.w.constant(I32, 1 << 20);
            row = self.w.op(I32, "or", &[&row, &past]);
        }
        let first = self.w.line(I32, &format!("var.address[var{variable}]"));
        let row = self.w.op(I32, "iadd", &[&first, &row]);
        let types = vec![ty; self.random.usize(1..=2)];
        if self.random.bool() {
            let values = self.picks(&types);
            return self.write(&format!("store.private {row}, {values}\n"));
        }
        let (names, text) = self.defined(&types);
        self.write(&format!("{text} = load.private {row}\n"));
        self.values.extend(types.into_iter().zip(names));
    }

    /// Words from memory that lanes mostly hit.
    fn load(&mut self) {
        let is_spaced = self.is_spaced && self.random.u32(..4) != 0;
        let mut offset = match is_spaced {
            true => self.spaced(),
            false => self.pick(I32),
        };
        if self.random.u32(..4) != 0 && !is_spaced {
            let size = self.w.constant(I32, 255);
            offset = self.w.op(I32, "and", &[&offset, &size]);
        }
        let ty = match self.random.u32(..6) {
            0..3 => I32,
            3 | 4 => F32,
            _ if self.is_plain => I32,
            _ => self.choose(&[I8, I16, I64]),
        };
        let types = vec![ty; self.random.usize(1..=4)];
        let (names, text) = self.defined(&types);
        let from = match self.is_private && self.random.bool() {
            true => format!("shared {offset}"),
            false => format!("buffer {MEMORY}, {offset}"),
        };
        self.write(&format!("{text} = load.{from}\n"));
        self.values.extend(types.into_iter().zip(names));
    }

    /// Offsets that have a distance from lane to lane, or are the same, some of them near the end
    /// of all offsets.
    fn spaced(&mut self) -> String {
        let lane = self.w.line(I32, "lane_index");
        let (name, by) = match self.random.u32(..8) {
            0 => ("lshr", 4),
            1..4 => ("shl", self.random.u64(0..5)),
            _ => ("imul", self.choose(&[3, 4, 8, 12, 20, 24, 28, 0xffff_fffc])),
        };
        let by = self.w.constant(I32, by);
        let offset = self.w.op(I32, name, &[&lane, &by]);
        let first = match self.random.u32(..6) {
            0 => self.w.constant(I32, 0xffff_fff0),
            1 => self.pick(I32),
            _ => {
                let first = self.random.u64(0..48);
                self.w.constant(I32, first)
            }
        };
        self.w.op(I32, "iadd", &[&offset, &first])
    }

    /// Operands of a `br`: some of what is there.
    fn picks(&mut self, types: &[Type]) -> String {
        let picked: Vec<String> = types.iter().map(|&ty| self.pick(ty)).collect();
        picked.join(", ")
    }

    fn write(&mut self, text: &str) {
        self.w.text += text;
    }

    /// A loop that some lanes leave sooner than others, with branches inside.
    fn turns(&mut self) {
        let left = self.types(4);
        let carried = self.types(8);
        let (seven, one, zero) = (
            self.w.constant(I32, self.random.u64(0..8)),
            self.w.constant(I32, 1),
            self.w.constant(I32, 0),
        );
        let mut bound = seven;
        if !self.is_counted || self.random.u32(..4) == 0 {
            let mut word = self.pick(I32);
            if self.is_counted {
                let line = format!("subgroup.broadcast_first {word}");
                word = self.w.line(I32, &line);
            }
            bound = self.w.op(I32, "and", &[&word, &bound]);
        }
        let (results, text) = self.defined(&left);
        self.write(&format!("block L0{} {{\n", arrow(&text)));
        let outside = self.values.len();
        let first = self.picks(&carried);
        let (names, text) = self.defined(&carried);
        let (counter, _) = self.defined(&[I32]);
        let counter = &counter[0];
        let comma = if carried.is_empty() { "" } else { ", " };
        self.write(&format!(
            "loop L1 ({counter}: i32{comma}{text}) = ({zero}{comma}{first}) {{\n"
        ));
        self.values.extend(carried.iter().copied().zip(names));
        self.show(I32, counter.clone());
        self.operations(5);
        let goes_on = self.w.op(I1, "ult", &[counter, &bound]);
        let leaves = self.picks(&left);
        self.write(&format!(
            "if {goes_on}, L2 {{\nbr L2\n}} else {{\n{}\n}}\n",
            branch(0, &leaves)
        ));
        self.operations(8);
        let next = self.w.op(I32, "iadd", &[counter, &one]);
        for label in 3..3 + self.random.u32(..3) {
            let condition = self.pick(I1);
            let types = self.types(3);
            let (names, text) = self.defined(&types);
            self.write(&format!("if {condition}, L{label}{} {{\n", arrow(&text)));
            let inside = self.values.len();
            self.operations(4);
            let joined = self.picks(&types);
            self.write(&format!("{}\n}} else {{\n", branch(label, &joined)));
            self.values.truncate(inside);
            self.operations(4);
            let end = match self.random.u32(..3) {
                0 => branch(0, &self.picks(&left)),
                1 => format!("br L1({next}{comma}{})", self.picks(&carried)),
                _ => branch(label, &self.picks(&types)),
            };
            self.write(&format!("{end}\n}}\n"));
            self.values.truncate(inside);
            self.values.extend(types.into_iter().zip(names));
        }
        self.operations(5);
        let last = self.picks(&carried);
        self.write(&format!(
            "br L1({next}{comma}{last})\n}}\nunreachable\n}}\n"
        ));
        self.values.truncate(outside);
        self.values.extend(left.into_iter().zip(results));
    }
}

fn arrow(results: &str) -> String {
    match results {
        "" => String::new(),
        _ => format!(" -> ({results})"),
    }
}

fn branch(label: u32, operands: &str) -> String {
    match operands {
        "" => format!("br L{label}"),
        _ => format!("br L{label}({operands})"),
    }
}

/// A program with a loop, its text, and which of its outputs are floats.
fn program_with_loop(
    seed: u64,
    [is_across, is_private, is_spaced, is_counted]: [bool; 4],
) -> (Module, String, Vec<bool>) {
    let mut m = Maker::new(seed);
    m.is_plain = m.random.u32(..4) != 0;
    if is_private {
        m.w.text = format!(
            "module compute\ninputs {}\noutput_rows {OUTPUTS}\nlocal_size 64, 1, 1\n\
            shared {SHARED_BYTES}\nfunc f0 {{\n",
            WORKGROUP_INPUTS.join(", ")
        );
        for variable in 0..VARIABLES.len() {
            m.write(&format!("var{variable}: {VARIABLE_ROWS} rows zero\n"));
        }
    }
    m.inputs();
    m.operations(6);
    m.is_across = is_across;
    (m.is_private, m.is_spaced, m.is_counted) = (is_private, is_spaced, is_counted);
    m.turns();
    m.operations(3);
    let (outputs, floats) = m.outputs();
    let (module, text) = m.w.end(&outputs);
    (module, text, floats)
}

/// As [`program_with_loop`], without one.
fn program(seed: u64) -> (Module, String, Vec<bool>) {
    let mut m = Maker::new(seed);
    m.inputs();
    let count = m.random.usize(2..=60);
    match m.random.u32(..3) {
        0 => {
            for _ in 0..count {
                m.operation();
            }
            let (outputs, floats) = m.outputs();
            let (module, text) = m.w.end(&outputs);
            (module, text, floats)
        }
        // In some lanes, or in lanes of some subgroups, alone.
        how => {
            let before = m.random.usize(..count);
            for _ in 0..before {
                m.operation();
            }
            let (lanes, tested) = (how == 1, m.values.iter().find(|(ty, _)| *ty == I1));
            let mut condition = tested.expect("an input is").1.clone();
            if !lanes {
                // Values that all lanes of a subgroup agree on.
                condition = m.w.line(I1, &format!("subgroup.any {condition}"));
                let same = m.w.line(I32, "input[0]");
                let first = m.w.line(I32, &format!("subgroup.broadcast_first {same}"));
                let (one, four) = (m.w.constant(I32, 1), m.w.constant(I32, 4));
                let bits = m.w.op(I32, "and", &[&first, &four]);
                let other = m.w.op(I1, "ult", &[&bits, &one]);
                condition = m.w.op(I1, "and", &[&condition, &other]);
            }
            let names: Vec<String> = (0..OUTPUTS)
                .map(|k| format!("v{}", m.w.next + k as u32))
                .collect();
            m.w.next += OUTPUTS as u32;
            let params: Vec<String> = names.iter().map(|name| format!("{name}: i32")).collect();
            m.w.text += &format!("if {condition}, L0 -> ({}) {{\n", params.join(", "));
            let outside = m.values.len();
            for _ in before..count {
                m.operation();
            }
            for k in 0..2 {
                let (outputs, floats) = m.outputs();
                let mut words = Vec::new();
                for (word, is_float) in outputs.iter().zip(floats) {
                    words.push(match is_float {
                        true => m.w.bits(F32, word),
                        false => word.clone(),
                    });
                }
                m.w.text += &format!("br L0({})\n", words.join(", "));
                m.w.text += ["} else {\n", "}\n"][k];
                m.values.truncate(outside);
            }
            let (module, text) = m.w.end(&names);
            (module, text, vec![false; OUTPUTS])
        }
    }
}

/// The first seed, and how many there are.
fn seeds(cases: u32) -> (u64, u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    (
        number("TUFF_SEED").unwrap_or(0),
        number("TUFF_CASES").unwrap_or(u64::from(effort::rounds(cases))),
    )
}

/// Loops that hand a value on from a row which another value is written to, on AVX-512 and, the
/// third, on AVX2.
const HANDED_ON_FROM_ROWS: [u64; 5] = [12496, 20620, 20960, 40855, 51035];

/// Compares a program with a loop in all tiers; whether the loop is native code in the best one.
fn agrees_with_loop(seed: u64, kinds: [bool; 4]) -> u64 {
    let (module, text, floats) = program_with_loop(seed, kinds);
    agrees(&module, &floats, seed, &text);
    let program = Program::with_tier(&module, TierKind::best()).unwrap();
    program.native_loops() as u64
}

/// One in `share` loops is native code, or more, where a tier has any.
fn are_native(native: u64, cases: u64, share: u64) {
    if lanes::Tier::available().len() > 1 {
        assert!(
            native * share > cases || cases < 100,
            "{native} of {cases} loops are native code"
        );
    }
}

/// As [`native_loops_give_what_the_interpreter_gives`], with operations across lanes.
#[test]
fn native_loops_combine_lanes_as_the_interpreter_does() {
    let (first, cases) = seeds(300);
    let native: u64 = (first..first + cases)
        .map(|seed| agrees_with_loop(seed, [true, false, false, false]))
        .sum();
    are_native(native, cases, 5);
}

/// As [`native_loops_give_what_the_interpreter_gives`], with private memory and workgroup
/// memory.
#[test]
fn native_loops_access_private_memory_as_the_interpreter_does() {
    let (first, cases) = seeds(300);
    let native: u64 = (first..first + cases)
        .map(|seed| agrees_with_loop(seed, [seed % 4 == 0, true, false, seed % 3 == 0]))
        .sum();
    are_native(native, cases, 5);
}

/// As [`native_loops_give_what_the_interpreter_gives`], with loads from places that have a distance
/// from lane to lane.
#[test]
fn native_loops_load_words_at_distances_as_the_interpreter_does() {
    let (first, cases) = seeds(300);
    let native: u64 = (first..first + cases)
        .map(|seed| agrees_with_loop(seed, [false, seed % 2 == 0, true, seed % 3 == 0]))
        .sum();
    are_native(native, cases, 5);
}

/// Loops, as native code in one piece, and by single turns where the fuel is short.
#[test]
fn native_loops_give_what_the_interpreter_gives() {
    let (first, cases) = seeds(300);
    let mut native = 0;
    for seed in (first..first + cases).chain(HANDED_ON_FROM_ROWS) {
        native += agrees_with_loop(seed, [false; 4]);
    }
    are_native(native, cases, 4);
}

/// As [`native_loops_give_what_the_interpreter_gives`], of loops that all lanes leave at once.
#[test]
fn native_loops_end_for_all_lanes_as_the_interpreter_ends_them() {
    let (first, cases) = seeds(300);
    let agrees = |seed| agrees_with_loop(seed, [seed % 5 == 0, false, false, true]);
    are_native((first..first + cases).map(agrees).sum(), cases, 4);
}

#[test]
fn native_code_gives_what_the_interpreter_gives() {
    let (first, cases) = seeds(400);
    let mut native = 0;
    for seed in first..first + cases {
        let (module, text, floats) = program(seed);
        native += agrees(&module, &floats, seed, &text) as u64;
    }
    if lanes::Tier::available().len() > 1 {
        assert!(
            native * 10 > cases * 9 || cases < 100,
            "{native} of {cases} have native code"
        );
    }
}
