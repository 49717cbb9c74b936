//! ETC2 and EAC (Khronos Data Format specification, "ETC2 Compressed Texture Image Formats"). Bits
//! are numbered as there: the first byte of a block holds bits 63 to 56.
#![forbid(unsafe_code)]

use super::{ONE, Texel, bytes};

/// Small and large intensity modifiers by table codeword.
const MODIFIERS: [[i32; 2]; 8] = [
    [2, 8],
    [5, 17],
    [9, 29],
    [13, 42],
    [18, 60],
    [24, 80],
    [33, 106],
    [47, 183],
];

/// Distances of T and H modes.
const DISTANCES: [i32; 8] = [3, 6, 11, 16, 23, 32, 41, 64];

/// EAC's modifiers by table codeword.
#[rustfmt::skip]
const EAC_MODIFIERS: [[i32; 8]; 16] = [
    [-3, -6,  -9, -15, 2, 5, 8, 14], [-3, -7, -10, -13, 2, 6, 9, 12], [-2, -5, -8, -13, 1, 4, 7, 12], [-2, -4, -6, -13, 1, 3, 5, 12],
    [-3, -6,  -8, -12, 2, 5, 7, 11], [-3, -7,  -9, -11, 2, 6, 8, 10], [-4, -7, -8, -11, 3, 6, 7, 10], [-3, -5, -8, -11, 2, 4, 7, 10],
    [-2, -6,  -8, -10, 1, 5, 7,  9], [-2, -5,  -8, -10, 1, 4, 7,  9], [-2, -4, -8, -10, 1, 3, 7,  9], [-2, -5, -7, -10, 1, 4, 6,  9],
    [-3, -4,  -7, -10, 2, 3, 6,  9], [-1, -2,  -3, -10, 0, 1, 2,  9], [-4, -6, -8,  -9, 3, 5, 7,  8], [-3, -5, -7,  -9, 2, 4, 6,  8],
];

/// Bits `high` down to `low`.
fn field(block: u64, high: u32, low: u32) -> i32 {
    (block >> low & (u64::MAX >> (63 - (high - low)))) as i32
}

/// Texels are numbered by columns.
fn texel_number(i: usize) -> u32 {
    let (x, y) = (i % 4, i / 4);
    (4 * x + y) as u32
}

/// A texel's two bits.
fn index_of(block: u64, i: usize) -> usize {
    let number = texel_number(i);
    (block >> (16 + number) & 1) as usize * 2 + (block >> number & 1) as usize
}

fn moved(color: [i32; 3], by: i32) -> [u8; 3] {
    color.map(|value| (value + by).clamp(0, 255) as u8)
}

/// Blocks of colours. `punch_through`: bit 33 says whether all texels are opaque, instead of
/// choosing the individual mode.
pub(super) fn rgb(block: u64, punch_through: bool, is_srgb: bool, texels: &mut [Texel]) {
    let block = block.swap_bytes();
    let bit33 = field(block, 33, 33) != 0;
    let is_opaque = !punch_through || bit33;
    let is_differential = punch_through || bit33;
    // Five bits each, and what the second colour's differ by: three bits with a sign.
    let base = [
        field(block, 63, 59),
        field(block, 55, 51),
        field(block, 47, 43),
    ];
    let step = [
        field(block, 58, 56),
        field(block, 50, 48),
        field(block, 42, 40),
    ];
    let second: [i32; 3] = std::array::from_fn(|i| base[i] + (step[i] << 29 >> 29));
    let is_outside = second.map(|value| !(0..32).contains(&value));
    let colors = match is_differential {
        true if is_outside[0] => Paint::Four(t_mode(block)),
        true if is_outside[1] => Paint::Four(h_mode(block)),
        true if is_outside[2] => return planar(block, is_srgb, texels),
        true => Paint::Halves([base, second].map(|color| color.map(|v| v << 3 | v >> 2))),
        false => {
            let four = |at: u32| {
                [
                    field(block, 63 - at, 60 - at),
                    field(block, 55 - at, 52 - at),
                    field(block, 47 - at, 44 - at),
                ]
            };
            Paint::Halves([four(0), four(4)].map(|color| color.map(|v| v * 17)))
        }
    };
    let flipped = field(block, 32, 32) != 0;
    let tables = [field(block, 39, 37), field(block, 36, 34)];
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        let index = index_of(block, i);
        if !is_opaque && index == 2 {
            *texel = [0; 4];
            continue;
        }
        let [r, g, b] = match &colors {
            Paint::Four(colors) => colors[index],
            Paint::Halves(colors) => {
                let half = (if flipped { i / 4 } else { i % 4 }) / 2;
                let [small, large] = MODIFIERS[tables[half] as usize];
                let by = match index {
                    0 if !is_opaque => 0,
                    0 => small,
                    1 => large,
                    2 => -small,
                    _ => -large,
                };
                moved(colors[half], by)
            }
        };
        *texel = bytes([r, g, b, 255], is_srgb);
    }
}

/// The colours that texels choose from.
enum Paint {
    /// One for each half of the block, which the index modifies.
    Halves([[i32; 3]; 2]),
    Four([[u8; 3]; 4]),
}

fn t_mode(block: u64) -> [[u8; 3]; 4] {
    let first = [
        field(block, 60, 59) << 2 | field(block, 57, 56),
        field(block, 55, 52),
        field(block, 51, 48),
    ];
    let second = [
        field(block, 47, 44),
        field(block, 43, 40),
        field(block, 39, 36),
    ];
    let [first, second] = [first, second].map(|color| color.map(|v| v * 17));
    let distance = DISTANCES[(field(block, 35, 34) << 1 | field(block, 32, 32)) as usize];
    [
        moved(first, 0),
        moved(second, distance),
        moved(second, 0),
        moved(second, -distance),
    ]
}

fn h_mode(block: u64) -> [[u8; 3]; 4] {
    let first = [
        field(block, 62, 59),
        field(block, 58, 56) << 1 | field(block, 52, 52),
        field(block, 51, 51) << 3 | field(block, 49, 47),
    ];
    let second = [
        field(block, 46, 43),
        field(block, 42, 39),
        field(block, 38, 35),
    ];
    // The order of the colours is the distance's last bit.
    let order = (first >= second) as i32;
    let code = field(block, 34, 34) << 2 | field(block, 32, 32) << 1 | order;
    let distance = DISTANCES[code as usize];
    let [first, second] = [first, second].map(|color| color.map(|v| v * 17));
    [
        moved(first, distance),
        moved(first, -distance),
        moved(second, distance),
        moved(second, -distance),
    ]
}

fn planar(block: u64, is_srgb: bool, texels: &mut [Texel]) {
    let six = |v: i32| v << 2 | v >> 4;
    let seven = |v: i32| v << 1 | v >> 6;
    let blue = field(block, 48, 48) << 5 | field(block, 44, 43) << 3 | field(block, 41, 39);
    let origin = [
        six(field(block, 62, 57)),
        seven(field(block, 56, 56) << 6 | field(block, 54, 49)),
        six(blue),
    ];
    let right = [
        six(field(block, 38, 34) << 1 | field(block, 32, 32)),
        seven(field(block, 31, 25)),
        six(field(block, 24, 19)),
    ];
    let below = [
        six(field(block, 18, 13)),
        seven(field(block, 12, 6)),
        six(field(block, 5, 0)),
    ];
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        let (x, y) = (i as i32 % 4, i as i32 / 4);
        let [r, g, b] = std::array::from_fn(|c| {
            let sum = x * (right[c] - origin[c]) + y * (below[c] - origin[c]) + 4 * origin[c] + 2;
            (sum >> 2).clamp(0, 255) as u8
        });
        *texel = bytes([r, g, b, 255], is_srgb);
    }
}

/// Alpha of 8 bits, then colours.
pub(super) fn rgba(alpha: u64, color: u64, is_srgb: bool, texels: &mut [Texel]) {
    rgb(color, false, is_srgb, texels);
    let block = alpha.swap_bytes();
    let (base, multiplier) = (field(block, 63, 56), field(block, 55, 52));
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        let value = (base + eac_modifier(block, i) * multiplier).clamp(0, 255);
        texel[3] = (value as f32 / 255.0).to_bits();
    }
}

fn eac_modifier(block: u64, i: usize) -> i32 {
    let low = 45 - 3 * texel_number(i);
    EAC_MODIFIERS[field(block, 51, 48) as usize][field(block, low + 2, low) as usize]
}

/// One or two components of 11 bits.
pub(super) fn eac(components: &[u64], signed: bool, texels: &mut [Texel]) {
    texels[..16].fill([0, 0, 0, ONE]);
    for (component, block) in components.iter().enumerate() {
        let block = block.swap_bytes();
        let base = field(block, 63, 56);
        // A multiplier of zero is an eighth.
        let multiplier = (field(block, 55, 52) * 8).max(1);
        for (i, texel) in texels[..16].iter_mut().enumerate() {
            let step = eac_modifier(block, i) * multiplier;
            let value = match signed {
                true => {
                    let base = i32::from(base as u8 as i8).max(-127);
                    (base * 8 + step).clamp(-1023, 1023) as f32 / 1023.0
                }
                false => (base * 8 + 4 + step).clamp(0, 2047) as f32 / 2047.0,
            };
            texel[component] = value.to_bits();
        }
    }
}
