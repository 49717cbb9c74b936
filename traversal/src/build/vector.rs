//! [`Corners`] in a register: the arithmetic of the builders' inner loops, once for each
//! instruction set.
//!
//! Both do the same operations in the same order, so a tree does not depend on the machine.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

use super::corners::Corners;
use super::primitive::Primitive;

/// Eight numbers, as [`Corners`] has them.
///
/// # Safety
/// Implementations may need an instruction set: code that is generic over them is inlined into
/// functions that have it, which are called where the machine has it.
pub(crate) unsafe trait Vector: Copy {
    fn of(corners: &Corners) -> Self;
    /// A primitive's box, with zeros in place of the indices: as floats they would be denormal,
    /// which is a hundred times slower.
    fn of_primitive(primitive: &Primitive) -> Self;
    fn corners(self) -> Corners;
    /// The union of both boxes: the minimum of each number, or that of `other` if they are equal.
    fn join(self, other: Self) -> Self;
    /// Twice a box's center, as a box.
    fn center(self) -> Self;
    /// The box if `wanted`, otherwise the empty box.
    fn only_if(self, wanted: bool) -> Self;
    /// (`self` − `base`) · `factor` of the lower corner, rounded toward 0. All are inside i32.
    fn places(self, base: &[f32; 4], factor: &[f32; 4]) -> [i32; 4];
    /// Four numbers: one for each axis, and an unused one.
    type Four: Copy;
    /// Four counts, likewise.
    type Counts: Copy;

    fn counts(counts: &[u32; 4]) -> Self::Counts;
    fn add_counts(one: Self::Counts, other: Self::Counts) -> Self::Counts;
    /// Half the surfaces of three boxes, with edges multiplied by `scale`, times the number of
    /// blocks of 2^`shift` for the counts.
    fn costs(boxes: [Self; 3], scale: f32, counts: Self::Counts, shift: u32) -> Self::Four;
    fn add(one: Self::Four, other: Self::Four) -> Self::Four;
    /// Replaces larger costs with `cost`, and their position.
    fn lower(least: &mut [Self::Four; 2], cost: Self::Four, place: f32);
    fn four(number: f32) -> Self::Four;
    fn numbers(four: Self::Four) -> [f32; 4];
}

/// The portable implementation.
#[derive(Clone, Copy)]
pub(crate) struct PortableBounds([f32; 8]);

// SAFETY: needs nothing.
unsafe impl Vector for PortableBounds {
    #[inline(always)]
    fn of(corners: &Corners) -> PortableBounds {
        PortableBounds(corners.0)
    }

    #[inline(always)]
    fn of_primitive(primitive: &Primitive) -> PortableBounds {
        PortableBounds(primitive.corners().0)
    }

    #[inline(always)]
    fn corners(self) -> Corners {
        Corners(self.0)
    }

    #[inline(always)]
    fn join(self, other: PortableBounds) -> PortableBounds {
        PortableBounds(Corners(self.0).join(&Corners(other.0)).0)
    }

    #[inline(always)]
    fn center(self) -> PortableBounds {
        PortableBounds(Corners::point(Corners(self.0).center()).0)
    }

    #[inline(always)]
    fn only_if(self, wanted: bool) -> PortableBounds {
        let least = LEAST[usize::from(wanted)];
        PortableBounds(
            self.0
                .map(|number| if number > least { number } else { least }),
        )
    }

    #[inline(always)]
    fn places(self, base: &[f32; 4], factor: &[f32; 4]) -> [i32; 4] {
        // A saturating conversion costs more, and is not needed.
        std::array::from_fn(|i| ((self.0[i] - base[i]) * factor[i]) as i32)
    }

    type Four = [f32; 4];
    type Counts = [u32; 4];

    #[inline(always)]
    fn counts(counts: &[u32; 4]) -> [u32; 4] {
        *counts
    }

    #[inline(always)]
    fn add_counts(one: [u32; 4], other: [u32; 4]) -> [u32; 4] {
        std::array::from_fn(|i| one[i] + other[i])
    }

    #[inline(always)]
    fn costs(boxes: [PortableBounds; 3], scale: f32, counts: [u32; 4], shift: u32) -> [f32; 4] {
        let areas = boxes.map(|part| Corners(part.0).half_area(scale));
        std::array::from_fn(|i| match areas.get(i) {
            Some(area) => {
                let blocks = (counts[i] + (1 << shift) - 1) >> shift;
                area * blocks as i32 as f32
            }
            None => f32::NAN,
        })
    }

    #[inline(always)]
    fn add(one: [f32; 4], other: [f32; 4]) -> [f32; 4] {
        std::array::from_fn(|i| one[i] + other[i])
    }

    #[inline(always)]
    fn lower([least, places]: &mut [[f32; 4]; 2], cost: [f32; 4], place: f32) {
        for i in 0..4 {
            if cost[i] < least[i] {
                (least[i], places[i]) = (cost[i], place);
            }
        }
    }

    #[inline(always)]
    fn four(number: f32) -> [f32; 4] {
        [number; 4]
    }

    #[inline(always)]
    fn numbers(four: [f32; 4]) -> [f32; 4] {
        four
    }
}

/// The identity of [`Vector::only_if`]: infinity makes a box empty.
const LEAST: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// The implementation with AVX2.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub(crate) struct Avx2Bounds(__m256);

#[cfg(target_arch = "x86_64")]
impl Avx2Bounds {
    /// The lengths of the edges, and an unused number.
    #[inline(always)]
    fn edges(self) -> __m128 {
        // SAFETY: the trait's promise.
        unsafe {
            let upper = _mm256_extractf128_ps::<1>(self.0);
            let lower = _mm256_castps256_ps128(self.0);
            _mm_sub_ps(_mm_xor_ps(upper, _mm_set1_ps(-0.0)), lower)
        }
    }
}

// SAFETY: by the trait's promise, the machine has AVX2 wherever one of these runs.
#[cfg(target_arch = "x86_64")]
unsafe impl Vector for Avx2Bounds {
    #[inline(always)]
    fn of(corners: &Corners) -> Avx2Bounds {
        // SAFETY: eight aligned numbers.
        Avx2Bounds(unsafe { _mm256_load_ps(corners.0.as_ptr()) })
    }

    #[inline(always)]
    fn of_primitive(primitive: &Primitive) -> Avx2Bounds {
        // SAFETY: as large and as aligned as eight numbers, and any bits are some.
        unsafe {
            let words = _mm256_load_ps(std::ptr::from_ref(primitive).cast());
            Avx2Bounds(_mm256_blend_ps::<0b1000_1000>(words, _mm256_setzero_ps()))
        }
    }

    #[inline(always)]
    fn corners(self) -> Corners {
        let mut corners = Corners::EMPTY;
        // SAFETY: eight aligned numbers.
        unsafe { _mm256_store_ps(corners.0.as_mut_ptr(), self.0) };
        corners
    }

    #[inline(always)]
    fn join(self, other: Avx2Bounds) -> Avx2Bounds {
        // SAFETY: the trait's promise.
        Avx2Bounds(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn center(self) -> Avx2Bounds {
        // SAFETY: the trait's promise.
        Avx2Bounds(unsafe { _mm256_sub_ps(self.0, _mm256_permute2f128_ps::<1>(self.0, self.0)) })
    }

    #[inline(always)]
    fn only_if(self, wanted: bool) -> Avx2Bounds {
        // SAFETY: the trait's promise.
        unsafe {
            let least = _mm256_broadcast_ss(&LEAST[usize::from(wanted)]);
            Avx2Bounds(_mm256_max_ps(self.0, least))
        }
    }

    #[inline(always)]
    fn places(self, base: &[f32; 4], factor: &[f32; 4]) -> [i32; 4] {
        // SAFETY: the trait's promise; four numbers each.
        unsafe {
            let (base, factor) = (_mm_loadu_ps(base.as_ptr()), _mm_loadu_ps(factor.as_ptr()));
            let place = _mm_mul_ps(_mm_sub_ps(_mm256_castps256_ps128(self.0), base), factor);
            let place = _mm_cvttps_epi32(place);
            [
                _mm_cvtsi128_si32(place),
                _mm_extract_epi32::<1>(place),
                _mm_extract_epi32::<2>(place),
                0,
            ]
        }
    }

    type Four = __m128;
    type Counts = __m128i;

    #[inline(always)]
    fn counts(counts: &[u32; 4]) -> __m128i {
        // SAFETY: four numbers.
        unsafe { _mm_loadu_si128(counts.as_ptr().cast()) }
    }

    #[inline(always)]
    fn add_counts(one: __m128i, other: __m128i) -> __m128i {
        // SAFETY: SSE2 is part of x86-64.
        unsafe { _mm_add_epi32(one, other) }
    }

    #[inline(always)]
    fn costs(boxes: [Avx2Bounds; 3], scale: f32, counts: __m128i, shift: u32) -> __m128 {
        // SAFETY: the trait's promise.
        unsafe {
            let [a, b, c] = [boxes[0].edges(), boxes[1].edges(), boxes[2].edges()];
            // Rows of x, y, z, one box a column.
            let (low, high) = (_mm_unpacklo_ps(a, b), _mm_unpackhi_ps(a, b));
            let scale = _mm_set1_ps(scale);
            let x = _mm_mul_ps(_mm_shuffle_ps::<0b11_00_01_00>(low, c), scale);
            let y = _mm_mul_ps(_mm_shuffle_ps::<0b11_01_11_10>(low, c), scale);
            let z = _mm_mul_ps(_mm_shuffle_ps::<0b11_10_01_00>(high, c), scale);
            let area = _mm_add_ps(
                _mm_add_ps(_mm_mul_ps(x, y), _mm_mul_ps(y, z)),
                _mm_mul_ps(z, x),
            );
            let up = _mm_add_epi32(counts, _mm_set1_epi32((1 << shift) - 1));
            let blocks = _mm_srl_epi32(up, _mm_cvtsi32_si128(shift as i32));
            _mm_mul_ps(area, _mm_cvtepi32_ps(blocks))
        }
    }

    #[inline(always)]
    fn add(one: __m128, other: __m128) -> __m128 {
        // SAFETY: SSE is part of x86-64.
        unsafe { _mm_add_ps(one, other) }
    }

    #[inline(always)]
    fn lower([least, places]: &mut [__m128; 2], cost: __m128, place: f32) {
        // SAFETY: the trait's promise.
        unsafe {
            let better = _mm_cmplt_ps(cost, *least);
            *least = _mm_blendv_ps(*least, cost, better);
            *places = _mm_blendv_ps(*places, _mm_set1_ps(place), better);
        }
    }

    #[inline(always)]
    fn four(number: f32) -> __m128 {
        // SAFETY: SSE is part of x86-64.
        unsafe { _mm_set1_ps(number) }
    }

    #[inline(always)]
    fn numbers(four: __m128) -> [f32; 4] {
        let mut numbers = [0.0; 4];
        // SAFETY: four numbers.
        unsafe { _mm_storeu_ps(numbers.as_mut_ptr(), four) };
        numbers
    }
}
