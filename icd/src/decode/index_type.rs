//! Index types.

#![forbid(unsafe_code)]

use ash::vk;
use traversal::IndexType;

/// The index type; [`IndexType::None`] for invalid values.
pub fn index_type(ty: vk::IndexType) -> IndexType {
    match ty {
        vk::IndexType::UINT8_KHR => IndexType::U8,
        vk::IndexType::UINT16 => IndexType::U16,
        vk::IndexType::UINT32 => IndexType::U32,
        _ => IndexType::None,
    }
}
