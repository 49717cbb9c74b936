//! Sixteen pixels at once: four quads of four lanes, as fragment programs have them. In a 4×4
//! block, lane `l` is pixel ([`LANE_X`]`[l]`, [`LANE_Y`]`[l]`).
//!
//! Loops over rows of sixteen become vectors by themselves; [`lanes::vectors!`] compiles them
//! for each instruction set. All of them compute the same bits: nothing is fused, nothing is
//! reordered.

pub use lanes::Row;
use lanes::vector::Vector;

/// A number a lane.
pub type Floats = [f32; 16];

/// Column and row of each lane in a 4×4 block.
pub const LANE_X: [i32; 16] = [0, 1, 0, 1, 2, 3, 2, 3, 0, 1, 0, 1, 2, 3, 2, 3];
pub const LANE_Y: [i32; 16] = [0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 2, 2, 3, 3];

/// Column and row of each lane, as words: of a block, and of a row of sixteen pixels.
pub static IN_BLOCK: [Row; 2] = [
    [0, 1, 0, 1, 2, 3, 2, 3, 0, 1, 0, 1, 2, 3, 2, 3],
    [0, 0, 1, 1, 0, 0, 1, 1, 2, 2, 3, 3, 2, 2, 3, 3],
];
pub static IN_ROW: [Row; 2] = [
    [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
    [0; 16],
];

/// In the order of rows: the lane of pixel `4 y + x` of a block. It is its own inverse.
pub const BY_ROWS: [usize; 16] = [0, 1, 4, 5, 2, 3, 6, 7, 8, 9, 12, 13, 10, 11, 14, 15];

/// Lanes whose column, or row, is in `from..to`: `[from][to]`.
pub static COLUMNS: [[u16; 5]; 5] = ranges(&LANE_X);
pub static ROWS: [[u16; 5]; 5] = ranges(&LANE_Y);

const fn ranges(side: &[i32; 16]) -> [[u16; 5]; 5] {
    let mut masks = [[0; 5]; 5];
    let mut from = 0;
    while from < 5 {
        let mut to = 0;
        while to < 5 {
            let mut lane = 0;
            while lane < 16 {
                if side[lane] >= from as i32 && side[lane] < to as i32 {
                    masks[from][to] |= 1 << lane;
                }
                lane += 1;
            }
            to += 1;
        }
        from += 1;
    }
    masks
}

/// The lanes whose word is negative.
#[inline(always)]
pub fn negative(row: &[i32; 16]) -> u16 {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        // SAFETY: every processor of this architecture has SSE2; four words are read from each
        // quarter of the row.
        unsafe {
            let quarter = |index: usize| _mm_loadu_si128(row[4 * index..].as_ptr().cast());
            let low = _mm_packs_epi32(quarter(0), quarter(1));
            let high = _mm_packs_epi32(quarter(2), quarter(3));
            _mm_movemask_epi8(_mm_packs_epi16(low, high)) as u16
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        let mut mask = 0;
        for lane in 0..16 {
            mask |= ((row[lane] < 0) as u16) << lane;
        }
        mask
    }
}

/// The lanes for which something holds.
#[inline(always)]
pub fn lanes_where(holds: impl Fn(usize) -> bool) -> u16 {
    let mut row = [0; 16];
    for lane in 0..16 {
        row[lane] = -(holds(lane) as i32);
    }
    negative(&row)
}

/// Vectors from rows of words, and rows from vectors.
#[inline(always)]
pub fn load_words<V: Vector>(v: V, rows: &[Row; 4]) -> [V::I; 4] {
    [
        v.load_i(&rows[0]),
        v.load_i(&rows[1]),
        v.load_i(&rows[2]),
        v.load_i(&rows[3]),
    ]
}

#[inline(always)]
pub fn rows_of<V: Vector>(v: V, words: &[V::I; 4]) -> [Row; 4] {
    let mut rows = [[0; 16]; 4];
    v.store_i(words[0], &mut rows[0]);
    v.store_i(words[1], &mut rows[1]);
    v.store_i(words[2], &mut rows[2]);
    v.store_i(words[3], &mut rows[3]);
    rows
}

/// Words of vectors as numbers, and back.
#[inline(always)]
pub fn numbers<V: Vector>(v: V, words: &[V::I; 4]) -> [V::F; 4] {
    [
        v.bits_to_f(words[0]),
        v.bits_to_f(words[1]),
        v.bits_to_f(words[2]),
        v.bits_to_f(words[3]),
    ]
}

#[inline(always)]
pub fn words<V: Vector>(v: V, numbers: &[V::F; 4]) -> [V::I; 4] {
    [
        v.bits_of(numbers[0]),
        v.bits_of(numbers[1]),
        v.bits_of(numbers[2]),
        v.bits_of(numbers[3]),
    ]
}

/// One row of a vector.
#[inline(always)]
pub fn row_of<V: Vector>(v: V, words: V::I) -> Row {
    let mut row = [0; 16];
    v.store_i(words, &mut row);
    row
}

/// The numbers of words.
#[inline(always)]
pub fn floats_of(row: &Row) -> Floats {
    let mut numbers = [0.0; 16];
    for lane in 0..16 {
        numbers[lane] = f32::from_bits(row[lane]);
    }
    numbers
}

/// The quads, a bit each, that have lanes in a mask.
#[inline(always)]
pub fn quads_of(mask: u16) -> u32 {
    let pairs = mask | mask >> 1;
    let first = (pairs | pairs >> 2) & 0x1111;
    u32::from((first | first >> 3) & 0x3 | ((first >> 6 | first >> 9) & 0xc))
}

/// All lanes of some quads.
#[inline(always)]
pub fn lanes_of(quads: u32) -> u16 {
    let spread = (quads & 1) | (quads & 2) << 3 | (quads & 4) << 6 | (quads & 8) << 9;
    (spread * 0xf) as u16
}
