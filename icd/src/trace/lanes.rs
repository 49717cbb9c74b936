//! Rows of subgroups, some lanes at a time.

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
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
