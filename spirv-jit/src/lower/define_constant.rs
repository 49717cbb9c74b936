//! Evaluates the instructions that define constants.

#![forbid(unsafe_code)]

use std::rc::Rc;

use rspirv::spirv::{Decoration, Op, StorageClass};

use super::constants::{Constant, Constants, truncate};
use super::fold::fold_operation;
use super::types::{MAX_LEAVES, TypeKind, Types};
use crate::Error;
use crate::ir::Type;
use crate::parse::{Id, Instruction, ParsedModule};

fn is_of_workgroup(pointer: Result<(StorageClass, Id), Error>) -> bool {
    matches!(pointer, Ok((StorageClass::Workgroup, _)))
}

impl Constants {
    /// Evaluates the constant that an instruction defines; false if the instruction defines none.
    pub fn define(
        &mut self,
        module: &ParsedModule,
        types: &Types,
        specialization: &[(u32, &[u8])],
        instruction: &Instruction,
    ) -> Result<bool, Error> {
        let operands = module.operands(instruction);
        let bits = match instruction.opcode {
            // Zero is where a variable of the workgroup lies.
            Op::ConstantNull if is_of_workgroup(types.pointer(instruction.result_type)) => {
                Some(vec![u32::MAX.into()])
            }
            Op::ConstantNull | Op::Undef => None,
            Op::ConstantTrue | Op::ConstantFalse => {
                Some(vec![(instruction.opcode == Op::ConstantTrue) as u64])
            }
            Op::SpecConstantTrue | Op::SpecConstantFalse => {
                let default = (instruction.opcode == Op::SpecConstantTrue) as u64;
                let given = specialized(module, specialization, instruction.result);
                Some(vec![given.map_or(default, |bits| (bits != 0) as u64)])
            }
            Op::Constant | Op::SpecConstant => {
                let ty = types.scalar(instruction.result_type)?;
                let high = operands.get(1).copied().unwrap_or(0) as u64;
                let literal = operands[0] as u64 | high << 32;
                let given = match instruction.opcode {
                    Op::SpecConstant => specialized(module, specialization, instruction.result),
                    _ => None,
                };
                Some(vec![truncate(given.unwrap_or(literal), ty)])
            }
            Op::ConstantComposite
            | Op::SpecConstantComposite
            | Op::ConstantCompositeReplicateEXT
            | Op::SpecConstantCompositeReplicateEXT => {
                Some(self.compose(types, instruction, operands)?)
            }
            Op::SpecConstantOp => Some(fold_operation(types, self, instruction, operands)?),
            _ => return Ok(false),
        };
        self.check(types, instruction, bits.as_deref())?;
        let constant = Constant {
            ty: instruction.result_type,
            bits: bits.map(Rc::from),
        };
        self.by_id.insert(instruction.result, constant);
        Ok(true)
    }

    fn check(
        &mut self,
        types: &Types,
        instruction: &Instruction,
        bits: Option<&[u64]>,
    ) -> Result<(), Error> {
        let info = types.info(instruction.result_type)?;
        let wrong = match (&info.kind, instruction.opcode) {
            (TypeKind::Void | TypeKind::Function { .. } | TypeKind::RuntimeArray { .. }, _) => true,
            (TypeKind::Scalar { ty, .. }, opcode) => match opcode {
                Op::Constant | Op::SpecConstant => *ty == Type::I1,
                Op::ConstantTrue
                | Op::ConstantFalse
                | Op::SpecConstantTrue
                | Op::SpecConstantFalse => *ty != Type::I1,
                _ => false,
            },
            // Only the null constant, which is the null descriptor.
            _ => info.is_opaque && bits.is_some(),
        };
        let count = bits.map_or(info.leaf_count, |bits| bits.len() as u64);
        if wrong || count != info.leaf_count {
            let at = instruction.offset;
            return Err(Error::invalid(at, "the constant does not fit its type"));
        }
        self.total += bits.map_or(0, |bits| bits.len() as u64);
        if self.total > 64 * MAX_LEAVES {
            return Err(super::budget("the module's constants are too large"));
        }
        Ok(())
    }

    fn compose(
        &self,
        types: &Types,
        instruction: &Instruction,
        operands: &[u32],
    ) -> Result<Vec<u64>, Error> {
        let leaf_count = types.info(instruction.result_type)?.leaf_count;
        if leaf_count > MAX_LEAVES {
            return Err(super::budget("a constant is too large"));
        }
        let replicated = matches!(
            instruction.opcode,
            Op::ConstantCompositeReplicateEXT | Op::SpecConstantCompositeReplicateEXT
        );
        let mut bits = Vec::with_capacity(leaf_count as usize);
        let count = types.element_count(instruction.result_type)?;
        for index in 0..count {
            let operand = operands.get(if replicated { 0 } else { index as usize });
            let Some(&operand) = operand else {
                let at = instruction.offset;
                return Err(Error::invalid(at, "a composite lacks constituents"));
            };
            let part = self.bits(types, operand)?;
            let element = types.element(instruction.result_type, Some(index))?;
            let given = self.find(operand).map_or(0, |constant| constant.ty);
            if types.leaves(element)? != types.leaves(given)? {
                let at = instruction.offset;
                return Err(Error::invalid(at, "a constituent has the wrong type"));
            }
            bits.extend_from_slice(&part);
        }
        Ok(bits)
    }
}

/// The value that the pipeline gives to a specialization constant.
fn specialized(module: &ParsedModule, given: &[(u32, &[u8])], id: Id) -> Option<u64> {
    let spec_id = module.annotations.id(id, Decoration::SpecId)?;
    let bytes = given.iter().find(|entry| entry.0 == spec_id)?.1;
    let mut padded = [0u8; 8];
    let count = bytes.len().min(8);
    padded[..count].copy_from_slice(&bytes[..count]);
    Some(u64::from_le_bytes(padded))
}
