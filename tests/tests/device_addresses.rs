//! `VK_KHR_device_address_commands`: commands on memory by its address. The functions and most
//! structures are newer than the bindings, so they are declared here.

use std::ffi::{CStr, c_void};

use tuff_tests::*;

fn gpu_with_address_commands() -> Option<Gpu> {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 340));
    gpu.with("VK_KHR_device_address_commands", |gpu| {
        gpu.optional.address_commands.device_address_commands != 0
    })
}

/// `VK_ADDRESS_COMMAND_STORAGE_BUFFER_USAGE_BIT_KHR`: every buffer of the harness may be a storage
/// buffer.
const OF_STORAGE: u32 = 1 << 2;

/// A device function by name, as a pointer of type `T`.
fn function<T: Copy>(gpu: &Gpu, name: &CStr) -> T {
    assert_eq!(size_of::<T>(), size_of::<vk::PFN_vkVoidFunction>());
    // SAFETY: the caller names the type of the function.
    unsafe {
        let found = gpu
            .instance
            .get_device_proc_addr(gpu.device.handle(), name.as_ptr());
        assert!(found.is_some(), "{name:?}");
        std::mem::transmute_copy(&found)
    }
}

fn range(buffer: Buffer, offset: u64, size: u64) -> DeviceAddressRangeKHR {
    DeviceAddressRangeKHR {
        address: buffer.address + offset,
        size,
    }
}

type Fill = unsafe extern "system" fn(vk::CommandBuffer, *const DeviceAddressRangeKHR, u32, u32);
type Update = unsafe extern "system" fn(
    vk::CommandBuffer,
    *const DeviceAddressRangeKHR,
    u32,
    u64,
    *const c_void,
);
type WithInfo<T> = unsafe extern "system" fn(vk::CommandBuffer, *const T);

/// `VkDeviceMemoryCopyKHR`.
#[repr(C)]
struct MemoryCopy {
    s_type: vk::StructureType,
    p_next: *const c_void,
    source: DeviceAddressRangeKHR,
    source_flags: u32,
    destination: DeviceAddressRangeKHR,
    destination_flags: u32,
}

/// `VkCopyDeviceMemoryInfoKHR`.
#[repr(C)]
struct CopyInfo {
    s_type: vk::StructureType,
    p_next: *const c_void,
    count: u32,
    regions: *const MemoryCopy,
}

/// `VkDeviceMemoryImageCopyKHR`.
#[repr(C)]
struct ImageCopy {
    s_type: vk::StructureType,
    p_next: *const c_void,
    range: DeviceAddressRangeKHR,
    flags: u32,
    row_length: u32,
    image_height: u32,
    subresource: vk::ImageSubresourceLayers,
    layout: vk::ImageLayout,
    offset: vk::Offset3D,
    extent: vk::Extent3D,
}

/// `VkCopyDeviceMemoryImageInfoKHR`.
#[repr(C)]
struct ImageCopyInfo {
    s_type: vk::StructureType,
    p_next: *const c_void,
    image: vk::Image,
    count: u32,
    regions: *const ImageCopy,
}

const fn structure(number: i32) -> vk::StructureType {
    vk::StructureType::from_raw(1_000_318_000 + number)
}

#[test]
fn memory_is_filled_updated_and_copied() {
    let Some(gpu) = gpu_with_address_commands() else {
        return;
    };
    let fill: Fill = function(&gpu, c"vkCmdFillMemoryKHR");
    let update: Update = function(&gpu, c"vkCmdUpdateMemoryKHR");
    let copy: WithInfo<CopyInfo> = function(&gpu, c"vkCmdCopyMemoryKHR");
    let (first, second) = (gpu.buffer(64), gpu.buffer(64));
    let words = [5u32, 6, 7];
    let region = |from: u64, to: u64, size: u64| MemoryCopy {
        s_type: structure(0),
        p_next: std::ptr::null(),
        source: range(first, from, size),
        source_flags: OF_STORAGE,
        destination: range(second, to, size),
        destination_flags: OF_STORAGE,
    };
    let regions = [region(8, 0, 16), region(0, 32, 4)];
    let info = CopyInfo {
        s_type: structure(1),
        p_next: std::ptr::null(),
        count: 2,
        regions: regions.as_ptr(),
    };
    gpu.run(|commands| {
        // SAFETY: the ranges lie in the buffers; the structures outlive the calls.
        unsafe {
            fill(commands, &range(first, 0, 24), OF_STORAGE, 9);
            gpu.barrier(commands);
            update(
                commands,
                &range(first, 12, 12),
                OF_STORAGE,
                12,
                words.as_ptr().cast(),
            );
            gpu.barrier(commands);
            copy(commands, &info);
        }
    });
    assert_eq!(first.read::<u32>()[..7], [9, 9, 9, 5, 6, 7, 0]);
    assert_eq!(second.read::<u32>()[..9], [9, 5, 6, 7, 0, 0, 0, 0, 9]);
}

#[test]
fn images_are_copied_from_and_to_addresses() {
    let Some(gpu) = gpu_with_address_commands() else {
        return;
    };
    let into: WithInfo<ImageCopyInfo> = function(&gpu, c"vkCmdCopyMemoryToImageKHR");
    let out: WithInfo<ImageCopyInfo> = function(&gpu, c"vkCmdCopyImageToMemoryKHR");
    let shape = Shape::flat(vk::Format::R32_UINT, 4, 4);
    let picture = gpu.picture(shape, vk::ImageUsageFlags::TRANSFER_DST);
    gpu.upload(&picture, 0, &[1u32; 16]);
    let input = gpu.buffer_with(&[10u32, 11, 99, 12, 13, 99]);
    let output = gpu.buffer(64);
    let layers = vk::ImageSubresourceLayers::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .layer_count(1);
    let region = |range, row_length, offset, side| ImageCopy {
        s_type: structure(2),
        p_next: std::ptr::null(),
        range,
        flags: OF_STORAGE,
        row_length,
        image_height: 0,
        subresource: layers,
        layout: vk::ImageLayout::GENERAL,
        offset: vk::Offset3D {
            x: offset,
            y: offset,
            z: 0,
        },
        extent: vk::Extent3D {
            width: side,
            height: side,
            depth: 1,
        },
    };
    let info = |region: &ImageCopy| ImageCopyInfo {
        s_type: structure(3),
        p_next: std::ptr::null(),
        image: picture.handle,
        count: 1,
        regions: region,
    };
    // Two rows of two texels, three apart in memory.
    let inward = region(range(input, 0, 20), 3, 1, 2);
    let outward = region(range(output, 0, 64), 0, 0, 4);
    gpu.run(|commands| {
        // SAFETY: the ranges lie in the buffers; the structures outlive the calls.
        unsafe {
            into(commands, &info(&inward));
            gpu.barrier(commands);
            out(commands, &info(&outward));
        }
    });
    let expected = [1, 1, 1, 1, 1, 10, 11, 1, 1, 12, 13, 1, 1, 1, 1, 1];
    assert_eq!(output.read::<u32>(), expected);
}

/// `VkDispatchIndirect2InfoKHR`.
#[repr(C)]
struct DispatchInfo {
    s_type: vk::StructureType,
    p_next: *const c_void,
    range: DeviceAddressRangeKHR,
    flags: u32,
}

#[test]
fn a_dispatch_takes_its_size_from_an_address() {
    let Some(gpu) = gpu_with_address_commands() else {
        return;
    };
    let dispatch: WithInfo<DispatchInfo> = function(&gpu, c"vkCmdDispatchIndirect2KHR");
    let counter = gpu.buffer(4);
    let sizes = gpu.buffer_with(&[7u32, 3, 2, 1]);
    let set = gpu.set_of(&[counter.into()]);
    let kernel = gpu.kernel(
        "layout(local_size_x = 1) in;
        layout(set = 0, binding = 0, std430) buffer C { uint count; };
        void main() { atomicAdd(count, 1); }",
        &[set.layout],
    );
    let info = DispatchInfo {
        s_type: structure(11),
        p_next: std::ptr::null(),
        range: range(sizes, 4, 12),
        flags: OF_STORAGE,
    };
    gpu.run(|commands| {
        gpu.bind_kernel(commands, kernel, &[set], &[]);
        // SAFETY: the command buffer is being recorded; everything lives as long as the device.
        unsafe {
            dispatch(commands, &info);
        }
    });
    assert_eq!(counter.read::<u32>(), [6]);
}

/// `VkStridedDeviceAddressRangeKHR`.
#[repr(C)]
struct StridedRange {
    address: u64,
    size: u64,
    stride: u64,
}

type CopyResults = unsafe extern "system" fn(
    vk::CommandBuffer,
    vk::QueryPool,
    u32,
    u32,
    *const StridedRange,
    u32,
    vk::QueryResultFlags,
);

#[test]
fn query_results_go_to_an_address() {
    let Some(gpu) = gpu_with_address_commands() else {
        return;
    };
    let copy: CopyResults = function(&gpu, c"vkCmdCopyQueryPoolResultsToMemoryKHR");
    let output = gpu.buffer(48);
    let results = StridedRange {
        address: output.address + 8,
        size: 24,
        stride: 16,
    };
    let pool = gpu.queries(vk::QueryType::TIMESTAMP, 2);
    // SAFETY: the command buffer is being recorded, and the handles are of this device.
    gpu.run(|commands| unsafe {
        gpu.device.cmd_reset_query_pool(commands, pool, 0, 2);
        for query in 0..2 {
            let stage = vk::PipelineStageFlags::ALL_COMMANDS;
            gpu.device.cmd_write_timestamp(commands, stage, pool, query);
        }
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        copy(commands, pool, 0, 2, &results, OF_STORAGE, flags);
    });
    let words: Vec<u64> = output.read();
    assert_eq!([words[0], words[2], words[4], words[5]], [0; 4]);
    assert!(words[1] > 0 && words[3] >= words[1], "{words:?}");
}

/// `VkDrawIndirect2InfoKHR`.
#[repr(C)]
struct DrawInfo {
    s_type: vk::StructureType,
    p_next: *const c_void,
    range: StridedRange,
    flags: u32,
    count: u32,
}

/// `VkDrawIndirectCount2InfoKHR`.
#[repr(C)]
struct DrawCountInfo {
    s_type: vk::StructureType,
    p_next: *const c_void,
    range: StridedRange,
    flags: u32,
    count: DeviceAddressRangeKHR,
    count_flags: u32,
    most: u32,
}

/// `vkCmdDrawMeshTasksIndirect2EXT` and `vkCmdDrawMeshTasksIndirectCount2EXT`: a pixel for each
/// workgroup, a row for each draw.
#[test]
fn draws_take_their_workgroups_from_an_address() {
    let Some(gpu) = gpu_with_address_commands() else {
        return;
    };
    let has_stage = |gpu: &Gpu| gpu.optional.mesh_shader.mesh_shader == vk::TRUE;
    let Some(gpu) = gpu.with("mesh shaders", |gpu| gpu.has_graphics() && has_stage(gpu)) else {
        return;
    };
    let mesh = "
        layout(points, max_vertices = 1, max_primitives = 1) out;
        void main() {
            SetMeshOutputsEXT(1, 1);
            vec2 at = (vec2(gl_WorkGroupID.x, gl_DrawID) + 0.5) / 4.0 - 1.0;
            gl_MeshVerticesEXT[0].gl_Position = vec4(at, 0.5, 1.0);
            gl_MeshVerticesEXT[0].gl_PointSize = 1.0;
            gl_PrimitivePointIndicesEXT[0] = 0;
        }";
    let mut painting = Painting::new(&gpu, "", WHITE, RGBA);
    painting.mesh = Some((None, mesh));
    let pipeline = gpu.painting(&painting);
    let sizes = gpu.buffer_with(&[0u32, 3, 1, 1, 9, 5, 1, 1, 9, 8, 1, 1]);
    let counts = gpu.buffer_with(&[9u32, 2]);
    let strided = || StridedRange {
        address: sizes.address + 4,
        size: 44,
        stride: 16,
    };
    let by_number: WithInfo<DrawInfo> = function(&gpu, c"vkCmdDrawMeshTasksIndirect2EXT");
    let by_count: WithInfo<DrawCountInfo> = function(&gpu, c"vkCmdDrawMeshTasksIndirectCount2EXT");
    for (counted, rows) in [(false, &[3, 5, 8][..]), (true, &[3, 5])] {
        let canvas = gpu.canvas(RGBA, 8, 8);
        gpu.paint(&canvas, pipeline, |commands| {
            let number = DrawInfo {
                s_type: structure(9),
                p_next: std::ptr::null(),
                range: strided(),
                flags: OF_STORAGE,
                count: 3,
            };
            let count = DrawCountInfo {
                s_type: structure(10),
                p_next: std::ptr::null(),
                range: strided(),
                flags: OF_STORAGE,
                count: range(counts, 4, 4),
                count_flags: OF_STORAGE,
                most: 3,
            };
            // SAFETY: the command buffer is being recorded; everything lives as long as the device.
            unsafe {
                match counted {
                    false => by_number(commands, &number),
                    true => by_count(commands, &count),
                }
            }
        });
        for (pixel, color) in gpu.colors(&canvas).iter().enumerate() {
            let width = rows.get(pixel / 8).copied().unwrap_or(0);
            let is_drawn = *color == [255; 4];
            assert_eq!(
                is_drawn,
                pixel % 8 < width,
                "pixel {pixel}, counted: {counted}"
            );
        }
    }
}

/// `VkCopyMemoryIndirectInfoKHR`.
#[repr(C)]
struct IndirectCopyInfo {
    s_type: vk::StructureType,
    p_next: *const c_void,
    source_flags: u32,
    destination_flags: u32,
    count: u32,
    parameters: [u64; 3],
}

/// `VkCopyMemoryToImageIndirectInfoKHR`.
#[repr(C)]
struct IndirectImageCopyInfo {
    s_type: vk::StructureType,
    p_next: *const c_void,
    source_flags: u32,
    count: u32,
    parameters: [u64; 3],
    image: vk::Image,
    layout: vk::ImageLayout,
    layers: *const vk::ImageSubresourceLayers,
}

/// The words of a `VkCopyMemoryToImageIndirectCommandKHR` into layers from a first one on (first,
/// count), one slice deep.
fn region(
    source: u64,
    row_length: u32,
    [layer, layers]: [u32; 2],
    [x, y]: [u32; 2],
    [width, height]: [u32; 2],
) -> [u32; 14] {
    let (low, high) = (source as u32, (source >> 32) as u32);
    [
        low, high, row_length, 0, 1, 0, layer, layers, x, y, 0, width, height, 1,
    ]
}

/// A device that copies what memory says.
#[track_caller]
fn gpu_with_indirect_copies() -> Option<Gpu> {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 330));
    gpu.with("VK_KHR_copy_memory_indirect", |gpu| {
        let features = gpu.optional.indirect_copies;
        features.indirect_memory_copy != 0 && features.indirect_memory_to_image_copy != 0
    })
}

/// The slices of a 3D image are named by the layers, as the command is recorded with them: "the
/// starting slice and number of slices to copy are specified in
/// `pImageSubresources->baseArrayLayer` and `pImageSubresources->layerCount`"
/// (`vkCmdCopyMemoryToImageIndirectKHR`).
#[test]
fn indirect_copies_to_volumes_take_slices_from_layers() {
    let Some(gpu) = gpu_with_indirect_copies() else {
        return;
    };
    let words: Vec<u32> = (1..=64).collect();
    let source = gpu.buffer_with(&words);
    let shape = Shape {
        kind: vk::ImageViewType::TYPE_3D,
        extent: [4, 2, 8],
        ..Shape::flat(vk::Format::R32_UINT, 4, 2)
    };
    let usage = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
    let picture = gpu.picture(shape, usage);
    gpu.upload(&picture, 0, &[0u32; 64]);
    // Slices 0 to 2 from the first words on, two texels of slice 5 from the fortieth, slices 6 and
    // 7 in part.
    let copies = [
        (0, [0, 3], [0, 0], [4, 2]),
        (39, [5, 1], [1, 1], [2, 1]),
        (48, [6, 2], [3, 0], [1, 2]),
    ];
    let regions = copies.map(|(word, layers, offset, extent)| {
        region(source.address + 4 * word, 0, layers, offset, extent)
    });
    let regions = gpu.buffer_with(regions.as_flattened());
    let layers = copies.map(|(_, [first, count], ..)| {
        vk::ImageSubresourceLayers::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .base_array_layer(first)
            .layer_count(count)
    });
    let info = IndirectImageCopyInfo {
        s_type: vk::StructureType::from_raw(1_000_549_003),
        p_next: std::ptr::null(),
        source_flags: 0,
        count: copies.len() as u32,
        parameters: [regions.address, 56 * copies.len() as u64, 56],
        image: picture.handle,
        layout: vk::ImageLayout::GENERAL,
        layers: layers.as_ptr(),
    };
    let copy: WithInfo<IndirectImageCopyInfo> =
        function(&gpu, c"vkCmdCopyMemoryToImageIndirectKHR");
    gpu.run(|commands| {
        // SAFETY: the structures outlive the call, and the buffers and the image the execution.
        unsafe { copy(commands, &info) };
    });
    let mut expected = [0u32; 64];
    for (word, [first, count], [x, y], [width, height]) in copies {
        let mut next = word as usize;
        for slice in first..first + count {
            for row in y..y + height {
                for column in x..x + width {
                    expected[(slice * 8 + row * 4 + column) as usize] = words[next];
                    next += 1;
                }
            }
        }
    }
    assert_eq!(gpu.download(&picture, 0, 4).read::<u32>(), expected);
}

/// `VK_KHR_copy_memory_indirect`: what is copied where is read when the copies are performed.
#[test]
fn copies_are_read_from_memory() {
    let Some(gpu) = gpu_with_indirect_copies() else {
        return;
    };
    let words: Vec<u32> = (0..64).collect();
    let source = gpu.buffer_with(&words);
    let output = gpu.buffer(4 * 64);
    // Two copies, 32 bytes apart.
    let parameters = gpu.buffer_with(&[
        source.address + 16,
        output.address,
        8,
        !0,
        source.address + 128,
        output.address + 64,
        32,
        !0,
    ]);
    let info = IndirectCopyInfo {
        s_type: vk::StructureType::from_raw(1_000_549_002),
        p_next: std::ptr::null(),
        source_flags: 0,
        destination_flags: 0,
        count: 2,
        parameters: [parameters.address, 64, 32],
    };
    let copy: WithInfo<IndirectCopyInfo> = function(&gpu, c"vkCmdCopyMemoryIndirectKHR");

    let usage = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
    let shape = Shape::flat(vk::Format::R32_UINT, 8, 4);
    let picture = gpu.picture(shape, usage);
    let layers = vk::ImageSubresourceLayers::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .layer_count(1);
    // All of the image from rows of ten words, and then a part of it.
    let regions = gpu.buffer_with(
        [
            region(source.address, 10, [0, 1], [0, 0], [8, 4]),
            region(source.address + 200, 0, [0, 1], [2, 1], [3, 2]),
        ]
        .as_flattened(),
    );
    let both = [layers; 2];
    let image_info = IndirectImageCopyInfo {
        s_type: vk::StructureType::from_raw(1_000_549_003),
        p_next: std::ptr::null(),
        source_flags: 0,
        count: 1,
        parameters: [regions.address, 112, 56],
        image: picture.handle,
        layout: vk::ImageLayout::GENERAL,
        layers: both.as_ptr(),
    };
    let part = IndirectImageCopyInfo {
        parameters: [regions.address + 56, 56, 56],
        ..image_info
    };
    let image_copy: WithInfo<IndirectImageCopyInfo> =
        function(&gpu, c"vkCmdCopyMemoryToImageIndirectKHR");
    gpu.run(|commands| {
        // SAFETY: the structures outlive the calls, and the buffers and the image the execution.
        unsafe {
            gpu.device
                .cmd_fill_buffer(commands, output.handle, 0, 256, 0);
            gpu.barrier(commands);
            copy(commands, &info);
            image_copy(commands, &image_info);
            gpu.barrier(commands);
            image_copy(commands, &part);
        }
    });
    let mut expected = vec![0u32; 64];
    expected[..2].copy_from_slice(&words[4..6]);
    expected[16..24].copy_from_slice(&words[32..40]);
    assert_eq!(output.read::<u32>(), expected);
    let mut texels: Vec<u32> = (0..32).map(|i| i / 8 * 10 + i % 8).collect();
    for (index, word) in (50..56).enumerate() {
        texels[(1 + index / 3) * 8 + 2 + index % 3] = word;
    }
    assert_eq!(gpu.download(&picture, 0, 4).read::<u32>(), texels);
}
