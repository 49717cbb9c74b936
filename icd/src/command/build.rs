//! Builds as they are recorded: `VkAccelerationStructureBuildGeometryInfoKHR` and its ranges,
//! copied.
#![forbid(unsafe_code)]

use traversal::{BuildFlags, GeometryFlags, GeometryMicromap, IndexType, Kind, VertexFormat};

use super::instances::Instances;
use super::range::Range;
use super::swept_sphere::Swept;
use crate::object::acceleration_structure::Storage;

/// A `VkAccelerationStructureBuildGeometryInfoKHR` and its ranges, copied.
#[derive(Clone, Debug)]
pub struct Build {
    pub flags: BuildFlags,
    /// `VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR` and its source.
    pub update_from: Option<Storage>,
    pub destination: Storage,
    pub geometries: BuildGeometries,
    pub scratch: u64,
}

/// The geometries of a build, all of one kind.
#[derive(Clone, Debug)]
pub enum BuildGeometries {
    Triangles(Vec<Triangles>),
    Aabbs(Vec<Aabbs>),
    Swept(Vec<Swept>),
    Motion(Vec<MotionTriangles>),
    Instances(Instances),
}

/// Triangles with `VkAccelerationStructureGeometryMotionTrianglesDataNV`, restricted to their
/// range.
#[derive(Clone, Copy, Debug)]
pub struct MotionTriangles {
    pub start: Triangles,
    /// The vertices at time 1.
    pub end_vertices: u64,
}

/// `VkAccelerationStructureGeometryTrianglesDataKHR`, restricted to its range.
#[derive(Clone, Copy, Debug)]
pub struct Triangles {
    pub flags: GeometryFlags,
    pub vertex_format: VertexFormat,
    pub vertices: u64,
    pub vertex_stride_bytes: u64,
    pub max_vertex: u32,
    pub first_vertex: u32,
    pub index_type: IndexType,
    pub indices: u64,
    /// Address of a `VkTransformMatrixKHR`, or 0.
    pub transform: u64,
    pub primitive_count: u32,
    /// The memory of the indices is bounded once the range is known.
    pub micromap: Option<GeometryMicromap>,
}

/// `VkAccelerationStructureGeometryAabbsDataKHR`, restricted to its range.
#[derive(Clone, Copy, Debug)]
pub struct Aabbs {
    pub flags: GeometryFlags,
    pub boxes: u64,
    pub stride_bytes: u64,
    pub primitive_count: u32,
}

impl BuildGeometries {
    /// Restricts geometry `index` to a range.
    pub fn apply_range(&mut self, index: usize, range: &Range) {
        let offset = u64::from(range.primitive_offset);
        match self {
            Self::Triangles(list) => {
                if let Some(geometry) = list.get_mut(index) {
                    geometry.apply_range(range);
                }
            }
            Self::Motion(list) => {
                if let Some(geometry) = list.get_mut(index) {
                    geometry.apply_range(range);
                }
            }
            Self::Aabbs(list) => {
                let Some(geometry) = list.get_mut(index) else {
                    return;
                };
                geometry.primitive_count = range.primitive_count;
                geometry.boxes = geometry.boxes.wrapping_add(offset);
            }
            Self::Swept(list) => {
                if let Some(geometry) = list.get_mut(index) {
                    geometry.apply_range(range);
                }
            }
            Self::Instances(instances) if index == 0 => {
                instances.count = range.primitive_count;
                instances.address = instances.address.wrapping_add(offset);
            }
            Self::Instances(_) => {}
        }
    }

    /// The kind of structure that holds these geometries.
    pub fn kind(&self) -> Kind {
        match self {
            Self::Triangles(_) => Kind::Triangles,
            Self::Aabbs(_) => Kind::Aabbs,
            Self::Swept(_) => Kind::Swept,
            Self::Motion(_) => Kind::Motion,
            Self::Instances(instances) if instances.array.is_motion() => Kind::MotionInstances,
            Self::Instances(_) => Kind::Instances,
        }
    }

    /// The primitive count of all geometries.
    pub fn primitive_count(&self) -> u64 {
        self.primitive_counts().into_iter().map(u64::from).sum()
    }

    /// The primitive count of each geometry.
    pub fn primitive_counts(&self) -> Vec<u32> {
        match self {
            Self::Triangles(list) => list
                .iter()
                .map(|geometry| geometry.primitive_count)
                .collect(),
            Self::Aabbs(list) => list
                .iter()
                .map(|geometry| geometry.primitive_count)
                .collect(),
            Self::Swept(list) => list
                .iter()
                .map(|geometry| geometry.primitive_count)
                .collect(),
            Self::Motion(list) => list
                .iter()
                .map(|geometry| geometry.start.primitive_count)
                .collect(),
            Self::Instances(instances) => vec![instances.count],
        }
    }
}

impl Triangles {
    /// Restricts the geometry to a range.
    fn apply_range(&mut self, range: &Range) {
        let offset = u64::from(range.primitive_offset);
        self.primitive_count = range.primitive_count;
        self.first_vertex = range.first_vertex;
        match self.index_type {
            IndexType::None => self.vertices = self.vertices.wrapping_add(offset),
            _ => self.indices = self.indices.wrapping_add(offset),
        }
        if self.transform != 0 {
            self.transform = self
                .transform
                .wrapping_add(u64::from(range.transform_offset));
        }
    }
}

impl MotionTriangles {
    /// Restricts the geometry to a range, the vertices at both times alike.
    fn apply_range(&mut self, range: &Range) {
        self.start.apply_range(range);
        if self.start.index_type == IndexType::None {
            self.end_vertices = self
                .end_vertices
                .wrapping_add(u64::from(range.primitive_offset));
        }
    }
}
