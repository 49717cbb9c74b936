//! Shows the picture so far: one triangle that covers the window.

use anyhow::Result;
use ash::vk;
use bytemuck::{Pod, Zeroable};
use demo::raster::COVERING_TRIANGLE;
use demo::vulkan::{Context, DrawInput, DrawPipeline};
use vk::{DescriptorType, ShaderStageFlags as Stage};

use crate::progress::Progress;

const SHOW: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/show.frag.spv"));

/// `Show` in show.frag.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ShowConstants {
    size: [u32; 2],
    small_size: [u32; 2],
    split: u32,
    drawn_rows: u32,
    traced_rows: u32,
    exposure: f32,
}

/// The pipeline, and the set that says what picture it shows.
pub struct Show<'a> {
    context: &'a Context,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    sampler: vk::Sampler,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    pipeline: DrawPipeline<'a>,
}

/// By binding.
const KINDS: [DescriptorType; 4] = [
    DescriptorType::STORAGE_BUFFER,
    DescriptorType::STORAGE_BUFFER,
    DescriptorType::COMBINED_IMAGE_SAMPLER,
    DescriptorType::COMBINED_IMAGE_SAMPLER,
];

impl<'a> Show<'a> {
    /// For images of a format.
    pub fn new(context: &'a Context, color: vk::Format) -> Result<Show<'a>> {
        let device = &context.device;
        let bindings = [0, 1, 2, 3].map(|binding| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding)
                .descriptor_type(KINDS[binding as usize])
                .descriptor_count(1)
                .stage_flags(Stage::FRAGMENT)
        });
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let push = [vk::PushConstantRange::default()
            .stage_flags(Stage::FRAGMENT)
            .size(size_of::<ShowConstants>() as u32)];
        let sizes = [KINDS[0], KINDS[2]].map(|ty| vk::DescriptorPoolSize {
            ty,
            descriptor_count: 2,
        });
        let pool = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(&sizes);
        // SAFETY: the structures outlive the calls, and the handles are of this device.
        let (set_layout, layout, sampler, pool, set) = unsafe {
            let set_layout = device.create_descriptor_set_layout(&info, None)?;
            let set_layouts = [set_layout];
            let info = vk::PipelineLayoutCreateInfo::default()
                .set_layouts(&set_layouts)
                .push_constant_ranges(&push);
            let layout = device.create_pipeline_layout(&info, None)?;
            let sampler = device.create_sampler(&vk::SamplerCreateInfo::default(), None)?;
            let pool = device.create_descriptor_pool(&pool, None)?;
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(pool)
                .set_layouts(&set_layouts);
            let set = device.allocate_descriptor_sets(&info)?[0];
            (set_layout, layout, sampler, pool, set)
        };
        let input = DrawInput {
            vertex: COVERING_TRIANGLE,
            fragment: SHOW,
            has_holes: false,
            color,
            depth: None,
            vertex_input: vk::PipelineVertexInputStateCreateInfo::default(),
            blends: false,
            layout,
        };
        Ok(Show {
            context,
            set_layout,
            layout,
            sampler,
            pool,
            set,
            pipeline: DrawPipeline::new(context, &input)?,
        })
    }

    /// Shows this picture from now on; nothing may be in flight.
    pub fn turn_to(&self, progress: &Progress) {
        let buffers = progress.traced().map(|buffer| {
            [vk::DescriptorBufferInfo::default()
                .buffer(buffer)
                .range(vk::WHOLE_SIZE)]
        });
        let images = progress.drawn().map(|view| {
            [vk::DescriptorImageInfo::default()
                .sampler(self.sampler)
                .image_view(view)
                .image_layout(vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL)]
        });
        let write = |binding: u32| {
            vk::WriteDescriptorSet::default()
                .dst_set(self.set)
                .dst_binding(binding)
                .descriptor_type(KINDS[binding as usize])
        };
        let writes = [
            write(0).buffer_info(&buffers[0]),
            write(1).buffer_info(&buffers[1]),
            write(2).image_info(&images[0]),
            write(3).image_info(&images[1]),
        ];
        // SAFETY: every handle is of this device, and the set is not in use.
        unsafe { self.context.device.update_descriptor_sets(&writes, &[]) };
    }

    /// Draws inside a pass with viewport and scissor.
    pub fn record(&self, commands: vk::CommandBuffer, progress: &Progress, exposure: f32) {
        let push = ShowConstants {
            size: progress.size.into(),
            small_size: progress.small_size.into(),
            split: progress.sight.split,
            drawn_rows: progress.drawn_rows,
            traced_rows: progress.traced_rows(),
            exposure,
        };
        let (device, layout) = (&self.context.device, self.layout);
        let (point, sets) = (vk::PipelineBindPoint::GRAPHICS, [self.set]);
        // SAFETY: the command buffer is recording, and what is bound outlives its execution.
        unsafe {
            device.cmd_bind_pipeline(commands, point, self.pipeline.handle);
            device.cmd_bind_descriptor_sets(commands, point, layout, 0, &sets, &[]);
            let bytes = bytemuck::bytes_of(&push);
            device.cmd_push_constants(commands, layout, Stage::FRAGMENT, 0, bytes);
            device.cmd_draw(commands, 3, 1, 0, 0);
        }
    }
}

impl Drop for Show<'_> {
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
