//! `VkCommandPool`.

#![forbid(unsafe_code)]

use std::collections::HashMap;

use ash::vk;
use parking_lot::Mutex;

use super::CommandBuffer;
use crate::handle::{self, Ref};

/// A command pool, which owns its buffers and destroys them with itself.
#[derive(Default)]
pub struct CommandPool {
    buffers: Mutex<HashMap<vk::CommandBuffer, Ref<CommandBuffer>>>,
}

impl CommandPool {
    /// Allocates a command buffer in the initial state.
    pub fn allocate(&self, level: vk::CommandBufferLevel) -> vk::CommandBuffer {
        let buffer = handle::new(CommandBuffer::new(level));
        let handle = handle::handle_of(&buffer);
        self.buffers.lock().insert(handle, buffer);
        handle
    }

    /// Frees a command buffer; null handles are ignored.
    pub fn free(&self, buffer: vk::CommandBuffer) {
        self.buffers.lock().remove(&buffer);
    }

    /// `vkResetCommandPool`.
    pub fn reset(&self, keep_memory: bool) {
        for buffer in self.buffers.lock().values() {
            buffer.recording.lock().reset(keep_memory);
        }
    }
}
