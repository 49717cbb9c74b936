//! Passes of dynamic rendering, and draws in them.

use ash::{khr, vk};
use bytemuck::Pod;

use crate::{Buffer, Canvas, Gpu};

pub const RGBA: vk::Format = vk::Format::R8G8B8A8_UNORM;
pub const BLACK: [f32; 4] = [0.0; 4];

/// A vertex shader: one triangle over all of the viewport.
pub const COVER: &str = "
    void main() {
        gl_Position = vec4(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0, 0.5, 1.0);
    }";

/// The colour that is pushed.
pub const PUSHED: &str = "
    layout(push_constant) uniform Push { vec4 pushed; };
    layout(location = 0) out vec4 color;
    void main() { color = pushed; }";

/// A fragment shader that writes one everywhere.
pub const WHITE: &str = "
    layout(location = 0) out vec4 color;
    void main() { color = vec4(1.0); }";

/// A pass of dynamic rendering.
#[derive(Clone, Copy, Default)]
pub struct Pass<'a> {
    pub colors: &'a [Canvas],
    /// Clear colours, one a canvas; where there is none, contents are loaded.
    pub clears: &'a [[f32; 4]],
    /// Where colours are resolved to, one a canvas.
    pub resolves: &'a [Canvas],
    pub depth: Option<Canvas>,
    pub stencil: Option<Canvas>,
    /// Of depth and stencil.
    pub clear_depth: Option<(f32, u32)>,
    pub view_mask: u32,
    pub flags: vk::RenderingFlags,
    /// Samples that draws have of canvases with one
    /// (`VK_EXT_multisampled_render_to_single_sampled`); 0 or 1: no more.
    pub samples: u32,
    /// The attachment of fragment shading rates, and the size of the squares of its texels.
    pub rates: Option<(vk::ImageView, vk::Extent2D)>,
}

impl<'a> Pass<'a> {
    /// Into one attachment, which is black before.
    pub fn black(canvas: &'a Canvas) -> Pass<'a> {
        Pass {
            colors: std::slice::from_ref(canvas),
            clears: &[BLACK],
            ..Pass::default()
        }
    }
}

impl Gpu {
    /// This device, if it draws.
    #[track_caller]
    pub fn drawing(self) -> Option<Gpu> {
        self.with("a graphics queue with dynamic rendering", |gpu| {
            gpu.has_graphics() && gpu.features13.dynamic_rendering == vk::TRUE
        })
    }

    /// Records a pass, with viewport and scissor over all of the first attachment.
    pub fn record_pass(
        &self,
        commands: vk::CommandBuffer,
        pass: &Pass<'_>,
        record: impl FnOnce(vk::CommandBuffer),
    ) {
        let layout = vk::ImageLayout::GENERAL;
        let attachment = |view| {
            vk::RenderingAttachmentInfo::default()
                .image_view(view)
                .image_layout(layout)
                .load_op(vk::AttachmentLoadOp::LOAD)
                .store_op(vk::AttachmentStoreOp::STORE)
        };
        let color = |(index, canvas): (usize, &Canvas)| {
            let mut info = attachment(canvas.view);
            if let Some(&float32) = pass.clears.get(index) {
                let color = vk::ClearColorValue { float32 };
                info = info
                    .load_op(vk::AttachmentLoadOp::CLEAR)
                    .clear_value(vk::ClearValue { color });
            }
            if pass.samples > 1 {
                info = info
                    .resolve_mode(vk::ResolveModeFlags::AVERAGE)
                    .resolve_image_layout(layout);
            }
            if let Some(resolve) = pass.resolves.get(index) {
                info = info
                    .resolve_mode(vk::ResolveModeFlags::AVERAGE)
                    .resolve_image_view(resolve.view)
                    .resolve_image_layout(layout);
            }
            info
        };
        let colors: Vec<_> = pass.colors.iter().enumerate().map(color).collect();
        let side = |canvas: Option<Canvas>| {
            let mut info = attachment(canvas.map_or(vk::ImageView::null(), |it| it.view));
            if let Some((depth, stencil)) = pass.clear_depth {
                let depth_stencil = vk::ClearDepthStencilValue { depth, stencil };
                info = info
                    .load_op(vk::AttachmentLoadOp::CLEAR)
                    .clear_value(vk::ClearValue { depth_stencil });
            }
            info
        };
        let (depth, stencil) = (side(pass.depth), side(pass.stencil));
        let first = pass
            .colors
            .first()
            .or(pass.depth.as_ref())
            .or(pass.stencil.as_ref());
        let first = first.expect("a pass has attachments");
        let mut info = vk::RenderingInfo::default()
            .flags(pass.flags)
            .render_area(first.area())
            .layer_count(if pass.view_mask == 0 { first.layers } else { 1 })
            .view_mask(pass.view_mask)
            .color_attachments(&colors);
        if pass.depth.is_some() {
            info = info.depth_attachment(&depth);
        }
        if pass.stencil.is_some() {
            info = info.stencil_attachment(&stencil);
        }
        let mut samples = vk::MultisampledRenderToSingleSampledInfoEXT::default()
            .multisampled_render_to_single_sampled_enable(true)
            .rasterization_samples(vk::SampleCountFlags::from_raw(pass.samples));
        if pass.samples > 1 {
            info = info.push_next(&mut samples);
        }
        let (view, texel) = pass.rates.unwrap_or_default();
        let mut rates = vk::RenderingFragmentShadingRateAttachmentInfoKHR::default()
            .image_view(view)
            .image_layout(layout)
            .shading_rate_attachment_texel_size(texel);
        if pass.rates.is_some() {
            info = info.push_next(&mut rates);
        }
        // SAFETY: the command buffer is being recorded, and the structures outlive the calls.
        unsafe {
            self.device.cmd_begin_rendering(commands, &info);
            if !pass
                .flags
                .contains(vk::RenderingFlags::CONTENTS_SECONDARY_COMMAND_BUFFERS)
            {
                self.look_at(commands, first);
            }
            record(commands);
            self.device.cmd_end_rendering(commands);
        }
    }

    /// Sets viewport and scissor to all of an attachment.
    pub fn look_at(&self, commands: vk::CommandBuffer, canvas: &Canvas) {
        let viewport = vk::Viewport {
            x: 0.0,
            y: 0.0,
            width: canvas.width as f32,
            height: canvas.height as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        // SAFETY: the command buffer is being recorded.
        unsafe {
            self.device.cmd_set_viewport(commands, 0, &[viewport]);
            self.device.cmd_set_scissor(commands, 0, &[canvas.area()]);
        }
    }

    /// Records and runs a pass.
    pub fn draw(&self, pass: &Pass<'_>, record: impl FnOnce(vk::CommandBuffer)) {
        self.run(|commands| self.record_pass(commands, pass, record));
    }

    /// Draws with a pipeline into an attachment that is black before.
    pub fn paint(
        &self,
        canvas: &Canvas,
        pipeline: vk::Pipeline,
        record: impl FnOnce(vk::CommandBuffer),
    ) {
        self.draw(&Pass::black(canvas), |commands| {
            self.bind(commands, pipeline);
            record(commands);
        });
    }

    /// Binds a graphics pipeline.
    pub fn bind(&self, commands: vk::CommandBuffer, pipeline: vk::Pipeline) {
        // SAFETY: the command buffer is being recorded.
        unsafe {
            let point = vk::PipelineBindPoint::GRAPHICS;
            self.device.cmd_bind_pipeline(commands, point, pipeline);
        }
    }

    /// The limits of fragment shading rates; of a device without them, zeros.
    pub fn shading_rate_limits(
        &self,
    ) -> vk::PhysicalDeviceFragmentShadingRatePropertiesKHR<'static> {
        let mut limits = vk::PhysicalDeviceFragmentShadingRatePropertiesKHR::default();
        let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut limits);
        // SAFETY: the physical device is of the instance. The structure of an extension that is not
        // there is left as it is.
        unsafe { (self.instance).get_physical_device_properties2(self.physical, &mut all) };
        limits
    }

    /// Sets the pipeline's fragment shading rate and the combiner operations.
    pub fn set_shading_rate(
        &self,
        commands: vk::CommandBuffer,
        [width, height]: [u32; 2],
        combiners: [vk::FragmentShadingRateCombinerOpKHR; 2],
    ) {
        let device = khr::fragment_shading_rate::Device::new(&self.instance, &self.device);
        let size = vk::Extent2D { width, height };
        let set = device.fp().cmd_set_fragment_shading_rate_khr;
        // SAFETY: the command buffer is being recorded.
        unsafe { set(commands, &size, &combiners) };
    }

    /// Binds a buffer of vertices.
    pub fn bind_vertices(&self, commands: vk::CommandBuffer, vertices: &Buffer) {
        // SAFETY: the command buffer is being recorded; buffers live as long as the device.
        unsafe {
            (self.device).cmd_bind_vertex_buffers(commands, 0, &[vertices.handle], &[0]);
        }
    }

    /// Binds a buffer of indices.
    pub fn bind_indices(&self, commands: vk::CommandBuffer, indices: &Buffer, ty: vk::IndexType) {
        // SAFETY: the command buffer is being recorded; buffers live as long as the device.
        unsafe { (self.device).cmd_bind_index_buffer(commands, indices.handle, 0, ty) };
    }

    /// Binds set 0 of draws.
    pub fn bind_set(
        &self,
        commands: vk::CommandBuffer,
        layout: vk::PipelineLayout,
        set: vk::DescriptorSet,
    ) {
        let point = vk::PipelineBindPoint::GRAPHICS;
        // SAFETY: the command buffer is being recorded; sets live as long as the device.
        unsafe {
            (self.device).cmd_bind_descriptor_sets(commands, point, layout, 0, &[set], &[]);
        }
    }

    /// Sets push constants of all stages.
    pub fn push<T: Pod>(
        &self,
        commands: vk::CommandBuffer,
        layout: vk::PipelineLayout,
        constants: &T,
    ) {
        let (all, bytes) = (vk::ShaderStageFlags::ALL, bytemuck::bytes_of(constants));
        // SAFETY: the command buffer is being recorded.
        unsafe { (self.device).cmd_push_constants(commands, layout, all, 0, bytes) };
    }

    /// Draws vertices from 0 on, as one instance.
    pub fn draw_vertices(&self, commands: vk::CommandBuffer, count: u32) {
        // SAFETY: the command buffer is being recorded, in a pass and with a pipeline.
        unsafe { self.device.cmd_draw(commands, count, 1, 0, 0) };
    }
}
