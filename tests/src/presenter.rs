//! Programs that present: an instance with a surface, a device, and frames of given pixels.

use std::ffi::{CStr, c_char};

use ash::{ext, khr, vk};

use crate::has;
use crate::newer::{
    PRESENT_ID_2, PRESENT_TIMING, PhysicalDevicePresentId2FeaturesKHR,
    PhysicalDevicePresentTimingFeaturesEXT, PresentId2KHR, PresentTimingInfoEXT,
    PresentTimingsInfoEXT,
};

/// An instance with a surface and a device that presents to it.
pub struct Presenter {
    pub entry: ash::Entry,
    pub instance: ash::Instance,
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue: vk::Queue,
    pub surfaces: khr::surface::Instance,
    pub surface: vk::SurfaceKHR,
    pub swapchains: khr::swapchain::Device,
    device_extensions: Vec<&'static CStr>,
    pool: vk::CommandPool,
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    mapped: *mut u8,
    acquired: vk::Semaphore,
    drawn: vk::Semaphore,
}

/// Bytes of the largest frame.
const FRAME_BYTES: u64 = 16 << 20;

/// The parameters of a swapchain.
#[derive(Clone, Copy)]
pub struct Chain {
    pub extent: vk::Extent2D,
    pub format: vk::Format,
    pub mode: vk::PresentModeKHR,
    pub count: u32,
    pub alpha: vk::CompositeAlphaFlagsKHR,
    pub scaling: vk::PresentScalingFlagsEXT,
    pub gravity: vk::PresentGravityFlagsEXT,
    pub old: vk::SwapchainKHR,
    /// `VK_SWAPCHAIN_CREATE_PRESENT_TIMING_BIT_EXT`.
    pub is_timed: bool,
}

impl Chain {
    /// Of this extent, shown in order.
    pub fn of(width: u32, height: u32) -> Chain {
        Chain {
            extent: vk::Extent2D { width, height },
            format: vk::Format::B8G8R8A8_UNORM,
            mode: vk::PresentModeKHR::FIFO,
            count: 2,
            alpha: vk::CompositeAlphaFlagsKHR::OPAQUE,
            scaling: vk::PresentScalingFlagsEXT::empty(),
            gravity: vk::PresentGravityFlagsEXT::MIN,
            old: vk::SwapchainKHR::null(),
            is_timed: false,
        }
    }
}

/// The id of a presentation, and its timing request.
#[derive(Clone, Copy, Default)]
pub struct Asked {
    /// 0 is no name.
    pub id: u64,
    pub timing: Option<PresentTimingInfoEXT>,
}

/// Device extensions that tests use where they are there.
const WANTED: [&CStr; 10] = [
    khr::swapchain::NAME,
    ext::device_address_binding_report::NAME,
    ext::swapchain_maintenance1::NAME,
    khr::present_id::NAME,
    khr::present_wait::NAME,
    khr::shared_presentable_image::NAME,
    khr::incremental_present::NAME,
    khr::calibrated_timestamps::NAME,
    PRESENT_ID_2,
    PRESENT_TIMING,
];

impl Presenter {
    /// An instance with the extension of a kind of window, the surface that `make` makes, and a
    /// device; nothing where the driver does not know such windows.
    pub fn new(
        kind: &'static CStr,
        make: impl FnOnce(&ash::Entry, &ash::Instance) -> vk::SurfaceKHR,
    ) -> Option<Presenter> {
        // SAFETY: the structures outlive the calls, and handles are used with what they are of.
        unsafe {
            let entry = ash::Entry::load().unwrap();
            let there = entry.enumerate_instance_extension_properties(None).unwrap();
            let is_there = |name: &CStr| {
                there
                    .iter()
                    .any(|other| other.extension_name_as_c_str() == Ok(name))
            };
            if !has(&kind.to_string_lossy(), is_there(kind)) {
                return None;
            }
            let wanted = [
                khr::surface::NAME,
                kind,
                khr::get_surface_capabilities2::NAME,
                ext::surface_maintenance1::NAME,
                ext::debug_utils::NAME,
            ];
            let names = wanted.into_iter().filter(|name| is_there(name));
            let names: Vec<*const c_char> = names.map(CStr::as_ptr).collect();
            let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
            let info = vk::InstanceCreateInfo::default()
                .application_info(&application)
                .enabled_extension_names(&names);
            let instance = entry.create_instance(&info, None).unwrap();
            let physical = instance.enumerate_physical_devices().unwrap()[0];
            let surface = make(&entry, &instance);
            let surfaces = khr::surface::Instance::new(&entry, &instance);
            let there = instance
                .enumerate_device_extension_properties(physical)
                .unwrap();
            let is_there = |name: &CStr| {
                there
                    .iter()
                    .any(|other| other.extension_name_as_c_str() == Ok(name))
            };
            let device_extensions: Vec<_> =
                WANTED.into_iter().filter(|name| is_there(name)).collect();
            let names: Vec<*const c_char> =
                device_extensions.iter().map(|name| name.as_ptr()).collect();
            let mut maintenance = vk::PhysicalDeviceSwapchainMaintenance1FeaturesEXT::default()
                .swapchain_maintenance1(true);
            let mut ids = vk::PhysicalDevicePresentIdFeaturesKHR::default().present_id(true);
            let mut waits = vk::PhysicalDevicePresentWaitFeaturesKHR::default().present_wait(true);
            let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
            let mut info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&names);
            if is_there(ext::swapchain_maintenance1::NAME) {
                info = info.push_next(&mut maintenance);
            }
            let mut addresses = vk::PhysicalDeviceAddressBindingReportFeaturesEXT::default()
                .report_address_binding(true);
            if is_there(ext::device_address_binding_report::NAME) {
                info = info.push_next(&mut addresses);
            }
            if is_there(khr::present_id::NAME) && is_there(khr::present_wait::NAME) {
                info = info.push_next(&mut ids).push_next(&mut waits);
            }
            let mut ids2 = PhysicalDevicePresentId2FeaturesKHR {
                p_next: info.p_next.cast_mut(),
                present_id2: vk::TRUE,
                ..Default::default()
            };
            let times = PhysicalDevicePresentTimingFeaturesEXT {
                p_next: (&raw mut ids2).cast(),
                present_timing: vk::TRUE,
                present_at_absolute_time: vk::TRUE,
                present_at_relative_time: vk::TRUE,
                ..Default::default()
            };
            if is_there(PRESENT_TIMING) {
                info.p_next = (&raw const times).cast();
            }
            let device = instance.create_device(physical, &info, None).unwrap();
            let pool_info = vk::CommandPoolCreateInfo::default()
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = device.create_command_pool(&pool_info, None).unwrap();
            let info = vk::BufferCreateInfo::default()
                .size(FRAME_BYTES)
                .usage(vk::BufferUsageFlags::TRANSFER_SRC);
            let buffer = device.create_buffer(&info, None).unwrap();
            let needs = device.get_buffer_memory_requirements(buffer);
            let types = instance.get_physical_device_memory_properties(physical);
            let flags =
                vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
            let kind = (0..types.memory_type_count).find(|&index| {
                let property_flags = types.memory_types[index as usize].property_flags;
                needs.memory_type_bits >> index & 1 == 1 && property_flags.contains(flags)
            });
            let info = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(kind.unwrap());
            let memory = device.allocate_memory(&info, None).unwrap();
            device.bind_buffer_memory(buffer, memory, 0).unwrap();
            let mapped = device
                .map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                .unwrap();
            let semaphore = || {
                device
                    .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
                    .unwrap()
            };
            let (acquired, drawn) = (semaphore(), semaphore());
            Some(Presenter {
                queue: device.get_device_queue(0, 0),
                swapchains: khr::swapchain::Device::new(&instance, &device),
                entry,
                physical,
                surfaces,
                surface,
                device_extensions,
                pool,
                buffer,
                memory,
                mapped: mapped.cast(),
                acquired,
                drawn,
                device,
                instance,
            })
        }
    }

    /// Whether the device has an extension; a test that needs it and ends without it says so.
    #[track_caller]
    pub fn extends(&self, name: &CStr) -> bool {
        has(
            &name.to_string_lossy(),
            self.device_extensions.contains(&name),
        )
    }

    /// The capabilities of the surface.
    pub fn capabilities(&self) -> Result<vk::SurfaceCapabilitiesKHR, vk::Result> {
        // SAFETY: handles of this instance.
        unsafe {
            self.surfaces
                .get_physical_device_surface_capabilities(self.physical, self.surface)
        }
    }

    /// The modes of the surface.
    pub fn modes(&self) -> Vec<vk::PresentModeKHR> {
        // SAFETY: handles of this instance.
        unsafe {
            self.surfaces
                .get_physical_device_surface_present_modes(self.physical, self.surface)
                .unwrap()
        }
    }

    /// A swapchain.
    pub fn swapchain(&self, chain: &Chain) -> Result<vk::SwapchainKHR, vk::Result> {
        let mut scaling = vk::SwapchainPresentScalingCreateInfoEXT::default()
            .scaling_behavior(chain.scaling)
            .present_gravity_x(chain.gravity)
            .present_gravity_y(chain.gravity);
        let mut info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface)
            .min_image_count(chain.count)
            .image_format(chain.format)
            .image_color_space(vk::ColorSpaceKHR::SRGB_NONLINEAR)
            .image_extent(chain.extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .pre_transform(vk::SurfaceTransformFlagsKHR::IDENTITY)
            .composite_alpha(chain.alpha)
            .present_mode(chain.mode)
            .old_swapchain(chain.old);
        if !chain.scaling.is_empty() {
            info = info.push_next(&mut scaling);
        }
        if chain.is_timed {
            // And ids by `VkPresentId2KHR`.
            info.flags = vk::SwapchainCreateFlagsKHR::from_raw(1 << 9 | 1 << 6);
        }
        // SAFETY: the surface is of this instance; `info` outlives the call.
        unsafe { self.swapchains.create_swapchain(&info, None) }
    }

    /// Destroys a swapchain that nothing is presented to any more.
    pub fn destroy(&self, swapchain: vk::SwapchainKHR) {
        // SAFETY: the device is idle then.
        unsafe {
            self.device.device_wait_idle().unwrap();
            self.swapchains.destroy_swapchain(swapchain, None);
        }
    }

    /// Makes and destroys so many swapchains, each tenth of which shows a picture, and asserts that
    /// they leave no files open, no thread and no memory behind.
    pub fn assert_nothing_stays(&self, side: u32, pixels: &[u8], rounds: u32) {
        let count = |folder| std::fs::read_dir(folder).unwrap().count();
        let chain = Chain {
            mode: vk::PresentModeKHR::IMMEDIATE,
            ..Chain::of(side, side)
        };
        let now = || {
            (
                count("/proc/self/fd"),
                count("/proc/self/task"),
                resident_bytes(),
            )
        };
        let mut before = now();
        for round in 0..rounds {
            let swapchain = self.swapchain(&chain).unwrap();
            if round % 10 == 0 {
                self.show(swapchain, &chain, pixels);
            }
            self.destroy(swapchain);
            if round == rounds / 4 {
                before = now();
            }
        }
        let (after, most) = (now(), 8 << 20);
        println!("{before:?} files, threads and bytes, then {after:?}");
        // Other tests of this program may have some open, too.
        assert!(after.0 < before.0 + 100 && after.1 < before.1 + 100);
        // A kilobyte and a tenth of each of 7,500.
        assert!(after.2 < before.2 + most);
    }

    /// Presents a picture, which must succeed; the image's index, and whether the swapchain does
    /// not fit well.
    #[track_caller]
    pub fn show(&self, swapchain: vk::SwapchainKHR, chain: &Chain, pixels: &[u8]) -> (u32, bool) {
        self.frame(swapchain, chain.extent, pixels, 0).unwrap()
    }

    /// Acquires an image, copies pixels there that lie as its format has them, and presents it; the
    /// index, and the result.
    pub fn frame(
        &self,
        swapchain: vk::SwapchainKHR,
        extent: vk::Extent2D,
        pixels: &[u8],
        id: u64,
    ) -> Result<(u32, bool), vk::Result> {
        self.timed_frame(swapchain, extent, pixels, Asked { id, timing: None })
    }

    /// The same, with its times asked for.
    pub fn timed_frame(
        &self,
        swapchain: vk::SwapchainKHR,
        extent: vk::Extent2D,
        pixels: &[u8],
        asked: Asked,
    ) -> Result<(u32, bool), vk::Result> {
        // SAFETY: all handles are of this device; the frame before is done with the buffer and the
        // semaphores.
        unsafe {
            self.device.queue_wait_idle(self.queue).unwrap();
            let (index, _) = self.swapchains.acquire_next_image(
                swapchain,
                crate::PATIENCE_NS,
                self.acquired,
                vk::Fence::null(),
            )?;
            assert!(pixels.len() as u64 <= FRAME_BYTES);
            self.mapped.copy_from(pixels.as_ptr(), pixels.len());
            let image = self.swapchains.get_swapchain_images(swapchain)?[index as usize];
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(self.pool)
                .command_buffer_count(1);
            let commands = self.device.allocate_command_buffers(&info)?[0];
            self.record(commands, image, extent)?;
            let (waits, stages) = ([self.acquired], [vk::PipelineStageFlags::TRANSFER]);
            let (buffers, signals) = ([commands], [self.drawn]);
            let submit = vk::SubmitInfo::default()
                .wait_semaphores(&waits)
                .wait_dst_stage_mask(&stages)
                .command_buffers(&buffers)
                .signal_semaphores(&signals);
            self.device
                .queue_submit(self.queue, &[submit], vk::Fence::null())?;
            let result = self.timed_present(swapchain, index, &signals, asked);
            self.device.queue_wait_idle(self.queue).unwrap();
            self.device.free_command_buffers(self.pool, &buffers);
            result.map(|suboptimal| (index, suboptimal))
        }
    }

    /// Presents an image; an id other than 0 names the presentation.
    pub fn present(
        &self,
        swapchain: vk::SwapchainKHR,
        index: u32,
        waits: &[vk::Semaphore],
        id: u64,
    ) -> Result<bool, vk::Result> {
        self.timed_present(swapchain, index, waits, Asked { id, timing: None })
    }

    /// The same, with its times asked for.
    pub fn timed_present(
        &self,
        swapchain: vk::SwapchainKHR,
        index: u32,
        waits: &[vk::Semaphore],
        Asked { id, timing }: Asked,
    ) -> Result<bool, vk::Result> {
        let (swapchains, indices, ids) = ([swapchain], [index], [id]);
        let mut named = vk::PresentIdKHR::default().present_ids(&ids);
        let named2 = PresentId2KHR {
            swapchain_count: 1,
            p_present_ids: ids.as_ptr(),
            ..Default::default()
        };
        let timed = PresentTimingsInfoEXT {
            p_next: (&raw const named2).cast(),
            swapchain_count: 1,
            p_timing_infos: timing.as_ref().map_or(std::ptr::null(), std::ptr::from_ref),
            ..Default::default()
        };
        let mut present = vk::PresentInfoKHR::default()
            .wait_semaphores(waits)
            .swapchains(&swapchains)
            .image_indices(&indices);
        if timing.is_some() {
            present.p_next = (&raw const timed).cast();
        } else if id != 0 {
            present = present.push_next(&mut named);
        }
        // SAFETY: handles of this device; the structures outlive the call.
        unsafe { self.swapchains.queue_present(self.queue, &present) }
    }

    /// # Safety
    /// The handles are alive.
    unsafe fn record(
        &self,
        commands: vk::CommandBuffer,
        image: vk::Image,
        extent: vk::Extent2D,
    ) -> Result<(), vk::Result> {
        let device = &self.device;
        let range = vk::ImageSubresourceRange::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .level_count(1)
            .layer_count(1);
        let barrier = |from, to| {
            vk::ImageMemoryBarrier::default()
                .old_layout(from)
                .new_layout(to)
                .dst_access_mask(vk::AccessFlags::TRANSFER_WRITE)
                .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .image(image)
                .subresource_range(range)
        };
        let layers = vk::ImageSubresourceLayers::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .layer_count(1);
        let copy = vk::BufferImageCopy::default()
            .image_subresource(layers)
            .image_extent(extent.into());
        let stage = vk::PipelineStageFlags::TRANSFER;
        let none = vk::DependencyFlags::empty();
        let written = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        // SAFETY: the caller guarantees that the handles are alive.
        unsafe {
            device.begin_command_buffer(commands, &vk::CommandBufferBeginInfo::default())?;
            let before = barrier(vk::ImageLayout::UNDEFINED, written);
            device.cmd_pipeline_barrier(commands, stage, stage, none, &[], &[], &[before]);
            device.cmd_copy_buffer_to_image(commands, self.buffer, image, written, &[copy]);
            let after = barrier(written, vk::ImageLayout::PRESENT_SRC_KHR);
            device.cmd_pipeline_barrier(commands, stage, stage, none, &[], &[], &[after]);
            device.end_command_buffer(commands)
        }
    }
}

impl Drop for Presenter {
    fn drop(&mut self) {
        // SAFETY: the swapchains are gone.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_semaphore(self.acquired, None);
            self.device.destroy_semaphore(self.drawn, None);
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_buffer(self.buffer, None);
            self.device.free_memory(self.memory, None);
            self.device.destroy_device(None);
            self.surfaces.destroy_surface(self.surface, None);
            self.instance.destroy_instance(None);
        }
    }
}

/// Memory of this process that is there.
fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes: u64 = line.unwrap().replace(" kB", "").trim().parse().unwrap();
    kilobytes << 10
}

/// A picture with no two rows or columns alike: blue, green, red, alpha.
pub fn screen_picture(width: u32, height: u32, seed: u32) -> Vec<u8> {
    (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .flat_map(|(x, y)| {
            [
                (x * 4 + seed) as u8,
                (y * 5) as u8,
                (x ^ y ^ seed) as u8,
                255,
            ]
        })
        .collect()
}

/// The same with red first.
pub fn red_first(pixels: &[u8]) -> Vec<u8> {
    let swap = |pixel: &[u8]| [pixel[2], pixel[1], pixel[0], pixel[3]];
    pixels.chunks_exact(4).flat_map(swap).collect()
}
