//! BC6H and BC7 (Khronos Data Format specification, "BPTC Compressed Texture Image Formats"), whose
//! arithmetic is whole numbers: `bcdec_rs` does it.
#![forbid(unsafe_code)]

use lanes::halves;

use super::{ONE, Texel, bytes};

/// Half floats of red, green and blue. Reserved modes give zeros.
pub(super) fn bc6h(block: u128, signed: bool, texels: &mut [Texel]) {
    let mut halves = [0; 3 * 16];
    bcdec_rs::bc6h_half(&block.to_le_bytes(), &mut halves, 3 * 4, signed);
    for (texel, rgb) in texels.iter_mut().zip(halves.chunks_exact(3)) {
        let word = |half: u16| halves::half_to_f32(half).to_bits();
        *texel = [word(rgb[0]), word(rgb[1]), word(rgb[2]), ONE];
    }
}

/// Four codes of 8 bits. The reserved mode gives zeros.
pub(super) fn bc7(block: u128, is_srgb: bool, texels: &mut [Texel]) {
    let mut codes = [0; 4 * 16];
    bcdec_rs::bc7(&block.to_le_bytes(), &mut codes, 4 * 4);
    for (texel, rgba) in texels.iter_mut().zip(codes.chunks_exact(4)) {
        *texel = bytes([rgba[0], rgba[1], rgba[2], rgba[3]], is_srgb);
    }
}
