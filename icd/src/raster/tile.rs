//! The tiles: coverage, tests, fragments, output.

use super::{Chunk, Context, Targets, Work};
use crate::wave::Stopped;

/// The tiles' memory.
#[derive(Default)]
pub struct Tiles {}

impl Tiles {
    /// Works chunks off, in order, in every tile.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn run(
        &self,
        _context: Context<'_>,
        _targets: &Targets,
        _work: &[Work],
        _chunks: &[Chunk],
    ) -> Result<(), Stopped> {
        Ok(())
    }
}
