//! Storage buffers of `maxStorageBufferRange`, 2³²−1 bytes. Offsets use all 32 bits, and indices
//! past the end do not wrap back into the buffer.

use effort::sparse::Sparse;
use shaders::compute::{Memory, compile, dispatch_over};
use shaders::glsl;
use spirv_jit::environment::Descriptor;
use spirv_jit::program::Stage;

/// `maxStorageBufferRange`, in whole words.
const LARGEST: u64 = (1 << 32) - 4;

/// The buffers of 16 indices and results.
const HEAD: &str = "layout(local_size_x = 16) in;
    layout(set = 0, binding = 1, std430) readonly buffer Indices { uint indices[16]; };
    layout(set = 0, binding = 2, std430) writeonly buffer Results { uvec4 results[16]; };";

fn whole(memory: &Sparse) -> Descriptor {
    Descriptor {
        address: memory.as_mut_ptr() as u64,
        size_bytes: memory.size_bytes(),
        ..Descriptor::NULL
    }
}

/// Runs a shader whose binding 0 is the memory, declared by `block`. Each invocation has an index
/// and returns a result.
fn run(memory: &Sparse, block: &str, body: &str, indices: [u32; 16]) -> Vec<[u32; 4]> {
    let source = format!(
        "{HEAD}
        {block}
        void main() {{
            uint k = gl_LocalInvocationIndex, i = indices[k];
            uvec4 result = uvec4(0);
            {body}
            results[k] = result;
        }}"
    );
    let program = compile(&glsl(Stage::Compute, &source));
    let mut small = Memory {
        buffers: vec![(16, indices.to_vec()), (32, vec![7; 64])],
        push_constants: Vec::new(),
    };
    dispatch_over(&program, 1, &mut small, &[(0, whole(memory))]);
    small.buffers[1].1.as_chunks().0.to_vec()
}

/// Indices of elements at the start, around 2 GiB, around 3 GiB and at the end; then indices past
/// the end.
fn places(element_bytes: u64) -> [u32; 16] {
    let last = LARGEST / element_bytes - 1;
    let around = |at: u64| [at / element_bytes - 1, at / element_bytes];
    let [a, b] = around(1 << 31);
    let [c, d] = around(3 << 30);
    let [e, f] = around(0xffe0_0000);
    let outside = [
        last + 1,
        last + 2,
        (1 << 32) / element_bytes,
        (1 << 32) / element_bytes + 1,
        u32::MAX as u64 - 1,
        u32::MAX as u64,
        u32::MAX as u64 - 3,
    ];
    let inside = [0, a, b, c, d, e, f, last - 1, last];
    let mut all = [0; 16];
    for (place, index) in all.iter_mut().zip(inside.into_iter().chain(outside)) {
        *place = index.min(u32::MAX.into()) as u32;
    }
    all
}

/// Whether an element is inside the largest buffer, if the array starts at `before`.
fn is_inside(index: u32, element_bytes: u64, before: u64) -> bool {
    before + (u64::from(index) + 1) * element_bytes <= LARGEST
}

/// Bytes that differ from place to place.
fn pattern(at: u64) -> [u8; 16] {
    let word = |k: u64| (at / 4 + k).wrapping_mul(0x9e37_79b9) as u32 | 1;
    let mut bytes = [0; 16];
    for (k, word_bytes) in bytes.chunks_exact_mut(4).enumerate() {
        word_bytes.copy_from_slice(&word(k as u64).to_ne_bytes());
    }
    bytes
}

fn scalar(bytes: &[u8]) -> u32 {
    let mut word = [0; 4];
    word[..bytes.len()].copy_from_slice(bytes);
    u32::from_ne_bytes(word)
}

/// Loads and stores of scalars of each size.
#[test]
fn scalars_are_at_their_offsets() {
    for (ty, size) in [("uint", 4u64), ("uint16_t", 2), ("uint8_t", 1)] {
        let memory = Sparse::new(LARGEST);
        let indices = places(size);
        for index in indices {
            if is_inside(index, size, 0) {
                let at = u64::from(index) * size;
                memory.write(at, &pattern(at)[..size as usize]);
            }
        }
        let block = format!("layout(set = 0, binding = 0, std430) buffer Data {{ {ty} data[]; }};");
        let loaded = run(&memory, &block, "result.x = uint(data[i]);", indices);
        for (index, result) in indices.into_iter().zip(loaded) {
            let at = u64::from(index) * size;
            let expected = match is_inside(index, size, 0) {
                true => scalar(&pattern(at)[..size as usize]),
                false => 0,
            };
            assert_eq!(result[0], expected, "{ty} {index:#x}");
        }
        let store = format!("data[i] = {ty}(k + 100u);");
        run(&memory, &block, &store, indices);
        for (k, index) in indices.into_iter().enumerate() {
            if is_inside(index, size, 0) {
                let bytes: [u8; 4] = memory.read((u64::from(index) * size).min(LARGEST - 4));
                let skip = (u64::from(index) * size).saturating_sub(LARGEST - 4) as usize;
                let stored = scalar(&bytes[skip..][..size as usize]);
                assert_eq!(stored, k as u32 + 100, "{ty} {index:#x}");
            }
        }
    }
}

/// Vectors, members of structures, and arrays in arrays. The buffers end inside an element, whose
/// scalars are checked one by one.
#[test]
fn elements_are_at_their_offsets() {
    // The last element that ends at 2³² stands for all larger indices. The first buffer contains a
    // part of it, the second one none.
    for size_bytes in [LARGEST, (1 << 32) - 68] {
        elements_of(size_bytes);
    }
}

fn elements_of(size_bytes: u64) {
    let memory = Sparse::new(size_bytes);
    let indices = places(16);
    let words = size_bytes / 4;
    let word = |index: u32, k: usize| u64::from(index) * 4 + k as u64;
    for index in indices {
        for at in (0..4).map(|k| word(index, k)).filter(|&at| at < words) {
            memory.write(at * 4, &pattern(at * 4)[..4]);
        }
    }
    let expected = |index: u32| -> [u32; 4] {
        std::array::from_fn(|k| match word(index, k) {
            at if at < words => scalar(&pattern(at * 4)[..4]),
            _ => 0,
        })
    };
    let blocks = [
        ("uvec4 data[];", "result = data[i];"),
        (
            "Item data[];",
            "result = uvec4(data[i].a, data[i].b, data[i].c);",
        ),
        (
            "uint data[][4];",
            "for (uint j = 0u; j < 4u; j++) result[j] = data[i][(j + k) & 3u];
             result = k % 4u == 0u ? result : k % 4u == 1u ? result.wxyz : k % 4u == 2u ? result.zwxy : result.yzwx;",
        ),
        (
            "layout(row_major) mat4 data[];",
            "result[k & 3u] = floatBitsToUint(data[i >> 2u][k & 3u][i & 3u]);",
        ),
    ];
    for (members, body) in blocks {
        let block = format!(
            "struct Item {{ uint a; uint b; uvec2 c; }};
             layout(set = 0, binding = 0, std430) buffer Data {{ {members} }};"
        );
        let results = run(&memory, &block, body, indices);
        for (lane, (index, result)) in indices.into_iter().zip(results).enumerate() {
            if index >= 1 << 28 && size_bytes == LARGEST {
                continue;
            }
            let mut wanted = expected(index);
            if members.contains("mat4") {
                wanted = std::array::from_fn(|k| if k == lane & 3 { wanted[k] } else { 0 });
            }
            assert_eq!(result, wanted, "{members} {index:#x}");
        }
    }
}

/// Indices past the end of the address range do not reach members before the array.
#[test]
fn no_index_leads_around_into_what_lies_before() {
    let memory = Sparse::new(1 << 16);
    for at in (0..1 << 16).step_by(4) {
        memory.write(at, &[0xff; 4]);
    }
    let outside: [u32; 16] = std::array::from_fn(|k| match k {
        0..8 => u32::MAX - k as u32,
        8..12 => (1 << 30) - 4 + k as u32 - 8,
        _ => (1 << 30) + k as u32 - 12,
    });
    let arrays = [
        "uvec4 before; uint8_t data[];",
        "uvec4 before[3]; uint data[];",
        "uvec4 before; uvec4 data[];",
        "uint before; uint64_t data[];",
        "uvec4 before[100]; uint data[4];",
        "uint before; u16vec3 data[];",
    ];
    for members in arrays {
        let block = format!("layout(set = 0, binding = 0, scalar) buffer Data {{ {members} }};");
        let (load, store) = match members.contains("vec4 data") {
            true => ("result = data[i];", "data[i] = uvec4(0u);"),
            false if members.contains("16vec3") => {
                ("result.xyz = uvec3(data[i]);", "data[i] = u16vec3(0us);")
            }
            false => ("result.x = uint(data[i]);", "data[i] -= data[i];"),
        };
        let indices = outside.map(|index| match members {
            // Half of the indices would be inside 4 GiB.
            _ if members.contains("uint8_t") => index | 1 << 31,
            _ => index,
        });
        let loaded = run(&memory, &block, load, indices);
        assert!(
            loaded.iter().all(|it| *it == [0; 4]),
            "{members} {loaded:?}"
        );
        run(&memory, &block, store, indices);
        for at in (0..1 << 16).step_by(4) {
            assert_eq!(memory.word(at), u32::MAX, "{members}: {at} was written");
        }
    }
    // Constant indices.
    let block = "layout(set = 0, binding = 0, std430) buffer Data { uvec4 before; uint data[]; };";
    for index in ["0x3ffffffcu", "0x3fffffffu", "0x40000000u", "0x7fffffffu"] {
        let body = format!("result.x = data[{index}];");
        let loaded = run(&memory, block, &body, outside);
        assert!(loaded.iter().all(|it| *it == [0; 4]), "{index} {loaded:?}");
    }
}

/// Atomics, and physical pointers that differ from lane to lane.
#[test]
fn atomics_and_addresses_past_two_gibibytes() {
    let memory = Sparse::new(LARGEST);
    let indices = places(4);
    let block = "layout(set = 0, binding = 0, std430) buffer Data { uint data[]; };";
    let body = "result.x = atomicAdd(data[i], k + 1u); result.y = atomicOr(data[i], 0x80000000u);";
    let results = run(&memory, block, body, indices);
    for (lane, (index, result)) in (1..).zip(indices.into_iter().zip(results)) {
        let is_inside = is_inside(index, 4, 0);
        assert_eq!(
            result[..2],
            [0, if is_inside { lane } else { 0 }],
            "{index:#x}"
        );
        if is_inside {
            assert_eq!(memory.word(u64::from(index) * 4), 1 << 31 | lane);
        }
    }
    let address = memory.as_mut_ptr() as u64;
    let block = "layout(buffer_reference, std430) buffer Words { uint word[]; };";
    let body = format!(
        "Words words = Words({address}ul);
         if (i < 0x3fffffffu) {{ result.x = words.word[i]; words.word[i] = k; }}"
    );
    let results = run(&memory, block, &body, indices);
    for (lane, (index, result)) in (0..).zip(indices.into_iter().zip(results)) {
        if is_inside(index, 4, 0) {
            assert_eq!(result[0], 1 << 31 | (lane + 1), "{index:#x}");
            assert_eq!(memory.word(u64::from(index) * 4), lane, "{index:#x}");
        }
    }
}

/// `.length()` of the largest buffers.
#[test]
fn lengths_of_large_buffers() {
    let memory = Sparse::new(LARGEST);
    let block = "layout(set = 0, binding = 0, std430) buffer Data { uvec4 before; uint data[]; };";
    let body = "result.x = uint(data.length());";
    let results = run(&memory, block, body, [0; 16]);
    assert!(
        results.iter().all(|it| it[0] == (1 << 30) - 5),
        "{results:?}"
    );
}
