//! Uniform values: constants into rows of their own, the rest into code that runs before a wave
//! goes on.

use lanes::AlignedRow;

use super::Emitter;
use crate::Error;
use crate::interp::operand::Operand;
use crate::interp::tier::Portable;
use crate::interp::{tier::Tier, yields};
use crate::ir::{Inst, Op, Type};

impl Emitter<'_> {
    /// Emits the prologue.
    pub(super) fn emit_prologue(&mut self) -> Result<(), Error> {
        let mut computed: Vec<(usize, &Inst)> = Vec::new();
        for &f in &self.planned.order {
            let uniform = &self.planned.function(f).uniform;
            let mut insts = Vec::new();
            self.module.functions[f].body.visit_insts(&mut |inst| {
                if inst.results.first().is_some_and(|r| uniform[r.index()]) {
                    insts.push(inst);
                }
            });
            for inst in insts {
                if !self.place_constant(f, inst)? {
                    computed.push((f, inst));
                }
            }
        }
        self.code.uniform_rows = self.code.constants.len();
        for &(f, inst) in &computed {
            for result in &inst.results {
                let ty = self.module.functions[f].ty(*result);
                let row = self.code.uniform_rows;
                self.code.uniform_rows += ty.rows() as usize;
                self.operands[f][result.index()] = Operand::uniform(row);
            }
        }
        for (f, inst) in computed {
            self.function = f;
            self.emit_operation(inst)?;
        }
        self.code.prologue_end = self.code.instrs.len();
        self.emit_plain(self.kernel::<yields::Resume>());
        Ok(())
    }

    /// Gives a constant its row; false for other instructions.
    fn place_constant(&mut self, f: usize, inst: &Inst) -> Result<bool, Error> {
        let bits = match inst.op {
            Op::Const(bits) => bits,
            Op::VarAddress(variable) => self.variable_row(f, variable, inst.source)? as u64,
            _ => return Ok(false),
        };
        let result = inst.results[0];
        let ty = self.module.functions[f].ty(result);
        let bits = match ty {
            Type::I1 if bits & 1 != 0 => u32::MAX as u64,
            Type::I1 => 0,
            ty if ty.bits() == 64 => bits,
            ty => bits & ((1 << ty.bits()) - 1),
        };
        let wide = ty.rows() == 2;
        let constants = &mut self.code.constants;
        let operand = *self.constants.entry((bits, wide)).or_insert_with(|| {
            let row = constants.len();
            if wide {
                // Lanes of 64 bits: eight to a row of 64 bytes.
                let words = std::array::from_fn(|k| (bits >> (32 * (k % 2))) as u32);
                constants.extend([AlignedRow(words); 2]);
            } else {
                constants.push(AlignedRow([bits as u32; 16]));
            }
            Operand::uniform(row)
        });
        self.operands[f][result.index()] = operand;
        Ok(true)
    }

    /// An instruction without operands.
    pub(super) fn emit_plain(&mut self, handler: crate::interp::machine::Handler) {
        self.push(super::instr(handler));
    }

    /// As [`Self::kernel`], for kernels that gain nothing from a tier.
    pub(super) fn portable<K: crate::interp::tier::Kernel>(
        &self,
    ) -> crate::interp::machine::Handler {
        Portable::handler::<K>()
    }
}
