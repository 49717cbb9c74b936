//! Points of cost and error, with the frontier and the default.

use anyhow::Result;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::{Drawing, FONT, failed, short};

/// How a point is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Tuff's default.
    Default,
    /// Tuff's other settings.
    Ours,
    /// Other methods.
    Other,
}

/// A method.
#[derive(Clone, Debug)]
pub struct Point {
    pub label: String,
    /// Cost, above 0.
    pub x: f64,
    /// Error; 0 is drawn at the foot.
    pub y: f64,
    pub mark: Mark,
}

/// One of the axes, logarithmic.
#[derive(Clone, Debug)]
pub struct Axis {
    pub title: String,
    low: f64,
    high: f64,
}

impl Axis {
    /// An axis that holds all of these, with room around; zeros do not count.
    pub fn of(title: &str, values: impl Iterator<Item = f64> + Clone) -> Axis {
        let positive = values.filter(|value| *value > 0.0);
        let low = positive.clone().fold(f64::INFINITY, f64::min);
        let high = positive.fold(0.0, f64::max);
        let (low, high) = if low <= high { (low, high) } else { (0.5, 2.0) };
        let room = (high / low).powf(0.08).max(1.35);
        Axis {
            title: title.into(),
            low: low / room,
            high: high * room,
        }
    }

    fn place(&self, value: f64) -> f64 {
        (value / self.low).ln() / (self.high / self.low).ln()
    }

    /// Where lines go: decades, or finer where there are few.
    fn ticks(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        let steps: &[f64] = if decades < 1.0 {
            &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0]
        } else if decades < 3.0 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let stride = (decades / 8.0).ceil().max(1.0) as i32;
        let range = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        range
            .filter(|exponent| exponent % stride == 0)
            .flat_map(|exponent| steps.iter().map(move |step| step * 10f64.powi(exponent)))
            .filter(|tick| (self.low..=self.high).contains(tick))
            .collect()
    }
}

/// Cost along, error up; lower left is better.
#[derive(Clone, Debug)]
pub struct Scatter {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub points: Vec<Point>,
    /// Points of one group are joined by a line instead of a frontier over all: indices.
    pub groups: Vec<Vec<usize>>,
    /// Under the picture: machine, date.
    pub foot: String,
}

/// For each point, the number of one that is at least as good in both respects and better in one.
pub fn dominated(points: &[(f64, f64)]) -> Vec<Option<usize>> {
    let better = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
    points
        .iter()
        .map(|point| points.iter().position(|other| better(other, point)))
        .collect()
}

const SIZE: (u32, u32) = (960, 600);
const LEFT: i32 = 96;
const RIGHT: i32 = 24;
const TOP: i32 = 48;
const BOTTOM: i32 = 84;
/// Room at the foot for errors of 0.
const ZERO: i32 = 36;

const OURS: RGBColor = RGBColor(0, 90, 180);
const OTHER: RGBColor = RGBColor(110, 110, 110);
const CHOSEN: RGBColor = RGBColor(200, 60, 20);
const GRID: RGBColor = RGBColor(225, 225, 225);

type Rectangle4 = [i32; 4];

impl Scatter {
    fn has_zero(&self) -> bool {
        self.points.iter().any(|point| point.y == 0.0)
    }

    fn pixel(&self, x: f64, y: f64) -> (i32, i32) {
        let (width, height) = (SIZE.0 as i32 - LEFT - RIGHT, SIZE.1 as i32 - TOP - BOTTOM);
        let foot = if self.has_zero() { ZERO } else { 0 };
        let across = LEFT + (self.x.place(x) * f64::from(width)) as i32;
        let up = match y == 0.0 {
            true => foot / 2,
            false => foot + (self.y.place(y) * f64::from(height - foot)) as i32,
        };
        (across, SIZE.1 as i32 - BOTTOM - up)
    }

    fn draw_axes<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let (right, bottom) = (SIZE.0 as i32 - RIGHT, SIZE.1 as i32 - BOTTOM);
        let small = (FONT, 13).into_font().color(&BLACK);
        let text = |text: &str, at: (i32, i32), h: HPos, v: VPos| {
            let style = small.clone().pos(Pos::new(h, v));
            area.draw_text(text, &style, at).map_err(failed)
        };
        let line = |from, to| {
            let path = PathElement::new([from, to], GRID);
            area.draw(&path).map_err(failed)
        };
        for tick in self.x.ticks() {
            let x = self.pixel(tick, self.y.low).0;
            line((x, TOP), (x, bottom))?;
            text(&short(tick), (x, bottom + 6), HPos::Center, VPos::Top)?;
        }
        for tick in self.y.ticks() {
            let y = self.pixel(self.x.low, tick).1;
            line((LEFT, y), (right, y))?;
            text(&short(tick), (LEFT - 8, y), HPos::Right, VPos::Center)?;
        }
        if self.has_zero() {
            let y = self.pixel(self.x.low, 0.0).1;
            line((LEFT, y), (right, y))?;
            text("0", (LEFT - 8, y), HPos::Right, VPos::Center)?;
        }
        let frame = Rectangle::new([(LEFT, TOP), (right, bottom)], BLACK);
        area.draw(&frame).map_err(failed)?;
        let title = (FONT, 18).into_font().color(&BLACK);
        let at_top = title.pos(Pos::new(HPos::Left, VPos::Center));
        area.draw_text(&self.title, &at_top, (LEFT, TOP / 2))
            .map_err(failed)?;
        let named = (FONT, 14).into_font().color(&BLACK);
        let under = named.pos(Pos::new(HPos::Center, VPos::Top));
        area.draw_text(&self.x.title, &under, ((LEFT + right) / 2, bottom + 28))
            .map_err(failed)?;
        let beside = (FONT, 14).into_font().transform(FontTransform::Rotate270);
        let beside = beside.color(&BLACK).pos(Pos::new(HPos::Center, VPos::Top));
        area.draw_text(&self.y.title, &beside, (10, (TOP + bottom) / 2))
            .map_err(failed)?;
        let faint = (FONT, 11).into_font().color(&OTHER);
        let last = faint.pos(Pos::new(HPos::Right, VPos::Bottom));
        area.draw_text(&self.foot, &last, (right, SIZE.1 as i32 - 6))
            .map_err(failed)
    }

    /// The frontier's points from cheap to exact, with the corners of a staircase between them.
    fn frontier(&self, beaten: &[Option<usize>]) -> Vec<(i32, i32)> {
        let mut best: Vec<&Point> = self
            .points
            .iter()
            .zip(beaten)
            .filter(|(_, beaten)| beaten.is_none())
            .map(|(point, _)| point)
            .collect();
        best.sort_by(|a, b| a.x.total_cmp(&b.x));
        let mut path = Vec::new();
        for point in best {
            let (x, y) = self.pixel(point.x, point.y);
            if let Some(&(_, before)) = path.last() {
                path.push((x, before));
            }
            path.push((x, y));
        }
        path
    }
}

impl Drawing for Scatter {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        self.draw_axes(area)?;
        let pairs: Vec<_> = self.points.iter().map(|point| (point.x, point.y)).collect();
        let beaten = if self.groups.is_empty() {
            dominated(&pairs)
        } else {
            vec![None; pairs.len()]
        };
        let mut lines = Vec::new();
        if self.groups.is_empty() {
            lines.push((self.frontier(&beaten), CHOSEN.mix(0.5)));
        }
        for (number, group) in self.groups.iter().enumerate() {
            let path = group.iter().map(|&index| {
                let point = &self.points[index];
                self.pixel(point.x, point.y)
            });
            lines.push((path.collect(), Palette99::pick(number).mix(0.7)));
        }
        for (path, colour) in lines {
            let path = PathElement::new(path, colour.stroke_width(2));
            area.draw(&path).map_err(failed)?;
        }
        let mut taken: Vec<Rectangle4> = Vec::new();
        for (point, beaten) in self.points.iter().zip(&beaten) {
            let at = self.pixel(point.x, point.y);
            let colour = colour_of(point.mark);
            let radius = if point.mark == Mark::Default { 7 } else { 5 };
            let style = match beaten {
                Some(_) => colour.stroke_width(2),
                None => colour.filled(),
            };
            area.draw(&Circle::new(at, radius, WHITE.filled()))
                .map_err(failed)?;
            area.draw(&Circle::new(at, radius, style)).map_err(failed)?;
            taken.push([at.0 - 8, at.1 - 8, at.0 + 8, at.1 + 8]);
        }
        for point in self.points.iter().filter(|point| !point.label.is_empty()) {
            let size = if point.mark == Mark::Default { 15 } else { 13 };
            let style = (FONT, size).into_font().color(&colour_of(point.mark));
            let (width, height) = area
                .estimate_text_size(&point.label, &style)
                .map_err(failed)?;
            let at = self.pixel(point.x, point.y);
            let corner = free_place(at, (width as i32, height as i32), &taken);
            taken.push(extent(corner, (width as i32, height as i32)));
            area.draw_text(&point.label, &style, corner)
                .map_err(failed)?;
        }
        Ok(())
    }
}

fn colour_of(mark: Mark) -> RGBColor {
    match mark {
        Mark::Default => CHOSEN,
        Mark::Ours => OURS,
        Mark::Other => OTHER,
    }
}

fn extent(corner: (i32, i32), (width, height): (i32, i32)) -> Rectangle4 {
    [corner.0, corner.1, corner.0 + width, corner.1 + height]
}

/// The upper left corner of a label near a point, beside the labels already placed.
fn free_place(at: (i32, i32), size: (i32, i32), taken: &[Rectangle4]) -> (i32, i32) {
    let (width, height) = size;
    let mut best = (i64::MAX, at);
    for distance in [0, 12, 26, 42, 60] {
        let (gap, middle) = (11 + distance, height / 2);
        let places = [
            (at.0 + 11, at.1 - middle - distance),
            (at.0 + 11, at.1 - middle + distance),
            (at.0 - 11 - width, at.1 - middle - distance),
            (at.0 - 11 - width, at.1 - middle + distance),
            (at.0 - width / 2, at.1 - gap - height),
            (at.0 - width / 2, at.1 + gap),
        ];
        for place in places {
            let here = extent(place, size);
            let inside = here[0] > LEFT + 2
                && here[2] < SIZE.0 as i32 - RIGHT - 2
                && here[1] > TOP + 2
                && here[3] < SIZE.1 as i32 - BOTTOM - 2;
            let overlap: i64 = taken.iter().map(|other| shared(&here, other)).sum();
            let cost = overlap * 100 + i64::from(distance) + if inside { 0 } else { 1_000_000 };
            if cost < best.0 {
                best = (cost, place);
            }
        }
    }
    best.1
}

/// The area that two rectangles share.
fn shared(a: &Rectangle4, b: &Rectangle4) -> i64 {
    let width = (a[2].min(b[2]) - a[0].max(b[0])).max(0);
    let height = (a[3].min(b[3]) - a[1].max(b[1])).max(0);
    i64::from(width) * i64::from(height)
}

#[cfg(test)]
mod tests {
    use super::dominated;

    #[test]
    fn what_is_worse_in_both_is_dominated() {
        let points = [(1.0, 5.0), (2.0, 2.0), (3.0, 3.0), (4.0, 0.0), (4.0, 0.0)];
        let expected = [None, None, Some(1), None, None];
        assert_eq!(dominated(&points), expected);
    }
}
