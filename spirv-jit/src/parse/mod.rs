//! SPIR-V words to a checked module.

use crate::Error;

/// A parsed module.
pub struct ParsedModule {}

/// Parses and checks a module.
///
/// # Errors
/// Malformed words, ids or types; capabilities that nothing advertises.
pub fn parse(words: &[u32]) -> Result<ParsedModule, Error> {
    let _ = words;
    Err(Error::unsupported(0, "no front end yet"))
}
