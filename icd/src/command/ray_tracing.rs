//! Ray tracing dispatches.

#![forbid(unsafe_code)]

use crate::wave::binding_table::Tables;

/// A recorded dispatch of rays.
pub enum RayTracingCommand {
    /// `vkCmdTraceRaysKHR`.
    TraceRays { tables: Tables, extent: [u32; 3] },
    /// `vkCmdTraceRaysNV`.
    TraceRaysNv { tables: Tables, extent: [u32; 3] },
    /// `vkCmdTraceRaysIndirectKHR`: the address of a `VkTraceRaysIndirectCommandKHR`.
    TraceRaysIndirect { tables: Tables, address: u64 },
    /// `vkCmdTraceRaysIndirect2KHR`: the address of a `VkTraceRaysIndirectCommand2KHR`.
    TraceRaysIndirect2 { address: u64 },
}
