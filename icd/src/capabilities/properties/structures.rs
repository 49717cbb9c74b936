//! Property structures of an output chain, by the part of Vulkan that they are of. Members that
//! several structures share come from one source, mostly the structure of a whole version.

use ash::vk::TaggedStructure;
use spirv_jit::abort::MAX_MESSAGE_BYTES;
use spirv_jit::environment::Descriptor;
use spirv_jit::ir::op::VectorProduct;

use super::{
    Machine, SUBGROUP_STAGES, acceleration_structure, descriptor_buffer, descriptor_heap,
    fragment_shading_rate, invocation_reorder, mesh_shader, pipeline_cache_uuid, ray_tracing_nv,
    ray_tracing_pipeline, transform_feedback, vulkan11, vulkan12, vulkan13, vulkan14,
};
use crate::capabilities::limits;
use crate::ffi::{chain, enumerate, vk};

/// The layouts of host copies: every layout except `UNDEFINED`.
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

/// The host copy layouts of `VkPhysicalDeviceVulkan14Properties` and
/// `VkPhysicalDeviceHostImageCopyProperties`: counted arrays, each filled if its pointer is set.
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

/// Fills the structures of these types: `Type(source) { field, field: source_field, … }` copies
/// the named fields, `Type(source)` all of them.
macro_rules! fill_structures {
    ($node:expr; $($structure:ident($source:expr) $({$($field:ident $(: $from:ident)?),* $(,)?})?;)*) => {
        match (*$node).s_type {
            $(<vk::$structure<'_> as vk::TaggedStructure>::STRUCTURE_TYPE => {
                #[allow(unused_mut)]
                let mut source = $source;
                let out = &mut *$node.cast::<vk::$structure<'_>>();
                fill_structures!(@copy out source $({$($field $(: $from)?),*})?);
            })*
            _ => {}
        }
    };
    (@copy $out:ident $source:ident {$($field:ident $(: $from:ident)?),*}) => {
        $($out.$field = fill_structures!(@field $source $field $($from)?);)*
    };
    (@copy $out:ident $source:ident) => {
        $source.p_next = $out.p_next;
        *$out = $source;
    };
    (@field $source:ident $field:ident $from:ident) => { $source.$from };
    (@field $source:ident $field:ident) => { $source.$field };
}

/// Fills every property structure of an output chain.
///
/// # Safety
/// As [`chain::nodes_mut`].
pub unsafe fn fill_chain(machine: &Machine, next: *mut std::ffi::c_void) {
    // SAFETY: the caller passes a valid chain, in which `sType` says the type of each structure.
    unsafe {
        for node in chain::nodes_mut(next) {
            fill(machine, node);
        }
    }
}

/// # Safety
/// `node` is a structure of the type that its `sType` says.
unsafe fn fill(machine: &Machine, node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_copy_layouts(node);
        fill_versions(machine, node);
        fill_promoted_to_1_1(machine, node);
        fill_promoted_to_1_2(node);
        fill_promoted_to_1_3(node);
        fill_promoted_to_1_4(node);
        fill_ray_tracing(node);
        fill_shaders(node);
        fill_drawing(node);
        fill_device(node);
    }
}

/// # Safety
/// As [`fill`].
unsafe fn fill_copy_layouts(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        let ty = (*node).s_type;
        if ty == vk::PhysicalDeviceHostImageCopyPropertiesEXT::STRUCTURE_TYPE {
            copy_layouts!(&mut *node.cast::<vk::PhysicalDeviceHostImageCopyPropertiesEXT<'_>>());
        } else if ty == vk::PhysicalDeviceVulkan14Properties::STRUCTURE_TYPE {
            copy_layouts!(&mut *node.cast::<vk::PhysicalDeviceVulkan14Properties<'_>>());
        }
    }
}

/// Structures of whole versions of Vulkan.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_versions(machine: &Machine, node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
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
        }
    }
}

/// Structures whose members Vulkan 1.1 took over.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_promoted_to_1_1(machine: &Machine, node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
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
        }
    }
}

/// Structures whose members Vulkan 1.2 took over.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_promoted_to_1_2(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
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
        }
    }
}

/// Structures whose members Vulkan 1.3 took over.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_promoted_to_1_3(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
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
        }
    }
}

/// Structures whose members Vulkan 1.4 took over.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_promoted_to_1_4(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
            PhysicalDeviceMaintenance5PropertiesKHR(vulkan14()) {
                early_fragment_multisample_coverage_after_sample_counting, early_fragment_sample_mask_test_before_sample_counting,
                depth_stencil_swizzle_one_support, polygon_mode_point_size,
                non_strict_single_pixel_wide_lines_use_parallelogram, non_strict_wide_lines_use_parallelogram,
            };
            PhysicalDevicePushDescriptorPropertiesKHR(vulkan14()) {
                max_push_descriptors,
            };
            PhysicalDeviceLineRasterizationPropertiesKHR(vulkan14()) {
                line_sub_pixel_precision_bits,
            };
            PhysicalDeviceMaintenance6PropertiesKHR(vulkan14()) {
                block_texel_view_compatible_multiple_layers, max_combined_image_sampler_descriptor_count,
                fragment_shading_rate_clamp_combiner_inputs,
            };
            PhysicalDevicePipelineRobustnessPropertiesEXT(vulkan14()) {
                default_robustness_storage_buffers, default_robustness_uniform_buffers, default_robustness_vertex_inputs,
                default_robustness_images,
            };
            PhysicalDeviceVertexAttributeDivisorPropertiesEXT(vulkan14()) {
                max_vertex_attrib_divisor,
            };
            PhysicalDeviceVertexAttributeDivisorPropertiesKHR(vulkan14()) {
                max_vertex_attrib_divisor, supports_non_zero_first_instance,
            };
        }
    }
}

/// Structures of the ray tracing extensions.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_ray_tracing(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
            PhysicalDeviceAccelerationStructurePropertiesKHR(acceleration_structure());
            PhysicalDeviceRayTracingPipelinePropertiesKHR(ray_tracing_pipeline());
            PhysicalDeviceRayTracingPropertiesNV(ray_tracing_nv());
            PhysicalDeviceRayTracingInvocationReorderPropertiesNV(invocation_reorder()) {
                ray_tracing_invocation_reorder_reordering_hint,
            };
            PhysicalDeviceRayTracingInvocationReorderPropertiesEXT(invocation_reorder());
            PhysicalDeviceOpacityMicromapPropertiesEXT(vk::PhysicalDeviceOpacityMicromapPropertiesEXT {
                max_opacity2_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_opacity4_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                ..Default::default()
            });
            // Lossy formats have the same levels, since nothing is lost.
            PhysicalDeviceOpacityMicromapPropertiesKHR(vk::PhysicalDeviceOpacityMicromapPropertiesKHR {
                max_opacity2_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_opacity4_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_opacity_lossy4_state_subdivision_level: traversal::micromap::MAX_LEVEL,
                max_micromap_triangles: limits::MAX_PRIMITIVES,
                ..Default::default()
            });
        }
    }
}

/// Structures of extensions on shaders and their descriptors.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_shaders(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
            PhysicalDeviceDescriptorBufferPropertiesEXT(descriptor_buffer());
            PhysicalDeviceDescriptorHeapPropertiesEXT(descriptor_heap());
            PhysicalDeviceDescriptorBufferDensityMapPropertiesEXT(vk::PhysicalDeviceDescriptorBufferDensityMapPropertiesEXT {
                combined_image_sampler_density_map_descriptor_size: size_of::<Descriptor>(),
                ..Default::default()
            });
            PhysicalDeviceComputeShaderDerivativesPropertiesKHR(vk::PhysicalDeviceComputeShaderDerivativesPropertiesKHR {
                mesh_and_task_shader_derivatives: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceCooperativeMatrixPropertiesKHR(vk::PhysicalDeviceCooperativeMatrixPropertiesKHR {
                cooperative_matrix_supported_stages: vk::ShaderStageFlags::COMPUTE,
                ..Default::default()
            });
            PhysicalDeviceCooperativeVectorPropertiesNV(vk::PhysicalDeviceCooperativeVectorPropertiesNV {
                cooperative_vector_supported_stages: SUBGROUP_STAGES,
                max_cooperative_vector_components: VectorProduct::MAX_COMPONENTS as u32,
                ..Default::default()
            });
            PhysicalDeviceShaderLongVectorPropertiesEXT(vk::PhysicalDeviceShaderLongVectorPropertiesEXT {
                max_vector_components: limits::MAX_VECTOR_COMPONENTS,
                ..Default::default()
            });
            // Split barriers count arrivals outside of workgroup memory.
            PhysicalDeviceShaderSplitBarrierPropertiesEXT(
                vk::PhysicalDeviceShaderSplitBarrierPropertiesEXT::default()
            );
            PhysicalDeviceShaderAbortPropertiesKHR(vk::PhysicalDeviceShaderAbortPropertiesKHR {
                max_shader_abort_message_size: MAX_MESSAGE_BYTES,
                ..Default::default()
            });
            PhysicalDeviceShaderObjectPropertiesEXT(vk::PhysicalDeviceShaderObjectPropertiesEXT {
                shader_binary_uuid: pipeline_cache_uuid(),
                shader_binary_version: 1,
                ..Default::default()
            });
            PhysicalDevicePipelineBinaryPropertiesKHR(vk::PhysicalDevicePipelineBinaryPropertiesKHR::default()) {
                pipeline_binary_internal_cache, pipeline_binary_internal_cache_control,
                pipeline_binary_prefers_internal_cache, pipeline_binary_precompiled_internal_cache,
                pipeline_binary_compressed_data,
            };
        }
    }
}

/// Structures of extensions on drawing.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_drawing(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
            PhysicalDeviceMeshShaderPropertiesEXT(mesh_shader());
            PhysicalDeviceFragmentShadingRatePropertiesKHR(fragment_shading_rate());
            PhysicalDeviceCustomBorderColorPropertiesEXT(vk::PhysicalDeviceCustomBorderColorPropertiesEXT {
                max_custom_border_color_samplers: u32::MAX,
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
            PhysicalDeviceFragmentShaderBarycentricPropertiesKHR(
                vk::PhysicalDeviceFragmentShaderBarycentricPropertiesKHR::default()
            );
            PhysicalDeviceMultiDrawPropertiesEXT(vk::PhysicalDeviceMultiDrawPropertiesEXT {
                max_multi_draw_count: u32::MAX,
                ..Default::default()
            });
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
        }
    }
}

/// Structures of extensions on memory, command buffers and the device.
///
/// # Safety
/// As [`fill`].
unsafe fn fill_device(node: *mut vk::BaseOutStructure<'static>) {
    // SAFETY: the caller's node has the type that its `sType` says.
    unsafe {
        fill_structures! { node;
            PhysicalDeviceExternalMemoryHostPropertiesEXT(vk::PhysicalDeviceExternalMemoryHostPropertiesEXT {
                min_imported_host_pointer_alignment: limits::PAGE_BYTES,
                ..Default::default()
            });
            PhysicalDeviceRobustness2PropertiesEXT(vk::PhysicalDeviceRobustness2PropertiesEXT {
                robust_storage_buffer_access_size_alignment: 1,
                robust_uniform_buffer_access_size_alignment: 1,
                ..Default::default()
            });
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
                // Slices have whole pages, as layers have.
                image2_d_view_of3_d_sparse: vk::TRUE,
                default_vertex_attribute_value: vk::DefaultVertexAttributeValueKHR::ZERO_ZERO_ZERO_ZERO,
                ..Default::default()
            });
            PhysicalDeviceFaultPropertiesKHR(vk::PhysicalDeviceFaultPropertiesKHR {
                max_device_fault_count: limits::MAX_DEVICE_FAULT_COUNT,
                ..Default::default()
            });
            PhysicalDeviceMaintenance10PropertiesKHR(vk::PhysicalDeviceMaintenance10PropertiesKHR {
                rgba4_opaque_black_swizzled: vk::TRUE,
                resolve_srgb_format_applies_transfer_function: vk::TRUE,
                resolve_srgb_format_supports_transfer_function_control: vk::TRUE,
                ..Default::default()
            });
            PhysicalDeviceLayeredApiPropertiesListKHR(vk::PhysicalDeviceLayeredApiPropertiesListKHR::default()) {
                layered_api_count,
            };
            PhysicalDeviceNestedCommandBufferPropertiesEXT(vk::PhysicalDeviceNestedCommandBufferPropertiesEXT {
                max_command_buffer_nesting_level: limits::MAX_COMMAND_BUFFER_NESTING,
                ..Default::default()
            });
        }
    }
}
