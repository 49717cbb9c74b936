//! Samplers of descriptor heaps (`VK_EXT_descriptor_heap`): they are no objects, so the device
//! keeps each that is described until its own end.

use std::cell::UnsafeCell;
use std::collections::HashSet;
use std::sync::{Arc, OnceLock};

use ash::vk;
use images::SamplerDescriptor;
use parking_lot::Mutex;
use spirv_jit::environment::{Descriptor, DescriptorSet};
use spirv_jit::views::{Key, Views};
use xxhash_rust::xxh3::xxh3_128;

use super::heap_replay;
use super::view_entry::store_failure;
use crate::VkResult;
use crate::table::limits::MAX_EMBEDDED_SAMPLERS;

/// The identity of an embedded sampler: its number, and a hash of its contents.
pub type EmbeddedSampler = [u8; 20];

/// The samplers of a device's heaps and programs, and its custom border colors.
pub struct HeapSamplers {
    views: Arc<Views>,
    known: Mutex<Known>,
    /// Embedded samplers by number, [`MAX_EMBEDDED_SAMPLERS`] of them once there is one.
    embedded: OnceLock<Box<[Entry]>>,
    /// Samplers have names, which are the same on every device.
    replays: bool,
    /// Indices of registered border colors. The colors come with each sampler.
    pub border_colors: Mutex<HashSet<u32>>,
}

#[derive(Default)]
struct Known {
    samplers: Vec<(SamplerDescriptor, Key)>,
    /// By number: indices of samplers.
    embedded: Vec<usize>,
}

struct Entry(UnsafeCell<Descriptor>);

// SAFETY: an entry is written once, under the lock, before a program names it.
unsafe impl Sync for Entry {}
// SAFETY: descriptors are plain data.
unsafe impl Send for Entry {}

impl Known {
    fn find(
        &mut self,
        views: &Views,
        sampler: &SamplerDescriptor,
        replays: bool,
    ) -> VkResult<usize> {
        if let Some(index) = self.samplers.iter().position(|known| known.0 == *sampler) {
            return Ok(index);
        }
        let no_memory = vk::Result::ERROR_OUT_OF_HOST_MEMORY;
        self.samplers.try_reserve(1).map_err(|_| no_memory)?;
        let samplers = &views.samplers;
        let key = match replays {
            true => {
                let name = heap_replay::name(sampler, 0);
                samplers.store_named(*sampler, name).map(|_| name)
            }
            false => samplers.store(*sampler),
        };
        let key = key.map_err(store_failure)?;
        self.samplers.push((*sampler, key));
        Ok(self.samplers.len() - 1)
    }
}

impl HeapSamplers {
    /// No samplers. With `replays` the same samplers have the same keys on every device.
    pub fn new(views: &Arc<Views>, replays: bool) -> Self {
        Self {
            views: Arc::clone(views),
            known: Mutex::default(),
            embedded: OnceLock::new(),
            replays,
            border_colors: Mutex::default(),
        }
    }

    /// The key of a sampler: the same for the same sampler.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`; `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` if another sampler
    /// has the name.
    pub fn key(&self, sampler: &SamplerDescriptor) -> VkResult<Key> {
        let mut known = self.known.lock();
        let index = known.find(&self.views, sampler, self.replays)?;
        Ok(known.samplers[index].1)
    }

    /// The number by which programs name a sampler that they embed.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`, also for more than [`MAX_EMBEDDED_SAMPLERS`].
    pub fn embed(&self, sampler: &SamplerDescriptor) -> VkResult<u32> {
        let mut known = self.known.lock();
        let index = known.find(&self.views, sampler, self.replays)?;
        if let Some(number) = known.embedded.iter().position(|&it| it == index) {
            return Ok(number as u32);
        }
        let null = || Entry(UnsafeCell::new(Descriptor::NULL));
        let entries = self
            .embedded
            .get_or_init(|| (0..MAX_EMBEDDED_SAMPLERS).map(|_| null()).collect());
        let number = known.embedded.len();
        let entry = entries.get(number);
        let entry = entry.ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        let descriptor = Descriptor {
            sampler: self.views.samplers.get(known.samplers[index].1),
            ..Descriptor::NULL
        };
        // SAFETY: the lock is held, and no program has this number yet.
        unsafe { *entry.0.get() = descriptor };
        known.embedded.push(index);
        Ok(number as u32)
    }

    /// An embedded sampler as data names it.
    pub fn identify(number: u32, sampler: &SamplerDescriptor) -> EmbeddedSampler {
        let contents = xxh3_128(format!("{sampler:?}").as_bytes()).to_le_bytes();
        let mut identity = EmbeddedSampler::default();
        identity[..4].copy_from_slice(&number.to_le_bytes());
        identity[4..].copy_from_slice(&contents);
        identity
    }

    /// Whether an embedded sampler of data has its number on this device.
    pub fn has(&self, wanted: &EmbeddedSampler) -> bool {
        let known = self.known.lock();
        let [a, b, c, d, ..] = *wanted;
        let number = u32::from_le_bytes([a, b, c, d]);
        let index = known.embedded.get(number as usize);
        index.is_some_and(|&index| Self::identify(number, &known.samplers[index].0) == *wanted)
    }

    /// The table of embedded samplers.
    pub fn embedded(&self) -> DescriptorSet {
        let Some(entries) = self.embedded.get() else {
            return DescriptorSet::NONE;
        };
        DescriptorSet {
            entries: entries.as_ptr().cast(),
            count: MAX_EMBEDDED_SAMPLERS,
            ..DescriptorSet::NONE
        }
    }
}
