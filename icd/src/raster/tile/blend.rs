//! Blending and logical operations of sixteen colours (spec, "The Framebuffer").

use ash::vk::{BlendFactor, BlendOp, LogicOp};

use super::lanes::{Floats, tiered};
use super::texels::Words;
use crate::object::graphics_state::BlendAttachment;

/// R, G, B, A.
pub type Colors = [Floats; 4];

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
    #[inline(always)]
    fn clamp(self, number: f32) -> f32 {
        let least = match self {
            Range::All => return number,
            Range::Unorm => 0.0,
            Range::Snorm => -1.0,
        };
        let number = if number > least { number } else { least };
        if number < 1.0 { number } else { 1.0 }
    }

    /// Clamps colours. NaN becomes the least number.
    #[inline(always)]
    pub fn clamp_colors(self, colors: &Colors) -> Colors {
        let mut clamped = *colors;
        if self != Range::All {
            for row in &mut clamped {
                for number in row {
                    *number = self.clamp(*number);
                }
            }
        }
        clamped
    }
}

/// What factors are made of.
struct Sources<'a> {
    source: &'a Colors,
    second: &'a Colors,
    destination: &'a Colors,
    constants: [f32; 4],
    range: Range,
}

impl Sources<'_> {
    #[inline(always)]
    fn complement(&self, row: &Floats) -> Floats {
        let mut complement = [0.0; 16];
        for lane in 0..16 {
            complement[lane] = self.range.clamp(1.0 - row[lane]);
        }
        complement
    }

    /// A component's factor; none for one.
    #[inline(always)]
    fn factor(&self, factor: BlendFactor, component: usize) -> Option<Floats> {
        use BlendFactor as Factor;
        let Sources {
            source,
            second,
            destination,
            ..
        } = self;
        let constant = |component: usize| [self.constants[component]; 16];
        Some(match factor {
            Factor::ONE => return None,
            Factor::SRC_COLOR => source[component],
            Factor::ONE_MINUS_SRC_COLOR => self.complement(&source[component]),
            Factor::DST_COLOR => destination[component],
            Factor::ONE_MINUS_DST_COLOR => self.complement(&destination[component]),
            Factor::SRC_ALPHA => source[3],
            Factor::ONE_MINUS_SRC_ALPHA => self.complement(&source[3]),
            Factor::DST_ALPHA => destination[3],
            Factor::ONE_MINUS_DST_ALPHA => self.complement(&destination[3]),
            Factor::CONSTANT_COLOR => constant(component),
            Factor::ONE_MINUS_CONSTANT_COLOR => self.complement(&constant(component)),
            Factor::CONSTANT_ALPHA => constant(3),
            Factor::ONE_MINUS_CONSTANT_ALPHA => self.complement(&constant(3)),
            Factor::SRC_ALPHA_SATURATE if component == 3 => return None,
            Factor::SRC_ALPHA_SATURATE => {
                let rest = self.complement(&destination[3]);
                let mut least = source[3];
                for lane in 0..16 {
                    if rest[lane] < least[lane] {
                        least[lane] = rest[lane];
                    }
                }
                least
            }
            Factor::SRC1_COLOR => second[component],
            Factor::ONE_MINUS_SRC1_COLOR => self.complement(&second[component]),
            Factor::SRC1_ALPHA => second[3],
            Factor::ONE_MINUS_SRC1_ALPHA => self.complement(&second[3]),
            _ => [0.0; 16],
        })
    }

    /// A component times its factor. A factor of zero gives zero, whatever the number is.
    #[inline(always)]
    fn product(&self, numbers: &Floats, factor: BlendFactor, component: usize) -> Floats {
        if factor == BlendFactor::ZERO {
            return [0.0; 16];
        }
        match self.factor(factor, component) {
            None => *numbers,
            Some(factors) => {
                let mut products = [0.0; 16];
                for lane in 0..16 {
                    products[lane] = numbers[lane] * factors[lane];
                }
                products
            }
        }
    }

    #[inline(always)]
    fn blend(
        &self,
        op: BlendOp,
        source_factor: BlendFactor,
        destination_factor: BlendFactor,
        component: usize,
    ) -> Floats {
        let (source, destination) = (&self.source[component], &self.destination[component]);
        let mut blended = *source;
        match op {
            BlendOp::MIN => {
                for lane in 0..16 {
                    if destination[lane] < source[lane] {
                        blended[lane] = destination[lane];
                    }
                }
            }
            BlendOp::MAX => {
                for lane in 0..16 {
                    if destination[lane] > source[lane] {
                        blended[lane] = destination[lane];
                    }
                }
            }
            _ => {
                let source = self.product(source, source_factor, component);
                let destination = self.product(destination, destination_factor, component);
                for lane in 0..16 {
                    blended[lane] = match op {
                        BlendOp::SUBTRACT => source[lane] - destination[lane],
                        BlendOp::REVERSE_SUBTRACT => destination[lane] - source[lane],
                        _ => source[lane] + destination[lane],
                    };
                }
            }
        }
        blended
    }
}

tiered! {
    /// Blends colours; all that comes in is clamped to the format's range, what goes out is not.
    pub fn blend(
        state: &BlendAttachment,
        constants: &[f32; 4],
        range: Range,
        source: &Colors,
        second: &Colors,
        destination: &Colors,
    ) -> Colors {
        let sources = Sources {
            source: &range.clamp_colors(source),
            second: &range.clamp_colors(second),
            destination,
            constants: constants.map(|constant| range.clamp(constant)),
            range,
        };
        let mut blended = [[0.0; 16]; 4];
        for component in 0..3 {
            blended[component] =
                sources.blend(state.color_op, state.src_color, state.dst_color, component);
        }
        blended[3] = sources.blend(state.alpha_op, state.src_alpha, state.dst_alpha, 3);
        blended
    }
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
pub fn operate_words(op: LogicOp, source: &Words, destination: &Words) -> Words {
    let mut words = *source;
    for (row, destination) in words.iter_mut().zip(destination) {
        for (word, destination) in row.iter_mut().zip(destination) {
            *word = operate(op, *word, *destination);
        }
    }
    words
}
