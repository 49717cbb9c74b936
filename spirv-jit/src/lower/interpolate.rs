//! `interpolateAt*`: a varying at another position in the pixel than its decoration's.
//!
//! The result is the sum of the vertices' values, weighted by barycentric coordinates at the
//! requested position.

use rspirv::spirv::GlslStd450Op as GLOp;

use super::Lowerer;
use super::stage_interface::Evaluation;
use super::values::MemoryLocation;
use super::values::Values;
use crate::Error;
use crate::ir::stage::Builtin;
use crate::ir::{self, InputRow, Type, Value};
use crate::parse::Id;

impl Lowerer<'_> {
    /// The extended instruction on a pointer to an input.
    pub(super) fn lower_interpolate_at(
        &mut self,
        op: GLOp,
        operands: &[Id],
    ) -> Result<Values, Error> {
        let pointer = self.pointer(operands[0])?;
        let ty = pointer.pointee;
        let MemoryLocation::Input {
            variable,
            row,
            index,
        } = pointer.place
        else {
            return Err(self.b.invalid("only inputs are interpolated"));
        };
        if op == GLOp::InterpolateAtCentroid {
            return self.load_input(variable, row, index, ty, Evaluation::Centroid);
        }
        let offset = match op {
            GLOp::InterpolateAtOffset => {
                let offset = self.leaves(operands[1])?;
                match offset[..] {
                    [x, y] if self.b.ty(x) == Type::F32 && self.b.ty(y) == Type::F32 => [x, y],
                    _ => return Err(self.b.invalid("an offset is two floats")),
                }
            }
            _ => self.sample_offset(operands[1])?,
        };
        let count = self.types.leaves(ty)?.len();
        if self.types.leaves(ty)?.iter().any(|&ty| ty != Type::F32) {
            return Err(self.b.invalid("only floats are interpolated"));
        }
        let words = self.interface_words(variable)?;
        let Some(&first) = words.get(row as usize).or(words.last()) else {
            return Err(self.b.invalid("an input without words"));
        };
        if let Some((_, perspective)) = first.barycentric() {
            let weights = self.weights_at(perspective, offset)?;
            return (row..)
                .take(count)
                .map(|row| self.weight(weights, row, index))
                .collect();
        }
        let Some(perspective) = first.is_perspective() else {
            return self.load_input(variable, row, index, ty, Evaluation::Decorated);
        };
        let weights = self.weights_at(perspective, offset)?;
        let mut sums = Values::new();
        for (vertex, weight) in (0u8..).zip(weights) {
            let at = Evaluation::Vertex(vertex);
            let values = self.load_input(variable, row, index, ty, at)?;
            for (index, value) in values.into_iter().enumerate() {
                let part = self.b.binary(ir::Op::FMul, weight, value)?;
                match sums.get(index).copied() {
                    None => sums.push(part),
                    Some(sum) => sums[index] = self.b.binary(ir::Op::FAdd, sum, part)?,
                }
            }
        }
        Ok(sums)
    }

    /// The barycentric coordinate of a vertex whose number may be computed.
    fn weight(
        &mut self,
        weights: [Value; 3],
        row: u32,
        index: Option<Value>,
    ) -> Result<Value, Error> {
        let Some(index) = index else {
            return Ok(weights[row.min(2) as usize]);
        };
        let vertex = self.b.add_terms(Some(index), row)?;
        let mut chosen = weights[2];
        for (number, weight) in (0..2).zip(weights) {
            let number = self.b.i32(number);
            let is_this = self.b.compare(ir::Op::IEq, vertex, number)?;
            chosen = self.b.select(is_this, weight, chosen)?;
        }
        Ok(chosen)
    }

    fn weights_at(&mut self, perspective: bool, offset: [Value; 2]) -> Result<[Value; 3], Error> {
        let planes = if perspective {
            Builtin::PerspectivePlanes
        } else {
            Builtin::LinearPlanes
        };
        let mut weights = [offset[0]; 3];
        for (vertex, weight) in (0u8..).zip(&mut weights) {
            let [at, dx, dy] = [0, 3, 6].map(|first| InputRow::Builtin(planes, first + vertex));
            let at = self.input(at, Type::F32)?;
            let (dx, dy) = (self.input(dx, Type::F32)?, self.input(dy, Type::F32)?);
            let x = self.b.binary(ir::Op::FMul, dx, offset[0])?;
            let y = self.b.binary(ir::Op::FMul, dy, offset[1])?;
            let moved = self.b.binary(ir::Op::FAdd, at, x)?;
            *weight = self.b.binary(ir::Op::FAdd, moved, y)?;
        }
        if perspective {
            let [a, b, c] = weights;
            let sum = self.b.binary(ir::Op::FAdd, a, b)?;
            let sum = self.b.binary(ir::Op::FAdd, sum, c)?;
            for weight in &mut weights {
                *weight = self.b.binary(ir::Op::FDiv, *weight, sum)?;
            }
        }
        Ok(weights)
    }

    /// The position of a sample, relative to the pixel's center.
    fn sample_offset(&mut self, sample: Id) -> Result<[Value; 2], Error> {
        let sample = self.scalar(sample)?;
        let sample = self.b.i32_of(sample, false)?;
        let shift = self.b.scale(sample, 4)?;
        let mut offset = [shift; 2];
        for (axis, offset) in (0..).zip(&mut offset) {
            let word = self.input(InputRow::Builtin(Builtin::SampleLocations, axis), Type::I32)?;
            let place = self.b.binary(ir::Op::LShr, word, shift)?;
            let low = self.b.i32(15);
            let place = self.b.binary(ir::Op::And, place, low)?;
            let place = self.b.emit(ir::Op::UToF, &[place], Type::F32)?;
            let (sixteenth, half) = (self.b.f32(1.0 / 16.0), self.b.f32(0.5));
            let place = self.b.binary(ir::Op::FMul, place, sixteenth)?;
            *offset = self.b.binary(ir::Op::FSub, place, half)?;
        }
        Ok(offset)
    }
}
