//! ASTC of two dimensions and the LDR profile (Khronos Data Format specification, "ASTC Compressed
//! Texture Image Formats"). What that profile does not have, and blocks that are not valid, are
//! magenta.
#![forbid(unsafe_code)]

mod endpoints;
mod sequence;

use self::endpoints::Endpoints;
use self::sequence::{ENDPOINT_RANGES, Range, WEIGHT_RANGES};
use super::{ONE, Texel, bytes};

/// The colour of errors.
const ERROR: [u32; 4] = [ONE, 0, ONE, ONE];
/// Most weights, most values of endpoints.
const MOST_WEIGHTS: usize = 64;
const MOST_VALUES: usize = 18;

/// Bits `low` to `low + count - 1`.
fn field(block: u128, low: u32, count: u32) -> u32 {
    (block >> low) as u32 & ((1u64 << count) - 1) as u32
}

/// The texels of a block of a footprint.
pub(super) fn decode(block: u128, footprint: [u8; 2], is_srgb: bool, texels: &mut [Texel]) {
    let footprint = footprint.map(u32::from);
    let texels = &mut texels[..(footprint[0] * footprint[1]) as usize];
    if field(block, 0, 9) == 0x1fc {
        texels.fill(void_extent(block, is_srgb).unwrap_or(ERROR));
    } else if decode_block(block, footprint, is_srgb, texels).is_none() {
        texels.fill(ERROR);
    }
}

/// A component of 16 bits: of sRGB, the upper half is the code. All else is decoded in the mode
/// `decode_float16`, which Vulkan's chapter "ASTC Compressed Image Formats" asks for: divided by
/// 65536, and rounded to zero in a float of 16 bits ("Weight Application").
fn words(color: [u32; 4], is_srgb: bool) -> Texel {
    match is_srgb {
        true => bytes(color.map(|value| (value >> 8) as u8), true),
        false => color.map(|value| match value {
            65535 => ONE,
            value => (leading_bits(value) as f32 / 65536.0).to_bits(),
        }),
    }
}

/// A number without the bits below its eleven highest: those that a float of 16 bits has no room
/// for.
fn leading_bits(value: u32) -> u32 {
    let dropped = (u32::BITS - value.leading_zeros()).saturating_sub(11);
    value >> dropped << dropped
}

/// A block of one colour; its extent only says how far it reaches beyond the block.
fn void_extent(block: u128, is_srgb: bool) -> Option<Texel> {
    let is_hdr = field(block, 9, 1) == 1;
    let is_reserved = field(block, 10, 2) != 3;
    let [s0, s1, t0, t1] = [12, 25, 38, 51].map(|low| field(block, low, 13));
    let is_unbounded = [s0, s1, t0, t1] == [0x1fff; 4];
    let is_ordered = s0 < s1 && t0 < t1;
    let is_valid = !is_hdr && !is_reserved && (is_unbounded || is_ordered);
    let color = [64, 80, 96, 112].map(|low| field(block, low, 16));
    is_valid.then(|| words(color, is_srgb))
}

/// The grid of weights.
struct Grid {
    width: u32,
    height: u32,
    /// Two weights a point.
    is_dual: bool,
    range: Range,
}

impl Grid {
    /// From a block's first 11 bits ("Block Mode").
    fn new(block: u128) -> Option<Grid> {
        let (a, b) = (field(block, 5, 2), field(block, 7, 2));
        let (mut is_dual, mut is_precise) = (field(block, 10, 1) == 1, field(block, 9, 1) == 1);
        let low = field(block, 0, 2);
        let (width, height, r);
        if low != 0 {
            r = field(block, 4, 1) | low << 1;
            (width, height) = match (field(block, 2, 2), b >> 1) {
                (0, _) => (b + 4, a + 2),
                (1, _) => (b + 8, a + 2),
                (2, _) => (a + 2, b + 8),
                (_, 0) => (a + 2, (b & 1) + 6),
                (_, _) => ((b & 1) + 2, a + 2),
            };
        } else {
            r = field(block, 4, 1) | field(block, 2, 2) << 1;
            (width, height) = match (b, a) {
                (0, _) => (12, a + 2),
                (1, _) => (a + 2, 12),
                (2, _) => {
                    (is_dual, is_precise) = (false, false);
                    (a + 6, field(block, 9, 2) + 6)
                }
                (_, 0) => (6, 10),
                (_, 1) => (10, 6),
                _ => return None,
            };
        }
        Some(Grid {
            width,
            height,
            is_dual,
            range: WEIGHT_RANGES[is_precise as usize][r.checked_sub(2)? as usize],
        })
    }

    fn weight_count(&self) -> usize {
        (self.width * self.height) as usize * if self.is_dual { 2 } else { 1 }
    }
}

/// `None` for a block that is not valid.
fn decode_block(
    block: u128,
    footprint: [u32; 2],
    is_srgb: bool,
    texels: &mut [Texel],
) -> Option<()> {
    let grid = Grid::new(block)?;
    let count = grid.weight_count();
    let weight_bits = grid.range.sequence_bits(count as u32);
    let partitions = field(block, 11, 2) + 1;
    let is_valid = grid.width <= footprint[0]
        && grid.height <= footprint[1]
        && count <= MOST_WEIGHTS
        && (24..=96).contains(&weight_bits)
        && !(grid.is_dual && partitions == 4);
    if !is_valid {
        return None;
    }
    // Weights stand at the end, bits reversed.
    let mut raw = [(0, 0); MOST_WEIGHTS];
    grid.range.read(block.reverse_bits(), &mut raw[..count]);
    // Those that lie outside the grid count nothing.
    let mut weights = [0; 2 * MOST_WEIGHTS];
    for (weight, raw) in weights.iter_mut().zip(&raw[..count]) {
        *weight = grid.range.weight(*raw);
    }

    // Downwards from the weights: what does not fit into the endpoint modes' place, the second
    // plane's component.
    let mut end = 128 - weight_bits;
    let (modes, start) = endpoint_modes(block, partitions, &mut end);
    let second_component = grid.is_dual.then(|| {
        end -= 2;
        field(block, end, 2) as usize
    });
    let endpoints = all_endpoints(block, &modes[..partitions as usize], start, end)?;

    let seed = field(block, 13, 10);
    let is_small = footprint[0] * footprint[1] < 31;
    for (i, texel) in texels.iter_mut().enumerate() {
        let (x, y) = (i as u32 % footprint[0], i as u32 / footprint[0]);
        let partition = match partitions {
            1 => 0,
            _ => partition_of(seed, [x, y], partitions, is_small),
        };
        let Some(endpoints) = &endpoints[partition] else {
            *texel = ERROR;
            continue;
        };
        let first = infill(&grid, &weights, footprint, [x, y], 0);
        let mut of_component = [first; 4];
        if let Some(component) = second_component {
            of_component[component] = infill(&grid, &weights, footprint, [x, y], 1);
        }
        let color = std::array::from_fn(|c| {
            let wide = |code: u8| match is_srgb {
                true => u32::from(code) << 8 | 0x80,
                false => u32::from(code) * 257,
            };
            let (low, high) = (wide(endpoints[0][c]), wide(endpoints[1][c]));
            (low * (64 - of_component[c]) + high * of_component[c] + 32) / 64
        });
        *texel = words(color, is_srgb);
    }
    Some(())
}

/// The endpoint modes of the partitions, and where their values start. Takes what it needs off the
/// `end`.
fn endpoint_modes(block: u128, partitions: u32, end: &mut u32) -> ([u32; 4], u32) {
    if partitions == 1 {
        return ([field(block, 13, 4); 4], 17);
    }
    let low = field(block, 23, 6);
    if low & 3 == 0 {
        return ([low >> 2; 4], 29);
    }
    let more = 3 * partitions - 4;
    *end -= more;
    let packed = (low | field(block, *end, more) << 6) >> 2;
    let class = (low & 3) - 1;
    let modes = std::array::from_fn(|partition| {
        let is_higher = packed >> partition & 1;
        let within = packed >> (partitions + 2 * partition as u32) & 3;
        (class + is_higher) << 2 | within
    });
    (modes, 29)
}

/// The endpoints of each partition; of those with a mode of high dynamic range, none.
fn all_endpoints(
    block: u128,
    modes: &[u32],
    start: u32,
    end: u32,
) -> Option<[Option<Endpoints>; 4]> {
    let count_of = |mode: u32| 2 * (mode >> 2) as usize + 2;
    let count: usize = modes.iter().map(|&mode| count_of(mode)).sum();
    if count > MOST_VALUES {
        return None;
    }
    let room = end.checked_sub(start)?;
    let range = ENDPOINT_RANGES
        .into_iter()
        .find(|range| range.sequence_bits(count as u32) <= room)?;
    let mut raw = [(0, 0); MOST_VALUES];
    range.read(block >> start, &mut raw[..count]);
    let values = raw.map(|value| range.endpoint(value));
    let mut endpoints = [None; 4];
    let mut rest = &values[..];
    for (slot, &mode) in endpoints.iter_mut().zip(modes) {
        *slot = endpoints::decode(mode, rest);
        rest = &rest[count_of(mode)..];
    }
    Some(endpoints)
}

/// A texel's weight, between those of the grid ("Weight Infill").
fn infill(
    grid: &Grid,
    weights: &[u32; 2 * MOST_WEIGHTS],
    footprint: [u32; 2],
    texel: [u32; 2],
    plane: usize,
) -> u32 {
    let place = |axis: usize, points: u32| {
        let size = footprint[axis];
        let scale = (1024 + size / 2) / (size - 1);
        let at = (scale * texel[axis] * (points - 1) + 32) >> 6;
        (at >> 4, at & 15)
    };
    let ((x, fx), (y, fy)) = (place(0, grid.width), place(1, grid.height));
    let w11 = (fx * fy + 8) >> 4;
    let (w10, w01, w00) = (fy - w11, fx - w11, 16 + w11 - fx - fy);
    let first = (y * grid.width + x) as usize;
    let step = if grid.is_dual { 2 } else { 1 };
    let point = |index: usize| weights[(index * step + plane) % weights.len()];
    let below = first + grid.width as usize;
    (point(first) * w00 + point(first + 1) * w01 + point(below) * w10 + point(below + 1) * w11 + 8)
        >> 4
}

/// Which partition a texel is in ("Partition Pattern Generation").
fn partition_of(seed: u32, texel: [u32; 2], partitions: u32, is_small: bool) -> usize {
    let [x, y] = texel.map(|v| if is_small { 2 * v } else { v });
    let seed = seed + (partitions - 1) * 1024;
    let random = hash(seed);
    let nibble = |shift: u32| {
        let value = random.rotate_right(shift) & 15;
        value * value
    };
    let odd = if seed & 2 != 0 { 4 } else { 5 };
    let even = if partitions == 3 { 6 } else { 5 };
    let (shift1, shift2) = match seed & 1 {
        1 => (odd, even),
        _ => (even, odd),
    };
    let plane = |first: u32, bits: u32| {
        let slope = (nibble(first) >> shift1) * x + (nibble(first + 4) >> shift2) * y;
        slope.wrapping_add(random >> bits) & 0x3f
    };
    let a = plane(0, 14);
    let b = plane(8, 10);
    let c = if partitions < 3 { 0 } else { plane(16, 6) };
    let d = if partitions < 4 { 0 } else { plane(24, 2) };
    if a >= b && a >= c && a >= d {
        0
    } else if b >= c && b >= d {
        1
    } else if c >= d {
        2
    } else {
        3
    }
}

/// The specification's `hash52`.
fn hash(seed: u32) -> u32 {
    let mut p = seed;
    p ^= p >> 15;
    p = p.wrapping_sub(p << 17);
    p = p.wrapping_add(p << 7);
    p = p.wrapping_add(p << 4);
    p ^= p >> 5;
    p = p.wrapping_add(p << 16);
    p ^= p >> 7;
    p ^= p >> 3;
    p ^= p << 6;
    p ^ p >> 17
}
