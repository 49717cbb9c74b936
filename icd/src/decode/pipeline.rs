//! `VkPipelineShaderStageCreateInfo` to an owned [`ShaderStage`].

use std::ffi::c_char;
use std::sync::Arc;

use ash::vk;
use spirv_jit::origin::Name;
use spirv_jit::program::Stage;

use super::descriptor_heap::{Mappings, decode_mappings};
use crate::VkResult;
use crate::device::Device;
use crate::ffi::{find, slice, string, vk as newer};
use crate::handle::{self, Ref, from_handle};
use crate::object::captured::{Captured, keeps_modules};
use crate::object::pipeline_binary::StoredModule;
use crate::object::shader_stage::{Compiled, Compiler, ShaderStage};
use crate::object::{Pipeline, PipelineBinary, PipelineCache, PipelineLayout, ShaderModule};

/// The lower 32 bits of a pipeline's creation flags. A chained `VkPipelineCreateFlags2CreateInfo`
/// replaces the flags.
///
/// # Safety
/// The chain is valid.
pub unsafe fn create_flags(
    flags: vk::PipelineCreateFlags,
    next: *const std::ffi::c_void,
) -> vk::PipelineCreateFlags {
    // SAFETY: the caller guarantees that the chain is valid.
    let chained = unsafe { find::<vk::PipelineCreateFlags2CreateInfoKHR<'_>>(next) };
    chained.map_or(flags, |chained| {
        vk::PipelineCreateFlags::from_raw(chained.flags.as_raw() as u32)
    })
}

/// Whether the chain of a pipeline's creation asks for 64-bit indexing.
///
/// # Safety
/// The chain is valid.
unsafe fn indexes_in_64_bits(next: *const std::ffi::c_void) -> bool {
    // SAFETY: the caller guarantees that the chain is valid.
    let chained = unsafe { find::<vk::PipelineCreateFlags2CreateInfoKHR<'_>>(next) };
    chained.is_some_and(|it| {
        it.flags
            .contains(newer::PIPELINE_CREATE_2_64_BIT_INDEXING_EXT)
    })
}

/// The source of a new pipeline's programs.
pub struct ProgramSource<'a> {
    compiler: Compiler<'a>,
    cache: Option<&'a PipelineCache>,
    /// The programs of its binary, by stage, without compilation.
    stored: Option<&'a [StoredModule]>,
    flags: vk::PipelineCreateFlags,
}

impl<'a> ProgramSource<'a> {
    /// The source in a pipeline's flags and chain.
    ///
    /// # Errors
    /// `VK_ERROR_UNKNOWN` for several binaries, since a pipeline has one.
    ///
    /// # Safety
    /// The chain is valid, and its handles are alive for `'a`.
    pub unsafe fn of(
        device: &'a Device,
        cache: Option<&'a PipelineCache>,
        flags: vk::PipelineCreateFlags,
        next: *const std::ffi::c_void,
    ) -> VkResult<Self> {
        // SAFETY: the caller guarantees that the chain is valid, and its handles are alive for
        // `'a`.
        let binaries = unsafe {
            let info = find::<newer::PipelineBinaryInfoKHR<'_>>(next);
            info.map_or(&[][..], |it| slice(it.p_pipeline_binaries, it.binary_count))
        };
        let stored = match *binaries {
            [] => None,
            // SAFETY: the caller guarantees that the chain is valid, and its handles are alive for
            // `'a`.
            [binary] => Some(unsafe { &from_handle::<'a, PipelineBinary>(binary).modules[..] }),
            _ => return Err(vk::Result::ERROR_UNKNOWN),
        };
        let compiler = Compiler {
            keeps_modules: keeps_modules(flags),
            ..device.compiler()
        };
        Ok(Self {
            compiler,
            cache,
            stored,
            flags,
        })
    }

    /// The program of a stage. Also counts compiled stages.
    ///
    /// # Errors
    /// As [`ShaderStage::compile`] and [`ShaderStage::load`].
    pub fn program(
        &self,
        index: usize,
        stage: &ShaderStage,
        layout: &PipelineLayout,
    ) -> VkResult<Compiled> {
        if let Some(stored) = self.stored {
            return stage.load(
                &self.compiler,
                stored.get(index).ok_or(vk::Result::ERROR_UNKNOWN)?,
            );
        }
        let may_compile =
            !(self.flags).contains(vk::PipelineCreateFlags::FAIL_ON_PIPELINE_COMPILE_REQUIRED);
        stage.compile(&self.compiler, self.cache, layout, may_compile)
    }
}

/// Captures of the libraries in a `VkPipelineLibraryCreateInfoKHR`.
///
/// # Safety
/// The info is valid, and its libraries are alive for `'a`.
pub unsafe fn captured_libraries<'a>(
    info: Option<&vk::PipelineLibraryCreateInfoKHR<'_>>,
) -> impl Iterator<Item = &'a Captured> {
    // SAFETY: the caller guarantees that the info is valid, and its libraries are alive for `'a`.
    let libraries =
        unsafe { info.map_or(&[][..], |it| slice(it.p_libraries, it.library_count)) }.to_vec();
    // SAFETY: the caller guarantees that the info is valid, and its libraries are alive for `'a`.
    (libraries.into_iter()).map(|library| unsafe { &from_handle::<'a, Pipeline>(library).captured })
}

/// A pipeline's layout. Without one it is empty, since the bindings are mapped to heaps.
///
/// # Safety
/// The handle is null or that of a live layout.
pub unsafe fn pipeline_layout(layout: vk::PipelineLayout) -> Ref<PipelineLayout> {
    if layout == vk::PipelineLayout::null() {
        return handle::new(PipelineLayout::new(Vec::new(), 0));
    }
    // SAFETY: the caller guarantees that the handle is null or of a living layout.
    unsafe { handle::retain::<PipelineLayout>(layout) }
}

/// Copies a stage. Its words are shared with the module, or come from a chained create info without
/// a module (`VK_EXT_graphics_pipeline_library`, maintenance5). A stage with neither has no words,
/// and needs a pipeline binary. `next` is the chain of the pipeline's create info.
///
/// # Errors
/// `VK_ERROR_UNKNOWN` for a stage that is not advertised or an entry point name that is not UTF-8.
///
/// # Safety
/// The info and the chain are valid and the module alive.
pub unsafe fn decode_stage(
    info: &vk::PipelineShaderStageCreateInfo<'_>,
    next: *const std::ffi::c_void,
) -> VkResult<ShaderStage> {
    // SAFETY: the caller guarantees that the info and the chain are valid and the module alive.
    unsafe {
        let (words, name) = match handle::optional::<ShaderModule>(info.module) {
            Some(module) => (Arc::clone(&module.words), Arc::clone(&module.name)),
            None => {
                let module = find::<vk::ShaderModuleCreateInfo>(info.p_next);
                let words = module.map_or(&[][..], |module| {
                    slice(module.p_code, (module.code_size / 4) as u32)
                });
                (words.into(), chained_name(info.p_next))
            }
        };
        let Mappings { mappings, embedded } = decode_mappings(info.p_next);
        Ok(ShaderStage {
            mappings,
            embedded,
            words,
            name,
            entry_point: entry_point(info.p_name)?,
            stage: program_stage(info.stage).ok_or(vk::Result::ERROR_UNKNOWN)?,
            specialization: specialization(info.p_specialization_info),
            view_index_is_device_index: false,
            indexes_in_64_bits: indexes_in_64_bits(next),
        })
    }
}

/// # Safety
/// The name is a string.
unsafe fn entry_point(name: *const c_char) -> VkResult<String> {
    // SAFETY: the caller guarantees that the name is a string.
    let name = unsafe { string(name) }.to_str();
    Ok(name.map_err(|_| vk::Result::ERROR_UNKNOWN)?.to_owned())
}

/// The name of a stage's shader module, from a `VkDebugUtilsObjectNameInfoEXT` in the chain.
///
/// # Safety
/// The chain is valid.
unsafe fn chained_name(next: *const std::ffi::c_void) -> Arc<Name> {
    let name = Arc::<Name>::default();
    // SAFETY: the caller guarantees that the chain is valid; a name is a string or null.
    unsafe {
        let info = find::<vk::DebugUtilsObjectNameInfoEXT<'_>>(next);
        if let Some(info) = info.filter(|info| !info.p_object_name.is_null()) {
            name.set(&string(info.p_object_name).to_string_lossy());
        }
    }
    name
}

/// Copies the shader of a `VkShaderCreateInfoEXT` in SPIR-V.
///
/// # Errors
/// As [`decode_stage`].
///
/// # Safety
/// The info is valid.
pub unsafe fn decode_shader(info: &vk::ShaderCreateInfoEXT<'_>) -> VkResult<ShaderStage> {
    let words = u32::try_from(info.code_size / 4);
    let words = words.map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        let Mappings { mappings, embedded } = decode_mappings(info.p_next);
        Ok(ShaderStage {
            mappings,
            embedded,
            words: slice(info.p_code.cast::<u32>(), words).into(),
            name: Arc::default(),
            entry_point: entry_point(info.p_name)?,
            stage: program_stage(info.stage).ok_or(vk::Result::ERROR_UNKNOWN)?,
            specialization: specialization(info.p_specialization_info),
            view_index_is_device_index: false,
            indexes_in_64_bits: (info.flags).contains(newer::SHADER_CREATE_64_BIT_INDEXING_EXT),
        })
    }
}

/// # Safety
/// The info is null or valid.
unsafe fn specialization(info: *const vk::SpecializationInfo<'_>) -> Vec<(u32, Vec<u8>)> {
    // SAFETY: the caller guarantees that the info is null or valid; an entry outside the data is
    // dropped.
    unsafe {
        let Some(info) = info.as_ref() else {
            return Vec::new();
        };
        let data: &[u8] = slice(info.p_data.cast(), info.data_size as u32);
        slice(info.p_map_entries, info.map_entry_count)
            .iter()
            .filter_map(|entry| {
                let start = entry.offset as usize;
                let bytes = data.get(start..start.checked_add(entry.size)?)?;
                Some((entry.constant_id, bytes.to_vec()))
            })
            .collect()
    }
}

/// The program stage; `None` for an unsupported stage.
pub fn program_stage(stage: vk::ShaderStageFlags) -> Option<Stage> {
    Some(match stage {
        vk::ShaderStageFlags::COMPUTE => Stage::Compute,
        vk::ShaderStageFlags::RAYGEN_KHR => Stage::RayGeneration,
        vk::ShaderStageFlags::INTERSECTION_KHR => Stage::Intersection,
        vk::ShaderStageFlags::ANY_HIT_KHR => Stage::AnyHit,
        vk::ShaderStageFlags::CLOSEST_HIT_KHR => Stage::ClosestHit,
        vk::ShaderStageFlags::MISS_KHR => Stage::Miss,
        vk::ShaderStageFlags::CALLABLE_KHR => Stage::Callable,
        vk::ShaderStageFlags::VERTEX => Stage::Vertex,
        vk::ShaderStageFlags::TESSELLATION_CONTROL => Stage::TessellationControl,
        vk::ShaderStageFlags::TESSELLATION_EVALUATION => Stage::TessellationEvaluation,
        vk::ShaderStageFlags::GEOMETRY => Stage::Geometry,
        vk::ShaderStageFlags::TASK_EXT => Stage::Task,
        vk::ShaderStageFlags::MESH_EXT => Stage::Mesh,
        vk::ShaderStageFlags::FRAGMENT => Stage::Fragment,
        _ => return None,
    })
}
