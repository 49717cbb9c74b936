//! Shader modules, pipeline layouts and pipelines.

#![forbid(unsafe_code)]

use std::sync::Arc;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::ir::op::DescriptorBinding;

use super::DescriptorSetLayout;
use super::deferred_pipeline::DeferredPipeline;
use super::graphics_pipeline::GraphicsPipeline;
use super::ray_tracing_pipeline::RayTracingPipeline;
use crate::handle::Ref;
use crate::table::limits::MAX_DYNAMIC_BUFFERS;
use crate::wave::table::Group;

/// A shader module: its words, checked when a pipeline uses them.
pub struct ShaderModule {
    pub words: Arc<[u32]>,
}

/// Dynamic buffers of a set have numbers of their own: those of set n begin at n times this, so that a program's places depend on the
/// layouts of the sets that it uses and on no other (pipeline libraries, shader objects). Twice the limit: uniform and storage buffers.
pub const DYNAMIC_OF_SET: u32 = 2 * MAX_DYNAMIC_BUFFERS;

/// A pipeline layout.
pub struct PipelineLayout {
    /// By set number; `None` where the application gave `VK_NULL_HANDLE`.
    pub sets: Vec<Option<Ref<DescriptorSetLayout>>>,
    pub push_constant_bytes: u32,
}

impl PipelineLayout {
    pub fn new(sets: Vec<Option<Ref<DescriptorSetLayout>>>, push_constant_bytes: u32) -> Self {
        Self {
            sets,
            push_constant_bytes,
        }
    }

    /// Where a shader finds the descriptors of (`set`, `binding`).
    pub fn descriptor_binding(&self, set: u32, binding: u32) -> Option<DescriptorBinding> {
        let layout = self.sets.get(set as usize)?.as_ref()?;
        let binding = layout.binding(binding)?;
        let dynamic = binding.is_dynamic();
        let base = if dynamic { set * DYNAMIC_OF_SET } else { 0 };
        Some(DescriptorBinding {
            set,
            first: base + binding.first,
            count: if binding.is_variable() {
                u32::MAX
            } else {
                binding.entry_count()
            },
            dynamic,
        })
    }
}

/// A pipeline.
pub struct Pipeline {
    pub layout: Ref<PipelineLayout>,
    pub kind: PipelineKind,
}

/// What a pipeline runs.
pub enum PipelineKind {
    Compute(Arc<Program>),
    Graphics(Box<GraphicsPipeline>),
    RayTracing(RayTracingPipeline),
    Deferred(DeferredPipeline),
}

impl Pipeline {
    pub fn bind_point(&self) -> vk::PipelineBindPoint {
        match self.kind {
            PipelineKind::Compute(_) => vk::PipelineBindPoint::COMPUTE,
            PipelineKind::Graphics(_) => vk::PipelineBindPoint::GRAPHICS,
            PipelineKind::RayTracing(_) | PipelineKind::Deferred(_) => {
                vk::PipelineBindPoint::RAY_TRACING_KHR
            }
        }
    }

    /// The ray tracing pipeline that it is, as far as that can run.
    pub fn ray_tracing(&self) -> Option<&RayTracingPipeline> {
        match &self.kind {
            PipelineKind::RayTracing(pipeline) => Some(pipeline),
            PipelineKind::Deferred(pipeline) => pipeline.linked(),
            PipelineKind::Compute(_) | PipelineKind::Graphics(_) => None,
        }
    }

    /// Its shader groups; none, of other pipelines than those for ray tracing.
    pub fn groups(&self) -> &[Group] {
        match &self.kind {
            PipelineKind::RayTracing(pipeline) => &pipeline.shaders.groups,
            PipelineKind::Deferred(pipeline) => &pipeline.groups,
            PipelineKind::Compute(_) | PipelineKind::Graphics(_) => &[],
        }
    }
}

/// What makes two compilations the same: the module, its entry point and stage, the specialization and where its descriptors are.
pub type ProgramKey = [u8; 16];
