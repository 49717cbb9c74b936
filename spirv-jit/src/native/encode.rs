//! Bytes of vector instructions: VEX for AVX2, EVEX for AVX-512 ("Intel 64 and IA-32 Architectures
//! Software Developer's Manual", volume 2, sections 2.3 and 2.7).

use crate::SUBGROUP_SIZE;

/// A vector register, or a mask register of AVX-512.
pub(super) type Register = u8;

/// How registers and instructions are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// 256 bits, sixteen registers.
    Vex,
    /// 512 bits, thirty-two registers.
    Evex,
}

impl Encoding {
    pub const fn vector_bytes(self) -> i32 {
        match self {
            Encoding::Vex => 32,
            Encoding::Evex => 64,
        }
    }
}

/// The pointers that code has, by the number of their register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Base {
    /// `rdi`: the subgroup's frame.
    Frame = 7,
    /// `rsi`: uniform rows.
    Uniforms = 6,
    /// `r8`: with [`Encoding::Vex`], the half of the frame's 32-bit lanes that is computed. In a
    /// loop that several subgroups take together, the second one's frame.
    Half = 8,
    /// `r9`: the same of 64-bit lanes, or the third one's frame.
    WideHalf = 9,
    /// `rax`: the fourth one's frame.
    FourthFrame = 0,
    /// `r10`: the mask of the subgroup's active lanes, 16 bits; with [`Encoding::Vex`] the half's,
    /// 8 bits.
    Lanes = 10,
    /// `rbx`: a word that a loop loads.
    Word = 3,
    /// `rbp`: the stack's part for values of a loop that leave their registers and have no row.
    Stack = 5,
    /// `r13`: where a step of a loop finds memory, such as a subgroup's first private row.
    Private = 13,
    /// `r14`: what a loop is given besides, [`LoopContext`](crate::native::LoopContext).
    Context = 14,
}

/// A place in memory of as many bytes as a register has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Memory {
    At(Base, i32),
    /// A vector behind the code, by its number.
    Pool(u32),
}

impl Memory {
    /// So many bytes behind; constants stay where they are.
    pub fn behind(self, bytes: i32) -> Memory {
        match self {
            Memory::At(base, displacement) => Memory::At(base, displacement + bytes),
            Memory::Pool(_) => self,
        }
    }
}

/// A vector behind the code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Constant {
    /// In all lanes the same word.
    Word(u32),
    /// In each lane the bit that it has in masks.
    LaneBits,
    /// In each lane a word of its own; [`Encoding::Vex`] takes those of the first eight.
    Words([u32; SUBGROUP_SIZE]),
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Operand {
    Register(Register),
    Memory(Memory),
}

/// An instruction's name: opcode map (1: 0F, 2: 0F38, 3: 0F3A, 5 and 6: those of AVX-512 FP16),
/// prefix (1: 66, 2: F3, 3: F2), `W`,
/// opcode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Opcode {
    pub map: u8,
    pub prefix: u8,
    pub w: bool,
    pub byte: u8,
}

/// `map prefix W byte`.
pub(super) const fn opcode(map: u8, prefix: u8, w: u8, byte: u8) -> Opcode {
    Opcode {
        map,
        prefix,
        w: w != 0,
        byte,
    }
}

/// With a mask: zeros in all other lanes.
pub(super) const ZEROING: u8 = 0x80;

/// `rbx`, which holds nothing between two steps.
pub(super) const SCRATCH_WORD: Register = 3;

/// How [`Assembler::rounding`] rounds.
pub(super) const DOWN: u8 = 1;
pub(super) const UP: u8 = 2;
pub(super) const TOWARDS_ZERO: u8 = 3;

/// Conditions of jumps.
pub(super) const OVERFLOW: u8 = 0;
pub(super) const ZERO: u8 = 4;
pub(super) const NOT_ZERO: u8 = 5;
pub(super) const NOT_NEGATIVE: u8 = 9;
pub(super) const CARRY: u8 = 2;
pub(super) const NOT_CARRY: u8 = 3;
pub(super) const GREATER: u8 = 15;

/// Code that is being written.
#[derive(Clone)]
pub(super) struct Assembler {
    pub encoding: Encoding,
    pub bytes: Vec<u8>,
    /// Displacements that are to lead into the pool: where they stand, which vector they mean.
    pool_uses: Vec<(usize, u32)>,
}

impl Assembler {
    pub fn new(encoding: Encoding) -> Assembler {
        Assembler {
            encoding,
            bytes: Vec::new(),
            pool_uses: Vec::new(),
        }
    }

    /// An instruction with operands `reg`, `vvvv` and `rm`, under `mask` (0: in all lanes; only
    /// EVEX has others; [`ZEROING`] is added to it).
    pub fn vector(
        &mut self,
        op: Opcode,
        (reg, second, rm): (Register, Register, Operand),
        mask: u8,
        immediate: Option<u8>,
    ) {
        match self.encoding {
            Encoding::Vex => self.vex(op, (reg, second, rm), true, immediate),
            Encoding::Evex => self.evex(op, (reg, second, rm), (mask, 64), immediate),
        }
    }

    /// An instruction on registers that rounds as `how` says. AVX-512 only.
    pub fn rounding(&mut self, op: Opcode, operands: (Register, Register, Operand), how: u8) {
        let prefix = self.bytes.len();
        self.evex(op, operands, (0, 64), None);
        // The bits of the vectors' length tell how, beside the bit that says so.
        let byte = &mut self.bytes[prefix + 3];
        *byte = *byte & !(0b11 << 5) | how << 5 | 1 << 4;
    }

    /// An instruction on mask registers.
    pub fn mask(
        &mut self,
        op: Opcode,
        (reg, second, rm): (Register, Register, Operand),
        long: bool,
        immediate: Option<u8>,
    ) {
        self.vex(op, (reg, second, rm), long, immediate);
    }

    /// An instruction on first lanes alone, one of which is in memory.
    pub fn first_lane(&mut self, op: Opcode, (reg, second): (Register, Register), rm: Memory) {
        let operands = (reg, second, Operand::Memory(rm));
        match self.encoding {
            Encoding::Vex => self.vex(op, operands, false, None),
            Encoding::Evex => self.evex(op, operands, (0, 4), None),
        }
    }

    /// `reg = op` of words at `rbx` plus the lanes of `index`, in lanes of `mask`, which is
    /// cleared.
    pub fn gather(&mut self, op: Opcode, reg: Register, index: Register, mask: Register) {
        let high = |register: Register, bit| not_if(register & bit != 0);
        match self.encoding {
            Encoding::Vex => self.bytes.extend([
                0xc4,
                high(reg, 8) << 7 | high(index, 8) << 6 | 1 << 5 | op.map,
                (op.w as u8) << 7 | (!mask & 15) << 3 | 1 << 2 | op.prefix,
                op.byte,
            ]),
            Encoding::Evex => self.bytes.extend([
                0x62,
                high(reg, 8) << 7 | high(index, 8) << 6 | 1 << 5 | high(reg, 16) << 4 | op.map,
                (op.w as u8) << 7 | 15 << 3 | 1 << 2 | op.prefix,
                0b10 << 5 | high(index, 16) << 3 | mask,
                op.byte,
            ]),
        }
        // Base 3 is `rbx`.
        self.bytes
            .extend([(reg & 7) << 3 | 4, (index & 7) << 3 | 3]);
    }

    /// Stores one of the first four lanes of `from`, by `op` with its immediate, at `r13` plus a
    /// general register. AVX2 only.
    pub fn store_lane(&mut self, op: Opcode, from: Register, index: Register, lane: Option<u8>) {
        self.bytes.extend([
            0xc4,
            not_if(from >= 8) << 7 | not_if(index >= 8) << 6 | op.map,
            15 << 3 | op.prefix,
            op.byte,
        ]);
        // An index, a displacement of one byte; base 5 is `r13`.
        let (reg, index) = (from & 7, index & 7);
        self.bytes.extend([0x44 | reg << 3, index << 3 | 5, 0]);
        self.bytes.extend(lane);
    }

    fn vex(
        &mut self,
        op: Opcode,
        (reg, second, rm): (Register, Register, Operand),
        long: bool,
        immediate: Option<u8>,
    ) {
        let base = high_bit(rm, 8);
        self.bytes.extend([
            0xc4,
            not_if(reg >= 8) << 7 | 1 << 6 | not_if(base) << 5 | op.map,
            (op.w as u8) << 7 | (!second & 15) << 3 | (long as u8) << 2 | op.prefix,
            op.byte,
        ]);
        self.operand(reg & 7, rm, 1, immediate);
    }

    fn evex(
        &mut self,
        op: Opcode,
        (reg, second, rm): (Register, Register, Operand),
        (mask, scale): (u8, i32),
        immediate: Option<u8>,
    ) {
        let index = match rm {
            Operand::Register(r) => r >= 16,
            Operand::Memory(_) => false,
        };
        self.bytes.extend([
            0x62,
            not_if(reg & 8 != 0) << 7
                | not_if(index) << 6
                | not_if(high_bit(rm, 8)) << 5
                | not_if(reg & 16 != 0) << 4
                | op.map,
            (op.w as u8) << 7 | (!second & 15) << 3 | 1 << 2 | op.prefix,
            // 512 bits.
            0b10 << 5 | not_if(second & 16 != 0) << 3 | mask,
            op.byte,
        ]);
        self.operand(reg & 7, rm, scale, immediate);
    }

    /// The bytes behind the opcode; short displacements count units of `scale` bytes.
    fn operand(&mut self, reg: u8, rm: Operand, scale: i32, immediate: Option<u8>) {
        match rm {
            Operand::Register(r) => self.bytes.push(0xc0 | reg << 3 | r & 7),
            Operand::Memory(Memory::At(base, displacement)) => {
                let base = base as u8 & 7;
                let short = i8::try_from(displacement / scale);
                match short {
                    Ok(short) if displacement % scale == 0 => {
                        self.bytes.extend([0x40 | reg << 3 | base, short as u8]);
                    }
                    _ => {
                        self.bytes.push(0x80 | reg << 3 | base);
                        self.bytes.extend(displacement.to_le_bytes());
                    }
                }
            }
            Operand::Memory(Memory::Pool(index)) => {
                // Relative to the instruction's end.
                self.bytes.push(reg << 3 | 5);
                self.pool_uses.push((self.bytes.len(), index));
                let behind = 4 + immediate.is_some() as i32;
                self.bytes.extend(behind.to_le_bytes());
            }
        }
        self.bytes.extend(immediate);
    }

    /// `jnz` to a place before this one.
    pub fn jump_if_not_zero(&mut self, target: usize) {
        let jump = self.jump_ahead(NOT_ZERO);
        self.land_at(jump, target);
    }

    /// `rbx` = the address of the lane that `rbx` numbers, of lanes at a distance from a pointer.
    pub fn lane_address(&mut self, base: Base, displacement: i32, is_wide: bool) {
        let scale = 2 + is_wide as u8;
        let base = base as u8;
        // lea rbx, [base + rbx * lane + displacement]
        self.bytes.extend([
            0x48 | base >> 3,
            0x8d,
            0x80 | SCRATCH_WORD << 3 | 4,
            scale << 6 | SCRATCH_WORD << 3 | base & 7,
        ]);
        self.bytes.extend(displacement.to_le_bytes());
    }

    /// A jump to a place that is named later.
    pub fn jump(&mut self) -> usize {
        self.bytes.extend([0xe9, 0, 0, 0, 0]);
        self.bytes.len()
    }

    /// A jump under a condition to a place that is named later.
    pub fn jump_ahead(&mut self, condition: u8) -> usize {
        self.bytes.extend([0x0f, 0x80 | condition, 0, 0, 0, 0]);
        self.bytes.len()
    }

    /// Says where a jump leads: here.
    pub fn land(&mut self, jump: usize) {
        self.land_at(jump, self.bytes.len());
    }

    /// Says where a jump leads.
    pub fn land_at(&mut self, jump: usize, target: usize) {
        let distance = target as i32 - jump as i32;
        self.bytes[jump - 4..jump].copy_from_slice(&distance.to_le_bytes());
    }

    /// Appends the pool, and lets its users find it.
    pub fn finish(mut self, pool: &[Constant]) -> Vec<u8> {
        let size = self.encoding.vector_bytes() as usize;
        if !pool.is_empty() {
            self.bytes
                .resize(self.bytes.len().next_multiple_of(size), 0);
        }
        let start = self.bytes.len();
        for (at, index) in self.pool_uses {
            let place: [u8; 4] = self.bytes[at..at + 4].try_into().expect("four bytes");
            let end = at as i32 + i32::from_le_bytes(place);
            let target = (start + index as usize * size) as i32;
            self.bytes[at..at + 4].copy_from_slice(&(target - end).to_le_bytes());
        }
        for constant in pool {
            for lane in 0..size / 4 {
                let word: u32 = match constant {
                    Constant::Word(word) => *word,
                    Constant::LaneBits => 1 << lane,
                    Constant::Words(words) => words[lane],
                };
                self.bytes.extend(word.to_le_bytes());
            }
        }
        self.bytes
    }
}

/// Prefixes hold some bits inverted.
fn not_if(bit: bool) -> u8 {
    !bit as u8
}

/// Whether the number of the operand's register has this bit.
fn high_bit(rm: Operand, bit: u8) -> bool {
    match rm {
        Operand::Register(r) => r & bit != 0,
        Operand::Memory(Memory::At(base, _)) => base as u8 & bit != 0,
        Operand::Memory(Memory::Pool(_)) => false,
    }
}
