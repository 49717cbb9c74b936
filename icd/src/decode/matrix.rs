//! Matrices of `VK_NV_cooperative_vector`.

#![forbid(unsafe_code)]

use spirv_jit::ir::op::optimal_stride_bytes;

use crate::capabilities::cooperative_vectors::component;
use crate::command::matrix::{Matrix, MatrixConversion};
use crate::ffi::vk;
use crate::ffi::vk::{ComponentTypeKHR, ConvertCooperativeVectorMatrixInfoNV as Info};

/// A matrix of a conversion; `None` for an unsupported component type or layout, and for
/// overlapping lines.
fn decode(
    info: &Info<'_>,
    address: u64,
    component_type: ComponentTypeKHR,
    layout: vk::CooperativeVectorMatrixLayoutNV,
    stride_bytes: usize,
) -> Option<Matrix> {
    let component = component(component_type)?;
    let element_bytes = component.ty().size_bytes().into();
    let (rows, columns) = (info.num_rows.into(), info.num_columns.into());
    let by_columns = layout == vk::CooperativeVectorMatrixLayoutNV::COLUMN_MAJOR;
    let (lines, elements) = match by_columns {
        true => (columns, rows),
        false => (rows, columns),
    };
    let is_padded = match layout.0 {
        0 | 1 => false,
        2 | 3 => true,
        _ => return None,
    };
    let stride_bytes = match is_padded {
        true => optimal_stride_bytes(columns, element_bytes),
        false => stride_bytes as u64,
    };
    (stride_bytes >= elements * element_bytes).then_some(Matrix {
        address,
        component,
        by_columns,
        lines,
        elements,
        stride_bytes,
        is_padded,
    })
}

/// The destination of a conversion.
pub fn destination(info: &Info<'_>, address: u64) -> Option<Matrix> {
    decode(
        info,
        address,
        info.dst_component_type,
        info.dst_layout,
        info.dst_stride,
    )
}

/// A conversion from a source of `info.src_size` bytes; `None` if the source is null or longer, or
/// the component types are not convertible.
pub fn conversion(info: &Info<'_>, source: u64, destination: Matrix) -> Option<MatrixConversion> {
    let source = decode(
        info,
        source,
        info.src_component_type,
        info.src_layout,
        info.src_stride,
    )?;
    let (from, to) = (source.component, destination.component);
    let is_there = source.address != 0 && source.size_bytes() <= info.src_size as u64;
    let is_known = from == to || from.is_float() && to.is_float();
    (is_there && is_known).then_some(MatrixConversion {
        source,
        destination,
    })
}
