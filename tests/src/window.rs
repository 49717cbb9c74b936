//! Windows of X11 on a server of the test's own.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use ash::khr;
use ash::vk;
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    ConfigureWindowAux, ConnectionExt, CreateWindowAux, ImageFormat, WindowClass,
};
use x11rb::wrapper::ConnectionExt as _;
use x11rb::xcb_ffi::XCBConnection;

use crate::{Presenter, comes, has};

/// An Xvfb with one screen of 640 by 480 pixels, 24 bits deep.
pub struct Xvfb {
    process: Child,
    pub display: String,
    /// The socket of a messenger between the server and its clients.
    between: Option<PathBuf>,
}

impl Xvfb {
    /// Starts one; nothing where the machine has none. `without` names extensions that the server
    /// is not to have.
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
            between: None,
        })
    }

    /// Starts a server behind a proxy that drops descriptors (as the way into a container may) and
    /// that hides the Present extension from clients on request.
    #[track_caller]
    pub fn start_afar(hides_present: bool) -> Option<Xvfb> {
        let mut server = Self::start(&[])?;
        let sockets = Path::new("/tmp/.X11-unix");
        let behind = sockets.join(format!("X{}", &server.display[1..]));
        let numbers = 200 + std::process::id() % 1000..;
        let (listener, number) = numbers
            .filter_map(|number| {
                let path = sockets.join(format!("X{number}"));
                Some((UnixListener::bind(path).ok()?, number))
            })
            .next()?;
        server.display = format!(":{number}");
        server.between = Some(sockets.join(format!("X{number}")));
        std::thread::spawn(move || {
            while let Ok((client, _)) = listener.accept() {
                let Ok(server) = UnixStream::connect(&behind) else {
                    return;
                };
                let ends = [client.try_clone().unwrap(), server.try_clone().unwrap()];
                std::thread::spawn(move || pass_on(client, server, hides_present));
                let [client, server] = ends;
                std::thread::spawn(move || pass_on(server, client, false));
            }
        });
        Some(server)
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
        if let Some(socket) = &self.between {
            let _ = std::fs::remove_file(socket);
        }
    }
}

/// Passes bytes on until either side hangs up.
fn pass_on(mut from: UnixStream, mut to: UnixStream, hides_present: bool) {
    let mut bytes = [0; 1 << 16];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        let part = &mut bytes[..count];
        if hides_present {
            let mut places = part.windows(7).map(|word| word == b"Present");
            if let Some(place) = places.position(|is_there| is_there) {
                part[place] = b'A';
            }
        }
        if to.write_all(part).is_err() {
            break;
        }
    }
    let _ = to.shutdown(std::net::Shutdown::Both);
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

    /// The pixels of the screen in the window's corner: blue, green, red and an unused byte each.
    pub fn screenshot(&self, width: u16, height: u16) -> Vec<u8> {
        let format = ImageFormat::Z_PIXMAP;
        let image = self
            .x
            .get_image(format, self.root, 0, 0, width, height, u32::MAX);
        image.unwrap().reply().unwrap().data
    }

    /// Whether the screen comes to show these pixels (blue, green, red, anything).
    pub fn shows(&self, width: u16, height: u16, pixels: &[u8]) -> bool {
        let same = |(shown, wanted): (&[u8], &[u8])| shown[..3] == wanted[..3];
        comes(|| {
            let shown = self.screenshot(width, height);
            shown.chunks_exact(4).zip(pixels.chunks_exact(4)).all(same)
        })
    }
}
