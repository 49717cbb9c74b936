//! Buffers that the host can see, and textures.

use anyhow::{Context as _, Result};
use ash::vk;
use bytemuck::Pod;

use super::Context;
use crate::scene::{Texture, Wrap};

/// A buffer in memory that the host can see, mapped only while the host reads or writes it.
///
/// RenderDoc records each change of mapped memory as a write of the host, also one that a launch
/// made while it was running.
pub struct Buffer<'a> {
    context: &'a Context,
    pub handle: vk::Buffer,
    memory: vk::DeviceMemory,
    size_bytes: u64,
}

impl<'a> Buffer<'a> {
    /// A buffer of `size_bytes`, not zeroed, with a device address.
    pub fn new(
        context: &'a Context,
        size_bytes: u64,
        usage: vk::BufferUsageFlags,
    ) -> Result<Buffer<'a>> {
        let size_bytes = size_bytes.max(16);
        let info = vk::BufferCreateInfo::default()
            .size(size_bytes)
            .usage(usage | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS);
        let device = &context.device;
        // SAFETY: the handles are of this device; the memory is bound once.
        unsafe {
            let handle = device.create_buffer(&info, None)?;
            let needs = device.get_buffer_memory_requirements(handle);
            let memory = allocate(context, needs, true).context("memory for a buffer")?;
            device.bind_buffer_memory(handle, memory, 0)?;
            Ok(Buffer {
                context,
                handle,
                memory,
                size_bytes,
            })
        }
    }

    /// A buffer that holds a copy of `items`.
    pub fn with<T: Pod>(
        context: &'a Context,
        items: &[T],
        usage: vk::BufferUsageFlags,
    ) -> Result<Buffer<'a>> {
        let bytes: &[u8] = bytemuck::cast_slice(items);
        let mut buffer = Buffer::new(context, bytes.len() as u64, usage)?;
        buffer.write(0, bytes)?;
        Ok(buffer)
    }

    /// Copies bytes in; the device must not be using them. Fails where memory cannot be mapped.
    pub fn write(&mut self, offset: usize, bytes: &[u8]) -> Result<()> {
        assert!(offset + bytes.len() <= self.size_bytes as usize);
        let copy = |mapped: *mut u8| {
            // SAFETY: the range lies inside the mapping, and no other reference to it exists.
            unsafe {
                mapped
                    .add(offset)
                    .copy_from_nonoverlapping(bytes.as_ptr(), bytes.len())
            }
        };
        self.with_mapping(copy)
    }

    /// Copies out bytes that the device has finished writing. Fails where memory cannot be mapped.
    pub fn read<T: Pod>(&self, count: usize) -> Result<Vec<T>> {
        let bytes = count * size_of::<T>();
        assert!(bytes <= self.size_bytes as usize);
        let mut items = vec![T::zeroed(); count];
        let target: &mut [u8] = bytemuck::cast_slice_mut(&mut items);
        // SAFETY: the range lies inside the mapping, and `target` is our own.
        let copy = |mapped: *mut u8| unsafe {
            mapped.copy_to_nonoverlapping(target.as_mut_ptr(), bytes);
        };
        self.with_mapping(copy)?;
        Ok(items)
    }

    /// Calls `copy` with the address of the buffer's memory, which is valid during the call.
    fn with_mapping(&self, copy: impl FnOnce(*mut u8)) -> Result<()> {
        let (device, flags) = (&self.context.device, vk::MemoryMapFlags::empty());
        // SAFETY: the memory is of this device and is mapped only here.
        let mapped = unsafe { device.map_memory(self.memory, 0, vk::WHOLE_SIZE, flags) };
        copy(mapped.context("mapping a buffer")?.cast());
        // SAFETY: it is mapped, and `copy` no longer uses it.
        unsafe { device.unmap_memory(self.memory) };
        Ok(())
    }

    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
    }

    pub fn address(&self) -> u64 {
        let info = vk::BufferDeviceAddressInfo::default().buffer(self.handle);
        // SAFETY: the buffer is of this device and has the usage for it.
        unsafe { self.context.device.get_buffer_device_address(&info) }
    }
}

impl Drop for Buffer<'_> {
    fn drop(&mut self) {
        // SAFETY: the device is idle when buffers go.
        unsafe {
            self.context.device.destroy_buffer(self.handle, None);
            self.context.device.free_memory(self.memory, None);
        }
    }
}

/// Memory of a fitting type: for a buffer that the host sees, or for an image.
pub(super) fn allocate(
    context: &Context,
    needs: vk::MemoryRequirements,
    is_buffer: bool,
) -> Result<vk::DeviceMemory> {
    let visible = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
    let wishes = if is_buffer {
        let cached = visible | vk::MemoryPropertyFlags::HOST_CACHED;
        [cached, visible]
    } else {
        [
            vk::MemoryPropertyFlags::DEVICE_LOCAL,
            vk::MemoryPropertyFlags::empty(),
        ]
    };
    let types = context.memory.memory_types_as_slice();
    let kind = wishes
        .iter()
        .find_map(|wish| {
            types.iter().enumerate().position(|(i, kind)| {
                needs.memory_type_bits >> i & 1 == 1 && kind.property_flags.contains(*wish)
            })
        })
        .context("no fitting type of memory")?;
    let mut flags = vk::MemoryAllocateFlagsInfo::default();
    if is_buffer {
        flags = flags.flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
    }
    let info = vk::MemoryAllocateInfo::default()
        .allocation_size(needs.size)
        .memory_type_index(kind as u32)
        .push_next(&mut flags);
    // SAFETY: `info` outlives the call.
    Ok(unsafe { context.device.allocate_memory(&info, None) }?)
}

/// A sampled texture.
pub struct Image<'a> {
    context: &'a Context,
    handle: vk::Image,
    memory: vk::DeviceMemory,
    pub view: vk::ImageView,
    pub sampler: vk::Sampler,
}

impl<'a> Image<'a> {
    fn new(context: &'a Context, texture: &Texture) -> Result<Image<'a>> {
        let format = match texture.srgb {
            true => vk::Format::R8G8B8A8_SRGB,
            false => vk::Format::R8G8B8A8_UNORM,
        };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D {
                width: texture.width,
                height: texture.height,
                depth: 1,
            })
            .mip_levels(texture.levels.len() as u32)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST);
        let mode = match texture.wrap {
            Wrap::Repeat => vk::SamplerAddressMode::REPEAT,
            Wrap::Clamp => vk::SamplerAddressMode::CLAMP_TO_EDGE,
            Wrap::Mirror => vk::SamplerAddressMode::MIRRORED_REPEAT,
        };
        let sampler = vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::LINEAR)
            .min_filter(vk::Filter::LINEAR)
            .mipmap_mode(vk::SamplerMipmapMode::LINEAR)
            .address_mode_u(mode)
            .address_mode_v(mode)
            .address_mode_w(mode)
            .max_lod(vk::LOD_CLAMP_NONE);
        let device = &context.device;
        // SAFETY: the handles are of this device, and the memory is bound once.
        unsafe {
            let handle = device.create_image(&info, None)?;
            let needs = device.get_image_memory_requirements(handle);
            let memory = allocate(context, needs, false).context("memory for a texture")?;
            device.bind_image_memory(handle, memory, 0)?;
            let view = vk::ImageViewCreateInfo::default()
                .image(handle)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(format)
                .subresource_range(whole(texture));
            let view = device.create_image_view(&view, None)?;
            let sampler = device.create_sampler(&sampler, None)?;
            Ok(Image {
                context,
                handle,
                memory,
                view,
                sampler,
            })
        }
    }
}

impl Drop for Image<'_> {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: the device is idle when images go.
        unsafe {
            device.destroy_sampler(self.sampler, None);
            device.destroy_image_view(self.view, None);
            device.destroy_image(self.handle, None);
            device.free_memory(self.memory, None);
        }
    }
}

fn whole(texture: &Texture) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(texture.levels.len() as u32)
        .layer_count(1)
}

/// Makes images of textures and fills all their levels, in one submission.
pub fn upload_images<'a>(context: &'a Context, textures: &[Texture]) -> Result<Vec<Image<'a>>> {
    let bytes: Vec<u8> = textures
        .iter()
        .flat_map(|texture| texture.levels.iter().flatten().flatten().copied())
        .collect();
    let staging = Buffer::with(context, &bytes, vk::BufferUsageFlags::TRANSFER_SRC)?;
    let images: Vec<Image> = textures
        .iter()
        .map(|texture| Image::new(context, texture))
        .collect::<Result<_>>()?;
    context.run(|commands| {
        let mut offset = 0;
        for (image, texture) in images.iter().zip(textures) {
            let undefined = (vk::ImageLayout::UNDEFINED, vk::AccessFlags::empty());
            let target = (
                vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                vk::AccessFlags::TRANSFER_WRITE,
            );
            let read = (
                vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
                vk::AccessFlags::SHADER_READ,
            );
            transition(context, commands, image, texture, undefined, target);
            let mut copies = Vec::new();
            for (level, texels) in texture.levels.iter().enumerate() {
                let extent = |size: u32| (size >> level).max(1);
                let (width, height) = (extent(texture.width), extent(texture.height));
                copies.push(
                    vk::BufferImageCopy::default()
                        .buffer_offset(offset)
                        .image_subresource(
                            vk::ImageSubresourceLayers::default()
                                .aspect_mask(vk::ImageAspectFlags::COLOR)
                                .mip_level(level as u32)
                                .layer_count(1),
                        )
                        .image_extent(vk::Extent3D {
                            width,
                            height,
                            depth: 1,
                        }),
                );
                offset += 4 * texels.len() as u64;
            }
            // SAFETY: the buffer holds every level, and both outlive the submission.
            unsafe {
                context.device.cmd_copy_buffer_to_image(
                    commands,
                    staging.handle,
                    image.handle,
                    vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                    &copies,
                );
            }
            transition(context, commands, image, texture, target, read);
        }
    })?;
    Ok(images)
}

fn transition(
    context: &Context,
    commands: vk::CommandBuffer,
    image: &Image,
    texture: &Texture,
    (from, wrote): (vk::ImageLayout, vk::AccessFlags),
    (to, reads): (vk::ImageLayout, vk::AccessFlags),
) {
    let barrier = vk::ImageMemoryBarrier::default()
        .old_layout(from)
        .new_layout(to)
        .src_access_mask(wrote)
        .dst_access_mask(reads)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(image.handle)
        .subresource_range(whole(texture));
    let after = match to {
        vk::ImageLayout::TRANSFER_DST_OPTIMAL => vk::PipelineStageFlags::TRANSFER,
        _ => vk::PipelineStageFlags::ALL_COMMANDS,
    };
    let before = match from {
        vk::ImageLayout::UNDEFINED => vk::PipelineStageFlags::TOP_OF_PIPE,
        _ => vk::PipelineStageFlags::TRANSFER,
    };
    // SAFETY: the command buffer is recording, and the image outlives the submission.
    unsafe {
        context.device.cmd_pipeline_barrier(
            commands,
            before,
            after,
            vk::DependencyFlags::empty(),
            &[],
            &[],
            &[barrier],
        );
    }
}
