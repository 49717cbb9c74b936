//! Drawing: attachments, graphics pipelines, passes.

use ash::vk;
use bytemuck::Pod;

use crate::gpu::Made;
use crate::{Buffer, Gpu, Stage, flat_info, glsl, stage_flag};

/// An attachment in the general layout, with a view of all of it.
#[derive(Clone, Copy, Debug)]
pub struct Canvas {
    pub image: vk::Image,
    pub view: vk::ImageView,
    pub format: vk::Format,
    pub aspects: vk::ImageAspectFlags,
    pub width: u32,
    pub height: u32,
    pub layers: u32,
    pub samples: u32,
}

impl Canvas {
    fn range(&self) -> vk::ImageSubresourceRange {
        vk::ImageSubresourceRange::default()
            .aspect_mask(self.aspects)
            .level_count(1)
            .layer_count(self.layers)
    }

    /// All of its pixels.
    pub fn area(&self) -> vk::Rect2D {
        vk::Rect2D::default().extent(vk::Extent2D {
            width: self.width,
            height: self.height,
        })
    }
}

/// A vertex of the usual kind: a position in clip space and a colour.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Corner {
    pub position: [f32; 4],
    pub color: [f32; 4],
}

impl Corner {
    pub fn at(x: f32, y: f32, color: [f32; 4]) -> Corner {
        Corner {
            position: [x, y, 0.5, 1.0],
            color,
        }
    }
}

/// A graphics pipeline to be made. Viewport and scissor are dynamic.
#[derive(Clone)]
pub struct Painting<'a> {
    pub vertex: &'a str,
    /// Control and evaluation.
    pub tessellation: Option<[&'a str; 2]>,
    /// Vertices of a patch.
    pub control_points: u32,
    pub lower_left: bool,
    pub geometry: Option<&'a str>,
    /// Task, if there is one, and mesh: in the place of all stages above.
    pub mesh: Option<(Option<&'a str>, &'a str)>,
    /// None: depth and stencil alone.
    pub fragment: Option<&'a str>,
    pub bindings: Vec<vk::VertexInputBindingDescription>,
    pub attributes: Vec<vk::VertexInputAttributeDescription>,
    pub topology: vk::PrimitiveTopology,
    pub restart: bool,
    pub rasterization: vk::PipelineRasterizationStateCreateInfo<'a>,
    pub samples: u32,
    /// Of `VK_EXT_sample_locations`, in the place of the standard ones.
    pub locations: &'a [vk::SampleLocationEXT],
    pub alpha_to_coverage: bool,
    pub depth_stencil: vk::PipelineDepthStencilStateCreateInfo<'a>,
    /// One a colour attachment.
    pub blend: Vec<vk::PipelineColorBlendAttachmentState>,
    pub logic: Option<vk::LogicOp>,
    pub colors: Vec<vk::Format>,
    pub depth: vk::Format,
    pub stencil: vk::Format,
    pub view_mask: u32,
    /// Viewports and scissors.
    pub viewports: u32,
    pub dynamic: Vec<vk::DynamicState>,
    pub layout: vk::PipelineLayout,
    /// In the place of the formats: a render pass and its subpass.
    pub render_pass: Option<(vk::RenderPass, u32)>,
}

impl<'a> Painting<'a> {
    /// Triangles without vertex buffers into one attachment, without tests and blending.
    pub fn new(gpu: &Gpu, vertex: &'a str, fragment: &'a str, color: vk::Format) -> Painting<'a> {
        let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        Painting {
            vertex,
            tessellation: None,
            control_points: 0,
            locations: &[],
            lower_left: false,
            geometry: None,
            mesh: None,
            fragment: Some(fragment),
            bindings: Vec::new(),
            attributes: Vec::new(),
            topology: vk::PrimitiveTopology::TRIANGLE_LIST,
            restart: false,
            rasterization,
            samples: 1,
            alpha_to_coverage: false,
            depth_stencil: vk::PipelineDepthStencilStateCreateInfo::default(),
            blend: vec![opaque()],
            logic: None,
            colors: vec![color],
            depth: vk::Format::UNDEFINED,
            stencil: vk::Format::UNDEFINED,
            view_mask: 0,
            viewports: 1,
            dynamic: Vec::new(),
            layout: gpu.layout(&[]),
            render_pass: None,
        }
    }

    /// [`Corner`]s as vertices: locations 0 and 1 of binding 0.
    pub fn with_corners(mut self) -> Painting<'a> {
        self.bindings
            .push(vk::VertexInputBindingDescription::default().stride(size_of::<Corner>() as u32));
        for location in 0..2 {
            let attribute = vk::VertexInputAttributeDescription::default()
                .location(location)
                .format(vk::Format::R32G32B32A32_SFLOAT)
                .offset(16 * location);
            self.attributes.push(attribute);
        }
        self
    }
}

/// All components are written as they are.
fn opaque() -> vk::PipelineColorBlendAttachmentState {
    vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA)
}

impl Gpu {
    /// An attachment of one level, which can also be read by shaders and copied.
    pub fn canvas(&self, format: vk::Format, width: u32, height: u32) -> Canvas {
        self.canvas_of(format, width, height, 1, 1)
    }

    /// The same, with layers (a view of an array where there are several) and samples.
    pub fn canvas_of(
        &self,
        format: vk::Format,
        width: u32,
        height: u32,
        layers: u32,
        samples: u32,
    ) -> Canvas {
        let flags = vk::ImageCreateFlags::empty();
        self.flagged_canvas(flags, format, [width, height], layers, samples)
    }

    /// The same, of an image with flags.
    pub fn flagged_canvas(
        &self,
        flags: vk::ImageCreateFlags,
        format: vk::Format,
        [width, height]: [u32; 2],
        layers: u32,
        samples: u32,
    ) -> Canvas {
        use vk::ImageAspectFlags as Aspect;
        let aspects = match format {
            vk::Format::D16_UNORM | vk::Format::D32_SFLOAT => Aspect::DEPTH,
            vk::Format::S8_UINT => Aspect::STENCIL,
            vk::Format::D24_UNORM_S8_UINT | vk::Format::D32_SFLOAT_S8_UINT => {
                Aspect::DEPTH | Aspect::STENCIL
            }
            _ => Aspect::COLOR,
        };
        let attachment = match aspects == Aspect::COLOR {
            true => vk::ImageUsageFlags::COLOR_ATTACHMENT,
            false => vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
        };
        let info = flat_info(format, width, height)
            .flags(flags)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::from_raw(samples))
            .usage(
                attachment
                    | vk::ImageUsageFlags::SAMPLED
                    | vk::ImageUsageFlags::INPUT_ATTACHMENT
                    | vk::ImageUsageFlags::TRANSFER_SRC
                    | vk::ImageUsageFlags::TRANSFER_DST,
            );
        let kind = match layers {
            1 => vk::ImageViewType::TYPE_2D,
            _ => vk::ImageViewType::TYPE_2D_ARRAY,
        };
        let mut canvas = Canvas {
            image: vk::Image::null(),
            view: vk::ImageView::null(),
            format,
            aspects,
            width,
            height,
            layers,
            samples,
        };
        canvas.image = self.image(&info);
        let view = vk::ImageViewCreateInfo::default()
            .image(canvas.image)
            .view_type(kind)
            .format(format)
            .subresource_range(canvas.range());
        canvas.view = self.view(&view);
        self.to_general(canvas.image, canvas.range());
        canvas
    }

    /// The texels of an aspect of an attachment of one sample, layer by layer.
    pub fn texels<T: Pod>(&self, canvas: &Canvas, aspect: vk::ImageAspectFlags) -> Vec<T> {
        let count = u64::from(canvas.width) * u64::from(canvas.height) * u64::from(canvas.layers);
        let buffer: Buffer = self.buffer(count * size_of::<T>() as u64);
        let layers = vk::ImageSubresourceLayers::default()
            .aspect_mask(aspect)
            .layer_count(canvas.layers);
        let copy = vk::BufferImageCopy::default()
            .image_subresource(layers)
            .image_extent(vk::Extent3D {
                width: canvas.width,
                height: canvas.height,
                depth: 1,
            });
        self.run(|commands| {
            // SAFETY: the buffer holds all of it.
            unsafe {
                self.device.cmd_copy_image_to_buffer(
                    commands,
                    canvas.image,
                    vk::ImageLayout::GENERAL,
                    buffer.handle,
                    &[copy],
                );
            }
        });
        buffer.read()
    }

    /// The colours of an attachment with four bytes a texel.
    pub fn colors(&self, canvas: &Canvas) -> Vec<[u8; 4]> {
        self.texels(canvas, vk::ImageAspectFlags::COLOR)
    }

    /// Makes a graphics pipeline.
    pub fn painting(&self, painting: &Painting<'_>) -> vk::Pipeline {
        self.painting_with(painting, vk::PipelineCreateFlags::empty(), std::ptr::null())
    }

    /// The same, with flags and structures that are put before its chain.
    pub fn painting_with(
        &self,
        painting: &Painting<'_>,
        flags: vk::PipelineCreateFlags,
        next: *const std::ffi::c_void,
    ) -> vk::Pipeline {
        let mut stages = vec![(Stage::Vertex, painting.vertex)];
        let between = [Stage::TessellationControl, Stage::TessellationEvaluation];
        let sources = painting.tessellation.into_iter().flatten();
        stages.extend(between.into_iter().zip(sources));
        stages.extend(painting.geometry.map(|source| (Stage::Geometry, source)));
        if let Some((task, mesh)) = painting.mesh {
            stages.extend(task.map(|source| (Stage::Task, source)));
            stages.push((Stage::Mesh, mesh));
        }
        stages.extend(painting.fragment.map(|source| (Stage::Fragment, source)));
        // A part of a pipeline may have no vertex shader.
        stages.retain(|(_, source)| !source.is_empty());
        let words = |(stage, source)| (stage, glsl(stage, source));
        let stages: Vec<_> = stages.into_iter().map(words).collect();
        self.try_painting(painting, &stages, flags, next)
            .expect("vkCreateGraphicsPipelines")
    }

    /// The same from the words of modules, in the place of the sources; a pipeline that is refused
    /// is an answer.
    pub fn try_painting(
        &self,
        painting: &Painting<'_>,
        stages: &[(Stage, Vec<u32>)],
        flags: vk::PipelineCreateFlags,
        next: *const std::ffi::c_void,
    ) -> Result<vk::Pipeline, vk::Result> {
        let stages: Vec<_> = stages
            .iter()
            .map(|(stage, words)| {
                vk::PipelineShaderStageCreateInfo::default()
                    .stage(stage_flag(*stage))
                    .module(self.module(words))
                    .name(c"main")
            })
            .collect();
        let input = vk::PipelineVertexInputStateCreateInfo::default()
            .vertex_binding_descriptions(&painting.bindings)
            .vertex_attribute_descriptions(&painting.attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
            .topology(painting.topology)
            .primitive_restart_enable(painting.restart);
        let mut origin = vk::PipelineTessellationDomainOriginStateCreateInfo::default()
            .domain_origin(match painting.lower_left {
                true => vk::TessellationDomainOrigin::LOWER_LEFT,
                false => vk::TessellationDomainOrigin::UPPER_LEFT,
            });
        let tessellation = vk::PipelineTessellationStateCreateInfo::default()
            .patch_control_points(painting.control_points)
            .push_next(&mut origin);
        let viewports = vk::PipelineViewportStateCreateInfo::default()
            .viewport_count(painting.viewports)
            .scissor_count(painting.viewports);
        let samples = vk::SampleCountFlags::from_raw(painting.samples);
        let mut multisample = vk::PipelineMultisampleStateCreateInfo::default()
            .rasterization_samples(samples)
            .alpha_to_coverage_enable(painting.alpha_to_coverage);
        let mut locations = vk::PipelineSampleLocationsStateCreateInfoEXT::default()
            .sample_locations_enable(true)
            .sample_locations_info(
                vk::SampleLocationsInfoEXT::default()
                    .sample_locations_per_pixel(samples)
                    .sample_location_grid_size(vk::Extent2D {
                        width: 1,
                        height: 1,
                    })
                    .sample_locations(painting.locations),
            );
        if !painting.locations.is_empty() {
            multisample = multisample.push_next(&mut locations);
        }
        let blend = vk::PipelineColorBlendStateCreateInfo::default()
            .logic_op_enable(painting.logic.is_some())
            .logic_op(painting.logic.unwrap_or_default())
            .attachments(&painting.blend);
        let mut dynamic = vec![vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
        dynamic.extend(&painting.dynamic);
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
        let mut rendering = vk::PipelineRenderingCreateInfo::default()
            .color_attachment_formats(&painting.colors)
            .depth_attachment_format(painting.depth)
            .stencil_attachment_format(painting.stencil)
            .view_mask(painting.view_mask);
        rendering.p_next = next;
        let mut info = vk::GraphicsPipelineCreateInfo::default()
            .flags(flags)
            .stages(&stages)
            .viewport_state(&viewports)
            .rasterization_state(&painting.rasterization)
            .multisample_state(&multisample)
            .depth_stencil_state(&painting.depth_stencil)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(painting.layout);
        if painting.mesh.is_none() {
            info = info
                .vertex_input_state(&input)
                .input_assembly_state(&assembly);
        }
        if painting.control_points > 0 {
            info = info.tessellation_state(&tessellation);
        }
        match painting.render_pass {
            Some((pass, subpass)) => {
                info = info.render_pass(pass).subpass(subpass);
                info.p_next = next;
            }
            None => info.p_next = (&raw const rendering).cast(),
        }
        let cache = vk::PipelineCache::null();
        // SAFETY: the structures outlive the call.
        let made = unsafe { self.device.create_graphics_pipelines(cache, &[info], None) };
        let pipeline = made.map_err(|(_, code)| code)?[0];
        self.keep(Made::Pipeline(pipeline));
        Ok(pipeline)
    }

    /// A part of a pipeline, as a library.
    pub fn painting_part(
        &self,
        painting: &Painting<'_>,
        parts: vk::GraphicsPipelineLibraryFlagsEXT,
    ) -> vk::Pipeline {
        self.painting_part_with(painting, parts, vk::PipelineCreateFlags::LIBRARY_KHR)
    }

    /// The same with creation flags, `VK_PIPELINE_CREATE_LIBRARY_BIT_KHR` among them.
    pub fn painting_part_with(
        &self,
        painting: &Painting<'_>,
        parts: vk::GraphicsPipelineLibraryFlagsEXT,
        flags: vk::PipelineCreateFlags,
    ) -> vk::Pipeline {
        use vk::GraphicsPipelineLibraryFlagsEXT as Part;
        let mut painting = painting.clone();
        if !parts.contains(Part::PRE_RASTERIZATION_SHADERS) {
            painting.vertex = "";
            painting.tessellation = None;
            painting.geometry = None;
            painting.mesh = None;
        }
        if !parts.contains(Part::FRAGMENT_SHADER) {
            painting.fragment = None;
        }
        let info = vk::GraphicsPipelineLibraryCreateInfoEXT::default().flags(parts);
        self.painting_with(&painting, flags, (&raw const info).cast())
    }

    /// A pipeline of libraries.
    pub fn linked(&self, libraries: &[vk::Pipeline], layout: vk::PipelineLayout) -> vk::Pipeline {
        self.linked_with(libraries, layout, vk::PipelineCreateFlags::empty())
    }

    /// The same with creation flags.
    pub fn linked_with(
        &self,
        libraries: &[vk::Pipeline],
        layout: vk::PipelineLayout,
        flags: vk::PipelineCreateFlags,
    ) -> vk::Pipeline {
        let mut linked = vk::PipelineLibraryCreateInfoKHR::default().libraries(libraries);
        let info = vk::GraphicsPipelineCreateInfo::default()
            .flags(flags)
            .layout(layout)
            .push_next(&mut linked);
        let cache = vk::PipelineCache::null();
        // SAFETY: the structures outlive the call.
        let made = unsafe { self.device.create_graphics_pipelines(cache, &[info], None) };
        let pipeline = made
            .map_err(|(_, code)| code)
            .expect("libraries are linked")[0];
        self.keep(Made::Pipeline(pipeline));
        pipeline
    }

    /// A shader object without sets, from SPIR-V or from another one's binary.
    pub fn shader_object(
        &self,
        stage: Stage,
        code_type: vk::ShaderCodeTypeEXT,
        code: &[u8],
    ) -> vk::ShaderEXT {
        let flags = vk::ShaderCreateFlagsEXT::empty();
        self.shader_object_with(stage, (code_type, code), flags, &[])
    }

    /// The same with flags, and with sets.
    pub fn shader_object_with(
        &self,
        stage: Stage,
        (code_type, code): (vk::ShaderCodeTypeEXT, &[u8]),
        flags: vk::ShaderCreateFlagsEXT,
        sets: &[vk::DescriptorSetLayout],
    ) -> vk::ShaderEXT {
        let push = [vk::PushConstantRange::default()
            .stage_flags(vk::ShaderStageFlags::ALL)
            .size(128)];
        let next = match stage {
            Stage::Vertex | Stage::TessellationEvaluation => {
                let mut next = vk::ShaderStageFlags::FRAGMENT;
                if self.features.geometry_shader == vk::TRUE {
                    next |= vk::ShaderStageFlags::GEOMETRY;
                }
                if stage == Stage::Vertex && self.features.tessellation_shader == vk::TRUE {
                    next |= vk::ShaderStageFlags::TESSELLATION_CONTROL;
                }
                next
            }
            Stage::TessellationControl => vk::ShaderStageFlags::TESSELLATION_EVALUATION,
            Stage::Geometry | Stage::Mesh => vk::ShaderStageFlags::FRAGMENT,
            Stage::Task => vk::ShaderStageFlags::MESH_EXT,
            _ => vk::ShaderStageFlags::empty(),
        };
        let info = vk::ShaderCreateInfoEXT::default()
            .flags(flags)
            .set_layouts(sets)
            .stage(stage_flag(stage))
            .next_stage(next)
            .code_type(code_type)
            .code(code)
            .name(c"main")
            .push_constant_ranges(&push);
        let objects = ash::ext::shader_object::Device::new(&self.instance, &self.device);
        // SAFETY: the structures outlive the call.
        let made = unsafe { objects.create_shaders(&[info], None) };
        let shader = made.map_err(|(_, code)| code).expect("vkCreateShadersEXT")[0];
        self.keep(Made::Shader(shader));
        shader
    }

    /// A render pass that is destroyed at the end.
    pub fn render_pass(&self, info: &vk::RenderPassCreateInfo2<'_>) -> vk::RenderPass {
        // SAFETY: the info outlives the call.
        let pass = unsafe { self.device.create_render_pass2(info, None) };
        let pass = pass.expect("vkCreateRenderPass2");
        self.keep(Made::RenderPass(pass));
        pass
    }

    /// A framebuffer of attachments of one size.
    pub fn framebuffer(&self, pass: vk::RenderPass, canvases: &[Canvas]) -> vk::Framebuffer {
        let views: Vec<_> = canvases.iter().map(|canvas| canvas.view).collect();
        let info = vk::FramebufferCreateInfo::default()
            .render_pass(pass)
            .attachments(&views)
            .width(canvases[0].width)
            .height(canvases[0].height)
            .layers(1);
        // SAFETY: the info outlives the call.
        let framebuffer = unsafe { self.device.create_framebuffer(&info, None) };
        let framebuffer = framebuffer.expect("vkCreateFramebuffer");
        self.keep(Made::Framebuffer(framebuffer));
        framebuffer
    }

    /// A set whose binding 0 is an input attachment.
    pub fn input_set(
        &self,
        layout: vk::DescriptorSetLayout,
        view: vk::ImageView,
    ) -> vk::DescriptorSet {
        let ty = vk::DescriptorType::INPUT_ATTACHMENT;
        let size = vk::DescriptorPoolSize {
            ty,
            descriptor_count: 1,
        };
        let set = self.allocate_set(layout, &[size]);
        let image = [vk::DescriptorImageInfo::default()
            .image_view(view)
            .image_layout(vk::ImageLayout::GENERAL)];
        let write = vk::WriteDescriptorSet::default()
            .dst_set(set)
            .descriptor_type(ty)
            .image_info(&image);
        // SAFETY: the structures outlive the call.
        unsafe { self.device.update_descriptor_sets(&[write], &[]) };
        set
    }
}
