//! The barrier between images of a surface (`wp_fifo_v1`): the compositor commits an image after
//! the last one was shown for a refresh. For a hidden surface it commits at a rate of its own and
//! sends no frame callbacks.

use std::ffi::c_void;

use wayland_backend::client::ObjectId;
use wayland_client::protocol::wl_surface::WlSurface;
use wayland_client::{Connection, EventQueue, Proxy, delegate_noop};
use wayland_protocols::wp::fifo::v1::client::wp_fifo_manager_v1::WpFifoManagerV1;
use wayland_protocols::wp::fifo::v1::client::wp_fifo_v1::WpFifoV1;

use super::super::SurfaceLost;

pub struct Barrier {
    fifo: WpFifoV1,
    /// The connection of the barrier's objects, which must live as long.
    connection: Connection,
    _queue: EventQueue<Silent>,
}

/// The events of barriers: there are none.
struct Silent;

delegate_noop!(Silent: WpFifoV1);

impl Barrier {
    /// Creates the barrier of a surface that has none.
    ///
    /// # Errors
    /// The connection is lost.
    ///
    /// # Safety
    /// `display` and `surface` are as in [`WaylandWindow::new`](super::WaylandWindow::new);
    /// `manager` lives as long.
    pub unsafe fn new(
        display: *mut c_void,
        surface: *mut c_void,
        manager: &ObjectId,
    ) -> Result<Self, SurfaceLost> {
        // SAFETY: the caller keeps the display, the surface and the manager alive.
        let (connection, surface, manager) = unsafe {
            (
                super::connect(display),
                ObjectId::from_ptr(WlSurface::interface(), surface.cast()),
                ObjectId::from_ptr(WpFifoManagerV1::interface(), manager.as_ptr()),
            )
        };
        let (surface, manager) = (
            surface.map_err(|_| SurfaceLost)?,
            manager.map_err(|_| SurfaceLost)?,
        );
        let surface = WlSurface::from_id(&connection, surface).map_err(|_| SurfaceLost)?;
        let manager = WpFifoManagerV1::from_id(&connection, manager).map_err(|_| SurfaceLost)?;
        let queue = connection.new_event_queue();
        Ok(Self {
            fifo: manager.get_fifo(&surface, &queue.handle(), ()),
            connection,
            _queue: queue,
        })
    }

    /// The next commit waits for the barrier that the last commit set, and sets it again.
    pub fn keep(&self) {
        self.fifo.wait_barrier();
        self.fifo.set_barrier();
    }
}

impl Drop for Barrier {
    fn drop(&mut self) {
        self.fifo.destroy();
        let _ = self.connection.flush();
    }
}
