//! Vulkan's types: those of `ash`, and the structures that are newer than it.

use std::ffi::{CStr, c_void};
use std::marker::PhantomData;

pub use ash::vk::*;

/// `VK_NV_ray_tracing_linear_swept_spheres`.
pub const LINEAR_SWEPT_SPHERES: &CStr = c"VK_NV_ray_tracing_linear_swept_spheres";

/// `VK_KHR_device_address_commands`.
pub const DEVICE_ADDRESS_COMMANDS: &CStr = c"VK_KHR_device_address_commands";

/// Extensions that a validation layer may be too old for, and the version that knows them: enabled only without an older layer.
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
        ash::ext::dynamic_rendering_unused_attachments::NAME,
        make_api_version(0, 1, 3, 252),
    ),
    (
        ash::ext::host_image_copy::NAME,
        make_api_version(0, 1, 3, 258),
    ),
    (ash::khr::maintenance5::NAME, make_api_version(0, 1, 3, 260)),
    (DEVICE_ADDRESS_COMMANDS, make_api_version(0, 1, 4, 340)),
    (
        ash::khr::ray_tracing_position_fetch::NAME,
        make_api_version(0, 1, 3, 249),
    ),
];

pub const GEOMETRY_TYPE_SPHERES_NV: GeometryTypeKHR = GeometryTypeKHR::from_raw(1_000_429_004);
pub const GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV: GeometryTypeKHR =
    GeometryTypeKHR::from_raw(1_000_429_005);

#[repr(C)]
#[derive(Clone, Copy)]
pub struct PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV<'a> {
    pub s_type: StructureType,
    pub p_next: *mut c_void,
    pub spheres: Bool32,
    pub linear_swept_spheres: Bool32,
    pub _marker: PhantomData<&'a ()>,
}

impl Default for PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV<'_> {
    fn default() -> Self {
        Self {
            s_type: StructureType::from_raw(1_000_429_008),
            p_next: std::ptr::null_mut(),
            spheres: FALSE,
            linear_swept_spheres: FALSE,
            _marker: PhantomData,
        }
    }
}

// SAFETY: the registry says so.
unsafe impl ExtendsPhysicalDeviceFeatures2
    for PhysicalDeviceRayTracingLinearSweptSpheresFeaturesNV<'_>
{
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct PhysicalDeviceDeviceAddressCommandsFeaturesKHR<'a> {
    pub s_type: StructureType,
    pub p_next: *mut c_void,
    pub device_address_commands: Bool32,
    pub _marker: PhantomData<&'a ()>,
}

impl Default for PhysicalDeviceDeviceAddressCommandsFeaturesKHR<'_> {
    fn default() -> Self {
        Self {
            s_type: StructureType::from_raw(1_000_318_006),
            p_next: std::ptr::null_mut(),
            device_address_commands: FALSE,
            _marker: PhantomData,
        }
    }
}

// SAFETY: the registry says so.
unsafe impl ExtendsPhysicalDeviceFeatures2 for PhysicalDeviceDeviceAddressCommandsFeaturesKHR<'_> {}

/// `VkDeviceAddressRangeKHR`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct DeviceAddressRangeKHR {
    pub address: DeviceAddress,
    pub size: DeviceSize,
}

/// `VkAccelerationStructureGeometryLinearSweptSpheresDataNV`; that of spheres is the same up to `index_stride`.
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
