//! Opacity micromaps.

use crate::gpu::Made;
use crate::newer as vk;
use crate::{Buffer, Gpu};

/// A triangle of a micromap: a state for each of its 4ᴸ parts.
#[derive(Clone, Debug)]
pub struct MicroTriangle {
    pub level: u16,
    /// `VkOpacityMicromapFormatEXT`: 1 for two states, 2 for four.
    pub format: u16,
    pub states: Vec<u8>,
}

impl MicroTriangle {
    /// States from a function of the part.
    pub fn of(level: u16, format: u16, state: impl Fn(u32) -> u8) -> MicroTriangle {
        let states = (0..1u32 << (2 * level)).map(state).collect();
        MicroTriangle {
            level,
            format,
            states,
        }
    }

    /// The states as they lie in memory: one or two bits each, from the lowest bit on.
    fn packed(&self) -> Vec<u8> {
        let bits = usize::from(self.format);
        let mut bytes = vec![0; (self.states.len() * bits).div_ceil(8)];
        for (part, state) in self.states.iter().enumerate() {
            bytes[part * bits / 8] |= state << (part * bits % 8);
        }
        bytes
    }
}

/// The extension that a micromap is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MicromapForm {
    Ext,
    Khr,
}

/// A micromap and what a geometry has to say about it.
#[derive(Clone, Debug)]
pub struct Micromap {
    pub form: MicromapForm,
    /// In the EXT form.
    pub handle: vk::MicromapEXT,
    /// In the KHR form.
    pub structure: vk::AccelerationStructureKHR,
    /// Where it is, in the KHR form.
    pub address: u64,
    pub size_bytes: u64,
    pub usages: Vec<vk::MicromapUsageEXT>,
}

/// The inputs of a micromap build, in buffers.
pub struct MicromapParts {
    pub data: Buffer,
    pub triangles: Buffer,
    pub usages: Vec<vk::MicromapUsageEXT>,
}

impl Gpu {
    /// Builds a micromap on the device.
    pub fn micromap(&self, triangles: &[MicroTriangle]) -> Micromap {
        self.object_micromap(self.micromap_parts(triangles))
    }

    fn object_micromap(&self, parts: MicromapParts) -> Micromap {
        let mut info = parts.build_info();
        let device = self.device.handle();
        let mut sizes = vk::MicromapBuildSizesInfoEXT::default();
        // SAFETY: the info is complete except for the destination, which sizes do not depend on.
        unsafe {
            (self.micromaps.fp().get_micromap_build_sizes_ext)(
                device,
                vk::AccelerationStructureBuildTypeKHR::DEVICE,
                &info,
                &mut sizes,
            );
        }
        let alignment = u64::from(
            self.structure_properties
                .min_acceleration_structure_scratch_offset_alignment,
        );
        let scratch = self.buffer(sizes.build_scratch_size + alignment);
        let handle = self.empty_micromap(sizes.micromap_size);
        info.dst_micromap = handle;
        info.scratch_data.device_address = scratch.address.next_multiple_of(alignment);
        self.run(|commands| {
            // SAFETY: every buffer that the info refers to lives as long as the device.
            unsafe { (self.micromaps.fp().cmd_build_micromaps_ext)(commands, 1, &info) };
        });
        Micromap {
            form: MicromapForm::Ext,
            handle,
            structure: vk::AccelerationStructureKHR::null(),
            address: 0,
            size_bytes: sizes.micromap_size,
            usages: parts.usages,
        }
    }

    /// Builds a micromap of a form on the device.
    pub fn micromap_in(&self, form: MicromapForm, triangles: &[MicroTriangle]) -> Micromap {
        self.micromap_of(form, self.micromap_parts(triangles))
    }

    /// The same from inputs in buffers.
    pub fn micromap_of(&self, form: MicromapForm, parts: MicromapParts) -> Micromap {
        match form {
            MicromapForm::Ext => self.object_micromap(parts),
            MicromapForm::Khr => {
                let flags = vk::BuildAccelerationStructureFlagsKHR::ALLOW_COMPACTION;
                self.structure_micromap(parts, flags)
            }
        }
    }

    /// Builds a micromap of the KHR form.
    pub fn structure_micromap(
        &self,
        parts: MicromapParts,
        flags: vk::BuildAccelerationStructureFlagsKHR,
    ) -> Micromap {
        let data = parts.geometry_data();
        let mut geometry = vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GEOMETRY_TYPE_MICROMAP_KHR);
        geometry.p_next = (&raw const data).cast();
        let geometries = [geometry];
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(vk::ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR)
            .flags(flags)
            .geometries(&geometries);
        let fp = self.acceleration.fp();
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        // SAFETY: no counts go with a micromap.
        unsafe {
            (fp.get_acceleration_structure_build_sizes_khr)(
                self.device.handle(),
                vk::AccelerationStructureBuildTypeKHR::DEVICE,
                &info,
                std::ptr::null(),
                &mut sizes,
            );
        }
        assert_eq!(sizes.update_scratch_size, 0);
        let mut micromap = self.room_for_structure(sizes.acceleration_structure_size);
        let alignment = u64::from(
            self.structure_properties
                .min_acceleration_structure_scratch_offset_alignment,
        );
        let scratch = self.buffer(sizes.build_scratch_size + alignment);
        info.scratch_data.device_address = scratch.address.next_multiple_of(alignment);
        info.dst_acceleration_structure = micromap.structure;
        let no_ranges = [std::ptr::null()];
        self.run(|commands| {
            // SAFETY: every buffer that the info refers to lives as long as the device, and no
            // ranges go with a micromap.
            unsafe {
                (fp.cmd_build_acceleration_structures_khr)(commands, 1, &info, no_ranges.as_ptr());
            }
        });
        micromap.usages = parts.usages;
        micromap
    }

    /// Room for a micromap of the KHR form.
    pub fn room_for_structure(&self, size_bytes: u64) -> Micromap {
        type Create = unsafe extern "system" fn(
            vk::Device,
            *const vk::AccelerationStructureCreateInfo2KHR,
            *const vk::AllocationCallbacks<'_>,
            *mut vk::AccelerationStructureKHR,
        ) -> vk::Result;
        let buffer = self.buffer(size_bytes + 256);
        let address = buffer.address.next_multiple_of(256);
        let info = vk::AccelerationStructureCreateInfo2KHR {
            address_range: vk::DeviceAddressRangeKHR {
                address,
                size: size_bytes,
            },
            ty: vk::ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR,
            ..Default::default()
        };
        let mut structure = vk::AccelerationStructureKHR::null();
        let name = c"vkCreateAccelerationStructure2KHR";
        let device = self.device.handle();
        // SAFETY: the function is of this type, and the buffer large enough.
        unsafe {
            let found = (self.instance).get_device_proc_addr(device, name.as_ptr());
            let create: Create = std::mem::transmute(found.expect("it is there"));
            let made = create(device, &info, std::ptr::null(), &mut structure);
            made.result().expect("vkCreateAccelerationStructure2KHR");
        }
        self.keep(Made::Structure(structure));
        Micromap {
            form: MicromapForm::Khr,
            handle: vk::MicromapEXT::null(),
            structure,
            address,
            size_bytes,
            usages: Vec::new(),
        }
    }

    /// Room of a size for a copy of a micromap.
    pub fn room_for_copy(&self, of: &Micromap, size_bytes: u64) -> Micromap {
        let room = match of.form {
            MicromapForm::Khr => self.room_for_structure(size_bytes),
            MicromapForm::Ext => Micromap {
                handle: self.empty_micromap(size_bytes),
                ..of.clone()
            },
        };
        Micromap {
            usages: of.usages.clone(),
            ..room
        }
    }

    /// The compacted size of a micromap and that of its serialized data.
    pub fn micromap_sizes(&self, micromap: &Micromap) -> [u64; 2] {
        let types = match micromap.form {
            MicromapForm::Ext => [
                vk::QueryType::MICROMAP_COMPACTED_SIZE_EXT,
                vk::QueryType::MICROMAP_SERIALIZATION_SIZE_EXT,
            ],
            MicromapForm::Khr => [
                vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
                vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR,
            ],
        };
        types.map(|ty| {
            // SAFETY: the micromap is built, and the query reset.
            self.query(ty, |commands, pool| unsafe {
                match micromap.form {
                    MicromapForm::Ext => (self.micromaps.fp().cmd_write_micromaps_properties_ext)(
                        commands,
                        1,
                        &micromap.handle,
                        ty,
                        pool,
                        0,
                    ),
                    MicromapForm::Khr => self
                        .acceleration
                        .cmd_write_acceleration_structures_properties(
                            commands,
                            &[micromap.structure],
                            ty,
                            pool,
                            0,
                        ),
                }
            })
        })
    }

    /// Records a copy from one micromap to another of its form.
    pub fn record_micromap_copy(
        &self,
        commands: vk::CommandBuffer,
        from: &Micromap,
        to: &Micromap,
        compact: bool,
    ) {
        // SAFETY: both live as long as the device.
        unsafe {
            match from.form {
                MicromapForm::Ext => {
                    let info = vk::CopyMicromapInfoEXT::default()
                        .src(from.handle)
                        .dst(to.handle)
                        .mode(match compact {
                            true => vk::CopyMicromapModeEXT::COMPACT,
                            false => vk::CopyMicromapModeEXT::CLONE,
                        });
                    (self.micromaps.fp().cmd_copy_micromap_ext)(commands, &info);
                }
                MicromapForm::Khr => {
                    let info = vk::CopyAccelerationStructureInfoKHR::default()
                        .src(from.structure)
                        .dst(to.structure)
                        .mode(match compact {
                            true => vk::CopyAccelerationStructureModeKHR::COMPACT,
                            false => vk::CopyAccelerationStructureModeKHR::CLONE,
                        });
                    (self.acceleration).cmd_copy_acceleration_structure(commands, &info);
                }
            }
        }
    }

    /// Records that a micromap is written to memory.
    pub fn record_micromap_out(
        &self,
        commands: vk::CommandBuffer,
        from: &Micromap,
        device_address: u64,
    ) {
        let memory = vk::DeviceOrHostAddressKHR { device_address };
        // SAFETY: all of it lives as long as the device.
        unsafe {
            match from.form {
                MicromapForm::Ext => {
                    let info = vk::CopyMicromapToMemoryInfoEXT::default()
                        .src(from.handle)
                        .dst(memory)
                        .mode(vk::CopyMicromapModeEXT::SERIALIZE);
                    (self.micromaps.fp().cmd_copy_micromap_to_memory_ext)(commands, &info);
                }
                MicromapForm::Khr => {
                    let info = vk::CopyAccelerationStructureToMemoryInfoKHR::default()
                        .src(from.structure)
                        .dst(memory)
                        .mode(vk::CopyAccelerationStructureModeKHR::SERIALIZE);
                    (self.acceleration).cmd_copy_acceleration_structure_to_memory(commands, &info);
                }
            }
        }
    }

    /// Records that a micromap is read from memory.
    pub fn record_micromap_in(
        &self,
        commands: vk::CommandBuffer,
        device_address: u64,
        to: &Micromap,
    ) {
        let memory = vk::DeviceOrHostAddressConstKHR { device_address };
        // SAFETY: all of it lives as long as the device.
        unsafe {
            match to.form {
                MicromapForm::Ext => {
                    let info = vk::CopyMemoryToMicromapInfoEXT::default()
                        .src(memory)
                        .dst(to.handle)
                        .mode(vk::CopyMicromapModeEXT::DESERIALIZE);
                    (self.micromaps.fp().cmd_copy_memory_to_micromap_ext)(commands, &info);
                }
                MicromapForm::Khr => {
                    let info = vk::CopyMemoryToAccelerationStructureInfoKHR::default()
                        .src(memory)
                        .dst(to.structure)
                        .mode(vk::CopyAccelerationStructureModeKHR::DESERIALIZE);
                    (self.acceleration).cmd_copy_memory_to_acceleration_structure(commands, &info);
                }
            }
        }
    }

    /// Room for a micromap of this size.
    pub fn empty_micromap(&self, size_bytes: u64) -> vk::MicromapEXT {
        let buffer = self.buffer(size_bytes);
        let info = vk::MicromapCreateInfoEXT::default()
            .buffer(buffer.handle)
            .size(size_bytes)
            .ty(vk::MicromapTypeEXT::OPACITY_MICROMAP);
        let mut handle = vk::MicromapEXT::null();
        // SAFETY: the buffer is large enough.
        let made = unsafe {
            (self.micromaps.fp().create_micromap_ext)(
                self.device.handle(),
                &info,
                std::ptr::null(),
                &mut handle,
            )
        };
        made.result().expect("vkCreateMicromapEXT");
        self.keep(Made::Micromap(handle));
        handle
    }

    /// Writes what a micromap is built from into buffers.
    pub fn micromap_parts(&self, triangles: &[MicroTriangle]) -> MicromapParts {
        let (mut data, mut records, mut usages) = (Vec::new(), Vec::new(), Vec::new());
        for triangle in triangles {
            records.push([
                data.len() as u32,
                u32::from(triangle.level) | u32::from(triangle.format) << 16,
            ]);
            data.extend(triangle.packed());
            usages.push(vk::MicromapUsageEXT {
                count: 1,
                subdivision_level: triangle.level.into(),
                format: triangle.format.into(),
            });
        }
        MicromapParts {
            data: self.buffer_with(&data),
            triangles: self.buffer_with(&records),
            usages,
        }
    }
}

impl MicromapParts {
    /// The structure in the chain of a geometry of the KHR form.
    pub fn geometry_data(&self) -> vk::AccelerationStructureGeometryMicromapDataKHR {
        vk::AccelerationStructureGeometryMicromapDataKHR {
            usage_counts_count: self.usages.len() as u32,
            p_usage_counts: self.usages.as_ptr(),
            data: self.data.address,
            triangle_array: self.triangles.address,
            triangle_array_stride: 8,
            ..Default::default()
        }
    }

    /// A build without destination and scratch.
    pub fn build_info(&self) -> vk::MicromapBuildInfoEXT<'_> {
        vk::MicromapBuildInfoEXT::default()
            .ty(vk::MicromapTypeEXT::OPACITY_MICROMAP)
            .flags(vk::BuildMicromapFlagsEXT::ALLOW_COMPACTION)
            .mode(vk::BuildMicromapModeEXT::BUILD)
            .usage_counts(&self.usages)
            .data(vk::DeviceOrHostAddressConstKHR {
                device_address: self.data.address,
            })
            .triangle_array(vk::DeviceOrHostAddressConstKHR {
                device_address: self.triangles.address,
            })
            .triangle_array_stride(8)
    }
}

/// The middle of each part of a triangle, in the order of the states: at each level the child near
/// vertex 0, the middle one, the one near vertex 1 and the one near vertex 2, the second and the
/// last of them flipped (chapter Ray Traversal, "Ray Opacity Micromap"). Weights of the second and
/// the third vertex.
pub fn part_centres(level: u16) -> Vec<[f32; 2]> {
    (0..1u32 << (2 * level))
        .map(|part| part_centre(level, part))
        .collect()
}

/// The middle of one part.
pub fn part_centre(level: u16, part: u32) -> [f32; 2] {
    let middle = |p: [f64; 2], q: [f64; 2]| [(p[0] + q[0]) / 2.0, (p[1] + q[1]) / 2.0];
    let mut corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    for digit in (0..level).rev() {
        let [a, b, c] = corners;
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        let children = [[a, ab, ca], [ca, bc, ab], [ab, b, bc], [bc, ca, c]];
        corners = children[(part >> (2 * digit)) as usize & 3];
    }
    let [a, b, c] = corners;
    [0, 1].map(|i| ((a[i] + b[i] + c[i]) / 3.0) as f32)
}
