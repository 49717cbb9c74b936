//! Texel formats: the numbering is `VkFormat`'s.
//!
//! * [`table`] lists the formats, [`layout`] reads from a format's name where its components lie,
//!   [`codec`] turns texels into words and back, [`block`] does so for 16 lanes.
//!
//! **Depth and stencil.** An image of a format with both is stored as two planes, each laid out
//! like an image of that plane's own format ([`Format::plane`]): a view or copy addresses one
//! aspect, and is handed the plane's format and memory.

pub mod block;
mod codec;
pub mod layout;
pub mod small_float;
mod table;
#[cfg(test)]
mod tests;

pub use layout::{Aspect, FormatInfo, Numeric};

/// A texel format, by its `VkFormat` value (spec, chapter Formats).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(transparent)]
pub struct Format(pub u32);

/// Largest texel, in bytes.
pub const MAX_TEXEL_BYTES: usize = 32;

/// Formats `1..=CORE_COUNT` stand in the table at their number less one.
const CORE_COUNT: u32 = 184;

impl FormatInfo {
    /// The format with the same layout that reads the codes of an sRGB format as normalized
    /// numbers; of any other format, itself.
    pub fn codes(&'static self) -> &'static FormatInfo {
        let Some((before, after)) = self.name.split_once("SRGB") else {
            return self;
        };
        let is_twin = |it: &&FormatInfo| {
            let rest = it.name.strip_prefix(before);
            rest.and_then(|rest| rest.strip_prefix("UNORM")) == Some(after)
        };
        let all = table::FORMATS.iter().map(|(_, info)| info);
        all.into_iter().find(is_twin).unwrap_or(self)
    }
}

impl Format {
    pub const UNDEFINED: Format = Format(0);

    /// The description of the format; `None` for `UNDEFINED` and unsupported formats.
    pub fn info(self) -> Option<&'static FormatInfo> {
        if self.0.wrapping_sub(1) < CORE_COUNT {
            return Some(&table::FORMATS[self.0 as usize - 1].1);
        }
        table::FORMATS[CORE_COUNT as usize..]
            .iter()
            .find(|(number, _)| *number == self.0)
            .map(|(_, info)| info)
    }

    /// Every format there is.
    pub fn all() -> impl Iterator<Item = Format> {
        table::FORMATS.iter().map(|(number, _)| Format(*number))
    }

    /// Size of a texel or, in compressed formats, a block, in bytes (of one plane's, for a format
    /// with depth and stencil: see [`Format::plane`]); 0 if the format does not exist.
    pub fn size_bytes(self) -> usize {
        self.info().map_or(0, |info| info.size_bytes as usize)
    }

    /// The format of the plane that stores an aspect; `None` if the format lacks the aspect.
    ///
    /// Also the texels of a buffer in a copy of that aspect (spec, "Copying Depth/Stencil Images":
    /// tightly packed, D24 in the low bits of 32).
    pub fn plane(self, aspect: Aspect) -> Option<Format> {
        let info = self.info()?;
        match aspect {
            Aspect::Color => info.is_color().then_some(self),
            Aspect::Stencil => info.has_stencil.then_some(Format::S8_UINT),
            Aspect::Depth if !info.has_depth => None,
            Aspect::Depth => Some(match self {
                Format::D16_UNORM_S8_UINT => Format::D16_UNORM,
                Format::D24_UNORM_S8_UINT => Format::X8_D24_UNORM_PACK32,
                Format::D32_SFLOAT_S8_UINT => Format::D32_SFLOAT,
                other => other,
            }),
        }
    }
}
