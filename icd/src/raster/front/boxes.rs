//! Upright rectangles of two triangles, as sprites and user interfaces have them: if each output
//! has one plane for both, the second triangle becomes a part of the first one's shape and record.
//!
//! The fragments of the second triangle then come from the first one's planes. Both planes are the
//! same numbers, rounded at other places (spec, "Polygon Rasterization", leaves the precision of
//! interpolation open). Depth is the same everywhere, so that it keeps its bits.

#![forbid(unsafe_code)]

use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::program::{Builtin, InputRow, VaryingMode};

use super::screen::ScreenVertex;
use super::vertices::Shaded;
use crate::raster::Draw;
use crate::raster::primitive::{Chunk, Coverage, area, corners_in};

/// A triangle whose shape is the last one of its chunk.
struct Latest {
    vertices: [u32; 3],
    places: [[i32; 2]; 3],
    depth: f64,
    /// Layer, view and viewport.
    destination: [u32; 3],
    /// Shapes of the chunk.
    shapes: usize,
}

/// The words of vertices that fragments see.
#[derive(Default)]
struct SeenWords {
    interpolated: SmallVec<[u32; 16]>,
    flat: SmallVec<[u32; 4]>,
}

/// The triangles of a draw, one after the other.
pub struct Boxes<'a> {
    programs: Option<[&'a Program; 2]>,
    /// Found for the first pair that may be a box; none if fragments see more than such words.
    words: Option<Option<SeenWords>>,
    latest: Option<Latest>,
}

/// The words of a vertex that a fragment program sees, after a program; none if it sees which
/// triangle a fragment is of.
fn seen_words([before, fragment]: [&Program; 2]) -> Option<SeenWords> {
    let mut words = SeenWords::default();
    for input in fragment.inputs() {
        match input {
            InputRow::Varying(varying) => {
                let wanted = varying.output();
                // Varyings that are not written are zero.
                let Some(word) = before.outputs().iter().position(|row| *row == wanted) else {
                    continue;
                };
                match varying.mode {
                    VaryingMode::Flat => words.flat.push(word as u32),
                    VaryingMode::PerVertex(_) => return None,
                    VaryingMode::Smooth(_) | VaryingMode::Linear(_) => {
                        words.interpolated.push(word as u32);
                    }
                }
            }
            InputRow::Builtin(
                Builtin::PrimitiveId | Builtin::PerspectivePlanes | Builtin::LinearPlanes,
                _,
            )
            | InputRow::Barycentric(_) => return None,
            _ => {}
        }
    }
    Some(words)
}

/// The vertices of a triangle by the corners of its bounds: those of an upright rectangle, a number
/// each, as [`corners_in`] counts them.
fn by_corner(
    vertices: [u32; 3],
    places: &[[i32; 2]; 3],
    [least, greatest]: [[i32; 2]; 2],
) -> Option<[Option<u32>; 4]> {
    let mut found = [None; 4];
    for (vertex, corner) in vertices
        .into_iter()
        .zip(corners_in(places, least, greatest)?)
    {
        found[corner as usize] = Some(vertex);
    }
    Some(found)
}

impl<'a> Boxes<'a> {
    /// Of a draw; `before` is the last program before the fragments. There are none where
    /// fragments need no program, since the tiles have other ways for these, and where a fragment
    /// may be of several pixels.
    pub fn new(draw: &'a Draw, is_filled: bool) -> Self {
        let rate = &draw.state.shading_rate;
        let are_pixels = rate.pipeline.is_one() && rate.uses() == [false; 2];
        let runs = |it: &&Program| it.pass_through().is_none() && it.modulated().is_none();
        let fragment = draw.stages.fragment().filter(runs);
        let before = draw.stages.last().filter(|it| it.mesh().is_none());
        let programs = before.zip(fragment).map(<[&Program; 2]>::from);
        Self {
            programs: programs.filter(|_| is_filled && are_pixels),
            words: None,
            latest: None,
        }
    }

    /// Notes a triangle whose shape was the last one to be added, if there are more than `shapes`
    /// now and it may be one half of a box.
    #[inline(always)]
    pub fn note(
        &mut self,
        vertices: [u32; 3],
        destination: [u32; 3],
        on_screen: [&ScreenVertex; 3],
        (shapes, chunk): (usize, &Chunk),
    ) {
        if self.programs.is_none() {
            return;
        }
        let is_one = chunk.shapes.len() == shapes + 1 && is_level(on_screen);
        self.latest = is_one.then(|| Latest {
            vertices,
            places: on_screen.map(|vertex| [vertex.x, vertex.y]),
            depth: on_screen[0].depth,
            destination,
            shapes: shapes + 1,
        });
    }

    /// Makes a triangle a part of the latest one's shape, if both are a box; else gives false.
    #[inline(always)]
    pub fn join(
        &mut self,
        vertices: [u32; 3],
        destination: [u32; 3],
        on_screen: [&ScreenVertex; 3],
        (shaded, chunk): (&Shaded<'_>, &mut Chunk),
    ) -> bool {
        match &self.latest {
            Some(latest) if is_level(on_screen) && latest.depth == on_screen[0].depth => {}
            _ => return false,
        }
        self.join_level(vertices, destination, on_screen, (shaded, chunk))
    }

    fn join_level(
        &mut self,
        vertices: [u32; 3],
        destination: [u32; 3],
        on_screen: [&ScreenVertex; 3],
        (shaded, chunk): (&Shaded<'_>, &mut Chunk),
    ) -> bool {
        let (Some(latest), Some(programs)) = (self.latest.take(), self.programs) else {
            return false;
        };
        let places = on_screen.map(|vertex| [vertex.x, vertex.y]);
        let may_join = latest.destination == destination
            && chunk.shapes.len() == latest.shapes
            && (area(places) > 0) == (area(latest.places) > 0);
        let [a, b, c] = places;
        let sides = [
            [a[0].min(b[0]).min(c[0]), a[1].min(b[1]).min(c[1])],
            [a[0].max(b[0]).max(c[0]), a[1].max(b[1]).max(c[1])],
        ];
        let first = by_corner(latest.vertices, &latest.places, sides);
        let second = by_corner(vertices, &places, sides);
        let (true, Some(first), Some(second)) = (may_join, first, second) else {
            return false;
        };
        let words = (self.words).get_or_insert_with(|| seen_words(programs));
        let is_box = (words.as_ref()).is_some_and(|words| words.are_planes(shaded, first, second));
        if let Some(shape) = chunk.shapes.last_mut().filter(|_| is_box) {
            let [least, greatest] = sides;
            shape.coverage = Coverage::Upright { least, greatest };
        }
        is_box
    }
}

/// Whether the depth of a triangle is the same everywhere, and no output changes with perspective.
#[inline(always)]
fn is_level([a, b, c]: [&ScreenVertex; 3]) -> bool {
    a.inverse_w == 1.0
        && b.inverse_w == 1.0
        && c.inverse_w == 1.0
        && a.depth == b.depth
        && a.depth == c.depth
}

impl SeenWords {
    /// Whether each word of the vertices of two triangles, by corner, has one plane. The triangles
    /// lack one corner each.
    fn are_planes(
        &self,
        shaded: &Shaded<'_>,
        first: [Option<u32>; 4],
        second: [Option<u32>; 4],
    ) -> bool {
        let missing = |corners: &[Option<u32>; 4]| {
            let mut places = (0..4).filter(|&corner: &usize| corners[corner].is_none());
            places.next().filter(|_| places.next().is_none())
        };
        let (Some(far), Some(near)) = (missing(&first), missing(&second)) else {
            return false;
        };
        if near != far ^ 3 {
            return false;
        }
        let word = |corners: &[Option<u32>; 4], corner: usize, word: u32| {
            let vertex = corners[corner].unwrap_or(0) as usize;
            shaded.words[vertex * shaded.places.words + word as usize]
        };
        // The corners beside the diagonal, and those on it, which both triangles have.
        let of = |at: u32| {
            let shared = [near ^ 1, near ^ 2];
            let [a, b] = shared.map(|corner| word(&first, corner, at));
            let is_shared = [a, b] == shared.map(|corner| word(&second, corner, at));
            is_shared.then_some([word(&first, near, at), a, b, word(&second, far, at)])
        };
        let is_flat = |it: &u32| of(*it).is_some_and(|[near, a, b, far]| [a, b, far] == [near; 3]);
        // The same along one of the sides: the plane is exact.
        let is_plane = |it: &u32| {
            of(*it).is_some_and(|[near, a, b, far]| near == a && b == far || near == b && a == far)
        };
        self.flat.iter().all(is_flat) && self.interpolated.iter().all(is_plane)
    }
}
