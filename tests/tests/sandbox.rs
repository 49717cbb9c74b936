//! Sandboxes: a device starts no thread before there is work, opens no file afterwards, and bears
//! it when threads are refused.
//!
//! System calls are filtered by seccomp(2), each test in a process of its own. Vulkan leaves open
//! what a driver asks the system for, so the filters look only at Tuff: they allow what
//! docs/security.md lists.
#![cfg(all(
    target_os = "linux",
    any(target_arch = "x86_64", target_arch = "aarch64")
))]

use std::ffi::{c_int, c_long, c_void};
use std::io::{Read, Seek};
use std::os::fd::AsRawFd;

use ash::khr;
use tuff_tests::*;

const PAGE: &str = include_str!("../../docs/security.md");

macro_rules! numbers {
    ($($name:ident $number:ident),*) => {
        /// System calls that the page may list, by name.
        const NUMBERS: &[(&str, c_long)] = &[$((stringify!($name), libc::$number)),*];
    };
}

numbers! {
    brk SYS_brk,
    clock_gettime SYS_clock_gettime,
    clock_nanosleep SYS_clock_nanosleep,
    clone SYS_clone,
    clone3 SYS_clone3,
    close SYS_close,
    eventfd2 SYS_eventfd2,
    exit SYS_exit,
    exit_group SYS_exit_group,
    fcntl SYS_fcntl,
    fstat SYS_fstat,
    ftruncate SYS_ftruncate,
    futex SYS_futex,
    getpid SYS_getpid,
    getrandom SYS_getrandom,
    madvise SYS_madvise,
    memfd_create SYS_memfd_create,
    mincore SYS_mincore,
    mmap SYS_mmap,
    mprotect SYS_mprotect,
    mremap SYS_mremap,
    munmap SYS_munmap,
    newfstatat SYS_newfstatat,
    ppoll SYS_ppoll,
    prctl SYS_prctl,
    pread64 SYS_pread64,
    read SYS_read,
    rseq SYS_rseq,
    rt_sigprocmask SYS_rt_sigprocmask,
    rt_sigreturn SYS_rt_sigreturn,
    sched_getaffinity SYS_sched_getaffinity,
    sched_setaffinity SYS_sched_setaffinity,
    sched_yield SYS_sched_yield,
    set_robust_list SYS_set_robust_list,
    sysinfo SYS_sysinfo,
    write SYS_write
}

/// The call that waits for files: ARM64 has only the newer one.
#[cfg(target_arch = "x86_64")]
const POLL: c_long = libc::SYS_poll;
#[cfg(target_arch = "aarch64")]
const POLL: c_long = libc::SYS_ppoll;

/// The system calls that a row of the page lists.
fn listed(row: &str) -> Vec<c_long> {
    let start = format!("| {row} |");
    let line = PAGE.lines().find(|line| line.starts_with(&start));
    let line = line.unwrap_or_else(|| panic!("docs/security.md has no row for {row}"));
    let names = line.split('`').skip(1).step_by(2);
    let number = |name: &str| {
        let mut known = NUMBERS.iter().chain(&[("poll", POLL)]);
        let found = known.find(|known| known.0 == name);
        found
            .unwrap_or_else(|| panic!("{name} is not known here"))
            .1
    };
    names.map(number).collect()
}

/// The filter's answers (`SECCOMP_RET_…`).
const ALLOW: u32 = libc::SECCOMP_RET_ALLOW;
const REFUSE: u32 = libc::SECCOMP_RET_ERRNO | libc::EPERM as u32;
/// A signal, which ends the process.
const END: u32 = libc::SECCOMP_RET_TRAP;

/// Filters the system calls of all threads of the process from now on: the listed ones get
/// `answer`, all others get `otherwise`. False if the system has no such filters.
fn filter(calls: &[c_long], answer: u32, otherwise: u32) -> bool {
    const SET_MODE_FILTER: c_long = 1;
    const ALL_THREADS: c_long = 1;
    let is_equal = (libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K) as u16;
    let give = |answer: u32| step((libc::BPF_RET | libc::BPF_K) as u16, answer, 0);
    // The number is the first word of what a filter sees.
    let mut program = vec![step(
        (libc::BPF_LD | libc::BPF_W | libc::BPF_ABS) as u16,
        0,
        0,
    )];
    for &call in calls {
        program.extend([step(is_equal, call as u32, 1), give(answer)]);
    }
    program.push(give(otherwise));
    let program = libc::sock_fprog {
        len: program.len() as u16,
        filter: program.as_mut_ptr(),
    };
    // SAFETY: the program outlives the call, which copies it.
    unsafe {
        libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
            && libc::syscall(
                libc::SYS_seccomp,
                SET_MODE_FILTER,
                ALL_THREADS,
                &raw const program,
            ) == 0
    }
}

/// An instruction of a filter: one that compares skips `skipped` instructions if its operand
/// differs.
fn step(code: u16, operand: u32, skipped: u8) -> libc::sock_filter {
    libc::sock_filter {
        code,
        jt: 0,
        jf: skipped,
        k: operand,
    }
}

/// Says which system call was not allowed, and ends the process.
extern "C" fn tell(_: c_int, info: *mut libc::siginfo_t, _: *mut c_void) {
    // SAFETY: of a filter's signal, the number stands behind the address of the call (sigaction(2),
    // `si_syscall`); `write` and `_exit` may be called by handlers.
    unsafe {
        let number = *info.cast::<u8>().add(24).cast::<c_int>();
        let mut text = *b"system call    0 is not allowed\n";
        let (mut at, mut rest) = (15, number);
        while rest > 0 && at > 11 {
            text[at] = b'0' + (rest % 10) as u8;
            (at, rest) = (at - 1, rest / 10);
        }
        libc::write(2, text.as_ptr().cast(), text.len());
        libc::_exit(1);
    }
}

/// Allows what the rows of the page list, and nothing else. False if the system has no such
/// filters.
fn enter(rows: &[&str]) -> bool {
    // SAFETY: the handler does what handlers may.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = tell as *const () as usize;
        action.sa_flags = libc::SA_SIGINFO;
        libc::sigaction(libc::SIGSYS, &action, std::ptr::null_mut());
    }
    let mut calls: Vec<c_long> = rows.iter().flat_map(|row| listed(row)).collect();
    // The test's own: with these its threads start and end, and filters are added.
    calls.extend([libc::SYS_gettid, libc::SYS_sigaltstack, libc::SYS_seccomp]);
    filter(&calls, ALLOW, END)
}

/// Refuses to start threads from now on.
fn refuse_threads() -> bool {
    filter(&[libc::SYS_clone, libc::SYS_clone3], REFUSE, ALLOW)
}

/// Runs a test in a process of its own, whose devices have three workers. True in that process.
fn by_itself(test: &str) -> bool {
    // Else glibc's `free` looks at /proc/sys/vm/overcommit_memory when it first gives back memory
    // of a thread that is not the main one, as this test's is (malloc/arena.c).
    let one_heap = ("GLIBC_TUNABLES", "glibc.malloc.arena_max=1");
    alone(test, &[("TUFF_THREADS", "3"), one_heap])
}

/// The threads of this process.
fn threads() -> usize {
    let tasks = std::fs::read_dir("/proc/self/task").expect("Linux");
    tasks.count()
}

/// A device of this driver without layers, which would ask for more.
fn gpu() -> Option<Gpu> {
    let gpu = Gpu::without_validation();
    has("Tuff", gpu.is_tuff()).then_some(gpu)
}

/// Work of every kind that is shared out over workers, with results that are known.
fn work(gpu: &Gpu) {
    compute(gpu);
    copy(gpu);
    trace(gpu);
    if gpu.has_graphics() {
        draw(gpu);
    }
    ask_for_budget(gpu);
}

fn compute(gpu: &Gpu) {
    let count = 1 << 16;
    let output = gpu.buffer(4 * count);
    let set = gpu.set_of(&[output.into()]);
    let kernel = gpu.kernel(
        "layout(local_size_x = 64) in;
        layout(set = 0, binding = 0, std430) buffer O { uint o[]; };
        void main() { o[gl_GlobalInvocationID.x] = gl_GlobalInvocationID.x * 2654435761u; }",
        &[set.layout],
    );
    gpu.dispatch::<u32>(kernel, &[set], &[], [count as u32 / 64, 1, 1]);
    let found: Vec<u32> = output.read();
    let expected = (0..count as u32).map(|index| index.wrapping_mul(2_654_435_761));
    assert!(found.into_iter().eq(expected));
}

/// A copy of an image that is large enough to be shared out.
fn copy(gpu: &Gpu) {
    let uses = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
    let picture = gpu.picture(Shape::flat(vk::Format::R32_UINT, 512, 256), uses);
    let texels: Vec<u32> = (0..512 * 256).map(|index| index * 7 + 3).collect();
    gpu.upload(&picture, 0, &texels);
    assert!(gpu.download(&picture, 0, 4).read::<u32>() == texels);
}

const TRIANGLES: u32 = 6000;

/// Triangles side by side, and how far each is from a ray to it.
fn stairs() -> (Vec<[f32; 3]>, Vec<f32>) {
    let depth = |index: u32| 1.0 + (index % 11) as f32;
    let corners = (0..TRIANGLES).flat_map(|index| {
        let (x, z) = (index as f32, depth(index));
        [[x, 0.0, z], [x + 1.0, 0.0, z], [x, 1.0, z]]
    });
    (corners.collect(), (0..TRIANGLES).map(depth).collect())
}

/// A build on the device, and rays.
fn trace(gpu: &Gpu) {
    let (corners, depths) = stairs();
    let world = gpu.scene(&[Geometry::opaque(&corners)]);
    assert!(gpu.depths(world, TRIANGLES) == depths);
}

/// A pass of many triangles over many tiles.
fn draw(gpu: &Gpu) {
    let canvas = gpu.canvas(RGBA, 256, 256);
    let vertex = "
        void main() {
            int triangle = gl_VertexIndex / 6, corner = gl_VertexIndex % 6;
            ivec2 cell = ivec2(triangle % 64, triangle / 64);
            ivec2 place = ivec2[](ivec2(0), ivec2(1, 0), ivec2(0, 1), ivec2(0, 1), ivec2(1, 0), ivec2(1))[corner];
            gl_Position = vec4(vec2(cell + place) / 32.0 - 1.0, 0.5, 1.0);
        }";
    let pipeline = gpu.painting(&Painting::new(gpu, vertex, WHITE, RGBA));
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.draw_vertices(commands, 64 * 64 * 6);
    });
    assert!(gpu.colors(&canvas) == [[255; 4]; 256 * 256]);
}

/// The machine's free memory is asked for anew each time.
fn ask_for_budget(gpu: &Gpu) {
    let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
    let mut memory = vk::PhysicalDeviceMemoryProperties2::default().push_next(&mut budget);
    // SAFETY: the chain outlives the call.
    unsafe {
        gpu.instance
            .get_physical_device_memory_properties2(gpu.physical, &mut memory);
    }
    assert!(budget.heap_budget[0] > 0);
}

/// A build on the host, by this thread or by an operation that it joins.
fn build_on_host(gpu: &Gpu, is_deferred: bool) -> Structure {
    let (corners, _) = stairs();
    let at = vk::DeviceOrHostAddressConstKHR {
        host_address: corners.as_ptr().cast(),
    };
    let triangles = triangles_at(at, 3 * TRIANGLES);
    let geometry = [geometry_of(triangles).flags(vk::GeometryFlagsKHR::OPAQUE)];
    let level = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
    let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(level)
        .geometries(&geometry);
    let on_host = vk::AccelerationStructureBuildTypeKHR::HOST;
    let sizes = gpu.build_sizes(on_host, &info, &[TRIANGLES]);
    let structure = gpu.empty_structure(level, sizes.acceleration_structure_size);
    let mut scratch = vec![0u8; sizes.build_scratch_size as usize];
    info.scratch_data.host_address = scratch.as_mut_ptr().cast();
    info = info.dst_acceleration_structure(structure.handle);
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(TRIANGLES);
    let ranges = [std::ptr::from_ref(&range)];
    let build = gpu.acceleration.fp().build_acceleration_structures_khr;
    let host = khr::deferred_host_operations::Device::new(&gpu.instance, &gpu.device);
    // SAFETY: what the build reads and writes lives until it is complete.
    unsafe {
        let operation = match is_deferred {
            true => host.create_deferred_operation(None).expect("an operation"),
            false => vk::DeferredOperationKHR::null(),
        };
        let device = gpu.device.handle();
        match build(device, operation, 1, &info, ranges.as_ptr()) {
            vk::Result::OPERATION_DEFERRED_KHR => {
                assert_eq!(host.deferred_operation_join(operation), Ok(()));
                assert_eq!(host.get_deferred_operation_result(operation), Ok(()));
            }
            result => assert_eq!(result, vk::Result::SUCCESS),
        }
        host.destroy_deferred_operation(operation, None);
    }
    structure
}

/// The structure is that of the triangles.
fn check(gpu: &Gpu, bottom: Structure) {
    let world = gpu.top(&[Instance::of(bottom)]);
    assert!(gpu.depths(world, TRIANGLES) == stairs().1);
}

#[test]
fn a_device_starts_its_threads_with_its_first_work() {
    if !by_itself("a_device_starts_its_threads_with_its_first_work") {
        return;
    }
    let Some(gpu) = gpu() else { return };
    // The harness has a thread for each device.
    let before = threads();
    let second = Gpu::without_validation();
    assert_eq!(threads(), before + 1);
    // A few bytes need the queue's thread, and no worker.
    let buffer = gpu.buffer(64);
    assert_eq!(threads(), before + 1);
    gpu.run(|commands| {
        // SAFETY: the buffer outlives the execution.
        unsafe {
            gpu.device
                .cmd_fill_buffer(commands, buffer.handle, 0, 64, 7);
        }
    });
    assert_eq!(threads(), before + 2);
    compute(&gpu);
    assert_eq!(threads(), before + 2 + 3);
    compute(&gpu);
    assert_eq!(threads(), before + 2 + 3);
    drop(second);
}

#[test]
fn work_goes_on_in_a_sandbox() {
    if !by_itself("work_goes_on_in_a_sandbox") {
        return;
    }
    let Some(gpu) = gpu() else { return };
    if !has("seccomp", enter(&["threads", "work"])) {
        return;
    }
    work(&gpu);
    if gpu.has_host_commands {
        check(&gpu, build_on_host(&gpu, false));
        check(&gpu, build_on_host(&gpu, true));
    }
    // Threads that run are enough.
    assert!(refuse_threads());
    work(&gpu);
    if gpu.has_host_commands {
        check(&gpu, build_on_host(&gpu, false));
        check(&gpu, build_on_host(&gpu, true));
    }
}

/// No page becomes executable (`PR_SET_MDWE`, since Linux 6.3): shaders are interpreted, and one
/// line says so.
#[test]
fn refused_code_is_reported_once() {
    if !alone(
        "refused_code_is_reported_once",
        &[("TUFF_TIER", ""), ("TUFF_NATIVE", ""), ("TUFF_LOG", "")],
    ) {
        return;
    }
    #[cfg(target_arch = "x86_64")]
    let has_native_code = is_x86_feature_detected!("avx2");
    #[cfg(not(target_arch = "x86_64"))]
    let has_native_code = false;
    let Some(gpu) = gpu() else { return };
    const SET_MDWE: c_int = 65;
    const REFUSE_EXEC_GAIN: c_long = 1;
    const NONE: c_long = 0;
    // SAFETY: plain numbers.
    let set = unsafe { libc::prctl(SET_MDWE, REFUSE_EXEC_GAIN, NONE, NONE, NONE) };
    // Older processors have no native code, and older kernels no such refusal.
    if !has_native_code || set != 0 {
        return;
    }
    let mut said = std::fs::File::options();
    let path = std::env::temp_dir().join(format!("tuff-refused-{}", std::process::id()));
    let mut said = said
        .read(true)
        .write(true)
        .create_new(true)
        .open(&path)
        .expect("a file");
    std::fs::remove_file(&path).expect("removed");
    // SAFETY: descriptors of this process, which has this one test.
    unsafe {
        let errors = libc::dup(2);
        libc::dup2(said.as_raw_fd(), 2);
        compute(&gpu);
        compute(&gpu);
        libc::dup2(errors, 2);
    }
    let mut text = String::new();
    said.rewind().expect("a file");
    said.read_to_string(&mut text).expect("text");
    let lines: Vec<&str> = text.lines().collect();
    assert!(
        matches!(lines[..], [line] if line.contains("refuses executable pages")),
        "{text}"
    );
}

#[test]
fn memory_and_semaphores_are_shared_in_a_sandbox() {
    if !by_itself("memory_and_semaphores_are_shared_in_a_sandbox") {
        return;
    }
    let Some(gpu) = gpu() else { return };
    let names = [
        khr::external_memory_fd::NAME.as_ptr(),
        khr::external_semaphore_fd::NAME.as_ptr(),
    ];
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(gpu.family)
        .queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&names);
    // SAFETY: Tuff has the extensions.
    let device = unsafe { gpu.instance.create_device(gpu.physical, &info, None) };
    let device = device.expect("vkCreateDevice");
    let memories = khr::external_memory_fd::Device::new(&gpu.instance, &device);
    let semaphores = khr::external_semaphore_fd::Device::new(&gpu.instance, &device);
    let rows = [
        "threads",
        "work",
        "shared memory",
        "shared semaphores and fences",
    ];
    if !has("seccomp", enter(&rows)) {
        return;
    }
    const SIZE_BYTES: u64 = 1 << 16;
    // SAFETY: handles of this device; descriptors go over to what imports them.
    unsafe {
        let opaque = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
        let mut exported = vk::ExportMemoryAllocateInfo::default().handle_types(opaque);
        let allocation = vk::MemoryAllocateInfo::default().allocation_size(SIZE_BYTES);
        let first = device.allocate_memory(&allocation.push_next(&mut exported), None);
        let first = first.expect("memory");
        let asked = vk::MemoryGetFdInfoKHR::default()
            .memory(first)
            .handle_type(opaque);
        let file = memories.get_memory_fd(&asked).expect("a descriptor");
        let mut imported = vk::ImportMemoryFdInfoKHR::default()
            .handle_type(opaque)
            .fd(file);
        let allocation = vk::MemoryAllocateInfo::default().allocation_size(SIZE_BYTES);
        let second = device.allocate_memory(&allocation.push_next(&mut imported), None);
        let second = second.expect("imported memory");
        let word = |memory| {
            let flags = vk::MemoryMapFlags::empty();
            let start = device.map_memory(memory, 0, SIZE_BYTES, flags);
            start.expect("mapped memory").cast::<u32>()
        };
        word(first).write_volatile(7);
        assert_eq!(word(second).read_volatile(), 7);

        let opaque = vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD;
        let mut exported = vk::ExportSemaphoreCreateInfo::default().handle_types(opaque);
        let info = vk::SemaphoreCreateInfo::default();
        let one = device.create_semaphore(&info.push_next(&mut exported), None);
        let (one, other) = (one.unwrap(), device.create_semaphore(&info, None).unwrap());
        let asked = vk::SemaphoreGetFdInfoKHR::default()
            .semaphore(one)
            .handle_type(opaque);
        let file = semaphores.get_semaphore_fd(&asked).expect("a descriptor");
        let import = vk::ImportSemaphoreFdInfoKHR::default()
            .semaphore(other)
            .handle_type(opaque)
            .fd(file);
        semaphores.import_semaphore_fd(&import).expect("imported");
        let (signals, waits) = ([one], [other]);
        let stages = [vk::PipelineStageFlags::ALL_COMMANDS];
        let signal = vk::SubmitInfo::default().signal_semaphores(&signals);
        let wait = vk::SubmitInfo::default()
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages);
        let queue = device.get_device_queue(gpu.family, 0);
        device
            .queue_submit(queue, &[signal, wait], vk::Fence::null())
            .expect("submitted");
        device.device_wait_idle().expect("waited");
        for semaphore in [one, other] {
            device.destroy_semaphore(semaphore, None);
        }
        for memory in [first, second] {
            device.free_memory(memory, None);
        }
        device.destroy_device(None);
    }
}

/// The queue has its thread, and does all of the work on it.
#[test]
fn without_workers_a_queue_works_alone() {
    if !by_itself("without_workers_a_queue_works_alone") {
        return;
    }
    let Some(gpu) = gpu() else { return };
    gpu.run(|_| ());
    let before = threads();
    if !has("seccomp", refuse_threads()) {
        return;
    }
    work(&gpu);
    if gpu.has_host_commands {
        check(&gpu, build_on_host(&gpu, false));
        check(&gpu, build_on_host(&gpu, true));
    }
    assert_eq!(threads(), before);
}

/// Without the queue's thread nothing can be submitted; what the host does itself is done.
#[test]
fn without_threads_submissions_are_refused() {
    if !by_itself("without_threads_submissions_are_refused") {
        return;
    }
    let Some(gpu) = gpu() else { return };
    if !has("seccomp", refuse_threads()) {
        return;
    }
    let refused = gpu.try_run(|_| ());
    assert_eq!(refused, Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY));
    if gpu.has_host_commands {
        build_on_host(&gpu, false);
        build_on_host(&gpu, true);
    }
    let again = gpu.try_run(|_| ());
    assert_eq!(again, Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY));
}
