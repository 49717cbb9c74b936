//! The stored form of samplers that programs embed (`VK_EXT_descriptor_heap`). A loaded program has
//! no other description of them.

#![forbid(unsafe_code)]

use images::{AddressMode, CompareOp, Filter, Reduction, SamplerDescriptor};

/// Words of an embedded sampler: its number, and a word for each of its parameters.
const WORDS: usize = 20;

/// Bytes of an embedded sampler in data.
pub const STORED_BYTES: usize = 4 * WORDS;

/// The stored form of an embedded sampler.
pub type EmbeddedSampler = [u8; STORED_BYTES];

const FILTERS: [Filter; 2] = [Filter::Nearest, Filter::Linear];

const ADDRESS_MODES: [AddressMode; 5] = [
    AddressMode::Repeat,
    AddressMode::MirroredRepeat,
    AddressMode::ClampToEdge,
    AddressMode::ClampToBorder,
    AddressMode::MirrorClampToEdge,
];

const COMPARE_OPS: [CompareOp; 8] = [
    CompareOp::Never,
    CompareOp::Less,
    CompareOp::Equal,
    CompareOp::LessOrEqual,
    CompareOp::Greater,
    CompareOp::NotEqual,
    CompareOp::GreaterOrEqual,
    CompareOp::Always,
];

const REDUCTIONS: [Reduction; 3] = [Reduction::WeightedAverage, Reduction::Min, Reduction::Max];

/// Encodes a sampler and its number.
pub fn encode(number: u32, sampler: &SamplerDescriptor) -> EmbeddedSampler {
    let s = sampler;
    let [u, v, w] = s.address_mode.map(|mode| mode as u32);
    let [red, green, blue, alpha] = s.border_color;
    let words: [u32; WORDS] = [
        number,
        s.mag_filter as u32,
        s.min_filter as u32,
        s.mipmap_mode as u32,
        u,
        v,
        w,
        s.mip_lod_bias.to_bits(),
        s.min_lod.to_bits(),
        s.max_lod.to_bits(),
        s.max_anisotropy.to_bits(),
        s.compare.is_some().into(),
        s.compare.unwrap_or(CompareOp::Never) as u32,
        s.reduction as u32,
        red,
        green,
        blue,
        alpha,
        s.unnormalized_coordinates.into(),
        s.non_seamless.into(),
    ];
    let mut bytes = [0; STORED_BYTES];
    for (to, word) in bytes.as_chunks_mut().0.iter_mut().zip(words) {
        *to = word.to_le_bytes();
    }
    bytes
}

/// Decodes the number and the sampler; `None` for data that [`encode`] cannot produce.
pub fn decode(bytes: &EmbeddedSampler) -> Option<(u32, SamplerDescriptor)> {
    let mut words = bytes.as_chunks().0.iter().copied().map(u32::from_le_bytes);
    let mut word = || words.next();
    fn one<T: Copy>(all: &[T], word: u32) -> Option<T> {
        all.get(word as usize).copied()
    }
    let number = word()?;
    let filters = [word()?, word()?, word()?];
    let modes = [word()?, word()?, word()?];
    let floats = [word()?, word()?, word()?, word()?].map(f32::from_bits);
    let (compares, compare) = (one(&[false, true], word()?)?, one(&COMPARE_OPS, word()?)?);
    let sampler = SamplerDescriptor {
        mag_filter: one(&FILTERS, filters[0])?,
        min_filter: one(&FILTERS, filters[1])?,
        mipmap_mode: one(&FILTERS, filters[2])?,
        address_mode: [
            one(&ADDRESS_MODES, modes[0])?,
            one(&ADDRESS_MODES, modes[1])?,
            one(&ADDRESS_MODES, modes[2])?,
        ],
        mip_lod_bias: floats[0],
        min_lod: floats[1],
        max_lod: floats[2],
        max_anisotropy: floats[3],
        compare: compares.then_some(compare),
        reduction: one(&REDUCTIONS, word()?)?,
        border_color: [word()?, word()?, word()?, word()?],
        unnormalized_coordinates: one(&[false, true], word()?)?,
        non_seamless: one(&[false, true], word()?)?,
    };
    Some((number, sampler))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samplers_are_read_as_they_were_stored() {
        let sampler = SamplerDescriptor {
            min_filter: Filter::Linear,
            address_mode: [
                AddressMode::MirrorClampToEdge,
                AddressMode::Repeat,
                AddressMode::ClampToBorder,
            ],
            max_lod: 7.5,
            compare: Some(CompareOp::Always),
            reduction: Reduction::Max,
            border_color: [1, 2, 3, u32::MAX],
            non_seamless: true,
            ..SamplerDescriptor::DEFAULT
        };
        let stored = encode(9, &sampler);
        assert_eq!(decode(&stored), Some((9, sampler)));
        // Invalid enumerators and booleans.
        for word in [1, 2, 3, 4, 5, 6, 11, 12, 13, 18, 19] {
            let mut wrong = stored;
            wrong[4 * word] = 8;
            assert_eq!(decode(&wrong), None, "word {word}");
        }
    }
}
