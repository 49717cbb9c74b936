//! Recording: the `vkCmd*` entry points' way to a command buffer.

use ash::vk;

use crate::VkResult;
use crate::command::{CommandBuffer, Recording};
use crate::guard::{guard, refused};
use crate::handle::from_handle;

/// Runs the body of a `vkCmd*` entry point with the command buffer's recorder. An error or a panic
/// becomes the result of `vkEndCommandBuffer`.
///
/// # Safety
/// The command buffer is alive.
pub unsafe fn record(
    name: &'static str,
    commands: vk::CommandBuffer,
    body: impl FnOnce(&mut Recording) -> VkResult,
) {
    guard(name, move || {
        // SAFETY: the caller guarantees that the command buffer is alive.
        let commands = unsafe { from_handle::<CommandBuffer>(commands) };
        let mut recording = commands.recording.lock();
        if let Err(code) = guard(name, || body(&mut recording)) {
            refused(name, code);
            recording.fail(code);
        }
    });
}
