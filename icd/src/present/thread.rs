//! The thread of a swapchain, which presents one image at a time.

#![forbid(unsafe_code)]

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use ash::vk;
use serde_json::json;

use super::swapchain::{Next, Request, Shared};
use super::timing::{Refresh, Timing};
use super::{Frame, Screen, ScreenEvent, SurfaceLost, When};
use crate::execute::query::timestamp_ns;
use crate::guard::panic_text;
use crate::timeline::{self, Kind};

/// A hidden window's server may never report that an image was shown. After this time the next
/// image is presented.
const PATIENCE: Duration = Duration::from_secs(1);

/// An image that was presented and is not yet on the screen.
struct UnderWay {
    serial: u32,
    id: u64,
    since: Instant,
}

impl Shared {
    /// Presents images until the swapchain is closed or the window is lost.
    pub(super) fn run(&self, mut screen: Box<dyn Screen>) {
        let result = catch_unwind(AssertUnwindSafe(|| self.present(&mut *screen)));
        let code = match result {
            Ok(Ok(())) => return,
            Ok(Err(SurfaceLost)) => vk::Result::ERROR_SURFACE_LOST_KHR,
            Err(payload) => {
                let text = panic_text(&*payload);
                log::error!("presentation panicked: {text}");
                vk::Result::ERROR_SURFACE_LOST_KHR
            }
        };
        self.fail(code);
    }

    fn present(&self, screen: &mut dyn Screen) -> Result<(), SurfaceLost> {
        let mut serial = 0u32;
        let mut under_way: Option<UnderWay> = None;
        let mut continuous: Option<Request> = None;
        let mut timed = Timed::default();
        let mut events = Vec::new();
        loop {
            // The last image before the end is shown, even while another one is pending.
            let mut waits = None;
            if under_way.is_none() || self.is_ending() {
                let next = match (self.next(timed.seen_ns, screen.refresh()), &continuous) {
                    (Next::End, _) => return Ok(()),
                    (Next::Show(request), _) => Some(request),
                    (Next::Wait | Next::At(_), Some(again)) => Some(Request {
                        index: again.index,
                        id: 0,
                        mode: again.mode,
                        damage: Vec::new(),
                        timing: Timing::default(),
                        ticket: 0,
                    }),
                    (Next::At(time_ns), None) => {
                        waits = Some(Instant::now() + Duration::from_nanos(time_ns));
                        None
                    }
                    (Next::Wait, None) => None,
                };
                if let Some(request) = next {
                    serial = serial.wrapping_add(1);
                    let _span = timeline::span(Kind::Present, || {
                        let frame = json!({ "image": request.index, "id": request.id });
                        ("present".into(), frame)
                    });
                    screen.show(&Frame {
                        index: request.index,
                        serial,
                        when: when(request.mode),
                        damage: &request.damage,
                    })?;
                    timed.handed_over(serial, request.ticket, self);
                    under_way = Some(UnderWay {
                        serial,
                        id: request.id,
                        since: Instant::now(),
                    });
                    let is_continuous =
                        request.mode == vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH;
                    continuous = (is_continuous && screen.is_watched()).then_some(request);
                }
            }
            let deadline = under_way.as_ref().map(|frame| frame.since + PATIENCE);
            screen.wait(deadline.or(waits), &mut events)?;
            for event in events.drain(..) {
                match event {
                    ScreenEvent::Shown { serial } => {
                        if let Some(frame) = under_way.take_if(|frame| frame.serial == serial) {
                            timed.shown(serial);
                            self.shown(frame.id);
                        }
                    }
                    ScreenEvent::Out { serial, at_ns } => timed.out(serial, at_ns, self),
                    ScreenEvent::Free { index } => self.freed(index),
                    ScreenEvent::Extent(extent) => self.resized(extent),
                }
            }
            if let Some(Refresh { period_ns, .. }) = screen.refresh()
                && period_ns != timed.period_ns
            {
                timed.period_ns = period_ns;
                self.measured(period_ns);
            }
            let now = Instant::now();
            if let Some(frame) = under_way.take_if(|_| deadline.is_some_and(|end| now >= end)) {
                timed.shown(frame.serial);
                self.shown(frame.id);
            }
        }
    }
}

/// Times that the thread has observed.
#[derive(Default)]
struct Timed {
    /// The time at which the last frame was shown, and its serial.
    seen_ns: Option<u64>,
    seen_serial: u32,
    period_ns: u64,
    /// Serials of frames whose time is pending, with the tickets of their requests.
    asked: VecDeque<(u32, u64)>,
}

impl Timed {
    /// Pending frames at most. A window that has not reported the first of them will not report it.
    const MOST: usize = 64;

    fn handed_over(&mut self, serial: u32, ticket: u64, shared: &Shared) {
        if ticket != 0 {
            self.asked.push_back((serial, ticket));
        }
        if self.asked.len() > Self::MOST
            && let Some((_, ticket)) = self.asked.pop_front()
        {
            shared.out(ticket, None);
        }
    }

    /// Notes that a frame was shown now. A time that the server reports replaces this one.
    fn shown(&mut self, serial: u32) {
        if self.seen_serial != serial {
            self.seen_serial = serial;
            self.seen_ns = Some(timestamp_ns());
        }
    }

    fn out(&mut self, serial: u32, at_ns: Option<u64>, shared: &Shared) {
        let place = self.asked.iter().position(|(other, _)| *other == serial);
        if let Some((_, ticket)) = place.and_then(|place| self.asked.remove(place)) {
            shared.out(ticket, at_ns);
        }
        // Reports may arrive out of order.
        if at_ns.is_some() && serial.wrapping_sub(self.seen_serial) < u32::MAX / 2 {
            self.seen_serial = serial;
            self.seen_ns = at_ns;
        }
    }
}

fn when(mode: vk::PresentModeKHR) -> When {
    match mode {
        vk::PresentModeKHR::IMMEDIATE => When::AtOnce,
        vk::PresentModeKHR::MAILBOX => When::Replaceable,
        vk::PresentModeKHR::FIFO_RELAXED => When::NextRefreshOrLate,
        _ => When::NextRefresh,
    }
}
