//! `VK_EXT_debug_utils` on devices, queues and command buffers.

use ash::vk;

use crate::ffi::{self, commands, entry};
use crate::handle::from_handle;
use crate::object::Device;

entry! {
    fn vkSetDebugUtilsObjectNameEXT(device: vk::Device, info: *const vk::DebugUtilsObjectNameInfoEXT) -> vk::Result {
        let info = &*info;
        let name = ffi::string(info.p_object_name).to_string_lossy().into_owned();
        from_handle::<Device>(device).set_object_name(info.object_handle, name);
        Ok(())
    }

    fn vkSetDebugUtilsObjectTagEXT(_device: vk::Device, _info: *const vk::DebugUtilsObjectTagInfoEXT) -> vk::Result {
        // Tags are for layers and tools; messages of the driver say names.
        Ok(())
    }

    fn vkQueueBeginDebugUtilsLabelEXT(_queue: vk::Queue, _label: *const vk::DebugUtilsLabelEXT) {
        // Labels, here and below, are for layers and tools.
    }

    fn vkQueueEndDebugUtilsLabelEXT(_queue: vk::Queue) {}

    fn vkQueueInsertDebugUtilsLabelEXT(_queue: vk::Queue, _label: *const vk::DebugUtilsLabelEXT) {}
}

commands! {
    fn vkCmdBeginDebugUtilsLabelEXT(recording, _label: *const vk::DebugUtilsLabelEXT) {
        let _ = recording;
        Ok(())
    }

    fn vkCmdEndDebugUtilsLabelEXT(recording) {
        let _ = recording;
        Ok(())
    }

    fn vkCmdInsertDebugUtilsLabelEXT(recording, _label: *const vk::DebugUtilsLabelEXT) {
        let _ = recording;
        Ok(())
    }
}
