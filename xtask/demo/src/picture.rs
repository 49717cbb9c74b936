//! From sums of radiance to a PNG file.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use anyhow::{Context, Result};

use demo_limits::parent;

/// Writes the mean of each pixel's samples, tone mapped and sRGB-encoded.
pub fn write_png(
    path: &Path,
    (width, height): (u32, u32),
    radiance: &[[f32; 4]],
    exposure: f32,
) -> Result<()> {
    let bytes = encoded(radiance, exposure);
    if let Some(folder) = parent(path) {
        std::fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    }
    let file = File::create(path).with_context(|| format!("creating {}", path.display()))?;
    let mut png = png::Encoder::new(BufWriter::new(file), width, height);
    png.set_color(png::ColorType::Rgb);
    png.set_depth(png::BitDepth::Eight);
    png.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    // The default compressor depends on the packages that are built along, this one does not.
    png.set_compression(png::Compression::Fast);
    let mut writer = png.write_header()?;
    writer
        .write_image_data(&bytes)
        .context("writing the picture")?;
    writer.finish().context("writing the picture")
}

/// The mean of each pixel's samples, tone mapped and sRGB-encoded: red, green and blue of each.
pub fn encoded(radiance: &[[f32; 4]], exposure: f32) -> Vec<u8> {
    let thresholds = srgb_thresholds();
    let encode = |value: f32| thresholds.partition_point(|threshold| *threshold <= value) as u8;
    let pixels = radiance.iter().flat_map(|[r, g, b, samples]| {
        let scale = exposure / samples.max(1.0);
        tone_map([r * scale, g * scale, b * scale]).map(encode)
    });
    pixels.collect()
}

/// A filmic curve for each channel: a rational fit to the ACES reference (Narkowicz 2015), after
/// a little of each channel has gone into the others, so that bright colours pale.
fn tone_map([r, g, b]: [f32; 3]) -> [f32; 3] {
    let mean = (r + g + b) / 3.0;
    [r, g, b].map(|channel| {
        let x = (channel * 0.92 + mean * 0.08).max(0.0) * 0.75;
        let y = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
        y.clamp(0.0, 1.0)
    })
}

/// The linear value at which each sRGB code but the first begins (IEC 61966-2-1).
fn srgb_thresholds() -> [f32; 255] {
    std::array::from_fn(|code| {
        let c = (code as f64 + 0.5) / 255.0;
        let linear = if c <= 0.04045 {
            c / 12.92
        } else {
            libm::pow((c + 0.055) / 1.055, 2.4)
        };
        linear as f32
    })
}
