//! The common sample, with as few passes over the lanes as possible: a 2D image, averaged, without comparison, offsets, border or derivatives. Gives the
//! same results as [`sample`](super::sample), bit for bit.

use super::address::{Floats, Ints};
use super::execute::{Operands, put_texels};
use super::format::FormatInfo;
use super::format::block::{self, Texels, map};
use super::format::layout::Codec;
use super::lod::{self, LevelLanes};
use super::{
    AddressMode, Dim, Filter, ImageDescriptor, ImageOp, ImageOpKind, LodMode, Reduction,
    SamplerDescriptor,
};
use crate::SUBGROUP_SIZE;
use crate::program::Row;

/// Whether [`sample`] serves.
#[inline(always)]
pub(super) fn applies(
    op: &ImageOp,
    image: &ImageDescriptor,
    info: &FormatInfo,
    sampler: &SamplerDescriptor,
) -> bool {
    let plain_mode = |mode: AddressMode| {
        matches!(
            mode,
            AddressMode::Repeat | AddressMode::ClampToEdge | AddressMode::MirroredRepeat
        )
    };
    op.kind == ImageOpKind::Sample
        && op.dim == Dim::D2
        && !op.depth_compare
        && !op.has_offset
        && !op.has_min_lod
        && op.lod != LodMode::Grad
        && !sampler.unnormalized_coordinates
        && sampler.mag_filter == sampler.min_filter
        && sampler.reduction == Reduction::WeightedAverage
        && plain_mode(sampler.address_mode[0])
        && plain_mode(sampler.address_mode[1])
        && !info.numeric.is_integer()
        && image.size_bytes <= u32::MAX as u64
}

/// Byte offsets of an axis's two texels, and the second one's weight.
struct Axis {
    offsets: [[u32; SUBGROUP_SIZE]; 2],
    weight: Floats,
}

/// One axis by a rule for coordinates and one for indices, in one loop.
#[inline(always)]
fn axis(
    shift: f32,
    coordinates: &Floats,
    sizes: &Ints,
    strides: &[u32; SUBGROUP_SIZE],
    scale: impl Fn(f32, f32) -> f32,
    wrap: impl Fn(i32, i32) -> i32,
) -> Axis {
    let mut axis = Axis {
        offsets: [[0; SUBGROUP_SIZE]; 2],
        weight: [0.0; SUBGROUP_SIZE],
    };
    for lane in 0..SUBGROUP_SIZE {
        let size = sizes[lane];
        let texel = scale(coordinates[lane], size as f32) - shift;
        let floor = texel.floor();
        let first = floor as i32;
        let clamped = |i: i32| wrap(i, size).max(0).min(size - 1) as u32;
        axis.weight[lane] = texel - floor;
        axis.offsets[0][lane] = clamped(first).wrapping_mul(strides[lane]);
        axis.offsets[1][lane] = clamped(first.wrapping_add(1)).wrapping_mul(strides[lane]);
    }
    axis
}

#[inline(always)]
fn address(
    mode: AddressMode,
    shift: f32,
    coordinates: &Floats,
    sizes: &Ints,
    strides: &[u32; SUBGROUP_SIZE],
) -> Axis {
    match mode {
        AddressMode::Repeat => axis(
            shift,
            coordinates,
            sizes,
            strides,
            |s, size| (s - s.floor()) * size,
            |i, size| {
                let i = if i < 0 { i + size } else { i };
                if i >= size { i.wrapping_sub(size) } else { i }
            },
        ),
        AddressMode::MirroredRepeat => axis(
            shift,
            coordinates,
            sizes,
            strides,
            |s, size| (s - 2.0 * (s * 0.5).floor()) * size,
            |i, size| {
                // Reduced to -1..=2 size: the ends reflect to the first texel.
                let i = if i < 0 { !i } else { i };
                let mirrored = 2 * size - 1 - i;
                if i < size { i } else { mirrored }
            },
        ),
        _ => axis(
            shift,
            coordinates,
            sizes,
            strides,
            // Far enough outside for both texels to be the edge's.
            |s, size| (s * size).max(-size - 64.0).min(size + 64.0),
            |i, _| i,
        ),
    }
}

/// `a + w (b - a)`.
#[inline(always)]
fn lerp(a: f32, b: f32, w: f32) -> f32 {
    a + w * (b - a)
}

/// A level's texels in units. `offsets` are those of the level, the layer included.
///
/// # Safety
/// All offsets that the axes give are of texels of the image.
#[inline(always)]
unsafe fn filtered(
    info: &FormatInfo,
    data: *const u8,
    filter: Filter,
    level_offsets: &[u32; SUBGROUP_SIZE],
    x: &Axis,
    y: &Axis,
) -> Texels {
    let offsets = |i: usize, j: usize| {
        let mut sum = [0u32; SUBGROUP_SIZE];
        for lane in 0..SUBGROUP_SIZE {
            sum[lane] = level_offsets[lane]
                .wrapping_add(x.offsets[i][lane])
                .wrapping_add(y.offsets[j][lane]);
        }
        sum
    };
    // SAFETY (of all loads): the caller's promise.
    if filter == Filter::Nearest {
        // SAFETY: as above.
        return unsafe { block::load(info, data, &offsets(0, 0)) };
    }
    let mut texels = [[0; SUBGROUP_SIZE]; 4];
    if matches!(info.codec, Codec::Unorm8(4) | Codec::Bgra8) {
        // SAFETY: as above.
        let [a, b, c, d] = unsafe {
            [
                block::gather::<u32, u32>(data, &offsets(0, 0), 0),
                block::gather::<u32, u32>(data, &offsets(1, 0), 0),
                block::gather::<u32, u32>(data, &offsets(0, 1), 0),
                block::gather::<u32, u32>(data, &offsets(1, 1), 0),
            ]
        };
        for (row, channel) in texels.iter_mut().zip(&info.channels) {
            let shift = channel.offset as u32;
            let units = |word: u32| ((word >> shift & 0xff) as i32) as f32;
            for lane in 0..SUBGROUP_SIZE {
                let upper = lerp(units(a[lane]), units(b[lane]), x.weight[lane]);
                let lower = lerp(units(c[lane]), units(d[lane]), x.weight[lane]);
                row[lane] = lerp(upper, lower, y.weight[lane]).to_bits();
            }
        }
        return texels;
    }
    let mut taps = [[[0; SUBGROUP_SIZE]; 4]; 4];
    for (tap, texels) in taps.iter_mut().enumerate() {
        // SAFETY: as above.
        *texels = unsafe { block::load(info, data, &offsets(tap & 1, tap >> 1)) };
    }
    for (component, row) in texels.iter_mut().enumerate() {
        if info.channels[component].bits == 0 {
            continue;
        }
        let [a, b, c, d] = [
            &taps[0][component],
            &taps[1][component],
            &taps[2][component],
            &taps[3][component],
        ];
        for lane in 0..SUBGROUP_SIZE {
            let f = f32::from_bits;
            let upper = lerp(f(a[lane]), f(b[lane]), x.weight[lane]);
            let lower = lerp(f(c[lane]), f(d[lane]), x.weight[lane]);
            row[lane] = lerp(upper, lower, y.weight[lane]).to_bits();
        }
    }
    texels
}

/// `OpImageSample*` where it [`applies`].
///
/// # Safety
/// The image's memory stays allocated during the call.
#[inline(always)]
pub(super) unsafe fn sample(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    info: &FormatInfo,
    sampler: &SamplerDescriptor,
    mask: u16,
    results: &mut [Row],
) {
    let u = lod::floats(operands.coordinates[0]);
    let v = lod::floats(operands.coordinates[1]);
    let last_level = (image.level_count - 1) as f32;
    let has_operand = op.lod != LodMode::Implicit;
    let is_bias = op.lod == LodMode::Bias;
    // λ' to d', as in `lod`.
    let mut levels = [0.0; SUBGROUP_SIZE];
    for lane in 0..SUBGROUP_SIZE {
        let operand = if has_operand {
            f32::from_bits(operands.lod[0][lane])
        } else {
            0.0
        };
        let (base, extra) = if is_bias {
            (0.0, operand)
        } else {
            (operand, 0.0)
        };
        let bias = (sampler.mip_lod_bias + extra)
            .max(-lod::MAX_LOD_BIAS)
            .min(lod::MAX_LOD_BIAS);
        let lambda = (base + bias).min(sampler.max_lod).max(sampler.min_lod);
        levels[lane] = lambda.max(0.0).max(image.min_lod).min(last_level);
    }
    let (level, weight) = lod::split(sampler.mipmap_mode, &levels);
    // Inactive lanes follow the first active one.
    let first = mask.trailing_zeros() as usize & 15;
    let (mut differ, mut between) = (0u32, 0u32);
    for lane in 0..SUBGROUP_SIZE {
        let active = (mask as u32 >> lane) & 1;
        differ |= active & (level[lane] != level[first]) as u32;
        between |= active & (weight[lane] > 0.0) as u32;
    }
    let layer_offset = layer_offsets(op, operands, image);
    let shift = if sampler.mag_filter == Filter::Linear {
        0.5
    } else {
        0.0
    };
    let texel_bytes = [info.size_bytes as u32; SUBGROUP_SIZE];
    let mut texels = [[0; SUBGROUP_SIZE]; 4];
    for pass in 0..1 + between as i32 {
        let is_uniform = differ == 0;
        let of_pass = if is_uniform {
            [(level[first] + pass).min(last_level as i32); SUBGROUP_SIZE]
        } else {
            map(&level, |d| (d + pass).min(last_level as i32))
        };
        let lanes = LevelLanes::new(image, &of_pass, is_uniform);
        let rows = map(&lanes.row_stride_bytes, |stride| stride as u32);
        let mut level_offsets = layer_offset;
        for lane in 0..SUBGROUP_SIZE {
            level_offsets[lane] = level_offsets[lane].wrapping_add(lanes.offset_bytes[lane] as u32);
        }
        let x = address(
            sampler.address_mode[0],
            shift,
            &u,
            &lanes.size[0],
            &texel_bytes,
        );
        let y = address(sampler.address_mode[1], shift, &v, &lanes.size[1], &rows);
        // SAFETY: indices are inside the level and layers inside the view, so that each offset is of a texel of the image; sums fit in 32 bits, as
        // the image's size does.
        let of_level =
            unsafe { filtered(info, image.data, sampler.mag_filter, &level_offsets, &x, &y) };
        if pass == 0 {
            texels = of_level;
        } else {
            for (row, next) in texels.iter_mut().zip(&of_level) {
                for lane in 0..SUBGROUP_SIZE {
                    let (a, b) = (f32::from_bits(row[lane]), f32::from_bits(next[lane]));
                    row[lane] = lerp(a, b, weight[lane]).to_bits();
                }
            }
        }
    }
    block::finish(info, &mut texels);
    super::sample::swizzle(image, info, &mut texels);
    put_texels(op, info, &texels, results);
}

/// Offsets of the lanes' layers.
#[inline(always)]
fn layer_offsets(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
) -> [u32; SUBGROUP_SIZE] {
    let mut offsets = [0; SUBGROUP_SIZE];
    if op.arrayed {
        let last = image.layer_count.max(1) as i32 - 1;
        for lane in 0..SUBGROUP_SIZE {
            let layer = f32::from_bits(operands.coordinates[2][lane]).round_ties_even();
            let layer = (layer as i32).max(0).min(last) as u32;
            offsets[lane] = layer.wrapping_mul(image.layer_stride_bytes as u32);
        }
    }
    offsets
}
