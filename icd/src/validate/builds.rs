//! What builds read on the device.

use spirv_jit::reach::Reach;
use traversal::IndexType;

use super::{Checks, Rule};
use crate::execute::acceleration_structure::{Build, BuildGeometries, Triangles};
use crate::execute::reachable::read;

impl Checks<'_> {
    /// Looks at a build with its ranges.
    ///
    /// # Safety
    /// Nothing writes what the build reads meanwhile.
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
        // SAFETY: the caller's promise, for each.
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
                        let bytes = u64::from(last) * list.stride_bytes + 24;
                        self.input("boxes", list.boxes, bytes, reach);
                    }
                }),
                BuildGeometries::Swept(list) => list.iter().for_each(|list| {
                    if list.primitive_count > 0 {
                        self.input("vertices", list.vertices, 1, reach);
                        self.input("radii", list.radii, 1, reach);
                    }
                }),
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
    /// Nothing writes what the build reads meanwhile.
    unsafe fn triangles(&self, list: &Triangles, reach: &Reach) {
        if list.primitive_count == 0 {
            return;
        }
        self.input("vertices", list.vertices, vertex_bytes(list), reach);
        if list.transform != 0 {
            self.input("transform", list.transform, 48, reach);
            // SAFETY: the caller's promise.
            let transform = unsafe { read::<[f32; 12]>(reach, list.transform) };
            let finite = transform.is_none_or(|transform| transform.iter().all(|n| n.is_finite()));
            self.require(finite, Rule::TransformFinite, list.transform, || {
                format!("{transform:?}")
            });
        }
        // SAFETY: the caller's promise.
        unsafe { self.indices(list, reach) };
    }

    /// # Safety
    /// Nothing writes the indices meanwhile.
    unsafe fn indices(&self, list: &Triangles, reach: &Reach) {
        let (size, restart) = match list.index_type {
            IndexType::None => return,
            IndexType::U8 => (1, u8::MAX.into()),
            IndexType::U16 => (2, u16::MAX.into()),
            IndexType::U32 => (4, u32::MAX),
        };
        let count = 3 * u64::from(list.primitive_count);
        self.input("indices", list.indices, size * count, reach);
        for i in 0..reach.clip(list.indices, size * count) / size {
            let address = list.indices + size * i;
            // SAFETY: the caller's promise.
            let index = unsafe {
                match size {
                    1 => read::<u8>(reach, address).map(u32::from),
                    2 => read::<u16>(reach, address).map(u32::from),
                    _ => read::<u32>(reach, address),
                }
            };
            let Some(index) = index.filter(|&index| index != restart) else {
                continue;
            };
            let highest = u64::from(index) + u64::from(list.first_vertex);
            let inside = highest <= u64::from(list.max_vertex);
            self.require(inside, Rule::MaxVertex, list.indices, || {
                format!("index {i} is {index}, past {}", list.max_vertex)
            });
        }
    }

    fn input(&self, what: &str, address: u64, size_bytes: u64, reach: &Reach) {
        let there = reach.contains(address, size_bytes);
        self.require(there, Rule::BuildInput, address, || {
            format!("{what} at {address:#x}, {size_bytes} bytes")
        });
    }

    fn output(&self, what: &str, address: u64, size_bytes: u64, reach: &Reach) {
        let there = size_bytes == 0 || reach.contains(address, size_bytes);
        self.require(there, Rule::BuildOutput, address, || {
            format!("{what} at {address:#x}, {size_bytes} bytes")
        });
    }

    /// Looks at where an indirect build's ranges are.
    pub fn ranges(&self, address: u64, size_bytes: u64) {
        use super::registry::Known;
        use ash::vk;
        let place = || format!("the ranges are at {address:#x}, {size_bytes} bytes");
        let is_aligned = address.is_multiple_of(4);
        self.require(is_aligned, Rule::RangeAlignment, address, place);
        match self.validator.registry.find(address, size_bytes) {
            Known::Outside => self.broken(Rule::RangeMemory, address, place),
            Known::Inside(usage) => self.require(
                usage.contains(vk::BufferUsageFlags::INDIRECT_BUFFER),
                Rule::RangeUsage,
                address,
                place,
            ),
        }
    }

    /// Looks at a primitive count that an indirect build read.
    pub fn range_count(&self, address: u64, count: u32, max: u32) {
        self.require(count <= max, Rule::RangeCount, address, || {
            format!("{count}, of {max}")
        });
    }
}

/// From the first vertex to the end of the last that the geometry names.
fn vertex_bytes(list: &Triangles) -> u64 {
    let last = match list.index_type {
        IndexType::None => {
            u64::from(list.first_vertex) + 3 * u64::from(list.primitive_count.saturating_sub(1)) + 2
        }
        _ => u64::from(list.max_vertex),
    };
    // The smallest position that there is: two components of 8 bits.
    last * list.vertex_stride_bytes + 2
}
