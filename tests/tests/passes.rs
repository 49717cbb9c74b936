//! Passes: load operations, several samples, subpasses with input attachments, views, layers,
//! secondary command buffers, suspension, clears inside, pipelines in parts, dynamic state.

use tuff_tests::*;

#[test]
fn attachments_are_cleared_and_loaded() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let canvas = gpu.canvas(RGBA, 130, 3);
    let first = Pass {
        colors: &[canvas],
        clears: &[[0.2, 0.4, 0.6, 0.8]],
        ..Pass::default()
    };
    gpu.draw(&first, |_| ());
    assert_eq!(gpu.colors(&canvas), [[51, 102, 153, 204]; 390]);
    let painting = Painting::new(&gpu, COVER, PUSHED, RGBA);
    let pipeline = gpu.painting(&painting);
    let again = Pass {
        colors: &[canvas],
        ..Pass::default()
    };
    gpu.draw(&again, |commands| {
        gpu.bind(commands, pipeline);
        gpu.push(commands, painting.layout, &[1.0f32; 4]);
        let part = vk::Rect2D {
            offset: vk::Offset2D { x: 60, y: 1 },
            extent: vk::Extent2D {
                width: 10,
                height: 1,
            },
        };
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_set_scissor(commands, 0, &[part]) };
        gpu.draw_vertices(commands, 3);
    });
    for (index, color) in gpu.colors(&canvas).into_iter().enumerate() {
        let drawn = index / 130 == 1 && (60..70).contains(&(index % 130));
        assert_eq!(
            color,
            if drawn { [255; 4] } else { [51, 102, 153, 204] },
            "pixel {index}"
        );
    }
}

/// `VK_EXT_dynamic_rendering_unused_attachments`: what a pipeline has no format for stays as it is,
/// and tests nothing.
#[test]
fn attachments_without_a_format_are_left() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 252));
    let Some(gpu) = gpu.drawing() else { return };
    let features = gpu.optional.unused_attachments;
    if !has(
        "pipelines without formats for all attachments",
        features.dynamic_rendering_unused_attachments == vk::TRUE,
    ) {
        return;
    }
    let canvases = [gpu.canvas(RGBA, 8, 8), gpu.canvas(RGBA, 8, 8)];
    let depth = gpu.canvas(vk::Format::D32_SFLOAT, 8, 8);
    let fragment = "
        layout(location = 0) out vec4 first;
        layout(location = 1) out vec4 second;
        void main() { first = second = vec4(1.0); }";
    let mut painting = Painting::new(&gpu, COVER, fragment, RGBA);
    painting.colors.insert(0, vk::Format::UNDEFINED);
    painting.blend.push(painting.blend[0]);
    painting.depth_stencil = painting
        .depth_stencil
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::NEVER);
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        colors: &canvases,
        clears: &[BLACK; 2],
        depth: Some(depth),
        clear_depth: Some((0.75, 0)),
        ..Pass::default()
    };
    gpu.draw(&pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.draw_vertices(commands, 3);
    });
    assert_eq!(gpu.colors(&canvases[0]), [[0; 4]; 64]);
    assert_eq!(gpu.colors(&canvases[1]), [[255; 4]; 64]);
    let depths: Vec<f32> = gpu.texels(&depth, vk::ImageAspectFlags::DEPTH);
    assert_eq!(depths, [0.75; 64]);
}

#[test]
fn parts_are_cleared_inside_a_pass() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let (canvas, depth) = (
        gpu.canvas(RGBA, 8, 8),
        gpu.canvas(vk::Format::D32_SFLOAT, 8, 8),
    );
    let pass = Pass {
        depth: Some(depth),
        clear_depth: Some((1.0, 0)),
        ..Pass::black(&canvas)
    };
    gpu.draw(&pass, |commands| {
        let color = vk::ClearColorValue {
            float32: [1.0, 0.0, 0.0, 1.0],
        };
        let depth_stencil = vk::ClearDepthStencilValue {
            depth: 0.25,
            stencil: 0,
        };
        let clears = [
            vk::ClearAttachment {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                color_attachment: 0,
                clear_value: vk::ClearValue { color },
            },
            vk::ClearAttachment {
                aspect_mask: vk::ImageAspectFlags::DEPTH,
                color_attachment: 0,
                clear_value: vk::ClearValue { depth_stencil },
            },
        ];
        let rect = vk::ClearRect {
            rect: vk::Rect2D {
                offset: vk::Offset2D { x: 2, y: 3 },
                extent: vk::Extent2D {
                    width: 4,
                    height: 2,
                },
            },
            base_array_layer: 0,
            layer_count: 1,
        };
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_clear_attachments(commands, &clears, &[rect]) };
    });
    let depths: Vec<f32> = gpu.texels(&depth, vk::ImageAspectFlags::DEPTH);
    for (index, (color, depth)) in gpu.colors(&canvas).into_iter().zip(depths).enumerate() {
        let inside = (2..6).contains(&(index % 8)) && (3..5).contains(&(index / 8));
        let expected = if inside {
            ([255, 0, 0, 255], 0.25)
        } else {
            ([0; 4], 1.0)
        };
        assert_eq!((color, depth), expected, "pixel {index}");
    }
}

/// An edge through the middle of pixels: half of the standard sample locations lie on either side.
#[test]
fn samples_are_resolved() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    if !has(
        "standardSampleLocations",
        gpu.limits.standard_sample_locations == vk::TRUE,
    ) {
        return;
    }
    let vertex = "
        void main() {
            float right = (8.5 / 16.0) * 2.0 - 1.0;
            vec2 corner = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
            gl_Position = vec4(corner.x == 0.0 ? -1.0 : right, corner.y * 2.0 - 1.0, 0.5, 1.0);
        }";
    for samples in [2, 4, 8] {
        let counts = gpu.limits.framebuffer_color_sample_counts;
        if !counts.contains(vk::SampleCountFlags::from_raw(samples)) {
            continue;
        }
        let many = gpu.canvas_of(RGBA, 16, 16, 1, samples);
        let resolved = gpu.canvas(RGBA, 16, 16);
        let mut painting = Painting::new(&gpu, vertex, WHITE, RGBA);
        painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
        painting.samples = samples;
        let pipeline = gpu.painting(&painting);
        let pass = Pass {
            colors: &[many],
            clears: &[BLACK],
            resolves: &[resolved],
            ..Pass::default()
        };
        gpu.draw(&pass, |commands| {
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, 4);
        });
        // Chapter Rasterization, "Multisampling": x of the standard locations, below 0.5.
        let left = match samples {
            2 => 1.0 / 2.0,
            4 => 2.0 / 4.0,
            _ => 4.0 / 8.0,
        };
        for (index, color) in gpu.colors(&resolved).into_iter().enumerate() {
            let expected = match (index % 16).cmp(&8) {
                std::cmp::Ordering::Less => 255,
                std::cmp::Ordering::Equal => (left * 255.0f32).round() as u8,
                std::cmp::Ordering::Greater => 0,
            };
            assert!(
                color[0].abs_diff(expected) <= 1,
                "{samples} samples, pixel {index}: {color:?}"
            );
        }
    }
}

/// Samples lie where a pipeline says: in coverage, in shaders, and where varyings are evaluated.
#[test]
fn samples_lie_where_a_pipeline_says() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let mut properties = vk::PhysicalDeviceSampleLocationsPropertiesEXT::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut properties);
    // SAFETY: the physical device is of this instance; the chain is one structure.
    unsafe { (gpu.instance).get_physical_device_properties2(gpu.physical, &mut all) };
    let has_four = properties
        .sample_location_sample_counts
        .contains(vk::SampleCountFlags::TYPE_4)
        && properties.sample_location_sub_pixel_bits >= 4
        && properties.sample_location_coordinate_range[1] >= 15.0 / 16.0;
    let has_sample_shading = gpu.features.sample_rate_shading == vk::TRUE;
    if !has("locations of four samples", has_four && has_sample_shading) {
        return;
    }
    let vertex = "
        layout(location = 0) out vec2 pixel;
        void main() {
            float right = (8 + 4.5 / 16.0) / 8 - 1.0;
            vec2 corner = vec2(gl_VertexIndex & 1, gl_VertexIndex >> 1);
            gl_Position = vec4(corner.x == 0.0 ? -1.0 : right, corner.y * 2.0 - 1.0, 0.5, 1.0);
            pixel = (gl_Position.xy + 1.0) * 8;
        }";
    let fragment = "
        layout(location = 0) in vec2 pixel;
        layout(location = 0) out vec4 color;
        void main() {
            float last = fract(interpolateAtSample(pixel, 3).x);
            color = vec4(gl_SamplePosition, last, 1);
        }";
    let locations = [[1, 0], [2, 3], [3, 7], [13, 15]].map(|place| {
        let [x, y] = place.map(|sixteenths: u8| f32::from(sixteenths) / 16.0);
        vk::SampleLocationEXT { x, y }
    });
    let many = gpu.canvas_of(RGBA, 16, 16, 1, 4);
    let resolved = gpu.canvas(RGBA, 16, 16);
    let mut painting = Painting::new(&gpu, vertex, fragment, RGBA);
    painting.topology = vk::PrimitiveTopology::TRIANGLE_STRIP;
    painting.samples = 4;
    painting.locations = &locations;
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        colors: &[many],
        clears: &[BLACK],
        resolves: &[resolved],
        ..Pass::default()
    };
    gpu.draw(&pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.draw_vertices(commands, 4);
    });
    // Means over the samples; three of the four are left of the edge, which goes through column 8.
    let inside = [19.0, 25.0, 4.0 * 13.0, 64.0f32];
    let edge = [6.0, 10.0, 3.0 * 13.0, 48.0];
    for (index, color) in gpu.colors(&resolved).into_iter().enumerate() {
        let wanted = match (index % 16).cmp(&8) {
            std::cmp::Ordering::Less => inside,
            std::cmp::Ordering::Equal => edge,
            std::cmp::Ordering::Greater => [0.0; 4],
        };
        for (component, sum) in wanted.into_iter().enumerate() {
            let wanted = (sum / 64.0 * 255.0).round() as u8;
            let is_near = color[component].abs_diff(wanted) <= 1;
            // The cleared samples are opaque black.
            assert!(is_near || component == 3, "pixel {index}: {color:?}");
        }
    }
}

/// The first subpass draws what the second one reads as an input attachment, and inverts.
#[test]
fn subpasses_read_what_was_drawn_before() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let (source, result) = (gpu.canvas(RGBA, 66, 5), gpu.canvas(RGBA, 66, 5));
    let layout = vk::ImageLayout::GENERAL;
    let attachment = vk::AttachmentDescription2::default()
        .format(RGBA)
        .samples(vk::SampleCountFlags::TYPE_1)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .store_op(vk::AttachmentStoreOp::STORE)
        .initial_layout(layout)
        .final_layout(layout);
    let reference = |attachment| {
        [vk::AttachmentReference2::default()
            .attachment(attachment)
            .layout(layout)
            .aspect_mask(vk::ImageAspectFlags::COLOR)]
    };
    let (first, second) = (reference(0), reference(1));
    let subpasses = [
        vk::SubpassDescription2::default().color_attachments(&first),
        vk::SubpassDescription2::default()
            .input_attachments(&first)
            .color_attachments(&second),
    ];
    let dependency = [vk::SubpassDependency2::default()
        .src_subpass(0)
        .dst_subpass(1)
        .src_stage_mask(vk::PipelineStageFlags::COLOR_ATTACHMENT_OUTPUT)
        .dst_stage_mask(vk::PipelineStageFlags::FRAGMENT_SHADER)
        .src_access_mask(vk::AccessFlags::COLOR_ATTACHMENT_WRITE)
        .dst_access_mask(vk::AccessFlags::INPUT_ATTACHMENT_READ)
        .dependency_flags(vk::DependencyFlags::BY_REGION)];
    let attachments = [attachment; 2];
    let info = vk::RenderPassCreateInfo2::default()
        .attachments(&attachments)
        .subpasses(&subpasses)
        .dependencies(&dependency);
    let pass = gpu.render_pass(&info);
    let framebuffer = gpu.framebuffer(pass, &[source, result]);
    let set_layout = gpu.set_layout_of(
        &[(0, vk::DescriptorType::INPUT_ATTACHMENT, 1)],
        vk::DescriptorSetLayoutCreateFlags::empty(),
    );
    let place = "
        layout(location = 0) out vec4 color;
        void main() { color = vec4(floor(gl_FragCoord.xy) / 255.0, 0.0, 1.0); }";
    let invert = "
        layout(input_attachment_index = 0, set = 0, binding = 0) uniform subpassInput source;
        layout(location = 0) out vec4 color;
        void main() { color = vec4(1.0) - subpassLoad(source); }";
    let mut painting = Painting::new(&gpu, COVER, place, RGBA);
    painting.layout = gpu.layout(&[set_layout]);
    painting.render_pass = Some((pass, 0));
    let write = gpu.painting(&painting);
    painting.fragment = Some(invert);
    painting.render_pass = Some((pass, 1));
    let read = gpu.painting(&painting);
    let set = gpu.input_set(set_layout, source.view);
    gpu.run(|commands| {
        let clear = vk::ClearValue {
            color: vk::ClearColorValue { float32: BLACK },
        };
        let clears = [clear; 2];
        let begin = vk::RenderPassBeginInfo::default()
            .render_pass(pass)
            .framebuffer(framebuffer)
            .render_area(source.area())
            .clear_values(&clears);
        // SAFETY: the command buffer is being recorded.
        unsafe {
            let device = &gpu.device;
            device.cmd_begin_render_pass(commands, &begin, vk::SubpassContents::INLINE);
            gpu.look_at(commands, &source);
            gpu.bind(commands, write);
            gpu.draw_vertices(commands, 3);
            device.cmd_next_subpass(commands, vk::SubpassContents::INLINE);
            gpu.bind(commands, read);
            gpu.bind_set(commands, painting.layout, set);
            gpu.draw_vertices(commands, 3);
            device.cmd_end_render_pass(commands);
        }
    });
    for (index, color) in gpu.colors(&result).into_iter().enumerate() {
        let expected = [255 - (index % 66) as u8, 255 - (index / 66) as u8, 255, 0];
        assert_eq!(color, expected, "pixel {index}");
    }
}

/// A draw reads a uniform block, another one stores there, and the first reads again: one pixel,
/// with a barrier between fragments each time, and the same bindings for all.
#[test]
fn fragments_read_uniform_blocks_anew_behind_barriers() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    if !has(
        "fragmentStoresAndAtomics",
        gpu.features.fragment_stores_and_atomics == vk::TRUE,
    ) {
        return;
    }
    let canvas = gpu.canvas(RGBA, 1, 1);
    let layout = vk::ImageLayout::GENERAL;
    let attachments = [vk::AttachmentDescription2::default()
        .format(RGBA)
        .samples(vk::SampleCountFlags::TYPE_1)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .store_op(vk::AttachmentStoreOp::STORE)
        .initial_layout(layout)
        .final_layout(layout)];
    let color = [vk::AttachmentReference2::default()
        .attachment(0)
        .layout(layout)];
    let subpasses = [vk::SubpassDescription2::default().color_attachments(&color)];
    let fragments = vk::PipelineStageFlags::FRAGMENT_SHADER;
    let stored = vk::AccessFlags::SHADER_WRITE;
    let read = vk::AccessFlags::UNIFORM_READ;
    let dependencies = [vk::SubpassDependency2::default()
        .src_subpass(0)
        .dst_subpass(0)
        .src_stage_mask(fragments)
        .dst_stage_mask(fragments)
        .src_access_mask(stored)
        .dst_access_mask(read | stored)
        .dependency_flags(vk::DependencyFlags::BY_REGION)];
    let info = vk::RenderPassCreateInfo2::default()
        .attachments(&attachments)
        .subpasses(&subpasses)
        .dependencies(&dependencies);
    let pass = gpu.render_pass(&info);
    let framebuffer = gpu.framebuffer(pass, &[canvas]);
    let buffer = gpu.buffer_with(&[[0.2f32, 0.4, 0.6, 0.8]]);
    let set = gpu.set_of(&[Bound::Storage(buffer), Bound::Uniform(buffer)]);
    let show = "
        layout(set = 0, binding = 1) uniform Block { vec4 kept; };
        layout(location = 0) out vec4 color;
        void main() { color = kept; }";
    let store = "
        layout(set = 0, binding = 0) buffer Stored { vec4 stored; };
        layout(location = 0) out vec4 color;
        void main() { stored += vec4(0.2, 0.0, -0.2, 0.0); color = vec4(0.0); }";
    let mut painting = Painting::new(&gpu, COVER, show, RGBA);
    painting.layout = gpu.layout(&[set.layout]);
    painting.render_pass = Some((pass, 0));
    let shows = gpu.painting(&painting);
    painting.fragment = Some(store);
    let stores = gpu.painting(&painting);
    gpu.run(|commands| {
        let clears = [vk::ClearValue {
            color: vk::ClearColorValue { float32: BLACK },
        }];
        let begin = vk::RenderPassBeginInfo::default()
            .render_pass(pass)
            .framebuffer(framebuffer)
            .render_area(canvas.area())
            .clear_values(&clears);
        let barrier = [vk::MemoryBarrier::default()
            .src_access_mask(stored)
            .dst_access_mask(read | stored)];
        let device = &gpu.device;
        // SAFETY: the command buffer is being recorded.
        unsafe {
            device.cmd_begin_render_pass(commands, &begin, vk::SubpassContents::INLINE);
            gpu.look_at(commands, &canvas);
            gpu.bind_set(commands, painting.layout, set.handle);
            for pipeline in [shows, stores, shows, stores, shows] {
                gpu.bind(commands, pipeline);
                gpu.draw_vertices(commands, 3);
                let by_region = vk::DependencyFlags::BY_REGION;
                device.cmd_pipeline_barrier(
                    commands,
                    fragments,
                    fragments,
                    by_region,
                    &barrier,
                    &[],
                    &[],
                );
            }
            device.cmd_end_render_pass(commands);
        }
    });
    assert_eq!(gpu.colors(&canvas), [[153, 102, 51, 204]]);
}

#[test]
fn views_are_layers_that_know_their_number() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    if !has("multiview", gpu.features11.multiview == vk::TRUE) {
        return;
    }
    let canvas = gpu.canvas_of(RGBA, 5, 5, 3, 1);
    let fragment = "
        layout(location = 0) out vec4 color;
        void main() { color = vec4(gl_ViewIndex + 1) / 255.0; }";
    let mut painting = Painting::new(&gpu, COVER, fragment, RGBA);
    painting.view_mask = 0b101;
    let pipeline = gpu.painting(&painting);
    let all = Pass {
        colors: &[canvas],
        clears: &[[1.0; 4]],
        view_mask: 0b111,
        ..Pass::default()
    };
    gpu.draw(&all, |_| ());
    let two = Pass {
        clears: &[BLACK],
        view_mask: 0b101,
        ..all
    };
    gpu.draw(&two, |commands| {
        gpu.bind(commands, pipeline);
        gpu.draw_vertices(commands, 3);
    });
    let colors = gpu.colors(&canvas);
    let layers: Vec<_> = colors.chunks(25).map(|layer| layer.to_vec()).collect();
    assert_eq!(layers, [[[1; 4]; 25], [[255; 4]; 25], [[3; 4]; 25]]);
}

#[test]
fn vertices_choose_layers() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    if !has(
        "shaderOutputLayer",
        gpu.features12.shader_output_layer == vk::TRUE,
    ) {
        return;
    }
    let canvas = gpu.canvas_of(RGBA, 6, 6, 4, 1);
    let vertex = "
        void main() {
            gl_Position = vec4(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0, 0.5, 1.0);
            gl_Layer = gl_InstanceIndex;
        }";
    let painting = Painting::new(&gpu, vertex, PUSHED, RGBA);
    let pipeline = gpu.painting(&painting);
    gpu.paint(&canvas, pipeline, |commands| {
        gpu.push(commands, painting.layout, &[1.0f32; 4]);
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_draw(commands, 3, 2, 0, 1) };
    });
    let colors = gpu.colors(&canvas);
    let layers: Vec<_> = colors.chunks(36).map(|layer| layer[7][0]).collect();
    assert_eq!(layers, [0, 255, 255, 0]);
}

/// Secondary command buffers go on with the pass, but with nothing bound; a suspended pass keeps
/// what it drew.
#[test]
fn passes_go_on_in_other_command_buffers() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let canvas = gpu.canvas(RGBA, 4, 4);
    let painting = Painting::new(&gpu, COVER, PUSHED, RGBA);
    let pipeline = gpu.painting(&painting);
    let info = vk::CommandBufferAllocateInfo::default()
        .command_pool(gpu.pool)
        .level(vk::CommandBufferLevel::SECONDARY)
        .command_buffer_count(1);
    let formats = [RGBA];
    let mut rendering = vk::CommandBufferInheritanceRenderingInfo::default()
        .color_attachment_formats(&formats)
        .rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let inheritance = vk::CommandBufferInheritanceInfo::default().push_next(&mut rendering);
    let begin = vk::CommandBufferBeginInfo::default()
        .flags(vk::CommandBufferUsageFlags::RENDER_PASS_CONTINUE)
        .inheritance_info(&inheritance);
    // SAFETY: the pool is of this device; the structures outlive the calls.
    let secondary = unsafe {
        let secondary = gpu.device.allocate_command_buffers(&info).unwrap()[0];
        gpu.device.begin_command_buffer(secondary, &begin).unwrap();
        gpu.look_at(secondary, &canvas);
        gpu.bind(secondary, pipeline);
        gpu.push(secondary, painting.layout, &[0.0f32, 1.0, 0.0, 1.0]);
        gpu.draw_vertices(secondary, 3);
        gpu.device.end_command_buffer(secondary).unwrap();
        secondary
    };
    let pass = Pass {
        flags: vk::RenderingFlags::CONTENTS_SECONDARY_COMMAND_BUFFERS,
        ..Pass::black(&canvas)
    };
    gpu.draw(&pass, |commands| {
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_execute_commands(commands, &[secondary]) };
    });
    assert_eq!(gpu.colors(&canvas), [[0, 255, 0, 255]; 16]);

    let suspends = Pass {
        flags: vk::RenderingFlags::SUSPENDING,
        ..pass
    };
    let resumes = Pass {
        flags: vk::RenderingFlags::RESUMING,
        ..pass
    };
    gpu.run(|commands| {
        gpu.record_pass(commands, &suspends, |commands| {
            gpu.bind(commands, pipeline);
            gpu.push(commands, painting.layout, &[1.0f32, 0.0, 0.0, 1.0]);
            gpu.draw_vertices(commands, 3);
        });
        gpu.record_pass(commands, &resumes, |_| ());
    });
    assert_eq!(gpu.colors(&canvas), [[255, 0, 0, 255]; 16]);
}

/// Draws differ by what is pushed and by what is set in between: each is drawn with what was
/// current then.
#[test]
fn draws_keep_what_was_current() {
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    const COUNT: u32 = 100;
    let canvas = gpu.canvas(RGBA, COUNT, 1);
    let mut painting = Painting::new(&gpu, COVER, PUSHED, RGBA);
    painting.dynamic = vec![vk::DynamicState::CULL_MODE, vk::DynamicState::FRONT_FACE];
    let pipeline = gpu.painting(&painting);
    gpu.paint(&canvas, pipeline, |commands| {
        for column in 0..COUNT {
            // Every third one is culled.
            let culled = column % 3 == 2;
            let cull = if culled {
                vk::CullModeFlags::BACK
            } else {
                vk::CullModeFlags::FRONT
            };
            let part = vk::Rect2D {
                offset: vk::Offset2D {
                    x: column as i32,
                    y: 0,
                },
                extent: vk::Extent2D {
                    width: 1,
                    height: 1,
                },
            };
            // SAFETY: the command buffer is being recorded.
            unsafe {
                gpu.device.cmd_set_scissor(commands, 0, &[part]);
                gpu.device.cmd_set_cull_mode(commands, cull);
                // The triangle turns clockwise on the screen, where y points down.
                let front = vk::FrontFace::COUNTER_CLOCKWISE;
                gpu.device.cmd_set_front_face(commands, front);
            }
            gpu.push(commands, painting.layout, &[column as f32 / 255.0; 4]);
            gpu.draw_vertices(commands, 3);
        }
    });
    for (column, color) in gpu.colors(&canvas).into_iter().enumerate() {
        let expected = if column % 3 == 2 { 0 } else { column as u8 };
        assert_eq!(color, [expected; 4], "column {column}");
    }
}
