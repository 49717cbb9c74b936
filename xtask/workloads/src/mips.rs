//! Textures with mip chains that blits make, as loaders of assets do it.

use tuff_tests::{Bound, Gpu, Picture, Shape, vk};

/// A square texture, its first level filled.
pub struct Texture {
    pub picture: Picture,
    side: u32,
}

impl Texture {
    pub fn filled(gpu: &Gpu, format: vk::Format, side: u32, number: u32) -> Texture {
        let shape = Shape {
            levels: side.ilog2() + 1,
            ..Shape::flat(format, side, side)
        };
        let picture = gpu.picture(shape, vk::ImageUsageFlags::SAMPLED);
        let texel = |i: u32| {
            let (x, y) = (i % side, i / side);
            let stripe = (x / 8 + y / 16 + number) % 3;
            [
                x * 37 + number * 91,
                y * 53,
                (x ^ y) * 11 + stripe * 60,
                255,
            ]
            .map(|part| part as u8)
        };
        let texels: Vec<[u8; 4]> = (0..side * side).map(texel).collect();
        gpu.upload(&picture, 0, &texels);
        Texture { picture, side }
    }

    /// Makes every level from the one before it.
    pub fn record_mips(&self, gpu: &Gpu, commands: vk::CommandBuffer) {
        let general = vk::ImageLayout::GENERAL;
        for level in 1..self.picture.shape.levels {
            let corner = |level: u32| {
                let side = (self.side >> level).max(1) as i32;
                vk::Offset3D {
                    x: side,
                    y: side,
                    z: 1,
                }
            };
            let blit = vk::ImageBlit::default()
                .src_subresource(layers(level - 1))
                .dst_subresource(layers(level))
                .src_offsets([vk::Offset3D::default(), corner(level - 1)])
                .dst_offsets([vk::Offset3D::default(), corner(level)]);
            let image = self.picture.handle;
            // SAFETY: the levels are the image's.
            unsafe {
                gpu.device.cmd_blit_image(
                    commands,
                    image,
                    general,
                    image,
                    general,
                    &[blit],
                    vk::Filter::LINEAR,
                );
            }
            gpu.barrier(commands);
        }
    }

    /// To be sampled with repetition and trilinearly.
    pub fn bound(&self, gpu: &Gpu) -> Bound {
        Bound::Sampled(self.picture.view, gpu.sampler(&trilinear()))
    }
}

/// A sampler with repetition.
pub fn trilinear() -> vk::SamplerCreateInfo<'static> {
    vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .min_filter(vk::Filter::LINEAR)
        .mipmap_mode(vk::SamplerMipmapMode::LINEAR)
        .max_lod(vk::LOD_CLAMP_NONE)
}

/// Texels of all levels but the first.
pub fn texels_made(side: u32) -> u32 {
    (1..=side.ilog2())
        .map(|level| (side >> level) * (side >> level))
        .sum()
}

/// A level of an image of one layer.
pub fn layers(level: u32) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .mip_level(level)
        .layer_count(1)
}
