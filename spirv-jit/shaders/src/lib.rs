//! Shaders for the tests, examples and searches of spirv-jit, and runs of them: GLSL over plain
//! memory, and modules that were corrupted over memory that is watched.

pub mod code_pages;
#[cfg(feature = "glsl")]
pub mod compute;
pub mod corrupt;
#[cfg(feature = "glsl")]
mod glsl;
#[cfg(feature = "glsl")]
pub mod raster;
#[cfg(feature = "glsl")]
pub mod samples;

use std::sync::LazyLock;

#[cfg(feature = "glsl")]
pub use self::glsl::glsl;
use rspirv::spirv::Capability;
use spirv_jit::ir::op::DescriptorBinding;
use spirv_jit::parse::NewerCapability;
use spirv_jit::program::Stage;
use spirv_jit::{Accuracy, CompileRequest, Error, ir};

/// Every (set, binding) is `count` descriptors from `16 * binding` on.
fn bindings(set: u32, binding: u32) -> Option<DescriptorBinding> {
    Some(DescriptorBinding {
        set,
        first: binding.wrapping_mul(16),
        count: 16,
        dynamic: false,
    })
}

/// Every capability that SPIR-V has numbers for below the vendors' upper ranges: whatever is
/// refused then, the front end refuses.
static CAPABILITIES: LazyLock<Vec<Capability>> =
    LazyLock::new(|| (0..8000).filter_map(Capability::from_u32).collect());

/// Asks for the entry point `main`, with 16 descriptors from `16 * binding` on in each binding.
pub fn request(stage: Stage, words: &[u32]) -> CompileRequest<'_> {
    CompileRequest {
        words,
        entry_point: "main",
        stage,
        specialization: &[],
        mappings: &[],
        bindings: &bindings,
        capabilities: &CAPABILITIES,
        newer_capabilities: NewerCapability::ALL,
        accuracy: Accuracy::Spec,
        prints: true,
        checks_alignment: false,
        micromaps_by_mode: false,
        view_index_is_device_index: false,
        indexes_in_64_bits: false,
    }
}

/// Lowers a module and holds the result against the verifier.
pub fn lower(request: &CompileRequest<'_>) -> Result<ir::Module, Error> {
    let parsed = spirv_jit::parse::parse(request.words)?;
    let module = spirv_jit::lower::lower_module(&parsed, request)?;
    if let Err(message) = ir::verify(&module) {
        panic!("{message}\n{}", ir::text::print_module(&module));
    }
    Ok(module)
}

/// Compiles and lowers GLSL that must be accepted.
#[cfg(feature = "glsl")]
pub fn lower_glsl(stage: Stage, source: &str) -> ir::Module {
    let words = glsl(stage, source);
    lower(&request(stage, &words)).unwrap_or_else(|error| panic!("{error}\n{source}"))
}
