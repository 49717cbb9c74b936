//! `VK_KHR_device_fault` and `VK_EXT_device_fault`: the known causes of a device's loss.

use std::mem::MaybeUninit;

use ash::vk;
use spirv_jit::abort;

use crate::VkResult;
use crate::device::Device;
use crate::ffi::enumerate::{enumerate, enumerate_with};
use crate::ffi::{array, chain, vk as newer};
use crate::guard::guard_result;
use crate::handle::from_handle;
use crate::wave::{Cause, Fault, Stopped, WildAddress};

/// First vendor fault code of invalid addresses; the codes of causes come before.
const CODE_READ: u64 = 6;
const CODE_WRITE: u64 = 7;
/// Vendor fault code for the invalid addresses that were not kept.
const CODE_DROPPED: u64 = 8;

/// All reports of a device belong to the fault that lost it.
const GROUP: u64 = 1;

fn address_info(wild: &WildAddress) -> vk::DeviceFaultAddressInfoEXT {
    vk::DeviceFaultAddressInfoEXT {
        address_type: match wild.writes {
            true => vk::DeviceFaultAddressTypeEXT::WRITE_INVALID,
            false => vk::DeviceFaultAddressTypeEXT::READ_INVALID,
        },
        reported_address: wild.address,
        // The address is exact.
        address_precision: 1,
    }
}

fn vendor_info(description: &str, code: u64, data: u64) -> vk::DeviceFaultVendorInfoEXT {
    let mut info = vk::DeviceFaultVendorInfoEXT {
        vendor_fault_code: code,
        vendor_fault_data: data,
        ..Default::default()
    };
    array::write_text(&mut info.description, description);
    info
}

/// The cause, with its position in the shader.
fn cause_info(fault: &Fault) -> vk::DeviceFaultVendorInfoEXT {
    let (place, depth) = match &fault.at {
        Some(at) => (at.to_string(), at.depth),
        None => (fault.cause.to_string(), 0),
    };
    vendor_info(&place, fault.cause.code(), u64::from(depth))
}

fn wild_info(wild: &WildAddress) -> vk::DeviceFaultVendorInfoEXT {
    let code = if wild.writes { CODE_WRITE } else { CODE_READ };
    vendor_info(&wild.place.to_string(), code, wild.address)
}

/// The cause, then the invalid addresses, then the number of those that were not kept.
fn vendor_infos(fault: &Fault) -> Vec<vk::DeviceFaultVendorInfoEXT> {
    let dropped = (fault.dropped > 0).then(|| {
        let text = format!("{} earlier invalid addresses were not kept", fault.dropped);
        vendor_info(&text, CODE_DROPPED, fault.dropped)
    });
    let wild = fault.wild.iter().map(wild_info);
    (std::iter::once(cause_info(fault))
        .chain(wild)
        .chain(dropped))
    .collect()
}

/// Writes a report of a lost device: an invalid address, or the loss itself, which comes last.
fn write_report(fault: &Fault, index: usize, out: &mut newer::DeviceFaultInfoKHR<'_>) {
    out.flags = newer::DEVICE_FAULT_FLAG_VENDOR_KHR;
    out.group_id = GROUP;
    out.fault_address_info = Default::default();
    out.instruction_address_info = Default::default();
    let description = match fault.wild.get(index) {
        Some(wild) => {
            out.flags |= newer::DEVICE_FAULT_FLAG_MEMORY_ADDRESS_KHR;
            out.fault_address_info = address_info(wild);
            out.vendor_info = wild_info(wild);
            let access = if wild.writes { "written" } else { "read" };
            format!(
                "invalid address {:#x} {access}: {}",
                wild.address, wild.place
            )
        }
        None => {
            out.flags |= newer::DEVICE_FAULT_FLAG_DEVICE_LOST_KHR;
            if fault.cause == Cause::Stopped(Stopped::TimedOut) {
                out.flags |= newer::DEVICE_FAULT_FLAG_WATCHDOG_TIMEOUT_KHR;
            }
            out.vendor_info = cause_info(fault);
            fault.to_string()
        }
    };
    if index == 0 && fault.dropped > 0 {
        out.flags |= newer::DEVICE_FAULT_FLAG_OVERFLOW_KHR;
    }
    array::write_text(&mut out.description, &description);
}

/// Writes as many elements as fit, none to a null pointer, and their number.
///
/// # Errors
/// `VK_INCOMPLETE` if not all fit.
///
/// # Safety
/// `out` is null or has room for `*count` elements.
unsafe fn write_infos<T>(infos: Vec<T>, count: &mut u32, out: *mut T) -> VkResult {
    let mut nowhere = MaybeUninit::uninit();
    let out = if out.is_null() {
        *count = 0;
        nowhere.as_mut_ptr()
    } else {
        out
    };
    // SAFETY: the caller guarantees that `out` is null or has room for `*count` elements.
    unsafe { enumerate(count, out, infos.into_iter()) }
}

/// Writes abort messages, or their size.
///
/// # Errors
/// `VK_INCOMPLETE` if not all fit.
///
/// # Safety
/// The data pointer is null, or there is room for as many bytes as `info` says.
unsafe fn write_messages(
    all: &[u8],
    info: &mut newer::DeviceFaultShaderAbortMessageInfoKHR<'_>,
) -> VkResult {
    if info.p_message_data.is_null() {
        info.message_data_size = all.len() as u64;
        return Ok(());
    }
    let fitting = &all[..abort::whole_messages(all, info.message_data_size)];
    let to = info.p_message_data.cast::<u8>();
    // SAFETY: the caller guarantees that the data pointer is null, or there is room for as many
    // bytes as `info` says.
    unsafe { to.copy_from_nonoverlapping(fitting.as_ptr(), fitting.len()) };
    info.message_data_size = fitting.len() as u64;
    match fitting.len() == all.len() {
        true => Ok(()),
        false => Err(vk::Result::INCOMPLETE),
    }
}

/// A device that is not lost has no fault.
pub(crate) unsafe extern "system" fn vkGetDeviceFaultInfoEXT(
    device: vk::Device,
    counts: *mut vk::DeviceFaultCountsEXT,
    info: *mut vk::DeviceFaultInfoEXT,
) -> vk::Result {
    guard_result("vkGetDeviceFaultInfoEXT", move || {
        let fault = from_handle::<Device>(device).engine.fault();
        let counts = &mut *counts;
        counts.vendor_binary_size = 0;
        let (addresses, vendor) = match &fault {
            Some(fault) => (
                fault.wild.iter().map(address_info).collect(),
                vendor_infos(fault),
            ),
            None => (Vec::new(), Vec::new()),
        };
        if info.is_null() {
            counts.address_info_count = addresses.len() as u32;
            counts.vendor_info_count = vendor.len() as u32;
            return Ok(());
        }
        let info = &mut *info;
        let description = match &fault {
            Some(fault) => fault.to_string(),
            None => "the device is not lost".to_owned(),
        };
        array::write_text(&mut info.description, &description);
        // Each is written as far as there is room, even if the other does not fit.
        let wrote = [
            write_infos(
                addresses,
                &mut counts.address_info_count,
                info.p_address_infos,
            ),
            write_infos(vendor, &mut counts.vendor_info_count, info.p_vendor_infos),
        ];
        wrote.into_iter().collect()
    })
}

/// The reports of a lost device, invalid addresses first. Once all have been returned, there
/// are no more and no wait.
pub(crate) unsafe extern "system" fn vkGetDeviceFaultReportsKHR(
    device: vk::Device,
    timeout: u64,
    count: *mut u32,
    out: *mut newer::DeviceFaultInfoKHR<'_>,
) -> vk::Result {
    guard_result("vkGetDeviceFaultReportsKHR", move || {
        let engine = &from_handle::<Device>(device).engine;
        let waited = engine.wait_for_reports(timeout);
        let left = waited.inspect_err(|_| *count = 0)?;
        if out.is_null() {
            *count = left;
            return Ok(());
        }
        let Some(fault) = engine.fault() else {
            return Ok(());
        };
        let taken = engine.take_reports(*count);
        let is_last = taken.end == fault.report_count();
        enumerate_with(count, out, taken, |out, index| {
            write_report(&fault, index as usize, out)
        })?;
        if is_last {
            Ok(())
        } else {
            Err(vk::Result::INCOMPLETE)
        }
    })
}

/// There is no vendor binary. Only whole messages are written.
pub(crate) unsafe extern "system" fn vkGetDeviceFaultDebugInfoKHR(
    device: vk::Device,
    info: *mut newer::DeviceFaultDebugInfoKHR<'_>,
) -> vk::Result {
    guard_result("vkGetDeviceFaultDebugInfoKHR", move || {
        let engine = &from_handle::<Device>(device).engine;
        (*info).vendor_binary_size = 0;
        let next = (*info).p_next;
        match chain::find_mut::<newer::DeviceFaultShaderAbortMessageInfoKHR<'_>>(next) {
            Some(info) => engine.with_abort_messages(|all| write_messages(all, info)),
            None => Ok(()),
        }
    })
}
