//! Ray tracing pipelines and shader binding tables.

use ash::vk;
use bytemuck::Pod;

use crate::gpu::Made;
use crate::{Buffer, Gpu, Set, Stage, stage_flag};

/// A shader group: numbers of the pipeline's shaders.
#[derive(Clone, Copy, Debug, Default)]
pub struct Group {
    pub general: Option<u32>,
    pub closest_hit: Option<u32>,
    pub any_hit: Option<u32>,
    pub intersection: Option<u32>,
}

impl Group {
    pub fn general(shader: u32) -> Group {
        Group {
            general: Some(shader),
            ..Group::default()
        }
    }

    pub fn hit(closest_hit: u32) -> Group {
        Group {
            closest_hit: Some(closest_hit),
            ..Group::default()
        }
    }
}

/// A ray tracing pipeline and the set it uses.
#[derive(Clone, Debug)]
pub struct Rays {
    pub pipeline: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub set: Set,
    pub handles: Vec<Vec<u8>>,
}

/// A record of the binding table: the handle of a group (none: zeros), then data.
#[derive(Clone, Debug, Default)]
pub struct Record {
    pub group: Option<u32>,
    pub data: Vec<u8>,
}

impl Record {
    pub fn of(group: u32) -> Record {
        Record {
            group: Some(group),
            data: Vec::new(),
        }
    }

    pub fn with<T: Pod>(group: u32, data: &[T]) -> Record {
        Record {
            group: Some(group),
            data: bytemuck::cast_slice(data).to_vec(),
        }
    }
}

/// The four regions of a binding table.
#[derive(Clone, Debug, Default)]
pub struct Table {
    pub raygen: Record,
    pub miss: Vec<Record>,
    pub hit: Vec<Record>,
    pub callable: Vec<Record>,
}

impl Table {
    /// Records without data: the groups of the ray generation shader, the miss shaders and the hit
    /// groups.
    pub fn of(raygen: u32, miss: &[u32], hit: &[u32]) -> Table {
        let records = |groups: &[u32]| groups.iter().map(|&group| Record::of(group)).collect();
        Table {
            raygen: Record::of(raygen),
            miss: records(miss),
            hit: records(hit),
            callable: Vec::new(),
        }
    }
}

impl Gpu {
    /// A pipeline of SPIR-V that uses one set.
    pub fn rays_of_words(
        &self,
        shaders: &[(Stage, Vec<u32>)],
        groups: &[Group],
        recursion: u32,
        set: Set,
        flags: vk::PipelineCreateFlags,
    ) -> Rays {
        let layout = self.layout(&[set.layout]);
        let no_cache = vk::PipelineCache::null();
        let made = self.try_rays_with(shaders, groups, recursion, layout, flags, no_cache);
        let pipeline = made.expect("vkCreateRayTracingPipelinesKHR");
        self.rays_of(pipeline, layout, set, groups.len())
    }

    /// The arguments for tracing with a pipeline that was made elsewhere.
    pub fn rays_of(
        &self,
        pipeline: vk::Pipeline,
        layout: vk::PipelineLayout,
        set: Set,
        groups: usize,
    ) -> Rays {
        let size = self.pipeline_properties.shader_group_handle_size as usize;
        // SAFETY: the pipeline has these groups.
        let handles = unsafe {
            self.ray_tracing.get_ray_tracing_shader_group_handles(
                pipeline,
                0,
                groups as u32,
                size * groups,
            )
        };
        let handles = handles
            .expect("group handles")
            .chunks(size)
            .map(<[u8]>::to_vec)
            .collect();
        Rays {
            pipeline,
            layout,
            set,
            handles,
        }
    }

    /// Makes a pipeline of SPIR-V that may be refused.
    pub fn try_rays(
        &self,
        shaders: &[(Stage, Vec<u32>)],
        groups: &[Group],
        recursion: u32,
        layout: vk::PipelineLayout,
    ) -> Result<vk::Pipeline, vk::Result> {
        let flags = vk::PipelineCreateFlags::empty();
        let no_cache = vk::PipelineCache::null();
        self.try_rays_with(shaders, groups, recursion, layout, flags, no_cache)
    }

    /// The same with flags and a pipeline cache.
    pub fn try_rays_with(
        &self,
        shaders: &[(Stage, Vec<u32>)],
        groups: &[Group],
        recursion: u32,
        layout: vk::PipelineLayout,
        flags: vk::PipelineCreateFlags,
        cache: vk::PipelineCache,
    ) -> Result<vk::Pipeline, vk::Result> {
        let info = vk::RayTracingPipelineCreateInfoKHR::default()
            .flags(flags)
            .max_pipeline_ray_recursion_depth(recursion)
            .layout(layout);
        self.try_rays_of(shaders, groups, info, std::ptr::null(), cache)
    }

    /// The same of an info without stages and groups, and with what is chained to each stage.
    pub(crate) fn try_rays_of(
        &self,
        shaders: &[(Stage, Vec<u32>)],
        groups: &[Group],
        info: vk::RayTracingPipelineCreateInfoKHR<'_>,
        next: *const std::ffi::c_void,
        cache: vk::PipelineCache,
    ) -> Result<vk::Pipeline, vk::Result> {
        let mut modules = Vec::new();
        for (_, words) in shaders {
            let info = vk::ShaderModuleCreateInfo::default().code(words);
            // SAFETY: `info` outlives the call.
            let module = unsafe { self.device.create_shader_module(&info, None) }?;
            self.keep(Made::Module(module));
            modules.push(module);
        }
        let stages: Vec<vk::PipelineShaderStageCreateInfo> = shaders
            .iter()
            .zip(&modules)
            .map(|((stage, _), module)| {
                let mut info = vk::PipelineShaderStageCreateInfo::default()
                    .stage(stage_flag(*stage))
                    .module(*module)
                    .name(c"main");
                info.p_next = next;
                info
            })
            .collect();
        let groups: Vec<vk::RayTracingShaderGroupCreateInfoKHR> =
            groups.iter().map(group_info).collect();
        let info = info.stages(&stages).groups(&groups);
        // SAFETY: the structures outlive the call.
        let made = unsafe {
            self.ray_tracing.create_ray_tracing_pipelines(
                vk::DeferredOperationKHR::null(),
                cache,
                &[info],
                None,
            )
        };
        match made {
            Ok(pipelines) => {
                self.keep(Made::Pipeline(pipelines[0]));
                Ok(pipelines[0])
            }
            Err((_, error)) => Err(error),
        }
    }

    /// Traces a grid of rays and waits for its end.
    pub fn trace(&self, rays: &Rays, table: &Table, size: [u32; 3]) {
        let regions = self.regions(rays, table);
        self.run(|commands| self.record_trace(commands, rays, &regions, size));
    }

    pub fn bind_rays(&self, commands: vk::CommandBuffer, rays: &Rays) {
        let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
        // SAFETY: the command buffer is being recorded, and the handles are of this device.
        unsafe {
            self.device
                .cmd_bind_pipeline(commands, point, rays.pipeline);
            let sets = [rays.set.handle];
            self.device
                .cmd_bind_descriptor_sets(commands, point, rays.layout, 0, &sets, &[]);
        }
    }

    pub fn record_trace(
        &self,
        commands: vk::CommandBuffer,
        rays: &Rays,
        [raygen, miss, hit, callable]: &[vk::StridedDeviceAddressRegionKHR; 4],
        [width, height, depth]: [u32; 3],
    ) {
        self.bind_rays(commands, rays);
        // SAFETY: the regions lie in buffers that live as long as the device.
        unsafe {
            self.ray_tracing
                .cmd_trace_rays(commands, raygen, miss, hit, callable, width, height, depth);
        }
    }

    /// Writes a binding table, each region in a buffer of its own.
    pub fn regions(&self, rays: &Rays, table: &Table) -> [vk::StridedDeviceAddressRegionKHR; 4] {
        let raygen = std::slice::from_ref(&table.raygen);
        let mut regions =
            [raygen, &table.miss, &table.hit, &table.callable].map(|it| self.region(rays, it));
        regions[0].size = regions[0].stride;
        regions
    }

    fn region(&self, rays: &Rays, records: &[Record]) -> vk::StridedDeviceAddressRegionKHR {
        if records.is_empty() {
            return vk::StridedDeviceAddressRegionKHR::default();
        }
        let properties = &self.pipeline_properties;
        let handle = properties.shader_group_handle_size as usize;
        let data = records
            .iter()
            .map(|record| record.data.len())
            .max()
            .unwrap_or(0);
        let alignment = properties.shader_group_handle_alignment as usize;
        let stride = (handle + data).next_multiple_of(alignment);
        let base = u64::from(properties.shader_group_base_alignment);
        let buffer: Buffer = self.buffer((records.len() * stride) as u64 + base);
        let start = buffer.address.next_multiple_of(base);
        for (i, record) in records.iter().enumerate() {
            let mut bytes = vec![0; handle];
            if let Some(group) = record.group {
                bytes.copy_from_slice(&rays.handles[group as usize]);
            }
            bytes.extend_from_slice(&record.data);
            buffer.write((start - buffer.address) as usize + i * stride, &bytes);
        }
        vk::StridedDeviceAddressRegionKHR {
            device_address: start,
            stride: stride as u64,
            size: (records.len() * stride) as u64,
        }
    }
}

pub(crate) fn group_info(group: &Group) -> vk::RayTracingShaderGroupCreateInfoKHR<'static> {
    use vk::RayTracingShaderGroupTypeKHR as Kind;
    let or_unused = |shader: Option<u32>| shader.unwrap_or(vk::SHADER_UNUSED_KHR);
    let kind = match (group.general, group.intersection) {
        (Some(_), _) => Kind::GENERAL,
        (None, Some(_)) => Kind::PROCEDURAL_HIT_GROUP,
        (None, None) => Kind::TRIANGLES_HIT_GROUP,
    };
    vk::RayTracingShaderGroupCreateInfoKHR::default()
        .ty(kind)
        .general_shader(or_unused(group.general))
        .closest_hit_shader(or_unused(group.closest_hit))
        .any_hit_shader(or_unused(group.any_hit))
        .intersection_shader(or_unused(group.intersection))
}
