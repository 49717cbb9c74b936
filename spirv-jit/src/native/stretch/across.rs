//! Operations across the lanes of a subgroup, in loops that take all of a subgroup's lanes at once:
//! in one register with AVX-512, in two with AVX2. What each must give,
//! [`eval::subgroup`](crate::eval::subgroup) says.
//!
//! Lanes that take part are those that have come to the operation. Sums and products of floats
//! combine lanes one after another; scans of floats have no code.

use smallvec::SmallVec;

use super::lower::{LEFT, RIGHT, float, int};
use super::turns::{Lanes, Turns};
use super::{Held, IrOperand, Stretch};
use crate::SUBGROUP_SIZE;
use crate::eval;
use crate::ir::op::{ReduceOp, SubgroupOp};
use crate::ir::{Op, Type};
use crate::native::allocate::{Class, Form, Virtual, Vote};
use crate::native::encode::{Constant, Encoding, Memory, Opcode};
use crate::native::opcodes::*;

const LANES: u32 = SUBGROUP_SIZE as u32;

/// Lanes of one of the registers of AVX2, and of a quarter of a subgroup.
const HALF: usize = SUBGROUP_SIZE / 2;
const QUARTER: usize = SUBGROUP_SIZE / 4;

/// The registers of all lanes of a value, in the order of lanes.
type Registers = SmallVec<[Virtual; 4]>;

/// A word of each lane.
type LaneWords = [u32; SUBGROUP_SIZE];

/// How instructions change places of halves, and of neighbours in each half.
const HALVES: u8 = 0x4e;
const NEIGHBOURS: u8 = 0xb1;

/// An operation on two scalars, and a scalar that changes no other when combined with it.
fn combination(op: ReduceOp, ty: Type) -> Option<(Op, u64)> {
    let ones = u64::MAX >> (64 - ty.bits());
    let is_float = ty.is_float();
    Some(match op {
        ReduceOp::IAdd => (Op::IAdd, 0),
        ReduceOp::IMul => (Op::IMul, 1),
        ReduceOp::SMin => (Op::SMin, ones >> 1),
        ReduceOp::UMin => (Op::UMin, ones),
        ReduceOp::SMax => (Op::SMax, ones ^ ones >> 1),
        ReduceOp::UMax => (Op::UMax, 0),
        ReduceOp::And if !is_float => (Op::And, ones),
        ReduceOp::Or if !is_float => (Op::Or, 0),
        ReduceOp::Xor if !is_float => (Op::Xor, 0),
        ReduceOp::FAdd if ty == Type::F32 => (Op::FAdd, (-0f32).to_bits().into()),
        ReduceOp::FMul if ty == Type::F32 => (Op::FMul, 1f32.to_bits().into()),
        // Any number is chosen before a NaN.
        ReduceOp::FMin if ty == Type::F32 => (Op::FMin, f32::NAN.to_bits().into()),
        ReduceOp::FMax if ty == Type::F32 => (Op::FMax, f32::NAN.to_bits().into()),
        _ => return None,
    })
}

impl Turns {
    /// The lanes' numbers.
    pub fn lane_index(&mut self, result: &IrOperand) -> Option<()> {
        self.hold_words(std::array::from_fn(|lane| lane as u32), result)
    }

    /// An operation on words that are known when code is written, such as lanes' numbers.
    pub fn fold(&mut self, op: &Op, operands: &[IrOperand], result: &IrOperand) -> Option<()> {
        let call = match op {
            Op::And => eval::and::<u32>,
            Op::Or => eval::or::<u32>,
            Op::Xor => eval::xor::<u32>,
            Op::IAdd => eval::iadd::<u32>,
            Op::ISub => eval::isub::<u32>,
            Op::Shl => eval::shl::<u32>,
            Op::LShr => eval::lshr::<u32>,
            _ => return None,
        };
        let &[a, b] = operands else {
            return None;
        };
        if [a.ty, b.ty, result.ty] != [Type::I32; 3] {
            return None;
        }
        let [a, b] = [self.words_of(&a)?, self.words_of(&b)?];
        self.hold_words(std::array::from_fn(|lane| call(a[lane], b[lane])), result)
    }

    fn hold_words(&mut self, words: LaneWords, result: &IrOperand) -> Option<()> {
        let sides = self.sides();
        let s = &mut self.stretch;
        if s.encoding == Encoding::Vex && sides == 1 {
            // Halves take turns of their own.
            return None;
        }
        for (side, register) in s.known_words(words).into_iter().enumerate() {
            s.held[side].insert(result.value, Held::One(register));
        }
        Some(())
    }

    /// The words that a value has in each lane, where that is known.
    fn words_of(&self, place: &IrOperand) -> Option<LaneWords> {
        let s = &self.stretch;
        if let Some(&constant) = place.constant.as_ref() {
            return Some([constant as u32; SUBGROUP_SIZE]);
        }
        let mut words = [0; SUBGROUP_SIZE];
        let lanes = SUBGROUP_SIZE / self.sides();
        for (held, words) in s.held.iter().zip(words.chunks_mut(lanes)) {
            let &Held::One(register) = held.get(&place.value)? else {
                return None;
            };
            let Some(Memory::Pool(index)) = s.infos[register as usize].home else {
                return None;
            };
            match s.pool[index as usize] {
                Constant::Words(known) => words.copy_from_slice(&known[..lanes]),
                Constant::Word(word) => words.fill(word),
                Constant::LaneBits => return None,
            }
        }
        Some(words)
    }

    /// The registers of all lanes of a value.
    fn registers(&mut self, place: &IrOperand) -> Registers {
        let is_paired = self.sides() == 2;
        let s = &mut self.stretch;
        let mut registers = Registers::new();
        for half in 0..=is_paired as i32 {
            s.half = is_paired.then_some(half);
            registers.extend(s.operand(place).parts());
        }
        s.half = None;
        registers
    }

    /// Notes where a result is.
    fn give(&mut self, place: &IrOperand, registers: &[Virtual]) {
        let is_paired = self.sides() == 2;
        let s = &mut self.stretch;
        let is_same = |both: &[Virtual]| both.first() == both.last();
        for (half, registers) in registers.chunks(place.ty.rows() as usize).enumerate() {
            s.half = is_paired.then_some(half as i32);
            s.give(
                place,
                match *registers {
                    [a, b] => Held::Two(a, b),
                    _ => Held::One(registers[0]),
                },
            );
        }
        s.half = None;
        if is_paired && is_same(registers) {
            // Both halves have it.
            s.infos[registers[0] as usize].home = None;
        }
    }

    /// A subgroup operation in which some lanes take part; `None` where it has no code. `most`: no
    /// lane's last operand is greater.
    pub fn across(
        &mut self,
        lanes: Lanes,
        op: SubgroupOp,
        operands: &[IrOperand],
        most: u32,
        result: &IrOperand,
    ) -> Option<()> {
        let sides = self.sides();
        if self.stretch.encoding == Encoding::Vex && sides == 1 {
            return None;
        }
        let takes_conditions = matches!(op, SubgroupOp::All | SubgroupOp::Any | SubgroupOp::Ballot);
        if operands
            .iter()
            .any(|place| (place.ty == Type::I1) != takes_conditions)
        {
            return None;
        }
        let from = match (op, operands.get(1)) {
            (SubgroupOp::Shuffle | SubgroupOp::QuadShuffle, Some(from)) => self.words_of(from),
            _ => None,
        };
        let held: Vec<Registers> = operands.iter().map(|place| self.registers(place)).collect();
        let lanes = &lanes.0[..sides];
        let ty = operands.first().map(|place| place.ty);
        let is_word = operands.iter().all(|place| place.ty.rows() == 1);
        let s = &mut self.stretch;
        let given = match (op, &held[..], ty) {
            (SubgroupOp::Elect, ..) => s.lowest(lanes),
            (SubgroupOp::All, [a], _) => {
                let others = s.by_lanes(a, lanes, Stretch::second_alone);
                s.vote(Vote::None, &others)
            }
            (SubgroupOp::Any, [a], _) => {
                let some = s.by_lanes(a, lanes, Stretch::both);
                s.vote(Vote::Some, &some)
            }
            (SubgroupOp::Ballot, [a], _) => {
                let some = s.by_lanes(a, lanes, Stretch::both);
                let bits = s.bits_of(&some);
                Registers::from_elem(bits, sides)
            }
            (SubgroupOp::AllEqual, [a], Some(ty)) if is_word && ty != Type::F16 => {
                let first = s.broadcast_first(lanes, a);
                let same = s.by_lanes(a, &first, |s, a, first| match ty {
                    Type::F32 => s.condition(CMPPS, a, first, float::EQ),
                    _ => s.compare_words(a, first, int::EQ, true),
                });
                let others = s.by_lanes(&same, lanes, Stretch::second_alone);
                s.vote(Vote::None, &others)
            }
            (SubgroupOp::BroadcastFirst, [a], _) if is_word => s.broadcast_first(lanes, a),
            (SubgroupOp::Shuffle, [a, b], _) if is_word => s.shuffle(a, b, from, most),
            (SubgroupOp::QuadShuffle, [a, b], _) if is_word => s.quad_shuffle(lanes, a, b, from),
            (SubgroupOp::Reduce { op, cluster }, [a], Some(ty)) => {
                s.reduce(lanes, op, cluster.into(), ty, a)?
            }
            (SubgroupOp::InclusiveScan(op), [a], Some(ty)) if is_word => {
                s.scan(lanes, op, true, ty, a)?
            }
            (SubgroupOp::ExclusiveScan(op), [a], Some(ty)) if is_word => {
                s.scan(lanes, op, false, ty, a)?
            }
            _ => return None,
        };
        let given = s.apart_from(&held, &given);
        self.give(result, &given);
        self.stretch.operations += 1;
        self.stretch.end_operation();
        Some(())
    }
}

/// The parts of operations across lanes. Each takes registers of all lanes.
impl Stretch {
    /// The registers of a result, copied where they are an operand's because lanes keep their own
    /// words: a result has registers of its own.
    fn apart_from(&mut self, operands: &[Registers], given: &[Virtual]) -> Registers {
        let own = given.iter().map(|&register| {
            match operands.iter().any(|operand| operand.contains(&register)) {
                true => self.copy(register),
                false => register,
            }
        });
        own.collect()
    }

    /// An operation on each register.
    fn by_lanes(
        &mut self,
        a: &[Virtual],
        b: &[Virtual],
        mut write: impl FnMut(&mut Stretch, Virtual, Virtual) -> Virtual,
    ) -> Registers {
        a.iter().zip(b).map(|(&a, &b)| write(self, a, b)).collect()
    }

    /// Words that are known when code is written.
    fn known_words(&mut self, words: LaneWords) -> Registers {
        let lanes = self.encoding.vector_bytes() as usize / 4;
        (words.chunks(lanes))
            .map(|words| match words.iter().all(|&word| word == words[0]) {
                true => self.words(words[0]),
                false => {
                    let mut all = [0; SUBGROUP_SIZE];
                    all[..lanes].copy_from_slice(words);
                    self.constant(Constant::Words(all))
                }
            })
            .collect()
    }

    /// The lowest lane of a condition; none of none.
    fn lowest(&mut self, lanes: &[Virtual]) -> Registers {
        if let &[lanes] = lanes {
            let ones = self.masks(KXNOR, &[lanes, lanes]);
            let less = self.masks(KADD, &[lanes, ones]);
            return Registers::from_slice(&[self.masks(KANDN, &[less, lanes])]);
        }
        let bits = self.bits_of(lanes);
        let zero = self.words(0);
        let negative = self.binary(PSUBD, zero, bits);
        let lowest = self.commutative(PAND, bits, negative);
        let each = self.known_words(std::array::from_fn(|lane| 1 << lane));
        (each.into_iter())
            .map(|bit| {
                let own = self.commutative(PAND, lowest, bit);
                self.commutative(PCMPEQD, own, bit)
            })
            .collect()
    }

    /// All lanes or none.
    fn vote(&mut self, vote: Vote, lanes: &[Virtual]) -> Registers {
        let all = (lanes.iter().copied())
            .reduce(|a, b| self.either(a, b))
            .expect("lanes");
        let class = self.class_of(Type::I1);
        let voted = self.step(class, KMOV_IN, Form::OfVote(vote), &[all]);
        Registers::from_elem(voted, lanes.len())
    }

    /// A bit for each lane of a condition, in all lanes.
    fn bits_of(&mut self, lanes: &[Virtual]) -> Virtual {
        self.step(Class::Vector, PBROADCASTD_OF, Form::OfBits, lanes)
    }

    /// The word of the lowest lane of a condition, in all lanes.
    fn broadcast_first(&mut self, lanes: &[Virtual], a: &[Virtual]) -> Registers {
        let first = self.step_once(PBROADCASTD, Form::OfFirst, lanes);
        self.permute(a, &[first; 2][..lanes.len()])
    }

    /// The result of a step on lanes, which other operations near it may have taken. It is no
    /// result of an operation.
    fn step_once(&mut self, op: Opcode, form: Form, lanes: &[Virtual]) -> Virtual {
        let known = self.near_step((op, form, None), lanes);
        known.unwrap_or_else(|| self.step(Class::Vector, op, form, lanes))
    }

    /// The words of the lanes that some name by the lowest bits of theirs.
    fn permute(&mut self, a: &[Virtual], from: &[Virtual]) -> Registers {
        let mut given = Registers::new();
        for (k, &from_lane) in from.iter().enumerate() {
            if k > 0 && from[k - 1] == from_lane {
                given.push(given[k - 1]);
                continue;
            }
            given.push(match *a {
                [low, high] if low != high => {
                    let [low, high] = [low, high].map(|half| self.binary(PERMD, from_lane, half));
                    let is_high = self.shift(PSHIFTD, LEFT, from_lane, 31 - HALF.ilog2());
                    self.select(is_high, high, low)
                }
                _ => self.binary(PERMD, from_lane, a[0]),
            });
        }
        given
    }

    /// As [`Self::permute`], by lanes that are known when code is written, all below 16.
    fn permute_known(&mut self, a: &[Virtual], from: LaneWords) -> Registers {
        let &[low, high] = a else {
            let from = self.known_words(from);
            return self.permute(a, &from);
        };
        let mut given = Registers::new();
        for half in [0, 1] {
            let own: [u32; HALF] = std::array::from_fn(|lane| from[half * HALF + lane]);
            match half == 1 && own[..] == from[..HALF] {
                true => given.push(given[0]),
                false => given.push(self.permute_half(low, high, own)),
            }
        }
        given
    }

    /// A half of a permutation.
    fn permute_half(&mut self, low: Virtual, high: Virtual, from: [u32; HALF]) -> Virtual {
        let quarter = |lane: u32| lane / QUARTER as u32;
        let is_quarters = (from.chunks(QUARTER))
            .all(|lanes| lanes.iter().all(|&lane| quarter(lane) == quarter(lanes[0])));
        if !is_quarters {
            let index = self.known_words(std::array::from_fn(|lane| from[lane % HALF]))[0];
            let is_high = (from.iter().enumerate()).fold(0, |bits, (lane, &from)| {
                bits | (from as usize / HALF) << lane
            });
            return match is_high {
                0 => self.binary(PERMD, index, low),
                0xff => self.binary(PERMD, index, high),
                _ => {
                    let [low, high] = [low, high].map(|half| self.binary(PERMD, index, half));
                    self.step_with(PBLENDD, Form::Binary, &[low, high], is_high as u8)
                }
            };
        }
        let quarters = [quarter(from[0]), quarter(from[QUARTER])];
        let chosen = match quarters {
            [0, 1] => low,
            [2, 3] => high,
            [first, second] => {
                let how = (first | second << 4) as u8;
                self.step_with(PERM2I128, Form::Binary, &[low, high], how)
            }
        };
        let within = from.map(|lane| lane % QUARTER as u32);
        let places = |lanes: &[u32]| {
            lanes
                .iter()
                .rev()
                .fold(0, |places, lane| places << 2 | lane)
        };
        const IN_PLACE: u32 = 0b11_10_01_00;
        match [places(&within[..QUARTER]), places(&within[QUARTER..])] {
            [IN_PLACE, IN_PLACE] => chosen,
            [first, second] if first == second => {
                self.step_with(PSHUFD, Form::Unary, &[chosen], first as u8)
            }
            _ => {
                let places = self.known_words(std::array::from_fn(|lane| within[lane % HALF]))[0];
                self.binary(PERMILPS, chosen, places)
            }
        }
    }

    /// The words of the lanes that some name; zero for numbers past the last.
    /// None of those is greater than `most`.
    fn shuffle(
        &mut self,
        a: &[Virtual],
        b: &[Virtual],
        from: Option<LaneWords>,
        most: u32,
    ) -> Registers {
        match (from, self.encoding) {
            (Some(from), _) if from.iter().all(|&lane| lane < LANES) => self.permute_known(a, from),
            (Some(from), Encoding::Vex) => {
                let inside = from.map(|lane| if lane < LANES { u32::MAX } else { 0 });
                let words = self.permute_known(a, from.map(|lane| lane % LANES));
                let inside = self.known_words(inside);
                self.by_lanes(&words, &inside, Stretch::both)
            }
            (None, Encoding::Vex) if most < HALF as u32 => self.permute(&a[..1], b),
            (None, Encoding::Vex) if most < LANES => self.permute(a, b),
            (None, Encoding::Vex) => {
                let words = self.permute(a, b);
                self.by_lanes(&words, b, |s, word, from| {
                    let inside = s.is_lane(from);
                    s.both(inside, word)
                })
            }
            (None, Encoding::Evex) if most < LANES => self.permute(a, b),
            (_, Encoding::Evex) => {
                let end = self.words(LANES);
                let inside = self.condition(PCMPUD, b[0], end, int::LT);
                let from = [inside, b[0], a[0]];
                let words = self.step(Class::Vector, PERMD, Form::Zeroing, &from);
                Registers::from_slice(&[words])
            }
        }
    }

    /// Whether words are numbers of lanes. AVX2 only.
    fn is_lane(&mut self, a: Virtual) -> Virtual {
        let above = self.shift(PSHIFTD, RIGHT, a, LANES.ilog2());
        let zero = self.words(0);
        self.commutative(PCMPEQD, above, zero)
    }

    /// The words of the lanes that some name, where those take part; else the lanes' own.
    fn quad_shuffle(
        &mut self,
        lanes: &[Virtual],
        a: &[Virtual],
        b: &[Virtual],
        from: Option<LaneWords>,
    ) -> Registers {
        if let (&[lanes], &[a], &[b]) = (lanes, a, b) {
            // Numbers past the last lane have no bit among lanes.
            let bits = match from {
                Some(words) => {
                    self.known_words(words.map(|lane| 1u32.checked_shl(lane).unwrap_or(0)))[0]
                }
                None => {
                    let one = self.words(1);
                    self.binary(PSLLVD, one, b)
                }
            };
            let active = self.step_once(PBROADCASTD_OF, Form::OfBits, &[lanes]);
            let is_active = self.step(Class::Mask, PTESTMD, Form::Binary, &[active, bits]);
            let other = self.binary(PERMD, b, a);
            return Registers::from_slice(&[self.select(is_active, other, a)]);
        }
        let (others, active) = match from {
            // An inactive lane is as good as its own word.
            Some(from) => {
                let inside = from.map(|lane| if lane < LANES { u32::MAX } else { 0 });
                let from = from.map(|lane| lane % LANES);
                let others = self.permute_known(a, from);
                let mut active = self.permute_known(lanes, from);
                if inside.contains(&0) {
                    let inside = self.known_words(inside);
                    active = self.by_lanes(&active, &inside, Stretch::both);
                }
                (others, active)
            }
            None => {
                let (others, active) = (self.permute(a, b), self.permute(lanes, b));
                let active = self.by_lanes(&active, b, |s, active, from| {
                    let inside = s.is_lane(from);
                    s.both(inside, active)
                });
                (others, active)
            }
        };
        (0..a.len())
            .map(|k| self.select(active[k], others[k], a[k]))
            .collect()
    }

    /// Registers with a scalar that changes no other in all lanes but some.
    fn with_neutral(
        &mut self,
        lanes: &[Virtual],
        neutral: Virtual,
        is_wide: bool,
        a: &[Virtual],
    ) -> Registers {
        if !is_wide {
            let pairs = lanes.iter().zip(a);
            return pairs
                .map(|(&lanes, &a)| self.select(lanes, a, neutral))
                .collect();
        }
        let mut masks = Registers::new();
        for &lanes in lanes {
            masks.extend(self.wide_lanes(lanes));
        }
        let pairs = masks.iter().zip(a);
        pairs
            .map(|(&lanes, &a)| self.select_wide(lanes, a, neutral))
            .collect()
    }

    /// Combines the lanes of a condition in each cluster of so many.
    fn reduce(
        &mut self,
        lanes: &[Virtual],
        op: ReduceOp,
        cluster: usize,
        ty: Type,
        a: &[Virtual],
    ) -> Option<Registers> {
        let (op, neutral) = combination(op, ty)?;
        let is_wide = ty.rows() == 2;
        let neutral = match neutral {
            0 => self.words(0),
            u64::MAX => self.words(u32::MAX),
            _ if is_wide => return None,
            _ => self.words(neutral as u32),
        };
        let mut all = self.with_neutral(lanes, neutral, is_wide, a);
        if let Op::FAdd | Op::FMul = op {
            return self.reduce_in_order(&op, ty, cluster, &all);
        }
        let in_register = self.encoding.vector_bytes() as usize / if is_wide { 8 } else { 4 };
        let mut step = cluster / 2;
        while step >= in_register {
            // With the register that is so many further on, which has the same result.
            let distance = step / in_register;
            for k in 0..all.len() {
                all[k] = match k & distance {
                    0 => self.combine(&op, ty, all[k], all[k + distance])?,
                    _ => all[k - distance],
                };
            }
            step /= 2;
        }
        while step > 0 {
            let before = all.clone();
            for k in 0..all.len() {
                let same = before[..k].iter().position(|&other| other == before[k]);
                all[k] = match same {
                    Some(same) => all[same],
                    None => {
                        let other = self.exchange(before[k], step * if is_wide { 8 } else { 4 });
                        self.combine(&op, ty, before[k], other)?
                    }
                };
            }
            step /= 2;
        }
        Some(all)
    }

    /// Combines the lanes of each cluster one after another, as rounding asks.
    fn reduce_in_order(
        &mut self,
        op: &Op,
        ty: Type,
        cluster: usize,
        all: &[Virtual],
    ) -> Option<Registers> {
        let scalar = match op {
            Op::FAdd => ADDSS,
            _ => MULSS,
        };
        if cluster == SUBGROUP_SIZE {
            let combined = self.step(Class::Vector, scalar, Form::InOrder, all);
            return Some(Registers::from_elem(combined, all.len()));
        }
        let lane = |number| std::array::from_fn(|lane| (lane / cluster * cluster + number) as u32);
        let mut reduced = self.permute_known(all, lane(0));
        for number in 1..cluster {
            let next = self.permute_known(all, lane(number));
            let is_same = reduced.first() == reduced.last() && next.first() == next.last();
            let first = self.combine(op, ty, reduced[0], next[0])?;
            for k in 1..reduced.len() {
                reduced[k] = match is_same {
                    true => first,
                    false => self.combine(op, ty, reduced[k], next[k])?,
                };
            }
            reduced[0] = first;
        }
        Some(reduced)
    }

    /// Changes places of groups of so many bytes within a register.
    fn exchange(&mut self, a: Virtual, bytes: usize) -> Virtual {
        match (bytes, self.encoding) {
            (4, _) => self.step_with(PSHUFD, Form::Unary, &[a], NEIGHBOURS),
            (8, _) => self.step_with(PSHUFD, Form::Unary, &[a], HALVES),
            (16, Encoding::Vex) => self.step_with(PERMQ, Form::Unary, &[a], HALVES),
            (16, Encoding::Evex) => self.quarters(a, NEIGHBOURS),
            _ => self.quarters(a, HALVES),
        }
    }

    /// Combines the lanes of a condition up to each lane; without the lane itself unless
    /// `inclusive`.
    fn scan(
        &mut self,
        lanes: &[Virtual],
        op: ReduceOp,
        inclusive: bool,
        ty: Type,
        a: &[Virtual],
    ) -> Option<Registers> {
        // The result for no lanes is the neutral number of integers alone.
        if ty.is_float() {
            return None;
        }
        let (op, neutral) = combination(op, ty)?;
        let neutral = self.words(neutral as u32);
        let mut all = self.with_neutral(lanes, neutral, false, a);
        for step in [1, 2, 4, 8] {
            let before = self.behind(&all, neutral, step);
            for (before, own) in before.into_iter().zip(&mut all) {
                if before != neutral {
                    *own = self.combine(&op, ty, before, *own)?;
                }
            }
        }
        Some(match inclusive {
            true => all,
            false => self.behind(&all, neutral, 1),
        })
    }

    /// The words of the lanes so many before each; `first` where there are none.
    fn behind(&mut self, all: &[Virtual], first: Virtual, step: usize) -> Registers {
        let &[low, high] = all else {
            let from = [all[0], first];
            let how = (SUBGROUP_SIZE - step) as u8;
            return Registers::from_slice(&[self.step_with(ALIGND, Form::Binary, &from, how)]);
        };
        if step == HALF {
            return Registers::from_slice(&[first, low]);
        }
        let pairs = [(first, low), (low, high)].into_iter();
        pairs
            .map(|(before, own)| {
                // The quarter before each.
                let before = self.step_with(PERM2I128, Form::Binary, &[before, own], 0x21);
                let bytes = 4 * (QUARTER - step % QUARTER) as u8;
                match step {
                    QUARTER => before,
                    _ => self.step_with(PALIGNR, Form::Binary, &[own, before], bytes),
                }
            })
            .collect()
    }

    /// An operation on two registers' lanes.
    fn combine(&mut self, op: &Op, ty: Type, a: Virtual, b: Virtual) -> Option<Virtual> {
        if ty.rows() == 2 {
            let (op, form) = self.wide_opcode(op, ty)?;
            return Some(self.step(Class::Vector, op, form, &[a, b]));
        }
        let place = IrOperand {
            value: crate::ir::Value(u32::MAX),
            ty,
            row: super::ValueRow::Forwarded,
            constant: None,
        };
        match self.lower_binary(op, ty, ty, [&place, &place], a, b)? {
            Held::One(both) => Some(both),
            Held::Two(..) => None,
        }
    }

    fn quarters(&mut self, a: Virtual, how: u8) -> Virtual {
        self.step_with(SHUFFLE_QUARTERS, Form::Registers, &[a, a], how)
    }
}
