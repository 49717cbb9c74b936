//! A colour attachment that a draw writes: how colours become its texels, sixteen pixels at a time.

use ash::vk::{BlendFactor, ColorComponentFlags, LogicOp};
use images::format::{FormatInfo, Numeric};
use images::texels::{decode_words, encode_words};
use lanes::Tier;
use lanes::vector::Vector;
use spirv_jit::program::AlignedRow;

use super::advanced::blend_advanced;
use super::blend::{Over, Range, operate_words};
use super::lanes::{load_words, numbers, rows_of, words};
use super::places::{Places, TexelWords};
use super::texels::{load, load_word, store, store_word};
use crate::object::graphics_state::{BlendAttachment, GraphicsState};
use crate::raster::Target;

/// Bits of 1.0.
pub(super) const ONE: u32 = 0x3f80_0000;

/// Factors that ask for the second colour of a fragment.
const SECOND: [BlendFactor; 4] = [
    BlendFactor::SRC1_COLOR,
    BlendFactor::ONE_MINUS_SRC1_COLOR,
    BlendFactor::SRC1_ALPHA,
    BlendFactor::ONE_MINUS_SRC1_ALPHA,
];

/// Output rows of a colour, by component; none for components that the program does not write.
pub type ComponentRows = [Option<usize>; 4];

/// How colours become texels.
#[derive(Clone, Copy)]
pub(super) enum Coding {
    /// Four normalised bytes: bits to shift.
    Bytes([u32; 4]),
    /// So many 16-bit floats.
    Halves(usize),
    /// So many words, as they are.
    Words(usize),
    /// By functions of their own, whatever the format is.
    Other,
}

/// Four normalised bytes that are written as a whole, as they come or laid over what is there: the
/// commonest attachment. Arrays are in the order of the bytes.
#[derive(Clone, Copy)]
pub(super) struct Bytes {
    /// The colour's component that each byte is.
    components: [usize; 4],
    /// For source-over blending: the bytes that are multiplied with alpha first.
    over: Option<[bool; 4]>,
}

/// A colour attachment that a draw writes to.
pub struct Color {
    tier: Tier,
    pub target: Target,
    pub source: ComponentRows,
    pub second: ComponentRows,
    /// Factors of blending ask for the second colour.
    pub has_second: bool,
    pub(super) blend: Option<BlendAttachment>,
    pub(super) over: Option<Over>,
    pub(super) bytes: Option<Bytes>,
    pub(super) coding: Coding,
    pub(super) range: Range,
    pub(super) logic_op: Option<LogicOp>,
    /// By word of a texel: bits that are written.
    written: [u32; 4],
    /// Those are all.
    pub(super) writes_all: bool,
    pub(super) alpha_to_one: bool,
}

lanes::vectors! {
    fn encode_rows<V>(v, info: &FormatInfo, rows: &TexelWords) -> TexelWords {
        rows_of(v, &encode_words(v, info, &load_words(v, rows)))
    }
}

lanes::vectors! {
    fn decode_rows<V>(v, info: &FormatInfo, rows: &TexelWords) -> TexelWords {
        rows_of(v, &decode_words(v, info, &load_words(v, rows)))
    }
}

fn coding_of(info: &FormatInfo) -> Coding {
    let count = info.component_count();
    let in_order = |bits: u8| {
        (info.channels[..count].iter().zip(0..))
            .all(|(channel, at)| channel.bits == bits && channel.offset == at * bits)
    };
    let are_bytes = info.channels.iter().all(|channel| channel.bits == 8);
    if info.numeric == Numeric::Unorm && info.size_bytes == 4 && are_bytes {
        Coding::Bytes(info.channels.map(|channel| channel.offset.into()))
    } else if info.numeric == Numeric::Sfloat && in_order(16) {
        Coding::Halves(count)
    } else if in_order(32) && usize::from(info.size_bytes) == 4 * count {
        Coding::Words(count)
    } else {
        Coding::Other
    }
}

impl Bytes {
    /// Components of colours in the order of the bytes.
    #[inline(always)]
    fn order<F: Copy>(&self, components: &[F; 4]) -> [F; 4] {
        let [r, g, b, a] = *components;
        match self.components {
            [0, 1, 2, 3] => [r, g, b, a],
            [2, 1, 0, 3] => [b, g, r, a],
            order => order.map(|component| components[component % 4]),
        }
    }
}

/// If an attachment is such.
fn bytes_of(coding: Coding, color: &Color) -> Option<Bytes> {
    let Coding::Bytes(shifts) = coding else {
        return None;
    };
    let mut components = [0; 4];
    for (component, shift) in shifts.into_iter().enumerate() {
        components[shift as usize / 8 % 4] = component;
    }
    let over = match (&color.blend, color.over) {
        (None, _) => None,
        (Some(_), Some(over)) => Some(components.map(|it| over.times_alpha(it))),
        _ => return None,
    };
    (color.writes_all && color.logic_op.is_none()).then_some(Bytes { components, over })
}

/// Color `attachment` of a pass as a draw writes it; none where it does not.
pub(super) fn color(
    tier: Tier,
    target: &Target,
    state: &GraphicsState,
    attachment: usize,
    source: ComponentRows,
    second: ComponentRows,
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
    let factors = [
        blend.src_color,
        blend.dst_color,
        blend.src_alpha,
        blend.dst_alpha,
    ];
    let range = match info.numeric {
        Numeric::Unorm | Numeric::Srgb => Range::Unorm,
        Numeric::Snorm => Range::Snorm,
        _ => Range::All,
    };
    let mut color = Color {
        tier,
        bytes: None,
        has_second: blend.enable && factors.iter().any(|factor| SECOND.contains(factor)),
        coding: coding_of(info),
        target: *target,
        source,
        second,
        blend: (blend.enable && logic_op.is_none() && !info.numeric.is_integer()).then_some(*blend),
        over: Over::new(blend, range),
        range,
        logic_op: logic_op.filter(|_| !is_float && info.numeric != Numeric::Srgb),
        written,
        writes_all,
        alpha_to_one: state.multisample.alpha_to_one && !info.numeric.is_integer(),
    };
    color.bytes = bytes_of(color.coding, &color);
    Some(color)
}

/// A number of 0 to 1 as the byte of that index.
#[inline(always)]
fn to_byte<V: Vector>(v: V, number: V::F, index: u32) -> V::I {
    let number = v.min(v.max(number, v.splat(0.0)), v.splat(1.0));
    v.left_i(v.scaled(number, 255.0), 8 * index)
}

/// Four numbers as bytes.
#[inline(always)]
fn to_bytes<V: Vector>(v: V, numbers: [V::F; 4]) -> V::I {
    let low = v.or_i(to_byte(v, numbers[0], 0), to_byte(v, numbers[1], 1));
    let high = v.or_i(to_byte(v, numbers[2], 2), to_byte(v, numbers[3], 3));
    v.or_i(low, high)
}

/// Sixteen colours of source-over blending, in the order of their bytes.
#[derive(Clone, Copy)]
pub struct SourceOver<V: Vector> {
    /// The addends.
    parts: [V::F; 4],
    /// The factor of the stored colour.
    rest: V::F,
}

impl<V: Vector> SourceOver<V> {
    /// As [`Over`] has it; `source` are the components in the order of the bytes.
    #[inline(always)]
    fn new(v: V, source: [V::F; 4], alpha: V::F, times_alpha: [bool; 4]) -> Self {
        let (none, one) = (v.splat(0.0), v.splat(1.0));
        let mut parts = [
            v.min(v.max(source[0], none), one),
            v.min(v.max(source[1], none), one),
            v.min(v.max(source[2], none), one),
            v.min(v.max(source[3], none), one),
        ];
        let alpha = v.min(v.max(alpha, none), one);
        for index in 0..4 {
            if times_alpha[index] {
                parts[index] = v.mul(parts[index], alpha);
            }
        }
        let rest = v.min(v.max(v.sub(one, alpha), none), one);
        Self { parts, rest }
    }

    /// Lays it over texels.
    #[inline(always)]
    pub fn over(&self, v: V, texels: V::I) -> V::I {
        to_bytes(
            v,
            [
                self.byte(v, texels, 0),
                self.byte(v, texels, 1),
                self.byte(v, texels, 2),
                self.byte(v, texels, 3),
            ],
        )
    }

    #[inline(always)]
    fn byte(&self, v: V, texels: V::I, index: u32) -> V::F {
        let below = v.div_units(v.to_f(v.byte(texels, index)), 255.0);
        v.add(self.parts[index as usize], v.mul(below, self.rest))
    }
}

/// A normalised component as a byte, where it lies in its word.
#[inline(always)]
fn byte<V: Vector>(v: V, component: V::I, shift: u32) -> V::I {
    let number = v.bits_to_f(component);
    let number = v.min(v.max(number, v.splat(0.0)), v.splat(1.0));
    v.left_i(v.scaled(number, 255.0), shift)
}

/// The component of such a byte.
#[inline(always)]
fn of_byte<V: Vector>(v: V, word: V::I, shift: u32) -> V::I {
    let code = v.and_i(v.right_u(word, shift), v.splat_i(0xff));
    v.bits_of(v.div_units(v.to_f(code), 255.0))
}

/// Components of which the format has the first ones.
#[inline(always)]
fn with_missing<V: Vector>(
    v: V,
    info: &FormatInfo,
    mut components: [V::I; 4],
    count: usize,
) -> [V::I; 4] {
    for component in count..4 {
        components[component] = v.splat_i(info.missing(component) as i32);
    }
    components
}

/// A row of a program's outputs; zeros if the program does not write it.
#[inline(always)]
fn component<V: Vector>(v: V, place: Option<usize>, rows: &[AlignedRow]) -> V::I {
    match place {
        Some(place) => v.load_i(&rows[place].0),
        None => v.splat_i(0),
    }
}

impl Color {
    /// The distance of neighbouring numbers in the attachment, 0 if it has floats.
    fn step(&self) -> f32 {
        let bits = u32::from(self.target.surface.format.channels[0].bits);
        match self.range {
            Range::All => 0.0,
            Range::Unorm => 1.0 / ((1u64 << bits) - 1) as f32,
            Range::Snorm => 1.0 / ((1u64 << (bits.max(2) - 1)) - 1) as f32,
        }
    }

    /// Blends by an advanced operation, in a function of its own.
    #[inline(always)]
    pub fn blend_advanced<V: Vector>(
        &self,
        v: V,
        state: &BlendAttachment,
        source: &[V::F; 4],
        destination: &[V::F; 4],
    ) -> [V::F; 4] {
        let (source, destination) = (words(v, source), words(v, destination));
        let (source, destination) = (rows_of(v, &source), rows_of(v, &destination));
        let blended = blend_advanced(
            self.tier,
            state,
            self.range,
            self.step(),
            &source,
            &destination,
        );
        numbers(v, &load_words(v, &blended))
    }

    #[inline(always)]
    pub(super) fn rows<V: Vector>(
        &self,
        v: V,
        places: &ComponentRows,
        rows: &[AlignedRow],
    ) -> [V::I; 4] {
        // One by one: a loop would keep them in memory.
        let colors = [
            component(v, places[0], rows),
            component(v, places[1], rows),
            component(v, places[2], rows),
            component(v, places[3], rows),
        ];
        self.with_alpha(v, colors)
    }

    /// Colours with the alpha that is written.
    #[inline(always)]
    pub fn with_alpha<V: Vector>(&self, v: V, colors: [V::I; 4]) -> [V::I; 4] {
        let mut colors = colors;
        if self.alpha_to_one {
            colors[3] = v.splat_i(ONE as i32);
        }
        colors
    }

    /// Texels' words.
    #[inline(always)]
    pub fn encode<V: Vector>(&self, v: V, colors: &[V::I; 4]) -> [V::I; 4] {
        let none = v.splat_i(0);
        match &self.coding {
            Coding::Bytes(shifts) => {
                let [r, g, b, a] = [
                    byte(v, colors[0], shifts[0]),
                    byte(v, colors[1], shifts[1]),
                    byte(v, colors[2], shifts[2]),
                    byte(v, colors[3], shifts[3]),
                ];
                [v.or_i(v.or_i(r, g), v.or_i(b, a)), none, none, none]
            }
            Coding::Halves(_) => {
                let [r, g, b, a] = [
                    v.to_half(v.bits_to_f(colors[0])),
                    v.to_half(v.bits_to_f(colors[1])),
                    v.to_half(v.bits_to_f(colors[2])),
                    v.to_half(v.bits_to_f(colors[3])),
                ];
                let first = v.or_i(r, v.left_i(g, 16));
                [first, v.or_i(b, v.left_i(a, 16)), none, none]
            }
            // Of words that the format lacks nothing is stored.
            Coding::Words(_) => *colors,
            Coding::Other => {
                let info = self.target.surface.format;
                load_words(v, &encode_rows(self.tier, info, &rows_of(v, colors)))
            }
        }
    }

    /// Colours of texels' words.
    #[inline(always)]
    pub(super) fn decode<V: Vector>(&self, v: V, texels: &[V::I; 4]) -> [V::I; 4] {
        let info = self.target.surface.format;
        match &self.coding {
            Coding::Bytes(shifts) => [
                of_byte(v, texels[0], shifts[0]),
                of_byte(v, texels[0], shifts[1]),
                of_byte(v, texels[0], shifts[2]),
                of_byte(v, texels[0], shifts[3]),
            ],
            Coding::Halves(count) => {
                let low = v.splat_i(0xffff);
                let halves = [
                    v.bits_of(v.half_to_f(v.and_i(texels[0], low))),
                    v.bits_of(v.half_to_f(v.right_u(texels[0], 16))),
                    v.bits_of(v.half_to_f(v.and_i(texels[1], low))),
                    v.bits_of(v.half_to_f(v.right_u(texels[1], 16))),
                ];
                with_missing(v, info, halves, *count)
            }
            Coding::Words(count) => with_missing(v, info, *texels, *count),
            Coding::Other => load_words(v, &decode_rows(self.tier, info, &rows_of(v, texels))),
        }
    }

    /// The blend of one colour over the attachment, if blending is of that kind: components of a
    /// colour.
    #[inline(always)]
    pub fn source_over<V: Vector>(&self, v: V, source: [V::I; 4]) -> Option<SourceOver<V>> {
        let bytes = self.bytes?;
        let source = numbers(v, &self.with_alpha(v, source));
        Some(SourceOver::new(
            v,
            bytes.order(&source),
            source[3],
            bytes.over?,
        ))
    }

    /// Writes colours of the only sample if the attachment has byte components. Returns false, and
    /// writes nothing, for others.
    ///
    /// # Safety
    /// As [`load`].
    #[inline(always)]
    pub unsafe fn put_colors<V: Vector>(
        &self,
        v: V,
        source: [V::I; 4],
        places: &Places,
        mask: u16,
    ) -> bool {
        let Some(bytes) = &self.bytes else {
            return false;
        };
        let source = numbers(v, &self.with_alpha(v, source));
        let ordered = bytes.order(&source);
        // SAFETY: the caller keeps the contract of `load`.
        unsafe {
            let texels = match bytes.over {
                None => to_bytes(v, ordered),
                Some(times_alpha) => {
                    let old = load_word(v, &self.target, places, 0, mask);
                    SourceOver::new(v, ordered, source[3], times_alpha).over(v, old)
                }
            };
            store_word(v, &self.target, places, 0, mask, texels);
        }
        true
    }

    /// Writes texels that do not depend on the stored ones, except by masks and logic operations.
    ///
    /// # Safety
    /// As [`load`].
    #[inline(always)]
    pub(super) unsafe fn put<V: Vector>(
        &self,
        v: V,
        places: &Places,
        sample: u32,
        mask: u16,
        words: &[V::I; 4],
    ) {
        // SAFETY: the caller keeps the contract of `load`.
        unsafe {
            if self.writes_all && self.logic_op.is_none() {
                return store(v, &self.target, places, sample, mask, words);
            }
            let old = load(v, &self.target, places, sample, mask);
            let mut words = *words;
            if let Some(op) = self.logic_op {
                let operated = operate_words(op, &rows_of(v, &words), &rows_of(v, &old));
                words = load_words(v, &operated);
            }
            self.put_over(v, places, sample, mask, &words, &old);
        }
    }

    /// Writes the bits that are written; the others stay as they are.
    ///
    /// # Safety
    /// As [`load`].
    #[inline(always)]
    pub(super) unsafe fn put_over<V: Vector>(
        &self,
        v: V,
        places: &Places,
        sample: u32,
        mask: u16,
        words: &[V::I; 4],
        old: &[V::I; 4],
    ) {
        let merged = self.merged(v, *words, old);
        // SAFETY: the caller keeps the contract of `load`.
        unsafe { store(v, &self.target, places, sample, mask, &merged) };
    }

    /// The words with the bits of the old ones that are not written.
    #[inline(always)]
    pub(super) fn merged<V: Vector>(&self, v: V, words: [V::I; 4], old: &[V::I; 4]) -> [V::I; 4] {
        let mut merged = words;
        if !self.writes_all {
            for index in 0..4 {
                let changed = v.xor_i(words[index], old[index]);
                let written = v.splat_i(self.written[index] as i32);
                merged[index] = v.xor_i(old[index], v.and_i(changed, written));
            }
        }
        merged
    }
}
