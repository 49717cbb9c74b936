//! The code of a loop around its turns: entry, the next turn, suspension, the next subgroups.

use super::exits::{drop_exits, ordered};
use super::skips::bounds_skip;
use super::turns::Turns;
use super::weave::{chains, emit_frames, waits};
use super::{Form, Info, without_unused};
use crate::native::allocate::{
    Carried, LOAD, Outside, STORE, Step, Turn, allocate_turn, jump_without,
};
use crate::native::encode::{
    Assembler, Constant, Encoding, Memory, NOT_NEGATIVE, Operand, Register, ZERO,
};
use crate::native::opcodes::*;
use crate::native::{LoopContext, Own, STAYING};

/// Instructions, at least, of a turn of several subgroups for each that moves a value to or from
/// the stack.
const STEPS_OF_SPILL: usize = 8;

/// Instructions, at least, of a turn whose subgroups and halves take its operations in turn, for
/// each that moves a value to or from memory.
const STEPS_OF_MOVE: usize = 16;

impl Turns {
    /// The code: see [`LoopCode`](crate::native::LoopCode). Each turn of a subgroup takes twice
    /// `fuel`. `None`: more values live at once than there are registers and rows for, or several
    /// subgroups have too few registers.
    pub fn assemble(mut self, fuel: u32) -> Option<Vec<u8>> {
        let mut a = Assembler::new(self.stretch.encoding);
        let stack_size = emit_entry(&mut a);
        let start = a.bytes.len();
        self.emit_pointers(&mut a);
        let half = a.bytes.len();
        let is_constant = self.settle_lanes();
        self.settle_skips();
        let is_tested = self.settle_exits(is_constant);
        let mut ends = Vec::new();
        if self.halves() == 1 && is_constant {
            // Lanes of no half but the subgroup's: cmp byte [r10], 0; je
            a.bytes.extend([0x41, 0x80, 0x3a, 0]);
            ends.push(a.jump_ahead(ZERO));
        }
        let turn = self.emit_turn(&mut a)?;
        ends.extend(turn.exits);
        if !is_constant && !is_tested {
            ends.push(self.jump_without_lanes(&mut a)?);
        }
        // sub r11, the turn's fuel
        a.bytes.extend([0x49, 0x81, 0xeb]);
        a.bytes.extend((fuel * self.halves()).to_le_bytes());
        let next = a.jump_ahead(NOT_NEGATIVE);
        a.land_at(next, turn.head);
        self.emit_rows(&mut a);
        ends.into_iter().for_each(|jump| a.land(jump));
        self.emit_next_subgroups(&mut a, [start, half]);
        emit_return(&mut a, turn.stack_bytes);
        a.bytes[stack_size..stack_size + 4].copy_from_slice(&turn.stack_bytes.to_le_bytes());
        Some(a.finish(&self.stretch.pool))
    }

    /// The rows of the subgroups that take a turn together.
    fn emit_pointers(&self, a: &mut Assembler) {
        if self.halves() == 1 {
            // mov r8, rdi; mov r9, rdi; mov eax, 2
            a.bytes
                .extend([0x49, 0x89, 0xf8, 0x49, 0x89, 0xf9, 0xb8, 2, 0, 0, 0]);
        }
        emit_frames(a, self.subgroups);
    }

    /// Writes the beginning of the first turn, and a turn.
    fn emit_turn(&mut self, a: &mut Assembler) -> Option<Turn> {
        let (halves, subgroups) = (self.halves() as usize, self.subgroups);
        let bits = self.stretch.constant(Constant::LaneBits);
        let bits = self.stretch.infos[bits as usize].home?;
        let mut is_used: Vec<bool> = self.stretch.infos.iter().map(|info| info.keep).collect();
        for value in &self.carried {
            is_used[value.after as usize] = true;
        }
        let steps = without_unused(std::mem::take(&mut self.stretch.steps), is_used);
        let (mut steps, stack_bytes) = self.hoist(steps, a);
        let infos = std::mem::take(&mut self.stretch.infos);
        let is_long = subgroups > 2 && self.stretch.encoding == Encoding::Vex;
        if is_long && !gains_by_four(&steps, infos.len(), halves) {
            return None;
        }
        let outside = Outside {
            bits,
            exits: &self.exits,
            stack_bytes,
        };
        if steps.iter().any(|step| bounds_skip(step.form)) {
            let (mut carried, mut attempt) = (self.carried.clone(), a.clone());
            let written = self.write_turn(&steps, &infos, &mut carried, outside, &mut attempt);
            if let Some(turn) = written {
                (self.carried, *a) = (carried, attempt);
                return Some(turn);
            }
            drop_exits(&mut steps, bounds_skip);
        }
        let mut carried = self.carried.clone();
        let turn = self.write_turn(&steps, &infos, &mut carried, outside, a);
        self.carried = carried;
        turn
    }

    /// Writes the steps of a turn in the better order.
    fn write_turn(
        &self,
        steps: &[Step],
        infos: &[Info],
        carried: &mut Vec<Carried>,
        outside: Outside<'_>,
        a: &mut Assembler,
    ) -> Option<Turn> {
        let (halves, subgroups) = (self.halves() as usize, self.subgroups);
        let is_long = subgroups > 2 && self.stretch.encoding == Encoding::Vex;
        let waits = self.is_paired && waits(steps, infos.len(), halves);
        let woven = match waits {
            true => ordered(steps, infos.len(), subgroups, true),
            false => None,
        };
        if let Some(steps) = woven {
            let (mut other, mut attempt) = (carried.clone(), a.clone());
            let turn = allocate_turn(&steps, infos.to_vec(), &mut other, outside, &mut attempt);
            if let Ok(turn) = turn
                && (turn.spills + turn.evictions) * STEPS_OF_MOVE <= steps.len()
            {
                (*carried, *a) = (other, attempt);
                return Some(turn);
            }
        }
        if waits && is_long {
            // Two subgroups in turn wait less than four one after another.
            return None;
        }
        let steps = ordered(steps, infos.len(), subgroups, false)?;
        let turn = allocate_turn(&steps, infos.to_vec(), carried, outside, a).ok()?;
        let moves = match is_long {
            true => (turn.spills + turn.evictions) * STEPS_OF_MOVE,
            false => turn.spills * STEPS_OF_SPILL,
        };
        (subgroups == 1 || moves <= steps.len()).then_some(turn)
    }

    /// Lanes that take the loop, by half.
    fn masks(&self) -> impl Iterator<Item = &Carried> {
        self.carried.iter().filter(|value| value.lanes.is_some())
    }

    /// A jump that is taken where no lane takes the next turn.
    fn jump_without_lanes(&self, a: &mut Assembler) -> Option<usize> {
        let lanes: Option<Vec<Register>> = self.masks().map(|value| value.register).collect();
        jump_without(a, &lanes?)
    }

    /// The fuel is out: writes the values for the next turn to their rows, and the lanes that take
    /// it.
    fn emit_rows(&self, a: &mut Assembler) {
        for value in &self.carried {
            let Some(register) = value.register else {
                continue;
            };
            let rows: &[Memory] = match &value.alike {
                Some(alike) => &alike.rows,
                None => value.home.as_slice(),
            };
            for &row in rows {
                a.vector(STORE, (register, 0, Operand::Memory(row)), 0, None);
            }
        }
        for value in self.masks() {
            const EBX: u8 = 3;
            let from = value.lanes.map_or(0, |lanes| lanes as u8);
            let at = STAYING as u8 + from;
            match (value.register, a.encoding) {
                (Some(lanes), Encoding::Evex) => {
                    a.mask(KMOV_OUT, (EBX, 0, Operand::Register(lanes)), false, None);
                    // mov [r10 + at], bx
                    a.bytes.extend([0x66, 0x41, 0x89, 0x5a, at]);
                    continue;
                }
                (Some(lanes), Encoding::Vex) => {
                    a.vector(MOVMSKPS, (EBX, 0, Operand::Register(lanes)), 0, None);
                }
                // All that came: mov bx, [r10 + from]; mov [r10 + at], bx
                (None, Encoding::Evex) => {
                    a.bytes.extend([0x66, 0x41, 0x8b, 0x5a, from]);
                    a.bytes.extend([0x66, 0x41, 0x89, 0x5a, at]);
                    continue;
                }
                // The same of a half: mov bl, [r10 + from]
                (None, Encoding::Vex) => a.bytes.extend([0x41, 0x8a, 0x5a, from]),
            }
            // mov [r10 + at], bl
            a.bytes.extend([0x41, 0x88, 0x5a, at]);
        }
        // No register holds anything any more.
        for value in &self.carried {
            if let (None, Some(home), Some(alike)) = (value.register, value.home, &value.alike)
                && !alike.rows.contains(&home)
            {
                a.vector(LOAD, (0, 0, Operand::Memory(home)), 0, None);
                for &row in &alike.rows {
                    a.vector(STORE, (0, 0, Operand::Memory(row)), 0, None);
                }
            }
        }
    }

    /// Jumps to `start` for the next subgroups, or to `half` for the second half of this one.
    fn emit_next_subgroups(&self, a: &mut Assembler, [start, half]: [usize; 2]) {
        let (halves, subgroups) = (self.halves(), self.subgroups);
        // add r10, a byte for each eight lanes
        a.bytes.extend([0x49, 0x83, 0xc2, halves as u8]);
        if halves == 1 {
            // add r8, 32; add r9, 64; dec eax
            a.bytes
                .extend([0x49, 0x83, 0xc0, 32, 0x49, 0x83, 0xc1, 64, 0xff, 0xc8]);
            a.jump_if_not_zero(half);
        }
        if self.takes_own {
            // add qword [r14 + own], that of the subgroups
            a.bytes.extend([0x49, 0x83, 0x86]);
            a.bytes.extend(LoopContext::OWN.to_le_bytes());
            a.bytes.push((size_of::<Own>() * subgroups) as u8);
        }
        // lea rdi, [rdi + subgroups * rcx]; dec rdx
        let scale = subgroups.trailing_zeros() as u8;
        a.bytes
            .extend([0x48, 0x8d, 0x3c, scale << 6 | 0x0f, 0x48, 0xff, 0xca]);
        a.jump_if_not_zero(start);
    }
}

/// Saves registers and makes room on the stack. Gives the place of the room's size in bytes.
fn emit_entry(a: &mut Assembler) -> usize {
    // push rbx; push rbp; push r13; push r14
    a.bytes.extend([0x53, 0x55, 0x41, 0x55, 0x41, 0x56]);
    // sub rsp, bytes of the stack; lea rbp, [rsp + 63]; and rbp, -64
    a.bytes.extend([0x48, 0x81, 0xec]);
    let stack_size = a.bytes.len();
    a.bytes.extend([0; 4]);
    a.bytes
        .extend([0x48, 0x8d, 0x6c, 0x24, 63, 0x48, 0x83, 0xe5, 0xc0]);
    // mov r14, r9; mov r11, [r14]; mov r10, r8
    a.bytes.extend([0x4d, 0x89, 0xce]);
    a.bytes.extend([0x4d, 0x8b, 0x1e, 0x4d, 0x89, 0xc2]);
    stack_size
}

/// Restores registers and returns.
fn emit_return(a: &mut Assembler, stack_bytes: i32) {
    // mov [r14], r11; add rsp, bytes of the stack; pop r14; pop r13; pop rbp; pop rbx
    a.bytes.extend([0x4d, 0x89, 0x1e, 0x48, 0x81, 0xc4]);
    a.bytes.extend(stack_bytes.to_le_bytes());
    a.bytes.extend([0x41, 0x5e, 0x41, 0x5d, 0x5d, 0x5b]);
    // vzeroupper; ret
    a.bytes.extend([0xc5, 0xf8, 0x77, 0xc3]);
}

/// Whether four subgroups have more operations to take in turn than two, with AVX2.
fn gains_by_four(steps: &[Step], values: usize, halves: usize) -> bool {
    // Those take the register of the fourth frame.
    let has_other_use = |step: &Step| {
        matches!(
            step.form,
            Form::OfBits | Form::OfFirst | Form::ScatterRows | Form::Scatter(_) | Form::OfVote(_)
        )
    };
    !steps.iter().any(has_other_use) && chains(steps, values, halves) as usize > halves / 2
}
