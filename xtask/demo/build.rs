//! Compiles the GLSL shaders to SPIR-V, so that the first pixel does not wait for a compiler.

use std::path::{Path, PathBuf};
use std::{env, fs};

use glslang::{
    Compiler, CompilerOptions, Shader, ShaderInput, ShaderMessage, ShaderSource, ShaderStage,
    SourceLanguage, SpirvVersion, Target, VulkanVersion,
};

fn main() {
    let shaders = PathBuf::from(env::var("CARGO_MANIFEST_DIR").unwrap()).join("shaders");
    let out = PathBuf::from(env::var("OUT_DIR").unwrap());
    println!("cargo:rerun-if-changed={}", shaders.display());
    let compiler = Compiler::acquire().expect("glslang starts");
    for entry in fs::read_dir(&shaders).unwrap() {
        let path = entry.unwrap().path();
        let Some(stage) = stage_of(&path) else {
            continue;
        };
        let source = ShaderSource::from(with_includes(&path));
        let options = CompilerOptions {
            source_language: SourceLanguage::GLSL,
            target: Target::Vulkan {
                version: VulkanVersion::Vulkan1_2,
                spirv_version: SpirvVersion::SPIRV1_5,
            },
            version_profile: None,
            messages: ShaderMessage::DEFAULT,
        };
        let words = ShaderInput::new(&source, stage, &options, None, None)
            .and_then(|input| Shader::new(compiler, input).parse())
            .and_then(|shader| shader.compile())
            .unwrap_or_else(|error| panic!("{}:\n{error}", path.display()));
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let name = path.file_name().unwrap().to_str().unwrap();
        fs::write(out.join(format!("{name}.spv")), bytes).unwrap();
    }
}

/// The stage that a file name ends in; `None` for included files.
fn stage_of(path: &Path) -> Option<ShaderStage> {
    Some(match path.extension()?.to_str()? {
        "vert" => ShaderStage::Vertex,
        "frag" => ShaderStage::Fragment,
        "rgen" => ShaderStage::RayGeneration,
        "rchit" => ShaderStage::ClosestHit,
        "rahit" => ShaderStage::AnyHit,
        "rint" => ShaderStage::Intersect,
        "rmiss" => ShaderStage::Miss,
        _ => return None,
    })
}

/// The text of a shader with each `#include "file"` line replaced by that file, found beside it.
fn with_includes(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut all = String::new();
    for line in text.lines() {
        match line
            .strip_prefix("#include \"")
            .and_then(|rest| rest.strip_suffix('"'))
        {
            Some(name) => all += &with_includes(&path.with_file_name(name)),
            None => {
                all += line;
                all.push('\n');
            }
        }
    }
    all
}
