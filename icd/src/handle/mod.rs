//! Handles: pointers to reference-counted objects that begin with the loader's word and a type tag.
//!
//! A handle owns one count of an [`Arc`]; objects that outlive their handle (a pipeline layout
//! inside a pipeline) are held by further counts. A handle is dereferenced only inside pages of
//! objects, and accepted only with the tag, so an invalid number causes no fault.

mod object_pages;

use std::cell::UnsafeCell;
use std::ops::Deref;
use std::sync::Arc;

use ash::vk::Handle;

/// `ICD_LOADER_MAGIC` (vk_icd.h): the loader checks it, then puts its dispatch table there.
const LOADER_MAGIC: usize = 0x01CD_C0DE;

/// An object with the head that handles need. The loader reads and writes the first word of
/// dispatchable ones. By its alignment the head lies in one page.
#[repr(C, align(16))]
pub struct Object<T> {
    loader_word: UnsafeCell<usize>,
    tag: u64,
    value: T,
}

// SAFETY: `loader_word` is the loader's alone; nothing here reads it after creation.
unsafe impl<T: Send> Send for Object<T> {}
// SAFETY: `loader_word` is the loader's alone; nothing here reads it after creation.
unsafe impl<T: Sync> Sync for Object<T> {}

impl<T> Drop for Object<T> {
    /// A later use of the handle finds no tag, while the memory has no other use.
    fn drop(&mut self) {
        // SAFETY: the field is the object's own. The compiler takes the last write to memory that
        // goes away for useless, unless it is volatile.
        unsafe { (&raw mut self.tag).write_volatile(0) };
        object_pages::forget(&raw const *self as usize);
    }
}

impl<T> Deref for Object<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

/// A counted reference to an object.
pub type Ref<T> = Arc<Object<T>>;

/// A type that lies behind a Vulkan handle.
pub trait Handled: Sized {
    type Handle: Handle + Copy;
}

const fn tag<T: Handled>() -> u64 {
    0x5475_6666_0000_0000 | <T::Handle as Handle>::TYPE.as_raw() as u32 as u64
}

/// A new object, not yet given out.
pub fn new<T: Handled>(value: T) -> Ref<T> {
    let object = Arc::new(Object {
        loader_word: UnsafeCell::new(LOADER_MAGIC),
        tag: tag::<T>(),
        value,
    });
    object_pages::note(Arc::as_ptr(&object) as usize);
    object
}

/// Gives a count to the application, as a handle.
pub fn into_handle<T: Handled>(object: Ref<T>) -> T::Handle {
    Handle::from_raw(Arc::into_raw(object) as u64)
}

/// A new object's handle.
pub fn create<T: Handled>(value: T) -> T::Handle {
    into_handle(new(value))
}

/// The handle of an object that is held elsewhere.
pub fn handle_of<T: Handled>(object: &Ref<T>) -> T::Handle {
    Handle::from_raw(Arc::as_ptr(object) as u64)
}

fn pointer<T: Handled>(handle: T::Handle) -> *const Object<T> {
    let pointer = handle.as_raw() as *const Object<T>;
    assert!(!pointer.is_null(), "null handle");
    // SAFETY: the place is aligned and in a page that holds objects, so that it can be read. That
    // it is not written meanwhile is the application's valid usage.
    let is_alive = pointer.is_aligned()
        && object_pages::may_hold(pointer as usize)
        && unsafe { (*pointer).tag } == tag::<T>();
    assert!(
        is_alive,
        "not a live handle of this type: {:#x}",
        handle.as_raw()
    );
    pointer
}

/// The object behind a handle.
///
/// # Safety
/// The handle is alive and stays so for `'a`.
pub unsafe fn from_handle<'a, T: Handled>(handle: T::Handle) -> &'a Object<T> {
    // SAFETY: the caller guarantees that the handle stays alive; the tag has been checked.
    unsafe { &*pointer::<T>(handle) }
}

/// The object behind a handle, or `None` for `VK_NULL_HANDLE`.
///
/// # Safety
/// As [`from_handle`].
pub unsafe fn optional<'a, T: Handled>(handle: T::Handle) -> Option<&'a Object<T>> {
    // SAFETY: the caller guarantees that the handle is alive and stays so for `'a`.
    (!handle.is_null()).then(|| unsafe { from_handle(handle) })
}

/// A further count of the object behind a handle.
///
/// # Safety
/// The handle is alive.
pub unsafe fn retain<T: Handled>(handle: T::Handle) -> Ref<T> {
    let pointer = pointer::<T>(handle);
    // SAFETY: the handle owns a count of an `Arc` that `into_handle` took apart.
    unsafe {
        Arc::increment_strong_count(pointer);
        Arc::from_raw(pointer)
    }
}

/// Takes the handle's own count back; `None` for `VK_NULL_HANDLE`.
///
/// # Safety
/// The handle is alive, and the application does not use it again.
pub unsafe fn take<T: Handled>(handle: T::Handle) -> Option<Ref<T>> {
    if handle.is_null() {
        return None;
    }
    // SAFETY: the caller guarantees that the handle is alive, and the application does not use it
    // again.
    Some(unsafe { Arc::from_raw(pointer::<T>(handle)) })
}

macro_rules! handled {
    ($($ty:ty => $handle:ident),* $(,)?) => {$(
        impl $crate::handle::Handled for $ty {
            type Handle = $crate::ffi::vk::$handle;
        }
    )*};
}
pub(crate) use handled;

#[cfg(test)]
mod tests {
    use super::*;
    use ash::vk;

    struct Thing(u32);
    struct Other;
    handled!(Thing => Buffer, Other => Image);

    #[test]
    fn handles_count_and_check_their_type() {
        let handle = create(Thing(5));
        // SAFETY: the handle is alive until `take`.
        unsafe {
            let kept = retain::<Thing>(handle);
            assert_eq!(from_handle::<Thing>(handle).0, 5);
            assert_eq!(Arc::strong_count(&take::<Thing>(handle).unwrap()), 2);
            assert_eq!(kept.0, 5);
            let wrong = vk::Image::from_raw(handle_of(&kept).as_raw());
            assert!(std::panic::catch_unwind(|| from_handle::<Other>(wrong).tag).is_err());
            assert!(take::<Thing>(vk::Buffer::null()).is_none());
        }
    }

    #[test]
    fn numbers_that_were_never_handles_are_refused() {
        let thing = new(Thing(1));
        let real = handle_of(&thing).as_raw();
        let wild = [
            1,
            8,
            0x0123_4560,
            0x4141_4141_4141_4140,
            u64::MAX,
            real + 8,
            real + 16,
        ];
        for number in wild {
            let wrong = vk::Buffer::from_raw(number);
            // SAFETY: none of these is followed further than its tag.
            let found = std::panic::catch_unwind(|| unsafe { from_handle::<Thing>(wrong).0 });
            assert!(found.is_err(), "{number:#x}");
        }
    }

    #[test]
    fn objects_begin_with_the_loader_magic() {
        let thing = new(Thing(1));
        // SAFETY: `Object` is `repr(C)`: its first word is the loader's.
        let first_word = unsafe { *Arc::as_ptr(&thing).cast::<usize>() };
        assert_eq!(first_word, LOADER_MAGIC);
    }
}
