//! The demo's picture in a window: rasterized on the left, path-traced on the right, better with
//! every sample.
//!
//! The mouse looks around, W, A, S, D, Q, E and the arrow keys move (faster with shift), R goes
//! back to where it began, Escape ends it.

mod app;
mod flight;
mod overlay;
mod panel;
mod progress;
mod show;
mod surface;
mod swapchain;

use std::panic;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result, anyhow, ensure};
use clap::Parser;
use demo::limits;
use demo::raster::Rasterizer;
use demo::render::{self, DeviceScene};
use demo::scene::Scene;
use demo::vulkan::{Context, PipelineCache, Wish};
use winit::event_loop::EventLoop;

use app::{App, WindowOptions};
use progress::Studio;

#[derive(Parser)]
#[command(about = "Renders a picture by ray tracing through Vulkan, in a window")]
struct Arguments {
    /// Size of the picture in pixels at first, 16384 a side at most
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = limits::parse_size)]
    size: (u32, u32),
    /// Samples per pixel after which the picture is done, 1 to 65536
    #[arg(long, value_name = "N", default_value_t = 65536, value_parser = limits::parse_spp)]
    spp: u32,
    /// End once so many pictures were presented
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Which frame, of 24 a second: the lake's waves move
    #[arg(long, value_name = "K", default_value_t = 0)]
    frame: u16,
    /// Threads to use: here, and in the driver by TUFF_THREADS
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// A glTF scene (.glb or .gltf) to render instead of the landscape
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// The driver to open where there is no Vulkan loader
    #[arg(long, value_name = "LIBRARY")]
    driver: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<()> {
    let arguments = Arguments::parse();
    for file in [&arguments.driver, &arguments.scene].into_iter().flatten() {
        ensure!(file.exists(), "there is no {}", file.display());
    }
    if let Some(threads) = arguments.threads {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("TUFF_THREADS", threads.to_string()) };
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads as usize)
            .build_global()?;
    }
    let events = event_loop()?;
    let extensions = surface::extensions(&events)?;
    let make_scene = || match &arguments.scene {
        Some(path) => Scene::from_gltf(path),
        None => Ok(Scene::landscape()),
    };
    let wish = Wish {
        draws: true,
        windows: &extensions,
    };
    let start_vulkan = || Context::new(arguments.driver.as_deref(), wish);
    let (scene, context) = rayon::join(make_scene, start_vulkan);
    let (scene, context) = (scene?, context?);
    ensure!(!scene.instances.is_empty(), "the scene is empty");

    let set_layout = render::set_layout(&context, scene.textures.len() as u32)?;
    let cache = PipelineCache::new(&context, &[])?;
    let pipeline = render::pipeline(&context, set_layout, &cache)?;
    let world = DeviceScene::new(&context, set_layout, &scene)?;
    let rasterizer = Rasterizer::new(&world, &scene)?;
    let studio = Studio {
        context: &context,
        scene: &scene,
        world: &world,
        pipeline: &pipeline,
        rasterizer: &rasterizer,
        frame: arguments.frame,
    };
    let order = WindowOptions {
        size: arguments.size,
        spp: arguments.spp,
        frames: arguments.frames,
    };
    let mut app = App::new(studio, order)?;
    events.run_app(&mut app).context("the window's events")?;
    let done = app.finish();
    drop((rasterizer, world, pipeline, cache));
    // SAFETY: the pipelines and the sets that were made of it are gone.
    unsafe {
        context
            .device
            .destroy_descriptor_set_layout(set_layout, None)
    };
    done
}

/// A connection to the display.
///
/// # Errors
/// The missing requirement, in one line: winit reports some by a panic.
fn event_loop() -> Result<EventLoop<()>> {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let made = panic::catch_unwind(EventLoop::new);
    panic::set_hook(hook);
    let why = match made {
        Ok(Ok(events)) => return Ok(events),
        Ok(Err(winit::error::EventLoopError::Os(error))) => {
            let text = error.to_string();
            // "os error at FILE:LINE: ...", of winit's own source.
            match text.strip_prefix("os error at ") {
                Some(placed) => placed
                    .split_once(": ")
                    .map_or(placed, |(_, why)| why)
                    .into(),
                None => text,
            }
        }
        Ok(Err(error)) => error.to_string(),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| text.to_string()));
            text.unwrap_or_default()
        }
    };
    Err(anyhow!("no window can be opened: {why}"))
}
