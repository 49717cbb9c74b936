//! Command buffers: an owned list of commands, recorded once, replayed by [`execute`](crate::execute).
//!
//! Recording copies what the application may free; what it may destroy early is held by count. Images, buffers and queries are named by
//! counted references too: a mistaken application gets a wrong picture, not a fault.

use std::collections::HashSet;
use std::sync::Arc;

use ash::vk;
use ash::vk::Handle;
use parking_lot::Mutex;
use smallvec::SmallVec;

use crate::VkResult;
use crate::handle::{self, Ref};
use crate::object::{
    DescriptorSet, DescriptorSetLayout, Event, Pipeline, PipelineLayout, QueryPool,
};

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
}

/// A command buffer.
pub struct CommandBuffer {
    pub level: vk::CommandBufferLevel,
    pub recording: Mutex<Recording>,
}

impl CommandBuffer {
    /// An empty command buffer.
    pub fn new(level: vk::CommandBufferLevel) -> Self {
        Self {
            level,
            recording: Mutex::new(Recording::default()),
        }
    }
}

/// What a command buffer holds, and what recording it has to remember.
pub struct Recording {
    pub commands: Arc<Vec<Command>>,
    /// What went wrong while recording: `vkEndCommandBuffer` returns it.
    pub result: VkResult,
    /// The last push descriptor set of each bind point and set number: the next push changes a copy.
    pushed: Vec<((vk::PipelineBindPoint, u32), Ref<DescriptorSet>)>,
}

impl Default for Recording {
    fn default() -> Self {
        Self {
            commands: Arc::default(),
            result: Ok(()),
            pushed: Vec::new(),
        }
    }
}

impl Recording {
    /// Starts anew. Submissions and primaries that hold the old commands keep them.
    pub fn reset(&mut self) {
        match Arc::get_mut(&mut self.commands) {
            Some(commands) => commands.clear(),
            None => self.commands = Arc::default(),
        }
        self.result = Ok(());
        self.pushed.clear();
    }

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

    /// A new set with the contents of the last push to this place.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn pushed_set(
        &mut self,
        bind_point: vk::PipelineBindPoint,
        set: u32,
        layout: &Ref<DescriptorSetLayout>,
    ) -> VkResult<Ref<DescriptorSet>> {
        let place = (bind_point, set);
        let last = self.pushed.iter_mut().find(|pushed| pushed.0 == place);
        let new = match &last {
            Some((_, last)) if Arc::ptr_eq(&last.layout, layout) => last.duplicate()?,
            _ => DescriptorSet::new(Ref::clone(layout), 0)?,
        };
        let new = handle::new(new);
        match last {
            Some(last) => last.1 = Ref::clone(&new),
            None => self.pushed.push((place, Ref::clone(&new))),
        }
        Ok(new)
    }
}

/// A command pool: it destroys its buffers with itself.
#[derive(Default)]
pub struct CommandPool {
    buffers: Mutex<HashSet<u64>>,
}

impl CommandPool {
    pub fn insert(&self, buffer: vk::CommandBuffer) {
        self.buffers.lock().insert(buffer.as_raw());
    }

    /// Takes a buffer out; false if it is not the pool's.
    pub fn remove(&self, buffer: vk::CommandBuffer) -> bool {
        self.buffers.lock().remove(&buffer.as_raw())
    }

    /// The pool's buffers.
    pub fn all(&self) -> Vec<vk::CommandBuffer> {
        self.buffers
            .lock()
            .iter()
            .map(|&buffer| vk::CommandBuffer::from_raw(buffer))
            .collect()
    }

    /// Takes all buffers out.
    pub fn take_all(&self) -> Vec<vk::CommandBuffer> {
        self.buffers
            .lock()
            .drain()
            .map(vk::CommandBuffer::from_raw)
            .collect()
    }
}
