//! Mistakes that docs/debugging.md finds with a capture: what it shows of them.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use tuff_tests::*;

/// Says in a child what to do there.
const CHILD: &str = "TUFF_TEST_MISTAKE";

/// Pixels of a side.
const SIDE: u32 = 16;

/// Runs [`work_in_a_child`] in a process of its own.
fn child(what: &str, variables: &[(&str, &str)]) -> Output {
    let program = std::env::current_exe().expect("this program");
    let mut child = Command::new(program);
    child.args(["--exact", "work_in_a_child", "--nocapture"]);
    child.env(CHILD, what).envs(variables.iter().copied());
    let output = child.output().expect("this program runs again");
    assert!(output.status.success(), "{output:?}");
    output
}

/// The picture that a child draws.
fn picture(what: &str) -> Vec<u32> {
    let output = child(what, &[]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = text.lines().find_map(|line| line.split_once("picture: "));
    serde_json::from_str(line.expect("a picture").1).expect("numbers")
}

/// Captures what a child does: maps, and the path of a pixel as text and JSON.
fn captured(what: &str, index: usize) -> (Value, String, Value) {
    let name = format!("tuff-mistake-{}-{what}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    let path = folder.to_string_lossy().into_owned();
    child(what, &[("TUFF_CAPTURE", &path)]);
    let (x, y) = (index as u32 % SIDE, index as u32 / SIDE);
    let pixel = format!("{x},{y}");
    let variables = [("TUFF_CAPTURE", &*path), ("TUFF_CAPTURE_PIXEL", &pixel)];
    child(what, &variables);
    let json = |file: &Path| -> Vec<Value> {
        let text = std::fs::read_to_string(file).expect("a file of the capture");
        serde_json::from_str(&text).expect("an array in JSON")
    };
    let maps = json(&folder.join("maps.json"))[1].clone();
    let command = json(&folder.join("pixel.json"))[1].clone();
    let text = std::fs::read_to_string(folder.join("pixel.txt")).expect("the text");
    let _ = std::fs::remove_dir_all(&folder);
    // With `--nocapture`: what the page quotes.
    println!("{text}");
    (maps, text, command)
}

/// The sum of a map.
fn sum(maps: &Value, name: &str) -> u64 {
    let list = maps["maps"].as_array().expect("a list");
    let map = list.iter().find(|map| map["name"] == name);
    map.expect(name)["sum"].as_u64().expect("a sum")
}

fn is_tuff() -> bool {
    let gpu = Gpu::without_validation().with("a driver that captures rays", Gpu::is_tuff);
    gpu.is_some()
}

/// In a child.
#[test]
fn work_in_a_child() {
    let Some(what) = std::env::var_os(CHILD) else {
        return;
    };
    let gpu = Gpu::without_validation();
    let picture = match what.to_str() {
        Some("self-intersection") => floor(&gpu, 0.0),
        Some("no self-intersection") => floor(&gpu, 0.01),
        Some("opaque") => leaves(&gpu, vk::GeometryFlagsKHR::OPAQUE),
        Some("not opaque") => leaves(&gpu, vk::GeometryFlagsKHR::empty()),
        other => panic!("{other:?}"),
    };
    println!("picture: {picture:?}");
}

/// A floor that slopes, and a light above it, to which shadow rays start at their `t_min`. A pixel
/// is 1 where the light is seen.
fn floor(gpu: &Gpu, t_min: f32) -> Vec<u32> {
    let height = |x: f32, y: f32| 10.0 + 0.37 * x + 0.21 * y;
    let corner = |x: f32, y: f32| [x, y, height(x, y)];
    let floor = [
        corner(-50.0, -50.0),
        corner(90.0, -40.0),
        corner(-40.0, 90.0),
    ];
    let world = gpu.scene(&[Geometry::opaque(&floor)]);
    let raygen = format!(
        r"
    layout(location = 0) rayPayloadEXT float t;
    layout(location = 1) rayPayloadEXT uint is_lit;
    void main() {{
        vec2 at = (vec2(gl_LaunchIDEXT.xy) + 0.5) / 7.0;
        vec3 way = normalize(vec3(at, 3.0));
        t = -1.0;
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, way, 100.0, 0);
        vec3 hit = t * way;
        is_lit = 0u;
        traceRayEXT(world, gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipClosestHitShaderEXT,
            0xff, 0, 0, 1, hit, {t_min:?}, vec3(1, 2, -20) - hit, 1.0, 1);
        results[gl_LaunchIDEXT.x + {SIDE}u * gl_LaunchIDEXT.y] = is_lit;
    }}"
    );
    let hit = "layout(location = 0) rayPayloadInEXT float t; void main() { t = gl_HitTEXT; }";
    let lit = "layout(location = 1) rayPayloadInEXT uint is_lit; void main() { is_lit = 1u; }";
    let case = Case::with_words(&raygen).miss(lit).hit(hit);
    case.words(gpu, world, [SIDE, SIDE, 1], (SIDE * SIDE) as usize)
}

#[test]
fn self_intersections_hit_the_triangle_that_they_start_from() {
    if !is_tuff() {
        return;
    }
    // Nothing is between the floor and the light.
    let lit = picture("no self-intersection");
    assert!(lit.iter().all(|&is_lit| is_lit == 1));
    let speckled = picture("self-intersection");
    let dark = speckled.iter().position(|&is_lit| is_lit == 0);
    let dark = dark.expect("a dark pixel");
    assert!(speckled.contains(&1), "not all are dark");
    let (maps, text, command) = captured("self-intersection", dark);
    let rays = command["rays"].as_array().expect("a list");
    assert_eq!(rays.len(), 2);
    let (first, second) = (&rays[0]["hit"], &rays[1]["hit"]);
    for key in ["instance", "geometry", "primitive"] {
        assert_eq!(first[key], second[key], "{key} of {command}");
    }
    assert!(second["t"].as_f64() < Some(1e-5), "{command}");
    assert!(first["t"].as_f64() > Some(1.0), "{command}");
    let misses = speckled.iter().filter(|&&is_lit| is_lit == 1).count() as u64;
    assert_eq!(sum(&maps, "miss_shaders"), misses);
    assert!(text.contains("TerminateOnFirstHitKHR"), "{text}");
    assert_eq!(
        missing_quotes("Finding a self-intersection", &text),
        [""; 0]
    );
}

/// A leaf before a wall. The any-hit shader cuts holes into the leaf, through which the wall is
/// seen: a pixel is 1 plus the geometry.
fn leaves(gpu: &Gpu, flags: vk::GeometryFlagsKHR) -> Vec<u32> {
    let square = |z: f32| [[-9.0, -9.0, z], [90.0, -9.0, z], [-9.0, 90.0, z]];
    let world = gpu.scene(&[
        Geometry::triangles(&square(1.0), flags),
        Geometry::opaque(&square(2.0)),
    ]);
    let raygen = format!(
        r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {{
        payload = 0u;
        vec3 origin = vec3(vec2(gl_LaunchIDEXT.xy) + 0.5, 0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 100.0, 0);
        results[gl_LaunchIDEXT.x + {SIDE}u * gl_LaunchIDEXT.y] = payload;
    }}"
    );
    let hit = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    void main() { payload = 1u + gl_GeometryIndexEXT; }";
    let holes = r"
    void main() { if (gl_LaunchIDEXT.x % 2u == 0u) { ignoreIntersectionEXT; } }";
    let case = Case::with_words(&raygen).hit(hit).any_hit(holes);
    case.words(gpu, world, [SIDE, SIDE, 1], (SIDE * SIDE) as usize)
}

#[test]
fn opaque_geometries_have_no_candidates_for_any_hit_shaders() {
    if !is_tuff() {
        return;
    }
    let number = (SIDE * SIDE) as usize;
    assert_eq!(picture("not opaque"), [2, 1].repeat(number / 2));
    assert_eq!(picture("opaque"), vec![1; number]);
    let (maps, text, command) = captured("opaque", 0);
    for name in ["any_hit_candidates", "any_hit_shaders"] {
        assert_eq!(sum(&maps, name), 0, "{name}");
    }
    let met = &command["rays"][0]["met"][0];
    assert_eq!(met["outcome"], "committed");
    assert!(text.contains("opaque: committed"), "{text}");
    let (maps, mended, _) = captured("not opaque", 0);
    assert_eq!(sum(&maps, "any_hit_candidates"), number as u64);
    assert_eq!(sum(&maps, "any_hit_shaders"), number as u64);
    assert!(mended.contains("ignored"), "{mended}");
    let section = "Finding a missed any-hit";
    assert_eq!(missing_quotes(section, &(text + &mended)), [""; 0]);
}
