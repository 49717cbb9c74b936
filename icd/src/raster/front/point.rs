//! Points: squares around their position (spec, "Points").

#![forbid(unsafe_code)]

use super::planes::{Planes, Wide};
use super::screen::{PIXEL, ScreenVertex, code, pixels};
use super::set_up::{Primitive, SetUp, is_empty};
use crate::raster::primitive::{Bounds, Coverage, Extra, Shape};

/// `pointSizeRange`.
pub const POINT_SIZES: [f32; 2] = [1.0, 256.0];

impl SetUp<'_> {
    /// Draws a corner of a primitive as a point of that size. It is clipped by its centre alone
    /// (`VK_POINT_CLIPPING_BEHAVIOR_ALL_CLIP_PLANES`).
    pub fn point(
        &mut self,
        primitive: &Primitive,
        vertex: &ScreenVertex,
        size: f32,
        corner: usize,
        (front, offset): (bool, f64),
    ) {
        const OUT: u32 = code::REJECT | code::NOWHERE | code::NOT_FINITE;
        let Some(view) = self.facts.views.get(primitive.viewport as usize) else {
            return;
        };
        if vertex.code & OUT != 0 {
            return;
        }
        self.clipped += 1;
        let [least, greatest] = POINT_SIZES;
        // NaN becomes the least.
        let size = f64::from(size.max(least).min(greatest));
        let side = (size * f64::from(PIXEL)) as i32;
        let (left, top) = (vertex.x - side / 2, vertex.y - side / 2);
        let (right, bottom) = (left + side, top + side);
        let (first_x, end_x) = pixels(left, right, self.facts.centers_only);
        let (first_y, end_y) = pixels(top, bottom, self.facts.centers_only);
        let around = Bounds {
            left: first_x,
            top: first_y,
            right: end_x,
            bottom: end_y,
        };
        let bounds = around.intersection(view.scissor);
        if is_empty(&bounds) {
            return;
        }
        let origin = [around.left.max(0), around.top.max(0)];
        let mut linear = [Wide::default(); 3];
        linear[corner] = Wide::constant(1.0);
        let planes = Planes {
            origin,
            depth: Wide::constant(vertex.depth),
            perspective: linear.map(|plane| plane.times(vertex.inverse_w)),
            linear,
            is_affine: vertex.inverse_w == 1.0,
        };
        let record = self.push_record(primitive, front, &planes, offset);
        let coordinate = |axis: usize| {
            let place = f64::from([vertex.x, vertex.y][axis]) / f64::from(PIXEL);
            let center = f64::from(origin[axis]) + 0.5;
            let slope = 1.0 / size;
            Wide {
                at: 0.5 + (center - place) * slope,
                dx: if axis == 0 { slope } else { 0.0 },
                dy: if axis == 1 { slope } else { 0.0 },
            }
            .narrow()
        };
        self.chunk.records[record as usize].extra = self.chunk.extras.len() as u32;
        self.chunk.extras.push(Extra {
            point_coord: [coordinate(0), coordinate(1)],
            half: [0.0; 2],
        });
        self.chunk.shapes.push(Shape {
            record,
            coverage: Coverage::Upright {
                least: [left, top],
                greatest: [right, bottom],
            },
            bounds,
        });
    }
}
