//! Tuff: a Vulkan driver that traces rays on the CPU.
//!
//! ```text
//! entry ──> decode ──> device ──> queue ──> present
//!                                   └───> execute ──> raster, compute, trace, structures, transfer
//!                                                            │
//!           validate ──> command ──> object ──> format ──> wave ──> table ──> ffi ──> os
//! ```
//!
//! [`entry::loader`] has the three symbols that the shared library exports and finds commands by
//! name; [`entry::commands`] is their table.

pub mod capabilities;
mod capture;
pub mod command;
pub mod compute;
mod decode;
pub mod device;
pub mod entry;
pub mod execute;
pub mod ffi;
pub mod float_environment;
pub mod format;
pub mod guard;
pub mod handle;
pub mod logger;
pub mod object;
mod os;
pub mod present;
pub mod queue;
pub mod raster;
mod settings;
pub mod structures;
pub mod timeline;
pub mod trace;
pub mod transfer;
pub mod validate;
pub mod wave;

/// A result with the Vulkan code that an entry point returns. Codes other than `VK_SUCCESS` travel
/// as `Err`, `VK_INCOMPLETE` and `VK_NOT_READY` included.
pub type VkResult<T = ()> = Result<T, ash::vk::Result>;
