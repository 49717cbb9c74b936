//! Bounded integer sequences and what their values stand for (Khronos Data Format specification,
//! "Integer Sequence Encoding", "Endpoint Unquantization", "Weight Unquantization").
#![forbid(unsafe_code)]

/// How the values of a sequence are stored: so many bits each, and a trit or quint that several
/// share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Range {
    pub digit: Digit,
    pub bits: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Digit {
    None,
    Trit,
    Quint,
}

const fn plain(bits: u32) -> Range {
    Range {
        digit: Digit::None,
        bits,
    }
}

const fn trits(bits: u32) -> Range {
    Range {
        digit: Digit::Trit,
        bits,
    }
}

const fn quints(bits: u32) -> Range {
    Range {
        digit: Digit::Quint,
        bits,
    }
}

/// The ranges of weights, by precision and by the block mode's R less 2.
#[rustfmt::skip]
pub(super) const WEIGHT_RANGES: [[Range; 6]; 2] = [
    [plain(1), trits(0), plain(2), quints(0), trits(1), plain(3)],
    [quints(1), trits(2), plain(4), quints(2), trits(3), plain(5)],
];

/// The ranges of endpoints, widest first.
#[rustfmt::skip]
pub(super) const ENDPOINT_RANGES: [Range; 17] = [
    plain(8), trits(6), quints(5), plain(7), trits(5), quints(4), plain(6), trits(4), quints(3), plain(5), trits(3), quints(2),
    plain(4), trits(2), quints(1), plain(3), trits(1),
];

impl Range {
    /// Bits of a sequence of `count` values.
    pub fn sequence_bits(self, count: u32) -> u32 {
        count * self.bits
            + match self.digit {
                Digit::None => 0,
                Digit::Trit => (8 * count).div_ceil(5),
                Digit::Quint => (7 * count).div_ceil(3),
            }
    }

    /// The values of a sequence in the low bits of `data`, as their bits and their digit.
    pub fn read(self, data: u128, values: &mut [(u32, u32)]) {
        let size = self.sequence_bits(values.len() as u32);
        // Bits that are not stored are zero.
        let mut rest = data & (1u128 << size.min(127)).wrapping_sub(1);
        let mut take = |bits: u32| {
            let taken = rest as u32 & ((1 << bits) - 1);
            rest >>= bits;
            taken
        };
        match self.digit {
            Digit::None => values.fill_with(|| (take(self.bits), 0)),
            Digit::Trit => {
                for group in values.chunks_mut(5) {
                    let (mut packed, mut at) = (0, 0);
                    let mut bits = [0; 5];
                    for (bits, width) in bits.iter_mut().zip([2, 2, 1, 2, 1]) {
                        *bits = take(self.bits);
                        packed |= take(width) << at;
                        at += width;
                    }
                    for ((value, bits), trit) in group.iter_mut().zip(bits).zip(five_trits(packed))
                    {
                        *value = (bits, trit);
                    }
                }
            }
            Digit::Quint => {
                for group in values.chunks_mut(3) {
                    let (mut packed, mut at) = (0, 0);
                    let mut bits = [0; 3];
                    for (bits, width) in bits.iter_mut().zip([3, 2, 2]) {
                        *bits = take(self.bits);
                        packed |= take(width) << at;
                        at += width;
                    }
                    for ((value, bits), quint) in
                        group.iter_mut().zip(bits).zip(three_quints(packed))
                    {
                        *value = (bits, quint);
                    }
                }
            }
        }
    }

    /// An endpoint's component of 8 bits.
    pub fn endpoint(self, (bits, digit): (u32, u32)) -> i32 {
        let bit = |index: u32| bits >> index & 1;
        let (b, c, d, e, f) = (bit(1), bit(2), bit(3), bit(4), bit(5));
        let (multiplier, spread) = match (self.digit, self.bits) {
            (Digit::None, width) => return replicated(bits, width, 8) as i32,
            (Digit::Trit, 1) => (204, 0),
            (Digit::Trit, 2) => (93, b << 8 | b << 4 | b << 2 | b << 1),
            (Digit::Trit, 3) => (44, c << 8 | b << 7 | c << 3 | b << 2 | c << 1 | b),
            (Digit::Trit, 4) => (22, d << 8 | c << 7 | b << 6 | d << 2 | c << 1 | b),
            (Digit::Trit, 5) => (11, e << 8 | d << 7 | c << 6 | b << 5 | e << 1 | d),
            (Digit::Trit, _) => (5, f << 8 | e << 7 | d << 6 | c << 5 | b << 4 | f),
            (Digit::Quint, 1) => (113, 0),
            (Digit::Quint, 2) => (54, b << 8 | b << 3 | b << 2),
            (Digit::Quint, 3) => (26, c << 8 | b << 7 | c << 2 | b << 1 | c),
            (Digit::Quint, 4) => (13, d << 8 | c << 7 | b << 6 | d << 1 | c),
            (Digit::Quint, _) => (6, e << 8 | d << 7 | c << 6 | b << 5 | e),
        };
        let flip = if bit(0) == 1 { 0x1ff } else { 0 };
        let value = (digit * multiplier + spread) ^ flip;
        (flip & 0x80 | value >> 2) as i32
    }

    /// A weight of 0 to 64.
    pub fn weight(self, (bits, digit): (u32, u32)) -> u32 {
        let bit = |index: u32| bits >> index & 1;
        let (b, c) = (bit(1), bit(2));
        let (multiplier, spread) = match (self.digit, self.bits) {
            (Digit::None, width) => return widened(replicated(bits, width, 6)),
            (Digit::Trit, 0) => return widened([0, 32, 63][digit as usize]),
            (Digit::Quint, 0) => return widened([0, 16, 32, 47, 63][digit as usize]),
            (Digit::Trit, 1) => (50, 0),
            (Digit::Trit, 2) => (23, b << 6 | b << 2 | b),
            (Digit::Trit, _) => (11, c << 6 | b << 5 | c << 1 | b),
            (Digit::Quint, 1) => (28, 0),
            (Digit::Quint, _) => (13, b << 6 | b << 1),
        };
        let flip = if bit(0) == 1 { 0x7f } else { 0 };
        let value = (digit * multiplier + spread) ^ flip;
        widened(flip & 0x20 | value >> 2)
    }
}

/// 0 to 63 as 0 to 64.
fn widened(weight: u32) -> u32 {
    weight + (weight > 32) as u32
}

/// A number of `from` bits, repeated until it fills `to`.
fn replicated(value: u32, from: u32, to: u32) -> u32 {
    let (mut filled, mut width) = (value, from);
    while width < to {
        filled = filled << from | value;
        width += from;
    }
    filled >> (width - to)
}

/// The trits of 8 bits.
fn five_trits(packed: u32) -> [u32; 5] {
    let bit = |index: u32| packed >> index & 1;
    let field = |high: u32, low: u32| packed >> low & ((2 << (high - low)) - 1);
    let (c, t3, t4);
    if field(4, 2) == 7 {
        c = field(7, 5) << 2 | field(1, 0);
        (t3, t4) = (2, 2);
    } else {
        c = field(4, 0);
        (t3, t4) = match field(6, 5) {
            3 => (bit(7), 2),
            low => (low, bit(7)),
        };
    }
    let (c0, c1, c2, c3, c4) = (c & 1, c >> 1 & 1, c >> 2 & 1, c >> 3 & 1, c >> 4);
    let [t0, t1, t2] = if c & 3 == 3 {
        [c3 << 1 | (c2 & !c3), c4, 2]
    } else if c >> 2 & 3 == 3 {
        [c & 3, 2, 2]
    } else {
        [c1 << 1 | (c0 & !c1), c >> 2 & 3, c4]
    };
    [t0, t1, t2, t3, t4]
}

/// The quints of 7 bits.
fn three_quints(packed: u32) -> [u32; 3] {
    let bit = |index: u32| packed >> index & 1;
    let field = |high: u32, low: u32| packed >> low & ((2 << (high - low)) - 1);
    if field(2, 1) == 3 && field(6, 5) == 0 {
        let q0 = bit(0);
        return [4, 4, q0 << 2 | (bit(4) & !q0) << 1 | (bit(3) & !q0)];
    }
    let (c, q2) = match field(2, 1) {
        3 => (field(4, 3) << 3 | (!field(6, 5) & 3) << 1 | bit(0), 4),
        _ => (field(4, 0), field(6, 5)),
    };
    match c & 7 {
        5 => [c >> 3, 4, q2],
        low => [low, c >> 3, q2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each digit sequence has an encoding.
    #[test]
    fn packed_digits_reach_every_combination() {
        let trits: std::collections::HashSet<_> = (0..256).map(five_trits).collect();
        assert_eq!(trits.len(), 243);
        assert!(trits.iter().flatten().all(|&trit| trit < 3));
        let quints: std::collections::HashSet<_> = (0..128).map(three_quints).collect();
        assert_eq!(quints.len(), 125);
        assert!(quints.iter().flatten().all(|&quint| quint < 5));
    }

    /// The values of a range are distinct, and cover their whole interval.
    #[test]
    fn values_spread_evenly() {
        let digits = |range: Range| match range.digit {
            Digit::None => 1,
            Digit::Trit => 3,
            Digit::Quint => 5,
        };
        let spread = |range: Range, of: &dyn Fn((u32, u32)) -> u32, most: u32| {
            let pairs = (0..1 << range.bits).flat_map(|b| (0..digits(range)).map(move |d| (b, d)));
            let mut values: Vec<u32> = pairs.map(of).collect();
            values.sort();
            let steps = values.len() as f64 - 1.0;
            for (i, value) in values.iter().enumerate() {
                let ideal = i as f64 * f64::from(most) / steps;
                assert!(
                    (f64::from(*value) - ideal).abs() <= 1.5,
                    "{range:?} {i} {value}"
                );
            }
            values.dedup();
            assert_eq!(values.len() as f64, steps + 1.0, "{range:?}");
        };
        for range in ENDPOINT_RANGES {
            spread(range, &|value| range.endpoint(value) as u32, 255);
        }
        for range in WEIGHT_RANGES.into_iter().flatten() {
            spread(range, &|value| range.weight(value), 64);
        }
    }

    #[test]
    fn sequences_take_the_bits_of_the_table() {
        assert_eq!(trits(3).sequence_bits(5), 23);
        assert_eq!(trits(1).sequence_bits(1), 3);
        assert_eq!(quints(2).sequence_bits(3), 13);
        assert_eq!(quints(0).sequence_bits(2), 5);
        assert_eq!(plain(4).sequence_bits(7), 28);
    }
}
