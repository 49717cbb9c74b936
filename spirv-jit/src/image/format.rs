//! Texel formats: the numbering is `VkFormat`'s.

/// A texel format, by its `VkFormat` value (spec, chapter Formats).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(transparent)]
pub struct Format(pub u32);

impl Format {
    pub const UNDEFINED: Format = Format(0);
}
