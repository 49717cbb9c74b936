//! The state of a draw except shaders, bindings, buffers and attachments, from graphics pipelines
//! and from commands.
//!
//! A command buffer has one current [`GraphicsState`]. Binding a pipeline copies the pipeline's
//! static groups ([`GraphicsState::take_static`]); `vkCmdSet*` writes single values. So a draw
//! reads one structure, regardless of the source of its parts.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;

use super::shading_rate::ShadingRate;
use crate::capabilities::limits;

/// `maxViewports`.
pub const MAX_VIEWPORTS: usize = limits::MAX_VIEWPORTS as usize;

/// `maxColorAttachments`.
pub const MAX_COLOR_ATTACHMENTS: usize = limits::MAX_COLOR_ATTACHMENTS as usize;

/// `maxVertexInputAttributes` and `maxVertexInputBindings`.
pub const MAX_VERTEX_INPUTS: usize = limits::MAX_VERTEX_INPUTS as usize;

/// `VkVertexInputBindingDescription`, with its divisor (`VkVertexInputBindingDivisorDescription`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VertexBinding {
    pub binding: u32,
    pub stride_bytes: u32,
    /// The binding advances by instance, otherwise by vertex.
    pub per_instance: bool,
    /// Instances between advances; 0: never.
    pub divisor: u32,
}

/// `VkVertexInputAttributeDescription`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VertexAttribute {
    pub location: u32,
    pub binding: u32,
    pub format: vk::Format,
    pub offset_bytes: u32,
}

/// Vertex input. Strides may be dynamic by themselves (`vkCmdBindVertexBuffers2`).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexInput {
    pub bindings: SmallVec<[VertexBinding; 4]>,
    pub attributes: SmallVec<[VertexAttribute; 4]>,
}

/// `VkPipelineRasterizationStateCreateInfo` and its chain, by field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rasterization {
    pub discard: bool,
    pub depth_clamp: bool,
    /// Replaces the viewport's depth range (`VK_EXT_depth_clamp_control`).
    pub depth_clamp_range: Option<[f32; 2]>,
    /// The set value, or the opposite of `depth_clamp` if none was set
    /// (`VkPipelineRasterizationDepthClipStateCreateInfoEXT`).
    pub depth_clip: bool,
    /// No value was set: `depth_clip` follows `depth_clamp`, as its opposite.
    pub depth_clip_follows: bool,
    pub polygon_mode: vk::PolygonMode,
    pub cull_mode: vk::CullModeFlags,
    pub front_face: vk::FrontFace,
    pub depth_bias: bool,
    pub depth_bias_constant: f32,
    pub depth_bias_clamp: f32,
    pub depth_bias_slope: f32,
    /// `VkDepthBiasRepresentationInfoEXT`.
    pub depth_bias_representation: vk::DepthBiasRepresentationEXT,
    pub depth_bias_exact: bool,
    pub line_width: f32,
    pub line_mode: vk::LineRasterizationModeEXT,
    pub line_stipple: bool,
    pub line_stipple_factor: u32,
    pub line_stipple_pattern: u16,
    /// The vertex stream that is rasterized.
    pub stream: u32,
    /// `VK_PROVOKING_VERTEX_MODE_LAST_VERTEX_EXT`.
    pub provoking_last: bool,
    /// `VkPipelineViewportDepthClipControlCreateInfoEXT::negativeOneToOne`.
    pub negative_one_to_one: bool,
}

/// `VkPipelineMultisampleStateCreateInfo`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Multisample {
    /// 1, 2, 4 or 8.
    pub samples: u32,
    pub sample_shading: bool,
    pub min_sample_shading: f32,
    pub sample_mask: u32,
    pub alpha_to_coverage: bool,
    pub alpha_to_one: bool,
    /// `VkPipelineSampleLocationsStateCreateInfoEXT`: the sample locations, in sixteenths of a
    /// pixel.
    pub has_locations: bool,
    pub locations: SampleLocations,
}

/// The x and y of each sample of a pixel, in sixteenths from the upper left corner.
pub type SampleLocations = [[u8; 2]; 8];

/// One face of the stencil test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StencilFace {
    pub fail: vk::StencilOp,
    pub pass: vk::StencilOp,
    pub depth_fail: vk::StencilOp,
    pub compare: vk::CompareOp,
    pub compare_mask: u32,
    pub write_mask: u32,
    pub reference: u32,
}

/// `VkPipelineDepthStencilStateCreateInfo`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthStencil {
    pub depth_test: bool,
    pub depth_write: bool,
    pub depth_compare: vk::CompareOp,
    pub depth_bounds_test: bool,
    pub depth_bounds: [f32; 2],
    pub stencil_test: bool,
    /// Front, back.
    pub stencil: [StencilFace; 2],
}

/// `VkPipelineColorBlendAttachmentState`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlendAttachment {
    pub enable: bool,
    pub src_color: vk::BlendFactor,
    pub dst_color: vk::BlendFactor,
    pub color_op: vk::BlendOp,
    pub src_alpha: vk::BlendFactor,
    pub dst_alpha: vk::BlendFactor,
    pub alpha_op: vk::BlendOp,
    pub write_mask: vk::ColorComponentFlags,
    /// Used by advanced blend operations.
    pub advanced: AdvancedBlend,
}

/// Parameters of advanced blend operations: `VkPipelineColorBlendAdvancedStateCreateInfoEXT` or
/// `VkColorBlendAdvancedEXT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdvancedBlend {
    pub source_premultiplied: bool,
    pub destination_premultiplied: bool,
    pub overlap: vk::BlendOverlapEXT,
    /// Results are clamped to 0 to 1.
    pub clamps: bool,
}

impl Default for AdvancedBlend {
    fn default() -> Self {
        Self {
            source_premultiplied: true,
            destination_premultiplied: true,
            overlap: vk::BlendOverlapEXT::UNCORRELATED,
            clamps: false,
        }
    }
}

/// `VkPipelineColorBlendStateCreateInfo`, with `VK_EXT_color_write_enable`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorBlend {
    /// The logic operation, if it is enabled; see [`Self::set_logic_op`].
    pub logic_op: Option<vk::LogicOp>,
    /// The operation as it was set, enabled or not.
    pub set_logic_op: vk::LogicOp,
    pub attachments: [BlendAttachment; MAX_COLOR_ATTACHMENTS],
    /// A bit an attachment.
    pub write_enable: u32,
    pub constants: [f32; 4],
}

/// Viewports and scissors.
#[derive(Clone, Debug, Default)]
pub struct Viewports {
    pub viewports: SmallVec<[vk::Viewport; 1]>,
    pub scissors: SmallVec<[vk::Rect2D; 1]>,
}

/// The attachments for which a pipeline has formats. It neither reads nor writes the others
/// (`VK_EXT_dynamic_rendering_unused_attachments`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UsedAttachments {
    /// A bit an attachment.
    pub colors: u32,
    pub depth: bool,
    pub stencil: bool,
}

/// The color attachment of each fragment output location, or `VK_ATTACHMENT_UNUSED`
/// (`VkRenderingAttachmentLocationInfo`).
pub type ColorLocations = [u32; MAX_COLOR_ATTACHMENTS];

/// The locations at the start of a pass: each attachment has the location of its number.
pub fn own_locations() -> ColorLocations {
    std::array::from_fn(|location| location as u32)
}

/// Tessellation state (`VkPipelineTessellationStateCreateInfo`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tessellation {
    /// Vertices of a patch.
    pub control_points: u32,
    /// The domain's origin is the lower left corner instead of the upper left one.
    pub lower_left: bool,
}

/// All of it.
#[derive(Clone, Debug)]
pub struct GraphicsState {
    pub vertex_input: VertexInput,
    pub topology: vk::PrimitiveTopology,
    pub primitive_restart: bool,
    pub tessellation: Tessellation,
    pub viewports: Viewports,
    pub rasterization: Rasterization,
    pub multisample: Multisample,
    pub depth_stencil: DepthStencil,
    pub blend: ColorBlend,
    pub shading_rate: ShadingRate,
    pub color_locations: ColorLocations,
    /// All attachments, except for pipelines of dynamic rendering.
    pub used_attachments: UsedAttachments,
}

impl GraphicsState {
    /// Whether both states draw the same. Floats are compared by their bits, since the sign of a
    /// zero can reach an attachment.
    pub fn is_same(&self, other: &Self) -> bool {
        let Self {
            vertex_input,
            topology,
            primitive_restart,
            tessellation,
            viewports,
            rasterization,
            multisample,
            depth_stencil,
            blend,
            shading_rate,
            color_locations,
            used_attachments,
        } = self;
        // The field that differs most often comes first.
        viewports.is_same(&other.viewports)
            && *depth_stencil == other.depth_stencil
            && *rasterization == other.rasterization
            && *blend == other.blend
            && *topology == other.topology
            && *primitive_restart == other.primitive_restart
            && *tessellation == other.tessellation
            && *multisample == other.multisample
            && *shading_rate == other.shading_rate
            && *color_locations == other.color_locations
            && *used_attachments == other.used_attachments
            && *vertex_input == other.vertex_input
            && self.float_bits() == other.float_bits()
    }

    /// The bits of all floats, viewports excepted.
    fn float_bits(&self) -> [u32; 11] {
        let (raster, [low, high]) = (&self.rasterization, self.depth_stencil.depth_bounds);
        let [red, green, blue, alpha] = self.blend.constants;
        [
            raster.depth_bias_constant,
            raster.depth_bias_clamp,
            raster.depth_bias_slope,
            raster.line_width,
            self.multisample.min_sample_shading,
            low,
            high,
            red,
            green,
            blue,
            alpha,
        ]
        .map(f32::to_bits)
    }
}

impl Viewports {
    fn is_same(&self, other: &Self) -> bool {
        let bits = |it: &vk::Viewport| {
            [it.x, it.y, it.width, it.height, it.min_depth, it.max_depth].map(f32::to_bits)
        };
        self.scissors == other.scissors
            && (self.viewports.iter().map(bits)).eq(other.viewports.iter().map(bits))
    }
}

impl Default for UsedAttachments {
    fn default() -> Self {
        Self {
            colors: u32::MAX,
            depth: true,
            stencil: true,
        }
    }
}

impl Default for Rasterization {
    fn default() -> Self {
        Self {
            discard: false,
            depth_clamp: false,
            depth_clamp_range: None,
            depth_clip: true,
            depth_clip_follows: true,
            polygon_mode: vk::PolygonMode::FILL,
            cull_mode: vk::CullModeFlags::NONE,
            front_face: vk::FrontFace::COUNTER_CLOCKWISE,
            depth_bias: false,
            depth_bias_constant: 0.0,
            depth_bias_clamp: 0.0,
            depth_bias_slope: 0.0,
            depth_bias_representation:
                vk::DepthBiasRepresentationEXT::LEAST_REPRESENTABLE_VALUE_FORMAT,
            depth_bias_exact: false,
            line_width: 1.0,
            line_mode: vk::LineRasterizationModeEXT::DEFAULT,
            line_stipple: false,
            line_stipple_factor: 1,
            line_stipple_pattern: u16::MAX,
            stream: 0,
            provoking_last: false,
            negative_one_to_one: false,
        }
    }
}

impl Default for Multisample {
    fn default() -> Self {
        Self {
            samples: 1,
            sample_shading: false,
            min_sample_shading: 0.0,
            sample_mask: u32::MAX,
            alpha_to_coverage: false,
            alpha_to_one: false,
            has_locations: false,
            locations: [[0; 2]; 8],
        }
    }
}

impl Default for StencilFace {
    fn default() -> Self {
        Self {
            fail: vk::StencilOp::KEEP,
            pass: vk::StencilOp::KEEP,
            depth_fail: vk::StencilOp::KEEP,
            compare: vk::CompareOp::ALWAYS,
            compare_mask: u32::MAX,
            write_mask: u32::MAX,
            reference: 0,
        }
    }
}

impl Default for DepthStencil {
    fn default() -> Self {
        Self {
            depth_test: false,
            depth_write: false,
            depth_compare: vk::CompareOp::ALWAYS,
            depth_bounds_test: false,
            depth_bounds: [0.0, 1.0],
            stencil_test: false,
            stencil: [StencilFace::default(); 2],
        }
    }
}

impl Default for BlendAttachment {
    fn default() -> Self {
        Self {
            enable: false,
            src_color: vk::BlendFactor::ONE,
            dst_color: vk::BlendFactor::ZERO,
            color_op: vk::BlendOp::ADD,
            src_alpha: vk::BlendFactor::ONE,
            dst_alpha: vk::BlendFactor::ZERO,
            alpha_op: vk::BlendOp::ADD,
            write_mask: vk::ColorComponentFlags::RGBA,
            advanced: AdvancedBlend::default(),
        }
    }
}

impl Default for ColorBlend {
    fn default() -> Self {
        Self {
            logic_op: None,
            set_logic_op: vk::LogicOp::COPY,
            attachments: [BlendAttachment::default(); MAX_COLOR_ATTACHMENTS],
            write_enable: u32::MAX,
            constants: [0.0; 4],
        }
    }
}

impl Default for GraphicsState {
    fn default() -> Self {
        Self {
            vertex_input: VertexInput::default(),
            topology: vk::PrimitiveTopology::TRIANGLE_LIST,
            tessellation: Tessellation::default(),
            primitive_restart: false,
            viewports: Viewports::default(),
            rasterization: Rasterization::default(),
            multisample: Multisample::default(),
            depth_stencil: DepthStencil::default(),
            blend: ColorBlend::default(),
            shading_rate: ShadingRate::default(),
            color_locations: own_locations(),
            used_attachments: UsedAttachments::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_the_same_to_the_last_bit() {
        let state = GraphicsState::default();
        let differs = |change: fn(&mut GraphicsState)| {
            let mut other = state.clone();
            assert!(state.is_same(&other));
            change(&mut other);
            !state.is_same(&other)
        };
        assert!(differs(|it| it.blend.constants[3] = -0.0));
        assert!(differs(|it| it.rasterization.depth_bias_slope = -0.0));
        assert!(differs(|it| it.depth_stencil.stencil[1].reference = 1));
        assert!(differs(|it| it.multisample.sample_mask = 1));
        assert!(differs(|it| it.shading_rate.pipeline.logs = [1, 0]));
        assert!(differs(|it| it.topology = vk::PrimitiveTopology::POINT_LIST));
        assert!(differs(|it| it.color_locations[7] = vk::ATTACHMENT_UNUSED));
        assert!(differs(
            |it| it.viewports.viewports = [vk::Viewport::default()].into()
        ));
        assert!(differs(
            |it| it.viewports.scissors = [vk::Rect2D::default()].into()
        ));
    }
}
