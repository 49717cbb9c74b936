//! The front end: from draws to chunks.

use super::{Chunk, Context, Targets, Work};
use crate::wave::Stopped;

/// The front end's memory.
#[derive(Default)]
pub struct FrontEnd {}

/// How far the front end has come in a batch.
pub struct Rounds {}

impl Rounds {
    /// At the batch's start.
    pub fn new(_work: &[Work], _targets: &Targets) -> Self {
        Self {}
    }
}

impl FrontEnd {
    /// The next chunks of a batch, in order; `None` when it is done.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn next_round(
        &self,
        _context: Context<'_>,
        _targets: &Targets,
        _work: &[Work],
        _rounds: &mut Rounds,
    ) -> Result<Option<Vec<Chunk>>, Stopped> {
        Ok(None)
    }
}
