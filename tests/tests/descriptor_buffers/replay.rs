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

/// A view's descriptor can be had again as soon as the view is destroyed, though a framebuffer was
/// made of it and a command buffer that draws into the framebuffer is still there.
#[test]
fn views_that_framebuffers_were_made_of_are_replayed() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let Some(it) = Buffers::replaying(&gpu) else {
        return;
    };
    let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::INPUT_ATTACHMENT;
    let picture = gpu.picture(
        Shape::flat(RGBA, 4, 4),
        usage | vk::ImageUsageFlags::SAMPLED,
    );
    let attachments = [vk::AttachmentDescription2::default()
        .format(RGBA)
        .samples(vk::SampleCountFlags::TYPE_1)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .store_op(vk::AttachmentStoreOp::STORE)
        .initial_layout(GENERAL)
        .final_layout(GENERAL)];
    let color = [vk::AttachmentReference2::default().layout(GENERAL)];
    let subpasses = [vk::SubpassDescription2::default().color_attachments(&color)];
    let info = vk::RenderPassCreateInfo2::default()
        .attachments(&attachments)
        .subpasses(&subpasses);
    let pass = gpu.render_pass(&info);
    let info = vk::ImageViewCreateInfo::default()
        .flags(vk::ImageViewCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT)
        .image(picture.handle)
        .view_type(picture.shape.kind)
        .format(picture.shape.format)
        .subresource_range(all_of(picture.shape));
    // SAFETY: the objects are of this device; the framebuffer and the commands are not used after
    // the view's end.
    unsafe {
        let view = gpu.device.create_image_view(&info, None).unwrap();
        let canvas = Canvas {
            view,
            ..gpu.canvas(RGBA, 4, 4)
        };
        let framebuffer = gpu.framebuffer(pass, &[canvas]);
        let commands = gpu.record(|commands| {
            let clears = [vk::ClearValue::default()];
            let begin = vk::RenderPassBeginInfo::default()
                .render_pass(pass)
                .framebuffer(framebuffer)
                .render_area(canvas.area())
                .clear_values(&clears);
            (gpu.device).cmd_begin_render_pass(commands, &begin, vk::SubpassContents::INLINE);
            gpu.device.cmd_end_render_pass(commands);
        });
        gpu.submit(commands).unwrap();
        let size = it.properties.image_view_capture_replay_descriptor_data_size;
        let mut data = vec![0; size];
        let captured = vk::ImageViewCaptureDescriptorDataInfoEXT::default().image_view(view);
        it.commands
            .get_image_view_opaque_capture_descriptor_data(&captured, &mut data)
            .unwrap();
        let sampled = |view| it.descriptor(&Source::Sampled(image(view, vk::Sampler::null())));
        let before = sampled(view);
        gpu.device.destroy_image_view(view, None);
        let mut replay = vk::OpaqueCaptureDescriptorDataCreateInfoEXT::default();
        replay.opaque_capture_descriptor_data = data.as_ptr().cast();
        let info = info.push_next(&mut replay);
        let again = gpu.device.create_image_view(&info, None);
        let again = again.expect("the view's data is free again");
        assert_eq!(sampled(again), before);
        // The remains of the first view take nothing from the second.
        gpu.device.free_command_buffers(gpu.pool, &[commands]);
        assert_eq!(sampled(again), before);
        gpu.device.destroy_image_view(again, None);
    }
}

/// A sparse buffer has its address from its creation: its data asks for it again, whatever was
/// allocated in between.
#[test]
fn sparse_buffers_are_replayed() {
    let gpu = Gpu::new();
    let Some(it) = Buffers::replaying(&gpu) else {
        return;
    };
    if !has(
        "sparse buffers",
        gpu.features.sparse_residency_buffer == vk::TRUE,
    ) {
        return;
    }
    let info = vk::BufferCreateInfo::default()
        .flags(
            vk::BufferCreateFlags::SPARSE_BINDING
                | vk::BufferCreateFlags::SPARSE_RESIDENCY
                | vk::BufferCreateFlags::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT,
        )
        .size(2048)
        .usage(vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS);
    let storage = |buffer| {
        let address = vk::BufferDeviceAddressInfo::default().buffer(buffer);
        // SAFETY: the buffer is of this device, and alive.
        let address = unsafe { gpu.device.get_buffer_device_address(&address) };
        it.descriptor(&Source::Storage(address, 2048))
    };
    // SAFETY: the objects are of this device, and none is used after its end.
    unsafe {
        let create = |info| gpu.device.create_buffer(info, None);
        let (extra, buffer) = (create(&info).unwrap(), create(&info).unwrap());
        let mut data = vec![0; it.properties.buffer_capture_replay_descriptor_data_size];
        let captured = vk::BufferCaptureDescriptorDataInfoEXT::default().buffer(buffer);
        it.commands
            .get_buffer_opaque_capture_descriptor_data(&captured, &mut data)
            .unwrap();
        let before = storage(buffer);
        gpu.device.destroy_buffer(buffer, None);
        gpu.device.destroy_buffer(extra, None);
        let mut replay = vk::OpaqueCaptureDescriptorDataCreateInfoEXT::default();
        replay.opaque_capture_descriptor_data = data.as_ptr().cast();
        let again = create(&info.push_next(&mut replay));
        let again = again.expect("the buffer's data is free again");
        assert_eq!(storage(again), before);
        gpu.device.destroy_buffer(again, None);
    }
}
