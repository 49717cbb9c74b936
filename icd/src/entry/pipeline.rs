//! Shader modules, pipeline layouts, pipeline caches and compute pipelines.

use std::ffi::c_void;
use std::sync::Arc;
use std::time::Instant;

use ash::vk;

use crate::VkResult;
use crate::decode::pipeline::{ProgramSource, create_flags, decode_stage, pipeline_layout};
use crate::device::Device;
use crate::ffi::enumerate::enumerate_bytes;
use crate::ffi::{self, array, chain};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, optional, retain};
use crate::object::captured::Captured;
use crate::object::pipeline::PipelineKind;
use crate::object::shader_stage::Compiled;
use crate::object::{DescriptorSetLayout, Pipeline, PipelineCache, PipelineLayout, ShaderModule};

pub(crate) unsafe extern "system" fn vkDestroyShaderModule(
    _device: vk::Device,
    handle: vk::ShaderModule,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyShaderModule", move || {
        drop(handle::take::<ShaderModule>(handle))
    })
}

pub(crate) unsafe extern "system" fn vkDestroyPipelineLayout(
    _device: vk::Device,
    handle: vk::PipelineLayout,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyPipelineLayout", move || {
        drop(handle::take::<PipelineLayout>(handle))
    })
}

pub(crate) unsafe extern "system" fn vkDestroyPipelineCache(
    _device: vk::Device,
    handle: vk::PipelineCache,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyPipelineCache", move || {
        drop(handle::take::<PipelineCache>(handle))
    })
}

pub(crate) unsafe extern "system" fn vkDestroyPipeline(
    _device: vk::Device,
    handle: vk::Pipeline,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyPipeline", move || {
        drop(handle::take::<Pipeline>(handle))
    })
}

/// The words of a module.
///
/// # Safety
/// `info` is valid usage of `vkCreateShaderModule`.
unsafe fn words(info: &vk::ShaderModuleCreateInfo<'_>) -> VkResult<Arc<[u32]>> {
    let count =
        u32::try_from(info.code_size / 4).map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateShaderModule`.
    Ok(unsafe { ffi::slice(info.p_code, count) }.into())
}

/// Writes `VkPipelineCreationFeedback`, if requested.
///
/// # Safety
/// `next` is the chain of a pipeline's creation.
pub unsafe fn write_feedback(next: *const c_void, start: Instant, cache_hits: &[bool]) {
    // SAFETY: the caller guarantees that `next` is the chain of a pipeline's creation; the
    // structure's pointers are valid outputs.
    unsafe {
        let Some(info) = chain::find::<vk::PipelineCreationFeedbackCreateInfo>(next) else {
            return;
        };
        let feedback = |hit: bool| vk::PipelineCreationFeedback {
            flags: if hit {
                vk::PipelineCreationFeedbackFlags::VALID
                    | vk::PipelineCreationFeedbackFlags::APPLICATION_PIPELINE_CACHE_HIT
            } else {
                vk::PipelineCreationFeedbackFlags::VALID
            },
            duration: start.elapsed().as_nanos() as u64,
        };
        *info.p_pipeline_creation_feedback =
            feedback(!cache_hits.is_empty() && cache_hits.iter().all(|&hit| hit));
        let stages = array::slice_mut(
            info.p_pipeline_stage_creation_feedbacks,
            info.pipeline_stage_creation_feedback_count,
        );
        for (stage, &hit) in stages.iter_mut().zip(cache_hits) {
            *stage = feedback(hit);
        }
    }
}

/// Creates one compute pipeline.
///
/// # Safety
/// `info` is valid usage of `vkCreateComputePipelines`.
unsafe fn create_compute(
    device: &Device,
    cache: Option<&PipelineCache>,
    info: &vk::ComputePipelineCreateInfo<'_>,
) -> VkResult<vk::Pipeline> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateComputePipelines`.
    unsafe {
        let start = Instant::now();
        let layout = pipeline_layout(info.layout);
        let stage = decode_stage(&info.stage, info.p_next)?;
        let flags = create_flags(info.flags, info.p_next);
        let source = ProgramSource::of(device, cache, flags, info.p_next)?;
        let Compiled { program, cache_hit } = source.program(0, &stage, &layout)?;
        write_feedback(info.p_next, start, &[cache_hit]);
        Ok(handle::create(Pipeline {
            layout,
            kind: PipelineKind::Compute(Arc::clone(&program.program)),
            captured: Captured::of(flags, vec![program], std::iter::empty()),
        }))
    }
}

/// Creates pipelines in order by the rules of "Multiple Pipeline Creation": failed ones are null
/// handles, the first failure is the result (an error before `VK_PIPELINE_COMPILE_REQUIRED`), and
/// flags of a failed one may stop the creation.
///
/// # Safety
/// `out` has room for as many handles.
pub unsafe fn create_each<T>(
    infos: &[T],
    out: *mut vk::Pipeline,
    flags: impl Fn(&T) -> vk::PipelineCreateFlags,
    create: impl Fn(&T) -> VkResult<vk::Pipeline>,
) -> VkResult {
    // SAFETY: the caller guarantees that `out` has room for as many handles.
    let out = unsafe { array::slice_mut(out, infos.len() as u32) };
    out.fill(vk::Pipeline::null());
    let mut result = Ok(());
    for (info, out) in infos.iter().zip(out) {
        match create(info) {
            Ok(pipeline) => *out = pipeline,
            Err(code) => {
                if result.is_ok() || result == Err(vk::Result::PIPELINE_COMPILE_REQUIRED) {
                    result = Err(code);
                }
                if flags(info).contains(vk::PipelineCreateFlags::EARLY_RETURN_ON_FAILURE) {
                    break;
                }
            }
        }
    }
    result
}

pub(crate) unsafe extern "system" fn vkCreateShaderModule(
    _device: vk::Device,
    info: *const vk::ShaderModuleCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::ShaderModule,
) -> vk::Result {
    guard_result("vkCreateShaderModule", move || {
        *out = handle::create(ShaderModule {
            words: words(&*info)?,
            name: Arc::default(),
        });
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreatePipelineLayout(
    _device: vk::Device,
    info: *const vk::PipelineLayoutCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::PipelineLayout,
) -> vk::Result {
    guard_result("vkCreatePipelineLayout", move || {
        let info = &*info;
        let sets = ffi::slice(info.p_set_layouts, info.set_layout_count)
            .iter()
            .map(|&layout| {
                (layout != vk::DescriptorSetLayout::null())
                    .then(|| retain::<DescriptorSetLayout>(layout))
            });
        let ranges = ffi::slice(info.p_push_constant_ranges, info.push_constant_range_count);
        let push_constant_bytes = ranges
            .iter()
            .map(|range| range.offset.saturating_add(range.size))
            .max()
            .unwrap_or(0);
        *out = handle::create(PipelineLayout::new(sets.collect(), push_constant_bytes));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreatePipelineCache(
    _device: vk::Device,
    info: *const vk::PipelineCacheCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::PipelineCache,
) -> vk::Result {
    guard_result("vkCreatePipelineCache", move || {
        let data = array::bytes((*info).p_initial_data, (*info).initial_data_size);
        *out = handle::create(PipelineCache::with_data(data));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPipelineCacheData(
    _device: vk::Device,
    cache: vk::PipelineCache,
    size: *mut usize,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetPipelineCacheData", move || {
        let cache = from_handle::<PipelineCache>(cache);
        enumerate_bytes(size, data.cast(), |room| cache.data(room))
    })
}

pub(crate) unsafe extern "system" fn vkMergePipelineCaches(
    _device: vk::Device,
    destination: vk::PipelineCache,
    count: u32,
    sources: *const vk::PipelineCache,
) -> vk::Result {
    guard_result("vkMergePipelineCaches", move || {
        let destination = from_handle::<PipelineCache>(destination);
        for &source in ffi::slice(sources, count) {
            destination.merge(from_handle::<PipelineCache>(source));
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateComputePipelines(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::ComputePipelineCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Pipeline,
) -> vk::Result {
    guard_result("vkCreateComputePipelines", move || {
        let device = from_handle::<Device>(device);
        let cache = optional::<PipelineCache>(cache).map(|cache| &**cache);
        create_each(
            ffi::slice(infos, count),
            out,
            |info| create_flags(info.flags, info.p_next),
            |info| create_compute(device, cache, info),
        )
    })
}
