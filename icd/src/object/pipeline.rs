//! Shader modules and pipelines.

#![forbid(unsafe_code)]

use std::sync::Arc;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::origin::Name;

use super::PipelineLayout;
use super::captured::Captured;
use super::deferred_pipeline::DeferredPipeline;
use super::graphics_pipeline::GraphicsPipeline;
use super::ray_tracing_pipeline::RayTracingPipeline;
use crate::handle::Ref;
use crate::wave::binding_table::Group;

/// A shader module: its words, checked when a pipeline uses them.
pub struct ShaderModule {
    pub words: Arc<[u32]>,
    pub name: Arc<Name>,
}

/// A pipeline.
pub struct Pipeline {
    pub layout: Ref<PipelineLayout>,
    pub kind: PipelineKind,
    pub captured: Captured,
}

/// The programs of a pipeline, by bind point.
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

    /// Gives its programs the application's name for it. Pipelines that share programs through a
    /// cache share their names.
    pub fn set_name(&self, name: &str) {
        for program in self.programs() {
            if let Some(origin) = program.origin() {
                origin.pipeline.set(name);
            }
        }
    }

    /// The compiled programs.
    pub fn programs(&self) -> Vec<&Arc<Program>> {
        match &self.kind {
            PipelineKind::Compute(program) => vec![program],
            PipelineKind::Graphics(it) => it.stages.iter().collect(),
            PipelineKind::RayTracing(_) | PipelineKind::Deferred(_) => {
                let linked = self.ray_tracing();
                (linked.iter().flat_map(|it| &it.shaders.programs)).collect()
            }
        }
    }

    /// The ray tracing pipeline, if all its shaders are compiled.
    pub fn ray_tracing(&self) -> Option<&RayTracingPipeline> {
        match &self.kind {
            PipelineKind::RayTracing(pipeline) => Some(pipeline),
            PipelineKind::Deferred(pipeline) => pipeline.linked(),
            PipelineKind::Compute(_) | PipelineKind::Graphics(_) => None,
        }
    }

    /// The shader groups; none for other pipelines than ray tracing.
    pub fn groups(&self) -> &[Group] {
        match &self.kind {
            PipelineKind::RayTracing(pipeline) => &pipeline.shaders.groups,
            PipelineKind::Deferred(pipeline) => &pipeline.groups,
            PipelineKind::Compute(_) | PipelineKind::Graphics(_) => &[],
        }
    }
}
