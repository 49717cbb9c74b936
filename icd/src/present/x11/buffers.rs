//! The pixmaps of a swapchain's images: the images themselves if the server can read them in place,
//! copies in shared memory, or copies that are sent.

use std::sync::Arc;

use ash::vk;
use x11rb::connection::RequestConnection;
use x11rb::errors::ReplyError;
use x11rb::protocol::shm::ConnectionExt as _;
use x11rb::protocol::xproto::{ConnectionExt as _, ImageFormat};

use super::super::pixels::{self, Canvas};
use super::super::{Pictures, SurfaceLost};
use super::connection::{Connection, Pixels, Sharing};
use crate::os::handle::Handle;
use crate::os::window_server::SharedMemory;

/// Largest size of a request that puts pixels, so that the application's own requests can come in
/// between.
const CHUNK_BYTES: usize = 1 << 20;
/// Bytes of a `PutImage` request before its data.
const PUT_IMAGE_BYTES: usize = 28;

/// A pixmap for each image.
pub struct Buffers {
    connection: Arc<Connection>,
    pub extent: vk::Extent2D,
    pixels: Pixels,
    row_stride_bytes: usize,
    size_bytes: usize,
    pixmaps: Vec<u32>,
    contents: Contents,
    segment: Option<u32>,
}

/// The storage of the pixels.
enum Contents {
    /// In the images.
    Images,
    /// In shared memory, with a part for each pixmap.
    Shared {
        memory: SharedMemory,
        is_pixmaps: bool,
    },
    /// In a buffer from which they are sent.
    Sent(Vec<u8>),
}

impl Buffers {
    /// Creates pixmaps of this extent.
    ///
    /// # Errors
    /// The window or its connection is lost, or memory is exhausted.
    pub fn new(
        connection: &Arc<Connection>,
        window: u32,
        pixels: Pixels,
        sharing: Sharing,
        pictures: &Pictures,
        extent: vk::Extent2D,
    ) -> Result<Self, SurfaceLost> {
        let row_bytes = extent.width as usize * pixels.layout.bytes();
        let row_stride_bytes = row_bytes.next_multiple_of(pixels.row_alignment_bytes);
        let mut buffers = Self {
            connection: Arc::clone(connection),
            extent,
            pixels,
            row_stride_bytes,
            size_bytes: row_stride_bytes * extent.height as usize,
            pixmaps: Vec::new(),
            contents: Contents::Sent(Vec::new()),
            segment: None,
        };
        let in_place = sharing.descriptors && sharing.pixmaps && buffers.are_images(pictures);
        if in_place
            && let Ok(file) = pictures.memory.export()
            && let Some(segment) = buffers.attach_file(file)
        {
            buffers.segment = Some(segment);
            buffers.contents = Contents::Images;
            if buffers.make_pixmaps(window, pictures)? {
                return Ok(buffers);
            }
            buffers.forget();
        }
        if let Some((memory, segment)) = buffers.share(sharing, pictures.images.len()) {
            buffers.segment = Some(segment);
            buffers.contents = Contents::Shared {
                memory,
                is_pixmaps: sharing.pixmaps,
            };
            if buffers.make_pixmaps(window, pictures)? {
                return Ok(buffers);
            }
            buffers.forget();
        }
        let mut room = Vec::new();
        room.try_reserve_exact(buffers.size_bytes)
            .map_err(|_| SurfaceLost)?;
        room.resize(buffers.size_bytes, 0);
        buffers.contents = Contents::Sent(room);
        match buffers.make_pixmaps(window, pictures)? {
            true => Ok(buffers),
            false => Err(SurfaceLost),
        }
    }

    /// Creates a pixmap for each image. Returns whether the server accepts them.
    fn make_pixmaps(&mut self, window: u32, pictures: &Pictures) -> Result<bool, SurfaceLost> {
        let mut all_made = true;
        for index in 0..pictures.images.len() as u32 {
            let pixmap = self.connection.id()?;
            all_made &= self.make_pixmap(pixmap, window, pictures, index)?;
            self.pixmaps.push(pixmap);
        }
        Ok(all_made)
    }

    /// Whether pixmaps have the layout of the images.
    fn are_images(&self, pictures: &Pictures) -> bool {
        let picture = pictures.picture(0);
        self.extent == picture.extent
            && self.row_stride_bytes == picture.row_stride_bytes
            && self.pixels.layout.is_that_of(picture.format)
            && !self.hides_alpha(pictures)
    }

    /// The window has alpha, and the application wants it opaque.
    fn hides_alpha(&self, pictures: &Pictures) -> bool {
        self.pixels.has_alpha && pictures.composite_alpha == vk::CompositeAlphaFlagsKHR::OPAQUE
    }

    /// The server's access to the file: pixmaps in it need more than read access.
    fn attach_file(&self, file: Handle) -> Option<u32> {
        let x = &self.connection.x;
        let segment = self.connection.id().ok()?;
        x.shm_attach_fd(segment, file, false).ok()?.check().ok()?;
        Some(segment)
    }

    /// Memory attached to the server.
    fn share(&self, sharing: Sharing, count: usize) -> Option<(SharedMemory, u32)> {
        let size_bytes = self.size_bytes.checked_mul(count)?;
        if sharing.descriptors
            && let Some(memory) = SharedMemory::file(size_bytes)
            && let Some(file) = memory.handle().and_then(Handle::try_clone)
            && let Some(segment) = self.attach_file(file)
        {
            return Some((memory, segment));
        }
        if !sharing.segments {
            return None;
        }
        let memory = SharedMemory::segment(size_bytes)?;
        let segment = self.connection.id().ok()?;
        let id = memory.segment_id()? as u32;
        let attached = self.connection.x.shm_attach(segment, id, false).ok()?;
        let attached = attached.check();
        memory.unname();
        attached.ok()?;
        Some((memory, segment))
    }

    fn make_pixmap(
        &self,
        pixmap: u32,
        window: u32,
        pictures: &Pictures,
        index: u32,
    ) -> Result<bool, SurfaceLost> {
        let x = &self.connection.x;
        let depth = self.pixels.depth;
        // Images and windows are far smaller than 65,536.
        let (width, height) = (self.extent.width as u16, self.extent.height as u16);
        let offset = match &self.contents {
            Contents::Images => Some(pictures.offset_bytes(index)),
            Contents::Shared { is_pixmaps, .. } => {
                is_pixmaps.then_some(u64::from(index) * self.size_bytes as u64)
            }
            Contents::Sent(_) => None,
        };
        let shared = offset.and_then(|offset| Some((u32::try_from(offset).ok()?, self.segment?)));
        let cookie = match shared {
            Some((offset, segment)) => {
                x.shm_create_pixmap(pixmap, window, width, height, depth, segment, offset)
            }
            None => x.create_pixmap(depth, pixmap, window, width, height),
        };
        match cookie.map_err(|_| SurfaceLost)?.check() {
            Ok(()) => Ok(true),
            Err(ReplyError::X11Error(_)) => Ok(false),
            Err(ReplyError::ConnectionError(_)) => Err(SurfaceLost),
        }
    }

    /// The pixmap of an image, filled with the image's pixels.
    ///
    /// # Errors
    /// The connection is lost.
    pub fn fill(&mut self, pictures: &Pictures, index: u32, gc: u32) -> Result<u32, SurfaceLost> {
        let pixmap = self.pixmaps[index as usize];
        let is_opaque = self.hides_alpha(pictures);
        let size_bytes = self.size_bytes;
        let start = index as usize * size_bytes;
        let room = match &mut self.contents {
            Contents::Images => return Ok(pixmap),
            Contents::Shared { memory, .. } => &mut memory.bytes()[start..][..size_bytes],
            Contents::Sent(room) => &mut room[..],
        };
        let picture = pictures.picture(index);
        let mut canvas = Canvas {
            pixels: room,
            row_stride_bytes: self.row_stride_bytes,
            extent: self.extent,
            layout: self.pixels.layout,
            is_opaque,
        };
        let placement = pictures.scaling.placement(picture.extent, self.extent);
        // SAFETY: the images' memory lives as long as `pictures`.
        unsafe { pixels::draw(&picture, &placement, &mut canvas) };
        match &self.contents {
            Contents::Shared {
                is_pixmaps: false, ..
            } => {
                let x = &self.connection.x;
                let (width, height) = (self.extent.width as u16, self.extent.height as u16);
                let format = u8::from(ImageFormat::Z_PIXMAP);
                let depth = self.pixels.depth;
                let segment = self.segment.ok_or(SurfaceLost)?;
                x.shm_put_image(
                    pixmap,
                    gc,
                    width,
                    height,
                    0,
                    0,
                    width,
                    height,
                    0,
                    0,
                    depth,
                    format,
                    false,
                    segment,
                    start as u32,
                )
                .map_err(|_| SurfaceLost)?
                .ignore_error();
            }
            Contents::Sent(room) => self.send(room, pixmap, gc)?,
            _ => {}
        }
        Ok(pixmap)
    }

    /// Puts pixels into a pixmap, some rows at a time.
    fn send(&self, room: &[u8], pixmap: u32, gc: u32) -> Result<(), SurfaceLost> {
        let x = &self.connection.x;
        let largest = (x.maximum_request_bytes().saturating_sub(PUT_IMAGE_BYTES)).min(CHUNK_BYTES);
        let rows = (largest / self.row_stride_bytes).max(1);
        let (format, depth) = (ImageFormat::Z_PIXMAP, self.pixels.depth);
        let width = self.extent.width as u16;
        for (index, chunk) in room.chunks(rows * self.row_stride_bytes).enumerate() {
            let height = (chunk.len() / self.row_stride_bytes) as u16;
            let y = (index * rows) as i16;
            x.put_image(format, pixmap, gc, width, height, 0, y, 0, depth, chunk)
                .map_err(|_| SurfaceLost)?
                .ignore_error();
        }
        Ok(())
    }
}

impl Buffers {
    /// Frees the server's resources.
    fn forget(&mut self) {
        let x = &self.connection.x;
        for pixmap in self.pixmaps.drain(..) {
            if let Ok(cookie) = x.free_pixmap(pixmap) {
                cookie.ignore_error();
            }
        }
        if let Some(segment) = self.segment.take()
            && let Ok(cookie) = x.shm_detach(segment)
        {
            cookie.ignore_error();
        }
        let _ = self.connection.flush();
    }
}

impl Drop for Buffers {
    fn drop(&mut self) {
        self.forget();
    }
}
