//! Ray shaders run once each, and their payloads and values survive traces.

use tuff_tests::*;

#[test]
fn every_invocation_runs_once_with_its_id() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    for size in [[1, 1, 1], [7, 5, 3], [130, 1, 2], [1, 3, 65]] {
        let count = size.iter().product::<u32>() as usize;
        let raygen = r"
        void main() {
            uvec3 id = gl_LaunchIDEXT, size = gl_LaunchSizeEXT;
            uint i = (id.z * size.y + id.y) * size.x + id.x;
            atomicAdd(results[i], 1000000u + size.x + 1000u * (size.y + size.z));
        }";
        let results = Case::with_words(raygen).words(&gpu, world, size, count);
        let expected = 1_000_000 + size[0] + 1000 * (size[1] + size[2]);
        assert!(results.iter().all(|word| *word == expected), "{size:?}");
    }
}

#[test]
fn closest_hit_shaders_trace_rays_to_the_allowed_depth() {
    let gpu = Gpu::new();
    let depth = gpu.pipeline_properties.max_ray_recursion_depth.min(6);
    if !has("recursion", depth >= 2) {
        return;
    }
    let world = gpu.scene(&[Geometry::opaque(&layers(8))]);
    // A ray that hits layer k goes on from there until `left` is used up; each level keeps a
    // value of its own across the call.
    let raygen = r"
    layout(location = 0) rayPayloadEXT uvec2 payload; // left, sum
    void main() {
        uint i = gl_LaunchIDEXT.x;
        payload = uvec2(i % results.length(), 0u);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, 1), 100.0, 0);
        results[i] = payload.y;
    }";
    let closest = format!(
        "{WORLD}
        layout(location = 0) rayPayloadInEXT uvec2 payload;
        layout(location = 1) rayPayloadEXT uvec2 inner;
        void main() {{
            uint own = (uint(gl_PrimitiveID) + 1u) * (payload.x + 1u);
            uint sum = own;
            if (payload.x > 0u) {{
                inner = uvec2(payload.x - 1u, 0u);
                vec3 origin = gl_WorldRayOriginEXT + gl_HitTEXT * gl_WorldRayDirectionEXT;
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.5, gl_WorldRayDirectionEXT, 100.0, 1);
                sum = own + 3u * inner.y;
            }}
            payload.y = sum;
        }}"
    );
    let output = gpu.buffer(4 * u64::from(depth));
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let miss =
        "layout(location = 0) rayPayloadInEXT uvec2 payload; void main() { payload.y = 1u; }";
    let case = Case::new(&raygen)
        .miss(miss)
        .hit(&closest)
        .recursion(depth)
        .bind(world)
        .bind(output);
    case.trace(&gpu, [depth, 1, 1]);
    fn expected(layer: u32, left: u32) -> u32 {
        let own = (layer + 1) * (left + 1);
        if left == 0 {
            own
        } else {
            own + 3 * expected(layer + 1, left - 1)
        }
    }
    let all: Vec<u32> = (0..depth).map(|left| expected(0, left)).collect();
    assert_eq!(output.read::<u32>(), all);
}

#[test]
fn values_live_across_traces_in_loops_and_branches() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(9))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        uint kept[4] = uint[](i, i * i, 3u, 5u);
        float step = 0.0;
        uint sum = 0u;
        for (uint k = 0u; k < i % 7u; k++) {
            if ((i + k) % 3u == 0u) {
                step += 1.0;
                continue;
            }
            payload = 0u;
            traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, step), 0.0, vec3(0, 0, 1), 100.0, 0);
            kept[k % 4u] += payload;
            if (payload == 6u) {
                break;
            }
            sum += k * payload;
            step += 0.9;
        }
        results[i] = sum + kept[0] + 7u * kept[1] + 11u * kept[2] + 13u * kept[3];
    }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    void main() { payload = uint(gl_PrimitiveID) + 1u; }";
    let results = Case::with_words(raygen)
        .hit(closest)
        .words(&gpu, world, [300, 1, 1], 300);
    for i in 0..300u32 {
        let mut kept = [i, i * i, 3, 5];
        let (mut step, mut sum) = (0.0f32, 0);
        for k in 0..i % 7 {
            if (i + k) % 3 == 0 {
                step += 1.0;
                continue;
            }
            let payload = (1..=9u32)
                .find(|z| *z as f32 > step)
                .expect("there is a layer ahead");
            kept[k as usize % 4] += payload;
            if payload == 6 {
                break;
            }
            sum += k * payload;
            step += 0.9;
        }
        let expected = sum + kept[0] + 7 * kept[1] + 11 * kept[2] + 13 * kept[3];
        assert_eq!(results[i as usize], expected, "invocation {i}");
    }
}

#[test]
fn payloads_of_many_sizes_come_back() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    for words in [1u32, 2, 3, 5, 8, 17, 40, 64] {
        let raygen = format!(
            "layout(location = 0) rayPayloadEXT uint payload[{words}];
            void main() {{
                uint i = gl_LaunchIDEXT.x;
                for (uint k = 0u; k < {words}u; k++) payload[k] = i * 1000u + k;
                vec3 direction = vec3(0, 0, i % 2u == 0u ? 1 : -1);
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, direction, 10.0, 0);
                for (uint k = 0u; k < {words}u; k++) results[i * {words}u + k] = payload[k];
            }}"
        );
        let touch = |add: u32| {
            format!(
                "layout(location = 0) rayPayloadInEXT uint payload[{words}];
                void main() {{ for (uint k = 0u; k < {words}u; k += 2u) payload[k] += {add}u; }}"
            )
        };
        let (closest, miss) = (touch(1_000_000), touch(2_000_000));
        let output = gpu.buffer(4 * 70 * u64::from(words));
        let raygen = format!("{WORLD}{RESULTS}{raygen}");
        let case = Case::new(&raygen)
            .miss(&miss)
            .hit(&closest)
            .bind(world)
            .bind(output);
        case.trace(&gpu, [70, 1, 1]);
        for (i, got) in output.read::<u32>().chunks(words as usize).enumerate() {
            for (k, word) in got.iter().enumerate() {
                let add = if k % 2 == 0 {
                    1_000_000 * (1 + i as u32 % 2)
                } else {
                    0
                };
                assert_eq!(
                    *word,
                    i as u32 * 1000 + k as u32 + add,
                    "{words} words, ray {i}"
                );
            }
        }
    }
}

#[test]
fn several_rays_use_several_payloads_and_miss_shaders() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint a;
    layout(location = 1) rayPayloadEXT vec3 b;
    struct Deep { dvec2 d; uint u; float f[3]; };
    layout(location = 2) rayPayloadEXT Deep c;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        a = 1u; b = vec3(2.0); c = Deep(dvec2(3.0, 4.0), 5u, float[](6.0, 7.0, 8.0));
        vec3 away = vec3(0, 0, -1);
        traceRayEXT(world, 0u, 0xff, 0, 0, 1, vec3(0), 0.0, away, 10.0, 1);
        if (i % 2u == 1u) traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, away, 10.0, 0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 2, vec3(0), 0.0, away, 10.0, 2);
        results[3u * i] = a;
        results[3u * i + 1u] = uint(b.x + 10.0 * b.y + 100.0 * b.z);
        results[3u * i + 2u] = uint(c.d.x + 10.0 * c.d.y) + 1000u * c.u + uint(100000.0 * c.f[2]);
    }";
    let first = "layout(location = 0) rayPayloadInEXT uint a; void main() { a += 50u; }";
    let second =
        "layout(location = 1) rayPayloadInEXT vec3 b; void main() { b = b.zyx + vec3(1, 2, 3); }";
    let third = r"
    struct Deep { dvec2 d; uint u; float f[3]; };
    layout(location = 2) rayPayloadInEXT Deep c;
    void main() { c.d = c.d.yx; c.u *= 2u; c.f[2] = c.f[0] + c.f[1]; }";
    if !has("doubles", gpu.features.shader_float64 != 0) {
        return;
    }
    let output = gpu.buffer(12 * 40);
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let case = Case::new(&raygen)
        .miss(first)
        .miss(second)
        .miss(third)
        .bind(world)
        .bind(output);
    case.trace(&gpu, [40, 1, 1]);
    for (i, got) in output.read::<[u32; 3]>().into_iter().enumerate() {
        let first = if i % 2 == 1 { 51 } else { 1 };
        assert_eq!(
            got,
            [first, 3 + 40 + 500, 34 + 10_000 + 1_300_000],
            "invocation {i}"
        );
    }
}

#[test]
fn indirect_traces_read_their_size_from_memory() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let output = gpu.buffer(4 * 100);
    let raygen = format!(
        "{WORLD}{RESULTS}
        void main() {{ results[gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x] = 7u; }}"
    );
    let case = Case::new(&raygen).bind(world).bind(output);
    let rays = gpu.rays(&case);
    let regions = gpu.regions(&rays, &case.table());
    let size = gpu.buffer_with(&[11u32, 8, 1]);
    gpu.run(|commands| {
        gpu.bind_rays(commands, &rays);
        // SAFETY: the buffers live as long as the device.
        unsafe {
            gpu.ray_tracing.cmd_trace_rays_indirect(
                commands,
                &regions[0],
                &regions[1],
                &regions[2],
                &regions[3],
                size.address,
            );
        }
    });
    let expected: Vec<u32> = (0..100).map(|i| if i < 88 { 7 } else { 0 }).collect();
    assert_eq!(output.read::<u32>(), expected);
}

#[test]
fn hit_shaders_know_the_ray_and_the_instance() {
    let gpu = Gpu::new();
    let bottom = gpu.bottom(&[Geometry::opaque(&layers(2))]);
    let transform = [2.0, 0.5, 0.0, 1.0, 0.0, 1.0, 0.25, 2.0, 0.0, 0.0, 4.0, 3.0];
    let world = gpu.top(&[
        Instance {
            transform: translated([100.0, 0.0, 0.0]),
            ..Instance::of(bottom)
        },
        Instance {
            transform,
            custom_index: 0x0012_3456,
            ..Instance::of(bottom)
        },
    ]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        traceRayEXT(world, 1u, 0x3c, 0, 0, 0, vec3(1.5, 2.5, 0.5), 0.25, vec3(0.125, 0.0, 2.0), 77.0, 0);
    }";
    let closest = format!(
        "{RESULTS}
        layout(location = 0) rayPayloadInEXT uint payload;
        void put(uint i, float f) {{ results[i] = floatBitsToUint(f); }}
        void main() {{
            for (uint k = 0u; k < 3u; k++) {{
                put(k, gl_WorldRayOriginEXT[k]);
                put(3u + k, gl_WorldRayDirectionEXT[k]);
                put(6u + k, gl_ObjectRayOriginEXT[k]);
                put(9u + k, gl_ObjectRayDirectionEXT[k]);
            }}
            for (uint c = 0u; c < 4u; c++) {{
                for (uint r = 0u; r < 3u; r++) {{
                    put(12u + 3u * c + r, gl_ObjectToWorldEXT[c][r]);
                    put(24u + 3u * c + r, gl_WorldToObjectEXT[c][r]);
                    put(36u + 3u * c + r, gl_ObjectToWorld3x4EXT[r][c]);
                }}
            }}
            put(48u, gl_RayTminEXT);
            put(49u, gl_RayTmaxEXT);
            put(50u, gl_HitTEXT);
            results[51] = gl_InstanceID;
            results[52] = gl_InstanceCustomIndexEXT;
            results[53] = gl_PrimitiveID;
            results[54] = gl_GeometryIndexEXT;
            results[55] = gl_IncomingRayFlagsEXT;
        }}"
    );
    let results = Case::with_words(raygen)
        .hit(&closest)
        .words(&gpu, world, [1, 1, 1], 56);
    let close = |i: usize, expected: f64| {
        let got = f64::from(f32::from_bits(results[i]));
        assert!(
            (got - expected).abs() < 1e-5 * expected.abs().max(1.0),
            "{i}: {got}, {expected}"
        );
    };
    let m = |row: usize, column: usize| f64::from(transform[4 * row + column]);
    // The inverse of the matrix's left 3 × 3 by cofactors.
    let minor = |r: usize, c: usize| {
        let (r0, r1, c0, c1) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m(r0, c0) * m(r1, c1) - m(r0, c1) * m(r1, c0)
    };
    let determinant: f64 = (0..3).map(|c| m(0, c) * minor(0, c)).sum();
    let inverse = |r: usize, c: usize| minor(c, r) / determinant;
    let moved = |r: usize| -(0..3).map(|k| inverse(r, k) * m(k, 3)).sum::<f64>();
    let (origin, direction) = ([1.5, 2.5, 0.5], [0.125, 0.0, 2.0]);
    for r in 0..3 {
        close(r, origin[r]);
        close(3 + r, direction[r]);
        close(
            6 + r,
            (0..3).map(|k| inverse(r, k) * origin[k]).sum::<f64>() + moved(r),
        );
        close(
            9 + r,
            (0..3).map(|k| inverse(r, k) * direction[k]).sum::<f64>(),
        );
        for c in 0..4 {
            close(12 + 3 * c + r, m(r, c));
            close(24 + 3 * c + r, if c < 3 { inverse(r, c) } else { moved(r) });
            close(36 + 3 * c + r, m(r, c));
        }
    }
    // The nearer layer lies at world z = 4 · 1 + 3.
    close(48, 0.25);
    close(49, 3.25);
    close(50, 3.25);
    assert_eq!(results[51..56], [1, 0x0012_3456, 0, 0, 1]);
}

#[test]
fn invocations_that_end_early_do_not_disturb_the_rest() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint i = gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x;
        uint length = i * 2654435761u >> 28;
        uint words[4] = uint[](i, i * 3u, i * 5u, i * 7u);
        uint sum = 0u;
        for (uint turn = 0u; turn < 16u; turn++) {
            payload = turn;
            traceRayEXT(world, 0u, 0xffu, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, turn % 3u == 2u ? -1 : 1), 10.0, 0);
            sum = sum * 31u + payload + words[(turn + payload) & 3u];
            if (turn == length) {
                results[i] = sum;
                return;
            }
        }
    }";
    let closest =
        "layout(location = 0) rayPayloadInEXT uint payload; void main() { payload += 100u; }";
    let (width, height) = (50u32, 21u32);
    let count = width * height;
    let results = Case::with_words(raygen).hit(closest).words(
        &gpu,
        world,
        [width, height, 1],
        count as usize,
    );
    for i in 0..count {
        let mut sum = 0u32;
        for turn in 0..=(i.wrapping_mul(2_654_435_761) >> 28) {
            let payload = if turn % 3 == 2 { u32::MAX } else { turn + 100 };
            let factor = 1 + 2 * (turn.wrapping_add(payload) & 3);
            sum = (sum.wrapping_mul(31))
                .wrapping_add(payload)
                .wrapping_add(i * factor);
        }
        assert_eq!(results[i as usize], sum, "invocation {i}");
    }
}

/// Shaders that run longer than a scheduler lets them at a time, before calls, within and after.
#[test]
fn shaders_of_every_kind_run_long() {
    let name = "shaders_of_every_kind_run_long";
    let settings: [&[(&str, &str)]; 4] = [
        &[],
        &[("TUFF_DIRECT", "0")],
        &[("TUFF_WAVE", "1")],
        &[("TUFF_WAVE", "4"), ("TUFF_TIER", "portable")],
    ];
    if !settings.iter().any(|variables| alone(name, variables)) {
        return;
    }
    const COUNT: u32 = 200;
    const LONG: u32 = 20_000;
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let run = "uint run(uint x, uint n) {
        for (uint k = 0u; k < n; k++) x = x * 1664525u + 1013904223u;
        return x;
    }";
    let raygen = format!(
        "layout(location = 0) rayPayloadEXT uvec2 payload;
        {run}
        void main() {{
            uint i = gl_LaunchIDEXT.x, kind = i / 8u % 4u;
            payload = uvec2(run(i, i < 32u ? {LONG}u : 3u), kind);
            vec3 direction = vec3(0, 0, kind == 3u ? -1 : 1);
            traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, direction, 10.0, 0);
            results[i] = run(payload.x, i < 16u ? {LONG}u : 2u);
        }}"
    );
    let incoming = "layout(location = 0) rayPayloadInEXT uvec2 payload;";
    let hit = format!(
        "{incoming} layout(location = 0) callableDataEXT uint data; {run}
        void main() {{
            data = payload.x + 1u;
            if (payload.y != 2u) executeCallableEXT(payload.y, 0);
            payload.x = run(data, gl_LaunchIDEXT.x < 64u ? 1u : {LONG}u);
        }}"
    );
    let miss = format!("{incoming} {run} void main() {{ payload.x = run(payload.x, {LONG}u); }}");
    let callable = |body: &str| {
        format!("layout(location = 0) callableDataInEXT uint data; {run} void main() {{ {body} }}")
    };
    let results = Case::new(&format!("{WORLD}{RESULTS}{raygen}"))
        .miss(&miss)
        .hit(&hit)
        .callable(&callable(&format!("data = run(data, {LONG}u);")))
        .callable(&callable("data ^= gl_LaunchIDEXT.x;"))
        .words(&gpu, world, [COUNT, 1, 1], COUNT as usize);
    let run = |x: u32, n: u32| {
        (0..n).fold(x, |x, _| {
            x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)
        })
    };
    for (i, result) in (0..).zip(results) {
        let kind = i / 8 % 4;
        let mut x = run(i, if i < 32 { LONG } else { 3 });
        if kind == 3 {
            x = run(x, LONG);
        } else {
            x = x.wrapping_add(1);
            x = match kind {
                0 => run(x, LONG),
                1 => x ^ i,
                _ => x,
            };
            x = run(x, if i < 64 { 1 } else { LONG });
        }
        assert_eq!(result, run(x, if i < 16 { LONG } else { 2 }), "{i}");
    }
}

/// Hit, miss and callable shaders exchange the components of what they are given, write one of
/// them, or end before they write any; a tile has lanes of all kinds.
#[test]
fn payloads_are_exchanged_in_place() {
    let name = "payloads_are_exchanged_in_place";
    let settings: [&[(&str, &str)]; 4] = [
        &[],
        &[("TUFF_DIRECT", "0")],
        &[("TUFF_WAVE", "1")],
        &[("TUFF_TIER", "portable")],
    ];
    if !settings.iter().any(|variables| alone(name, variables)) {
        return;
    }
    const KINDS: u32 = 6;
    const SIZE: [u32; 2] = [52, 40];
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    // Tiles of one kind, and tiles of two.
    let raygen = format!(
        "layout(location = 0) rayPayloadEXT uvec4 payload;
        void main() {{
            uvec2 at = gl_LaunchIDEXT.xy;
            uint i = at.y * {}u + at.x;
            uint kind = (at.x / 4u + (at.y % 8u < 4u ? 0u : at.y / 2u)) % {KINDS}u;
            for (uint turn = 0u; turn < 2u; turn++) {{
                payload = uvec4(i, kind, 3u * i, 7u * i + turn);
                vec3 direction = vec3(0, 0, kind == 5u ? -1 : 1);
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, direction, 10.0, 0);
                for (uint k = 0u; k < 4u; k++) results[8u * i + 4u * turn + k] = payload[k];
            }}
        }}",
        SIZE[0]
    );
    let hit = "
        layout(location = 0) rayPayloadInEXT uvec4 payload;
        layout(location = 0) callableDataEXT uvec3 data;
        void main() {
            uint kind = payload.y;
            if (kind == 0u && payload.x % 3u == 0u) return;
            if (kind == 1u) { payload.z = payload.w; return; }
            if (kind == 2u) { payload = payload.wzyx; return; }
            if (kind == 3u) {
                data = payload.xzw;
                executeCallableEXT(0, 0);
                payload.xzw = data;
                return;
            }
            payload = payload.yzwx;
        }";
    let miss = "
        layout(location = 0) rayPayloadInEXT uvec4 payload;
        void main() { payload.xw = payload.wx; }";
    let callable = "
        layout(location = 0) callableDataInEXT uvec3 data;
        void main() {
            if (data.x % 5u == 0u) return;
            data = data.zxy;
        }";
    let count = SIZE[0] * SIZE[1];
    let size = [SIZE[0], SIZE[1], 1];
    let results = Case::new(&format!("{WORLD}{RESULTS}{raygen}"))
        .miss(miss)
        .hit(hit)
        .callable(callable)
        .words(&gpu, world, size, 8 * count as usize);
    for (i, results) in (0..count).zip(results.chunks(8)) {
        let (x, y) = (i % SIZE[0], i / SIZE[0]);
        let kind = (x / 4 + if y % 8 < 4 { 0 } else { y / 2 }) % KINDS;
        for (turn, result) in (0..2).zip(results.chunks(4)) {
            let [a, b, c, d] = [i, kind, 3 * i, 7 * i + turn];
            let expected = match kind {
                0 if i % 3 == 0 => [a, b, c, d],
                1 => [a, b, d, d],
                2 => [d, c, b, a],
                3 if i % 5 == 0 => [a, b, c, d],
                3 => [d, b, a, c],
                5 => [d, b, c, a],
                _ => [b, c, d, a],
            };
            assert_eq!(
                result, expected,
                "launch {x}, {y}, kind {kind}, turn {turn}"
            );
        }
    }
}

/// Shaders may be declared with longer payloads and data than their callers have: what they write
/// beyond these reaches no other variable.
#[test]
fn payloads_longer_than_those_of_callers_stay_apart() {
    let name = "payloads_longer_than_those_of_callers_stay_apart";
    let settings: [&[(&str, &str)]; 2] = [&[], &[("TUFF_DIRECT", "0")]];
    if !settings.iter().any(|variables| alone(name, variables)) {
        return;
    }
    const COUNT: u32 = 100;
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let raygen = format!(
        "layout(location = 0) rayPayloadEXT uint payload;
        layout(location = 1) callableDataEXT uint data;
        void main() {{
            uint i = gl_LaunchIDEXT.x;
            uint kept[5] = uint[](i, 2u * i, 3u * i, 5u * i, 7u * i);
            uint sum = 0u;
            for (uint turn = 0u; turn < 3u; turn++) {{
                payload = i + turn;
                vec3 direction = vec3(0, 0, i / 16u % 2u == 0u ? 1 : -1);
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, direction, 10.0, 0);
                data = i;
                executeCallableEXT(0, 1);
                sum += kept[(turn + i) % 5u];
            }}
            results[i] = sum + (payload & 0u) + (data & 0u);
            results[{COUNT}u + i] = i;
        }}"
    );
    let long = |declaration: &str| {
        format!(
            "layout(location = 0) {declaration} uint words[1024];
            void main() {{
                for (uint k = 0u; k < 1024u; k++) words[k] = words[k] * 3u + 0xabcd0000u + k;
            }}"
        )
    };
    let results = Case::new(&format!("{WORLD}{RESULTS}{raygen}"))
        .miss(&long("rayPayloadInEXT"))
        .hit(&long("rayPayloadInEXT"))
        .callable(&long("callableDataInEXT"))
        .words(&gpu, world, [COUNT, 1, 1], 2 * COUNT as usize);
    for i in 0..COUNT {
        let kept = [i, 2 * i, 3 * i, 5 * i, 7 * i];
        let sum: u32 = (0..3).map(|turn| kept[((turn + i) % 5) as usize]).sum();
        assert_eq!(results[i as usize], sum, "{i}");
        assert_eq!(results[(COUNT + i) as usize], i);
    }
}

/// Traces and calls alternate: neither sees data that the other has left.
#[test]
fn traces_and_calls_take_turns() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(2))]);
    const SIZE: [u32; 2] = [36, 20];
    let raygen = format!(
        "layout(location = 0) rayPayloadEXT uint payload;
        layout(location = 1) callableDataEXT uint data;
        void main() {{
            uint i = gl_LaunchIDEXT.y * {}u + gl_LaunchIDEXT.x, sum = 0u;
            for (uint turn = 0u; turn < 4u; turn++) {{
                payload = turn;
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), turn % 2u == 0u ? 0.0 : 1.5,
                    vec3(0, 0, 1), 10.0, 0);
                sum = sum * 31u + payload;
                data = i + turn;
                executeCallableEXT(turn % 2u, 1);
                sum = sum * 31u + data;
                if (turn == i % 4u) break;
                traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.5, vec3(0, 0, -1), 10.0, 0);
                sum = sum * 31u + payload;
            }}
            results[i] = sum;
        }}",
        SIZE[0]
    );
    let hit = "layout(location = 0) rayPayloadInEXT uint payload;
        void main() { payload = payload * 10u + uint(gl_PrimitiveID) + 3u; }";
    let callable = |body: &str| {
        format!("layout(location = 0) callableDataInEXT uint data; void main() {{ {body} }}")
    };
    let count = SIZE[0] * SIZE[1];
    let results = Case::with_words(&raygen)
        .hit(hit)
        .callable(&callable("data += 17u;"))
        .callable(&callable("data *= 5u;"))
        .words(&gpu, world, [SIZE[0], SIZE[1], 1], count as usize);
    for i in 0..count {
        let mut sum = 0u32;
        let mut add = |word: u32| sum = sum.wrapping_mul(31).wrapping_add(word);
        for turn in 0..=i % 4 {
            add(turn * 10 + turn % 2 + 3);
            add(match turn % 2 {
                0 => i + turn + 17,
                _ => (i + turn) * 5,
            });
            if turn < i % 4 {
                add(u32::MAX);
            }
        }
        assert_eq!(results[i as usize], sum, "{i}");
    }
}

/// Any-hit shaders that run for long, look at other lanes or have effects are asked about each
/// layer once.
#[test]
fn any_hit_shaders_see_each_layer_once() {
    let name = "any_hit_shaders_see_each_layer_once";
    let settings: [&[(&str, &str)]; 4] = [
        &[],
        &[("TUFF_DIRECT", "0")],
        &[("TUFF_WAVE", "1")],
        &[("TUFF_WAVE", "4"), ("TUFF_TIER", "portable")],
    ];
    if !settings.iter().any(|variables| alone(name, variables)) {
        return;
    }
    const SIZE: u32 = 40;
    const LAYERS: u32 = 6;
    const LONG: u32 = 20_000;
    let gpu = Gpu::new();
    // Rays that ignore all layers sum them up; of others, the nearest that is taken counts.
    let raygen = "layout(location = 0) rayPayloadEXT uvec2 payload;
        void main() {
            uint i = gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x;
            payload = uvec2(0u, i);
            traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, 1), 100.0, 0);
            results[i] = payload.x;
        }";
    let incoming = "layout(location = 0) rayPayloadInEXT uvec2 payload;";
    let hit = format!("{incoming} void main() {{ payload.x = uint(gl_PrimitiveID); }}");
    let miss = format!("{incoming} void main() {{ payload.x += 7u; }}");
    let any_hit = |head: &str, effect: &str| {
        format!(
            "{head} {incoming}
            void main() {{
                uint layer = uint(gl_PrimitiveID), x = layer;
                uint turns = payload.y % 50u == 4u && layer == 2u ? {LONG}u : 2u;
                for (uint k = 0u; k < turns; k++) x = x * 1664525u + 1013904223u;
                payload.x += x;
                {effect}
                if (payload.y % 2u == 0u || layer < payload.y / 2u % {LAYERS}u) {{
                    ignoreIntersectionEXT;
                }}
            }}"
        )
    };
    let shaders = [
        any_hit("", ""),
        any_hit(
            "#extension GL_KHR_shader_subgroup_ballot : enable\n",
            "if (subgroupBallot(true) == uvec4(0)) payload.x = 0u;",
        ),
        any_hit(
            RESULTS,
            &format!(
                "if (layer == 0u) atomicAdd(results[{SIZE}u * {SIZE}u + payload.y % 2u], 1u);"
            ),
        ),
    ];
    for (kind, shader) in shaders.iter().enumerate() {
        let flags = vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION;
        let world = gpu.scene(&[Geometry::triangles(&layers(LAYERS), flags)]);
        let count = SIZE * SIZE;
        let results = Case::new(&format!("{WORLD}{RESULTS}{raygen}"))
            .miss(&miss)
            .hit(&hit)
            .any_hit(shader)
            .words(&gpu, world, [SIZE, SIZE, 1], count as usize + 2);
        for i in 0..count {
            let seen = |layer: u32| {
                let turns = if i % 50 == 4 && layer == 2 { LONG } else { 2 };
                (0..turns).fold(layer, |x, _| {
                    x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)
                })
            };
            let expected = match i % 2 {
                0 => (0..LAYERS).fold(7, |sum: u32, layer| sum.wrapping_add(seen(layer))),
                _ => i / 2 % LAYERS,
            };
            assert_eq!(results[i as usize], expected, "{kind}: {i}");
        }
        if kind == 2 {
            // Those that take a nearer layer first may never meet it.
            let [all, some] = [results[count as usize], results[count as usize + 1]];
            assert!(all == count / 2 && some <= count / 2, "{all} {some}");
        }
    }
}
