//! A compositor of Wayland for one client: it reads what is attached, and misbehaves where a test
//! wants it to.

use std::collections::VecDeque;
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ash::{khr, vk};
use wayland_client::Proxy as _;
use wayland_protocols::wp::fifo::v1::server::wp_fifo_manager_v1::{self, WpFifoManagerV1};
use wayland_protocols::wp::fifo::v1::server::wp_fifo_v1::{self, WpFifoV1};
use wayland_protocols::wp::presentation_time::server::wp_presentation::{self, WpPresentation};
use wayland_protocols::wp::presentation_time::server::wp_presentation_feedback::{
    self, WpPresentationFeedback,
};
use wayland_server::backend::ClientData;
use wayland_server::protocol::wl_buffer::{self, WlBuffer};
use wayland_server::protocol::wl_callback::WlCallback;
use wayland_server::protocol::wl_compositor::{self, WlCompositor};
use wayland_server::protocol::wl_region::{self, WlRegion};
use wayland_server::protocol::wl_shm::{self, WlShm};
use wayland_server::protocol::wl_shm_pool::{self, WlShmPool};
use wayland_server::protocol::wl_surface::{self, WlSurface};
use wayland_server::{
    Client, DataInit, Dispatch, Display, DisplayHandle, GlobalDispatch, New, Resource,
};

use crate::{Presenter, comes};

/// Between refreshes.
const REFRESH: Duration = Duration::from_micros(16_667);

/// The compositor's faults, and its observations.
#[derive(Default)]
pub struct Manners {
    /// Shown frames are not reported, as for a hidden window.
    pub hides: AtomicBool,
    /// Buffers are given back this many commits later than they could be.
    pub late_releases: AtomicUsize,
    /// The connection breaks.
    pub dies: AtomicBool,
    /// Commits that came to the screen so far, and the last one's pixels.
    pub commits: AtomicUsize,
    /// How many of them waited for a barrier if there was one, and how many barriers the surface
    /// has: one at most.
    pub waited: AtomicUsize,
    pub barriers: AtomicUsize,
    pub shown: Mutex<ScreenContents>,
    /// When frames were shown that were asked about, in nanoseconds of `CLOCK_MONOTONIC`.
    pub presented: Mutex<Vec<u64>>,
}

/// The contents of the screen: rows of blue, green, red, alpha.
#[derive(Clone, Default)]
pub struct ScreenContents {
    pub width: usize,
    pub height: usize,
    pub has_alpha: bool,
    pub pixels: Vec<u8>,
}

/// The compositor's thread, and a client of it with a surface.
pub struct Compositor {
    pub manners: Arc<Manners>,
    thread: Option<JoinHandle<()>>,
    is_over: Arc<AtomicBool>,
    client: wayland_client::Connection,
    _queue: wayland_client::EventQueue<Application>,
    surface: wayland_client::protocol::wl_surface::WlSurface,
}

/// A pool's file.
struct Pool(Arc<OwnedFd>);

/// A part of a pool's file.
#[derive(Clone)]
struct Part {
    file: Arc<OwnedFd>,
    offset: usize,
    width: usize,
    height: usize,
    stride: usize,
    has_alpha: bool,
}

/// The changes of a commit.
#[derive(Default)]
struct Update {
    attached: Option<WlBuffer>,
    callbacks: Vec<WlCallback>,
    asked: Vec<WpPresentationFeedback>,
    waits: bool,
    sets: bool,
}

/// The optional interfaces of a compositor.
#[derive(Clone, Copy, Default)]
pub struct Offers {
    /// It can tell when frames are shown.
    pub times: bool,
    /// It keeps barriers between frames.
    pub barriers: bool,
}

struct CompositorState {
    manners: Arc<Manners>,
    /// The uncommitted changes.
    pending: Update,
    /// The changes that wait for the barrier, the oldest first.
    queued: VecDeque<Update>,
    has_barrier: bool,
    /// Callbacks of the committed state.
    due: Vec<WlCallback>,
    /// Buffers that were replaced, the oldest first.
    replaced: Vec<WlBuffer>,
    current: Option<WlBuffer>,
    /// Callbacks of a frame that is not yet shown.
    promised: Vec<WpPresentationFeedback>,
}

struct Quiet;
impl ClientData for Quiet {}

impl Compositor {
    /// Starts one.
    pub fn start() -> Compositor {
        Self::start_with(Offers {
            times: true,
            ..Offers::default()
        })
    }

    /// Starts one that offers no more than this.
    pub fn start_with(offers: Offers) -> Compositor {
        let manners = Arc::new(Manners::default());
        let is_over = Arc::new(AtomicBool::new(false));
        let (ours, theirs) = UnixStream::pair().unwrap();
        let (seen, over) = (Arc::clone(&manners), Arc::clone(&is_over));
        let thread = std::thread::spawn(move || compose(theirs, seen, &over, offers));
        let backend = wayland_client::backend::Backend::connect(ours).unwrap();
        let client = wayland_client::Connection::from_backend(backend);
        let (globals, queue) =
            wayland_client::globals::registry_queue_init::<Application>(&client).unwrap();
        let compositor: wayland_client::protocol::wl_compositor::WlCompositor =
            globals.bind(&queue.handle(), 4..=4, ()).unwrap();
        let surface = compositor.create_surface(&queue.handle(), ());
        client.flush().unwrap();
        Compositor {
            manners,
            thread: Some(thread),
            is_over,
            client,
            _queue: queue,
            surface,
        }
    }

    /// A program that presents to the client's surface.
    pub fn presenter(&self) -> Option<Presenter> {
        Presenter::new(khr::wayland_surface::NAME, |entry, instance| {
            let info = vk::WaylandSurfaceCreateInfoKHR::default()
                .display(self.client.backend().display_ptr().cast())
                .surface(self.surface.id().as_ptr().cast());
            // SAFETY: display and surface live longer than the presenter.
            unsafe {
                khr::wayland_surface::Instance::new(entry, instance)
                    .create_wayland_surface(&info, None)
                    .unwrap()
            }
        })
    }

    /// Whether the screen comes to show these pixels (blue, green, red, anything).
    pub fn shows(&self, width: usize, height: usize, pixels: &[u8]) -> bool {
        let same = |(shown, wanted): (&[u8], &[u8])| shown[..3] == wanted[..3];
        comes(|| {
            let shown = self.manners.shown.lock().unwrap().clone();
            let mut both = shown.pixels.chunks_exact(4).zip(pixels.chunks_exact(4));
            (shown.width, shown.height) == (width, height) && both.all(same)
        })
    }
}

impl Drop for Compositor {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn compose(stream: UnixStream, manners: Arc<Manners>, is_over: &AtomicBool, offers: Offers) {
    let mut display = Display::<CompositorState>::new().unwrap();
    let mut handle = display.handle();
    handle.create_global::<CompositorState, WlCompositor, ()>(4, ());
    handle.create_global::<CompositorState, WlShm, ()>(1, ());
    if offers.times {
        handle.create_global::<CompositorState, WpPresentation, ()>(1, ());
    }
    if offers.barriers {
        handle.create_global::<CompositorState, WpFifoManagerV1, ()>(1, ());
    }
    handle.insert_client(stream, Arc::new(Quiet)).unwrap();
    let mut state = CompositorState {
        manners,
        pending: Update::default(),
        queued: VecDeque::new(),
        has_barrier: false,
        due: Vec::new(),
        replaced: Vec::new(),
        current: None,
        promised: Vec::new(),
    };
    let start = Instant::now();
    let mut refresh = 0u32;
    while !is_over.load(Ordering::Acquire) && !state.manners.dies.load(Ordering::Acquire) {
        display.dispatch_clients(&mut state).unwrap();
        if start.elapsed() >= REFRESH * (refresh + 1) {
            refresh = (start.elapsed().as_micros() / REFRESH.as_micros()) as u32;
            if !state.manners.hides.load(Ordering::Acquire) {
                for callback in state.due.drain(..) {
                    callback.done(refresh * 16);
                }
                state.present(refresh);
            }
            // A hidden window's barriers fall, too.
            state.has_barrier = false;
            state.take_up();
        }
        display.flush_clients().unwrap();
        std::thread::sleep(Duration::from_micros(500));
    }
}

/// Reads a part of a file.
fn read(part: &Part) -> ScreenContents {
    let size = part.offset + part.stride * part.height;
    // SAFETY: a mapping of the client's file, which is as large as it said, or this test fails by a
    // signal.
    unsafe {
        let (protection, kind) = (libc::PROT_READ, libc::MAP_SHARED);
        let file = part.file.as_raw_fd();
        let data = libc::mmap(std::ptr::null_mut(), size, protection, kind, file, 0);
        assert_ne!(data, libc::MAP_FAILED);
        let bytes = std::slice::from_raw_parts(data.cast::<u8>(), size);
        let rows = bytes[part.offset..].chunks(part.stride).take(part.height);
        let pixels = rows
            .flat_map(|row| &row[..part.width * 4])
            .copied()
            .collect();
        libc::munmap(data, size);
        ScreenContents {
            width: part.width,
            height: part.height,
            has_alpha: part.has_alpha,
            pixels,
        }
    }
}

/// Now, by `CLOCK_MONOTONIC`.
fn now_ns() -> u64 {
    // SAFETY: a valid pointer, and a clock that every system has.
    let now = unsafe {
        let mut now: libc::timespec = std::mem::zeroed();
        libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now);
        now
    };
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

impl CompositorState {
    /// Reports that the committed frame is on the screen.
    fn present(&mut self, refresh: u32) {
        let now = now_ns();
        let (seconds, rest) = (now / 1_000_000_000, now % 1_000_000_000);
        for feedback in self.promised.drain(..) {
            self.manners.presented.lock().unwrap().push(now);
            let period = REFRESH.as_nanos() as u32;
            let (high, low) = ((seconds >> 32) as u32, seconds as u32);
            let kind = wp_presentation_feedback::Kind::Vsync;
            feedback.presented(high, low, rest as u32, period, 0, refresh, kind);
        }
    }

    fn commit(&mut self) {
        self.queued.push_back(std::mem::take(&mut self.pending));
        self.take_up();
    }

    /// Applies the committed updates, up to the one that waits for the barrier.
    fn take_up(&mut self) {
        while let Some(next) = self.queued.pop_front() {
            if self.has_barrier && next.waits {
                self.queued.push_front(next);
                return;
            }
            self.apply(next);
        }
    }

    fn apply(&mut self, mut update: Update) {
        if let Some(buffer) = update.attached.take() {
            if let Some(part) = buffer.data::<Part>() {
                *self.manners.shown.lock().unwrap() = read(part);
            }
            let before = self.current.replace(buffer);
            self.replaced.extend(before);
            let late = self.manners.late_releases.load(Ordering::Acquire);
            while self.replaced.len() > late {
                self.replaced.remove(0).release();
            }
        }
        self.has_barrier |= update.sets;
        self.promised.drain(..).for_each(|old| old.discarded());
        self.promised.append(&mut update.asked);
        self.due.append(&mut update.callbacks);
        self.manners.commits.fetch_add(1, Ordering::AcqRel);
        let waited = usize::from(update.waits);
        self.manners.waited.fetch_add(waited, Ordering::AcqRel);
    }
}

macro_rules! global {
    ($interface:ty) => {
        impl GlobalDispatch<$interface, ()> for CompositorState {
            fn bind(
                _: &mut Self,
                _: &DisplayHandle,
                _: &Client,
                resource: New<$interface>,
                (): &(),
                init: &mut DataInit<'_, Self>,
            ) {
                let resource = init.init(resource, ());
                announce(&resource);
            }
        }
    };
}

/// The description of a global.
fn announce<R: Resource + 'static>(resource: &R) {
    if let Some(shm) = (resource as &dyn std::any::Any).downcast_ref::<WlShm>() {
        shm.format(wl_shm::Format::Argb8888);
        shm.format(wl_shm::Format::Xrgb8888);
    }
    if let Some(presentation) = (resource as &dyn std::any::Any).downcast_ref::<WpPresentation>() {
        presentation.clock_id(libc::CLOCK_MONOTONIC as u32);
    }
}

global!(WlCompositor);
global!(WlShm);
global!(WpPresentation);
global!(WpFifoManagerV1);

macro_rules! dispatch {
    ($interface:ty, $data:ty, |$state:ident, $resource:ident, $request:ident, $own:ident, $init:ident| $body:block) => {
        impl Dispatch<$interface, $data> for CompositorState {
            fn request(
                $state: &mut Self,
                _: &Client,
                $resource: &$interface,
                $request: <$interface as Resource>::Request,
                $own: &$data,
                _: &DisplayHandle,
                $init: &mut DataInit<'_, Self>,
            ) $body
        }
    };
}

dispatch!(WlCompositor, (), |_state,
                             _resource,
                             request,
                             _own,
                             init| {
    match request {
        wl_compositor::Request::CreateSurface { id } => drop(init.init(id, ())),
        wl_compositor::Request::CreateRegion { id } => drop(init.init(id, ())),
        _ => {}
    }
});

dispatch!(WpPresentation, (), |state,
                               _resource,
                               request,
                               _own,
                               init| {
    if let wp_presentation::Request::Feedback { callback, .. } = request {
        state.pending.asked.push(init.init(callback, ()));
    }
});

dispatch!(
    WpPresentationFeedback,
    (),
    |_state, _resource, _request, _own, _init| {}
);

dispatch!(WpFifoManagerV1, (), |state,
                                resource,
                                request,
                                _own,
                                init| {
    if let wp_fifo_manager_v1::Request::GetFifo { id, .. } = request {
        init.init(id, ());
        if state.manners.barriers.fetch_add(1, Ordering::AcqRel) > 0 {
            let text = "the surface has a barrier";
            resource.post_error(wp_fifo_manager_v1::Error::AlreadyExists, text);
        }
    }
});

dispatch!(WpFifoV1, (), |state, _resource, request, _own, _init| {
    match request {
        wp_fifo_v1::Request::SetBarrier => state.pending.sets = true,
        wp_fifo_v1::Request::WaitBarrier => state.pending.waits = true,
        wp_fifo_v1::Request::Destroy => {
            state.manners.barriers.fetch_sub(1, Ordering::AcqRel);
        }
        _ => {}
    }
});

dispatch!(WlRegion, (), |_state, _resource, request, _own, _init| {
    let _: wl_region::Request = request;
});

dispatch!(WlShm, (), |_state, _resource, request, _own, init| {
    if let wl_shm::Request::CreatePool { id, fd, .. } = request {
        init.init(id, Pool(Arc::new(fd)));
    }
});

dispatch!(WlShmPool, Pool, |_state, _resource, request, own, init| {
    if let wl_shm_pool::Request::CreateBuffer {
        id,
        offset,
        width,
        height,
        stride,
        format,
    } = request
    {
        init.init(
            id,
            Part {
                file: Arc::clone(&own.0),
                offset: offset as usize,
                width: width as usize,
                height: height as usize,
                stride: stride as usize,
                has_alpha: matches!(format.into_result(), Ok(wl_shm::Format::Argb8888)),
            },
        );
    }
});

dispatch!(WlBuffer, Part, |state, resource, request, _own, _init| {
    if let wl_buffer::Request::Destroy = request {
        state.replaced.retain(|buffer| buffer != resource);
        state.current.take_if(|buffer| buffer == resource);
        let waiting = state.queued.iter_mut().chain([&mut state.pending]);
        for update in waiting {
            update.attached.take_if(|buffer| buffer == resource);
        }
    }
});

dispatch!(WlCallback, (), |_state,
                           _resource,
                           _request,
                           _own,
                           _init| {});

dispatch!(WlSurface, (), |state, _resource, request, _own, init| {
    match request {
        wl_surface::Request::Attach { buffer, .. } => state.pending.attached = buffer,
        wl_surface::Request::Frame { callback } => {
            state.pending.callbacks.push(init.init(callback, ()));
        }
        wl_surface::Request::Commit => state.commit(),
        _ => {}
    }
});

/// The application that has the surface. It listens to nothing.
struct Application;

macro_rules! ignore {
    ($($interface:ident $module:ident $data:ty;)*) => {$(
        impl wayland_client::Dispatch<wayland_client::protocol::$module::$interface, $data> for Application {
            fn event(
                _: &mut Self,
                _: &wayland_client::protocol::$module::$interface,
                _: wayland_client::protocol::$module::Event,
                _: &$data,
                _: &wayland_client::Connection,
                _: &wayland_client::QueueHandle<Self>,
            ) {
            }
        }
    )*};
}

ignore! {
    WlRegistry wl_registry wayland_client::globals::GlobalListContents;
    WlCompositor wl_compositor ();
    WlSurface wl_surface ();
}
