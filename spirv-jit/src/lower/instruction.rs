//! The table of instructions: the group that lowers each opcode.

use rspirv::spirv::Op;

use super::Lowerer;
use super::types::TypeKind;
use crate::Error;
use crate::ir;
use crate::ir::stage::Stage;
use crate::parse::{Instruction, opcode_name};

impl Lowerer<'_> {
    /// Lowers an instruction that is neither a phi nor a terminator.
    pub(super) fn lower_instruction(&mut self, instruction: &Instruction) -> Result<(), Error> {
        self.check_opaque_result(instruction)?;
        if self.lower_large(instruction)? {
            return Ok(());
        }
        match instruction.opcode {
            Op::Variable | Op::Load | Op::Store | Op::CopyMemory | Op::CopyMemorySized => {
                self.lower_memory(instruction)
            }
            Op::AccessChain
            | Op::InBoundsAccessChain
            | Op::PtrAccessChain
            | Op::InBoundsPtrAccessChain
            | Op::UntypedAccessChainKHR
            | Op::UntypedInBoundsAccessChainKHR
            | Op::UntypedPtrAccessChainKHR
            | Op::UntypedInBoundsPtrAccessChainKHR => self.lower_access_chain(instruction),
            Op::CooperativeMatrixLoadKHR
            | Op::CooperativeMatrixStoreKHR
            | Op::CooperativeMatrixMulAddKHR
            | Op::CooperativeMatrixLengthKHR => self.lower_cooperative_matrix(instruction),
            Op::CooperativeVectorLoadNV
            | Op::CooperativeVectorStoreNV
            | Op::CooperativeVectorMatrixMulNV
            | Op::CooperativeVectorMatrixMulAddNV => self.lower_cooperative_vector(instruction),
            Op::BufferPointerEXT => self.lower_buffer_pointer(instruction),
            Op::ArrayLength | Op::UntypedArrayLengthKHR => self.lower_array_length(instruction),
            Op::CopyObject | Op::ExpectKHR => {
                let value = self.value(self.module.operands(instruction)[0])?;
                self.define(instruction.result, value)
            }
            Op::CopyLogical => {
                let values = self.leaves(self.module.operands(instruction)[0])?;
                self.define_typed(instruction, values.to_vec())
            }
            Op::Undef => self.lower_undef(instruction),
            Op::ExtInst | Op::ExtInstWithForwardRefsKHR => self.lower_extended(instruction),
            Op::AssumeTrueKHR => Ok(()),
            // Invocations that the interlock must separate are never in the same wave
            // (`FragmentFacts::interlock`).
            Op::BeginInvocationInterlockEXT | Op::EndInvocationInterlockEXT => {
                self.b.emit_effect(ir::Op::MemoryBarrier, &[])
            }
            Op::EmitVertex | Op::EndPrimitive | Op::EmitStreamVertex | Op::EndStreamPrimitive => {
                self.lower_emission(instruction)
            }
            Op::SetMeshOutputsEXT => self.lower_set_mesh_outputs(instruction),
            Op::DemoteToHelperInvocation => match self.request.stage {
                Stage::Fragment => self.b.emit_effect(ir::Op::Demote, &[]),
                _ => Ok(()),
            },
            Op::IsHelperInvocationEXT => {
                let helper = self.b.emit(ir::Op::IsHelper, &[], ir::Type::I1)?;
                self.define_typed(instruction, [helper])
            }

            Op::CompositeConstruct
            | Op::CompositeConstructReplicateEXT
            | Op::CompositeExtract
            | Op::CompositeInsert
            | Op::VectorShuffle
            | Op::VectorExtractDynamic
            | Op::VectorInsertDynamic => self.lower_composite(instruction),

            Op::MatrixTimesScalar
            | Op::VectorTimesScalar
            | Op::VectorTimesMatrix
            | Op::MatrixTimesVector
            | Op::MatrixTimesMatrix
            | Op::OuterProduct
            | Op::Transpose
            | Op::Dot => self.lower_matrix(instruction),

            Op::SDot | Op::UDot | Op::SUDot | Op::SDotAccSat | Op::UDotAccSat | Op::SUDotAccSat => {
                self.lower_integer_dot(instruction)
            }

            Op::ConvertFToU
            | Op::ConvertFToS
            | Op::ConvertSToF
            | Op::ConvertUToF
            | Op::UConvert
            | Op::SConvert
            | Op::FConvert
            | Op::QuantizeToF16
            | Op::Bitcast
            | Op::ConvertPtrToU
            | Op::ConvertUToPtr
            | Op::ConvertUToAccelerationStructureKHR => self.lower_conversion(instruction),

            Op::TraceRayKHR
            | Op::TraceNV
            | Op::TraceRayMotionNV
            | Op::TraceMotionNV
            | Op::ReportIntersectionKHR
            | Op::ExecuteCallableKHR
            | Op::ExecuteCallableNV => self.lower_ray(instruction),

            Op::SampledImage
            | Op::Image
            | Op::ImageTexelPointer
            | Op::UntypedImageTexelPointerEXT
            | Op::ImageSampleImplicitLod
            | Op::ImageSampleExplicitLod
            | Op::ImageSampleDrefImplicitLod
            | Op::ImageSampleDrefExplicitLod
            | Op::ImageSampleProjImplicitLod
            | Op::ImageSampleProjExplicitLod
            | Op::ImageSampleProjDrefImplicitLod
            | Op::ImageSampleProjDrefExplicitLod
            | Op::ImageFetch
            | Op::ImageGather
            | Op::ImageDrefGather
            | Op::ImageRead
            | Op::ImageWrite
            | Op::ImageQuerySizeLod
            | Op::ImageQuerySize
            | Op::ImageQueryLod
            | Op::ImageQueryLevels
            | Op::ImageQuerySamples
            | Op::ImageSparseSampleImplicitLod
            | Op::ImageSparseSampleExplicitLod
            | Op::ImageSparseSampleDrefImplicitLod
            | Op::ImageSparseSampleDrefExplicitLod
            | Op::ImageSparseFetch
            | Op::ImageSparseGather
            | Op::ImageSparseDrefGather
            | Op::ImageSparseTexelsResident
            | Op::ImageSparseRead => self.lower_image(instruction),

            Op::AtomicLoad
            | Op::AtomicStore
            | Op::AtomicExchange
            | Op::AtomicCompareExchange
            | Op::AtomicCompareExchangeWeak
            | Op::AtomicIIncrement
            | Op::AtomicIDecrement
            | Op::AtomicIAdd
            | Op::AtomicISub
            | Op::AtomicSMin
            | Op::AtomicUMin
            | Op::AtomicSMax
            | Op::AtomicUMax
            | Op::AtomicAnd
            | Op::AtomicOr
            | Op::AtomicXor
            | Op::AtomicFAddEXT
            | Op::AtomicFMinEXT
            | Op::AtomicFMaxEXT => self.lower_atomic(instruction),

            Op::ControlBarrier
            | Op::ControlBarrierArriveINTEL
            | Op::ControlBarrierWaitINTEL
            | Op::MemoryBarrier
            | Op::ReadClockKHR => self.lower_barrier(instruction),

            opcode if super::hit_object::is_hit_object(opcode) => {
                self.lower_hit_object(instruction)
            }
            opcode if super::subgroup::is_subgroup(opcode) => self.lower_subgroup(instruction),
            opcode if super::derivative::is_derivative(opcode) => {
                self.lower_derivative(instruction)
            }
            opcode if super::ray_query::is_ray_query(opcode) => self.lower_ray_query(instruction),
            _ => self.lower_arithmetic(instruction),
        }
    }

    fn lower_undef(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let info = self.types.info(instruction.result_type)?;
        if matches!(info.kind, TypeKind::RuntimeArray { .. }) {
            // Its length is unknown, so it cannot be loaded.
            return self.define(instruction.result, Self::scalars(Vec::new()));
        }
        let types = self.types.leaves(instruction.result_type)?;
        let zeros: Vec<_> = types.iter().map(|&ty| self.b.constant(ty, 0)).collect();
        self.define(instruction.result, Self::scalars(zeros))
    }

    /// An opcode that no group lowers.
    pub(super) fn unsupported(&self, instruction: &Instruction) -> Error {
        let message = format!("Op{} is not supported", opcode_name(instruction.opcode));
        Error::unsupported(instruction.offset, message)
    }
}
