//! A straight stretch of operations on its way to instructions: where values are held, and the
//! steps so far.

use foldhash::HashMap;

use super::allocate::{Class, Form, Info, Step, Virtual, allocate};
use super::encode::{Assembler, Base, Constant, Encoding, Memory, Opcode};
use super::opcodes::*;
use crate::ir::{Op, Type, Value};

mod across;
mod assemble;
mod exits;
mod halves;
mod hoist;
mod lower;
mod private;
mod skips;
mod stores;
#[cfg(test)]
mod tests;
mod turns;
mod weave;

pub(crate) use private::PrivateRow;
pub(crate) use turns::{Lanes, Merged, Sameness, Turns};
use weave::Woven;

/// The row of a value in a frame, or among uniform rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ValueRow {
    Frame(usize),
    Uniform(usize),
    /// A result that only the next operation of the stretch takes.
    Forwarded,
}

/// An operand or a result.
#[derive(Clone, Copy, Debug)]
pub(crate) struct IrOperand {
    pub value: Value,
    pub ty: Type,
    pub row: ValueRow,
    /// Its constant value.
    pub constant: Option<u64>,
}

/// The registers of a value: a second one for lanes of 64 bits.
#[derive(Clone, Copy)]
enum Held {
    One(Virtual),
    Two(Virtual, Virtual),
}

/// Operations one behind another, without branches and memory of the shader's.
pub(crate) struct Stretch {
    encoding: Encoding,
    /// The processor has instructions for 16-bit floats.
    has_halves: bool,
    /// The processor has instructions that count bits.
    has_counts: bool,
    steps: Vec<Step>,
    infos: Vec<Info>,
    pool: Vec<Constant>,
    /// By half of the subgroup where code takes both at once, else the first alone.
    held: [HashMap<Value, Held>; 2],
    /// Results that have rows.
    results: Vec<(Value, Held)>,
    /// The active lanes, once they were asked for.
    lanes: Option<Virtual>,
    operations: usize,
    /// Values of 16-bit floats of which other forms are in registers.
    half_forms: Vec<halves::HalfForms>,
    /// The half of the subgroup that is computed, where code takes both halves at once; AVX2 only.
    half: Option<i32>,
    /// The subgroup's number among those that take a loop together.
    subgroup: usize,
}

/// Subgroups that take a loop together, at most.
pub(crate) const MOST_TOGETHER: usize = 4;

/// Where frames of subgroups are that take a loop together.
const FRAMES: [Base; MOST_TOGETHER] = [Base::Frame, Base::Half, Base::WideHalf, Base::FourthFrame];

/// How much of a stretch there is.
pub(crate) struct Mark {
    steps: usize,
    results: usize,
    operations: usize,
}

impl Stretch {
    pub fn new(encoding: Encoding) -> Stretch {
        Stretch {
            encoding,
            has_halves: encoding == Encoding::Evex && lanes::has_half_arithmetic(),
            has_counts: encoding == Encoding::Evex && lanes::has_bit_counts(),
            steps: Vec::new(),
            infos: Vec::new(),
            pool: Vec::new(),
            held: Default::default(),
            results: Vec::new(),
            lanes: None,
            operations: 0,
            half_forms: Vec::new(),
            half: None,
            subgroup: 0,
        }
    }

    /// Operations so far.
    pub fn operations(&self) -> usize {
        self.operations
    }

    pub fn mark(&self) -> Mark {
        Mark {
            steps: self.steps.len(),
            results: self.results.len(),
            operations: self.operations,
        }
    }

    /// Takes back what came behind a mark.
    pub fn take_back(&mut self, mark: Mark) {
        self.steps.truncate(mark.steps);
        self.forget_half_forms(mark.steps);
        for (value, _) in self.results.drain(mark.results..) {
            self.held[0].remove(&value);
        }
        self.operations = mark.operations;
    }

    /// Appends an operation; false, and nothing is changed, if it has no native code.
    pub fn perform(&mut self, op: &Op, operands: &[IrOperand], results: &[IrOperand]) -> bool {
        let mark = self.mark();
        if self.lower(op, operands, results).is_none() {
            self.take_back(mark);
            return false;
        }
        self.operations += 1;
        true
    }

    /// The operations since the last such call are one: its results are stored when all of it is
    /// done.
    pub fn end_operation(&mut self) {
        if let Some(step) = self.steps.last_mut() {
            step.ends = true;
        }
    }

    /// Copies a value of 32-bit lanes to a row; where `is_masked`, in active lanes alone.
    pub fn copy_to(&mut self, from: &IrOperand, row: ValueRow, is_masked: bool) {
        let Held::One(new) = self.operand(from) else {
            unreachable!("lanes of 64 bits are left to the interpreter");
        };
        let class = self.class_of(from.ty);
        let home = self.home(&IrOperand { row, ..*from }, 0);
        let to = match (is_masked, class) {
            (true, _) => {
                let lanes = self.active_lanes();
                let old = self.value(class, home, true);
                match class {
                    Class::Vector => self.select(lanes, new, old),
                    Class::Mask => {
                        let new = self.masks(KAND, &[lanes, new]);
                        let old = self.masks(KANDN, &[lanes, old]);
                        self.masks(KOR, &[new, old])
                    }
                }
            }
            (false, Class::Vector) => self.copy(new),
            (false, Class::Mask) => self.masks(KAND, &[new, new]),
        };
        let info = &mut self.infos[to as usize];
        (info.home, info.keep) = (home, true);
        self.operations += 1;
        self.end_operation();
    }

    /// The mask of active lanes, as conditions are held.
    fn active_lanes(&mut self) -> Virtual {
        if let Some(lanes) = self.lanes {
            return lanes;
        }
        let lanes = match self.encoding {
            Encoding::Evex => self.step(Class::Mask, KMOV, Form::OfLanes, &[]),
            Encoding::Vex => {
                let mask = self.step(Class::Vector, PBROADCASTB, Form::OfLanes, &[]);
                let bits = self.constant(Constant::LaneBits);
                let mask = self.commutative(PAND, mask, bits);
                self.commutative(PCMPEQD, mask, bits)
            }
        };
        *self.lanes.insert(lanes)
    }

    /// The code: a function of the first subgroup's frame, the uniform rows, the number of
    /// subgroups, how far their frames are apart, and the first subgroup's mask of active lanes,
    /// behind which the others' stand. `is_kept` tells the results that are used behind the
    /// stretch. `None`: more values live at once than there are registers for.
    pub fn assemble(mut self, is_kept: impl Fn(Value) -> bool) -> Option<Vec<u8>> {
        for &(value, held) in &self.results {
            if is_kept(value) {
                for part in held.parts() {
                    self.infos[part as usize].keep = true;
                }
            }
        }
        let is_kept = self.infos.iter().map(|info| info.keep).collect();
        let steps = without_unused(std::mem::take(&mut self.steps), is_kept);
        let mut a = Assembler::new(self.encoding);
        if self.lanes.is_some() {
            // mov r10, r8
            a.bytes.extend([0x4d, 0x89, 0xc2]);
        }
        let woven = self.write_woven(&steps, &mut a);
        if !matches!(woven, Some(Woven::All)) {
            self.write_single(&steps, &mut a)?;
        }
        if let Some(Woven::Several { done }) = woven {
            a.land(done);
        }
        // vzeroupper; ret
        a.bytes.extend([0xc5, 0xf8, 0x77, 0xc3]);
        Some(a.finish(&self.pool))
    }

    /// Code for one subgroup after another.
    fn write_single(&mut self, steps: &[Step], a: &mut Assembler) -> Option<()> {
        let halves = self.encoding == Encoding::Vex;
        let start = a.bytes.len();
        if halves {
            // mov r8, rdi; mov r9, rdi; mov eax, 2
            a.bytes
                .extend([0x49, 0x89, 0xf8, 0x49, 0x89, 0xf9, 0xb8, 2, 0, 0, 0]);
        }
        let half = a.bytes.len();
        allocate(steps, std::mem::take(&mut self.infos), a).ok()?;
        if self.lanes.is_some() {
            // add r10, a byte for each eight lanes
            let step = self.encoding.vector_bytes() as u8 / 32;
            a.bytes.extend([0x49, 0x83, 0xc2, step]);
        }
        if halves {
            // add r8, 32; add r9, 64; dec eax
            a.bytes
                .extend([0x49, 0x83, 0xc0, 32, 0x49, 0x83, 0xc1, 64, 0xff, 0xc8]);
            a.jump_if_not_zero(half);
        }
        // add rdi, rcx; dec rdx
        a.bytes.extend([0x48, 0x01, 0xcf, 0x48, 0xff, 0xca]);
        a.jump_if_not_zero(start);
        Some(())
    }

    fn value(&mut self, class: Class, home: Option<Memory>, is_home: bool) -> Virtual {
        self.infos.push(Info {
            class,
            home,
            is_home,
            keep: false,
        });
        self.infos.len() as u32 - 1
    }

    /// Index of the half that is being written.
    fn side(&self) -> usize {
        self.half.unwrap_or(0) as usize
    }

    /// The registers of a value, if it has some.
    fn known(&self, value: Value) -> Option<Held> {
        self.held[self.side()].get(&value).copied()
    }

    fn hold(&mut self, value: Value, held: Held) {
        let side = self.side();
        self.held[side].insert(value, held);
    }

    fn class_of(&self, ty: Type) -> Class {
        match (ty, self.encoding) {
            (Type::I1, Encoding::Evex) => Class::Mask,
            _ => Class::Vector,
        }
    }

    fn home(&self, place: &IrOperand, part: i32) -> Option<Memory> {
        let offset = part * self.encoding.vector_bytes();
        let frame = FRAMES[self.subgroup];
        Some(match (place.row, self.encoding) {
            // All lanes of uniform rows are equal.
            (ValueRow::Uniform(row), _) => Memory::At(Base::Uniforms, row as i32 * 64),
            (ValueRow::Frame(row), Encoding::Evex) => Memory::At(frame, row as i32 * 64 + offset),
            (ValueRow::Frame(row), Encoding::Vex) => {
                let row = row as i32 * 64;
                match (self.half, place.ty.rows()) {
                    (None, 2) => Memory::At(Base::WideHalf, row + offset),
                    (None, _) => Memory::At(Base::Half, row),
                    (Some(half), 2) => Memory::At(frame, row + 64 * half + offset),
                    (Some(half), _) => Memory::At(frame, row + 32 * half),
                }
            }
            (ValueRow::Forwarded, _) => return None,
        })
    }

    fn operand(&mut self, place: &IrOperand) -> Held {
        if let Some(held) = self.known(place.value) {
            return held;
        }
        let class = self.class_of(place.ty);
        let part = |stretch: &mut Self, k| {
            let home = stretch.home(place, k);
            stretch.value(class, home, true)
        };
        let held = match (place.ty.rows(), place.row) {
            (2, ValueRow::Uniform(_)) => {
                // All lanes are equal.
                let both = part(self, 0);
                Held::Two(both, both)
            }
            (2, _) => Held::Two(part(self, 0), part(self, 1)),
            _ => Held::One(part(self, 0)),
        };
        self.hold(place.value, held);
        if let ValueRow::Uniform(_) = place.row {
            // The same in both halves.
            self.held[1].insert(place.value, held);
        }
        held
    }

    fn step(&mut self, class: Class, op: Opcode, form: Form, from: &[Virtual]) -> Virtual {
        let to = self.value(class, None, false);
        let mut operands = [0; 3];
        operands[..from.len()].copy_from_slice(from);
        self.steps.push(Step {
            op,
            form,
            to,
            more: [None; 3],
            from: operands,
            count: from.len(),
            immediate: None,
            ends: false,
            subgroup: self.subgroup as u8,
            half: self.half,
        });
        to
    }

    fn step_with(&mut self, op: Opcode, form: Form, from: &[Virtual], immediate: u8) -> Virtual {
        let to = self.step(Class::Vector, op, form, from);
        self.steps.last_mut().expect("pushed").immediate = Some(immediate);
        to
    }

    fn binary(&mut self, op: Opcode, a: Virtual, b: Virtual) -> Virtual {
        self.step(Class::Vector, op, Form::Binary, &[a, b])
    }

    fn commutative(&mut self, op: Opcode, a: Virtual, b: Virtual) -> Virtual {
        self.step(Class::Vector, op, Form::Commutative, &[a, b])
    }

    fn unary(&mut self, op: Opcode, a: Virtual) -> Virtual {
        self.step(Class::Vector, op, Form::Unary, &[a])
    }

    fn shift(&mut self, op: Opcode, number: u8, a: Virtual, count: u32) -> Virtual {
        self.step_with(op, Form::Extended(number), &[a], count as u8)
    }

    /// A vector of equal words.
    fn words(&mut self, word: u32) -> Virtual {
        self.constant(Constant::Word(word))
    }

    fn constant(&mut self, constant: Constant) -> Virtual {
        let index = self.constant_index(constant);
        self.value(Class::Vector, Some(Memory::Pool(index)), true)
    }

    /// The number of a constant behind the code.
    fn constant_index(&mut self, constant: Constant) -> u32 {
        let known = self.pool.iter().position(|&other| other == constant);
        let index = known.unwrap_or_else(|| {
            self.pool.push(constant);
            self.pool.len() - 1
        });
        index as u32
    }

    /// The number of the first of constants that follow one another behind the code.
    fn neighbours(&mut self, constants: Vec<Constant>) -> u32 {
        if constants.is_empty() {
            return 0;
        }
        let known = (self.pool.windows(constants.len())).position(|other| *other == constants);
        let first = known.unwrap_or(self.pool.len());
        if known.is_none() {
            self.pool.extend(constants);
        }
        first as u32
    }

    fn and(&mut self, a: Virtual, word: u32) -> Virtual {
        let word = self.words(word);
        self.commutative(PAND, a, word)
    }

    fn not(&mut self, a: Virtual) -> Virtual {
        let ones = self.words(u32::MAX);
        self.commutative(PXOR, a, ones)
    }

    fn round(&mut self, a: Virtual, how: u8) -> Virtual {
        // 8: without the exception for what is not an integer.
        self.step_with(ROUNDPS, Form::Unary, &[a], 8 | how)
    }
}

/// The steps without those whose results neither a step nor code behind them takes. `is_used`: by
/// value, whether code behind them does.
fn without_unused(steps: Vec<Step>, mut is_used: Vec<bool>) -> Vec<Step> {
    let mut used = Vec::with_capacity(steps.len());
    let mut ends = false;
    for mut step in steps.into_iter().rev() {
        ends |= step.ends;
        if !is_used[step.to as usize] && step.form.only_computes() {
            continue;
        }
        step.ends = std::mem::take(&mut ends);
        for &value in &step.from[..step.count] {
            is_used[value as usize] = true;
        }
        used.push(step);
    }
    used.reverse();
    used
}

impl Held {
    fn parts(self) -> impl Iterator<Item = Virtual> {
        let (first, second) = match self {
            Held::One(a) => (a, None),
            Held::Two(a, b) => (a, Some(b)),
        };
        [Some(first), second].into_iter().flatten()
    }
}
