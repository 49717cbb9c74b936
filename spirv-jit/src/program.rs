//! Compiled shaders, and how they are run: the seam between the compiler and the scheduler.

use std::sync::Arc;

use crate::error::Error;
use crate::ir;

pub use crate::interp::{Frame, Program};
pub use crate::ir::interface::{
    Barycentric, DepthMode, FragmentFacts, Interlock, OutputRow, Position, Varying, VaryingMode,
    VaryingPlace,
};
pub use crate::ir::module::InputRow;
pub use crate::ir::passed::Passed;
pub use crate::ir::stage::{Builtin, Stage};
pub use crate::request::CompileRequest;
pub use crate::row::{AlignedRow, Row};
pub use crate::state::{Event, IO_DATA_ROW, ResumePoint, SiteId, SiteKind, StateLayout, Wave};

/// Compiles one entry point.
///
/// # Errors
/// See [`ErrorKind`](crate::error::ErrorKind). Never panics, whatever the words are; time and memory are bounded in proportion to the module.
pub fn compile(request: &CompileRequest<'_>) -> Result<Arc<Program>, Error> {
    Program::new(&compile_module(request)?).map(Arc::new)
}

/// Compiles one entry point as far as [`compile`] does without looking at the machine: what a cache keeps.
///
/// # Errors
/// As [`compile`].
pub fn compile_module(request: &CompileRequest<'_>) -> Result<ir::Module, Error> {
    let parsed = crate::parse::parse(request.words)?;
    let mut module = crate::lower::lower_module(&parsed, request)?;
    crate::pass::optimize(&mut module)?;
    Ok(module)
}

/// A program from the bytes of an optimised module ([`ir::binary::encode`]).
///
/// # Errors
/// Bytes that are no valid module. Never panics.
pub fn from_bytes(bytes: &[u8]) -> Result<Arc<Program>, Error> {
    let module = ir::binary::decode(bytes).map_err(Error::not_a_module)?;
    ir::verify(&module).map_err(Error::not_a_module)?;
    Program::new(&module).map(Arc::new)
}
