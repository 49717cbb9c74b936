//! Windows of X11, on the application's own connection (`VK_KHR_xcb_surface`,
//! `VK_KHR_xlib_surface`).

mod buffers;
mod connection;
mod events;
mod library;
mod screen;

use std::ffi::c_void;
use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;

pub use library::connection_of;

use super::{Pictures, WakeEvent, Window};
use crate::VkResult;
use connection::{Connection, Facts, Sharing};
use events::Events;

const LOST: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;

/// A window.
pub struct X11Window(Arc<Inner>);

struct Inner {
    connection: Arc<Connection>,
    window: u32,
    /// `None` if the window does not exist.
    facts: Option<Facts>,
    server: Mutex<Option<Server>>,
}

/// The server's capabilities for images, queried by the first swapchain.
#[derive(Clone)]
struct Server {
    /// Events of the Present extension, if the server has it.
    events: Option<Arc<Events>>,
    sharing: Sharing,
}

impl X11Window {
    /// A window on a connection of libxcb.
    ///
    /// # Errors
    /// `VK_ERROR_INITIALIZATION_FAILED` without libxcb.
    ///
    /// # Safety
    /// `connection` is an `xcb_connection_t *` that outlives the object and its screens.
    pub unsafe fn new(connection: *mut c_void, window: u32) -> VkResult<Self> {
        // SAFETY: the caller guarantees that `connection` is an `xcb_connection_t *` that outlives
        // the object and its screens.
        let connection = Arc::new(unsafe { Connection::new(connection)? });
        let facts = connection.facts(window).ok();
        Ok(Self(Arc::new(Inner {
            connection,
            window,
            facts,
            server: Mutex::default(),
        })))
    }
}

/// Whether windows with this visual can be presented to.
///
/// # Safety
/// `connection` is an open `xcb_connection_t *`.
pub unsafe fn presents_visual(connection: *mut c_void, visual: u32) -> bool {
    // SAFETY: the caller guarantees that `connection` is an open `xcb_connection_t *`.
    let connection = unsafe { Connection::new(connection) };
    connection.is_ok_and(|connection| connection.pixels(visual).is_some())
}

impl Inner {
    fn server(&self, root: u32) -> Server {
        let mut server = self.server.lock();
        server
            .get_or_insert_with(|| Server {
                events: (self.connection.has_present())
                    .then(|| {
                        Events::new(&self.connection, self.window, root)
                            .ok()
                            .map(Arc::new)
                    })
                    .flatten(),
                sharing: self.connection.sharing(),
            })
            .clone()
    }
}

impl Window for X11Window {
    fn extent(&self) -> VkResult<Option<vk::Extent2D>> {
        let extent = self.0.connection.extent(self.0.window);
        extent.map(Some).map_err(|_| LOST)
    }

    fn is_presentable(&self) -> bool {
        (self.0.facts.as_ref()).is_some_and(|facts| facts.pixels.is_some())
    }

    fn composite_alpha(&self) -> vk::CompositeAlphaFlagsKHR {
        let pixels = self.0.facts.as_ref().and_then(|facts| facts.pixels);
        let all = vk::CompositeAlphaFlagsKHR::OPAQUE | vk::CompositeAlphaFlagsKHR::INHERIT;
        match pixels {
            Some(pixels) if pixels.has_alpha => all | vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED,
            _ => all,
        }
    }

    fn reports_times(&self) -> bool {
        self.0.connection.has_present()
    }

    fn screen(
        &self,
        pictures: Pictures,
        wake: &Arc<WakeEvent>,
    ) -> VkResult<Box<dyn super::Screen>> {
        let facts = self.0.facts.as_ref().ok_or(LOST)?;
        let pixels = facts.pixels.ok_or(LOST)?;
        let server = self.0.server(facts.root);
        let screen = screen::X11Screen::new(&self.0, server, pixels, pictures, wake);
        Ok(Box::new(screen.map_err(|_| LOST)?))
    }
}
