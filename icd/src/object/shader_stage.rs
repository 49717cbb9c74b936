//! A shader stage and its compilation to a program, through the pipeline cache.

#![forbid(unsafe_code)]

use std::hash::Hash;
use std::sync::Arc;
use std::time::Instant;

use ash::vk;
use images::SamplerDescriptor;
use rspirv::spirv::Capability;
use serde_json::json;
use spirv_jit::Program;
use spirv_jit::descriptor_heap::{Mapping, Source};
use spirv_jit::error::ErrorKind;
use spirv_jit::ir::{Module, binary};
use spirv_jit::origin::{Name, Origin, file_of, has_lines};
use spirv_jit::parse::NewerCapability;
use spirv_jit::program::{CompileRequest, Stage};
use xxhash_rust::xxh3::Xxh3;

use super::descriptor_heap::HeapSamplers;
use super::embedded_sampler::{EmbeddedSampler, encode};
use super::messenger::Messengers;
use super::pipeline_binary::StoredModule;
use super::stage_program::{ProgramKey, StageProgram};
use super::{PipelineCache, PipelineLayout};
use crate::VkResult;
use crate::settings::settings;
use crate::timeline::{self, Kind};

/// Compiler settings that all shaders of a device share.
pub struct Compiler<'a> {
    /// Capabilities that modules may declare.
    pub capabilities: &'a [Capability],
    /// Capabilities that the SPIR-V bindings lack.
    pub newer_capabilities: &'a [NewerCapability],
    pub messengers: &'a Messengers,
    /// Programs count misaligned pointers, for validation.
    pub checks_alignment: bool,
    /// Ray queries use micromaps only with an execution mode.
    pub micromaps_by_mode: bool,
    /// Programs keep their modules' bytes.
    pub keeps_modules: bool,
    /// The samplers that programs embed.
    pub samplers: &'a HeapSamplers,
}

/// `VkPipelineShaderStageCreateInfo`, copied.
#[derive(Clone, Debug)]
pub struct ShaderStage {
    pub words: Arc<[u32]>,
    /// The name of the module.
    pub name: Arc<Name>,
    pub entry_point: String,
    pub stage: Stage,
    /// `SpecId` and bytes.
    pub specialization: Vec<(u32, Vec<u8>)>,
    /// `VK_PIPELINE_CREATE_VIEW_INDEX_FROM_DEVICE_INDEX_BIT` of the pipeline, or of the library
    /// that the stage comes with.
    pub view_index_is_device_index: bool,
    /// `VK_PIPELINE_CREATE_2_64_BIT_INDEXING_BIT_EXT` of the pipeline or library, or
    /// `VK_SHADER_CREATE_64_BIT_INDEXING_BIT_EXT` of the shader.
    pub indexes_in_64_bits: bool,
    /// Mappings of bindings to heaps, which name samplers by index in `embedded`.
    pub mappings: Vec<Mapping>,
    pub embedded: Vec<SamplerDescriptor>,
}

/// A program, and whether it was in the cache.
pub struct Compiled {
    pub program: StageProgram,
    pub cache_hit: bool,
}

impl ShaderStage {
    /// The identity of a compilation: module, entry point, stage, specialization, descriptor
    /// locations and mappings, accuracy of functions, the meaning of its view index, whether its
    /// queries look at micromaps only in a mode, whether its indices have 64 bits, and whether it
    /// prints.
    pub fn key(&self, layout: &PipelineLayout, compiler: &Compiler<'_>) -> ProgramKey {
        let mut hash = Xxh3::new();
        for word in self.words.iter() {
            hash.update(&word.to_le_bytes());
        }
        hash.update(&(self.words.len() as u64).to_le_bytes());
        hash.update(self.entry_point.as_bytes());
        let switches = u8::from(self.view_index_is_device_index)
            | u8::from(compiler.micromaps_by_mode) << 1
            | u8::from(self.indexes_in_64_bits) << 2;
        let prints = u8::from(settings().prints.is_some());
        hash.update(&[
            0,
            self.stage as u8,
            settings().accuracy as u8,
            switches,
            prints,
        ]);
        for (id, bytes) in &self.specialization {
            hash.update(&id.to_le_bytes());
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        }
        for (set, set_layout) in (0..).zip(&layout.sets) {
            for binding in set_layout.iter().flat_map(|layout| &layout.bindings) {
                let place = layout.descriptor_binding(set, binding.binding);
                let words = place.map_or([0; 4], |place| {
                    [
                        place.set,
                        place.first,
                        place.count,
                        u32::from(place.dynamic),
                    ]
                });
                for word in [set, binding.binding].into_iter().chain(words) {
                    hash.update(&word.to_le_bytes());
                }
            }
        }
        if !self.mappings.is_empty() {
            // If memory for a sampler is exhausted, the compilation fails later.
            self.numbered(compiler).unwrap_or_default().hash(&mut hash);
            // A number may belong to another sampler in another process.
            hash.update(format!("{:?}", self.embedded).as_bytes());
        }
        hash.digest128().to_le_bytes()
    }

    /// The mappings, with the numbers of their embedded samplers.
    fn numbered(&self, compiler: &Compiler<'_>) -> VkResult<Vec<Mapping>> {
        let mut mappings = self.mappings.clone();
        for mapping in &mut mappings {
            if let Source::Heap(source) = &mut mapping.source
                && let Some(at) = &mut source.embedded
            {
                *at = compiler.samplers.embed(&self.embedded[*at as usize])?;
            }
        }
        Ok(mappings)
    }

    /// The samplers that the program embeds.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`, also for more than 255.
    pub fn embedded_samplers(&self, compiler: &Compiler<'_>) -> VkResult<Vec<EmbeddedSampler>> {
        if self.embedded.len() > usize::from(u8::MAX) {
            return Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY);
        }
        let embed = |sampler| compiler.samplers.embed(sampler);
        let identified = |sampler| Ok(encode(embed(sampler)?, sampler));
        self.embedded.iter().map(identified).collect()
    }

    /// The program's origin for reports. Module words with names of files or lines are kept for it.
    fn origin(&self) -> Origin {
        let is_told = has_lines(&self.words) || file_of(&self.words).is_some();
        Origin {
            entry_point: self.entry_point.clone(),
            name: Arc::clone(&self.name),
            pipeline: Name::default(),
            words: is_told.then(|| Arc::clone(&self.words)),
        }
    }

    /// Takes the program from the cache, or compiles it and puts it there.
    ///
    /// # Errors
    /// `VK_PIPELINE_COMPILE_REQUIRED` if it is not in the cache and `may_compile` is false;
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` for a module that would need too much memory;
    /// `VK_ERROR_UNKNOWN` for one that is malformed or needs an unadvertised feature. The debug
    /// messengers get the last two.
    pub fn compile(
        &self,
        compiler: &Compiler<'_>,
        cache: Option<&PipelineCache>,
        layout: &PipelineLayout,
        may_compile: bool,
    ) -> VkResult<Compiled> {
        let key = self.key(layout, compiler);
        let embedded = match compiler.keeps_modules {
            true => self.embedded_samplers(compiler)?.into(),
            false => Arc::default(),
        };
        let cached = cache.and_then(|cache| cache.find(&key));
        // Data from the application may be arbitrary.
        if let Some((program, module)) = cached.filter(|(it, _)| it.stage() == self.stage) {
            program.set_origin(self.origin());
            let program = StageProgram {
                program,
                key,
                module: compiler.keeps_modules.then_some(module),
                embedded,
            };
            return Ok(Compiled {
                program,
                cache_hit: true,
            });
        }
        if !may_compile {
            return Err(vk::Result::PIPELINE_COMPILE_REQUIRED);
        }
        let mappings = self.numbered(compiler)?;
        let _span = timeline::span(Kind::Compilation, || {
            let sizes = json!({
                "stage": format!("{:?}", self.stage),
                "words": self.words.len(),
                "module": self.name.text().as_deref(),
            });
            (format!("compile {}", self.entry_point), sizes)
        });
        let (program, module) = self.compile_module(compiler, layout, &mappings)?;
        let wanted = compiler.keeps_modules || cache.is_some();
        let bytes = wanted.then(|| Arc::<[u8]>::from(binary::encode(&module)));
        if let (Some(cache), Some(bytes)) = (cache, &bytes) {
            cache.insert(key, Arc::clone(bytes), Arc::clone(&program));
        }
        program.set_origin(self.origin());
        let program = StageProgram {
            program,
            key,
            module: bytes.filter(|_| compiler.keeps_modules),
            embedded,
        };
        Ok(Compiled {
            program,
            cache_hit: false,
        })
    }

    /// Compiles the module. The debug messengers get the reason of a failure.
    fn compile_module(
        &self,
        compiler: &Compiler<'_>,
        layout: &PipelineLayout,
        mappings: &[Mapping],
    ) -> VkResult<(Arc<Program>, Module)> {
        let specialization: Vec<_> = self
            .specialization
            .iter()
            .map(|(id, bytes)| (*id, &bytes[..]))
            .collect();
        let request = CompileRequest {
            words: &self.words,
            entry_point: &self.entry_point,
            stage: self.stage,
            specialization: &specialization,
            mappings,
            bindings: &|set, binding| layout.descriptor_binding(set, binding),
            capabilities: compiler.capabilities,
            newer_capabilities: compiler.newer_capabilities,
            accuracy: settings().accuracy,
            prints: settings().prints.is_some(),
            checks_alignment: compiler.checks_alignment,
            micromaps_by_mode: compiler.micromaps_by_mode,
            view_index_is_device_index: self.view_index_is_device_index,
            indexes_in_64_bits: self.indexes_in_64_bits,
        };
        let start = Instant::now();
        let compiled = spirv_jit::program::compile_module(&request)
            .and_then(|module| Ok((Arc::new(Program::new(&module)?), module)));
        let compiled = compiled.map_err(|error| {
            let message = format!("{:?} shader \"{}\": {error}", self.stage, self.entry_point);
            compiler
                .messengers
                .error(c"TUFF-shader-compilation", &message);
            match error.kind {
                ErrorKind::Budget => vk::Result::ERROR_OUT_OF_HOST_MEMORY,
                ErrorKind::Invalid | ErrorKind::Unsupported | ErrorKind::EntryPoint => {
                    vk::Result::ERROR_UNKNOWN
                }
            }
        })?;
        let (stage, name, milliseconds) = (
            self.stage,
            &self.entry_point,
            start.elapsed().as_secs_f64() * 1e3,
        );
        log::debug!("{stage:?} shader \"{name}\" compiled in {milliseconds:.2} ms");
        Ok(compiled)
    }

    /// Takes the program from a pipeline's binary; the stage's module is ignored.
    ///
    /// # Errors
    /// `VK_ERROR_UNKNOWN` for a binary of another stage, and if the number of an embedded sampler
    /// belongs to another sampler.
    pub fn load(&self, compiler: &Compiler<'_>, stored: &StoredModule) -> VkResult<Compiled> {
        if !(stored.embedded.iter()).all(|it| compiler.samplers.place(it)) {
            return Err(vk::Result::ERROR_UNKNOWN);
        }
        let program = spirv_jit::program::from_bytes(&stored.bytes).ok();
        let program = program.filter(|program| program.stage() == self.stage);
        let program = program.ok_or(vk::Result::ERROR_UNKNOWN)?;
        program.set_origin(self.origin());
        let program = StageProgram {
            program,
            key: stored.key,
            module: Some(Arc::clone(&stored.bytes)),
            embedded: Arc::clone(&stored.embedded),
        };
        Ok(Compiled {
            program,
            cache_hit: false,
        })
    }
}
