//! Command buffers: an owned list of commands, recorded once, replayed by
//! [`execute`](crate::execute).
//!
//! Recording copies data that the application may free, and holds counted references to objects
//! that it may destroy early. Images and queries are held by counted references, too, so that an
//! invalid application gets a wrong image instead of a fault. Buffers are resolved to addresses,
//! since they must be bound to memory when a command that uses them is recorded.

#![forbid(unsafe_code)]

mod buffer;
pub mod build;
pub mod graphics;
pub mod instances;
pub mod matrix;
pub mod micromap;
pub mod pass;
mod pool;
pub mod range;
mod ray_tracing;
pub mod structures;
pub mod swept_sphere;
mod transfer;

use std::sync::Arc;

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::descriptor_heap::Table;

use crate::handle::Ref;
use crate::object::{DescriptorSet, DescriptorSetLayout, Event, Pipeline, QueryPool};
use crate::wave::mask::InvocationMask;

pub use buffer::{CommandBuffer, Recording, copied};
pub use graphics::GraphicsCommand;
pub use matrix::MatrixConversion;
pub use pool::CommandPool;
pub use ray_tracing::RayTracingCommand;
pub use structures::StructureCommand;
pub use transfer::{Parameters, TransferCommand};

crate::handle::handled!(
    CommandBuffer => CommandBuffer,
    CommandPool => CommandPool,
);

/// A label of the application in a command buffer, recorded if there is a timeline.
pub enum Mark {
    /// The handle of the command buffer: its first command.
    CommandBuffer(u64),
    Begin(Box<str>),
    End,
    Insert(Box<str>),
}

/// A recorded command.
pub enum Command {
    Mark(Mark),
    BindPipeline(Ref<Pipeline>),
    /// `vkCmdSetRayTracingPipelineStackSizeKHR`.
    SetRayTracingStackSize(u32),
    /// `vkCmdBindInvocationMaskHUAWEI`; without a mask all invocations run.
    BindInvocationMask(Option<InvocationMask>),
    BindDescriptorSets(BindDescriptorSets),
    BindDescriptorBuffer(BindDescriptorBuffer),
    BindHeap(BindHeap),
    PushConstants {
        offset: u32,
        bytes: SmallVec<[u8; 32]>,
    },
    Dispatch {
        base: [u32; 3],
        count: [u32; 3],
    },
    DispatchIndirect {
        /// Device address of a `VkDispatchIndirectCommand`.
        address: u64,
    },
    ResetQueryPool {
        pool: Ref<QueryPool>,
        first: u32,
        count: u32,
    },
    WriteTimestamp {
        pool: Ref<QueryPool>,
        query: u32,
    },
    CopyQueryPoolResults(CopyQueryPoolResults),
    SetEvent(Ref<Event>),
    ResetEvent(Ref<Event>),
    WaitEvents(Vec<Ref<Event>>),
    ExecuteCommands(Vec<Arc<Vec<Command>>>),
    Transfer(TransferCommand),
    Structure(StructureCommand),
    RayTracing(RayTracingCommand),
    Graphics(GraphicsCommand),
}

/// `vkCmdBindDescriptorSets`, or pushed descriptors as a set of their own.
pub struct BindDescriptorSets {
    pub bind_point: vk::PipelineBindPoint,
    pub first_set: u32,
    pub sets: SmallVec<[Option<Ref<DescriptorSet>>; 4]>,
    pub dynamic_offsets: SmallVec<[u32; 4]>,
}

/// `vkCmdBindResourceHeapEXT`, `vkCmdBindSamplerHeapEXT`.
pub struct BindHeap {
    pub table: Table,
    pub address: u64,
    pub size_bytes: u64,
}

/// One set of `vkCmdSetDescriptorBufferOffsetsEXT`.
pub struct BindDescriptorBuffer {
    pub bind_point: vk::PipelineBindPoint,
    pub set: u32,
    pub layout: Ref<DescriptorSetLayout>,
    /// Device address of the set's first byte.
    pub address: u64,
}

/// `vkCmdCopyQueryPoolResults`.
pub struct CopyQueryPoolResults {
    pub pool: Ref<QueryPool>,
    pub first: u32,
    pub count: u32,
    /// Device address of the first result.
    pub address: u64,
    pub stride_bytes: u64,
    pub flags: vk::QueryResultFlags,
}
