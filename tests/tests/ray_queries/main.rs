//! Ray queries, in compute and in every ray tracing stage. Expectations follow from where the
//! geometry is.

mod decisions;

use tuff_tests::*;

const NEAREST: vk::GeometryFlagsKHR = vk::GeometryFlagsKHR::OPAQUE;
const ASKS: vk::GeometryFlagsKHR = vk::GeometryFlagsKHR::empty();

const HEAD: &str = r"
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) buffer Results { uint results[]; };
";

/// A triangle around the z axis at each height. Seen from below, along +z, it is a front face.
fn layers(heights: &[f32]) -> Vec<[f32; 3]> {
    heights
        .iter()
        .flat_map(|&z| [[-9.0, -9.0, z], [0.0, 9.0, z], [9.0, -9.0, z]])
        .collect()
}

/// Runs a compute shader over a scene; the words it leaves.
fn query(gpu: &Gpu, world: Structure, body: &str, groups: u32, words: usize) -> Vec<u32> {
    let results = gpu.buffer(4 * words as u64);
    results.write(0, &vec![0u32; words]);
    let bindings: [(u32, &[Bound]); 2] = [
        (0, &[Bound::Structure(world.handle)]),
        (1, &[Bound::Storage(results)]),
    ];
    gpu.compute_with(&format!("{HEAD}{body}"), &bindings, [groups, 1, 1]);
    results.read()
}

fn floats(words: &[u32]) -> Vec<f32> {
    words.iter().map(|&word| f32::from_bits(word)).collect()
}

/// Opens a device that has ray queries.
fn open() -> Option<Gpu> {
    Gpu::new().with("VK_KHR_ray_query", |gpu| {
        gpu.optional.ray_query.ray_query == vk::TRUE
    })
}

#[test]
fn getters_tell_all_about_a_committed_triangle() {
    let Some(gpu) = open() else { return };
    // The second primitive of the second geometry of the second instance is hit.
    let bottom = gpu.bottom(&[
        Geometry::opaque(&layers(&[50.0])),
        Geometry::opaque(&[layers(&[60.0]), layers(&[2.0])].concat()),
    ]);
    let far = Instance {
        transform: translated([0.0, 0.0, 500.0]),
        ..Instance::of(bottom)
    };
    let near = Instance {
        transform: scaled([2.0, 4.0, 0.5], [1.0, 0.0, 3.0]),
        custom_index: 0xABCDEF,
        table_offset: 0x123456,
        ..Instance::of(bottom)
    };
    let world = gpu.top(&[far, near]);
    let body = r"
    layout(local_size_x = 1) in;
    uint at = 0;
    void put(uint word) { results[at++] = word; }
    void put(float x) { put(floatBitsToUint(x)); }
    void put(vec3 v) { put(v.x); put(v.y); put(v.z); }
    void main() {
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, gl_RayFlagsCullBackFacingTrianglesEXT, 0xff,
            vec3(2.0, 4.0, 1.0), 0.25, vec3(0.0, 0.0, 0.5), 100.0);
        put(rayQueryGetIntersectionTypeEXT(q, true));
        put(uint(rayQueryProceedEXT(q)));
        put(uint(rayQueryProceedEXT(q)));
        put(rayQueryGetIntersectionTypeEXT(q, true));
        put(rayQueryGetRayTMinEXT(q));
        put(rayQueryGetRayFlagsEXT(q));
        put(rayQueryGetWorldRayOriginEXT(q));
        put(rayQueryGetWorldRayDirectionEXT(q));
        put(rayQueryGetIntersectionTEXT(q, true));
        put(uint(rayQueryGetIntersectionInstanceCustomIndexEXT(q, true)));
        put(uint(rayQueryGetIntersectionInstanceIdEXT(q, true)));
        put(rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(q, true));
        put(uint(rayQueryGetIntersectionGeometryIndexEXT(q, true)));
        put(uint(rayQueryGetIntersectionPrimitiveIndexEXT(q, true)));
        put(vec3(rayQueryGetIntersectionBarycentricsEXT(q, true), 0.0));
        put(uint(rayQueryGetIntersectionFrontFaceEXT(q, true)));
        put(rayQueryGetIntersectionObjectRayOriginEXT(q, true));
        put(rayQueryGetIntersectionObjectRayDirectionEXT(q, true));
        mat4x3 there = rayQueryGetIntersectionObjectToWorldEXT(q, true);
        for (int i = 0; i < 4; i++) put(there[i]);
        mat4x3 back = rayQueryGetIntersectionWorldToObjectEXT(q, true);
        for (int i = 0; i < 4; i++) put(back[i]);
    }";
    let words = query(&gpu, world, body, 1, 56);
    assert_eq!(words[..4], [0, 0, 0, 1]);
    assert_eq!(f32::from_bits(words[4]), 0.25);
    assert_eq!(words[5], 0x10);
    assert_eq!(floats(&words[6..12]), [2.0, 4.0, 1.0, 0.0, 0.0, 0.5]);
    // Height 3 + 0.5 * 2 in the world, 3 above the origin at half a unit per t.
    assert_eq!(f32::from_bits(words[12]), 6.0);
    assert_eq!(words[13..18], [0xABCDEF, 1, 0x123456, 1, 1]);
    // At (0.5, 1) of the corners (−9, −9), (0, 9), (9, −9).
    let (u, v) = (f32::from_bits(words[18]), f32::from_bits(words[19]));
    let hit = [-9.0 + 9.0 * u + 18.0 * v, -9.0 + 18.0 * u];
    assert!(
        (hit[0] - 0.5).abs() < 1e-5 && (hit[1] - 1.0).abs() < 1e-5,
        "{hit:?}"
    );
    assert_eq!(words[21], 1);
    assert_eq!(floats(&words[22..28]), [0.5, 1.0, -4.0, 0.0, 0.0, 1.0]);
    assert_eq!(
        floats(&words[28..40]),
        [2.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 3.0]
    );
    assert_eq!(
        floats(&words[40..52]),
        [
            0.5, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 2.0, -0.5, 0.0, -6.0
        ]
    );
}

#[test]
fn many_queries_live_side_by_side() {
    let Some(gpu) = open() else { return };
    let heights: Vec<f32> = (1..=7).map(|z| z as f32).collect();
    let world = gpu.scene(&[Geometry::triangles(&layers(&heights), ASKS)]);
    // An array of queries of different lengths, advanced in turns, in an order that differs by
    // invocation; inside, another query in a function.
    let body = r"
    layout(local_size_x = 40) in;
    rayQueryEXT outer[4];
    void begin(rayQueryEXT q, float reach) {
        rayQueryInitializeEXT(q, world, 0, 0xff, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), reach);
    }
    uint count_below(float reach) {
        rayQueryEXT inner;
        begin(inner, reach);
        uint count = 0;
        while (rayQueryProceedEXT(inner)) count++;
        return count;
    }
    void main() {
        uint i = gl_LocalInvocationIndex;
        for (uint k = 0; k < 4; k++) {
            rayQueryInitializeEXT(outer[k], world, 0, 0xff, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), float(k) + 1.5);
        }
        uint counts[4] = uint[4](0, 0, 0, 0);
        uint inside = 0;
        bool more = true;
        for (uint turn = 0; more; turn++) {
            more = false;
            for (uint k = 0; k < 4; k++) {
                uint which = (k + i + turn) % 4;
                if (rayQueryProceedEXT(outer[which])) {
                    more = true;
                    counts[which]++;
                    if (which == i % 4) {
                        rayQueryConfirmIntersectionEXT(outer[which]);
                        inside += count_below(rayQueryGetIntersectionTEXT(outer[which], true) + 0.5);
                    }
                }
            }
        }
        for (uint k = 0; k < 4; k++) {
            bool confirmed = rayQueryGetIntersectionTypeEXT(outer[k], true) == 1;
            uint count = counts[k];
            // Nothing farther than what was confirmed is asked for, in an order that is open.
            if (k == i % 4) count = confirmed && abs(rayQueryGetIntersectionTEXT(outer[k], true) - 1.0) < 1e-4 ? 100 : 999;
            else if (confirmed) count = 888;
            results[5 * i + k] = count;
        }
        results[5 * i + 4] = uint(inside >= 1 && inside <= 28);
    }";
    let words = query(&gpu, world, body, 1, 200);
    for (i, words) in words.chunks(5).enumerate() {
        let mut expected = [1, 2, 3, 4, 1];
        expected[i % 4] = 100;
        assert_eq!(words, expected, "invocation {i}");
    }
}

#[test]
fn waves_stay_together_around_queries() {
    let Some(gpu) = open() else { return };
    let heights: Vec<f32> = (1..=16).map(|z| z as f32).collect();
    let world = gpu.scene(&[Geometry::triangles(&layers(&heights), ASKS)]);
    // Invocations differ in their number of steps; what they count meets in shared memory and in
    // the subgroup.
    let body = r"
    #extension GL_KHR_shader_subgroup_arithmetic : enable
    layout(local_size_x = 64) in;
    shared uint sums[64];
    void main() {
        uint i = gl_LocalInvocationIndex;
        uint before = gl_SubgroupInvocationID;
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0, 0xff, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), float(i % 16) + 0.5);
        uint count = 0;
        while (rayQueryProceedEXT(q)) count++;
        uint together = subgroupAdd(1u);
        sums[i] = count;
        barrier();
        results[64 * gl_WorkGroupID.x + i] = sums[(i + 17) % 64]
            + 100 * uint(before == gl_SubgroupInvocationID)
            + 1000 * uint(together == gl_SubgroupSize);
    }";
    let words = query(&gpu, world, body, 5, 320);
    for (i, &word) in words.iter().enumerate() {
        let expected = 1100 + (i as u32 % 64 + 17) % 16;
        assert_eq!(word, expected, "invocation {i}");
    }
}

#[test]
fn random_rays_agree_with_a_computation() {
    let Some(gpu) = open() else { return };
    // Unit squares at random heights of a grid, each of two triangles, half of them not opaque and
    // confirmed by the shader.
    let mut random = Rng::with_seed(7);
    let cells = 16;
    let (mut solid, mut open) = (Vec::new(), Vec::new());
    let mut height = Vec::new();
    for y in 0..cells {
        for x in 0..cells {
            let z = between(&mut random, 1.0, 50.0).floor();
            height.push(z);
            let (x, y) = (x as f32, y as f32);
            let corner = |a: f32, b: f32| [x + a, y + b, z];
            let square = [
                corner(0.0, 0.0),
                corner(1.0, 0.0),
                corner(1.0, 1.0),
                corner(0.0, 0.0),
                corner(1.0, 1.0),
                corner(0.0, 1.0),
            ];
            if random.bool() { &mut solid } else { &mut open }.extend(square);
        }
    }
    let world = gpu.scene(&[
        Geometry::triangles(&solid, NEAREST),
        Geometry::triangles(&open, ASKS),
    ]);
    let body = r"
    layout(local_size_x = 64) in;
    void main() {
        uint i = gl_GlobalInvocationID.x;
        vec2 at = vec2(i % 64, i / 64) * 0.25 + vec2(0.1, 0.05);
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0, 0xff, vec3(at, 0.0), 0.0, vec3(0.0, 0.0, 2.0), 1000.0);
        while (rayQueryProceedEXT(q)) rayQueryConfirmIntersectionEXT(q);
        results[i] = rayQueryGetIntersectionTypeEXT(q, true) == 1
            ? floatBitsToUint(rayQueryGetIntersectionTEXT(q, true)) : 0;
    }";
    let count = 64 * 64;
    let words = query(&gpu, world, body, count / 64, count as usize);
    for (i, t) in floats(&words).into_iter().enumerate() {
        let cell = (i % 64) / 4 + cells * ((i / 64) / 4);
        let expected = height[cell] / 2.0;
        assert!(
            (t - expected).abs() <= 1e-6 * expected,
            "ray {i}: {t} for {expected}"
        );
    }
}

#[test]
fn positions_of_vertices_are_fetched() {
    let gpu = Gpu::without_validation();
    let fetches = gpu.optional.position_fetch.ray_tracing_position_fetch;
    let there = gpu.optional.ray_query.ray_query * fetches != 0;
    if !has("positions fetched in queries", there) {
        return;
    }
    let corners = [layers(&[7.0]), layers(&[5.0])].concat();
    let bottom = gpu.bottom_with(
        &[Geometry::triangles(&corners, ASKS)],
        vk::BuildAccelerationStructureFlagsKHR::ALLOW_DATA_ACCESS,
    );
    let world = gpu.top(&[Instance {
        transform: scaled([2.0; 3], [0.0; 3]),
        ..Instance::of(bottom)
    }]);
    let body = r"
    #extension GL_EXT_ray_tracing_position_fetch : enable
    layout(local_size_x = 1) in;
    void main() {
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0, 0xff, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 100.0);
        vec3 p[3];
        while (rayQueryProceedEXT(q)) {
            rayQueryGetIntersectionTriangleVertexPositionsEXT(q, false, p);
            uint first = rayQueryGetIntersectionPrimitiveIndexEXT(q, false) * 9;
            for (uint k = 0; k < 9; k++) results[first + k] = floatBitsToUint(p[k / 3][k % 3]);
            rayQueryConfirmIntersectionEXT(q);
        }
        rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, p);
        for (uint k = 0; k < 9; k++) results[18 + k] = floatBitsToUint(p[k / 3][k % 3]);
    }";
    let words = floats(&query(&gpu, world, body, 1, 27));
    let flat: Vec<f32> = corners.concat();
    // Whether the farther one was asked for depends on the order.
    assert!(
        words[..9] == flat[..9] || words[..9] == [0.0; 9],
        "{words:?}"
    );
    assert_eq!(words[9..18], flat[9..]);
    assert_eq!(words[18..], flat[9..]);
}

#[test]
fn structures_are_named_by_their_address() {
    let Some(gpu) = open() else { return };
    let worlds = [
        gpu.scene(&[Geometry::opaque(&layers(&[3.0]))]),
        gpu.scene(&[Geometry::opaque(&layers(&[8.0]))]),
    ];
    let body = r"
    layout(local_size_x = 20) in;
    layout(push_constant) uniform Push { uvec2 addresses[2]; };
    void main() {
        uint i = gl_LocalInvocationIndex;
        rayQueryEXT q;
        rayQueryInitializeEXT(q, accelerationStructureEXT(addresses[i % 2]), 0, 0xff,
            vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 100.0);
        rayQueryProceedEXT(q);
        results[i] = uint(rayQueryGetIntersectionTEXT(q, true) + 0.5);
    }";
    let results = gpu.buffer(80);
    let set = gpu.set_of(&[worlds[0].into(), results.into()]);
    let kernel = gpu.kernel(&format!("{HEAD}{body}"), &[set.layout]);
    gpu.dispatch(
        kernel,
        &[set],
        &worlds.map(|world| world.address),
        [1, 1, 1],
    );
    let words: Vec<u32> = results.read();
    for (i, word) in words.into_iter().enumerate() {
        assert_eq!(word, [3, 8][i % 2], "invocation {i}");
    }
}

/// A function for any stage: how far the first layer beyond `z` is, layers above `z + 3.5` left
/// out, confirmed by hand.
const LOOK: &str = r"
uint look(float z) {
    rayQueryEXT q;
    rayQueryInitializeEXT(q, world, gl_RayFlagsNoOpaqueEXT, 0x0f, vec3(0.0, 0.0, z), 0.0, vec3(0.0, 0.0, 1.0), 3.5);
    uint count = 0;
    while (rayQueryProceedEXT(q)) {
        count++;
        if (rayQueryGetIntersectionTypeEXT(q, false) == 0) rayQueryConfirmIntersectionEXT(q);
    }
    return rayQueryGetIntersectionTypeEXT(q, true) == 0 ? 0
        : uint(4.0 * rayQueryGetIntersectionTEXT(q, true) + 0.5) + uint(count > 0 ? 1000 : 0);
}
";

#[test]
fn every_ray_tracing_stage_asks() {
    let Some(gpu) = open() else { return };
    let heights: Vec<f32> = (1..=64).map(|z| z as f32).collect();
    let floor = gpu.bottom(&[Geometry::opaque(&layers(&heights))]);
    // Geometry that the pipeline's rays hit and queries do not see: a non-opaque triangle, and a
    // box beside it.
    let wall = gpu.bottom(&[Geometry::triangles(
        &[[100.0, -9.0, 5.0], [109.0, -9.0, 5.0], [100.0, 9.0, 5.0]],
        ASKS,
    )]);
    let cube = gpu.bottom(&[Geometry::boxes(
        &[[200.0, -1.0, 4.0, 202.0, 1.0, 6.0]],
        ASKS,
    )]);
    let special = |structure, table_offset| Instance {
        mask: 0xf0,
        table_offset,
        ..Instance::of(structure)
    };
    let world = gpu.top(&[
        Instance {
            mask: 0x0f,
            ..Instance::of(floor)
        },
        special(wall, 0),
        special(cube, 1),
    ]);
    let with = |body: &str| format!("{HEAD}{LOOK}{body}");
    let raygen = with(
        r"
    layout(location = 0) rayPayloadEXT uint payload[2];
    layout(location = 1) callableDataEXT uint data;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        // Before, between and after: the query of this invocation stays where it is.
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, gl_RayFlagsNoOpaqueEXT, 0x0f, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 4.5);
        bool first = rayQueryProceedEXT(q);
        payload[0] = i;
        payload[1] = 0;
        vec3 origin = i % 4 == 0 ? vec3(101.0, 0.0, 0.0) : i % 4 == 1 ? vec3(201.0, 0.0, 0.0) : vec3(300.0, 0.0, 0.0);
        traceRayEXT(world, 0, 0xf0, 0, 0, 0, origin, 0.0, vec3(0.0, 0.0, 1.0), 100.0, 0);
        data = i;
        executeCallableEXT(0, 1);
        uint count = first ? 1 : 0;
        while (rayQueryProceedEXT(q)) count++;
        results[4 * i] = look(float(i % 50) + 0.25);
        results[4 * i + 1] = payload[1];
        results[4 * i + 2] = data;
        results[4 * i + 3] = count;
    }",
    );
    let closest = with(
        r"
    layout(location = 0) rayPayloadInEXT uint payload[2];
    hitAttributeEXT uint found;
    void main() { payload[1] += 10000 * look(float(payload[0] % 50) + 0.5); }",
    );
    let closest_box = with(
        r"
    layout(location = 0) rayPayloadInEXT uint payload[2];
    hitAttributeEXT uint found;
    void main() { payload[1] += found + 10000 * look(float(payload[0] % 50) + 0.5); }",
    );
    let any = with(
        r"
    layout(location = 0) rayPayloadInEXT uint payload[2];
    void main() {
        payload[1] = look(float(payload[0] % 50) + 0.75);
        if (payload[0] % 8 == 0) ignoreIntersectionEXT;
    }",
    );
    let intersection = with(
        r"
    hitAttributeEXT uint found;
    void main() {
        found = look(float(gl_LaunchIDEXT.x % 50) + 0.25);
        reportIntersectionEXT(float(4.5), 0);
    }",
    );
    let miss = with(
        r"
    layout(location = 0) rayPayloadInEXT uint payload[2];
    void main() { payload[1] += 7 + look(float(payload[0] % 50) + 0.75); }",
    );
    let callable = with(
        r"
    layout(location = 1) callableDataInEXT uint data;
    void main() { data = look(float(data % 50) + 0.5) + 5; }",
    );
    let count = 100u32;
    let results = gpu.buffer(16 * u64::from(count));
    let case = Case::new(&raygen)
        .miss(&miss)
        .hit(&closest)
        .any_hit(&any)
        .hit(&closest_box)
        .intersection(&intersection)
        .callable(&callable)
        .bind(world)
        .bind(results);
    case.trace(&gpu, [count, 1, 1]);
    let words: Vec<u32> = results.read();
    // From z, the next layer is at the next integer above 0: three quarters, a half, or a quarter
    // away.
    let (quarter, half, three) = (1003, 1002, 1001);
    for (i, words) in words.chunks(4).enumerate() {
        let by_ray = match i % 8 {
            // Ignored by the any-hit shader, so it misses.
            0 => three + 7 + three,
            4 => three + 10000 * half,
            1 | 5 => quarter + 10000 * half,
            _ => 7 + three,
        };
        assert_eq!(words, [quarter, by_ray, half + 5, 4], "launch {i}");
    }
}
