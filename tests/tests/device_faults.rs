//! `VK_EXT_device_fault`: a device that was lost tells why, and where. What it tells is left to
//! drivers: of others than Tuff only its form is checked.

use ash::ext;
use tuff_tests::*;

/// An endless loop for the driver, which cannot know the buffer, past its seventh line.
const SPIN: &str = r"
layout(set = 0, binding = 0) buffer Data { uint data[]; };
void main() {
    while (data[0] == 0) { data[1] = data[1] + 1; }
    data[2] = 1;
}";

const LOST: Result<(), vk::Result> = Err(vk::Result::ERROR_DEVICE_LOST);

/// Where the loop is, in the debug information that the tests make.
const LOOP_LINE: u32 = 42;

/// A device that a test may lose.
fn open() -> Option<Gpu> {
    Gpu::without_validation().with("VK_EXT_device_fault", has_faults)
}

fn has_faults(gpu: &Gpu) -> bool {
    gpu.optional.fault.device_fault == vk::TRUE
}

/// A device's fault report.
struct Report {
    description: String,
    addresses: Vec<vk::DeviceFaultAddressInfoEXT>,
    vendor: Vec<vk::DeviceFaultVendorInfoEXT>,
}

/// Text that ends inside of its array.
fn text(chars: &[std::ffi::c_char]) -> String {
    let bytes: Vec<u8> = chars.iter().map(|&c| c.cast_unsigned()).collect();
    let text = std::ffi::CStr::from_bytes_until_nul(&bytes).expect("it ends");
    text.to_str().expect("it is UTF-8").to_owned()
}

/// Asks for so many infos, and checks what the counts and the result say of them.
fn ask(gpu: &Gpu, room: [u32; 2]) -> (Report, vk::Result) {
    let api = ext::device_fault::Device::new(&gpu.instance, &gpu.device);
    let mut counts = vk::DeviceFaultCountsEXT::default()
        .address_info_count(room[0])
        .vendor_info_count(room[1]);
    let mut addresses = vec![vk::DeviceFaultAddressInfoEXT::default(); room[0] as usize];
    let mut vendor = vec![vk::DeviceFaultVendorInfoEXT::default(); room[1] as usize];
    let mut info = vk::DeviceFaultInfoEXT {
        p_address_infos: addresses.as_mut_ptr(),
        p_vendor_infos: vendor.as_mut_ptr(),
        ..Default::default()
    };
    // SAFETY: there is room for what the counts say.
    let result = unsafe {
        (api.fp().get_device_fault_info_ext)(gpu.device.handle(), &mut counts, &mut info)
    };
    assert!(counts.address_info_count <= room[0] && counts.vendor_info_count <= room[1]);
    assert_eq!(counts.vendor_binary_size, 0, "the feature is off");
    addresses.truncate(counts.address_info_count as usize);
    vendor.truncate(counts.vendor_info_count as usize);
    let description = text(&info.description);
    (
        Report {
            description,
            addresses,
            vendor,
        },
        result,
    )
}

/// How much a device has to tell.
fn counts(gpu: &Gpu) -> [u32; 2] {
    let api = ext::device_fault::Device::new(&gpu.instance, &gpu.device);
    let mut counts = vk::DeviceFaultCountsEXT::default();
    // SAFETY: without infos the counts are asked for.
    let result = unsafe {
        let none = std::ptr::null_mut();
        (api.fp().get_device_fault_info_ext)(gpu.device.handle(), &mut counts, none)
    };
    assert_eq!(result, vk::Result::SUCCESS);
    assert_eq!(counts.vendor_binary_size, 0, "the feature is off");
    [counts.address_info_count, counts.vendor_info_count]
}

/// The whole report of a lost device; every way to ask for less says so.
fn report(gpu: &Gpu) -> Report {
    let all = counts(gpu);
    let (report, result) = ask(gpu, all);
    assert_eq!(result, vk::Result::SUCCESS);
    assert_eq!(
        [report.addresses.len() as u32, report.vendor.len() as u32],
        all
    );
    assert!(!report.description.is_empty());
    for address in &report.addresses {
        assert!(address.address_precision.is_power_of_two());
    }
    for info in &report.vendor {
        println!(
            "{} {:#x} {}",
            info.vendor_fault_code,
            info.vendor_fault_data,
            text(&info.description)
        );
    }
    println!("{}", report.description);
    for which in 0..2 {
        let mut room = all;
        if room[which] > 0 {
            room[which] -= 1;
            let (less, result) = ask(gpu, room);
            assert_eq!(result, vk::Result::INCOMPLETE);
            assert_eq!(
                [less.addresses.len() as u32, less.vendor.len() as u32],
                room
            );
        }
        let (more, result) = ask(gpu, all.map(|count| count + 3));
        assert_eq!(result, vk::Result::SUCCESS);
        assert_eq!([more.addresses.len() as u32, more.vendor.len() as u32], all);
    }
    report
}

/// Fails where a description lacks one of these.
#[track_caller]
fn says(description: &str, parts: &[&str]) {
    for part in parts {
        assert!(description.contains(part), "no {part:?} in {description:?}");
    }
}

/// Adds debug information to a module: what is inside of a loop comes from [`LOOP_LINE`] of a file,
/// all else of functions from lines that no loop is on.
fn with_lines(words: &[u32], file: &str) -> Vec<u32> {
    const SOURCE: u32 = 3;
    const NAME: u32 = 5;
    const MEMBER_NAME: u32 = 6;
    const STRING: u32 = 7;
    const LINE: u32 = 8;
    const FUNCTION: u32 = 54;
    const PARAMETER: u32 = 55;
    const FUNCTION_END: u32 = 56;
    const VARIABLE: u32 = 59;
    const PHI: u32 = 245;
    const LOOP_MERGE: u32 = 246;
    const SELECTION_MERGE: u32 = 247;
    const LABEL: u32 = 248;
    let id = words[3];
    let mut out = words[..5].to_vec();
    out[3] += 1;
    let (mut at, mut named, mut inside, mut after, mut line) = (5, false, false, 0, 1);
    let mut merged = false;
    while at < words.len() {
        let (opcode, count) = (words[at] & 0xffff, (words[at] >> 16) as usize);
        if !named && [SOURCE, NAME, MEMBER_NAME].contains(&opcode) {
            named = true;
            let mut text = file.as_bytes().to_vec();
            text.resize(file.len() / 4 * 4 + 4, 0);
            out.push((2 + text.len() as u32 / 4) << 16 | STRING);
            out.push(id);
            out.extend(
                text.chunks_exact(4)
                    .map(|word| u32::from_le_bytes(word.try_into().unwrap())),
            );
        }
        inside |= opcode == FUNCTION;
        inside &= opcode != FUNCTION_END;
        if opcode == LABEL && words[at + 1] == after {
            line = 90;
        }
        if opcode == LOOP_MERGE {
            (after, line) = (words[at + 1], LOOP_LINE);
        }
        // Nothing may stand between a merge and its branch, nor between labels, variables and phis.
        let first = [FUNCTION, PARAMETER, LABEL, VARIABLE, PHI].contains(&opcode);
        if inside && !first && !merged {
            out.extend([4 << 16 | LINE, id, line, 5]);
        }
        merged = [LOOP_MERGE, SELECTION_MERGE].contains(&opcode);
        out.extend(&words[at..at + count]);
        at += count;
    }
    assert!(named, "names or a source, before which strings stand");
    out
}

/// Makes a compute pipeline of a module that keeps its name.
fn named_kernel(gpu: &Gpu, words: &[u32], set: Set, names: [&std::ffi::CStr; 2]) -> Kernel {
    let layout = gpu.layout(&[set.layout]);
    let info = vk::ShaderModuleCreateInfo::default().code(words);
    // SAFETY: the structures outlive the calls; the module goes when the pipeline is made.
    let pipeline = unsafe {
        let module = gpu.device.create_shader_module(&info, None).unwrap();
        gpu.name_object(module, names[0]);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(layout);
        let cache = vk::PipelineCache::null();
        let made = gpu.device.create_compute_pipelines(cache, &[info], None);
        gpu.device.destroy_shader_module(module, None);
        made.expect("vkCreateComputePipelines")[0]
    };
    gpu.name_object(pipeline, names[1]);
    gpu.keep_pipeline(pipeline);
    Kernel { pipeline, layout }
}

fn dispatch(gpu: &Gpu, kernel: Kernel, set: Set) -> Result<(), vk::Result> {
    gpu.try_run(|commands| gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], [1, 1, 1]))
}

#[test]
fn a_hang_is_told_with_its_names_and_line() {
    let test = "a_hang_is_told_with_its_names_and_line";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let data = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[data.into()]);
    let words = with_lines(&glsl(Stage::Compute, SPIN), "shaders/spin.comp");
    let kernel = named_kernel(&gpu, &words, set, [c"spinner", c"spins for ever"]);
    assert_eq!(dispatch(&gpu, kernel, set), LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        let line = format!("shaders/spin.comp:{LOOP_LINE}");
        let parts = [
            "TUFF_TIMEOUT",
            "Compute",
            "\"spinner\"",
            "\"main\"",
            "\"spins for ever\"",
            &line,
        ];
        says(&report.description, &parts);
        assert!(report.addresses.is_empty());
        assert_eq!(report.vendor.len(), 1);
        says(&text(&report.vendor[0].description), &parts[1..]);
        assert_eq!(report.vendor[0].vendor_fault_code, 1);
    }
}

/// Without debug information there is no line; what a messenger hears is what the report says.
#[test]
fn a_messenger_hears_the_same() {
    let test = "a_messenger_hears_the_same";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = Gpu::validated_by_driver() else {
        return;
    };
    let Some(gpu) = gpu.with("VK_EXT_device_fault", has_faults) else {
        return;
    };
    let Some(gpu) = gpu.with("a driver that promises this", Gpu::is_tuff) else {
        return;
    };
    let data = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[data.into()]);
    let kernel = named_kernel(&gpu, &glsl(Stage::Compute, SPIN), set, [c"", c"p"]);
    assert_eq!(dispatch(&gpu, kernel, set), LOST);
    let report = report(&gpu);
    says(
        &report.description,
        &["Compute shader", "entry point \"main\"", "pipeline \"p\""],
    );
    assert!(!report.description.contains(':') || !report.description.contains(".comp"));
    let heard = gpu.take_complaints();
    assert_eq!(heard, [format!("device lost: {}", report.description)]);
}

#[test]
fn a_fragment_shader_that_hangs_is_told() {
    let test = "a_fragment_shader_that_hangs_is_told";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a graphics queue", Gpu::has_graphics) else {
        return;
    };
    let vertex = r"
    void main() {
        vec2 corner = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
        gl_Position = vec4(corner * 4.0 - 1.0, 0, 1);
    }";
    let fragment = r"
    layout(set = 0, binding = 0) readonly buffer Data { uint data[]; };
    layout(location = 0) out vec4 color;
    void main() {
        uint sum = 1;
        while (data[0] == 0) sum = sum * 3 + data[1];
        color = vec4(sum);
    }";
    let data = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[data.into()]);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let painting = Painting {
        layout: gpu.layout(&[set.layout]),
        ..Painting::new(&gpu, vertex, fragment, RGBA)
    };
    let stages = [
        (Stage::Vertex, glsl(Stage::Vertex, vertex)),
        (
            Stage::Fragment,
            with_lines(&glsl(Stage::Fragment, fragment), "spin.frag"),
        ),
    ];
    let flags = vk::PipelineCreateFlags::empty();
    let pipeline = gpu
        .try_painting(&painting, &stages, flags, std::ptr::null())
        .unwrap();
    gpu.name_object(pipeline, c"a painting");
    let pass = Pass::black(&canvas);
    let lost = gpu.try_run(|commands| {
        gpu.record_pass(commands, &pass, |commands| {
            gpu.look_at(commands, &canvas);
            gpu.bind(commands, pipeline);
            gpu.bind_set(commands, painting.layout, set.handle);
            gpu.draw_vertices(commands, 3);
        });
    });
    assert_eq!(lost, LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        let line = format!("spin.frag:{LOOP_LINE}");
        says(
            &report.description,
            &["TUFF_TIMEOUT", "Fragment", "\"a painting\"", &line],
        );
    }
}

/// A geometry shader that emits for ever: what it may emit is bounded, and so is its time.
#[test]
fn emission_without_an_end_is_told() {
    let test = "emission_without_an_end_is_told";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let has_stage = |gpu: &Gpu| gpu.has_graphics() && gpu.features.geometry_shader == vk::TRUE;
    let Some(gpu) = gpu.with("geometry shaders", has_stage) else {
        return;
    };
    let geometry = r"
    layout(triangles) in; layout(triangle_strip, max_vertices = 3) out;
    layout(set = 0, binding = 0) readonly buffer Data { uint data[]; };
    void main() {
        while (data[0] == 0) { gl_Position = vec4(data[1]); EmitVertex(); }
    }";
    let data = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[data.into()]);
    let canvas = gpu.canvas(RGBA, 16, 16);
    let painting = Painting {
        geometry: Some(geometry),
        layout: gpu.layout(&[set.layout]),
        ..Painting::new(&gpu, COVER, WHITE, RGBA)
    };
    let pipeline = gpu.painting(&painting);
    gpu.name_object(pipeline, c"a fountain");
    let lost = gpu.try_run(|commands| {
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, pipeline);
            gpu.bind_set(commands, painting.layout, set.handle);
            gpu.draw_vertices(commands, 3);
        });
    });
    assert_eq!(lost, LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        let expected = ["TUFF_TIMEOUT", "Geometry", "\"a fountain\""];
        says(&report.description, &expected);
    }
}

/// Patches of the highest level, as many as a draw can have: their memory is bounded, and so is
/// their time.
#[test]
fn patches_without_an_end_are_told() {
    let test = "patches_without_an_end_are_told";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let has_stages = |gpu: &Gpu| gpu.has_graphics() && gpu.features.tessellation_shader == vk::TRUE;
    let Some(gpu) = gpu.with("tessellation shaders", has_stages) else {
        return;
    };
    let control = r"
    layout(vertices = 1) out;
    void main() {
        gl_TessLevelOuter = float[](64.0, 64.0, 64.0, 64.0);
        gl_TessLevelInner = float[](64.0, 64.0);
    }";
    let evaluation = r"
    layout(quads) in;
    void main() { gl_Position = vec4(gl_TessCoord.xy * 2.0 - 1.0, 0.5, 1.0); }";
    let canvas = gpu.canvas(RGBA, 16, 16);
    let painting = Painting {
        tessellation: Some([control, evaluation]),
        control_points: 1,
        topology: vk::PrimitiveTopology::PATCH_LIST,
        ..Painting::new(&gpu, COVER, WHITE, RGBA)
    };
    let pipeline = gpu.painting(&painting);
    let lost = gpu.try_run(|commands| {
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, u32::MAX);
        });
    });
    assert_eq!(lost, LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        says(&report.description, &["TUFF_TIMEOUT"]);
    }
}

/// Task shaders that ask for more workgroups than there can be: their memory is bounded, and so is
/// their time.
#[test]
fn workgroups_without_an_end_are_told() {
    let test = "workgroups_without_an_end_are_told";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let features = gpu.optional.mesh_shader;
    let both = features.task_shader == vk::TRUE && features.mesh_shader == vk::TRUE;
    let Some(gpu) = gpu.with("mesh shaders", |gpu| gpu.has_graphics() && both) else {
        return;
    };
    let task = r"
    struct Payload { uint words[4000]; };
    taskPayloadSharedEXT Payload payload;
    void main() { payload.words[gl_WorkGroupID.x % 4000] = 1; EmitMeshTasksEXT(~0u, ~0u, ~0u); }";
    let mesh = r"
    layout(triangles, max_vertices = 3, max_primitives = 1) out;
    void main() { SetMeshOutputsEXT(0, 0); }";
    let canvas = gpu.canvas(RGBA, 16, 16);
    let painting = Painting {
        mesh: Some((Some(task), mesh)),
        ..Painting::new(&gpu, "", WHITE, RGBA)
    };
    let pipeline = gpu.painting(&painting);
    gpu.name_object(pipeline, c"a swarm");
    let commands_of_meshes = ash::ext::mesh_shader::Device::new(&gpu.instance, &gpu.device);
    let lost = gpu.try_run(|commands| {
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, pipeline);
            // SAFETY: the command buffer is being recorded.
            unsafe { commands_of_meshes.cmd_draw_mesh_tasks(commands, 1 << 22, 1, 1) };
        });
    });
    assert_eq!(lost, LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        says(&report.description, &["TUFF_TIMEOUT"]);
    }
}

/// Counts and indices beyond what a mesh shader declares: primitives are drawn as far as there
/// are any, and those with vertices that are not there are left out.
#[test]
fn mesh_outputs_out_of_range_are_left_out() {
    let Some(gpu) = open() else { return };
    // Undefined elsewhere.
    let both = gpu.is_tuff() && gpu.optional.mesh_shader.mesh_shader == vk::TRUE;
    let Some(gpu) = gpu.with("mesh shaders", |gpu| gpu.has_graphics() && both) else {
        return;
    };
    let mesh = r"
    layout(local_size_x = 32) in;
    layout(points, max_vertices = 8, max_primitives = 16) out;
    void main() {
        uint i = gl_LocalInvocationIndex;
        SetMeshOutputsEXT(1000, ~0u);
        gl_MeshVerticesEXT[i].gl_Position = vec4((float(i) + 0.5) / 8.0 - 1.0, -0.9, 0.5, 1.0);
        gl_MeshVerticesEXT[i].gl_PointSize = 1.0;
        gl_PrimitivePointIndicesEXT[i] = i == 2 ? ~0u : i;
    }";
    let canvas = gpu.canvas(RGBA, 16, 16);
    let painting = Painting {
        mesh: Some((None, mesh)),
        ..Painting::new(&gpu, "", WHITE, RGBA)
    };
    let pipeline = gpu.painting(&painting);
    let commands_of_meshes = ash::ext::mesh_shader::Device::new(&gpu.instance, &gpu.device);
    gpu.paint(&canvas, pipeline, |commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe { commands_of_meshes.cmd_draw_mesh_tasks(commands, 1, 1, 1) };
    });
    let drawn = |color: &[u8; 4]| *color == [255; 4];
    let found: Vec<usize> = (gpu.colors(&canvas).iter().enumerate())
        .filter(|(_, color)| drawn(color))
        .map(|(pixel, _)| pixel)
        .collect();
    assert_eq!(found, [0, 1, 3, 4, 5, 6, 7]);
}

#[test]
fn recursion_without_an_end_is_told_with_its_depth() {
    let Some(gpu) = open() else { return };
    let there = gpu.pipeline_properties.max_ray_recursion_depth >= 1;
    let Some(gpu) = gpu.with("VK_KHR_ray_tracing_pipeline", |_| there) else {
        return;
    };
    let case = Case::endless();
    let rays = gpu.rays(&case);
    gpu.name_object(rays.pipeline, c"deep");
    let regions = gpu.regions(&rays, &case.table());
    let lost = gpu.try_run(|commands| gpu.record_trace(commands, &rays, &regions, [16, 1, 1]));
    assert_eq!(lost, LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        says(
            &report.description,
            &["memory", "Callable shader", "\"deep\"", "shader calls deep"],
        );
        assert_eq!(report.vendor[0].vendor_fault_code, 2);
        let depth = report.vendor[0].vendor_fault_data;
        assert!(depth > 1000, "{depth}");
    }
}

/// Pages near zero are never mapped: a read gives zeros, a write is dropped, and both are told when
/// the loop is stopped.
#[test]
fn wild_addresses_are_told() {
    let test = "wild_addresses_are_told";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let source = r"
    layout(buffer_reference, buffer_reference_align = 4) buffer Word { uint word; };
    layout(set = 0, binding = 0) buffer Data { uint64_t wild[]; };
    void main() {
        uint read = Word(wild[0]).word;
        Word(wild[1]).word = 7;
        while (wild[2] == 0) wild[3] = wild[3] + read;
    }";
    let data = gpu.buffer_with(&[0x1230u64, 0x2340, 0, 0]);
    let set = gpu.set_of(&[data.into()]);
    let words = with_lines(&glsl(Stage::Compute, source), "wild.comp");
    let kernel = named_kernel(&gpu, &words, set, [c"", c""]);
    assert_eq!(dispatch(&gpu, kernel, set), LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        let found: Vec<_> = (report.addresses.iter())
            .map(|it| (it.address_type, it.reported_address, it.address_precision))
            .collect();
        let read = (vk::DeviceFaultAddressTypeEXT::READ_INVALID, 0x1230, 1);
        let write = (vk::DeviceFaultAddressTypeEXT::WRITE_INVALID, 0x2340, 1);
        assert_eq!(found, [read, write]);
        let codes = report
            .vendor
            .iter()
            .map(|it| (it.vendor_fault_code, it.vendor_fault_data));
        assert_eq!(
            codes.skip(1).collect::<Vec<_>>(),
            [(6, 0x1230), (7, 0x2340)]
        );
        says(
            &text(&report.vendor[1].description),
            &["Compute", "wild.comp:1"],
        );
    }
}

/// Wild addresses of draws, in a command before the one that hangs.
#[test]
fn earlier_wild_addresses_are_told() {
    let test = "earlier_wild_addresses_are_told";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a driver that goes on", Gpu::is_tuff) else {
        return;
    };
    let vertex = r"
    layout(buffer_reference, buffer_reference_align = 4) buffer Word { uint word; };
    void main() { gl_Position = vec4(Word(uint64_t(0x3450 + gl_InstanceIndex)).word, 0, 0, 1); }";
    let canvas = gpu.canvas(RGBA, 16, 16);
    let pipeline = gpu.painting(&Painting::new(&gpu, vertex, WHITE, RGBA));
    let pass = Pass::black(&canvas);
    gpu.draw(&pass, |commands| {
        gpu.look_at(commands, &canvas);
        gpu.bind(commands, pipeline);
        gpu.draw_vertices(commands, 3);
    });
    let data = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[data.into()]);
    let kernel = named_kernel(&gpu, &glsl(Stage::Compute, SPIN), set, [c"", c""]);
    assert_eq!(dispatch(&gpu, kernel, set), LOST);
    let report = report(&gpu);
    let found: Vec<_> = report
        .addresses
        .iter()
        .map(|it| it.reported_address)
        .collect();
    assert_eq!(found, [0x3450]);
    says(&text(&report.vendor[1].description), &["Vertex shader"]);
}

/// A device that is not lost may not be asked: an answer is a kindness.
#[test]
fn a_device_that_is_not_lost_tells_nothing() {
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a driver that promises this", Gpu::is_tuff) else {
        return;
    };
    assert_eq!(counts(&gpu), [0, 0]);
    let (report, result) = ask(&gpu, [2, 2]);
    assert_eq!(result, vk::Result::SUCCESS);
    assert!(report.addresses.is_empty() && report.vendor.is_empty());
}

/// The name of a stage's module, where the module is in the chain of the stage.
#[test]
fn names_in_chains_are_told() {
    let test = "names_in_chains_are_told";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    let Some(gpu) = open() else { return };
    let has_chains = |gpu: &Gpu| gpu.optional.maintenance5.maintenance5 == vk::TRUE;
    let Some(gpu) = gpu.with("VK_KHR_maintenance5", has_chains) else {
        return;
    };
    let data = gpu.buffer_with(&[0u32; 4]);
    let set = gpu.set_of(&[data.into()]);
    let words = glsl(Stage::Compute, SPIN);
    let mut module = vk::ShaderModuleCreateInfo::default().code(&words);
    let mut name = vk::DebugUtilsObjectNameInfoEXT {
        object_type: vk::ObjectType::SHADER_MODULE,
        ..vk::DebugUtilsObjectNameInfoEXT::default().object_name(c"in the chain")
    };
    let stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(vk::ShaderStageFlags::COMPUTE)
        .name(c"main")
        .push_next(&mut module)
        .push_next(&mut name);
    let layout = gpu.layout(&[set.layout]);
    let info = vk::ComputePipelineCreateInfo::default()
        .stage(stage)
        .layout(layout);
    let cache = vk::PipelineCache::null();
    // SAFETY: `info` outlives the call.
    let made = unsafe { gpu.device.create_compute_pipelines(cache, &[info], None) };
    let pipeline = made.expect("vkCreateComputePipelines")[0];
    gpu.keep_pipeline(pipeline);
    let lost = dispatch(&gpu, Kernel { pipeline, layout }, set);
    assert_eq!(lost, LOST);
    let report = report(&gpu);
    if gpu.is_tuff() {
        says(&report.description, &["Compute shader \"in the chain\""]);
    }
}

/// A device is lost to a child of its process, which can ask why.
#[cfg(unix)]
#[test]
fn a_child_is_told_that_it_is_one() {
    unsafe extern "C" {
        fn fork() -> i32;
        fn _exit(code: i32) -> !;
        fn waitpid(child: i32, status: *mut i32, options: i32) -> i32;
    }
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a driver that promises this", Gpu::is_tuff) else {
        return;
    };
    // SAFETY: the child asks, and ends without running anything else of the test's.
    unsafe {
        let child = fork();
        if child == 0 {
            let (report, result) = ask(&gpu, counts(&gpu));
            let told = result == vk::Result::SUCCESS && report.vendor[0].vendor_fault_code == 5;
            _exit(if told { 7 } else { 8 });
        }
        let mut status = 0;
        assert_eq!(waitpid(child, &mut status, 0), child);
        assert_eq!(status, 7 << 8, "how the child ended");
    }
    assert_eq!(counts(&gpu), [0, 0]);
}
