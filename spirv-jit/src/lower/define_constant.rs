//! Evaluates the instructions that define constants.

#![forbid(unsafe_code)]

use rspirv::spirv::{Decoration, Op, StorageClass};

use super::constants::{Constant, Constants, Contents, MAX_SCALARS, truncate};
use super::fold::fold_operation;
use super::types::{TypeKind, Types};
use crate::Error;
use crate::descriptor_heap::DESCRIPTOR_BYTES;
use crate::ir::Type;
use crate::parse::{Id, Instruction, ParsedModule, newer};

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
        let bits = |bits: Vec<u64>| Contents::Bits(bits.into());
        let contents = match instruction.opcode {
            // Zero is the address of a workgroup variable, so it cannot be null.
            Op::ConstantNull if is_of_workgroup(types.pointer(instruction.result_type)) => {
                bits(vec![u32::MAX.into()])
            }
            Op::ConstantNull | Op::Undef => Contents::Null,
            Op::ConstantTrue | Op::ConstantFalse => {
                bits(vec![(instruction.opcode == Op::ConstantTrue) as u64])
            }
            Op::SpecConstantTrue | Op::SpecConstantFalse => {
                let default = (instruction.opcode == Op::SpecConstantTrue) as u64;
                let given = specialized(module, specialization, instruction.result);
                bits(vec![given.map_or(default, |bits| (bits != 0) as u64)])
            }
            Op::Constant | Op::SpecConstant if is_data(module, instruction) => {
                bits(data(module, types, specialization, instruction)?)
            }
            Op::Constant | Op::SpecConstant => {
                let ty = types.scalar(instruction.result_type)?;
                let high = operands.get(1).copied().unwrap_or(0) as u64;
                let literal = operands[0] as u64 | high << 32;
                let given = match instruction.opcode {
                    Op::SpecConstant => specialized(module, specialization, instruction.result),
                    _ => None,
                };
                bits(vec![truncate(given.unwrap_or(literal), ty)])
            }
            Op::ConstantComposite
            | Op::SpecConstantComposite
            | Op::ConstantCompositeReplicateEXT
            | Op::SpecConstantCompositeReplicateEXT => {
                self.compose(types, instruction, operands)?
            }
            Op::ConstantSizeOfEXT => bits(vec![DESCRIPTOR_BYTES.into()]),
            Op::SpecConstantOp => bits(fold_operation(types, self, instruction, operands)?),
            _ => return Ok(false),
        };
        check(types, instruction, &contents)?;
        if let Contents::Bits(bits) = &contents {
            self.total += bits.len() as u64;
        }
        if self.total > MAX_SCALARS {
            return Err(super::budget(&format!(
                "the module's constants have more than {MAX_SCALARS} scalars"
            )));
        }
        let constant = Constant {
            ty: instruction.result_type,
            contents,
        };
        self.by_id.insert(instruction.result, constant);
        Ok(true)
    }

    fn compose(
        &self,
        types: &Types,
        instruction: &Instruction,
        operands: &[u32],
    ) -> Result<Contents, Error> {
        let kind = types.kind(instruction.result_type)?;
        let replicated = matches!(
            instruction.opcode,
            Op::ConstantCompositeReplicateEXT | Op::SpecConstantCompositeReplicateEXT
        ) || matches!(kind, TypeKind::CooperativeMatrix { .. });
        let count = types.element_count(instruction.result_type)?;
        let given = if replicated { 1 } else { count as usize };
        let Some(parts) = operands.get(..given) else {
            let at = instruction.offset;
            return Err(Error::invalid(at, "a composite lacks constituents"));
        };
        let checked = if replicated { count.min(1) } else { count };
        for index in 0..checked {
            let element = types.element(instruction.result_type, Some(index))?;
            let given = self.find(parts[index as usize]);
            let given = given.map_or(0, |constant| constant.ty);
            if element != given && types.leaves_of_any(element)? != types.leaves_of_any(given)? {
                let at = instruction.offset;
                return Err(Error::invalid(at, "a constituent has the wrong type"));
            }
        }
        let times = if replicated { count } else { 1 };
        Ok(Contents::Composite(parts.into(), times))
    }
}

/// The constant must fit its type.
fn check(types: &Types, instruction: &Instruction, contents: &Contents) -> Result<(), Error> {
    let info = types.info(instruction.result_type)?;
    let is_null = matches!(contents, Contents::Null);
    let wrong = match (&info.kind, instruction.opcode) {
        (TypeKind::Void | TypeKind::Function { .. } | TypeKind::RuntimeArray { .. }, _) => true,
        (TypeKind::Scalar { ty, .. }, opcode) => match opcode {
            Op::Constant | Op::SpecConstant => *ty == Type::I1,
            Op::ConstantTrue | Op::ConstantFalse | Op::SpecConstantTrue | Op::SpecConstantFalse => {
                *ty != Type::I1
            }
            _ => false,
        },
        // Only the null constant is allowed, which is the null descriptor.
        _ => info.is_opaque && !is_null,
    };
    let count = match contents {
        Contents::Bits(bits) => bits.len() as u64,
        Contents::Null | Contents::Composite(..) => info.leaf_count,
    };
    if wrong || count != info.leaf_count {
        let at = instruction.offset;
        return Err(Error::invalid(at, "the constant does not fit its type"));
    }
    Ok(())
}

/// The value that the pipeline gives to a specialization constant.
fn specialized(module: &ParsedModule, given: &[(u32, &[u8])], id: Id) -> Option<u64> {
    specialized_bytes(module, given, id).map(padded)
}

fn specialized_bytes<'a>(
    module: &ParsedModule,
    given: &[(u32, &'a [u8])],
    id: Id,
) -> Option<&'a [u8]> {
    let spec_id = module.annotations.id(id, Decoration::SpecId)?;
    Some(given.iter().find(|entry| entry.0 == spec_id)?.1)
}

/// A number of up to 8 bytes, the lowest first.
fn padded(bytes: &[u8]) -> u64 {
    let mut padded = [0u8; 8];
    let count = bytes.len().min(8);
    padded[..count].copy_from_slice(&bytes[..count]);
    u64::from_le_bytes(padded)
}

fn is_data(module: &ParsedModule, instruction: &Instruction) -> bool {
    let opcode = module.written_opcode(instruction);
    matches!(opcode, newer::CONSTANT_DATA | newer::SPEC_CONSTANT_DATA)
}

/// The integers of `OpConstantDataKHR` and `OpSpecConstantDataKHR`, packed in words or in the
/// pipeline's data.
fn data(
    module: &ParsedModule,
    types: &Types,
    specialization: &[(u32, &[u8])],
    instruction: &Instruction,
) -> Result<Vec<u64>, Error> {
    let wrong = |message: &str| Error::invalid(instruction.offset, message);
    let &TypeKind::Array { element, count } = types.kind(instruction.result_type)? else {
        return Err(wrong("the type of constant data is no array"));
    };
    let width = match types.kind(element)? {
        TypeKind::Scalar {
            ty: Type::I8 | Type::I16 | Type::I32 | Type::I64,
            is_bfloat16: false,
            ..
        } => types.scalar(element)?.size_bytes() as usize,
        _ => return Err(wrong("the elements of constant data are no integers")),
    };
    let size = count as usize * width;
    let given = match instruction.opcode {
        Op::SpecConstant => specialized_bytes(module, specialization, instruction.result),
        _ => None,
    };
    let words: Vec<u8>;
    let bytes = match given {
        Some(bytes) if bytes.len() == size => bytes,
        Some(_) => return Err(wrong("the given data do not fit the length of the array")),
        None => {
            let operands = module.operands(instruction);
            if operands.len() != size.div_ceil(4) {
                return Err(wrong("the data do not fit the length of the array"));
            }
            words = operands
                .iter()
                .flat_map(|word| word.to_le_bytes())
                .collect();
            &words[..size]
        }
    };
    Ok(bytes.chunks_exact(width).map(padded).collect())
}
