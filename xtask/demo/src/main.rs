//! A progressive path tracer, written as an ordinary Vulkan application.
//!
//! It does not depend on a driver: it uses the system's Vulkan loader, or opens the given driver
//! where there is none.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use ash::vk;
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};

use demo::limits::{self, Tile};
use demo::raster::{Drawing, Rasterizer};
use demo::render::{self, DeviceScene, Renderer, Settings};
use demo::scene::Scene;
use demo::{picture, vulkan};

#[derive(Parser)]
#[command(about = "Renders a picture by ray tracing through Vulkan")]
struct Arguments {
    /// Size of the picture in pixels, 16384 a side at most
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = limits::parse_size)]
    size: (u32, u32),
    /// Samples per pixel, 1 to 65536
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = limits::parse_spp)]
    spp: u32,
    /// Render only band I (from 0) of N equal ones, into a picture of its own: laid below each
    /// other in order, they are the whole
    #[arg(long, value_name = "I/N", value_parser = limits::parse_tile)]
    tile: Option<Tile>,
    /// Which frame, of 24 a second: the lake's waves move
    #[arg(long, value_name = "K", default_value_t = 0)]
    frame: u16,
    /// Threads to use: here, and in the driver by TUFF_THREADS
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// The PNG file to write
    #[arg(long, value_name = "FILE", default_value = "target/demo.png")]
    out: PathBuf,
    /// A glTF scene (.glb or .gltf) to render instead of the landscape
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Rasterize the left half, with shadows and mirrors by ray queries, and trace paths in the
    /// right half
    #[arg(long)]
    compare: bool,
    /// A file to keep compiled shaders in
    #[arg(long, value_name = "FILE")]
    pipeline_cache: Option<PathBuf>,
    /// The driver to open where there is no Vulkan loader
    #[arg(long, value_name = "LIBRARY")]
    driver: Option<PathBuf>,
}

fn main() -> Result<()> {
    let launched = Instant::now();
    let arguments = Arguments::parse();
    limits::try_out(&arguments.out).map_err(anyhow::Error::msg)?;
    for file in [&arguments.driver, &arguments.scene].into_iter().flatten() {
        ensure!(file.exists(), "there is no {}", file.display());
    }
    let (width, height) = arguments.size;
    let (first_row, rows) = (arguments.tile).map_or((0, height), |tile| tile.rows(height));
    ensure!(
        rows > 0,
        "there are more tiles than rows: this one has none"
    );
    let (scene, context) = start(&arguments)?;
    let first_column = match arguments.compare {
        true => width / 2,
        false => 0,
    };
    let settings = Settings {
        width,
        height,
        first_row,
        rows,
        first_column,
        spp: arguments.spp,
        bounces: render::BOUNCES,
        frame: arguments.frame,
    };

    let set_layout = render::set_layout(&context, scene.textures.len() as u32)?;
    let pipeline = make_pipeline(&context, set_layout, arguments.pipeline_cache.as_deref())?;
    let world = DeviceScene::new(&context, set_layout, &scene)?;
    let renderer = Renderer::new(&world, &pipeline, &scene, &scene.camera, settings)?;
    eprintln!(
        "{}: {} triangles, {} with instances, {} instances, {} textures",
        context.name,
        scene.triangle_count(),
        scene.instanced_triangle_count(),
        scene.instances.len(),
        scene.textures.len(),
    );
    let left = match first_column > 0 {
        true => rasterize_left(&world, &scene, &renderer, settings)?,
        false => Vec::new(),
    };
    let bar = ProgressBar::new(
        u64::from(width - first_column) * u64::from(rows) * u64::from(arguments.spp),
    );
    let style = "{bar:40} {percent:>3} %  {elapsed} of about {duration}";
    bar.set_style(ProgressStyle::with_template(style)?);
    let mut rendering = renderer.render(|pixels| bar.inc(pixels))?;
    bar.finish_and_clear();
    if first_column > 0 {
        let lines = rendering.radiance.chunks_exact_mut(width as usize);
        lay_left(lines, left.chunks_exact(first_column as usize));
    }
    let (size, exposure) = ((width, rows), scene.exposure);
    picture::write_png(&arguments.out, size, &rendering.radiance, exposure)
        .context("the picture")?;
    drop(renderer);
    drop(world);
    drop(pipeline);
    // SAFETY: the pipeline and the set that were made of it are gone.
    unsafe {
        context
            .device
            .destroy_descriptor_set_layout(set_layout, None)
    };
    println!(
        "demo: {width}x{rows}, {} spp, {} rays, first pixel {:.2} s, {:.1} Mrays/s, {}",
        arguments.spp,
        rendering.rays,
        (rendering.first_pixel - launched).as_secs_f64(),
        rendering.rays as f64 / rendering.seconds / 1e6,
        arguments.out.display(),
    );
    Ok(())
}

/// The scene, and Vulkan, with the threads that the arguments allow.
fn start(arguments: &Arguments) -> Result<(Scene, vulkan::Context)> {
    if let Some(threads) = arguments.threads {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("TUFF_THREADS", threads.to_string()) };
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads as usize)
            .build_global()?;
    }
    let make_scene = || match &arguments.scene {
        Some(path) => Scene::from_gltf(path),
        None => Ok(Scene::landscape()),
    };
    let start_vulkan = || {
        let wish = vulkan::Wish {
            draws: arguments.compare,
            ..Default::default()
        };
        vulkan::Context::new(arguments.driver.as_deref(), wish)
    };
    let (scene, context) = rayon::join(make_scene, start_vulkan);
    let (scene, context) = (scene?, context?);
    ensure!(!scene.instances.is_empty(), "the scene is empty");
    Ok((scene, context))
}

/// Lays drawn lines over the first columns of traced ones.
fn lay_left<'l>(
    lines: impl Iterator<Item = &'l mut [[f32; 4]]>,
    drawn: impl Iterator<Item = &'l [[f32; 4]]>,
) {
    for (line, drawn) in lines.zip(drawn) {
        line[..drawn.len()].copy_from_slice(drawn);
    }
}

/// The columns that are drawn instead of traced, for a comparison.
fn rasterize_left(
    world: &DeviceScene,
    scene: &Scene,
    renderer: &Renderer,
    settings: Settings,
) -> Result<Vec<[f32; 4]>> {
    let rasterizer = Rasterizer::new(world, scene)?;
    let drawing = Drawing::new(&rasterizer, renderer)?;
    let (width, height) = (settings.first_column, settings.rows);
    let area = vk::Rect2D::default()
        .offset(vk::Offset2D::default().y(settings.first_row as i32))
        .extent(vk::Extent2D { width, height });
    let started = Instant::now();
    let pixels = drawing.radiance(area)?;
    eprintln!(
        "{width}x{height} rasterized in {:.2} s",
        started.elapsed().as_secs_f64()
    );
    Ok(pixels)
}

/// The pipeline, by way of a cache file if there is to be one.
fn make_pipeline<'a>(
    context: &'a vulkan::Context,
    set_layout: ash::vk::DescriptorSetLayout,
    file: Option<&Path>,
) -> Result<vulkan::Pipeline<'a>> {
    let known = file.and_then(|file| std::fs::read(file).ok());
    let known = known.unwrap_or_default();
    let started = Instant::now();
    let cache = vulkan::PipelineCache::new(context, &known)?;
    let pipeline = render::pipeline(context, set_layout, &cache)?;
    let seconds = started.elapsed().as_secs_f64();
    if let Some(file) = file {
        let data = cache.data()?;
        eprintln!(
            "pipeline: {:.1} ms with {} bytes in the cache, {} bytes now",
            seconds * 1e3,
            known.len(),
            data.len()
        );
        std::fs::write(file, data).with_context(|| format!("writing {}", file.display()))?;
    }
    Ok(pipeline)
}
