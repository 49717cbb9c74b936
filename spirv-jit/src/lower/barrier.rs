//! Barriers, whole and split (`SPV_EXT_split_barrier`), and clocks.

use rspirv::spirv::{Op, Scope};

use super::Lowerer;
use crate::Error;
use crate::ir::stage::Stage;
use crate::ir::{self, Type};
use crate::parse::Instruction;

impl Lowerer<'_> {
    pub(super) fn lower_barrier(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        match instruction.opcode {
            Op::ControlBarrier => {
                let scope = self.constants.unsigned(&self.types, operands[0])?;
                if scope != Scope::Subgroup as u32 && self.is_control() {
                    return self.control_barrier();
                }
                self.b.emit_effect(ir::Op::MemoryBarrier, &[])?;
                // The lanes of a subgroup run together, so there is nothing to wait for.
                if scope != Scope::Subgroup as u32 && self.request.stage.has_workgroups() {
                    self.b.emit_effect(ir::Op::Barrier, &[])?;
                }
                Ok(())
            }
            Op::ControlBarrierArriveINTEL => self.half_barrier(operands, ir::Op::BarrierArrive),
            Op::ControlBarrierWaitINTEL => self.half_barrier(operands, ir::Op::BarrierWait),
            Op::ReadClockKHR => {
                let time = self.b.emit(ir::Op::ReadClock, &[], Type::I64)?;
                let values = match self.types.leaves(instruction.result_type)?.len() {
                    1 => vec![time],
                    _ => self.b.unpack64(time)?.to_vec(),
                };
                self.define_typed(instruction, values)
            }
            _ => self.b.emit_effect(ir::Op::MemoryBarrier, &[]),
        }
    }

    /// `OpControlBarrierArriveEXT` and `OpControlBarrierWaitEXT`, which only compute shaders may
    /// use.
    fn half_barrier(&mut self, operands: &[u32], half: ir::Op) -> Result<(), Error> {
        let scope = self.constants.unsigned(&self.types, operands[0])?;
        self.b.emit_effect(ir::Op::MemoryBarrier, &[])?;
        if scope == Scope::Subgroup as u32 {
            return Ok(());
        }
        if self.request.stage != Stage::Compute {
            return Err(self.b.invalid("split barriers are for compute shaders"));
        }
        self.b.emit_effect(half, &[])
    }
}
