//! Lanes of subgroups, as bits of a mask.

use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::Row;

/// The lanes of a mask, lowest first.
pub fn lanes_of(mask: u16) -> impl Iterator<Item = usize> {
    let mut rest = mask;
    std::iter::from_fn(move || {
        let lane = rest.trailing_zeros() as usize;
        rest &= rest.wrapping_sub(1);
        (lane < SUBGROUP_SIZE).then_some(lane)
    })
}

/// Takes over some lanes of a row.
#[inline]
pub fn copy_lanes(to: &mut Row, from: &Row, lanes: u16) {
    if lanes == u16::MAX {
        *to = *from;
        return;
    }
    for lane in 0..SUBGROUP_SIZE {
        let copied = lanes & 1 << lane != 0;
        to[lane] = if copied { from[lane] } else { to[lane] };
    }
}
