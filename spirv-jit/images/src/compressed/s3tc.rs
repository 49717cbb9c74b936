//! BC1 to BC5 (Khronos Data Format specification, "S3TC Compressed Texture Image Formats" and "RGTC
//! Compressed Texture Image Formats"). Interpolated values are not rounded to 8 bits, but where the
//! sRGB transfer function follows.
#![forbid(unsafe_code)]

use super::{ONE, Texel};
use crate::srgb;

/// The fourth colour of a block with three.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Black {
    Opaque,
    Transparent,
    /// There are always four colours.
    Never,
}

/// Red, green and blue of 5, 6 and 5 bits.
fn rgb565(code: u64) -> [f32; 3] {
    let field = |shift: u32, most: u64| (code >> shift & most) as f32 / most as f32;
    [field(11, 31), field(5, 63), field(0, 31)]
}

fn words(color: [f32; 3], is_srgb: bool) -> [u32; 3] {
    color.map(|value| match is_srgb {
        true => srgb::decode((value * 255.0).round_ties_even() as u8).to_bits(),
        false => value.to_bits(),
    })
}

/// The colours of a block; alpha is 1 or 0.
pub(super) fn bc1(block: u64, black: Black, is_srgb: bool, texels: &mut [Texel]) {
    let (code0, code1) = (block & 0xffff, block >> 16 & 0xffff);
    let (c0, c1) = (rgb565(code0), rgb565(code1));
    // Divided last, so that equal ends give themselves.
    let mix =
        |a: f32, b: f32| -> [f32; 3] { std::array::from_fn(|i| (a * c0[i] + b * c1[i]) / (a + b)) };
    let has_four = code0 > code1 || black == Black::Never;
    let colors = match has_four {
        true => [c0, c1, mix(2.0, 1.0), mix(1.0, 2.0)],
        false => [c0, c1, mix(1.0, 1.0), [0.0; 3]],
    };
    let last_alpha = match !has_four && black == Black::Transparent {
        true => 0,
        false => ONE,
    };
    let alphas = [ONE, ONE, ONE, last_alpha];
    let colors = colors.map(|color| words(color, is_srgb));
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        let index = (block >> (32 + 2 * i) & 3) as usize;
        let [r, g, b] = colors[index];
        *texel = [r, g, b, alphas[index]];
    }
}

/// Four bits of alpha a texel, then colours.
pub(super) fn bc2(alpha: u64, color: u64, is_srgb: bool, texels: &mut [Texel]) {
    bc1(color, Black::Never, is_srgb, texels);
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        texel[3] = ((alpha >> (4 * i) & 15) as f32 / 15.0).to_bits();
    }
}

/// Interpolated alpha, then colours.
pub(super) fn bc3(alpha: u64, color: u64, is_srgb: bool, texels: &mut [Texel]) {
    bc1(color, Black::Never, is_srgb, texels);
    let alphas = ramp(alpha, false);
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        texel[3] = alphas[ramp_index(alpha, i)];
    }
}

/// Red alone.
pub(super) fn bc4(block: u64, signed: bool, texels: &mut [Texel]) {
    let reds = ramp(block, signed);
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        *texel = [reds[ramp_index(block, i)], 0, 0, ONE];
    }
}

/// Red and green.
pub(super) fn bc5(red: u64, green: u64, signed: bool, texels: &mut [Texel]) {
    bc4(red, signed, texels);
    let greens = ramp(green, signed);
    for (i, texel) in texels[..16].iter_mut().enumerate() {
        texel[1] = greens[ramp_index(green, i)];
    }
}

/// Which of the eight values a texel has.
fn ramp_index(block: u64, texel: usize) -> usize {
    (block >> (16 + 3 * texel) & 7) as usize
}

/// The eight values of a block of one component.
fn ramp(block: u64, signed: bool) -> [u32; 8] {
    let (byte0, byte1) = (block as u8, (block >> 8) as u8);
    let value = |byte: u8| match signed {
        // -128 is -1, too.
        true => f32::from((byte as i8).max(-127)) / 127.0,
        false => f32::from(byte) / 255.0,
    };
    let has_six = match signed {
        true => byte0 as i8 > byte1 as i8,
        false => byte0 > byte1,
    };
    let (a, b) = (value(byte0), value(byte1));
    let mix = |i: usize, steps: usize| ((steps - i) as f32 * a + i as f32 * b) / steps as f32;
    let values: [f32; 8] = std::array::from_fn(|index| match (index, has_six) {
        (0, _) => a,
        (1, _) => b,
        (_, true) => mix(index - 1, 7),
        (6, false) => match signed {
            true => -1.0,
            false => 0.0,
        },
        (7, false) => 1.0,
        (_, false) => mix(index - 1, 5),
    });
    values.map(f32::to_bits)
}
