//! Memory of all kinds.

use super::*;

#[test]
fn memory_layouts_agree_with_bytes() {
    // std430: a at 0, b at 12 (stride 4), m at 24 (row-major, stride 8); 48 bytes an element, the
    // first at 16.
    let source = "layout(local_size_x = 1) in;
         struct S { vec3 a; float b[3]; mat2 m; };
         layout(set = 0, binding = 0, std430, row_major) buffer In { uint head; S items[]; };
         layout(set = 0, binding = 1, std430) buffer Out { float o[]; };
         layout(push_constant) uniform P { uint which; };
         void main() {
             S s = items[which];
             o[0] = s.a.y; o[1] = s.b[2]; o[2] = s.m[0][1]; o[3] = s.m[1][0]; o[4] = items[which + 1].b[which];
             o[5] = items[which].m[which][0]; o[6] = float(items.length()); o[7] = items[which].a[which + 1];
             items[0].m[which] = vec2(100, 200);
             items[0].b[which] = 300;
         }";
    let words = glsl(Stage::Compute, source);
    let program = compile(&words);
    let input: Vec<u32> = (0..4 + 12 * 3).map(|i| (i as f32).to_bits()).collect();
    let mut memory = Memory {
        buffers: vec![(0, input), (16, vec![0; 8])],
        push_constants: vec![1],
    };
    dispatch(&program, 1, &mut memory);
    let out: Vec<f32> = memory.buffers[1]
        .1
        .iter()
        .map(|&w| f32::from_bits(w))
        .collect();
    // Element 1 starts at word 16, element 2 at word 28; m[c][r] is word 6 + 2 r + c of an element.
    let expected = [17.0, 21.0, 24.0, 23.0, 32.0, 23.0, 3.0, 18.0];
    assert_eq!(out, expected);
    let first: Vec<f32> = memory.buffers[0].1[4..16]
        .iter()
        .map(|&w| f32::from_bits(w))
        .collect();
    let expected = [
        4.0, 5.0, 6.0, 7.0, 300.0, 9.0, 10.0, 100.0, 12.0, 200.0, 14.0, 15.0,
    ];
    assert_eq!(first, expected);
}

#[test]
fn local_memory_with_computed_indices() {
    check(
        "struct S { uint a[4]; bool b; uint64_t w; uvec3 v; };
         uint total(S s) { uint t = uint(s.w >> 32) + (s.b ? 1 : 0); for (int k = 0; k < 4; k++) t += s.a[k] * (k + 1); return t + s.v.z; }
         void bump(inout S s, uint k) { s.a[k & 3u] += 5u; s.v[k % 3u] = k; s.b = !s.b; }
         uint counter = 7u; uint table[5] = uint[](3u, 1u, 4u, 1u, 5u);",
        "S s[3]; for (uint k = 0u; k < 3u; k++) { s[k].a = uint[4](k, k + 1u, k + 2u, x); s[k].b = k == 1u; s[k].w = uint64_t(x + k) << 32; s[k].v = uvec3(k, x, 9u); }
         bump(s[x % 3u], x); bump(s[1], 2u);
         S copy = s[(x + 1u) % 3u]; s[0] = copy; table[x % 5u] += counter++;
         r = total(s[0]) + total(s[x % 3u]) * 31u + total(s[2]) * 1009u + table[3] * 100000u + counter;",
        &ramp(),
        |_, x| {
            #[derive(Clone, Copy, Default)]
            struct S {
                a: [u32; 4],
                b: bool,
                w: u64,
                v: [u32; 3],
            }
            let total = |s: S| {
                let mut t = (s.w >> 32) as u32 + s.b as u32 + s.v[2];
                for k in 0..4 {
                    t += s.a[k] * (k as u32 + 1);
                }
                t
            };
            let bump = |s: &mut S, k: u32| {
                s.a[k as usize & 3] += 5;
                s.v[k as usize % 3] = k;
                s.b = !s.b;
            };
            let mut s = [S::default(); 3];
            for k in 0..3u32 {
                s[k as usize] = S {
                    a: [k, k + 1, k + 2, x],
                    b: k == 1,
                    w: ((x + k) as u64) << 32,
                    v: [k, x, 9],
                };
            }
            bump(&mut s[x as usize % 3], x);
            bump(&mut s[1], 2);
            s[0] = s[(x as usize + 1) % 3];
            let mut table = [3, 1, 4, 1, 5];
            table[x as usize % 5] += 7;
            total(s[0])
                .wrapping_add(total(s[x as usize % 3]).wrapping_mul(31))
                .wrapping_add(total(s[2]).wrapping_mul(1009))
                .wrapping_add(table[3] * 100_000)
                .wrapping_add(8)
        },
    );
}

#[test]
fn workgroup_memory_and_barriers() {
    let source = "layout(local_size_x = 64) in;
         layout(set = 0, binding = 0) buffer In { uint a[]; };
         layout(set = 0, binding = 1) buffer Out { uint o[]; };
         shared uint tile[64]; shared bool odd[64]; shared uint count;
         void main() {
             uint i = gl_LocalInvocationIndex, g = gl_GlobalInvocationID.x;
             if (i == 0u) count = 0u;
             tile[i] = a[g]; odd[i] = (a[g] & 1u) != 0u;
             barrier();
             for (uint step = 32u; step > 0u; step >>= 1) { if (i < step) tile[i] += tile[i + step]; barrier(); }
             if (odd[63u - i]) atomicAdd(count, 1u);
             barrier();
             o[g] = tile[0] * 100u + count + gl_NumWorkGroups.x;
         }";
    let words = glsl(Stage::Compute, source);
    let program = compile(&words);
    let input: Vec<u32> = (0..128).map(|i| i * 3 % 17).collect();
    let mut memory = Memory {
        buffers: vec![(0, input.clone()), (16, vec![0; 128])],
        push_constants: Vec::new(),
    };
    dispatch(&program, 2, &mut memory);
    for (group, chunk) in input.chunks(64).enumerate() {
        let sum: u32 = chunk.iter().sum();
        let odd = chunk.iter().filter(|&&x| x % 2 == 1).count() as u32;
        let expected = sum * 100 + odd + 2;
        let out = &memory.buffers[1].1[64 * group..64 * group + 64];
        assert!(out.iter().all(|&x| x == expected), "{out:?} {expected}");
    }
}

#[test]
fn physical_pointers() {
    let source = "layout(local_size_x = 1) in;
         layout(buffer_reference) buffer Node;
         layout(buffer_reference, std430, buffer_reference_align = 4) buffer Node { uint value; uint pad; Node next; uint8_t bytes[8]; };
         layout(buffer_reference, std430, buffer_reference_align = 4) buffer Word { uint w; };
         layout(set = 0, binding = 0) buffer Out { uint o[]; };
         layout(push_constant) uniform P { Node head; uint64_t raw; };
         void main() {
             uint n = 0u; Node node = head;
             while (uint64_t(node) != 0ul) { n = n * 10u + node.value; node.bytes[n & 7u] = uint8_t(n); node = node.next; }
             Word word = Word(raw);
             o[0] = n; o[1] = word[2].w; (word + 1).w = 5u; atomicAdd(word[3].w, 7u);
         }";
    let words = glsl(Stage::Compute, source);
    let program = compile(&words);
    let mut nodes = [[0u32; 6]; 3];
    let address = |node: &[u32; 6]| node.as_ptr() as u64;
    for index in 0..3 {
        nodes[index][0] = index as u32 + 1;
        let next = nodes.get(index + 1).map_or(0, address);
        nodes[index][2] = next as u32;
        nodes[index][3] = (next >> 32) as u32;
    }
    let mut raw = [11u32, 22, 33, 44];
    let raw_address = raw.as_mut_ptr() as u64;
    let head = nodes.as_mut_ptr() as u64;
    let mut memory = Memory {
        buffers: vec![(0, vec![0; 2])],
        push_constants: vec![
            head as u32,
            (head >> 32) as u32,
            raw_address as u32,
            (raw_address >> 32) as u32,
        ],
    };
    dispatch(&program, 1, &mut memory);
    assert_eq!(memory.buffers[0].1, [123, 33]);
    assert_eq!(std::hint::black_box(raw), [11, 5, 33, 51]);
    let nodes = std::hint::black_box(nodes);
    // 1, 12, 123 at bytes 1, 4, 3.
    assert_eq!(nodes[0][4] >> 8 & 0xff, 1);
    assert_eq!(nodes[1][5] & 0xff, 12);
    assert_eq!(nodes[2][4] >> 24, 123);
}

#[test]
fn arrays_of_buffers() {
    let source = "layout(local_size_x = 16) in;
         layout(set = 0, binding = 0) buffer In { uint a[]; } ins[2][3];
         layout(set = 0, binding = 1) buffer Out { uint o[]; };
         void main() { uint i = gl_GlobalInvocationID.x;
             o[i] = ins[nonuniformEXT(i & 1u)][nonuniformEXT(i % 3u)].a[1] + ins[1][2].a[0] * 1000u + uint(ins[0][1].a.length()) * 100000u; }";
    let words = glsl(Stage::Compute, source);
    let program = compile(&words);
    let mut buffers: Vec<(usize, Vec<u32>)> =
        (0..6).map(|k| (k, vec![k as u32, 10 + k as u32])).collect();
    buffers.push((16, vec![0; 16]));
    let mut memory = Memory {
        buffers,
        push_constants: Vec::new(),
    };
    dispatch(&program, 1, &mut memory);
    for (i, &word) in memory.buffers[6].1.iter().enumerate() {
        let expected = 10 + (i & 1) * 3 + i % 3 + 5000 + 200_000;
        assert_eq!(word as usize, expected);
    }
}

#[test]
fn workgroup_memory_starts_as_zero_where_it_says_so() {
    let source = "#extension GL_EXT_null_initializer : enable
         layout(local_size_x = 48) in;
         layout(set = 0, binding = 0) buffer Out { uint o[]; };
         shared uint tile[301] = {};
         void main() { uint s = 1u; for (uint k = 0u; k < 301u; k++) s += tile[k]; o[gl_LocalInvocationIndex] = s; }";
    let words = glsl(Stage::Compute, source);
    let program = compile(&words);
    let mut memory = Memory {
        buffers: vec![(0, vec![0; 48])],
        push_constants: Vec::new(),
    };
    dispatch(&program, 1, &mut memory);
    assert_eq!(memory.buffers[0].1, [1; 48]);
}

#[test]
fn atomics_on_half_floats_leave_their_neighbours_alone() {
    let inputs: Vec<u32> = (0..64).map(|i| i % 16).collect();
    check(
        "shared float16_t cells[4];",
        "if (gl_LocalInvocationIndex < 4u) cells[gl_LocalInvocationIndex] = float16_t(7);
         barrier();
         atomicAdd(cells[1], float16_t(0.25) * float16_t(x));
         atomicMin(cells[2], float16_t(3) - float16_t(x));
         atomicMax(cells[3], float16_t(x));
         float16_t old = atomicExchange(cells[0], float16_t(7));
         barrier();
         r = uint(cells[1] + float16_t(0.5)) | uint(-cells[2]) << 8 | uint(cells[3]) << 16 | uint(old) << 24;",
        &inputs,
        // 7 + 120/4, 3 - 15, 15, what was there.
        |_, _| 37 | 12 << 8 | 15 << 16 | 7 << 24,
    );
}
