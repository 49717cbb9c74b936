//! glslang, in this process.

use std::sync::{Mutex, PoisonError};

use glslang::{
    Compiler, CompilerOptions, Shader, ShaderInput, ShaderMessage, ShaderSource, ShaderStage,
    SourceLanguage, SpirvVersion, Target, VulkanVersion,
};

use crate::Version;

/// Compiles GLSL for a stage, which has the name that glslang's program gives its files.
///
/// # Errors
/// glslang's message, or that there is no such stage.
pub fn compile(stage: &str, version: Version, text: &str) -> Result<Vec<u32>, String> {
    // glslang keeps state that is shared by all threads.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let stage = glslang_stage(stage).ok_or_else(|| format!("no stage is named {stage}"))?;
    let options = CompilerOptions {
        source_language: SourceLanguage::GLSL,
        target: Target::Vulkan {
            version: VulkanVersion::Vulkan1_3,
            spirv_version: match version {
                Version::V1_4 => SpirvVersion::SPIRV1_4,
                Version::V1_6 => SpirvVersion::SPIRV1_6,
            },
        },
        version_profile: None,
        messages: ShaderMessage::DEFAULT,
    };
    let compiler = Compiler::acquire().ok_or("glslang does not start")?;
    let source = ShaderSource::from(text);
    ShaderInput::new(&source, stage, &options, None, None)
        .and_then(|input| Shader::new(compiler, input).parse())
        .and_then(|shader| shader.compile())
        .map_err(|error| error.to_string())
}

fn glslang_stage(name: &str) -> Option<ShaderStage> {
    Some(match name {
        "comp" => ShaderStage::Compute,
        "rgen" => ShaderStage::RayGeneration,
        "rmiss" => ShaderStage::Miss,
        "rchit" => ShaderStage::ClosestHit,
        "rahit" => ShaderStage::AnyHit,
        "rint" => ShaderStage::Intersect,
        "rcall" => ShaderStage::Callable,
        "vert" => ShaderStage::Vertex,
        "tesc" => ShaderStage::TesselationControl,
        "tese" => ShaderStage::TesselationEvaluation,
        "geom" => ShaderStage::Geometry,
        "task" => ShaderStage::Task,
        "mesh" => ShaderStage::Mesh,
        "frag" => ShaderStage::Fragment,
        _ => return None,
    })
}
