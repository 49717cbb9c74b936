//! `VK_KHR_device_fault`: why a device was lost.

use std::ffi::{CStr, c_char};

use ash::vk;

use crate::Gpu;
use crate::newer::{DeviceFaultDebugInfoKHR, DeviceFaultInfoKHR};

/// `VkDeviceFaultFlagBitsKHR`.
pub mod fault {
    pub const DEVICE_LOST: u32 = 1;
    pub const MEMORY_ADDRESS: u32 = 2;
    pub const VENDOR: u32 = 8;
    pub const WATCHDOG_TIMEOUT: u32 = 16;
    pub const OVERFLOW: u32 = 32;
    pub const ALL: u32 = 63;
}

type Reports =
    unsafe extern "system" fn(vk::Device, u64, *mut u32, *mut DeviceFaultInfoKHR) -> vk::Result;
type DebugInfo = unsafe extern "system" fn(vk::Device, *mut DeviceFaultDebugInfoKHR) -> vk::Result;

/// The commands of a device, for any thread.
#[derive(Clone, Copy)]
pub struct Faults {
    device: vk::Device,
    reports: Reports,
    debug_info: DebugInfo,
}

impl Gpu {
    /// The commands of `VK_KHR_device_fault`.
    pub fn faults(&self) -> Faults {
        let find = |name: &CStr| {
            let look = self.instance.fp_v1_0().get_device_proc_addr;
            // SAFETY: the name ends in a zero.
            let found = unsafe { look(self.device.handle(), name.as_ptr()) };
            found.unwrap_or_else(|| panic!("no {name:?}"))
        };
        // SAFETY: the types are the commands'.
        unsafe {
            Faults {
                device: self.device.handle(),
                reports: std::mem::transmute::<_, Reports>(find(c"vkGetDeviceFaultReportsKHR")),
                debug_info: std::mem::transmute::<_, DebugInfo>(find(
                    c"vkGetDeviceFaultDebugInfoKHR",
                )),
            }
        }
    }
}

impl Faults {
    /// The number of reports there are, which are not taken.
    pub fn count(&self, timeout_ns: u64) -> (u32, vk::Result) {
        let mut count = 77;
        let none = std::ptr::null_mut();
        // SAFETY: without infos the count is asked for.
        let result = unsafe { (self.reports)(self.device, timeout_ns, &mut count, none) };
        (count, result)
    }

    /// Takes reports, at most so many, and checks their form.
    pub fn take(&self, timeout_ns: u64, room: usize) -> (Vec<DeviceFaultInfoKHR>, vk::Result) {
        let mut infos = vec![DeviceFaultInfoKHR::default(); room + 1];
        infos.iter_mut().for_each(|info| info.flags = !0);
        let mut count = room as u32;
        // SAFETY: there is room for as many.
        let result =
            unsafe { (self.reports)(self.device, timeout_ns, &mut count, infos.as_mut_ptr()) };
        assert!(count as usize <= room);
        let past = &infos[count as usize..];
        assert!(past.iter().all(|info| info.flags == !0), "past the count");
        infos.truncate(count as usize);
        for info in &infos {
            assert_eq!(info.flags & !fault::ALL, 0);
            fault_text(&info.description);
            if info.flags & fault::MEMORY_ADDRESS != 0 {
                assert!(info.fault_address_info.address_precision.is_power_of_two());
            }
        }
        (infos, result)
    }

    /// `vkGetDeviceFaultDebugInfoKHR`.
    pub fn debug_info(&self, info: &mut DeviceFaultDebugInfoKHR) -> vk::Result {
        // SAFETY: the caller gave a structure with room for what it says.
        unsafe { (self.debug_info)(self.device, info) }
    }
}

/// Text that ends inside of its array.
pub fn fault_text(chars: &[c_char]) -> String {
    let bytes: Vec<u8> = chars.iter().map(|&c| c.cast_unsigned()).collect();
    let text = CStr::from_bytes_until_nul(&bytes).expect("it ends");
    text.to_str().expect("it is UTF-8").to_owned()
}
