//! Vulkan's types: those of `ash`, and the structures that are newer than it, in the same style.

use std::ffi::{c_char, c_void};
use std::marker::PhantomData;

pub use ash::vk::*;

macro_rules! structures {
    ($($(#[$doc:meta])* $name:ident $ty:literal $next:ty { $($field:ident: $field_ty:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Clone, Copy)]
            pub struct $name<'a> {
                pub s_type: StructureType,
                pub p_next: $next,
                $(pub $field: $field_ty,)*
                pub _marker: PhantomData<&'a ()>,
            }

            // SAFETY: the structure begins with its type and the next pointer, as all of them.
            unsafe impl TaggedStructure for $name<'_> {
                const STRUCTURE_TYPE: StructureType = StructureType::from_raw($ty);
            }

            impl Default for $name<'_> {
                fn default() -> Self {
                    // SAFETY: all zero is a value of each field.
                    let mut structure: Self = unsafe { std::mem::zeroed() };
                    structure.s_type = Self::STRUCTURE_TYPE;
                    structure
                }
            }
        )*
    };
}

/// `VK_COMPONENT_TYPE_BFLOAT16_KHR`.
pub const COMPONENT_TYPE_BFLOAT16_KHR: ComponentTypeKHR = ComponentTypeKHR::from_raw(1_000_141_000);

/// `VK_COMPONENT_TYPE_SINT8_PACKED_NV`.
pub const COMPONENT_TYPE_SINT8_PACKED_NV: ComponentTypeKHR =
    ComponentTypeKHR::from_raw(1_000_491_000);
/// `VK_COMPONENT_TYPE_UINT8_PACKED_NV`.
pub const COMPONENT_TYPE_UINT8_PACKED_NV: ComponentTypeKHR =
    ComponentTypeKHR::from_raw(1_000_491_001);
/// `VK_COMPONENT_TYPE_FLOAT_E4M3_NV`.
pub const COMPONENT_TYPE_FLOAT_E4M3_NV: ComponentTypeKHR =
    ComponentTypeKHR::from_raw(1_000_491_002);
/// `VK_COMPONENT_TYPE_FLOAT_E5M2_NV`.
pub const COMPONENT_TYPE_FLOAT_E5M2_NV: ComponentTypeKHR =
    ComponentTypeKHR::from_raw(1_000_491_003);

/// `VkCooperativeVectorMatrixLayoutNV`.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CooperativeVectorMatrixLayoutNV(pub i32);

impl CooperativeVectorMatrixLayoutNV {
    pub const COLUMN_MAJOR: Self = Self(1);
}

/// `VK_DYNAMIC_STATE_DEPTH_CLAMP_RANGE_EXT`.
pub const DYNAMIC_STATE_DEPTH_CLAMP_RANGE_EXT: DynamicState = DynamicState::from_raw(1_000_582_000);

/// `VK_DEPTH_CLAMP_MODE_USER_DEFINED_RANGE_EXT`.
pub const DEPTH_CLAMP_MODE_USER_DEFINED_RANGE_EXT: i32 = 1;

#[repr(C)]
#[derive(Clone, Copy)]
pub struct DepthClampRangeEXT {
    pub min_depth_clamp: f32,
    pub max_depth_clamp: f32,
}

/// `VK_GEOMETRY_TYPE_MICROMAP_KHR`.
pub const GEOMETRY_TYPE_MICROMAP_KHR: GeometryTypeKHR = GeometryTypeKHR::from_raw(1_000_623_000);

/// `VK_ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR`.
pub const ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR: AccelerationStructureTypeKHR =
    AccelerationStructureTypeKHR::from_raw(1_000_623_000);

/// The version 1.4 of Vulkan.
pub const API_VERSION_1_4: u32 = make_api_version(0, 1, 4, 0);

structures! {
    PhysicalDeviceVulkan14Features 55 *mut c_void {
        global_priority_query: Bool32,
        shader_subgroup_rotate: Bool32,
        shader_subgroup_rotate_clustered: Bool32,
        shader_float_controls2: Bool32,
        shader_expect_assume: Bool32,
        rectangular_lines: Bool32,
        bresenham_lines: Bool32,
        smooth_lines: Bool32,
        stippled_rectangular_lines: Bool32,
        stippled_bresenham_lines: Bool32,
        stippled_smooth_lines: Bool32,
        vertex_attribute_instance_rate_divisor: Bool32,
        vertex_attribute_instance_rate_zero_divisor: Bool32,
        index_type_uint8: Bool32,
        dynamic_rendering_local_read: Bool32,
        maintenance5: Bool32,
        maintenance6: Bool32,
        pipeline_protected_access: Bool32,
        pipeline_robustness: Bool32,
        host_image_copy: Bool32,
        push_descriptor: Bool32,
    }
    PhysicalDeviceVulkan14Properties 56 *mut c_void {
        line_sub_pixel_precision_bits: u32,
        max_vertex_attrib_divisor: u32,
        supports_non_zero_first_instance: Bool32,
        max_push_descriptors: u32,
        dynamic_rendering_local_read_depth_stencil_attachments: Bool32,
        dynamic_rendering_local_read_multisampled_attachments: Bool32,
        early_fragment_multisample_coverage_after_sample_counting: Bool32,
        early_fragment_sample_mask_test_before_sample_counting: Bool32,
        depth_stencil_swizzle_one_support: Bool32,
        polygon_mode_point_size: Bool32,
        non_strict_single_pixel_wide_lines_use_parallelogram: Bool32,
        non_strict_wide_lines_use_parallelogram: Bool32,
        block_texel_view_compatible_multiple_layers: Bool32,
        max_combined_image_sampler_descriptor_count: u32,
        fragment_shading_rate_clamp_combiner_inputs: Bool32,
        default_robustness_storage_buffers: PipelineRobustnessBufferBehaviorEXT,
        default_robustness_uniform_buffers: PipelineRobustnessBufferBehaviorEXT,
        default_robustness_vertex_inputs: PipelineRobustnessBufferBehaviorEXT,
        default_robustness_images: PipelineRobustnessImageBehaviorEXT,
        copy_src_layout_count: u32,
        p_copy_src_layouts: *mut ImageLayout,
        copy_dst_layout_count: u32,
        p_copy_dst_layouts: *mut ImageLayout,
        optimal_tiling_layout_uuid: [u8; UUID_SIZE],
        identical_memory_type_requirements: Bool32,
    }
    /// `VK_KHR_compute_shader_derivatives`.
    PhysicalDeviceComputeShaderDerivativesPropertiesKHR 1_000_511_000 *mut c_void {
        mesh_and_task_shader_derivatives: Bool32,
    }
    /// `VK_EXT_shader_replicated_composites`.
    PhysicalDeviceShaderReplicatedCompositesFeaturesEXT 1_000_564_000 *mut c_void {
        shader_replicated_composites: Bool32,
    }
    /// `VK_NV_cooperative_vector`.
    PhysicalDeviceCooperativeVectorFeaturesNV 1_000_491_000 *mut c_void {
        cooperative_vector: Bool32,
        cooperative_vector_training: Bool32,
    }
    PhysicalDeviceCooperativeVectorPropertiesNV 1_000_491_001 *mut c_void {
        cooperative_vector_supported_stages: ShaderStageFlags,
        cooperative_vector_training_float16_accumulation: Bool32,
        cooperative_vector_training_float32_accumulation: Bool32,
        max_cooperative_vector_components: u32,
    }
    CooperativeVectorPropertiesNV 1_000_491_002 *mut c_void {
        input_type: ComponentTypeKHR,
        input_interpretation: ComponentTypeKHR,
        matrix_interpretation: ComponentTypeKHR,
        bias_interpretation: ComponentTypeKHR,
        result_type: ComponentTypeKHR,
        transpose: Bool32,
    }
    ConvertCooperativeVectorMatrixInfoNV 1_000_491_004 *const c_void {
        src_size: usize,
        src_data: DeviceOrHostAddressConstKHR,
        p_dst_size: *mut usize,
        dst_data: DeviceOrHostAddressKHR,
        src_component_type: ComponentTypeKHR,
        dst_component_type: ComponentTypeKHR,
        num_rows: u32,
        num_columns: u32,
        src_layout: CooperativeVectorMatrixLayoutNV,
        src_stride: usize,
        dst_layout: CooperativeVectorMatrixLayoutNV,
        dst_stride: usize,
    }
    /// `VK_KHR_shader_bfloat16`.
    PhysicalDeviceShaderBfloat16FeaturesKHR 1_000_141_000 *mut c_void {
        shader_b_float16_type: Bool32,
        shader_b_float16_dot_product: Bool32,
        shader_b_float16_cooperative_matrix: Bool32,
    }
    /// `VK_KHR_shader_untyped_pointers`.
    PhysicalDeviceShaderUntypedPointersFeaturesKHR 1_000_387_000 *mut c_void {
        shader_untyped_pointers: Bool32,
    }
    /// `VK_EXT_shader_subgroup_partitioned`.
    PhysicalDeviceShaderSubgroupPartitionedFeaturesEXT 1_000_662_000 *mut c_void {
        shader_subgroup_partitioned: Bool32,
    }
    /// `VK_KHR_shader_relaxed_extended_instruction`.
    PhysicalDeviceShaderRelaxedExtendedInstructionFeaturesKHR 1_000_558_000 *mut c_void {
        shader_relaxed_extended_instruction: Bool32,
    }
    /// `VK_KHR_maintenance7`.
    PhysicalDeviceMaintenance7FeaturesKHR 1_000_562_000 *mut c_void {
        maintenance7: Bool32,
    }
    PhysicalDeviceMaintenance7PropertiesKHR 1_000_562_001 *mut c_void {
        robust_fragment_shading_rate_attachment_access: Bool32,
        separate_depth_stencil_attachment_access: Bool32,
        max_descriptor_set_total_uniform_buffers_dynamic: u32,
        max_descriptor_set_total_storage_buffers_dynamic: u32,
        max_descriptor_set_total_buffers_dynamic: u32,
        max_descriptor_set_update_after_bind_total_uniform_buffers_dynamic: u32,
        max_descriptor_set_update_after_bind_total_storage_buffers_dynamic: u32,
        max_descriptor_set_update_after_bind_total_buffers_dynamic: u32,
    }
    PhysicalDeviceLayeredApiPropertiesListKHR 1_000_562_002 *mut c_void {
        layered_api_count: u32,
        p_layered_apis: *mut c_void,
    }
    /// `VK_KHR_copy_memory_indirect`.
    PhysicalDeviceCopyMemoryIndirectFeaturesKHR 1_000_549_000 *mut c_void {
        indirect_memory_copy: Bool32,
        indirect_memory_to_image_copy: Bool32,
    }
    PhysicalDeviceCopyMemoryIndirectPropertiesKHR 1_000_426_001 *mut c_void {
        supported_queues: QueueFlags,
    }
    CopyMemoryIndirectInfoKHR 1_000_549_002 *const c_void {
        src_copy_flags: Flags,
        dst_copy_flags: Flags,
        copy_count: u32,
        copy_address_range: StridedDeviceAddressRangeKHR,
    }
    CopyMemoryToImageIndirectInfoKHR 1_000_549_003 *const c_void {
        src_copy_flags: Flags,
        copy_count: u32,
        copy_address_range: StridedDeviceAddressRangeKHR,
        dst_image: Image,
        dst_image_layout: ImageLayout,
        p_image_subresources: *const ImageSubresourceLayers,
    }
    /// `VK_KHR_maintenance8`.
    PhysicalDeviceMaintenance8FeaturesKHR 1_000_574_000 *mut c_void {
        maintenance8: Bool32,
    }
    /// `VK_KHR_maintenance9`.
    PhysicalDeviceMaintenance9FeaturesKHR 1_000_584_000 *mut c_void {
        maintenance9: Bool32,
    }
    PhysicalDeviceMaintenance9PropertiesKHR 1_000_584_001 *mut c_void {
        image2_d_view_of3_d_sparse: Bool32,
        default_vertex_attribute_value: DefaultVertexAttributeValueKHR,
    }
    QueueFamilyOwnershipTransferPropertiesKHR 1_000_584_002 *mut c_void {
        optimal_image_transfer_to_queue_families: u32,
    }
    /// `VK_KHR_internally_synchronized_queues`.
    PhysicalDeviceInternallySynchronizedQueuesFeaturesKHR 1_000_504_000 *mut c_void {
        internally_synchronized_queues: Bool32,
    }
    /// `VK_KHR_device_fault`.
    PhysicalDeviceFaultFeaturesKHR 1_000_573_000 *mut c_void {
        device_fault: Bool32,
        device_fault_vendor_binary: Bool32,
        device_fault_report_masked: Bool32,
        device_fault_device_lost_on_masked: Bool32,
    }
    PhysicalDeviceFaultPropertiesKHR 1_000_573_001 *mut c_void {
        max_device_fault_count: u32,
    }
    DeviceFaultInfoKHR 1_000_573_002 *mut c_void {
        flags: Flags,
        group_id: u64,
        description: [c_char; MAX_DESCRIPTION_SIZE],
        fault_address_info: DeviceFaultAddressInfoEXT,
        instruction_address_info: DeviceFaultAddressInfoEXT,
        vendor_info: DeviceFaultVendorInfoEXT,
    }
    DeviceFaultDebugInfoKHR 1_000_573_003 *mut c_void {
        vendor_binary_size: u32,
        p_vendor_binary_data: *mut c_void,
    }
    /// `VK_KHR_shader_abort`.
    PhysicalDeviceShaderAbortFeaturesKHR 1_000_233_000 *mut c_void {
        shader_abort: Bool32,
    }
    DeviceFaultShaderAbortMessageInfoKHR 1_000_233_001 *mut c_void {
        message_data_size: u64,
        p_message_data: *mut c_void,
    }
    PhysicalDeviceShaderAbortPropertiesKHR 1_000_233_002 *mut c_void {
        max_shader_abort_message_size: u64,
    }
    /// `VK_KHR_shader_constant_data`.
    PhysicalDeviceShaderConstantDataFeaturesKHR 1_000_231_000 *mut c_void {
        shader_constant_data: Bool32,
    }
    /// `VK_KHR_shader_fma`.
    PhysicalDeviceShaderFmaFeaturesKHR 1_000_579_000 *mut c_void {
        shader_fma_float16: Bool32,
        shader_fma_float32: Bool32,
        shader_fma_float64: Bool32,
    }
    /// `VK_EXT_shader_split_barrier`.
    PhysicalDeviceShaderSplitBarrierFeaturesEXT 1_000_305_000 *mut c_void {
        shader_split_barrier: Bool32,
    }
    PhysicalDeviceShaderSplitBarrierPropertiesEXT 1_000_305_001 *mut c_void {
        split_barrier_reserved_shared_memory: u32,
    }
    /// `VK_EXT_shader_long_vector`.
    PhysicalDeviceShaderLongVectorFeaturesEXT 1_000_635_000 *mut c_void {
        long_vector: Bool32,
    }
    PhysicalDeviceShaderLongVectorPropertiesEXT 1_000_635_001 *mut c_void {
        max_vector_components: u32,
    }
    /// `VK_EXT_shader_64bit_indexing`.
    PhysicalDeviceShader64BitIndexingFeaturesEXT 1_000_627_000 *mut c_void {
        shader64_bit_indexing: Bool32,
    }
    /// `VK_KHR_maintenance10`.
    PhysicalDeviceMaintenance10FeaturesKHR 1_000_630_000 *mut c_void {
        maintenance10: Bool32,
    }
    PhysicalDeviceMaintenance10PropertiesKHR 1_000_630_001 *mut c_void {
        rgba4_opaque_black_swizzled: Bool32,
        resolve_srgb_format_applies_transfer_function: Bool32,
        resolve_srgb_format_supports_transfer_function_control: Bool32,
    }
    RenderingAttachmentFlagsInfoKHR 1_000_630_002 *const c_void {
        flags: Flags,
    }
    ResolveImageModeInfoKHR 1_000_630_004 *const c_void {
        flags: Flags,
        resolve_mode: ResolveModeFlags,
        stencil_resolve_mode: ResolveModeFlags,
    }
    /// `VK_KHR_maintenance11`.
    PhysicalDeviceMaintenance11FeaturesKHR 1_000_657_000 *mut c_void {
        maintenance11: Bool32,
    }
    QueueFamilyOptimalImageTransferGranularityPropertiesKHR 1_000_657_001 *mut c_void {
        optimal_image_transfer_granularity: Extent3D,
    }
    /// `VK_KHR_extended_flags`.
    FormatProperties4KHR 1_000_668_000 *mut c_void {
        linear_tiling_features: Flags64,
        optimal_tiling_features: Flags64,
        buffer_features: Flags64,
    }
    ImageCreateFlags2CreateInfoKHR 1_000_668_001 *const c_void {
        flags: Flags64,
    }
    ImageUsageFlags2CreateInfoKHR 1_000_668_002 *const c_void {
        usage: Flags64,
    }
    PhysicalDeviceExtendedFlagsFeaturesKHR 1_000_668_004 *mut c_void {
        extended_flags: Bool32,
    }
    ImageStencilUsage2CreateInfoKHR 1_000_668_005 *const c_void {
        stencil_usage: Flags64,
    }
    SharedPresentSurfaceCapabilities2KHR 1_000_668_006 *mut c_void {
        shared_present_supported_usage_flags: Flags64,
    }
    /// `VK_KHR_unified_image_layouts`.
    PhysicalDeviceUnifiedImageLayoutsFeaturesKHR 1_000_527_000 *mut c_void {
        unified_image_layouts: Bool32,
        unified_image_layouts_video: Bool32,
    }
    /// `VK_EXT_legacy_vertex_attributes`.
    PhysicalDeviceLegacyVertexAttributesFeaturesEXT 1_000_495_000 *mut c_void {
        legacy_vertex_attributes: Bool32,
    }
    PhysicalDeviceLegacyVertexAttributesPropertiesEXT 1_000_495_001 *mut c_void {
        native_unaligned_performance: Bool32,
    }
    /// `VK_EXT_depth_clamp_control`.
    PhysicalDeviceDepthClampControlFeaturesEXT 1_000_582_000 *mut c_void {
        depth_clamp_control: Bool32,
    }
    PipelineViewportDepthClampControlCreateInfoEXT 1_000_582_001 *const c_void {
        depth_clamp_mode: i32,
        p_depth_clamp_range: *const DepthClampRangeEXT,
    }
    /// `VK_EXT_primitive_restart_index`.
    PhysicalDevicePrimitiveRestartIndexFeaturesEXT 1_000_678_000 *mut c_void {
        primitive_restart_index: Bool32,
    }
    /// `VK_EXT_zero_initialize_device_memory`.
    PhysicalDeviceZeroInitializeDeviceMemoryFeaturesEXT 1_000_620_000 *mut c_void {
        zero_initialize_device_memory: Bool32,
    }
    /// `VK_EXT_ray_tracing_invocation_reorder`.
    PhysicalDeviceRayTracingInvocationReorderFeaturesEXT 1_000_581_000 *mut c_void {
        ray_tracing_invocation_reorder: Bool32,
    }
    PhysicalDeviceRayTracingInvocationReorderPropertiesEXT 1_000_581_001 *mut c_void {
        ray_tracing_invocation_reorder_reordering_hint: RayTracingInvocationReorderModeNV,
        max_shader_binding_table_record_index: u32,
    }
    /// `VK_NV_ray_tracing_linear_swept_spheres`.
    PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV 1_000_429_008 *mut c_void {
        spheres: Bool32,
        linear_swept_spheres: Bool32,
    }
    AccelerationStructureGeometryLinearSweptSpheresDataNV 1_000_429_009 *const c_void {
        vertex_format: Format,
        vertex_data: DeviceOrHostAddressConstKHR,
        vertex_stride: DeviceSize,
        radius_format: Format,
        radius_data: DeviceOrHostAddressConstKHR,
        radius_stride: DeviceSize,
        index_type: IndexType,
        index_data: DeviceOrHostAddressConstKHR,
        index_stride: DeviceSize,
        indexing_mode: RayTracingLssIndexingModeNV,
        end_caps_mode: RayTracingLssPrimitiveEndCapsModeNV,
    }
    AccelerationStructureGeometrySpheresDataNV 1_000_429_010 *const c_void {
        vertex_format: Format,
        vertex_data: DeviceOrHostAddressConstKHR,
        vertex_stride: DeviceSize,
        radius_format: Format,
        radius_data: DeviceOrHostAddressConstKHR,
        radius_stride: DeviceSize,
        index_type: IndexType,
        index_data: DeviceOrHostAddressConstKHR,
        index_stride: DeviceSize,
    }
    /// `VK_KHR_device_address_commands`.
    DeviceMemoryCopyKHR 1_000_318_000 *const c_void {
        src_range: DeviceAddressRangeKHR,
        src_flags: AddressCommandFlagsKHR,
        dst_range: DeviceAddressRangeKHR,
        dst_flags: AddressCommandFlagsKHR,
    }
    CopyDeviceMemoryInfoKHR 1_000_318_001 *const c_void {
        region_count: u32,
        p_regions: *const DeviceMemoryCopyKHR<'a>,
    }
    DeviceMemoryImageCopyKHR 1_000_318_002 *const c_void {
        address_range: DeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
        address_row_length: u32,
        address_image_height: u32,
        image_subresource: ImageSubresourceLayers,
        image_layout: ImageLayout,
        image_offset: Offset3D,
        image_extent: Extent3D,
    }
    CopyDeviceMemoryImageInfoKHR 1_000_318_003 *const c_void {
        image: Image,
        region_count: u32,
        p_regions: *const DeviceMemoryImageCopyKHR<'a>,
    }
    PhysicalDeviceDeviceAddressCommandsFeaturesKHR 1_000_318_006 *mut c_void {
        device_address_commands: Bool32,
    }
    BindIndexBuffer3InfoKHR 1_000_318_007 *const c_void {
        address_range: DeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
        index_type: IndexType,
    }
    BindVertexBuffer3InfoKHR 1_000_318_008 *const c_void {
        set_stride: Bool32,
        address_range: StridedDeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
    }
    DrawIndirect2InfoKHR 1_000_318_009 *const c_void {
        address_range: StridedDeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
        draw_count: u32,
    }
    DrawIndirectCount2InfoKHR 1_000_318_010 *const c_void {
        address_range: StridedDeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
        count_address_range: DeviceAddressRangeKHR,
        count_address_flags: AddressCommandFlagsKHR,
        max_draw_count: u32,
    }
    ConditionalRenderingBeginInfo2EXT 1_000_318_012 *const c_void {
        address_range: DeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
        flags: ConditionalRenderingFlagsEXT,
    }
    BindTransformFeedbackBuffer2InfoEXT 1_000_318_013 *const c_void {
        address_range: DeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
    }
    DispatchIndirect2InfoKHR 1_000_318_011 *const c_void {
        address_range: DeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
    }
    AccelerationStructureCreateInfo2KHR 1_000_318_015 *const c_void {
        create_flags: AccelerationStructureCreateFlagsKHR,
        address_range: DeviceAddressRangeKHR,
        address_flags: AddressCommandFlagsKHR,
        ty: AccelerationStructureTypeKHR,
    }
    /// `VK_KHR_opacity_micromap`.
    TexelBufferDescriptorInfoEXT 1_000_135_000 *const c_void {
        format: Format,
        address_range: DeviceAddressRangeKHR,
    }
    ImageDescriptorInfoEXT 1_000_135_001 *const c_void {
        p_view: *const ImageViewCreateInfo<'a>,
        layout: ImageLayout,
    }
    ResourceDescriptorInfoEXT 1_000_135_002 *const c_void {
        ty: DescriptorType,
        data: ResourceDescriptorDataEXT<'a>,
    }
    BindHeapInfoEXT 1_000_135_003 *const c_void {
        heap_range: DeviceAddressRangeKHR,
        reserved_range_offset: DeviceSize,
        reserved_range_size: DeviceSize,
    }
    PushDataInfoEXT 1_000_135_004 *const c_void {
        offset: u32,
        data: HostAddressRangeEXT,
    }
    DescriptorSetAndBindingMappingEXT 1_000_135_005 *const c_void {
        descriptor_set: u32,
        first_binding: u32,
        binding_count: u32,
        resource_mask: u32,
        source: i32,
        source_data: DescriptorMappingSourceDataEXT<'a>,
    }
    ShaderDescriptorSetAndBindingMappingInfoEXT 1_000_135_006 *const c_void {
        mapping_count: u32,
        p_mappings: *const DescriptorSetAndBindingMappingEXT<'a>,
    }
    OpaqueCaptureDataCreateInfoEXT 1_000_135_007 *const c_void {
        p_data: *const HostAddressRangeEXT,
    }
    PhysicalDeviceDescriptorHeapPropertiesEXT 1_000_135_008 *mut c_void {
        sampler_heap_alignment: DeviceSize,
        resource_heap_alignment: DeviceSize,
        max_sampler_heap_size: DeviceSize,
        max_resource_heap_size: DeviceSize,
        min_sampler_heap_reserved_range: DeviceSize,
        min_sampler_heap_reserved_range_with_embedded: DeviceSize,
        min_resource_heap_reserved_range: DeviceSize,
        sampler_descriptor_size: DeviceSize,
        image_descriptor_size: DeviceSize,
        buffer_descriptor_size: DeviceSize,
        sampler_descriptor_alignment: DeviceSize,
        image_descriptor_alignment: DeviceSize,
        buffer_descriptor_alignment: DeviceSize,
        max_push_data_size: DeviceSize,
        image_capture_replay_opaque_data_size: usize,
        max_descriptor_heap_embedded_samplers: u32,
        sampler_ycbcr_conversion_count: u32,
        sparse_descriptor_heaps: Bool32,
        protected_descriptor_heaps: Bool32,
    }
    PhysicalDeviceDescriptorHeapFeaturesEXT 1_000_135_009 *mut c_void {
        descriptor_heap: Bool32,
        descriptor_heap_capture_replay: Bool32,
    }
    CommandBufferInheritanceDescriptorHeapInfoEXT 1_000_135_010 *const c_void {
        p_sampler_heap_bind_info: *const BindHeapInfoEXT<'a>,
        p_resource_heap_bind_info: *const BindHeapInfoEXT<'a>,
    }
    PhysicalDeviceOpacityMicromapFeaturesKHR 1_000_623_000 *mut c_void {
        micromap: Bool32,
    }
    PhysicalDeviceOpacityMicromapPropertiesKHR 1_000_623_001 *mut c_void {
        max_opacity2_state_subdivision_level: u32,
        max_opacity4_state_subdivision_level: u32,
        max_opacity_lossy4_state_subdivision_level: u32,
        max_micromap_triangles: u64,
    }
    AccelerationStructureGeometryMicromapDataKHR 1_000_623_002 *const c_void {
        usage_counts_count: u32,
        p_usage_counts: *const MicromapUsageEXT,
        pp_usage_counts: *const *const MicromapUsageEXT,
        data: DeviceAddress,
        triangle_array: DeviceAddress,
        triangle_array_stride: DeviceSize,
    }
    AccelerationStructureTrianglesOpacityMicromapKHR 1_000_623_003 *mut c_void {
        index_type: IndexType,
        index_buffer: DeviceAddress,
        index_stride: DeviceSize,
        base_triangle: u32,
        micromap: AccelerationStructureKHR,
    }
    /// `VK_ARM_pipeline_opacity_micromap`.
    PhysicalDevicePipelineOpacityMicromapFeaturesARM 1_000_596_000 *mut c_void {
        pipeline_opacity_micromap: Bool32,
    }
    /// `VK_KHR_pipeline_binary`.
    PhysicalDevicePipelineBinaryFeaturesKHR 1_000_483_000 *mut c_void {
        pipeline_binaries: Bool32,
    }
    PipelineBinaryCreateInfoKHR 1_000_483_001 *const c_void {
        p_keys_and_data_info: *const PipelineBinaryKeysAndDataKHR<'a>,
        pipeline: Pipeline,
        p_pipeline_create_info: *const PipelineCreateInfoKHR<'a>,
    }
    PipelineBinaryInfoKHR 1_000_483_002 *const c_void {
        binary_count: u32,
        p_pipeline_binaries: *const PipelineBinaryKHR,
    }
    PipelineBinaryKeyKHR 1_000_483_003 *mut c_void {
        key_size: u32,
        key: [u8; 32],
    }
    PhysicalDevicePipelineBinaryPropertiesKHR 1_000_483_004 *mut c_void {
        pipeline_binary_internal_cache: Bool32,
        pipeline_binary_internal_cache_control: Bool32,
        pipeline_binary_prefers_internal_cache: Bool32,
        pipeline_binary_precompiled_internal_cache: Bool32,
        pipeline_binary_compressed_data: Bool32,
    }
    ReleaseCapturedPipelineDataInfoKHR 1_000_483_005 *mut c_void {
        pipeline: Pipeline,
    }
    PipelineBinaryDataInfoKHR 1_000_483_006 *mut c_void {
        pipeline_binary: PipelineBinaryKHR,
    }
    PipelineCreateInfoKHR 1_000_483_007 *mut c_void {
    }
    PipelineBinaryHandlesInfoKHR 1_000_483_009 *const c_void {
        pipeline_binary_count: u32,
        p_pipeline_binaries: *mut PipelineBinaryKHR,
    }
    /// `VK_KHR_present_mode_fifo_latest_ready`.
    PhysicalDevicePresentModeFifoLatestReadyFeaturesKHR 1_000_361_000 *mut c_void {
        present_mode_fifo_latest_ready: Bool32,
    }
    /// `VK_KHR_present_id2`.
    SurfaceCapabilitiesPresentId2KHR 1_000_479_000 *mut c_void {
        present_id2_supported: Bool32,
    }
    PresentId2KHR 1_000_479_001 *const c_void {
        swapchain_count: u32,
        p_present_ids: *const u64,
    }
    PhysicalDevicePresentId2FeaturesKHR 1_000_479_002 *mut c_void {
        present_id2: Bool32,
    }
    /// `VK_KHR_present_wait2`.
    SurfaceCapabilitiesPresentWait2KHR 1_000_480_000 *mut c_void {
        present_wait2_supported: Bool32,
    }
    PhysicalDevicePresentWait2FeaturesKHR 1_000_480_001 *mut c_void {
        present_wait2: Bool32,
    }
    PresentWait2InfoKHR 1_000_480_002 *const c_void {
        present_id: u64,
        timeout: u64,
    }
    /// `VK_EXT_present_timing`.
    PhysicalDevicePresentTimingFeaturesEXT 1_000_208_000 *mut c_void {
        present_timing: Bool32,
        present_at_absolute_time: Bool32,
        present_at_relative_time: Bool32,
    }
    SwapchainTimingPropertiesEXT 1_000_208_001 *mut c_void {
        refresh_duration: u64,
        refresh_interval: u64,
    }
    SwapchainTimeDomainPropertiesEXT 1_000_208_002 *mut c_void {
        time_domain_count: u32,
        p_time_domains: *mut TimeDomainKHR,
        p_time_domain_ids: *mut u64,
    }
    PresentTimingsInfoEXT 1_000_208_003 *const c_void {
        swapchain_count: u32,
        p_timing_infos: *const PresentTimingInfoEXT<'a>,
    }
    PresentTimingInfoEXT 1_000_208_004 *const c_void {
        flags: Flags,
        target_time: u64,
        time_domain_id: u64,
        present_stage_queries: PresentStageFlagsEXT,
        target_time_domain_present_stage: PresentStageFlagsEXT,
    }
    PastPresentationTimingInfoEXT 1_000_208_005 *const c_void {
        flags: Flags,
        swapchain: SwapchainKHR,
    }
    PastPresentationTimingPropertiesEXT 1_000_208_006 *mut c_void {
        timing_properties_counter: u64,
        time_domains_counter: u64,
        presentation_timing_count: u32,
        p_presentation_timings: *mut PastPresentationTimingEXT<'a>,
    }
    PastPresentationTimingEXT 1_000_208_007 *mut c_void {
        present_id: u64,
        target_time: u64,
        present_stage_count: u32,
        p_present_stages: *mut PresentStageTimeEXT,
        time_domain: TimeDomainKHR,
        time_domain_id: u64,
        report_complete: Bool32,
    }
    PresentTimingSurfaceCapabilitiesEXT 1_000_208_008 *mut c_void {
        present_timing_supported: Bool32,
        present_at_absolute_time_supported: Bool32,
        present_at_relative_time_supported: Bool32,
        present_stage_queries: PresentStageFlagsEXT,
    }
}

/// `VK_PIPELINE_CREATE_2_64_BIT_INDEXING_BIT_EXT`.
pub const PIPELINE_CREATE_2_64_BIT_INDEXING_EXT: PipelineCreateFlags2KHR =
    PipelineCreateFlags2KHR::from_raw(1 << 43);
/// `VK_SHADER_CREATE_64_BIT_INDEXING_BIT_EXT`.
pub const SHADER_CREATE_64_BIT_INDEXING_EXT: ShaderCreateFlagsEXT =
    ShaderCreateFlagsEXT::from_raw(1 << 15);

/// `VkDeviceFaultFlagBitsKHR`.
pub const DEVICE_FAULT_FLAG_DEVICE_LOST_KHR: Flags = 1 << 0;
pub const DEVICE_FAULT_FLAG_MEMORY_ADDRESS_KHR: Flags = 1 << 1;
pub const DEVICE_FAULT_FLAG_VENDOR_KHR: Flags = 1 << 3;
pub const DEVICE_FAULT_FLAG_WATCHDOG_TIMEOUT_KHR: Flags = 1 << 4;
pub const DEVICE_FAULT_FLAG_OVERFLOW_KHR: Flags = 1 << 5;

/// `VK_ATTACHMENT_DESCRIPTION_RESOLVE_SKIP_TRANSFER_FUNCTION_BIT_KHR`.
pub const ATTACHMENT_DESCRIPTION_RESOLVE_SKIP_TRANSFER_FUNCTION_KHR: AttachmentDescriptionFlags =
    AttachmentDescriptionFlags::from_raw(1 << 1);
/// `VK_RENDERING_ATTACHMENT_RESOLVE_SKIP_TRANSFER_FUNCTION_BIT_KHR`.
pub const RENDERING_ATTACHMENT_RESOLVE_SKIP_TRANSFER_FUNCTION_KHR: Flags = 1 << 1;
/// `VK_RESOLVE_IMAGE_SKIP_TRANSFER_FUNCTION_BIT_KHR`.
pub const RESOLVE_IMAGE_SKIP_TRANSFER_FUNCTION_KHR: Flags = 1;

/// `VkPipelineBinaryKHR`.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PipelineBinaryKHR(u64);

impl Handle for PipelineBinaryKHR {
    const TYPE: ObjectType = ObjectType::from_raw(1_000_483_000);

    fn as_raw(self) -> u64 {
        self.0
    }

    fn from_raw(raw: u64) -> Self {
        Self(raw)
    }
}

/// `VkPipelineBinaryKeysAndDataKHR`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PipelineBinaryKeysAndDataKHR<'a> {
    pub binary_count: u32,
    pub p_pipeline_binary_keys: *const PipelineBinaryKeyKHR<'a>,
    pub p_pipeline_binary_data: *const PipelineBinaryDataKHR,
}

/// `VkPipelineBinaryDataKHR`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PipelineBinaryDataKHR {
    pub data_size: usize,
    pub p_data: *mut c_void,
}

/// `VK_PIPELINE_BINARY_MISSING_KHR`.
pub const PIPELINE_BINARY_MISSING_KHR: Result = Result::from_raw(1_000_483_000);
/// `VK_ERROR_NOT_ENOUGH_SPACE_KHR`.
pub const ERROR_NOT_ENOUGH_SPACE_KHR: Result = Result::from_raw(-1_000_483_000);

/// `VkDefaultVertexAttributeValueKHR`.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DefaultVertexAttributeValueKHR(pub i32);

impl DefaultVertexAttributeValueKHR {
    pub const ZERO_ZERO_ZERO_ZERO: Self = Self(0);
}

/// `VkPresentStageTimeEXT`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PresentStageTimeEXT {
    pub stage: PresentStageFlagsEXT,
    pub time: u64,
}

/// `VkPresentStageFlagsEXT`.
pub type PresentStageFlagsEXT = Flags;
pub const PRESENT_STAGE_QUEUE_OPERATIONS_END_EXT: PresentStageFlagsEXT = 1;
pub const PRESENT_STAGE_REQUEST_DEQUEUED_EXT: PresentStageFlagsEXT = 2;
pub const PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_EXT: PresentStageFlagsEXT = 4;

/// `VkPresentTimingInfoFlagBitsEXT`.
pub const PRESENT_TIMING_INFO_PRESENT_AT_RELATIVE_TIME_EXT: Flags = 1;
pub const PRESENT_TIMING_INFO_PRESENT_AT_NEAREST_REFRESH_CYCLE_EXT: Flags = 2;

/// `VkPastPresentationTimingFlagBitsEXT`.
pub const PAST_PRESENTATION_TIMING_ALLOW_OUT_OF_ORDER_RESULTS_EXT: Flags = 2;

/// `VK_SWAPCHAIN_CREATE_PRESENT_TIMING_BIT_EXT`.
pub const SWAPCHAIN_CREATE_PRESENT_TIMING_EXT: SwapchainCreateFlagsKHR =
    SwapchainCreateFlagsKHR::from_raw(1 << 9);
/// `VK_ERROR_PRESENT_TIMING_QUEUE_FULL_EXT`.
pub const ERROR_PRESENT_TIMING_QUEUE_FULL_EXT: Result = Result::from_raw(-1_000_208_000);
/// `VK_TIME_DOMAIN_PRESENT_STAGE_LOCAL_EXT`.
pub const TIME_DOMAIN_PRESENT_STAGE_LOCAL_EXT: TimeDomainKHR =
    TimeDomainKHR::from_raw(1_000_208_000);
/// `VK_TIME_DOMAIN_SWAPCHAIN_LOCAL_EXT`.
pub const TIME_DOMAIN_SWAPCHAIN_LOCAL_EXT: TimeDomainKHR = TimeDomainKHR::from_raw(1_000_208_001);

/// `VK_PRESENT_MODE_FIFO_LATEST_READY_KHR`.
pub const PRESENT_MODE_FIFO_LATEST_READY_KHR: PresentModeKHR =
    PresentModeKHR::from_raw(1_000_361_000);

/// `VkDeviceAddressRangeKHR`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct DeviceAddressRangeKHR {
    pub address: DeviceAddress,
    pub size: DeviceSize,
}

/// `VkHostAddressRangeEXT` and `VkHostAddressRangeConstEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct HostAddressRangeEXT {
    pub address: *mut c_void,
    pub size: usize,
}

/// `VkResourceDescriptorDataEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub union ResourceDescriptorDataEXT<'a> {
    pub p_image: *const ImageDescriptorInfoEXT<'a>,
    pub p_texel_buffer: *const TexelBufferDescriptorInfoEXT<'a>,
    pub p_address_range: *const DeviceAddressRangeKHR,
}

/// `VkDescriptorMappingSourceConstantOffsetEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DescriptorMappingSourceConstantOffsetEXT<'a> {
    pub heap_offset: u32,
    pub heap_array_stride: u32,
    pub p_embedded_sampler: *const SamplerCreateInfo<'a>,
    pub sampler_heap_offset: u32,
    pub sampler_heap_array_stride: u32,
}

/// `VkDescriptorMappingSourcePushIndexEXT`, and `VkDescriptorMappingSourceShaderRecordIndexEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DescriptorMappingSourceIndexEXT<'a> {
    pub heap_offset: u32,
    /// In push data, or in the shader record.
    pub index_offset: u32,
    pub heap_index_stride: u32,
    pub heap_array_stride: u32,
    pub p_embedded_sampler: *const SamplerCreateInfo<'a>,
    pub use_combined_image_sampler_index: Bool32,
    pub sampler_heap_offset: u32,
    pub sampler_index_offset: u32,
    pub sampler_heap_index_stride: u32,
    pub sampler_heap_array_stride: u32,
}

/// `VkDescriptorMappingSourceIndirectIndexEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DescriptorMappingSourceIndirectIndexEXT<'a> {
    pub heap_offset: u32,
    pub push_offset: u32,
    pub address_offset: u32,
    pub heap_index_stride: u32,
    pub heap_array_stride: u32,
    pub p_embedded_sampler: *const SamplerCreateInfo<'a>,
    pub use_combined_image_sampler_index: Bool32,
    pub sampler_heap_offset: u32,
    pub sampler_push_offset: u32,
    pub sampler_address_offset: u32,
    pub sampler_heap_index_stride: u32,
    pub sampler_heap_array_stride: u32,
}

/// `VkDescriptorMappingSourceIndirectIndexArrayEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct DescriptorMappingSourceIndirectIndexArrayEXT<'a> {
    pub heap_offset: u32,
    pub push_offset: u32,
    pub address_offset: u32,
    pub heap_index_stride: u32,
    pub p_embedded_sampler: *const SamplerCreateInfo<'a>,
    pub use_combined_image_sampler_index: Bool32,
    pub sampler_heap_offset: u32,
    pub sampler_push_offset: u32,
    pub sampler_address_offset: u32,
    pub sampler_heap_index_stride: u32,
}

/// `VkDescriptorMappingSourceDataEXT`; the structures of two words and the single words are
/// `words`.
#[repr(C)]
#[derive(Clone, Copy)]
pub union DescriptorMappingSourceDataEXT<'a> {
    pub constant_offset: DescriptorMappingSourceConstantOffsetEXT<'a>,
    pub index: DescriptorMappingSourceIndexEXT<'a>,
    pub indirect_index: DescriptorMappingSourceIndirectIndexEXT<'a>,
    pub indirect_index_array: DescriptorMappingSourceIndirectIndexArrayEXT<'a>,
    pub words: [u32; 2],
}

/// `VkStridedDeviceAddressRangeKHR`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct StridedDeviceAddressRangeKHR {
    pub address: DeviceAddress,
    pub size: DeviceSize,
    pub stride: DeviceSize,
}

/// `VkAddressCommandFlagsKHR`: the range's memory type; there is only one.
pub type AddressCommandFlagsKHR = u32;

macro_rules! functions {
    ($($name:ident($($ty:ty),*) $(-> $result:ty)?;)*) => {
        $(#[allow(non_camel_case_types, reason = "Vulkan's names")]
        pub type $name = unsafe extern "system" fn($($ty),*) $(-> $result)?;)*
    };
}

functions! {
    PFN_vkCmdBeginConditionalRendering2EXT(CommandBuffer, *const c_void);
    PFN_vkCmdBindTransformFeedbackBuffers2EXT(CommandBuffer, u32, u32, *const c_void);
    PFN_vkCmdBeginTransformFeedback2EXT(CommandBuffer, u32, u32, *const c_void);
    PFN_vkCmdEndTransformFeedback2EXT(CommandBuffer, u32, u32, *const c_void);
    PFN_vkCmdDrawIndirectByteCount2EXT(CommandBuffer, u32, u32, *const c_void, u32, u32);
    PFN_vkCmdBindIndexBuffer3KHR(CommandBuffer, *const c_void);
    PFN_vkCmdBindVertexBuffers3KHR(CommandBuffer, u32, u32, *const c_void);
    PFN_vkCmdSetPrimitiveRestartIndexEXT(CommandBuffer, u32);
    PFN_vkCmdSetDepthClampRangeEXT(CommandBuffer, i32, *const DepthClampRangeEXT);
    PFN_vkCmdCopyImageToMemoryKHR(CommandBuffer, *const CopyDeviceMemoryImageInfoKHR<'_>);
    PFN_vkCmdConvertCooperativeVectorMatrixNV(
        CommandBuffer, u32, *const ConvertCooperativeVectorMatrixInfoNV<'_>
    );
    PFN_vkConvertCooperativeVectorMatrixNV(
        Device, *const ConvertCooperativeVectorMatrixInfoNV<'_>
    ) -> Result;
    PFN_vkGetPhysicalDeviceCooperativeVectorPropertiesNV(
        PhysicalDevice, *mut u32, *mut CooperativeVectorPropertiesNV<'_>
    ) -> Result;
    PFN_vkCmdCopyMemoryIndirectKHR(CommandBuffer, *const CopyMemoryIndirectInfoKHR<'_>);
    PFN_vkCmdCopyMemoryToImageIndirectKHR(CommandBuffer, *const CopyMemoryToImageIndirectInfoKHR<'_>);
    PFN_vkCmdCopyMemoryKHR(CommandBuffer, *const CopyDeviceMemoryInfoKHR<'_>);
    PFN_vkCmdCopyMemoryToImageKHR(CommandBuffer, *const CopyDeviceMemoryImageInfoKHR<'_>);
    PFN_vkCmdCopyQueryPoolResultsToMemoryKHR(
        CommandBuffer, QueryPool, u32, u32, *const StridedDeviceAddressRangeKHR, AddressCommandFlagsKHR, QueryResultFlags
    );
    PFN_vkCmdDispatchIndirect2KHR(CommandBuffer, *const DispatchIndirect2InfoKHR<'_>);
    PFN_vkCmdDrawIndexedIndirect2KHR(CommandBuffer, *const c_void);
    PFN_vkCmdDrawIndexedIndirectCount2KHR(CommandBuffer, *const c_void);
    PFN_vkCmdDrawIndirect2KHR(CommandBuffer, *const c_void);
    PFN_vkCmdDrawIndirectCount2KHR(CommandBuffer, *const c_void);
    PFN_vkCmdDrawMeshTasksIndirect2EXT(CommandBuffer, *const c_void);
    PFN_vkCmdDrawMeshTasksIndirectCount2EXT(CommandBuffer, *const c_void);
    PFN_vkCmdFillMemoryKHR(CommandBuffer, *const DeviceAddressRangeKHR, AddressCommandFlagsKHR, u32);
    PFN_vkCmdUpdateMemoryKHR(
        CommandBuffer, *const DeviceAddressRangeKHR, AddressCommandFlagsKHR, DeviceSize, *const c_void
    );
    PFN_vkGetPastPresentationTimingEXT(
        Device, *const PastPresentationTimingInfoEXT<'_>, *mut PastPresentationTimingPropertiesEXT<'_>
    ) -> Result;
    PFN_vkGetSwapchainTimeDomainPropertiesEXT(
        Device, SwapchainKHR, *mut SwapchainTimeDomainPropertiesEXT<'_>, *mut u64
    ) -> Result;
    PFN_vkGetSwapchainTimingPropertiesEXT(
        Device, SwapchainKHR, *mut SwapchainTimingPropertiesEXT<'_>, *mut u64
    ) -> Result;
    PFN_vkSetSwapchainPresentTimingQueueSizeEXT(Device, SwapchainKHR, u32) -> Result;
    PFN_vkWaitForPresent2KHR(Device, SwapchainKHR, *const PresentWait2InfoKHR<'_>) -> Result;
    PFN_vkGetDeviceFaultReportsKHR(Device, u64, *mut u32, *mut DeviceFaultInfoKHR<'_>) -> Result;
    PFN_vkGetDeviceFaultDebugInfoKHR(Device, *mut DeviceFaultDebugInfoKHR<'_>) -> Result;
    PFN_vkCmdEndRendering2KHR(CommandBuffer, *const c_void);
    PFN_vkCreatePipelineBinariesKHR(
        Device, *const PipelineBinaryCreateInfoKHR<'_>, *const AllocationCallbacks<'_>, *mut PipelineBinaryHandlesInfoKHR<'_>
    ) -> Result;
    PFN_vkDestroyPipelineBinaryKHR(Device, PipelineBinaryKHR, *const AllocationCallbacks<'_>);
    PFN_vkGetPipelineBinaryDataKHR(
        Device, *const PipelineBinaryDataInfoKHR<'_>, *mut PipelineBinaryKeyKHR<'_>, *mut usize, *mut c_void
    ) -> Result;
    PFN_vkGetPipelineKeyKHR(
        Device, *const PipelineCreateInfoKHR<'_>, *mut PipelineBinaryKeyKHR<'_>
    ) -> Result;
    PFN_vkReleaseCapturedPipelineDataKHR(
        Device, *const ReleaseCapturedPipelineDataInfoKHR<'_>, *const AllocationCallbacks<'_>
    ) -> Result;
    PFN_vkCmdBindResourceHeapEXT(CommandBuffer, *const BindHeapInfoEXT<'_>);
    PFN_vkCmdBindSamplerHeapEXT(CommandBuffer, *const BindHeapInfoEXT<'_>);
    PFN_vkCmdPushDataEXT(CommandBuffer, *const PushDataInfoEXT<'_>);
    PFN_vkGetImageOpaqueCaptureDataEXT(Device, u32, *const Image, *mut HostAddressRangeEXT) -> Result;
    PFN_vkGetPhysicalDeviceDescriptorSizeEXT(PhysicalDevice, DescriptorType) -> DeviceSize;
    PFN_vkRegisterCustomBorderColorEXT(
        Device, *const SamplerCustomBorderColorCreateInfoEXT<'_>, Bool32, *mut u32
    ) -> Result;
    PFN_vkUnregisterCustomBorderColorEXT(Device, u32);
    PFN_vkWriteResourceDescriptorsEXT(
        Device, u32, *const ResourceDescriptorInfoEXT<'_>, *const HostAddressRangeEXT
    ) -> Result;
    PFN_vkWriteSamplerDescriptorsEXT(
        Device, u32, *const SamplerCreateInfo<'_>, *const HostAddressRangeEXT
    ) -> Result;
    PFN_vkCreateAccelerationStructure2KHR(
        Device, *const AccelerationStructureCreateInfo2KHR<'_>, *const AllocationCallbacks<'_>, *mut AccelerationStructureKHR
    ) -> Result;
}

/// `VkRayTracingLssIndexingModeNV`.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RayTracingLssIndexingModeNV(pub i32);

impl RayTracingLssIndexingModeNV {
    pub const SUCCESSIVE: Self = Self(1);
}

/// `VkRayTracingLssPrimitiveEndCapsModeNV`.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RayTracingLssPrimitiveEndCapsModeNV(pub i32);

impl RayTracingLssPrimitiveEndCapsModeNV {
    pub const CHAINED: Self = Self(1);
}

/// `VK_GEOMETRY_TYPE_SPHERES_NV`.
pub const GEOMETRY_TYPE_SPHERES_NV: GeometryTypeKHR = GeometryTypeKHR::from_raw(1_000_429_004);
/// `VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV`.
pub const GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV: GeometryTypeKHR =
    GeometryTypeKHR::from_raw(1_000_429_005);
/// `VK_FORMAT_FEATURE_2_ACCELERATION_STRUCTURE_RADIUS_BUFFER_BIT_NV`.
pub const FORMAT_FEATURE_2_ACCELERATION_STRUCTURE_RADIUS_BUFFER_NV: FormatFeatureFlags2 =
    FormatFeatureFlags2::from_raw(1 << 51);
/// `VK_FORMAT_FEATURE_2_COPY_IMAGE_INDIRECT_DST_BIT_KHR`.
pub const FORMAT_FEATURE_2_COPY_IMAGE_INDIRECT_DST_KHR: FormatFeatureFlags2 =
    FormatFeatureFlags2::from_raw(1 << 59);
