//! Memory, semaphores and fences that two devices share by file descriptors.
#![cfg(unix)]

use std::ffi::CStr;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd, RawFd};

use ash::khr;
use tuff_tests::*;

const SIZE_BYTES: u64 = 1 << 16;
const EXTENSIONS: [&CStr; 3] = [
    khr::external_memory_fd::NAME,
    khr::external_semaphore_fd::NAME,
    khr::external_fence_fd::NAME,
];

/// A device of its own, with a buffer in memory that it shares.
struct Side {
    device: ash::Device,
    queue: vk::Queue,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    memory_files: khr::external_memory_fd::Device,
    semaphore_files: khr::external_semaphore_fd::Device,
    fence_files: khr::external_fence_fd::Device,
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    semaphore: vk::Semaphore,
}

impl Side {
    /// A side without memory, whose semaphore can be exported as these.
    fn new(gpu: &Gpu, semaphores: vk::ExternalSemaphoreHandleTypeFlags) -> Side {
        let names = EXTENSIONS.map(CStr::as_ptr);
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(gpu.family)
            .queue_priorities(&[1.0])];
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&names);
        let pool_info = vk::CommandPoolCreateInfo::default().queue_family_index(gpu.family);
        let mut shared = vk::ExternalMemoryBufferCreateInfo::default()
            .handle_types(vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD);
        let buffer_info = vk::BufferCreateInfo::default()
            .size(SIZE_BYTES)
            .usage(vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST)
            .push_next(&mut shared);
        let mut exported = vk::ExportSemaphoreCreateInfo::default().handle_types(semaphores);
        let semaphore_info = vk::SemaphoreCreateInfo::default().push_next(&mut exported);
        // SAFETY: what is asked for is there, by `open`.
        unsafe {
            let device = gpu.instance.create_device(gpu.physical, &info, None);
            let device = device.expect("vkCreateDevice");
            let pool = device.create_command_pool(&pool_info, None).unwrap();
            let commands = vk::CommandBufferAllocateInfo::default()
                .command_pool(pool)
                .command_buffer_count(1);
            Side {
                queue: device.get_device_queue(gpu.family, 0),
                pool,
                commands: device.allocate_command_buffers(&commands).unwrap()[0],
                memory_files: khr::external_memory_fd::Device::new(&gpu.instance, &device),
                semaphore_files: khr::external_semaphore_fd::Device::new(&gpu.instance, &device),
                fence_files: khr::external_fence_fd::Device::new(&gpu.instance, &device),
                buffer: device.create_buffer(&buffer_info, None).unwrap(),
                memory: vk::DeviceMemory::null(),
                semaphore: device.create_semaphore(&semaphore_info, None).unwrap(),
                device,
            }
        }
    }

    /// Gives the buffer memory that the host sees: a file's, or new one.
    fn allocate(&mut self, gpu: &Gpu, file: Option<OwnedFd>) {
        let opaque = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
        // SAFETY: handles of this side; the file goes over to the memory.
        unsafe {
            let needs = self.device.get_buffer_memory_requirements(self.buffer);
            let kinds = gpu
                .instance
                .get_physical_device_memory_properties(gpu.physical);
            let wanted =
                vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let kind = (0..kinds.memory_type_count).find(|&kind| {
                needs.memory_type_bits >> kind & 1 == 1
                    && kinds.memory_types[kind as usize]
                        .property_flags
                        .contains(wanted)
            });
            let mut exported = vk::ExportMemoryAllocateInfo::default().handle_types(opaque);
            let mut imported = vk::ImportMemoryFdInfoKHR::default().handle_type(opaque);
            let mut info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(kind.expect("memory that the host sees"));
            info = match &file {
                Some(file) => {
                    imported = imported.fd(file.as_raw_fd());
                    info.push_next(&mut imported)
                }
                None => info.push_next(&mut exported),
            };
            self.memory = self.device.allocate_memory(&info, None).unwrap();
            std::mem::forget(file);
            let bound = self.device.bind_buffer_memory(self.buffer, self.memory, 0);
            bound.unwrap();
        }
    }

    fn memory_file(&self) -> OwnedFd {
        let info = vk::MemoryGetFdInfoKHR::default()
            .memory(self.memory)
            .handle_type(vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD);
        // SAFETY: the memory was allocated to be exported; the file is the caller's.
        unsafe { OwnedFd::from_raw_fd(self.memory_files.get_memory_fd(&info).unwrap()) }
    }

    /// A file of the semaphore; -1 is a sync file that is signaled already.
    fn semaphore_file(&self, kind: vk::ExternalSemaphoreHandleTypeFlags) -> RawFd {
        let info = vk::SemaphoreGetFdInfoKHR::default()
            .semaphore(self.semaphore)
            .handle_type(kind);
        // SAFETY: the semaphore was made to be exported as this.
        unsafe { self.semaphore_files.get_semaphore_fd(&info) }.unwrap()
    }

    fn import_semaphore(&self, file: RawFd, kind: vk::ExternalSemaphoreHandleTypeFlags) {
        let info = vk::ImportSemaphoreFdInfoKHR::default()
            .semaphore(self.semaphore)
            .handle_type(kind)
            .flags(match kind {
                vk::ExternalSemaphoreHandleTypeFlags::SYNC_FD => {
                    vk::SemaphoreImportFlags::TEMPORARY
                }
                _ => vk::SemaphoreImportFlags::empty(),
            })
            .fd(file);
        // SAFETY: the file is of this kind, and goes over to the semaphore.
        unsafe { self.semaphore_files.import_semaphore_fd(&info) }.unwrap();
    }

    /// Fills the buffer with a word, between waiting and signaling.
    fn fill(&self, word: u32, waits: bool, signals: bool, fence: vk::Fence) {
        let semaphores = [self.semaphore];
        let stages = [vk::PipelineStageFlags::ALL_COMMANDS];
        let commands = [self.commands];
        let mut info = vk::SubmitInfo::default().command_buffers(&commands);
        if waits {
            info = info
                .wait_semaphores(&semaphores)
                .wait_dst_stage_mask(&stages);
        }
        if signals {
            info = info.signal_semaphores(&semaphores);
        }
        // SAFETY: the commands are not in use, and everything is of this side.
        unsafe {
            let flags = vk::CommandPoolResetFlags::empty();
            self.device.reset_command_pool(self.pool, flags).unwrap();
            let begin = vk::CommandBufferBeginInfo::default();
            let begun = self.device.begin_command_buffer(self.commands, &begin);
            begun.unwrap();
            (self.device).cmd_fill_buffer(self.commands, self.buffer, 0, SIZE_BYTES, word);
            self.device.end_command_buffer(self.commands).unwrap();
            self.device
                .queue_submit(self.queue, &[info], fence)
                .unwrap();
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
}

impl Drop for Side {
    fn drop(&mut self) {
        // SAFETY: nothing of it is in use after the wait.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_semaphore(self.semaphore, None);
            self.device.destroy_buffer(self.buffer, None);
            self.device.free_memory(self.memory, None);
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
        }
    }
}

/// A device that can share memory, and semaphores by such files.
fn open(kind: vk::ExternalSemaphoreHandleTypeFlags) -> Option<Gpu> {
    Gpu::new().with("external file descriptors", |gpu| {
        // SAFETY: the physical device is of the instance.
        let there = unsafe {
            gpu.instance
                .enumerate_device_extension_properties(gpu.physical)
        };
        let there = there.unwrap();
        let has_extensions = EXTENSIONS.iter().all(|name| {
            let is_it = |it: &vk::ExtensionProperties| {
                it.extension_name_as_c_str().is_ok_and(|it| it == *name)
            };
            there.iter().any(is_it)
        });
        let mut found = vk::ExternalSemaphoreProperties::default();
        let asked = vk::PhysicalDeviceExternalSemaphoreInfo::default().handle_type(kind);
        // SAFETY: the physical device is of the instance.
        unsafe {
            (gpu.instance).get_physical_device_external_semaphore_properties(
                gpu.physical,
                &asked,
                &mut found,
            );
        }
        let both = vk::ExternalSemaphoreFeatureFlags::EXPORTABLE
            | vk::ExternalSemaphoreFeatureFlags::IMPORTABLE;
        has_extensions && found.external_semaphore_features.contains(both)
    })
}

/// One side writes and signals, the other waits and writes over it; both see the same bytes.
fn hands_over(kind: vk::ExternalSemaphoreHandleTypeFlags) {
    let Some(gpu) = open(kind) else { return };
    let (mut one, mut other) = (Side::new(&gpu, kind), Side::new(&gpu, kind));
    one.allocate(&gpu, None);
    other.allocate(&gpu, Some(one.memory_file()));
    let none = vk::Fence::null();
    for round in 0..20 {
        let (first, second) = (0x1000 + round, 0x2000 + round);
        if kind == vk::ExternalSemaphoreHandleTypeFlags::SYNC_FD {
            // A sync file is of a signal that is on its way; taking it resets the semaphore.
            one.fill(first, false, true, none);
            other.import_semaphore(one.semaphore_file(kind), kind);
        } else {
            if round == 0 {
                other.import_semaphore(one.semaphore_file(kind), kind);
            }
            one.fill(first, false, true, none);
        }
        other.fill(second, true, false, none);
        other.holds(second);
        one.holds(second);
    }
}

#[test]
fn opaque_files_hand_memory_over() {
    hands_over(vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD);
}

#[test]
fn sync_files_hand_memory_over() {
    hands_over(vk::ExternalSemaphoreHandleTypeFlags::SYNC_FD);
}

/// A fence's sync file can be waited for by the system's means.
#[test]
fn sync_files_of_fences_can_be_polled() {
    let semaphores = vk::ExternalSemaphoreHandleTypeFlags::SYNC_FD;
    let Some(gpu) = open(semaphores) else {
        return;
    };
    let kind = vk::ExternalFenceHandleTypeFlags::SYNC_FD;
    let mut side = Side::new(&gpu, semaphores);
    side.allocate(&gpu, None);
    let mut exported = vk::ExportFenceCreateInfo::default().handle_types(kind);
    let info = vk::FenceCreateInfo::default().push_next(&mut exported);
    // SAFETY: the fence is of this side, was made to be exported, and is destroyed when it is out
    // of use.
    unsafe {
        let fence = side.device.create_fence(&info, None).unwrap();
        side.fill(7, false, false, fence);
        let info = vk::FenceGetFdInfoKHR::default()
            .fence(fence)
            .handle_type(kind);
        let file = side.fence_files.get_fence_fd(&info).unwrap();
        // -1 is a file that is signaled already.
        if file >= 0 {
            let file = OwnedFd::from_raw_fd(file);
            let mut poll = libc::pollfd {
                fd: file.as_raw_fd(),
                events: libc::POLLIN,
                revents: 0,
            };
            assert_eq!(libc::poll(&raw mut poll, 1, 10_000), 1);
        }
        side.holds(7);
        side.device.destroy_fence(fence, None);
    }
}
