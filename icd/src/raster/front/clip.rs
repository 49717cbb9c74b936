//! Clipping in homogeneous coordinates (spec, "Primitive Clipping"; Sutherland and Hodgman,
//! "Reentrant Polygon Clipping", 1974).
//!
//! Two primitives that share an edge cut it at the same points to the bit: a point on an edge is
//! computed from its inner end towards its outer one, plane after plane, from nothing but the two.

#![forbid(unsafe_code)]

use smallvec::SmallVec;

use super::screen::{Clip, GUARD, PIXEL, Screen, Volume, code, round};

/// `maxClipDistances`.
pub const MAX_CLIP_DISTANCES: usize = 8;

/// A vertex while it is clipped.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vertex {
    pub position: Clip,
    pub distances: [f64; MAX_CLIP_DISTANCES],
}

/// Planes: near, far, eight distances, w, four sides of the viewport, four of the guard band. A
/// convex polygon gains one vertex at each.
const MAX_VERTICES: usize = 3 + 2 + MAX_CLIP_DISTANCES + 1 + 4 + 4;

/// A convex polygon.
pub type Polygon = SmallVec<[Vertex; MAX_VERTICES]>;

/// A plane of the volume.
#[derive(Clone, Copy, Debug)]
enum ClipPlane {
    Near,
    Far,
    Distance(usize),
    /// Sides of the view volume.
    Side(usize, f64),
    /// Sides of the guard band.
    Guard(usize, f64),
}

impl ClipPlane {
    /// How far inside a vertex is; negative outside.
    fn distance(self, vertex: &Vertex, screen: &Screen, volume: &Volume) -> f64 {
        let position = &vertex.position;
        match self {
            Self::Near if volume.negative_one_to_one => position[2] + position[3],
            Self::Near => position[2],
            Self::Far => position[3] - position[2],
            Self::Distance(index) => vertex.distances[index],
            Self::Side(axis, sign) => position[3] + sign * position[axis],
            Self::Guard(axis, sign) => {
                GUARD * position[3] + sign * screen.homogeneous(position)[axis]
            }
        }
    }
}

/// The planes that a primitive with vertices outside of `codes` is cut at, in their order.
fn planes(codes: u32, sides: bool) -> impl Iterator<Item = ClipPlane> {
    let when = |condition: bool, plane: ClipPlane| condition.then_some(plane);
    let has = move |bit: u32| codes & bit != 0;
    let distances = (0..MAX_CLIP_DISTANCES).filter_map(move |index| {
        when(
            has(1 << (code::CLIP as usize + index)),
            ClipPlane::Distance(index),
        )
    });
    let side = |bit: u32, axis, sign| when(sides && codes & bit != 0, ClipPlane::Side(axis, sign));
    let nowhere = has(code::NOWHERE);
    [
        when(has(code::NEAR), ClipPlane::Near),
        when(has(code::FAR), ClipPlane::Far),
    ]
    .into_iter()
    .flatten()
    .chain(distances)
    .chain(
        [
            side(code::LEFT, 0, 1.0),
            side(code::RIGHT, 0, -1.0),
            side(code::TOP, 1, 1.0),
            side(code::BOTTOM, 1, -1.0),
            when(nowhere, ClipPlane::Guard(0, 1.0)),
            when(nowhere, ClipPlane::Guard(0, -1.0)),
            when(nowhere, ClipPlane::Guard(1, 1.0)),
            when(nowhere, ClipPlane::Guard(1, -1.0)),
        ]
        .into_iter()
        .flatten(),
    )
}

fn between(inner: &Vertex, outer: &Vertex, inside: f64, outside: f64) -> Vertex {
    let t = inside / (inside - outside);
    let mix = |a: f64, b: f64| a + t * (b - a);
    Vertex {
        position: std::array::from_fn(|i| mix(inner.position[i], outer.position[i])),
        distances: std::array::from_fn(|i| mix(inner.distances[i], outer.distances[i])),
    }
}

/// The part of a triangle that is inside; empty if there is none. `codes` are those of all vertices
/// together; `sides`: at the view volume's sides, too.
pub fn polygon(
    triangle: [Vertex; 3],
    codes: u32,
    sides: bool,
    screen: &Screen,
    volume: &Volume,
) -> Polygon {
    let mut polygon: Polygon = triangle.into_iter().collect();
    for plane in planes(codes, sides) {
        let source = std::mem::take(&mut polygon);
        let distance = |vertex: &Vertex| plane.distance(vertex, screen, volume);
        let Some(mut previous) = source.last() else {
            break;
        };
        let mut before = distance(previous);
        for vertex in &source {
            let here = distance(vertex);
            // NaN counts as outside.
            let (was_in, is_in) = (before >= 0.0, here >= 0.0);
            if was_in != is_in {
                polygon.push(if is_in {
                    between(vertex, previous, here, before)
                } else {
                    between(previous, vertex, before, here)
                });
            }
            if is_in {
                polygon.push(*vertex);
            }
            (previous, before) = (vertex, here);
        }
    }
    if polygon.iter().any(|vertex| !(vertex.position[3] > 0.0)) {
        polygon.clear();
    }
    polygon
}

/// The part of a line that is inside: how far along it, from 0 to 1, it starts and ends.
pub fn line(
    ends: [Vertex; 2],
    codes: u32,
    sides: bool,
    screen: &Screen,
    volume: &Volume,
) -> Option<[f64; 2]> {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for plane in planes(codes, sides) {
        let [a, b] = ends
            .each_ref()
            .map(|end| plane.distance(end, screen, volume));
        match (a >= 0.0, b >= 0.0) {
            (true, true) => {}
            (false, false) => return None,
            (true, false) => to = to.min(a / (a - b)),
            (false, true) => from = from.max(a / (a - b)),
        }
    }
    (from <= to).then_some([from, to])
}

/// A vertex on a line, `t` of the way.
pub fn along(ends: &[Vertex; 2], t: f64) -> Vertex {
    if t <= 0.0 {
        ends[0]
    } else if t >= 1.0 {
        ends[1]
    } else {
        let mix = |a: f64, b: f64| a + t * (b - a);
        Vertex {
            position: std::array::from_fn(|i| mix(ends[0].position[i], ends[1].position[i])),
            distances: [0.0; MAX_CLIP_DISTANCES],
        }
    }
}

/// Where a clipped vertex is on the screen, in fixed point: as [`project`](super::screen::project)
/// has it where nothing was cut.
pub fn snap(screen: &Screen, position: &Clip) -> [i32; 2] {
    let inverse_w = 1.0 / position[3];
    std::array::from_fn(|axis| {
        let pixels = position[axis] * inverse_w * screen.scale[axis] + screen.offset[axis];
        // Of what is no number (nothing is left of such a polygon anyhow): a number all the same.
        let pixels = pixels.max(-GUARD).min(GUARD);
        round(pixels * f64::from(PIXEL))
    })
}
