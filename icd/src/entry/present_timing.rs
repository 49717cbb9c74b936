//! `VK_EXT_present_timing`: target times and reported times of presentations.

use crate::ffi::enumerate::enumerate;
use crate::ffi::{array, vk};
use crate::guard::guard_result;
use crate::handle::from_handle;
use crate::present::Swapchain;
use crate::present::timing::{Report, Target, Timing, domains};

/// The timing request of a presentation.
pub fn timing(info: &vk::PresentTimingInfoEXT<'_>) -> Timing {
    let has = |flag| info.flags & flag != 0;
    Timing {
        target: (info.target_time != 0).then(|| Target {
            time_ns: info.target_time,
            is_relative: has(vk::PRESENT_TIMING_INFO_PRESENT_AT_RELATIVE_TIME_EXT),
            is_nearest: has(vk::PRESENT_TIMING_INFO_PRESENT_AT_NEAREST_REFRESH_CYCLE_EXT),
        }),
        stages: info.present_stage_queries,
        domain_id: info.time_domain_id,
    }
}

/// # Safety
/// `out` has room for as many stages as it says.
unsafe fn tell(out: &mut vk::PastPresentationTimingEXT<'_>, report: &Report) {
    let domain = domains().iter().find(|(_, id)| *id == report.domain_id);
    (out.time_domain, out.time_domain_id) = *domain.unwrap_or(&domains()[0]);
    out.present_id = report.id;
    out.target_time = report.target_ns;
    out.report_complete = vk::TRUE;
    // SAFETY: the caller guarantees that `out` has room for as many stages as it says.
    let room = unsafe { array::slice_mut(out.p_present_stages, out.present_stage_count) };
    let mut count = 0;
    for (out, stage) in room.iter_mut().zip(report.times()) {
        *out = stage;
        count += 1;
    }
    out.present_stage_count = count;
}

pub(crate) unsafe extern "system" fn vkSetSwapchainPresentTimingQueueSizeEXT(
    _device: vk::Device,
    swapchain: vk::SwapchainKHR,
    size: u32,
) -> vk::Result {
    guard_result("vkSetSwapchainPresentTimingQueueSizeEXT", move || {
        from_handle::<Swapchain>(swapchain).timings(|timings| timings.resize(size))
    })
}

pub(crate) unsafe extern "system" fn vkGetSwapchainTimingPropertiesEXT(
    _device: vk::Device,
    swapchain: vk::SwapchainKHR,
    out: *mut vk::SwapchainTimingPropertiesEXT,
    counter: *mut u64,
) -> vk::Result {
    guard_result("vkGetSwapchainTimingPropertiesEXT", move || {
        let (period, now) = from_handle::<Swapchain>(swapchain)
            .timings(|timings| (timings.period_ns(), timings.counter));
        // All known displays have a fixed rate.
        (*out).refresh_duration = period;
        (*out).refresh_interval = period;
        if let Some(counter) = counter.as_mut() {
            *counter = now;
        }
        match period {
            0 => Err(vk::Result::NOT_READY),
            _ => Ok(()),
        }
    })
}

pub(crate) unsafe extern "system" fn vkGetSwapchainTimeDomainPropertiesEXT(
    _device: vk::Device,
    _swapchain: vk::SwapchainKHR,
    out: *mut vk::SwapchainTimeDomainPropertiesEXT,
    counter: *mut u64,
) -> vk::Result {
    guard_result("vkGetSwapchainTimeDomainPropertiesEXT", move || {
        if let Some(counter) = counter.as_mut() {
            *counter = 1;
        }
        let out = &mut *out;
        let mut count = out.time_domain_count;
        let ids = domains().iter().map(|(_, id)| *id);
        let domains = domains().iter().map(|(domain, _)| *domain);
        // Both arrays have the same capacity and count.
        let _ = enumerate(&mut count, out.p_time_domains, domains);
        enumerate(&mut out.time_domain_count, out.p_time_domain_ids, ids)
    })
}

pub(crate) unsafe extern "system" fn vkGetPastPresentationTimingEXT(
    _device: vk::Device,
    info: *const vk::PastPresentationTimingInfoEXT,
    out: *mut vk::PastPresentationTimingPropertiesEXT,
) -> vk::Result {
    guard_result("vkGetPastPresentationTimingEXT", move || {
        let (info, out) = (&*info, &mut *out);
        let room = array::slice_mut(out.p_presentation_timings, out.presentation_timing_count);
        let is_question = out.p_presentation_timings.is_null();
        let (count, is_all) = from_handle::<Swapchain>(info.swapchain).timings(|timings| {
            out.timing_properties_counter = timings.counter;
            out.time_domains_counter = 1;
            match is_question {
                true => (timings.count(info.flags), true),
                false => timings.tell(info.flags, room.len() as u32, |index, report| {
                    tell(&mut room[index], report);
                }),
            }
        });
        out.presentation_timing_count = count;
        if is_all {
            Ok(())
        } else {
            Err(vk::Result::INCOMPLETE)
        }
    })
}
