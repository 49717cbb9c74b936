//! Sixteen 16-bit floats, each in the low half of a word whose high half is zero, to and from
//! f32 by the processor's conversions. Subnormal numbers take no longer than others, and NaNs
//! become quiet.

use std::arch::x86_64::*;

use crate::SUBGROUP_SIZE;

/// The words.
pub(crate) type Words = [u32; SUBGROUP_SIZE];

/// The numbers of sixteen words.
#[inline]
#[target_feature(enable = "avx2,f16c")]
pub(crate) fn widen_256([low, high]: [__m256i; 2]) -> [__m256; 2] {
    // Packed within halves: the middle quarters change places.
    let packed = _mm256_permute4x64_epi64::<0xd8>(_mm256_packus_epi32(low, high));
    [
        _mm256_cvtph_ps(_mm256_castsi256_si128(packed)),
        _mm256_cvtph_ps(_mm256_extracti128_si256::<1>(packed)),
    ]
}

/// The words of eight numbers, rounded to nearest even.
#[inline]
#[target_feature(enable = "avx2,f16c")]
pub(crate) fn narrow_256(lanes: __m256) -> __m256i {
    _mm256_cvtepu16_epi32(_mm256_cvtps_ph::<_MM_FROUND_TO_NEAREST_INT>(lanes))
}

/// As [`widen_256`].
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn widen_512(words: __m512i) -> __m512 {
    _mm512_cvtph_ps(_mm512_cvtepi32_epi16(words))
}

/// The words of sixteen numbers, rounded to nearest even.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn narrow_512(lanes: __m512) -> __m512i {
    _mm512_cvtepu16_epi32(_mm512_cvtps_ph::<_MM_FROUND_TO_NEAREST_INT>(lanes))
}

/// # Safety
/// The lanes are there; the machine has AVX2 and F16C.
#[inline]
#[target_feature(enable = "avx2,f16c")]
pub(crate) unsafe fn widen_avx2(from: *const Words) -> [f32; SUBGROUP_SIZE] {
    // SAFETY: the caller guarantees that the lanes are there; the machine has AVX2 and F16C; arrays
    // of sixteen words are two registers long.
    unsafe {
        let from = from.cast::<__m256i>();
        let wide = widen_256([_mm256_loadu_si256(from), _mm256_loadu_si256(from.add(1))]);
        std::mem::transmute::<[__m256; 2], [f32; SUBGROUP_SIZE]>(wide)
    }
}

/// # Safety
/// As for [`widen_avx2`].
#[inline]
#[target_feature(enable = "avx2,f16c")]
pub(crate) unsafe fn narrow_avx2(from: &[f32; SUBGROUP_SIZE], to: *mut Words) {
    // SAFETY: as for `widen_avx2`.
    unsafe {
        let (from, to) = (from.as_ptr(), to.cast::<__m256i>());
        _mm256_storeu_si256(to, narrow_256(_mm256_loadu_ps(from)));
        _mm256_storeu_si256(to.add(1), narrow_256(_mm256_loadu_ps(from.add(8))));
    }
}

/// # Safety
/// The lanes are there; the machine has AVX-512 F.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn widen_avx512(from: *const Words) -> [f32; SUBGROUP_SIZE] {
    // SAFETY: the caller guarantees that the lanes are there; the machine has AVX-512 F; arrays of
    // sixteen words are one register long.
    unsafe {
        let wide = widen_512(_mm512_loadu_si512(from.cast()));
        std::mem::transmute::<__m512, [f32; SUBGROUP_SIZE]>(wide)
    }
}

/// # Safety
/// As for [`widen_avx512`].
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn narrow_avx512(from: &[f32; SUBGROUP_SIZE], to: *mut Words) {
    // SAFETY: as for `widen_avx512`.
    unsafe {
        _mm512_storeu_si512(to.cast(), narrow_512(_mm512_loadu_ps(from.as_ptr())));
    }
}
