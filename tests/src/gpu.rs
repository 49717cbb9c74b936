//! An instance, a device with everything enabled that it has, and what a test makes on it.

use std::cell::RefCell;
use std::ffi::{CStr, c_char, c_void};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ash::{ext, khr, nv, vk};

use crate::has;
use crate::optional::Optional;
use crate::patience::PATIENCE_NS;

/// How long any one test may take before the process is given up.
const TEST_PATIENCE: Duration = Duration::from_secs(1800);

/// Set where the device is to be Tuff's: a loader that reads other variables finds others.
const TUFF_ALONE: &str = "TUFF_UNDER_TEST";

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// A device and everything that a test has made on it, destroyed together at the end.
pub struct Gpu {
    pub entry: ash::Entry,
    pub instance: ash::Instance,
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub family: u32,
    pub queue: vk::Queue,
    /// Another queue of the family, if it has two.
    pub second_queue: Option<vk::Queue>,
    pub pool: vk::CommandPool,
    pub memory: vk::PhysicalDeviceMemoryProperties,
    pub limits: vk::PhysicalDeviceLimits,
    pub acceleration: khr::acceleration_structure::Device,
    pub ray_tracing: khr::ray_tracing_pipeline::Device,
    pub micromaps: ext::opacity_micromap::Device,
    pub nv_ray_tracing: Option<nv::ray_tracing::Device>,
    pub push_descriptor: Option<khr::push_descriptor::Device>,
    pub features: vk::PhysicalDeviceFeatures,
    pub features11: vk::PhysicalDeviceVulkan11Features<'static>,
    pub features12: vk::PhysicalDeviceVulkan12Features<'static>,
    pub features13: vk::PhysicalDeviceVulkan13Features<'static>,
    pub optional: Optional,
    pub pipeline_properties: vk::PhysicalDeviceRayTracingPipelinePropertiesKHR<'static>,
    pub structure_properties: vk::PhysicalDeviceAccelerationStructurePropertiesKHR<'static>,
    /// `accelerationStructureHostCommands`.
    pub has_host_commands: bool,
    /// `accelerationStructureCaptureReplay`, enabled.
    pub replays_structures: bool,
    /// `rayTracingPipelineShaderGroupHandleCaptureReplay`, enabled.
    pub replays_handles: bool,
    debug: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    complaints: Arc<Mutex<Vec<String>>>,
    /// The objects to destroy, oldest first.
    pub(crate) made: RefCell<Vec<Made>>,
    _watchdog: Sender<()>,
}

/// A thing to destroy at the end.
pub(crate) enum Made {
    Memory(vk::DeviceMemory),
    Buffer(vk::Buffer),
    Image(vk::Image),
    View(vk::ImageView),
    BufferView(vk::BufferView),
    Sampler(vk::Sampler),
    SetLayout(vk::DescriptorSetLayout),
    Pool(vk::DescriptorPool),
    Layout(vk::PipelineLayout),
    Pipeline(vk::Pipeline),
    PipelineCache(vk::PipelineCache),
    Module(vk::ShaderModule),
    Structure(vk::AccelerationStructureKHR),
    StructureNv(vk::AccelerationStructureNV),
    Micromap(vk::MicromapEXT),
    RenderPass(vk::RenderPass),
    Framebuffer(vk::Framebuffer),
    QueryPool(vk::QueryPool),
    Shader(vk::ShaderEXT),
}

/// How a device is opened.
#[derive(Clone, Copy, Default)]
struct Opening {
    /// With the validation layer, where it is installed.
    validate: bool,
    /// With the driver's own validation.
    by_driver: bool,
    /// With capture and replay of addresses and of shader group handles.
    replays: bool,
    /// With headless surfaces and swapchains, and with no extension newer than ray tracing.
    presents: bool,
    /// Without an extension that the device has.
    without: Option<&'static CStr>,
}

impl Gpu {
    /// The device, if it has what a test needs.
    #[track_caller]
    pub fn with(self, what: &str, there: impl FnOnce(&Gpu) -> bool) -> Option<Gpu> {
        has(what, there(&self)).then_some(self)
    }

    /// The first device, with validation where it is installed.
    #[expect(clippy::new_without_default, reason = "opening a device is no default")]
    pub fn new() -> Gpu {
        Gpu::open(Opening {
            validate: true,
            ..Opening::default()
        })
    }

    /// The same, with the features of tools that capture addresses and replay them.
    #[track_caller]
    pub fn replaying() -> Option<Gpu> {
        let gpu = Gpu::open(Opening {
            validate: true,
            replays: true,
            ..Opening::default()
        });
        gpu.with("bufferDeviceAddressCaptureReplay", |gpu| {
            gpu.features12.buffer_device_address_capture_replay == vk::TRUE
        })
    }

    /// A device with ray tracing and swapchains of headless surfaces, without later extensions:
    /// tools that are layers pass on only what they know.
    #[track_caller]
    pub fn presenting() -> Option<Gpu> {
        // SAFETY: the loader's initialisers only set up its own state.
        let entry = unsafe { ash::Entry::load() }.expect("there is a Vulkan loader");
        if !has(
            "VK_EXT_headless_surface",
            extends(&entry, ext::headless_surface::NAME),
        ) {
            return None;
        }
        Some(Gpu::open(Opening {
            presents: true,
            ..Opening::default()
        }))
    }

    /// Without the layer, and with the driver's own ray tracing validation
    /// (`VK_NV_ray_tracing_validation`): what that says is in [`Gpu::take_complaints`].
    #[track_caller]
    pub fn validated_by_driver() -> Option<Gpu> {
        let opening = Opening {
            by_driver: true,
            ..Opening::default()
        };
        Gpu::open(opening).with("VK_NV_ray_tracing_validation", |gpu| {
            gpu.optional.driver_validation.ray_tracing_validation == vk::TRUE
        })
    }

    /// The same where the validation layer is of this version or newer: older ones misjudge what
    /// the test does.
    pub fn validated_since(version: u32) -> Gpu {
        // SAFETY: the loader's initialisers only set up its own state.
        let entry = unsafe { ash::Entry::load() }.expect("there is a Vulkan loader");
        let is_new = validation_version(&entry).is_some_and(|found| found >= version);
        Gpu::open(Opening {
            validate: is_new,
            ..Opening::default()
        })
    }

    /// The same for tests that break rules on purpose.
    pub fn without_validation() -> Gpu {
        Gpu::open(Opening::default())
    }

    /// The same without an extension that the device may have.
    pub fn without(extension: &'static CStr) -> Gpu {
        Gpu::open(Opening {
            without: Some(extension),
            ..Opening::default()
        })
    }

    /// The device's name.
    pub fn name(&self) -> String {
        // SAFETY: the physical device is of this instance.
        let properties = unsafe { self.instance.get_physical_device_properties(self.physical) };
        let name = properties.device_name_as_c_str().unwrap_or(c"?");
        name.to_string_lossy().into_owned()
    }

    /// True when the driver under test is Tuff, for tests of behaviour that Vulkan leaves open.
    pub fn is_tuff(&self) -> bool {
        self.name().contains("Tuff")
    }

    /// True when the queue can do what only graphics queues must.
    pub fn has_graphics(&self) -> bool {
        // SAFETY: the physical device is of this instance.
        let families = unsafe {
            self.instance
                .get_physical_device_queue_family_properties(self.physical)
        };
        families[self.family as usize]
            .queue_flags
            .contains(vk::QueueFlags::GRAPHICS)
    }

    fn open(opening: Opening) -> Gpu {
        let Opening {
            validate,
            by_driver,
            replays,
            presents,
            without,
        } = opening;
        // SAFETY: the loader's initialisers only set up its own state.
        let entry = unsafe { ash::Entry::load() }.expect("there is a Vulkan loader");
        let complaints = Arc::new(Mutex::new(Vec::new()));
        let layer = validation_version(&entry).filter(|_| validate);
        let has_layer = layer.is_some();
        let instance = create_instance(&entry, has_layer, presents);
        let debug = (has_layer || by_driver).then(|| listen(&entry, &instance, &complaints));
        // SAFETY: the handles passed are of this instance, and the chains outlive the calls.
        unsafe {
            let physical = instance
                .enumerate_physical_devices()
                .expect("devices can be enumerated")
                .into_iter()
                .next()
                .expect("there is a device");
            let families = instance.get_physical_device_queue_family_properties(physical);
            let family = (families.iter())
                .position(|family| family.queue_flags.contains(vk::QueueFlags::COMPUTE))
                .expect("some queue computes") as u32;
            let queue_count = families[family as usize].queue_count.min(2) as usize;

            let mut features11 = vk::PhysicalDeviceVulkan11Features::default();
            let mut features12 = vk::PhysicalDeviceVulkan12Features::default();
            let mut features13 = vk::PhysicalDeviceVulkan13Features::default();
            let mut structure = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
            let mut pipeline = vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default();
            let mut all = vk::PhysicalDeviceFeatures2::default()
                .push_next(&mut features11)
                .push_next(&mut features12)
                .push_next(&mut features13)
                .push_next(&mut structure)
                .push_next(&mut pipeline);
            instance.get_physical_device_features2(physical, &mut all);
            // Features that change addresses or serve only tools stay off.
            let features = all.features;
            features12.buffer_device_address_multi_device = 0;
            if !replays {
                features12.buffer_device_address_capture_replay = 0;
                structure.acceleration_structure_capture_replay = 0;
                pipeline.ray_tracing_pipeline_shader_group_handle_capture_replay = 0;
            }
            pipeline.ray_tracing_pipeline_shader_group_handle_capture_replay_mixed = 0;

            let offered = instance
                .enumerate_device_extension_properties(physical)
                .expect("extensions can be enumerated");
            let wanted = [
                khr::acceleration_structure::NAME,
                khr::ray_tracing_pipeline::NAME,
                khr::deferred_host_operations::NAME,
                khr::pipeline_library::NAME,
                khr::push_descriptor::NAME,
                nv::ray_tracing::NAME,
                ext::sample_locations::NAME,
            ];
            let has = |name: &CStr| {
                let since = crate::newer::NEWER.iter().find(|newer| newer.0 == name);
                let hidden = since.is_some_and(|since| layer.is_some_and(|layer| layer < since.1))
                    || without == Some(name)
                    || presents && !wanted.contains(&name);
                let mut names = offered.iter().map(|e| e.extension_name_as_c_str());
                !hidden && names.any(|n| n.is_ok_and(|n| n == name))
            };
            let mut optional = Optional::of(&instance, physical, has);
            if !replays {
                optional.heaps.descriptor_heap_capture_replay = vk::FALSE;
            }
            if !by_driver {
                optional.driver_validation.ray_tracing_validation = vk::FALSE;
            }
            let names: Vec<*const c_char> = wanted
                .into_iter()
                .filter(|name| has(name))
                .chain(Optional::names(has))
                .chain(presents.then_some(khr::swapchain::NAME))
                .map(CStr::as_ptr)
                .collect();
            let queues = [vk::DeviceQueueCreateInfo::default()
                .queue_family_index(family)
                .queue_priorities(&[1.0; 2][..queue_count])];
            let (mut f11, mut f12, mut f13) = (features11, features12, features13);
            f11.p_next = std::ptr::null_mut();
            f12.p_next = std::ptr::null_mut();
            f13.p_next = std::ptr::null_mut();
            structure.p_next = std::ptr::null_mut();
            pipeline.p_next = std::ptr::null_mut();
            let mut info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&names)
                .enabled_features(&features)
                .push_next(&mut f11)
                .push_next(&mut f12)
                .push_next(&mut f13);
            if has(khr::acceleration_structure::NAME) {
                info = info.push_next(&mut structure);
            }
            if has(khr::ray_tracing_pipeline::NAME) {
                info = info.push_next(&mut pipeline);
            }
            info.p_next = optional.chain(has, info.p_next);
            let device = instance
                .create_device(physical, &info, None)
                .expect("vkCreateDevice");
            let queue = device.get_device_queue(family, 0);
            let second_queue = (queue_count > 1).then(|| device.get_device_queue(family, 1));
            let pool = vk::CommandPoolCreateInfo::default()
                .queue_family_index(family)
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = device
                .create_command_pool(&pool, None)
                .expect("vkCreateCommandPool");

            let mut pipeline_properties =
                vk::PhysicalDeviceRayTracingPipelinePropertiesKHR::default();
            let mut structure_properties =
                vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
            let mut properties = vk::PhysicalDeviceProperties2::default()
                .push_next(&mut pipeline_properties)
                .push_next(&mut structure_properties);
            instance.get_physical_device_properties2(physical, &mut properties);
            let limits = properties.properties.limits;
            pipeline_properties.p_next = std::ptr::null_mut();
            structure_properties.p_next = std::ptr::null_mut();
            features11.p_next = std::ptr::null_mut();
            features12.p_next = std::ptr::null_mut();
            features13.p_next = std::ptr::null_mut();
            let gpu = Gpu {
                memory: instance.get_physical_device_memory_properties(physical),
                limits,
                acceleration: khr::acceleration_structure::Device::new(&instance, &device),
                ray_tracing: khr::ray_tracing_pipeline::Device::new(&instance, &device),
                micromaps: ext::opacity_micromap::Device::new(&instance, &device),
                nv_ray_tracing: has(nv::ray_tracing::NAME)
                    .then(|| nv::ray_tracing::Device::new(&instance, &device)),
                push_descriptor: has(khr::push_descriptor::NAME)
                    .then(|| khr::push_descriptor::Device::new(&instance, &device)),
                features,
                features11,
                features12,
                features13,
                optional,
                pipeline_properties,
                structure_properties,
                has_host_commands: structure.acceleration_structure_host_commands == vk::TRUE,
                replays_structures: structure.acceleration_structure_capture_replay == vk::TRUE,
                replays_handles: pipeline.ray_tracing_pipeline_shader_group_handle_capture_replay
                    == vk::TRUE,
                entry,
                instance,
                physical,
                device,
                family,
                queue,
                second_queue,
                pool,
                debug,
                complaints,
                made: RefCell::new(Vec::new()),
                _watchdog: watchdog(),
            };
            let name = gpu.name();
            let is_wanted = gpu.is_tuff() || std::env::var_os(TUFF_ALONE).is_none();
            assert!(is_wanted, "the loader found {name}");
            gpu
        }
    }

    /// Records commands into a buffer of the pool.
    pub fn record(&self, record: impl FnOnce(vk::CommandBuffer)) -> vk::CommandBuffer {
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(self.pool)
            .command_buffer_count(1);
        // SAFETY: the pool is of this device; the structures outlive the calls.
        unsafe {
            let commands = self
                .device
                .allocate_command_buffers(&info)
                .expect("a command buffer")[0];
            let begin = vk::CommandBufferBeginInfo::default();
            self.device
                .begin_command_buffer(commands, &begin)
                .expect("vkBeginCommandBuffer");
            record(commands);
            self.device
                .end_command_buffer(commands)
                .expect("vkEndCommandBuffer");
            commands
        }
    }

    /// Records commands between barriers for everything, runs them, and waits for their end.
    pub fn run(&self, record: impl FnOnce(vk::CommandBuffer)) {
        let result = self.try_run(record);
        result.expect("the commands run");
    }

    /// The same, for commands that may lose the device.
    pub fn try_run(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), vk::Result> {
        let commands = self.record(|commands| {
            self.barrier(commands);
            record(commands);
            self.barrier(commands);
        });
        self.submit(commands)
    }

    /// Runs a recorded command buffer and waits for its end.
    pub fn submit(&self, commands: vk::CommandBuffer) -> Result<(), vk::Result> {
        let buffers = [commands];
        let submit = vk::SubmitInfo::default().command_buffers(&buffers);
        // SAFETY: the fence and the commands are of this device, and live until the wait is over.
        unsafe {
            let fence = self
                .device
                .create_fence(&vk::FenceCreateInfo::default(), None)?;
            let ended = self
                .device
                .queue_submit(self.queue, &[submit], fence)
                .and_then(|()| self.device.wait_for_fences(&[fence], true, PATIENCE_NS));
            if ended == Err(vk::Result::TIMEOUT) {
                give_up("the device did not finish");
            }
            self.device.destroy_fence(fence, None);
            ended
        }
    }

    /// A barrier between everything before and everything after.
    pub fn barrier(&self, commands: vk::CommandBuffer) {
        let everything = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        let host = vk::AccessFlags::HOST_READ | vk::AccessFlags::HOST_WRITE;
        let memory = vk::MemoryBarrier::default()
            .src_access_mask(everything)
            .dst_access_mask(everything | host);
        let all = vk::PipelineStageFlags::ALL_COMMANDS;
        // SAFETY: the command buffer is being recorded.
        unsafe {
            self.device.cmd_pipeline_barrier(
                commands,
                all,
                all | vk::PipelineStageFlags::HOST,
                vk::DependencyFlags::empty(),
                &[memory],
                &[],
                &[],
            );
        }
    }

    /// Gives an object a name, where there is `VK_EXT_debug_utils`.
    pub fn name_object<T: vk::Handle>(&self, object: T, name: &CStr) {
        let command = c"vkSetDebugUtilsObjectNameEXT";
        // SAFETY: a plain query.
        let there = unsafe {
            self.instance
                .get_device_proc_addr(self.device.handle(), command.as_ptr())
        };
        if there.is_none() {
            return;
        }
        let info = vk::DebugUtilsObjectNameInfoEXT::default()
            .object_handle(object)
            .object_name(name);
        let debug = ext::debug_utils::Device::new(&self.instance, &self.device);
        // SAFETY: the object is of this device.
        let named = unsafe { debug.set_debug_utils_object_name(&info) };
        named.expect("vkSetDebugUtilsObjectNameEXT");
    }

    /// The messages of the validation layer so far; the list is empty afterwards.
    pub fn take_complaints(&self) -> Vec<String> {
        std::mem::take(
            &mut *self
                .complaints
                .lock()
                .expect("nobody panics with this lock"),
        )
    }

    /// Destroys a pipeline at the end.
    pub fn keep_pipeline(&self, pipeline: vk::Pipeline) {
        self.keep(Made::Pipeline(pipeline));
    }

    pub(crate) fn keep(&self, made: Made) {
        self.made.borrow_mut().push(made);
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        let device = &self.device;
        // SAFETY: everything was made on this device, and is destroyed once, after its users.
        unsafe {
            let _ = device.device_wait_idle();
            for made in self.made.take().into_iter().rev() {
                match made {
                    Made::Memory(it) => device.free_memory(it, None),
                    Made::Buffer(it) => device.destroy_buffer(it, None),
                    Made::Image(it) => device.destroy_image(it, None),
                    Made::View(it) => device.destroy_image_view(it, None),
                    Made::BufferView(it) => device.destroy_buffer_view(it, None),
                    Made::Sampler(it) => device.destroy_sampler(it, None),
                    Made::SetLayout(it) => device.destroy_descriptor_set_layout(it, None),
                    Made::Pool(it) => device.destroy_descriptor_pool(it, None),
                    Made::Layout(it) => device.destroy_pipeline_layout(it, None),
                    Made::Pipeline(it) => device.destroy_pipeline(it, None),
                    Made::PipelineCache(it) => device.destroy_pipeline_cache(it, None),
                    Made::Module(it) => device.destroy_shader_module(it, None),
                    Made::Micromap(it) => {
                        (self.micromaps.fp().destroy_micromap_ext)(
                            device.handle(),
                            it,
                            std::ptr::null(),
                        );
                    }
                    Made::RenderPass(it) => device.destroy_render_pass(it, None),
                    Made::Framebuffer(it) => device.destroy_framebuffer(it, None),
                    Made::Shader(it) => {
                        ext::shader_object::Device::new(&self.instance, device)
                            .destroy_shader(it, None);
                    }
                    Made::QueryPool(it) => device.destroy_query_pool(it, None),
                    Made::StructureNv(it) => self.nv().destroy_acceleration_structure(it, None),
                    Made::Structure(it) => {
                        self.acceleration.destroy_acceleration_structure(it, None);
                    }
                }
            }
            device.destroy_command_pool(self.pool, None);
            device.destroy_device(None);
            if let Some((debug, messenger)) = &self.debug {
                debug.destroy_debug_utils_messenger(*messenger, None);
            }
            self.instance.destroy_instance(None);
        }
        let complaints = self.take_complaints();
        if !std::thread::panicking() && !complaints.is_empty() {
            panic!("validation complains:\n{}", complaints.join("\n"));
        }
    }
}

/// Ends the process: a test hangs, and nothing can be taken back from a device that is busy.
pub(crate) fn give_up(why: &str) -> ! {
    let test = std::thread::current().name().unwrap_or("?").to_string();
    eprintln!("giving up in {test}: {why}");
    std::process::abort();
}

/// Ends the process if the returned end of the channel is not dropped in time.
fn watchdog() -> Sender<()> {
    let (alive, watched) = channel::<()>();
    let test = std::thread::current().name().unwrap_or("?").to_string();
    std::thread::spawn(move || {
        use std::sync::mpsc::RecvTimeoutError::Timeout;
        if watched.recv_timeout(TEST_PATIENCE) == Err(Timeout) {
            eprintln!("giving up: {test} took too long");
            std::process::abort();
        }
    });
    alive
}

/// The version of Vulkan that the validation layer was made for, if it is installed.
fn validation_version(entry: &ash::Entry) -> Option<u32> {
    // SAFETY: a plain query.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    let found = layers.iter().find(|layer| {
        layer
            .layer_name_as_c_str()
            .is_ok_and(|name| name == VALIDATION)
    });
    found.map(|layer| layer.spec_version)
}

/// Whether an instance can have an extension.
fn extends(entry: &ash::Entry, name: &CStr) -> bool {
    // SAFETY: a plain query.
    let offered = unsafe { entry.enumerate_instance_extension_properties(None) };
    let offered = offered.unwrap_or_default();
    let mut names = offered.iter().map(|it| it.extension_name_as_c_str());
    names.any(|it| it == Ok(name))
}

fn create_instance(entry: &ash::Entry, has_layer: bool, presents: bool) -> ash::Instance {
    let application = vk::ApplicationInfo::default()
        .application_name(c"tuff-tests")
        .api_version(vk::API_VERSION_1_3);
    let layers: Vec<*const c_char> = has_layer
        .then_some(VALIDATION.as_ptr())
        .into_iter()
        .collect();
    let debug = extends(entry, ext::debug_utils::NAME).then_some(ext::debug_utils::NAME.as_ptr());
    let surfaces = [khr::surface::NAME, ext::headless_surface::NAME].map(CStr::as_ptr);
    let surfaces = surfaces.into_iter().filter(|_| presents);
    let extensions: Vec<*const c_char> = debug.into_iter().chain(surfaces).collect();
    let info = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&layers)
        .enabled_extension_names(&extensions);
    // SAFETY: `info` outlives the call.
    unsafe { entry.create_instance(&info, None) }.expect("vkCreateInstance")
}

fn listen(
    entry: &ash::Entry,
    instance: &ash::Instance,
    complaints: &Arc<Mutex<Vec<String>>>,
) -> (ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT) {
    let debug = ext::debug_utils::Instance::new(entry, instance);
    // The list outlives the messenger: the `Gpu` holds both.
    let list: *const Mutex<Vec<String>> = Arc::as_ptr(complaints);
    let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
        .message_type(
            vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION
                | vk::DebugUtilsMessageTypeFlagsEXT::GENERAL,
        )
        .pfn_user_callback(Some(complain))
        .user_data(list.cast_mut().cast());
    // SAFETY: the callback keeps to its signature, and its data outlives the messenger.
    let messenger = unsafe { debug.create_debug_utils_messenger(&info, None) };
    (debug, messenger.expect("vkCreateDebugUtilsMessengerEXT"))
}

unsafe extern "system" fn complain(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    list: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the loader passes valid data, and `list` is the mutex that `listen` gave.
    unsafe {
        let text = (*data)
            .message_as_c_str()
            .unwrap_or(c"?")
            .to_string_lossy()
            .into_owned();
        let list = &*list.cast::<Mutex<Vec<String>>>();
        if let Ok(mut list) = list.lock() {
            list.push(text);
        }
    }
    vk::FALSE
}
