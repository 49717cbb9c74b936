//! Ends of loops: those that all lanes come to at once, and those where no lane is left.

use super::words::enter;
use super::*;
use crate::native::encode::{NOT_ZERO, ZERO};
use crate::native::opcodes::*;

/// A value that lanes take along when they leave.
#[derive(Clone, Copy)]
pub(in crate::native) struct Left {
    pub value: Virtual,
    /// The row that it goes to.
    pub row: Memory,
    /// The mask of lanes that take the loop is so many bytes behind the first one.
    pub mask: i32,
    /// These lanes as a condition, unless they are those that came to the loop.
    pub lanes: Option<Virtual>,
    /// The lower or the upper lanes of a register, where they have 64 bits.
    pub part: Option<usize>,
}

/// A place in a turn where a loop ends.
#[derive(Clone)]
pub(in crate::native) enum Exit {
    /// All lanes leave at once with these values.
    All(Vec<Left>),
    /// These are all lanes that are still in the loop, as conditions, and there are none.
    Without(Vec<Virtual>),
}

impl Exit {
    /// The values that lanes take along.
    pub fn left(&self) -> &[Left] {
        match self {
            Exit::All(left) => left,
            Exit::Without(_) => &[],
        }
    }

    /// The same, to be changed.
    pub fn left_mut(&mut self) -> &mut [Left] {
        match self {
            Exit::All(left) => left,
            Exit::Without(_) => &mut [],
        }
    }
}

/// Vector registers that code behind a jump out of the loop may overwrite, with AVX2.
struct Scratch {
    mask: Register,
    part: Register,
}

impl Scratch {
    /// The lanes that take a value along. `own`: these lanes as a condition, and whether `mask` has
    /// them already.
    fn lanes(
        &self,
        a: &mut Assembler,
        left: &Left,
        own: (Option<Operand>, bool),
        bits: Memory,
    ) -> Register {
        let &Scratch { mask, part, .. } = self;
        let lanes = match own {
            (Some(Operand::Register(lanes)), _) => lanes,
            (_, true) => mask,
            (Some(memory), _) => {
                a.vector(LOAD, (mask, 0, memory), 0, None);
                mask
            }
            (None, _) => {
                enter(a, mask, left.mask, bits);
                mask
            }
        };
        match left.part {
            None => lanes,
            Some(0) => {
                a.vector(PMOVSXDQ, (part, 0, Operand::Register(lanes)), 0, None);
                part
            }
            Some(_) => {
                let upper = Operand::Register(part);
                a.vector(EXTRACT_128, (lanes, 0, upper), 0, Some(1));
                a.vector(PMOVSXDQ, (part, 0, upper), 0, None);
                part
            }
        }
    }
}

/// A jump that is taken where no lane is in any of the registers.
pub(in crate::native) fn jump_without(a: &mut Assembler, lanes: &[Register]) -> Option<usize> {
    let mut some = Vec::new();
    let mut none = None;
    for (k, &register) in lanes.iter().enumerate() {
        let rm = Operand::Register(register);
        match a.encoding {
            Encoding::Vex => a.vector(TESTPS, (register, 0, rm), 0, None),
            Encoding::Evex => a.mask(KORTESTW, (register, 0, rm), false, None),
        }
        match k + 1 < lanes.len() {
            true => some.push(a.jump_ahead(NOT_ZERO)),
            false => none = Some(a.jump_ahead(ZERO)),
        }
    }
    some.into_iter().for_each(|jump| a.land(jump));
    none
}

impl Allocation<'_> {
    /// Leaves the loop where a condition of all lanes is `when`. Code behind the jump may overwrite
    /// all registers, except those of values that it writes.
    pub(super) fn exit(
        &mut self,
        step: &Step,
        (index, when): (usize, bool),
        after: [u32; 3],
    ) -> Result<(), TooManyLive> {
        let condition = step.from[0];
        let tested = self.bring(condition, &[condition])?;
        let outside = self.outside.ok_or(TooManyLive)?;
        let left = outside.exits[index].left();
        let a = &mut *self.assembler;
        let operands = (tested, 0, Operand::Register(tested));
        match a.encoding {
            Encoding::Vex => a.vector(step.op, operands, 0, None),
            Encoding::Evex => a.mask(step.op, operands, false, None),
        }
        let stay = a.jump_ahead(if when { ZERO } else { NOT_ZERO });
        match a.encoding {
            Encoding::Vex => self.take_along(left, outside.bits)?,
            Encoding::Evex => self.take_along_by_masks(left, outside.bits)?,
        }
        let a = &mut *self.assembler;
        self.exits.push(a.jump());
        a.land(stay);
        self.next[condition as usize] = after[0];
        if after[0] == NEVER {
            self.release(condition);
        }
        Ok(())
    }

    /// Ends the loop where all lanes have left it.
    pub(super) fn exit_without(&mut self, index: usize) -> Result<(), TooManyLive> {
        let registers = self.lanes_of_exit(index)?;
        let none = jump_without(self.assembler, &registers);
        self.exits.extend(none);
        Ok(())
    }

    /// The registers of all subgroups' lanes. They are brought there before the first jump, so that
    /// all jumps find the same registers.
    pub(super) fn lanes_of_exit(&mut self, index: usize) -> Result<Vec<Register>, TooManyLive> {
        let outside = self.outside.ok_or(TooManyLive)?;
        let Exit::Without(lanes) = &outside.exits[index] else {
            return Err(TooManyLive);
        };
        (lanes.iter())
            .map(|&value| self.bring(value, lanes))
            .collect()
    }

    /// Registers of a class that hold none of the values that lanes take along, nor their lanes.
    fn unread<const N: usize>(
        &self,
        left: &[Left],
        class: Class,
        mut all: std::ops::Range<Register>,
    ) -> Result<[Register; N], TooManyLive> {
        let is_read = |r: Register| {
            let values = left.iter().flat_map(|left| [Some(left.value), left.lanes]);
            values.flatten().any(|value| {
                self.values[value as usize].class == class
                    && self.registers[value as usize] == Some(r)
            })
        };
        let mut unread = [0; N];
        for register in &mut unread {
            *register = all.find(|&r| !is_read(r)).ok_or(TooManyLive)?;
        }
        Ok(unread)
    }

    /// Where a value is that lanes take along.
    fn found(&self, left: &[Left], value: Virtual) -> Result<Operand, TooManyLive> {
        if let Some(register) = self.registers[value as usize] {
            return Ok(Operand::Register(register));
        }
        let info = &self.values[value as usize];
        let home = info.home.filter(|_| info.is_home).ok_or(TooManyLive)?;
        // That one is written here.
        let is_written = |left: &Left| left.row == home && left.value != value;
        match left.iter().any(is_written) {
            true => Err(TooManyLive),
            false => Ok(Operand::Memory(home)),
        }
    }

    /// Writes the values that lanes take along, with AVX2.
    fn take_along(&mut self, all: &[Left], bits: Memory) -> Result<(), TooManyLive> {
        let [mask, part, old] = self.unread(all, Class::Vector, 0..16)?;
        let scratch = Scratch { mask, part };
        let mut current = None;
        for left in all {
            let own = left.lanes.map(|lanes| self.found(all, lanes)).transpose()?;
            let new = self.found(all, left.value)?;
            let a = &mut *self.assembler;
            let lanes = scratch.lanes(a, left, (own, current == Some(left.mask)), bits);
            current = Some(left.mask);
            let row = Operand::Memory(left.row);
            if matches!(new, Operand::Memory(home) if home == left.row) {
                continue;
            }
            a.vector(LOAD, (old, 0, row), 0, None);
            a.vector(BLENDVPS, (old, old, new), 0, Some(lanes << 4));
            a.vector(STORE, (old, 0, row), 0, None);
        }
        Ok(())
    }

    /// Writes the values that lanes take along, with AVX-512.
    fn take_along_by_masks(&mut self, all: &[Left], bits: Memory) -> Result<(), TooManyLive> {
        // `k0` means no mask.
        let [mask, part] = self.unread(all, Class::Mask, 1..8)?;
        let scratch = Operand::Register(SCRATCH);
        let mut current = None;
        for left in all {
            let own = left.lanes.map(|lanes| self.found(all, lanes)).transpose()?;
            let new = self.found(all, left.value)?;
            let is_mask = self.values[left.value as usize].class == Class::Mask;
            let a = &mut *self.assembler;
            let lanes = match own {
                Some(Operand::Register(lanes)) => lanes,
                _ if current == Some(left.mask) => mask,
                Some(memory) => {
                    a.vector(LOAD, (SCRATCH, 0, memory), 0, None);
                    a.vector(VECTOR_TO_MASK, (mask, 0, scratch), 0, None);
                    mask
                }
                None => {
                    enter(a, mask, left.mask, bits);
                    mask
                }
            };
            current = Some(left.mask);
            let row = Operand::Memory(left.row);
            let from = match new {
                Operand::Memory(home) if home == left.row => continue,
                Operand::Memory(_) => {
                    a.vector(LOAD, (SCRATCH, 0, new), 0, None);
                    SCRATCH
                }
                Operand::Register(_) if is_mask => {
                    a.vector(MASK_TO_VECTOR, (SCRATCH, 0, new), 0, None);
                    SCRATCH
                }
                Operand::Register(register) => register,
            };
            match left.part {
                None => a.vector(STORE, (from, 0, row), lanes, None),
                Some(0) => a.vector(STORE_WIDE, (from, 0, row), lanes, None),
                Some(_) => {
                    let lanes = Operand::Register(lanes);
                    a.mask(KSHIFTRW, (part, 0, lanes), false, Some(8));
                    a.vector(STORE_WIDE, (from, 0, row), part, None);
                }
            }
        }
        Ok(())
    }
}
