//! Vulkan's types: those of `ash`, and the structures that are newer than it.
//!
//! The driver has its own declarations. These are written from the registry a second time, so that
//! a wrong member in one of the two fails a test.

use std::ffi::{CStr, c_char, c_void};
use std::marker::PhantomData;

pub use ash::vk::*;

/// `VK_NV_ray_tracing_linear_swept_spheres`.
pub const LINEAR_SWEPT_SPHERES: &CStr = c"VK_NV_ray_tracing_linear_swept_spheres";

/// `VK_KHR_device_address_commands`.
pub const DEVICE_ADDRESS_COMMANDS: &CStr = c"VK_KHR_device_address_commands";

/// `VK_KHR_opacity_micromap`.
pub const OPACITY_MICROMAP: &CStr = c"VK_KHR_opacity_micromap";

/// `VK_EXT_descriptor_heap`.
pub const DESCRIPTOR_HEAP: &CStr = c"VK_EXT_descriptor_heap";

/// `VK_KHR_copy_memory_indirect`.
pub const COPY_MEMORY_INDIRECT: &CStr = c"VK_KHR_copy_memory_indirect";

/// `VK_KHR_maintenance8`.
pub const MAINTENANCE_8: &CStr = c"VK_KHR_maintenance8";

/// `VK_KHR_maintenance9`.
pub const MAINTENANCE_9: &CStr = c"VK_KHR_maintenance9";

/// `VK_EXT_shader_64bit_indexing`.
pub const SHADER_64BIT_INDEXING: &CStr = c"VK_EXT_shader_64bit_indexing";

/// `VK_PIPELINE_CREATE_2_64_BIT_INDEXING_BIT_EXT`.
pub const PIPELINE_CREATE_2_64_BIT_INDEXING_EXT: PipelineCreateFlags2KHR =
    PipelineCreateFlags2KHR::from_raw(1 << 43);

/// `VK_EXT_shader_split_barrier`.
pub const SHADER_SPLIT_BARRIER: &CStr = c"VK_EXT_shader_split_barrier";

/// `VK_EXT_shader_long_vector`.
pub const SHADER_LONG_VECTOR: &CStr = c"VK_EXT_shader_long_vector";

/// `VK_KHR_maintenance11`.
pub const MAINTENANCE_11: &CStr = c"VK_KHR_maintenance11";

/// `VK_KHR_extended_flags`.
pub const EXTENDED_FLAGS: &CStr = c"VK_KHR_extended_flags";

/// `VK_KHR_shader_fma`.
pub const SHADER_FMA: &CStr = c"VK_KHR_shader_fma";

/// `VK_KHR_device_fault`.
pub const DEVICE_FAULT: &CStr = c"VK_KHR_device_fault";

/// `VK_KHR_shader_abort`.
pub const SHADER_ABORT: &CStr = c"VK_KHR_shader_abort";

/// `VK_KHR_shader_constant_data`.
pub const SHADER_CONSTANT_DATA: &CStr = c"VK_KHR_shader_constant_data";

/// `VK_KHR_pipeline_binary`.
pub const PIPELINE_BINARY: &CStr = c"VK_KHR_pipeline_binary";

/// `VK_NV_cooperative_vector`.
pub const COOPERATIVE_VECTOR: &CStr = c"VK_NV_cooperative_vector";

/// `VK_EXT_shader_replicated_composites`.
pub const REPLICATED_COMPOSITES: &CStr = c"VK_EXT_shader_replicated_composites";

/// Extensions that a validation layer may be too old for, and the version that knows them: enabled
/// only without an older layer.
pub const NEWER: &[(&CStr, u32)] = &[
    (LINEAR_SWEPT_SPHERES, make_api_version(0, 1, 4, 308)),
    (
        ash::khr::shader_maximal_reconvergence::NAME,
        make_api_version(0, 1, 3, 276),
    ),
    (
        ash::khr::shader_quad_control::NAME,
        make_api_version(0, 1, 3, 276),
    ),
    (
        ash::nv::ray_tracing_validation::NAME,
        make_api_version(0, 1, 3, 279),
    ),
    (
        ash::ext::shader_object::NAME,
        make_api_version(0, 1, 3, 246),
    ),
    (
        ash::khr::dynamic_rendering_local_read::NAME,
        make_api_version(0, 1, 3, 277),
    ),
    (
        ash::ext::dynamic_rendering_unused_attachments::NAME,
        make_api_version(0, 1, 3, 252),
    ),
    (
        ash::ext::image_sliced_view_of_3d::NAME,
        make_api_version(0, 1, 3, 243),
    ),
    (
        ash::ext::host_image_copy::NAME,
        make_api_version(0, 1, 3, 258),
    ),
    (ash::khr::maintenance5::NAME, make_api_version(0, 1, 3, 260)),
    (DEVICE_ADDRESS_COMMANDS, make_api_version(0, 1, 4, 340)),
    (OPACITY_MICROMAP, make_api_version(0, 1, 4, 359)),
    (DESCRIPTOR_HEAP, make_api_version(0, 1, 4, 340)),
    (COPY_MEMORY_INDIRECT, make_api_version(0, 1, 4, 330)),
    (PIPELINE_BINARY, make_api_version(0, 1, 3, 294)),
    (DEVICE_FAULT, make_api_version(0, 1, 4, 347)),
    (SHADER_ABORT, make_api_version(0, 1, 4, 347)),
    (SHADER_CONSTANT_DATA, make_api_version(0, 1, 4, 347)),
    (REPLICATED_COMPOSITES, make_api_version(0, 1, 3, 294)),
    (COOPERATIVE_VECTOR, make_api_version(0, 1, 4, 309)),
    (SHADER_FMA, make_api_version(0, 1, 4, 340)),
    (SHADER_SPLIT_BARRIER, make_api_version(0, 1, 4, 359)),
    (SHADER_LONG_VECTOR, make_api_version(0, 1, 4, 340)),
    (SHADER_64BIT_INDEXING, make_api_version(0, 1, 4, 340)),
    (MAINTENANCE_8, make_api_version(0, 1, 4, 330)),
    (MAINTENANCE_9, make_api_version(0, 1, 4, 330)),
    (MAINTENANCE_11, make_api_version(0, 1, 4, 356)),
    (EXTENDED_FLAGS, make_api_version(0, 1, 4, 356)),
    (
        ash::khr::ray_tracing_position_fetch::NAME,
        make_api_version(0, 1, 3, 249),
    ),
];

pub const GEOMETRY_TYPE_MICROMAP_KHR: GeometryTypeKHR = GeometryTypeKHR::from_raw(1_000_623_000);
pub const ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR: AccelerationStructureTypeKHR =
    AccelerationStructureTypeKHR::from_raw(1_000_623_000);
pub const BUILD_ACCELERATION_STRUCTURE_MICROMAP_LOSSY_BIT_KHR: BuildAccelerationStructureFlagsKHR =
    BuildAccelerationStructureFlagsKHR::from_raw(1 << 10);
pub const GEOMETRY_TYPE_SPHERES_NV: GeometryTypeKHR = GeometryTypeKHR::from_raw(1_000_429_004);
pub const GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV: GeometryTypeKHR =
    GeometryTypeKHR::from_raw(1_000_429_005);

/// Structures of features alone.
macro_rules! features {
    ($($name:ident $ty:literal { $($field:ident)* })*) => {$(
        #[repr(C)]
        #[derive(Clone, Copy)]
        pub struct $name<'a> {
            pub s_type: StructureType,
            pub p_next: *mut c_void,
            $(pub $field: Bool32,)*
            pub _marker: PhantomData<&'a ()>,
        }

        impl Default for $name<'_> {
            fn default() -> Self {
                Self {
                    s_type: StructureType::from_raw($ty),
                    p_next: std::ptr::null_mut(),
                    $($field: FALSE,)*
                    _marker: PhantomData,
                }
            }
        }

        // SAFETY: the registry says so.
        unsafe impl ExtendsPhysicalDeviceFeatures2 for $name<'_> {}
    )*};
}

features! {
    PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV 1_000_429_008 {
        spheres linear_swept_spheres
    }
    PhysicalDeviceDeviceAddressCommandsFeaturesKHR 1_000_318_006 { device_address_commands }
    PhysicalDeviceOpacityMicromapFeaturesKHR 1_000_623_000 { micromap }
    PhysicalDeviceMaintenance8FeaturesKHR 1_000_574_000 { maintenance8 }
    PhysicalDeviceMaintenance9FeaturesKHR 1_000_584_000 { maintenance9 }
    PhysicalDeviceCopyMemoryIndirectFeaturesKHR 1_000_549_000 {
        indirect_memory_copy indirect_memory_to_image_copy
    }
    PhysicalDeviceDescriptorHeapFeaturesEXT 1_000_135_009 {
        descriptor_heap descriptor_heap_capture_replay
    }
    PhysicalDeviceCooperativeVectorFeaturesNV 1_000_491_000 {
        cooperative_vector cooperative_vector_training
    }
    PhysicalDevicePipelineBinaryFeaturesKHR 1_000_483_000 { pipeline_binaries }
    PhysicalDeviceShaderSplitBarrierFeaturesEXT 1_000_305_000 { shader_split_barrier }
    PhysicalDeviceShaderLongVectorFeaturesEXT 1_000_635_000 { long_vector }
    PhysicalDeviceShader64BitIndexingFeaturesEXT 1_000_627_000 { shader64_bit_indexing }
    PhysicalDeviceFaultFeaturesKHR 1_000_573_000 {
        device_fault device_fault_vendor_binary device_fault_report_masked
        device_fault_device_lost_on_masked
    }
    PhysicalDeviceShaderAbortFeaturesKHR 1_000_233_000 { shader_abort }
    PhysicalDeviceShaderConstantDataFeaturesKHR 1_000_231_000 { shader_constant_data }
    PhysicalDeviceShaderReplicatedCompositesFeaturesEXT 1_000_564_000 { shader_replicated_composites }
    PhysicalDeviceShaderFmaFeaturesKHR 1_000_579_000 {
        shader_fma_float16 shader_fma_float32 shader_fma_float64
    }
    PhysicalDeviceMaintenance11FeaturesKHR 1_000_657_000 { maintenance11 }
    PhysicalDeviceExtendedFlagsFeaturesKHR 1_000_668_004 { extended_flags }
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct PhysicalDeviceShaderLongVectorPropertiesEXT<'a> {
    pub s_type: StructureType,
    pub p_next: *mut c_void,
    pub max_vector_components: u32,
    pub _marker: PhantomData<&'a ()>,
}

impl Default for PhysicalDeviceShaderLongVectorPropertiesEXT<'_> {
    fn default() -> Self {
        Self {
            s_type: StructureType::from_raw(1_000_635_001),
            p_next: std::ptr::null_mut(),
            max_vector_components: 0,
            _marker: PhantomData,
        }
    }
}

// SAFETY: the registry says so.
unsafe impl ExtendsPhysicalDeviceProperties2 for PhysicalDeviceShaderLongVectorPropertiesEXT<'_> {}

/// `VkHostAddressRangeEXT` and `VkHostAddressRangeConstEXT`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct HostAddressRangeEXT {
    pub address: *mut c_void,
    pub size: usize,
}

/// `VkDeviceAddressRangeKHR`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct DeviceAddressRangeKHR {
    pub address: DeviceAddress,
    pub size: DeviceSize,
}

/// `VkAccelerationStructureGeometryLinearSweptSpheresDataNV`; that of spheres is the same up to
/// `index_stride`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct SweptData {
    pub s_type: StructureType,
    pub p_next: *const c_void,
    pub vertex_format: Format,
    pub vertex_data: DeviceOrHostAddressConstKHR,
    pub vertex_stride: DeviceSize,
    pub radius_format: Format,
    pub radius_data: DeviceOrHostAddressConstKHR,
    pub radius_stride: DeviceSize,
    pub index_type: IndexType,
    pub index_data: DeviceOrHostAddressConstKHR,
    pub index_stride: DeviceSize,
    /// 0: list, 1: successive.
    pub indexing_mode: i32,
    /// 0: none, 1: chained.
    pub end_caps_mode: i32,
}

impl SweptData {
    pub const SPHERES: StructureType = StructureType::from_raw(1_000_429_010);
    pub const LINEAR_SWEPT_SPHERES: StructureType = StructureType::from_raw(1_000_429_009);
}

/// `VK_EXT_present_timing`, and `VK_KHR_present_id2`, which it needs.
pub const PRESENT_TIMING: &CStr = c"VK_EXT_present_timing";
pub const PRESENT_ID_2: &CStr = c"VK_KHR_present_id2";

macro_rules! structures {
    ($($name:ident $ty:literal $next:ty { $($field:ident: $field_ty:ty,)* })*) => {$(
        #[repr(C)]
        #[derive(Clone, Copy)]
        pub struct $name {
            pub s_type: StructureType,
            pub p_next: $next,
            $(pub $field: $field_ty,)*
        }

        impl Default for $name {
            fn default() -> Self {
                // SAFETY: all zero is a value of each field.
                let mut it: Self = unsafe { std::mem::zeroed() };
                it.s_type = StructureType::from_raw($ty);
                it
            }
        }
    )*};
}

structures! {
    DeviceFaultShaderAbortMessageInfoKHR 1_000_233_001 *mut c_void {
        message_data_size: u64,
        p_message_data: *mut c_void,
    }
    PhysicalDeviceShaderAbortPropertiesKHR 1_000_233_002 *mut c_void {
        max_shader_abort_message_size: u64,
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
    AccelerationStructureCreateInfo2KHR 1_000_318_015 *const c_void {
        create_flags: AccelerationStructureCreateFlagsKHR,
        address_range: DeviceAddressRangeKHR,
        address_flags: Flags,
        ty: AccelerationStructureTypeKHR,
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
    QueueFamilyOptimalImageTransferGranularityPropertiesKHR 1_000_657_001 *mut c_void {
        optimal_image_transfer_granularity: Extent3D,
    }
    FormatProperties4KHR 1_000_668_000 *mut c_void {
        linear_tiling_features: u64,
        optimal_tiling_features: u64,
        buffer_features: u64,
    }
    ImageCreateFlags2CreateInfoKHR 1_000_668_001 *const c_void {
        flags: u64,
    }
    ImageUsageFlags2CreateInfoKHR 1_000_668_002 *const c_void {
        usage: u64,
    }
    ImageViewUsage2CreateInfoKHR 1_000_668_003 *const c_void {
        usage: u64,
    }
    ImageStencilUsage2CreateInfoKHR 1_000_668_005 *const c_void {
        stencil_usage: u64,
    }
    SharedPresentSurfaceCapabilities2KHR 1_000_668_006 *mut c_void {
        shared_present_supported_usage_flags: u64,
    }
    TexelBufferDescriptorInfoEXT 1_000_135_000 *const c_void {
        format: Format,
        address_range: DeviceAddressRangeKHR,
    }
    ImageDescriptorInfoEXT 1_000_135_001 *const c_void {
        p_view: *const ImageViewCreateInfo<'static>,
        layout: ImageLayout,
    }
    ResourceDescriptorInfoEXT 1_000_135_002 *const c_void {
        ty: DescriptorType,
        data: *const c_void,
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
        source_data: DescriptorMappingSourceDataEXT,
    }
    ShaderDescriptorSetAndBindingMappingInfoEXT 1_000_135_006 *const c_void {
        mapping_count: u32,
        p_mappings: *const DescriptorSetAndBindingMappingEXT,
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
    CommandBufferInheritanceDescriptorHeapInfoEXT 1_000_135_010 *const c_void {
        p_sampler_heap_bind_info: *const BindHeapInfoEXT,
        p_resource_heap_bind_info: *const BindHeapInfoEXT,
    }
    PhysicalDeviceCooperativeVectorPropertiesNV 1_000_491_001 *mut c_void {
        cooperative_vector_supported_stages: ShaderStageFlags,
        cooperative_vector_training_float16_accumulation: Bool32,
        cooperative_vector_training_float32_accumulation: Bool32,
        max_cooperative_vector_components: u32,
    }
    CooperativeVectorPropertiesNV 1_000_491_002 *mut c_void {
        types: [ComponentTypeKHR; 5],
        transpose: Bool32,
    }
    ConvertCooperativeVectorMatrixInfoNV 1_000_491_004 *const c_void {
        src_size: usize,
        src_data: u64,
        p_dst_size: *mut usize,
        dst_data: u64,
        src_component_type: ComponentTypeKHR,
        dst_component_type: ComponentTypeKHR,
        num_rows: u32,
        num_columns: u32,
        src_layout: i32,
        src_stride: usize,
        dst_layout: i32,
        dst_stride: usize,
    }
    PhysicalDevicePresentId2FeaturesKHR 1_000_479_002 *mut c_void {
        present_id2: Bool32,
    }
    PresentId2KHR 1_000_479_001 *const c_void {
        swapchain_count: u32,
        p_present_ids: *const u64,
    }
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
        p_timing_infos: *const PresentTimingInfoEXT,
    }
    PresentTimingInfoEXT 1_000_208_004 *const c_void {
        flags: Flags,
        target_time: u64,
        time_domain_id: u64,
        present_stage_queries: Flags,
        target_time_domain_present_stage: Flags,
    }
    PastPresentationTimingInfoEXT 1_000_208_005 *const c_void {
        flags: Flags,
        swapchain: SwapchainKHR,
    }
    PastPresentationTimingPropertiesEXT 1_000_208_006 *mut c_void {
        timing_properties_counter: u64,
        time_domains_counter: u64,
        presentation_timing_count: u32,
        p_presentation_timings: *mut PastPresentationTimingEXT,
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
        present_stage_queries: Flags,
    }
    SwapchainCalibratedTimestampInfoEXT 1_000_208_009 *const c_void {
        swapchain: SwapchainKHR,
        present_stage: Flags,
        time_domain_id: u64,
    }
}

/// `VkPresentStageTimeEXT`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PresentStageTimeEXT {
    pub stage: Flags,
    pub time: u64,
}

/// `VkDescriptorMappingSourceConstantOffsetEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct ConstantOffset {
    pub heap_offset: u32,
    pub heap_array_stride: u32,
    pub p_embedded_sampler: *const SamplerCreateInfo<'static>,
    pub sampler_heap_offset: u32,
    pub sampler_heap_array_stride: u32,
}

/// `VkDescriptorMappingSourcePushIndexEXT`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PushIndex {
    pub heap_offset: u32,
    pub push_offset: u32,
    pub heap_index_stride: u32,
    pub heap_array_stride: u32,
    pub p_embedded_sampler: *const SamplerCreateInfo<'static>,
    pub use_combined_image_sampler_index: Bool32,
    pub sampler_heap_offset: u32,
    pub sampler_push_offset: u32,
    pub sampler_heap_index_stride: u32,
    pub sampler_heap_array_stride: u32,
}

/// `VkDescriptorMappingSourceDataEXT`, as large as its largest member.
#[repr(C)]
#[derive(Clone, Copy)]
pub union DescriptorMappingSourceDataEXT {
    pub constant_offset: ConstantOffset,
    pub push_index: PushIndex,
    pub words: [u32; 2],
    pub size: [u64; 7],
}
