//! The driver's answers to queries, as bytes.

use std::sync::Arc;

use ash::vk;
use vulkan_tuff::capabilities::extensions::ExtensionSet;
use vulkan_tuff::capabilities::limits::API_VERSION;
use vulkan_tuff::capabilities::{features, properties};
use vulkan_tuff::object::PhysicalDevice;
use vulkan_tuff::object::messenger::Messengers;

use crate::registry::Structure;

/// The byte that fills the driver's answer beforehand.
pub const UNTOUCHED: u8 = 0xAA;

/// Bytes of `sType` and `pNext`.
const HEAD_BYTES: usize = 16;

/// Larger than any structure of the registry.
const ROOM_BYTES: usize = 4096;

fn device() -> PhysicalDevice {
    PhysicalDevice::new(
        API_VERSION,
        Arc::new(Messengers::default()),
        ExtensionSet::default(),
    )
}

/// A structure, after `sType` and `pNext`, as the driver fills it; `None` if it is neither of
/// features nor of properties, or has pointers for the driver to write through.
pub fn answer(structure: &Structure) -> Option<Vec<u8>> {
    if structure.has_pointers {
        return None;
    }
    // SAFETY: the structure has no pointers.
    let bytes = unsafe { filled(structure, UNTOUCHED) }?;
    Some(bytes[HEAD_BYTES..].to_vec())
}

/// A structure as the driver fills it, its pointers null and its counts zero, and zeros if the
/// driver does not know it; `None` if it is neither of features nor of properties.
pub fn chained(structure: &Structure) -> Option<Vec<u8>> {
    // SAFETY: the structure's pointers are null.
    unsafe { filled(structure, 0) }
}

/// # Safety
/// The structure has no pointers, or the byte is zero.
unsafe fn filled(structure: &Structure, byte: u8) -> Option<Vec<u8>> {
    let extends = |what: &str| structure.extends.iter().any(|name| name == what);
    let mut room = vec![u64::from_ne_bytes([byte; 8]); ROOM_BYTES / 8];
    let head = room.as_mut_ptr().cast::<vk::BaseOutStructure<'_>>();
    // SAFETY: the room is larger than any structure of the registry, and begins with a type and a
    // null pointer. A driver that knows the type fills it in.
    unsafe {
        (*head).s_type = vk::StructureType::from_raw(structure.ty);
        (*head).p_next = std::ptr::null_mut();
        if extends("VkPhysicalDeviceFeatures2") {
            features::fill_chain(head.cast());
        } else if extends("VkPhysicalDeviceProperties2") {
            properties::fill_chain(&device().machine(), head.cast());
        } else {
            return None;
        }
    }
    Some(bytes_of(&room))
}

/// `VkPhysicalDeviceFeatures`.
pub fn core_features() -> Vec<u8> {
    plain(features::core_features())
}

/// `VkPhysicalDeviceProperties`.
pub fn core_properties() -> Vec<u8> {
    plain(properties::core(&device().machine()))
}

/// The bytes of a structure of Vulkan 1.0.
fn plain<T: Copy>(structure: T) -> Vec<u8> {
    assert!(size_of::<T>() <= ROOM_BYTES && align_of::<T>() <= align_of::<u64>());
    let mut room = vec![0u64; ROOM_BYTES / 8];
    // SAFETY: the room is large enough, and aligned.
    unsafe { room.as_mut_ptr().cast::<T>().write(structure) };
    bytes_of(&room)
}

fn bytes_of(words: &[u64]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_ne_bytes()).collect()
}
