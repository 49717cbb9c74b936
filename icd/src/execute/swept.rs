//! Spheres and linear swept spheres of a build (`VK_NV_ray_tracing_linear_swept_spheres`).
#![forbid(unsafe_code)]

use ash::vk;
use spirv_jit::reach::Reach;
use traversal::{
    EndCaps, GeometryFlags, IndexType, Indexing, RadiusFormat, SweptGeometry, VertexFormat,
};

use super::acceleration_structure::{MAX_VERTEX_BYTES, Range};
use super::reachable::readable;

/// `VkAccelerationStructureGeometrySpheresDataNV` or `VkAccelerationStructureGeometryLinearSweptSpheresDataNV`, restricted to its range.
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
    /// A geometry without memory: all of it is inactive.
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

    /// Restricts it to a range (`VkAccelerationStructureBuildRangeInfoKHR`).
    pub fn apply_range(&mut self, range: &Range) {
        let offset = u64::from(range.primitive_offset);
        self.primitive_count = range.primitive_count;
        self.first_vertex = range.first_vertex;
        match self.index_type {
            IndexType::None => {
                self.vertices += offset;
                self.radii += offset;
            }
            _ => self.indices += offset,
        }
    }

    /// Bounds the geometry's memory. What an index can reach is known from its type alone: the structures name no greatest vertex.
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
        // One more for the second end of a successive primitive.
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
                numbers.saturating_sub(1) * self.index_stride_bytes + index_bytes,
            ),
            index_stride_bytes: self.index_stride_bytes,
            indexing: self.indexing,
            end_caps: self.end_caps,
            primitive_count: self.primitive_count,
            flags: self.flags,
        }
    }
}

/// The radius formats that structures are built from, by `VkFormat`; those with
/// `VK_FORMAT_FEATURE_2_ACCELERATION_STRUCTURE_RADIUS_BUFFER_BIT_NV`.
pub fn radius_format(format: vk::Format) -> Option<RadiusFormat> {
    Some(match format {
        vk::Format::R32_SFLOAT => RadiusFormat::F32,
        vk::Format::R16_SFLOAT => RadiusFormat::F16,
        _ => return None,
    })
}
