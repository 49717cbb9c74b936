//! Operations across the lanes of a subgroup, in loops with AVX-512, where a register holds all of
//! a subgroup's lanes. What each must give, [`eval::subgroup`](crate::eval::subgroup) says.
//!
//! Lanes that take part are those that have come to the operation. Sums and products of floats have
//! no code: their lanes combine one after another.

use super::lower::{float, int};
use super::turns::{Lanes, Turns};
use super::{Held, Place, Stretch};
use crate::SUBGROUP_SIZE;
use crate::eval;
use crate::ir::op::{ReduceOp, SubgroupOp};
use crate::ir::{Op, Type};
use crate::native::allocate::{Class, Form, Virtual, Vote};
use crate::native::encode::{Constant, Encoding, Memory};
use crate::native::opcodes::*;

const LANES: u32 = SUBGROUP_SIZE as u32;

/// How [`SHUFFLE_QUARTERS`] and [`PSHUFD`] change places of halves, and of neighbours in each half.
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
        // Any number is chosen before a NaN.
        ReduceOp::FMin if ty == Type::F32 => (Op::FMin, f32::NAN.to_bits().into()),
        ReduceOp::FMax if ty == Type::F32 => (Op::FMax, f32::NAN.to_bits().into()),
        _ => return None,
    })
}

impl Turns {
    /// The lanes' numbers.
    pub fn lane_index(&mut self, result: &Place) -> Option<()> {
        self.hold_words(std::array::from_fn(|lane| lane as u32), result)
    }

    /// An operation on words that are known when code is written, such as lanes' numbers.
    pub fn fold(&mut self, op: &Op, operands: &[Place], result: &Place) -> Option<()> {
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
        let [a, b] = [self.known_words(&a)?, self.known_words(&b)?];
        self.hold_words(std::array::from_fn(|lane| call(a[lane], b[lane])), result)
    }

    fn hold_words(&mut self, words: [u32; SUBGROUP_SIZE], result: &Place) -> Option<()> {
        let s = &mut self.stretch;
        if s.encoding == Encoding::Vex {
            return None;
        }
        let held = s.constant(Constant::Words(words));
        s.held.insert(result.value, Held::One(held));
        Some(())
    }

    fn known_words(&self, place: &Place) -> Option<[u32; SUBGROUP_SIZE]> {
        let s = &self.stretch;
        if let Some(&constant) = place.constant.as_ref() {
            return Some([constant as u32; SUBGROUP_SIZE]);
        }
        let &Held::One(held) = s.held.get(&place.value)? else {
            return None;
        };
        match s.infos[held as usize].home {
            Some(Memory::Pool(index)) => match s.pool[index as usize] {
                Constant::Words(words) => Some(words),
                _ => None,
            },
            _ => None,
        }
    }

    /// A subgroup operation in which some lanes take part; `None` where it has no code.
    pub fn across(
        &mut self,
        lanes: Lanes,
        op: SubgroupOp,
        operands: &[Place],
        result: &Place,
    ) -> Option<()> {
        if self.stretch.encoding == Encoding::Vex {
            return None;
        }
        let from = match (op, operands.get(1)) {
            (SubgroupOp::Shuffle | SubgroupOp::QuadShuffle, Some(from)) => self.known_words(from),
            _ => None,
        };
        let takes_conditions = matches!(op, SubgroupOp::All | SubgroupOp::Any | SubgroupOp::Ballot);
        if operands
            .iter()
            .any(|place| (place.ty == Type::I1) != takes_conditions)
        {
            return None;
        }
        let s = &mut self.stretch;
        let held: Vec<Held> = operands.iter().map(|place| s.operand(place)).collect();
        let given = match (op, &held[..]) {
            (SubgroupOp::Elect, _) => Held::One(s.lowest(lanes.0)),
            (SubgroupOp::All, &[Held::One(a)]) => {
                let others = s.masks(KANDN, &[a, lanes.0]);
                Held::One(s.vote(Vote::None, others))
            }
            (SubgroupOp::Any, &[Held::One(a)]) => {
                let some = s.masks(KAND, &[a, lanes.0]);
                Held::One(s.vote(Vote::Some, some))
            }
            (SubgroupOp::Ballot, &[Held::One(a)]) => {
                let some = s.masks(KAND, &[a, lanes.0]);
                Held::One(s.bits_of(some))
            }
            (SubgroupOp::AllEqual, &[Held::One(a)]) if operands[0].ty != Type::F16 => {
                let first = s.broadcast_first(lanes.0, a);
                let same = match operands[0].ty {
                    Type::F32 => s.condition(CMPPS, a, first, float::EQ),
                    _ => s.condition(PCMPD, a, first, int::EQ),
                };
                let others = s.masks(KANDN, &[same, lanes.0]);
                Held::One(s.vote(Vote::None, others))
            }
            (SubgroupOp::BroadcastFirst, &[Held::One(a)]) => {
                Held::One(s.broadcast_first(lanes.0, a))
            }
            (SubgroupOp::Shuffle, &[Held::One(a), Held::One(b)]) => {
                let is_inside =
                    |words: [u32; SUBGROUP_SIZE]| words.iter().all(|&lane| lane < LANES);
                Held::One(match from.is_some_and(is_inside) {
                    true => s.binary(PERMD, b, a),
                    false => {
                        let end = s.words(LANES);
                        let inside = s.condition(PCMPUD, b, end, int::LT);
                        s.step(Class::Vector, PERMD, Form::Zeroing, &[inside, b, a])
                    }
                })
            }
            (SubgroupOp::QuadShuffle, &[Held::One(a), Held::One(b)]) => {
                // Numbers past the last lane have no bit among lanes.
                let bits = match from {
                    Some(words) => s.constant(Constant::Words(
                        words.map(|lane| 1u32.checked_shl(lane).unwrap_or(0)),
                    )),
                    None => {
                        let one = s.words(1);
                        s.binary(PSLLVD, one, b)
                    }
                };
                let active = s.bits_of(lanes.0);
                let is_active = s.step(Class::Mask, PTESTMD, Form::Binary, &[active, bits]);
                let other = s.binary(PERMD, b, a);
                Held::One(s.select(is_active, other, a))
            }
            (SubgroupOp::Reduce { op, cluster }, &[held]) => {
                s.reduce(lanes.0, op, cluster.into(), operands[0].ty, held)?
            }
            (SubgroupOp::InclusiveScan(op), &[Held::One(a)]) => {
                Held::One(s.scan(lanes.0, op, true, operands[0].ty, a)?)
            }
            (SubgroupOp::ExclusiveScan(op), &[Held::One(a)]) => {
                Held::One(s.scan(lanes.0, op, false, operands[0].ty, a)?)
            }
            _ => return None,
        };
        s.give(result, given);
        s.operations += 1;
        s.end_operation();
        Some(())
    }
}

impl Stretch {
    /// The lowest lane of a mask; none of none.
    fn lowest(&mut self, lanes: Virtual) -> Virtual {
        let ones = self.masks(KXNOR, &[lanes, lanes]);
        let less = self.masks(KADD, &[lanes, ones]);
        self.masks(KANDN, &[less, lanes])
    }

    fn vote(&mut self, vote: Vote, lanes: Virtual) -> Virtual {
        self.step(Class::Mask, KMOV_IN, Form::OfVote(vote), &[lanes])
    }

    /// A bit for each lane of a mask, in all lanes.
    fn bits_of(&mut self, lanes: Virtual) -> Virtual {
        self.step(Class::Vector, PBROADCASTD_OF, Form::OfBits, &[lanes])
    }

    /// The word of the lowest lane of a mask, in all lanes.
    fn broadcast_first(&mut self, lanes: Virtual, a: Virtual) -> Virtual {
        let from = [lanes, a];
        let first = self.step(Class::Vector, PCOMPRESSD, Form::ReverseZeroing, &from);
        self.step(Class::Vector, PBROADCASTD, Form::Registers, &[first])
    }

    /// Combines the lanes of a mask in each cluster of so many.
    fn reduce(
        &mut self,
        lanes: Virtual,
        op: ReduceOp,
        cluster: usize,
        ty: Type,
        held: Held,
    ) -> Option<Held> {
        let (op, neutral) = combination(op, ty)?;
        match held {
            Held::One(a) => {
                let neutral = self.words(neutral as u32);
                let mut all = self.select(lanes, a, neutral);
                for step in [8, 4, 2, 1].into_iter().filter(|&step| step < cluster) {
                    let other = match step {
                        8 => self.quarters(all, HALVES),
                        4 => self.quarters(all, NEIGHBOURS),
                        2 => self.step_with(PSHUFD, Form::Unary, &[all], HALVES),
                        _ => self.step_with(PSHUFD, Form::Unary, &[all], NEIGHBOURS),
                    };
                    all = self.combine(&op, ty, all, other)?;
                }
                Some(Held::One(all))
            }
            Held::Two(a, b) => {
                let (opcode, form) = self.wide_opcode(&op, ty)?;
                // All lanes of both words: the wide ones that are neutral.
                let neutral = match neutral {
                    0 => self.words(0),
                    u64::MAX => self.words(u32::MAX),
                    _ => return None,
                };
                let masks = self.wide_lanes(lanes);
                let mut parts = [(masks[0], a), (masks[1], b)]
                    .map(|(lanes, part)| self.select_wide(lanes, part, neutral));
                if cluster > 8 {
                    let both = self.step(Class::Vector, opcode, form, &parts);
                    parts = [both; 2];
                }
                let count = if cluster > 8 { 1 } else { 2 };
                for part in &mut parts[..count] {
                    for step in [4, 2, 1].into_iter().filter(|&step| step < cluster) {
                        let other = match step {
                            4 => self.quarters(*part, HALVES),
                            2 => self.quarters(*part, NEIGHBOURS),
                            _ => self.step_with(PSHUFD, Form::Unary, &[*part], HALVES),
                        };
                        *part = self.step(Class::Vector, opcode, form, &[*part, other]);
                    }
                }
                if cluster > 8 {
                    // Rows of their own.
                    parts[1] = self.copy(parts[0]);
                }
                Some(Held::Two(parts[0], parts[1]))
            }
        }
    }

    /// Combines the lanes of a mask up to each lane; without the lane itself unless `inclusive`.
    fn scan(
        &mut self,
        lanes: Virtual,
        op: ReduceOp,
        inclusive: bool,
        ty: Type,
        a: Virtual,
    ) -> Option<Virtual> {
        // The result for no lanes is the neutral number of integers alone.
        if ty.is_float() {
            return None;
        }
        let (op, neutral) = combination(op, ty)?;
        let neutral = self.words(neutral as u32);
        let mut all = self.select(lanes, a, neutral);
        let behind = |s: &mut Self, all, step: usize| {
            let from = [all, neutral];
            s.step_with(ALIGND, Form::Binary, &from, (SUBGROUP_SIZE - step) as u8)
        };
        for step in [1, 2, 4, 8] {
            let before = behind(self, all, step);
            all = self.combine(&op, ty, before, all)?;
        }
        Some(match inclusive {
            true => all,
            false => behind(self, all, 1),
        })
    }

    /// An operation on two registers' lanes.
    fn combine(&mut self, op: &Op, ty: Type, a: Virtual, b: Virtual) -> Option<Virtual> {
        let place = Place {
            value: crate::ir::Value(u32::MAX),
            ty,
            row: super::Row::Nowhere,
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
