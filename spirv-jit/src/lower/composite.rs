//! Composites: construction, extraction and insertion of scalars.

use rspirv::spirv::Op;

use super::Lowerer;
use super::types::TypeKind;
use super::values::Values;
use crate::Error;
use crate::ir::op::MatrixProduct;
use crate::ir::{self, Value};
use crate::parse::Instruction;

impl Lowerer<'_> {
    pub(super) fn lower_composite(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let values = match instruction.opcode {
            Op::CompositeConstruct => {
                let mut values = Values::new();
                for &id in operands {
                    values.extend_from_slice(&self.leaves(id)?);
                }
                match self.types.kind(instruction.result_type)? {
                    TypeKind::CooperativeMatrix { .. } if values.len() == 1 => {
                        Values::from_elem(values[0], MatrixProduct::SIZE)
                    }
                    _ => values,
                }
            }
            Op::CompositeConstructReplicateEXT => {
                let part = self.leaves(operands[0])?;
                let count = self.types.element_count(instruction.result_type)?;
                if part.len() as u64 * count as u64 > super::types::MAX_LEAVES {
                    return Err(super::budget("a composite is too large"));
                }
                part.repeat(count as usize).into()
            }
            Op::CompositeExtract => {
                let ty = self.type_of(operands[0])?;
                let whole = self.leaves(operands[0])?;
                let (first, part) = self.types.path(ty, &operands[1..])?;
                let count = self.types.leaves(part)?.len();
                Values::from_slice(self.slice(&whole, first, count)?)
            }
            Op::CompositeInsert => {
                let part = self.leaves(operands[0])?;
                let ty = self.type_of(operands[1])?;
                let mut whole = Values::from_slice(&self.leaves(operands[1])?);
                let (first, _) = self.types.path(ty, &operands[2..])?;
                self.slice(&whole, first, part.len())?;
                whole[first..first + part.len()].copy_from_slice(&part);
                whole
            }
            Op::VectorShuffle => {
                let a = self.leaves(operands[0])?;
                let b = self.leaves(operands[1])?;
                let ty = self.types.component(instruction.result_type)?;
                let undefined = self.b.constant(ty, 0);
                let mut values = Values::new();
                for &index in &operands[2..] {
                    let index = index as usize;
                    values.push(match index {
                        _ if index == u32::MAX as usize => undefined,
                        _ if index < a.len() => a[index],
                        _ if index < a.len() + b.len() => b[index - a.len()],
                        _ => return Err(self.b.invalid("shuffle index out of range")),
                    });
                }
                values
            }
            Op::VectorExtractDynamic => {
                let vector = self.leaves(operands[0])?;
                let index = self.scalar(operands[1])?;
                Values::from_slice(&[self.select_component(&vector, index)?])
            }
            _ => {
                let vector = self.leaves(operands[0])?;
                let component = self.scalar(operands[1])?;
                let index = self.scalar(operands[2])?;
                let ty = self.b.ty(index);
                let mut values = Values::new();
                for (lane, &old) in vector.iter().enumerate() {
                    let lane = self.b.constant(ty, lane as u64);
                    let here = self.b.compare(ir::Op::IEq, index, lane)?;
                    values.push(self.b.select(here, component, old)?);
                }
                values
            }
        };
        self.define_typed(instruction, values)
    }

    fn slice<'v>(
        &self,
        whole: &'v [Value],
        first: usize,
        count: usize,
    ) -> Result<&'v [Value], Error> {
        let end = first.checked_add(count);
        let part = end.and_then(|end| whole.get(first..end));
        part.ok_or_else(|| self.b.invalid("a composite has fewer parts than its type"))
    }

    /// A component at a computed index.
    fn select_component(&mut self, vector: &[Value], index: Value) -> Result<Value, Error> {
        let Some((&first, rest)) = vector.split_first() else {
            return Err(self.b.invalid("a vector has no components"));
        };
        let ty = self.b.ty(index);
        let mut chosen = first;
        for (lane, &component) in rest.iter().enumerate() {
            let lane = self.b.constant(ty, lane as u64 + 1);
            let here = self.b.compare(ir::Op::IEq, index, lane)?;
            chosen = self.b.select(here, component, chosen)?;
        }
        Ok(chosen)
    }
}
