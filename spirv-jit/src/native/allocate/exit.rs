//! Ends of loops that all lanes come to at once.

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
    /// The lower or the upper four lanes of a half, where they have 64 bits.
    pub quarter: Option<usize>,
}

/// A place in a turn where all lanes leave at once, and their values.
#[derive(Clone, Default)]
pub(in crate::native) struct Exit {
    pub left: Vec<Left>,
}

/// Registers that code behind a jump out of the loop may overwrite.
struct Scratch {
    mask: Register,
    quarter: Register,
    old: Register,
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
        let &Scratch { mask, quarter, .. } = self;
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
        match left.quarter {
            None => lanes,
            Some(0) => {
                a.vector(PMOVSXDQ, (quarter, 0, Operand::Register(lanes)), 0, None);
                quarter
            }
            Some(_) => {
                let upper = Operand::Register(quarter);
                a.vector(EXTRACT_128, (lanes, 0, upper), 0, Some(1));
                a.vector(PMOVSXDQ, (quarter, 0, upper), 0, None);
                quarter
            }
        }
    }
}

impl Allocation<'_> {
    /// Leaves the loop where a condition of all lanes is `when`. Code behind the jump may overwrite
    /// all registers but those of values that it writes.
    pub(super) fn exit(
        &mut self,
        step: &Step,
        (index, when): (usize, bool),
        after: [u32; 3],
    ) -> Result<(), TooManyLive> {
        let condition = step.from[0];
        let tested = self.bring(condition, &[condition])?;
        let outside = self.outside.ok_or(TooManyLive)?;
        let left = &outside.exits[index].left;
        let register = |value: Virtual| self.registers[value as usize];
        let is_read = |r: &Register| {
            left.iter().any(|left| {
                let values = [Some(left.value), left.lanes];
                values
                    .into_iter()
                    .flatten()
                    .any(|v| register(v) == Some(*r))
            })
        };
        let mut free = (0..16).filter(|r| !is_read(r));
        let mut take = || free.next().ok_or(TooManyLive);
        let scratch = Scratch {
            mask: take()?,
            quarter: take()?,
            old: take()?,
        };
        let old = scratch.old;
        let place = |value: Virtual| match register(value) {
            Some(register) => Ok(Operand::Register(register)),
            None => {
                let info = &self.values[value as usize];
                let home = info.home.filter(|_| info.is_home).ok_or(TooManyLive)?;
                // That one is written here.
                let is_written = |left: &Left| left.row == home && left.value != value;
                match left.iter().any(is_written) {
                    true => Err(TooManyLive),
                    false => Ok(Operand::Memory(home)),
                }
            }
        };
        let a = &mut *self.assembler;
        a.vector(TESTPS, (tested, 0, Operand::Register(tested)), 0, None);
        let stay = a.jump_ahead(if when { ZERO } else { NOT_ZERO });
        let mut current = None;
        for left in left {
            let own = left.lanes.map(place).transpose()?;
            let lanes = scratch.lanes(a, left, (own, current == Some(left.mask)), outside.bits);
            current = Some(left.mask);
            let row = Operand::Memory(left.row);
            let new = place(left.value)?;
            if matches!(new, Operand::Memory(home) if home == left.row) {
                continue;
            }
            a.vector(LOAD, (old, 0, row), 0, None);
            a.vector(BLENDVPS, (old, old, new), 0, Some(lanes << 4));
            a.vector(STORE, (old, 0, row), 0, None);
        }
        self.exits.push(a.jump());
        a.land(stay);
        self.next[condition as usize] = after[0];
        if after[0] == NEVER {
            self.release(condition);
        }
        Ok(())
    }
}
