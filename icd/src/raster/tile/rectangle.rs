//! Two triangles that make up an upright rectangle: the boxes of interfaces. Each pixel is of one
//! of them, so that they can be worked off together, in cells that start where the rectangle does.
//! The result has the same bits as the two triangles drawn in sequence.

#![forbid(unsafe_code)]

use lanes::vector::Vector;

use super::coverage::NARROW;
use super::lanes::{COLUMNS, IN_BLOCK, IN_ROW, ROWS};
use super::places::{Pattern, Places};
use crate::raster::primitive::{Bounds, Edge};

/// Units of the screen's fixed point in a pixel.
const PIXEL: i32 = 256;

/// A rectangle of two triangles.
#[derive(Clone, Copy, Debug)]
pub struct Rectangle {
    /// Pixels inside of it are the first triangle's, the others the second's.
    pub diagonal: Edge,
    /// The pixels whose centres it covers, inside both triangles' bounds.
    pub covered: Bounds,
}

/// An edge without its rule of ties: 0 where it is.
fn line(edge: &Edge) -> i64 {
    let owns = edge.a > 0 || (edge.a == 0 && edge.b > 0);
    edge.c + i64::from(!owns)
}

/// The level, the upright and the slanted edge of a triangle that has one of each.
fn sides(edges: &[Edge; 4]) -> Option<[&Edge; 3]> {
    let edges = &edges[..3];
    let level = edges.iter().find(|edge| edge.a == 0)?;
    let upright = edges.iter().find(|edge| edge.b == 0)?;
    let slanted = edges.iter().find(|edge| edge.a != 0 && edge.b != 0)?;
    Some([level, upright, slanted])
}

impl Rectangle {
    /// From the edges of two triangles that share their longest side and have right angles between
    /// upright and level sides. Coverage is by pixels' centres, inside `clip`, which lies inside
    /// both triangles' bounds.
    pub fn of(first: &[Edge; 4], second: &[Edge; 4], clip: &Bounds) -> Option<Self> {
        let [level, upright, diagonal] = sides(first)?;
        let [other_level, other_upright, other_diagonal] = sides(second)?;
        let height = i64::from(diagonal.a.unsigned_abs());
        let width = i64::from(diagonal.b.unsigned_abs());
        // A level edge is at y = −c / b, the other one the height away from it, on its inside; and
        // so on.
        let are_sides = i64::from(level.b.unsigned_abs()) == width
            && i64::from(upright.a.unsigned_abs()) == height
            && other_level.b == -level.b
            && line(other_level) == -line(level) + width * height
            && other_upright.a == -upright.a
            && line(other_upright) == -line(upright) + width * height;
        let is_shared = other_diagonal.a == -diagonal.a
            && other_diagonal.b == -diagonal.b
            && other_diagonal.c == -diagonal.c - 1;
        if !are_sides || !is_shared || width + height > NARROW as i64 {
            return None;
        }
        let mut covered = *clip;
        let mut columns = [*upright, *other_upright];
        let mut rows = [*level, *other_level];
        columns.sort_by_key(|edge| edge.a < 0);
        rows.sort_by_key(|edge| edge.b < 0);
        // Bounds are hardly wider than what is covered.
        let is_out = |slope: i32, at: i32, c: i64| {
            i64::from(slope) * (i64::from(at) * i64::from(PIXEL) + i64::from(PIXEL / 2)) + c < 0
        };
        let [left, right] = columns.map(|edge| (edge.a, edge.c));
        let [top, bottom] = rows.map(|edge| (edge.b, edge.c));
        while covered.left < covered.right && is_out(left.0, covered.left, left.1) {
            covered.left += 1;
        }
        while covered.left < covered.right && is_out(right.0, covered.right - 1, right.1) {
            covered.right -= 1;
        }
        while covered.top < covered.bottom && is_out(top.0, covered.top, top.1) {
            covered.top += 1;
        }
        while covered.top < covered.bottom && is_out(bottom.0, covered.bottom - 1, bottom.1) {
            covered.bottom -= 1;
        }
        Some(Self {
            diagonal: *diagonal,
            covered,
        })
    }

    /// How many pixels it covers.
    pub fn area(&self) -> u64 {
        let side = |from: i32, to: i32| u64::from((to - from).max(0) as u32);
        side(self.covered.left, self.covered.right) * side(self.covered.top, self.covered.bottom)
    }

    /// Its pixels, each once, in cells that lie in `limit` where that has room for them.
    #[inline(always)]
    pub fn cells(&self, limit: &Bounds, layer: u32) -> Cells {
        let covered = self.covered;
        let width = (covered.right - covered.left).max(0);
        let is_empty = width == 0 || covered.top >= covered.bottom;
        Cells {
            covered,
            limit: *limit,
            layer,
            rows_end: covered.left + (width & !15),
            is_in_rows: width >= 16,
            x: covered.left,
            y: if is_empty {
                covered.bottom
            } else {
                covered.top
            },
        }
    }
}

/// Pixels of a rectangle: sixteen of a row each while there are as many, then blocks of 4×4.
pub struct Cells {
    covered: Bounds,
    limit: Bounds,
    layer: u32,
    /// Where rows of sixteen end.
    rows_end: i32,
    is_in_rows: bool,
    x: i32,
    y: i32,
}

impl Iterator for Cells {
    /// The places of sixteen pixels, and the mask of those inside the rectangle.
    type Item = (Places, u16);

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        let covered = self.covered;
        if self.is_in_rows {
            if self.y < covered.bottom {
                let places = Places::row(self.x, self.y, self.layer);
                self.x += 16;
                if self.x >= self.rows_end {
                    self.x = covered.left;
                    self.y += 1;
                }
                return Some((places, u16::MAX));
            }
            self.is_in_rows = false;
            self.x = self.rows_end;
            self.y = covered.top;
        }
        if self.y >= covered.bottom || self.x >= covered.right {
            return None;
        }
        let (x, y) = (self.x, self.y);
        let place = [
            x.min(self.limit.right - 4).max(self.limit.left),
            y.min(self.limit.bottom - 4).max(self.limit.top),
        ];
        let places = Places::block(place, self.layer, &self.limit);
        let end = |from: i32, to: i32| (to - from).min(4) as usize;
        let (column, row) = ((x - place[0]) as usize, (y - place[1]) as usize);
        let mask = COLUMNS[column][end(place[0], covered.right)]
            & ROWS[row][end(place[1], covered.bottom)];
        self.x = place[0] + 4;
        if self.x >= covered.right {
            self.x = self.rows_end;
            self.y = place[1] + 4;
        }
        Some((places, mask))
    }
}

/// Which of sixteen pixels are on the inside of an edge.
pub struct EdgeTest<V: Vector> {
    edge: Edge,
    /// Floor of its value at the centre of the pixel at the origin, in pixels.
    at_origin: i64,
    /// From the first pixel on, in a row and in a block.
    in_row: V::I,
    in_block: V::I,
}

/// The steps of an edge's value from the first pixel to the others.
#[inline(always)]
fn steps<V: Vector>(v: V, edge: &Edge, lanes: &[[u32; 16]; 2]) -> V::I {
    let x = v.mul_i(v.splat_i(edge.a), v.load_i(&lanes[0]));
    v.add_i(x, v.mul_i(v.splat_i(edge.b), v.load_i(&lanes[1])))
}

impl<V: Vector> EdgeTest<V> {
    /// Of an edge of at most [`NARROW`] units.
    #[inline(always)]
    pub fn new(v: V, edge: &Edge) -> Self {
        let half = i64::from(PIXEL / 2);
        Self {
            edge: *edge,
            at_origin: (half * (i64::from(edge.a) + i64::from(edge.b)) + edge.c) >> 8,
            in_row: steps(v, edge, &IN_ROW),
            in_block: steps(v, edge, &IN_BLOCK),
        }
    }

    /// Lanes inside: those of a row or of a block.
    #[inline(always)]
    pub fn inside(&self, v: V, places: &Places) -> u16 {
        let (x, y) = (i64::from(places.x[0]), i64::from(places.y[0]));
        let first = i64::from(self.edge.a) * x + i64::from(self.edge.b) * y + self.at_origin;
        // Beyond that, no step inside of sixteen pixels changes the sign.
        let first = first.clamp(-(1 << 30), 1 << 30) as i32;
        let steps = match places.pattern {
            Pattern::Row => self.in_row,
            _ => self.in_block,
        };
        let values = v.add_i(v.splat_i(first), steps);
        !v.ne_i(v.sign_i(values), v.splat_i(0))
    }
}
