//! Fragments of several pixels (spec, "Fragment Shading Rates").
//!
//! Coverage, tests and writes stay those of pixels; only the program runs less often. A quad of
//! fragments of w×h pixels has w×h quads of pixels, its *parts*, row by row. The blocks of a
//! primitive are tested as always, then their quads are gathered by the fragments that they belong
//! to. The fragments go into packs as if they were pixels of a smaller tile. After the wave, its
//! outputs are copied to the quads of each part in turn, and those are finished like any others.

use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::program::OutputRow;

use super::coverage::{Block, Covered};
use super::inputs::{Inputs, vertex_words};
use super::pack::{Found, Origin, Pack, Packs, Went, move_quad, quad_place};
use super::pass_through::Part;
use super::samples::{MAX_COVERAGE, MAX_SAMPLES, any};
use crate::capabilities::limits::RATE_TEXEL;
use crate::object::shading_rate::{RATES, Rate, ShadingRate};
use crate::raster::primitive::Record;
use crate::raster::{Draw, Target, Targets};
use crate::wave::runner::Runner;

/// Parts of a quad, at most.
const PARTS: usize = 16;

/// Blocks along a tile's side.
const BLOCKS: usize = crate::raster::TILE as usize / 4;

/// Masks of the lanes of four quads, by part and sample.
type Masks = [[u16; MAX_SAMPLES]; PARTS];

/// The rates of a draw.
pub struct Coarse {
    state: ShadingRate,
    samples: u32,
    /// The place of primitives' rates in the outputs of the stage before.
    primitive: Option<RateWord>,
    attachment: Option<Target>,
    pub kinds: SmallVec<[RateGroup; 1]>,
    /// Inputs depend on coverage.
    has_coverage: bool,
    /// And on that before the early tests.
    pub sees_untested: bool,
}

/// Fragments of one size.
pub struct RateGroup {
    pub rate: Rate,
    pub inputs: Inputs,
}

/// A word of the provoking vertex, or one that a mesh program gave to the primitive.
#[derive(Clone, Copy)]
enum RateWord {
    OfVertex(u32),
    OfPrimitive(u32),
}

impl RateWord {
    fn new(before: &Program) -> Option<Self> {
        let mut outputs = before.outputs().iter();
        let word = outputs.position(|row| *row == OutputRow::ShadingRate)? as u32;
        Some(match before.mesh() {
            None => Self::OfVertex(word),
            Some(_) => Self::OfPrimitive(word.saturating_sub(vertex_words(Some(before)))),
        })
    }

    fn rate(self, record: &Record, outputs: &[u32]) -> Rate {
        let place = match self {
            Self::OfVertex(word) => {
                let provoking = usize::from(record.provoking.min(2));
                record.vertices[provoking].wrapping_add(word)
            }
            Self::OfPrimitive(word) => record.words.wrapping_add(word),
        };
        Rate::from_word(outputs.get(place as usize).copied().unwrap_or(0))
    }
}

impl Coarse {
    /// The rates of a draw whose program does not run for each sample; none if all its fragments
    /// are pixels. `inputs` links the program for fragments of a size.
    pub fn new(
        draw: &Draw,
        targets: &Targets,
        samples: u32,
        post_depth_coverage: bool,
        inputs: impl Fn(Rate) -> Inputs,
    ) -> Option<Self> {
        let state = draw.state.shading_rate;
        let [primitive, attachment] = state.uses();
        let primitive = (draw.stages.last().filter(|_| primitive)).and_then(RateWord::new);
        let attachment = targets.rates.filter(|_| attachment);
        let one = Rate::default();
        let fixed = state.at(state.of_primitive(one), one, samples);
        let varies = primitive.is_some() || attachment.is_some();
        // Without an attachment its rate is one.
        let most = state.at(RATES[0], one, samples);
        if fixed.is_one() && (!varies || attachment.is_none() && most.is_one()) {
            return None;
        }
        let has_samples = |rate: &Rate| rate.samples().as_raw() & samples != 0;
        let rates = RATES.into_iter().filter(has_samples);
        let rates = rates.filter(|&rate| varies || rate == fixed);
        let kind = |rate| RateGroup {
            rate,
            inputs: inputs(rate),
        };
        let kinds: SmallVec<[RateGroup; 1]> = rates.map(kind).collect();
        let has_coverage = kinds.iter().any(|kind| kind.inputs.see_coverage());
        Some(Self {
            state,
            samples,
            primitive,
            attachment,
            kinds,
            has_coverage,
            sees_untested: has_coverage && !post_depth_coverage,
        })
    }

    /// The rate of a primitive, before the attachment's.
    fn of_primitive(&self, record: &Record, outputs: &[u32]) -> Rate {
        let rate = self.primitive.map(|place| place.rate(record, outputs));
        self.state.of_primitive(rate.unwrap_or_default())
    }

    /// The kind of fragments at a pixel, where the primitive has a rate.
    fn kind(&self, primitive: Rate, pixel: [i32; 2], layer: u32) -> usize {
        let attachment = self.attachment.map(|rates| rate_at(&rates, pixel, layer));
        let attachment = attachment.unwrap_or_default();
        let rate = (self.state).at(primitive, attachment, self.samples);
        let place = self.kinds.iter().position(|kind| kind.rate == rate);
        place.unwrap_or(0)
    }
}

/// The attachment's rate for a pixel.
fn rate_at(rates: &Target, pixel: [i32; 2], layer: u32) -> Rate {
    let Target {
        surface,
        first_layer,
        layers,
    } = rates;
    let slice = first_layer
        + if *layers > 1 {
            layer.min(layers - 1)
        } else {
            0
        };
    let [x, y] = [(pixel[0], surface.width), (pixel[1], surface.height)]
        .map(|(at, size)| (at as u32 / RATE_TEXEL).min(size.saturating_sub(1)));
    // SAFETY: the texel is inside, and the pass keeps the image, whose texels are bytes, as it is.
    let word = unsafe { surface.texel(x, y, slice.min(surface.slices - 1), 0).read() };
    Rate::from_word(word.into())
}

/// A part of a quad of fragments.
#[derive(Clone, Copy)]
pub struct PartOf {
    rate: Rate,
    /// Its column and row, in quads of pixels.
    pub(super) at: [usize; 2],
}

impl PartOf {
    pub fn new(rate: Rate, part: usize) -> Self {
        let column = part & (rate.pixels()[0] - 1);
        let row = part >> rate.logs[0];
        Self {
            rate,
            at: [column, row],
        }
    }

    /// Of the pixel in a lane of the part: the lane of its fragment in the quad, and its number
    /// within that, from the last pixel on, as coverage masks have it.
    pub fn fragment(&self, lane: usize) -> (usize, usize) {
        let [[x, left], [y, above]] = [0, 1].map(|axis| {
            let pixel = 2 * self.at[axis] + (lane >> axis & 1);
            let log = self.rate.logs[axis];
            [pixel >> log, pixel & ((1 << log) - 1)]
        });
        let [width, height] = self.rate.pixels();
        (x + 2 * y, width * height - 1 - (left + width * above))
    }
}

/// A 4×4 block of fragments of one primitive.
pub struct Gathered {
    /// Its first pixel, from the tile's.
    pub(super) first: [u8; 2],
    pub(super) kind: u8,
    masks: Masks,
    /// Before the tests.
    untested: Masks,
}

impl Gathered {
    /// Lanes of fragments with a sample that is left.
    pub fn lanes(&self, rate: Rate) -> u16 {
        let [width, height] = rate.pixels();
        let mut lanes = 0;
        for part in 0..width * height {
            let covered = any(&self.masks[part]);
            if covered != 0 {
                let part = PartOf::new(rate, part);
                for pixel in 0..4 {
                    let of_pixel = covered >> pixel & 0x1111;
                    lanes |= of_pixel << part.fragment(pixel).0;
                }
            }
        }
        lanes
    }

    /// By bit of the coverage mask: fragments that have it.
    fn coverage(&self, rate: Rate, samples: usize, untested: bool) -> [[u16; MAX_SAMPLES]; 2] {
        let [width, height] = rate.pixels();
        let masks = if untested {
            &self.untested
        } else {
            &self.masks
        };
        let mut coverage = [[0; MAX_SAMPLES]; 2];
        for (part, masks) in masks.iter().enumerate().take(width * height) {
            let part = PartOf::new(rate, part);
            for pixel in 0..4 {
                let (lane, number) = part.fragment(pixel);
                for (sample, mask) in masks.iter().enumerate().take(samples) {
                    let bit = number * samples + sample;
                    if let Some(row) = coverage.as_flattened_mut().get_mut(bit) {
                        *row |= (mask >> pixel & 0x1111) << lane;
                    }
                }
            }
        }
        coverage
    }
}

/// Masks of a pack of fragments of several pixels.
#[derive(Default)]
pub struct Spread {
    /// By part: covered samples of its quads.
    pub(super) masks: Masks,
    coverage: [[u16; MAX_SAMPLES]; 2],
}

impl Spread {
    /// By bit of the coverage mask: fragments that have it.
    pub fn coverage(&self) -> &[u16] {
        self.coverage.as_flattened()
    }
}

const _: () = assert!(2 * MAX_SAMPLES == MAX_COVERAGE && RATE_TEXEL >= 16);

/// The primitive whose blocks are gathered.
#[derive(Clone, Copy, PartialEq)]
pub struct Of {
    pub origin: Origin,
    pub layer: u32,
}

/// A worker's memory for fragments of several pixels.
pub struct Gather {
    pub of: Option<Of>,
    pub(super) blocks: Vec<Gathered>,
    /// By 4×4 pixels of the tile: of the block of fragments that starts there, its index in
    /// `blocks`, plus one.
    pub(super) places: Box<[u16; BLOCKS * BLOCKS]>,
    /// Of the packs that wait, all of them of one kind.
    pub packs: Vec<Spread>,
    pub kind: usize,
    /// States of parts.
    pub(super) states: Runner,
    pub(super) parts: Vec<Pack>,
    /// The packs that they are of.
    pub(super) sources: Vec<usize>,
}

impl Default for Gather {
    fn default() -> Self {
        Self {
            of: None,
            blocks: Vec::new(),
            places: Box::new([0; BLOCKS * BLOCKS]),
            packs: Vec::new(),
            kind: 0,
            states: Runner::default(),
            parts: Vec::new(),
            sources: Vec::new(),
        }
    }
}

/// The index of the block at a pixel of the tile.
pub fn block_at([x, y]: [u8; 2]) -> usize {
    usize::from(y) / 4 * BLOCKS + usize::from(x) / 4
}

impl Gather {
    /// Forgets all.
    pub fn clear(&mut self) {
        for block in self.blocks.drain(..) {
            self.places[block_at(block.first)] = 0;
        }
        self.of = None;
        self.packs.clear();
    }

    /// Ends a worker's part of a round.
    pub fn rest(&mut self) {
        self.states.rest();
    }

    /// Adds tested blocks of a primitive, from the tile's corner on, and what they were before the
    /// tests, where that matters.
    pub fn add(
        &mut self,
        coarse: &Coarse,
        part: &Part<'_>,
        covered: &Covered,
        untested: &[[u16; MAX_SAMPLES]],
    ) {
        let rate = coarse.of_primitive(part.record, part.outputs);
        let layer = part.record.layer.into();
        let mut kind = coarse.kind(rate, part.corner, layer);
        for (index, block) in covered.blocks.iter().enumerate() {
            let untested = untested.get(index).unwrap_or(&block.masks);
            if any(untested) == 0 {
                continue;
            }
            if coarse.attachment.is_some() {
                kind = coarse.kind(rate, block.place(part.corner), layer);
            }
            self.add_block(kind, coarse.kinds[kind].rate, block, untested);
        }
    }

    fn add_block(&mut self, kind: usize, rate: Rate, block: &Block, untested: &[u16; MAX_SAMPLES]) {
        let [x_log, y_log] = rate.logs;
        let first = [
            block.x & (u8::MAX << (2 + x_log)),
            block.y & (u8::MAX << (2 + y_log)),
        ];
        let place = &mut self.places[block_at(first)];
        if *place == 0 {
            self.blocks.push(Gathered {
                first,
                kind: kind as u8,
                masks: Masks::default(),
                untested: Masks::default(),
            });
            *place = self.blocks.len() as u16;
        }
        let gathered = &mut self.blocks[usize::from(*place) - 1];
        let [width, height] = rate.pixels();
        for quad in 0..4 {
            let at = quad_place([block.x.into(), block.y.into()], quad);
            let [x, y] = at.map(|at| at as usize / 2);
            let part = (x & (width - 1)) + (y & (height - 1)) * width;
            let to = (x >> x_log & 1) + 2 * (y >> y_log & 1);
            move_quad(&block.masks, quad, &mut gathered.masks[part], to);
            move_quad(untested, quad, &mut gathered.untested[part], to);
        }
    }

    /// Adds the fragments of a gathered block to packs, which are of its kind.
    pub fn pack(
        &mut self,
        coarse: &Coarse,
        block: &Gathered,
        found: &Found<'_>,
        packs: &mut Packs,
    ) {
        let rate = coarse.kinds[self.kind].rate;
        let coverage = match coarse.has_coverage {
            true => block.coverage(rate, coarse.samples as usize, coarse.sees_untested),
            false => Default::default(),
        };
        let list = &mut self.packs;
        packs.add_with(found, |Went { pack, quad }| {
            if list.len() <= pack {
                list.push(Spread::default());
            }
            let spread = &mut list[pack];
            let Some((quad, place)) = quad else {
                (spread.masks, spread.coverage) = (block.masks, coverage);
                return;
            };
            let from = block.masks.iter().chain(&coverage);
            let to = spread.masks.iter_mut().chain(&mut spread.coverage);
            for (from, to) in from.zip(to) {
                move_quad(from, quad, to, place);
            }
        });
    }

    /// Moves packs to the first pixels of their quads of fragments.
    pub fn to_pixels(packs: &mut [Pack], rate: Rate) {
        for Pack { places, .. } in packs {
            places.x = places.x.map(|x| x << rate.logs[0]);
            places.y = places.y.map(|y| y << rate.logs[1]);
        }
    }
}
