//! Target times and reported times of presentations (`VK_EXT_present_timing`).
//!
//! All times are nanoseconds of [`Clock::Monotonic`](crate::os::clock::Clock), in every time
//! domain. It is the device's clock, and the clock of X11 servers and Wayland compositors on this
//! machine.

#![forbid(unsafe_code)]

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use ash::vk;

use crate::VkResult;
use crate::ffi::vk as newer;
use crate::os::clock::IS_POSIX;
use newer::PresentStageFlagsEXT as Stages;

/// The time domains of swapchains, with their ids.
const DOMAINS: [(vk::TimeDomainKHR, u64); 4] = [
    (newer::TIME_DOMAIN_PRESENT_STAGE_LOCAL_EXT, 1),
    (newer::TIME_DOMAIN_SWAPCHAIN_LOCAL_EXT, 2),
    (vk::TimeDomainKHR::DEVICE, 4),
    (vk::TimeDomainKHR::CLOCK_MONOTONIC, 3),
];

/// The time domains of this system.
pub fn domains() -> &'static [(vk::TimeDomainKHR, u64)] {
    &DOMAINS[..if IS_POSIX { 4 } else { 3 }]
}

/// The stages that every presentation has times for: the end of its queue operations, and its
/// dequeuing.
pub const OWN_STAGES: Stages =
    newer::PRESENT_STAGE_QUEUE_OPERATIONS_END_EXT | newer::PRESENT_STAGE_REQUEST_DEQUEUED_EXT;

/// The time after which a report completes without the times that are still missing.
const FORGOTTEN: Duration = Duration::from_secs(3);

/// A display's refresh cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refresh {
    /// The time of a past refresh.
    pub at_ns: u64,
    pub period_ns: u64,
}

/// The target time of a presentation (`VkPresentTimingInfoEXT`).
#[derive(Clone, Copy, Debug)]
pub struct Target {
    pub time_ns: u64,
    /// The time is relative to the display of the presentation before.
    pub is_relative: bool,
    /// The nearest refresh is used, even if it is before the time.
    pub is_nearest: bool,
}

impl Target {
    /// The time at which the image must be presented to be shown in time; `seen_ns` is the time at
    /// which the presentation before was shown. It is a quarter of a period after the refresh
    /// before the target, so that a small delay does not change the refresh. (Xvfb shows an image
    /// that arrives in the second half of a period one refresh later.)
    pub fn due_ns(&self, seen_ns: Option<u64>, refresh: Option<Refresh>) -> u64 {
        let wanted = match (self.is_relative, seen_ns) {
            (false, _) => self.time_ns,
            (true, Some(seen)) => seen.saturating_add(self.time_ns),
            (true, None) => return 0,
        };
        let Some(Refresh { at_ns, period_ns }) = refresh else {
            return wanted;
        };
        let ahead = wanted.saturating_sub(at_ns);
        let count = match self.is_nearest {
            true => ahead.saturating_add(period_ns / 2) / period_ns,
            false => ahead.div_ceil(period_ns),
        };
        at_ns
            .saturating_add(count.saturating_mul(period_ns))
            .saturating_sub(period_ns / 4 * 3)
    }
}

/// The timing to report for a presentation, and the time when it should be visible.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timing {
    pub target: Option<Target>,
    pub stages: Stages,
    pub domain_id: u64,
}

/// A display's period, measured by its count of refreshes.
#[derive(Default)]
pub struct RefreshEstimate {
    /// Time and refresh count at the start of the measurement.
    first: Option<(u64, u64)>,
    last: (u64, u64),
    period_ns: u64,
}

impl RefreshEstimate {
    /// Refreshes before the first estimate, and before a new measurement starts.
    const LEAST: u64 = 8;
    const MOST: u64 = 64;

    /// Adds an observation: the time of the refresh with this count.
    pub fn note(&mut self, at_ns: u64, count: u64) {
        let (last_at, last_count) = self.last;
        self.last = (at_ns, count);
        let Some((first_at, first_count)) = self.first else {
            self.first = Some(self.last);
            return;
        };
        if count < last_count || at_ns < last_at {
            // The counter went back: the window is on another display.
            *self = Self::default();
            self.first = Some((at_ns, count));
            self.last = (at_ns, count);
            return;
        }
        let passed = count - first_count;
        if passed < Self::LEAST {
            return;
        }
        let period = (at_ns - first_at) / passed;
        // Changes are reported to the application, so small variations are ignored.
        if period.abs_diff(self.period_ns) > self.period_ns / 64 {
            self.period_ns = period;
        }
        if passed >= Self::MOST {
            self.first = Some(self.last);
        }
    }

    /// The refresh cycle, if it is known.
    pub fn refresh(&self) -> Option<Refresh> {
        (self.period_ns != 0).then_some(Refresh {
            at_ns: self.last.0,
            period_ns: self.period_ns,
        })
    }
}

/// A server's time for an image sent at `sent_ns`. `None` if the server uses another clock, for
/// example on another machine. Servers that copy at once report the refresh before, so the result
/// is at least `sent_ns`.
pub fn server_time_ns(at_ns: u64, sent_ns: u64, now_ns: u64) -> Option<u64> {
    const APART: u64 = 1_000_000_000;
    let near = sent_ns.saturating_sub(APART)..=now_ns.saturating_add(APART);
    near.contains(&at_ns).then_some(at_ns.max(sent_ns))
}

/// The recorded times of one presentation.
pub struct Report {
    /// Identifies the report; 0 is no report.
    pub ticket: u64,
    pub id: u64,
    pub target_ns: u64,
    pub domain_id: u64,
    stages: Stages,
    /// The stages whose time is known, or will never be.
    known: Stages,
    /// Indexed by a stage's bit; 0 if the stage was not reached or its time is unknown.
    times: [u64; 4],
    since: Option<Instant>,
}

impl Report {
    const ALL: Stages = 0b1111;

    fn is_complete(&self) -> bool {
        self.stages & !self.known == 0
    }

    /// The requested stages with their times.
    pub fn times(&self) -> impl Iterator<Item = newer::PresentStageTimeEXT> {
        (0..self.times.len())
            .filter(|bit| self.stages & 1 << bit != 0)
            .map(|bit| newer::PresentStageTimeEXT {
                stage: 1 << bit,
                time: self.times[bit],
            })
    }
}

/// A swapchain's queue of timing results, and its display's refresh period.
pub struct Timings {
    size: usize,
    reports: VecDeque<Report>,
    tickets: u64,
    period_ns: u64,
    /// Incremented whenever the period changes.
    pub counter: u64,
}

impl Default for Timings {
    fn default() -> Self {
        Self {
            size: 0,
            reports: VecDeque::new(),
            tickets: 0,
            period_ns: 0,
            counter: 1,
        }
    }
}

impl Timings {
    /// # Errors
    /// `VK_NOT_READY` if more results are outstanding.
    pub fn resize(&mut self, size: u32) -> VkResult {
        if self.reports.len() > size as usize {
            return Err(vk::Result::NOT_READY);
        }
        self.size = size as usize;
        Ok(())
    }

    /// Reserves a result for a presentation and returns its ticket; 0 if no stage is requested.
    ///
    /// # Errors
    /// `VK_ERROR_PRESENT_TIMING_QUEUE_FULL_EXT`.
    pub fn reserve(&mut self, id: u64, timing: &Timing) -> VkResult<u64> {
        let stages = timing.stages & Report::ALL;
        if stages == 0 {
            return Ok(0);
        }
        if self.reports.len() >= self.size {
            return Err(newer::ERROR_PRESENT_TIMING_QUEUE_FULL_EXT);
        }
        self.tickets += 1;
        self.reports.push_back(Report {
            ticket: self.tickets,
            id,
            target_ns: timing.target.map_or(0, |target| target.time_ns),
            domain_id: timing.domain_id,
            stages,
            known: 0,
            times: [0; 4],
            since: None,
        });
        Ok(self.tickets)
    }

    fn report(&mut self, ticket: u64) -> Option<&mut Report> {
        (self.reports.iter_mut()).find(|report| report.ticket == ticket && ticket != 0)
    }

    /// Records that a presentation has reached a stage.
    pub fn reached(&mut self, ticket: u64, stage: Stages, at_ns: u64) {
        if let Some(report) = self.report(ticket)
            && report.known & stage == 0
        {
            report.known |= stage;
            report.times[stage.trailing_zeros() as usize] = at_ns;
            if stage == newer::PRESENT_STAGE_REQUEST_DEQUEUED_EXT {
                report.since = Some(Instant::now());
            }
        }
    }

    /// Completes a report: no more times will follow.
    pub fn finish(&mut self, ticket: u64) {
        if let Some(report) = self.report(ticket) {
            report.known = Report::ALL;
        }
    }

    /// Completes all reports.
    pub fn finish_all(&mut self) {
        (self.reports.iter_mut()).for_each(|report| report.known = Report::ALL);
    }

    /// The display's period is this.
    pub fn measured(&mut self, period_ns: u64) {
        if period_ns != self.period_ns {
            self.period_ns = period_ns;
            self.counter += 1;
        }
    }

    /// The refresh period in nanoseconds; 0 if it is unknown.
    pub fn period_ns(&self) -> u64 {
        self.period_ns
    }

    /// The number of results.
    pub fn count(&mut self, flags: vk::Flags) -> u32 {
        self.available(flags).count() as u32
    }

    /// Writes as many results as there is room for and removes them. Returns their number, and
    /// whether that is all of them.
    pub fn tell(
        &mut self,
        flags: vk::Flags,
        room: u32,
        mut tell: impl FnMut(usize, &Report),
    ) -> (u32, bool) {
        let mut told = Vec::new();
        let mut is_all = true;
        for report in self.available(flags) {
            if told.len() == room as usize {
                is_all = false;
                break;
            }
            tell(told.len(), report);
            told.push(report.ticket);
        }
        // Tickets ascend.
        self.reports
            .retain(|report| told.binary_search(&report.ticket).is_err());
        (told.len() as u32, is_all)
    }

    /// The results that can be reported, in the order of the presentations unless
    /// `VK_PAST_PRESENTATION_TIMING_ALLOW_OUT_OF_ORDER_RESULTS_BIT_EXT` allows any order. Partial
    /// results are not reported, even where allowed: all times of a result become known almost
    /// together.
    fn available(&mut self, flags: vk::Flags) -> impl Iterator<Item = &Report> {
        let in_any_order =
            flags & newer::PAST_PRESENTATION_TIMING_ALLOW_OUT_OF_ORDER_RESULTS_EXT != 0;
        for report in &mut self.reports {
            if (report.since).is_some_and(|since| since.elapsed() > FORGOTTEN) {
                report.known = Report::ALL;
            }
        }
        let from_front =
            (self.reports.iter()).take_while(move |report| in_any_order || report.is_complete());
        from_front.filter(|report| report.is_complete())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OUT: Stages = newer::PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_EXT;
    const DEQUEUED: Stages = newer::PRESENT_STAGE_REQUEST_DEQUEUED_EXT;

    #[test]
    fn targets_fall_due_after_the_refresh_before_theirs() {
        let refresh = Some(Refresh {
            at_ns: 1000,
            period_ns: 100,
        });
        let mut target = Target {
            time_ns: 1540,
            is_relative: false,
            is_nearest: false,
        };
        assert_eq!(target.due_ns(None, None), 1540);
        assert_eq!(target.due_ns(None, refresh), 1525);
        target.is_nearest = true;
        assert_eq!(target.due_ns(None, refresh), 1425);
        // A late image is due.
        target.time_ns = 3;
        assert!(target.due_ns(None, refresh) < 1000);
        target.time_ns = u64::MAX;
        assert!(target.due_ns(None, refresh) > u64::MAX / 2);
        let relative = Target {
            time_ns: 200,
            is_relative: true,
            is_nearest: false,
        };
        assert_eq!(relative.due_ns(None, refresh), 0);
        assert_eq!(relative.due_ns(Some(1300), refresh), 1425);
        assert_eq!(relative.due_ns(Some(1300), None), 1500);
    }

    #[test]
    fn rhythms_are_measured_over_many_refreshes_and_begin_anew_elsewhere() {
        let mut estimate = RefreshEstimate::default();
        for count in 0..200 {
            // A hand that shakes by a tenth.
            estimate.note(count * 1000 + count % 7 * 15, count);
            let period = estimate.refresh().map(|refresh| refresh.period_ns);
            assert_eq!(period.is_some(), count >= RefreshEstimate::LEAST);
            assert!(
                period.is_none_or(|period| period.abs_diff(1000) <= 16),
                "{period:?}"
            );
        }
        estimate.note(200_000, 3);
        assert_eq!(estimate.refresh(), None);
    }

    #[test]
    fn times_of_another_clock_are_none() {
        let second = 1_000_000_000;
        assert_eq!(
            server_time_ns(5 * second, 4 * second, 6 * second),
            Some(5 * second)
        );
        assert_eq!(
            server_time_ns(4 * second - 1, 4 * second, 6 * second),
            Some(4 * second)
        );
        assert_eq!(server_time_ns(9 * second, 4 * second, 6 * second), None);
        assert_eq!(server_time_ns(2 * second, 4 * second, 6 * second), None);
    }

    #[test]
    fn results_come_in_order_unless_asked_otherwise() {
        let any_order = newer::PAST_PRESENTATION_TIMING_ALLOW_OUT_OF_ORDER_RESULTS_EXT;
        let mut timings = Timings::default();
        let timing = Timing {
            stages: DEQUEUED | OUT,
            ..Timing::default()
        };
        let full = Err(newer::ERROR_PRESENT_TIMING_QUEUE_FULL_EXT);
        assert_eq!(timings.reserve(1, &timing), full);
        timings.resize(2).unwrap();
        let first = timings.reserve(1, &timing).unwrap();
        let second = timings.reserve(2, &timing).unwrap();
        assert_eq!(timings.reserve(3, &timing), full);
        assert_eq!(timings.resize(1), Err(vk::Result::NOT_READY));
        timings.reached(first, DEQUEUED, 10);
        timings.reached(second, DEQUEUED, 30);
        timings.finish(second);
        assert_eq!([0, any_order].map(|flags| timings.count(flags)), [0, 1]);
        timings.reached(first, OUT, 20);
        timings.reached(first, OUT, 21);
        let mut told = Vec::new();
        let mut tell = |_: usize, report: &Report| {
            told.extend(report.times().map(|it| (report.id, it.stage, it.time)));
        };
        assert_eq!(timings.tell(0, 1, &mut tell), (1, false));
        assert_eq!(timings.tell(0, 4, &mut tell), (1, true));
        let both = [
            (1, DEQUEUED, 10),
            (1, OUT, 20),
            (2, DEQUEUED, 30),
            (2, OUT, 0),
        ];
        assert_eq!(told, both);
        assert_eq!(timings.count(any_order), 0);
    }
}
