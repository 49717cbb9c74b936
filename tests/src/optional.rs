//! Extensions that a device may lack: enabled, with all their features, where it has them.

use std::ffi::{CStr, c_void};

use ash::{ext, huawei, khr, nv};

use crate::newer::{
    self as vk, COOPERATIVE_VECTOR, COPY_MEMORY_INDIRECT, DESCRIPTOR_HEAP, DEVICE_ADDRESS_COMMANDS,
    DEVICE_FAULT, EXTENDED_FLAGS, LINEAR_SWEPT_SPHERES, MAINTENANCE_8, MAINTENANCE_9,
    MAINTENANCE_11, OPACITY_MICROMAP, PIPELINE_BINARY, REPLICATED_COMPOSITES,
    SHADER_64BIT_INDEXING, SHADER_ABORT, SHADER_CONSTANT_DATA, SHADER_FMA, SHADER_LONG_VECTOR,
    SHADER_SPLIT_BARRIER,
};

macro_rules! optional {
    ($($(#[$doc:meta])* $field:ident: $extension:path, $features:ident { $($off:ident)* };)*) => {
        /// The features that were enabled; all off where the extension is not there.
        #[derive(Clone, Copy, Default)]
        pub struct Optional {
            $($(#[$doc])* pub $field: vk::$features<'static>,)*
        }

        impl Optional {
            /// The device's features, except those that serve only tools.
            ///
            /// # Safety
            /// The physical device is of the instance.
            pub(crate) unsafe fn of(
                instance: &ash::Instance,
                physical: vk::PhysicalDevice,
                has: impl Fn(&CStr) -> bool,
            ) -> Optional {
                let mut it = Optional::default();
                $(if has($extension) {
                    let mut all = vk::PhysicalDeviceFeatures2::default().push_next(&mut it.$field);
                    // SAFETY: the caller guarantees that the physical device is of the instance;
                    // the chain is one structure of an extension that is there.
                    unsafe { instance.get_physical_device_features2(physical, &mut all) };
                    it.$field.p_next = std::ptr::null_mut();
                    $(it.$field.$off = vk::FALSE;)*
                })*
                it
            }

            /// The names of the extensions, of those that are there.
            pub(crate) fn names(has: impl Fn(&CStr) -> bool) -> Vec<&'static CStr> {
                let all = [$($extension),*];
                all.into_iter().filter(|name| has(name)).collect()
            }

            /// Chains the structures of the extensions that are there in front of `next`.
            pub(crate) fn chain(&mut self, has: impl Fn(&CStr) -> bool, next: *const c_void) -> *const c_void {
                let mut next = next;
                $(if has($extension) {
                    self.$field.p_next = next.cast_mut();
                    next = (&raw const self.$field).cast();
                })*
                next
            }
        }
    };
}

optional! {
    pipeline_parts: ext::graphics_pipeline_library::NAME, PhysicalDeviceGraphicsPipelineLibraryFeaturesEXT {};
    unused_attachments: ext::dynamic_rendering_unused_attachments::NAME, PhysicalDeviceDynamicRenderingUnusedAttachmentsFeaturesEXT {};
    shader_object: ext::shader_object::NAME, PhysicalDeviceShaderObjectFeaturesEXT {};
    local_read: khr::dynamic_rendering_local_read::NAME, PhysicalDeviceDynamicRenderingLocalReadFeaturesKHR {};
    advanced_blend: ext::blend_operation_advanced::NAME, PhysicalDeviceBlendOperationAdvancedFeaturesEXT {};
    sliced_views: ext::image_sliced_view_of_3d::NAME, PhysicalDeviceImageSlicedViewOf3DFeaturesEXT {};
    single_sampled: ext::multisampled_render_to_single_sampled::NAME, PhysicalDeviceMultisampledRenderToSingleSampledFeaturesEXT {};
    lines: ext::line_rasterization::NAME, PhysicalDeviceLineRasterizationFeaturesKHR {};
    host_image_copy: ext::host_image_copy::NAME, PhysicalDeviceHostImageCopyFeaturesEXT {};
    conditional_rendering: ext::conditional_rendering::NAME, PhysicalDeviceConditionalRenderingFeaturesEXT {};
    transform_feedback: ext::transform_feedback::NAME, PhysicalDeviceTransformFeedbackFeaturesEXT {};
    mesh_shader: ext::mesh_shader::NAME, PhysicalDeviceMeshShaderFeaturesEXT {};
    shading_rate: khr::fragment_shading_rate::NAME, PhysicalDeviceFragmentShadingRateFeaturesKHR {};
    primitives_generated: ext::primitives_generated_query::NAME, PhysicalDevicePrimitivesGeneratedQueryFeaturesEXT {};
    provoking_vertex: ext::provoking_vertex::NAME, PhysicalDeviceProvokingVertexFeaturesEXT {};
    float_atomics: ext::shader_atomic_float::NAME, PhysicalDeviceShaderAtomicFloatFeaturesEXT {};
    ray_query: khr::ray_query::NAME, PhysicalDeviceRayQueryFeaturesKHR {};
    /// Off where there is validation: older versions of it do not know the extension.
    position_fetch: khr::ray_tracing_position_fetch::NAME, PhysicalDeviceRayTracingPositionFetchFeaturesKHR {};
    maintenance1: khr::ray_tracing_maintenance1::NAME, PhysicalDeviceRayTracingMaintenance1FeaturesKHR {};
    address_commands: DEVICE_ADDRESS_COMMANDS, PhysicalDeviceDeviceAddressCommandsFeaturesKHR {};
    maintenance5: khr::maintenance5::NAME, PhysicalDeviceMaintenance5FeaturesKHR {};
    indirect_copies: COPY_MEMORY_INDIRECT, PhysicalDeviceCopyMemoryIndirectFeaturesKHR {};
    maintenance8: MAINTENANCE_8, PhysicalDeviceMaintenance8FeaturesKHR {};
    maintenance9: MAINTENANCE_9, PhysicalDeviceMaintenance9FeaturesKHR {};
    maintenance11: MAINTENANCE_11, PhysicalDeviceMaintenance11FeaturesKHR {};
    extended_flags: EXTENDED_FLAGS, PhysicalDeviceExtendedFlagsFeaturesKHR {};
    depth_clip: ext::depth_clip_enable::NAME, PhysicalDeviceDepthClipEnableFeaturesEXT {};
    dynamic_state3: ext::extended_dynamic_state3::NAME, PhysicalDeviceExtendedDynamicState3FeaturesEXT {};
    micromap: ext::opacity_micromap::NAME, PhysicalDeviceOpacityMicromapFeaturesEXT { micromap_capture_replay };
    /// Off where there is validation, as above.
    micromap_khr: OPACITY_MICROMAP, PhysicalDeviceOpacityMicromapFeaturesKHR {};
    shader_64bit_indexing: SHADER_64BIT_INDEXING, PhysicalDeviceShader64BitIndexingFeaturesEXT {};
    split_barrier: SHADER_SPLIT_BARRIER, PhysicalDeviceShaderSplitBarrierFeaturesEXT {};
    long_vector: SHADER_LONG_VECTOR, PhysicalDeviceShaderLongVectorFeaturesEXT {};
    shader_abort: SHADER_ABORT, PhysicalDeviceShaderAbortFeaturesKHR {};
    constant_data: SHADER_CONSTANT_DATA, PhysicalDeviceShaderConstantDataFeaturesKHR {};
    replicated_composites: REPLICATED_COMPOSITES, PhysicalDeviceShaderReplicatedCompositesFeaturesEXT {};
    /// Off where there is validation, as above.
    cooperative_vector: COOPERATIVE_VECTOR, PhysicalDeviceCooperativeVectorFeaturesNV { cooperative_vector_training };
    shader_fma: SHADER_FMA, PhysicalDeviceShaderFmaFeaturesKHR {};
    pipeline_binary: PIPELINE_BINARY, PhysicalDevicePipelineBinaryFeaturesKHR {};
    executables: khr::pipeline_executable_properties::NAME, PhysicalDevicePipelineExecutablePropertiesFeaturesKHR {};
    derivatives: nv::compute_shader_derivatives::NAME, PhysicalDeviceComputeShaderDerivativesFeaturesNV {};
    /// Off where there is validation, as above.
    maximal_reconvergence: khr::shader_maximal_reconvergence::NAME, PhysicalDeviceShaderMaximalReconvergenceFeaturesKHR {};
    quad_control: khr::shader_quad_control::NAME, PhysicalDeviceShaderQuadControlFeaturesKHR {};
    /// Null descriptors alone.
    robustness2: ext::robustness2::NAME, PhysicalDeviceRobustness2FeaturesEXT { robust_buffer_access2 robust_image_access2 };
    descriptor_buffer: ext::descriptor_buffer::NAME, PhysicalDeviceDescriptorBufferFeaturesEXT {};
    /// Off where there is validation, as above.
    heaps: DESCRIPTOR_HEAP, PhysicalDeviceDescriptorHeapFeaturesEXT {};
    mutable: ext::mutable_descriptor_type::NAME, PhysicalDeviceMutableDescriptorTypeFeaturesEXT {};
    reorder: nv::ray_tracing_invocation_reorder::NAME, PhysicalDeviceRayTracingInvocationReorderFeaturesNV {};
    motion: nv::ray_tracing_motion_blur::NAME, PhysicalDeviceRayTracingMotionBlurFeaturesNV {};
    /// Off but where a test asks for it: see
    /// [`Gpu::validated_by_driver`](crate::Gpu::validated_by_driver).
    driver_validation: nv::ray_tracing_validation::NAME, PhysicalDeviceRayTracingValidationFeaturesNV {};
    invocation_mask: huawei::invocation_mask::NAME, PhysicalDeviceInvocationMaskFeaturesHUAWEI {};
    address_report: ext::device_address_binding_report::NAME, PhysicalDeviceAddressBindingReportFeaturesEXT {};
    /// Without the vendor's binary.
    fault: ext::device_fault::NAME, PhysicalDeviceFaultFeaturesEXT { device_fault_vendor_binary };
    /// Off where there is validation, as above.
    fault_khr: DEVICE_FAULT, PhysicalDeviceFaultFeaturesKHR { device_fault_vendor_binary device_fault_report_masked device_fault_device_lost_on_masked };
    list_restart: ext::primitive_topology_list_restart::NAME, PhysicalDevicePrimitiveTopologyListRestartFeaturesEXT {};
    swept_spheres: LINEAR_SWEPT_SPHERES, PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV {};
}
