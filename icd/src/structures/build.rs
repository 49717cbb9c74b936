//! Building acceleration structures: from addresses in recorded commands to the `traversal` crate.
//!
//! Host and device commands use the same functions, since a device address is a host address.

use rayon::prelude::*;
use spirv_jit::reach::Reach;
use traversal::{
    AabbGeometry, BuildError, BuildInput, BuildSizes, Geometries, GeometryMicromap, IndexType,
    Live, MotionGeometry, TriangleGeometry,
};

use super::acceleration_structure::report;
use super::acceleration_structure::{storage_bytes, structure_bytes};
use crate::capture;
use crate::command::build::{Aabbs, Build, BuildGeometries, MotionTriangles, Triangles};
use crate::command::range::Range;
use crate::command::structures::IndirectBuild;
use crate::format::structure::{MAX_VERTEX_BYTES, index_size_bytes};
use crate::timeline;
use crate::validate::Checks;
use crate::wave::reachable::{read, readable, writable};

impl Build {
    /// The memory that this build needs for its actual primitive counts.
    pub fn sizes(&self) -> BuildSizes {
        traversal::build_sizes(
            self.geometries.kind(),
            self.flags,
            &self.geometries.primitive_counts(),
        )
    }

    /// The scratch memory of the build.
    fn scratch_bytes(&self) -> u64 {
        let sizes = self.sizes();
        match self.update_from {
            None => sizes.build_scratch_bytes,
            Some(_) => sizes.update_scratch_bytes,
        }
    }

    /// Performs the build or update on the current rayon pool. Structures are checked against
    /// `live`, all other addresses against `reach`.
    ///
    /// # Errors
    /// See [`BuildError`]; the destination's contents are undefined then.
    ///
    /// # Safety
    /// Every address is readable (geometry) or writable (destination, scratch) as the valid usage
    /// of `vkCmdBuildAccelerationStructuresKHR` requires, and nothing else writes it during the
    /// call.
    pub unsafe fn execute(&self, reach: &Reach, live: &Live) -> Result<u64, BuildError> {
        let started = capture::start_build();
        // SAFETY: the caller guarantees that each address is readable or writable as the command's
        // valid usage requires, and nothing else writes it during the call.
        let built = unsafe { self.perform(reach, live) };
        capture::note_build(
            self.destination.address,
            self.update_from.is_some(),
            started,
        );
        built
    }

    /// # Safety
    /// As [`Self::execute`].
    unsafe fn perform(&self, reach: &Reach, live: &Live) -> Result<u64, BuildError> {
        // SAFETY: the caller keeps the addresses readable or writable, for each use below.
        unsafe {
            let destination = storage_bytes(live, self.destination);
            match &self.geometries {
                BuildGeometries::Triangles(list) => {
                    let list: Vec<_> = list.iter().map(|geometry| geometry.read(reach)).collect();
                    self.run(Geometries::Triangles(&list), destination, (reach, live))
                }
                BuildGeometries::Aabbs(list) => {
                    let list: Vec<_> = list.iter().map(|list| list.resolve(reach)).collect();
                    self.run(Geometries::Aabbs(&list), destination, (reach, live))
                }
                BuildGeometries::Swept(list) => {
                    let list: Vec<_> = list.iter().map(|list| list.resolve(reach)).collect();
                    self.run(Geometries::Swept(&list), destination, (reach, live))
                }
                BuildGeometries::Motion(list) => {
                    let list: Vec<_> = list.iter().map(|geometry| geometry.read(reach)).collect();
                    self.run(Geometries::Motion(&list), destination, (reach, live))
                }
                BuildGeometries::Instances(instances) => {
                    // An array that is too large is refused before it is read.
                    if u64::from(instances.count) > traversal::MAX_GEOMETRIES {
                        return Err(BuildError::TooLarge);
                    }
                    let is_new = self.update_from.is_none();
                    if is_new && (destination.len() as u64) < self.sizes().structure_bytes {
                        return Err(BuildError::Destination);
                    }
                    let source = instances.resolve(reach, live);
                    self.run(Geometries::Instances(source), destination, (reach, live))
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
        (reach, live): (&Reach, &Live),
    ) -> Result<u64, BuildError> {
        let input = BuildInput {
            flags: self.flags,
            geometries,
        };
        // SAFETY: the caller keeps the promises of `Self::execute`.
        unsafe {
            let scratch = writable(reach, self.scratch, self.scratch_bytes());
            if overlap(scratch, destination) {
                return Err(BuildError::Scratch);
            }
            let Some(source) = self.update_from else {
                return traversal::build(&input, destination, scratch);
            };
            if source.address == self.destination.address {
                return traversal::update(&input, None, destination, scratch);
            }
            let source = structure_bytes(live, source.address).ok_or(BuildError::Source)?;
            traversal::update(&input, Some(source), destination, scratch)
        }
    }
}

impl Triangles {
    /// Bounds the geometry's memory and reads its transform.
    ///
    /// # Safety
    /// Nothing writes the transform during the call.
    unsafe fn read(&self, reach: &Reach) -> TriangleGeometry {
        let corners = self.primitive_count as u64 * 3;
        let vertex_count = match self.index_type {
            IndexType::None => self.first_vertex as u64 + corners,
            _ => self.first_vertex as u64 + self.max_vertex as u64 + 1,
        };
        // The last vertex takes a stride or its own size, whichever is larger.
        let vertex_bytes = vertex_count
            .saturating_mul(self.vertex_stride_bytes)
            .saturating_add(MAX_VERTEX_BYTES);
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
            // SAFETY: the caller guarantees that nothing writes the transform during the call.
            transform: unsafe { read(reach, self.transform) },
            primitive_count: self.primitive_count,
            flags: self.flags,
            micromap: self.bounded_micromap(reach),
        }
    }

    /// The micromap, with the indices of the range's triangles.
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

impl MotionTriangles {
    /// As [`Triangles::read`].
    ///
    /// # Safety
    /// As [`Triangles::read`].
    unsafe fn read(&self, reach: &Reach) -> MotionGeometry {
        // SAFETY: the caller keeps the promises of `Triangles::read`.
        let start = unsafe { self.start.read(reach) };
        MotionGeometry {
            start,
            end_vertices: readable(reach, self.end_vertices, start.vertices.bytes as u64),
        }
    }
}

/// `sizeof(VkAabbPositionsKHR)`.
const AABB_BYTES: u64 = 24;

impl Aabbs {
    fn resolve(&self, reach: &Reach) -> AabbGeometry {
        let last = u64::from(self.primitive_count)
            .saturating_sub(1)
            .saturating_mul(self.stride_bytes);
        AabbGeometry {
            boxes: readable(reach, self.boxes, last.saturating_add(AABB_BYTES)),
            stride_bytes: self.stride_bytes,
            primitive_count: self.primitive_count,
            flags: self.flags,
        }
    }
}

/// Whether two pieces of memory have a byte in common.
fn overlap(one: &[u8], other: &[u8]) -> bool {
    let (one, other) = (one.as_ptr_range(), other.as_ptr_range());
    one.start < other.end && other.start < one.end
}

/// Whether builds of one command share scratch memory. That is invalid, and in parallel such builds
/// would corrupt each other.
fn share_scratch(builds: &[Build]) -> bool {
    let mut ranges: Vec<_> = (builds.iter())
        .map(|build| {
            (
                build.scratch,
                build.scratch.saturating_add(build.scratch_bytes()),
            )
        })
        .filter(|(start, end)| start < end)
        .collect();
    ranges.sort_unstable();
    ranges.windows(2).any(|pair| pair[1].0 < pair[0].1)
}

/// Performs builds in parallel: the specification forbids that builds of one command depend on each
/// other. `live` and `reach` are as for [`Build::execute`].
pub fn build(builds: &[Build], reach: &Reach, live: &Live, checks: Option<&Checks>) {
    let run = |build: &Build| {
        let _span = timeline::work("structure");
        if let Some(checks) = checks {
            // SAFETY: as in `execute`.
            unsafe { checks.build(build, reach) };
        }
        // SAFETY: as in `execute`.
        report(
            unsafe { build.execute(reach, live) },
            "acceleration structure build",
        );
    };
    match builds {
        [one] => run(one),
        _ if share_scratch(builds) => {
            log::error!("acceleration structure builds of one command share scratch memory");
            builds.iter().for_each(run);
        }
        _ => builds.par_iter().for_each(run),
    }
}

/// The number of threads that these builds can keep busy.
pub fn build_concurrency(builds: &[Build]) -> usize {
    /// The primitives for which a thread pays off.
    const SHARE: u64 = 4096;
    let shares = |build: &Build| build.geometries.primitive_count().div_ceil(SHARE).max(1);
    usize::try_from(builds.iter().map(shares).sum::<u64>()).unwrap_or(usize::MAX)
}

/// Reads an indirect build's ranges.
///
/// # Safety
/// Nothing writes the ranges during the call.
pub(super) unsafe fn with_ranges(
    indirect: &IndirectBuild,
    reach: &Reach,
    checks: Option<&Checks>,
) -> Build {
    let mut build = indirect.build.clone();
    for (index, &max) in indirect.max_primitive_counts.iter().enumerate() {
        let offset = index as u64 * u64::from(indirect.stride_bytes);
        let address = indirect.ranges.wrapping_add(offset);
        // SAFETY: the caller keeps the ranges unwritten. A range outside of memory is empty.
        let range = unsafe { read::<Range>(reach, address) }.unwrap_or_default();
        if let Some(checks) = checks {
            checks.ranges(address, size_of::<Range>() as u64);
            checks.range_count(address, range.primitive_count, max);
        }
        let primitive_count = range.primitive_count.min(max);
        build.geometries.apply_range(
            index,
            &Range {
                primitive_count,
                ..range
            },
        );
    }
    build
}
