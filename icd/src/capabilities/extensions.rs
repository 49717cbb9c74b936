//! The table of extensions. Every listed extension works. Promoted ones are listed too, because
//! applications enable them by name.

#![forbid(unsafe_code)]

use std::ffi::CStr;

use crate::os;

macro_rules! extensions {
    ($($kind:ident $variant:ident $name:literal $version:literal;)*) => {
        /// A supported extension.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[allow(non_camel_case_types)]
        pub enum Extension {
            $($variant,)*
        }

        impl Extension {
            /// All extensions, with those of other systems.
            pub const ALL: &[Extension] = &[$(Extension::$variant,)*];

            /// The extension's name.
            pub fn name(self) -> &'static CStr {
                match self {
                    $(Extension::$variant => $name,)*
                }
            }

            /// The implemented revision (`specVersion`).
            pub fn version(self) -> u32 {
                match self {
                    $(Extension::$variant => $version,)*
                }
            }

            /// Whether instances or devices enable it.
            pub fn kind(self) -> Kind {
                match self {
                    $(Extension::$variant => Kind::$kind,)*
                }
            }
        }
    };
}

/// The kind of object that enables an extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Instance,
    Device,
}

extensions! {
    Instance KHR_DEVICE_GROUP_CREATION c"VK_KHR_device_group_creation" 1;
    Instance KHR_EXTERNAL_FENCE_CAPABILITIES c"VK_KHR_external_fence_capabilities" 1;
    Instance KHR_EXTERNAL_MEMORY_CAPABILITIES c"VK_KHR_external_memory_capabilities" 1;
    Instance KHR_EXTERNAL_SEMAPHORE_CAPABILITIES c"VK_KHR_external_semaphore_capabilities" 1;
    Instance KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 c"VK_KHR_get_physical_device_properties2" 2;
    Instance KHR_GET_SURFACE_CAPABILITIES_2 c"VK_KHR_get_surface_capabilities2" 1;
    Instance KHR_SURFACE c"VK_KHR_surface" 25;
    Instance KHR_SURFACE_MAINTENANCE_1 c"VK_KHR_surface_maintenance1" 1;
    Instance KHR_SURFACE_PROTECTED_CAPABILITIES c"VK_KHR_surface_protected_capabilities" 1;
    Instance KHR_WAYLAND_SURFACE c"VK_KHR_wayland_surface" 6;
    Instance KHR_WIN32_SURFACE c"VK_KHR_win32_surface" 6;
    Instance KHR_XCB_SURFACE c"VK_KHR_xcb_surface" 6;
    Instance KHR_XLIB_SURFACE c"VK_KHR_xlib_surface" 6;
    Instance EXT_DEBUG_UTILS c"VK_EXT_debug_utils" 2;
    Instance EXT_HEADLESS_SURFACE c"VK_EXT_headless_surface" 1;
    Instance EXT_SURFACE_MAINTENANCE_1 c"VK_EXT_surface_maintenance1" 1;
    Instance EXT_SWAPCHAIN_COLORSPACE c"VK_EXT_swapchain_colorspace" 5;
    Instance GOOGLE_SURFACELESS_QUERY c"VK_GOOGLE_surfaceless_query" 2;
    Device KHR_16BIT_STORAGE c"VK_KHR_16bit_storage" 1;
    Device KHR_8BIT_STORAGE c"VK_KHR_8bit_storage" 1;
    Device KHR_ACCELERATION_STRUCTURE c"VK_KHR_acceleration_structure" 13;
    Device KHR_BIND_MEMORY_2 c"VK_KHR_bind_memory2" 1;
    Device KHR_BUFFER_DEVICE_ADDRESS c"VK_KHR_buffer_device_address" 1;
    Device KHR_CALIBRATED_TIMESTAMPS c"VK_KHR_calibrated_timestamps" 1;
    Device KHR_COMPUTE_SHADER_DERIVATIVES c"VK_KHR_compute_shader_derivatives" 1;
    Device KHR_COOPERATIVE_MATRIX c"VK_KHR_cooperative_matrix" 2;
    Device KHR_COPY_COMMANDS_2 c"VK_KHR_copy_commands2" 1;
    Device KHR_COPY_MEMORY_INDIRECT c"VK_KHR_copy_memory_indirect" 1;
    Device KHR_CREATE_RENDERPASS_2 c"VK_KHR_create_renderpass2" 1;
    Device KHR_DEDICATED_ALLOCATION c"VK_KHR_dedicated_allocation" 3;
    Device KHR_DEFERRED_HOST_OPERATIONS c"VK_KHR_deferred_host_operations" 4;
    Device KHR_DEPTH_CLAMP_ZERO_ONE c"VK_KHR_depth_clamp_zero_one" 1;
    Device KHR_DEPTH_STENCIL_RESOLVE c"VK_KHR_depth_stencil_resolve" 1;
    Device KHR_DESCRIPTOR_UPDATE_TEMPLATE c"VK_KHR_descriptor_update_template" 1;
    Device KHR_DEVICE_ADDRESS_COMMANDS c"VK_KHR_device_address_commands" 1;
    Device KHR_DEVICE_FAULT c"VK_KHR_device_fault" 1;
    Device KHR_DEVICE_GROUP c"VK_KHR_device_group" 4;
    Device KHR_DRAW_INDIRECT_COUNT c"VK_KHR_draw_indirect_count" 1;
    Device KHR_DRIVER_PROPERTIES c"VK_KHR_driver_properties" 1;
    Device KHR_DYNAMIC_RENDERING c"VK_KHR_dynamic_rendering" 1;
    Device KHR_DYNAMIC_RENDERING_LOCAL_READ c"VK_KHR_dynamic_rendering_local_read" 1;
    Device KHR_EXTENDED_FLAGS c"VK_KHR_extended_flags" 1;
    Device KHR_EXTERNAL_FENCE c"VK_KHR_external_fence" 1;
    Device KHR_EXTERNAL_FENCE_FD c"VK_KHR_external_fence_fd" 1;
    Device KHR_EXTERNAL_FENCE_WIN32 c"VK_KHR_external_fence_win32" 1;
    Device KHR_EXTERNAL_MEMORY c"VK_KHR_external_memory" 1;
    Device KHR_EXTERNAL_MEMORY_FD c"VK_KHR_external_memory_fd" 1;
    Device KHR_EXTERNAL_MEMORY_WIN32 c"VK_KHR_external_memory_win32" 1;
    Device KHR_EXTERNAL_SEMAPHORE c"VK_KHR_external_semaphore" 1;
    Device KHR_EXTERNAL_SEMAPHORE_FD c"VK_KHR_external_semaphore_fd" 1;
    Device KHR_EXTERNAL_SEMAPHORE_WIN32 c"VK_KHR_external_semaphore_win32" 1;
    Device KHR_FORMAT_FEATURE_FLAGS_2 c"VK_KHR_format_feature_flags2" 2;
    Device KHR_FRAGMENT_SHADER_BARYCENTRIC c"VK_KHR_fragment_shader_barycentric" 1;
    Device KHR_FRAGMENT_SHADING_RATE c"VK_KHR_fragment_shading_rate" 2;
    Device KHR_GET_MEMORY_REQUIREMENTS_2 c"VK_KHR_get_memory_requirements2" 1;
    Device KHR_GLOBAL_PRIORITY c"VK_KHR_global_priority" 1;
    Device KHR_IMAGELESS_FRAMEBUFFER c"VK_KHR_imageless_framebuffer" 1;
    Device KHR_IMAGE_FORMAT_LIST c"VK_KHR_image_format_list" 1;
    Device KHR_INCREMENTAL_PRESENT c"VK_KHR_incremental_present" 2;
    Device KHR_INDEX_TYPE_UINT8 c"VK_KHR_index_type_uint8" 1;
    Device KHR_INTERNALLY_SYNCHRONIZED_QUEUES c"VK_KHR_internally_synchronized_queues" 1;
    Device KHR_LINE_RASTERIZATION c"VK_KHR_line_rasterization" 1;
    Device KHR_LOAD_STORE_OP_NONE c"VK_KHR_load_store_op_none" 1;
    Device KHR_MAINTENANCE_1 c"VK_KHR_maintenance1" 2;
    Device KHR_MAINTENANCE_10 c"VK_KHR_maintenance10" 1;
    Device KHR_MAINTENANCE_11 c"VK_KHR_maintenance11" 1;
    Device KHR_MAINTENANCE_2 c"VK_KHR_maintenance2" 1;
    Device KHR_MAINTENANCE_3 c"VK_KHR_maintenance3" 1;
    Device KHR_MAINTENANCE_4 c"VK_KHR_maintenance4" 2;
    Device KHR_MAINTENANCE_5 c"VK_KHR_maintenance5" 1;
    Device KHR_MAINTENANCE_6 c"VK_KHR_maintenance6" 1;
    Device KHR_MAINTENANCE_7 c"VK_KHR_maintenance7" 1;
    Device KHR_MAINTENANCE_8 c"VK_KHR_maintenance8" 1;
    Device KHR_MAINTENANCE_9 c"VK_KHR_maintenance9" 1;
    Device KHR_MAP_MEMORY_2 c"VK_KHR_map_memory2" 1;
    Device KHR_MULTIVIEW c"VK_KHR_multiview" 1;
    Device KHR_OPACITY_MICROMAP c"VK_KHR_opacity_micromap" 1;
    Device KHR_PIPELINE_BINARY c"VK_KHR_pipeline_binary" 1;
    Device KHR_PIPELINE_EXECUTABLE_PROPERTIES c"VK_KHR_pipeline_executable_properties" 1;
    Device KHR_PIPELINE_LIBRARY c"VK_KHR_pipeline_library" 1;
    Device KHR_PRESENT_ID c"VK_KHR_present_id" 1;
    Device KHR_PRESENT_ID_2 c"VK_KHR_present_id2" 1;
    Device KHR_PRESENT_MODE_FIFO_LATEST_READY c"VK_KHR_present_mode_fifo_latest_ready" 1;
    Device KHR_PRESENT_WAIT c"VK_KHR_present_wait" 1;
    Device KHR_PRESENT_WAIT_2 c"VK_KHR_present_wait2" 1;
    Device KHR_PUSH_DESCRIPTOR c"VK_KHR_push_descriptor" 2;
    Device KHR_RAY_QUERY c"VK_KHR_ray_query" 1;
    Device KHR_RAY_TRACING_MAINTENANCE_1 c"VK_KHR_ray_tracing_maintenance1" 1;
    Device KHR_RAY_TRACING_PIPELINE c"VK_KHR_ray_tracing_pipeline" 1;
    Device KHR_RAY_TRACING_POSITION_FETCH c"VK_KHR_ray_tracing_position_fetch" 1;
    Device KHR_RELAXED_BLOCK_LAYOUT c"VK_KHR_relaxed_block_layout" 1;
    Device KHR_ROBUSTNESS_2 c"VK_KHR_robustness2" 1;
    Device KHR_SAMPLER_MIRROR_CLAMP_TO_EDGE c"VK_KHR_sampler_mirror_clamp_to_edge" 3;
    Device KHR_SAMPLER_YCBCR_CONVERSION c"VK_KHR_sampler_ycbcr_conversion" 14;
    Device KHR_SEPARATE_DEPTH_STENCIL_LAYOUTS c"VK_KHR_separate_depth_stencil_layouts" 1;
    Device KHR_SHADER_ABORT c"VK_KHR_shader_abort" 1;
    Device KHR_SHADER_ATOMIC_INT64 c"VK_KHR_shader_atomic_int64" 1;
    Device KHR_SHADER_BFLOAT16 c"VK_KHR_shader_bfloat16" 1;
    Device KHR_SHADER_CLOCK c"VK_KHR_shader_clock" 1;
    Device KHR_SHADER_CONSTANT_DATA c"VK_KHR_shader_constant_data" 1;
    Device KHR_SHADER_DRAW_PARAMETERS c"VK_KHR_shader_draw_parameters" 1;
    Device KHR_SHADER_EXPECT_ASSUME c"VK_KHR_shader_expect_assume" 1;
    Device KHR_SHADER_FLOAT16_INT8 c"VK_KHR_shader_float16_int8" 1;
    Device KHR_SHADER_FLOAT_CONTROLS c"VK_KHR_shader_float_controls" 4;
    Device KHR_SHADER_FLOAT_CONTROLS_2 c"VK_KHR_shader_float_controls2" 1;
    Device KHR_SHADER_FMA c"VK_KHR_shader_fma" 1;
    Device KHR_SHADER_INTEGER_DOT_PRODUCT c"VK_KHR_shader_integer_dot_product" 1;
    Device KHR_SHADER_MAXIMAL_RECONVERGENCE c"VK_KHR_shader_maximal_reconvergence" 1;
    Device KHR_SHADER_NON_SEMANTIC_INFO c"VK_KHR_shader_non_semantic_info" 1;
    Device KHR_SHADER_QUAD_CONTROL c"VK_KHR_shader_quad_control" 1;
    Device KHR_SHADER_RELAXED_EXTENDED_INSTRUCTION c"VK_KHR_shader_relaxed_extended_instruction" 1;
    Device KHR_SHADER_SUBGROUP_EXTENDED_TYPES c"VK_KHR_shader_subgroup_extended_types" 1;
    Device KHR_SHADER_SUBGROUP_ROTATE c"VK_KHR_shader_subgroup_rotate" 2;
    Device KHR_SHADER_SUBGROUP_UNIFORM_CONTROL_FLOW c"VK_KHR_shader_subgroup_uniform_control_flow" 1;
    Device KHR_SHADER_TERMINATE_INVOCATION c"VK_KHR_shader_terminate_invocation" 1;
    Device KHR_SHADER_UNTYPED_POINTERS c"VK_KHR_shader_untyped_pointers" 1;
    Device KHR_SHARED_PRESENTABLE_IMAGE c"VK_KHR_shared_presentable_image" 1;
    Device KHR_SPIRV_1_4 c"VK_KHR_spirv_1_4" 1;
    Device KHR_STORAGE_BUFFER_STORAGE_CLASS c"VK_KHR_storage_buffer_storage_class" 1;
    Device KHR_SWAPCHAIN c"VK_KHR_swapchain" 70;
    Device KHR_SWAPCHAIN_MAINTENANCE_1 c"VK_KHR_swapchain_maintenance1" 1;
    Device KHR_SWAPCHAIN_MUTABLE_FORMAT c"VK_KHR_swapchain_mutable_format" 1;
    Device KHR_SYNCHRONIZATION_2 c"VK_KHR_synchronization2" 1;
    Device KHR_TIMELINE_SEMAPHORE c"VK_KHR_timeline_semaphore" 2;
    Device KHR_UNIFIED_IMAGE_LAYOUTS c"VK_KHR_unified_image_layouts" 1;
    Device KHR_UNIFORM_BUFFER_STANDARD_LAYOUT c"VK_KHR_uniform_buffer_standard_layout" 1;
    Device KHR_VARIABLE_POINTERS c"VK_KHR_variable_pointers" 1;
    Device KHR_VERTEX_ATTRIBUTE_DIVISOR c"VK_KHR_vertex_attribute_divisor" 1;
    Device KHR_VULKAN_MEMORY_MODEL c"VK_KHR_vulkan_memory_model" 3;
    Device KHR_WORKGROUP_MEMORY_EXPLICIT_LAYOUT c"VK_KHR_workgroup_memory_explicit_layout" 1;
    Device KHR_ZERO_INITIALIZE_WORKGROUP_MEMORY c"VK_KHR_zero_initialize_workgroup_memory" 1;
    Device EXT_4444_FORMATS c"VK_EXT_4444_formats" 1;
    Device EXT_ATTACHMENT_FEEDBACK_LOOP_DYNAMIC_STATE c"VK_EXT_attachment_feedback_loop_dynamic_state" 1;
    Device EXT_ATTACHMENT_FEEDBACK_LOOP_LAYOUT c"VK_EXT_attachment_feedback_loop_layout" 2;
    Device EXT_BLEND_OPERATION_ADVANCED c"VK_EXT_blend_operation_advanced" 2;
    Device EXT_BORDER_COLOR_SWIZZLE c"VK_EXT_border_color_swizzle" 1;
    Device EXT_CALIBRATED_TIMESTAMPS c"VK_EXT_calibrated_timestamps" 2;
    Device EXT_COLOR_WRITE_ENABLE c"VK_EXT_color_write_enable" 1;
    Device EXT_CONDITIONAL_RENDERING c"VK_EXT_conditional_rendering" 2;
    Device EXT_CUSTOM_BORDER_COLOR c"VK_EXT_custom_border_color" 12;
    Device EXT_DEPTH_BIAS_CONTROL c"VK_EXT_depth_bias_control" 1;
    Device EXT_DEPTH_CLAMP_CONTROL c"VK_EXT_depth_clamp_control" 1;
    Device EXT_DEPTH_CLAMP_ZERO_ONE c"VK_EXT_depth_clamp_zero_one" 1;
    Device EXT_DEPTH_CLIP_CONTROL c"VK_EXT_depth_clip_control" 1;
    Device EXT_DEPTH_CLIP_ENABLE c"VK_EXT_depth_clip_enable" 1;
    Device EXT_DEPTH_RANGE_UNRESTRICTED c"VK_EXT_depth_range_unrestricted" 1;
    Device EXT_DESCRIPTOR_BUFFER c"VK_EXT_descriptor_buffer" 1;
    Device EXT_DESCRIPTOR_HEAP c"VK_EXT_descriptor_heap" 1;
    Device EXT_DESCRIPTOR_INDEXING c"VK_EXT_descriptor_indexing" 2;
    Device EXT_DEVICE_ADDRESS_BINDING_REPORT c"VK_EXT_device_address_binding_report" 1;
    Device EXT_DEVICE_FAULT c"VK_EXT_device_fault" 2;
    Device EXT_DYNAMIC_RENDERING_UNUSED_ATTACHMENTS c"VK_EXT_dynamic_rendering_unused_attachments" 1;
    Device EXT_EXTENDED_DYNAMIC_STATE c"VK_EXT_extended_dynamic_state" 1;
    Device EXT_EXTENDED_DYNAMIC_STATE_2 c"VK_EXT_extended_dynamic_state2" 1;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 c"VK_EXT_extended_dynamic_state3" 2;
    Device EXT_EXTERNAL_MEMORY_HOST c"VK_EXT_external_memory_host" 1;
    Device EXT_FRAGMENT_SHADER_INTERLOCK c"VK_EXT_fragment_shader_interlock" 1;
    Device EXT_GLOBAL_PRIORITY c"VK_EXT_global_priority" 2;
    Device EXT_GLOBAL_PRIORITY_QUERY c"VK_EXT_global_priority_query" 1;
    Device EXT_GRAPHICS_PIPELINE_LIBRARY c"VK_EXT_graphics_pipeline_library" 1;
    Device EXT_HDR_METADATA c"VK_EXT_hdr_metadata" 2;
    Device EXT_HOST_IMAGE_COPY c"VK_EXT_host_image_copy" 1;
    Device EXT_HOST_QUERY_RESET c"VK_EXT_host_query_reset" 1;
    Device EXT_IMAGE_2D_VIEW_OF_3D c"VK_EXT_image_2d_view_of_3d" 1;
    Device EXT_IMAGE_ROBUSTNESS c"VK_EXT_image_robustness" 1;
    Device EXT_IMAGE_SLICED_VIEW_OF_3D c"VK_EXT_image_sliced_view_of_3d" 1;
    Device EXT_IMAGE_VIEW_MIN_LOD c"VK_EXT_image_view_min_lod" 1;
    Device EXT_INDEX_TYPE_UINT8 c"VK_EXT_index_type_uint8" 1;
    Device EXT_INLINE_UNIFORM_BLOCK c"VK_EXT_inline_uniform_block" 1;
    Device EXT_LEGACY_VERTEX_ATTRIBUTES c"VK_EXT_legacy_vertex_attributes" 1;
    Device EXT_LINE_RASTERIZATION c"VK_EXT_line_rasterization" 1;
    Device EXT_LOAD_STORE_OP_NONE c"VK_EXT_load_store_op_none" 1;
    Device EXT_MEMORY_BUDGET c"VK_EXT_memory_budget" 1;
    Device EXT_MEMORY_PRIORITY c"VK_EXT_memory_priority" 1;
    Device EXT_MESH_SHADER c"VK_EXT_mesh_shader" 1;
    Device EXT_MULTI_DRAW c"VK_EXT_multi_draw" 1;
    Device EXT_MULTISAMPLED_RENDER_TO_SINGLE_SAMPLED c"VK_EXT_multisampled_render_to_single_sampled" 1;
    Device EXT_MUTABLE_DESCRIPTOR_TYPE c"VK_EXT_mutable_descriptor_type" 1;
    Device EXT_NESTED_COMMAND_BUFFER c"VK_EXT_nested_command_buffer" 1;
    Device EXT_NON_SEAMLESS_CUBE_MAP c"VK_EXT_non_seamless_cube_map" 1;
    Device EXT_OPACITY_MICROMAP c"VK_EXT_opacity_micromap" 2;
    Device EXT_PAGEABLE_DEVICE_LOCAL_MEMORY c"VK_EXT_pageable_device_local_memory" 1;
    Device EXT_PIPELINE_CREATION_CACHE_CONTROL c"VK_EXT_pipeline_creation_cache_control" 3;
    Device EXT_PIPELINE_CREATION_FEEDBACK c"VK_EXT_pipeline_creation_feedback" 1;
    Device EXT_PIPELINE_LIBRARY_GROUP_HANDLES c"VK_EXT_pipeline_library_group_handles" 1;
    Device EXT_PIPELINE_PROTECTED_ACCESS c"VK_EXT_pipeline_protected_access" 1;
    Device EXT_PIPELINE_ROBUSTNESS c"VK_EXT_pipeline_robustness" 1;
    Device EXT_POST_DEPTH_COVERAGE c"VK_EXT_post_depth_coverage" 1;
    Device EXT_PRESENT_MODE_FIFO_LATEST_READY c"VK_EXT_present_mode_fifo_latest_ready" 1;
    Device EXT_PRESENT_TIMING c"VK_EXT_present_timing" 3;
    Device EXT_PRIMITIVE_RESTART_INDEX c"VK_EXT_primitive_restart_index" 1;
    Device EXT_PRIMITIVE_TOPOLOGY_LIST_RESTART c"VK_EXT_primitive_topology_list_restart" 1;
    Device EXT_PRIMITIVES_GENERATED_QUERY c"VK_EXT_primitives_generated_query" 1;
    Device EXT_PRIVATE_DATA c"VK_EXT_private_data" 1;
    Device EXT_PROVOKING_VERTEX c"VK_EXT_provoking_vertex" 1;
    Device EXT_QUEUE_FAMILY_FOREIGN c"VK_EXT_queue_family_foreign" 1;
    Device EXT_RASTERIZATION_ORDER_ATTACHMENT_ACCESS c"VK_EXT_rasterization_order_attachment_access" 1;
    Device EXT_RAY_TRACING_INVOCATION_REORDER c"VK_EXT_ray_tracing_invocation_reorder" 2;
    Device EXT_ROBUSTNESS_2 c"VK_EXT_robustness2" 1;
    Device EXT_SAMPLE_LOCATIONS c"VK_EXT_sample_locations" 1;
    Device EXT_SAMPLER_FILTER_MINMAX c"VK_EXT_sampler_filter_minmax" 2;
    Device EXT_SCALAR_BLOCK_LAYOUT c"VK_EXT_scalar_block_layout" 1;
    Device EXT_SEPARATE_STENCIL_USAGE c"VK_EXT_separate_stencil_usage" 1;
    Device EXT_SHADER_64BIT_INDEXING c"VK_EXT_shader_64bit_indexing" 1;
    Device EXT_SHADER_ATOMIC_FLOAT c"VK_EXT_shader_atomic_float" 1;
    Device EXT_SHADER_ATOMIC_FLOAT_2 c"VK_EXT_shader_atomic_float2" 1;
    Device EXT_SHADER_DEMOTE_TO_HELPER_INVOCATION c"VK_EXT_shader_demote_to_helper_invocation" 1;
    Device EXT_SHADER_IMAGE_ATOMIC_INT64 c"VK_EXT_shader_image_atomic_int64" 1;
    Device EXT_SHADER_LONG_VECTOR c"VK_EXT_shader_long_vector" 1;
    Device EXT_SHADER_OBJECT c"VK_EXT_shader_object" 1;
    Device EXT_SHADER_REPLICATED_COMPOSITES c"VK_EXT_shader_replicated_composites" 1;
    Device EXT_SHADER_SPLIT_BARRIER c"VK_EXT_shader_split_barrier" 1;
    Device EXT_SHADER_STENCIL_EXPORT c"VK_EXT_shader_stencil_export" 1;
    Device EXT_SHADER_SUBGROUP_BALLOT c"VK_EXT_shader_subgroup_ballot" 1;
    Device EXT_SHADER_SUBGROUP_PARTITIONED c"VK_EXT_shader_subgroup_partitioned" 1;
    Device EXT_SHADER_SUBGROUP_VOTE c"VK_EXT_shader_subgroup_vote" 1;
    Device EXT_SHADER_VIEWPORT_INDEX_LAYER c"VK_EXT_shader_viewport_index_layer" 1;
    Device EXT_SUBGROUP_SIZE_CONTROL c"VK_EXT_subgroup_size_control" 2;
    Device EXT_SWAPCHAIN_MAINTENANCE_1 c"VK_EXT_swapchain_maintenance1" 1;
    Device EXT_TEXEL_BUFFER_ALIGNMENT c"VK_EXT_texel_buffer_alignment" 1;
    Device EXT_TOOLING_INFO c"VK_EXT_tooling_info" 1;
    Device EXT_TRANSFORM_FEEDBACK c"VK_EXT_transform_feedback" 1;
    Device EXT_VERTEX_ATTRIBUTE_DIVISOR c"VK_EXT_vertex_attribute_divisor" 3;
    Device EXT_VERTEX_INPUT_DYNAMIC_STATE c"VK_EXT_vertex_input_dynamic_state" 2;
    Device EXT_YCBCR_2PLANE_444_FORMATS c"VK_EXT_ycbcr_2plane_444_formats" 1;
    Device EXT_YCBCR_IMAGE_ARRAYS c"VK_EXT_ycbcr_image_arrays" 1;
    Device EXT_ZERO_INITIALIZE_DEVICE_MEMORY c"VK_EXT_zero_initialize_device_memory" 1;
    Device ARM_PIPELINE_OPACITY_MICROMAP c"VK_ARM_pipeline_opacity_micromap" 1;
    Device ARM_RASTERIZATION_ORDER_ATTACHMENT_ACCESS c"VK_ARM_rasterization_order_attachment_access" 1;
    Device GOOGLE_DECORATE_STRING c"VK_GOOGLE_decorate_string" 1;
    Device GOOGLE_HLSL_FUNCTIONALITY_1 c"VK_GOOGLE_hlsl_functionality1" 1;
    Device GOOGLE_USER_TYPE c"VK_GOOGLE_user_type" 1;
    Device NV_COMPUTE_SHADER_DERIVATIVES c"VK_NV_compute_shader_derivatives" 1;
    Device HUAWEI_INVOCATION_MASK c"VK_HUAWEI_invocation_mask" 1;
    Device NV_COOPERATIVE_VECTOR c"VK_NV_cooperative_vector" 4;
    Device NV_SHADER_SUBGROUP_PARTITIONED c"VK_NV_shader_subgroup_partitioned" 1;
    Device NV_RAY_TRACING c"VK_NV_ray_tracing" 3;
    Device NV_RAY_TRACING_INVOCATION_REORDER c"VK_NV_ray_tracing_invocation_reorder" 1;
    Device NV_RAY_TRACING_MOTION_BLUR c"VK_NV_ray_tracing_motion_blur" 1;
    Device NV_RAY_TRACING_LINEAR_SWEPT_SPHERES c"VK_NV_ray_tracing_linear_swept_spheres" 1;
    Device NV_RAY_TRACING_VALIDATION c"VK_NV_ray_tracing_validation" 1;
    Device VALVE_MUTABLE_DESCRIPTOR_TYPE c"VK_VALVE_mutable_descriptor_type" 1;
}

/// A set of extensions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExtensionSet([u64; 4]);

impl ExtensionSet {
    pub fn contains(&self, extension: Extension) -> bool {
        let bit = extension as usize;
        self.0[bit / 64] >> (bit % 64) & 1 != 0
    }

    pub fn insert(&mut self, extension: Extension) {
        let bit = extension as usize;
        self.0[bit / 64] |= 1 << (bit % 64);
    }

    /// Union of both.
    pub fn union(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|word| self.0[word] | other.0[word]))
    }

    /// The set of extensions with these names; `None` if one is not advertised for this kind.
    pub fn from_names<'a>(kind: Kind, names: impl Iterator<Item = &'a CStr>) -> Option<Self> {
        let mut set = Self::default();
        for name in names {
            set.insert(of_kind(kind).find(|extension| extension.name() == name)?);
        }
        Some(set)
    }
}

/// The extensions of this system.
pub fn of_system() -> impl Iterator<Item = Extension> {
    let all = Extension::ALL.iter().copied();
    all.filter(|extension| extension.is_of_this_system())
}

/// The extensions of this system of a kind.
pub fn of_kind(kind: Kind) -> impl Iterator<Item = Extension> {
    of_system().filter(move |extension| extension.kind() == kind)
}

impl Extension {
    /// Whether the system has the objects of the extension.
    fn is_of_this_system(self) -> bool {
        match self {
            Self::KHR_EXTERNAL_FENCE_FD
            | Self::KHR_EXTERNAL_MEMORY_FD
            | Self::KHR_EXTERNAL_SEMAPHORE_FD => os::HAS_DESCRIPTORS,
            Self::KHR_EXTERNAL_FENCE_WIN32
            | Self::KHR_EXTERNAL_MEMORY_WIN32
            | Self::KHR_EXTERNAL_SEMAPHORE_WIN32
            | Self::KHR_WIN32_SURFACE => os::HAS_WIN32,
            Self::KHR_WAYLAND_SURFACE | Self::KHR_XCB_SURFACE | Self::KHR_XLIB_SURFACE => {
                os::HAS_X11_AND_WAYLAND
            }
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_know_kinds_and_hold_all() {
        assert!(Extension::ALL.len() <= 256);
        assert!(
            ExtensionSet::from_names(Kind::Device, [c"VK_EXT_debug_utils"].into_iter()).is_none()
        );
        let set =
            ExtensionSet::from_names(Kind::Instance, [c"VK_EXT_debug_utils"].into_iter()).unwrap();
        assert!(set.contains(Extension::EXT_DEBUG_UTILS));
        assert!(!set.contains(Extension::KHR_8BIT_STORAGE));
    }
}
