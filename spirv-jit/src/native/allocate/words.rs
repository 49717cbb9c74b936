//! Words between vectors and `rbx`, which holds nothing between two steps, and from vectors to
//! memory. Masks of lanes as conditions.

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

/// Stores words of all lanes, in their order, at places behind the address in `r13`. None of it
/// goes through the stack: a load may wait for a store at a place that looks like its own. AVX2
/// only.
pub(super) fn store_all(a: &mut Assembler, to: Register, [place, value]: [Register; 2]) {
    /// Which loops use for frames only with AVX-512, and for the fourth and the third subgroup.
    const EAX: Register = 0;
    const R9: Register = 9;
    let [low, high] = [SCRATCH_WORD, R9].map(Operand::Register);
    for half in [0, 1] {
        let [mut places, mut values] = [place, value];
        let upper = Operand::Register(to);
        if half == 1 {
            a.vector(EXTRACT_128, (place, 0, upper), 0, Some(1));
            places = to;
        }
        a.mask(MOVQ_OUT, (places, 0, low), false, None);
        a.mask(PEXTRQ, (places, 0, high), false, Some(1));
        if half == 1 {
            a.vector(EXTRACT_128, (value, 0, upper), 0, Some(1));
            values = to;
        }
        // movsxd rax, ebx; sar rbx, 32
        a.bytes.extend([0x48, 0x63, 0xc3, 0x48, 0xc1, 0xfb, 32]);
        a.store_lane(MOVD_OUT, values, EAX, None);
        a.store_lane(PEXTRD, values, SCRATCH_WORD, Some(1));
        // movsxd rax, r9d; sar r9, 32
        a.bytes.extend([0x49, 0x63, 0xc1, 0x49, 0xc1, 0xf9, 32]);
        a.store_lane(PEXTRD, values, EAX, Some(2));
        a.store_lane(PEXTRD, values, R9, Some(3));
    }
}
