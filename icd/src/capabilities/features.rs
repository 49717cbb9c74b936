//! The table of supported features: the structures of each, and the SPIR-V capabilities that it
//! enables. Features that are not listed are not supported.

use ash::vk::TaggedStructure;
use rspirv::spirv::Capability;
use spirv_jit::parse::NewerCapability;

use crate::VkResult;
use crate::ffi::{chain, vk};

/// Bytes of `sType` and `pNext`, before a feature structure's first word.
const HEAD_BYTES: usize = size_of::<vk::BaseOutStructure<'_>>();

macro_rules! features {
    (
        core { $($core:ident $($core_capability:ident)*;)* }
        chained { $($feature:ident: $($structure:ident)+ $(=> $($capability:ident)+)? $(-> $newer:ident)?;)* }
        without_support { $($empty:ident)* }
    ) => {
        /// `VkPhysicalDeviceFeatures`.
        pub fn core_features() -> vk::PhysicalDeviceFeatures {
            vk::PhysicalDeviceFeatures {
                $($core: vk::TRUE,)*
                ..Default::default()
            }
        }

        /// Size of a known feature structure, up to its last feature. Undefined padding may follow.
        fn structure_bytes(ty: vk::StructureType) -> Option<usize> {
            $($(if ty == vk::$structure::STRUCTURE_TYPE {
                return Some(std::mem::offset_of!(vk::$structure<'_>, _marker));
            })+)*
            $(if ty == vk::$empty::STRUCTURE_TYPE {
                return Some(std::mem::offset_of!(vk::$empty<'_>, _marker));
            })*
            None
        }

        /// Sets the supported features of a structure.
        ///
        /// # Safety
        /// `node` is a structure of the type that its `sType` says.
        unsafe fn set_supported(node: *mut vk::BaseOutStructure<'_>) {
            // SAFETY: the caller guarantees that `node` is a structure of the type that its `sType`
            // says.
            unsafe {
                let ty = (*node).s_type;
                $($(if ty == vk::$structure::STRUCTURE_TYPE {
                    (*node.cast::<vk::$structure<'_>>()).$feature = vk::TRUE;
                })+)*
            }
        }

        /// Capabilities that shader modules may declare because of a feature.
        const FEATURE_CAPABILITIES: &[Capability] = &[
            $($(Capability::$core_capability,)*)*
            $($($(Capability::$capability,)+)?)*
        ];

        /// Capabilities that the SPIR-V bindings lack (`->` in the table).
        pub const NEWER_CAPABILITIES: &[NewerCapability] = &[
            $($(NewerCapability::$newer,)?)*
        ];
    };
}

features! {
    core {
        robust_buffer_access;
        full_draw_index_uint32;
        image_cube_array SampledCubeArray ImageCubeArray;
        sampler_anisotropy;
        shader_image_gather_extended ImageGatherExtended;
        shader_storage_image_extended_formats StorageImageExtendedFormats;
        shader_storage_image_multisample StorageImageMultisample ImageMSArray;
        shader_storage_image_read_without_format StorageImageReadWithoutFormat;
        shader_storage_image_write_without_format StorageImageWriteWithoutFormat;
        shader_uniform_buffer_array_dynamic_indexing UniformBufferArrayDynamicIndexing;
        shader_sampled_image_array_dynamic_indexing SampledImageArrayDynamicIndexing;
        shader_storage_buffer_array_dynamic_indexing StorageBufferArrayDynamicIndexing;
        shader_storage_image_array_dynamic_indexing StorageImageArrayDynamicIndexing;
        shader_float64 Float64;
        shader_int64 Int64;
        shader_int16 Int16;
        shader_resource_residency SparseResidency;
        shader_resource_min_lod MinLod;
        texture_compression_bc;
        texture_compression_etc2;
        texture_compression_astc_ldr;
        independent_blend;
        geometry_shader Geometry;
        tessellation_shader Tessellation;
        sample_rate_shading SampleRateShading InterpolationFunction;
        dual_src_blend;
        logic_op;
        multi_draw_indirect;
        draw_indirect_first_instance;
        depth_clamp;
        depth_bias_clamp;
        fill_mode_non_solid;
        depth_bounds;
        wide_lines;
        large_points;
        alpha_to_one;
        multi_viewport MultiViewport;
        occlusion_query_precise;
        pipeline_statistics_query;
        vertex_pipeline_stores_and_atomics;
        fragment_stores_and_atomics;
        shader_tessellation_and_geometry_point_size GeometryPointSize TessellationPointSize;
        shader_clip_distance ClipDistance;
        shader_cull_distance CullDistance;
        variable_multisample_rate;
        inherited_queries;
        sparse_binding;
        sparse_residency_buffer;
        sparse_residency_image2_d;
        sparse_residency_image3_d;
        sparse_residency_aliased;
    }
    chained {
        storage_buffer16_bit_access: PhysicalDeviceVulkan11Features PhysicalDevice16BitStorageFeatures => StorageBuffer16BitAccess;
        uniform_and_storage_buffer16_bit_access: PhysicalDeviceVulkan11Features PhysicalDevice16BitStorageFeatures => UniformAndStorageBuffer16BitAccess;
        storage_push_constant16: PhysicalDeviceVulkan11Features PhysicalDevice16BitStorageFeatures => StoragePushConstant16;
        variable_pointers_storage_buffer: PhysicalDeviceVulkan11Features PhysicalDeviceVariablePointersFeatures => VariablePointersStorageBuffer;
        variable_pointers: PhysicalDeviceVulkan11Features PhysicalDeviceVariablePointersFeatures => VariablePointers;

        sampler_mirror_clamp_to_edge: PhysicalDeviceVulkan12Features;
        storage_buffer8_bit_access: PhysicalDeviceVulkan12Features PhysicalDevice8BitStorageFeatures => StorageBuffer8BitAccess;
        uniform_and_storage_buffer8_bit_access: PhysicalDeviceVulkan12Features PhysicalDevice8BitStorageFeatures => UniformAndStorageBuffer8BitAccess;
        storage_push_constant8: PhysicalDeviceVulkan12Features PhysicalDevice8BitStorageFeatures => StoragePushConstant8;
        shader_buffer_int64_atomics: PhysicalDeviceVulkan12Features PhysicalDeviceShaderAtomicInt64Features => Int64Atomics;
        shader_shared_int64_atomics: PhysicalDeviceVulkan12Features PhysicalDeviceShaderAtomicInt64Features;
        shader_float16: PhysicalDeviceVulkan12Features PhysicalDeviceShaderFloat16Int8Features => Float16;
        shader_int8: PhysicalDeviceVulkan12Features PhysicalDeviceShaderFloat16Int8Features => Int8;
        descriptor_indexing: PhysicalDeviceVulkan12Features;
        shader_uniform_texel_buffer_array_dynamic_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => UniformTexelBufferArrayDynamicIndexing;
        shader_storage_texel_buffer_array_dynamic_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => StorageTexelBufferArrayDynamicIndexing;
        shader_uniform_buffer_array_non_uniform_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => UniformBufferArrayNonUniformIndexing ShaderNonUniform;
        shader_sampled_image_array_non_uniform_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => SampledImageArrayNonUniformIndexing;
        shader_storage_buffer_array_non_uniform_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => StorageBufferArrayNonUniformIndexing;
        shader_storage_image_array_non_uniform_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => StorageImageArrayNonUniformIndexing;
        shader_uniform_texel_buffer_array_non_uniform_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => UniformTexelBufferArrayNonUniformIndexing;
        shader_storage_texel_buffer_array_non_uniform_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => StorageTexelBufferArrayNonUniformIndexing;
        descriptor_binding_uniform_buffer_update_after_bind: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_sampled_image_update_after_bind: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_storage_image_update_after_bind: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_storage_buffer_update_after_bind: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_uniform_texel_buffer_update_after_bind: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_storage_texel_buffer_update_after_bind: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_update_unused_while_pending: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_partially_bound: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        descriptor_binding_variable_descriptor_count: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures;
        runtime_descriptor_array: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => RuntimeDescriptorArray;
        sampler_filter_minmax: PhysicalDeviceVulkan12Features;
        scalar_block_layout: PhysicalDeviceVulkan12Features PhysicalDeviceScalarBlockLayoutFeatures;
        uniform_buffer_standard_layout: PhysicalDeviceVulkan12Features PhysicalDeviceUniformBufferStandardLayoutFeatures;
        shader_subgroup_extended_types: PhysicalDeviceVulkan12Features PhysicalDeviceShaderSubgroupExtendedTypesFeatures;
        separate_depth_stencil_layouts: PhysicalDeviceVulkan12Features PhysicalDeviceSeparateDepthStencilLayoutsFeatures;
        host_query_reset: PhysicalDeviceVulkan12Features PhysicalDeviceHostQueryResetFeatures;
        timeline_semaphore: PhysicalDeviceVulkan12Features PhysicalDeviceTimelineSemaphoreFeatures;
        buffer_device_address: PhysicalDeviceVulkan12Features PhysicalDeviceBufferDeviceAddressFeatures => PhysicalStorageBufferAddresses;
        buffer_device_address_capture_replay: PhysicalDeviceVulkan12Features PhysicalDeviceBufferDeviceAddressFeatures;
        vulkan_memory_model: PhysicalDeviceVulkan12Features PhysicalDeviceVulkanMemoryModelFeatures => VulkanMemoryModel;
        vulkan_memory_model_device_scope: PhysicalDeviceVulkan12Features PhysicalDeviceVulkanMemoryModelFeatures => VulkanMemoryModelDeviceScope;
        vulkan_memory_model_availability_visibility_chains: PhysicalDeviceVulkan12Features PhysicalDeviceVulkanMemoryModelFeatures;
        subgroup_broadcast_dynamic_id: PhysicalDeviceVulkan12Features;

        robust_image_access: PhysicalDeviceVulkan13Features PhysicalDeviceImageRobustnessFeatures;
        inline_uniform_block: PhysicalDeviceVulkan13Features PhysicalDeviceInlineUniformBlockFeatures;
        descriptor_binding_inline_uniform_block_update_after_bind: PhysicalDeviceVulkan13Features PhysicalDeviceInlineUniformBlockFeatures;
        pipeline_creation_cache_control: PhysicalDeviceVulkan13Features PhysicalDevicePipelineCreationCacheControlFeatures;
        private_data: PhysicalDeviceVulkan13Features PhysicalDevicePrivateDataFeatures;
        shader_demote_to_helper_invocation: PhysicalDeviceVulkan13Features PhysicalDeviceShaderDemoteToHelperInvocationFeatures;
        shader_terminate_invocation: PhysicalDeviceVulkan13Features PhysicalDeviceShaderTerminateInvocationFeatures;
        subgroup_size_control: PhysicalDeviceVulkan13Features PhysicalDeviceSubgroupSizeControlFeatures;
        compute_full_subgroups: PhysicalDeviceVulkan13Features PhysicalDeviceSubgroupSizeControlFeatures;
        synchronization2: PhysicalDeviceVulkan13Features PhysicalDeviceSynchronization2Features;
        shader_zero_initialize_workgroup_memory: PhysicalDeviceVulkan13Features PhysicalDeviceZeroInitializeWorkgroupMemoryFeatures;
        maintenance4: PhysicalDeviceVulkan13Features PhysicalDeviceMaintenance4Features;
        shader_integer_dot_product: PhysicalDeviceVulkan13Features PhysicalDeviceShaderIntegerDotProductFeatures => DotProduct DotProductInputAll DotProductInput4x8Bit DotProductInput4x8BitPacked;

        device_address_commands: PhysicalDeviceDeviceAddressCommandsFeaturesKHR;
        maintenance5: PhysicalDeviceVulkan14Features PhysicalDeviceMaintenance5FeaturesKHR;
        acceleration_structure: PhysicalDeviceAccelerationStructureFeaturesKHR;
        acceleration_structure_capture_replay: PhysicalDeviceAccelerationStructureFeaturesKHR;
        acceleration_structure_indirect_build: PhysicalDeviceAccelerationStructureFeaturesKHR;
        acceleration_structure_host_commands: PhysicalDeviceAccelerationStructureFeaturesKHR;
        descriptor_binding_acceleration_structure_update_after_bind: PhysicalDeviceAccelerationStructureFeaturesKHR;
        ray_tracing_pipeline: PhysicalDeviceRayTracingPipelineFeaturesKHR => RayTracingKHR;
        ray_tracing_pipeline_shader_group_handle_capture_replay: PhysicalDeviceRayTracingPipelineFeaturesKHR;
        ray_tracing_pipeline_shader_group_handle_capture_replay_mixed: PhysicalDeviceRayTracingPipelineFeaturesKHR;
        ray_tracing_pipeline_trace_rays_indirect: PhysicalDeviceRayTracingPipelineFeaturesKHR;
        ray_traversal_primitive_culling: PhysicalDeviceRayTracingPipelineFeaturesKHR => RayTraversalPrimitiveCullingKHR;
        ray_query: PhysicalDeviceRayQueryFeaturesKHR => RayQueryKHR;
        ray_tracing_maintenance1: PhysicalDeviceRayTracingMaintenance1FeaturesKHR => RayCullMaskKHR;
        ray_tracing_pipeline_trace_rays_indirect2: PhysicalDeviceRayTracingMaintenance1FeaturesKHR;
        ray_tracing_position_fetch: PhysicalDeviceRayTracingPositionFetchFeaturesKHR => RayTracingPositionFetchKHR RayQueryPositionFetchKHR;
        ray_tracing_invocation_reorder: PhysicalDeviceRayTracingInvocationReorderFeaturesNV => ShaderInvocationReorderNV;
        ray_tracing_invocation_reorder: PhysicalDeviceRayTracingInvocationReorderFeaturesEXT => ShaderInvocationReorderEXT;
        ray_tracing_motion_blur: PhysicalDeviceRayTracingMotionBlurFeaturesNV => RayTracingMotionBlurNV;
        ray_tracing_motion_blur_pipeline_trace_rays_indirect: PhysicalDeviceRayTracingMotionBlurFeaturesNV;
        ray_tracing_validation: PhysicalDeviceRayTracingValidationFeaturesNV;
        invocation_mask: PhysicalDeviceInvocationMaskFeaturesHUAWEI;
        spheres: PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV => RayTracingSpheresGeometryNV;
        linear_swept_spheres: PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV => RayTracingLinearSweptSpheresGeometryNV;
        micromap: PhysicalDeviceOpacityMicromapFeaturesEXT => RayTracingOpacityMicromapEXT;
        micromap: PhysicalDeviceOpacityMicromapFeaturesKHR -> RayTracingOpacityMicromapExecutionModeKHR;
        pipeline_opacity_micromap: PhysicalDevicePipelineOpacityMicromapFeaturesARM;
        micromap_capture_replay: PhysicalDeviceOpacityMicromapFeaturesEXT;
        micromap_host_commands: PhysicalDeviceOpacityMicromapFeaturesEXT;
        pipeline_library_group_handles: PhysicalDevicePipelineLibraryGroupHandlesFeaturesEXT;

        shader_buffer_float32_atomics: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_buffer_float32_atomic_add: PhysicalDeviceShaderAtomicFloatFeaturesEXT => AtomicFloat32AddEXT;
        shader_buffer_float64_atomics: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_buffer_float64_atomic_add: PhysicalDeviceShaderAtomicFloatFeaturesEXT => AtomicFloat64AddEXT;
        shader_shared_float32_atomics: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_shared_float32_atomic_add: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_shared_float64_atomics: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_shared_float64_atomic_add: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_image_float32_atomics: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_image_float32_atomic_add: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        sparse_image_float32_atomics: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        sparse_image_float32_atomic_add: PhysicalDeviceShaderAtomicFloatFeaturesEXT;
        shader_buffer_float16_atomics: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        shader_buffer_float16_atomic_add: PhysicalDeviceShaderAtomicFloat2FeaturesEXT => AtomicFloat16AddEXT;
        shader_buffer_float16_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT => AtomicFloat16MinMaxEXT;
        shader_shared_float16_atomics: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        shader_shared_float16_atomic_add: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        shader_shared_float16_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        shader_buffer_float32_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT => AtomicFloat32MinMaxEXT;
        shader_buffer_float64_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT => AtomicFloat64MinMaxEXT;
        shader_shared_float32_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        shader_shared_float64_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        shader_image_float32_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        sparse_image_float32_atomic_min_max: PhysicalDeviceShaderAtomicFloat2FeaturesEXT;
        shader_image_int64_atomics: PhysicalDeviceShaderImageAtomicInt64FeaturesEXT => Int64ImageEXT;
        sparse_image_int64_atomics: PhysicalDeviceShaderImageAtomicInt64FeaturesEXT;
        shader_expect_assume: PhysicalDeviceVulkan14Features PhysicalDeviceShaderExpectAssumeFeaturesKHR => ExpectAssumeKHR;
        shader_float_controls2: PhysicalDeviceVulkan14Features PhysicalDeviceShaderFloatControls2FeaturesKHR => FloatControls2;
        compute_derivative_group_quads: PhysicalDeviceComputeShaderDerivativesFeaturesNV => ComputeDerivativeGroupQuadsKHR;
        compute_derivative_group_linear: PhysicalDeviceComputeShaderDerivativesFeaturesNV => ComputeDerivativeGroupLinearKHR;
        shader_maximal_reconvergence: PhysicalDeviceShaderMaximalReconvergenceFeaturesKHR;
        shader_quad_control: PhysicalDeviceShaderQuadControlFeaturesKHR => QuadControlKHR;
        shader_relaxed_extended_instruction: PhysicalDeviceShaderRelaxedExtendedInstructionFeaturesKHR;
        shader_replicated_composites: PhysicalDeviceShaderReplicatedCompositesFeaturesEXT => ReplicatedCompositesEXT;
        shader_subgroup_uniform_control_flow: PhysicalDeviceShaderSubgroupUniformControlFlowFeaturesKHR;
        shader_subgroup_rotate: PhysicalDeviceVulkan14Features PhysicalDeviceShaderSubgroupRotateFeaturesKHR => GroupNonUniformRotateKHR;
        shader_subgroup_rotate_clustered: PhysicalDeviceVulkan14Features PhysicalDeviceShaderSubgroupRotateFeaturesKHR;
        shader_subgroup_partitioned: PhysicalDeviceShaderSubgroupPartitionedFeaturesEXT;
        cooperative_matrix: PhysicalDeviceCooperativeMatrixFeaturesKHR => CooperativeMatrixKHR;
        cooperative_matrix_robust_buffer_access: PhysicalDeviceCooperativeMatrixFeaturesKHR;
        cooperative_vector: PhysicalDeviceCooperativeVectorFeaturesNV => CooperativeVectorNV;
        shader_b_float16_type: PhysicalDeviceShaderBfloat16FeaturesKHR => BFloat16TypeKHR;
        shader_b_float16_dot_product: PhysicalDeviceShaderBfloat16FeaturesKHR => BFloat16DotProductKHR;
        shader_b_float16_cooperative_matrix: PhysicalDeviceShaderBfloat16FeaturesKHR => BFloat16CooperativeMatrixKHR;
        shader_untyped_pointers: PhysicalDeviceShaderUntypedPointersFeaturesKHR => UntypedPointersKHR;
        workgroup_memory_explicit_layout: PhysicalDeviceWorkgroupMemoryExplicitLayoutFeaturesKHR => WorkgroupMemoryExplicitLayoutKHR;
        workgroup_memory_explicit_layout_scalar_block_layout: PhysicalDeviceWorkgroupMemoryExplicitLayoutFeaturesKHR;
        workgroup_memory_explicit_layout8_bit_access: PhysicalDeviceWorkgroupMemoryExplicitLayoutFeaturesKHR => WorkgroupMemoryExplicitLayout8BitAccessKHR;
        workgroup_memory_explicit_layout16_bit_access: PhysicalDeviceWorkgroupMemoryExplicitLayoutFeaturesKHR => WorkgroupMemoryExplicitLayout16BitAccessKHR;
        host_image_copy: PhysicalDeviceVulkan14Features PhysicalDeviceHostImageCopyFeaturesEXT;
        sampler_ycbcr_conversion: PhysicalDeviceVulkan11Features PhysicalDeviceSamplerYcbcrConversionFeatures;
        ycbcr2plane444_formats: PhysicalDeviceYcbcr2Plane444FormatsFeaturesEXT;
        ycbcr_image_arrays: PhysicalDeviceYcbcrImageArraysFeaturesEXT;
        border_color_swizzle: PhysicalDeviceBorderColorSwizzleFeaturesEXT;
        border_color_swizzle_from_image: PhysicalDeviceBorderColorSwizzleFeaturesEXT;
        image2_d_view_of3_d: PhysicalDeviceImage2DViewOf3DFeaturesEXT;
        sampler2_d_view_of3_d: PhysicalDeviceImage2DViewOf3DFeaturesEXT;
        non_seamless_cube_map: PhysicalDeviceNonSeamlessCubeMapFeaturesEXT;
        custom_border_colors: PhysicalDeviceCustomBorderColorFeaturesEXT;
        custom_border_color_without_format: PhysicalDeviceCustomBorderColorFeaturesEXT;
        min_lod: PhysicalDeviceImageViewMinLodFeaturesEXT;
        image_sliced_view_of3_d: PhysicalDeviceImageSlicedViewOf3DFeaturesEXT;
        descriptor_buffer: PhysicalDeviceDescriptorBufferFeaturesEXT;
        descriptor_buffer_capture_replay: PhysicalDeviceDescriptorBufferFeaturesEXT;
        descriptor_buffer_image_layout_ignored: PhysicalDeviceDescriptorBufferFeaturesEXT;
        descriptor_buffer_push_descriptors: PhysicalDeviceDescriptorBufferFeaturesEXT;
        descriptor_heap: PhysicalDeviceDescriptorHeapFeaturesEXT => DescriptorHeapEXT;
        descriptor_heap_capture_replay: PhysicalDeviceDescriptorHeapFeaturesEXT;
        mutable_descriptor_type: PhysicalDeviceMutableDescriptorTypeFeaturesEXT;
        memory_priority: PhysicalDeviceMemoryPriorityFeaturesEXT;
        pageable_device_local_memory: PhysicalDevicePageableDeviceLocalMemoryFeaturesEXT;
        zero_initialize_device_memory: PhysicalDeviceZeroInitializeDeviceMemoryFeaturesEXT;
        format_a4r4g4b4: PhysicalDevice4444FormatsFeaturesEXT;
        format_a4b4g4r4: PhysicalDevice4444FormatsFeaturesEXT;
        report_address_binding: PhysicalDeviceAddressBindingReportFeaturesEXT;
        device_fault: PhysicalDeviceFaultFeaturesKHR PhysicalDeviceFaultFeaturesEXT;
        null_descriptor: PhysicalDeviceRobustness2FeaturesEXT;
        robust_buffer_access2: PhysicalDeviceRobustness2FeaturesEXT;
        robust_image_access2: PhysicalDeviceRobustness2FeaturesEXT;
        shader_subgroup_clock: PhysicalDeviceShaderClockFeaturesKHR => ShaderClockKHR;
        shader_device_clock: PhysicalDeviceShaderClockFeaturesKHR;
        texel_buffer_alignment: PhysicalDeviceTexelBufferAlignmentFeaturesEXT;
        present_id: PhysicalDevicePresentIdFeaturesKHR;
        present_id2: PhysicalDevicePresentId2FeaturesKHR;
        present_mode_fifo_latest_ready: PhysicalDevicePresentModeFifoLatestReadyFeaturesKHR;
        present_timing: PhysicalDevicePresentTimingFeaturesEXT;
        present_at_absolute_time: PhysicalDevicePresentTimingFeaturesEXT;
        present_at_relative_time: PhysicalDevicePresentTimingFeaturesEXT;
        present_wait: PhysicalDevicePresentWaitFeaturesKHR;
        present_wait2: PhysicalDevicePresentWait2FeaturesKHR;
        swapchain_maintenance1: PhysicalDeviceSwapchainMaintenance1FeaturesEXT;

        multiview: PhysicalDeviceVulkan11Features PhysicalDeviceMultiviewFeatures => MultiView;
        multiview_geometry_shader: PhysicalDeviceVulkan11Features PhysicalDeviceMultiviewFeatures;
        multiview_tessellation_shader: PhysicalDeviceVulkan11Features PhysicalDeviceMultiviewFeatures;
        shader_draw_parameters: PhysicalDeviceVulkan11Features PhysicalDeviceShaderDrawParametersFeatures => DrawParameters;
        draw_indirect_count: PhysicalDeviceVulkan12Features;
        imageless_framebuffer: PhysicalDeviceVulkan12Features PhysicalDeviceImagelessFramebufferFeatures;
        shader_output_viewport_index: PhysicalDeviceVulkan12Features => ShaderViewportIndex ShaderViewportIndexLayerEXT;
        shader_output_layer: PhysicalDeviceVulkan12Features => ShaderLayer;
        shader_input_attachment_array_dynamic_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => InputAttachmentArrayDynamicIndexing;
        shader_input_attachment_array_non_uniform_indexing: PhysicalDeviceVulkan12Features PhysicalDeviceDescriptorIndexingFeatures => InputAttachmentArrayNonUniformIndexing;
        storage_input_output16: PhysicalDeviceVulkan11Features PhysicalDevice16BitStorageFeatures => StorageInputOutput16;
        dynamic_rendering: PhysicalDeviceVulkan13Features PhysicalDeviceDynamicRenderingFeatures;
        dynamic_rendering_local_read: PhysicalDeviceVulkan14Features PhysicalDeviceDynamicRenderingLocalReadFeaturesKHR;
        dynamic_rendering_unused_attachments: PhysicalDeviceDynamicRenderingUnusedAttachmentsFeaturesEXT;
        index_type_uint8: PhysicalDeviceVulkan14Features PhysicalDeviceIndexTypeUint8FeaturesKHR;
        rectangular_lines: PhysicalDeviceVulkan14Features PhysicalDeviceLineRasterizationFeaturesKHR;
        smooth_lines: PhysicalDeviceVulkan14Features PhysicalDeviceLineRasterizationFeaturesKHR;
        bresenham_lines: PhysicalDeviceVulkan14Features PhysicalDeviceLineRasterizationFeaturesKHR;
        stippled_rectangular_lines: PhysicalDeviceVulkan14Features PhysicalDeviceLineRasterizationFeaturesKHR;
        stippled_smooth_lines: PhysicalDeviceVulkan14Features PhysicalDeviceLineRasterizationFeaturesKHR;
        stippled_bresenham_lines: PhysicalDeviceVulkan14Features PhysicalDeviceLineRasterizationFeaturesKHR;
        vertex_attribute_instance_rate_divisor: PhysicalDeviceVulkan14Features PhysicalDeviceVertexAttributeDivisorFeaturesKHR;
        vertex_attribute_instance_rate_zero_divisor: PhysicalDeviceVulkan14Features PhysicalDeviceVertexAttributeDivisorFeaturesKHR;
        color_write_enable: PhysicalDeviceColorWriteEnableFeaturesEXT;
        advanced_blend_coherent_operations: PhysicalDeviceBlendOperationAdvancedFeaturesEXT;
        depth_bias_control: PhysicalDeviceDepthBiasControlFeaturesEXT;
        least_representable_value_force_unorm_representation: PhysicalDeviceDepthBiasControlFeaturesEXT;
        float_representation: PhysicalDeviceDepthBiasControlFeaturesEXT;
        depth_bias_exact: PhysicalDeviceDepthBiasControlFeaturesEXT;
        depth_clip_control: PhysicalDeviceDepthClipControlFeaturesEXT;
        multisampled_render_to_single_sampled: PhysicalDeviceMultisampledRenderToSingleSampledFeaturesEXT;
        depth_clamp_control: PhysicalDeviceDepthClampControlFeaturesEXT;
        depth_clamp_zero_one: PhysicalDeviceDepthClampZeroOneFeaturesEXT;
        depth_clip_enable: PhysicalDeviceDepthClipEnableFeaturesEXT;
        extended_dynamic_state: PhysicalDeviceExtendedDynamicStateFeaturesEXT;
        extended_dynamic_state2: PhysicalDeviceExtendedDynamicState2FeaturesEXT;
        extended_dynamic_state2_logic_op: PhysicalDeviceExtendedDynamicState2FeaturesEXT;
        extended_dynamic_state2_patch_control_points: PhysicalDeviceExtendedDynamicState2FeaturesEXT;
        extended_dynamic_state3_tessellation_domain_origin: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_depth_clamp_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_polygon_mode: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_rasterization_samples: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_sample_mask: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_sample_locations_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_alpha_to_coverage_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_alpha_to_one_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_logic_op_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_color_blend_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_color_blend_equation: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_color_blend_advanced: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_color_write_mask: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_depth_clip_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_provoking_vertex_mode: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_line_rasterization_mode: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_rasterization_stream: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_line_stipple_enable: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        extended_dynamic_state3_depth_clip_negative_one_to_one: PhysicalDeviceExtendedDynamicState3FeaturesEXT;
        legacy_vertex_attributes: PhysicalDeviceLegacyVertexAttributesFeaturesEXT;
        primitive_restart_index: PhysicalDevicePrimitiveRestartIndexFeaturesEXT;
        maintenance7: PhysicalDeviceMaintenance7FeaturesKHR;
        indirect_memory_copy: PhysicalDeviceCopyMemoryIndirectFeaturesKHR;
        indirect_memory_to_image_copy: PhysicalDeviceCopyMemoryIndirectFeaturesKHR;
        maintenance8: PhysicalDeviceMaintenance8FeaturesKHR;
        maintenance9: PhysicalDeviceMaintenance9FeaturesKHR;
        internally_synchronized_queues: PhysicalDeviceInternallySynchronizedQueuesFeaturesKHR;
        shader_abort: PhysicalDeviceShaderAbortFeaturesKHR -> AbortKHR;
        shader_constant_data: PhysicalDeviceShaderConstantDataFeaturesKHR -> ConstantDataKHR;
        shader_fma_float16: PhysicalDeviceShaderFmaFeaturesKHR => FMAKHR;
        shader_fma_float32: PhysicalDeviceShaderFmaFeaturesKHR => FMAKHR;
        shader_fma_float64: PhysicalDeviceShaderFmaFeaturesKHR => FMAKHR;
        shader_split_barrier: PhysicalDeviceShaderSplitBarrierFeaturesEXT => SplitBarrierINTEL;
        long_vector: PhysicalDeviceShaderLongVectorFeaturesEXT => LongVectorEXT;
        shader64_bit_indexing: PhysicalDeviceShader64BitIndexingFeaturesEXT => Shader64BitIndexingEXT;
        maintenance10: PhysicalDeviceMaintenance10FeaturesKHR;
        maintenance11: PhysicalDeviceMaintenance11FeaturesKHR;
        extended_flags: PhysicalDeviceExtendedFlagsFeaturesKHR;
        fragment_shader_barycentric: PhysicalDeviceFragmentShaderBarycentricFeaturesKHR => FragmentBarycentricKHR;
        pipeline_fragment_shading_rate: PhysicalDeviceFragmentShadingRateFeaturesKHR => FragmentShadingRateKHR;
        primitive_fragment_shading_rate: PhysicalDeviceFragmentShadingRateFeaturesKHR => FragmentShadingRateKHR;
        attachment_fragment_shading_rate: PhysicalDeviceFragmentShadingRateFeaturesKHR => FragmentShadingRateKHR;
        fragment_shader_sample_interlock: PhysicalDeviceFragmentShaderInterlockFeaturesEXT => FragmentShaderSampleInterlockEXT;
        fragment_shader_pixel_interlock: PhysicalDeviceFragmentShaderInterlockFeaturesEXT => FragmentShaderPixelInterlockEXT;
        rasterization_order_color_attachment_access: PhysicalDeviceRasterizationOrderAttachmentAccessFeaturesEXT;
        rasterization_order_depth_attachment_access: PhysicalDeviceRasterizationOrderAttachmentAccessFeaturesEXT;
        rasterization_order_stencil_attachment_access: PhysicalDeviceRasterizationOrderAttachmentAccessFeaturesEXT;
        attachment_feedback_loop_layout: PhysicalDeviceAttachmentFeedbackLoopLayoutFeaturesEXT;
        attachment_feedback_loop_dynamic_state: PhysicalDeviceAttachmentFeedbackLoopDynamicStateFeaturesEXT;
        graphics_pipeline_library: PhysicalDeviceGraphicsPipelineLibraryFeaturesEXT;
        multi_draw: PhysicalDeviceMultiDrawFeaturesEXT;
        nested_command_buffer: PhysicalDeviceNestedCommandBufferFeaturesEXT;
        nested_command_buffer_rendering: PhysicalDeviceNestedCommandBufferFeaturesEXT;
        nested_command_buffer_simultaneous_use: PhysicalDeviceNestedCommandBufferFeaturesEXT;
        push_descriptor: PhysicalDeviceVulkan14Features;
        global_priority_query: PhysicalDeviceVulkan14Features PhysicalDeviceGlobalPriorityQueryFeaturesKHR;
        unified_image_layouts: PhysicalDeviceUnifiedImageLayoutsFeaturesKHR;
        conditional_rendering: PhysicalDeviceConditionalRenderingFeaturesEXT;
        inherited_conditional_rendering: PhysicalDeviceConditionalRenderingFeaturesEXT;
        pipeline_protected_access: PhysicalDeviceVulkan14Features PhysicalDevicePipelineProtectedAccessFeaturesEXT;
        shader_object: PhysicalDeviceShaderObjectFeaturesEXT;
        maintenance6: PhysicalDeviceVulkan14Features PhysicalDeviceMaintenance6FeaturesKHR;
        pipeline_robustness: PhysicalDeviceVulkan14Features PhysicalDevicePipelineRobustnessFeaturesEXT;
        pipeline_binaries: PhysicalDevicePipelineBinaryFeaturesKHR;
        pipeline_executable_info: PhysicalDevicePipelineExecutablePropertiesFeaturesKHR;
        primitive_topology_list_restart: PhysicalDevicePrimitiveTopologyListRestartFeaturesEXT;
        primitive_topology_patch_list_restart: PhysicalDevicePrimitiveTopologyListRestartFeaturesEXT;
        provoking_vertex_last: PhysicalDeviceProvokingVertexFeaturesEXT;
        transform_feedback_preserves_provoking_vertex: PhysicalDeviceProvokingVertexFeaturesEXT;
        task_shader: PhysicalDeviceMeshShaderFeaturesEXT;
        mesh_shader: PhysicalDeviceMeshShaderFeaturesEXT => MeshShadingEXT;
        multiview_mesh_shader: PhysicalDeviceMeshShaderFeaturesEXT;
        mesh_shader_queries: PhysicalDeviceMeshShaderFeaturesEXT;
        primitive_fragment_shading_rate_mesh_shader: PhysicalDeviceMeshShaderFeaturesEXT;
        transform_feedback: PhysicalDeviceTransformFeedbackFeaturesEXT => TransformFeedback;
        geometry_streams: PhysicalDeviceTransformFeedbackFeaturesEXT => GeometryStreams;
        primitives_generated_query: PhysicalDevicePrimitivesGeneratedQueryFeaturesEXT;
        primitives_generated_query_with_rasterizer_discard: PhysicalDevicePrimitivesGeneratedQueryFeaturesEXT;
        primitives_generated_query_with_non_zero_streams: PhysicalDevicePrimitivesGeneratedQueryFeaturesEXT;
        vertex_input_dynamic_state: PhysicalDeviceVertexInputDynamicStateFeaturesEXT;
    }
    without_support {
        PhysicalDeviceProtectedMemoryFeatures
        PhysicalDeviceTextureCompressionASTCHDRFeatures
    }
}

/// Capabilities that need no feature.
const BASE_CAPABILITIES: &[Capability] = &[
    Capability::Matrix,
    Capability::Shader,
    Capability::Sampled1D,
    Capability::Image1D,
    Capability::SampledBuffer,
    Capability::ImageBuffer,
    Capability::ImageQuery,
    Capability::InputAttachment,
    Capability::StencilExportEXT,
    Capability::DeviceGroup,
    Capability::StorageImageExtendedFormats,
    Capability::GroupNonUniform,
    Capability::GroupNonUniformVote,
    Capability::GroupNonUniformArithmetic,
    Capability::GroupNonUniformBallot,
    Capability::GroupNonUniformShuffle,
    Capability::GroupNonUniformShuffleRelative,
    Capability::GroupNonUniformClustered,
    Capability::GroupNonUniformQuad,
    Capability::GroupNonUniformPartitionedEXT,
    Capability::SubgroupBallotKHR,
    Capability::SubgroupVoteKHR,
    Capability::DemoteToHelperInvocation,
    Capability::DerivativeControl,
    Capability::SampleMaskPostDepthCoverage,
    Capability::DenormPreserve,
    // Without effect: see docs/capabilities.md.
    Capability::DenormFlushToZero,
    Capability::SignedZeroInfNanPreserve,
    Capability::RoundingModeRTE,
    // `VK_NV_ray_tracing` has no features.
    Capability::RayTracingNV,
];

/// All capabilities that a shader module may declare.
pub fn capabilities() -> Vec<Capability> {
    [BASE_CAPABILITIES, FEATURE_CAPABILITIES].concat()
}

/// Fills every feature structure of an output chain.
///
/// # Safety
/// As [`chain::nodes_mut`].
pub unsafe fn fill_chain(next: *mut std::ffi::c_void) {
    // SAFETY: the caller keeps the promises of `chain::nodes_mut`.
    unsafe {
        for node in chain::nodes_mut(next) {
            if let Some(bytes) = structure_bytes((*node).s_type) {
                node.cast::<u8>()
                    .add(HEAD_BYTES)
                    .write_bytes(0, bytes - HEAD_BYTES);
                set_supported(node);
            }
        }
    }
}

/// Checks the features of a new device.
///
/// # Errors
/// `VK_ERROR_FEATURE_NOT_PRESENT`.
///
/// # Safety
/// `info` is valid usage of `vkCreateDevice`.
pub unsafe fn check_requested(info: &vk::DeviceCreateInfo<'_>) -> VkResult {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateDevice`; feature
    // structures are words after their head.
    unsafe {
        let core2 = chain::find::<vk::PhysicalDeviceFeatures2>(info.p_next).map(|f| &f.features);
        for requested in core2.into_iter().chain(info.p_enabled_features.as_ref()) {
            check_words(words(requested), words(&core_features()))?;
        }
        for node in chain::nodes(info.p_next) {
            let Some(bytes) = structure_bytes(node.s_type) else {
                continue;
            };
            let mut supported = vec![0u64; bytes.div_ceil(8)];
            let head = supported.as_mut_ptr().cast::<vk::BaseOutStructure<'_>>();
            (*head).s_type = node.s_type;
            set_supported(head);
            let body = |start: *const u8| {
                std::slice::from_raw_parts(
                    start.add(HEAD_BYTES).cast::<u32>(),
                    (bytes - HEAD_BYTES) / 4,
                )
            };
            check_words(body(std::ptr::from_ref(node).cast()), body(head.cast()))?;
        }
        Ok(())
    }
}

fn words(features: &vk::PhysicalDeviceFeatures) -> &[u32] {
    let count = size_of::<vk::PhysicalDeviceFeatures>() / 4;
    // SAFETY: the structure is `count` `VkBool32`s.
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(features).cast(), count) }
}

fn check_words(requested: &[u32], supported: &[u32]) -> VkResult {
    let missing = requested
        .iter()
        .zip(supported)
        .any(|(&asked, &there)| asked != vk::FALSE && there == vk::FALSE);
    if missing {
        Err(vk::Result::ERROR_FEATURE_NOT_PRESENT)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_are_answered_and_checked() {
        let mut unsupported =
            vk::PhysicalDeviceProtectedMemoryFeatures::default().protected_memory(true);
        let mut v12 = vk::PhysicalDeviceVulkan12Features {
            p_next: (&raw mut unsupported).cast(),
            ..Default::default()
        };
        // SAFETY: the chain is the two structures above.
        unsafe { fill_chain((&raw mut v12).cast()) };
        assert_eq!(unsupported.protected_memory, vk::FALSE);
        assert_eq!(v12.buffer_device_address, vk::TRUE);
        assert_eq!(v12.draw_indirect_count, vk::TRUE);

        let check = |next: *const std::ffi::c_void| {
            let info = vk::DeviceCreateInfo {
                p_next: next,
                ..Default::default()
            };
            // SAFETY: the chain holds what the caller below made.
            unsafe { check_requested(&info) }
        };
        assert_eq!(check((&raw const v12).cast()), Ok(()));
        // Through a pointer, because the chain reads it through one.
        // SAFETY: the structure above.
        unsafe { (&raw mut unsupported.protected_memory).write(vk::TRUE) };
        assert_eq!(
            check((&raw const v12).cast()),
            Err(vk::Result::ERROR_FEATURE_NOT_PRESENT)
        );
        let core = vk::PhysicalDeviceFeatures2::default()
            .features(vk::PhysicalDeviceFeatures::default().sparse_residency16_samples(true));
        assert_eq!(
            check((&raw const core).cast()),
            Err(vk::Result::ERROR_FEATURE_NOT_PRESENT)
        );
    }

    /// `docs/capabilities.md` lists the capabilities that the compiler refuses. That is the
    /// driver's list only if devices enable the rest.
    #[test]
    fn devices_enable_what_the_compiler_takes() {
        let enabled = capabilities();
        let mut missing = spirv_jit::lower::SUPPORTED_CAPABILITIES.to_vec();
        missing.retain(|it| !enabled.contains(it));
        assert!(missing.is_empty(), "{missing:?}");
        let mut missing = NewerCapability::ALL.to_vec();
        missing.retain(|it| !NEWER_CAPABILITIES.contains(it));
        assert!(missing.is_empty(), "{missing:?}");
    }
}
