//! Rows of subgroups, some lanes at a time.

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::image::vector::Vector;
use spirv_jit::program::Row;

/// Takes over some lanes of a row.
#[inline]
pub fn copy_lanes(to: &mut Row, from: &Row, lanes: LaneMask) {
    if lanes == LaneMask::ALL {
        *to = *from;
        return;
    }
    for lane in 0..SUBGROUP_SIZE {
        let copied = lanes.contains(lane);
        to[lane] = if copied { from[lane] } else { to[lane] };
    }
}

/// [`copy_lanes`] in vectors.
#[inline(always)]
pub fn put_lanes<V: Vector>(v: V, to: &mut Row, from: &Row, lanes: LaneMask) {
    let row = v.select(lanes.bits(), v.load_i(from), v.load_i(to));
    v.store_i(row, to);
}

spirv_jit::vectors! {
    /// Puts a word into some lanes of a row.
    pub fn put_word<V>(v, to: &mut Row, word: u32, lanes: LaneMask) {
        let row = v.select(lanes.bits(), v.splat_i(word as i32), v.load_i(to));
        v.store_i(row, to);
    }
}

spirv_jit::vectors! {
    /// The lanes of a row that hold a word.
    pub fn holding<V>(v, row: &Row, word: u32) -> LaneMask {
        LaneMask::from_bits(!v.ne_i(v.load_i(row), v.splat_i(word as i32)))
    }
}
