//! Bresenham lines: the pixels whose diamonds a line leaves (spec, "Bresenham Line Segment
//! Rasterization"), decided exactly.
//!
//! The diamond of a pixel is what is less than half a pixel from its centre, |x| + |y| < ½. A line
//! makes a fragment of each pixel whose diamond it meets and does not end in, with both ends moved
//! by (−ε, −ε²). Of an x-major line, that is at most one pixel a column: the one whose row the line
//! crosses the column's middle in, unless the line starts past the middle and outside of the
//! diamond, or ends before the middle or in the diamond.

#![forbid(unsafe_code)]

use super::line::Segment;
use super::screen::PIXEL;
use super::set_up::SetUp;
use crate::raster::primitive::{Bounds, Coverage, Shape};

const HALF: i64 = PIXEL as i64 / 2;

/// A line seen along its longer side: `u` runs along, `v` across.
struct MajorLine {
    /// u is x.
    is_x: bool,
    from: [i64; 2],
    to: [i64; 2],
}

/// Whether an end, moved by the ε's, is in the diamond around a centre.
fn in_diamond(end: [i64; 2], center: [i64; 2], is_x: bool) -> bool {
    let (u, v) = (end[0] - center[0], end[1] - center[1]);
    // On the edge, the move to the left decides: x moves more than y.
    let x = if is_x { u } else { v };
    match (u.abs() + v.abs()).cmp(&HALF) {
        std::cmp::Ordering::Less => true,
        std::cmp::Ordering::Equal => x > 0,
        std::cmp::Ordering::Greater => false,
    }
}

impl MajorLine {
    fn new(segment: &Segment) -> Self {
        let [dx, dy] = segment.direction().map(i32::unsigned_abs);
        let is_x = dx >= dy;
        let place = |[x, y]: [i32; 2]| {
            if is_x {
                [i64::from(x), i64::from(y)]
            } else {
                [i64::from(y), i64::from(x)]
            }
        };
        Self {
            is_x,
            from: place(segment.from),
            to: place(segment.to),
        }
    }

    /// The row in which the line crosses the middle of a column.
    fn row(&self, column: i64) -> i64 {
        let center = column * i64::from(PIXEL) + HALF;
        let [du, dv] = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        // v at the centre is from + dv (centre − from) / du, in units of a row: numerator /
        // denominator.
        let (du, dv) = if du < 0 { (-du, -dv) } else { (du, dv) };
        let numerator = i128::from(self.from[1]) * i128::from(du)
            + i128::from(dv) * i128::from(center - self.from[0]);
        let denominator = i128::from(du) * i128::from(PIXEL);
        let row = numerator.div_euclid(denominator) as i64;
        // Between two rows: the move takes an x-major line down its slope's way first, then up; a
        // y-major one left.
        let is_between = numerator.rem_euclid(denominator) == 0;
        let stays = self.is_x && dv > 0;
        if is_between && !stays { row - 1 } else { row }
    }

    /// Whether an end at a coordinate along the line, moved, is past a column's middle to the
    /// greater side.
    fn is_past(&self, u: i64, center: i64) -> bool {
        u > center
    }

    fn has(&self, column: i64) -> bool {
        let center = [
            column * i64::from(PIXEL) + HALF,
            self.row(column) * i64::from(PIXEL) + HALF,
        ];
        let start_past = self.is_past(self.from[0], center[0]);
        let end_past = self.is_past(self.to[0], center[0]);
        if self.to[0] > self.from[0] {
            let meets = !start_past || in_diamond(self.from, center, self.is_x);
            meets && end_past && !in_diamond(self.to, center, self.is_x)
        } else {
            let meets = start_past || in_diamond(self.from, center, self.is_x);
            meets && !end_past && !in_diamond(self.to, center, self.is_x)
        }
    }
}

impl SetUp<'_> {
    /// Adds the pixels of a line.
    pub fn bresenham(&mut self, segment: &Segment, record: u32, limits: Bounds) {
        let width = f64::from(self.facts.lines.width).round().clamp(1.0, 1024.0) as i64;
        let mut line = MajorLine::new(segment);
        // Of a wide line, the first of the pixels across.
        for end in [&mut line.from, &mut line.to] {
            end[1] -= HALF * (width - 1);
        }
        let column = |u: i64| u.div_euclid(i64::from(PIXEL));
        let (start, end) = (column(line.from[0]), column(line.to[0]));
        // An end between two columns is moved into the first.
        let before = column(line.from[0].min(line.to[0]) - 1);
        let (mut low, mut high) = (before, start.max(end));
        while low <= high && !line.has(low) {
            low += 1;
        }
        while low <= high && !line.has(high) {
            high -= 1;
        }
        let (first, step) = if start <= end { (low, 1) } else { (high, -1) };
        let stippled = self.stippled as u64;
        let count = high - low + 1;
        if count > 0 && self.facts.lines.stipple.is_some() {
            self.stippled += count as f64;
        }
        let (least, greatest) = if line.is_x {
            (limits.left, limits.right)
        } else {
            (limits.top, limits.bottom)
        };
        let (low, high) = (low.max(least.into()), high.min(i64::from(greatest) - 1));
        let first_pixel = self.chunk.pixels.len();
        let mut bounds = Bounds {
            left: i32::MAX,
            top: i32::MAX,
            right: i32::MIN,
            bottom: i32::MIN,
        };
        for column in low..=high {
            if let Some((pattern, factor)) = self.facts.lines.stipple {
                let index = stippled + ((column - first) * step) as u64;
                if pattern >> (index / u64::from(factor) % 16) & 1 == 0 {
                    continue;
                }
            }
            let row = line.row(column);
            for across in row..row + width {
                let (x, y) = if line.is_x {
                    (column, across)
                } else {
                    (across, column)
                };
                let (x, y) = (x as i32, y as i32);
                let is_inside = (limits.left..limits.right).contains(&x)
                    && (limits.top..limits.bottom).contains(&y);
                if is_inside {
                    self.chunk.pixels.push([x as i16, y as i16]);
                    bounds.left = bounds.left.min(x);
                    bounds.top = bounds.top.min(y);
                    bounds.right = bounds.right.max(x + 1);
                    bounds.bottom = bounds.bottom.max(y + 1);
                }
            }
        }
        let count = self.chunk.pixels.len() - first_pixel;
        if count > 0 {
            self.chunk.shapes.push(Shape {
                record,
                coverage: Coverage::Pixels {
                    first: first_pixel as u32,
                    count: count as u32,
                },
                bounds,
            });
        }
    }
}
