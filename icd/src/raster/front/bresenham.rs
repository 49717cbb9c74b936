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

/// The column of a coordinate along a line.
fn column_of(u: i64) -> i64 {
    u.div_euclid(i64::from(PIXEL))
}

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

    /// The rows in which the line crosses the middles of columns, from one on.
    fn rows(&self, column: i64) -> LineRows {
        let center = column * i64::from(PIXEL) + HALF;
        let [du, dv] = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        // v at the centre is from + dv (centre − from) / du, in units of a row: numerator /
        // denominator. Ends have 30 bits, so products have 62.
        let (du, dv) = if du < 0 { (-du, -dv) } else { (du, dv) };
        let numerator = self.from[1] * du + dv * (center - self.from[0]);
        let denominator = du * i64::from(PIXEL);
        LineRows {
            row: numerator.div_euclid(denominator),
            rest: numerator.rem_euclid(denominator),
            step: dv * i64::from(PIXEL),
            denominator,
            stays: self.is_x && dv > 0,
        }
    }

    /// Whether an end at a coordinate along the line, moved, is past a column's middle to the
    /// greater side.
    fn is_past(&self, u: i64, center: i64) -> bool {
        u > center
    }

    /// Whether the line starts in a column that is not after the one it ends in.
    fn is_forward(&self) -> bool {
        column_of(self.from[0]) <= column_of(self.to[0])
    }

    /// The first and the last column with a pixel; the last is less if there is none.
    fn columns(&self) -> [i64; 2] {
        // An end between two columns is moved into the first.
        let mut low = column_of(self.from[0].min(self.to[0]) - 1);
        let mut high = column_of(self.from[0].max(self.to[0]));
        while low <= high && !self.has(low) {
            low += 1;
        }
        while low <= high && !self.has(high) {
            high -= 1;
        }
        [low, high]
    }

    fn has(&self, column: i64) -> bool {
        let center = [
            column * i64::from(PIXEL) + HALF,
            self.rows(column).row() * i64::from(PIXEL) + HALF,
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

/// The pattern of a stippled line.
struct Stipple {
    pattern: u16,
    factor: u32,
    /// Columns of the lines that this one continues.
    before: u64,
    /// The line's first column, and the direction of the next one.
    first: i64,
    step: i64,
}

impl Stipple {
    fn has(&self, column: i64) -> bool {
        let index = self.before + ((column - self.first) * self.step) as u64;
        self.pattern >> (index / u64::from(self.factor) % 16) & 1 != 0
    }
}

/// The place of a line at the middles of columns, one after the other: `row + rest / denominator`
/// rows.
struct LineRows {
    row: i64,
    rest: i64,
    /// The growth of `rest` by a column; at most the denominator, up or down.
    step: i64,
    denominator: i64,
    stays: bool,
}

impl LineRows {
    #[inline(always)]
    fn row(&self) -> i64 {
        // Between two rows: the move takes an x-major line down its slope's way first, then up; a
        // y-major one left.
        self.row - i64::from(self.rest == 0 && !self.stays)
    }

    /// Goes on to the next column.
    #[inline(always)]
    fn advance(&mut self) {
        self.rest += self.step;
        if self.rest >= self.denominator {
            self.rest -= self.denominator;
            self.row += 1;
        } else if self.rest < 0 {
            self.rest += self.denominator;
            self.row -= 1;
        }
    }
}

/// The bounds of pixels in the order of columns, whose rows are in a range.
fn bounds_of(pixels: &[[i16; 2]], rows: [i64; 2], is_x: bool) -> Option<Bounds> {
    let (one, last) = (pixels.first()?, pixels.last()?);
    let [least, greatest] = rows.map(|row| row as i32);
    Some(match is_x {
        true => Bounds {
            left: one[0].into(),
            top: least,
            right: i32::from(last[0]) + 1,
            bottom: greatest,
        },
        false => Bounds {
            left: least,
            top: one[1].into(),
            right: greatest,
            bottom: i32::from(last[1]) + 1,
        },
    })
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
        let [low, high] = line.columns();
        let stipple = self.facts.lines.stipple.map(|(pattern, factor)| Stipple {
            pattern,
            factor,
            before: self.stippled as u64,
            first: if line.is_forward() { low } else { high },
            step: if line.is_forward() { 1 } else { -1 },
        });
        if stipple.is_some() && low <= high {
            self.stippled += (high - low + 1) as f64;
        }
        let (along, across) = (
            (limits.left.into(), limits.right.into()),
            (limits.top.into(), limits.bottom.into()),
        );
        let (along, across): ((i64, i64), (i64, i64)) = match line.is_x {
            true => (along, across),
            false => (across, along),
        };
        let (low, high) = (low.max(along.0), high.min(along.1 - 1));
        if low > high {
            return;
        }
        let pixels = &mut self.chunk.pixels;
        let first_pixel = pixels.len();
        let (mut least, mut greatest) = (i64::MAX, i64::MIN);
        let mut rows = line.rows(low);
        for column in low..=high {
            let row = rows.row();
            rows.advance();
            if stipple.as_ref().is_some_and(|it| !it.has(column)) {
                continue;
            }
            let (from, to) = (row.max(across.0), (row + width).min(across.1));
            if from >= to {
                continue;
            }
            (least, greatest) = (least.min(from), greatest.max(to));
            for row in from..to {
                pixels.push(match line.is_x {
                    true => [column as i16, row as i16],
                    false => [row as i16, column as i16],
                });
            }
        }
        let list = &pixels[first_pixel..];
        let Some(bounds) = bounds_of(list, [least, greatest], line.is_x) else {
            return;
        };
        self.chunk.shapes.push(Shape {
            record,
            coverage: Coverage::Pixels {
                first: first_pixel as u32,
                count: list.len() as u32,
                is_x: line.is_x,
            },
            bounds,
        });
    }
}
