//! The scene, rasterized: one pass finds the object at each pixel's centre, a second one shades
//! that, with ray queries for shadows, mirrors and glass.

#[cfg(test)]
mod tests;

use anyhow::{Context as _, Result};
use ash::vk;
use bytemuck::{Pod, Zeroable};
use vk::{
    BufferUsageFlags as Usage, DescriptorType, ImageLayout as Layout, ImageUsageFlags as Image,
    ShaderStageFlags as Stage,
};

use crate::render::{DeviceScene, Renderer};
use crate::scene::{Model, NONE, Scene};
use crate::structures::{hit_group, rows};
use crate::vulkan::{Buffer, Context, DrawInput, DrawPipeline, Target, change_layout, viewport};

macro_rules! shader {
    ($name:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".spv"))
    };
}

/// The vertex shader of a triangle that covers the picture.
pub const COVERING_TRIANGLE: &[u8] = shader!("whole.vert");

const SEEN: vk::Format = vk::Format::R32G32B32A32_UINT;
const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
const COLOR: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// `RasterInstance` in raster.glsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RasterInstance {
    rows: [[f32; 4]; 3],
    hit_group: u32,
    unused: [u32; 3],
}

/// Which pipeline draws it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum PipelineKind {
    Opaque,
    HasHoles,
    Procedural,
}

/// One draw: all instances of one geometry or procedural primitive.
#[derive(Clone, Copy, Debug)]
struct Draw {
    kind: PipelineKind,
    /// `model` in raster.glsl.
    model: u32,
    vertex_count: u32,
    first_instance: u32,
    instance_count: u32,
}

/// Vertices of a procedural primitive's box.
const BOX_VERTICES: u32 = 36;

/// A scene ready to be rasterized.
pub struct Rasterizer<'a> {
    context: &'a Context,
    draws: Vec<Draw>,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    sampler: vk::Sampler,
    /// By [`PipelineKind`].
    pipelines: [DrawPipeline<'a>; 3],
    shading: DrawPipeline<'a>,
    /// The instances, and their numbers in the order of the draws.
    buffers: [Buffer<'a>; 2],
}

/// Pictures that a scene is drawn into.
pub struct Drawing<'r, 'a> {
    rasterizer: &'r Rasterizer<'a>,
    /// The renderer's.
    scene_set: vk::DescriptorSet,
    size: (u32, u32),
    seen: Target<'a>,
    depth: Target<'a>,
    /// Linear radiance, and 1; in the layout for reading by shaders once something is drawn.
    pub color: Target<'a>,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
}

/// The second set's bindings.
const KINDS: [(DescriptorType, Stage); 3] = [
    (
        DescriptorType::STORAGE_BUFFER,
        Stage::from_raw(Stage::VERTEX.as_raw() | Stage::FRAGMENT.as_raw()),
    ),
    (DescriptorType::STORAGE_BUFFER, Stage::VERTEX),
    (DescriptorType::COMBINED_IMAGE_SAMPLER, Stage::FRAGMENT),
];

impl<'a> Rasterizer<'a> {
    pub fn new(world: &DeviceScene<'a>, scene: &Scene) -> Result<Rasterizer<'a>> {
        let context = world.context;
        let instances = scene.instances.iter().map(|instance| RasterInstance {
            rows: rows(instance),
            hit_group: hit_group(scene, instance),
            unused: [0; 3],
        });
        let instances: Vec<RasterInstance> = instances.collect();
        let (draws, drawn) = draw_list(scene);
        let buffers = [
            Buffer::with(context, &instances, Usage::STORAGE_BUFFER)?,
            Buffer::with(context, &drawn, Usage::STORAGE_BUFFER)?,
        ];
        let device = &context.device;
        let bindings = [0, 1, 2].map(|binding| {
            let (kind, stages) = KINDS[binding];
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding as u32)
                .descriptor_type(kind)
                .descriptor_count(1)
                .stage_flags(stages)
        });
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let push = [vk::PushConstantRange::default()
            .stage_flags(Stage::VERTEX | Stage::FRAGMENT)
            .size(4)];
        // SAFETY: the structures outlive the calls, and the handles are of this device.
        let (set_layout, layout, sampler) = unsafe {
            let set_layout = device.create_descriptor_set_layout(&info, None)?;
            let set_layouts = [world.set_layout, set_layout];
            let info = vk::PipelineLayoutCreateInfo::default()
                .set_layouts(&set_layouts)
                .push_constant_ranges(&push);
            let layout = device.create_pipeline_layout(&info, None)?;
            let sampler = device.create_sampler(&vk::SamplerCreateInfo::default(), None)?;
            (set_layout, layout, sampler)
        };
        let whole = DrawInput {
            vertex: COVERING_TRIANGLE,
            fragment: shader!("shade.frag"),
            has_holes: false,
            color: COLOR,
            depth: None,
            vertex_input: vk::PipelineVertexInputStateCreateInfo::default(),
            blends: false,
            layout,
        };
        let shading = DrawPipeline::new(context, &whole)?;
        let triangles = DrawInput {
            vertex: shader!("triangles.vert"),
            fragment: shader!("triangles.frag"),
            color: SEEN,
            depth: Some(DEPTH),
            ..whole
        };
        let holes = DrawInput {
            has_holes: true,
            ..triangles
        };
        let procedurals = DrawInput {
            vertex: shader!("procedurals.vert"),
            fragment: shader!("procedurals.frag"),
            ..triangles
        };
        Ok(Rasterizer {
            context,
            draws,
            set_layout,
            layout,
            sampler,
            pipelines: [
                DrawPipeline::new(context, &triangles)?,
                DrawPipeline::new(context, &holes)?,
                DrawPipeline::new(context, &procedurals)?,
            ],
            shading,
            buffers,
        })
    }
}

impl<'r, 'a> Drawing<'r, 'a> {
    /// Pictures of the renderer's size, with its camera.
    pub fn new(rasterizer: &'r Rasterizer<'a>, renderer: &Renderer) -> Result<Drawing<'r, 'a>> {
        let context = rasterizer.context;
        let size = (renderer.settings.width, renderer.settings.height);
        let attached = Image::COLOR_ATTACHMENT;
        let usage = attached | Image::SAMPLED | Image::TRANSFER_SRC;
        let seen = Target::new(context, SEEN, size, usage)?;
        let depth = Target::new(context, DEPTH, size, Image::DEPTH_STENCIL_ATTACHMENT)?;
        let color = Target::new(context, COLOR, size, usage)?;
        let sizes = KINDS.map(|(kind, _)| vk::DescriptorPoolSize {
            ty: kind,
            descriptor_count: 1,
        });
        let pool = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(&sizes);
        let device = &context.device;
        let set_layouts = [rasterizer.set_layout];
        // SAFETY: the structures outlive the calls, and the handles are of this device.
        let (pool, set) = unsafe {
            let pool = device.create_descriptor_pool(&pool, None)?;
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(pool)
                .set_layouts(&set_layouts);
            (pool, device.allocate_descriptor_sets(&info)?[0])
        };
        let ranges = [0, 1].map(|i: usize| {
            [vk::DescriptorBufferInfo::default()
                .buffer(rasterizer.buffers[i].handle)
                .range(vk::WHOLE_SIZE)]
        });
        let images = [vk::DescriptorImageInfo::default()
            .sampler(rasterizer.sampler)
            .image_view(seen.view)
            .image_layout(Layout::SHADER_READ_ONLY_OPTIMAL)];
        let write = |binding: u32| {
            vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(binding)
                .descriptor_type(KINDS[binding as usize].0)
        };
        let writes = [
            write(0).buffer_info(&ranges[0]),
            write(1).buffer_info(&ranges[1]),
            write(2).image_info(&images),
        ];
        // SAFETY: every handle is of this device, and the set is not in use.
        unsafe { device.update_descriptor_sets(&writes, &[]) };
        Ok(Drawing {
            rasterizer,
            scene_set: renderer.set,
            size,
            seen,
            depth,
            color,
            pool,
            set,
        })
    }

    /// Draws what lies in `area`.
    pub fn record(&self, commands: vk::CommandBuffer, area: vk::Rect2D) {
        self.record_seen(commands, area);
        self.record_shading(commands, area, true);
    }

    fn change(&self, commands: vk::CommandBuffer, target: &Target, from: Layout, to: Layout) {
        let image = (target.image, target.aspect);
        change_layout(self.rasterizer.context, commands, image, from, to);
    }

    /// Finds the object at each pixel's centre in `area`, and nowhere else.
    pub fn record_seen(&self, commands: vk::CommandBuffer, area: vk::Rect2D) {
        let attached = Layout::COLOR_ATTACHMENT_OPTIMAL;
        self.change(commands, &self.seen, Layout::UNDEFINED, attached);
        let of_depth = Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
        self.change(commands, &self.depth, Layout::UNDEFINED, of_depth);
        let Rasterizer {
            context,
            draws,
            pipelines,
            layout,
            ..
        } = self.rasterizer;
        let device = &context.device;
        let depth = self.depth.attachment(vk::ClearValue::default());
        let stages = Stage::VERTEX | Stage::FRAGMENT;
        self.pass(commands, area, &self.seen, Some(depth), || {
            let mut bound = None;
            for draw in draws {
                let pipeline = pipelines[draw.kind as usize].handle;
                // SAFETY: the command buffer is recording, and what it uses outlives its execution.
                unsafe {
                    if bound.replace(draw.kind) != Some(draw.kind) {
                        let point = vk::PipelineBindPoint::GRAPHICS;
                        device.cmd_bind_pipeline(commands, point, pipeline);
                    }
                    let model = draw.model.to_ne_bytes();
                    device.cmd_push_constants(commands, *layout, stages, 0, &model);
                    let (count, first) = (draw.instance_count, draw.first_instance);
                    device.cmd_draw(commands, draw.vertex_count, count, 0, first);
                }
            }
        });
        let read = Layout::SHADER_READ_ONLY_OPTIMAL;
        self.change(commands, &self.seen, attached, read);
    }

    /// Shades `area`, whose objects are known; pixels outside stay unless this `is_first`.
    pub fn record_shading(&self, commands: vk::CommandBuffer, area: vk::Rect2D, is_first: bool) {
        let attached = Layout::COLOR_ATTACHMENT_OPTIMAL;
        let read = Layout::SHADER_READ_ONLY_OPTIMAL;
        let before = if is_first { Layout::UNDEFINED } else { read };
        self.change(commands, &self.color, before, attached);
        self.pass(commands, area, &self.color, None, || {
            let device = &self.rasterizer.context.device;
            // SAFETY: the command buffer is being recorded, in a pass.
            unsafe {
                let point = vk::PipelineBindPoint::GRAPHICS;
                device.cmd_bind_pipeline(commands, point, self.rasterizer.shading.handle);
                device.cmd_draw(commands, 3, 1, 0, 0);
            }
        });
        self.change(commands, &self.color, attached, read);
    }

    /// A pass over `area` that clears its attachments.
    fn pass(
        &self,
        commands: vk::CommandBuffer,
        area: vk::Rect2D,
        color: &Target,
        depth: Option<vk::RenderingAttachmentInfo>,
        draw: impl FnOnce(),
    ) {
        let colors = [color.attachment(vk::ClearValue::default())];
        let mut rendering = vk::RenderingInfo::default()
            .render_area(area)
            .layer_count(1)
            .color_attachments(&colors);
        if let Some(depth) = &depth {
            rendering = rendering.depth_attachment(depth);
        }
        let device = &self.rasterizer.context.device;
        let point = vk::PipelineBindPoint::GRAPHICS;
        let (layout, sets) = (self.rasterizer.layout, [self.scene_set, self.set]);
        // SAFETY: the command buffer is recording, and the targets outlive its execution.
        unsafe {
            device.cmd_begin_rendering(commands, &rendering);
            device.cmd_set_viewport(commands, 0, &[viewport(self.size)]);
            device.cmd_set_scissor(commands, 0, &[area]);
            device.cmd_bind_descriptor_sets(commands, point, layout, 0, &sets, &[]);
            draw();
            device.cmd_end_rendering(commands);
        }
    }

    /// Draws `area` and reads its pixels, row by row.
    pub fn radiance(&self, area: vk::Rect2D) -> Result<Vec<[f32; 4]>> {
        self.run(area, &self.color)
    }

    /// Draws `area` and reads the object at each pixel's centre, row by row.
    #[cfg(test)]
    fn seen(&self, area: vk::Rect2D) -> Result<Vec<[u32; 4]>> {
        self.run(area, &self.seen)
    }

    fn run<T: Pod>(&self, area: vk::Rect2D, from: &Target) -> Result<Vec<T>> {
        let pixels = area.extent.width as usize * area.extent.height as usize;
        let bytes = (pixels * size_of::<T>()) as u64;
        let context = self.rasterizer.context;
        let buffer = Buffer::new(context, bytes, Usage::TRANSFER_DST)?;
        let source = Layout::TRANSFER_SRC_OPTIMAL;
        context
            .run(|commands| {
                self.record(commands, area);
                self.change(commands, from, Layout::SHADER_READ_ONLY_OPTIMAL, source);
                let layers = vk::ImageSubresourceLayers::default()
                    .aspect_mask(from.aspect)
                    .layer_count(1);
                let (x, y) = (area.offset.x, area.offset.y);
                let copy = vk::BufferImageCopy::default()
                    .image_subresource(layers)
                    .image_offset(vk::Offset3D { x, y, z: 0 })
                    .image_extent(area.extent.into());
                // SAFETY: the buffer holds the area, and is read only after the wait.
                unsafe {
                    context.device.cmd_copy_image_to_buffer(
                        commands,
                        from.image,
                        source,
                        buffer.handle,
                        &[copy],
                    );
                }
            })
            .context("rasterizing")?;
        buffer.read(pixels)
    }
}

impl Drop for Rasterizer<'_> {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: nothing is in flight once the device is idle.
        unsafe {
            let _ = device.device_wait_idle();
            device.destroy_sampler(self.sampler, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

impl Drop for Drawing<'_, '_> {
    fn drop(&mut self) {
        let device = &self.rasterizer.context.device;
        // SAFETY: nothing is in flight once the device is idle.
        unsafe {
            let _ = device.device_wait_idle();
            device.destroy_descriptor_pool(self.pool, None);
        }
    }
}

/// The draws, those without holes first, since they hide what is shaded at a greater cost; and the
/// instances in their order.
fn draw_list(scene: &Scene) -> (Vec<Draw>, Vec<u32>) {
    let mut by_model: Vec<Vec<u32>> = Vec::new();
    by_model.resize_with(scene.meshes.len() + scene.procedurals.len(), Vec::new);
    for (number, instance) in scene.instances.iter().enumerate() {
        let model = match instance.model {
            Model::Mesh(mesh) => mesh as usize,
            Model::Procedural(procedural) => scene.meshes.len() + procedural as usize,
        };
        by_model[model].push(number as u32);
    }
    let (mut draws, mut drawn) = (Vec::new(), Vec::new());
    for (model, instances) in by_model.iter().enumerate() {
        let draw = |kind, model, vertex_count| Draw {
            kind,
            model,
            vertex_count,
            first_instance: drawn.len() as u32,
            instance_count: instances.len() as u32,
        };
        match scene.meshes.get(model) {
            Some(mesh) => draws.extend((0..mesh.geometry_count).map(|i| {
                let number = mesh.first_geometry + i;
                let geometry = &scene.geometries[number as usize];
                let material = &scene.materials[geometry.material as usize];
                let kind = match material.alpha_cutoff > 0.0 && material.base_texture != NONE {
                    true => PipelineKind::HasHoles,
                    false => PipelineKind::Opaque,
                };
                draw(kind, number, geometry.index_count / 3 * 3)
            })),
            None => {
                let number = (model - scene.meshes.len()) as u32;
                draws.push(draw(PipelineKind::Procedural, number, BOX_VERTICES));
            }
        }
        drawn.extend(instances);
    }
    draws.retain(|draw| draw.instance_count > 0);
    draws.sort_by_key(|draw| draw.kind);
    (draws, drawn)
}
