//! File descriptors, for memory, semaphores and fences shared with other devices and processes.

use std::ffi::{c_int, c_void};

use ash::vk;

use crate::VkResult;
use crate::device::Device;
use crate::ffi::chain;
use crate::guard::guard_result;
use crate::handle::from_handle;
use crate::object::external_sync::Import;
use crate::object::{DeviceMemory, Fence, Semaphore};
use crate::os::handle::{Handle, RawHandle, Sharing};
use crate::os::section::Section;

/// The handle types of memory that is exported and imported.
pub const MEMORY_HANDLES: vk::ExternalMemoryHandleTypeFlags =
    vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;

/// The handle types of semaphores.
pub const SEMAPHORE_HANDLES: vk::ExternalSemaphoreHandleTypeFlags =
    vk::ExternalSemaphoreHandleTypeFlags::from_raw(
        vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD.as_raw()
            | vk::ExternalSemaphoreHandleTypeFlags::SYNC_FD.as_raw(),
    );

/// The handle types of fences.
pub const FENCE_HANDLES: vk::ExternalFenceHandleTypeFlags =
    vk::ExternalFenceHandleTypeFlags::from_raw(
        vk::ExternalFenceHandleTypeFlags::OPAQUE_FD.as_raw()
            | vk::ExternalFenceHandleTypeFlags::SYNC_FD.as_raw(),
    );

/// How an allocation's memory is shared; `None` if it is not exported.
///
/// # Safety
/// `next` is a valid chain of `VkMemoryAllocateInfo`.
pub unsafe fn exported_memory(next: *const c_void) -> Option<Sharing> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkMemoryAllocateInfo`.
    let export = unsafe { chain::find::<vk::ExportMemoryAllocateInfo>(next) }?;
    let opaque = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
    (export.handle_types.contains(opaque)).then(Sharing::default)
}

/// How a semaphore's payload is shared; `None` if it lies in no file.
///
/// # Safety
/// `next` is a valid chain of `VkSemaphoreCreateInfo`.
pub unsafe fn exported_semaphore(next: *const c_void) -> Option<Sharing> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkSemaphoreCreateInfo`.
    let export = unsafe { chain::find::<vk::ExportSemaphoreCreateInfo>(next) }?;
    let opaque = vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD;
    (export.handle_types.contains(opaque)).then(Sharing::default)
}

/// How a fence's payload is shared; `None` if it lies in no file.
///
/// # Safety
/// `next` is a valid chain of `VkFenceCreateInfo`.
pub unsafe fn exported_fence(next: *const c_void) -> Option<Sharing> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkFenceCreateInfo`.
    let export = unsafe { chain::find::<vk::ExportFenceCreateInfo>(next) }?;
    let opaque = vk::ExternalFenceHandleTypeFlags::OPAQUE_FD;
    (export.handle_types.contains(opaque)).then(Sharing::default)
}

/// A payload to import, which owns its file.
///
/// # Errors
/// `VK_ERROR_INVALID_EXTERNAL_HANDLE` if it is no file; the file is not owned then.
///
/// # Safety
/// The application owns the file and transfers it.
unsafe fn import(fd: RawHandle, is_sync: bool, is_temporary: bool) -> VkResult<Import> {
    if is_sync && fd == -1 {
        return Ok(Import::Sync(None));
    }
    // SAFETY: the caller guarantees that the file is the application's to give away.
    let file = unsafe { Handle::adopt(fd) }.ok_or(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE)?;
    Ok(match is_sync {
        true => Import::Sync(Some(file)),
        false => Import::Opaque { file, is_temporary },
    })
}

/// The memory that an allocation imports: a new handle of it, and the application's handle if that
/// is closed on success.
///
/// # Errors
/// `VK_ERROR_INVALID_EXTERNAL_HANDLE` if it is no file.
///
/// # Safety
/// `next` is a valid chain of `VkMemoryAllocateInfo`.
pub unsafe fn imported_memory(
    next: *const c_void,
) -> VkResult<Option<(Handle, Option<RawHandle>)>> {
    // SAFETY: the caller guarantees that `next` is a valid chain of `VkMemoryAllocateInfo`.
    let import = unsafe { chain::find::<vk::ImportMemoryFdInfoKHR>(next) };
    let Some(import) = import.filter(|import| !import.handle_type.is_empty()) else {
        return Ok(None);
    };
    let copy = Handle::duplicate(import.fd);
    let copy = copy.ok_or(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE)?;
    Ok(Some((copy, Some(import.fd))))
}

pub(crate) unsafe extern "system" fn vkImportSemaphoreFdKHR(
    _device: vk::Device,
    info: *const vk::ImportSemaphoreFdInfoKHR,
) -> vk::Result {
    guard_result("vkImportSemaphoreFdKHR", move || {
        let info = &*info;
        let is_temporary = info.flags.contains(vk::SemaphoreImportFlags::TEMPORARY);
        let is_sync = info.handle_type == vk::ExternalSemaphoreHandleTypeFlags::SYNC_FD;
        let semaphore = from_handle::<Semaphore>(info.semaphore);
        semaphore
            .external
            .import(import(info.fd, is_sync, is_temporary)?);
        Ok(())
    })
}

/// A sync file is exported after the semaphore's signal, for which this waits. For the
/// semaphore the export is a wait operation.
pub(crate) unsafe extern "system" fn vkGetSemaphoreFdKHR(
    device: vk::Device,
    info: *const vk::SemaphoreGetFdInfoKHR,
    out: *mut c_int,
) -> vk::Result {
    guard_result("vkGetSemaphoreFdKHR", move || {
        let semaphore = from_handle::<Semaphore>((*info).semaphore);
        if (*info).handle_type != vk::ExternalSemaphoreHandleTypeFlags::SYNC_FD {
            *out = semaphore.external.export()?.into_raw();
            return Ok(());
        }
        let waiting = &from_handle::<Device>(device).engine.waiting;
        waiting.wait(u64::MAX, semaphore.external.is_there(), || {
            semaphore.has_reached(1)
        })?;
        semaphore.consume();
        *out = -1;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkImportFenceFdKHR(
    _device: vk::Device,
    info: *const vk::ImportFenceFdInfoKHR,
) -> vk::Result {
    guard_result("vkImportFenceFdKHR", move || {
        let info = &*info;
        let is_temporary = info.flags.contains(vk::FenceImportFlags::TEMPORARY);
        let is_sync = info.handle_type == vk::ExternalFenceHandleTypeFlags::SYNC_FD;
        let fence = from_handle::<Fence>(info.fence);
        fence
            .external
            .import(import(info.fd, is_sync, is_temporary)?);
        Ok(())
    })
}

/// As [`vkGetSemaphoreFdKHR`]; exporting a sync file resets the fence.
pub(crate) unsafe extern "system" fn vkGetFenceFdKHR(
    device: vk::Device,
    info: *const vk::FenceGetFdInfoKHR,
    out: *mut c_int,
) -> vk::Result {
    guard_result("vkGetFenceFdKHR", move || {
        let fence = from_handle::<Fence>((*info).fence);
        if (*info).handle_type != vk::ExternalFenceHandleTypeFlags::SYNC_FD {
            *out = fence.external.export()?.into_raw();
            return Ok(());
        }
        let waiting = &from_handle::<Device>(device).engine.waiting;
        waiting.wait(u64::MAX, fence.external.is_there(), || fence.is_signaled())?;
        fence.set(false);
        *out = -1;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetMemoryFdKHR(
    _device: vk::Device,
    info: *const vk::MemoryGetFdInfoKHR,
    out: *mut c_int,
) -> vk::Result {
    guard_result("vkGetMemoryFdKHR", move || {
        *out = from_handle::<DeviceMemory>((*info).memory)
            .export()?
            .into_raw();
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetMemoryFdPropertiesKHR(
    _device: vk::Device,
    _ty: vk::ExternalMemoryHandleTypeFlags,
    fd: c_int,
    out: *mut vk::MemoryFdPropertiesKHR,
) -> vk::Result {
    guard_result("vkGetMemoryFdPropertiesKHR", move || {
        let section = Handle::duplicate(fd).and_then(|handle| Section::import(handle, 1));
        section.ok_or(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE)?;
        (*out).memory_type_bits = 1;
        Ok(())
    })
}
