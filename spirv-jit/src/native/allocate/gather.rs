//! Loads of words of a loop's regions.

use smallvec::SmallVec;

use super::private::own;
use super::words::first_word;
use super::*;
use crate::SUBGROUP_SIZE;
use crate::native::encode::{GREATER, NOT_CARRY, NOT_ZERO, OVERFLOW, SCRATCH_WORD, ZERO};
use crate::native::opcodes::*;
use crate::native::{LoopContext, Own, WORKGROUP};

/// Comparisons of [`PCMPD`].
const NOT_EQUAL: u8 = 4;
const LESS_OR_EQUAL: u8 = 2;

/// Bytes from the first lane's word to the last one's, where lanes' words have this distance.
fn to_last(encoding: Encoding, distance: u32) -> u32 {
    (encoding.vector_bytes() as u32 / 4 - 1) * distance
}

/// Where vectors begin that have the words of all lanes: so many words behind the first lane's, at
/// a distance of so many bytes. None reaches further than the last lane's word.
pub(in crate::native) fn blocks(distance: u32) -> impl Iterator<Item = u32> {
    const WORDS: u32 = SUBGROUP_SIZE as u32;
    let last = (WORDS - 1) * (distance / 4);
    (0..=last / WORDS).map(move |block| (block * WORDS).min(last + 1 - WORDS))
}

/// Which words of two vectors lanes take: of the ones before, which are in the lanes' places from
/// the second on, and of a block.
pub(in crate::native) fn choice(distance: u32, block: usize) -> [u32; SUBGROUP_SIZE] {
    const WORDS: u32 = SUBGROUP_SIZE as u32;
    std::array::from_fn(|lane| {
        let word = distance / 4 * lane as u32;
        let own = blocks(distance).position(|start| (start..start + WORDS).contains(&word));
        let start = blocks(distance).nth(block).unwrap_or(0);
        match own {
            Some(own) if own == block => WORDS + word - start,
            Some(0) if block == 1 => word,
            _ => lane as u32,
        }
    })
}

/// Puts the last lane's place into `rbx` where lanes' places have a distance. Jumps where they have
/// others, and where places overflow on the way. `steps`: the lanes' distances from the first.
fn find_run(
    a: &mut Assembler,
    to: Register,
    [index, lanes]: [Register; 2],
    (distance, steps): (u32, Operand),
) -> SmallVec<[usize; 3]> {
    let mut apart = SmallVec::new();
    match (a.encoding, steps) {
        (Encoding::Vex, _) => {
            distances(a, to, index);
            a.vector(PCMPEQD, (to, to, steps), 0, None);
            a.vector(TESTPS, (to, 0, Operand::Register(lanes)), 0, None);
            apart.push(a.jump_ahead(NOT_CARRY));
            if distance == 4 {
                // Without a lane the place may be any, and processors are slow to find out that
                // memory is missing there.
                apart.push(a.jump_ahead(ZERO));
            } else {
                // Words of lanes that have none are loaded, too.
                all_lanes(a, lanes);
                apart.push(a.jump_ahead(NOT_ZERO));
            }
            first_word(a, index);
        }
        (Encoding::Evex, steps) => {
            // As with AVX2.
            a.mask(KORTESTW, (lanes, 0, Operand::Register(lanes)), false, None);
            apart.push(a.jump_ahead(if distance == 4 { ZERO } else { NOT_CARRY }));
            apart.push(first_of_run(a, to, [index, lanes], steps));
        }
    }
    // add ebx, the distance to the last lane's word
    a.bytes.extend([0x81, 0xc3]);
    let bytes = to_last(a.encoding, distance);
    a.bytes.extend(bytes.to_le_bytes());
    apart.push(a.jump_ahead(OVERFLOW));
    // movsxd rbx, ebx
    a.bytes.extend([0x48, 0x63, 0xdb]);
    apart
}

/// Compares a bit for each lane of a condition with those of all lanes. AVX2 only.
fn all_lanes(a: &mut Assembler, lanes: Register) {
    let lanes = Operand::Register(lanes);
    a.vector(MOVMSKPS, (SCRATCH_WORD, 0, lanes), 0, None);
    // cmp ebx, all lanes
    a.bytes.extend([0x81, 0xfb, 0xff, 0, 0, 0]);
}

/// Puts the place of a run's first word into `ebx`, and jumps where lanes' words lie otherwise.
pub(super) fn first_of_run(
    a: &mut Assembler,
    to: Register,
    [index, lanes]: [Register; 2],
    steps: Operand,
) -> usize {
    /// No mask for instructions, but they write it.
    const DIFFERENT: Register = 0;
    let register = Operand::Register;
    a.vector(PSUBD, (to, index, steps), 0, None);
    a.vector(PBROADCASTD, (SCRATCH, 0, register(to)), 0, None);
    a.vector(
        PCMPD,
        (DIFFERENT, to, register(SCRATCH)),
        lanes,
        Some(NOT_EQUAL),
    );
    a.mask(KORTESTW, (DIFFERENT, 0, register(DIFFERENT)), false, None);
    let apart = a.jump_ahead(NOT_ZERO);
    first_word(a, SCRATCH);
    apart
}

/// `r13` = the address of the offset 2³¹ of a step's region.
pub(super) fn region_base(a: &mut Assembler, step: &Step) {
    let region = region_of(step);
    if region == WORKGROUP {
        return own(a, step.subgroup, std::mem::offset_of!(Own, workgroup));
    }
    // mov r13, [r14 + region]
    a.bytes.extend([0x4d, 0x8b, 0xae]);
    a.bytes.extend(LoopContext::base(region).to_le_bytes());
}

/// `rbx` += the address of the offset 2³¹ of a step's region.
fn add_base(a: &mut Assembler, step: &Step) {
    let region = region_of(step);
    if region == WORKGROUP {
        region_base(a, step);
        // add rbx, r13
        a.bytes.extend([0x4c, 0x01, 0xeb]);
        return;
    }
    // add rbx, [r14 + region]
    a.bytes.extend([0x49, 0x03, 0x9e]);
    a.bytes.extend(LoopContext::base(region).to_le_bytes());
}

/// Compares `ebx` with the last offset of a step's region.
fn compare_last(a: &mut Assembler, step: &Step) {
    // cmp ebx, [r14 + last]
    a.bytes.extend([0x41, 0x3b, 0x9e]);
    a.bytes
        .extend(LoopContext::last(region_of(step)).to_le_bytes());
}

/// `rbx` = the address of the word so many bytes behind the place that a vector's first lane says,
/// of the region whose base `r13` is; that of zeros if it is outside.
fn word_address(a: &mut Assembler, step: &Step, place: Register, behind: u32) {
    first_word(a, place);
    // Signed numbers in the order of unsigned ones: add ebx, 2^31 + behind
    a.bytes.extend([0x81, 0xc3]);
    a.bytes.extend((1 << 31 | behind).to_le_bytes());
    inside_address(a, step);
}

/// `rbx` = the address of the word at the place `ebx`; that of zeros if it is outside.
fn inside_address(a: &mut Assembler, step: &Step) {
    compare_last(a, step);
    // movsxd rbx, ebx; lea rbx, [r13 + rbx]; cmovg rbx, [r14 + zeros]
    a.bytes.extend([0x48, 0x63, 0xdb]);
    a.bytes.extend([0x49, 0x8d, 0x5c, 0x1d, 0]);
    a.bytes.extend([0x49, 0x0f, 0x4f, 0x9e]);
    a.bytes.extend(LoopContext::ZEROS.to_le_bytes());
}

/// `to` = distances of places from the first lane's. AVX2 only.
pub(super) fn distances(a: &mut Assembler, to: Register, index: Register) {
    a.vector(PBROADCASTD, (to, 0, Operand::Register(index)), 0, None);
    a.vector(PSUBD, (to, index, Operand::Register(to)), 0, None);
}

/// If all lanes' words are one, loads it and jumps to a place that is named later. AVX2 only.
fn load_same(a: &mut Assembler, step: &Step, to: Register, [index, lanes]: [Register; 2]) -> usize {
    let register = Operand::Register;
    distances(a, to, index);
    a.vector(PTEST, (lanes, 0, register(to)), 0, None);
    let apart = a.jump_ahead(NOT_ZERO);
    // Where no lane's word is inside, the first lane's place may be any.
    region_base(a, step);
    first_word(a, index);
    inside_address(a, step);
    let word = Operand::Memory(Memory::At(Base::Word, 0));
    a.vector(PBROADCASTD, (to, 0, word), 0, None);
    a.vector(PAND, (to, to, register(lanes)), 0, None);
    let done = a.jump();
    a.land(apart);
    done
}

/// `rbx` = the address of a place that is stored on the stack.
fn stored_address(a: &mut Assembler, at: i32) {
    // movsxd rbx, [rbp + at]; add rbx, r13
    a.bytes.extend([0x48, 0x63, 0x9d]);
    a.bytes.extend(at.to_le_bytes());
    a.bytes.extend([0x4c, 0x01, 0xeb]);
}

/// The four words of lanes, one lane in each quarter of `x`, `second`, `y` and `fourth`, become
/// registers of one word of each lane: `first` to `fourth`.
fn lanes_of_words(
    a: &mut Assembler,
    [first, second, third, fourth]: [Register; 4],
    [x, y]: [Register; 2],
) {
    let mut mix = |op, to, from: Register, other| {
        a.vector(op, (to, from, Operand::Register(other)), 0, None);
    };
    mix(UNPCKLPS, first, x, second);
    mix(UNPCKHPS, x, x, second);
    mix(UNPCKLPS, third, y, fourth);
    mix(UNPCKHPS, y, y, fourth);
    mix(UNPCKHPD, second, first, third);
    mix(UNPCKLPD, first, first, third);
    mix(UNPCKLPD, third, x, y);
    mix(UNPCKHPD, fourth, x, y);
}

/// The number of a step's region.
fn region_of(step: &Step) -> usize {
    step.immediate.unwrap_or(0).into()
}

impl Allocation<'_> {
    /// Loads words of a region; the result's register is none of the operands'. `steps`: the
    /// distance of neighbouring lanes' words that is looked for, and all lanes' distances from the
    /// first one.
    pub(super) fn gather(
        &mut self,
        step: &Step,
        to: Register,
        [index, lanes]: [Register; 2],
        steps: Option<(Spread, Operand)>,
    ) -> Result<(), TooManyLive> {
        let upper = match (self.assembler.encoding, steps) {
            (Encoding::Vex, Some((spread, _))) if spread.distance != 4 => {
                let upper = self.temporary(Class::Vector);
                let [a, b, _] = step.from;
                Some((upper, self.take(upper, &[a, b, step.to])?))
            }
            _ => None,
        };
        let a = &mut *self.assembler;
        let mut done = SmallVec::<[usize; 2]>::new();
        if let Some((spread, steps)) = steps {
            let distance = spread.distance;
            let apart = find_run(a, to, [index, lanes], (distance, steps));
            add_base(a, step);
            let first = -(to_last(a.encoding, distance) as i32);
            let word = |bytes| Operand::Memory(Memory::At(Base::Word, first + bytes));
            match (a.encoding, upper) {
                (Encoding::Vex, None) => a.vector(MASKMOVPS, (to, lanes, word(0)), 0, None),
                (Encoding::Vex, Some((_, upper))) => {
                    for (quarter, to) in [(0, to), (4, upper)] {
                        let at = |lane| word((quarter + lane) * distance as i32);
                        a.mask(MOVD_IN, (to, 0, at(0)), false, None);
                        for lane in 1..4 {
                            a.mask(PINSRD, (to, to, at(lane)), false, Some(lane as u8));
                        }
                    }
                    let upper = Operand::Register(upper);
                    a.vector(INSERT_128, (to, to, upper), 0, Some(1));
                }
                (Encoding::Evex, _) if distance == 4 => {
                    a.vector(LOAD, (to, 0, word(0)), lanes | ZEROING, None);
                }
                (Encoding::Evex, _) => {
                    a.vector(LOAD, (to, 0, word(0)), 0, None);
                    for (k, start) in (0..).zip(blocks(distance)).skip(1) {
                        let choice = Memory::Pool(spread.first_choice + k - 1);
                        a.vector(LOAD, (SCRATCH, 0, Operand::Memory(choice)), 0, None);
                        let block = word(4 * start as i32);
                        a.vector(PERMT2D, (to, SCRATCH, block), 0, None);
                    }
                }
            }
            done.push(a.jump());
            apart.into_iter().for_each(|apart| a.land(apart));
        }
        if a.encoding == Encoding::Vex {
            done.push(load_same(a, step, to, [index, lanes]));
        }
        region_base(a, step);
        // mov rbx, r13
        a.bytes.extend([0x4c, 0x89, 0xeb]);
        a.vector(PXOR, (to, to, Operand::Register(to)), 0, None);
        a.gather(step.op, to, index, lanes);
        done.into_iter().for_each(|done| a.land(done));
        if let Some((upper, _)) = upper {
            self.release(upper);
        }
        Ok(())
    }

    /// Loads four words of each lane, one behind another, into registers: where all of all lanes
    /// are inside, those of a lane at once, else word by word.
    pub(super) fn load_fours(&mut self, step: &Step, after: [u32; 3]) -> Result<(), TooManyLive> {
        let mut held = SmallVec::<[Virtual; 8]>::from_slice(&step.from[..2]);
        let mut operands = [0; 2];
        for (k, operand) in operands.iter_mut().enumerate() {
            *operand = self.bring(step.from[k], &step.from[..2])?;
        }
        for (&value, after) in step.from.iter().zip(after) {
            self.next[value as usize] = after;
        }
        let results = [Some(step.to), step.more[0], step.more[1], step.more[2]];
        let mut registers = [0; 6];
        for (k, register) in registers.iter_mut().enumerate() {
            let result = results.get(k).copied().flatten();
            let value = result.unwrap_or_else(|| self.temporary(Class::Vector));
            *register = self.take(value, &held)?;
            held.push(value);
        }
        let fours = self.values[step.from[2] as usize].home;
        let fours = Operand::Memory(fours.expect("a constant"));
        match self.assembler.encoding {
            Encoding::Vex => self.write_fours(step, registers, operands, fours)?,
            Encoding::Evex => {
                let inside = self.temporary(Class::Mask);
                let mask = self.take(inside, &held)?;
                held.push(inside);
                self.write_fours_by_masks(step, registers, (operands, mask), fours)?;
            }
        }
        for value in held {
            let is_result = results.contains(&Some(value));
            if is_result {
                self.results.push(value);
            } else if self.next[value as usize] == NEVER {
                self.release(value);
            }
        }
        Ok(())
    }

    fn write_fours(
        &mut self,
        step: &Step,
        [first, second, third, fourth, x, y]: [Register; 6],
        [index, lanes]: [Register; 2],
        fours: Operand,
    ) -> Result<(), TooManyLive> {
        let [places, _] = self.aside()?;
        let a = &mut *self.assembler;
        let register = Operand::Register;
        let last = Memory::At(Base::Context, LoopContext::last(region_of(step)));
        let last = Operand::Memory(last);
        // The fourth words' places, and lanes where those are outside or have overflown.
        a.vector(PADDD, (x, index, fours), 0, None);
        a.vector(PADDD, (x, x, fours), 0, None);
        a.vector(PADDD, (x, x, fours), 0, None);
        a.vector(PCMPGTD, (y, index, register(x)), 0, None);
        a.vector(PCMPGTD, (x, x, last), 0, None);
        a.vector(POR, (x, x, register(y)), 0, None);
        a.vector(PANDN, (x, x, register(lanes)), 0, None);
        all_lanes(a, x);
        let some = a.jump_ahead(NOT_ZERO);
        region_base(a, step);
        let stored = Operand::Memory(Memory::At(Base::Stack, places));
        a.vector(STORE, (index, 0, stored), 0, None);
        let word = Operand::Memory(Memory::At(Base::Word, 0));
        for (lane, quarters) in (0..).zip([x, second, y, fourth]) {
            stored_address(a, places + 4 * lane);
            a.mask(LOAD, (quarters, 0, word), false, None);
            stored_address(a, places + 4 * (lane + 4));
            a.vector(INSERT_128, (quarters, quarters, word), 0, Some(1));
        }
        lanes_of_words(a, [first, second, third, fourth], [x, y]);
        let done = a.jump();
        a.land(some);
        region_base(a, step);
        // mov rbx, r13
        a.bytes.extend([0x4c, 0x89, 0xeb]);
        let mut place = index;
        for (k, to) in [first, second, third, fourth].into_iter().enumerate() {
            if k > 0 {
                a.vector(PADDD, (x, place, fours), 0, None);
                place = x;
            }
            if k > 0 && step.more[k - 1].is_none() {
                continue;
            }
            a.vector(PCMPGTD, (y, place, last), 0, None);
            a.vector(PANDN, (y, y, register(lanes)), 0, None);
            a.vector(PXOR, (to, to, register(to)), 0, None);
            a.gather(step.op, to, place, y);
        }
        a.land(done);
        Ok(())
    }

    /// As [`Self::write_fours`], with AVX-512. `inside`: a mask register.
    fn write_fours_by_masks(
        &mut self,
        step: &Step,
        [first, second, third, fourth, x, y]: [Register; 6],
        ([index, lanes], inside): ([Register; 2], Register),
        fours: Operand,
    ) -> Result<(), TooManyLive> {
        let [places, _] = self.aside()?;
        let a = &mut *self.assembler;
        let register = Operand::Register;
        let last = Memory::At(Base::Context, LoopContext::last(region_of(step)));
        let last = Operand::Memory(last);
        // The fourth words' places, and lanes where those are inside and have not overflown.
        a.vector(PADDD, (x, index, fours), 0, None);
        a.vector(PADDD, (x, x, fours), 0, None);
        a.vector(PADDD, (x, x, fours), 0, None);
        a.vector(PCMPD, (inside, x, last), lanes, Some(LESS_OR_EQUAL));
        a.vector(
            PCMPD,
            (inside, index, register(x)),
            inside,
            Some(LESS_OR_EQUAL),
        );
        a.mask(KORTESTW, (inside, 0, register(inside)), false, None);
        let some = a.jump_ahead(NOT_CARRY);
        region_base(a, step);
        let stored = Operand::Memory(Memory::At(Base::Stack, places));
        a.vector(STORE, (index, 0, stored), 0, None);
        let word = Operand::Memory(Memory::At(Base::Word, 0));
        for (first_lane, quarters) in (0..).zip([x, second, y, fourth]) {
            stored_address(a, places + 4 * first_lane);
            a.vector(BROADCAST_128, (quarters, 0, word), 0, None);
            for quarter in 1..4 {
                stored_address(a, places + 4 * (first_lane + 4 * quarter));
                let operands = (quarters, quarters, word);
                a.vector(INSERT_128, operands, 0, Some(quarter as u8));
            }
        }
        lanes_of_words(a, [first, second, third, fourth], [x, y]);
        let done = a.jump();
        a.land(some);
        region_base(a, step);
        // mov rbx, r13
        a.bytes.extend([0x4c, 0x89, 0xeb]);
        let mut place = index;
        for (k, to) in [first, second, third, fourth].into_iter().enumerate() {
            if k > 0 {
                a.vector(PADDD, (x, place, fours), 0, None);
                place = x;
            }
            if k > 0 && step.more[k - 1].is_none() {
                continue;
            }
            a.vector(PCMPD, (inside, place, last), lanes, Some(LESS_OR_EQUAL));
            a.vector(PXOR, (to, to, register(to)), 0, None);
            a.gather(step.op, to, place, inside);
        }
        a.land(done);
        Ok(())
    }

    /// Loads one word for all lanes. `rbx` stays the address of the last of the words.
    pub(super) fn load_one(
        &mut self,
        step: &Step,
        to: Register,
        place: Register,
        [first, last]: [u32; 2],
    ) -> Result<(), TooManyLive> {
        if first == last {
            let a = &mut *self.assembler;
            region_base(a, step);
            word_address(a, step, place, first);
            self.load_next(to, 0);
            return Ok(());
        }
        let [aside, _] = self.aside()?;
        let a = &mut *self.assembler;
        region_base(a, step);
        // Signed numbers in the order of unsigned ones: add ebx, 2^31 + first
        first_word(a, place);
        a.bytes.extend([0x81, 0xc3]);
        a.bytes.extend((1 << 31 | first).to_le_bytes());
        // add ebx, distance to the last word
        a.bytes.extend([0x81, 0xc3]);
        a.bytes.extend((last - first).to_le_bytes());
        let over = a.jump_ahead(OVERFLOW);
        compare_last(a, step);
        let outside = a.jump_ahead(GREATER);
        // movsxd rbx, ebx; add rbx, r13
        a.bytes.extend([0x48, 0x63, 0xdb, 0x4c, 0x01, 0xeb]);
        let done = a.jump();
        a.land(over);
        a.land(outside);
        for word in (first..=last).step_by(4) {
            word_address(a, step, place, word);
            // mov ebx, [rbx]; mov [rbp + aside], ebx
            a.bytes.extend([0x8b, 0x1b, 0x89, 0x9d]);
            a.bytes
                .extend((aside + (word - first) as i32).to_le_bytes());
        }
        // lea rbx, [rbp + the last word]
        a.bytes.extend([0x48, 0x8d, 0x9d]);
        a.bytes
            .extend((aside + (last - first) as i32).to_le_bytes());
        a.land(done);
        self.load_next(to, last - first);
        Ok(())
    }

    /// Loads a word so many bytes before `rbx` for all lanes.
    pub(super) fn load_next(&mut self, to: Register, before: u32) {
        let word = Memory::At(Base::Word, -(before as i32));
        let word = Operand::Memory(word);
        self.assembler.vector(PBROADCASTD, (to, 0, word), 0, None);
    }
}
