//! Blending and logical operations of sixteen colours (spec, "The Framebuffer").

use ash::vk::{BlendFactor, BlendOp, LogicOp};
use lanes::vector::Vector;

use super::places::TexelWords;
use crate::object::graphics_state::BlendAttachment;

/// The numbers of a fixed-point format, to which everything is clamped before blending.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// 0 to 1.
    Unorm,
    /// −1 to 1.
    Snorm,
    /// All: floats.
    All,
}

impl Range {
    /// Clamps numbers. NaN becomes the least one.
    #[inline(always)]
    pub(super) fn clamp<V: Vector>(self, v: V, numbers: V::F) -> V::F {
        let least = match self {
            Range::All => return numbers,
            Range::Unorm => 0.0,
            Range::Snorm => -1.0,
        };
        v.min(v.max(numbers, v.splat(least)), v.splat(1.0))
    }

    #[inline(always)]
    pub(super) fn clamp_colors<V: Vector>(self, v: V, colors: &[V::F; 4]) -> [V::F; 4] {
        [
            self.clamp(v, colors[0]),
            self.clamp(v, colors[1]),
            self.clamp(v, colors[2]),
            self.clamp(v, colors[3]),
        ]
    }
}

/// The inputs of blend factors.
struct Sources<'a, V: Vector> {
    v: V,
    source: [V::F; 4],
    /// Not clamped: few need it.
    second: &'a [V::F; 4],
    destination: &'a [V::F; 4],
    constants: &'a [f32; 4],
    range: Range,
}

impl<V: Vector> Sources<'_, V> {
    #[inline(always)]
    fn complement(&self, numbers: V::F) -> V::F {
        let v = self.v;
        self.range.clamp(v, v.sub(v.splat(1.0), numbers))
    }

    #[inline(always)]
    fn second(&self, component: usize) -> V::F {
        self.range.clamp(self.v, self.second[component])
    }

    #[inline(always)]
    fn constant(&self, component: usize) -> V::F {
        let v = self.v;
        self.range.clamp(v, v.splat(self.constants[component]))
    }

    /// A component times its factor. A factor of zero gives zero, whatever the number is.
    #[inline(always)]
    fn product(&self, numbers: V::F, factor: BlendFactor, component: usize) -> V::F {
        use BlendFactor as Factor;
        let v = self.v;
        let factors = match factor {
            Factor::ONE => return numbers,
            Factor::SRC_COLOR => self.source[component],
            Factor::ONE_MINUS_SRC_COLOR => self.complement(self.source[component]),
            Factor::DST_COLOR => self.destination[component],
            Factor::ONE_MINUS_DST_COLOR => self.complement(self.destination[component]),
            Factor::SRC_ALPHA => self.source[3],
            Factor::ONE_MINUS_SRC_ALPHA => self.complement(self.source[3]),
            Factor::DST_ALPHA => self.destination[3],
            Factor::ONE_MINUS_DST_ALPHA => self.complement(self.destination[3]),
            Factor::CONSTANT_COLOR => self.constant(component),
            Factor::ONE_MINUS_CONSTANT_COLOR => self.complement(self.constant(component)),
            Factor::CONSTANT_ALPHA => self.constant(3),
            Factor::ONE_MINUS_CONSTANT_ALPHA => self.complement(self.constant(3)),
            Factor::SRC_ALPHA_SATURATE if component == 3 => return numbers,
            Factor::SRC_ALPHA_SATURATE => {
                v.min(self.complement(self.destination[3]), self.source[3])
            }
            Factor::SRC1_COLOR => self.second(component),
            Factor::ONE_MINUS_SRC1_COLOR => self.complement(self.second(component)),
            Factor::SRC1_ALPHA => self.second(3),
            Factor::ONE_MINUS_SRC1_ALPHA => self.complement(self.second(3)),
            _ => return v.splat(0.0),
        };
        v.mul(numbers, factors)
    }

    #[inline(always)]
    fn blend(
        &self,
        op: BlendOp,
        source_factor: BlendFactor,
        destination_factor: BlendFactor,
        component: usize,
    ) -> V::F {
        let v = self.v;
        let (source, destination) = (self.source[component], self.destination[component]);
        match op {
            BlendOp::MIN => return v.min(destination, source),
            BlendOp::MAX => return v.max(destination, source),
            _ => {}
        }
        let source = self.product(source, source_factor, component);
        let destination = self.product(destination, destination_factor, component);
        match op {
            BlendOp::SUBTRACT => v.sub(source, destination),
            BlendOp::REVERSE_SUBTRACT => v.sub(destination, source),
            _ => v.add(source, destination),
        }
    }
}

/// The commonest way to blend colours: the stored colour keeps the rest of the source's alpha, and
/// the two are added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Over {
    range: Range,
    /// The source's components, and its alpha, are multiplied with its alpha first.
    times_alpha: [bool; 2],
}

impl Over {
    /// If a state says that.
    pub fn new(state: &BlendAttachment, range: Range) -> Option<Self> {
        let adds = state.color_op == BlendOp::ADD && state.alpha_op == BlendOp::ADD;
        let keeps_rest =
            [state.dst_color, state.dst_alpha] == [BlendFactor::ONE_MINUS_SRC_ALPHA; 2];
        let factors = [state.src_color, state.src_alpha];
        let is_known = (factors.iter())
            .all(|factor| [BlendFactor::ONE, BlendFactor::SRC_ALPHA].contains(factor));
        let times_alpha = factors.map(|factor| factor == BlendFactor::SRC_ALPHA);
        (adds && keeps_rest && is_known).then_some(Self { range, times_alpha })
    }

    /// Whether a component is multiplied with the source's alpha.
    #[inline(always)]
    pub fn times_alpha(self, component: usize) -> bool {
        self.times_alpha[usize::from(component == 3)]
    }

    /// The blend over stored colours of a source with that alpha, in a format of a range.
    #[inline(always)]
    pub fn with_alpha<V: Vector>(self, v: V, range: Range, alpha: V::F) -> Laid<V> {
        let alpha = range.clamp(v, alpha);
        Laid {
            over: self,
            range,
            alpha,
            rest: range.clamp(v, v.sub(v.splat(1.0), alpha)),
        }
    }

    /// As [`blend`].
    #[inline(always)]
    pub fn blend<V: Vector>(self, v: V, source: &[V::F; 4], destination: &[V::F; 4]) -> [V::F; 4] {
        let laid = self.with_alpha(v, self.range, source[3]);
        [
            laid.over(v, 0, source[0], destination[0]),
            laid.over(v, 1, source[1], destination[1]),
            laid.over(v, 2, source[2], destination[2]),
            laid.over(v, 3, source[3], destination[3]),
        ]
    }
}

/// [`Over`] with the source's alpha.
#[derive(Clone, Copy)]
pub struct Laid<V: Vector> {
    over: Over,
    range: Range,
    alpha: V::F,
    /// The factor of the stored colour.
    rest: V::F,
}

impl<V: Vector> Laid<V> {
    /// Blends one component.
    #[inline(always)]
    pub fn over(&self, v: V, component: usize, source: V::F, destination: V::F) -> V::F {
        let mut source = self.range.clamp(v, source);
        if self.over.times_alpha(component) {
            source = v.mul(source, self.alpha);
        }
        v.add(source, v.mul(destination, self.rest))
    }
}

/// Blends colours. Inputs are clamped to the format's range, results are not.
#[inline(always)]
pub fn blend<V: Vector>(
    v: V,
    state: &BlendAttachment,
    constants: &[f32; 4],
    range: Range,
    source: &[V::F; 4],
    second: &[V::F; 4],
    destination: &[V::F; 4],
) -> [V::F; 4] {
    let sources = Sources {
        v,
        source: range.clamp_colors(v, source),
        second,
        destination,
        constants,
        range,
    };
    // No closure: it would not be compiled for the vectors.
    let (op, source, destination) = (state.color_op, state.src_color, state.dst_color);
    [
        sources.blend(op, source, destination, 0),
        sources.blend(op, source, destination, 1),
        sources.blend(op, source, destination, 2),
        sources.blend(state.alpha_op, state.src_alpha, state.dst_alpha, 3),
    ]
}

/// A logical operation on the texels' bits.
pub fn operate(op: LogicOp, source: u32, destination: u32) -> u32 {
    let (s, d) = (source, destination);
    match op {
        LogicOp::CLEAR => 0,
        LogicOp::AND => s & d,
        LogicOp::AND_REVERSE => s & !d,
        LogicOp::AND_INVERTED => !s & d,
        LogicOp::NO_OP => d,
        LogicOp::XOR => s ^ d,
        LogicOp::OR => s | d,
        LogicOp::NOR => !(s | d),
        LogicOp::EQUIVALENT => !(s ^ d),
        LogicOp::INVERT => !d,
        LogicOp::OR_REVERSE => s | !d,
        LogicOp::COPY_INVERTED => !s,
        LogicOp::OR_INVERTED => !s | d,
        LogicOp::NAND => !(s & d),
        LogicOp::SET => !0,
        _ => s,
    }
}

/// A logical operation on texels' words.
pub fn operate_words(op: LogicOp, source: &TexelWords, destination: &TexelWords) -> TexelWords {
    let mut words = *source;
    for (row, destination) in words.iter_mut().zip(destination) {
        for (word, destination) in row.iter_mut().zip(destination) {
            *word = operate(op, *word, *destination);
        }
    }
    words
}
