//! Buffers and texel buffer views.

use ash::vk;

use super::destroy;
use crate::ffi::{self, chain, entry};
use crate::handle::{self, from_handle};
use crate::object::image::{SendDescriptor, texel_buffer_descriptor};
use crate::object::{Buffer, BufferView, Device, DeviceMemory};
use crate::table::limits::{MAX_BUFFER_BYTES, MEMORY_ALIGNMENT};

destroy! {
    vkDestroyBuffer: Buffer, Buffer;
    vkDestroyBufferView: BufferView, BufferView;
}

/// What memory a resource needs.
pub fn requirements(size_bytes: u64) -> vk::MemoryRequirements {
    vk::MemoryRequirements {
        size: size_bytes.next_multiple_of(MEMORY_ALIGNMENT),
        alignment: MEMORY_ALIGNMENT,
        memory_type_bits: 1,
    }
}

/// Answers a requirements structure and its chain. A dedicated allocation is never needed.
///
/// # Safety
/// `out` is valid, with a valid chain.
pub unsafe fn write_requirements(out: *mut vk::MemoryRequirements2<'_>, size_bytes: u64) {
    // SAFETY: the caller's promise.
    unsafe {
        (*out).memory_requirements = requirements(size_bytes);
        if let Some(dedicated) = chain::find_mut::<vk::MemoryDedicatedRequirements>((*out).p_next) {
            dedicated.prefers_dedicated_allocation = vk::FALSE;
            dedicated.requires_dedicated_allocation = vk::FALSE;
        }
    }
}

entry! {
    fn vkCreateBuffer(
        _device: vk::Device,
        info: *const vk::BufferCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Buffer,
    ) -> vk::Result {
        let info = &*info;
        if info.size > MAX_BUFFER_BYTES {
            return Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
        }
        *out = handle::create(Buffer::new(info.size, info.usage, info.flags));
        Ok(())
    }

    fn vkGetBufferMemoryRequirements(_device: vk::Device, buffer: vk::Buffer, out: *mut vk::MemoryRequirements) {
        *out = requirements(from_handle::<Buffer>(buffer).size_bytes);
    }

    fn vkGetBufferMemoryRequirements2(
        _device: vk::Device,
        info: *const vk::BufferMemoryRequirementsInfo2,
        out: *mut vk::MemoryRequirements2,
    ) {
        write_requirements(out, from_handle::<Buffer>((*info).buffer).size_bytes);
    }

    fn vkGetDeviceBufferMemoryRequirements(
        _device: vk::Device,
        info: *const vk::DeviceBufferMemoryRequirements,
        out: *mut vk::MemoryRequirements2,
    ) {
        write_requirements(out, (*(*info).p_create_info).size);
    }

    fn vkBindBufferMemory(
        _device: vk::Device,
        buffer: vk::Buffer,
        memory: vk::DeviceMemory,
        offset: vk::DeviceSize,
    ) -> vk::Result {
        from_handle::<Buffer>(buffer).bind(from_handle::<DeviceMemory>(memory).address + offset);
        Ok(())
    }

    fn vkBindBufferMemory2(_device: vk::Device, count: u32, infos: *const vk::BindBufferMemoryInfo) -> vk::Result {
        for info in ffi::slice(infos, count) {
            let memory = from_handle::<DeviceMemory>(info.memory);
            from_handle::<Buffer>(info.buffer).bind(memory.address + info.memory_offset);
        }
        Ok(())
    }

    fn vkGetBufferDeviceAddress(_device: vk::Device, info: *const vk::BufferDeviceAddressInfo) -> vk::DeviceAddress {
        from_handle::<Buffer>((*info).buffer).address()
    }

    fn vkGetBufferOpaqueCaptureAddress(_device: vk::Device, info: *const vk::BufferDeviceAddressInfo) -> u64 {
        // The address follows from that of the memory, which is what is captured.
        from_handle::<Buffer>((*info).buffer).address()
    }

    fn vkCreateBufferView(
        device: vk::Device,
        info: *const vk::BufferViewCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::BufferView,
    ) -> vk::Result {
        let device = from_handle::<Device>(device);
        let info = &*info;
        let (data, size_bytes) = from_handle::<Buffer>(info.buffer).range(info.offset, info.range)?;
        let descriptor = texel_buffer_descriptor(data, size_bytes, info.format);
        *out = handle::create(BufferView {
            descriptor: device.image_descriptors.store(SendDescriptor(descriptor)),
        });
        Ok(())
    }
}
