//! Formats, color spaces, modes and image counts that surfaces offer.

#![forbid(unsafe_code)]

use ash::vk;

use crate::ffi::vk::PRESENT_MODE_FIFO_LATEST_READY_KHR;

/// Images of a swapchain. One is handed to the window while another is drawn.
pub const MIN_IMAGES: u32 = 2;

pub const MAX_IMAGES: u32 = 16;

/// The formats that can be presented; windows get them converted where they show another one.
pub const FORMATS: [vk::Format; 4] = [
    vk::Format::B8G8R8A8_UNORM,
    vk::Format::B8G8R8A8_SRGB,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::R8G8B8A8_SRGB,
];

/// Formats of more than eight bits, and the color spaces that they can be presented in: for
/// applications that ask for color spaces (`VK_EXT_swapchain_colorspace`). Others choose the format
/// of most bits and would pay for bits that their windows do not show.
pub const DEEP_FORMATS: [(vk::Format, vk::ColorSpaceKHR); 3] = [
    (
        vk::Format::A2B10G10R10_UNORM_PACK32,
        vk::ColorSpaceKHR::SRGB_NONLINEAR,
    ),
    (
        vk::Format::R16G16B16A16_SFLOAT,
        vk::ColorSpaceKHR::SRGB_NONLINEAR,
    ),
    (
        vk::Format::R16G16B16A16_SFLOAT,
        vk::ColorSpaceKHR::EXTENDED_SRGB_LINEAR_EXT,
    ),
];

/// The modes that can be asked for, and whether an extension has to be enabled for one.
pub const MODES: [vk::PresentModeKHR; 7] = [
    vk::PresentModeKHR::FIFO,
    vk::PresentModeKHR::FIFO_RELAXED,
    vk::PresentModeKHR::MAILBOX,
    vk::PresentModeKHR::IMMEDIATE,
    PRESENT_MODE_FIFO_LATEST_READY_KHR,
    vk::PresentModeKHR::SHARED_DEMAND_REFRESH,
    vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH,
];

/// Those of them that may be named where no surface is (`VK_GOOGLE_surfaceless_query`).
pub const SURFACELESS_MODES: [vk::PresentModeKHR; 3] = [
    vk::PresentModeKHR::FIFO,
    vk::PresentModeKHR::SHARED_DEMAND_REFRESH,
    vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH,
];

/// Usages of swapchain images.
pub const IMAGE_USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::TRANSFER_SRC.as_raw()
        | vk::ImageUsageFlags::TRANSFER_DST.as_raw()
        | vk::ImageUsageFlags::SAMPLED.as_raw()
        | vk::ImageUsageFlags::STORAGE.as_raw()
        | vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw()
        | vk::ImageUsageFlags::INPUT_ATTACHMENT.as_raw(),
);

/// Whether a mode presents one image that the application goes on drawing to.
pub fn is_shared(mode: vk::PresentModeKHR) -> bool {
    mode == vk::PresentModeKHR::SHARED_DEMAND_REFRESH
        || mode == vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH
}

/// The modes that a swapchain made for `mode` can change to: itself first, so that it is there
/// where not all fit.
pub fn compatible_modes(mode: vk::PresentModeKHR) -> impl Iterator<Item = vk::PresentModeKHR> {
    let others = MODES
        .into_iter()
        .filter(move |&other| other != mode && is_shared(other) == is_shared(mode));
    std::iter::once(mode).chain(others)
}
