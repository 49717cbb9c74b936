//! Advanced blend operations (spec, "Advanced Blend Operations"; the equations of modes are those
//! of the W3C's "Compositing and Blending", coverage is Porter and Duff's, 1984).

use ash::vk::{BlendOp, BlendOverlapEXT};
use lanes::vector::Vector;

use super::blend::Range;
use super::lanes::{load_words, numbers, rows_of, words};
use super::places::TexelWords;
use crate::object::graphics_state::{AdvancedBlend, BlendAttachment};

/// Whether an operation is an advanced one.
pub fn is_advanced(op: BlendOp) -> bool {
    op.as_raw() >= BlendOp::ZERO_EXT.as_raw()
}

lanes::vectors! {
    /// Blends colours by an advanced operation. All that comes in is clamped to the format's range.
    /// `step` is the distance of neighbouring numbers in a fixed-point attachment, 0 for floats.
    pub fn blend_advanced<V>(
        v,
        state: &BlendAttachment,
        range: Range,
        step: f32,
        source: &TexelWords,
        destination: &TexelWords,
    ) -> TexelWords {
        let source = range.clamp_colors(v, &numbers(v, &load_words(v, source)));
        let destination = range.clamp_colors(v, &numbers(v, &load_words(v, destination)));
        let modes = Modes { v, step };
        let mut blended = modes.blend(state.color_op, &state.advanced, source, destination);
        // The attachment's colours are not multiplied with their alpha; results are.
        if !state.advanced.destination_premultiplied {
            blended = modes.divided(blended, true);
        }
        if state.advanced.clamps {
            blended = Range::Unorm.clamp_colors(v, &blended);
        }
        rows_of(v, &words(v, &blended))
    }
}

/// The modes on sixteen colours.
#[derive(Clone, Copy)]
struct Modes<V> {
    v: V,
    step: f32,
}

/// Weights of the parts of a pixel that both colours cover, only the source, only the destination.
type OverlapWeights<F> = [F; 3];

impl<V: Vector> Modes<V> {
    #[inline(always)]
    fn number(self, x: f32) -> V::F {
        self.v.splat(x)
    }

    #[inline(always)]
    fn pick(self, mask: u16, a: V::F, b: V::F) -> V::F {
        let v = self.v;
        v.bits_to_f(v.select(mask, v.bits_of(a), v.bits_of(b)))
    }

    #[inline(always)]
    fn one_minus(self, a: V::F) -> V::F {
        self.v.sub(self.number(1.0), a)
    }

    #[inline(always)]
    fn twice(self, a: V::F) -> V::F {
        self.v.add(a, a)
    }

    #[inline(always)]
    fn blend(
        self,
        op: BlendOp,
        state: &AdvancedBlend,
        source: [V::F; 4],
        destination: [V::F; 4],
    ) -> [V::F; 4] {
        if op.as_raw() >= BlendOp::PLUS_EXT.as_raw() {
            let source = self.multiplied(source, state.source_premultiplied);
            let destination = self.multiplied(destination, state.destination_premultiplied);
            return self.combined(op, source, destination);
        }
        let s = self.divided(source, state.source_premultiplied);
        let d = self.divided(destination, state.destination_premultiplied);
        let (both, only_source, only_destination) = parts(op);
        let mut weights = self.weights(state.overlap, s[3], d[3]);
        if !only_source {
            weights[1] = self.number(0.0);
        }
        if !only_destination {
            weights[2] = self.number(0.0);
        }
        let mut mode = [s[0]; 3];
        match op {
            BlendOp::HSL_HUE_EXT
            | BlendOp::HSL_SATURATION_EXT
            | BlendOp::HSL_COLOR_EXT
            | BlendOp::HSL_LUMINOSITY_EXT => {
                mode = self.of_colors(op, [s[0], s[1], s[2]], [d[0], d[1], d[2]]);
            }
            // A loop, so that the modes' code is there once.
            _ => {
                for component in 0..3 {
                    mode[component] = self.of_components(op, s[component], d[component]);
                }
            }
        }
        let both = self.number(if both { 1.0 } else { 0.0 });
        let one = self.number(1.0);
        [
            self.weighted(&weights, mode[0], s[0], d[0]),
            self.weighted(&weights, mode[1], s[1], d[1]),
            self.weighted(&weights, mode[2], s[2], d[2]),
            self.weighted(&weights, both, one, one),
        ]
    }

    #[inline(always)]
    fn weighted(self, weights: &OverlapWeights<V::F>, both: V::F, s: V::F, d: V::F) -> V::F {
        let v = self.v;
        let covered = v.add(v.mul(both, weights[0]), v.mul(s, weights[1]));
        v.add(covered, v.mul(d, weights[2]))
    }

    /// A colour divided by its alpha, if it was multiplied with it; zero where alpha is.
    #[inline(always)]
    fn divided(self, color: [V::F; 4], premultiplied: bool) -> [V::F; 4] {
        if !premultiplied {
            return color;
        }
        let (v, [r, g, b, a], zero) = (self.v, color, self.number(0.0));
        let none = v.eq(a, zero);
        [
            self.pick(none, zero, v.div(r, a)),
            self.pick(none, zero, v.div(g, a)),
            self.pick(none, zero, v.div(b, a)),
            a,
        ]
    }

    /// A colour multiplied with its alpha, if it was not.
    #[inline(always)]
    fn multiplied(self, color: [V::F; 4], premultiplied: bool) -> [V::F; 4] {
        let (v, [r, g, b, a]) = (self.v, color);
        match premultiplied {
            true => color,
            false => [v.mul(r, a), v.mul(g, a), v.mul(b, a), a],
        }
    }

    #[inline(always)]
    fn weights(self, overlap: BlendOverlapEXT, s: V::F, d: V::F) -> OverlapWeights<V::F> {
        let (v, zero) = (self.v, self.number(0.0));
        match overlap {
            BlendOverlapEXT::CONJOINT => [
                v.min(s, d),
                v.max(v.sub(s, d), zero),
                v.max(v.sub(d, s), zero),
            ],
            BlendOverlapEXT::DISJOINT => [
                v.max(v.sub(v.add(s, d), self.number(1.0)), zero),
                v.min(s, self.one_minus(d)),
                v.min(d, self.one_minus(s)),
            ],
            _ => [
                v.mul(s, d),
                v.mul(s, self.one_minus(d)),
                v.mul(d, self.one_minus(s)),
            ],
        }
    }

    /// Operations that combine colours and ignore coverage.
    #[inline(always)]
    fn combined(self, op: BlendOp, s: [V::F; 4], d: [V::F; 4]) -> [V::F; 4] {
        let v = self.v;
        let ([sr, sg, sb, sa], [dr, dg, db, da]) = (s, d);
        let alpha = match op {
            BlendOp::PLUS_EXT => v.add(sa, da),
            BlendOp::PLUS_CLAMPED_EXT
            | BlendOp::PLUS_CLAMPED_ALPHA_EXT
            | BlendOp::PLUS_DARKER_EXT => v.min(self.number(1.0), v.add(sa, da)),
            BlendOp::MINUS_EXT => v.sub(da, sa),
            BlendOp::MINUS_CLAMPED_EXT => v.max(self.number(0.0), v.sub(da, sa)),
            BlendOp::INVERT_OVG_EXT => v.sub(v.add(sa, da), v.mul(sa, da)),
            BlendOp::RED_EXT => return [sr, dg, db, da],
            BlendOp::GREEN_EXT => return [dr, sg, db, da],
            BlendOp::BLUE_EXT => return [dr, dg, sb, da],
            _ => da,
        };
        let mut color = [alpha; 4];
        for component in 0..3 {
            let (s, d) = ([s[component], sa], [d[component], da]);
            color[component] = self.combined_component(op, s, d, alpha);
        }
        color
    }

    /// A component with its alpha of both colours; `alpha` is the result's.
    #[inline(always)]
    fn combined_component(
        self,
        op: BlendOp,
        [s, sa]: [V::F; 2],
        [d, da]: [V::F; 2],
        alpha: V::F,
    ) -> V::F {
        let (v, zero, half) = (self.v, self.number(0.0), self.number(0.5));
        match op {
            BlendOp::PLUS_EXT => v.add(s, d),
            BlendOp::PLUS_CLAMPED_EXT => v.min(self.number(1.0), v.add(s, d)),
            BlendOp::PLUS_CLAMPED_ALPHA_EXT => v.min(alpha, v.add(s, d)),
            BlendOp::PLUS_DARKER_EXT => {
                let missing = v.add(v.sub(sa, s), v.sub(da, d));
                v.max(zero, v.sub(alpha, missing))
            }
            BlendOp::MINUS_EXT => v.sub(d, s),
            BlendOp::MINUS_CLAMPED_EXT => v.max(zero, v.sub(d, s)),
            BlendOp::CONTRAST_EXT => {
                let (source_middle, middle) = (v.mul(sa, half), v.mul(da, half));
                let distance = self.twice(v.sub(d, middle));
                v.add(middle, v.mul(distance, v.sub(s, source_middle)))
            }
            BlendOp::INVERT_OVG_EXT => {
                let inverted = v.mul(sa, self.one_minus(d));
                v.add(inverted, v.mul(self.one_minus(sa), d))
            }
            _ => d,
        }
    }

    /// A mode of each component by itself.
    #[inline(always)]
    fn of_components(self, op: BlendOp, s: V::F, d: V::F) -> V::F {
        let v = self.v;
        let (zero, half, one) = (self.number(0.0), self.number(0.5), self.number(1.0));
        let sum = v.add(s, d);
        match op {
            BlendOp::SRC_EXT
            | BlendOp::SRC_OVER_EXT
            | BlendOp::SRC_IN_EXT
            | BlendOp::SRC_ATOP_EXT => s,
            BlendOp::DST_EXT
            | BlendOp::DST_OVER_EXT
            | BlendOp::DST_IN_EXT
            | BlendOp::DST_ATOP_EXT => d,
            BlendOp::MULTIPLY_EXT => v.mul(s, d),
            BlendOp::SCREEN_EXT => v.sub(sum, v.mul(s, d)),
            BlendOp::OVERLAY_EXT => self.hard_light(d, s),
            BlendOp::HARDLIGHT_EXT => self.hard_light(s, d),
            BlendOp::DARKEN_EXT => v.min(s, d),
            BlendOp::LIGHTEN_EXT => v.max(s, d),
            BlendOp::COLORDODGE_EXT => self.dodge(self.one_minus(s), d),
            BlendOp::COLORBURN_EXT => self.one_minus(self.dodge(s, self.one_minus(d))),
            BlendOp::SOFTLIGHT_EXT => {
                let twice = v.sub(self.twice(s), one);
                let square = v.mul(v.mul(twice, d), self.one_minus(d));
                let inner = v.sub(v.mul(self.number(16.0), d), self.number(12.0));
                let cubic = v.mul(d, v.add(v.mul(inner, d), self.number(3.0)));
                let is_dark = v.ge(self.number(0.25), d);
                let root = v.sub(v.sqrt(d), d);
                let light = v.mul(twice, self.pick(is_dark, cubic, root));
                v.add(d, self.pick(v.ge(half, s), square, light))
            }
            BlendOp::DIFFERENCE_EXT => v.max(v.sub(d, s), v.sub(s, d)),
            BlendOp::EXCLUSION_EXT => v.sub(sum, self.twice(v.mul(s, d))),
            BlendOp::INVERT_EXT => self.one_minus(d),
            BlendOp::INVERT_RGB_EXT => v.mul(s, self.one_minus(d)),
            BlendOp::LINEARDODGE_EXT => v.min(sum, one),
            BlendOp::LINEARBURN_EXT => v.max(v.sub(sum, one), zero),
            BlendOp::VIVIDLIGHT_EXT => {
                let burn = self.one_minus(self.quotient(self.one_minus(d), self.twice(s)));
                let burn = self.pick(v.gt(s, zero), burn, zero);
                let dodge = self.quotient(d, self.twice(self.one_minus(s)));
                let dodge = self.pick(v.gt(one, s), dodge, one);
                self.pick(v.gt(half, s), burn, dodge)
            }
            BlendOp::LINEARLIGHT_EXT => {
                let light = v.sub(v.add(self.twice(s), d), one);
                v.min(v.max(light, zero), one)
            }
            BlendOp::PINLIGHT_EXT => {
                let least = v.sub(self.twice(s), one);
                let darker = v.max(least, zero);
                let lighter = self.pick(v.gt(v.mul(half, d), s), self.twice(s), d);
                self.pick(v.gt(least, d), darker, lighter)
            }
            // A destination is half a step at most from the number that was stored: a sum that
            // close to 1 is one of 1.
            BlendOp::HARDMIX_EXT => {
                let least = self.number(1.0 - 0.5 * self.step);
                self.pick(v.gt(least, sum), zero, one)
            }
            _ => zero,
        }
    }

    /// A quotient of numbers that are not negative, at most 1.
    #[inline(always)]
    fn quotient(self, a: V::F, b: V::F) -> V::F {
        self.v.min(self.number(1.0), self.v.div(a, b))
    }

    /// `d` over the light that is missing, at most 1: 0 for a `d` of 0, else 1 if none is missing.
    #[inline(always)]
    fn dodge(self, rest: V::F, d: V::F) -> V::F {
        let (v, zero) = (self.v, self.number(0.0));
        let light = self.pick(v.gt(rest, zero), self.quotient(d, rest), self.number(1.0));
        self.pick(v.gt(d, zero), light, zero)
    }

    #[inline(always)]
    fn hard_light(self, s: V::F, d: V::F) -> V::F {
        let v = self.v;
        let dark = self.twice(v.mul(s, d));
        let product = v.mul(self.one_minus(s), self.one_minus(d));
        let light = self.one_minus(self.twice(product));
        self.pick(v.ge(self.number(0.5), s), dark, light)
    }

    /// A mode that gives the hue, saturation or luminosity of one colour to another.
    #[inline(always)]
    fn of_colors(self, op: BlendOp, s: [V::F; 3], d: [V::F; 3]) -> [V::F; 3] {
        let (color, light) = match op {
            BlendOp::HSL_HUE_EXT => (self.saturated(s, d), d),
            BlendOp::HSL_SATURATION_EXT => (self.saturated(d, s), d),
            BlendOp::HSL_COLOR_EXT => (s, d),
            _ => (d, s),
        };
        self.with_luminosity(color, light)
    }

    #[inline(always)]
    fn luminosity(self, [r, g, b]: [V::F; 3]) -> V::F {
        let v = self.v;
        let (r, g) = (v.mul(self.number(0.30), r), v.mul(self.number(0.59), g));
        v.add(v.add(r, g), v.mul(self.number(0.11), b))
    }

    /// The least and the greatest component.
    #[inline(always)]
    fn bounds(self, [r, g, b]: [V::F; 3]) -> (V::F, V::F) {
        let v = self.v;
        (v.min(v.min(r, g), b), v.max(v.max(r, g), b))
    }

    /// A colour's hue with the saturation of another: its components stretched from zero to that.
    #[inline(always)]
    fn saturated(self, hue: [V::F; 3], other: [V::F; 3]) -> [V::F; 3] {
        let v = self.v;
        let (least, most) = self.bounds(hue);
        let (other_least, other_most) = self.bounds(other);
        let saturation = v.sub(other_most, other_least);
        let width = v.sub(most, least);
        let has_hue = v.gt(width, self.number(0.0));
        let scale = v.div(saturation, width);
        let zero = self.number(0.0);
        [
            self.pick(has_hue, v.mul(v.sub(hue[0], least), scale), zero),
            self.pick(has_hue, v.mul(v.sub(hue[1], least), scale), zero),
            self.pick(has_hue, v.mul(v.sub(hue[2], least), scale), zero),
        ]
    }

    /// A colour with the luminosity of another: moved there, then drawn to it where it leaves 0 to
    /// 1.
    #[inline(always)]
    fn with_luminosity(self, color: [V::F; 3], other: [V::F; 3]) -> [V::F; 3] {
        let (v, zero, one) = (self.v, self.number(0.0), self.number(1.0));
        let luminosity = self.luminosity(other);
        let move_by = v.sub(luminosity, self.luminosity(color));
        let color = [
            v.add(color[0], move_by),
            v.add(color[1], move_by),
            v.add(color[2], move_by),
        ];
        let center = self.luminosity(color);
        let (least, most) = self.bounds(color);
        let below = v.gt(zero, least);
        let above = v.gt(most, one);
        let up = v.div(center, v.sub(center, least));
        let down = v.div(self.one_minus(center), v.sub(most, center));
        let scale = self.pick(above, down, self.pick(below, up, one));
        [
            v.add(center, v.mul(v.sub(color[0], center), scale)),
            v.add(center, v.mul(v.sub(color[1], center), scale)),
            v.add(center, v.mul(v.sub(color[2], center), scale)),
        ]
    }
}

/// The parts of a pixel that an operation keeps: of both colours, of the source, of the
/// destination (the factors X, Y, Z of the specification).
fn parts(op: BlendOp) -> (bool, bool, bool) {
    match op {
        BlendOp::ZERO_EXT => (false, false, false),
        BlendOp::SRC_EXT | BlendOp::DST_ATOP_EXT => (true, true, false),
        BlendOp::DST_EXT
        | BlendOp::SRC_ATOP_EXT
        | BlendOp::INVERT_EXT
        | BlendOp::INVERT_RGB_EXT => (true, false, true),
        BlendOp::SRC_IN_EXT | BlendOp::DST_IN_EXT => (true, false, false),
        BlendOp::SRC_OUT_EXT => (false, true, false),
        BlendOp::DST_OUT_EXT => (false, false, true),
        BlendOp::XOR_EXT => (false, true, true),
        _ => (true, true, true),
    }
}
