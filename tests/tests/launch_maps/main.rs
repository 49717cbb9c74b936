//! `TUFF_CAPTURE` without a pixel: what each invocation's rays cost, expected from where the
//! triangles are.

mod reading;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicU32, Ordering};

use reading::{Captured, read};
use serde_json::{Value, json};
use tuff_tests::*;

/// Says in a child what to do there.
const CHILD: &str = "TUFF_TEST_MAPS";

/// A folder of its own for a test's capture: several tests capture the same work.
fn folder(name: &str) -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = format!("tuff-maps-{}-{count}-{name}", std::process::id());
    std::env::temp_dir().join(name)
}

/// Runs [`work_in_a_child`] in a process of its own.
fn child(what: &str, variables: &[(&str, &str)]) -> Output {
    let program = std::env::current_exe().expect("this program");
    let mut child = Command::new(program);
    child.args(["--exact", "work_in_a_child", "--nocapture"]);
    child.env(CHILD, what).envs(variables.iter().copied());
    child.output().expect("this program runs again")
}

fn is_tuff() -> bool {
    let gpu = Gpu::without_validation().with("a driver that counts rays", Gpu::is_tuff);
    gpu.is_some()
}

/// The lines in which a child tells its results.
fn results(output: &Output) -> Vec<String> {
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let lines = text.lines().filter_map(|line| line.split_once("results: "));
    lines.map(|(_, words)| words.to_owned()).collect()
}

/// Captures work in a child, with the same results as without.
fn captured(what: &str, more: &[(&str, &str)]) -> Vec<Captured> {
    let (results_with, commands) = captured_with(what, more);
    assert_eq!(results_with, results(&child(what, &[])));
    commands
}

/// Captures work in a child; its results, too.
fn captured_with(what: &str, more: &[(&str, &str)]) -> (Vec<String>, Vec<Captured>) {
    let names: String = more.iter().map(|(_, value)| format!("-{value}")).collect();
    let folder = folder(&format!("{what}{names}"));
    let path = folder.to_string_lossy().into_owned();
    let mut variables = vec![("TUFF_CAPTURE", &*path)];
    variables.extend(more);
    let output = child(what, &variables);
    assert!(output.status.success(), "{output:?}");
    assert_ne!(results(&output), [""; 0]);
    let commands = read(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    (results(&output), commands)
}

/// A triangle at a height, which rays along z at (0.25, 0.25) meet.
fn triangle(z: f32) -> [[f32; 3]; 3] {
    [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]]
}

/// In a child.
#[test]
fn work_in_a_child() {
    let Some(what) = std::env::var_os(CHILD) else {
        return;
    };
    let gpu = Gpu::without_validation();
    let words: Vec<u32> = match what.to_str() {
        Some("triangle") => one_triangle(&gpu),
        Some("layers") => layers(&gpu),
        Some("boxes") => boxes(&gpu),
        Some("callables") => callables(&gpu),
        Some("lines") => lines(&gpu),
        Some("queries") => queries(&gpu),
        Some("many") => many(&gpu),
        Some("passes") => passes(&gpu),
        Some("large") => large(&gpu),
        Some("die") => {
            one_triangle(&gpu);
            std::process::abort();
        }
        other => panic!("{other:?}"),
    };
    println!("results: {words:?}");
}

/// 40 × 30 rays along z, a unit apart, at one opaque triangle: (1, 1) meets it, its neighbours with
/// a 2 its box alone, all others nothing. The closest-hit shader traces another ray, away from the
/// triangle. Two invocations trace a ray that is none.
fn one_triangle(gpu: &Gpu) -> Vec<u32> {
    let side = [[1.0, 1.0, 2.0], [2.2, 1.0, 2.0], [1.0, 2.2, 2.0]];
    let world = gpu.scene(&[Geometry::opaque(&side)]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 0u;
        vec3 origin = vec3(vec2(gl_LaunchIDEXT.xy) + 0.125, 0);
        if (gl_LaunchIDEXT.xy == uvec2(7, 5)) { origin.y = uintBitsToFloat(0x7fc00000u); }
        if (gl_LaunchIDEXT.xy == uvec2(39, 29)) { origin.x = uintBitsToFloat(0xff800000u); }
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 100.0, 0);
        results[gl_LaunchIDEXT.x + 40u * gl_LaunchIDEXT.y] = payload;
    }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    layout(location = 1) rayPayloadEXT uint inner;
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    void main() {
        inner = 5u;
        vec3 origin = gl_WorldRayOriginEXT;
        traceRayEXT(world, 0u, 0xff, 0, 0, 1, origin, 0.0, vec3(0, 0, -1), 10.0, 1);
        payload = 100u + inner;
    }";
    let inner = "layout(location = 1) rayPayloadInEXT uint inner; void main() { inner = 6u; }";
    let output = gpu.buffer(4 * 1200);
    let case = Case::with_words(raygen).miss(inner).hit(closest);
    let case = case.recursion(2).bind(world).bind(output);
    let table = case.table();
    gpu.trace(&gpu.rays(&case), &table, [40, 30, 1]);
    output.read()
}

/// A map of 40 × 30 with one number, except for some places.
fn map_of(most: u32, others: &[(usize, usize, u32)]) -> Vec<u32> {
    let mut map = vec![most; 1200];
    for &(x, y, number) in others {
        map[x + 40 * y] = number;
    }
    map
}

#[test]
fn rays_are_counted_where_they_are_traced() {
    if !is_tuff() {
        return;
    }
    let commands = captured("triangle", &[]);
    let [command] = &commands[..] else {
        panic!("one command");
    };
    let entry = &command.entry;
    for (key, expected) in [
        ("kind", json!("trace")),
        ("frame", json!(0)),
        ("extent", json!([40, 30, 1])),
        ("step", json!([1, 1, 1])),
        ("size", json!([40, 30, 1])),
        ("stopped", json!(false)),
    ] {
        assert_eq!(entry[key], expected, "{key} of {entry}");
    }
    let (nan, infinite) = ((7, 5, 0), (39, 29, 0));
    let boxed = [(2, 1), (1, 2), (2, 2)];
    let with_boxed = |others: &[(usize, usize, u32)], number: u32| {
        let boxed = boxed.iter().map(|&(x, y)| (x, y, number));
        boxed.chain(others.iter().copied()).collect::<Vec<_>>()
    };
    // The inner ray is held against the root's child, behind its start.
    for (name, expected) in [
        ("rays", map_of(1, &[(1, 1, 2)])),
        ("depth", map_of(1, &[(1, 1, 2)])),
        // A node; where the ray meets the box, its leaf, too.
        (
            "steps",
            map_of(1, &with_boxed(&[(1, 1, 3), nan, infinite], 2)),
        ),
        ("box_tests", map_of(1, &[(1, 1, 2), nan, infinite])),
        ("primitive_tests", map_of(0, &with_boxed(&[(1, 1, 1)], 1))),
        ("closest_hit_shaders", map_of(0, &[(1, 1, 1)])),
        ("miss_shaders", map_of(1, &[])),
        ("nan_rays", map_of(0, &[(7, 5, 1)])),
        ("infinite_rays", map_of(0, &[(39, 29, 1)])),
        ("any_hit_candidates", map_of(0, &[])),
        ("box_candidates", map_of(0, &[])),
        ("callable_shaders", map_of(0, &[])),
        ("any_hit_shaders", map_of(0, &[])),
        ("intersection_shaders", map_of(0, &[])),
    ] {
        assert_eq!(command.map(name), expected, "{name}");
    }
    let time = command.map("nanoseconds");
    assert!(time.iter().any(|&number| number > 0));
    assert_eq!(command.maps.len(), 15);
    assert_eq!(entry["first_rays"]["step"], json!([1, 1, 1]));
    assert_eq!(entry["first_rays"]["size"], json!([40, 30, 1]));
    for (index, line) in command.first_rays.chunks(6).enumerate() {
        let (x, y) = ((index % 40) as f32, (index / 40) as f32);
        match (x, y) {
            (7.0, 5.0) => assert!(line[1].is_nan()),
            (39.0, 29.0) => assert_eq!(line[0], f32::NEG_INFINITY),
            _ => assert_eq!(line, [x + 0.125, y + 0.125, 0.0, 0.0, 0.0, 1.0]),
        }
    }
}

#[test]
fn counts_are_the_same_on_every_machine() {
    if !is_tuff() {
        return;
    }
    for what in ["triangle", "layers", "lines", "queries"] {
        let (same, expected) = captured_with(what, &[]);
        for more in [
            ("TUFF_THREADS", "1"),
            ("TUFF_THREADS", "2"),
            ("TUFF_WAVE", "1"),
            ("TUFF_DIRECT", "0"),
            ("TUFF_TIER", "portable"),
            ("TUFF_DISABLE", "packets,streams"),
        ] {
            let (results, found) = captured_with(what, &[more]);
            assert_eq!(results, same, "{what} with {more:?}");
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(&expected) {
                assert_eq!(found.alone(), expected.alone(), "{what} with {more:?}");
            }
        }
    }
}

/// Three triangles that the any-hit shader ignores, in the way of even invocations.
fn layers(gpu: &Gpu) -> Vec<u32> {
    let all = [triangle(1.0), triangle(2.0), triangle(3.0)].concat();
    let world = gpu.scene(&[Geometry::triangles(&all, vk::GeometryFlagsKHR::empty())]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 0u;
        vec3 origin = vec3(0.25 + 50.0 * float(gl_LaunchIDEXT.x % 2u), 0.25, 0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 100.0, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let any_hit = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    void main() { payload += 1u; ignoreIntersectionEXT; }";
    let case = Case::with_words(raygen).hit_group().any_hit(any_hit);
    case.words(gpu, world, [20, 1, 1], 20)
}

/// Boxes whose intersection shader reports nothing: odd invocations meet two of them, others one.
fn boxes(gpu: &Gpu) -> Vec<u32> {
    let boxes = [
        [0.0, 0.0, 1.0, 2.0, 1.0, 2.0],
        [1.0, 0.0, 5.0, 2.0, 1.0, 6.0],
    ];
    let bottom = gpu.bottom(&[Geometry::boxes(&boxes, vk::GeometryFlagsKHR::empty())]);
    let world = gpu.top(&[Instance::of(bottom)]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 3u;
        vec3 origin = vec3(0.5 + float(gl_LaunchIDEXT.x % 2u), 0.5, 0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 50.0, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let case = Case::with_words(raygen)
        .hit_group()
        .intersection("void main() {}");
    case.words(gpu, world, [20, 1, 1], 20)
}

#[test]
fn structures_are_written_as_they_were_built() {
    if !is_tuff() {
        return;
    }
    let commands = captured("triangle", &[]);
    let structure = &commands[0].entry["structures"][0];
    assert_eq!(
        (&structure["kind"], &structure["primitives"]),
        (&json!("instances"), &json!(1))
    );
    let bottom = &structure["bottom_levels"][0];
    assert_eq!(
        (&bottom["kind"], &bottom["primitives"]),
        (&json!("triangles"), &json!(1))
    );
    assert_eq!(
        (&bottom["depth"], &bottom["instances"]),
        (&json!(1), &json!(1))
    );
    assert_eq!(
        bottom["bounds"],
        json!([[1.0, 1.0, 2.0], [2.2f32, 2.2f32, 2.0]])
    );
    for built in [structure, bottom] {
        assert!(built["build_nanoseconds"].as_u64() > Some(0), "{built}");
        assert_eq!(built["is_update"], false);
        assert_eq!(built["boxes"]["levels"], json!([{ "boxes": 1, "kept": 1 }]));
    }
    // Boxes are as large as what is in them, rounded outwards.
    let exact = [1.0, 1.0, 2.0, 2.2f32, 2.2, 2.0];
    assert_eq!(commands[0].boxes.len(), 2);
    for boxes in &commands[0].boxes {
        assert_eq!(boxes.len(), 6);
        for (axis, (bound, exact)) in boxes.iter().zip(exact).enumerate() {
            let inside = if axis < 3 {
                bound - exact
            } else {
                exact - bound
            };
            assert!((-1e-3..=0.0).contains(&inside), "{boxes:?}");
        }
    }
    let scene = &commands[0].scenes[0];
    assert_eq!(scene["nodes"].as_array().map(Vec::len), Some(1));
    let primitive = &scene["meshes"][0]["primitives"][0];
    assert_eq!(primitive["mode"], 4);
    let positions =
        &scene["accessors"][primitive["attributes"]["POSITION"].as_u64().expect("one") as usize];
    assert_eq!(
        (&positions["count"], &positions["min"]),
        (&json!(3), &json!([1.0, 1.0, 2.0]))
    );

    let commands = captured("boxes", &[]);
    let primitive = &commands[0].scenes[0]["meshes"][0]["primitives"][0];
    assert_eq!(primitive["mode"], 1, "boxes are lines");
    let count = |index: &Value| {
        &commands[0].scenes[0]["accessors"][index.as_u64().expect("one") as usize]["count"]
    };
    assert_eq!(count(&primitive["attributes"]["POSITION"]), 2 * 8);
    assert_eq!(count(&primitive["indices"]), 2 * 24);
}

#[test]
fn candidates_are_those_on_the_line() {
    if !is_tuff() {
        return;
    }
    let by_parity = |even: u32, odd: u32| [even, odd].repeat(10);
    let commands = captured("layers", &[]);
    for name in ["any_hit_candidates", "any_hit_shaders", "primitive_tests"] {
        assert_eq!(commands[0].map(name), by_parity(3, 0), "{name}");
    }
    assert_eq!(commands[0].map("miss_shaders"), [1; 20]);
    let commands = captured("boxes", &[]);
    for name in ["box_candidates", "intersection_shaders"] {
        assert_eq!(commands[0].map(name), by_parity(1, 2), "{name}");
    }
    // The root has two children, of which one box is a leaf each.
    assert_eq!(commands[0].map("box_tests"), [2; 20]);
    assert_eq!(commands[0].map("steps"), by_parity(2, 3));
    assert_eq!(commands[0].map("primitive_tests"), [0; 20]);
}

/// A callable that calls another one, from even invocations.
fn callables(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let raygen = r"
    layout(location = 3) callableDataEXT uint data;
    void main() {
        data = gl_LaunchIDEXT.x;
        if (gl_LaunchIDEXT.x % 2u == 0u) { executeCallableEXT(1u, 3); }
        results[gl_LaunchIDEXT.x] = data;
    }";
    let leaf = "layout(location = 0) callableDataInEXT uint data; void main() { data *= 3u; }";
    let caller = r"
    layout(location = 0) callableDataInEXT uint data;
    layout(location = 1) callableDataEXT uint inner;
    void main() { inner = data; executeCallableEXT(0u, 1); data = inner + 1u; }";
    let case = Case::with_words(raygen).callable(leaf).callable(caller);
    case.words(gpu, world, [40, 1, 1], 40)
}

/// 64 × 16 rays that go together: those left of column 48 meet a triangle. Its shader calls a
/// callable in the columns left of 32.
fn lines(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 0u;
        vec3 origin = vec3(gl_LaunchIDEXT.x < 48u ? 0.25 : 9.0, 0.25, 0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 100.0, 0);
        results[gl_LaunchIDEXT.x + 64u * gl_LaunchIDEXT.y] = payload;
    }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    layout(location = 1) callableDataEXT uint data;
    void main() {
        data = gl_LaunchIDEXT.x;
        if (data < 32u) { executeCallableEXT(0u, 1); }
        payload = data;
    }";
    let called = "layout(location = 1) callableDataInEXT uint data; void main() { data *= 3u; }";
    let case = Case::with_words(raygen).callable(called).hit(closest);
    case.words(gpu, world, [64, 16, 1], 1024)
}

/// Ray queries of workgroups of 4 × 2. Invocations with x below 6 meet two triangles that are not
/// opaque and confirm neither.
const QUERY: &str = r"
    #extension GL_EXT_ray_query : require
    layout(local_size_x = 4, local_size_y = 2) in;
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1, std430) buffer R { uint results[]; };
    void main() {
        uvec2 id = gl_GlobalInvocationID.xy;
        uint found = 0u;
        for (uint i = 0u; i < 1u + id.y; i++) {
            rayQueryEXT query;
            rayQueryInitializeEXT(query, world, 0u, 0xff,
                vec3(id.x < 6u ? 0.25 : 9.0, 0.25, 0), 0.0, vec3(0, 0, 1), 1000.0);
            while (rayQueryProceedEXT(query)) { found += 1u; }
        }
        results[id.x + 12u * id.y] = found;
    }";

fn queries(gpu: &Gpu) -> Vec<u32> {
    let triangles = [triangle(1.0), triangle(2.0)].concat();
    let world = gpu.scene(&[Geometry::triangles(
        &triangles,
        vk::GeometryFlagsKHR::empty(),
    )]);
    let output = gpu.buffer(4 * 12 * 4);
    let bindings: [(u32, &[Bound]); 2] = [(0, &[world.into()]), (1, &[output.into()])];
    gpu.compute_with(QUERY, &bindings, [3, 2, 1]);
    output.read()
}

#[test]
fn ray_queries_of_compute_shaders_are_counted() {
    if !is_tuff() {
        return;
    }
    let commands = captured("queries", &[]);
    assert_eq!(commands.len(), 1);
    let command = &commands[0];
    assert_eq!(command.entry["kind"], "dispatch");
    assert_eq!(command.entry["extent"], json!([12, 4, 1]));
    // So many rays an invocation as its row says.
    let by_row = |inside: u32, outside: u32| -> Vec<u32> {
        let of = |y: u32| (0..12).map(move |x| (y + 1) * if x < 6 { inside } else { outside });
        (0..4).flat_map(of).collect()
    };
    for (name, inside, outside) in [
        ("rays", 1, 1),
        ("any_hit_candidates", 2, 0),
        ("primitive_tests", 2, 0),
        ("box_tests", 1, 1),
        ("steps", 2, 1),
    ] {
        assert_eq!(command.map(name), by_row(inside, outside), "{name}");
    }
    for name in ["depth", "any_hit_shaders", "miss_shaders"] {
        assert_eq!(command.map(name), [0; 48], "{name}");
    }
}

#[test]
fn callables_are_counted() {
    if !is_tuff() {
        return;
    }
    let commands = captured("callables", &[]);
    assert_eq!(commands[0].map("callable_shaders"), [2, 0].repeat(20));
    assert_eq!(commands[0].map("rays"), [0; 40]);
}

#[test]
fn shaders_that_run_in_lines_are_counted() {
    if !is_tuff() {
        return;
    }
    let commands = captured("lines", &[]);
    let row = |of: [u32; 4]| of.map(|number| [number; 16]).concat().repeat(16);
    assert_eq!(commands[0].map("rays"), row([1; 4]));
    assert_eq!(commands[0].map("closest_hit_shaders"), row([1, 1, 1, 0]));
    assert_eq!(commands[0].map("miss_shaders"), row([0, 0, 0, 1]));
    assert_eq!(commands[0].map("callable_shaders"), row([1, 1, 0, 0]));
}

/// Three passes into 40 × 30 pixels. In the first, a triangle over all of them traces rays by ray
/// queries, as many as its row says; one behind it is drawn to the left half and fails the depth
/// test. The second has a program that computes nothing, the third has none. A fourth only clears.
fn passes(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let set = gpu.set_of(&[world.into()]);
    let vertex = "
        layout(push_constant) uniform Push { float depth; };
        void main() {
            vec2 at = vec2(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0);
            gl_Position = vec4(at, depth, 1.0);
        }";
    let fragment = "
        #extension GL_EXT_ray_query : require
        layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(location = 0) out vec4 color;
        void main() {
            uint found = 0u;
            for (uint i = 0u; i < 1u + uint(gl_FragCoord.y) % 3u; i++) {
                rayQueryEXT query;
                rayQueryInitializeEXT(query, world, 0u, 0xff,
                    vec3(gl_FragCoord.x < 10.0 ? 0.25 : 9.0, 0.25, 0), 0.0, vec3(0, 0, 1), 50.0);
                rayQueryProceedEXT(query);
                found += rayQueryGetIntersectionTypeEXT(query, true);
            }
            color = vec4(float(found) / 8.0);
        }";
    let canvas = gpu.canvas(RGBA, 40, 30);
    let depth = gpu.canvas(vk::Format::D32_SFLOAT, 40, 30);
    let mut painting = Painting::new(gpu, vertex, fragment, RGBA);
    painting.layout = gpu.layout(&[set.layout]);
    painting.depth = vk::Format::D32_SFLOAT;
    painting.depth_stencil = (painting.depth_stencil)
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::LESS);
    let traced = gpu.painting(&painting);
    painting.fragment = Some(WHITE);
    let plain = gpu.painting(&painting);
    let mut alone = painting.clone();
    (alone.fragment, alone.colors, alone.blend) = (None, Vec::new(), Vec::new());
    let alone = gpu.painting(&alone);
    let pass = Pass {
        depth: Some(depth),
        clear_depth: Some((1.0, 0)),
        ..Pass::black(&canvas)
    };
    let draw = |commands, pipeline, depth: f32| {
        gpu.bind(commands, pipeline);
        gpu.push(commands, painting.layout, &depth);
        gpu.draw_vertices(commands, 3);
    };
    let mut words = Vec::new();
    let mut keep = || words.extend(gpu.colors(&canvas).into_iter().map(u32::from_le_bytes));
    gpu.draw(&pass, |commands| {
        gpu.bind_set(commands, painting.layout, set.handle);
        draw(commands, traced, 0.25);
        let half = vk::Rect2D::default().extent(vk::Extent2D {
            width: 20,
            height: 30,
        });
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_set_scissor(commands, 0, &[half]) };
        draw(commands, traced, 0.75);
    });
    keep();
    gpu.draw(&pass, |commands| draw(commands, plain, 0.5));
    keep();
    let depths = Pass {
        colors: &[],
        clears: &[],
        ..pass
    };
    gpu.draw(&depths, |commands| draw(commands, alone, 0.5));
    gpu.draw(&pass, |_| ());
    words
}

#[test]
fn pixels_of_passes_are_counted() {
    if !is_tuff() {
        return;
    }
    let commands = captured("passes", &[]);
    assert_eq!(commands.len(), 3, "one that only clears is none");
    for (number, command) in commands.iter().enumerate() {
        assert_eq!(command.entry["kind"], "pass");
        assert_eq!(command.entry["command"], json!(number));
        assert_eq!(command.entry["extent"], json!([40, 30, 1]));
        assert_eq!(command.maps.len(), 12);
        assert!(command.first_rays.is_empty());
    }
    let map = |of: &dyn Fn(u32, u32) -> u32| -> Vec<u32> {
        (0..30)
            .flat_map(|y| (0..40).map(move |x| (x, y)))
            .map(|(x, y)| of(x, y))
            .collect()
    };
    let left = |x: u32, number: u32| if x < 10 { number } else { 0 };
    let [traced, plain, alone] = &commands[..] else {
        panic!("three passes");
    };
    for (name, expected) in [
        ("primitives", map(&|x, _| 1 + u32::from(x < 20))),
        ("failed_tests", map(&|x, _| u32::from(x < 20))),
        ("fragment_shaders", map(&|_, _| 1)),
        ("rays", map(&|_, y| 1 + y % 3)),
        ("steps", map(&|x, y| (1 + y % 3) * (1 + left(x, 1)))),
        ("box_tests", map(&|_, y| 1 + y % 3)),
        ("primitive_tests", map(&|x, y| left(x, 1 + y % 3))),
        ("any_hit_candidates", map(&|_, _| 0)),
        ("nan_rays", map(&|_, _| 0)),
    ] {
        assert_eq!(traced.map(name), expected, "{name}");
    }
    assert!(traced.map("nanoseconds").iter().any(|&time| time > 0));
    assert_eq!(traced.entry["structures"][0]["active_instances"], 1);
    for (command, shaders) in [(plain, 1), (alone, 0)] {
        assert_eq!(command.map("primitives"), [1; 1200]);
        assert_eq!(command.map("failed_tests"), [0; 1200]);
        assert_eq!(command.map("fragment_shaders"), [shaders; 1200]);
        assert_eq!(command.map("rays"), [0; 1200]);
    }
}

/// 2²³ invocations of a compute shader, one in 2¹⁶ of which traces a ray.
fn large(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let output = gpu.buffer(4 * 128);
    let source = r"
    #extension GL_EXT_ray_query : require
    layout(local_size_x = 1024) in;
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1, std430) buffer R { uint results[]; };
    void main() {
        uint id = gl_GlobalInvocationID.x;
        if (id % 65536u != 0u) { return; }
        rayQueryEXT query;
        rayQueryInitializeEXT(query, world, 0u, 0xff, vec3(0.25, 0.25, 0), 0.0, vec3(0, 0, 1), 9.0);
        rayQueryProceedEXT(query);
        results[id / 65536u] = 1u + rayQueryGetIntersectionTypeEXT(query, true);
    }";
    let bindings: [(u32, &[Bound]); 2] = [(0, &[world.into()]), (1, &[output.into()])];
    gpu.compute_with(source, &bindings, [1 << 13, 1, 1]);
    output.read()
}

#[test]
fn large_launches_are_sampled() {
    if !is_tuff() {
        return;
    }
    let commands = captured("large", &[]);
    let entry = &commands[0].entry;
    assert_eq!(entry["extent"], json!([1 << 23, 1, 1]));
    assert_eq!(
        (&entry["step"], &entry["size"]),
        (&json!([2, 1, 1]), &json!([1 << 22, 1, 1]))
    );
    let rays = commands[0].map("rays");
    let by_place = (0..1 << 22).map(|place| u32::from(place % (1 << 15) == 0));
    assert!(rays.iter().copied().eq(by_place));
}

/// Seventy commands.
fn many(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0.25, 0.25, 0), 0.0, vec3(0, 0, 1), 9.0, 0);
        results[gl_LaunchIDEXT.x] += 1u;
    }";
    let output = gpu.buffer(4);
    let case = Case::with_words(raygen).bind(world).bind(output);
    let (rays, table) = (gpu.rays(&case), case.table());
    let regions = gpu.regions(&rays, &table);
    gpu.run(|commands| {
        for _ in 0..70 {
            gpu.record_trace(commands, &rays, &regions, [1, 1, 1]);
            gpu.barrier(commands);
        }
    });
    output.read()
}

#[test]
fn commands_past_the_limit_are_dropped() {
    if !is_tuff() {
        return;
    }
    let commands = captured("many", &[]);
    assert_eq!(commands.len(), 64);
    let numbers = commands
        .iter()
        .map(|command| command.entry["command"].as_u64());
    assert!(numbers.eq((0..64).map(Some)));
    // Nothing is presented: all is in frame 0.
    assert_eq!(
        captured("many", &[("TUFF_CAPTURE_FRAMES", "1..2")]).len(),
        0
    );
}

#[test]
fn a_program_that_dies_leaves_what_was_captured() {
    if !is_tuff() {
        return;
    }
    let folder = folder("die");
    let path = folder.to_string_lossy();
    let output = child("die", &[("TUFF_CAPTURE", &path)]);
    assert!(!output.status.success());
    let commands = read(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    assert_eq!(commands.len(), 1);
}

#[test]
fn what_cannot_be_written_is_told_once() {
    if !is_tuff() {
        return;
    }
    let run = |path: &Path, named: &Path| {
        let output = child("many", &[("TUFF_CAPTURE", &path.to_string_lossy())]);
        assert!(output.status.success(), "{output:?}");
        assert_eq!(results(&output), results(&child("many", &[])));
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(text.matches("TUFF_CAPTURE").count(), 1, "{text}");
        assert!(text.contains(&*named.to_string_lossy()), "{text}");
        text
    };
    let file = folder("no-folder");
    std::fs::write(&file, "a file").expect("a temporary file");
    let text = run(&file.join("inside"), &file);
    assert!(text.contains("nothing is captured"), "{text}");
    let _ = std::fs::remove_file(&file);

    // The list can be written, but no map.
    let folder = folder("no-maps");
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    std::fs::write(folder.join("command-0000"), "a file").expect("a temporary file");
    let text = run(&folder, &folder);
    assert!(text.contains("the capture ends here"), "{text}");
    assert_eq!(read(&folder).len(), 0);
    let _ = std::fs::remove_dir_all(&folder);
}

/// No file may grow beyond a few blocks, as on a disk that is full: the maps of bytes are written,
/// that of words is not.
#[cfg(unix)]
#[test]
fn a_full_disk_ends_the_capture() {
    if !is_tuff() {
        return;
    }
    let folder = folder("full");
    let alone = results(&child("triangle", &[]));
    let mut child = Command::new("/bin/sh");
    let program = std::env::current_exe().expect("this program");
    let limited = "trap '' XFSZ; ulimit -f 4; exec \"$0\" --exact work_in_a_child --nocapture";
    child.arg("-c").arg(limited).arg(program);
    child.env(CHILD, "triangle").env("TUFF_CAPTURE", &folder);
    let output = child.output().expect("a shell");
    assert!(output.status.success(), "{output:?}");
    assert_eq!(results(&output), alone);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(text.matches("the capture ends here").count(), 1, "{text}");
    assert_eq!(read(&folder).len(), 0, "the list is whole");
    let part = |entry: std::io::Result<std::fs::DirEntry>| {
        let path = entry.expect("an entry").path();
        path.extension().is_some_and(|it| it == "part")
    };
    let maps = std::fs::read_dir(folder.join("command-0000")).expect("a folder");
    assert!(!maps.into_iter().any(part), "parts of files are removed");
    let _ = std::fs::remove_dir_all(&folder);
}
