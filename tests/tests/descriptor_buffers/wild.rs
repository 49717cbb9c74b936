//! Sets in memory that is written when it should not be, or that is not there.

use super::*;

#[test]
fn a_set_may_be_written_between_its_binding_and_the_dispatch() {
    use vk::DescriptorType as Ty;
    let gpu = Gpu::new();
    let Some(it) = Buffers::with_blocks(&gpu) else {
        return;
    };
    let layout = it.layout(&[
        (0, Ty::INLINE_UNIFORM_BLOCK, 16),
        (1, Ty::STORAGE_BUFFER, 1),
        (2, Ty::INLINE_UNIFORM_BLOCK, 16),
    ]);
    let results = gpu.buffer(64);
    let (staging, set) = (it.buffer(layout), it.buffer(layout));
    // Memory outside the bindings belongs to the application, too, and may hold anything.
    staging.write(0, &vec![0xa5u8; staging.size_bytes as usize]);
    staging.write(it.offset(layout, 0), &[1u32, 2, 3, 4]);
    it.put(
        &staging,
        layout,
        1,
        0,
        &Source::Storage(results.address, 64),
    );
    staging.write(it.offset(layout, 2), &[5u32, 6, 7, 8]);
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) uniform A { uvec4 a; };
    layout(set = 0, binding = 1) buffer R { uint r[]; };
    layout(set = 0, binding = 2) uniform B { uvec4 b; };
    void main() { r[0] = a.y; r[1] = b.w; }";
    let kernel = it.kernel(source, &[layout]);
    gpu.run(|commands| {
        it.bind(commands, kernel, 1, &[set]);
        let copy = [vk::BufferCopy::default().size(set.size_bytes)];
        // SAFETY: both buffers are that long.
        unsafe {
            gpu.device
                .cmd_copy_buffer(commands, staging.handle, set.handle, &copy);
        }
        gpu.barrier(commands);
        it.finish(commands, kernel, &[]);
    });
    assert_eq!(results.read::<u32>()[..2], [2, 8]);
}

/// A set is in memory that shaders write: what they put there is no way to memory that they were
/// not given.
#[test]
fn descriptors_that_a_shader_makes_up_lead_nowhere() {
    use vk::DescriptorType as Ty;
    let Some(gpu) = Gpu::surviving() else { return };
    let Some(it) = Buffers::new(&gpu) else { return };
    let layout = it.layout(&[
        (0, Ty::STORAGE_BUFFER, 1),
        (1, Ty::STORAGE_BUFFER, 1),
        (2, Ty::STORAGE_IMAGE, 1),
        (3, Ty::COMBINED_IMAGE_SAMPLER, 1),
        (4, Ty::STORAGE_TEXEL_BUFFER, 1),
    ]);
    let results = gpu.buffer_with(&[7u32; 16]);
    let secret = Box::new([0x600d_600du32; 16]);
    let set = it.buffer(layout);
    it.put(&set, layout, 0, 0, &Source::Storage(results.address, 64));
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { uint r[]; };
    layout(set = 0, binding = 1) buffer B { uint b[]; };
    layout(set = 0, binding = 2, r32ui) uniform uimage2D i;
    layout(set = 0, binding = 3) uniform usampler2D s;
    layout(set = 0, binding = 4, r32ui) uniform uimageBuffer t;
    void main() {
        r[0] = b[0] + uint(b.length());
        r[1] = imageLoad(i, ivec2(0)).x;
        r[2] = texelFetch(s, ivec2(0), 0).x;
        r[3] = imageLoad(t, 0).x;
        b[0] = 0xdeadu;
        imageStore(i, ivec2(0), uvec4(0xdead));
        imageStore(t, 0, uvec4(0xdead));
    }";
    let kernel = it.kernel(source, &[layout]);
    let address = &raw const *secret as u64;
    let wild = [
        // Where the host has memory, and where it has none.
        [address, 64, address, address],
        [
            0x4141_4141_4141_4140,
            64,
            0x4141_4141_4141_4140,
            0x4141_4141_4141_4140,
        ],
        [8, u64::MAX, 8, 8],
        [u64::MAX - 3, 64, u64::MAX - 1, u64::MAX],
        // A texel buffer of 32-bit numbers.
        [address, 64, (98 << 1) | 1, 2],
        [results.address + 32, u64::MAX, 1 << 32 | 2, 1 << 32 | 2],
    ];
    for (round, words) in wild.iter().enumerate() {
        for binding in 1..5 {
            set.write(it.offset(layout, binding), words);
        }
        it.dispatch(kernel, &[set], &[]);
        let words: Vec<u32> = results.read();
        if round + 1 < wild.len() {
            assert_eq!(words[..4], [0; 4], "round {round}");
        }
        assert_eq!(secret[..], [0x600d_600d; 16], "round {round}");
    }
    // Where the last one led, there was memory of the device.
    assert_eq!(results.read::<u32>()[8], 0xdead);
}

#[test]
fn a_descriptor_buffer_at_a_wild_address_holds_null_descriptors() {
    let Some(gpu) = Gpu::surviving() else { return };
    let Some(it) = Buffers::new(&gpu) else { return };
    let storage = vk::DescriptorType::STORAGE_BUFFER;
    let layout = it.layout(&[
        (0, storage, 1),
        (1, vk::DescriptorType::INLINE_UNIFORM_BLOCK, 16),
    ]);
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { uint r[]; };
    layout(set = 0, binding = 1) uniform B { uvec4 b; };
    void main() { r[0] = b.x + 1u; }";
    let kernel = it.kernel(source, &[layout]);
    let real = it.buffer(layout);
    for address in [0x4141_4141_4141_0000, 0, u64::MAX - 63, 1 << 16] {
        let mut wild = real;
        wild.address = address;
        it.dispatch(kernel, &[wild], &[]);
    }
}
