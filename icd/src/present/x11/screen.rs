//! Presents a swapchain's images to an X11 window.
//!
//! A server with the Present extension copies each pixmap at a refresh and reports the completion.
//! Other servers copy pixmaps at once, and the driver's clock decides the refreshes.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ash::vk;
use x11rb::protocol::present::{ConnectionExt as _, Option as PresentOption};
use x11rb::protocol::xproto::{ConnectionExt as _, CreateGCAux};

use super::super::timing::{Refresh, RefreshEstimate, server_time_ns};
use super::super::{Frame, Pictures, Screen, ScreenEvent, SurfaceLost, WakeEvent, When};
use super::buffers::Buffers;
use super::connection::{Connection, Pixels, Sharing};
use super::events::{Events, Inbox};
use super::{Inner, Server};
use crate::execute::query::timestamp_ns;

/// The refresh period where the server reports none.
const REFRESH: Duration = Duration::from_nanos(16_666_667);
/// The interval of window queries while the server is silent.
const LOOK: Duration = Duration::from_millis(100);
/// The time after which a frame counts as lost. Windows that are unmapped lose their frames.
const FORGOTTEN: Duration = Duration::from_secs(3);

pub struct X11Screen {
    connection: Arc<Connection>,
    window: u32,
    pixels: Pixels,
    sharing: Sharing,
    pictures: Pictures,
    wake: Arc<WakeEvent>,
    gc: u32,
    buffers: Option<Buffers>,
    /// The window's extent at the last query.
    extent: vk::Extent2D,
    timing: Timing,
    looked: Instant,
    /// Replies were read since the application's pollers of the connection were last woken.
    has_read: bool,
    /// Events for the next wait.
    pending: Vec<ScreenEvent>,
}

/// The source of presentation times.
enum Timing {
    /// The server's Present extension.
    Present {
        events: Arc<Events>,
        inbox: Arc<Inbox>,
        under_way: Vec<UnderWay>,
        last_msc: u64,
        estimate: RefreshEstimate,
    },
    /// The driver's clock: the time of the next refresh, and the frame that is shown at it.
    Clock { next: Instant, shown: Option<u32> },
}

/// A frame that was sent to the server.
struct UnderWay {
    /// The serial number in the server's events.
    number: u32,
    serial: u32,
    index: u32,
    since: Instant,
    sent_ns: u64,
    /// The server shows the frame after all earlier ones.
    is_in_order: bool,
}

impl UnderWay {
    fn is_over(&self, at_ns: Option<u64>) -> [ScreenEvent; 3] {
        let (index, serial) = (self.index, self.serial);
        let out = ScreenEvent::Out { serial, at_ns };
        [
            ScreenEvent::Free { index },
            out,
            ScreenEvent::Shown { serial },
        ]
    }
}

impl X11Screen {
    /// Creates the screen of a swapchain's images.
    ///
    /// # Errors
    /// The window or its connection is lost.
    pub(super) fn new(
        window: &Arc<Inner>,
        server: Server,
        pixels: Pixels,
        pictures: Pictures,
        wake: &Arc<WakeEvent>,
    ) -> Result<Self, SurfaceLost> {
        let connection = Arc::clone(&window.connection);
        let gc = connection.id()?;
        // Copies from pixmaps generate no events.
        let look = CreateGCAux::new().graphics_exposures(0);
        let made = connection.x.create_gc(gc, window.window, &look);
        made.map_err(|_| SurfaceLost)?.ignore_error();
        let timing = match server.events {
            Some(events) => Timing::Present {
                inbox: events.inbox(wake),
                events,
                under_way: Vec::new(),
                last_msc: 0,
                estimate: RefreshEstimate::default(),
            },
            None => Timing::Clock {
                next: Instant::now(),
                shown: None,
            },
        };
        Ok(Self {
            extent: connection.extent(window.window)?,
            window: window.window,
            pixels,
            sharing: server.sharing,
            pictures,
            wake: Arc::clone(wake),
            gc,
            buffers: None,
            timing,
            looked: Instant::now(),
            has_read: false,
            pending: Vec::new(),
            connection,
        })
    }

    /// The extent of the pixmaps.
    fn buffer_extent(&self) -> vk::Extent2D {
        match self.pictures.scaling.is_asked_for() {
            true => self.extent,
            false => self.pictures.extent(),
        }
    }

    /// Whether frames are in flight at a server that reports completions.
    fn is_under_way(&self) -> bool {
        matches!(&self.timing, Timing::Present { under_way, .. } if !under_way.is_empty())
    }

    /// Queries the window's extent, which fails if the window is destroyed.
    fn look(&mut self) -> Result<(), SurfaceLost> {
        self.looked = Instant::now();
        self.has_read = true;
        self.extent = self.connection.extent(self.window)?;
        self.pending.push(ScreenEvent::Extent(self.extent));
        Ok(())
    }

    /// Collects pending events of the server.
    fn collect(&mut self) -> Result<(), SurfaceLost> {
        let Timing::Present {
            events,
            inbox,
            under_way,
            last_msc,
            estimate,
        } = &mut self.timing
        else {
            return Ok(());
        };
        if inbox.is_broken.load(Ordering::Acquire) {
            return Err(SurfaceLost);
        }
        for completed in inbox.completed.lock().drain(..) {
            let mut frames = under_way.iter();
            let Some(place) = frames.position(|frame| frame.number == completed.serial) else {
                continue;
            };
            let frame = under_way.remove(place);
            *last_msc = completed.msc;
            if frame.is_in_order {
                events.settle(frame.number);
            }
            let shown_ns = completed.ust.saturating_mul(1000);
            let at_ns = server_time_ns(shown_ns, frame.sent_ns, timestamp_ns());
            if at_ns.is_some() {
                estimate.note(shown_ns, completed.msc);
            }
            // Pixmaps are copied (`PresentOptionCopy`), so a presented pixmap is no longer read.
            self.pending.extend(frame.is_over(at_ns));
        }
        let forgotten = under_way.extract_if(.., |frame| frame.since.elapsed() > FORGOTTEN);
        for frame in forgotten {
            self.pending.extend(frame.is_over(None));
            events.forget(frame.number);
        }
        Ok(())
    }

    /// Sends a pixmap to the server's Present extension.
    fn present(&mut self, pixmap: u32, frame: &Frame<'_>) -> Result<(), SurfaceLost> {
        let Timing::Present {
            events,
            under_way,
            last_msc,
            ..
        } = &mut self.timing
        else {
            return Ok(());
        };
        // Frames of the previous swapchain may still wait for their refresh. They come
        // first.
        let is_own = |number| under_way.iter().any(|frame| frame.number == number);
        let when = match events.has_others(is_own) {
            true => When::NextRefresh,
            false => frame.when,
        };
        let number = events.begin()?;
        let sent_ns = timestamp_ns();
        let (options, target_msc) = match when {
            When::NextRefresh | When::Replaceable => (PresentOption::COPY, 0),
            When::NextRefreshOrLate => (PresentOption::COPY | PresentOption::ASYNC, *last_msc + 1),
            When::AtOnce => (PresentOption::COPY | PresentOption::ASYNC, 0),
        };
        let is_in_order = !options.contains(PresentOption::ASYNC);
        let x = &self.connection.x;
        x.present_pixmap(
            self.window,
            pixmap,
            number,
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            options.into(),
            target_msc,
            0,
            0,
            // Servers up to 21.1 crash with notifies for other windows.
            &[],
        )
        .map_err(|_| SurfaceLost)?
        .ignore_error();
        under_way.push(UnderWay {
            number,
            serial: frame.serial,
            index: frame.index,
            since: Instant::now(),
            sent_ns,
            is_in_order,
        });
        self.look()
    }

    /// Copies a pixmap to the window at once.
    fn copy(&mut self, pixmap: u32, frame: &Frame<'_>) -> Result<(), SurfaceLost> {
        let extent = self.buffer_extent();
        let Timing::Clock { next, shown } = &mut self.timing else {
            return Ok(());
        };
        let (width, height) = (extent.width as u16, extent.height as u16);
        let x = &self.connection.x;
        x.copy_area(pixmap, self.window, self.gc, 0, 0, 0, 0, width, height)
            .map_err(|_| SurfaceLost)?
            .ignore_error();
        let now = Instant::now();
        *next = match frame.when {
            When::AtOnce => now,
            // Unused refreshes have passed.
            _ => (*next + REFRESH).max(now),
        };
        *shown = Some(frame.serial);
        // The server replies in order: after this reply it has copied the pixmap.
        self.look()?;
        self.pending.push(ScreenEvent::Free { index: frame.index });
        Ok(())
    }
}

impl Screen for X11Screen {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), SurfaceLost> {
        let extent = self.buffer_extent();
        let mut buffers = match self.buffers.take() {
            Some(buffers) if buffers.extent == extent => buffers,
            _ => Buffers::new(
                &self.connection,
                self.window,
                self.pixels,
                self.sharing,
                &self.pictures,
                extent,
            )?,
        };
        let pixmap = buffers.fill(&self.pictures, frame.index, self.gc)?;
        self.buffers = Some(buffers);
        match self.timing {
            Timing::Present { .. } => self.present(pixmap, frame),
            Timing::Clock { .. } => self.copy(pixmap, frame),
        }
    }

    fn wait(
        &mut self,
        deadline: Option<Instant>,
        events: &mut Vec<ScreenEvent>,
    ) -> Result<(), SurfaceLost> {
        self.collect()?;
        if self.pending.is_empty() {
            let own = match &self.timing {
                Timing::Present { under_way, .. } if under_way.is_empty() => None,
                Timing::Present { .. } => Some(self.looked + LOOK),
                Timing::Clock { next, shown } => shown.map(|_| *next),
            };
            let until = match (deadline, own) {
                (Some(deadline), Some(own)) => Some(deadline.min(own)),
                (deadline, own) => deadline.or(own),
            };
            if self.has_read && !self.is_under_way() {
                self.has_read = false;
                self.connection.wake_pollers()?;
            }
            self.wake.wait(until, None);
            self.collect()?;
        }
        match &mut self.timing {
            Timing::Present { .. } => {
                if self.is_under_way() && self.looked.elapsed() >= LOOK {
                    self.look()?;
                }
            }
            Timing::Clock { next, shown } => {
                if let Some(serial) = shown.take_if(|_| Instant::now() >= *next) {
                    let at_ns = None;
                    let out = ScreenEvent::Out { serial, at_ns };
                    self.pending.extend([out, ScreenEvent::Shown { serial }]);
                }
            }
        }
        events.append(&mut self.pending);
        Ok(())
    }

    fn refresh(&self) -> Option<Refresh> {
        match &self.timing {
            Timing::Present { estimate, .. } => estimate.refresh(),
            Timing::Clock { .. } => None,
        }
    }
}

impl Drop for X11Screen {
    fn drop(&mut self) {
        if let Timing::Present {
            events, under_way, ..
        } = &self.timing
        {
            (under_way.iter()).for_each(|frame| events.forget(frame.number));
        }
        self.buffers = None;
        if let Ok(cookie) = self.connection.x.free_gc(self.gc) {
            cookie.ignore_error();
        }
        let _ = self.connection.flush();
    }
}
