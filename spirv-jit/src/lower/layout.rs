//! Where scalars lie in memory that others see: explicit layouts (`Offset`, `ArrayStride`, `MatrixStride`, `RowMajor`), and natural
//! alignment where a module gives none (workgroup memory).

use rspirv::spirv::{Decoration, StorageClass};

use super::types::{TypeKind, Types, pointer_leaves};
use super::values::Shape;
use crate::Error;
use crate::ir::Type;
use crate::parse::{Annotations, Id};

/// Types of a module together with their decorations.
#[derive(Clone, Copy)]
pub(super) struct Layout<'a> {
    pub types: &'a Types,
    pub annotations: &'a Annotations,
    /// `ArrayStride` counts: not in workgroup memory that the compiler lays out.
    pub has_strides: bool,
}

impl Layout<'_> {
    /// What the decoration of an array, or of a pointer into one, says of its elements.
    fn given_stride(&self, id: Id) -> Option<u64> {
        let given = self.annotations.id(id, Decoration::ArrayStride);
        given.filter(|_| self.has_strides).map(u64::from)
    }

    /// Bytes between elements of a type in an array.
    fn stride(&self, given_by: Id, element: Id) -> Result<u64, Error> {
        if let Some(stride) = self.given_stride(given_by) {
            return Ok(stride);
        }
        let (size, align) = self.natural(element)?;
        Ok(size.next_multiple_of(align))
    }

    /// Bytes between the elements of an array.
    pub fn array_stride(&self, array: Id) -> Result<u64, Error> {
        self.stride(array, self.types.element(array, None)?)
    }

    /// Bytes between the elements of the array that pointers of a type lead into.
    pub fn pointer_stride(&self, pointer: Id) -> Result<u64, Error> {
        self.stride(pointer, self.types.pointer(pointer)?.1)
    }

    /// Bytes before a member.
    pub fn member_offset(&self, structure: Id, member: u32) -> Result<u64, Error> {
        let given = self
            .annotations
            .member(structure, member, Decoration::Offset);
        if let Some(offset) = given {
            return Ok(offset as u64);
        }
        let TypeKind::Struct { members } = self.types.kind(structure)? else {
            return Err(Error::invalid(0, "a structure is expected"));
        };
        let mut end = 0u64;
        for (index, &part) in members.iter().enumerate() {
            let (size, align) = self.natural(part)?;
            let start = end.saturating_add(align - 1) / align * align;
            if index as u32 == member {
                return Ok(start);
            }
            end = start.saturating_add(size);
        }
        Err(Error::invalid(0, "structure member index out of range"))
    }

    /// The matrix layout that a member's decorations give to what is in it.
    pub fn member_shape(&self, structure: Id, member: u32) -> Shape {
        let find = |decoration| self.annotations.member(structure, member, decoration);
        Shape {
            matrix_stride: find(Decoration::MatrixStride).unwrap_or(0),
            row_major: find(Decoration::RowMajor).is_some(),
            component_stride: 0,
        }
    }

    /// Bytes between the columns (rows if row-major) of a matrix.
    pub fn matrix_stride(&self, matrix: Id, shape: Shape) -> Result<u64, Error> {
        if shape.matrix_stride != 0 {
            return Ok(shape.matrix_stride as u64);
        }
        let columns = self.types.element_count(matrix)?;
        let column = self.types.element(matrix, None)?;
        let rows = self.types.element_count(column)?;
        let line = if shape.row_major { columns } else { rows };
        Ok(line as u64 * self.types.component(matrix)?.size_bytes() as u64)
    }

    /// Size and alignment without decorations: each scalar aligned to its size.
    pub fn natural(&self, id: Id) -> Result<(u64, u64), Error> {
        Ok(match self.types.kind(id)? {
            TypeKind::Scalar { ty, .. } => (ty.size_bytes() as u64, ty.size_bytes() as u64),
            TypeKind::Vector {
                component: element,
                count,
            }
            | TypeKind::Matrix {
                column: element,
                count,
            }
            | TypeKind::Array { element, count } => {
                let (size, align) = self.natural(*element)?;
                let stride = match self.given_stride(id) {
                    Some(stride) => stride,
                    None => size.next_multiple_of(align),
                };
                (stride.saturating_mul(*count as u64), align)
            }
            TypeKind::Struct { members } => {
                let (mut end, mut most) = (0u64, 1);
                for (index, &member) in members.iter().enumerate() {
                    let (size, align) = self.natural(member)?;
                    let given = self
                        .annotations
                        .member(id, index as u32, Decoration::Offset);
                    let start = match given {
                        Some(offset) => offset as u64,
                        None => end.saturating_add(align - 1) / align * align,
                    };
                    end = end.max(start.saturating_add(size));
                    most = most.max(align);
                }
                (end.saturating_add(most - 1) / most * most, most)
            }
            TypeKind::Pointer { class, .. } if is_physical(*class) => {
                let leaves = pointer_leaves(*class);
                let size = leaves.iter().map(|ty| ty.size_bytes() as u64).sum();
                (size, leaves[0].size_bytes() as u64)
            }
            TypeKind::RuntimeArray { .. } => (0, 1),
            _ => return Err(Error::invalid(0, "this type has no layout in memory")),
        })
    }

    /// The scalars of a value in memory with their byte offsets, in the order of [`Types::leaves`].
    pub fn leaves(&self, id: Id, shape: Shape) -> Result<Vec<(Type, u64)>, Error> {
        let count = self.types.leaves(id)?.len();
        let mut out = Vec::with_capacity(count);
        self.push_leaves(id, shape, 0, &mut out)?;
        Ok(out)
    }

    fn push_leaves(
        &self,
        id: Id,
        shape: Shape,
        at: u64,
        out: &mut Vec<(Type, u64)>,
    ) -> Result<(), Error> {
        match self.types.kind(id)? {
            TypeKind::Scalar { ty, .. } => out.push((*ty, at)),
            TypeKind::Vector { component, count } => {
                let ty = self.types.scalar(*component)?;
                let stride = match shape.component_stride {
                    0 => ty.size_bytes(),
                    stride => stride,
                };
                for index in 0..*count {
                    out.push((ty, at.wrapping_add(index as u64 * stride as u64)));
                }
            }
            TypeKind::Matrix { column, count } => {
                let stride = self.matrix_stride(id, shape)?;
                let size = self.types.component(id)?.size_bytes();
                for index in 0..*count as u64 {
                    let (step, component_stride) = match shape.row_major {
                        true => (size as u64, stride as u32),
                        false => (stride, 0),
                    };
                    let shape = Shape {
                        component_stride,
                        ..Shape::default()
                    };
                    self.push_leaves(*column, shape, at.wrapping_add(index * step), out)?;
                }
            }
            TypeKind::Array { element, count } => {
                let stride = self.array_stride(id)?;
                for index in 0..*count as u64 {
                    let at = at.wrapping_add(index.wrapping_mul(stride));
                    self.push_leaves(*element, shape, at, out)?;
                }
            }
            TypeKind::Struct { members } => {
                for (index, &member) in members.iter().enumerate() {
                    let offset = self.member_offset(id, index as u32)?;
                    let shape = self.member_shape(id, index as u32);
                    self.push_leaves(member, shape, at.wrapping_add(offset), out)?;
                }
            }
            TypeKind::Pointer { class, .. } if is_physical(*class) => {
                let mut at = at;
                for &ty in pointer_leaves(*class) {
                    out.push((ty, at));
                    at = at.wrapping_add(ty.size_bytes() as u64);
                }
            }
            _ => return Err(Error::invalid(0, "this type has no layout in memory")),
        }
        Ok(())
    }
}

/// Pointers that may lie in memory that others see: logical ones are for variables of the invocation.
fn is_physical(class: StorageClass) -> bool {
    matches!(
        class,
        StorageClass::PhysicalStorageBuffer | StorageClass::ShaderRecordBufferKHR
    )
}
