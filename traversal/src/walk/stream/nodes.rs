//! From a list of rays at a node to lists at its children.

use std::arch::x86_64::*;

use super::lists::{List, OctantStack, Stream};
use super::rays::StreamRay;
use crate::layout::{NodeAt, WIDTH};
use crate::walk::PACKET;

/// Sorts eight words.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn sorted(v: __m256i) -> __m256i {
    macro_rules! step {
        ($v:expr, $p:expr, $max:expr) => {{
            let (v, p) = ($v, $p);
            _mm256_blend_epi32::<$max>(_mm256_min_epu32(v, p), _mm256_max_epu32(v, p))
        }};
    }
    let v = step!(v, _mm256_shuffle_epi32::<0xB1>(v), 0x66);
    let v = step!(v, _mm256_shuffle_epi32::<0x4E>(v), 0x3C);
    let v = step!(v, _mm256_shuffle_epi32::<0xB1>(v), 0x5A);
    let v = step!(v, _mm256_permute2x128_si256::<1>(v, v), 0xF0);
    let v = step!(v, _mm256_shuffle_epi32::<0x4E>(v), 0xCC);
    step!(v, _mm256_shuffle_epi32::<0xB1>(v), 0xAA)
}

/// For each mask of eight lanes: those that it has, one a byte, then others.
static LANES: [[u8; 8]; 256] = {
    let mut lanes = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut length) = (0, 0);
        while lane < 8 {
            if mask >> lane & 1 != 0 {
                lanes[mask][length] = lane;
                length += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    lanes
};

/// The words of a mask's lanes, one after the other, and others behind them.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
pub(super) fn chosen(words: __m256i, mask: u8) -> __m256i {
    // SAFETY: eight bytes.
    let lanes = unsafe { _mm_loadl_epi64(LANES[usize::from(mask)].as_ptr().cast()) };
    _mm256_permutevar8x32_epi32(words, _mm256_cvtepu8_epi32(lanes))
}

/// Puts the words of a mask's lanes down; returns how many those are.
///
/// # Safety
/// There is room for sixteen. The machine has AVX2, `WIDE`: AVX-512, and so does the function that
/// this becomes part of.
#[inline(always)]
pub(super) unsafe fn put_chosen<const WIDE: bool>(
    place: *mut u32,
    words: [__m256i; 2],
    mask: u32,
) -> u32 {
    if WIDE {
        // SAFETY: the caller guarantees that there is room for sixteen words, and the machine has
        // AVX2, or AVX-512 if `WIDE`.
        unsafe {
            let low = _mm512_castsi256_si512(words[0]);
            let words = _mm512_inserti64x4::<1>(low, words[1]);
            _mm512_storeu_si512(
                place.cast(),
                _mm512_maskz_compress_epi32(mask as u16, words),
            );
        }
        return mask.count_ones();
    }
    let [low, high] = [mask as u8, (mask >> 8) as u8];
    // SAFETY: the caller guarantees that there is room for sixteen words, and the machine has AVX2,
    // or AVX-512 if `WIDE`; the second half begins eight words on at most.
    unsafe {
        _mm256_storeu_si256(place.cast(), chosen(words[0], low));
        let place = place.add(low.count_ones() as usize);
        _mm256_storeu_si256(place.cast(), chosen(words[1], high));
    }
    mask.count_ones()
}

/// Sixteen words.
///
/// # Safety
/// There are so many.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn sixteen(words: *const u32) -> [__m256i; 2] {
    // SAFETY: the caller guarantees that there are so many entries.
    unsafe {
        [
            _mm256_loadu_si256(words.cast()),
            _mm256_loadu_si256(words.add(8).cast()),
        ]
    }
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
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
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

    /// Which children a ray meets, and where it enters them, all ones where it does not; as
    /// [`Kernel::intersect_node`] does it.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn intersect_node(&self, ray: &StreamRay) -> (u8, __m256i) {
        let (n, o, i) = (&self.near, &ray.minus_origin, &ray.near_inverse);
        let t_min = _mm256_castps_si256(_mm256_set1_ps(ray.t_min));
        let near = _mm256_max_epi32(
            _mm256_max_epi32(meets!(n, o, i, 0), meets!(n, o, i, 1)),
            _mm256_max_epi32(meets!(n, o, i, 2), t_min),
        );
        let (f, o, i) = (&self.far, &ray.minus_far_origin, &ray.far_inverse);
        let t_far = _mm256_castps_si256(_mm256_set1_ps(ray.t_far()));
        let far = _mm256_min_epi32(
            _mm256_min_epi32(meets!(f, o, i, 0), meets!(f, o, i, 1)),
            _mm256_min_epi32(meets!(f, o, i, 2), t_far),
        );
        let beyond = _mm256_cmpgt_epi32(near, far);
        let mask = !_mm256_movemask_ps(_mm256_castsi256_ps(beyond)) as u8;
        (mask, _mm256_or_si256(near, beyond))
    }
}

/// [`intersect_node_with`] AVX2.
///
/// # Safety
/// As there.
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
pub(super) unsafe fn intersect_node<const ANY: bool>(
    stream: &mut Stream,
    octant_stack: &mut OctantStack,
    list: &List,
    node: NodeAt<'_>,
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe { intersect_node_with::<ANY, false>(stream, octant_stack, list, node) }
}

/// [`intersect_node_with`] the 32 registers and the masks of AVX-512.
///
/// # Safety
/// As there.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) unsafe fn intersect_node_wide<const ANY: bool>(
    stream: &mut Stream,
    octant_stack: &mut OctantStack,
    list: &List,
    node: NodeAt<'_>,
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe { intersect_node_with::<ANY, true>(stream, octant_stack, list, node) }
}

/// Tests the rays of a list against the children of a node, and makes lists of those that meet
/// each.
///
/// # Safety
/// The machine has the instruction set. There is room for eight lists.
#[inline(always)]
unsafe fn intersect_node_with<const ANY: bool, const WIDE: bool>(
    stream: &mut Stream,
    octant_stack: &mut OctantStack,
    list: &List,
    node: NodeAt<'_>,
) {
    // SAFETY: the caller guarantees that the machine has the instruction set. There is room for
    // eight lists; for the rest, see the comments.
    unsafe {
        let rows = [0, 1, 2].map(|axis: usize| 2 * axis + (octant_stack.octant >> axis & 1));
        let planes = Planes::new(node, rows);
        let all_rays = stream.rays.as_ptr();
        let count = list.count as usize;
        // The list is among the words.
        let here = stream.words.as_mut_ptr().add(list.first as usize);
        let copy = stream.here.as_mut_ptr();
        let masks = stream.masks.as_mut_ptr();

        // Least distances at which children are entered, and which are entered at all.
        let mut least = _mm256_set1_epi32(-1);
        let mut all = 0u8;
        let mut bytes = _mm_setzero_si128();
        let mut ids = [_mm256_setzero_si256(); 2];
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
                let mut eight = 0u64;
                while at < end {
                    // Words of lists are offsets of rays.
                    let ray = &*all_rays.byte_add(*here.add(at) as usize);
                    let (mask, near) = planes.intersect_node(ray);
                    if !ANY {
                        least = _mm256_min_epu32(least, near);
                    }
                    all |= mask;
                    eight = eight >> 8 | u64::from(mask) << 56;
                    at += 1;
                }
                *half = eight >> shift;
            }
            bytes = _mm_set_epi64x(halves[1] as i64, halves[0] as i64);
            // There is slack behind the lists, and in the space as many places as in the longest.
            ids = sixteen(here.add(block));
            if count > PACKET {
                _mm_storeu_si128(masks.add(block).cast(), bytes);
                _mm256_storeu_si256(copy.add(block).cast(), ids[0]);
                _mm256_storeu_si256(copy.add(block + 8).cast(), ids[1]);
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
            chosen(last_first, all.reverse_bits())
        } else {
            sorted(_mm256_or_si256(
                _mm256_andnot_si256(_mm256_set1_epi32(7), least),
                columns,
            ))
        };
        _mm256_storeu_si256(order.as_mut_ptr().cast(), in_order);
        let mut top = list.first;
        octant_stack.lists.reserve(WIDTH);
        // The words of all lists made here are eight times as many as of this one at most, for
        // which there is room, and slack.
        let words = stream.words.as_mut_ptr();
        for &column in order[..all.count_ones() as usize].iter().rev() {
            let column = column as usize % WIDTH;
            let first = top;
            let to_sign = _mm_cvtsi32_si128(7 - column as i32);
            if count <= PACKET {
                let meeting = _mm_movemask_epi8(_mm_sll_epi16(bytes, to_sign)) as u32;
                top += put_chosen::<WIDE>(words.add(top as usize), ids, meeting);
            } else {
                for block in 0..count.div_ceil(PACKET) {
                    let at = block * PACKET;
                    let bytes = _mm_loadu_si128(masks.add(at).cast());
                    let meeting = _mm_movemask_epi8(_mm_sll_epi16(bytes, to_sign)) as u32;
                    top +=
                        put_chosen::<WIDE>(words.add(top as usize), sixteen(copy.add(at)), meeting);
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
