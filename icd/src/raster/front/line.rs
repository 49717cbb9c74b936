//! Lines: clipping, planes, and rectangles around them (spec, "Line Segment Rasterization");
//! [`bresenham`](super::bresenham) has the others.

#![forbid(unsafe_code)]

use smallvec::SmallVec;

use super::clip;
use super::facts::{Lines, View};
use super::planes::{Planes, Wide};
use super::screen::{PIXEL, ScreenVertex, code, pixels};
use super::set_up::{Corners, Primitive, SetUp, is_empty};
use crate::raster::primitive::{Bounds, Coverage, Edge, Extra, Shape, edge};

/// A line on the screen, in fixed point.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    pub from: [i32; 2],
    pub to: [i32; 2],
}

impl Segment {
    /// From start to end.
    #[inline(always)]
    pub fn direction(&self) -> [i32; 2] {
        [self.to[0] - self.from[0], self.to[1] - self.from[1]]
    }

    /// Fixed-point units.
    #[inline(always)]
    pub fn length(&self) -> f64 {
        let [dx, dy] = self.direction();
        let [dx, dy] = [f64::from(dx), f64::from(dy)];
        (dx * dx + dy * dy).sqrt()
    }

    /// `((x, y) − from) · (dx, dy) ≥ least`, or more than that where neighbours own the samples on
    /// the edge. What is not whole has no samples on it.
    #[inline(always)]
    fn half_plane(&self, [a, b]: [i32; 2], least: f64) -> Edge {
        let from = i64::from(a) * i64::from(self.from[0]) + i64::from(b) * i64::from(self.from[1]);
        // Rounded up by conversions, which round to zero: without SSE 4.1, rounding is a call.
        let whole = least as i64;
        let up = whole + i64::from((whole as f64) < least);
        let edge = edge(a, b, -from - up);
        match whole as f64 == least {
            true => edge,
            false => Edge {
                c: -from - up,
                ..edge
            },
        }
    }

    /// The part of the rectangle around the line from `start` to `end` units of its length, which
    /// is `length`; `width` in units.
    #[inline(always)]
    fn rectangle(&self, length: f64, width: f64, start: f64, end: f64) -> [Edge; 4] {
        let [dx, dy] = self.direction();
        let half = width / 2.0 * length;
        let last = match end == length {
            // Exactly at the end's place, which the next line of a strip starts at.
            true => {
                let [x, y] = self.to;
                edge(
                    -dx,
                    -dy,
                    i64::from(dx) * i64::from(x) + i64::from(dy) * i64::from(y),
                )
            }
            false => self.half_plane([-dx, -dy], -(end * length)),
        };
        [
            self.half_plane([-dy, dx], -half),
            self.half_plane([dy, -dx], -half),
            self.half_plane([dx, dy], start * length),
            last,
        ]
    }
}

/// How far along a line primitive the visible part goes.
#[derive(Clone, Copy)]
struct Visible {
    segment: Segment,
    /// Of the start and the end: w, and depth.
    w: [f64; 2],
    depth: [f64; 2],
    t: [f64; 2],
}

/// The part of a line that is inside of the planes that lines are cut at; the sides of the view
/// volume only decide whether there is one.
fn visible(
    view: &View,
    set_up: &SetUp<'_>,
    corners: &Corners<'_>,
    ends: [usize; 2],
) -> Option<Visible> {
    let [a, b] = ends.map(|end| corners.screen[end].code);
    let all = a | b;
    if a & b & code::REJECT != 0 || all & code::NOT_FINITE != 0 {
        return None;
    }
    let vertices = ends.map(|end| corners.vertex(end));
    let volume = &set_up.facts.volume;
    if all & code::SIDES != 0 {
        clip::line(vertices, all, true, &view.screen, volume)?;
    }
    if all & code::CLIPPED == 0 {
        let [a, b] = ends.map(|end| corners.screen[end]);
        return Some(Visible {
            segment: Segment {
                from: [a.x, a.y],
                to: [b.x, b.y],
            },
            w: ends.map(|end| corners.positions[end][3]),
            depth: [a.depth, b.depth],
            t: [0.0, 1.0],
        });
    }
    let t = clip::line(vertices, all, false, &view.screen, volume)?;
    let [from, to] = t.map(|t| clip::along(&vertices, t).position);
    if !(from[3] > 0.0 && to[3] > 0.0) {
        return None;
    }
    let depth = |position: super::screen::Clip| {
        position[2] / position[3] * view.screen.depth_scale + view.screen.depth_offset
    };
    Some(Visible {
        segment: Segment {
            from: clip::snap(&view.screen, &from),
            to: clip::snap(&view.screen, &to),
        },
        w: [from[3], to[3]],
        depth: [depth(from), depth(to)],
        t,
    })
}

/// How far along a line the closest point to a pixel's centre is, from 0 to 1, relative to the
/// origin.
#[inline(always)]
fn progress(segment: &Segment, origin: [i32; 2]) -> Wide {
    let pixel = f64::from(PIXEL);
    let [dx, dy] = segment.direction();
    let [dx, dy] = [f64::from(dx), f64::from(dy)];
    let square = dx * dx + dy * dy;
    let x = (f64::from(origin[0]) + 0.5) * pixel - f64::from(segment.from[0]);
    let y = (f64::from(origin[1]) + 0.5) * pixel - f64::from(segment.from[1]);
    Wide {
        at: (x * dx + y * dy) / square,
        dx: dx * pixel / square,
        dy: dy * pixel / square,
    }
}

/// Distances of a pixel's centre from the middle of a line, across and along it, in pixels; planes
/// relative to the origin.
fn from_middle(segment: &Segment, length: f64, origin: [i32; 2]) -> [Wide; 2] {
    let pixel = f64::from(PIXEL);
    let [dx, dy] = segment.direction().map(|d| f64::from(d) / length);
    let [x, y] = [0, 1].map(|axis| {
        let middle = (f64::from(segment.from[axis]) + f64::from(segment.to[axis])) / 2.0;
        f64::from(origin[axis]) + 0.5 - middle / pixel
    });
    let across = Wide {
        at: x * dy - y * dx,
        dx: dy,
        dy: -dx,
    };
    let along = Wide {
        at: x * dx + y * dy,
        dx,
        dy,
    };
    [across, along]
}

impl Visible {
    /// Of the two ends, in `ends`' places.
    fn planes(&self, corners: &Corners<'_>, ends: [usize; 2], origin: [i32; 2]) -> Planes {
        let s = progress(&self.segment, origin);
        let between = |from: f64, to: f64| Wide::constant(from).plus(s.times(to - from));
        let mut planes = Planes {
            origin,
            depth: between(self.depth[0], self.depth[1]),
            ..Planes::default()
        };
        let is_whole = self.t == [0.0, 1.0];
        for (place, end) in ends.into_iter().enumerate() {
            let share = self.t.map(|t| if place == 0 { 1.0 - t } else { t });
            let w = corners.positions[end][3];
            let perspective = between(share[0] / self.w[0], share[1] / self.w[1]);
            planes.perspective[end] = perspective;
            planes.linear[end] = if is_whole {
                between(share[0], share[1])
            } else {
                perspective.times(w)
            };
        }
        planes.is_affine = planes.perspective == planes.linear;
        planes
    }
}

/// The planes of a line whose ends are on the screen, as [`Visible::planes`] has them.
#[inline(always)]
fn whole_planes(segment: &Segment, [a, b]: [&ScreenVertex; 2], origin: [i32; 2]) -> Planes {
    let s = progress(segment, origin);
    let between = |from: f64, to: f64| Wide::constant(from).plus(s.times(to - from));
    Planes {
        origin,
        depth: between(a.depth, b.depth),
        perspective: [
            between(a.inverse_w, 0.0),
            between(0.0, b.inverse_w),
            Wide::default(),
        ],
        linear: [between(1.0, 0.0), between(0.0, 1.0), Wide::default()],
        is_affine: (a.inverse_w == 1.0) & (b.inverse_w == 1.0),
    }
}

impl SetUp<'_> {
    /// Draws the line between two corners of a primitive.
    #[cold]
    pub fn line(
        &mut self,
        primitive: &Primitive,
        corners: &Corners<'_>,
        ends: [usize; 2],
        front: bool,
        offset: f64,
    ) {
        let Some(view) = self.facts.views.get(primitive.viewport as usize) else {
            return;
        };
        let Some(visible) = visible(view, self, corners, ends) else {
            return;
        };
        let planes = |origin| visible.planes(corners, ends, origin);
        self.segment(primitive, view, &visible.segment, (front, offset), planes);
    }

    /// The codes of both vertices say that the line is whole and inside. A line primitive.
    #[inline(always)]
    pub fn whole_line(&mut self, primitive: &Primitive, ends: [&ScreenVertex; 2]) {
        let Some(view) = self.facts.views.get(primitive.viewport as usize) else {
            return;
        };
        let [a, b] = ends;
        let segment = Segment {
            from: [a.x, a.y],
            to: [b.x, b.y],
        };
        let planes = |origin| whole_planes(&segment, ends, origin);
        self.segment(primitive, view, &segment, (true, 0.0), planes);
    }

    /// Draws the visible part of a line. `planes`: of a record with an origin.
    #[inline(always)]
    fn segment(
        &mut self,
        primitive: &Primitive,
        view: &View,
        segment: &Segment,
        (front, offset): (bool, f64),
        planes: impl FnOnce([i32; 2]) -> Planes,
    ) {
        let lines = &self.facts.lines;
        self.clipped += 1;
        if segment.from == segment.to {
            return;
        }
        let width = f64::from(lines.width.max(0.0).min(1024.0)) * f64::from(PIXEL);
        // Pixels up to this distance from a smooth line meet it.
        let halo = if lines.smooth {
            f64::from(PIXEL) / 2.0
        } else {
            0.0
        };
        let reach = reach(lines, width).ceil() as i32;
        let around = around(segment, reach, self.facts.centers_only);
        let limits = view.scissor.intersection(inside(lines, view));
        let bounds = around.intersection(limits);
        let length = segment.length();
        let stippled = self.stippled;
        if lines.stipple.is_some() && !lines.bresenham {
            self.stippled += length / f64::from(PIXEL);
        }
        if is_empty(&bounds) && !lines.bresenham {
            return;
        }
        let origin = [around.left.max(0), around.top.max(0)];
        let planes = planes(origin);
        let record = self.chunk.records.len();
        let shapes = self.chunk.shapes.len();
        self.push_record(primitive, front, &planes, offset);
        if lines.smooth
            && let Some(record) = self.chunk.records.last_mut()
        {
            record.extra = self.chunk.extras.len() as u32;
            self.chunk.extras.push(Extra {
                point_coord: from_middle(segment, length, origin).map(Wide::narrow),
                half: [width, length].map(|it| (it / 2.0 / f64::from(PIXEL)) as f32),
            });
        }
        let mut add = |start: f64, end: f64| {
            // Dashes fade at the ends of the line alone.
            let start = if start == 0.0 { -halo } else { start };
            let end = if end == length { end + halo } else { end };
            let rectangle = self.chunk.edges.len() as u32;
            let edges = segment.rectangle(length, width + 2.0 * halo, start, end);
            self.chunk.edges.push(edges);
            self.chunk.shapes.push(Shape {
                record: record as u32,
                coverage: Coverage::Rectangle(rectangle),
                bounds,
            });
        };
        match lines.stipple {
            _ if lines.bresenham => self.bresenham(segment, record as u32, limits),
            Some(stipple) => {
                for [start, end] in dashes(segment, length, bounds, stippled, stipple) {
                    add(start, end);
                }
            }
            None => add(0.0, length),
        }
        if self.chunk.shapes.len() == shapes {
            self.chunk.records.truncate(record);
        }
    }
}

/// How far a line of a width reaches past its end points.
#[inline(always)]
fn reach(lines: &Lines, width: f64) -> f64 {
    if lines.smooth {
        width / 2.0 + f64::from(PIXEL)
    } else if lines.bresenham {
        width.max(f64::from(PIXEL))
    } else {
        width / 2.0
    }
}

/// The pixels to which a viewport cuts lines. Lines end there where their middle does; thin lines
/// need not be cut off.
#[inline(always)]
fn inside(lines: &Lines, view: &View) -> Bounds {
    let beyond = if lines.width > 1.0 {
        (lines.width / 2.0).ceil() as i32
    } else {
        0
    } + i32::from(lines.smooth);
    let inside = view.screen.inside;
    Bounds {
        left: inside.left.saturating_sub(beyond),
        top: inside.top.saturating_sub(beyond),
        right: inside.right.saturating_add(beyond),
        bottom: inside.bottom.saturating_add(beyond),
    }
}

/// The pixels that samples within `reach` of a line can be in.
#[inline(always)]
fn around(segment: &Segment, reach: i32, centers_only: bool) -> Bounds {
    let range = |axis: usize| {
        let (a, b) = (segment.from[axis], segment.to[axis]);
        pixels(a.min(b) - reach, a.max(b) + reach, centers_only)
    };
    let ((left, right), (top, bottom)) = (range(0), range(1));
    Bounds {
        left,
        top,
        right,
        bottom,
    }
}

/// Where the pattern of a stippled line has ones, in units of its length, as far as `bounds` show
/// it. The line starts `stippled` pixels after the pattern.
fn dashes(
    segment: &Segment,
    length: f64,
    bounds: Bounds,
    stippled: f64,
    (pattern, factor): (u16, u32),
) -> SmallVec<[[f64; 2]; 8]> {
    let pixel = f64::from(PIXEL);
    let [dx, dy] = segment.direction().map(|d| f64::from(d) / length);
    let corners = [
        (bounds.left, bounds.top),
        (bounds.right, bounds.top),
        (bounds.left, bounds.bottom),
        (bounds.right, bounds.bottom),
    ]
    .map(|(x, y)| {
        let [x, y] = [
            f64::from(x) * pixel - f64::from(segment.from[0]),
            f64::from(y) * pixel - f64::from(segment.from[1]),
        ];
        x * dx + y * dy
    });
    let first = corners.into_iter().fold(f64::INFINITY, f64::min).max(0.0);
    let last = corners.into_iter().fold(0.0, f64::max).min(length);
    let step = f64::from(factor) * pixel;
    let start = stippled * pixel;
    let bit = |at: f64| ((at + start) / step) as u64;
    let mut dashes = SmallVec::<[[f64; 2]; 8]>::new();
    if first > last {
        return dashes;
    }
    for index in bit(first)..=bit(last) {
        if pattern >> (index % 16) & 1 == 0 {
            continue;
        }
        let from = (index as f64 * step - start).max(0.0);
        let to = ((index + 1) as f64 * step - start).min(length);
        match dashes.last_mut() {
            Some(dash) if dash[1] == from => dash[1] = to,
            _ if from < to => dashes.push([from, to]),
            _ => {}
        }
    }
    dashes
}
