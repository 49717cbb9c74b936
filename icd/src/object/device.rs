//! Devices.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;
use rspirv::spirv::Capability;
use spirv_jit::image::SamplerDescriptor;

use super::image::{DescriptorSlab, SendDescriptor};
use super::instance::Messengers;
use super::memory::AddressWindow;
use super::sync::Waiting;
use crate::VkResult;
use crate::handle::Ref;
use crate::queue::Queue;
use crate::table::extensions::ExtensionSet;

/// A logical device.
pub struct Device {
    pub extensions: ExtensionSet,
    pub messengers: Arc<Messengers>,
    /// What shader modules may declare.
    pub capabilities: Vec<Capability>,
    /// The workers that commands fan out over. Shared with the queues' threads.
    pub workers: Arc<rayon::ThreadPool>,
    pub window: Arc<AddressWindow>,
    pub queues: Vec<Ref<Queue>>,
    pub image_descriptors: Arc<DescriptorSlab<SendDescriptor>>,
    pub sampler_descriptors: Arc<DescriptorSlab<SamplerDescriptor>>,
    /// All waiting of the device, and whether it is lost.
    pub waiting: Arc<Waiting>,
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
