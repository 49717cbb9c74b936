//! Permutations of lanes, in each instruction set.

use lanes::Row;

use crate::SUBGROUP_SIZE;
use crate::interp::tier::{Portable, Tier};

type Pairs = [u64; SUBGROUP_SIZE];

/// Permutes of a tier.
///
/// # Safety
/// Of all functions: the machine has the tier.
pub(in crate::interp) trait Permute: Tier {
    /// The words of the lanes that `from` names; zero for numbers past the last lane.
    unsafe fn shuffle(words: &Row, from: &Row) -> Row;
    /// The same for 64 bits.
    unsafe fn shuffle_pairs(pairs: &Pairs, from: &Row) -> Pairs;
}

/// A word of 32 or 64 bits that a permutation moves.
pub(in crate::interp) trait Word: Copy + 'static {
    /// # Safety
    /// As for [`Permute`].
    unsafe fn shuffled<P: Permute>(
        row: &[Self; SUBGROUP_SIZE],
        from: &Row,
    ) -> [Self; SUBGROUP_SIZE];
}

impl Word for u32 {
    #[inline(always)]
    unsafe fn shuffled<P: Permute>(row: &Row, from: &Row) -> Row {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { P::shuffle(row, from) }
    }
}

impl Word for u64 {
    #[inline(always)]
    unsafe fn shuffled<P: Permute>(row: &Pairs, from: &Row) -> Pairs {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { P::shuffle_pairs(row, from) }
    }
}

/// The permutation lane by lane.
#[inline(always)]
fn shuffle_singly<S: Copy + Default>(row: &[S; SUBGROUP_SIZE], from: &Row) -> [S; SUBGROUP_SIZE] {
    let mut taken = [S::default(); SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        let other = from[k] as usize;
        let scalar = row[other % SUBGROUP_SIZE];
        taken[k] = if other < SUBGROUP_SIZE {
            scalar
        } else {
            S::default()
        };
    }
    taken
}

impl Permute for Portable {
    #[inline(always)]
    unsafe fn shuffle(words: &Row, from: &Row) -> Row {
        shuffle_singly(words, from)
    }

    #[inline(always)]
    unsafe fn shuffle_pairs(pairs: &Pairs, from: &Row) -> Pairs {
        shuffle_singly(pairs, from)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;
    use std::mem::transmute;

    use super::{Pairs, Permute, shuffle_singly};
    use crate::interp::tier::{Avx2, Avx512};
    use lanes::Row;

    impl Permute for Avx2 {
        #[inline(always)]
        unsafe fn shuffle(words: &Row, from: &Row) -> Row {
            // SAFETY: the caller keeps the contract of this function; a row is two registers.
            unsafe {
                let [low, high] = transmute::<Row, [__m256i; 2]>(*words);
                let mut lanes = transmute::<Row, [__m256i; 2]>(*from);
                for lanes in &mut lanes {
                    let from = *lanes;
                    // The permutes read the low three bits of a lane's number. The fourth becomes
                    // the sign bit, which selects in the blend.
                    let of_low = _mm256_castsi256_ps(_mm256_permutevar8x32_epi32(low, from));
                    let of_high = _mm256_castsi256_ps(_mm256_permutevar8x32_epi32(high, from));
                    let is_high = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(from));
                    let both = _mm256_castps_si256(_mm256_blendv_ps(of_low, of_high, is_high));
                    let beyond = _mm256_srli_epi32::<4>(from);
                    let exists = _mm256_cmpeq_epi32(beyond, _mm256_setzero_si256());
                    *lanes = _mm256_and_si256(both, exists);
                }
                transmute::<[__m256i; 2], Row>(lanes)
            }
        }

        #[inline(always)]
        unsafe fn shuffle_pairs(pairs: &Pairs, from: &Row) -> Pairs {
            shuffle_singly(pairs, from)
        }
    }

    impl Permute for Avx512 {
        #[inline(always)]
        unsafe fn shuffle(words: &Row, from: &Row) -> Row {
            // SAFETY: the caller keeps the contract of this function; a row is a register.
            unsafe {
                let words = transmute::<Row, __m512i>(*words);
                let from = transmute::<Row, __m512i>(*from);
                let exists = _mm512_cmplt_epu32_mask(from, _mm512_set1_epi32(16));
                let taken = _mm512_maskz_permutexvar_epi32(exists, from, words);
                transmute::<__m512i, Row>(taken)
            }
        }

        #[inline(always)]
        unsafe fn shuffle_pairs(pairs: &Pairs, from: &Row) -> Pairs {
            // SAFETY: the caller keeps the contract of this function; pairs are two registers.
            unsafe {
                let [low, high] = transmute::<Pairs, [__m512i; 2]>(*pairs);
                let lanes = transmute::<Row, [__m256i; 2]>(*from);
                let mut taken = [low, high];
                for k in 0..2 {
                    let from = _mm512_cvtepu32_epi64(lanes[k]);
                    let exists = _mm512_cmplt_epu64_mask(from, _mm512_set1_epi64(16));
                    taken[k] = _mm512_maskz_permutex2var_epi64(exists, low, from, high);
                }
                transmute::<[__m512i; 2], Pairs>(taken)
            }
        }
    }
}
