//! The description of a compilation.

#![forbid(unsafe_code)]

use crate::accuracy::Accuracy;
use crate::parse::NewerCapability;
use crate::{descriptor_heap, ir};

/// The inputs for compiling a module's entry point into a program.
pub struct CompileRequest<'a> {
    pub words: &'a [u32],
    pub entry_point: &'a str,
    pub stage: ir::stage::Stage,
    /// `SpecId` and its bytes (`VkSpecializationMapEntry`; booleans as `VkBool32`).
    pub specialization: &'a [(u32, &'a [u8])],
    /// Where each (set, binding) lies in the pipeline layout; a pair that gives `None` is a null
    /// descriptor.
    pub bindings: &'a dyn Fn(u32, u32) -> Option<ir::op::DescriptorBinding>,
    /// Where pairs lie that no layout has: in heaps, push data or shader records. The first that
    /// fits counts, before `bindings`.
    pub mappings: &'a [descriptor_heap::Mapping],
    /// Capabilities that the device has enabled; a module that declares others is refused.
    pub capabilities: &'a [rspirv::spirv::Capability],
    /// Of capabilities that the bindings lack, those that the device has enabled.
    pub newer_capabilities: &'a [NewerCapability],
    pub accuracy: Accuracy,
    /// Whether the shader's messages (`NonSemantic.DebugPrintf`) are kept.
    pub prints: bool,
    /// Whether accesses through physical pointers say when those are less aligned than the module
    /// promises.
    pub checks_alignment: bool,
    /// Whether ray queries look at opacity micromaps only where an execution mode
    /// `OpacityMicromapIdKHR` says so, and not where there is none.
    pub micromaps_by_mode: bool,
    /// Whether inputs decorated as `ViewIndex` hold the device index
    /// (`VK_PIPELINE_CREATE_VIEW_INDEX_FROM_DEVICE_INDEX_BIT`).
    pub view_index_is_device_index: bool,
    /// Whether offsets in storage buffers have 64 bits, as they have where the entry point's
    /// execution mode `Shader64BitIndexingEXT` asks for it
    /// (`VK_PIPELINE_CREATE_2_64_BIT_INDEXING_BIT_EXT`).
    pub indexes_in_64_bits: bool,
}
