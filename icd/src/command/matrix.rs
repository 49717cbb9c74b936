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
    /// Lines, elements of each, and bytes from one to the next.
    pub lines: u64,
    pub elements: u64,
    pub stride_bytes: u64,
    /// The bytes behind the elements of a line, and behind the last line, belong to the matrix.
    pub is_padded: bool,
}

impl Matrix {
    pub fn element_bytes(&self) -> u64 {
        self.component.ty().size_bytes().into()
    }

    /// Bytes from the first to the last. Those of a padded matrix are whole cache lines, so that
    /// another matrix, which is aligned like them, may follow.
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

/// The same matrix twice. Components are of one kind, or floats of both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatrixConversion {
    pub source: Matrix,
    pub destination: Matrix,
}
