//! Images and views.

use ash::vk;
use bytemuck::Pod;

use crate::gpu::Made;
use crate::{Buffer, Gpu};

/// The parameters of an image.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    pub kind: vk::ImageViewType,
    pub format: vk::Format,
    pub extent: [u32; 3],
    pub levels: u32,
    pub layers: u32,
}

impl Shape {
    /// A two-dimensional image of one level and one layer.
    pub fn flat(format: vk::Format, width: u32, height: u32) -> Shape {
        Shape {
            kind: vk::ImageViewType::TYPE_2D,
            format,
            extent: [width, height, 1],
            levels: 1,
            layers: 1,
        }
    }
}

/// An image of two dimensions, one level, one layer and one sample.
pub fn flat_info(format: vk::Format, width: u32, height: u32) -> vk::ImageCreateInfo<'static> {
    vk::ImageCreateInfo::default()
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
}

/// An image in the general layout, with a view of all of it.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    pub handle: vk::Image,
    pub view: vk::ImageView,
    pub shape: Shape,
}

impl Gpu {
    pub fn picture(&self, shape: Shape, usage: vk::ImageUsageFlags) -> Picture {
        use vk::ImageViewType as View;
        let (dimensions, flags) = match shape.kind {
            View::TYPE_1D | View::TYPE_1D_ARRAY => {
                (vk::ImageType::TYPE_1D, vk::ImageCreateFlags::empty())
            }
            View::TYPE_3D => (vk::ImageType::TYPE_3D, vk::ImageCreateFlags::empty()),
            View::CUBE | View::CUBE_ARRAY => (
                vk::ImageType::TYPE_2D,
                vk::ImageCreateFlags::CUBE_COMPATIBLE,
            ),
            _ => (vk::ImageType::TYPE_2D, vk::ImageCreateFlags::empty()),
        };
        let [width, height, depth] = shape.extent;
        let mut info = flat_info(shape.format, width, height)
            .flags(flags)
            .image_type(dimensions)
            .mip_levels(shape.levels)
            .array_layers(shape.layers)
            .usage(usage | vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST);
        info.extent.depth = depth;
        let handle = self.image(&info);
        let view = if usage.intersects(vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::STORAGE)
        {
            let info = vk::ImageViewCreateInfo::default()
                .image(handle)
                .view_type(shape.kind)
                .format(shape.format)
                .subresource_range(all_of(shape));
            self.view(&info)
        } else {
            vk::ImageView::null()
        };
        let picture = Picture {
            handle,
            view,
            shape,
        };
        self.to_general(handle, all_of(shape));
        picture
    }

    /// An image with memory of its own.
    pub fn image(&self, info: &vk::ImageCreateInfo<'_>) -> vk::Image {
        // SAFETY: the handles are of this device; the structures outlive the calls.
        unsafe {
            let image = self.device.create_image(info, None);
            let image = image.expect("vkCreateImage");
            let needs = self.device.get_image_memory_requirements(image);
            let memory = self.allocate(needs, false);
            self.keep(Made::Image(image));
            let bound = self.device.bind_image_memory(image, memory, 0);
            bound.expect("vkBindImageMemory");
            image
        }
    }

    /// A view that is destroyed at the end.
    pub fn view(&self, info: &vk::ImageViewCreateInfo<'_>) -> vk::ImageView {
        // SAFETY: `info` outlives the call.
        let view = unsafe { self.device.create_image_view(info, None) };
        let view = view.expect("vkCreateImageView");
        self.keep(Made::View(view));
        view
    }

    /// Takes a new image to the general layout.
    pub fn to_general(&self, image: vk::Image, range: vk::ImageSubresourceRange) {
        let barrier = vk::ImageMemoryBarrier::default()
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(vk::ImageLayout::GENERAL)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image)
            .subresource_range(range);
        let (all, none) = (vk::PipelineStageFlags::ALL_COMMANDS, Default::default());
        self.run(|commands| {
            // SAFETY: the command buffer is being recorded.
            unsafe {
                (self.device).cmd_pipeline_barrier(commands, all, all, none, &[], &[], &[barrier]);
            }
        });
    }

    /// Fills one level of every layer with tightly packed texels.
    pub fn upload<T: Pod>(&self, picture: &Picture, level: u32, texels: &[T]) {
        let buffer = self.buffer_with(texels);
        let copy = level_copy(picture.shape, level);
        self.run(|commands| {
            // SAFETY: the caller's texels cover the level.
            unsafe {
                self.device.cmd_copy_buffer_to_image(
                    commands,
                    buffer.handle,
                    picture.handle,
                    vk::ImageLayout::GENERAL,
                    &[copy],
                );
            }
        });
    }

    /// Reads one level of every layer as tightly packed texels of `texel_bytes`.
    pub fn download(&self, picture: &Picture, level: u32, texel_bytes: u64) -> Buffer {
        let copy = level_copy(picture.shape, level);
        let extent = copy.image_extent;
        let texels = u64::from(extent.width) * u64::from(extent.height) * u64::from(extent.depth);
        let buffer = self.buffer(texels * u64::from(picture.shape.layers) * texel_bytes);
        self.run(|commands| {
            // SAFETY: the buffer holds the whole level.
            unsafe {
                self.device.cmd_copy_image_to_buffer(
                    commands,
                    picture.handle,
                    vk::ImageLayout::GENERAL,
                    buffer.handle,
                    &[copy],
                );
            }
        });
        buffer
    }

    pub fn sampler(&self, info: &vk::SamplerCreateInfo) -> vk::Sampler {
        // SAFETY: `info` outlives the call.
        let sampler = unsafe { self.device.create_sampler(info, None) }.expect("vkCreateSampler");
        self.keep(Made::Sampler(sampler));
        sampler
    }

    /// True when the format can be used so with optimal tiling.
    pub fn supports(&self, format: vk::Format, features: vk::FormatFeatureFlags) -> bool {
        // SAFETY: a plain query.
        let has = unsafe {
            self.instance
                .get_physical_device_format_properties(self.physical, format)
        };
        has.optimal_tiling_features.contains(features)
    }
}

/// Every level and layer of an image.
pub fn all_of(shape: Shape) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(shape.levels)
        .layer_count(shape.layers)
}

fn level_copy(shape: Shape, level: u32) -> vk::BufferImageCopy {
    let [width, height, depth] = shape.extent.map(|side| (side >> level).max(1));
    vk::BufferImageCopy::default()
        .image_subresource(
            vk::ImageSubresourceLayers::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .mip_level(level)
                .layer_count(shape.layers),
        )
        .image_extent(vk::Extent3D {
            width,
            height,
            depth,
        })
}
