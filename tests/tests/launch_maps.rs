//! `TUFF_CAPTURE` without a pixel: what each invocation's rays cost, expected from where the
//! triangles are.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};
use tuff_tests::*;

/// Says in a child what to do there.
const CHILD: &str = "TUFF_TEST_MAPS";

/// Maps of the way that was taken: the other counts are those of each ray by itself.
const OF_THE_RUN: [&str; 3] = ["any_hit_shaders", "intersection_shaders", "nanoseconds"];

/// A folder of its own for a test's capture.
fn folder(name: &str) -> PathBuf {
    let name = format!("tuff-maps-{}-{name}", std::process::id());
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

/// A captured command: its entry in the list, and its maps by name.
struct Captured {
    entry: Value,
    /// JSON of the structures' files.
    scenes: Vec<Value>,
    maps: BTreeMap<String, Vec<u32>>,
}

impl Captured {
    fn map(&self, name: &str) -> &[u32] {
        &self.maps[name]
    }

    /// The maps that every machine has alike.
    fn alone(&self) -> BTreeMap<&str, &[u32]> {
        let maps = (self.maps.iter()).map(|(name, map)| (name.as_str(), map.as_slice()));
        maps.filter(|(name, _)| !OF_THE_RUN.contains(name))
            .collect()
    }
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

fn read(folder: &Path) -> Vec<Captured> {
    let json = std::fs::read_to_string(folder.join("maps.json")).expect("maps.json");
    let mut all: Vec<Value> = serde_json::from_str(&json).expect("an array in JSON");
    assert_eq!(all.remove(0)["version"], 1);
    let commands = all.into_iter().filter(|entry| entry["maps"].is_array());
    let commands = commands.map(|entry| {
        let sizes: Vec<u64> = serde_json::from_value(entry["size"].clone()).expect("three sizes");
        let count = sizes.iter().product::<u64>() as usize;
        let maps = entry["maps"].as_array().expect("a list").iter().map(|map| {
            let numbers = match map["file"].as_str() {
                None => vec![0; count],
                Some(file) => {
                    let bytes = std::fs::read(folder.join(file)).expect("a map's file");
                    numbers(&bytes, map["type"].as_str().expect("a type"), &sizes)
                }
            };
            assert_eq!(numbers.len(), count);
            assert_eq!(map["most"], json!(numbers.iter().max()), "{map}");
            let sum: u64 = numbers.iter().map(|&number| u64::from(number)).sum();
            assert_eq!(map["sum"], json!(sum), "{map}");
            let name = map["name"].as_str().expect("a name").to_owned();
            let expected = match OF_THE_RUN.contains(&&*name) {
                true => "run",
                false => "ray",
            };
            assert_eq!(map["of"], expected, "{map}");
            (name, numbers)
        });
        let maps = maps.collect();
        let structures = entry["structures"].as_array().expect("a list").iter();
        let scenes = structures.map(|it| gltf(&folder.join(it["file"].as_str().expect("a file"))));
        let scenes = scenes.collect();
        Captured {
            entry,
            scenes,
            maps,
        }
    });
    commands.collect()
}

/// The JSON of a binary glTF file.
fn gltf(path: &Path) -> Value {
    let bytes = std::fs::read(path).expect("a structure's file");
    assert_eq!(&bytes[..4], b"glTF");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    assert_eq!(word(8) as usize, bytes.len());
    serde_json::from_slice(&bytes[20..20 + word(12) as usize]).expect("JSON")
}

/// Numbers of a file as `numpy.load` reads them.
fn numbers(bytes: &[u8], descr: &str, sizes: &[u64]) -> Vec<u32> {
    let [width, height, depth] = sizes else {
        panic!("{sizes:?}");
    };
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let data = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let head = std::str::from_utf8(&bytes[10..data]).expect("it is ASCII");
    let shape = format!(
        "'descr': '{descr}', 'fortran_order': False, 'shape': ({depth}, {height}, {width}), "
    );
    assert!(head.contains(&shape), "{head} has {shape}");
    let size = descr[2..].parse().expect("bytes of a number");
    let number = |bytes: &[u8]| {
        let mut word = [0; 4];
        word[..size].copy_from_slice(bytes);
        u32::from_le_bytes(word)
    };
    bytes[data..].chunks(size).map(number).collect()
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
        Some("queries") => queries(&gpu),
        Some("many") => many(&gpu),
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
}

#[test]
fn counts_are_the_same_on_every_machine() {
    if !is_tuff() {
        return;
    }
    for what in ["triangle", "layers", "queries"] {
        let (same, expected) = captured_with(what, &[]);
        for more in [
            ("TUFF_THREADS", "1"),
            ("TUFF_THREADS", "2"),
            ("TUFF_WAVE", "1"),
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
