//! Shader objects (`VK_EXT_shader_object`).

#![forbid(unsafe_code)]

use std::sync::Arc;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::program::Stage;

use super::captured::Captured;
use super::embedded_sampler::EmbeddedSampler;
use super::pipeline::PipelineKind;
use super::shader_stage::{Compiler, ShaderStage};
use super::stage_program::ProgramKey;
use super::{Pipeline, PipelineCache, PipelineLayout};
use crate::VkResult;
use crate::handle::{self, Ref};

/// A shader.
pub struct ShaderObject {
    pub program: Arc<Program>,
    /// A compute shader as a pipeline.
    pub compute: Option<Ref<Pipeline>>,
    key: ProgramKey,
    /// The embedded samplers of the program, with their numbers on the device; at most 255.
    embedded: Vec<EmbeddedSampler>,
    /// A cache with only this program. The shader's binary is the key, the samplers and the cache's
    /// data.
    cache: PipelineCache,
}

impl ShaderObject {
    /// Creates a shader from SPIR-V.
    ///
    /// # Errors
    /// As [`ShaderStage::compile`].
    pub fn compile(
        stage: &ShaderStage,
        compiler: &Compiler<'_>,
        layout: Ref<PipelineLayout>,
    ) -> VkResult<Self> {
        let cache = PipelineCache::default();
        let compiled = stage
            .compile(compiler, Some(&cache), &layout, true)?
            .program;
        let embedded = stage.embedded_samplers(compiler)?;
        Ok(Self::new(
            compiled.program,
            compiled.key,
            cache,
            layout,
            embedded,
        ))
    }

    /// Creates a shader from the data of [`Self::binary`].
    ///
    /// # Errors
    /// `VK_INCOMPATIBLE_SHADER_BINARY_EXT`.
    pub fn from_binary(
        data: &[u8],
        compiler: &Compiler<'_>,
        layout: Ref<PipelineLayout>,
    ) -> VkResult<Self> {
        let split = data.split_first_chunk::<{ size_of::<ProgramKey>() }>();
        let incompatible = vk::Result::INCOMPATIBLE_SHADER_BINARY_EXT;
        let (key, data) = split.ok_or(incompatible)?;
        let (&count, data) = data.split_first().ok_or(incompatible)?;
        let bytes = usize::from(count) * size_of::<EmbeddedSampler>();
        let (embedded, data) = data.split_at_checked(bytes).ok_or(incompatible)?;
        let embedded = embedded.as_chunks().0.to_vec();
        if !embedded.iter().all(|it| compiler.samplers.place(it)) {
            return Err(incompatible);
        }
        let cache = PipelineCache::with_data(data);
        let (program, _) = cache
            .find(key)
            .ok_or(vk::Result::INCOMPATIBLE_SHADER_BINARY_EXT)?;
        Ok(Self::new(program, *key, cache, layout, embedded))
    }

    fn new(
        program: Arc<Program>,
        key: ProgramKey,
        cache: PipelineCache,
        layout: Ref<PipelineLayout>,
        embedded: Vec<EmbeddedSampler>,
    ) -> Self {
        let compute = (program.stage() == Stage::Compute).then(|| {
            handle::new(Pipeline {
                layout,
                kind: PipelineKind::Compute(Arc::clone(&program)),
                captured: Captured::default(),
            })
        });
        Self {
            program,
            compute,
            key,
            embedded,
            cache,
        }
    }

    /// `vkGetShaderBinaryDataEXT`.
    pub fn binary(&self) -> Vec<u8> {
        let count = self.embedded.len() as u8;
        let embedded = self.embedded.as_flattened();
        [
            &self.key[..],
            &[count],
            embedded,
            &self.cache.data(usize::MAX).0,
        ]
        .concat()
    }
}
