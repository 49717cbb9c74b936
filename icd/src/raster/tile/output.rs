//! What fragments write into the colour attachments: blended or operated on, masked, encoded, sixteen pixels at a time.

use ash::vk::{ColorComponentFlags, LogicOp};
use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::image::format::Numeric;
use spirv_jit::image::texels::{decode_block, encode_block};
use spirv_jit::interp::TierKind;
use spirv_jit::program::{AlignedRow, OutputRow};

use super::blend::{Range, blend, operate_words};
use super::lanes::{Row, bits_of, floats_of, lanes_where};
use super::samples::MAX_SAMPLES;
use super::texels::{Places, Words, load, store};
use crate::object::graphics_state::{BlendAttachment, GraphicsState, MAX_COLOR_ATTACHMENTS};
use crate::raster::{Target, Targets};

/// Bits of 1.0.
const ONE: u32 = 0x3f80_0000;

/// Output rows of a colour, by component; none for what the program does not write.
type Rows = [Option<usize>; 4];

/// Texels of sixteen fragments, by colour attachment.
pub type Texels = SmallVec<[Words; 1]>;

/// A colour attachment that a draw writes to.
struct Color {
    target: Target,
    source: Rows,
    second: Rows,
    blend: Option<BlendAttachment>,
    range: Range,
    logic_op: Option<LogicOp>,
    /// By word of a texel: bits that are written.
    written: [u32; 4],
    /// Those are all.
    writes_all: bool,
    alpha_to_one: bool,
}

/// What a program's outputs become.
pub struct Output {
    tier: TierKind,
    samples: u32,
    colors: Vec<Color>,
    constants: [f32; 4],
    /// Rows of outputs that are no colours.
    pub depth: Option<usize>,
    pub stencil: Option<usize>,
    sample_mask: Option<usize>,
    /// The row of alpha, where it becomes coverage.
    alpha: Option<usize>,
}

impl Output {
    /// Links a program to the attachments of a pass.
    pub fn new(
        tier: TierKind,
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
        let colors = (0..MAX_COLOR_ATTACHMENTS)
            .filter_map(|location| {
                let rows = |index| [0, 1, 2, 3].map(|it| color_row(location, it, index));
                let source = rows(0);
                source.iter().flatten().next()?;
                let attachment = state.color_locations[location] as usize;
                let target = *targets.colors.get(attachment)?.as_ref()?;
                color(&target, state, attachment, source, rows(1))
            })
            .collect();
        Self {
            tier,
            samples: targets.samples,
            colors,
            constants: state.blend.constants,
            depth: row(OutputRow::FragDepth),
            stencil: row(OutputRow::FragStencilRef),
            sample_mask: row(OutputRow::SampleMask),
            alpha: color_row(0, 3, 0).filter(|_| state.multisample.alpha_to_coverage),
        }
    }

    /// Whether fragments lose samples by what the program leaves.
    pub fn drops_samples(&self) -> bool {
        self.sample_mask.is_some() || self.alpha.is_some()
    }

    /// Takes from the masks the samples that the program's sample mask and alpha leave out. `rows`: the program's outputs.
    pub fn drop_samples(&self, rows: &[AlignedRow], masks: &mut [u16; MAX_SAMPLES]) {
        let samples = self.samples;
        if let Some(row) = self.sample_mask {
            let row = &rows[row].0;
            for (sample, mask) in (0..samples).zip(masks.iter_mut()) {
                *mask &= lanes_where(|lane| row[lane] >> sample & 1 != 0);
            }
        }
        if let Some(row) = self.alpha {
            let alpha = floats_of(&rows[row].0);
            for (sample, mask) in (0..samples).zip(masks.iter_mut()) {
                // So many samples as alpha times their number, rounded, the first ones first. A NaN covers none.
                let least = (sample as f32 + 0.5) / samples as f32;
                *mask &= lanes_where(|lane| alpha[lane] >= least);
            }
        }
    }

    /// Texels of fragments that all leave the same outputs: none where they are blended, or lose samples.
    pub fn texels(&self, rows: &[AlignedRow]) -> Option<Texels> {
        let is_plain = |color: &Color| color.blend.is_none();
        if self.drops_samples() || !self.colors.iter().all(is_plain) {
            return None;
        }
        let mut texels = Texels::new();
        for color in &self.colors {
            let source = color.rows(&color.source, rows);
            texels.push(encode_block(color.target.surface.format, &source));
        }
        Some(texels)
    }

    /// Writes such texels.
    ///
    /// # Safety
    /// As [`Self::write`].
    pub unsafe fn write_texels(
        &self,
        texels: &Texels,
        places: &Places,
        masks: &[u16; MAX_SAMPLES],
    ) {
        for (color, words) in self.colors.iter().zip(texels) {
            for (sample, &mask) in (0..self.samples).zip(masks).filter(|(_, mask)| **mask != 0) {
                // SAFETY: the caller's promise.
                unsafe { color.put(places, sample, mask, words) };
            }
        }
    }

    /// Writes the colours of sixteen fragments to the samples of the masks. `rows`: the program's outputs.
    ///
    /// # Safety
    /// As [`load`], for all attachments.
    pub unsafe fn write(&self, rows: &[AlignedRow], places: &Places, masks: &[u16; MAX_SAMPLES]) {
        let samples = || (0..self.samples).zip(masks).filter(|(_, mask)| **mask != 0);
        for color in &self.colors {
            let info = color.target.surface.format;
            let source = color.rows(&color.source, rows);
            let Some(state) = &color.blend else {
                let words = encode_block(info, &source);
                for (sample, &mask) in samples() {
                    // SAFETY: the caller's promise.
                    unsafe { color.put(places, sample, mask, &words) };
                }
                continue;
            };
            let source = source.map(|row| floats_of(&row));
            let second = color.rows(&color.second, rows).map(|row| floats_of(&row));
            for (sample, &mask) in samples() {
                // SAFETY: the caller's promise.
                let old = unsafe { load(&color.target, places, sample, mask) };
                let destination = decode_block(info, &old).map(|row| floats_of(&row));
                let blended = blend(
                    self.tier,
                    state,
                    &self.constants,
                    color.range,
                    &source,
                    &second,
                    &destination,
                );
                let words = encode_block(info, &blended.map(|row| bits_of(&row)));
                // SAFETY: the caller's promise.
                unsafe { color.put_over(places, sample, mask, &words, &old) };
            }
        }
    }
}

fn color(
    target: &Target,
    state: &GraphicsState,
    attachment: usize,
    source: Rows,
    second: Rows,
) -> Option<Color> {
    let blend = &state.blend.attachments[attachment];
    let info = target.surface.format;
    let is_enabled = state.blend.write_enable >> attachment & 1 != 0;
    if !is_enabled || blend.write_mask.is_empty() {
        return None;
    }
    let (mut written, mut writes_all) = ([0u32; 4], true);
    let flags = [
        ColorComponentFlags::R,
        ColorComponentFlags::G,
        ColorComponentFlags::B,
        ColorComponentFlags::A,
    ];
    for (channel, flag) in info.channels.iter().zip(flags) {
        if channel.bits == 0 {
            continue;
        }
        if !blend.write_mask.contains(flag) {
            writes_all = false;
            continue;
        }
        let ones = u64::MAX >> (64 - u32::from(channel.bits)) << (channel.offset % 32);
        for (word, bits) in [ones as u32, (ones >> 32) as u32].into_iter().enumerate() {
            if let Some(place) = written.get_mut(usize::from(channel.offset / 32) + word) {
                *place |= bits;
            }
        }
    }
    let is_float = matches!(info.numeric, Numeric::Sfloat | Numeric::Ufloat);
    let logic_op = state.blend.logic_op;
    Some(Color {
        target: *target,
        source,
        second,
        blend: (blend.enable && logic_op.is_none() && !info.numeric.is_integer()).then_some(*blend),
        range: match info.numeric {
            Numeric::Unorm | Numeric::Srgb => Range::Unorm,
            Numeric::Snorm => Range::Snorm,
            _ => Range::All,
        },
        logic_op: logic_op.filter(|_| !is_float && info.numeric != Numeric::Srgb),
        written,
        writes_all,
        alpha_to_one: state.multisample.alpha_to_one && !info.numeric.is_integer(),
    })
}

impl Color {
    fn rows(&self, places: &Rows, rows: &[AlignedRow]) -> [Row; 4] {
        let mut colors = places.map(|place| place.map_or([0; 16], |place| rows[place].0));
        if self.alpha_to_one {
            colors[3] = [ONE; 16];
        }
        colors
    }

    /// Writes texels that do not depend on what is there, but for masks and logical operations.
    ///
    /// # Safety
    /// As [`load`].
    unsafe fn put(&self, places: &Places, sample: u32, mask: u16, words: &Words) {
        // SAFETY: the caller's promise.
        unsafe {
            if self.writes_all && self.logic_op.is_none() {
                return store(&self.target, places, sample, mask, words);
            }
            let old = load(&self.target, places, sample, mask);
            match self.logic_op {
                None => self.put_over(places, sample, mask, words, &old),
                Some(op) => {
                    let words = operate_words(op, words, &old);
                    self.put_over(places, sample, mask, &words, &old);
                }
            }
        }
    }

    /// Writes the bits that are written; the others stay as they are.
    ///
    /// # Safety
    /// As [`load`].
    unsafe fn put_over(&self, places: &Places, sample: u32, mask: u16, words: &Words, old: &Words) {
        let mut merged = *words;
        if !self.writes_all {
            for (index, row) in merged.iter_mut().enumerate() {
                let bits = self.written[index];
                for lane in 0..16 {
                    row[lane] = row[lane] & bits | old[index][lane] & !bits;
                }
            }
        }
        // SAFETY: the caller's promise.
        unsafe { store(&self.target, places, sample, mask, &merged) };
    }
}
