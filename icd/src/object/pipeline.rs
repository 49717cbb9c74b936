//! Shader modules, pipeline layouts, pipelines and the cache of compiled programs.

#![forbid(unsafe_code)]

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Weak};

use ash::vk;
use parking_lot::Mutex;
use spirv_jit::error::ErrorKind;
use spirv_jit::ir::op::DescriptorBinding;
use spirv_jit::program::Stage;
use spirv_jit::{CompileRequest, Program};

use super::{DescriptorSetLayout, Device};
use crate::VkResult;
use crate::handle::Ref;

/// A shader module: its words, checked when a pipeline uses them.
pub struct ShaderModule {
    pub words: Arc<[u32]>,
}

/// A pipeline layout.
pub struct PipelineLayout {
    /// By set number; `None` where the application gave `VK_NULL_HANDLE`.
    pub sets: Vec<Option<Ref<DescriptorSetLayout>>>,
    /// Per set: its first dynamic buffer among those of all sets.
    pub dynamic_first: Vec<u32>,
    pub dynamic_count: u32,
    pub push_constant_bytes: u32,
}

impl PipelineLayout {
    /// Numbers the dynamic buffers of all sets.
    pub fn new(sets: Vec<Option<Ref<DescriptorSetLayout>>>, push_constant_bytes: u32) -> Self {
        let mut dynamic_count = 0;
        let dynamic_first = sets
            .iter()
            .map(|set| {
                let first = dynamic_count;
                dynamic_count += set.as_ref().map_or(0, |set| set.dynamic_count);
                first
            })
            .collect();
        Self {
            sets,
            dynamic_first,
            dynamic_count,
            push_constant_bytes,
        }
    }

    /// Where a shader finds the descriptors of (`set`, `binding`).
    pub fn descriptor_binding(&self, set: u32, binding: u32) -> Option<DescriptorBinding> {
        let layout = self.sets.get(set as usize)?.as_ref()?;
        let binding = layout.binding(binding)?;
        let dynamic = binding.is_dynamic();
        let base = if dynamic {
            self.dynamic_first[set as usize]
        } else {
            0
        };
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
}

impl Pipeline {
    pub fn bind_point(&self) -> vk::PipelineBindPoint {
        match self.kind {
            PipelineKind::Compute(_) => vk::PipelineBindPoint::COMPUTE,
        }
    }
}

/// A shader stage, decoded.
pub struct ShaderStage {
    pub words: Arc<[u32]>,
    pub entry_point: String,
    pub stage: Stage,
    pub specialization: Vec<(u32, Vec<u8>)>,
    /// The module's handle, for its name in messages.
    pub module: u64,
}

impl ShaderStage {
    /// The stage of a stage bit; `None` for those that do not exist here.
    pub fn from_flag(flag: vk::ShaderStageFlags) -> Option<Stage> {
        Some(match flag {
            vk::ShaderStageFlags::COMPUTE => Stage::Compute,
            vk::ShaderStageFlags::RAYGEN_KHR => Stage::RayGeneration,
            vk::ShaderStageFlags::INTERSECTION_KHR => Stage::Intersection,
            vk::ShaderStageFlags::ANY_HIT_KHR => Stage::AnyHit,
            vk::ShaderStageFlags::CLOSEST_HIT_KHR => Stage::ClosestHit,
            vk::ShaderStageFlags::MISS_KHR => Stage::Miss,
            vk::ShaderStageFlags::CALLABLE_KHR => Stage::Callable,
            _ => return None,
        })
    }

    /// The key of a compilation with this layout.
    pub fn key(&self, layout: &PipelineLayout) -> ProgramKey {
        let half = |seed: u8| {
            let mut hasher = DefaultHasher::new();
            seed.hash(&mut hasher);
            self.words.hash(&mut hasher);
            self.entry_point.hash(&mut hasher);
            self.stage.hash(&mut hasher);
            self.specialization.hash(&mut hasher);
            for (set, set_layout) in layout.sets.iter().enumerate() {
                for binding in set_layout.iter().flat_map(|set| &set.bindings) {
                    binding.binding.hash(&mut hasher);
                    layout
                        .descriptor_binding(set as u32, binding.binding)
                        .hash(&mut hasher);
                }
            }
            hasher.finish()
        };
        [half(0), half(1)]
    }
}

/// What makes two compilations the same: 128 bits of hash over the module, its entry point and stage, the specialization and where
/// its descriptors are.
pub type ProgramKey = [u64; 2];

/// A program, and whether the application's cache had it.
pub struct Compiled {
    pub program: Arc<Program>,
    pub cache_hit: bool,
}

/// A pipeline cache: compiled programs by what they were compiled from.
#[derive(Default)]
pub struct PipelineCache {
    programs: Mutex<HashMap<ProgramKey, Arc<Program>>>,
}

impl PipelineCache {
    /// Takes over what another cache has.
    pub fn merge(&self, other: &PipelineCache) {
        let others: Vec<_> = other
            .programs
            .lock()
            .iter()
            .map(|(key, program)| (*key, Arc::clone(program)))
            .collect();
        self.programs.lock().extend(others);
    }
}

/// The programs of a device's living pipelines: the same shader is not compiled twice while one of them is there.
#[derive(Default)]
pub struct LivingPrograms {
    programs: Mutex<HashMap<ProgramKey, Weak<Program>>>,
}

impl LivingPrograms {
    fn find(&self, key: &ProgramKey) -> Option<Arc<Program>> {
        self.programs.lock().get(key)?.upgrade()
    }

    fn insert(&self, key: ProgramKey, program: &Arc<Program>) {
        let mut programs = self.programs.lock();
        if programs.len() == programs.capacity() {
            programs.retain(|_, program| program.strong_count() > 0);
        }
        programs.insert(key, Arc::downgrade(program));
    }
}

impl Device {
    /// Compiles a stage, or finds it compiled.
    ///
    /// # Errors
    /// `VK_PIPELINE_COMPILE_REQUIRED` if it would have to be compiled and may not; `VK_ERROR_INVALID_SHADER_NV` for a module that is
    /// refused, with one message; `VK_ERROR_OUT_OF_HOST_MEMORY` past the compiler's budget.
    pub fn compile(
        &self,
        cache: Option<&PipelineCache>,
        stage: &ShaderStage,
        layout: &PipelineLayout,
        allowed: bool,
    ) -> VkResult<Compiled> {
        let key = stage.key(layout);
        if let Some(program) = cache.and_then(|cache| cache.programs.lock().get(&key).cloned()) {
            return Ok(Compiled {
                program,
                cache_hit: true,
            });
        }
        let program = match self.programs.find(&key) {
            Some(program) => program,
            None if !allowed => return Err(vk::Result::PIPELINE_COMPILE_REQUIRED),
            None => self.compile_anew(stage, layout)?,
        };
        self.programs.insert(key, &program);
        if let Some(cache) = cache {
            cache.programs.lock().insert(key, Arc::clone(&program));
        }
        Ok(Compiled {
            program,
            cache_hit: false,
        })
    }

    fn compile_anew(&self, stage: &ShaderStage, layout: &PipelineLayout) -> VkResult<Arc<Program>> {
        let specialization: Vec<(u32, &[u8])> = stage
            .specialization
            .iter()
            .map(|(id, bytes)| (*id, bytes.as_slice()))
            .collect();
        spirv_jit::compile(&CompileRequest {
            words: &stage.words,
            entry_point: &stage.entry_point,
            stage: stage.stage,
            specialization: &specialization,
            bindings: &|set, binding| layout.descriptor_binding(set, binding),
            capabilities: &self.capabilities,
        })
        .map_err(|error| {
            let name = self
                .object_name(stage.module)
                .unwrap_or_else(|| format!("shader module {:#x}", stage.module));
            let message = format!(
                "{name}, entry point \"{}\" ({:?}): {error}",
                stage.entry_point, stage.stage
            );
            self.messengers.error(c"Tuff-shader", &message);
            match error.kind {
                ErrorKind::Budget => vk::Result::ERROR_OUT_OF_HOST_MEMORY,
                ErrorKind::Invalid | ErrorKind::Unsupported | ErrorKind::EntryPoint => {
                    vk::Result::ERROR_INVALID_SHADER_NV
                }
            }
        })
    }
}
