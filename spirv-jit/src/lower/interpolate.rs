//! `interpolateAt*`: a varying elsewhere in the pixel than decorated.
//!
//! The result is the sum of the vertices' values, weighted by barycentric coordinates at the place that is asked for.

use rspirv::spirv::GlslStd450Op as GLOp;

use super::Lowerer;
use super::memory::Values;
use super::values::Place;
use crate::Error;
use crate::ir::interface::{Position, Varying, VaryingMode};
use crate::ir::{self, InputRow, Type, Value};
use crate::parse::Id;
use crate::program::Builtin;

/// The standard sample locations of 2, 4 and 8 samples, in sixteenths of a pixel from its corner (Vulkan, "Multisampling").
const LOCATIONS: [(u32, &[[u8; 2]]); 3] = [
    (2, &[[12, 12], [4, 4]]),
    (4, &[[6, 2], [14, 6], [2, 10], [10, 14]]),
    (
        8,
        &[
            [9, 5],
            [7, 11],
            [13, 9],
            [5, 3],
            [3, 13],
            [1, 7],
            [11, 15],
            [15, 1],
        ],
    ),
];

impl Lowerer<'_> {
    /// The extended instruction on a pointer to an input.
    pub(super) fn lower_interpolate_at(
        &mut self,
        op: GLOp,
        operands: &[Id],
    ) -> Result<Values, Error> {
        let pointer = self.pointer(operands[0])?;
        let Place::Builtin { variable, word } = pointer.place else {
            let message = "interpolation of a computed element is not supported".to_owned();
            return Err(Error::unsupported(self.b.source, message));
        };
        if op == GLOp::InterpolateAtCentroid {
            let at = Some(Position::Centroid);
            return self
                .load_stage_input(variable, word, pointer.pointee, at)
                .map(Values::from);
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
        let words = self.interface_words(variable)?;
        let types = self.types.leaves(pointer.pointee)?;
        if types.iter().any(|&ty| ty != Type::F32) {
            return Err(self.b.invalid("only floats are interpolated"));
        }
        let mut values = Values::new();
        for index in 0..types.len() {
            let from = words.get(word as usize + index).or(words.last()).copied();
            let varying = from.and_then(|word| self.varying(word, Type::F32));
            let Some(varying) = varying else {
                return Err(self.b.invalid("only varyings are interpolated"));
            };
            values.push(self.interpolated(varying, offset)?);
        }
        Ok(values)
    }

    /// A varying at an offset from the pixel's centre. One that is flat stays as it is.
    fn interpolated(&mut self, varying: Varying, offset: [Value; 2]) -> Result<Value, Error> {
        let perspective = match varying.mode {
            VaryingMode::Smooth(_) => true,
            VaryingMode::Linear(_) => false,
            _ => return self.input(InputRow::Varying(varying), Type::F32),
        };
        let weights = self.weights_at(perspective, offset)?;
        let mut sum = None;
        for (vertex, weight) in (0u8..).zip(weights) {
            let row = InputRow::Varying(Varying {
                mode: VaryingMode::PerVertex(vertex),
                ..varying
            });
            let value = self.input(row, Type::F32)?;
            let part = self.b.binary(ir::Op::FMul, weight, value)?;
            sum = Some(match sum {
                None => part,
                Some(sum) => self.b.binary(ir::Op::FAdd, sum, part)?,
            });
        }
        sum.ok_or_else(|| self.b.invalid("a primitive has vertices"))
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

    /// Where a sample lies, from the pixel's centre.
    fn sample_offset(&mut self, sample: Id) -> Result<[Value; 2], Error> {
        let sample = self.scalar(sample)?;
        let sample = self.b.i32_of(sample, false)?;
        let count = self.input(InputRow::Builtin(Builtin::SampleCount, 0), Type::I32)?;
        let zero = self.b.constant(Type::F32, 0);
        let mut offset = [zero; 2];
        for (samples, places) in LOCATIONS {
            let of_count = self.b.i32(samples);
            let is_count = self.b.compare(ir::Op::IEq, count, of_count)?;
            for (index, place) in (0..).zip(places) {
                let of_sample = self.b.i32(index);
                let is_sample = self.b.compare(ir::Op::IEq, sample, of_sample)?;
                let is_both = self.b.binary(ir::Op::And, is_count, is_sample)?;
                for axis in 0..2 {
                    let from_center = (f32::from(place[axis]) - 8.0) / 16.0;
                    let there = self.b.constant(Type::F32, from_center.to_bits().into());
                    let args = [is_both, there, offset[axis]];
                    offset[axis] = self.b.emit(ir::Op::Select, &args, Type::F32)?;
                }
            }
        }
        Ok(offset)
    }
}
