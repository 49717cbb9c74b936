//! Windows, and pixels that GDI copies to them.

use windows_sys::Win32::Foundation::{HWND, RECT};
use windows_sys::Win32::Graphics::Gdi::{
    BI_RGB, BITMAPINFO, BITMAPINFOHEADER, BitBlt, CreateCompatibleDC, CreateDIBSection, DCX_CACHE,
    DCX_CLIPCHILDREN, DCX_CLIPSIBLINGS, DIB_RGB_COLORS, DeleteDC, DeleteObject, GdiFlush, GetDCEx,
    GetDeviceCaps, HBITMAP, HDC, HGDIOBJ, ReleaseDC, SRCCOPY, SelectObject, VREFRESH,
};
use windows_sys::Win32::UI::WindowsAndMessaging::{GetClientRect, IsIconic};

/// A window of the application, which may be destroyed at any time.
#[derive(Clone, Copy, Debug)]
pub struct Window(HWND);

// SAFETY: a window's name, which all threads may use; it is no pointer to memory.
unsafe impl Send for Window {}
// SAFETY: a window's name, which all threads may use; it is no pointer to memory.
unsafe impl Sync for Window {}

impl Window {
    /// The window of an `HWND`, which may be any number.
    pub fn new(window: isize) -> Self {
        Self(window as HWND)
    }

    /// Width and height of the client area in pixels: both 0 if it is empty, as in a minimized
    /// window. `None` once the window is destroyed.
    pub fn extent(self) -> Option<(u32, u32)> {
        let mut area = RECT::default();
        // SAFETY: plain system calls; the first fills the rectangle.
        let (is_there, is_minimized) =
            unsafe { (GetClientRect(self.0, &mut area) != 0, IsIconic(self.0) != 0) };
        if !is_there {
            return None;
        }
        let sides = (area.right - area.left, area.bottom - area.top);
        Some(match sides {
            (width @ 1.., height @ 1..) if !is_minimized => (width as u32, height as u32),
            _ => (0, 0),
        })
    }

    /// The refresh rate of the window's display in hertz; `None` if it is unknown.
    pub fn refreshes_per_second(self) -> Option<u32> {
        let rate = self.draw(|context| {
            // SAFETY: a context of the window's.
            unsafe { GetDeviceCaps(context, VREFRESH as i32) }
        })?;
        // 0 and 1 stand for the display's default.
        u32::try_from(rate).ok().filter(|&rate| rate > 1)
    }

    /// Uses a device context of the window with default settings.
    fn draw<R>(self, how: impl FnOnce(HDC) -> R) -> Option<R> {
        let kind = DCX_CACHE | DCX_CLIPCHILDREN | DCX_CLIPSIBLINGS;
        // SAFETY: plain system calls; the context is given back by the thread that has got it.
        unsafe {
            let context = GetDCEx(self.0, std::ptr::null_mut(), kind);
            if context.is_null() {
                return None;
            }
            let result = how(context);
            ReleaseDC(self.0, context);
            Some(result)
        }
    }
}

/// Pixels of 32 bits (blue, green, red, alpha), the upper row first, in memory that GDI reads (a
/// "DIB section"). Only the thread that created it uses it.
pub struct Bitmap {
    context: HDC,
    bitmap: HBITMAP,
    before: HGDIOBJ,
    data: *mut u8,
    pub width: u32,
    pub height: u32,
}

// SAFETY: made, used and dropped by one thread at a time; its memory is its own.
unsafe impl Send for Bitmap {}

impl Bitmap {
    /// Bytes of a pixel.
    pub const PIXEL_BYTES: usize = 4;

    /// Black pixels; `None` if the system refuses.
    pub fn new(width: u32, height: u32) -> Option<Self> {
        let header = BITMAPINFOHEADER {
            biSize: size_of::<BITMAPINFOHEADER>() as u32,
            biWidth: i32::try_from(width).ok()?,
            // Negative: the upper row is the first.
            biHeight: -i32::try_from(height).ok()?,
            biPlanes: 1,
            biBitCount: 32,
            biCompression: BI_RGB,
            ..BITMAPINFOHEADER::default()
        };
        let info = BITMAPINFO {
            bmiHeader: header,
            ..BITMAPINFO::default()
        };
        let mut data = std::ptr::null_mut();
        let (own, colors) = (std::ptr::null_mut(), DIB_RGB_COLORS);
        // SAFETY: plain system calls; what they make is freed by `drop`, or here.
        unsafe {
            let context = CreateCompatibleDC(std::ptr::null_mut());
            if context.is_null() {
                return None;
            }
            let bitmap = CreateDIBSection(context, &info, colors, &mut data, own, 0);
            if bitmap.is_null() || data.is_null() {
                DeleteDC(context);
                return None;
            }
            Some(Self {
                before: SelectObject(context, bitmap),
                context,
                bitmap,
                data: data.cast(),
                width,
                height,
            })
        }
    }

    pub fn pixels(&mut self) -> &mut [u8] {
        let bytes = self.width as usize * self.height as usize * Self::PIXEL_BYTES;
        // SAFETY: the bitmap has so many bytes; after the call no copy of the system's reads them.
        unsafe {
            GdiFlush();
            std::slice::from_raw_parts_mut(self.data, bytes)
        }
    }

    /// Copies the pixels to the upper left corner of a window; false if the system refuses, for
    /// example for a destroyed window. The copy is complete on return.
    pub fn show(&self, window: Window) -> bool {
        let (width, height) = (self.width as i32, self.height as i32);
        let is_copied = window.draw(|context| {
            // SAFETY: two contexts that are there.
            unsafe {
                let done = BitBlt(context, 0, 0, width, height, self.context, 0, 0, SRCCOPY);
                GdiFlush();
                done != 0
            }
        });
        is_copied == Some(true)
    }
}

impl Drop for Bitmap {
    fn drop(&mut self) {
        // SAFETY: what `new` made; nothing uses it any more.
        unsafe {
            SelectObject(self.context, self.before);
            DeleteObject(self.bitmap);
            DeleteDC(self.context);
        }
    }
}
