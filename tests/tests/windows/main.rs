//! Windows of X11: what is presented is on the screen.
#![cfg(unix)]

mod failing;
mod pace;

use std::time::Duration;

use ash::{ext, khr};
use tuff_tests::*;

const WIDTH: u32 = 61;
const HEIGHT: u32 = 37;

/// A server, a window of it, and who presents to that: dropped in the other order.
#[track_caller]
fn on_screen(width: u32, height: u32) -> Option<(Xvfb, Window, Presenter)> {
    let server = Xvfb::start(&[])?;
    let window = server.window(width as u16, height as u16);
    let presenter = window.presenter()?;
    Some((server, window, presenter))
}

/// Frames in each mode on a server, the last of which is on the screen in the end.
fn shows_frames(server: Option<Xvfb>) {
    let Some(server) = server else { return };
    let window = server.window(WIDTH as u16, HEIGHT as u16);
    let Some(presenter) = window.presenter() else {
        return;
    };
    let extent = vk::Extent2D {
        width: WIDTH,
        height: HEIGHT,
    };
    let current = presenter.capabilities().unwrap().current_extent;
    assert_eq!(current, extent);
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
                let (_, suboptimal) = presenter.frame(swapchain, extent, &ordered, 0).unwrap();
                assert!(!suboptimal);
                if seed == 5 {
                    let shown = window.shows(WIDTH as u16, HEIGHT as u16, &pixels);
                    assert!(shown, "{mode:?} {format:?}: {}", wrong(&window, &pixels));
                }
            }
            old = swapchain;
        }
    }
    presenter.destroy(old);
}

/// How the screen differs from a picture of [`screen_picture`]: its first pixel names another one.
fn wrong(window: &Window, pixels: &[u8]) -> String {
    let shown = window.screenshot(WIDTH as u16, HEIGHT as u16);
    let both = shown.chunks_exact(4).zip(pixels.chunks_exact(4));
    let count = both
        .filter(|(shown, wanted)| shown[..3] != wanted[..3])
        .count();
    let (first, wanted) = (&shown[..4], &pixels[..4]);
    format!("{count} pixels are wrong, the first is {first:?} instead of {wanted:?}")
}

#[test]
fn what_is_presented_is_on_the_screen() {
    shows_frames(Xvfb::start(&[]));
}

#[test]
fn servers_without_shared_memory_are_sent_the_pixels() {
    shows_frames(Xvfb::start(&["MIT-SHM"]));
}

#[test]
fn servers_that_take_no_descriptors_share_segments() {
    shows_frames(Xvfb::start_afar(false));
}

#[test]
fn servers_without_present_are_copied_to() {
    shows_frames(Xvfb::start_afar(true));
}

/// A frame that waits for its refresh when its swapchain is replaced comes before the frames of the
/// new one, also where these are shown at once.
#[test]
fn frames_of_replaced_swapchains_come_first() {
    let Some((_server, window, presenter)) = on_screen(WIDTH, HEIGHT) else {
        return;
    };
    let frame = |swapchain, number| {
        let pixels = screen_picture(WIDTH, HEIGHT, number);
        let extent = Chain::of(WIDTH, HEIGHT).extent;
        presenter.frame(swapchain, extent, &pixels, 0).unwrap();
        pixels
    };
    let mut old = vk::SwapchainKHR::null();
    for turn in 0..10 {
        let mut chain = Chain {
            mode: vk::PresentModeKHR::FIFO,
            old,
            ..Chain::of(WIDTH, HEIGHT)
        };
        let waiting = presenter.swapchain(&chain).unwrap();
        if old != vk::SwapchainKHR::null() {
            presenter.destroy(old);
        }
        frame(waiting, 2 * turn);
        (chain.mode, chain.old) = (vk::PresentModeKHR::IMMEDIATE, waiting);
        let swapchain = presenter.swapchain(&chain).unwrap();
        presenter.destroy(waiting);
        let pixels = frame(swapchain, 2 * turn + 1);
        assert!(window.shows(WIDTH as u16, HEIGHT as u16, &pixels));
        // Longer than a refresh: nothing covers it.
        std::thread::sleep(Duration::from_millis(40));
        let stays = window.screenshot(WIDTH as u16, HEIGHT as u16);
        let both = stays.chunks_exact(4).zip(pixels.chunks_exact(4));
        assert!(
            both.into_iter()
                .all(|(shown, wanted)| shown[..3] == wanted[..3]),
            "{turn}"
        );
        old = swapchain;
    }
    presenter.destroy(old);
}

#[test]
fn the_last_frame_of_a_destroyed_swapchain_is_shown() {
    let Some((_server, window, presenter)) = on_screen(WIDTH, HEIGHT) else {
        return;
    };
    let chain = Chain::of(WIDTH, HEIGHT);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let pixels = screen_picture(WIDTH, HEIGHT, 99);
    for seed in [1, 99] {
        let pixels = screen_picture(WIDTH, HEIGHT, seed);
        presenter
            .frame(swapchain, chain.extent, &pixels, 0)
            .unwrap();
    }
    presenter.destroy(swapchain);
    assert!(window.shows(WIDTH as u16, HEIGHT as u16, &pixels));
}

#[test]
fn resized_windows_make_swapchains_suboptimal_and_replacements_fit() {
    let Some((_server, window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain::of(64, 64);
    let swapchain = presenter.swapchain(&chain).unwrap();
    presenter
        .frame(swapchain, chain.extent, &screen_picture(64, 64, 1), 0)
        .unwrap();
    window.resize(80, 48);
    let current = presenter.capabilities().unwrap().current_extent;
    assert_eq!((current.width, current.height), (80, 48));
    let told = (0..20).any(|seed| {
        match presenter.frame(swapchain, chain.extent, &screen_picture(64, 64, seed), 0) {
            Ok((_, suboptimal)) => suboptimal,
            Err(code) => {
                assert_eq!(code, vk::Result::ERROR_OUT_OF_DATE_KHR);
                true
            }
        }
    });
    assert!(told, "nobody says that the window has another size");
    let again = Chain {
        old: swapchain,
        ..Chain::of(80, 48)
    };
    let next = presenter.swapchain(&again).unwrap();
    presenter.destroy(swapchain);
    let pixels = screen_picture(80, 48, 9);
    let (_, suboptimal) = presenter.frame(next, again.extent, &pixels, 0).unwrap();
    assert!(!suboptimal);
    assert!(window.shows(80, 48, &pixels));
    presenter.destroy(next);
}

#[test]
fn pictures_are_stretched_over_windows_of_other_sizes() {
    let Some((_server, window, presenter)) = on_screen(64, 96) else {
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
    presenter.frame(swapchain, chain.extent, &small, 0).unwrap();
    let row = |y: u16| -> Vec<u8> {
        let shot = window.screenshot(64, 96);
        shot[usize::from(y) * 256..][..256].to_vec()
    };
    let is_there = |row: &[u8]| row[..3] == [255, 0, 0] && row[252..255] == [0, 0, 255];
    let fills = comes(|| is_there(&row(0)) && is_there(&row(95)));
    assert!(fills, "{:?}", row(0));
    presenter.destroy(swapchain);
    let chain = Chain {
        scaling: vk::PresentScalingFlagsEXT::ASPECT_RATIO_STRETCH,
        gravity: vk::PresentGravityFlagsEXT::MAX,
        ..chain
    };
    let swapchain = presenter.swapchain(&chain).unwrap();
    presenter.frame(swapchain, chain.extent, &small, 0).unwrap();
    // 64 by 64 pixels at the lower end.
    let lies_below = comes(|| !is_there(&row(0)) && !is_there(&row(31)) && is_there(&row(32)));
    assert!(lies_below, "{:?}", row(0));
    presenter.destroy(swapchain);
}

/// The application draws to the image that is shown (`VK_KHR_shared_presentable_image`), and asks
/// for a refresh or does not need to.
#[test]
fn shared_images_are_shown_again() {
    let shared = [
        vk::PresentModeKHR::SHARED_DEMAND_REFRESH,
        vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH,
    ];
    for mode in shared {
        let Some((_server, window, presenter)) = on_screen(64, 48) else {
            return;
        };
        if !presenter.extends(khr::shared_presentable_image::NAME)
            || !has(&format!("{mode:?}"), presenter.modes().contains(&mode))
        {
            return;
        }
        let chain = Chain {
            mode,
            count: 1,
            ..Chain::of(64, 48)
        };
        let swapchain = presenter.swapchain(&chain).unwrap();
        let index = acquire(&presenter, swapchain, PATIENCE_NS).unwrap();
        let device = &presenter.device;
        // SAFETY: handles of this device, idle before each recording and when they are destroyed;
        // no other work draws to the image.
        unsafe {
            let images = presenter.swapchains.get_swapchain_images(swapchain);
            let image = images.unwrap()[index as usize];
            let info = vk::CommandPoolCreateInfo::default();
            let pool = device.create_command_pool(&info, None).unwrap();
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(pool)
                .command_buffer_count(1);
            let commands = device.allocate_command_buffers(&info).unwrap();
            let range = vk::ImageSubresourceRange::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .level_count(1)
                .layer_count(1);
            let layout = vk::ImageLayout::SHARED_PRESENT_KHR;
            for round in 0..4u8 {
                let flags = vk::CommandPoolResetFlags::empty();
                device.reset_command_pool(pool, flags).unwrap();
                let begin = vk::CommandBufferBeginInfo::default();
                device.begin_command_buffer(commands[0], &begin).unwrap();
                if round == 0 {
                    let barrier = vk::ImageMemoryBarrier::default()
                        .new_layout(layout)
                        .dst_access_mask(vk::AccessFlags::TRANSFER_WRITE)
                        .image(image)
                        .subresource_range(range);
                    let stage = vk::PipelineStageFlags::TRANSFER;
                    let none = vk::DependencyFlags::empty();
                    let barriers = [barrier];
                    device.cmd_pipeline_barrier(
                        commands[0],
                        stage,
                        stage,
                        none,
                        &[],
                        &[],
                        &barriers,
                    );
                }
                let bytes = [40 * round, 255 - 60 * round, 7, 255];
                let color = vk::ClearColorValue {
                    float32: bytes.map(|byte| f32::from(byte) / 255.0),
                };
                device.cmd_clear_color_image(commands[0], image, layout, &color, &[range]);
                device.end_command_buffer(commands[0]).unwrap();
                let submit = vk::SubmitInfo::default().command_buffers(&commands);
                let fence = vk::Fence::null();
                device
                    .queue_submit(presenter.queue, &[submit], fence)
                    .unwrap();
                device.queue_wait_idle(presenter.queue).unwrap();
                if round == 0 || mode == vk::PresentModeKHR::SHARED_DEMAND_REFRESH {
                    presenter.present(swapchain, index, &[], 0).unwrap();
                }
                let pixel = [bytes[2], bytes[1], bytes[0], 255];
                assert!(window.shows(64, 48, &pixel.repeat(64 * 48)), "{mode:?}");
            }
            device.destroy_command_pool(pool, None);
        }
        presenter.destroy(swapchain);
    }
}

#[test]
fn a_window_has_one_swapchain_that_is_not_retired() {
    let Some((_server, _window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let chain = Chain::of(64, 64);
    let first = presenter.swapchain(&chain).unwrap();
    let refused = presenter.swapchain(&chain).err();
    assert_eq!(refused, Some(vk::Result::ERROR_NATIVE_WINDOW_IN_USE_KHR));
    let second = presenter
        .swapchain(&Chain {
            old: first,
            ..chain
        })
        .unwrap();
    // SAFETY: the swapchain is alive, though retired.
    let acquired = unsafe {
        let (none, fence) = (vk::Semaphore::null(), vk::Fence::null());
        presenter
            .swapchains
            .acquire_next_image(first, 0, none, fence)
    };
    assert_eq!(acquired.err(), Some(vk::Result::ERROR_OUT_OF_DATE_KHR));
    presenter.destroy(first);
    presenter.destroy(second);
    let third = presenter.swapchain(&chain).unwrap();
    presenter.destroy(third);
}

/// An image of a swapchain, acquired by a fence; the code, where there is none.
fn acquire(
    presenter: &Presenter,
    swapchain: vk::SwapchainKHR,
    timeout_ns: u64,
) -> Result<u32, vk::Result> {
    // SAFETY: the fence is waited for where it will be signaled, and destroyed once.
    unsafe {
        let device = &presenter.device;
        let fence = device
            .create_fence(&vk::FenceCreateInfo::default(), None)
            .unwrap();
        let none = vk::Semaphore::null();
        let swapchains = &presenter.swapchains;
        let acquired = swapchains.acquire_next_image(swapchain, timeout_ns, none, fence);
        if acquired.is_ok() {
            device.wait_for_fences(&[fence], true, PATIENCE_NS).unwrap();
        }
        device.destroy_fence(fence, None);
        acquired.map(|(index, _)| index)
    }
}

/// Event loops look into the connection's queue, then sleep until its socket can be read.
#[test]
fn events_wake_programs_that_poll_the_connection() {
    use std::os::fd::AsRawFd;

    use x11rb::connection::Connection;
    use x11rb::protocol::xproto::{
        AtomEnum, ChangeWindowAttributesAux, ConnectionExt, EventMask, PropMode,
    };
    use x11rb::wrapper::ConnectionExt as _;

    let Some((server, window, presenter)) = on_screen(64, 64) else {
        return;
    };
    let wanted = ChangeWindowAttributesAux::new().event_mask(EventMask::PROPERTY_CHANGE);
    let selected = window.x.change_window_attributes(window.window, &wanted);
    selected.unwrap().check().unwrap();
    let other = server.window(1, 1);
    let chain = Chain::of(64, 64);
    let swapchain = presenter.swapchain(&chain).unwrap();
    let pixels = screen_picture(64, 64, 1);
    let (name, text) = (AtomEnum::WM_NAME, AtomEnum::STRING);
    for round in 0..200u32 {
        (presenter.frame(swapchain, chain.extent, &pixels, 0)).unwrap();
        let sender = std::thread::scope(|scope| {
            let sender = scope.spawn(|| {
                // From when the frame is on its way to when it is long there.
                std::thread::sleep(Duration::from_micros(u64::from(round) * 250));
                let x = &other.x;
                x.change_property8(PropMode::REPLACE, window.window, name, text, b"name")
                    .unwrap();
                x.flush().unwrap();
            });
            while window.x.poll_for_event().unwrap().is_none() {
                let mut socket = libc::pollfd {
                    fd: window.x.as_raw_fd(),
                    events: libc::POLLIN,
                    revents: 0,
                };
                // SAFETY: one structure, which lives here.
                let ready = unsafe { libc::poll(&raw mut socket, 1, PATIENCE.as_millis() as i32) };
                assert_eq!(ready, 1, "nothing wakes the program in round {round}");
            }
            sender.join()
        });
        sender.unwrap();
    }
    presenter.destroy(swapchain);
}
