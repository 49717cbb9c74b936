//! `VK_KHR_pipeline_binary`: a pipeline with its own stages has one binary, any other has none.

use std::ffi::c_void;

use ash::vk::{Handle, TaggedStructure};

use crate::VkResult;
use crate::capabilities::properties::pipeline_cache_uuid;
use crate::decode::graphics;
use crate::decode::pipeline::decode_stage;
use crate::device::Device;
use crate::ffi::{array, chain, slice, vk};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, optional, retain};
use crate::object::pipeline_binary::key_of;
use crate::object::shader_stage::ShaderStage;
use crate::object::{Pipeline, PipelineBinary, PipelineLayout};

pub(crate) unsafe extern "system" fn vkDestroyPipelineBinaryKHR(
    _device: vk::Device,
    handle: vk::PipelineBinaryKHR,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyPipelineBinaryKHR", move || {
        drop(handle::take::<PipelineBinary>(handle))
    })
}

fn write_key(out: &mut vk::PipelineBinaryKeyKHR<'_>, key: [u8; 16]) {
    out.key_size = key.len() as u32;
    out.key[..key.len()].copy_from_slice(&key);
}

/// The stages that a pipeline compiles itself, and its layout.
///
/// # Errors
/// As [`decode_stage`].
///
/// # Safety
/// `info` points to a valid create info of a pipeline.
unsafe fn own_stages(info: *const c_void) -> VkResult<(Vec<ShaderStage>, vk::PipelineLayout)> {
    // SAFETY: the caller guarantees that `info` points to a valid structure that pipelines are
    // created with; the type says which structure it is.
    unsafe {
        let Some(first) = chain::nodes(info).next() else {
            return Err(vk::Result::ERROR_UNKNOWN);
        };
        let first = std::ptr::from_ref(first);
        match (*first).s_type {
            vk::ComputePipelineCreateInfo::STRUCTURE_TYPE => {
                let info = &*first.cast::<vk::ComputePipelineCreateInfo<'_>>();
                Ok((vec![decode_stage(&info.stage, info.p_next)?], info.layout))
            }
            vk::GraphicsPipelineCreateInfo::STRUCTURE_TYPE => {
                let info = &*first.cast::<vk::GraphicsPipelineCreateInfo<'_>>();
                let stages = graphics::decode(info)?.stages;
                Ok((stages.into_iter().map(|(_, it)| it).collect(), info.layout))
            }
            vk::RayTracingPipelineCreateInfoKHR::STRUCTURE_TYPE => {
                let info = &*first.cast::<vk::RayTracingPipelineCreateInfoKHR<'_>>();
                let stages = slice(info.p_stages, info.stage_count);
                let stages = stages.iter().map(|it| decode_stage(it, info.p_next));
                Ok((stages.collect::<VkResult<_>>()?, info.layout))
            }
            _ => Err(vk::Result::ERROR_UNKNOWN),
        }
    }
}

pub(crate) unsafe extern "system" fn vkCreatePipelineBinariesKHR(
    _device: vk::Device,
    info: *const vk::PipelineBinaryCreateInfoKHR<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    out: *mut vk::PipelineBinaryHandlesInfoKHR<'_>,
) -> vk::Result {
    guard_result("vkCreatePipelineBinariesKHR", move || {
        let (info, out) = (&*info, &mut *out);
        let made: Vec<Option<PipelineBinary>> = match info.p_keys_and_data_info.as_ref() {
            Some(stored) => slice(stored.p_pipeline_binary_data, stored.binary_count)
                .iter()
                .map(|it| PipelineBinary::with_data(array::bytes(it.p_data, it.data_size)))
                .collect(),
            None => match optional::<Pipeline>(info.pipeline) {
                Some(pipeline) => pipeline
                    .captured
                    .binary
                    .lock()
                    .iter()
                    .cloned()
                    .map(Some)
                    .collect(),
                // There is no internal cache.
                None => return Err(vk::PIPELINE_BINARY_MISSING_KHR),
            },
        };
        if out.p_pipeline_binaries.is_null() {
            out.pipeline_binary_count = made.len() as u32;
            return Ok(());
        }
        let (count, room) = (made.len(), out.pipeline_binary_count);
        let places = array::slice_mut(out.p_pipeline_binaries, room);
        let mut result = if count > places.len() {
            Err(vk::Result::INCOMPLETE)
        } else {
            Ok(())
        };
        out.pipeline_binary_count = count.min(places.len()) as u32;
        for (place, binary) in places.iter_mut().zip(made) {
            *place = binary.map_or(Handle::from_raw(0), handle::create);
            if place.is_null() && !matches!(result, Err(vk::Result::ERROR_INITIALIZATION_FAILED)) {
                result = Err(vk::Result::ERROR_INITIALIZATION_FAILED);
            }
        }
        result
    })
}

pub(crate) unsafe extern "system" fn vkGetPipelineKeyKHR(
    device: vk::Device,
    info: *const vk::PipelineCreateInfoKHR<'_>,
    out: *mut vk::PipelineBinaryKeyKHR<'_>,
) -> vk::Result {
    guard_result("vkGetPipelineKeyKHR", move || {
        let Some(info) = info.as_ref() else {
            // Binaries of another compiler are refused.
            write_key(&mut *out, pipeline_cache_uuid());
            return Ok(());
        };
        let (stages, layout) = own_stages(info.p_next)?;
        let mut content = Vec::new();
        if !stages.is_empty() {
            let layout = retain::<PipelineLayout>(layout);
            let compiler = from_handle::<Device>(device).compiler();
            for stage in &stages {
                content.extend_from_slice(&stage.key(&layout, &compiler));
            }
        }
        write_key(&mut *out, key_of(&content));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPipelineBinaryDataKHR(
    _device: vk::Device,
    info: *const vk::PipelineBinaryDataInfoKHR<'_>,
    key: *mut vk::PipelineBinaryKeyKHR<'_>,
    size: *mut usize,
    out: *mut c_void,
) -> vk::Result {
    guard_result("vkGetPipelineBinaryDataKHR", move || {
        let data = from_handle::<PipelineBinary>((*info).pipeline_binary).data();
        let room = std::mem::replace(&mut *size, data.len());
        if !out.is_null() {
            if room < data.len() {
                return Err(vk::ERROR_NOT_ENOUGH_SPACE_KHR);
            }
            out.cast::<u8>()
                .copy_from_nonoverlapping(data.as_ptr(), data.len());
        }
        write_key(&mut *key, key_of(&data));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkReleaseCapturedPipelineDataKHR(
    _device: vk::Device,
    info: *const vk::ReleaseCapturedPipelineDataInfoKHR<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
) -> vk::Result {
    guard_result("vkReleaseCapturedPipelineDataKHR", move || {
        *from_handle::<Pipeline>((*info).pipeline)
            .captured
            .binary
            .lock() = None;
        Ok(())
    })
}
