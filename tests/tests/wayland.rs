//! Surfaces of Wayland, on a compositor of the test's own.
#![cfg(unix)]

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ash::khr;
use tuff_tests::*;

#[test]
fn what_is_presented_is_attached() {
    let compositor = Compositor::start();
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    let current = presenter.capabilities().unwrap().current_extent;
    assert_eq!(current.width, u32::MAX);
    let usual = [
        vk::PresentModeKHR::FIFO,
        vk::PresentModeKHR::MAILBOX,
        vk::PresentModeKHR::IMMEDIATE,
    ];
    let mut old = vk::SwapchainKHR::null();
    for mode in usual
        .into_iter()
        .filter(|mode| presenter.modes().contains(mode))
    {
        for format in [vk::Format::B8G8R8A8_SRGB, vk::Format::R8G8B8A8_UNORM] {
            let chain = Chain {
                format,
                mode,
                count: 3,
                old,
                ..Chain::of(61, 37)
            };
            let swapchain = presenter.swapchain(&chain).unwrap();
            if old != vk::SwapchainKHR::null() {
                presenter.destroy(old);
            }
            for seed in 0..6 {
                let pixels = screen_picture(61, 37, seed * 9 + mode.as_raw() as u32);
                let ordered = match format {
                    vk::Format::R8G8B8A8_UNORM => red_first(&pixels),
                    _ => pixels.clone(),
                };
                presenter.show(swapchain, &chain, &ordered);
                if seed == 5 {
                    assert!(compositor.shows(61, 37, &pixels), "{mode:?} {format:?}");
                }
            }
            assert!(!compositor.manners.shown.lock().unwrap().has_alpha);
            old = swapchain;
        }
    }
    presenter.destroy(old);
    let chain = Chain {
        alpha: vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED,
        ..Chain::of(5, 7)
    };
    let swapchain = presenter.swapchain(&chain).unwrap();
    let pixels = screen_picture(5, 7, 1);
    presenter.show(swapchain, &chain, &pixels);
    assert!(compositor.shows(5, 7, &pixels));
    assert!(compositor.manners.shown.lock().unwrap().has_alpha);
    presenter.destroy(swapchain);
}

#[test]
fn fifo_waits_for_the_compositor_and_goes_on_when_hidden() {
    let compositor = Compositor::start();
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    if !presenter.extends(khr::present_wait::NAME) {
        return;
    }
    let waits = khr::present_wait::Device::new(&presenter.instance, &presenter.device);
    let chain = Chain::of(16, 16);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let pixels = screen_picture(16, 16, 3);
    let start = Instant::now();
    for id in 1..=30 {
        presenter
            .frame(swapchain, chain.extent, &pixels, id)
            .unwrap();
    }
    // SAFETY: the swapchain is alive, and the id has been presented.
    unsafe { waits.wait_for_present(swapchain, 30, PATIENCE_NS).unwrap() };
    // The first one may be shown at once.
    let took = start.elapsed().as_secs_f64();
    assert!(took > 28.0 / 60.0, "{took} s");
    compositor.manners.hides.store(true, Ordering::Release);
    let start = Instant::now();
    for id in 31..=34 {
        presenter
            .frame(swapchain, chain.extent, &pixels, id)
            .unwrap();
    }
    // SAFETY: the swapchain is alive, and the id has been presented.
    unsafe { waits.wait_for_present(swapchain, 34, PATIENCE_NS).unwrap() };
    assert!(start.elapsed() < PATIENCE);
    presenter.destroy(swapchain);
}

/// The compositor's barriers fall with each refresh, whether or not somebody sees the window.
#[test]
fn fifo_keeps_the_pace_of_barriers_where_nobody_looks() {
    let compositor = Compositor::start_with(Offers {
        barriers: true,
        ..Offers::default()
    });
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    if !presenter.extends(khr::present_wait::NAME) {
        return;
    }
    let waits = khr::present_wait::Device::new(&presenter.instance, &presenter.device);
    let manners = &compositor.manners;
    let mut chain = Chain::of(16, 16);
    for late_releases in [0, 1] {
        manners
            .late_releases
            .store(late_releases, Ordering::Release);
        chain.count = 3 + late_releases as u32;
        let swapchain = presenter.swapchain(&chain).unwrap();
        if chain.old != vk::SwapchainKHR::null() {
            presenter.destroy(chain.old);
        }
        chain.old = swapchain;
        for (is_hidden, first) in [(false, 1), (true, 31), (false, 61)] {
            manners.hides.store(is_hidden, Ordering::Release);
            let before = manners.waited.load(Ordering::Acquire);
            let start = Instant::now();
            let mut last_frame = start;
            let mut quick = 0;
            for id in first..first + 30 {
                let pixels = screen_picture(16, 16, id as u32);
                presenter
                    .frame(swapchain, chain.extent, &pixels, id)
                    .unwrap();
                quick += u32::from(last_frame.elapsed() < Duration::from_millis(90));
                last_frame = Instant::now();
            }
            let last = first + 29;
            // SAFETY: the swapchain is alive, and the id has been presented.
            unsafe {
                waits
                    .wait_for_present(swapchain, last, PATIENCE_NS)
                    .unwrap()
            };
            let took = start.elapsed().as_secs_f64();
            // A tenth of a second or a whole one passes before a driver gives up waiting for a
            // window that is not seen, so that all frames but those with free images take that
            // long. A busy machine delays some.
            assert!(
                took > 27.0 / 60.0 && quick > 10,
                "hidden: {is_hidden}: {took} s, {quick} of 30 frames in time"
            );
            assert!(compositor.shows(16, 16, &screen_picture(16, 16, last as u32)));
            assert_eq!(manners.waited.load(Ordering::Acquire) - before, 30);
        }
    }
    assert_eq!(manners.barriers.load(Ordering::Acquire), 1);
    presenter.destroy(chain.old);
}

#[test]
fn late_releases_hold_images_back_but_nothing_up() {
    let compositor = Compositor::start();
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    compositor.manners.late_releases.store(2, Ordering::Release);
    let chain = Chain {
        count: 4,
        mode: vk::PresentModeKHR::MAILBOX,
        ..Chain::of(16, 16)
    };
    let swapchain = presenter.swapchain(&chain).unwrap();
    for seed in 0..40 {
        let pixels = screen_picture(16, 16, seed);
        presenter.show(swapchain, &chain, &pixels);
    }
    assert!(compositor.shows(16, 16, &screen_picture(16, 16, 39)));
    presenter.destroy(swapchain);
}

#[test]
fn a_dead_compositor_is_a_lost_surface() {
    let compositor = Compositor::start();
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    let chain = Chain::of(16, 16);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let pixels = screen_picture(16, 16, 3);
    presenter.show(swapchain, &chain, &pixels);
    compositor.manners.dies.store(true, Ordering::Release);
    let code = (0..20).find_map(|_| presenter.frame(swapchain, chain.extent, &pixels, 0).err());
    assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
    presenter.destroy(swapchain);
}

#[test]
fn thousands_of_swapchains_leave_nothing_behind() {
    let compositor = Compositor::start();
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    presenter.assert_nothing_stays(16, &screen_picture(16, 16, 5), 2_000);
}
