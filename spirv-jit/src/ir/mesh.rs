//! Facts of task and mesh shaders: the layout of their workgroup memory.
//!
//! The text form of each is one dotted word, as in [`super::interface`].

use std::fmt;

use super::interface::OutputRow;
use super::tessellation::PatchWord;

/// Largest number of vertices, and of primitives, of a mesh shader's workgroup.
pub const MAX_MESH_ELEMENTS: u32 = 1 << 10;

/// Size of a workgroup's counts: three words, padded, 16 bytes apart.
pub const COUNTS_BYTES: u32 = 32;

/// The facts of a task or mesh shader. A workgroup's memory starts with the payload, which task
/// shaders write and mesh shaders read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MeshFacts {
    /// Bytes of the payload.
    pub payload_bytes: u32,
    /// Offset of the workgroup's counts. Task: mesh workgroups in x, y and z; mesh: vertices and
    /// primitives.
    pub counts_offset: u32,
    /// Mesh: vertices of a primitive.
    pub corners: u32,
    pub max_vertices: u32,
    pub max_primitives: u32,
    /// Words of a vertex.
    pub vertices: Vec<PatchWord>,
    /// Words of a primitive, with its vertex indices.
    pub primitives: Vec<PatchWord>,
}

impl MeshFacts {
    /// Meanings of the words of a vertex, then of those of a primitive.
    pub fn rows(&self) -> Vec<OutputRow> {
        let words = self.vertices.iter().chain(&self.primitives);
        words.map(|word| word.row).collect()
    }

    /// Whether everything is inside a workgroup's memory.
    pub fn fits(&self, is_mesh: bool, shared_size_bytes: u32) -> bool {
        let size = u64::from(shared_size_bytes);
        let is_inside = |words: &[PatchWord], count: u32| {
            let ends = words.iter().map(|word| word.end(count));
            ends.max().unwrap_or(0) <= size
        };
        let is_made = match is_mesh {
            true => (1..=3).contains(&self.corners),
            false => self.vertices.is_empty() && self.primitives.is_empty(),
        };
        is_made
            && self.max_vertices <= MAX_MESH_ELEMENTS
            && self.max_primitives <= MAX_MESH_ELEMENTS
            && u64::from(self.payload_bytes) <= size
            && u64::from(self.counts_offset) + u64::from(COUNTS_BYTES) <= size
            && is_inside(&self.vertices, self.max_vertices)
            && is_inside(&self.primitives, self.max_primitives)
    }

    /// Parses one word of the text form; false if it is invalid.
    pub fn set(&mut self, word: &str) -> bool {
        let Some((name, rest)) = word.split_once('.') else {
            return false;
        };
        match (name, rest.parse(), rest.parse()) {
            ("payload", Ok(number), _) => self.payload_bytes = number,
            ("counts", Ok(number), _) => self.counts_offset = number,
            ("corners", Ok(number), _) => self.corners = number,
            ("max_vertices", Ok(number), _) => self.max_vertices = number,
            ("max_primitives", Ok(number), _) => self.max_primitives = number,
            ("vertex", _, Ok(word)) => self.vertices.push(word),
            ("primitive", _, Ok(word)) => self.primitives.push(word),
            _ => return false,
        }
        true
    }
}

/// The facts' words in the text form, in order.
impl fmt::Display for MeshFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "payload.{}, counts.{}",
            self.payload_bytes, self.counts_offset
        )?;
        write!(f, ", corners.{}", self.corners)?;
        write!(f, ", max_vertices.{}", self.max_vertices)?;
        write!(f, ", max_primitives.{}", self.max_primitives)?;
        for word in &self.vertices {
            write!(f, ", vertex.{word}")?;
        }
        for word in &self.primitives {
            write!(f, ", primitive.{word}")?;
        }
        Ok(())
    }
}
