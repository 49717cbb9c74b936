//! Devices.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;
use rspirv::spirv::Capability;
use spirv_jit::image::SamplerDescriptor;

use super::image::{DescriptorSlab, SendDescriptor};
use super::instance::Messengers;
use super::memory::AddressWindow;
use crate::VkResult;
use crate::execute::Engine;
use crate::handle::Ref;
use crate::queue::Queue;
use crate::table::extensions::ExtensionSet;

/// A logical device.
pub struct Device {
    pub extensions: ExtensionSet,
    pub messengers: Arc<Messengers>,
    /// What shader modules may declare.
    pub capabilities: Vec<Capability>,
    /// What executes commands, on the device and on the host: workers, waiting, device loss. Shared with the queues' threads.
    pub engine: Arc<Engine>,
    pub window: Arc<AddressWindow>,
    pub queues: Vec<Ref<Queue>>,
    pub image_descriptors: Arc<DescriptorSlab<SendDescriptor>>,
    pub sampler_descriptors: Arc<DescriptorSlab<SamplerDescriptor>>,
}

impl Drop for Device {
    /// Ends the queues' threads and the workers: when the device is gone, no code of this library runs on a thread of its own.
    fn drop(&mut self) {
        self.engine.shut_down();
        for queue in &self.queues {
            queue.close();
        }
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
