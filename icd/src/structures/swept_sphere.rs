//! The memory of spheres and linear swept spheres of a build.
#![forbid(unsafe_code)]

use spirv_jit::reach::Reach;
use traversal::{IndexType, Indexing, SweptGeometry};

use crate::command::swept_sphere::Swept;
use crate::format::structure::MAX_VERTEX_BYTES;
use crate::wave::reachable::readable;

impl Swept {
    /// Bounds the geometry's memory. The index type alone bounds the vertices, since the structures
    /// have no `maxVertex`.
    pub fn resolve(&self, reach: &Reach) -> SweptGeometry {
        let count = u64::from(self.primitive_count);
        let numbers = match self.indexing {
            Indexing::Pairs => 2 * count,
            _ => count,
        };
        let (index_bytes, reachable) = match self.index_type {
            IndexType::None => (0, numbers),
            IndexType::U8 => (1, 1 << 8),
            IndexType::U16 => (2, 1 << 16),
            IndexType::U32 => (4, 1 << 32),
        };
        // One more index for the second end of a successive primitive.
        let vertices = u64::from(self.first_vertex) + reachable + 1;
        let bytes = |address: u64, stride: u64, size: u64| match address {
            0 => 0,
            _ => vertices.saturating_mul(stride).saturating_add(size),
        };
        SweptGeometry {
            vertices: readable(
                reach,
                self.vertices,
                bytes(self.vertices, self.vertex_stride_bytes, MAX_VERTEX_BYTES),
            ),
            vertex_stride_bytes: self.vertex_stride_bytes,
            vertex_format: self.vertex_format,
            radii: readable(
                reach,
                self.radii,
                bytes(self.radii, self.radius_stride_bytes, 4),
            ),
            radius_stride_bytes: self.radius_stride_bytes,
            radius_format: self.radius_format,
            first_vertex: self.first_vertex,
            index_type: self.index_type,
            indices: readable(
                reach,
                self.indices,
                numbers
                    .saturating_sub(1)
                    .saturating_mul(self.index_stride_bytes)
                    .saturating_add(index_bytes),
            ),
            index_stride_bytes: self.index_stride_bytes,
            indexing: self.indexing,
            end_caps: self.end_caps,
            primitive_count: self.primitive_count,
            flags: self.flags,
        }
    }
}
