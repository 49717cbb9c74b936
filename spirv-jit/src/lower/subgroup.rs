//! Subgroup instructions. A subgroup has 16 lanes, so a ballot is its first word.

use rspirv::spirv::{GroupOperation, Op};

use super::Lowerer;
use crate::Error;
use crate::ir::op::{ReduceOp, SubgroupOp};
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction};

const LANES: u32 = crate::SUBGROUP_SIZE as u32;

/// Whether an opcode is one of this file's.
pub(super) fn is_subgroup(opcode: Op) -> bool {
    let number = opcode as u32;
    let non_uniform =
        (Op::GroupNonUniformElect as u32..=Op::GroupNonUniformQuadSwap as u32).contains(&number);
    non_uniform
        || matches!(
            opcode,
            Op::GroupNonUniformRotateKHR
                | Op::GroupNonUniformPartitionEXT
                | Op::GroupNonUniformQuadAllKHR
                | Op::GroupNonUniformQuadAnyKHR
                | Op::SubgroupBallotKHR
                | Op::SubgroupFirstInvocationKHR
                | Op::SubgroupAllKHR
                | Op::SubgroupAnyKHR
                | Op::SubgroupAllEqualKHR
                | Op::SubgroupReadInvocationKHR
        )
}

fn reduction(opcode: Op) -> Option<ReduceOp> {
    Some(match opcode {
        Op::GroupNonUniformIAdd => ReduceOp::IAdd,
        Op::GroupNonUniformFAdd => ReduceOp::FAdd,
        Op::GroupNonUniformIMul => ReduceOp::IMul,
        Op::GroupNonUniformFMul => ReduceOp::FMul,
        Op::GroupNonUniformSMin => ReduceOp::SMin,
        Op::GroupNonUniformUMin => ReduceOp::UMin,
        Op::GroupNonUniformFMin => ReduceOp::FMin,
        Op::GroupNonUniformSMax => ReduceOp::SMax,
        Op::GroupNonUniformUMax => ReduceOp::UMax,
        Op::GroupNonUniformFMax => ReduceOp::FMax,
        Op::GroupNonUniformBitwiseAnd | Op::GroupNonUniformLogicalAnd => ReduceOp::And,
        Op::GroupNonUniformBitwiseOr | Op::GroupNonUniformLogicalOr => ReduceOp::Or,
        Op::GroupNonUniformBitwiseXor | Op::GroupNonUniformLogicalXor => ReduceOp::Xor,
        _ => return None,
    })
}

/// Whether the first operand is a scope, as in core instructions: always the subgroup.
fn has_scope(opcode: Op) -> bool {
    !matches!(
        opcode,
        Op::SubgroupBallotKHR
            | Op::SubgroupFirstInvocationKHR
            | Op::SubgroupAllKHR
            | Op::SubgroupAnyKHR
            | Op::SubgroupAllEqualKHR
            | Op::SubgroupReadInvocationKHR
            | Op::GroupNonUniformPartitionEXT
            | Op::GroupNonUniformQuadAllKHR
            | Op::GroupNonUniformQuadAnyKHR
    )
}

impl Lowerer<'_> {
    pub(super) fn lower_subgroup(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        if let Some(op) = reduction(instruction.opcode) {
            return self.lower_reduction(instruction, op, operands);
        }
        let operands = &operands[has_scope(instruction.opcode) as usize..];
        let values = match instruction.opcode {
            Op::GroupNonUniformElect => vec![self.across(SubgroupOp::Elect, &[], Type::I1)?],
            Op::GroupNonUniformAll | Op::SubgroupAllKHR => {
                let condition = self.bool_scalar(operands[0])?;
                vec![self.across(SubgroupOp::All, &[condition], Type::I1)?]
            }
            Op::GroupNonUniformAny | Op::SubgroupAnyKHR => {
                let condition = self.bool_scalar(operands[0])?;
                vec![self.across(SubgroupOp::Any, &[condition], Type::I1)?]
            }
            Op::GroupNonUniformQuadAllKHR => {
                let condition = self.bool_scalar(operands[0])?;
                vec![self.across_quad(ir::Op::And, condition)?]
            }
            Op::GroupNonUniformQuadAnyKHR => {
                let condition = self.bool_scalar(operands[0])?;
                vec![self.across_quad(ir::Op::Or, condition)?]
            }
            Op::GroupNonUniformAllEqual | Op::SubgroupAllEqualKHR => {
                let all = self.b.bool(true);
                vec![self.all_parts(operands[0], SubgroupOp::AllEqual, all)?]
            }
            Op::GroupNonUniformBroadcastFirst | Op::SubgroupFirstInvocationKHR => {
                self.per_part(operands[0], |lowerer, part| {
                    let ty = lowerer.b.ty(part);
                    lowerer.across(SubgroupOp::BroadcastFirst, &[part], ty)
                })?
            }
            Op::GroupNonUniformBallot | Op::SubgroupBallotKHR => {
                let condition = self.bool_scalar(operands[0])?;
                let word = self.across(SubgroupOp::Ballot, &[condition], Type::I32)?;
                let zero = self.b.i32(0);
                vec![word, zero, zero, zero]
            }
            Op::GroupNonUniformPartitionEXT => {
                let all = self.b.i32((1 << LANES) - 1);
                let word = self.all_parts(operands[0], SubgroupOp::Match, all)?;
                let zero = self.b.i32(0);
                vec![word, zero, zero, zero]
            }
            Op::GroupNonUniformInverseBallot => {
                let lane = self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?;
                let word = self.ballot_word(operands[0])?;
                vec![self.test_bit(word, lane)?]
            }
            Op::GroupNonUniformBallotBitExtract => {
                let index = self.scalar(operands[1])?;
                let index = self.b.i32_of(index, false)?;
                let word = self.ballot_word(operands[0])?;
                let set = self.test_bit(word, index)?;
                let lanes = self.b.i32(32);
                let inside = self.b.compare(ir::Op::ULt, index, lanes)?;
                vec![self.b.binary(ir::Op::And, set, inside)?]
            }
            Op::GroupNonUniformBallotBitCount => {
                vec![self.count_ballot(operands[0], operands[1])?]
            }
            Op::GroupNonUniformBallotFindLSB => {
                let word = self.ballot_of_lanes(operands[0])?;
                vec![self.b.unary(ir::Op::FindLsb, word)?]
            }
            Op::GroupNonUniformBallotFindMSB => {
                let word = self.ballot_of_lanes(operands[0])?;
                vec![self.b.unary(ir::Op::FindUMsb, word)?]
            }
            _ => return self.lower_shuffle(instruction, operands),
        };
        self.define_typed(instruction, values)
    }

    /// The conjunction of an operation's results for the scalars of a value. `all` is the result
    /// for none.
    fn all_parts(&mut self, value: u32, op: SubgroupOp, all: Value) -> Result<Value, Error> {
        let mut result = all;
        for &part in self.leaves(value)?.iter() {
            let part = self.lane_word(part)?;
            let of_part = self.across(op, &[part], self.b.ty(all))?;
            result = self.b.binary(ir::Op::And, result, of_part)?;
        }
        Ok(result)
    }

    fn across(&mut self, op: SubgroupOp, args: &[Value], result: Type) -> Result<Value, Error> {
        Ok(self
            .b
            .emit_unchecked(ir::Op::Subgroup(op), args, &[result])?[0])
    }

    /// A condition combined over the active lanes of the quad.
    fn across_quad(&mut self, op: ir::Op, condition: Value) -> Result<Value, Error> {
        let lane = self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?;
        let own = self.bool_to_word(condition)?;
        let mut word = own;
        for flip in 1..4 {
            let flip = self.b.i32(flip);
            let other = self.b.binary(ir::Op::Xor, lane, flip)?;
            let other = self.across(SubgroupOp::QuadShuffle, &[own, other], Type::I32)?;
            word = self.b.binary(op, word, other)?;
        }
        self.word_to_bool(word)
    }

    /// Booleans cross lanes as words.
    fn lane_word(&mut self, value: Value) -> Result<Value, Error> {
        match self.b.ty(value) {
            Type::I1 => self.bool_to_word(value),
            _ => Ok(value),
        }
    }

    /// Applies an operation to each scalar of a value.
    fn per_part(
        &mut self,
        id: Id,
        mut apply: impl FnMut(&mut Self, Value) -> Result<Value, Error>,
    ) -> Result<Vec<Value>, Error> {
        let parts = self.leaves(id)?;
        let mut values = Vec::with_capacity(parts.len());
        for &part in parts.iter() {
            let word = self.lane_word(part)?;
            let result = apply(self, word)?;
            let was_bool = self.b.ty(part) == Type::I1;
            values.push(if was_bool {
                self.word_to_bool(result)?
            } else {
                result
            });
        }
        Ok(values)
    }

    fn ballot_word(&mut self, id: Id) -> Result<Value, Error> {
        let first = self.leaves(id)?.first().copied();
        match first {
            Some(word) if self.b.ty(word) == Type::I32 => Ok(word),
            _ => Err(self.b.invalid("a ballot is four 32-bit words")),
        }
    }

    /// The bits of a ballot that belong to the subgroup. Searches and counts ignore all others.
    fn ballot_of_lanes(&mut self, id: Id) -> Result<Value, Error> {
        let word = self.ballot_word(id)?;
        let lanes = self.b.i32((1 << LANES) - 1);
        self.b.binary(ir::Op::And, word, lanes)
    }

    fn test_bit(&mut self, word: Value, index: Value) -> Result<Value, Error> {
        let shifted = self.b.binary(ir::Op::LShr, word, index)?;
        let one = self.b.i32(1);
        let bit = self.b.binary(ir::Op::And, shifted, one)?;
        self.word_to_bool(bit)
    }

    fn count_ballot(&mut self, operation: u32, id: Id) -> Result<Value, Error> {
        let word = self.ballot_word(id)?;
        let lane = self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?;
        let one = self.b.i32(1);
        let here = self.b.binary(ir::Op::Shl, one, lane)?;
        let below = self.b.binary(ir::Op::ISub, here, one)?;
        let mask = match GroupOperation::from_u32(operation) {
            Some(GroupOperation::InclusiveScan) => self.b.binary(ir::Op::Or, below, here)?,
            Some(GroupOperation::ExclusiveScan) => below,
            _ => self.b.i32((1 << LANES) - 1),
        };
        let counted = self.b.binary(ir::Op::And, word, mask)?;
        self.b.unary(ir::Op::BitCount, counted)
    }

    fn lower_reduction(
        &mut self,
        instruction: &Instruction,
        op: ReduceOp,
        operands: &[u32],
    ) -> Result<(), Error> {
        let is_float = matches!(
            op,
            ReduceOp::FAdd | ReduceOp::FMul | ReduceOp::FMin | ReduceOp::FMax
        );
        let operation = GroupOperation::from_u32(operands[1]);
        let op = match operation {
            Some(GroupOperation::Reduce) => SubgroupOp::Reduce {
                op,
                cluster: LANES as u8,
            },
            Some(GroupOperation::InclusiveScan) => SubgroupOp::InclusiveScan(op),
            Some(GroupOperation::ExclusiveScan) => SubgroupOp::ExclusiveScan(op),
            Some(GroupOperation::ClusteredReduce) => {
                let Some(&size) = operands.get(3) else {
                    return Err(self.b.invalid("a clustered reduction lacks its size"));
                };
                let cluster = self.constants.unsigned(&self.types, size)?;
                if !cluster.is_power_of_two() {
                    return Err(self.b.invalid("a cluster's size is a power of two"));
                }
                SubgroupOp::Reduce {
                    op,
                    cluster: cluster.min(LANES) as u8,
                }
            }
            Some(GroupOperation::PartitionedReduceEXT) => SubgroupOp::PartitionedReduce(op),
            Some(GroupOperation::PartitionedInclusiveScanEXT) => {
                SubgroupOp::PartitionedInclusiveScan(op)
            }
            Some(GroupOperation::PartitionedExclusiveScanEXT) => {
                SubgroupOp::PartitionedExclusiveScan(op)
            }
            _ => return Err(self.unsupported(instruction)),
        };
        let partition = match (op, operands.get(3)) {
            (
                SubgroupOp::PartitionedReduce(_)
                | SubgroupOp::PartitionedInclusiveScan(_)
                | SubgroupOp::PartitionedExclusiveScan(_),
                Some(&ballot),
            ) => Some(self.ballot_word(ballot)?),
            (SubgroupOp::PartitionedReduce(_), None)
            | (SubgroupOp::PartitionedInclusiveScan(_), None)
            | (SubgroupOp::PartitionedExclusiveScan(_), None) => {
                return Err(self
                    .b
                    .invalid("a partitioned reduction lacks its partition"));
            }
            _ => None,
        };
        let logical_and = matches!(instruction.opcode, Op::GroupNonUniformLogicalAnd);
        let values = self.per_part(operands[2], |lowerer, part| {
            let ty = lowerer.b.ty(part);
            if ty.is_float() != is_float {
                return Err(lowerer.b.invalid("a reduction has the wrong type"));
            }
            let mut args = vec![part];
            args.extend(partition);
            let result = lowerer.across(op, &args, ty)?;
            // The identity of a logical and is 1, not all ones.
            if logical_and {
                let one = lowerer.b.constant(ty, 1);
                return lowerer.b.binary(ir::Op::And, result, one);
            }
            Ok(result)
        })?;
        self.define_typed(instruction, values)
    }

    /// Instructions that read the value of a computed lane.
    fn lower_shuffle(&mut self, instruction: &Instruction, operands: &[Id]) -> Result<(), Error> {
        let lane = self.b.emit(ir::Op::LaneIndex, &[], Type::I32)?;
        let argument = self.scalar(operands[1])?;
        let argument = self.b.i32_of(argument, false)?;
        let source = match instruction.opcode {
            Op::GroupNonUniformBroadcast
            | Op::GroupNonUniformShuffle
            | Op::SubgroupReadInvocationKHR => argument,
            Op::GroupNonUniformShuffleXor => self.b.binary(ir::Op::Xor, lane, argument)?,
            Op::GroupNonUniformShuffleUp => self.b.binary(ir::Op::ISub, lane, argument)?,
            Op::GroupNonUniformShuffleDown => self.b.binary(ir::Op::IAdd, lane, argument)?,
            Op::GroupNonUniformQuadBroadcast => {
                let (base, within) = (self.b.i32(!3), self.b.i32(3));
                let base = self.b.binary(ir::Op::And, lane, base)?;
                let within = self.b.binary(ir::Op::And, argument, within)?;
                self.b.binary(ir::Op::Or, base, within)?
            }
            Op::GroupNonUniformQuadSwap => {
                // Horizontal, vertical, diagonal: 1, 2, 3.
                let one = self.b.i32(1);
                let flip = self.b.binary(ir::Op::IAdd, argument, one)?;
                self.b.binary(ir::Op::Xor, lane, flip)?
            }
            Op::GroupNonUniformRotateKHR => {
                let cluster = match operands.get(2) {
                    Some(&id) => self.constants.unsigned(&self.types, id)?.clamp(1, LANES),
                    None => LANES,
                };
                let (base, within) = (self.b.i32(!(cluster - 1)), self.b.i32(cluster - 1));
                let moved = self.b.binary(ir::Op::IAdd, lane, argument)?;
                let moved = self.b.binary(ir::Op::And, moved, within)?;
                let base = self.b.binary(ir::Op::And, lane, base)?;
                self.b.binary(ir::Op::Or, base, moved)?
            }
            _ => return Err(self.unsupported(instruction)),
        };
        let op = match instruction.opcode {
            Op::GroupNonUniformQuadBroadcast | Op::GroupNonUniformQuadSwap => {
                SubgroupOp::QuadShuffle
            }
            _ => SubgroupOp::Shuffle,
        };
        let values = self.per_part(operands[0], |lowerer, part| {
            let ty = lowerer.b.ty(part);
            lowerer.across(op, &[part, source], ty)
        })?;
        self.define_typed(instruction, values)
    }
}
