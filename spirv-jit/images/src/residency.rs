//! Residency: which texels of a sparse image have memory (Vulkan specification, "Sparse Residency";
//! `OpImageSparse*` of SPIR-V).
#![forbid(unsafe_code)]

use std::cell::Cell;

use lanes::{LANES, Row};

use super::ImageDescriptor;
use super::format::FormatInfo;
use super::format::block::{Offsets, each_lane};

/// Whether all of some bytes, by their address and their number, have memory.
pub type IsBound<'a> = dyn Fn(u64, u64) -> bool + 'a;

/// Collects the lanes that read a texel without memory.
pub struct Residency<'a> {
    is_bound: &'a IsBound<'a>,
    missing: Cell<u16>,
}

impl<'a> Residency<'a> {
    pub fn new(is_bound: &'a IsBound<'a>) -> Self {
        Self {
            is_bound,
            missing: Cell::new(0),
        }
    }

    /// Checks a texel at an offset into the image in each of some lanes.
    pub(super) fn check(
        &self,
        image: &ImageDescriptor,
        info: &FormatInfo,
        offsets: &Offsets,
        lanes: u16,
    ) {
        each_lane(lanes & !self.missing.get(), |lane| {
            let address = (image.data as u64).wrapping_add(offsets[lane]);
            if !(self.is_bound)(address, u64::from(info.size_bytes)) {
                self.missing.set(self.missing.get() | 1 << lane);
            }
        });
    }

    /// The lanes' residency codes: 1 where all texels have memory, else 0.
    pub fn codes(&self) -> Row {
        let missing = self.missing.get();
        std::array::from_fn::<u32, LANES, _>(|lane| u32::from(missing >> lane & 1 == 0))
    }
}
