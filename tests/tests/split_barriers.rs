//! `VK_EXT_shader_split_barrier`: barriers in two halves.

use tuff_tests::assembly::{instruction, instructions, opcode, with_capability};
use tuff_tests::*;

/// `SplitBarrierEXT`.
const CAPABILITY: u32 = 6141;
const OP_CONSTANT: u32 = 43;
const OP_CONTROL_BARRIER: u32 = 224;
const ARRIVE: u32 = 6142;
const WAIT: u32 = 6143;

/// Semantics: workgroup memory, and storage buffers.
const RELEASE: u32 = 0x144;
const ACQUIRE: u32 = 0x142;

/// Compiles a shader and makes its control barriers arrivals and waits, alternating.
fn split(source: &str) -> Vec<u32> {
    let words = glsl(Stage::Compute, source);
    let words = with_capability(&words, CAPABILITY, "SPV_EXT_split_barrier");
    let barrier = instructions(&words).find(|it| opcode(it) == OP_CONTROL_BARRIER);
    let semantics = barrier.expect("there is a barrier")[3];
    let (release, acquire) = (words[3], words[3] + 1);
    let mut out = words[..5].to_vec();
    out[3] += 2;
    let mut halves = [(ARRIVE, release), (WAIT, acquire)].into_iter().cycle();
    for it in instructions(&words) {
        match *it {
            [_, scope, memory, _] if opcode(it) == OP_CONTROL_BARRIER => {
                let (half, semantics) = halves.next().expect("there is no end of them");
                out.extend(instruction(half, &[scope, memory, semantics]));
            }
            _ => out.extend_from_slice(it),
        }
        if opcode(it) == OP_CONSTANT && it[2] == semantics {
            out.extend(instruction(OP_CONSTANT, &[it[1], release, RELEASE]));
            out.extend(instruction(OP_CONSTANT, &[it[1], acquire, ACQUIRE]));
        }
    }
    out
}

fn gpu() -> Option<Gpu> {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 359));
    gpu.with("VK_EXT_shader_split_barrier", |gpu| {
        gpu.optional.split_barrier.shader_split_barrier != 0
    })
}

/// Invocations hand numbers to those in other subgroups, turn after turn, with work of different
/// lengths between the halves.
#[test]
fn what_was_stored_before_an_arrival_is_there_after_the_wait() {
    let Some(gpu) = gpu() else {
        return;
    };
    const INVOCATIONS: u32 = 256;
    const TURNS: u32 = 6;
    let source = format!(
        "layout(local_size_x = {INVOCATIONS}) in;
        layout(set = 0, binding = 0, std430) buffer Results {{ uint results[]; }};
        shared uint places[2][{INVOCATIONS}];
        void main() {{
            uint i = gl_LocalInvocationIndex, x = i, work = 0u;
            for (uint turn = 0u; turn < {TURNS}u; turn++) {{
                places[turn & 1u][(i + 37u) % {INVOCATIONS}u] = x;
                barrier();
                for (uint k = 0u; k < 8000u * ((turn + i / 16u) & 3u); k++)
                    work = work * 5u + k;
                barrier();
                x = places[turn & 1u][i];
            }}
            results[gl_GlobalInvocationID.x] = work == 0xFFFFFFFFu ? i : x;
        }}"
    );
    let workgroups = 5;
    let results = gpu.buffer(u64::from(4 * INVOCATIONS * workgroups));
    let set = gpu.set_of(&[results.into()]);
    let kernel = gpu.kernel_of(&split(&source), &[set.layout]);
    gpu.dispatch::<u32>(kernel, &[set], &[], [workgroups, 1, 1]);
    for (index, found) in (0..).zip(results.read::<u32>()) {
        let i = index % INVOCATIONS;
        let from = (i + 37 * INVOCATIONS - 37 * TURNS % INVOCATIONS) % INVOCATIONS;
        assert_eq!(found, from, "{index}");
    }
}

/// Memory that one half releases in one subgroup is acquired by the other half in the others.
#[test]
fn buffers_are_ordered_too() {
    let Some(gpu) = gpu() else {
        return;
    };
    let source = "layout(local_size_x = 256) in;
        layout(set = 0, binding = 0, std430) coherent buffer Data { uint data[256]; };
        layout(set = 0, binding = 1, std430) buffer Results { uint results[256]; };
        void main() {
            uint i = gl_LocalInvocationIndex;
            data[i] = i * i;
            barrier();
            uint other = i ^ 0xC3u;
            barrier();
            results[i] = data[other];
        }";
    let (data, results) = (gpu.buffer(1024), gpu.buffer(1024));
    let set = gpu.set_of(&[data.into(), results.into()]);
    let kernel = gpu.kernel_of(&split(source), &[set.layout]);
    gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
    let wanted: Vec<u32> = (0..256u32).map(|i| (i ^ 0xC3).pow(2)).collect();
    assert_eq!(results.read::<u32>(), wanted);
}
