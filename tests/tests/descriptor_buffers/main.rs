//! `VK_EXT_descriptor_buffer`: descriptors in memory of the application.

mod replay;
mod wild;

use ash::ext::descriptor_buffer;
use tuff_tests::*;

/// The extension's commands, and what the device says of it.
struct Buffers<'a> {
    gpu: &'a Gpu,
    commands: descriptor_buffer::Device,
    properties: vk::PhysicalDeviceDescriptorBufferPropertiesEXT<'static>,
}

/// The usage of descriptor buffers, besides the usual one.
const USES: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::RESOURCE_DESCRIPTOR_BUFFER_EXT.as_raw()
        | vk::BufferUsageFlags::SAMPLER_DESCRIPTOR_BUFFER_EXT.as_raw(),
);

/// The source of a descriptor.
enum Source {
    Sampler(vk::Sampler),
    Combined(vk::DescriptorImageInfo),
    Sampled(vk::DescriptorImageInfo),
    StorageImage(vk::DescriptorImageInfo),
    Uniform(u64, u64),
    Storage(u64, u64),
    UniformTexels(u64, u64, vk::Format),
    StorageTexels(u64, u64, vk::Format),
    Structure(u64),
    NullStorage,
}

const GENERAL: vk::ImageLayout = vk::ImageLayout::GENERAL;

fn image(view: vk::ImageView, sampler: vk::Sampler) -> vk::DescriptorImageInfo {
    vk::DescriptorImageInfo {
        sampler,
        image_view: view,
        image_layout: GENERAL,
    }
}

impl<'a> Buffers<'a> {
    /// None where the device lacks the extension.
    #[track_caller]
    fn new(gpu: &'a Gpu) -> Option<Self> {
        let there = gpu.optional.descriptor_buffer.descriptor_buffer;
        if !has("VK_EXT_descriptor_buffer", there == vk::TRUE) {
            return None;
        }
        let mut properties = vk::PhysicalDeviceDescriptorBufferPropertiesEXT::default();
        let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut properties);
        // SAFETY: the physical device is of the instance; the chain outlives the call.
        unsafe {
            gpu.instance
                .get_physical_device_properties2(gpu.physical, &mut all);
        }
        properties.p_next = std::ptr::null_mut();
        Some(Self {
            gpu,
            commands: descriptor_buffer::Device::new(&gpu.instance, &gpu.device),
            properties,
        })
    }

    /// The same for sets with inline uniform blocks.
    #[track_caller]
    fn with_blocks(gpu: &'a Gpu) -> Option<Self> {
        let there = gpu.features13.inline_uniform_block;
        Self::new(gpu).filter(|_| has("inline uniform blocks", there == vk::TRUE))
    }

    /// The same for descriptors that are captured and replayed.
    #[track_caller]
    fn replaying(gpu: &'a Gpu) -> Option<Self> {
        let features = gpu.optional.descriptor_buffer;
        let there = features.descriptor_buffer_capture_replay;
        Self::new(gpu).filter(|_| has("replayed descriptors", there == vk::TRUE))
    }

    fn layout(&self, bindings: &[(u32, vk::DescriptorType, u32)]) -> vk::DescriptorSetLayout {
        let flags = vk::DescriptorSetLayoutCreateFlags::DESCRIPTOR_BUFFER_EXT;
        self.gpu.set_layout_of(bindings, flags)
    }

    /// A buffer for a set's descriptors.
    fn buffer(&self, layout: vk::DescriptorSetLayout) -> Buffer {
        // SAFETY: the layout is for descriptor buffers.
        let size = unsafe { self.commands.get_descriptor_set_layout_size(layout) };
        self.gpu.buffer_for(size, USES)
    }

    fn offset(&self, layout: vk::DescriptorSetLayout, binding: u32) -> usize {
        // SAFETY: the layout is for descriptor buffers.
        unsafe {
            self.commands
                .get_descriptor_set_layout_binding_offset(layout, binding) as usize
        }
    }

    /// A descriptor's bytes.
    fn descriptor(&self, source: &Source) -> Vec<u8> {
        use vk::DescriptorType as Ty;
        let range = |address: u64, range: u64, format: vk::Format| {
            vk::DescriptorAddressInfoEXT::default()
                .address(address)
                .range(range)
                .format(format)
        };
        let p = &self.properties;
        let (address, sampler);
        let (ty, size, data) = match source {
            Source::Sampler(it) => {
                sampler = *it;
                let data = vk::DescriptorDataEXT {
                    p_sampler: &sampler,
                };
                (Ty::SAMPLER, p.sampler_descriptor_size, data)
            }
            Source::Combined(info) => {
                let data = vk::DescriptorDataEXT {
                    p_combined_image_sampler: info,
                };
                let size = p.combined_image_sampler_descriptor_size;
                (Ty::COMBINED_IMAGE_SAMPLER, size, data)
            }
            Source::Sampled(info) => {
                let data = vk::DescriptorDataEXT {
                    p_sampled_image: info,
                };
                (Ty::SAMPLED_IMAGE, p.sampled_image_descriptor_size, data)
            }
            Source::StorageImage(info) => {
                let data = vk::DescriptorDataEXT {
                    p_storage_image: info,
                };
                (Ty::STORAGE_IMAGE, p.storage_image_descriptor_size, data)
            }
            &Source::Uniform(at, size) => {
                address = range(at, size, vk::Format::UNDEFINED);
                let data = vk::DescriptorDataEXT {
                    p_uniform_buffer: &address,
                };
                let size = p.robust_uniform_buffer_descriptor_size;
                (Ty::UNIFORM_BUFFER, size, data)
            }
            &Source::Storage(at, size) => {
                address = range(at, size, vk::Format::UNDEFINED);
                let data = vk::DescriptorDataEXT {
                    p_storage_buffer: &address,
                };
                let size = p.robust_storage_buffer_descriptor_size;
                (Ty::STORAGE_BUFFER, size, data)
            }
            &Source::UniformTexels(at, size, format) => {
                address = range(at, size, format);
                let data = vk::DescriptorDataEXT {
                    p_uniform_texel_buffer: &address,
                };
                let size = p.robust_uniform_texel_buffer_descriptor_size;
                (Ty::UNIFORM_TEXEL_BUFFER, size, data)
            }
            &Source::StorageTexels(at, size, format) => {
                address = range(at, size, format);
                let data = vk::DescriptorDataEXT {
                    p_storage_texel_buffer: &address,
                };
                let size = p.robust_storage_texel_buffer_descriptor_size;
                (Ty::STORAGE_TEXEL_BUFFER, size, data)
            }
            &Source::Structure(at) => {
                let data = vk::DescriptorDataEXT {
                    acceleration_structure: at,
                };
                let size = p.acceleration_structure_descriptor_size;
                (Ty::ACCELERATION_STRUCTURE_KHR, size, data)
            }
            Source::NullStorage => {
                let data = vk::DescriptorDataEXT {
                    p_storage_buffer: std::ptr::null(),
                };
                let size = p.robust_storage_buffer_descriptor_size;
                (Ty::STORAGE_BUFFER, size, data)
            }
        };
        let mut info = vk::DescriptorGetInfoEXT::default().ty(ty);
        info.data = data;
        let mut bytes = vec![0; size];
        // SAFETY: what the union points to outlives the call.
        unsafe { self.commands.get_descriptor(&info, &mut bytes) };
        bytes
    }

    /// Puts a descriptor into a set's buffer.
    fn put(
        &self,
        buffer: &Buffer,
        layout: vk::DescriptorSetLayout,
        binding: u32,
        element: usize,
        source: &Source,
    ) {
        let bytes = self.descriptor(source);
        let at = self.offset(layout, binding) + element * bytes.len();
        buffer.write(at, &bytes);
    }

    fn kernel(&self, source: &str, sets: &[vk::DescriptorSetLayout]) -> Kernel {
        let flags = vk::PipelineCreateFlags::DESCRIPTOR_BUFFER_EXT;
        self.gpu.kernel_with(source, sets, flags)
    }

    /// Runs a kernel once with these buffers as its sets.
    fn dispatch(&self, kernel: Kernel, sets: &[Buffer], push: &[u32]) {
        self.gpu.run(|commands| {
            self.bind(commands, kernel, sets.len() as u32, sets);
            self.finish(commands, kernel, push);
        });
    }

    /// Binds buffers, and to each set of the kernel the buffer of its number.
    fn bind(&self, commands: vk::CommandBuffer, kernel: Kernel, sets: u32, buffers: &[Buffer]) {
        let usage = self.gpu.usual_uses() | USES;
        let bindings: Vec<_> = buffers
            .iter()
            .map(|buffer| {
                vk::DescriptorBufferBindingInfoEXT::default()
                    .address(buffer.address)
                    .usage(usage)
            })
            .collect();
        let indices: Vec<u32> = (0..sets).collect();
        let offsets = vec![0; sets as usize];
        // SAFETY: the buffers are of this device and live for long enough.
        unsafe {
            self.commands
                .cmd_bind_descriptor_buffers(commands, &bindings);
            self.commands.cmd_set_descriptor_buffer_offsets(
                commands,
                vk::PipelineBindPoint::COMPUTE,
                kernel.layout,
                0,
                &indices,
                &offsets,
            );
        }
    }

    fn finish(&self, commands: vk::CommandBuffer, kernel: Kernel, push: &[u32]) {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            let device = &self.gpu.device;
            let bytes: Vec<u8> = push.iter().flat_map(|word| word.to_ne_bytes()).collect();
            if !bytes.is_empty() {
                let all = vk::ShaderStageFlags::ALL;
                device.cmd_push_constants(commands, kernel.layout, all, 0, &bytes);
            }
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, kernel.pipeline);
            device.cmd_dispatch(commands, 1, 1, 1);
        }
    }
}

#[test]
fn buffers_of_every_kind() {
    use vk::DescriptorType as Ty;
    let gpu = Gpu::new();
    let Some(it) = Buffers::new(&gpu) else { return };
    let layout = it.layout(&[
        (0, Ty::STORAGE_BUFFER, 1),
        (2, Ty::UNIFORM_BUFFER, 1),
        (5, Ty::STORAGE_BUFFER, 3),
        (6, Ty::UNIFORM_TEXEL_BUFFER, 1),
        (7, Ty::STORAGE_TEXEL_BUFFER, 1),
    ]);
    let results = gpu.buffer(256);
    let uniform = gpu.buffer_with(&[3u32, 5, 7, 9]);
    let arrays = [0u32, 1, 2].map(|k| gpu.buffer_with(&[100 * k, 100 * k + 1]));
    let texels = gpu.buffer_with(&[0xff00_0080u32, 0x0102_0304]);
    let set = it.buffer(layout);
    it.put(&set, layout, 0, 0, &Source::Storage(results.address, 256));
    it.put(&set, layout, 2, 0, &Source::Uniform(uniform.address, 16));
    for (k, array) in arrays.iter().enumerate() {
        it.put(&set, layout, 5, k, &Source::Storage(array.address, 8));
    }
    let format = vk::Format::R8G8B8A8_UNORM;
    it.put(
        &set,
        layout,
        6,
        0,
        &Source::UniformTexels(texels.address, 8, format),
    );
    let format = vk::Format::R32_UINT;
    it.put(
        &set,
        layout,
        7,
        0,
        &Source::StorageTexels(texels.address + 4, 4, format),
    );
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { uint r[]; };
    layout(set = 0, binding = 2) uniform U { uvec4 u; };
    layout(set = 0, binding = 5) buffer A { uint a[]; } arrays[3];
    layout(set = 0, binding = 6) uniform samplerBuffer t;
    layout(set = 0, binding = 7, r32ui) uniform uimageBuffer s;
    layout(push_constant) uniform P { uint which; };
    void main() {
        r[0] = u.z;
        r[1] = arrays[which].a[1];
        r[2] = uint(arrays[0].a.length());
        r[3] = uint(round(texelFetch(t, 0).x * 255.0));
        r[4] = uint(textureSize(t));
        r[5] = imageLoad(s, 0).x;
        r[6] = uint(imageSize(s));
        imageStore(s, 0, uvec4(77));
    }";
    let kernel = it.kernel(source, &[layout]);
    it.dispatch(kernel, &[set], &[2]);
    let words: Vec<u32> = results.read();
    assert_eq!(words[..7], [7, 201, 2, 0x80, 2, 0x0102_0304, 1]);
    assert_eq!(texels.read::<u32>()[1], 77);
}

#[test]
fn two_sets_and_a_change_between_two_dispatches() {
    let gpu = Gpu::new();
    let Some(it) = Buffers::new(&gpu) else { return };
    let storage = vk::DescriptorType::STORAGE_BUFFER;
    let layout = it.layout(&[(0, storage, 1)]);
    let results = gpu.buffer(64);
    let numbers = [gpu.buffer_with(&[5u32]), gpu.buffer_with(&[6u32])];
    let sets = [results, numbers[0], numbers[1]].map(|buffer| {
        let set = it.buffer(layout);
        let source = Source::Storage(buffer.address, buffer.size_bytes);
        it.put(&set, layout, 0, 0, &source);
        set
    });
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { uint r[]; };
    layout(set = 1, binding = 0) buffer N { uint n[]; };
    layout(push_constant) uniform P { uint at; };
    void main() { r[at] = n[0]; }";
    let kernel = it.kernel(source, &[layout, layout]);
    gpu.run(|commands| {
        it.bind(commands, kernel, 2, &sets);
        it.finish(commands, kernel, &[0]);
        // Set 1 again, from another buffer.
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: the buffers are bound.
        unsafe {
            it.commands.cmd_set_descriptor_buffer_offsets(
                commands,
                point,
                kernel.layout,
                1,
                &[2],
                &[0],
            );
        }
        it.finish(commands, kernel, &[1]);
    });
    assert_eq!(results.read::<u32>()[..2], [5, 6]);
}

#[test]
fn images_and_samplers() {
    use vk::DescriptorType as Ty;
    let gpu = Gpu::new();
    let Some(it) = Buffers::new(&gpu) else { return };
    let shape = Shape::flat(vk::Format::R32_SFLOAT, 2, 1);
    let usage = vk::ImageUsageFlags::SAMPLED
        | vk::ImageUsageFlags::STORAGE
        | vk::ImageUsageFlags::TRANSFER_DST;
    let picture = gpu.picture(shape, usage);
    gpu.upload(&picture, 0, &[1.0f32, 3.0]);
    let nearest = gpu.sampler(&vk::SamplerCreateInfo::default());
    let linear = gpu.sampler(
        &vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::LINEAR)
            .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE),
    );
    let layout = it.layout(&[
        (0, Ty::STORAGE_BUFFER, 1),
        (1, Ty::SAMPLED_IMAGE, 1),
        (2, Ty::SAMPLER, 2),
        (3, Ty::STORAGE_IMAGE, 1),
        (4, Ty::COMBINED_IMAGE_SAMPLER, 1),
    ]);
    let results = gpu.buffer(64);
    let set = it.buffer(layout);
    let view = picture.view;
    let null = vk::Sampler::null();
    it.put(&set, layout, 0, 0, &Source::Storage(results.address, 64));
    it.put(&set, layout, 1, 0, &Source::Sampled(image(view, null)));
    it.put(&set, layout, 2, 0, &Source::Sampler(nearest));
    it.put(&set, layout, 2, 1, &Source::Sampler(linear));
    it.put(&set, layout, 3, 0, &Source::StorageImage(image(view, null)));
    it.put(&set, layout, 4, 0, &Source::Combined(image(view, linear)));
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { float r[]; };
    layout(set = 0, binding = 1) uniform texture2D image;
    layout(set = 0, binding = 2) uniform sampler samplers[2];
    layout(set = 0, binding = 3, r32f) uniform image2D stored;
    layout(set = 0, binding = 4) uniform sampler2D combined;
    void main() {
        r[0] = textureLod(sampler2D(image, samplers[0]), vec2(0.7, 0.5), 0.0).x;
        r[1] = textureLod(sampler2D(image, samplers[1]), vec2(0.5, 0.5), 0.0).x;
        r[2] = imageLoad(stored, ivec2(1, 0)).x;
        r[3] = textureLod(combined, vec2(0.5, 0.5), 0.0).x;
    }";
    let kernel = it.kernel(source, &[layout]);
    // If combined descriptors are two arrays, an array of one is one after the other all the same.
    it.dispatch(kernel, &[set], &[]);
    assert_eq!(results.read::<f32>()[..4], [3.0, 2.0, 3.0, 2.0]);
}

#[test]
fn samplers_embedded_in_a_layout() {
    use vk::DescriptorType as Ty;
    let gpu = Gpu::new();
    if gpu.name().contains("llvmpipe") {
        // A fault takes the other tests along: this is the one check that is left out instead of
        // known to fail.
        println!("known to fault on llvmpipe");
        return;
    }
    let Some(it) = Buffers::new(&gpu) else { return };
    let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST;
    let picture = gpu.picture(Shape::flat(vk::Format::R32_SFLOAT, 2, 1), usage);
    gpu.upload(&picture, 0, &[1.0f32, 3.0]);
    let edge = vk::SamplerAddressMode::CLAMP_TO_EDGE;
    let sampler = gpu.sampler(
        &vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::LINEAR)
            .address_mode_u(edge)
            .address_mode_v(edge),
    );
    let samplers = [sampler];
    let bindings = [vk::DescriptorSetLayoutBinding::default()
        .binding(0)
        .descriptor_type(Ty::SAMPLER)
        .descriptor_count(1)
        .immutable_samplers(&samplers)
        .stage_flags(vk::ShaderStageFlags::ALL)];
    let embedded = gpu.set_layout_from(
        &vk::DescriptorSetLayoutCreateInfo::default()
            .flags(
                vk::DescriptorSetLayoutCreateFlags::DESCRIPTOR_BUFFER_EXT
                    | vk::DescriptorSetLayoutCreateFlags::EMBEDDED_IMMUTABLE_SAMPLERS_EXT,
            )
            .bindings(&bindings),
    );
    let layout = it.layout(&[(0, Ty::STORAGE_BUFFER, 1), (1, Ty::SAMPLED_IMAGE, 1)]);
    let results = gpu.buffer(64);
    let set = it.buffer(layout);
    let null = vk::Sampler::null();
    it.put(&set, layout, 0, 0, &Source::Storage(results.address, 64));
    it.put(
        &set,
        layout,
        1,
        0,
        &Source::Sampled(image(picture.view, null)),
    );
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { float r[]; };
    layout(set = 0, binding = 1) uniform texture2D image;
    layout(set = 1, binding = 0) uniform sampler s;
    void main() { r[0] = textureLod(sampler2D(image, s), vec2(0.5, 0.5), 0.0).x; }";
    let kernel = it.kernel(source, &[layout, embedded]);
    gpu.run(|commands| {
        it.bind(commands, kernel, 1, &[set]);
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: set 1 of the layout has embedded samplers.
        unsafe {
            it.commands.cmd_bind_descriptor_buffer_embedded_samplers(
                commands,
                point,
                kernel.layout,
                1,
            );
        }
        it.finish(commands, kernel, &[]);
    });
    assert_eq!(results.read::<f32>()[0], 2.0);
}

#[test]
fn inline_uniform_blocks_lie_in_the_buffer_itself() {
    use vk::DescriptorType as Ty;
    let gpu = Gpu::new();
    let Some(it) = Buffers::with_blocks(&gpu) else {
        return;
    };
    let layout = it.layout(&[
        (0, Ty::INLINE_UNIFORM_BLOCK, 16),
        (1, Ty::STORAGE_BUFFER, 1),
        (2, Ty::INLINE_UNIFORM_BLOCK, 32),
    ]);
    let results = gpu.buffer(64);
    let set = it.buffer(layout);
    set.write(it.offset(layout, 0), &[1u32, 2, 3, 4]);
    it.put(&set, layout, 1, 0, &Source::Storage(results.address, 64));
    set.write(it.offset(layout, 2), &[5u32, 6, 7, 8, 9, 10, 11, 12]);
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) uniform A { uvec4 a; };
    layout(set = 0, binding = 1) buffer R { uint r[]; };
    layout(set = 0, binding = 2) uniform B { uvec4 b[2]; };
    void main() { r[0] = a.y; r[1] = b[1].w; r[2] = b[0].x; }";
    let kernel = it.kernel(source, &[layout]);
    it.dispatch(kernel, &[set], &[]);
    assert_eq!(results.read::<u32>()[..3], [2, 12, 5]);
}

#[test]
fn structures_and_null_descriptors() {
    use vk::DescriptorType as Ty;
    let gpu = Gpu::new();
    let Some(it) = Buffers::new(&gpu) else { return };
    if !has("ray queries", gpu.optional.ray_query.ray_query == vk::TRUE) {
        return;
    }
    let has_null = gpu.optional.robustness2.null_descriptor != vk::FALSE;
    let triangle = [[-1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [-1.0, 3.0, 0.0]];
    let world = gpu.scene(&[Geometry::opaque(&triangle)]);
    let layout = it.layout(&[
        (0, Ty::STORAGE_BUFFER, 1),
        (1, Ty::ACCELERATION_STRUCTURE_KHR, 1),
        (2, Ty::STORAGE_BUFFER, 1),
    ]);
    let results = gpu.buffer_with(&[9.0f32; 4]);
    let set = it.buffer(layout);
    it.put(&set, layout, 0, 0, &Source::Storage(results.address, 16));
    it.put(&set, layout, 1, 0, &Source::Structure(world.address));
    let second = if has_null {
        Source::NullStorage
    } else {
        Source::Storage(results.address, 16)
    };
    it.put(&set, layout, 2, 0, &second);
    let source = r"
    #extension GL_EXT_ray_query : require
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { float r[]; };
    layout(set = 0, binding = 1) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 2) buffer N { float n[]; };
    void main() {
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0, 0xff, vec3(0.0, 0.0, 2.0), 0.0, vec3(0.0, 0.0, -1.0), 10.0);
        while (rayQueryProceedEXT(q)) {}
        r[0] = rayQueryGetIntersectionTEXT(q, true);
        r[1] = n[2];
    }";
    let kernel = it.kernel(source, &[layout]);
    it.dispatch(kernel, &[set], &[]);
    let found: Vec<f32> = results.read();
    assert_eq!(found[0], 2.0);
    assert_eq!(found[1], if has_null { 0.0 } else { 9.0 });
}
