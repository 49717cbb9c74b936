//! Handles, for memory, semaphores and fences shared with other devices and processes.
//!
//! Memory is a section; the payload of a semaphore or fence is an event. An import has its own
//! handle and does not close the application's (Vulkan 1.4, "Importing Semaphore Payloads").

use std::ffi::c_void;

use ash::vk;

use crate::VkResult;
use crate::ffi::chain;
use crate::guard::guard_result;
use crate::handle::from_handle;
use crate::object::external_sync::Import;
use crate::object::{DeviceMemory, Fence, Semaphore};
use crate::os::handle::{Handle, RawHandle, Sharing};
use crate::os::section::Section;
use crate::os::{event, section};

const INVALID: vk::Result = vk::Result::ERROR_INVALID_EXTERNAL_HANDLE;

/// The handle types of memory that is exported and imported.
pub const MEMORY_HANDLES: vk::ExternalMemoryHandleTypeFlags =
    vk::ExternalMemoryHandleTypeFlags::OPAQUE_WIN32;

/// The handle types of semaphores.
pub const SEMAPHORE_HANDLES: vk::ExternalSemaphoreHandleTypeFlags =
    vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_WIN32;

/// The handle types of fences.
pub const FENCE_HANDLES: vk::ExternalFenceHandleTypeFlags =
    vk::ExternalFenceHandleTypeFlags::OPAQUE_WIN32;

/// The sharing parameters of a Vulkan structure, or the system's defaults without one.
macro_rules! sharing {
    ($next:ident, $info:ident) => {
        chain::find::<vk::$info>($next).map_or_else(Sharing::default, |info| {
            Sharing::new(info.p_attributes, info.name, info.dw_access)
        })
    };
}

/// How an allocation's memory is shared; `None` if it is not exported.
///
/// # Safety
/// `next` is a valid chain of `VkMemoryAllocateInfo`, as long as the result is used.
pub unsafe fn exported_memory(next: *const c_void) -> Option<Sharing> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkMemoryAllocateInfo`, as long
    // as the result is used.
    unsafe {
        let export = chain::find::<vk::ExportMemoryAllocateInfo>(next)?;
        (export.handle_types.contains(MEMORY_HANDLES))
            .then(|| sharing!(next, ExportMemoryWin32HandleInfoKHR))
    }
}

/// How a semaphore's payload is shared; `None` if no other can have it.
///
/// # Safety
/// `next` is a valid chain of `VkSemaphoreCreateInfo`, as long as the result is used.
pub unsafe fn exported_semaphore(next: *const c_void) -> Option<Sharing> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkSemaphoreCreateInfo`, as
    // long as the result is used.
    unsafe {
        let export = chain::find::<vk::ExportSemaphoreCreateInfo>(next)?;
        (export.handle_types.contains(SEMAPHORE_HANDLES))
            .then(|| sharing!(next, ExportSemaphoreWin32HandleInfoKHR))
    }
}

/// How a fence's payload is shared; `None` if no other can have it.
///
/// # Safety
/// `next` is a valid chain of `VkFenceCreateInfo`, as long as the result is used.
pub unsafe fn exported_fence(next: *const c_void) -> Option<Sharing> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkFenceCreateInfo`, as long as
    // the result is used.
    unsafe {
        let export = chain::find::<vk::ExportFenceCreateInfo>(next)?;
        (export.handle_types.contains(FENCE_HANDLES))
            .then(|| sharing!(next, ExportFenceWin32HandleInfoKHR))
    }
}

/// The memory that an allocation imports: a new handle of it. The application keeps its own.
///
/// # Errors
/// `VK_ERROR_INVALID_EXTERNAL_HANDLE` for an invalid handle or name, and for other handle types.
///
/// # Safety
/// `next` is a valid chain of `VkMemoryAllocateInfo`.
pub unsafe fn imported_memory(
    next: *const c_void,
) -> VkResult<Option<(Handle, Option<RawHandle>)>> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkMemoryAllocateInfo`.
    let import = unsafe { chain::find::<vk::ImportMemoryWin32HandleInfoKHR>(next) };
    let Some(import) = import.filter(|import| !import.handle_type.is_empty()) else {
        return Ok(None);
    };
    if import.handle_type != MEMORY_HANDLES {
        return Err(INVALID);
    }
    let handle = match import.handle {
        // SAFETY: the caller guarantees that `next` is a valid chain of `VkMemoryAllocateInfo`.
        0 => unsafe { section::named(import.name) },
        handle => Handle::duplicate(handle as RawHandle),
    };
    Ok(Some((handle.ok_or(INVALID)?, None)))
}

/// A payload to import.
///
/// # Errors
/// `VK_ERROR_INVALID_EXTERNAL_HANDLE` for another kind of object.
///
/// # Safety
/// The name is null or ends with a zero.
unsafe fn import(handle: vk::HANDLE, name: vk::LPCWSTR, is_temporary: bool) -> VkResult<Import> {
    let file = match handle {
        // SAFETY: the caller guarantees that the name is null or ends with a zero.
        0 => unsafe { event::named(name) },
        handle => event::imported(handle as RawHandle),
    };
    Ok(Import::Opaque {
        file: file.ok_or(INVALID)?,
        is_temporary,
    })
}

pub(crate) unsafe extern "system" fn vkImportSemaphoreWin32HandleKHR(
    _device: vk::Device,
    info: *const vk::ImportSemaphoreWin32HandleInfoKHR,
) -> vk::Result {
    guard_result("vkImportSemaphoreWin32HandleKHR", move || {
        let info = &*info;
        let is_temporary = info.flags.contains(vk::SemaphoreImportFlags::TEMPORARY);
        if info.handle_type != SEMAPHORE_HANDLES {
            return Err(INVALID);
        }
        let semaphore = from_handle::<Semaphore>(info.semaphore);
        semaphore
            .external
            .import(import(info.handle, info.name, is_temporary)?);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetSemaphoreWin32HandleKHR(
    _device: vk::Device,
    info: *const vk::SemaphoreGetWin32HandleInfoKHR,
    out: *mut vk::HANDLE,
) -> vk::Result {
    guard_result("vkGetSemaphoreWin32HandleKHR", move || {
        *out = from_handle::<Semaphore>((*info).semaphore)
            .external
            .export()?
            .into_raw() as vk::HANDLE;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkImportFenceWin32HandleKHR(
    _device: vk::Device,
    info: *const vk::ImportFenceWin32HandleInfoKHR,
) -> vk::Result {
    guard_result("vkImportFenceWin32HandleKHR", move || {
        let info = &*info;
        let is_temporary = info.flags.contains(vk::FenceImportFlags::TEMPORARY);
        if info.handle_type != FENCE_HANDLES {
            return Err(INVALID);
        }
        let fence = from_handle::<Fence>(info.fence);
        fence
            .external
            .import(import(info.handle, info.name, is_temporary)?);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetFenceWin32HandleKHR(
    _device: vk::Device,
    info: *const vk::FenceGetWin32HandleInfoKHR,
    out: *mut vk::HANDLE,
) -> vk::Result {
    guard_result("vkGetFenceWin32HandleKHR", move || {
        *out = from_handle::<Fence>((*info).fence)
            .external
            .export()?
            .into_raw() as vk::HANDLE;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetMemoryWin32HandleKHR(
    _device: vk::Device,
    info: *const vk::MemoryGetWin32HandleInfoKHR,
    out: *mut vk::HANDLE,
) -> vk::Result {
    guard_result("vkGetMemoryWin32HandleKHR", move || {
        *out = from_handle::<DeviceMemory>((*info).memory)
            .export()?
            .into_raw() as vk::HANDLE;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetMemoryWin32HandlePropertiesKHR(
    _device: vk::Device,
    _ty: vk::ExternalMemoryHandleTypeFlags,
    handle: vk::HANDLE,
    out: *mut vk::MemoryWin32HandlePropertiesKHR,
) -> vk::Result {
    guard_result("vkGetMemoryWin32HandlePropertiesKHR", move || {
        let handle = Handle::duplicate(handle as RawHandle);
        let section = handle.and_then(|handle| Section::import(handle, 1));
        section.ok_or(INVALID)?;
        (*out).memory_type_bits = 1;
        Ok(())
    })
}
