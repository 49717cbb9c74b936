//! Draws egui's meshes: one pipeline, one texture, a scissor for each mesh.

mod glyphs;

use anyhow::Result;
use ash::vk;
use demo::vulkan::{Buffer, Context, DrawInput, DrawPipeline};
use egui::epaint::{ClippedPrimitive, Primitive, Vertex};
use egui::{TextureId, TexturesDelta};
use vk::{BufferUsageFlags as Usage, ShaderStageFlags as Stage};

use glyphs::Glyphs;

macro_rules! shader {
    ($name:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".spv"))
    };
}

/// The texture that egui keeps glyphs and white in: the only one here.
const GLYPHS: TextureId = TextureId::Managed(0);

/// One mesh, in the buffers of all.
struct Part {
    scissor: vk::Rect2D,
    first_index: u32,
    index_count: u32,
    first_vertex: i32,
}

/// The resources for drawing over a picture.
pub struct Overlay<'a> {
    context: &'a Context,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    sampler: vk::Sampler,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    pipeline: DrawPipeline<'a>,
    glyphs: Glyphs<'a>,
    vertices: Option<Buffer<'a>>,
    indices: Option<Buffer<'a>>,
    parts: Vec<Part>,
    /// Of the window, in points.
    points: [f32; 2],
}

/// The attributes of a [`Vertex`].
fn attributes() -> [vk::VertexInputAttributeDescription; 3] {
    let attribute = |location: u32, format: vk::Format, offset: usize| {
        vk::VertexInputAttributeDescription::default()
            .location(location)
            .format(format)
            .offset(offset as u32)
    };
    [
        attribute(
            0,
            vk::Format::R32G32_SFLOAT,
            std::mem::offset_of!(Vertex, pos),
        ),
        attribute(
            1,
            vk::Format::R32G32_SFLOAT,
            std::mem::offset_of!(Vertex, uv),
        ),
        attribute(
            2,
            vk::Format::R8G8B8A8_UNORM,
            std::mem::offset_of!(Vertex, color),
        ),
    ]
}

impl<'a> Overlay<'a> {
    /// For images of a format.
    pub fn new(context: &'a Context, color: vk::Format) -> Result<Overlay<'a>> {
        let device = &context.device;
        let bindings = [vk::DescriptorSetLayoutBinding::default()
            .descriptor_type(vk::DescriptorType::COMBINED_IMAGE_SAMPLER)
            .descriptor_count(1)
            .stage_flags(Stage::FRAGMENT)];
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let push = [vk::PushConstantRange::default()
            .stage_flags(Stage::VERTEX)
            .size(8)];
        let sizes = [vk::DescriptorPoolSize {
            ty: vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            descriptor_count: 1,
        }];
        let pool = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(&sizes);
        let clamp = vk::SamplerAddressMode::CLAMP_TO_EDGE;
        let sampler = vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::LINEAR)
            .min_filter(vk::Filter::LINEAR)
            .address_mode_u(clamp)
            .address_mode_v(clamp);
        // SAFETY: the structures outlive the calls, and the handles are of this device.
        let (set_layout, layout, sampler, pool, set) = unsafe {
            let set_layout = device.create_descriptor_set_layout(&info, None)?;
            let set_layouts = [set_layout];
            let info = vk::PipelineLayoutCreateInfo::default()
                .set_layouts(&set_layouts)
                .push_constant_ranges(&push);
            let layout = device.create_pipeline_layout(&info, None)?;
            let sampler = device.create_sampler(&sampler, None)?;
            let pool = device.create_descriptor_pool(&pool, None)?;
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(pool)
                .set_layouts(&set_layouts);
            let set = device.allocate_descriptor_sets(&info)?[0];
            (set_layout, layout, sampler, pool, set)
        };
        let strides = [vk::VertexInputBindingDescription::default()
            .stride(size_of::<Vertex>() as u32)
            .input_rate(vk::VertexInputRate::VERTEX)];
        let attributes = attributes();
        let input = DrawInput {
            vertex: shader!("panel.vert"),
            fragment: shader!("panel.frag"),
            has_holes: false,
            color,
            depth: None,
            vertex_input: vk::PipelineVertexInputStateCreateInfo::default()
                .vertex_binding_descriptions(&strides)
                .vertex_attribute_descriptions(&attributes),
            blends: true,
            layout,
        };
        Ok(Overlay {
            context,
            set_layout,
            layout,
            sampler,
            pool,
            set,
            pipeline: DrawPipeline::new(context, &input)?,
            glyphs: Glyphs::new(context),
            vertices: None,
            indices: None,
            parts: Vec::new(),
            points: [1.0; 2],
        })
    }

    /// Takes over the shapes of egui to draw, for an image of a size in pixels; no frame may be in
    /// flight.
    pub fn prepare(
        &mut self,
        textures: &TexturesDelta,
        primitives: &[ClippedPrimitive],
        (width, height): (u32, u32),
        pixels_per_point: f32,
    ) -> Result<()> {
        let mut changed = false;
        for (id, delta) in &textures.set {
            if *id == GLYPHS {
                self.glyphs.change(delta);
                changed = true;
            }
        }
        if changed {
            self.glyphs.upload(self.sampler, self.set)?;
        }
        self.points = [
            width as f32 / pixels_per_point,
            height as f32 / pixels_per_point,
        ];
        self.parts.clear();
        let (mut vertices, mut indices) = (Vec::<Vertex>::new(), Vec::<u32>::new());
        for ClippedPrimitive {
            clip_rect,
            primitive,
        } in primitives
        {
            let Primitive::Mesh(mesh) = primitive else {
                continue;
            };
            let inside = |point: f32, most: u32| {
                (point * pixels_per_point).round().clamp(0.0, most as f32) as u32
            };
            let (left, right) = (
                inside(clip_rect.min.x, width),
                inside(clip_rect.max.x, width),
            );
            let (top, bottom) = (
                inside(clip_rect.min.y, height),
                inside(clip_rect.max.y, height),
            );
            if left >= right || top >= bottom || mesh.texture_id != GLYPHS {
                continue;
            }
            self.parts.push(Part {
                scissor: vk::Rect2D {
                    offset: vk::Offset2D {
                        x: left as i32,
                        y: top as i32,
                    },
                    extent: vk::Extent2D {
                        width: right - left,
                        height: bottom - top,
                    },
                },
                first_index: indices.len() as u32,
                index_count: mesh.indices.len() as u32,
                first_vertex: vertices.len() as i32,
            });
            vertices.extend_from_slice(&mesh.vertices);
            indices.extend_from_slice(&mesh.indices);
        }
        let context = self.context;
        fill(context, &mut self.vertices, &vertices, Usage::VERTEX_BUFFER)?;
        fill(context, &mut self.indices, &indices, Usage::INDEX_BUFFER)
    }

    /// Draws inside a pass with a viewport; changes the scissor.
    pub fn record(&self, commands: vk::CommandBuffer) {
        let (Some(vertices), Some(indices)) = (&self.vertices, &self.indices) else {
            return;
        };
        if !self.glyphs.is_there() {
            return;
        }
        let (device, layout) = (&self.context.device, self.layout);
        let (point, sets) = (vk::PipelineBindPoint::GRAPHICS, [self.set]);
        // SAFETY: the command buffer is recording, and what is bound outlives its execution.
        unsafe {
            device.cmd_bind_pipeline(commands, point, self.pipeline.handle);
            device.cmd_bind_descriptor_sets(commands, point, layout, 0, &sets, &[]);
            let bytes = bytemuck::bytes_of(&self.points);
            device.cmd_push_constants(commands, layout, Stage::VERTEX, 0, bytes);
            device.cmd_bind_vertex_buffers(commands, 0, &[vertices.handle], &[0]);
            let of_words = vk::IndexType::UINT32;
            device.cmd_bind_index_buffer(commands, indices.handle, 0, of_words);
            for part in &self.parts {
                device.cmd_set_scissor(commands, 0, &[part.scissor]);
                device.cmd_draw_indexed(
                    commands,
                    part.index_count,
                    1,
                    part.first_index,
                    part.first_vertex,
                    0,
                );
            }
        }
    }
}

/// Writes items to a buffer, a larger one if they do not fit.
fn fill<'a, T: bytemuck::Pod>(
    context: &'a Context,
    buffer: &mut Option<Buffer<'a>>,
    items: &[T],
    usage: Usage,
) -> Result<()> {
    let bytes: &[u8] = bytemuck::cast_slice(items);
    match buffer {
        Some(buffer) if buffer.size_bytes() >= bytes.len() as u64 => buffer.write(0, bytes)?,
        _ => {
            let size = bytes.len().next_power_of_two() as u64;
            let mut larger = Buffer::new(context, size, usage)?;
            larger.write(0, bytes)?;
            *buffer = Some(larger);
        }
    }
    Ok(())
}

impl Drop for Overlay<'_> {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: nothing is in flight once the device is idle.
        unsafe {
            let _ = device.device_wait_idle();
            device.destroy_sampler(self.sampler, None);
            device.destroy_descriptor_pool(self.pool, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}
