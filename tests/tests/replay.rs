//! Capture and replay: objects that are made again get the addresses that were captured, whatever
//! else was allocated before.

use std::sync::{Mutex, MutexGuard, PoisonError};

use tuff_tests::*;

/// Carries the captured addresses to another process.
const CAPTURED: &str = "TUFF_TESTS_CAPTURED";

/// Bytes of the buffers that are captured.
const SIZES: [u64; 6] = [64, 100_000, 1 << 20, 64 << 10, 300_000, 4];

/// Held during a test: captured addresses are free only while no other device of the process has
/// them.
static DEVICES: Mutex<()> = Mutex::new(());

fn no_other_device() -> MutexGuard<'static, ()> {
    DEVICES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The captured addresses of a buffer: that of its memory, and its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Captured {
    memory: u64,
    buffer: u64,
}

/// A buffer with memory of its own, whose addresses can be captured. `again` asks for addresses.
struct Replayable {
    handle: vk::Buffer,
    memory: vk::DeviceMemory,
    addresses: Captured,
}

/// Makes the buffer.
fn replayable(
    gpu: &Gpu,
    size_bytes: u64,
    again: Option<Captured>,
) -> Result<Replayable, vk::Result> {
    let mut of_buffer = vk::BufferOpaqueCaptureAddressCreateInfo::default();
    let mut of_memory = vk::MemoryOpaqueCaptureAddressAllocateInfo::default();
    let mut info = vk::BufferCreateInfo::default()
        .flags(vk::BufferCreateFlags::DEVICE_ADDRESS_CAPTURE_REPLAY)
        .size(size_bytes)
        .usage(gpu.usual_uses());
    let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(
        vk::MemoryAllocateFlags::DEVICE_ADDRESS
            | vk::MemoryAllocateFlags::DEVICE_ADDRESS_CAPTURE_REPLAY,
    );
    let mut allocation = vk::MemoryAllocateInfo::default().push_next(&mut flags);
    if let Some(again) = again {
        of_buffer.opaque_capture_address = again.buffer;
        of_memory.opaque_capture_address = again.memory;
        info = info.push_next(&mut of_buffer);
        allocation = allocation.push_next(&mut of_memory);
    }
    // SAFETY: the structures outlive the calls; what is made goes by `destroy`.
    unsafe {
        let handle = gpu.device.create_buffer(&info, None)?;
        let needs = gpu.device.get_buffer_memory_requirements(handle);
        allocation.allocation_size = needs.size;
        allocation.memory_type_index = needs.memory_type_bits.trailing_zeros();
        let memory = match gpu.device.allocate_memory(&allocation, None) {
            Ok(memory) => memory,
            Err(error) => {
                gpu.device.destroy_buffer(handle, None);
                return Err(error);
            }
        };
        let bound = gpu.device.bind_buffer_memory(handle, memory, 0);
        bound.expect("vkBindBufferMemory");
        let of_memory = vk::DeviceMemoryOpaqueCaptureAddressInfo::default().memory(memory);
        let of_buffer = vk::BufferDeviceAddressInfo::default().buffer(handle);
        let addresses = Captured {
            memory: gpu
                .device
                .get_device_memory_opaque_capture_address(&of_memory),
            buffer: gpu.device.get_buffer_opaque_capture_address(&of_buffer),
        };
        assert!(addresses.memory != 0 && addresses.buffer != 0);
        if let Some(again) = again {
            assert_eq!(addresses, again);
            let address = gpu.device.get_buffer_device_address(&of_buffer);
            assert_ne!(address, 0);
        }
        Ok(Replayable {
            handle,
            memory,
            addresses,
        })
    }
}

/// A sparse buffer with such an address, and that.
fn sparse(gpu: &Gpu, again: u64) -> (vk::Buffer, u64) {
    let mut of_buffer =
        vk::BufferOpaqueCaptureAddressCreateInfo::default().opaque_capture_address(again);
    let info = vk::BufferCreateInfo::default()
        .flags(
            vk::BufferCreateFlags::SPARSE_BINDING
                | vk::BufferCreateFlags::DEVICE_ADDRESS_CAPTURE_REPLAY,
        )
        .size(1 << 20)
        .usage(vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS)
        .push_next(&mut of_buffer);
    // SAFETY: `info` outlives the call.
    unsafe {
        let buffer = gpu.device.create_buffer(&info, None);
        let buffer = buffer.expect("vkCreateBuffer");
        let info = vk::BufferDeviceAddressInfo::default().buffer(buffer);
        (buffer, gpu.device.get_buffer_opaque_capture_address(&info))
    }
}

/// An acceleration structure in a buffer, and its address. `again` is the address that it had.
fn structure(
    gpu: &Gpu,
    buffer: vk::Buffer,
    again: u64,
) -> Result<(vk::AccelerationStructureKHR, u64), vk::Result> {
    let info = vk::AccelerationStructureCreateInfoKHR::default()
        .create_flags(vk::AccelerationStructureCreateFlagsKHR::DEVICE_ADDRESS_CAPTURE_REPLAY)
        .buffer(buffer)
        .offset(256)
        .size(4096)
        .ty(vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL)
        .device_address(again);
    // SAFETY: the range lies in the buffer.
    unsafe {
        let structure = gpu
            .acceleration
            .create_acceleration_structure(&info, None)?;
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default()
            .acceleration_structure(structure);
        let address = gpu
            .acceleration
            .get_acceleration_structure_device_address(&info);
        Ok((structure, address))
    }
}

fn destroy(gpu: &Gpu, buffers: Vec<Replayable>) {
    for it in buffers {
        // SAFETY: the buffers are of this device, and nothing uses them any more.
        unsafe {
            gpu.device.destroy_buffer(it.handle, None);
            gpu.device.free_memory(it.memory, None);
        }
    }
}

fn has_sparse(gpu: &Gpu) -> bool {
    gpu.features.sparse_binding != 0
}

/// Where the structure lies: the buffer is large enough.
const OF_STRUCTURE: usize = 4;

/// All captured addresses: of the buffers, of the sparse one and of the structure; zero for what
/// the device lacks.
struct Capture {
    buffers: Vec<Captured>,
    sparse: u64,
    structure: u64,
}

impl Capture {
    /// Makes the objects between ordinary ones, and forgets them.
    fn new(gpu: &Gpu) -> Capture {
        let mut made = Vec::new();
        for size_bytes in SIZES {
            gpu.buffer(size_bytes);
            made.push(replayable(gpu, size_bytes, None).expect("a buffer"));
        }
        let mut capture = Capture {
            buffers: made.iter().map(|it| it.addresses).collect(),
            sparse: 0,
            structure: 0,
        };
        // SAFETY: the objects are of this device, and nothing uses them any more.
        unsafe {
            if has_sparse(gpu) {
                let (buffer, address) = sparse(gpu, 0);
                capture.sparse = address;
                gpu.device.destroy_buffer(buffer, None);
            }
            if gpu.replays_structures {
                let made = structure(gpu, made[OF_STRUCTURE].handle, 0);
                let (structure, address) = made.expect("a structure");
                capture.structure = address;
                gpu.acceleration
                    .destroy_acceleration_structure(structure, None);
            }
        }
        destroy(gpu, made);
        capture
    }

    fn to_text(&self) -> String {
        let buffers = self.buffers.iter().flat_map(|it| [it.memory, it.buffer]);
        let numbers = [self.sparse, self.structure].into_iter().chain(buffers);
        numbers.map(|it| it.to_string() + " ").collect()
    }

    fn from_text(text: &str) -> Capture {
        let numbers = text
            .split_whitespace()
            .map(|it| it.parse().expect("a number"));
        let numbers: Vec<u64> = numbers.collect();
        let buffers = numbers[2..].chunks(2).map(|pair| Captured {
            memory: pair[0],
            buffer: pair[1],
        });
        Capture {
            buffers: buffers.collect(),
            sparse: numbers[0],
            structure: numbers[1],
        }
    }

    /// Makes the objects again, last things first, after other memory was allocated.
    fn replay(&self, gpu: &Gpu) {
        for round in 0..40 {
            gpu.buffer(SIZES[round % SIZES.len()] + 5_000);
        }
        gpu.picture(
            Shape::flat(vk::Format::R8G8B8A8_UNORM, 1024, 1024),
            vk::ImageUsageFlags::TRANSFER_DST,
        );
        let of_sparse = (self.sparse != 0).then(|| {
            let (buffer, address) = sparse(gpu, self.sparse);
            assert_eq!(address, self.sparse);
            buffer
        });
        let mut made = Vec::new();
        for (size_bytes, &captured) in SIZES.into_iter().zip(&self.buffers).rev() {
            gpu.buffer(size_bytes);
            made.push(replayable(gpu, size_bytes, Some(captured)).expect("its addresses"));
        }
        made.reverse();
        if self.structure != 0 {
            self.replay_structure(gpu, &made);
        }
        write_and_read(gpu, &made);
        // An address that is in use is no longer to be had.
        let taken = replayable(gpu, SIZES[0], Some(self.buffers[0])).err();
        assert_eq!(
            taken,
            Some(vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS)
        );
        // SAFETY: the buffer is of this device, and nothing uses it.
        unsafe {
            if let Some(buffer) = of_sparse {
                gpu.device.destroy_buffer(buffer, None);
            }
        }
        destroy(gpu, made);
    }

    fn replay_structure(&self, gpu: &Gpu, made: &[Replayable]) {
        let again = structure(gpu, made[OF_STRUCTURE].handle, self.structure);
        let (handle, address) = again.expect("its address");
        assert_eq!(address, self.structure);
        // SAFETY: the structure is of this device, and nothing uses it.
        unsafe {
            gpu.acceleration
                .destroy_acceleration_structure(handle, None)
        };
    }
}

/// The addresses lead to the buffers' memory: a shader writes there, and a copy reads it.
fn write_and_read(gpu: &Gpu, made: &[Replayable]) {
    let addresses: Vec<u64> = made
        .iter()
        .map(|it| {
            let info = vk::BufferDeviceAddressInfo::default().buffer(it.handle);
            // SAFETY: the buffer is of this device, and bound.
            unsafe { gpu.device.get_buffer_device_address(&info) }
        })
        .collect();
    let set = gpu.set_of(&[gpu.buffer_with(&addresses).into()]);
    let kernel = gpu.kernel(
        "#extension GL_EXT_buffer_reference : require
        #extension GL_EXT_buffer_reference_uvec2 : require
        layout(local_size_x = 1) in;
        layout(buffer_reference, std430) buffer Word { uint word; };
        layout(set = 0, binding = 0, std430) buffer A { uvec2 addresses[]; };
        void main() { Word(addresses[gl_WorkGroupID.x]).word = 100 + gl_WorkGroupID.x; }",
        &[set.layout],
    );
    let count = made.len() as u32;
    gpu.dispatch::<u32>(kernel, &[set], &[], [count, 1, 1]);
    let output = gpu.buffer(4 * u64::from(count));
    gpu.run(|commands| {
        for (index, it) in (0..).zip(made) {
            let region = [vk::BufferCopy::default().dst_offset(4 * index).size(4)];
            // SAFETY: the ranges lie in the buffers, which outlive the execution.
            unsafe {
                gpu.device
                    .cmd_copy_buffer(commands, it.handle, output.handle, &region);
            }
        }
    });
    let expected: Vec<u32> = (100..100 + count).collect();
    assert_eq!(output.read::<u32>(), expected);
}

#[test]
fn captured_addresses_are_had_again_on_another_device() {
    let _alone = no_other_device();
    let Some(gpu) = Gpu::replaying() else { return };
    let capture = Capture::new(&gpu);
    drop(gpu);
    capture.replay(&Gpu::replaying().expect("as before"));
}

#[test]
fn captured_addresses_are_had_again_in_another_process() {
    const TEST: &str = "captured_addresses_are_had_again_in_another_process";
    let _alone = no_other_device();
    let Some(gpu) = Gpu::replaying() else { return };
    match std::env::var(CAPTURED) {
        Ok(text) => Capture::from_text(&text).replay(&gpu),
        Err(_) => {
            let text = Capture::new(&gpu).to_text();
            alone(TEST, &[(CAPTURED, &text)]);
        }
    }
}

/// A structure lies in its buffer: where that has another address, the structure's cannot be had.
#[test]
fn a_structure_elsewhere_does_not_get_its_address() {
    let _alone = no_other_device();
    let Some(gpu) = Gpu::replaying() else { return };
    if !has("accelerationStructureCaptureReplay", gpu.replays_structures) {
        return;
    }
    let made: Vec<_> = (0..2)
        .map(|_| replayable(&gpu, SIZES[OF_STRUCTURE], None).expect("a buffer"))
        .collect();
    let (first, address) = structure(&gpu, made[0].handle, 0).expect("a structure");
    let second = structure(&gpu, made[1].handle, address).err();
    // SAFETY: the structure is of this device, and nothing uses it.
    unsafe { gpu.acceleration.destroy_acceleration_structure(first, None) };
    destroy(&gpu, made);
    assert_eq!(
        second,
        Some(vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS)
    );
}

/// A pipeline whose callables answer 10, 11 and 12, with group handles for capture. `again` is the
/// captured handles.
fn callables(gpu: &Gpu, again: Option<&[u8]>) -> (Rays, Buffer) {
    let raygen = r"
    layout(set = 0, binding = 0, std430) buffer R { uint results[]; };
    layout(location = 0) callableDataEXT uint data;
    void main() {
        executeCallableEXT(gl_LaunchIDEXT.x, 0);
        results[gl_LaunchIDEXT.x] = data;
    }";
    let mut shaders = vec![(Stage::RayGeneration, glsl(Stage::RayGeneration, raygen))];
    shaders.extend((10..13).map(|answer| {
        let source = format!(
            "layout(location = 0) callableDataInEXT uint data; void main() {{ data = {answer}; }}"
        );
        (Stage::Callable, glsl(Stage::Callable, &source))
    }));
    let names: Vec<vk::ShaderModule> = shaders.iter().map(|(_, it)| gpu.module(it)).collect();
    let stages = shaders.iter().zip(&names).map(|((stage, _), &module)| {
        vk::PipelineShaderStageCreateInfo::default()
            .stage(stage_flag(*stage))
            .module(module)
            .name(c"main")
    });
    let stages: Vec<_> = stages.collect();
    let properties = &gpu.pipeline_properties;
    let size_bytes = properties.shader_group_handle_capture_replay_size as usize;
    let groups = (0..shaders.len()).map(|index| {
        let info = vk::RayTracingShaderGroupCreateInfoKHR::default()
            .ty(vk::RayTracingShaderGroupTypeKHR::GENERAL)
            .general_shader(index as u32)
            .closest_hit_shader(vk::SHADER_UNUSED_KHR)
            .any_hit_shader(vk::SHADER_UNUSED_KHR)
            .intersection_shader(vk::SHADER_UNUSED_KHR);
        match again {
            Some(handles) => info
                .shader_group_capture_replay_handle(handles[index * size_bytes..].as_ptr().cast()),
            None => info,
        }
    });
    let groups: Vec<_> = groups.collect();
    let output = gpu.buffer(12);
    let set = gpu.set_of(&[output.into()]);
    let layout = gpu.layout(&[set.layout]);
    let info = vk::RayTracingPipelineCreateInfoKHR::default()
        .flags(vk::PipelineCreateFlags::RAY_TRACING_SHADER_GROUP_HANDLE_CAPTURE_REPLAY_KHR)
        .stages(&stages)
        .groups(&groups)
        .max_pipeline_ray_recursion_depth(1)
        .layout(layout);
    // SAFETY: the structures and the handles that they point to outlive the call.
    let made = unsafe {
        gpu.ray_tracing.create_ray_tracing_pipelines(
            vk::DeferredOperationKHR::null(),
            vk::PipelineCache::null(),
            &[info],
            None,
        )
    };
    let pipeline = made.map_err(|(_, error)| error).expect("a pipeline")[0];
    gpu.keep_pipeline(pipeline);
    (gpu.rays_of(pipeline, layout, set, groups.len()), output)
}

/// The handles of the groups for capture and those in binding tables, one behind the other.
fn captured_handles(gpu: &Gpu) -> [Vec<u8>; 2] {
    let (rays, _) = callables(gpu, None);
    let count = rays.handles.len() as u32;
    let size_bytes = gpu
        .pipeline_properties
        .shader_group_handle_capture_replay_size;
    // SAFETY: the pipeline has these groups, and the flag for capture.
    let captured = unsafe {
        gpu.ray_tracing
            .get_ray_tracing_capture_replay_shader_group_handles(
                rays.pipeline,
                0,
                count,
                (count * size_bytes) as usize,
            )
    };
    [captured.expect("captured handles"), rays.handles.concat()]
}

/// A binding table of the captured process works after other pipelines were made.
fn replay_handles(gpu: &Gpu, [captured, handles]: [Vec<u8>; 2]) {
    let world = gpu.scene(&[Geometry::opaque(&[
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [0.0, 1.0, 1.0],
    ])]);
    assert_eq!(gpu.depths(world, 2), [1.0, -1.0]);
    let (mut rays, output) = callables(gpu, Some(&captured));
    assert_eq!(rays.handles.concat(), handles);
    let size_bytes = handles.len() / rays.handles.len();
    rays.handles = handles.chunks(size_bytes).map(<[u8]>::to_vec).collect();
    let table = Table {
        raygen: Record::of(0),
        callable: (1..4).map(Record::of).collect(),
        ..Table::default()
    };
    gpu.trace(&rays, &table, [3, 1, 1]);
    assert_eq!(output.read::<u32>(), [10, 11, 12]);
}

#[test]
fn captured_group_handles_are_had_again_in_another_process() {
    const TEST: &str = "captured_group_handles_are_had_again_in_another_process";
    let _alone = no_other_device();
    let Some(gpu) = Gpu::replaying() else { return };
    if !has(
        "rayTracingPipelineShaderGroupHandleCaptureReplay",
        gpu.replays_handles,
    ) {
        return;
    }
    let to_text = |bytes: &[u8]| bytes.iter().map(|it| format!("{it:02x}")).collect();
    let from_text = |text: &str| {
        let digits = (0..text.len()).step_by(2).map(|at| &text[at..at + 2]);
        let bytes = digits.map(|it| u8::from_str_radix(it, 16).expect("a byte"));
        bytes.collect::<Vec<u8>>()
    };
    match std::env::var(CAPTURED) {
        Ok(text) => {
            let (captured, handles) = text.split_once(' ').expect("two lists");
            replay_handles(&gpu, [captured, handles].map(from_text));
        }
        Err(_) => {
            let both: [String; 2] = captured_handles(&gpu).map(|it| to_text(&it));
            alone(TEST, &[(CAPTURED, &both.join(" "))]);
        }
    }
}
