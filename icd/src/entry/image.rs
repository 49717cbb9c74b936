//! Images, image views and samplers.

use ash::vk;
use images::{AddressMode, CompareOp, Filter, Reduction, SamplerDescriptor};
use spirv_jit::reach::Range;
use spirv_jit::views::Key;

use super::address_report::{destroy_addressed, report, report_bound};
use super::buffer::{requirements, write_requirements};
use super::define::entry;
use super::descriptor_buffer::captured;
use super::destroy;
use crate::VkResult;
use crate::device::Device;
use crate::ffi::enumerate::enumerate_with;
use crate::ffi::{self, chain, enumerate};
use crate::handle::{self, from_handle};
use crate::object::address_space::Placement;
use crate::object::addressed::AddressEvent;
use crate::object::image_view::{ViewEntry, sliced, view_descriptor};
use crate::object::resident;
use crate::object::sparse::Reservation;
use crate::object::{DeviceMemory, Image, ImageView, Sampler, YcbcrConversion};
use crate::present::Swapchain;

destroy_addressed! {
    vkDestroyImage: Image, Image;
}

destroy! {
    vkDestroySamplerYcbcrConversion: YcbcrConversion, SamplerYcbcrConversion;
}

/// Where a subresource lies, from the image's first byte.
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

fn filter(filter: vk::Filter) -> Filter {
    if filter == vk::Filter::LINEAR {
        Filter::Linear
    } else {
        Filter::Nearest
    }
}

fn address_mode(mode: vk::SamplerAddressMode) -> AddressMode {
    match mode {
        vk::SamplerAddressMode::MIRRORED_REPEAT => AddressMode::MirroredRepeat,
        vk::SamplerAddressMode::CLAMP_TO_EDGE => AddressMode::ClampToEdge,
        vk::SamplerAddressMode::CLAMP_TO_BORDER => AddressMode::ClampToBorder,
        vk::SamplerAddressMode::MIRROR_CLAMP_TO_EDGE => AddressMode::MirrorClampToEdge,
        _ => AddressMode::Repeat,
    }
}

fn compare(op: vk::CompareOp) -> CompareOp {
    match op {
        vk::CompareOp::LESS => CompareOp::Less,
        vk::CompareOp::EQUAL => CompareOp::Equal,
        vk::CompareOp::LESS_OR_EQUAL => CompareOp::LessOrEqual,
        vk::CompareOp::GREATER => CompareOp::Greater,
        vk::CompareOp::NOT_EQUAL => CompareOp::NotEqual,
        vk::CompareOp::GREATER_OR_EQUAL => CompareOp::GreaterOrEqual,
        vk::CompareOp::ALWAYS => CompareOp::Always,
        _ => CompareOp::Never,
    }
}

fn border_color(color: vk::BorderColor) -> [u32; 4] {
    const ONE: u32 = 1f32.to_bits();
    match color {
        vk::BorderColor::FLOAT_OPAQUE_BLACK => [0, 0, 0, ONE],
        vk::BorderColor::INT_OPAQUE_BLACK => [0, 0, 0, 1],
        vk::BorderColor::FLOAT_OPAQUE_WHITE => [ONE; 4],
        vk::BorderColor::INT_OPAQUE_WHITE => [1; 4],
        _ => [0; 4],
    }
}

/// The border color of a sampler, a custom one where it is given.
///
/// # Safety
/// `info` is valid usage of `vkCreateSampler`.
unsafe fn border(info: &vk::SamplerCreateInfo<'_>) -> [u32; 4] {
    // SAFETY: the caller's promise. A clear color is four words, whatever they mean.
    unsafe {
        chain::find::<vk::SamplerCustomBorderColorCreateInfoEXT>(info.p_next)
            .filter(|_| info.border_color.as_raw() >= vk::BorderColor::FLOAT_CUSTOM_EXT.as_raw())
            .map_or_else(
                || border_color(info.border_color),
                |custom| custom.custom_border_color.uint32,
            )
    }
}

fn sampler_descriptor(
    info: &vk::SamplerCreateInfo<'_>,
    reduction: vk::SamplerReductionMode,
    border_color: [u32; 4],
) -> SamplerDescriptor {
    SamplerDescriptor {
        mag_filter: filter(info.mag_filter),
        min_filter: filter(info.min_filter),
        mipmap_mode: if info.mipmap_mode == vk::SamplerMipmapMode::LINEAR {
            Filter::Linear
        } else {
            Filter::Nearest
        },
        address_mode: [
            info.address_mode_u,
            info.address_mode_v,
            info.address_mode_w,
        ]
        .map(address_mode),
        mip_lod_bias: info.mip_lod_bias,
        min_lod: info.min_lod,
        max_lod: info.max_lod,
        max_anisotropy: if info.anisotropy_enable == vk::TRUE {
            info.max_anisotropy
        } else {
            1.0
        },
        compare: (info.compare_enable == vk::TRUE).then(|| compare(info.compare_op)),
        reduction: match reduction {
            vk::SamplerReductionMode::MIN => Reduction::Min,
            vk::SamplerReductionMode::MAX => Reduction::Max,
            _ => Reduction::WeightedAverage,
        },
        border_color,
        unnormalized_coordinates: info.unnormalized_coordinates == vk::TRUE,
        non_seamless: info
            .flags
            .contains(vk::SamplerCreateFlags::NON_SEAMLESS_CUBE_MAP_EXT),
    }
}

fn is_sparse(flags: vk::ImageCreateFlags) -> bool {
    flags.contains(vk::ImageCreateFlags::SPARSE_BINDING)
}

entry! {
    fn vkDestroyImageView(_device: vk::Device, view: vk::ImageView, _allocator: *const vk::AllocationCallbacks) {
        if let Some(view) = handle::take::<ImageView>(view) {
            view.descriptor.release();
        }
    }

    fn vkDestroySampler(_device: vk::Device, sampler: vk::Sampler, _allocator: *const vk::AllocationCallbacks) {
        if let Some(sampler) = handle::take::<Sampler>(sampler) {
            sampler.descriptor.release();
        }
    }

    fn vkCreateImage(
        device: vk::Device,
        info: *const vk::ImageCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Image,
    ) -> vk::Result {
        let mut image = Image::new(&*info)?;
        if is_sparse(image.flags) {
            let window = &from_handle::<Device>(device).window;
            let reservation = Reservation::new(window, image.size_bytes, Placement::Ordinary)?;
            image = image.reserved(reservation);
        }
        *out = handle::create(image);
        // A sparse image has its addresses already.
        report::<Image>(device, *out, AddressEvent::Created);
        Ok(())
    }

    fn vkGetImageMemoryRequirements(_device: vk::Device, image: vk::Image, out: *mut vk::MemoryRequirements) {
        let image = from_handle::<Image>(image);
        *out = requirements(image.size_bytes, Image::alignment(image.flags));
    }

    fn vkGetImageMemoryRequirements2(
        _device: vk::Device,
        info: *const vk::ImageMemoryRequirementsInfo2,
        out: *mut vk::MemoryRequirements2,
    ) {
        let image = from_handle::<Image>((*info).image);
        let plane = chain::find::<vk::ImagePlaneMemoryRequirementsInfo>((*info).p_next);
        let size_bytes = image.binding_size_bytes(plane.map(|plane| plane.plane_aspect));
        write_requirements(out, size_bytes, Image::alignment(image.flags));
    }

    fn vkGetDeviceImageMemoryRequirements(
        _device: vk::Device,
        info: *const vk::DeviceImageMemoryRequirements,
        out: *mut vk::MemoryRequirements2,
    ) {
        // Valid usage makes the creation succeed; an impossible image asks for more than there is.
        let aspect = (*info).plane_aspect;
        let info = &*(*info).p_create_info;
        let size_bytes = Image::new(info)
            .map_or(1 << 62, |image| image.binding_size_bytes(Some(aspect)));
        write_requirements(out, size_bytes, Image::alignment(info.flags));
    }

    fn vkGetImageSparseMemoryRequirements(
        _device: vk::Device,
        image: vk::Image,
        count: *mut u32,
        out: *mut vk::SparseImageMemoryRequirements,
    ) {
        let image = from_handle::<Image>(image);
        let all = resident::requirements(image.flags, image.format, image.mip_levels);
        let _ = enumerate(count, out, all.into_iter());
    }

    fn vkGetImageSparseMemoryRequirements2(
        _device: vk::Device,
        info: *const vk::ImageSparseMemoryRequirementsInfo2,
        count: *mut u32,
        out: *mut vk::SparseImageMemoryRequirements2,
    ) {
        let image = from_handle::<Image>((*info).image);
        let all = resident::requirements(image.flags, image.format, image.mip_levels);
        let _ = enumerate_with(count, out, all.into_iter(), |out, it| out.memory_requirements = it);
    }

    fn vkGetDeviceImageSparseMemoryRequirements(
        _device: vk::Device,
        info: *const vk::DeviceImageMemoryRequirements,
        count: *mut u32,
        out: *mut vk::SparseImageMemoryRequirements2,
    ) {
        let info = &*(*info).p_create_info;
        let all = resident::requirements(info.flags, info.format, info.mip_levels);
        let _ = enumerate_with(count, out, all.into_iter(), |out, it| out.memory_requirements = it);
    }

    fn vkBindImageMemory(
        device: vk::Device,
        image: vk::Image,
        memory: vk::DeviceMemory,
        offset: vk::DeviceSize,
    ) -> vk::Result {
        let bound = from_handle::<Image>(image);
        bound.bind(from_handle::<DeviceMemory>(memory).place(offset, bound.size_bytes)?);
        report::<Image>(device, image, AddressEvent::Bound);
        Ok(())
    }

    fn vkBindImageMemory2(device: vk::Device, count: u32, infos: *const vk::BindImageMemoryInfo) -> vk::Result {
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
            } else if let Some(from) = ffi::find::<vk::BindImageMemorySwapchainInfoKHR>(info.p_next) {
                let images = &from_handle::<Swapchain>(from.swapchain).images;
                let shared = images.get(from.image_index as usize).ok_or(vk::Result::ERROR_UNKNOWN)?;
                image.bind(shared.data() as u64);
                report::<Image>(device, info.image, AddressEvent::Bound);
            }
        }
        Ok(())
    }

    fn vkGetImageSubresourceLayout(
        _device: vk::Device,
        image: vk::Image,
        subresource: *const vk::ImageSubresource,
        out: *mut vk::SubresourceLayout,
    ) {
        *out = subresource_layout(from_handle::<Image>(image), &*subresource).unwrap_or_default();
    }

    fn vkCreateImageView(
        device: vk::Device,
        info: *const vk::ImageViewCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::ImageView,
    ) -> vk::Result {
        let device = from_handle::<Device>(device);
        let info = &*info;
        let image = from_handle::<Image>(info.image);
        if image.data().is_null() {
            return Err(vk::Result::ERROR_UNKNOWN);
        }
        let range = info.subresource_range;
        let min_lod = chain::find::<vk::ImageViewMinLodCreateInfoEXT>(info.p_next).map_or(0.0, |min| min.min_lod);
        let conversion = chain::find::<vk::SamplerYcbcrConversionInfo>(info.p_next)
            .and_then(|info| handle::optional::<YcbcrConversion>(info.conversion))
            .map(|conversion| conversion.conversion);
        let slices = chain::find::<vk::ImageViewSlicedCreateInfoEXT>(info.p_next)
            .filter(|_| info.view_type == vk::ImageViewType::TYPE_3D);
        let descriptor =
            view_descriptor(image, info.view_type, info.format, info.components, &range, min_lod, conversion)?;
        let descriptor = match slices {
            Some(slices) => sliced(descriptor, slices),
            None => descriptor,
        };
        let replays = info.flags.contains(vk::ImageViewCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT);
        let replay = replays.then(|| captured(info.p_next).map(Key));
        let descriptor = ViewEntry::store(&device.engine.views, |it| &it.images, descriptor, replay)?;
        let image = handle::retain(info.image);
        *out = handle::create(ImageView { descriptor, image, format: info.format, range });
        Ok(())
    }

    fn vkCreateSamplerYcbcrConversion(
        _device: vk::Device,
        info: *const vk::SamplerYcbcrConversionCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::SamplerYcbcrConversion,
    ) -> vk::Result {
        *out = handle::create(YcbcrConversion::new(&*info)?);
        Ok(())
    }

    fn vkCreateSampler(
        device: vk::Device,
        info: *const vk::SamplerCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Sampler,
    ) -> vk::Result {
        let device = from_handle::<Device>(device);
        let info = &*info;
        let reduction = chain::find::<vk::SamplerReductionModeCreateInfo>(info.p_next)
            .map_or(vk::SamplerReductionMode::WEIGHTED_AVERAGE, |reduction| reduction.reduction_mode);
        let contents = sampler_descriptor(info, reduction, border(info));
        let replays = info.flags.contains(vk::SamplerCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT);
        let replay = replays.then(|| captured(info.p_next).map(Key));
        let descriptor = ViewEntry::store(&device.engine.views, |it| &it.samplers, contents, replay)?;
        *out = handle::create(Sampler { descriptor });
        Ok(())
    }
}
