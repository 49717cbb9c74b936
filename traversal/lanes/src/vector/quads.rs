//! Loads and stores of quads by registers of AVX2.

use std::arch::x86_64::*;

/// Four rows of four numbers of 16 bits as two quads and two more.
///
/// # Safety
/// The machine has AVX2, and eight bytes are readable at `at` and 1 to 3 strides behind it.
#[inline(always)]
pub(super) unsafe fn quads_of_shorts(at: *const u8, stride_bytes: usize) -> [__m128i; 2] {
    // SAFETY: the caller guarantees that the machine has AVX2, and eight bytes are readable at `at`
    // and 1 to 3 strides behind it.
    unsafe {
        let (second, third) = (at.add(stride_bytes), at.add(2 * stride_bytes));
        let fourth = at.add(3 * stride_bytes);
        [
            _mm_unpacklo_epi32(_mm_loadl_epi64(at.cast()), _mm_loadl_epi64(second.cast())),
            _mm_unpacklo_epi32(
                _mm_loadl_epi64(third.cast()),
                _mm_loadl_epi64(fourth.cast()),
            ),
        ]
    }
}

/// Stores two quads of numbers of 16 bits as two rows of four.
///
/// # Safety
/// The machine has AVX2, and eight bytes are writable at `at` and a stride behind it.
#[inline(always)]
pub(super) unsafe fn put_quads_of_shorts(quads: __m128i, at: *mut u8, stride_bytes: usize) {
    // SAFETY: the caller guarantees that the machine has AVX2, and eight bytes are writable at `at`
    // and a stride behind it.
    unsafe {
        let rows = _mm_shuffle_epi32::<0b11_01_10_00>(quads);
        _mm_storel_epi64(at.cast(), rows);
        _mm_storel_epi64(at.add(stride_bytes).cast(), _mm_unpackhi_epi64(rows, rows));
    }
}

/// The words of a quad whose rows lie apart.
///
/// # Safety
/// The machine has AVX2, and eight bytes are readable at `at` and a stride behind it.
#[inline(always)]
pub(super) unsafe fn quad_at(at: *const u8, stride_bytes: usize) -> __m128i {
    // SAFETY: the caller guarantees that the machine has AVX2, and eight bytes are readable at `at`
    // and a stride behind it.
    unsafe {
        let lower = _mm_loadl_epi64(at.add(stride_bytes).cast());
        _mm_unpacklo_epi64(_mm_loadl_epi64(at.cast()), lower)
    }
}

/// By lanes of a quad: ones in their words.
static LANES: [[u32; 4]; 16] = {
    let mut lanes = [[0; 4]; 16];
    let mut bits = 0;
    while bits < 64 {
        if (bits / 4) >> (bits % 4) & 1 != 0 {
            lanes[bits / 4][bits % 4] = u32::MAX;
        }
        bits += 1;
    }
    lanes
};

/// Stores words of the lanes in the lowest bits of a mask to a quad whose rows lie apart.
///
/// # Safety
/// The machine has AVX2, and eight bytes are writable at `at` and a stride behind it.
#[inline(always)]
unsafe fn put_quad(words: __m128i, lanes: u16, at: *mut u8, stride_bytes: usize) {
    // SAFETY: the caller guarantees that the machine has AVX2, and eight bytes are writable at `at`
    // and a stride behind it.
    unsafe {
        let lanes = _mm_loadu_si128(LANES[usize::from(lanes & 0xf)].as_ptr().cast());
        let new = _mm_blendv_epi8(quad_at(at, stride_bytes), words, lanes);
        _mm_storel_epi64(at.cast(), new);
        _mm_storel_epi64(at.add(stride_bytes).cast(), _mm_unpackhi_epi64(new, new));
    }
}

/// As [`put_quad`], of pairs of words.
///
/// # Safety
/// The machine has AVX2, and sixteen bytes are writable at `at` and a stride behind it.
#[inline(always)]
unsafe fn put_quad_of_pairs([a, b]: [__m128i; 2], lanes: u16, at: *mut u8, stride_bytes: usize) {
    // SAFETY: the caller guarantees that the machine has AVX2, and sixteen bytes are writable at
    // `at` and a stride behind it.
    unsafe {
        let lanes = _mm_loadu_si128(LANES[usize::from(lanes & 0xf)].as_ptr().cast());
        let (first, second) = (at.cast(), at.add(stride_bytes).cast());
        let upper = _mm_blendv_epi8(
            _mm_loadu_si128(first),
            _mm_unpacklo_epi32(a, b),
            _mm_unpacklo_epi32(lanes, lanes),
        );
        let lower = _mm_blendv_epi8(
            _mm_loadu_si128(second),
            _mm_unpackhi_epi32(a, b),
            _mm_unpackhi_epi32(lanes, lanes),
        );
        _mm_storeu_si128(first, upper);
        _mm_storeu_si128(second, lower);
    }
}

/// As [`put_quad`], of four words.
///
/// # Safety
/// The machine has AVX2, and 32 bytes are writable at `at` and a stride behind it.
#[inline(always)]
unsafe fn put_quad_of_fours(
    [a, b, c, d]: [__m128i; 4],
    lanes: u16,
    at: *mut u8,
    stride_bytes: usize,
) {
    // SAFETY: the caller guarantees that the machine has AVX2, and 32 bytes are writable at `at`
    // and a stride behind it.
    unsafe {
        let lanes = _mm_loadu_si128(LANES[usize::from(lanes & 0xf)].as_ptr().cast());
        let (first, second) = (at.cast::<__m256i>(), at.add(stride_bytes).cast::<__m256i>());
        let ((ac, bd), (ac_high, bd_high)) = (
            (_mm_unpacklo_epi32(a, c), _mm_unpacklo_epi32(b, d)),
            (_mm_unpackhi_epi32(a, c), _mm_unpackhi_epi32(b, d)),
        );
        let upper = _mm256_set_m128i(_mm_unpackhi_epi32(ac, bd), _mm_unpacklo_epi32(ac, bd));
        let lower = _mm256_set_m128i(
            _mm_unpackhi_epi32(ac_high, bd_high),
            _mm_unpacklo_epi32(ac_high, bd_high),
        );
        let lanes = _mm256_castsi128_si256(lanes);
        let in_upper =
            _mm256_permutevar8x32_epi32(lanes, _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1));
        let in_lower =
            _mm256_permutevar8x32_epi32(lanes, _mm256_setr_epi32(2, 2, 2, 2, 3, 3, 3, 3));
        let upper = _mm256_blendv_epi8(_mm256_loadu_si256(first), upper, in_upper);
        let lower = _mm256_blendv_epi8(_mm256_loadu_si256(second), lower, in_lower);
        _mm256_storeu_si256(first, upper);
        _mm256_storeu_si256(second, lower);
    }
}

/// [`Vector::put_each_quad`], by the quarters of each word's register.
///
/// # Safety
/// As there; the machine has AVX2.
#[inline(always)]
pub(super) unsafe fn put_quads<const WORDS: usize>(
    words: &[[__m128i; 4]; WORDS],
    mask: u16,
    at: [*mut u8; 4],
    stride_bytes: usize,
) {
    for quad in 0..4 {
        let (lanes, at) = (mask >> (4 * quad), at[quad]);
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            match &words[..] {
                [a] => put_quad(a[quad], lanes, at, stride_bytes),
                [a, b] => put_quad_of_pairs([a[quad], b[quad]], lanes, at, stride_bytes),
                [a, b, c, d] => {
                    let fours = [a[quad], b[quad], c[quad], d[quad]];
                    put_quad_of_fours(fours, lanes, at, stride_bytes);
                }
                _ => unreachable!("texels have one, two or four words"),
            }
        }
    }
}

/// Two rows of four pairs of words as two quads: the first words, and the second ones.
///
/// # Safety
/// The machine has AVX2, and 32 bytes are readable at `at` and a stride behind it.
#[inline(always)]
pub(super) unsafe fn half_of_pairs(at: *const u8, stride_bytes: usize) -> (__m256i, __m256i) {
    // SAFETY: the caller guarantees that the machine has AVX2, and 32 bytes are readable at `at`
    // and a stride behind it.
    unsafe {
        let upper = _mm256_loadu_ps(at.cast());
        let lower = _mm256_loadu_ps(at.add(stride_bytes).cast());
        (
            _mm256_castps_si256(_mm256_shuffle_ps::<0b10_00_10_00>(upper, lower)),
            _mm256_castps_si256(_mm256_shuffle_ps::<0b11_01_11_01>(upper, lower)),
        )
    }
}
