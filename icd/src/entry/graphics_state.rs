//! Commands that set dynamic state.

use ash::vk;

use super::define::commands;
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

commands! {
    fn vkCmdSetLineWidth(commands, width: f32) {
        set(commands, Setting::LineWidth(width))
    }

    fn vkCmdSetDepthBiasEnable(commands, enable: vk::Bool32) {
        set(commands, Setting::DepthBiasEnable(enable != vk::FALSE))
    }

    fn vkCmdSetDepthClampEnableEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::DepthClamp(enable != vk::FALSE))
    }

    fn vkCmdSetDepthClipEnableEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::DepthClip(enable != vk::FALSE))
    }

    fn vkCmdSetDepthClipNegativeOneToOneEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::NegativeOneToOne(enable != vk::FALSE))
    }

    fn vkCmdSetDepthBounds(commands, least: f32, greatest: f32) {
        set(commands, Setting::DepthBounds([least, greatest]))
    }

    fn vkCmdSetDepthBoundsTestEnable(commands, enable: vk::Bool32) {
        set(commands, Setting::DepthBoundsTest(enable != vk::FALSE))
    }

    fn vkCmdSetDepthTestEnable(commands, enable: vk::Bool32) {
        set(commands, Setting::DepthTest(enable != vk::FALSE))
    }

    fn vkCmdSetDepthWriteEnable(commands, enable: vk::Bool32) {
        set(commands, Setting::DepthWrite(enable != vk::FALSE))
    }

    fn vkCmdSetDepthCompareOp(commands, op: vk::CompareOp) {
        set(commands, Setting::DepthCompare(op))
    }

    fn vkCmdSetStencilTestEnable(commands, enable: vk::Bool32) {
        set(commands, Setting::StencilTest(enable != vk::FALSE))
    }

    fn vkCmdSetStencilCompareMask(commands, faces: vk::StencilFaceFlags, mask: u32) {
        set(commands, Setting::StencilCompareMask(faces, mask))
    }

    fn vkCmdSetStencilWriteMask(commands, faces: vk::StencilFaceFlags, mask: u32) {
        set(commands, Setting::StencilWriteMask(faces, mask))
    }

    fn vkCmdSetStencilReference(commands, faces: vk::StencilFaceFlags, reference: u32) {
        set(commands, Setting::StencilReference(faces, reference))
    }

    fn vkCmdSetCullMode(commands, mode: vk::CullModeFlags) {
        set(commands, Setting::CullMode(mode))
    }

    fn vkCmdSetFrontFace(commands, face: vk::FrontFace) {
        set(commands, Setting::FrontFace(face))
    }

    fn vkCmdSetPolygonModeEXT(commands, mode: vk::PolygonMode) {
        set(commands, Setting::PolygonMode(mode))
    }

    fn vkCmdSetProvokingVertexModeEXT(commands, mode: vk::ProvokingVertexModeEXT) {
        set(commands, Setting::ProvokingLast(mode == vk::ProvokingVertexModeEXT::LAST_VERTEX))
    }

    fn vkCmdSetPrimitiveTopology(commands, topology: vk::PrimitiveTopology) {
        set(commands, Setting::Topology(topology))
    }

    fn vkCmdSetPrimitiveRestartEnable(commands, enable: vk::Bool32) {
        set(commands, Setting::PrimitiveRestart(enable != vk::FALSE))
    }

    fn vkCmdSetRasterizerDiscardEnable(commands, enable: vk::Bool32) {
        set(commands, Setting::RasterizerDiscard(enable != vk::FALSE))
    }

    fn vkCmdSetLineRasterizationModeEXT(commands, mode: vk::LineRasterizationModeEXT) {
        set(commands, Setting::LineMode(mode))
    }

    fn vkCmdSetLineStippleEnableEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::LineStippleEnable(enable != vk::FALSE))
    }

    fn vkCmdSetLineStippleKHR(commands, factor: u32, pattern: u16) {
        set(commands, Setting::LineStipple(factor, pattern))
    }

    fn vkCmdSetRasterizationSamplesEXT(commands, samples: vk::SampleCountFlags) {
        set(commands, Setting::Samples(samples.as_raw()))
    }

    fn vkCmdSetAlphaToCoverageEnableEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::AlphaToCoverage(enable != vk::FALSE))
    }

    fn vkCmdSetAlphaToOneEnableEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::AlphaToOne(enable != vk::FALSE))
    }

    fn vkCmdSetLogicOpEXT(commands, op: vk::LogicOp) {
        set(commands, Setting::LogicOp(op))
    }

    fn vkCmdSetLogicOpEnableEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::LogicOpEnable(enable != vk::FALSE))
    }

    fn vkCmdSetViewport(commands, first: u32, number: u32, viewports: *const vk::Viewport) {
        let viewports = slice(viewports, count(number)).iter().copied().collect();
        set(commands, Setting::Viewports(first, viewports))
    }

    fn vkCmdSetViewportWithCount(commands, number: u32, viewports: *const vk::Viewport) {
        let viewports = slice(viewports, count(number)).iter().copied().collect();
        set(commands, Setting::ViewportsWithCount(viewports))
    }

    fn vkCmdSetScissor(commands, first: u32, number: u32, scissors: *const vk::Rect2D) {
        let scissors = slice(scissors, count(number)).iter().copied().collect();
        set(commands, Setting::Scissors(first, scissors))
    }

    fn vkCmdSetScissorWithCount(commands, number: u32, scissors: *const vk::Rect2D) {
        let scissors = slice(scissors, count(number)).iter().copied().collect();
        set(commands, Setting::ScissorsWithCount(scissors))
    }

    fn vkCmdSetBlendConstants(commands, constants: *const [f32; 4]) {
        set(commands, Setting::BlendConstants(*constants))
    }

    fn vkCmdSetDepthBias(commands, constant: f32, clamp: f32, slope: f32) {
        set(commands, Setting::DepthBias {
            constant,
            clamp,
            slope,
            representation: vk::DepthBiasRepresentationEXT::LEAST_REPRESENTABLE_VALUE_FORMAT,
            exact: false,
        })
    }

    fn vkCmdSetDepthBias2EXT(commands, info: *const vk::DepthBiasInfoEXT<'_>) {
        let info = &*info;
        let chained = find::<vk::DepthBiasRepresentationInfoEXT>(info.p_next);
        let usual = vk::DepthBiasRepresentationEXT::LEAST_REPRESENTABLE_VALUE_FORMAT;
        set(commands, Setting::DepthBias {
            constant: info.depth_bias_constant_factor,
            clamp: info.depth_bias_clamp,
            slope: info.depth_bias_slope_factor,
            representation: chained.map_or(usual, |it| it.depth_bias_representation),
            exact: chained.is_some_and(|it| it.depth_bias_exact != vk::FALSE),
        })
    }

    fn vkCmdSetStencilOp(
        commands,
        faces: vk::StencilFaceFlags,
        fail: vk::StencilOp,
        pass: vk::StencilOp,
        depth_fail: vk::StencilOp,
        compare: vk::CompareOp,
    ) {
        set(commands, Setting::StencilOps(faces, [fail, pass, depth_fail], compare))
    }

    fn vkCmdSetSampleMaskEXT(commands, _samples: vk::SampleCountFlags, mask: *const vk::SampleMask) {
        set(commands, Setting::SampleMask(mask.as_ref().copied().unwrap_or(u32::MAX)))
    }

    fn vkCmdSetDepthClampRangeEXT(
        commands,
        mode: i32,
        range: *const newer::DepthClampRangeEXT,
    ) {
        set(commands, Setting::DepthClampRange(depth_clamp_range(mode, range)))
    }

    fn vkCmdSetFragmentShadingRateKHR(
        commands,
        size: *const vk::Extent2D,
        combiners: *const [vk::FragmentShadingRateCombinerOpKHR; 2],
    ) {
        set(commands, Setting::ShadingRate(ShadingRate::new(*size, *combiners)))
    }

    fn vkCmdSetSampleLocationsEXT(commands, info: *const vk::SampleLocationsInfoEXT<'_>) {
        set(commands, Setting::SampleLocations(sample_locations(&*info)))
    }

    fn vkCmdSetSampleLocationsEnableEXT(commands, enable: vk::Bool32) {
        set(commands, Setting::SampleLocationsEnable(enable != vk::FALSE))
    }

    fn vkCmdSetVertexInputEXT(
        commands,
        binding_count: u32,
        bindings: *const vk::VertexInputBindingDescription2EXT<'_>,
        attribute_count: u32,
        attributes: *const vk::VertexInputAttributeDescription2EXT<'_>,
    ) {
        let (bindings, attributes) = (slice(bindings, binding_count), slice(attributes, attribute_count));
        let input = Box::new(dynamic_vertex_input(bindings, attributes));
        set(commands, Setting::VertexInput(input))
    }

    fn vkCmdSetColorWriteEnableEXT(commands, number: u32, enables: *const vk::Bool32) {
        set(commands, Setting::ColorWriteEnable(color_write_enables(slice(enables, number))))
    }

    fn vkCmdSetColorBlendEnableEXT(commands, first: u32, number: u32, enables: *const vk::Bool32) {
        let enables = slice(enables, number).iter().map(|&enable| enable != vk::FALSE);
        set(commands, Setting::BlendEnable(first, enables.collect()))
    }

    fn vkCmdSetColorBlendEquationEXT(
        commands,
        first: u32,
        number: u32,
        equations: *const vk::ColorBlendEquationEXT,
    ) {
        set(commands, Setting::BlendEquations(first, slice(equations, number).into()))
    }

    fn vkCmdSetColorBlendAdvancedEXT(
        commands,
        first: u32,
        number: u32,
        blends: *const vk::ColorBlendAdvancedEXT,
    ) {
        set(commands, Setting::AdvancedBlends(first, slice(blends, number).into()))
    }

    fn vkCmdSetColorWriteMaskEXT(
        commands,
        first: u32,
        number: u32,
        masks: *const vk::ColorComponentFlags,
    ) {
        let masks = slice(masks, number).iter().copied().collect();
        set(commands, Setting::WriteMasks(first, masks))
    }

    fn vkCmdSetRasterizationStreamEXT(commands, stream: u32) {
        set(commands, Setting::RasterizationStream(stream))
    }

    fn vkCmdSetPatchControlPointsEXT(commands, points: u32) {
        set(commands, Setting::PatchControlPoints(points))
    }

    fn vkCmdSetTessellationDomainOriginEXT(commands, origin: vk::TessellationDomainOrigin) {
        let is_lower_left = origin == vk::TessellationDomainOrigin::LOWER_LEFT;
        set(commands, Setting::LowerLeftOrigin(is_lower_left))
    }

    /// Attachments are written and read in place, so feedback loops need no handling.
    fn vkCmdSetAttachmentFeedbackLoopEnableEXT(_commands, _aspects: vk::ImageAspectFlags) {
        Ok(())
    }
}
