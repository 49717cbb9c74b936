//! Performing an [`ImageOp`]: the entry for interpreters and compiled code.
//!
//! The unit is a block of 16 lanes. Descriptors that are the same in all active lanes, the common case, are set up once for the block; where they
//! differ, lanes are grouped by descriptor.

use super::fast::Fast;
use super::format::block::{Texels, each_lane};
use super::format::{FormatInfo, Numeric};
use super::{Dim, ImageDescriptor, ImageOp, ImageOpKind, Level, LodMode, SamplerDescriptor};
use super::{access, sample, ycbcr};
use crate::SUBGROUP_SIZE;
use crate::environment::Environment;
use crate::ir::Type;
use crate::program::Row;

/// Most result rows an operation has: four texel components of 64 bits.
pub const MAX_RESULT_ROWS: usize = 8;

impl ImageOp {
    /// Whether a sampler descriptor follows the image descriptor.
    pub fn has_sampler(&self) -> bool {
        matches!(
            self.kind,
            ImageOpKind::Sample | ImageOpKind::Gather(_) | ImageOpKind::QueryLod
        )
    }

    /// Queries that take no coordinates.
    fn is_size_query(&self) -> bool {
        matches!(
            self.kind,
            ImageOpKind::QuerySize | ImageOpKind::QueryLevels | ImageOpKind::QuerySamples
        )
    }

    /// Rows of 32-bit words that [`execute`] reads: all operands but the descriptors, 64-bit ones as two rows.
    pub fn operand_rows(&self) -> usize {
        let words = if self.texel == Type::I64 { 2 } else { 1 };
        let spatial = self.spatial_count();
        let is_query = self.is_size_query();
        let coordinates = match self.kind {
            _ if is_query => 0,
            _ => self.coordinate_count(),
        };
        let lod = match self.lod {
            LodMode::Implicit => 0,
            LodMode::Bias | LodMode::Lod => 1,
            LodMode::Grad => 2 * spatial,
        };
        let offsets = match (self.has_offsets, self.has_offset) {
            (true, _) => 4 * spatial,
            (false, true) => spatial,
            (false, false) => 0,
        };
        let texel = match self.kind {
            ImageOpKind::Write => 4 * words,
            ImageOpKind::Atomic(op) => words * atomic_operands(op),
            _ => 0,
        };
        let sample = self.multisampled && !is_query;
        coordinates
            + self.depth_compare as usize
            + lod
            + self.has_min_lod as usize
            + offsets
            + sample as usize
            + texel
    }

    /// Rows of 32-bit words that [`execute`] produces.
    pub fn result_rows(&self) -> usize {
        let words = if self.texel == Type::I64 { 2 } else { 1 };
        match self.kind {
            ImageOpKind::Sample if self.depth_compare => 1,
            ImageOpKind::Sample
            | ImageOpKind::Fetch
            | ImageOpKind::Gather(_)
            | ImageOpKind::Read => 4 * words,
            ImageOpKind::Write => 0,
            ImageOpKind::Atomic(crate::ir::op::AtomicOp::Store) => 0,
            ImageOpKind::Atomic(_) => words,
            ImageOpKind::QuerySize => self.size_components(),
            ImageOpKind::QueryLevels | ImageOpKind::QuerySamples => 1,
            ImageOpKind::QueryLod => 2,
        }
    }

    /// Components of a size query: a cube has two.
    fn size_components(&self) -> usize {
        let spatial = match self.dim {
            super::Dim::Cube => 2,
            _ => self.spatial_count(),
        };
        spatial + self.arrayed as usize
    }
}

/// Texel operands of an atomic.
fn atomic_operands(op: crate::ir::op::AtomicOp) -> usize {
    use crate::ir::op::AtomicOp;
    match op {
        AtomicOp::Load => 0,
        AtomicOp::CompareExchange => 2,
        _ => 1,
    }
}

/// Performs `op` in the lanes of `mask`, for a block of 16 lanes.
///
/// * `images`, `samplers`: per lane, the address of a descriptor in the `environment`, as `Op::Descriptor` gives it; `samplers` is looked at only if
///   [`ImageOp::has_sampler`]. Only active lanes are looked at.
/// * `operands`: the operands after the descriptors, in [`ImageOp`]'s order, one row each; a 64-bit operand is two rows, low word first
///   ([`ImageOp::operand_rows`] in all).
/// * `results`: [`ImageOp::result_rows`] rows, 64-bit results as two rows, low word first. Inactive lanes get unspecified values.
///
/// Null descriptors and accesses outside the image follow robustness2: reads give (0, 0, 0, 1) where the format lacks components and zero elsewhere,
/// writes are dropped. Lanes are performed in order of their index, so that writes and atomics of one block are deterministic.
///
/// # Safety
/// Active lanes' descriptor addresses are those of live descriptors, whose images cover memory that stays allocated during the call.
pub unsafe fn execute(
    op: &ImageOp,
    environment: &Environment,
    images: &[u64; SUBGROUP_SIZE],
    samplers: &[u64; SUBGROUP_SIZE],
    mask: u16,
    operands: &[&Row],
    results: &mut [Row],
) {
    debug_assert_eq!(operands.len(), op.operand_rows());
    debug_assert!(results.len() >= op.result_rows());
    let has_sampler = op.has_sampler();
    let mut rest = mask;
    while rest != 0 {
        let first = rest.trailing_zeros() as usize;
        let mut group = 0u16;
        for lane in 0..SUBGROUP_SIZE {
            let same = images[lane] == images[first]
                && (!has_sampler || samplers[lane] == samplers[first]);
            group |= (same as u16) << lane;
        }
        group &= rest;
        rest &= !group;
        // SAFETY: the caller vouches for the descriptors of active lanes.
        unsafe {
            let descriptor = environment.descriptor(images[first]);
            let held = descriptor.held_image();
            let image = match &held {
                Some(image) => Some(image),
                None => descriptor.viewed_image().as_ref(),
            };
            let sampler = if has_sampler {
                environment.descriptor(samplers[first]).sampler.as_ref()
            } else {
                None
            };
            if group == mask {
                return execute_block(op, image, sampler, group, operands, results);
            }
            // A block writes whole rows: other groups' lanes must not be touched.
            let mut part = [[0; SUBGROUP_SIZE]; MAX_RESULT_ROWS];
            execute_block(op, image, sampler, group, operands, &mut part);
            for (row, part) in results.iter_mut().zip(&part[..op.result_rows()]) {
                each_lane(group, |lane| row[lane] = part[lane]);
            }
        }
    }
}

/// [`execute`] with one image and sampler for all lanes of `mask`; `None` is the null descriptor.
///
/// # Safety
/// The image's memory stays allocated during the call.
pub unsafe fn execute_block(
    op: &ImageOp,
    image: Option<&ImageDescriptor>,
    sampler: Option<&SamplerDescriptor>,
    mask: u16,
    operands: &[&Row],
    results: &mut [Row],
) {
    let rows = operands;
    let operands = Operands::new(op, rows);
    let Some((image, info)) = usable(image) else {
        return put_null(op, mask, results);
    };
    if let (ImageOpKind::Sample, Some(conversion), Some(sampler), false) =
        (op.kind, &image.conversion, sampler, op.depth_compare)
    {
        // SAFETY: the caller's promise.
        return unsafe { ycbcr::sample(op, image, conversion, sampler, mask, rows, results) };
    }
    // SAFETY: the caller's promise.
    unsafe {
        match op.kind {
            ImageOpKind::Sample | ImageOpKind::Gather(_) => match sampler {
                Some(sampler) => match Fast::new(op, image, info, sampler, 0xf) {
                    Some(fast) => sample::sample_fast(&fast, &operands, mask, results),
                    None => sample::sample(op, &operands, image, info, sampler, mask, results),
                },
                None => put_null(op, mask, results),
            },
            ImageOpKind::QueryLod => match sampler {
                Some(sampler) => sample::query_lod(op, &operands, image, sampler, mask, results),
                None => put_null(op, mask, results),
            },
            ImageOpKind::Fetch | ImageOpKind::Read => {
                access::read(op, &operands, image, info, mask, results);
            }
            ImageOpKind::Write => access::write(op, &operands, image, info, mask),
            ImageOpKind::Atomic(atomic) => {
                access::atomic(op, atomic, &operands, image, info, mask, results);
            }
            ImageOpKind::QuerySize => query_size(op, &operands, image, mask, results),
            ImageOpKind::QueryLevels => put(mask, &mut results[0], image.level_count as u32),
            ImageOpKind::QuerySamples => put(mask, &mut results[0], image.samples.max(1) as u32),
        }
    }
}

/// An image that is there, and its format.
#[inline(always)]
pub(crate) fn usable(
    image: Option<&ImageDescriptor>,
) -> Option<(&ImageDescriptor, &'static FormatInfo)> {
    let image = image.filter(|image| {
        !image.data.is_null() && image.level_count != 0 && image.levels[0].width != 0
    })?;
    Some((image, image.format.info()?))
}

/// An operation's operand rows, by name.
pub(crate) struct Operands<'a> {
    pub coordinates: &'a [&'a Row],
    pub depth_reference: Option<&'a Row>,
    /// Bias, level, or derivatives along the screen's x, then y.
    pub lod: &'a [&'a Row],
    pub min_lod: Option<&'a Row>,
    pub offsets: &'a [&'a Row],
    pub sample: Option<&'a Row>,
    pub texel: &'a [&'a Row],
}

impl<'a> Operands<'a> {
    #[inline(always)]
    pub(crate) fn new(op: &ImageOp, rows: &'a [&'a Row]) -> Self {
        let spatial = op.spatial_count();
        let mut rest = rows;
        let mut take = |count: usize| {
            let (taken, left) = rest.split_at(count);
            rest = left;
            taken
        };
        let is_query = op.is_size_query();
        Operands {
            coordinates: take(if is_query { 0 } else { op.coordinate_count() }),
            depth_reference: take(op.depth_compare as usize).first().copied(),
            lod: take(match op.lod {
                LodMode::Implicit => 0,
                LodMode::Bias | LodMode::Lod => 1,
                LodMode::Grad => 2 * spatial,
            }),
            min_lod: take(op.has_min_lod as usize).first().copied(),
            offsets: take(match (op.has_offsets, op.has_offset) {
                (true, _) => 4 * spatial,
                (false, true) => spatial,
                (false, false) => 0,
            }),
            sample: take((op.multisampled && !is_query) as usize)
                .first()
                .copied(),
            texel: rest,
        }
    }
}

/// A 64-bit operand of two rows.
pub(super) fn read_64(low: &Row, high: &Row, lane: usize) -> u64 {
    low[lane] as u64 | (high[lane] as u64) << 32
}

fn put(mask: u16, row: &mut Row, value: u32) {
    each_lane(mask, |lane| row[lane] = value);
}

/// Results of the null descriptor.
fn put_null(op: &ImageOp, mask: u16, results: &mut [Row]) {
    for row in &mut results[..op.result_rows()] {
        put(mask, row, 0);
    }
}

/// Texel components to result rows, widened where the operation's texels are 64-bit.
#[inline(always)]
pub(super) fn put_texels(op: &ImageOp, info: &FormatInfo, texels: &Texels, results: &mut [Row]) {
    if op.texel != Type::I64 {
        results[..4].copy_from_slice(texels);
        return;
    }
    for (component, row) in texels.iter().enumerate() {
        results[2 * component] = *row;
        results[2 * component + 1] = match info.numeric {
            Numeric::Sint => row.map(|word| (word as i32 >> 31) as u32),
            _ => [0; SUBGROUP_SIZE],
        };
    }
}

/// `OpImageQuerySize`, `OpImageQuerySizeLod`: zeros for a level that does not exist.
fn query_size(
    op: &ImageOp,
    operands: &Operands<'_>,
    image: &ImageDescriptor,
    mask: u16,
    results: &mut [Row],
) {
    each_lane(mask, |lane| {
        let index = operands.lod.first().map_or(0, |row| row[lane] as usize);
        let level = if index < image.level_count as usize {
            image.levels[index]
        } else {
            Level::default()
        };
        let size = [level.width, level.height, level.depth];
        let count = op.size_components();
        for component in 0..count {
            let is_layers = op.arrayed && component + 1 == count;
            results[component][lane] = match (is_layers, op.dim) {
                (true, Dim::Cube) => image.layer_count / 6,
                (true, _) => image.layer_count,
                (false, _) => size[component],
            };
        }
    });
}
