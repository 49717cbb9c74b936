//! A program that loads the driver's library and unloads it again and again, as loaders do with
//! each instance. No thread and no handle is left behind.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use ash::vk;
use libloading::Library;

const ROUNDS: usize = 1000;
const PATIENCE: Duration = Duration::from_secs(60);
/// Handles that the process itself may open meanwhile.
const FEW: usize = 8;

/// The library, which cargo builds beside the test programs.
fn library() -> PathBuf {
    let program = std::env::current_exe().expect("the program's path");
    program.with_file_name(libloading::library_filename("vulkan_tuff"))
}

#[test]
fn unloaded_drivers_leave_nothing_behind() {
    for is_device_needed in [false, true] {
        // The first round may start what stays for the process.
        round(is_device_needed);
        let before = handles();
        for _ in 0..ROUNDS {
            round(is_device_needed);
        }
        let after = handles();
        assert!(after <= before + FEW, "{before} handles, then {after}");
    }
}

/// Loads the library, uses it and unloads it.
fn round(is_device_needed: bool) {
    let before = threads();
    // SAFETY: the library is the driver, whose symbol has the type of the loader's interface
    // (Khronos' LoaderDriverInterface.md), and all objects are destroyed before it is unloaded.
    unsafe {
        let library = Library::new(library()).expect("the driver loads");
        // Loaders agree on a version first.
        type Negotiate = unsafe extern "system" fn(*mut u32) -> vk::Result;
        let negotiate = *library
            .get::<Negotiate>(b"vk_icdNegotiateLoaderICDInterfaceVersion\0")
            .expect("the loader's interface");
        assert_eq!(negotiate(&mut 7), vk::Result::SUCCESS);
        let get = *library
            .get::<vk::PFN_vkGetInstanceProcAddr>(b"vk_icdGetInstanceProcAddr\0")
            .expect("the loader's interface");
        let entry = ash::Entry::from_static_fn(ash::StaticFn {
            get_instance_proc_addr: get,
        });
        let instance = entry
            .create_instance(&vk::InstanceCreateInfo::default(), None)
            .expect("an instance");
        if is_device_needed {
            use_device(&instance);
        }
        instance.destroy_instance(None);
        expect_threads(before);
        library.close().expect("the driver is unloaded");
    }
}

/// Writes memory from the host and by a queue.
///
/// # Safety
/// The instance is alive.
unsafe fn use_device(instance: &ash::Instance) {
    const SIZE: u64 = 1 << 20;
    let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
    let device_info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
    let buffer_info = vk::BufferCreateInfo::default()
        .size(SIZE)
        .usage(vk::BufferUsageFlags::TRANSFER_DST);
    // SAFETY: the caller's instance; handles are of this device, and its work has ended when they
    // are destroyed.
    unsafe {
        let physical = instance.enumerate_physical_devices().expect("devices")[0];
        let device = instance
            .create_device(physical, &device_info, None)
            .expect("a device");
        let buffer = device.create_buffer(&buffer_info, None).expect("a buffer");
        let needs = device.get_buffer_memory_requirements(buffer);
        let memory_info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(needs.memory_type_bits.trailing_zeros());
        let memory = device.allocate_memory(&memory_info, None).expect("memory");
        device
            .bind_buffer_memory(buffer, memory, 0)
            .expect("a binding");
        let mapped = device.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty());
        let words = mapped.expect("mapped memory").cast::<u32>();
        words.write_volatile(7);
        let pool = device.create_command_pool(&vk::CommandPoolCreateInfo::default(), None);
        let pool = pool.expect("a pool");
        let allocation = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .command_buffer_count(1);
        let commands = device
            .allocate_command_buffers(&allocation)
            .expect("commands");
        device
            .begin_command_buffer(commands[0], &vk::CommandBufferBeginInfo::default())
            .expect("a beginning");
        device.cmd_fill_buffer(commands[0], buffer, 4, vk::WHOLE_SIZE, 9);
        device.end_command_buffer(commands[0]).expect("an end");
        let fence = device.create_fence(&vk::FenceCreateInfo::default(), None);
        let fence = fence.expect("a fence");
        let submit = vk::SubmitInfo::default().command_buffers(&commands);
        let queue = device.get_device_queue(0, 0);
        device
            .queue_submit(queue, &[submit], fence)
            .expect("a submission");
        device
            .wait_for_fences(&[fence], true, PATIENCE.as_nanos() as u64)
            .expect("its end");
        let last = words.add(SIZE as usize / 4 - 1);
        assert_eq!((words.read_volatile(), last.read_volatile()), (7, 9));
        device.destroy_fence(fence, None);
        device.destroy_command_pool(pool, None);
        device.destroy_buffer(buffer, None);
        device.free_memory(memory, None);
        device.destroy_device(None);
    }
}

/// Waits for the system to take threads that have ended off its list.
fn expect_threads(expected: usize) {
    let start = Instant::now();
    while threads() != expected {
        assert!(start.elapsed() < PATIENCE, "{} threads", threads());
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The number of threads of this process.
#[cfg(unix)]
fn threads() -> usize {
    entries("/proc/self/task")
}

/// The number of open file descriptors.
#[cfg(unix)]
fn handles() -> usize {
    entries("/proc/self/fd")
}

#[cfg(unix)]
fn entries(folder: &str) -> usize {
    std::fs::read_dir(folder).expect("a folder").count()
}

/// The number of threads of this process.
#[cfg(windows)]
fn threads() -> usize {
    use windows_sys::Win32::Foundation::CloseHandle;
    use windows_sys::Win32::System::Diagnostics::ToolHelp::{
        CreateToolhelp32Snapshot, TH32CS_SNAPTHREAD, THREADENTRY32, Thread32First, Thread32Next,
    };
    let mut thread = THREADENTRY32 {
        dwSize: size_of::<THREADENTRY32>() as u32,
        ..Default::default()
    };
    let mut count = 0;
    // SAFETY: valid pointers; the structure says how large it is.
    unsafe {
        let snapshot = CreateToolhelp32Snapshot(TH32CS_SNAPTHREAD, 0);
        let mut is_there = Thread32First(snapshot, &mut thread) != 0;
        while is_there {
            count += usize::from(thread.th32OwnerProcessID == std::process::id());
            is_there = Thread32Next(snapshot, &mut thread) != 0;
        }
        CloseHandle(snapshot);
    }
    count
}

/// The number of open handles.
#[cfg(windows)]
fn handles() -> usize {
    use windows_sys::Win32::System::Threading::{GetCurrentProcess, GetProcessHandleCount};
    let mut count = 0;
    // SAFETY: a valid pointer, and the handle of this process.
    unsafe { GetProcessHandleCount(GetCurrentProcess(), &mut count) };
    count as usize
}
