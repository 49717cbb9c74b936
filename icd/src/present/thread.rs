//! The thread of a swapchain: one image at a time is on its way to the window.

#![forbid(unsafe_code)]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use ash::vk;

use super::swapchain::{Next, Request, Shared};
use super::{Event, Frame, Gone, Screen, When};
use crate::guard::panic_text;
use crate::log::{self, Level};

/// A hidden window's server may never say that an image's turn has come. Then the next one has its
/// turn.
const PATIENCE: Duration = Duration::from_secs(1);

/// An image that was handed over and is not yet on the screen.
struct UnderWay {
    serial: u32,
    id: u64,
    since: Instant,
}

impl Shared {
    /// Shows what is presented until the swapchain is closed or the window has gone.
    pub(super) fn run(&self, mut screen: Box<dyn Screen>) {
        let result = catch_unwind(AssertUnwindSafe(|| self.present(&mut *screen)));
        let code = match result {
            Ok(Ok(())) => return,
            Ok(Err(Gone)) => vk::Result::ERROR_SURFACE_LOST_KHR,
            Err(payload) => {
                let text = panic_text(&*payload);
                log::write(Level::Error, &format!("presentation panicked: {text}"));
                vk::Result::ERROR_SURFACE_LOST_KHR
            }
        };
        self.fail(code);
    }

    fn present(&self, screen: &mut dyn Screen) -> Result<(), Gone> {
        let mut serial = 0u32;
        let mut under_way: Option<UnderWay> = None;
        let mut continuous: Option<Request> = None;
        let mut events = Vec::new();
        loop {
            // What was presented last before the end is handed over whatever is under way.
            if under_way.is_none() || self.is_ending() {
                let next = match (self.next(), &continuous) {
                    (Next::End, _) => return Ok(()),
                    (Next::Show(request), _) => Some(request),
                    (Next::Wait, Some(again)) => Some(Request {
                        index: again.index,
                        id: 0,
                        mode: again.mode,
                        damage: Vec::new(),
                    }),
                    (Next::Wait, None) => None,
                };
                if let Some(request) = next {
                    serial = serial.wrapping_add(1);
                    screen.show(&Frame {
                        index: request.index,
                        serial,
                        when: when(request.mode),
                        damage: &request.damage,
                    })?;
                    under_way = Some(UnderWay {
                        serial,
                        id: request.id,
                        since: Instant::now(),
                    });
                    continuous = (request.mode == vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH)
                        .then_some(request);
                }
            }
            let deadline = under_way.as_ref().map(|frame| frame.since + PATIENCE);
            screen.wait(deadline, &mut events)?;
            for event in events.drain(..) {
                match event {
                    Event::Shown { serial } => {
                        if let Some(frame) = under_way.take_if(|frame| frame.serial == serial) {
                            self.shown(frame.id);
                        }
                    }
                    Event::Free { index } => self.freed(index),
                    Event::Extent(extent) => self.resized(extent),
                }
            }
            let now = Instant::now();
            if let Some(frame) = under_way.take_if(|_| deadline.is_some_and(|end| now >= end)) {
                self.shown(frame.id);
            }
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
