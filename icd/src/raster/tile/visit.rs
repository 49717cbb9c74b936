//! A worker's visit to a tile: shapes in order to blocks, blocks through the tests, fragments to waves, waves to the attachments.

use std::sync::atomic::{AtomicU64, Ordering};

use spirv_jit::interp::TierKind;
use spirv_jit::program::AlignedRow;

use super::clear::{clear_tile, meet};
use super::coverage::{Block, convex, listed};
use super::depth::Tested;
use super::inputs::{self, Fragments, depths};
use super::lanes::{Floats, LANE_X, LANE_Y, floats_of, lanes_of};
use super::output::Texels;
use super::pack::{Found, Origin, Pack, Packs};
use super::plan::{Fragment, Order, Passing, Plan, Plans};
use super::samples::{MAX_SAMPLES, from_center, locations};
use super::texels::Places;
use crate::compute::waves::Runner;
use crate::raster::primitive::{Bounds, Coverage, Grid, Record, Shape};
use crate::raster::{Chunk, Context, Counters, Draw, Targets, Work};
use crate::wave::Stopped;

/// Shapes between two looks at the limits.
const SHAPES: usize = 1024;

/// What all tiles of a round share.
pub struct Round<'a> {
    pub tier: TierKind,
    pub context: Context<'a>,
    pub targets: &'a Targets,
    pub work: &'a [Work],
    pub chunks: &'a [Chunk],
    pub plans: Plans<'a>,
    pub grid: Grid,
    pub area: Bounds,
}

/// A worker's memory, kept from one tile to the next.
#[derive(Default)]
pub struct Worker {
    runner: Runner,
    blocks: Vec<Block>,
    packs: Packs,
    /// Outputs of fragments that no program runs for.
    rows: Vec<AlignedRow>,
    /// Texels of a primitive all of whose fragments are the same; none where there is more to do.
    solid: Option<(Origin, Option<Texels>)>,
}

/// What a draw's queries count in a tile.
#[derive(Default)]
struct Counts {
    samples: u64,
    invocations: u64,
}

/// The draw whose shapes are worked off.
#[derive(Clone, Copy)]
struct Current<'a> {
    index: u32,
    draw: &'a Draw,
    plan: &'a Plan<'a>,
}

/// A visit.
pub struct Visit<'a> {
    round: &'a Round<'a>,
    worker: &'a mut Worker,
    bounds: Bounds,
    current: Option<Current<'a>>,
    counts: Counts,
}

impl Worker {
    /// Works all chunks of a round off in a tile.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn visit(&mut self, round: &Round<'_>, tile: usize) -> Result<(), Stopped> {
        self.packs.clear();
        self.solid = None;
        let mut visit = Visit {
            round,
            worker: self,
            bounds: round.grid.bounds(tile),
            current: None,
            counts: Counts::default(),
        };
        for (index, chunk) in (0..).zip(round.chunks) {
            visit.chunk(index, chunk, tile)?;
        }
        visit.finish_draw()
    }
}

impl<'a> Visit<'a> {
    fn chunk(&mut self, index: u32, chunk: &Chunk, tile: usize) -> Result<(), Stopped> {
        if let Some(clear) = chunk.clear {
            self.finish_draw()?;
            if let Some(Work::Clear(clear)) = self.round.work.get(clear as usize) {
                clear_tile(clear, self.round.targets, &self.bounds);
            }
            return Ok(());
        }
        for shapes in chunk.bins.shapes_of(tile).chunks(SHAPES) {
            self.round.context.limits.check()?;
            for &shape in shapes {
                let shape = &chunk.shapes[shape as usize];
                self.shape(index, chunk, shape)?;
            }
        }
        Ok(())
    }

    /// Goes on with a draw, after all that the one before has left to do.
    fn take_draw(&mut self, index: u32) -> Result<Option<Current<'a>>, Stopped> {
        if let Some(current) = self.current.filter(|current| current.index == index) {
            return Ok(Some(current));
        }
        self.finish_draw()?;
        if let (Some(Work::Draw(draw)), Some(plan)) = (
            self.round.work.get(index as usize),
            self.round.plans.of_draw(index),
        ) {
            self.current = Some(Current { index, draw, plan });
        }
        Ok(self.current)
    }

    fn finish_draw(&mut self) -> Result<(), Stopped> {
        self.run_wave()?;
        let counts = std::mem::take(&mut self.counts);
        if let Some(current) = self.current.take() {
            let add = |counter: fn(&Counters) -> &AtomicU64, count: u64| {
                for counters in current.draw.counters.iter().filter(|_| count != 0) {
                    counter(counters).fetch_add(count, Ordering::Relaxed);
                }
            };
            add(|it| &it.samples, counts.samples);
            add(|it| &it.fragment_invocations, counts.invocations);
        }
        Ok(())
    }

    fn shape(&mut self, index: u32, chunk: &Chunk, shape: &Shape) -> Result<(), Stopped> {
        let record = &chunk.records[shape.record as usize];
        let clip = meet(&shape.bounds, &meet(&self.bounds, &self.round.area));
        let is_outside = clip.left >= clip.right || clip.top >= clip.bottom;
        if is_outside || record.layer >= self.round.targets.layers {
            return Ok(());
        }
        let Some(current) = self.take_draw(record.draw)? else {
            return Ok(());
        };
        let samples = current.plan.samples;
        let mut blocks = std::mem::take(&mut self.worker.blocks);
        blocks.clear();
        match &shape.coverage {
            Coverage::Convex { edges, count } => convex(
                self.round.tier,
                &edges[..usize::from(*count).min(4)],
                &self.bounds,
                &clip,
                samples,
                &mut blocks,
            ),
            Coverage::Pixels { first, count } => {
                let (first, count) = (*first as usize, *count as usize);
                let list = chunk.pixels.get(first..).unwrap_or_default();
                let list = &list[..count.min(list.len())];
                listed(list, &self.bounds, &clip, samples, &mut blocks);
            }
        }
        let origin = Origin {
            chunk: index,
            record: shape.record,
        };
        let mut result = Ok(());
        for block in &blocks {
            result = self.block(current, origin, record, block);
            if result.is_err() {
                break;
            }
        }
        self.worker.blocks = blocks;
        result
    }

    /// Tests a block's fragments, as far as that comes first, and adds those that are left to the wave.
    fn block(
        &mut self,
        current: Current<'a>,
        origin: Origin,
        record: &Record,
        block: &Block,
    ) -> Result<(), Stopped> {
        let Current { plan, .. } = current;
        let (x, y) = (
            self.bounds.left + i32::from(block.x),
            self.bounds.top + i32::from(block.y),
        );
        let area = &self.round.area;
        let is_inside =
            x >= area.left && y >= area.top && x + 4 <= area.right && y + 4 <= area.bottom;
        let places = Places::block(x, y, record.layer, is_inside);
        let mut masks = block.masks;
        for (sample, mask) in masks.iter_mut().enumerate() {
            if plan.sample_mask >> sample & 1 == 0 {
                *mask = 0;
            }
        }
        let covered = any(&masks);
        if covered == 0 {
            return Ok(());
        }
        let mut coverage = masks;
        let serial = plan.program.as_ref().is_some_and(|it| it.is_serial);
        if serial && self.worker.packs.holds_any(&places, covered) {
            self.run_wave()?;
        }
        match plan.order {
            Order::Early => {
                self.test_block(plan, record, &places, &mut masks);
                self.counts.samples += count(&masks);
            }
            Order::LateButSeen => self.look_at_block(plan, record, &places, &mut masks),
            Order::Late => {}
        }
        let Some(fragment) = &plan.program else {
            return Ok(());
        };
        if any(&masks) != 0 {
            if let Some(passing) = &fragment.passed {
                self.pass(plan, passing, origin, &places, &masks, &coverage);
                return Ok(());
            }
            if fragment.sees_tests {
                coverage = masks;
            }
            self.add(fragment, origin, &places, &masks, &coverage)?;
        }
        Ok(())
    }

    /// Depths of a block's fragments at a sample.
    fn depths_of_block(
        &self,
        plan: &Plan<'_>,
        record: &Record,
        places: &Places,
        sample: usize,
    ) -> Floats {
        let range = plan.clamps_depth.then_some(record.depth_range);
        let location = locations(plan.samples)[sample];
        depths(
            self.round.tier,
            record,
            places.x[0],
            places.y[0],
            location,
            range,
        )
    }

    fn test_block(
        &self,
        plan: &Plan<'_>,
        record: &Record,
        places: &Places,
        masks: &mut [u16; MAX_SAMPLES],
    ) {
        if plan.tests.is_empty() {
            return;
        }
        let front = if record.front { u16::MAX } else { 0 };
        for (sample, mask) in masks.iter_mut().enumerate().take(plan.samples as usize) {
            if *mask == 0 {
                continue;
            }
            let depths = match plan.tests.uses_depths() {
                true => self.depths_of_block(plan, record, places, sample),
                false => [0.0; 16],
            };
            let tested = Tested {
                places,
                front,
                depths: &depths,
                references: None,
            };
            // SAFETY: the lanes of the mask lie in the render area and with it in all attachments, the layer was checked, and a tile belongs to one worker.
            *mask = unsafe { plan.tests.run(&tested, sample as u32, *mask) };
        }
    }

    fn look_at_block(
        &self,
        plan: &Plan<'_>,
        record: &Record,
        places: &Places,
        masks: &mut [u16; MAX_SAMPLES],
    ) {
        for (sample, mask) in masks.iter_mut().enumerate().take(plan.samples as usize) {
            if *mask == 0 {
                continue;
            }
            let depths = self.depths_of_block(plan, record, places, sample);
            // SAFETY: as for the tests.
            *mask = unsafe { plan.tests.may_pass(places, &depths, sample as u32, *mask) };
        }
    }

    /// Does what a program would that computes nothing.
    fn pass(
        &mut self,
        plan: &Plan<'_>,
        passing: &Passing,
        origin: Origin,
        places: &Places,
        masks: &[u16; MAX_SAMPLES],
        coverage: &[u16; MAX_SAMPLES],
    ) {
        self.counts.invocations += u64::from(any(masks).count_ones());
        let solid = self.worker.solid.as_ref();
        if let Some((of, Some(texels))) = solid
            && *of == origin
            && plan.order == Order::Early
        {
            // SAFETY: as for the tests.
            return unsafe { plan.output.write_texels(texels, places, masks) };
        }
        let pack = Pack {
            places: *places,
            origins: [origin; 4],
            is_uniform: true,
            sample: [0; 4],
            masks: *masks,
            coverage: *coverage,
            quads: 0xf,
        };
        let mut rows = std::mem::take(&mut self.worker.rows);
        rows.resize(passing.rows.len(), AlignedRow::default());
        let fragments = fragments_of(self.round.chunks, &pack);
        passing.rows.fill(self.round.tier, &fragments, &mut rows);
        let is_new = solid.is_none_or(|(of, _)| *of != origin);
        if passing.is_constant && is_new {
            self.worker.solid = Some((origin, plan.output.texels(&rows)));
        }
        let chunks = self.round.chunks;
        finish(chunks, plan, &rows, &pack, *masks, &mut self.counts);
        self.worker.rows = rows;
    }

    fn add(
        &mut self,
        fragment: &Fragment<'_>,
        origin: Origin,
        places: &Places,
        masks: &[u16; MAX_SAMPLES],
        coverage: &[u16; MAX_SAMPLES],
    ) -> Result<(), Stopped> {
        let packs = &mut self.worker.packs;
        if !fragment.per_sample {
            packs.add(&Found {
                origin,
                places,
                sample: 0,
                masks,
                coverage,
            });
        } else {
            for (sample, &mask) in masks.iter().enumerate().filter(|(_, mask)| **mask != 0) {
                let mut masks = [0; MAX_SAMPLES];
                masks[sample] = mask;
                packs.add(&Found {
                    origin,
                    places,
                    sample: sample as u8,
                    masks: &masks,
                    coverage,
                });
            }
        }
        // A block adds at most four subgroups, or as many as samples.
        match packs.packs.len() >= fragment.subgroups {
            true => self.run_wave(),
            false => Ok(()),
        }
    }

    /// Runs the fragments that wait, and writes what they leave, in order.
    fn run_wave(&mut self) -> Result<(), Stopped> {
        let Some(current) = self.current else {
            return Ok(());
        };
        let Some(fragment) = &current.plan.program else {
            return Ok(());
        };
        if self.worker.packs.packs.is_empty() {
            return Ok(());
        }
        let packs = std::mem::take(&mut self.worker.packs.packs);
        let result = self.run_packs(&current, fragment, &packs);
        self.worker.packs.packs = packs;
        self.worker.packs.clear();
        result
    }

    fn run_packs(
        &mut self,
        current: &Current<'_>,
        fragment: &Fragment<'_>,
        packs: &[Pack],
    ) -> Result<(), Stopped> {
        let program = fragment.program;
        let layout = program.layout();
        let runner = &mut self.worker.runner;
        runner.begin(program, packs.len())?;
        for (pack, state) in packs.iter().zip(runner.states()) {
            let (active, covered) = (pack.active(), pack.covered());
            program.start_fragments(state, active, active & !covered);
            let fragments = fragments_of(self.round.chunks, pack);
            let rows = &mut state[layout.inputs..];
            fragment.inputs.fill(self.round.tier, &fragments, rows);
            self.counts.invocations += u64::from(covered.count_ones());
        }
        runner.run(
            program,
            &current.draw.environment,
            self.round.context.limits,
        )?;
        for (index, pack) in packs.iter().enumerate() {
            let state = self.worker.runner.state(index);
            let live = !program.helpers(state);
            let masks = pack.masks.map(|mask| mask & live);
            let rows = &state[layout.io..];
            finish(
                self.round.chunks,
                current.plan,
                rows,
                pack,
                masks,
                &mut self.counts,
            );
        }
        Ok(())
    }
}

/// Late tests of a subgroup's fragments, and their colours. `masks`: those that the program left.
fn finish(
    chunks: &[Chunk],
    plan: &Plan<'_>,
    rows: &[AlignedRow],
    pack: &Pack,
    mut masks: [u16; MAX_SAMPLES],
    counts: &mut Counts,
) {
    plan.output.drop_samples(rows, &mut masks);
    if any(&masks) == 0 {
        return;
    }
    if plan.order != Order::Early {
        let fragments = fragments_of(chunks, pack);
        let front = (0..4).filter(|&quad| fragments.records[quad].front);
        let front = lanes_of(front.fold(0, |quads, quad| quads | 1 << quad));
        let written = plan.output.depth.map(|row| floats_of(&rows[row].0));
        let references = plan.output.stencil.map(|row| &rows[row].0);
        for (sample, mask) in masks.iter_mut().enumerate().take(plan.samples as usize) {
            if *mask == 0 || plan.tests.is_empty() {
                continue;
            }
            let depths = depths_of_pack(plan, &fragments, sample, written.as_ref());
            let tested = Tested {
                places: &pack.places,
                front,
                depths: &depths,
                references,
            };
            // SAFETY: as for a block's tests: the fragments come from blocks.
            *mask = unsafe { plan.tests.run(&tested, sample as u32, *mask) };
        }
        counts.samples += count(&masks);
    }
    // SAFETY: as above.
    unsafe { plan.output.write(rows, &pack.places, &masks) };
}
/// All lanes of any sample.
fn any(masks: &[u16; MAX_SAMPLES]) -> u16 {
    masks.iter().fold(0, |all, mask| all | mask)
}

/// Covered samples.
fn count(masks: &[u16; MAX_SAMPLES]) -> u64 {
    masks.iter().map(|mask| u64::from(mask.count_ones())).sum()
}

/// What the fragments of a subgroup are made of.
fn fragments_of<'a>(chunks: &'a [Chunk], pack: &'a Pack) -> Fragments<'a> {
    let chunk = |quad: usize| &chunks[pack.origins[quad].chunk as usize];
    let record = |quad: usize| &chunk(quad).records[pack.origins[quad].record as usize];
    Fragments {
        records: [record(0), record(1), record(2), record(3)],
        outputs: [
            &chunk(0).outputs,
            &chunk(1).outputs,
            &chunk(2).outputs,
            &chunk(3).outputs,
        ],
        is_uniform: pack.is_uniform,
        x: pack.places.x,
        y: pack.places.y,
        sample: pack.sample,
        coverage: &pack.coverage,
    }
}

/// Depths of a subgroup's fragments at a sample: what the program wrote, or the planes' values.
fn depths_of_pack(
    plan: &Plan<'_>,
    fragments: &Fragments<'_>,
    sample: usize,
    written: Option<&Floats>,
) -> Floats {
    let mut depths = [0.0; 16];
    let [inside_x, inside_y] = from_center(locations(plan.samples)[sample]);
    for (lane, depth) in depths.iter_mut().enumerate() {
        let quad = lane / 4;
        let record = fragments.records[quad];
        let from =
            |at: i32, origin: i32, step: i32| at.wrapping_sub(origin).wrapping_add(step & 1) as f32;
        let x = inside_x + from(fragments.x[quad], record.origin[0], LANE_X[lane]);
        let y = inside_y + from(fragments.y[quad], record.origin[1], LANE_Y[lane]);
        let plane = &record.depth;
        let value = match written {
            Some(written) => written[lane],
            None => plane.at + plane.dx * x + plane.dy * y,
        };
        let range = plan.clamps_depth.then_some(record.depth_range);
        *depth = inputs::clamp(value, range);
    }
    depths
}
