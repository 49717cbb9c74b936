//! `pNext` chains.

use std::ffi::c_void;

use ash::vk;

/// The structures of an input chain, in order.
///
/// # Safety
/// `next` starts a valid `pNext` chain that lives for `'a`.
pub unsafe fn nodes<'a>(next: *const c_void) -> impl Iterator<Item = &'a vk::BaseInStructure<'a>> {
    let mut node: *const vk::BaseInStructure<'a> = next.cast();
    std::iter::from_fn(move || {
        // SAFETY: the caller guarantees that `next` starts a valid `pNext` chain that lives for
        // `'a`; null, or a structure that begins as `VkBaseInStructure` does.
        let this = unsafe { node.as_ref() }?;
        node = this.p_next;
        Some(this)
    })
}

/// The first structure of a type in an input chain.
///
/// # Safety
/// As [`nodes`].
pub unsafe fn find<'a, T: vk::TaggedStructure>(next: *const c_void) -> Option<&'a T> {
    // SAFETY: the caller keeps the promises of `nodes`; the type word says that the structure is a
    // `T`.
    unsafe {
        nodes(next)
            .find(|node| node.s_type == T::STRUCTURE_TYPE)
            .map(|node| &*std::ptr::from_ref(node).cast::<T>())
    }
}

/// The structures of an output chain, in order, as pointers.
///
/// # Safety
/// As [`nodes`], and nothing else uses the structures for the time of the call.
pub unsafe fn nodes_mut(
    next: *mut c_void,
) -> impl Iterator<Item = *mut vk::BaseOutStructure<'static>> {
    let mut node: *mut vk::BaseOutStructure<'static> = next.cast();
    std::iter::from_fn(move || {
        if node.is_null() {
            return None;
        }
        let this = node;
        // SAFETY: the caller keeps the promises of `nodes`, and guarantees that nothing else uses
        // the structures for the time of the call.
        node = unsafe { (*this).p_next };
        Some(this)
    })
}

/// The first structure of a type in an output chain.
///
/// # Safety
/// As [`nodes_mut`].
pub unsafe fn find_mut<'a, T: vk::TaggedStructure>(next: *mut c_void) -> Option<&'a mut T> {
    // SAFETY: the caller keeps the promises of `nodes_mut`; the type word says that the structure
    // is a `T`.
    unsafe {
        nodes_mut(next)
            .find(|&node| (*node).s_type == T::STRUCTURE_TYPE)
            .map(|node| &mut *node.cast::<T>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_behind_others() {
        let mut second = vk::PhysicalDeviceVulkan12Features::default().shader_int8(true);
        let first = vk::PhysicalDeviceVulkan11Features {
            p_next: (&raw mut second).cast(),
            ..Default::default()
        };
        // SAFETY: the chain is the two structures above.
        unsafe {
            let start = (&raw const first).cast();
            assert_eq!(
                find::<vk::PhysicalDeviceVulkan12Features>(start)
                    .unwrap()
                    .shader_int8,
                vk::TRUE
            );
            assert!(find::<vk::PhysicalDeviceVulkan13Features>(start).is_none());
            assert!(find::<vk::PhysicalDeviceVulkan13Features>(std::ptr::null()).is_none());
        }
    }
}
