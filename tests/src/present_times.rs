//! When presentations are seen (`VK_EXT_present_timing`), of a presenter's device.

use std::ffi::CStr;

use ash::khr;

use crate::newer::{self as vk, PRESENT_TIMING};
use crate::{Presenter, comes};

type SetSize = unsafe extern "system" fn(vk::Device, vk::SwapchainKHR, u32) -> vk::Result;
type Properties = unsafe extern "system" fn(
    vk::Device,
    vk::SwapchainKHR,
    *mut vk::SwapchainTimingPropertiesEXT,
    *mut u64,
) -> vk::Result;
type Domains = unsafe extern "system" fn(
    vk::Device,
    vk::SwapchainKHR,
    *mut vk::SwapchainTimeDomainPropertiesEXT,
    *mut u64,
) -> vk::Result;
type Past = unsafe extern "system" fn(
    vk::Device,
    *const vk::PastPresentationTimingInfoEXT,
    *mut vk::PastPresentationTimingPropertiesEXT,
) -> vk::Result;

/// The extension's commands.
pub struct PresentTimes<'a> {
    presenter: &'a Presenter,
    set_size: SetSize,
    properties: Properties,
    domains: Domains,
    past: Past,
    clocks: khr::calibrated_timestamps::Device,
}

/// `VkPresentStageFlagBitsEXT`.
pub struct Stages;

impl Stages {
    pub const QUEUE_END: u32 = 1;
    pub const DEQUEUED: u32 = 2;
    pub const OUT: u32 = 4;
    pub const ALL: u32 = 15;
}

/// The times of a presentation.
#[derive(Clone, Debug)]
pub struct PresentationTiming {
    pub id: u64,
    pub target: u64,
    /// Stages and their times.
    pub times: Vec<(u32, u64)>,
    pub domain: (vk::TimeDomainKHR, u64),
    pub is_complete: bool,
}

impl PresentationTiming {
    /// A stage's time, which was asked for.
    #[track_caller]
    pub fn at(&self, stage: u32) -> u64 {
        let time = self.times.iter().find(|(other, _)| *other == stage);
        time.expect("it is told of").1
    }
}

impl<'a> PresentTimes<'a> {
    /// The commands, where the device has them.
    #[track_caller]
    pub fn of(presenter: &'a Presenter) -> Option<PresentTimes<'a>> {
        if !presenter.extends(PRESENT_TIMING) {
            return None;
        }
        let (instance, device) = (&presenter.instance, presenter.device.handle());
        let find = |name: &CStr| {
            // SAFETY: the device is of the instance.
            unsafe { instance.get_device_proc_addr(device, name.as_ptr()) }.unwrap()
        };
        // SAFETY: the registry says so.
        unsafe {
            Some(PresentTimes {
                presenter,
                set_size: std::mem::transmute::<unsafe extern "system" fn(), SetSize>(find(
                    c"vkSetSwapchainPresentTimingQueueSizeEXT",
                )),
                properties: std::mem::transmute::<unsafe extern "system" fn(), Properties>(find(
                    c"vkGetSwapchainTimingPropertiesEXT",
                )),
                domains: std::mem::transmute::<unsafe extern "system" fn(), Domains>(find(
                    c"vkGetSwapchainTimeDomainPropertiesEXT",
                )),
                past: std::mem::transmute::<unsafe extern "system" fn(), Past>(find(
                    c"vkGetPastPresentationTimingEXT",
                )),
                clocks: khr::calibrated_timestamps::Device::new(instance, &presenter.device),
            })
        }
    }

    /// The stages that the surface tells of.
    pub fn stages(&self) -> u32 {
        let mut times = vk::PresentTimingSurfaceCapabilitiesEXT::default();
        let mut all = vk::SurfaceCapabilities2KHR {
            p_next: (&raw mut times).cast(),
            ..Default::default()
        };
        let info = vk::PhysicalDeviceSurfaceInfo2KHR::default().surface(self.presenter.surface);
        let surfaces = khr::get_surface_capabilities2::Instance::new(
            &self.presenter.entry,
            &self.presenter.instance,
        );
        // SAFETY: handles of this instance, and a chain of structures that live here.
        unsafe {
            surfaces
                .get_physical_device_surface_capabilities2(self.presenter.physical, &info, &mut all)
                .unwrap();
        }
        assert_eq!(times.present_timing_supported, vk::TRUE);
        assert_eq!(times.present_at_absolute_time_supported, vk::TRUE);
        assert_eq!(times.present_at_relative_time_supported, vk::TRUE);
        assert_ne!(times.present_stage_queries & Stages::QUEUE_END, 0);
        times.present_stage_queries
    }

    /// Makes room for so many results.
    pub fn set_size(&self, swapchain: vk::SwapchainKHR, size: u32) -> vk::Result {
        // SAFETY: the swapchain is alive.
        unsafe { (self.set_size)(self.presenter.device.handle(), swapchain, size) }
    }

    /// The display's refreshes, and the counter of their changes.
    pub fn properties(
        &self,
        swapchain: vk::SwapchainKHR,
    ) -> (vk::Result, vk::SwapchainTimingPropertiesEXT, u64) {
        let mut properties = vk::SwapchainTimingPropertiesEXT::default();
        let mut counter = 0;
        let device = self.presenter.device.handle();
        // SAFETY: the swapchain is alive; the structures live here.
        let code = unsafe { (self.properties)(device, swapchain, &mut properties, &mut counter) };
        (code, properties, counter)
    }

    /// The clocks, and their names.
    pub fn domains(&self, swapchain: vk::SwapchainKHR) -> Vec<(vk::TimeDomainKHR, u64)> {
        let device = self.presenter.device.handle();
        let mut out = vk::SwapchainTimeDomainPropertiesEXT::default();
        // SAFETY: the swapchain is alive; the arrays are as long as said.
        unsafe {
            let null = std::ptr::null_mut();
            let code = (self.domains)(device, swapchain, &mut out, null);
            assert_eq!(code, vk::Result::SUCCESS);
            let count = out.time_domain_count as usize;
            let mut domains = vec![vk::TimeDomainKHR::default(); count];
            let mut ids = vec![0; count];
            out.p_time_domains = domains.as_mut_ptr();
            out.p_time_domain_ids = ids.as_mut_ptr();
            out.time_domain_count = 1;
            let code = (self.domains)(device, swapchain, &mut out, null);
            assert_eq!((code, out.time_domain_count), (vk::Result::INCOMPLETE, 1));
            out.time_domain_count = count as u32;
            let mut counter = 0;
            let code = (self.domains)(device, swapchain, &mut out, &mut counter);
            assert_eq!(code, vk::Result::SUCCESS);
            domains.into_iter().zip(ids).collect()
        }
    }

    /// Now, by each of the swapchain's clocks, of a stage.
    pub fn now(
        &self,
        swapchain: vk::SwapchainKHR,
        stage: u32,
        (domain, id): (vk::TimeDomainKHR, u64),
    ) -> u64 {
        let named = vk::SwapchainCalibratedTimestampInfoEXT {
            swapchain,
            present_stage: stage,
            time_domain_id: id,
            ..Default::default()
        };
        let mut info = vk::CalibratedTimestampInfoKHR::default().time_domain(domain);
        info.p_next = (&raw const named).cast();
        // SAFETY: the swapchain is alive; the structures live here.
        unsafe { self.clocks.get_calibrated_timestamps(&[info]) }
            .unwrap()
            .0[0]
    }

    /// The times of at most so many presentations, and whether these are all.
    pub fn past(
        &self,
        swapchain: vk::SwapchainKHR,
        flags: u32,
        most: u32,
    ) -> (Vec<PresentationTiming>, bool) {
        let info = vk::PastPresentationTimingInfoEXT {
            flags,
            swapchain,
            ..Default::default()
        };
        let mut stages = vec![[vk::PresentStageTimeEXT::default(); 4]; most as usize];
        let mut told: Vec<_> = (stages.iter_mut())
            .map(|stages| vk::PastPresentationTimingEXT {
                present_stage_count: 4,
                p_present_stages: stages.as_mut_ptr(),
                ..Default::default()
            })
            .collect();
        let mut out = vk::PastPresentationTimingPropertiesEXT {
            presentation_timing_count: most,
            p_presentation_timings: told.as_mut_ptr(),
            ..Default::default()
        };
        // SAFETY: the swapchain is alive; the arrays are as long as said.
        let code = unsafe { (self.past)(self.presenter.device.handle(), &info, &mut out) };
        assert!(code.as_raw() >= 0, "{code:?}");
        told.truncate(out.presentation_timing_count as usize);
        let of = |(told, stages): (
            &vk::PastPresentationTimingEXT,
            &[vk::PresentStageTimeEXT; 4],
        )| PresentationTiming {
            id: told.present_id,
            target: told.target_time,
            times: stages[..told.present_stage_count as usize]
                .iter()
                .map(|stage| (stage.stage, stage.time))
                .collect(),
            domain: (told.time_domain, told.time_domain_id),
            is_complete: told.report_complete == vk::TRUE,
        };
        let all = told.iter().zip(&stages).map(of).collect();
        (all, code == vk::Result::SUCCESS)
    }

    /// How many results there are.
    pub fn count(&self, swapchain: vk::SwapchainKHR, flags: u32) -> u32 {
        let info = vk::PastPresentationTimingInfoEXT {
            flags,
            swapchain,
            ..Default::default()
        };
        let mut out = vk::PastPresentationTimingPropertiesEXT::default();
        // SAFETY: the swapchain is alive; the structures live here.
        let code = unsafe { (self.past)(self.presenter.device.handle(), &info, &mut out) };
        assert_eq!(code, vk::Result::SUCCESS);
        out.presentation_timing_count
    }

    /// Waits for the results of so many presentations.
    #[track_caller]
    pub fn wait(&self, swapchain: vk::SwapchainKHR, count: usize) -> Vec<PresentationTiming> {
        let mut all = Vec::new();
        let has_all = comes(|| {
            all.extend(self.past(swapchain, 0, 64).0);
            all.len() >= count
        });
        assert!(has_all, "{all:?}");
        all
    }
}
