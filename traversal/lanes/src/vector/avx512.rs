//! AVX-512: one register for sixteen lanes.

use std::arch::x86_64::*;
use std::hint::black_box;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::avx2::four_scalars;
use super::neighbours::blend_neighbours;
use super::quads::{half_of_pairs, put_quads, put_quads_of_shorts, quad_at, quads_of_shorts};
use super::{ByteTable, Line, Task, Vector, gathered_bytes};
use crate::{Row, Tier, has_byte_permutes, quad};

/// AVX-512 F, VL, DQ and BW.
#[derive(Clone, Copy)]
pub struct Avx512(());

type F = __m512;
type I = __m512i;

/// Functions that are one expression of intrinsics.
macro_rules! intrinsics {
    ($(fn $name:ident($($arg:ident: $ty:ty),*) -> $result:ty = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name(self, $($arg: $ty),*) -> $result {
            // SAFETY: the token says that the machine has the instructions; rows are as long as a
            // register.
            unsafe { $body }
        }
    )*};
}

impl Vector for Avx512 {
    type F = F;
    type I = I;

    const TIER: Tier = Tier::Avx512;
    const HAS_WINDOWS: bool = true;
    const BLENDS_NEIGHBOURS: bool = true;

    #[inline(always)]
    unsafe fn new() -> Self {
        Avx512(())
    }

    intrinsics! {
        fn splat(x: f32) -> F = _mm512_set1_ps(x);
        fn splat_i(x: i32) -> I = _mm512_set1_epi32(x);
        fn load(row: &Row) -> F = _mm512_loadu_ps(row.as_ptr().cast());
        fn store(a: F, row: &mut Row) -> () = _mm512_storeu_ps(row.as_mut_ptr().cast(), a);
        fn load_i(row: &Row) -> I = _mm512_loadu_si512(row.as_ptr().cast());
        fn store_i(a: I, row: &mut Row) -> () = _mm512_storeu_si512(row.as_mut_ptr().cast(), a);
        fn bits_to_f(a: I) -> F = _mm512_castsi512_ps(a);
        fn bits_of(a: F) -> I = _mm512_castps_si512(a);
        fn add(a: F, b: F) -> F = _mm512_add_ps(a, b);
        fn sub(a: F, b: F) -> F = _mm512_sub_ps(a, b);
        fn mul(a: F, b: F) -> F = _mm512_mul_ps(a, b);
        fn add_exact_product(sum: F, a: F, b: F) -> F = _mm512_fmadd_ps(a, b, sum);
        fn div_units(a: F, divisor: f32) -> F = {
            let (d, r) = (_mm512_set1_ps(divisor), _mm512_set1_ps(1.0 / divisor));
            let quotient = _mm512_mul_ps(a, r);
            _mm512_fmadd_ps(_mm512_fnmadd_ps(quotient, d, a), r, quotient)
        };
        fn quotient(a: F, _divisor: F, high: F, low: F) -> F =
            _mm512_fmadd_ps(a, high, _mm512_mul_ps(a, low));
        fn div(a: F, b: F) -> F = _mm512_div_ps(a, b);
        fn sqrt(a: F) -> F = _mm512_sqrt_ps(a);
        fn scaled(a: F, scale: f32) -> I = {
            let sum = _mm512_fmadd_ps(a, _mm512_set1_ps(scale), _mm512_set1_ps(super::ROUNDER));
            let rounder = _mm512_set1_epi32(super::ROUNDER.to_bits() as i32);
            _mm512_sub_epi32(_mm512_castps_si512(sum), rounder)
        };
        fn quiet_half_to_f(a: I) -> F = _mm512_cvtph_ps(_mm512_cvtepi32_epi16(a));
        fn floor(a: F) -> F = _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a);
        fn ceil(a: F) -> F = _mm512_roundscale_ps::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(a);
        fn round_ties_even(a: F) -> F =
            _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(a);
        fn min(a: F, b: F) -> F = _mm512_min_ps(a, b);
        fn max(a: F, b: F) -> F = _mm512_max_ps(a, b);
        fn to_i(a: F) -> I = _mm512_cvttps_epi32(a);
        fn to_f(a: I) -> F = _mm512_cvtepi32_ps(a);
        fn to_half(a: F) -> I = {
            let halves = _mm512_cvtps_ph::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(a);
            _mm512_cvtepu16_epi32(halves)
        };
        fn add_i(a: I, b: I) -> I = _mm512_add_epi32(a, b);
        fn sub_i(a: I, b: I) -> I = _mm512_sub_epi32(a, b);
        fn mul_i(a: I, b: I) -> I = _mm512_mullo_epi32(a, b);
        fn and_i(a: I, b: I) -> I = _mm512_and_si512(a, b);
        fn or_i(a: I, b: I) -> I = _mm512_or_si512(a, b);
        fn xor_i(a: I, b: I) -> I = _mm512_xor_si512(a, b);
        // Not by a count in a 128-bit register, which takes two operations.
        fn left_i(a: I, bits: u32) -> I = _mm512_sllv_epi32(a, _mm512_set1_epi32(bits as i32));
        fn right_u(a: I, bits: u32) -> I = _mm512_srlv_epi32(a, _mm512_set1_epi32(bits as i32));
        fn right_i(a: I, bits: u32) -> I = _mm512_srav_epi32(a, _mm512_set1_epi32(bits as i32));
        fn left_each(a: I, bits: I) -> I = _mm512_sllv_epi32(a, bits);
        fn right_each(a: I, bits: I) -> I = _mm512_srlv_epi32(a, bits);
        fn table(table: &[f32; 16], index: I) -> F =
            _mm512_permutexvar_ps(index, _mm512_loadu_ps(table.as_ptr()));
        fn min_u(a: I, b: I) -> I = _mm512_min_epu32(a, b);
        fn min_i(a: I, b: I) -> I = _mm512_min_epi32(a, b);
        fn max_i(a: I, b: I) -> I = _mm512_max_epi32(a, b);
        fn sign_i(a: I) -> I = _mm512_srai_epi32::<31>(a);
        fn byte(a: I, index: u32) -> I = {
            // Of each word the one byte, and zeros.
            let word = _mm_setr_epi32(0, 4, 8, 12);
            let pick = _mm_or_si128(
                _mm_add_epi32(word, _mm_set1_epi32(index as i32)),
                _mm_set1_epi32(0x8080_8000u32 as i32),
            );
            _mm512_shuffle_epi8(a, _mm512_broadcast_i32x4(pick))
        };
        fn keep(a: I, mask: u16) -> I = _mm512_maskz_mov_epi32(mask, a);
        fn ne_i(a: I, b: I) -> u16 = _mm512_cmpneq_epi32_mask(a, b);
        fn lt_u(a: I, b: I) -> u16 = _mm512_cmplt_epu32_mask(a, b);
        fn gt(a: F, b: F) -> u16 = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, b);
        fn at_least(a: F, b: F) -> I = _mm512_movm_epi32(_mm512_cmp_ps_mask::<_CMP_GE_OQ>(a, b));
        fn ge(a: F, b: F) -> u16 = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(a, b);
        fn eq(a: F, b: F) -> u16 = _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(a, b);
        fn select(mask: u16, a: I, b: I) -> I = _mm512_mask_mov_epi32(b, mask, a);
    }

    #[inline(always)]
    fn quads(self, words: &[u32; 4]) -> I {
        let lanes = [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3];
        // SAFETY: the token; four words are as long as a quarter of a register.
        unsafe {
            let words = _mm512_castsi128_si512(_mm_loadu_si128(words.as_ptr().cast()));
            _mm512_permutexvar_epi32(self.load_i(&lanes), words)
        }
    }

    #[inline(always)]
    fn sides<const AXIS: usize>(self, a: F) -> (F, F) {
        // SAFETY: the token.
        unsafe {
            match AXIS {
                quad::X => (
                    _mm512_permute_ps::<0b10_10_00_00>(a),
                    _mm512_permute_ps::<0b11_11_01_01>(a),
                ),
                _ => (
                    _mm512_permute_ps::<0b01_00_01_00>(a),
                    _mm512_permute_ps::<0b11_10_11_10>(a),
                ),
            }
        }
    }

    #[inline(always)]
    unsafe fn load_quads(self, at: *const u8, stride_bytes: usize) -> I {
        // SAFETY: the token proves the features; the caller guarantees that sixteen bytes are
        // readable at `at` and 1 to 3 strides behind it.
        unsafe {
            let second = _mm_loadu_si128(at.add(stride_bytes).cast());
            let third = _mm_loadu_si128(at.add(2 * stride_bytes).cast());
            let fourth = _mm_loadu_si128(at.add(3 * stride_bytes).cast());
            let rows = _mm512_castsi128_si512(_mm_loadu_si128(at.cast()));
            let rows = _mm512_inserti32x4::<1>(rows, second);
            let rows = _mm512_inserti32x4::<2>(rows, third);
            let rows = _mm512_inserti32x4::<3>(rows, fourth);
            _mm512_permutex_epi64::<0b11_01_10_00>(rows)
        }
    }

    #[inline(always)]
    unsafe fn store_quads(self, a: I, at: *mut u8, stride_bytes: usize) {
        // SAFETY: the token proves the features; the caller guarantees that sixteen bytes are
        // writable at `at` and 1 to 3 strides behind it.
        unsafe {
            let rows = _mm512_permutex_epi64::<0b11_01_10_00>(a);
            let (second, third) = (at.add(stride_bytes), at.add(2 * stride_bytes));
            let fourth = at.add(3 * stride_bytes);
            _mm_storeu_si128(at.cast(), _mm512_castsi512_si128(rows));
            _mm_storeu_si128(second.cast(), _mm512_extracti32x4_epi32::<1>(rows));
            _mm_storeu_si128(third.cast(), _mm512_extracti32x4_epi32::<2>(rows));
            _mm_storeu_si128(fourth.cast(), _mm512_extracti32x4_epi32::<3>(rows));
        }
    }

    #[inline(always)]
    unsafe fn load_quads_of_shorts(self, at: *const u8, stride_bytes: usize) -> I {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // readable at `at` and 1 to 3 strides behind it.
        unsafe {
            let [upper, lower] = quads_of_shorts(at, stride_bytes);
            _mm512_cvtepu16_epi32(_mm256_set_m128i(lower, upper))
        }
    }

    #[inline(always)]
    unsafe fn store_quads_of_shorts(self, a: I, at: *mut u8, stride_bytes: usize) {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // writable at `at` and 1 to 3 strides behind it.
        unsafe {
            let shorts = _mm512_cvtepi32_epi16(a);
            let (upper, lower) = (
                _mm256_castsi256_si128(shorts),
                _mm256_extracti128_si256::<1>(shorts),
            );
            put_quads_of_shorts(upper, at, stride_bytes);
            put_quads_of_shorts(lower, at.add(2 * stride_bytes), stride_bytes);
        }
    }

    #[inline(always)]
    fn of_bytes(self, [low, high]: [u64; 2]) -> I {
        // SAFETY: the token.
        unsafe { _mm512_cvtepu8_epi32(_mm_set_epi64x(high as i64, low as i64)) }
    }

    #[inline(always)]
    fn to_bytes(self, a: I) -> [u64; 2] {
        // SAFETY: the token.
        unsafe {
            let bytes = _mm512_cvtepi32_epi8(a);
            let (low, high) = (_mm_cvtsi128_si64(bytes), _mm_extract_epi64::<1>(bytes));
            [low as u64, high as u64]
        }
    }

    #[inline(always)]
    unsafe fn load_each_quad(self, at: [*const u8; 4], stride_bytes: usize) -> I {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // readable at each place and a stride behind it.
        unsafe {
            let rows = _mm512_castsi128_si512(quad_at(at[0], stride_bytes));
            let rows = _mm512_inserti32x4::<1>(rows, quad_at(at[1], stride_bytes));
            let rows = _mm512_inserti32x4::<2>(rows, quad_at(at[2], stride_bytes));
            _mm512_inserti32x4::<3>(rows, quad_at(at[3], stride_bytes))
        }
    }

    #[inline(always)]
    unsafe fn put_each_quad<const WORDS: usize>(
        self,
        words: [I; WORDS],
        mask: u16,
        at: [*mut u8; 4],
        stride_bytes: usize,
    ) {
        // SAFETY: the token proves the features; the caller guarantees that two texels are readable
        // and writable at each place and a stride behind it.
        unsafe {
            let mut quarters = [[_mm_setzero_si128(); 4]; WORDS];
            for (quarters, words) in quarters.iter_mut().zip(words) {
                *quarters = parts(words);
            }
            put_quads(&quarters, mask, at, stride_bytes);
        }
    }

    #[inline(always)]
    unsafe fn load_quads_of_pairs(self, at: *const u8, stride_bytes: usize) -> (I, I) {
        // SAFETY: the token proves the features; the caller guarantees that 32 bytes are readable
        // at `at` and 1 to 3 strides behind it.
        unsafe {
            let (a0, b0) = half_of_pairs(at, stride_bytes);
            let (a1, b1) = half_of_pairs(at.add(2 * stride_bytes), stride_bytes);
            (
                _mm512_inserti64x4::<1>(_mm512_castsi256_si512(a0), a1),
                _mm512_inserti64x4::<1>(_mm512_castsi256_si512(b0), b1),
            )
        }
    }

    #[inline(always)]
    unsafe fn store_quads_of_pairs(self, a: I, b: I, at: *mut u8, stride_bytes: usize) {
        // SAFETY: the token proves the features; the caller guarantees that 32 bytes are writable
        // at `at` and 1 to 3 strides behind it.
        unsafe {
            let (upper, lower) = (_mm512_unpacklo_epi32(a, b), _mm512_unpackhi_epi32(a, b));
            let (second, third) = (at.add(stride_bytes), at.add(2 * stride_bytes));
            let fourth = at.add(3 * stride_bytes);
            _mm256_storeu_si256(at.cast(), _mm512_castsi512_si256(upper));
            _mm256_storeu_si256(second.cast(), _mm512_castsi512_si256(lower));
            _mm256_storeu_si256(third.cast(), _mm512_extracti64x4_epi64::<1>(upper));
            _mm256_storeu_si256(fourth.cast(), _mm512_extracti64x4_epi64::<1>(lower));
        }
    }

    #[inline(always)]
    unsafe fn gather(self, base: *const u8, offsets: I) -> I {
        // SAFETY: the token proves the features; the caller guarantees that four bytes are readable
        // at each.
        unsafe { _mm512_i32gather_epi32::<1>(offsets, base.cast()) }
    }

    #[inline(always)]
    unsafe fn gather_scalars<T: Copy + Into<u32>>(self, base: *const u8, offsets: I) -> I {
        let places = &mut Line([0; 16]).0;
        self.store_i(offsets, places);
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.scalars_at::<T>(base, std::hint::black_box(&*places)) }
    }
    #[inline(always)]
    unsafe fn words_at(self, base: *const u8, offsets: &Row) -> I {
        // SAFETY: the token proves the features; the caller guarantees that four bytes are readable
        // at each.
        unsafe {
            match gathers_slowly() {
                true => self.scalars_at::<u32>(base, offsets),
                false => self.gather(base, self.load_i(offsets)),
            }
        }
    }
    #[inline(always)]
    unsafe fn words_in_windows<const SIZE: u32>(
        self,
        base: *const u8,
        offsets: &Row,
        readable: u64,
    ) -> Option<I> {
        // SAFETY: the token proves the features; the caller keeps the contract of `Windows::new`.
        unsafe {
            let windows = Windows::new(base, offsets, readable, [SIZE, SIZE])?;
            let words = windows.words(0);
            if SIZE >= 4 {
                return Some(words);
            }
            let bytes = self.and_i(windows.offsets, self.splat_i(3));
            Some(self.right_each(words, self.left_i(bytes, 3)))
        }
    }
    #[inline(always)]
    unsafe fn pairs_in_windows(
        self,
        base: *const u8,
        offsets: &Row,
        readable: u64,
    ) -> Option<(I, I)> {
        // SAFETY: the token proves the features; the caller keeps the contract of `Windows::new`.
        unsafe {
            let windows = Windows::new(base, offsets, readable, [8, 4])?;
            Some((windows.words(0), windows.words(1)))
        }
    }
    #[inline(always)]
    unsafe fn scalars_at<T: Copy + Into<u32>>(self, base: *const u8, offsets: &Row) -> I {
        // SAFETY: the token proves the features; the caller guarantees that a scalar is readable at
        // each.
        unsafe {
            let first = four_scalars::<T>(base, offsets, 0);
            let second = four_scalars::<T>(base, offsets, 4);
            let third = four_scalars::<T>(base, offsets, 8);
            let fourth = four_scalars::<T>(base, offsets, 12);
            let low = _mm256_set_m128i(second, first);
            let high = _mm256_set_m128i(fourth, third);
            _mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high)
        }
    }

    #[inline(always)]
    unsafe fn gather_pairs(self, base: *const u8, offsets: I) -> (I, I) {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // readable at each.
        unsafe {
            match gathers_slowly() {
                true => {
                    let places = &mut Line([0; 16]).0;
                    self.store_i(offsets, places);
                    loaded_pairs(base, places)
                }
                false => gathered_pairs(base, offsets),
            }
        }
    }
    #[inline(always)]
    unsafe fn pairs_at(self, base: *const u8, offsets: &Row) -> (I, I) {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // readable at each.
        unsafe {
            match gathers_slowly() {
                true => loaded_pairs(base, offsets),
                false => gathered_pairs(base, self.load_i(offsets)),
            }
        }
    }
    #[inline(always)]
    unsafe fn gather_quads(self, base: *const u8, offsets: I) -> [I; 4] {
        let places = &mut Line([0; 16]).0;
        self.store_i(offsets, places);
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.quads_at(base, places) }
    }
    #[inline(always)]
    unsafe fn quads_at(self, base: *const u8, offsets: &Row) -> [I; 4] {
        // SAFETY: the token proves the features; the caller guarantees that sixteen bytes are
        // readable at each.
        unsafe {
            let a = every_fourth(base, offsets, 0);
            let b = every_fourth(base, offsets, 1);
            let c = every_fourth(base, offsets, 2);
            let d = every_fourth(base, offsets, 3);
            let low = (_mm512_unpacklo_epi32(a, b), _mm512_unpacklo_epi32(c, d));
            let high = (_mm512_unpackhi_epi32(a, b), _mm512_unpackhi_epi32(c, d));
            [
                _mm512_unpacklo_epi64(low.0, low.1),
                _mm512_unpackhi_epi64(low.0, low.1),
                _mm512_unpacklo_epi64(high.0, high.1),
                _mm512_unpackhi_epi64(high.0, high.1),
            ]
        }
    }

    /// In registers of half the width: in whole ones, two more halves would change places for each
    /// texel.
    #[inline(always)]
    unsafe fn blend_neighbours<const KIND: u8, const LINES: usize>(
        self,
        base: *const u8,
        offsets: [I; LINES],
        weights: [F; 3],
    ) -> [F; 4] {
        // SAFETY: the token; the caller keeps the contract of this function.
        unsafe {
            let mut lines = [[_mm256_setzero_si256(); 2]; LINES];
            for (line, offsets) in lines.iter_mut().zip(offsets) {
                *line = [
                    _mm512_castsi512_si256(offsets),
                    _mm512_extracti64x4_epi64::<1>(offsets),
                ];
            }
            let [x, y, z] = weights;
            let weights = [halves(x), halves(y), halves(z)];
            let [a, b, c, d] = blend_neighbours::<KIND, LINES>(base, lines, weights);
            [whole(a), whole(b), whole(c), whole(d)]
        }
    }

    #[inline(always)]
    fn bytes_in<const N: usize>(self, table: &ByteTable, words: [I; N]) -> [[F; 3]; N] {
        match has_byte_permutes() {
            // SAFETY: the machine has AVX-512 VBMI, and what the token says.
            true => unsafe { permuted_bytes(table, words) },
            false => gathered_bytes(self, table, words),
        }
    }

    #[inline(always)]
    unsafe fn apart<T: Task<Self>>(self, task: T) -> T::Output {
        #[inline(never)]
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,f16c")]
        unsafe fn run<T: Task<Avx512>>(v: Avx512, task: T) -> T::Output {
            // SAFETY: the caller guarantees that the task is as its type requires.
            unsafe { task.run(v) }
        }
        // SAFETY: the token says that the machine has the features; the caller keeps the contract
        // of `Task::run` of the task.
        unsafe { run(self, task) }
    }
}

/// [`Vector::bytes_in`] by permutes of bytes instead of gathers.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx2")]
fn permuted_bytes<const N: usize>(table: &ByteTable, words: [I; N]) -> [[F; 3]; N] {
    let mut planes = [[_mm512_setzero_si512(); 4]; N];
    for (i, table) in table.planes.iter().enumerate() {
        let at = table.as_ptr().cast::<I>();
        // SAFETY: the table is four registers long, and on a register's boundary.
        let [a, b, c, d] = unsafe { [*at, *at.add(1), *at.add(2), *at.add(3)] };
        for (word, planes) in words.iter().zip(&mut planes) {
            let upper = _mm512_movepi8_mask(*word);
            let low = _mm512_permutex2var_epi8(a, *word, b);
            let high = _mm512_permutex2var_epi8(c, *word, d);
            planes[i] = _mm512_mask_mov_epi8(low, upper, high);
        }
    }
    let mut entries = [[_mm512_setzero_ps(); 3]; N];
    let (even_bytes, lower) = (_mm512_set1_epi32(0x00ff_00ff), _mm512_set1_epi32(0xffff));
    for ([p0, p1, p2, p3], entries) in planes.into_iter().zip(&mut entries) {
        // 0xca takes the second where the first has ones, else the third.
        let even = |low, high| {
            _mm512_ternarylogic_epi32::<0xca>(even_bytes, low, _mm512_slli_epi16::<8>(high))
        };
        let odd = |low, high| {
            _mm512_ternarylogic_epi32::<0xca>(even_bytes, _mm512_srli_epi16::<8>(low), high)
        };
        let (low, high) = (even(p0, p1), even(p2, p3));
        let first = _mm512_ternarylogic_epi32::<0xca>(lower, low, _mm512_slli_epi32::<16>(high));
        let third = _mm512_ternarylogic_epi32::<0xca>(lower, _mm512_srli_epi32::<16>(low), high);
        let (low, high) = (odd(p0, p1), odd(p2, p3));
        let second = _mm512_ternarylogic_epi32::<0xca>(lower, low, _mm512_slli_epi32::<16>(high));
        *entries = [
            _mm512_castsi512_ps(first),
            _mm512_castsi512_ps(second),
            _mm512_castsi512_ps(third),
        ];
    }
    entries
}

/// Two windows of 64 bytes in which sixteen lanes' words lie, around the first lane's word and
/// around that of the first lane outside of that window.
struct Windows {
    words: [I; 2],
    /// Of the lanes' bytes in both windows.
    offsets: I,
}

impl Windows {
    /// If scalars of so many bytes, aligned to so many, all lie in such windows.
    ///
    /// # Safety
    /// The machine has AVX-512, and `readable` bytes are readable at `base`.
    #[inline(always)]
    unsafe fn new(
        base: *const u8,
        places: &Row,
        readable: u64,
        [size, alignment]: [u32; 2],
    ) -> Option<Windows> {
        const BYTES: u32 = 64;
        // The first lane's word is in the middle.
        let before = BYTES / 2 - 4;
        // SAFETY: the caller guarantees that the machine has AVX-512; windows that are not entirely
        // readable, or begin before the base, are not loaded.
        unsafe {
            let lanes = _mm512_loadu_si512(places.as_ptr().cast());
            let last = _mm512_set1_epi32((BYTES - size) as i32);
            let first = places[0].wrapping_sub(before);
            let in_first = _mm512_sub_epi32(lanes, _mm512_set1_epi32(first as i32));
            let outside = _mm512_cmpgt_epu32_mask(in_first, last);
            let second = places[outside.trailing_zeros() as usize & 15].wrapping_sub(before);
            let in_second = _mm512_sub_epi32(lanes, _mm512_set1_epi32(second as i32));
            let beyond = _mm512_mask_cmpgt_epu32_mask(outside, in_second, last);
            let behind = _mm512_set1_epi32(BYTES as i32);
            let offsets = _mm512_mask_add_epi32(in_first, outside, in_second, behind);
            let low = _mm512_set1_epi32(alignment as i32 - 1);
            let is_readable = u64::from(first.max(second)) + u64::from(BYTES) <= readable;
            if beyond | _mm512_test_epi32_mask(offsets, low) != 0 || !is_readable {
                return None;
            }
            Some(Windows {
                words: [
                    _mm512_loadu_si512(base.add(first as usize).cast()),
                    _mm512_loadu_si512(base.add(second as usize).cast()),
                ],
                offsets,
            })
        }
    }

    /// The lanes' words, or those so many behind them.
    ///
    /// # Safety
    /// The machine has AVX-512.
    #[inline(always)]
    unsafe fn words(&self, behind: i32) -> I {
        // SAFETY: the caller guarantees that the machine has AVX-512.
        unsafe {
            let index = _mm512_srli_epi32::<2>(self.offsets);
            let index = _mm512_add_epi32(index, _mm512_set1_epi32(behind));
            _mm512_permutex2var_epi32(self.words[0], index, self.words[1])
        }
    }
}

/// Whether gathers of pairs take longer than loads one by one. They do on AMD's processors, and on
/// Intel's with a microcode that keeps gathers from leaking data; so both are timed once. The
/// results are the same. Only code that is compiled for AVX-512 asks.
#[inline]
fn gathers_slowly() -> bool {
    static SLOWLY: OnceLock<bool> = OnceLock::new();
    *SLOWLY.get_or_init(pairs_are_loaded_faster)
}

/// Times gathers and loads of pairs: the least of many rounds, since the first ones are slow in
/// wide registers, and some are interrupted.
#[inline(never)]
fn pairs_are_loaded_faster() -> bool {
    const ROUNDS: usize = 100;
    let words = [0u32; 64];
    let rows = [const {
        Line([
            0, 12, 24, 36, 4, 16, 28, 40, 60, 72, 84, 96, 64, 76, 88, 100,
        ])
    }; 16];
    // SAFETY: only machines that have AVX-512 come here.
    let mut pairs = [unsafe { (_mm512_setzero_si512(), _mm512_setzero_si512()) }; 16];
    let mut least = [Duration::MAX; 2];
    for round in 0..2 * ROUNDS {
        let start = Instant::now();
        for _ in 0..4 {
            let base = black_box(&words).as_ptr().cast();
            // SAFETY: as above; eight bytes are readable at each offset, of 256.
            unsafe {
                match round % 2 {
                    0 => pairs_of::<true>(base, &rows, &mut pairs),
                    _ => pairs_of::<false>(base, &rows, &mut pairs),
                }
            }
            black_box(&mut pairs);
        }
        least[round % 2] = least[round % 2].min(start.elapsed());
    }
    least[0] > least[1]
}

/// Pairs at sixteen rows of offsets, gathered or loaded one by one.
///
/// # Safety
/// The machine has AVX-512, and eight bytes are readable at each offset.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,f16c")]
unsafe fn pairs_of<const GATHERS: bool>(
    base: *const u8,
    rows: &[Line; 16],
    pairs: &mut [(I, I); 16],
) {
    for (Line(places), pairs) in rows.iter().zip(pairs) {
        // SAFETY: the caller guarantees that the machine has AVX-512, and eight bytes are readable
        // at each offset.
        *pairs = unsafe {
            match GATHERS {
                true => gathered_pairs(base, _mm512_loadu_si512(places.as_ptr().cast())),
                false => loaded_pairs(base, places),
            }
        };
    }
}

/// Two words at each offset, loaded one by one.
///
/// # Safety
/// Eight bytes are readable at each offset.
#[inline(always)]
unsafe fn loaded_pairs(base: *const u8, places: &Row) -> (I, I) {
    // SAFETY: the token proves the features; the caller guarantees that eight bytes are readable at
    // each offset.
    unsafe {
        let (first, second) = (four_pairs(base, places, 0), four_pairs(base, places, 2));
        let (first, second) = (_mm512_castsi512_ps(first), _mm512_castsi512_ps(second));
        (
            _mm512_castps_si512(_mm512_shuffle_ps::<0x88>(first, second)),
            _mm512_castps_si512(_mm512_shuffle_ps::<0xdd>(first, second)),
        )
    }
}

/// Two words at each offset, gathered.
///
/// # Safety
/// The machine has AVX-512, and eight bytes are readable at each offset.
#[inline(always)]
unsafe fn gathered_pairs(base: *const u8, offsets: I) -> (I, I) {
    // SAFETY: the caller guarantees that the machine has AVX-512, and eight bytes are readable at
    // each offset.
    unsafe {
        let low = _mm512_castsi512_si256(offsets);
        let high = _mm512_extracti64x4_epi64::<1>(offsets);
        let low = _mm512_i32gather_epi64::<1>(low, base.cast());
        let high = _mm512_i32gather_epi64::<1>(high, base.cast());
        let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        let odd = _mm512_add_epi32(even, _mm512_set1_epi32(1));
        (
            _mm512_permutex2var_epi32(low, even, high),
            _mm512_permutex2var_epi32(low, odd, high),
        )
    }
}

/// Eight bytes each at the places of `lane` and the one behind it, and of every fourth pair of
/// lanes after these.
///
/// # Safety
/// The machine has AVX-512, and eight bytes are readable at each place.
#[inline(always)]
unsafe fn four_pairs(base: *const u8, places: &Row, lane: usize) -> I {
    // SAFETY: the caller guarantees that the machine has AVX-512, and eight bytes are readable at
    // each place.
    unsafe {
        let load = |lane: usize| _mm_loadl_epi64(base.add(places[lane] as usize).cast());
        let pair = |lane: usize| _mm_unpacklo_epi64(load(lane), load(lane + 1));
        let low = _mm256_set_m128i(pair(lane + 4), pair(lane));
        let high = _mm256_set_m128i(pair(lane + 12), pair(lane + 8));
        _mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high)
    }
}

/// Sixteen bytes each at the places of `lane` and of every fourth one behind it.
///
/// # Safety
/// The machine has AVX-512, and sixteen bytes are readable at each place.
#[inline(always)]
unsafe fn every_fourth(base: *const u8, places: &Row, lane: usize) -> I {
    // SAFETY: the caller guarantees that the machine has AVX-512, and sixteen bytes are readable at
    // each place.
    unsafe {
        let first = _mm_loadu_si128(base.add(places[lane] as usize).cast());
        let second = _mm_loadu_si128(base.add(places[lane + 4] as usize).cast());
        let third = _mm_loadu_si128(base.add(places[lane + 8] as usize).cast());
        let fourth = _mm_loadu_si128(base.add(places[lane + 12] as usize).cast());
        let low = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(first), second);
        let high = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(third), fourth);
        _mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high)
    }
}

/// The halves of a register.
///
/// # Safety
/// The machine has AVX-512.
#[inline(always)]
unsafe fn halves(a: F) -> [__m256; 2] {
    // SAFETY: the caller guarantees that the machine has AVX-512.
    unsafe { [_mm512_castps512_ps256(a), _mm512_extractf32x8_ps::<1>(a)] }
}

/// A register of two halves.
///
/// # Safety
/// The machine has AVX-512.
#[inline(always)]
unsafe fn whole([low, high]: [__m256; 2]) -> F {
    // SAFETY: the caller guarantees that the machine has AVX-512.
    unsafe { _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high) }
}

/// The quarters of a register.
///
/// # Safety
/// The machine has AVX-512.
#[inline(always)]
unsafe fn parts(a: I) -> [__m128i; 4] {
    // SAFETY: the caller guarantees that the machine has AVX-512.
    unsafe {
        [
            _mm512_castsi512_si128(a),
            _mm512_extracti32x4_epi32::<1>(a),
            _mm512_extracti32x4_epi32::<2>(a),
            _mm512_extracti32x4_epi32::<3>(a),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the two ways a machine takes one; both read the words that are there.
    #[test]
    fn pairs_are_the_same_loaded_and_gathered() {
        if !Tier::available().contains(&Tier::Avx512) {
            return;
        }
        let mut random = fastrand::Rng::with_seed(5);
        let bytes: Vec<u8> = (0..1024).map(|_| random.u8(..)).collect();
        for _ in 0..200 {
            let places: Row = std::array::from_fn(|_| random.u32(..bytes.len() as u32 - 8));
            let mut found = [[[0; 16]; 2]; 2];
            // SAFETY: the machine has AVX-512, and eight bytes are readable at each place.
            unsafe {
                let v = Avx512::new();
                let (base, offsets) = (bytes.as_ptr(), v.load_i(&places));
                let ways = [loaded_pairs(base, &places), gathered_pairs(base, offsets)];
                for (rows, (first, second)) in found.iter_mut().zip(ways) {
                    v.store_i(first, &mut rows[0]);
                    v.store_i(second, &mut rows[1]);
                }
            }
            let word = |at: u32, k: usize| {
                let at = at as usize + 4 * k;
                u32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap())
            };
            let wanted = [0, 1].map(|k| places.map(|at| word(at, k)));
            assert_eq!(found, [wanted; 2]);
        }
    }
}
