//! `VK_KHR_device_fault`: reports of how a device was lost, each of which is returned once. What
//! they tell is left to drivers: of others than Tuff only their form is checked.

use std::ffi::c_void;
use std::time::{Duration, Instant};

use tuff_tests::fault::{DEVICE_LOST, MEMORY_ADDRESS, OVERFLOW, VENDOR, WATCHDOG_TIMEOUT};
use tuff_tests::newer::{
    DeviceFaultDebugInfoKHR, DeviceFaultInfoKHR, PhysicalDeviceFaultPropertiesKHR,
};
use tuff_tests::*;

/// An endless loop for the driver, which cannot know the buffer.
const SPIN: &str = r"
layout(set = 0, binding = 0) buffer Data { uint data[]; };
void main() {
    while (data[0] == 0) { data[1] = data[1] + 1; }
    data[2] = 1;
}";

const LOST: Result<(), vk::Result> = Err(vk::Result::ERROR_DEVICE_LOST);

/// A device that a test may lose.
fn open() -> Option<Gpu> {
    Gpu::without_validation().with("VK_KHR_device_fault", |gpu| {
        gpu.optional.fault_khr.device_fault == vk::TRUE
    })
}

/// Runs a shader over a buffer of words, the first of which are given.
fn run(gpu: &Gpu, source: &str, words: &[u64]) -> Result<(), vk::Result> {
    let data = gpu.buffer_with(words);
    let set = gpu.set_of(&[data.into()]);
    let kernel = gpu.kernel(source, &[set.layout]);
    gpu.try_run(|commands| gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], [1, 1, 1]))
}

/// A shader that reads at as many invalid addresses, each by an instruction of its own, and then
/// runs for ever.
fn wild(accesses: u64) -> String {
    let reads: String = (0..accesses)
        .map(|i| format!("sum += Word(wild[0] + {}ul).word;\n", 16 * i))
        .collect();
    format!(
        "layout(buffer_reference, buffer_reference_align = 4) buffer Word {{ uint word; }};
        layout(set = 0, binding = 0) buffer Data {{ uint64_t wild[]; }};
        void main() {{
            uint sum = 0;
            {reads}
            while (wild[2] == 0) wild[3] = wild[3] + sum;
        }}"
    )
}

#[test]
fn at_least_one_report_is_kept() {
    let Some(gpu) = open() else { return };
    assert!(most(&gpu) >= 1);
}

fn most(gpu: &Gpu) -> u32 {
    let mut faults = PhysicalDeviceFaultPropertiesKHR::default();
    let mut properties = vk::PhysicalDeviceProperties2 {
        p_next: (&raw mut faults).cast(),
        ..Default::default()
    };
    // SAFETY: the chain is the structure above.
    unsafe { (gpu.instance).get_physical_device_properties2(gpu.physical, &mut properties) };
    faults.max_device_fault_count
}

/// Without a fault the command waits as long as it is told to.
#[test]
fn a_device_that_is_not_lost_has_no_reports() {
    let Some(gpu) = open() else { return };
    assert_eq!(gpu.faults().count(0), (0, vk::Result::TIMEOUT));
    let start = Instant::now();
    let (infos, result) = gpu.faults().take(20_000_000, 2);
    assert_eq!((infos.len(), result), (0, vk::Result::TIMEOUT));
    assert!(start.elapsed() >= Duration::from_millis(19));
}

/// The last report says that the device is lost; then there are none, and nothing to wait for.
#[test]
fn a_hang_is_reported_once() {
    if !alone("a_hang_is_reported_once", &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    assert_eq!(run(&gpu, SPIN, &[0; 4]), LOST);
    let (there, result) = gpu.faults().count(u64::MAX);
    assert_eq!(result, vk::Result::SUCCESS);
    assert!((1..=most(&gpu)).contains(&there));
    assert_eq!(
        gpu.faults().count(0),
        (there, vk::Result::SUCCESS),
        "a count takes nothing"
    );
    let (none, result) = gpu.faults().take(0, 0);
    assert_eq!((none.len(), result), (0, vk::Result::INCOMPLETE));
    let (infos, result) = gpu.faults().take(0, there as usize + 3);
    assert_eq!((infos.len() as u32, result), (there, vk::Result::SUCCESS));
    let (last, others) = infos.split_last().unwrap();
    assert_ne!(last.flags & DEVICE_LOST, 0);
    assert!(others.iter().all(|info| info.flags & DEVICE_LOST == 0));
    if gpu.is_tuff() {
        assert_eq!(last.flags, DEVICE_LOST | VENDOR | WATCHDOG_TIMEOUT);
        assert_eq!(last.vendor_info.vendor_fault_code, 1);
        assert!(fault_text(&last.description).contains("TUFF_TIMEOUT"));
        assert_eq!(gpu.faults().count(u64::MAX), (0, vk::Result::SUCCESS));
        let (none, result) = gpu.faults().take(u64::MAX, 4);
        assert_eq!((none.len(), result), (0, vk::Result::SUCCESS));
    }
}

/// A thread that waits hears of the loss when it happens.
#[test]
fn a_thread_may_wait_for_a_fault() {
    if !alone("a_thread_may_wait_for_a_fault", &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let faults = gpu.faults();
    std::thread::scope(|scope| {
        let waiting = scope.spawn(move || {
            let (infos, result) = faults.take(u64::MAX, 99);
            let is_lost = infos.iter().any(|info| info.flags & DEVICE_LOST != 0);
            (is_lost, result)
        });
        assert_eq!(run(&gpu, SPIN, &[0; 4]), LOST);
        let (is_lost, result) = waiting.join().unwrap();
        assert_eq!((is_lost, result), (true, vk::Result::SUCCESS));
    });
}

/// Invalid addresses come before the loss, in their order and with its group; each call continues
/// where the one before ended.
#[test]
fn invalid_addresses_are_reported_in_order() {
    if !alone(
        "invalid_addresses_are_reported_in_order",
        &[("TUFF_TIMEOUT", "1")],
    ) {
        return;
    }
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a driver that goes on", Gpu::is_tuff) else {
        return;
    };
    let start = 0x1230;
    assert_eq!(run(&gpu, &wild(3), &[start, 0, 0, 0]), LOST);
    assert_eq!(gpu.faults().count(0), (4, vk::Result::SUCCESS));
    let (first, result) = gpu.faults().take(0, 1);
    assert_eq!(result, vk::Result::INCOMPLETE);
    let (rest, result) = gpu.faults().take(0, 3);
    assert_eq!(result, vk::Result::SUCCESS);
    let infos = [first, rest].concat();
    for (info, address) in infos[..3].iter().zip((start..).step_by(16)) {
        assert_eq!(info.flags, MEMORY_ADDRESS | VENDOR);
        let told = &info.fault_address_info;
        assert_eq!(told.reported_address, address);
        assert_eq!(
            told.address_type,
            vk::DeviceFaultAddressTypeEXT::READ_INVALID
        );
        assert_eq!(told.address_precision, 1);
        let vendor = &info.vendor_info;
        assert_eq!(
            (vendor.vendor_fault_code, vendor.vendor_fault_data),
            (6, address)
        );
        assert!(fault_text(&info.description).contains(&format!("{address:#x}")));
    }
    assert!(infos.iter().all(|info| info.group_id == infos[0].group_id));
    assert_eq!(infos[3].flags, DEVICE_LOST | VENDOR | WATCHDOG_TIMEOUT);
}

/// Where more addresses were invalid than are kept, the first report says so, and the latest are
/// there.
#[test]
fn lost_reports_are_told() {
    if !alone("lost_reports_are_told", &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a driver that goes on", Gpu::is_tuff) else {
        return;
    };
    let (kept, more) = (u64::from(most(&gpu)) - 1, 3);
    let start = 0x1000;
    assert_eq!(run(&gpu, &wild(kept + more), &[start, 0, 0, 0]), LOST);
    let (infos, result) = gpu.faults().take(0, 100);
    assert_eq!(
        (infos.len() as u32, result),
        (most(&gpu), vk::Result::SUCCESS)
    );
    assert_eq!(infos[0].flags, MEMORY_ADDRESS | VENDOR | OVERFLOW);
    let first = infos[0].fault_address_info.reported_address;
    assert_eq!(first, start + 16 * more);
    assert!(infos[1..].iter().all(|info| info.flags & OVERFLOW == 0));
    // The older command tells the same, with the number.
    let Some(gpu) = gpu.with("VK_EXT_device_fault", |gpu| {
        gpu.optional.fault.device_fault == vk::TRUE
    }) else {
        return;
    };
    let api = ash::ext::device_fault::Device::new(&gpu.instance, &gpu.device);
    let mut vendor = vec![vk::DeviceFaultVendorInfoEXT::default(); 100];
    let mut counts = vk::DeviceFaultCountsEXT::default().vendor_info_count(100);
    let mut info = vk::DeviceFaultInfoEXT {
        p_vendor_infos: vendor.as_mut_ptr(),
        ..Default::default()
    };
    // SAFETY: there is room for what the counts say.
    let result = unsafe {
        (api.fp().get_device_fault_info_ext)(gpu.device.handle(), &mut counts, &mut info)
    };
    // The addresses found no room.
    assert_eq!(result, vk::Result::INCOMPLETE);
    let last = &vendor[counts.vendor_info_count as usize - 1];
    assert_eq!((last.vendor_fault_code, last.vendor_fault_data), (8, more));
}

/// Threads that ask at the same time share the reports.
#[test]
fn each_report_goes_to_one_thread() {
    if !alone("each_report_goes_to_one_thread", &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    assert_eq!(run(&gpu, &wild(40), &[0x1000, 0, 0, 0]), LOST);
    let (all, _) = gpu.faults().count(0);
    let faults = gpu.faults();
    let taken: Vec<DeviceFaultInfoKHR> = std::thread::scope(|scope| {
        let ask = move || {
            let mut mine = Vec::new();
            loop {
                let (infos, _) = faults.take(0, 1);
                if infos.is_empty() {
                    return mine;
                }
                mine.extend(infos.iter().map(|info| Sent(*info)));
            }
        };
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(ask)).collect();
        let each = threads
            .into_iter()
            .flat_map(|thread| thread.join().unwrap());
        each.map(|sent| sent.0).collect()
    });
    assert_eq!(taken.len() as u32, all);
    let mut addresses: Vec<u64> = (taken.iter())
        .filter(|info| info.flags & MEMORY_ADDRESS != 0)
        .map(|info| info.fault_address_info.reported_address)
        .collect();
    addresses.sort_unstable();
    let count = addresses.len();
    addresses.dedup();
    assert_eq!(addresses.len(), count);
}

/// A report, whose chain is empty.
struct Sent(DeviceFaultInfoKHR);

// SAFETY: its pointer is null.
unsafe impl Send for Sent {}

/// The feature of vendor binaries is off: there is none, and none is written.
#[test]
fn there_is_no_vendor_binary() {
    if !alone("there_is_no_vendor_binary", &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    assert_eq!(run(&gpu, SPIN, &[0; 4]), LOST);
    let mut bytes = [0xa5u8; 256];
    for data in [std::ptr::null_mut(), bytes.as_mut_ptr().cast::<c_void>()] {
        let mut info = DeviceFaultDebugInfoKHR {
            vendor_binary_size: 256,
            p_vendor_binary_data: data,
            ..Default::default()
        };
        let result = gpu.faults().debug_info(&mut info);
        assert_eq!((result, info.vendor_binary_size), (vk::Result::SUCCESS, 0));
        assert_eq!(info.p_vendor_binary_data, data);
    }
    assert_eq!(bytes, [0xa5; 256]);
}

/// To a child of its process a device is lost for a reason of its own, whatever the parent has
/// asked before.
#[cfg(unix)]
#[test]
fn a_child_has_a_report_of_its_own() {
    unsafe extern "C" {
        fn fork() -> i32;
        fn _exit(code: i32) -> !;
        fn waitpid(child: i32, status: *mut i32, options: i32) -> i32;
    }
    if !alone("a_child_has_a_report_of_its_own", &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a driver that promises this", Gpu::is_tuff) else {
        return;
    };
    let child = || {
        // SAFETY: the child asks, and ends without running anything else of the test's.
        unsafe {
            let child = fork();
            if child == 0 {
                let (infos, result) = gpu.faults().take(u64::MAX, 4);
                let told = result == vk::Result::SUCCESS
                    && infos.len() == 1
                    && infos[0].flags == DEVICE_LOST | VENDOR
                    && infos[0].vendor_info.vendor_fault_code == 5;
                let (none, result) = gpu.faults().take(u64::MAX, 4);
                let over = none.is_empty() && result == vk::Result::SUCCESS;
                _exit(if told && over { 7 } else { 8 });
            }
            let mut status = 0;
            assert_eq!(waitpid(child, &mut status, 0), child);
            assert_eq!(status, 7 << 8, "how the child ended");
        }
    };
    child();
    assert_eq!(
        gpu.faults().count(0),
        (0, vk::Result::TIMEOUT),
        "the parent's device is not lost"
    );
    assert_eq!(run(&gpu, &wild(2), &[0x1000, 0, 0, 0]), LOST);
    let (first, _) = gpu.faults().take(0, 1);
    assert_eq!(first[0].fault_address_info.reported_address, 0x1000);
    child();
    let (rest, result) = gpu.faults().take(0, 4);
    assert_eq!((rest.len(), result), (2, vk::Result::SUCCESS));
}
