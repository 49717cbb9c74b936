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
}
