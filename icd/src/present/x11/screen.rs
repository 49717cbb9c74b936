//! The way of a swapchain's images to a window of X11.
//!
//! Where the server has the Present extension, it copies each pixmap at a refresh and says when it
//! has. Elsewhere pixmaps are copied at once, and this side keeps the time.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ash::vk;
use x11rb::protocol::present::{ConnectionExt as _, Option as PresentOption};
use x11rb::protocol::xproto::{ConnectionExt as _, CreateGCAux};

use super::super::timing::{Refresh, Rhythm, told_ns};
use super::super::{Bell, Event, Frame, Gone, Pictures, Screen, When};
use super::buffers::Buffers;
use super::connection::{Connection, Pixels, Sharing};
use super::events::{Events, Inbox};
use super::{Inner, Server};
use crate::execute::query::timestamp_ns;

/// Between refreshes, where no server says when they are.
const REFRESH: Duration = Duration::from_nanos(16_666_667);
/// How often a window whose server is silent is looked for.
const LOOK: Duration = Duration::from_millis(100);
/// A frame that the server has forgotten: windows that come and go take their frames along.
const FORGOTTEN: Duration = Duration::from_secs(3);

pub struct X11Screen {
    connection: Arc<Connection>,
    window: u32,
    pixels: Pixels,
    sharing: Sharing,
    pictures: Pictures,
    bell: Arc<Bell>,
    gc: u32,
    buffers: Option<Buffers>,
    /// The window's, when it was last looked at.
    extent: vk::Extent2D,
    timing: Timing,
    looked: Instant,
    /// Answers were read since who polls the connection was last woken.
    has_read: bool,
    /// To be told by the next wait.
    news: Vec<Event>,
}

/// Who knows when a frame is shown.
enum Timing {
    /// The server.
    Present {
        events: Arc<Events>,
        inbox: Arc<Inbox>,
        under_way: Vec<UnderWay>,
        last_msc: u64,
        rhythm: Rhythm,
    },
    /// The clock: when the next refresh would be, and whose turn it is then.
    Clock { next: Instant, shown: Option<u32> },
}

/// A frame that the server has.
struct UnderWay {
    /// The server's name for it, and the swapchain's.
    number: u32,
    serial: u32,
    index: u32,
    since: Instant,
    sent_ns: u64,
    /// The server shows it behind all that it had before.
    is_in_order: bool,
}

impl UnderWay {
    fn is_over(&self, at_ns: Option<u64>) -> [Event; 3] {
        let (index, serial) = (self.index, self.serial);
        let out = Event::Out { serial, at_ns };
        [Event::Free { index }, out, Event::Shown { serial }]
    }
}

impl X11Screen {
    /// A way for these pictures.
    ///
    /// # Errors
    /// The window or its connection has gone.
    pub(super) fn new(
        window: &Arc<Inner>,
        server: Server,
        pixels: Pixels,
        pictures: Pictures,
        bell: &Arc<Bell>,
    ) -> Result<Self, Gone> {
        let connection = Arc::clone(&window.connection);
        let gc = connection.id()?;
        // Copies from pixmaps make no events.
        let look = CreateGCAux::new().graphics_exposures(0);
        let made = connection.x.create_gc(gc, window.window, &look);
        made.map_err(|_| Gone)?.ignore_error();
        let timing = match server.events {
            Some(events) => Timing::Present {
                inbox: events.inbox(bell),
                events,
                under_way: Vec::new(),
                last_msc: 0,
                rhythm: Rhythm::default(),
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
            bell: Arc::clone(bell),
            gc,
            buffers: None,
            timing,
            looked: Instant::now(),
            has_read: false,
            news: Vec::new(),
            connection,
        })
    }

    /// The extent of pixmaps.
    fn buffer_extent(&self) -> vk::Extent2D {
        match self.pictures.scaling.is_asked_for() {
            true => self.extent,
            false => self.pictures.extent(),
        }
    }

    /// Whether the server has frames, and its answers about them are read.
    fn is_under_way(&self) -> bool {
        matches!(&self.timing, Timing::Present { under_way, .. } if !under_way.is_empty())
    }

    /// Looks whether the window is still there, and how large it is.
    fn look(&mut self) -> Result<(), Gone> {
        self.looked = Instant::now();
        self.has_read = true;
        self.extent = self.connection.extent(self.window)?;
        self.news.push(Event::Extent(self.extent));
        Ok(())
    }

    /// Collects pending events of the server.
    fn collect(&mut self) -> Result<(), Gone> {
        let Timing::Present {
            events,
            inbox,
            under_way,
            last_msc,
            rhythm,
        } = &mut self.timing
        else {
            return Ok(());
        };
        if inbox.is_broken.load(Ordering::Acquire) {
            return Err(Gone);
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
            let at_ns = told_ns(shown_ns, frame.sent_ns, timestamp_ns());
            if at_ns.is_some() {
                rhythm.note(shown_ns, completed.msc);
            }
            // Pixmaps are copied (`PresentOptionCopy`): who has had its turn is not read any more.
            self.news.extend(frame.is_over(at_ns));
        }
        let forgotten = under_way.extract_if(.., |frame| frame.since.elapsed() > FORGOTTEN);
        for frame in forgotten {
            self.news.extend(frame.is_over(None));
            events.forget(frame.number);
        }
        Ok(())
    }
}

impl Screen for X11Screen {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), Gone> {
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
        let x = &self.connection.x;
        match &mut self.timing {
            Timing::Present {
                events,
                under_way,
                last_msc,
                ..
            } => {
                // Frames of the swapchain before may wait for their refresh. They come first.
                let is_own = |number| under_way.iter().any(|frame| frame.number == number);
                let when = match events.has_others(is_own) {
                    true => When::NextRefresh,
                    false => frame.when,
                };
                let number = events.begin()?;
                let sent_ns = timestamp_ns();
                let (options, target_msc) = match when {
                    When::NextRefresh | When::Replaceable => (PresentOption::COPY, 0),
                    When::NextRefreshOrLate => {
                        (PresentOption::COPY | PresentOption::ASYNC, *last_msc + 1)
                    }
                    When::AtOnce => (PresentOption::COPY | PresentOption::ASYNC, 0),
                };
                let is_in_order = !options.contains(PresentOption::ASYNC);
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
                    // Servers up to 21.1 crash where other windows are to be told.
                    &[],
                )
                .map_err(|_| Gone)?
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
            Timing::Clock { next, shown } => {
                let (width, height) = (extent.width as u16, extent.height as u16);
                x.copy_area(pixmap, self.window, self.gc, 0, 0, 0, 0, width, height)
                    .map_err(|_| Gone)?
                    .ignore_error();
                let now = Instant::now();
                *next = match frame.when {
                    When::AtOnce => now,
                    // Refreshes that nothing was shown in are past.
                    _ => (*next + REFRESH).max(now),
                };
                *shown = Some(frame.serial);
                // The server answers in order: after this it has copied.
                self.look()?;
                self.news.push(Event::Free { index: frame.index });
                Ok(())
            }
        }
    }

    fn wait(&mut self, deadline: Option<Instant>, events: &mut Vec<Event>) -> Result<(), Gone> {
        self.collect()?;
        if self.news.is_empty() {
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
            self.bell.wait(until, None);
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
                    let out = Event::Out { serial, at_ns };
                    self.news.extend([out, Event::Shown { serial }]);
                }
            }
        }
        events.append(&mut self.news);
        Ok(())
    }

    fn refresh(&self) -> Option<Refresh> {
        match &self.timing {
            Timing::Present { rhythm, .. } => rhythm.refresh(),
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
