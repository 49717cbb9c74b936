//! `TUFF_TRACE`: the file is what Chrome's trace event format says (a JSON array of events; `X`
//! events have a time and a duration, and nest on each track; `M` events name tracks), also of a
//! program that dies.

use std::collections::HashMap;
use std::path::PathBuf;
use std::process::{Command, Output};

use ash::ext;
use serde_json::Value;
use tuff_tests::*;

/// Says in a child what to do there: `all` or `die`.
const CHILD: &str = "TUFF_TEST_TIMELINE";

fn file(name: &str) -> PathBuf {
    let name = format!("tuff-timeline-{}-{name}.json", std::process::id());
    std::env::temp_dir().join(name)
}

/// Runs [`work_in_a_child`] in a process of its own.
fn child(what: &str, trace: &str) -> Output {
    let program = std::env::current_exe().expect("this program");
    let mut child = Command::new(program);
    child.args(["--exact", "work_in_a_child", "--nocapture"]);
    child.env(CHILD, what).env("TUFF_TRACE", trace);
    child.output().expect("this program runs again")
}

fn is_tuff() -> bool {
    let gpu = Gpu::without_validation().with("a driver with a timeline", Gpu::is_tuff);
    gpu.is_some()
}

const FILL: &str = "
    layout(local_size_x = 32) in;
    layout(set = 0, binding = 0) buffer Data { uint data[]; };
    void main() { data[gl_GlobalInvocationID.x] = 7; }";

/// In a child: a dispatch between labels, a build, rays, a pass.
#[test]
fn work_in_a_child() {
    let Some(what) = std::env::var_os(CHILD) else {
        return;
    };
    let gpu = Gpu::without_validation();
    let debug = ext::debug_utils::Device::new(&gpu.instance, &gpu.device);
    let label = |name| vk::DebugUtilsLabelEXT::default().label_name(name);
    let data = gpu.buffer(4 * 32 * 40);
    let set = gpu.set_of(&[data.into()]);
    let kernel = gpu.kernel(FILL, &[set.layout]);
    gpu.name_object(kernel.pipeline, c"filling");
    let commands = gpu.record(|commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            debug.cmd_begin_debug_utils_label(commands, &label(c"warm-up"));
            debug.cmd_begin_debug_utils_label(commands, &label(c"inner \"part\""));
            gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], [5, 4, 2]);
            debug.cmd_end_debug_utils_label(commands);
            debug.cmd_insert_debug_utils_label(commands, &label(c"here"));
            debug.cmd_end_debug_utils_label(commands);
            debug.cmd_end_debug_utils_label(commands);
        }
    });
    gpu.name_object(commands, c"frame 7");
    gpu.submit(commands).expect("it runs");
    if what == "die" {
        std::process::abort();
    }
    let world = gpu.scene(&[Geometry::opaque(&layers(3))]);
    let raygen = "void main() { results[gl_LaunchIDEXT.x + 300 * gl_LaunchIDEXT.y] = 1; }";
    Case::with_words(raygen).words(&gpu, world, [300, 20, 1], 6000);
    let Some(gpu) = gpu.drawing() else {
        return;
    };
    let canvas = gpu.canvas(RGBA, 64, 48);
    gpu.name_object(canvas.view, c"picture");
    let pipeline = gpu.painting(&Painting::new(&gpu, COVER, WHITE, RGBA));
    gpu.name_object(pipeline, c"white");
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.draw_vertices(commands, 3);
        gpu.draw_vertices(commands, 3);
    });
}

/// An event with a duration.
#[derive(Clone, Debug)]
struct Event {
    name: String,
    category: String,
    track: u64,
    /// In nanoseconds.
    begin: i64,
    end: i64,
    arguments: Value,
}

/// Reads a file and checks it against the format.
fn read(path: &PathBuf) -> Vec<Event> {
    let text = std::fs::read_to_string(path).expect("the file is there");
    let _ = std::fs::remove_file(path);
    let all: Vec<Value> = serde_json::from_str(&text).expect("an array in JSON");
    let mut tracks: HashMap<u64, String> = HashMap::new();
    let mut events = Vec::new();
    let text_of = |event: &Value, key: &str| {
        let text = event[key].as_str();
        text.unwrap_or_else(|| panic!("{key} of {event}"))
            .to_owned()
    };
    for event in &all {
        let track = event["tid"].as_u64().expect("a track");
        assert!(event["pid"].is_u64(), "{event}");
        match text_of(event, "ph").as_str() {
            "M" => {
                let name = text_of(&event["args"], "name");
                match text_of(event, "name").as_str() {
                    "process_name" => assert_eq!(name, "Tuff"),
                    "thread_name" => assert_eq!(tracks.insert(track, name), None),
                    other => panic!("{other}"),
                }
            }
            "X" => {
                let time = |key: &str| {
                    let time = event[key].as_f64().expect("a number");
                    assert!(time >= 0.0, "{event}");
                    (time * 1e3).round() as i64
                };
                events.push(Event {
                    name: text_of(event, "name"),
                    category: text_of(event, "cat"),
                    track,
                    begin: time("ts"),
                    end: time("ts") + time("dur"),
                    arguments: event["args"].clone(),
                });
            }
            other => panic!("{other}"),
        }
    }
    let mut names: Vec<&String> = tracks.values().collect();
    names.sort();
    assert!(names.contains(&&"tuff-queue-0".to_owned()), "{names:?}");
    // On each track an event lies within another or apart from it. Times are exact to a nanosecond,
    // and the clock may stand still for one.
    for &track in tracks.keys() {
        let mut on_track: Vec<&Event> = events.iter().filter(|it| it.track == track).collect();
        on_track.sort_by_key(|event| (event.begin, -event.end));
        let mut open: Vec<&Event> = Vec::new();
        for event in on_track {
            while open.last().is_some_and(|outer| outer.end <= event.begin) {
                open.pop();
            }
            if let Some(outer) = open.last() {
                assert!(event.end <= outer.end + 1, "{event:?} leaves {outer:?}");
            }
            open.push(event);
        }
    }
    assert!(events.iter().all(|event| tracks.contains_key(&event.track)));
    events
}

/// The events of a category.
fn of<'a>(events: &'a [Event], category: &str) -> Vec<&'a Event> {
    let of = events.iter().filter(|event| event.category == category);
    of.collect()
}

/// Whether one event lies within another on the same track.
fn within(inner: &Event, outer: &Event) -> bool {
    inner.track == outer.track && outer.begin <= inner.begin && inner.end <= outer.end + 1
}

#[test]
fn the_file_has_every_kind_of_work_with_names_and_sizes() {
    if !is_tuff() {
        return;
    }
    let path = file("all");
    let output = child("all", &path.to_string_lossy());
    assert!(output.status.success(), "{output:?}");
    let events = read(&path);
    let named = |category: &str, name: &str| {
        let mut found = of(&events, category);
        found.retain(|event| event.name == name);
        assert_eq!(found.len(), 1, "{category} {name} in {events:#?}");
        found[0]
    };
    let list = named("command buffer", "frame 7");
    let (outer, inner) = (named("label", "warm-up"), named("label", "inner \"part\""));
    let dispatch = named("dispatch", "dispatch");
    let submissions = of(&events, "submission");
    assert!(
        submissions
            .iter()
            .any(|submission| within(list, submission))
    );
    assert!(within(outer, list) && within(inner, outer) && within(dispatch, inner));
    assert!(within(named("label", "here"), outer));
    assert_eq!(dispatch.arguments["groups"], serde_json::json!([5, 4, 2]));
    assert_eq!(
        dispatch.arguments["group size"],
        serde_json::json!([32, 1, 1])
    );
    let shader = dispatch.arguments["shader"].as_str().expect("a shader");
    assert!(shader.contains("pipeline \"filling\""), "{shader}");
    let rays = named("trace", "trace rays");
    assert_eq!(rays.arguments["extent"], serde_json::json!([300, 20, 1]));
    let builds = of(&events, "build");
    let primitives = |event: &&Event| {
        let structures = event.arguments["structures"].as_array().cloned();
        structures.is_some_and(|all| all.iter().any(|it| it["primitives"] == 3))
    };
    assert!(builds.iter().any(primitives), "{builds:?}");
    assert!(of(&events, "compilation").len() >= 5);
    assert!(!of(&events, "work").is_empty());
    let (passes, draws) = (of(&events, "pass"), of(&events, "draws"));
    if let [pass] = passes[..] {
        assert_eq!(pass.arguments["extent"], serde_json::json!([64, 48]));
        assert_eq!(
            pass.arguments["attachments"],
            serde_json::json!(["picture"])
        );
        let drawn = draws
            .iter()
            .find(|event| within(event, pass))
            .expect("draws");
        assert_eq!(drawn.arguments["draws"], 2);
        assert_eq!(drawn.arguments["vertices"], 6);
        assert_eq!(drawn.arguments["pipelines"], serde_json::json!(["white"]));
    } else {
        panic!("{passes:?}");
    }
}

#[test]
fn a_program_that_dies_leaves_the_submissions_before() {
    if !is_tuff() {
        return;
    }
    let path = file("die");
    let output = child("die", &path.to_string_lossy());
    assert!(!output.status.success());
    let events = read(&path);
    assert_eq!(of(&events, "dispatch").len(), 1);
    assert_eq!(of(&events, "submission").len(), 1);
}

/// One message, and the program goes on.
#[test]
fn a_file_that_cannot_be_written_is_told_once() {
    if !is_tuff() {
        return;
    }
    for path in ["/nowhere/at/all.json", "/dev/full"] {
        let output = child("all", path);
        assert!(output.status.success(), "{output:?}");
        let text = String::from_utf8_lossy(&output.stderr);
        let told: Vec<&str> = text
            .lines()
            .filter(|line| line.contains("TUFF_TRACE"))
            .collect();
        assert_eq!(told.len(), 1, "{text}");
        assert!(told[0].contains(path), "{told:?}");
    }
}

/// The first file of a name in the folders of programs.
fn program(names: &[&str]) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let paths = (names.iter()).flat_map(|name| folders.iter().map(move |it| it.join(name)));
    paths.into_iter().find(|path| path.is_file())
}

/// The page of speedscope, as `npm install --global speedscope` leaves it: its command is a link
/// into the package.
fn speedscope() -> Option<PathBuf> {
    let command = program(&["speedscope"])?.canonicalize().ok()?;
    let page = command.parent()?.join("../dist/release/index.html");
    page.canonicalize().ok()
}

/// speedscope reads the file in Chromium, in the way of its own command: each thread is a track.
#[test]
fn speedscope_shows_each_thread() {
    let chromium = program(&["chromium", "chromium-browser", "google-chrome"]);
    let tools = chromium.zip(speedscope());
    if !is_tuff() || !has_program("speedscope and Chromium", tools.is_some()) {
        return;
    }
    let Some((chromium, page)) = tools else {
        return;
    };
    let path = file("speedscope");
    assert!(child("all", &path.to_string_lossy()).status.success());
    let text = std::fs::read_to_string(&path).expect("the file is there");
    let _ = std::fs::remove_file(&path);
    let events: Vec<Value> = serde_json::from_str(&text).expect("an array in JSON");
    let folder = path.with_extension("folder");
    std::fs::create_dir_all(&folder).expect("a folder can be made");
    let script = folder.join("timeline.js");
    let literal = Value::from(text);
    let load = format!("speedscope.loadFileFromBase64(\"timeline.json\", btoa({literal}))");
    std::fs::write(&script, load).expect("a file");
    let mut browser = Command::new(chromium);
    browser.args([
        "--headless",
        "--no-sandbox",
        "--dump-dom",
        "--virtual-time-budget=20000",
    ]);
    browser.args([
        "--allow-file-access-from-files",
        "--enable-unsafe-swiftshader",
    ]);
    let profile = folder.join("profile");
    browser.arg(format!("--user-data-dir={}", profile.display()));
    let (page, script) = (page.display(), script.display());
    browser.arg(format!("file://{page}#localProfilePath={script}"));
    let output = browser.output().expect("Chromium runs");
    let _ = std::fs::remove_dir_all(&folder);
    let shown = String::from_utf8_lossy(&output.stdout);
    let names = (events.iter().filter(|event| event["name"] == "thread_name"))
        .filter_map(|event| event["args"]["name"].as_str());
    let threads: Vec<&str> = names.collect();
    assert!(threads.contains(&"tuff-queue-0"), "{threads:?}");
    for thread in threads {
        assert!(
            shown.contains(&format!(", {thread} (tid ")),
            "{thread}: {shown}"
        );
    }
    assert!(!shown.contains("Something went wrong"), "{shown}");
}
