//! The ray tracing pipeline and its shader binding table.

use anyhow::{Context as _, Result};
use ash::vk;

use super::{Buffer, Context};

/// A hit group: indices into the shaders; all have a closest-hit shader.
pub struct HitGroup {
    pub closest_hit: u32,
    pub any_hit: Option<u32>,
    pub intersection: Option<u32>,
}

/// The parts of a pipeline. The first shader is the ray generation shader.
pub struct PipelineInput<'i> {
    pub shaders: &'i [(vk::ShaderStageFlags, &'i [u8])],
    pub miss: &'i [u32],
    pub hit: &'i [HitGroup],
    pub set_layout: vk::DescriptorSetLayout,
    pub push_bytes: u32,
}

impl HitGroup {
    pub const fn new(closest_hit: u32, any_hit: Option<u32>, intersection: Option<u32>) -> Self {
        HitGroup {
            closest_hit,
            any_hit,
            intersection,
        }
    }
}

/// A pipeline cache, from one run of the program to the next.
pub struct PipelineCache<'a> {
    context: &'a Context,
    handle: vk::PipelineCache,
}

impl<'a> PipelineCache<'a> {
    /// A cache with the data of an earlier one; drivers ignore data of other drivers.
    pub fn new(context: &'a Context, data: &[u8]) -> Result<PipelineCache<'a>> {
        let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
        // SAFETY: `info` outlives the call.
        let handle = unsafe { context.device.create_pipeline_cache(&info, None) }?;
        Ok(PipelineCache { context, handle })
    }

    pub fn data(&self) -> Result<Vec<u8>> {
        // SAFETY: the cache is of this device.
        Ok(unsafe { self.context.device.get_pipeline_cache_data(self.handle) }?)
    }
}

impl Drop for PipelineCache<'_> {
    fn drop(&mut self) {
        // SAFETY: nothing uses the cache any more.
        unsafe {
            self.context
                .device
                .destroy_pipeline_cache(self.handle, None)
        };
    }
}

pub struct Pipeline<'a> {
    context: &'a Context,
    pub handle: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub raygen: vk::StridedDeviceAddressRegionKHR,
    pub miss: vk::StridedDeviceAddressRegionKHR,
    pub hit: vk::StridedDeviceAddressRegionKHR,
    _table: Buffer<'a>,
}

impl<'a> Pipeline<'a> {
    pub fn new(
        context: &'a Context,
        input: &PipelineInput,
        cache: &PipelineCache,
    ) -> Result<Pipeline<'a>> {
        let device = &context.device;
        let modules: Vec<vk::ShaderModule> = input
            .shaders
            .iter()
            .map(|(_, bytes)| {
                let words: Vec<u32> = bytes
                    .chunks_exact(4)
                    .map(bytemuck::pod_read_unaligned)
                    .collect();
                let info = vk::ShaderModuleCreateInfo::default().code(&words);
                // SAFETY: the words are a whole SPIR-V module.
                unsafe { device.create_shader_module(&info, None) }
            })
            .collect::<Result<_, _>>()?;
        let stages: Vec<vk::PipelineShaderStageCreateInfo> = input
            .shaders
            .iter()
            .zip(&modules)
            .map(|((stage, _), module)| {
                vk::PipelineShaderStageCreateInfo::default()
                    .stage(*stage)
                    .module(*module)
                    .name(c"main")
            })
            .collect();
        let groups = groups(input);
        let push = [vk::PushConstantRange::default()
            .stage_flags(vk::ShaderStageFlags::RAYGEN_KHR)
            .size(input.push_bytes)];
        let sets = [input.set_layout];
        let layout = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&sets)
            .push_constant_ranges(&push);
        // SAFETY: the modules, layouts and groups are valid and outlive the calls.
        let (layout, handle) = unsafe {
            let layout = device.create_pipeline_layout(&layout, None)?;
            let info = vk::RayTracingPipelineCreateInfoKHR::default()
                .stages(&stages)
                .groups(&groups)
                .max_pipeline_ray_recursion_depth(1)
                .layout(layout);
            let made = context.ray_tracing.create_ray_tracing_pipelines(
                vk::DeferredOperationKHR::null(),
                cache.handle,
                &[info],
                None,
            );
            let made = made
                .map_err(|(_, error)| error)
                .context("creating the pipeline")?;
            for module in modules {
                device.destroy_shader_module(module, None);
            }
            (layout, made[0])
        };
        let (table, [raygen, miss, hit]) = binding_table(context, input, handle)?;
        Ok(Pipeline {
            context,
            handle,
            layout,
            raygen,
            miss,
            hit,
            _table: table,
        })
    }
}

impl Drop for Pipeline<'_> {
    fn drop(&mut self) {
        // SAFETY: the device is idle when the pipeline goes.
        unsafe {
            self.context.device.destroy_pipeline(self.handle, None);
            self.context
                .device
                .destroy_pipeline_layout(self.layout, None);
        }
    }
}

/// Ray generation first, then the miss shaders, then the hit groups.
fn groups(input: &PipelineInput) -> Vec<vk::RayTracingShaderGroupCreateInfoKHR<'static>> {
    let unused = vk::SHADER_UNUSED_KHR;
    let blank = vk::RayTracingShaderGroupCreateInfoKHR::default()
        .general_shader(unused)
        .closest_hit_shader(unused)
        .any_hit_shader(unused)
        .intersection_shader(unused);
    let general = |shader: u32| {
        blank
            .ty(vk::RayTracingShaderGroupTypeKHR::GENERAL)
            .general_shader(shader)
    };
    let hit = |group: &HitGroup| {
        let kind = match group.intersection {
            Some(_) => vk::RayTracingShaderGroupTypeKHR::PROCEDURAL_HIT_GROUP,
            None => vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP,
        };
        blank
            .ty(kind)
            .closest_hit_shader(group.closest_hit)
            .any_hit_shader(group.any_hit.unwrap_or(unused))
            .intersection_shader(group.intersection.unwrap_or(unused))
    };
    let miss = input.miss.iter().map(|shader| general(*shader));
    std::iter::once(general(0))
        .chain(miss)
        .chain(input.hit.iter().map(hit))
        .collect()
}

/// One region for each kind of group, in one buffer.
fn binding_table<'a>(
    context: &'a Context,
    input: &PipelineInput,
    pipeline: vk::Pipeline,
) -> Result<(Buffer<'a>, [vk::StridedDeviceAddressRegionKHR; 3])> {
    let size = context.group_handle_size as usize;
    let base_alignment = u64::from(context.group_base_alignment);
    let record = context
        .group_handle_size
        .next_multiple_of(context.group_handle_alignment);
    let counts = [1, input.miss.len(), input.hit.len()];
    let total: usize = counts.iter().sum();
    // SAFETY: the pipeline has `total` groups.
    let handles = unsafe {
        context.ray_tracing.get_ray_tracing_shader_group_handles(
            pipeline,
            0,
            total as u32,
            total * size,
        )
    }?;
    let region_bytes =
        counts.map(|count| (count as u64 * u64::from(record)).next_multiple_of(base_alignment));
    let mut table = Buffer::new(
        context,
        region_bytes.iter().sum::<u64>() + base_alignment,
        vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR,
    )?;
    let start = table.address();
    let mut address = start.next_multiple_of(base_alignment);
    let mut group = 0;
    let mut regions = [vk::StridedDeviceAddressRegionKHR::default(); 3];
    for (region, count) in counts.into_iter().enumerate() {
        for i in 0..count {
            let offset = (address - start) as usize + i * record as usize;
            table.write(offset, &handles[group * size..][..size])?;
            group += 1;
        }
        regions[region] = vk::StridedDeviceAddressRegionKHR {
            device_address: address,
            stride: u64::from(record),
            // The region of the ray generation shader is its stride.
            size: count as u64 * u64::from(record),
        };
        address += region_bytes[region];
    }
    Ok((table, regions))
}
