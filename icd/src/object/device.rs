//! Devices.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;
use parking_lot::Mutex;
use rspirv::spirv::Capability;
use spirv_jit::image::{Dim, Format, ImageDescriptor, Level, SamplerDescriptor};

use super::PhysicalDevice;
use super::image::{DescriptorSlab, SendDescriptor};
use super::instance::Messengers;
use super::memory::AddressWindow;
use super::pipeline::LivingPrograms;
use super::private_data::PrivateData;
use super::sync::Waiting;
use crate::VkResult;
use crate::execute::Engine;
use crate::handle::{self, Ref};
use crate::queue::Queue;
use crate::table::extensions::ExtensionSet;
use crate::table::features;

/// A logical device.
pub struct Device {
    pub extensions: ExtensionSet,
    pub messengers: Arc<Messengers>,
    /// What shader modules may declare.
    pub capabilities: Vec<Capability>,
    /// What executes commands. Shared with the queues' threads.
    pub engine: Arc<Engine>,
    /// All waiting of the device, and whether it is lost.
    pub waiting: Arc<Waiting>,
    pub window: Arc<AddressWindow>,
    pub queues: Vec<Ref<Queue>>,
    pub image_descriptors: Arc<DescriptorSlab<SendDescriptor>>,
    pub sampler_descriptors: Arc<DescriptorSlab<SamplerDescriptor>>,
    /// Programs that living pipelines share.
    pub programs: LivingPrograms,
    pub private_data: Mutex<PrivateData>,
    /// Names that the application gave, by handle (`vkSetDebugUtilsObjectNameEXT`).
    object_names: Mutex<HashMap<u64, String>>,
}

impl Device {
    /// A device with its workers and `queue_count` queues.
    ///
    /// # Errors
    /// Memory or threads that the system does not give.
    pub fn new(
        physical: &PhysicalDevice,
        extensions: ExtensionSet,
        queue_count: u32,
    ) -> VkResult<Self> {
        let waiting = Arc::new(Waiting::default());
        let engine = Arc::new(Engine::new(physical.thread_count, Arc::clone(&waiting))?);
        let queues = (0..queue_count)
            .map(|index| Ok(handle::new(Queue::new(index, Arc::clone(&engine))?)))
            .collect::<VkResult<_>>()?;
        Ok(Self {
            extensions,
            messengers: Arc::clone(&physical.messengers),
            capabilities: features::capabilities(),
            engine,
            waiting,
            window: AddressWindow::reserve(physical.heap_bytes, Arc::clone(&physical.used))?,
            queues,
            image_descriptors: DescriptorSlab::new(|slot| slot.0 = null_image()),
            sampler_descriptors: DescriptorSlab::new(|_| ()),
            programs: LivingPrograms::default(),
            private_data: Mutex::default(),
            object_names: Mutex::default(),
        })
    }

    /// Names an object; an empty name forgets it.
    pub fn set_object_name(&self, handle: u64, name: String) {
        let mut names = self.object_names.lock();
        if name.is_empty() {
            names.remove(&handle);
        } else {
            names.insert(handle, name);
        }
    }

    /// The name of an object, for messages.
    pub fn object_name(&self, handle: u64) -> Option<String> {
        self.object_names.lock().get(&handle).cloned()
    }

    /// Waits until all queues are idle.
    ///
    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn wait_idle(&self) -> VkResult {
        self.queues.iter().try_for_each(|queue| queue.wait_idle())
    }

    /// Joins all threads. The device executes nothing afterwards.
    pub fn shut_down(&self) {
        for queue in &self.queues {
            queue.shut_down();
        }
        self.engine.shut_down();
    }
}

/// A view of nothing.
fn null_image() -> ImageDescriptor {
    ImageDescriptor {
        data: std::ptr::null_mut(),
        size_bytes: 0,
        format: Format::UNDEFINED,
        dim: Dim::D2,
        arrayed: false,
        samples: 1,
        level_count: 0,
        layer_count: 0,
        layer_stride_bytes: 0,
        sample_stride_bytes: 0,
        swizzle: [0, 1, 2, 3],
        min_lod: 0.0,
        levels: [Level::default(); spirv_jit::image::MAX_LEVELS],
    }
}

/// Whether a device is lost. Once it is, it stays so.
#[derive(Default)]
pub struct Lost(AtomicBool);

impl Lost {
    /// Marks the device lost.
    pub fn set(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn check(&self) -> VkResult {
        if self.0.load(Ordering::Acquire) {
            Err(vk::Result::ERROR_DEVICE_LOST)
        } else {
            Ok(())
        }
    }
}
