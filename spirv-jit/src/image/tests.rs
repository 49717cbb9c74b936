//! Against a straightforward sampler in f64, written from the spec's equations for one lane at a time.

use super::execute::{execute, execute_block};
use super::*;
use crate::environment::Descriptor;
use crate::ir::Type;
use crate::ir::op::AtomicOp;
use crate::program::Row;
use proptest::prelude::*;

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
        let mut state = seed as u64 | 1;
        // SAFETY: the vector's own bytes.
        let bytes = unsafe {
            std::slice::from_raw_parts_mut(memory.as_mut_ptr().cast::<u8>(), total as usize)
        };
        let info = format.info().unwrap();
        for chunk in bytes.chunks_exact_mut(texel as usize) {
            let words = [0; 4].map(|_: u32| {
                state = state
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                let random = (state >> 40) as u32;
                if info.numeric.is_integer() {
                    random
                } else {
                    (random as f32 / (1 << 24) as f32).to_bits()
                }
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

    fn texel(&self, level: usize, layer: u32, index: [u32; 3]) -> [f64; 4] {
        self.words(level, layer, index)
            .map(|word| f32::from_bits(word) as f64)
    }
}

fn sampler() -> SamplerDescriptor {
    SamplerDescriptor {
        mag_filter: Filter::Linear,
        min_filter: Filter::Linear,
        mipmap_mode: Filter::Nearest,
        address_mode: [AddressMode::Repeat; 3],
        mip_lod_bias: 0.0,
        min_lod: 0.0,
        max_lod: 1000.0,
        max_anisotropy: 0.0,
        compare: None,
        reduction: Reduction::WeightedAverage,
        border_color: [0.25f32, 0.5, 0.75, 1.0].map(f32::to_bits),
        unnormalized_coordinates: false,
    }
}

fn image_op(kind: ImageOpKind, dim: Dim) -> ImageOp {
    ImageOp {
        kind,
        dim,
        arrayed: false,
        multisampled: false,
        depth_compare: false,
        lod: LodMode::Implicit,
        has_min_lod: false,
        has_offset: false,
        has_offsets: false,
        texel: Type::F32,
        signed: false,
        format: Format::UNDEFINED,
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

/// What a sample reads.
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
    ])
}

fn row(value: f32) -> Row {
    [value.to_bits(); 16]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// 1D, 2D and 3D sampling with every addressing, filter, level selection, reduction, offset and comparison, 16 different lanes.
    #[test]
    fn sampling_agrees_with_the_equations(
        format in any_format(), s in any_sampler(), axes in 1usize..4,
        size in prop::array::uniform3(1u32..13), level_count in 1u8..4, layers in 1u32..4, seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform3(-2.5f32..3.5)),
        layer_coordinates in prop::array::uniform16(-1.0f32..5.0),
        lods in prop::array::uniform16(-1.0f32..4.0), uniform_lod: bool,
        offsets in prop::option::of(prop::array::uniform3(-8i32..8)),
        compare in prop::option::of((0usize..8, 0.0f32..1.0)),
        swizzle in prop::option::of(prop::array::uniform4(0u8..6)),
        mask: u16,
    ) {
        let mut s = s;
        let dim = [Dim::D1, Dim::D2, Dim::D3][axes - 1];
        let layers = if axes == 3 { 1 } else { layers };
        let format = if compare.is_some() { Format::D16_UNORM } else { format };
        let mut image = Image::new(format, dim, size, level_count, layers, seed);
        if let (Some(swizzle), None) = (swizzle, compare) {
            image.descriptor.swizzle = swizzle;
        }
        s.compare = compare.map(|(index, _)| [
            CompareOp::Never, CompareOp::Less, CompareOp::Equal, CompareOp::LessOrEqual,
            CompareOp::Greater, CompareOp::NotEqual, CompareOp::GreaterOrEqual, CompareOp::Always,
        ][index]);
        let op = ImageOp {
            arrayed: layers > 1,
            depth_compare: compare.is_some(),
            lod: LodMode::Lod,
            has_offset: offsets.is_some(),
            ..image_op(ImageOpKind::Sample, dim)
        };
        let mut rows: Vec<Row> = (0..axes).map(|axis| coordinates.map(|c| c[axis].to_bits())).collect();
        if layers > 1 { rows.push(layer_coordinates.map(f32::to_bits)); }
        if let Some((_, reference)) = compare { rows.push(row(reference)); }
        let lods = if uniform_lod { [lods[0]; 16] } else { lods };
        rows.push(lods.map(f32::to_bits));
        if let Some(offsets) = offsets { rows.extend(offsets[..axes].iter().map(|&o| [o as u32; 16])); }
        let results = run(&op, &image.descriptor, Some(&s), mask, &rows);
        let reference = Reference { image: &image, sampler: &s, axes };
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            let q = Query {
                coordinates: coordinates[lane].map(|c| c as f64),
                layer: if layers > 1 { (layer_coordinates[lane].round_ties_even().max(0.0) as u32).min(layers - 1) } else { 0 },
                offsets: offsets.unwrap_or([0; 3]),
                lambda: lods[lane] as f64,
                reference: compare.map(|(_, reference)| reference as f64),
            };
            let Some(expected) = reference.sample(&q) else { continue };
            let expected = if compare.is_some() { expected } else {
                image.descriptor.swizzle.map(|from| match from {
                    0..=3 => expected[from as usize],
                    4 => 0.0,
                    _ => 1.0,
                })
            };
            for component in 0..op.result_rows() {
                let got = f32::from_bits(results[component][lane]) as f64;
                // Coordinates are rounded relative to the texel grid: 13 texels × 3.5 repeats × 2^-24, times the texels' range.
                prop_assert!((got - expected[component]).abs() < 4e-5, "lane {lane} component {component}: {got} {expected:?} {q:?}");
            }
        }
    }

    /// Gathers take the footprint of linear filtering at the base level, in the spec's order, from the component after the swizzle.
    #[test]
    fn gathers_take_the_footprint_in_order(
        format in any_format(), s in any_sampler(), size in prop::array::uniform2(1u32..9), seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform2(-1.5f32..2.5)), component in 0u8..4,
        offsets in prop::array::uniform8(-32i32..32), offset_kind in 0usize..3, swizzle in prop::array::uniform4(0u8..6), compare: bool,
    ) {
        let mut s = s;
        let format = if compare { Format::D32_SFLOAT } else { format };
        let mut image = Image::new(format, Dim::D2, [size[0], size[1], 1], 2, 1, seed);
        if compare { s.compare = Some(CompareOp::LessOrEqual); } else { image.descriptor.swizzle = swizzle; }
        let op = ImageOp {
            depth_compare: compare,
            has_offset: offset_kind == 1,
            has_offsets: offset_kind == 2,
            ..image_op(ImageOpKind::Gather(component), Dim::D2)
        };
        let mut rows: Vec<Row> = (0..2).map(|axis| coordinates.map(|c| c[axis].to_bits())).collect();
        if compare { rows.push(row(0.5)); }
        let offset_rows = [0, 2, 8][offset_kind];
        rows.extend(offsets[..offset_rows].iter().map(|&o| [o as u32; 16]));
        let results = run(&op, &image.descriptor, Some(&s), 0xffff, &rows);
        let reference = Reference { image: &image, sampler: &s, axes: 2 };
        for lane in 0..16 {
            for result in 0..4 {
                let offset = match offset_kind {
                    0 => [0, 0],
                    1 => [offsets[0], offsets[1]],
                    _ => [offsets[2 * result], offsets[2 * result + 1]],
                };
                let corner = if offset_kind == 2 { [0, 0] } else { [[0, 1], [1, 1], [1, 0], [0, 0]][result] };
                let q = Query {
                    coordinates: [coordinates[lane][0] as f64, coordinates[lane][1] as f64, 0.0],
                    layer: 0, offsets: [offset[0], offset[1], 0], lambda: 0.0, reference: None,
                };
                let (texel, near) = reference.scaled(0, &q, 0.5);
                if near { continue; }
                let index = [texel[0].floor() as i64 + corner[0], texel[1].floor() as i64 + corner[1], 0];
                let texel = reference.fetch(0, 0, index, compare.then_some(0.5));
                let expected = match image.descriptor.swizzle[component as usize] {
                    _ if compare => texel[0],
                    4 => 0.0,
                    5 => 1.0,
                    from => texel[from as usize],
                };
                let got = f32::from_bits(results[result][lane]) as f64;
                prop_assert!((got - expected).abs() < 1e-6, "{got} {expected} {q:?}");
            }
        }
    }

    /// λ of derivatives, without and with anisotropy, against logarithms in f64; seen through a LOD query.
    #[test]
    fn derivatives_give_the_level(
        axes in 1usize..4, derivatives in prop::array::uniform6(-3.0f32..3.0), exponent in -12i32..3, bias in -2.0f32..2.0, linear: bool,
        anisotropy in prop::option::of(1.0f32..16.0),
    ) {
        let derivatives = derivatives.map(|d| d * 2f32.powi(exponent));
        let dim = [Dim::D1, Dim::D2, Dim::D3][axes - 1];
        let size = [32, if axes > 1 { 16 } else { 1 }, if axes > 2 { 8 } else { 1 }];
        let image = Image::new(Format::R8_UNORM, dim, size, 5, 1, 1);
        let s = SamplerDescriptor {
            mip_lod_bias: bias,
            mipmap_mode: if linear { Filter::Linear } else { Filter::Nearest },
            max_anisotropy: anisotropy.unwrap_or(0.0),
            ..sampler()
        };
        let op = ImageOp { lod: LodMode::Grad, ..image_op(ImageOpKind::QueryLod, dim) };
        let mut rows = vec![row(0.3); axes];
        for screen in 0..2 { for axis in 0..axes { rows.push(row(derivatives[screen * 3 + axis])); } }
        let results = run(&op, &image.descriptor, Some(&s), 1, &rows);
        let length = |screen: usize| (0..axes)
            .map(|axis| (derivatives[screen * 3 + axis] as f64 * size[axis] as f64).powi(2)).sum::<f64>().sqrt();
        let (max, min) = (length(0).max(length(1)), length(0).min(length(1)));
        // η as a real number in 1..=maxAnisotropy.
        let eta = match anisotropy {
            Some(limit) => (max / min).min(limit as f64).max(1.0),
            None => 1.0,
        };
        let lambda = (max / eta).log2() + bias as f64;
        let got = f32::from_bits(results[1][0]) as f64;
        prop_assert!((got - lambda).abs() < 1e-4, "{got} {lambda}");
        let d = lambda.clamp(0.0, 4.0);
        let level = f32::from_bits(results[0][0]) as f64;
        if linear {
            prop_assert!((level - d).abs() < 1e-4);
        } else if (d.fract() - 0.5).abs() > 1e-3 {
            prop_assert_eq!(level, d.round());
        }
    }

    /// Fetches, with levels, layers, offsets; what is outside is zero, with the missing components filled.
    #[test]
    fn fetches_give_texels_and_zero_outside(
        format in any_format(), axes in 1usize..4, size in prop::array::uniform3(1u32..9), layers in 1u32..3, seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform4(-2i32..10)), lods in prop::array::uniform16(-1i32..4),
        offset in prop::option::of(-3i32..4), mask: u16,
    ) {
        let dim = [Dim::D1, Dim::D2, Dim::D3][axes - 1];
        let size: [u32; 3] = std::array::from_fn(|axis| if axis < axes { size[axis] } else { 1 });
        let layers = if axes == 3 { 1 } else { layers };
        let image = Image::new(format, dim, size, 3, layers, seed);
        let op = ImageOp { arrayed: layers > 1, lod: LodMode::Lod, has_offset: offset.is_some(), ..image_op(ImageOpKind::Fetch, dim) };
        let mut rows: Vec<Row> = (0..axes).map(|axis| coordinates.map(|c| c[axis] as u32)).collect();
        if layers > 1 { rows.push(coordinates.map(|c| c[3] as u32)); }
        rows.push(lods.map(|lod| lod as u32));
        if let Some(offset) = offset { rows.extend(vec![[offset as u32; 16]; axes]); }
        let results = run(&op, &image.descriptor, None, mask, &rows);
        let info = format.info().unwrap();
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            let at: [i32; 3] = std::array::from_fn(|axis| if axis < axes { coordinates[lane][axis] + offset.unwrap_or(0) } else { 0 });
            let layer = if layers > 1 { coordinates[lane][3] } else { 0 };
            let lod = lods[lane];
            let inside = (0..3).contains(&lod)
                && (0..layers as i32).contains(&layer)
                && (0..3).all(|axis| at[axis] >= 0 && at[axis] < (size[axis] >> lod).max(1) as i32);
            let expected = if inside {
                image.words(lod as usize, layer as u32, at.map(|i| i as u32))
            } else {
                std::array::from_fn(|c| if info.channels[c].bits == 0 && c == 3 { 1f32.to_bits() } else { 0 })
            };
            let got: [u32; 4] = std::array::from_fn(|c| results[c][lane]);
            prop_assert_eq!(got, expected);
        }
    }

    /// What is written is read back, in every format that can hold it; writes outside are dropped.
    #[test]
    fn writes_are_read_back(
        seed: u32, words in prop::array::uniform4(prop::array::uniform16(any::<u32>())), mask: u16,
        coordinates in prop::array::uniform16(prop::array::uniform2(-1i32..9)),
    ) {
        for format in Format::all() {
            let info = format.info().unwrap();
            if info.is_wide() { continue; }
            let image = Image::new(format, Dim::D2, [8, 8, 1], 1, 1, seed);
            let texel = if info.numeric.is_integer() { Type::I32 } else { Type::F32 };
            let write = ImageOp { texel, ..image_op(ImageOpKind::Write, Dim::D2) };
            let before: Vec<[u32; 4]> = (0..64).map(|i| image.words(0, 0, [i % 8, i / 8, 0])).collect();
            let mut expected = before.clone();
            for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
                let [x, y] = coordinates[lane];
                if (0..8).contains(&x) && (0..8).contains(&y) {
                    let mut bytes = [0; 32];
                    info.encode(words.map(|row| row[lane]), &mut bytes);
                    expected[(y * 8 + x) as usize] = info.decode(&bytes);
                }
            }
            let mut rows: Vec<Row> = (0..2).map(|axis| coordinates.map(|c| c[axis] as u32)).collect();
            rows.extend(words);
            run(&write, &image.descriptor, None, mask, &rows);
            for i in 0..64u32 {
                prop_assert_eq!(image.words(0, 0, [i % 8, i / 8, 0]), expected[i as usize], "{}", info.name);
            }
        }
    }

    /// The common case has code of its own: the same bits as the general one.
    #[test]
    fn the_fast_path_is_the_same(
        format in any_format(), s in any_sampler(), size in prop::array::uniform2(1u32..40), level_count in 1u8..4, layers in 1u32..4, seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform3(-3.5f32..3.5)), special in prop::option::of((0usize..16, prop::sample::select(vec![f32::NAN, f32::INFINITY, -1e30, 1e30, 1.0, 0.0, -1e-9]))),
        lods in prop::array::uniform16(-1.0f32..4.0), uniform_lod: bool, bias: bool, mask in 1u16..,
    ) {
        let mut s = s;
        s.min_filter = s.mag_filter;
        s.reduction = Reduction::WeightedAverage;
        for mode in &mut s.address_mode {
            if matches!(mode, AddressMode::ClampToBorder | AddressMode::MirrorClampToEdge) {
                *mode = AddressMode::ClampToEdge;
            }
        }
        let image = Image::new(format, Dim::D2, [size[0], size[1], 1], level_count, layers, seed);
        let info = format.info().unwrap();
        let op = ImageOp {
            arrayed: layers > 1,
            lod: if bias { LodMode::Bias } else { LodMode::Lod },
            ..image_op(ImageOpKind::Sample, Dim::D2)
        };
        prop_assert!(fast::applies(&op, &image.descriptor, info, &s));
        let mut coordinates = coordinates;
        if let Some((lane, value)) = special { coordinates[lane][1] = value; }
        let mut rows: Vec<Row> = (0..2).map(|axis| coordinates.map(|c| c[axis].to_bits())).collect();
        if layers > 1 { rows.push(coordinates.map(|c| c[2].to_bits())); }
        rows.push(if uniform_lod { [lods[0].to_bits(); 16] } else { lods.map(f32::to_bits) });
        let rows: Vec<&Row> = rows.iter().collect();
        let operands = execute::Operands::new(&op, &rows);
        let (mut fast, mut general) = ([[0; 16]; 8], [[0; 16]; 8]);
        // SAFETY: the image's memory is alive.
        unsafe {
            sample::sample_fast(&op, &operands, &image.descriptor, info, &s, mask, &mut fast);
            sample::sample(&op, &operands, &image.descriptor, info, &s, mask, &mut general);
        }
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            for component in 0..4 {
                let (a, b) = (fast[component][lane], general[component][lane]);
                let both_nan = f32::from_bits(a).is_nan() && f32::from_bits(b).is_nan();
                prop_assert!(a == b || both_nan, "{lane} {component} {a:x} {b:x}");
            }
        }
    }

    /// A cube's faces, nearest: the texel is where the direction, scaled to the face, points.
    #[test]
    fn cubes_select_faces(directions in prop::array::uniform16(prop::array::uniform3(-1.0f32..1.0)), cube in 0u32..2, seed: u32) {
        let image = Image::new(Format::R8G8B8A8_UNORM, Dim::Cube, [8, 8, 1], 1, 12, seed);
        let s = SamplerDescriptor { mag_filter: Filter::Nearest, min_filter: Filter::Nearest, ..sampler() };
        let op = ImageOp { arrayed: true, ..image_op(ImageOpKind::Sample, Dim::Cube) };
        let mut rows: Vec<Row> = (0..3).map(|axis| directions.map(|d| d[axis].to_bits())).collect();
        rows.push(row(cube as f32));
        let results = run(&op, &image.descriptor, Some(&s), 0xffff, &rows);
        for lane in 0..16 {
            let [x, y, z] = directions[lane].map(|d| d as f64);
            let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
            // The table of the chapter.
            let (face, sc, tc, rc) = if az >= ax && az >= ay {
                if z >= 0.0 { (4, x, -y, az) } else { (5, -x, -y, az) }
            } else if ay >= ax {
                if y >= 0.0 { (2, x, z, ay) } else { (3, x, -z, ay) }
            } else if x >= 0.0 { (0, -z, -y, ax) } else { (1, z, -y, ax) };
            let texel = [sc, tc].map(|c| (c / rc * 0.5 + 0.5) * 8.0);
            if texel.iter().any(|u| (u - u.round()).abs() < 1e-4) { continue; }
            let index = texel.map(|u| u.floor() as u32);
            let expected = image.words(0, cube * 6 + face, [index[0], index[1], 0]);
            prop_assert_eq!(std::array::from_fn::<u32, 4, _>(|c| results[c][lane]), expected);
        }
    }

    /// Linear filtering is continuous over a cube's edges and corners.
    #[test]
    fn cubes_are_seamless(direction in prop::array::uniform3(-1.0f32..1.0), edge in 0usize..3, seed: u32) {
        let image = Image::new(Format::R32_SFLOAT, Dim::Cube, [4, 4, 1], 1, 6, seed);
        let op = image_op(ImageOpKind::Sample, Dim::Cube);
        let at = |d: [f32; 3]| {
            let rows = d.map(row);
            f32::from_bits(run(&op, &image.descriptor, Some(&sampler()), 1, &rows)[0][0])
        };
        // Two components equal in magnitude: an edge, if they are the largest.
        let mut d = direction;
        let other = (edge + 1) % 3;
        let largest = direction.iter().fold(0f32, |a, b| a.max(b.abs())).max(0.1);
        d[edge] = largest.copysign(d[edge]);
        d[other] = largest.copysign(d[other]);
        let (mut inside, mut outside) = (d, d);
        inside[edge] *= 1.00001;
        outside[edge] *= 0.99999;
        prop_assert!((at(inside) - at(outside)).abs() < 1e-3);
    }
}

#[test]
fn unnormalized_coordinates_count_texels() {
    let image = Image::new(Format::R32_SFLOAT, Dim::D2, [5, 3, 1], 1, 1, 7);
    let s = SamplerDescriptor {
        unnormalized_coordinates: true,
        address_mode: [AddressMode::ClampToEdge; 3],
        ..sampler()
    };
    let results = run(
        &image_op(ImageOpKind::Sample, Dim::D2),
        &image.descriptor,
        Some(&s),
        1,
        &[row(2.5), row(1.75)],
    );
    let expected = 0.75 * image.texel(0, 0, [2, 1, 0])[0] + 0.25 * image.texel(0, 0, [2, 2, 0])[0];
    assert!((f32::from_bits(results[0][0]) as f64 - expected).abs() < 1e-6);
}

#[test]
fn anisotropy_averages_along_the_longer_axis() {
    let image = Image::new(Format::R32_SFLOAT, Dim::D2, [64, 64, 1], 1, 1, 3);
    let s = SamplerDescriptor {
        max_anisotropy: 4.0,
        ..sampler()
    };
    let op = ImageOp {
        lod: LodMode::Grad,
        ..image_op(ImageOpKind::Sample, Dim::D2)
    };
    // 4 texels along x, 1 along y: N = 4.
    let rows = [
        row(0.4),
        row(0.3),
        row(4.0 / 64.0),
        row(0.0),
        row(0.0),
        row(1.0 / 64.0),
    ];
    let results = run(&op, &image.descriptor, Some(&s), 1, &rows);
    let reference = Reference {
        image: &image,
        sampler: &s,
        axes: 2,
    };
    let mean = (1..=4)
        .map(|i| {
            let q = Query {
                coordinates: [0.4 + 4.0 / 64.0 * (i as f64 / 5.0 - 0.5), 0.3, 0.0],
                layer: 0,
                offsets: [0; 3],
                lambda: 0.0,
                reference: None,
            };
            reference.level(0, Filter::Linear, &q).unwrap()[0]
        })
        .sum::<f64>()
        / 4.0;
    assert!((f32::from_bits(results[0][0]) as f64 - mean).abs() < 1e-4);
}

#[test]
fn queries_of_the_image() {
    let image = Image::new(Format::R8_UNORM, Dim::D2, [10, 6, 1], 3, 4, 1);
    let size = ImageOp {
        arrayed: true,
        lod: LodMode::Lod,
        texel: Type::I32,
        ..image_op(ImageOpKind::QuerySize, Dim::D2)
    };
    let results = run(&size, &image.descriptor, None, 1, &[[1; 16]]);
    assert_eq!([results[0][0], results[1][0], results[2][0]], [5, 3, 4]);
    let cube = Image::new(Format::R8_UNORM, Dim::Cube, [8, 8, 1], 1, 12, 1);
    let size = ImageOp {
        arrayed: true,
        ..image_op(ImageOpKind::QuerySize, Dim::Cube)
    };
    let results = run(&size, &cube.descriptor, None, 1, &[]);
    assert_eq!([results[0][0], results[1][0], results[2][0]], [8, 8, 2]);
    let results = run(
        &image_op(ImageOpKind::QueryLevels, Dim::D2),
        &image.descriptor,
        None,
        1,
        &[],
    );
    assert_eq!(results[0][0], 3);
    let results = run(
        &image_op(ImageOpKind::QuerySamples, Dim::D2),
        &image.descriptor,
        None,
        1,
        &[],
    );
    assert_eq!(results[0][0], 1);
}

#[test]
fn atomics_return_the_old_value_in_lane_order() {
    let image = Image::new(Format::R32_UINT, Dim::D2, [4, 4, 1], 1, 1, 1);
    let old = image.words(0, 0, [1, 2, 0])[0];
    let op = ImageOp {
        texel: Type::I32,
        ..image_op(ImageOpKind::Atomic(AtomicOp::IAdd), Dim::D2)
    };
    let results = run(
        &op,
        &image.descriptor,
        None,
        0b1011,
        &[[1; 16], [2; 16], [5; 16]],
    );
    assert_eq!(
        [results[0][0], results[0][1], results[0][3]],
        [old, old + 5, old + 10]
    );
    assert_eq!(image.words(0, 0, [1, 2, 0])[0], old + 15);

    let image = Image::new(Format::R64_SINT, Dim::D1, [4, 1, 1], 1, 1, 1);
    let op = ImageOp {
        texel: Type::I64,
        ..image_op(ImageOpKind::Write, Dim::D1)
    };
    let zero = [0; 16];
    run(
        &op,
        &image.descriptor,
        None,
        1,
        &[
            [3; 16],
            [7; 16],
            [u32::MAX; 16],
            zero,
            zero,
            zero,
            zero,
            zero,
            zero,
        ],
    );
    let op = ImageOp {
        texel: Type::I64,
        ..image_op(ImageOpKind::Atomic(AtomicOp::SMin), Dim::D1)
    };
    let results = run(
        &op,
        &image.descriptor,
        None,
        1,
        &[[3; 16], [0; 16], [0x8000_0000; 16]],
    );
    assert_eq!([results[0][0], results[1][0]], [7, u32::MAX]);
    let read = ImageOp {
        texel: Type::I64,
        ..image_op(ImageOpKind::Read, Dim::D1)
    };
    let results = run(&read, &image.descriptor, None, 1, &[[3; 16]]);
    assert_eq!(
        results.map(|row| row[0]),
        [0, 0x8000_0000, 0, 0, 0, 0, 1, 0]
    );

    let image = Image::new(Format::R32_SFLOAT, Dim::Buffer, [4, 1, 1], 1, 1, 1);
    let op = image_op(ImageOpKind::Atomic(AtomicOp::Exchange), Dim::Buffer);
    run(&op, &image.descriptor, None, 1, &[[0; 16], row(1.5)]);
    let op = image_op(ImageOpKind::Atomic(AtomicOp::FAdd), Dim::Buffer);
    let results = run(&op, &image.descriptor, None, 0b11, &[[0; 16], row(0.25)]);
    assert_eq!(
        [results[0][0], results[0][1]].map(f32::from_bits),
        [1.5, 1.75]
    );
    // Outside: dropped, and the old value is zero.
    let results = run(&op, &image.descriptor, None, 1, &[[4; 16], row(0.25)]);
    assert_eq!(results[0][0], 0);
}

#[test]
fn samples_of_multisampled_images_are_separate() {
    let mut image = Image::new(Format::R32_UINT, Dim::D2, [4, 4, 1], 1, 2, 5);
    // Two layers seen as two samples.
    image.descriptor.sample_stride_bytes = image.descriptor.layer_stride_bytes;
    image.descriptor.samples = 2;
    let expected = [0, 1].map(|layer| image.words(0, layer, [1, 2, 0])[0]);
    image.descriptor.layer_count = 1;
    let op = ImageOp {
        multisampled: true,
        texel: Type::I32,
        ..image_op(ImageOpKind::Fetch, Dim::D2)
    };
    let mut samples = [0; 16];
    (samples[1], samples[2]) = (1, 2);
    let results = run(
        &op,
        &image.descriptor,
        None,
        7,
        &[[1; 16], [2; 16], samples],
    );
    assert_eq!(results[0][..3], [expected[0], expected[1], 0]);
}

#[test]
fn null_descriptors_read_zero() {
    let op = image_op(ImageOpKind::Fetch, Dim::D2);
    let mut results = [[7; 16]; 8];
    // SAFETY: no image.
    unsafe { execute_block(&op, None, None, 1, &[&[0; 16], &[0; 16]], &mut results) };
    assert_eq!(results.map(|row| row[0])[..4], [0; 4]);
}

#[test]
fn lanes_with_different_images_keep_their_own_texels() {
    let images =
        [1, 2, 3].map(|side| Image::new(Format::R8G8B8A8_UINT, Dim::D2, [side, 4, 1], 1, 1, side));
    let descriptors = images.each_ref().map(|image| Descriptor {
        image: &image.descriptor,
        ..Descriptor::NULL
    });
    let addresses: [u64; 16] = std::array::from_fn(|lane| &raw const descriptors[lane % 3] as u64);
    let op = ImageOp {
        texel: Type::I32,
        ..image_op(ImageOpKind::Fetch, Dim::D2)
    };
    let mut results = [[7; 16]; 8];
    let rows: [&Row; 2] = [&[0; 16], &[3; 16]];
    // SAFETY: descriptors and images are alive.
    unsafe { execute(&op, &addresses, &[0; 16], 0x7fff, &rows, &mut results) };
    for lane in 0..15 {
        let expected = images[lane % 3].words(0, 0, [0, 3, 0]);
        assert_eq!(
            std::array::from_fn(|c| results[c][lane]),
            expected,
            "lane {lane}"
        );
    }
    assert_eq!(results[0][15], 7);
}
