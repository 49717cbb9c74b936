//! Data that draws of one state and one set of programs share, prepared for tiles.

use std::sync::Arc;

use ash::vk;
use lanes::Tier;
use spirv_jit::Program;
use spirv_jit::program::FragmentFacts;

use super::HAS_PORTABLE_LOOPS;
use super::coarse::Coarse;
use super::depth::Tests;
use super::inputs::Inputs;
use super::modulate::Sampled;
use super::output::Output;
use super::pass_through::PassThrough;
use super::samples::{Locations, MAX_SAMPLES};
use crate::object::graphics_state::{GraphicsState, MAX_VIEWPORTS};
use crate::object::shading_rate::Rate;
use crate::raster::primitive::Record;
use crate::raster::{Chunk, Draw, Targets, Work};
use crate::wave::runner::subgroups_at_once;

/// When the tests are done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Before the program.
    Early,
    /// After it; what fails already need not run.
    LateButSeen,
    /// After it.
    Late,
}

/// How a draw's fragments are worked off.
pub struct Plan<'a> {
    pub program: Option<Fragment<'a>>,
    /// In its place, where nothing needs to run.
    pub pass_through: Option<PassThrough>,
    /// In its place, where that is a sample and products.
    pub sampled: Option<Sampled<'a>>,
    /// The rates of fragments that may be of several pixels.
    pub coarse: Option<Coarse>,
    pub tests: Tests,
    pub order: Order,
    pub output: Output,
    pub samples: u32,
    pub locations: Locations,
    /// Samples that the state lets pass.
    pub sample_mask: u32,
    /// Fragments of one sample go from coverage to the program, with nothing between but a depth
    /// test.
    is_small: bool,
    /// They do so without a test, and may join.
    is_plain: bool,
    /// By viewport: the range that depths are clamped to; none where they are not.
    depth_ranges: Vec<[f32; 2]>,
}

/// The program of a plan.
pub struct Fragment<'a> {
    pub program: &'a Program,
    pub inputs: Inputs,
    /// One invocation a sample.
    pub per_sample: bool,
    /// A fragment sees what earlier ones at its pixel left: they never run side by side.
    pub is_serial: bool,
    /// It sees coverage as it was before the early tests (without `PostDepthCoverage`).
    pub sees_coverage: bool,
    /// Pixels of one quad may be of several primitives: no lane looks at others, and nothing but
    /// inputs depends on the primitive.
    pub joins: bool,
    /// Subgroups that run together.
    pub subgroups: usize,
}

impl<'a> Fragment<'a> {
    fn new(
        program: &'a Program,
        inputs: Inputs,
        facts: &FragmentFacts,
        (per_sample, samples): (bool, u32),
        may_join: bool,
    ) -> Self {
        let is_serial = facts.reads_attachments || facts.interlock.is_some();
        let is_plain = !(is_serial || facts.writes_memory || facts.full_quads || per_sample);
        let sees_coverage = inputs.see_coverage();
        Self {
            program,
            per_sample: per_sample && samples > 1,
            is_serial,
            sees_coverage: sees_coverage && !facts.post_depth_coverage,
            inputs,
            joins: may_join && is_plain && !sees_coverage && !program.looks_at_lanes(),
            subgroups: subgroups_at_once(program),
        }
    }
}

impl<'a> Plan<'a> {
    /// Of a draw in a pass.
    pub fn new(tier: Tier, targets: &Targets, draw: &'a Draw) -> Self {
        let state = &*draw.state;
        let samples = targets.samples.clamp(1, 8);
        let fragment = draw.stages.fragment();
        let facts = (fragment.and_then(Program::fragment)).copied();
        let facts = facts.unwrap_or_default();
        let targets = &targets.used_by(&state.used_attachments);
        let tests = Tests::new(targets, &state.depth_stencil);
        let output = Output::new(tier, targets, state, fragment);
        let multisample = &state.multisample;
        let locations = Locations::new(samples, multisample);
        // Shading a part of the samples is shading all of them, as soon as it is more than one
        // (spec, "Sample Shading").
        let shades_samples = multisample.sample_shading
            && multisample.min_sample_shading * samples as f32 > 1.0
            && samples > 1;
        let per_sample = shades_samples || facts.per_sample;
        let link = |program, rate| {
            let last = draw.stages.last();
            Inputs::new(program, last, locations, rate, per_sample, shades_samples)
        };
        let inputs = fragment.map(|program| link(program, Rate::default()));
        // Sample shading makes fragments of a pixel (spec, "Fragment Shading Rates").
        let shades_pixels = !(multisample.sample_shading || facts.per_sample);
        let coarse = fragment.filter(|_| shades_pixels).and_then(|program| {
            let inputs = |rate| link(program, rate);
            Coarse::new(draw, targets, samples, facts.post_depth_coverage, inputs)
        });
        let order = order(&facts, &output, &tests);
        let has_effects = facts.discards || facts.writes_memory || facts.interlock.is_some();
        let rows = fragment.zip(inputs.as_ref()).map(|(program, inputs)| {
            let outputs = program
                .pass_through()
                .filter(|_| !has_effects && !per_sample);
            outputs.map(|outputs| inputs.pass_through(outputs))
        });
        let passes = order == Order::Early && !output.drops_samples();
        let pass_through = match &rows {
            _ if coarse.is_some() || !passes || output.smooth_alpha.is_some() => None,
            Some(None) => None,
            Some(Some(rows)) => PassThrough::new(tier, Some(rows), &output),
            None => PassThrough::new(tier, None, &output),
        };
        let modulated = (fragment.and_then(Program::modulated))
            .filter(|_| order == Order::Early && !(has_effects || per_sample))
            .filter(|_| output.smooth_alpha.is_none() && coarse.is_none())
            .filter(|_| tier != Tier::Portable || HAS_PORTABLE_LOOPS);
        let sampled = (modulated.zip(inputs.as_ref()))
            .and_then(|(modulated, inputs)| Sampled::new(modulated, inputs, &output));
        let program = fragment.zip(inputs).map(|(program, inputs)| {
            let may_join = order == Order::Early && output.smooth_alpha.is_none();
            Fragment::new(program, inputs, &facts, (per_sample, samples), may_join)
        });
        let runs = |it: &Fragment<'_>| !(it.is_serial || it.per_sample || it.sees_coverage);
        let is_small = program.as_ref().is_some_and(runs)
            && order == Order::Early
            && pass_through.is_none()
            && sampled.is_none()
            && coarse.is_none()
            && (tests.is_empty() || tests.plain().is_some())
            && samples == 1
            && multisample.sample_mask & 1 != 0;
        let may_join = program.as_ref().is_some_and(|program| program.joins);
        let is_plain = is_small && may_join && tests.is_empty();
        Self {
            program,
            pass_through,
            sampled,
            coarse,
            is_small,
            is_plain,
            order,
            tests,
            output,
            samples,
            locations,
            sample_mask: multisample.sample_mask,
            depth_ranges: depth_ranges(state),
        }
    }

    /// The program, where at most a depth test stands between coverage and it.
    #[inline(always)]
    pub fn small(&self) -> Option<&Fragment<'a>> {
        self.program.as_ref().filter(|_| self.is_small)
    }

    /// The program, where nothing stands between coverage and it.
    #[inline(always)]
    pub fn plain(&self) -> Option<&Fragment<'a>> {
        self.program.as_ref().filter(|_| self.is_plain)
    }

    /// Whether blocks that are covered as a whole go to the program as they are.
    #[inline(always)]
    pub fn takes_squares(&self) -> bool {
        let runs = |it: &Fragment<'_>| !(it.is_serial || it.per_sample);
        let is_first = self.order == Order::Late || self.tests.is_empty();
        is_first && self.coarse.is_none() && self.program.as_ref().is_some_and(runs)
    }

    /// The masks of a block that is covered as a whole, without samples that the state leaves out.
    #[inline(always)]
    pub fn whole(&self) -> [u16; MAX_SAMPLES] {
        let mut masks = [0; MAX_SAMPLES];
        for (sample, mask) in masks.iter_mut().enumerate().take(self.samples as usize) {
            if self.sample_mask >> sample & 1 != 0 {
                *mask = u16::MAX;
            }
        }
        masks
    }

    /// The range that depths of a primitive are clamped to.
    #[inline(always)]
    pub fn depth_range(&self, record: &Record) -> Option<[f32; 2]> {
        let range = self.depth_ranges.get(usize::from(record.viewport));
        range.copied()
    }
}

/// The ranges of [`Plan::depth_range`].
fn depth_ranges(state: &GraphicsState) -> Vec<[f32; 2]> {
    let rasterization = &state.rasterization;
    if !rasterization.depth_clamp {
        return Vec::new();
    }
    let of_viewport = |viewport: &vk::Viewport| {
        let (near, far) = (viewport.min_depth, viewport.max_depth);
        [near.min(far), far.max(near)]
    };
    let range = |viewport| (rasterization.depth_clamp_range).unwrap_or(of_viewport(viewport));
    let viewports = state.viewports.viewports.iter();
    viewports.take(MAX_VIEWPORTS).map(range).collect()
}

/// Tests run after a program whose effects or outputs depend on their order (spec, "Early Fragment
/// Test"); they run early when the order is unobservable.
fn order(facts: &FragmentFacts, output: &Output, tests: &Tests) -> Order {
    let replaces = facts.depth.is_some() || facts.writes_stencil_ref;
    let drops = facts.discards || output.drops_samples();
    // The depth and stencil values that it reads are results of earlier fragments.
    let looks = facts.reads_attachments;
    if facts.early_tests || !(replaces || drops || looks || facts.writes_memory) {
        Order::Early
    } else if !replaces && !facts.writes_memory && tests.is_monotonic() {
        Order::LateButSeen
    } else {
        Order::Late
    }
}

/// The plans of the draws that chunks come from.
pub struct Plans<'a> {
    plans: Vec<Plan<'a>>,
    /// The first draw, and the plan of each from there on.
    first: usize,
    of_draws: Vec<u32>,
}

impl<'a> Plans<'a> {
    /// Of chunks in order.
    pub fn new(tier: Tier, targets: &Targets, work: &'a [Work], chunks: &[Chunk]) -> Self {
        // Records are in the order of draws.
        let first = chunks.iter().find_map(|chunk| chunk.records.first());
        let last = chunks.iter().rev().find_map(|chunk| chunk.records.last());
        let first = first.map_or(0, |record| record.draw as usize);
        let end = last.map(|record| record.draw as usize + 1);
        let mut plans = Vec::new();
        let mut of_draws = Vec::new();
        let mut last: Option<&Draw> = None;
        for work in &work[first.min(work.len())..end.unwrap_or(0).clamp(first, work.len())] {
            if let Work::Draw(draw) = work {
                let is_same = last.is_some_and(|last| {
                    Arc::ptr_eq(&last.stages, &draw.stages) && Arc::ptr_eq(&last.state, &draw.state)
                });
                if !is_same {
                    plans.push(Plan::new(tier, targets, draw));
                    last = Some(draw);
                }
            }
            of_draws.push((plans.len() as u32).wrapping_sub(1));
        }
        Self {
            plans,
            first,
            of_draws,
        }
    }

    /// That of a draw, by its index in the batch's work.
    pub fn of_draw(&self, draw: u32) -> Option<&Plan<'a>> {
        let place = (draw as usize).checked_sub(self.first)?;
        self.plans.get(*self.of_draws.get(place)? as usize)
    }
}
