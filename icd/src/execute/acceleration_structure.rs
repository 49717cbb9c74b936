//! Building and moving acceleration structures: from addresses in recorded commands to the `traversal` crate.
//!
//! Host and device commands end here alike, since a device address is a host address.

use ash::vk;
use spirv_jit::reach::Reach;
use traversal::{
    AabbGeometry, BuildError, BuildFlags, BuildInput, BuildSizes, Geometries, GeometryFlags,
    GeometryMicromap, IndexType, Kind, MotionGeometry, Structure, TriangleGeometry, VertexFormat,
};

use super::instances::Instances;
use super::reachable::{bytes, read, readable, writable};
use super::swept::Swept;

/// The memory of an acceleration structure object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Storage {
    pub address: u64,
    pub size_bytes: u64,
}

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

/// Triangles with `VkAccelerationStructureGeometryMotionTrianglesDataNV`, restricted to their range.
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
    /// Its indices' memory is bounded when the range is known.
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

/// `VkAccelerationStructureBuildRangeInfoKHR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Range {
    pub primitive_count: u32,
    pub primitive_offset: u32,
    pub first_vertex: u32,
    pub transform_offset: u32,
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
                geometry.boxes += offset;
            }
            Self::Swept(list) => {
                if let Some(geometry) = list.get_mut(index) {
                    geometry.apply_range(range);
                }
            }
            Self::Instances(instances) if index == 0 => {
                instances.count = range.primitive_count;
                instances.address += offset;
            }
            Self::Instances(_) => {}
        }
    }

    /// What a structure of these holds.
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

    /// Of all geometries.
    pub fn primitive_count(&self) -> u64 {
        self.primitive_counts().into_iter().map(u64::from).sum()
    }

    fn primitive_counts(&self) -> Vec<u32> {
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

impl Build {
    /// Memory that this build needs, for its actual primitive counts.
    pub fn sizes(&self) -> BuildSizes {
        traversal::build_sizes(
            self.geometries.kind(),
            self.flags,
            &self.geometries.primitive_counts(),
        )
    }

    /// Performs the build or update on the current rayon pool.
    ///
    /// # Errors
    /// See [`BuildError`]; the destination's contents are undefined then.
    ///
    /// # Safety
    /// Every address is readable (geometry) or writable (destination, scratch) as far as the specification makes the application promise
    /// (valid usage of `vkCmdBuildAccelerationStructuresKHR`), and not written by anyone else meanwhile.
    pub unsafe fn execute(&self, reach: &Reach) -> Result<u64, BuildError> {
        // SAFETY: the caller's promise, for each use below.
        unsafe {
            let Storage {
                address,
                size_bytes,
            } = self.destination;
            let destination = writable(reach, address, size_bytes);
            match &self.geometries {
                BuildGeometries::Triangles(list) => {
                    let list: Vec<_> = list.iter().map(|geometry| geometry.read(reach)).collect();
                    self.run(Geometries::Triangles(&list), destination, reach)
                }
                BuildGeometries::Aabbs(list) => {
                    let list: Vec<_> = list.iter().map(|list| list.resolve(reach)).collect();
                    self.run(Geometries::Aabbs(&list), destination, reach)
                }
                BuildGeometries::Swept(list) => {
                    let list: Vec<_> = list.iter().map(|list| list.resolve(reach)).collect();
                    self.run(Geometries::Swept(&list), destination, reach)
                }
                BuildGeometries::Motion(list) => {
                    let list: Vec<_> = list.iter().map(|geometry| geometry.read(reach)).collect();
                    self.run(Geometries::Motion(&list), destination, reach)
                }
                BuildGeometries::Instances(instances) => {
                    let (source, _copies) = instances.resolve(reach);
                    self.run(Geometries::Instances(source), destination, reach)
                }
            }
        }
    }

    /// # Safety
    /// As [`Self::execute`].
    unsafe fn run(
        &self,
        geometries: Geometries<'_>,
        destination: &mut [u8],
        reach: &Reach,
    ) -> Result<u64, BuildError> {
        let input = BuildInput {
            flags: self.flags,
            geometries,
        };
        let sizes = self.sizes();
        // SAFETY: the caller's promise.
        unsafe {
            let Some(source) = self.update_from else {
                return traversal::build(
                    &input,
                    destination,
                    writable(reach, self.scratch, sizes.build_scratch_bytes),
                );
            };
            let scratch = writable(reach, self.scratch, sizes.update_scratch_bytes);
            if source.address == self.destination.address {
                return traversal::update(&input, None, destination, scratch);
            }
            let source = structure_bytes(reach, source.address).ok_or(BuildError::Source)?;
            traversal::update(&input, Some(source), destination, scratch)
        }
    }
}

impl Triangles {
    /// Restricts it to a range.
    fn apply_range(&mut self, range: &Range) {
        let offset = u64::from(range.primitive_offset);
        self.primitive_count = range.primitive_count;
        self.first_vertex = range.first_vertex;
        match self.index_type {
            IndexType::None => self.vertices += offset,
            _ => self.indices += offset,
        }
        if self.transform != 0 {
            self.transform += u64::from(range.transform_offset);
        }
    }

    /// Bounds the geometry's memory and reads its transform.
    ///
    /// # Safety
    /// Nothing writes the transform meanwhile.
    unsafe fn read(&self, reach: &Reach) -> TriangleGeometry {
        let corners = self.primitive_count as u64 * 3;
        let vertex_count = match self.index_type {
            IndexType::None => self.first_vertex as u64 + corners,
            _ => self.first_vertex as u64 + self.max_vertex as u64 + 1,
        };
        // The last vertex counts with a whole stride or its own size, whichever is larger.
        let vertex_bytes = vertex_count * self.vertex_stride_bytes + MAX_VERTEX_BYTES;
        TriangleGeometry {
            vertices: readable(reach, self.vertices, vertex_bytes),
            vertex_stride_bytes: self.vertex_stride_bytes,
            vertex_format: self.vertex_format,
            first_vertex: self.first_vertex,
            index_type: self.index_type,
            indices: readable(
                reach,
                self.indices,
                corners * index_size_bytes(self.index_type),
            ),
            // SAFETY: the caller's promise.
            transform: unsafe { read(reach, self.transform) },
            primitive_count: self.primitive_count,
            flags: self.flags,
            micromap: self.bounded_micromap(reach),
        }
    }

    /// The micromap, with indices for the range's triangles.
    pub fn bounded_micromap(&self, reach: &Reach) -> Option<GeometryMicromap> {
        let micromap = self.micromap?;
        let last = u64::from(self.primitive_count.saturating_sub(1))
            .saturating_mul(micromap.index_stride_bytes);
        let bytes = last.saturating_add(index_size_bytes(micromap.index_type));
        Some(GeometryMicromap {
            indices: readable(reach, micromap.indices.base as u64, bytes),
            ..micromap
        })
    }
}

/// Bytes of an index.
pub fn index_size_bytes(ty: IndexType) -> u64 {
    match ty {
        IndexType::None => 0,
        IndexType::U8 => 1,
        IndexType::U16 => 2,
        IndexType::U32 => 4,
    }
}

impl MotionTriangles {
    /// Restricts it to a range; the vertices at both times move alike.
    fn apply_range(&mut self, range: &Range) {
        self.start.apply_range(range);
        if self.start.index_type == IndexType::None {
            self.end_vertices += u64::from(range.primitive_offset);
        }
    }

    /// As [`Triangles::read`].
    ///
    /// # Safety
    /// As there.
    unsafe fn read(&self, reach: &Reach) -> MotionGeometry {
        // SAFETY: the caller's promise.
        let start = unsafe { self.start.read(reach) };
        MotionGeometry {
            start,
            end_vertices: readable(reach, self.end_vertices, start.vertices.bytes as u64),
        }
    }
}

/// Largest position: four 64-bit components.
pub(super) const MAX_VERTEX_BYTES: u64 = 32;

/// `sizeof(VkAabbPositionsKHR)`.
const AABB_BYTES: u64 = 24;

impl Aabbs {
    fn resolve(&self, reach: &Reach) -> AabbGeometry {
        let last = (self.primitive_count as u64).saturating_sub(1) * self.stride_bytes;
        AabbGeometry {
            boxes: readable(reach, self.boxes, last + AABB_BYTES),
            stride_bytes: self.stride_bytes,
            primitive_count: self.primitive_count,
            flags: self.flags,
        }
    }
}

/// The bytes in use of the structure at an address, or `None` where none was built.
///
/// # Safety
/// A structure at the address is unchanged for `'a`.
unsafe fn structure_bytes<'a>(reach: &Reach, address: u64) -> Option<&'a [u8]> {
    // SAFETY: the caller's promise.
    unsafe {
        let size_bytes = structure_at(reach, address)?.size_bytes();
        Some(bytes(reach, address, size_bytes)).filter(|bytes| !bytes.is_empty())
    }
}

/// The structure at an address, or `None` where none was built.
///
/// # Safety
/// As [`structure_bytes`].
unsafe fn structure_at(reach: &Reach, address: u64) -> Option<Structure> {
    if !reach.contains(address, Structure::HEADER_BYTES) {
        return None;
    }
    // SAFETY: there is memory, and the caller's promise.
    unsafe { Structure::at(address) }
}

/// The vertex formats that structures are built from, by `VkFormat`; those with
/// `VK_FORMAT_FEATURE_ACCELERATION_STRUCTURE_VERTEX_BUFFER_BIT_KHR`.
pub fn vertex_format(format: vk::Format) -> Option<VertexFormat> {
    Some(match format {
        vk::Format::R32G32_SFLOAT => VertexFormat::F32x2,
        vk::Format::R32G32B32_SFLOAT => VertexFormat::F32x3,
        vk::Format::R32G32B32A32_SFLOAT => VertexFormat::F32x4,
        vk::Format::R16G16_SFLOAT => VertexFormat::F16x2,
        vk::Format::R16G16B16_SFLOAT => VertexFormat::F16x3,
        vk::Format::R16G16B16A16_SFLOAT => VertexFormat::F16x4,
        vk::Format::R64G64_SFLOAT => VertexFormat::F64x2,
        vk::Format::R64G64B64_SFLOAT => VertexFormat::F64x3,
        vk::Format::R64G64B64A64_SFLOAT => VertexFormat::F64x4,
        vk::Format::R8G8_SNORM => VertexFormat::Snorm8x2,
        vk::Format::R8G8B8_SNORM => VertexFormat::Snorm8x3,
        vk::Format::R8G8B8A8_SNORM => VertexFormat::Snorm8x4,
        vk::Format::R8G8_UNORM => VertexFormat::Unorm8x2,
        vk::Format::R8G8B8_UNORM => VertexFormat::Unorm8x3,
        vk::Format::R8G8B8A8_UNORM => VertexFormat::Unorm8x4,
        vk::Format::R16G16_SNORM => VertexFormat::Snorm16x2,
        vk::Format::R16G16B16_SNORM => VertexFormat::Snorm16x3,
        vk::Format::R16G16B16A16_SNORM => VertexFormat::Snorm16x4,
        vk::Format::R16G16_UNORM => VertexFormat::Unorm16x2,
        vk::Format::R16G16B16_UNORM => VertexFormat::Unorm16x3,
        vk::Format::R16G16B16A16_UNORM => VertexFormat::Unorm16x4,
        vk::Format::A2B10G10R10_UNORM_PACK32 => VertexFormat::Unorm10x3A2,
        vk::Format::A2B10G10R10_SNORM_PACK32 => VertexFormat::Snorm10x3A2,
        _ => return None,
    })
}

/// What a copy between structures does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CopyMode {
    Clone,
    Compact,
}

/// `VkCopyAccelerationStructureInfoKHR`.
///
/// # Safety
/// Both are the memory of acceleration structure objects; the source is built and not written meanwhile, the destination not used elsewhere.
pub unsafe fn copy(source: Storage, destination: Storage, mode: CopyMode, reach: &Reach) {
    // SAFETY: the caller's promise.
    unsafe {
        let Some(source) = structure_bytes(reach, source.address) else {
            return;
        };
        let destination = writable(reach, destination.address, destination.size_bytes);
        let done = match mode {
            CopyMode::Clone => traversal::copy_into(source, destination),
            CopyMode::Compact => traversal::compact_into(source, destination),
        };
        report(done.map(drop), "copy");
    }
}

/// Identifiers at the head of serialized data: the driver's, then the format's.
pub type Uuids = [[u8; 16]; 2];

/// `VkCopyAccelerationStructureToMemoryInfoKHR`.
///
/// # Safety
/// As [`copy`], and `destination` is writable for the serialized size.
pub unsafe fn serialize(source: Storage, destination: u64, uuids: &Uuids, reach: &Reach) {
    // SAFETY: the caller's promise.
    unsafe {
        let Some(source) = structure_bytes(reach, source.address) else {
            return;
        };
        let Ok(size_bytes) = traversal::serialized_size(source) else {
            return;
        };
        report(
            traversal::serialize(source, uuids, writable(reach, destination, size_bytes)).map(drop),
            "serialization",
        );
    }
}

/// `VkCopyMemoryToAccelerationStructureInfoKHR`.
///
/// # Safety
/// As [`copy`], and `source` holds what [`serialize`] wrote.
pub unsafe fn deserialize(source: u64, destination: Storage, reach: &Reach) {
    // SAFETY: the caller's promise; the head says how long the rest is.
    unsafe {
        let head = bytes(reach, source, traversal::Serialized::HEAD_BYTES as u64);
        let Ok(head) = traversal::Serialized::read(head) else {
            return;
        };
        let data = bytes(reach, source, head.serialized_bytes);
        let destination = writable(reach, destination.address, destination.size_bytes);
        report(
            traversal::deserialize(data, destination).map(drop),
            "deserialization",
        );
    }
}

/// A failed transfer leaves the destination undefined, and a line in the log.
fn report(result: Result<(), traversal::StructureError>, what: &str) {
    if let Err(error) = result {
        crate::log::write(
            crate::log::Level::Error,
            &format!("acceleration structure {what}: {error:?}"),
        );
    }
}

/// A property that `vkCmdWriteAccelerationStructuresPropertiesKHR` writes.
///
/// # Safety
/// `address` is the memory of an acceleration structure object that is built.
pub unsafe fn property(address: u64, query_type: vk::QueryType, reach: &Reach) -> u64 {
    // SAFETY: the caller's promise.
    unsafe {
        let Some(structure) = structure_at(reach, address) else {
            return 0;
        };
        let bytes = structure_bytes(reach, address).unwrap_or(&[]);
        match query_type {
            vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR
            | vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_NV => {
                traversal::compacted_size(bytes).unwrap_or(0)
            }
            vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR => {
                traversal::serialized_size(bytes).unwrap_or(0)
            }
            vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_BOTTOM_LEVEL_POINTERS_KHR => {
                structure.reference_count()
            }
            // `ACCELERATION_STRUCTURE_SIZE_KHR`: what the structure takes, wherever it is put.
            _ => structure.size_bytes(),
        }
    }
}
