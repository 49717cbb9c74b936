//! Accesses past 2 GiB in a buffer of `maxStorageBufferRange`, 2³²−1 bytes. Few of its pages are
//! touched.

use tuff_tests::*;

/// In whole words.
const SIZE: u64 = (1 << 32) - 4;

const GIB: u64 = 1 << 30;

/// Offsets around 2 GiB, at 3 GiB, and at the end.
const PLACES: [u64; 8] = [
    64,
    2 * GIB - 16,
    2 * GIB,
    2 * GIB + 16,
    3 * GIB,
    3 * GIB + 4080,
    4 * GIB - 4096,
    4 * GIB - 32,
];

/// The device, and the buffer.
#[track_caller]
fn large() -> Option<(Gpu, Buffer)> {
    let gpu = Gpu::new().with("buffers of 4 GiB", |gpu| {
        u64::from(gpu.limits.max_storage_buffer_range) >= SIZE
    })?;
    let buffer = gpu.untouched_buffer(SIZE);
    has("4 GiB of memory", buffer.is_some()).then_some(())?;
    Some((gpu, buffer?))
}

/// Indices of the elements at the places.
fn indices(element_bytes: u64) -> Vec<u32> {
    let index = |place: u64| (place / element_bytes) as u32;
    PLACES.map(index).to_vec()
}

/// Four words for each place, all different.
fn pattern(seed: u32) -> Vec<[u32; 4]> {
    let word = |k: u32| (k + 1 + 100 * seed).wrapping_mul(0x9e37_79b9);
    (0..8)
        .map(|k| [0, 1, 2, 3].map(|component| word(4 * k + component)))
        .collect()
}

fn expect(buffer: Buffer, wanted: &[[u32; 4]], words: usize) {
    for (place, wanted) in PLACES.into_iter().zip(wanted) {
        let found = buffer.read_at::<u32>(place, words);
        assert_eq!(found, wanted[..words], "at {place:#x}");
    }
}

/// The other buffers of a shader: an index, four words and a result for each of eight invocations.
const GIVEN: &str = "
    layout(local_size_x = 8) in;
    layout(set = 0, binding = 1, std430) readonly buffer Indices { uint indices[]; };
    layout(set = 0, binding = 2, std430) readonly buffer Given { uvec4 given[]; };
    layout(set = 0, binding = 3, std430) writeonly buffer Results { uvec4 results[]; };";

/// Runs a body with `i` the index, `g` what is given and `r` the result.
fn run(
    gpu: &Gpu,
    large: Bound,
    (declarations, body): (&str, &str),
    indices: &[u32],
    given: &[[u32; 4]],
) -> Vec<[u32; 4]> {
    let results = gpu.buffer(8 * 16);
    let things = [
        large,
        gpu.buffer_with(indices).into(),
        gpu.buffer_with(given).into(),
        results.into(),
    ];
    let source = format!(
        "{GIVEN}{declarations}
        void main() {{
            uint k = gl_LocalInvocationIndex, i = indices[k];
            uvec4 g = given[k], r = uvec4(0u);
            {body}
            results[k] = r;
        }}"
    );
    let set = gpu.set_of(&things);
    let kernel = gpu.kernel(&source, &[set.layout]);
    gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
    results.read()
}

#[test]
fn shaders_reach_every_byte_of_a_large_buffer() {
    let Some((gpu, buffer)) = large() else {
        return;
    };
    let members = [
        ("uint data[];", 4, "data[i] = g.x;", "r.x = data[i];"),
        ("uvec4 data[];", 16, "data[i] = g;", "r = data[i];"),
        (
            "Item data[];",
            16,
            "data[i].a = g.x; data[i].b = g.yzw;",
            "r = uvec4(data[i].a, data[i].b);",
        ),
        (
            "uint data[][2][2];",
            16,
            "for (uint j = 0u; j < 4u; j++) data[i][j >> 1u][j & 1u] = g[j];",
            "for (uint j = 0u; j < 4u; j++) r[j] = data[i][(j ^ k & 2u) >> 1u][j & 1u];
             r = (k & 2u) != 0u ? r.zwxy : r;",
        ),
    ];
    for (seed, (members, bytes, write, read)) in (0..).zip(members) {
        let block = format!(
            "struct Item {{ uint a; uvec3 b; }};
             layout(set = 0, binding = 0, scalar) buffer Data {{ {members} }};"
        );
        let (given, indices) = (pattern(seed), indices(bytes));
        run(&gpu, buffer.into(), (&block, write), &indices, &given);
        let words = bytes as usize / 4;
        expect(buffer, &given, words);
        let found = run(&gpu, buffer.into(), (&block, read), &indices, &given);
        for (found, given) in found.iter().zip(&given) {
            assert_eq!(found[..words], given[..words], "{members}");
        }
    }
}

#[test]
fn atomics_and_addresses_in_a_large_buffer() {
    let Some((gpu, buffer)) = large() else {
        return;
    };
    let (first, second) = (pattern(7), pattern(8));
    for (place, words) in PLACES.into_iter().zip(&first) {
        buffer.write(place as usize, words);
    }
    let block = "layout(set = 0, binding = 0, std430) buffer Data { uint data[]; };";
    let body = "r.x = atomicAdd(data[i], g.x); r.y = atomicExchange(data[i + 1u], g.y);";
    let found = run(&gpu, buffer.into(), (block, body), &indices(4), &second);
    for ((found, first), place) in found.iter().zip(&first).zip(PLACES) {
        assert_eq!(found[..2], first[..2], "at {place:#x}");
    }
    let both: Vec<[u32; 4]> = (first.iter().zip(&second))
        .map(|(a, b)| [a[0].wrapping_add(b[0]), b[1], a[2], a[3]])
        .collect();
    expect(buffer, &both, 4);
    let block = "layout(buffer_reference, std430) buffer Words { uint word[]; };";
    let body = format!(
        "Words words = Words({}ul);
         r = uvec4(words.word[i], words.word[i + 1u], 0u, 0u); words.word[i + 2u] = g.z;",
        buffer.address
    );
    let found = run(&gpu, buffer.into(), (block, &body), &indices(4), &second);
    for ((found, both), place) in found.iter().zip(&both).zip(PLACES) {
        assert_eq!(found[..2], both[..2], "at {place:#x}");
    }
    let all: Vec<[u32; 4]> = (both.iter().zip(&second))
        .map(|(a, b)| [a[0], a[1], b[2], a[3]])
        .collect();
    expect(buffer, &all, 4);
}

/// Copies, fills, texel buffers and parameters of indirect dispatches.
#[test]
fn commands_reach_every_byte_of_a_large_buffer() {
    let Some((gpu, buffer)) = large() else {
        return;
    };
    let given = pattern(3);
    let source = gpu.buffer_with(&given);
    let region = |from: u64, to: u64| {
        let region = vk::BufferCopy::default().size(16);
        [region.src_offset(from).dst_offset(to)]
    };
    gpu.run(|commands| {
        // SAFETY: the command buffer is being recorded, and the ranges lie in their buffers.
        unsafe {
            // Across 2 GiB, and at the end.
            gpu.device
                .cmd_fill_buffer(commands, buffer.handle, 2 * GIB - 64, 256, 0xABAB_ABAB);
            gpu.device
                .cmd_fill_buffer(commands, buffer.handle, 4 * GIB - 64, vk::WHOLE_SIZE, 7);
            gpu.barrier(commands);
            for (k, place) in (0..).zip(PLACES) {
                let (from, to) = (source.handle, buffer.handle);
                let region = region(16 * k, place);
                gpu.device.cmd_copy_buffer(commands, from, to, &region);
            }
        }
    });
    expect(buffer, &given, 4);
    assert_eq!(buffer.read_at::<u32>(2 * GIB + 188, 1), [0xABAB_ABAB]);
    assert_eq!(buffer.read_at::<u32>(4 * GIB - 64, 8), [7; 8]);
    assert_eq!(buffer.read_at::<u32>(4 * GIB - 16, 3), [7; 3]);
    gpu.run(|commands| {
        let region = region(4 * GIB - 32, 3 * GIB + 64);
        // SAFETY: the command buffer is being recorded, and the ranges lie in their buffers.
        unsafe {
            gpu.device
                .cmd_copy_buffer(commands, buffer.handle, buffer.handle, &region);
        }
    });
    assert_eq!(buffer.read_at::<u32>(3 * GIB + 64, 4), given[7]);
    let view = gpu.buffer_view_of(&buffer, vk::Format::R32G32B32A32_UINT, 3 * GIB, 4096);
    let texels = "layout(set = 0, binding = 0) uniform utextureBuffer texels;";
    let fetch = "r = texelFetch(texels, int(i));";
    let indices: Vec<u32> = (0..8).map(|k| if k == 0 { 0 } else { 255 }).collect();
    let bound = Bound::UniformTexels(view);
    let found = run(&gpu, bound, (texels, fetch), &indices, &given);
    assert_eq!([found[0], found[1]], [given[4], given[5]]);

    let at = 3 * GIB + 512;
    buffer.write(at as usize, &[3u32, 2, 1]);
    let counts = gpu.buffer(4);
    let set = gpu.set_of(&[counts.into()]);
    let count = "layout(local_size_x = 1) in;
        layout(set = 0, binding = 0, std430) buffer Count { uint count; };
        void main() { atomicAdd(count, 1u); }";
    let kernel = gpu.kernel(count, &[set.layout]);
    gpu.run(|commands| {
        gpu.bind_kernel(commands, kernel, &[set], &[]);
        // SAFETY: the command buffer is being recorded, and the ranges lie in their buffers.
        unsafe {
            gpu.device
                .cmd_dispatch_indirect(commands, buffer.handle, at);
        }
    });
    assert_eq!(counts.read::<u32>(), [6]);
}

/// Vertices, indices, transforms and boxes of builds at offsets past 2 GiB.
#[test]
fn builds_read_at_offsets_of_32_bits() {
    let Some((gpu, buffer)) = large() else {
        return;
    };
    let there = gpu.optional.ray_query.ray_query == vk::TRUE;
    if !has("VK_KHR_ray_query", there) {
        return;
    }
    const FIRST: u32 = 0x1200_0000;
    let (indices, transform, boxes) = (0xC000_0010u32, 0xF000_0000u32, 0xE000_0008u32);
    let corners = [[0.0f32, 0.0, 5.0], [4.0, 0.0, 5.0], [0.0, 4.0, 5.0]];
    buffer.write(12 * FIRST as usize, &corners);
    buffer.write(indices as usize, &[0u32, 1, 2]);
    buffer.write(transform as usize, &translated([10.0, 0.0, 2.0]));
    buffer.write(boxes as usize, &[20.0f32, 0.0, 3.0, 24.0, 4.0, 4.0]);
    let triangles = geometry_of(
        triangles_at(buffer.at(), 3)
            .index_type(vk::IndexType::UINT32)
            .index_data(buffer.at())
            .transform_data(buffer.at()),
    );
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(1);
    let of_triangles = range
        .first_vertex(FIRST)
        .primitive_offset(indices)
        .transform_offset(transform);
    let bottom = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
    let flags = vk::BuildAccelerationStructureFlagsKHR::empty();
    let first = gpu.build(bottom, &[triangles], &[of_triangles], flags);
    let aabbs = vk::AccelerationStructureGeometryAabbsDataKHR::default()
        .data(buffer.at())
        .stride(24);
    let geometry = vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::AABBS)
        .geometry(vk::AccelerationStructureGeometryDataKHR { aabbs });
    let second = gpu.build(bottom, &[geometry], &[range.primitive_offset(boxes)], flags);
    let top = gpu.top(&[Instance::of(first), Instance::of(second)]);
    let world = "layout(set = 0, binding = 0) uniform accelerationStructureEXT world;";
    let body = "rayQueryEXT q;
        float x = k == 0u ? 11.0 : k == 1u ? 21.0 : 1.0;
        rayQueryInitializeEXT(q, world, 0u, 0xFFu, vec3(x, 1.0, 0.0), 0.0, vec3(0.0, 0.0, 1.0), 100.0);
        while (rayQueryProceedEXT(q)) {
            if (rayQueryGetIntersectionTypeEXT(q, false) == gl_RayQueryCandidateIntersectionAABBEXT)
                r.x = 3u;
            else
                rayQueryConfirmIntersectionEXT(q);
        }
        if (rayQueryGetIntersectionTypeEXT(q, true) != 0u) r.x = uint(rayQueryGetIntersectionTEXT(q, true));";
    let world = (world, body);
    let bound = Bound::Structure(top.handle);
    let found = run(&gpu, bound, world, &[0; 8], &pattern(0));
    assert_eq!([found[0][0], found[1][0], found[2][0]], [7, 3, 0]);
}
