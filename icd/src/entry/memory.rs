//! Device memory.

use std::ffi::c_void;

use ash::vk;

use super::address_report::report;
use super::system::{exported_memory, imported_memory};
use crate::VkResult;
use crate::capabilities::limits::PAGE_BYTES;
use crate::device::Device;
use crate::ffi::chain;
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle};
use crate::object::DeviceMemory;
use crate::object::address_space::Placement;
use crate::object::addressed::AddressEvent;
use crate::object::memory::Source;
use crate::os::handle::{RawHandle, close};

pub(crate) unsafe extern "system" fn vkFreeMemory(
    device: vk::Device,
    handle: vk::DeviceMemory,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkFreeMemory", move || {
        report::<DeviceMemory>(device, handle, AddressEvent::Unbound);
        drop(handle::take::<DeviceMemory>(handle));
    })
}

/// The source of an allocation's bytes. An imported handle is duplicated. A handle that the
/// application transfers is closed on success.
///
/// # Safety
/// `info` is valid usage of `vkAllocateMemory`.
unsafe fn source(
    device: &Device,
    info: &vk::MemoryAllocateInfo<'_>,
) -> VkResult<(Source, Option<RawHandle>)> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkAllocateMemory`.
    unsafe {
        if let Some(import) = chain::find::<vk::ImportMemoryHostPointerInfoEXT>(info.p_next)
            && !import.handle_type.is_empty()
        {
            return Ok((Source::HostPointer(import.p_host_pointer.cast()), None));
        }
        if let Some((copy, imported)) = imported_memory(info.p_next)? {
            return Ok((Source::Exported(copy), imported));
        }
        let source = match exported_memory(info.p_next) {
            Some(sharing) => Source::Exportable(sharing),
            None if device.sparse_binding => Source::Shared,
            None => Source::Fresh,
        };
        Ok((source, None))
    }
}

/// The placement of an allocation.
///
/// # Safety
/// `info` is valid usage of `vkAllocateMemory`.
unsafe fn placement(info: &vk::MemoryAllocateInfo<'_>) -> Placement {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkAllocateMemory`.
    unsafe {
        let flags = chain::find::<vk::MemoryAllocateFlagsInfo>(info.p_next).map(|it| it.flags);
        let replayable = vk::MemoryAllocateFlags::DEVICE_ADDRESS_CAPTURE_REPLAY;
        let captured = chain::find::<vk::MemoryOpaqueCaptureAddressAllocateInfo>(info.p_next);
        Placement::new(
            flags.is_some_and(|flags| flags.contains(replayable)),
            captured.map(|it| it.opaque_capture_address),
        )
    }
}

/// The host address of memory at an offset. A size past the end is not checked.
///
/// # Errors
/// `VK_ERROR_MEMORY_MAP_FAILED` past the end.
///
/// # Safety
/// The handle is one of memory.
unsafe fn mapped(memory: vk::DeviceMemory, offset: u64) -> VkResult<*mut c_void> {
    // SAFETY: the caller guarantees that the handle is one of memory.
    let memory = unsafe { from_handle::<DeviceMemory>(memory) };
    if offset >= memory.size_bytes.max(1) {
        return Err(vk::Result::ERROR_MEMORY_MAP_FAILED);
    }
    Ok((memory.address + offset) as *mut c_void)
}

pub(crate) unsafe extern "system" fn vkAllocateMemory(
    device: vk::Device,
    info: *const vk::MemoryAllocateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::DeviceMemory,
) -> vk::Result {
    guard_result("vkAllocateMemory", move || {
        let owner = from_handle::<Device>(device);
        let info = &*info;
        let (source, imported) = source(owner, info)?;
        let memory =
            DeviceMemory::allocate(&owner.window, info.allocation_size, source, placement(info))?;
        if let Some(imported) = imported {
            close(imported);
        }
        *out = handle::create(memory);
        report::<DeviceMemory>(device, *out, AddressEvent::Created);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkMapMemory(
    _device: vk::Device,
    memory: vk::DeviceMemory,
    offset: vk::DeviceSize,
    _size: vk::DeviceSize,
    _flags: vk::MemoryMapFlags,
    out: *mut *mut c_void,
) -> vk::Result {
    guard_result("vkMapMemory", move || {
        *out = mapped(memory, offset)?;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkUnmapMemory(_device: vk::Device, _memory: vk::DeviceMemory) {
    guard("vkUnmapMemory", move || {
        // Memory stays mapped.
    })
}

pub(crate) unsafe extern "system" fn vkMapMemory2KHR(
    _device: vk::Device,
    info: *const vk::MemoryMapInfoKHR,
    out: *mut *mut c_void,
) -> vk::Result {
    guard_result("vkMapMemory2KHR", move || {
        *out = mapped((*info).memory, (*info).offset)?;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkUnmapMemory2KHR(
    _device: vk::Device,
    _info: *const vk::MemoryUnmapInfoKHR,
) -> vk::Result {
    vk::Result::SUCCESS
}

pub(crate) unsafe extern "system" fn vkFlushMappedMemoryRanges(
    _device: vk::Device,
    _count: u32,
    _ranges: *const vk::MappedMemoryRange,
) -> vk::Result {
    guard_result("vkFlushMappedMemoryRanges", move || {
        // The one memory type is coherent.
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkInvalidateMappedMemoryRanges(
    _device: vk::Device,
    _count: u32,
    _ranges: *const vk::MappedMemoryRange,
) -> vk::Result {
    vk::Result::SUCCESS
}

pub(crate) unsafe extern "system" fn vkGetDeviceMemoryCommitment(
    _device: vk::Device,
    _memory: vk::DeviceMemory,
    out: *mut vk::DeviceSize,
) {
    guard("vkGetDeviceMemoryCommitment", move || {
        // Only lazily allocated memory types have a commitment, and there are none.
        *out = 0;
    })
}

/// All memory is equal, so a priority has no effect.
pub(crate) unsafe extern "system" fn vkSetDeviceMemoryPriorityEXT(
    _device: vk::Device,
    _memory: vk::DeviceMemory,
    _priority: f32,
) {
}

pub(crate) unsafe extern "system" fn vkGetDeviceMemoryOpaqueCaptureAddress(
    _device: vk::Device,
    info: *const vk::DeviceMemoryOpaqueCaptureAddressInfo,
) -> u64 {
    guard("vkGetDeviceMemoryOpaqueCaptureAddress", move || {
        from_handle::<DeviceMemory>((*info).memory).address
    })
}

pub(crate) unsafe extern "system" fn vkGetMemoryHostPointerPropertiesEXT(
    _device: vk::Device,
    _ty: vk::ExternalMemoryHandleTypeFlags,
    pointer: *const c_void,
    out: *mut vk::MemoryHostPointerPropertiesEXT,
) -> vk::Result {
    guard_result("vkGetMemoryHostPointerPropertiesEXT", move || {
        if !(pointer as u64).is_multiple_of(PAGE_BYTES) {
            return Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE);
        }
        (*out).memory_type_bits = 1;
        Ok(())
    })
}
