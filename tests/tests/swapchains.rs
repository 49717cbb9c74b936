//! Swapchains on a surface without a window.

use ash::ext;
use tuff_tests::*;

#[test]
fn images_are_acquired_copied_to_and_presented_in_turn() {
    let presenter = Presenter::new(ext::headless_surface::NAME, |entry, instance| {
        let surfaces = ext::headless_surface::Instance::new(entry, instance);
        let info = vk::HeadlessSurfaceCreateInfoEXT::default();
        // SAFETY: the surface is destroyed with the presenter.
        unsafe { surfaces.create_headless_surface(&info, None) }.unwrap()
    });
    let Some(presenter) = presenter else { return };
    let limits = presenter.capabilities().unwrap();
    let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT;
    assert!(limits.supported_usage_flags.contains(usage));
    assert!(presenter.modes().contains(&vk::PresentModeKHR::FIFO));
    // SAFETY: handles of this instance.
    let (is_supported, formats) = unsafe {
        let (surfaces, physical) = (&presenter.surfaces, presenter.physical);
        let surface = presenter.surface;
        (
            surfaces.get_physical_device_surface_support(physical, 0, surface),
            surfaces.get_physical_device_surface_formats(physical, surface),
        )
    };
    assert!(is_supported.unwrap());
    let chain = Chain {
        format: formats.unwrap()[0].format,
        count: limits.min_image_count.max(2),
        ..Chain::of(16, 8)
    };
    let swapchain = presenter.swapchain(&chain).unwrap();
    // SAFETY: the swapchain is alive.
    let images = unsafe { presenter.swapchains.get_swapchain_images(swapchain) }.unwrap();
    assert!(images.len() >= 2);
    let pixels = screen_picture(16, 8, 0);
    let mut seen = Vec::new();
    for _ in 0..3 * images.len() {
        let (index, suboptimal) = presenter.show(swapchain, &chain, &pixels);
        assert!(!suboptimal);
        seen.push(index);
    }
    for index in 0..images.len() as u32 {
        assert!(seen.contains(&index), "image {index} has its turn");
    }
    let next = Chain {
        old: swapchain,
        ..chain
    };
    let next = presenter.swapchain(&next).unwrap();
    let first = presenter.frame(next, chain.extent, &pixels, 0);
    assert!(first.is_ok(), "{first:?}");
    presenter.destroy(swapchain);
    presenter.destroy(next);
}
