//! Tuff: a Vulkan driver that traces rays on the CPU.
//!
//! ```text
//! ffi ──> entry ──> object, command, queue ──> execute ──> trace
//!          │
//!        table (commands, extensions, features, limits)
//! ```
//!
//! [`loader`] has the three symbols that the shared library exports; [`table::commands`] names every entry point.

pub mod command;
mod entry;
pub mod execute;
pub mod ffi;
pub mod format;
pub mod handle;
pub mod loader;
pub mod log;
pub mod object;
pub mod queue;
pub mod table;
pub mod trace;
pub mod validate;

/// A result with the Vulkan code that an entry point returns. Codes other than `VK_SUCCESS` travel as `Err`, `VK_INCOMPLETE` and
/// `VK_NOT_READY` included.
pub type VkResult<T = ()> = Result<T, ash::vk::Result>;
