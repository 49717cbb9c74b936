//! Levels of detail (spec, "Level-of-Detail Operation", "Image Level(s) Selection").
#![forbid(unsafe_code)]

use lanes::{LANES, Row, bounds, map};

use super::address::{Floats, Ints};
use super::cube;
use super::operands::Operands;
use super::{Dim, Filter, ImageDescriptor, ImageOp, Level, LodMode, SamplerDescriptor};

/// `maxSamplerLodBias`: bias is clamped to it.
pub const MAX_LOD_BIAS: f32 = 16.0;
/// `maxSamplerAnisotropy`.
pub const MAX_ANISOTROPY: f32 = 16.0;

/// A level of detail per lane, before the sampler's clamp (λ'), and the data for anisotropic
/// filtering.
pub(super) struct Lod {
    pub lambda: Floats,
    pub anisotropy: Option<Anisotropy>,
}

/// Sampling along the longer axis of a pixel's footprint.
pub(super) struct Anisotropy {
    /// Samples to take.
    pub count: Ints,
    /// The axis, in normalised coordinates.
    pub axis: [Floats; 3],
}

impl Anisotropy {
    /// The most samples that some lane of the mask takes.
    #[inline(always)]
    pub(super) fn passes(&self, mask: u16) -> i32 {
        let mut most = 1;
        for lane in 0..LANES {
            if mask >> lane & 1 == 1 {
                most = most.max(self.count[lane]);
            }
        }
        most
    }

    /// The lanes that take the sample of an index.
    #[inline(always)]
    pub(super) fn taking(&self, sample_index: i32) -> u16 {
        (0..LANES).fold(0, |lanes, lane| {
            lanes | u16::from(sample_index < self.count[lane]) << lane
        })
    }
}

/// √½ as a float's bits.
pub(super) const SQRT_HALF: u32 = 0x3f35_04f3;
/// 2 / ln 2 times the series of the inverse hyperbolic tangent, by even powers.
pub(super) const SERIES: [f32; 5] = [2.885_39, 0.961_796_7, 0.577_078, 0.412_198_6, 0.320_598_9];

/// Binary logarithm to about 1e-7 absolute, from additions, products and one quotient, so that it
/// is the same everywhere. For 0 and infinity: very small and very large.
#[inline(always)]
fn log2(x: f32) -> f32 {
    // Mantissa in [√½, √2), exponent to match.
    let bits = x.to_bits().wrapping_sub(SQRT_HALF);
    let exponent = (bits as i32) >> 23;
    let m = f32::from_bits((bits & 0x007f_ffff).wrapping_add(SQRT_HALF));
    let t = (m - 1.0) / (m + 1.0);
    let t2 = t * t;
    let [a, b, c, d, e] = SERIES;
    let series = a + t2 * (b + t2 * (c + t2 * (d + t2 * e)));
    exponent as f32 + t * series
}

/// Whether a sampler takes several samples along a footprint.
#[inline(always)]
pub(super) fn is_anisotropic(sampler: &SamplerDescriptor) -> bool {
    most_samples(sampler) > 1.0
}

/// `maxAnisotropy`, as far as the device goes.
#[inline(always)]
pub(super) fn most_samples(sampler: &SamplerDescriptor) -> f32 {
    sampler.max_anisotropy.min(MAX_ANISOTROPY)
}

/// The second one, if either is no number: as vectors have it.
#[inline(always)]
fn longer(x: f32, y: f32) -> f32 {
    if x > y { x } else { y }
}

/// λ' of a footprint, by derivatives for each axis of the screen and of an image of this size, and
/// its samples, if there may be more than one.
#[inline(always)]
fn of_footprint(derivatives: &[[Floats; 3]; 2], size: [f32; 3], most: f32) -> Lod {
    let mut squares = [[0.0; LANES]; 2];
    for (axes, square) in derivatives.iter().zip(&mut squares) {
        for (row, size) in axes.iter().zip(size) {
            for lane in 0..LANES {
                let texels = row[lane] * size;
                square[lane] += texels * texels;
            }
        }
    }
    let mut lambda = [0.0; LANES];
    // The half of the logarithm of a square saves the root.
    for lane in 0..LANES {
        lambda[lane] = 0.5 * log2(longer(squares[0][lane], squares[1][lane]));
    }
    if most.is_nan() || most <= 1.0 {
        return Lod {
            lambda,
            anisotropy: None,
        };
    }
    let mut count = [1; LANES];
    let mut axis = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        let (x, y) = (squares[0][lane], squares[1][lane]);
        let most_squared = longer(x, y);
        let ratio = (most_squared / if x < y { x } else { y }).sqrt();
        // A NaN of 0 / 0 becomes 1. One for each texel along the axis is enough.
        let texels = most_squared.sqrt().ceil().max(1.0);
        let samples = ratio.ceil().max(1.0).min(most.ceil()).min(texels);
        count[lane] = samples as i32;
        // λ of the footprint divided among the samples.
        lambda[lane] -= log2(ratio.max(1.0).min(most));
        for (i, axis) in axis.iter_mut().enumerate() {
            let [along_x, along_y] = [derivatives[0][i][lane], derivatives[1][i][lane]];
            axis[lane] = if y > x { along_y } else { along_x };
        }
    }
    Lod {
        lambda,
        anisotropy: Some(Anisotropy { count, axis }),
    }
}

/// λ' per lane.
#[inline(always)]
pub(super) fn lod(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    sampler: &SamplerDescriptor,
) -> Lod {
    let mut lod = match op.lod {
        LodMode::Implicit | LodMode::Bias => Lod {
            lambda: [0.0; LANES],
            anisotropy: None,
        },
        LodMode::Lod => Lod {
            lambda: floats(operands.lod[0]),
            anisotropy: None,
        },
        LodMode::Grad => from_gradients(op, operands, image, sampler),
    };
    for lane in 0..LANES {
        let bias = match op.lod {
            LodMode::Bias => sampler.mip_lod_bias + f32::from_bits(operands.lod[0][lane]),
            _ => sampler.mip_lod_bias,
        };
        lod.lambda[lane] += bounds::min(bounds::max(bias, -MAX_LOD_BIAS), MAX_LOD_BIAS);
    }
    lod
}

/// λ: λ' clamped by the sampler and by the operation's own minimum.
#[inline(always)]
pub(super) fn clamp(lambda: &Floats, sampler: &SamplerDescriptor, min_lod: Option<&Row>) -> Floats {
    let mut clamped = [0.0; LANES];
    for lane in 0..LANES {
        let least = match min_lod {
            Some(row) => bounds::max(sampler.min_lod, f32::from_bits(row[lane])),
            None => sampler.min_lod,
        };
        clamped[lane] = bounds::max(bounds::min(lambda[lane], sampler.max_lod), least);
    }
    clamped
}

/// d' of the levels section, relative to the view's base level.
#[inline(always)]
pub(super) fn levels(lambda: &Floats, image: &ImageDescriptor) -> Floats {
    let last = (image.level_count - 1) as f32;
    map(lambda, |lambda| {
        let least = bounds::max(bounds::max(lambda, 0.0), image.min_lod);
        bounds::min(least, last)
    })
}

/// The nearest level to d'; of two, the smaller image, as Direct3D requires. Vulkan allows both
/// (`nearest(d')`).
#[inline(always)]
pub(super) fn nearest(level: f32) -> f32 {
    (level + 0.5).floor()
}

#[inline(always)]
pub(super) fn floats(row: &Row) -> Floats {
    map(row, f32::from_bits)
}

#[inline(always)]
pub(super) fn words(values: &Floats) -> Row {
    let mut row = [0; LANES];
    for lane in 0..LANES {
        row[lane] = values[lane].to_bits();
    }
    row
}

/// From derivatives: the length of the footprint in texels of the base level.
#[inline(always)]
pub(super) fn from_gradients(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    sampler: &SamplerDescriptor,
) -> Lod {
    let count = op.spatial_count();
    // derivatives[axis of the screen][axis of the image]
    let mut derivatives = [[[0.0; LANES]; 3]; 2];
    for (screen, axes) in derivatives.iter_mut().enumerate() {
        for (axis, row) in axes.iter_mut().enumerate().take(count) {
            *row = floats(operands.lod[screen * count + axis]);
        }
    }
    if op.dim == Dim::Cube {
        let direction: [Floats; 3] = std::array::from_fn(|i| floats(operands.coordinates[i]));
        let place = cube::place([&direction[0], &direction[1], &direction[2]]);
        for axes in &mut derivatives {
            for lane in 0..LANES {
                let on_face = cube::face_derivative(
                    place.face[lane],
                    direction.map(|row| row[lane]),
                    axes.map(|row| row[lane]),
                );
                axes[0][lane] = on_face[0];
                axes[1][lane] = on_face[1];
                axes[2][lane] = 0.0;
            }
        }
    }
    let Level {
        width,
        height,
        depth,
        ..
    } = image.levels[0];
    let size = match op.dim {
        Dim::D1 | Dim::Buffer => [width as f32, 0.0, 0.0],
        Dim::D2 | Dim::Cube => [width as f32, height as f32, 0.0],
        Dim::D3 => [width as f32, height as f32, depth as f32],
    };
    let most = match op.dim {
        Dim::Cube => 1.0,
        _ => most_samples(sampler),
    };
    of_footprint(&derivatives, size, most)
}

/// The levels' geometry, a lane each.
pub(super) struct LevelLanes {
    pub size: [Ints; 3],
    pub offset_bytes: [u64; LANES],
    pub row_stride_bytes: [u64; LANES],
    pub slice_stride_bytes: [u64; LANES],
}

impl LevelLanes {
    /// Levels are in range in every lane; `is_uniform` says that they are all the first lane's.
    #[inline(always)]
    pub fn new(image: &ImageDescriptor, levels: &Ints, is_uniform: bool) -> LevelLanes {
        if is_uniform {
            let level = &image.levels[levels[0] as usize];
            return LevelLanes {
                size: [
                    [level.width as i32; LANES],
                    [level.height as i32; LANES],
                    [level.depth as i32; LANES],
                ],
                offset_bytes: [level.offset_bytes; LANES],
                row_stride_bytes: [level.row_stride_bytes; LANES],
                slice_stride_bytes: [level.slice_stride_bytes; LANES],
            };
        }
        let mut lanes = LevelLanes {
            size: [[1; LANES]; 3],
            offset_bytes: [0; LANES],
            row_stride_bytes: [0; LANES],
            slice_stride_bytes: [0; LANES],
        };
        for lane in 0..LANES {
            let level = &image.levels[levels[lane] as usize];
            lanes.size[0][lane] = level.width as i32;
            lanes.size[1][lane] = level.height as i32;
            lanes.size[2][lane] = level.depth as i32;
            lanes.offset_bytes[lane] = level.offset_bytes;
            lanes.row_stride_bytes[lane] = level.row_stride_bytes;
            lanes.slice_stride_bytes[lane] = level.slice_stride_bytes;
        }
        lanes
    }
}

/// Integer and fraction of d' for a mipmap mode: the level, and the next one's weight.
#[inline(always)]
pub(super) fn split(mode: Filter, levels: &Floats) -> (Ints, Floats) {
    match mode {
        Filter::Nearest => (map(levels, |d| nearest(d) as i32), [0.0; LANES]),
        Filter::Linear => {
            let mut whole = [0; LANES];
            let mut fraction = [0.0; LANES];
            for lane in 0..LANES {
                let floor = levels[lane].floor();
                whole[lane] = floor as i32;
                fraction[lane] = levels[lane] - floor;
            }
            (whole, fraction)
        }
    }
}
