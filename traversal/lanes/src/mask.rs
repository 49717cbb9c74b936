//! Sets of lanes.

use std::ops::{BitAnd, BitAndAssign, BitOr, BitOrAssign, Not, Sub, SubAssign};

/// Which of sixteen lanes: one bit a lane, lane 0 the lowest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct LaneMask(u16);

impl LaneMask {
    /// Lanes that there are.
    pub const LANES: usize = u16::BITS as usize;
    pub const NONE: LaneMask = LaneMask(0);
    pub const ALL: LaneMask = LaneMask(u16::MAX);

    #[inline]
    pub const fn from_bits(bits: u16) -> LaneMask {
        LaneMask(bits)
    }

    /// The lanes for which `is_in` holds, which is asked once for each.
    #[inline]
    pub fn from_fn(mut is_in: impl FnMut(usize) -> bool) -> LaneMask {
        let mut bits = 0;
        for lane in 0..LaneMask::LANES {
            bits |= u16::from(is_in(lane)) << lane;
        }
        LaneMask(bits)
    }

    /// The lanes of a row that hold a word.
    #[inline]
    pub fn holding(row: &[u32; LaneMask::LANES], word: u32) -> LaneMask {
        LaneMask(alike(row, word, u32::MAX))
    }

    /// The lanes of a row that have any of some bits.
    #[inline]
    pub fn with_any(row: &[u32; LaneMask::LANES], bits: u32) -> LaneMask {
        LaneMask(!alike(row, 0, bits))
    }

    /// One lane.
    #[inline]
    pub const fn of(lane: usize) -> LaneMask {
        LaneMask(1 << lane)
    }

    /// The first lanes, sixteen at most.
    #[inline]
    pub const fn full(count: usize) -> LaneMask {
        LaneMask(((1u32 << count) - 1) as u16)
    }

    #[inline]
    pub const fn bits(self) -> u16 {
        self.0
    }

    #[inline]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    #[inline]
    pub const fn count(self) -> u32 {
        self.0.count_ones()
    }

    #[inline]
    pub const fn contains(self, lane: usize) -> bool {
        self.0 >> lane & 1 != 0
    }

    /// The lowest lane, or lane 0 where there is none: always one that rows have.
    #[inline]
    pub const fn first(self) -> usize {
        self.0.trailing_zeros() as usize % LaneMask::LANES
    }

    #[inline]
    pub const fn insert(&mut self, lane: usize) {
        self.0 |= 1 << lane;
    }

    #[inline]
    pub const fn remove(&mut self, lane: usize) {
        self.0 &= !(1 << lane);
    }

    #[inline]
    pub const fn set(&mut self, lane: usize, is_in: bool) {
        self.0 = self.0 & !(1 << lane) | (is_in as u16) << lane;
    }

    /// The lanes, lowest first.
    #[inline]
    pub const fn iter(self) -> Iter {
        Iter(self.0)
    }
}

/// A bit for each word of a row that is the same as another in some bits.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
#[allow(unsafe_code)]
fn alike(row: &[u32; LaneMask::LANES], other: u32, bits: u32) -> u16 {
    use std::arch::x86_64::*;
    // SAFETY: these processors have SSE2, and four words are read at a time.
    unsafe {
        let (other, bits) = (_mm_set1_epi32(other as i32), _mm_set1_epi32(bits as i32));
        let quarter = |i: usize| {
            let words = _mm_loadu_si128(row[4 * i..][..4].as_ptr().cast());
            let differences = _mm_and_si128(_mm_xor_si128(words, other), bits);
            _mm_cmpeq_epi32(differences, _mm_setzero_si128())
        };
        let low = _mm_packs_epi32(quarter(0), quarter(1));
        let high = _mm_packs_epi32(quarter(2), quarter(3));
        _mm_movemask_epi8(_mm_packs_epi16(low, high)) as u16
    }
}

#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn alike(row: &[u32; LaneMask::LANES], other: u32, bits: u32) -> u16 {
    LaneMask::from_fn(|lane| (row[lane] ^ other) & bits == 0).0
}

/// The lanes of a mask, lowest first.
#[derive(Clone)]
pub struct Iter(u16);

impl Iterator for Iter {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        let lane = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lane < LaneMask::LANES).then_some(lane)
    }
}

impl IntoIterator for LaneMask {
    type Item = usize;
    type IntoIter = Iter;

    #[inline]
    fn into_iter(self) -> Iter {
        self.iter()
    }
}

impl FromIterator<usize> for LaneMask {
    #[inline]
    fn from_iter<I: IntoIterator<Item = usize>>(lanes: I) -> LaneMask {
        LaneMask(lanes.into_iter().fold(0, |bits, lane| bits | 1 << lane))
    }
}

impl Not for LaneMask {
    type Output = LaneMask;

    #[inline]
    fn not(self) -> LaneMask {
        LaneMask(!self.0)
    }
}

/// Operations on two masks, and the same in place.
macro_rules! binary {
    ($($trait:ident $method:ident, $assign:ident $in_place:ident: |$a:ident, $b:ident| $bits:expr;)*) => {$(
        impl $trait for LaneMask {
            type Output = LaneMask;

            #[inline]
            fn $method(self, other: LaneMask) -> LaneMask {
                let ($a, $b) = (self.0, other.0);
                LaneMask($bits)
            }
        }

        impl $assign for LaneMask {
            #[inline]
            fn $in_place(&mut self, other: LaneMask) {
                *self = self.$method(other);
            }
        }
    )*};
}

binary! {
    BitAnd bitand, BitAndAssign bitand_assign: |a, b| a & b;
    BitOr bitor, BitOrAssign bitor_assign: |a, b| a | b;
    // Those of the first that are not in the second.
    Sub sub, SubAssign sub_assign: |a, b| a & !b;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against rows of sixteen booleans.
    #[test]
    fn masks_are_sets_of_lanes() {
        let rows = |bits: u16| -> [bool; 16] { std::array::from_fn(|lane| bits & 1 << lane != 0) };
        for bits in 0..=u16::MAX {
            let (mask, row) = (LaneMask::from_bits(bits), rows(bits));
            let lanes: Vec<usize> = (0..16).filter(|&lane| row[lane]).collect();
            assert_eq!(mask.iter().collect::<Vec<_>>(), lanes);
            assert_eq!(mask.count() as usize, lanes.len());
            assert_eq!(mask.first(), lanes.first().copied().unwrap_or(0));
            assert_eq!(mask.is_empty(), lanes.is_empty());
            assert_eq!(LaneMask::from_fn(|lane| row[lane]), mask);
            assert_eq!(lanes.into_iter().collect::<LaneMask>(), mask);
            let other = bits.wrapping_mul(0x9E37).rotate_left(5);
            let (others, other) = (rows(other), LaneMask::from_bits(other));
            for lane in 0..16 {
                let (a, b) = (row[lane], others[lane]);
                assert_eq!(mask.contains(lane), a);
                assert_eq!((!mask).contains(lane), !a);
                assert_eq!((mask & other).contains(lane), a && b);
                assert_eq!((mask | other).contains(lane), a || b);
                assert_eq!((mask - other).contains(lane), a && !b);
                let (mut with, mut without) = (mask, mask);
                with.insert(lane);
                without.remove(lane);
                assert_eq!(with, mask | LaneMask::of(lane));
                assert_eq!(without, mask - LaneMask::of(lane));
                with.set(lane, a);
                without.set(lane, a);
                assert_eq!([with, without], [mask; 2]);
            }
        }
        for count in 0..=16 {
            assert_eq!(LaneMask::full(count), (0..count).collect());
        }
    }

    /// Against one lane after the other.
    #[test]
    fn rows_are_compared_with_a_word() {
        let row = std::array::from_fn(|lane| [0, 1, 2, u32::MAX, 1 << 31][lane * 7 % 5]);
        for word in [0, 1, 2, 3, u32::MAX, 1 << 31, 0x8000_0001] {
            let holding = LaneMask::from_fn(|lane| row[lane] == word);
            assert_eq!(LaneMask::holding(&row, word), holding, "{word:#x}");
            let with_any = LaneMask::from_fn(|lane| row[lane] & word != 0);
            assert_eq!(LaneMask::with_any(&row, word), with_any, "{word:#x}");
        }
    }
}
