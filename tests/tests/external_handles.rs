//! Memory, semaphores and fences that two devices, or two processes, share by handles of Windows.
#![cfg(windows)]

use std::ffi::CStr;
use std::process::Command;

use ash::khr;
use tuff_tests::*;
use windows_sys::Win32::Foundation::{
    CloseHandle, GENERIC_ALL, GetHandleInformation, HANDLE_FLAG_INHERIT,
};
use windows_sys::Win32::Security::SECURITY_ATTRIBUTES;

const SIZE_BYTES: u64 = 1 << 16;
const EXTENSIONS: [&CStr; 3] = [
    khr::external_memory_win32::NAME,
    khr::external_semaphore_win32::NAME,
    khr::external_fence_win32::NAME,
];
const MEMORY: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_WIN32;
const SEMAPHORE: vk::ExternalSemaphoreHandleTypeFlags =
    vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_WIN32;
const FENCE: vk::ExternalFenceHandleTypeFlags = vk::ExternalFenceHandleTypeFlags::OPAQUE_WIN32;

/// The prefix of names, in the process that a test starts.
const NAMES: &str = "TUFF_TESTS_NAMES";

/// A handle of the application's, closed once.
struct Handle(vk::HANDLE);

impl Handle {
    fn is_inherited(&self) -> bool {
        let mut flags = 0;
        // SAFETY: the handle is open; the call fills the number.
        let done = unsafe { GetHandleInformation(self.0 as _, &mut flags) };
        assert_ne!(done, 0);
        flags & HANDLE_FLAG_INHERIT != 0
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: nothing but this object closes it: an import leaves it to the application.
        let closed = unsafe { CloseHandle(self.0 as _) };
        assert_ne!(closed, 0, "{}", std::io::Error::last_os_error());
    }
}

/// A payload to import.
enum Payload<'a> {
    Handle(&'a Handle),
    Name(&'a [u16]),
}

impl Payload<'_> {
    fn parts(&self) -> (vk::HANDLE, vk::LPCWSTR) {
        match self {
            Payload::Handle(handle) => (handle.0, std::ptr::null()),
            Payload::Name(name) => (0, name.as_ptr()),
        }
    }
}

/// A name as Windows has it, of this process alone unless `of` says which.
fn name(of: &str, what: &str) -> Vec<u16> {
    format!("{of} {what}\0").encode_utf16().collect()
}

fn own_names(test: &str) -> String {
    format!("tuff tests {} {test}", std::process::id())
}

/// How exported objects are to be shared.
#[derive(Clone, Copy, Default)]
struct Asked<'a> {
    attributes: Option<&'a SECURITY_ATTRIBUTES>,
    access: u32,
    name: Option<&'a [u16]>,
}

impl Asked<'_> {
    fn attributes(&self) -> *const vk::SECURITY_ATTRIBUTES {
        (self.attributes).map_or(std::ptr::null(), |it| std::ptr::from_ref(it).cast())
    }

    fn name(&self) -> vk::LPCWSTR {
        self.name.map_or(std::ptr::null(), <[u16]>::as_ptr)
    }
}

/// A device of its own, with a buffer in memory that it shares.
struct Side<'a> {
    gpu: &'a Gpu,
    device: ash::Device,
    queue: vk::Queue,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    memory_handles: khr::external_memory_win32::Device,
    semaphore_handles: khr::external_semaphore_win32::Device,
    fence_handles: khr::external_fence_win32::Device,
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
}

impl<'a> Side<'a> {
    /// A side without memory.
    fn new(gpu: &'a Gpu) -> Side<'a> {
        let names = EXTENSIONS.map(CStr::as_ptr);
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(gpu.family)
            .queue_priorities(&[1.0])];
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&names);
        let pool_info = vk::CommandPoolCreateInfo::default().queue_family_index(gpu.family);
        let mut shared = vk::ExternalMemoryBufferCreateInfo::default().handle_types(MEMORY);
        let buffer_info = vk::BufferCreateInfo::default()
            .size(SIZE_BYTES)
            .usage(vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST)
            .push_next(&mut shared);
        // SAFETY: the device has all of this, by `open`.
        unsafe {
            let device = gpu.instance.create_device(gpu.physical, &info, None);
            let device = device.expect("vkCreateDevice");
            let pool = device.create_command_pool(&pool_info, None).unwrap();
            let commands = vk::CommandBufferAllocateInfo::default()
                .command_pool(pool)
                .command_buffer_count(1);
            Side {
                gpu,
                queue: device.get_device_queue(gpu.family, 0),
                pool,
                commands: device.allocate_command_buffers(&commands).unwrap()[0],
                memory_handles: khr::external_memory_win32::Device::new(&gpu.instance, &device),
                semaphore_handles: khr::external_semaphore_win32::Device::new(
                    &gpu.instance,
                    &device,
                ),
                fence_handles: khr::external_fence_win32::Device::new(&gpu.instance, &device),
                buffer: device.create_buffer(&buffer_info, None).unwrap(),
                memory: vk::DeviceMemory::null(),
                device,
            }
        }
    }

    /// Memory that the host sees: a payload's, or new memory to share.
    fn memory_of(
        &self,
        payload: Option<Payload<'_>>,
        asked: Asked<'_>,
    ) -> Result<vk::DeviceMemory, vk::Result> {
        let gpu = self.gpu;
        let mut exported = vk::ExportMemoryAllocateInfo::default().handle_types(MEMORY);
        let mut how = vk::ExportMemoryWin32HandleInfoKHR::default();
        how.p_attributes = asked.attributes();
        how.dw_access = asked.access;
        how.name = asked.name();
        let mut imported = vk::ImportMemoryWin32HandleInfoKHR::default().handle_type(MEMORY);
        // SAFETY: handles of this side.
        unsafe {
            let needs = self.device.get_buffer_memory_requirements(self.buffer);
            let kinds = gpu
                .instance
                .get_physical_device_memory_properties(gpu.physical);
            let wanted =
                vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let kind = (0..kinds.memory_type_count).find(|&kind| {
                let flags = kinds.memory_types[kind as usize].property_flags;
                needs.memory_type_bits >> kind & 1 == 1 && flags.contains(wanted)
            });
            let mut info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(kind.expect("memory that the host sees"));
            info = match payload {
                Some(payload) => {
                    (imported.handle, imported.name) = payload.parts();
                    info.push_next(&mut imported)
                }
                None if asked.access == 0 => info.push_next(&mut exported),
                None => info.push_next(&mut exported).push_next(&mut how),
            };
            self.device.allocate_memory(&info, None)
        }
    }

    /// Gives the buffer memory.
    fn allocate(&mut self, payload: Option<Payload<'_>>, asked: Asked<'_>) {
        self.memory = self.memory_of(payload, asked).unwrap();
        // SAFETY: handles of this side; the memory is as large as the buffer needs.
        let bound = unsafe { self.device.bind_buffer_memory(self.buffer, self.memory, 0) };
        bound.unwrap();
    }

    fn memory_handle(&self) -> Handle {
        let info = vk::MemoryGetWin32HandleInfoKHR::default()
            .memory(self.memory)
            .handle_type(MEMORY);
        // SAFETY: the memory was allocated to be exported; the handle is the caller's.
        Handle(unsafe { self.memory_handles.get_memory_win32_handle(&info) }.unwrap())
    }

    /// A semaphore that can be exported; the caller destroys it.
    fn semaphore(&self, asked: Asked<'_>) -> vk::Semaphore {
        let mut exported = vk::ExportSemaphoreCreateInfo::default().handle_types(SEMAPHORE);
        let mut how = vk::ExportSemaphoreWin32HandleInfoKHR::default();
        how.p_attributes = asked.attributes();
        how.dw_access = asked.access;
        how.name = asked.name();
        let mut info = vk::SemaphoreCreateInfo::default().push_next(&mut exported);
        if asked.access != 0 {
            info = info.push_next(&mut how);
        }
        // SAFETY: the structures outlive the call.
        unsafe { self.device.create_semaphore(&info, None) }.unwrap()
    }

    fn semaphore_handle(&self, semaphore: vk::Semaphore) -> Handle {
        let info = vk::SemaphoreGetWin32HandleInfoKHR::default()
            .semaphore(semaphore)
            .handle_type(SEMAPHORE);
        // SAFETY: the semaphore was made to be exported; the handle is the caller's.
        Handle(unsafe { self.semaphore_handles.get_semaphore_win32_handle(&info) }.unwrap())
    }

    fn import_semaphore(
        &self,
        semaphore: vk::Semaphore,
        payload: &Payload<'_>,
        flags: vk::SemaphoreImportFlags,
    ) {
        let mut info = vk::ImportSemaphoreWin32HandleInfoKHR::default()
            .semaphore(semaphore)
            .flags(flags)
            .handle_type(SEMAPHORE);
        (info.handle, info.name) = payload.parts();
        // SAFETY: the payload is of this kind.
        unsafe { self.semaphore_handles.import_semaphore_win32_handle(&info) }.unwrap();
    }

    /// Fills the buffer with a word, between waiting and signaling.
    fn fill(
        &self,
        word: u32,
        waits: Option<vk::Semaphore>,
        signals: Option<vk::Semaphore>,
        fence: vk::Fence,
    ) {
        let stages = [vk::PipelineStageFlags::ALL_COMMANDS];
        let commands = [self.commands];
        let (waits, signals) = (Vec::from_iter(waits), Vec::from_iter(signals));
        let info = vk::SubmitInfo::default()
            .command_buffers(&commands)
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages[..waits.len()])
            .signal_semaphores(&signals);
        // SAFETY: the commands are not in use, and everything is of this side.
        unsafe {
            let flags = vk::CommandPoolResetFlags::empty();
            self.device.device_wait_idle().unwrap();
            self.device.reset_command_pool(self.pool, flags).unwrap();
            let begin = vk::CommandBufferBeginInfo::default();
            let begun = self.device.begin_command_buffer(self.commands, &begin);
            begun.unwrap();
            (self.device).cmd_fill_buffer(self.commands, self.buffer, 0, SIZE_BYTES, word);
            self.device.end_command_buffer(self.commands).unwrap();
            let submitted = self.device.queue_submit(self.queue, &[info], fence);
            submitted.unwrap();
        }
    }

    /// Fails unless the buffer is full of this word.
    #[track_caller]
    fn holds(&self, word: u32) {
        // SAFETY: the memory is as long, visible to the host, and not written now.
        unsafe {
            self.device.device_wait_idle().unwrap();
            let flags = vk::MemoryMapFlags::empty();
            let words = self.device.map_memory(self.memory, 0, SIZE_BYTES, flags);
            let words = words.unwrap().cast::<u32>();
            let words = std::slice::from_raw_parts(words, SIZE_BYTES as usize / 4);
            assert!(words.iter().all(|&found| found == word), "{word:#x}");
            self.device.unmap_memory(self.memory);
        }
    }

    /// Destroys semaphores that no work uses.
    fn destroy(&self, semaphores: &[vk::Semaphore]) {
        // SAFETY: of this side, and idle after the wait.
        unsafe {
            self.device.device_wait_idle().unwrap();
            for &semaphore in semaphores {
                self.device.destroy_semaphore(semaphore, None);
            }
        }
    }
}

impl Drop for Side<'_> {
    fn drop(&mut self) {
        // SAFETY: nothing of it is in use after the wait.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_buffer(self.buffer, None);
            self.device.free_memory(self.memory, None);
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
        }
    }
}

/// A device that can share all of them by handles.
fn open() -> Option<Gpu> {
    Gpu::new().with("external handles of Windows", |gpu| {
        // SAFETY: the physical device is of the instance.
        unsafe {
            let instance = &gpu.instance;
            let there = instance.enumerate_device_extension_properties(gpu.physical);
            let there = there.unwrap();
            let has_extensions = EXTENSIONS.iter().all(|name| {
                let is_it = |it: &vk::ExtensionProperties| {
                    it.extension_name_as_c_str().is_ok_and(|it| it == *name)
                };
                there.iter().any(is_it)
            });
            let mut semaphores = vk::ExternalSemaphoreProperties::default();
            let asked = vk::PhysicalDeviceExternalSemaphoreInfo::default().handle_type(SEMAPHORE);
            instance.get_physical_device_external_semaphore_properties(
                gpu.physical,
                &asked,
                &mut semaphores,
            );
            let mut fences = vk::ExternalFenceProperties::default();
            let asked = vk::PhysicalDeviceExternalFenceInfo::default().handle_type(FENCE);
            instance.get_physical_device_external_fence_properties(
                gpu.physical,
                &asked,
                &mut fences,
            );
            has_extensions
                && semaphores.external_semaphore_features
                    == vk::ExternalSemaphoreFeatureFlags::EXPORTABLE
                        | vk::ExternalSemaphoreFeatureFlags::IMPORTABLE
                && fences.external_fence_features
                    == vk::ExternalFenceFeatureFlags::EXPORTABLE
                        | vk::ExternalFenceFeatureFlags::IMPORTABLE
        }
    })
}

/// One side writes and signals, the other waits and writes over it; both see the same bytes.
#[test]
fn handles_hand_memory_over() {
    let Some(gpu) = open() else { return };
    let (mut one, mut other) = (Side::new(&gpu), Side::new(&gpu));
    one.allocate(None, Asked::default());
    let handle = one.memory_handle();
    assert!(!handle.is_inherited());
    other.allocate(Some(Payload::Handle(&handle)), Asked::default());
    // An import has a reference of its own.
    drop(handle);
    let (signaled, waited) = (
        one.semaphore(Asked::default()),
        other.semaphore(Asked::default()),
    );
    let handle = one.semaphore_handle(signaled);
    let payload = Payload::Handle(&handle);
    other.import_semaphore(waited, &payload, vk::SemaphoreImportFlags::empty());
    drop(handle);
    for round in 0..20 {
        let (first, second) = (0x1000 + round, 0x2000 + round);
        one.fill(first, None, Some(signaled), vk::Fence::null());
        other.fill(second, Some(waited), None, vk::Fence::null());
        other.holds(second);
        one.holds(second);
    }
    one.destroy(&[signaled]);
    other.destroy(&[waited]);
    // The memory lives as long as one side has it.
    drop(one);
    other.holds(0x2013);
    let mut third = Side::new(&gpu);
    let handle = other.memory_handle_of_import();
    third.allocate(Some(Payload::Handle(&handle)), Asked::default());
    third.holds(0x2013);
}

impl Side<'_> {
    /// "exportFromImportedHandleTypes" has the type.
    fn memory_handle_of_import(&self) -> Handle {
        let mut found = vk::ExternalBufferProperties::default();
        let asked = vk::PhysicalDeviceExternalBufferInfo::default()
            .usage(vk::BufferUsageFlags::TRANSFER_SRC)
            .handle_type(MEMORY);
        // SAFETY: the physical device is of the instance.
        unsafe {
            (self.gpu.instance).get_physical_device_external_buffer_properties(
                self.gpu.physical,
                &asked,
                &mut found,
            );
        }
        let found = found.external_memory_properties;
        assert!(found.export_from_imported_handle_types.contains(MEMORY));
        self.memory_handle()
    }
}

/// A temporary import lasts for one wait; then the semaphore's own payload is back.
#[test]
fn temporary_payloads_last_for_one_wait() {
    let Some(gpu) = open() else { return };
    let (mut one, mut other) = (Side::new(&gpu), Side::new(&gpu));
    one.allocate(None, Asked::default());
    other.allocate(None, Asked::default());
    let (signaled, own) = (
        one.semaphore(Asked::default()),
        other.semaphore(Asked::default()),
    );
    let handle = one.semaphore_handle(signaled);
    let (temporary, none) = (vk::SemaphoreImportFlags::TEMPORARY, vk::Fence::null());
    other.import_semaphore(own, &Payload::Handle(&handle), temporary);
    one.fill(1, None, Some(signaled), none);
    other.fill(2, Some(own), None, none);
    other.holds(2);
    // Its own payload was not signaled by `one`.
    other.fill(3, None, Some(own), none);
    other.fill(4, Some(own), None, none);
    other.holds(4);
    one.destroy(&[signaled]);
    other.destroy(&[own]);
}

#[test]
fn fences_are_shared_and_reset() {
    let Some(gpu) = open() else { return };
    let (mut one, other) = (Side::new(&gpu), Side::new(&gpu));
    one.allocate(None, Asked::default());
    let fence = |side: &Side<'_>| {
        let mut exported = vk::ExportFenceCreateInfo::default().handle_types(FENCE);
        let info = vk::FenceCreateInfo::default().push_next(&mut exported);
        // SAFETY: the structures outlive the call.
        unsafe { side.device.create_fence(&info, None) }.unwrap()
    };
    let (first, second) = (fence(&one), fence(&other));
    let info = vk::FenceGetWin32HandleInfoKHR::default()
        .fence(first)
        .handle_type(FENCE);
    // SAFETY: the fences are alive, of their devices, and destroyed when they are out of use.
    unsafe {
        let handle = Handle(one.fence_handles.get_fence_win32_handle(&info).unwrap());
        let import = |flags| {
            let info = vk::ImportFenceWin32HandleInfoKHR::default()
                .fence(second)
                .flags(flags)
                .handle_type(FENCE)
                .handle(handle.0);
            let imported = other.fence_handles.import_fence_win32_handle(&info);
            imported.unwrap();
        };
        let is_signaled = |side: &Side<'_>, fence| side.device.get_fence_status(fence).unwrap();
        import(vk::FenceImportFlags::TEMPORARY);
        one.fill(7, None, None, first);
        let waited = (other.device).wait_for_fences(&[second], true, PATIENCE_NS);
        waited.unwrap();
        // Resetting ends a temporary import, and leaves that payload as it is.
        other.device.reset_fences(&[second]).unwrap();
        assert!(is_signaled(&one, first) && !is_signaled(&other, second));
        import(vk::FenceImportFlags::empty());
        assert!(is_signaled(&other, second));
        one.device.device_wait_idle().unwrap();
        other.device.reset_fences(&[second]).unwrap();
        assert!(!is_signaled(&one, first) && !is_signaled(&other, second));
        one.device.destroy_fence(first, None);
        other.device.destroy_fence(second, None);
    }
}

#[test]
fn attributes_say_who_inherits_and_names_are_taken_once() {
    let Some(gpu) = open() else { return };
    let names = own_names("attributes");
    let (memory, semaphore) = (name(&names, "memory"), name(&names, "semaphore"));
    let attributes = SECURITY_ATTRIBUTES {
        nLength: size_of::<SECURITY_ATTRIBUTES>() as u32,
        lpSecurityDescriptor: std::ptr::null_mut(),
        bInheritHandle: 1,
    };
    let asked = |name| Asked {
        attributes: Some(&attributes),
        access: GENERIC_ALL,
        name: Some(name),
    };
    let (mut one, mut other) = (Side::new(&gpu), Side::new(&gpu));
    one.allocate(None, asked(&memory));
    let shared = one.semaphore(asked(&semaphore));
    assert!(one.memory_handle().is_inherited());
    assert!(one.semaphore_handle(shared).is_inherited());
    let refused = other.memory_of(None, asked(&memory)).err();
    assert_eq!(refused, Some(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE));
    other.allocate(Some(Payload::Name(&memory)), Asked::default());
    one.fill(5, None, None, vk::Fence::null());
    one.holds(5);
    other.holds(5);
    one.destroy(&[shared]);
}

/// Rights that are too few for a driver do not keep others from importing: "must ensure the access
/// rights allow read and write access to the memory", where an application asks for nothing.
#[test]
fn handles_with_few_rights_are_imported() {
    const READ: u32 = 1 << 31;
    let Some(gpu) = open() else { return };
    let asked = Asked {
        access: READ,
        ..Asked::default()
    };
    let (mut one, mut other) = (Side::new(&gpu), Side::new(&gpu));
    one.allocate(None, asked);
    let handle = one.memory_handle();
    other.allocate(Some(Payload::Handle(&handle)), Asked::default());
    other.fill(6, None, None, vk::Fence::null());
    other.holds(6);
    one.holds(6);
}

/// Another process finds memory and semaphores by their names, waits, reads, writes and signals.
#[test]
fn processes_share_by_names() {
    let Some(gpu) = open() else { return };
    let test = "processes_share_by_names";
    let parent = std::env::var(NAMES).ok();
    let names = parent.clone().unwrap_or_else(|| own_names(test));
    let [memory, there, back] = ["memory", "there", "back"].map(|what| name(&names, what));
    let mut side = Side::new(&gpu);
    let none = vk::Fence::null();
    if parent.is_some() {
        side.allocate(Some(Payload::Name(&memory)), Asked::default());
        let semaphores = [&there, &back].map(|name| {
            let semaphore = side.semaphore(Asked::default());
            let flags = vk::SemaphoreImportFlags::empty();
            side.import_semaphore(semaphore, &Payload::Name(name), flags);
            semaphore
        });
        side.holds(0x11);
        side.fill(0x22, Some(semaphores[0]), Some(semaphores[1]), none);
        side.holds(0x22);
        side.destroy(&semaphores);
        return;
    }
    let asked = |name| Asked {
        access: GENERIC_ALL,
        name: Some(name),
        ..Asked::default()
    };
    side.allocate(None, asked(&memory));
    let semaphores = [&there, &back].map(|name| side.semaphore(asked(name)));
    side.fill(0x11, None, Some(semaphores[0]), none);
    side.holds(0x11);
    let program = std::env::current_exe().expect("this program lies somewhere");
    let status = Command::new(program)
        .args(["--exact", test, "--nocapture"])
        .env(NAMES, &names)
        .status();
    assert!(status.expect("it starts again").success());
    side.holds(0x22);
    side.fill(0x33, Some(semaphores[1]), None, none);
    side.holds(0x33);
    side.destroy(&semaphores);
}

/// Vulkan leaves open what happens: Tuff refuses what is no payload.
#[test]
fn other_handles_and_names_are_refused() {
    let Some(gpu) = Gpu::surviving() else { return };
    let mut side = Side::new(&gpu);
    side.allocate(None, Asked::default());
    let semaphore = side.semaphore(Asked::default());
    let (section, event) = (side.memory_handle(), side.semaphore_handle(semaphore));
    let invalid = Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE);
    let missing = name("tuff tests", "no such name");
    let import_semaphore = |payload: &Payload<'_>| {
        let mut info = vk::ImportSemaphoreWin32HandleInfoKHR::default()
            .semaphore(semaphore)
            .handle_type(SEMAPHORE);
        (info.handle, info.name) = payload.parts();
        // SAFETY: what is no event is refused.
        unsafe { (side.semaphore_handles).import_semaphore_win32_handle(&info) }
    };
    let import_memory =
        |payload: Payload<'_>| side.memory_of(Some(payload), Asked::default()).map(drop);
    assert_eq!(import_memory(Payload::Handle(&event)), invalid);
    assert_eq!(import_semaphore(&Payload::Handle(&section)), invalid);
    assert_eq!(import_memory(Payload::Name(&missing)), invalid);
    assert_eq!(import_semaphore(&Payload::Name(&missing)), invalid);
    for number in [0, -1, -2, 0x7fff_fff0] {
        // Not to be closed.
        let handle = std::mem::ManuallyDrop::new(Handle(number));
        assert_eq!(import_memory(Payload::Handle(&handle)), invalid, "{number}");
        let refused = import_semaphore(&Payload::Handle(&handle));
        assert_eq!(refused, invalid, "{number}");
    }
    side.destroy(&[semaphore]);
}
