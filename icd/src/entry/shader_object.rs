//! `VK_EXT_shader_object`: stages without pipelines.

use std::ffi::c_void;

use ash::vk;
use spirv_jit::program::Stage;

use super::record::record;
use crate::VkResult;
use crate::command::{Command, GraphicsCommand};
use crate::decode::pipeline::{decode_shader, program_stage};
use crate::device::Device;
use crate::ffi::array::{bytes, slice_mut};
use crate::ffi::enumerate::enumerate_bytes;
use crate::ffi::slice;
use crate::guard::{guard, guard_result};
use crate::handle::{self, Ref, from_handle, optional, retain};
use crate::object::graphics_pipeline::Stages;
use crate::object::shader_object::ShaderObject;
use crate::object::{DescriptorSetLayout, PipelineLayout};

pub(crate) unsafe extern "system" fn vkDestroyShaderEXT(
    _device: vk::Device,
    handle: vk::ShaderEXT,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyShaderEXT", move || {
        drop(handle::take::<ShaderObject>(handle))
    })
}

/// Creates one shader, from SPIR-V or from the data of `vkGetShaderBinaryDataEXT`.
///
/// # Safety
/// `info` is valid usage of `vkCreateShadersEXT`.
unsafe fn create(
    device: &Device,
    info: &vk::ShaderCreateInfoEXT<'_>,
) -> VkResult<Ref<ShaderObject>> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateShadersEXT`.
    unsafe {
        let sets = slice(info.p_set_layouts, info.set_layout_count)
            .iter()
            .map(|&layout| {
                optional::<DescriptorSetLayout>(layout)
                    .map(|_| retain::<DescriptorSetLayout>(layout))
            });
        let ranges = slice(info.p_push_constant_ranges, info.push_constant_range_count).iter();
        let ends = ranges.map(|range| range.offset.saturating_add(range.size));
        let layout = handle::new(PipelineLayout::new(sets.collect(), ends.max().unwrap_or(0)));
        let object = match info.code_type {
            vk::ShaderCodeTypeEXT::BINARY => {
                let data = bytes(info.p_code, info.code_size);
                ShaderObject::from_binary(data, &device.compiler(), layout)?
            }
            _ => ShaderObject::compile(&decode_shader(info)?, &device.compiler(), layout)?,
        };
        Ok(handle::new(object))
    }
}

pub(crate) unsafe extern "system" fn vkCreateShadersEXT(
    device: vk::Device,
    count: u32,
    infos: *const vk::ShaderCreateInfoEXT<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    out: *mut vk::ShaderEXT,
) -> vk::Result {
    guard_result("vkCreateShadersEXT", move || {
        let device = from_handle::<Device>(device);
        let out = slice_mut(out, count);
        out.fill(vk::ShaderEXT::null());
        for (info, out) in slice(infos, count).iter().zip(out) {
            *out = handle::into_handle(create(device, info)?);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetShaderBinaryDataEXT(
    _device: vk::Device,
    shader: vk::ShaderEXT,
    size: *mut usize,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetShaderBinaryDataEXT", move || {
        let binary = from_handle::<ShaderObject>(shader).binary();
        // Either the whole binary is written or nothing.
        enumerate_bytes(size, data.cast(), |room| match binary.len() <= room {
            true => (binary, true),
            false => (Vec::new(), false),
        })
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindShadersEXT(
    commands: vk::CommandBuffer,
    count: u32,
    stages: *const vk::ShaderStageFlags,
    shaders: *const vk::ShaderEXT,
) {
    record("vkCmdBindShadersEXT", commands, move |commands| {
        let shaders = slice(shaders, count);
        for (index, &stage) in slice(stages, count).iter().enumerate() {
            // Without an array, the stages are unbound.
            let shader = shaders.get(index).copied().unwrap_or_default();
            let shader = optional::<ShaderObject>(shader).map(|_| retain::<ShaderObject>(shader));
            match program_stage(stage) {
                Some(Stage::Compute) => {
                    if let Some(pipeline) = shader.as_ref().and_then(|it| it.compute.as_ref()) {
                        commands.push(Command::BindPipeline(Ref::clone(pipeline)))?;
                    }
                }
                Some(stage) if Stages::has(stage) => {
                    commands.push(Command::Graphics(GraphicsCommand::BindShader(
                        stage, shader,
                    )))?;
                }
                // Unsupported stages are ignored.
                _ => {}
            }
        }
        Ok(())
    })
}
