//! Linear blends of neighbouring texels whose components lie side by side, by registers of AVX2.

use std::arch::x86_64::*;

use super::{FourOf, Line};

/// [`Vector::blend_neighbours`](super::Vector::blend_neighbours).
///
/// The four components of two lanes are one register from the loads to the last blend, so that a
/// load and a conversion fetch two texels whole.
///
/// # Safety
/// The machine has AVX2 and F16C; for the rest as there.
#[inline(always)]
pub(super) unsafe fn blend_neighbours<const KIND: u8, const LINES: usize>(
    base: *const u8,
    offsets: [[__m256i; 2]; LINES],
    weights: [[__m256; 2]; 3],
) -> [[__m256; 2]; 4] {
    let mut places = [const { Line([0; 16]) }; LINES];
    // SAFETY: the caller guarantees that the machine has AVX2 and F16C, and keeps the contract of
    // the trait's function; a row is two registers long.
    unsafe {
        for (line, [low, high]) in places.iter_mut().zip(offsets) {
            let at = line.0.as_mut_ptr();
            _mm256_store_si256(at.cast(), low);
            _mm256_store_si256(at.add(8).cast(), high);
        }
        let [[xl, xh], [yl, yh], [zl, zh]] = weights;
        let low = eight_lanes::<KIND, LINES>(base, &places, 0, [xl, yl, zl]);
        let high = eight_lanes::<KIND, LINES>(base, &places, 8, [xh, yh, zh]);
        [
            [low[0], high[0]],
            [low[1], high[1]],
            [low[2], high[2]],
            [low[3], high[3]],
        ]
    }
}

/// The components of eight lanes from `first` on.
///
/// # Safety
/// As [`blend_neighbours`].
#[inline(always)]
unsafe fn eight_lanes<const KIND: u8, const LINES: usize>(
    base: *const u8,
    places: &[Line; LINES],
    first: usize,
    weights: [__m256; 3],
) -> [__m256; 4] {
    // SAFETY: the caller guarantees that the machine has AVX2 and F16C, and keeps the contract of
    // the trait's function.
    unsafe {
        let a = two_lanes::<KIND, LINES, 0b00_00_00_00>(base, places, first, weights);
        let b = two_lanes::<KIND, LINES, 0b01_01_01_01>(base, places, first + 1, weights);
        let c = two_lanes::<KIND, LINES, 0b10_10_10_10>(base, places, first + 2, weights);
        let d = two_lanes::<KIND, LINES, 0b11_11_11_11>(base, places, first + 3, weights);
        // Transposed in each half: that has the components of four neighbouring lanes.
        let low = [_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d)];
        let high = [_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d)];
        [
            _mm256_shuffle_ps::<0b01_00_01_00>(low[0], low[1]),
            _mm256_shuffle_ps::<0b11_10_11_10>(low[0], low[1]),
            _mm256_shuffle_ps::<0b01_00_01_00>(high[0], high[1]),
            _mm256_shuffle_ps::<0b11_10_11_10>(high[0], high[1]),
        ]
    }
}

/// The components of a lane, and of the one four behind it. `SPREAD` picks their weights.
///
/// # Safety
/// As [`blend_neighbours`].
#[inline(always)]
unsafe fn two_lanes<const KIND: u8, const LINES: usize, const SPREAD: i32>(
    base: *const u8,
    places: &[Line; LINES],
    lane: usize,
    weights: [__m256; 3],
) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2 and F16C, and keeps the contract of
    // the trait's function.
    unsafe {
        let x = _mm256_permute_ps::<SPREAD>(weights[0]);
        let mut lines = [x; LINES];
        for (line, places) in lines.iter_mut().zip(places) {
            let a = two_texels::<KIND>(base.add(places.0[lane] as usize));
            let b = two_texels::<KIND>(base.add(places.0[lane + 4] as usize));
            let left = _mm256_permute2f128_ps::<0x20>(a, b);
            let right = _mm256_permute2f128_ps::<0x31>(a, b);
            *line = lerp(left, right, x);
        }
        let y = _mm256_permute_ps::<SPREAD>(weights[1]);
        let front = lerp(lines[0], lines[1], y);
        if LINES == 2 {
            return front;
        }
        let behind = lerp(lines[2 % LINES], lines[3 % LINES], y);
        lerp(front, behind, _mm256_permute_ps::<SPREAD>(weights[2]))
    }
}

/// The components of two neighbouring texels.
///
/// # Safety
/// As [`blend_neighbours`].
#[inline(always)]
unsafe fn two_texels<const KIND: u8>(at: *const u8) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2 and F16C, and keeps the contract of
    // the trait's function.
    unsafe {
        match KIND {
            FourOf::BYTES => _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(at.cast()))),
            FourOf::SHORTS => _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(at.cast()))),
            FourOf::HALVES => _mm256_cvtph_ps(_mm_loadu_si128(at.cast())),
            _ => _mm256_loadu_ps(at.cast()),
        }
    }
}

/// As [`Vector::lerp`](super::Vector::lerp).
///
/// # Safety
/// The machine has AVX.
#[inline(always)]
unsafe fn lerp(a: __m256, b: __m256, weight: __m256) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX.
    unsafe { _mm256_add_ps(a, _mm256_mul_ps(weight, _mm256_sub_ps(b, a))) }
}
