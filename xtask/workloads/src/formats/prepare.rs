//! Cells made ready: images, samplers, kernels and draws.

use tuff_tests::{Bound, Buffer, Gpu, Kernel, Painting, Pass, Set, Stage, vk};

use super::table::FormatEntry;
use super::{Access, HEIGHT, Shape, TURNS, WIDTH};
use crate::shader;
use crate::workload::borrowed;

/// A cell that is ready to run, again and again.
pub struct Prepared {
    pub turn: vk::CommandBuffer,
    /// Reads the target into the picture where the turn does not.
    pub look: Option<vk::CommandBuffer>,
    /// Four floats a pixel.
    pub picture: Buffer,
}

/// Blits of a turn.
const BLITS: u32 = 8;
/// Layers of a blended picture, each of one triangle.
const LAYERS: u32 = 8;

const VERTEX: &str = "
    void main() {
        int corner = gl_VertexIndex % 3;
        gl_Position = vec4(corner == 1 ? 3.0 : -1.0, corner == 2 ? 3.0 : -1.0, 0.5, 1.0);
    }";
const FRAGMENT: &str = "
    layout(location = 0) out vec4 color;
    void main() { color = vec4(gl_FragCoord.xy / 256.0, 0.6, 0.25); }";

/// `None` where the driver lacks what the cell needs.
pub fn prepare(gpu: &Gpu, row: &FormatEntry, access: Access, shape: Shape) -> Option<Prepared> {
    use vk::FormatFeatureFlags as Feature;
    let linear = Feature::SAMPLED_IMAGE_FILTER_LINEAR;
    let of_access = match access {
        Access::Fetch | Access::Nearest | Access::Gather => Feature::empty(),
        Access::Linear | Access::Trilinear => linear,
        Access::Shadow if !row.is_depth() => return None,
        Access::Shadow => linear,
        Access::Store => Feature::STORAGE_IMAGE,
        Access::Blend => Feature::COLOR_ATTACHMENT_BLEND,
        Access::Blit => Feature::BLIT_SRC | Feature::BLIT_DST,
    };
    if !gpu.supports(row.0, of_access | Feature::SAMPLED_IMAGE) {
        return None;
    }
    match access {
        Access::Store => store(gpu, row),
        Access::Blend => blend(gpu, row),
        Access::Blit => blit(gpu, row),
        _ => sample(gpu, row, access, shape),
    }
}

fn sample(gpu: &Gpu, row: &FormatEntry, access: Access, shape: Shape) -> Option<Prepared> {
    let has_levels = access == Access::Trilinear;
    let usage = vk::ImageUsageFlags::SAMPLED;
    let (_, view) = image(gpu, row, shape, has_levels, usage)?;
    let reading = Reading::of(gpu, row, access, shape, view);
    Some(Prepared {
        turn: reading.turn(gpu),
        look: None,
        picture: reading.picture,
    })
}

fn store(gpu: &Gpu, row: &FormatEntry) -> Option<Prepared> {
    if gpu.features.shader_storage_image_write_without_format != vk::TRUE {
        return None;
    }
    let usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::STORAGE;
    let (_, view) = image(gpu, row, Shape::Flat, false, usage)?;
    let reading = Reading::of(gpu, row, Access::Fetch, Shape::Flat, view);
    let bindings = [
        (0, [Bound::Storage(reading.picture)]),
        (1, [Bound::StorageImage(view)]),
    ];
    let kernel = kernel(gpu, row, Access::Store, Shape::Flat, &bindings);
    Some(Prepared {
        turn: dispatch(gpu, kernel),
        look: Some(reading.turn(gpu)),
        picture: reading.picture,
    })
}

fn blend(gpu: &Gpu, row: &FormatEntry) -> Option<Prepared> {
    if !gpu.has_graphics() || gpu.features13.dynamic_rendering != vk::TRUE {
        return None;
    }
    let canvas = gpu.canvas(row.0, WIDTH, WIDTH);
    let reading = Reading::of(gpu, row, Access::Fetch, Shape::Flat, canvas.view);
    let mut painting = Painting::new(gpu, VERTEX, FRAGMENT, row.0);
    painting.blend = vec![
        vk::PipelineColorBlendAttachmentState::default()
            .color_write_mask(vk::ColorComponentFlags::RGBA)
            .blend_enable(true)
            .src_color_blend_factor(vk::BlendFactor::SRC_ALPHA)
            .dst_color_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
            .src_alpha_blend_factor(vk::BlendFactor::ONE)
            .dst_alpha_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA),
    ];
    let pipeline = gpu.painting(&painting);
    let turn = gpu.record(|commands| {
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, 3 * LAYERS);
        });
        gpu.barrier(commands);
    });
    Some(Prepared {
        turn,
        look: Some(reading.turn(gpu)),
        picture: reading.picture,
    })
}

fn blit(gpu: &Gpu, row: &FormatEntry) -> Option<Prepared> {
    let usage = vk::ImageUsageFlags::SAMPLED;
    let [from, to] = [(); 2].map(|()| image(gpu, row, Shape::Flat, false, usage));
    let ((from, _), (to, view)) = (from?, to?);
    let reading = Reading::of(gpu, row, Access::Fetch, Shape::Flat, view);
    let is_linear = row.prefix().is_empty()
        && !row.is_depth()
        && gpu.supports(row.0, vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR);
    let filter = match is_linear {
        true => vk::Filter::LINEAR,
        false => vk::Filter::NEAREST,
    };
    let layers = vk::ImageSubresourceLayers::default()
        .aspect_mask(row.aspects()[0])
        .layer_count(1);
    let corner = |side: u32| vk::Offset3D {
        x: side as i32,
        y: side as i32,
        z: 1,
    };
    let general = vk::ImageLayout::GENERAL;
    let turn = gpu.record(|commands| {
        for number in 0..BLITS {
            let region = vk::ImageBlit::default()
                .src_subresource(layers)
                .dst_subresource(layers)
                .src_offsets([vk::Offset3D::default(), corner(200 + number)])
                .dst_offsets([vk::Offset3D::default(), corner(WIDTH)]);
            // SAFETY: the command buffer is being recorded, and the regions lie in the images.
            unsafe {
                let device = &gpu.device;
                device.cmd_blit_image(commands, from, general, to, general, &[region], filter);
            }
            gpu.barrier(commands);
        }
    });
    Some(Prepared {
        turn,
        look: Some(reading.turn(gpu)),
        picture: reading.picture,
    })
}

/// A kernel that reads a view into a picture.
struct Reading {
    picture: Buffer,
    kernel: (Kernel, Set),
}

impl Reading {
    fn of(
        gpu: &Gpu,
        row: &FormatEntry,
        access: Access,
        shape: Shape,
        view: vk::ImageView,
    ) -> Reading {
        let filter = match access {
            Access::Linear | Access::Trilinear | Access::Shadow => vk::Filter::LINEAR,
            _ => vk::Filter::NEAREST,
        };
        let mut info = vk::SamplerCreateInfo::default()
            .mag_filter(filter)
            .min_filter(filter);
        match access {
            Access::Trilinear => {
                info = info
                    .mipmap_mode(vk::SamplerMipmapMode::LINEAR)
                    .max_lod(vk::LOD_CLAMP_NONE);
            }
            Access::Shadow => {
                info = info
                    .compare_enable(true)
                    .compare_op(vk::CompareOp::LESS_OR_EQUAL);
            }
            _ => {}
        }
        let picture = gpu.buffer(u64::from(WIDTH * HEIGHT) * 16);
        let bindings = [
            (0, [Bound::Storage(picture)]),
            (1, [Bound::Sampled(view, gpu.sampler(&info))]),
        ];
        Reading {
            picture,
            kernel: kernel(gpu, row, access, shape, &bindings),
        }
    }

    fn turn(&self, gpu: &Gpu) -> vk::CommandBuffer {
        let (kernel, set) = &self.kernel;
        dispatch(gpu, (*kernel, *set))
    }
}

fn kernel(
    gpu: &Gpu,
    row: &FormatEntry,
    access: Access,
    shape: Shape,
    bindings: &[(u32, [Bound; 1])],
) -> (Kernel, Set) {
    let set = gpu.set(&borrowed(bindings));
    let source = source(row.prefix(), access, shape);
    let words = shader::glsl(Stage::Compute, &source);
    (gpu.kernel_of(&words, &[set.layout]), set)
}

fn dispatch(gpu: &Gpu, (kernel, set): (Kernel, Set)) -> vk::CommandBuffer {
    gpu.record(|commands| {
        let groups = [WIDTH / 8, HEIGHT / 8, 1];
        gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], groups);
        gpu.barrier(commands);
    })
}

/// The shader of a cell of a format of floats (no prefix) or integers (`i`, `u`).
pub fn source(prefix: &str, access: Access, shape: Shape) -> String {
    let define = match access {
        Access::Fetch => "FETCH",
        Access::Nearest | Access::Linear => "SAMPLE",
        Access::Trilinear => "LEVELS",
        Access::Gather => "GATHER",
        Access::Shadow => "SHADOW",
        _ => "STORE",
    };
    let dimension = match shape {
        Shape::Flat => "2D",
        Shape::Volume => "3D",
        Shape::Cube => "Cube",
        Shape::Array => "2DArray",
    };
    let resource = match access {
        Access::Store => format!("{prefix}image{dimension}"),
        Access::Shadow => format!("{prefix}sampler{dimension}Shadow"),
        _ => format!("{prefix}sampler{dimension}"),
    };
    let names = ["FETCH", "SAMPLE", "LEVELS", "GATHER", "SHADOW", "STORE"];
    let names = names.iter().enumerate();
    let names: String = names
        .map(|(number, name)| format!("#define {name} {number}\n"))
        .collect();
    format!(
        "{names}#define ACCESS {define}\n#define SHAPE {}\n#define RESOURCE {resource}\n\
         #define COMPONENTS {prefix}vec4\n#define INTEGERS {}\n#define TURNS {TURNS}\n{}",
        shape as u32,
        u32::from(!prefix.is_empty()),
        shader::FORMATS,
    )
}

/// Fills a level of this size with texels.
fn fill_level(
    gpu: &Gpu,
    row: &FormatEntry,
    image: vk::Image,
    level: u32,
    [side, depth, layers]: [u32; 3],
) {
    let blocks = |side: u32| (side.div_ceil(row.block_side())) as usize;
    let count = blocks(side) * blocks(side) * depth as usize * layers as usize;
    let buffer = gpu.buffer_with(&row.texels(count));
    let copy = vk::BufferImageCopy::default()
        .image_subresource(
            vk::ImageSubresourceLayers::default()
                .aspect_mask(row.aspects()[0])
                .mip_level(level)
                .layer_count(layers),
        )
        .image_extent(vk::Extent3D {
            width: side,
            height: side,
            depth,
        });
    gpu.run(|commands| {
        let general = vk::ImageLayout::GENERAL;
        // SAFETY: the command buffer is being recorded, and the buffer covers the level.
        unsafe {
            (gpu.device).cmd_copy_buffer_to_image(commands, buffer.handle, image, general, &[copy]);
        }
    });
}

/// A filled image and the view that is sampled.
fn image(
    gpu: &Gpu,
    row: &FormatEntry,
    shape: Shape,
    has_levels: bool,
    usage: vk::ImageUsageFlags,
) -> Option<(vk::Image, vk::ImageView)> {
    let (kind, side, depth, layers) = match shape {
        Shape::Flat => (vk::ImageViewType::TYPE_2D, 256, 1, 1),
        Shape::Volume => (vk::ImageViewType::TYPE_3D, 64, 64, 1),
        Shape::Cube => (vk::ImageViewType::CUBE, 64, 1, 6),
        Shape::Array => (vk::ImageViewType::TYPE_2D_ARRAY, 128, 1, 4u32),
    };
    // Down to whole blocks.
    let levels = match has_levels {
        true => 5,
        false => 1,
    };
    let usage = usage | vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
    let (dimensions, flags) = match shape {
        Shape::Volume => (vk::ImageType::TYPE_3D, vk::ImageCreateFlags::empty()),
        Shape::Cube => (
            vk::ImageType::TYPE_2D,
            vk::ImageCreateFlags::CUBE_COMPATIBLE,
        ),
        _ => (vk::ImageType::TYPE_2D, vk::ImageCreateFlags::empty()),
    };
    // SAFETY: a plain query.
    let limits = unsafe {
        gpu.instance.get_physical_device_image_format_properties(
            gpu.physical,
            row.0,
            dimensions,
            vk::ImageTiling::OPTIMAL,
            usage,
            flags,
        )
    };
    let _ = limits.ok()?;
    let info = vk::ImageCreateInfo::default()
        .flags(flags)
        .image_type(dimensions)
        .format(row.0)
        .extent(vk::Extent3D {
            width: side,
            height: side,
            depth,
        })
        .mip_levels(levels)
        .array_layers(layers)
        .samples(vk::SampleCountFlags::TYPE_1)
        .usage(usage);
    let image = gpu.image(&info);
    let [sampled, other] = row.aspects();
    let range = vk::ImageSubresourceRange::default()
        .level_count(levels)
        .layer_count(layers);
    gpu.to_general(image, range.aspect_mask(sampled | other));
    for level in 0..levels {
        let [side, depth] = [side, depth].map(|side| (side >> level).max(1));
        fill_level(gpu, row, image, level, [side, depth, layers]);
    }
    let info = vk::ImageViewCreateInfo::default()
        .image(image)
        .view_type(kind)
        .format(row.0)
        .subresource_range(range.aspect_mask(sampled));
    Some((image, gpu.view(&info)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::ACCESSES;

    #[test]
    fn every_cell_has_a_shader() {
        let others = [Access::Blend, Access::Blit];
        for access in ACCESSES.into_iter().filter(|it| !others.contains(it)) {
            for &shape in access.shapes() {
                for prefix in ["", "i", "u"] {
                    if !(access == Access::Shadow && !prefix.is_empty()) {
                        let words = shader::glsl(Stage::Compute, &source(prefix, access, shape));
                        assert!(!words.is_empty(), "{access:?} {shape:?} {prefix}");
                    }
                }
            }
        }
    }
}
