//! Formats, color spaces, modes and image counts that surfaces offer.

#![forbid(unsafe_code)]

use ash::vk;

use crate::ffi::vk::PRESENT_MODE_FIFO_LATEST_READY_KHR;

/// Image counts of a swapchain. One image is presented while another is drawn.
pub const MIN_IMAGES: u32 = 2;

pub const MAX_IMAGES: u32 = 16;

/// The formats that can be presented. Images are converted where the window has another format.
pub const FORMATS: [vk::Format; 4] = [
    vk::Format::B8G8R8A8_UNORM,
    vk::Format::B8G8R8A8_SRGB,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::R8G8B8A8_SRGB,
];

/// Formats of more than eight bits, and their color spaces, for applications that enable
/// `VK_EXT_swapchain_colorspace`. Other applications would choose the format with the most bits and
/// pay for bits that their windows do not show.
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

/// The present modes, and whether a mode needs an extension to be enabled.
pub const MODES: [vk::PresentModeKHR; 7] = [
    vk::PresentModeKHR::FIFO,
    vk::PresentModeKHR::FIFO_RELAXED,
    vk::PresentModeKHR::MAILBOX,
    vk::PresentModeKHR::IMMEDIATE,
    PRESENT_MODE_FIFO_LATEST_READY_KHR,
    vk::PresentModeKHR::SHARED_DEMAND_REFRESH,
    vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH,
];

/// The modes that are reported without a surface (`VK_GOOGLE_surfaceless_query`).
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

/// Whether a mode presents one shared image, which the application continues to draw to.
pub fn is_shared(mode: vk::PresentModeKHR) -> bool {
    mode == vk::PresentModeKHR::SHARED_DEMAND_REFRESH
        || mode == vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH
}

/// The modes to which a swapchain made for `mode` can change. `mode` comes first, so that a short
/// array holds it.
pub fn compatible_modes(mode: vk::PresentModeKHR) -> impl Iterator<Item = vk::PresentModeKHR> {
    let others = MODES
        .into_iter()
        .filter(move |&other| other != mode && is_shared(other) == is_shared(mode));
    std::iter::once(mode).chain(others)
}
