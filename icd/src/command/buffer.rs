//! `VkCommandBuffer` and its states.

#![forbid(unsafe_code)]

use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;
use smallvec::SmallVec;

use super::Command;
use super::pass::PassRecorder;
use crate::VkResult;
use crate::handle::{self, Ref};
use crate::object::{DescriptorSet, DescriptorSetLayout};

/// A command buffer.
pub struct CommandBuffer {
    pub level: vk::CommandBufferLevel,
    pub recording: Mutex<Recording>,
}

impl CommandBuffer {
    /// Creates a command buffer in the initial state.
    pub fn new(level: vk::CommandBufferLevel) -> Self {
        Self {
            level,
            recording: Mutex::default(),
        }
    }
}

/// Contents of a command buffer. They determine the state that the specification describes (chapter
/// Command Buffers, "Command Buffer Lifecycle"): *executable* with a finished list, *initial* or
/// *recording* without. The application tracks *pending*.
#[derive(Default)]
pub struct Recording {
    commands: Vec<Command>,
    /// The list that `vkEndCommandBuffer` finished. Submissions and primary command buffers hold
    /// further references.
    finished: Option<Arc<Vec<Command>>>,
    /// The first error during recording; `vkEndCommandBuffer` returns it.
    failure: Option<vk::Result>,
    /// The last push descriptor set of each bind point and set number: the next push changes a
    /// copy.
    pushed: Vec<((vk::PipelineBindPoint, u32), Ref<DescriptorSet>)>,
    /// Addresses of the bound descriptor buffers (`vkCmdBindDescriptorBuffersEXT`).
    pub descriptor_buffers: SmallVec<[u64; 4]>,
    /// The current render pass.
    pub render_pass: Option<PassRecorder>,
}

impl Recording {
    /// Appends a command.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn push(&mut self, command: Command) -> VkResult {
        self.commands
            .try_reserve(1)
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        self.commands.push(command);
        Ok(())
    }

    /// Keeps the first error.
    pub fn fail(&mut self, code: vk::Result) {
        self.failure.get_or_insert(code);
    }

    /// Returns to the initial state. `keep_memory` keeps the list's memory for the next recording.
    pub fn reset(&mut self, keep_memory: bool) {
        let finished = self
            .finished
            .take()
            .and_then(|list| Arc::try_unwrap(list).ok());
        self.commands = finished
            .or_else(|| Some(std::mem::take(&mut self.commands)))
            .filter(|_| keep_memory)
            .unwrap_or_default();
        self.commands.clear();
        self.failure = None;
        self.pushed.clear();
        self.descriptor_buffers.clear();
        self.render_pass = None;
    }

    /// A new set with the contents of the last push to this bind point and set number.
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

    /// `vkEndCommandBuffer`.
    ///
    /// # Errors
    /// The first error during recording, after which the buffer cannot be executed.
    pub fn finish(&mut self) -> VkResult {
        let commands = std::mem::take(&mut self.commands);
        if let Some(code) = self.failure {
            return Err(code);
        }
        self.finished = Some(Arc::new(commands));
        Ok(())
    }

    /// The finished list, to execute.
    ///
    /// # Errors
    /// `VK_ERROR_UNKNOWN` if the buffer is not in the executable state.
    pub fn executable(&self) -> VkResult<Arc<Vec<Command>>> {
        self.finished.clone().ok_or(vk::Result::ERROR_UNKNOWN)
    }
}

/// An owned copy of an application's array.
///
/// # Errors
/// `VK_ERROR_OUT_OF_HOST_MEMORY`.
pub fn copied<T, U>(items: &[T], copy: impl FnMut(&T) -> U) -> VkResult<Vec<U>> {
    let mut copies = Vec::new();
    copies
        .try_reserve_exact(items.len())
        .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
    copies.extend(items.iter().map(copy));
    Ok(copies)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dispatch() -> Command {
        Command::Dispatch {
            base: [0; 3],
            count: [1; 3],
        }
    }

    #[test]
    fn a_failure_surfaces_at_the_end_and_reset_forgets_it() {
        let mut recording = Recording::default();
        recording.fail(vk::Result::ERROR_OUT_OF_HOST_MEMORY);
        recording.fail(vk::Result::ERROR_UNKNOWN);
        assert_eq!(
            recording.finish(),
            Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY)
        );
        assert!(recording.executable().is_err());
        recording.reset(true);
        assert!(recording.push(dispatch()).is_ok() && recording.finish().is_ok());
        assert_eq!(recording.executable().ok().unwrap().len(), 1);
    }

    #[test]
    fn a_list_outlives_the_reset_of_its_buffer() {
        let mut recording = Recording::default();
        assert!(recording.push(dispatch()).is_ok() && recording.finish().is_ok());
        let submitted = recording.executable().ok().unwrap();
        recording.reset(true);
        assert!(recording.push(dispatch()).is_ok());
        assert!(recording.push(dispatch()).is_ok() && recording.finish().is_ok());
        assert_eq!(submitted.len(), 1);
        assert_eq!(recording.executable().ok().unwrap().len(), 2);
    }
}
