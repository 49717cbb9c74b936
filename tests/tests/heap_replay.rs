//! `descriptorHeapCaptureReplay`: images and samplers of another device have the descriptors that
//! were captured.

use std::ffi::CStr;

use tuff_tests::heaps::Heaps;
use tuff_tests::newer as vk;
use tuff_tests::*;
use vk::DescriptorType as Ty;

/// `VK_IMAGE_CREATE_DESCRIPTOR_HEAP_CAPTURE_REPLAY_BIT_EXT`.
const CAPTURE_REPLAY: vk::ImageCreateFlags =
    vk::ImageCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT;

type CaptureImages = unsafe extern "system" fn(
    vk::Device,
    u32,
    *const vk::Image,
    *mut vk::HostAddressRangeEXT,
) -> vk::Result;

fn replaying() -> Option<Gpu> {
    Gpu::replaying()?.with("descriptorHeapCaptureReplay", |gpu| {
        gpu.optional.heaps.descriptor_heap_capture_replay != 0
    })
}

/// An image whose descriptors are captured, or had again, as its creation answers.
fn try_image(gpu: &Gpu, side: u32, captured: Option<&[u8]>) -> Result<vk::Image, vk::Result> {
    let range = captured.map(|data| vk::HostAddressRangeEXT {
        address: data.as_ptr().cast_mut().cast(),
        size: data.len(),
    });
    let data = vk::OpaqueCaptureDataCreateInfoEXT {
        p_data: range.as_ref().map_or(std::ptr::null(), std::ptr::from_ref),
        ..Default::default()
    };
    let mut info = flat_info(vk::Format::R32_SFLOAT, side, side)
        .flags(CAPTURE_REPLAY | vk::ImageCreateFlags::MUTABLE_FORMAT)
        .array_layers(2)
        .usage(
            vk::ImageUsageFlags::SAMPLED
                | vk::ImageUsageFlags::STORAGE
                | vk::ImageUsageFlags::TRANSFER_DST,
        );
    info.p_next = (&raw const data).cast();
    // SAFETY: the structures outlive the call.
    unsafe { gpu.device.create_image(&info, None) }
}

/// An image that is destroyed before the device is.
struct Replayed<'a> {
    gpu: &'a Gpu,
    picture: Picture,
    memory: vk::DeviceMemory,
}

impl Drop for Replayed<'_> {
    fn drop(&mut self) {
        // SAFETY: nothing uses the image any more.
        unsafe {
            self.gpu.device.destroy_image(self.picture.handle, None);
            self.gpu.device.free_memory(self.memory, None);
        }
    }
}

/// The same with memory of its own, in the general layout.
fn image<'a>(gpu: &'a Gpu, side: u32, captured: Option<&[u8]>) -> Replayed<'a> {
    let handle = try_image(gpu, side, captured).expect("vkCreateImage");
    let shape = Shape {
        kind: vk::ImageViewType::TYPE_2D_ARRAY,
        layers: 2,
        ..Shape::flat(vk::Format::R32_SFLOAT, side, side)
    };
    // SAFETY: the handles are of this device; the structures outlive the calls.
    let memory = unsafe {
        let needs = gpu.device.get_image_memory_requirements(handle);
        let mut flags = vk::MemoryAllocateFlagsInfo::default().flags(
            vk::MemoryAllocateFlags::DEVICE_ADDRESS
                | vk::MemoryAllocateFlags::DEVICE_ADDRESS_CAPTURE_REPLAY,
        );
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(needs.memory_type_bits.trailing_zeros())
            .push_next(&mut flags);
        let memory = gpu.device.allocate_memory(&info, None).expect("memory");
        gpu.device
            .bind_image_memory(handle, memory, 0)
            .expect("vkBindImageMemory");
        memory
    };
    gpu.to_general(handle, all_of(shape));
    let picture = Picture {
        handle,
        view: vk::ImageView::null(),
        shape,
    };
    Replayed {
        gpu,
        picture,
        memory,
    }
}

/// The opaque capture data of an image.
fn capture(image: &Replayed<'_>) -> Vec<u8> {
    let gpu = image.gpu;
    let mut p = vk::PhysicalDeviceDescriptorHeapPropertiesEXT::default();
    let mut all = vk::PhysicalDeviceProperties2 {
        p_next: (&raw mut p).cast(),
        ..Default::default()
    };
    let name: &CStr = c"vkGetImageOpaqueCaptureDataEXT";
    // SAFETY: the chain outlives the call; the command has this type, and the range is valid.
    unsafe {
        (gpu.instance).get_physical_device_properties2(gpu.physical, &mut all);
        // Through a pointer, because the driver wrote through one.
        let size = (&raw const p.image_capture_replay_opaque_data_size).read();
        let mut data = vec![0u8; size];
        let found = gpu
            .instance
            .get_device_proc_addr(gpu.device.handle(), name.as_ptr());
        let command = std::mem::transmute::<vk::PFN_vkVoidFunction, CaptureImages>(found);
        let mut range = vk::HostAddressRangeEXT {
            address: data.as_mut_ptr().cast(),
            size,
        };
        let done = command(gpu.device.handle(), 1, &image.picture.handle, &mut range);
        assert_eq!(done, vk::Result::SUCCESS);
        data
    }
}

/// The descriptor of a view of an image.
fn described(
    it: &Heaps<'_>,
    Replayed { picture, .. }: &Replayed<'_>,
    (ty, kind, format, layer): (Ty, vk::ImageViewType, vk::Format, u32),
) -> Vec<u8> {
    let range = vk::ImageSubresourceRange {
        base_array_layer: layer,
        layer_count: 1,
        ..all_of(picture.shape)
    };
    let view = vk::ImageViewCreateInfo::default()
        .image(picture.handle)
        .view_type(kind)
        .format(format)
        .subresource_range(range);
    let info = vk::ImageDescriptorInfoEXT {
        p_view: &view,
        layout: vk::ImageLayout::GENERAL,
        ..Default::default()
    };
    it.resource(ty, &info)
}

/// Views that differ in what they say of the image.
const VIEWS: [(Ty, vk::ImageViewType, vk::Format, u32); 4] = [
    (
        Ty::SAMPLED_IMAGE,
        vk::ImageViewType::TYPE_2D,
        vk::Format::R32_SFLOAT,
        1,
    ),
    (
        Ty::SAMPLED_IMAGE,
        vk::ImageViewType::TYPE_2D,
        vk::Format::R32_SFLOAT,
        0,
    ),
    (
        Ty::STORAGE_IMAGE,
        vk::ImageViewType::TYPE_2D,
        vk::Format::R32_UINT,
        1,
    ),
    (
        Ty::STORAGE_IMAGE,
        vk::ImageViewType::TYPE_2D_ARRAY,
        vk::Format::R32_UINT,
        0,
    ),
];

fn samplers() -> [vk::SamplerCreateInfo<'static>; 2] {
    let plain = vk::SamplerCreateInfo::default();
    [plain, plain.mag_filter(vk::Filter::LINEAR).max_lod(4.0)]
}

/// Other objects before them, and descriptors in another order, change no bits.
#[test]
fn images_and_samplers_are_replayed() {
    let Some(gpu) = replaying() else { return };
    let it = Heaps::new(&gpu, 16);
    let pictures = [8, 4].map(|side| image(&gpu, side, None));
    let captured = pictures.each_ref().map(capture);
    assert_ne!(captured[0], captured[1]);
    let before: Vec<Vec<u8>> = (pictures.iter())
        .flat_map(|picture| VIEWS.map(|view| described(&it, picture, view)))
        .chain(samplers().map(|sampler| it.sampler(&sampler)))
        .collect();
    let buffer = gpu.buffer(64);
    let range = tuff_tests::heaps::range_of(&buffer);
    let of_buffer = it.resource(Ty::STORAGE_BUFFER, &range);

    let Some(gpu) = replaying() else { return };
    let it = Heaps::new(&gpu, 16);
    let others = [
        vk::SamplerAddressMode::MIRRORED_REPEAT,
        vk::SamplerAddressMode::CLAMP_TO_EDGE,
    ];
    for mode in others {
        it.sampler(&vk::SamplerCreateInfo::default().address_mode_u(mode));
    }
    // The last first.
    let mut pictures = [1, 0].map(|index| image(&gpu, [8, 4][index], Some(&captured[index])));
    pictures.reverse();
    let others = [16, 8].map(|side| image(&gpu, side, None));
    for other in &others {
        assert!(!captured.contains(&capture(other)));
    }
    let mut after: Vec<Vec<u8>> = (samplers().iter().rev())
        .map(|sampler| it.sampler(sampler))
        .chain(pictures.iter().rev().flat_map(|picture| {
            let views = VIEWS.iter().rev();
            views.map(|&view| described(&it, picture, view))
        }))
        .collect();
    after.reverse();
    assert_eq!(before, after);
    assert_eq!(it.resource(Ty::STORAGE_BUFFER, &range), of_buffer);
    for (picture, data) in pictures.iter().zip(&captured) {
        assert_eq!(capture(picture), *data);
    }

    // The descriptors lead to the new images.
    gpu.upload(&pictures[0].picture, 0, &[[1.5f32; 64], [2.5; 64]].concat());
    let results = gpu.buffer(16);
    it.put_buffer(1, Ty::STORAGE_BUFFER, &results);
    it.resources.write(it.at(2) as usize, &before[0]);
    it.samplers.write(it.at(2) as usize, &before[8]);
    let source = "
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer R { float r[]; };
    layout(set = 0, binding = 1) uniform sampler2D image;
    void main() { r[0] = textureLod(image, vec2(0.3), 0.0).x; }";
    let kernel = it.kernel(source, &[it.constant(0, 1), it.constant(1, 2)]);
    gpu.run(|commands| {
        it.bind(commands);
        it.dispatch(commands, kernel);
    });
    assert_eq!(results.read::<f32>()[0], 2.5);
}

/// An image that is there has its identity alone; when it is gone, another may have it.
#[test]
fn an_identity_is_of_one_image_at_a_time() {
    let Some(gpu) = replaying() else { return };
    let it = Heaps::new(&gpu, 4);
    let first = image(&gpu, 4, None);
    let data = capture(&first);
    let bytes = described(&it, &first, VIEWS[0]);
    let taken = vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS;
    assert_eq!(try_image(&gpu, 4, Some(&data)), Err(taken));
    drop(first);
    let second = image(&gpu, 4, Some(&data));
    assert_eq!(described(&it, &second, VIEWS[0]), bytes);
    drop(second);
    if gpu.is_tuff() {
        // Data that no image ever had.
        for wrong in [0u64, u64::MAX, 1 << 32] {
            let made = try_image(&gpu, 4, Some(&wrong.to_ne_bytes()));
            assert_eq!(made, Err(taken), "{wrong:x}");
        }
        assert_eq!(try_image(&gpu, 4, Some(&[1; 3])), Err(taken));
    }
}
