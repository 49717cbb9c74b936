//! Capabilities that a module may declare: those of enabled features that lowering can express.

use rspirv::spirv::{Capability, ExecutionModel};

use crate::Error;
use crate::parse::ParsedModule;
use crate::request::CompileRequest;

/// Implied by every shader; applications do not enable them.
const ALWAYS: &[Capability] = &[Capability::Shader, Capability::Matrix];

/// Capabilities that this front end lowers. A device enables each of them with some feature, or
/// always.
pub const SUPPORTED: &[Capability] = &[
    Capability::Geometry,
    Capability::GeometryPointSize,
    Capability::Tessellation,
    Capability::TessellationPointSize,
    Capability::GeometryStreams,
    Capability::TransformFeedback,
    Capability::MeshShadingEXT,
    Capability::Matrix,
    Capability::Shader,
    Capability::Float16,
    Capability::Float64,
    Capability::FMAKHR,
    Capability::Int8,
    Capability::Int16,
    Capability::Int64,
    Capability::Int64Atomics,
    Capability::ImageGatherExtended,
    Capability::StorageImageMultisample,
    Capability::UniformBufferArrayDynamicIndexing,
    Capability::SampledImageArrayDynamicIndexing,
    Capability::StorageBufferArrayDynamicIndexing,
    Capability::StorageImageArrayDynamicIndexing,
    Capability::ImageCubeArray,
    Capability::Int64ImageEXT,
    Capability::MinLod,
    Capability::SparseResidency,
    Capability::Sampled1D,
    Capability::Image1D,
    Capability::SampledCubeArray,
    Capability::SampledBuffer,
    Capability::ImageBuffer,
    Capability::ImageMSArray,
    Capability::StorageImageExtendedFormats,
    Capability::ImageQuery,
    Capability::StorageImageReadWithoutFormat,
    Capability::StorageImageWriteWithoutFormat,
    Capability::GroupNonUniform,
    Capability::GroupNonUniformVote,
    Capability::GroupNonUniformArithmetic,
    Capability::GroupNonUniformBallot,
    Capability::GroupNonUniformShuffle,
    Capability::GroupNonUniformShuffleRelative,
    Capability::GroupNonUniformClustered,
    Capability::GroupNonUniformQuad,
    Capability::GroupNonUniformRotateKHR,
    Capability::GroupNonUniformPartitionedEXT,
    Capability::SubgroupBallotKHR,
    Capability::SubgroupVoteKHR,
    Capability::DeviceGroup,
    Capability::VariablePointers,
    Capability::VariablePointersStorageBuffer,
    Capability::StorageBuffer16BitAccess,
    Capability::UniformAndStorageBuffer16BitAccess,
    Capability::StoragePushConstant16,
    Capability::StorageBuffer8BitAccess,
    Capability::UniformAndStorageBuffer8BitAccess,
    Capability::StoragePushConstant8,
    Capability::WorkgroupMemoryExplicitLayoutKHR,
    Capability::WorkgroupMemoryExplicitLayout8BitAccessKHR,
    Capability::WorkgroupMemoryExplicitLayout16BitAccessKHR,
    Capability::DenormPreserve,
    // Without effect: see docs/capabilities.md.
    Capability::DenormFlushToZero,
    Capability::SignedZeroInfNanPreserve,
    Capability::RoundingModeRTE,
    Capability::FloatControls2,
    Capability::ShaderClockKHR,
    Capability::ShaderNonUniform,
    Capability::RuntimeDescriptorArray,
    Capability::InputAttachmentArrayDynamicIndexing,
    Capability::UniformTexelBufferArrayDynamicIndexing,
    Capability::StorageTexelBufferArrayDynamicIndexing,
    Capability::UniformBufferArrayNonUniformIndexing,
    Capability::SampledImageArrayNonUniformIndexing,
    Capability::StorageBufferArrayNonUniformIndexing,
    Capability::StorageImageArrayNonUniformIndexing,
    Capability::InputAttachmentArrayNonUniformIndexing,
    Capability::UniformTexelBufferArrayNonUniformIndexing,
    Capability::StorageTexelBufferArrayNonUniformIndexing,
    Capability::RayTracingKHR,
    Capability::RayTracingNV,
    Capability::RayTraversalPrimitiveCullingKHR,
    Capability::RayTracingPositionFetchKHR,
    Capability::RayCullMaskKHR,
    Capability::RayQueryKHR,
    Capability::RayQueryPositionFetchKHR,
    Capability::RayTracingSpheresGeometryNV,
    Capability::RayTracingLinearSweptSpheresGeometryNV,
    Capability::RayTracingMotionBlurNV,
    Capability::ShaderInvocationReorderNV,
    Capability::ShaderInvocationReorderEXT,
    Capability::RayTracingOpacityMicromapEXT,
    Capability::VulkanMemoryModel,
    Capability::VulkanMemoryModelDeviceScope,
    Capability::PhysicalStorageBufferAddresses,
    Capability::DemoteToHelperInvocation,
    Capability::AtomicFloat16AddEXT,
    Capability::AtomicFloat32AddEXT,
    Capability::AtomicFloat64AddEXT,
    Capability::AtomicFloat16MinMaxEXT,
    Capability::AtomicFloat32MinMaxEXT,
    Capability::AtomicFloat64MinMaxEXT,
    Capability::DotProduct,
    Capability::DotProductInputAll,
    Capability::DotProductInput4x8Bit,
    Capability::DotProductInput4x8BitPacked,
    Capability::ExpectAssumeKHR,
    Capability::QuadControlKHR,
    Capability::DerivativeControl,
    Capability::ClipDistance,
    Capability::CullDistance,
    Capability::SampleRateShading,
    Capability::InterpolationFunction,
    Capability::InputAttachment,
    Capability::MultiView,
    Capability::DrawParameters,
    Capability::MultiViewport,
    Capability::ShaderLayer,
    Capability::ShaderViewportIndex,
    Capability::ShaderViewportIndexLayerEXT,
    Capability::StencilExportEXT,
    Capability::SampleMaskPostDepthCoverage,
    Capability::FragmentBarycentricKHR,
    Capability::FragmentShadingRateKHR,
    Capability::FragmentShaderPixelInterlockEXT,
    Capability::FragmentShaderSampleInterlockEXT,
    Capability::StorageInputOutput16,
    Capability::ComputeDerivativeGroupQuadsKHR,
    Capability::ComputeDerivativeGroupLinearKHR,
    Capability::ReplicatedCompositesEXT,
    Capability::UntypedPointersKHR,
    Capability::CooperativeMatrixKHR,
    Capability::CooperativeVectorNV,
    Capability::BFloat16TypeKHR,
    Capability::BFloat16DotProductKHR,
    Capability::BFloat16CooperativeMatrixKHR,
    Capability::DescriptorHeapEXT,
    Capability::Shader64BitIndexingEXT,
    Capability::SplitBarrierINTEL,
    Capability::LongVectorEXT,
];

/// Whether a capability is accepted although its feature is disabled. Compilers declare `Geometry`
/// for the inputs `PrimitiveId`, `Layer` and `ViewportIndex` of fragment shaders (each needs one of
/// several capabilities). It enables nothing else in that stage.
fn serves_inputs(capability: Capability, parsed: &ParsedModule) -> bool {
    let mut entries = parsed.entry_points.iter();
    capability == Capability::Geometry && entries.any(|it| it.model == ExecutionModel::Fragment)
}

/// Refuses a module with capabilities that the device has not enabled, or that cannot be lowered.
pub(super) fn check_capabilities(
    parsed: &ParsedModule,
    request: &CompileRequest<'_>,
) -> Result<(), Error> {
    for &(capability, offset) in &parsed.capabilities {
        if !SUPPORTED.contains(&capability) {
            let message = format!("capability {capability:?} is not supported");
            return Err(Error::unsupported(offset, message));
        }
        let is_enabled = ALWAYS.contains(&capability) || request.capabilities.contains(&capability);
        if !is_enabled && !serves_inputs(capability, parsed) {
            let message = format!("capability {capability:?} is not enabled");
            return Err(Error::unsupported(offset, message));
        }
    }
    for &(capability, offset) in &parsed.newer_capabilities {
        if !request.newer_capabilities.contains(&capability) {
            let message = format!("capability {capability:?} is not enabled");
            return Err(Error::unsupported(offset, message));
        }
    }
    Ok(())
}
