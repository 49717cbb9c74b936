//! Commands that set dynamic state.

use ash::vk;

use super::record::record;
use crate::VkResult;
use crate::command::{Command, GraphicsCommand, Recording};
use crate::decode::graphics::{
    color_write_enables, depth_clamp_range, dynamic_vertex_input, sample_locations,
};
use crate::ffi::{find, slice, vk as newer};
use crate::object::graphics_state::MAX_VIEWPORTS;
use crate::object::setting::Setting;
use crate::object::shading_rate::ShadingRate;

fn set(commands: &mut Recording, setting: Setting) -> VkResult {
    commands.push(Command::Graphics(GraphicsCommand::Set(setting)))
}

/// Viewports or scissors, at most as many as supported.
fn count(count: u32) -> u32 {
    count.min(MAX_VIEWPORTS as u32)
}

pub(crate) unsafe extern "system" fn vkCmdSetLineWidth(commands: vk::CommandBuffer, width: f32) {
    record("vkCmdSetLineWidth", commands, move |commands| {
        set(commands, Setting::LineWidth(width))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthBiasEnable(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetDepthBiasEnable", commands, move |commands| {
        set(commands, Setting::DepthBiasEnable(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthClampEnableEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetDepthClampEnableEXT", commands, move |commands| {
        set(commands, Setting::DepthClamp(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthClipEnableEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetDepthClipEnableEXT", commands, move |commands| {
        set(commands, Setting::DepthClip(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthClipNegativeOneToOneEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record(
        "vkCmdSetDepthClipNegativeOneToOneEXT",
        commands,
        move |commands| set(commands, Setting::NegativeOneToOne(enable != vk::FALSE)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthBounds(
    commands: vk::CommandBuffer,
    least: f32,
    greatest: f32,
) {
    record("vkCmdSetDepthBounds", commands, move |commands| {
        set(commands, Setting::DepthBounds([least, greatest]))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthBoundsTestEnable(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetDepthBoundsTestEnable", commands, move |commands| {
        set(commands, Setting::DepthBoundsTest(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthTestEnable(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetDepthTestEnable", commands, move |commands| {
        set(commands, Setting::DepthTest(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthWriteEnable(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetDepthWriteEnable", commands, move |commands| {
        set(commands, Setting::DepthWrite(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthCompareOp(
    commands: vk::CommandBuffer,
    op: vk::CompareOp,
) {
    record("vkCmdSetDepthCompareOp", commands, move |commands| {
        set(commands, Setting::DepthCompare(op))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetStencilTestEnable(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetStencilTestEnable", commands, move |commands| {
        set(commands, Setting::StencilTest(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetStencilCompareMask(
    commands: vk::CommandBuffer,
    faces: vk::StencilFaceFlags,
    mask: u32,
) {
    record("vkCmdSetStencilCompareMask", commands, move |commands| {
        set(commands, Setting::StencilCompareMask(faces, mask))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetStencilWriteMask(
    commands: vk::CommandBuffer,
    faces: vk::StencilFaceFlags,
    mask: u32,
) {
    record("vkCmdSetStencilWriteMask", commands, move |commands| {
        set(commands, Setting::StencilWriteMask(faces, mask))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetStencilReference(
    commands: vk::CommandBuffer,
    faces: vk::StencilFaceFlags,
    reference: u32,
) {
    record("vkCmdSetStencilReference", commands, move |commands| {
        set(commands, Setting::StencilReference(faces, reference))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetCullMode(
    commands: vk::CommandBuffer,
    mode: vk::CullModeFlags,
) {
    record("vkCmdSetCullMode", commands, move |commands| {
        set(commands, Setting::CullMode(mode))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetFrontFace(
    commands: vk::CommandBuffer,
    face: vk::FrontFace,
) {
    record("vkCmdSetFrontFace", commands, move |commands| {
        set(commands, Setting::FrontFace(face))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetPolygonModeEXT(
    commands: vk::CommandBuffer,
    mode: vk::PolygonMode,
) {
    record("vkCmdSetPolygonModeEXT", commands, move |commands| {
        set(commands, Setting::PolygonMode(mode))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetProvokingVertexModeEXT(
    commands: vk::CommandBuffer,
    mode: vk::ProvokingVertexModeEXT,
) {
    record(
        "vkCmdSetProvokingVertexModeEXT",
        commands,
        move |commands| {
            set(
                commands,
                Setting::ProvokingLast(mode == vk::ProvokingVertexModeEXT::LAST_VERTEX),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetPrimitiveTopology(
    commands: vk::CommandBuffer,
    topology: vk::PrimitiveTopology,
) {
    record("vkCmdSetPrimitiveTopology", commands, move |commands| {
        set(commands, Setting::Topology(topology))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetPrimitiveRestartEnable(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record(
        "vkCmdSetPrimitiveRestartEnable",
        commands,
        move |commands| set(commands, Setting::PrimitiveRestart(enable != vk::FALSE)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetRasterizerDiscardEnable(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record(
        "vkCmdSetRasterizerDiscardEnable",
        commands,
        move |commands| set(commands, Setting::RasterizerDiscard(enable != vk::FALSE)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetLineRasterizationModeEXT(
    commands: vk::CommandBuffer,
    mode: vk::LineRasterizationModeEXT,
) {
    record(
        "vkCmdSetLineRasterizationModeEXT",
        commands,
        move |commands| set(commands, Setting::LineMode(mode)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetLineStippleEnableEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetLineStippleEnableEXT", commands, move |commands| {
        set(commands, Setting::LineStippleEnable(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetLineStippleKHR(
    commands: vk::CommandBuffer,
    factor: u32,
    pattern: u16,
) {
    record("vkCmdSetLineStippleKHR", commands, move |commands| {
        set(commands, Setting::LineStipple(factor, pattern))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetRasterizationSamplesEXT(
    commands: vk::CommandBuffer,
    samples: vk::SampleCountFlags,
) {
    record(
        "vkCmdSetRasterizationSamplesEXT",
        commands,
        move |commands| set(commands, Setting::Samples(samples.as_raw())),
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetAlphaToCoverageEnableEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record(
        "vkCmdSetAlphaToCoverageEnableEXT",
        commands,
        move |commands| set(commands, Setting::AlphaToCoverage(enable != vk::FALSE)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetAlphaToOneEnableEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetAlphaToOneEnableEXT", commands, move |commands| {
        set(commands, Setting::AlphaToOne(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetLogicOpEXT(
    commands: vk::CommandBuffer,
    op: vk::LogicOp,
) {
    record("vkCmdSetLogicOpEXT", commands, move |commands| {
        set(commands, Setting::LogicOp(op))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetLogicOpEnableEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record("vkCmdSetLogicOpEnableEXT", commands, move |commands| {
        set(commands, Setting::LogicOpEnable(enable != vk::FALSE))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetViewport(
    commands: vk::CommandBuffer,
    first: u32,
    number: u32,
    viewports: *const vk::Viewport,
) {
    record("vkCmdSetViewport", commands, move |commands| {
        let viewports = slice(viewports, count(number)).iter().copied().collect();
        set(commands, Setting::Viewports(first, viewports))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetViewportWithCount(
    commands: vk::CommandBuffer,
    number: u32,
    viewports: *const vk::Viewport,
) {
    record("vkCmdSetViewportWithCount", commands, move |commands| {
        let viewports = slice(viewports, count(number)).iter().copied().collect();
        set(commands, Setting::ViewportsWithCount(viewports))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetScissor(
    commands: vk::CommandBuffer,
    first: u32,
    number: u32,
    scissors: *const vk::Rect2D,
) {
    record("vkCmdSetScissor", commands, move |commands| {
        let scissors = slice(scissors, count(number)).iter().copied().collect();
        set(commands, Setting::Scissors(first, scissors))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetScissorWithCount(
    commands: vk::CommandBuffer,
    number: u32,
    scissors: *const vk::Rect2D,
) {
    record("vkCmdSetScissorWithCount", commands, move |commands| {
        let scissors = slice(scissors, count(number)).iter().copied().collect();
        set(commands, Setting::ScissorsWithCount(scissors))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetBlendConstants(
    commands: vk::CommandBuffer,
    constants: *const [f32; 4],
) {
    record("vkCmdSetBlendConstants", commands, move |commands| {
        set(commands, Setting::BlendConstants(*constants))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthBias(
    commands: vk::CommandBuffer,
    constant: f32,
    clamp: f32,
    slope: f32,
) {
    record("vkCmdSetDepthBias", commands, move |commands| {
        set(
            commands,
            Setting::DepthBias {
                constant,
                clamp,
                slope,
                representation: vk::DepthBiasRepresentationEXT::LEAST_REPRESENTABLE_VALUE_FORMAT,
                exact: false,
            },
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthBias2EXT(
    commands: vk::CommandBuffer,
    info: *const vk::DepthBiasInfoEXT<'_>,
) {
    record("vkCmdSetDepthBias2EXT", commands, move |commands| {
        let info = &*info;
        let chained = find::<vk::DepthBiasRepresentationInfoEXT>(info.p_next);
        let usual = vk::DepthBiasRepresentationEXT::LEAST_REPRESENTABLE_VALUE_FORMAT;
        set(
            commands,
            Setting::DepthBias {
                constant: info.depth_bias_constant_factor,
                clamp: info.depth_bias_clamp,
                slope: info.depth_bias_slope_factor,
                representation: chained.map_or(usual, |it| it.depth_bias_representation),
                exact: chained.is_some_and(|it| it.depth_bias_exact != vk::FALSE),
            },
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetStencilOp(
    commands: vk::CommandBuffer,
    faces: vk::StencilFaceFlags,
    fail: vk::StencilOp,
    pass: vk::StencilOp,
    depth_fail: vk::StencilOp,
    compare: vk::CompareOp,
) {
    record("vkCmdSetStencilOp", commands, move |commands| {
        set(
            commands,
            Setting::StencilOps(faces, [fail, pass, depth_fail], compare),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetSampleMaskEXT(
    commands: vk::CommandBuffer,
    _samples: vk::SampleCountFlags,
    mask: *const vk::SampleMask,
) {
    record("vkCmdSetSampleMaskEXT", commands, move |commands| {
        set(
            commands,
            Setting::SampleMask(mask.as_ref().copied().unwrap_or(u32::MAX)),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDepthClampRangeEXT(
    commands: vk::CommandBuffer,
    mode: i32,
    range: *const newer::DepthClampRangeEXT,
) {
    record("vkCmdSetDepthClampRangeEXT", commands, move |commands| {
        set(
            commands,
            Setting::DepthClampRange(depth_clamp_range(mode, range)),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetFragmentShadingRateKHR(
    commands: vk::CommandBuffer,
    size: *const vk::Extent2D,
    combiners: *const [vk::FragmentShadingRateCombinerOpKHR; 2],
) {
    record(
        "vkCmdSetFragmentShadingRateKHR",
        commands,
        move |commands| {
            set(
                commands,
                Setting::ShadingRate(ShadingRate::new(*size, *combiners)),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetSampleLocationsEXT(
    commands: vk::CommandBuffer,
    info: *const vk::SampleLocationsInfoEXT<'_>,
) {
    record("vkCmdSetSampleLocationsEXT", commands, move |commands| {
        set(commands, Setting::SampleLocations(sample_locations(&*info)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetSampleLocationsEnableEXT(
    commands: vk::CommandBuffer,
    enable: vk::Bool32,
) {
    record(
        "vkCmdSetSampleLocationsEnableEXT",
        commands,
        move |commands| {
            set(
                commands,
                Setting::SampleLocationsEnable(enable != vk::FALSE),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetVertexInputEXT(
    commands: vk::CommandBuffer,
    binding_count: u32,
    bindings: *const vk::VertexInputBindingDescription2EXT<'_>,
    attribute_count: u32,
    attributes: *const vk::VertexInputAttributeDescription2EXT<'_>,
) {
    record("vkCmdSetVertexInputEXT", commands, move |commands| {
        let (bindings, attributes) = (
            slice(bindings, binding_count),
            slice(attributes, attribute_count),
        );
        let input = Box::new(dynamic_vertex_input(bindings, attributes));
        set(commands, Setting::VertexInput(input))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetColorWriteEnableEXT(
    commands: vk::CommandBuffer,
    number: u32,
    enables: *const vk::Bool32,
) {
    record("vkCmdSetColorWriteEnableEXT", commands, move |commands| {
        set(
            commands,
            Setting::ColorWriteEnable(color_write_enables(slice(enables, number))),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetColorBlendEnableEXT(
    commands: vk::CommandBuffer,
    first: u32,
    number: u32,
    enables: *const vk::Bool32,
) {
    record("vkCmdSetColorBlendEnableEXT", commands, move |commands| {
        let enables = slice(enables, number)
            .iter()
            .map(|&enable| enable != vk::FALSE);
        set(commands, Setting::BlendEnable(first, enables.collect()))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetColorBlendEquationEXT(
    commands: vk::CommandBuffer,
    first: u32,
    number: u32,
    equations: *const vk::ColorBlendEquationEXT,
) {
    record("vkCmdSetColorBlendEquationEXT", commands, move |commands| {
        set(
            commands,
            Setting::BlendEquations(first, slice(equations, number).into()),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetColorBlendAdvancedEXT(
    commands: vk::CommandBuffer,
    first: u32,
    number: u32,
    blends: *const vk::ColorBlendAdvancedEXT,
) {
    record("vkCmdSetColorBlendAdvancedEXT", commands, move |commands| {
        set(
            commands,
            Setting::AdvancedBlends(first, slice(blends, number).into()),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetColorWriteMaskEXT(
    commands: vk::CommandBuffer,
    first: u32,
    number: u32,
    masks: *const vk::ColorComponentFlags,
) {
    record("vkCmdSetColorWriteMaskEXT", commands, move |commands| {
        let masks = slice(masks, number).iter().copied().collect();
        set(commands, Setting::WriteMasks(first, masks))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetRasterizationStreamEXT(
    commands: vk::CommandBuffer,
    stream: u32,
) {
    record(
        "vkCmdSetRasterizationStreamEXT",
        commands,
        move |commands| set(commands, Setting::RasterizationStream(stream)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetPatchControlPointsEXT(
    commands: vk::CommandBuffer,
    points: u32,
) {
    record("vkCmdSetPatchControlPointsEXT", commands, move |commands| {
        set(commands, Setting::PatchControlPoints(points))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetTessellationDomainOriginEXT(
    commands: vk::CommandBuffer,
    origin: vk::TessellationDomainOrigin,
) {
    record(
        "vkCmdSetTessellationDomainOriginEXT",
        commands,
        move |commands| {
            let is_lower_left = origin == vk::TessellationDomainOrigin::LOWER_LEFT;
            set(commands, Setting::LowerLeftOrigin(is_lower_left))
        },
    )
}

/// Attachments are written and read in place, so feedback loops need no handling.
pub(crate) unsafe extern "system" fn vkCmdSetAttachmentFeedbackLoopEnableEXT(
    commands: vk::CommandBuffer,
    _aspects: vk::ImageAspectFlags,
) {
    record(
        "vkCmdSetAttachmentFeedbackLoopEnableEXT",
        commands,
        move |_| Ok(()),
    )
}
