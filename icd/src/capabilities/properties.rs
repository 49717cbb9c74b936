//! `VkPhysicalDeviceProperties2` and the structures that extend it. A value that several structures
//! share is written once, in the core one.

mod structures;

use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::descriptor_heap::DESCRIPTOR_BYTES;
use spirv_jit::environment::{Descriptor, MAX_SETS};
use spirv_jit::program::{MAX_FEEDBACK_BUFFERS, MAX_STREAMS};

use super::limits::{self, API_VERSION, CAPTURE_BYTES, HANDLE_SIZE};
use crate::ffi::{array, vk};
use crate::settings;

pub use structures::fill_chain;

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

/// Identifies the form of pipeline cache data: it changes with the compiler's sources.
pub fn pipeline_cache_uuid() -> [u8; vk::UUID_SIZE] {
    let mut uuid = *b"tuff/00000000000";
    // The build script's hash of the compiler's sources.
    for (digit, byte) in uuid[5..].iter_mut().zip(env!("TUFF_COMPILER_HASH").bytes()) {
        *digit = byte;
    }
    uuid
}

/// Numbers of no registry: the driver claims no registered vendor or device.
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
        // No registered driver, and no conformance except the version that the user asks for.
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
        shader_denorm_flush_to_zero_float32: vk::TRUE,
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

/// All members except the layouts for host copies, which [`fill_chain`] writes.
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

/// No part of a heap is reserved, and all descriptors have the same size.
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
        max_transform_feedback_buffers: MAX_FEEDBACK_BUFFERS as u32,
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
