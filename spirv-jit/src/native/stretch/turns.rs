//! Loops without suspensions, calls and stores, in native code.
//!
//! A subgroup takes all its turns, then the next one does. Up to four subgroups take their turns
//! together where registers suffice, so that none waits for its own results. Masks of lanes say
//! where control is: both sides of a branch are computed, and their results are blended. Results of
//! a lane that leaves the loop go to the rows of the construct that it leaves to. A subgroup stops
//! when none of its lanes stays, or when the fuel is out: then the values for the next turn are in
//! the rows, and the interpreter suspends the wave as behind any turn.

use super::lower::int;
use super::{Class, Form, Held, Place, Row, Stretch, Virtual};
use crate::ir::{Type, Value};
use crate::native::allocate::{Carried, STORE, allocate_turn};
use crate::native::encode::{
    Assembler, Base, Constant, Encoding, Memory, NOT_NEGATIVE, NOT_ZERO, Operand, ZERO,
};
use crate::native::opcodes::*;
use crate::native::{LoopContext, STAYING};

/// Lanes on one of the ways through a turn.
#[derive(Clone, Copy)]
pub(crate) struct Lanes(pub(super) Virtual);

/// A value that depends on the way that lanes came.
#[derive(Clone, Copy)]
pub(crate) struct Merged(Held);

/// A loop on its way to instructions.
pub(crate) struct Turns {
    pub stretch: Stretch,
    carried: Vec<Carried>,
    /// Parameters and lanes of the half that is being written.
    entered: Vec<Held>,
    /// Both halves of a subgroup take their turns together, so that one need not wait for the
    /// other's results.
    is_paired: bool,
    /// Subgroups that do so.
    subgroups: usize,
}

impl Turns {
    /// `subgroups` (1, 2 or 4) take their turns together, and where there are halves and
    /// `is_paired`, both halves do; several subgroups take whole turns.
    pub fn new(encoding: Encoding, is_paired: bool, subgroups: usize) -> Turns {
        Turns {
            stretch: Stretch::new(encoding),
            carried: Vec::new(),
            entered: Vec::new(),
            is_paired: (is_paired || subgroups > 1) && encoding == Encoding::Vex,
            subgroups,
        }
    }

    /// How often a turn is written.
    pub fn copies(&self) -> usize {
        match self.is_paired {
            true => 2 * self.subgroups,
            false => self.subgroups,
        }
    }

    /// Half subgroups that take a turn together.
    fn halves(&self) -> u32 {
        match (self.stretch.encoding, self.is_paired) {
            (Encoding::Vex, false) => 1,
            _ => 2 * self.subgroups as u32,
        }
    }

    /// Begins a turn, or another copy of it; gives the lanes that take it.
    pub fn begin(&mut self, copy: usize, params: &[Place]) -> Lanes {
        let s = &mut self.stretch;
        (s.half, s.subgroup) = match self.is_paired {
            true => (Some(copy as i32 % 2), copy / 2),
            false => (None, copy),
        };
        s.held.clear();
        s.results.clear();
        let lanes = s.value(s.class_of(Type::I1), None, false);
        self.entered = vec![Held::One(lanes)];
        for param in params {
            let held = s.operand(param);
            self.entered.push(held);
        }
        Lanes(lanes)
    }

    /// Ends a turn: the lanes that take the next one, and its parameters.
    pub fn end(&mut self, lanes: Lanes, params: &[Merged]) {
        let ends = std::iter::once(Held::One(lanes.0)).chain(params.iter().map(|param| param.0));
        // Bytes from the first mask.
        let mask = 2 * self.stretch.subgroup as i32 + self.stretch.half.unwrap_or(0);
        for (k, (before, after)) in self.entered.iter().zip(ends).enumerate() {
            for (before, after) in before.parts().zip(after.parts()) {
                self.carried.push(Carried {
                    before,
                    after,
                    lanes: (k == 0).then_some(mask),
                    register: None,
                });
            }
        }
    }

    /// The lanes of some where a condition holds, and where it does not.
    pub fn split(&mut self, lanes: Lanes, condition: &Place) -> Option<[Lanes; 2]> {
        let s = &mut self.stretch;
        let Held::One(condition) = s.operand(condition) else {
            return None;
        };
        let [yes, no] = match s.encoding {
            Encoding::Evex => [KAND, KANDN].map(|op| s.masks(op, &[condition, lanes.0])),
            Encoding::Vex => [
                s.commutative(PAND, condition, lanes.0),
                s.binary(PANDN, condition, lanes.0),
            ],
        };
        s.end_operation();
        Some([Lanes(yes), Lanes(no)])
    }

    /// Lanes that come together.
    pub fn join(&mut self, a: Lanes, b: Lanes) -> Lanes {
        let s = &mut self.stretch;
        let both = match s.encoding {
            Encoding::Evex => s.masks(KOR, &[a.0, b.0]),
            Encoding::Vex => s.commutative(POR, a.0, b.0),
        };
        s.end_operation();
        Lanes(both)
    }

    /// The value of `result` when lanes have come to its construct's end with `from`, and others
    /// before with `others`.
    pub fn merge(
        &mut self,
        lanes: Lanes,
        from: &Place,
        others: Option<Merged>,
        result: &Place,
    ) -> Merged {
        let s = &mut self.stretch;
        let new = s.operand(from);
        let class = s.class_of(from.ty);
        let merged = match (new, others.map(|others| others.0)) {
            (Held::One(new), Some(Held::One(old))) => Held::One(match class {
                Class::Vector => s.select(lanes.0, new, old),
                Class::Mask => {
                    let new = s.masks(KAND, &[lanes.0, new]);
                    let old = s.masks(KANDN, &[lanes.0, old]);
                    s.masks(KOR, &[new, old])
                }
            }),
            (Held::Two(a, b), Some(Held::Two(x, y))) => {
                let [low, high] = s.wide_lanes(lanes.0);
                Held::Two(s.select_wide(low, a, x), s.select_wide(high, b, y))
            }
            (Held::One(new), _) if class == Class::Mask => Held::One(s.masks(KAND, &[new, new])),
            (Held::One(new), _) => Held::One(s.copy(new)),
            (Held::Two(a, b), _) => Held::Two(s.copy(a), s.copy(b)),
        };
        for (k, part) in merged.parts().enumerate() {
            s.infos[part as usize].home = s.home(result, k as i32);
        }
        s.end_operation();
        Merged(merged)
    }

    /// A value as it is, where all lanes come by one way.
    pub fn only(&mut self, from: &Place) -> Merged {
        Merged(self.stretch.operand(from))
    }

    /// The construct's result from here on.
    pub fn define(&mut self, result: Value, merged: Merged) {
        self.stretch.held.insert(result, merged.0);
    }

    /// Words that lanes load from a region, one behind another from an offset on. Words that are
    /// not inside are zero. `is_run`: those of one lane after the other may lie so, too.
    pub fn load(
        &mut self,
        lanes: Lanes,
        region: usize,
        (offset, is_run): (&Place, bool),
        results: &[Option<Place>],
    ) -> Option<()> {
        let s = &mut self.stretch;
        let Held::One(offset) = s.operand(offset) else {
            return None;
        };
        let at = Memory::At(Base::Context, LoopContext::last(region));
        let last = s.value(Class::Vector, Some(at), true);
        for (k, result) in results.iter().enumerate() {
            let Some(result) = result else {
                continue;
            };
            // Signed numbers in the order of unsigned ones.
            let start = s.words((1 << 31) + 4 * k as u32);
            let offset = s.commutative(PADDD, offset, start);
            let inside = match s.encoding {
                Encoding::Evex => {
                    let inside = s.condition(PCMPD, offset, last, int::LE);
                    s.masks(KAND, &[inside, lanes.0])
                }
                Encoding::Vex => {
                    let outside = s.binary(PCMPGTD, offset, last);
                    s.binary(PANDN, outside, lanes.0)
                }
            };
            let to = match (s.encoding, is_run && results.len() == 1) {
                (Encoding::Evex, true) => {
                    let words = std::array::from_fn(|lane| 4 * lane as u32);
                    let steps = s.constant(Constant::Words(words));
                    let from = [offset, inside, steps];
                    s.step(Class::Vector, PGATHERDD, Form::Gather, &from)
                }
                _ => s.step(Class::Vector, PGATHERDD, Form::Gather, &[offset, inside]),
            };
            s.steps.last_mut().expect("pushed").immediate = Some(region as u8);
            s.give(result, Held::One(to));
            s.operations += 1;
            s.end_operation();
        }
        Some(())
    }

    /// As [`Self::load`], of an offset that is the same in all of the lanes.
    pub fn load_at_one_place(
        &mut self,
        lanes: Lanes,
        region: usize,
        offset: &Place,
        results: &[Option<Place>],
    ) -> Option<()> {
        let s = &mut self.stretch;
        if s.encoding == Encoding::Vex {
            return self.load(lanes, region, (offset, false), results);
        }
        let Held::One(offset) = s.operand(offset) else {
            return None;
        };
        // Other lanes have offsets of their own.
        let from = [lanes.0, offset];
        let first = s.step(Class::Vector, PCOMPRESSD, Form::ReverseZeroing, &from);
        for (k, result) in results.iter().enumerate() {
            let Some(result) = result else {
                continue;
            };
            let form = Form::LoadOne(4 * k as u32);
            let to = s.step(Class::Vector, PBROADCASTD, form, &[first]);
            s.steps.last_mut().expect("pushed").immediate = Some(region as u8);
            s.give(result, Held::One(to));
            s.operations += 1;
            s.end_operation();
        }
        Some(())
    }

    /// Lanes leave the loop and take `from` along to a row.
    pub fn leave(&mut self, lanes: Lanes, from: &Place, row: Row) {
        let s = &mut self.stretch;
        let value = s.operand(from);
        let place = Place { row, ..*from };
        let (op, lanes) = match (value, s.encoding) {
            (Held::One(_), _) => (STORE, [lanes.0; 2]),
            (Held::Two(..), Encoding::Vex) => (STORE, s.wide_lanes(lanes.0)),
            (Held::Two(..), Encoding::Evex) => (STORE_WIDE, s.wide_lanes(lanes.0)),
        };
        for (k, part) in value.parts().enumerate() {
            let home = s.home(&place, k as i32);
            let step = s.step(Class::Vector, op, Form::Leave, &[lanes[k], part]);
            s.infos[step as usize].home = home;
        }
        s.operations += 1;
        s.end_operation();
    }

    /// The code: see [`LoopCode`](crate::native::LoopCode). Each turn of a subgroup takes twice
    /// `fuel`. `None`: more values live at once than there are registers for.
    pub fn assemble(mut self, fuel: u32) -> Option<Vec<u8>> {
        let (encoding, halves, subgroups) = (self.stretch.encoding, self.halves(), self.subgroups);
        let mut a = Assembler::new(encoding);
        // push rbx; push r14; mov r14, r9; mov r11, [r14]; mov r10, r8
        a.bytes.extend([0x53, 0x41, 0x56, 0x4d, 0x89, 0xce]);
        a.bytes.extend([0x4d, 0x8b, 0x1e, 0x4d, 0x89, 0xc2]);
        let start = a.bytes.len();
        if halves == 1 {
            // mov r8, rdi; mov r9, rdi; mov eax, 2
            a.bytes
                .extend([0x49, 0x89, 0xf8, 0x49, 0x89, 0xf9, 0xb8, 2, 0, 0, 0]);
        }
        if subgroups > 1 {
            // lea r8, [rdi + rcx]
            a.bytes.extend([0x4c, 0x8d, 0x04, 0x0f]);
        }
        if subgroups > 2 {
            // lea r9, [rdi + 2 rcx]; lea rax, [r8 + 2 rcx]
            a.bytes.extend([0x4c, 0x8d, 0x0c, 0x4f]);
            a.bytes.extend([0x49, 0x8d, 0x04, 0x48]);
        }
        let half = a.bytes.len();
        let bits = self.stretch.constant(Constant::LaneBits);
        let bits = self.stretch.infos[bits as usize].home?;
        let homes: Vec<Option<Memory>> = (self.carried.iter().map(|value| value.before as usize))
            .map(|value| self.stretch.infos[value].home)
            .collect();
        let (steps, infos) = (&self.stretch.steps, self.stretch.infos);
        let head = allocate_turn(steps, infos, &mut self.carried, bits, &mut a).ok()?;

        // On to the next turn with lanes that stay.
        let lanes = |value: &&Carried| value.lanes.is_some();
        let masks: Vec<_> = self.carried.iter().filter(lanes).collect();
        let mut some = Vec::new();
        let mut none = None;
        for (k, value) in masks.iter().enumerate() {
            let register = value.register?;
            let rm = Operand::Register(register);
            match encoding {
                Encoding::Vex => a.vector(TESTPS, (register, 0, rm), 0, None),
                Encoding::Evex => a.mask(KORTESTW, (register, 0, rm), false, None),
            }
            match k + 1 < masks.len() {
                true => some.push(a.jump_ahead(NOT_ZERO)),
                false => none = Some(a.jump_ahead(ZERO)),
            }
        }
        some.into_iter().for_each(|jump| a.land(jump));
        // sub r11, the turn's fuel
        a.bytes.extend([0x49, 0x81, 0xeb]);
        a.bytes.extend((fuel * halves).to_le_bytes());
        let next = a.jump_ahead(NOT_NEGATIVE);
        a.land_at(next, head);

        // The fuel is out.
        for (value, home) in self.carried.iter().zip(homes) {
            if let (Some(register), Some(home), None) = (value.register, home, value.lanes) {
                a.vector(STORE, (register, 0, Operand::Memory(home)), 0, None);
            }
        }
        for value in masks {
            const EBX: u8 = 3;
            let rm = Operand::Register(value.register?);
            let at = STAYING as u8 + value.lanes? as u8;
            match encoding {
                Encoding::Vex => {
                    a.vector(MOVMSKPS, (EBX, 0, rm), 0, None);
                    // mov [r10 + at], bl
                    a.bytes.extend([0x41, 0x88, 0x5a, at]);
                }
                Encoding::Evex => {
                    a.mask(KMOV_OUT, (EBX, 0, rm), false, None);
                    // mov [r10 + at], bx
                    a.bytes.extend([0x66, 0x41, 0x89, 0x5a, at]);
                }
            }
        }
        a.land(none?);

        // add r10, a byte for each eight lanes
        a.bytes.extend([0x49, 0x83, 0xc2, halves as u8]);
        if halves == 1 {
            // add r8, 32; add r9, 64; dec eax
            a.bytes
                .extend([0x49, 0x83, 0xc0, 32, 0x49, 0x83, 0xc1, 64, 0xff, 0xc8]);
            a.jump_if_not_zero(half);
        }
        // lea rdi, [rdi + subgroups * rcx]; dec rdx
        let scale = subgroups.trailing_zeros() as u8;
        a.bytes
            .extend([0x48, 0x8d, 0x3c, scale << 6 | 0x0f, 0x48, 0xff, 0xca]);
        a.jump_if_not_zero(start);
        // mov [r14], r11; pop r14; pop rbx; vzeroupper; ret
        a.bytes.extend([0x4d, 0x89, 0x1e, 0x41, 0x5e, 0x5b]);
        a.bytes.extend([0xc5, 0xf8, 0x77, 0xc3]);
        Some(a.finish(&self.stretch.pool))
    }
}

impl Stretch {
    /// Lanes as masks of lanes of 64 bits: the lower and the upper ones.
    pub(super) fn wide_lanes(&mut self, lanes: Virtual) -> [Virtual; 2] {
        match self.encoding {
            Encoding::Evex => {
                let upper = self.masks(KSHIFTRW, &[lanes]);
                self.steps.last_mut().expect("pushed").immediate = Some(8);
                [lanes, upper]
            }
            Encoding::Vex => match self.widen(PMOVSXDQ, lanes) {
                Held::Two(low, high) => [low, high],
                Held::One(_) => unreachable!("two registers"),
            },
        }
    }

    pub(super) fn select_wide(&mut self, lanes: Virtual, a: Virtual, b: Virtual) -> Virtual {
        let op = match self.encoding {
            Encoding::Evex => PBLENDMQ,
            Encoding::Vex => BLENDVPS,
        };
        self.step(Class::Vector, op, Form::Blend, &[lanes, a, b])
    }
}
