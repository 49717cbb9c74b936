//! Which shader a record of the binding table calls.

use tuff_tests::*;

#[test]
fn the_binding_table_is_indexed_by_instance_geometry_and_ray() {
    let gpu = Gpu::new();
    // Three geometries side by side in each of four instances, one above the other.
    let geometries: Vec<Geometry> = (0..3)
        .map(|i| {
            let x = i as f32 * 2.0;
            Geometry::opaque(&[[x, 0.0, 1.0], [x + 1.0, 0.0, 1.0], [x, 1.0, 1.0]])
        })
        .collect();
    let bottom = gpu.bottom(&geometries);
    let offsets = [0, 3, 11, 6];
    let instances: Vec<Instance> = offsets
        .iter()
        .enumerate()
        .map(|(i, offset)| Instance {
            transform: translated([0.0, 2.0 * i as f32, 0.0]),
            table_offset: *offset,
            ..Instance::of(bottom)
        })
        .collect();
    let world = gpu.top(&instances);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    layout(shaderRecordEXT, std430) buffer Own { uint own[2]; };
    void main() {
        uvec3 id = gl_LaunchIDEXT;
        vec3 origin = vec3(2.0 * float(id.x) + 0.25, 2.0 * float(id.y) + 0.25, 0.0);
        uint offset = id.z % 3u, stride = id.z / 3u;
        payload = own[1];
        traceRayEXT(world, 0u, 0xff, offset, stride, id.z % 2u, origin, 0.0, vec3(0, 0, 1), 100.0, 0);
        results[(id.z * 5u + id.y) * 4u + id.x] = payload + own[0];
    }";
    let hit = |letter: u32| {
        format!(
            "layout(location = 0) rayPayloadInEXT uint payload;
            layout(shaderRecordEXT, std430) buffer Own {{ uint number; uint more[3]; }};
            void main() {{ payload += number + more[2] * 1000u + {letter}u * 100000u; }}"
        )
    };
    let miss = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    layout(shaderRecordEXT, std430) buffer Own { uint number; };
    void main() { payload += number; }";
    let (hit_a, hit_b) = (hit(1), hit(2));
    let output = gpu.buffer(4 * 4 * 5 * 9);
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let case = Case::new(&raygen)
        .miss(miss)
        .hit(&hit_a)
        .hit(&hit_b)
        .bind(world)
        .bind(output);
    let table = Table {
        raygen: Record::with(0, &[70_000_000u32, 3_000_000]),
        miss: vec![Record::with(1, &[11u32]), Record::with(1, &[22u32])],
        hit: (0..20u32)
            .map(|i| Record::with(2 + i % 2, &[i, 0, 0, 2 * i]))
            .collect(),
        callable: vec![],
    };
    gpu.trace(&gpu.rays(&case), &table, [4, 5, 9]);
    let results: Vec<u32> = output.read();
    for z in 0..9u32 {
        for y in 0..5u32 {
            for x in 0..4u32 {
                let hit = x < 3 && y < 4;
                let expected = 73_000_000
                    + if hit {
                        let record = offsets[y as usize] + x * (z / 3) + z % 3;
                        record + 2000 * record + 100_000 * (1 + record % 2)
                    } else {
                        11 * (1 + z % 2)
                    };
                assert_eq!(
                    results[((z * 5 + y) * 4 + x) as usize],
                    expected,
                    "{x} {y} {z}"
                );
            }
        }
    }
}

#[test]
fn unused_groups_do_nothing() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 42u;
        vec3 direction = vec3(0, 0, gl_LaunchIDEXT.x == 0u ? 1 : -1);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, direction, 100.0, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let output = gpu.buffer(8);
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let case = Case::new(&raygen).bind(world).bind(output);
    let table = Table {
        miss: vec![Record::default()],
        hit: vec![Record::default()],
        ..case.table()
    };
    gpu.trace(&gpu.rays(&case), &table, [2, 1, 1]);
    assert_eq!(output.read::<u32>(), [42, 42]);
}

#[test]
fn callables_call_callables() {
    let gpu = Gpu::new();
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let raygen = r"
    layout(location = 3) callableDataEXT uvec4 data;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        data = uvec4(i, 0u, 0u, i * 7u);
        executeCallableEXT(i % 3u, 3);
        results[2u * i] = data.y;
        results[2u * i + 1u] = data.w + data.z;
    }";
    let leaf = r"
    layout(location = 0) callableDataInEXT uvec4 data;
    layout(shaderRecordEXT, std430) buffer Own { uint number; };
    void main() { data.y = data.x * 3u + number; data.z += 1u; }";
    let caller = r"
    layout(location = 0) callableDataInEXT uvec4 data;
    layout(location = 1) callableDataEXT uvec4 inner;
    void main() {
        uint sum = 0u;
        for (uint k = 0u; k < data.x % 4u; k++) {
            inner = uvec4(k, 0u, 0u, 0u);
            executeCallableEXT(k % 2u, 1);
            sum += inner.y;
            data.z += inner.z;
        }
        data.y = sum;
    }";
    let output = gpu.buffer(8 * 200);
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let case = Case::new(&raygen)
        .callable(leaf)
        .callable(caller)
        .bind(world)
        .bind(output);
    let table = Table {
        callable: vec![
            Record::with(1, &[500u32]),
            Record::with(1, &[9000u32]),
            Record::of(2),
        ],
        ..case.table()
    };
    gpu.trace(&gpu.rays(&case), &table, [200, 1, 1]);
    let call = |i: u32, record: u32| 3 * i + [500, 9000][record as usize];
    for (i, [value, rest]) in output.read::<[u32; 2]>().into_iter().enumerate() {
        let i = i as u32;
        let (expected, calls) = match i % 3 {
            2 => ((0..i % 4).map(|k| call(k, k % 2)).sum(), i % 4),
            record => (call(i, record), 1),
        };
        assert_eq!((value, rest), (expected, 7 * i + calls), "invocation {i}");
    }
}
