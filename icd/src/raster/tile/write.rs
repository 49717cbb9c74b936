//! Colours of a wave's fragments, written to one attachment. The loop over the fragments is
//! compiled for each way to code texels, with all of a fragment's steps in it: load, decode, blend,
//! encode, store. Rows, factors and formats are looked up once a wave.

use images::format::layout::Channel;
use images::format::{FormatInfo, Numeric};
use images::texels::{decode_words, encode_words, quotient_of_code};
use lanes::vector::{Task, Vector};
use spirv_jit::program::AlignedRow;

use super::HAS_PORTABLE_LOOPS;
use super::blend::{Over, Range};
use super::color::{Coding, Color, ONE};
use super::lanes::{numbers, words};
use super::output::Output;
use super::pack::Pack;
use super::places::Pattern;
use super::texels::{load_sized, store_sized};

/// The outputs of a wave's subgroups.
#[derive(Clone, Copy)]
pub struct WaveOutputs<'a> {
    /// Rows of states, one state after the other.
    pub states: &'a [AlignedRow],
    /// Rows of one state, and the first of its outputs.
    pub rows: usize,
    pub io: usize,
}

impl<'a> WaveOutputs<'a> {
    /// The outputs of one subgroup.
    #[inline(always)]
    fn of(&self, subgroup: usize) -> &'a [AlignedRow] {
        &self.states[subgroup * self.rows + self.io..]
    }
}

/// Rows of components that the program does not write.
static ZEROS: [AlignedRow; 1] = [AlignedRow([0; 16])];
static ONES: [AlignedRow; 1] = [AlignedRow([ONE; 16])];

/// The rows of one component in all subgroups: the first, and the distance of two.
#[derive(Clone, Copy)]
struct Component<'a> {
    rows: &'a [AlignedRow],
    step: usize,
}

impl<'a> Component<'a> {
    fn new(color: &Color, outputs: &WaveOutputs<'a>, index: usize) -> Self {
        let (rows, step) = match color.source[index] {
            _ if index == 3 && color.alpha_to_one => (&ONES[..], 0),
            Some(place) => (&outputs.of(0)[place..], outputs.rows),
            None => (&ZEROS[..], 0),
        };
        Self { rows, step }
    }

    #[inline(always)]
    fn of<V: Vector>(&self, v: V, subgroup: usize) -> V::F {
        v.load(&self.rows[subgroup * self.step].0)
    }
}

/// A way to code texels, as a type.
trait Code<V: Vector>: Copy {
    /// Components of a texel.
    const COMPONENTS: usize = 4;

    fn size_bytes(self) -> usize;

    /// Whether texels have a component. Others are neither loaded nor blended.
    #[inline(always)]
    fn has(self, component: usize) -> bool {
        component < Self::COMPONENTS
    }

    #[inline(always)]
    fn range(self) -> Range {
        Range::All
    }

    fn decode(self, v: V, texels: &[V::I; 4]) -> [V::F; 4];

    fn encode(self, v: V, colors: &[V::F; 4]) -> [V::I; 4];
}

/// Four normalised bytes; `SWAPPED`: blue comes first.
#[derive(Clone, Copy)]
struct Bytes<const SWAPPED: bool>;

impl<const SWAPPED: bool> Bytes<SWAPPED> {
    #[inline(always)]
    fn order<T: Copy>(components: [T; 4]) -> [T; 4] {
        let [r, g, b, a] = components;
        match SWAPPED {
            true => [b, g, r, a],
            false => [r, g, b, a],
        }
    }
}

#[inline(always)]
fn of_byte<V: Vector>(v: V, texels: V::I, index: u32) -> V::F {
    v.div_units(v.to_f(v.byte(texels, index)), 255.0)
}

#[inline(always)]
fn to_byte<V: Vector>(v: V, number: V::F, index: u32) -> V::I {
    let number = v.min(v.max(number, v.splat(0.0)), v.splat(1.0));
    v.left_i(v.scaled(number, 255.0), 8 * index)
}

impl<V: Vector, const SWAPPED: bool> Code<V> for Bytes<SWAPPED> {
    #[inline(always)]
    fn size_bytes(self) -> usize {
        4
    }

    #[inline(always)]
    fn range(self) -> Range {
        Range::Unorm
    }

    #[inline(always)]
    fn decode(self, v: V, texels: &[V::I; 4]) -> [V::F; 4] {
        Self::order([
            of_byte(v, texels[0], 0),
            of_byte(v, texels[0], 1),
            of_byte(v, texels[0], 2),
            of_byte(v, texels[0], 3),
        ])
    }

    #[inline(always)]
    fn encode(self, v: V, colors: &[V::F; 4]) -> [V::I; 4] {
        let [a, b, c, d] = Self::order(*colors);
        let low = v.or_i(to_byte(v, a, 0), to_byte(v, b, 1));
        let high = v.or_i(to_byte(v, c, 2), to_byte(v, d, 3));
        let none = v.splat_i(0);
        [v.or_i(low, high), none, none, none]
    }
}

/// So many 16-bit floats.
#[derive(Clone, Copy)]
struct Halves<const COUNT: usize>;

/// Two numbers as 16-bit floats in a word, or the first alone.
#[inline(always)]
fn to_halves<V: Vector>(v: V, low: V::F, high: Option<V::F>) -> V::I {
    let low = v.to_half(low);
    match high {
        Some(high) => v.or_i(low, v.left_i(v.to_half(high), 16)),
        None => low,
    }
}

impl<V: Vector, const COUNT: usize> Code<V> for Halves<COUNT> {
    const COMPONENTS: usize = COUNT;

    #[inline(always)]
    fn size_bytes(self) -> usize {
        2 * COUNT
    }

    #[inline(always)]
    fn decode(self, v: V, texels: &[V::I; 4]) -> [V::F; 4] {
        let mut colors = [v.splat(0.0); 4];
        let ones = v.splat_i(0xffff);
        colors[0] = v.half_to_f(v.and_i(texels[0], ones));
        if COUNT > 1 {
            colors[1] = v.half_to_f(v.right_u(texels[0], 16));
        }
        if COUNT > 2 {
            colors[2] = v.half_to_f(v.and_i(texels[1], ones));
            colors[3] = v.half_to_f(v.right_u(texels[1], 16));
        }
        colors
    }

    #[inline(always)]
    fn encode(self, v: V, colors: &[V::F; 4]) -> [V::I; 4] {
        let mut texels = [v.splat_i(0); 4];
        let [r, g, b, a] = *colors;
        texels[0] = to_halves(v, r, (COUNT > 1).then_some(g));
        if COUNT > 2 {
            texels[1] = to_halves(v, b, Some(a));
        }
        texels
    }
}

/// So many words, as they are.
#[derive(Clone, Copy)]
struct Words<const COUNT: usize>;

impl<V: Vector, const COUNT: usize> Code<V> for Words<COUNT> {
    const COMPONENTS: usize = COUNT;

    #[inline(always)]
    fn size_bytes(self) -> usize {
        4 * COUNT
    }

    #[inline(always)]
    fn decode(self, v: V, texels: &[V::I; 4]) -> [V::F; 4] {
        numbers(v, texels)
    }

    #[inline(always)]
    fn encode(self, v: V, colors: &[V::F; 4]) -> [V::I; 4] {
        words(v, colors)
    }
}

/// A component of a format of normalised integers, of up to 16 bits.
#[derive(Clone, Copy, Default)]
struct Field {
    /// 0: there is none.
    bits: u8,
    /// It lies in the texel's second word.
    is_second: bool,
    shift: u32,
    ones: u16,
}

impl Field {
    #[inline(always)]
    fn decode<V: Vector>(&self, v: V, texels: &[V::I; 4]) -> V::F {
        let word = if self.is_second { texels[1] } else { texels[0] };
        let code = v.and_i(v.right_u(word, self.shift), v.splat_i(self.ones.into()));
        quotient_of_code(v, v.to_f(code), self.bits)
    }

    /// Adds the component's code to the texels.
    #[inline(always)]
    fn encode<V: Vector>(&self, v: V, number: V::F, texels: &mut [V::I; 4]) {
        if self.bits == 0 {
            return;
        }
        let number = v.min(v.max(number, v.splat(0.0)), v.splat(1.0));
        let code = v.left_i(v.scaled(number, self.ones.into()), self.shift);
        match self.is_second {
            false => texels[0] = v.or_i(texels[0], code),
            true => texels[1] = v.or_i(texels[1], code),
        }
    }
}

/// Normalised integers in up to two words.
#[derive(Clone, Copy)]
struct Fields {
    size_bytes: usize,
    fields: [Field; 4],
}

impl Fields {
    /// Of a format that is such.
    fn of(info: &FormatInfo) -> Option<Self> {
        let fits = |channel: &Channel| {
            channel.bits <= 16 && channel.offset % 32 + channel.bits <= 32 && channel.offset < 64
        };
        let is_such = info.numeric == Numeric::Unorm && info.channels.iter().all(fits);
        (is_such && matches!(info.size_bytes, 1 | 2 | 4 | 8)).then(|| Self {
            size_bytes: info.size_bytes.into(),
            fields: info.channels.map(|channel| Field {
                bits: channel.bits,
                is_second: channel.offset >= 32,
                shift: u32::from(channel.offset % 32),
                ones: ((1u32 << channel.bits) - 1) as u16,
            }),
        })
    }
}

impl<V: Vector> Code<V> for Fields {
    #[inline(always)]
    fn size_bytes(self) -> usize {
        self.size_bytes
    }

    #[inline(always)]
    fn has(self, component: usize) -> bool {
        self.fields[component].bits != 0
    }

    #[inline(always)]
    fn range(self) -> Range {
        Range::Unorm
    }

    #[inline(always)]
    fn decode(self, v: V, texels: &[V::I; 4]) -> [V::F; 4] {
        let mut colors = [v.splat(0.0); 4];
        let [r, g, b, a] = &self.fields;
        // One by one: a loop would keep them in memory.
        if r.bits != 0 {
            colors[0] = r.decode(v, texels);
        }
        if g.bits != 0 {
            colors[1] = g.decode(v, texels);
        }
        if b.bits != 0 {
            colors[2] = b.decode(v, texels);
        }
        if a.bits != 0 {
            colors[3] = a.decode(v, texels);
        }
        colors
    }

    #[inline(always)]
    fn encode(self, v: V, colors: &[V::F; 4]) -> [V::I; 4] {
        let mut texels = [v.splat_i(0); 4];
        let [r, g, b, a] = &self.fields;
        r.encode(v, colors[0], &mut texels);
        g.encode(v, colors[1], &mut texels);
        b.encode(v, colors[2], &mut texels);
        a.encode(v, colors[3], &mut texels);
        texels
    }
}

/// Any format, by the codec that shaders have, too.
#[derive(Clone, Copy)]
struct Any<'a> {
    info: &'a FormatInfo,
    range: Range,
}

impl<V: Vector> Code<V> for Any<'_> {
    #[inline(always)]
    fn size_bytes(self) -> usize {
        self.info.size_bytes.into()
    }

    #[inline(always)]
    fn has(self, component: usize) -> bool {
        self.info.channels[component].bits != 0
    }

    #[inline(always)]
    fn range(self) -> Range {
        self.range
    }

    #[inline(always)]
    fn decode(self, v: V, texels: &[V::I; 4]) -> [V::F; 4] {
        numbers(v, &decode_words(v, self.info, texels))
    }

    #[inline(always)]
    fn encode(self, v: V, colors: &[V::F; 4]) -> [V::I; 4] {
        encode_words(v, self.info, &words(v, colors))
    }
}

/// Fragments of one sample to write, as they are or laid over stored ones.
struct Writing<'a, C> {
    color: &'a Color,
    code: C,
    over: Option<Over>,
    packs: &'a [Pack],
    outputs: WaveOutputs<'a>,
}

impl<V: Vector, C: Code<V>> Task<V> for Writing<'_, C> {
    type Output = ();

    /// # Safety
    /// As [`Color::write_wave`].
    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Self {
            color,
            code,
            over,
            packs,
            outputs,
        } = self;
        let (target, size) = (&color.target, code.size_bytes());
        let components = [
            Component::new(color, &outputs, 0),
            Component::new(color, &outputs, 1),
            Component::new(color, &outputs, 2),
            Component::new(color, &outputs, 3),
        ];
        for (index, pack) in packs.iter().enumerate() {
            let (places, mut mask) = (&pack.places, pack.masks[0]);
            if mask == 0 {
                continue;
            }
            let mut source = [v.splat(0.0); 4];
            // One by one: a loop would keep them in memory.
            if code.has(0) {
                source[0] = components[0].of(v, index);
            }
            if code.has(1) {
                source[1] = components[1].of(v, index);
            }
            if code.has(2) {
                source[2] = components[2].of(v, index);
            }
            if code.has(3) || over.is_some() {
                source[3] = components[3].of(v, index);
            }
            let Some(over) = over else {
                let texels = code.encode(v, &source);
                // SAFETY: the caller keeps the contract of `load`.
                unsafe { store_sized(v, target, places, 0, mask, &texels, size) };
                continue;
            };
            // SAFETY: the caller keeps the contract of `load`.
            let old = unsafe { load_sized(v, target, places, 0, mask, size) };
            let below = code.decode(v, &old);
            let laid = over.with_alpha(v, code.range(), source[3]);
            if code.has(0) {
                source[0] = laid.over(v, 0, source[0], below[0]);
            }
            if code.has(1) {
                source[1] = laid.over(v, 1, source[1], below[1]);
            }
            if code.has(2) {
                source[2] = laid.over(v, 2, source[2], below[2]);
            }
            if code.has(3) {
                source[3] = laid.over(v, 3, source[3], below[3]);
            }
            let mut new = color.merged(v, code.encode(v, &source), &old);
            if mask != u16::MAX && matches!(places.pattern, Pattern::Row | Pattern::Block) {
                // The old texels are known already.
                new = [
                    v.select(mask, new[0], old[0]),
                    v.select(mask, new[1], old[1]),
                    v.select(mask, new[2], old[2]),
                    v.select(mask, new[3], old[3]),
                ];
                mask = u16::MAX;
            }
            // SAFETY: the caller keeps the contract of `load`.
            unsafe { store_sized(v, target, places, 0, mask, &new, size) };
        }
    }
}

/// Fragments of any number of samples, and of any blending.
struct WritingSamples<'a> {
    output: &'a Output,
    color: &'a Color,
    packs: &'a [Pack],
    outputs: WaveOutputs<'a>,
}

impl<V: Vector> Task<V> for WritingSamples<'_> {
    type Output = ();

    /// # Safety
    /// As [`Color::write_wave`].
    #[inline(always)]
    unsafe fn run(self, v: V) {
        let color = self.color;
        for (index, pack) in self.packs.iter().enumerate() {
            let rows = self.outputs.of(index);
            let source = color.rows(v, &color.source, rows);
            let second = match color.has_second {
                true => color.rows(v, &color.second, rows),
                false => source,
            };
            let (places, masks) = (&pack.places, &pack.masks);
            // SAFETY: the caller keeps the contract of `load`.
            unsafe { (self.output).write_color(v, color, &source, &second, places, masks) };
        }
    }
}

impl Color {
    /// Writes the colours of a wave's fragments.
    ///
    /// # Safety
    /// As [`load`](super::texels::load), for the pixels and samples of the packs' masks.
    #[inline(always)]
    pub unsafe fn write_wave<V: Vector>(
        &self,
        v: V,
        output: &Output,
        packs: &[Pack],
        outputs: WaveOutputs<'_>,
    ) {
        let over = self.over.filter(|_| self.blend.is_some());
        let is_replaced = self.blend.is_none() && self.writes_all && self.logic_op.is_none();
        // SAFETY: the caller keeps the contract of `load`.
        unsafe {
            if output.samples != 1 || !(over.is_some() || is_replaced) {
                return v.apart(WritingSamples {
                    output,
                    color: self,
                    packs,
                    outputs,
                });
            }
            let all = (over, packs, outputs);
            let (info, range) = (self.target.surface.format, self.range);
            if !V::IS_MACHINES && !HAS_PORTABLE_LOOPS {
                return self.write_as(v, Any { info, range }, all);
            }
            match self.coding {
                Coding::Bytes([0, 8, 16, 24]) => self.write_as(v, Bytes::<false>, all),
                Coding::Bytes([16, 8, 0, 24]) => self.write_as(v, Bytes::<true>, all),
                Coding::Halves(1) => self.write_as(v, Halves::<1>, all),
                Coding::Halves(2) => self.write_as(v, Halves::<2>, all),
                Coding::Halves(4) => self.write_as(v, Halves::<4>, all),
                Coding::Words(1) => self.write_as(v, Words::<1>, all),
                Coding::Words(2) => self.write_as(v, Words::<2>, all),
                Coding::Words(4) => self.write_as(v, Words::<4>, all),
                _ => match Fields::of(info) {
                    Some(fields) => self.write_as(v, fields, all),
                    None => self.write_as(v, Any { info, range }, all),
                },
            }
        }
    }

    /// [`Self::write_wave`], by a code.
    ///
    /// # Safety
    /// As there.
    #[inline(always)]
    unsafe fn write_as<'a, V: Vector, C: Code<V>>(
        &self,
        v: V,
        code: C,
        (over, packs, outputs): (Option<Over>, &[Pack], WaveOutputs<'a>),
    ) {
        // SAFETY: the caller keeps the contract of `load`.
        unsafe {
            v.apart(Writing {
                color: self,
                code,
                over,
                packs,
                outputs,
            });
        }
    }
}
