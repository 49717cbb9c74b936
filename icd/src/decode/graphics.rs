//! `VkGraphicsPipelineCreateInfo` and what it points to.
//!
//! Members that a pipeline does not use may hold anything, invalid pointers included (chapter
//! Pipelines, "Graphics Pipelines"). Each is read only where it counts.

use ash::vk;
use smallvec::SmallVec;

use super::pipeline::{create_flags, decode_stage};
use crate::VkResult;
use crate::ffi::{find, slice, vk as newer};
use crate::handle::{from_handle, optional};
use crate::object::dynamic_state::{DynamicStates, Parts};
use crate::object::graphics_pipeline::GraphicsPipeline;
use crate::object::graphics_state::{
    AdvancedBlend, BlendAttachment, ColorBlend, ColorLocations, DepthStencil, GraphicsState,
    MAX_COLOR_ATTACHMENTS, MAX_VIEWPORTS, Multisample, Rasterization, SampleLocations, StencilFace,
    Tessellation, UsedAttachments, VertexAttribute, VertexBinding, VertexInput, Viewports,
    own_locations,
};
use crate::object::pipeline::PipelineKind;
use crate::object::shader_stage::ShaderStage;
use crate::object::shading_rate::ShadingRate;
use crate::object::{Pipeline, RenderPass};

const ALL: Parts = Parts::from_raw(
    Parts::VERTEX_INPUT_INTERFACE.as_raw()
        | Parts::PRE_RASTERIZATION_SHADERS.as_raw()
        | Parts::FRAGMENT_SHADER.as_raw()
        | Parts::FRAGMENT_OUTPUT_INTERFACE.as_raw(),
);

/// A pipeline to be created, without its programs, and the libraries that complete it.
pub struct Decoded<'a> {
    /// The parts that come with the info.
    pub own: GraphicsPipeline,
    /// The stages, each with its index among the info's stages.
    pub stages: SmallVec<[(usize, ShaderStage); 2]>,
    pub libraries: Vec<&'a GraphicsPipeline>,
}

/// Decodes all of an info.
///
/// # Errors
/// As [`decode_stage`]; `VK_ERROR_UNKNOWN` for a library that has no graphics.
///
/// # Safety
/// The info is valid, and its handles are alive for `'a`.
pub unsafe fn decode<'a>(info: &vk::GraphicsPipelineCreateInfo<'_>) -> VkResult<Decoded<'a>> {
    // SAFETY: the caller's info is valid, and its handles are alive.
    unsafe {
        let libraries = libraries(info)?;
        let parts = own_parts(info, &libraries);
        let list = info.p_dynamic_state.as_ref();
        let list = list.map_or(&[][..], |it| {
            slice(it.p_dynamic_states, it.dynamic_state_count)
        });
        let dynamic = DynamicStates::of(list, parts);
        let mut state = GraphicsState::default();
        decode_input(info, parts, dynamic, &mut state);
        decode_rasterization(info, parts, &mut state);
        let discards = parts.contains(Parts::PRE_RASTERIZATION_SHADERS)
            && state.rasterization.discard
            && !dynamic.contains(vk::DynamicState::RASTERIZER_DISCARD_ENABLE);
        if !discards {
            decode_viewports(info, parts, dynamic, &mut state);
        }
        decode_fragments(info, parts, discards, &mut state);
        let stages = decode_stages(info, parts, discards)?;
        let mut own = GraphicsPipeline::empty();
        (own.parts, own.state, own.dynamic) = (parts, state, dynamic);
        Ok(Decoded {
            own,
            stages,
            libraries,
        })
    }
}

/// The state of the vertex input interface. Mesh pipelines take no vertices.
///
/// # Safety
/// The info is valid.
unsafe fn decode_input(
    info: &vk::GraphicsPipelineCreateInfo<'_>,
    parts: Parts,
    dynamic: DynamicStates,
    state: &mut GraphicsState,
) {
    // SAFETY: the caller's info is valid: the pointers of a part that is there are null or valid.
    unsafe {
        let mut stages = slice(info.p_stages, info.stage_count).iter();
        let has_mesh = stages.any(|it| it.stage == vk::ShaderStageFlags::MESH_EXT);
        if !parts.contains(Parts::VERTEX_INPUT_INTERFACE) || has_mesh {
            return;
        }
        if !dynamic.contains(vk::DynamicState::VERTEX_INPUT_EXT)
            && let Some(input) = info.p_vertex_input_state.as_ref()
        {
            state.vertex_input = vertex_input(input);
        }
        if let Some(assembly) = info.p_input_assembly_state.as_ref() {
            state.topology = assembly.topology;
            state.primitive_restart = assembly.primitive_restart_enable != vk::FALSE;
        }
    }
}

/// The state before rasterization, except viewports, and the shading rate.
///
/// # Safety
/// The info is valid.
unsafe fn decode_rasterization(
    info: &vk::GraphicsPipelineCreateInfo<'_>,
    parts: Parts,
    state: &mut GraphicsState,
) {
    // SAFETY: the caller's info is valid: the pointers of a part that is there are null or valid.
    unsafe {
        if parts.contains(Parts::PRE_RASTERIZATION_SHADERS) {
            if let Some(info) = info.p_rasterization_state.as_ref() {
                state.rasterization = rasterization(info);
            }
            if has_tessellation(slice(info.p_stages, info.stage_count))
                && let Some(info) = info.p_tessellation_state.as_ref()
            {
                state.tessellation = tessellation(info);
            }
        }
        if parts.intersects(Parts::PRE_RASTERIZATION_SHADERS | Parts::FRAGMENT_SHADER) {
            let rate = find::<vk::PipelineFragmentShadingRateStateCreateInfoKHR<'_>>(info.p_next);
            let rate = rate.map(|it| ShadingRate::new(it.fragment_size, it.combiner_ops));
            state.shading_rate = rate.unwrap_or_default();
        }
    }
}

/// The viewports and their depth settings.
///
/// # Safety
/// The info is valid.
unsafe fn decode_viewports(
    info: &vk::GraphicsPipelineCreateInfo<'_>,
    parts: Parts,
    dynamic: DynamicStates,
    state: &mut GraphicsState,
) {
    if !parts.contains(Parts::PRE_RASTERIZATION_SHADERS) {
        return;
    }
    // SAFETY: the caller's info is valid: the pointers of a part that is there are null or valid.
    unsafe {
        let Some(info) = info.p_viewport_state.as_ref() else {
            return;
        };
        state.viewports = viewports(info, dynamic);
        state.rasterization.negative_one_to_one =
            find::<vk::PipelineViewportDepthClipControlCreateInfoEXT>(info.p_next)
                .is_some_and(|control| control.negative_one_to_one != vk::FALSE);
        let clamp = find::<newer::PipelineViewportDepthClampControlCreateInfoEXT>(info.p_next);
        state.rasterization.depth_clamp_range =
            clamp.and_then(|it| depth_clamp_range(it.depth_clamp_mode, it.p_depth_clamp_range));
    }
}

/// The state of fragments and of the fragment output interface.
///
/// # Safety
/// The info is valid.
unsafe fn decode_fragments(
    info: &vk::GraphicsPipelineCreateInfo<'_>,
    parts: Parts,
    discards: bool,
    state: &mut GraphicsState,
) {
    // SAFETY: the caller's info is valid: the pointers of a part that is there are null or valid.
    unsafe {
        let (colors, depth) = attachments(info, parts);
        if parts.contains(Parts::FRAGMENT_SHADER)
            && !discards
            && depth
            && let Some(info) = info.p_depth_stencil_state.as_ref()
        {
            state.depth_stencil = depth_stencil(info);
        }
        if !parts.contains(Parts::FRAGMENT_OUTPUT_INTERFACE) {
            return;
        }
        if info.render_pass == vk::RenderPass::null() {
            state.used_attachments = used_attachments(info);
        }
        if discards {
            return;
        }
        if let Some(info) = info.p_multisample_state.as_ref() {
            state.multisample = multisample(info);
        }
        if colors && let Some(info) = info.p_color_blend_state.as_ref() {
            state.blend = color_blend(info);
        }
        if let Some(locations) = find::<vk::RenderingAttachmentLocationInfoKHR>(info.p_next) {
            state.color_locations = color_locations(locations);
        }
    }
}

/// The shader stages of the info's own parts, with their index among the info's stages.
///
/// # Safety
/// The info is valid.
unsafe fn decode_stages(
    info: &vk::GraphicsPipelineCreateInfo<'_>,
    parts: Parts,
    discards: bool,
) -> VkResult<SmallVec<[(usize, ShaderStage); 2]>> {
    let mut stages = SmallVec::new();
    // SAFETY: the caller's info is valid, and so are its stages.
    unsafe {
        let view_index_is_device_index = create_flags(info.flags, info.p_next)
            .contains(vk::PipelineCreateFlags::VIEW_INDEX_FROM_DEVICE_INDEX);
        for (index, stage) in slice(info.p_stages, info.stage_count).iter().enumerate() {
            let wanted = match stage.stage {
                vk::ShaderStageFlags::FRAGMENT => {
                    parts.contains(Parts::FRAGMENT_SHADER) && !discards
                }
                _ => parts.contains(Parts::PRE_RASTERIZATION_SHADERS),
            };
            if wanted {
                let stage = ShaderStage {
                    view_index_is_device_index,
                    ..decode_stage(stage, info.p_next)?
                };
                stages.push((index, stage));
            }
        }
    }
    Ok(stages)
}

/// Whether a stage uses the tessellation state, which may hold anything otherwise.
fn has_tessellation(stages: &[vk::PipelineShaderStageCreateInfo<'_>]) -> bool {
    (stages.iter()).any(|it| it.stage == vk::ShaderStageFlags::TESSELLATION_EVALUATION)
}

/// # Safety
/// The info is valid.
unsafe fn tessellation(info: &vk::PipelineTessellationStateCreateInfo<'_>) -> Tessellation {
    // SAFETY: the caller guarantees that the info is valid.
    let origin =
        unsafe { find::<vk::PipelineTessellationDomainOriginStateCreateInfo<'_>>(info.p_next) };
    Tessellation {
        control_points: info.patch_control_points,
        lower_left: origin
            .is_some_and(|it| it.domain_origin == vk::TessellationDomainOrigin::LOWER_LEFT),
    }
}

/// The parts that an info itself has (`VkGraphicsPipelineLibraryCreateInfoEXT`).
///
/// # Safety
/// The info is valid.
unsafe fn own_parts(
    info: &vk::GraphicsPipelineCreateInfo<'_>,
    libraries: &[&GraphicsPipeline],
) -> Parts {
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        let flags = create_flags(info.flags, info.p_next);
        match find::<vk::GraphicsPipelineLibraryCreateInfoEXT>(info.p_next) {
            Some(parts) => parts.flags,
            None if flags.contains(vk::PipelineCreateFlags::LIBRARY_KHR) => Parts::empty(),
            None if !libraries.is_empty() => Parts::empty(),
            None => ALL,
        }
    }
}

/// # Safety
/// The info is valid, and its libraries are alive for `'a`.
unsafe fn libraries<'a>(
    info: &vk::GraphicsPipelineCreateInfo<'_>,
) -> VkResult<Vec<&'a GraphicsPipeline>> {
    // SAFETY: the caller guarantees that the info is valid, and its libraries are alive for `'a`.
    unsafe {
        let Some(info) = find::<vk::PipelineLibraryCreateInfoKHR>(info.p_next) else {
            return Ok(Vec::new());
        };
        let graphics = |&library: &vk::Pipeline| match &from_handle::<'a, Pipeline>(library).kind {
            PipelineKind::Graphics(pipeline) => Ok(&**pipeline),
            _ => Err(vk::Result::ERROR_UNKNOWN),
        };
        slice(info.p_libraries, info.library_count)
            .iter()
            .map(graphics)
            .collect()
    }
}

/// Whether there are color attachments, and a depth or stencil attachment. Their state is read only
/// then.
///
/// # Safety
/// The info is valid.
unsafe fn attachments(info: &vk::GraphicsPipelineCreateInfo<'_>, parts: Parts) -> (bool, bool) {
    if !parts.intersects(Parts::FRAGMENT_SHADER | Parts::FRAGMENT_OUTPUT_INTERFACE) {
        return (false, false);
    }
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        if let Some(pass) = optional::<RenderPass>(info.render_pass) {
            let subpass = pass.subpasses.get(info.subpass as usize);
            let colors = subpass.is_some_and(|it| it.colors.iter().any(Option::is_some));
            return (colors, subpass.is_some_and(|it| it.depth_stencil.is_some()));
        }
        let rendering = find::<vk::PipelineRenderingCreateInfo>(info.p_next);
        (
            rendering.is_some_and(|it| it.color_attachment_count != 0),
            true,
        )
    }
}

/// The attachments for which a pipeline of dynamic rendering has formats.
///
/// # Safety
/// The info is valid.
unsafe fn used_attachments(info: &vk::GraphicsPipelineCreateInfo<'_>) -> UsedAttachments {
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        let rendering = find::<vk::PipelineRenderingCreateInfo>(info.p_next);
        let colors = rendering.map_or(&[][..], |it| {
            slice(it.p_color_attachment_formats, it.color_attachment_count)
        });
        let is_used = |format: vk::Format| format != vk::Format::UNDEFINED;
        let used = colors.iter().take(MAX_COLOR_ATTACHMENTS).enumerate();
        UsedAttachments {
            colors: (used.filter(|(_, format)| is_used(**format)))
                .fold(0, |bits, (index, _)| bits | 1 << index),
            depth: rendering.is_some_and(|it| is_used(it.depth_attachment_format)),
            stencil: rendering.is_some_and(|it| is_used(it.stencil_attachment_format)),
        }
    }
}

/// `VkPipelineVertexInputStateCreateInfo`.
///
/// # Safety
/// The info is valid.
unsafe fn vertex_input(info: &vk::PipelineVertexInputStateCreateInfo<'_>) -> VertexInput {
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        let divisors = find::<vk::PipelineVertexInputDivisorStateCreateInfoKHR>(info.p_next);
        let divisors = divisors.map_or(&[][..], |it| {
            slice(
                it.p_vertex_binding_divisors,
                it.vertex_binding_divisor_count,
            )
        });
        let bindings = slice(
            info.p_vertex_binding_descriptions,
            info.vertex_binding_description_count,
        );
        let binding = |it: &vk::VertexInputBindingDescription| VertexBinding {
            binding: it.binding,
            stride_bytes: it.stride,
            per_instance: it.input_rate == vk::VertexInputRate::INSTANCE,
            divisor: (divisors.iter())
                .find(|divisor| divisor.binding == it.binding)
                .map_or(1, |divisor| divisor.divisor),
        };
        let attributes = slice(
            info.p_vertex_attribute_descriptions,
            info.vertex_attribute_description_count,
        );
        let attribute = |it: &vk::VertexInputAttributeDescription| VertexAttribute {
            location: it.location,
            binding: it.binding,
            format: it.format,
            offset_bytes: it.offset,
        };
        VertexInput {
            bindings: bindings.iter().map(binding).collect(),
            attributes: attributes.iter().map(attribute).collect(),
        }
    }
}

/// `VkPipelineRasterizationStateCreateInfo`, and a `VkDepthBiasRepresentationInfoEXT` in its chain.
///
/// # Safety
/// The info is valid.
unsafe fn rasterization(info: &vk::PipelineRasterizationStateCreateInfo<'_>) -> Rasterization {
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        let next = info.p_next;
        let clip = find::<vk::PipelineRasterizationDepthClipStateCreateInfoEXT>(next);
        let line = find::<vk::PipelineRasterizationLineStateCreateInfoKHR>(next);
        let provoking = find::<vk::PipelineRasterizationProvokingVertexStateCreateInfoEXT>(next);
        let stream = find::<vk::PipelineRasterizationStateStreamCreateInfoEXT>(next);
        let bias = find::<vk::DepthBiasRepresentationInfoEXT>(next);
        let usual = Rasterization::default();
        let depth_clamp = info.depth_clamp_enable != vk::FALSE;
        Rasterization {
            discard: info.rasterizer_discard_enable != vk::FALSE,
            depth_clamp,
            depth_clip: clip.map_or(!depth_clamp, |clip| clip.depth_clip_enable != vk::FALSE),
            depth_clip_follows: clip.is_none(),
            polygon_mode: info.polygon_mode,
            cull_mode: info.cull_mode,
            front_face: info.front_face,
            depth_bias: info.depth_bias_enable != vk::FALSE,
            depth_bias_constant: info.depth_bias_constant_factor,
            depth_bias_clamp: info.depth_bias_clamp,
            depth_bias_slope: info.depth_bias_slope_factor,
            depth_bias_representation: bias.map_or(usual.depth_bias_representation, |it| {
                it.depth_bias_representation
            }),
            depth_bias_exact: bias.is_some_and(|it| it.depth_bias_exact != vk::FALSE),
            line_width: info.line_width,
            line_mode: line.map_or(usual.line_mode, |line| line.line_rasterization_mode),
            line_stipple: line.is_some_and(|line| line.stippled_line_enable != vk::FALSE),
            line_stipple_factor: line.map_or(1, |line| line.line_stipple_factor),
            line_stipple_pattern: line.map_or(u16::MAX, |line| line.line_stipple_pattern),
            stream: stream.map_or(0, |it| it.rasterization_stream),
            provoking_last: provoking.is_some_and(|it| {
                it.provoking_vertex_mode == vk::ProvokingVertexModeEXT::LAST_VERTEX
            }),
            negative_one_to_one: false,
            depth_clamp_range: None,
        }
    }
}

/// `VkPipelineViewportStateCreateInfo`; dynamic state is ignored.
///
/// # Safety
/// The info is valid.
unsafe fn viewports(
    info: &vk::PipelineViewportStateCreateInfo<'_>,
    dynamic: DynamicStates,
) -> Viewports {
    use vk::DynamicState as State;
    let is_set = |states: [State; 2]| states.iter().any(|&state| dynamic.contains(state));
    let count = |count: u32| count.min(MAX_VIEWPORTS as u32);
    let mut viewports = Viewports::default();
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        if !is_set([State::VIEWPORT, State::VIEWPORT_WITH_COUNT]) {
            let values = slice(info.p_viewports, count(info.viewport_count));
            viewports.viewports = SmallVec::from_slice(values);
        }
        if !is_set([State::SCISSOR, State::SCISSOR_WITH_COUNT]) {
            let values = slice(info.p_scissors, count(info.scissor_count));
            viewports.scissors = SmallVec::from_slice(values);
        }
    }
    viewports
}

/// The range of a mode of `VK_EXT_depth_clamp_control`; `None` for the viewport's range.
///
/// # Safety
/// The pointer leads to a range if the mode is the user-defined range.
pub unsafe fn depth_clamp_range(
    mode: i32,
    range: *const newer::DepthClampRangeEXT,
) -> Option<[f32; 2]> {
    let is_range = mode == newer::DEPTH_CLAMP_MODE_USER_DEFINED_RANGE_EXT;
    let range = if is_range { range } else { std::ptr::null() };
    // SAFETY: the caller guarantees that the pointer is to a range if the mode is that of a range,
    // else null or anything.
    let range = unsafe { range.as_ref() }?;
    Some([range.min_depth_clamp, range.max_depth_clamp])
}

fn depth_stencil(info: &vk::PipelineDepthStencilStateCreateInfo<'_>) -> DepthStencil {
    let face = |face: &vk::StencilOpState| StencilFace {
        fail: face.fail_op,
        pass: face.pass_op,
        depth_fail: face.depth_fail_op,
        compare: face.compare_op,
        compare_mask: face.compare_mask,
        write_mask: face.write_mask,
        reference: face.reference,
    };
    DepthStencil {
        depth_test: info.depth_test_enable != vk::FALSE,
        depth_write: info.depth_write_enable != vk::FALSE,
        depth_compare: info.depth_compare_op,
        depth_bounds_test: info.depth_bounds_test_enable != vk::FALSE,
        depth_bounds: [info.min_depth_bounds, info.max_depth_bounds],
        stencil_test: info.stencil_test_enable != vk::FALSE,
        stencil: [face(&info.front), face(&info.back)],
    }
}

/// # Safety
/// The info is valid.
unsafe fn multisample(info: &vk::PipelineMultisampleStateCreateInfo<'_>) -> Multisample {
    // SAFETY: the caller guarantees that the info is valid.
    let locations = unsafe {
        let info = find::<vk::PipelineSampleLocationsStateCreateInfoEXT>(info.p_next);
        info.map(|it| {
            let locations = sample_locations(&it.sample_locations_info);
            (it.sample_locations_enable != vk::FALSE, locations)
        })
    };
    let (has_locations, locations) = locations.unwrap_or_default();
    Multisample {
        samples: info.rasterization_samples.as_raw().max(1),
        sample_shading: info.sample_shading_enable != vk::FALSE,
        min_sample_shading: info.min_sample_shading,
        // SAFETY: the caller guarantees that the info is valid.
        sample_mask: unsafe { info.p_sample_mask.as_ref() }
            .copied()
            .unwrap_or(u32::MAX),
        alpha_to_coverage: info.alpha_to_coverage_enable != vk::FALSE,
        alpha_to_one: info.alpha_to_one_enable != vk::FALSE,
        has_locations,
        locations,
    }
}

/// `VkSampleLocationsInfoEXT`: a grid of one pixel.
///
/// # Safety
/// The info is valid.
pub unsafe fn sample_locations(info: &vk::SampleLocationsInfoEXT<'_>) -> SampleLocations {
    // SAFETY: the caller guarantees that the info is valid.
    let given = unsafe { slice(info.p_sample_locations, info.sample_locations_count) };
    let sixteenths = |at: f32| (at * 16.0).round_ties_even().clamp(0.0, 15.0) as u8;
    let mut locations = SampleLocations::default();
    for (place, it) in locations.iter_mut().zip(given) {
        *place = [sixteenths(it.x), sixteenths(it.y)];
    }
    locations
}

/// # Safety
/// The info is valid.
unsafe fn color_blend(info: &vk::PipelineColorBlendStateCreateInfo<'_>) -> ColorBlend {
    // SAFETY: the caller guarantees that the info is valid.
    let (attachments, enables) = unsafe {
        let enables = find::<vk::PipelineColorWriteCreateInfoEXT>(info.p_next);
        let enables = enables.map_or(&[][..], |it| {
            slice(it.p_color_write_enables, it.attachment_count)
        });
        (slice(info.p_attachments, info.attachment_count), enables)
    };
    // SAFETY: the caller guarantees that the info is valid.
    let advanced = unsafe { find::<vk::PipelineColorBlendAdvancedStateCreateInfoEXT>(info.p_next) };
    let advanced = advanced.map_or_else(AdvancedBlend::default, |it| AdvancedBlend {
        source_premultiplied: it.src_premultiplied != vk::FALSE,
        destination_premultiplied: it.dst_premultiplied != vk::FALSE,
        overlap: it.blend_overlap,
        clamps: false,
    });
    let attachment = |it: &vk::PipelineColorBlendAttachmentState| BlendAttachment {
        enable: it.blend_enable != vk::FALSE,
        src_color: it.src_color_blend_factor,
        dst_color: it.dst_color_blend_factor,
        color_op: it.color_blend_op,
        src_alpha: it.src_alpha_blend_factor,
        dst_alpha: it.dst_alpha_blend_factor,
        alpha_op: it.alpha_blend_op,
        write_mask: it.color_write_mask,
        advanced,
    };
    ColorBlend {
        logic_op: (info.logic_op_enable != vk::FALSE).then_some(info.logic_op),
        set_logic_op: info.logic_op,
        attachments: std::array::from_fn(|index| {
            attachments
                .get(index)
                .map_or_else(BlendAttachment::default, attachment)
        }),
        write_enable: color_write_enables(enables),
        constants: info.blend_constants,
    }
}

/// `VkPipelineColorWriteCreateInfoEXT`: a bit for each attachment. Attachments without an entry are
/// written.
pub fn color_write_enables(enables: &[vk::Bool32]) -> u32 {
    let off = (enables.iter().take(32).enumerate()).filter(|(_, enable)| **enable == vk::FALSE);
    off.fold(u32::MAX, |bits, (index, _)| bits & !(1 << index))
}

/// `VkRenderingAttachmentLocationInfo`, inverted: the attachment of each location.
///
/// # Safety
/// The info is valid.
pub unsafe fn color_locations(info: &vk::RenderingAttachmentLocationInfoKHR<'_>) -> ColorLocations {
    let count = info
        .color_attachment_count
        .min(MAX_COLOR_ATTACHMENTS as u32);
    if info.p_color_attachment_locations.is_null() {
        return own_locations();
    }
    // SAFETY: the caller guarantees that the info is valid.
    let given = unsafe { slice(info.p_color_attachment_locations, count) };
    let mut locations = [vk::ATTACHMENT_UNUSED; MAX_COLOR_ATTACHMENTS];
    for (attachment, &location) in (0..).zip(given) {
        if let Some(place) = locations.get_mut(location as usize) {
            *place = attachment;
        }
    }
    locations
}

/// The vertex input state of `vkCmdSetVertexInputEXT`.
pub fn dynamic_vertex_input(
    bindings: &[vk::VertexInputBindingDescription2EXT<'_>],
    attributes: &[vk::VertexInputAttributeDescription2EXT<'_>],
) -> VertexInput {
    let binding = |it: &vk::VertexInputBindingDescription2EXT<'_>| VertexBinding {
        binding: it.binding,
        stride_bytes: it.stride,
        per_instance: it.input_rate == vk::VertexInputRate::INSTANCE,
        divisor: it.divisor,
    };
    let attribute = |it: &vk::VertexInputAttributeDescription2EXT<'_>| VertexAttribute {
        location: it.location,
        binding: it.binding,
        format: it.format,
        offset_bytes: it.offset,
    };
    VertexInput {
        bindings: bindings.iter().map(binding).collect(),
        attributes: attributes.iter().map(attribute).collect(),
    }
}
