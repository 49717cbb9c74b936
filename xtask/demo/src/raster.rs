//! The scene, rasterized: one pass finds who is seen at each pixel's centre, a second one shades that, with ray queries for
//! shadows, mirrors and glass.

#[cfg(test)]
mod tests;

use anyhow::{Context as _, Result};
use ash::vk;
use bytemuck::{Pod, Zeroable};
use vk::{
    BufferUsageFlags as Usage, DescriptorType, ImageLayout as Layout, ImageUsageFlags as Image,
    ShaderStageFlags as Stage,
};

use crate::render::{Renderer, hit_group, rows};
use crate::scene::{Model, NONE, Scene};
use crate::vulkan::{Buffer, Context, DrawInput, DrawPipeline, Target, change_layout, viewport};

macro_rules! shader {
    ($name:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".spv"))
    };
}

const SEEN: vk::Format = vk::Format::R32G32B32A32_UINT;
const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
const COLOR: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// `Instance` in raster.glsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Instance {
    rows: [[f32; 4]; 3],
    hit_group: u32,
    unused: [u32; 3],
}

/// Which pipeline draws it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Opaque,
    HasHoles,
    Procedural,
}

/// One draw: all instances of one geometry or procedural primitive.
#[derive(Clone, Copy, Debug)]
struct Draw {
    kind: Kind,
    /// `model` in raster.glsl.
    model: u32,
    vertex_count: u32,
    first_instance: u32,
    instance_count: u32,
}

/// Vertices of a procedural primitive's box.
const BOX_VERTICES: u32 = 36;

/// A scene ready to be rasterized, and the pictures that it is drawn into.
pub struct Rasterizer<'a> {
    context: &'a Context,
    /// The scene's own set.
    scene_set: vk::DescriptorSet,
    size: (u32, u32),
    draws: Vec<Draw>,
    seen: Target<'a>,
    depth: Target<'a>,
    /// Linear radiance, and 1.
    pub color: Target<'a>,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    sampler: vk::Sampler,
    /// By [`Kind`].
    pipelines: [DrawPipeline<'a>; 3],
    shading: DrawPipeline<'a>,
    _buffers: [Buffer<'a>; 2],
}

impl<'a> Rasterizer<'a> {
    /// For pictures of the renderer's size, of the scene that it has, with its camera.
    pub fn new(
        context: &'a Context,
        renderer: &Renderer<'a>,
        scene_layout: vk::DescriptorSetLayout,
        scene: &Scene,
    ) -> Result<Rasterizer<'a>> {
        let size = (renderer.settings.width, renderer.settings.height);
        let instances = scene.instances.iter().map(|instance| Instance {
            rows: rows(instance),
            hit_group: hit_group(scene, instance),
            unused: [0; 3],
        });
        let instances: Vec<Instance> = instances.collect();
        let (draws, drawn) = draw_list(scene);
        let buffers = [
            Buffer::with(context, &instances, Usage::STORAGE_BUFFER)?,
            Buffer::with(context, &drawn, Usage::STORAGE_BUFFER)?,
        ];
        let attached = Image::COLOR_ATTACHMENT;
        let seen_usage = attached | Image::SAMPLED | Image::TRANSFER_SRC;
        let seen = Target::new(context, SEEN, size, seen_usage)?;
        let depth = Target::new(context, DEPTH, size, Image::DEPTH_STENCIL_ATTACHMENT)?;
        let color_usage = attached | Image::SAMPLED | Image::TRANSFER_SRC;
        let color = Target::new(context, COLOR, size, color_usage)?;

        let device = &context.device;
        let kinds = [
            (
                DescriptorType::STORAGE_BUFFER,
                Stage::VERTEX | Stage::FRAGMENT,
            ),
            (DescriptorType::STORAGE_BUFFER, Stage::VERTEX),
            (DescriptorType::COMBINED_IMAGE_SAMPLER, Stage::FRAGMENT),
        ];
        let bindings = [0, 1, 2].map(|binding| {
            let (kind, stages) = kinds[binding];
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding as u32)
                .descriptor_type(kind)
                .descriptor_count(1)
                .stage_flags(stages)
        });
        let sizes = kinds.map(|(kind, _)| vk::DescriptorPoolSize {
            ty: kind,
            descriptor_count: 1,
        });
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let push = [vk::PushConstantRange::default()
            .stage_flags(Stage::VERTEX | Stage::FRAGMENT)
            .size(4)];
        let pool = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(&sizes);
        // SAFETY: the structures outlive the calls, and the handles are of this device.
        let (set_layout, layout, pool, set, sampler) = unsafe {
            let set_layout = device.create_descriptor_set_layout(&info, None)?;
            let set_layouts = [scene_layout, set_layout];
            let info = vk::PipelineLayoutCreateInfo::default()
                .set_layouts(&set_layouts)
                .push_constant_ranges(&push);
            let layout = device.create_pipeline_layout(&info, None)?;
            let pool = device.create_descriptor_pool(&pool, None)?;
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(pool)
                .set_layouts(&set_layouts[1..]);
            let set = device.allocate_descriptor_sets(&info)?[0];
            let sampler = device.create_sampler(&vk::SamplerCreateInfo::default(), None)?;
            (set_layout, layout, pool, set, sampler)
        };
        let ranges = [0, 1].map(|i: usize| {
            [vk::DescriptorBufferInfo::default()
                .buffer(buffers[i].handle)
                .range(vk::WHOLE_SIZE)]
        });
        let images = [vk::DescriptorImageInfo::default()
            .sampler(sampler)
            .image_view(seen.view)
            .image_layout(Layout::SHADER_READ_ONLY_OPTIMAL)];
        let write = |binding: u32| {
            vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(binding)
                .descriptor_type(kinds[binding as usize].0)
        };
        let writes = [
            write(0).buffer_info(&ranges[0]),
            write(1).buffer_info(&ranges[1]),
            write(2).image_info(&images),
        ];
        // SAFETY: every handle is of this device, and the set is not in use.
        unsafe { device.update_descriptor_sets(&writes, &[]) };

        let whole = DrawInput {
            vertex: shader!("whole.vert"),
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
            scene_set: renderer.set,
            size,
            draws,
            seen,
            depth,
            color,
            set_layout,
            layout,
            pool,
            set,
            sampler,
            pipelines: [
                DrawPipeline::new(context, &triangles)?,
                DrawPipeline::new(context, &holes)?,
                DrawPipeline::new(context, &procedurals)?,
            ],
            shading,
            _buffers: buffers,
        })
    }

    /// Draws what lies in `area`; who is seen and the colors can be copied from then on.
    pub fn record(&self, commands: vk::CommandBuffer, area: vk::Rect2D) {
        let change = |target: &Target, from, to| {
            change_layout(
                self.context,
                commands,
                (target.image, target.aspect),
                from,
                to,
            );
        };
        let attached = Layout::COLOR_ATTACHMENT_OPTIMAL;
        change(&self.seen, Layout::UNDEFINED, attached);
        change(
            &self.depth,
            Layout::UNDEFINED,
            Layout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
        );
        change(&self.color, Layout::UNDEFINED, attached);
        let device = &self.context.device;
        let nothing = vk::ClearValue::default();
        let depth = self.depth.attachment(nothing);
        let stages = Stage::VERTEX | Stage::FRAGMENT;
        self.pass(commands, area, &self.seen, Some(depth), || {
            let mut bound = None;
            for draw in &self.draws {
                let pipeline = self.pipelines[draw.kind as usize].handle;
                // SAFETY: the command buffer is recording, and what it uses outlives its execution.
                unsafe {
                    if bound.replace(draw.kind) != Some(draw.kind) {
                        let point = vk::PipelineBindPoint::GRAPHICS;
                        device.cmd_bind_pipeline(commands, point, pipeline);
                    }
                    let model = draw.model.to_ne_bytes();
                    device.cmd_push_constants(commands, self.layout, stages, 0, &model);
                    let (count, first) = (draw.instance_count, draw.first_instance);
                    device.cmd_draw(commands, draw.vertex_count, count, 0, first);
                }
            }
        });
        change(&self.seen, attached, Layout::SHADER_READ_ONLY_OPTIMAL);
        self.pass(commands, area, &self.color, None, || {
            // SAFETY: as above.
            unsafe {
                let point = vk::PipelineBindPoint::GRAPHICS;
                device.cmd_bind_pipeline(commands, point, self.shading.handle);
                device.cmd_draw(commands, 3, 1, 0, 0);
            }
        });
        change(&self.color, attached, Layout::TRANSFER_SRC_OPTIMAL);
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
        let device = &self.context.device;
        let point = vk::PipelineBindPoint::GRAPHICS;
        let sets = [self.scene_set, self.set];
        // SAFETY: the command buffer is recording, and the targets outlive its execution.
        unsafe {
            device.cmd_begin_rendering(commands, &rendering);
            device.cmd_set_viewport(commands, 0, &[viewport(self.size)]);
            device.cmd_set_scissor(commands, 0, &[area]);
            device.cmd_bind_descriptor_sets(commands, point, self.layout, 0, &sets, &[]);
            draw();
            device.cmd_end_rendering(commands);
        }
    }

    /// Draws `area` and reads its pixels, row by row.
    pub fn radiance(&self, area: vk::Rect2D) -> Result<Vec<[f32; 4]>> {
        self.run(area, &self.color, Layout::TRANSFER_SRC_OPTIMAL)
    }

    /// Draws `area` and reads who is seen at each pixel's centre, row by row.
    #[cfg(test)]
    fn seen(&self, area: vk::Rect2D) -> Result<Vec<[u32; 4]>> {
        self.run(area, &self.seen, Layout::SHADER_READ_ONLY_OPTIMAL)
    }

    fn run<T: Pod>(&self, area: vk::Rect2D, from: &Target, layout: Layout) -> Result<Vec<T>> {
        let pixels = area.extent.width as usize * area.extent.height as usize;
        let bytes = (pixels * size_of::<T>()) as u64;
        let buffer = Buffer::new(self.context, bytes, Usage::TRANSFER_DST)?;
        let source = Layout::TRANSFER_SRC_OPTIMAL;
        self.context
            .run(|commands| {
                self.record(commands, area);
                if layout != source {
                    let image = (from.image, from.aspect);
                    change_layout(self.context, commands, image, layout, source);
                }
                let layers = vk::ImageSubresourceLayers::default()
                    .aspect_mask(from.aspect)
                    .layer_count(1);
                let (x, y) = (area.offset.x, area.offset.y);
                let copy = vk::BufferImageCopy::default()
                    .image_subresource(layers)
                    .image_offset(vk::Offset3D { x, y, z: 0 })
                    .image_extent(area.extent.into());
                let device = &self.context.device;
                // SAFETY: the buffer holds the area, and is read only after the wait.
                unsafe {
                    device.cmd_copy_image_to_buffer(
                        commands,
                        from.image,
                        source,
                        buffer.handle,
                        &[copy],
                    );
                }
            })
            .context("rasterizing")?;
        Ok(buffer.read(pixels))
    }
}

impl Drop for Rasterizer<'_> {
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

/// The draws, those without holes first, since they hide what is shaded at a greater cost; and the instances in their order.
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
                    true => Kind::HasHoles,
                    false => Kind::Opaque,
                };
                draw(kind, number, geometry.index_count / 3 * 3)
            })),
            None => {
                let number = (model - scene.meshes.len()) as u32;
                draws.push(draw(Kind::Procedural, number, BOX_VERTICES));
            }
        }
        drawn.extend(instances);
    }
    draws.retain(|draw| draw.instance_count > 0);
    draws.sort_by_key(|draw| draw.kind);
    (draws, drawn)
}
