//! `VK_EXT_descriptor_buffer`: descriptors in the application's memory.
//!
//! A descriptor of any type is a [`StoredDescriptor`] there, so a set is bound by its address. It
//! holds no pointer of the driver: keys name views and samplers.

use std::ffi::c_void;

use ash::vk;
use images::Format;
use smallvec::SmallVec;
use spirv_jit::environment::{Descriptor, StoredDescriptor};
use spirv_jit::views::Views;

use super::push_descriptor::bind_points;
use super::record::record;
use crate::VkResult;
use crate::command::{BindDescriptorBuffer, BindDescriptorSets, Command, Recording};
use crate::device::Device;
use crate::ffi::{self, chain};
use crate::guard::{guard, guard_result};
use crate::handle::{self, Ref, from_handle, optional};
use crate::object::{
    AccelerationStructure, AccelerationStructureNv, Buffer, DescriptorSet, DescriptorSetLayout,
    ImageView, PipelineLayout, Sampler,
};

/// The captured address or key of an object (`VkOpaqueCaptureDescriptorDataCreateInfoEXT`), to be
/// replayed.
///
/// # Safety
/// As [`chain::nodes`].
pub(super) unsafe fn captured(next: *const c_void) -> Option<u64> {
    // SAFETY: the caller keeps the promises of `chain::nodes`; the data is what a capture wrote.
    unsafe {
        let info = chain::find::<vk::OpaqueCaptureDescriptorDataCreateInfoEXT>(next)?;
        let data: *const u64 = info.opaque_capture_descriptor_data.cast();
        (!data.is_null()).then(|| data.read_unaligned())
    }
}

/// The part of a descriptor for a sampler or an image view.
///
/// # Safety
/// `info` is null or valid; what it names is alive or null.
unsafe fn image_descriptor(
    ty: vk::DescriptorType,
    info: *const vk::DescriptorImageInfo,
) -> StoredDescriptor {
    // SAFETY: the caller guarantees that `info` is null or valid; what it names is alive or null.
    unsafe {
        let view = info
            .as_ref()
            .and_then(|info| optional::<ImageView>(info.image_view));
        StoredDescriptor {
            image: view.map_or(0, |view| view.entry(ty).key.0),
            ..StoredDescriptor::default()
        }
    }
}

/// # Safety
/// As [`image_descriptor`].
unsafe fn sampler_key(sampler: vk::Sampler) -> u64 {
    // SAFETY: the caller keeps the promises of `image_descriptor`.
    unsafe { optional::<Sampler>(sampler) }.map_or(0, |sampler| sampler.descriptor.key.0)
}

/// The range of a descriptor; `None` for the null descriptor.
///
/// # Safety
/// `info` is null or valid.
unsafe fn range_of<'a>(
    info: *const vk::DescriptorAddressInfoEXT<'a>,
) -> Option<&'a vk::DescriptorAddressInfoEXT<'a>> {
    // SAFETY: the caller guarantees that `info` is null or valid.
    unsafe { info.as_ref() }.filter(|info| info.address != 0)
}

/// The descriptor for a `VkDescriptorGetInfoEXT`.
///
/// # Safety
/// Valid usage of `vkGetDescriptorEXT`.
unsafe fn descriptor(views: &Views, info: &vk::DescriptorGetInfoEXT<'_>) -> StoredDescriptor {
    use vk::DescriptorType as Ty;
    // SAFETY: the caller guarantees valid usage of `vkGetDescriptorEXT`; the type says which part
    // of the union there is.
    unsafe {
        let data = &info.data;
        let null = StoredDescriptor::default();
        match info.ty {
            Ty::SAMPLER => StoredDescriptor {
                sampler: data
                    .p_sampler
                    .as_ref()
                    .map_or(0, |&sampler| sampler_key(sampler)),
                ..null
            },
            Ty::COMBINED_IMAGE_SAMPLER => StoredDescriptor {
                sampler: data
                    .p_combined_image_sampler
                    .as_ref()
                    .map_or(0, |info| sampler_key(info.sampler)),
                ..image_descriptor(info.ty, data.p_combined_image_sampler)
            },
            Ty::SAMPLED_IMAGE => image_descriptor(info.ty, data.p_sampled_image),
            Ty::STORAGE_IMAGE => image_descriptor(info.ty, data.p_storage_image),
            Ty::INPUT_ATTACHMENT => image_descriptor(info.ty, data.p_input_attachment_image),
            Ty::UNIFORM_TEXEL_BUFFER | Ty::STORAGE_TEXEL_BUFFER => {
                range_of(data.p_uniform_texel_buffer).map_or(null, |info| {
                    let format = Format(info.format.as_raw() as u32);
                    Descriptor::texel_buffer(info.address, info.range, format).into()
                })
            }
            Ty::ACCELERATION_STRUCTURE_KHR | Ty::ACCELERATION_STRUCTURE_NV => StoredDescriptor {
                address: match views.structure_key(data.acceleration_structure) {
                    Some(key) => key.0 | StoredDescriptor::STRUCTURE,
                    None => data.acceleration_structure,
                },
                ..null
            },
            _ => range_of(data.p_uniform_buffer).map_or(null, |info| StoredDescriptor {
                address: info.address,
                size_bytes: info.range,
                ..null
            }),
        }
    }
}

pub(crate) unsafe extern "system" fn vkGetDescriptorSetLayoutSizeEXT(
    _device: vk::Device,
    layout: vk::DescriptorSetLayout,
    size: *mut vk::DeviceSize,
) {
    guard("vkGetDescriptorSetLayoutSizeEXT", move || {
        *size = from_handle::<DescriptorSetLayout>(layout)
            .buffer_layout()
            .size_bytes;
    })
}

pub(crate) unsafe extern "system" fn vkGetDescriptorSetLayoutBindingOffsetEXT(
    _device: vk::Device,
    layout: vk::DescriptorSetLayout,
    binding: u32,
    offset: *mut vk::DeviceSize,
) {
    guard("vkGetDescriptorSetLayoutBindingOffsetEXT", move || {
        let layout = from_handle::<DescriptorSetLayout>(layout);
        *offset = layout
            .binding(binding)
            .map_or(0, |binding| layout.buffer_layout().offset_of(binding));
    })
}

pub(crate) unsafe extern "system" fn vkGetDescriptorEXT(
    device: vk::Device,
    info: *const vk::DescriptorGetInfoEXT,
    data_size: usize,
    data: *mut c_void,
) {
    guard("vkGetDescriptorEXT", move || {
        let views = &from_handle::<Device>(device).engine.views;
        let descriptor = descriptor(views, &*info);
        let bytes = std::ptr::from_ref(&descriptor).cast::<u8>();
        data.cast::<u8>()
            .copy_from(bytes, data_size.min(size_of::<StoredDescriptor>()));
    })
}

pub(crate) unsafe extern "system" fn vkGetBufferOpaqueCaptureDescriptorDataEXT(
    _device: vk::Device,
    info: *const vk::BufferCaptureDescriptorDataInfoEXT,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetBufferOpaqueCaptureDescriptorDataEXT", move || {
        // The address follows from the captured address of the memory; a sparse buffer captures its
        // own.
        data.cast::<u64>()
            .write_unaligned(from_handle::<Buffer>((*info).buffer).address());
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetImageOpaqueCaptureDescriptorDataEXT(
    _device: vk::Device,
    _info: *const vk::ImageCaptureDescriptorDataInfoEXT,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetImageOpaqueCaptureDescriptorDataEXT", move || {
        // Descriptors refer to views, so images have no capture data.
        data.cast::<u64>().write_unaligned(0);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetImageViewOpaqueCaptureDescriptorDataEXT(
    _device: vk::Device,
    info: *const vk::ImageViewCaptureDescriptorDataInfoEXT,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetImageViewOpaqueCaptureDescriptorDataEXT", move || {
        let view = from_handle::<ImageView>((*info).image_view);
        data.cast::<u64>().write_unaligned(view.descriptor.key.0);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetSamplerOpaqueCaptureDescriptorDataEXT(
    _device: vk::Device,
    info: *const vk::SamplerCaptureDescriptorDataInfoEXT,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetSamplerOpaqueCaptureDescriptorDataEXT", move || {
        let sampler = from_handle::<Sampler>((*info).sampler);
        data.cast::<u64>().write_unaligned(sampler.descriptor.key.0);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetAccelerationStructureOpaqueCaptureDescriptorDataEXT(
    device: vk::Device,
    info: *const vk::AccelerationStructureCaptureDescriptorDataInfoEXT,
    data: *mut c_void,
) -> vk::Result {
    guard_result(
        "vkGetAccelerationStructureOpaqueCaptureDescriptorDataEXT",
        move || {
            let structure = optional::<AccelerationStructure>((*info).acceleration_structure);
            let older = optional::<AccelerationStructureNv>((*info).acceleration_structure_nv);
            let structure = structure.or(older.map(|older| &*older.structure));
            let address = structure.map_or(0, |structure| structure.address());
            let key = from_handle::<Device>(device)
                .engine
                .views
                .structure_key(address);
            data.cast::<u64>()
                .write_unaligned(key.map_or(address, |key| key.0));
            Ok(())
        },
    )
}

/// A pipeline layout's set layout.
fn set_layout(layout: &PipelineLayout, set: u32) -> VkResult<&Ref<DescriptorSetLayout>> {
    let layout = layout.sets.get(set as usize).and_then(Option::as_ref);
    layout.ok_or(vk::Result::ERROR_UNKNOWN)
}

fn set_offsets(
    commands: &mut Recording,
    bind_point: vk::PipelineBindPoint,
    layout: &PipelineLayout,
    first_set: u32,
    buffers: &[u32],
    offsets: &[vk::DeviceSize],
) -> VkResult {
    for (index, (&buffer, &offset)) in buffers.iter().zip(offsets).enumerate() {
        let set = first_set + index as u32;
        let address = commands.descriptor_buffers.get(buffer as usize).copied();
        let address = address.ok_or(vk::Result::ERROR_UNKNOWN)?;
        commands.push(Command::BindDescriptorBuffer(BindDescriptorBuffer {
            bind_point,
            set,
            layout: Ref::clone(set_layout(layout, set)?),
            address: address.wrapping_add(offset),
        }))?;
    }
    Ok(())
}

fn bind_samplers(
    commands: &mut Recording,
    bind_point: vk::PipelineBindPoint,
    layout: &PipelineLayout,
    set: u32,
) -> VkResult {
    let samplers = handle::new(DescriptorSet::new(Ref::clone(set_layout(layout, set)?), 0)?);
    commands.push(Command::BindDescriptorSets(BindDescriptorSets {
        bind_point,
        first_set: set,
        sets: SmallVec::from_elem(Some(samplers), 1),
        dynamic_offsets: SmallVec::new(),
    }))
}

pub(crate) unsafe extern "system" fn vkCmdBindDescriptorBuffersEXT(
    commands: vk::CommandBuffer,
    count: u32,
    infos: *const vk::DescriptorBufferBindingInfoEXT,
) {
    record("vkCmdBindDescriptorBuffersEXT", commands, move |commands| {
        commands.descriptor_buffers = ffi::slice(infos, count)
            .iter()
            .map(|info| info.address)
            .collect();
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetDescriptorBufferOffsetsEXT(
    commands: vk::CommandBuffer,
    bind_point: vk::PipelineBindPoint,
    layout: vk::PipelineLayout,
    first_set: u32,
    count: u32,
    buffers: *const u32,
    offsets: *const vk::DeviceSize,
) {
    record(
        "vkCmdSetDescriptorBufferOffsetsEXT",
        commands,
        move |commands| {
            let layout = from_handle::<PipelineLayout>(layout);
            let (buffers, offsets) = (ffi::slice(buffers, count), ffi::slice(offsets, count));
            set_offsets(commands, bind_point, layout, first_set, buffers, offsets)
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdSetDescriptorBufferOffsets2EXT(
    commands: vk::CommandBuffer,
    info: *const vk::SetDescriptorBufferOffsetsInfoEXT<'_>,
) {
    record(
        "vkCmdSetDescriptorBufferOffsets2EXT",
        commands,
        move |commands| {
            let info = &*info;
            let layout = from_handle::<PipelineLayout>(info.layout);
            let buffers = ffi::slice(info.p_buffer_indices, info.set_count);
            let offsets = ffi::slice(info.p_offsets, info.set_count);
            for point in bind_points(info.stage_flags) {
                set_offsets(commands, point, layout, info.first_set, buffers, offsets)?;
            }
            Ok(())
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdBindDescriptorBufferEmbeddedSamplersEXT(
    commands: vk::CommandBuffer,
    bind_point: vk::PipelineBindPoint,
    layout: vk::PipelineLayout,
    set: u32,
) {
    record(
        "vkCmdBindDescriptorBufferEmbeddedSamplersEXT",
        commands,
        move |commands| {
            bind_samplers(
                commands,
                bind_point,
                from_handle::<PipelineLayout>(layout),
                set,
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdBindDescriptorBufferEmbeddedSamplers2EXT(
    commands: vk::CommandBuffer,
    info: *const vk::BindDescriptorBufferEmbeddedSamplersInfoEXT<'_>,
) {
    record(
        "vkCmdBindDescriptorBufferEmbeddedSamplers2EXT",
        commands,
        move |commands| {
            let info = &*info;
            for point in bind_points(info.stage_flags) {
                bind_samplers(
                    commands,
                    point,
                    from_handle::<PipelineLayout>(info.layout),
                    info.set,
                )?;
            }
            Ok(())
        },
    )
}
