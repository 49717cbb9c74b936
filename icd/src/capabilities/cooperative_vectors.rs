//! The supported products of matrices and cooperative vectors.

#![forbid(unsafe_code)]

use spirv_jit::ir::op::Component;

use crate::ffi::vk;
use crate::ffi::vk::ComponentTypeKHR as Type;

/// Types of a product, in the order of `VkCooperativeVectorPropertiesNV`: input, input
/// interpretation, matrix, bias and result.
type Product = [Type; 5];

/// All products, beginning with those that the extension requires
/// (`VkCooperativeVectorPropertiesNV`).
pub fn products() -> impl ExactSizeIterator<Item = Product> {
    const F16: Type = Type::FLOAT16;
    const F32: Type = Type::FLOAT32;
    const S8: Type = Type::SINT8;
    const U8: Type = Type::UINT8;
    const S32: Type = Type::SINT32;
    const U32: Type = Type::UINT32;
    const PACKED_S8: Type = vk::COMPONENT_TYPE_SINT8_PACKED_NV;
    const PACKED_U8: Type = vk::COMPONENT_TYPE_UINT8_PACKED_NV;
    const E4M3: Type = vk::COMPONENT_TYPE_FLOAT_E4M3_NV;
    const E5M2: Type = vk::COMPONENT_TYPE_FLOAT_E5M2_NV;
    [
        [F16, F16, F16, F16, F16],
        [U32, PACKED_S8, S8, S32, S32],
        [S8, S8, S8, S32, S32],
        [F32, S8, S8, S32, S32],
        [F16, E4M3, E4M3, F16, F16],
        [F16, E5M2, E5M2, F16, F16],
        [F16, F16, F16, F32, F32],
        [F16, E4M3, E4M3, F32, F32],
        [F16, E5M2, E5M2, F32, F32],
        [F32, F32, F32, F32, F32],
        [F32, F16, F16, F32, F32],
        [F16, S8, S8, S32, S32],
        [S32, S8, S8, S32, S32],
        [U8, U8, U8, U32, U32],
        [U8, U8, U8, S32, S32],
        [U8, U8, S8, S32, S32],
        [S8, S8, U8, S32, S32],
        [U32, PACKED_U8, U8, U32, U32],
        [U32, PACKED_U8, U8, S32, S32],
        [U32, PACKED_U8, S8, S32, S32],
        [U32, PACKED_S8, U8, S32, S32],
    ]
    .into_iter()
}

/// Writes the properties of a product.
pub fn describe(product: Product, out: &mut vk::CooperativeVectorPropertiesNV<'_>) {
    let [input, input_interpretation, matrix, bias, result] = product;
    out.input_type = input;
    out.input_interpretation = input_interpretation;
    out.matrix_interpretation = matrix;
    out.bias_interpretation = bias;
    out.result_type = result;
    out.transpose = vk::TRUE;
}

/// The component type of a matrix in memory; `None` for unsupported types.
pub fn component(ty: Type) -> Option<Component> {
    Some(match ty {
        Type::FLOAT16 => Component::F16,
        Type::FLOAT32 => Component::F32,
        Type::SINT8 => Component::S8,
        Type::UINT8 => Component::U8,
        vk::COMPONENT_TYPE_FLOAT_E4M3_NV => Component::E4M3,
        vk::COMPONENT_TYPE_FLOAT_E5M2_NV => Component::E5M2,
        _ => return None,
    })
}
