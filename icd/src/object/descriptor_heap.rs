//! Samplers of descriptor heaps (`VK_EXT_descriptor_heap`). They have no objects, so the device
//! keeps each described sampler until it is destroyed.
//!
//! A program names an embedded sampler by a number that follows from the sampler's contents, so
//! that stored programs run on other devices. If two samplers have the same number, which is rare,
//! the second gets the next free one.

use std::alloc::Layout;
use std::collections::{HashMap, HashSet};
use std::ptr::NonNull;
use std::sync::{Arc, OnceLock};

use ash::vk;
use images::SamplerDescriptor;
use parking_lot::Mutex;
use spirv_jit::environment::{Descriptor, DescriptorSet};
use spirv_jit::views::{Key, Views};
use xxhash_rust::xxh3::xxh3_64;

use super::descriptor_heap_replay;
use super::embedded_sampler::{EmbeddedSampler, decode, encode};
use super::view_entry::store_failure;
use crate::VkResult;
use crate::capabilities::limits::MAX_EMBEDDED_SAMPLERS;

/// The samplers of a device's heaps and programs, and its custom border colors.
pub struct HeapSamplers {
    views: Arc<Views>,
    known: Mutex<EmbeddedSamplers>,
    /// The table of embedded samplers, created with the first.
    embedded: OnceLock<Entries>,
    /// Samplers get the same keys on every device.
    replays: bool,
    /// Indices of registered border colors. The colors come with each sampler.
    pub border_colors: Mutex<HashSet<u32>>,
}

#[derive(Default)]
struct EmbeddedSamplers {
    samplers: Vec<(SamplerDescriptor, Key)>,
    /// The sampler's index for each number. A sampler may have several numbers.
    embedded: HashMap<u32, usize>,
}

/// The number range of embedded samplers, much larger than the number of samplers.
const NUMBERS: u32 = 1 << 20;

/// Descriptors by number. The system commits memory only for used pages.
struct Entries(NonNull<Descriptor>);

// SAFETY: an entry is written once, under the lock, before a program names it.
unsafe impl Sync for Entries {}
// SAFETY: descriptors are plain data.
unsafe impl Send for Entries {}

impl Entries {
    fn layout() -> Layout {
        Layout::array::<Descriptor>(NUMBERS as usize).expect("fewer bytes than addresses")
    }

    /// Null descriptors, which are zeros; `None` without memory.
    fn new() -> Option<Self> {
        // SAFETY: the layout is not empty.
        let start = unsafe { std::alloc::alloc_zeroed(Self::layout()) };
        NonNull::new(start.cast()).map(Self)
    }
}

impl Drop for Entries {
    fn drop(&mut self) {
        // SAFETY: allocated by `new` with this layout.
        unsafe { std::alloc::dealloc(self.0.as_ptr().cast(), Self::layout()) };
    }
}

impl EmbeddedSamplers {
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
                let name = descriptor_heap_replay::name(sampler, 0);
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
    /// Creates an empty table. With `replays` the same samplers have the same keys on every device.
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

    /// The number that programs use for an embedded sampler.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`, also for more than [`MAX_EMBEDDED_SAMPLERS`].
    pub fn embed(&self, sampler: &SamplerDescriptor) -> VkResult<u32> {
        let mut known = self.known.lock();
        let index = known.find(&self.views, sampler, self.replays)?;
        let wanted = xxh3_64(format!("{sampler:?}").as_bytes()) as u32;
        for number in (0..NUMBERS).map(|step| wanted.wrapping_add(step) % NUMBERS) {
            match known.embedded.get(&number) {
                Some(&it) if it == index => return Ok(number),
                Some(_) => {}
                None => return self.put(&mut known, number, index).map(|()| number),
            }
        }
        Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY)
    }

    /// Assigns a free number to a sampler.
    fn put(&self, known: &mut EmbeddedSamplers, number: u32, index: usize) -> VkResult {
        const NO_MEMORY: vk::Result = vk::Result::ERROR_OUT_OF_HOST_MEMORY;
        if known.embedded.len() >= MAX_EMBEDDED_SAMPLERS as usize {
            return Err(NO_MEMORY);
        }
        known.embedded.try_reserve(1).map_err(|_| NO_MEMORY)?;
        if self.embedded.get().is_none() {
            // The lock is held, so no other thread creates the table.
            let _ = self.embedded.set(Entries::new().ok_or(NO_MEMORY)?);
        }
        let entries = self.embedded.get().ok_or(NO_MEMORY)?;
        let descriptor = Descriptor {
            sampler: self.views.samplers.get(known.samplers[index].1),
            ..Descriptor::NULL
        };
        // SAFETY: the number is inside the table. The lock is held, and no program uses the number
        // yet.
        unsafe { entries.0.add(number as usize).write(descriptor) };
        known.embedded.insert(number, index);
        Ok(())
    }

    /// Assigns a stored sampler its number on this device. Returns false if another sampler has the
    /// number.
    pub fn place(&self, stored: &EmbeddedSampler) -> bool {
        let Some((number, sampler)) = decode(stored).filter(|it| it.0 < NUMBERS) else {
            return false;
        };
        let mut known = self.known.lock();
        match known.embedded.get(&number) {
            // Bits are compared, because NaN is unequal to itself.
            Some(&index) => encode(number, &known.samplers[index].0) == *stored,
            None => {
                let index = known.find(&self.views, &sampler, self.replays);
                index.is_ok_and(|index| self.put(&mut known, number, index).is_ok())
            }
        }
    }

    /// The table of embedded samplers.
    pub fn embedded(&self) -> DescriptorSet {
        let Some(entries) = self.embedded.get() else {
            return DescriptorSet::NONE;
        };
        DescriptorSet {
            entries: entries.0.as_ptr().cast(),
            count: NUMBERS,
            ..DescriptorSet::NONE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampler(lod: f32) -> SamplerDescriptor {
        SamplerDescriptor {
            max_lod: lod,
            ..SamplerDescriptor::DEFAULT
        }
    }

    fn entry(samplers: &HeapSamplers, number: u32) -> Descriptor {
        let entries = samplers.embedded.get().unwrap();
        // SAFETY: a number of the table.
        unsafe { entries.0.add(number as usize).read() }
    }

    #[test]
    fn samplers_have_the_same_numbers_in_every_order() {
        let [first, second] = [(); 2].map(|()| HeapSamplers::new(&Arc::default(), false));
        let lods = [1.0, 2.0, 3.0, 4.0];
        let numbers = lods.map(|lod| first.embed(&sampler(lod)).unwrap());
        assert_eq!(numbers[1], first.embed(&sampler(2.0)).unwrap());
        for (number, lod) in numbers.into_iter().zip(lods).rev() {
            assert_eq!(second.embed(&sampler(lod)).unwrap(), number);
            // SAFETY: the sampler of a table that lives.
            let embedded = unsafe { entry(&second, number).sampler.as_ref() };
            assert_eq!(embedded, Some(&sampler(lod)));
        }
    }

    #[test]
    fn stored_numbers_are_had_again_if_they_are_free() {
        let samplers = HeapSamplers::new(&Arc::default(), false);
        let known = [sampler(1.0), sampler(2.0)];
        // A number that the sampler does not have by itself.
        let stored = encode(7, &known[1]);
        assert!(samplers.place(&stored));
        assert!(samplers.place(&stored));
        assert!(!samplers.place(&encode(7, &known[0])));
        // SAFETY: the sampler of a table that lives.
        let embedded = unsafe { entry(&samplers, 7).sampler.as_ref() };
        assert_eq!(embedded, Some(&known[1]));
        assert!(!samplers.place(&encode(NUMBERS, &known[0])));
        let own = samplers.embed(&known[1]).unwrap();
        assert_eq!(samplers.embed(&known[1]), Ok(own));
    }
}
