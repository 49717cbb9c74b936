//! `NonSemantic.DebugPrintf` without a layer: each message comes once, in the order of invocations,
//! whatever the threads and waves. Where drivers print, and how, Vulkan leaves open: of others than
//! Tuff only results are checked.

use std::ffi::c_void;
use std::process::{Command, Stdio};
use std::sync::Mutex;

use ash::ext;
use tuff_tests::*;

/// Settings of Tuff that must change nothing.
const SETTINGS: [&[(&str, &str)]; 4] = [
    &[],
    &[("TUFF_WAVE", "1"), ("TUFF_TIER", "portable")],
    &[("TUFF_THREADS", "4"), ("TUFF_WAVE", "4")],
    &[("TUFF_THREADS", "1"), ("TUFF_NATIVE", "0")],
];

fn in_all_settings(test: &str) -> bool {
    SETTINGS.iter().any(|variables| alone(test, variables))
}

fn open() -> Option<Gpu> {
    Gpu::without_validation().with("a driver that prints messages of shaders", Gpu::is_tuff)
}

/// The messages that a messenger heard.
struct Listener {
    api: ext::debug_utils::Instance,
    messenger: vk::DebugUtilsMessengerEXT,
    heard: Box<Mutex<Vec<String>>>,
}

impl Listener {
    fn new(gpu: &Gpu) -> Listener {
        // SAFETY: the loader's initialisers only set up its own state.
        let entry = unsafe { ash::Entry::load() }.expect("there is a Vulkan loader");
        let api = ext::debug_utils::Instance::new(&entry, &gpu.instance);
        let heard = Box::<Mutex<Vec<String>>>::default();
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::INFO)
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(hear))
            .user_data((&raw const *heard).cast_mut().cast());
        // SAFETY: the callback keeps to its signature, and its data outlives the messenger.
        let messenger = unsafe { api.create_debug_utils_messenger(&info, None) };
        Listener {
            api,
            messenger: messenger.expect("vkCreateDebugUtilsMessengerEXT"),
            heard,
        }
    }

    fn take(&self) -> Vec<String> {
        std::mem::take(&mut *self.heard.lock().expect("no callback panics"))
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        // SAFETY: nothing runs any more, and the instance is still there.
        unsafe { self.api.destroy_debug_utils_messenger(self.messenger, None) };
    }
}

unsafe extern "system" fn hear(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    list: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the loader passes valid data, and `list` is the listener's mutex.
    unsafe {
        let text =
            |text: Option<&std::ffi::CStr>| text.unwrap_or(c"").to_string_lossy().into_owned();
        if (*data).message_id_name_as_c_str() == Some(c"WARNING-DEBUG-PRINTF")
            && let Ok(mut list) = (*list.cast::<Mutex<Vec<String>>>()).lock()
        {
            list.push(text((*data).message_as_c_str()));
        }
    }
    vk::FALSE
}

const HEAD: &str = "#extension GL_EXT_debug_printf : require\n";

/// Invocations of two dimensions, each of which prints twice; some print nothing.
const KERNEL: &str = r#"
layout(local_size_x = 4, local_size_y = 2) in;
layout(set = 0, binding = 0) buffer Data { uint data[]; };
void main() {
    uvec2 id = gl_GlobalInvocationID.xy;
    uint index = id.x + 12 * id.y;
    debugPrintfEXT("index %u, half %1.2f", index, 0.5 * float(index));
    if (index % 3 != 1) {
        debugPrintfEXT("%v2d and 0x%lx\n", ivec2(id) - 1, uint64_t(index) << 32);
    }
    data[index] = index * 7;
}"#;

/// The messages of [`KERNEL`] in three by two workgroups.
fn expected_of_kernel() -> Vec<String> {
    let mut expected = Vec::new();
    for (y, x) in (0..4i32).flat_map(|y| (0..12i32).map(move |x| (y, x))) {
        let index = x + 12 * y;
        let place = format!("invocation ({x}, {y}, 0), Compute shader, entry point \"main\"");
        let half = 0.5 * f64::from(index);
        expected.push(format!("{place}: index {index}, half {half:.2}"));
        if index % 3 != 1 {
            let (less, wide) = ([x - 1, y - 1], u64::from(index.cast_unsigned()) << 32);
            expected.push(format!("{place}: {}, {} and 0x{wide:x}", less[0], less[1]));
        }
    }
    expected
}

fn run_kernel(gpu: &Gpu) {
    let data = gpu.buffer(4 * 48);
    gpu.compute(&format!("{HEAD}{KERNEL}"), &[data], [3, 2, 1]);
    let results: Vec<u32> = (0..48).map(|index| index * 7).collect();
    assert_eq!(data.read::<u32>(), results);
}

#[test]
fn compute_shaders_print_in_the_order_of_invocations() {
    if !in_all_settings("compute_shaders_print_in_the_order_of_invocations") {
        return;
    }
    let gpu = Gpu::without_validation();
    let listener = gpu.is_tuff().then(|| Listener::new(&gpu));
    run_kernel(&gpu);
    if let Some(listener) = listener {
        assert_eq!(listener.take(), expected_of_kernel());
    }
}

/// A ray's shaders print between the messages of the shader that traced it.
#[test]
fn ray_tracing_shaders_print_in_the_order_of_launches() {
    if !in_all_settings("ray_tracing_shaders_print_in_the_order_of_launches") {
        return;
    }
    let Some(gpu) = open() else {
        return;
    };
    let raygen = r#"
layout(location = 0) rayPayloadEXT float payload;
layout(location = 1) callableDataEXT uint doubled;
void main() {
    debugPrintfEXT("before");
    payload = 0.5 + gl_LaunchIDEXT.x;
    traceRayEXT(world, 0, 0xFF, 0, 0, 0, vec3(0, 0, 100), 0.0, vec3(0, 0, 1), 1.0, 0);
    doubled = gl_LaunchIDEXT.y;
    executeCallableEXT(0, 1);
    debugPrintfEXT("after: %g and %u", payload, doubled);
}"#;
    let miss = r#"
layout(location = 0) rayPayloadInEXT float payload;
void main() { debugPrintfEXT("missed with %g", payload); payload *= 2; }"#;
    let callable = r#"
layout(location = 1) callableDataInEXT uint doubled;
void main() { doubled *= 2; debugPrintfEXT("called"); }"#;
    let world = gpu.scene(&[Geometry::opaque(&layers(1))]);
    let case = Case::new(&format!("{HEAD}{WORLD}{raygen}"))
        .miss(&format!("{HEAD}{miss}"))
        .callable(&format!("{HEAD}{callable}"))
        .bind(world);
    let listener = Listener::new(&gpu);
    case.trace(&gpu, [9, 5, 2]);
    let mut expected = Vec::new();
    for (z, y, x) in (0..2).flat_map(|z| (0..5).flat_map(move |y| (0..9).map(move |x| (z, y, x)))) {
        let mut print = |stage: &str, text: String| {
            let place = format!("launch ({x}, {y}, {z}), {stage} shader, entry point \"main\"");
            expected.push(format!("{place}: {text}"));
        };
        print("RayGeneration", "before".into());
        print("Miss", format!("missed with {}", f64::from(x) + 0.5));
        print("Callable", "called".into());
        let after = format!("after: {} and {}", 2 * x + 1, 2 * y);
        print("RayGeneration", after);
    }
    assert_eq!(listener.take(), expected);
}

/// Two triangles, of which the second covers a quarter of the first. Helper invocations and pixels
/// without a message print nothing; colours are those of the same shader without messages.
#[test]
fn drawing_shaders_print_and_the_picture_stays_the_same() {
    if !in_all_settings("drawing_shaders_print_and_the_picture_stays_the_same") {
        return;
    }
    let Some(gpu) = open().and_then(Gpu::drawing) else {
        return;
    };
    let vertex = r#"
void main() {
    vec2 at = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1 & 1);
    debugPrintfEXT("corner %1.0v2f", at);
    gl_Position = vec4((gl_InstanceIndex == 0 ? 4.0 : 2.0) * at - 1.0, 0.5, 1.0);
}"#;
    let fragment = r#"
layout(location = 0) out vec4 color;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    float slope = dFdx(float(at.x));
    if (at.y == 5 && at.x % 4 == 2) {
        debugPrintfEXT("slope %.1f", slope);
    }
    color = vec4(vec2(at), 10.0 * slope, 255.0) / 255.0;
}"#;
    const SIZE: u32 = 17;
    let draw = |head: &str, vertex: &str, fragment: &str| {
        let canvas = gpu.canvas(RGBA, SIZE, SIZE);
        let (vertex, fragment) = (format!("{head}{vertex}"), format!("{head}{fragment}"));
        let painting = Painting::new(&gpu, &vertex, &fragment, RGBA);
        let pipeline = gpu.painting(&painting);
        gpu.paint(&canvas, pipeline, |commands| {
            // SAFETY: the pipeline is bound inside of the pass.
            unsafe { gpu.device.cmd_draw(commands, 3, 2, 0, 0) };
        });
        gpu.colors(&canvas)
    };
    let listener = Listener::new(&gpu);
    let printed = draw(HEAD, vertex, fragment);
    let messages = listener.take();
    let silent = |text: &str| text.replace("debugPrintfEXT", "//");
    assert_eq!(printed, draw("", &silent(vertex), &silent(fragment)));
    assert_eq!(listener.take(), [""; 0]);
    let mut expected = Vec::new();
    for instance in 0..2 {
        for (vertex, at) in ["0, 0", "1, 0", "0, 1"].into_iter().enumerate() {
            expected.push(format!(
                "vertex {vertex}, instance {instance}, Vertex shader, entry point \"main\": corner {at}"
            ));
        }
    }
    // The first triangle covers the canvas; the second one x + y < 17 with centres at halves, so
    // that on row 5 it ends before column 11.
    for x in (0..SIZE).filter(|x| x % 4 == 2) {
        for _ in 0..if x < 11 { 2 } else { 1 } {
            expected.push(format!(
                "fragment ({x}, 5), primitive 0, Fragment shader, entry point \"main\": slope 1.0"
            ));
        }
    }
    assert_eq!(messages, expected);
}

/// Primitives enough for several threads share their vertices, which may run more than once: the
/// messages of a run stay together.
#[test]
fn messages_of_shared_vertices_stay_together() {
    if !in_all_settings("messages_of_shared_vertices_stay_together") {
        return;
    }
    let Some(gpu) = open().and_then(Gpu::drawing) else {
        return;
    };
    let vertex = format!(
        "{HEAD}{}",
        r#"
void main() {
    debugPrintfEXT("first");
    debugPrintfEXT("second");
    gl_Position = vec4(gl_VertexIndex & 1, gl_VertexIndex >> 1, 0.5, 1.0);
}"#
    );
    let indices: Vec<u32> = (0..3 * 5000).map(|index| index % 3).collect();
    let indices = gpu.buffer_with(&indices);
    let canvas = gpu.canvas(RGBA, 8, 8);
    let pipeline = gpu.painting(&Painting::new(&gpu, &vertex, WHITE, RGBA));
    let listener = Listener::new(&gpu);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.bind_indices(commands, &indices, vk::IndexType::UINT32);
        // SAFETY: the pipeline and the indices are bound inside of the pass.
        unsafe { gpu.device.cmd_draw_indexed(commands, 3 * 5000, 1, 0, 0, 0) };
    });
    let messages = listener.take();
    let each = messages.len() / 3;
    assert!(each >= 2 && messages.len() == 3 * each, "{messages:?}");
    for (index, message) in messages.iter().enumerate() {
        let start = format!("vertex {}, instance 0, ", index / each);
        let end = [": first", ": second"][index % 2];
        assert!(
            message.starts_with(&start) && message.ends_with(end),
            "{index}: {message}"
        );
    }
}

/// The opcodes that [`with_line`] looks at (SPIR-V, section 3.52).
const OP_STRING: u32 = 7;
const OP_LINE: u32 = 8;
const OP_EXT_INST_IMPORT: u32 = 11;
const OP_EXT_INST: u32 = 12;

/// Words of a literal string.
fn literal(text: &str) -> Vec<u32> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(bytes.len() / 4 * 4 + 4, 0);
    let words = bytes.chunks_exact(4);
    words
        .map(|word| u32::from_le_bytes(word.try_into().expect("four")))
        .collect()
}

/// Says that the messages of a module come from a line of a file.
fn with_line(words: &[u32], file: &str, line: u32) -> Vec<u32> {
    let id = words[3];
    let name = literal(file);
    let mut made = words[..5].to_vec();
    made[3] = id + 1;
    let (mut at, mut set, mut has_file) = (5, 0, false);
    while at < words.len() {
        let instruction = &words[at..at + (words[at] >> 16) as usize];
        let opcode = instruction[0] & 0xffff;
        if opcode == OP_EXT_INST_IMPORT && instruction[2..] == literal("NonSemantic.DebugPrintf") {
            set = instruction[1];
        }
        if opcode == OP_STRING && !has_file {
            has_file = true;
            made.extend([(name.len() as u32 + 2) << 16 | OP_STRING, id]);
            made.extend(&name);
        }
        if opcode == OP_EXT_INST && instruction[3] == set {
            made.extend([4 << 16 | OP_LINE, id, line, 9]);
        }
        made.extend(instruction);
        at += instruction.len();
    }
    assert!(has_file && set != 0, "a module with messages");
    made
}

/// A compute pipeline of a module whose name is "noise", from a cache.
fn kernel_from(gpu: &Gpu, words: &[u32], cache: vk::PipelineCache) -> Kernel {
    let layout = gpu.layout(&[]);
    let info = vk::ShaderModuleCreateInfo::default().code(words);
    // SAFETY: the structures outlive the calls; the module goes when the pipeline is made.
    let pipeline = unsafe {
        let module = gpu.device.create_shader_module(&info, None).unwrap();
        gpu.name_object(module, c"noise");
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(layout);
        let made = gpu.device.create_compute_pipelines(cache, &[info], None);
        gpu.device.destroy_shader_module(module, None);
        made.expect("vkCreateComputePipelines")[0]
    };
    gpu.keep_pipeline(pipeline);
    Kernel { pipeline, layout }
}

/// The message names the module and the line, also where the program comes from a cache, and the
/// mistake in a format.
#[test]
fn messages_say_where_they_come_from_and_what_is_wrong() {
    let Some(gpu) = open() else {
        return;
    };
    let source = r#"
void main() {
    debugPrintfEXT("%d", 1);
    debugPrintfEXT("%d %d", 1);
    debugPrintfEXT("%d", 1, 2);
    debugPrintfEXT("100 %% %s", 3);
}"#;
    let words = with_line(
        &glsl(Stage::Compute, &format!("{HEAD}{source}")),
        "noise.comp",
        12,
    );
    let listener = Listener::new(&gpu);
    let cache = gpu.pipeline_cache();
    for _ in 0..2 {
        let kernel = kernel_from(&gpu, &words, cache);
        gpu.dispatch::<u32>(kernel, &[], &[], [1, 1, 1]);
        let place =
            "invocation (0, 0, 0), Compute shader \"noise\", entry point \"main\", noise.comp:12:9";
        let expected = [
            "1",
            "1 <no argument for %d>",
            "1 <1 argument has no conversion>",
            "100 % <%s is not supported>",
        ];
        assert_eq!(
            listener.take(),
            expected.map(|text| format!("{place}: {text}"))
        );
    }
    // The same module with a format that is no string: the id of the import.
    let mut wrong = words.clone();
    let mut at = 5;
    let mut set = 0;
    while at < wrong.len() {
        match wrong[at] & 0xffff {
            OP_EXT_INST_IMPORT
                if wrong[at + 2..].starts_with(&literal("NonSemantic.DebugPrintf")) =>
            {
                set = wrong[at + 1];
            }
            OP_EXT_INST if wrong[at + 3] == set => wrong[at + 5] = set,
            _ => {}
        }
        at += (wrong[at] >> 16) as usize;
    }
    let kernel = gpu.kernel_of(&wrong, &[]);
    gpu.dispatch::<u32>(kernel, &[], &[], [1, 1, 1]);
    let messages = listener.take();
    assert_eq!(messages.len(), 4);
    for message in messages {
        assert!(
            message.ends_with(": <the format is not an OpString>"),
            "{message}"
        );
    }
}

/// Says in a child what to print: `kernel` or `layers`.
const CHILD: &str = "TUFF_TEST_PRINTF";

/// In a child: prints without a messenger.
#[test]
fn print_in_a_child() {
    let Some(what) = std::env::var_os(CHILD) else {
        return;
    };
    let gpu = Gpu::without_validation();
    match what.to_str() {
        Some("layers") => trace_layers(&gpu),
        _ => run_kernel(&gpu),
    }
}

/// Rays of many directions through layers that are not opaque, each of which is a candidate.
fn trace_layers(gpu: &Gpu) {
    let flags = vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION;
    let world = gpu.scene(&[Geometry::triangles(&layers(5), flags)]);
    let raygen = r"
void main() {
    vec3 to = vec3(float(gl_LaunchIDEXT.x) - 35.0, float(gl_LaunchIDEXT.y) - 5.0, 60.0);
    traceRayEXT(world, 0, 0xFF, 0, 0, 0, vec3(0), 0.0, to, 1.0, 0);
}";
    let payload = "layout(location = 0) rayPayloadEXT uint payload;\n";
    let any_hit = r#"
layout(location = 0) rayPayloadInEXT uint payload;
void main() {
    debugPrintfEXT("candidate %d", gl_PrimitiveID);
    ignoreIntersectionEXT;
}"#;
    Case::new(&format!("{HEAD}{WORLD}{payload}{raygen}"))
        .miss(MISS)
        .hit_group()
        .any_hit(&format!("{HEAD}{any_hit}"))
        .bind(world)
        .trace(gpu, [70, 11, 1]);
}

/// Lines of messages on standard error of a child with variables.
fn printed_by_child(what: &str, variables: &[(&str, &str)]) -> Vec<String> {
    let program = std::env::current_exe().expect("this program");
    let child = Command::new(program)
        .args(["--exact", "print_in_a_child", "--nocapture"])
        .envs(variables.iter().copied())
        .env(CHILD, what)
        .stdout(Stdio::null())
        .output()
        .expect("this program runs again");
    assert!(child.status.success(), "{}", child.status);
    let text = String::from_utf8_lossy(&child.stderr);
    let lines = text.lines();
    let lines = lines.filter(|line| line.contains(" shader, ") || line.contains("messages"));
    lines.map(str::to_owned).collect()
}

/// Vulkan leaves the order of a ray's candidates open; Tuff's is the same with every setting.
#[test]
fn candidates_print_in_the_same_order_with_every_setting() {
    if open().is_none() {
        return;
    }
    let all = SETTINGS.map(|variables| printed_by_child("layers", variables));
    assert_eq!(all[0].len(), 5 * 70 * 11);
    for (index, message) in all[0].iter().enumerate() {
        let (x, y) = (index / 5 % 70, index / 5 / 70);
        let start = format!("launch ({x}, {y}, 0), AnyHit shader, ");
        assert!(message.starts_with(&start), "{index}: {message}");
    }
    for other in &all[1..] {
        assert!(*other == all[0]);
    }
}

#[test]
fn without_a_messenger_messages_go_to_standard_error() {
    if open().is_none() {
        return;
    }
    let all = expected_of_kernel();
    assert_eq!(printed_by_child("kernel", &[]), all);
    assert_eq!(
        printed_by_child("kernel", &[("TUFF_DEBUG_PRINTF", "0")]),
        [""; 0]
    );
    // Lines and their ends.
    let room: usize = all[..5].iter().map(|line| line.len() + 1).sum();
    let room = (room + 20).to_string();
    for threads in ["1", "3"] {
        let limited = printed_by_child(
            "kernel",
            &[
                ("TUFF_DEBUG_PRINTF_BYTES", &room),
                ("TUFF_THREADS", threads),
            ],
        );
        assert_eq!(limited[..5], all[..5]);
        let rest = all.len() - 5;
        let last =
            format!("{rest} more messages of shaders are past TUFF_DEBUG_PRINTF_BYTES ({room})");
        assert_eq!(limited[5..], [last]);
    }
}
