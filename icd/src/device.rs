//! Devices.

use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;
use rspirv::spirv::Capability;
use spirv_jit::abort::Aborts;

use crate::VkResult;
use crate::capabilities::extensions::{Extension, ExtensionSet};
use crate::capabilities::features;
use crate::capabilities::limits::max_allocations;
use crate::execute::{Engine, EngineOptions};
use crate::handle::{self, Ref};
use crate::object::PhysicalDevice;
use crate::object::addressed::AddressReport;
use crate::object::memory::AddressWindow;
use crate::object::messenger::Messengers;
use crate::object::private_data::PrivateData;
use crate::object::shader_stage::Compiler;
use crate::queue::Queue;
use crate::settings;
use crate::validate::Validator;

crate::handle::handled!(Device => Device);

/// A logical device.
pub struct Device {
    /// The version of Vulkan that the application asked for.
    pub api_version: u32,
    /// Of the device and of its instance.
    pub extensions: ExtensionSet,
    pub messengers: Arc<Messengers>,
    /// Capabilities that shader modules may declare.
    pub capabilities: Vec<Capability>,
    /// Executes commands on the device and on the host: workers, waiting, device loss. Shared with
    /// the queues' threads.
    pub engine: Arc<Engine>,
    pub window: Arc<AddressWindow>,
    /// The feature `sparseBinding` is enabled: memory must be fit for it.
    pub sparse_binding: bool,
    pub queues: Vec<Ref<Queue>>,
    /// Creation flags of the queues.
    pub queue_flags: vk::DeviceQueueCreateFlags,
    pub private_data: Mutex<PrivateData>,
    /// Where the feature `reportAddressBinding` is enabled.
    pub address_report: Option<AddressReport>,
}

/// Features that change how a device works.
#[derive(Clone, Copy, Debug, Default)]
pub struct Enabled {
    pub sparse_binding: bool,
    pub ray_tracing_validation: bool,
    pub device_fault: bool,
    pub shader_abort: bool,
    pub report_address_binding: bool,
    pub depth_clamp_zero_one: bool,
    pub heap_capture_replay: bool,
    /// Creation flags of the queues. Queues synchronize themselves with any flags.
    pub queue_flags: vk::DeviceQueueCreateFlags,
}

impl Device {
    /// The settings that shaders are compiled with.
    pub fn compiler(&self) -> Compiler<'_> {
        Compiler {
            capabilities: &self.capabilities,
            newer_capabilities: features::NEWER_CAPABILITIES,
            messengers: &self.messengers,
            // A program that a cache has from a device without validation says nothing of
            // alignment.
            checks_alignment: self.validator().is_some(),
            // The older extension has no such mode: its queries always look at micromaps.
            micromaps_by_mode: self.extensions.contains(Extension::KHR_OPACITY_MICROMAP)
                && !self.extensions.contains(Extension::EXT_OPACITY_MICROMAP),
            keeps_modules: false,
            samplers: &self.engine.heap_samplers,
        }
    }

    /// Validation, where it is on.
    pub fn validator(&self) -> Option<&Validator> {
        self.engine.options.validator.as_deref()
    }

    /// A device with `queue_count` queues. It starts no thread: queues and workers start theirs
    /// with the first work that needs them.
    ///
    /// # Errors
    /// Address space that the system does not give; `VK_ERROR_INITIALIZATION_FAILED` where the
    /// environment asks for what there is not.
    pub fn new(
        physical: &PhysicalDevice,
        extensions: ExtensionSet,
        queue_count: u32,
        enabled: Enabled,
    ) -> VkResult<Self> {
        let settings = settings::checked().map_err(|message| {
            physical.messengers.error(c"TUFF-settings", message);
            vk::Result::ERROR_INITIALIZATION_FAILED
        })?;
        log::info!(
            "{}, version {}: a device, with {} MiB of memory at most",
            physical.name(),
            env!("CARGO_PKG_VERSION"),
            physical.heap_bytes >> 20
        );
        // Read now: a sandbox that is entered after this may refuse to open files.
        max_allocations();
        let window = AddressWindow::reserve(physical.heap_bytes)?;
        let validates = enabled.ray_tracing_validation || settings.validate;
        let validator =
            validates.then(|| Arc::new(Validator::new(Arc::clone(&physical.messengers))));
        let aborts = enabled.shader_abort.then(Aborts::new).transpose();
        let aborts = aborts.map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        let engine = Engine::new(
            physical.thread_count,
            Arc::clone(&physical.messengers),
            Arc::clone(&window.live),
            EngineOptions {
                validator,
                aborts: aborts.map(Arc::new),
                wild_addresses: enabled.device_fault,
                clamps_to_one: enabled.depth_clamp_zero_one
                    && !extensions.contains(Extension::EXT_DEPTH_RANGE_UNRESTRICTED),
                serializes_blocks: extensions.contains(Extension::KHR_OPACITY_MICROMAP),
                replays_heaps: enabled.heap_capture_replay,
                ..EngineOptions::default()
            },
        );
        let queue = |index| handle::new(Queue::new(index, Arc::clone(&engine)));
        Ok(Self {
            api_version: physical.api_version,
            extensions: extensions.union(&physical.instance_extensions),
            messengers: Arc::clone(&physical.messengers),
            capabilities: features::capabilities(),
            queues: (0..queue_count).map(queue).collect(),
            queue_flags: enabled.queue_flags,
            engine,
            window,
            sparse_binding: enabled.sparse_binding,
            private_data: Mutex::default(),
            address_report: (enabled.report_address_binding)
                .then(|| AddressReport::new(Arc::clone(&physical.messengers))),
        })
    }
}

impl Drop for Device {
    /// Ends the queues' threads and the workers: when the device is gone, no code of this library
    /// runs on a thread of its own.
    fn drop(&mut self) {
        self.engine.shut_down();
        for queue in &self.queues {
            queue.close();
        }
        crate::trace::stats::print();
    }
}
