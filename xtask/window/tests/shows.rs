//! Compares the window with the demo's pictures computed off screen: the rasterized picture left of
//! the split, the traced one right of it; resized and hidden, too. Closing the window ends the
//! program. On X11: tests/tests/win32_windows.rs tests windows of Windows.

#![cfg(unix)]

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use ash::vk;
use demo::picture::encoded;
use demo::raster::{Drawing, Rasterizer};
use demo::render::{self, BOUNCES, DeviceScene, Renderer, Settings};
use demo::scene::Scene;
use demo::vulkan::{Context, PipelineCache, Wish};
use tuff_tests::{Window, Xvfb, comes};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    AtomEnum, ClientMessageEvent, ConfigureWindowAux, ConnectionExt, EventMask,
};
use x11rb::wrapper::ConnectionExt as _;

/// Sizes of the window in pixels, at first and after the resize.
const SIZES: [(u32, u32); 2] = [(480, 270), (400, 240)];
const SAMPLES: u32 = 2;
/// The same light is encoded by a shader in the window and by a table off screen: where it lies
/// between two codes, either may come out.
const TOLERANCE: u8 = 1;
/// How far the panel's edge reaches beyond its rectangle, in pixels.
const EDGE: u32 = 2;

/// The pictures of all sizes, computed without a window: red, green and blue of each pixel, row by
/// row.
fn off_screen() -> [Vec<u8>; 2] {
    let scene = Scene::landscape();
    let wish = Wish {
        draws: true,
        ..Default::default()
    };
    let context = Context::new(None, wish).expect("a device that draws and traces");
    let set_layout = render::set_layout(&context, scene.textures.len() as u32).unwrap();
    let cache = PipelineCache::new(&context, &[]).unwrap();
    let pipeline = render::pipeline(&context, set_layout, &cache).unwrap();
    let world = DeviceScene::new(&context, set_layout, &scene).unwrap();
    let rasterizer = Rasterizer::new(&world, &scene).unwrap();
    let pictures = SIZES.map(|(width, height)| {
        let settings = Settings {
            width,
            height,
            first_row: 0,
            rows: height,
            first_column: width / 2,
            spp: SAMPLES,
            bounces: BOUNCES,
            frame: 0,
        };
        let renderer = Renderer::new(&world, &pipeline, &scene, &scene.camera, settings).unwrap();
        let drawing = Drawing::new(&rasterizer, &renderer).unwrap();
        let area = vk::Rect2D::default().extent(vk::Extent2D {
            width: width / 2,
            height,
        });
        let drawn = drawing.radiance(area).unwrap();
        let mut radiance = renderer.render(|_| ()).unwrap().radiance;
        let lines = radiance.chunks_exact_mut(width as usize);
        for (line, drawn) in lines.zip(drawn.chunks_exact(width as usize / 2)) {
            line[..drawn.len()].copy_from_slice(drawn);
        }
        encoded(&radiance, scene.exposure)
    });
    drop(rasterizer);
    drop(world);
    drop(pipeline);
    drop(cache);
    // SAFETY: the pipelines and the sets that were made of it are gone.
    unsafe {
        context
            .device
            .destroy_descriptor_set_layout(set_layout, None)
    };
    pictures
}

/// The window's program.
fn program(display: &str) -> Command {
    let mut program = Command::new(env!("CARGO_BIN_EXE_window"));
    program
        .env("DISPLAY", display)
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET");
    program
}

/// The number that stands before the others, and the rest of the text.
fn number(text: &str) -> (u32, &str) {
    let text = text.trim_start_matches(|c: char| !c.is_ascii_digit());
    let end = text.find(|c: char| !c.is_ascii_digit());
    let (digits, rest) = text.split_at(end.unwrap_or(text.len()));
    (digits.parse().expect("a number"), rest)
}

/// Where the panel lies, in pixels.
struct Panel {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Panel {
    /// As the program tells it once a picture is done: the next line.
    fn read(lines: &mut impl BufRead, size: (u32, u32)) -> Panel {
        let mut told = String::new();
        lines.read_line(&mut told).unwrap();
        print!("{told}");
        let about = format!("window: {}x{}, {SAMPLES} samples", size.0, size.1);
        assert!(told.starts_with(&about), "{told}");
        let rest = told.split("panel at").nth(1).expect("the panel's place");
        let (x, rest) = number(rest);
        let (y, rest) = number(rest);
        let (width, rest) = number(rest);
        let (height, _) = number(rest);
        // Nearly all columns of the right half are outside the panel, and many rows of the left
        // one.
        assert!(x + width < size.0 * 3 / 4 && y + height < size.1);
        Panel {
            x,
            y,
            width,
            height,
        }
    }

    fn covers(&self, column: u32, row: u32) -> bool {
        (self.x.saturating_sub(EDGE)..self.x + self.width + EDGE).contains(&column)
            && (self.y.saturating_sub(EDGE)..self.y + self.height + EDGE).contains(&row)
    }

    /// Waits until the screen shows a picture with the panel before it.
    fn comes_before(&self, screen: &Window, (width, height): (u32, u32), picture: &[u8]) {
        let mut differs = String::new();
        let is_there = comes(|| {
            let shown = screen.screenshot(width as u16, height as u16);
            let mut worst = [0; 2];
            let mut over_the_panel = 0;
            // The test's own window covers the first pixel.
            for index in 1..width * height {
                let (column, row) = (index % width, index / width);
                let pixel = &shown[4 * index as usize..][..3];
                let wanted = &picture[3 * index as usize..][..3];
                // The screen has blue first.
                let off = (0..3).map(|i| pixel[2 - i].abs_diff(wanted[i])).max();
                let off = off.unwrap_or(0);
                if self.covers(column, row) {
                    over_the_panel += u32::from(off > TOLERANCE);
                } else {
                    let half = usize::from(column >= width / 2);
                    worst[half] = off.max(worst[half]);
                }
            }
            // Most of the panel is something else than the picture.
            let has_panel = over_the_panel > self.width * self.height / 2;
            differs = format!(
                "codes off, left and right of the split: {worst:?}; of the panel: {over_the_panel}"
            );
            has_panel && worst.iter().all(|worst| *worst <= TOLERANCE)
        });
        println!("{differs}");
        assert!(is_there, "{differs}");
    }
}

/// The program's windows, by their name.
fn all_named_tuff(screen: &Window) -> Vec<u32> {
    let (name, text) = (AtomEnum::WM_NAME, AtomEnum::ANY);
    let root = screen.x.setup().roots[0].root;
    let children = screen.x.query_tree(root).unwrap().reply().unwrap().children;
    let is_it = |window: &u32| {
        let property = screen.x.get_property(false, *window, name, text, 0, 16);
        (property.unwrap().reply()).is_ok_and(|property| property.value == b"Tuff")
    };
    children.into_iter().filter(is_it).collect()
}

/// The program's window, which is the only one.
fn named_tuff(screen: &Window) -> u32 {
    let found = all_named_tuff(screen);
    assert_eq!(found.len(), 1, "{found:?}");
    found[0]
}

/// How a program ends that has been asked to.
fn end_of(program: &mut Child) -> ExitStatus {
    let mut ended = None;
    comes(|| {
        ended = program.try_wait().unwrap();
        ended.is_some()
    });
    ended.unwrap_or_else(|| {
        program.kill().unwrap();
        panic!("it goes on")
    })
}

/// Asks a window to close, as a window manager does when its cross is clicked.
fn ask_to_close(screen: &Window, window: u32) {
    let atom = |name: &str| {
        let atom = screen.x.intern_atom(false, name.as_bytes());
        atom.unwrap().reply().unwrap().atom
    };
    let (protocols, delete) = (atom("WM_PROTOCOLS"), atom("WM_DELETE_WINDOW"));
    let message = ClientMessageEvent::new(32, window, protocols, [delete, 0, 0, 0, 0]);
    (screen
        .x
        .send_event(false, window, EventMask::NO_EVENT, message))
    .unwrap();
    screen.x.sync().unwrap();
}

#[test]
fn the_window_shows_what_is_computed_off_screen() {
    let Some(server) = Xvfb::start(&[]) else {
        return;
    };
    let [first, smaller] = SIZES;
    let pictures = off_screen();
    let mut window = program(&server.display)
        .args(["--size", &format!("{}x{}", first.0, first.1)])
        .args(["--spp", &SAMPLES.to_string()])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(window.stdout.take().unwrap());
    let panel = Panel::read(&mut lines, first);
    let screen = server.window(1, 1);
    panel.comes_before(&screen, first, &pictures[0]);

    let shown = named_tuff(&screen);
    let size = ConfigureWindowAux::new().width(smaller.0).height(smaller.1);
    screen.x.configure_window(shown, &size).unwrap();
    screen.x.sync().unwrap();
    let panel = Panel::read(&mut lines, smaller);
    panel.comes_before(&screen, smaller, &pictures[1]);

    // A hidden window returns unchanged.
    let shot = || screen.screenshot(smaller.0 as u16, smaller.1 as u16);
    let before = shot();
    screen.x.unmap_window(shown).unwrap();
    screen.x.sync().unwrap();
    std::thread::sleep(Duration::from_millis(200));
    assert_ne!(shot(), before);
    screen.x.map_window(shown).unwrap();
    screen.x.sync().unwrap();
    panel.comes_before(&screen, smaller, &pictures[1]);

    ask_to_close(&screen, shown);
    assert!(end_of(&mut window).success());
}

#[test]
fn a_window_that_is_closed_before_its_frames_were_shown_fails() {
    let Some(server) = Xvfb::start(&[]) else {
        return;
    };
    let mut window = program(&server.display)
        .args(["--size", "480x270", "--spp", "1", "--frames", "1000000"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = String::new();
    (BufReader::new(window.stdout.take().unwrap()).read_line(&mut told)).unwrap();
    let screen = server.window(1, 1);
    ask_to_close(&screen, named_tuff(&screen));
    assert!(!end_of(&mut window).success());
    let said = std::io::read_to_string(window.stderr.take().unwrap()).unwrap();
    assert!(said.contains("of 1000000 frames were presented"), "{said}");
}

#[test]
fn without_a_display_it_says_so() {
    for display in ["", ":9999"] {
        let ended = program(display).args(["--frames", "1"]).output().unwrap();
        assert!(!ended.status.success());
        let said = String::from_utf8(ended.stderr).unwrap();
        assert!(
            said.starts_with("error: no window can be opened: "),
            "{said}"
        );
        assert_eq!(said.lines().count(), 1, "{said}");
        // No place in a library's source, which does not help a person who wants a window.
        assert!(!said.contains(".rs"), "{said}");
    }
}

#[test]
fn a_window_that_cannot_show_its_frames_fails() {
    let Some(server) = Xvfb::start(&[]) else {
        return;
    };
    let mut window = program(&server.display)
        .args(["--size", "64x64", "--frames", "1000000"])
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let screen = server.window(1, 1);
    assert!(comes(|| !all_named_tuff(&screen).is_empty()));
    drop(screen);
    drop(server);
    assert!(!window.wait().unwrap().success());
}
