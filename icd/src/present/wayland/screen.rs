//! Presents a swapchain's images to a Wayland surface.

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
use super::super::timing::{Refresh, server_time_ns};
use super::super::{Frame, Pictures, Screen, ScreenEvent, SurfaceLost, WakeEvent, When};
use super::Named;
use super::barrier::Barrier;
use crate::execute::query::timestamp_ns;
use crate::os::handle::BorrowedHandle;
use crate::os::window_server::SharedMemory;

/// The time within which a visible surface gets its frame callback.
const CALLBACK_PATIENCE: Duration = Duration::from_millis(100);

pub struct WaylandScreen {
    connection: Connection,
    queue: EventQueue<ScreenEvents>,
    pending: ScreenEvents,
    surface: WlSurface,
    shm: WlShm,
    /// Reports when images were shown, if the compositor can and the application asks.
    presentation: Option<WpPresentation>,
    barrier: Option<Arc<Barrier>>,
    pictures: Pictures,
    wake: Arc<WakeEvent>,
    buffers: Vec<WlBuffer>,
    /// Copies of the images, if the compositor cannot read the images themselves.
    copies: Option<SharedMemory>,
}

/// A frame with pending presentation feedback.
struct Sent {
    serial: u32,
    sent_ns: u64,
}

/// Events of the compositor that [`Screen::wait`] has not returned yet.
#[derive(Default)]
struct ScreenEvents {
    events: VecDeque<ScreenEvent>,
    refresh: Option<Refresh>,
    behind_barrier: Option<BehindBarrier>,
    /// The last frame got no callback in time.
    is_hidden: bool,
}

/// A frame behind a barrier, which the compositor commits in order even for a hidden surface.
struct BehindBarrier {
    serial: u32,
    since: Instant,
    /// A buffer was released since: this frame's, by a compositor that copies, or that of a frame
    /// before.
    is_taken_up: bool,
}

impl ScreenEvents {
    /// The time until which to wait for a callback once the frame is committed.
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
            self.events.push_back(ScreenEvent::Shown { serial });
        }
    }
}

impl Dispatch<WlBuffer, u32> for ScreenEvents {
    fn event(
        pending: &mut Self,
        _: &WlBuffer,
        event: wl_buffer::Event,
        &index: &u32,
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
        if let wl_buffer::Event::Release = event {
            pending.events.push_back(ScreenEvent::Free { index });
            if let Some(frame) = &mut pending.behind_barrier {
                frame.is_taken_up = true;
            }
        }
    }
}

impl Dispatch<WlCallback, u32> for ScreenEvents {
    fn event(
        pending: &mut Self,
        _: &WlCallback,
        event: wl_callback::Event,
        &serial: &u32,
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
        if let wl_callback::Event::Done { .. } = event {
            pending.is_hidden = false;
            pending
                .behind_barrier
                .take_if(|frame| frame.serial == serial);
            pending.events.push_back(ScreenEvent::Shown { serial });
        }
    }
}

impl Dispatch<WpPresentationFeedback, Sent> for ScreenEvents {
    fn event(
        pending: &mut Self,
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
                let at_ns = server_time_ns(at_ns, sent_ns, timestamp_ns());
                if let (Some(at_ns), period_ns @ 1..) = (at_ns, u64::from(refresh)) {
                    pending.refresh = Some(Refresh { at_ns, period_ns });
                }
                at_ns
            }
            wp_presentation_feedback::Event::Discarded => None,
            _ => return,
        };
        pending.events.push_back(ScreenEvent::Out { serial, at_ns });
    }
}

// The interface's only event reports the clock, which the globals have read.
delegate_noop!(ScreenEvents: ignore WpPresentation);

impl Dispatch<WlShmPool, ()> for ScreenEvents {
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
    /// Creates the screen of a swapchain's images.
    ///
    /// # Errors
    /// The connection is lost.
    ///
    /// # Safety
    /// `display` and `surface` are as in [`WaylandWindow::new`](super::WaylandWindow::new); the
    /// named objects live as long.
    pub unsafe fn new(
        display: *mut c_void,
        surface: *mut c_void,
        named: Named,
        barrier: Option<Arc<Barrier>>,
        pictures: Pictures,
        wake: &Arc<WakeEvent>,
    ) -> Result<Self, SurfaceLost> {
        // SAFETY: the caller keeps the display, the surface and the named objects alive.
        let (connection, surface, shm, presentation) = unsafe {
            let connection = super::connect(display);
            let surface = ObjectId::from_ptr(WlSurface::interface(), surface.cast());
            let shm = ObjectId::from_ptr(WlShm::interface(), named.shm.as_ptr());
            let presentation = (named.presentation)
                .map(|id| ObjectId::from_ptr(WpPresentation::interface(), id.as_ptr()));
            (
                connection,
                surface.map_err(|_| SurfaceLost)?,
                shm.map_err(|_| SurfaceLost)?,
                presentation.transpose().map_err(|_| SurfaceLost)?,
            )
        };
        let surface = WlSurface::from_id(&connection, surface).map_err(|_| SurfaceLost)?;
        let shm = WlShm::from_id(&connection, shm).map_err(|_| SurfaceLost)?;
        let presentation = presentation
            .map(|id| WpPresentation::from_id(&connection, id))
            .transpose()
            .map_err(|_| SurfaceLost)?;
        let queue = connection.new_event_queue();
        Ok(Self {
            connection,
            queue,
            pending: ScreenEvents::default(),
            surface,
            shm,
            presentation,
            barrier,
            pictures,
            wake: Arc::clone(wake),
            buffers: Vec::new(),
            copies: None,
        })
    }

    /// Creates buffers in the images' memory, or in copies of the images.
    fn make_buffers(&mut self) -> Result<(), SurfaceLost> {
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
        let size = each.checked_mul(count as usize).ok_or(SurfaceLost)?;
        let memory = SharedMemory::file(size).ok_or(SurfaceLost)?;
        let file = memory.handle().ok_or(SurfaceLost)?;
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
    ) -> Result<Vec<WlBuffer>, SurfaceLost> {
        // The protocol's sizes have 31 bits.
        let whole = |bytes: u64| i32::try_from(bytes).map_err(|_| SurfaceLost);
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

    /// Fills an image's copy, if there are copies.
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

    fn flush(&self) -> Result<(), SurfaceLost> {
        match self.connection.flush() {
            Ok(()) => Ok(()),
            // The socket is full: the next flush sends the rest.
            Err(WaylandError::Io(error)) if error.kind() == std::io::ErrorKind::WouldBlock => {
                Ok(())
            }
            Err(_) => Err(SurfaceLost),
        }
    }

    fn dispatch(&mut self) -> Result<(), SurfaceLost> {
        self.queue
            .dispatch_pending(&mut self.pending)
            .map_err(|_| SurfaceLost)?;
        Ok(())
    }
}

impl Screen for WaylandScreen {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), SurfaceLost> {
        if self.buffers.is_empty() {
            self.make_buffers()?;
        }
        self.copy(frame.index);
        self.surface
            .attach(Some(&self.buffers[frame.index as usize]), 0, 0);
        if frame.damage.is_empty() || self.surface.version() < 4 {
            // Damage in surface units: all of the surface.
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
        self.pending.behind_barrier = None;
        match frame.when {
            // The compositor shows the last committed image.
            When::AtOnce | When::Replaceable => self.pending.events.push_back(ScreenEvent::Shown {
                serial: frame.serial,
            }),
            _ => {
                self.surface.frame(&self.queue.handle(), frame.serial);
                if let Some(barrier) = &self.barrier {
                    barrier.keep();
                    self.pending.behind_barrier = Some(BehindBarrier {
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
            None => self.pending.events.push_back(ScreenEvent::Out {
                serial,
                at_ns: None,
            }),
        }
        self.surface.commit();
        self.flush()
    }

    fn wait(
        &mut self,
        deadline: Option<Instant>,
        events: &mut Vec<ScreenEvent>,
    ) -> Result<(), SurfaceLost> {
        self.dispatch()?;
        self.pending.do_without_callback();
        if self.pending.events.is_empty() {
            self.flush()?;
            let ends = [deadline, self.pending.callback_deadline()];
            let deadline = ends.into_iter().flatten().min();
            // Without a guard there are events to dispatch.
            if let Some(guard) = self.queue.prepare_read() {
                let connection = guard.connection_fd();
                if self.wake.wait(deadline, Some(connection)) {
                    match guard.read() {
                        Ok(_) => {}
                        Err(WaylandError::Io(error))
                            if error.kind() == std::io::ErrorKind::WouldBlock => {}
                        Err(_) => return Err(SurfaceLost),
                    }
                }
            }
            self.dispatch()?;
            self.pending.do_without_callback();
        }
        events.extend(self.pending.events.drain(..));
        Ok(())
    }

    fn refresh(&self) -> Option<Refresh> {
        self.pending.refresh
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
