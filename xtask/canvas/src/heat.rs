//! Where methods fail: rows are methods, columns a parameter, and a cell how often or by how much.

use anyhow::Result;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::{Drawing, FONT, failed};

/// A table of numbers in colours.
#[derive(Clone, Debug, Default)]
pub struct HeatMap {
    pub title: String,
    /// The meaning of the columns.
    pub across: String,
    pub columns: Vec<String>,
    pub rows: Vec<(String, Vec<Option<Cell>>)>,
    /// Under the picture: what a number means, machine, date.
    pub foot: String,
}

/// A cell: its text, and its badness from 0 (good) to 1.
pub type Cell = (String, f64);

const LEFT: i32 = 190;
const TOP: i32 = 44;
const ROW: i32 = 30;
const WIDTH: i32 = 960;
const FOOT: i32 = 66;

impl Drawing for HeatMap {
    fn size(&self) -> (u32, u32) {
        let height = TOP + ROW * self.rows.len() as i32 + FOOT;
        (WIDTH as u32, height as u32)
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let cell = (WIDTH - LEFT - 12) / self.columns.len().max(1) as i32;
        let bottom = TOP + ROW * self.rows.len() as i32;
        let text = |text: &str, size: i32, at: (i32, i32), h: HPos, colour: RGBColor| {
            let style = (FONT, size).into_font().color(&colour);
            let style = style.pos(Pos::new(h, VPos::Center));
            area.draw_text(text, &style, at).map_err(failed)
        };
        text(&self.title, 18, (12, TOP / 2), HPos::Left, BLACK)?;
        for (number, (name, cells)) in self.rows.iter().enumerate() {
            let y = TOP + ROW * number as i32;
            text(name, 13, (LEFT - 8, y + ROW / 2), HPos::Right, BLACK)?;
            for (column, found) in cells.iter().enumerate() {
                let x = LEFT + cell * column as i32;
                let (fill, label) = match found {
                    Some((label, badness)) => (shade(*badness), label.as_str()),
                    None => (RGBColor(235, 235, 235), ""),
                };
                let corners = [(x, y), (x + cell - 1, y + ROW - 1)];
                area.draw(&Rectangle::new(corners, fill.filled()))
                    .map_err(failed)?;
                let ink = if found.as_ref().is_some_and(|found| found.1 > 0.75) {
                    WHITE
                } else {
                    BLACK
                };
                let middle = (x + cell / 2, y + ROW / 2);
                text(label, 11, middle, HPos::Center, ink)?;
            }
        }
        for (column, name) in self.columns.iter().enumerate() {
            let x = LEFT + cell * column as i32 + cell / 2;
            text(name, 12, (x, bottom + 12), HPos::Center, BLACK)?;
        }
        let middle = (LEFT + WIDTH - 12) / 2;
        text(&self.across, 13, (middle, bottom + 32), HPos::Center, BLACK)?;
        let faint = RGBColor(110, 110, 110);
        let at = (WIDTH - 12, bottom + FOOT - 12);
        text(&self.foot, 11, at, HPos::Right, faint)
    }
}

/// From green over yellow to dark red.
fn shade(badness: f64) -> RGBColor {
    const STOPS: [(f64, [f64; 3]); 5] = [
        (0.0, [198.0, 233.0, 196.0]),
        (0.02, [250.0, 243.0, 176.0]),
        (0.4, [250.0, 190.0, 100.0]),
        (0.75, [225.0, 90.0, 55.0]),
        (1.0, [130.0, 15.0, 30.0]),
    ];
    let value = badness.clamp(0.0, 1.0);
    let upper = STOPS.iter().position(|stop| value <= stop.0).unwrap_or(4);
    let (high, low) = (STOPS[upper], STOPS[upper.saturating_sub(1)]);
    let share = if high.0 > low.0 {
        (value - low.0) / (high.0 - low.0)
    } else {
        0.0
    };
    let part = |i: usize| (low.1[i] + share * (high.1[i] - low.1[i])) as u8;
    RGBColor(part(0), part(1), part(2))
}
