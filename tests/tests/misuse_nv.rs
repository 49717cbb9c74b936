//! Broken rules of `VK_NV_ray_tracing`: reported by their names, and survived.

use tuff_tests::*;
use vk::BuildAccelerationStructureFlagsKHR as BuildFlags;

const TRIANGLE: [[f32; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];

const RAYGEN: &str =
    "traceNV(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);";

/// A trace that is right as it stands; each check spoils a part.
struct Trace<'a> {
    gpu: &'a Gpu,
    rays: Rays,
    tables: TablesNv,
    results: Buffer,
    world: StructureNv,
}

fn main(body: &str, storage: &str) -> String {
    format!(
        "layout(set = 0, binding = 0) uniform accelerationStructureNV world;
        layout(set = 0, binding = 1, std430) buffer W {{ uint words[]; }};
        layout(location = 0) {storage} uint payload;
        void main() {{ {body} }}"
    )
}

impl<'a> Trace<'a> {
    fn new(gpu: &'a Gpu) -> Self {
        Self::with(gpu, "payload = 2u;", vk::PipelineCreateFlags::empty())
    }

    fn with(gpu: &'a Gpu, hit: &str, flags: vk::PipelineCreateFlags) -> Self {
        let world = gpu.scene_nv(&[Geometry::opaque(&TRIANGLE)]);
        let results = gpu.buffer(64);
        let raygen = main(
            &format!("payload = 9u; {RAYGEN} words[0] = payload;"),
            "rayPayloadNV",
        );
        let miss = main("payload = 1u;", "rayPayloadInNV");
        let hit = main(hit, "rayPayloadInNV");
        let case = Case::new(&raygen).miss(&miss).hit(&hit);
        let rays = gpu.rays_nv(&case.flags(flags).bind(world).bind(results));
        let tables = gpu.tables_nv(&rays, &Table::of(0, &[1], &[2, 2]));
        Self {
            gpu,
            rays,
            tables,
            results,
            world,
        }
    }

    /// Traces rays and returns the first word of the results.
    fn run(&self, width: u32) -> u32 {
        self.results.write(0, &[0u32]);
        self.gpu.run(|commands| {
            let size = [width, 1, 1];
            self.gpu
                .record_trace_nv(commands, &self.rays, &self.tables, size);
        });
        self.results.read::<u32>()[0]
    }

    /// The same into another structure.
    fn run_into(&self, world: vk::AccelerationStructureNV) -> u32 {
        self.gpu
            .write(self.rays.set.handle, 0, 0, &Bound::StructureNv(world));
        self.run(1)
    }
}

/// A structure without memory; to be destroyed by the check.
fn unbound(gpu: &Gpu, described: &DescribedNv) -> vk::AccelerationStructureNV {
    let info = vk::AccelerationStructureCreateInfoNV::default().info(described.info());
    // SAFETY: the info outlives the call.
    unsafe { gpu.nv().create_acceleration_structure(&info, None) }.expect("a structure")
}

fn destroy(gpu: &Gpu, structure: vk::AccelerationStructureNV) {
    // SAFETY: it was made on this device, and nothing uses it.
    unsafe { gpu.nv().destroy_acceleration_structure(structure, None) };
}

fn described(gpu: &Gpu) -> DescribedNv {
    gpu.describe_nv(&[Geometry::opaque(&TRIANGLE)], BuildFlags::empty())
}

/// Builds with buffers of these names.
fn build(
    gpu: &Gpu,
    info: &vk::AccelerationStructureInfoNV<'_>,
    into: vk::AccelerationStructureNV,
    scratch: vk::Buffer,
) {
    let null = vk::AccelerationStructureNV::null();
    let none = vk::Buffer::null();
    gpu.run(|commands| {
        // SAFETY: the driver promises to survive this.
        unsafe {
            gpu.nv().cmd_build_acceleration_structure(
                commands, info, none, 0, false, into, null, scratch, 0,
            );
        }
    });
}

/// Each check breaks one rule, whose name is on the left; what it asserts holds with validation and
/// without.
const CHECKS: &[(&str, Misuse)] = &[
    ("VUID-vkCmdTraceRaysNV-None-03429", |gpu| {
        let mut trace = Trace::new(gpu);
        trace.tables.0[2] = TableNv {
            buffer: gpu.buffer_with(&[0x5au8; 32]).handle,
            offset: 0,
            stride: 32,
        };
        assert_eq!(trace.run(1), 9, "such a group is as good as none");
    }),
    (
        "VUID-vkCmdTraceRaysNV-missShaderBindingOffset-02458",
        |gpu| {
            let mut trace = Trace::new(gpu);
            trace.tables.0[1].offset += 16;
            trace.run(64);
        },
    ),
    (
        "VUID-vkCmdTraceRaysNV-hitShaderBindingStride-02464",
        |gpu| {
            let mut trace = Trace::new(gpu);
            trace.tables.0[2].stride = 33;
            trace.run(64);
        },
    ),
    (
        "VUID-vkCmdTraceRaysNV-hitShaderBindingStride-02467",
        |gpu| {
            let mut trace = Trace::new(gpu);
            trace.tables.0[2].stride = 1 << 40;
            assert_eq!(trace.run(1), 2, "record 0 is where it was");
        },
    ),
    (
        "VUID-vkCmdTraceRaysNV-hitShaderBindingTableBuffer-04044",
        |gpu| {
            let info = vk::BufferCreateInfo::default()
                .size(4096)
                .usage(gpu.usual_uses());
            // SAFETY: the buffer is of this device, and destroyed when nothing uses it.
            unsafe {
                let buffer = gpu.device.create_buffer(&info, None).expect("a buffer");
                let mut trace = Trace::new(gpu);
                trace.tables.0[2].buffer = buffer;
                assert_eq!(trace.run(1), 9);
                gpu.device.destroy_buffer(buffer, None);
            }
        },
    ),
    ("VUID-vkCmdTraceRaysNV-maxRecursionDepth-03625", |gpu| {
        let hit = format!("if (payload++ < 30u) {RAYGEN}");
        let trace = Trace::with(gpu, &hit, vk::PipelineCreateFlags::empty());
        assert_eq!(trace.run(64), 31, "depth costs heap only");
    }),
    ("VUID-vkCmdTraceRaysNV-None-08114", |gpu| {
        let trace = Trace::new(gpu);
        let other = unbound(gpu, &described(gpu));
        let memory = gpu.allocate(
            gpu.needs_nv(
                other,
                vk::AccelerationStructureMemoryRequirementsTypeNV::OBJECT,
            ),
            false,
        );
        let bind = vk::BindAccelerationStructureMemoryInfoNV::default()
            .acceleration_structure(other)
            .memory(memory);
        // SAFETY: the handles are of this device.
        unsafe { gpu.nv().bind_acceleration_structure_memory(&[bind]) }.expect("bound");
        gpu.write(trace.rays.set.handle, 0, 0, &Bound::StructureNv(other));
        destroy(gpu, other);
        assert_eq!(trace.run(64), 1, "nothing was ever built there");
    }),
    ("TUFF-build-output", |gpu| {
        let trace = Trace::new(gpu);
        let structure = unbound(gpu, &described(gpu));
        let scratch = gpu.buffer(1 << 16).handle;
        build(gpu, &described(gpu).info(), structure, scratch);
        build(
            gpu,
            &described(gpu).info(),
            trace.world.handle,
            vk::Buffer::null(),
        );
        let trace = Trace::new(gpu);
        assert_eq!(trace.run_into(structure), 1);
        let copy = |mode| {
            gpu.run(|commands| {
                // SAFETY: the driver promises to survive this.
                unsafe {
                    gpu.nv().cmd_copy_acceleration_structure(
                        commands,
                        structure,
                        trace.world.handle,
                        mode,
                    );
                    gpu.nv().cmd_copy_acceleration_structure(
                        commands,
                        trace.world.handle,
                        structure,
                        mode,
                    );
                }
            });
        };
        copy(vk::CopyAccelerationStructureModeKHR::CLONE);
        copy(vk::CopyAccelerationStructureModeKHR::COMPACT);
        assert_eq!(trace.run_into(trace.world.handle), 2);
        destroy(gpu, structure);
    }),
    ("TUFF-build-input", |gpu| {
        // Vertices in a buffer without memory, then past its end.
        let info = vk::BufferCreateInfo::default()
            .size(64)
            .usage(gpu.usual_uses());
        // SAFETY: the buffer is of this device, and destroyed when nothing uses it.
        unsafe {
            let buffer = gpu.device.create_buffer(&info, None).expect("a buffer");
            let triangles = vk::GeometryTrianglesNV::default()
                .vertex_data(buffer)
                .vertex_count(300)
                .vertex_stride(12)
                .vertex_format(vk::Format::R32G32B32_SFLOAT)
                .index_type(vk::IndexType::NONE_KHR);
            let mut geometries =
                [vk::GeometryNV::default().geometry_type(vk::GeometryTypeKHR::TRIANGLES)];
            geometries[0].geometry.triangles = triangles;
            for _ in 0..2 {
                let info = vk::AccelerationStructureInfoNV::default()
                    .ty(vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL)
                    .geometries(&geometries);
                let create = vk::AccelerationStructureCreateInfoNV::default().info(info);
                let structure = gpu
                    .nv()
                    .create_acceleration_structure(&create, None)
                    .expect("a structure");
                let memory = gpu.allocate(
                    gpu.needs_nv(
                        structure,
                        vk::AccelerationStructureMemoryRequirementsTypeNV::OBJECT,
                    ),
                    false,
                );
                let bind = vk::BindAccelerationStructureMemoryInfoNV::default()
                    .acceleration_structure(structure)
                    .memory(memory);
                gpu.nv()
                    .bind_acceleration_structure_memory(&[bind])
                    .expect("bound");
                build(gpu, &info, structure, gpu.buffer(1 << 20).handle);
                destroy(gpu, structure);
                geometries[0].geometry.triangles.vertex_data = gpu.buffer(64).handle;
                geometries[0].geometry.triangles.vertex_offset = 1 << 45;
            }
            gpu.device.destroy_buffer(buffer, None);
        }
    }),
    ("TUFF-build-reference", |gpu| {
        let trace = Trace::new(gpu);
        let astray = |reference| {
            StructureNv {
                handle: Default::default(),
                reference,
            }
            .instance()
        };
        let world = gpu.top_nv(&[astray(64), astray(u64::MAX - 255), astray(1 << 45)]);
        assert_eq!(trace.run_into(world.handle), 1);
    }),
];

#[test]
fn misuse_is_survived() {
    let Some(gpu) = Gpu::surviving() else { return };
    gpu.assert_survived(CHECKS);
    assert_eq!(Trace::new(&gpu).run(1), 2);
}

#[test]
fn misuse_is_reported_by_its_name() {
    let Some(gpu) = Gpu::reporting() else { return };
    assert_eq!(Trace::new(&gpu).run(1), 2);
    gpu.assert_silent();
    gpu.assert_reported(CHECKS);
    assert_eq!(Trace::new(&gpu).run(1), 2);
    gpu.assert_silent();
}

#[test]
fn deferred_pipelines_trace_nothing_before_they_are_compiled() {
    let Some(gpu) = Gpu::surviving() else { return };
    let trace = Trace::with(
        &gpu,
        "payload = 2u;",
        vk::PipelineCreateFlags::DEFER_COMPILE_NV,
    );
    let compile = |shader| {
        // SAFETY: the driver promises to survive what is wrong here.
        unsafe { gpu.nv().compile_deferred(trace.rays.pipeline, shader) }
    };
    assert_eq!(compile(1 << 20), Err(vk::Result::ERROR_UNKNOWN));
    for shader in [0, 2, 2] {
        assert_eq!(compile(shader), Ok(()));
        assert_eq!(trace.run(1), 0);
    }
    assert_eq!(compile(1), Ok(()));
    assert_eq!(trace.run(1), 2);
    let plain = Trace::new(&gpu);
    // SAFETY: the driver promises to survive what is wrong here.
    let again = unsafe { gpu.nv().compile_deferred(plain.rays.pipeline, 0) };
    assert_eq!(again, Err(vk::Result::ERROR_UNKNOWN));
}

#[test]
fn handles_need_eight_bytes() {
    let Some(gpu) = Gpu::surviving() else { return };
    let structure = gpu.bottom_nv(&[Geometry::opaque(&TRIANGLE)]);
    let mut bytes = [7u8; 8];
    // SAFETY: there is room for what is asked for.
    let result = unsafe {
        let get = gpu.nv().fp().get_acceleration_structure_handle_nv;
        get(
            gpu.device.handle(),
            structure.handle,
            4,
            bytes.as_mut_ptr().cast(),
        )
    };
    assert_eq!((result, bytes), (vk::Result::ERROR_UNKNOWN, [7; 8]));
}
