//! Every format that both drivers have: sampled, fetched, stored, blended and blitted.
//!
//! A format is measured in a process of its own, cell by cell. A cell is an access and a shape of
//! image; one shader serves all cells, by defines. The result of a cell is summed over blocks of
//! pixels, and the sums of the drivers are compared.

mod compare;
mod prepare;
mod table;

use anyhow::{Context, Result, ensure};
pub use compare::compare;
use serde::{Deserialize, Serialize};
use tuff_tests::Gpu;

use crate::usage::processor_seconds;

/// Accesses of an invocation.
const TURNS: u32 = 16;
/// Pixels of the picture's width.
const WIDTH: u32 = 256;
/// Pixels of its height.
const HEIGHT: u32 = 128;

/// An operation on texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Access {
    Fetch,
    Nearest,
    Linear,
    Trilinear,
    Gather,
    Shadow,
    Store,
    Blend,
    Blit,
}

pub const ACCESSES: [Access; 9] = [
    Access::Fetch,
    Access::Nearest,
    Access::Linear,
    Access::Trilinear,
    Access::Gather,
    Access::Shadow,
    Access::Store,
    Access::Blend,
    Access::Blit,
];

impl Access {
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Whether results are the same in every driver, up to a rounding.
    fn is_exact(self) -> bool {
        matches!(self, Access::Fetch | Access::Nearest | Access::Gather)
    }

    /// Shapes that are measured.
    fn shapes(self) -> &'static [Shape] {
        use Shape::{Array, Cube, Flat, Volume};
        match self {
            Access::Fetch => &[Flat, Volume, Array],
            Access::Nearest | Access::Linear | Access::Trilinear => &[Flat, Volume, Cube, Array],
            Access::Gather | Access::Shadow => &[Flat, Cube, Array],
            Access::Store | Access::Blend | Access::Blit => &[Flat],
        }
    }
}

/// The shape of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Shape {
    Flat,
    Volume,
    Cube,
    Array,
}

pub const SHAPES: [Shape; 4] = [Shape::Flat, Shape::Volume, Shape::Cube, Shape::Array];

impl Shape {
    pub fn name(self) -> &'static str {
        match self {
            Shape::Flat => "2D",
            Shape::Volume => "3D",
            Shape::Cube => "cube",
            Shape::Array => "array",
        }
    }
}

/// A measured cell of a format.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cell {
    pub access: Access,
    pub shape: Shape,
    /// Processor time of the fastest turn.
    pub seconds: f64,
    /// Means over blocks of pixels, four components each.
    pub means: Vec<f32>,
}

/// A format on the one driver that this process sees.
#[derive(Debug, Serialize, Deserialize)]
pub struct Measured {
    pub driver: String,
    pub cells: Vec<Cell>,
}

#[derive(clap::Args)]
pub struct Options {
    /// The format's name, without `VK_FORMAT_`
    format: String,
    /// Turns to time, after one that is not
    #[arg(long, default_value_t = 4)]
    turns: usize,
    /// Only these accesses
    #[arg(long, value_name = "ACCESS", value_delimiter = ',')]
    accesses: Vec<String>,
}

/// Prints a [`Measured`] as JSON.
pub fn measure(options: &Options) -> Result<()> {
    let row = table::ALL.iter().find(|row| row.name() == options.format);
    let row = row.with_context(|| format!("there is no format «{}»", options.format))?;
    let gpu = Gpu::without_validation();
    let mut cells = Vec::new();
    let wanted =
        |access: &Access| options.accesses.is_empty() || options.accesses.contains(&access.name());
    for access in ACCESSES.into_iter().filter(wanted) {
        for &shape in access.shapes() {
            let Some(prepared) = prepare::prepare(&gpu, row, access, shape) else {
                continue;
            };
            let name = || format!("{} {} of {}", access.name(), shape.name(), row.name());
            gpu.submit(prepared.turn).with_context(name)?;
            let mut seconds = f64::INFINITY;
            for _ in 0..options.turns {
                let before = processor_seconds();
                gpu.submit(prepared.turn).with_context(name)?;
                seconds = seconds.min(processor_seconds() - before);
            }
            if let Some(look) = prepared.look {
                gpu.submit(look).with_context(name)?;
            }
            cells.push(Cell {
                access,
                shape,
                seconds,
                means: means(&prepared.picture.read()),
            });
        }
    }
    let driver = gpu.name();
    println!("{}", serde_json::to_string(&Measured { driver, cells })?);
    Ok(())
}

/// Means over blocks of 16 pixels' rows.
fn means(pixels: &[[f32; 4]]) -> Vec<f32> {
    let blocks = pixels.chunks((16 * WIDTH / 4) as usize);
    let mean = |block: &[[f32; 4]]| {
        let sum = |component: usize| -> f64 {
            block.iter().map(|pixel| f64::from(pixel[component])).sum()
        };
        [0, 1, 2, 3].map(|component| (sum(component) / block.len() as f64) as f32)
    };
    blocks.flat_map(mean).collect()
}

/// Why two drivers' results of a cell count as different.
fn disagreement(format: &str, a: &Cell, b: &Cell) -> Result<()> {
    let apart: f64 = a
        .means
        .iter()
        .zip(&b.means)
        .map(|(a, b)| f64::from((a - b).abs()))
        .sum();
    let whole: f64 = a.means.iter().map(|a| f64::from(a.abs())).sum();
    let tolerance = match a.access.is_exact() {
        // Drivers may round colours between a block's ends to bytes.
        true if format.ends_with("BLOCK") => 0.01,
        true => 1e-3,
        false => 0.02,
    };
    ensure!(
        apart <= tolerance * whole,
        "results differ by {:.2} %",
        100.0 * apart / whole
    );
    Ok(())
}
