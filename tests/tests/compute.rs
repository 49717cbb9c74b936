//! Compute shaders: places, control flow and memory of every kind, against the host's answers.

use tuff_tests::*;

#[test]
fn every_invocation_knows_its_place() {
    let gpu = Gpu::new();
    for [x, y, z] in [[4, 3, 2], [1, 1, 1], [3, 1, 1], [1, 5, 4]] {
        let source = format!(
            "layout(local_size_x = {x}, local_size_y = {y}, local_size_z = {z}) in;
            layout(set = 0, binding = 0) buffer B {{ uint b[]; }};
            void main() {{
                uvec3 whole = gl_NumWorkGroups * gl_WorkGroupSize;
                uvec3 id = gl_GlobalInvocationID;
                uint i = (id.z * whole.y + id.y) * whole.x + id.x;
                bool right = id == gl_WorkGroupID * gl_WorkGroupSize + gl_LocalInvocationID
                    && gl_LocalInvocationIndex
                        == (gl_LocalInvocationID.z * {y}u + gl_LocalInvocationID.y) * {x}u
                            + gl_LocalInvocationID.x;
                atomicAdd(b[i], right ? 1u : 100u);
            }}"
        );
        let groups = [5, 7, 3];
        let invocations = x * y * z * groups.iter().product::<u32>();
        let buffer = gpu.buffer(4 * u64::from(invocations));
        gpu.compute(&source, &[buffer], groups);
        assert!(buffer.read::<u32>().iter().all(|count| *count == 1));
    }
}

#[test]
fn control_flow_diverges_and_comes_together() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer O { uint o[]; };
    uint collatz(uint n) {
        uint steps = 0u;
        while (n > 1u) {
            n = (n & 1u) == 0u ? n / 2u : 3u * n + 1u;
            steps++;
        }
        return steps;
    }
    uint early(uint n) {
        for (uint i = 2u; i < 50u; i++) {
            if (n % i == 0u) return i;
        }
        return 0u;
    }
    void main() {
        uint id = gl_GlobalInvocationID.x;
        uint sum = collatz(id + 1u) * 100u;
        for (uint i = 0u; i < 10u; i++) {
            if (i == id % 7u) continue;
            for (uint j = 0u;; j++) {
                if (j > i) break;
                if ((id + j) % 5u == 4u) break;
                sum += j;
            }
            switch ((id + i) % 6u) {
            case 0u: sum += 1u; break;
            case 1u: sum += 10u; // falls through
            case 2u: sum += 100u; break;
            case 5u:
                if (id % 2u == 0u) break;
                sum += 1000u;
                break;
            default: sum += 3u;
            }
            if (i == 8u && id % 11u == 3u) break;
        }
        do { sum += 7u; } while (sum % 3u != 0u);
        o[id] = sum + 1000000u * early(id + 2u);
    }";
    let output = gpu.buffer(4 * 256);
    gpu.compute(source, &[output], [4, 1, 1]);
    let expected = |id: u32| {
        let mut n = id + 1;
        let mut sum = 0u32;
        while n > 1 {
            n = if n & 1 == 0 { n / 2 } else { 3 * n + 1 };
            sum += 100;
        }
        for i in 0..10 {
            if i == id % 7 {
                continue;
            }
            sum += (0..=i).take_while(|j| (id + j) % 5 != 4).sum::<u32>();
            sum += match (id + i) % 6 {
                0 => 1,
                1 => 110,
                2 => 100,
                5 if id.is_multiple_of(2) => 0,
                5 => 1000,
                _ => 3,
            };
            if i == 8 && id % 11 == 3 {
                break;
            }
        }
        loop {
            sum += 7;
            if sum.is_multiple_of(3) {
                break;
            }
        }
        sum + 1_000_000 * (2..50).find(|i| (id + 2).is_multiple_of(*i)).unwrap_or(0)
    };
    for (id, got) in output.read::<u32>().into_iter().enumerate() {
        assert_eq!(got, expected(id as u32), "invocation {id}");
    }
}

#[test]
fn functions_take_and_change_arrays_and_structures() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer O { uint o[]; };
    struct Inner { uint a[5]; vec2 v; };
    struct Outer { Inner inner[3]; uint n; };
    void fill(inout Outer outer, uint id) {
        for (uint i = 0u; i < 3u; i++)
            for (uint j = 0u; j < 5u; j++) outer.inner[i].a[(j + id) % 5u] += id * 31u + i * 5u + j;
        outer.n = id;
    }
    uint pick(in Outer outer, uint i) {
        outer.inner[i % 3u].a[1] = 9u; // its own copy
        return outer.inner[i % 3u].a[i % 5u];
    }
    const uint table[6] = uint[](3u, 1u, 4u, 1u, 5u, 9u);
    void main() {
        uint id = gl_GlobalInvocationID.x;
        Outer outer;
        for (uint i = 0u; i < 3u; i++) outer.inner[i] = Inner(uint[](0u, 1u, 2u, 3u, 4u), vec2(i));
        fill(outer, id);
        Outer copy = outer;
        copy.inner[2] = outer.inner[id % 2u];
        uint sum = pick(outer, id) + 3u * pick(copy, id + 2u) + outer.n + uint(copy.inner[2].v.x);
        o[id] = sum * 10u + table[id % 6u];
    }";
    let output = gpu.buffer(4 * 192);
    gpu.compute(source, &[output], [3, 1, 1]);
    for (id, got) in output.read::<u32>().into_iter().enumerate() {
        let id = id as u32;
        let element = |i: u32, k: u32| k + id * 31 + i * 5 + (k + 5 - id % 5) % 5;
        let pick = |i: u32, from: u32| if i % 5 == 1 { 9 } else { element(from, i % 5) };
        let copied = if (id + 2) % 3 == 2 {
            id % 2
        } else {
            (id + 2) % 3
        };
        let sum = pick(id, id % 3) + 3 * pick(id + 2, copied) + id + id % 2;
        assert_eq!(
            got,
            sum * 10 + [3, 1, 4, 1, 5, 9][id as usize % 6],
            "invocation {id}"
        );
    }
}

#[test]
fn workgroups_share_memory_and_meet_at_barriers() {
    let gpu = Gpu::new();
    // A scan in shared memory: each step needs every invocation's last one.
    for size in [1u32, 7, 32, 61, 128, 256] {
        if size > gpu.limits.max_compute_work_group_invocations {
            continue;
        }
        let source = format!(
            "layout(local_size_x = {size}) in;
            layout(set = 0, binding = 0) buffer O {{ uint o[]; }};
            shared uint sums[{size}];
            shared uint flag;
            void main() {{
                uint i = gl_LocalInvocationIndex;
                sums[i] = i * i + gl_WorkGroupID.x;
                if (i == 0u) flag = 0u;
                barrier();
                for (uint step = 1u; step < {size}u; step *= 2u) {{
                    uint add = i >= step ? sums[i - step] : 0u;
                    barrier();
                    sums[i] += add;
                    barrier();
                }}
                atomicMax(flag, sums[i]);
                barrier();
                o[gl_GlobalInvocationID.x] = sums[i] + (flag == sums[{size} - 1] ? 0u : 1000000u);
            }}"
        );
        let output = gpu.buffer(4 * 6 * u64::from(size));
        gpu.compute(&source, &[output], [6, 1, 1]);
        for (i, got) in output.read::<u32>().into_iter().enumerate() {
            let (group, last) = (i as u32 / size, i as u32 % size);
            let expected: u32 = (0..=last).map(|k| k * k + group).sum();
            assert_eq!(got, expected, "size {size}, invocation {i}");
        }
    }
}

#[test]
fn atomics_lose_nothing() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer O { uint o[9]; int signed_min; uint seen[]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        atomicAdd(o[0], i);
        atomicOr(o[1], 1u << (i % 32u));
        atomicAnd(o[2], ~(1u << (i % 13u)));
        atomicXor(o[3], i * 2654435761u);
        atomicMin(o[4], i + 5u);
        atomicMax(o[5], i);
        uint ticket = atomicAdd(o[6], 1u);
        seen[ticket] = 1u;
        atomicCompSwap(o[7], i, i + 1u);
        atomicExchange(o[8], i | 0x10000u);
        atomicMin(signed_min, 3 - int(i));
    }";
    let count = 64 * 16u32;
    let mut start = vec![0u32; 10 + count as usize];
    start[2] = u32::MAX;
    start[4] = u32::MAX;
    let buffer = gpu.buffer_with(&start);
    gpu.compute(source, &[buffer], [16, 1, 1]);
    let o: Vec<u32> = buffer.read();
    assert_eq!(o[0], (0..count).sum());
    assert_eq!(o[1], u32::MAX);
    assert_eq!(o[2], !0x1fff);
    assert_eq!(
        o[3],
        (0..count).fold(0, |x, i| x ^ i.wrapping_mul(2_654_435_761))
    );
    assert_eq!((o[4], o[5], o[6]), (5, count - 1, count));
    assert!(o[7] >= 1 && o[7] <= count);
    assert!(o[8] & 0x10000 != 0 && o[8] & 0xffff < count);
    assert_eq!(o[9] as i32, 3 - (count as i32 - 1));
    assert!(o[10..].iter().all(|seen| *seen == 1));
}

#[test]
fn push_constants_and_specialization_constants() {
    let gpu = Gpu::new();
    let source = r"
    layout(constant_id = 3) const uint size = 4u;
    layout(constant_id = 1) const float scale = 1.5;
    layout(constant_id = 7) const bool flip = false;
    layout(constant_id = 2) const int offset = -3;
    layout(local_size_x_id = 9) in;
    layout(push_constant) uniform Push { uvec2 a; layout(offset = 16) vec3 v; float f[4]; };
    layout(set = 0, binding = 0) buffer O { float o[]; };
    float table[size * 2u];
    void main() {
        uint i = gl_GlobalInvocationID.x;
        for (uint k = 0u; k < table.length(); k++) table[k] = float(k) * scale;
        float x = table[i % table.length()] + float(offset) + v.z + f[i % 4u] + float(a.y);
        o[i] = flip ? -x : x;
    }";
    let output = gpu.buffer(4 * 24);
    let set = gpu.set_of(&[output.into()]);
    let mut push = [0.0f32; 12];
    push[1] = f32::from_bits(40);
    push[4..7].copy_from_slice(&[1.0, 2.0, 3.0]);
    push[7..11].copy_from_slice(&[0.25, 0.5, 0.75, 1.0]);
    for specialized in [false, true] {
        let mut data = Vec::new();
        data.extend(8u32.to_le_bytes());
        data.extend((-0.5f32).to_le_bytes());
        data.extend(1u32.to_le_bytes());
        data.extend(5i32.to_le_bytes());
        data.extend(12u32.to_le_bytes());
        let entry = |constant_id: u32, offset: u32| vk::SpecializationMapEntry {
            constant_id,
            offset,
            size: 4,
        };
        let all = [
            entry(3, 0),
            entry(1, 4),
            entry(7, 8),
            entry(2, 12),
            entry(9, 16),
        ];
        let used = if specialized { &all[..] } else { &all[4..] };
        let constants = vk::SpecializationInfo::default()
            .map_entries(used)
            .data(&data);
        let kernel = gpu.specialized_kernel(source, &[set.layout], &constants);
        gpu.dispatch(kernel, &[set], &push, [2, 1, 1]);
        for (i, got) in output.read::<f32>().into_iter().enumerate() {
            let (size, scale, sign, offset) = if specialized {
                (16, -0.5, -1.0, 5.0)
            } else {
                (8, 1.5, 1.0, -3.0)
            };
            let x = (i % size) as f32 * scale + offset + 3.0 + [0.25, 0.5, 0.75, 1.0][i % 4] + 40.0;
            assert_eq!(got, sign * x, "{specialized} {i}");
        }
    }
}

#[test]
fn descriptors_in_arrays_with_dynamic_offsets_and_addresses() {
    let gpu = Gpu::new();
    let indexes = [
        gpu.features12
            .shader_uniform_buffer_array_non_uniform_indexing,
        gpu.features12
            .shader_storage_buffer_array_non_uniform_indexing,
    ];
    if !has(
        "descriptors indexed non-uniformly",
        indexes == [vk::TRUE; 2],
    ) {
        return;
    }
    let source = r"
    layout(local_size_x = 32) in;
    layout(set = 0, binding = 0) uniform U { uvec4 u; } uniforms[3];
    layout(set = 0, binding = 2) buffer S { uint s[]; } storage[5];
    layout(set = 1, binding = 0) uniform D { uint d; } moved;
    layout(set = 1, binding = 4) buffer E { uint e[]; } output_window;
    layout(buffer_reference) buffer List;
    layout(buffer_reference, std430, buffer_reference_align = 16) buffer List { uint value; uint pad; List next; };
    layout(push_constant) uniform Push { List head; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        List list = head;
        for (uint k = 0u; k < i % 3u; k++) list = list.next;
        uint a = uniforms[nonuniformEXT(i % 3u)].u[i % 4u];
        uint b = storage[nonuniformEXT(i % 5u)].s[i];
        storage[nonuniformEXT(i % 5u)].s[i] = 0u;
        output_window.e[i] = a + b * 10u + moved.d * 100000u + list.value;
    }";
    let uniforms: Vec<Bound> = (0..3u32)
        .map(|k| Bound::Uniform(gpu.buffer_with(&[k, k + 10, k + 20, k + 30])))
        .collect();
    let stored: Vec<Buffer> = (0..5u32)
        .map(|k| gpu.buffer_with(&(0..64).map(|i| 1000 * (k + 1) + i).collect::<Vec<u32>>()))
        .collect();
    let storage: Vec<Bound> = stored
        .iter()
        .map(|buffer| Bound::Storage(*buffer))
        .collect();
    let set_0 = gpu.set(&[(0, &uniforms), (2, &storage)]);
    let moved = gpu.buffer_with(&(0..1024).collect::<Vec<u32>>());
    let window = gpu.buffer(4096);
    let set_1 = gpu.set(&[
        (0, &[Bound::UniformDynamic(moved, 4)]),
        (4, &[Bound::StorageDynamic(window, 256)]),
    ]);
    let list = gpu.buffer(48);
    let (second, third) = (list.address + 16, list.address + 32);
    list.write(0, &[1_000_000u64, second, 2_000_000, third, 3_000_000, 0]);
    let kernel = gpu.kernel(source, &[set_0.layout, set_1.layout]);
    gpu.run(|commands| {
        gpu.bind_kernel(commands, kernel, &[set_0, set_1], &[512, 1024]);
        gpu.push(commands, kernel.layout, &list.address);
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_dispatch(commands, 2, 1, 1) };
    });
    let results: Vec<u32> = window.read();
    for i in 0..64u32 {
        let a = i % 3 + 10 * (i % 4);
        let b = 1000 * (i % 5 + 1) + i;
        let expected = a + b * 10 + 128 * 100_000 + 1_000_000 * (i % 3 + 1);
        assert_eq!(results[256 + i as usize], expected, "invocation {i}");
    }
    assert!(
        results[..256]
            .iter()
            .chain(&results[320..])
            .all(|word| *word == 0)
    );
    assert_eq!(
        stored[2].read::<u32>()[..8],
        [3000, 3001, 0, 3003, 3004, 3005, 3006, 0]
    );
}

#[test]
fn indirect_dispatch_and_base_groups() {
    let gpu = Gpu::new();
    let source = r"
    layout(local_size_x = 8) in;
    layout(set = 0, binding = 0) buffer O { uint o[]; };
    void main() { atomicAdd(o[gl_GlobalInvocationID.x], gl_NumWorkGroups.x + 100u * gl_WorkGroupID.y); }";
    let output = gpu.buffer(4 * 64);
    let set = gpu.set_of(&[output.into()]);
    let kernel = gpu.kernel(source, &[set.layout]);
    let sizes = gpu.buffer_with(&[9u32, 9, 9, 3, 2, 1]);
    gpu.run(|commands| {
        gpu.bind_kernel(commands, kernel, &[set], &[]);
        // SAFETY: the command buffer is being recorded; everything lives as long as the device.
        unsafe {
            gpu.device.cmd_dispatch_indirect(commands, sizes.handle, 12);
        }
    });
    // Three groups wide, twice: once with y = 0 and once with y = 1.
    let expected: Vec<u32> = (0..64).map(|i| if i < 24 { 106 } else { 0 }).collect();
    assert_eq!(output.read::<u32>(), expected);
}
