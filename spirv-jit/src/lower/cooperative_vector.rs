//! Cooperative vectors (`SPV_NV_cooperative_vector`): vectors of any length, which are lowered like
//! others, and their products with matrices in memory.

use rspirv::spirv::{CooperativeMatrixOperands, CooperativeVectorMatrixLayout, Op};

use super::Lowerer;
use super::memory::{access, space};
use super::types::TypeKind;
use super::values::{MemoryLocation, Pointer, Values};
use crate::Error;
use crate::ir::op::{Component, VectorProduct, optimal_stride_bytes};
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction};

/// A *Component Type* of SPIR-V: the interpretation of components of the input, the matrix or the
/// bias.
#[derive(Clone, Copy, PartialEq)]
enum Interpretation {
    Each(Component),
    /// Four components in a word.
    Packed(Component),
}

impl Interpretation {
    /// By the value of a *Component Type*.
    fn new(value: u32) -> Option<Interpretation> {
        use Interpretation::{Each, Packed};
        Some(match value {
            0 => Each(Component::F16),
            1 => Each(Component::F32),
            3 => Each(Component::S8),
            5 => Each(Component::S32),
            7 => Each(Component::U8),
            9 => Each(Component::U32),
            1_000_491_000 => Packed(Component::S8),
            1_000_491_001 => Packed(Component::U8),
            1_000_491_002 => Each(Component::E4M3),
            1_000_491_003 => Each(Component::E5M2),
            _ => return None,
        })
    }
}

impl Lowerer<'_> {
    pub(super) fn lower_cooperative_vector(
        &mut self,
        instruction: &Instruction,
    ) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        match instruction.opcode {
            Op::CooperativeVectorLoadNV => {
                let pointer = self.vector_place(operands[0], operands[1])?;
                let pointer = self.with_access(pointer, &operands[2..]);
                let types = self.vector(instruction.result_type)?;
                let values = self.load_vector(&pointer, types)?;
                self.define_typed(instruction, values)
            }
            Op::CooperativeVectorStoreNV => {
                let pointer = self.vector_place(operands[0], operands[1])?;
                let pointer = self.with_access(pointer, &operands[3..]);
                self.vector(self.type_of(operands[2])?)?;
                let values = self.leaves(operands[2])?;
                let place = self.address(&pointer, 0)?;
                self.b.store(access(&pointer, 0), &place, &values)
            }
            _ => self.lower_vector_product(instruction, operands),
        }
    }

    /// The type and number of a vector's components.
    fn vector(&self, ty: Id) -> Result<(Type, usize), Error> {
        match *self.types.kind(ty)? {
            TypeKind::Vector { component, count } => {
                Ok((self.types.scalar(component)?, count as usize))
            }
            _ => Err(self.b.invalid("a cooperative vector is expected")),
        }
    }

    /// The location at a byte offset from a pointer to an array.
    fn vector_place(&mut self, array: Id, offset: Id) -> Result<Pointer, Error> {
        let mut pointer = self.pointer(array)?;
        let bytes = self.scalar(offset)?;
        // Components are consecutive, independent of the offset.
        pointer.alignment = 0;
        match &mut pointer.place {
            MemoryLocation::Shared { offset, .. } | MemoryLocation::Buffer { offset, .. } => {
                let bytes = self.b.i32_of(bytes, false)?;
                *offset = Some(self.add(*offset, bytes)?);
            }
            MemoryLocation::Buffer64 { offset, .. } => {
                let bytes = self.b.i64_of(bytes, false)?;
                *offset = Some(self.add(*offset, bytes)?);
            }
            MemoryLocation::Global { address, .. } => {
                let bytes = self.b.i64_of(bytes, false)?;
                *address = self.b.binary(ir::Op::IAdd, *address, bytes)?;
            }
            _ => return Err(self.b.invalid("cooperative vectors are not in that memory")),
        }
        Ok(pointer)
    }

    fn load_vector(
        &mut self,
        pointer: &Pointer,
        (ty, count): (Type, usize),
    ) -> Result<Values, Error> {
        let place = self.address(pointer, 0)?;
        let loaded = self.b.load(access(pointer, 0), &place, &vec![ty; count])?;
        Ok(loaded.into_iter().collect())
    }

    fn interpretation(&self, id: Id) -> Result<Interpretation, Error> {
        let value = self.constants.unsigned(&self.types, id)?;
        Interpretation::new(value).ok_or_else(|| self.no_vector_product())
    }

    fn no_vector_product(&self) -> Error {
        let message = "a product of a matrix and a vector of these types is not supported";
        Error::unsupported(self.b.source, message)
    }

    /// `OpCooperativeVectorMatrixMulNV` and `OpCooperativeVectorMatrixMulAddNV`.
    fn lower_vector_product(
        &mut self,
        instruction: &Instruction,
        operands: &[u32],
    ) -> Result<(), Error> {
        let adds = instruction.opcode == Op::CooperativeVectorMatrixMulAddNV;
        let number = |index: usize| self.constants.unsigned(&self.types, operands[index]);
        let rest = if adds { 8 } else { 5 };
        let [rows, columns, layout] = [number(rest)?, number(rest + 1)?, number(rest + 2)?];
        let transposes = number(rest + 3)? != 0;
        let signs = operands.get(rest + 5).copied().unwrap_or(0);
        let signs = CooperativeMatrixOperands::from_bits_truncate(signs);
        let is_signed = signs.contains(CooperativeMatrixOperands::MATRIX_B_SIGNED_COMPONENTS_KHR);

        let (ty, count) = self.vector(instruction.result_type)?;
        let most = VectorProduct::MAX_COMPONENTS as u32;
        if count as u32 != rows || !(1..=most).contains(&rows) || !(1..=most).contains(&columns) {
            return Err(self
                .b
                .invalid("a product does not have its number of components"));
        }
        let sum = match ty {
            Type::F16 => Component::F16,
            Type::F32 => Component::F32,
            Type::I32 => Component::S32,
            _ => return Err(self.no_vector_product()),
        };
        let Interpretation::Each(matrix) = self.interpretation(operands[4])? else {
            return Err(self.no_vector_product());
        };
        let input = self.interpretation(operands[1])?;
        let vector = self.interpreted(operands[0], input, is_signed, columns as usize)?;
        let is_row_major = |layout| layout != Some(CooperativeVectorMatrixLayout::ColumnMajorNV);
        let layout = CooperativeVectorMatrixLayout::from_u32(layout);
        let product = VectorProduct {
            matrix,
            vector: vector.1,
            sum,
            by_columns: is_row_major(layout) == transposes,
            adds,
        };
        if !product.is_valid() {
            return Err(self.no_vector_product());
        }
        // The matrix before its transposition is stored in rows.
        let elements = if transposes { rows } else { columns };
        let stride = self.matrix_stride(layout, operands.get(rest + 4), elements, matrix)?;

        let pointer = self.vector_place(operands[2], operands[3])?;
        if let MemoryLocation::Shared { .. } = pointer.place {
            return Err(self.b.invalid("matrices are not in workgroup memory"));
        }
        let mut args: Values = self.address(&pointer, 0)?.into_iter().collect();
        args.push(stride);
        args.extend(vector.0);
        if adds {
            args.extend(self.bias(operands, (ty, count))?);
        }
        let op = ir::Op::VectorProduct(product, space(&pointer));
        let values = self.b.emit_unchecked(op, &args, &vec![ty; count])?;
        self.define_typed(instruction, &values[..])
    }

    /// The distance in bytes between the rows or columns of a matrix in memory: an operand, or by
    /// the size of its `elements` in an optimal layout.
    fn matrix_stride(
        &mut self,
        layout: Option<CooperativeVectorMatrixLayout>,
        operand: Option<&u32>,
        elements: u32,
        matrix: Component,
    ) -> Result<Value, Error> {
        use CooperativeVectorMatrixLayout::{ColumnMajorNV, RowMajorNV};
        match (layout, operand) {
            (Some(RowMajorNV | ColumnMajorNV), Some(&id)) => {
                let stride = self.scalar(id)?;
                self.b.i32_of(stride, false)
            }
            (Some(RowMajorNV | ColumnMajorNV), None) => {
                Err(self.b.invalid("a matrix in memory lacks its stride"))
            }
            (Some(_), _) => {
                let element_bytes = matrix.ty().size_bytes();
                let stride = optimal_stride_bytes(elements.into(), element_bytes.into());
                Ok(self.b.i32(stride as u32))
            }
            (None, _) => Err(self.b.invalid("no such layout of matrices")),
        }
    }

    /// The bias of a product with components of this type, which its own must have.
    fn bias(&mut self, operands: &[u32], (ty, count): (Type, usize)) -> Result<Values, Error> {
        let bias = self.interpretation(operands[7])?;
        let place = self.vector_place(operands[5], operands[6])?;
        let is_of_sum = match bias {
            Interpretation::Each(bias) => bias.ty() == ty && bias.is_float() == ty.is_float(),
            Interpretation::Packed(_) => false,
        };
        if !is_of_sum {
            return Err(self.no_vector_product());
        }
        self.load_vector(&place, (ty, count))
    }

    /// The components of an input, converted to its interpretation.
    ///
    /// A 16-bit float that is read as one of 8 bits keeps its precision, as it may (Vulkan
    /// Environment for SPIR-V, "Precision of Individual Operations").
    fn interpreted(
        &mut self,
        input: Id,
        interpretation: Interpretation,
        is_signed: bool,
        count: usize,
    ) -> Result<(Values, Component), Error> {
        let (from, given) = self.vector(self.type_of(input)?)?;
        let values = self.leaves(input)?;
        let component = match interpretation {
            Interpretation::Packed(component) => {
                if from != Type::I32 || given < count.div_ceil(4) {
                    return Err(self.b.invalid("a packed vector has too few words"));
                }
                let parts = self.bitcast(&values, &vec![Type::I8; 4 * given])?;
                return Ok((parts[..count].iter().copied().collect(), component));
            }
            Interpretation::Each(component) => component,
        };
        if given != count {
            return Err(self
                .b
                .invalid("a vector does not have its number of components"));
        }
        let to = match component {
            Component::F32 => Component::F32,
            Component::F16 | Component::E4M3 | Component::E5M2 => Component::F16,
            Component::S8 | Component::U8 => component,
            _ => return Err(self.no_vector_product()),
        };
        let mut converted = Values::with_capacity(count);
        for &value in values.iter() {
            converted.push(self.converted(value, from, is_signed, to)?);
        }
        Ok((converted, to))
    }

    /// A component as another type: nearest, ties to even, and saturated.
    fn converted(
        &mut self,
        value: Value,
        from: Type,
        is_signed: bool,
        to: Component,
    ) -> Result<Value, Error> {
        let ty = to.ty();
        match (from.is_float(), to.is_float()) {
            (true, true) if from == ty => Ok(value),
            (true, true) => self.b.emit(ir::Op::FConvert, &[value], ty),
            (false, true) => {
                let op = if is_signed {
                    ir::Op::SToF
                } else {
                    ir::Op::UToF
                };
                self.b.emit(op, &[value], ty)
            }
            (true, false) => {
                let (op, least, most) = match to {
                    Component::S8 => (ir::Op::FToS, -128.0, 127.0),
                    _ => (ir::Op::FToU, 0.0, 255.0),
                };
                let number = self.b.unary(ir::Op::FRoundEven, value)?;
                let least = self.b.float(from, least);
                let number = self.b.binary(ir::Op::FMax, number, least)?;
                let most = self.b.float(from, most);
                let number = self.b.binary(ir::Op::FMin, number, most)?;
                self.b.emit(op, &[number], ty)
            }
            (false, false) if from == ty && is_signed == (to == Component::S8) => Ok(value),
            (false, false) => {
                let (least, most) = match to {
                    Component::S8 => (-128i64, 127u64),
                    _ => (0, 255),
                };
                // In 16 bits or more, which hold all limits.
                let wide = match from.bits() {
                    8 => Type::I16,
                    _ => from,
                };
                let widen = if is_signed {
                    ir::Op::SConvert
                } else {
                    ir::Op::UConvert
                };
                let mut number = value;
                if wide != from {
                    number = self.b.emit(widen, &[number], wide)?;
                }
                if is_signed {
                    let least = self.b.constant(wide, least as u64);
                    number = self.b.binary(ir::Op::SMax, number, least)?;
                }
                let most = self.b.constant(wide, most);
                let op = if is_signed {
                    ir::Op::SMin
                } else {
                    ir::Op::UMin
                };
                let number = self.b.binary(op, number, most)?;
                self.b.emit(ir::Op::UConvert, &[number], ty)
            }
        }
    }
}
