//! The facts of a draw that set-up needs, computed once for a run of its primitives.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;

use super::screen::{Screen, Volume, code};
use crate::object::graphics_state::{GraphicsState, MAX_VIEWPORTS};
use crate::raster::primitive::Bounds;

/// A viewport, and what can be drawn to through it.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub screen: Screen,
    /// The scissor, within the render area.
    pub scissor: Bounds,
    /// That, within the viewport: polygons end there.
    pub clipped: Bounds,
}

/// Depth bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias {
    pub constant: f32,
    pub slope: f32,
    pub clamp: f32,
    pub unit: BiasUnit,
}

/// The unit of a depth bias's constant factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BiasUnit {
    /// The same for all primitives.
    Constant(f64),
    /// 2^(e − 23), e the exponent of the greatest depth of the primitive.
    FloatOf,
}

/// The encoding of depths in an attachment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthFormat {
    None,
    /// Bits.
    Unorm(u8),
    Float,
}

/// How lines become coverage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lines {
    pub bresenham: bool,
    /// Rectangles whose coverage fades at their sides.
    pub smooth: bool,
    /// Pixels.
    pub width: f32,
    /// Pattern and factor.
    pub stipple: Option<(u16, u32)>,
}

/// The facts of a draw that set-up needs.
#[derive(Clone, Debug)]
pub struct Facts {
    pub views: SmallVec<[View; 1]>,
    pub volume: Volume,
    /// Samples are at pixels' centres.
    pub centers_only: bool,
    /// Triangles with that sign of area (positive is clockwise, y down) are dropped.
    pub cull_positive: bool,
    pub cull_negative: bool,
    /// Triangles with positive area are front-facing.
    pub positive_is_front: bool,
    pub polygon_mode: vk::PolygonMode,
    pub bias: Option<Bias>,
    pub lines: Lines,
    /// Layers that can be drawn to.
    pub layers: u32,
    /// Nothing is drawn.
    pub discard: bool,
}

impl Facts {
    /// The codes that leave a filled triangle whole; `None` where no triangle is just filled.
    pub fn harmless_codes(&self) -> Option<u32> {
        let whole_pixels = |view: &View| view.screen.whole_pixels;
        let is_bounded = self.centers_only || self.views.iter().all(whole_pixels);
        (self.polygon_mode == vk::PolygonMode::FILL).then_some(if is_bounded {
            code::SIDES | 0xFF << code::CULL
        } else {
            0xFF << code::CULL
        })
    }

    /// Of a draw with that state into `area`.
    pub fn new(
        state: &GraphicsState,
        area: &vk::Rect2D,
        samples: u32,
        layers: u32,
        depth: DepthFormat,
    ) -> Self {
        let rasterization = &state.rasterization;
        let area = Bounds::of(area);
        let viewports = &state.viewports;
        let views = viewports
            .viewports
            .iter()
            .take(MAX_VIEWPORTS)
            .enumerate()
            .map(|(index, viewport)| {
                let screen = Screen::new(viewport, rasterization.negative_one_to_one);
                let scissor = viewports.scissors.get(index).map_or(area, Bounds::of);
                let scissor = scissor.intersection(area);
                View {
                    screen,
                    scissor,
                    clipped: scissor.intersection(screen.inside),
                }
            })
            .collect();
        let culled = |face| rasterization.cull_mode.contains(face);
        let positive_is_front = rasterization.front_face == vk::FrontFace::CLOCKWISE;
        let (front, back) = (
            culled(vk::CullModeFlags::FRONT),
            culled(vk::CullModeFlags::BACK),
        );
        let (cull_positive, cull_negative) = if positive_is_front {
            (front, back)
        } else {
            (back, front)
        };
        Self {
            views,
            volume: Volume {
                depth_clip: rasterization.depth_clip,
                negative_one_to_one: rasterization.negative_one_to_one,
            },
            centers_only: samples <= 1,
            cull_positive,
            cull_negative,
            positive_is_front,
            polygon_mode: rasterization.polygon_mode,
            bias: bias(state, depth),
            lines: Lines {
                bresenham: rasterization.line_mode == vk::LineRasterizationModeEXT::BRESENHAM,
                smooth: rasterization.line_mode == vk::LineRasterizationModeEXT::RECTANGULAR_SMOOTH,
                width: rasterization.line_width,
                stipple: rasterization.line_stipple.then_some((
                    rasterization.line_stipple_pattern,
                    rasterization.line_stipple_factor.clamp(1, 256),
                )),
            },
            layers,
            discard: rasterization.discard,
        }
    }
}

/// Spec, "Depth Bias Computation". Without a depth attachment the bias shows in `FragCoord`; the
/// unit, which is undefined then, is that of 32-bit floats.
fn bias(state: &GraphicsState, depth: DepthFormat) -> Option<Bias> {
    let rasterization = &state.rasterization;
    if !rasterization.depth_bias {
        return None;
    }
    let unorm = |bits: u8| BiasUnit::Constant(f64::from_bits((1023 - u64::from(bits)) << 52));
    let unit = match (rasterization.depth_bias_representation, depth) {
        (vk::DepthBiasRepresentationEXT::FLOAT, _) => BiasUnit::Constant(1.0),
        (_, DepthFormat::Unorm(bits)) => unorm(bits),
        (vk::DepthBiasRepresentationEXT::LEAST_REPRESENTABLE_VALUE_FORCE_UNORM, _) => unorm(24),
        _ => BiasUnit::FloatOf,
    };
    Some(Bias {
        constant: rasterization.depth_bias_constant,
        slope: rasterization.depth_bias_slope,
        clamp: rasterization.depth_bias_clamp,
        unit,
    })
}

impl Bias {
    /// The bias of all depths of a primitive with that slope and that greatest depth.
    pub fn of(&self, slope: f64, greatest: f64) -> f64 {
        let unit = match self.unit {
            BiasUnit::Constant(unit) => unit,
            BiasUnit::FloatOf => {
                // Of a zero or a denormal number: of the least normal one.
                let exponent = ((greatest as f32).to_bits() >> 23 & 0xFF).clamp(1, 254) as i32;
                // Exact: a power of two that f64 has.
                f64::from_bits(((exponent - 127 - 23 + 1023) as u64) << 52)
            }
        };
        let offset = slope * f64::from(self.slope) + unit * f64::from(self.constant);
        let clamp = f64::from(self.clamp);
        // Unordered comparisons leave it as it is.
        if clamp > 0.0 && offset > clamp || clamp < 0.0 && offset < clamp {
            clamp
        } else {
            offset
        }
    }
}
