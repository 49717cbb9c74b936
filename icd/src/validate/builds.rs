//! Checks of the memory that builds read on the device.

use spirv_jit::reach::Reach;
use traversal::{IndexType, Indexing};

use super::{Checks, Rule};
use crate::command::build::{Build, BuildGeometries, Triangles};
use crate::command::swept_sphere::Swept;
use crate::format::structure::index_size_bytes;
use crate::wave::reachable::read;

impl Checks {
    /// Checks a build with its ranges.
    ///
    /// # Safety
    /// Nothing writes the build's inputs during the call.
    pub unsafe fn build(&self, build: &Build, reach: &Reach) {
        let sizes = build.sizes();
        let scratch = match build.update_from {
            Some(_) => sizes.update_scratch_bytes,
            None => sizes.build_scratch_bytes,
        };
        self.output("scratch memory", build.scratch, scratch, reach);
        let destination = build.destination;
        self.output(
            "destination",
            destination.address,
            destination.size_bytes,
            reach,
        );
        // SAFETY: the caller guarantees that nothing writes what the build reads meanwhile.
        unsafe {
            match &build.geometries {
                BuildGeometries::Triangles(list) => {
                    list.iter().for_each(|list| self.triangles(list, reach));
                }
                BuildGeometries::Motion(list) => list.iter().for_each(|list| {
                    self.triangles(&list.start, reach);
                    let bytes = vertex_bytes(&list.start);
                    self.input("vertices at time 1", list.end_vertices, bytes, reach);
                }),
                BuildGeometries::Aabbs(list) => list.iter().for_each(|list| {
                    if let Some(last) = list.primitive_count.checked_sub(1) {
                        let bytes = u64::from(last)
                            .saturating_mul(list.stride_bytes)
                            .saturating_add(24);
                        self.input("boxes", list.boxes, bytes, reach);
                    }
                }),
                BuildGeometries::Swept(list) => {
                    list.iter().for_each(|list| self.swept(list, reach));
                }
                BuildGeometries::Instances(instances) => {
                    let known = self.validator.registry.structures();
                    for (index, reference) in instances.references(reach).enumerate() {
                        let place = build.destination.address;
                        let Some(reference) = reference else {
                            self.broken(Rule::BuildInput, place, || {
                                format!("instance {index} is not in live memory")
                            });
                            continue;
                        };
                        let exists = reference == 0 || known.contains(&reference);
                        self.require(exists, Rule::BuildReference, place, || {
                            format!("instance {index} refers to {reference:#x}")
                        });
                    }
                }
            }
        }
    }

    /// # Safety
    /// Nothing writes the build's inputs during the call.
    unsafe fn triangles(&self, list: &Triangles, reach: &Reach) {
        if list.primitive_count == 0 {
            return;
        }
        self.input("vertices", list.vertices, vertex_bytes(list), reach);
        if list.transform != 0 {
            self.input("transform", list.transform, 48, reach);
            // SAFETY: the caller guarantees that nothing writes what the build reads meanwhile.
            let transform = unsafe { read::<[f32; 12]>(reach, list.transform) };
            let finite = transform.is_none_or(|transform| transform.iter().all(|n| n.is_finite()));
            self.require(finite, Rule::TransformFinite, list.transform, || {
                format!("{transform:?}")
            });
        }
        // SAFETY: the caller guarantees that nothing writes what the build reads meanwhile.
        unsafe {
            self.indices(list, reach);
            self.geometry_micromap(list, reach);
        }
    }

    /// # Safety
    /// Nothing writes the indices during the call.
    unsafe fn indices(&self, list: &Triangles, reach: &Reach) {
        let size = index_size_bytes(list.index_type);
        if size == 0 {
            return;
        }
        let restart = u32::MAX >> (32 - 8 * size);
        let count = 3 * u64::from(list.primitive_count);
        self.input("indices", list.indices, size * count, reach);
        for i in 0..reach.clip(list.indices, size * count) / size {
            // SAFETY: the caller guarantees that nothing writes the indices meanwhile.
            let index = unsafe { read_index(list.index_type, reach, list.indices + size * i) };
            let Some(index) = index.filter(|&index| index != restart) else {
                continue;
            };
            let highest = u64::from(index) + u64::from(list.first_vertex);
            let inside = highest <= u64::from(list.max_vertex);
            self.require(inside, Rule::MaxVertex, list.indices, || {
                let (first, max) = (list.first_vertex, list.max_vertex);
                format!("index {i} is {index}: with firstVertex {first}, past maxVertex {max}")
            });
        }
    }

    /// The structures have no `maxVertex`, so every indexed vertex must be in memory.
    ///
    /// # Safety
    /// Nothing writes the indices during the call.
    unsafe fn swept(&self, list: &Swept, reach: &Reach) {
        let primitives = u64::from(list.primitive_count);
        let numbers = match list.indexing {
            Indexing::Pairs => 2 * primitives,
            _ => primitives,
        };
        let Some(last) = numbers.checked_sub(1) else {
            return;
        };
        let size = index_size_bytes(list.index_type);
        let highest = match list.index_type {
            IndexType::None => last,
            ty => {
                let stride = list.index_stride_bytes;
                let bytes = last.saturating_mul(stride).saturating_add(size);
                self.input("indices", list.indices, bytes, reach);
                (0..=last)
                    .map_while(|i| {
                        let address = list.indices.wrapping_add(i.wrapping_mul(stride));
                        // SAFETY: the caller guarantees that nothing writes the indices meanwhile.
                        unsafe { read_index(ty, reach, address) }
                    })
                    .max()
                    .unwrap_or(0)
                    .into()
            }
        };
        // The second end of a successive primitive is the vertex after the first.
        let second = u64::from(list.indexing == Indexing::Successive);
        let vertex = highest + second + u64::from(list.first_vertex);
        for (what, address, stride) in [
            ("vertices", list.vertices, list.vertex_stride_bytes),
            ("radii", list.radii, list.radius_stride_bytes),
        ] {
            // The sizes of the smallest position and radius formats.
            self.input(
                what,
                address,
                vertex.saturating_mul(stride).saturating_add(2),
                reach,
            );
        }
    }

    /// Whether a reference of a host build is the handle of a structure.
    pub fn host_reference(&self, handle: u64, destination: u64) -> bool {
        let exists = self.validator.registry.has_structure(handle);
        self.require(exists, Rule::BuildReference, destination, || {
            format!("an instance refers to {handle:#x}, which is not the handle of a structure")
        });
        exists
    }

    pub(super) fn input(&self, what: &str, address: u64, size_bytes: u64, reach: &Reach) {
        let there = reach.contains(address, size_bytes);
        self.require(there, Rule::BuildInput, address, || {
            format!("{what} at {address:#x}, {size_bytes} bytes")
        });
    }

    pub(super) fn output(&self, what: &str, address: u64, size_bytes: u64, reach: &Reach) {
        let there = size_bytes == 0 || reach.contains(address, size_bytes);
        self.require(there, Rule::BuildOutput, address, || {
            format!("{what} at {address:#x}, {size_bytes} bytes")
        });
    }

    /// Checks the memory of an indirect build's ranges.
    pub fn ranges(&self, address: u64, size_bytes: u64) {
        use super::registry::BufferCoverage;
        use ash::vk;
        let place = || format!("the ranges are at {address:#x}, {size_bytes} bytes");
        let is_aligned = address.is_multiple_of(4);
        self.require(is_aligned, Rule::RangeAlignment, address, place);
        match self.validator.registry.find(address, size_bytes) {
            BufferCoverage::Outside => self.broken(Rule::RangeMemory, address, place),
            BufferCoverage::Inside(usage) => self.require(
                usage.contains(vk::BufferUsageFlags::INDIRECT_BUFFER),
                Rule::RangeUsage,
                address,
                place,
            ),
        }
    }

    /// Checks a primitive count of an indirect build.
    pub fn range_count(&self, address: u64, count: u32, max: u32) {
        self.require(count <= max, Rule::RangeCount, address, || {
            format!("{count}, of {max}")
        });
    }
}

/// An index, if it is in memory.
///
/// # Safety
/// Nothing writes it meanwhile.
unsafe fn read_index(ty: IndexType, reach: &Reach, address: u64) -> Option<u32> {
    // SAFETY: the caller guarantees that nothing writes it meanwhile.
    unsafe {
        match ty {
            IndexType::None => None,
            IndexType::U8 => read::<u8>(reach, address).map(u32::from),
            IndexType::U16 => read::<u16>(reach, address).map(u32::from),
            IndexType::U32 => read::<u32>(reach, address),
        }
    }
}

/// The size from the first vertex to the end of the last.
fn vertex_bytes(list: &Triangles) -> u64 {
    let last = match list.index_type {
        IndexType::None => {
            u64::from(list.first_vertex) + 3 * u64::from(list.primitive_count.saturating_sub(1)) + 2
        }
        _ => u64::from(list.max_vertex),
    };
    // The smallest position format: two components of 8 bits.
    last.saturating_mul(list.vertex_stride_bytes)
        .saturating_add(2)
}
