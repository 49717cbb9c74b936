//! Acceleration structures from lists of geometry.

use std::ffi::c_void;

use ash::vk;

use crate::gpu::Made;
use crate::{Buffer, Gpu, newer};

/// One geometry of a bottom-level structure.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// Corners, and the numbers of the corners of each triangle: all in turn when there are none.
    Triangles {
        corners: Vec<[f32; 3]>,
        indices: Vec<u32>,
        flags: vk::GeometryFlagsKHR,
    },
    /// Boxes, as minimum and maximum corners.
    Boxes {
        boxes: Vec<[f32; 6]>,
        flags: vk::GeometryFlagsKHR,
    },
    /// Spheres or linear swept spheres, as positions and radii of their ends; the numbers of the
    /// ends, all in turn when there are none.
    Swept {
        ends: Vec<[f32; 4]>,
        indices: Vec<u32>,
        sweep: Sweep,
        flags: vk::GeometryFlagsKHR,
    },
}

/// The kind of a list of round primitives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sweep {
    Spheres,
    Pairs { caps: bool },
    Successive { caps: bool },
}

impl Geometry {
    /// Opaque triangles.
    pub fn opaque(corners: &[[f32; 3]]) -> Geometry {
        Geometry::triangles(corners, vk::GeometryFlagsKHR::OPAQUE)
    }

    pub fn triangles(corners: &[[f32; 3]], flags: vk::GeometryFlagsKHR) -> Geometry {
        Geometry::Triangles {
            corners: corners.to_vec(),
            indices: Vec::new(),
            flags,
        }
    }

    pub fn boxes(boxes: &[[f32; 6]], flags: vk::GeometryFlagsKHR) -> Geometry {
        Geometry::Boxes {
            boxes: boxes.to_vec(),
            flags,
        }
    }
}

/// One instance of a bottom-level structure.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    pub structure: Structure,
    pub transform: [f32; 12],
    pub custom_index: u32,
    pub mask: u8,
    pub table_offset: u32,
    pub flags: vk::GeometryInstanceFlagsKHR,
}

impl Instance {
    /// As it is, seen by every ray.
    pub fn of(structure: Structure) -> Instance {
        Instance {
            structure,
            transform: identity(),
            custom_index: 0,
            mask: 0xff,
            table_offset: 0,
            flags: vk::GeometryInstanceFlagsKHR::empty(),
        }
    }
}

pub fn identity() -> [f32; 12] {
    scaled([1.0; 3], [0.0; 3])
}

pub fn translated(by: [f32; 3]) -> [f32; 12] {
    scaled([1.0; 3], by)
}

/// Scales about the origin, then moves.
pub fn scaled([x, y, z]: [f32; 3], [tx, ty, tz]: [f32; 3]) -> [f32; 12] {
    [x, 0.0, 0.0, tx, 0.0, y, 0.0, ty, 0.0, 0.0, z, tz]
}

/// A built structure.
#[derive(Clone, Copy, Debug)]
pub struct Structure {
    pub handle: vk::AccelerationStructureKHR,
    pub address: u64,
    pub size_bytes: u64,
    /// The buffer that it fills; of others than those of this harness nothing is known.
    pub storage: Option<Buffer>,
}

/// Triangles whose corners stand in turn, three numbers each.
pub fn triangles_at<'a>(
    corners: vk::DeviceOrHostAddressConstKHR,
    count: u32,
) -> vk::AccelerationStructureGeometryTrianglesDataKHR<'a> {
    vk::AccelerationStructureGeometryTrianglesDataKHR::default()
        .vertex_format(vk::Format::R32G32B32_SFLOAT)
        .vertex_data(corners)
        .vertex_stride(12)
        .max_vertex(count.max(1) - 1)
        .index_type(vk::IndexType::NONE_KHR)
}

/// A geometry of triangles.
pub fn geometry_of(
    triangles: vk::AccelerationStructureGeometryTrianglesDataKHR<'_>,
) -> vk::AccelerationStructureGeometryKHR<'_> {
    vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { triangles })
}

impl Gpu {
    /// Builds a bottom-level structure.
    pub fn bottom(&self, geometries: &[Geometry]) -> Structure {
        self.bottom_with(geometries, vk::BuildAccelerationStructureFlagsKHR::empty())
    }

    pub fn bottom_with(
        &self,
        geometries: &[Geometry],
        flags: vk::BuildAccelerationStructureFlagsKHR,
    ) -> Structure {
        let (mut described, mut ranges) = (Vec::new(), Vec::new());
        // One for each geometry at most, so that none moves.
        let mut chained = Vec::with_capacity(geometries.len());
        for geometry in geometries {
            let mut next: *const c_void = std::ptr::null();
            let (data, kind, own, count) = match geometry {
                Geometry::Triangles {
                    corners,
                    indices,
                    flags,
                } => {
                    let vertices = self.buffer_with(corners);
                    let mut data = triangles_at(vertices.at(), corners.len() as u32);
                    let mut count = corners.len() / 3;
                    if !indices.is_empty() {
                        count = indices.len() / 3;
                        data = data
                            .index_type(vk::IndexType::UINT32)
                            .index_data(self.buffer_with(indices).at());
                    }
                    let data = vk::AccelerationStructureGeometryDataKHR { triangles: data };
                    (data, vk::GeometryTypeKHR::TRIANGLES, *flags, count)
                }
                Geometry::Boxes { boxes, flags } => {
                    let data = vk::AccelerationStructureGeometryAabbsDataKHR::default()
                        .data(self.buffer_with(boxes).at())
                        .stride(24);
                    let data = vk::AccelerationStructureGeometryDataKHR { aabbs: data };
                    (data, vk::GeometryTypeKHR::AABBS, *flags, boxes.len())
                }
                Geometry::Swept {
                    ends,
                    indices,
                    sweep,
                    flags,
                } => {
                    chained.push(self.swept_data(ends, indices, *sweep));
                    next = (&raw const chained[chained.len() - 1]).cast();
                    let kind = match sweep {
                        Sweep::Spheres => newer::GEOMETRY_TYPE_SPHERES_NV,
                        _ => newer::GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV,
                    };
                    let numbers = if indices.is_empty() {
                        ends.len()
                    } else {
                        indices.len()
                    };
                    let count = match sweep {
                        Sweep::Pairs { .. } => numbers / 2,
                        _ => numbers,
                    };
                    let data = vk::AccelerationStructureGeometryDataKHR::default();
                    (data, kind, *flags, count)
                }
            };
            let mut it = vk::AccelerationStructureGeometryKHR::default()
                .geometry_type(kind)
                .geometry(data)
                .flags(own);
            it.p_next = next;
            described.push(it);
            ranges.push(
                vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count as u32),
            );
        }
        let level = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
        self.build(level, &described, &ranges, flags)
    }

    fn swept_data(&self, ends: &[[f32; 4]], indices: &[u32], sweep: Sweep) -> newer::SweptData {
        let vertices = self.buffer_with(ends);
        let mut data = newer::SweptData {
            s_type: newer::SweptData::LINEAR_SWEPT_SPHERES,
            p_next: std::ptr::null(),
            vertex_format: vk::Format::R32G32B32_SFLOAT,
            vertex_data: vertices.at(),
            vertex_stride: 16,
            radius_format: vk::Format::R32_SFLOAT,
            radius_data: vk::DeviceOrHostAddressConstKHR {
                device_address: vertices.address + 12,
            },
            radius_stride: 16,
            index_type: vk::IndexType::NONE_KHR,
            index_data: vk::DeviceOrHostAddressConstKHR { device_address: 0 },
            index_stride: 0,
            indexing_mode: 0,
            end_caps_mode: 0,
        };
        match sweep {
            Sweep::Spheres => data.s_type = newer::SweptData::SPHERES,
            Sweep::Pairs { caps } => data.end_caps_mode = i32::from(caps),
            Sweep::Successive { caps } => {
                data.indexing_mode = 1;
                data.end_caps_mode = i32::from(caps);
            }
        }
        if !indices.is_empty() {
            data.index_type = vk::IndexType::UINT32;
            data.index_data = self.buffer_with(indices).at();
            data.index_stride = 4;
        }
        data
    }

    /// Builds a top-level structure.
    pub fn top(&self, instances: &[Instance]) -> Structure {
        let data = vk::AccelerationStructureGeometryInstancesDataKHR::default()
            .data(self.buffer_with(&instance_records(instances)).at());
        let geometry = vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::INSTANCES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data });
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default()
            .primitive_count(instances.len() as u32);
        let flags = vk::BuildAccelerationStructureFlagsKHR::empty();
        let level = vk::AccelerationStructureTypeKHR::TOP_LEVEL;
        self.build(level, &[geometry], &[range], flags)
    }

    /// A scene of one bottom level, as it is.
    pub fn scene(&self, geometries: &[Geometry]) -> Structure {
        let bottom = self.bottom(geometries);
        self.top(&[Instance::of(bottom)])
    }

    /// Builds a structure of geometries that are described in full.
    pub fn build(
        &self,
        level: vk::AccelerationStructureTypeKHR,
        geometries: &[vk::AccelerationStructureGeometryKHR],
        ranges: &[vk::AccelerationStructureBuildRangeInfoKHR],
        flags: vk::BuildAccelerationStructureFlagsKHR,
    ) -> Structure {
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(level)
            .flags(flags)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(geometries);
        let counts: Vec<u32> = ranges.iter().map(|range| range.primitive_count).collect();
        let sizes = self.build_sizes(
            vk::AccelerationStructureBuildTypeKHR::DEVICE,
            &info,
            &counts,
        );
        let moves = flags.contains(vk::BuildAccelerationStructureFlagsKHR::MOTION_NV);
        let structure = self.create_structure(
            level,
            sizes.acceleration_structure_size,
            moves.then(|| counts.iter().sum()),
        );
        let alignment = u64::from(
            self.structure_properties
                .min_acceleration_structure_scratch_offset_alignment,
        );
        let scratch = self.buffer(sizes.build_scratch_size + alignment);
        info.scratch_data.device_address = scratch.address.next_multiple_of(alignment);
        info = info.dst_acceleration_structure(structure.handle);
        self.run(|commands| {
            // SAFETY: every buffer that the info refers to lives as long as the device.
            unsafe {
                self.acceleration
                    .cmd_build_acceleration_structures(commands, &[info], &[ranges]);
            }
        });
        structure
    }

    /// The sizes of a build of so many primitives, on the device or on the host.
    pub fn build_sizes(
        &self,
        on: vk::AccelerationStructureBuildTypeKHR,
        info: &vk::AccelerationStructureBuildGeometryInfoKHR,
        counts: &[u32],
    ) -> vk::AccelerationStructureBuildSizesInfoKHR<'static> {
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        // SAFETY: there is one count for each geometry.
        unsafe {
            (self.acceleration)
                .get_acceleration_structure_build_sizes(on, info, counts, &mut sizes);
        }
        sizes
    }

    /// Room for a structure of this size, to be built or copied into.
    pub fn empty_structure(
        &self,
        level: vk::AccelerationStructureTypeKHR,
        size_bytes: u64,
    ) -> Structure {
        self.create_structure(level, size_bytes, None)
    }

    /// The same with a number of instances, for structures in motion.
    fn create_structure(
        &self,
        level: vk::AccelerationStructureTypeKHR,
        size_bytes: u64,
        motion: Option<u32>,
    ) -> Structure {
        let buffer = self.buffer(size_bytes);
        let mut moving =
            vk::AccelerationStructureMotionInfoNV::default().max_instances(motion.unwrap_or(0));
        let mut create = vk::AccelerationStructureCreateInfoKHR::default()
            .buffer(buffer.handle)
            .size(size_bytes)
            .ty(level);
        if motion.is_some() {
            create = create
                .create_flags(vk::AccelerationStructureCreateFlagsKHR::MOTION_NV)
                .push_next(&mut moving);
        }
        // SAFETY: the buffer is large enough.
        unsafe {
            let handle = self
                .acceleration
                .create_acceleration_structure(&create, None);
            let handle = handle.expect("vkCreateAccelerationStructureKHR");
            self.keep(Made::Structure(handle));
            let address = vk::AccelerationStructureDeviceAddressInfoKHR::default()
                .acceleration_structure(handle);
            let address = self
                .acceleration
                .get_acceleration_structure_device_address(&address);
            Structure {
                handle,
                address,
                size_bytes,
                storage: Some(buffer),
            }
        }
    }

    /// Destroys a structure before its time.
    pub fn destroy(&self, structure: Structure) {
        let is_it = |made: &Made| matches!(made, Made::Structure(it) if *it == structure.handle);
        self.made.borrow_mut().retain(|made| !is_it(made));
        // SAFETY: it was made on this device, and is not destroyed again.
        unsafe {
            self.acceleration
                .destroy_acceleration_structure(structure.handle, None);
        }
    }
}

/// Instances as a build reads them.
pub(crate) fn instance_records(instances: &[Instance]) -> Vec<u8> {
    let records: Vec<vk::AccelerationStructureInstanceKHR> = instances
        .iter()
        .map(|instance| vk::AccelerationStructureInstanceKHR {
            transform: vk::TransformMatrixKHR {
                matrix: instance.transform,
            },
            instance_custom_index_and_mask: vk::Packed24_8::new(
                instance.custom_index,
                instance.mask,
            ),
            instance_shader_binding_table_record_offset_and_flags: vk::Packed24_8::new(
                instance.table_offset,
                instance.flags.as_raw() as u8,
            ),
            acceleration_structure_reference: vk::AccelerationStructureReferenceKHR {
                device_handle: instance.structure.address,
            },
        })
        .collect();
    // SAFETY: the records are plain data of 64 bytes without padding.
    let bytes = unsafe {
        std::slice::from_raw_parts(records.as_ptr().cast::<u8>(), size_of_val(&records[..]))
    };
    bytes.to_vec()
}
