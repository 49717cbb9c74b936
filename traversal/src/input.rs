//! The input of a build: geometries in the caller's memory.

use crate::live::Live;
use crate::memory::{IndexType, Memory};
use crate::micromap::GeometryMicromap;

/// Flags of a build; the bits of `VkBuildAccelerationStructureFlagBitsKHR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildFlags(pub u32);

impl BuildFlags {
    /// The structure can be updated.
    pub const ALLOW_UPDATE: u32 = 0x1;
    /// The structure can be compacted (every structure of ours can).
    pub const ALLOW_COMPACTION: u32 = 0x2;
    /// Speed of walks comes first.
    pub const PREFER_FAST_TRACE: u32 = 0x4;
    /// Speed of the build comes first.
    pub const PREFER_FAST_BUILD: u32 = 0x8;
    /// Size comes first.
    pub const LOW_MEMORY: u32 = 0x10;
    /// Vertex positions can be fetched (from every structure of ours they can).
    pub const ALLOW_DATA_ACCESS: u32 = 0x800;

    /// Whether all of `bits` are set.
    pub fn contains(self, bits: u32) -> bool {
        self.0 & bits == bits
    }
}

/// Flags of a geometry; the bits of `VkGeometryFlagBitsKHR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GeometryFlags(pub u32);

impl GeometryFlags {
    /// No any-hit shader runs for it.
    pub const OPAQUE: u32 = 0x1;
    /// An any-hit shader runs at most once per primitive and ray (here it always does).
    pub const NO_DUPLICATE_ANY_HIT_INVOCATION: u32 = 0x2;

    /// Whether all of `bits` are set.
    pub fn contains(self, bits: u32) -> bool {
        self.0 & bits == bits
    }
}

/// How a vertex position lies in memory. Missing components are 0, a fourth is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each name is component count and type")]
pub enum VertexFormat {
    F32x2,
    F32x3,
    F32x4,
    F16x2,
    F16x3,
    F16x4,
    F64x2,
    F64x3,
    F64x4,
    Snorm8x2,
    Snorm8x3,
    Snorm8x4,
    Unorm8x2,
    Unorm8x3,
    Unorm8x4,
    Snorm16x2,
    Snorm16x3,
    Snorm16x4,
    Unorm16x2,
    Unorm16x3,
    Unorm16x4,
    /// `A2B10G10R10`: x in the low ten bits.
    Unorm10x3A2,
    /// `A2B10G10R10`, signed: x in the low ten bits.
    Snorm10x3A2,
}

/// A list of triangles.
#[derive(Clone, Copy, Debug)]
pub struct TriangleGeometry {
    /// Vertex 0 lies at its start (a build range's `primitiveOffset` is already added when there
    /// are no indices).
    pub vertices: Memory,
    /// Bytes from one vertex to the next; may be 0.
    pub vertex_stride_bytes: u64,
    /// Format of a position at the start of each vertex.
    pub vertex_format: VertexFormat,
    /// Added to every index, or the first vertex without indices.
    pub first_vertex: u32,
    /// Type of `indices`.
    pub index_type: IndexType,
    /// The first index lies at its start (`primitiveOffset` already added); unused without indices.
    pub indices: Memory,
    /// Row-major 3 × 4 matrix applied to the positions.
    pub transform: Option<[f32; 12]>,
    /// Number of triangles.
    pub primitive_count: u32,
    /// Opaque, no duplicate any-hits.
    pub flags: GeometryFlags,
    /// The micromap that determines opacity instead of the flag.
    pub micromap: Option<GeometryMicromap>,
}

/// How a radius lies in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum RadiusFormat {
    F32,
    F16,
}

/// The vertices of primitive `i` of a list of swept spheres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Indexing {
    /// A sphere: number `i`.
    Spheres,
    /// Swept from number `2 i` to number `2 i + 1`.
    Pairs,
    /// Swept from number `i` to the vertex after it.
    Successive,
}

/// Which ends of a swept sphere are round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndCaps {
    /// None of them.
    None,
    /// Both, but of a successive primitive that goes on where the one before it ends, the second
    /// only.
    Chained,
}

/// A list of spheres or of linear swept spheres.
#[derive(Clone, Copy, Debug)]
pub struct SweptGeometry {
    /// Vertex 0 lies at its start (a build range's `primitiveOffset` is already added when there
    /// are no indices).
    pub vertices: Memory,
    /// Bytes from one vertex to the next.
    pub vertex_stride_bytes: u64,
    /// Format of a position at the start of each vertex.
    pub vertex_format: VertexFormat,
    /// The radius of vertex 0 lies at its start (`primitiveOffset` likewise).
    pub radii: Memory,
    /// Bytes from one radius to the next.
    pub radius_stride_bytes: u64,
    /// Format of a radius.
    pub radius_format: RadiusFormat,
    /// Added to every number.
    pub first_vertex: u32,
    /// Type of `indices`; without, number `i` is `i`.
    pub index_type: IndexType,
    /// The first index lies at its start (`primitiveOffset` already added).
    pub indices: Memory,
    /// Bytes from one index to the next.
    pub index_stride_bytes: u64,
    /// The meaning of the indices.
    pub indexing: Indexing,
    /// Means nothing for spheres.
    pub end_caps: EndCaps,
    /// Number of primitives.
    pub primitive_count: u32,
    /// Opaque, no duplicate any-hits.
    pub flags: GeometryFlags,
}

/// A list of boxes: min x y z, max x y z as `f32`.
#[derive(Clone, Copy, Debug)]
pub struct AabbGeometry {
    /// Box 0 lies at its start (`primitiveOffset` already added).
    pub boxes: Memory,
    /// Bytes from one box to the next.
    pub stride_bytes: u64,
    /// Number of boxes.
    pub primitive_count: u32,
    /// Opaque, no duplicate any-hits.
    pub flags: GeometryFlags,
}

/// A list of triangles that move: each vertex on a line, from time 0 to time 1.
#[derive(Clone, Copy, Debug)]
pub struct MotionGeometry {
    /// The triangles at time 0.
    pub start: TriangleGeometry,
    /// The vertices at time 1, otherwise as those of `start`.
    pub end_vertices: Memory,
}

/// How instances lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstanceArray {
    /// 64-byte `VkAccelerationStructureInstanceKHR` records, one after the other.
    Records,
    /// 64-bit addresses of such records.
    Pointers,
    /// 160-byte `VkAccelerationStructureMotionInstanceNV` records.
    MotionRecords,
    /// 64-bit addresses whose low four bits are a `VkAccelerationStructureMotionInstanceTypeNV`.
    MotionPointers,
}

impl InstanceArray {
    /// The instances may move.
    pub fn is_motion(self) -> bool {
        matches!(self, Self::MotionRecords | Self::MotionPointers)
    }

    /// Bytes of an element.
    pub fn stride_bytes(self) -> u64 {
        match self {
            Self::Records => 64,
            Self::MotionRecords => 160,
            Self::Pointers | Self::MotionPointers => 8,
        }
    }
}

/// The instances of a top level.
///
/// Each record's reference is the address of a bottom level's blob, or 0 for an inactive one.
#[derive(Clone, Copy, Debug)]
pub struct InstanceSource<'a> {
    /// Records or pointers (`primitiveOffset` already added).
    pub memory: Memory,
    /// The array in `memory`.
    pub array: InstanceArray,
    /// Number of instances.
    pub count: u32,
    /// Flags of the one geometry that holds them; they mean nothing.
    pub flags: GeometryFlags,
    /// Where records behind pointers and bottom levels may lie: an instance that leads elsewhere is
    /// inactive.
    pub live: &'a Live,
}

/// All geometries of a build, of one kind.
#[derive(Clone, Copy, Debug)]
pub enum Geometries<'a> {
    /// A bottom level of triangles.
    Triangles(&'a [TriangleGeometry]),
    /// A bottom level of boxes.
    Aabbs(&'a [AabbGeometry]),
    /// A bottom level of spheres or of linear swept spheres.
    Swept(&'a [SweptGeometry]),
    /// A bottom level of triangles that move.
    Motion(&'a [MotionGeometry]),
    /// A top level.
    Instances(InstanceSource<'a>),
}

impl<'a> Geometries<'a> {
    /// Lists of triangles, of those that move as they are at time 0; none of anything else.
    pub(crate) fn triangle_lists(&self) -> impl Iterator<Item = &'a TriangleGeometry> {
        let (still, moving): (&'a [_], &'a [MotionGeometry]) = match *self {
            Self::Triangles(list) => (list, &[]),
            Self::Motion(list) => (&[], list),
            _ => (&[], &[]),
        };
        still.iter().chain(moving.iter().map(|list| &list.start))
    }
}

/// A build: what and how.
#[derive(Clone, Copy, Debug)]
pub struct BuildInput<'a> {
    /// The build flags.
    pub flags: BuildFlags,
    /// The geometries of the structure.
    pub geometries: Geometries<'a>,
}
