//! Flushing of denormals: the execution mode `DenormFlushToZero` of 32-bit floats.
//!
//! Vulkan ("Precision and Operation of SPIR-V Instructions") lists the instructions whose results
//! must not be denormal. Their operands and intermediate results may be, so one flush of each
//! result is enough. Loads, stores, selections, bit casts and other moves of bits do not flush.

use rspirv::spirv::{ExecutionMode, Op};

use super::Lowerer;
use super::values::Scalars;
use crate::Error;
use crate::ir::{self, Type, Value};

/// Whether an instruction computes floats, rather than moving them.
fn computes_floats(opcode: Op) -> bool {
    matches!(
        opcode,
        Op::FConvert
            | Op::FNegate
            | Op::FAdd
            | Op::FSub
            | Op::FMul
            | Op::FDiv
            | Op::FRem
            | Op::FMod
            | Op::FmaKHR
            | Op::VectorTimesScalar
            | Op::MatrixTimesScalar
            | Op::VectorTimesMatrix
            | Op::MatrixTimesVector
            | Op::MatrixTimesMatrix
            | Op::OuterProduct
            | Op::Dot
            | Op::CooperativeMatrixMulAddKHR
            | Op::CooperativeVectorMatrixMulNV
            | Op::CooperativeVectorMatrixMulAddNV
            | Op::GroupNonUniformFAdd
            | Op::GroupNonUniformFMul
            | Op::GroupNonUniformFMin
            | Op::GroupNonUniformFMax
            | Op::AtomicFAddEXT
            | Op::AtomicFMinEXT
            | Op::AtomicFMaxEXT
            | Op::DPdx
            | Op::DPdy
            | Op::Fwidth
            | Op::DPdxFine
            | Op::DPdyFine
            | Op::FwidthFine
            | Op::DPdxCoarse
            | Op::DPdyCoarse
            | Op::FwidthCoarse
            | Op::ExtInst
            | Op::ExtInstWithForwardRefsKHR
    )
}

/// The bits of a 32-bit float, zero of the same sign for a denormal.
pub(super) fn flushed(bits: u32) -> u32 {
    crate::eval::fflush_denormal(f32::from_bits(bits)).to_bits()
}

impl Lowerer<'_> {
    /// Whether the entry point asks for 32-bit denormals to be flushed.
    pub(super) fn has_flush_mode(&self) -> bool {
        let mut modes = self.execution_modes();
        modes.any(|(mode, operands)| {
            mode == ExecutionMode::DenormFlushToZero && operands.first() == Some(&32)
        })
    }

    /// Whether an instruction's result must not be denormal.
    pub(super) fn is_flushed(&self, opcode: Op) -> bool {
        self.constants.flushes_denormals && computes_floats(opcode)
    }

    /// The scalars of a result, those of 32-bit floats flushed.
    pub(super) fn flush_denormals(&mut self, values: &[Value]) -> Result<Scalars, Error> {
        let flushed = values.iter().map(|&value| match self.b.ty(value) {
            Type::F32 => self.b.unary(ir::Op::FFlushDenormal, value),
            _ => Ok(value),
        });
        flushed.collect()
    }
}
