//! A compiled stage, and the key of its sources.

#![forbid(unsafe_code)]

use std::sync::Arc;

use spirv_jit::Program;

use super::embedded_sampler::EmbeddedSampler;

/// The identity of a compilation: module, entry point, stage, specialization and descriptor
/// locations.
pub type ProgramKey = [u8; 16];

/// A compiled stage of a pipeline or library.
#[derive(Clone)]
pub struct StageProgram {
    pub program: Arc<Program>,
    pub key: ProgramKey,
    /// Bytes of the module (`spirv_jit::ir::binary`), if the application captures them.
    pub module: Option<Arc<[u8]>>,
    /// The embedded samplers, if the application captures the module.
    pub embedded: Arc<[EmbeddedSampler]>,
}
