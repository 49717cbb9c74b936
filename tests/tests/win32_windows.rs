//! Windows of Win32: what is presented is on the screen.
#![cfg(windows)]

use ash::{ext, khr};
use tuff_tests::*;
use windows_sys::Win32::System::Threading::{
    GR_GDIOBJECTS, GetCurrentProcess, GetGuiResources, GetProcessHandleCount,
};

const WIDTH: u32 = 61;
const HEIGHT: u32 = 37;

/// A window, and the program that presents to it: dropped in the other order.
#[track_caller]
fn on_screen(width: u32, height: u32) -> Option<(Win32Window, Presenter)> {
    let window = Win32Window::new(width as i32, height as i32);
    let presenter = window.presenter()?;
    Some((window, presenter))
}

fn current(presenter: &Presenter) -> (u32, u32) {
    let found = presenter.capabilities().unwrap();
    let extents = [
        found.min_image_extent,
        found.max_image_extent,
        found.current_extent,
    ];
    // "must always equal the window size" (Vulkan 1.4, section 34.2, Win32 Platform).
    assert!(extents.iter().all(|&it| it == found.current_extent));
    (found.current_extent.width, found.current_extent.height)
}

#[test]
fn what_is_presented_is_on_the_screen() {
    let Some((window, presenter)) = on_screen(WIDTH, HEIGHT) else {
        return;
    };
    assert_eq!(current(&presenter), (WIDTH, HEIGHT));
    let windows = khr::win32_surface::Instance::new(&presenter.entry, &presenter.instance);
    // SAFETY: handles of this instance.
    unsafe {
        let (physical, surface) = (presenter.physical, presenter.surface);
        assert!(windows.get_physical_device_win32_presentation_support(physical, 0));
        let surfaces = &presenter.surfaces;
        let is_supported = surfaces.get_physical_device_surface_support(physical, 0, surface);
        assert!(is_supported.unwrap());
    }
    let usual = [
        vk::PresentModeKHR::FIFO,
        vk::PresentModeKHR::FIFO_RELAXED,
        vk::PresentModeKHR::MAILBOX,
        vk::PresentModeKHR::IMMEDIATE,
    ];
    let mut old = vk::SwapchainKHR::null();
    for mode in presenter.modes() {
        if !usual.contains(&mode) {
            continue;
        }
        let formats = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_SRGB];
        for (variant, format) in (0..).zip(formats) {
            let chain = Chain {
                format,
                mode,
                count: 3,
                old,
                ..Chain::of(WIDTH, HEIGHT)
            };
            let swapchain = presenter.swapchain(&chain).unwrap();
            if old != vk::SwapchainKHR::null() {
                presenter.destroy(old);
            }
            for seed in 0..6 {
                // No two frames are alike.
                let number = (seed * 2 + variant) * 4 + mode.as_raw() as u32;
                let pixels = screen_picture(WIDTH, HEIGHT, number);
                let ordered = match format {
                    vk::Format::B8G8R8A8_UNORM => pixels.clone(),
                    _ => red_first(&pixels),
                };
                let (_, suboptimal) = presenter.show(swapchain, &chain, &ordered);
                assert!(!suboptimal);
                if seed == 5 {
                    let (width, height) = (WIDTH as i32, HEIGHT as i32);
                    let shown = window.shows(width, height, &pixels);
                    assert!(shown, "{mode:?} {format:?}");
                    assert!(
                        window.is_seen(width, height, &pixels),
                        "{mode:?} {format:?}"
                    );
                }
            }
            old = swapchain;
        }
    }
    presenter.destroy(old);
}

#[test]
fn the_last_frame_of_a_destroyed_swapchain_is_shown() {
    let Some((window, presenter)) = on_screen(WIDTH, HEIGHT) else {
        return;
    };
    let chain = Chain::of(WIDTH, HEIGHT);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let pixels = screen_picture(WIDTH, HEIGHT, 99);
    presenter.show(swapchain, &chain, &screen_picture(WIDTH, HEIGHT, 1));
    presenter.show(swapchain, &chain, &pixels);
    presenter.destroy(swapchain);
    assert!(window.shows(WIDTH as i32, HEIGHT as i32, &pixels));
}

#[test]
fn resized_windows_make_swapchains_suboptimal_and_replacements_fit() {
    let Some((window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain::of(64, 64);
    let swapchain = presenter.swapchain(&chain).unwrap();
    presenter.show(swapchain, &chain, &screen_picture(64, 64, 1));
    window.resize(80, 48);
    assert_eq!(current(&presenter), (80, 48));
    let told = (0..20).any(|seed| {
        match presenter.frame(swapchain, chain.extent, &screen_picture(64, 64, seed), 0) {
            Ok((_, suboptimal)) => suboptimal,
            Err(code) => {
                assert_eq!(code, vk::Result::ERROR_OUT_OF_DATE_KHR);
                true
            }
        }
    });
    assert!(told, "the window has another size");
    let again = Chain {
        old: swapchain,
        ..Chain::of(80, 48)
    };
    let next = presenter.swapchain(&again).unwrap();
    presenter.destroy(swapchain);
    let pixels = screen_picture(80, 48, 9);
    let (_, suboptimal) = presenter.show(next, &again, &pixels);
    assert!(!suboptimal);
    assert!(window.shows(80, 48, &pixels));
    presenter.destroy(next);
}

#[test]
fn pictures_are_stretched_over_windows_of_other_sizes() {
    let Some((window, presenter)) = on_screen(64, 96) else {
        return;
    };
    if !presenter.extends(ext::swapchain_maintenance1::NAME) {
        return;
    }
    // Two colors, the border between them at half: any filter keeps the outer quarters.
    let small: Vec<u8> = [[255, 0, 0, 255], [0, 0, 255, 255]].concat().repeat(2);
    let chain = Chain {
        scaling: vk::PresentScalingFlagsEXT::STRETCH,
        ..Chain::of(2, 2)
    };
    let swapchain = presenter.swapchain(&chain).unwrap();
    presenter.show(swapchain, &chain, &small);
    let row = |y: usize| window.picture(64, 96)[y * 256..][..256].to_vec();
    let is_there = |row: &[u8]| row[..3] == [255, 0, 0] && row[252..255] == [0, 0, 255];
    assert!(comes(|| is_there(&row(0)) && is_there(&row(95))));
    presenter.destroy(swapchain);
    let chain = Chain {
        scaling: vk::PresentScalingFlagsEXT::ASPECT_RATIO_STRETCH,
        gravity: vk::PresentGravityFlagsEXT::MAX,
        ..chain
    };
    let swapchain = presenter.swapchain(&chain).unwrap();
    presenter.show(swapchain, &chain, &small);
    // 64 by 64 pixels at the lower end.
    let lies_below = || !is_there(&row(0)) && !is_there(&row(31)) && is_there(&row(32));
    assert!(comes(lies_below), "{:?}", row(0));
    presenter.destroy(swapchain);
}

/// A minimized window has no pixels: frames to it count as shown, and nothing waits for it.
#[test]
fn minimized_windows_have_no_extent_and_hold_nothing_up() {
    let Some((window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain::of(64, 64);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let present = |seed| {
        let pixels = screen_picture(64, 64, seed);
        let shown = presenter.frame(swapchain, chain.extent, &pixels, 0);
        assert!(shown.is_ok() || shown == Err(vk::Result::ERROR_OUT_OF_DATE_KHR));
        pixels
    };
    present(0);
    window.minimize();
    assert_eq!(current(&presenter), (0, 0));
    (1..7).for_each(|seed| drop(present(seed)));
    window.restore();
    assert!(comes(|| {
        window.answer();
        current(&presenter) == (64, 64)
    }));
    let again = Chain {
        old: swapchain,
        ..chain
    };
    let next = presenter.swapchain(&again).unwrap();
    presenter.destroy(swapchain);
    let pixels = screen_picture(64, 64, 77);
    presenter.show(next, &again, &pixels);
    assert!(window.shows(64, 64, &pixels));
    presenter.destroy(next);
}

#[test]
fn windows_that_die_are_lost_surfaces() {
    for mode in [vk::PresentModeKHR::FIFO, vk::PresentModeKHR::IMMEDIATE] {
        let Some((window, presenter)) = on_screen(64, 64) else {
            return;
        };
        let chain = Chain {
            mode,
            ..Chain::of(64, 64)
        };
        let swapchain = presenter.swapchain(&chain).unwrap();
        let pixels = screen_picture(64, 64, 1);
        presenter.show(swapchain, &chain, &pixels);
        window.destroy();
        let code = (0..20).find_map(|_| presenter.frame(swapchain, chain.extent, &pixels, 0).err());
        assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
        let code = presenter.capabilities().err();
        assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
        presenter.destroy(swapchain);
        let refused = presenter.swapchain(&chain).err();
        assert_eq!(refused, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
    }
}

/// Vulkan leaves open what happens: Tuff's surface is lost from the beginning.
#[test]
fn a_number_that_is_no_window_is_a_lost_surface() {
    let Some(presenter) = Win32Window::presenter_to_none() else {
        return;
    };
    let code = presenter.capabilities().err();
    assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
    let refused = presenter.swapchain(&Chain::of(64, 64)).err();
    assert_eq!(refused, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
}

#[test]
fn swapchains_leave_no_objects_of_the_system_behind() {
    let Some((_window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain {
        mode: vk::PresentModeKHR::IMMEDIATE,
        ..Chain::of(64, 64)
    };
    let pixels = screen_picture(64, 64, 1);
    let count = || {
        let mut handles = 0;
        // SAFETY: plain system calls; the second fills the number.
        unsafe {
            let process = GetCurrentProcess();
            assert_ne!(GetProcessHandleCount(process, &mut handles), 0);
            (GetGuiResources(process, GR_GDIOBJECTS), handles)
        }
    };
    let mut before = count();
    for round in 0..300 {
        if round == 100 {
            before = count();
        }
        let swapchain = presenter.swapchain(&chain).unwrap();
        presenter.show(swapchain, &chain, &pixels);
        presenter.destroy(swapchain);
    }
    let after = count();
    println!("{before:?} objects of GDI and handles, then {after:?}");
    assert!(after.0 < before.0 + 100 && after.1 < before.1 + 100);
}
