//! A worker's visit to a tile: shapes in order to blocks, blocks through the tests, fragments to
//! waves, waves to the attachments.

use std::sync::atomic::{AtomicU64, Ordering};

use lanes::Tier;
use spirv_jit::interp::modulate::Sampling;

use super::clear::clear_tile;
use super::coarse::{Gather, Of};
use super::coverage::{Block, Covered, SmallBlocks, Square, convex, in_tile, listed, small_shape};
use super::direct;
use super::filling::WaveFragments;
use super::modulate::{self, Sampled};
use super::pack::{Found, OWN, Origin, Pack, Packs};
use super::parts::Wave;
use super::pass_through::Part;
use super::plan::{Fragment, Order, Plan, Plans};
use super::rectangle::Rectangle;
use super::samples::{Counts, Location, MAX_SAMPLES, any, count, masks_of};
use super::shading::{finish, start, test_blocks, test_small};
use super::shares::Shares;
use super::small_rectangle::cover_rectangle;
use super::upright::cover_upright;
use crate::raster::primitive::{Bounds, Coverage, Grid, Record, Shape, triangle_edges};
use crate::raster::{Chunk, Context, Counters, Draw, Targets, Work};
use crate::wave::Stopped;
use crate::wave::runner::{Runner, Subgroups};

/// Shapes between two looks at the limits.
const SHAPES: usize = 1024;

/// Shapes from the one that is drawn to the one whose record is fetched ahead. Small primitives lie
/// in memory in the order of their draw, and a tile visits them in leaps.
const AHEAD: usize = 4;

/// A bit a sample.
const ALL_SAMPLES: u32 = (1 << MAX_SAMPLES) - 1;

/// State that all tiles of a round share.
pub struct Round<'a> {
    pub tier: Tier,
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
pub struct TileWorker {
    runner: Runner,
    pub(super) covered: Covered,
    /// Blocks' masks before the tests.
    pub(super) coverage: Vec<[u16; MAX_SAMPLES]>,
    pub(super) packs: Packs,
    shares: Shares,
    pub(super) gather: Gather,
}

impl TileWorker {
    /// Ends its part of a round.
    pub fn rest(&mut self) {
        self.runner.rest();
        self.gather.rest();
    }
}

/// The draw whose shapes are worked off.
#[derive(Clone, Copy)]
pub struct Current<'a> {
    index: u32,
    draw: &'a Draw,
    pub plan: &'a Plan<'a>,
    /// Queries count its samples.
    pub(super) is_counted: bool,
}

/// A visit.
pub struct Visit<'a> {
    pub(super) round: &'a Round<'a>,
    pub(super) worker: &'a mut TileWorker,
    pub(super) bounds: Bounds,
    /// The tile lies in the render area.
    is_whole: bool,
    pub(super) current: Option<Current<'a>>,
    /// Quads of a block from which on it takes a subgroup of its own, if fragments may join.
    own: u32,
    /// The sample of the draw's program, if the program does little else.
    sampling: Option<Sampling<'a>>,
    pub(super) counts: Counts,
}

impl TileWorker {
    /// Works all chunks of a round off in a tile.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn visit(&mut self, round: &Round<'_>, tile: usize) -> Result<(), Stopped> {
        self.packs.clear();
        self.gather.clear();
        let bounds = round.grid.bounds(tile);
        let mut visit = Visit {
            round,
            worker: self,
            bounds,
            is_whole: bounds.intersection(round.area) == bounds,
            current: None,
            own: OWN,
            sampling: None,
            counts: Counts::default(),
        };
        for (index, chunk) in (0..).zip(round.chunks) {
            match round.context.counts {
                None => visit.chunk::<false>(index, chunk, tile)?,
                Some(_) => visit.chunk::<true>(index, chunk, tile)?,
            }
        }
        visit.finish_draw()
    }
}

impl<'a> Visit<'a> {
    /// `COUNTED`: a capture counts pixels.
    fn chunk<const COUNTED: bool>(
        &mut self,
        index: u32,
        chunk: &Chunk,
        tile: usize,
    ) -> Result<(), Stopped> {
        if let Some(clear) = chunk.clear {
            self.finish_draw()?;
            if let Some(Work::Clear(clear)) = self.round.work.get(clear as usize) {
                clear_tile(clear, self.round.targets, &self.bounds);
            }
            return Ok(());
        }
        for shapes in chunk.bins.shapes_of(tile).chunks(SHAPES) {
            self.round.context.limits.check()?;
            let mut rest = shapes;
            while let Some((&first, others)) = rest.split_first() {
                fetch_ahead(chunk, rest);
                let shape = &chunk.shapes[first as usize];
                rest = others;
                let second = others.first().filter(|&&second| second == first + 1);
                let second = second.map(|&second| &chunk.shapes[second as usize]);
                let second = second.filter(|second| shape.bounds == second.bounds);
                if let Some(second) = second.filter(|_| !COUNTED)
                    && self.pair(index, chunk, shape, second)?
                {
                    fetch_ahead(chunk, others);
                    rest = &others[1..];
                    continue;
                }
                // The second one of a rectangle will cover what is left of the first one's blocks.
                self.own = if second.is_some() { 1 } else { OWN };
                self.shape::<COUNTED>(index, chunk, shape)?;
            }
        }
        Ok(())
    }

    /// Goes on with a draw, after all that the one before has left to do.
    #[inline(always)]
    fn take_draw(&mut self, index: u32) -> Result<Option<Current<'a>>, Stopped> {
        match self.current {
            Some(current) if current.index == index => Ok(Some(current)),
            _ => self.start_draw(index),
        }
    }

    #[inline(never)]
    fn start_draw(&mut self, index: u32) -> Result<Option<Current<'a>>, Stopped> {
        self.finish_draw()?;
        if let (Some(Work::Draw(draw)), Some(plan)) = (
            self.round.work.get(index as usize),
            self.round.plans.of_draw(index),
        ) {
            let modulated = plan.sampled.as_ref().map(|sampled| sampled.modulated);
            // SAFETY: the draw keeps what its environment points to.
            self.sampling =
                modulated.and_then(|it| unsafe { Sampling::new(it, &draw.environment) });
            self.current = Some(Current {
                index,
                draw,
                plan,
                is_counted: !draw.counters.is_empty(),
            });
        }
        Ok(self.current)
    }

    fn finish_draw(&mut self) -> Result<(), Stopped> {
        self.pass_gathered()?;
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

    fn shape<const COUNTED: bool>(
        &mut self,
        index: u32,
        chunk: &Chunk,
        shape: &Shape,
    ) -> Result<(), Stopped> {
        let record = &chunk.records[shape.record as usize];
        let clip = (shape.bounds).intersection(self.bounds.intersection(self.round.area));
        let is_outside = clip.left >= clip.right || clip.top >= clip.bottom;
        if is_outside || u32::from(record.layer) >= self.round.targets.layers {
            return Ok(());
        }
        let Some(current) = self.take_draw(record.draw)? else {
            return Ok(());
        };
        let origin = Origin {
            chunk: index,
            record: shape.record,
        };
        if COUNTED {
            return self.counted_shape(current, chunk, origin, shape, &clip);
        }
        if let Some(fragment) = current.plan.small()
            && (self.is_whole || current.plan.tests.is_empty())
            && let Some(mut blocks) =
                small_shape(self.round.tier, &shape.coverage, &self.bounds, &clip)
        {
            fetch_inputs(chunk, record);
            if let Some(plain) = current.plan.tests.plain() {
                let (tier, plan) = (self.round.tier, current.plan);
                let (corner, area) = ([self.bounds.left, self.bounds.top], &self.round.area);
                // SAFETY: the whole tile lies in the render area; for the rest, as below.
                unsafe { test_small(tier, plan, plain, record, corner, area, &mut blocks) };
            }
            let layer = record.layer.into();
            return self.small_fragments(current, fragment, origin, layer, &blocks);
        }
        let mut covered = std::mem::take(&mut self.worker.covered);
        covered.clear();
        self.cover(chunk, shape, &clip, &current.plan.locations, &mut covered);
        let corner = [self.bounds.left, self.bounds.top];
        let part = Part::new(chunk, record, corner, &self.round.area);
        let sampled = current.plan.sampled.as_ref().zip(self.sampling.as_ref());
        let result = match (&current.plan.pass_through, sampled) {
            (Some(pass_through), _) => {
                let (tier, plan) = (self.round.tier, current.plan);
                // SAFETY: what is covered lies in the clip, which lies in the render area, and with
                // it in all attachments; the layer was checked, and a tile belongs to one worker.
                unsafe {
                    direct::draw(tier, plan, pass_through, &part, &covered, &mut self.counts)
                };
                Ok(())
            }
            (None, Some((sampled, sampling))) => {
                let (tier, counts) = (self.round.tier, &mut self.counts);
                sample(
                    tier,
                    current,
                    sampled,
                    sampling,
                    &part,
                    &mut covered,
                    counts,
                );
                Ok(())
            }
            (None, None) => match &current.plan.coarse {
                None => self.fragments::<false>(current, origin, record, &mut covered),
                Some(coarse) => {
                    let layer = record.layer.into();
                    let of = Of { origin, layer };
                    self.coarse_fragments::<false>(current, coarse, of, &part, &mut covered)
                }
            },
        };
        self.worker.covered = covered;
        result
    }

    /// Draws two shapes as one, if they are a rectangle and either go into subgroups without a test
    /// or are sampled, where neither tests nor levels need whole quads of each; else gives false.
    fn pair(
        &mut self,
        index: u32,
        chunk: &Chunk,
        first: &Shape,
        second: &Shape,
    ) -> Result<bool, Stopped> {
        let records = [first, second].map(|shape| &chunk.records[shape.record as usize]);
        let Some(current) = self.take_draw(records[0].draw)? else {
            return Ok(false);
        };
        if current.plan.plain().is_none() && current.plan.sampled.is_none() {
            return Ok(false);
        }
        let is_one = records.iter().all(|it| it.draw == current.index)
            && records[0].layer == records[1].layer
            && u32::from(records[0].layer) < self.round.targets.layers;
        if !is_one {
            return Ok(false);
        }
        if let Some(fragment) = current.plan.plain() {
            return self.small_halves(current, fragment, index, records[0].layer, [first, second]);
        }
        let (Some(sampled), Some(sampling)) = (&current.plan.sampled, &self.sampling) else {
            return Ok(false);
        };
        let plan = current.plan;
        let is_plain = plan.tests.is_empty()
            && plan.samples == 1
            && plan.sample_mask & 1 != 0
            && !sampling.takes_derivatives();
        if !is_plain {
            return Ok(false);
        }
        let limit = self.bounds.intersection(self.round.area);
        let clip = first.bounds.intersection(limit);
        let triangles = [first, second].map(|shape| match shape.coverage {
            Coverage::Triangle(corners) => Some(triangle_edges(corners)),
            _ => None,
        });
        let [Some(a), Some(b)] = triangles else {
            return Ok(false);
        };
        let Some(rectangle) = Rectangle::of(&a, &b, &clip) else {
            return Ok(false);
        };
        let corner = [self.bounds.left, self.bounds.top];
        let part = |record| Part::new(chunk, record, corner, &self.round.area);
        let tier = self.round.tier;
        if current.is_counted {
            self.counts.samples += rectangle.area();
        }
        // SAFETY: the rectangle lies in the clip, that in the limit, which is the part of a
        // worker's tile in the render area; for the rest, as for direct fragments, and the draw
        // keeps what its environment points to.
        unsafe {
            modulate::draw_rectangle(
                tier,
                tier,
                &plan.output,
                sampled,
                sampling,
                [&part(records[0]), &part(records[1])],
                &rectangle,
                &limit,
                &mut self.counts,
            );
        }
        Ok(true)
    }

    /// Adds the fragments of two small triangles that no test comes before to the wave, if they are
    /// a rectangle; else gives false. Apart from the loop over shapes, which it would make slower.
    #[inline(never)]
    fn small_halves(
        &mut self,
        current: Current<'a>,
        fragment: &Fragment<'_>,
        chunk: u32,
        layer: u16,
        shapes: [&Shape; 2],
    ) -> Result<bool, Stopped> {
        let [Coverage::Triangle(first), Coverage::Triangle(second)] =
            [shapes[0].coverage, shapes[1].coverage]
        else {
            return Ok(false);
        };
        let clip = (shapes[0].bounds).intersection(self.bounds.intersection(self.round.area));
        if clip.left >= clip.right || clip.top >= clip.bottom {
            return Ok(true);
        }
        let Some(blocks) = cover_rectangle(self.round.tier, [&first, &second], &self.bounds, &clip)
        else {
            return Ok(false);
        };
        let [origin, other] =
            [shapes[0].record, shapes[1].record].map(|record| Origin { chunk, record });
        for block in blocks.covered() {
            if current.is_counted {
                self.counts.samples += u64::from(block.lanes.count_ones());
            }
            let masks = masks_of(block.lanes.into());
            let found = Found {
                origin,
                place: [
                    self.bounds.left + i32::from(block.x),
                    self.bounds.top + i32::from(block.y),
                ],
                layer: layer.into(),
                area: &self.round.area,
                sample: 0,
                lanes: block.lanes,
                masks: &masks,
                coverage: &masks,
            };
            self.worker.packs.add_halves(&found, block.first, other);
            if self.worker.packs.packs.len() >= fragment.subgroups {
                self.run_wave()?;
            }
        }
        Ok(true)
    }

    #[inline(always)]
    pub(super) fn cover(
        &self,
        chunk: &Chunk,
        shape: &Shape,
        clip: &Bounds,
        locations: &[Location],
        covered: &mut Covered,
    ) {
        match shape.coverage {
            Coverage::Pixels { first, count, is_x } => {
                let (first, count) = (first as usize, count as usize);
                let list = chunk.pixels.get(first..).unwrap_or_default();
                let list = &list[..count.min(list.len())];
                listed(
                    list,
                    is_x,
                    &self.bounds,
                    clip,
                    locations.len() as u32,
                    &mut covered.blocks,
                );
            }
            Coverage::Upright { least, greatest } if locations.len() == 1 => {
                let pixels = Bounds::of_centers(least, greatest).intersection(*clip);
                cover_upright(&in_tile(&pixels, &self.bounds), covered);
            }
            _ => {
                let (edges, count) = shape.edges(chunk);
                convex(
                    self.round.tier,
                    &edges[..count],
                    &self.bounds,
                    clip,
                    locations,
                    covered,
                );
            }
        }
    }

    /// Adds the fragments of a small triangle to the wave, after their test.
    fn small_fragments(
        &mut self,
        current: Current<'a>,
        fragment: &Fragment<'_>,
        origin: Origin,
        layer: u32,
        blocks: &SmallBlocks,
    ) -> Result<(), Stopped> {
        for block in blocks.covered() {
            let lanes = block.lanes;
            if lanes == 0 {
                continue;
            }
            if current.is_counted {
                self.counts.samples += u64::from(lanes.count_ones());
            }
            let masks = masks_of(lanes.into());
            let found = Found {
                origin,
                place: [
                    self.bounds.left + i32::from(block.x),
                    self.bounds.top + i32::from(block.y),
                ],
                layer,
                area: &self.round.area,
                sample: 0,
                lanes,
                masks: &masks,
                coverage: &masks,
            };
            let joins = fragment.joins.then_some(self.own);
            self.worker.packs.add(&found, joins);
            if self.worker.packs.packs.len() >= fragment.subgroups {
                self.run_wave()?;
            }
        }
        Ok(())
    }

    /// Tests the fragments of a program, as far as that comes first, and adds those that are left
    /// to the wave.
    pub(super) fn fragments<const COUNTED: bool>(
        &mut self,
        current: Current<'a>,
        origin: Origin,
        record: &Record,
        covered: &mut Covered,
    ) -> Result<(), Stopped> {
        let Current { plan, .. } = current;
        let Some(fragment) = &plan.program else {
            return Ok(());
        };
        if !COUNTED && plan.takes_squares() {
            self.squares(current, fragment, origin, record, &covered.squares)?;
            covered.squares.clear();
        }
        covered.split(plan.samples);
        if !fragment.is_serial {
            let blocks = &mut covered.blocks;
            return self.some_fragments::<COUNTED>(current, fragment, origin, record, blocks);
        }
        // A fragment sees what those before it left: all of it, before its own tests.
        for block in &mut covered.blocks {
            let place = block.place([self.bounds.left, self.bounds.top]);
            if self.worker.packs.holds_any(place, any(&block.masks)) {
                self.run_wave()?;
            }
            let block = std::slice::from_mut(block);
            self.some_fragments::<COUNTED>(current, fragment, origin, record, block)?;
        }
        Ok(())
    }

    /// Does the tests of blocks that come before the program. If `sees_coverage`, keeps the blocks'
    /// masks from before the tests.
    pub(super) fn test<const COUNTED: bool>(
        &mut self,
        Current {
            plan, is_counted, ..
        }: Current<'a>,
        sees_coverage: bool,
        record: &Record,
        blocks: &mut [Block],
    ) {
        if plan.sample_mask & ALL_SAMPLES != ALL_SAMPLES {
            for block in &mut *blocks {
                for (sample, mask) in block.masks.iter_mut().enumerate() {
                    *mask &= if plan.sample_mask >> sample & 1 != 0 {
                        u16::MAX
                    } else {
                        0
                    };
                }
            }
        }
        let untested: Vec<u16> = match COUNTED {
            true => blocks.iter().map(|block| any(&block.masks)).collect(),
            false => Vec::new(),
        };
        let coverage = &mut self.worker.coverage;
        coverage.clear();
        if plan.order != Order::Late && !plan.tests.is_empty() {
            if sees_coverage {
                coverage.extend(blocks.iter().map(|block| block.masks));
            }
            let (corner, area) = ([self.bounds.left, self.bounds.top], &self.round.area);
            // SAFETY: as for direct fragments.
            unsafe { test_blocks(self.round.tier, plan, record, corner, area, blocks) };
        }
        if plan.order == Order::Early && is_counted {
            for block in &*blocks {
                self.counts.samples += count(&block.masks);
            }
        }
        if COUNTED {
            self.count_failed(blocks, &untested, record.layer.into());
        }
    }

    fn some_fragments<const COUNTED: bool>(
        &mut self,
        current: Current<'a>,
        fragment: &Fragment<'_>,
        origin: Origin,
        record: &Record,
        blocks: &mut [Block],
    ) -> Result<(), Stopped> {
        self.test::<COUNTED>(current, fragment.sees_coverage, record, blocks);
        let coverage = std::mem::take(&mut self.worker.coverage);
        let mut result = Ok(());
        for (index, block) in blocks.iter().enumerate() {
            let lanes = any(&block.masks);
            if lanes == 0 {
                continue;
            }
            // Before the tests, if there were any.
            let coverage = coverage.get(index).unwrap_or(&block.masks);
            let found = Found {
                origin,
                place: block.place([self.bounds.left, self.bounds.top]),
                layer: record.layer.into(),
                area: &self.round.area,
                sample: 0,
                lanes,
                masks: &block.masks,
                coverage,
            };
            result = self.add(fragment, &found);
            if result.is_err() {
                break;
            }
        }
        self.worker.coverage = coverage;
        result
    }

    fn add(&mut self, fragment: &Fragment<'_>, found: &Found<'_>) -> Result<(), Stopped> {
        let packs = &mut self.worker.packs;
        if !fragment.per_sample {
            packs.add(found, fragment.joins.then_some(self.own));
        } else {
            let masks = found.masks.iter().enumerate();
            for (sample, &mask) in masks.filter(|(_, mask)| **mask != 0) {
                let mut masks = [0; MAX_SAMPLES];
                masks[sample] = mask;
                let found = Found {
                    sample: sample as u8,
                    lanes: mask,
                    masks: &masks,
                    ..*found
                };
                packs.add(&found, None);
            }
        }
        // A block adds at most four subgroups, or as many as samples.
        match packs.packs.len() >= fragment.subgroups {
            true => self.run_wave(),
            false => Ok(()),
        }
    }

    /// Runs the waiting fragments, and writes their results in order.
    pub(super) fn run_wave(&mut self) -> Result<(), Stopped> {
        let Some(current) = self.current else {
            return Ok(());
        };
        let Some(fragment) = &current.plan.program else {
            return Ok(());
        };
        if self.worker.packs.packs.is_empty() {
            return Ok(());
        }
        let mut packs = std::mem::take(&mut self.worker.packs.packs);
        let result = self.run_packs(&current, fragment, &mut packs);
        self.worker.packs.packs = packs;
        self.worker.packs.clear();
        self.worker.gather.packs.clear();
        result
    }

    fn run_packs(
        &mut self,
        current: &Current<'_>,
        fragment: &Fragment<'_>,
        packs: &mut [Pack],
    ) -> Result<(), Stopped> {
        let program = fragment.program;
        let (tier, chunks) = (self.round.tier, self.round.chunks);
        let (limits, counted) = (self.round.context.limits, self.round.context.counts);
        let outputs = current.plan.output.rows;
        let coarse = current.plan.coarse.as_ref();
        let kind = coarse.map(|coarse| &coarse.kinds[self.worker.gather.kind]);
        if let Some(kind) = kind {
            Gather::to_pixels(packs, kind.rate);
        }
        let seen = match counted {
            Some(_) => self.seen_packs(packs, kind.map(|kind| kind.rate)),
            None => None,
        };
        let TileWorker {
            runner,
            gather,
            packs: waiting,
            shares,
            ..
        } = &mut *self.worker;
        runner.begin(program, Subgroups::apart(packs.len()), limits)?;
        runner.set_outputs(Some(outputs));
        let inputs = kind.map_or(&fragment.inputs, |kind| &kind.inputs);
        shares.collect(inputs, chunks, packs, &waiting.joined);
        let fragments = WaveFragments {
            chunks,
            packs,
            spread: &gather.packs,
        };
        let (output, counts) = (&current.plan.output, &mut self.counts);
        start(
            tier, program, inputs, output, fragments, shares, runner, counts,
        );
        runner.run_seen(program, &current.draw.environment, limits, seen.as_ref())?;
        let (plan, counts) = (current.plan, &mut self.counts);
        let Some(kind) = kind else {
            // SAFETY: as for direct fragments: these come from blocks, too.
            unsafe { finish(tier, chunks, plan, program, runner, packs, counts, counted) };
            return Ok(());
        };
        let wave = Wave {
            tier,
            chunks,
            plan,
            program,
            rate: kind.rate,
            area: &self.round.area,
            limits,
            counted,
        };
        // SAFETY: the packs come from blocks, whose pixels lie in the render area.
        unsafe { gather.finish(&wave, packs, runner, counts) }
    }
}

/// Asks for what the shapes that follow the first of a list need: the shapes themselves, and the
/// records and edges of those that were asked for before.
#[inline(always)]
fn fetch_ahead(chunk: &Chunk, shapes: &[u32]) {
    let shape = |ahead: usize| chunk.shapes.get(*shapes.get(ahead)? as usize);
    if let Some(next) = shape(AHEAD) {
        if let Some(record) = chunk.records.get(next.record as usize) {
            lanes::prefetch(record);
        }
        if let Coverage::Rectangle(index) = next.coverage
            && let Some(edges) = chunk.edges.get(index as usize)
        {
            lanes::prefetch(edges);
        }
    }
    if let Some(shape) = shape(2 * AHEAD) {
        lanes::prefetch(shape);
    }
}

/// Asks for what the inputs of a record's fragments are computed from, when the wave runs.
#[inline(always)]
fn fetch_inputs(chunk: &Chunk, record: &Record) {
    for vertex in record.vertices {
        if let Some(word) = chunk.outputs.get(vertex as usize) {
            lanes::prefetch(word);
        }
    }
    if let Some(extra) = chunk.extras.get(record.extra as usize) {
        lanes::prefetch(extra);
    }
}

/// Tests the fragments of a program that samples and multiplies, and writes them.
fn sample(
    tier: Tier,
    Current {
        plan, is_counted, ..
    }: Current<'_>,
    sampled: &Sampled<'_>,
    sampling: &Sampling<'_>,
    part: &Part<'_>,
    covered: &mut Covered,
    counts: &mut Counts,
) {
    if plan.sample_mask & 1 == 0 {
        return;
    }
    let is_tested = !plan.tests.is_empty();
    if is_tested || sampling.takes_derivatives() {
        covered.split(1);
    }
    // SAFETY: as for direct fragments; the draw keeps what its environment points to.
    unsafe {
        if is_tested {
            let (corner, blocks) = (part.corner, &mut covered.blocks);
            test_blocks(tier, plan, part.record, corner, part.area, blocks);
        }
        if is_counted {
            let pixels = |square: &Square| u64::from(square.size) * u64::from(square.size);
            counts.samples += covered.squares.iter().map(pixels).sum::<u64>();
            let blocks = covered.blocks.iter();
            counts.samples += blocks.map(|block| count(&block.masks)).sum::<u64>();
        }
        modulate::draw(
            tier,
            tier,
            &plan.output,
            sampled,
            sampling,
            part,
            covered,
            counts,
        );
    }
}
