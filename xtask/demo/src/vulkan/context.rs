//! An instance, a device that traces rays, and one queue of it.

use std::ffi::{CStr, c_char};
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use ash::{khr, vk};

/// Everything that lives as long as the program.
pub struct Context {
    pub instance: ash::Instance,
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue: vk::Queue,
    /// The queue's family.
    pub family: u32,
    pub pool: vk::CommandPool,
    pub acceleration: khr::acceleration_structure::Device,
    pub ray_tracing: khr::ray_tracing_pipeline::Device,
    pub memory: vk::PhysicalDeviceMemoryProperties,
    /// The device's name.
    pub name: String,
    pub group_handle_size: u32,
    pub group_handle_alignment: u32,
    pub group_base_alignment: u32,
    pub scratch_alignment: u32,
    /// Whether the queue draws.
    pub draws: bool,
    /// The library with the functions: unloaded last.
    pub entry: ash::Entry,
}

/// The features that a program needs besides ray tracing.
#[derive(Clone, Copy, Default)]
pub struct Wish<'w> {
    /// A queue that draws, and ray queries.
    pub draws: bool,
    /// The instance extensions for windows, if there is to be a window: swapchains come with them.
    pub windows: &'w [&'w CStr],
}

/// How long to wait for any one piece of work.
pub const PATIENCE_NS: u64 = 600_000_000_000;

/// The file name of the Vulkan loader.
const LOADER: &str = match cfg!(windows) {
    true => "vulkan-1.dll",
    false => "libvulkan.so.1",
};

const EXTENSIONS: [&CStr; 3] = [
    khr::acceleration_structure::NAME,
    khr::ray_tracing_pipeline::NAME,
    khr::deferred_host_operations::NAME,
];

impl Context {
    /// Starts Vulkan through the system's loader or, where there is none, with `driver` alone.
    pub fn new(driver: Option<&Path>, wish: Wish) -> Result<Context> {
        let entry = open(driver)?;
        let application = vk::ApplicationInfo::default()
            .application_name(c"demo")
            .engine_name(c"demo")
            .api_version(vk::API_VERSION_1_3);
        let windows: Vec<*const c_char> = wish.windows.iter().map(|name| name.as_ptr()).collect();
        let info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_extension_names(&windows);
        // SAFETY: `info` and what it points to outlive the call.
        let instance = unsafe { entry.create_instance(&info, None) }.context("vkCreateInstance")?;
        let (physical, family) = choose(&instance, wish)?;
        let device = create_device(&instance, physical, family, wish)?;
        // SAFETY: the device has this one queue, and the structures outlive the calls.
        let (queue, pool) = unsafe {
            let pool = vk::CommandPoolCreateInfo::default()
                .queue_family_index(family)
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            (
                device.get_device_queue(family, 0),
                device.create_command_pool(&pool, None)?,
            )
        };
        let mut pipeline = vk::PhysicalDeviceRayTracingPipelinePropertiesKHR::default();
        let mut structure = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut pipeline)
            .push_next(&mut structure);
        // SAFETY: `physical` is of this instance.
        let memory = unsafe {
            instance.get_physical_device_properties2(physical, &mut properties);
            instance.get_physical_device_memory_properties(physical)
        };
        let name = properties.properties.device_name_as_c_str().unwrap_or(c"?");
        Ok(Context {
            name: name.to_string_lossy().into_owned(),
            acceleration: khr::acceleration_structure::Device::new(&instance, &device),
            ray_tracing: khr::ray_tracing_pipeline::Device::new(&instance, &device),
            memory,
            group_handle_size: pipeline.shader_group_handle_size,
            group_handle_alignment: pipeline.shader_group_handle_alignment,
            group_base_alignment: pipeline.shader_group_base_alignment,
            draws: wish.draws,
            scratch_alignment: structure.min_acceleration_structure_scratch_offset_alignment,
            instance,
            physical,
            device,
            queue,
            family,
            pool,
            entry,
        })
    }

    /// Records commands, runs them and waits for their end.
    pub fn run(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<()> {
        let device = &self.device;
        // SAFETY: the buffer and the fence are of this device, and are freed only after the wait.
        unsafe {
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(self.pool)
                .command_buffer_count(1);
            let commands = device.allocate_command_buffers(&info)?[0];
            let begin = vk::CommandBufferBeginInfo::default()
                .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(commands, &begin)?;
            record(commands);
            device.end_command_buffer(commands)?;
            let fence = device.create_fence(&vk::FenceCreateInfo::default(), None)?;
            let buffers = [commands];
            let submit = vk::SubmitInfo::default().command_buffers(&buffers);
            device.queue_submit(self.queue, &[submit], fence)?;
            let waited = device.wait_for_fences(&[fence], true, PATIENCE_NS);
            waited.context("waiting for the device")?;
            device.destroy_fence(fence, None);
            device.free_command_buffers(self.pool, &buffers);
        }
        Ok(())
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // SAFETY: every other object borrowed this context and is gone.
        unsafe {
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

fn open(driver: Option<&Path>) -> Result<ash::Entry> {
    // SAFETY: the loader's initialisers only set up its own state.
    if let Ok(entry) = unsafe { ash::Entry::load() } {
        return Ok(entry);
    }
    match driver {
        Some(library) => open_driver(library),
        None => bail!("there is no Vulkan loader ({LOADER}), and no driver was given"),
    }
}

/// Talks to a driver as the loader would: agrees on an interface version, and asks it for
/// everything else by name.
fn open_driver(path: &Path) -> Result<ash::Entry> {
    type Negotiate = unsafe extern "system" fn(*mut u32) -> vk::Result;
    // SAFETY: the library is a Vulkan driver: its symbols have the types of the loader's interface
    // (Khronos' LoaderDriverInterface.md), and it stays loaded for ever.
    unsafe {
        let library = libloading::Library::new(path)
            .with_context(|| format!("loading {}", path.display()))?;
        let library = Box::leak(Box::new(library));
        let negotiate: libloading::Symbol<Negotiate> =
            library.get(b"vk_icdNegotiateLoaderICDInterfaceVersion\0")?;
        let mut version = 5;
        ensure!(
            negotiate(&mut version) == vk::Result::SUCCESS,
            "the driver is of another age"
        );
        let get: libloading::Symbol<vk::PFN_vkGetInstanceProcAddr> =
            library.get(b"vk_icdGetInstanceProcAddr\0")?;
        Ok(ash::Entry::from_static_fn(ash::StaticFn {
            get_instance_proc_addr: *get,
        }))
    }
}

/// The first device with all that is needed, and a queue family of it that computes, and draws if
/// it is to.
fn choose(instance: &ash::Instance, wish: Wish) -> Result<(vk::PhysicalDevice, u32)> {
    let draws = wish.draws;
    let wanted = match draws {
        true => vk::QueueFlags::COMPUTE | vk::QueueFlags::GRAPHICS,
        false => vk::QueueFlags::COMPUTE,
    };
    // SAFETY: the handles come from this instance.
    unsafe {
        let devices = instance
            .enumerate_physical_devices()
            .context("looking for devices")?;
        for physical in devices {
            let has = instance.enumerate_device_extension_properties(physical)?;
            let names: Vec<&CStr> = has
                .iter()
                .filter_map(|e| e.extension_name_as_c_str().ok())
                .collect();
            let version = instance
                .get_physical_device_properties(physical)
                .api_version;
            let family = instance
                .get_physical_device_queue_family_properties(physical)
                .iter()
                .position(|family| family.queue_flags.contains(wanted));
            if let Some(family) = family
                && extensions(wish).all(|extension| names.contains(&extension))
                && (!draws || version >= vk::API_VERSION_1_3)
            {
                return Ok((physical, family as u32));
            }
        }
    }
    match draws {
        _ if !wish.windows.is_empty() => bail!(
            "no Vulkan 1.3 device here draws and has VK_KHR_ray_tracing_pipeline, VK_KHR_ray_query and VK_KHR_swapchain"
        ),
        true => bail!(
            "no Vulkan 1.3 device here draws and has VK_KHR_ray_tracing_pipeline and VK_KHR_ray_query"
        ),
        false => bail!("no Vulkan device here has VK_KHR_ray_tracing_pipeline"),
    }
}

/// The device extensions.
fn extensions(wish: Wish) -> impl Iterator<Item = &'static CStr> {
    let drawing = wish.draws.then_some(khr::ray_query::NAME);
    let windows = (!wish.windows.is_empty()).then_some(khr::swapchain::NAME);
    EXTENSIONS.into_iter().chain(drawing).chain(windows)
}

fn create_device(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    family: u32,
    wish: Wish,
) -> Result<ash::Device> {
    let mut core = vk::PhysicalDeviceVulkan12Features::default()
        .buffer_device_address(true)
        .descriptor_indexing(true)
        .runtime_descriptor_array(true)
        .shader_sampled_image_array_non_uniform_indexing(true)
        .timeline_semaphore(true);
    let mut structure =
        vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(true);
    let mut pipeline =
        vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default().ray_tracing_pipeline(true);
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(family)
        .queue_priorities(&[1.0])];
    let extensions: Vec<*const c_char> = extensions(wish).map(CStr::as_ptr).collect();
    let mut rendering =
        vk::PhysicalDeviceDynamicRenderingFeatures::default().dynamic_rendering(true);
    let mut queries = vk::PhysicalDeviceRayQueryFeaturesKHR::default().ray_query(true);
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .push_next(&mut core)
        .push_next(&mut structure)
        .push_next(&mut pipeline);
    if wish.draws {
        info = info.push_next(&mut rendering).push_next(&mut queries);
    }
    // SAFETY: `info` and what it points to outlive the call.
    unsafe { instance.create_device(physical, &info, None) }.context("vkCreateDevice")
}
