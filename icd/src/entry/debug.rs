//! `VK_EXT_debug_utils` on objects: names and tags are for layers and tools, which see them on the way here.

use ash::vk;

use super::define::entry;

entry! {
    fn vkSetDebugUtilsObjectNameEXT(_device: vk::Device, _info: *const vk::DebugUtilsObjectNameInfoEXT) -> vk::Result {
        Ok(())
    }

    fn vkSetDebugUtilsObjectTagEXT(_device: vk::Device, _info: *const vk::DebugUtilsObjectTagInfoEXT) -> vk::Result {
        Ok(())
    }
}
