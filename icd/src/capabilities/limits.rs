//! The table of limits (chapter Limits, "Required Limits").

#![forbid(unsafe_code)]

use std::sync::OnceLock;

use ash::vk;

use crate::os::address_space::max_mappings;

/// Largest side of an image, for which `images::MAX_LEVELS` is enough.
pub const MAX_IMAGE_DIMENSION: u32 = 16384;
pub const MAX_IMAGE_DIMENSION_3D: u32 = MAX_IMAGE_DIMENSION;
pub const MAX_IMAGE_ARRAY_LAYERS: u32 = 2048;
pub const MAX_PUSH_CONSTANTS_BYTES: u32 = 256;
/// `maxDescriptorHeapEmbeddedSamplers`.
pub const MAX_EMBEDDED_SAMPLERS: u32 = 4096;
/// Descriptors of a type in a set or in a stage. They are array entries, so there is no technical
/// limit.
pub const MAX_DESCRIPTORS: u32 = 1 << 20;
pub const MAX_DYNAMIC_BUFFERS: u32 = 32;
pub const MAX_INLINE_UNIFORM_BYTES: u32 = 4096;
pub const MAX_PUSH_DESCRIPTORS: u32 = 32;
/// `maxVectorComponents`.
pub const MAX_VECTOR_COMPONENTS: u32 = spirv_jit::lower::MAX_VECTOR_COMPONENTS;
pub const MAX_WORKGROUP_INVOCATIONS: u32 = spirv_jit::ir::MAX_INVOCATIONS as u32;
pub const MAX_SHARED_BYTES: u32 = 64 << 10;
/// `maxTaskPayloadSize`.
pub const MAX_TASK_PAYLOAD_BYTES: u32 = 16 << 10;
/// Workgroups of task or mesh shaders, in total and per dimension.
pub const MAX_MESH_WORKGROUPS: u32 = 1 << 22;
/// `maxMeshOutputVertices` and `maxMeshOutputPrimitives`.
pub const MAX_MESH_ELEMENTS: u32 = 256;
/// `maxPreferredMeshWorkGroupInvocations`: a wave.
pub const PREFERRED_WORKGROUP_INVOCATIONS: u32 = 128;
pub const MAX_BUFFER_BYTES: u64 = 1 << 40;
/// Alignment of buffers, images and host pointers in memory.
pub const MEMORY_ALIGNMENT: u64 = 256;
pub const PAGE_BYTES: u64 = 4096;
pub const SAMPLE_COUNTS: vk::SampleCountFlags = vk::SampleCountFlags::from_raw(1 | 2 | 4 | 8);

/// `sampleLocationSampleCounts`: a single sample is at the pixel's center.
pub const SAMPLE_LOCATION_COUNTS: vk::SampleCountFlags = vk::SampleCountFlags::from_raw(2 | 4 | 8);

/// `maxVertexInputAttributes` and `maxVertexInputBindings`.
pub const MAX_VERTEX_INPUTS: u32 = 32;
/// Side in pixels of the square of a shading rate attachment's texel. At least the side of a block
/// of 4×4 fragments, so that a block has one rate.
pub const RATE_TEXEL: u32 = 16;
/// `maxFragmentSize`: a side.
pub const MAX_FRAGMENT_SIDE: u32 = 4;
/// `maxFragmentShadingRateCoverageSamples`.
pub const MAX_COVERAGE_SAMPLES: u32 = 16;
pub const MAX_COLOR_ATTACHMENTS: u32 = 8;
pub const MAX_VIEWPORTS: u32 = 16;
/// `maxMultiviewViewCount`.
pub const MAX_VIEWS: u32 = 6;
/// `subPixelPrecisionBits`.
pub const SUB_PIXEL_BITS: u32 = 8;
/// Pixels.
pub const MAX_POINT_SIZE: f32 = 256.0;
pub const MAX_LINE_WIDTH: f32 = 64.0;
/// `maxTessellationGenerationLevel`.
pub const MAX_TESSELLATION_LEVEL: u32 = 64;
/// `maxCommandBufferNestingLevel`: each level is a nested call on the queue's thread. Reports of a
/// device (`maxDeviceFaultCount`): 64 invalid addresses and the loss.
pub const MAX_DEVICE_FAULT_COUNT: u32 = 65;
pub const MAX_COMMAND_BUFFER_NESTING: u32 = 64;

/// Largest address space of all sparse resources of a device.
pub const SPARSE_ADDRESS_SPACE_BYTES: u64 = 1 << 38;

/// `VkPhysicalDeviceLimits`.
pub fn limits() -> vk::PhysicalDeviceLimits {
    vk::PhysicalDeviceLimits {
        max_image_dimension1_d: MAX_IMAGE_DIMENSION,
        max_image_dimension2_d: MAX_IMAGE_DIMENSION,
        max_image_dimension3_d: MAX_IMAGE_DIMENSION_3D,
        max_image_dimension_cube: MAX_IMAGE_DIMENSION,
        max_image_array_layers: MAX_IMAGE_ARRAY_LAYERS,
        max_texel_buffer_elements: 1 << 27,
        max_uniform_buffer_range: 1 << 30,
        max_storage_buffer_range: u32::MAX,
        max_push_constants_size: MAX_PUSH_CONSTANTS_BYTES,
        max_memory_allocation_count: max_allocations(),
        max_sampler_allocation_count: u32::MAX,
        buffer_image_granularity: 1,
        sparse_address_space_size: SPARSE_ADDRESS_SPACE_BYTES,
        max_bound_descriptor_sets: spirv_jit::environment::MAX_SETS as u32,
        max_per_stage_descriptor_samplers: MAX_DESCRIPTORS,
        max_per_stage_descriptor_uniform_buffers: MAX_DESCRIPTORS,
        max_per_stage_descriptor_storage_buffers: MAX_DESCRIPTORS,
        max_per_stage_descriptor_sampled_images: MAX_DESCRIPTORS,
        max_per_stage_descriptor_storage_images: MAX_DESCRIPTORS,
        max_per_stage_descriptor_input_attachments: MAX_DESCRIPTORS,
        max_per_stage_resources: MAX_DESCRIPTORS,
        max_descriptor_set_samplers: MAX_DESCRIPTORS,
        max_descriptor_set_uniform_buffers: MAX_DESCRIPTORS,
        max_descriptor_set_uniform_buffers_dynamic: MAX_DYNAMIC_BUFFERS,
        max_descriptor_set_storage_buffers: MAX_DESCRIPTORS,
        max_descriptor_set_storage_buffers_dynamic: MAX_DYNAMIC_BUFFERS,
        max_descriptor_set_sampled_images: MAX_DESCRIPTORS,
        max_descriptor_set_storage_images: MAX_DESCRIPTORS,
        max_descriptor_set_input_attachments: MAX_DESCRIPTORS,
        max_vertex_input_attributes: MAX_VERTEX_INPUTS,
        max_vertex_input_bindings: MAX_VERTEX_INPUTS,
        max_vertex_input_attribute_offset: u32::MAX,
        max_vertex_input_binding_stride: 1 << 16,
        max_vertex_output_components: 128,
        max_tessellation_generation_level: MAX_TESSELLATION_LEVEL,
        max_tessellation_patch_size: spirv_jit::ir::tessellation::MAX_PATCH_VERTICES,
        max_tessellation_control_per_vertex_input_components: 128,
        max_tessellation_control_per_vertex_output_components: 128,
        max_tessellation_control_per_patch_output_components: 120,
        max_tessellation_control_total_output_components: 4096,
        max_tessellation_evaluation_input_components: 128,
        max_tessellation_evaluation_output_components: 128,
        max_geometry_shader_invocations: spirv_jit::ir::MAX_GEOMETRY_INVOCATIONS,
        max_geometry_input_components: 128,
        max_geometry_output_components: 256,
        max_geometry_output_vertices: 256,
        max_geometry_total_output_components: 1024,
        max_fragment_input_components: 128,
        max_fragment_output_attachments: MAX_COLOR_ATTACHMENTS,
        max_fragment_combined_output_resources: MAX_DESCRIPTORS,
        max_fragment_dual_src_attachments: 1,
        viewport_sub_pixel_bits: SUB_PIXEL_BITS,
        min_interpolation_offset: -0.5,
        max_interpolation_offset: 0.4375,
        sub_pixel_interpolation_offset_bits: 4,
        max_clip_distances: 8,
        max_cull_distances: 8,
        max_combined_clip_and_cull_distances: 8,
        point_size_granularity: 0.125,
        line_width_granularity: 0.125,
        max_compute_shared_memory_size: MAX_SHARED_BYTES,
        max_compute_work_group_count: [u32::MAX; 3],
        max_compute_work_group_invocations: MAX_WORKGROUP_INVOCATIONS,
        max_compute_work_group_size: [
            MAX_WORKGROUP_INVOCATIONS,
            MAX_WORKGROUP_INVOCATIONS,
            MAX_WORKGROUP_INVOCATIONS,
        ],
        sub_pixel_precision_bits: SUB_PIXEL_BITS,
        sub_texel_precision_bits: 8,
        mipmap_precision_bits: 8,
        max_draw_indexed_index_value: u32::MAX,
        max_draw_indirect_count: u32::MAX,
        max_sampler_lod_bias: 16.0,
        max_sampler_anisotropy: 16.0,
        max_viewports: MAX_VIEWPORTS,
        max_viewport_dimensions: [MAX_IMAGE_DIMENSION; 2],
        viewport_bounds_range: [
            -2.0 * MAX_IMAGE_DIMENSION as f32,
            2.0 * MAX_IMAGE_DIMENSION as f32 - 1.0,
        ],
        min_memory_map_alignment: PAGE_BYTES as usize,
        min_texel_buffer_offset_alignment: 16,
        min_uniform_buffer_offset_alignment: 16,
        min_storage_buffer_offset_alignment: 16,
        min_texel_offset: -32,
        max_texel_offset: 31,
        min_texel_gather_offset: -32,
        max_texel_gather_offset: 31,
        max_framebuffer_width: MAX_IMAGE_DIMENSION,
        max_framebuffer_height: MAX_IMAGE_DIMENSION,
        max_framebuffer_layers: MAX_IMAGE_ARRAY_LAYERS,
        framebuffer_color_sample_counts: SAMPLE_COUNTS,
        framebuffer_depth_sample_counts: SAMPLE_COUNTS,
        framebuffer_stencil_sample_counts: SAMPLE_COUNTS,
        framebuffer_no_attachments_sample_counts: SAMPLE_COUNTS,
        max_color_attachments: MAX_COLOR_ATTACHMENTS,
        sampled_image_color_sample_counts: SAMPLE_COUNTS,
        sampled_image_integer_sample_counts: SAMPLE_COUNTS,
        sampled_image_depth_sample_counts: SAMPLE_COUNTS,
        sampled_image_stencil_sample_counts: SAMPLE_COUNTS,
        storage_image_sample_counts: SAMPLE_COUNTS,
        max_sample_mask_words: 1,
        timestamp_compute_and_graphics: vk::TRUE,
        timestamp_period: 1.0,
        discrete_queue_priorities: 2,
        point_size_range: [1.0, MAX_POINT_SIZE],
        line_width_range: [1.0, MAX_LINE_WIDTH],
        strict_lines: vk::TRUE,
        standard_sample_locations: vk::TRUE,
        optimal_buffer_copy_offset_alignment: 16,
        optimal_buffer_copy_row_pitch_alignment: 16,
        non_coherent_atom_size: 1,
    }
}

/// Geometries and instances of a structure: 24-bit indices.
pub const MAX_GEOMETRIES: u64 = (1 << 24) - 1;
pub const MAX_PRIMITIVES: u64 = (1 << 29) - 1;
/// `minAccelerationStructureScratchOffsetAlignment`.
pub const SCRATCH_ALIGNMENT: u32 = 128;
/// `maxRayRecursionDepth`: recursion uses the heap, never the stack.
pub const MAX_RAY_RECURSION_DEPTH: u32 = 31;

/// `shaderGroupBaseAlignment`.
pub const SHADER_GROUP_BASE_ALIGNMENT: u32 = 64;
/// `shaderGroupHandleAlignment`.
pub const SHADER_GROUP_HANDLE_ALIGNMENT: u32 = 32;
/// `maxShaderGroupStride`.
pub const MAX_SHADER_GROUP_STRIDE: u32 = 1 << 20;

/// `maxRayDispatchInvocationCount`.
pub const MAX_RAY_DISPATCH_INVOCATIONS: u32 = 1 << 30;

/// The identifiers at the head of serialized micromaps.
pub fn micromap_uuids() -> [[u8; 16]; 2] {
    [*b"tuff vulkan cpu\0", *b"tuff micromap  1"]
}

/// The identifiers at the head of serialized acceleration structures: the driver's, and the
/// layout's version.
pub fn serialization_uuids() -> [[u8; 16]; 2] {
    [*b"tuff vulkan cpu\0", *b"tuff structure 2"]
}

/// The API version of instance and device, with the revision of the specification that describes
/// the newest extensions.
pub const API_VERSION: u32 = vk::make_api_version(0, 1, 4, 356);

/// Size of capture data: an object's address, or that of its descriptor.
pub const CAPTURE_BYTES: usize = size_of::<u64>();

/// `shaderGroupHandleSize`.
pub const HANDLE_SIZE: usize = 32;

/// Largest number of allocations of a device. Each may need two of the process's limited mappings,
/// which other libraries use, too.
pub fn max_allocations() -> u32 {
    static MAX: OnceLock<u32> = OnceLock::new();
    *MAX.get_or_init(|| {
        // At least the minimum that Vulkan requires.
        (max_mappings() / 4).max(4096)
    })
}
