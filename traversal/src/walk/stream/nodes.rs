//! From a list of rays at a node to lists at its children.

use std::arch::x86_64::*;

use super::lists::{List, OctantStack, Stream};
use super::rays::StreamRay;
use crate::layout::{NodeAt, WIDTH};
use crate::walk::PACKET;

/// Sorts eight words.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
fn sorted(v: __m256i) -> __m256i {
    macro_rules! step {
        ($v:expr, $p:expr, $max:expr) => {{
            let (v, p) = ($v, $p);
            _mm256_mask_max_epu32(_mm256_min_epu32(v, p), $max, v, p)
        }};
    }
    let v = step!(v, _mm256_shuffle_epi32::<0xB1>(v), 0x66);
    let v = step!(v, _mm256_shuffle_epi32::<0x4E>(v), 0x3C);
    let v = step!(v, _mm256_shuffle_epi32::<0xB1>(v), 0x5A);
    let v = step!(v, _mm256_permute2x128_si256::<1>(v, v), 0xF0);
    let v = step!(v, _mm256_shuffle_epi32::<0x4E>(v), 0xCC);
    step!(v, _mm256_shuffle_epi32::<0xB1>(v), 0xAA)
}

/// A node's planes, with the opposite sign: near ones and far ones.
#[derive(Clone, Copy)]
struct Planes {
    near: [__m256; 3],
    far: [__m256; 3],
}

/// Where a ray meets the planes of an axis.
macro_rules! meets {
    ($planes:expr, $minus_origin:expr, $inverse:expr, $axis:expr) => {{
        let apart = _mm256_sub_ps($planes[$axis], _mm256_set1_ps($minus_origin[$axis]));
        _mm256_castps_si256(_mm256_mul_ps(apart, _mm256_set1_ps($inverse[$axis])))
    }};
}

impl Planes {
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
    fn new(node: NodeAt<'_>, rows: [usize; 3]) -> Planes {
        let minus = |row: usize| {
            // SAFETY: a row of eight, aligned.
            let row = unsafe { _mm256_load_ps(node.row(row).cast()) };
            _mm256_xor_ps(row, _mm256_set1_ps(-0.0))
        };
        Planes {
            near: [minus(rows[0]), minus(rows[1]), minus(rows[2])],
            far: [minus(rows[0] ^ 1), minus(rows[1] ^ 1), minus(rows[2] ^ 1)],
        }
    }

    /// Which children a ray meets, and where it enters them; as [`Kernel::meet`] does it.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
    fn meet(&self, ray: &StreamRay) -> (u8, __m256i) {
        let (n, o, i) = (&self.near, &ray.minus_origin, &ray.near_inverse);
        let t_min = _mm256_castps_si256(_mm256_set1_ps(ray.t_min));
        let near = _mm256_max_epi32(
            _mm256_max_epi32(meets!(n, o, i, 0), meets!(n, o, i, 1)),
            _mm256_max_epi32(meets!(n, o, i, 2), t_min),
        );
        let (f, o, i) = (&self.far, &ray.minus_far_origin, &ray.far_inverse);
        let t_far = _mm256_castps_si256(_mm256_set1_ps(ray.t_far));
        let far = _mm256_min_epi32(
            _mm256_min_epi32(meets!(f, o, i, 0), meets!(f, o, i, 1)),
            _mm256_min_epi32(meets!(f, o, i, 2), t_far),
        );
        (_mm256_cmple_epi32_mask(near, far), near)
    }
}

/// Tests the rays of a list against the children of a node, and makes lists of those that meet each.
///
/// # Safety
/// The machine has the instruction set. There is room for eight lists.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) unsafe fn meet<const ANY: bool>(
    stream: &mut Stream,
    octant_stack: &mut OctantStack,
    list: &List,
    node: NodeAt<'_>,
) {
    let rows = [0, 1, 2].map(|axis: usize| 2 * axis + (octant_stack.octant >> axis & 1));
    let planes = Planes::new(node, rows);
    let all_rays = stream.rays.as_ptr();
    let count = list.count as usize;
    // SAFETY: the list is among the words.
    let here = unsafe { stream.words.as_mut_ptr().add(list.first as usize) };
    let copy = stream.here.as_mut_ptr();
    let masks = stream.masks.as_mut_ptr();

    // Least distances at which children are entered, and which are entered at all.
    let mut least = _mm256_set1_epi32(-1);
    let mut all = 0u8;
    let mut bits = _mm512_setzero_si512();
    let mut ids = _mm512_setzero_si512();
    let mut block = 0;
    while block < count {
        let mut halves = [0u64; 2];
        let mut at = block;
        for half in &mut halves {
            let end = (at + 8).min(count);
            if at >= end {
                break;
            }
            let shift = 8 * (8 - (end - at)) as u32;
            let mut bytes = 0u64;
            while at < end {
                // SAFETY: words of lists are offsets of rays.
                let ray = unsafe { &*all_rays.byte_add(*here.add(at) as usize) };
                let (mask, near) = planes.meet(ray);
                if !ANY {
                    least = _mm256_mask_min_epu32(least, mask, least, near);
                }
                all |= mask;
                bytes = bytes >> 8 | u64::from(mask) << 56;
                at += 1;
            }
            *half = bytes >> shift;
        }
        let bytes = _mm_set_epi64x(halves[1] as i64, halves[0] as i64);
        bits = _mm512_cvtepu8_epi32(bytes);
        // SAFETY: there is slack behind the lists, and in the space as many places as in the longest.
        unsafe {
            ids = _mm512_loadu_si512(here.add(block).cast());
            if count > PACKET {
                _mm_storeu_si128(masks.add(block).cast(), bytes);
                _mm512_storeu_si512(copy.add(block).cast(), ids);
            }
        }
        block += PACKET;
    }
    if all == 0 {
        return;
    }

    let mut order = [0u32; WIDTH];
    let columns = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    let in_order = if ANY {
        // The last one first.
        let last_first = _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0);
        _mm256_maskz_compress_epi32(all.reverse_bits(), last_first)
    } else {
        sorted(_mm256_or_si256(
            _mm256_andnot_si256(_mm256_set1_epi32(7), least),
            columns,
        ))
    };
    // SAFETY: eight words.
    unsafe { _mm256_storeu_si256(order.as_mut_ptr().cast(), in_order) };
    let mut top = list.first;
    octant_stack.lists.reserve(WIDTH);
    // SAFETY: the words of all lists made here are eight times as many as of this one at most, for which there is room, and slack.
    unsafe {
        let words = stream.words.as_mut_ptr();
        for &column in order[..all.count_ones() as usize].iter().rev() {
            let column = column as usize % WIDTH;
            let first = top;
            let bit = _mm512_set1_epi32(1 << column);
            if count <= PACKET {
                let chosen = _mm512_test_epi32_mask(bits, bit);
                let ids = _mm512_maskz_compress_epi32(chosen, ids);
                _mm512_storeu_si512(words.add(top as usize).cast(), ids);
                top += chosen.count_ones();
            } else {
                for block in 0..count.div_ceil(PACKET) {
                    let at = block * PACKET;
                    let bits = _mm512_cvtepu8_epi32(_mm_loadu_si128(masks.add(at).cast()));
                    let chosen = _mm512_test_epi32_mask(bits, bit);
                    let ids = _mm512_loadu_si512(copy.add(at).cast());
                    let ids = _mm512_maskz_compress_epi32(chosen, ids);
                    _mm512_storeu_si512(words.add(top as usize).cast(), ids);
                    top += chosen.count_ones();
                }
            }
            let length = octant_stack.lists.len();
            octant_stack.lists.as_mut_ptr().add(length).write(List {
                word: node.child(column),
                first,
                count: top - first,
                planes: rows.map(|row| -node.bound(row, column)),
            });
            octant_stack.lists.set_len(length + 1);
        }
    }
}
