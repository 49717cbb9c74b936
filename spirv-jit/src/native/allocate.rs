//! Registers for a straight stretch of code: each value is loaded where it is first used, and
//! leaves its register when it is used no more or when another is needed sooner (Belady 1966).

use super::encode::{
    Assembler, Base, Encoding, Memory, Opcode, Operand, Register, ZEROING, opcode,
};

mod carry;
mod exit;
mod gather;
mod private;
mod scatter;
mod skip;
mod words;

pub(super) use carry::{Alike, Carried, Outside, Turn, allocate_turn};
pub(super) use exit::{Exit, Left, jump_without};
pub(super) use gather::{blocks, choice};
#[cfg(test)]
pub(super) use words::{broadcast_word, first_word};

/// A value of the stretch: one register's worth.
pub(super) type Virtual = u32;

/// In which registers a value is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Class {
    Vector,
    /// A bit for each lane; in memory, all zeros or all ones in each. AVX-512 only.
    Mask,
}

#[derive(Clone, Copy)]
pub(super) struct Info {
    pub class: Class,
    /// Where it is in memory, or may be put.
    pub home: Option<Memory>,
    /// Whether it is there.
    pub is_home: bool,
    /// Whether code behind the stretch looks for it there.
    pub keep: bool,
}

/// How an instruction takes its operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// `reg = op(vvvv, rm)`.
    Binary,
    /// As [`Form::Binary`], in either order.
    Commutative,
    /// `reg = op(rm)`.
    Unary,
    /// `reg = op(vvvv, rm)` and [`Form::Unary`] between registers alone: those whose operand in
    /// memory would be shorter or is none.
    Registers,
    /// `rm = op(reg)`.
    Reverse,
    /// `vvvv = op(rm)`, with this number in `reg`.
    Extended(u8),
    /// `a * b + c`.
    MultiplyAdd,
    /// `reg = op(vvvv, rm)` between registers, rounded in this way. AVX-512 only.
    Rounding(u8),
    /// `condition ? a : b`.
    Blend,
    /// On mask registers; of two operands, or of one.
    OfMasks,
    /// `reg = op(the mask of active lanes)`, into a vector or a mask register.
    OfLanes,
    /// Loads words at the places that the first operand says, in lanes of the second, which is used
    /// no more; zeros elsewhere. The immediate is the region's number. With a third operand,
    /// multiples of a distance, words that have this distance are loaded without a gather. With
    /// AVX2 the same word of all lanes is loaded at once.
    Gather(Spread),
    /// Loads up to four words that lie one behind another, the first one at the places that the
    /// first operand says, in lanes of the second; zeros elsewhere. The third operand is the
    /// constant four. The immediate is the region's number.
    LoadFours,
    /// In all lanes the first of words that lie from `first` to `last` bytes behind the place that
    /// the operand's first lane says; zero if that is outside. The immediate is the region's
    /// number.
    LoadOne { first: u32, last: u32 },
    /// In all lanes the word so many bytes before the last of those words. Directly behind such a
    /// step.
    LoadNext(u32),
    /// `reg = op(vvvv, rm)` of the second and the third operand in lanes of the first, zeros
    /// elsewhere. AVX-512 only.
    Zeroing,
    /// All lanes or none, from a condition: see [`Vote`].
    OfVote(Vote),
    /// A bit for each lane of a condition, or of two halves' conditions, in each lane of a vector.
    OfBits,
    /// In each lane the number of the first lane of a condition, or of two halves' conditions.
    OfFirst,
    /// In all lanes `op` of all lanes of a register, or of two halves, one after another.
    InOrder,
    /// Loads a private row, of this number or that of the operand's first lane.
    LoadRow(Option<u32>),
    /// Stores the second operand, in lanes of the first, to such a row; the third operand has its
    /// number. The result's register is scratch.
    StoreRow(Option<u32>),
    /// Stores the third operand at the places that the first operand says, in lanes of the second.
    /// The immediate is the region's number, the form's the constant of lanes' distances where
    /// words may lie one behind another. The result's register is scratch; AVX-512 clears the
    /// second operand.
    Scatter(Option<u32>),
    /// As [`Form::Gather`], at places from the first private row on.
    GatherRows,
    /// Stores the third operand, in lanes of the second, at such places. The result's register is
    /// scratch.
    ScatterRows,
    /// Stores the second operand, in lanes of the first, to the result's place in memory; the
    /// result's register is scratch.
    Leave,
    /// All lanes leave the loop where the operand is `when`.
    Exit { index: usize, when: bool },
    /// The loop ends where no lane is in it any more: see [`Exit`].
    ExitWithout(usize),
    /// Begins a region that code jumps over where no lane comes to it, by the number of its lanes
    /// among exits.
    Skip(usize),
    /// Ends that region.
    EndSkip(usize),
    /// Behind an exit or a region's begin: that one reads the operands.
    Hold,
}

/// How words lie that may be loaded without a gather.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Spread {
    /// Bytes between the words of neighbouring lanes.
    pub distance: u32,
    /// Numbers of the constants that choose lanes' words of vectors: see [`blocks`]. AVX-512 only.
    pub first_choice: u32,
}

impl Form {
    /// Whether all that a step does is its result.
    pub fn only_computes(self) -> bool {
        use Form::*;
        matches!(
            self,
            Binary
                | Commutative
                | Unary
                | Registers
                | Reverse
                | Extended(_)
                | MultiplyAdd
                | Rounding(_)
                | Blend
                | OfMasks
        )
    }

    /// Whether all subgroups that take a loop together come to the step at once.
    pub fn is_common(self) -> bool {
        use Form::*;
        matches!(self, Exit { .. } | ExitWithout(_) | Skip(_) | EndSkip(_))
    }

    /// Whether the result's register is written before all operands are read.
    fn writes_first(self) -> bool {
        use Form::*;
        matches!(
            self,
            Leave | Gather(_) | Scatter(_) | GatherRows | ScatterRows | StoreRow(_)
        )
    }
}

/// When a vote gives all lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Vote {
    /// The mask has lanes.
    Some,
    /// It has none.
    None,
}

/// The number of all subgroups that take a loop together: of steps that give the same to each.
pub(super) const TURNS_TOGETHER: u8 = u8::MAX;

/// An instruction of the stretch.
#[derive(Clone, Copy)]
pub(super) struct Step {
    pub op: Opcode,
    pub form: Form,
    pub to: Virtual,
    /// Further results, of [`Form::LoadFours`].
    pub more: [Option<Virtual>; 3],
    pub from: [Virtual; 3],
    pub count: usize,
    pub immediate: Option<u8>,
    /// The last of its operation: results that are kept are stored behind it, and no sooner, since
    /// their rows may be operands'.
    pub ends: bool,
    /// The subgroup's number among those that take a loop together.
    pub subgroup: u8,
    /// The half of the subgroup that it computes, where code takes both; `None`: both at once.
    pub half: Option<i32>,
}

pub(super) const LOAD: Opcode = opcode(1, 0, 0, 0x10);
pub(super) const STORE: Opcode = opcode(1, 0, 0, 0x11);
pub(super) const MOVE: Opcode = opcode(1, 0, 0, 0x28);
pub(super) const MULTIPLY_ADD_213: Opcode = opcode(2, 1, 0, 0xa8);
pub(super) const MULTIPLY_ADD_231: Opcode = opcode(2, 1, 0, 0xb8);
pub(super) const MASK_TO_VECTOR: Opcode = opcode(2, 2, 0, 0x38);
pub(super) const VECTOR_TO_MASK: Opcode = opcode(2, 2, 0, 0x39);

/// With AVX-512, where masks pass through on their way to and from memory.
const SCRATCH: Register = 31;

const NEVER: u32 = u32::MAX;

/// No register could be freed.
#[derive(Debug)]
pub(super) struct TooManyLive;

/// Writes the steps. Gives how many values left their registers for their rows.
pub(super) fn allocate(
    steps: &[Step],
    values: Vec<Info>,
    assembler: &mut Assembler,
) -> Result<usize, TooManyLive> {
    let (after, first) = next_uses(steps, vec![NEVER; values.len()]);
    let mut allocation = Allocation::new(values, first, assembler);
    allocation.steps(steps, after)?;
    Ok(allocation.evictions)
}

/// By step, when its operands are used again; by value, when it is first used. `next`: when it is
/// used behind the steps.
fn next_uses(steps: &[Step], mut next: Vec<u32>) -> (Vec<[u32; 3]>, Vec<u32>) {
    let mut after = vec![[NEVER; 3]; steps.len()];
    for (index, step) in steps.iter().enumerate().rev() {
        let from = &step.from[..step.count];
        for (k, &value) in from.iter().enumerate() {
            after[index][k] = next[value as usize];
        }
        for &value in from {
            next[value as usize] = index as u32;
        }
    }
    (after, next)
}

struct Allocation<'a> {
    assembler: &'a mut Assembler,
    values: Vec<Info>,
    /// By value.
    registers: Vec<Option<Register>>,
    /// By value: its next use.
    next: Vec<u32>,
    /// The registers that values had best be in.
    preferred: Vec<(Virtual, Register)>,
    /// Free registers.
    vectors: Vec<Register>,
    masks: Vec<Register>,
    /// Values in registers.
    held: Vec<Virtual>,
    /// Of the operation that is being written.
    results: Vec<Virtual>,
    /// Values without a row may leave their registers for the stack.
    may_spill: bool,
    /// Of the stack, that values have left their registers for.
    stack_bytes: i32,
    /// How often one did, or came back.
    spills: usize,
    /// How often a value left its register for its row.
    evictions: usize,
    /// Where steps put registers aside on the stack.
    aside: Option<i32>,
    /// Of a loop.
    outside: Option<Outside<'a>>,
    /// Jumps to the end of the loop.
    exits: Vec<usize>,
    /// Regions that are being written.
    skipped: Vec<skip::Skipped>,
}

/// Of a loop's part of the stack, at most.
const MOST_STACK_BYTES: i32 = 2048;

impl<'a> Allocation<'a> {
    /// Nothing is in a register yet. `first`: by value, when it is first used.
    fn new(values: Vec<Info>, first: Vec<u32>, assembler: &'a mut Assembler) -> Allocation<'a> {
        let vectors = match assembler.encoding {
            Encoding::Vex => (0..16).rev().collect(),
            Encoding::Evex => (0..SCRATCH).rev().collect(),
        };
        Allocation {
            assembler,
            registers: vec![None; values.len()],
            next: first,
            preferred: Vec::new(),
            values,
            vectors,
            // `k0` means no mask.
            masks: (1..8).rev().collect(),
            held: Vec::new(),
            results: Vec::new(),
            may_spill: false,
            stack_bytes: 0,
            spills: 0,
            evictions: 0,
            aside: None,
            outside: None,
            exits: Vec::new(),
            skipped: Vec::new(),
        }
    }

    fn steps(&mut self, steps: &[Step], after: Vec<[u32; 3]>) -> Result<(), TooManyLive> {
        for (step, after) in steps.iter().zip(after) {
            self.step(step, after)?;
            if step.ends {
                self.end_operation()?;
            }
        }
        Ok(())
    }

    fn step(&mut self, step: &Step, after: [u32; 3]) -> Result<(), TooManyLive> {
        let from = &step.from[..step.count];
        match step.form {
            Form::LoadFours => return self.load_fours(step, after),
            Form::Exit { index, when } => return self.exit(step, (index, when), after),
            Form::ExitWithout(index) => return self.exit_without(index),
            Form::Skip(index) => return self.skip(index),
            Form::EndSkip(_) => return self.end_skip(),
            Form::Hold => return self.hold(from, after),
            _ => {}
        }
        // Which operand stays in memory: the last, if nothing else will want it in a register.
        let in_memory = |a: &Self, k: usize| {
            let info = &a.values[from[k] as usize];
            a.registers[from[k] as usize].is_none()
                && info.is_home
                && info.class == Class::Vector
                && after[k] == NEVER
                && from.iter().filter(|&&value| value == from[k]).count() == 1
        };
        let memory = match step.form {
            Form::Binary | Form::Unary => step.count - 1,
            Form::Commutative if !in_memory(self, 1) && in_memory(self, 0) => 0,
            Form::Commutative => 1,
            Form::MultiplyAdd => match (in_memory(self, 2), in_memory(self, 1)) {
                (true, _) => 2,
                (_, true) => 1,
                _ => 0,
            },
            Form::Blend => 1,
            Form::Zeroing => 2,
            Form::Gather(_) if step.count == 3 => 2,
            _ => usize::MAX,
        };
        let memory = (memory != usize::MAX && in_memory(self, memory)).then_some(memory);
        let mut operands = [Operand::Register(0); 3];
        for (k, &value) in from.iter().enumerate() {
            operands[k] = match memory {
                Some(m) if m == k => {
                    let home = self.values[value as usize].home;
                    Operand::Memory(home.expect("it is home"))
                }
                _ => Operand::Register(self.bring(value, from)?),
            };
        }
        for (k, &value) in from.iter().enumerate() {
            self.next[value as usize] = after[k];
        }
        let dies = |a: &Self, k: usize| {
            let value = from[k];
            a.next[value as usize] == NEVER && !a.is_to_be_stored(value)
        };
        if step.form == Form::MultiplyAdd {
            let dying = [0, 1, 2].map(|k| memory != Some(k) && dies(self, k));
            self.multiply_add(step, operands, memory, dying)?;
        } else if step.form.writes_first() {
            let to = self.take_apart(step.to, from, &operands)?;
            self.write(step, to, operands, memory)?;
            for k in 0..from.len() {
                if dies(self, k) {
                    self.release(from[k]);
                }
            }
        } else {
            for k in 0..from.len() {
                if dies(self, k) {
                    self.release(from[k]);
                }
            }
            let to = self.take(step.to, from)?;
            self.write(step, to, operands, memory)?;
        }
        self.results.push(step.to);
        Ok(())
    }

    /// Passes the place up to which another step reads values.
    fn hold(&mut self, from: &[Virtual], after: [u32; 3]) -> Result<(), TooManyLive> {
        for (&value, after) in from.iter().zip(after) {
            self.next[value as usize] = after;
            if after == NEVER && !self.is_to_be_stored(value) {
                self.release(value);
            }
        }
        Ok(())
    }

    fn write(
        &mut self,
        step: &Step,
        to: Register,
        operands: [Operand; 3],
        memory: Option<usize>,
    ) -> Result<(), TooManyLive> {
        let register = |operand: Operand| match operand {
            Operand::Register(register) => register,
            Operand::Memory(_) => unreachable!("in a register"),
        };
        let encoding = self.assembler.encoding;
        let [a, b, c] = operands;
        let mut vector = |operands: (Register, Register, Operand), mask, immediate| {
            self.assembler.vector(step.op, operands, mask, immediate);
        };
        match step.form {
            Form::Commutative if memory == Some(0) => {
                vector((to, register(b), a), 0, step.immediate);
            }
            Form::Binary | Form::Commutative => vector((to, register(a), b), 0, step.immediate),
            Form::Registers if step.count == 2 => vector((to, register(a), b), 0, step.immediate),
            Form::Unary | Form::Registers => vector((to, 0, a), 0, step.immediate),
            Form::Reverse => vector((register(a), 0, Operand::Register(to)), 0, step.immediate),
            Form::Extended(number) => vector((number, to, a), 0, step.immediate),
            Form::Rounding(how) => self.assembler.rounding(step.op, (to, register(a), b), how),
            Form::Blend if encoding == Encoding::Evex => {
                vector((to, register(c), b), register(a), step.immediate);
            }
            Form::Blend => vector((to, register(c), b), 0, Some(register(a) << 4)),
            Form::OfMasks => {
                let (second, rm) = match step.count {
                    2 => (register(a), b),
                    _ => (0, a),
                };
                let operands = (to, second, rm);
                self.assembler
                    .mask(step.op, operands, step.count == 2, step.immediate);
            }
            Form::OfLanes => {
                let behind = 2 * i32::from(step.subgroup) + step.half.unwrap_or(0);
                let lanes = Operand::Memory(Memory::At(Base::Lanes, behind));
                match encoding {
                    Encoding::Vex => vector((to, 0, lanes), 0, None),
                    Encoding::Evex => self.assembler.mask(step.op, (to, 0, lanes), false, None),
                }
            }
            Form::Zeroing => vector((to, register(b), c), register(a) | ZEROING, step.immediate),
            Form::OfVote(vote) => self.vote(to, register(a), vote),
            Form::OfBits => {
                let lanes = [a, b].map(register);
                self.bits(to, &lanes[..step.count]);
            }
            Form::OfFirst => {
                let lanes = [a, b].map(register);
                self.first_lane(to, &lanes[..step.count]);
            }
            Form::Gather(spread) => {
                let steps = (step.count == 3).then_some((spread, c));
                return self.gather(step, to, [register(a), register(b)], steps);
            }
            Form::Scatter(steps) => {
                return self.scatter(step, to, operands.map(register), steps.map(Memory::Pool));
            }
            Form::InOrder => return self.in_order(step, to, [a, b].map(register)),
            Form::LoadOne { first, last } => {
                return self.load_one(step, to, register(a), [first, last]);
            }
            Form::LoadNext(before) => self.load_next(to, before),
            Form::LoadRow(row) => self.load_row(step, to, row, register(a)),
            Form::StoreRow(row) => self.store_row(step, (to, row), operands.map(register)),
            Form::GatherRows => self.gather_rows(step, to, [a, b].map(register)),
            Form::ScatterRows => return self.scatter_rows(step, to, operands.map(register)),
            Form::Leave => self.leave(step, to, register(a), register(b)),
            _ => unreachable!("has its own function"),
        }
        Ok(())
    }

    /// `a * b + c` in the place of an operand that is used no more, or of a copy.
    fn multiply_add(
        &mut self,
        step: &Step,
        [a, b, c]: [Operand; 3],
        memory: Option<usize>,
        dying: [bool; 3],
    ) -> Result<(), TooManyLive> {
        let from = step.from;
        // The one to be overwritten, and whether it is the sum's.
        let (place, is_sum) = match (memory, dying) {
            (Some(2), [true, ..]) => (0, false),
            (Some(2), [_, true, _]) => (1, false),
            (Some(2), _) => (0, false),
            (_, [_, _, true]) | (Some(_), _) => (2, true),
            (None, [true, ..]) => (0, false),
            (None, [_, true, _]) => (1, false),
            _ => (2, true),
        };
        let operands = [a, b, c];
        let register = |k: usize| match operands[k] {
            Operand::Register(register) => register,
            Operand::Memory(_) => unreachable!("in a register"),
        };
        let at = register(place);
        let overwrites = dying[place];
        for k in 0..3 {
            // One that is overwritten changes hands below.
            if dying[k] && from[k] != from[place] {
                self.release(from[k]);
            }
        }
        let to = match overwrites {
            true => {
                self.registers[from[place] as usize] = None;
                self.held.retain(|&held| held != from[place]);
                self.put(step.to, at);
                at
            }
            false => {
                // None of the operands' registers, even of those that die: they are read behind the
                // copy.
                let free = self.take_apart(step.to, &from, &operands)?;
                let moved = (free, 0, Operand::Register(at));
                self.assembler.vector(MOVE, moved, 0, None);
                free
            }
        };
        let (op, second, rm) = match is_sum {
            true if memory == Some(0) => (MULTIPLY_ADD_231, 1, 0),
            true => (MULTIPLY_ADD_231, 0, 1),
            false => (MULTIPLY_ADD_213, 1 - place, 2),
        };
        let op = Opcode {
            byte: op.byte,
            ..step.op
        };
        let written = (to, register(second), operands[rm]);
        self.assembler.vector(op, written, 0, None);
        Ok(())
    }

    /// A register for a result that is none of the operands'.
    fn take_apart(
        &mut self,
        value: Virtual,
        from: &[Virtual],
        operands: &[Operand; 3],
    ) -> Result<Register, TooManyLive> {
        let is_operand = |r: Register| {
            (operands.iter()).any(|&o| matches!(o, Operand::Register(other) if other == r))
        };
        let set_aside: Vec<Register> = (self.vectors.iter().copied())
            .filter(|&r| is_operand(r))
            .collect();
        self.vectors.retain(|&r| !is_operand(r));
        let taken = self.take(value, from);
        self.vectors.extend(set_aside);
        taken
    }

    fn is_to_be_stored(&self, value: Virtual) -> bool {
        self.values[value as usize].keep && self.results.contains(&value)
    }

    /// After an operation: stores kept values and forgets unused ones.
    fn end_operation(&mut self) -> Result<(), TooManyLive> {
        for value in std::mem::take(&mut self.results) {
            if self.values[value as usize].keep {
                self.store(value)?;
            }
            if self.next[value as usize] == NEVER {
                self.release(value);
            }
        }
        Ok(())
    }

    /// The register of a value, which is loaded if it has none.
    fn bring(&mut self, value: Virtual, from: &[Virtual]) -> Result<Register, TooManyLive> {
        if let Some(register) = self.registers[value as usize] {
            return Ok(register);
        }
        let register = self.take(value, from)?;
        let home = self.values[value as usize].home.ok_or(TooManyLive)?;
        // Values for all turns are on the stack, too.
        let own = self.outside.map_or(0, |outside| outside.stack_bytes);
        self.spills += matches!(home, Memory::At(Base::Stack, at) if at >= own) as usize;
        let info = self.values[value as usize];
        self.read_home(&info, register)?;
        Ok(register)
    }

    /// Loads a value from its place in memory.
    fn read_home(&mut self, info: &Info, register: Register) -> Result<(), TooManyLive> {
        let home = Operand::Memory(info.home.ok_or(TooManyLive)?);
        match info.class {
            Class::Vector => self.assembler.vector(LOAD, (register, 0, home), 0, None),
            Class::Mask => {
                self.assembler.vector(LOAD, (SCRATCH, 0, home), 0, None);
                let scratch = Operand::Register(SCRATCH);
                self.assembler
                    .vector(VECTOR_TO_MASK, (register, 0, scratch), 0, None);
            }
        }
        Ok(())
    }

    /// Stores a value to its place in memory.
    fn write_home(&mut self, info: &Info, register: Register) -> Result<(), TooManyLive> {
        let home = info.home.ok_or(TooManyLive)?;
        let from = match info.class {
            Class::Vector => register,
            Class::Mask => {
                let mask = Operand::Register(register);
                self.assembler
                    .vector(MASK_TO_VECTOR, (SCRATCH, 0, mask), 0, None);
                SCRATCH
            }
        };
        self.assembler
            .vector(STORE, (from, 0, Operand::Memory(home)), 0, None);
        Ok(())
    }

    /// A register for a value; operands of the step, `from`, stay where they are.
    fn take(&mut self, value: Virtual, from: &[Virtual]) -> Result<Register, TooManyLive> {
        let class = self.values[value as usize].class;
        let free = match class {
            Class::Vector => &mut self.vectors,
            Class::Mask => &mut self.masks,
        };
        let preferred = self.preferred.iter().find(|&&(other, _)| other == value);
        let place = preferred.and_then(|&(_, best)| free.iter().position(|&r| r == best));
        let register = match place.map(|place| free.remove(place)).or_else(|| free.pop()) {
            Some(register) => register,
            None => {
                let can_leave = |&&other: &&Virtual| {
                    let info = &self.values[other as usize];
                    // The row of a result may still be an operand's.
                    let has_place = match info.home {
                        None | Some(Memory::At(Base::Stack, _)) => self.may_spill,
                        Some(_) => !self.results.contains(&other),
                    };
                    info.class == class && has_place && !from.contains(&other)
                };
                let last = (self.held.iter())
                    .filter(can_leave)
                    .max_by_key(|&&other| self.next[other as usize]);
                let &last = last.ok_or(TooManyLive)?;
                self.give_home(last)?;
                if !self.values[last as usize].is_home {
                    self.evictions += 1;
                    self.store(last)?;
                }
                let register = self.registers[last as usize].take().ok_or(TooManyLive)?;
                self.held.retain(|&held| held != last);
                register
            }
        };
        self.put(value, register);
        Ok(register)
    }

    /// A place of the stack for a value that has none in memory.
    fn give_home(&mut self, value: Virtual) -> Result<(), TooManyLive> {
        let info = &mut self.values[value as usize];
        if info.home.is_none() {
            info.home = Some(Memory::At(Base::Stack, self.stack_bytes));
            self.stack_bytes += self.assembler.encoding.vector_bytes();
            self.spills += 1;
        }
        match self.stack_bytes <= MOST_STACK_BYTES {
            true => Ok(()),
            false => Err(TooManyLive),
        }
    }

    /// A value for no longer than a step.
    fn temporary(&mut self, class: Class) -> Virtual {
        self.values.push(Info {
            class,
            home: None,
            is_home: false,
            keep: false,
        });
        self.registers.push(None);
        self.next.push(NEVER);
        self.values.len() as Virtual - 1
    }

    fn put(&mut self, value: Virtual, register: Register) {
        self.registers[value as usize] = Some(register);
        self.held.push(value);
    }

    /// Frees a value's register.
    fn release(&mut self, value: Virtual) {
        let Some(register) = self.registers[value as usize].take() else {
            return;
        };
        self.held.retain(|&held| held != value);
        match self.values[value as usize].class {
            Class::Vector => self.vectors.push(register),
            Class::Mask => self.masks.push(register),
        }
    }

    fn store(&mut self, value: Virtual) -> Result<(), TooManyLive> {
        let info = &mut self.values[value as usize];
        let register = self.registers[value as usize].ok_or(TooManyLive)?;
        info.is_home = true;
        let info = *info;
        self.write_home(&info, register)
    }
}
