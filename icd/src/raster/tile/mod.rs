//! The tiles: coverage, tests, fragments, output.
//!
//! ```text
//! chunk ──> shapes of the tile ──> blocks of 4×4 ──> early tests ──> packs ──> waves ──> late tests ──> blending ──> images
//!           [visit]                [coverage]        [depth]         [pack]   [inputs]                  [output]
//! ```
//!
//! Fragments of programs that compute nothing go from coverage to the images at once:
//! [`pass_through`], [`direct`]; those that sample and multiply: [`modulate`].
//!
//! A tile belongs to one worker, which works off all chunks in order and writes straight into the
//! images: the order of primitives holds at each sample, and no pixel has two writers. [`plan`] is
//! what draws of one state have in common; [`lanes`] is how sixteen pixels become vectors.

mod advanced;
mod blend;
mod bytes;
mod clear;
mod coarse;
mod color;
mod counted;
mod coverage;
mod depth;
mod direct;
mod filling;
mod gathering;
mod inputs;
mod interpolation;
mod lanes;
mod modulate;
mod output;
mod pack;
mod parts;
mod pass_through;
mod pixels;
mod places;
mod plan;
mod rectangle;
mod samples;
mod scalar;
mod shading;
mod shares;
mod small_rectangle;
mod squares;
#[cfg(test)]
mod tests;
mod texels;
mod upright;
mod visit;
mod write;

use ::lanes::Tier;
use parking_lot::Mutex;

use super::primitive::{Bounds, Grid};
use super::{Chunk, Context, Targets, Work};
use crate::timeline;
use crate::wave::Stopped;
use crate::wave::costs::Costs;
use plan::Plans;
use visit::{Round, TileWorker};

/// Whether loops for the most common fragments are worth their code where operations are no
/// instructions. Only old x86-64 processors are so: there, the loop for all fragments serves. Tests
/// run all loops.
const HAS_PORTABLE_LOOPS: bool = cfg!(any(not(target_arch = "x86_64"), test));

/// Pixels of shapes' bounds up to which a round without programs is too little to hand out.
const LITTLE: u64 = 1 << 12;

/// The tiles' memory, kept from one round to the next.
#[derive(Default)]
pub struct Tiles {
    idle: Mutex<Vec<TileWorker>>,
    /// Of tiles, by the grid and the number of the round in its batch.
    costs: Costs<(Grid, usize)>,
}

impl Tiles {
    /// Works off the chunks of a round, in order, in every tile. `number`: rounds of the batch
    /// before this one.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn run(
        &self,
        context: Context<'_>,
        targets: &Targets,
        work: &[Work],
        chunks: &[Chunk],
        number: usize,
    ) -> Result<(), Stopped> {
        let grid = Grid::of(&targets.area);
        if grid.is_empty() {
            return Ok(());
        }
        // Leading commands that are the same for all tiles need none.
        let clears = chunks.iter().take_while(|chunk| chunk.clear.is_some());
        let clears: Vec<u32> = clears.filter_map(|chunk| chunk.clear).collect();
        for &clear in &clears {
            if let Some(Work::Clear(clear)) = work.get(clear as usize) {
                clear::clear_all(clear, targets, context.workers);
            }
        }
        let chunks = &chunks[clears.len()..];
        let has_clears = chunks.iter().any(|chunk| chunk.clear.is_some());
        let is_busy = |tile: &usize| {
            let mut bins = chunks.iter().map(|chunk| chunk.bins.shapes_of(*tile));
            has_clears || bins.any(|shapes| !shapes.is_empty())
        };
        let busy: Vec<usize> = (0..grid.len()).filter(is_busy).collect();
        if busy.is_empty() {
            return Ok(());
        }
        let threads = match !has_clears && is_little(chunks) {
            true => 1,
            false => context.workers.current_num_threads(),
        };
        let queue = (self.costs).queue((grid, number), grid.len(), Some(busy), threads);
        let tier = Tier::best();
        let round = Round {
            tier,
            context,
            targets,
            work,
            chunks,
            plans: Plans::new(tier, targets, work, chunks),
            grid,
            area: area_bounds(targets),
        };
        let work_off = || {
            let _span = timeline::work("tiles");
            let mut worker = self.idle.lock().pop().unwrap_or_default();
            queue.work_off(|tile| worker.visit(&round, tile))?;
            worker.rest();
            self.idle.lock().push(worker);
            Ok(())
        };
        context.workers.share(queue.length().min(threads), work_off)
    }
}

/// Whether shapes have few pixels.
fn is_little(chunks: &[Chunk]) -> bool {
    let mut pixels = 0;
    for shape in chunks.iter().flat_map(|chunk| &chunk.shapes) {
        let side = |from: i32, to: i32| u64::from(to.saturating_sub(from).max(0) as u32);
        let (width, height) = (
            side(shape.bounds.left, shape.bounds.right),
            side(shape.bounds.top, shape.bounds.bottom),
        );
        pixels += width * height;
        if pixels > LITTLE {
            return false;
        }
    }
    true
}

/// The render area as bounds.
fn area_bounds(targets: &Targets) -> Bounds {
    let area = &targets.area;
    let end = |first: i32, size: u32| first.saturating_add_unsigned(size);
    Bounds {
        left: area.offset.x.max(0),
        top: area.offset.y.max(0),
        right: end(area.offset.x, area.extent.width),
        bottom: end(area.offset.y, area.extent.height),
    }
}
