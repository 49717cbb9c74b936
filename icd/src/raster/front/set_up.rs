//! Set-up: from vertices on the screen to records and shapes.

#![forbid(unsafe_code)]

use super::clip::{self, MAX_CLIP_DISTANCES};
use super::facts::Facts;
use super::planes::{Planes, Wide};
use super::screen::{Clip, ScreenVertex};
use crate::raster::primitive::{Bounds, Chunk, PlaneEquation, Record};

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
        let mut depth = planes.depth;
        depth.at += depth_offset;
        let is_affine = planes.is_affine;
        let linear = self.chunk.linear.len() as u32;
        if !is_affine {
            self.chunk.linear.push(narrow(&planes.linear));
        }
        self.chunk.records.push(Record {
            draw: primitive.draw,
            primitive_id: primitive.primitive_id,
            // There are fewer layers, views, viewports, and pixels along a side of an attachment.
            layer: primitive.layer as u16,
            view_index: primitive.view_index as u8,
            viewport: primitive.viewport as u8,
            front,
            is_affine,
            provoking: primitive.provoking,
            vertices: primitive.vertices,
            words: primitive.words,
            origin: [planes.origin[0] as i16, planes.origin[1] as i16],
            depth: depth.narrow(),
            perspective: narrow(&planes.perspective),
            linear,
            extra: u32::MAX,
        });
        index
    }
}
