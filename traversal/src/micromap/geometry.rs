//! The opacity references of a geometry's triangles.

use super::{FIRST_SPECIAL, Opacity};

use crate::layout::micromap_reference;
use crate::memory::{IndexType, Memory};

/// How the triangles of a geometry find their opacity
/// (`VkAccelerationStructureTrianglesOpacityMicromapEXT`).
#[derive(Clone, Copy, Debug)]
pub struct GeometryMicromap {
    /// Type of `indices`; without indices, triangle `i` of the geometry has index `i`.
    pub index_type: IndexType,
    /// An index for each triangle of the geometry.
    pub indices: Memory,
    /// Stride of the indices in bytes; may be 0.
    pub index_stride_bytes: u64,
    /// Added to each index that is not special.
    pub base_triangle: u32,
    /// Address of a built micromap, or 0 if all indices are special.
    pub micromap: u64,
    /// Whether serialized structures list that address, which the application replaces
    /// (`VK_KHR_opacity_micromap`), instead of containing the micromap.
    pub listed: bool,
}

impl GeometryMicromap {
    /// The word that a bottom level keeps for the geometry.
    pub(crate) fn reference(&self) -> u64 {
        match self.listed && self.micromap != 0 {
            true => self.micromap | micromap_reference::LISTED,
            false => self.micromap,
        }
    }

    /// The micromap's triangle for the geometry's triangle `index`; `None` if one state applies to
    /// the whole triangle.
    ///
    /// # Safety
    /// The memory of the indices is readable and unchanged.
    pub unsafe fn triangle(&self, index: u32) -> Option<u32> {
        // SAFETY: the caller guarantees that the memory of the indices is readable and unchanged.
        let word = unsafe { self.word(index) };
        (word < FIRST_SPECIAL).then_some(word)
    }

    /// The word that a bottom level keeps for triangle `index`. Without an index, a shader decides.
    ///
    /// # Safety
    /// The memory of the indices is readable and unchanged.
    pub(crate) unsafe fn word(&self, index: u32) -> u32 {
        let offset = u64::from(index).checked_mul(self.index_stride_bytes);
        // SAFETY: the caller guarantees that the memory of the indices is readable and unchanged.
        // Special indices are cast to the type.
        let read = || unsafe {
            Some(match self.index_type {
                IndexType::None => index,
                IndexType::U8 => match self.indices.read::<1>(offset?)?[0] {
                    special @ 0xFC.. => special as i8 as u32,
                    index => index.into(),
                },
                IndexType::U16 => match u16::from_le_bytes(self.indices.read(offset?)?) {
                    special @ 0xFFFC.. => special as i16 as u32,
                    index => index.into(),
                },
                IndexType::U32 => u32::from_le_bytes(self.indices.read(offset?)?),
            })
        };
        let unknown = !(Opacity::UnknownOpaque as u32);
        match read() {
            Some(special @ FIRST_SPECIAL..) if self.index_type != IndexType::None => special,
            Some(index) => (index.checked_add(self.base_triangle))
                .filter(|&index| index < FIRST_SPECIAL)
                .unwrap_or(unknown),
            None => unknown,
        }
    }
}
