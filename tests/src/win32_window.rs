//! Windows of Win32, on the screen of the test program.

use std::sync::Once;

use ash::khr;
use ash::vk;
use windows_sys::Win32::Foundation::HWND;
use windows_sys::Win32::Graphics::Gdi::{
    BI_RGB, BITMAPINFO, BITMAPINFOHEADER, BitBlt, CreateCompatibleBitmap, CreateCompatibleDC,
    DIB_RGB_COLORS, DeleteDC, DeleteObject, GetDC, GetDIBits, ReleaseDC, SRCCOPY, SelectObject,
};
use windows_sys::Win32::UI::WindowsAndMessaging::{
    CreateWindowExW, DefWindowProcW, DestroyWindow, DispatchMessageW, HWND_TOPMOST, MSG, PM_REMOVE,
    PeekMessageW, RegisterClassW, SW_MINIMIZE, SW_RESTORE, SWP_NOACTIVATE, SetWindowPos,
    ShowWindow, WNDCLASSW, WS_EX_TOPMOST, WS_MINIMIZEBOX, WS_POPUP, WS_VISIBLE,
};

use crate::{Presenter, comes};

/// A window in the upper left corner of the screen, without a frame, of the thread that makes it.
pub struct Win32Window {
    window: HWND,
}

impl Win32Window {
    pub fn new(width: i32, height: i32) -> Win32Window {
        let class: Vec<u16> = "tuff tests\0".encode_utf16().collect();
        static REGISTERED: Once = Once::new();
        let none = std::ptr::null_mut();
        // SAFETY: the class' procedure is the system's, and its name ends with a zero.
        let window = unsafe {
            REGISTERED.call_once(|| {
                RegisterClassW(&WNDCLASSW {
                    lpfnWndProc: Some(DefWindowProcW),
                    lpszClassName: class.as_ptr(),
                    ..std::mem::zeroed()
                });
            });
            let style = WS_POPUP | WS_VISIBLE | WS_MINIMIZEBOX;
            let (name, data) = (class.as_ptr(), std::ptr::null());
            CreateWindowExW(
                WS_EX_TOPMOST,
                name,
                name,
                style,
                0,
                0,
                width,
                height,
                none,
                none,
                none,
                data,
            )
        };
        assert!(!window.is_null(), "{}", std::io::Error::last_os_error());
        let window = Win32Window { window };
        window.answer();
        window
    }

    /// A program that presents to it.
    pub fn presenter(&self) -> Option<Presenter> {
        presenter_to(self.window as isize)
    }

    /// A program that presents to a number that is no window.
    pub fn presenter_to_none() -> Option<Presenter> {
        presenter_to(0x7fff_fff0)
    }

    /// Handles the messages that have come for windows of this thread.
    pub fn answer(&self) {
        // SAFETY: the message is plain data, which the first call fills.
        unsafe {
            let mut message: MSG = std::mem::zeroed();
            while PeekMessageW(&mut message, std::ptr::null_mut(), 0, 0, PM_REMOVE) != 0 {
                DispatchMessageW(&message);
            }
        }
    }

    pub fn resize(&self, width: i32, height: i32) {
        let kind = SWP_NOACTIVATE;
        // SAFETY: a window of this thread.
        let done = unsafe { SetWindowPos(self.window, HWND_TOPMOST, 0, 0, width, height, kind) };
        assert_ne!(done, 0);
        self.answer();
    }

    pub fn minimize(&self) {
        // SAFETY: a window of this thread.
        unsafe { ShowWindow(self.window, SW_MINIMIZE) };
        self.answer();
    }

    pub fn restore(&self) {
        // SAFETY: a window of this thread.
        unsafe { ShowWindow(self.window, SW_RESTORE) };
        self.answer();
    }

    pub fn destroy(&self) {
        // SAFETY: a window of this thread, or none any more.
        unsafe { DestroyWindow(self.window) };
        self.answer();
    }

    /// The pixels of the window's upper left corner: blue, green, red and an unused byte each.
    pub fn picture(&self, width: i32, height: i32) -> Vec<u8> {
        pixels_of(self.window, width, height)
    }

    /// The pixels of the screen's upper left corner.
    pub fn screenshot(&self, width: i32, height: i32) -> Vec<u8> {
        pixels_of(std::ptr::null_mut(), width, height)
    }

    /// Whether the window comes to show these pixels (blue, green, red, anything).
    pub fn shows(&self, width: i32, height: i32, pixels: &[u8]) -> bool {
        comes(|| {
            self.answer();
            is_like(&self.picture(width, height), pixels)
        })
    }

    /// Whether the screen comes to show these pixels where the window is.
    pub fn is_seen(&self, width: i32, height: i32, pixels: &[u8]) -> bool {
        comes(|| {
            self.answer();
            is_like(&self.screenshot(width, height), pixels)
        })
    }
}

impl Drop for Win32Window {
    fn drop(&mut self) {
        self.destroy();
    }
}

/// Whether pixels are the same, their fourth byte left out.
fn is_like(shown: &[u8], wanted: &[u8]) -> bool {
    let same = |(shown, wanted): (&[u8], &[u8])| shown[..3] == wanted[..3];
    shown.chunks_exact(4).zip(wanted.chunks_exact(4)).all(same)
}

fn presenter_to(window: isize) -> Option<Presenter> {
    Presenter::new(khr::win32_surface::NAME, |entry, instance| {
        let info = vk::Win32SurfaceCreateInfoKHR::default().hwnd(window);
        let surfaces = khr::win32_surface::Instance::new(entry, instance);
        // SAFETY: the window lives longer than the presenter, or dies as the test wants it.
        unsafe { surfaces.create_win32_surface(&info, None) }.unwrap()
    })
}

/// The upper left corner of a window, or of the screen for null.
fn pixels_of(window: HWND, width: i32, height: i32) -> Vec<u8> {
    let mut pixels = vec![0; (width * height * 4) as usize];
    let header = BITMAPINFOHEADER {
        biSize: size_of::<BITMAPINFOHEADER>() as u32,
        biWidth: width,
        // Negative: the upper row is the first.
        biHeight: -height,
        biPlanes: 1,
        biBitCount: 32,
        biCompression: BI_RGB,
        ..BITMAPINFOHEADER::default()
    };
    let mut info = BITMAPINFO {
        bmiHeader: header,
        ..BITMAPINFO::default()
    };
    // SAFETY: what is made is freed, and the vector has as many bytes as the header says.
    unsafe {
        let context = GetDC(window);
        let copy = CreateCompatibleDC(context);
        let bitmap = CreateCompatibleBitmap(context, width, height);
        let before = SelectObject(copy, bitmap);
        BitBlt(copy, 0, 0, width, height, context, 0, 0, SRCCOPY);
        SelectObject(copy, before);
        let (data, colors) = (pixels.as_mut_ptr().cast(), DIB_RGB_COLORS);
        GetDIBits(copy, bitmap, 0, height as u32, data, &mut info, colors);
        DeleteObject(bitmap);
        DeleteDC(copy);
        ReleaseDC(window, context);
    }
    pixels
}
