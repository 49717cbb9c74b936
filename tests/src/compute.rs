//! Compute pipelines, and the short way to run one.

use ash::vk;
use bytemuck::Pod;

use crate::gpu::Made;
use crate::{Bound, Buffer, Gpu, Set, Stage, glsl};

/// A compute pipeline with its layout.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    pub pipeline: vk::Pipeline,
    pub layout: vk::PipelineLayout,
}

impl Gpu {
    /// Compiles a compute shader for these set layouts.
    pub fn kernel(&self, source: &str, sets: &[vk::DescriptorSetLayout]) -> Kernel {
        self.specialized_kernel(source, sets, &vk::SpecializationInfo::default())
    }

    /// The same, with values for its specialization constants.
    pub fn specialized_kernel(
        &self,
        source: &str,
        sets: &[vk::DescriptorSetLayout],
        constants: &vk::SpecializationInfo,
    ) -> Kernel {
        let words = glsl(Stage::Compute, source);
        let layout = self.layout(sets);
        let made = self.try_kernel(&words, c"main", layout, constants);
        let pipeline = made.expect("vkCreateComputePipelines");
        Kernel { pipeline, layout }
    }

    /// A kernel of SPIR-V.
    pub fn kernel_of(&self, words: &[u32], sets: &[vk::DescriptorSetLayout]) -> Kernel {
        let layout = self.layout(sets);
        let constants = vk::SpecializationInfo::default();
        let made = self.try_kernel(words, c"main", layout, &constants);
        let pipeline = made.expect("vkCreateComputePipelines");
        Kernel { pipeline, layout }
    }

    /// The same as [`Self::kernel`], with flags for the pipeline.
    pub fn kernel_with(
        &self,
        source: &str,
        sets: &[vk::DescriptorSetLayout],
        flags: vk::PipelineCreateFlags,
    ) -> Kernel {
        let words = glsl(Stage::Compute, source);
        let layout = self.layout(sets);
        let constants = vk::SpecializationInfo::default();
        let info = vk::ComputePipelineCreateInfo::default().flags(flags);
        let made = self.try_kernel_with(&words, c"main", layout, &constants, info);
        let pipeline = made.expect("vkCreateComputePipelines");
        Kernel { pipeline, layout }
    }

    /// The same as [`Self::kernel_of`], with flags of 64 bits for the pipeline.
    pub fn kernel_with_flags2(
        &self,
        words: &[u32],
        sets: &[vk::DescriptorSetLayout],
        flags: vk::PipelineCreateFlags2KHR,
    ) -> Kernel {
        let layout = self.layout(sets);
        let constants = vk::SpecializationInfo::default();
        let mut flags = vk::PipelineCreateFlags2CreateInfoKHR::default().flags(flags);
        let info = vk::ComputePipelineCreateInfo::default().push_next(&mut flags);
        let made = self.try_kernel_with(words, c"main", layout, &constants, info);
        let pipeline = made.expect("vkCreateComputePipelines");
        Kernel { pipeline, layout }
    }

    /// An empty pipeline cache.
    pub fn pipeline_cache(&self) -> vk::PipelineCache {
        let info = vk::PipelineCacheCreateInfo::default();
        // SAFETY: `info` outlives the call.
        let cache = unsafe { self.device.create_pipeline_cache(&info, None) };
        let cache = cache.expect("vkCreatePipelineCache");
        self.keep(Made::PipelineCache(cache));
        cache
    }

    /// Makes a pipeline of SPIR-V that may be refused.
    pub fn try_kernel(
        &self,
        words: &[u32],
        entry_point: &std::ffi::CStr,
        layout: vk::PipelineLayout,
        constants: &vk::SpecializationInfo,
    ) -> Result<vk::Pipeline, vk::Result> {
        let info = vk::ComputePipelineCreateInfo::default();
        self.try_kernel_with(words, entry_point, layout, constants, info)
    }

    fn try_kernel_with(
        &self,
        words: &[u32],
        entry_point: &std::ffi::CStr,
        layout: vk::PipelineLayout,
        constants: &vk::SpecializationInfo,
        pipeline: vk::ComputePipelineCreateInfo<'_>,
    ) -> Result<vk::Pipeline, vk::Result> {
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: the structures outlive the calls; the module goes when the pipeline is made.
        unsafe {
            let module = self.device.create_shader_module(&info, None)?;
            let mut stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(entry_point);
            if constants.map_entry_count > 0 {
                stage = stage.specialization_info(constants);
            }
            let info = pipeline.stage(stage).layout(layout);
            let made =
                self.device
                    .create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
            self.device.destroy_shader_module(module, None);
            match made {
                Ok(pipelines) => {
                    self.keep(Made::Pipeline(pipelines[0]));
                    Ok(pipelines[0])
                }
                Err((pipelines, error)) => {
                    for pipeline in pipelines {
                        self.device.destroy_pipeline(pipeline, None);
                    }
                    Err(error)
                }
            }
        }
    }

    /// Runs a kernel with its sets and push constants, and waits for its end.
    pub fn dispatch<T: Pod>(&self, kernel: Kernel, sets: &[Set], push: &[T], groups: [u32; 3]) {
        self.run(|commands| self.record_dispatch(commands, kernel, sets, push, groups));
    }

    pub fn record_dispatch<T: Pod>(
        &self,
        commands: vk::CommandBuffer,
        kernel: Kernel,
        sets: &[Set],
        push: &[T],
        groups: [u32; 3],
    ) {
        self.bind_kernel(commands, kernel, sets, &[]);
        let bytes: &[u8] = bytemuck::cast_slice(push);
        // SAFETY: the command buffer is being recorded, and the handles are of this device.
        unsafe {
            if !bytes.is_empty() {
                let all = vk::ShaderStageFlags::ALL;
                self.device
                    .cmd_push_constants(commands, kernel.layout, all, 0, bytes);
            }
            self.device
                .cmd_dispatch(commands, groups[0], groups[1], groups[2]);
        }
    }

    /// Binds a pipeline and its sets, with dynamic offsets.
    pub fn bind_kernel(
        &self,
        commands: vk::CommandBuffer,
        kernel: Kernel,
        sets: &[Set],
        offsets: &[u32],
    ) {
        let handles: Vec<vk::DescriptorSet> = sets.iter().map(|set| set.handle).collect();
        let (device, point) = (&self.device, vk::PipelineBindPoint::COMPUTE);
        // SAFETY: the command buffer is being recorded, and the handles are of this device.
        unsafe {
            device.cmd_bind_pipeline(commands, point, kernel.pipeline);
            if !handles.is_empty() {
                let layout = kernel.layout;
                device.cmd_bind_descriptor_sets(commands, point, layout, 0, &handles, offsets);
            }
        }
    }

    /// The short way: storage buffers at bindings 0, 1, … of set 0, and no push constants.
    pub fn compute(&self, source: &str, buffers: &[Buffer], groups: [u32; 3]) {
        let bound: Vec<Bound> = buffers.iter().map(|&buffer| buffer.into()).collect();
        let set = self.set_of(&bound);
        let kernel = self.kernel(source, &[set.layout]);
        self.dispatch::<u32>(kernel, &[set], &[], groups);
    }

    /// The same with anything bound to set 0.
    pub fn compute_with(&self, source: &str, bindings: &[(u32, &[Bound])], groups: [u32; 3]) {
        let set = self.set(bindings);
        let kernel = self.kernel(source, &[set.layout]);
        self.dispatch::<u32>(kernel, &[set], &[], groups);
    }
}
