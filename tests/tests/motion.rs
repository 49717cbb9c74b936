//! Motion (`VK_NV_ray_tracing_motion_blur`), against where things are at a time.

use tuff_tests::*;

const MOTION: vk::BuildAccelerationStructureFlagsKHR =
    vk::BuildAccelerationStructureFlagsKHR::MOTION_NV;

/// A device that has motion; `None` skips the test. Some validation layers take its structures and
/// its SPIR-V extension for unknown ones.
fn gpu() -> Option<Gpu> {
    let gpu = Gpu::without_validation();
    gpu.with("VK_NV_ray_tracing_motion_blur", |gpu| {
        gpu.optional.motion.ray_tracing_motion_blur == vk::TRUE
    })
}

fn gpu_with_micromaps() -> Option<Gpu> {
    gpu()?.with("VK_EXT_opacity_micromap", |gpu| {
        gpu.optional.micromap.micromap == vk::TRUE
    })
}

/// A bottom level of opaque triangles that move.
fn moving(gpu: &Gpu, start: &[[f32; 3]], end: &[[f32; 3]]) -> Structure {
    moving_with(gpu, start, end, vk::GeometryFlagsKHR::OPAQUE, None)
}

/// A bottom level of triangles that move, the first of which takes its opacity from a micromap's
/// first, and so on.
fn moving_with(
    gpu: &Gpu,
    start: &[[f32; 3]],
    end: &[[f32; 3]],
    flags: vk::GeometryFlagsKHR,
    micromap: Option<&Micromap>,
) -> Structure {
    let mut data = triangles_at(gpu.buffer_with(start).at(), start.len() as u32);
    let mut motion = vk::AccelerationStructureGeometryMotionTrianglesDataNV::default()
        .vertex_data(gpu.buffer_with(end).at());
    let opacity = micromap.map(|micromap| {
        vk::AccelerationStructureTrianglesOpacityMicromapEXT::default()
            .index_type(vk::IndexType::NONE_KHR)
            .micromap(micromap.handle)
            .usage_counts(&micromap.usages)
    });
    if let Some(opacity) = &opacity {
        motion.p_next = (&raw const *opacity).cast();
    }
    data.p_next = (&raw const motion).cast();
    let geometry = geometry_of(data).flags(flags);
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default()
        .primitive_count(start.len() as u32 / 3);
    let level = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
    gpu.build(level, &[geometry], &[range], MOTION)
}

/// How an instance moves: static, by two matrices, or by two decompositions.
enum Moves {
    Not([f32; 12]),
    Matrices([f32; 12], [f32; 12]),
    Decomposed([f32; 16], [f32; 16]),
}

/// A top level of instances that move, with custom indices from 0 on.
fn top(gpu: &Gpu, instances: &[(Structure, Moves)]) -> Structure {
    let mut words: Vec<u32> = Vec::new();
    for (index, (bottom, moves)) in instances.iter().enumerate() {
        let first = words.len();
        let (ty, transforms): (u32, Vec<f32>) = match moves {
            Moves::Not(transform) => (0, transform.to_vec()),
            Moves::Matrices(start, end) => (1, [*start, *end].concat()),
            Moves::Decomposed(start, end) => (2, [*start, *end].concat()),
        };
        words.extend([ty, 0]);
        words.extend(transforms.iter().map(|number| number.to_bits()));
        words.extend([index as u32 | 0xff00_0000, 0]);
        words.extend([bottom.address as u32, (bottom.address >> 32) as u32]);
        words.resize(first + 40, 0);
    }
    let data = vk::AccelerationStructureGeometryInstancesDataKHR::default()
        .data(gpu.buffer_with(&words).at());
    let geometry = vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::INSTANCES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data });
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default()
        .primitive_count(instances.len() as u32);
    let level = vk::AccelerationStructureTypeKHR::TOP_LEVEL;
    gpu.build(level, &[geometry], &[range], MOTION)
}

const HEAD: &str = r"
#extension GL_NV_ray_tracing_motion_blur : enable
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) buffer Results { float results[]; };
layout(set = 0, binding = 2, scalar) buffer Rays { float rays[]; };
";

/// The result of a ray: distance (or -1), time, custom index, three numbers of the transform.
type Found = [f32; 6];

/// Traces rays: origin, direction, time. A negative time traces without motion.
fn trace(gpu: &Gpu, world: Structure, rays: &[[f32; 7]]) -> Vec<Found> {
    trace_with(gpu, world, rays, vk::PipelineCreateFlags::empty())
}

const MICROMAPS: vk::PipelineCreateFlags =
    vk::PipelineCreateFlags::RAY_TRACING_OPACITY_MICROMAP_EXT;

fn trace_with(
    gpu: &Gpu,
    world: Structure,
    rays: &[[f32; 7]],
    flags: vk::PipelineCreateFlags,
) -> Vec<Found> {
    trace_any(gpu, world, rays, flags, None)
}

/// As [`trace`], with flags of the pipeline and an any-hit shader.
fn trace_any(
    gpu: &Gpu,
    world: Structure,
    rays: &[[f32; 7]],
    flags: vk::PipelineCreateFlags,
    any_hit: Option<&str>,
) -> Vec<Found> {
    let output = gpu.buffer(24 * rays.len() as u64);
    let raygen = format!(
        "{HEAD}
        layout(location = 0) rayPayloadEXT float payload[6];
        void main() {{
            uint i = gl_LaunchIDEXT.x;
            float v[7];
            for (uint k = 0u; k < 7u; k++)
                v[k] = rays[7u * i + k];
            vec3 from = vec3(v[0], v[1], v[2]), along = vec3(v[3], v[4], v[5]);
            if (v[6] < 0.0)
                traceRayEXT(world, 0u, 0xffu, 0u, 0u, 0u, from, 0.0, along, 1000.0, 0);
            else
                traceRayMotionNV(world, 0u, 0xffu, 0u, 0u, 0u, from, 0.0, along, 1000.0, v[6], 0);
            for (uint k = 0u; k < 6u; k++)
                results[6u * i + k] = payload[k];
        }}"
    );
    let miss = format!(
        "{HEAD}
        layout(location = 0) rayPayloadInEXT float payload[6];
        void main() {{ payload = float[](-1.0, gl_CurrentRayTimeNV, 0.0, 0.0, 0.0, 0.0); }}"
    );
    let hit = format!(
        "{HEAD}
        layout(location = 0) rayPayloadInEXT float payload[6];
        void main() {{
            payload = float[](gl_HitTEXT, gl_CurrentRayTimeNV, float(gl_InstanceCustomIndexEXT),
                gl_ObjectToWorldEXT[0].x, gl_ObjectToWorldEXT[3].x, gl_WorldToObjectEXT[3].x);
        }}"
    );
    let mut case = Case::new(&raygen).miss(&miss).hit(&hit);
    if let Some(any_hit) = any_hit {
        case = case.any_hit(any_hit);
    }
    case.flags(flags | vk::PipelineCreateFlags::RAY_TRACING_ALLOW_MOTION_NV)
        .bind(world)
        .bind(output)
        .bind(gpu.buffer_with(rays))
        .trace(gpu, [rays.len() as u32, 1, 1]);
    output.read()
}

/// A right triangle in the plane at this z.
fn triangle(z: f32) -> [[f32; 3]; 3] {
    [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]]
}

fn assert_close(found: &[Found], expected: &[Found]) {
    for (found, expected) in found.iter().zip(expected) {
        let close = found
            .iter()
            .zip(expected)
            .all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(close, "{found:?} instead of {expected:?}");
    }
}

const STILL: [f32; 16] = [
    1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0,
];

#[test]
fn vertices_move_on_lines() {
    let Some(gpu) = gpu() else { return };
    let bottom = moving(&gpu, &triangle(1.0), &triangle(3.0));
    let world = top(&gpu, &[(bottom, Moves::Not(identity()))]);
    let times = [-1.0, 0.0, 0.25, 0.5, 1.0];
    let rays = times.map(|time| [0.25, 0.25, 0.0, 0.0, 0.0, 1.0, time]);
    let expected = times.map(|time: f32| {
        let time = time.max(0.0);
        [1.0 + 2.0 * time, time, 0.0, 1.0, 0.0, 0.0]
    });
    assert_close(&trace(&gpu, world, &rays), &expected);
}

#[test]
fn instances_move_by_matrices() {
    let Some(gpu) = gpu() else { return };
    let bottom = gpu.bottom_with(&[Geometry::opaque(&triangle(1.0))], MOTION);
    let world = top(
        &gpu,
        &[
            (
                bottom,
                Moves::Matrices(translated([5.0, 0.0, 0.0]), translated([9.0, 0.0, 0.0])),
            ),
            (bottom, Moves::Not(translated([20.0, 0.0, 0.0]))),
        ],
    );
    let ray = |x: f32, time: f32| [x, 0.25, 0.0, 0.0, 0.0, 1.0, time];
    let rays = [
        ray(5.25, 0.0),
        ray(5.25, 0.5),
        ray(7.25, 0.5),
        ray(9.25, 1.0),
        ray(20.25, 0.75),
        ray(7.25, -1.0),
    ];
    let hit = |time: f32, x: f32, index: f32| [1.0, time, index, 1.0, x, -x];
    let miss = |time: f32| [-1.0, time, 0.0, 0.0, 0.0, 0.0];
    let expected = [
        hit(0.0, 5.0, 0.0),
        miss(0.5),
        hit(0.5, 7.0, 0.0),
        hit(1.0, 9.0, 0.0),
        hit(0.75, 20.0, 1.0),
        miss(0.0),
    ];
    assert_close(&trace(&gpu, world, &rays), &expected);
}

#[test]
fn instances_turn_by_quaternions() {
    let Some(gpu) = gpu() else { return };
    // Half a turn about z, by a quaternion from (0, 0, 0, 1) to (0, 0, 1, 0): a quarter in the
    // middle.
    let mut end = STILL;
    (end[11], end[12]) = (1.0, 0.0);
    let bottom = gpu.bottom_with(&[Geometry::opaque(&triangle(1.0))], MOTION);
    let world = top(&gpu, &[(bottom, Moves::Decomposed(STILL, end))]);
    let quarters = [[0.25, 0.25], [-0.25, 0.25], [-0.25, -0.25]];
    for (turned, time) in [0.0, 0.5, 1.0].into_iter().enumerate() {
        let rays = quarters.map(|[x, y]| [x, y, 0.0, 0.0, 0.0, 1.0, time]);
        let found = trace(&gpu, world, &rays);
        for (i, found) in found.iter().enumerate() {
            let expected = if i == turned { 1.0 } else { -1.0 };
            assert!((found[0] - expected).abs() < 1e-5, "{time} {i}: {found:?}");
        }
        let cosine = [1.0, 0.0, -1.0][turned];
        assert!((found[turned][3] - cosine).abs() < 1e-6);
    }
}

#[test]
fn moving_meshes_have_no_gaps() {
    let Some(gpu) = gpu() else { return };
    let mut random = Rng::with_seed(11);
    let side = 12;
    let mut grid = |z: f32| -> Vec<[f32; 3]> {
        (0..=side * (side + 2))
            .map(|i| {
                let (x, y) = ((i % (side + 1)) as f32, (i / (side + 1)) as f32);
                let mut jitter = |r: f32| between(&mut random, -r, r);
                [x + jitter(0.3), y + jitter(0.3), z + jitter(0.2)]
            })
            .collect()
    };
    let (start, end) = (grid(5.0), grid(7.0));
    let expand = |points: &[[f32; 3]]| -> Vec<[f32; 3]> {
        (0..side * side)
            .flat_map(|i| {
                let a = i / side * (side + 1) + i % side;
                let (b, c, d) = (a + 1, a + side + 1, a + side + 2);
                [a, b, c, c, b, d].map(|k| points[k])
            })
            .collect()
    };
    let bottom = moving(&gpu, &expand(&start), &expand(&end));
    let world = top(&gpu, &[(bottom, Moves::Not(identity()))]);
    let rays: Vec<[f32; 7]> = (0..2000)
        .map(|_| {
            let mut c = || between(&mut random, 1.0, side as f32 - 1.0);
            [c(), c(), 0.0, 0.0, 0.0, 1.0, c() / side as f32]
        })
        .collect();
    let found = trace(&gpu, world, &rays);
    for (ray, found) in rays.iter().zip(found) {
        let middle = 5.0 + 2.0 * ray[6];
        assert!((found[0] - middle).abs() < 0.25, "{ray:?}: {found:?}");
    }
}

#[test]
fn micromaps_move_with_their_triangles() {
    let Some(gpu) = gpu_with_micromaps() else {
        return;
    };
    // Transparent, opaque, unknown, unknown, over and over.
    let states = MicroTriangle::of(2, 2, |part| (part % 4) as u8);
    let micromap = gpu.micromap(std::slice::from_ref(&states));
    let shift = |by: f32| triangle(1.0).map(|[x, y, z]| [x + by, y, z]);
    let (start, end) = (shift(0.0), shift(4.0));
    for flags in [vk::GeometryFlagsKHR::empty(), vk::GeometryFlagsKHR::OPAQUE] {
        let bottom = moving_with(&gpu, &start, &end, flags, Some(&micromap));
        let world = top(&gpu, &[(bottom, Moves::Not(identity()))]);
        for time in [0.0, 0.25, 1.0] {
            let rays: Vec<[f32; 7]> = part_centres(2)
                .iter()
                .map(|[x, y]| [x + 4.0 * time, *y, 0.0, 0.0, 0.0, 1.0, time])
                .collect();
            let hits: Vec<bool> = trace_with(&gpu, world, &rays, MICROMAPS)
                .iter()
                .map(|found| found[0] > 0.0)
                .collect();
            // There is no any-hit shader: what is unknown is hit.
            let expected: Vec<bool> = states.states.iter().map(|&state| state != 0).collect();
            assert_eq!(hits, expected, "{time} {flags:?}");
        }
    }
}

#[test]
fn any_hit_shaders_decide_on_unknown_parts_in_motion() {
    let Some(gpu) = gpu_with_micromaps() else {
        return;
    };
    let states = MicroTriangle::of(1, 2, |part| part as u8);
    let micromap = gpu.micromap(std::slice::from_ref(&states));
    let end = triangle(3.0);
    let flags = vk::GeometryFlagsKHR::empty();
    let bottom = moving_with(&gpu, &triangle(1.0), &end, flags, Some(&micromap));
    let world = top(&gpu, &[(bottom, Moves::Not(identity()))]);
    let rays: Vec<[f32; 7]> = part_centres(1)
        .iter()
        .map(|[x, y]| [*x, *y, 0.0, 0.0, 0.0, 1.0, 0.5])
        .collect();
    let ignore = Some("void main() { ignoreIntersectionEXT; }");
    let found = trace_any(&gpu, world, &rays, MICROMAPS, ignore);
    let distances: Vec<f32> = found.iter().map(|found| found[0]).collect();
    assert_eq!(distances, [-1.0, 2.0, -1.0, -1.0]);
}
