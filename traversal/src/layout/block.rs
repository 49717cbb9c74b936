//! Leaves of little memory: up to eight triangles over the vertices that they share.

use super::margin::longest_side;
use super::{GROUP, LEAF_TRIANGLES, Margin, TriangleGroup};

/// Vertices of a block, at most: three for each triangle.
pub(crate) const BLOCK_VERTICES: usize = 3 * LEAF_TRIANGLES;
/// Bytes of what blocks are measured in.
pub(crate) const BLOCK_UNIT: usize = 16;
/// Units of the largest block. After the start of each, so much may be read.
pub(crate) const BLOCK_UNITS: u32 = (size_of::<Block>() / BLOCK_UNIT) as u32;

/// A block as it may be read from its start on; most end sooner. After the head come, without gaps:
///
/// ```text
/// primitives          4 bytes for each triangle
/// coordinates         x of each vertex, then y, then z
/// geometries          4 bytes for each triangle, where they differ
/// ```
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub(crate) struct Block {
    /// `[corner][triangle]`: which vertex.
    pub corners: [[u8; LEAF_TRIANGLES]; 3],
    /// How many there are.
    pub triangle_count: u8,
    pub vertex_count: u8,
    /// 1: triangles are of several geometries.
    pub mixed: u8,
    /// The exponent of a power of two, as f32 has it: no side of a box around a triangle is longer.
    pub extent: u8,
    /// The [`super::geometry_word`] of all triangles, unless they are mixed.
    pub geometry: u32,
    pub words: [u32; WORDS],
}

const WORDS: usize = 2 * LEAF_TRIANGLES + 3 * BLOCK_VERTICES;

impl Block {
    pub const EMPTY: Block = Block {
        corners: [[0; LEAF_TRIANGLES]; 3],
        triangle_count: 0,
        vertex_count: 0,
        mixed: 0,
        extent: u8::MAX,
        geometry: 0,
        words: [0; WORDS],
    };

    /// Triangles that it holds, whatever it says.
    #[inline(always)]
    pub fn triangles(&self) -> usize {
        usize::from(self.triangle_count).min(LEAF_TRIANGLES)
    }

    #[inline(always)]
    fn vertices(&self) -> usize {
        usize::from(self.vertex_count).min(BLOCK_VERTICES)
    }

    /// Where the coordinates of an axis begin, of which 24 may be read.
    #[inline(always)]
    pub fn coordinates(&self, axis: usize) -> &[u32; BLOCK_VERTICES] {
        let start = self.triangles() + axis.min(2) * self.vertices();
        let row = self.words[start..].first_chunk();
        row.expect("room for the largest block")
    }

    /// A bit for each triangle.
    #[inline(always)]
    pub fn lanes(&self) -> u32 {
        (1 << self.triangles()) - 1
    }

    /// Index within the geometry.
    #[inline(always)]
    pub fn primitive(&self, lane: usize) -> u32 {
        self.words[lane % LEAF_TRIANGLES]
    }

    /// A [`super::geometry_word`].
    #[inline(always)]
    pub fn geometry(&self, lane: usize) -> u32 {
        match self.mixed {
            0 => self.geometry,
            _ => self.words[self.geometries_start() + lane % LEAF_TRIANGLES],
        }
    }

    fn geometries_start(&self) -> usize {
        self.triangles() + 3 * self.vertices()
    }

    /// The three vertices of a lane.
    pub fn triangle(&self, lane: usize) -> [[f32; 3]; 3] {
        self.corners.map(|corners| {
            let vertex = usize::from(corners[lane % LEAF_TRIANGLES]).min(BLOCK_VERTICES - 1);
            std::array::from_fn(|axis| f32::from_bits(self.coordinates(axis)[vertex]))
        })
    }

    /// Writes the vertices of all triangles into two groups. Returns which of their lanes there
    /// are.
    pub fn expand(&self, groups: [&mut TriangleGroup; 2]) -> u32 {
        let lanes = self.lanes();
        for (i, group) in groups.into_iter().enumerate() {
            for lane in 0..GROUP {
                group.set_triangle(lane, &self.triangle(GROUP * i + lane));
            }
            group.lanes = lanes >> (GROUP * i) & 0xF;
            group.margin = self.margin();
        }
        lanes
    }

    /// For the largest of the triangles.
    #[inline(always)]
    pub fn margin(&self) -> Margin {
        Margin::of_extent(f32::from_bits(u32::from(self.extent) << 23))
    }

    /// The same with everything else that groups say.
    pub fn groups(&self) -> [TriangleGroup; 2] {
        let [mut first, mut last] = [TriangleGroup::EMPTY; 2];
        self.expand([&mut first, &mut last]);
        for lane in 0..self.triangles() {
            let group = if lane < GROUP { &mut first } else { &mut last };
            group.primitives[lane % GROUP] = self.primitive(lane);
            group.geometries[lane % GROUP] = self.geometry(lane);
        }
        [first, last]
    }

    /// Whether it says what a build may have written.
    pub fn is_sound(&self) -> bool {
        let (triangles, vertices) = (self.triangle_count.into(), self.vertex_count.into());
        let corner = |corners: &[u8; LEAF_TRIANGLES]| {
            corners[..triangles]
                .iter()
                .all(|&corner| usize::from(corner) < vertices)
        };
        (1..=LEAF_TRIANGLES).contains(&triangles)
            && vertices <= BLOCK_VERTICES
            && self.corners.iter().all(corner)
    }

    /// Units of memory that it takes.
    pub fn units(&self) -> u32 {
        let geometries = if self.mixed != 0 { self.triangles() } else { 0 };
        let words = self.geometries_start() + geometries;
        let bytes = size_of::<Block>() - size_of_val(&self.words) + 4 * words;
        bytes.div_ceil(BLOCK_UNIT) as u32
    }

    /// A block of triangles, each with its index and the word of its geometry; no more than eight.
    pub fn of(triangles: impl Iterator<Item = (u32, u32, [[f32; 3]; 3])>) -> Block {
        let mut block = Block::EMPTY;
        let mut vertices = [[0u32; 3]; BLOCK_VERTICES];
        let mut vertex_count = 0;
        let mut geometries = [0; LEAF_TRIANGLES];
        let mut count = 0;
        let mut extent = 0f32;
        for (primitive, geometry, triangle) in triangles.take(LEAF_TRIANGLES) {
            extent = extent.max(longest_side(&triangle));
            for (corners, vertex) in block.corners.iter_mut().zip(triangle) {
                let vertex = vertex.map(f32::to_bits);
                // By their bits: what is read is what was given.
                let known = vertices[..vertex_count].iter().position(|&v| v == vertex);
                let number = known.unwrap_or_else(|| {
                    vertices[vertex_count] = vertex;
                    vertex_count += 1;
                    vertex_count - 1
                });
                corners[count] = number as u8;
            }
            block.words[count] = primitive;
            geometries[count] = geometry;
            count += 1;
        }
        block.triangle_count = count as u8;
        block.vertex_count = vertex_count as u8;
        block.extent = (extent.to_bits() >> 23).min(254) as u8 + 1;
        for (i, vertex) in vertices[..vertex_count].iter().enumerate() {
            for (axis, &bits) in vertex.iter().enumerate() {
                block.words[count + axis * vertex_count + i] = bits;
            }
        }
        let geometries = &geometries[..count];
        block.geometry = geometries.first().copied().unwrap_or(0);
        if geometries
            .iter()
            .any(|&geometry| geometry != block.geometry)
        {
            block.mixed = 1;
            let start = block.geometries_start();
            block.words[start..start + count].copy_from_slice(geometries);
        }
        block
    }
}

const _: () = assert!(size_of::<Block>() == 384);
