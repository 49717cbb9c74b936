//! Rows of results, and how they are shown.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::rays::RayKind;

/// The rates of one engine in one scene, one a turn.
pub struct EngineRates {
    pub scene: &'static str,
    pub counts: bool,
    pub engine: &'static str,
    /// Triangles a second.
    pub build: Vec<f64>,
    /// Rays a second, of each kind.
    pub rays: [Vec<f64>; 3],
    /// Bytes a triangle in use.
    pub bytes: f64,
    /// Bytes a triangle that were reported for structure and scratch.
    pub reported: [f64; 2],
}

impl EngineRates {
    pub fn new(scene: &'static str, counts: bool, engine: &'static str) -> EngineRates {
        EngineRates {
            scene,
            counts,
            engine,
            build: Vec::new(),
            rays: Default::default(),
            bytes: 0.0,
            reported: [0.0; 2],
        }
    }

    /// The four rates: building, then each kind of rays.
    fn rates(&self) -> [&[f64]; 4] {
        let [primary, shadow, diffuse] = &self.rays;
        [&self.build, primary, shadow, diffuse]
    }
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<_> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// All rows. The first of a scene is what its others are compared with.
#[derive(Default)]
pub struct Table {
    rows: Vec<(EngineRates, [Option<f64>; 4])>,
}

impl Table {
    /// Adds and prints the rows of a scene.
    pub fn add(&mut self, scene: &str, triangles: usize, rows: Vec<EngineRates>) {
        println!();
        println!(
            "{:<24}{:>16}{:>16}{:>16}{:>16}{:>9}{:>14}",
            format!("{scene}, {triangles}"),
            "build Mtri/s",
            "primary Mray/s",
            "shadow Mray/s",
            "diffuse Mray/s",
            "bytes/tri",
            "reported",
        );
        let mut ratios = Vec::new();
        for row in &rows {
            let mut line = format!("{:<24}", row.engine);
            let mut row_ratios = [None; 4];
            for (place, (rates, first)) in
                (row_ratios.iter_mut()).zip(row.rates().into_iter().zip(rows[0].rates()))
            {
                // Ratios of the same turn.
                *place = median(rates.iter().zip(first).map(|(rate, first)| rate / first));
                let cell = match (median(rates.iter().copied()), *place) {
                    (Some(rate), Some(ratio)) => format!("{:.3} ({ratio:.2})", rate * 1e-6),
                    _ => "-".to_string(),
                };
                let _ = write!(line, "{cell:>16}");
            }
            let [structure, scratch] = row.reported;
            let reported = if structure > 0.0 {
                format!("{structure:.1} + {scratch:.0}")
            } else {
                "-".to_string()
            };
            println!("{line}{:>9.1}{reported:>14}", row.bytes);
            ratios.push(row_ratios);
        }
        self.rows.extend(rows.into_iter().zip(ratios));
    }

    /// Prints each engine's geometric means of ratios over the scenes that count.
    pub fn print_means(&self) {
        let mut engines: Vec<_> = self.rows.iter().map(|(row, _)| row.engine).collect();
        engines.sort_unstable();
        engines.dedup();
        println!("\ngeometric means over the scenes but needles, and the least");
        for engine in engines {
            let mut line = format!("{engine:<24}");
            for cell in 0..4 {
                let ratios: Vec<_> = (self.rows.iter())
                    .filter(|(row, _)| row.engine == engine && row.counts)
                    .filter_map(|(_, ratios)| ratios[cell])
                    .collect();
                let mean = ratios.iter().map(|r| r.ln()).sum::<f64>() / ratios.len() as f64;
                let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
                let _ = write!(line, "{:>16}", format!("{:.3} ({least:.2})", mean.exp()));
            }
            println!("{line}");
        }
    }

    pub fn write_csv(&self, path: &Path) -> Result<()> {
        let mut text =
            String::from("scene,engine,build,primary,shadow,diffuse,bytes,structure,scratch\n");
        for (row, _) in &self.rows {
            let _ = write!(text, "{},{}", row.scene, row.engine);
            for rates in row.rates() {
                let _ = write!(text, ",{:.0}", median(rates.iter().copied()).unwrap_or(0.0));
            }
            let [structure, scratch] = row.reported;
            let _ = writeln!(text, ",{:.2},{structure:.2},{scratch:.2}", row.bytes);
        }
        std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))
    }
}

impl Table {
    /// Every sample of every row, and its ratios to the first row of its scene.
    pub fn write_json(&self, path: &Path) -> Result<()> {
        let cells = ["build", "primary", "shadow", "diffuse"];
        let rows: Vec<_> = (self.rows.iter())
            .map(|(row, ratios)| {
                let by_cell = |value: &dyn Fn(usize) -> Value| -> Value {
                    let pairs = cells.iter().enumerate();
                    pairs
                        .map(|(i, cell)| (cell.to_string(), value(i)))
                        .collect()
                };
                json!({
                    "scene": row.scene,
                    "engine": row.engine,
                    "samples_per_second": by_cell(&|i| json!(row.rates()[i])),
                    "ratios": by_cell(&|i| json!(ratios[i])),
                    "bytes_per_triangle": row.bytes,
                    "reported_bytes_per_triangle": row.reported,
                })
            })
            .collect();
        let text = serde_json::to_string_pretty(&rows)?;
        std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))
    }
}

const _: () = assert!(RayKind::Primary as usize == 0 && RayKind::Diffuse as usize == 2);
