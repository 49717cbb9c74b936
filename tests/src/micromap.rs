//! Opacity micromaps.

use ash::vk;

use crate::gpu::Made;
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

/// A micromap and what a geometry has to say about it.
#[derive(Clone, Debug)]
pub struct Micromap {
    pub handle: vk::MicromapEXT,
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
        let parts = self.micromap_parts(triangles);
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
            handle,
            size_bytes: sizes.micromap_size,
            usages: parts.usages,
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
    fn divide(corners: [[f64; 2]; 3], level: u16, out: &mut Vec<[f32; 2]>) {
        let middle = |p: [f64; 2], q: [f64; 2]| [(p[0] + q[0]) / 2.0, (p[1] + q[1]) / 2.0];
        let [a, b, c] = corners;
        if level == 0 {
            out.push([0, 1].map(|i| ((a[i] + b[i] + c[i]) / 3.0) as f32));
            return;
        }
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        for child in [[a, ab, ca], [ca, bc, ab], [ab, b, bc], [bc, ca, c]] {
            divide(child, level - 1, out);
        }
    }
    let mut out = Vec::new();
    divide([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], level, &mut out);
    out
}
