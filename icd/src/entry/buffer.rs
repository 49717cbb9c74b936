//! Buffers and texel buffer views.

use ash::vk::{self, Handle};
use images::{Format, ImageDescriptor};

use super::address_report::report;
use super::descriptor_buffer::captured;
use crate::VkResult;
use crate::capabilities::limits::{MAX_BUFFER_BYTES, MEMORY_ALIGNMENT};
use crate::device::Device;
use crate::ffi::{self, chain};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle};
use crate::object::address_space::GRANULE;
use crate::object::address_space::Placement;
use crate::object::addressed::AddressEvent;
use crate::object::sparse::Reservation;
use crate::object::view_entry::ViewEntry;
use crate::object::{Buffer, BufferView, DeviceMemory};

pub(crate) unsafe extern "system" fn vkDestroyBufferView(
    _device: vk::Device,
    handle: vk::BufferView,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyBufferView", move || {
        drop(handle::take::<BufferView>(handle))
    })
}

/// Memory requirements of a resource.
pub fn requirements(size_bytes: u64, alignment: u64) -> vk::MemoryRequirements {
    vk::MemoryRequirements {
        size: size_bytes.next_multiple_of(alignment),
        alignment,
        memory_type_bits: 1,
    }
}

fn is_sparse(flags: vk::BufferCreateFlags) -> bool {
    flags.contains(vk::BufferCreateFlags::SPARSE_BINDING)
}

/// The placement of a sparse buffer. Its capture data for descriptor buffers is its address, too.
///
/// # Safety
/// `info` is valid usage of `vkCreateBuffer`.
unsafe fn sparse_placement(info: &vk::BufferCreateInfo<'_>) -> Placement {
    let replayable = vk::BufferCreateFlags::DEVICE_ADDRESS_CAPTURE_REPLAY
        | vk::BufferCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT;
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateBuffer`.
    let address = unsafe {
        chain::find::<vk::BufferOpaqueCaptureAddressCreateInfo>(info.p_next)
            .map(|captured| captured.opaque_capture_address)
            .filter(|&address| address != 0)
            .or_else(|| captured(info.p_next))
    };
    Placement::new(info.flags.intersects(replayable), address)
}

fn alignment(flags: vk::BufferCreateFlags) -> u64 {
    match is_sparse(flags) {
        true => GRANULE,
        false => MEMORY_ALIGNMENT,
    }
}

/// Fills a requirements structure and its chain. A dedicated allocation is never needed.
///
/// # Safety
/// `out` is valid, with a valid chain.
pub unsafe fn write_requirements(
    out: *mut vk::MemoryRequirements2<'_>,
    size_bytes: u64,
    alignment: u64,
) {
    // SAFETY: the caller guarantees that `out` is valid, with a valid chain.
    unsafe {
        (*out).memory_requirements = requirements(size_bytes, alignment);
        if let Some(dedicated) = chain::find_mut::<vk::MemoryDedicatedRequirements>((*out).p_next) {
            dedicated.prefers_dedicated_allocation = vk::FALSE;
            dedicated.requires_dedicated_allocation = vk::FALSE;
        }
    }
}

/// Binds a buffer to memory.
///
/// # Safety
/// The handles are alive.
unsafe fn bind(
    device: vk::Device,
    handle: vk::Buffer,
    memory: vk::DeviceMemory,
    offset: u64,
) -> VkResult<()> {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        let buffer = from_handle::<Buffer>(handle);
        buffer.bind(from_handle::<DeviceMemory>(memory).place(offset, buffer.size_bytes)?);
        register(from_handle::<Device>(device), handle, buffer);
        report::<Buffer>(device, handle, AddressEvent::Bound);
    }
    Ok(())
}

/// Registers a buffer with an address for validation.
fn register(device: &Device, handle: vk::Buffer, buffer: &Buffer) {
    if let Some(validator) = device.validator() {
        let registry = &validator.registry;
        registry.add_buffer(
            handle.as_raw(),
            buffer.address(),
            buffer.size_bytes,
            buffer.usage,
        );
    }
}

pub(crate) unsafe extern "system" fn vkDestroyBuffer(
    device: vk::Device,
    buffer: vk::Buffer,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyBuffer", move || {
        if let (Some(object), Some(validator)) = (
            handle::optional::<Buffer>(buffer),
            from_handle::<Device>(device).validator(),
        ) {
            validator
                .registry
                .remove_buffer(buffer.as_raw(), object.address());
        }
        report::<Buffer>(device, buffer, AddressEvent::Unbound);
        drop(handle::take::<Buffer>(buffer));
    })
}

pub(crate) unsafe extern "system" fn vkCreateBuffer(
    device: vk::Device,
    info: *const vk::BufferCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Buffer,
) -> vk::Result {
    guard_result("vkCreateBuffer", move || {
        let info = &*info;
        if info.size > MAX_BUFFER_BYTES {
            return Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
        }
        let usage = match chain::find::<vk::BufferUsageFlags2CreateInfoKHR>(info.p_next) {
            // The first 32 flags are those of Vulkan 1.0.
            Some(more) => vk::BufferUsageFlags::from_raw(more.usage.as_raw() as u32),
            None => info.usage,
        };
        let mut buffer = Buffer::new(info.size, usage, info.flags);
        let is_sparse = is_sparse(info.flags);
        if is_sparse {
            let window = &from_handle::<Device>(device).window;
            buffer = buffer.reserved(Reservation::new(window, info.size, sparse_placement(info))?);
        }
        *out = handle::create(buffer);
        if is_sparse {
            register(
                from_handle::<Device>(device),
                *out,
                from_handle::<Buffer>(*out),
            );
            report::<Buffer>(device, *out, AddressEvent::Created);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetBufferMemoryRequirements(
    _device: vk::Device,
    buffer: vk::Buffer,
    out: *mut vk::MemoryRequirements,
) {
    guard("vkGetBufferMemoryRequirements", move || {
        let buffer = from_handle::<Buffer>(buffer);
        *out = requirements(buffer.size_bytes, alignment(buffer.flags));
    })
}

pub(crate) unsafe extern "system" fn vkGetBufferMemoryRequirements2(
    _device: vk::Device,
    info: *const vk::BufferMemoryRequirementsInfo2,
    out: *mut vk::MemoryRequirements2,
) {
    guard("vkGetBufferMemoryRequirements2", move || {
        let buffer = from_handle::<Buffer>((*info).buffer);
        write_requirements(out, buffer.size_bytes, alignment(buffer.flags));
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceBufferMemoryRequirements(
    _device: vk::Device,
    info: *const vk::DeviceBufferMemoryRequirements,
    out: *mut vk::MemoryRequirements2,
) {
    guard("vkGetDeviceBufferMemoryRequirements", move || {
        let info = &*(*info).p_create_info;
        write_requirements(out, info.size, alignment(info.flags));
    })
}

pub(crate) unsafe extern "system" fn vkBindBufferMemory(
    device: vk::Device,
    buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    offset: vk::DeviceSize,
) -> vk::Result {
    guard_result("vkBindBufferMemory", move || {
        bind(device, buffer, memory, offset)
    })
}

pub(crate) unsafe extern "system" fn vkBindBufferMemory2(
    device: vk::Device,
    count: u32,
    infos: *const vk::BindBufferMemoryInfo,
) -> vk::Result {
    guard_result("vkBindBufferMemory2", move || {
        for info in ffi::slice(infos, count) {
            let bound = bind(device, info.buffer, info.memory, info.memory_offset);
            if let Some(status) = ffi::find::<vk::BindMemoryStatusKHR<'_>>(info.p_next) {
                *status.p_result = bound.err().unwrap_or(vk::Result::SUCCESS);
            }
            bound?;
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetBufferDeviceAddress(
    _device: vk::Device,
    info: *const vk::BufferDeviceAddressInfo,
) -> vk::DeviceAddress {
    guard("vkGetBufferDeviceAddress", move || {
        from_handle::<Buffer>((*info).buffer).address()
    })
}

pub(crate) unsafe extern "system" fn vkGetBufferOpaqueCaptureAddress(
    _device: vk::Device,
    info: *const vk::BufferDeviceAddressInfo,
) -> u64 {
    guard("vkGetBufferOpaqueCaptureAddress", move || {
        // The address follows from the captured address of the memory; a sparse buffer captures its
        // own.
        from_handle::<Buffer>((*info).buffer).address()
    })
}

pub(crate) unsafe extern "system" fn vkCreateBufferView(
    device: vk::Device,
    info: *const vk::BufferViewCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::BufferView,
) -> vk::Result {
    guard_result("vkCreateBufferView", move || {
        let device = from_handle::<Device>(device);
        let info = &*info;
        let buffer = from_handle::<Buffer>(info.buffer);
        // The view ends with the buffer, since existing engines request more (against
        // VUID-VkBufferViewCreateInfo-offset-00931).
        let there = buffer.size_bytes.saturating_sub(info.offset);
        let (data, size_bytes) = buffer.range(info.offset, info.range.min(there))?;
        let format = Format(info.format.as_raw() as u32);
        let descriptor = ImageDescriptor::texel_buffer(data, size_bytes, format);
        *out = handle::create(BufferView {
            descriptor: ViewEntry::store(&device.engine.views, |it| &it.images, descriptor, None)?,
        });
        Ok(())
    })
}
