//! Several samples a pixel in images with one (`VK_EXT_multisampled_render_to_single_sampled`).

use tuff_tests::*;

/// Four samples a pixel in an image with one: those that a draw leaves out keep the image's value
/// until the pass ends.
#[test]
fn images_with_one_sample_are_drawn_with_four() {
    let gpu = Gpu::new().drawing();
    let Some(gpu) = gpu.and_then(|gpu| {
        gpu.with("VK_EXT_multisampled_render_to_single_sampled", |gpu| {
            let features = &gpu.optional.single_sampled;
            features.multisampled_render_to_single_sampled != 0
                && gpu.limits.standard_sample_locations != 0
        })
    }) else {
        return;
    };
    let half = "
        layout(push_constant) uniform Push { vec4 pushed; float left; float right; };
        void main() {
            vec2 corner = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
            float x = corner.x == 0.0 ? left : right;
            gl_Position = vec4(x, corner.y * 2.0 - 1.0, 0.5, 1.0);
        }";
    let flags = vk::ImageCreateFlags::MULTISAMPLED_RENDER_TO_SINGLE_SAMPLED_EXT;
    let canvas = gpu.flagged_canvas(flags, RGBA, [16, 16], 1, 1);
    gpu.draw(
        &Pass {
            colors: &[canvas],
            clears: &[[0.0, 0.0, 1.0, 1.0]],
            ..Pass::default()
        },
        |_| (),
    );
    let mut painting = Painting::new(&gpu, half, PUSHED, RGBA);
    painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
    painting.samples = 4;
    let pipeline = gpu.painting(&painting);
    // To the middle of column 8 in red, then from there to that of column 12 in green.
    let [first, second] = [8.5, 12.5].map(|column: f32| column / 8.0 - 1.0);
    let pass = Pass {
        colors: &[canvas],
        samples: 4,
        ..Pass::default()
    };
    gpu.draw(&pass, |commands| {
        gpu.bind(commands, pipeline);
        let red = [1.0, 0.0, 0.0, 1.0, -1.0, first];
        let green = [0.0, 1.0, 0.0, 1.0, first, second];
        for push in [red, green] {
            gpu.push(commands, painting.layout, &push);
            gpu.draw_vertices(commands, 4);
        }
    });
    for (index, color) in gpu.colors(&canvas).into_iter().enumerate() {
        let wanted = match index % 16 {
            0..8 => [255, 0, 0, 255],
            8 => [128, 128, 0, 255],
            9..12 => [0, 255, 0, 255],
            12 => [0, 128, 128, 255],
            _ => [0, 0, 255, 255],
        };
        let is_near = |(a, b): (&u8, &u8)| a.abs_diff(*b) <= 1;
        let is_right = color.iter().zip(&wanted).all(is_near);
        assert!(is_right, "pixel {index}: {color:?}");
    }
}

/// A draw reads the samples that the one before it gave an image with one, before they are
/// resolved.
#[test]
fn shaders_read_the_samples_of_images_with_one() {
    // The layers want images with several samples where shaders read several, in such passes, too.
    let gpu = Gpu::without_validation().drawing();
    let Some(gpu) = gpu.and_then(|gpu| {
        gpu.with("VK_EXT_multisampled_render_to_single_sampled", |gpu| {
            let features = &gpu.optional.single_sampled;
            features.multisampled_render_to_single_sampled != 0
                && gpu.limits.standard_sample_locations != 0
                && gpu.features.sample_rate_shading != 0
        })
    }) else {
        return;
    };
    let flags = vk::ImageCreateFlags::MULTISAMPLED_RENDER_TO_SINGLE_SAMPLED_EXT;
    let [drawn, seen] = [(); 2].map(|()| gpu.flagged_canvas(flags, RGBA, [16, 16], 1, 1));
    let layout = vk::ImageLayout::GENERAL;
    let attachments = [vk::AttachmentDescription2::default()
        .format(RGBA)
        .samples(vk::SampleCountFlags::TYPE_1)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .store_op(vk::AttachmentStoreOp::STORE)
        .initial_layout(layout)
        .final_layout(layout); 2];
    let colors = [0, 1].map(|attachment| {
        vk::AttachmentReference2::default()
            .attachment(attachment)
            .layout(layout)
    });
    let inputs = [colors[0].aspect_mask(vk::ImageAspectFlags::COLOR)];
    let mut samples = vk::MultisampledRenderToSingleSampledInfoEXT::default()
        .multisampled_render_to_single_sampled_enable(true)
        .rasterization_samples(vk::SampleCountFlags::TYPE_4);
    let subpasses = [vk::SubpassDescription2::default()
        .color_attachments(&colors)
        .input_attachments(&inputs)
        .push_next(&mut samples)];
    let (written, read) = (
        vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT,
        vk::PipelineStageFlags::FRAGMENT_SHADER,
    );
    let (writes, reads) = (
        vk::AccessFlags::COLOR_ATTACHMENT_WRITE,
        vk::AccessFlags::INPUT_ATTACHMENT_READ,
    );
    let dependencies = [vk::SubpassDependency2::default()
        .src_stage_mask(written)
        .dst_stage_mask(read)
        .src_access_mask(writes)
        .dst_access_mask(reads)
        .dependency_flags(vk::DependencyFlags::BY_REGION)];
    let info = vk::RenderPassCreateInfo2::default()
        .attachments(&attachments)
        .subpasses(&subpasses)
        .dependencies(&dependencies);
    let pass = gpu.render_pass(&info);
    let framebuffer = gpu.framebuffer(pass, &[drawn, seen]);
    let set_layout = gpu.set_layout_of(
        &[(0, vk::DescriptorType::INPUT_ATTACHMENT, 1)],
        vk::DescriptorSetLayoutCreateFlags::empty(),
    );
    let set = gpu.input_set(set_layout, drawn.view);
    // To the middle of column 8: two of its four samples (spec, "Multisampling").
    let half = "
        void main() {
            vec2 corner = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
            gl_Position = vec4(corner * vec2(8.5 / 8, 2) - 1, 0.5, 1);
        }";
    let read_samples = "
        layout(input_attachment_index = 0, set = 0, binding = 0) uniform subpassInputMS drawn;
        layout(location = 1) out vec4 color;
        void main() { color = vec4(subpassLoad(drawn, gl_SampleID).x > 0.75 ? 1 : 0.5); }";
    let mut painting = Painting::new(&gpu, half, WHITE, RGBA);
    painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
    painting.samples = 4;
    painting.layout = gpu.layout(&[set_layout]);
    painting.render_pass = Some((pass, 0));
    let all = painting.blend[0];
    let none = all.color_write_mask(vk::ColorComponentFlags::empty());
    painting.blend = vec![all, none];
    let first = gpu.painting(&painting);
    painting.vertex = COVER;
    painting.topology = vk::PrimitiveTopology::TRIANGLE_LIST;
    painting.fragment = Some(read_samples);
    painting.blend = vec![none, all];
    let second = gpu.painting(&painting);
    gpu.run(|commands| {
        let clear = vk::ClearValue {
            color: vk::ClearColorValue { float32: BLACK },
        };
        let clears = [clear; 2];
        let begin = vk::RenderPassBeginInfo::default()
            .render_pass(pass)
            .framebuffer(framebuffer)
            .render_area(drawn.area())
            .clear_values(&clears);
        let barrier = [vk::MemoryBarrier::default()
            .src_access_mask(writes)
            .dst_access_mask(reads)];
        let device = &gpu.device;
        // SAFETY: the command buffer is being recorded.
        unsafe {
            device.cmd_begin_render_pass(commands, &begin, vk::SubpassContents::INLINE);
            gpu.look_at(commands, &drawn);
            gpu.bind(commands, first);
            gpu.draw_vertices(commands, 4);
            let by_region = vk::DependencyFlags::BY_REGION;
            device.cmd_pipeline_barrier(commands, written, read, by_region, &barrier, &[], &[]);
            gpu.bind(commands, second);
            gpu.bind_set(commands, painting.layout, set);
            gpu.draw_vertices(commands, 3);
            device.cmd_end_render_pass(commands);
        }
    });
    let why = "the image with one sample is read as it was before the pass";
    unless_known(&gpu, "llvmpipe", why, || {
        for (index, color) in gpu.colors(&seen).into_iter().enumerate() {
            let wanted: u8 = match (index % 16).cmp(&8) {
                std::cmp::Ordering::Less => 255,
                std::cmp::Ordering::Equal => 191,
                std::cmp::Ordering::Greater => 128,
            };
            let is_right = color.iter().all(|it| it.abs_diff(wanted) <= 1);
            assert!(is_right, "pixel {index}: {color:?}");
        }
    });
}
