//! Triangles: facing, culling, clipping, edges.

#![forbid(unsafe_code)]

use ash::vk;

use super::clip;
use super::planes::{self, Planes};
use super::screen::{PIXEL, Screen, ScreenVertex, code, pixels};
use super::set_up::{Corners, Primitive, SetUp, is_empty};
use crate::raster::primitive::{Bounds, Coverage, Edge, Shape, area, triangle_edges};

/// A place on the screen in fixed point.
type FixedPoint = [i32; 2];

/// The pixels that samples of a triangle can be in.
#[inline(always)]
fn around(places: [FixedPoint; 3], centers_only: bool) -> Bounds {
    let [a, b, c] = places;
    let least = |i: usize| a[i].min(b[i]).min(c[i]);
    let greatest = |i: usize| a[i].max(b[i]).max(c[i]);
    let (left, right) = pixels(least(0), greatest(0), centers_only);
    let (top, bottom) = pixels(least(1), greatest(1), centers_only);
    Bounds {
        left,
        top,
        right,
        bottom,
    }
}

/// Whether a triangle has none of the centres of its pixels; false without a look where those are
/// more than two, of which it mostly has one.
#[inline(always)]
fn passes_between(corners: [FixedPoint; 3], bounds: &Bounds) -> bool {
    const FEW: i32 = 2;
    let (width, height) = (bounds.right - bounds.left, bounds.bottom - bounds.top);
    if width > FEW || height > FEW || width * height > FEW {
        return false;
    }
    let [p, q, r, _] = triangle_edges(corners);
    let center = |pixel: i32| i64::from(pixel) * i64::from(PIXEL) + i64::from(PIXEL / 2);
    for y in bounds.top..bounds.bottom {
        for x in bounds.left..bounds.right {
            let (x, y) = (center(x), center(y));
            let at = |edge: &Edge| i64::from(edge.a) * x + i64::from(edge.b) * y + edge.c;
            // Not negative is what a sample inside an edge is.
            if at(&p) | at(&q) | at(&r) >= 0 {
                return false;
            }
        }
    }
    true
}

/// The pixel that planes start at: near the primitive, and the same whatever the scissor and the
/// render area are.
#[inline(always)]
fn origin(around: Bounds, screen: &Screen) -> [i32; 2] {
    [
        around.left.max(screen.inside.left).max(0),
        around.top.max(screen.inside.top).max(0),
    ]
}

impl SetUp<'_> {
    /// Without branches but one: signs of areas are hard to predict.
    #[inline(always)]
    fn is_culled(&self, area: i64) -> bool {
        (area == 0) | (area > 0) & self.facts.cull_positive | (area < 0) & self.facts.cull_negative
    }

    /// The codes of all three vertices say that the triangle is whole and inside. Filled.
    #[inline(always)]
    pub fn whole_triangle(&mut self, primitive: &Primitive, vertices: [&ScreenVertex; 3]) {
        let Some(view) = self.facts.views.get(primitive.viewport as usize) else {
            return;
        };
        let [a, b, c] = vertices;
        let places = [[a.x, a.y], [b.x, b.y], [c.x, c.y]];
        // First: of most models it drops half the triangles.
        let area = area(places);
        if self.is_culled(area) {
            return;
        }
        let around = around(places, self.facts.centers_only);
        let bounds = around.intersection(view.clipped);
        if is_empty(&bounds) {
            return;
        }
        if self.facts.centers_only && passes_between(places, &bounds) {
            return;
        }
        let origin = origin(around, &view.screen);
        let planes = planes::of_triangle(&vertices, area, origin);
        let offset = self.depth_offset(&planes, &vertices);
        let front = (area > 0) == self.facts.positive_is_front;
        let record = self.push_record(primitive, front, &planes, offset);
        self.chunk.shapes.push(Shape {
            record,
            coverage: Coverage::Triangle(places),
            bounds,
        });
    }

    #[inline(always)]
    fn depth_offset(&self, planes: &Planes, vertices: &[&ScreenVertex; 3]) -> f64 {
        let Some(bias) = &self.facts.bias else {
            return 0.0;
        };
        let slope = planes.depth.dx.abs().max(planes.depth.dy.abs());
        let greatest = vertices
            .iter()
            .filter(|vertex| vertex.code & code::NOWHERE == 0)
            .fold(0.0f64, |greatest, vertex| greatest.max(vertex.depth.abs()));
        bias.of(slope, greatest)
    }

    /// Any triangle.
    #[cold]
    pub fn triangle(&mut self, primitive: &Primitive, corners: &Corners<'_>) {
        let facts = self.facts;
        let Some(view) = facts.views.get(primitive.viewport as usize) else {
            return;
        };
        let codes = corners.screen.map(|vertex| vertex.code);
        let all = codes[0] | codes[1] | codes[2];
        if codes[0] & codes[1] & codes[2] & code::REJECT != 0 || all & code::NOT_FINITE != 0 {
            return;
        }
        let sides = !view.screen.whole_pixels && !facts.centers_only;
        let needs_clipping = all & code::CLIPPED != 0 || sides && all & code::SIDES != 0;
        if !needs_clipping && facts.polygon_mode == vk::PolygonMode::FILL {
            self.clipped += 1;
            return self.whole_triangle(primitive, corners.screen);
        }
        let screen = view.screen;
        let polygon = clip::polygon(
            std::array::from_fn(|i| corners.vertex(i)),
            all,
            sides,
            &screen,
            &facts.volume,
        );
        self.clipped += u64::from(polygon.len() >= 3);
        let places: smallvec::SmallVec<[FixedPoint; 24]> = polygon
            .iter()
            .map(|vertex| clip::snap(&screen, &vertex.position))
            .collect();
        let Some((&first, rest)) = places.split_first() else {
            return;
        };
        let whole: i64 = rest
            .windows(2)
            .map(|pair| area([first, pair[0], pair[1]]))
            .sum();
        if self.is_culled(whole) {
            return;
        }
        let front = (whole > 0) == facts.positive_is_front;
        let hull = hull(&places, facts.centers_only);
        let origin = origin(hull, &screen);
        let planes = if all & code::NOWHERE == 0 {
            let [a, b, c] = corners.screen.map(|vertex| [vertex.x, vertex.y]);
            match area([a, b, c]) {
                0 => planes::of_homogeneous(&screen, &corners.positions, &corners.screen, origin),
                area => planes::of_triangle(&corners.screen, area, origin),
            }
        } else {
            planes::of_homogeneous(&screen, &corners.positions, &corners.screen, origin)
        };
        let offset = self.depth_offset(&planes, &corners.screen);
        match facts.polygon_mode {
            vk::PolygonMode::LINE => return self.outline(primitive, corners, front, offset),
            vk::PolygonMode::POINT => return self.corner_points(primitive, corners, front, offset),
            _ => {}
        }
        if is_empty(&hull.intersection(view.clipped)) {
            return;
        }
        let clipped = view.clipped;
        let record = self.push_record(primitive, front, &planes, offset);
        for pair in rest.windows(2) {
            let piece = [first, pair[0], pair[1]];
            let area = area(piece);
            let bounds = around(piece, facts.centers_only).intersection(clipped);
            // Snapped, a polygon may have a corner that points inwards: what it folds over is
            // covered by others.
            if area == 0 || (area > 0) != (whole > 0) || is_empty(&bounds) {
                continue;
            }
            self.chunk.shapes.push(Shape {
                record,
                coverage: Coverage::Triangle(piece),
                bounds,
            });
        }
    }

    /// `VK_POLYGON_MODE_LINE`.
    fn outline(&mut self, primitive: &Primitive, corners: &Corners<'_>, front: bool, offset: f64) {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            self.line(primitive, corners, [from, to], front, offset);
        }
    }

    /// `VK_POLYGON_MODE_POINT`.
    fn corner_points(
        &mut self,
        primitive: &Primitive,
        corners: &Corners<'_>,
        front: bool,
        offset: f64,
    ) {
        for corner in 0..3 {
            let (vertex, size) = (corners.screen[corner], corners.point_sizes[corner]);
            self.point(primitive, vertex, size, corner, (front, offset));
        }
    }
}

/// The pixels that samples of a polygon can be in.
fn hull(places: &[FixedPoint], centers_only: bool) -> Bounds {
    let range = |axis: usize| {
        let values = || places.iter().map(|place| place[axis]);
        (
            values().min().unwrap_or_default(),
            values().max().unwrap_or_default(),
        )
    };
    let ((left, right), (top, bottom)) = (range(0), range(1));
    let (left, right) = pixels(left, right, centers_only);
    let (top, bottom) = pixels(top, bottom, centers_only);
    Bounds {
        left,
        top,
        right,
        bottom,
    }
}
