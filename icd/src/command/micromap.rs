//! Builds of micromaps as they are recorded.
#![forbid(unsafe_code)]

use traversal::MicromapUsage;

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
    /// The number of triangles, from the usage counts.
    pub fn count(&self) -> u32 {
        let counts = self.usages.iter().map(|usage| u64::from(usage.count));
        counts.sum::<u64>().min(u32::MAX.into()) as u32
    }
}
