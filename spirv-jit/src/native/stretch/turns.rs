//! Loops without suspensions, calls and stores to shared memory, in native code.
//!
//! A subgroup takes all its turns, then the next one does. Up to four subgroups take their turns
//! together where registers suffice, so that none waits for its own results. Masks of lanes say
//! where control is: both sides of a branch are computed, and their results are blended; code jumps
//! over a long body that no lane comes to. Results of a lane that leaves the loop go to the rows of
//! the construct that it leaves to. A subgroup stops as soon as none of its lanes stays, or at a
//! turn's end when the fuel is out: then the values for the next turn are in the rows, and the
//! interpreter suspends the wave as behind any turn.

use foldhash::HashSet;
use smallvec::SmallVec;

use super::lower::int;
use super::{Class, Form, Held, IrOperand, Stretch, ValueRow, Virtual};
use crate::ir::{Type, Value};
use crate::native::allocate::{
    Alike, Carried, Exit, STORE, Spread, TURNS_TOGETHER, blocks, choice,
};
use crate::native::encode::{Base, Constant, Encoding, Memory};
use crate::native::opcodes::*;
use crate::native::{LoopContext, WORKGROUP};

/// Lanes on one of the ways through a turn: a condition for each half of the subgroup, or twice the
/// same where code takes one register of lanes at a time.
#[derive(Clone, Copy)]
pub(crate) struct Lanes(pub(super) [Virtual; 2]);

/// A value that depends on the way that lanes came, by halves as [`Lanes`].
#[derive(Clone, Copy)]
pub(crate) struct Merged([Held; 2]);

/// The lanes among which a value is the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sameness {
    Nowhere,
    /// All lanes of a subgroup.
    Subgroup,
    /// All lanes of all subgroups that take the loop together.
    Together,
}

/// A parameter of the turn that is being written.
struct Entered {
    held: [Held; 2],
    place: IrOperand,
    sameness: Sameness,
}

/// Bytes that are loaded at one place, at most, before a place is computed again.
const MOST_AT_ONCE: u32 = 64;

/// Bytes between the words of neighbouring lanes that are loaded without a gather, at most.
const MOST_DISTANCE: u32 = 1 << 16;

/// The same of those that are chosen from whole vectors: AVX-512 only.
const MOST_IN_VECTORS: u32 = 32;

/// Words of a lane that are loaded at once, at most.
const FOUR: usize = 4;

/// A loop on its way to instructions.
pub(crate) struct Turns {
    pub(super) stretch: Stretch,
    pub(super) carried: Vec<Carried>,
    pub(super) lanes: Option<Lanes>,
    params: Vec<Entered>,
    /// Values that are the same in all subgroups: the first one's code computes them.
    shared: HashSet<Value>,
    /// Where the loop ends inside of a turn, in the order of the turn.
    pub(super) exits: Vec<Exit>,
    /// How many of them the turn of this subgroup has come to.
    pub(super) exits_so_far: usize,
    /// Bodies of branches that are never jumped over.
    pub(super) kept_bodies: HashSet<usize>,
    /// Both halves of a subgroup take their turns together: neither need wait for the other's
    /// results, and operations across lanes see both.
    pub(super) is_paired: bool,
    /// Subgroups that do so.
    pub(super) subgroups: usize,
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
            shared: HashSet::default(),
            exits: Vec::new(),
            exits_so_far: 0,
            kept_bodies: HashSet::default(),
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
    pub(super) fn halves(&self) -> u32 {
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
    /// and the other has the same registers; all subgroups do where it `is_for_all`. All its
    /// operands are the same in all lanes of a subgroup, so that its results are, too, whichever
    /// lanes come to it.
    fn once<T>(
        &mut self,
        results: &[Value],
        is_for_all: bool,
        write: impl FnOnce(&mut Stretch) -> Option<T>,
    ) -> Option<T> {
        let s = &mut self.stretch;
        s.half = self.is_paired.then_some(0);
        let first = s.infos.len();
        let written = write(s)?;
        s.half = None;
        if self.is_paired || is_for_all {
            for info in &mut s.infos[first..] {
                if !matches!(
                    info.home,
                    Some(Memory::Pool(_) | Memory::At(Base::Uniforms, _))
                ) {
                    // Code for the others comes later, when the row may hold another value.
                    (info.home, info.is_home) = (None, false);
                }
            }
        }
        if self.is_paired {
            for &result in results {
                if let Some(&held) = s.held[0].get(&result) {
                    s.held[1].insert(result, held);
                }
            }
        }
        Some(written)
    }

    /// As [`Self::once`], of results that are the same in all subgroups: the first one's code
    /// writes it.
    fn once_for_all<T: Default>(
        &mut self,
        results: &[Value],
        write: impl FnOnce(&mut Stretch) -> Option<T>,
    ) -> Option<T> {
        if self.subgroups == 1 {
            return self.once(results, false, write);
        }
        if self.stretch.subgroup > 0 {
            // Code of all subgroups counts the same operations.
            self.stretch.operations += 1;
            return Some(T::default());
        }
        let first = self.stretch.steps.len();
        let written = self.once(results, true, write)?;
        for step in &mut self.stretch.steps[first..] {
            step.subgroup = TURNS_TOGETHER;
        }
        self.shared.extend(results);
        Some(written)
    }

    /// Writes an operation without memory. `sameness`: that of its results, because of its
    /// operands.
    pub fn perform(
        &mut self,
        results: &[Value],
        sameness: Sameness,
        write: impl Fn(&mut Stretch) -> bool,
    ) -> Option<()> {
        match sameness {
            Sameness::Together => self.once_for_all(results, |s| write(s).then_some(())),
            Sameness::Subgroup => self.once(results, false, |s| write(s).then_some(())),
            Sameness::Nowhere => self.by_halves(|s, _| write(s).then_some(())).map(|_| ()),
        }
    }

    /// Begins a turn of a subgroup; gives the lanes that take it.
    pub fn begin(&mut self, subgroup: usize, params: &[(IrOperand, Sameness)]) -> Lanes {
        let s = &mut self.stretch;
        s.subgroup = subgroup;
        let is_uniform = |held: Held| {
            held.parts().all(|part| {
                let info = &s.infos[part as usize];
                info.is_home && matches!(info.home, Some(Memory::At(Base::Uniforms, _)))
            })
        };
        for side in &mut s.held {
            side.retain(|value, held| is_uniform(*held) || self.shared.contains(value));
        }
        s.results.clear();
        self.exits_so_far = 0;
        let lanes = self.by_halves(|s, _| Some(s.value(s.class_of(Type::I1), None, false)));
        let lanes = Lanes(lanes.expect("a register for each half"));
        self.lanes = Some(lanes);
        self.params.clear();
        for &(place, sameness) in params {
            let is_for_all = sameness == Sameness::Together && self.subgroups > 1;
            let held = match sameness {
                Sameness::Nowhere => self.by_halves(|s, _| Some(s.operand(&place))),
                Sameness::Together if subgroup > 0 => {
                    self.stretch.known(place.value).map(|held| [held; 2])
                }
                _ => {
                    let held = self.once(&[place.value], is_for_all, |s| Some(s.operand(&place)));
                    held.map(|held| [held; 2])
                }
            };
            if is_for_all {
                self.shared.insert(place.value);
            }
            self.params.push(Entered {
                held: held.expect("registers for each half"),
                place,
                sameness,
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
            match param.sameness {
                Sameness::Together if subgroup > 0 => continue,
                Sameness::Nowhere => {}
                _ => {
                    self.end_alike(param, after.0[0]);
                    continue;
                }
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
        let subgroups = match param.sameness {
            Sameness::Together => 0..self.subgroups,
            _ => s.subgroup..s.subgroup + 1,
        };
        let own = s.subgroup;
        let mut homes = SmallVec::<[Memory; 2]>::new();
        for subgroup in subgroups {
            for half in 0..2 {
                (s.subgroup, s.half) = (subgroup, is_paired.then_some(half));
                let home = s.home(&param.place, 0).expect("a parameter has a row");
                if !homes.contains(&home) {
                    homes.push(home);
                }
            }
        }
        (s.subgroup, s.half) = (own, None);
        let is_wide = param.place.ty.rows() == 2;
        for (k, (before, after)) in param.held[0].parts().zip(after.parts()).enumerate() {
            let behind = k as i32 * s.encoding.vector_bytes();
            self.carried.push(Carried {
                alike: Some(Alike {
                    first: homes[0],
                    is_wide,
                    is_half: s.encoding == Encoding::Vex && !is_paired,
                    mask: 2 * s.subgroup as i32,
                    rows: homes.iter().map(|home| home.behind(behind)).collect(),
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
                    2.. => {
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
    /// computed. `is_shared`: in those of all subgroups.
    pub fn load_at_one_place(
        &mut self,
        region: usize,
        (offset, is_shared): (&IrOperand, bool),
        results: &[Option<IrOperand>],
    ) -> Option<()> {
        self.takes_own |= region == WORKGROUP;
        let used: Vec<(u32, IrOperand)> = (0..)
            .zip(results)
            .filter_map(|(k, result)| result.map(|result| (4 * k, result)))
            .collect();
        let values: Vec<Value> = used.iter().map(|(_, place)| place.value).collect();
        let write = |s: &mut Stretch| {
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
        };
        match is_shared {
            true => self.once_for_all(&values, write),
            false => self.once(&values, false, write),
        }
    }

    /// Lanes leave the loop and take `from` along to a row.
    pub fn leave(&mut self, lanes: Lanes, from: &IrOperand, row: ValueRow) {
        let left = self.by_halves(|s, half| {
            s.leave(lanes.0[half], from, row);
            Some(())
        });
        left.expect("a register for each half");
    }
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
            (Held::One(new), Some(Held::One(old))) if new == old && class == Class::Vector => {
                Held::One(self.copy(new))
            }
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
    pub(super) fn inside(&mut self, offset: Virtual, last: Virtual, lanes: Virtual) -> Virtual {
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
        let mut first_choice = 0;
        let has_code = match self.encoding {
            Encoding::Vex => (4..=MOST_DISTANCE).contains(&distance),
            Encoding::Evex => {
                distance.is_multiple_of(4) && (4..=MOST_IN_VECTORS).contains(&distance)
            }
        };
        if has_code && self.encoding == Encoding::Evex {
            let choices = (1..blocks(distance).count()).map(|block| choice(distance, block));
            first_choice = self.neighbours(choices.map(Constant::Words).collect());
        }
        if has_code {
            let steps = std::array::from_fn(|lane| distance * lane as u32);
            from.push(self.constant(Constant::Words(steps)));
        }
        let spread = Spread {
            distance,
            first_choice,
        };
        let to = self.step(Class::Vector, PGATHERDD, Form::Gather(spread), &from);
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
