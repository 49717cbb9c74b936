//! Numbers of a packet's rays in registers: one for all rays with AVX-512, one for each half of
//! them with AVX2.

use std::arch::x86_64::*;

use lanes::LaneMask;

use crate::walk::PACKET;
use crate::walk::rows::{Lanes, Words};

/// A register with numbers of some of a packet's rays, a *part* of it.
///
/// Methods are inlined into functions that have the instruction set enabled. Masks have a bit for
/// each ray of the part.
pub(super) trait Register: Copy {
    /// Rays of a part.
    const RAYS: usize;
    /// Whether a test of each triangle with all rays takes less than one of each ray with all
    /// triangles.
    fn is_by_triangles(triangles: u32, rays: u32) -> bool;

    /// # Safety
    /// The machine has the instruction set, here and below.
    unsafe fn load(row: &Lanes, part: usize) -> Self;
    unsafe fn store(self, row: &mut Lanes, part: usize);
    unsafe fn splat(number: f32) -> Self;
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn sub(self, other: Self) -> Self;
    unsafe fn mul(self, other: Self) -> Self;
    unsafe fn div(self, other: Self) -> Self;
    /// `self < other ? self : other`, and `self > other ? self : other`.
    unsafe fn min(self, other: Self) -> Self;
    unsafe fn max(self, other: Self) -> Self;
    unsafe fn abs(self) -> Self;
    unsafe fn negated(self) -> Self;
    /// `self < other`, `self <= other` and `self == other`: none holds of a NaN.
    unsafe fn lt(self, other: Self) -> u32;
    unsafe fn le(self, other: Self) -> u32;
    unsafe fn eq(self, other: Self) -> u32;
    /// These numbers in the rays of a mask, and others in the other rays.
    unsafe fn pick(self, others: Self, rays: u32) -> Self;
    /// Puts a word into a row, for the rays of a mask.
    unsafe fn put_word(row: &mut Words, word: u32, part: usize, rays: u32);
}

/// The rays of a part, of those of a packet.
#[inline(always)]
pub(super) fn rays_of<R: Register>(lanes: LaneMask, part: usize) -> u32 {
    u32::from(lanes.bits()) >> (part * R::RAYS) & ((1 << R::RAYS) - 1)
}

/// The lanes of rays of a part.
#[inline(always)]
pub(super) fn lanes_of<R: Register>(rays: u32, part: usize) -> LaneMask {
    LaneMask::from_bits((rays << (part * R::RAYS)) as u16)
}

impl Register for __m512 {
    const RAYS: usize = PACKET;

    #[inline(always)]
    fn is_by_triangles(triangles: u32, rays: u32) -> bool {
        triangles < 2 * rays
    }

    #[inline(always)]
    unsafe fn load(row: &Lanes, _: usize) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set; sixteen numbers.
        unsafe { _mm512_loadu_ps(row.as_ptr()) }
    }

    #[inline(always)]
    unsafe fn store(self, row: &mut Lanes, _: usize) {
        // SAFETY: the caller guarantees that the machine has the instruction set; sixteen numbers.
        unsafe { _mm512_storeu_ps(row.as_mut_ptr(), self) }
    }

    #[inline(always)]
    unsafe fn splat(number: f32) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_set1_ps(number) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_add_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_sub_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_mul_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn div(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_div_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_min_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_max_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn abs(self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_abs_ps(self) }
    }

    #[inline(always)]
    unsafe fn negated(self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_xor_ps(self, _mm512_set1_ps(-0.0)) }
    }

    #[inline(always)]
    unsafe fn lt(self, other: Self) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self, other).into() }
    }

    #[inline(always)]
    unsafe fn le(self, other: Self) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self, other).into() }
    }

    #[inline(always)]
    unsafe fn eq(self, other: Self) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self, other).into() }
    }

    #[inline(always)]
    unsafe fn pick(self, others: Self, rays: u32) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm512_mask_blend_ps(rays as u16, others, self) }
    }

    #[inline(always)]
    unsafe fn put_word(row: &mut Words, word: u32, _: usize, rays: u32) {
        // SAFETY: the caller guarantees that the machine has the instruction set; sixteen words.
        unsafe {
            let row = row.as_mut_ptr().cast();
            _mm512_mask_storeu_epi32(row, rays as u16, _mm512_set1_epi32(word as i32));
        }
    }
}

/// The rays of a mask, a word each.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn spread(rays: u32) -> __m256i {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe {
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let chosen = _mm256_and_si256(_mm256_set1_epi32(rays as i32), bits);
        _mm256_cmpeq_epi32(chosen, bits)
    }
}

impl Register for __m256 {
    const RAYS: usize = PACKET / 2;

    #[inline(always)]
    fn is_by_triangles(triangles: u32, rays: u32) -> bool {
        2 * triangles < rays
    }

    #[inline(always)]
    unsafe fn load(row: &Lanes, part: usize) -> Self {
        let half = &row[part % 2 * Self::RAYS..][..Self::RAYS];
        // SAFETY: the caller guarantees that the machine has the instruction set; eight numbers.
        unsafe { _mm256_loadu_ps(half.as_ptr()) }
    }

    #[inline(always)]
    unsafe fn store(self, row: &mut Lanes, part: usize) {
        let half = &mut row[part % 2 * Self::RAYS..][..Self::RAYS];
        // SAFETY: the caller guarantees that the machine has the instruction set; eight numbers.
        unsafe { _mm256_storeu_ps(half.as_mut_ptr(), self) }
    }

    #[inline(always)]
    unsafe fn splat(number: f32) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_set1_ps(number) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_add_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_sub_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_mul_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn div(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_div_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn min(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_min_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_max_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn abs(self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self) }
    }

    #[inline(always)]
    unsafe fn negated(self) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_xor_ps(self, _mm256_set1_ps(-0.0)) }
    }

    #[inline(always)]
    unsafe fn lt(self, other: Self) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self, other)) as u32 }
    }

    #[inline(always)]
    unsafe fn le(self, other: Self) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self, other)) as u32 }
    }

    #[inline(always)]
    unsafe fn eq(self, other: Self) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(self, other)) as u32 }
    }

    #[inline(always)]
    unsafe fn pick(self, others: Self, rays: u32) -> Self {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { _mm256_blendv_ps(others, self, _mm256_castsi256_ps(spread(rays))) }
    }

    #[inline(always)]
    unsafe fn put_word(row: &mut Words, word: u32, part: usize, rays: u32) {
        let half = &mut row[part % 2 * Self::RAYS..][..Self::RAYS];
        // SAFETY: the caller guarantees that the machine has the instruction set; eight words.
        unsafe {
            let word = _mm256_set1_epi32(word as i32);
            _mm256_maskstore_epi32(half.as_mut_ptr().cast(), spread(rays), word);
        }
    }
}
