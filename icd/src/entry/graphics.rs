//! Graphics pipelines, render passes and framebuffers. A device without a graphics queue has render
//! passes and framebuffers, too, since applications create them anyway. Its graphics pipelines are
//! refused with `VK_ERROR_VALIDATION_FAILED` and one message
//! (VUID-vkCreateGraphicsPipelines-device-09662).

use std::sync::Arc;
use std::time::Instant;

use ash::vk;

use super::pipeline::create_each;
use crate::VkResult;
use crate::decode::graphics::{Decoded, decode};
use crate::decode::pipeline::{ProgramSource, captured_libraries, create_flags};
use crate::decode::ray_tracing::creation_feedback;
use crate::decode::render_pass::{framebuffer, render_pass, render_pass2};
use crate::device::Device;
use crate::ffi::array::slice_mut;
use crate::ffi::{find, slice};
use crate::guard::{guard, guard_result};
use crate::handle::{self, Ref, from_handle, optional, retain};
use crate::object::captured::Captured;
use crate::object::graphics_pipeline::GraphicsPipeline;
use crate::object::pipeline::PipelineKind;
use crate::object::{Framebuffer, Pipeline, PipelineCache, PipelineLayout, RenderPass};

pub(crate) unsafe extern "system" fn vkDestroyFramebuffer(
    _device: vk::Device,
    handle: vk::Framebuffer,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyFramebuffer", move || {
        drop(handle::take::<Framebuffer>(handle))
    })
}

pub(crate) unsafe extern "system" fn vkDestroyRenderPass(
    _device: vk::Device,
    handle: vk::RenderPass,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyRenderPass", move || {
        drop(handle::take::<RenderPass>(handle))
    })
}

/// Creates one graphics pipeline, or a library.
///
/// # Safety
/// `info` is valid usage of `vkCreateGraphicsPipelines`.
unsafe fn create_graphics(
    device: &Device,
    cache: Option<&PipelineCache>,
    info: &vk::GraphicsPipelineCreateInfo<'_>,
) -> VkResult<vk::Pipeline> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateGraphicsPipelines`.
    unsafe {
        let start = Instant::now();
        let Decoded {
            mut own,
            stages,
            libraries,
        } = decode(info)?;
        // Parts without shaders need none.
        let layout: Ref<PipelineLayout> = match optional::<PipelineLayout>(info.layout) {
            Some(_) if !stages.is_empty() || !libraries.is_empty() => retain(info.layout),
            _ => handle::new(PipelineLayout::new(Vec::new(), 0)),
        };
        let flags = create_flags(info.flags, info.p_next);
        let source = ProgramSource::of(device, cache, flags, info.p_next)?;
        let mut programs = Vec::new();
        let feedback = find::<vk::PipelineCreationFeedbackCreateInfo>(info.p_next);
        let out = feedback.map_or(&mut [][..], |it| {
            let count = it.pipeline_stage_creation_feedback_count;
            slice_mut(it.p_pipeline_stage_creation_feedbacks, count)
        });
        let mut all_hits = !stages.is_empty();
        for (place, (index, stage)) in stages.iter().enumerate() {
            let start = Instant::now();
            let compiled = source.program(place, stage, &layout)?;
            all_hits &= compiled.cache_hit;
            if let Some(out) = out.get_mut(*index) {
                *out = creation_feedback(start.elapsed(), compiled.cache_hit);
            }
            own.set_program(stage.stage, Arc::clone(&compiled.program.program));
            programs.push(compiled.program);
        }
        let mut pipeline = GraphicsPipeline::empty();
        for part in libraries.into_iter().chain([&own]) {
            pipeline.link(part);
        }
        if let Some(out) = feedback.and_then(|it| it.p_pipeline_creation_feedback.as_mut()) {
            *out = creation_feedback(start.elapsed(), all_hits);
        }
        let captured = captured_libraries(find(info.p_next));
        Ok(handle::create(Pipeline {
            layout,
            captured: Captured::of(flags, programs, captured),
            kind: PipelineKind::Graphics(Box::new(pipeline)),
        }))
    }
}

pub(crate) unsafe extern "system" fn vkCreateGraphicsPipelines(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::GraphicsPipelineCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Pipeline,
) -> vk::Result {
    guard_result("vkCreateGraphicsPipelines", move || {
        let device = from_handle::<Device>(device);
        let cache = optional::<PipelineCache>(cache).map(|cache| &**cache);
        create_each(
            slice(infos, count),
            out,
            |info| create_flags(info.flags, info.p_next),
            |info| create_graphics(device, cache, info),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCreateRenderPass(
    _device: vk::Device,
    info: *const vk::RenderPassCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::RenderPass,
) -> vk::Result {
    guard_result("vkCreateRenderPass", move || {
        *out = handle::create(render_pass(&*info));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateRenderPass2(
    _device: vk::Device,
    info: *const vk::RenderPassCreateInfo2,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::RenderPass,
) -> vk::Result {
    guard_result("vkCreateRenderPass2", move || {
        *out = handle::create(render_pass2(&*info));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateFramebuffer(
    _device: vk::Device,
    info: *const vk::FramebufferCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Framebuffer,
) -> vk::Result {
    guard_result("vkCreateFramebuffer", move || {
        *out = handle::create(framebuffer(&*info));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetRenderAreaGranularity(
    _device: vk::Device,
    _render_pass: vk::RenderPass,
    out: *mut vk::Extent2D,
) {
    guard("vkGetRenderAreaGranularity", move || {
        *out = vk::Extent2D {
            width: 1,
            height: 1,
        };
    })
}
