//! Transfers against loops that know no strides: images are written and read texel by texel through
//! buffers.

use std::sync::{Arc, OnceLock};

use ash::vk;
use images::format::MAX_TEXEL_BYTES;

use super::{blit, clear, copy, resolve};
use crate::format::texel_format;
use crate::object::Image;
use crate::object::render_pass::ResolveMode;
use crate::wave::Workers;

const COLOR: vk::ImageAspectFlags = vk::ImageAspectFlags::COLOR;

/// An image with memory of its own.
struct Bound {
    image: Image,
    _memory: Vec<u64>,
}

impl std::ops::Deref for Bound {
    type Target = Image;

    fn deref(&self) -> &Image {
        &self.image
    }
}

#[derive(Clone, Copy)]
struct ImageSpec {
    ty: vk::ImageType,
    format: vk::Format,
    extent: [u32; 3],
    levels: u32,
    layers: u32,
    samples: vk::SampleCountFlags,
}

/// Two threads, so that rows are dealt out.
fn workers() -> &'static Workers {
    static WORKERS: OnceLock<Arc<Workers>> = OnceLock::new();
    WORKERS.get_or_init(|| Workers::new(2))
}

fn kind(format: vk::Format, width: u32, height: u32) -> ImageSpec {
    ImageSpec {
        ty: vk::ImageType::TYPE_2D,
        format,
        extent: [width, height, 1],
        levels: 1,
        layers: 1,
        samples: vk::SampleCountFlags::TYPE_1,
    }
}

fn image(kind: ImageSpec) -> Bound {
    let info = vk::ImageCreateInfo {
        image_type: kind.ty,
        format: kind.format,
        extent: extent(kind.extent),
        mip_levels: kind.levels,
        array_layers: kind.layers,
        samples: kind.samples,
        ..Default::default()
    };
    let image = Image::new(&info).unwrap();
    let mut memory = vec![0xcdcd_cdcd_cdcd_cdcdu64; image.size_bytes.div_ceil(8) as usize];
    image.bind(memory.as_mut_ptr() as u64);
    Bound {
        image,
        _memory: memory,
    }
}

fn extent([width, height, depth]: [u32; 3]) -> vk::Extent3D {
    vk::Extent3D {
        width,
        height,
        depth,
    }
}

fn offset([x, y, z]: [i32; 3]) -> vk::Offset3D {
    vk::Offset3D { x, y, z }
}

fn layers(
    aspect_mask: vk::ImageAspectFlags,
    mip_level: u32,
    base_array_layer: u32,
    layer_count: u32,
) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers {
        aspect_mask,
        mip_level,
        base_array_layer,
        layer_count,
    }
}

fn texel_copy(
    aspect: vk::ImageAspectFlags,
    level: u32,
    layer: u32,
    at: [i32; 3],
) -> vk::BufferImageCopy {
    vk::BufferImageCopy {
        image_subresource: layers(aspect, level, layer, 1),
        image_offset: offset(at),
        image_extent: extent([1; 3]),
        ..Default::default()
    }
}

/// Writes one texel, given as words.
fn put(
    image: &Image,
    aspect: vk::ImageAspectFlags,
    level: u32,
    layer: u32,
    at: [i32; 3],
    words: [u32; 4],
) {
    let mut bytes = [0; MAX_TEXEL_BYTES];
    let format = texel_format(image.plane(aspect).unwrap().format)
        .info()
        .unwrap();
    format.encode(words, &mut bytes);
    copy::copy_buffer_to_image(
        workers(),
        bytes.as_ptr() as u64,
        image,
        &texel_copy(aspect, level, layer, at),
    );
}

/// Reads one texel as words.
fn get(
    image: &Image,
    aspect: vk::ImageAspectFlags,
    level: u32,
    layer: u32,
    at: [i32; 3],
) -> [u32; 4] {
    let mut bytes = [0; MAX_TEXEL_BYTES];
    copy::copy_image_to_buffer(
        workers(),
        image,
        bytes.as_mut_ptr() as u64,
        &texel_copy(aspect, level, layer, at),
    );
    let format = texel_format(image.plane(aspect).unwrap().format)
        .info()
        .unwrap();
    format.decode(&bytes)
}

fn get_float(image: &Image, at: [i32; 3]) -> [f32; 4] {
    get(image, COLOR, 0, 0, at).map(f32::from_bits)
}

/// A different number for each place.
fn mark(x: i32, y: i32, z: i32) -> [u32; 4] {
    [(x + 100 * y + 10_000 * z) as u32; 4]
}

#[test]
fn buffers_are_addressed_by_row_length_and_image_height() {
    let to = image(ImageSpec {
        layers: 3,
        levels: 2,
        ..kind(vk::Format::R32_UINT, 8, 8)
    });
    let buffer: Vec<u32> = (0..1000).collect();
    let region = vk::BufferImageCopy {
        buffer_offset: 40,
        buffer_row_length: 7,
        buffer_image_height: 5,
        image_subresource: layers(COLOR, 1, 1, 2),
        image_offset: offset([1, 1, 0]),
        image_extent: extent([3, 2, 1]),
    };
    assert_eq!(
        copy::buffer_size_bytes(&to, &region),
        Some(4 * (35 + 7 + 3))
    );
    copy::copy_buffer_to_image(workers(), buffer.as_ptr() as u64, &to, &region);
    for layer in 0..2 {
        for (x, y) in (0..3).flat_map(|x| (0..2).map(move |y| (x, y))) {
            let word = get(&to, COLOR, 1, 1 + layer, [1 + x, 1 + y, 0])[0];
            assert_eq!(word, 10 + layer * 35 + y as u32 * 7 + x as u32);
        }
    }
    // Around it, nothing.
    assert_eq!(get(&to, COLOR, 1, 0, [1, 1, 0])[0], 0xcdcd_cdcd);
    assert_eq!(get(&to, COLOR, 1, 1, [0, 1, 0])[0], 0xcdcd_cdcd);
    assert_eq!(get(&to, COLOR, 0, 1, [1, 1, 0])[0], 0xcdcd_cdcd);

    let mut back = vec![0u32; 1000];
    copy::copy_image_to_buffer(workers(), &to, back.as_mut_ptr() as u64, &region);
    for (index, word) in back.iter().enumerate() {
        let from = index.wrapping_sub(10);
        let (x, y, layer) = (from % 7, from / 7 % 5, from / 35);
        let inside = index >= 10 && x < 3 && y < 2 && layer < 2;
        assert_eq!(*word, if inside { index as u32 } else { 0 });
    }
}

#[test]
fn copies_pair_slices_with_layers() {
    let volume = ImageSpec {
        ty: vk::ImageType::TYPE_3D,
        extent: [4, 4, 4],
        ..kind(vk::Format::R32_UINT, 0, 0)
    };
    let (from, to) = (
        image(volume),
        image(ImageSpec {
            layers: 5,
            ..kind(vk::Format::R32_SFLOAT, 4, 4)
        }),
    );
    for z in 0..4 {
        for (x, y) in (0..4).flat_map(|x| (0..4).map(move |y| (x, y))) {
            put(&from, COLOR, 0, 0, [x, y, z], mark(x, y, z));
        }
    }
    let region = vk::ImageCopy {
        src_subresource: layers(COLOR, 0, 0, 1),
        src_offset: offset([1, 0, 1]),
        dst_subresource: layers(COLOR, 0, 2, 3),
        dst_offset: offset([0, 2, 0]),
        extent: extent([3, 2, 3]),
    };
    copy::copy_image(workers(), &from, &to, &region);
    for z in 0..3 {
        for (x, y) in (0..3).flat_map(|x| (0..2).map(move |y| (x, y))) {
            let word = get(&to, COLOR, 0, 2 + z as u32, [x, 2 + y, 0])[0];
            assert_eq!(word, mark(x + 1, y, z + 1)[0]);
        }
    }
    assert_eq!(get(&to, COLOR, 0, 1, [0, 2, 0])[0], 0xcdcd_cdcd);
    // And back, to the first slices.
    let back = vk::ImageCopy {
        src_subresource: region.dst_subresource,
        src_offset: region.dst_offset,
        dst_subresource: region.src_subresource,
        dst_offset: offset([0, 0, 0]),
        extent: region.extent,
    };
    copy::copy_image(workers(), &to, &from, &back);
    assert_eq!(get(&from, COLOR, 0, 0, [2, 1, 2])[0], mark(3, 1, 3)[0]);
}

#[test]
fn regions_outside_are_not_transferred() {
    let (from, to) = (
        image(kind(vk::Format::R32_UINT, 4, 4)),
        image(kind(vk::Format::R32_UINT, 4, 4)),
    );
    put(&from, COLOR, 0, 0, [1, 1, 0], [7; 4]);
    let region = vk::ImageCopy {
        src_subresource: layers(COLOR, 0, 0, 1),
        dst_subresource: layers(COLOR, 0, 0, 1),
        extent: extent([5, 4, 1]),
        ..Default::default()
    };
    copy::copy_image(workers(), &from, &to, &region);
    assert_eq!(get(&to, COLOR, 0, 0, [1, 1, 0])[0], 0xcdcd_cdcd);
}

#[test]
fn depth_and_stencil_are_copied_apart() {
    use vk::ImageAspectFlags as Aspect;
    let (from, to) = (
        image(kind(vk::Format::D24_UNORM_S8_UINT, 4, 4)),
        image(kind(vk::Format::D24_UNORM_S8_UINT, 4, 4)),
    );
    let range = vk::ImageSubresourceRange {
        aspect_mask: Aspect::DEPTH | Aspect::STENCIL,
        level_count: vk::REMAINING_MIP_LEVELS,
        layer_count: vk::REMAINING_ARRAY_LAYERS,
        ..Default::default()
    };
    let value = |depth, stencil| vk::ClearDepthStencilValue { depth, stencil };
    clear::clear_depth_stencil_image(&from, &value(0.5, 9), &range);
    clear::clear_depth_stencil_image(&to, &value(1.0, 3), &range);
    let region = vk::ImageCopy {
        src_subresource: layers(Aspect::STENCIL, 0, 0, 1),
        dst_subresource: layers(Aspect::STENCIL, 0, 0, 1),
        extent: extent([4, 4, 1]),
        ..Default::default()
    };
    copy::copy_image(workers(), &from, &to, &region);
    assert_eq!(get(&to, Aspect::DEPTH, 0, 0, [2, 2, 0])[0], 1f32.to_bits());
    assert_eq!(get(&to, Aspect::STENCIL, 0, 0, [2, 2, 0])[0], 9);
    let depth = f32::from_bits(get(&from, Aspect::DEPTH, 0, 0, [2, 2, 0])[0]);
    assert!((depth - 0.5).abs() < 1.0 / 16_777_215.0);
}

#[test]
fn clears_cover_their_range_in_every_format() {
    for format in images::Format::all() {
        let info = format.info().unwrap();
        let is_written = info.is_color() && info.blocks().is_none();
        if !is_written || info.channels[0].bits == 64 || info.channels[0].bits == 0 {
            continue;
        }
        let raw = vk::Format::from_raw(format.0 as i32);
        let to = image(ImageSpec {
            layers: 3,
            levels: 3,
            ..kind(raw, 8, 4)
        });
        let words = if info.numeric.is_integer() {
            [1, 0, 1, 1]
        } else {
            [1.0f32, 0.0, 1.0, 1.0].map(f32::to_bits)
        };
        let value = vk::ClearColorValue { uint32: words };
        let range = vk::ImageSubresourceRange {
            aspect_mask: COLOR,
            base_mip_level: 1,
            level_count: vk::REMAINING_MIP_LEVELS,
            base_array_layer: 1,
            layer_count: 1,
        };
        let before = get(&to, COLOR, 0, 1, [1, 0, 0]);
        clear::clear_color_image(&to, &value, &range);
        assert_eq!(get(&to, COLOR, 0, 1, [1, 0, 0]), before);
        assert_eq!(get(&to, COLOR, 1, 0, [1, 0, 0]), before);
        for (level, at) in [(1, [3, 1, 0]), (2, [1, 0, 0])] {
            let got = get(&to, COLOR, level, 1, at);
            for component in 0..4 {
                if info.channels[component].bits != 0 {
                    assert_eq!(got[component], words[component], "{}", info.name);
                }
            }
        }
    }
}

#[test]
fn clears_of_64_bits_take_two_words_a_component() {
    let to = image(kind(vk::Format::R64_UINT, 2, 2));
    let range = vk::ImageSubresourceRange {
        aspect_mask: COLOR,
        level_count: 1,
        layer_count: 1,
        ..Default::default()
    };
    let value = vk::ClearColorValue {
        uint32: [1, 2, 3, 4],
    };
    clear::clear_color_image(&to, &value, &range);
    assert_eq!(get(&to, COLOR, 0, 0, [1, 1, 0])[..2], [1, 2]);
}

#[test]
fn resolves_average_samples_and_integers_take_the_first() {
    for (format, is_averaged) in [
        (vk::Format::R32_SFLOAT, true),
        (vk::Format::R32_UINT, false),
    ] {
        let from = image(ImageSpec {
            samples: vk::SampleCountFlags::TYPE_4,
            ..kind(format, 3, 2)
        });
        let to = image(kind(format, 3, 2));
        let plane = &from.planes[0];
        for sample in 0..4u64 {
            let word = if is_averaged {
                (sample as f32).to_bits()
            } else {
                10 + sample as u32
            };
            let at = plane.levels[0].offset_bytes
                + plane.levels[0].row_stride_bytes
                + sample * plane.sample_stride_bytes
                + 8;
            // SAFETY: texel (2, 1) of the sample.
            unsafe { from.data().add(at as usize).cast::<u32>().write(word) };
        }
        let region = vk::ImageResolve {
            src_subresource: layers(COLOR, 0, 0, 1),
            src_offset: offset([2, 1, 0]),
            dst_subresource: layers(COLOR, 0, 0, 1),
            dst_offset: offset([0, 0, 0]),
            extent: extent([1, 1, 1]),
        };
        let (stencil, other) = (ResolveMode::AVERAGE, ResolveMode::AVERAGE);
        resolve::resolve_image(&from, &to, &region, stencil, other);
        let expected = if is_averaged { 1.5f32.to_bits() } else { 10 };
        assert_eq!(get(&to, COLOR, 0, 0, [0, 0, 0])[0], expected);
        assert_eq!(get(&to, COLOR, 0, 0, [1, 0, 0])[0], 0xcdcd_cdcd);
    }
}

/// Resolves an image of one texel with two samples, whose first bytes are those given; returns the
/// first bytes of the result.
fn resolved<const N: usize>(
    format: vk::Format,
    aspect: vk::ImageAspectFlags,
    samples: [[u8; N]; 2],
    mode: ResolveMode,
) -> [u8; N] {
    let from = image(ImageSpec {
        samples: vk::SampleCountFlags::TYPE_2,
        ..kind(format, 1, 1)
    });
    let to = image(kind(format, 1, 1));
    let plane = from.plane(aspect).expect("the aspect's plane");
    for (sample, bytes) in (0..).zip(samples) {
        let at = plane.levels[0].offset_bytes + sample * plane.sample_stride_bytes;
        let place = from.plane_data(plane).wrapping_add(at as usize);
        // SAFETY: the only texel of the sample.
        unsafe { place.cast::<[u8; N]>().write_unaligned(bytes) };
    }
    let region = vk::ImageResolve {
        src_subresource: layers(aspect, 0, 0, 1),
        dst_subresource: layers(aspect, 0, 0, 1),
        extent: extent([1, 1, 1]),
        ..Default::default()
    };
    let none = ResolveMode::linear(vk::ResolveModeFlags::NONE);
    let is_stencil = aspect == vk::ImageAspectFlags::STENCIL;
    let (stencil, other) = if is_stencil {
        (mode, none)
    } else {
        (none, mode)
    };
    resolve::resolve_image(&from, &to, &region, stencil, other);
    let plane = to.plane(aspect).expect("the aspect's plane");
    let place = to.plane_data(plane);
    let place = place.wrapping_add(plane.levels[0].offset_bytes as usize);
    // SAFETY: the only texel.
    unsafe { place.cast::<[u8; N]>().read_unaligned() }
}

/// `VkResolveImageModeInfoKHR`.
#[test]
fn resolves_follow_their_mode() {
    use vk::ResolveModeFlags as Mode;
    let linear = linear_of_srgb(254.0 / 255.0) / 2.0;
    let mean = (srgb_of_linear(linear) * 255.0).round() as u8;
    let codes = [[0, 254, 0, 0], [254, 0, 0, 254]];
    for format in [vk::Format::R8G8B8A8_SRGB, vk::Format::A8B8G8R8_SRGB_PACK32] {
        let of = |mode| resolved(format, COLOR, codes, mode);
        assert_eq!(of(ResolveMode::AVERAGE), [mean, mean, 0, 127]);
        let encoded = ResolveMode {
            encoded_mean: true,
            ..ResolveMode::AVERAGE
        };
        assert_eq!(of(encoded), [127, 127, 0, 127]);
    }
    let depths = [0.75f32, 0.25].map(f32::to_le_bytes);
    for (mode, expected) in [
        (Mode::SAMPLE_ZERO, 0.75f32),
        (Mode::MIN, 0.25),
        (Mode::MAX, 0.75),
        (Mode::AVERAGE, 0.5),
    ] {
        let (format, aspect) = (vk::Format::D32_SFLOAT, vk::ImageAspectFlags::DEPTH);
        let found = resolved(format, aspect, depths, ResolveMode::linear(mode));
        assert_eq!(f32::from_le_bytes(found), expected, "{mode:?}");
    }
    for (mode, expected) in [(Mode::SAMPLE_ZERO, 9), (Mode::MIN, 9), (Mode::MAX, 200)] {
        for format in [vk::Format::S8_UINT, vk::Format::D32_SFLOAT_S8_UINT] {
            let aspect = vk::ImageAspectFlags::STENCIL;
            let found = resolved(format, aspect, [[9], [200]], ResolveMode::linear(mode));
            assert_eq!(found, [expected], "{mode:?}");
        }
    }
}

/// One axis of the spec's equation for a blit's source coordinates.
fn source_coordinate(d: i32, source: [i32; 2], destination: [i32; 2]) -> f64 {
    let scale = f64::from(source[1] - source[0]) / f64::from(destination[1] - destination[0]);
    (f64::from(d) + 0.5 - f64::from(destination[0])) * scale + f64::from(source[0])
}

#[test]
fn blits_scale_and_mirror() {
    let (width, height) = (13, 9);
    let from = image(kind(vk::Format::R32G32B32A32_SFLOAT, width, height));
    let value = |x: i32, y: i32| {
        let (x, y) = (
            x.clamp(0, width as i32 - 1) as f32,
            y.clamp(0, height as i32 - 1) as f32,
        );
        [x * x, y * 3.0, x + y, 1.0]
    };
    for (x, y) in (0..width as i32).flat_map(|x| (0..height as i32).map(move |y| (x, y))) {
        put(&from, COLOR, 0, 0, [x, y, 0], value(x, y).map(f32::to_bits));
    }
    for (sx, sy, dx, dy) in [
        ([0, 13], [0, 9], [0, 40], [0, 31]),
        ([0, 13], [9, 0], [2, 7], [1, 4]),
        ([12, 3], [2, 7], [1, 38], [0, 20]),
        ([3, 4], [5, 6], [30, 10], [25, 3]),
    ] {
        for filter in [vk::Filter::NEAREST, vk::Filter::LINEAR] {
            let to = image(kind(vk::Format::R32G32B32A32_SFLOAT, 40, 31));
            let region = vk::ImageBlit {
                src_subresource: layers(COLOR, 0, 0, 1),
                src_offsets: [offset([sx[0], sy[0], 0]), offset([sx[1], sy[1], 1])],
                dst_subresource: layers(COLOR, 0, 0, 1),
                dst_offsets: [offset([dx[0], dy[0], 0]), offset([dx[1], dy[1], 1])],
            };
            blit::blit_image(workers(), &from, &to, &region, filter);
            for (x, y) in (0..40).flat_map(|x| (0..31).map(move |y| (x, y))) {
                let inside =
                    |d: i32, side: [i32; 2]| d >= side[0].min(side[1]) && d < side[0].max(side[1]);
                if !inside(x, dx) || !inside(y, dy) {
                    assert_eq!(get(&to, COLOR, 0, 0, [x, y, 0])[0], 0xcdcd_cdcd);
                    continue;
                }
                let (u, v) = (source_coordinate(x, sx, dx), source_coordinate(y, sy, dy));
                let got = get_float(&to, [x, y, 0]);
                let expected: [f64; 4] = if filter == vk::Filter::NEAREST {
                    let near = |c: f64| (c - c.round()).abs() < 1e-4;
                    if near(u) || near(v) {
                        continue;
                    }
                    value(u.floor() as i32, v.floor() as i32).map(f64::from)
                } else {
                    let (fx, fy) = ((u - 0.5).floor(), (v - 0.5).floor());
                    let (wx, wy) = (u - 0.5 - fx, v - 0.5 - fy);
                    let texel = |i: i32, j: i32| value(fx as i32 + i, fy as i32 + j).map(f64::from);
                    let [a, b, c, d] = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
                    std::array::from_fn(|k| {
                        (a[k] * (1.0 - wx) + b[k] * wx) * (1.0 - wy)
                            + (c[k] * (1.0 - wx) + d[k] * wx) * wy
                    })
                };
                for k in 0..4 {
                    assert!(
                        (f64::from(got[k]) - expected[k]).abs() < 1e-3,
                        "{x} {y}: {got:?} {expected:?}"
                    );
                }
            }
        }
    }
}

/// The sRGB transfer function of the Khronos Data Format specification, and its inverse.
fn linear_of_srgb(code: f64) -> f64 {
    match code <= 0.04045 {
        true => code / 12.92,
        false => ((code + 0.055) / 1.055).powf(2.4),
    }
}

fn srgb_of_linear(linear: f64) -> f64 {
    match linear <= 0.003_130_8 {
        true => linear * 12.92,
        false => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
    }
}

#[test]
fn blits_to_half_the_size_give_the_means_of_four_texels() {
    let code = |x: i32, y: i32, layer: u32, k: usize| {
        let number = (x * 37 + y * 101 + layer as i32 * 59 + k as i32 * 83) as u32;
        (number.wrapping_mul(2_654_435_761) >> 24) as u8
    };
    let size = [71, 43];
    for format in [
        vk::Format::R8G8B8A8_UNORM,
        vk::Format::B8G8R8A8_UNORM,
        vk::Format::R8G8B8A8_SRGB,
        vk::Format::B8G8R8A8_SRGB,
    ] {
        let is_srgb = [vk::Format::R8G8B8A8_SRGB, vk::Format::B8G8R8A8_SRGB].contains(&format);
        let linear = |k: usize, code: u8| match is_srgb && k < 3 {
            true => linear_of_srgb(f64::from(code) / 255.0),
            false => f64::from(code) / 255.0,
        };
        let code_of = |k: usize, linear: f64| match is_srgb && k < 3 {
            true => srgb_of_linear(linear) * 255.0,
            false => linear * 255.0,
        };
        let of_layers = |format, [width, height]: [u32; 2]| ImageSpec {
            layers: 3,
            ..kind(format, width, height)
        };
        let from = image(of_layers(format, size));
        for (x, y) in (0..size[0] as i32).flat_map(|x| (0..size[1] as i32).map(move |y| (x, y))) {
            for layer in 0..3 {
                let texel = [0, 1, 2, 3].map(|k| linear(k, code(x, y, layer, k)));
                put(
                    &from,
                    COLOR,
                    0,
                    layer,
                    [x, y, 0],
                    texel.map(|number| (number as f32).to_bits()),
                );
            }
        }
        // Of the source, from where; of the destination, to where. The last is cut off by the
        // destination's edges.
        for (first, count, to_first) in [
            ([0, 0], [35, 21], [0, 0]),
            ([3, 2], [17, 20], [5, 1]),
            ([1, 1], [35, 21], [-4, -3]),
        ] {
            let to = image(of_layers(format, [36, 24]));
            let end = |k: usize| (first[k] + 2 * count[k], to_first[k] + count[k]);
            let region = vk::ImageBlit {
                src_subresource: layers(COLOR, 0, 1, 2),
                src_offsets: [
                    offset([first[0], first[1], 0]),
                    offset([end(0).0, end(1).0, 1]),
                ],
                dst_subresource: layers(COLOR, 0, 0, 2),
                dst_offsets: [
                    offset([to_first[0], to_first[1], 0]),
                    offset([end(0).1, end(1).1, 1]),
                ],
            };
            blit::blit_image(workers(), &from, &to, &region, vk::Filter::LINEAR);
            for (x, y) in (0..36).flat_map(|x| (0..24).map(move |y| (x, y))) {
                let at = [x - to_first[0], y - to_first[1]];
                let is_inside = (0..2).all(|k| (0..count[k]).contains(&at[k]));
                for layer in 0..3 {
                    let got = get(&to, COLOR, 0, layer, [x, y, 0]);
                    for (k, got) in got.map(f32::from_bits).into_iter().enumerate() {
                        let got = code_of(k, got.into());
                        assert!((got - got.round()).abs() < 1e-3);
                        if !is_inside || layer == 2 {
                            assert_eq!(got.round(), 205.0, "{format:?} {x} {y} {layer}");
                            continue;
                        }
                        let four = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| {
                            let (x, y) = (first[0] + 2 * at[0] + i, first[1] + 2 * at[1] + j);
                            linear(k, code(x, y, layer + 1, k))
                        });
                        let expected = code_of(k, four.iter().sum::<f64>() / 4.0);
                        let error = got.round() - expected;
                        assert!(
                            error.abs() < 0.5 + 1e-3,
                            "{format:?} {x} {y} {layer}: {error}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn blits_convert_formats_and_pair_layers() {
    let from = image(ImageSpec {
        layers: 3,
        ..kind(vk::Format::R8G8B8A8_UNORM, 2, 2)
    });
    let to = image(ImageSpec {
        layers: 3,
        ..kind(vk::Format::B8G8R8A8_SRGB, 2, 2)
    });
    let color = [0.0f32, 0.2, 0.6, 1.0];
    put(&from, COLOR, 0, 2, [1, 1, 0], color.map(f32::to_bits));
    let corners = [offset([0, 0, 0]), offset([2, 2, 1])];
    let region = vk::ImageBlit {
        src_subresource: layers(COLOR, 0, 1, 2),
        src_offsets: corners,
        dst_subresource: layers(COLOR, 0, 0, 2),
        dst_offsets: corners,
    };
    blit::blit_image(workers(), &from, &to, &region, vk::Filter::NEAREST);
    let got = get(&to, COLOR, 0, 1, [1, 1, 0]).map(f32::from_bits);
    for (got, expected) in got.iter().zip(color) {
        // Half a code of sRGB at its steepest, plus one of 8-bit unorm.
        assert!((got - expected).abs() < 0.007, "{got} {expected}");
    }
    assert_eq!(
        get(&to, COLOR, 0, 2, [1, 1, 0])[0],
        get(&to, COLOR, 0, 2, [0, 0, 0])[0]
    );

    let (from, to) = (
        image(kind(vk::Format::R32_SINT, 2, 1)),
        image(kind(vk::Format::R8_SINT, 2, 1)),
    );
    put(&from, COLOR, 0, 0, [0, 0, 0], [-5i32 as u32; 4]);
    put(&from, COLOR, 0, 0, [1, 0, 0], [1000; 4]);
    let corners = [offset([0, 0, 0]), offset([2, 1, 1])];
    let region = vk::ImageBlit {
        src_subresource: layers(COLOR, 0, 0, 1),
        src_offsets: corners,
        dst_subresource: layers(COLOR, 0, 0, 1),
        dst_offsets: corners,
    };
    blit::blit_image(workers(), &from, &to, &region, vk::Filter::NEAREST);
    assert_eq!(get(&to, COLOR, 0, 0, [0, 0, 0])[0], -5i32 as u32);
    assert_eq!(get(&to, COLOR, 0, 0, [1, 0, 0])[0], 127);
}

#[test]
fn volumes_are_scaled_in_depth() {
    let volume = |depth| ImageSpec {
        ty: vk::ImageType::TYPE_3D,
        extent: [1, 1, depth],
        ..kind(vk::Format::R32_SFLOAT, 0, 0)
    };
    let (from, to) = (image(volume(2)), image(volume(4)));
    put(&from, COLOR, 0, 0, [0, 0, 0], [0; 4]);
    put(&from, COLOR, 0, 0, [0, 0, 1], [1f32.to_bits(); 4]);
    let region = vk::ImageBlit {
        src_subresource: layers(COLOR, 0, 0, 1),
        src_offsets: [offset([0, 0, 0]), offset([1, 1, 2])],
        dst_subresource: layers(COLOR, 0, 0, 1),
        dst_offsets: [offset([0, 0, 4]), offset([1, 1, 0])],
    };
    blit::blit_image(workers(), &from, &to, &region, vk::Filter::LINEAR);
    let got = [0, 1, 2, 3].map(|z| get_float(&to, [0, 0, z])[0]);
    assert_eq!(got, [1.0, 0.75, 0.25, 0.0]);
}
