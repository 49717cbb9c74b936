//! From coordinates to texel indices, one axis at a time (spec, "Texel Input Operations": "Scale
//! Operation", "Wrapping Operation", "Texel Gathering").
//!
//! Loops over lanes are branch-free, so that they become vector code.
#![forbid(unsafe_code)]

use lanes::{LANES, map};

use super::{AddressMode, Filter};

/// A number per lane.
pub(super) type Floats = [f32; LANES];
pub(super) type Ints = [i32; LANES];

/// The texels that a lane's sample touches along one axis.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    /// Texel indices: the one and, if filtered, its right neighbour. In range, except that one past
    /// either end means the border with `ClampToBorder` and the neighbouring face in cubes.
    pub index: [Ints; 2],
    /// The second one's weight.
    pub weight: Floats,
}

/// Farthest that an offset can move a texel (`minTexelGatherOffset` and its like), with room to
/// spare.
pub(super) const REACH: f32 = 64.0;

/// How an axis is addressed.
#[derive(Clone, Copy)]
pub(super) struct AxisRule {
    pub mode: AddressMode,
    pub filter: Filter,
    /// Coordinates count texels.
    pub unnormalized: bool,
    /// A cube's axis: indices past the ends are left for the caller to carry over to the next face.
    pub seamless: bool,
}

/// `i` modulo `size`, for `i` within a few sizes of 0.
#[inline(always)]
fn modulo(i: i32, size: i32) -> i32 {
    // The half keeps the quotient half a texel away from an integer: rounding cannot change its
    // floor.
    let quotient = ((i as f32 + 0.5) / size as f32).floor();
    i.wrapping_sub((quotient as i32).wrapping_mul(size))
}

/// Addresses one axis. `sizes` are at least 1.
#[inline(always)]
pub(super) fn address(
    rule: AxisRule,
    coordinates: &Floats,
    sizes: &Ints,
    offsets: Option<&Ints>,
) -> Axis {
    let shift = match rule.filter {
        Filter::Nearest => 0.0,
        Filter::Linear => 0.5,
    };
    let mut texel = [0.0; LANES];
    match rule.mode {
        // Periodic: reduced before scaling, which loses nothing.
        AddressMode::Repeat => {
            for lane in 0..LANES {
                let s = coordinates[lane];
                texel[lane] = (s - s.floor()) * sizes[lane] as f32 - shift;
            }
        }
        AddressMode::MirroredRepeat => {
            for lane in 0..LANES {
                let s = coordinates[lane];
                let period = s - 2.0 * (s * 0.5).floor();
                texel[lane] = period * sizes[lane] as f32 - shift;
            }
        }
        _ => {
            for lane in 0..LANES {
                let size = sizes[lane] as f32;
                let scale = if rule.unnormalized { 1.0 } else { size };
                let u = coordinates[lane] * scale - shift;
                texel[lane] = u.max(-size - REACH).min(size + REACH);
            }
        }
    }
    let mut first = [0; LANES];
    let mut weight = [0.0; LANES];
    for lane in 0..LANES {
        let floor = texel[lane].floor();
        first[lane] = floor as i32;
        weight[lane] = texel[lane] - floor;
    }
    if let Some(offsets) = offsets {
        for lane in 0..LANES {
            let offset = offsets[lane].clamp(-(REACH as i32), REACH as i32);
            first[lane] = first[lane].wrapping_add(offset);
        }
    }
    let has_offset = offsets.is_some();
    let second = map(&first, |i: i32| i.wrapping_add(1));
    Axis {
        index: [
            wrap(rule, &first, sizes, has_offset),
            wrap(rule, &second, sizes, has_offset),
        ],
        weight,
    }
}

#[inline(always)]
fn wrap(rule: AxisRule, indices: &Ints, sizes: &Ints, has_offset: bool) -> Ints {
    let mut wrapped = [0; LANES];
    if rule.seamless {
        for lane in 0..LANES {
            wrapped[lane] = indices[lane].max(-1).min(sizes[lane]);
        }
        return wrapped;
    }
    match rule.mode {
        AddressMode::Repeat => {
            for lane in 0..LANES {
                let (i, size) = (indices[lane], sizes[lane]);
                let i = if has_offset {
                    modulo(i, size)
                } else {
                    // At most one texel out, since the coordinate is reduced.
                    let i = if i < 0 { i + size } else { i };
                    if i >= size { i.wrapping_sub(size) } else { i }
                };
                wrapped[lane] = i.max(0).min(size - 1);
            }
        }
        AddressMode::MirroredRepeat => {
            for lane in 0..LANES {
                let (i, size) = (indices[lane], sizes[lane]);
                let i = modulo(i, 2 * size);
                let mirrored = if i < size { i } else { 2 * size - 1 - i };
                wrapped[lane] = mirrored.max(0).min(size - 1);
            }
        }
        AddressMode::ClampToEdge => {
            for lane in 0..LANES {
                wrapped[lane] = indices[lane].max(0).min(sizes[lane] - 1);
            }
        }
        AddressMode::ClampToBorder => {
            for lane in 0..LANES {
                wrapped[lane] = indices[lane].max(-1).min(sizes[lane]);
            }
        }
        AddressMode::MirrorClampToEdge => {
            for lane in 0..LANES {
                let i = indices[lane];
                // mirror(i) = -(1 + i) for negative i: its complement.
                let mirrored = if i < 0 { !i } else { i };
                wrapped[lane] = mirrored.min(sizes[lane] - 1);
            }
        }
    }
    wrapped
}
