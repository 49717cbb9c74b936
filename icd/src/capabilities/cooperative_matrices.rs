//! The supported products of cooperative matrices.

#![forbid(unsafe_code)]

use spirv_jit::ir::op::{Component, MatrixProduct};

use crate::ffi::vk;

/// All products: factors of one type, sums of the same or a wider type.
pub fn products() -> impl ExactSizeIterator<Item = MatrixProduct> {
    const fn product(factor: Component, sum: Component, saturates: bool) -> MatrixProduct {
        MatrixProduct {
            a: factor,
            b: factor,
            sum,
            saturates,
        }
    }
    use Component::{BFloat16, F16, F32, S8, S32, U8, U32};
    // Programs take the first one that fits.
    [
        product(F16, F32, false),
        product(F16, F16, false),
        product(BFloat16, F32, false),
        product(BFloat16, BFloat16, false),
        product(F32, F32, false),
        product(S8, S32, false),
        product(S8, S32, true),
        product(U8, U32, false),
        product(U8, U32, true),
    ]
    .into_iter()
}

fn component(component: Component) -> vk::ComponentTypeKHR {
    use vk::ComponentTypeKHR as Type;
    match component {
        Component::F16 => Type::FLOAT16,
        Component::BFloat16 => vk::COMPONENT_TYPE_BFLOAT16_KHR,
        Component::F32 => Type::FLOAT32,
        Component::S8 => Type::SINT8,
        Component::U8 => Type::UINT8,
        Component::S32 => Type::SINT32,
        Component::U32 => Type::UINT32,
        Component::E4M3 => vk::COMPONENT_TYPE_FLOAT_E4M3_NV,
        Component::E5M2 => vk::COMPONENT_TYPE_FLOAT_E5M2_NV,
    }
}

/// Writes the properties of a product.
pub fn describe(product: &MatrixProduct, out: &mut vk::CooperativeMatrixPropertiesKHR<'_>) {
    let size = MatrixProduct::SIZE as u32;
    (out.m_size, out.n_size, out.k_size) = (size, size, size);
    out.a_type = component(product.a);
    out.b_type = component(product.b);
    out.c_type = component(product.sum);
    out.result_type = component(product.sum);
    out.saturating_accumulation = product.saturates.into();
    out.scope = vk::ScopeKHR::SUBGROUP;
}
