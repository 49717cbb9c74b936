//! Cooperative matrices. A matrix has 16 rows and columns; a value is a row, and a lane holds the
//! column of its number. Operations on single components are lowered as for vectors.

use rspirv::spirv::{CooperativeMatrixLayout, CooperativeMatrixOperands, Op};
use smallvec::SmallVec;

use super::Lowerer;
use super::memory::access;
use super::types::{TypeKind, UNTYPED};
use super::values::{MemoryLocation, Pointer, Values};
use crate::Error;
use crate::ir::op::{Access, Component, MatrixProduct};
use crate::ir::{self, Space, Type, Value};
use crate::parse::{Id, Instruction};

const SIZE: usize = MatrixProduct::SIZE;

/// Of an access.
type MatrixOperands = SmallVec<[Value; 2]>;

/// Bytes from a line of a matrix to the next. A computed stride is an i32, or an i64 in shaders
/// with 64-bit indexing.
#[derive(Clone, Copy)]
enum Stride {
    Constant(u64),
    Value(Value),
}

/// The location of a matrix's components in memory.
struct Lines {
    /// The first component of the lane's column.
    pointer: Pointer,
    /// Distance between components.
    stride: Stride,
    ty: Type,
}

impl Lowerer<'_> {
    pub(super) fn lower_cooperative_matrix(
        &mut self,
        instruction: &Instruction,
    ) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        match instruction.opcode {
            Op::CooperativeMatrixLoadKHR => {
                let ty = instruction.result_type;
                let lines = self.matrix_lines(operands[0], ty, &operands[1..])?;
                let values = self.load_lines(lines)?;
                self.define_typed(instruction, values)
            }
            Op::CooperativeMatrixStoreKHR => {
                let ty = self.type_of(operands[1])?;
                let values = self.leaves(operands[1])?;
                let lines = self.matrix_lines(operands[0], ty, &operands[2..])?;
                self.store_lines(lines, &values)
            }
            Op::CooperativeMatrixLengthKHR => {
                let length = self.types.element_count(operands[0])?;
                let length = self.b.i32(length);
                self.define_typed(instruction, [length])
            }
            _ => self.lower_matrix_product(instruction, operands),
        }
    }

    /// The components of a matrix behind a pointer; `operands`: layout, stride, and operands of
    /// memory accesses.
    fn matrix_lines(&mut self, id: Id, matrix: Id, operands: &[u32]) -> Result<Lines, Error> {
        let TypeKind::CooperativeMatrix { component } = *self.types.kind(matrix)? else {
            return Err(self.b.invalid("a cooperative matrix is expected"));
        };
        let ty = self.types.scalar(component)?;
        let mut pointer = self.pointer(id)?;
        pointer = self.with_access(pointer, operands.get(2..).unwrap_or_default());
        if !matches!(
            pointer.place,
            MemoryLocation::Shared { .. }
                | MemoryLocation::Buffer { .. }
                | MemoryLocation::Buffer64 { .. }
                | MemoryLocation::Global { .. }
        ) {
            return Err(self.b.invalid("a matrix is not loaded or stored there"));
        }
        let size_bytes = u64::from(ty.size_bytes());
        // Components of a line are consecutive, independent of the stride.
        pointer.alignment = pointer.alignment.min(size_bytes.ilog2() as u8);
        // A stride counts elements of the pointee.
        let (_, pointee) = self.types.pointer(self.type_of(id)?)?;
        let unit = match pointee {
            UNTYPED => 1,
            pointee => self.layout().natural(pointee)?.0,
        };
        let stride = match operands.get(1) {
            None => return Err(self.b.invalid("a matrix in memory lacks its stride")),
            Some(&id) if self.constants.find(id).is_some() => {
                let stride = self.constants.integer(&self.types, id)?;
                Stride::Constant((stride as u64).wrapping_mul(unit))
            }
            Some(&id) => {
                let value = self.scalar(id)?;
                let value = match self.types.has_wide_offsets {
                    true => self
                        .b
                        .i64_of(value, self.types.is_signed(self.type_of(id)?))?,
                    false => self.resize(value, Type::I32)?,
                };
                Stride::Value(self.b.scale(value, unit)?)
            }
        };
        let component = Stride::Constant(size_bytes);
        let layout = self.constants.unsigned(&self.types, operands[0])?;
        let (of_lane, stride) = match CooperativeMatrixLayout::from_u32(layout) {
            Some(CooperativeMatrixLayout::RowMajorKHR) => (component, stride),
            Some(CooperativeMatrixLayout::ColumnMajorKHR) => (stride, component),
            _ => {
                let message = format!("matrices of layout {layout} are not supported");
                return Err(Error::unsupported(self.b.source, message));
            }
        };
        let lane = self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?;
        let lane = match self.types.has_wide_offsets {
            true => self.b.i64_of(lane, false)?,
            false => lane,
        };
        let bytes = match of_lane {
            Stride::Constant(bytes) => self.b.scale(lane, bytes)?,
            Stride::Value(bytes) => self.b.binary(ir::Op::IMul, lane, bytes)?,
        };
        let pointer = self.moved(&pointer, bytes)?;
        Ok(Lines {
            pointer,
            stride,
            ty,
        })
    }

    /// The location some bytes further.
    fn moved(&mut self, pointer: &Pointer, bytes: Value) -> Result<Pointer, Error> {
        let mut pointer = pointer.clone();
        match &mut pointer.place {
            MemoryLocation::Shared { offset, .. } | MemoryLocation::Buffer { offset, .. } => {
                let bytes = self.resize(bytes, Type::I32)?;
                *offset = Some(self.add(*offset, bytes)?);
            }
            MemoryLocation::Buffer64 { offset, .. } => {
                let bytes = self.b.i64_of(bytes, true)?;
                *offset = Some(self.add(*offset, bytes)?);
            }
            MemoryLocation::Global { address, .. } => {
                let bytes = self.b.i64_of(bytes, true)?;
                *address = self.b.binary(ir::Op::IAdd, *address, bytes)?;
            }
            _ => {}
        }
        Ok(pointer)
    }

    /// The accesses to a matrix, each with its operands, kind and number of components.
    fn accesses(&mut self, lines: Lines) -> Result<Vec<(Access, MatrixOperands, usize)>, Error> {
        let Lines {
            mut pointer,
            stride,
            ty,
        } = lines;
        let whole = access(&pointer, 0);
        let mut operands = self.address(&pointer, 0)?;
        match stride {
            Stride::Constant(bytes) if bytes == u64::from(ty.size_bytes()) => {
                Ok(vec![(whole, operands, SIZE)])
            }
            _ if matches!(whole.space, Space::Shared | Space::Buffer) => {
                operands.push(match stride {
                    Stride::Constant(bytes) => self.b.i32(bytes as u32),
                    Stride::Value(bytes) => self.resize(bytes, Type::I32)?,
                });
                let strided = Access {
                    is_strided: true,
                    ..whole
                };
                Ok(vec![(strided, operands, SIZE)])
            }
            _ => {
                let mut all = Vec::with_capacity(SIZE);
                for row in 0..SIZE as u64 {
                    let offset = match stride {
                        Stride::Constant(bytes) => bytes.wrapping_mul(row),
                        Stride::Value(_) => 0,
                    };
                    let operands = self.address(&pointer, offset)?;
                    all.push((access(&pointer, offset), operands, 1));
                    if let Stride::Value(bytes) = stride {
                        pointer = self.moved(&pointer, bytes)?;
                    }
                }
                Ok(all)
            }
        }
    }

    fn load_lines(&mut self, lines: Lines) -> Result<Values, Error> {
        let ty = lines.ty;
        let mut values = Values::with_capacity(SIZE);
        for (access, operands, count) in self.accesses(lines)? {
            let loaded = self.b.load(access, &operands, &[ty; SIZE][..count])?;
            values.extend(loaded);
        }
        Ok(values)
    }

    fn store_lines(&mut self, lines: Lines, mut values: &[Value]) -> Result<(), Error> {
        for (access, operands, count) in self.accesses(lines)? {
            let (part, rest) = values.split_at(count);
            let access = Access {
                constant: false,
                ..access
            };
            self.b.store(access, &operands, part)?;
            values = rest;
        }
        Ok(())
    }

    /// The kind of a matrix's components.
    fn matrix_component(&self, matrix: Id, signed: bool) -> Result<Component, Error> {
        let kind = match *self.types.kind(matrix)? {
            TypeKind::CooperativeMatrix { component } => self.types.kind(component)?,
            _ => return Err(self.b.invalid("a cooperative matrix is expected")),
        };
        Ok(match (kind, signed) {
            (
                TypeKind::Scalar {
                    is_bfloat16: true, ..
                },
                _,
            ) => Component::BFloat16,
            (TypeKind::Scalar { ty: Type::F16, .. }, _) => Component::F16,
            (TypeKind::Scalar { ty: Type::F32, .. }, _) => Component::F32,
            (TypeKind::Scalar { ty: Type::I8, .. }, true) => Component::S8,
            (TypeKind::Scalar { ty: Type::I8, .. }, false) => Component::U8,
            (TypeKind::Scalar { ty: Type::I32, .. }, true) => Component::S32,
            (TypeKind::Scalar { ty: Type::I32, .. }, false) => Component::U32,
            _ => return Err(self.no_product()),
        })
    }

    fn no_product(&self) -> Error {
        let message = "a product of matrices of these types is not supported";
        Error::unsupported(self.b.source, message)
    }

    /// `OpCooperativeMatrixMulAddKHR`.
    fn lower_matrix_product(
        &mut self,
        instruction: &Instruction,
        operands: &[u32],
    ) -> Result<(), Error> {
        type Bits = CooperativeMatrixOperands;
        let bits = Bits::from_bits_truncate(operands.get(3).copied().unwrap_or(0));
        let [a, b, c] = [operands[0], operands[1], operands[2]];
        let product = MatrixProduct {
            a: self.matrix_component(
                self.type_of(a)?,
                bits.contains(Bits::MATRIX_A_SIGNED_COMPONENTS_KHR),
            )?,
            b: self.matrix_component(
                self.type_of(b)?,
                bits.contains(Bits::MATRIX_B_SIGNED_COMPONENTS_KHR),
            )?,
            sum: self.matrix_component(
                instruction.result_type,
                bits.contains(Bits::MATRIX_RESULT_SIGNED_COMPONENTS_KHR),
            )?,
            saturates: bits.contains(Bits::SATURATING_ACCUMULATION_KHR),
        };
        let mut args = Values::with_capacity(3 * SIZE);
        for id in [a, b, c] {
            args.extend_from_slice(&self.leaves(id)?);
        }
        let sums = args[2 * SIZE..].iter();
        let is_of_sum = |&value: &Value| self.b.ty(value) == product.sum.ty();
        if !product.is_valid() || !sums.clone().all(is_of_sum) {
            return Err(self.no_product());
        }
        let results = [product.sum.ty(); SIZE];
        let op = ir::Op::MatrixProduct(product);
        let values = self.b.emit_unchecked(op, &args, &results)?;
        self.define_typed(instruction, &values[..])
    }
}
