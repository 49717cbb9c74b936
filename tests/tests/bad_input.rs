//! Input that breaks the rules. Vulkan leaves its effect open, so these tests look only at Tuff,
//! which promises an error or an answer, and a process that lives on.

use tuff_tests::*;

const COMPUTE: &str = r"
layout(local_size_x = 8) in;
layout(constant_id = 0) const uint many = 5u;
struct S { uint a[4]; vec3 v; };
layout(set = 0, binding = 0) buffer B { S s[]; };
layout(set = 0, binding = 1) uniform sampler2D t;
layout(set = 0, binding = 2, rgba8) uniform image2D p;
shared uint meet[8];
float f(vec2 x) { return x.x > 0.5 ? sin(x.y) : sqrt(x.x); }
void main() {
    uint i = gl_GlobalInvocationID.x;
    meet[gl_LocalInvocationIndex] = i;
    barrier();
    for (uint k = 0u; k < many; k++) {
        switch (k % 3u) {
        case 0u: s[i].a[k & 3u] += meet[(i + k) & 7u]; break;
        case 1u: s[i].v += textureLod(t, vec2(k), 0.0).xyz * f(s[i].v.xy); break;
        default: imageStore(p, ivec2(k, i), vec4(1.0));
        }
    }
}";

const RAYGEN: &str = r"
layout(set = 0, binding = 3) uniform accelerationStructureEXT world;
layout(location = 0) rayPayloadEXT vec4 payload;
layout(set = 0, binding = 0) buffer B { vec4 o[]; };
void main() {
    vec3 direction = vec3(0, 0, 1);
    for (int k = 0; k < 4; k++) {
        payload = vec4(k);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, direction, 10.0, 0);
        if (payload.x > 2.0) break;
        direction = payload.yzw;
    }
    o[gl_LaunchIDEXT.x] = payload;
}";

const HIT: &str = r"
layout(location = 0) rayPayloadInEXT vec4 payload;
hitAttributeEXT vec2 weights;
void main() { payload = vec4(gl_HitTEXT, weights, gl_ObjectToWorldEXT[1][2]); }";

/// A device, and a layout with room for what the shaders above name.
fn open() -> Option<(Gpu, vk::PipelineLayout)> {
    let gpu = Gpu::surviving()?;
    let buffer = gpu.buffer(4096);
    let picture = gpu.picture(
        Shape::flat(vk::Format::R8G8B8A8_UNORM, 8, 8),
        vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::STORAGE,
    );
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    let world = gpu.top(&[]);
    let set = gpu.set_of(&[
        buffer.into(),
        Bound::Sampled(picture.view, sampler),
        Bound::StorageImage(picture.view),
        world.into(),
    ]);
    let layout = gpu.layout(&[set.layout]);
    Some((gpu, layout))
}

/// Makes a pipeline of the words, or fails to; panics, crashes and hangs are what must not be.
fn swallow(gpu: &Gpu, stage: Stage, words: Vec<u32>, layout: vk::PipelineLayout) -> bool {
    let made = match stage {
        Stage::Compute => {
            gpu.try_kernel(&words, c"main", layout, &vk::SpecializationInfo::default())
        }
        Stage::RayGeneration => gpu.try_rays(&[(stage, words)], &[Group::general(0)], 1, layout),
        _ => gpu.try_rays(
            &[
                (Stage::RayGeneration, glsl(Stage::RayGeneration, RAYGEN)),
                (stage, words),
            ],
            &[Group::general(0), Group::hit(1)],
            1,
            layout,
        ),
    };
    if let Err(error) = made {
        let named = [
            vk::Result::ERROR_INVALID_SHADER_NV,
            vk::Result::ERROR_UNKNOWN,
            vk::Result::ERROR_OUT_OF_HOST_MEMORY,
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
            vk::Result::ERROR_INITIALIZATION_FAILED,
        ];
        assert!(named.contains(&error), "{error:?}");
    }
    made.is_ok()
}

fn modules() -> [(Stage, Vec<u32>); 3] {
    [
        (Stage::Compute, COMPUTE),
        (Stage::RayGeneration, RAYGEN),
        (Stage::ClosestHit, HIT),
    ]
    .map(|(stage, source)| (stage, glsl(stage, source)))
}

#[test]
fn a_thousand_corrupted_modules() {
    let Some((gpu, layout)) = open() else {
        return;
    };
    let modules = modules();
    let mut random = Rng::with_seed(31);
    let mut refused = 0;
    for round in 0..1000u32 {
        let (stage, words) = &modules[round as usize % 3];
        let mut words = words.clone();
        for _ in 0..1 + random.u32(..4) {
            let at = random.usize(..words.len());
            match random.u32(..6) {
                0 => words[at] = random.u32(..),
                1 => words[at] ^= 1 << random.u32(..32),
                2 => words[at] = random.u32(..200),
                3 => {
                    let from = random.usize(..words.len());
                    words[at] = words[from];
                }
                4 => {
                    words.remove(at);
                }
                _ => words.insert(at, random.u32(..1000)),
            }
        }
        refused += u32::from(!swallow(&gpu, *stage, words, layout));
    }
    assert!(refused > 300, "only {refused} of a thousand were refused");
    // The device is as good as new.
    for (stage, words) in modules {
        assert!(swallow(&gpu, stage, words, layout));
    }
}

#[test]
fn every_truncation_is_refused() {
    let Some((gpu, layout)) = open() else {
        return;
    };
    for (stage, words) in modules() {
        for length in (1..words.len()).step_by(7) {
            let refused = !swallow(&gpu, stage, words[..length].to_vec(), layout);
            assert!(refused, "{stage:?}: {length} of {} words", words.len());
        }
    }
}

#[test]
fn noise_is_refused() {
    let Some((gpu, layout)) = open() else {
        return;
    };
    let mut random = Rng::with_seed(32);
    for round in 0..200 {
        let mut words: Vec<u32> = (0..5 + random.u32(..300)).map(|_| random.u32(..)).collect();
        if round % 2 == 0 {
            words[..5].copy_from_slice(&[0x0723_0203, 0x0001_0600, 0, 500, 0]);
        }
        assert!(
            !swallow(&gpu, Stage::Compute, words, layout),
            "round {round}"
        );
    }
}

#[test]
fn a_wrong_entry_point_is_refused() {
    let Some((gpu, layout)) = open() else {
        return;
    };
    let words = glsl(Stage::Compute, COMPUTE);
    let none = vk::SpecializationInfo::default();
    for name in [c"Main", c"", c"main\xc3\xa9", c"no such thing"] {
        assert!(
            gpu.try_kernel(&words, name, layout, &none).is_err(),
            "{name:?}"
        );
    }
    assert!(gpu.try_kernel(&words, c"main", layout, &none).is_ok());
    // The right name in the wrong stage.
    assert!(!swallow(&gpu, Stage::RayGeneration, words, layout));
    assert!(!swallow(
        &gpu,
        Stage::Compute,
        glsl(Stage::ClosestHit, HIT),
        layout
    ));
}

#[test]
fn an_unsupported_capability_is_refused() {
    let Some((gpu, layout)) = open() else {
        return;
    };
    let words = glsl(Stage::Compute, COMPUTE);
    // OpCapability is opcode 17 of two words; the first follows the header. Kernel is 6; 5000 and
    // 0xffff are not assigned.
    assert_eq!(words[5], 2 << 16 | 17);
    for capability in [6, 5000, 0xffff] {
        let mut words = words.clone();
        words.splice(5..5, [2 << 16 | 17, capability]);
        assert!(
            !swallow(&gpu, Stage::Compute, words, layout),
            "{capability}"
        );
    }
}

#[test]
fn indices_out_of_range_reach_nothing() {
    let Some((gpu, _)) = open() else {
        return;
    };
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer I { int places[]; };
    layout(set = 0, binding = 1) buffer B { uint b[]; };
    layout(set = 0, binding = 2) buffer O { uint o[]; };
    layout(set = 0, binding = 3, r32ui) uniform uimage2D p;
    void main() {
        uint i = gl_GlobalInvocationID.x;
        int at = places[i];
        o[i] = b[at] + imageLoad(p, ivec2(at, 0)).x;
        b[at] = 7u;
        imageStore(p, ivec2(at, 1), uvec4(9u));
        imageAtomicAdd(p, ivec2(at, -1), 1u);
        atomicAdd(b[at], 1u);
    }";
    let mut places = vec![0i32; 64];
    let far = [16, 17, -1, i32::MIN, i32::MAX, 0x4000_0000, 1 << 20, -4096];
    places[..8].copy_from_slice(&far);
    for (i, place) in places.iter_mut().enumerate().skip(8) {
        *place = 1000 + 997 * i as i32;
    }
    let inputs = gpu.buffer_with(&places);
    let stored = gpu.buffer_with(&[5u32; 16]);
    let output = gpu.buffer_with(&[99u32; 64]);
    let shape = Shape::flat(vk::Format::R32_UINT, 4, 4);
    let picture = gpu.picture(shape, vk::ImageUsageFlags::STORAGE);
    gpu.upload(&picture, 0, &[3u32; 16]);
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::Storage(inputs)]),
            (1, &[Bound::Storage(stored)]),
            (2, &[Bound::Storage(output)]),
            (3, &[Bound::StorageImage(picture.view)]),
        ],
        [1, 1, 1],
    );
    assert_eq!(output.read::<u32>(), [0; 64]);
    assert_eq!(stored.read::<u32>(), [5; 16]);
    assert_eq!(gpu.download(&picture, 0, 4).read::<u32>(), [3; 16]);
}

/// Each of these rays ends at once, so that no shader and no walk ever looks at the time.
#[test]
fn a_dispatch_of_too_many_rays_ends_by_its_time_limit() {
    let test = "a_dispatch_of_too_many_rays_ends_by_its_time_limit";
    if !alone(test, &[("TUFF_TIMEOUT", "0.5")]) {
        return;
    }
    let Some(gpu) = Gpu::surviving() else { return };
    let case = Case::new("void main() {}");
    let rays = gpu.rays(&case);
    let regions = gpu.regions(&rays, &case.table());
    let started = std::time::Instant::now();
    let most = gpu.pipeline_properties.max_ray_dispatch_invocation_count;
    let extent = [1 << 14, most >> 14, 1];
    let ended = gpu.try_run(|commands| gpu.record_trace(commands, &rays, &regions, extent));
    // A machine that is as fast as that has nothing to be stopped.
    let is_late = started.elapsed() > std::time::Duration::from_secs(2);
    assert!(
        ended == Err(vk::Result::ERROR_DEVICE_LOST) || !is_late,
        "{ended:?}"
    );
}

/// The size of a workgroup is held to the device's limits, also where specialization constants make
/// it.
#[test]
fn a_workgroup_that_is_too_large_is_refused() {
    let Some(gpu) = Gpu::surviving() else { return };
    let source = "
    layout(local_size_x_id = 0, local_size_y_id = 1) in;
    layout(set = 0, binding = 0) buffer O { uint o[]; };
    void main() { atomicAdd(o[0], 1u); }";
    let count = gpu.buffer_with(&[0u32]);
    let set = gpu.set_of(&[count.into()]);
    let words = glsl(Stage::Compute, source);
    let layout = gpu.layout(&[set.layout]);
    let most = gpu.limits.max_compute_work_group_invocations;
    let mut invocations = 0;
    for [x, y] in [
        [most, 1],
        [128, most / 128],
        [128, 128],
        [most + 1, 1],
        [most, most],
        [0, 1],
    ] {
        let data = [x, y].map(u32::to_le_bytes).concat();
        let entries = [0, 1].map(|id| vk::SpecializationMapEntry {
            constant_id: id,
            offset: 4 * id,
            size: 4,
        });
        let constants = vk::SpecializationInfo::default()
            .map_entries(&entries)
            .data(&data);
        let made = gpu.try_kernel(&words, c"main", layout, &constants);
        let is_possible = (1..=most).contains(&x.saturating_mul(y));
        assert_eq!(made.is_ok(), is_possible, "{x} by {y}: {made:?}");
        if let Ok(pipeline) = made {
            gpu.dispatch::<u32>(Kernel { pipeline, layout }, &[set], &[], [1, 1, 1]);
            invocations += x * y;
            assert_eq!(count.read::<u32>(), [invocations]);
        }
    }
}
