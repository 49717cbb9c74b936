//! Words between vectors and `rbx`, which holds nothing between two steps. Masks of lanes as
//! conditions.

use super::*;
use crate::native::encode::SCRATCH_WORD;
use crate::native::opcodes::*;

/// `ebx` = the first lane of a vector.
pub(in crate::native) fn first_word(a: &mut Assembler, from: Register) {
    let not_if = |bit: Register| (from & bit == 0) as u8;
    match a.encoding {
        Encoding::Vex => {
            let word = Operand::Register(SCRATCH_WORD);
            a.mask(MOVD_OUT, (from, 0, word), false, None);
        }
        // vmovd ebx, from
        Encoding::Evex => a.bytes.extend([
            0x62,
            not_if(8) << 7 | 0b11 << 5 | not_if(16) << 4 | 1,
            0x7d,
            0x08,
            0x7e,
            0xc3 | (from & 7) << 3,
        ]),
    }
}

/// All lanes = `ebx`.
pub(in crate::native) fn broadcast_word(a: &mut Assembler, to: Register) {
    let word = Operand::Register(SCRATCH_WORD);
    match a.encoding {
        Encoding::Vex => {
            a.mask(MOVD_IN, (to, 0, word), false, None);
            a.vector(PBROADCASTD, (to, 0, Operand::Register(to)), 0, None);
        }
        Encoding::Evex => a.vector(PBROADCASTD_OF, (to, 0, word), 0, None),
    }
}

/// The lanes that are in the loop at first.
pub(super) fn enter(a: &mut Assembler, register: Register, half: i32, bits: Memory) {
    let lanes = Operand::Memory(Memory::At(Base::Lanes, half));
    match a.encoding {
        Encoding::Evex => a.mask(KMOV, (register, 0, lanes), false, None),
        Encoding::Vex => {
            a.vector(PBROADCASTB, (register, 0, lanes), 0, None);
            let bits = Operand::Memory(bits);
            a.vector(PAND, (register, register, bits), 0, None);
            a.vector(PCMPEQD, (register, register, bits), 0, None);
        }
    }
}
