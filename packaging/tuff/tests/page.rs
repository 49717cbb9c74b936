//! `tuff view`: the pictures of a capture's maps, and its page in Chromium.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

/// The capture's size.
const SIZE: [u32; 3] = [40, 20, 1];
/// The pixel whose path was captured.
const PIXEL: [u32; 2] = [12, 7];

/// A folder of its own for a test.
fn folder(name: &str) -> PathBuf {
    let name = format!("tuff-view-{}-{name}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(folder.join("command-0000")).expect("a temporary folder");
    folder
}

fn view(folder: &Path) -> std::process::Output {
    let mut tuff = Command::new(env!("CARGO_BIN_EXE_tuff"));
    tuff.arg("view").arg(folder).arg("--no-open");
    tuff.output().expect("tuff runs")
}

/// A pixel's number of rays, and of nanoseconds.
fn numbers(x: u32, y: u32) -> [u32; 2] {
    [(x + y) % 7, 1000 * x + 100_000 * y]
}

/// The head of a file that NumPy reads, version 1.0 of its format.
fn npy_head(descr: &str, shape: &str) -> Vec<u8> {
    let mut head = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    while (head.len() + 11) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((head.len() as u16).to_le_bytes());
    file.extend(head.bytes());
    file
}

/// A file in NumPy's format.
fn npy(descr: &str, width: usize, which: usize) -> Vec<u8> {
    let [x, y, z] = SIZE;
    let mut file = npy_head(descr, &format!("{z}, {y}, {x}"));
    for y in 0..y {
        for x in 0..x {
            file.extend(&numbers(x, y)[which].to_le_bytes()[..width]);
        }
    }
    file
}

/// Floats as NumPy writes them.
fn floats(shape: &str, rows: impl Iterator<Item = [f32; 6]>) -> Vec<u8> {
    let mut file = npy_head("<f4", &format!("{shape}, 6"));
    file.extend(rows.flatten().flat_map(f32::to_le_bytes));
    file
}

/// A capture of one command with three maps and a path.
fn capture(name: &str) -> PathBuf {
    let folder = folder(name);
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).expect("a file");
    write("command-0000/rays.npy", &npy("|u1", 1, 0));
    write("command-0000/nanoseconds.npy", &npy("<u4", 4, 1));
    // A camera without perspective: the first ray of each second pixel, through the middle of two.
    let lines = (0..10).flat_map(|y| (0..20).map(move |x| (x, y)));
    let lines = lines.map(|(x, y)| [2.0 * x as f32, 2.0 * y as f32, 0.0, 0.0, 0.0, 1.0]);
    write("command-0000/first_rays.npy", &floats("1, 10, 20", lines));
    let boxes = [
        [0.0, 0.0, 0.0, 40.0, 20.0, 5.0],
        [1.0, 1.0, 0.0, 9.0, 9.0, 2.0],
    ];
    write("boxes-1.npy", &floats("2", boxes.into_iter()));
    let map = |name: &str, of: &str, ty: &str, file: Value| {
        let mut map = json!({ "name": name, "of": of, "most": 1, "sum": 1, "type": ty });
        map["file"] = file;
        map
    };
    let maps = json!([{ "version": 1, "program": "demo </script>" }, {
        "command": 0, "frame": 3, "kind": "trace", "pipeline": "scene",
        "first": [0, 0, 0], "extent": SIZE, "step": [1, 1, 1], "size": SIZE, "stopped": false,
        "structures": [{
            "address": "0x100", "kind": "instances", "active_instances": 3, "bytes": 1280,
            "depth": 1, "left_out_of_file": 0, "file": "structure-7.glb",
            "flags": ["PREFER_FAST_TRACE"], "build_nanoseconds": 2_500_000, "is_update": true,
            "boxes": { "file": "boxes-1.npy", "levels": [
                { "boxes": 1, "kept": 1 }, { "boxes": 1000, "kept": 1 },
            ] },
            "bottom_levels": [{
                "address": "0x200", "kind": "triangles", "primitives": 4321, "geometries": 1,
                "instances": 3, "bytes": 99, "depth": 2, "nodes": 5, "flags": ["LOW_MEMORY"],
                "build_nanoseconds": 1_500_000, "is_update": false,
            }],
        }],
        "maps": [
            map("rays", "ray", "|u1", json!("command-0000/rays.npy")),
            map("steps", "ray", "|u1", Value::Null),
            map("nanoseconds", "run", "<u4", json!("command-0000/nanoseconds.npy")),
        ],
        "first_rays": {
            "file": "command-0000/first_rays.npy", "step": [2, 2, 1], "size": [20, 10, 1],
        },
    }]);
    write("maps.json", maps.to_string().as_bytes());
    let [x, y] = PIXEL;
    let path = json!([{ "version": 1 }, {
        "command": 0, "frame": 3, "kind": "trace", "extent": SIZE, "invocation": [x, y, 0],
        "rays": [{
            "parent": null, "instruction": "trace", "origin": [12.0, 7.0, 0.0],
            "direction": [0.0, 0.0, 1.0], "hit": { "t": 2.5 }, "shader": { "stage": "ClosestHit" },
            "met": [{ "t": 2.5, "primitive_kind": "triangle", "primitive": 4, "geometry": 0,
                "instance": 9, "outcome": "committed" }],
        }, {
            "parent": 0, "instruction": "trace", "origin": [12.0, 6.5, 2.5],
            "direction": [1.0, 0.0, 0.0], "hit": { "t": 20.25 }, "met": [],
        }, {
            "parent": 1, "instruction": "trace", "origin": [32.25, 6.5, 2.5],
            "direction": [0.0, 0.0, "nan"], "hit": null, "met": [],
        }],
        "table": { "hit": {
            "address": "0x300", "stride": 32, "size": 64, "record_count": 2, "records": [
                { "index": 0, "names": "a group", "candidates": 0, "calls": 1, "used": true,
                    "group": { "group": 2, "closest_hit": {
                        "stage": "ClosestHit", "name": "floor",
                    } } },
                { "index": 1, "names": "no group of this pipeline", "group": null, "used": false },
            ],
        } },
    }]);
    write("pixel.json", path.to_string().as_bytes());
    folder
}

#[test]
fn maps_become_pictures() {
    let folder = capture("pictures");
    let output = view(&folder);
    assert!(output.status.success(), "{output:?}");
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(told.trim_end().ends_with("index.html"), "{told}");
    let picture = fs::File::open(folder.join("command-0000/rays.png")).expect("a picture");
    let decoder = png::Decoder::new(std::io::BufReader::new(picture));
    let reader = decoder.read_info().expect("a PNG");
    assert_eq!(
        (reader.info().width, reader.info().height),
        (SIZE[0], SIZE[1])
    );
    assert!(
        !folder.join("command-0000/steps.png").exists(),
        "zeros have no picture"
    );
    let _ = fs::remove_dir_all(&folder);
}

#[test]
fn what_is_no_capture_is_refused() {
    let folder = folder("none");
    let output = view(&folder);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !output.status.success() && told.contains("has no capture"),
        "{told}"
    );
    for (maps, expected) in [
        ("[{\"version\": 1}", "reading"),
        (
            r#"[{"size":[2,2,1],"maps":[{"name":"rays","of":"ray","type":"|u1","file":"../x"}]}]"#,
            "outside",
        ),
        (
            r#"[{"size":[2,2,1],"maps":[{"name":"rays","of":"ray","type":"<f4","file":"x"}]}]"#,
            "type",
        ),
    ] {
        fs::write(folder.join("maps.json"), maps).expect("a file");
        let output = view(&folder);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            !output.status.success() && told.contains(expected),
            "{told}"
        );
        assert!(!folder.join("index.html").exists());
    }
    let _ = fs::remove_dir_all(&folder);
}

/// The first installed browser.
fn chromium() -> Option<PathBuf> {
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let paths = names
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    paths.into_iter().find(|path| path.is_file())
}

/// The first script of the page: it records errors. Synthetic pointer events cannot be captured.
const FIRST: &str = r#"<script>
window.problems = [];
addEventListener("error", (event) => problems.push(event.message));
addEventListener("unhandledrejection", (event) => problems.push(String(event.reason)));
console.error = (...words) => problems.push(words.join(" "));
HTMLCanvasElement.prototype.setPointerCapture = () => {};
</script>"#;

/// Performs a user's actions, and writes the results as JSON.
const LAST: &str = r#"<script type="module">
while (document.body.dataset.ready === undefined) {
  await new Promise((done) => setTimeout(done, 10));
}
const canvas = document.querySelector("figure[data-map=rays] canvas");
const at = (x, y) => {
  const box = canvas.getBoundingClientRect();
  const [right, down] = [((x + 0.5) * box.width) / 40, ((y + 0.5) * box.height) / 20];
  return { clientX: box.left + right, clientY: box.top + down };
};
const point = (kind, x, y) =>
  canvas.dispatchEvent(new PointerEvent(kind, { ...at(x, y), pointerId: 1, bubbles: true }));
const click = (x, y) => { point("pointerdown", x, y); point("pointerup", x, y); };
const press = (key, more) =>
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, ...more }));
const value = (map) => document.querySelector(`[data-value=${map}]`)?.textContent;
const text = (id) => document.getElementById(id).textContent;
const values = () => [text("place"), value("rays"), value("steps"), value("nanoseconds")];
const titles = [...document.querySelectorAll("figcaption b")].map((title) => title.textContent);
const result = { titles };
point("pointermove", 31, 17);
result.hover = values();
click(31, 17);
result.other = text("path");
press("ArrowLeft");
press("ArrowUp", { shiftKey: true });
result.keys = values();
click(12, 7);
const drawnPath = () => document.querySelector("[id=path] ol > li[title]");
for (let i = 0; i < 1000 && !drawnPath(); i++) {
  await new Promise((done) => setTimeout(done, 10));
}
result.path = text("path");
result.seen = [...document.querySelectorAll("[id=path] ol > li")].map((item) => item.title);
// The second ray's colour is on the line between the pixels where its ends are seen.
const line = at(22, 6);
const box = canvas.getBoundingClientRect();
const pixels = canvas.getContext("2d").getImageData(
  Math.round(((line.clientX - box.left) * canvas.width) / box.width),
  Math.round(((line.clientY - box.top) * canvas.height) / box.height) - 8, 1, 16).data;
result.line = false;
for (let i = 0; i < pixels.length; i += 4) {
  result.line ||= pixels[i] === 230 && pixels[i + 1] === 159 && pixels[i + 2] === 0;
}
const space = document.getElementById("space");
const boxes = space.toDataURL();
result.boxes = [text("space-told")];
const pressed = (key) => space.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
pressed("ArrowLeft");
result.turned = space.toDataURL() !== boxes;
pressed("PageDown");
result.boxes.push(text("space-told"));
press("+");
press("+");
const drawn = (name) => document.querySelector(`figure[data-map=${name}] canvas`).toDataURL();
const before = drawn("nanoseconds");
press("Home");
result.linked = before !== drawn("nanoseconds");
document.getElementById("colours").value = "cividis";
document.getElementById("colours").dispatchEvent(new Event("change"));
result.colours = before !== drawn("nanoseconds");
const drawings = [...document.querySelectorAll("canvas, svg")];
result.labels = drawings.every((one) => one.getAttribute("aria-label"));
result.structures = text("structures");
result.problems = problems;
const place = document.createElement("pre");
place.id = "result";
place.textContent = JSON.stringify(result);
document.body.replaceChildren(place);
</script>"#;

/// The first of the browsers that are installed; a line says where there is none.
fn browser(test: &str) -> Option<PathBuf> {
    let found = chromium();
    if found.is_none() {
        // The test program keeps what passing tests print, but not what is written past it.
        let line = format!("skipped: {test} needs Chromium\n");
        let _ = std::io::stderr().write_all(line.as_bytes());
    }
    found
}

/// A driven page as Chromium leaves it.
fn driven(chromium: &Path, folder: &Path, page: &str) -> String {
    let path = folder.join("driven.html");
    fs::write(&path, page).expect("a file");
    let mut browser = Command::new(chromium);
    browser.args(["--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]);
    browser.args(["--window-size=1280,900", "--virtual-time-budget=20000"]);
    let profile = folder.join("profile");
    browser.arg(format!("--user-data-dir={}", profile.display()));
    let page = format!("file://{}", path.display());
    let output = browser.arg(page).stderr(Stdio::null()).output();
    let dom = output.expect("Chromium runs").stdout;
    String::from_utf8_lossy(&dom).into_owned()
}

#[test]
fn the_page_shows_the_numbers_in_chromium() {
    let Some(chromium) = browser("the_page_shows_the_numbers_in_chromium") else {
        return;
    };
    let folder = capture("chromium");
    assert!(view(&folder).status.success());
    let page = fs::read_to_string(folder.join("index.html")).expect("the page");
    let page = page.replacen("<head>", &format!("<head>{FIRST}"), 1);
    let page = page.replacen("</body>", &format!("{LAST}</body>"), 1);
    let dom = driven(&chromium, &folder, &page);
    let _ = fs::remove_dir_all(&folder);
    let shown =
        (dom.split_once("<pre id=\"result\">")).and_then(|(_, rest)| rest.split_once("</pre>"));
    let Some((shown, _)) = shown else {
        panic!("the page did not come to its end: {dom}");
    };
    let shown = shown
        .replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&amp;", "&");
    let shown: Value = serde_json::from_str(&shown).expect("JSON");
    assert_eq!(shown["problems"], json!([]));
    assert_eq!(
        shown["titles"],
        json!(["Rays", "Traversal steps", "Nanoseconds"])
    );
    let values = |x: u32, y: u32| {
        let [rays, time] = numbers(x, y);
        // Numbers have commas.
        let time = format!("{time}");
        let (thousands, rest) = time.split_at(time.len() - 3);
        let time = match thousands.len() {
            4.. => {
                let (millions, thousands) = thousands.split_at(thousands.len() - 3);
                format!("{millions},{thousands},{rest}")
            }
            _ => format!("{thousands},{rest}"),
        };
        json!([format!("({x}, {y}, 0)"), rays.to_string(), "0", time])
    };
    assert_eq!(shown["hover"], values(31, 17));
    assert_eq!(shown["keys"], values(30, 7));
    let told = shown["other"].as_str().expect("text");
    assert!(told.contains("TUFF_CAPTURE_PIXEL=31,17,0 "), "{told}");
    assert!(told.contains("TUFF_CAPTURE_FRAMES=3 demo"), "{told}");
    let path = shown["path"].as_str().expect("text");
    assert!(path.contains("hit at t = 2.5, ClosestHit shader"), "{path}");
    assert!(
        path.contains("triangle 4 of geometry 0, instance 9: committed"),
        "{path}"
    );
    let structures = shown["structures"].as_str().expect("text");
    assert!(
        structures.contains("3 instances, 1,280 bytes"),
        "{structures}"
    );
    assert!(structures.contains("structure-7.glb"), "{structures}");
    for words in [
        "triangles4,32139921.50 ms",
        "0x200: LOW_MEMORY",
        "updated in 2.50 ms, PREFER_FAST_TRACE",
    ] {
        assert!(structures.contains(words), "{structures}");
    }
    for words in [
        "hit region at 0x300: 2 records, stride 32, size 64",
        "record 0: group 2: ClosestHit shader “floor” (candidates: 0, calls: 1)",
        "record 1: no group of this pipeline (never looked up)",
    ] {
        assert!(path.contains(words), "{path}");
    }
    assert!(
        path.starts_with("2 of 3 rays are drawn over the maps"),
        "{path}"
    );
    assert_eq!(
        shown["seen"],
        json!([
            "seen from (12, 7) to (12, 7)",
            "seen from (12, 6) to (32, 6)",
            "seen from (32, 6) to outside",
        ])
    );
    let boxes = |told: &str| {
        format!(
            "{told} of top level 0x100: the world, and 3 rays of the path; \
             those that miss are dashed."
        )
    };
    assert_eq!(
        shown["boxes"],
        json!([
            boxes("1 box, 1 level below the root"),
            boxes("1 of 1,000 boxes, 2 levels below the root"),
        ])
    );
    for key in ["linked", "colours", "labels", "line", "turned"] {
        assert_eq!(shown[key], true, "{key}");
    }
}

/// A capture of 1280 × 720 invocations, with as many maps as the driver writes of a trace.
fn large_capture(name: &str) -> PathBuf {
    const SIZE: [u32; 3] = [1280, 720, 1];
    let folder = folder(name);
    let shape = "1, 720, 1280";
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).expect("a file");
    let names = [
        ("rays", 1),
        ("steps", 2),
        ("box_tests", 2),
        ("primitive_tests", 2),
        ("any_hit_candidates", 1),
        ("box_candidates", 1),
        ("depth", 1),
        ("closest_hit_shaders", 1),
        ("miss_shaders", 1),
        ("callable_shaders", 1),
        ("any_hit_shaders", 1),
        ("intersection_shaders", 1),
        ("nanoseconds", 4),
    ];
    let maps = names.map(|(name, width)| {
        let ty = ["|u1", "<u2", "", "<u4"][width - 1];
        let mut bytes = npy_head(ty, shape);
        let mut noise = 1u32;
        for _ in 0..SIZE[0] * SIZE[1] {
            // Every map is as hard to pack as noise of five bits, or of ten.
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            bytes.extend(&(noise >> if width == 1 { 27 } else { 22 }).to_le_bytes()[..width]);
        }
        let file = format!("command-0000/{name}.npy");
        write(&file, &bytes);
        json!({ "name": name, "of": "ray", "most": 1023, "sum": 1, "type": ty, "file": file })
    });
    let command = json!({
        "command": 0, "frame": 0, "kind": "trace", "pipeline": "scene", "first": [0, 0, 0],
        "extent": SIZE, "step": [1, 1, 1], "size": SIZE, "stopped": false, "structures": [],
        "maps": maps, "first_rays": null,
    });
    write(
        "maps.json",
        json!([{ "version": 1 }, command]).to_string().as_bytes(),
    );
    folder
}

/// Tells on the console when the page is shown, by the clock of the browser.
const CLOCK: &str = r#"<script type="module">
while (document.body.dataset.ready === undefined) {
  await new Promise((done) => setTimeout(done, 5));
}
requestAnimationFrame(() => requestAnimationFrame(() => {
  console.log(`shown after ${performance.now()} ms`);
}));
</script>"#;

/// Milliseconds from the start of a page's navigation until it is shown.
fn opening_time(chromium: &Path, folder: &Path, page: &Path) -> f64 {
    let mut browser = Command::new(chromium);
    browser.args(["--headless", "--no-sandbox", "--disable-gpu"]);
    browser.args(["--enable-logging=stderr", "--remote-debugging-port=0"]);
    browser.arg(format!(
        "--user-data-dir={}",
        folder.join("profile").display()
    ));
    browser.arg(format!("file://{}", page.display()));
    let browser = browser.stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let mut browser = browser.expect("Chromium runs");
    let told = BufReader::new(browser.stderr.take().expect("its messages"));
    let (sender, receiver) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        let time = told.lines().map_while(Result::ok).find_map(|line| {
            let (_, rest) = line.split_once("shown after ")?;
            rest.split(' ').next()?.parse::<f64>().ok()
        });
        // The other end is gone after a minute.
        let _ = sender.send(time);
    });
    let time = receiver.recv_timeout(Duration::from_secs(60));
    browser.kill().expect("it can be ended");
    browser.wait().expect("it ends");
    reader.join().expect("no panic");
    (time.ok().flatten()).expect("the page is shown within a minute")
}

#[test]
fn a_capture_of_1280_by_720_opens_within_two_seconds() {
    let Some(chromium) = browser("a_capture_of_1280_by_720_opens_within_two_seconds") else {
        return;
    };
    let folder = large_capture("large");
    assert!(view(&folder).status.success());
    let path = folder.join("index.html");
    let page = fs::read_to_string(&path).expect("the page");
    let page = page.replacen("</body>", &format!("{CLOCK}</body>"), 1);
    fs::write(&path, page).expect("a file");
    // One of some: other tests run meanwhile.
    let mut tries = (0..12).map(|_| opening_time(&chromium, &folder, &path));
    let is_fast = tries.any(|milliseconds| milliseconds < 2000.0);
    let _ = fs::remove_dir_all(&folder);
    assert!(is_fast, "none of twelve tries took less than two seconds");
}

/// A program that dies before its first command is complete leaves a list without commands.
#[test]
fn a_capture_without_commands_is_a_page() {
    let folder = folder("empty");
    let list = r#"[{"version":1,"program":"demo"},{"dropped_commands":3}]"#;
    fs::write(folder.join("maps.json"), list).expect("a file");
    let output = view(&folder);
    assert!(output.status.success(), "{output:?}");
    let page = fs::read_to_string(folder.join("index.html")).expect("the page");
    if let Some(chromium) = browser("a_capture_without_commands_is_a_page") {
        let last = r#"<script type="module">
            document.body.dataset.problems = JSON.stringify(problems);
        </script>"#;
        let page = page.replacen("<head>", &format!("<head>{FIRST}"), 1);
        let page = page.replacen("</body>", &format!("{last}</body>"), 1);
        let dom = driven(&chromium, &folder, &page);
        assert!(dom.contains("data-problems=\"[]\""), "{dom}");
        assert!(dom.contains("No command that traces rays"), "{dom}");
    }
    let _ = fs::remove_dir_all(&folder);
}
