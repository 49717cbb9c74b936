//! `VK_KHR_shader_abort`: a shader that aborts loses the device, and its message is told.

use std::collections::BTreeSet;
use std::ffi::c_void;

use tuff_tests::fault::DEVICE_LOST;
use tuff_tests::newer::{
    DeviceFaultDebugInfoKHR, DeviceFaultShaderAbortMessageInfoKHR,
    PhysicalDeviceShaderAbortPropertiesKHR,
};
use tuff_tests::spirv::{instructions, literal, put};
use tuff_tests::*;

const LOST: Result<(), vk::Result> = Err(vk::Result::ERROR_DEVICE_LOST);

/// The message of `die`, a function that [`aborting`] makes abort.
const DIE: &str = "
struct Message { uint code; uint who; };
void die(Message m) {}
";

/// The members' offsets.
const OFFSETS: [u32; 2] = [0, 8];
const CODE: u32 = 0x7ace_0ff5;

/// A device that a test may lose.
fn open() -> Option<Gpu> {
    Gpu::without_validation().with("VK_KHR_shader_abort", |gpu| {
        gpu.optional.shader_abort.shader_abort == vk::TRUE
            && gpu.optional.fault_khr.device_fault == vk::TRUE
    })
}

/// Makes the function `die` abort with the structure that it is given, whose members are laid out
/// at these offsets, arrays with these strides (0 for other members).
fn aborting(words: &[u32], offsets: &[u32], strides: &[u32]) -> Vec<u32> {
    const NAME: u32 = 5;
    const EXTENSION: u32 = 10;
    const CAPABILITY: u32 = 17;
    const TYPE_VOID: u32 = 19;
    const TYPE_ARRAY: u32 = 28;
    const TYPE_STRUCT: u32 = 30;
    const TYPE_POINTER: u32 = 32;
    const FUNCTION: u32 = 54;
    const PARAMETER: u32 = 55;
    const FUNCTION_END: u32 = 56;
    const LOAD: u32 = 61;
    const DECORATE: u32 = 71;
    const MEMBER_DECORATE: u32 = 72;
    const LABEL: u32 = 248;
    const ARRAY_STRIDE: u32 = 6;
    const OFFSET: u32 = 35;
    const ABORT_CAPABILITY: u32 = 5120;
    const ABORT: u32 = 5121;

    let all = instructions(words);
    let find = |opcode, test: &dyn Fn(&[u32]) -> bool| {
        let found = all.iter().position(|it| it.0 == opcode && test(it.1));
        found.unwrap_or_else(|| panic!("no opcode {opcode}"))
    };
    let name = literal("die(")[0];
    let die = all[find(NAME, &|it| it[1] == name)].1[0];
    let start = find(FUNCTION, &|it| it[1] == die);
    let (opcode, parameter) = all[start + 1];
    assert_eq!(opcode, PARAMETER);
    let message = all[find(TYPE_POINTER, &|it| it[0] == parameter[0])].1[2];
    let place = find(TYPE_STRUCT, &|it| it[0] == message);
    let members = &all[place].1[1..];
    assert_eq!(members.len(), offsets.len());

    let bound = words[3];
    let (laid_out, loaded) = (bound, bound + 1);
    let array = |member: u32| bound + 2 + member;
    let stride = |member: u32| strides.get(member as usize).copied().unwrap_or(0);
    let mut out = words[..5].to_vec();
    out[3] = bound + 2 + members.len() as u32;
    let (mut declared, mut annotated, mut dropping) = (false, false, false);
    for (index, &(opcode, operands)) in all.iter().enumerate() {
        if !declared && opcode != CAPABILITY {
            put(&mut out, CAPABILITY, &[ABORT_CAPABILITY]);
            put(&mut out, EXTENSION, &literal("SPV_KHR_abort"));
            declared = true;
        }
        if !annotated && opcode == TYPE_VOID {
            for (member, &offset) in (0..).zip(offsets) {
                put(
                    &mut out,
                    MEMBER_DECORATE,
                    &[laid_out, member, OFFSET, offset],
                );
                if stride(member) != 0 {
                    put(
                        &mut out,
                        DECORATE,
                        &[array(member), ARRAY_STRIDE, stride(member)],
                    );
                }
            }
            annotated = true;
        }
        if opcode == FUNCTION_END {
            dropping = false;
        }
        if !dropping {
            put(&mut out, opcode, operands);
        }
        if index == place {
            let mut types = vec![laid_out];
            for (member, &ty) in (0..).zip(members) {
                if stride(member) == 0 {
                    types.push(ty);
                    continue;
                }
                let of = all[find(TYPE_ARRAY, &|it| it[0] == ty)].1;
                put(&mut out, TYPE_ARRAY, &[array(member), of[1], of[2]]);
                types.push(array(member));
            }
            put(&mut out, TYPE_STRUCT, &types);
        }
        if index > start + 1 && opcode == LABEL && !dropping {
            let is_die = all[start..index].iter().all(|it| it.0 != FUNCTION_END);
            if is_die {
                put(&mut out, LOAD, &[message, loaded, parameter[1]]);
                put(&mut out, ABORT, &[laid_out, loaded]);
                dropping = true;
            }
        }
    }
    out
}

/// A shader that aborts where its source calls `die`.
fn dying(stage: Stage, source: &str) -> Vec<u32> {
    aborting(&glsl(stage, &format!("{DIE}{source}")), &OFFSETS, &[])
}

/// The abort messages of a lost device, as the command gives them.
fn message_data(gpu: &Gpu) -> Vec<u8> {
    let mut messages = DeviceFaultShaderAbortMessageInfoKHR {
        message_data_size: 77,
        ..Default::default()
    };
    let ask = |messages: &mut DeviceFaultShaderAbortMessageInfoKHR| {
        let mut info = DeviceFaultDebugInfoKHR {
            p_next: (&raw mut *messages).cast(),
            ..Default::default()
        };
        gpu.faults().debug_info(&mut info)
    };
    assert_eq!(ask(&mut messages), vk::Result::SUCCESS);
    let size = messages.message_data_size as usize;
    let mut data = vec![0xa5; size + 8];
    messages.p_message_data = data.as_mut_ptr().cast();
    assert_eq!(ask(&mut messages), vk::Result::SUCCESS);
    assert_eq!(messages.message_data_size as usize, size);
    assert_eq!(data[size..], [0xa5; 8]);
    data.truncate(size);
    data
}

/// The payloads: each stands behind its size, which is at a multiple of 8 bytes.
fn messages(gpu: &Gpu) -> Vec<Vec<u8>> {
    let data = message_data(gpu);
    let (mut at, mut all) = (0, Vec::new());
    while at < data.len() {
        let size: [u8; 8] = data[at..at + 8].try_into().unwrap();
        let size = u64::from_ne_bytes(size) as usize;
        all.push(data[at + 8..at + 8 + size].to_vec());
        at = (at + 8 + size).next_multiple_of(8);
    }
    all
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// The device was lost by the message that `die` has, of these invocations. The report names the
/// stage.
#[track_caller]
fn check(gpu: &Gpu, lost: Result<(), vk::Result>, stage: &str, who: &BTreeSet<u32>) {
    assert_eq!(lost, LOST);
    let all = messages(gpu);
    assert!(!all.is_empty());
    for message in &all {
        assert_eq!((message.len(), word(message, 0)), (12, CODE));
        let found = word(message, OFFSETS[1] as usize);
        assert!(who.contains(&found), "{found}");
    }
    let (reports, result) = gpu.faults().take(0, 99);
    assert_eq!(result, vk::Result::SUCCESS);
    let last = reports.last().expect("a report");
    assert_ne!(last.flags & DEVICE_LOST, 0);
    if gpu.is_tuff() {
        assert_eq!(last.vendor_info.vendor_fault_code, 9);
        let text = fault_text(&last.description);
        assert!(text.contains("abort") && text.contains(stage), "{text}");
    }
}

/// Runs a compute shader of SPIR-V over words.
fn dispatch(gpu: &Gpu, words: &[u32], data: Buffer, groups: u32) -> Result<(), vk::Result> {
    let set = gpu.set_of(&[data.into()]);
    let kernel = gpu.kernel_of(words, &[set.layout]);
    gpu.try_run(|commands| {
        gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], [groups, 1, 1]);
    })
}

const DATA: &str = "layout(set = 0, binding = 0) buffer Data { uint data[]; };\n";

#[test]
fn messages_of_64_kib_are_possible() {
    let Some(gpu) = open() else { return };
    let mut aborts = PhysicalDeviceShaderAbortPropertiesKHR::default();
    let mut properties = vk::PhysicalDeviceProperties2 {
        p_next: (&raw mut aborts).cast(),
        ..Default::default()
    };
    // SAFETY: the chain is the structure above.
    unsafe { (gpu.instance).get_physical_device_properties2(gpu.physical, &mut properties) };
    assert!(aborts.max_shader_abort_message_size >= 65536);
}

/// Effects before the abort are there, and none after it.
#[test]
fn one_invocation_aborts() {
    let Some(gpu) = open() else { return };
    let source = format!(
        "layout(local_size_x = 32) in; {DATA}
        void main() {{
            uint i = gl_GlobalInvocationID.x;
            data[i] = i + 1;
            if (i == 37) die(Message({CODE}u, i));
            data[64 + i] = 1;
        }}"
    );
    let data = gpu.buffer_with(&[0u32; 128]);
    let lost = dispatch(&gpu, &dying(Stage::Compute, &source), data, 2);
    check(&gpu, lost, "Compute", &[37].into());
    // The specification leaves memory undefined.
    if gpu.is_tuff() {
        let words: Vec<u32> = data.read();
        assert_eq!((words[37], words[64 + 37]), (38, 0));
    }
}

#[test]
fn no_invocation_aborts() {
    let Some(gpu) = open() else { return };
    let source = format!(
        "layout(local_size_x = 32) in; {DATA}
        void main() {{
            uint i = gl_GlobalInvocationID.x;
            if (data[i] != i) die(Message({CODE}u, i));
            data[i] = 2 * i;
        }}"
    );
    let data = gpu.buffer_with(&std::array::from_fn::<u32, 64, _>(|i| i as u32));
    let run = dispatch(&gpu, &dying(Stage::Compute, &source), data, 2);
    assert_eq!(run, Ok(()));
    assert!((data.read::<u32>().into_iter()).eq((0..64).map(|i| 2 * i)));
    assert_eq!(gpu.faults().count(0), (0, vk::Result::TIMEOUT));
}

/// Others end in finite time: those that run for ever, those that wait for the one that aborted,
/// and what was to come after the command.
#[test]
fn others_are_ended() {
    for after in [
        "while (data[0] == 0) data[1] = data[1] + 1;",
        "barrier(); data[2] = 1;",
        "for (uint k = 0; k < 9; k++) { memoryBarrierBuffer(); barrier(); data[2] += k; }",
    ] {
        let Some(gpu) = open() else { return };
        let source = format!(
            "layout(local_size_x = 48) in; {DATA}
            void main() {{
                uint i = gl_LocalInvocationIndex;
                if (i == 17) die(Message({CODE}u, i));
                {after}
            }}"
        );
        let data = gpu.buffer_with(&[0u32; 64]);
        let lost = dispatch(&gpu, &dying(Stage::Compute, &source), data, 1);
        check(&gpu, lost, "Compute", &[17].into());
        // SAFETY: the queue is this test's.
        let idle = unsafe { gpu.device.queue_wait_idle(gpu.queue) };
        assert_eq!(idle, LOST);
    }
}

#[test]
fn many_invocations_abort() {
    let Some(gpu) = open() else { return };
    let source = format!(
        "layout(local_size_x = 64) in;
        void main() {{ die(Message({CODE}u, gl_GlobalInvocationID.x)); }}"
    );
    let data = gpu.buffer_with(&[0u32; 4]);
    let lost = dispatch(&gpu, &dying(Stage::Compute, &source), data, 999);
    let all = (0..64 * 999).collect();
    check(&gpu, lost, "Compute", &all);
    let messages = messages(&gpu);
    let different: BTreeSet<&Vec<u8>> = messages.iter().collect();
    assert_eq!(different.len(), messages.len(), "an invocation aborts once");
    if !gpu.is_tuff() {
        return;
    }
    // Whole messages, as many as fit.
    let data = message_data(&gpu);
    for room in [0, 8, 19, 20, 43, 44] {
        let mut bytes = [0xa5u8; 64];
        let mut messages = DeviceFaultShaderAbortMessageInfoKHR {
            message_data_size: room,
            p_message_data: bytes.as_mut_ptr().cast::<c_void>(),
            ..Default::default()
        };
        let mut info = DeviceFaultDebugInfoKHR {
            p_next: (&raw mut messages).cast(),
            ..Default::default()
        };
        assert_eq!(gpu.faults().debug_info(&mut info), vk::Result::INCOMPLETE);
        let expected = [0, 20, 44].into_iter().rfind(|&size| size <= room).unwrap();
        assert_eq!(messages.message_data_size, expected);
        let (written, rest) = bytes.split_at(expected as usize);
        assert_eq!(written, &data[..expected as usize]);
        assert!(rest.iter().all(|&byte| byte == 0xa5));
    }
}

/// A message is laid out as its type says, with arrays, vectors and narrow members.
#[test]
fn messages_have_the_layout_of_their_type() {
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("8-bit and 16-bit integers", |gpu| {
        gpu.features12.shader_int8 & gpu.features.shader_int16 != 0
    }) else {
        return;
    };
    let source = format!(
        "layout(local_size_x = 32) in; {DATA}
        struct Message {{ uint8_t text[5]; uint16_t small; vec3 place; uint words[3]; uint8_t end; }};
        void die(Message m) {{}}
        const uint8_t TEXT[5] = uint8_t[](uint8_t(104), uint8_t(101), uint8_t(108), uint8_t(108), uint8_t(111));
        void main() {{
            uint i = gl_GlobalInvocationID.x;
            if (data[i] != 0)
                die(Message(TEXT, uint16_t(data[i]), vec3(i, 0.5, -2.0), uint[](i, data[i], 7), uint8_t(i)));
        }}"
    );
    let offsets = [1, 6, 12, 32, 77];
    let words = aborting(&glsl(Stage::Compute, &source), &offsets, &[1, 0, 0, 16, 0]);
    let mut given = [0u32; 64];
    given[43] = 0x1_abcd;
    let data = gpu.buffer_with(&given);
    assert_eq!(dispatch(&gpu, &words, data, 2), LOST);
    let all = messages(&gpu);
    assert_eq!(all.len(), 1);
    let message = &all[0];
    assert_eq!(message.len(), 78);
    assert_eq!(&message[1..6], b"hello");
    assert_eq!(message[6..8], 0xabcd_u16.to_ne_bytes());
    let place = [12, 16, 20].map(|at| f32::from_bits(word(message, at)));
    assert_eq!(place, [43.0, 0.5, -2.0]);
    assert_eq!([32, 48, 64].map(|at| word(message, at)), [43, 0x1_abcd, 7]);
    assert_eq!(message[77], 43);
}

/// A message of the largest size that every device takes, of data and of computed words.
#[test]
fn the_largest_messages() {
    for whole in [false, true] {
        let Some(gpu) = open() else { return };
        let filled = match whole {
            true => "m.words = data;",
            false => "for (uint k = 0; k < 16383; k++) m.words[k] = data[k] * 3 + i;",
        };
        let source = format!(
            "layout(local_size_x = 16) in;
            layout(set = 0, binding = 0) buffer Data {{ uint data[16383]; }};
            struct Message {{ uint who; uint words[16383]; }};
            void die(Message m) {{}}
            void main() {{
                uint i = gl_GlobalInvocationID.x;
                Message m;
                m.who = i;
                if (i % 20 == 5) {{ {filled} die(m); }}
            }}"
        );
        let words = aborting(&glsl(Stage::Compute, &source), &[0, 4], &[0, 4]);
        let given: Vec<u32> = (0..16383u32).map(|i| i.wrapping_mul(0x9e37_79b9)).collect();
        let data = gpu.buffer_with(&given);
        assert_eq!(dispatch(&gpu, &words, data, 20), LOST);
        let all = messages(&gpu);
        assert!(!all.is_empty());
        for message in &all {
            assert_eq!(message.len(), 65536);
            let found: Vec<u32> = bytemuck::pod_collect_to_vec(message);
            let who = found[0];
            assert_eq!(who % 20, 5);
            let expected = |&it: &u32| {
                if whole {
                    it
                } else {
                    it.wrapping_mul(3).wrapping_add(who)
                }
            };
            assert!(found[1..].iter().copied().eq(given.iter().map(expected)));
        }
    }
}

/// Aborts in functions, in loops and in both branches of a condition.
#[test]
fn functions_and_loops_abort() {
    let step = "for (int k = 0; k < 4; k++) { y += a[k]; s = s * 3u + uint(y); a[(k + 1) & 3] ^= int(s); }\n";
    let source = format!(
        "layout(local_size_x = 32) in; {DATA}
        uint s = 1u;
        int big(inout int a[4], int y) {{
            {}
            for (uint k = 0; k < 9; k++) {{
                if (data[k] == gl_GlobalInvocationID.x) {{
                    if (k == 3) die(Message({CODE}u, k)); else data[40] = 9;
                }}
            }}
            return y;
        }}
        void main() {{
            int a[4] = int[](1, 2, 3, int(data[9]));
            data[32] = uint(big(a, 1));
            data[33] = uint(big(a, 2) + a[2]) + s;
        }}",
        step.repeat(16)
    );
    let Some(gpu) = open() else { return };
    let mut given = [77u32; 64];
    given[3] = 21;
    let data = gpu.buffer_with(&given);
    let lost = dispatch(&gpu, &dying(Stage::Compute, &source), data, 1);
    check(&gpu, lost, "Compute", &[3].into());
}

/// Draws with these shaders, in the place of the painting's own.
fn paint(
    gpu: &Gpu,
    painting: &Painting<'_>,
    stages: &[(Stage, Vec<u32>)],
    record: impl FnOnce(vk::CommandBuffer),
) -> Result<(), vk::Result> {
    let canvas = gpu.canvas(RGBA, 16, 16);
    let flags = vk::PipelineCreateFlags::empty();
    let pipeline = gpu
        .try_painting(painting, stages, flags, std::ptr::null())
        .expect("vkCreateGraphicsPipelines");
    gpu.try_run(|commands| {
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.look_at(commands, &canvas);
            gpu.bind(commands, pipeline);
            record(commands);
        });
    })
}

/// The stages of a draw, one of which aborts.
fn stages(list: &[(Stage, &str)]) -> Vec<(Stage, Vec<u32>)> {
    let words = |&(stage, source): &(Stage, &str)| match source.contains("die(") {
        true => (stage, dying(stage, source)),
        false => (stage, glsl(stage, source)),
    };
    list.iter().map(words).collect()
}

fn drawing() -> Option<Gpu> {
    open()?.with("a graphics queue", Gpu::has_graphics)
}

#[test]
fn vertex_shaders_abort() {
    let Some(gpu) = drawing() else { return };
    let vertex = format!(
        "void main() {{
            gl_Position = vec4(0, 0, 0, 1);
            if (gl_VertexIndex == 2) die(Message({CODE}u, 5));
        }}"
    );
    let painting = Painting::new(&gpu, "", WHITE, RGBA);
    let stages = stages(&[(Stage::Vertex, &vertex), (Stage::Fragment, WHITE)]);
    let lost = paint(&gpu, &painting, &stages, |commands| {
        gpu.draw_vertices(commands, 3)
    });
    check(&gpu, lost, "Vertex", &[5].into());
}

#[test]
fn fragment_shaders_abort() {
    let Some(gpu) = drawing() else { return };
    let fragment = format!(
        "layout(location = 0) out vec4 color;
        void main() {{
            uvec2 at = uvec2(gl_FragCoord.xy);
            color = vec4(1);
            if (at == uvec2(9, 4)) die(Message({CODE}u, at.x));
        }}"
    );
    let painting = Painting::new(&gpu, "", WHITE, RGBA);
    let stages = stages(&[(Stage::Vertex, COVER), (Stage::Fragment, &fragment)]);
    let lost = paint(&gpu, &painting, &stages, |commands| {
        gpu.draw_vertices(commands, 3)
    });
    check(&gpu, lost, "Fragment", &[9].into());
}

/// A helper invocation has no effects: it aborts nothing.
#[test]
fn helper_invocations_do_not_abort() {
    let Some(gpu) = drawing() else { return };
    let fragment = format!(
        "layout(location = 0) out vec4 color;
        void main() {{
            if (gl_HelperInvocation) die(Message({CODE}u, 1));
            color = vec4(1);
        }}"
    );
    // One pixel, and three helpers.
    let vertex = "void main() { gl_Position = vec4(0.0625, 0.0625, 0, 1); gl_PointSize = 1.0; }";
    let painting = Painting {
        topology: vk::PrimitiveTopology::POINT_LIST,
        ..Painting::new(&gpu, "", WHITE, RGBA)
    };
    let stages = stages(&[(Stage::Vertex, vertex), (Stage::Fragment, &fragment)]);
    let drawn = paint(&gpu, &painting, &stages, |commands| {
        gpu.draw_vertices(commands, 1)
    });
    assert_eq!(drawn, Ok(()));
}

#[test]
fn tessellation_shaders_abort() {
    let control = |die: &str| {
        format!(
            "layout(vertices = 3) out;
            void main() {{
                gl_out[gl_InvocationID].gl_Position = vec4(0, 0, 0, 1);
                gl_TessLevelOuter = float[](2.0, 2.0, 2.0, 2.0);
                gl_TessLevelInner = float[](2.0, 2.0);
                {die}
            }}"
        )
    };
    let evaluation = |die: &str| {
        format!(
            "layout(triangles) in;
            void main() {{ gl_Position = vec4(gl_TessCoord.xy, 0.5, 1.0); {die} }}"
        )
    };
    let vertex = "void main() { gl_Position = vec4(0, 0, 0, 1); }";
    for (stage, dies) in [
        (
            Stage::TessellationControl,
            format!("if (gl_InvocationID == 1) die(Message({CODE}u, 1));"),
        ),
        (
            Stage::TessellationEvaluation,
            format!("if (gl_TessCoord.x > 0.9) die(Message({CODE}u, 1));"),
        ),
    ] {
        let Some(gpu) = drawing() else { return };
        let Some(gpu) = gpu.with("tessellation shaders", |gpu| {
            gpu.features.tessellation_shader == vk::TRUE
        }) else {
            return;
        };
        let of = |it| if it == stage { &dies[..] } else { "" };
        let painting = Painting {
            control_points: 3,
            topology: vk::PrimitiveTopology::PATCH_LIST,
            ..Painting::new(&gpu, "", WHITE, RGBA)
        };
        let stages = stages(&[
            (Stage::Vertex, vertex),
            (
                Stage::TessellationControl,
                &control(of(Stage::TessellationControl)),
            ),
            (
                Stage::TessellationEvaluation,
                &evaluation(of(Stage::TessellationEvaluation)),
            ),
            (Stage::Fragment, WHITE),
        ]);
        let lost = paint(&gpu, &painting, &stages, |commands| {
            gpu.draw_vertices(commands, 3)
        });
        check(&gpu, lost, "Tessellation", &[1].into());
    }
}

#[test]
fn geometry_shaders_abort() {
    let Some(gpu) = drawing() else { return };
    let Some(gpu) = gpu.with("geometry shaders", |gpu| {
        gpu.features.geometry_shader == vk::TRUE
    }) else {
        return;
    };
    let geometry = format!(
        "layout(triangles) in; layout(triangle_strip, max_vertices = 3) out;
        void main() {{
            gl_Position = vec4(1);
            EmitVertex();
            if (gl_PrimitiveIDIn == 3) die(Message({CODE}u, 3));
            EmitVertex();
        }}"
    );
    let painting = Painting::new(&gpu, "", WHITE, RGBA);
    let stages = stages(&[
        (Stage::Vertex, COVER),
        (Stage::Geometry, &geometry),
        (Stage::Fragment, WHITE),
    ]);
    let lost = paint(&gpu, &painting, &stages, |commands| {
        gpu.draw_vertices(commands, 15)
    });
    check(&gpu, lost, "Geometry", &[3].into());
}

#[test]
fn task_and_mesh_shaders_abort() {
    let task = |die: &str| {
        format!(
            "layout(local_size_x = 32) in;
            void main() {{ {die} EmitMeshTasksEXT(2, 1, 1); }}"
        )
    };
    let mesh = |die: &str| {
        format!(
            "layout(local_size_x = 32) in;
            layout(triangles, max_vertices = 3, max_primitives = 1) out;
            void main() {{
                SetMeshOutputsEXT(3, 1);
                {die}
                gl_MeshVerticesEXT[gl_LocalInvocationIndex % 3].gl_Position = vec4(0);
                gl_PrimitiveTriangleIndicesEXT[0] = uvec3(0, 1, 2);
            }}"
        )
    };
    let dies = format!(
        "if (gl_WorkGroupID.x == 1 && gl_LocalInvocationIndex == 20) die(Message({CODE}u, 20));"
    );
    for stage in [Stage::Task, Stage::Mesh] {
        let Some(gpu) = drawing() else { return };
        let features = gpu.optional.mesh_shader;
        let both = features.task_shader == vk::TRUE && features.mesh_shader == vk::TRUE;
        let Some(gpu) = gpu.with("mesh shaders", |_| both) else {
            return;
        };
        let of = |it| if it == stage { &dies[..] } else { "" };
        let painting = Painting {
            mesh: Some((None, "")),
            ..Painting::new(&gpu, "", WHITE, RGBA)
        };
        let stages = stages(&[
            (Stage::Task, &task(of(Stage::Task))),
            (Stage::Mesh, &mesh(of(Stage::Mesh))),
            (Stage::Fragment, WHITE),
        ]);
        let commands_of_meshes = ash::ext::mesh_shader::Device::new(&gpu.instance, &gpu.device);
        let lost = paint(&gpu, &painting, &stages, |commands| {
            // SAFETY: the command buffer is being recorded.
            unsafe { commands_of_meshes.cmd_draw_mesh_tasks(commands, 2, 1, 1) };
        });
        check(&gpu, lost, &format!("{stage:?}"), &[20].into());
    }
}

/// Each stage of ray tracing aborts where its shader's first word says so.
#[test]
fn ray_tracing_shaders_abort() {
    for stage in [
        Stage::RayGeneration,
        Stage::Miss,
        Stage::ClosestHit,
        Stage::AnyHit,
        Stage::Intersection,
        Stage::Callable,
    ] {
        let Some(gpu) = open() else { return };
        let Some(gpu) = gpu.with("VK_KHR_ray_tracing_pipeline", |gpu| {
            gpu.pipeline_properties.max_ray_recursion_depth >= 1
        }) else {
            return;
        };
        let die = format!("if (gl_LaunchIDEXT.x == 33) die(Message({CODE}u, gl_LaunchIDEXT.x));");
        let of = |it| if it == stage { &die[..] } else { "" };
        let raygen = format!(
            "layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
            layout(location = 0) rayPayloadEXT uint hit;
            layout(location = 0) callableDataEXT uint called;
            void main() {{
                {}
                // Half of the rays miss.
                float x = float(gl_LaunchIDEXT.x % 2);
                vec3 from = vec3({} * 10.0, 0, -1);
                traceRayEXT(world, gl_RayFlagsNoneEXT, 0xff, 0, 0, 0, from, 0.0, vec3(0, 0, 1), 9.0, 0);
                executeCallableEXT(0, 0);
            }}",
            of(Stage::RayGeneration),
            if stage == Stage::Miss { "x" } else { "(1.0 - x)" },
        );
        let miss = format!(
            "layout(location = 0) rayPayloadInEXT uint hit; void main() {{ hit = 1; {} hit = 2; }}",
            of(Stage::Miss)
        );
        let closest = format!(
            "layout(location = 0) rayPayloadInEXT uint hit; void main() {{ hit = 3; {} hit = 4; }}",
            of(Stage::ClosestHit)
        );
        let any = format!(
            "layout(location = 0) rayPayloadInEXT uint hit; void main() {{ hit = 5; {} }}",
            of(Stage::AnyHit)
        );
        let intersection = format!(
            "void main() {{ {} reportIntersectionEXT(0.5, 0); }}",
            of(Stage::Intersection)
        );
        let callable = format!(
            "layout(location = 0) callableDataInEXT uint called; void main() {{ called = 1; {} }}",
            of(Stage::Callable)
        );
        let shaders = stages(&[
            (Stage::RayGeneration, &raygen),
            (Stage::Miss, &miss),
            (Stage::ClosestHit, &closest),
            (Stage::AnyHit, &any),
            (Stage::Intersection, &intersection),
            (Stage::Callable, &callable),
        ]);
        let groups = [
            Group::general(0),
            Group::general(1),
            Group {
                closest_hit: Some(2),
                any_hit: Some(3),
                intersection: Some(4),
                ..Group::default()
            },
            Group::general(5),
        ];
        let world = gpu.scene(&[Geometry::boxes(
            &[[-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]],
            vk::GeometryFlagsKHR::empty(),
        )]);
        let set = gpu.set_of(&[world.into()]);
        let rays = gpu.rays_of_words(&shaders, &groups, 1, set, vk::PipelineCreateFlags::empty());
        let table = Table {
            callable: vec![Record::of(3)],
            ..Table::of(0, &[1], &[2])
        };
        let regions = gpu.regions(&rays, &table);
        let lost = gpu.try_run(|commands| gpu.record_trace(commands, &rays, &regions, [64, 1, 1]));
        check(&gpu, lost, &format!("{stage:?}"), &[33].into());
    }
}

/// The instruction needs its capability.
#[test]
fn aborts_need_the_capability() {
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a driver that refuses invalid modules", Gpu::is_tuff) else {
        return;
    };
    let source = format!("void main() {{ die(Message({CODE}u, 0)); }}");
    let mut words = dying(Stage::Compute, &source);
    let capability = words
        .windows(2)
        .position(|it| it == [2 << 16 | 17, 5120])
        .unwrap();
    words.drain(capability..capability + 2);
    let layout = gpu.layout(&[]);
    let made = gpu.try_kernel(&words, c"main", layout, &vk::SpecializationInfo::default());
    assert!(made.is_err());
}
