//! Vulkan's types: those of `ash`, and the structures that are newer than it, in the same style.

use std::ffi::c_void;
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

structures! {
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
