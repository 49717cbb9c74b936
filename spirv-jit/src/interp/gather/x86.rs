//! [`Gather`] in registers of SSE2, AVX2 and AVX-512.

mod neighbours;

use std::arch::x86_64::*;

use lanes::{LaneMask, Row};

use self::neighbours::{load_neighbours, store_neighbours};
use super::{Gather, Layout, RowPointers, load_singly, store_singly};
use crate::SUBGROUP_SIZE;
use crate::interp::kernels::Lane;
use crate::interp::tier::{Avx2, Avx512};

/// Lanes whose words are put together in a quarter of a row.
const TOGETHER: usize = 4;

/// Registers of one or more quarters of 128 bits, in each of which the functions do the same.
///
/// # Safety
/// Of all functions: the machine has the registers.
pub(super) trait Register: Copy {
    const QUARTERS: usize;
    /// Of the first [`Self::QUARTERS`].
    unsafe fn join(quarters: [__m128i; 4]) -> Self;
    /// The quarters, and zeros behind them.
    unsafe fn quarters(self) -> [__m128i; 4];
    unsafe fn load(from: *const u8) -> Self;
    unsafe fn splat(word: u32) -> Self;
    unsafe fn and(self, other: Self) -> Self;
    unsafe fn or(self, other: Self) -> Self;
    unsafe fn shift_left(self, bits: u32) -> Self;
    unsafe fn shift_right(self, bits: u32) -> Self;
    /// Interleaves the low words of two registers.
    unsafe fn low_words(self, other: Self) -> Self;
    unsafe fn high_words(self, other: Self) -> Self;
    /// The first 64 bits of one and of another.
    unsafe fn low_pair(self, other: Self) -> Self;
    unsafe fn high_pair(self, other: Self) -> Self;
    /// Words 0 and 2 of one and of another.
    unsafe fn even_words(self, other: Self) -> Self;
    unsafe fn odd_words(self, other: Self) -> Self;
    unsafe fn store(self, to: *mut u8);
}

macro_rules! register {
    (
        $register:ty, $quarters:literal,
        $join:item $quarters_of:item
        $load:ident $store:ident $splat:ident $shift_left:ident $shift_right:ident
        $($name:ident: $instruction:ident),*;
        $shuffle:ident $to_floats:ident $to_integers:ident
    ) => {
        impl Register for $register {
            const QUARTERS: usize = $quarters;
            #[inline(always)]
            $join
            #[inline(always)]
            $quarters_of
            #[inline(always)]
            unsafe fn load(from: *const u8) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $load(from.cast()) }
            }
            #[inline(always)]
            unsafe fn store(self, to: *mut u8) {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $store(to.cast(), self) }
            }
            #[inline(always)]
            unsafe fn splat(word: u32) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $splat(word as i32) }
            }
            #[inline(always)]
            unsafe fn shift_left(self, bits: u32) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $shift_left(self, _mm_cvtsi32_si128(bits as i32)) }
            }
            #[inline(always)]
            unsafe fn shift_right(self, bits: u32) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $shift_right(self, _mm_cvtsi32_si128(bits as i32)) }
            }
            $(
                #[inline(always)]
                unsafe fn $name(self, other: Self) -> Self {
                    // SAFETY: the caller keeps the contract of this function.
                    unsafe { $instruction(self, other) }
                }
            )*
            #[inline(always)]
            unsafe fn even_words(self, other: Self) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $to_integers($shuffle::<0x88>($to_floats(self), $to_floats(other))) }
            }
            #[inline(always)]
            unsafe fn odd_words(self, other: Self) -> Self {
                // SAFETY: the caller keeps the contract of this function.
                unsafe { $to_integers($shuffle::<0xdd>($to_floats(self), $to_floats(other))) }
            }
        }
    };
}

register! {
    __m128i, 1,
    unsafe fn join([quarter, ..]: [__m128i; 4]) -> Self {
        quarter
    }
    unsafe fn quarters(self) -> [__m128i; 4] {
        // SAFETY: every x86-64 processor has SSE2.
        let zero = unsafe { _mm_setzero_si128() };
        [self, zero, zero, zero]
    }
    _mm_loadu_si128 _mm_storeu_si128 _mm_set1_epi32 _mm_sll_epi32 _mm_srl_epi32
    and: _mm_and_si128, or: _mm_or_si128, low_words: _mm_unpacklo_epi32, high_words: _mm_unpackhi_epi32,
    low_pair: _mm_unpacklo_epi64, high_pair: _mm_unpackhi_epi64;
    _mm_shuffle_ps _mm_castsi128_ps _mm_castps_si128
}
register! {
    __m256i, 2,
    unsafe fn join([a, b, ..]: [__m128i; 4]) -> Self {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(a), b) }
    }
    unsafe fn quarters(self) -> [__m128i; 4] {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let (low, high) = (_mm256_castsi256_si128(self), _mm256_extracti128_si256::<1>(self));
            [low, high, _mm_setzero_si128(), _mm_setzero_si128()]
        }
    }
    _mm256_loadu_si256 _mm256_storeu_si256 _mm256_set1_epi32 _mm256_sll_epi32 _mm256_srl_epi32
    and: _mm256_and_si256, or: _mm256_or_si256, low_words: _mm256_unpacklo_epi32, high_words: _mm256_unpackhi_epi32,
    low_pair: _mm256_unpacklo_epi64, high_pair: _mm256_unpackhi_epi64;
    _mm256_shuffle_ps _mm256_castsi256_ps _mm256_castps_si256
}
register! {
    __m512i, 4,
    unsafe fn join([a, b, c, d]: [__m128i; 4]) -> Self {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let low = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(a), b);
            let high = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(c), d);
            _mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high)
        }
    }
    unsafe fn quarters(self) -> [__m128i; 4] {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            [
                _mm512_castsi512_si128(self),
                _mm512_extracti32x4_epi32::<1>(self),
                _mm512_extracti32x4_epi32::<2>(self),
                _mm512_extracti32x4_epi32::<3>(self),
            ]
        }
    }
    _mm512_loadu_si512 _mm512_storeu_si512 _mm512_set1_epi32 _mm512_sll_epi32 _mm512_srl_epi32
    and: _mm512_and_si512, or: _mm512_or_si512, low_words: _mm512_unpacklo_epi32, high_words: _mm512_unpackhi_epi32,
    low_pair: _mm512_unpacklo_epi64, high_pair: _mm512_unpackhi_epi64;
    _mm512_shuffle_ps _mm512_castsi512_ps _mm512_castps_si512
}

/// [`Gather::load_apart`] in registers of some width.
///
/// # Safety
/// As there.
#[inline(always)]
pub(super) unsafe fn load_apart<R: Register, T: Lane, const N: usize>(
    base: *const u8,
    offsets: &Row,
    rows: RowPointers<N>,
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match (size_of::<T>(), N) {
            (1 | 2 | 4, 1..=4) | (1, 16) | (2, 8) => {
                for quarter in (0..SUBGROUP_SIZE / TOGETHER).step_by(R::QUARTERS) {
                    load_quarters::<R, T, N>(base, offsets, rows, quarter);
                }
            }
            (8, 1 | 2) => {
                for pair in (0..SUBGROUP_SIZE / 2).step_by(R::QUARTERS) {
                    load_pairs::<R, N>(base, offsets, rows, pair);
                }
            }
            _ => load_singly::<T, N>(base, offsets, rows),
        }
    }
}

/// A register whose quarters are made by an expression of their numbers.
macro_rules! join {
    ($register:ty, $quarter:ident => $made:expr) => {{
        let mut quarters = [_mm_setzero_si128(); 4];
        for $quarter in 0..<$register>::QUARTERS {
            quarters[$quarter] = $made;
        }
        <$register>::join(quarters)
    }};
}

/// Scalars of at most 32 bits, of as many lanes as a register has words.
///
/// # Safety
/// As [`Gather::load_apart`].
#[inline(always)]
unsafe fn load_quarters<R: Register, T: Lane, const N: usize>(
    base: *const u8,
    offsets: &Row,
    rows: RowPointers<N>,
    first: usize,
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let size = size_of::<T>();
        let at =
            |quarter: usize, k: usize| base.add(offsets[TOGETHER * (first + quarter) + k] as usize);
        // Macros: in closures, which have no tier, its instructions would be calls.
        macro_rules! put {
            ($row:expr, $lanes:expr) => {
                R::store($lanes, rows[$row].add(16 * first))
            };
        }
        macro_rules! words {
            ($scalar:ty, $skip:expr) => {
                join!(R, q => {
                    let word = |k| at(q, k).add($skip).cast::<$scalar>().read_unaligned() as i32;
                    _mm_set_epi32(word(3), word(2), word(1), word(0))
                })
            };
        }
        // First and second words of 64 bits of each lane.
        macro_rules! pairs {
            () => {{
                let half = |q, k| _mm_loadl_epi64(at(q, k).cast());
                let low = join!(R, q => _mm_unpacklo_epi64(half(q, 0), half(q, 1)));
                let high = join!(R, q => _mm_unpacklo_epi64(half(q, 2), half(q, 3)));
                [low.even_words(high), low.odd_words(high)]
            }};
        }
        // The scalars in words, from some row on.
        macro_rules! split {
            ($row:expr, $count:expr, $words:expr) => {
                let words = $words;
                let bits = 8 * size as u32;
                let mask = R::splat(((1u64 << bits) - 1) as u32);
                for k in 0..$count {
                    put!($row + k, words.shift_right(k as u32 * bits).and(mask));
                }
            };
        }
        // Words 0 to 3 of each lane.
        macro_rules! fours {
            () => {{
                let whole = |q, k| _mm_loadu_si128(at(q, k).cast());
                let a = join!(R, q => whole(q, 0));
                let b = join!(R, q => whole(q, 1));
                let c = join!(R, q => whole(q, 2));
                let d = join!(R, q => whole(q, 3));
                let low = (a.low_words(b), c.low_words(d));
                let high = (a.high_words(b), c.high_words(d));
                [
                    low.0.low_pair(low.1),
                    low.0.high_pair(low.1),
                    high.0.low_pair(high.1),
                    high.0.high_pair(high.1),
                ]
            }};
        }
        match (size, N) {
            (1, 1) => put!(0, words!(u8, 0)),
            (2, 1) => put!(0, words!(u16, 0)),
            (4, 1) => put!(0, words!(u32, 0)),
            (1, 2) => {
                split!(0, 2, words!(u16, 0));
            }
            (1, 3) => {
                split!(0, 2, words!(u16, 0));
                put!(2, words!(u8, 2));
            }
            (1, 4) => {
                split!(0, 4, words!(u32, 0));
            }
            (2, 2) => {
                split!(0, 2, words!(u32, 0));
            }
            (2, 3) => {
                split!(0, 2, words!(u32, 0));
                put!(2, words!(u16, 4));
            }
            (2, 4) => {
                let [low, high] = pairs!();
                split!(0, 2, low);
                split!(2, 2, high);
            }
            (4, 2 | 3) => {
                let [low, high] = pairs!();
                put!(0, low);
                put!(1, high);
                if N == 3 {
                    put!(2, words!(u32, 8));
                }
            }
            (1, 16) | (2, 8) => {
                for (k, lanes) in fours!().into_iter().enumerate() {
                    split!(k * 4 / size, 4 / size, lanes);
                }
            }
            _ => {
                for (k, lanes) in fours!().into_iter().enumerate() {
                    put!(k, lanes);
                }
            }
        }
    }
}

/// One or two scalars of 64 bits, of half as many lanes as a register has words.
///
/// # Safety
/// As [`Gather::load_apart`].
#[inline(always)]
unsafe fn load_pairs<R: Register, const N: usize>(
    base: *const u8,
    offsets: &Row,
    rows: RowPointers<N>,
    first: usize,
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let at = |pair: usize, k: usize| base.add(offsets[2 * (first + pair) + k] as usize);
        macro_rules! put {
            ($row:expr, $lanes:expr) => {
                R::store($lanes, rows[$row].add(16 * first))
            };
        }
        if N == 1 {
            let scalar = |p, k| _mm_loadl_epi64(at(p, k).cast());
            put!(
                0,
                join!(R, p => _mm_unpacklo_epi64(scalar(p, 0), scalar(p, 1)))
            );
            return;
        }
        let whole = |p, k| _mm_loadu_si128(at(p, k).cast());
        let a = join!(R, p => whole(p, 0));
        let b = join!(R, p => whole(p, 1));
        put!(0, a.low_pair(b));
        put!(1, a.high_pair(b));
    }
}

/// [`Gather::store_apart`] in registers of some width.
///
/// # Safety
/// As there.
#[inline(always)]
pub(super) unsafe fn store_apart<R: Register, T: Lane, const N: usize>(
    base: *mut u8,
    offsets: &Row,
    rows: RowPointers<N>,
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match (size_of::<T>(), N) {
            (4, 2 | 4) | (2, 4 | 8) | (1, 16) => {
                for quarter in (0..SUBGROUP_SIZE / TOGETHER).step_by(R::QUARTERS) {
                    store_quarters::<R, T, N>(base, offsets, rows, quarter);
                }
            }
            _ => store_singly::<T, N>(base, offsets, rows, LaneMask::ALL),
        }
    }
}

/// Scalars that fill two or four words, of as many lanes as a register has words.
///
/// # Safety
/// As [`Gather::store_apart`].
#[inline(always)]
unsafe fn store_quarters<R: Register, T: Lane, const N: usize>(
    base: *mut u8,
    offsets: &Row,
    rows: RowPointers<N>,
    first: usize,
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let at =
            |quarter: usize, k: usize| base.add(offsets[TOGETHER * (first + quarter) + k] as usize);
        let size = size_of::<T>();
        // A word of each lane: the scalars of one or of several rows.
        macro_rules! word {
            ($word:expr) => {{
                let count = 4 / size;
                let row = $word * count;
                let mut word = R::load(rows[row].add(16 * first));
                if count > 1 {
                    let bits = 8 * size as u32;
                    let mask = R::splat((1u32 << bits).wrapping_sub(1));
                    word = word.and(mask);
                    for k in 1..count {
                        let scalar = R::load(rows[row + k].add(16 * first)).and(mask);
                        word = word.or(scalar.shift_left(k as u32 * bits));
                    }
                }
                word
            }};
        }
        if N * size == 8 {
            let (a, b) = (word!(0), word!(1));
            let (low, high) = (a.low_words(b).quarters(), a.high_words(b).quarters());
            for quarter in 0..R::QUARTERS {
                for (k, pairs) in [low, high].into_iter().enumerate() {
                    let (to, next) = (at(quarter, 2 * k), at(quarter, 2 * k + 1));
                    _mm_storel_epi64(to.cast(), pairs[quarter]);
                    _mm_storeh_pd(next.cast(), _mm_castsi128_pd(pairs[quarter]));
                }
            }
            return;
        }
        let (a, b, c, d) = (word!(0), word!(1), word!(2), word!(3));
        let low = (a.low_words(b), c.low_words(d));
        let high = (a.high_words(b), c.high_words(d));
        let lanes = [
            low.0.low_pair(low.1).quarters(),
            low.0.high_pair(low.1).quarters(),
            high.0.low_pair(high.1).quarters(),
            high.0.high_pair(high.1).quarters(),
        ];
        for quarter in 0..R::QUARTERS {
            for (k, lane) in lanes.into_iter().enumerate() {
                _mm_storeu_si128(at(quarter, k).cast(), lane[quarter]);
            }
        }
    }
}

/// How far each lane is behind the first in a run.
#[inline(always)]
fn steps(size_bytes: u32) -> Row {
    let mut steps = [0; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        steps[k] = k as u32 * size_bytes;
    }
    steps
}

/// The layout of offsets, by the lanes that have each.
#[inline(always)]
fn layout(offsets: &Row, inside: u16, same: u16, run: u16) -> Layout {
    match () {
        _ if inside != u16::MAX => Layout::Outside(LaneMask::from_bits(inside)),
        _ if same == u16::MAX => Layout::Same,
        // One that wraps is none.
        _ if run == u16::MAX && offsets[0] < offsets[SUBGROUP_SIZE - 1] => Layout::Run,
        _ => Layout::Apart,
    }
}

impl Gather for Avx512 {
    #[inline(always)]
    unsafe fn layout(offsets: &Row, last: u32, size_bytes: u32) -> Layout {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let lanes = _mm512_loadu_si512(offsets.as_ptr().cast());
            let first = _mm512_set1_epi32(offsets[0] as i32);
            let inside = _mm512_cmple_epu32_mask(lanes, _mm512_set1_epi32(last as i32));
            let steps = _mm512_loadu_si512(steps(size_bytes).as_ptr().cast());
            let same = _mm512_cmpeq_epi32_mask(lanes, first);
            let run = _mm512_cmpeq_epi32_mask(lanes, _mm512_add_epi32(first, steps));
            layout(offsets, inside, same, run)
        }
    }

    #[inline(always)]
    unsafe fn fill(offsets: &Row, active: LaneMask) -> Row {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let first = _mm512_set1_epi32(offsets[active.first()] as i32);
            let from = offsets.as_ptr().cast();
            let lanes = _mm512_mask_loadu_epi32(first, active.bits(), from);
            std::mem::transmute::<__m512i, Row>(lanes)
        }
    }

    #[inline(always)]
    unsafe fn distances(addresses: &[u64; SUBGROUP_SIZE], start: u64) -> Row {
        // SAFETY: the caller keeps the contract of this function; addresses are two registers long.
        unsafe {
            let start = _mm512_set1_epi64(start as i64);
            let mut near = [_mm256_setzero_si256(); 2];
            for k in 0..2 {
                let lanes = _mm512_loadu_si512(addresses.as_ptr().add(8 * k).cast());
                near[k] = _mm512_cvtusepi64_epi32(_mm512_sub_epi64(lanes, start));
            }
            std::mem::transmute::<[__m256i; 2], Row>(near)
        }
    }

    #[inline(always)]
    unsafe fn load_apart<T: Lane, const N: usize>(
        base: *const u8,
        offsets: &Row,
        rows: RowPointers<N>,
    ) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { load_apart::<__m512i, T, N>(base, offsets, rows) }
    }

    #[inline(always)]
    unsafe fn store_apart<T: Lane, const N: usize>(
        base: *mut u8,
        offsets: &Row,
        rows: RowPointers<N>,
    ) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { store_apart::<__m512i, T, N>(base, offsets, rows) }
    }

    #[inline(always)]
    unsafe fn load_neighbours<const N: usize>(at: *const u8, rows: RowPointers<N>) -> bool {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { load_neighbours::<__m512i, N>(at, rows) };
        true
    }

    #[inline(always)]
    unsafe fn store_neighbours<const N: usize>(at: *mut u8, rows: RowPointers<N>) -> bool {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { store_neighbours::<__m512i, N>(at, rows) };
        true
    }
}

/// A bit for each lane of two registers whose highest bit is set.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn bits([low, high]: [__m256i; 2]) -> u16 {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let low = _mm256_movemask_ps(_mm256_castsi256_ps(low));
        let high = _mm256_movemask_ps(_mm256_castsi256_ps(high));
        (low | high << 8) as u16
    }
}

/// All ones in active lanes, zeros in others.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn spread(active: LaneMask) -> [__m256i; 2] {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let lanes = _mm256_set1_epi32(active.bits() as i32);
        let low = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let high = _mm256_slli_epi32::<8>(low);
        [low, high].map(|bits| _mm256_cmpeq_epi32(_mm256_and_si256(lanes, bits), bits))
    }
}

impl Gather for Avx2 {
    #[inline(always)]
    unsafe fn layout(offsets: &Row, last: u32, size_bytes: u32) -> Layout {
        // SAFETY: the caller guarantees that the machine has AVX2; a row is two registers long.
        unsafe {
            let first = _mm256_set1_epi32(offsets[0] as i32);
            let last = _mm256_set1_epi32(last as i32);
            let steps = steps(size_bytes);
            let mut inside = [first; 2];
            let (mut same, mut run) = (inside, inside);
            for k in 0..2 {
                let lanes = _mm256_loadu_si256(offsets.as_ptr().add(8 * k).cast());
                let steps = _mm256_loadu_si256(steps.as_ptr().add(8 * k).cast());
                inside[k] = _mm256_cmpeq_epi32(_mm256_max_epu32(lanes, last), last);
                same[k] = _mm256_cmpeq_epi32(lanes, first);
                run[k] = _mm256_cmpeq_epi32(lanes, _mm256_add_epi32(first, steps));
            }
            layout(offsets, bits(inside), bits(same), bits(run))
        }
    }

    #[inline(always)]
    unsafe fn fill(offsets: &Row, active: LaneMask) -> Row {
        // SAFETY: the caller guarantees that the machine has AVX2; a row is two registers long.
        unsafe {
            let first = _mm256_set1_epi32(offsets[active.first()] as i32);
            let mut filled = spread(active);
            for (k, part) in filled.iter_mut().enumerate() {
                let lanes = _mm256_loadu_si256(offsets.as_ptr().add(8 * k).cast());
                *part = _mm256_blendv_epi8(first, lanes, *part);
            }
            std::mem::transmute::<[__m256i; 2], Row>(filled)
        }
    }

    #[inline(always)]
    unsafe fn distances(addresses: &[u64; SUBGROUP_SIZE], start: u64) -> Row {
        // SAFETY: the caller guarantees that the machine has AVX2; addresses are four registers
        // long.
        unsafe {
            let start = _mm256_set1_epi64x(start as i64);
            let zero = _mm256_setzero_si256();
            let mut near = [zero; 2];
            for k in 0..2 {
                let at = addresses.as_ptr().add(8 * k).cast::<__m256i>();
                let a = _mm256_sub_epi64(_mm256_loadu_si256(at), start);
                let b = _mm256_sub_epi64(_mm256_loadu_si256(at.add(1)), start);
                let is_near = _mm256_cmpeq_epi32(a.odd_words(b), zero);
                // All ones if the high word is not zero.
                let is_far = _mm256_xor_si256(is_near, _mm256_cmpeq_epi32(zero, zero));
                let words = _mm256_or_si256(a.even_words(b), is_far);
                // By quarters: the middle ones change places.
                near[k] = _mm256_permute4x64_epi64::<0b11_01_10_00>(words);
            }
            std::mem::transmute::<[__m256i; 2], Row>(near)
        }
    }

    #[inline(always)]
    unsafe fn load_apart<T: Lane, const N: usize>(
        base: *const u8,
        offsets: &Row,
        rows: RowPointers<N>,
    ) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { load_apart::<__m256i, T, N>(base, offsets, rows) }
    }

    #[inline(always)]
    unsafe fn store_apart<T: Lane, const N: usize>(
        base: *mut u8,
        offsets: &Row,
        rows: RowPointers<N>,
    ) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { store_apart::<__m256i, T, N>(base, offsets, rows) }
    }

    #[inline(always)]
    unsafe fn load_neighbours<const N: usize>(at: *const u8, rows: RowPointers<N>) -> bool {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { load_neighbours::<__m256i, N>(at, rows) };
        true
    }

    #[inline(always)]
    unsafe fn store_neighbours<const N: usize>(at: *mut u8, rows: RowPointers<N>) -> bool {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { store_neighbours::<__m256i, N>(at, rows) };
        true
    }
}
