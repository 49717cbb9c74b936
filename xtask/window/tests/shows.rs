//! What the window shows is what the demo computes off screen: the rasterized picture left of the
//! split, the traced one right of it.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use ash::vk;
use demo::picture::encoded;
use demo::raster::{Drawing, Rasterizer};
use demo::render::{self, BOUNCES, Renderer, Settings, World};
use demo::scene::Scene;
use demo::vulkan::{Context, PipelineCache, Wish};
use tuff_tests::Xvfb;

const WIDTH: u32 = 480;
const HEIGHT: u32 = 270;
const SAMPLES: u32 = 2;
/// The same light is encoded by a shader in the window and by a table off screen: where it lies
/// between two codes, either may come out.
const TOLERANCE: u8 = 1;
/// How far the panel's edge reaches beyond its rectangle, in pixels.
const EDGE: u32 = 2;

/// Red, green and blue of each pixel of the picture, row by row, computed without a window.
fn off_screen() -> Vec<u8> {
    let scene = Scene::landscape();
    let wish = Wish {
        draws: true,
        ..Default::default()
    };
    let context = Context::new(None, wish).expect("a device that draws and traces");
    let settings = Settings {
        width: WIDTH,
        height: HEIGHT,
        first_row: 0,
        rows: HEIGHT,
        first_column: WIDTH / 2,
        spp: SAMPLES,
        bounces: BOUNCES,
        frame: 0,
    };
    let set_layout = render::set_layout(&context, scene.textures.len() as u32).unwrap();
    let cache = PipelineCache::new(&context, &[]).unwrap();
    let pipeline = render::pipeline(&context, set_layout, &cache).unwrap();
    let world = World::new(&context, set_layout, &scene).unwrap();
    let renderer = Renderer::new(&world, &pipeline, &scene, &scene.camera, settings).unwrap();
    let rasterizer = Rasterizer::new(&world, &scene).unwrap();
    let drawing = Drawing::new(&rasterizer, &renderer).unwrap();
    let area = vk::Rect2D::default().extent(vk::Extent2D {
        width: WIDTH / 2,
        height: HEIGHT,
    });
    let drawn = drawing.radiance(area).unwrap();
    let mut radiance = renderer.render(|_| ()).unwrap().radiance;
    let lines = radiance.chunks_exact_mut(WIDTH as usize);
    for (line, drawn) in lines.zip(drawn.chunks_exact(WIDTH as usize / 2)) {
        line[..drawn.len()].copy_from_slice(drawn);
    }
    drop(drawing);
    drop(rasterizer);
    drop(renderer);
    drop(world);
    drop(pipeline);
    drop(cache);
    // SAFETY: the pipelines and the sets that were made of it are gone.
    unsafe {
        context
            .device
            .destroy_descriptor_set_layout(set_layout, None)
    };
    encoded(&radiance, scene.exposure)
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

#[test]
fn the_window_shows_what_is_computed_off_screen() {
    let Some(server) = Xvfb::start(&[]) else {
        return;
    };
    let expected = off_screen();
    let mut window = program(&server.display)
        .args(["--size", &format!("{WIDTH}x{HEIGHT}")])
        .args(["--spp", &SAMPLES.to_string()])
        .args(["--frames", "600"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = String::new();
    BufReader::new(window.stdout.take().unwrap())
        .read_line(&mut told)
        .unwrap();
    print!("{told}");
    let rest = told
        .split("panel at")
        .nth(1)
        .expect("it tells of the panel");
    let (x, rest) = number(rest);
    let (y, rest) = number(rest);
    let (width, rest) = number(rest);
    let (height, _) = number(rest);
    assert!(told.contains(&format!("{SAMPLES} samples")), "{told}");

    let is_panel = |column: u32, row: u32| {
        (x.saturating_sub(EDGE)..x + width + EDGE).contains(&column)
            && (y.saturating_sub(EDGE)..y + height + EDGE).contains(&row)
    };
    // Nearly all columns of the right half are outside the panel, and many rows of the left one.
    assert!(x + width < WIDTH * 3 / 4 && y + height < HEIGHT);
    let screen = server.window(1, 1);
    let started = Instant::now();
    loop {
        let shown = screen.screenshot(WIDTH as u16, HEIGHT as u16);
        let mut worst = [0; 2];
        let mut over_the_panel = 0;
        // The test's own window covers the first pixel.
        for index in 1..WIDTH * HEIGHT {
            let (column, row) = (index % WIDTH, index / WIDTH);
            let pixel = &shown[4 * index as usize..][..3];
            let wanted = &expected[3 * index as usize..][..3];
            // The screen has blue first.
            let off = (0..3).map(|i| pixel[2 - i].abs_diff(wanted[i])).max();
            let off = off.unwrap_or(0);
            if is_panel(column, row) {
                over_the_panel += u32::from(off > TOLERANCE);
            } else {
                let half = usize::from(column >= WIDTH / 2);
                worst[half] = off.max(worst[half]);
            }
        }
        if worst.iter().all(|worst| *worst <= TOLERANCE) {
            println!("codes off: {worst:?}; {over_the_panel} pixels of the panel differ");
            // Most of the panel is something else than the picture.
            assert!(over_the_panel > width * height / 2);
            break;
        }
        assert!(
            started.elapsed() < Duration::from_secs(5),
            "codes off, left and right of the split: {worst:?}"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(window.wait().unwrap().success());
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
    std::thread::sleep(Duration::from_secs(3));
    drop(server);
    assert!(!window.wait().unwrap().success());
}
