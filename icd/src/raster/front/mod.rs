//! The front end: from draws to chunks.
//!
//! ```text
//! batch ──cut──> jobs (in order, one thread) ──> chunks (any worker, any job), a round of them at a time
//!                                                  assemble: indices, topology, each vertex once
//!                                                  vertices: attributes, waves of the vertex shader, outputs
//!                                                  geometry: waves of the geometry shader
//!                                                  set_up: clip, snap, cull, edges, planes
//!                                                  bins
//! ```
//!
//! Where jobs are cut follows from the draws alone, and a chunk from its job alone: no result
//! depends on the number of threads.

mod bins;
mod bresenham;
mod chunk;
mod clip;
mod cut;
mod facts;
mod fetch;
mod geometry;
mod indices;
mod line;
mod outputs;
mod planes;
mod point;
mod project;
mod screen;
mod set_up;
#[cfg(test)]
mod tests;
mod topology;
mod triangle;
mod vertices;

use parking_lot::Mutex;
use rayon::prelude::*;

use self::chunk::{Round, Worker};
use self::cut::{Cursor, Cutter, Job};
use super::primitive::Grid;
use super::{Chunk, Context, ROUND_CHUNKS, Targets, Work};
use crate::timeline;
use crate::wave::Stopped;

/// Primitives of a round that are less work than waking others up.
const FEW_PRIMITIVES: u32 = 192;

/// Chunks of a batch's first round: later ones have more, as long as they take little memory.
const FIRST_ROUND: usize = 16;

/// Chunks of a round for each worker: enough that all have something to do to the end. A chunk of
/// small triangles is half a megabyte, and the tiles should find it in a cache.
const CHUNKS_OF_WORKER: usize = 8;

/// Bytes of lists (tiles' shapes, lines' pixels) that a round should stay below.
const ROUND_BYTES: usize = 64 << 20;

/// The front end's memory, kept from one flush to the next.
#[derive(Default)]
pub struct FrontEnd {
    idle: Mutex<Vec<Worker>>,
    /// Chunks to fill again.
    spare: Mutex<Vec<Chunk>>,
}

/// How far the front end has come in a batch.
pub struct Rounds {
    cursor: Cursor,
    grid: Grid,
    /// Chunks of the next round.
    chunks: usize,
}

impl Rounds {
    /// At the batch's start.
    pub fn new(_work: &[Work], targets: &Targets) -> Self {
        Self {
            cursor: Cursor::default(),
            grid: Grid::of(&targets.area),
            chunks: FIRST_ROUND,
        }
    }
}

impl FrontEnd {
    /// The next chunks of a batch, in order; `None` when it is done.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn next_round(
        &self,
        context: Context<'_>,
        targets: &Targets,
        work: &[Work],
        rounds: &mut Rounds,
    ) -> Result<Option<Vec<Chunk>>, Stopped> {
        context.limits.check()?;
        let cutter = Cutter {
            work,
            view_mask: targets.view_mask,
            reach: context.reach,
            limits: context.limits,
        };
        let mut jobs: Vec<Job> = Vec::new();
        while jobs.len() < rounds.chunks
            && let Some(job) = cutter.next(&mut rounds.cursor)?
        {
            jobs.push(job);
        }
        if jobs.is_empty() {
            return Ok(None);
        }
        let round = Round {
            work,
            targets,
            reach: context.reach,
            limits: context.limits,
            grid: rounds.grid,
        };
        let make = |job: &Job| {
            let _span = timeline::work("primitives");
            let mut worker = self.idle.lock().pop().unwrap_or_default();
            let mut chunk = self.spare.lock().pop().unwrap_or_default();
            worker.run(&round, job, &mut chunk)?;
            worker.rest();
            self.idle.lock().push(worker);
            Ok(chunk)
        };
        let primitives: u32 = jobs.iter().map(|job| job.primitives).sum();
        let are_few = primitives <= FEW_PRIMITIVES && !jobs.iter().any(|job| job.amplifies);
        let chunks: Vec<Chunk> = if jobs.len() == 1 || are_few {
            jobs.iter().map(make).collect::<Result<_, _>>()?
        } else {
            context
                .workers
                .install(|| jobs.par_iter().map(make).collect::<Result<_, _>>())?
        };
        let bytes = chunks.iter().map(Chunk::list_bytes).sum::<usize>();
        let threads = context.workers.current_num_threads();
        let most = (threads * CHUNKS_OF_WORKER).clamp(FIRST_ROUND, ROUND_CHUNKS);
        rounds.chunks = if bytes > ROUND_BYTES {
            (rounds.chunks / 2).max(1)
        } else if bytes < ROUND_BYTES / 4 {
            (rounds.chunks * 2).min(most)
        } else {
            rounds.chunks
        };
        Ok(Some(chunks))
    }

    /// Takes back the chunks of a round, for their memory.
    pub fn give_back(&self, chunks: Vec<Chunk>) {
        let mut spare = self.spare.lock();
        let room = ROUND_CHUNKS.saturating_sub(spare.len());
        let small = |chunk: &Chunk| chunk.list_bytes() <= ROUND_BYTES / ROUND_CHUNKS;
        spare.extend(chunks.into_iter().filter(small).take(room));
    }
}
