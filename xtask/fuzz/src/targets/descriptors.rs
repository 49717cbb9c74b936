//! Descriptor buffers into which somebody has written.

use ash::ext::descriptor_buffer;
use ash::vk;

use crate::case::{Case, wild};
use crate::world::{HEAD, World};
use tuff_tests::{Kernel, Stage, glsl};

const SOURCE: &str = r"
    layout(local_size_x = 16) in;
    void main() {
        uint i = gl_LocalInvocationIndex;
        b[i] = b[i + 1u] + floatBitsToUint(u[i].x);
        vec4 c = texelFetch(t, ivec2(i & 7u), 0) + textureLod(t, vec2(i) * 0.1, 0.0);
        imageStore(p, ivec2(i, 1), c + imageLoad(p, ivec2(i)));
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0u, 0xff, vec3(0.01 * i, 0.01, 0), 0.0, vec3(0, 0, 1), 50.0);
        while (rayQueryProceedEXT(q)) {}
        b[64 + i] = rayQueryGetIntersectionTypeEXT(q, true);
    }";

const KINDS: [vk::DescriptorType; 5] = [
    vk::DescriptorType::STORAGE_BUFFER,
    vk::DescriptorType::UNIFORM_BUFFER,
    vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
    vk::DescriptorType::STORAGE_IMAGE,
    vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
];

/// The bytes of a sound descriptor.
fn descriptor(
    world: &World,
    commands: &descriptor_buffer::Device,
    properties: &vk::PhysicalDeviceDescriptorBufferPropertiesEXT<'_>,
    kind: vk::DescriptorType,
) -> Vec<u8> {
    let p = properties;
    let range = |guarded: &crate::guard::Guarded| {
        vk::DescriptorAddressInfoEXT::default()
            .address(guarded.address())
            .range(guarded.size_bytes)
    };
    let (storage, uniform) = (range(&world.guarded[0]), range(&world.guarded[1]));
    let image = vk::DescriptorImageInfo {
        sampler: world.sampler,
        image_view: world.picture.view,
        image_layout: vk::ImageLayout::GENERAL,
    };
    let (size, data) = match kind {
        vk::DescriptorType::STORAGE_BUFFER => (
            p.storage_buffer_descriptor_size,
            vk::DescriptorDataEXT {
                p_storage_buffer: &storage,
            },
        ),
        vk::DescriptorType::UNIFORM_BUFFER => (
            p.uniform_buffer_descriptor_size,
            vk::DescriptorDataEXT {
                p_uniform_buffer: &uniform,
            },
        ),
        vk::DescriptorType::COMBINED_IMAGE_SAMPLER => (
            p.combined_image_sampler_descriptor_size,
            vk::DescriptorDataEXT {
                p_combined_image_sampler: &image,
            },
        ),
        vk::DescriptorType::STORAGE_IMAGE => (
            p.storage_image_descriptor_size,
            vk::DescriptorDataEXT {
                p_storage_image: &image,
            },
        ),
        _ => (
            p.acceleration_structure_descriptor_size,
            vk::DescriptorDataEXT {
                acceleration_structure: world.levels[1].address,
            },
        ),
    };
    let info = vk::DescriptorGetInfoEXT::default().ty(kind).data(data);
    let mut bytes = vec![0; size];
    // SAFETY: what the info points to is alive, and there is room.
    unsafe { commands.get_descriptor(&info, &mut bytes) };
    bytes
}

pub fn run(world: &World, case: &Case) {
    let gpu = &world.gpu;
    if gpu.optional.descriptor_buffer.descriptor_buffer == vk::FALSE {
        return;
    }
    let commands = descriptor_buffer::Device::new(&gpu.instance, &gpu.device);
    let mut properties = vk::PhysicalDeviceDescriptorBufferPropertiesEXT::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut properties);
    // SAFETY: the physical device is of the instance.
    unsafe { (gpu.instance).get_physical_device_properties2(gpu.physical, &mut all) };
    let bindings: Vec<_> = (0..).zip(KINDS).map(|(i, kind)| (i, kind, 1)).collect();
    let flags = vk::DescriptorSetLayoutCreateFlags::DESCRIPTOR_BUFFER_EXT;
    let set = gpu.set_layout_of(&bindings, flags);
    let uses = vk::BufferUsageFlags::RESOURCE_DESCRIPTOR_BUFFER_EXT
        | vk::BufferUsageFlags::SAMPLER_DESCRIPTOR_BUFFER_EXT;
    // SAFETY: the layout is for descriptor buffers.
    let size = unsafe { commands.get_descriptor_set_layout_size(set) };
    let buffer = gpu.buffer_for(size, uses);
    for (binding, kind) in (0..).zip(KINDS) {
        let bytes = descriptor(world, &commands, &properties, kind);
        // SAFETY: the layout is for descriptor buffers.
        let at = unsafe { commands.get_descriptor_set_layout_binding_offset(set, binding) };
        buffer.write(at as usize, &bytes);
    }
    // The nonsense.
    let mut bytes = buffer.read::<u8>();
    for mut rng in case.steps() {
        let at = rng.usize(0..bytes.len());
        match rng.u32(0..4) {
            0 => bytes[at] = rng.u8(..),
            1 => bytes[at] ^= 1 << rng.u32(0..8),
            _ => {
                let at = (at & !7).min(bytes.len().saturating_sub(8));
                let word = match rng.bool() {
                    true => wild(&mut rng),
                    false => world.guarded[0].buffer.address + rng.u64(0..65536),
                };
                let length = bytes.len().min(8);
                bytes[at..at + length].copy_from_slice(&word.to_le_bytes()[..length]);
            }
        }
    }
    buffer.write(0, &bytes);
    let mut rng = case.common();
    let address = match rng.u32(0..10) {
        0 => wild(&mut rng),
        _ => buffer.address,
    };
    let offset = match rng.u32(0..10) {
        0 => wild(&mut rng),
        _ => 0,
    };
    let layout = gpu.layout(&[set]);
    let words = glsl(Stage::Compute, &format!("{HEAD}{SOURCE}"));
    let flags = vk::PipelineCreateFlags::DESCRIPTOR_BUFFER_EXT;
    let pipeline = pipeline(world, &words, layout, flags);
    let kernel = Kernel { pipeline, layout };
    let binding = vk::DescriptorBufferBindingInfoEXT::default()
        .address(address)
        .usage(uses);
    world.run(|buffer| {
        // SAFETY: the handles live as long as the device; the rest the driver has to bear.
        unsafe {
            commands.cmd_bind_descriptor_buffers(buffer, &[binding]);
            let point = vk::PipelineBindPoint::COMPUTE;
            commands.cmd_set_descriptor_buffer_offsets(buffer, point, layout, 0, &[0], &[offset]);
        }
        gpu.record_dispatch::<u32>(buffer, kernel, &[], &[], [1, 1, 1]);
    });
    // SAFETY: nothing uses it any more.
    unsafe { gpu.device.destroy_pipeline(pipeline, None) };
    // A descriptor may have pointed to the written memory.
    world.guarded.iter().for_each(crate::guard::Guarded::renew);
}

fn pipeline(
    world: &World,
    words: &[u32],
    layout: vk::PipelineLayout,
    flags: vk::PipelineCreateFlags,
) -> vk::Pipeline {
    let device = &world.gpu.device;
    let info = vk::ShaderModuleCreateInfo::default().code(words);
    // SAFETY: the structures outlive the calls.
    unsafe {
        let module = device.create_shader_module(&info, None).expect("a module");
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        let info = vk::ComputePipelineCreateInfo::default()
            .flags(flags)
            .stage(stage)
            .layout(layout);
        let made = device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
        device.destroy_shader_module(module, None);
        made.expect("a pipeline")[0]
    }
}
