//! Stores of words to a loop's regions.

use super::gather::{distances, first_of_run, region_base};
use super::words::{first_word, store_all};
use super::*;
use crate::native::encode::{NOT_CARRY, NOT_ZERO, OVERFLOW, SCRATCH_WORD, ZERO};
use crate::native::opcodes::*;

/// Lanes of half a subgroup.
const LANES: i32 = 8;

/// Loops use it for frames only with AVX-512, and for the fourth subgroup.
const EAX: Register = 0;

impl Allocation<'_> {
    /// Stores words in some lanes, in the lanes' order. `steps`: the lanes' distances from the
    /// first one where words may lie one behind another. The result's register is scratch.
    pub(super) fn scatter(
        &mut self,
        step: &Step,
        to: Register,
        [place, lanes, value]: [Register; 3],
        steps: Option<Memory>,
    ) -> Result<(), TooManyLive> {
        if self.assembler.encoding == Encoding::Evex {
            self.scatter_by_masks(step, to, [place, lanes, value], steps);
            return Ok(());
        }
        let [places, values] = self.aside()?;
        let a = &mut *self.assembler;
        region_base(a, step);
        a.vector(MOVMSKPS, (EAX, 0, Operand::Register(lanes)), 0, None);
        // cmp eax, all lanes
        a.bytes.extend([0x3d, 0xff, 0, 0, 0]);
        let some = a.jump_ahead(NOT_ZERO);
        let run = steps.map(|steps| store_run(a, to, [place, value], steps));
        store_all(a, to, [place, value]);
        let done = a.jump();
        a.land(some);
        // test eax, eax
        a.bytes.extend([0x85, 0xc0]);
        let none = a.jump_ahead(ZERO);
        let memory = |at| Operand::Memory(Memory::At(Base::Stack, at));
        a.vector(STORE, (place, 0, memory(places)), 0, None);
        a.vector(STORE, (value, 0, memory(values)), 0, None);
        for lane in 0..LANES {
            // shr eax, 1
            a.bytes.extend([0xd1, 0xe8]);
            let not = a.jump_ahead(NOT_CARRY);
            store_word(a, places + 4 * lane, values + 4 * lane);
            a.land(not);
        }
        a.land(done);
        run.into_iter().for_each(|done| a.land(done));
        a.land(none);
        Ok(())
    }

    /// As [`Self::scatter`], with AVX-512.
    fn scatter_by_masks(
        &mut self,
        step: &Step,
        to: Register,
        [place, lanes, value]: [Register; 3],
        steps: Option<Memory>,
    ) {
        let a = &mut *self.assembler;
        // Processors are slow to find out that memory is missing where no lane stores.
        a.mask(KORTESTW, (lanes, 0, Operand::Register(lanes)), false, None);
        let none = a.jump_ahead(ZERO);
        region_base(a, step);
        let run = steps.map(|steps| {
            let apart = first_of_run(a, to, [place, lanes], Operand::Memory(steps));
            let (first, overflows) = run_address(a);
            a.vector(STORE, (value, 0, first), lanes, None);
            let done = a.jump();
            a.land(apart);
            a.land(overflows);
            done
        });
        // mov rbx, r13
        a.bytes.extend([0x4c, 0x89, 0xeb]);
        a.gather(step.op, value, place, lanes);
        run.into_iter().for_each(|done| a.land(done));
        a.land(none);
    }
}

/// `rbx` = the address of a run's last word, from the place of its first one in `ebx` and the
/// address of the offset 2³¹ in `r13`. Gives the first word, and the jump where places overflow.
fn run_address(a: &mut Assembler) -> (Operand, usize) {
    let to_last = a.encoding.vector_bytes() - 4;
    // add ebx, the distance to the last lane's word
    a.bytes.extend([0x81, 0xc3]);
    a.bytes.extend(to_last.to_le_bytes());
    let overflows = a.jump_ahead(OVERFLOW);
    // movsxd rbx, ebx; add rbx, r13
    a.bytes.extend([0x48, 0x63, 0xdb, 0x4c, 0x01, 0xeb]);
    (Operand::Memory(Memory::At(Base::Word, -to_last)), overflows)
}

/// Stores words of all lanes at once if they lie one behind another. Gives the jump that is taken
/// then. AVX2 only.
fn store_run(
    a: &mut Assembler,
    to: Register,
    [place, value]: [Register; 2],
    steps: Memory,
) -> usize {
    distances(a, to, place);
    a.vector(PCMPEQD, (to, to, Operand::Memory(steps)), 0, None);
    a.vector(MOVMSKPS, (SCRATCH_WORD, 0, Operand::Register(to)), 0, None);
    // cmp ebx, all lanes
    a.bytes.extend([0x81, 0xfb, 0xff, 0, 0, 0]);
    let apart = a.jump_ahead(NOT_ZERO);
    first_word(a, place);
    let (first, overflows) = run_address(a);
    a.vector(STORE, (value, 0, first), 0, None);
    let done = a.jump();
    a.land(apart);
    a.land(overflows);
    done
}

/// Stores a word at a place from the offset 2³¹ on, whose address `r13` is; both lie on the stack.
fn store_word(a: &mut Assembler, place: i32, value: i32) {
    // movsxd rbx, [rbp + place]
    a.bytes.extend([0x48, 0x63, 0x9d]);
    a.bytes.extend(place.to_le_bytes());
    // mov r9d, [rbp + value]
    a.bytes.extend([0x44, 0x8b, 0x8d]);
    a.bytes.extend(value.to_le_bytes());
    // mov [r13 + rbx], r9d
    a.bytes.extend([0x45, 0x89, 0x4c, 0x1d, 0]);
}
