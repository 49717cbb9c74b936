//! One picture by every accuracy and driver, held against the same paths in f64.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use canvas::{Mark, Point, short};
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, FlipPool};

use crate::Options;
use crate::report::{Chart, Report};
use crate::workload::{self, Scale};

/// How far a picture is from the reference.
struct Difference {
    /// Root of the mean square over channels.
    rmse: f64,
    /// Share of pixels of which a channel is off by more than 1/255.
    visible: f64,
    /// Mean of ꟻLIP (Andersson et al. 2020), 8 bits a channel.
    flip: f64,
}

/// 8 bits a channel, by a gamma of 2.2.
fn bytes(pixels: &[[f32; 4]]) -> Vec<u8> {
    let byte = |channel: f32| (channel.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0).round() as u8;
    pixels
        .iter()
        .flat_map(|pixel| [byte(pixel[0]), byte(pixel[1]), byte(pixel[2])])
        .collect()
}

fn difference(scale: &Scale, truth: &[[f32; 4]], found: &[[f32; 4]]) -> Difference {
    let mut square = 0.0;
    let mut visible = 0usize;
    for (a, b) in truth.iter().zip(found) {
        let off = |channel: usize| f64::from(a[channel] - b[channel]);
        square += (0..3).map(|channel| off(channel).powi(2)).sum::<f64>();
        visible += usize::from((0..3).any(|channel| off(channel).abs() > 1.0 / 255.0));
    }
    let pixels = truth.len() as f64;
    let image = |pixels| FlipImageRgb8::with_data(scale.width, scale.height, &bytes(pixels));
    let map = nv_flip::flip(image(truth), image(found), DEFAULT_PIXELS_PER_DEGREE);
    Difference {
        rmse: (square / (3.0 * pixels)).sqrt(),
        visible: visible as f64 / pixels,
        flip: f64::from(FlipPool::from_image(&map).mean()),
    }
}

fn write_png(path: &Path, scale: &Scale, pixels: &[[f32; 4]]) -> Result<()> {
    let file =
        std::fs::File::create(path).with_context(|| format!("writing {}", path.display()))?;
    let mut encoder = png::Encoder::new(file, scale.width, scale.height);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&bytes(pixels))?;
    Ok(())
}

const QUICK: Scale = Scale {
    width: 160,
    height: 90,
    triangles: 20_000,
    instances: 32,
    no_any_hit: false,
};

const WHOLE: Scale = Scale {
    width: 480,
    height: 270,
    triangles: 200_000,
    instances: 256,
    no_any_hit: false,
};

/// A driver with settings, and the name of its picture; empty until its first picture names it.
type PictureRun<'a> = (String, &'a Path, Vec<(&'static str, &'static str)>);

/// The first driver in each accuracy, and the others as they are.
fn contestants<'a>(tuff: &'a Path, others: &'a [PathBuf]) -> Vec<PictureRun<'a>> {
    let accuracies = ["fast", "spec", "exact"];
    let mut contestants: Vec<PictureRun<'_>> = accuracies
        .into_iter()
        .map(|name| (format!("Tuff {name}"), tuff, vec![("TUFF_ACCURACY", name)]))
        .collect();
    contestants.extend(
        others
            .iter()
            .map(|icd| (String::new(), icd.as_path(), Vec::new())),
    );
    contestants
}

/// A picture in the chart, by its cost and error.
fn point(name: &str, x: f64, y: f64) -> Point {
    Point {
        label: name.to_owned(),
        x,
        y,
        mark: match name {
            "Tuff spec" => Mark::Default,
            name if name.starts_with("Tuff") => Mark::Ours,
            _ => Mark::Other,
        },
    }
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let Some((tuff, others)) = options.icds.split_first() else {
        eprintln!("no driver is given: no pictures");
        return Ok(());
    };
    let (scale, rounds) = match options.quick {
        true => (QUICK, 2),
        false => (WHOLE, 5),
    };
    std::fs::create_dir_all(&options.out)?;
    let raw = options.out.join("picture.raw");
    workload::reference(options, &scale, &raw)?;
    let truth = workload::read(&raw)?;
    write_png(&options.out.join("picture-f64.png"), &scale, &truth)?;
    let mut contestants = contestants(tuff, others);
    let mut times = vec![f64::INFINITY; contestants.len()];
    let mut differences = Vec::new();
    for round in 0..rounds {
        for (number, (name, icd, settings)) in contestants.iter_mut().enumerate() {
            let sample = workload::measure(options, icd, "path", &scale, 3, settings, Some(&raw))?;
            let sample = sample.context("the driver cannot draw")?;
            times[number] = times[number].min(sample.least());
            if round == 0 {
                let found = workload::read(&raw)?;
                if name.is_empty() {
                    // Without what is said of the compiler.
                    *name = sample.driver.split(" (").next().unwrap_or("another").into();
                }
                let file = format!("picture-{}.png", name.to_lowercase().replace(' ', "-"));
                write_png(&options.out.join(file), &scale, &found)?;
                differences.push(difference(&scale, &truth, &found));
            }
        }
    }
    std::fs::remove_file(&raw).context("removing a picture")?;
    let (mut points, mut rows) = (Vec::new(), Vec::new());
    for (((name, ..), time), off) in contestants.iter().zip(&times).zip(&differences) {
        rows.push(vec![
            name.clone(),
            format!("{:.2}", time * 1e3),
            short(off.rmse),
            format!("{:.4} %", off.visible * 100.0),
            short(off.flip),
        ]);
        for (what, value) in [
            ("ms", time * 1e3),
            ("RMSE", off.rmse),
            ("visible", off.visible),
            ("FLIP", off.flip),
        ] {
            report.number("pictures", name, what, value);
        }
        points.push(point(name, time * 1e3, off.rmse));
    }
    let columns = [
        "ms of processor time",
        "RMSE",
        "off by more than 1/255",
        "mean of ꟻLIP",
    ];
    report.table("Pictures against f64", &columns, &rows);
    let chart = Chart {
        name: "pictures",
        title: "Pictures: diffuse paths of eight bounces against the same in f64",
        cost: "ms of processor time a picture",
        error: "RMSE over channels",
    };
    report.frontier(&options.out, &chart, points)
}
