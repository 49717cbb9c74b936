//! Ray tracing pipelines whose shaders are compiled one by one
//! (`VK_PIPELINE_CREATE_DEFER_COMPILE_BIT_NV`).

#![forbid(unsafe_code)]

use std::sync::OnceLock;

use ash::vk;

use super::captured::{Captured, keeps_modules};
use super::ray_tracing_pipeline::{GroupInfo, RayTracingPipeline, new_groups};
use super::shader_stage::{Compiler, ShaderStage};
use super::stage_program::{ProgramKey, StageProgram};
use super::{PipelineCache, PipelineLayout};
use crate::VkResult;
use crate::handle::Ref;
use crate::wave::binding_table::Group;

/// A pipeline that is linked once all its shaders are compiled.
pub struct DeferredPipeline {
    stages: Vec<DeferredStage>,
    group_infos: Vec<GroupInfo>,
    /// The groups with their final handles, which follow from the sources of the shaders.
    pub groups: Vec<Group>,
    cache: Option<Ref<PipelineCache>>,
    max_recursion_depth: u32,
    flags: vk::PipelineCreateFlags,
    linked: OnceLock<RayTracingPipeline>,
}

struct DeferredStage {
    stage: ShaderStage,
    program: OnceLock<StageProgram>,
}

impl DeferredPipeline {
    /// Creates the pipeline without compiled shaders.
    pub fn new(
        stages: Vec<ShaderStage>,
        group_infos: Vec<GroupInfo>,
        layout: &PipelineLayout,
        compiler: &Compiler<'_>,
        cache: Option<Ref<PipelineCache>>,
        max_recursion_depth: u32,
        flags: vk::PipelineCreateFlags,
    ) -> Self {
        let keys: Vec<ProgramKey> = stages
            .iter()
            .map(|stage| stage.key(layout, compiler))
            .collect();
        let deferred = |stage| DeferredStage {
            stage,
            program: OnceLock::new(),
        };
        Self {
            stages: stages.into_iter().map(deferred).collect(),
            groups: new_groups(&group_infos, &keys),
            group_infos,
            cache,
            max_recursion_depth,
            flags,
            linked: OnceLock::new(),
        }
    }

    /// Compiles a shader; the last one links the pipeline (`vkCompileDeferredNV`). Threads may
    /// compile different shaders at once.
    ///
    /// # Errors
    /// As [`ShaderStage::compile`]; `VK_ERROR_UNKNOWN` for an invalid shader index.
    pub fn compile(
        &self,
        compiler: &Compiler<'_>,
        layout: &PipelineLayout,
        captured: &Captured,
        shader: u32,
    ) -> VkResult {
        let deferred = self.stages.get(shader as usize);
        let deferred = deferred.ok_or(vk::Result::ERROR_UNKNOWN)?;
        if deferred.program.get().is_none() {
            let cache = self.cache.as_ref().map(|cache| &***cache);
            let compiler = Compiler {
                keeps_modules: keeps_modules(self.flags),
                ..*compiler
            };
            let compiled = deferred.stage.compile(&compiler, cache, layout, true)?;
            if deferred.program.set(compiled.program.clone()).is_ok() {
                captured.add(compiled.program);
            }
        }
        let programs = self.stages.iter().map(|stage| stage.program.get().cloned());
        if let Some(programs) = programs.collect() {
            self.linked.get_or_init(|| self.link(programs));
        }
        Ok(())
    }

    /// The pipeline; `None` until all shaders are compiled.
    pub fn linked(&self) -> Option<&RayTracingPipeline> {
        self.linked.get()
    }

    fn link(&self, programs: Vec<StageProgram>) -> RayTracingPipeline {
        let (infos, depth) = (&self.group_infos, self.max_recursion_depth);
        RayTracingPipeline::link(programs, infos, &[], depth, self.flags, false)
    }
}
