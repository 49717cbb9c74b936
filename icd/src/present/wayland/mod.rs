//! Surfaces of Wayland (`VK_KHR_wayland_surface`): images go to the compositor by `wl_shm`.
//!
//! The display and the surface are the application's. What is asked of them is answered to event
//! queues of the driver's own: one that finds `wl_shm`, for as long as the Vulkan surface lives,
//! and one a swapchain.

mod screen;

use std::ffi::c_void;
use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;
use wayland_backend::client::{Backend, ObjectId};
use wayland_client::globals::{GlobalListContents, registry_queue_init};
use wayland_client::protocol::wl_registry::{self, WlRegistry};
use wayland_client::protocol::wl_shm::{self, WlShm};
use wayland_client::{Connection, Dispatch, EventQueue, Proxy, QueueHandle};

use super::{Bell, Gone, Pictures, Window};
use crate::VkResult;

/// A surface.
pub struct WaylandWindow {
    display: *mut c_void,
    surface: *mut c_void,
    shm: Mutex<Option<Shm>>,
}

// SAFETY: displays and proxies of libwayland can be used by all threads; the pointers are only
// passed to it.
unsafe impl Send for WaylandWindow {}
// SAFETY: as above.
unsafe impl Sync for WaylandWindow {}

/// The compositor's `wl_shm`, which is bound once: it cannot be given back.
struct Shm {
    id: ObjectId,
    _queue: EventQueue<Nothing>,
    _connection: Connection,
}

/// Nobody listens.
struct Nothing;

impl Dispatch<WlRegistry, GlobalListContents> for Nothing {
    fn event(
        _: &mut Self,
        _: &WlRegistry,
        _: wl_registry::Event,
        _: &GlobalListContents,
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
    }
}

impl Dispatch<WlShm, ()> for Nothing {
    fn event(
        _: &mut Self,
        _: &WlShm,
        _: wl_shm::Event,
        (): &(),
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
    }
}

/// The display with an event queue of its own.
///
/// # Safety
/// `display` is a `wl_display *` that stays open as long as what is made of it.
unsafe fn connect(display: *mut c_void) -> Connection {
    // SAFETY: the caller's promise.
    Connection::from_backend(unsafe { Backend::from_foreign_display(display.cast()) })
}

impl WaylandWindow {
    /// A surface of the application's.
    ///
    /// # Safety
    /// `display` is a `wl_display *` and `surface` a `wl_surface *` of it, and both stay as long as
    /// the object and the screens made of it.
    pub unsafe fn new(display: *mut c_void, surface: *mut c_void) -> Self {
        Self {
            display,
            surface,
            shm: Mutex::default(),
        }
    }

    fn shm(&self) -> Result<ObjectId, Gone> {
        let mut shm = self.shm.lock();
        if let Some(shm) = &*shm {
            return Ok(shm.id.clone());
        }
        // SAFETY: the promise of `new`.
        let connection = unsafe { connect(self.display) };
        let (globals, queue) = registry_queue_init::<Nothing>(&connection).map_err(|_| Gone)?;
        let bound: WlShm = globals.bind(&queue.handle(), 1..=1, ()).map_err(|_| Gone)?;
        let id = bound.id();
        *shm = Some(Shm {
            id: id.clone(),
            _queue: queue,
            _connection: connection,
        });
        Ok(id)
    }
}

impl Window for WaylandWindow {
    fn extent(&self) -> VkResult<Option<vk::Extent2D>> {
        // A surface takes the size of what is attached to it.
        Ok(None)
    }

    fn is_presentable(&self) -> bool {
        true
    }

    fn composite_alpha(&self) -> vk::CompositeAlphaFlagsKHR {
        vk::CompositeAlphaFlagsKHR::OPAQUE | vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED
    }

    fn screen(&self, pictures: Pictures, bell: &Arc<Bell>) -> VkResult<Box<dyn super::Screen>> {
        const LOST: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;
        let shm = self.shm().map_err(|Gone| LOST)?;
        // SAFETY: the promise of `new`.
        let screen =
            unsafe { screen::WaylandScreen::new(self.display, self.surface, &shm, pictures, bell) };
        Ok(Box::new(screen.map_err(|Gone| LOST)?))
    }
}
