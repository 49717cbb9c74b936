//! Commands on micromaps.
#![forbid(unsafe_code)]

use ash::vk;
use traversal::MicromapUsage;

use crate::handle::Ref;
use crate::object::QueryPool;
use crate::object::acceleration_structure::Storage;

/// `VkMicromapBuildInfoEXT`, copied.
#[derive(Clone, Debug)]
pub struct MicromapBuild {
    pub destination: Storage,
    pub data: u64,
    /// Address of the first `VkMicromapTriangleEXT`.
    pub triangles: u64,
    pub stride_bytes: u64,
    pub usages: Vec<MicromapUsage>,
}

impl MicromapBuild {
    /// How many triangles there are, as the usage counts have it.
    pub fn count(&self) -> u32 {
        let counts = self.usages.iter().map(|usage| u64::from(usage.count));
        counts.sum::<u64>().min(u32::MAX.into()) as u32
    }
}

/// A recorded command on micromaps.
pub enum MicromapCommand {
    /// `vkCmdBuildMicromapsEXT`.
    Build(Vec<MicromapBuild>),
    /// `vkCmdCopyMicromapEXT`, in either mode.
    Copy {
        source: Storage,
        destination: Storage,
    },
    /// `vkCmdCopyMicromapToMemoryEXT`.
    Serialize { source: Storage, destination: u64 },
    /// `vkCmdCopyMemoryToMicromapEXT`.
    Deserialize { source: u64, destination: Storage },
    /// `vkCmdWriteMicromapsPropertiesEXT`.
    WriteProperties {
        micromaps: Vec<u64>,
        query_type: vk::QueryType,
        pool: Ref<QueryPool>,
        first: u32,
    },
}
