//! From operations to instructions. What each must give, to the bit (NaN payloads aside), `eval`
//! says.

use smallvec::SmallVec;

use super::{Held, IrOperand, Stretch};
use crate::ir::{Op, Type};
use crate::native::allocate::{Class, Form, MOVE, Virtual};
use crate::native::encode::{Constant, Encoding, Opcode};
use crate::native::opcodes::*;

/// Numbers of shifts by one count for all lanes.
pub(super) const RIGHT: u8 = 2;
pub(super) const RIGHT_SIGNED: u8 = 4;
pub(super) const LEFT: u8 = 6;

/// Comparisons of [`CMPPS`], none of which signals.
pub(super) mod float {
    pub const EQ: u8 = 0;
    pub const UNORDERED: u8 = 3;
    pub const NE_OR_UNORDERED: u8 = 4;
    pub const EQ_OR_UNORDERED: u8 = 8;
    pub const NE: u8 = 12;
    pub const LT: u8 = 0x11;
    pub const LE: u8 = 0x12;
    pub const LT_OR_UNORDERED: u8 = 0x19;
    pub const LE_OR_UNORDERED: u8 = 0x1a;
    pub const GE: u8 = 0x1d;
}

/// Comparisons of [`PCMPD`].
pub(super) mod int {
    pub const EQ: u8 = 0;
    pub const LT: u8 = 1;
    pub const LE: u8 = 2;
    pub const NE: u8 = 4;
}

/// A number one above or one below a power of two.
struct Near {
    /// The power's exponent.
    shift: u32,
    is_above: bool,
}

/// Which factor of a product is such a number. A shift and a sum or a difference then give the
/// product, on many processors sooner than a multiplication does.
fn near_power(factors: [Option<u64>; 2], bits: u32) -> Option<(usize, Near)> {
    let near = |factor: u64| {
        let all = u64::MAX >> (64 - bits);
        [
            (factor.wrapping_sub(1) & all, true),
            (factor.wrapping_add(1) & all, false),
        ]
        .into_iter()
        .find(|(power, _)| power.is_power_of_two())
        .map(|(power, is_above)| Near {
            shift: power.trailing_zeros(),
            is_above,
        })
    };
    (0..)
        .zip(factors)
        .find_map(|(k, factor)| Some((k, near(factor?)?)))
}

impl Stretch {
    /// A condition: a comparison of floats.
    fn compare(&mut self, a: Virtual, b: Virtual, how: u8) -> Virtual {
        self.condition(CMPPS, a, b, how)
    }

    pub(super) fn condition(&mut self, op: Opcode, a: Virtual, b: Virtual, how: u8) -> Virtual {
        let class = self.class_of(Type::I1);
        let to = self.step(class, op, Form::Binary, &[a, b]);
        self.steps.last_mut().expect("pushed").immediate = Some(how);
        to
    }

    /// A condition: a comparison of integers.
    pub(super) fn compare_words(
        &mut self,
        a: Virtual,
        b: Virtual,
        how: u8,
        signed: bool,
    ) -> Virtual {
        if self.encoding == Encoding::Evex {
            let op = if signed { PCMPD } else { PCMPUD };
            return self.condition(op, a, b, how);
        }
        match (how, signed) {
            (int::EQ, _) => self.commutative(PCMPEQD, a, b),
            (int::NE, _) => {
                let equal = self.commutative(PCMPEQD, a, b);
                self.not(equal)
            }
            (int::LT, true) => self.binary(PCMPGTD, b, a),
            (_, true) => {
                let above = self.binary(PCMPGTD, a, b);
                self.not(above)
            }
            (int::LT, false) => {
                let least = self.commutative(PMINUD, a, b);
                let not_below = self.commutative(PCMPEQD, least, b);
                self.not(not_below)
            }
            (_, false) => {
                let least = self.commutative(PMINUD, a, b);
                self.commutative(PCMPEQD, least, a)
            }
        }
    }

    pub(super) fn select(&mut self, condition: Virtual, a: Virtual, b: Virtual) -> Virtual {
        let op = match self.encoding {
            Encoding::Evex => PBLENDMD,
            Encoding::Vex => BLENDVPS,
        };
        self.step(Class::Vector, op, Form::Blend, &[condition, a, b])
    }

    pub(super) fn masks(&mut self, op: Opcode, from: &[Virtual]) -> Virtual {
        self.step(Class::Mask, op, Form::OfMasks, from)
    }

    /// As [`Self::select`], of conditions.
    pub(super) fn select_condition(&mut self, which: Virtual, a: Virtual, b: Virtual) -> Virtual {
        let chosen = self.both(which, a);
        let other = self.second_alone(which, b);
        self.either(chosen, other)
    }

    /// Where both of two conditions hold.
    pub(super) fn both(&mut self, a: Virtual, b: Virtual) -> Virtual {
        match self.encoding {
            Encoding::Evex => self.masks(KAND, &[a, b]),
            Encoding::Vex => self.commutative(PAND, a, b),
        }
    }

    /// Where one of two conditions holds.
    pub(super) fn either(&mut self, a: Virtual, b: Virtual) -> Virtual {
        match self.encoding {
            Encoding::Evex => self.masks(KOR, &[a, b]),
            Encoding::Vex => self.commutative(POR, a, b),
        }
    }

    /// Where the second of two conditions holds, and the first does not.
    pub(super) fn second_alone(&mut self, a: Virtual, b: Virtual) -> Virtual {
        match self.encoding {
            Encoding::Evex => self.masks(KANDN, &[a, b]),
            Encoding::Vex => self.binary(PANDN, a, b),
        }
    }

    /// Both operands are conditions: mask registers with AVX-512.
    fn logic(&mut self, op: &Op, a: Virtual, b: Virtual) -> Option<Virtual> {
        let evex = self.encoding == Encoding::Evex;
        Some(match op {
            Op::And => self.both(a, b),
            Op::Or => self.either(a, b),
            Op::Xor | Op::INe if evex => self.masks(KXOR, &[a, b]),
            Op::IEq if evex => self.masks(KXNOR, &[a, b]),
            Op::Xor | Op::INe => self.commutative(PXOR, a, b),
            Op::IEq => {
                let differ = self.commutative(PXOR, a, b);
                self.not(differ)
            }
            _ => return None,
        })
    }

    /// `fmin` (`fmax`): with a NaN the other operand; of zeros of both signs the one with (without)
    /// a sign.
    fn least(&mut self, op: Opcode, zeros: Opcode, a: Virtual, b: Virtual) -> Virtual {
        // `a` where it is the least, else `b`: so with a NaN in `a`, too.
        let least = self.binary(op, a, b);
        let both = self.commutative(zeros, a, b);
        let equal = self.compare(a, b, float::EQ);
        let least = self.select(equal, both, least);
        let is_nan = self.compare(b, b, float::UNORDERED);
        self.select(is_nan, a, least)
    }

    fn extreme(&mut self, op: &Op, [x, y]: [&IrOperand; 2], a: Virtual, b: Virtual) -> Virtual {
        let (op, zeros) = match op {
            Op::FMin => (MINPS, POR),
            _ => (MAXPS, PAND),
        };
        // The instruction gives its second operand if the two are equal or one of them is a NaN: as
        // it must with a number but zero there.
        let is_plain = |place: &IrOperand| {
            let number = place.constant.map(|bits| f32::from_bits(bits as u32));
            number.is_some_and(|number| {
                let gives_itself = op == MAXPS && number.to_bits() == 0;
                !number.is_nan() && (number != 0.0 || gives_itself)
            })
        };
        match (is_plain(x), is_plain(y)) {
            (_, true) => self.binary(op, a, b),
            (true, _) => self.binary(op, b, a),
            _ => self.least(op, zeros, a, b),
        }
    }

    /// Zero above a narrow integer's bits.
    fn narrow(&mut self, ty: Type, a: Virtual) -> Virtual {
        match ty.bits() {
            8 => self.and(a, 0xff),
            16 => self.and(a, 0xffff),
            _ => a,
        }
    }

    /// A narrow integer with its sign in the bits above.
    fn extend(&mut self, ty: Type, a: Virtual) -> Virtual {
        let above = 32 - ty.bits();
        match above {
            0 => a,
            _ => {
                let up = self.shift(PSHIFTD, LEFT, a, above);
                self.shift(PSHIFTD, RIGHT_SIGNED, up, above)
            }
        }
    }

    /// How many bits are set, or the number of the lowest or the highest one; all ones if there is
    /// none.
    fn count_bits(&mut self, op: &Op, ty: Type, a: Virtual) -> Option<Virtual> {
        let is_by_steps = self.encoding == Encoding::Vex;
        if !(self.has_counts || is_by_steps) || !matches!(ty, Type::I8 | Type::I16 | Type::I32) {
            return None;
        }
        let marked = match op {
            Op::BitCount if is_by_steps => return Some(self.set_bits(a)),
            Op::BitCount => return Some(self.unary(POPCNTD, a)),
            Op::FindLsb => {
                let zero = self.words(0);
                let negative = self.binary(PSUBD, zero, a);
                self.commutative(PAND, a, negative)
            }
            Op::FindSMsb => {
                // The highest bit that differs from the sign.
                let number = self.extend(ty, a);
                let sign = self.shift(PSHIFTD, RIGHT_SIGNED, number, 31);
                self.commutative(PXOR, number, sign)
            }
            _ => a,
        };
        if is_by_steps {
            return Some(self.highest_bit(marked));
        }
        let above = self.unary(LZCNTD, marked);
        let last = self.words(31);
        Some(self.binary(PSUBD, last, above))
    }

    /// How many bits are set: of each four by a table, whose words are summed up.
    fn set_bits(&mut self, a: Virtual) -> Virtual {
        const OF_FOUR: [u32; 4] = [0x0201_0100, 0x0302_0201, 0x0302_0201, 0x0403_0302];
        let table = std::array::from_fn(|lane| OF_FOUR[lane % 4]);
        let table = self.constant(Constant::Words(table));
        let low = self.and(a, 0x0f0f_0f0f);
        let high = self.shift(PSHIFTD, RIGHT, a, 4);
        let high = self.and(high, 0x0f0f_0f0f);
        let [low, high] = [low, high].map(|four| self.binary(PSHUFB, table, four));
        let of_bytes = self.commutative(PADDB, low, high);
        let ones = self.words(0x0101_0101);
        let of_pairs = self.binary(PMADDUBSW, of_bytes, ones);
        let ones = self.words(0x0001_0001);
        self.binary(PMADDWD, of_pairs, ones)
    }

    /// The number of the highest bit, by the exponent of a float; all ones if there is none.
    fn highest_bit(&mut self, a: Virtual) -> Virtual {
        // Without the bit below the highest one, so that rounding does not carry.
        let below = self.shift(PSHIFTD, RIGHT, a, 1);
        let number = self.binary(PANDN, below, a);
        let number = self.unary(CVTDQ2PS, number);
        let exponent = self.shift(PSHIFTD, RIGHT, number, 23);
        let bias = self.words(127);
        let bit = self.binary(PSUBD, exponent, bias);
        let none = self.words(u32::MAX);
        let bit = self.commutative(PMAXSD, bit, none);
        // Negative numbers have the last one.
        let last = self.words(31);
        self.select(a, last, bit)
    }

    fn unsigned_to_float(&mut self, a: Virtual) -> Virtual {
        if self.encoding == Encoding::Evex {
            return self.unary(CVTUDQ2PS, a);
        }
        // 2^23 + low half, 2^39 + high half: exact. Their difference from what was added is, too,
        // so that one sum rounds.
        let low = self.and(a, 0xffff);
        let (two_23, two_39) = (self.words(0x4b00_0000), self.words(0x5300_0000));
        let low = self.commutative(POR, low, two_23);
        let high = self.shift(PSHIFTD, RIGHT, a, 16);
        let high = self.commutative(POR, high, two_39);
        let both = self.words(0x5300_0080);
        let high = self.binary(SUBPS, high, both);
        self.commutative(ADDPS, high, low)
    }

    /// Truncates and saturates; NaN gives 0.
    fn float_to_signed(&mut self, a: Virtual) -> Virtual {
        // Least where it does not fit.
        let whole = self.unary(CVTTPS2DQ, a);
        let limit = self.words(0x4f00_0000);
        let above = self.compare(a, limit, float::GE);
        let greatest = self.words(i32::MAX as u32);
        let whole = self.select(above, greatest, whole);
        let is_nan = self.compare(a, a, float::UNORDERED);
        let zero = self.words(0);
        self.select(is_nan, zero, whole)
    }

    /// Truncates and saturates; NaN gives 0.
    fn float_to_unsigned(&mut self, a: Virtual) -> Virtual {
        let zero = self.words(0);
        let a = self.binary(MAXPS, a, zero);
        if self.encoding == Encoding::Evex {
            return self.unary(CVTTPS2UDQ, a);
        }
        // Half of the numbers are beyond a signed one: 2^31 is taken from those, and put back as
        // their highest bit.
        let low = self.unary(CVTTPS2DQ, a);
        let (half, all) = (self.words(0x4f00_0000), self.words(0x4f80_0000));
        let rest = self.binary(SUBPS, a, half);
        let rest = self.unary(CVTTPS2DQ, rest);
        let top = self.words(1 << 31);
        let high = self.commutative(PXOR, rest, top);
        let is_high = self.compare(a, half, float::GE);
        let number = self.select(is_high, high, low);
        let is_above = self.compare(a, all, float::GE);
        let ones = self.words(u32::MAX);
        self.select(is_above, ones, number)
    }

    /// The upper half of a vector's lanes, in the lower.
    pub(super) fn upper(&mut self, a: Virtual) -> Virtual {
        match self.encoding {
            Encoding::Evex => self.step_with(EXTRACT_HALF, Form::Reverse, &[a], 1),
            Encoding::Vex => self.step_with(EXTRACT_128, Form::Reverse, &[a], 1),
        }
    }

    /// Lanes of 32 bits as lanes of 64.
    pub(super) fn widen(&mut self, op: Opcode, a: Virtual) -> Held {
        let low = self.step(Class::Vector, op, Form::Registers, &[a]);
        let upper = self.upper(a);
        Held::Two(low, self.step(Class::Vector, op, Form::Registers, &[upper]))
    }

    /// The lower words of lanes of 64 bits.
    fn low_words(&mut self, a: Virtual, b: Virtual) -> Virtual {
        match self.encoding {
            Encoding::Evex => {
                let a = self.step(Class::Vector, PMOVQD, Form::Reverse, &[a]);
                let b = self.step(Class::Vector, PMOVQD, Form::Reverse, &[b]);
                self.step_with(INSERT_HALF, Form::Registers, &[a, b], 1)
            }
            Encoding::Vex => {
                // By quarters: the middle ones change places.
                let mixed = self.step_with(SHUFPS, Form::Registers, &[a, b], 0b10_00_10_00);
                self.step_with(PERMQ, Form::Registers, &[mixed], 0b11_01_10_00)
            }
        }
    }

    /// An operation on 16-bit floats, each in the lower half of a lane whose upper half is zero.
    ///
    /// By the processor's own instructions where it has them: they take the upper halves for zeros,
    /// and leave zeros there. Else in 32 bits: a sum, difference, product, quotient or root of
    /// 16-bit floats that is rounded to 24 bits and then to 11 is the one that is rounded once,
    /// because 24 ≥ 2·11 + 2 (Figueroa, "When is double rounding innocuous?", 1995). Sums with a
    /// product are rounded to odd first. Whole numbers and the lesser of two are exact.
    fn of_halves(&mut self, op: &Op, to: Type, from: &[Virtual]) -> Option<Virtual> {
        let own = match (op, from) {
            (Op::FAdd, &[a, b]) => Some((ADDPH, a, b)),
            (Op::FSub, &[a, b]) => Some((SUBPH, a, b)),
            (Op::FMul, &[a, b]) => Some((MULPH, a, b)),
            _ => None,
        };
        match (own, op, from) {
            (Some((op, a, b)), ..) if self.has_halves => return Some(self.binary(op, a, b)),
            (_, Op::FFma, &[_, _, _]) if self.has_halves => {
                return Some(self.step(Class::Vector, FMAPH, Form::MultiplyAdd, from));
            }
            (_, Op::FNeg, &[a]) => {
                let sign = self.words(0x8000);
                return Some(self.commutative(PXOR, a, sign));
            }
            (_, Op::FAbs, &[a]) => return Some(self.and(a, 0x7fff)),
            (_, Op::FInverseSqrt, _) => return None,
            _ => {}
        }
        let mut wide = SmallVec::<[Virtual; 3]>::new();
        for &half in from {
            let number = self.half_to_float(half);
            wide.push(number);
        }
        let number = match *wide {
            [a] => self.of_float(op, a)?,
            [a, b] => match op {
                Op::FMin => self.least(MINPS, POR, a, b),
                Op::FMax => self.least(MAXPS, PAND, a, b),
                _ => self.of_floats(op, a, b)?,
            },
            [a, b, c] => self.odd_fma([a, b, c])?,
            _ => return None,
        };
        Some(match to {
            Type::F16 => self.float_to_half(number),
            _ => number,
        })
    }

    /// An operation on a 32-bit float that gives one, or a condition.
    fn of_float(&mut self, op: &Op, a: Virtual) -> Option<Virtual> {
        Some(match op {
            Op::FNeg => {
                let sign = self.words(1 << 31);
                self.commutative(PXOR, a, sign)
            }
            Op::FAbs => self.and(a, !(1 << 31)),
            Op::FSqrt => self.unary(SQRTPS, a),
            Op::FInverseSqrt => {
                let root = self.unary(SQRTPS, a);
                let one = self.words(1f32.to_bits());
                self.binary(DIVPS, one, root)
            }
            Op::FRoundEven => self.round(a, 0),
            Op::FFloor => self.round(a, 1),
            Op::FCeil => self.round(a, 2),
            Op::FTrunc => self.round(a, 3),
            Op::FFract => {
                let floor = self.round(a, 1);
                self.binary(SUBPS, a, floor)
            }
            Op::FFlushDenormal => self.flush_denormal(a),
            Op::FIsNan => self.compare(a, a, float::UNORDERED),
            Op::FIsInf => {
                let size = self.and(a, !(1 << 31));
                let infinity = self.words(f32::INFINITY.to_bits());
                self.compare(size, infinity, float::EQ)
            }
            _ => return None,
        })
    }

    /// The sign alone where the exponent's bits are zeros.
    fn flush_denormal(&mut self, a: Virtual) -> Virtual {
        let exponent = self.words(f32::INFINITY.to_bits());
        if self.encoding == Encoding::Evex {
            let is_normal = self.step(Class::Mask, PTESTMD, Form::Binary, &[a, exponent]);
            let sign = self.and(a, 1 << 31);
            return self.select(is_normal, a, sign);
        }
        let exponent = self.commutative(PAND, a, exponent);
        let zero = self.words(0);
        let is_denormal = self.commutative(PCMPEQD, exponent, zero);
        let magnitude = self.shift(PSHIFTD, RIGHT, is_denormal, 1);
        self.binary(PANDN, magnitude, a)
    }

    /// An operation on two 32-bit floats that gives one, or a condition.
    fn of_floats(&mut self, op: &Op, a: Virtual, b: Virtual) -> Option<Virtual> {
        Some(match op {
            Op::FAdd => self.binary(ADDPS, a, b),
            Op::FSub => self.binary(SUBPS, a, b),
            Op::FMul => self.binary(MULPS, a, b),
            Op::FDiv => self.binary(DIVPS, a, b),
            Op::FOEq => self.compare(a, b, float::EQ),
            Op::FONe => self.compare(a, b, float::NE),
            Op::FOLt => self.compare(a, b, float::LT),
            Op::FOLe => self.compare(a, b, float::LE),
            Op::FUEq => self.compare(a, b, float::EQ_OR_UNORDERED),
            Op::FUNe => self.compare(a, b, float::NE_OR_UNORDERED),
            Op::FULt => self.compare(a, b, float::LT_OR_UNORDERED),
            Op::FULe => self.compare(a, b, float::LE_OR_UNORDERED),
            _ => return None,
        })
    }

    pub(super) fn lower(
        &mut self,
        op: &Op,
        operands: &[IrOperand],
        results: &[IrOperand],
    ) -> Option<()> {
        if *op == Op::Unpack64 {
            let Held::Two(a, b) = self.operand(&operands[0]) else {
                return None;
            };
            let low = self.low_words(a, b);
            let [a, b] = [a, b].map(|part| self.shift(PSHIFTQ, RIGHT, part, 32));
            let high = self.low_words(a, b);
            self.give(&results[0], Held::One(low));
            self.give(&results[1], Held::One(high));
            return Some(());
        }
        let [result] = results else {
            return None;
        };
        let held: Vec<Held> = operands.iter().map(|place| self.operand(place)).collect();
        let held = self.lower_one(op, operands, result.ty, &held)?;
        self.give(result, held);
        Some(())
    }

    /// Notes where a result is. It is made in the last steps, so that no row of an operand is lost
    /// before.
    pub(super) fn give(&mut self, place: &IrOperand, held: Held) {
        for (k, part) in held.parts().enumerate() {
            self.infos[part as usize].home = self.home(place, k as i32);
        }
        self.hold(place.value, held);
        self.results.push((place.value, held));
    }

    fn lower_one(
        &mut self,
        op: &Op,
        places: &[IrOperand],
        to: Type,
        held: &[Held],
    ) -> Option<Held> {
        let from = places.last()?.ty;
        match (op, held) {
            (Op::Select, &[Held::One(condition), Held::One(a), Held::One(b)]) => {
                Some(Held::One(match self.class_of(to) {
                    Class::Mask => self.select_condition(condition, a, b),
                    Class::Vector => self.select(condition, a, b),
                }))
            }
            (Op::Pack64, &[Held::One(low), Held::One(high)]) => {
                let (Held::Two(a, b), Held::Two(x, y)) =
                    (self.widen(PMOVZXDQ, low), self.widen(PMOVZXDQ, high))
                else {
                    return None;
                };
                let [x, y] = [x, y].map(|part| self.shift(PSHIFTQ, LEFT, part, 32));
                Some(Held::Two(
                    self.commutative(POR, a, x),
                    self.commutative(POR, b, y),
                ))
            }
            (_, &[Held::One(a)]) => self.lower_unary(op, from, to, a),
            (_, &[Held::One(a), Held::One(b)]) => {
                self.lower_binary(op, from, to, [&places[0], &places[1]], a, b)
            }
            (Op::Select, &[Held::One(condition), Held::Two(a, b), Held::Two(x, y)]) => {
                let [low, high] = self.wide_lanes(condition);
                Some(Held::Two(
                    self.select_wide(low, a, x),
                    self.select_wide(high, b, y),
                ))
            }
            (Op::FFma, &[Held::Two(a, x), Held::Two(b, y), Held::Two(c, z)]) => {
                let [low, high] = [[a, b, c], [x, y, z]]
                    .map(|from| self.step(Class::Vector, FMAPD, Form::MultiplyAdd, &from));
                Some(Held::Two(low, high))
            }
            (Op::FFma, &[Held::One(a), Held::One(b), Held::One(c)]) if to == Type::F32 => {
                let from = [a, b, c];
                Some(Held::One(self.step(
                    Class::Vector,
                    FMAPS,
                    Form::MultiplyAdd,
                    &from,
                )))
            }
            (Op::FFma, &[Held::One(a), Held::One(b), Held::One(c)]) if to == Type::F16 => {
                Some(Held::One(self.of_halves(op, to, &[a, b, c])?))
            }
            (_, &[Held::Two(a, b)]) => self.lower_wide_unary(op, to, a, b),
            (_, &[Held::Two(..), Held::Two(..)]) => self.lower_wide(op, from, to, places, held),
            _ => None,
        }
    }

    fn lower_unary(&mut self, op: &Op, from: Type, to: Type, a: Virtual) -> Option<Held> {
        let before = self.steps.len();
        let one = match (op, from, to) {
            (Op::Not, Type::I1, _) if self.encoding == Encoding::Evex => self.masks(KNOT, &[a]),
            (Op::Not, Type::I1 | Type::I32, _) => self.not(a),
            (Op::INeg, Type::I32, _) => {
                let zero = self.words(0);
                self.binary(PSUBD, zero, a)
            }
            (Op::IAbs, Type::I32, _) => self.unary(PABSD, a),
            (Op::BitCount | Op::FindLsb | Op::FindUMsb | Op::FindSMsb, _, _) => {
                let number = self.count_bits(op, from, a)?;
                self.narrow(to, number)
            }
            (Op::SToF, Type::I8 | Type::I16 | Type::I32, Type::F32) => {
                let a = self.extend(from, a);
                self.unary(CVTDQ2PS, a)
            }
            (Op::UToF, Type::I8 | Type::I16, Type::F32) => self.unary(CVTDQ2PS, a),
            (Op::UToF, Type::I32, Type::F32) => self.unsigned_to_float(a),
            (Op::SToF, Type::I8 | Type::I16, Type::F16) => {
                let a = self.extend(from, a);
                let number = self.unary(CVTDQ2PS, a);
                self.float_to_half(number)
            }
            (Op::UToF, Type::I8 | Type::I16, Type::F16) => {
                let number = self.unary(CVTDQ2PS, a);
                self.float_to_half(number)
            }
            (Op::FToS, Type::F32, Type::I32) => self.float_to_signed(a),
            (Op::FToU, Type::F32, Type::I32) => self.float_to_unsigned(a),
            (Op::FToS, Type::F16, Type::I32) => {
                let number = self.half_to_float(a);
                self.float_to_signed(number)
            }
            (Op::FToU, Type::F16, Type::I32) => {
                let number = self.half_to_float(a);
                self.float_to_unsigned(number)
            }
            (Op::FConvert, Type::F16, Type::F32) => self.half_to_float(a),
            (Op::FConvert, Type::F32, Type::F16) => self.float_to_half(a),
            (Op::UConvert, Type::I32, Type::I64) => return Some(self.widen(PMOVZXDQ, a)),
            (Op::SConvert, Type::I32, Type::I64) => return Some(self.widen(PMOVSXDQ, a)),
            (Op::UConvert | Op::SConvert, _, _) if to.bits() > 32 => return None,
            (Op::UConvert, _, _) => match to.bits() < from.bits() {
                true => self.narrow(to, a),
                false => self.copy(a),
            },
            (Op::SConvert, _, _) => {
                let a = self.extend(from, a);
                match to.bits() {
                    32 => a,
                    _ => self.narrow(to, a),
                }
            }
            (Op::Bitcast, _, _) => self.copy(a),
            (_, Type::F32, Type::F32 | Type::I1) => self.of_float(op, a)?,
            (_, Type::F16, Type::F16 | Type::I1) => self.of_halves(op, to, &[a])?,
            _ => return None,
        };
        // A conversion between equal types is a copy.
        let is_same = self.steps.len() == before;
        Some(Held::One(if is_same { self.copy(one) } else { one }))
    }

    /// In a register of its own: its row differs.
    pub(super) fn copy(&mut self, a: Virtual) -> Virtual {
        self.unary(MOVE, a)
    }

    pub(super) fn lower_binary(
        &mut self,
        op: &Op,
        from: Type,
        to: Type,
        places: [&IrOperand; 2],
        a: Virtual,
        b: Virtual,
    ) -> Option<Held> {
        let is_word = from == Type::I32;
        let is_float = from == Type::F32;
        let is_narrow = matches!(from, Type::I8 | Type::I16);
        let count = places[1]
            .constant
            .map(|count| count as u32 & (from.bits().max(1) - 1));
        let one = match op {
            _ if from == Type::I1 => self.logic(op, a, b)?,
            Op::FMin | Op::FMax if is_float => self.extreme(op, places, a, b),
            _ if is_float => self.of_floats(op, a, b)?,
            _ if from == Type::F16 => self.of_halves(op, to, &[a, b])?,
            Op::And if is_word || is_narrow => self.commutative(PAND, a, b),
            Op::Or if is_word || is_narrow => self.commutative(POR, a, b),
            Op::Xor if is_word || is_narrow => self.commutative(PXOR, a, b),
            Op::IEq if is_word || is_narrow => self.compare_words(a, b, int::EQ, true),
            Op::INe if is_word || is_narrow => self.compare_words(a, b, int::NE, true),
            Op::IAdd | Op::ISub | Op::IMul if is_word || is_narrow => {
                let number = match op {
                    Op::IAdd => self.commutative(PADDD, a, b),
                    Op::ISub => self.binary(PSUBD, a, b),
                    _ => self.product(places, a, b),
                };
                self.narrow(to, number)
            }
            Op::Shl if is_narrow || is_word && count.is_some() => {
                let shifted = self.shift(PSHIFTD, LEFT, a, count?);
                self.narrow(to, shifted)
            }
            Op::LShr if is_narrow => self.shift(PSHIFTD, RIGHT, a, count?),
            _ if !is_word => return None,
            Op::LShr if count.is_some() => self.shift(PSHIFTD, RIGHT, a, count?),
            Op::AShr if count.is_some() => self.shift(PSHIFTD, RIGHT_SIGNED, a, count?),
            Op::Shl | Op::LShr | Op::AShr => {
                let op = match op {
                    Op::Shl => PSLLVD,
                    Op::LShr => PSRLVD,
                    _ => PSRAVD,
                };
                let count = self.and(b, 31);
                self.binary(op, a, count)
            }
            Op::SMin => self.commutative(PMINSD, a, b),
            Op::SMax => self.commutative(PMAXSD, a, b),
            Op::UMin => self.commutative(PMINUD, a, b),
            Op::UMax => self.commutative(PMAXUD, a, b),
            Op::ULt => self.compare_words(a, b, int::LT, false),
            Op::ULe => self.compare_words(a, b, int::LE, false),
            Op::SLt => self.compare_words(a, b, int::LT, true),
            Op::SLe => self.compare_words(a, b, int::LE, true),
            _ => return None,
        };
        Some(Held::One(one))
    }

    /// A product of integers: see [`near_power`].
    fn product(&mut self, places: [&IrOperand; 2], a: Virtual, b: Virtual) -> Virtual {
        let Some((factor, near)) = near_power(places.map(|place| place.constant), 32) else {
            return self.commutative(PMULLD, a, b);
        };
        let other = if factor == 0 { b } else { a };
        let multiple = self.shift(PSHIFTD, LEFT, other, near.shift);
        match near.is_above {
            true => self.commutative(PADDD, multiple, other),
            false => self.binary(PSUBD, multiple, other),
        }
    }

    /// The same of lanes of 64 bits.
    fn wide_product(&mut self, constants: [Option<u64>; 2], a: Virtual, b: Virtual) -> Virtual {
        let Some((factor, near)) = near_power(constants, 64) else {
            return match self.encoding {
                Encoding::Vex => self.product_by_words(a, b),
                Encoding::Evex => self.commutative(PMULLQ, a, b),
            };
        };
        let other = if factor == 0 { b } else { a };
        let multiple = self.shift(PSHIFTQ, LEFT, other, near.shift);
        match near.is_above {
            true => self.commutative(PADDQ, multiple, other),
            false => self.binary(PSUBQ, multiple, other),
        }
    }

    fn lower_wide_unary(&mut self, op: &Op, to: Type, a: Virtual, b: Virtual) -> Option<Held> {
        match (op, to) {
            (Op::UConvert | Op::SConvert, Type::I32) => Some(Held::One(self.low_words(a, b))),
            (Op::Bitcast, _) => Some(Held::Two(self.copy(a), self.copy(b))),
            (Op::INeg, Type::I64) => {
                let zero = self.words(0);
                let [a, b] = [a, b].map(|part| self.binary(PSUBQ, zero, part));
                Some(Held::Two(a, b))
            }
            (Op::Not, Type::I64) => Some(Held::Two(self.not(a), self.not(b))),
            (Op::FSqrt, Type::F64) => Some(Held::Two(self.unary(SQRTPD, a), self.unary(SQRTPD, b))),
            _ => None,
        }
    }

    fn lower_wide(
        &mut self,
        op: &Op,
        from: Type,
        to: Type,
        places: &[IrOperand],
        held: &[Held],
    ) -> Option<Held> {
        let &[Held::Two(a0, a1), Held::Two(b0, b1)] = held else {
            return None;
        };
        if from != to {
            return None;
        }
        if let Op::Shl | Op::LShr = op {
            if to != Type::I64 {
                return None;
            }
            let count = places[1].constant? as u32 & 63;
            let number = if *op == Op::Shl { LEFT } else { RIGHT };
            let [a0, a1] = [a0, a1].map(|part| self.shift(PSHIFTQ, number, part, count));
            return Some(Held::Two(a0, a1));
        }
        if (op, to) == (&Op::IMul, Type::I64) {
            let constants = [0, 1].map(|k| places[k].constant);
            let low = self.wide_product(constants, a0, b0);
            return Some(Held::Two(low, self.wide_product(constants, a1, b1)));
        }
        let (op, form) = self.wide_opcode(op, to)?;
        let low = self.step(Class::Vector, op, form, &[a0, b0]);
        Some(Held::Two(
            low,
            self.step(Class::Vector, op, form, &[a1, b1]),
        ))
    }

    /// The upper words of lanes of 64 bits, where products take the lower ones. A factor is often
    /// that of the product before.
    fn upper_words(&mut self, a: Virtual) -> Virtual {
        let known = self.near_step((PSHIFTQ, Form::Extended(RIGHT), Some(32)), &[a]);
        known.unwrap_or_else(|| self.shift(PSHIFTQ, RIGHT, a, 32))
    }

    /// The result of such a step shortly before, if no body that may be jumped over ends behind
    /// it.
    pub(super) fn near_step(
        &self,
        what: (Opcode, Form, Option<u8>),
        from: &[Virtual],
    ) -> Option<Virtual> {
        /// Steps of two registers' products: further ones would keep too many registers.
        const NEAR: usize = 24;
        let side = (self.half, self.subgroup as u8);
        let known = (self.steps.iter().rev().take(NEAR))
            .take_while(|step| !matches!(step.form, Form::EndSkip(_)))
            .find(|step| {
                (step.op, step.form, step.immediate) == what
                    && (step.half, step.subgroup) == side
                    && step.from[..step.count] == *from
                    && self.infos[step.to as usize].home.is_none()
            });
        known.map(|step| step.to)
    }

    /// A product of integers of 64 bits, from products of their words.
    fn product_by_words(&mut self, a: Virtual, b: Virtual) -> Virtual {
        let [upper_a, upper_b] = [a, b].map(|part| self.upper_words(part));
        let left = self.commutative(PMULUDQ, upper_a, b);
        let right = self.commutative(PMULUDQ, upper_b, a);
        let upper = self.commutative(PADDQ, left, right);
        let upper = self.shift(PSHIFTQ, LEFT, upper, 32);
        let lower = self.commutative(PMULUDQ, a, b);
        self.commutative(PADDQ, lower, upper)
    }

    /// The instruction that performs an operation on lanes of 64 bits.
    pub(super) fn wide_opcode(&self, op: &Op, ty: Type) -> Option<(Opcode, Form)> {
        Some(match op {
            Op::FAdd => (ADDPD, Form::Binary),
            Op::FSub => (SUBPD, Form::Binary),
            Op::FMul => (MULPD, Form::Binary),
            Op::FDiv => (DIVPD, Form::Binary),
            _ if ty != Type::I64 => return None,
            Op::IAdd => (PADDQ, Form::Commutative),
            Op::ISub => (PSUBQ, Form::Binary),
            Op::And => (PAND, Form::Commutative),
            Op::Or => (POR, Form::Commutative),
            Op::Xor => (PXOR, Form::Commutative),
            Op::IMul if self.encoding == Encoding::Evex => (PMULLQ, Form::Commutative),
            _ => return None,
        })
    }
}
