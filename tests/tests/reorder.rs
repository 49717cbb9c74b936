//! Hit objects and reordering (`VK_NV_ray_tracing_invocation_reorder`).

use tuff_tests::*;

/// A device that has hit objects; `None` skips the test.
fn gpu() -> Option<Gpu> {
    let gpu = Gpu::new();
    gpu.with("VK_NV_ray_tracing_invocation_reorder", |gpu| {
        gpu.optional.reorder.ray_tracing_invocation_reorder == vk::TRUE
    })
}

const HEAD: &str = r"
#extension GL_NV_shader_invocation_reorder : enable
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) buffer Results { uint results[]; };
";
const MISS: &str = r"
layout(location = 0) rayPayloadInEXT uint payload;
layout(shaderRecordEXT, scalar) buffer Record { uint name; };
void main() { payload = payload * 10u + name; }
";
const HIT: &str = r"
layout(location = 0) rayPayloadInEXT uint payload;
layout(shaderRecordEXT, scalar) buffer Record { uint name; };
hitAttributeEXT vec2 weights;
void main() {
    payload = payload * 10u + name + 1000u * (uint(gl_PrimitiveID) + 10u * uint(gl_InstanceCustomIndexEXT))
        + 1000000u * uint(weights.x * 8.0) + 10000000u * uint(gl_RayTmaxEXT);
}
";

/// Two right triangles side by side at z = 1: x from 0 to 1 and from 1 to 2; custom index 3, moved
/// by 10 in x.
fn world(gpu: &Gpu) -> Structure {
    let corners = [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [0.0, 1.0, 1.0],
        [1.0, 0.0, 1.0],
        [2.0, 0.0, 1.0],
        [1.0, 1.0, 1.0],
    ];
    let bottom = gpu.bottom(&[Geometry::opaque(&corners)]);
    gpu.top(&[Instance {
        transform: translated([10.0, 0.0, 0.0]),
        custom_index: 3,
        ..Instance::of(bottom)
    }])
}

/// Traces with hit records named 1 and 2, miss records named 5 and 6.
fn trace(gpu: &Gpu, raygen: &str, size: [u32; 3], words: usize) -> Vec<u32> {
    let world = world(gpu);
    let output = gpu.buffer(4 * words as u64);
    output.write(0, &vec![0u32; words]);
    let raygen = format!("{HEAD}{raygen}");
    let case = Case::new(&raygen)
        .miss(MISS)
        .hit(HIT)
        .bind(world)
        .bind(output);
    let table = Table {
        miss: vec![Record::with(1, &[5u32]), Record::with(1, &[6u32])],
        hit: vec![Record::with(2, &[1u32]), Record::with(2, &[2u32])],
        ..case.table()
    };
    gpu.trace(&gpu.rays(&case), &table, size);
    output.read()
}

#[test]
fn hit_objects_are_traced_then_executed() {
    let Some(gpu) = gpu() else { return };
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        vec3 from = vec3(10.25 + float(i), 0.25, 0.0);
        hitObjectNV object;
        payload = 7u;
        hitObjectTraceRayNV(object, world, 0u, 0xffu, 1u, 0u, 1u, from, 0.0, vec3(0, 0, 1), 9.0, 0);
        results[4u * i] = payload;
        results[4u * i + 1u] = uint(hitObjectIsEmptyNV(object)) + 2u * uint(hitObjectIsMissNV(object)) + 4u * uint(hitObjectIsHitNV(object));
        hitObjectExecuteShaderNV(object, 0);
        results[4u * i + 2u] = payload;
        hitObjectRecordEmptyNV(object);
        hitObjectExecuteShaderNV(object, 0);
        results[4u * i + 3u] = uint(hitObjectIsEmptyNV(object)) + payload;
    }";
    let results = trace(&gpu, raygen, [3, 1, 1], 12);
    // t is 1, the first weight is 1/4, the hit record's name 2, the miss record's 6.
    let hit = |primitive: u32| 72 + 1000 * (primitive + 30) + 2_000_000 + 10_000_000;
    let expected = [
        [7, 4, hit(0), hit(0) + 1],
        [7, 4, hit(1), hit(1) + 1],
        [7, 2, 76, 77],
    ];
    assert_eq!(results, expected.concat());
}

#[test]
fn hit_objects_tell_what_they_hold() {
    let Some(gpu) = gpu() else { return };
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    layout(location = 0) hitObjectAttributeNV vec2 weights;
    void main() {
        hitObjectNV object;
        hitObjectTraceRayNV(object, world, 0u, 0xffu, 1u, 0u, 0u, vec3(11.5, 0.25, -1.0), 0.5, vec3(0, 0, 1), 9.0, 0);
        hitObjectGetAttributesNV(object, 0);
        vec3 origin = hitObjectGetObjectRayOriginNV(object), direction = hitObjectGetObjectRayDirectionNV(object);
        vec3 from = hitObjectGetWorldRayOriginNV(object), along = hitObjectGetWorldRayDirectionNV(object);
        mat4x3 out_of = hitObjectGetObjectToWorldNV(object), into = hitObjectGetWorldToObjectNV(object);
        float values[20] = float[](
            origin.x, origin.y, origin.z, direction.x, direction.y, direction.z,
            from.x, from.z, along.z, out_of[3].x, into[3].x, out_of[0].x,
            weights.x, weights.y, hitObjectGetRayTMinNV(object), hitObjectGetRayTMaxNV(object),
            float(hitObjectGetInstanceIdNV(object)), float(hitObjectGetGeometryIndexNV(object)), into[1].y, into[0].y);
        for (int i = 0; i < 20; i++)
            results[i] = floatBitsToUint(values[i]);
        results[20] = uint(hitObjectGetPrimitiveIndexNV(object));
        results[21] = uint(hitObjectGetInstanceCustomIndexNV(object));
        results[22] = hitObjectGetHitKindNV(object);
        results[23] = hitObjectGetShaderBindingTableRecordIndexNV(object);
    }";
    let results = trace(&gpu, raygen, [1, 1, 1], 24);
    let floats: Vec<f32> = results[..20].iter().map(|&w| f32::from_bits(w)).collect();
    let expected = [
        1.5, 0.25, -1.0, 0.0, 0.0, 1.0, 11.5, -1.0, 1.0, 10.0, -10.0, 1.0, 0.5, 0.25, 0.5, 2.0,
        0.0, 0.0, 1.0, 0.0,
    ];
    assert_eq!(floats, expected);
    assert_eq!(results[20..22], [1, 3]);
    assert!([0xfe, 0xff].contains(&results[22]));
    assert_eq!(results[23], 1);
}

#[test]
fn hits_and_misses_are_recorded_without_a_trace() {
    let Some(gpu) = gpu() else { return };
    let raygen = r"
    #extension GL_EXT_buffer_reference_uvec2 : enable
    layout(buffer_reference, scalar) buffer Name { uint name; };
    layout(location = 0) rayPayloadEXT uint payload;
    layout(location = 1) hitObjectAttributeNV vec2 weights;
    void main() {
        hitObjectNV objects[3];
        uint i = gl_LaunchIDEXT.x;
        weights = vec2(0.5, 0.0);
        hitObjectRecordHitNV(objects[0], world, 0, 1, 0, 0xfeu, 1u, 0u, vec3(0), 0.0, vec3(0, 0, 1), 4.0, 1);
        hitObjectRecordHitWithIndexNV(objects[1], world, 0, 0, 0, 0xfeu, 0u, vec3(0), 0.0, vec3(0, 0, 1), 3.0, 1);
        hitObjectRecordMissNV(objects[2], 1u, vec3(0), 0.0, vec3(0, 0, 1), 4.0);
        payload = 0u;
        hitObjectExecuteShaderNV(objects[i], 0);
        results[2u * i] = payload;
        results[2u * i + 1u] = Name(hitObjectGetShaderRecordBufferHandleNV(objects[i])).name;
    }";
    let results = trace(&gpu, raygen, [3, 1, 1], 6);
    let hit = |name: u32, primitive: u32, t: u32| {
        name + 1000 * (primitive + 30) + 4_000_000 + 10_000_000 * t
    };
    assert_eq!(results, [hit(2, 1, 4), 2, hit(1, 0, 3), 1, 6, 6]);
}

#[test]
fn recorded_hits_know_their_triangle() {
    // Some validation layers are older than position fetch.
    let gpu = Gpu::without_validation();
    let optional = &gpu.optional;
    let fetches = optional.position_fetch.ray_tracing_position_fetch;
    let there = optional.reorder.ray_tracing_invocation_reorder * fetches == vk::TRUE;
    if !has("hit objects and positions fetched", there) {
        return;
    }
    let corners: Vec<[f32; 3]> = (0..300u16)
        .map(|i| [f32::from(i), f32::from(i % 17), f32::from(i % 5)])
        .collect();
    let flags = vk::BuildAccelerationStructureFlagsKHR::ALLOW_DATA_ACCESS;
    let bottom = gpu.bottom_with(&[Geometry::opaque(&corners)], flags);
    let world = gpu.top(&[Instance::of(bottom)]);
    let output = gpu.buffer(4 * 100);
    let raygen = format!(
        "{HEAD}
        layout(location = 0) rayPayloadEXT float payload;
        layout(location = 1) hitObjectAttributeNV vec2 weights;
        void main() {{
            int i = int(gl_LaunchIDEXT.x);
            hitObjectNV object;
            weights = vec2(0.5);
            hitObjectRecordHitNV(object, world, 0, i, 0, 0xfeu, 0u, 0u, vec3(0), 0.0, vec3(0, 0, 1), 4.0, 1);
            hitObjectExecuteShaderNV(object, 0);
            results[i] = floatBitsToUint(payload);
        }}"
    );
    let hit = r"
        #extension GL_EXT_ray_tracing_position_fetch : enable
        layout(location = 0) rayPayloadInEXT float payload;
        void main() { payload = gl_HitTriangleVertexPositionsEXT[2].x; }
    ";
    let case = Case::new(&raygen).hit(hit).bind(world).bind(output);
    case.trace(&gpu, [100, 1, 1]);
    let found: Vec<f32> = output.read();
    let expected: Vec<f32> = (0..100u16).map(|i| f32::from(3 * i + 2)).collect();
    assert_eq!(found, expected);
}

#[test]
fn payloads_and_locals_survive_a_reordering() {
    let Some(gpu) = gpu() else { return };
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint i = gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x;
        uint state = i * 747796405u + 2891336453u;
        uint words[8];
        for (int k = 0; k < 8; k++)
            words[k] = state ^ uint(k);
        uint sum = 0u;
        for (int turn = 0; turn < 5; turn++) {
            state = state * 747796405u + 2891336453u;
            uint pick = state >> 28;
            hitObjectNV object;
            vec3 from = vec3(10.25 + float(pick % 3u), 0.25, 0.0);
            payload = pick;
            hitObjectTraceRayNV(object, world, 0u, 0xffu, pick & 1u, 0u, pick >> 1 & 1u, from, 0.0, vec3(0, 0, 1), 9.0, 0);
            if (turn == 1)
                reorderThreadNV(pick, 3u);
            else if (turn == 2)
                reorderThreadNV(object);
            else
                reorderThreadNV(object, pick >> 2, 2u);
            hitObjectExecuteShaderNV(object, 0);
            sum = sum * 31u + payload + words[pick & 7u];
            // Lanes that leave are parked, those that end are gone.
            if (turn == 3 && (i & 7u) == 2u)
                break;
            if (turn == 3 && (i & 31u) == 5u)
                return;
        }
        atomicAdd(results[i], sum);
    }";
    let (width, height) = (75, 37);
    let count = width * height;
    let results = trace(&gpu, raygen, [width, height, 1], count as usize);
    for i in 0..count {
        let step = |state: u32| state.wrapping_mul(747796405).wrapping_add(2891336453);
        let mut state = step(i);
        let first = state;
        let mut sum = 0u32;
        for turn in 0..5 {
            state = step(state);
            let pick = state >> 28;
            let payload = if pick % 3 < 2 {
                pick * 10 + (1 + (pick & 1)) + 1000 * (pick % 3 + 30) + 2_000_000 + 10_000_000
            } else {
                pick * 10 + 5 + (pick >> 1 & 1)
            };
            sum = (sum.wrapping_mul(31))
                .wrapping_add(payload)
                .wrapping_add(first ^ (pick & 7));
            if turn == 3 && i & 7 == 2 {
                break;
            }
            if turn == 3 && i & 31 == 5 {
                sum = 0;
                break;
            }
        }
        assert_eq!(results[i as usize], sum, "invocation {i}");
    }
}

#[test]
fn reordering_sorts_by_hint() {
    let Some(gpu) = gpu() else { return };
    let mut mode = vk::PhysicalDeviceRayTracingInvocationReorderPropertiesNV::default();
    let mut properties = vk::PhysicalDeviceProperties2 {
        p_next: (&raw mut mode).cast(),
        ..Default::default()
    };
    // SAFETY: the physical device is of this instance, the chain is one structure.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut properties);
    }
    let raygen = r"
    #extension GL_KHR_shader_subgroup_vote : enable
    #extension GL_KHR_shader_subgroup_ballot : enable
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint hint = (gl_LaunchIDEXT.x * 2654435761u) >> 30;
        bool before = subgroupAllEqual(hint);
        // Bits above the two that count differ in every lane.
        reorderThreadNV(hint | gl_LaunchIDEXT.x << 2, 2u);
        bool after = subgroupAllEqual(hint);
        atomicAdd(results[0], uint(before));
        atomicAdd(results[1], uint(after));
        atomicAdd(results[2], 1u);
        uint members = subgroupBallotBitCount(subgroupBallot(true));
        atomicMax(results[3], members);
        atomicAdd(results[4], uint(gl_SubgroupInvocationID < gl_SubgroupSize));
    }";
    let results = trace(&gpu, raygen, [4000, 1, 1], 5);
    assert_eq!(results[2], 4000);
    assert_eq!(results[4], 4000);
    assert_eq!(results[0], 0, "the hints differ in every subgroup at first");
    if mode.ray_tracing_invocation_reorder_reordering_hint
        == vk::RayTracingInvocationReorderModeNV::REORDER
    {
        assert!(results[1] > 3000, "{} of 4000 lanes are sorted", results[1]);
    }
}

/// Lanes leave a loop one after the other, and wait behind it while the others are sorted, turn by
/// turn.
#[test]
fn lanes_that_wait_stay_where_they_are() {
    let Some(gpu) = gpu() else { return };
    let raygen = r"
    #extension GL_KHR_shader_subgroup_vote : enable
    #extension GL_EXT_shader_explicit_arithmetic_types_int64 : enable
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint i = gl_LaunchIDEXT.x, sorted = 0u, met = 0u;
        uint64_t wide = uint64_t(i) * 0x300000007ul;
        double fraction = 1.0LF / double(i + 3u);
        for (uint turn = 0u; turn < 6u; turn++) {
            if ((i * 2654435761u >> 7) % 5u == turn)
                break;
            uint hint = (i * 2654435761u + turn * 77777777u) >> 30;
            if ((i & 3u) != turn) {
                reorderThreadNV(hint, 2u);
                sorted += uint(subgroupAllEqual(hint));
                met++;
            }
            wide = wide * 3ul + uint64_t(turn);
            fraction = fraction * 2.0LF + 1.0LF;
        }
        results[5u * i] = uint(wide);
        results[5u * i + 1u] = uint(wide >> 32);
        results[5u * i + 2u] = uint(fraction * 65536.0LF);
        results[5u * i + 3u] = met;
        atomicAdd(results[4u], sorted);
    }";
    if !has("64-bit numbers in shaders", {
        gpu.features.shader_int64 * gpu.features.shader_float64 == vk::TRUE
    }) {
        return;
    }
    let count = 3000;
    let results = trace(&gpu, raygen, [count, 1, 1], 5 * count as usize);
    let mut all_met = 0;
    for i in 0..count {
        let hash = i.wrapping_mul(2654435761);
        let mut wide = u64::from(i).wrapping_mul(0x3_0000_0007);
        let mut fraction = 1.0 / f64::from(i + 3);
        let mut met = 0;
        for turn in 0..6 {
            if (hash >> 7) % 5 == turn {
                break;
            }
            met += u32::from(i & 3 != turn);
            wide = wide.wrapping_mul(3).wrapping_add(turn.into());
            fraction = fraction * 2.0 + 1.0;
        }
        all_met += met;
        let found = &results[5 * i as usize..][..4];
        let expected = [
            wide as u32,
            (wide >> 32) as u32,
            (fraction * 65536.0) as u32,
            met,
        ];
        assert_eq!(found, expected, "invocation {i}");
    }
    if gpu.is_tuff() {
        assert!(results[4] * 4 > all_met * 3, "{} of {all_met}", results[4]);
    }
}

/// Lanes end one after the other, so that those which are left may be put together.
#[test]
fn wide_numbers_survive_the_end_of_neighbours() {
    let Some(gpu) = gpu() else { return };
    if !has(
        "64-bit integers in shaders",
        gpu.features.shader_int64 == vk::TRUE,
    ) {
        return;
    }
    let raygen = r"
    #extension GL_EXT_shader_explicit_arithmetic_types_int64 : enable
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        uint64_t wide = uint64_t(i) * 0x300000007ul;
        for (uint turn = 0u; ; turn++) {
            results[2u * i] = uint(wide);
            results[2u * i + 1u] = uint(wide >> 32);
            if ((i * 2654435761u >> 7) % 16u <= turn)
                return;
            traceRayEXT(world, 0u, 0xffu, 0u, 0u, 0u, vec3(0), 0.0, vec3(0, 0, 1), 9.0, 0);
            wide = wide * 3ul + uint64_t(turn);
        }
    }";
    let count = 3000;
    let results = trace(&gpu, raygen, [count, 1, 1], 2 * count as usize);
    for i in 0..count {
        let turns = (i.wrapping_mul(2654435761) >> 7) % 16;
        let wide = (0..turns).fold(u64::from(i).wrapping_mul(0x3_0000_0007), |wide, turn| {
            wide.wrapping_mul(3).wrapping_add(turn.into())
        });
        let found = &results[2 * i as usize..][..2];
        assert_eq!(found, [wide as u32, (wide >> 32) as u32], "invocation {i}");
    }
}
