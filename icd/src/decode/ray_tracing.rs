//! `VkRayTracingPipelineCreateInfoKHR` and shader binding table regions.

use std::time::{Duration, Instant};

use ash::vk;
use rayon::prelude::*;

use super::pipeline::{
    ProgramSource, captured_libraries, create_flags, decode_stage, pipeline_layout,
};
use crate::VkResult;
use crate::device::Device;
use crate::ffi::{find, slice};
use crate::handle::from_handle;
use crate::object::captured::Captured;
use crate::object::pipeline::PipelineKind;
use crate::object::ray_tracing_pipeline::{GroupInfo, RayTracingPipeline};
use crate::object::shader_stage::ShaderStage;
use crate::object::{Pipeline, PipelineCache};
use crate::wave::binding_table::Region;

/// `VkStridedDeviceAddressRegionKHR`; an empty region for null.
///
/// # Safety
/// The pointer is null or leads to a valid region.
pub unsafe fn region(region: *const vk::StridedDeviceAddressRegionKHR) -> Region {
    // SAFETY: the caller guarantees that the pointer is null or to a valid region.
    unsafe { region.as_ref() }.map_or_else(Region::default, |region| Region {
        address: region.device_address,
        stride_bytes: region.stride,
        size_bytes: region.size,
    })
}

/// Compiles the stages of a pipeline or library and links it.
///
/// # Errors
/// As [`ShaderStage::compile`](crate::object::shader_stage::ShaderStage::compile).
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn create_pipeline(
    device: &Device,
    cache: Option<&PipelineCache>,
    info: &vk::RayTracingPipelineCreateInfoKHR<'_>,
) -> VkResult<Pipeline> {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let started = Instant::now();
        let layout = pipeline_layout(info.layout);
        let flags = create_flags(info.flags, info.p_next);
        let source = ProgramSource::of(device, cache, flags, info.p_next)?;
        let stages = slice(info.p_stages, info.stage_count);
        let feedback = find::<vk::PipelineCreationFeedbackCreateInfo>(info.p_next);
        let mut programs = Vec::with_capacity(stages.len());
        let mut all_hits = true;
        let decoded: Vec<_> = stages
            .iter()
            .map(|stage| decode_stage(stage, info.p_next))
            .collect::<VkResult<_>>()?;
        let compile = |(index, stage): (usize, &ShaderStage)| {
            let started = Instant::now();
            let compiled = source.program(index, stage, &layout)?;
            Ok((compiled, started.elapsed()))
        };
        // The threads of a deferred operation share the stages.
        let compiled: Vec<_> = if rayon::current_thread_index().is_some() {
            (decoded.par_iter().enumerate())
                .map(compile)
                .collect::<VkResult<_>>()?
        } else {
            (decoded.iter().enumerate())
                .map(compile)
                .collect::<VkResult<_>>()?
        };
        for (index, (compiled, duration)) in compiled.into_iter().enumerate() {
            all_hits &= compiled.cache_hit;
            programs.push(compiled.program);
            if let Some(feedback) = feedback
                && (index as u32) < feedback.pipeline_stage_creation_feedback_count
            {
                let out = feedback.p_pipeline_stage_creation_feedbacks.add(index);
                out.write(creation_feedback(duration, compiled.cache_hit));
            }
        }
        if let Some(feedback) =
            feedback.filter(|feedback| !feedback.p_pipeline_creation_feedback.is_null())
        {
            let hit = all_hits && !stages.is_empty();
            feedback
                .p_pipeline_creation_feedback
                .write(creation_feedback(started.elapsed(), hit));
        }
        let groups: Vec<_> = slice(info.p_groups, info.group_count)
            .iter()
            .map(group)
            .collect();
        let libraries = libraries(info)?;
        let captured = captured_libraries(info.p_library_info.as_ref());
        Ok(Pipeline {
            layout,
            captured: Captured::of(flags, programs.clone(), captured),
            kind: PipelineKind::RayTracing(RayTracingPipeline::link(
                programs,
                &groups,
                &libraries,
                info.max_pipeline_ray_recursion_depth,
                flags,
                has_dynamic_stack(info),
            )),
        })
    }
}

/// The value that `VkPipelineCreationFeedback` reports.
pub fn creation_feedback(duration: Duration, cache_hit: bool) -> vk::PipelineCreationFeedback {
    let mut flags = vk::PipelineCreationFeedbackFlags::VALID;
    if cache_hit {
        flags |= vk::PipelineCreationFeedbackFlags::APPLICATION_PIPELINE_CACHE_HIT;
    }
    vk::PipelineCreationFeedback {
        flags,
        duration: u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX),
    }
}

pub(super) fn group(info: &vk::RayTracingShaderGroupCreateInfoKHR<'_>) -> GroupInfo {
    let used = |index: u32| (index != vk::SHADER_UNUSED_KHR).then_some(index);
    let general = info.ty == vk::RayTracingShaderGroupTypeKHR::GENERAL;
    let of_hit = |index| if general { None } else { used(index) };
    let procedural = info.ty == vk::RayTracingShaderGroupTypeKHR::PROCEDURAL_HIT_GROUP;
    GroupInfo {
        ty: info.ty,
        general: if general {
            used(info.general_shader)
        } else {
            None
        },
        closest_hit: of_hit(info.closest_hit_shader),
        any_hit: of_hit(info.any_hit_shader),
        intersection: if procedural {
            used(info.intersection_shader)
        } else {
            None
        },
    }
}

/// # Safety
/// The info is valid.
unsafe fn has_dynamic_stack(info: &vk::RayTracingPipelineCreateInfoKHR<'_>) -> bool {
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        info.p_dynamic_state.as_ref().is_some_and(|state| {
            slice(state.p_dynamic_states, state.dynamic_state_count)
                .contains(&vk::DynamicState::RAY_TRACING_PIPELINE_STACK_SIZE_KHR)
        })
    }
}

/// # Safety
/// The info is valid and its libraries are alive for `'a`.
unsafe fn libraries<'a>(
    info: &vk::RayTracingPipelineCreateInfoKHR<'_>,
) -> VkResult<Vec<&'a RayTracingPipeline>> {
    // SAFETY: the caller guarantees that the info is valid and its libraries are alive for `'a`.
    unsafe {
        let Some(library_info) = info.p_library_info.as_ref() else {
            return Ok(Vec::new());
        };
        slice(library_info.p_libraries, library_info.library_count)
            .iter()
            .map(|&library| {
                let library = from_handle::<'a, Pipeline>(library);
                library.ray_tracing().ok_or(vk::Result::ERROR_UNKNOWN)
            })
            .collect()
    }
}
