//! The texture that egui keeps glyphs and white in.

use anyhow::Result;
use ash::vk;
use demo::vulkan::{Buffer, Context, Target, change_layout};
use egui::Color32;
use egui::epaint::{ImageData, ImageDelta};
use vk::{BufferUsageFlags as Usage, ImageLayout as Layout};

pub struct Glyphs<'a> {
    context: &'a Context,
    /// The pixels and how many there are across and down, as egui last sent them.
    pixels: Vec<Color32>,
    size: [usize; 2],
    texture: Option<Target<'a>>,
}

impl<'a> Glyphs<'a> {
    /// Nothing yet: egui sends all of it with its first frame.
    pub fn new(context: &'a Context) -> Glyphs<'a> {
        Glyphs {
            context,
            pixels: Vec::new(),
            size: [0; 2],
            texture: None,
        }
    }

    /// Whether it was uploaded.
    pub fn is_there(&self) -> bool {
        self.texture.is_some()
    }

    /// Replaces the texture, or a part of it.
    pub fn change(&mut self, delta: &ImageDelta) {
        let sent: Vec<Color32> = match &delta.image {
            ImageData::Color(image) => image.pixels.clone(),
            ImageData::Font(image) => image.srgba_pixels(None).collect(),
        };
        let [width, height] = delta.image.size();
        match delta.pos {
            None => {
                self.pixels = sent;
                self.size = [width, height];
            }
            Some([x, y]) => {
                let rows = self.pixels.chunks_exact_mut(self.size[0]).skip(y);
                for (row, sent) in rows.zip(sent.chunks_exact(width)) {
                    row[x..x + width].copy_from_slice(sent);
                }
            }
        }
    }

    /// Uploads the whole texture, and updates the set; no frame may be in flight.
    pub fn upload(&mut self, sampler: vk::Sampler, set: vk::DescriptorSet) -> Result<()> {
        let context = self.context;
        let (width, height) = (self.size[0] as u32, self.size[1] as u32);
        let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST;
        let format = vk::Format::R8G8B8A8_UNORM;
        let texture = Target::new(context, format, (width, height), usage)?;
        let staging = Buffer::with(context, &self.pixels, Usage::TRANSFER_SRC)?;
        context.run(|commands| {
            let image = (texture.image, texture.aspect);
            let target = Layout::TRANSFER_DST_OPTIMAL;
            change_layout(context, commands, image, Layout::UNDEFINED, target);
            let layers = vk::ImageSubresourceLayers::default()
                .aspect_mask(texture.aspect)
                .layer_count(1);
            let copy = vk::BufferImageCopy::default()
                .image_subresource(layers)
                .image_extent(vk::Extent3D {
                    width,
                    height,
                    depth: 1,
                });
            let device = &context.device;
            // SAFETY: the buffer holds the picture, and both outlive the submission.
            unsafe {
                device.cmd_copy_buffer_to_image(
                    commands,
                    staging.handle,
                    texture.image,
                    target,
                    &[copy],
                );
            }
            let read = Layout::SHADER_READ_ONLY_OPTIMAL;
            change_layout(context, commands, image, target, read);
        })?;
        let images = [vk::DescriptorImageInfo::default()
            .sampler(sampler)
            .image_view(texture.view)
            .image_layout(Layout::SHADER_READ_ONLY_OPTIMAL)];
        let write = vk::WriteDescriptorSet::default()
            .dst_set(set)
            .descriptor_type(vk::DescriptorType::COMBINED_IMAGE_SAMPLER)
            .image_info(&images);
        // SAFETY: every handle is of this device, and the set is not in use.
        unsafe { context.device.update_descriptor_sets(&[write], &[]) };
        self.texture = Some(texture);
        Ok(())
    }
}
