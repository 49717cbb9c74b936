//! State that single commands set (`vkCmdSet*`).

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;

use super::graphics_state::{
    AdvancedBlend, BlendAttachment, ColorLocations, GraphicsState, MAX_VIEWPORTS, SampleLocations,
    StencilFace, VertexInput,
};
use super::shading_rate::ShadingRate;

/// The state that a command sets.
#[derive(Clone, Debug)]
pub enum Setting {
    /// From an index on.
    Viewports(u32, SmallVec<[vk::Viewport; 1]>),
    ViewportsWithCount(SmallVec<[vk::Viewport; 1]>),
    Scissors(u32, SmallVec<[vk::Rect2D; 1]>),
    ScissorsWithCount(SmallVec<[vk::Rect2D; 1]>),
    LineWidth(f32),
    DepthBias {
        constant: f32,
        clamp: f32,
        slope: f32,
        representation: vk::DepthBiasRepresentationEXT,
        exact: bool,
    },
    DepthBiasEnable(bool),
    DepthClamp(bool),
    DepthClip(bool),
    NegativeOneToOne(bool),
    BlendConstants([f32; 4]),
    DepthBounds([f32; 2]),
    DepthBoundsTest(bool),
    DepthTest(bool),
    DepthWrite(bool),
    DepthCompare(vk::CompareOp),
    StencilTest(bool),
    StencilCompareMask(vk::StencilFaceFlags, u32),
    StencilWriteMask(vk::StencilFaceFlags, u32),
    StencilReference(vk::StencilFaceFlags, u32),
    /// Fail, pass, depth fail, compare.
    StencilOps(vk::StencilFaceFlags, [vk::StencilOp; 3], vk::CompareOp),
    CullMode(vk::CullModeFlags),
    FrontFace(vk::FrontFace),
    PolygonMode(vk::PolygonMode),
    ProvokingLast(bool),
    RasterizationStream(u32),
    Topology(vk::PrimitiveTopology),
    PrimitiveRestart(bool),
    PatchControlPoints(u32),
    LowerLeftOrigin(bool),
    RasterizerDiscard(bool),
    LineMode(vk::LineRasterizationModeEXT),
    LineStippleEnable(bool),
    /// Factor and pattern.
    LineStipple(u32, u16),
    VertexInput(Box<VertexInput>),
    Samples(u32),
    DepthClampRange(Option<[f32; 2]>),
    SampleMask(u32),
    SampleLocations(SampleLocations),
    SampleLocationsEnable(bool),
    AlphaToCoverage(bool),
    AlphaToOne(bool),
    LogicOp(vk::LogicOp),
    LogicOpEnable(bool),
    /// A bit an attachment; of the attachments below the count.
    ColorWriteEnable(u32),
    /// From an attachment on.
    BlendEnable(u32, SmallVec<[bool; 8]>),
    BlendEquations(u32, Box<[vk::ColorBlendEquationEXT]>),
    /// Advanced operations and their parameters.
    AdvancedBlends(u32, Box<[vk::ColorBlendAdvancedEXT]>),
    WriteMasks(u32, SmallVec<[vk::ColorComponentFlags; 4]>),
    ColorLocations(ColorLocations),
    ShadingRate(ShadingRate),
}

/// Writes values into a list at an index. The list grows if needed.
fn set_from<T: Copy + Default>(list: &mut SmallVec<[T; 1]>, first: u32, values: &[T])
where
    [T; 1]: smallvec::Array<Item = T>,
{
    let first = (first as usize).min(MAX_VIEWPORTS);
    let end = (first + values.len()).min(MAX_VIEWPORTS);
    if list.len() < end {
        list.resize(end, T::default());
    }
    list[first..end].copy_from_slice(&values[..end - first]);
}

impl GraphicsState {
    /// Sets a value.
    pub fn set(&mut self, setting: &Setting) {
        let (rasterization, depth_stencil) = (&mut self.rasterization, &mut self.depth_stencil);
        let (multisample, blend) = (&mut self.multisample, &mut self.blend);
        match setting {
            Setting::Viewports(first, values) => {
                set_from(&mut self.viewports.viewports, *first, values);
            }
            Setting::ViewportsWithCount(values) => self.viewports.viewports.clone_from(values),
            Setting::Scissors(first, values) => {
                set_from(&mut self.viewports.scissors, *first, values);
            }
            Setting::ScissorsWithCount(values) => self.viewports.scissors.clone_from(values),
            &Setting::LineWidth(width) => rasterization.line_width = width,
            &Setting::DepthBias {
                constant,
                clamp,
                slope,
                representation,
                exact,
            } => {
                rasterization.depth_bias_constant = constant;
                rasterization.depth_bias_clamp = clamp;
                rasterization.depth_bias_slope = slope;
                rasterization.depth_bias_representation = representation;
                rasterization.depth_bias_exact = exact;
            }
            &Setting::DepthBiasEnable(on) => rasterization.depth_bias = on,
            &Setting::DepthClamp(on) => {
                rasterization.depth_clamp = on;
                if rasterization.depth_clip_follows {
                    rasterization.depth_clip = !on;
                }
            }
            &Setting::DepthClip(on) => {
                rasterization.depth_clip = on;
                rasterization.depth_clip_follows = false;
            }
            &Setting::DepthClampRange(range) => rasterization.depth_clamp_range = range,
            &Setting::NegativeOneToOne(on) => rasterization.negative_one_to_one = on,
            &Setting::BlendConstants(constants) => blend.constants = constants,
            &Setting::DepthBounds(bounds) => depth_stencil.depth_bounds = bounds,
            &Setting::DepthBoundsTest(on) => depth_stencil.depth_bounds_test = on,
            &Setting::DepthTest(on) => depth_stencil.depth_test = on,
            &Setting::DepthWrite(on) => depth_stencil.depth_write = on,
            &Setting::DepthCompare(op) => depth_stencil.depth_compare = op,
            &Setting::StencilTest(on) => depth_stencil.stencil_test = on,
            &Setting::StencilCompareMask(faces, mask) => {
                each_face(&mut depth_stencil.stencil, faces, |face| {
                    face.compare_mask = mask;
                });
            }
            &Setting::StencilWriteMask(faces, mask) => {
                each_face(&mut depth_stencil.stencil, faces, |face| {
                    face.write_mask = mask;
                });
            }
            &Setting::StencilReference(faces, reference) => {
                each_face(&mut depth_stencil.stencil, faces, |face| {
                    face.reference = reference;
                });
            }
            &Setting::StencilOps(faces, [fail, pass, depth_fail], compare) => {
                each_face(&mut depth_stencil.stencil, faces, |face| {
                    (face.fail, face.pass) = (fail, pass);
                    (face.depth_fail, face.compare) = (depth_fail, compare);
                });
            }
            &Setting::CullMode(mode) => rasterization.cull_mode = mode,
            &Setting::FrontFace(front) => rasterization.front_face = front,
            &Setting::PolygonMode(mode) => rasterization.polygon_mode = mode,
            &Setting::RasterizationStream(stream) => rasterization.stream = stream,
            &Setting::ProvokingLast(on) => rasterization.provoking_last = on,
            &Setting::Topology(topology) => self.topology = topology,
            &Setting::PrimitiveRestart(on) => self.primitive_restart = on,
            &Setting::PatchControlPoints(points) => self.tessellation.control_points = points,
            &Setting::LowerLeftOrigin(on) => self.tessellation.lower_left = on,
            &Setting::RasterizerDiscard(on) => rasterization.discard = on,
            &Setting::LineMode(mode) => rasterization.line_mode = mode,
            &Setting::LineStippleEnable(on) => rasterization.line_stipple = on,
            &Setting::LineStipple(factor, pattern) => {
                rasterization.line_stipple_factor = factor;
                rasterization.line_stipple_pattern = pattern;
            }
            Setting::VertexInput(input) => self.vertex_input.clone_from(input),
            &Setting::Samples(samples) => multisample.samples = samples,
            &Setting::SampleMask(mask) => multisample.sample_mask = mask,
            &Setting::SampleLocations(locations) => multisample.locations = locations,
            &Setting::SampleLocationsEnable(enable) => multisample.has_locations = enable,
            &Setting::AlphaToCoverage(on) => multisample.alpha_to_coverage = on,
            &Setting::AlphaToOne(on) => multisample.alpha_to_one = on,
            &Setting::LogicOp(op) => {
                blend.set_logic_op = op;
                blend.logic_op = blend.logic_op.map(|_| op);
            }
            &Setting::LogicOpEnable(on) => blend.logic_op = on.then_some(blend.set_logic_op),
            &Setting::ColorWriteEnable(bits) => blend.write_enable = bits,
            Setting::BlendEnable(first, values) => {
                for (attachment, &on) in from(&mut blend.attachments, *first).zip(values) {
                    attachment.enable = on;
                }
            }
            Setting::BlendEquations(first, values) => {
                for (attachment, equation) in from(&mut blend.attachments, *first).zip(values) {
                    attachment.set_equation(equation);
                }
            }
            Setting::AdvancedBlends(first, values) => {
                for (attachment, value) in from(&mut blend.attachments, *first).zip(values) {
                    attachment.set_advanced(value);
                }
            }
            Setting::WriteMasks(first, values) => {
                for (attachment, &mask) in from(&mut blend.attachments, *first).zip(values) {
                    attachment.write_mask = mask;
                }
            }
            &Setting::ColorLocations(locations) => self.color_locations = locations,
            &Setting::ShadingRate(rate) => self.shading_rate = rate,
        }
    }
}

impl BlendAttachment {
    fn set_equation(&mut self, equation: &vk::ColorBlendEquationEXT) {
        *self = BlendAttachment {
            src_color: equation.src_color_blend_factor,
            dst_color: equation.dst_color_blend_factor,
            color_op: equation.color_blend_op,
            src_alpha: equation.src_alpha_blend_factor,
            dst_alpha: equation.dst_alpha_blend_factor,
            alpha_op: equation.alpha_blend_op,
            ..*self
        };
    }

    fn set_advanced(&mut self, value: &vk::ColorBlendAdvancedEXT) {
        self.color_op = value.advanced_blend_op;
        self.alpha_op = value.advanced_blend_op;
        self.advanced = AdvancedBlend {
            source_premultiplied: value.src_premultiplied != vk::FALSE,
            destination_premultiplied: value.dst_premultiplied != vk::FALSE,
            overlap: value.blend_overlap,
            clamps: value.clamp_results != vk::FALSE,
        };
    }
}

fn from(
    attachments: &mut [BlendAttachment],
    first: u32,
) -> impl Iterator<Item = &mut BlendAttachment> {
    attachments.iter_mut().skip(first as usize)
}

fn each_face(
    faces: &mut [StencilFace; 2],
    which: vk::StencilFaceFlags,
    set: impl Fn(&mut StencilFace),
) {
    let bits = [vk::StencilFaceFlags::FRONT, vk::StencilFaceFlags::BACK];
    for (face, bit) in faces.iter_mut().zip(bits) {
        if which.contains(bit) {
            set(face);
        }
    }
}
