//! Rows of subgroups, some lanes at a time.

use lanes::vector::Vector;
use lanes::{LaneMask, by_lane};
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::{AlignedRow, Row};

/// A row of numbers.
#[inline(always)]
pub fn floats(row: &Row) -> [f32; SUBGROUP_SIZE] {
    by_lane(|lane| f32::from_bits(row[lane]))
}

/// The bits of numbers.
#[inline(always)]
pub fn bits_of(numbers: &[f32; SUBGROUP_SIZE]) -> Row {
    by_lane(|lane| numbers[lane].to_bits())
}

lanes::vectors! {
    /// Takes over some lanes of rows.
    pub fn copy_lanes<V>(v, to: &mut [AlignedRow], from: &[AlignedRow], lanes: LaneMask) {
        for (to, from) in to.iter_mut().zip(from) {
            put_lanes(v, &mut to.0, &from.0, lanes);
        }
    }
}

lanes::vectors! {
    /// Takes over some lanes of a row.
    pub fn copy_row<V>(v, to: &mut Row, from: &Row, lanes: LaneMask) {
        put_lanes(v, to, from, lanes);
    }
}

/// [`copy_row`] among vectors.
#[inline(always)]
pub fn put_lanes<V: Vector>(v: V, to: &mut Row, from: &Row, lanes: LaneMask) {
    let row = v.select(lanes.bits(), v.load_i(from), v.load_i(to));
    v.store_i(row, to);
}

lanes::vectors! {
    /// Puts a word into some lanes of a row.
    pub fn put_word<V>(v, to: &mut Row, word: u32, lanes: LaneMask) {
        let row = v.select(lanes.bits(), v.splat_i(word as i32), v.load_i(to));
        v.store_i(row, to);
    }
}
