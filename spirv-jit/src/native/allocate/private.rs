//! Private rows of the subgroups of a loop.

use super::words::{first_word, store_all};
use super::*;
use crate::native::encode::{NOT_CARRY, NOT_ZERO};
use crate::native::opcodes::*;
use crate::native::{LoopContext, Own};

/// Bytes of a register with [`Encoding::Vex`].
const HALF_BYTES: i32 = 32;

impl Allocation<'_> {
    /// `r13` = the first private row of the step's subgroup.
    fn private(&mut self, step: &Step) {
        own(
            self.assembler,
            step.subgroup,
            std::mem::offset_of!(Own, private),
        );
    }

    /// The row of a step in memory, and where code jumps from if there is none. `fixed`: its
    /// number.
    fn row(&mut self, step: &Step, fixed: Option<u32>, row: Register) -> (Operand, Option<usize>) {
        self.private(step);
        let half = step.half.unwrap_or(0) * HALF_BYTES;
        if let Some(row) = fixed {
            let row = Memory::At(Base::Private, row as i32 * 64 + half);
            return (Operand::Memory(row), None);
        }
        let a = &mut *self.assembler;
        first_word(a, row);
        // cmp ebx, [r14 + private rows]
        a.bytes.extend([0x41, 0x3b, 0x9e]);
        a.bytes.extend(LoopContext::PRIVATE_ROWS.to_le_bytes());
        let none = a.jump_ahead(NOT_CARRY);
        // shl rbx, 6; add rbx, r13
        a.bytes.extend([0x48, 0xc1, 0xe3, 6, 0x4c, 0x01, 0xeb]);
        (Operand::Memory(Memory::At(Base::Word, half)), Some(none))
    }

    /// Loads a row; zeros if it does not exist.
    pub(super) fn load_row(
        &mut self,
        step: &Step,
        to: Register,
        fixed: Option<u32>,
        row: Register,
    ) {
        let (row, none) = self.row(step, fixed, row);
        let a = &mut *self.assembler;
        a.vector(LOAD, (to, 0, row), 0, None);
        if let Some(none) = none {
            let done = a.jump();
            a.land(none);
            a.vector(PXOR, (to, to, Operand::Register(to)), 0, None);
            a.land(done);
        }
    }

    /// Stores to a row in some lanes, if it exists.
    pub(super) fn store_row(
        &mut self,
        step: &Step,
        (to, fixed): (Register, Option<u32>),
        [lanes, value, row]: [Register; 3],
    ) {
        let (row, none) = self.row(step, fixed, row);
        let a = &mut *self.assembler;
        match a.encoding {
            Encoding::Evex => a.vector(STORE, (value, 0, row), lanes, None),
            Encoding::Vex => {
                a.vector(LOAD, (to, 0, row), 0, None);
                let new = Operand::Register(value);
                a.vector(BLENDVPS, (to, to, new), 0, Some(lanes << 4));
                a.vector(STORE, (to, 0, row), 0, None);
            }
        }
        if let Some(none) = none {
            a.land(none);
        }
    }

    /// Loads lanes' words at places from the first row on.
    pub(super) fn gather_rows(&mut self, step: &Step, to: Register, [place, lanes]: [Register; 2]) {
        self.private(step);
        let a = &mut *self.assembler;
        // mov rbx, r13
        a.bytes.extend([0x4c, 0x89, 0xeb]);
        a.vector(PXOR, (to, to, Operand::Register(to)), 0, None);
        a.gather(step.op, to, place, lanes);
    }

    /// Stores lanes' words at places from the first row on. The result's register is scratch.
    pub(super) fn scatter_rows(
        &mut self,
        step: &Step,
        to: Register,
        [place, lanes, value]: [Register; 3],
    ) -> Result<(), TooManyLive> {
        self.private(step);
        if self.assembler.encoding == Encoding::Evex {
            let a = &mut *self.assembler;
            // mov rbx, r13
            a.bytes.extend([0x4c, 0x89, 0xeb]);
            a.gather(step.op, value, place, lanes);
            return Ok(());
        }
        const EAX: Register = 0;
        let [places, values] = self.aside()?;
        let a = &mut *self.assembler;
        let memory = |at| Operand::Memory(Memory::At(Base::Stack, at));
        a.vector(MOVMSKPS, (EAX, 0, Operand::Register(lanes)), 0, None);
        // cmp eax, 0xff
        a.bytes.extend([0x3d, 0xff, 0, 0, 0]);
        let some = a.jump_ahead(NOT_ZERO);
        store_all(a, to, [place, value]);
        let done = a.jump();
        a.land(some);
        a.vector(STORE, (place, 0, memory(places)), 0, None);
        a.vector(STORE, (value, 0, memory(values)), 0, None);
        for lane in 0..8 {
            // shr eax, 1
            a.bytes.extend([0xd1, 0xe8]);
            let not = a.jump_ahead(NOT_CARRY);
            store_word(a, places + 4 * lane, values + 4 * lane);
            a.land(not);
        }
        a.land(done);
        Ok(())
    }

    /// Two registers' worth of the stack, for no longer than a step.
    pub(super) fn aside(&mut self) -> Result<[i32; 2], TooManyLive> {
        let first = *self.aside.get_or_insert_with(|| {
            let first = self.stack_bytes;
            self.stack_bytes += 2 * HALF_BYTES;
            first
        });
        match self.stack_bytes <= MOST_STACK_BYTES {
            true => Ok([first, first + HALF_BYTES]),
            false => Err(TooManyLive),
        }
    }
}

/// `r13` = a field of memory of a subgroup's own.
pub(super) fn own(a: &mut Assembler, subgroup: u8, field: usize) {
    // mov r13, [r14 + own]; mov r13, [r13 + the subgroup's + field]
    a.bytes.extend([0x4d, 0x8b, 0xae]);
    a.bytes.extend(LoopContext::OWN.to_le_bytes());
    let at = subgroup as usize * size_of::<Own>() + field;
    a.bytes.extend([0x4d, 0x8b, 0x6d, at as u8]);
}

/// Stores a word at a place behind `r13`; both lie on the stack.
fn store_word(a: &mut Assembler, place: i32, value: i32) {
    // mov ebx, [rbp + place]
    a.bytes.extend([0x8b, 0x9d]);
    a.bytes.extend(place.to_le_bytes());
    // mov r9d, [rbp + value]
    a.bytes.extend([0x44, 0x8b, 0x8d]);
    a.bytes.extend(value.to_le_bytes());
    // mov [r13 + rbx], r9d
    a.bytes.extend([0x45, 0x89, 0x4c, 0x1d, 0]);
}
