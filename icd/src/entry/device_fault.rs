//! `VK_EXT_device_fault`: how a device was lost, as far as it is known.

use std::mem::MaybeUninit;

use ash::vk;

use super::define::entry;
use crate::VkResult;
use crate::device::Device;
use crate::ffi::array;
use crate::ffi::enumerate::enumerate;
use crate::handle::from_handle;
use crate::wave::{Fault, WildAddress};

/// Vendor fault codes of wild addresses: those of causes come before.
const CODE_READ: u64 = 6;
const CODE_WRITE: u64 = 7;

fn address_info(wild: &WildAddress) -> vk::DeviceFaultAddressInfoEXT {
    vk::DeviceFaultAddressInfoEXT {
        address_type: match wild.writes {
            true => vk::DeviceFaultAddressTypeEXT::WRITE_INVALID,
            false => vk::DeviceFaultAddressTypeEXT::READ_INVALID,
        },
        reported_address: wild.address,
        // Known to the byte.
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

/// First the cause, with where that was found, then the wild addresses.
fn vendor_infos(fault: &Fault) -> Vec<vk::DeviceFaultVendorInfoEXT> {
    let (place, depth) = match &fault.at {
        Some(at) => (at.to_string(), at.depth),
        None => (fault.cause.to_string(), 0),
    };
    let cause = vendor_info(&place, fault.cause.code(), u64::from(depth));
    let wild = fault.wild.iter().map(|wild| {
        let code = if wild.writes { CODE_WRITE } else { CODE_READ };
        vendor_info(&wild.place.to_string(), code, wild.address)
    });
    std::iter::once(cause).chain(wild).collect()
}

/// Writes as many as fit, none to a null pointer, and how many those are.
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
    // SAFETY: the caller's promise.
    unsafe { enumerate(count, out, infos.into_iter()) }
}

entry! {
    /// A device that is not lost has nothing to tell.
    fn vkGetDeviceFaultInfoEXT(
        device: vk::Device,
        counts: *mut vk::DeviceFaultCountsEXT,
        info: *mut vk::DeviceFaultInfoEXT,
    ) -> vk::Result {
        let fault = from_handle::<Device>(device).engine.fault();
        let counts = &mut *counts;
        counts.vendor_binary_size = 0;
        let (addresses, vendor) = match &fault {
            Some(fault) => (fault.wild.iter().map(address_info).collect(), vendor_infos(fault)),
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
        // Both are written as far as there is room, whether the other fits or not.
        let wrote = [
            write_infos(addresses, &mut counts.address_info_count, info.p_address_infos),
            write_infos(vendor, &mut counts.vendor_info_count, info.p_vendor_infos),
        ];
        wrote.into_iter().collect()
    }
}
