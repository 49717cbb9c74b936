//! Registers of a loop: what one turn hands to the next stays in registers as far as those suffice,
//! and in its row of the frame where they do not.

use smallvec::SmallVec;

use super::words::{broadcast_word, enter};
use super::*;
use crate::SUBGROUP_SIZE;
use crate::native::encode::SCRATCH_WORD;
use crate::native::opcodes::*;

/// A value that a turn takes from the turn before.
#[derive(Clone)]
pub(in crate::native) struct Carried {
    /// In this turn, and what it is in the next.
    pub before: Virtual,
    pub after: Virtual,
    /// Lanes that are in the loop: the first turn's are the active ones, whose mask is so many
    /// bytes behind the first one.
    pub lanes: Option<i32>,
    /// The same in all lanes that are in the loop.
    pub alike: Option<Alike>,
    /// Where it is between two turns; `None`: in its place in memory.
    pub register: Option<Register>,
    /// Its place in memory.
    pub home: Option<Memory>,
}

impl Carried {
    pub fn new(before: Virtual, after: Virtual) -> Carried {
        Carried {
            before,
            after,
            lanes: None,
            alike: None,
            register: None,
            home: None,
        }
    }
}

/// A value that is the same in all lanes that are in the loop. When the loop is entered, code takes
/// it from the first of them into all lanes, those that are not in the loop, too: so they agree
/// from then on.
#[derive(Clone)]
pub(in crate::native) struct Alike {
    /// Where the first lane's scalar is.
    pub first: Memory,
    /// The scalars have 64 bits.
    pub is_wide: bool,
    /// Code takes one half after the other: masks have eight bits.
    pub is_half: bool,
    /// The mask of active lanes is so many bytes behind the first one.
    pub mask: i32,
    /// The register's rows in both halves, and in all subgroups for which it is the same.
    pub rows: SmallVec<[Memory; 2]>,
}

/// Of the stack's part of a loop.
const STACK_ALIGNMENT: i32 = 64;

/// Registers that are left to a turn's own values.
const LEFT: usize = 6;

/// A turn that is written.
pub(in crate::native) struct Turn {
    /// Where turns begin.
    pub head: usize,
    /// Of the stack.
    pub stack_bytes: i32,
    /// How often a value goes there or comes back.
    pub spills: usize,
    /// How often one leaves its register for memory.
    pub evictions: usize,
    /// Jumps to the end of the loop.
    pub exits: Vec<usize>,
}

/// The part of a loop that is outside of its turns.
#[derive(Clone, Copy)]
pub(in crate::native) struct Outside<'a> {
    /// The vector of lanes' bits in masks, for [`Encoding::Vex`].
    pub bits: Memory,
    pub exits: &'a [Exit],
    /// Of the stack, with values for all turns.
    pub stack_bytes: i32,
}

/// Writes the first turn's beginning, then the turn.
pub(in crate::native) fn allocate_turn(
    steps: &[Step],
    values: Vec<Info>,
    carried: &mut [Carried],
    outside: Outside<'_>,
    assembler: &mut Assembler,
) -> Result<Turn, TooManyLive> {
    let mut behind = vec![NEVER; values.len()];
    for value in &*carried {
        behind[value.after as usize] = steps.len() as u32;
    }
    let (after, first) = next_uses(steps, behind);
    let mut a = Allocation::new(values, first, assembler);
    a.may_spill = true;
    a.stack_bytes = outside.stack_bytes;
    a.outside = Some(outside);
    let mut uses = vec![0u32; a.values.len()];
    for step in steps {
        (step.from[..step.count].iter()).for_each(|&value| uses[value as usize] += 1);
    }
    let mut order: Vec<usize> = (0..carried.len()).collect();
    order.sort_by_key(|&k| {
        let value = &carried[k];
        (
            value.lanes.is_none(),
            u32::MAX - uses[value.before as usize],
        )
    });
    for k in order {
        let value = &mut carried[k];
        value.home = a.values[value.before as usize].home;
        let is_lanes = value.lanes.is_some();
        if is_lanes && is_unused(value, &uses) {
            continue;
        }
        let free = match a.values[value.before as usize].class {
            Class::Vector if a.vectors.len() > LEFT => &mut a.vectors,
            Class::Mask if is_lanes => &mut a.masks,
            _ if is_lanes => return Err(TooManyLive),
            _ => {
                a.give_home(value.before)?;
                value.home = a.values[value.before as usize].home;
                if let Some(alike) = &value.alike {
                    let free = *a.vectors.last().ok_or(TooManyLive)?;
                    let home = Operand::Memory(value.home.ok_or(TooManyLive)?);
                    level(a.assembler, free, alike);
                    a.assembler.vector(STORE, (free, 0, home), 0, None);
                    a.values[value.before as usize].is_home = true;
                }
                continue;
            }
        };
        let register = free.pop().ok_or(TooManyLive)?;
        value.register = Some(register);
        match (value.lanes, &value.alike) {
            (Some(half), _) => enter(a.assembler, register, half, outside.bits),
            (None, Some(alike)) => level(a.assembler, register, alike),
            (None, None) => {
                let home = Operand::Memory(value.home.ok_or(TooManyLive)?);
                a.assembler.vector(LOAD, (register, 0, home), 0, None);
            }
        }
        a.put(value.before, register);
        a.values[value.before as usize].is_home = false;
        a.preferred.push((value.after, register));
    }
    // Those that no step uses.
    for value in &*carried {
        if a.next[value.before as usize] == NEVER {
            a.release(value.before);
        }
    }
    let head = a.assembler.bytes.len();
    a.steps(steps, after)?;
    a.hand_on(carried)?;
    Ok(Turn {
        head,
        stack_bytes: a.stack_bytes + STACK_ALIGNMENT,
        spills: a.spills,
        evictions: a.evictions,
        exits: a.exits,
    })
}

/// Whether lanes stay the same from turn to turn and no step takes them. `uses`: by value.
fn is_unused(lanes: &Carried, uses: &[u32]) -> bool {
    lanes.before == lanes.after && uses[lanes.before as usize] == 0
}

/// The scalar of the first lane that is in the loop, in all lanes of a register.
fn level(a: &mut Assembler, to: Register, alike: &Alike) {
    let Memory::At(base, displacement) = alike.first else {
        unreachable!("a row of the frame");
    };
    let (load, top) = match alike.is_half {
        true => (0xb6, 1u32 << 7),
        false => (0xb7, 1 << 15),
    };
    // movzx ebx, [r10 + mask]; or ebx, the last lane; tzcnt ebx, ebx
    a.bytes.extend([0x41, 0x0f, load, 0x5a, alike.mask as u8]);
    a.bytes.extend([0x81, 0xcb]);
    a.bytes.extend(top.to_le_bytes());
    a.bytes.extend([0xf3, 0x0f, 0xbc, 0xdb]);
    a.lane_address(base, displacement, alike.is_wide);
    let first = Operand::Memory(Memory::At(Base::Word, 0));
    let broadcast = match (alike.is_wide, a.encoding) {
        (false, _) => PBROADCASTD,
        (true, Encoding::Vex) => PBROADCASTQ_VEX,
        (true, Encoding::Evex) => PBROADCASTQ,
    };
    a.vector(broadcast, (to, 0, first), 0, None);
}

/// A general register = a bit for each lane of a condition.
fn bits_of(a: &mut Assembler, to: Register, lanes: Register) {
    let lanes = Operand::Register(lanes);
    match a.encoding {
        Encoding::Vex => a.vector(MOVMSKPS, (to, 0, lanes), 0, None),
        Encoding::Evex => a.mask(KMOV_OUT, (to, 0, lanes), false, None),
    }
}

/// `ebx` = a bit for each lane of a condition, or of both halves'.
fn word_of(a: &mut Assembler, lanes: &[Register]) {
    /// Which loops use for frames only with AVX-512.
    const EAX: Register = 0;
    bits_of(a, SCRATCH_WORD, lanes[0]);
    if let &[_, upper] = lanes {
        bits_of(a, EAX, upper);
        // shl eax, 8; or ebx, eax
        a.bytes.extend([0xc1, 0xe0, 8, 0x09, 0xc3]);
    }
}

impl Allocation<'_> {
    /// The end of a turn: each carried value goes where the next turn looks for it, as if all did
    /// at once.
    fn hand_on(&mut self, carried: &[Carried]) -> Result<(), TooManyLive> {
        let in_rows = |value: &&Carried| value.register.is_none() && value.before != value.after;
        for value in carried.iter().filter(in_rows) {
            if carried.iter().any(|other| other.after == value.before) {
                // Its row is written here, and another value is what it held.
                return Err(TooManyLive);
            }
            let home = self.values[value.before as usize].home.ok_or(TooManyLive)?;
            let after = &self.values[value.after as usize];
            if after.is_home && after.home == Some(home) {
                continue;
            }
            self.bring(value.after, &[value.after])?;
            let info = &mut self.values[value.after as usize];
            let (own, was_home) = (info.home.replace(home), info.is_home);
            self.store(value.after)?;
            let info = &mut self.values[value.after as usize];
            (info.home, info.is_home) = (own, was_home || own == Some(home));
        }
        let mut moves: Vec<(Class, Register, Virtual)> = Vec::new();
        for value in carried {
            if let Some(register) = value.register
                && self.registers[value.after as usize] != Some(register)
            {
                let class = self.values[value.before as usize].class;
                moves.push((class, register, value.after));
            }
        }
        while !moves.is_empty() {
            let reads = |value: Virtual, class: Class, register: Register| {
                self.values[value as usize].class == class
                    && self.registers[value as usize] == Some(register)
            };
            // One that overwrites nothing that another still reads.
            let free = moves.iter().position(|&(class, to, _)| {
                !(moves.iter()).any(|&(_, other, value)| other != to && reads(value, class, to))
            });
            match free {
                Some(index) => {
                    let (class, to, value) = moves.swap_remove(index);
                    self.copy_into(class, to, value)?;
                }
                None => self.break_cycle(&moves, carried)?,
            }
        }
        Ok(())
    }

    fn copy_into(&mut self, class: Class, to: Register, value: Virtual) -> Result<(), TooManyLive> {
        let info = &self.values[value as usize];
        match (self.registers[value as usize], class) {
            (Some(from), Class::Vector) => {
                let from = Operand::Register(from);
                self.assembler.vector(MOVE, (to, 0, from), 0, None);
            }
            (Some(from), Class::Mask) => {
                let from = Operand::Register(from);
                self.assembler.mask(KMOV, (to, 0, from), false, None);
            }
            (None, Class::Vector) if info.is_home => {
                let home = Operand::Memory(info.home.ok_or(TooManyLive)?);
                self.assembler.vector(LOAD, (to, 0, home), 0, None);
            }
            _ => return Err(TooManyLive),
        }
        Ok(())
    }

    /// Frees the register that the first move writes.
    fn break_cycle(
        &mut self,
        moves: &[(Class, Register, Virtual)],
        carried: &[Carried],
    ) -> Result<(), TooManyLive> {
        let (class, to, _) = moves[0];
        let is_taken = |r: Register| {
            carried.iter().any(|value| {
                self.values[value.before as usize].class == class
                    && (value.register == Some(r)
                        || self.registers[value.after as usize] == Some(r))
            })
        };
        let aside = match (class, self.assembler.encoding) {
            (Class::Vector, Encoding::Evex) => Some(SCRATCH),
            (Class::Vector, Encoding::Vex) => self.vectors.iter().copied().find(|&r| !is_taken(r)),
            (Class::Mask, _) => self.masks.iter().copied().find(|&r| !is_taken(r)),
        };
        let aside = aside.ok_or(TooManyLive)?;
        let readers: Vec<Virtual> = (moves.iter())
            .map(|&(.., value)| value)
            .filter(|&value| {
                self.values[value as usize].class == class
                    && self.registers[value as usize] == Some(to)
            })
            .collect();
        self.copy_into(class, aside, readers[0])?;
        for value in readers {
            self.registers[value as usize] = Some(aside);
        }
        Ok(())
    }

    /// All lanes or none, as a vote on a condition says.
    pub(super) fn vote(&mut self, to: Register, lanes: Register, vote: Vote) {
        let a = &mut *self.assembler;
        bits_of(a, SCRATCH_WORD, lanes);
        // The carry says whether there are lanes, or whether there are none.
        match vote {
            // neg ebx
            Vote::Some => a.bytes.extend([0xf7, 0xdb]),
            // cmp ebx, 1
            Vote::None => a.bytes.extend([0x83, 0xfb, 1]),
        }
        // sbb ebx, ebx
        a.bytes.extend([0x19, 0xdb]);
        let word = Operand::Register(SCRATCH_WORD);
        match a.encoding {
            Encoding::Vex => broadcast_word(a, to),
            Encoding::Evex => a.mask(KMOV_IN, (to, 0, word), false, None),
        }
    }

    /// A bit for each lane of conditions, in each lane of a vector.
    pub(super) fn bits(&mut self, to: Register, lanes: &[Register]) {
        let a = &mut *self.assembler;
        word_of(a, lanes);
        broadcast_word(a, to);
    }

    /// The number of the first lane of conditions, in each lane of a vector.
    pub(super) fn first_lane(&mut self, to: Register, lanes: &[Register]) {
        let a = &mut *self.assembler;
        word_of(a, lanes);
        // tzcnt ebx, ebx
        a.bytes.extend([0xf3, 0x0f, 0xbc, 0xdb]);
        broadcast_word(a, to);
    }

    /// Combines the first lanes of a register with all other lanes of that, or of two halves.
    pub(super) fn in_order(
        &mut self,
        step: &Step,
        to: Register,
        all: [Register; 2],
    ) -> Result<(), TooManyLive> {
        let aside = self.aside()?;
        let a = &mut *self.assembler;
        let memory = |at| Memory::At(Base::Stack, at);
        for (&register, at) in all[..step.count].iter().zip(aside) {
            a.vector(STORE, (register, 0, Operand::Memory(memory(at))), 0, None);
        }
        a.first_lane(MOVSS, (to, 0), memory(aside[0]));
        for lane in 1..SUBGROUP_SIZE as i32 {
            a.first_lane(step.op, (to, to), memory(aside[0] + 4 * lane));
        }
        a.vector(PBROADCASTD, (to, 0, Operand::Register(to)), 0, None);
        Ok(())
    }

    /// Writes a value in some lanes to memory, for code behind the loop.
    pub(super) fn leave(&mut self, step: &Step, to: Register, lanes: Register, value: Register) {
        let home = self.values[step.to as usize].home.expect("a row");
        let home = Operand::Memory(home);
        let a = &mut *self.assembler;
        if a.encoding == Encoding::Evex {
            let mut from = value;
            if self.values[step.from[1] as usize].class == Class::Mask {
                let mask = Operand::Register(value);
                a.vector(MASK_TO_VECTOR, (SCRATCH, 0, mask), 0, None);
                from = SCRATCH;
            }
            a.vector(step.op, (from, 0, home), lanes, None);
            return;
        }
        a.vector(LOAD, (to, 0, home), 0, None);
        let new = Operand::Register(value);
        a.vector(BLENDVPS, (to, to, new), 0, Some(lanes << 4));
        a.vector(STORE, (to, 0, home), 0, None);
    }
}
