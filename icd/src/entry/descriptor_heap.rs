//! `VK_EXT_descriptor_heap`: descriptors in the application's memory, without sets and objects.
//!
//! A descriptor there is a [`StoredDescriptor`], as in a descriptor buffer. It holds no pointer of
//! the driver and is checked at each use.

use images::Format;
use smallvec::SmallVec;
use spirv_jit::descriptor_heap::{DESCRIPTOR_BYTES, Table};
use spirv_jit::environment::{Descriptor, StoredDescriptor};

use super::image::{slices_of, view};
use super::record::record;
use crate::VkResult;
use crate::command::{BindHeap, Command, Recording};
use crate::decode::sampler::decode_sampler;
use crate::device::Device;
use crate::ffi::array::slice_mut;
use crate::ffi::{self, chain, vk};
use crate::guard::{guard, guard_result};
use crate::handle::from_handle;
use crate::object::Image;

/// Writes a descriptor to host memory.
///
/// # Safety
/// The range is valid.
unsafe fn write(descriptor: &StoredDescriptor, to: &vk::HostAddressRangeEXT) {
    let bytes = std::ptr::from_ref(descriptor).cast::<u8>();
    // SAFETY: the caller guarantees that the range is valid.
    unsafe {
        let size = to.size.min(size_of::<StoredDescriptor>());
        to.address.cast::<u8>().copy_from(bytes, size);
    }
}

/// The descriptor of a resource.
///
/// # Safety
/// Valid usage of `vkWriteResourceDescriptorsEXT`.
unsafe fn descriptor(
    device: &Device,
    info: &vk::ResourceDescriptorInfoEXT<'_>,
) -> VkResult<StoredDescriptor> {
    use vk::DescriptorType as Ty;
    let views = &device.engine.views;
    let null = StoredDescriptor::default();
    // SAFETY: the caller guarantees valid usage of `vkWriteResourceDescriptorsEXT`; the type says
    // which part of the union there is.
    unsafe {
        let (data, ty) = (&info.data, info.ty);
        Ok(match ty {
            Ty::SAMPLED_IMAGE | Ty::STORAGE_IMAGE | Ty::INPUT_ATTACHMENT => {
                let Some(info) = data.p_image.as_ref() else {
                    return Ok(null);
                };
                let is_storage = ty == Ty::STORAGE_IMAGE;
                let info = &*info.p_view;
                let image = from_handle::<Image>(info.image);
                let all = view(info)?;
                let slices = slices_of(info, &all).filter(|_| is_storage);
                StoredDescriptor {
                    image: image.heap_view(views, slices.unwrap_or(all))?.0,
                    ..null
                }
            }
            Ty::UNIFORM_TEXEL_BUFFER | Ty::STORAGE_TEXEL_BUFFER => {
                let info = data.p_texel_buffer.as_ref();
                let info = info.filter(|info| info.address_range.address != 0);
                info.map_or(null, |info| {
                    let format = Format(info.format.as_raw() as u32);
                    let range = info.address_range;
                    Descriptor::texel_buffer(range.address, range.size, format).into()
                })
            }
            Ty::ACCELERATION_STRUCTURE_KHR | Ty::ACCELERATION_STRUCTURE_NV => {
                // The address alone, so that the same range has the same bits on every device.
                let address = data.p_address_range.as_ref().map_or(0, |it| it.address);
                StoredDescriptor { address, ..null }
            }
            _ => {
                let range = data.p_address_range.as_ref().filter(|it| it.address != 0);
                range.map_or(null, |range| StoredDescriptor {
                    address: range.address,
                    size_bytes: range.size,
                    ..null
                })
            }
        })
    }
}

/// Records the binding of a heap.
pub(super) fn bind_heap(
    commands: &mut Recording,
    table: Table,
    info: &vk::BindHeapInfoEXT<'_>,
) -> VkResult {
    commands.push(Command::BindHeap(BindHeap {
        table,
        address: info.heap_range.address,
        size_bytes: info.heap_range.size,
    }))
}

/// Binds the heaps that a secondary command buffer inherits.
///
/// # Safety
/// The chain is valid.
pub(super) unsafe fn inherit_heaps(
    commands: &mut Recording,
    next: *const std::ffi::c_void,
) -> VkResult {
    // SAFETY: the caller guarantees that the chain is valid.
    let (samplers, resources) = unsafe {
        type Info<'a> = vk::CommandBufferInheritanceDescriptorHeapInfoEXT<'a>;
        let Some(info) = chain::find::<Info<'_>>(next) else {
            return Ok(());
        };
        (
            info.p_sampler_heap_bind_info.as_ref(),
            info.p_resource_heap_bind_info.as_ref(),
        )
    };
    for (table, info) in [(Table::Samplers, samplers), (Table::Resources, resources)] {
        if let Some(info) = info {
            bind_heap(commands, table, info)?;
        }
    }
    Ok(())
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceDescriptorSizeEXT(
    _physical: vk::PhysicalDevice,
    _ty: vk::DescriptorType,
) -> vk::DeviceSize {
    guard("vkGetPhysicalDeviceDescriptorSizeEXT", move || {
        vk::DeviceSize::from(DESCRIPTOR_BYTES)
    })
}

pub(crate) unsafe extern "system" fn vkWriteSamplerDescriptorsEXT(
    device: vk::Device,
    count: u32,
    samplers: *const vk::SamplerCreateInfo<'_>,
    descriptors: *const vk::HostAddressRangeEXT,
) -> vk::Result {
    guard_result("vkWriteSamplerDescriptorsEXT", move || {
        let known = &from_handle::<Device>(device).engine.heap_samplers;
        let targets = ffi::slice(descriptors, count);
        for (info, to) in ffi::slice(samplers, count).iter().zip(targets) {
            let sampler = known.key(&decode_sampler(info))?.0;
            write(
                &StoredDescriptor {
                    sampler,
                    ..StoredDescriptor::default()
                },
                to,
            );
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkWriteResourceDescriptorsEXT(
    device: vk::Device,
    count: u32,
    resources: *const vk::ResourceDescriptorInfoEXT<'_>,
    descriptors: *const vk::HostAddressRangeEXT,
) -> vk::Result {
    guard_result("vkWriteResourceDescriptorsEXT", move || {
        let device = from_handle::<Device>(device);
        let targets = ffi::slice(descriptors, count);
        for (info, to) in ffi::slice(resources, count).iter().zip(targets) {
            write(&descriptor(device, info)?, to);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetImageOpaqueCaptureDataEXT(
    _device: vk::Device,
    count: u32,
    images: *const vk::Image,
    data: *mut vk::HostAddressRangeEXT,
) -> vk::Result {
    guard_result("vkGetImageOpaqueCaptureDataEXT", move || {
        let targets = slice_mut(data, count);
        for (&image, to) in ffi::slice(images, count).iter().zip(targets) {
            let captured = from_handle::<Image>(image).capture_data().to_ne_bytes();
            let size = to.size.min(captured.len());
            to.address.cast::<u8>().copy_from(captured.as_ptr(), size);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkRegisterCustomBorderColorEXT(
    device: vk::Device,
    _color: *const vk::SamplerCustomBorderColorCreateInfoEXT<'_>,
    wants_index: vk::Bool32,
    index: *mut u32,
) -> vk::Result {
    guard_result("vkRegisterCustomBorderColorEXT", move || {
        let mut colors = from_handle::<Device>(device)
            .engine
            .heap_samplers
            .border_colors
            .lock();
        colors
            .try_reserve(1)
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        if wants_index != vk::FALSE {
            let taken = vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS;
            return colors.insert(*index).then_some(()).ok_or(taken);
        }
        let free = (0..=colors.len() as u32).find(|it| !colors.contains(it));
        *index = free.ok_or(vk::Result::ERROR_TOO_MANY_OBJECTS)?;
        colors.insert(*index);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkUnregisterCustomBorderColorEXT(
    device: vk::Device,
    index: u32,
) {
    guard("vkUnregisterCustomBorderColorEXT", move || {
        from_handle::<Device>(device)
            .engine
            .heap_samplers
            .border_colors
            .lock()
            .remove(&index);
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindSamplerHeapEXT(
    commands: vk::CommandBuffer,
    info: *const vk::BindHeapInfoEXT<'_>,
) {
    record("vkCmdBindSamplerHeapEXT", commands, move |commands| {
        bind_heap(commands, Table::Samplers, &*info)
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindResourceHeapEXT(
    commands: vk::CommandBuffer,
    info: *const vk::BindHeapInfoEXT<'_>,
) {
    record("vkCmdBindResourceHeapEXT", commands, move |commands| {
        bind_heap(commands, Table::Resources, &*info)
    })
}

pub(crate) unsafe extern "system" fn vkCmdPushDataEXT(
    commands: vk::CommandBuffer,
    info: *const vk::PushDataInfoEXT<'_>,
) {
    record("vkCmdPushDataEXT", commands, move |commands| {
        let info = &*info;
        let bytes: &[u8] = ffi::slice(info.data.address.cast(), info.data.size as u32);
        commands.push(Command::PushConstants {
            offset: info.offset,
            bytes: SmallVec::from_slice(bytes),
        })
    })
}
