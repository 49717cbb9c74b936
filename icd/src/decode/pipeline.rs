//! `VkPipelineShaderStageCreateInfo` to an owned [`ShaderStage`].

use std::ffi::c_char;
use std::sync::Arc;

use ash::vk;
use spirv_jit::origin::Name;
use spirv_jit::program::Stage;

use crate::VkResult;
use crate::ffi::{find, slice, string};
use crate::handle;
use crate::object::ShaderModule;
use crate::object::shader_stage::ShaderStage;

/// A pipeline's creation flags: those of the chained `VkPipelineCreateFlags2CreateInfo` instead,
/// where there is one. Bits above the lower 32 ask for nothing here.
///
/// # Safety
/// The chain is valid.
pub unsafe fn create_flags(
    flags: vk::PipelineCreateFlags,
    next: *const std::ffi::c_void,
) -> vk::PipelineCreateFlags {
    // SAFETY: the caller's promise.
    let chained = unsafe { find::<vk::PipelineCreateFlags2CreateInfoKHR<'_>>(next) };
    chained.map_or(flags, |chained| {
        vk::PipelineCreateFlags::from_raw(chained.flags.as_raw() as u32)
    })
}

/// Copies a stage: its words are shared with the module, or taken from the chained create info
/// where there is none (`VK_EXT_graphics_pipeline_library`, maintenance5).
///
/// # Errors
/// `VK_ERROR_UNKNOWN` for a stage that is not advertised, an entry point name that is not UTF-8, or
/// no module at all.
///
/// # Safety
/// The info is valid and its module alive.
pub unsafe fn decode_stage(info: &vk::PipelineShaderStageCreateInfo<'_>) -> VkResult<ShaderStage> {
    // SAFETY: the caller's promise.
    unsafe {
        let (words, name) = match handle::optional::<ShaderModule>(info.module) {
            Some(module) => (Arc::clone(&module.words), Arc::clone(&module.name)),
            None => {
                let module = find::<vk::ShaderModuleCreateInfo>(info.p_next)
                    .ok_or(vk::Result::ERROR_UNKNOWN)?;
                let words: Arc<[u32]> = slice(module.p_code, (module.code_size / 4) as u32).into();
                (words, chained_name(info.p_next))
            }
        };
        Ok(ShaderStage {
            words,
            name,
            entry_point: entry_point(info.p_name)?,
            stage: program_stage(info.stage).ok_or(vk::Result::ERROR_UNKNOWN)?,
            specialization: specialization(info.p_specialization_info),
            view_index_is_device_index: false,
        })
    }
}

/// # Safety
/// The name is a string.
unsafe fn entry_point(name: *const c_char) -> VkResult<String> {
    // SAFETY: the caller's promise.
    let name = unsafe { string(name) }.to_str();
    Ok(name.map_err(|_| vk::Result::ERROR_UNKNOWN)?.to_owned())
}

/// The name that a `VkDebugUtilsObjectNameInfoEXT` in a chain gives to the shader module of a
/// stage.
///
/// # Safety
/// The chain is valid.
unsafe fn chained_name(next: *const std::ffi::c_void) -> Arc<Name> {
    let name = Arc::<Name>::default();
    // SAFETY: the caller's promise; a name is a string or null.
    unsafe {
        let info = find::<vk::DebugUtilsObjectNameInfoEXT<'_>>(next);
        if let Some(info) = info.filter(|info| !info.p_object_name.is_null()) {
            name.set(&string(info.p_object_name).to_string_lossy());
        }
    }
    name
}

/// Copies the shader of a `VkShaderCreateInfoEXT` in SPIR-V.
///
/// # Errors
/// As [`decode_stage`].
///
/// # Safety
/// The info is valid.
pub unsafe fn decode_shader(info: &vk::ShaderCreateInfoEXT<'_>) -> VkResult<ShaderStage> {
    let words = u32::try_from(info.code_size / 4);
    let words = words.map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
    // SAFETY: the caller's promise.
    unsafe {
        Ok(ShaderStage {
            words: slice(info.p_code.cast::<u32>(), words).into(),
            name: Arc::default(),
            entry_point: entry_point(info.p_name)?,
            stage: program_stage(info.stage).ok_or(vk::Result::ERROR_UNKNOWN)?,
            specialization: specialization(info.p_specialization_info),
            view_index_is_device_index: false,
        })
    }
}

/// # Safety
/// The info is null or valid.
unsafe fn specialization(info: *const vk::SpecializationInfo<'_>) -> Vec<(u32, Vec<u8>)> {
    // SAFETY: the caller's promise; an entry outside the data is dropped.
    unsafe {
        let Some(info) = info.as_ref() else {
            return Vec::new();
        };
        let data: &[u8] = slice(info.p_data.cast(), info.data_size as u32);
        slice(info.p_map_entries, info.map_entry_count)
            .iter()
            .filter_map(|entry| {
                let start = entry.offset as usize;
                let bytes = data.get(start..start.checked_add(entry.size)?)?;
                Some((entry.constant_id, bytes.to_vec()))
            })
            .collect()
    }
}

/// The stage of a program; none of a stage that does not exist here.
pub fn program_stage(stage: vk::ShaderStageFlags) -> Option<Stage> {
    Some(match stage {
        vk::ShaderStageFlags::COMPUTE => Stage::Compute,
        vk::ShaderStageFlags::RAYGEN_KHR => Stage::RayGeneration,
        vk::ShaderStageFlags::INTERSECTION_KHR => Stage::Intersection,
        vk::ShaderStageFlags::ANY_HIT_KHR => Stage::AnyHit,
        vk::ShaderStageFlags::CLOSEST_HIT_KHR => Stage::ClosestHit,
        vk::ShaderStageFlags::MISS_KHR => Stage::Miss,
        vk::ShaderStageFlags::CALLABLE_KHR => Stage::Callable,
        vk::ShaderStageFlags::VERTEX => Stage::Vertex,
        vk::ShaderStageFlags::TESSELLATION_CONTROL => Stage::TessellationControl,
        vk::ShaderStageFlags::TESSELLATION_EVALUATION => Stage::TessellationEvaluation,
        vk::ShaderStageFlags::GEOMETRY => Stage::Geometry,
        vk::ShaderStageFlags::TASK_EXT => Stage::Task,
        vk::ShaderStageFlags::MESH_EXT => Stage::Mesh,
        vk::ShaderStageFlags::FRAGMENT => Stage::Fragment,
        _ => return None,
    })
}
