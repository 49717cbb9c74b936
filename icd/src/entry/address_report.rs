//! Reports of objects' addresses by entry points (`VK_EXT_device_address_binding_report`).

use ash::vk::{self, Handle};
use spirv_jit::reach::Range;

use crate::device::Device;
use crate::handle::{Handled, from_handle, optional};
use crate::object::addressed::{AddressEvent, Addressed};

/// Reports all addresses of an object to the messengers, if the device reports any. Null handles
/// have none.
///
/// # Safety
/// The handles are alive.
pub unsafe fn report<T: Handled + Addressed>(
    device: vk::Device,
    object: T::Handle,
    event: AddressEvent,
) {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        if let Some(report) = &from_handle::<Device>(device).address_report
            && let Some(found) = optional::<T>(object)
        {
            report.tell(object, event, found.ranges());
        }
    }
}

/// As [`report`], for a newly bound part: one plane of a disjoint image.
///
/// # Safety
/// The device is alive.
pub unsafe fn report_bound<H: Handle + Copy>(device: vk::Device, object: H, range: Range) {
    // SAFETY: the caller guarantees that the device is alive.
    if let Some(report) = unsafe { &from_handle::<Device>(device).address_report } {
        report.tell(object, AddressEvent::Bound, [range]);
    }
}
