//! AVX2, FMA and F16C: two registers for sixteen lanes.

use std::arch::x86_64::*;

use super::neighbours::blend_neighbours;
use super::quads::{half_of_pairs, put_quads, put_quads_of_shorts, quad_at, quads_of_shorts};
use super::{Line, Task, Vector};
use crate::{Row, Tier, quad};

/// AVX2, FMA and F16C.
#[derive(Clone, Copy)]
pub struct Avx2(());

type F = [__m256; 2];
type I = [__m256i; 2];

/// Functions of one or two operands that are one expression of intrinsics on each half.
macro_rules! halves {
    ($(fn $name:ident($a:ident: $at:ty $(, $b:ident: $bt:ty)?) -> $result:ty = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name(self, $a: $at $(, $b: $bt)?) -> $result {
            // SAFETY: the token says that the machine has the instructions.
            unsafe {
                [
                    { let $a = $a[0]; $(let $b = $b[0];)? $body },
                    { let $a = $a[1]; $(let $b = $b[1];)? $body },
                ]
            }
        }
    )*};
}

impl Vector for Avx2 {
    type F = F;
    type I = I;

    const TIER: Tier = Tier::Avx2;
    const BLENDS_NEIGHBOURS: bool = true;

    #[inline(always)]
    unsafe fn new() -> Self {
        Avx2(())
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F {
        // SAFETY: the token.
        [unsafe { _mm256_set1_ps(x) }; 2]
    }
    #[inline(always)]
    fn splat_i(self, x: i32) -> I {
        // SAFETY: the token.
        [unsafe { _mm256_set1_epi32(x) }; 2]
    }
    #[inline(always)]
    fn load(self, row: &Row) -> F {
        let at = row.as_ptr();
        // SAFETY: the token; a row is two registers long.
        unsafe {
            [
                _mm256_loadu_ps(at.cast()),
                _mm256_loadu_ps(at.add(8).cast()),
            ]
        }
    }
    #[inline(always)]
    fn store(self, [a, b]: F, row: &mut Row) {
        let at = row.as_mut_ptr();
        // SAFETY: the token; a row is two registers long.
        unsafe {
            _mm256_storeu_ps(at.cast(), a);
            _mm256_storeu_ps(at.add(8).cast(), b);
        }
    }
    #[inline(always)]
    fn load_i(self, row: &Row) -> I {
        self.bits_of(self.load(row))
    }
    #[inline(always)]
    fn store_i(self, a: I, row: &mut Row) {
        self.store(self.bits_to_f(a), row);
    }

    halves! {
        fn bits_to_f(a: I) -> F = _mm256_castsi256_ps(a);
        fn bits_of(a: F) -> I = _mm256_castps_si256(a);
        fn add(a: F, b: F) -> F = _mm256_add_ps(a, b);
        fn sub(a: F, b: F) -> F = _mm256_sub_ps(a, b);
        fn mul(a: F, b: F) -> F = _mm256_mul_ps(a, b);
        fn div(a: F, b: F) -> F = _mm256_div_ps(a, b);
        fn sqrt(a: F) -> F = _mm256_sqrt_ps(a);
        fn floor(a: F) -> F = _mm256_floor_ps(a);
        fn ceil(a: F) -> F = _mm256_ceil_ps(a);
        fn round_ties_even(a: F) -> F =
            _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(a);
        fn min(a: F, b: F) -> F = _mm256_min_ps(a, b);
        fn max(a: F, b: F) -> F = _mm256_max_ps(a, b);
        fn to_i(a: F) -> I = _mm256_cvttps_epi32(a);
        fn to_f(a: I) -> F = _mm256_cvtepi32_ps(a);
        fn to_half(a: F) -> I = _mm256_cvtepu16_epi32(
            _mm256_cvtps_ph::<_MM_FROUND_TO_NEAREST_INT>(a)
        );
        fn add_i(a: I, b: I) -> I = _mm256_add_epi32(a, b);
        fn sub_i(a: I, b: I) -> I = _mm256_sub_epi32(a, b);
        fn mul_i(a: I, b: I) -> I = _mm256_mullo_epi32(a, b);
        fn and_i(a: I, b: I) -> I = _mm256_and_si256(a, b);
        fn or_i(a: I, b: I) -> I = _mm256_or_si256(a, b);
        fn xor_i(a: I, b: I) -> I = _mm256_xor_si256(a, b);
        fn min_u(a: I, b: I) -> I = _mm256_min_epu32(a, b);
        fn min_i(a: I, b: I) -> I = _mm256_min_epi32(a, b);
        fn max_i(a: I, b: I) -> I = _mm256_max_epi32(a, b);
        fn sign_i(a: I) -> I = _mm256_srai_epi32::<31>(a);
    }

    #[inline(always)]
    fn quiet_half_to_f(self, [a, b]: I) -> F {
        // SAFETY: the token.
        unsafe {
            let halves = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packus_epi32(a, b));
            [
                _mm256_cvtph_ps(_mm256_castsi256_si128(halves)),
                _mm256_cvtph_ps(_mm256_extracti128_si256::<1>(halves)),
            ]
        }
    }
    #[inline(always)]
    fn add_exact_product(self, sum: F, a: F, b: F) -> F {
        // SAFETY: the token.
        unsafe {
            [
                _mm256_fmadd_ps(a[0], b[0], sum[0]),
                _mm256_fmadd_ps(a[1], b[1], sum[1]),
            ]
        }
    }
    #[inline(always)]
    fn div_units(self, a: F, divisor: f32) -> F {
        let (d, r) = (self.splat(divisor), self.splat(1.0 / divisor));
        let q = self.mul(a, r);
        // SAFETY: the token.
        unsafe {
            let rest = [
                _mm256_fnmadd_ps(q[0], d[0], a[0]),
                _mm256_fnmadd_ps(q[1], d[1], a[1]),
            ];
            [
                _mm256_fmadd_ps(rest[0], r[0], q[0]),
                _mm256_fmadd_ps(rest[1], r[1], q[1]),
            ]
        }
    }
    #[inline(always)]
    fn scaled(self, a: F, scale: f32) -> I {
        let (s, r) = (self.splat(scale), self.splat(super::ROUNDER));
        // SAFETY: the token.
        let sums = unsafe {
            [
                _mm256_fmadd_ps(a[0], s[0], r[0]),
                _mm256_fmadd_ps(a[1], s[1], r[1]),
            ]
        };
        self.sub_i(self.bits_of(sums), self.bits_of(r))
    }
    #[inline(always)]
    fn left_i(self, [a, b]: I, bits: u32) -> I {
        // SAFETY: the token.
        unsafe {
            let count = _mm256_set1_epi32(bits as i32);
            [_mm256_sllv_epi32(a, count), _mm256_sllv_epi32(b, count)]
        }
    }
    #[inline(always)]
    fn right_u(self, [a, b]: I, bits: u32) -> I {
        // SAFETY: the token.
        unsafe {
            let count = _mm256_set1_epi32(bits as i32);
            [_mm256_srlv_epi32(a, count), _mm256_srlv_epi32(b, count)]
        }
    }
    #[inline(always)]
    fn right_i(self, [a, b]: I, bits: u32) -> I {
        // SAFETY: the token.
        unsafe {
            let count = _mm256_set1_epi32(bits as i32);
            [_mm256_srav_epi32(a, count), _mm256_srav_epi32(b, count)]
        }
    }
    #[inline(always)]
    fn left_each(self, a: I, bits: I) -> I {
        // SAFETY: the token.
        unsafe {
            [
                _mm256_sllv_epi32(a[0], bits[0]),
                _mm256_sllv_epi32(a[1], bits[1]),
            ]
        }
    }
    #[inline(always)]
    fn right_each(self, a: I, bits: I) -> I {
        // SAFETY: the token.
        unsafe {
            [
                _mm256_srlv_epi32(a[0], bits[0]),
                _mm256_srlv_epi32(a[1], bits[1]),
            ]
        }
    }
    #[inline(always)]
    fn table(self, table: &[f32; 16], [a, b]: I) -> F {
        // SAFETY: the token; the table is two registers long.
        unsafe {
            let low = _mm256_loadu_ps(table.as_ptr());
            let high = _mm256_loadu_ps(table.as_ptr().add(8));
            [eight_entries(low, high, a), eight_entries(low, high, b)]
        }
    }
    #[inline(always)]
    fn quotient(self, a: F, _: F, high: F, low: F) -> F {
        let rest = self.mul(a, low);
        // SAFETY: the token.
        unsafe {
            [
                _mm256_fmadd_ps(a[0], high[0], rest[0]),
                _mm256_fmadd_ps(a[1], high[1], rest[1]),
            ]
        }
    }
    #[inline(always)]
    fn keep(self, a: I, mask: u16) -> I {
        // SAFETY: the token.
        unsafe {
            let lanes = lanes(mask);
            self.and_i(a, lanes)
        }
    }
    #[inline(always)]
    fn lt_u(self, a: I, b: I) -> u16 {
        // Less, if the greater of both is another one.
        // SAFETY: the token.
        let greater = unsafe { [_mm256_max_epu32(a[0], b[0]), _mm256_max_epu32(a[1], b[1])] };
        self.ne_i(greater, a)
    }
    #[inline(always)]
    fn byte(self, [a, b]: I, index: u32) -> I {
        // SAFETY: the token.
        unsafe {
            // Of each word the one byte, and zeros.
            let word = _mm_setr_epi32(0, 4, 8, 12);
            let pick = _mm256_broadcastsi128_si256(_mm_or_si128(
                _mm_add_epi32(word, _mm_set1_epi32(index as i32)),
                _mm_set1_epi32(0x8080_8000u32 as i32),
            ));
            [_mm256_shuffle_epi8(a, pick), _mm256_shuffle_epi8(b, pick)]
        }
    }
    #[inline(always)]
    fn ne_i(self, a: I, b: I) -> u16 {
        // SAFETY: the token.
        let (low, high) = unsafe {
            let low = _mm256_castsi256_ps(_mm256_cmpeq_epi32(a[0], b[0]));
            let high = _mm256_castsi256_ps(_mm256_cmpeq_epi32(a[1], b[1]));
            (_mm256_movemask_ps(low), _mm256_movemask_ps(high))
        };
        !(low | high << 8) as u16
    }
    #[inline(always)]
    fn gt(self, a: F, b: F) -> u16 {
        // SAFETY: the token.
        let (low, high) = unsafe {
            let low = _mm256_cmp_ps::<_CMP_GT_OQ>(a[0], b[0]);
            let high = _mm256_cmp_ps::<_CMP_GT_OQ>(a[1], b[1]);
            (_mm256_movemask_ps(low), _mm256_movemask_ps(high))
        };
        (low | high << 8) as u16
    }
    #[inline(always)]
    fn at_least(self, a: F, b: F) -> I {
        // SAFETY: the token.
        unsafe {
            [
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_GE_OQ>(a[0], b[0])),
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_GE_OQ>(a[1], b[1])),
            ]
        }
    }
    #[inline(always)]
    fn ge(self, a: F, b: F) -> u16 {
        // SAFETY: the token.
        let (low, high) = unsafe {
            let low = _mm256_cmp_ps::<_CMP_GE_OQ>(a[0], b[0]);
            let high = _mm256_cmp_ps::<_CMP_GE_OQ>(a[1], b[1]);
            (_mm256_movemask_ps(low), _mm256_movemask_ps(high))
        };
        (low | high << 8) as u16
    }
    #[inline(always)]
    fn eq(self, a: F, b: F) -> u16 {
        // SAFETY: the token.
        let (low, high) = unsafe {
            let low = _mm256_cmp_ps::<_CMP_EQ_OQ>(a[0], b[0]);
            let high = _mm256_cmp_ps::<_CMP_EQ_OQ>(a[1], b[1]);
            (_mm256_movemask_ps(low), _mm256_movemask_ps(high))
        };
        (low | high << 8) as u16
    }
    #[inline(always)]
    fn select(self, mask: u16, a: I, b: I) -> I {
        // SAFETY: the token.
        unsafe {
            let lanes = lanes(mask);
            [
                _mm256_blendv_epi8(b[0], a[0], lanes[0]),
                _mm256_blendv_epi8(b[1], a[1], lanes[1]),
            ]
        }
    }
    #[inline(always)]
    fn quads(self, words: &[u32; 4]) -> I {
        // SAFETY: the token; four words are as long as half a register.
        unsafe {
            let words = _mm256_broadcastsi128_si256(_mm_loadu_si128(words.as_ptr().cast()));
            [
                _mm256_permutevar8x32_epi32(words, _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1)),
                _mm256_permutevar8x32_epi32(words, _mm256_setr_epi32(2, 2, 2, 2, 3, 3, 3, 3)),
            ]
        }
    }

    #[inline(always)]
    fn sides<const AXIS: usize>(self, [a, b]: F) -> (F, F) {
        // SAFETY: the token.
        unsafe {
            match AXIS {
                quad::X => (
                    [
                        _mm256_permute_ps::<0b10_10_00_00>(a),
                        _mm256_permute_ps::<0b10_10_00_00>(b),
                    ],
                    [
                        _mm256_permute_ps::<0b11_11_01_01>(a),
                        _mm256_permute_ps::<0b11_11_01_01>(b),
                    ],
                ),
                _ => (
                    [
                        _mm256_permute_ps::<0b01_00_01_00>(a),
                        _mm256_permute_ps::<0b01_00_01_00>(b),
                    ],
                    [
                        _mm256_permute_ps::<0b11_10_11_10>(a),
                        _mm256_permute_ps::<0b11_10_11_10>(b),
                    ],
                ),
            }
        }
    }

    #[inline(always)]
    unsafe fn load_quads(self, at: *const u8, stride_bytes: usize) -> I {
        // SAFETY: the token proves the features; the caller guarantees that sixteen bytes are
        // readable at `at` and 1 to 3 strides behind it.
        unsafe {
            let (second, third) = (at.add(stride_bytes), at.add(2 * stride_bytes));
            let fourth = at.add(3 * stride_bytes);
            let upper = _mm256_loadu2_m128i(second.cast(), at.cast());
            let lower = _mm256_loadu2_m128i(fourth.cast(), third.cast());
            [
                _mm256_permute4x64_epi64::<0b11_01_10_00>(upper),
                _mm256_permute4x64_epi64::<0b11_01_10_00>(lower),
            ]
        }
    }
    #[inline(always)]
    unsafe fn store_quads(self, [upper, lower]: I, at: *mut u8, stride_bytes: usize) {
        // SAFETY: the token proves the features; the caller guarantees that sixteen bytes are
        // writable at `at` and 1 to 3 strides behind it.
        unsafe {
            let upper = _mm256_permute4x64_epi64::<0b11_01_10_00>(upper);
            let lower = _mm256_permute4x64_epi64::<0b11_01_10_00>(lower);
            let (second, third) = (at.add(stride_bytes), at.add(2 * stride_bytes));
            let fourth = at.add(3 * stride_bytes);
            _mm256_storeu2_m128i(second.cast(), at.cast(), upper);
            _mm256_storeu2_m128i(fourth.cast(), third.cast(), lower);
        }
    }
    #[inline(always)]
    unsafe fn load_quads_of_shorts(self, at: *const u8, stride_bytes: usize) -> I {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // readable at `at` and 1 to 3 strides behind it.
        unsafe {
            let [upper, lower] = quads_of_shorts(at, stride_bytes);
            [_mm256_cvtepu16_epi32(upper), _mm256_cvtepu16_epi32(lower)]
        }
    }
    #[inline(always)]
    unsafe fn store_quads_of_shorts(self, a: I, at: *mut u8, stride_bytes: usize) {
        for half in 0..2 {
            // SAFETY: the token proves the features; the caller guarantees that eight bytes are
            // writable at `at` and 1 to 3 strides behind it.
            unsafe {
                let words = _mm256_and_si256(a[half], _mm256_set1_epi32(0xffff));
                let (first, second) = (
                    _mm256_castsi256_si128(words),
                    _mm256_extracti128_si256::<1>(words),
                );
                let shorts = _mm_packus_epi32(first, second);
                put_quads_of_shorts(shorts, at.add(2 * half * stride_bytes), stride_bytes);
            }
        }
    }
    #[inline(always)]
    fn of_bytes(self, [low, high]: [u64; 2]) -> I {
        // SAFETY: the token.
        unsafe {
            [
                _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(low as i64)),
                _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(high as i64)),
            ]
        }
    }
    #[inline(always)]
    fn to_bytes(self, [a, b]: I) -> [u64; 2] {
        // SAFETY: the token.
        unsafe {
            let byte = _mm256_set1_epi32(0xff);
            let (a, b) = (_mm256_and_si256(a, byte), _mm256_and_si256(b, byte));
            // Within halves of a register: the middle ones change places.
            let shorts = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packus_epi32(a, b));
            let bytes = _mm_packus_epi16(
                _mm256_castsi256_si128(shorts),
                _mm256_extracti128_si256::<1>(shorts),
            );
            let (low, high) = (_mm_cvtsi128_si64(bytes), _mm_extract_epi64::<1>(bytes));
            [low as u64, high as u64]
        }
    }
    #[inline(always)]
    unsafe fn load_each_quad(self, at: [*const u8; 4], stride_bytes: usize) -> I {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // readable at each place and a stride behind it.
        unsafe {
            let [a, b, c, d] = [
                quad_at(at[0], stride_bytes),
                quad_at(at[1], stride_bytes),
                quad_at(at[2], stride_bytes),
                quad_at(at[3], stride_bytes),
            ];
            [_mm256_set_m128i(b, a), _mm256_set_m128i(d, c)]
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
            ([a0, a1], [b0, b1])
        }
    }
    #[inline(always)]
    unsafe fn store_quads_of_pairs(self, a: I, b: I, at: *mut u8, stride_bytes: usize) {
        for half in 0..2 {
            // SAFETY: the token proves the features; the caller guarantees that 32 bytes are
            // writable at `at` and 1 to 3 strides behind it.
            unsafe {
                let upper = at.add(2 * half * stride_bytes);
                let lower = upper.add(stride_bytes);
                let (a, b) = (a[half], b[half]);
                _mm256_storeu_si256(upper.cast(), _mm256_unpacklo_epi32(a, b));
                _mm256_storeu_si256(lower.cast(), _mm256_unpackhi_epi32(a, b));
            }
        }
    }
    #[inline(always)]
    unsafe fn gather(self, base: *const u8, [a, b]: I) -> I {
        // SAFETY: the token proves the features; the caller guarantees that four bytes are readable
        // at each.
        unsafe {
            [
                _mm256_i32gather_epi32::<1>(base.cast(), a),
                _mm256_i32gather_epi32::<1>(base.cast(), b),
            ]
        }
    }
    #[inline(always)]
    unsafe fn gather_scalars<T: Copy + Into<u32>>(self, base: *const u8, offsets: I) -> I {
        let places = &mut Line([0; 16]).0;
        self.store_i(offsets, places);
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.scalars_at::<T>(base, std::hint::black_box(&*places)) }
    }
    #[inline(always)]
    unsafe fn gather_pairs(self, base: *const u8, offsets: I) -> (I, I) {
        let places = &mut Line([0; 16]).0;
        self.store_i(offsets, places);
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.pairs_at(base, places) }
    }
    #[inline(always)]
    unsafe fn gather_quads(self, base: *const u8, offsets: I) -> [I; 4] {
        let places = &mut Line([0; 16]).0;
        self.store_i(offsets, places);
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.quads_at(base, places) }
    }
    #[inline(always)]
    unsafe fn words_at(self, base: *const u8, offsets: &Row) -> I {
        // Single loads: gathers take longer.
        // SAFETY: the caller keeps the contract of this function.
        unsafe { self.scalars_at::<u32>(base, offsets) }
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
            [
                _mm256_set_m128i(second, first),
                _mm256_set_m128i(fourth, third),
            ]
        }
    }
    #[inline(always)]
    unsafe fn pairs_at(self, base: *const u8, offsets: &Row) -> (I, I) {
        // SAFETY: the token proves the features; the caller guarantees that eight bytes are
        // readable at each.
        let (low, high) = unsafe { (eight_pairs(base, offsets, 0), eight_pairs(base, offsets, 8)) };
        ([low.0, high.0], [low.1, high.1])
    }
    #[inline(always)]
    unsafe fn quads_at(self, base: *const u8, offsets: &Row) -> [I; 4] {
        // SAFETY: the token proves the features; the caller guarantees that sixteen bytes are
        // readable at each.
        let (low, high) = unsafe { (eight_quads(base, offsets, 0), eight_quads(base, offsets, 8)) };
        [
            [low[0], high[0]],
            [low[1], high[1]],
            [low[2], high[2]],
            [low[3], high[3]],
        ]
    }

    #[inline(always)]
    unsafe fn blend_neighbours<const KIND: u8, const LINES: usize>(
        self,
        base: *const u8,
        offsets: [I; LINES],
        weights: [F; 3],
    ) -> [F; 4] {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { blend_neighbours::<KIND, LINES>(base, offsets, weights) }
    }

    #[inline(always)]
    unsafe fn apart<T: Task<Self>>(self, task: T) -> T::Output {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma,f16c")]
        unsafe fn run<T: Task<Avx2>>(v: Avx2, task: T) -> T::Output {
            // SAFETY: the caller guarantees that the task is as its type requires.
            unsafe { task.run(v) }
        }
        // SAFETY: the token says that the machine has the features; the caller keeps the contract
        // of `Task::run` of the task.
        unsafe { run(self, task) }
    }
}

/// [`Vector::table`] of eight lanes.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn eight_entries(low: __m256, high: __m256, index: __m256i) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe {
        let is_high = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index));
        let (low, high) = (
            _mm256_permutevar8x32_ps(low, index),
            _mm256_permutevar8x32_ps(high, index),
        );
        _mm256_blendv_ps(low, high, is_high)
    }
}

/// The quarters of sixteen words.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn parts([upper, lower]: I) -> [__m128i; 4] {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe {
        [
            _mm256_castsi256_si128(upper),
            _mm256_extracti128_si256::<1>(upper),
            _mm256_castsi256_si128(lower),
            _mm256_extracti128_si256::<1>(lower),
        ]
    }
}

/// Sixteen bytes each at eight places from `first` on: the first words, the second, and so on.
/// These are loads and shuffles, because machines whose gathers are slow take four times as long
/// for the sixteen gathers of four words.
///
/// # Safety
/// The machine has AVX2, and sixteen bytes are readable at each place.
#[inline(always)]
unsafe fn eight_quads(base: *const u8, places: &Row, first: usize) -> [__m256i; 4] {
    // SAFETY: the caller guarantees that the machine has AVX2, and sixteen bytes are readable at
    // each place.
    unsafe {
        let a = with_fourth(base, places, first);
        let b = with_fourth(base, places, first + 1);
        let c = with_fourth(base, places, first + 2);
        let d = with_fourth(base, places, first + 3);
        let low = (_mm256_unpacklo_epi32(a, b), _mm256_unpacklo_epi32(c, d));
        let high = (_mm256_unpackhi_epi32(a, b), _mm256_unpackhi_epi32(c, d));
        [
            _mm256_unpacklo_epi64(low.0, low.1),
            _mm256_unpackhi_epi64(low.0, low.1),
            _mm256_unpacklo_epi64(high.0, high.1),
            _mm256_unpackhi_epi64(high.0, high.1),
        ]
    }
}

/// Sixteen bytes each at the places of `lane` and of the fourth one behind it.
///
/// # Safety
/// As [`eight_quads`].
#[inline(always)]
unsafe fn with_fourth(base: *const u8, places: &Row, lane: usize) -> __m256i {
    // SAFETY: the caller guarantees that the machine has AVX2, and sixteen bytes are readable at
    // each place.
    unsafe {
        let first = _mm_loadu_si128(base.add(places[lane] as usize).cast());
        let second = _mm_loadu_si128(base.add(places[lane + 4] as usize).cast());
        _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(first), second)
    }
}

/// All ones in the lanes of a mask.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn lanes(mask: u16) -> I {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe {
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let low = _mm256_and_si256(_mm256_set1_epi32(mask as i32), bits);
        let high = _mm256_and_si256(_mm256_set1_epi32(mask as i32 >> 8), bits);
        [
            _mm256_cmpeq_epi32(low, bits),
            _mm256_cmpeq_epi32(high, bits),
        ]
    }
}

/// The scalars at the places of four lanes from `lane` on, as words.
///
/// # Safety
/// The machine has AVX2, and a scalar is readable at each place.
#[inline(always)]
pub(super) unsafe fn four_scalars<T: Copy + Into<u32>>(
    base: *const u8,
    places: &Row,
    lane: usize,
) -> __m128i {
    // SAFETY: the caller guarantees that the machine has AVX2, and that a scalar is readable at
    // each place.
    unsafe {
        let scalar = |lane: usize| {
            let at = base.add(places[lane] as usize).cast::<T>();
            at.read_unaligned().into() as i32
        };
        let zero = _mm_setzero_si128();
        // Insertions from memory: from general registers they take two operations.
        match size_of::<T>() {
            1 => {
                let words = _mm_insert_epi8::<0>(zero, scalar(lane));
                let words = _mm_insert_epi8::<4>(words, scalar(lane + 1));
                let words = _mm_insert_epi8::<8>(words, scalar(lane + 2));
                _mm_insert_epi8::<12>(words, scalar(lane + 3))
            }
            2 => {
                let words = _mm_insert_epi16::<0>(zero, scalar(lane));
                let words = _mm_insert_epi16::<2>(words, scalar(lane + 1));
                let words = _mm_insert_epi16::<4>(words, scalar(lane + 2));
                _mm_insert_epi16::<6>(words, scalar(lane + 3))
            }
            _ => four_words(base, places, lane),
        }
    }
}

/// The words at the places of four lanes from `lane` on. Interleaved: insertions would wait for one
/// another.
///
/// # Safety
/// Four bytes are readable at each place.
#[inline(always)]
unsafe fn four_words(base: *const u8, places: &Row, lane: usize) -> __m128i {
    // SAFETY: the caller guarantees that four bytes are readable at each place; every x86-64
    // processor has SSE2.
    unsafe {
        let load = |lane: usize| _mm_loadu_si32(base.add(places[lane] as usize));
        let low = _mm_unpacklo_epi32(load(lane), load(lane + 1));
        let high = _mm_unpacklo_epi32(load(lane + 2), load(lane + 3));
        _mm_unpacklo_epi64(low, high)
    }
}

/// Eight bytes each at the places of eight lanes from `lane` on: their first and second words.
/// Loads one by one, as with AVX-512: gathers of pairs take longer.
///
/// # Safety
/// The machine has AVX2, and eight bytes are readable at each place.
#[inline(always)]
unsafe fn eight_pairs(base: *const u8, places: &Row, lane: usize) -> (__m256i, __m256i) {
    // SAFETY: the caller guarantees that the machine has AVX2, and eight bytes are readable at each
    // place.
    unsafe {
        let load = |lane: usize| _mm_loadl_epi64(base.add(places[lane] as usize).cast());
        let pair = |lane: usize| _mm_unpacklo_epi64(load(lane), load(lane + 1));
        let first = _mm256_castsi256_ps(_mm256_set_m128i(pair(lane + 4), pair(lane)));
        let second = _mm256_castsi256_ps(_mm256_set_m128i(pair(lane + 6), pair(lane + 2)));
        (
            _mm256_castps_si256(_mm256_shuffle_ps::<0x88>(first, second)),
            _mm256_castps_si256(_mm256_shuffle_ps::<0xdd>(first, second)),
        )
    }
}
