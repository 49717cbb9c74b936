//! The front end: from draws to chunks.
//!
//! ```text
//! batch ──cut──> jobs (in order, one thread) ──> chunks (any worker, any job), in rounds
//!     assemble: indices, topology, each vertex once
//!     vertices: attributes, waves of the vertex shader, outputs
//!     patches: waves of control shaders, which say how many primitives patches become; jobs of
//!         those
//!     mesh: waves of task shaders, which say how many workgroups of mesh shaders follow; waves of
//!         those
//!     tessellate: vertices of patches' domains, and primitives
//!     geometry: waves of the geometry shader
//!     streams: which primitives are captured or drawn
//!     set_up: clip, snap, cull, edges, planes
//!     bins
//! ```
//!
//! Where jobs are cut follows from the draws alone, and a chunk from its job alone: no result
//! depends on the number of threads.

mod assemble;
mod bins;
mod boxes;
mod bresenham;
mod chunk;
mod clip;
mod facts;
mod fetch;
mod geometry;
mod indices;
mod kept;
mod line;
mod mesh;
mod outputs;
mod patches;
mod planes;
mod point;
mod project;
mod screen;
mod set_up;
mod shapes;
mod split;
mod streams;
mod tessellate;
#[cfg(test)]
mod tests;
mod topology;
mod transpose;
mod triangle;
mod vertices;

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;

use self::chunk::{ChunkWorker, Round};
use self::mesh::{TaskCursor, Tasks};
use self::patches::Patches;
use self::split::{Cursor, Job, Splitter, longest_chunk};
use super::primitive::Grid;
use super::{
    CHUNK_PRIMITIVES, Chunk, Context, Draw, ROUND_CHUNKS, Targets, Work, transform_feedback,
};
use crate::timeline;
use crate::wave::Stopped;

/// Primitives of a round that are less work than waking others up.
const FEW_PRIMITIVES: u32 = 192;

/// Chunks of a batch's first round, at least: later ones have more, as long as they take little
/// memory.
const FIRST_ROUND: usize = 16;

/// Chunks of the first round for each worker. The tiles of a round wait for all of its chunks, and
/// the next round for all tiles, so many workers need few rounds.
const FIRST_CHUNKS_OF_WORKER: usize = 2;

/// Chunks of a round for each worker: enough that all have something to do to the end. A chunk of
/// small triangles is a quarter of a megabyte, and the tiles should find it in a cache.
const CHUNKS_OF_WORKER: usize = 8;

/// Bytes of lists (tiles' shapes, lines' pixels) that a round should stay below.
const ROUND_BYTES: usize = 64 << 20;

/// The front end's memory, kept from one flush to the next.
#[derive(Default)]
pub struct FrontEnd {
    idle: Mutex<Vec<ChunkWorker>>,
    /// Chunks to fill again.
    spare: Mutex<Vec<Chunk>>,
}

/// Work that waits for a round.
enum QueuedWork {
    Job(Job),
    /// Workgroups of mesh shaders, which become jobs in turn.
    Tasks(TaskCursor),
}

/// Output of the first stage of a job of patches or tasks.
enum Expanded {
    Patches(Patches),
    Tasks(Tasks),
}

/// Batches so far, of all devices.
static BATCHES: AtomicU64 = AtomicU64::new(0);

/// How far the front end has come in a batch.
pub struct Rounds {
    /// The batch's number.
    batch: u64,
    cursor: Cursor,
    /// Work of control and task shaders that have run, and jobs that come after them.
    waiting: VecDeque<QueuedWork>,
    grid: Grid,
    /// Chunks of the next round.
    chunks: usize,
}

impl Rounds {
    /// At the start of a batch that `threads` workers share.
    pub fn new(targets: &Targets, threads: usize) -> Self {
        Self {
            batch: BATCHES.fetch_add(1, Ordering::Relaxed),
            cursor: Cursor::default(),
            waiting: VecDeque::new(),
            grid: Grid::of(&targets.area),
            chunks: (threads * FIRST_CHUNKS_OF_WORKER).clamp(FIRST_ROUND, ROUND_CHUNKS),
        }
    }

    /// Chooses the number of chunks of the next round by the bytes of these.
    fn adapt(&mut self, chunks: &[Chunk], threads: usize) {
        let bytes = chunks.iter().map(Chunk::list_bytes).sum::<usize>();
        let most = (threads * CHUNKS_OF_WORKER).clamp(FIRST_ROUND, ROUND_CHUNKS);
        self.chunks = if bytes > ROUND_BYTES {
            (self.chunks / 2).max(1)
        } else if bytes < ROUND_BYTES / 4 {
            (self.chunks * 2).min(most)
        } else {
            self.chunks
        };
    }
}

/// A draw of a batch.
fn draw_of(work: &[Work], index: u32) -> Option<&Draw> {
    match work.get(index as usize) {
        Some(Work::Draw(draw)) => Some(draw),
        _ => None,
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
        let cutter = Splitter {
            work,
            view_mask: targets.view_mask,
            reach: context.reach,
            limits: context.limits,
        };
        let round = Round {
            batch: rounds.batch,
            work,
            targets,
            reach: context.reach,
            limits: context.limits,
            grid: rounds.grid,
        };
        let jobs = self.next_jobs(context, &round, &cutter, rounds)?;
        if jobs.is_empty() {
            return Ok(None);
        }
        let chunks = self.run_jobs(context, &round, &jobs)?;
        transform_feedback::write(context, work, &chunks);
        rounds.adapt(&chunks, context.workers.current_num_threads());
        Ok(Some(chunks))
    }

    /// The jobs of the next round: those that wait first.
    fn next_jobs(
        &self,
        context: Context<'_>,
        round: &Round<'_>,
        cutter: &Splitter<'_>,
        rounds: &mut Rounds,
    ) -> Result<Vec<Job>, Stopped> {
        let mut jobs: Vec<Job> = Vec::new();
        while jobs.len() < rounds.chunks {
            match rounds.waiting.front_mut() {
                Some(QueuedWork::Tasks(cursor)) => {
                    let draw = draw_of(round.work, cursor.draw());
                    match draw.and_then(|draw| cursor.next(longest_chunk(draw))) {
                        Some((workgroups, count)) => jobs.push(Job {
                            workgroups: Some(workgroups),
                            primitives: count,
                            amplifies: true,
                            ..Job::default()
                        }),
                        None => drop(rounds.waiting.pop_front()),
                    }
                    continue;
                }
                Some(QueuedWork::Job(job)) => {
                    jobs.push(std::mem::take(job));
                    rounds.waiting.pop_front();
                    continue;
                }
                None => {}
            }
            match cutter.next(&mut rounds.cursor)? {
                None => break,
                Some(job) if job.expands => {
                    let room = rounds.chunks - jobs.len();
                    self.divide(context, round, cutter, rounds, job, room)?;
                }
                Some(job) => jobs.push(job),
            }
        }
        Ok(jobs)
    }

    /// Runs jobs, each to a chunk, in order.
    fn run_jobs(
        &self,
        context: Context<'_>,
        round: &Round<'_>,
        jobs: &[Job],
    ) -> Result<Vec<Chunk>, Stopped> {
        let make = |job: &Job| -> Result<Chunk, Stopped> {
            let _span = timeline::work("primitives");
            let mut worker = self.idle.lock().pop().unwrap_or_default();
            let mut chunk = self.spare.lock().pop().unwrap_or_default();
            worker.run(round, job, &mut chunk)?;
            worker.rest();
            self.idle.lock().push(worker);
            Ok(chunk)
        };
        let primitives: u32 = jobs.iter().map(|job| job.primitives).sum();
        let are_few = primitives <= FEW_PRIMITIVES && !jobs.iter().any(|job| job.amplifies);
        if jobs.len() == 1 || are_few {
            return jobs.iter().map(make).collect();
        }
        context.workers.in_order(jobs, make)
    }

    /// Runs the control or task shaders of a job and of those that follow it, up to `room` jobs.
    /// Their results wait.
    fn divide(
        &self,
        context: Context<'_>,
        round: &Round<'_>,
        cutter: &Splitter<'_>,
        rounds: &mut Rounds,
        first: Job,
        room: usize,
    ) -> Result<(), Stopped> {
        let mut all = vec![first];
        let mut after = None;
        while all.len() < room
            && let Some(job) = cutter.next(&mut rounds.cursor)?
        {
            if !job.expands {
                after = Some(job);
                break;
            }
            all.push(job);
        }
        let run = |job: &Job| -> Result<Option<Expanded>, Stopped> {
            let _span = timeline::work("patches and tasks");
            let mut worker = self.idle.lock().pop().unwrap_or_default();
            let made = worker.expand(round, job)?;
            worker.rest();
            self.idle.lock().push(worker);
            Ok(made)
        };
        let made: Vec<Option<Expanded>> = if all.len() == 1 {
            all.iter().map(run).collect::<Result<_, _>>()?
        } else {
            context.workers.in_order(&all, run)?
        };
        for made in made.into_iter().flatten() {
            let patches = match made {
                Expanded::Patches(patches) => patches,
                Expanded::Tasks(tasks) => {
                    let cursor = TaskCursor::new(tasks);
                    rounds.waiting.push_back(QueuedWork::Tasks(cursor));
                    continue;
                }
            };
            let Some(draw) = draw_of(round.work, patches.draw) else {
                continue;
            };
            let most = longest_chunk(draw).min(CHUNK_PRIMITIVES as u32);
            patches::cut(&Arc::new(patches), most, |pieces, primitives| {
                rounds.waiting.push_back(QueuedWork::Job(Job {
                    pieces: Some(pieces),
                    primitives,
                    amplifies: draw.stages.geometry().is_some(),
                    ..Job::default()
                }));
            });
        }
        rounds.waiting.extend(after.map(QueuedWork::Job));
        Ok(())
    }

    /// Takes back the chunks of a round, for their memory.
    pub fn give_back(&self, chunks: Vec<Chunk>) {
        let mut spare = self.spare.lock();
        let room = ROUND_CHUNKS.saturating_sub(spare.len());
        let small = |chunk: &Chunk| chunk.list_bytes() <= ROUND_BYTES / ROUND_CHUNKS;
        spare.extend(chunks.into_iter().filter(small).take(room));
    }
}
