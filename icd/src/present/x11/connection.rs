//! The application's connection. Each request is checked, or its error is ignored: Xlib's handler
//! would end the process at an error event.

use std::ffi::c_void;

use ash::vk;
use x11rb::connection::{Connection as _, RequestConnection};
use x11rb::protocol::present::ConnectionExt as _;
use x11rb::protocol::shm::ConnectionExt as _;
use x11rb::protocol::xproto::{ConnectionExt as _, ImageOrder, VisualClass};
use x11rb::xcb_ffi::XCBConnection;

use super::super::SurfaceLost;
use super::super::conversion::Layout;
use super::library;
use crate::os::window_server;

/// A connection, borrowed from the application while it has surfaces.
pub struct Connection {
    pub x: XCBConnection,
    pub raw: *mut c_void,
}

// SAFETY: libxcb's connections can be used by all threads, and the pointer is only passed to
// libxcb.
unsafe impl Send for Connection {}
// SAFETY: as for `Send`.
unsafe impl Sync for Connection {}

/// How the server can share memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sharing {
    pub segments: bool,
    pub descriptors: bool,
    pub pixmaps: bool,
}

/// The pixel format of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pixels {
    pub depth: u8,
    pub layout: Layout,
    /// Alignment of rows.
    pub row_alignment_bytes: usize,
    /// The window's pixels have alpha.
    pub has_alpha: bool,
}

/// Properties of a window that are queried once.
pub struct Facts {
    pub root: u32,
    pub pixels: Option<Pixels>,
}

impl Connection {
    /// Wraps a connection of libxcb.
    ///
    /// # Errors
    /// `VK_ERROR_INITIALIZATION_FAILED` if libxcb cannot be opened, or the connection is broken.
    ///
    /// # Safety
    /// `raw` is an `xcb_connection_t *` that stays open as long as the object lives.
    pub unsafe fn new(raw: *mut c_void) -> Result<Self, vk::Result> {
        const FAILED: vk::Result = vk::Result::ERROR_INITIALIZATION_FAILED;
        if raw.is_null() || library::xcb().is_none() {
            return Err(FAILED);
        }
        // SAFETY: the caller passes an open connection, which stays the application's and is not
        // closed here.
        let x = unsafe { XCBConnection::from_raw_xcb_connection(raw, false) };
        let x = x.map_err(|_| FAILED)?;
        match x.has_error() {
            Some(_) => Err(FAILED),
            None => Ok(Self { x, raw }),
        }
    }

    /// Queries the properties of a window.
    pub fn facts(&self, window: u32) -> Result<Facts, SurfaceLost> {
        let attributes = self
            .x
            .get_window_attributes(window)
            .map_err(|_| SurfaceLost)?;
        let geometry = self.x.get_geometry(window).map_err(|_| SurfaceLost)?;
        let attributes = attributes.reply().map_err(|_| SurfaceLost)?;
        let geometry = geometry.reply().map_err(|_| SurfaceLost)?;
        Ok(Facts {
            root: geometry.root,
            pixels: self.pixels(attributes.visual),
        })
    }

    /// The pixel format of windows with this visual, if it is supported.
    pub fn pixels(&self, visual: u32) -> Option<Pixels> {
        let setup = self.x.setup();
        if setup.image_byte_order != ImageOrder::LSB_FIRST {
            return None;
        }
        let depths = setup.roots.iter().flat_map(|screen| &screen.allowed_depths);
        let (depth, visual) = depths
            .flat_map(|depth| {
                depth
                    .visuals
                    .iter()
                    .map(move |visual| (depth.depth, visual))
            })
            .find(|(_, other)| other.visual_id == visual)?;
        if visual.class != VisualClass::TRUE_COLOR && visual.class != VisualClass::DIRECT_COLOR {
            return None;
        }
        let mut formats = setup.pixmap_formats.iter();
        let format = formats.find(|format| format.depth == depth)?;
        let masks = [visual.red_mask, visual.green_mask, visual.blue_mask];
        let color_bits: u32 = masks.iter().map(|mask| mask.count_ones()).sum();
        Some(Pixels {
            depth,
            layout: Layout::from_masks(format.bits_per_pixel, masks)?,
            row_alignment_bytes: usize::from(format.scanline_pad / 8).max(1),
            has_alpha: u32::from(depth) > color_bits,
        })
    }

    /// A window's extent.
    pub fn extent(&self, window: u32) -> Result<vk::Extent2D, SurfaceLost> {
        let geometry = self.x.get_geometry(window).map_err(|_| SurfaceLost)?;
        let geometry = geometry.reply().map_err(|_| SurfaceLost)?;
        Ok(vk::Extent2D {
            width: geometry.width.into(),
            height: geometry.height.into(),
        })
    }

    /// An id for a new resource.
    pub fn id(&self) -> Result<u32, SurfaceLost> {
        self.x.generate_id().map_err(|_| SurfaceLost)
    }

    /// Whether the server has the Present extension.
    pub fn has_present(&self) -> bool {
        const NAME: &str = x11rb::protocol::present::X11_EXTENSION_NAME;
        matches!(self.x.extension_information(NAME), Ok(Some(_)))
            && (self.x.present_query_version(1, 0)).is_ok_and(|cookie| cookie.reply().is_ok())
    }

    /// The way in which the server can share memory (MIT-SHM). Sharing may still fail if the server
    /// is remote.
    pub fn sharing(&self) -> Sharing {
        const NAME: &str = x11rb::protocol::shm::X11_EXTENSION_NAME;
        // Descriptors cannot be sent to other machines: libxcb would shut the connection down.
        if !window_server::is_local(&self.x)
            || !matches!(self.x.extension_information(NAME), Ok(Some(_)))
        {
            return Sharing::default();
        }
        let Ok(Ok(version)) = self.x.shm_query_version().map(|cookie| cookie.reply()) else {
            return Sharing::default();
        };
        Sharing {
            segments: true,
            descriptors: (version.major_version, version.minor_version) >= (1, 2),
            pixmaps: version.shared_pixmaps && version.pixmap_format == 2,
        }
    }

    /// Makes the connection's socket readable once.
    ///
    /// A reader of the socket also moves the application's events into libxcb's queue, where an
    /// application that sleeps in `poll` does not see them. The answer to this request wakes the
    /// application, which then looks into the queue. Nothing here waits for the answer.
    pub fn wake_pollers(&self) -> Result<(), SurfaceLost> {
        // Dropping the cookie makes libxcb discard the reply.
        drop(self.x.get_input_focus().map_err(|_| SurfaceLost)?);
        self.flush()
    }

    /// Flushes the pending requests.
    pub fn flush(&self) -> Result<(), SurfaceLost> {
        self.x.flush().map_err(|_| SurfaceLost)
    }
}
