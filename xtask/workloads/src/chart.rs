//! The results drawn: bars of ratios, and curves.

use std::path::Path;

use anyhow::Result;
use canvas::plotters::coord::Shift;
use canvas::plotters::prelude::*;
use canvas::{Drawing, FONT, failed, save, short};

use crate::results::{Measurement, Results};

/// Draws `ratios` and each curve into the folder, as SVG and as PNG.
pub fn draw(results: &Results, folder: &Path) -> Result<()> {
    if results.drivers.len() > 1 && !results.table.is_empty() {
        save(&Ratios(results), folder, "ratios")?;
    }
    for (varies, points) in &results.curves {
        let curve = Curve {
            results,
            varies,
            points,
        };
        save(&curve, folder, &format!("by-{varies}"))?;
    }
    Ok(())
}

const SIZE: (u32, u32) = (960, 600);

struct Ratios<'a>(&'a Results);

impl Drawing for Ratios<'_> {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        ratios(self.0, area)
    }
}

struct Curve<'a> {
    results: &'a Results,
    varies: &'a str,
    points: &'a [Measurement],
}

impl Drawing for Curve<'_> {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        curve(self.results, self.varies, self.points, area)
    }
}

/// A bar a workload: how many times as fast the first driver is as the second.
fn ratios<B: DrawingBackend>(results: &Results, area: &DrawingArea<B, Shift>) -> Result<()> {
    let bars: Vec<(&str, f64)> = results
        .table
        .iter()
        .filter_map(|it| Some((it.name.as_str(), it.ratio(1)?)))
        .collect();
    let top = bars.iter().fold(2.0f64, |top, bar| top.max(bar.1)) * 1.2;
    let low = bars.iter().fold(0.5f64, |low, bar| low.min(bar.1)) / 1.2;
    let caption = format!("{} : {}", results.drivers[0], results.drivers[1]);
    let mut chart = ChartBuilder::on(area)
        .caption(caption, (FONT, 18))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(130)
        .build_cartesian_2d((low..top).log_scale(), 0.0..bars.len() as f64)
        .map_err(failed)?;
    let label = |y: &f64| {
        let row = bars.len() as f64 - 0.5 - y;
        let near = row.round();
        match (row - near).abs() < 0.01 && near >= 0.0 {
            true => bars.get(near as usize).map_or("", |bar| bar.0).to_string(),
            false => String::new(),
        }
    };
    chart
        .configure_mesh()
        .disable_y_mesh()
        .y_labels(bars.len() * 2 + 1)
        .y_label_formatter(&label)
        .x_desc("times as fast (logarithmic)")
        .draw()
        .map_err(failed)?;
    let rectangles = bars.iter().enumerate().map(|(row, &(_, ratio))| {
        let y = bars.len() as f64 - row as f64;
        let colour = if ratio < 1.0 {
            RED.mix(0.6)
        } else {
            BLUE.mix(0.6)
        };
        Rectangle::new([(1.0, y - 0.2), (ratio, y - 0.8)], colour.filled())
    });
    chart.draw_series(rectangles).map_err(failed)?;
    Ok(())
}

/// Speed by what varies, a line a driver.
fn curve<B: DrawingBackend>(
    results: &Results,
    varies: &str,
    points: &[Measurement],
    area: &DrawingArea<B, Shift>,
) -> Result<()> {
    let lines: Vec<Vec<(f64, f64)>> = (0..results.drivers.len())
        .map(|driver| {
            points
                .iter()
                .filter_map(|point| Some((point.at(varies) as f64, point.speeds()[driver]?.median)))
                .collect()
        })
        .collect();
    let all = || lines.iter().flatten();
    let right = all().fold(1.0f64, |right, point| right.max(point.0)) * 1.3;
    let left = all().fold(right, |left, point| left.min(point.0)) / 1.3;
    let top = all().fold(0.0f64, |top, point| top.max(point.1)) * 1.5;
    // A doubling axis has its ticks at powers of two.
    let base = if right > 5_000.0 { 10.0 } else { 2.0 };
    let low = all().fold(top, |low, point| low.min(point.1)) / 1.5;
    let mut chart = ChartBuilder::on(area)
        .caption(
            format!("paths of eight bounces, by {varies} (logarithmic)"),
            (FONT, 18),
        )
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d(
            (left..right).log_scale().base(base),
            (low..top).log_scale().base(2.0),
        )
        .map_err(failed)?;
    chart
        .configure_mesh()
        .x_desc(varies)
        .x_label_formatter(&|x| short(*x))
        .y_desc("Mrays/s")
        .y_label_formatter(&|y| short(*y))
        .draw()
        .map_err(failed)?;
    for (driver, line) in lines.iter().enumerate() {
        let colour = Palette99::pick(driver).to_rgba();
        chart
            .draw_series(LineSeries::new(line.clone(), colour.stroke_width(2)).point_size(3))
            .map_err(failed)?
            .label(results.drivers[driver].clone())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .draw()
        .map_err(failed)?;
    Ok(())
}
