//! Scaled copies with conversion between formats (spec, "Image Copies With Scaling"). The source is
//! sampled as in a shader, 16 texels at a time, and encoded into the destination. All workers share
//! the rows.

use ash::vk;
use images::execute::execute_block;
use images::fast::Fast;
use images::format::block::Texels;
use images::halve::Halving;
use images::operands::{MAX_RESULT_ROWS, usable};
use images::texels::store_row;
use images::wave::{self, Rows, Wave};
use images::{
    AddressMode, Dim, Filter, Format, ImageDescriptor, ImageOp, ImageOpKind, Level, MAX_LEVELS,
    SamplerDescriptor,
};
use lanes::{LaneMask, Tier};
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::Row;

use super::rows::for_rows;
use super::surface::{Surface, aspects, slice_count};
use crate::format::texel_format;
use crate::object::Image;
use crate::wave::Workers;

/// `vkCmdBlitImage`, one region. Swapped corners on one side mirror it.
pub fn blit_image(
    workers: &Workers,
    source: &Image,
    destination: &Image,
    blit: &vk::ImageBlit,
    filter: vk::Filter,
) {
    for aspect in aspects(blit.src_subresource.aspect_mask) {
        let surfaces = (
            Surface::new(source, aspect, blit.src_subresource.mip_level),
            Surface::new(destination, aspect, blit.dst_subresource.mip_level),
        );
        let level = source
            .plane(aspect)
            .and_then(|plane| plane.levels.get(blit.src_subresource.mip_level as usize));
        if let (Some(from), Some(to), Some(level)) = (surfaces.0, surfaces.1, level) {
            let format = source.plane(aspect).map(|plane| texel_format(plane.format));
            let format = format.unwrap_or(Format::UNDEFINED);
            let size = [level.width, level.height];
            let reader = Reader::new(source, &from, size, format, filter);
            blit_surface(workers, source, (&from, &reader), destination, &to, blit);
        }
    }
}

/// The region's destination texels on one axis, and the source coordinates of their centers.
#[derive(Clone, Copy)]
struct BlitAxis {
    /// Destination texels.
    first: i64,
    count: i64,
    /// The source coordinate, in texels, of the centre of destination texel `i` is `origin + (i +
    /// 0.5) * scale`.
    origin: f64,
    scale: f64,
}

impl BlitAxis {
    /// From corners of the source and of the destination, clipped to the destination's size.
    fn new(source: [i32; 2], destination: [i32; 2], size: u32) -> Option<Self> {
        let [s0, s1] = source.map(f64::from);
        let [d0, d1] = destination.map(f64::from);
        if d0 == d1 {
            return None;
        }
        let scale = (s1 - s0) / (d1 - d0);
        let low = i64::from(destination[0].min(destination[1])).max(0);
        let high = i64::from(destination[0].max(destination[1])).min(i64::from(size));
        Some(Self {
            first: low,
            count: (high - low).max(0),
            origin: s0 - d0 * scale,
            scale,
        })
    }

    /// Source coordinate of a destination texel.
    fn coordinate(&self, index: i64) -> f32 {
        (self.origin + (index as f64 + 0.5) * self.scale) as f32
    }
}

fn blit_surface(
    workers: &Workers,
    source: &Image,
    (from, reader): (&Surface, &Reader),
    destination: &Image,
    to: &Surface,
    blit: &vk::ImageBlit,
) {
    let [s0, s1] = blit.src_offsets;
    let [d0, d1] = blit.dst_offsets;
    let sides = (
        BlitAxis::new([s0.x, s1.x], [d0.x, d1.x], to.width),
        BlitAxis::new([s0.y, s1.y], [d0.y, d1.y], to.height),
    );
    let (Some(x_side), Some(y_side)) = sides else {
        return;
    };
    let is_volume = |image: &Image| image.image_type == vk::ImageType::TYPE_3D;
    // Slices are scaled between depths, and paired one to one where either side has layers.
    let z_side = if is_volume(source) && is_volume(destination) {
        BlitAxis::new([s0.z, s1.z], [d0.z, d1.z], to.slices)
    } else {
        let first = |image: &Image, z: [i32; 2], layers: &vk::ImageSubresourceLayers| {
            match is_volume(image) {
                true => z[0].min(z[1]),
                false => layers.base_array_layer as i32,
            }
        };
        let count = |image: &Image, z: [i32; 2], layers: &vk::ImageSubresourceLayers| {
            slice_count(image, layers, z[0].abs_diff(z[1]))
        };
        let from_first = first(source, [s0.z, s1.z], &blit.src_subresource);
        let to_first = first(destination, [d0.z, d1.z], &blit.dst_subresource);
        let slices = count(source, [s0.z, s1.z], &blit.src_subresource).min(count(
            destination,
            [d0.z, d1.z],
            &blit.dst_subresource,
        )) as i32;
        let span = |first: i32| [first, first.saturating_add(slices)];
        BlitAxis::new(span(from_first), span(to_first), to.slices)
    };
    let Some(z_side) = z_side else {
        return;
    };
    // A blit takes much longer than a copy of as many bytes, so fewer bytes pay off for a worker.
    const COST: u64 = 32;
    let row_bytes = x_side.count as u64 * to.texel_size_bytes as u64;
    let rows = z_side.count as u64 * y_side.count as u64;
    let halved = Halved::new(from, to, reader, [&x_side, &y_side, &z_side]);
    let columns = columns(&x_side);
    for_rows(workers, rows, row_bytes * COST, |rows| {
        let sampler = RowSampler::new(reader);
        let mut texels = [[[0; SUBGROUP_SIZE]; 4]; AT_ONCE];
        for row in rows {
            let y = y_side.first + (row % y_side.count as u64) as i64;
            let z = z_side.first + (row / y_side.count as u64) as i64;
            // SAFETY: source and destination are bound to memory that the application keeps during
            // execution, and the sides are clipped to the destination's size.
            unsafe {
                if let Some(halved) = &halved {
                    halved.row(y, z);
                    continue;
                }
                let first = to.texel(x_side.first as u32, y as u32, z as u32, 0);
                let (v, w) = (y_side.coordinate(y), z_side.coordinate(z));
                let count = x_side.count as usize;
                for (index, columns) in columns.chunks(AT_ONCE).enumerate() {
                    let done = index * AT_ONCE * SUBGROUP_SIZE;
                    sampler.sample(columns, v, w, &mut texels);
                    let at = first.add(done * to.texel_size_bytes);
                    store_row(to.format, at, &texels[..columns.len()], count - done);
                }
            };
        }
    });
}

/// The source columns of a row's texels, sixteen to a subgroup.
fn columns(side: &BlitAxis) -> Vec<Row> {
    let first = (0..side.count).step_by(SUBGROUP_SIZE);
    let columns = first.map(|first| {
        std::array::from_fn(|lane| {
            let index = side.first + first + lane as i64;
            side.coordinate(index).to_bits()
        })
    });
    columns.collect()
}

/// A blit in which each destination texel covers two by two source texels.
struct Halved<'a> {
    halving: Halving,
    from: &'a Surface,
    to: &'a Surface,
    /// The first texels, and the number of destination texels in a row.
    source: [u32; 3],
    destination: [u32; 3],
    count: usize,
}

impl<'a> Halved<'a> {
    /// `None` for other blits, and for those that read texels past the source's edge.
    fn new(
        from: &'a Surface,
        to: &'a Surface,
        reader: &Reader,
        [x, y, z]: [&BlitAxis; 3],
    ) -> Option<Self> {
        let is_half = reader.sampler.mag_filter == Filter::Linear
            && !reader.is_volume
            && from.format.name == to.format.name
            && [x.scale, y.scale, z.scale] == [2.0, 2.0, 1.0];
        let halving = Halving::new(to.format).filter(|_| is_half)?;
        let first = |side: &BlitAxis, size: u32| {
            let first = side.origin + side.first as f64 * side.scale;
            let end = first + side.count as f64 * side.scale;
            (first >= 0.0 && end <= f64::from(size)).then_some(first as u32)
        };
        Some(Self {
            halving,
            from,
            to,
            source: [
                first(x, from.width)?,
                first(y, from.height)?,
                first(z, from.slices)?,
            ],
            destination: [x, y, z].map(|side| side.first as u32),
            count: x.count as usize,
        })
    }

    /// Computes a row of the destination.
    ///
    /// # Safety
    /// The row is one of the blit's, and the memory of both images stays allocated during the call.
    unsafe fn row(&self, y: i64, z: i64) {
        let ([x, first_y, first_z], [to_x, to_y, to_z]) = (self.source, self.destination);
        let (to_row, slice) = (y as u32, z as u32);
        let row = first_y + 2 * (to_row - to_y);
        let from_slice = first_z + (slice - to_z);
        let rows = [row, row + 1].map(|row| self.from.texel(x, row, from_slice, 0).cast_const());
        let to = self.to.texel(to_x, to_row, slice, 0);
        // SAFETY: the caller passes a row of the blit, and `new` has checked that all rows are
        // inside of the source.
        unsafe { self.halving.row(rows, to, self.count) };
    }
}

/// The source, sampled as in a shader: one level, coordinates in texels, clamped to the edge.
struct Reader {
    op: ImageOp,
    image: ImageDescriptor,
    sampler: SamplerDescriptor,
    is_volume: bool,
}

// SAFETY: the image is only read, and valid usage keeps the region of the destination apart from
// it.
unsafe impl Sync for Reader {}

impl Reader {
    /// The source for a level of `size` texels.
    fn new(
        source: &Image,
        from: &Surface,
        size: [u32; 2],
        format: Format,
        filter: vk::Filter,
    ) -> Self {
        let is_volume = source.image_type == vk::ImageType::TYPE_3D;
        let mut levels = [Level::default(); MAX_LEVELS];
        levels[0] = Level {
            offset_bytes: 0,
            row_stride_bytes: from.row_stride_bytes,
            slice_stride_bytes: from.slice_stride_bytes,
            width: size[0],
            height: size[1],
            depth: if is_volume { from.slices } else { 1 },
        };
        let filter = match filter {
            vk::Filter::LINEAR => Filter::Linear,
            _ => Filter::Nearest,
        };
        Self {
            op: ImageOp {
                arrayed: !is_volume,
                ..ImageOp::plain(
                    ImageOpKind::Sample,
                    if is_volume { Dim::D3 } else { Dim::D2 },
                )
            },
            image: ImageDescriptor {
                data: from.texel(0, 0, 0, 0),
                size_bytes: from
                    .slice_stride_bytes
                    .saturating_mul(u64::from(from.slices)),
                format,
                dim: if is_volume { Dim::D3 } else { Dim::D2 },
                arrayed: !is_volume,
                samples: 1,
                level_count: 1,
                layer_count: if is_volume { 1 } else { from.slices },
                layer_stride_bytes: from.slice_stride_bytes,
                sample_stride_bytes: 0,
                swizzle: [0, 1, 2, 3],
                min_lod: 0.0,
                levels,
                conversion: None,
            },
            sampler: SamplerDescriptor {
                mag_filter: filter,
                min_filter: filter,
                address_mode: [AddressMode::ClampToEdge; 3],
                unnormalized_coordinates: true,
                ..SamplerDescriptor::DEFAULT
            },
            is_volume,
        }
    }
}

/// Subgroups that are sampled at once.
const AT_ONCE: usize = 16;

/// Samples rows of a source.
struct RowSampler<'a> {
    reader: &'a Reader,
    /// None for sources that are sampled subgroup by subgroup.
    fast: Option<Fast<'a>>,
}

impl<'a> RowSampler<'a> {
    fn new(reader: &'a Reader) -> Self {
        let fast = usable(Some(&reader.image))
            .and_then(|(image, info)| Fast::new(&reader.op, image, info, &reader.sampler, 0xf));
        Self { reader, fast }
    }

    /// Samples columns of a row, at most [`AT_ONCE`] subgroups.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    unsafe fn sample(&self, columns: &[Row], v: f32, w: f32, texels: &mut [Texels; AT_ONCE]) {
        let Self { reader, fast } = self;
        let mut v = [v.to_bits(); SUBGROUP_SIZE];
        // A layer's index is the slice's center less a half.
        let w = if reader.is_volume { w } else { w - 0.5 };
        let mut w = [w.to_bits(); SUBGROUP_SIZE];
        let Some(fast) = fast else {
            for (columns, texels) in columns.iter().zip(texels) {
                let mut results = [[0; SUBGROUP_SIZE]; MAX_RESULT_ROWS];
                // SAFETY: the caller keeps the contract of this function.
                unsafe {
                    execute_block(
                        &reader.op,
                        Some(&reader.image),
                        Some(&reader.sampler),
                        u16::MAX,
                        &[columns, &v, &w],
                        &mut results,
                    );
                }
                texels.copy_from_slice(&results[..4]);
            }
            return;
        };
        let subgroups: [u16; AT_ONCE] = std::array::from_fn(|index| index as u16);
        let results: *mut Row = texels.as_mut_ptr().cast();
        let result = |component: usize| Rows {
            first: results.wrapping_add(component),
            step_bytes: size_of::<Texels>(),
        };
        let shared = |row: &mut Row| Rows {
            first: row,
            step_bytes: 0,
        };
        let along = Rows {
            first: columns.as_ptr().cast_mut(),
            step_bytes: size_of::<Row>(),
        };
        let wave = Wave {
            subgroups: &subgroups[..columns.len().min(AT_ONCE)],
            lanes: &[LaneMask::ALL; AT_ONCE],
            operands: &[along, shared(&mut v), shared(&mut w)],
            results: [result(0), result(1), result(2), result(3)],
            derives: false,
        };
        // SAFETY: the operation takes three coordinates, of which each subgroup has a row, as it
        // has of the results; the caller keeps the image's memory.
        unsafe { wave::sample(Tier::best(), fast, &wave) };
    }
}
