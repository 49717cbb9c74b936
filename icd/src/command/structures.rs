//! Builds and copies of acceleration structures and micromaps, and queries of their properties.

#![forbid(unsafe_code)]

use ash::vk;

use super::build::Build;
use super::micromap::MicromapBuild;
use crate::handle::Ref;
use crate::object::QueryPool;
use crate::object::acceleration_structure::Storage;

/// A recorded command on acceleration structures or micromaps.
pub enum StructureCommand {
    /// `vkCmdBuildAccelerationStructuresKHR`.
    Build(Vec<Build>),
    /// `vkCmdBuildAccelerationStructuresIndirectKHR`.
    BuildIndirect(Vec<IndirectBuild>),
    /// `vkCmdBuildMicromapsEXT`.
    BuildMicromaps(Vec<MicromapBuild>),
    Copy(Built, BuiltCopy),
    /// `vkCmdWriteAccelerationStructuresPropertiesKHR`, `vkCmdWriteMicromapsPropertiesEXT`.
    WriteProperties {
        of: Built,
        addresses: Vec<u64>,
        query_type: vk::QueryType,
        pool: Ref<QueryPool>,
        first: u32,
    },
}

/// A build with ranges in memory, which an earlier command may write.
pub struct IndirectBuild {
    /// The build, before its ranges are read.
    pub build: Build,
    /// Device address of the first `VkAccelerationStructureBuildRangeInfoKHR`.
    pub ranges: u64,
    pub stride_bytes: u32,
    /// For each geometry, the largest primitive count of its range.
    pub max_primitive_counts: Vec<u32>,
}

/// A structure or micromap that a build writes.
#[derive(Clone, Copy)]
pub enum Built {
    Structure,
    Micromap,
}

/// A copy of a structure or micromap.
#[derive(Clone, Copy)]
pub enum BuiltCopy {
    /// `vkCmdCopyAccelerationStructureKHR`, `vkCmdCopyMicromapEXT`.
    Whole {
        source: Storage,
        destination: Storage,
        mode: CopyMode,
    },
    /// `vkCmdCopyAccelerationStructureToMemoryKHR`, `vkCmdCopyMicromapToMemoryEXT`.
    Serialize { source: Storage, destination: u64 },
    /// `vkCmdCopyMemoryToAccelerationStructureKHR`, `vkCmdCopyMemoryToMicromapEXT`.
    Deserialize { source: u64, destination: Storage },
}

/// The mode of a copy between two structures or micromaps.
#[derive(Clone, Copy)]
pub enum CopyMode {
    Clone,
    Compact,
}
