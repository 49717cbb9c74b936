//! Effective flags and usages of images (spec, "Effective Flags"): those in structures of
//! `VK_KHR_extended_flags` take precedence over those of the structure that they extend.

use std::ffi::c_void;

use ash::vk;

use crate::VkResult;
use crate::ffi::{chain, vk as newer};
use crate::format;
use crate::object::image::supported_image;

/// Creation flags: of a `VkImageCreateFlags2CreateInfoKHR` in the chain, otherwise `flags`.
///
/// # Safety
/// The chain is valid.
unsafe fn create_flags(next: *const c_void, flags: vk::ImageCreateFlags) -> u64 {
    // SAFETY: the caller guarantees that the chain is valid.
    let more = unsafe { chain::find::<newer::ImageCreateFlags2CreateInfoKHR<'_>>(next) };
    more.map_or(flags.as_raw().into(), |more| more.flags)
}

/// Usage: of a `VkImageUsageFlags2CreateInfoKHR` in the chain, otherwise `usage`.
///
/// # Safety
/// The chain is valid.
unsafe fn usage_flags(next: *const c_void, usage: vk::ImageUsageFlags) -> u64 {
    // SAFETY: the caller guarantees that the chain is valid.
    let more = unsafe { chain::find::<newer::ImageUsageFlags2CreateInfoKHR<'_>>(next) };
    more.map_or(usage.as_raw().into(), |more| more.usage)
}

/// The first 32 flags; the registry defines no others yet.
fn old(flags: u64) -> u32 {
    flags as u32
}

/// The first 32 flags of a query, if it has no others.
///
/// # Errors
/// `VK_ERROR_FORMAT_NOT_SUPPORTED` for flags that are unknown here.
fn known(flags: u64) -> VkResult<u32> {
    u32::try_from(flags).map_err(|_| vk::Result::ERROR_FORMAT_NOT_SUPPORTED)
}

/// The usage of a swapchain's images.
///
/// # Safety
/// `info` is valid usage of `vkCreateSwapchainKHR`.
pub unsafe fn swapchain_usage(info: &vk::SwapchainCreateInfoKHR<'_>) -> vk::ImageUsageFlags {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateSwapchainKHR`.
    let usage = unsafe { usage_flags(info.p_next, info.image_usage) };
    vk::ImageUsageFlags::from_raw(old(usage))
}

/// The parameters of an image with its effective flags and usage.
///
/// # Safety
/// `info` is valid usage of `vkCreateImage`.
pub unsafe fn image_info<'a>(info: &vk::ImageCreateInfo<'a>) -> vk::ImageCreateInfo<'a> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateImage`.
    let (flags, usage) = unsafe {
        (
            create_flags(info.p_next, info.flags),
            usage_flags(info.p_next, info.usage),
        )
    };
    vk::ImageCreateInfo {
        flags: vk::ImageCreateFlags::from_raw(old(flags)),
        usage: vk::ImageUsageFlags::from_raw(old(usage)),
        ..*info
    }
}

/// The capabilities of an image in a query, for both usages if stencil has its own.
///
/// # Errors
/// `VK_ERROR_FORMAT_NOT_SUPPORTED`.
///
/// # Safety
/// `info` is valid usage of `vkGetPhysicalDeviceImageFormatProperties2`.
pub unsafe fn described_image(
    info: &vk::PhysicalDeviceImageFormatInfo2<'_>,
) -> VkResult<vk::ImageFormatProperties> {
    // SAFETY: the caller guarantees that `info` is valid usage of
    // `vkGetPhysicalDeviceImageFormatProperties2`.
    let (flags, usage, stencil, stencil2) = unsafe {
        (
            create_flags(info.p_next, info.flags),
            usage_flags(info.p_next, info.usage),
            chain::find::<vk::ImageStencilUsageCreateInfo<'_>>(info.p_next),
            chain::find::<newer::ImageStencilUsage2CreateInfoKHR<'_>>(info.p_next),
        )
    };
    let stencil = stencil.map(|it| it.stencil_usage.as_raw().into());
    let stencil = stencil2.map(|it| it.stencil_usage).or(stencil);
    let flags = vk::ImageCreateFlags::from_raw(known(flags)?);
    let supported = |usage| {
        let usage = vk::ImageUsageFlags::from_raw(known(usage)?);
        supported_image(info.format, info.ty, info.tiling, usage, flags)
    };
    let is_stencil = |it: &format::PlaneFormat| it.aspect == vk::ImageAspectFlags::STENCIL;
    let has_stencil = format::planes(info.format).iter().any(is_stencil);
    if let Some(stencil) = stencil.filter(|_| has_stencil) {
        let _stencil = supported(stencil)?;
    }
    supported(usage)
}

/// The usage of the images in a query of sparse planes; `None` with unknown flags.
///
/// # Safety
/// `info` is valid usage of `vkGetPhysicalDeviceSparseImageFormatProperties2`.
pub unsafe fn resident_usage(
    info: &vk::PhysicalDeviceSparseImageFormatInfo2<'_>,
) -> Option<vk::ImageUsageFlags> {
    // SAFETY: the caller guarantees that `info` is valid usage of
    // `vkGetPhysicalDeviceSparseImageFormatProperties2`.
    let usage = unsafe { usage_flags(info.p_next, info.usage) };
    known(usage).ok().map(vk::ImageUsageFlags::from_raw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chained_flags_come_first_and_unknown_ones_are_not_supported() {
        let mut usage = newer::ImageUsageFlags2CreateInfoKHR {
            usage: vk::ImageUsageFlags::SAMPLED.as_raw().into(),
            ..Default::default()
        };
        let flags = newer::ImageCreateFlags2CreateInfoKHR {
            p_next: (&raw const usage).cast(),
            flags: vk::ImageCreateFlags::MUTABLE_FORMAT.as_raw().into(),
            ..Default::default()
        };
        let mut info = vk::ImageCreateInfo::default().usage(vk::ImageUsageFlags::STORAGE);
        info.p_next = (&raw const flags).cast();
        // SAFETY: the chain is the two structures above.
        let effective = unsafe { image_info(&info) };
        assert_eq!(effective.flags, vk::ImageCreateFlags::MUTABLE_FORMAT);
        assert_eq!(effective.usage, vk::ImageUsageFlags::SAMPLED);

        usage.usage |= 1 << 40;
        let query = vk::PhysicalDeviceImageFormatInfo2 {
            p_next: (&raw const usage).cast(),
            format: vk::Format::R8G8B8A8_UNORM,
            ty: vk::ImageType::TYPE_2D,
            ..Default::default()
        };
        // SAFETY: the chain is the structure above.
        let supported = unsafe { described_image(&query) };
        assert_eq!(
            supported.err(),
            Some(vk::Result::ERROR_FORMAT_NOT_SUPPORTED)
        );
    }

    #[test]
    fn stencil_has_a_usage_of_its_own() {
        let stencil = newer::ImageStencilUsage2CreateInfoKHR {
            stencil_usage: vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw().into(),
            ..Default::default()
        };
        let query = |format| {
            let info = vk::PhysicalDeviceImageFormatInfo2 {
                p_next: (&raw const stencil).cast(),
                format,
                ty: vk::ImageType::TYPE_2D,
                usage: vk::ImageUsageFlags::TRANSFER_SRC,
                ..Default::default()
            };
            // SAFETY: the chain is the structure above.
            unsafe { described_image(&info) }.is_ok()
        };
        assert!(!query(vk::Format::D32_SFLOAT_S8_UINT));
        assert!(query(vk::Format::D32_SFLOAT));
    }
}
