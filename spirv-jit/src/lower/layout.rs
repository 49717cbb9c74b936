//! The layout of scalars in shared memory: explicit layouts (`Offset`, `ArrayStride`,
//! `MatrixStride`, `RowMajor`), and natural alignment without them (workgroup memory).

use rspirv::spirv::Decoration;

use super::constants::Constants;
use super::types::{MAX_ROWS, TypeKind, Types, is_physical};
use super::values::Shape;
use crate::Error;
use crate::ir::Type;
use crate::parse::{Annotations, Id};

/// Types of a module together with their decorations.
#[derive(Clone, Copy)]
pub(super) struct TypeLayout<'a> {
    pub types: &'a Types,
    pub annotations: &'a Annotations,
    pub constants: &'a Constants,
    /// Whether `ArrayStride` applies. It does not in workgroup memory that the compiler lays out.
    pub has_strides: bool,
}

impl TypeLayout<'_> {
    /// The stride that the decoration of an array, or of a pointer into one, gives to its elements.
    fn stride_decoration(&self, id: Id) -> Option<u64> {
        let given = self.annotations.id(id, Decoration::ArrayStride);
        given.filter(|_| self.has_strides).map(u64::from)
    }

    /// Bytes between elements of a type in an array; `given_by` is the type of the array, or of the
    /// pointer that leads into it.
    pub fn stride(&self, given_by: Id, element: Id) -> Result<u64, Error> {
        if let Some(stride) = self.stride_decoration(given_by) {
            return Ok(stride);
        }
        if let Some(stride) = self.annotations.id(given_by, Decoration::ArrayStrideIdEXT) {
            return self.constants.unsigned(self.types, stride).map(u64::from);
        }
        let (size, align) = self.natural(element)?;
        Ok(size.next_multiple_of(align))
    }

    /// Bytes between the elements of an array.
    pub fn array_stride(&self, array: Id) -> Result<u64, Error> {
        self.stride(array, self.types.element(array, None)?)
    }

    /// Bytes before a member.
    pub fn member_offset(&self, structure: Id, member: u32) -> Result<u64, Error> {
        let given = self
            .annotations
            .member(structure, member, Decoration::Offset);
        if let Some(offset) = given {
            return Ok(offset as u64);
        }
        let given = (self.annotations).member(structure, member, Decoration::OffsetIdEXT);
        if let Some(offset) = given {
            return self.constants.unsigned(self.types, offset).map(u64::from);
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

    /// The matrix layout that a member's decorations give to the matrices inside.
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
        let info = self.types.info(id)?;
        let natural = match self.has_strides {
            true => info.natural,
            false => info.packed,
        };
        natural.ok_or_else(no_layout)
    }

    /// Bytes from the start of a value in memory to the end of its last scalar; `u64::MAX` for
    /// values with more scalars than [`MAX_ROWS`].
    pub fn extent(&self, id: Id, shape: Shape) -> Result<u64, Error> {
        if self.types.leaf_count(id) > MAX_ROWS {
            return Ok(u64::MAX);
        }
        let mut end = 0u64;
        let mut work = vec![(id, shape, 0u64)];
        while let Some((id, shape, at)) = work.pop() {
            // The last of several equal parts ends last.
            let last = |count: u32, stride: u64| {
                at.saturating_add(u64::from(count.saturating_sub(1)).saturating_mul(stride))
            };
            match self.types.kind(id)? {
                _ if self.types.leaf_count(id) == 0 => {}
                TypeKind::Array { element, count } => {
                    work.push((*element, shape, last(*count, self.array_stride(id)?)));
                }
                TypeKind::Struct { members } => {
                    for (index, &member) in members.iter().enumerate() {
                        let offset = self.member_offset(id, index as u32)?;
                        let shape = self.member_shape(id, index as u32);
                        work.push((member, shape, at.saturating_add(offset)));
                    }
                }
                _ => {
                    for (ty, offset) in self.leaves(id, shape)? {
                        let size = match ty {
                            // A word.
                            Type::I1 => 4,
                            ty => u64::from(ty.size_bytes()),
                        };
                        end = end.max(at.saturating_add(offset).saturating_add(size));
                    }
                }
            }
        }
        Ok(end)
    }

    /// The scalars of a value in memory with their byte offsets, in the order of [`Types::leaves`].
    pub fn leaves(&self, id: Id, shape: Shape) -> Result<Vec<(Type, u64)>, Error> {
        /// The remaining work, last first.
        enum Work {
            Type(Id, Shape, u64),
            /// The contents from an index on, with remaining repetitions and their distance in
            /// bytes.
            Repeat(usize, u32, u64),
        }
        let count = self.types.leaves(id)?.len();
        let mut out: Vec<(Type, u64)> = Vec::with_capacity(count);
        let mut work = vec![Work::Type(id, shape, 0)];
        while let Some(next) = work.pop() {
            let (id, shape, at) = match next {
                Work::Type(id, shape, at) => (id, shape, at),
                Work::Repeat(from, times, stride) => {
                    for more in from..from + (out.len() - from) * times as usize {
                        let (ty, at) = out[more];
                        out.push((ty, at.wrapping_add(stride)));
                    }
                    continue;
                }
            };
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
                    let (step, component_stride) = match shape.row_major {
                        true => (size as u64, stride as u32),
                        false => (stride, 0),
                    };
                    let shape = Shape {
                        component_stride,
                        ..Shape::default()
                    };
                    work.push(Work::Repeat(out.len(), count.saturating_sub(1), step));
                    work.push(Work::Type(*column, shape, at));
                }
                TypeKind::Array { element, count } => {
                    let stride = self.array_stride(id)?;
                    work.push(Work::Repeat(out.len(), count.saturating_sub(1), stride));
                    work.push(Work::Type(*element, shape, at));
                }
                TypeKind::Struct { members } => {
                    let first = work.len();
                    for (index, &member) in members.iter().enumerate() {
                        let offset = self.member_offset(id, index as u32)?;
                        let shape = self.member_shape(id, index as u32);
                        work.push(Work::Type(member, shape, at.wrapping_add(offset)));
                    }
                    work[first..].reverse();
                }
                TypeKind::Pointer { class, .. } if is_physical(*class) => {
                    let mut at = at;
                    for &ty in self.types.pointer_leaves(*class) {
                        out.push((ty, at));
                        at = at.wrapping_add(ty.size_bytes() as u64);
                    }
                }
                _ => return Err(no_layout()),
            }
        }
        Ok(out)
    }
}

fn no_layout() -> Error {
    Error::invalid(0, "this type has no layout in memory")
}
