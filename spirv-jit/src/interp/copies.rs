//! Loads of scalars for a whole subgroup.
//!
//! Every lane is active, and what it loads is inside. Lanes whose scalars lie one behind another are copied as one run; else four lanes
//! at a time are put together in registers, so that whoever reads the rows next need not wait for sixteen single stores.

use super::kernels::Lane;
use crate::SUBGROUP_SIZE;

/// Lanes that are loaded together.
pub(super) const TOGETHER: usize = 4;

/// Where scalars go: rows of lanes of 32 bits, for scalars of 64 bits of 64 bits.
pub(super) type Rows<const N: usize> = [*mut u8; N];

/// Whether any of the words has a bit set.
#[inline(always)]
fn is_any_set(mut words: [u32; SUBGROUP_SIZE]) -> bool {
    for step in [8, 4, 2, 1] {
        for k in 0..step {
            words[k] |= words[k + step];
        }
    }
    words[0] != 0
}

/// Whether all lanes have this offset.
#[inline(always)]
pub(super) fn are_same(offsets: &[u32; SUBGROUP_SIZE], first: u32) -> bool {
    // Mostly those that differ do so at the ends.
    offsets[SUBGROUP_SIZE - 1] == first && !is_any_set(offsets.map(|offset| offset ^ first))
}

/// Whether each lane's scalars lie behind those of the lane before, in `size_bytes` each; the last lane's end is inside what is 32 bits long.
#[inline(always)]
pub(super) fn are_consecutive(offsets: &[u32; SUBGROUP_SIZE], size_bytes: u32) -> bool {
    let (first, last) = (offsets[0], offsets[SUBGROUP_SIZE - 1]);
    let length = (SUBGROUP_SIZE as u32 - 1) * size_bytes;
    let mut apart = [0; SUBGROUP_SIZE];
    for k in 0..SUBGROUP_SIZE {
        apart[k] = offsets[k] ^ first.wrapping_add(k as u32 * size_bytes);
    }
    last.wrapping_sub(first) == length && first < last && !is_any_set(apart)
}

/// The highest offset.
#[inline(always)]
pub(super) fn highest(offsets: &[u32; SUBGROUP_SIZE]) -> u32 {
    let mut rest = *offsets;
    for step in [8, 4, 2, 1] {
        for k in 0..step {
            rest[k] = rest[k].max(rest[k + step]);
        }
    }
    rest[0]
}

/// Loads `N` scalars for each lane, one lane's behind another's.
///
/// # Safety
/// There are as many scalars at the address; the rows are a frame's.
#[inline(always)]
pub(super) unsafe fn load_run<T: Lane, const N: usize>(at: *const u8, rows: Rows<N>) {
    // SAFETY: as the caller promises.
    unsafe {
        match (size_of::<T>(), N) {
            (_, 1) => {
                let from = at.cast::<[T; SUBGROUP_SIZE]>().read_unaligned();
                *rows[0].cast::<[T::Slot; SUBGROUP_SIZE]>() = from.map(T::write);
            }
            (2, 2) | (1, 4) => {
                let from = at.cast::<[u32; SUBGROUP_SIZE]>().read_unaligned();
                let bits = 8 * size_of::<T>() as u32;
                for (k, row) in rows.into_iter().enumerate() {
                    let scalar = from.map(|word| word >> (k as u32 * bits) & ((1 << bits) - 1));
                    *row.cast::<[u32; SUBGROUP_SIZE]>() = scalar;
                }
            }
            _ => {
                let size = N * size_of::<T>();
                for lane in (0..SUBGROUP_SIZE).step_by(TOGETHER) {
                    let places = std::array::from_fn(|k| at.add((lane + k) * size));
                    load_together::<T, N>(places, rows, lane);
                }
            }
        }
    }
}

/// Loads `N` scalars for each of the lanes from `lane` on, from one place each.
///
/// # Safety
/// There are as many scalars at each place; the rows are a frame's.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) unsafe fn load_together<T: Lane, const N: usize>(
    places: [*const u8; TOGETHER],
    rows: Rows<N>,
    lane: usize,
) {
    use std::arch::x86_64::*;

    /// Words of four lanes.
    #[inline(always)]
    fn words(of: [u32; TOGETHER]) -> __m128i {
        let [a, b, c, d] = of.map(u32::cast_signed);
        // SAFETY: every x86-64 processor has SSE2.
        unsafe { _mm_set_epi32(d, c, b, a) }
    }
    // SAFETY: as the caller promises; every x86-64 processor has SSE2.
    unsafe {
        let put = |row: usize, lanes: __m128i| {
            let slots = size_of::<T::Slot>();
            _mm_storeu_si128(rows[row].add(lane * slots).cast(), lanes);
        };
        let halves = |k: usize| _mm_loadl_epi64(places[k].cast());
        // First and second words of 64 bits of each lane.
        let pairs = || {
            let low = _mm_castsi128_ps(_mm_unpacklo_epi64(halves(0), halves(1)));
            let high = _mm_castsi128_ps(_mm_unpacklo_epi64(halves(2), halves(3)));
            [
                _mm_castps_si128(_mm_shuffle_ps::<0x88>(low, high)),
                _mm_castps_si128(_mm_shuffle_ps::<0xdd>(low, high)),
            ]
        };
        // The scalars in words, from some row on.
        let split = |first: usize, count: usize, word: __m128i| {
            let bits = 8 * size_of::<T>() as i32;
            let mask = _mm_set1_epi32(((1u64 << bits) - 1) as i32);
            for k in 0..count {
                let shifted = _mm_srl_epi32(word, _mm_cvtsi32_si128(k as i32 * bits));
                put(first + k, _mm_and_si128(shifted, mask));
            }
        };
        match (size_of::<T>(), N) {
            (1, 1) => put(0, words(places.map(|at| *at as u32))),
            (2, 1) => {
                let of = |at: *const u8| at.cast::<u16>().read_unaligned() as u32;
                put(0, words(places.map(of)));
            }
            (4, 1) => put(0, words(places.map(|at| at.cast::<u32>().read_unaligned()))),
            (1, 2) => {
                let of = |at: *const u8| at.cast::<u16>().read_unaligned() as u32;
                split(0, 2, words(places.map(of)));
            }
            (1, 4) | (2, 2) => {
                let of = |at: *const u8| at.cast::<u32>().read_unaligned();
                split(0, N, words(places.map(of)));
            }
            (2, 4) => {
                let [low, high] = pairs();
                split(0, 2, low);
                split(2, 2, high);
            }
            (4, 2) => {
                let [low, high] = pairs();
                put(0, low);
                put(1, high);
            }
            (4, 3) => {
                let [low, high] = pairs();
                put(0, low);
                put(1, high);
                let of = |at: *const u8| at.add(8).cast::<u32>().read_unaligned();
                put(2, words(places.map(of)));
            }
            (4, 4) => {
                let [a, b, c, d] = places.map(|at| _mm_loadu_si128(at.cast()));
                let (ab, cd) = (_mm_unpacklo_epi32(a, b), _mm_unpacklo_epi32(c, d));
                put(0, _mm_unpacklo_epi64(ab, cd));
                put(1, _mm_unpackhi_epi64(ab, cd));
                let (ab, cd) = (_mm_unpackhi_epi32(a, b), _mm_unpackhi_epi32(c, d));
                put(2, _mm_unpacklo_epi64(ab, cd));
                put(3, _mm_unpackhi_epi64(ab, cd));
            }
            (8, 1) => {
                let to = rows[0].add(lane * 8);
                _mm_storeu_si128(to.cast(), _mm_unpacklo_epi64(halves(0), halves(1)));
                _mm_storeu_si128(to.add(16).cast(), _mm_unpacklo_epi64(halves(2), halves(3)));
            }
            _ => load_singly::<T, N>(places, rows, lane),
        }
    }
}

/// Loads `N` scalars for each of the lanes from `lane` on, from one place each.
///
/// # Safety
/// There are as many scalars at each place; the rows are a frame's.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(super) unsafe fn load_together<T: Lane, const N: usize>(
    places: [*const u8; TOGETHER],
    rows: Rows<N>,
    lane: usize,
) {
    // SAFETY: as the caller promises.
    unsafe { load_singly::<T, N>(places, rows, lane) };
}

/// [`load_together`], scalar by scalar.
///
/// # Safety
/// As there.
#[inline(always)]
unsafe fn load_singly<T: Lane, const N: usize>(
    places: [*const u8; TOGETHER],
    rows: Rows<N>,
    lane: usize,
) {
    for (k, at) in places.into_iter().enumerate() {
        for (scalar, row) in rows.into_iter().enumerate() {
            // SAFETY: as the caller promises.
            unsafe {
                let loaded = at.cast::<T>().add(scalar).read_unaligned();
                *row.cast::<T::Slot>().add(lane + k) = loaded.write();
            }
        }
    }
}
