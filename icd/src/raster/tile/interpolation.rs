//! Numbers across a primitive, sixteen lanes at a time: planes, perspective-correct coordinates,
//! depths.

use lanes::vector::Vector;

use super::lanes::Row;
use super::samples::from_center;
use crate::raster::primitive::{PlaneEquation, Record};

/// The value of a plane at coordinates from its origin on.
#[inline(always)]
pub fn plane_at<V: Vector>(v: V, plane: &PlaneEquation, [x, y]: [V::F; 2]) -> V::F {
    let across = v.add(v.splat(plane.at), v.mul(v.splat(plane.dx), x));
    v.add(across, v.mul(v.splat(plane.dy), y))
}

/// Perspective-correct coordinates of the second and third vertex from the values of the
/// perspective planes.
#[inline(always)]
pub fn perspective_weights<V: Vector>(v: V, planes: [V::F; 3]) -> [V::F; 2] {
    let sum = v.add(v.add(planes[0], planes[1]), planes[2]);
    [v.div(planes[1], sum), v.div(planes[2], sum)]
}

/// A varying from its value at the first vertex, the differences of the others, and the coordinates
/// of those. One that is the same at all vertices comes out as it is.
#[inline(always)]
pub fn interpolate<V: Vector>(
    v: V,
    first: V::F,
    [second, third]: [V::F; 2],
    weights: [V::F; 2],
) -> V::F {
    v.add(
        v.add(first, v.mul(weights[0], second)),
        v.mul(weights[1], third),
    )
}

/// A word of the vertices' outputs as a number; zero where there is none.
#[inline(always)]
pub fn number(outputs: &[u32], place: u32) -> f32 {
    match outputs.get(place as usize) {
        Some(&word) => f32::from_bits(word),
        None => 0.0,
    }
}

/// Depths of fragments of one record from pixel (x, y) on at a sample, those of its plane, clamped
/// to a range where there is one. `steps`: the lanes' columns and rows.
#[inline(always)]
pub fn depths<V: Vector>(
    v: V,
    record: &Record,
    [x, y]: [i32; 2],
    steps: &[Row; 2],
    location: [i32; 2],
    range: Option<[f32; 2]>,
) -> V::F {
    let [inside_x, inside_y] = from_center(location);
    let from_x = v.splat_i(x.wrapping_sub(record.origin[0].into()));
    let from_y = v.splat_i(y.wrapping_sub(record.origin[1].into()));
    let x = v.to_f(v.add_i(from_x, v.load_i(&steps[0])));
    let y = v.to_f(v.add_i(from_y, v.load_i(&steps[1])));
    let at = [v.add(v.splat(inside_x), x), v.add(v.splat(inside_y), y)];
    let depths = plane_at(v, &record.depth, at);
    match range {
        Some(range) => clamped(v, depths, range),
        None => depths,
    }
}

/// Depths clamped to a range, whose ends come in any order.
#[inline(always)]
pub fn clamped<V: Vector>(v: V, depths: V::F, [near, far]: [f32; 2]) -> V::F {
    let (least, most) = if near < far { (near, far) } else { (far, near) };
    v.min(v.max(depths, v.splat(least)), v.splat(most))
}

/// Clamps a depth to a range, whose ends come in any order.
#[inline(always)]
pub fn clamp(depth: f32, range: Option<[f32; 2]>) -> f32 {
    let Some([near, far]) = range else {
        return depth;
    };
    let (least, most) = if near < far { (near, far) } else { (far, near) };
    let depth = if depth > least { depth } else { least };
    if depth < most { depth } else { most }
}
