//! Writes of fragments into the colour attachments: dropped samples and blended colours, sixteen
//! pixels at a time.

use ash::vk;
use lanes::Tier;
use lanes::vector::Vector;
use spirv_jit::Program;
use spirv_jit::program::{AlignedRow, OutputRow};

use super::advanced::is_advanced;
use super::blend::blend;
use super::color::{Color, color};
use super::lanes::{Floats, LANE_X, LANE_Y, floats_of, lanes_where, numbers, words};
use super::places::Places;
use super::samples::MAX_SAMPLES;
use super::texels::{fetch, load};
use crate::object::graphics_state::{GraphicsState, MAX_COLOR_ATTACHMENTS};
use crate::raster::Targets;

/// Pixels along the side of the pattern of [`THRESHOLDS`].
const SIDE: usize = 8;

/// The least alpha that covers a pixel of one sample, by row and column modulo [`SIDE`]. Each of 64
/// steps occurs once, and neighbours differ by large steps (Bayer 1973). So the share of covered
/// pixels in an area is about alpha, and the same pixels are covered in every run.
static THRESHOLDS: [[f32; SIDE]; SIDE] = thresholds();

const fn thresholds() -> [[f32; SIDE]; SIDE] {
    let mut thresholds = [[0.0; SIDE]; SIDE];
    let mut pixel = 0;
    while pixel < SIDE * SIDE {
        let (x, y) = (pixel % SIDE, pixel / SIDE);
        // Interleaves the bits of x ^ y and y, the lowest ones first.
        let (mut step, mut bit) = (0, 0);
        while bit < 3 {
            step = step << 2 | ((x ^ y) >> bit & 1) << 1 | y >> bit & 1;
            bit += 1;
        }
        thresholds[y][x] = (step as f32 + 0.5) / (SIDE * SIDE) as f32;
        pixel += 1;
    }
    thresholds
}

/// [`THRESHOLDS`] of sixteen pixels.
fn dithered(places: &Places) -> Floats {
    std::array::from_fn(|lane| {
        let quad = lane / 4;
        let x = places.x[quad] + (LANE_X[lane] & 1);
        let y = places.y[quad] + (LANE_Y[lane] & 1);
        THRESHOLDS[y as usize % SIDE][x as usize % SIDE]
    })
}

/// The destination of a program's outputs.
pub struct Output {
    pub(super) samples: u32,
    /// The row of the first colour's alpha, where the coverage of smooth lines goes into it.
    pub smooth_alpha: Option<usize>,
    pub colors: Vec<Color>,
    constants: [f32; 4],
    /// Rows of outputs that are no colours.
    pub depth: Option<usize>,
    pub stencil: Option<usize>,
    pub sample_mask: Option<usize>,
    /// The row of alpha, where it becomes coverage.
    alpha: Option<usize>,
    /// Rows of outputs up to the last one that matters: programs may write to locations without an
    /// attachment.
    pub rows: usize,
}

impl Output {
    /// Links a program to the attachments of a pass.
    pub fn new(
        tier: Tier,
        targets: &Targets,
        state: &GraphicsState,
        program: Option<&Program>,
    ) -> Self {
        let outputs = program.map_or(&[][..], Program::outputs);
        let row = |wanted: OutputRow| outputs.iter().position(|row| *row == wanted);
        let color_row = |location: usize, component: u8, index: u8| {
            row(OutputRow::Location {
                location: location as u16,
                component,
                index,
            })
        };
        let colors: Vec<Color> = (0..MAX_COLOR_ATTACHMENTS)
            .filter_map(|location| {
                let rows = |index| [0, 1, 2, 3].map(|it| color_row(location, it, index));
                let source = rows(0);
                source.iter().flatten().next()?;
                let attachment = state.color_locations[location] as usize;
                let target = *targets.colors.get(attachment)?.as_ref()?;
                color(tier, &target, state, attachment, source, rows(1))
            })
            .collect();
        let depth = row(OutputRow::FragDepth);
        let stencil = row(OutputRow::FragStencilRef);
        let sample_mask = row(OutputRow::SampleMask);
        let alpha = color_row(0, 3, 0).filter(|_| state.multisample.alpha_to_coverage);
        let is_smooth =
            state.rasterization.line_mode == vk::LineRasterizationModeEXT::RECTANGULAR_SMOOTH;
        let first = targets.colors.get(state.color_locations[0] as usize);
        let first = first.and_then(Option::as_ref);
        let has_alpha = first.is_some_and(|it| !it.surface.format.numeric.is_integer());
        let smooth_alpha = color_row(0, 3, 0).filter(|_| is_smooth && has_alpha);
        let of_colors = colors
            .iter()
            .flat_map(|color| color.source.iter().chain(&color.second));
        let others = [depth, stencil, sample_mask, alpha, smooth_alpha];
        let last = of_colors.chain(&others).flatten().max();
        Self {
            samples: targets.samples,
            rows: last.map_or(0, |last| last + 1),
            smooth_alpha,
            colors,
            constants: state.blend.constants,
            depth,
            stencil,
            sample_mask,
            alpha,
        }
    }

    /// Whether fragments lose samples by outputs of the program.
    pub fn drops_samples(&self) -> bool {
        self.sample_mask.is_some() || self.alpha.is_some()
    }

    /// Takes from the masks the samples that the program's sample mask and alpha leave out. `rows`:
    /// the program's outputs.
    pub fn drop_samples(
        &self,
        rows: &[AlignedRow],
        places: &Places,
        masks: &mut [u16; MAX_SAMPLES],
    ) {
        let samples = self.samples;
        if let Some(row) = self.sample_mask {
            let row = &rows[row].0;
            for (sample, mask) in (0..samples).zip(masks.iter_mut()) {
                *mask &= lanes_where(|lane| row[lane] >> sample & 1 != 0);
            }
        }
        if let Some(row) = self.alpha {
            let alpha = floats_of(&rows[row].0);
            if samples == 1 {
                let least = dithered(places);
                masks[0] &= lanes_where(|lane| alpha[lane] >= least[lane]);
                return;
            }
            for (sample, mask) in (0..samples).zip(masks.iter_mut()) {
                // So many samples as alpha times their number, rounded, the first ones first. A NaN
                // covers none.
                let least = (sample as f32 + 0.5) / samples as f32;
                *mask &= lanes_where(|lane| alpha[lane] >= least);
            }
        }
    }

    /// Whether fragments that leave the same outputs leave the same texels, whatever is there.
    pub fn replaces(&self) -> bool {
        let is_plain =
            |color: &Color| color.blend.is_none() && color.writes_all && color.logic_op.is_none();
        self.colors.iter().all(is_plain)
    }

    /// Asks for texels that fragments of one sample a pixel are written to soon.
    #[inline(always)]
    pub fn fetch(&self, places: &Places) {
        for color in &self.colors {
            fetch(&color.target, places);
        }
    }

    /// Whether all attachments have four bytes and one sample, and all fragments that a program
    /// leaves are written.
    pub fn is_bytes(&self) -> bool {
        let are_bytes = self.colors.iter().all(|color| color.bytes.is_some());
        let is_plain = !self.drops_samples() && self.smooth_alpha.is_none();
        self.samples == 1 && are_bytes && is_plain
    }

    /// Writes one attachment's colours.
    ///
    /// # Safety
    /// As [`load`].
    #[inline(always)]
    pub unsafe fn write_color<V: Vector>(
        &self,
        v: V,
        color: &Color,
        source: &[V::I; 4],
        second: &[V::I; 4],
        places: &Places,
        masks: &[u16; MAX_SAMPLES],
    ) {
        let samples = self.samples as usize;
        let Some(state) = &color.blend else {
            let words = color.encode(v, source);
            for (sample, &mask) in masks.iter().enumerate().take(samples) {
                if mask != 0 {
                    // SAFETY: the caller keeps the contract of `load`.
                    unsafe { color.put(v, places, sample as u32, mask, &words) };
                }
            }
            return;
        };
        let (source, second) = (numbers(v, source), numbers(v, second));
        for (sample, &mask) in masks.iter().enumerate().take(samples) {
            if mask == 0 {
                continue;
            }
            let sample = sample as u32;
            // SAFETY: the caller keeps the contract of `load`.
            let old = unsafe { load(v, &color.target, places, sample, mask) };
            let destination = numbers(v, &color.decode(v, &old));
            let (constants, range) = (&self.constants, color.range);
            let blended = match color.over {
                Some(over) => over.blend(v, &source, &destination),
                None if is_advanced(state.color_op) => {
                    color.blend_advanced(v, state, &source, &destination)
                }
                None => blend(v, state, constants, range, &source, &second, &destination),
            };
            let new = color.encode(v, &words(v, &blended));
            // SAFETY: the caller keeps the contract of `load`.
            unsafe { color.put_over(v, places, sample, mask, &new, &old) };
        }
    }
}
