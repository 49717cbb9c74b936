//! A compiled stage, and the key that names what it was compiled from.

#![forbid(unsafe_code)]

use std::sync::Arc;

use spirv_jit::Program;

/// What makes two compilations the same: the module, its entry point and stage, the specialization and where its descriptors are.
pub type ProgramKey = [u8; 16];

/// A compiled stage of a pipeline or library.
#[derive(Clone)]
pub struct StageProgram {
    pub program: Arc<Program>,
    pub key: ProgramKey,
}
