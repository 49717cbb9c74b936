//! Windows: the performance counter.

use std::ffi::c_void;

use crate::VkResult;
use crate::entry::row::commands;
use crate::ffi::vk;
use crate::os::clock::{Clock, ticks};
use crate::os::handle::{Handle, RawHandle};

/// The system's clocks that timestamps can be calibrated to.
pub const TIME_DOMAINS: [vk::TimeDomainKHR; 1] = [vk::TimeDomainKHR::QUERY_PERFORMANCE_COUNTER];

/// The time in a domain: one of [`TIME_DOMAINS`], or that of the device.
pub fn time(domain: vk::TimeDomainKHR) -> u64 {
    match domain {
        vk::TimeDomainKHR::QUERY_PERFORMANCE_COUNTER => ticks(),
        _ => Clock::Monotonic.now_ns(),
    }
}

/// The memory that an allocation is to import: none, since no extension for it is offered.
///
/// # Errors
/// None.
///
/// # Safety
/// `next` is a valid chain of `VkMemoryAllocateInfo`.
pub unsafe fn imported_memory(_next: *const c_void) -> VkResult<Option<(Handle, RawHandle)>> {
    Ok(None)
}

commands! {}
