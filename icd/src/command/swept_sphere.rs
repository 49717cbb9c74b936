//! Spheres and linear swept spheres of a build (`VK_NV_ray_tracing_linear_swept_spheres`).
#![forbid(unsafe_code)]

use traversal::{EndCaps, GeometryFlags, IndexType, Indexing, RadiusFormat, VertexFormat};

use super::range::Range;

/// `VkAccelerationStructureGeometrySpheresDataNV` or
/// `VkAccelerationStructureGeometryLinearSweptSpheresDataNV`, restricted to its range.
#[derive(Clone, Copy, Debug)]
pub struct Swept {
    pub flags: GeometryFlags,
    pub vertex_format: VertexFormat,
    pub vertices: u64,
    pub vertex_stride_bytes: u64,
    pub radius_format: RadiusFormat,
    pub radii: u64,
    pub radius_stride_bytes: u64,
    pub index_type: IndexType,
    pub indices: u64,
    pub index_stride_bytes: u64,
    pub indexing: Indexing,
    pub end_caps: EndCaps,
    pub first_vertex: u32,
    pub primitive_count: u32,
}

impl Swept {
    /// A geometry without memory, whose primitives are all inactive.
    pub const NONE: Swept = Swept {
        flags: GeometryFlags(0),
        vertex_format: VertexFormat::F32x3,
        vertices: 0,
        vertex_stride_bytes: 0,
        radius_format: RadiusFormat::F32,
        radii: 0,
        radius_stride_bytes: 0,
        index_type: IndexType::None,
        indices: 0,
        index_stride_bytes: 0,
        indexing: Indexing::Spheres,
        end_caps: EndCaps::None,
        first_vertex: 0,
        primitive_count: 0,
    };

    /// Restricts the geometry to a range (`VkAccelerationStructureBuildRangeInfoKHR`).
    pub fn apply_range(&mut self, range: &Range) {
        let offset = u64::from(range.primitive_offset);
        self.primitive_count = range.primitive_count;
        self.first_vertex = range.first_vertex;
        match self.index_type {
            IndexType::None => {
                self.vertices = self.vertices.wrapping_add(offset);
                self.radii = self.radii.wrapping_add(offset);
            }
            _ => self.indices = self.indices.wrapping_add(offset),
        }
    }
}
