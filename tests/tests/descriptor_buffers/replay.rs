//! Descriptors of objects that are made again are those that were captured.

use super::*;

#[test]
fn samplers_and_views_are_replayed() {
    let gpu = Gpu::new();
    let Some(it) = Buffers::replaying(&gpu) else {
        return;
    };
    let picture = gpu.picture(
        Shape::flat(vk::Format::R32_SFLOAT, 2, 1),
        vk::ImageUsageFlags::SAMPLED,
    );
    let mut bytes: Vec<Vec<u8>> = Vec::new();
    let mut captured: Option<[Vec<u8>; 2]> = None;
    for _ in 0..2 {
        // SAFETY: the objects are of this device, and gone before the next round.
        unsafe {
            let mut replay: [vk::OpaqueCaptureDescriptorDataCreateInfoEXT; 2] = Default::default();
            if let Some(captured) = &captured {
                for (replay, data) in replay.iter_mut().zip(captured) {
                    replay.opaque_capture_descriptor_data = data.as_ptr().cast();
                }
            }
            let [for_sampler, for_view] = &mut replay;
            let mut sampler = vk::SamplerCreateInfo::default()
                .flags(vk::SamplerCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT);
            let mut view = vk::ImageViewCreateInfo::default()
                .flags(vk::ImageViewCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT)
                .image(picture.handle)
                .view_type(picture.shape.kind)
                .format(picture.shape.format)
                .subresource_range(all_of(picture.shape));
            if captured.is_some() {
                sampler = sampler.push_next(for_sampler);
                view = view.push_next(for_view);
            }
            let sampler = gpu.device.create_sampler(&sampler, None).unwrap();
            let view = gpu.device.create_image_view(&view, None).unwrap();
            bytes.push(it.descriptor(&Source::Combined(image(view, sampler))));
            let mut data = [
                vec![0; it.properties.sampler_capture_replay_descriptor_data_size],
                vec![0; it.properties.image_view_capture_replay_descriptor_data_size],
            ];
            let info = vk::SamplerCaptureDescriptorDataInfoEXT::default().sampler(sampler);
            it.commands
                .get_sampler_opaque_capture_descriptor_data(&info, &mut data[0])
                .unwrap();
            let info = vk::ImageViewCaptureDescriptorDataInfoEXT::default().image_view(view);
            it.commands
                .get_image_view_opaque_capture_descriptor_data(&info, &mut data[1])
                .unwrap();
            captured = Some(data);
            gpu.device.destroy_sampler(sampler, None);
            gpu.device.destroy_image_view(view, None);
        }
    }
    assert_eq!(bytes[0], bytes[1]);
}

/// The descriptor of a replayed structure is that of the captured one, wherever the new one lies.
#[test]
fn structures_are_replayed() {
    let gpu = Gpu::new();
    let Some(it) = Buffers::replaying(&gpu) else {
        return;
    };
    let buffers = [gpu.buffer(4096), gpu.buffer(4096)];
    let mut captured: Option<(Vec<u8>, Vec<u8>)> = None;
    for buffer in &buffers {
        let mut replay = vk::OpaqueCaptureDescriptorDataCreateInfoEXT::default();
        let mut info = vk::AccelerationStructureCreateInfoKHR::default()
            .create_flags(
                vk::AccelerationStructureCreateFlagsKHR::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT,
            )
            .buffer(buffer.handle)
            .size(4096)
            .ty(vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL);
        if let Some((data, _)) = &captured {
            replay.opaque_capture_descriptor_data = data.as_ptr().cast();
            info = info.push_next(&mut replay);
        }
        // SAFETY: the buffer is large enough; the structure is gone before the next round.
        unsafe {
            let structure = gpu.acceleration.create_acceleration_structure(&info, None);
            let structure = structure.expect("vkCreateAccelerationStructureKHR");
            let address = vk::AccelerationStructureDeviceAddressInfoKHR::default()
                .acceleration_structure(structure);
            let address = gpu
                .acceleration
                .get_acceleration_structure_device_address(&address);
            let bytes = it.descriptor(&Source::Structure(address));
            let size = it
                .properties
                .acceleration_structure_capture_replay_descriptor_data_size;
            let mut data = vec![0; size];
            let info = vk::AccelerationStructureCaptureDescriptorDataInfoEXT::default()
                .acceleration_structure(structure);
            it.commands
                .get_acceleration_structure_opaque_capture_descriptor_data(&info, &mut data)
                .unwrap();
            gpu.acceleration
                .destroy_acceleration_structure(structure, None);
            if let Some((before, descriptor)) = &captured {
                assert_eq!((before, descriptor), (&data, &bytes));
            }
            captured = Some((data, bytes));
        }
    }
}
