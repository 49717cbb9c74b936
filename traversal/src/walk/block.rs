//! Blocks of triangles that share vertices, written out as groups, so that one test serves both.

use std::arch::x86_64::*;

use crate::layout::{BLOCK_VERTICES, Block, GROUP, LEAF_TRIANGLES, TriangleGroup};
use crate::structure::Structure;

/// As [`Structure::leaf_groups`].
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
pub(super) fn leaf_groups<'a>(
    structure: &'a Structure,
    word: u32,
    room: &'a mut Option<[TriangleGroup; 2]>,
) -> Option<([&'a TriangleGroup; 2], u32)> {
    // SAFETY: the machine has AVX2.
    structure.leaf_groups(word, room, |block, room| unsafe { expand(block, room) })
}

/// As [`Block::expand`]. Reads of a corrupt block stay inside the largest block.
///
/// # Safety
/// The machine has AVX2.
#[inline(never)]
#[target_feature(enable = "avx2,bmi1,bmi2")]
pub(super) unsafe fn expand(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32 {
    let [first, last] = groups;
    let rows = [0, 1, 2].map(|axis| block.coordinates(axis));
    let many = usize::from(block.vertex_count) > LEAF_TRIANGLES;
    let most = usize::from(block.vertex_count) > 2 * LEAF_TRIANGLES;
    for (vertex, corners) in block.corners.iter().enumerate() {
        // SAFETY: eight bytes.
        let corners = unsafe { _mm_loadl_epi64(corners.as_ptr().cast()) };
        let corners = _mm256_cvtepu8_epi32(corners);
        let second = _mm256_cmpgt_epi32(corners, _mm256_set1_epi32(7));
        let third = _mm256_cmpgt_epi32(corners, _mm256_set1_epi32(15));
        for (axis, row) in rows.iter().enumerate() {
            let mut picked = pick::<0>(row, corners);
            if many {
                let others = pick::<1>(row, corners);
                picked = _mm256_blendv_ps(picked, others, _mm256_castsi256_ps(second));
            }
            if most {
                let others = pick::<2>(row, corners);
                picked = _mm256_blendv_ps(picked, others, _mm256_castsi256_ps(third));
            }
            let low: &mut [f32; GROUP] = &mut first.vertices[vertex][axis];
            let high: &mut [f32; GROUP] = &mut last.vertices[vertex][axis];
            // SAFETY: four numbers each.
            unsafe {
                _mm_storeu_ps(low.as_mut_ptr(), _mm256_castps256_ps128(picked));
                _mm_storeu_ps(high.as_mut_ptr(), _mm256_extractf128_ps::<1>(picked));
            }
        }
    }
    let lanes = block.lanes();
    (first.lanes, last.lanes) = (lanes & 0xF, lanes >> GROUP);
    first.margin = block.margin();
    last.margin = first.margin;
    lanes
}

/// Of an eighth vertex on, those that `corners` name modulo eight.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn pick<const PART: usize>(row: &[u32; BLOCK_VERTICES], corners: __m256i) -> __m256 {
    // SAFETY: eight of 24 numbers.
    let part = unsafe { _mm256_loadu_ps(row.as_ptr().add(PART * LEAF_TRIANGLES).cast()) };
    _mm256_permutevar8x32_ps(part, corners)
}
