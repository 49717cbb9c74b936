//! `TUFF_CAPTURE_PIXEL`: the rays of one invocation, what they met and why not, the shaders with
//! their payloads, and the binding table as it was read; expected from where the triangles are.

mod limits;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};
use tuff_tests::*;

/// Says in a child what to do there.
const CHILD: &str = "TUFF_TEST_CAPTURE";

/// A folder of its own for a test's capture.
fn folder(name: &str) -> PathBuf {
    let name = format!("tuff-capture-{}-{name}", std::process::id());
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
    let gpu = Gpu::without_validation().with("a driver that captures rays", Gpu::is_tuff);
    gpu.is_some()
}

/// The lines in which a child tells its results.
fn results(output: &Output) -> Vec<String> {
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let lines = text.lines().filter_map(|line| line.split_once("results: "));
    lines.map(|(_, words)| words.to_owned()).collect()
}

/// Captures work in a child: the text, and the commands in JSON.
fn captured(what: &str, pixel: &str, more: &[(&str, &str)]) -> (String, Vec<Value>) {
    let folder = folder(&format!("{what}-{}", pixel.replace(',', "-")));
    let path = folder.to_string_lossy().into_owned();
    let mut variables = vec![("TUFF_CAPTURE_PIXEL", pixel), ("TUFF_CAPTURE", &path)];
    variables.extend(more);
    let output = child(what, &variables);
    assert!(output.status.success(), "{output:?}");
    // The same results as without.
    assert_eq!(results(&output), results(&child(what, &[])));
    assert_ne!(results(&output), [""; 0]);
    let read = read(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    read
}

fn read(folder: &Path) -> (String, Vec<Value>) {
    let text = std::fs::read_to_string(folder.join("pixel.txt")).expect("pixel.txt");
    let json = std::fs::read_to_string(folder.join("pixel.json")).expect("pixel.json");
    let mut all: Vec<Value> = serde_json::from_str(&json).expect("an array in JSON");
    assert_eq!(all.remove(0)["version"], 1);
    (text, all)
}

fn bits(values: &[f32]) -> Value {
    values.iter().map(|value| json!(value.to_bits())).collect()
}

/// A triangle at a height, which rays along z at (0.25, 0.25) meet with these weights.
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
        Some("triangles") => triangles(&gpu),
        Some("boxes") => boxes(&gpu),
        Some("callables") => callables(&gpu),
        Some("queries") => queries(&gpu),
        Some("hit objects") => hit_objects(&gpu),
        Some("stride") => wrong_stride(&gpu),
        Some("die") => {
            triangles(&gpu);
            std::process::abort();
        }
        Some("many") => limits::many(&gpu),
        Some("stopped") => limits::stopped(&gpu),
        other => panic!("{other:?}"),
    };
    println!("results: {words:?}");
}

const CLOSEST: &str = r"
    layout(location = 0) rayPayloadInEXT vec2 payload;
    layout(location = 1) rayPayloadEXT float inner;
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    void main() {
        inner = 1.5;
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, -2), 10.0, 1);
        payload.y = gl_HitTEXT + inner;
    }";

/// Twelve invocations trace one ray each. On its line: a triangle before its start, one in an
/// instance that the mask hides, one that the any-hit shader ignores, its hit, and one behind. The
/// closest-hit shader traces another one, which misses.
fn triangles(gpu: &Gpu) -> Vec<u32> {
    let not_opaque = vk::GeometryFlagsKHR::empty();
    let hidden = gpu.bottom(&[Geometry::opaque(&triangle(1.0))]);
    let others = [triangle(0.25), triangle(4.0), triangle(3.0)].concat();
    let shown = gpu.bottom(&[
        Geometry::triangles(&triangle(2.0), not_opaque),
        Geometry::opaque(&others),
    ]);
    let world = gpu.top(&[
        Instance {
            mask: 0xf0,
            ..Instance::of(hidden)
        },
        Instance {
            mask: 0x0f,
            custom_index: 7,
            table_offset: 3,
            ..Instance::of(shown)
        },
    ]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT vec2 payload;
    void main() {
        payload = vec2(gl_LaunchIDEXT.xy);
        traceRayEXT(world, 0u, 0x0f, 1, 2, 1, vec3(0.25, 0.25, 0), 0.5, vec3(0, 0, 1), 100.0, 0);
        uint index = gl_LaunchIDEXT.x + 4u * gl_LaunchIDEXT.y;
        results[2u * index] = floatBitsToUint(payload.x);
        results[2u * index + 1u] = floatBitsToUint(payload.y);
    }";
    let any_hit = r"
    layout(location = 0) rayPayloadInEXT vec2 payload;
    void main() { payload.x += 1.0; ignoreIntersectionEXT; }";
    let miss = "layout(location = 1) rayPayloadInEXT float inner; void main() { inner = 9.0; }";
    let output = gpu.buffer(4 * 24);
    let case = Case::new(&format!("{WORLD}{RESULTS}{raygen}"))
        .miss(miss)
        .hit(CLOSEST)
        .hit_group()
        .any_hit(any_hit)
        .recursion(2)
        .bind(world)
        .bind(output);
    let (unused, closest) = (Record::default(), Record::of(2));
    let mut hit = vec![unused.clone(); 8];
    (hit[4], hit[6]) = (Record::of(3), closest);
    // Of another region.
    hit[7] = Record::of(1);
    let table = Table {
        raygen: Record::of(0),
        miss: vec![Record::of(1), Record::of(1)],
        hit,
        callable: vec![],
    };
    gpu.trace(&gpu.rays(&case), &table, [4, 3, 1]);
    output.read()
}

#[test]
fn a_ray_tells_what_it_met_and_why_not() {
    if !is_tuff() {
        return;
    }
    let (text, commands) = captured("triangles", "2,1", &[]);
    let [command] = &commands[..] else {
        panic!("{commands:?}");
    };
    assert_eq!(command["kind"], "trace");
    assert_eq!(command["extent"], json!([4, 3, 1]));
    assert_eq!(command["invocation"], json!([2, 1, 0]));
    let rays = command["rays"].as_array().expect("rays");
    assert_eq!(rays.len(), 2, "{rays:#?}");
    let outer = &rays[0];
    let expected = json!({
        "ray": 0, "parent": null, "depth": 1, "instruction": "trace",
        "origin": [0.25, 0.25, 0.0], "direction": [0.0, 0.0, 1.0],
        "t_min": 0.5, "t_max": 100.0, "flags": 0, "flag_names": [], "cull_mask": 15,
        "sbt_offset": 1, "sbt_stride": 2, "miss_index": 1, "record": 6,
        "payload_before": bits(&[2.0, 1.0]), "payload_after": bits(&[3.0, 12.0]),
        "more_met": 0, "report_is_cut": false,
    });
    for (key, value) in expected.as_object().expect("an object") {
        assert_eq!(&outer[key], value, "{key} of {outer:#}");
    }
    assert_eq!(outer["traced_by"]["stage"], "RayGeneration");
    // By distance: t, instance, geometry, primitive, outcome.
    let met = outer["met"].as_array().expect("a list");
    let places: Vec<Value> = (met.iter())
        .map(|it| {
            json!([
                it["t"],
                it["instance"],
                it["geometry"],
                it["primitive"],
                it["outcome"]
            ])
        })
        .collect();
    let expected = [
        json!([0.25, 1, 1, 0, "before t_min"]),
        json!([1.0, 0, 0, 0, "culled by mask"]),
        json!([2.0, 1, 0, 0, "ignored"]),
        json!([3.0, 1, 1, 2, "committed"]),
        json!([4.0, 1, 1, 1, "behind the hit"]),
    ];
    assert_eq!(places, expected, "{met:#?}");
    for it in met {
        assert_eq!(it["barycentrics"], json!([0.25, 0.25]));
        assert_eq!(it["primitive_kind"], "triangle");
    }
    assert_eq!(
        (&met[1]["instance_mask"], &met[1]["opaque"]),
        (&json!(0xf0), &json!(true))
    );
    assert_eq!(
        (&met[2]["custom_index"], &met[2]["opaque"]),
        (&json!(7), &json!(false))
    );
    assert_eq!(
        (&met[2]["record"], &met[2]["asked"]),
        (&json!(4), &json!(0))
    );
    let any_hit = &met[2]["shader"];
    assert_eq!(any_hit["stage"], "AnyHit");
    assert_eq!(any_hit["payload_before"], bits(&[2.0, 1.0]));
    assert_eq!(any_hit["payload_after"], bits(&[3.0, 1.0]));
    let closest = &outer["shader"];
    assert_eq!(
        (&closest["stage"], &closest["entry_point"]),
        (&json!("ClosestHit"), &json!("main"))
    );
    assert_eq!(closest["payload_before"], bits(&[3.0, 1.0]));
    assert_eq!(closest["payload_after"], bits(&[3.0, 12.0]));
    assert_eq!(outer["hit"]["t"], 3.0);

    let inner = &rays[1];
    assert_eq!((&inner["parent"], &inner["depth"]), (&json!(0), &json!(2)));
    assert_eq!(inner["traced_by"]["stage"], "ClosestHit");
    assert_eq!((&inner["hit"], &inner["met"]), (&Value::Null, &json!([])));
    assert_eq!(inner["shader"]["stage"], "Miss");
    assert_eq!(inner["payload_before"], bits(&[1.5]));
    assert_eq!(inner["payload_after"], bits(&[9.0]));

    for part in [
        "ray 0, traced by RayGeneration shader",
        "t = 1.0: triangle 0 of geometry 0, instance 0 (custom index 0)",
        "culled by mask 0xf0",
        "hit at t = 3.0, record 6: ClosestHit shader",
        "payload before: 2.0 1.0",
        "payload after: 3.0 12.0",
        "ray 1 in a shader of ray 0",
    ] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
}

#[test]
fn a_binding_table_tells_how_it_was_used() {
    if !is_tuff() {
        return;
    }
    let (text, commands) = captured("triangles", "0,0,0", &[]);
    let table = &commands[0]["table"];
    let record = |region: &str, index: usize| {
        let record = &table[region]["records"][index];
        assert_eq!(record["index"], index);
        json!([
            record["names"],
            record["candidates"],
            record["calls"],
            record["used"]
        ])
    };
    // Each of the twelve invocations traces two rays.
    assert_eq!(record("ray_generation", 0), json!(["a group", 0, 12, true]));
    assert_eq!(record("miss", 0), json!(["a group", 0, 12, true]));
    assert_eq!(record("miss", 1), json!(["a group", 0, 0, false]));
    assert_eq!(record("hit", 4), json!(["a group", 12, 0, true]));
    assert_eq!(record("hit", 5), json!(["zeros", 0, 0, false]));
    assert_eq!(record("hit", 6), json!(["a group", 0, 12, true]));
    assert_eq!(record("hit", 7), json!(["of another region", 0, 0, false]));
    let hit = &table["hit"];
    assert_eq!(
        (&hit["record_count"], &hit["stride"]),
        (&json!(8), &json!(32))
    );
    assert_eq!((&hit["size"], &hit["outside"]), (&json!(256), &json!([])));
    let group = &hit["records"][4]["group"];
    assert_eq!(
        (&group["group"], &group["kind"]),
        (&json!(3), &json!("triangles"))
    );
    assert_eq!(group["any_hit"]["stage"], "AnyHit");
    assert_eq!(group["closest_hit"], Value::Null);
    for part in [
        "hit region at 0x",
        "8 records, stride 32, size 256",
        "5: zeros, an unused group (never looked up)",
        "(candidates: 12, calls: 0)",
        "which cannot be called from this region (never looked up)",
    ] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
}

/// A box whose intersection shader reports three hits: the any-hit shader ignores the first, the
/// second counts, the third is beyond the interval. The ray ends before another box.
fn boxes(gpu: &Gpu) -> Vec<u32> {
    let boxes = [
        [0.0, 0.0, 5.0, 1.0, 1.0, 6.0],
        [0.0, 0.0, 1.0, 1.0, 1.0, 2.0],
    ];
    let bottom = gpu.bottom(&[Geometry::boxes(&boxes, vk::GeometryFlagsKHR::empty())]);
    let world = gpu.top(&[Instance::of(bottom)]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 100u;
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0.5, 0.5, 0), 0.0,
            vec3(0, 0, 1), 50.0, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let intersection = r"
    hitAttributeEXT uint own;
    void main() {
        if (gl_PrimitiveID == 1) {
            own = 40u; reportIntersectionEXT(1.5, 4u);
            own = 50u; reportIntersectionEXT(1.75, 5u);
            own = 60u; reportIntersectionEXT(1000.0, 6u);
        }
    }";
    let any_hit = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    hitAttributeEXT uint own;
    void main() { payload += 1u; if (gl_HitKindEXT == 4u) { ignoreIntersectionEXT; } }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    hitAttributeEXT uint own;
    void main() { payload = 1000u * own + payload; }";
    let case = Case::with_words(raygen)
        .hit(closest)
        .any_hit(any_hit)
        .intersection(intersection);
    case.words(gpu, world, [20, 1, 1], 20)
}

#[test]
fn reports_of_intersection_shaders_have_their_verdicts() {
    if !is_tuff() {
        return;
    }
    let (text, commands) = captured("boxes", "17,0", &[]);
    let ray = &commands[0]["rays"][0];
    let met = ray["met"].as_array().expect("a list");
    let of = |primitive: u32| {
        let mut found = met.iter().filter(|it| it["primitive"] == primitive);
        found.next().unwrap_or_else(|| panic!("{met:#?}"))
    };
    let (near, far) = (of(1), of(0));
    assert_eq!(
        (&near["outcome"], &near["primitive_kind"]),
        (&json!("committed"), &json!("box"))
    );
    assert_eq!(near["t"], Value::Null, "a box has no distance");
    assert_eq!(near["shader"]["stage"], "Intersection");
    let reports: Vec<Value> = (near["reports"].as_array().expect("reports").iter())
        .map(|it| json!([it["t"], it["hit_kind"], it["attributes"][0], it["verdict"]]))
        .collect();
    let expected = [
        json!([1.5, 4, 40, "ignored"]),
        json!([1.75, 5, 50, "committed"]),
        json!([1000.0, 6, 60, "outside of the interval"]),
    ];
    assert_eq!(reports, expected);
    let any_hit = &near["reports"][1]["any_hit"];
    assert_eq!(
        (&any_hit["payload_before"], &any_hit["payload_after"]),
        (&json!([101]), &json!([102]))
    );
    // Whether its shader was asked depends on the walk: it reports nothing.
    let outcomes = ["not reached", "not reported"];
    assert!(
        outcomes.contains(&far["outcome"].as_str().unwrap_or("")),
        "{far:#}"
    );
    assert_eq!(ray["attributes"][0], 50);
    assert_eq!(
        (&ray["hit"]["t"], &ray["hit"]["hit_kind"]),
        (&json!(1.75), &json!(5))
    );
    assert_eq!(ray["shader"]["payload_before"], json!([102]));
    assert_eq!(ray["payload_after"], json!([50_102]));
    assert!(
        text.contains("reported t = 1.75, kind 5: committed"),
        "{text}"
    );
}

/// A callable that calls another one; one index is past the end of the region.
fn callables(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let raygen = r"
    layout(location = 3) callableDataEXT uvec2 data;
    void main() {
        data = uvec2(gl_LaunchIDEXT.x, 5u);
        executeCallableEXT(1u, 3);
        executeCallableEXT(9u, 3);
        results[gl_LaunchIDEXT.x] = data.y;
    }";
    let leaf = r"
    layout(location = 0) callableDataInEXT uvec2 data;
    void main() { data.y = 3u * data.x; }";
    let caller = r"
    layout(location = 0) callableDataInEXT uvec2 data;
    layout(location = 1) callableDataEXT uvec2 inner;
    void main() {
        inner = uvec2(data.x + 1u, 0u);
        executeCallableEXT(0u, 1);
        data.y += inner.y;
    }";
    let case = Case::with_words(raygen).callable(leaf).callable(caller);
    case.words(gpu, world, [40, 1, 1], 40)
}

#[test]
fn callables_have_their_data() {
    if !is_tuff() {
        return;
    }
    let (_, commands) = captured("callables", "30,0", &[]);
    assert_eq!(commands[0]["rays"], json!([]));
    let calls = commands[0]["calls"].as_array().expect("calls");
    let data: Vec<Value> = (calls.iter())
        .map(|call| {
            let shader = &call["shader"];
            json!([
                call["index"],
                shader["payload_before"],
                shader["payload_after"]
            ])
        })
        .collect();
    let expected = [
        json!([1, [30, 5], [30, 98]]),
        json!([0, [31, 0], [31, 93]]),
        json!([9, null, null]),
    ];
    assert_eq!(data, expected);
    let region = &commands[0]["table"]["callable"];
    assert_eq!(
        region["outside"],
        json!([{ "index": 9, "candidates": 0, "calls": 40 }])
    );
    let calls: Vec<&Value> = (region["records"].as_array().expect("records").iter())
        .map(|record| &record["calls"])
        .collect();
    assert_eq!(calls, [40, 40]);
}

/// Queries of compute invocations; workgroups of 4 x 2. Of three triangles the first is confirmed
/// where the shader wants it, the second never, the third is opaque.
const QUERY: &str = r"
    #extension GL_EXT_ray_query : require
    layout(local_size_x = 4, local_size_y = 2) in;
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1, std430) buffer R { float results[]; };
    void main() {
        uvec2 id = gl_GlobalInvocationID.xy;
        rayQueryEXT query;
        rayQueryInitializeEXT(query, world, 0u, 0xff,
            vec3(0.25, 0.25, -float(id.x)), 0.0, vec3(0, 0, 1), 1000.0);
        while (rayQueryProceedEXT(query)) {
            float t = rayQueryGetIntersectionTEXT(query, false) - float(id.x);
            if (t == 1.0 && id.y == 3u) { rayQueryConfirmIntersectionEXT(query); }
        }
        results[id.x + 12u * id.y] = rayQueryGetIntersectionTEXT(query, true);
    }";

fn queries(gpu: &Gpu) -> Vec<u32> {
    let not_opaque = vk::GeometryFlagsKHR::empty();
    let world = gpu.scene(&[
        Geometry::triangles(&[triangle(1.0), triangle(2.0)].concat(), not_opaque),
        Geometry::opaque(&triangle(3.0)),
    ]);
    let output = gpu.buffer(4 * 12 * 4);
    let bindings: [(u32, &[Bound]); 2] = [(0, &[world.into()]), (1, &[output.into()])];
    gpu.compute_with(QUERY, &bindings, [3, 2, 1]);
    output.read()
}

#[test]
fn ray_queries_of_compute_shaders_are_captured() {
    if !is_tuff() {
        return;
    }
    // Rays start at z = -5: distances are 6, 7 and 8.
    for (pixel, expected) in [
        (
            "5,3",
            [
                json!([6.0, "committed"]),
                json!([7.0, "behind the hit"]),
                json!([8.0, "behind the hit"]),
            ],
        ),
        (
            "5,2",
            [
                json!([6.0, "ignored"]),
                json!([7.0, "ignored"]),
                json!([8.0, "committed"]),
            ],
        ),
    ] {
        let (text, commands) = captured("queries", pixel, &[]);
        let [command] = &commands[..] else {
            panic!("{commands:?}");
        };
        assert_eq!(
            (&command["kind"], &command["extent"]),
            (&json!("dispatch"), &json!([12, 4, 1]))
        );
        let rays = command["rays"].as_array().expect("rays");
        assert_eq!(rays.len(), 1, "{rays:#?}");
        assert_eq!(rays[0]["instruction"], "ray query");
        assert_eq!(rays[0]["traced_by"]["stage"], "Compute");
        assert_eq!(rays[0]["origin"], json!([0.25, 0.25, -5.0]));
        let met = rays[0]["met"].as_array().expect("a list");
        let outcomes: Vec<Value> = (met.iter())
            .map(|it| match it["outcome"].as_str() {
                // Whether the second is asked after the first was confirmed, and before, depends on
                // the walk.
                Some("ignored") if pixel == "5,3" => json!([it["t"], "behind the hit"]),
                _ => json!([it["t"], it["outcome"]]),
            })
            .collect();
        assert_eq!(outcomes, expected, "{pixel}: {met:#?}");
        assert!(text.contains("ray 0 of a ray query"));
    }
}

/// Hit objects: traced, then executed.
fn hit_objects(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(2.0))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 3u;
        hitObjectNV object;
        hitObjectTraceRayNV(object, world, 0u, 0xff, 0, 0, 0, vec3(0.25, 0.25, 0), 0.0,
            vec3(0, 0, 1), 9.0, 0);
        hitObjectExecuteShaderNV(object, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let closest =
        "layout(location = 0) rayPayloadInEXT uint payload; void main() { payload *= 7u; }";
    let head = "#extension GL_NV_shader_invocation_reorder : require\n";
    let case = Case::with_words(raygen).hit(closest).head(head);
    case.words(gpu, world, [20, 1, 1], 20)
}

#[test]
fn hit_objects_are_traced_and_executed() {
    if !is_tuff() {
        return;
    }
    let (_, commands) = captured("hit objects", "19,0", &[]);
    let rays = commands[0]["rays"].as_array().expect("rays");
    let kinds: Vec<&Value> = rays.iter().map(|ray| &ray["instruction"]).collect();
    assert_eq!(kinds, ["hit object trace", "hit object execute"]);
    assert_eq!(
        (&rays[0]["shader"], &rays[0]["hit"]["t"]),
        (&Value::Null, &json!(2.0))
    );
    assert_eq!(rays[0]["met"][0]["outcome"], "committed");
    assert_eq!(
        (&rays[1]["parent"], &rays[1]["hit"]["t"]),
        (&Value::Null, &json!(2.0))
    );
    assert_eq!(rays[1]["payload_before"], json!([3]));
    assert_eq!(rays[1]["payload_after"], json!([21]));
}

/// Two hit groups, whose records have data: 64 bytes each. The stride that the command is given is
/// that of a handle.
fn wrong_stride(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[
        Geometry::opaque(&triangle(1.0)),
        Geometry::opaque(&triangle(2.0).map(|[x, y, z]| [x + 2.0, y, z])),
    ]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 0u;
        vec3 origin = vec3(0.25 + 2.0 * float(gl_LaunchIDEXT.x), 0.25, 0);
        traceRayEXT(world, 0u, 0xff, 0, 1, 0, origin, 0.0, vec3(0, 0, 1), 50.0, 0);
        results[gl_LaunchIDEXT.x] = payload;
    }";
    let hit = |letter: u32| {
        format!(
            "layout(location = 0) rayPayloadInEXT uint payload;
            layout(shaderRecordEXT, std430) buffer Own {{ uint own[8]; }};
            void main() {{ payload = own[0] + {letter}u; }}"
        )
    };
    let output = gpu.buffer(8);
    let case = Case::with_words(raygen).hit(&hit(1)).hit(&hit(2));
    let case = case.bind(world).bind(output);
    let table = Table {
        hit: vec![Record::with(2, &[100u32; 8]), Record::with(3, &[200u32; 8])],
        ..case.table()
    };
    let rays = gpu.rays(&case);
    let mut regions = gpu.regions(&rays, &table);
    assert_eq!(regions[2].stride, 64);
    regions[2].stride = 32;
    gpu.run(|commands| gpu.record_trace(commands, &rays, &regions, [2, 1, 1]));
    output.read()
}

#[test]
fn a_wrong_stride_shows_in_the_table() {
    if !is_tuff() {
        return;
    }
    let (text, commands) = captured("stride", "1,0", &[]);
    let region = &commands[0]["table"]["hit"];
    let records: Vec<Value> = (region["records"].as_array().expect("records").iter())
        .map(|it| json!([it["index"], it["names"], it["group"]["group"], it["calls"]]))
        .collect();
    // The second hit group's ray finds what is data of the first.
    let expected = [
        json!([0, "a group", 2, 1]),
        json!([1, "no group of this pipeline", null, 1]),
        json!([2, "a group", 3, 0]),
        json!([3, "no group of this pipeline", null, 0]),
    ];
    assert_eq!(records, expected);
    let ray = &commands[0]["rays"][0];
    assert_eq!((&ray["record"], &ray["shader"]), (&json!(1), &Value::Null));
    assert!(
        text.contains("hit at t = 2.0, record 1: no shader runs"),
        "{text}"
    );
    let line = "1: the handle of no group of this pipeline (calls: 1)";
    assert!(text.contains(line), "{text}");
    assert_eq!(missing_quotes("Finding a wrong stride", &text), [""; 0]);
}
