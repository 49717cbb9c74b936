//! Block-compressed formats: BC1 to BC7, ETC2 and EAC, ASTC of the LDR profile (Khronos Data Format
//! specification, the chapters "Compressed Texture Image Formats").
//!
//! A block is decoded as a whole and kept for the next texel: each thread keeps a few blocks by
//! their *contents*, so cached blocks stay right while other threads write the image.
#![forbid(unsafe_code)]

mod astc;
mod bptc;
mod etc;
mod s3tc;
#[cfg(test)]
mod tests;

use std::cell::RefCell;

use crate::srgb;

/// How a block is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Scheme {
    /// BC1 whose punch-through texels are opaque black.
    Bc1Rgb,
    Bc1Rgba,
    Bc2,
    Bc3,
    Bc4,
    Bc4Signed,
    Bc5,
    Bc5Signed,
    Bc6h,
    Bc6hSigned,
    Bc7,
    Etc2Rgb,
    /// With punch-through alpha.
    Etc2RgbA1,
    Etc2Rgba,
    EacR,
    EacRSigned,
    EacRg,
    EacRgSigned,
    Astc,
}

/// The blocks of a compressed format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Blocks {
    pub scheme: Scheme,
    /// Texels of a block.
    pub width: u8,
    pub height: u8,
    /// Red, green and blue are codes of the sRGB transfer function.
    pub srgb: bool,
}

/// Most texels of a block: ASTC's 12×12.
const MOST_TEXELS: usize = 144;
/// Bytes of the largest block.
pub const MAX_BLOCK_BYTES: usize = 16;

/// A texel as four words: f32 bits.
type Texel = [u32; 4];

/// Bits of 1.0.
const ONE: u32 = 1f32.to_bits();

impl Blocks {
    /// Whether it is one of BC1 to BC7.
    pub const fn is_bc(self) -> bool {
        (self.scheme as u8) < Scheme::Etc2Rgb as u8
    }

    /// The texels of a block, row by row. Blocks of 8 bytes stand in the low half.
    pub fn decode(self, block: u128, texels: &mut [Texel]) {
        let low = block as u64;
        let high = (block >> 64) as u64;
        match self.scheme {
            Scheme::Bc1Rgb => s3tc::bc1(low, s3tc::Black::Opaque, self.srgb, texels),
            Scheme::Bc1Rgba => s3tc::bc1(low, s3tc::Black::Transparent, self.srgb, texels),
            Scheme::Bc2 => s3tc::bc2(low, high, self.srgb, texels),
            Scheme::Bc3 => s3tc::bc3(low, high, self.srgb, texels),
            Scheme::Bc4 => s3tc::bc4(low, false, texels),
            Scheme::Bc4Signed => s3tc::bc4(low, true, texels),
            Scheme::Bc5 => s3tc::bc5(low, high, false, texels),
            Scheme::Bc5Signed => s3tc::bc5(low, high, true, texels),
            Scheme::Bc6h => bptc::bc6h(block, false, texels),
            Scheme::Bc6hSigned => bptc::bc6h(block, true, texels),
            Scheme::Bc7 => bptc::bc7(block, self.srgb, texels),
            Scheme::Etc2Rgb => etc::rgb(low, false, self.srgb, texels),
            Scheme::Etc2RgbA1 => etc::rgb(low, true, self.srgb, texels),
            Scheme::Etc2Rgba => etc::rgba(low, high, self.srgb, texels),
            Scheme::EacR => etc::eac(&[low], false, texels),
            Scheme::EacRSigned => etc::eac(&[low], true, texels),
            Scheme::EacRg => etc::eac(&[low, high], false, texels),
            Scheme::EacRgSigned => etc::eac(&[low, high], true, texels),
            Scheme::Astc => {
                astc::decode(block, [self.width, self.height], self.srgb, texels);
            }
        }
    }

    /// One texel of a block, by its index in the block.
    #[inline]
    pub fn texel(self, block: u128, index: usize) -> Texel {
        let count = self.width as usize * self.height as usize;
        thread_local! {
            static SMALL: RefCell<Cache<64, 16>> = const { RefCell::new(Cache::new()) };
            static LARGE: RefCell<Cache<32, MOST_TEXELS>> = const { RefCell::new(Cache::new()) };
        }
        if count <= 16 {
            SMALL.with_borrow_mut(|cache| cache.texel(self, block, index))
        } else {
            LARGE.with_borrow_mut(|cache| cache.texel(self, block, index))
        }
    }
}

/// Decoded blocks, by a hash of what they were decoded from.
struct Cache<const SLOTS: usize, const TEXELS: usize> {
    slots: Option<Box<[Slot<TEXELS>]>>,
}

#[derive(Clone, Copy)]
struct Slot<const TEXELS: usize> {
    of: Option<(Blocks, u128)>,
    texels: [Texel; TEXELS],
}

impl<const SLOTS: usize, const TEXELS: usize> Cache<SLOTS, TEXELS> {
    const fn new() -> Self {
        Self { slots: None }
    }

    #[inline]
    fn texel(&mut self, blocks: Blocks, block: u128, index: usize) -> Texel {
        let empty = Slot {
            of: None,
            texels: [[0; 4]; TEXELS],
        };
        let slots = self
            .slots
            .get_or_insert_with(|| vec![empty; SLOTS].into_boxed_slice());
        let folded = block as u64 ^ (block >> 64) as u64;
        let hash = folded.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56;
        let slot = &mut slots[hash as usize % SLOTS];
        if slot.of != Some((blocks, block)) {
            blocks.decode(block, &mut slot.texels);
            slot.of = Some((blocks, block));
        }
        slot.texels[index % TEXELS]
    }
}

/// Codes of 8 bits as a texel.
fn bytes(rgba: [u8; 4], is_srgb: bool) -> Texel {
    let unorm = |code: u8| (code as f32 / 255.0).to_bits();
    let [r, g, b] = [rgba[0], rgba[1], rgba[2]].map(|code| match is_srgb {
        true => srgb::decode(code).to_bits(),
        false => unorm(code),
    });
    [r, g, b, unorm(rgba[3])]
}
