//! Windows of X11 on a server of the test's own.

use std::io::{BufRead, BufReader};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ash::khr;
use ash::vk;
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    ConfigureWindowAux, ConnectionExt, CreateWindowAux, ImageFormat, WindowClass,
};
use x11rb::wrapper::ConnectionExt as _;
use x11rb::xcb_ffi::XCBConnection;

use crate::{Presenter, has};

/// An Xvfb with one screen of 640 by 480 pixels, 24 bits deep.
pub struct Xvfb {
    process: Child,
    pub display: String,
}

impl Xvfb {
    /// Starts one; nothing where the machine has none. `without` names extensions that the server is not to have.
    #[track_caller]
    pub fn start(without: &[&str]) -> Option<Xvfb> {
        let mut ends = [0; 2];
        // SAFETY: a plain system call, and both descriptors are owned from then on.
        let (read, write) = unsafe {
            assert_eq!(libc::pipe(ends.as_mut_ptr()), 0);
            (OwnedFd::from_raw_fd(ends[0]), OwnedFd::from_raw_fd(ends[1]))
        };
        let mut command = Command::new("Xvfb");
        command.args(["-displayfd", &write.as_raw_fd().to_string()]);
        command.args(["-screen", "0", "640x480x24", "-nolisten", "tcp", "-noreset"]);
        for extension in without {
            command.args(["-extension", extension]);
        }
        let started = command.stderr(Stdio::null()).spawn();
        if !has("Xvfb", started.is_ok()) {
            return None;
        }
        drop(write);
        let mut line = String::new();
        BufReader::new(std::fs::File::from(read))
            .read_line(&mut line)
            .ok()?;
        Some(Xvfb {
            process: started.ok()?,
            display: format!(":{}", line.trim()),
        })
    }

    /// A window in the upper left corner, and the connection it is of.
    pub fn window(&self, width: u16, height: u16) -> Window {
        let display = std::ffi::CString::new(self.display.as_str()).unwrap();
        let (x, screen) = XCBConnection::connect(Some(&display)).unwrap();
        let window = x.generate_id().unwrap();
        let screen = &x.setup().roots[screen];
        let look = CreateWindowAux::new()
            .background_pixel(0)
            .override_redirect(1);
        let (root, visual) = (screen.root, screen.root_visual);
        let class = WindowClass::INPUT_OUTPUT;
        x.create_window(
            24, window, root, 0, 0, width, height, 0, class, visual, &look,
        )
        .unwrap();
        x.map_window(window).unwrap();
        x.sync().unwrap();
        Window { x, window, root }
    }
}

impl Drop for Xvfb {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A window of the application's.
pub struct Window {
    pub x: XCBConnection,
    pub window: u32,
    root: u32,
}

impl Window {
    /// A program that presents to it.
    pub fn presenter(&self) -> Option<Presenter> {
        Presenter::new(khr::xcb_surface::NAME, |entry, instance| {
            let info = vk::XcbSurfaceCreateInfoKHR::default()
                .connection(self.x.get_raw_xcb_connection().cast())
                .window(self.window);
            // SAFETY: the window lives longer than the presenter, or dies as the test wants it.
            unsafe {
                khr::xcb_surface::Instance::new(entry, instance)
                    .create_xcb_surface(&info, None)
                    .unwrap()
            }
        })
    }

    pub fn resize(&self, width: u32, height: u32) {
        let size = ConfigureWindowAux::new().width(width).height(height);
        self.x.configure_window(self.window, &size).unwrap();
        self.x.sync().unwrap();
    }

    pub fn destroy(&self) {
        self.x.destroy_window(self.window).unwrap();
        self.x.sync().unwrap();
    }

    /// What the screen shows in the corner where the window is: blue, green, red and nothing of each pixel.
    pub fn screenshot(&self, width: u16, height: u16) -> Vec<u8> {
        let format = ImageFormat::Z_PIXMAP;
        let image = self
            .x
            .get_image(format, self.root, 0, 0, width, height, u32::MAX);
        image.unwrap().reply().unwrap().data
    }

    /// Whether the screen comes to show these pixels (blue, green, red, anything).
    pub fn shows(&self, width: u16, height: u16, pixels: &[u8]) -> bool {
        let start = Instant::now();
        loop {
            let shown = self.screenshot(width, height);
            let same = |(shown, wanted): (&[u8], &[u8])| shown[..3] == wanted[..3];
            if shown.chunks_exact(4).zip(pixels.chunks_exact(4)).all(same) {
                return true;
            }
            if start.elapsed() > Duration::from_secs(5) {
                return false;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
