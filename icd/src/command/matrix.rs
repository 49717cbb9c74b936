//! Conversions of matrices in memory (`VkConvertCooperativeVectorMatrixInfoNV`).

#![forbid(unsafe_code)]

use spirv_jit::ir::op::Component;

/// The alignment of matrices in bytes (`vkCmdConvertCooperativeVectorMatrixNV`).
const ALIGNMENT: u64 = 64;

/// A matrix in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matrix {
    pub address: u64,
    pub component: Component,
    /// Lines are columns.
    pub by_columns: bool,
    /// The number of lines, the elements of each, and the stride between lines.
    pub lines: u64,
    pub elements: u64,
    pub stride_bytes: u64,
    /// The bytes after the elements of a line, and after the last line, belong to the matrix.
    pub is_padded: bool,
}

impl Matrix {
    pub fn element_bytes(&self) -> u64 {
        self.component.ty().size_bytes().into()
    }

    /// The matrix's size. A padded matrix takes whole cache lines, so that an aligned matrix may
    /// follow.
    pub fn size_bytes(&self) -> u64 {
        let Some(before) = self.lines.checked_sub(1) else {
            return 0;
        };
        let last = self.elements.saturating_mul(self.element_bytes());
        match self.is_padded {
            true => {
                let lines = self.lines.saturating_mul(self.stride_bytes);
                lines.checked_next_multiple_of(ALIGNMENT).unwrap_or(lines)
            }
            false => before
                .saturating_mul(self.stride_bytes)
                .saturating_add(last),
        }
    }
}

/// A source and a destination of the same shape. Their components have one type, or are floats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatrixConversion {
    pub source: Matrix,
    pub destination: Matrix,
}
