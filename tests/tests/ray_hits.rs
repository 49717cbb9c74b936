//! Which hits count: opacity, any-hit and intersection shaders, and where the search ends.

use tuff_tests::*;

#[test]
fn opacity_is_decided_by_geometry_instance_and_ray() {
    const OPAQUE: u32 = 1;
    const NO_OPAQUE: u32 = 2;
    const CULL_OPAQUE: u32 = 0x40;
    const CULL_NO_OPAQUE: u32 = 0x80;
    use vk::GeometryInstanceFlagsKHR as Instanced;
    let gpu = Gpu::new();
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint flags[5] = uint[](0u, 1u, 2u, 0x40u, 0x80u);
        payload = 0u;
        traceRayEXT(world, flags[gl_LaunchIDEXT.x], 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, 1), 10.0, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let any = "layout(location = 0) rayPayloadInEXT uint payload; void main() { payload += 100u; }";
    let closest =
        "layout(location = 0) rayPayloadInEXT uint payload; void main() { payload += 1u; }";
    for geometry in [vk::GeometryFlagsKHR::empty(), vk::GeometryFlagsKHR::OPAQUE] {
        let bottom = gpu.bottom(&[Geometry::triangles(&layers(1), geometry)]);
        for instance in [
            Instanced::empty(),
            Instanced::FORCE_OPAQUE,
            Instanced::FORCE_NO_OPAQUE,
        ] {
            let world = gpu.top(&[Instance {
                flags: instance,
                ..Instance::of(bottom)
            }]);
            let results =
                Case::with_words(raygen)
                    .hit(closest)
                    .any_hit(any)
                    .words(&gpu, world, [5, 1, 1], 5);
            for (flags, result) in [0, OPAQUE, NO_OPAQUE, CULL_OPAQUE, CULL_NO_OPAQUE]
                .into_iter()
                .zip(results)
            {
                let mut opaque = geometry.contains(vk::GeometryFlagsKHR::OPAQUE);
                opaque |= instance.contains(Instanced::FORCE_OPAQUE);
                opaque &= !instance.contains(Instanced::FORCE_NO_OPAQUE);
                opaque |= flags == OPAQUE;
                opaque &= flags != NO_OPAQUE;
                let expected = match (opaque, flags) {
                    (true, CULL_OPAQUE) | (false, CULL_NO_OPAQUE) => u32::MAX,
                    (true, _) => 1,
                    (false, _) => 101,
                };
                assert_eq!(result, expected, "{geometry:?} {instance:?} {flags:#x}");
            }
        }
    }
}

#[test]
fn any_hit_shaders_ignore_and_end_the_search() {
    let gpu = Gpu::new();
    let flags = vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION;
    let world = gpu.scene(&[Geometry::triangles(&layers(12), flags)]);
    let any = r"
    layout(location = 0) rayPayloadInEXT uint payload[3]; // ignore below, end at, count
    void main() {
        payload[2] += 1u;
        if (gl_PrimitiveID < payload[0]) { ignoreIntersectionEXT; }
        if (gl_PrimitiveID == payload[1]) { terminateRayEXT; }
        payload[2] += 10000u; // ending the invocation skips this
    }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload[3];
    void main() { payload[0] = gl_PrimitiveID; }";
    let miss = r"
    layout(location = 0) rayPayloadInEXT uint payload[3];
    void main() { payload[0] = 77u; }";
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload[3];
    void main() {
        uint i = gl_LaunchIDEXT.x;
        payload = uint[](i % 14u, 99u, 0u);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, 1), 100.0, 0);
        results[2u * i] = payload[0];
        results[2u * i + 1u] = payload[2];
    }";
    let output = gpu.buffer(8 * 140);
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let case = Case::new(&raygen)
        .miss(miss)
        .hit(closest)
        .any_hit(any)
        .bind(world)
        .bind(output);
    case.trace(&gpu, [140, 1, 1]);
    for (i, result) in output.read::<[u32; 2]>().into_iter().enumerate() {
        let below = i as u32 % 14;
        assert_eq!(result[0], if below < 12 { below } else { 77 }, "ray {i}");
        // Each triangle in front of the hit is asked exactly once; those behind may be.
        let (asked, kept) = (result[1] % 10000, result[1] / 10000);
        assert!(
            asked >= (below + 1).min(12) && asked <= 12,
            "ray {i}: {asked}"
        );
        assert!(
            kept == asked.saturating_sub(below),
            "ray {i}: {asked} {kept}"
        );
    }
}

#[test]
fn ending_the_search_keeps_the_hit_that_ended_it() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::triangles(
        &layers(12),
        vk::GeometryFlagsKHR::empty(),
    )]);
    let any = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    void main() {
        if (gl_PrimitiveID != payload) { ignoreIntersectionEXT; }
        terminateRayEXT;
    }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    void main() { payload = 1000u * payload + gl_PrimitiveID; }";
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = gl_LaunchIDEXT.x;
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, 1), 100.0, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let results =
        Case::with_words(raygen)
            .hit(closest)
            .any_hit(any)
            .words(&gpu, world, [12, 1, 1], 12);
    let expected: Vec<u32> = (0..12).map(|i| 1001 * i).collect();
    assert_eq!(results, expected);
}

#[test]
fn rays_may_end_at_the_first_hit_and_skip_the_closest_hit_shader() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(3))]);
    let closest =
        "layout(location = 0) rayPayloadInEXT uint payload; void main() { payload = 5u; }";
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint flags[4] = uint[](0u, 4u, 8u, 12u);
        float ends[2] = float[](100.0, 0.5);
        payload = 1u;
        uvec3 id = gl_LaunchIDEXT;
        traceRayEXT(world, flags[id.x], 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, 1), ends[id.y], 0);
        results[id.y * 4u + id.x] = payload;
    }";
    let results = Case::with_words(raygen)
        .hit(closest)
        .words(&gpu, world, [4, 2, 1], 8);
    let missed = u32::MAX;
    assert_eq!(results, [5, 5, 1, 1, missed, missed, missed, missed]);
}

#[test]
fn intersection_shaders_report_what_is_kept() {
    let gpu = Gpu::new();
    let boxes: Vec<[f32; 6]> = (0..3)
        .map(|i| {
            let z = 10.0 * i as f32;
            [-1.0, -1.0, z + 1.0, 1.0, 1.0, z + 9.0]
        })
        .collect();
    let world = gpu.scene(&[Geometry::boxes(&boxes, vk::GeometryFlagsKHR::empty())]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uvec4 payload; // case, t, kind and attribute, answers
    void main() {
        uint i = gl_LaunchIDEXT.x;
        payload = uvec4(i, 0u, 0u, 0u);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 2.0, vec3(0, 0, 1), 25.0, 0);
        results[4u * i] = payload.x;
        results[4u * i + 1u] = payload.y;
        results[4u * i + 2u] = payload.z;
        results[4u * i + 3u] = payload.w;
    }";
    // Case 0: too near, then fine. 1: too far only. 2: the nearer of two, the farther first.
    // 3: the any-hit shader refuses kind 99. 4: nothing.
    let intersection = r"
    layout(set = 0, binding = 2, std430) buffer Cases { uint cases[]; };
    hitAttributeEXT uvec2 extra;
    void main() {
        float z = 10.0 * float(gl_PrimitiveID);
        uint which = gl_LaunchIDEXT.x;
        extra = uvec2(gl_PrimitiveID, which);
        if (which == 0u) {
            bool early = reportIntersectionEXT(1.5, 3u);
            extra.y = early ? 1u : 50u;
            reportIntersectionEXT(z + 4.0, 4u);
        } else if (which == 1u) {
            reportIntersectionEXT(25.5, 5u);
        } else if (which == 2u) {
            extra.y = 60u;
            bool far = reportIntersectionEXT(z + 8.0, 6u);
            extra.y = far ? 61u : 62u;
            bool near = reportIntersectionEXT(z + 3.0, 7u);
            extra.y = 63u;
            reportIntersectionEXT(z + 5.0, 8u);
        } else if (which == 3u) {
            bool refused = reportIntersectionEXT(z + 3.0, 99u);
            extra.y = refused ? 70u : 71u;
            reportIntersectionEXT(z + 4.0, 9u);
        }
    }";
    let any = r"
    layout(location = 0) rayPayloadInEXT uvec4 payload;
    hitAttributeEXT uvec2 extra;
    void main() { if (gl_HitKindEXT == 99u) ignoreIntersectionEXT; }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uvec4 payload;
    hitAttributeEXT uvec2 extra;
    void main() {
        payload.y = floatBitsToUint(gl_HitTEXT);
        payload.z = gl_HitKindEXT;
        payload.w = extra.x * 1000u + extra.y;
    }";
    let miss =
        "layout(location = 0) rayPayloadInEXT uvec4 payload; void main() { payload.y = 1u; }";
    let output = gpu.buffer(16 * 5);
    let cases = gpu.buffer(64);
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let case = Case::new(&raygen)
        .miss(miss)
        .hit(closest)
        .intersection(intersection)
        .any_hit(any)
        .bind(world)
        .bind(output)
        .bind(cases);
    case.trace(&gpu, [5, 1, 1]);
    let t = |t: f32| t.to_bits();
    let why = "a reported hit that is too far away overwrites the attributes of the nearer one";
    unless_known(&gpu, "llvmpipe", why, || {
        let near = [0, t(4.0), 4, 50];
        let nearest = [2, t(3.0), 7, 61];
        let unrefused = [3, t(4.0), 9, 71];
        let expected = [near, [1, 1, 0, 0], nearest, unrefused, [4, 1, 0, 0]];
        assert_eq!(output.read::<[u32; 4]>(), expected);
    });
}

/// Sixteen and more rays that go the same way meet triangles of which shaders decide, and others
/// that are not opaque either but whose group has no any-hit shader, so that they count.
#[test]
fn triangles_without_an_any_hit_shader_count_beside_others() {
    const SIDE: u32 = 32;
    let gpu = Gpu::new();
    let through = gpu.bottom(&[Geometry::triangles(
        &layers(3),
        vk::GeometryFlagsKHR::empty(),
    )]);
    let far = gpu.bottom(&[Geometry::triangles(
        &layers(6),
        vk::GeometryFlagsKHR::empty(),
    )]);
    // The second group's triangles come after those that the first group's shader lets rays
    // through.
    let beyond = Instance {
        transform: translated([0.0, 0.0, 20.0]),
        table_offset: 1,
        ..Instance::of(far)
    };
    let world = gpu.top(&[Instance::of(through), beyond]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 0u;
        vec3 from = vec3(1.0 + (vec2(gl_LaunchIDEXT.xy) + 0.5) * 1e-3, 0.0);
        traceRayEXT(world, 0, 0xff, 0, 0, 0, from, 0.0, vec3(-0.02, -0.03, 1), 100.0, 0);
        results[gl_LaunchIDEXT.y * 32u + gl_LaunchIDEXT.x] = payload;
    }";
    let ignore = "void main() { ignoreIntersectionEXT; }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    void main() { payload = 100u * uint(gl_InstanceID) + uint(gl_PrimitiveID) + 1u; }";
    let case = Case::with_words(raygen)
        .hit(closest)
        .any_hit(ignore)
        .hit(closest);
    let results = case.words(&gpu, world, [SIDE, SIDE, 1], (SIDE * SIDE) as usize);
    assert_eq!(results, vec![101; (SIDE * SIDE) as usize]);
}

/// Rays side by side that go the same way, each with decisions of its own about the same layers:
/// one rank after the other is ignored, or ends the search, by an any-hit shader that keeps count
/// in the payload. Layers are triangles, or boxes whose hits are reported.
#[test]
fn neighbours_decide_each_for_itself() {
    const SIDE: u32 = 24;
    const LAYERS: u32 = 8;
    let gpu = Gpu::new();
    let flags = vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION;
    let boxes: Vec<[f32; 6]> = (1..=LAYERS)
        .map(|z| [-9.0, -9.0, z as f32 - 0.3, 9.0, 9.0, z as f32 + 0.3])
        .collect();
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload[4]; // ignore below, end at, count, answer
    void main() {
        uvec2 at = gl_LaunchIDEXT.xy;
        payload = uint[](at.x % 7u, at.y % 3u == 0u ? at.x % 7u : 99u, 0u, 0u);
        vec3 from = vec3(1.0 + vec2(at) * 1e-3, 0.0);
        traceRayEXT(world, 0, 0xff, 0, 0, 0, from, 0.0, vec3(-0.02, -0.03, 1), 100.0, 0);
        uint place = 2u * (at.y * 24u + at.x);
        results[place] = payload[3];
        results[place + 1u] = payload[2];
    }";
    let any = r"
    layout(location = 0) rayPayloadInEXT uint payload[4];
    void main() {
        payload[2] += 1u;
        if (gl_PrimitiveID < payload[0]) { ignoreIntersectionEXT; }
        if (gl_PrimitiveID == payload[1]) { terminateRayEXT; }
    }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload[4];
    void main() { payload[3] = 100u * uint(round(gl_HitTEXT)) + gl_PrimitiveID; }";
    let intersection = r"
    hitAttributeEXT uint extra;
    void main() {
        extra = gl_PrimitiveID;
        reportIntersectionEXT(float(gl_PrimitiveID) + 1.0, 5u);
    }";
    for is_boxes in [false, true] {
        let geometry = match is_boxes {
            true => Geometry::boxes(&boxes, flags),
            false => Geometry::triangles(&layers(LAYERS), flags),
        };
        let mut case = Case::with_words(raygen).hit(closest).any_hit(any);
        if is_boxes {
            case = case.intersection(intersection);
        }
        let world = gpu.scene(&[geometry]);
        let results = case.words(&gpu, world, [SIDE, SIDE, 1], (2 * SIDE * SIDE) as usize);
        for (place, answer) in results.chunks(2).enumerate() {
            let first = place as u32 % SIDE % 7;
            assert_eq!(
                answer[0],
                100 * (first + 1) + first,
                "{place}, boxes: {is_boxes}"
            );
            // All that are nearer have a say, unless the search ends before; those beyond may have.
            let ends = (place as u32 / SIDE).is_multiple_of(3);
            let met = if ends { 1 } else { first + 1 }..=LAYERS;
            assert!(met.contains(&answer[1]), "{place}: {} layers", answer[1]);
        }
    }
}
