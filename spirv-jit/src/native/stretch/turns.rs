//! Loops without suspensions, calls and stores to shared memory, in native code.
//!
//! A subgroup takes all its turns, then the next one does. Up to four subgroups take their turns
//! together where registers suffice, so that none waits for its own results. Masks of lanes say
//! where control is: both sides of a branch are computed, and their results are blended. Results of
//! a lane that leaves the loop go to the rows of the construct that it leaves to. A subgroup stops
//! when none of its lanes stays, or when the fuel is out: then the values for the next turn are in
//! the rows, and the interpreter suspends the wave as behind any turn.

use smallvec::SmallVec;

use super::lower::int;
use super::weave::{in_turn, waits};
use super::{Class, Form, Held, IrOperand, Stretch, ValueRow, Virtual, without_unused};
use crate::ir::{Type, Value};
use crate::native::allocate::{Alike, Carried, LOAD, STORE, Step, Turn, allocate_turn};
use crate::native::encode::{
    Assembler, Base, Constant, Encoding, Memory, NOT_NEGATIVE, NOT_ZERO, Operand, ZERO,
};
use crate::native::opcodes::*;
use crate::native::{LoopContext, Own, STAYING, WORKGROUP};

/// Lanes on one of the ways through a turn: a condition for each half of the subgroup, or twice the
/// same where code takes one register of lanes at a time.
#[derive(Clone, Copy)]
pub(crate) struct Lanes(pub(super) [Virtual; 2]);

/// A value that depends on the way that lanes came, by halves as [`Lanes`].
#[derive(Clone, Copy)]
pub(crate) struct Merged([Held; 2]);

/// A parameter of the turn that is being written.
struct Entered {
    held: [Held; 2],
    place: IrOperand,
    is_alike: bool,
}

/// Instructions, at least, of a turn of several subgroups for each that moves a value to or from
/// the stack.
const STEPS_OF_SPILL: usize = 8;

/// Instructions, at least, of a turn whose subgroups and halves take its operations in turn, for
/// each that moves a value to or from memory.
const STEPS_OF_MOVE: usize = 16;

/// Bytes that are loaded at one place, at most, before a place is computed again.
const MOST_AT_ONCE: u32 = 64;

/// Bytes between the words of neighbouring lanes that are loaded without a gather, at most.
const MOST_DISTANCE: u32 = 1 << 16;

/// Words of a lane that are loaded at once, at most.
const FOUR: usize = 4;

/// A loop on its way to instructions.
pub(crate) struct Turns {
    pub(super) stretch: Stretch,
    carried: Vec<Carried>,
    lanes: Option<Lanes>,
    params: Vec<Entered>,
    /// Both halves of a subgroup take their turns together: neither need wait for the other's
    /// results, and operations across lanes see both.
    is_paired: bool,
    /// Subgroups that do so.
    subgroups: usize,
    /// Memory of a subgroup's own is accessed.
    pub(super) takes_own: bool,
}

impl Turns {
    /// `subgroups` (1, 2 or 4) take their turns together, and where there are halves and
    /// `is_paired`, both halves do; several subgroups take whole turns.
    pub fn new(encoding: Encoding, is_paired: bool, subgroups: usize) -> Turns {
        Turns {
            stretch: Stretch::new(encoding),
            carried: Vec::new(),
            lanes: None,
            params: Vec::new(),
            is_paired: (is_paired || subgroups > 1) && encoding == Encoding::Vex,
            subgroups,
            takes_own: false,
        }
    }

    /// How often a turn is written: for each subgroup that takes it.
    pub fn copies(&self) -> usize {
        self.subgroups
    }

    /// Operations of all copies.
    pub fn operations(&self) -> usize {
        self.stretch.operations
    }

    /// Whether memory of a subgroup's own is accessed.
    pub fn takes_own(&self) -> bool {
        self.takes_own
    }

    /// Half subgroups that take a turn together.
    fn halves(&self) -> u32 {
        match (self.stretch.encoding, self.is_paired) {
            (Encoding::Vex, false) => 1,
            _ => 2 * self.subgroups as u32,
        }
    }

    /// Registers that hold a word of each lane of a subgroup.
    pub(super) fn sides(&self) -> usize {
        1 + self.is_paired as usize
    }

    /// Writes the same for each half of a subgroup.
    pub(super) fn by_halves<T: Copy>(
        &mut self,
        mut write: impl FnMut(&mut Stretch, usize) -> Option<T>,
    ) -> Option<[T; 2]> {
        let is_paired = self.is_paired;
        let s = &mut self.stretch;
        s.half = is_paired.then_some(0);
        let low = write(s, 0)?;
        if !is_paired {
            return Some([low; 2]);
        }
        let operations = s.operations;
        s.half = Some(1);
        let high = write(s, 1)?;
        (s.half, s.operations) = (None, operations);
        Some([low, high])
    }

    /// Writes an operation whose results are the same in all lanes that come to it: for one half,
    /// and the other has the same registers. All its operands are the same in all lanes of a
    /// subgroup, so that its results are, too, whichever lanes come to it.
    fn once<T>(
        &mut self,
        results: &[Value],
        write: impl FnOnce(&mut Stretch) -> Option<T>,
    ) -> Option<T> {
        let s = &mut self.stretch;
        s.half = self.is_paired.then_some(0);
        let first = s.infos.len();
        let written = write(s)?;
        s.half = None;
        if self.is_paired {
            for info in &mut s.infos[first..] {
                if !matches!(
                    info.home,
                    Some(Memory::Pool(_) | Memory::At(Base::Uniforms, _))
                ) {
                    // Code for the other half comes later, when the row may hold another value.
                    (info.home, info.is_home) = (None, false);
                }
            }
            for &result in results {
                if let Some(&held) = s.held[0].get(&result) {
                    s.held[1].insert(result, held);
                }
            }
        }
        Some(written)
    }

    /// Writes an operation without memory. `is_alike`: its results are the same in all lanes that
    /// come to it, because its operands are.
    pub fn perform(
        &mut self,
        results: &[Value],
        is_alike: bool,
        write: impl Fn(&mut Stretch) -> bool,
    ) -> Option<()> {
        match is_alike {
            true => self.once(results, |s| write(s).then_some(())),
            false => self.by_halves(|s, _| write(s).then_some(())).map(|_| ()),
        }
    }

    /// Begins a turn of a subgroup; gives the lanes that take it. Parameters that are `alike` are
    /// the same in all lanes that do.
    pub fn begin(&mut self, subgroup: usize, params: &[(IrOperand, bool)]) -> Lanes {
        self.stretch.subgroup = subgroup;
        self.stretch.held = Default::default();
        self.stretch.results.clear();
        let lanes = self.by_halves(|s, _| Some(s.value(s.class_of(Type::I1), None, false)));
        let lanes = Lanes(lanes.expect("a register for each half"));
        self.lanes = Some(lanes);
        self.params.clear();
        for &(place, is_alike) in params {
            let held = match is_alike {
                true => {
                    let held = self.once(&[place.value], |s| Some(s.operand(&place)));
                    held.map(|held| [held; 2])
                }
                false => self.by_halves(|s, _| Some(s.operand(&place))),
            };
            self.params.push(Entered {
                held: held.expect("registers for each half"),
                place,
                is_alike,
            });
        }
        lanes
    }

    /// Ends a turn: the lanes that take the next one, and its parameters.
    pub fn end(&mut self, lanes: Lanes, params: &[Merged]) {
        let sides = self.sides();
        let subgroup = self.stretch.subgroup as i32;
        let entered = self.lanes.expect("a turn has begun").0;
        for half in 0..sides {
            // Bytes from the first mask.
            let mask = 2 * subgroup + half as i32;
            self.carried.push(Carried {
                lanes: Some(mask),
                ..Carried::new(entered[half], lanes.0[half])
            });
        }
        for (param, after) in std::mem::take(&mut self.params).iter().zip(params) {
            if param.is_alike {
                self.end_alike(param, after.0[0]);
                continue;
            }
            for (before, after) in param.held.iter().zip(&after.0).take(sides) {
                for (before, after) in before.parts().zip(after.parts()) {
                    self.carried.push(Carried::new(before, after));
                }
            }
        }
    }

    /// A parameter that is the same in all lanes: it is brought there when the loop is entered, and
    /// its rows are written when the fuel is out.
    fn end_alike(&mut self, param: &Entered, after: Held) {
        let is_paired = self.is_paired;
        let s = &mut self.stretch;
        let mut homes = [None; 2];
        for (half, home) in homes.iter_mut().enumerate() {
            s.half = is_paired.then_some(half as i32);
            *home = s.home(&param.place, 0);
        }
        s.half = None;
        let ([Some(first), Some(second)], is_wide) = (homes, param.place.ty.rows() == 2) else {
            unreachable!("a parameter has a row");
        };
        for (k, (before, after)) in param.held[0].parts().zip(after.parts()).enumerate() {
            let behind = k as i32 * s.encoding.vector_bytes();
            self.carried.push(Carried {
                alike: Some(Alike {
                    first,
                    is_wide,
                    is_half: s.encoding == Encoding::Vex && !is_paired,
                    mask: 2 * s.subgroup as i32,
                    rows: [first.behind(behind), second.behind(behind)],
                }),
                ..Carried::new(before, after)
            });
        }
    }

    /// The lanes of some where a condition holds, and where it does not.
    pub fn split(&mut self, lanes: Lanes, condition: &IrOperand) -> Option<[Lanes; 2]> {
        let both = self.by_halves(|s, half| {
            let Held::One(condition) = s.operand(condition) else {
                return None;
            };
            let yes = s.both(condition, lanes.0[half]);
            let no = s.second_alone(condition, lanes.0[half]);
            s.end_operation();
            Some([yes, no])
        })?;
        Some([0, 1].map(|which| Lanes(both.map(|half| half[which]))))
    }

    /// Lanes that come together.
    pub fn join(&mut self, a: Lanes, b: Lanes) -> Lanes {
        let both = self.by_halves(|s, half| {
            let both = s.either(a.0[half], b.0[half]);
            s.end_operation();
            Some(both)
        });
        Lanes(both.expect("a register for each half"))
    }

    /// The value of `result` when lanes have come to its construct's end with `from`, and others
    /// before with `others`.
    pub fn merge(
        &mut self,
        lanes: Lanes,
        from: &IrOperand,
        others: Option<Merged>,
        result: &IrOperand,
    ) -> Merged {
        let merged = self.by_halves(|s, half| {
            let others = others.map(|others| others.0[half]);
            Some(s.merge(lanes.0[half], from, others, result))
        });
        Merged(merged.expect("registers for each half"))
    }

    /// A value as it is, where all lanes come by one way.
    pub fn only(&mut self, from: &IrOperand) -> Merged {
        let held = self.by_halves(|s, _| Some(s.operand(from)));
        Merged(held.expect("registers for each half"))
    }

    /// The construct's result from here on.
    pub fn define(&mut self, result: Value, merged: Merged) {
        for (held, merged) in self.stretch.held.iter_mut().zip(merged.0) {
            held.insert(result, merged);
        }
    }

    /// Words that lanes load from a region, one behind another from an offset on. Words that are
    /// not inside are zero. `distance`: how far neighbouring lanes' words may be apart.
    pub fn load(
        &mut self,
        lanes: Lanes,
        region: usize,
        (offset, distance): (&IrOperand, u32),
        results: &[Option<IrOperand>],
    ) -> Option<()> {
        self.takes_own |= region == WORKGROUP;
        self.by_halves(|s, half| {
            let Held::One(offset) = s.operand(offset) else {
                return None;
            };
            let at = Memory::At(Base::Context, LoopContext::last(region));
            let last = s.value(Class::Vector, Some(at), true);
            let mut word = 0;
            while word < results.len() {
                let near = &results[word..results.len().min(word + FOUR)];
                let Some(result) = &near[0] else {
                    word += 1;
                    continue;
                };
                // Signed numbers in the order of unsigned ones.
                let start = s.words((1 << 31) + 4 * word as u32);
                let lanes = lanes.0[half];
                match near.iter().flatten().count() {
                    2.. if s.encoding == Encoding::Vex => {
                        let place = s.commutative(PADDD, offset, start);
                        s.load_fours(place, lanes, region, near);
                        word += FOUR;
                    }
                    _ => {
                        let place = s.commutative(PADDD, offset, start);
                        let inside = s.inside(place, last, lanes);
                        s.gather(place, inside, distance, region, result);
                        word += 1;
                    }
                }
                s.end_operation();
            }
            Some(())
        })?;
        Some(())
    }

    /// As [`Self::load`], of an offset that is the same in all of the lanes, because of how it was
    /// computed.
    pub fn load_at_one_place(
        &mut self,
        region: usize,
        offset: &IrOperand,
        results: &[Option<IrOperand>],
    ) -> Option<()> {
        self.takes_own |= region == WORKGROUP;
        let used: Vec<(u32, IrOperand)> = (0..)
            .zip(results)
            .filter_map(|(k, result)| result.map(|result| (4 * k, result)))
            .collect();
        let values: Vec<Value> = used.iter().map(|(_, place)| place.value).collect();
        self.once(&values, |s| {
            let Held::One(offset) = s.operand(offset) else {
                return None;
            };
            let mut words = 0..0;
            for &(behind, result) in &used {
                let is_next = words.contains(&behind);
                if !is_next {
                    let near = used.iter().map(|&(at, _)| at);
                    let last = near.filter(|at| (behind..behind + MOST_AT_ONCE).contains(at));
                    words = behind..last.max().expect("the word itself") + 4;
                }
                let (first, last) = (behind, words.end - 4);
                let (form, from) = match is_next {
                    false => (Form::LoadOne { first, last }, &[offset][..]),
                    true => (Form::LoadNext(last - behind), &[][..]),
                };
                let to = s.step(Class::Vector, PBROADCASTD, form, from);
                s.steps.last_mut().expect("pushed").immediate = Some(region as u8);
                s.give(&result, Held::One(to));
                s.operations += 1;
            }
            s.end_operation();
            Some(())
        })
    }

    /// Lanes leave the loop and take `from` along to a row.
    pub fn leave(&mut self, lanes: Lanes, from: &IrOperand, row: ValueRow) {
        let left = self.by_halves(|s, half| {
            s.leave(lanes.0[half], from, row);
            Some(())
        });
        left.expect("a register for each half");
    }

    /// The code: see [`LoopCode`](crate::native::LoopCode). Each turn of a subgroup takes twice
    /// `fuel`. `None`: more values live at once than there are registers and rows for, or several
    /// subgroups have too few registers.
    pub fn assemble(mut self, fuel: u32) -> Option<Vec<u8>> {
        let mut a = Assembler::new(self.stretch.encoding);
        let stack_size = emit_entry(&mut a);
        let start = a.bytes.len();
        self.emit_pointers(&mut a);
        let half = a.bytes.len();
        let turn = self.emit_turn(&mut a)?;
        let none = self.emit_next_turn(&mut a, turn.head, fuel)?;
        // The fuel is out.
        self.emit_rows(&mut a)?;
        a.land(none);
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
        if self.subgroups > 1 {
            // lea r8, [rdi + rcx]
            a.bytes.extend([0x4c, 0x8d, 0x04, 0x0f]);
        }
        if self.subgroups > 2 {
            // lea r9, [rdi + 2 rcx]; lea rax, [r8 + 2 rcx]
            a.bytes.extend([0x4c, 0x8d, 0x0c, 0x4f]);
            a.bytes.extend([0x49, 0x8d, 0x04, 0x48]);
        }
    }

    /// The first turn's beginning, then the turn: with halves and subgroups in turn if its results
    /// wait for each other, and registers suffice.
    fn emit_turn(&mut self, a: &mut Assembler) -> Option<Turn> {
        let (halves, subgroups) = (self.halves() as usize, self.subgroups);
        let bits = self.stretch.constant(Constant::LaneBits);
        let bits = self.stretch.infos[bits as usize].home?;
        let infos = std::mem::take(&mut self.stretch.infos);
        let mut is_used: Vec<bool> = infos.iter().map(|info| info.keep).collect();
        for value in &self.carried {
            is_used[value.after as usize] = true;
        }
        let steps = without_unused(std::mem::take(&mut self.stretch.steps), is_used);
        let waits = self.is_paired && waits(&steps, infos.len(), halves);
        let woven = waits.then(|| in_turn(&steps, subgroups)).and_then(|steps| {
            let (mut carried, mut attempt) = (self.carried.clone(), a.clone());
            let turn = allocate_turn(&steps, infos.clone(), &mut carried, bits, &mut attempt);
            let turn = turn.ok()?;
            let moves = turn.spills + turn.evictions;
            (moves * STEPS_OF_MOVE <= steps.len()).then_some((turn, carried, attempt))
        });
        if let Some((turn, carried, attempt)) = woven {
            (self.carried, *a) = (carried, attempt);
            return Some(turn);
        }
        let steps = halves_apart(steps);
        let turn = allocate_turn(&steps, infos, &mut self.carried, bits, a).ok()?;
        (subgroups == 1 || turn.spills * STEPS_OF_SPILL <= steps.len()).then_some(turn)
    }

    /// The masks of lanes among the carried values.
    fn masks(&self) -> impl Iterator<Item = &Carried> {
        self.carried.iter().filter(|value| value.lanes.is_some())
    }

    /// On to the next turn, at `head`, with lanes that stay. The jump is taken if there are none.
    fn emit_next_turn(&self, a: &mut Assembler, head: usize, fuel: u32) -> Option<usize> {
        let count = self.masks().count();
        let mut some = Vec::new();
        let mut none = None;
        for (k, value) in self.masks().enumerate() {
            let register = value.register?;
            let rm = Operand::Register(register);
            match self.stretch.encoding {
                Encoding::Vex => a.vector(TESTPS, (register, 0, rm), 0, None),
                Encoding::Evex => a.mask(KORTESTW, (register, 0, rm), false, None),
            }
            match k + 1 < count {
                true => some.push(a.jump_ahead(NOT_ZERO)),
                false => none = Some(a.jump_ahead(ZERO)),
            }
        }
        some.into_iter().for_each(|jump| a.land(jump));
        // sub r11, the turn's fuel
        a.bytes.extend([0x49, 0x81, 0xeb]);
        a.bytes.extend((fuel * self.halves()).to_le_bytes());
        let next = a.jump_ahead(NOT_NEGATIVE);
        a.land_at(next, head);
        none
    }

    /// Stores the values and the lanes for the next turn: the interpreter goes on with them.
    fn emit_rows(&self, a: &mut Assembler) -> Option<()> {
        for value in &self.carried {
            let Some(register) = value.register else {
                continue;
            };
            let rows = match &value.alike {
                Some(alike) if alike.rows[0] != alike.rows[1] => alike.rows.to_vec(),
                Some(alike) => vec![alike.rows[0]],
                None => value.home.into_iter().collect(),
            };
            for row in rows {
                a.vector(STORE, (register, 0, Operand::Memory(row)), 0, None);
            }
        }
        for value in self.masks() {
            const EBX: u8 = 3;
            let rm = Operand::Register(value.register?);
            let at = STAYING as u8 + value.lanes? as u8;
            match self.stretch.encoding {
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
        // No register holds anything any more.
        for value in &self.carried {
            if let (None, Some(home), Some(alike)) = (value.register, value.home, &value.alike)
                && alike.rows[0] != home
            {
                a.vector(LOAD, (0, 0, Operand::Memory(home)), 0, None);
                for row in alike.rows {
                    a.vector(STORE, (0, 0, Operand::Memory(row)), 0, None);
                }
            }
        }
        Some(())
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

/// All that one half does before what the other does, up to each step that takes both.
fn halves_apart(steps: Vec<Step>) -> Vec<Step> {
    let mut apart = Vec::with_capacity(steps.len());
    let mut second = Vec::new();
    for step in steps {
        match step.half {
            Some(0) => apart.push(step),
            Some(_) => second.push(step),
            None => {
                apart.append(&mut second);
                apart.push(step);
            }
        }
    }
    apart.append(&mut second);
    apart
}

impl Stretch {
    /// See [`Turns::merge`].
    fn merge(
        &mut self,
        lanes: Virtual,
        from: &IrOperand,
        others: Option<Held>,
        to: &IrOperand,
    ) -> Held {
        let new = self.operand(from);
        let class = self.class_of(from.ty);
        let merged = match (new, others) {
            (Held::One(new), Some(Held::One(old))) => Held::One(match class {
                Class::Vector => self.select(lanes, new, old),
                Class::Mask => self.select_condition(lanes, new, old),
            }),
            (Held::Two(a, b), Some(Held::Two(x, y))) => {
                let [low, high] = self.wide_lanes(lanes);
                Held::Two(self.select_wide(low, a, x), self.select_wide(high, b, y))
            }
            (Held::One(new), _) if class == Class::Mask => Held::One(self.both(new, new)),
            (Held::One(new), _) => Held::One(self.copy(new)),
            (Held::Two(a, b), _) => Held::Two(self.copy(a), self.copy(b)),
        };
        for (k, part) in merged.parts().enumerate() {
            self.infos[part as usize].home = self.home(to, k as i32);
        }
        self.end_operation();
        merged
    }

    /// See [`Turns::leave`].
    fn leave(&mut self, lanes: Virtual, from: &IrOperand, row: ValueRow) {
        let value = self.operand(from);
        let place = IrOperand { row, ..*from };
        let (op, lanes) = match (value, self.encoding) {
            (Held::One(_), _) => (STORE, [lanes; 2]),
            (Held::Two(..), Encoding::Vex) => (STORE, self.wide_lanes(lanes)),
            (Held::Two(..), Encoding::Evex) => (STORE_WIDE, self.wide_lanes(lanes)),
        };
        for (k, part) in value.parts().enumerate() {
            let home = self.home(&place, k as i32);
            let step = self.step(Class::Vector, op, Form::Leave, &[lanes[k], part]);
            self.infos[step as usize].home = home;
        }
        self.operations += 1;
        self.end_operation();
    }

    /// The lanes of some whose word, at an offset less 2³¹, is inside.
    fn inside(&mut self, offset: Virtual, last: Virtual, lanes: Virtual) -> Virtual {
        match self.encoding {
            Encoding::Evex => {
                let inside = self.condition(PCMPD, offset, last, int::LE);
                self.masks(KAND, &[inside, lanes])
            }
            Encoding::Vex => {
                let outside = self.binary(PCMPGTD, offset, last);
                self.binary(PANDN, outside, lanes)
            }
        }
    }

    /// Gathers words, or loads them without a gather where they have a distance.
    fn gather(
        &mut self,
        place: Virtual,
        lanes: Virtual,
        distance: u32,
        region: usize,
        result: &IrOperand,
    ) {
        let mut from = SmallVec::<[Virtual; 3]>::from_slice(&[place, lanes]);
        let has_code = match self.encoding {
            Encoding::Vex => (4..=MOST_DISTANCE).contains(&distance),
            Encoding::Evex => distance == 4,
        };
        if has_code {
            let steps = std::array::from_fn(|lane| distance * lane as u32);
            from.push(self.constant(Constant::Words(steps)));
        }
        let to = self.step(Class::Vector, PGATHERDD, Form::Gather(distance), &from);
        self.steps.last_mut().expect("pushed").immediate = Some(region as u8);
        self.give(result, Held::One(to));
        self.operations += 1;
    }

    /// Loads words that lie one behind another; the first of up to four is used.
    fn load_fours(
        &mut self,
        place: Virtual,
        lanes: Virtual,
        region: usize,
        results: &[Option<IrOperand>],
    ) {
        let fours = self.words(4);
        let from = [place, lanes, fours];
        let first = self.step(Class::Vector, PGATHERDD, Form::LoadFours, &from);
        let mut more = [None; FOUR - 1];
        for (k, result) in results.iter().enumerate() {
            let Some(result) = result else {
                continue;
            };
            let to = match k.checked_sub(1) {
                None => first,
                Some(k) => *more[k].insert(self.value(Class::Vector, None, false)),
            };
            self.give(result, Held::One(to));
            self.operations += 1;
        }
        let step = self.steps.last_mut().expect("pushed");
        (step.more, step.immediate) = (more, Some(region as u8));
    }

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
