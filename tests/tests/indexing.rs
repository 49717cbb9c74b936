//! `VK_EXT_shader_64bit_indexing`: storage buffers of more than 4 GiB. Few of their pages are
//! touched.

use tuff_tests::assembly::{with_capability, with_execution_mode};
use tuff_tests::*;

const GIB: u64 = 1 << 30;

/// Elements of 16 bytes, of which the last one is whole.
const SIZE: u64 = 6 * GIB;

const ELEMENTS: u64 = SIZE / 16;

/// `Shader64BitIndexingEXT`: the capability and the execution mode.
const CAPABILITY: u32 = 5426;
const MODE: u32 = 5427;

/// Elements at the start, around 4 GiB and at the end, and some outside: of these the numbers of
/// bytes modulo 2³² are inside.
const INDICES: [u32; 10] = [
    1,
    (1 << 28) - 1,
    1 << 28,
    (1 << 28) + 1,
    (5 * GIB / 16) as u32,
    ELEMENTS as u32 - 1,
    ELEMENTS as u32,
    1 << 29,
    1 << 31,
    u32::MAX,
];

/// How a shader asks for 64-bit indexing.
#[derive(Clone, Copy, Debug)]
enum Asks {
    ByMode,
    ByFlag,
}

fn kernel(gpu: &Gpu, source: &str, set: &Set, asks: Asks) -> Kernel {
    let words = glsl(Stage::Compute, source);
    let sets = &[set.layout];
    match asks {
        Asks::ByMode => {
            let words = with_capability(&words, CAPABILITY, "SPV_EXT_shader_64bit_indexing");
            gpu.kernel_of(&with_execution_mode(&words, MODE), sets)
        }
        Asks::ByFlag => {
            let flags = newer::PIPELINE_CREATE_2_64_BIT_INDEXING_EXT;
            gpu.kernel_with_flags2(&words, sets, flags)
        }
    }
}

fn large() -> Option<(Gpu, Buffer)> {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 340));
    let gpu = gpu.with("VK_EXT_shader_64bit_indexing", |gpu| {
        gpu.optional.shader_64bit_indexing.shader64_bit_indexing != 0
    })?;
    let buffer = gpu.untouched_buffer(SIZE);
    has("6 GiB of memory", buffer.is_some()).then_some(())?;
    Some((gpu, buffer?))
}

fn element(index: u32) -> [u32; 4] {
    [0, 1, 2, 3].map(|k| index.wrapping_mul(0x9e37_79b9).wrapping_add(k) | 1)
}

#[test]
fn shaders_reach_elements_past_4_gib() {
    let Some((gpu, buffer)) = large() else {
        return;
    };
    let head = "layout(local_size_x = 10) in;
        layout(set = 0, binding = 0, std430) buffer Data { uvec4 data[]; };
        layout(set = 0, binding = 1, std430) readonly buffer Indices { uint indices[]; };
        layout(set = 0, binding = 2, std430) buffer Results { uvec4 results[]; };";
    let body = |body: &str| {
        format!(
            "{head} void main() {{
                uint k = gl_LocalInvocationIndex, i = indices[k];
                {body}
            }}"
        )
    };
    let inside = |index: u32| u64::from(index) < ELEMENTS;
    let indices = gpu.buffer_with(&INDICES);
    for asks in [Asks::ByMode, Asks::ByFlag] {
        let results = gpu.buffer_with(&[7u32; 40]);
        let set = gpu.set_of(&[buffer.into(), indices.into(), results.into()]);
        for index in INDICES.into_iter().filter(|&it| inside(it)) {
            buffer.write((16 * u64::from(index)) as usize, &element(index));
        }
        let load = kernel(&gpu, &body("results[k] = data[i];"), &set, asks);
        gpu.dispatch::<u32>(load, &[set], &[], [1, 1, 1]);
        // Without robust access a load from outside may give any value.
        for (index, found) in INDICES.into_iter().zip(results.read::<[u32; 4]>()) {
            if inside(index) {
                assert_eq!(found, element(index), "{asks:?} {index:#x}");
            }
        }
        let change = "if (i < 0x18000000u) { atomicAdd(data[i].x, k); data[i].w = k; }";
        let change = kernel(&gpu, &body(change), &set, asks);
        gpu.dispatch::<u32>(change, &[set], &[], [1, 1, 1]);
        for (k, index) in (0..).zip(INDICES).filter(|&(_, it)| inside(it)) {
            let [x, y, z, _] = element(index);
            let found = buffer.read_at::<u32>(16 * u64::from(index), 4);
            assert_eq!(found, [x + k, y, z, k], "{asks:?} {index:#x}");
        }
    }
}

/// A length fits into 32 bits, but not its bytes.
#[test]
fn lengths_are_those_of_whole_buffers() {
    let Some((gpu, buffer)) = large() else {
        return;
    };
    let source = "layout(local_size_x = 1) in;
        layout(set = 0, binding = 0, std430) buffer Data { uvec4 before; uvec4 data[]; };
        layout(set = 0, binding = 1, std430) buffer Results { uint result; };
        void main() { result = uint(data.length()); }";
    for asks in [Asks::ByMode, Asks::ByFlag] {
        let result = gpu.buffer(4);
        let set = gpu.set_of(&[buffer.into(), result.into()]);
        let kernel = kernel(&gpu, source, &set, asks);
        gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
        assert_eq!(result.read::<u32>(), [ELEMENTS as u32 - 1], "{asks:?}");
    }
}

/// Addresses of buffers reach as far.
#[test]
fn addresses_reach_past_4_gib() {
    let Some((gpu, buffer)) = large() else {
        return;
    };
    let source = format!(
        "layout(local_size_x = 10) in;
        layout(set = 0, binding = 0, std430) readonly buffer Indices {{ uint indices[]; }};
        layout(set = 0, binding = 1, std430) buffer Results {{ uvec4 results[]; }};
        layout(buffer_reference, std430) buffer Elements {{ uvec4 element[]; }};
        void main() {{
            uint k = gl_LocalInvocationIndex, i = indices[k];
            Elements elements = Elements({}ul);
            if (i < 0x18000000u) results[k] = elements.element[i];
        }}",
        buffer.address
    );
    let results = gpu.buffer_with(&[7u32; 40]);
    let indices = gpu.buffer_with(&INDICES);
    for index in INDICES.into_iter().filter(|&it| u64::from(it) < ELEMENTS) {
        buffer.write((16 * u64::from(index)) as usize, &element(index));
    }
    for asks in [Asks::ByMode, Asks::ByFlag] {
        let set = gpu.set_of(&[indices.into(), results.into()]);
        let kernel = kernel(&gpu, &source, &set, asks);
        gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
        for (index, found) in INDICES.into_iter().zip(results.read::<[u32; 4]>()) {
            if u64::from(index) < ELEMENTS {
                assert_eq!(found, element(index), "{asks:?} {index:#x}");
            }
        }
    }
}
