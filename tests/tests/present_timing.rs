//! When presentations are to be seen, and when they were: `VK_EXT_present_timing`.
#![cfg(unix)]

use std::sync::atomic::Ordering;
use std::time::Instant;

use ash::ext;
use tuff_tests::*;

const RELATIVE: u32 = 1;
const NEAREST: u32 = 2;
const ANY_ORDER: u32 = 2;
const QUEUE_FULL: i32 = -1_000_208_000;
const STAGE_LOCAL: vk::TimeDomainKHR = vk::TimeDomainKHR::from_raw(1_000_208_000);
const SWAPCHAIN_LOCAL: vk::TimeDomainKHR = vk::TimeDomainKHR::from_raw(1_000_208_001);
const SIDE: u32 = 16;
const MILLISECOND: u64 = 1_000_000;
/// How far a refresh of Xvfb is from the time it is due: its timer counts milliseconds.
const JITTER: u64 = 2 * MILLISECOND;

fn headless() -> Option<Presenter> {
    Presenter::new(ext::headless_surface::NAME, |entry, instance| {
        let surfaces = ext::headless_surface::Instance::new(entry, instance);
        let info = vk::HeadlessSurfaceCreateInfoEXT::default();
        // SAFETY: the surface is destroyed with the presenter.
        unsafe { surfaces.create_headless_surface(&info, None) }.unwrap()
    })
}

fn on_screen() -> Option<(Xvfb, Window, Presenter)> {
    let server = Xvfb::start(&[])?;
    let window = server.window(SIDE as u16, SIDE as u16);
    let presenter = window.presenter()?;
    Some((server, window, presenter))
}

/// A swapchain whose times are told, with room for so many results.
fn timed(times: &PresentTimes<'_>, presenter: &Presenter, size: u32) -> (vk::SwapchainKHR, Chain) {
    let chain = Chain {
        is_timed: true,
        count: 3,
        ..Chain::of(SIDE, SIDE)
    };
    let swapchain = presenter.swapchain(&chain).unwrap();
    assert_eq!(times.set_size(swapchain, size), vk::Result::SUCCESS);
    (swapchain, chain)
}

/// A presentation of a name, with a time at which it is to be seen.
fn asked(id: u64, flags: u32, target: u64, domain: u64) -> Asked {
    Asked {
        id,
        timing: Some(PresentTimingInfoEXT {
            flags,
            target_time: target,
            time_domain_id: domain,
            present_stage_queries: Stages::ALL,
            target_time_domain_present_stage: Stages::QUEUE_END,
            ..Default::default()
        }),
    }
}

fn show(presenter: &Presenter, swapchain: vk::SwapchainKHR, asked: Asked) {
    let extent = Chain::of(SIDE, SIDE).extent;
    let pixels = screen_picture(SIDE, SIDE, asked.id as u32);
    presenter
        .timed_frame(swapchain, extent, &pixels, asked)
        .unwrap();
}

fn domain(
    times: &PresentTimes<'_>,
    swapchain: vk::SwapchainKHR,
    wanted: vk::TimeDomainKHR,
) -> (vk::TimeDomainKHR, u64) {
    let domains = times.domains(swapchain);
    *(domains.iter())
        .find(|(domain, _)| *domain == wanted)
        .unwrap()
}

#[test]
fn results_are_queued_until_they_are_asked_for() {
    let Some(presenter) = headless() else { return };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    let (swapchain, chain) = timed(&times, &presenter, 2);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    assert_eq!(times.set_size(swapchain, 4), vk::Result::SUCCESS);
    for id in 1..=4 {
        show(&presenter, swapchain, asked(id * 3, 0, 0, local.1));
    }
    // A refused image stays acquired, and can be presented without a timing request.
    let pixels = screen_picture(SIDE, SIDE, 0);
    let refused = presenter.timed_frame(swapchain, chain.extent, &pixels, asked(15, 0, 0, local.1));
    assert_eq!(refused.unwrap_err().as_raw(), QUEUE_FULL);
    assert_eq!(times.set_size(swapchain, 3), vk::Result::NOT_READY);
    assert!(comes(|| times.count(swapchain, 0) >= 4));
    let (first, is_all) = times.past(swapchain, 0, 1);
    assert!(first.len() == 1 && first[0].id == 3 && !is_all, "{first:?}");
    show(&presenter, swapchain, asked(18, 0, 0, local.1));
    let rest = times.wait(swapchain, 4);
    let ids: Vec<_> = rest.iter().map(|told| told.id).collect();
    assert_eq!(ids, [6, 9, 12, 18]);
    for told in &rest {
        assert!(told.is_complete && told.domain == local && told.target == 0);
        assert_eq!(told.times.len(), 4, "all that was asked for");
        assert!(told.at(Stages::QUEUE_END) <= told.at(Stages::DEQUEUED));
        // The image is not visible.
        assert_eq!(told.at(Stages::OUT), 0);
    }
    assert_eq!(times.count(swapchain, ANY_ORDER), 0);
    presenter.destroy(swapchain);
}

#[test]
fn a_refused_image_is_still_acquired() {
    let Some(presenter) = headless() else { return };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    let (swapchain, _) = timed(&times, &presenter, 0);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    // SAFETY: the fence is waited for, and destroyed once.
    let index = unsafe {
        let device = &presenter.device;
        let fence = device
            .create_fence(&vk::FenceCreateInfo::default(), None)
            .unwrap();
        let none = vk::Semaphore::null();
        let swapchains = &presenter.swapchains;
        let acquired = swapchains.acquire_next_image(swapchain, PATIENCE_NS, none, fence);
        device.wait_for_fences(&[fence], true, PATIENCE_NS).unwrap();
        device.destroy_fence(fence, None);
        acquired.unwrap().0
    };
    let refused = presenter.timed_present(swapchain, index, &[], asked(1, 0, 0, local.1));
    assert_eq!(refused.unwrap_err().as_raw(), QUEUE_FULL);
    assert_eq!(times.set_size(swapchain, 1), vk::Result::SUCCESS);
    let taken = presenter.timed_present(swapchain, index, &[], asked(2, 0, 0, local.1));
    assert_eq!(taken, Ok(false));
    assert_eq!(times.wait(swapchain, 1)[0].id, 2);
    presenter.destroy(swapchain);
}

#[test]
fn times_are_by_the_clocks_that_can_be_asked() {
    let Some(presenter) = headless() else { return };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    let (swapchain, _) = timed(&times, &presenter, 2);
    let domains = times.domains(swapchain);
    assert!(domains.iter().any(|(domain, _)| *domain == STAGE_LOCAL));
    assert!(domains.iter().any(|(domain, _)| *domain == SWAPCHAIN_LOCAL));
    for domain in domains {
        let before = times.now(swapchain, Stages::QUEUE_END, domain);
        show(&presenter, swapchain, asked(1, 0, 0, domain.1));
        let told = times.wait(swapchain, 1);
        let after = times.now(swapchain, Stages::QUEUE_END, domain);
        assert_eq!(told[0].domain, domain);
        for (stage, time) in &told[0].times {
            assert!(
                *time == 0 || (before..=after).contains(time),
                "{stage} at {time}"
            );
        }
        assert_ne!(told[0].at(Stages::QUEUE_END), 0);
    }
    presenter.destroy(swapchain);
}

#[test]
fn presentations_wait_for_their_times() {
    let Some(presenter) = headless() else { return };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    let (swapchain, _) = timed(&times, &presenter, 4);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    // Nothing to count from, then half a second after the one before, then at a time, then late.
    show(
        &presenter,
        swapchain,
        asked(1, RELATIVE, 10_000_000_000, local.1),
    );
    let first = times.wait(swapchain, 1);
    let seen = first[0].at(Stages::DEQUEUED);
    let at = seen + 3000 * MILLISECOND;
    show(
        &presenter,
        swapchain,
        asked(2, RELATIVE, 500 * MILLISECOND, local.1),
    );
    show(&presenter, swapchain, asked(3, 0, at, local.1));
    assert_eq!(times.count(swapchain, ANY_ORDER), 0);
    show(&presenter, swapchain, asked(4, NEAREST, seen, local.1));
    let told = times.wait(swapchain, 3);
    assert_eq!(
        told.iter().map(|told| told.id).collect::<Vec<_>>(),
        [2, 3, 4]
    );
    assert!(told[0].at(Stages::DEQUEUED) >= seen + 500 * MILLISECOND);
    assert!(
        told[0].at(Stages::DEQUEUED) < at,
        "not only when the next one is due"
    );
    assert!(told[1].at(Stages::DEQUEUED) >= at && told[1].target == at);
    assert!(told[2].at(Stages::DEQUEUED) > told[1].at(Stages::DEQUEUED));
    // An image that would never be seen does not delay the end of the swapchain.
    show(&presenter, swapchain, asked(5, 0, u64::MAX, local.1));
    let start = Instant::now();
    presenter.destroy(swapchain);
    assert!(start.elapsed() < PATIENCE);
}

#[test]
fn the_latest_of_those_whose_time_has_come_is_shown() {
    let latest_ready = vk::PresentModeKHR::from_raw(1_000_361_000);
    let Some(presenter) = headless() else { return };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    let chain = Chain {
        is_timed: true,
        count: 4,
        mode: latest_ready,
        ..Chain::of(SIDE, SIDE)
    };
    if !has("latest ready", presenter.modes().contains(&latest_ready)) {
        return;
    }
    let swapchain = presenter.swapchain(&chain).unwrap();
    assert_eq!(times.set_size(swapchain, 4), vk::Result::SUCCESS);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    let now = times.now(swapchain, Stages::QUEUE_END, local);
    let (soon, later) = (now + 300 * MILLISECOND, now + 2500 * MILLISECOND);
    // The second is not ready when the first is.
    show(&presenter, swapchain, asked(1, 0, soon, local.1));
    show(&presenter, swapchain, asked(2, 0, later, local.1));
    let told = times.wait(swapchain, 2);
    let dequeued: Vec<_> = told.iter().map(|told| told.at(Stages::DEQUEUED)).collect();
    assert!(dequeued[0] >= soon && dequeued[0] < later, "{dequeued:?}");
    assert!(dequeued[1] >= later);
    presenter.destroy(swapchain);
}

#[test]
fn servers_of_x11_tell_when_a_picture_is_out() {
    let Some((_server, _window, presenter)) = on_screen() else {
        return;
    };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    assert_ne!(times.stages() & Stages::OUT, 0);
    let (swapchain, _) = timed(&times, &presenter, 64);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    assert_eq!(times.properties(swapchain).0, vk::Result::NOT_READY);
    let (_, _, counter) = times.properties(swapchain);
    let before = times.now(swapchain, Stages::OUT, local);
    for id in 1..=40 {
        show(&presenter, swapchain, asked(id, 0, 0, local.1));
    }
    let told = times.wait(swapchain, 40);
    let after = times.now(swapchain, Stages::OUT, local);
    let outs: Vec<_> = told.iter().map(|told| told.at(Stages::OUT)).collect();
    assert!(outs.is_sorted_by(|one, next| one < next), "{outs:?}");
    for told in &told {
        assert!(told.at(Stages::DEQUEUED) <= told.at(Stages::OUT));
        assert!((before..=after).contains(&told.at(Stages::OUT)));
    }
    // Xvfb counts 60 refreshes a second.
    let (code, properties, changed) = times.properties(swapchain);
    assert_eq!(code, vk::Result::SUCCESS);
    let period = properties.refresh_duration;
    assert_eq!(properties.refresh_interval, period);
    assert!(period.abs_diff(1_000_000_000 / 60) < 400_000, "{period} ns");
    assert!(changed > counter, "a change is counted");
    // Each is shown at the refresh that is meant, or, on a loaded machine, at another.
    let mut out = outs[39];
    for (flags, early_ns) in [(0, 0), (NEAREST, period / 2)] {
        let mut late = Vec::new();
        let is_punctual = enough(3, 60, || {
            let target = out + 10 * period + period / 4;
            show(&presenter, swapchain, asked(41, flags, target, local.1));
            out = times.wait(swapchain, 1)[0].at(Stages::OUT);
            late.push(out as i64 - target as i64);
            out + early_ns + JITTER >= target && out < target + period - early_ns
        });
        assert!(is_punctual, "{late:?} ns after the time asked for");
    }
    show(
        &presenter,
        swapchain,
        asked(43, RELATIVE, 5 * period, local.1),
    );
    let told = times.wait(swapchain, 1);
    assert!(told[0].at(Stages::OUT) + JITTER >= out + 5 * period);
    presenter.destroy(swapchain);
}

#[test]
fn servers_that_do_not_tell_are_not_asked() {
    let Some(server) = Xvfb::start_afar(true) else {
        return;
    };
    let window = server.window(SIDE as u16, SIDE as u16);
    let Some(presenter) = window.presenter() else {
        return;
    };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    assert_eq!(times.stages() & Stages::OUT, 0);
    let (swapchain, _) = timed(&times, &presenter, 4);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    for id in 1..=3 {
        show(&presenter, swapchain, asked(id, 0, 0, local.1));
    }
    let told = times.wait(swapchain, 3);
    assert!(
        told.iter()
            .all(|told| told.at(Stages::OUT) == 0 && told.at(Stages::DEQUEUED) != 0)
    );
    presenter.destroy(swapchain);
}

#[test]
fn a_window_that_dies_leaves_no_result_outstanding() {
    let Some((_server, window, presenter)) = on_screen() else {
        return;
    };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    let (swapchain, chain) = timed(&times, &presenter, 8);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    let now = times.now(swapchain, Stages::QUEUE_END, local);
    show(
        &presenter,
        swapchain,
        asked(1, 0, now + 200 * MILLISECOND, local.1),
    );
    show(
        &presenter,
        swapchain,
        asked(2, 0, now + 400 * MILLISECOND, local.1),
    );
    window.destroy();
    let told = times.wait(swapchain, 2);
    assert!(
        told.iter()
            .all(|told| told.is_complete && told.times.len() == 4)
    );
    let pixels = screen_picture(SIDE, SIDE, 0);
    let code = (0..20).find_map(|_| presenter.frame(swapchain, chain.extent, &pixels, 0).err());
    assert_eq!(code, Some(vk::Result::ERROR_SURFACE_LOST_KHR));
    presenter.destroy(swapchain);
}

#[test]
fn compositors_tell_when_a_picture_is_out() {
    let compositor = Compositor::start();
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    assert_ne!(times.stages() & Stages::OUT, 0);
    let (swapchain, _) = timed(&times, &presenter, 32);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    for id in 1..=20 {
        show(&presenter, swapchain, asked(id, 0, 0, local.1));
    }
    let told = times.wait(swapchain, 20);
    let outs: Vec<_> = told.iter().map(|told| told.at(Stages::OUT)).collect();
    let seen: Vec<_> = outs.iter().copied().filter(|out| *out != 0).collect();
    // Those that a later one overtook were not seen.
    assert_eq!(seen, *compositor.manners.presented.lock().unwrap());
    assert!(!seen.is_empty(), "{outs:?}");
    let (code, properties, _) = times.properties(swapchain);
    assert_eq!(code, vk::Result::SUCCESS);
    assert_eq!(properties.refresh_duration, 16_667_000);
    // The compositor's refreshes are as punctual as its thread.
    let mut target = seen[seen.len() - 1];
    let mut late = Vec::new();
    let is_punctual = enough(3, 60, || {
        target += 10 * 16_667_000;
        show(&presenter, swapchain, asked(21, 0, target, local.1));
        let out = times.wait(swapchain, 1)[0].at(Stages::OUT);
        late.push(out as i64 - target as i64);
        let is_not_before = out + 5 * MILLISECOND >= target;
        target = target.max(out);
        is_not_before
    });
    assert!(is_punctual, "{late:?} ns after the time asked for");
    // A hidden window is told of in finite time.
    compositor.manners.hides.store(true, Ordering::Release);
    show(&presenter, swapchain, asked(22, 0, 0, local.1));
    show(&presenter, swapchain, asked(23, 0, 0, local.1));
    let told = times.wait(swapchain, 2);
    assert!(
        told.iter()
            .all(|told| told.is_complete && told.at(Stages::OUT) == 0)
    );
    presenter.destroy(swapchain);
}

#[test]
fn compositors_that_do_not_tell_are_not_asked() {
    let compositor = Compositor::start_with(Offers::default());
    let Some(presenter) = compositor.presenter() else {
        return;
    };
    let Some(times) = PresentTimes::of(&presenter) else {
        return;
    };
    assert_eq!(times.stages() & Stages::OUT, 0);
    let (swapchain, _) = timed(&times, &presenter, 4);
    let local = domain(&times, swapchain, STAGE_LOCAL);
    show(&presenter, swapchain, asked(1, 0, 0, local.1));
    let told = times.wait(swapchain, 1);
    assert!(told[0].at(Stages::OUT) == 0 && told[0].at(Stages::DEQUEUED) != 0);
    presenter.destroy(swapchain);
}
