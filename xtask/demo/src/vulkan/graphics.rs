//! Pictures that are drawn into, and the pipelines that draw.

use anyhow::{Context as _, Result};
use ash::vk;

use super::{Context, memory};

/// A picture of one level that is drawn into, and sampled or copied afterwards.
pub struct Target<'a> {
    context: &'a Context,
    pub image: vk::Image,
    memory: vk::DeviceMemory,
    pub view: vk::ImageView,
    pub aspect: vk::ImageAspectFlags,
}

impl<'a> Target<'a> {
    pub fn new(
        context: &'a Context,
        format: vk::Format,
        (width, height): (u32, u32),
        usage: vk::ImageUsageFlags,
    ) -> Result<Target<'a>> {
        let aspect = match usage.contains(vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT) {
            true => vk::ImageAspectFlags::DEPTH,
            false => vk::ImageAspectFlags::COLOR,
        };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D {
                width,
                height,
                depth: 1,
            })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(usage);
        let device = &context.device;
        // SAFETY: the handles are of this device, and the memory is bound once.
        unsafe {
            let image = device.create_image(&info, None)?;
            let needs = device.get_image_memory_requirements(image);
            let memory = memory::allocate(context, needs, false).context("memory for a picture")?;
            device.bind_image_memory(image, memory, 0)?;
            let view = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(format)
                .subresource_range(whole(aspect));
            Ok(Target {
                context,
                image,
                memory,
                view: device.create_image_view(&view, None)?,
                aspect,
            })
        }
    }

    /// An attachment of a pass, cleared when the pass begins.
    pub fn attachment(&self, clear: vk::ClearValue) -> vk::RenderingAttachmentInfo<'static> {
        let layout = match self.aspect {
            vk::ImageAspectFlags::DEPTH => vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
            _ => vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
        };
        vk::RenderingAttachmentInfo::default()
            .image_view(self.view)
            .image_layout(layout)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(clear)
    }
}

impl Drop for Target<'_> {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: the device is idle when pictures go.
        unsafe {
            device.destroy_image_view(self.view, None);
            device.destroy_image(self.image, None);
            device.free_memory(self.memory, None);
        }
    }
}

fn whole(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(aspect)
        .level_count(1)
        .layer_count(1)
}

/// Changes the layout of a picture of one level between all that was recorded before and all that
/// comes after.
pub fn change_layout(
    context: &Context,
    commands: vk::CommandBuffer,
    (image, aspect): (vk::Image, vk::ImageAspectFlags),
    from: vk::ImageLayout,
    to: vk::ImageLayout,
) {
    let barrier = vk::ImageMemoryBarrier::default()
        .old_layout(from)
        .new_layout(to)
        .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
        .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(image)
        .subresource_range(whole(aspect));
    let (all, none) = (
        vk::PipelineStageFlags::ALL_COMMANDS,
        vk::DependencyFlags::empty(),
    );
    // SAFETY: the command buffer is recording, and the image outlives the submission.
    unsafe {
        context
            .device
            .cmd_pipeline_barrier(commands, all, all, none, &[], &[], &[barrier]);
    }
}

/// The differences between pipelines.
pub struct DrawInput<'i> {
    pub vertex: &'i [u8],
    pub fragment: &'i [u8],
    /// The fragment shader's specialization constant 0.
    pub has_holes: bool,
    pub color: vk::Format,
    /// With a depth test that passes greater depths.
    pub depth: Option<vk::Format>,
    pub vertex_input: vk::PipelineVertexInputStateCreateInfo<'i>,
    /// Blends by premultiplied alpha.
    pub blends: bool,
    pub layout: vk::PipelineLayout,
}

/// A pipeline that draws triangles of either winding; viewport and scissor are dynamic.
pub struct DrawPipeline<'a> {
    context: &'a Context,
    pub handle: vk::Pipeline,
}

impl<'a> DrawPipeline<'a> {
    pub fn new(context: &'a Context, input: &DrawInput) -> Result<DrawPipeline<'a>> {
        let device = &context.device;
        let module = |bytes: &[u8]| {
            let words: Vec<u32> = bytes
                .chunks_exact(4)
                .map(bytemuck::pod_read_unaligned)
                .collect();
            let info = vk::ShaderModuleCreateInfo::default().code(&words);
            // SAFETY: the words are a whole SPIR-V module.
            unsafe { device.create_shader_module(&info, None) }
        };
        let (vertex, fragment) = (module(input.vertex)?, module(input.fragment)?);
        let constant = u32::from(input.has_holes).to_ne_bytes();
        let entries = [vk::SpecializationMapEntry::default().size(4)];
        let constants = vk::SpecializationInfo::default()
            .map_entries(&entries)
            .data(&constant);
        let stage = |stage, module| {
            vk::PipelineShaderStageCreateInfo::default()
                .stage(stage)
                .module(module)
                .name(c"main")
        };
        let stages = [
            stage(vk::ShaderStageFlags::VERTEX, vertex),
            stage(vk::ShaderStageFlags::FRAGMENT, fragment).specialization_info(&constants),
        ];
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
            .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let viewport = vk::PipelineViewportStateCreateInfo::default()
            .viewport_count(1)
            .scissor_count(1);
        let rasterization = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        let samples = vk::PipelineMultisampleStateCreateInfo::default()
            .rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default()
            .depth_test_enable(input.depth.is_some())
            .depth_write_enable(input.depth.is_some())
            .depth_compare_op(vk::CompareOp::GREATER);
        let blending = [vk::PipelineColorBlendAttachmentState::default()
            .blend_enable(input.blends)
            .src_color_blend_factor(vk::BlendFactor::ONE)
            .dst_color_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
            .src_alpha_blend_factor(vk::BlendFactor::ONE_MINUS_DST_ALPHA)
            .dst_alpha_blend_factor(vk::BlendFactor::ONE)
            .color_write_mask(vk::ColorComponentFlags::RGBA)];
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blending);
        let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
        let formats = [input.color];
        let mut rendering = vk::PipelineRenderingCreateInfo::default()
            .color_attachment_formats(&formats)
            .depth_attachment_format(input.depth.unwrap_or(vk::Format::UNDEFINED));
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input.vertex_input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&rasterization)
            .multisample_state(&samples)
            .depth_stencil_state(&depth)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(input.layout)
            .push_next(&mut rendering);
        // SAFETY: the structures outlive the call, and the modules are not needed after it.
        let made = unsafe {
            let made = device.create_graphics_pipelines(vk::PipelineCache::null(), &[info], None);
            device.destroy_shader_module(vertex, None);
            device.destroy_shader_module(fragment, None);
            made.map_err(|(_, error)| error)
                .context("creating a graphics pipeline")?
        };
        Ok(DrawPipeline {
            context,
            handle: made[0],
        })
    }
}

impl Drop for DrawPipeline<'_> {
    fn drop(&mut self) {
        // SAFETY: the device is idle when pipelines go.
        unsafe { self.context.device.destroy_pipeline(self.handle, None) };
    }
}

/// The viewport that a picture fills.
pub fn viewport((width, height): (u32, u32)) -> vk::Viewport {
    vk::Viewport {
        width: width as f32,
        height: height as f32,
        max_depth: 1.0,
        ..Default::default()
    }
}
