//! Capture and replay of descriptors in heaps (`descriptorHeapCaptureReplay`). The bits of such a
//! descriptor follow from its contents; those of an image's descriptor also from the image's
//! identity, which is its opaque capture data.

#![forbid(unsafe_code)]

use std::collections::HashSet;
use std::fmt::Debug;
use std::sync::Arc;

use ash::vk;
use images::ImageDescriptor;
use parking_lot::Mutex;
use spirv_jit::views::Key;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::VkResult;

/// The identities of a device's images.
#[derive(Default)]
pub struct Identities {
    state: Mutex<IdentityAllocator>,
}

#[derive(Default)]
struct IdentityAllocator {
    last: u32,
    used: HashSet<u32>,
}

/// The identity of an image, free for another image once this is dropped.
pub struct Identity {
    number: u32,
    of: Arc<Identities>,
}

impl Identities {
    /// Takes an identity: `captured`, if there is one.
    ///
    /// # Errors
    /// `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` if another image has it, or it is invalid;
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn take(self: &Arc<Self>, captured: Option<u64>) -> VkResult<Identity> {
        let state = &mut *self.state.lock();
        (state.used.try_reserve(1)).map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        let number = match captured {
            Some(captured) => {
                let number = u32::try_from(captured).ok();
                let free = number.filter(|it| *it != 0 && !state.used.contains(it));
                free.ok_or(vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS)?
            }
            None => loop {
                state.last = state.last.wrapping_add(1).max(1);
                if !state.used.contains(&state.last) {
                    break state.last;
                }
            },
        };
        state.used.insert(number);
        Ok(Identity {
            number,
            of: Arc::clone(self),
        })
    }
}

impl Identity {
    /// The opaque capture data.
    pub fn data(&self) -> u64 {
        self.number.into()
    }

    /// The name of a view of the image, independent of the image's address.
    pub fn name(&self, view: &ImageDescriptor) -> Key {
        let view = ImageDescriptor {
            data: std::ptr::null_mut(),
            ..*view
        };
        name(&view, self.number)
    }
}

impl Drop for Identity {
    fn drop(&mut self) {
        self.of.state.lock().used.remove(&self.number);
    }
}

/// A name computed from contents and a seed.
pub fn name(contents: &impl Debug, seed: u32) -> Key {
    let text = format!("{contents:?}");
    Key::named(xxh3_64_with_seed(text.as_bytes(), seed.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identities_are_unique_and_can_be_had_again() {
        const TAKEN: vk::Result = vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS;
        let all = Arc::<Identities>::default();
        let first = all.take(None).unwrap();
        let second = all.take(Some(first.data() + 1)).unwrap();
        let third = all.take(None).unwrap();
        assert_eq!((first.data(), second.data(), third.data()), (1, 2, 3));
        for wrong in [0, 2, u64::MAX, 1 << 32] {
            assert_eq!(all.take(Some(wrong)).err(), Some(TAKEN));
        }
        let view = ImageDescriptor::NULL;
        let name = second.name(&view);
        assert_ne!(name, third.name(&view));
        drop(second);
        let moved = ImageDescriptor {
            data: std::ptr::without_provenance_mut(4096),
            ..view
        };
        assert_eq!(all.take(Some(2)).unwrap().name(&moved), name);
        let other = ImageDescriptor {
            layer_count: 2,
            ..view
        };
        assert_ne!(first.name(&other), first.name(&view));
    }
}
