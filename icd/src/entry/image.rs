//! Images, image views and samplers.

use ash::vk;
use images::ImageDescriptor;
use spirv_jit::reach::Range;
use spirv_jit::views::Key;

use super::address_report::{report, report_bound};
use super::buffer::{requirements, write_requirements};
use super::descriptor_buffer::captured;
use crate::VkResult;
use crate::capabilities::limits::CAPTURE_BYTES;
use crate::decode::image::image_info;
use crate::decode::sampler::decode_sampler;
use crate::device::Device;
use crate::ffi::enumerate::enumerate_with;
use crate::ffi::{self, chain, enumerate, vk as newer};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle};
use crate::object::address_space::Placement;
use crate::object::addressed::AddressEvent;
use crate::object::image_view::{sliced, view_descriptor};
use crate::object::resident;
use crate::object::sparse::Reservation;
use crate::object::view_entry::ViewEntry;
use crate::object::{DeviceMemory, Image, ImageView, Sampler, YcbcrConversion};
use crate::present::Swapchain;

pub(crate) unsafe extern "system" fn vkDestroySamplerYcbcrConversion(
    _device: vk::Device,
    handle: vk::SamplerYcbcrConversion,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroySamplerYcbcrConversion", move || {
        drop(handle::take::<YcbcrConversion>(handle))
    })
}

/// The layout of a subresource, with its offset from the image's first byte.
pub(super) fn subresource_layout(
    image: &Image,
    subresource: &vk::ImageSubresource,
) -> VkResult<vk::SubresourceLayout> {
    const OUTSIDE: vk::Result = vk::Result::ERROR_UNKNOWN;
    let plane = image.plane(subresource.aspect_mask).ok_or(OUTSIDE)?;
    let level = plane
        .levels
        .get(subresource.mip_level as usize)
        .ok_or(OUTSIDE)?;
    Ok(vk::SubresourceLayout {
        offset: level.offset_bytes + u64::from(subresource.array_layer) * plane.layer_stride_bytes,
        size: level.slice_stride_bytes * u64::from(level.depth),
        row_pitch: level.row_stride_bytes,
        array_pitch: plane.layer_stride_bytes,
        depth_pitch: level.slice_stride_bytes,
    })
}

/// The descriptor of a view.
///
/// # Errors
/// `VK_ERROR_UNKNOWN` for an image without memory, and as [`view_descriptor`].
///
/// # Safety
/// `info` is valid usage of `vkCreateImageView`.
pub(super) unsafe fn view(info: &vk::ImageViewCreateInfo<'_>) -> VkResult<ImageDescriptor> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateImageView`.
    let (image, min_lod, conversion) = unsafe {
        (
            from_handle::<Image>(info.image),
            chain::find::<vk::ImageViewMinLodCreateInfoEXT>(info.p_next),
            chain::find::<vk::SamplerYcbcrConversionInfo>(info.p_next)
                .and_then(|info| handle::optional::<YcbcrConversion>(info.conversion)),
        )
    };
    if image.data().is_null() {
        return Err(vk::Result::ERROR_UNKNOWN);
    }
    view_descriptor(
        image,
        info.view_type,
        info.format,
        info.components,
        &info.subresource_range,
        min_lod.map_or(0.0, |min| min.min_lod),
        conversion.map(|conversion| conversion.conversion),
    )
}

/// The descriptor of storage images, if those see only some slices of a view.
///
/// # Safety
/// As [`view`].
pub(super) unsafe fn slices_of(
    info: &vk::ImageViewCreateInfo<'_>,
    view: &ImageDescriptor,
) -> Option<ImageDescriptor> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateImageView`.
    let slices = unsafe { chain::find::<vk::ImageViewSlicedCreateInfoEXT>(info.p_next) };
    slices
        .filter(|_| info.view_type == vk::ImageViewType::TYPE_3D)
        .map(|slices| sliced(*view, slices))
}

fn is_sparse(flags: vk::ImageCreateFlags) -> bool {
    flags.contains(vk::ImageCreateFlags::SPARSE_BINDING)
}

/// The captured opaque data of an image (`VkOpaqueCaptureDataCreateInfoEXT`), to replay its
/// descriptors in heaps.
///
/// # Errors
/// `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` for data of another size.
///
/// # Safety
/// As [`chain::nodes`].
unsafe fn captured_image(next: *const std::ffi::c_void) -> VkResult<Option<u64>> {
    // SAFETY: the caller keeps the promises of `chain::nodes`; the range holds as many bytes as it
    // says.
    unsafe {
        let info = chain::find::<newer::OpaqueCaptureDataCreateInfoEXT<'_>>(next);
        let Some(range) = info.and_then(|info| info.p_data.as_ref()) else {
            return Ok(None);
        };
        if range.size != CAPTURE_BYTES || range.address.is_null() {
            return Err(vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS);
        }
        Ok(Some(range.address.cast::<u64>().read_unaligned()))
    }
}

pub(crate) unsafe extern "system" fn vkDestroyImage(
    device: vk::Device,
    image: vk::Image,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyImage", move || {
        if let Some(image) = handle::optional::<Image>(image) {
            image.forget_identity();
        }
        report::<Image>(device, image, AddressEvent::Unbound);
        drop(handle::take::<Image>(image));
    })
}

pub(crate) unsafe extern "system" fn vkDestroyImageView(
    _device: vk::Device,
    view: vk::ImageView,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyImageView", move || {
        if let Some(view) = handle::take::<ImageView>(view) {
            view.descriptor.release();
        }
    })
}

pub(crate) unsafe extern "system" fn vkDestroySampler(
    _device: vk::Device,
    sampler: vk::Sampler,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroySampler", move || {
        if let Some(sampler) = handle::take::<Sampler>(sampler) {
            sampler.descriptor.release();
        }
    })
}

pub(crate) unsafe extern "system" fn vkCreateImage(
    device: vk::Device,
    info: *const vk::ImageCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Image,
) -> vk::Result {
    guard_result("vkCreateImage", move || {
        let info = image_info(&*info);
        let mut image = Image::new(&info)?;
        if info
            .flags
            .contains(vk::ImageCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT)
        {
            let identities = &from_handle::<Device>(device).engine.image_identities;
            image = image.identified(identities.take(captured_image(info.p_next)?)?);
        }
        if is_sparse(image.flags) {
            let window = &from_handle::<Device>(device).window;
            let reservation = Reservation::new(window, image.size_bytes, Placement::Ordinary)?;
            image = image.reserved(reservation);
        }
        *out = handle::create(image);
        // A sparse image has its addresses from the start.
        report::<Image>(device, *out, AddressEvent::Created);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetImageMemoryRequirements(
    _device: vk::Device,
    image: vk::Image,
    out: *mut vk::MemoryRequirements,
) {
    guard("vkGetImageMemoryRequirements", move || {
        let image = from_handle::<Image>(image);
        *out = requirements(image.size_bytes, Image::alignment(image.flags));
    })
}

pub(crate) unsafe extern "system" fn vkGetImageMemoryRequirements2(
    _device: vk::Device,
    info: *const vk::ImageMemoryRequirementsInfo2,
    out: *mut vk::MemoryRequirements2,
) {
    guard("vkGetImageMemoryRequirements2", move || {
        let image = from_handle::<Image>((*info).image);
        let plane = chain::find::<vk::ImagePlaneMemoryRequirementsInfo>((*info).p_next);
        let size_bytes = image.binding_size_bytes(plane.map(|plane| plane.plane_aspect));
        write_requirements(out, size_bytes, Image::alignment(image.flags));
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceImageMemoryRequirements(
    _device: vk::Device,
    info: *const vk::DeviceImageMemoryRequirements,
    out: *mut vk::MemoryRequirements2,
) {
    guard("vkGetDeviceImageMemoryRequirements", move || {
        // With valid usage the creation succeeds. An invalid image reports a size that cannot be
        // allocated.
        let aspect = (*info).plane_aspect;
        let info = image_info(&*(*info).p_create_info);
        let size_bytes =
            Image::new(&info).map_or(1 << 62, |image| image.binding_size_bytes(Some(aspect)));
        write_requirements(out, size_bytes, Image::alignment(info.flags));
    })
}

pub(crate) unsafe extern "system" fn vkGetImageSparseMemoryRequirements(
    _device: vk::Device,
    image: vk::Image,
    count: *mut u32,
    out: *mut vk::SparseImageMemoryRequirements,
) {
    guard("vkGetImageSparseMemoryRequirements", move || {
        let image = from_handle::<Image>(image);
        let all = resident::requirements(image.flags, image.format, image.mip_levels);
        let _ = enumerate(count, out, all.into_iter());
    })
}

pub(crate) unsafe extern "system" fn vkGetImageSparseMemoryRequirements2(
    _device: vk::Device,
    info: *const vk::ImageSparseMemoryRequirementsInfo2,
    count: *mut u32,
    out: *mut vk::SparseImageMemoryRequirements2,
) {
    guard("vkGetImageSparseMemoryRequirements2", move || {
        let image = from_handle::<Image>((*info).image);
        let all = resident::requirements(image.flags, image.format, image.mip_levels);
        let _ = enumerate_with(count, out, all.into_iter(), |out, it| {
            out.memory_requirements = it
        });
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceImageSparseMemoryRequirements(
    _device: vk::Device,
    info: *const vk::DeviceImageMemoryRequirements,
    count: *mut u32,
    out: *mut vk::SparseImageMemoryRequirements2,
) {
    guard("vkGetDeviceImageSparseMemoryRequirements", move || {
        let info = image_info(&*(*info).p_create_info);
        let all = resident::requirements(info.flags, info.format, info.mip_levels);
        let _ = enumerate_with(count, out, all.into_iter(), |out, it| {
            out.memory_requirements = it
        });
    })
}

pub(crate) unsafe extern "system" fn vkBindImageMemory(
    device: vk::Device,
    image: vk::Image,
    memory: vk::DeviceMemory,
    offset: vk::DeviceSize,
) -> vk::Result {
    guard_result("vkBindImageMemory", move || {
        let bound = from_handle::<Image>(image);
        bound.bind(from_handle::<DeviceMemory>(memory).place(offset, bound.size_bytes)?);
        report::<Image>(device, image, AddressEvent::Bound);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkBindImageMemory2(
    device: vk::Device,
    count: u32,
    infos: *const vk::BindImageMemoryInfo,
) -> vk::Result {
    guard_result("vkBindImageMemory2", move || {
        for info in ffi::slice(infos, count) {
            let status = ffi::find::<vk::BindMemoryStatusKHR<'_>>(info.p_next);
            if let Some(status) = status {
                *status.p_result = vk::Result::SUCCESS;
            }
            let image = from_handle::<Image>(info.image);
            if let Some(memory) = handle::optional::<DeviceMemory>(info.memory) {
                let plane = chain::find::<vk::BindImagePlaneMemoryInfo>(info.p_next);
                let aspect = plane.map(|plane| plane.plane_aspect);
                let size_bytes = image.binding_size_bytes(aspect);
                let address = memory.place(info.memory_offset, size_bytes);
                if let (Some(status), Err(code)) = (status, &address) {
                    *status.p_result = *code;
                }
                let start = address?;
                image.bind_plane(aspect, start);
                report_bound(device, info.image, Range { start, size_bytes });
            } else if let Some(from) = ffi::find::<vk::BindImageMemorySwapchainInfoKHR>(info.p_next)
            {
                let images = &from_handle::<Swapchain>(from.swapchain).images;
                let shared = images
                    .get(from.image_index as usize)
                    .ok_or(vk::Result::ERROR_UNKNOWN)?;
                image.bind(shared.data() as u64);
                report::<Image>(device, info.image, AddressEvent::Bound);
            }
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetImageSubresourceLayout(
    _device: vk::Device,
    image: vk::Image,
    subresource: *const vk::ImageSubresource,
    out: *mut vk::SubresourceLayout,
) {
    guard("vkGetImageSubresourceLayout", move || {
        *out = subresource_layout(from_handle::<Image>(image), &*subresource).unwrap_or_default();
    })
}

pub(crate) unsafe extern "system" fn vkCreateImageView(
    device: vk::Device,
    info: *const vk::ImageViewCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::ImageView,
) -> vk::Result {
    guard_result("vkCreateImageView", move || {
        let device = from_handle::<Device>(device);
        let info = &*info;
        let descriptor = view(info)?;
        let replays = info
            .flags
            .contains(vk::ImageViewCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT);
        let replay = replays.then(|| captured(info.p_next).map(Key));
        let slices = slices_of(info, &descriptor);
        let store = |descriptor, replay| {
            ViewEntry::store(&device.engine.views, |it| &it.images, descriptor, replay)
        };
        let descriptor = store(descriptor, replay)?;
        let slices = slices.map(|slices| store(slices, None)).transpose()?;
        let (image, range) = (handle::retain(info.image), info.subresource_range);
        *out = handle::create(ImageView {
            descriptor,
            slices,
            image,
            format: info.format,
            range,
        });
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateSamplerYcbcrConversion(
    _device: vk::Device,
    info: *const vk::SamplerYcbcrConversionCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::SamplerYcbcrConversion,
) -> vk::Result {
    guard_result("vkCreateSamplerYcbcrConversion", move || {
        *out = handle::create(YcbcrConversion::new(&*info)?);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateSampler(
    device: vk::Device,
    info: *const vk::SamplerCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Sampler,
) -> vk::Result {
    guard_result("vkCreateSampler", move || {
        let device = from_handle::<Device>(device);
        let info = &*info;
        let contents = decode_sampler(info);
        let replays = info
            .flags
            .contains(vk::SamplerCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT);
        let replay = replays.then(|| captured(info.p_next).map(Key));
        let descriptor =
            ViewEntry::store(&device.engine.views, |it| &it.samplers, contents, replay)?;
        *out = handle::create(Sampler { descriptor });
        Ok(())
    })
}
