//! Surfaces of Wayland (`VK_KHR_wayland_surface`). The compositor gets the images through `wl_shm`.
//!
//! The display and the surface belong to the application. The driver has event queues of its own:
//! one for the globals, which lives as long as the Vulkan surface, and one for each swapchain.

mod barrier;
mod screen;

use std::ffi::c_void;
use std::sync::{Arc, Weak};

use ash::vk;
use parking_lot::Mutex;
use wayland_backend::client::{Backend, ObjectId};
use wayland_client::globals::{GlobalListContents, registry_queue_init};
use wayland_client::protocol::wl_registry::{self, WlRegistry};
use wayland_client::protocol::wl_shm::WlShm;
use wayland_client::{Connection, Dispatch, EventQueue, Proxy, QueueHandle, delegate_noop};
use wayland_protocols::wp::fifo::v1::client::wp_fifo_manager_v1::WpFifoManagerV1;
use wayland_protocols::wp::presentation_time::client::wp_presentation::{self, WpPresentation};

use self::barrier::Barrier;
use super::{Pictures, SurfaceLost, WakeEvent, Window};
use crate::VkResult;
use crate::os::clock::Clock;

/// A surface.
pub struct WaylandWindow {
    display: *mut c_void,
    surface: *mut c_void,
    globals: Mutex<Option<Globals>>,
    /// One barrier serves all swapchains of the surface.
    barrier: Mutex<Weak<Barrier>>,
}

// SAFETY: libwayland's displays and proxies can be used by all threads, and the pointers are only
// passed to libwayland.
unsafe impl Send for WaylandWindow {}
// SAFETY: as for `Send`.
unsafe impl Sync for WaylandWindow {}

/// The compositor's globals for images, bound once: `wl_shm` cannot be released.
struct Globals {
    named: Named,
    _queue: EventQueue<GlobalEvents>,
    _connection: Connection,
}

#[derive(Clone)]
struct Named {
    shm: ObjectId,
    /// `wp_presentation`, if it uses the clock of Vulkan's times.
    presentation: Option<ObjectId>,
    /// `wp_fifo_manager_v1`, which makes barriers between images.
    fifo: Option<ObjectId>,
}

/// Pending events of the globals.
#[derive(Default)]
struct GlobalEvents {
    presentation_clock: Option<u32>,
}

impl Dispatch<WlRegistry, GlobalListContents> for GlobalEvents {
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

impl Dispatch<WpPresentation, ()> for GlobalEvents {
    fn event(
        pending: &mut Self,
        _: &WpPresentation,
        event: wp_presentation::Event,
        (): &(),
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
        if let wp_presentation::Event::ClockId { clk_id } = event {
            pending.presentation_clock = Some(clk_id);
        }
    }
}

delegate_noop!(GlobalEvents: ignore WlShm);
delegate_noop!(GlobalEvents: WpFifoManagerV1);

/// Wraps the application's display.
///
/// # Safety
/// `display` is a `wl_display *` that stays open as long as the objects made from it.
unsafe fn connect(display: *mut c_void) -> Connection {
    // SAFETY: the caller guarantees that `display` is a `wl_display *` that stays open as long as
    // the objects made from it.
    Connection::from_backend(unsafe { Backend::from_foreign_display(display.cast()) })
}

impl WaylandWindow {
    /// Wraps the application's surface.
    ///
    /// # Safety
    /// `display` is a `wl_display *` and `surface` a `wl_surface *` of it. Both outlive the object
    /// and its screens.
    pub unsafe fn new(display: *mut c_void, surface: *mut c_void) -> Self {
        Self {
            display,
            surface,
            globals: Mutex::default(),
            barrier: Mutex::default(),
        }
    }

    /// Binds `wl_shm`, and `wp_presentation` and `wp_fifo_manager_v1` where they are usable.
    fn globals(&self) -> Result<Named, SurfaceLost> {
        let mut known = self.globals.lock();
        if let Some(known) = &*known {
            return Ok(known.named.clone());
        }
        // SAFETY: the promise of `new`.
        let connection = unsafe { connect(self.display) };
        let (globals, mut queue) =
            registry_queue_init::<GlobalEvents>(&connection).map_err(|_| SurfaceLost)?;
        let handle = queue.handle();
        let shm: WlShm = globals.bind(&handle, 1..=1, ()).map_err(|_| SurfaceLost)?;
        let shm = shm.id();
        let mut pending = GlobalEvents::default();
        let presentation = globals
            .bind::<WpPresentation, _, _>(&handle, 1..=1, ())
            .ok();
        let presentation = match presentation {
            Some(presentation) => {
                queue.roundtrip(&mut pending).map_err(|_| SurfaceLost)?;
                let is_of_use =
                    pending.presentation_clock == Some(Clock::Monotonic.number() as u32);
                is_of_use.then(|| presentation.id())
            }
            None => None,
        };
        let fifo = globals.bind::<WpFifoManagerV1, _, _>(&handle, 1..=1, ());
        let named = Named {
            shm,
            presentation,
            fifo: fifo.ok().map(|fifo| fifo.id()),
        };
        *known = Some(Globals {
            named: named.clone(),
            _queue: queue,
            _connection: connection,
        });
        Ok(named)
    }

    /// The surface's barrier, if the compositor supports barriers.
    fn barrier(&self, fifo: Option<&ObjectId>) -> Result<Option<Arc<Barrier>>, SurfaceLost> {
        let Some(fifo) = fifo else {
            return Ok(None);
        };
        let mut known = self.barrier.lock();
        if let Some(barrier) = known.upgrade() {
            return Ok(Some(barrier));
        }
        // SAFETY: the caller of `new` keeps the display and the surface alive, and the manager
        // lives as long as the window.
        let barrier = Arc::new(unsafe { Barrier::new(self.display, self.surface, fifo)? });
        *known = Arc::downgrade(&barrier);
        Ok(Some(barrier))
    }
}

impl Window for WaylandWindow {
    fn extent(&self) -> VkResult<Option<vk::Extent2D>> {
        // A surface takes the size of the buffer attached to it.
        Ok(None)
    }

    fn is_presentable(&self) -> bool {
        true
    }

    fn composite_alpha(&self) -> vk::CompositeAlphaFlagsKHR {
        vk::CompositeAlphaFlagsKHR::OPAQUE | vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED
    }

    fn reports_times(&self) -> bool {
        self.globals()
            .is_ok_and(|named| named.presentation.is_some())
    }

    fn screen(
        &self,
        pictures: Pictures,
        wake: &Arc<WakeEvent>,
    ) -> VkResult<Box<dyn super::Screen>> {
        const LOST: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;
        let mut named = self.globals().map_err(|SurfaceLost| LOST)?;
        named.presentation = named.presentation.filter(|_| pictures.is_timed);
        let barrier = self
            .barrier(named.fifo.as_ref())
            .map_err(|SurfaceLost| LOST)?;
        // SAFETY: the promise of `new`.
        let screen = unsafe {
            let (display, surface) = (self.display, self.surface);
            screen::WaylandScreen::new(display, surface, named, barrier, pictures, wake)
        };
        Ok(Box::new(screen.map_err(|SurfaceLost| LOST)?))
    }
}
