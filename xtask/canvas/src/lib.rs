//! Charts as SVG and PNG, and the machine and date that belong under them.
//!
//! [`Scatter`] shows what lies on a frontier and what does not, [`HeatMap`] where methods fail.
//! Anything else implements [`Drawing`] itself.

mod heat;
mod machine;
mod scatter;

use std::path::Path;

use anyhow::{Context, Result, anyhow};
use plotters::coord::Shift;
use plotters::prelude::*;

pub use heat::{Cell, HeatMap};
pub use machine::{date, machine};
pub use plotters;
pub use scatter::{Axis, Mark, Point, Scatter, dominated};

/// The family that text is set in; [`save`] registers it, so that no system font is needed.
pub const FONT: &str = "sans-serif";

/// A picture that can be drawn on any backend.
pub trait Drawing {
    /// Width and height in pixels.
    fn size(&self) -> (u32, u32);

    /// # Errors
    /// The backend's message.
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()>;
}

/// Writes `NAME.svg` and `NAME.png` into a folder, which is made if it is not there.
///
/// # Errors
/// Files that cannot be written.
pub fn save(drawing: &impl Drawing, folder: &Path, name: &str) -> Result<()> {
    let font = plotters::style::register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
    font.map_err(|_| anyhow!("the charts' font cannot be read"))?;
    std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    let path = folder.join(format!("{name}.svg"));
    let area = SVGBackend::new(&path, drawing.size()).into_drawing_area();
    area.fill(&WHITE)?;
    drawing.draw(&area)?;
    area.present()?;
    drop(area);
    let path = folder.join(format!("{name}.png"));
    let area = BitMapBackend::new(&path, drawing.size()).into_drawing_area();
    area.fill(&WHITE)?;
    drawing.draw(&area)?;
    area.present()?;
    Ok(())
}

/// Drawing errors borrow from the backend: keep what they say.
pub fn failed<E: std::fmt::Display>(error: E) -> anyhow::Error {
    anyhow!("drawing: {error}")
}

/// A number as an axis shows it: short, with a power of ten where it is far from 1.
pub fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let size = value.abs();
    if (0.001..100_000.0).contains(&size) {
        let digits = (2 - size.log10().floor() as i32).clamp(0, 5) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            return text.trim_end_matches('0').trim_end_matches('.').into();
        }
        return text;
    }
    let exponent = size.log10().floor();
    let mantissa = value / 10f64.powf(exponent);
    let power: String = (exponent as i32).to_string().chars().map(raised).collect();
    if (mantissa - 1.0).abs() < 0.005 {
        format!("10{power}")
    } else {
        format!("{mantissa:.1}·10{power}")
    }
}

fn raised(character: char) -> char {
    match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
    }
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn numbers_are_short() {
        let cases = [
            (0.0, "0"),
            (1.0, "1"),
            (0.5, "0.5"),
            (12_345.0, "12345"),
            (1e-20, "10⁻²⁰"),
            (2.5e7, "2.5·10⁷"),
        ];
        for (value, text) in cases {
            assert_eq!(short(value), text);
        }
    }
}
