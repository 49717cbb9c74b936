//! The picture so far: it is drawn and traced in bands, each within a few hundredths of a second,
//! so that the window stays responsive.

use std::time::{Duration, Instant};

use anyhow::Result;
use ash::vk;
use demo::raster::{Drawing, Rasterizer};
use demo::render::{DeviceScene, Renderer, Settings};
use demo::scene::{Camera, Scene};
use demo::vulkan::{Context, Pipeline, change_layout};

/// How long one band is to take.
const BAND: Duration = Duration::from_millis(30);
/// The sides of the small picture that is shown at once are this part of the window's.
const SMALLER: u32 = 4;

/// The resources of every picture of a scene.
pub struct Studio<'a> {
    pub context: &'a Context,
    pub scene: &'a Scene,
    pub world: &'a DeviceScene<'a>,
    pub pipeline: &'a Pipeline<'a>,
    pub rasterizer: &'a Rasterizer<'a>,
    /// Of the animation.
    pub frame: u16,
}

/// The parameters whose change restarts the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    pub camera: Camera,
    pub bounces: u32,
    /// The first column that is traced.
    pub split: u32,
}

/// How much is done in a second.
struct Pace(f64);

impl Pace {
    /// How many rows of `width` pixels a band has, of those that are left.
    fn rows(&self, width: u32, left: u32) -> u32 {
        let rows = self.0 * BAND.as_secs_f64() / f64::from(width.max(1));
        (rows as u32).clamp(1, left)
    }

    fn measured(&mut self, width: u32, rows: u32, seconds: f64) {
        let pixels = f64::from(width) * f64::from(rows);
        // Half of what was: one band may meet nothing but sky.
        self.0 = 0.5 * self.0 + 0.5 * pixels / seconds.max(1e-6);
    }
}

/// One size of the picture, drawn and traced.
struct Layer<'a> {
    renderer: Renderer<'a>,
    drawing: Drawing<'a, 'a>,
}

impl<'a> Layer<'a> {
    fn new(studio: &Studio<'a>, size: (u32, u32), sight: &Sight) -> Result<Layer<'a>> {
        let (width, height) = size;
        let settings = Settings {
            width,
            height,
            first_row: 0,
            rows: height,
            first_column: 0,
            spp: 1,
            bounces: sight.bounces,
            frame: studio.frame,
        };
        let (world, scene) = (studio.world, studio.scene);
        let renderer = Renderer::new(world, studio.pipeline, scene, &sight.camera, settings)?;
        let drawing = Drawing::new(studio.rasterizer, &renderer)?;
        // It can be bound before anything is drawn.
        studio.context.run(|commands| {
            let image = (drawing.color.image, drawing.color.aspect);
            let read = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
            change_layout(
                studio.context,
                commands,
                image,
                vk::ImageLayout::UNDEFINED,
                read,
            );
        })?;
        Ok(Layer { renderer, drawing })
    }

    fn look(&mut self, scene: &Scene, sight: &Sight, first_column: u32) -> Result<()> {
        self.renderer.settings.bounces = sight.bounces;
        self.renderer.settings.first_column = first_column;
        self.renderer.look(scene, &sight.camera)
    }
}

/// The picture of one size of the window, as far as it is done.
pub struct Progress<'a> {
    context: &'a Context,
    scene: &'a Scene,
    pub size: (u32, u32),
    pub small_size: (u32, u32),
    whole: Layer<'a>,
    small: Layer<'a>,
    pub sight: Sight,
    small_is_done: bool,
    /// Whether the objects left of the split are known.
    is_seen: bool,
    /// Rows that are drawn left of the split.
    pub drawn_rows: u32,
    /// Samples of every pixel right of the split,
    pub samples: u32,
    /// and rows that have one more.
    next_row: u32,
    drawing_pace: Pace,
    tracing_pace: Pace,
    /// The time that the samples took.
    tracing_seconds: f64,
    /// Rays a second, of the last whole sample of every pixel; 0 before it.
    pub rays_per_second: f64,
}

impl<'a> Progress<'a> {
    pub fn new(studio: &Studio<'a>, size: (u32, u32), sight: Sight) -> Result<Progress<'a>> {
        let small_size = (size.0.div_ceil(SMALLER), size.1.div_ceil(SMALLER));
        let mut progress = Progress {
            context: studio.context,
            scene: studio.scene,
            size,
            small_size,
            whole: Layer::new(studio, size, &sight)?,
            small: Layer::new(studio, small_size, &sight)?,
            sight,
            small_is_done: false,
            is_seen: false,
            drawn_rows: 0,
            samples: 0,
            next_row: 0,
            drawing_pace: Pace(1e6),
            tracing_pace: Pace(1e6),
            tracing_seconds: 0.0,
            rays_per_second: 0.0,
        };
        progress.start(sight)?;
        Ok(progress)
    }

    /// Restarts; no frame may be in flight.
    pub fn start(&mut self, sight: Sight) -> Result<()> {
        self.whole.look(self.scene, &sight, sight.split)?;
        self.small.look(self.scene, &sight, 0)?;
        // The small picture has both halves whole: it need not know of the split.
        let old = std::mem::replace(&mut self.sight, sight);
        self.small_is_done &= Sight {
            split: sight.split,
            ..old
        } == sight;
        self.is_seen = false;
        self.drawn_rows = 0;
        self.samples = 0;
        self.next_row = 0;
        self.tracing_seconds = 0.0;
        Ok(())
    }

    /// Rows right of the split that have a sample.
    pub fn traced_rows(&self) -> u32 {
        match self.samples {
            0 => self.next_row,
            _ => self.size.1,
        }
    }

    /// Whether all is done, with so many samples.
    pub fn is_done(&self, spp: u32) -> bool {
        let (width, height) = self.size;
        let split = self.sight.split;
        let drawn = split == 0 || self.drawn_rows == height;
        self.small_is_done && drawn && (split >= width || self.samples >= spp)
    }

    /// Does one band more, if there is one.
    pub fn advance(&mut self, spp: u32) -> Result<()> {
        let (width, height) = self.size;
        let split = self.sight.split;
        let context = self.context;
        let area = |first_row: u32, width: u32, rows: u32| vk::Rect2D {
            offset: vk::Offset2D {
                x: 0,
                y: first_row as i32,
            },
            extent: vk::Extent2D {
                width,
                height: rows,
            },
        };
        if !self.small_is_done {
            let (width, height) = self.small_size;
            context.run(|commands| {
                self.small.drawing.record(commands, area(0, width, height));
                self.small.renderer.record_sample(commands, (0, 0, height));
            })?;
            self.small_is_done = true;
        } else if split > 0 && !self.is_seen {
            let whole = area(0, split, height);
            context.run(|commands| self.whole.drawing.record_seen(commands, whole))?;
            self.is_seen = true;
        } else if split > 0 && self.drawn_rows < height {
            let rows = self.drawing_pace.rows(split, height - self.drawn_rows);
            let started = Instant::now();
            let band = area(self.drawn_rows, split, rows);
            let is_first = self.drawn_rows == 0;
            context.run(|commands| {
                let drawing = &self.whole.drawing;
                drawing.record_shading(commands, band, is_first);
            })?;
            let seconds = started.elapsed().as_secs_f64();
            self.drawing_pace.measured(split, rows, seconds);
            self.drawn_rows += rows;
        } else if split < width && self.samples < spp {
            let rows = (self.tracing_pace).rows(width - split, height - self.next_row);
            let started = Instant::now();
            let step = (self.samples, self.next_row, rows);
            context.run(|commands| self.whole.renderer.record_sample(commands, step))?;
            let seconds = started.elapsed().as_secs_f64();
            self.tracing_pace.measured(width - split, rows, seconds);
            self.tracing_seconds += seconds;
            self.next_row += rows;
            if self.next_row == height {
                self.next_row = 0;
                self.samples += 1;
                self.rays_per_second = self.whole.renderer.rays()? as f64 / self.tracing_seconds;
            }
        }
        Ok(())
    }

    /// Sums of the traced picture: of the whole one and of the small one.
    pub fn traced(&self) -> [vk::Buffer; 2] {
        [&self.whole, &self.small].map(|layer| layer.renderer.radiance.handle)
    }

    /// The drawn views, likewise.
    pub fn drawn(&self) -> [vk::ImageView; 2] {
        [&self.whole, &self.small].map(|layer| layer.drawing.color.view)
    }
}
