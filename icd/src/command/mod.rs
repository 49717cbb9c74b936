//! Command buffers: an owned list of commands, recorded once, replayed by [`execute`](crate::execute).
//!
//! Recording copies what the application may free; what it may destroy early is held by count. Images, buffers and queries are named by
//! counted references too: a mistaken application gets a wrong picture, not a fault.

pub mod ray_tracing;

use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;
use smallvec::SmallVec;

use crate::handle::{Object, Ref};
pub use ray_tracing::RayTracingCommand;

use crate::object::{DescriptorSet, Event, Image, Pipeline, PipelineLayout, QueryPool};

/// A recorded command.
pub enum Command {
    BindPipeline(Ref<Pipeline>),
    BindDescriptorSets {
        bind_point: vk::PipelineBindPoint,
        layout: Ref<PipelineLayout>,
        first_set: u32,
        sets: SmallVec<[Option<Ref<DescriptorSet>>; 4]>,
        dynamic_offsets: SmallVec<[u32; 4]>,
    },
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
    CopyBuffer {
        source: u64,
        destination: u64,
        size_bytes: u64,
    },
    FillBuffer {
        address: u64,
        size_bytes: u64,
        word: u32,
    },
    UpdateBuffer {
        address: u64,
        bytes: Box<[u8]>,
    },
    CopyImage {
        source: Ref<Image>,
        destination: Ref<Image>,
        regions: Vec<vk::ImageCopy>,
    },
    CopyBufferToImage {
        /// Device address of the buffer's first byte.
        source: u64,
        destination: Ref<Image>,
        regions: Vec<vk::BufferImageCopy>,
    },
    CopyImageToBuffer {
        source: Ref<Image>,
        destination: u64,
        regions: Vec<vk::BufferImageCopy>,
    },
    BlitImage {
        source: Ref<Image>,
        destination: Ref<Image>,
        regions: Vec<vk::ImageBlit>,
        filter: vk::Filter,
    },
    ResolveImage {
        source: Ref<Image>,
        destination: Ref<Image>,
        regions: Vec<vk::ImageResolve>,
    },
    ClearColorImage {
        image: Ref<Image>,
        value: vk::ClearColorValue,
        ranges: Vec<vk::ImageSubresourceRange>,
    },
    ClearDepthStencilImage {
        image: Ref<Image>,
        value: vk::ClearDepthStencilValue,
        ranges: Vec<vk::ImageSubresourceRange>,
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
    CopyQueryPoolResults {
        pool: Ref<QueryPool>,
        first: u32,
        count: u32,
        address: u64,
        stride_bytes: u64,
        flags: vk::QueryResultFlags,
    },
    SetEvent(Ref<Event>),
    ResetEvent(Ref<Event>),
    WaitEvents(Vec<Ref<Event>>),
    ExecuteCommands(Vec<Arc<Vec<Command>>>),
    RayTracing(RayTracingCommand),
}

/// A command buffer.
pub struct CommandBuffer {
    pub level: vk::CommandBufferLevel,
    pub recording: Mutex<Recording>,
}

/// What a command buffer holds, and what is bound while it is recorded.
pub struct Recording {
    pub commands: Arc<Vec<Command>>,
    /// What went wrong while recording: `vkEndCommandBuffer` returns it.
    pub result: crate::VkResult,
    pub one_time: bool,
}

impl Recording {
    /// Appends a command.
    pub fn push(&mut self, command: Command) {
        if let Some(commands) = Arc::get_mut(&mut self.commands) {
            commands.push(command);
        }
    }

    /// Notes the first failure.
    pub fn fail(&mut self, code: vk::Result) {
        if self.result.is_ok() {
            self.result = Err(code);
        }
    }
}

/// A command pool: it destroys its buffers with itself.
pub struct CommandPool {
    pub flags: vk::CommandPoolCreateFlags,
    pub buffers: Mutex<Vec<Arc<Object<CommandBuffer>>>>,
}
