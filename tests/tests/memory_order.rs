//! Memory order across shader calls: litmus tests of what the chapter says of payloads, callable
//! data, hit attributes, and of storage buffers, images and shader records at `ShaderCallKHR`
//! scope, and of built-ins that change. Each runs with one thread and with several. Then
//! invocations that wait for each other.

use tuff_tests::*;

const TRIANGLE: [[f32; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];

/// Invocations of each launch: some batches, and one that is not full.
const COUNT: u32 = 1000;

const HEAD: &str = r"
#extension GL_KHR_memory_scope_semantics : enable
#extension GL_KHR_shader_subgroup_basic : enable
#extension GL_KHR_shader_subgroup_ballot : enable
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) shadercallcoherent buffer W { uint words[]; };
layout(set = 0, binding = 2, r32ui) shadercallcoherent uniform uimage2D picture;
layout(set = 0, binding = 3, std430) buffer R { uint results[]; };
uint me() { return gl_LaunchIDEXT.x; }
void share() {
    memoryBarrier(gl_ScopeShaderCallEXT, gl_StorageSemanticsBuffer | gl_StorageSemanticsImage,
        gl_SemanticsAcquireRelease);
}
";

/// One litmus test: what its shaders do, and what invocation i leaves in `results`.
struct Litmus<'a> {
    globals: &'a str,
    /// As above, in the shaders of the hit group alone.
    hit_globals: &'a str,
    raygen: &'a str,
    miss: &'a str,
    hit: &'a str,
    any_hit: Option<&'a str>,
    intersection: Option<&'a str>,
    callable: Option<&'a str>,
    recursion: u32,
    expected: &'a dyn Fn(u32) -> u32,
    /// The known fault of lavapipe, if there is one.
    lavapipe: Option<&'a str>,
}

impl Default for Litmus<'_> {
    fn default() -> Self {
        Self {
            globals: "",
            hit_globals: "",
            raygen: "",
            miss: "",
            hit: "",
            any_hit: None,
            intersection: None,
            callable: None,
            recursion: 1,
            expected: &|_| 0,
            lavapipe: None,
        }
    }
}

/// Runs a litmus test, a few times.
fn run(litmus: &Litmus<'_>) {
    // Some validation layers take the barrier's scope for an unknown one.
    let gpu = Gpu::without_validation();
    let world = gpu.scene(&[match litmus.intersection {
        Some(_) => Geometry::boxes(
            &[[-1.0, -1.0, -0.5, 1.0, 1.0, 0.0]],
            vk::GeometryFlagsKHR::empty(),
        ),
        None => Geometry::triangles(&TRIANGLE, vk::GeometryFlagsKHR::empty()),
    }]);
    let incoming = "layout(location = 0) rayPayloadInEXT uint payload;";
    let of_hit = format!("{incoming}{}", litmus.hit_globals);
    let outgoing = "layout(location = 1) rayPayloadEXT uint deeper;";
    let calling = "layout(location = 2) callableDataEXT uint data;";
    let source = |declared: &str, body: &str| {
        let globals = litmus.globals;
        format!("{HEAD}{declared}\n{globals}\nvoid main() {{ {body} }}")
    };
    let of_raygen = format!("layout(location = 0) rayPayloadEXT uint payload; {calling}");
    let mut case = Case::new(&source(&of_raygen, litmus.raygen))
        .miss(&source(incoming, litmus.miss))
        .hit(&source(&format!("{of_hit}{outgoing}{calling}"), litmus.hit));
    if let Some(body) = litmus.any_hit {
        case = case.any_hit(&source(&of_hit, body));
    }
    if let Some(body) = litmus.intersection {
        case = case.intersection(&source(litmus.hit_globals, body));
    }
    if let Some(body) = litmus.callable {
        let data = "layout(location = 2) callableDataInEXT uint data; layout(location = 3) callableDataEXT uint more;";
        case = case.callable(&source(data, body));
    }
    let shape = Shape::flat(vk::Format::R32_UINT, COUNT, 1);
    let picture = gpu.picture(shape, vk::ImageUsageFlags::STORAGE);
    gpu.upload(&picture, 0, &[0u32; COUNT as usize]);
    let words = gpu.buffer(16 * u64::from(COUNT));
    let results = gpu.buffer(4 * u64::from(COUNT));
    let place = gpu.buffer(8);
    let case = case
        .recursion(litmus.recursion)
        .bind(world)
        .bind(words)
        .bind(Bound::StorageImage(picture.view))
        .bind(results)
        .bind(place);
    let rays = gpu.rays(&case);
    let mut table = case.table();
    table.miss = vec![Record::with(1, &[100u32])];
    table.hit = vec![Record::with(2, &[200u32])];
    for called in &mut table.callable {
        *called = Record::with(3, &[300u32]);
    }
    let regions = gpu.regions(&rays, &table);
    let handle_bytes = u64::from(gpu.pipeline_properties.shader_group_handle_size);
    place.write(0, &[regions[2].device_address + handle_bytes]);
    let expected: Vec<u32> = (0..COUNT).map(litmus.expected).collect();
    let check = || {
        for _ in 0..3 {
            gpu.run(|commands| gpu.record_trace(commands, &rays, &regions, [COUNT, 1, 1]));
            assert_eq!(results.read::<u32>(), expected);
        }
    };
    match litmus.lavapipe {
        Some(reason) => unless_known(&gpu, "llvmpipe", reason, check),
        None => check(),
    }
}

/// Down to the triangle or the box.
const DOWN: &str =
    "traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 0);";

#[test]
fn storage_buffers_follow_the_calls() {
    run(&Litmus {
        raygen: &format!(
            "words[4 * me()] = 7 + me(); share(); {DOWN} share(); results[me()] = words[4 * me()];"
        ),
        hit: "share(); words[4 * me()] *= 3; share();",
        expected: &|i| 3 * (7 + i),
        lavapipe: Some(
            "a value that was stored is not read again after a call, whatever barriers there are",
        ),
        ..Litmus::default()
    });
}

#[test]
fn storage_images_follow_the_calls() {
    run(&Litmus {
        raygen: &format!(
            "ivec2 at = ivec2(me(), 0); imageStore(picture, at, uvec4(5 + me())); share(); {DOWN} share();
            results[me()] = imageLoad(picture, at).x;"
        ),
        hit: "share(); ivec2 at = ivec2(me(), 0); imageStore(picture, at, imageLoad(picture, at) * 2u + 1u); share();",
        expected: &|i| 2 * (5 + i) + 1,
        ..Litmus::default()
    });
}

#[test]
fn one_invocation_sees_its_own_writes_in_order() {
    // No barrier: program order, across calls that do something else.
    run(&Litmus {
        raygen: &format!(
            "uint sum = 0; for (uint turn = 0; turn < 5; turn++) {{ words[4 * me()] = turn; {DOWN} sum = 10 * sum + words[4 * me()]; }}
            results[me()] = sum;"
        ),
        hit: "payload++;",
        expected: &|_| 1234,
        ..Litmus::default()
    });
}

#[test]
fn payloads_need_no_barrier() {
    run(&Litmus {
        raygen: &format!("payload = me(); {DOWN} results[me()] = payload;"),
        any_hit: Some("payload = payload * 2 + 1; if ((me() & 3u) == 0u) ignoreIntersectionEXT;"),
        hit: "payload += 1000;",
        miss: "payload += 5000;",
        // Writes of an any-hit shader stay, even if it ignores the hit.
        expected: &|i| 2 * i + 1 + if i % 4 == 0 { 5000 } else { 1000 },
        ..Litmus::default()
    });
}

#[test]
fn callable_data_needs_no_barrier() {
    run(&Litmus {
        raygen: "data = me(); executeCallableEXT(0, 2); results[me()] = data;",
        callable: Some(
            "if ((data & 7u) != 0u) { more = data - 1u; executeCallableEXT(0, 3); data = more * 2u; } else data += 1u;",
        ),
        expected: &|i| ((i & !7) + 1) << (i & 7),
        ..Litmus::default()
    });
}

#[test]
fn hit_attributes_are_those_of_the_hit_that_counts() {
    run(&Litmus {
        hit_globals: "hitAttributeEXT uvec2 mark;",
        raygen: &format!("payload = 0; {DOWN} results[me()] = payload;"),
        intersection: Some(
            "mark = uvec2(me(), 1); reportIntersectionEXT(1.25, 1u);
            mark = uvec2(me(), 2); reportIntersectionEXT(1.125, 2u);
            mark = uvec2(me(), 3); reportIntersectionEXT(1.375, 3u);
            mark = uvec2(me(), 4); reportIntersectionEXT(1.0625, 4u);
            mark = uvec2(9);",
        ),
        // The last one is ignored, the one before it is too far.
        any_hit: Some("payload += mark.y << 16; if (mark.y == 4u) ignoreIntersectionEXT;"),
        hit: "payload += mark.x * 8u + mark.y;",
        expected: &|i| ((1 + 2 + 4) << 16) + 8 * i + 2,
        lavapipe: Some(
            "attributes are those that the intersection shader leaves, not those that it reports",
        ),
        ..Litmus::default()
    });
}

#[test]
fn the_end_of_the_ray_is_read_anew() {
    run(&Litmus {
        hit_globals: "hitAttributeEXT uvec2 mark;",
        raygen: &format!("payload = 0; {DOWN} results[me()] = payload;"),
        intersection: Some(
            "float before = gl_RayTmaxEXT; mark = uvec2(0); bool first = reportIntersectionEXT(1.25, 1u);
            float between = gl_RayTmaxEXT; bool second = reportIntersectionEXT(1.5, 1u);
            float after = gl_RayTmaxEXT;
            mark = uvec2(before == 9.0 && between == 1.25 && after == 1.25, first && !second);
            reportIntersectionEXT(1.125, 2u);",
        ),
        hit: "payload = mark.x * 2 + mark.y + 4u * uint(gl_RayTmaxEXT == 1.125);",
        expected: &|_| 7,
        lavapipe: Some("gl_RayTmaxEXT stays what it was when the intersection shader began"),
        ..Litmus::default()
    });
}

#[track_caller]
fn has_ballots_in_ray_shaders() -> bool {
    let gpu = Gpu::without_validation();
    let mut subgroups = vk::PhysicalDeviceSubgroupProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut subgroups);
    // SAFETY: the chain is one structure of Vulkan 1.1.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut properties)
    };
    let stages = vk::ShaderStageFlags::RAYGEN_KHR | vk::ShaderStageFlags::CLOSEST_HIT_KHR;
    has(
        "ballots in ray tracing shaders",
        subgroups.supported_stages.contains(stages)
            && subgroups
                .supported_operations
                .contains(vk::SubgroupFeatureFlags::BALLOT),
    )
}

#[test]
fn subgroup_builtins_are_read_anew() {
    if !has_ballots_in_ray_shaders() {
        return;
    }
    run(&Litmus {
        globals: "
            uint consistent() {
                bool mine = (subgroupBallot(true) & gl_SubgroupEqMask) != uvec4(0);
                return uint(mine && gl_SubgroupInvocationID < gl_SubgroupSize);
            }",
        raygen: &format!(
            "payload = 0; uint sum = consistent(); for (uint turn = 0; turn < (me() & 3u); turn++) {{ {DOWN} sum += consistent(); }}
            results[me()] = sum * 16u + payload;"
        ),
        hit: "payload += consistent();",
        expected: &|i| (1 + (i & 3)) * 16 + (i & 3),
        ..Litmus::default()
    });
}

#[test]
fn shader_records_follow_what_is_written_to_them() {
    run(&Litmus {
        globals: "
            #extension GL_EXT_buffer_reference : enable
            #extension GL_EXT_buffer_reference_uvec2 : enable
            layout(set = 0, binding = 4, std430) buffer P { uvec2 place; };
            layout(buffer_reference, std430) shadercallcoherent buffer Record { uint word; };
            layout(shaderRecordEXT, std430) buffer Own { uint own; };",
        // Every invocation writes the same.
        raygen: &format!(
            "Record(place).word = 4711u; share(); payload = 0; {DOWN} results[me()] = payload;"
        ),
        hit: "share(); payload = own;",
        expected: &|_| 4711,
        ..Litmus::default()
    });
}

#[test]
fn chains_of_calls_hand_on_what_they_write() {
    run(&Litmus {
        raygen: &format!(
            "words[4 * me()] = 1; words[4 * me() + 1] = 0; share(); payload = 0; {DOWN} share();
            results[me()] = words[4 * me()] * 100u + words[4 * me() + 1];"
        ),
        hit: "share(); uint seen = words[4 * me()]; words[4 * me()] = seen * 2u; share();
            if (payload < 3u) {
                deeper = payload + 1u;
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, 1), 0.0, vec3(0, 0, -1), 9.0, 1);
            } else {
                data = 1u;
                executeCallableEXT(0, 2);
            }
            share(); words[4 * me() + 1] += words[4 * me()] == 48u ? 1u : 0u; share();",
        callable: Some("share(); words[4 * me()] = words[4 * me()] * 3u; share();"),
        recursion: 4,
        expected: &|_| 4804,
        lavapipe: Some(
            "a value that was stored is not read again after a call, whatever barriers there are",
        ),
        ..Litmus::default()
    });
}

#[test]
fn atomics_of_all_invocations_add_up() {
    run(&Litmus {
        raygen: &format!(
            "payload = 0; {DOWN} {DOWN} share(); results[me()] = atomicAdd(words[4 * me()], 0u) % 4u + payload;"
        ),
        hit: "atomicAdd(words[4 * me()], 2u); atomicAdd(words[4 * ((me() + 1u) % 1000u) + 1u], 1u); payload++;",
        expected: &|_| 2,
        ..Litmus::default()
    });
}

/// All of the above in processes whose device has one thread, and more than there are processors.
#[test]
fn the_number_of_threads_changes_nothing() {
    const CHILD: &str = "TUFF_TEST_THREADS";
    if std::env::var_os(CHILD).is_some() {
        return;
    }
    for threads in ["1", "5"] {
        let program = std::env::current_exe().expect("this program");
        let child = std::process::Command::new(program)
            .args([
                "--test-threads=1",
                "--skip",
                "the_number_of_threads_changes_nothing",
            ])
            .envs([("TUFF_THREADS", threads), (CHILD, "1")])
            .output()
            .expect("this program runs again");
        let said = String::from_utf8_lossy(&child.stdout);
        assert!(child.status.success(), "{threads} threads: {said}");
    }
}

/// Settings of Tuff with which invocations that wait for others must end.
const SETTINGS: [&[(&str, &str)]; 5] = [
    &[],
    &[("TUFF_THREADS", "1")],
    &[("TUFF_THREADS", "1"), ("TUFF_WAVE", "4")],
    &[("TUFF_THREADS", "1"), ("TUFF_WAVE", "1")],
    &[("TUFF_THREADS", "1"), ("TUFF_DIRECT", "0")],
];

/// Launches ray generation shaders that wait for each other, around a trace; returns the words.
/// `None` on other drivers: Vulkan does not promise that invocations make progress.
fn wait_around_a_trace(
    declared: &str,
    wait: &str,
    size: [u32; 3],
    words: usize,
) -> Option<Vec<u32>> {
    let gpu = Gpu::new().with("progress of all invocations", Gpu::is_tuff)?;
    let world = gpu.scene(&[Geometry::opaque(&TRIANGLE)]);
    let raygen = format!(
        "{WORLD}{declared}
        layout(location = 0) rayPayloadEXT uint payload;
        {wait}
        void main() {{
            for (uint turn = 1u; turn <= 2u; ++turn) {{
                wait(turn);
                vec2 at = vec2(gl_LaunchIDEXT.xy) / vec2(gl_LaunchSizeEXT.xy) * 2.0 - 1.0;
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(at, -1), 0.0, vec3(0, 0, 1), 10.0, 0);
            }}
        }}"
    );
    let hit = "layout(location = 0) rayPayloadInEXT uint payload; void main() { payload = 1u; }";
    let output = gpu.buffer_with(&vec![0u32; words]);
    let case = Case::new(&raygen).miss(MISS).hit(hit);
    case.bind(world).bind(output).trace(&gpu, size);
    Some(output.read())
}

/// One invocation at a time holds a lock, while the others spin.
#[test]
fn ray_generation_shaders_spin_for_a_lock() {
    let name = "ray_generation_shaders_spin_for_a_lock";
    if !SETTINGS.iter().any(|variables| alone(name, variables)) {
        return;
    }
    let declared = "layout(set = 0, binding = 1) coherent buffer Lock { uint held; uint count; };";
    let wait = "void wait(uint turn) {
        bool waits = true;
        while (waits) {
            if (atomicCompSwap(held, 0u, 1u) == 0u) {
                memoryBarrierBuffer();
                count = count + turn;
                memoryBarrierBuffer();
                atomicExchange(held, 0u);
                waits = false;
            }
        }
    }";
    let words = wait_around_a_trace(declared, wait, [96, 32, 1], 2);
    if let Some(words) = words {
        assert_eq!(words, [0, 3 * 96 * 32]);
    }
}

/// The first invocations of each square wait for the last ones, before a trace and after it.
#[test]
fn ray_generation_shaders_wait_for_later_ones() {
    let name = "ray_generation_shaders_wait_for_later_ones";
    if !SETTINGS.iter().any(|variables| alone(name, variables)) {
        return;
    }
    let declared = "layout(set = 0, binding = 1) buffer Given { uint given[]; };";
    let wait = "void wait(uint turn) {
        uvec2 at = gl_LaunchIDEXT.xy & 15u;
        uint slot = (gl_LaunchIDEXT.x >> 4u) * 16u + (at.y & 3u) * 4u + (at.x & 3u);
        if (all(greaterThanEqual(at, uvec2(12)))) atomicAdd(given[slot], 1u);
        if (all(lessThan(at, uvec2(4)))) while (atomicAdd(given[slot], 0u) < turn) {}
    }";
    let words = wait_around_a_trace(declared, wait, [48, 16, 1], 3 * 16);
    if let Some(words) = words {
        assert!(words.iter().all(|&word| word == 2));
    }
}
