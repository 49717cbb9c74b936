//! Set-up: from vertices on the screen to records and shapes.

#![forbid(unsafe_code)]

use super::clip::{self, MAX_CLIP_DISTANCES};
use super::facts::Facts;
use super::planes::{Planes, Wide};
use super::screen::{Clip, ScreenVertex};
use crate::raster::primitive::{Bounds, Chunk, Edge, PlaneEquation, Record};

/// The facts of a primitive that set-up needs besides its vertices.
#[derive(Clone, Copy, Debug, Default)]
pub struct Primitive {
    /// Index of the draw in the batch's work.
    pub draw: u32,
    pub primitive_id: u32,
    pub layer: u32,
    pub view_index: u32,
    pub viewport: u32,
    /// First words of the vertices' outputs.
    pub vertices: [u32; 3],
    pub provoking: u8,
    /// First of the words that a mesh program gave to it.
    pub words: u32,
}

/// Vertices of a primitive, on the screen and before projection.
pub struct Corners<'a> {
    pub screen: [&'a ScreenVertex; 3],
    pub positions: [Clip; 3],
    /// Of the vertices, clip distances in turn.
    pub distances: [[f64; MAX_CLIP_DISTANCES]; 3],
    pub point_sizes: [f32; 3],
}

impl Corners<'_> {
    /// A vertex, to be clipped.
    pub fn vertex(&self, index: usize) -> clip::Vertex {
        clip::Vertex {
            position: self.positions[index],
            distances: self.distances[index],
        }
    }
}

/// Where primitives of a run go.
pub struct SetUp<'a> {
    pub facts: &'a Facts,
    pub chunk: &'a mut Chunk,
    /// Fragments of stippled lines since the last restart of the pattern.
    pub stippled: f64,
    /// Primitives after clipping; each piece counts (`CLIPPING_PRIMITIVES`).
    pub clipped: u64,
}

/// An edge with that direction into its inside; samples on it are inside of one of two neighbours.
#[inline(always)]
pub fn edge(a: i32, b: i32, c: i64) -> Edge {
    let owns = a > 0 || (a == 0 && b > 0);
    Edge {
        a,
        b,
        c: c - i64::from(!owns),
    }
}

/// Whether there are pixels.
#[inline(always)]
pub fn is_empty(bounds: &Bounds) -> bool {
    bounds.left >= bounds.right || bounds.top >= bounds.bottom
}

#[inline(always)]
fn narrow([a, b, c]: &[Wide; 3]) -> [PlaneEquation; 3] {
    [a.narrow(), b.narrow(), c.narrow()]
}

impl SetUp<'_> {
    /// Adds a record, for shapes to name.
    #[inline(always)]
    pub fn push_record(
        &mut self,
        primitive: &Primitive,
        front: bool,
        planes: &Planes,
        depth_offset: f64,
    ) -> u32 {
        let index = self.chunk.records.len() as u32;
        let view = &self.facts.views[primitive.viewport as usize];
        let mut depth = planes.depth;
        depth.at += depth_offset;
        self.chunk.records.push(Record {
            draw: primitive.draw,
            primitive_id: primitive.primitive_id,
            layer: primitive.layer,
            view_index: primitive.view_index,
            viewport: primitive.viewport,
            front,
            vertices: primitive.vertices,
            provoking: primitive.provoking,
            words: primitive.words,
            origin: planes.origin,
            depth: depth.narrow(),
            depth_range: if self.facts.depth_clamp {
                let range = self.facts.depth_clamp_range;
                range.unwrap_or(view.screen.depth_range)
            } else {
                [f32::NEG_INFINITY, f32::INFINITY]
            },
            perspective: narrow(&planes.perspective),
            is_affine: planes.perspective == planes.linear,
            linear: narrow(&planes.linear),
            point_coord: Default::default(),
            half: [0.0; 2],
        });
        index
    }
}
