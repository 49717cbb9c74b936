//! `VK_KHR_ray_tracing_maintenance1`: indirect tables, the cull mask in shaders, sizes and counts
//! of structures.

use ash::khr;
use tuff_tests::*;
use vk::QueryType as Query;

const TRIANGLE: [[f32; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];

#[track_caller]
fn has_maintenance1(gpu: &Gpu) -> bool {
    let there = gpu.optional.maintenance1.ray_tracing_maintenance1 != 0;
    has("VK_KHR_ray_tracing_maintenance1", there)
}

#[test]
fn tables_and_extent_come_from_memory() {
    let gpu = Gpu::new();
    let features = gpu.optional.maintenance1;
    let there = features.ray_tracing_pipeline_trace_rays_indirect2 != 0;
    if !has("vkCmdTraceRaysIndirect2KHR", there) {
        return;
    }
    let extension = khr::ray_tracing_maintenance1::Device::new(&gpu.instance, &gpu.device);
    let raygen = r"
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1, std430) buffer R { uint results[]; };
    layout(location = 0) rayPayloadEXT uint seen;
    layout(location = 1) callableDataEXT uint told;
    void main() {
        seen = 0;
        told = 0;
        uint i = gl_LaunchIDEXT.x + gl_LaunchSizeEXT.x * gl_LaunchIDEXT.y;
        vec3 origin = vec3(gl_LaunchIDEXT.x == 0 ? 0.0 : 9.0, 0, 1);
        traceRayEXT(world, 0u, 0xff, 1, 0, 1, origin, 0.0, vec3(0, 0, -1), 9.0, 0);
        executeCallableEXT(1, 1);
        results[i] = 1000 * gl_LaunchSizeEXT.y + 100 * told + seen;
    }";
    let payload = |value: u32| {
        format!("layout(location = 0) rayPayloadInEXT uint seen; void main() {{ seen = {value}; }}")
    };
    let (miss, hit) = (payload(2), payload(1));
    let callable = "layout(location = 1) callableDataInEXT uint told; void main() { told = 3; }";
    let output = gpu.buffer(4 * 6);
    let bottom = gpu.scene(&[Geometry::opaque(&TRIANGLE)]);
    let case = Case::new(raygen)
        .miss(&miss)
        .hit(&hit)
        .callable(callable)
        .bind(bottom)
        .bind(output);
    let rays = gpu.rays(&case);
    // The records wanted are the second of each table: the strides count.
    let table = Table {
        miss: vec![Record::default(), Record::of(1)],
        hit: vec![Record::default(), Record::of(2)],
        callable: vec![Record::default(), Record::of(3)],
        ..case.table()
    };
    let [raygen, miss, hit, callable] = gpu.regions(&rays, &table);
    let command = vk::TraceRaysIndirectCommand2KHR {
        raygen_shader_record_address: raygen.device_address,
        raygen_shader_record_size: raygen.size,
        miss_shader_binding_table_address: miss.device_address,
        miss_shader_binding_table_size: miss.size,
        miss_shader_binding_table_stride: miss.stride,
        hit_shader_binding_table_address: hit.device_address,
        hit_shader_binding_table_size: hit.size,
        hit_shader_binding_table_stride: hit.stride,
        callable_shader_binding_table_address: callable.device_address,
        callable_shader_binding_table_size: callable.size,
        callable_shader_binding_table_stride: callable.stride,
        width: 2,
        height: 3,
        depth: 1,
    };
    let size = std::mem::offset_of!(vk::TraceRaysIndirectCommand2KHR, depth) + 4;
    // SAFETY: words without padding up to the last one.
    let bytes =
        unsafe { std::slice::from_raw_parts((&raw const command).cast::<u8>(), size) }.to_vec();
    let place = gpu.buffer(size_of_val(&command) as u64);
    gpu.run(|commands| {
        // SAFETY: the command buffer is being recorded; the buffers live as long as the device.
        unsafe {
            // The device itself writes the command that it then follows.
            gpu.device
                .cmd_update_buffer(commands, place.handle, 0, &bytes);
            gpu.barrier(commands);
            gpu.bind_rays(commands, &rays);
            extension.cmd_trace_rays_indirect2(commands, place.address);
        }
    });
    let results: Vec<u32> = output.read();
    assert_eq!(results, [3301, 3302, 3301, 3302, 3301, 3302]);
}

#[test]
fn shaders_see_the_cull_mask() {
    let gpu = Gpu::new();
    if !has_maintenance1(&gpu) {
        return;
    }
    let raygen = r"
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1, std430) buffer R { uvec4 results[]; };
    layout(location = 0) rayPayloadEXT uvec4 seen;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        seen = uvec4(0);
        vec3 origin = vec3(i == 1 ? 9.0 : i == 2 ? 4.0 : 0.0, 0, 1);
        traceRayEXT(world, 0u, 0x5a00 + 0x31 + i, 0, 0, 0, origin, 0.0, vec3(0, 0, -1), 9.0, 0);
        results[i] = seen;
    }";
    let stage = |row: usize| {
        format!(
            "layout(location = 0) rayPayloadInEXT uvec4 seen; void main() {{ seen[{row}] = gl_CullMaskEXT; }}"
        )
    };
    let (miss, hit, any_hit) = (stage(0), stage(1), stage(2));
    // An intersection shader has no payload: its mask comes back as the hit kind.
    let intersection = "void main() { reportIntersectionEXT(0.5, gl_CullMaskEXT); }";
    let box_hit =
        "layout(location = 0) rayPayloadInEXT uvec4 seen; void main() { seen[3] = gl_HitKindEXT; }";
    let output = gpu.buffer(16 * 3);
    let triangle = gpu.bottom(&[Geometry::Triangles {
        corners: TRIANGLE.to_vec(),
        indices: vec![],
        flags: vk::GeometryFlagsKHR::empty(),
    }]);
    let boxes = gpu.bottom(&[Geometry::Boxes {
        boxes: vec![[3.0, -1.0, 0.0, 5.0, 1.0, 0.5]],
        flags: vk::GeometryFlagsKHR::OPAQUE,
    }]);
    let world = gpu.top(&[
        Instance {
            mask: 0x10,
            ..Instance::of(triangle)
        },
        Instance {
            table_offset: 1,
            ..Instance::of(boxes)
        },
    ]);
    let case = Case::new(raygen)
        .miss(&miss)
        .hit(&hit)
        .any_hit(&any_hit)
        .hit(box_hit)
        .intersection(intersection)
        .bind(world)
        .bind(output);
    case.trace(&gpu, [3, 1, 1]);
    let results: Vec<[u32; 4]> = output.read();
    assert_eq!(results[0], [0, 0x31, 0x31, 0]);
    assert_eq!(results[1], [0x32, 0, 0, 0]);
    assert_eq!(results[2], [0, 0, 0, 0x33]);
}

/// A query of one structure on the device, after a copy that the copy stage waits for.
fn query(gpu: &Gpu, structure: Structure, ty: Query) -> u64 {
    gpu.query(ty, |commands, pool| {
        let written = vk::AccessFlags2::ACCELERATION_STRUCTURE_WRITE_KHR;
        let barrier = [vk::MemoryBarrier2::default()
            .src_stage_mask(
                vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_COPY_KHR
                    | vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_BUILD_KHR,
            )
            .src_access_mask(written)
            .dst_stage_mask(
                vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_COPY_KHR
                    | vk::PipelineStageFlags2::RAY_TRACING_SHADER_KHR,
            )
            .dst_access_mask(
                vk::AccessFlags2::ACCELERATION_STRUCTURE_READ_KHR
                    | vk::AccessFlags2::SHADER_BINDING_TABLE_READ_KHR,
            )];
        let dependency = vk::DependencyInfo::default().memory_barriers(&barrier);
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_pipeline_barrier2(commands, &dependency) };
        gpu.record_property(commands, structure, ty, pool);
    })
}

#[test]
fn structures_tell_their_size_and_references() {
    let gpu = Gpu::new();
    let sync = gpu.features13.synchronization2 != 0;
    if !has_maintenance1(&gpu) || !has("synchronization2", sync) {
        return;
    }
    let bottom = gpu.bottom(&[Geometry::opaque(&TRIANGLE)]);
    let top = gpu.top(&[bottom; 5].map(Instance::of));
    let pointers = Query::ACCELERATION_STRUCTURE_SERIALIZATION_BOTTOM_LEVEL_POINTERS_KHR;
    assert_eq!(query(&gpu, top, pointers), 5);
    // The number is the one at byte 48 of the serialized head, and all of them fit the serialized
    // size.
    let serialized = query(
        &gpu,
        top,
        Query::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR,
    );
    assert!(serialized >= 56 + 8 * 5);
    for structure in [bottom, top] {
        let size = query(&gpu, structure, Query::ACCELERATION_STRUCTURE_SIZE_KHR);
        assert!(size > 0 && size <= structure.size_bytes, "{size}");
    }
}
