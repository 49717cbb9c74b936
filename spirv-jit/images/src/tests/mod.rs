//! Against a straightforward sampler in f64, written from the spec's equations for one lane at a
//! time.

use super::execute::execute_block;
use super::*;
use lanes::Row;
use proptest::prelude::*;

mod access;
mod classes;
mod sampling;
mod vectors;

/// An image with its memory: levels of a layer one after the other, layers after each other.
struct Image {
    /// Keeps the texels in memory, 8-byte aligned.
    _memory: Vec<u64>,
    descriptor: ImageDescriptor,
}

impl Image {
    fn new(
        format: Format,
        dim: Dim,
        size: [u32; 3],
        level_count: u8,
        layers: u32,
        seed: u32,
    ) -> Image {
        let texel = format.size_bytes() as u64;
        let mut levels = [Level::default(); MAX_LEVELS];
        let mut offset = 0;
        for index in 0..level_count as usize {
            let [width, height, depth] = size.map(|n| (n >> index).max(1));
            // Rows with a gap, so that strides matter.
            let row = (width as u64 + 1) * texel;
            levels[index] = Level {
                offset_bytes: offset,
                row_stride_bytes: row,
                slice_stride_bytes: row * height as u64,
                width,
                height,
                depth,
            };
            offset += (row * height as u64 * depth as u64).next_multiple_of(8);
        }
        let total = offset * layers as u64;
        let mut memory = vec![0u64; total as usize / 8];
        let mut random = fastrand::Rng::with_seed(seed.into());
        // SAFETY: the vector's own bytes.
        let bytes = unsafe {
            std::slice::from_raw_parts_mut(memory.as_mut_ptr().cast::<u8>(), total as usize)
        };
        let info = format.info().unwrap();
        for chunk in bytes.chunks_exact_mut(texel as usize) {
            let words = [0; 4].map(|_: u32| match info.numeric.is_integer() {
                true => random.u32(..1 << 24),
                false => random.f32().to_bits(),
            });
            info.encode(words, chunk);
        }
        let descriptor = ImageDescriptor {
            data: memory.as_mut_ptr().cast(),
            size_bytes: total,
            format,
            dim,
            arrayed: layers > 1,
            samples: 1,
            level_count,
            layer_count: layers,
            layer_stride_bytes: offset,
            sample_stride_bytes: 0,
            swizzle: [0, 1, 2, 3],
            min_lod: 0.0,
            levels,
            conversion: None,
        };
        Image {
            _memory: memory,
            descriptor,
        }
    }

    /// A texel by index, decoded by the format's own code (tested apart).
    fn words(&self, level: usize, layer: u32, [x, y, z]: [u32; 3]) -> [u32; 4] {
        let d = &self.descriptor;
        let l = &d.levels[level];
        assert!(x < l.width && y < l.height && z < l.depth && layer < d.layer_count);
        let offset = l.offset_bytes
            + layer as u64 * d.layer_stride_bytes
            + z as u64 * l.slice_stride_bytes
            + y as u64 * l.row_stride_bytes
            + x as u64 * d.format.size_bytes() as u64;
        // SAFETY: inside the memory, by the assertion and the construction above.
        let bytes = unsafe {
            std::slice::from_raw_parts(d.data.add(offset as usize), d.format.size_bytes())
        };
        d.format.info().unwrap().decode(bytes)
    }

    /// All of its memory.
    fn bytes(&self) -> &[u8] {
        let d = &self.descriptor;
        // SAFETY: the memory's own bytes.
        unsafe { std::slice::from_raw_parts(d.data, d.size_bytes as usize) }
    }

    fn texel(&self, level: usize, layer: u32, index: [u32; 3]) -> [f64; 4] {
        self.words(level, layer, index)
            .map(|word| f32::from_bits(word) as f64)
    }
}

fn sampler() -> SamplerDescriptor {
    SamplerDescriptor {
        mag_filter: Filter::Linear,
        min_filter: Filter::Linear,
        max_lod: 1000.0,
        max_anisotropy: 0.0,
        border_color: [0.25f32, 0.5, 0.75, 1.0].map(f32::to_bits),
        ..SamplerDescriptor::DEFAULT
    }
}

fn run(
    op: &ImageOp,
    image: &ImageDescriptor,
    sampler: Option<&SamplerDescriptor>,
    mask: u16,
    rows: &[Row],
) -> [Row; 8] {
    assert_eq!(rows.len(), op.operand_rows());
    let rows: Vec<&Row> = rows.iter().collect();
    let mut results = [[0xdead_beef; 16]; 8];
    // SAFETY: the image's memory is alive in the caller.
    unsafe { execute_block(op, Some(image), sampler, mask, &rows, &mut results) };
    results
}

/// Wrapping, as the spec writes it; `None` is the border.
fn wrap(mode: AddressMode, i: i64, size: i64) -> Option<i64> {
    let mirror = |n: i64| if n >= 0 { n } else { -(1 + n) };
    match mode {
        AddressMode::Repeat => Some(i.rem_euclid(size)),
        AddressMode::MirroredRepeat => Some((size - 1) - mirror(i.rem_euclid(2 * size) - size)),
        AddressMode::ClampToEdge => Some(i.clamp(0, size - 1)),
        AddressMode::ClampToBorder => (i >= 0 && i < size).then_some(i),
        AddressMode::MirrorClampToEdge => Some(mirror(i).clamp(0, size - 1)),
    }
}

/// The arguments of a sample.
#[derive(Clone, Debug)]
struct Query {
    coordinates: [f64; 3],
    layer: u32,
    offsets: [i32; 3],
    lambda: f64,
    reference: Option<f64>,
}

struct Reference<'a> {
    image: &'a Image,
    sampler: &'a SamplerDescriptor,
    axes: usize,
}

impl Reference<'_> {
    fn fetch(&self, level: usize, layer: u32, index: [i64; 3], reference: Option<f64>) -> [f64; 4] {
        let l = &self.image.descriptor.levels[level];
        let size = [l.width, l.height, l.depth];
        let mut wrapped = [0; 3];
        let mut border = false;
        for axis in 0..self.axes {
            match wrap(
                self.sampler.address_mode[axis],
                index[axis],
                size[axis] as i64,
            ) {
                Some(i) => wrapped[axis] = i as u32,
                None => border = true,
            }
        }
        let mut texel = self.image.texel(level, layer, wrapped);
        if border {
            let info = self.image.descriptor.format.info().unwrap();
            for component in 0..4 {
                texel[component] = if info.channels[component].bits != 0 {
                    f32::from_bits(self.sampler.border_color[component]) as f64
                } else {
                    (component == 3) as u32 as f64
                };
            }
        }
        if let Some(r) = reference {
            let d = texel[0];
            let holds = match self.sampler.compare.unwrap() {
                CompareOp::Never => false,
                CompareOp::Less => r < d,
                CompareOp::Equal => r == d,
                CompareOp::LessOrEqual => r <= d,
                CompareOp::Greater => r > d,
                CompareOp::NotEqual => r != d,
                CompareOp::GreaterOrEqual => r >= d,
                CompareOp::Always => true,
            };
            texel = [holds as u32 as f64; 4];
        }
        texel
    }

    /// Texel coordinates and whether one is too near to where a selection changes to tell in f32.
    fn scaled(&self, level: usize, q: &Query, shift: f64) -> ([f64; 3], bool) {
        let l = &self.image.descriptor.levels[level];
        let size = [l.width, l.height, l.depth];
        let mut near = false;
        let mut texel = [0.0; 3];
        for axis in 0..self.axes {
            let scale = if self.sampler.unnormalized_coordinates {
                1.0
            } else {
                size[axis] as f64
            };
            texel[axis] = q.coordinates[axis] * scale + q.offsets[axis] as f64 - shift;
            near |= (texel[axis] - texel[axis].round()).abs() < 1e-3;
        }
        (texel, near)
    }

    /// One level; `None` if rounding decides.
    fn level(&self, level: usize, filter: Filter, q: &Query) -> Option<[f64; 4]> {
        if filter == Filter::Nearest {
            let (texel, near) = self.scaled(level, q, 0.0);
            let index = texel.map(|u| u.floor() as i64);
            return (!near).then(|| self.fetch(level, q.layer, index, q.reference));
        }
        let (texel, near) = self.scaled(level, q, 0.5);
        // A reduction drops texels of zero weight; averages are continuous.
        if near && self.sampler.reduction != Reduction::WeightedAverage {
            return None;
        }
        let mut sum = [0.0; 4];
        let (mut min, mut max) = ([f64::MAX; 4], [f64::MIN; 4]);
        for tap in 0..1 << self.axes {
            let mut weight = 1.0;
            let mut index = [0; 3];
            for axis in 0..self.axes {
                let floor = texel[axis].floor();
                let upper = tap >> axis & 1 == 1;
                index[axis] = floor as i64 + upper as i64;
                let fraction = texel[axis] - floor;
                weight *= if upper { fraction } else { 1.0 - fraction };
            }
            let texel = self.fetch(level, q.layer, index, q.reference);
            for c in 0..4 {
                sum[c] += weight * texel[c];
                min[c] = f64::min(min[c], texel[c]);
                max[c] = f64::max(max[c], texel[c]);
            }
        }
        Some(match self.sampler.reduction {
            Reduction::WeightedAverage => sum,
            Reduction::Min => min,
            Reduction::Max => max,
        })
    }

    fn sample(&self, q: &Query) -> Option<[f64; 4]> {
        let s = self.sampler;
        let lambda = (q.lambda + s.mip_lod_bias as f64)
            .min(s.max_lod as f64)
            .max(s.min_lod as f64);
        if lambda.abs() < 1e-4 && s.mag_filter != s.min_filter {
            return None;
        }
        let filter = if lambda <= 0.0 {
            s.mag_filter
        } else {
            s.min_filter
        };
        let last = (self.image.descriptor.level_count - 1) as f64;
        let d = lambda.clamp(0.0, last);
        if s.mipmap_mode == Filter::Nearest {
            if (d.fract() - 0.5).abs() < 1e-4 {
                return None;
            }
            return self.level(d.round() as usize, filter, q);
        }
        let near_integer = (d - d.round()).abs() < 1e-4;
        if near_integer && s.reduction != Reduction::WeightedAverage {
            return None;
        }
        let high = self.level(d.floor() as usize, filter, q)?;
        let low = self.level((d.floor() + 1.0).min(last) as usize, filter, q)?;
        let weight = d.fract();
        Some(std::array::from_fn(|c| match s.reduction {
            Reduction::WeightedAverage => high[c] * (1.0 - weight) + low[c] * weight,
            _ if weight == 0.0 => high[c],
            Reduction::Min => high[c].min(low[c]),
            Reduction::Max => high[c].max(low[c]),
        }))
    }
}

fn any_mode() -> impl Strategy<Value = AddressMode> {
    prop::sample::select(vec![
        AddressMode::Repeat,
        AddressMode::MirroredRepeat,
        AddressMode::ClampToEdge,
        AddressMode::ClampToBorder,
        AddressMode::MirrorClampToEdge,
    ])
}

fn any_filter() -> impl Strategy<Value = Filter> {
    prop::sample::select(vec![Filter::Nearest, Filter::Linear])
}

prop_compose! {
    fn any_sampler()(
        mag_filter in any_filter(), min_filter in any_filter(), mipmap_mode in any_filter(),
        address_mode in prop::array::uniform3(any_mode()),
        mip_lod_bias in prop::sample::select(vec![0.0f32, 0.0, 0.7, -1.3]),
        lods in prop::sample::select(vec![(0.0f32, 1000.0f32), (0.0, 0.25), (1.2, 2.6)]),
        reduction in prop::sample::select(vec![Reduction::WeightedAverage, Reduction::WeightedAverage, Reduction::Min, Reduction::Max]),
    ) -> SamplerDescriptor {
        SamplerDescriptor {
            mag_filter, min_filter, mipmap_mode, address_mode, mip_lod_bias, min_lod: lods.0, max_lod: lods.1, reduction,
            ..sampler()
        }
    }
}

fn any_compare() -> impl Strategy<Value = CompareOp> {
    prop::sample::select(vec![
        CompareOp::Never,
        CompareOp::Less,
        CompareOp::Equal,
        CompareOp::LessOrEqual,
        CompareOp::Greater,
        CompareOp::NotEqual,
        CompareOp::GreaterOrEqual,
        CompareOp::Always,
    ])
}

fn any_format() -> impl Strategy<Value = Format> {
    prop::sample::select(vec![
        Format::R8G8B8A8_UNORM,
        Format::B8G8R8A8_UNORM,
        Format::R8G8B8A8_SRGB,
        Format::B8G8R8A8_SRGB,
        Format::R8_UNORM,
        Format::R8G8_UNORM,
        Format::R16_UNORM,
        Format::R16G16B16A16_UNORM,
        Format::R16G16B16A16_SFLOAT,
        Format::R16G16_SFLOAT,
        Format::R32_SFLOAT,
        Format::R32G32B32A32_SFLOAT,
        Format::R5G6B5_UNORM_PACK16,
        Format::B10G11R11_UFLOAT_PACK32,
        Format::R8G8B8A8_SNORM,
        Format::X8_D24_UNORM_PACK32,
        Format::E5B9G9R9_UFLOAT_PACK32,
    ])
}

fn row(value: f32) -> Row {
    [value.to_bits(); 16]
}
