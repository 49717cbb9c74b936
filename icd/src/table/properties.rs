//! `VkPhysicalDeviceProperties2` and what extends it. What several structures say is written once,
//! in the core ones.

use ash::vk::TaggedStructure;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::abort::MAX_MESSAGE_BYTES;
use spirv_jit::environment::{Descriptor, MAX_SETS};
use spirv_jit::heap::DESCRIPTOR_BYTES;
use spirv_jit::ir::op::VectorProduct;
use spirv_jit::program::{MAX_CAPTURE_BUFFERS, MAX_STREAMS};

use super::limits::{self, API_VERSION, CAPTURE_BYTES, HANDLE_SIZE};
use crate::ffi::{array, chain, enumerate, vk};
use crate::settings;

/// Stages whose shaders may use subgroup operations.
const SUBGROUP_STAGES: vk::ShaderStageFlags = vk::ShaderStageFlags::from_raw(
    vk::ShaderStageFlags::COMPUTE.as_raw()
        | vk::ShaderStageFlags::RAYGEN_KHR.as_raw()
        | vk::ShaderStageFlags::ANY_HIT_KHR.as_raw()
        | vk::ShaderStageFlags::CLOSEST_HIT_KHR.as_raw()
        | vk::ShaderStageFlags::MISS_KHR.as_raw()
        | vk::ShaderStageFlags::INTERSECTION_KHR.as_raw()
        | vk::ShaderStageFlags::CALLABLE_KHR.as_raw()
        | vk::ShaderStageFlags::VERTEX.as_raw()
        | vk::ShaderStageFlags::TESSELLATION_CONTROL.as_raw()
        | vk::ShaderStageFlags::TESSELLATION_EVALUATION.as_raw()
        | vk::ShaderStageFlags::GEOMETRY.as_raw()
        | vk::ShaderStageFlags::TASK_EXT.as_raw()
        | vk::ShaderStageFlags::MESH_EXT.as_raw()
        | vk::ShaderStageFlags::FRAGMENT.as_raw(),
);

/// Identifies the driver: the same for every machine and run of one version.
const DRIVER_UUID: [u8; vk::UUID_SIZE] = *b"tuff-driver-0001";

/// Identifies the device: the host CPU as this driver presents it.
const DEVICE_UUID: [u8; vk::UUID_SIZE] = *b"tuff-cpu-device1";

/// Names the form of pipeline cache data: programs of another compiler are not this one's.
pub fn pipeline_cache_uuid() -> [u8; vk::UUID_SIZE] {
    let mut uuid = *b"tuff/00000000000";
    // The build script's hash of the compiler's sources.
    for (digit, byte) in uuid[5..].iter_mut().zip(env!("TUFF_COMPILER_HASH").bytes()) {
        *digit = byte;
    }
    uuid
}

/// Our own numbers: no vendor and no device of anyone's registry is claimed.
pub const VENDOR_ID: u32 = 0;
pub const DEVICE_ID: u32 = 1;

/// Values that differ between machines and environments.
pub struct Machine {
    pub device_name: String,
    /// Size of the memory heap.
    pub heap_bytes: u64,
}

/// `VkPhysicalDeviceProperties`.
pub fn core(machine: &Machine) -> vk::PhysicalDeviceProperties {
    let mut properties = vk::PhysicalDeviceProperties {
        api_version: API_VERSION,
        driver_version: vk::make_api_version(0, 0, 1, 0),
        vendor_id: VENDOR_ID,
        device_id: DEVICE_ID,
        device_type: vk::PhysicalDeviceType::CPU,
        pipeline_cache_uuid: pipeline_cache_uuid(),
        limits: limits::limits(),
        ..Default::default()
    };
    array::write_text(&mut properties.device_name, &machine.device_name);
    properties
}

fn vulkan11(machine: &Machine) -> vk::PhysicalDeviceVulkan11Properties<'static> {
    vk::PhysicalDeviceVulkan11Properties {
        device_uuid: DEVICE_UUID,
        driver_uuid: DRIVER_UUID,
        device_node_mask: 0,
        device_luid_valid: vk::FALSE,
        subgroup_size: SUBGROUP_SIZE as u32,
        subgroup_supported_stages: SUBGROUP_STAGES,
        subgroup_supported_operations: vk::SubgroupFeatureFlags::BASIC
            | vk::SubgroupFeatureFlags::VOTE
            | vk::SubgroupFeatureFlags::ARITHMETIC
            | vk::SubgroupFeatureFlags::BALLOT
            | vk::SubgroupFeatureFlags::SHUFFLE
            | vk::SubgroupFeatureFlags::SHUFFLE_RELATIVE
            | vk::SubgroupFeatureFlags::CLUSTERED
            | vk::SubgroupFeatureFlags::QUAD
            | vk::SubgroupFeatureFlags::PARTITIONED_NV
            | vk::SubgroupFeatureFlags::ROTATE_KHR
            | vk::SubgroupFeatureFlags::ROTATE_CLUSTERED_KHR,
        subgroup_quad_operations_in_all_stages: vk::TRUE,
        point_clipping_behavior: vk::PointClippingBehavior::ALL_CLIP_PLANES,
        max_multiview_view_count: limits::MAX_VIEWS,
        max_multiview_instance_index: (1 << 27) - 1,
        protected_no_fault: vk::FALSE,
        max_per_set_descriptors: limits::MAX_DESCRIPTORS,
        max_memory_allocation_size: machine.heap_bytes,
        ..Default::default()
    }
}

fn vulkan12() -> vk::PhysicalDeviceVulkan12Properties<'static> {
    const MAX: u32 = limits::MAX_DESCRIPTORS;
    let stencil_resolves =
        vk::ResolveModeFlags::SAMPLE_ZERO | vk::ResolveModeFlags::MIN | vk::ResolveModeFlags::MAX;
    let mut properties = vk::PhysicalDeviceVulkan12Properties {
        // No registered driver, and no conformance is claimed but what the user asks for.
        driver_id: vk::DriverId::from_raw(0),
        conformance_version: settings::checked().map_or_else(
            |_| vk::ConformanceVersion::default(),
            |settings| settings.conformance,
        ),
        denorm_behavior_independence: vk::ShaderFloatControlsIndependence::ALL,
        rounding_mode_independence: vk::ShaderFloatControlsIndependence::ALL,
        shader_signed_zero_inf_nan_preserve_float16: vk::TRUE,
        shader_signed_zero_inf_nan_preserve_float32: vk::TRUE,
        shader_signed_zero_inf_nan_preserve_float64: vk::TRUE,
        shader_denorm_preserve_float16: vk::TRUE,
        shader_denorm_preserve_float32: vk::TRUE,
        shader_denorm_preserve_float64: vk::TRUE,
        shader_rounding_mode_rte_float16: vk::TRUE,
        shader_rounding_mode_rte_float32: vk::TRUE,
        shader_rounding_mode_rte_float64: vk::TRUE,
        max_update_after_bind_descriptors_in_all_pools: u32::MAX,
        shader_uniform_buffer_array_non_uniform_indexing_native: vk::TRUE,
        shader_sampled_image_array_non_uniform_indexing_native: vk::TRUE,
        shader_storage_buffer_array_non_uniform_indexing_native: vk::TRUE,
        shader_storage_image_array_non_uniform_indexing_native: vk::TRUE,
        shader_input_attachment_array_non_uniform_indexing_native: vk::TRUE,
        robust_buffer_access_update_after_bind: vk::TRUE,
        quad_divergent_implicit_lod: vk::FALSE,
        max_per_stage_descriptor_update_after_bind_samplers: MAX,
        max_per_stage_descriptor_update_after_bind_uniform_buffers: MAX,
        max_per_stage_descriptor_update_after_bind_storage_buffers: MAX,
        max_per_stage_descriptor_update_after_bind_sampled_images: MAX,
        max_per_stage_descriptor_update_after_bind_storage_images: MAX,
        max_per_stage_descriptor_update_after_bind_input_attachments: MAX,
        max_per_stage_update_after_bind_resources: MAX,
        max_descriptor_set_update_after_bind_samplers: MAX,
        max_descriptor_set_update_after_bind_uniform_buffers: MAX,
        max_descriptor_set_update_after_bind_uniform_buffers_dynamic: limits::MAX_DYNAMIC_BUFFERS,
        max_descriptor_set_update_after_bind_storage_buffers: MAX,
        max_descriptor_set_update_after_bind_storage_buffers_dynamic: limits::MAX_DYNAMIC_BUFFERS,
        max_descriptor_set_update_after_bind_sampled_images: MAX,
        max_descriptor_set_update_after_bind_storage_images: MAX,
        max_descriptor_set_update_after_bind_input_attachments: MAX,
        supported_depth_resolve_modes: stencil_resolves | vk::ResolveModeFlags::AVERAGE,
        supported_stencil_resolve_modes: stencil_resolves,
        independent_resolve_none: vk::TRUE,
        independent_resolve: vk::TRUE,
        filter_minmax_single_component_formats: vk::TRUE,
        filter_minmax_image_component_mapping: vk::TRUE,
        max_timeline_semaphore_value_difference: u64::MAX,
        framebuffer_integer_color_sample_counts: limits::SAMPLE_COUNTS,
        ..Default::default()
    };
    array::write_text(&mut properties.driver_name, "Tuff");
    array::write_text(
        &mut properties.driver_info,
        concat!(
            "Tuff ",
            env!("CARGO_PKG_VERSION"),
            ", ray tracing on the CPU"
        ),
    );
    properties
}

fn vulkan13() -> vk::PhysicalDeviceVulkan13Properties<'static> {
    vk::PhysicalDeviceVulkan13Properties {
        min_subgroup_size: SUBGROUP_SIZE as u32,
        max_subgroup_size: SUBGROUP_SIZE as u32,
        max_compute_workgroup_subgroups: limits::MAX_WORKGROUP_INVOCATIONS / SUBGROUP_SIZE as u32,
        required_subgroup_size_stages: vk::ShaderStageFlags::COMPUTE
            | vk::ShaderStageFlags::VERTEX
            | vk::ShaderStageFlags::TESSELLATION_CONTROL
            | vk::ShaderStageFlags::TESSELLATION_EVALUATION
            | vk::ShaderStageFlags::GEOMETRY
            | vk::ShaderStageFlags::TASK_EXT
            | vk::ShaderStageFlags::MESH_EXT
            | vk::ShaderStageFlags::FRAGMENT,
        max_inline_uniform_block_size: limits::MAX_INLINE_UNIFORM_BYTES,
        max_per_stage_descriptor_inline_uniform_blocks: 256,
        max_per_stage_descriptor_update_after_bind_inline_uniform_blocks: 256,
        max_descriptor_set_inline_uniform_blocks: 256,
        max_descriptor_set_update_after_bind_inline_uniform_blocks: 256,
        max_inline_uniform_total_size: 256 * limits::MAX_INLINE_UNIFORM_BYTES,
        storage_texel_buffer_offset_alignment_bytes: 1,
        storage_texel_buffer_offset_single_texel_alignment: vk::TRUE,
        uniform_texel_buffer_offset_alignment_bytes: 1,
        uniform_texel_buffer_offset_single_texel_alignment: vk::TRUE,
        max_buffer_size: limits::MAX_BUFFER_BYTES,
        ..Default::default()
    }
}

/// All but what [`copy_layouts`] gives.
fn vulkan14() -> vk::PhysicalDeviceVulkan14Properties<'static> {
    use vk::PipelineRobustnessBufferBehaviorEXT as Buffers;
    vk::PhysicalDeviceVulkan14Properties {
        line_sub_pixel_precision_bits: limits::SUB_PIXEL_BITS,
        max_vertex_attrib_divisor: u32::MAX,
        supports_non_zero_first_instance: vk::TRUE,
        max_push_descriptors: limits::MAX_PUSH_DESCRIPTORS,
        dynamic_rendering_local_read_depth_stencil_attachments: vk::TRUE,
        dynamic_rendering_local_read_multisampled_attachments: vk::TRUE,
        depth_stencil_swizzle_one_support: vk::TRUE,
        block_texel_view_compatible_multiple_layers: vk::TRUE,
        max_combined_image_sampler_descriptor_count: 1,
        default_robustness_storage_buffers: Buffers::ROBUST_BUFFER_ACCESS_2,
        default_robustness_uniform_buffers: Buffers::ROBUST_BUFFER_ACCESS_2,
        default_robustness_vertex_inputs: Buffers::ROBUST_BUFFER_ACCESS_2,
        default_robustness_images: vk::PipelineRobustnessImageBehaviorEXT::ROBUST_IMAGE_ACCESS_2,
        ..Default::default()
    }
}

fn acceleration_structure() -> vk::PhysicalDeviceAccelerationStructurePropertiesKHR<'static> {
    vk::PhysicalDeviceAccelerationStructurePropertiesKHR {
        max_geometry_count: limits::MAX_GEOMETRIES,
        max_instance_count: limits::MAX_GEOMETRIES,
        max_primitive_count: limits::MAX_PRIMITIVES,
        max_per_stage_descriptor_acceleration_structures: limits::MAX_DESCRIPTORS,
        max_per_stage_descriptor_update_after_bind_acceleration_structures: limits::MAX_DESCRIPTORS,
        max_descriptor_set_acceleration_structures: limits::MAX_DESCRIPTORS,
        max_descriptor_set_update_after_bind_acceleration_structures: limits::MAX_DESCRIPTORS,
        min_acceleration_structure_scratch_offset_alignment: limits::SCRATCH_ALIGNMENT,
        ..Default::default()
    }
}

fn ray_tracing_pipeline() -> vk::PhysicalDeviceRayTracingPipelinePropertiesKHR<'static> {
    vk::PhysicalDeviceRayTracingPipelinePropertiesKHR {
        shader_group_handle_size: HANDLE_SIZE as u32,
        max_ray_recursion_depth: limits::MAX_RAY_RECURSION_DEPTH,
        max_shader_group_stride: limits::MAX_SHADER_GROUP_STRIDE,
        shader_group_base_alignment: limits::SHADER_GROUP_BASE_ALIGNMENT,
        shader_group_handle_capture_replay_size: HANDLE_SIZE as u32,
        max_ray_dispatch_invocation_count: limits::MAX_RAY_DISPATCH_INVOCATIONS,
        shader_group_handle_alignment: limits::SHADER_GROUP_HANDLE_ALIGNMENT,
        max_ray_hit_attribute_size: 32,
        ..Default::default()
    }
}

/// The same values as in the KHR structures.
fn ray_tracing_nv() -> vk::PhysicalDeviceRayTracingPropertiesNV<'static> {
    let (structures, pipelines) = (acceleration_structure(), ray_tracing_pipeline());
    vk::PhysicalDeviceRayTracingPropertiesNV {
        shader_group_handle_size: pipelines.shader_group_handle_size,
        max_recursion_depth: pipelines.max_ray_recursion_depth,
        max_shader_group_stride: pipelines.max_shader_group_stride,
        shader_group_base_alignment: pipelines.shader_group_base_alignment,
        max_geometry_count: structures.max_geometry_count,
        max_instance_count: structures.max_instance_count,
        max_triangle_count: structures.max_primitive_count,
        max_descriptor_set_acceleration_structures: structures
            .max_descriptor_set_acceleration_structures,
        ..Default::default()
    }
}

fn descriptor_buffer() -> vk::PhysicalDeviceDescriptorBufferPropertiesEXT<'static> {
    const SIZE: usize = size_of::<Descriptor>();
    const SETS: u32 = MAX_SETS as u32;
    const RANGE: u64 = limits::MAX_BUFFER_BYTES;
    vk::PhysicalDeviceDescriptorBufferPropertiesEXT {
        combined_image_sampler_descriptor_single_array: vk::TRUE,
        bufferless_push_descriptors: vk::TRUE,
        allow_sampler_image_view_post_submit_creation: vk::TRUE,
        descriptor_buffer_offset_alignment: SIZE as u64,
        max_descriptor_buffer_bindings: SETS,
        max_resource_descriptor_buffer_bindings: SETS,
        max_sampler_descriptor_buffer_bindings: SETS,
        max_embedded_immutable_sampler_bindings: SETS,
        max_embedded_immutable_samplers: u32::MAX,
        buffer_capture_replay_descriptor_data_size: CAPTURE_BYTES,
        image_capture_replay_descriptor_data_size: CAPTURE_BYTES,
        image_view_capture_replay_descriptor_data_size: CAPTURE_BYTES,
        sampler_capture_replay_descriptor_data_size: CAPTURE_BYTES,
        acceleration_structure_capture_replay_descriptor_data_size: CAPTURE_BYTES,
        sampler_descriptor_size: SIZE,
        combined_image_sampler_descriptor_size: SIZE,
        sampled_image_descriptor_size: SIZE,
        storage_image_descriptor_size: SIZE,
        uniform_texel_buffer_descriptor_size: SIZE,
        robust_uniform_texel_buffer_descriptor_size: SIZE,
        storage_texel_buffer_descriptor_size: SIZE,
        robust_storage_texel_buffer_descriptor_size: SIZE,
        uniform_buffer_descriptor_size: SIZE,
        robust_uniform_buffer_descriptor_size: SIZE,
        storage_buffer_descriptor_size: SIZE,
        robust_storage_buffer_descriptor_size: SIZE,
        input_attachment_descriptor_size: SIZE,
        acceleration_structure_descriptor_size: SIZE,
        max_sampler_descriptor_buffer_range: RANGE,
        max_resource_descriptor_buffer_range: RANGE,
        sampler_descriptor_buffer_address_space_size: RANGE,
        resource_descriptor_buffer_address_space_size: RANGE,
        descriptor_buffer_address_space_size: RANGE,
        ..Default::default()
    }
}

/// Nothing of a heap is reserved, and all descriptors have one size.
fn descriptor_heap() -> vk::PhysicalDeviceDescriptorHeapPropertiesEXT<'static> {
    const SIZE: u64 = DESCRIPTOR_BYTES as u64;
    const MAX_HEAP_BYTES: u64 = 1 << 30;
    vk::PhysicalDeviceDescriptorHeapPropertiesEXT {
        sampler_heap_alignment: SIZE,
        resource_heap_alignment: SIZE,
        max_sampler_heap_size: MAX_HEAP_BYTES,
        max_resource_heap_size: MAX_HEAP_BYTES,
        sampler_descriptor_size: SIZE,
        image_descriptor_size: SIZE,
        buffer_descriptor_size: SIZE,
        sampler_descriptor_alignment: SIZE,
        image_descriptor_alignment: SIZE,
        buffer_descriptor_alignment: SIZE,
        max_push_data_size: limits::MAX_PUSH_CONSTANTS_BYTES.into(),
        image_capture_replay_opaque_data_size: CAPTURE_BYTES,
        max_descriptor_heap_embedded_samplers: limits::MAX_EMBEDDED_SAMPLERS,
        sampler_ycbcr_conversion_count: 1,
        sparse_descriptor_heaps: vk::TRUE,
        ..Default::default()
    }
}

fn mesh_shader() -> vk::PhysicalDeviceMeshShaderPropertiesEXT<'static> {
    let payload_bytes = limits::MAX_TASK_PAYLOAD_BYTES;
    let all_bytes = payload_bytes + limits::MAX_SHARED_BYTES;
    let size = [limits::MAX_WORKGROUP_INVOCATIONS; 3];
    vk::PhysicalDeviceMeshShaderPropertiesEXT {
        max_task_work_group_total_count: limits::MAX_MESH_WORKGROUPS,
        max_task_work_group_count: [limits::MAX_MESH_WORKGROUPS; 3],
        max_task_work_group_invocations: limits::MAX_WORKGROUP_INVOCATIONS,
        max_task_work_group_size: size,
        max_task_payload_size: payload_bytes,
        max_task_shared_memory_size: limits::MAX_SHARED_BYTES,
        max_task_payload_and_shared_memory_size: all_bytes,
        max_mesh_work_group_total_count: limits::MAX_MESH_WORKGROUPS,
        max_mesh_work_group_count: [limits::MAX_MESH_WORKGROUPS; 3],
        max_mesh_work_group_invocations: limits::MAX_WORKGROUP_INVOCATIONS,
        max_mesh_work_group_size: size,
        max_mesh_shared_memory_size: limits::MAX_SHARED_BYTES,
        max_mesh_payload_and_shared_memory_size: all_bytes,
        max_mesh_output_memory_size: limits::MAX_SHARED_BYTES,
        max_mesh_payload_and_output_memory_size: all_bytes,
        max_mesh_output_components: 128,
        max_mesh_output_vertices: limits::MAX_MESH_ELEMENTS,
        max_mesh_output_primitives: limits::MAX_MESH_ELEMENTS,
        max_mesh_output_layers: limits::MAX_IMAGE_ARRAY_LAYERS,
        max_mesh_multiview_view_count: limits::MAX_VIEWS,
        mesh_output_per_vertex_granularity: 1,
        mesh_output_per_primitive_granularity: 1,
        max_preferred_task_work_group_invocations: limits::PREFERRED_WORKGROUP_INVOCATIONS,
        max_preferred_mesh_work_group_invocations: limits::PREFERRED_WORKGROUP_INVOCATIONS,
        prefers_local_invocation_vertex_output: vk::FALSE,
        prefers_local_invocation_primitive_output: vk::FALSE,
        prefers_compact_vertex_output: vk::FALSE,
        prefers_compact_primitive_output: vk::FALSE,
        ..Default::default()
    }
}

fn fragment_shading_rate() -> vk::PhysicalDeviceFragmentShadingRatePropertiesKHR<'static> {
    let square = |side| vk::Extent2D {
        width: side,
        height: side,
    };
    let texel = square(limits::RATE_TEXEL);
    vk::PhysicalDeviceFragmentShadingRatePropertiesKHR {
        min_fragment_shading_rate_attachment_texel_size: texel,
        max_fragment_shading_rate_attachment_texel_size: texel,
        max_fragment_shading_rate_attachment_texel_size_aspect_ratio: 1,
        layered_shading_rate_attachments: vk::TRUE,
        primitive_fragment_shading_rate_with_multiple_viewports: vk::TRUE,
        fragment_shading_rate_non_trivial_combiner_ops: vk::TRUE,
        max_fragment_size: square(limits::MAX_FRAGMENT_SIDE),
        max_fragment_size_aspect_ratio: 2,
        max_fragment_shading_rate_coverage_samples: limits::MAX_COVERAGE_SAMPLES,
        max_fragment_shading_rate_rasterization_samples: vk::SampleCountFlags::TYPE_8,
        fragment_shading_rate_with_shader_depth_stencil_writes: vk::TRUE,
        fragment_shading_rate_with_sample_mask: vk::TRUE,
        fragment_shading_rate_with_shader_sample_mask: vk::TRUE,
        fragment_shading_rate_with_fragment_shader_interlock: vk::TRUE,
        fragment_shading_rate_with_custom_sample_locations: vk::TRUE,
        fragment_shading_rate_strict_multiply_combiner: vk::TRUE,
        ..Default::default()
    }
}

fn transform_feedback() -> vk::PhysicalDeviceTransformFeedbackPropertiesEXT<'static> {
    vk::PhysicalDeviceTransformFeedbackPropertiesEXT {
        max_transform_feedback_streams: MAX_STREAMS,
        max_transform_feedback_buffers: MAX_CAPTURE_BUFFERS as u32,
        // Counters have 32 bits.
        max_transform_feedback_buffer_size: u32::MAX.into(),
        max_transform_feedback_stream_data_size: 512,
        max_transform_feedback_buffer_data_size: 512,
        max_transform_feedback_buffer_data_stride: 2048,
        transform_feedback_queries: vk::TRUE,
        transform_feedback_streams_lines_triangles: vk::TRUE,
        transform_feedback_rasterization_stream_select: vk::TRUE,
        transform_feedback_draw: vk::TRUE,
        ..Default::default()
    }
}

fn invocation_reorder() -> vk::PhysicalDeviceRayTracingInvocationReorderPropertiesEXT<'static> {
    vk::PhysicalDeviceRayTracingInvocationReorderPropertiesEXT {
        ray_tracing_invocation_reorder_reordering_hint:
            vk::RayTracingInvocationReorderModeNV::REORDER,
        max_shader_binding_table_record_index: u32::MAX,
        ..Default::default()
    }
}

/// Every layout but `UNDEFINED`.
const COPY_LAYOUTS: [vk::ImageLayout; 21] = [
    vk::ImageLayout::GENERAL,
    vk::ImageLayout::PREINITIALIZED,
    vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
    vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
    vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL,
    vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
    vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
    vk::ImageLayout::TRANSFER_DST_OPTIMAL,
    vk::ImageLayout::DEPTH_READ_ONLY_STENCIL_ATTACHMENT_OPTIMAL,
    vk::ImageLayout::DEPTH_ATTACHMENT_STENCIL_READ_ONLY_OPTIMAL,
    vk::ImageLayout::DEPTH_ATTACHMENT_OPTIMAL,
    vk::ImageLayout::DEPTH_READ_ONLY_OPTIMAL,
    vk::ImageLayout::STENCIL_ATTACHMENT_OPTIMAL,
    vk::ImageLayout::STENCIL_READ_ONLY_OPTIMAL,
    vk::ImageLayout::READ_ONLY_OPTIMAL,
    vk::ImageLayout::ATTACHMENT_OPTIMAL,
    vk::ImageLayout::RENDERING_LOCAL_READ_KHR,
    vk::ImageLayout::ATTACHMENT_FEEDBACK_LOOP_OPTIMAL_EXT,
    vk::ImageLayout::PRESENT_SRC_KHR,
    vk::ImageLayout::SHARED_PRESENT_KHR,
    vk::ImageLayout::FRAGMENT_SHADING_RATE_ATTACHMENT_OPTIMAL_KHR,
];

/// The host copy layouts of [`vulkan14`] and `VkPhysicalDeviceHostImageCopyProperties`: counted
/// arrays of layouts, each filled if there is one.
macro_rules! copy_layouts {
    ($out:expr) => {{
        let out = $out;
        // Too few elements are no error here.
        let (count, layouts) = (&mut out.copy_src_layout_count, out.p_copy_src_layouts);
        let _ = enumerate(count, layouts, COPY_LAYOUTS.into_iter());
        let (count, layouts) = (&mut out.copy_dst_layout_count, out.p_copy_dst_layouts);
        let _ = enumerate(count, layouts, COPY_LAYOUTS.into_iter());
        // All tilings are stored linearly.
        out.optimal_tiling_layout_uuid = *b"tuff-image-rows1";
        out.identical_memory_type_requirements = vk::TRUE;
    }};
}

/// Answers structures: `Type(source) { field, field: source_field, … }` copies fields,
/// `Type(source)` all of them.
macro_rules! answer {
    ($node:expr; $($structure:ident($source:expr) $({$($field:ident $(: $from:ident)?),* $(,)?})?;)*) => {
        match (*$node).s_type {
            $(<vk::$structure<'_> as vk::TaggedStructure>::STRUCTURE_TYPE => {
                #[allow(unused_mut)]
                let mut source = $source;
                let out = &mut *$node.cast::<vk::$structure<'_>>();
                answer!(@copy out source $({$($field $(: $from)?),*})?);
            })*
            _ => {}
        }
    };
    (@copy $out:ident $source:ident {$($field:ident $(: $from:ident)?),*}) => {
        $($out.$field = answer!(@field $source $field $($from)?);)*
    };
    (@copy $out:ident $source:ident) => {
        $source.p_next = $out.p_next;
        *$out = $source;
    };
    (@field $source:ident $field:ident $from:ident) => { $source.$from };
    (@field $source:ident $field:ident) => { $source.$field };
}

/// Answers every property structure of an output chain.
///
/// # Safety
/// As [`chain::nodes_mut`].
pub unsafe fn fill_chain(machine: &Machine, next: *mut std::ffi::c_void) {
    // SAFETY: the caller's promise; the type word says what a structure is.
    unsafe {
        for node in chain::nodes_mut(next) {
            fill(machine, node);
        }
    }
}

/// # Safety
/// `node` is a structure of the type that its `sType` says.
unsafe fn fill(machine: &Machine, node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's promise.
    unsafe {
        let ty = (*node).s_type;
        if ty == vk::PhysicalDeviceHostImageCopyPropertiesEXT::STRUCTURE_TYPE {
            copy_layouts!(&mut *node.cast::<vk::PhysicalDeviceHostImageCopyPropertiesEXT<'_>>());
        } else if ty == vk::PhysicalDeviceVulkan14Properties::STRUCTURE_TYPE {
            copy_layouts!(&mut *node.cast::<vk::PhysicalDeviceVulkan14Properties<'_>>());
        }
        answer! { node;
            PhysicalDeviceVulkan11Properties(vulkan11(machine));
            PhysicalDeviceVulkan12Properties(vulkan12());
            PhysicalDeviceVulkan13Properties(vulkan13());
            PhysicalDeviceVulkan14Properties(vulkan14()) {
                line_sub_pixel_precision_bits, max_vertex_attrib_divisor, supports_non_zero_first_instance, max_push_descriptors,
                dynamic_rendering_local_read_depth_stencil_attachments, dynamic_rendering_local_read_multisampled_attachments,
                early_fragment_multisample_coverage_after_sample_counting, early_fragment_sample_mask_test_before_sample_counting,
                depth_stencil_swizzle_one_support, polygon_mode_point_size,
                non_strict_single_pixel_wide_lines_use_parallelogram, non_strict_wide_lines_use_parallelogram,
                block_texel_view_compatible_multiple_layers, max_combined_image_sampler_descriptor_count,
                fragment_shading_rate_clamp_combiner_inputs,
                default_robustness_storage_buffers, default_robustness_uniform_buffers, default_robustness_vertex_inputs,
                default_robustness_images,
            };
            PhysicalDeviceIDProperties(vulkan11(machine)) {
                device_uuid, driver_uuid, device_luid, device_node_mask, device_luid_valid,
            };
            PhysicalDeviceSubgroupProperties(vulkan11(machine)) {
                subgroup_size,
                supported_stages: subgroup_supported_stages,
                supported_operations: subgroup_supported_operations,
                quad_operations_in_all_stages: subgroup_quad_operations_in_all_stages,
            };
            PhysicalDevicePointClippingProperties(vulkan11(machine)) { point_clipping_behavior };
            PhysicalDeviceMultiviewProperties(vulkan11(machine)) { max_multiview_view_count, max_multiview_instance_index };
            PhysicalDeviceProtectedMemoryProperties(vulkan11(machine)) { protected_no_fault };
            PhysicalDeviceMaintenance3Properties(vulkan11(machine)) { max_per_set_descriptors, max_memory_allocation_size };
            PhysicalDeviceDriverProperties(vulkan12()) { driver_id, driver_name, driver_info, conformance_version };
            PhysicalDeviceFloatControlsProperties(vulkan12()) {
                denorm_behavior_independence, rounding_mode_independence,
                shader_signed_zero_inf_nan_preserve_float16, shader_signed_zero_inf_nan_preserve_float32,
                shader_signed_zero_inf_nan_preserve_float64,
                shader_denorm_preserve_float16, shader_denorm_preserve_float32, shader_denorm_preserve_float64,
                shader_denorm_flush_to_zero_float16, shader_denorm_flush_to_zero_float32, shader_denorm_flush_to_zero_float64,
                shader_rounding_mode_rte_float16, shader_rounding_mode_rte_float32, shader_rounding_mode_rte_float64,
                shader_rounding_mode_rtz_float16, shader_rounding_mode_rtz_float32, shader_rounding_mode_rtz_float64,
            };
            PhysicalDeviceDescriptorIndexingProperties(vulkan12()) {
                max_update_after_bind_descriptors_in_all_pools,
                shader_uniform_buffer_array_non_uniform_indexing_native,
                shader_sampled_image_array_non_uniform_indexing_native,
                shader_storage_buffer_array_non_uniform_indexing_native,
                shader_storage_image_array_non_uniform_indexing_native,
                shader_input_attachment_array_non_uniform_indexing_native,
                robust_buffer_access_update_after_bind, quad_divergent_implicit_lod,
                max_per_stage_descriptor_update_after_bind_samplers,
                max_per_stage_descriptor_update_after_bind_uniform_buffers,
                max_per_stage_descriptor_update_after_bind_storage_buffers,
                max_per_stage_descriptor_update_after_bind_sampled_images,
                max_per_stage_descriptor_update_after_bind_storage_images,
                max_per_stage_descriptor_update_after_bind_input_attachments,
                max_per_stage_update_after_bind_resources,
                max_descriptor_set_update_after_bind_samplers,
                max_descriptor_set_update_after_bind_uniform_buffers,
                max_descriptor_set_update_after_bind_uniform_buffers_dynamic,
                max_descriptor_set_update_after_bind_storage_buffers,
                max_descriptor_set_update_after_bind_storage_buffers_dynamic,
                max_descriptor_set_update_after_bind_sampled_images,
                max_descriptor_set_update_after_bind_storage_images,
                max_descriptor_set_update_after_bind_input_attachments,
            };
            PhysicalDeviceDepthStencilResolveProperties(vulkan12()) {
                supported_depth_resolve_modes, supported_stencil_resolve_modes, independent_resolve_none, independent_resolve,
            };
            PhysicalDeviceSamplerFilterMinmaxProperties(vulkan12()) {
                filter_minmax_single_component_formats, filter_minmax_image_component_mapping,
            };
            PhysicalDeviceTimelineSemaphoreProperties(vulkan12()) { max_timeline_semaphore_value_difference };
            PhysicalDeviceSubgroupSizeControlProperties(vulkan13()) {
                min_subgroup_size, max_subgroup_size, max_compute_workgroup_subgroups, required_subgroup_size_stages,
            };
            PhysicalDeviceInlineUniformBlockProperties(vulkan13()) {
                max_inline_uniform_block_size, max_per_stage_descriptor_inline_uniform_blocks,
                max_per_stage_descriptor_update_after_bind_inline_uniform_blocks,
                max_descriptor_set_inline_uniform_blocks, max_descriptor_set_update_after_bind_inline_uniform_blocks,
            };
            PhysicalDeviceTexelBufferAlignmentProperties(vulkan13()) {
                storage_texel_buffer_offset_alignment_bytes, storage_texel_buffer_offset_single_texel_alignment,
                uniform_texel_buffer_offset_alignment_bytes, uniform_texel_buffer_offset_single_texel_alignment,
            };
            PhysicalDeviceMaintenance4Properties(vulkan13()) { max_buffer_size };
            PhysicalDeviceShaderIntegerDotProductProperties(vk::PhysicalDeviceShaderIntegerDotProductProperties::default());
            PhysicalDeviceAccelerationStructurePropertiesKHR(acceleration_structure());
            PhysicalDeviceRayTracingPipelinePropertiesKHR(ray_tracing_pipeline());
            PhysicalDeviceRayTracingPropertiesNV(ray_tracing_nv());
            PhysicalDeviceDescriptorBufferPropertiesEXT(descriptor_buffer());
            PhysicalDeviceDescriptorHeapPropertiesEXT(descriptor_heap());
            PhysicalDeviceDescriptorBufferDensityMapPropertiesEXT(vk::PhysicalDeviceDescriptorBufferDensityMapPropertiesEXT {
                combined_image_sampler_density_map_descriptor_size: size_of::<Descriptor>(),
                ..Default::default()
            });
            PhysicalDeviceRayTracingInvocationReorderPropertiesNV(invocation_reorder()) {
                ray_tracing_invocation_reorder_reordering_hint,
            };
            PhysicalDeviceRayTracingInvocationReorderPropertiesEXT(invocation_reorder());
            PhysicalDeviceComputeShaderDerivativesPropertiesKHR(vk::PhysicalDeviceComputeShaderDerivativesPropertiesKHR {
                mesh_and_task_shader_derivatives: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceMeshShaderPropertiesEXT(mesh_shader());
            PhysicalDeviceFragmentShadingRatePropertiesKHR(fragment_shading_rate());
            PhysicalDeviceCooperativeMatrixPropertiesKHR(vk::PhysicalDeviceCooperativeMatrixPropertiesKHR {
                cooperative_matrix_supported_stages: vk::ShaderStageFlags::COMPUTE,
                ..Default::default()
            });
            PhysicalDeviceCooperativeVectorPropertiesNV(vk::PhysicalDeviceCooperativeVectorPropertiesNV {
                cooperative_vector_supported_stages: SUBGROUP_STAGES,
                max_cooperative_vector_components: VectorProduct::MAX_COMPONENTS as u32,
                ..Default::default()
            });
            PhysicalDeviceOpacityMicromapPropertiesEXT(vk::PhysicalDeviceOpacityMicromapPropertiesEXT {
                max_opacity2_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_opacity4_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                ..Default::default()
            });
            // Nothing is lost where an application allows it: levels are the same.
            PhysicalDeviceOpacityMicromapPropertiesKHR(vk::PhysicalDeviceOpacityMicromapPropertiesKHR {
                max_opacity2_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_opacity4_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_opacity_lossy4_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_micromap_triangles: limits::MAX_PRIMITIVES,
                ..Default::default()
            });
            PhysicalDeviceMaintenance5PropertiesKHR(vulkan14()) {
                early_fragment_multisample_coverage_after_sample_counting, early_fragment_sample_mask_test_before_sample_counting,
                depth_stencil_swizzle_one_support, polygon_mode_point_size,
                non_strict_single_pixel_wide_lines_use_parallelogram, non_strict_wide_lines_use_parallelogram,
            };
            PhysicalDevicePushDescriptorPropertiesKHR(vulkan14()) {
                max_push_descriptors,
            };
            PhysicalDeviceExternalMemoryHostPropertiesEXT(vk::PhysicalDeviceExternalMemoryHostPropertiesEXT {
                min_imported_host_pointer_alignment: limits::PAGE_BYTES,
                ..Default::default()
            });
            PhysicalDeviceCustomBorderColorPropertiesEXT(vk::PhysicalDeviceCustomBorderColorPropertiesEXT {
                max_custom_border_color_samplers: u32::MAX,
                ..Default::default()
            });
            PhysicalDeviceRobustness2PropertiesEXT(vk::PhysicalDeviceRobustness2PropertiesEXT {
                robust_storage_buffer_access_size_alignment: 1,
                robust_uniform_buffer_access_size_alignment: 1,
                ..Default::default()
            });
            PhysicalDeviceExtendedDynamicState3PropertiesEXT(vk::PhysicalDeviceExtendedDynamicState3PropertiesEXT {
                dynamic_primitive_topology_unrestricted: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceGraphicsPipelineLibraryPropertiesEXT(vk::PhysicalDeviceGraphicsPipelineLibraryPropertiesEXT {
                graphics_pipeline_library_fast_linking: vk::TRUE,
                graphics_pipeline_library_independent_interpolation_decoration: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceLineRasterizationPropertiesKHR(vulkan14()) {
                line_sub_pixel_precision_bits,
            };
            PhysicalDeviceMaintenance6PropertiesKHR(vulkan14()) {
                block_texel_view_compatible_multiple_layers, max_combined_image_sampler_descriptor_count,
                fragment_shading_rate_clamp_combiner_inputs,
            };
            PhysicalDeviceMaintenance7PropertiesKHR(vk::PhysicalDeviceMaintenance7PropertiesKHR {
                separate_depth_stencil_attachment_access: vk::TRUE,
                max_descriptor_set_total_uniform_buffers_dynamic: limits::MAX_DYNAMIC_BUFFERS,
                max_descriptor_set_total_storage_buffers_dynamic: limits::MAX_DYNAMIC_BUFFERS,
                max_descriptor_set_total_buffers_dynamic: 2 * limits::MAX_DYNAMIC_BUFFERS,
                max_descriptor_set_update_after_bind_total_uniform_buffers_dynamic: limits::MAX_DYNAMIC_BUFFERS,
                max_descriptor_set_update_after_bind_total_storage_buffers_dynamic: limits::MAX_DYNAMIC_BUFFERS,
                max_descriptor_set_update_after_bind_total_buffers_dynamic: 2 * limits::MAX_DYNAMIC_BUFFERS,
                ..Default::default()
            });
            PhysicalDeviceCopyMemoryIndirectPropertiesKHR(vk::PhysicalDeviceCopyMemoryIndirectPropertiesKHR {
                supported_queues: vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE | vk::QueueFlags::TRANSFER,
                ..Default::default()
            });
            PhysicalDeviceMaintenance9PropertiesKHR(vk::PhysicalDeviceMaintenance9PropertiesKHR {
                // Slices are rows of pages like layers.
                image2_d_view_of3_d_sparse: vk::TRUE,
                default_vertex_attribute_value: vk::DefaultVertexAttributeValueKHR::ZERO_ZERO_ZERO_ZERO,
                ..Default::default()
            });
            PhysicalDeviceShaderLongVectorPropertiesEXT(vk::PhysicalDeviceShaderLongVectorPropertiesEXT {
                max_vector_components: limits::MAX_VECTOR_COMPONENTS,
                ..Default::default()
            });
            // Arrivals are counted outside of workgroup memory.
            PhysicalDeviceShaderSplitBarrierPropertiesEXT(
                vk::PhysicalDeviceShaderSplitBarrierPropertiesEXT::default()
            );
            PhysicalDeviceFaultPropertiesKHR(vk::PhysicalDeviceFaultPropertiesKHR {
                max_device_fault_count: limits::MAX_DEVICE_FAULT_COUNT,
                ..Default::default()
            });
            PhysicalDeviceShaderAbortPropertiesKHR(vk::PhysicalDeviceShaderAbortPropertiesKHR {
                max_shader_abort_message_size: MAX_MESSAGE_BYTES,
                ..Default::default()
            });
            PhysicalDeviceMaintenance10PropertiesKHR(vk::PhysicalDeviceMaintenance10PropertiesKHR {
                rgba4_opaque_black_swizzled: vk::TRUE,
                resolve_srgb_format_applies_transfer_function: vk::TRUE,
                resolve_srgb_format_supports_transfer_function_control: vk::TRUE,
                ..Default::default()
            });
            PhysicalDevicePipelineBinaryPropertiesKHR(vk::PhysicalDevicePipelineBinaryPropertiesKHR::default()) {
                pipeline_binary_internal_cache, pipeline_binary_internal_cache_control,
                pipeline_binary_prefers_internal_cache, pipeline_binary_precompiled_internal_cache,
                pipeline_binary_compressed_data,
            };
            PhysicalDeviceLayeredApiPropertiesListKHR(vk::PhysicalDeviceLayeredApiPropertiesListKHR::default()) {
                layered_api_count,
            };
            PhysicalDeviceFragmentShaderBarycentricPropertiesKHR(
                vk::PhysicalDeviceFragmentShaderBarycentricPropertiesKHR::default()
            );
            PhysicalDeviceShaderObjectPropertiesEXT(vk::PhysicalDeviceShaderObjectPropertiesEXT {
                shader_binary_uuid: pipeline_cache_uuid(),
                shader_binary_version: 1,
                ..Default::default()
            });
            PhysicalDeviceMultiDrawPropertiesEXT(vk::PhysicalDeviceMultiDrawPropertiesEXT {
                max_multi_draw_count: u32::MAX,
                ..Default::default()
            });
            PhysicalDeviceNestedCommandBufferPropertiesEXT(vk::PhysicalDeviceNestedCommandBufferPropertiesEXT {
                max_command_buffer_nesting_level: limits::MAX_COMMAND_BUFFER_NESTING,
                ..Default::default()
            });
            PhysicalDevicePipelineRobustnessPropertiesEXT(vulkan14()) {
                default_robustness_storage_buffers, default_robustness_uniform_buffers, default_robustness_vertex_inputs,
                default_robustness_images,
            };
            PhysicalDeviceBlendOperationAdvancedPropertiesEXT(vk::PhysicalDeviceBlendOperationAdvancedPropertiesEXT {
                advanced_blend_max_color_attachments: limits::MAX_COLOR_ATTACHMENTS,
                advanced_blend_independent_blend: vk::TRUE,
                advanced_blend_non_premultiplied_src_color: vk::TRUE,
                advanced_blend_non_premultiplied_dst_color: vk::TRUE,
                advanced_blend_correlated_overlap: vk::TRUE,
                advanced_blend_all_operations: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceLegacyVertexAttributesPropertiesEXT(vk::PhysicalDeviceLegacyVertexAttributesPropertiesEXT {
                native_unaligned_performance: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceSampleLocationsPropertiesEXT(vk::PhysicalDeviceSampleLocationsPropertiesEXT {
                sample_location_sample_counts: limits::SAMPLE_LOCATION_COUNTS,
                max_sample_location_grid_size: vk::Extent2D { width: 1, height: 1 },
                sample_location_coordinate_range: [0.0, 15.0 / 16.0],
                sample_location_sub_pixel_bits: 4,
                variable_sample_locations: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceProvokingVertexPropertiesEXT(vk::PhysicalDeviceProvokingVertexPropertiesEXT {
                provoking_vertex_mode_per_pipeline: vk::TRUE,
                transform_feedback_preserves_triangle_fan_provoking_vertex: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceTransformFeedbackPropertiesEXT(transform_feedback());
            PhysicalDeviceVertexAttributeDivisorPropertiesEXT(vulkan14()) {
                max_vertex_attrib_divisor,
            };
            PhysicalDeviceVertexAttributeDivisorPropertiesKHR(vulkan14()) {
                max_vertex_attrib_divisor, supports_non_zero_first_instance,
            };
        }
    }
}
