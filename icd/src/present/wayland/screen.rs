//! The way of a swapchain's images to a surface of Wayland.

use std::collections::VecDeque;
use std::ffi::c_void;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use wayland_backend::client::{ObjectId, WaylandError};
use wayland_client::protocol::wl_buffer::{self, WlBuffer};
use wayland_client::protocol::wl_callback::{self, WlCallback};
use wayland_client::protocol::wl_shm::{self, WlShm};
use wayland_client::protocol::wl_shm_pool::{self, WlShmPool};
use wayland_client::protocol::wl_surface::WlSurface;
use wayland_client::{Connection, Dispatch, EventQueue, Proxy, QueueHandle, delegate_noop};
use wayland_protocols::wp::presentation_time::client::wp_presentation::WpPresentation;
use wayland_protocols::wp::presentation_time::client::wp_presentation_feedback::{
    self, WpPresentationFeedback,
};

use super::super::conversion::Layout;
use super::super::pixels::{self, Canvas};
use super::super::timing::{Refresh, told_ns};
use super::super::{Bell, Event, Frame, Gone, Pictures, Screen, When};
use super::Named;
use super::barrier::Barrier;
use crate::execute::query::timestamp_ns;
use crate::os::handle::BorrowedHandle;
use crate::os::window_server::SharedMemory;

/// A surface that is seen gets its frame callback sooner.
const CALLBACK_PATIENCE: Duration = Duration::from_millis(100);

pub struct WaylandScreen {
    connection: Connection,
    queue: EventQueue<Told>,
    told: Told,
    surface: WlSurface,
    shm: WlShm,
    /// Where it is asked when pictures were shown, and can be.
    presentation: Option<WpPresentation>,
    barrier: Option<Arc<Barrier>>,
    pictures: Pictures,
    bell: Arc<Bell>,
    buffers: Vec<WlBuffer>,
    /// Copies of the images, where the compositor cannot read those.
    copies: Option<SharedMemory>,
}

/// A frame that somebody wants to know the time of.
struct Sent {
    serial: u32,
    sent_ns: u64,
}

/// Events of the compositor that are not passed on yet.
#[derive(Default)]
struct Told {
    events: VecDeque<Event>,
    refresh: Option<Refresh>,
    behind_barrier: Option<BehindBarrier>,
    /// The last frame had no callback in time.
    is_hidden: bool,
}

/// A frame that the compositor takes up in its turn, whether or not somebody sees it.
struct BehindBarrier {
    serial: u32,
    since: Instant,
    /// An image was given back meanwhile: this one, by a compositor that copies pictures, or one
    /// before it.
    is_taken_up: bool,
}

impl Told {
    /// Until when a callback can tell better than the images whether a frame's turn has come.
    fn callback_deadline(&self) -> Option<Instant> {
        let frame = (self.behind_barrier.as_ref()).filter(|frame| frame.is_taken_up)?;
        let patience = match self.is_hidden {
            true => Duration::ZERO,
            false => CALLBACK_PATIENCE,
        };
        Some(frame.since + patience)
    }

    /// Counts a hidden frame as presented once it is committed.
    fn do_without_callback(&mut self) {
        let is_over = self
            .callback_deadline()
            .is_some_and(|end| Instant::now() >= end);
        if let Some(frame) = self.behind_barrier.take_if(|_| is_over) {
            self.is_hidden = true;
            let serial = frame.serial;
            self.events.push_back(Event::Shown { serial });
        }
    }
}

impl Dispatch<WlBuffer, u32> for Told {
    fn event(
        told: &mut Self,
        _: &WlBuffer,
        event: wl_buffer::Event,
        &index: &u32,
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
        if let wl_buffer::Event::Release = event {
            told.events.push_back(Event::Free { index });
            if let Some(frame) = &mut told.behind_barrier {
                frame.is_taken_up = true;
            }
        }
    }
}

impl Dispatch<WlCallback, u32> for Told {
    fn event(
        told: &mut Self,
        _: &WlCallback,
        event: wl_callback::Event,
        &serial: &u32,
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
        if let wl_callback::Event::Done { .. } = event {
            told.is_hidden = false;
            told.behind_barrier.take_if(|frame| frame.serial == serial);
            told.events.push_back(Event::Shown { serial });
        }
    }
}

impl Dispatch<WpPresentationFeedback, Sent> for Told {
    fn event(
        told: &mut Self,
        _: &WpPresentationFeedback,
        event: wp_presentation_feedback::Event,
        &Sent { serial, sent_ns }: &Sent,
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
        let at_ns = match event {
            wp_presentation_feedback::Event::Presented {
                tv_sec_hi,
                tv_sec_lo,
                tv_nsec,
                refresh,
                ..
            } => {
                let seconds = u64::from(tv_sec_hi) << 32 | u64::from(tv_sec_lo);
                let at_ns = seconds
                    .saturating_mul(1_000_000_000)
                    .saturating_add(tv_nsec.into());
                let at_ns = told_ns(at_ns, sent_ns, timestamp_ns());
                if let (Some(at_ns), period_ns @ 1..) = (at_ns, u64::from(refresh)) {
                    told.refresh = Some(Refresh { at_ns, period_ns });
                }
                at_ns
            }
            wp_presentation_feedback::Event::Discarded => None,
            _ => return,
        };
        told.events.push_back(Event::Out { serial, at_ns });
    }
}

// Its compositor refuses requests that are wrong; none is made.
delegate_noop!(Told: ignore WpPresentation);

impl Dispatch<WlShmPool, ()> for Told {
    fn event(
        _: &mut Self,
        _: &WlShmPool,
        _: wl_shm_pool::Event,
        (): &(),
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
    }
}

impl WaylandScreen {
    /// A way for these pictures.
    ///
    /// # Errors
    /// The connection has gone.
    ///
    /// # Safety
    /// `display` and `surface` are as in [`WaylandWindow::new`](super::WaylandWindow::new); what is
    /// named lives as long.
    pub unsafe fn new(
        display: *mut c_void,
        surface: *mut c_void,
        named: Named,
        barrier: Option<Arc<Barrier>>,
        pictures: Pictures,
        bell: &Arc<Bell>,
    ) -> Result<Self, Gone> {
        // SAFETY: the caller's promise.
        let (connection, surface, shm, presentation) = unsafe {
            let connection = super::connect(display);
            let surface = ObjectId::from_ptr(WlSurface::interface(), surface.cast());
            let shm = ObjectId::from_ptr(WlShm::interface(), named.shm.as_ptr());
            let presentation = (named.presentation)
                .map(|id| ObjectId::from_ptr(WpPresentation::interface(), id.as_ptr()));
            (
                connection,
                surface.map_err(|_| Gone)?,
                shm.map_err(|_| Gone)?,
                presentation.transpose().map_err(|_| Gone)?,
            )
        };
        let surface = WlSurface::from_id(&connection, surface).map_err(|_| Gone)?;
        let shm = WlShm::from_id(&connection, shm).map_err(|_| Gone)?;
        let presentation = presentation
            .map(|id| WpPresentation::from_id(&connection, id))
            .transpose()
            .map_err(|_| Gone)?;
        let queue = connection.new_event_queue();
        Ok(Self {
            connection,
            queue,
            told: Told::default(),
            surface,
            shm,
            presentation,
            barrier,
            pictures,
            bell: Arc::clone(bell),
            buffers: Vec::new(),
            copies: None,
        })
    }

    /// Buffers in the images themselves, or copies of them.
    fn make_buffers(&mut self) -> Result<(), Gone> {
        let picture = self.pictures.picture(0);
        let count = self.pictures.images.len() as u32;
        if Layout::Argb8888.is_that_of(picture.format)
            && let Ok(file) = self.pictures.memory.export()
        {
            let stride = picture.row_stride_bytes;
            let offset = |index| self.pictures.offset_bytes(index);
            let size = self.pictures.memory.size_bytes;
            self.buffers = self.pool(file.borrow(), size, stride, count, offset)?;
            return Ok(());
        }
        let stride = self.extent().width as usize * Layout::Argb8888.bytes();
        let each = stride * self.extent().height as usize;
        let size = each.checked_mul(count as usize).ok_or(Gone)?;
        let memory = SharedMemory::file(size).ok_or(Gone)?;
        let file = memory.handle().ok_or(Gone)?;
        let offset = |index| u64::from(index) * each as u64;
        self.buffers = self.pool(file.borrow(), size as u64, stride, count, offset)?;
        self.copies = Some(memory);
        Ok(())
    }

    fn extent(&self) -> vk::Extent2D {
        self.pictures.extent()
    }

    fn pool(
        &self,
        file: BorrowedHandle<'_>,
        size_bytes: u64,
        stride: usize,
        count: u32,
        offset: impl Fn(u32) -> u64,
    ) -> Result<Vec<WlBuffer>, Gone> {
        // The protocol counts in 31 bits.
        let whole = |bytes: u64| i32::try_from(bytes).map_err(|_| Gone);
        let format = match self.pictures.composite_alpha {
            vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED => wl_shm::Format::Argb8888,
            _ => wl_shm::Format::Xrgb8888,
        };
        let handle = self.queue.handle();
        let pool = self.shm.create_pool(file, whole(size_bytes)?, &handle, ());
        let (width, height) = (self.extent().width as i32, self.extent().height as i32);
        let stride = whole(stride as u64)?;
        let buffers = (0..count).map(|index| {
            let offset = whole(offset(index))?;
            Ok(pool.create_buffer(offset, width, height, stride, format, &handle, index))
        });
        let buffers = buffers.collect();
        pool.destroy();
        buffers
    }

    /// Fills an image's copy, if it is shown by one.
    fn copy(&mut self, index: u32) {
        let picture = self.pictures.picture(index);
        let Some(memory) = &mut self.copies else {
            return;
        };
        let extent = picture.extent;
        let row_stride_bytes = extent.width as usize * Layout::Argb8888.bytes();
        let each = row_stride_bytes * extent.height as usize;
        let mut canvas = Canvas {
            pixels: &mut memory.bytes()[index as usize * each..][..each],
            row_stride_bytes,
            extent,
            layout: Layout::Argb8888,
            is_opaque: false,
        };
        let placement = pixels::Placement::one_to_one(extent, extent);
        // SAFETY: the images' memory lives as long as `pictures`.
        unsafe { pixels::draw(&picture, &placement, &mut canvas) };
    }

    fn flush(&self) -> Result<(), Gone> {
        match self.connection.flush() {
            Ok(()) => Ok(()),
            // The compositor reads slowly; what is left goes with the next.
            Err(WaylandError::Io(error)) if error.kind() == std::io::ErrorKind::WouldBlock => {
                Ok(())
            }
            Err(_) => Err(Gone),
        }
    }

    fn dispatch(&mut self) -> Result<(), Gone> {
        self.queue
            .dispatch_pending(&mut self.told)
            .map_err(|_| Gone)?;
        Ok(())
    }
}

impl Screen for WaylandScreen {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), Gone> {
        if self.buffers.is_empty() {
            self.make_buffers()?;
        }
        self.copy(frame.index);
        self.surface
            .attach(Some(&self.buffers[frame.index as usize]), 0, 0);
        if frame.damage.is_empty() || self.surface.version() < 4 {
            // In the surface's units, whatever these are: all of it.
            self.surface.damage(0, 0, i32::MAX, i32::MAX);
        } else {
            for rectangle in frame.damage {
                let (width, height) = (rectangle.extent.width, rectangle.extent.height);
                let (width, height) = (width.min(i32::MAX as u32), height.min(i32::MAX as u32));
                let (x, y) = (rectangle.offset.x, rectangle.offset.y);
                self.surface
                    .damage_buffer(x, y, width as i32, height as i32);
            }
        }
        self.told.behind_barrier = None;
        match frame.when {
            // The compositor shows what was committed last.
            When::AtOnce | When::Replaceable => self.told.events.push_back(Event::Shown {
                serial: frame.serial,
            }),
            _ => {
                self.surface.frame(&self.queue.handle(), frame.serial);
                if let Some(barrier) = &self.barrier {
                    barrier.keep();
                    self.told.behind_barrier = Some(BehindBarrier {
                        serial: frame.serial,
                        since: Instant::now(),
                        is_taken_up: false,
                    });
                }
            }
        }
        let serial = frame.serial;
        match &self.presentation {
            Some(presentation) => {
                let sent_ns = timestamp_ns();
                let sent = Sent { serial, sent_ns };
                presentation.feedback(&self.surface, &self.queue.handle(), sent);
            }
            None => self.told.events.push_back(Event::Out {
                serial,
                at_ns: None,
            }),
        }
        self.surface.commit();
        self.flush()
    }

    fn wait(&mut self, deadline: Option<Instant>, events: &mut Vec<Event>) -> Result<(), Gone> {
        self.dispatch()?;
        self.told.do_without_callback();
        if self.told.events.is_empty() {
            self.flush()?;
            let ends = [deadline, self.told.callback_deadline()];
            let deadline = ends.into_iter().flatten().min();
            // Without a guard there is something to dispatch.
            if let Some(guard) = self.queue.prepare_read() {
                let connection = guard.connection_fd();
                if self.bell.wait(deadline, Some(connection)) {
                    match guard.read() {
                        Ok(_) => {}
                        Err(WaylandError::Io(error))
                            if error.kind() == std::io::ErrorKind::WouldBlock => {}
                        Err(_) => return Err(Gone),
                    }
                }
            }
            self.dispatch()?;
            self.told.do_without_callback();
        }
        events.extend(self.told.events.drain(..));
        Ok(())
    }

    fn refresh(&self) -> Option<Refresh> {
        self.told.refresh
    }
}

impl Drop for WaylandScreen {
    fn drop(&mut self) {
        for buffer in &self.buffers {
            buffer.destroy();
        }
        let _ = self.flush();
    }
}
