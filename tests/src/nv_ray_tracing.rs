//! `VK_NV_ray_tracing`: structures with memory of their own, pipelines, and binding tables in
//! buffers.

use ash::{nv, vk};

use crate::acceleration::instance_records;
use crate::gpu::Made;
use crate::trace::group_info;
use crate::{Bound, Buffer, Case, Geometry, Gpu, Instance, Rays, Record, Stage, Structure, Table};
use crate::{Set, glsl_nv, stage_flag};

type BuildFlags = vk::BuildAccelerationStructureFlagsKHR;
type Needs = vk::AccelerationStructureMemoryRequirementsTypeNV;

/// A structure that has memory.
#[derive(Clone, Copy, Debug)]
pub struct StructureNv {
    pub handle: vk::AccelerationStructureNV,
    /// The reference that instances use.
    pub reference: u64,
}

impl From<StructureNv> for Bound {
    fn from(structure: StructureNv) -> Bound {
        Bound::StructureNv(structure.handle)
    }
}

impl Case {
    /// [`Case::trace`] by `VK_NV_ray_tracing`.
    pub fn trace_nv(&self, gpu: &Gpu, size: [u32; 3]) {
        gpu.trace_nv(&gpu.rays_nv(self), &self.table(), size);
    }
}

impl StructureNv {
    /// It as it is, seen by every ray.
    pub fn instance(&self) -> Instance {
        Instance::of(Structure {
            handle: vk::AccelerationStructureKHR::null(),
            address: self.reference,
            size_bytes: 0,
            storage: None,
        })
    }
}

/// The description of a structure.
pub struct DescribedNv {
    level: vk::AccelerationStructureTypeNV,
    flags: BuildFlags,
    geometries: Vec<vk::GeometryNV<'static>>,
    instances: Option<(Buffer, u32)>,
}

impl DescribedNv {
    pub fn info(&self) -> vk::AccelerationStructureInfoNV<'_> {
        vk::AccelerationStructureInfoNV::default()
            .ty(self.level)
            .flags(self.flags)
            .geometries(&self.geometries)
            .instance_count(self.instances.map_or(0, |(_, count)| count))
    }

    /// A transform for the triangles of a geometry.
    pub fn transform(&mut self, gpu: &Gpu, geometry: usize, matrix: [f32; 12]) {
        let triangles = &mut self.geometries[geometry].geometry.triangles;
        // The offset must be a multiple of 16.
        let buffer = gpu.buffer(64);
        buffer.write(16, &matrix);
        triangles.transform_data = buffer.handle;
        triangles.transform_offset = 16;
    }
}

impl Gpu {
    /// The commands, where the device has them.
    pub fn nv(&self) -> &nv::ray_tracing::Device {
        self.nv_ray_tracing
            .as_ref()
            .expect("the test asked for VK_NV_ray_tracing")
    }

    pub fn describe_nv(&self, geometries: &[Geometry], flags: BuildFlags) -> DescribedNv {
        let describe = |geometry: &Geometry| {
            let mut data = vk::GeometryDataNV::default();
            let (kind, flags) = match geometry {
                Geometry::Triangles {
                    corners,
                    indices,
                    flags,
                } => {
                    data.triangles = vk::GeometryTrianglesNV::default()
                        .vertex_data(self.buffer_with(corners).handle)
                        .vertex_count(corners.len() as u32)
                        .vertex_stride(12)
                        .vertex_format(vk::Format::R32G32B32_SFLOAT)
                        .index_type(vk::IndexType::NONE_KHR);
                    if !indices.is_empty() {
                        data.triangles = data
                            .triangles
                            .index_type(vk::IndexType::UINT32)
                            .index_data(self.buffer_with(indices).handle)
                            .index_count(indices.len() as u32);
                    }
                    (vk::GeometryTypeKHR::TRIANGLES, *flags)
                }
                Geometry::Boxes { boxes, flags } => {
                    // Not at the start, and not side by side.
                    let buffer = self.buffer(8 + 32 * boxes.len() as u64);
                    for (index, corners) in boxes.iter().enumerate() {
                        buffer.write(8 + 32 * index, corners);
                    }
                    data.aabbs = vk::GeometryAABBNV::default()
                        .aabb_data(buffer.handle)
                        .num_aab_bs(boxes.len() as u32)
                        .offset(8)
                        .stride(32);
                    (vk::GeometryTypeKHR::AABBS, *flags)
                }
                Geometry::Swept { .. } => panic!("VK_NV_ray_tracing has triangles and boxes"),
            };
            vk::GeometryNV::default()
                .geometry_type(kind)
                .geometry(data)
                .flags(flags)
        };
        DescribedNv {
            level: vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
            flags,
            geometries: geometries.iter().map(describe).collect(),
            instances: None,
        }
    }

    pub fn describe_top_nv(&self, instances: &[Instance], flags: BuildFlags) -> DescribedNv {
        let buffer = self.buffer_with(&instance_records(instances));
        DescribedNv {
            level: vk::AccelerationStructureTypeKHR::TOP_LEVEL,
            flags,
            geometries: Vec::new(),
            instances: Some((buffer, instances.len() as u32)),
        }
    }

    /// Creates a structure with room for the described geometry.
    pub fn structure_nv(&self, described: &DescribedNv) -> StructureNv {
        self.create_nv(&vk::AccelerationStructureCreateInfoNV::default().info(described.info()))
    }

    /// Creates a structure with room for a compacted copy of such a structure.
    pub fn compact_structure_nv(&self, described: &DescribedNv, size_bytes: u64) -> StructureNv {
        let info = vk::AccelerationStructureInfoNV::default()
            .ty(described.level)
            .flags(described.flags);
        self.create_nv(
            &vk::AccelerationStructureCreateInfoNV::default()
                .compacted_size(size_bytes)
                .info(info),
        )
    }

    fn create_nv(&self, info: &vk::AccelerationStructureCreateInfoNV<'_>) -> StructureNv {
        let nv = self.nv();
        // SAFETY: the info outlives the call, and the memory is as the structure asks for.
        unsafe {
            let handle = nv.create_acceleration_structure(info, None);
            let handle = handle.expect("vkCreateAccelerationStructureNV");
            let memory = self.allocate(self.needs_nv(handle, Needs::OBJECT), false);
            self.keep(Made::StructureNv(handle));
            let bind = vk::BindAccelerationStructureMemoryInfoNV::default()
                .acceleration_structure(handle)
                .memory(memory);
            nv.bind_acceleration_structure_memory(&[bind])
                .expect("vkBindAccelerationStructureMemoryNV");
            let reference = nv.get_acceleration_structure_handle(handle);
            StructureNv {
                handle,
                reference: reference.expect("vkGetAccelerationStructureHandleNV"),
            }
        }
    }

    pub fn needs_nv(
        &self,
        structure: vk::AccelerationStructureNV,
        what: Needs,
    ) -> vk::MemoryRequirements {
        let info = vk::AccelerationStructureMemoryRequirementsInfoNV::default()
            .ty(what)
            .acceleration_structure(structure);
        // SAFETY: the structure is of this device.
        let needs = unsafe {
            self.nv()
                .get_acceleration_structure_memory_requirements(&info)
        };
        needs.memory_requirements
    }

    /// Builds, or updates from what may be the same structure.
    pub fn build_nv(
        &self,
        described: &DescribedNv,
        into: &StructureNv,
        update_from: Option<&StructureNv>,
    ) {
        let what = match update_from {
            Some(_) => Needs::UPDATE_SCRATCH,
            None => Needs::BUILD_SCRATCH,
        };
        let scratch = self.buffer(self.needs_nv(into.handle, what).size);
        let instances = described.instances.map(|(buffer, _)| buffer.handle);
        let null = vk::AccelerationStructureNV::null();
        self.run(|commands| {
            // SAFETY: every buffer lives as long as the device.
            unsafe {
                self.nv().cmd_build_acceleration_structure(
                    commands,
                    &described.info(),
                    instances.unwrap_or_default(),
                    0,
                    update_from.is_some(),
                    into.handle,
                    update_from.map_or(null, |from| from.handle),
                    scratch.handle,
                    0,
                );
            }
        });
    }

    pub fn bottom_nv(&self, geometries: &[Geometry]) -> StructureNv {
        let described = self.describe_nv(geometries, BuildFlags::empty());
        let structure = self.structure_nv(&described);
        self.build_nv(&described, &structure, None);
        structure
    }

    pub fn top_nv(&self, instances: &[Instance]) -> StructureNv {
        let described = self.describe_top_nv(instances, BuildFlags::empty());
        let structure = self.structure_nv(&described);
        self.build_nv(&described, &structure, None);
        structure
    }

    /// A scene of one bottom level, as it is.
    pub fn scene_nv(&self, geometries: &[Geometry]) -> StructureNv {
        let bottom = self.bottom_nv(geometries);
        self.top_nv(&[bottom.instance()])
    }

    /// A pipeline of GLSL with `GL_NV_ray_tracing`.
    pub fn rays_nv(&self, case: &Case) -> Rays {
        let compile = |(stage, source): &(Stage, String)| {
            let module = self.module(&glsl_nv(*stage, source));
            vk::PipelineShaderStageCreateInfo::default()
                .stage(stage_flag(*stage))
                .module(module)
                .name(c"main")
        };
        let stages: Vec<_> = case.shaders.iter().map(compile).collect();
        let groups: Vec<_> = (case.groups.iter())
            .map(|group| {
                let group = group_info(group);
                vk::RayTracingShaderGroupCreateInfoNV::default()
                    .ty(group.ty)
                    .general_shader(group.general_shader)
                    .closest_hit_shader(group.closest_hit_shader)
                    .any_hit_shader(group.any_hit_shader)
                    .intersection_shader(group.intersection_shader)
            })
            .collect();
        let set: Set = case.set(self);
        let layout = self.layout(&[set.layout]);
        let info = vk::RayTracingPipelineCreateInfoNV::default()
            .flags(case.flags)
            .stages(&stages)
            .groups(&groups)
            .max_recursion_depth(case.recursion)
            .layout(layout);
        // SAFETY: the structures outlive the calls.
        unsafe {
            let no_cache = vk::PipelineCache::null();
            let made = (self.nv()).create_ray_tracing_pipelines(no_cache, &[info], None);
            let pipeline = made.expect("vkCreateRayTracingPipelinesNV")[0];
            self.keep(Made::Pipeline(pipeline));
            let size = self.pipeline_properties.shader_group_handle_size as usize;
            let mut bytes = vec![0; size * groups.len()];
            let count = groups.len() as u32;
            (self.nv())
                .get_ray_tracing_shader_group_handles(pipeline, 0, count, &mut bytes)
                .expect("vkGetRayTracingShaderGroupHandlesNV");
            Rays {
                pipeline,
                layout,
                set,
                handles: bytes.chunks(size).map(<[u8]>::to_vec).collect(),
            }
        }
    }

    /// Traces a grid of rays and waits for its end. All tables are in one buffer.
    pub fn trace_nv(&self, rays: &Rays, table: &Table, size: [u32; 3]) {
        let tables = self.tables_nv(rays, table);
        self.run(|commands| self.record_trace_nv(commands, rays, &tables, size));
    }

    pub fn record_trace_nv(
        &self,
        commands: vk::CommandBuffer,
        rays: &Rays,
        tables: &TablesNv,
        [width, height, depth]: [u32; 3],
    ) {
        self.bind_rays(commands, rays);
        let [raygen, miss, hit, callable] = tables.0;
        // SAFETY: the tables lie in buffers that live as long as the device.
        unsafe {
            self.nv().cmd_trace_rays(
                commands,
                raygen.buffer,
                raygen.offset,
                miss.buffer,
                miss.offset,
                miss.stride,
                hit.buffer,
                hit.offset,
                hit.stride,
                callable.buffer,
                callable.offset,
                callable.stride,
                width,
                height,
                depth,
            );
        }
    }

    /// Writes a binding table.
    pub fn tables_nv(&self, rays: &Rays, table: &Table) -> TablesNv {
        let base = u64::from(self.pipeline_properties.shader_group_base_alignment);
        let handle = rays.handles[0].len();
        let lists = [
            std::slice::from_ref(&table.raygen),
            &table.miss,
            &table.hit,
            &table.callable,
        ];
        let stride = |records: &[Record]| {
            let data = records.iter().map(|record| record.data.len()).max();
            (handle + data.unwrap_or(0)).next_multiple_of(handle)
        };
        let bytes = |records: &[Record]| (stride(records) * records.len()) as u64;
        let size: u64 = (lists.iter())
            .map(|records| bytes(records).next_multiple_of(base))
            .sum();
        let buffer = self.buffer(size);
        let mut end = 0;
        TablesNv(lists.map(|records| {
            if records.is_empty() {
                return TableNv::default();
            }
            let table = TableNv {
                buffer: buffer.handle,
                offset: end,
                stride: stride(records) as u64,
            };
            for (index, record) in records.iter().enumerate() {
                let mut bytes = vec![0; handle];
                if let Some(group) = record.group {
                    bytes.copy_from_slice(&rays.handles[group as usize]);
                }
                bytes.extend_from_slice(&record.data);
                buffer.write(end as usize + index * stride(records), &bytes);
            }
            end += bytes(records).next_multiple_of(base);
            table
        }))
    }
}

/// The four tables of a dispatch: ray generation, miss, hit, callable.
#[derive(Clone, Copy, Debug)]
pub struct TablesNv(pub [TableNv; 4]);

#[derive(Clone, Copy, Debug, Default)]
pub struct TableNv {
    pub buffer: vk::Buffer,
    pub offset: u64,
    pub stride: u64,
}
