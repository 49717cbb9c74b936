//! Surfaces of Wayland (`VK_KHR_wayland_surface`): images go to the compositor by `wl_shm`.
//!
//! The display and the surface are the application's. What is asked of them is answered to event
//! queues of the driver's own: one that finds `wl_shm`, for as long as the Vulkan surface lives,
//! and one a swapchain.

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
use super::{Bell, Gone, Pictures, Window};
use crate::VkResult;
use crate::os::clock::Clock;

/// A surface.
pub struct WaylandWindow {
    display: *mut c_void,
    surface: *mut c_void,
    globals: Mutex<Option<Globals>>,
    /// A surface has one, whichever of its swapchains are alive.
    barrier: Mutex<Weak<Barrier>>,
}

// SAFETY: displays and proxies of libwayland can be used by all threads; the pointers are only
// passed to it.
unsafe impl Send for WaylandWindow {}
// SAFETY: as above.
unsafe impl Sync for WaylandWindow {}

/// The compositor's globals for images, bound once: `wl_shm` cannot be released.
struct Globals {
    named: Named,
    _queue: EventQueue<Told>,
    _connection: Connection,
}

#[derive(Clone)]
struct Named {
    shm: ObjectId,
    /// Tells when pictures were shown, by the clock of Vulkan's times.
    presentation: Option<ObjectId>,
    /// Makes barriers between a surface's pictures.
    fifo: Option<ObjectId>,
}

/// Pending events of the globals.
#[derive(Default)]
struct Told {
    presentation_clock: Option<u32>,
}

impl Dispatch<WlRegistry, GlobalListContents> for Told {
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

impl Dispatch<WpPresentation, ()> for Told {
    fn event(
        told: &mut Self,
        _: &WpPresentation,
        event: wp_presentation::Event,
        (): &(),
        _: &Connection,
        _: &QueueHandle<Self>,
    ) {
        if let wp_presentation::Event::ClockId { clk_id } = event {
            told.presentation_clock = Some(clk_id);
        }
    }
}

delegate_noop!(Told: ignore WlShm);
delegate_noop!(Told: WpFifoManagerV1);

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
            globals: Mutex::default(),
            barrier: Mutex::default(),
        }
    }

    /// `wl_shm`, `wp_presentation` if it is of use, and what makes barriers, if there is one.
    fn globals(&self) -> Result<Named, Gone> {
        let mut known = self.globals.lock();
        if let Some(known) = &*known {
            return Ok(known.named.clone());
        }
        // SAFETY: the promise of `new`.
        let connection = unsafe { connect(self.display) };
        let (globals, mut queue) = registry_queue_init::<Told>(&connection).map_err(|_| Gone)?;
        let handle = queue.handle();
        let shm: WlShm = globals.bind(&handle, 1..=1, ()).map_err(|_| Gone)?;
        let shm = shm.id();
        let mut told = Told::default();
        let presentation = globals
            .bind::<WpPresentation, _, _>(&handle, 1..=1, ())
            .ok();
        let presentation = match presentation {
            Some(presentation) => {
                queue.roundtrip(&mut told).map_err(|_| Gone)?;
                let is_of_use = told.presentation_clock == Some(Clock::Monotonic.number() as u32);
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

    /// The surface's barrier, where the compositor has such.
    fn barrier(&self, fifo: Option<&ObjectId>) -> Result<Option<Arc<Barrier>>, Gone> {
        let Some(fifo) = fifo else {
            return Ok(None);
        };
        let mut known = self.barrier.lock();
        if let Some(barrier) = known.upgrade() {
            return Ok(Some(barrier));
        }
        // SAFETY: the promise of `new`, and the manager lives as long as the window.
        let barrier = Arc::new(unsafe { Barrier::new(self.display, self.surface, fifo)? });
        *known = Arc::downgrade(&barrier);
        Ok(Some(barrier))
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

    fn tells_times(&self) -> bool {
        self.globals()
            .is_ok_and(|named| named.presentation.is_some())
    }

    fn screen(&self, pictures: Pictures, bell: &Arc<Bell>) -> VkResult<Box<dyn super::Screen>> {
        const LOST: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;
        let mut named = self.globals().map_err(|Gone| LOST)?;
        named.presentation = named.presentation.filter(|_| pictures.is_timed);
        let barrier = self.barrier(named.fifo.as_ref()).map_err(|Gone| LOST)?;
        // SAFETY: the promise of `new`.
        let screen = unsafe {
            let (display, surface) = (self.display, self.surface);
            screen::WaylandScreen::new(display, surface, named, barrier, pictures, bell)
        };
        Ok(Box::new(screen.map_err(|Gone| LOST)?))
    }
}
