//! `VK_EXT_descriptor_heap`: descriptors in memory, without sets.

use std::ptr::from_ref;

use tuff_tests::heaps::{HEAP_WITH_PUSH_INDEX, Heaps, PUSH_ADDRESS, PUSH_DATA, chained, mapping};
use tuff_tests::newer as vk;
use tuff_tests::*;
use vk::DescriptorType as Ty;

/// Places of descriptors in each of a test's heaps.
const PLACES: u64 = 16;

fn gpu_with_heaps() -> Option<Gpu> {
    Gpu::validated_since(vk::make_api_version(0, 1, 4, 340)).with("VK_EXT_descriptor_heap", |gpu| {
        gpu.optional.heaps.descriptor_heap != 0
    })
}

fn words(binding: u32, source: i32, offset: u32) -> vk::DescriptorSetAndBindingMappingEXT {
    let words = [offset, 0];
    let data = vk::DescriptorMappingSourceDataEXT { words };
    mapping(binding, source, data)
}

#[test]
fn buffers_are_found_at_offsets_by_indices_and_by_addresses() {
    let Some(gpu) = gpu_with_heaps() else { return };
    let it = Heaps::new(&gpu, PLACES);
    let results = gpu.buffer(64);
    let numbers = [10u32, 20, 30].map(|k| gpu.buffer_with(&[k, k + 1]));
    it.put_buffer(1, Ty::STORAGE_BUFFER, &results);
    for (place, buffer) in (4..).zip(&numbers) {
        it.put_buffer(place, Ty::STORAGE_BUFFER, buffer);
    }
    let push_index = vk::PushIndex {
        heap_offset: it.at(0),
        push_offset: 4,
        heap_index_stride: it.stride as u32,
        heap_array_stride: it.stride as u32,
        p_embedded_sampler: std::ptr::null(),
        use_combined_image_sampler_index: 0,
        sampler_heap_offset: 0,
        sampler_push_offset: 0,
        sampler_heap_index_stride: 0,
        sampler_heap_array_stride: 0,
    };
    let indexed = vk::DescriptorMappingSourceDataEXT { push_index };
    let mappings = [
        it.constant(0, 1),
        it.constant(1, 4),
        mapping(2, HEAP_WITH_PUSH_INDEX, indexed),
        words(3, PUSH_DATA, 16),
        words(4, PUSH_ADDRESS, 8),
    ];
    let source = "
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { uint r[]; };
    layout(set = 0, binding = 1) buffer A { uint a[]; } arrays[3];
    layout(set = 0, binding = 2) buffer I { uint i[]; } indexed[2];
    layout(set = 0, binding = 3) uniform D { uvec2 d; };
    layout(set = 0, binding = 4) readonly buffer P { uint p[2]; };
    layout(push_constant) uniform Push { uint which; };
    void main() {
        r[0] = arrays[which].a[0];
        r[1] = uint(arrays[1].a.length());
        r[2] = indexed[1].i[1];
        r[3] = d.y;
        r[4] = p[1];
        r[5] = arrays[which].a[2];
    }";
    let kernel = it.kernel(source, &mappings);
    let address = numbers[0].address;
    let push = [2u32, 4, address as u32, (address >> 32) as u32, 7, 8];
    gpu.run(|commands| {
        it.bind(commands);
        it.push(commands, &push);
        it.dispatch(commands, kernel);
    });
    assert_eq!(results.read::<u32>()[..6], [30, 2, 21, 8, 11, 0]);
}

#[test]
fn images_are_sampled_by_samplers_of_the_heap_and_by_embedded_ones() {
    let Some(gpu) = gpu_with_heaps() else { return };
    let it = Heaps::new(&gpu, PLACES);
    let shape = Shape::flat(vk::Format::R32_SFLOAT, 2, 1);
    let usage = vk::ImageUsageFlags::SAMPLED
        | vk::ImageUsageFlags::STORAGE
        | vk::ImageUsageFlags::TRANSFER_DST;
    let picture = gpu.picture(shape, usage);
    gpu.upload(&picture, 0, &[1.0f32, 3.0]);
    let view = vk::ImageViewCreateInfo::default()
        .image(picture.handle)
        .view_type(vk::ImageViewType::TYPE_2D)
        .format(vk::Format::R32_SFLOAT)
        .subresource_range(all_of(shape));
    let image = vk::ImageDescriptorInfoEXT {
        p_view: &view,
        layout: vk::ImageLayout::GENERAL,
        ..Default::default()
    };
    let nearest = vk::SamplerCreateInfo::default();
    let linear = vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
        .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE);
    let results = gpu.buffer(64);
    it.put_buffer(1, Ty::STORAGE_BUFFER, &results);
    let sampled = it.resource(Ty::SAMPLED_IMAGE, &image);
    assert!(sampled == it.resource(Ty::SAMPLED_IMAGE, &image));
    it.resources.write(it.at(2) as usize, &sampled);
    let stored = it.resource(Ty::STORAGE_IMAGE, &image);
    it.resources.write(it.at(3) as usize, &stored);
    // The same sampler has the same bits.
    assert!(it.sampler(&linear) == it.sampler(&linear));
    it.samplers.write(it.at(2) as usize, &it.sampler(&nearest));
    it.samplers.write(it.at(3) as usize, &it.sampler(&linear));
    let mappings = [
        it.constant(0, 1),
        it.constant(1, 2),
        it.constant(2, 2),
        it.constant(3, 3),
        it.constant(4, 2),
        it.embedding(5, 2, &linear),
    ];
    let source = "
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { float r[]; };
    layout(set = 0, binding = 1) uniform texture2D image;
    layout(set = 0, binding = 2) uniform sampler samplers[2];
    layout(set = 0, binding = 3, r32f) uniform image2D stored;
    layout(set = 0, binding = 4) uniform sampler2D combined;
    layout(set = 0, binding = 5) uniform sampler2D embedded;
    float at(sampler2D image) { return textureLod(image, vec2(0.5, 0.5), 0.0).x; }
    void main() {
        r[0] = textureLod(sampler2D(image, samplers[0]), vec2(0.7, 0.5), 0.0).x;
        r[1] = textureLod(sampler2D(image, samplers[1]), vec2(0.5, 0.5), 0.0).x;
        r[2] = imageLoad(stored, ivec2(1, 0)).x;
        r[3] = textureLod(combined, vec2(0.2, 0.5), 0.0).x;
        r[4] = at(embedded);
    }";
    let kernel = it.kernel(source, &mappings);
    gpu.run(|commands| {
        it.bind(commands);
        it.dispatch(commands, kernel);
    });
    assert_eq!(results.read::<f32>()[..5], [3.0, 2.0, 3.0, 1.0, 2.0]);
}

/// Other bytes than descriptors in a heap are misuse, which other drivers do not survive.
#[test]
fn forged_descriptors_read_zeros_and_write_nothing() {
    let Some(gpu) = gpu_with_heaps() else { return };
    if !gpu.is_tuff() {
        return;
    }
    let it = Heaps::new(&gpu, PLACES);
    let results = gpu.buffer_with(&[9u32; 8]);
    it.put_buffer(1, Ty::STORAGE_BUFFER, &results);
    let mappings = [it.constant(0, 1), it.constant(1, 2), it.constant(2, 2)];
    let source = "
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { uint r[]; };
    layout(set = 0, binding = 1) buffer F { uint f[]; } forged[4];
    layout(set = 0, binding = 2) uniform sampler2D images[4];
    void main() {
        for (uint k = 0; k < 4; ++k) {
            r[k] = forged[k].f[k];
            forged[k].f[k] = 1u;
            r[4 + k] = floatBitsToUint(textureLod(images[k], vec2(0.5), 0.0).x);
        }
    }";
    let kernel = it.kernel(source, &mappings);
    for words in [
        [u64::MAX; 4],
        [4096, 1 << 40, 2, 2],
        [1 << 63 | 2; 4],
        [8; 4],
    ] {
        for place in 2..6 {
            it.resources.write(it.at(place) as usize, &words);
            it.samplers.write(it.at(place) as usize, &words);
        }
        results.write(0, &[9u32; 8]);
        gpu.run(|commands| {
            it.bind(commands);
            it.dispatch(commands, kernel);
        });
        assert_eq!(results.read::<u32>()[..8], [0; 8], "{words:x?}");
    }
}

#[test]
fn secondary_command_buffers_inherit_heaps() {
    let Some(gpu) = gpu_with_heaps() else { return };
    let it = Heaps::new(&gpu, PLACES);
    let results = gpu.buffer(64);
    it.put_buffer(1, Ty::STORAGE_BUFFER, &results);
    let source = "
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { uint r[]; };
    void main() { r[0] = 5u; }";
    let kernel = it.kernel(source, &[it.constant(0, 1)]);
    let (resources, samplers) = (it.binding(&it.resources), it.binding(&it.samplers));
    let heaps = vk::CommandBufferInheritanceDescriptorHeapInfoEXT {
        p_sampler_heap_bind_info: &samplers,
        p_resource_heap_bind_info: &resources,
        ..Default::default()
    };
    let mut inheritance = vk::CommandBufferInheritanceInfo::default();
    inheritance.p_next = from_ref(&heaps).cast();
    let info = vk::CommandBufferAllocateInfo::default()
        .command_pool(gpu.pool)
        .level(vk::CommandBufferLevel::SECONDARY)
        .command_buffer_count(1);
    let begin = vk::CommandBufferBeginInfo::default().inheritance_info(&inheritance);
    // SAFETY: the structures outlive the calls; the commands are executed once.
    let secondary = unsafe {
        let device = &gpu.device;
        let secondary = device.allocate_command_buffers(&info).expect("commands")[0];
        device
            .begin_command_buffer(secondary, &begin)
            .expect("a beginning");
        it.dispatch(secondary, kernel);
        device.end_command_buffer(secondary).expect("an end");
        secondary
    };
    gpu.run(|commands| {
        it.bind(commands);
        // SAFETY: the commands are complete.
        unsafe { gpu.device.cmd_execute_commands(commands, &[secondary]) };
    });
    assert_eq!(results.read::<u32>()[0], 5);
}

/// `VK_SHADER_CREATE_DESCRIPTOR_HEAP_BIT_EXT`.
const SHADER_WITH_HEAPS: vk::ShaderCreateFlagsEXT = vk::ShaderCreateFlagsEXT::from_raw(1 << 10);

/// A compute shader that samples with an embedded sampler, from SPIR-V or from a binary.
fn sampling_shader(
    it: &Heaps<'_>,
    sampler: &vk::SamplerCreateInfo<'static>,
    (code_type, code): (vk::ShaderCodeTypeEXT, &[u8]),
) -> vk::ShaderEXT {
    let mappings = [it.constant(0, 1), it.embedding(1, 2, sampler)];
    let mapped = chained(&mappings);
    let mut info = vk::ShaderCreateInfoEXT::default()
        .flags(SHADER_WITH_HEAPS)
        .stage(vk::ShaderStageFlags::COMPUTE)
        .code_type(code_type)
        .code(code)
        .name(c"main");
    info.p_next = from_ref(&mapped).cast();
    let objects = ash::ext::shader_object::Device::new(&it.gpu.instance, &it.gpu.device);
    // SAFETY: the structures outlive the call.
    let made = unsafe { objects.create_shaders(&[info], None) };
    made.map_err(|(_, code)| code).expect("vkCreateShadersEXT")[0]
}

/// A binary's samplers are those of its mappings on a device that knows others before.
#[test]
fn binaries_have_their_embedded_samplers_on_other_devices() {
    let linear = vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
        .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE);
    let others = [0.25, 0.5, 0.75].map(|lod| linear.max_lod(lod));
    let source = "
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { float r[]; };
    layout(set = 0, binding = 1) uniform sampler2D image;
    void main() { r[0] = textureLod(image, vec2(0.5), 0.0).x; }";
    let words = glsl(Stage::Compute, source);
    let spirv = (vk::ShaderCodeTypeEXT::SPIRV, bytemuck::cast_slice(&words));
    let mut binary: Option<Vec<u8>> = None;
    for _ in 0..2 {
        let Some(gpu) = gpu_with_heaps() else { return };
        if !has(
            "VK_EXT_shader_object",
            gpu.optional.shader_object.shader_object == vk::TRUE,
        ) {
            return;
        }
        let it = Heaps::new(&gpu, PLACES);
        let objects = ash::ext::shader_object::Device::new(&gpu.instance, &gpu.device);
        let shape = Shape::flat(vk::Format::R32_SFLOAT, 2, 1);
        let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST;
        let picture = gpu.picture(shape, usage);
        gpu.upload(&picture, 0, &[1.0f32, 3.0]);
        let results = gpu.buffer(16);
        it.put_buffer(1, Ty::STORAGE_BUFFER, &results);
        it.put_picture(2, Ty::SAMPLED_IMAGE, &picture);
        let mut shaders = Vec::new();
        let shader = match &binary {
            None => sampling_shader(&it, &linear, spirv),
            Some(binary) => {
                shaders.extend(
                    others
                        .each_ref()
                        .map(|other| sampling_shader(&it, other, spirv)),
                );
                let code = (vk::ShaderCodeTypeEXT::BINARY, &binary[..]);
                sampling_shader(&it, &linear, code)
            }
        };
        shaders.push(shader);
        gpu.run(|commands| {
            it.bind(commands);
            // SAFETY: the shader outlives the commands.
            unsafe {
                objects.cmd_bind_shaders(commands, &[vk::ShaderStageFlags::COMPUTE], &[shader]);
                gpu.device.cmd_dispatch(commands, 1, 1, 1);
            }
        });
        assert_eq!(results.read::<f32>()[0], 2.0);
        // SAFETY: nothing uses the shaders any more.
        unsafe {
            binary = Some(objects.get_shader_binary_data(shader).expect("a binary"));
            for shader in shaders {
                objects.destroy_shader(shader, None);
            }
        }
    }
}
