//! Between rows of lanes and the words of vertices, four by four.

use lanes::Row;

/// Words of two lists in turn.
#[inline(always)]
fn interleaved(a: [u32; 4], b: [u32; 4]) -> [[u32; 4]; 2] {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        use std::mem::transmute;
        // SAFETY: every processor of this architecture has SSE2; four words are as long as its
        // registers.
        unsafe {
            let (a, b) = (
                _mm_loadu_si128(a.as_ptr().cast()),
                _mm_loadu_si128(b.as_ptr().cast()),
            );
            [
                transmute::<__m128i, [u32; 4]>(_mm_unpacklo_epi32(a, b)),
                transmute::<__m128i, [u32; 4]>(_mm_unpackhi_epi32(a, b)),
            ]
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    [[a[0], b[0], a[1], b[1]], [a[2], b[2], a[3], b[3]]]
}

/// The first words of four lists, their second ones, and so on.
#[inline(always)]
pub fn transposed([a, b, c, d]: [[u32; 4]; 4]) -> [[u32; 4]; 4] {
    // Two steps: the first list with the third one, the second with the fourth.
    let ([ac, ac_upper], [bd, bd_upper]) = (interleaved(a, c), interleaved(b, d));
    let ([x, y], [z, w]) = (interleaved(ac, bd), interleaved(ac_upper, bd_upper));
    [x, y, z, w]
}

/// Copies a vertex of so many words from each of the first lanes: `row` has the row of a word,
/// `starts` the place of each lane's first word in `to`.
#[inline(always)]
pub fn copy_vertices<'a>(
    words: usize,
    row: impl Fn(usize) -> &'a Row,
    starts: &[usize],
    to: &mut [u32],
) {
    let whole = words & !3;
    let (fours, rest) = starts.as_chunks::<4>();
    for word in (0..whole).step_by(4) {
        let rows = [row(word), row(word + 1), row(word + 2), row(word + 3)];
        for (four, starts) in fours.iter().enumerate() {
            let lane = 4 * four;
            let of = |row: &Row| [row[lane], row[lane + 1], row[lane + 2], row[lane + 3]];
            let vertices = transposed([of(rows[0]), of(rows[1]), of(rows[2]), of(rows[3])]);
            for (start, vertex) in starts.iter().zip(&vertices) {
                to[start + word..start + word + 4].copy_from_slice(vertex);
            }
        }
        for (lane, start) in (4 * fours.len()..).zip(rest) {
            for (at, row) in rows.iter().enumerate() {
                to[start + word + at] = row[lane];
            }
        }
    }
    for word in whole..words {
        for (word_of_lane, start) in row(word).iter().zip(starts) {
            to[start + word] = *word_of_lane;
        }
    }
}
