//! Table entries of the resources that shaders read through views.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;
use spirv_jit::views::{Key, StoreError, Table, Views};

use crate::VkResult;

/// An entry of the device's [`Views`], under its key while the object lives. Descriptor sets hold
/// the contents' address, which stays readable for the device's life; descriptors in buffers hold
/// the key.
pub struct ViewEntry<T: Copy + 'static> {
    pub key: Key,
    /// The slot's key; equal to `key`, unless `key` is a name.
    slot: Key,
    views: Arc<Views>,
    table: fn(&Views) -> &Table<T>,
    /// The object has freed its key.
    removed: AtomicBool,
}

/// Vulkan's code for the failure.
pub fn store_failure(error: StoreError) -> vk::Result {
    match error {
        StoreError::OutOfMemory => vk::Result::ERROR_OUT_OF_HOST_MEMORY,
        StoreError::Taken => vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS,
    }
}

impl<T: Copy> ViewEntry<T> {
    /// Stores contents. With `replay` the key can be requested again; a key in `replay` is
    /// requested now.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`; `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` if the key is
    /// taken.
    pub fn store(
        views: &Arc<Views>,
        table: fn(&Views) -> &Table<T>,
        contents: T,
        replay: Option<Option<Key>>,
    ) -> VkResult<Self> {
        let key = match replay {
            None => table(views).store(contents),
            Some(wanted) => table(views).store_replayable(contents, wanted),
        };
        let key = key.map_err(store_failure)?;
        Ok(Self::of(views, table, key, key))
    }

    /// Stores contents under a name.
    ///
    /// # Errors
    /// As [`Self::store`].
    pub fn named(
        views: &Arc<Views>,
        table: fn(&Views) -> &Table<T>,
        contents: T,
        name: Key,
    ) -> VkResult<Self> {
        let slot = table(views).store_named(contents, name);
        Ok(Self::of(views, table, name, slot.map_err(store_failure)?))
    }

    fn of(views: &Arc<Views>, table: fn(&Views) -> &Table<T>, key: Key, slot: Key) -> Self {
        Self {
            key,
            slot,
            views: Arc::clone(views),
            table,
            removed: AtomicBool::new(false),
        }
    }

    /// Frees a replayable key at the object's destruction. Framebuffers, recorded passes and set
    /// layouts may hold the object longer, but a replayed object may take its key from now on.
    pub fn release(&self) {
        if self.key.is_replayable() {
            self.remove();
        }
    }

    fn remove(&self) {
        if !self.removed.swap(true, Ordering::Relaxed) {
            (self.table)(&self.views).remove(self.key);
        }
    }

    /// The pointer that descriptor sets store.
    pub fn as_ptr(&self) -> *const T {
        (self.table)(&self.views).get(self.key)
    }
}

impl<T: Copy> std::ops::Deref for ViewEntry<T> {
    type Target = T;

    fn deref(&self) -> &T {
        let slot = (self.table)(&self.views).slot_of(self.slot);
        // SAFETY: `store` filled the slot, which lives as long as the table. It is written again
        // only after the object's destruction, when valid usage forbids further uses.
        unsafe { slot.as_ref() }.expect("filled when the object was made")
    }
}

impl<T: Copy> Drop for ViewEntry<T> {
    fn drop(&mut self) {
        self.remove();
    }
}
