//! A parsed SPIR-V module to the IR.

use crate::program::CompileRequest;
use crate::{Error, ir, parse::ParsedModule};

/// Lowers what the entry point reaches.
///
/// # Errors
/// What the module asks for and the IR cannot express, or an ill-typed module.
pub fn lower_module(
    parsed: &ParsedModule,
    request: &CompileRequest<'_>,
) -> Result<ir::Module, Error> {
    let _ = (parsed, request);
    Err(Error::unsupported(0, "no front end yet"))
}
