//! 16-bit floats by their bits.

#![forbid(unsafe_code)]

/// f16 bits to f32, exactly; branch-free, so that a loop over it vectorises.
#[inline(always)]
pub fn half_to_f32(half: u16) -> f32 {
    let magnitude = (half as u32 & 0x7fff) << 13;
    // Rebias by a product: it also normalises subnormals, exactly.
    let rebiased = (f32::from_bits(magnitude) * f32::from_bits(0x7780_0000)).to_bits();
    let is_special = magnitude >= 0x0f80_0000;
    let bits = if is_special {
        magnitude | 0x7f80_0000
    } else {
        rebiased
    };
    f32::from_bits(bits | (half as u32 & 0x8000) << 16)
}

/// f32 to f16 bits, round to nearest even; overflow gives infinity; NaN stays NaN.
#[inline]
pub fn f32_to_half(value: f32) -> u16 {
    half::f16::from_f32_const(value).to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_half_decodes_as_ieee_says() {
        for bits in 0..=u16::MAX {
            let expected = half::f16::from_bits(bits).to_f32();
            let value = half_to_f32(bits);
            assert!(value.to_bits() == expected.to_bits() || value.is_nan() && expected.is_nan());
        }
    }
}
