//! Resolving multisampled images (spec, "Resolving Multisample Images").

use ash::vk;
use images::format::{FormatInfo, MAX_TEXEL_BYTES, Numeric};
use rayon::prelude::*;

use super::surface::{Region, Surface, region, slice_count};
use crate::object::Image;
use crate::object::render_pass::ResolveMode;

/// `vkCmdResolveImage`, one region: each aspect by its mode. The mean of integers is sample zero.
pub fn resolve_image(
    source: &Image,
    destination: &Image,
    resolve: &vk::ImageResolve,
    stencil: ResolveMode,
    other: ResolveMode,
) {
    let (from_layers, to_layers) = (&resolve.src_subresource, &resolve.dst_subresource);
    let slices = slice_count(source, from_layers, 1).min(slice_count(
        destination,
        to_layers,
        resolve.extent.depth,
    ));
    for (aspect, mode) in [
        (vk::ImageAspectFlags::COLOR, other),
        (vk::ImageAspectFlags::DEPTH, other),
        (vk::ImageAspectFlags::STENCIL, stencil),
    ] {
        let (from, to) = (from_layers.aspect_mask, to_layers.aspect_mask);
        if !(from & to).contains(aspect) || mode.mode.is_empty() {
            continue;
        }
        let surfaces = (
            Surface::new(source, aspect, from_layers.mip_level),
            Surface::new(destination, aspect, to_layers.mip_level),
        );
        let (Some(from), Some(to)) = surfaces else {
            return;
        };
        let (start, end) = (resolve.src_offset, resolve.dst_offset);
        let regions = (
            region(source, from_layers, start, resolve.extent, slices)
                .and_then(|region| from.inside(region)),
            region(destination, to_layers, end, resolve.extent, slices)
                .and_then(|region| to.inside(region)),
        );
        let (Some(from_region), Some(to_region)) = regions else {
            return;
        };
        for slice in 0..from_region.slices {
            let of = |region: Region| Region {
                slice: region.slice + slice,
                slices: 1,
                ..region
            };
            resolve_slice((&from, of(from_region)), (&to, of(to_region)), mode);
        }
    }
}

/// Resolves one layer of an attachment at the end of a pass.
pub fn resolve_attachment(
    (from, from_slice): (&Surface, u32),
    (to, to_slice): (&Surface, u32),
    mode: ResolveMode,
    area: &vk::Rect2D,
) {
    let region = area_of(area, from_slice);
    let destination = Region {
        slice: to_slice,
        ..region
    };
    if from.inside(region).is_none() || to.inside(destination).is_none() {
        return;
    }
    resolve_slice((from, region), (to, destination), mode);
}

/// Resolves one slice, on the current rayon pool: colors to their mean, integers to sample zero,
/// depth and stencil as the mode says. The regions have one size and are inside of their surfaces.
fn resolve_slice(
    (from, region): (&Surface, Region),
    (to, destination): (&Surface, Region),
    mode: ResolveMode,
) {
    let (mut from, mut to) = (*from, *to);
    if mode.encoded_mean {
        (from.format, to.format) = (from.format.codes(), to.format.codes());
    }
    let (from, to, mode) = (&from, &to, mode.mode);
    let is_integer = from.format.numeric.is_integer() || from.format.has_stencil;
    let bytes = is_bytes(from.format) && std::ptr::eq(from.format, to.format);
    let bytes = bytes && mode == vk::ResolveModeFlags::AVERAGE;
    (0..region.height)
        .into_par_iter()
        .with_min_len(16)
        .for_each(|row| {
            let (y, to_y) = (region.y + row, destination.y + row);
            if bytes {
                let length = region.width as usize * from.texel_size_bytes;
                let source = |sample| from.texel(region.x, y, region.slice, sample).cast_const();
                let target = to.texel(destination.x, to_y, destination.slice, 0);
                // SAFETY: the rows are inside the images, and each row of the destination is
                // written by one task.
                return unsafe { mean_bytes(source, from.samples, target, length) };
            }
            for column in 0..region.width {
                let x = region.x + column;
                let texel = |sample| from.texel(x, y, region.slice, sample);
                let words = |sample| {
                    // SAFETY: the texel is inside the image.
                    let bytes =
                        unsafe { std::slice::from_raw_parts(texel(sample), from.texel_size_bytes) };
                    from.format.decode(bytes)
                };
                let value = match mode {
                    vk::ResolveModeFlags::AVERAGE if !is_integer => mean(from, from.samples, texel),
                    vk::ResolveModeFlags::MIN | vk::ResolveModeFlags::MAX => {
                        let least = mode == vk::ResolveModeFlags::MIN;
                        let is_less = |a: u32, b: u32| match is_integer {
                            true => a < b,
                            false => f32::from_bits(a) < f32::from_bits(b),
                        };
                        let rest = (1..from.samples).map(|sample| words(sample)[0]);
                        let chosen = rest.fold(words(0)[0], |chosen, word| {
                            if is_less(word, chosen) == least {
                                word
                            } else {
                                chosen
                            }
                        });
                        [chosen, 0, 0, 0]
                    }
                    _ => words(0),
                };
                let mut texel = [0; MAX_TEXEL_BYTES];
                to.format.encode(value, &mut texel);
                let address = to.texel(destination.x + column, to_y, destination.slice, 0);
                // SAFETY: the texel is inside the image.
                unsafe {
                    std::ptr::copy_nonoverlapping(texel.as_ptr(), address, to.texel_size_bytes)
                };
            }
        });
}

/// The opposite of a resolve, for one layer: all samples get the value of the source's single
/// sample. Both images have the same format.
pub fn spread(
    (from, from_slice): (&Surface, u32),
    (to, to_slice): (&Surface, u32),
    area: &vk::Rect2D,
) {
    let region = area_of(area, from_slice);
    let destination = Region {
        slice: to_slice,
        ..region
    };
    if from.inside(region).is_none() || to.inside(destination).is_none() {
        return;
    }
    let length = region.width as usize * from.texel_size_bytes;
    (0..region.height)
        .into_par_iter()
        .with_min_len(16)
        .for_each(|row| {
            let y = region.y + row;
            let source = from.texel(region.x, y, from_slice, 0).cast_const();
            for sample in 0..to.samples {
                let target = to.texel(region.x, y, to_slice, sample);
                // SAFETY: the rows are inside the images; the destination is the driver's own
                // memory, and each of its rows is written by one task.
                unsafe { std::ptr::copy_nonoverlapping(source, target, length) };
            }
        });
}

fn area_of(area: &vk::Rect2D, slice: u32) -> Region {
    Region {
        x: area.offset.x.max(0) as u32,
        y: area.offset.y.max(0) as u32,
        slice,
        width: area.extent.width,
        height: area.extent.height,
        slices: 1,
    }
}

/// Whether texels are unsigned normalized bytes, so that the mean can be taken byte by byte.
fn is_bytes(format: &FormatInfo) -> bool {
    let mut channels = format.channels.iter();
    let has_bytes = channels.all(|channel| matches!(channel.bits, 0 | 8));
    format.numeric == Numeric::Unorm && format.is_color() && has_bytes
}

/// The mean of a row's samples, byte by byte, to the nearest, ties to even.
///
/// # Safety
/// `length` bytes are readable at each sample's row, and writable at `target`.
unsafe fn mean_bytes(
    source: impl Fn(u32) -> *const u8,
    samples: u32,
    target: *mut u8,
    length: usize,
) {
    let shift = samples.trailing_zeros();
    const PART: usize = 64;
    for start in (0..length).step_by(PART) {
        let count = PART.min(length - start);
        let mut sums = [0u16; PART];
        for sample in 0..samples {
            // SAFETY: the caller guarantees that `length` bytes are readable at each sample's row,
            // and writable at `target`.
            let row = unsafe { std::slice::from_raw_parts(source(sample).add(start), count) };
            for (sum, &byte) in sums.iter_mut().zip(row) {
                *sum += u16::from(byte);
            }
        }
        // SAFETY: the caller guarantees that `length` bytes are readable at each sample's row, and
        // writable at `target`.
        let row = unsafe { std::slice::from_raw_parts_mut(target.add(start), count) };
        for (byte, &sum) in row.iter_mut().zip(&sums) {
            let below_half = ((1u16 << shift) >> 1).saturating_sub(1);
            let odd = if samples > 1 { sum >> shift & 1 } else { 0 };
            *byte = ((sum + below_half + odd) >> shift) as u8;
        }
    }
}

/// The mean of a texel's samples, or the words of the selected sample.
fn mean(from: &Surface, sample_count: u32, texel: impl Fn(u32) -> *mut u8) -> [u32; 4] {
    let words = |sample: u32| {
        // SAFETY: the texel is inside the image.
        let bytes = unsafe { std::slice::from_raw_parts(texel(sample), from.texel_size_bytes) };
        from.format.decode(bytes)
    };
    if sample_count == 1 {
        return words(0);
    }
    let mut sums = [0.0f64; 4];
    for sample in 0..sample_count {
        for (sum, word) in sums.iter_mut().zip(words(sample)) {
            *sum += f64::from(f32::from_bits(word));
        }
    }
    sums.map(|sum| ((sum / f64::from(sample_count)) as f32).to_bits())
}
