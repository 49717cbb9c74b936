//! Derivatives: differences between the lanes of a quad, fine ones (see [`lanes::quad`]).

use rspirv::spirv::{ExecutionMode, Op};

use super::Lowerer;
use crate::Error;
use crate::ir::stage::Stage;
use crate::ir::{self, Value};
use crate::parse::{Id, Instruction};

/// The axis; `None` for the sum of both lengths.
fn axis(opcode: Op) -> Option<Option<u32>> {
    Some(match opcode {
        Op::DPdx | Op::DPdxFine | Op::DPdxCoarse => Some(0),
        Op::DPdy | Op::DPdyFine | Op::DPdyCoarse => Some(1),
        Op::Fwidth | Op::FwidthFine | Op::FwidthCoarse => None,
        _ => return None,
    })
}

pub(super) fn is_derivative(opcode: Op) -> bool {
    axis(opcode).is_some()
}

impl Lowerer<'_> {
    /// Whether the entry point has quads, and whether they are two by two invocations of its
    /// workgroup (instead of four in a row).
    pub(super) fn derivative_group(&self) -> Option<bool> {
        if self.request.stage == Stage::Fragment {
            return Some(true);
        }
        self.execution_modes().find_map(|(mode, _)| match mode {
            ExecutionMode::DerivativeGroupQuadsKHR => Some(true),
            ExecutionMode::DerivativeGroupLinearKHR => Some(false),
            _ => None,
        })
    }

    pub(super) fn lower_derivative(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let Some(axis) = axis(instruction.opcode) else {
            return Err(self.unsupported(instruction));
        };
        let values = self.leaves(self.module.operands(instruction)[0])?;
        let mut results = Vec::with_capacity(values.len());
        for &value in values.iter() {
            results.push(match axis {
                Some(axis) => self.difference(value, axis)?,
                None => {
                    let (dx, dy) = (self.difference(value, 0)?, self.difference(value, 1)?);
                    let dx = self.b.unary(ir::Op::FAbs, dx)?;
                    let dy = self.b.unary(ir::Op::FAbs, dy)?;
                    self.b.binary(ir::Op::FAdd, dx, dy)?
                }
            });
        }
        self.define_typed(instruction, results)
    }

    fn difference(&mut self, value: Value, axis: u32) -> Result<Value, Error> {
        let op = match axis {
            0 => ir::Op::DerivativeX,
            _ => ir::Op::DerivativeY,
        };
        let ty = self.b.ty(value);
        if !ty.is_float() {
            return Err(self.b.invalid("derivatives are of floats"));
        }
        self.b.emit_one(op, &[value], ty)
    }

    /// The derivatives of coordinates for an implicit level of detail: all in x, then in y. A bias
    /// of n scales the footprint by 2ⁿ.
    pub(super) fn gradients(
        &mut self,
        coordinates: &[Value],
        bias: Option<Id>,
    ) -> Result<Vec<Value>, Error> {
        let factor = match bias {
            Some(bias) => {
                let bias = self.scalar(bias)?;
                Some(self.b.unary(ir::Op::FExp2, bias)?)
            }
            None => None,
        };
        let mut gradients = Vec::with_capacity(2 * coordinates.len());
        for axis in 0..2 {
            for &coordinate in coordinates {
                let difference = self.difference(coordinate, axis)?;
                gradients.push(match factor {
                    Some(factor) => self.b.binary(ir::Op::FMul, difference, factor)?,
                    None => difference,
                });
            }
        }
        Ok(gradients)
    }
}
