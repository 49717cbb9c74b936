//! Hidden windows, windows and servers that die, and programs that break rules.

use std::ffi::c_void;
use std::time::Instant;

use ash::khr;
use tuff_tests::*;

use super::{acquire, on_screen};

#[test]
fn windows_that_nobody_sees_hold_nobody_up() {
    use x11rb::protocol::xproto::ConnectionExt;
    let Some((_server, window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain::of(64, 64);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let present = |seed| {
        presenter
            .frame(swapchain, chain.extent, &screen_picture(64, 64, seed), 0)
            .unwrap();
    };
    present(0);
    window
        .x
        .unmap_window(window.window)
        .unwrap()
        .check()
        .unwrap();
    let start = Instant::now();
    (0..6).for_each(present);
    assert!(start.elapsed() < PATIENCE, "{:?}", start.elapsed());
    window.x.map_window(window.window).unwrap().check().unwrap();
    present(77);
    assert!(window.shows(64, 64, &screen_picture(64, 64, 77)));
    presenter.destroy(swapchain);
}

#[test]
fn windows_that_die_are_lost_surfaces() {
    for mode in [vk::PresentModeKHR::FIFO, vk::PresentModeKHR::IMMEDIATE] {
        let Some((_server, window, presenter)) = on_screen(64, 64) else {
            return;
        };
        let chain = Chain {
            mode,
            ..Chain::of(64, 64)
        };
        let swapchain = presenter.swapchain(&chain).unwrap();
        let pixels = screen_picture(64, 64, 1);
        presenter
            .frame(swapchain, chain.extent, &pixels, 0)
            .unwrap();
        window.destroy();
        let code = (0..20).find_map(|_| presenter.frame(swapchain, chain.extent, &pixels, 0).err());
        assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
        let code = presenter.capabilities().err();
        assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
        presenter.destroy(swapchain);
        // No error came as an event of the application's.
        use x11rb::connection::Connection;
        while let Some(event) = window.x.poll_for_event().unwrap() {
            let error = matches!(event, x11rb::protocol::Event::Error(_));
            assert!(!error, "{event:?}");
        }
    }
}

#[test]
fn a_dead_server_ends_no_process_and_hangs_none() {
    let Some((server, _window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain::of(64, 64);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let pixels = screen_picture(64, 64, 1);
    presenter
        .frame(swapchain, chain.extent, &pixels, 0)
        .unwrap();
    drop(server);
    let code = (0..20).find_map(|_| presenter.frame(swapchain, chain.extent, &pixels, 0).err());
    assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
    presenter.destroy(swapchain);
}

/// Xlib's own error handler ends the process: it must hear of nothing.
#[test]
fn a_dead_window_of_xlib_does_not_reach_its_error_handler() {
    let Some(server) = Xvfb::start(&[]) else {
        return;
    };
    type Display = *mut c_void;
    // SAFETY: the functions have these types (Xlib.h), and are called as Xlib wants.
    unsafe {
        let Ok(xlib) = libloading::Library::new("libX11.so.6") else {
            has("libX11", false);
            return;
        };
        macro_rules! function {
            ($name:literal, fn($($ty:ty),*) -> $result:ty) => {
                *xlib.get::<unsafe extern "C" fn($($ty),*) -> $result>($name).unwrap()
            };
        }
        function!(b"XInitThreads\0", fn() -> i32)();
        let name = std::ffi::CString::new(server.display.as_str()).unwrap();
        let display: Display =
            function!(b"XOpenDisplay\0", fn(*const i8) -> Display)(name.as_ptr());
        assert!(!display.is_null());
        let root = function!(b"XDefaultRootWindow\0", fn(Display) -> u64)(display);
        let create = function!(
            b"XCreateSimpleWindow\0",
            fn(Display, u64, i32, i32, u32, u32, u32, u64, u64) -> u64
        );
        let window = create(display, root, 0, 0, 64, 64, 0, 0, 0);
        function!(b"XMapWindow\0", fn(Display, u64) -> i32)(display, window);
        let sync = function!(b"XSync\0", fn(Display, i32) -> i32);
        sync(display, 0);
        let presenter = Presenter::new(khr::xlib_surface::NAME, |entry, instance| {
            let info = vk::XlibSurfaceCreateInfoKHR::default()
                .dpy(display.cast())
                .window(window);
            khr::xlib_surface::Instance::new(entry, instance)
                .create_xlib_surface(&info, None)
                .unwrap()
        });
        let Some(presenter) = presenter else { return };
        let chain = Chain::of(64, 64);
        let swapchain = presenter.swapchain(&chain).unwrap();
        let pixels = screen_picture(64, 64, 1);
        for _ in 0..3 {
            presenter
                .frame(swapchain, chain.extent, &pixels, 0)
                .unwrap();
        }
        function!(b"XDestroyWindow\0", fn(Display, u64) -> i32)(display, window);
        sync(display, 0);
        let code = (0..20).find_map(|_| presenter.frame(swapchain, chain.extent, &pixels, 0).err());
        assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
        presenter.destroy(swapchain);
        drop(presenter);
        sync(display, 0);
        function!(b"XCloseDisplay\0", fn(Display) -> i32)(display);
    }
}

#[test]
fn images_that_are_never_presented_hold_nobody_up() {
    let Some((_server, window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain::of(64, 64);
    let swapchain = presenter.swapchain(&chain).unwrap();
    // SAFETY: the swapchain is alive.
    let images = unsafe { presenter.swapchains.get_swapchain_images(swapchain) };
    for _ in images.unwrap() {
        acquire(&presenter, swapchain, PATIENCE_NS).unwrap();
    }
    let none = acquire(&presenter, swapchain, 0);
    assert_eq!(none.err(), Some(vk::Result::NOT_READY));
    let none = acquire(&presenter, swapchain, 20_000_000);
    assert_eq!(none.err(), Some(vk::Result::TIMEOUT));
    let again = Chain {
        old: swapchain,
        ..chain
    };
    let next = presenter.swapchain(&again).unwrap();
    presenter.destroy(swapchain);
    let pixels = screen_picture(64, 64, 4);
    presenter.show(next, &chain, &pixels);
    assert!(window.shows(64, 64, &pixels));
    presenter.destroy(next);
}

/// Breaks a rule: presents images that were not acquired, the same one over and over.
#[test]
fn more_presents_than_images_hang_nobody() {
    let Some((_server, window, presenter)) = on_screen(64, 64) else {
        return;
    };
    for mode in [vk::PresentModeKHR::FIFO, vk::PresentModeKHR::IMMEDIATE] {
        let chain = Chain {
            mode,
            ..Chain::of(64, 64)
        };
        let swapchain = presenter.swapchain(&chain).unwrap();
        let index = acquire(&presenter, swapchain, PATIENCE_NS).unwrap();
        for _ in 0..20 {
            presenter.present(swapchain, index, &[], 0).unwrap();
        }
        let pixels = screen_picture(64, 64, 4);
        for _ in 0..4 {
            presenter.show(swapchain, &chain, &pixels);
        }
        assert!(window.shows(64, 64, &pixels));
        presenter.destroy(swapchain);
    }
}

#[test]
fn a_surface_can_be_asked_by_a_thread_while_another_presents() {
    let Some((_server, window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let pixels = screen_picture(64, 64, 7);
    let (surfaces, physical, surface) = (
        presenter.surfaces.clone(),
        presenter.physical,
        presenter.surface,
    );
    let is_over = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let asking = scope.spawn(|| {
            let mut count = 0;
            while !is_over.load(std::sync::atomic::Ordering::Acquire) {
                // SAFETY: handles of the instance, which outlives the thread.
                let (limits, modes) = unsafe {
                    (
                        surfaces.get_physical_device_surface_capabilities(physical, surface),
                        surfaces.get_physical_device_surface_present_modes(physical, surface),
                    )
                };
                assert_eq!(limits.unwrap().current_extent.width, 64);
                assert!(modes.unwrap().contains(&vk::PresentModeKHR::FIFO));
                count += 1;
            }
            count
        });
        for mode in [vk::PresentModeKHR::FIFO, vk::PresentModeKHR::IMMEDIATE] {
            let chain = Chain {
                mode,
                ..Chain::of(64, 64)
            };
            for _ in 0..10 {
                let swapchain = presenter.swapchain(&chain).unwrap();
                for _ in 0..5 {
                    presenter.show(swapchain, &chain, &pixels);
                }
                presenter.destroy(swapchain);
            }
        }
        is_over.store(true, std::sync::atomic::Ordering::Release);
        assert!(asking.join().unwrap() > 10);
    });
    assert!(window.shows(64, 64, &pixels));
}

#[test]
fn thousands_of_swapchains_leave_nothing_behind() {
    let Some((_server, window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let pixels = screen_picture(64, 64, 5);
    presenter.assert_nothing_stays(64, &pixels, 10_000);
    assert!(window.shows(64, 64, &pixels));
}
