//! `VK_EXT_debug_utils` on objects. Shaders and pipelines keep their names for fault reports, and
//! the timeline keeps all names. Tags are for layers and tools, which intercept them before the
//! driver.

use ash::vk::{self, Handle};

use crate::ffi::string;
use crate::guard::guard_result;
use crate::handle::from_handle;
use crate::object::{AccelerationStructure, Pipeline, ShaderModule, ShaderObject};
use crate::timeline;

pub(crate) unsafe extern "system" fn vkSetDebugUtilsObjectNameEXT(
    _device: vk::Device,
    info: *const vk::DebugUtilsObjectNameInfoEXT,
) -> vk::Result {
    guard_result("vkSetDebugUtilsObjectNameEXT", move || {
        let info = &*info;
        let name = match info.p_object_name.is_null() {
            true => Default::default(),
            false => string(info.p_object_name).to_string_lossy(),
        };
        match info.object_type {
            vk::ObjectType::SHADER_MODULE => {
                let module = vk::ShaderModule::from_raw(info.object_handle);
                from_handle::<ShaderModule>(module).name.set(&name);
            }
            vk::ObjectType::PIPELINE => {
                let pipeline = vk::Pipeline::from_raw(info.object_handle);
                from_handle::<Pipeline>(pipeline).set_name(&name);
            }
            vk::ObjectType::SHADER_EXT => {
                let shader = vk::ShaderEXT::from_raw(info.object_handle);
                if let Some(origin) = from_handle::<ShaderObject>(shader).program.origin() {
                    origin.name.set(&name);
                }
            }
            vk::ObjectType::ACCELERATION_STRUCTURE_KHR if timeline::is_on() => {
                let structure = vk::AccelerationStructureKHR::from_raw(info.object_handle);
                let structure = from_handle::<AccelerationStructure>(structure);
                timeline::name_object(structure.storage().address, &name);
            }
            _ => {}
        }
        timeline::name_object(info.object_handle, &name);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkSetDebugUtilsObjectTagEXT(
    _device: vk::Device,
    _info: *const vk::DebugUtilsObjectTagInfoEXT,
) -> vk::Result {
    vk::Result::SUCCESS
}
