//! Performs transfer commands. Those on images take the objects and the regions as recorded.

use ash::vk;

use super::{Engine, Failure};
use crate::command::{MatrixConversion, Parameters, TransferCommand};
use crate::object::Image;
use crate::transfer::{blit, buffer, clear, copy, matrix, resolve};
use crate::wave::reachable;

/// Performs one transfer command.
///
/// # Errors
/// A limit stopped it.
pub(super) fn perform(engine: &Engine, command: &TransferCommand) -> Result<(), Failure> {
    match command {
        &TransferCommand::CopyBuffer {
            source,
            destination,
            size_bytes,
        } => buffer::copy(&engine.memory.reach(), source, destination, size_bytes),
        &TransferCommand::FillBuffer {
            address,
            size_bytes,
            word,
        } => buffer::fill(&engine.memory.reach(), address, size_bytes, word),
        TransferCommand::UpdateBuffer { address, bytes } => {
            buffer::update(&engine.memory.reach(), *address, bytes);
        }
        TransferCommand::CopyImage {
            source,
            destination,
            regions,
        } => (regions.iter())
            .for_each(|region| copy::copy_image(&engine.workers, source, destination, region)),
        TransferCommand::CopyBufferToImage {
            source,
            destination,
            regions,
        } => within_reach(engine, *source, destination, regions).for_each(|region| {
            copy::copy_buffer_to_image(&engine.workers, *source, destination, region);
        }),
        TransferCommand::ConvertMatrices(conversions) => convert_matrices(engine, conversions)?,
        &TransferCommand::CopyMemoryIndirect { parameters, count } => {
            copy_indirect(engine, parameters, count)?;
        }
        TransferCommand::CopyMemoryToImageIndirect {
            parameters,
            destination,
            layers,
        } => copy_to_image_indirect(engine, *parameters, destination, layers),
        TransferCommand::CopyImageToBuffer {
            source,
            destination,
            regions,
        } => within_reach(engine, *destination, source, regions).for_each(|region| {
            copy::copy_image_to_buffer(&engine.workers, source, *destination, region);
        }),
        TransferCommand::BlitImage {
            source,
            destination,
            regions,
            filter,
        } => regions.iter().for_each(|region| {
            blit::blit_image(&engine.workers, source, destination, region, *filter);
        }),
        TransferCommand::ResolveImage {
            source,
            destination,
            regions,
            stencil,
            other,
        } => engine.workers.install(|| {
            for region in regions {
                resolve::resolve_image(source, destination, region, *stencil, *other);
            }
        }),
        TransferCommand::ClearColorImage {
            image,
            value,
            ranges,
        } => (ranges.iter()).for_each(|range| clear::clear_color_image(image, value, range)),
        TransferCommand::ClearDepthStencilImage {
            image,
            value,
            ranges,
        } => {
            (ranges.iter()).for_each(|range| clear::clear_depth_stencil_image(image, value, range))
        }
    }
    Ok(())
}

/// The regions of which a buffer has all bytes in reachable memory.
fn within_reach<'r>(
    engine: &Engine,
    buffer: u64,
    image: &Image,
    regions: &'r [vk::BufferImageCopy],
) -> impl Iterator<Item = &'r vk::BufferImageCopy> {
    (regions.iter()).filter(move |region| has_bytes(engine, buffer, image, region))
}

/// Whether all bytes of a buffer that a region touches are in reachable memory.
fn has_bytes(engine: &Engine, buffer: u64, image: &Image, region: &vk::BufferImageCopy) -> bool {
    let start = buffer.wrapping_add(region.buffer_offset);
    copy::buffer_size_bytes(image, region)
        .is_some_and(|bytes| bytes == 0 || engine.memory.reach().contains(start, bytes))
}

fn convert_matrices(engine: &Engine, conversions: &[MatrixConversion]) -> Result<(), Failure> {
    let limits = engine.limits();
    for conversion in conversions {
        limits.check()?;
        // SAFETY: addresses in reach lead to memory, and the queue performs one command at a time,
        // so that the application's contract keeps other accesses away.
        unsafe { matrix::convert(conversion, &engine.memory.reach()) };
    }
    Ok(())
}

/// Copies with parameters in memory (`VkCopyMemoryIndirectCommandKHR`). Parameters outside of
/// memory copy nothing.
fn copy_indirect(engine: &Engine, parameters: Parameters, count: u32) -> Result<(), Failure> {
    let limits = engine.limits();
    for index in 0..count {
        limits.check()?;
        let reach = engine.memory.reach();
        // SAFETY: any bytes are valid numbers, and the queue performs one command at a time.
        let copy = unsafe { reachable::read::<[u64; 3]>(&reach, parameters.of(index)) };
        if let Some([source, destination, size_bytes]) = copy {
            buffer::copy(&reach, source, destination, size_bytes);
        }
    }
    Ok(())
}

/// Copies to an image with parameters in memory (`VkCopyMemoryToImageIndirectCommandKHR`). For a 3D
/// image the recorded layers name the slices, and replace the depth of the offset and the extent in
/// memory (`vkCmdCopyMemoryToImageIndirectKHR`).
fn copy_to_image_indirect(
    engine: &Engine,
    parameters: Parameters,
    destination: &Image,
    layers: &[vk::ImageSubresourceLayers],
) {
    /// `VkCopyMemoryToImageIndirectCommandKHR`.
    #[repr(C)]
    #[derive(Clone, Copy)]
    struct Copy {
        source: u64,
        row_length: u32,
        image_height: u32,
        layers: [u32; 4],
        offset: [i32; 3],
        extent: [u32; 3],
    }
    for (&layers, index) in layers.iter().zip(0..) {
        // SAFETY: any bytes are valid numbers, and the queue performs one command at a time.
        let copy = unsafe { reachable::read::<Copy>(&engine.memory.reach(), parameters.of(index)) };
        let Some(copy) = copy else { continue };
        let ([x, y, mut z], [width, height, mut depth]) = (copy.offset, copy.extent);
        if destination.image_type == vk::ImageType::TYPE_3D {
            z = layers.base_array_layer as i32;
            depth = destination.slice_count(&layers);
        }
        let region = vk::BufferImageCopy {
            buffer_offset: 0,
            buffer_row_length: copy.row_length,
            buffer_image_height: copy.image_height,
            image_subresource: layers,
            image_offset: vk::Offset3D { x, y, z },
            image_extent: vk::Extent3D {
                width,
                height,
                depth,
            },
        };
        if has_bytes(engine, copy.source, destination, &region) {
            copy::copy_buffer_to_image(&engine.workers, copy.source, destination, &region);
        }
    }
}
