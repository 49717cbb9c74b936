//! The rows that an [`ImageOp`] reads and writes.

use lanes::{LANES, Row};

use super::format::block::Texels;
use super::format::{FormatInfo, Numeric};
use super::residency::Residency;
use super::{AtomicOp, ImageDescriptor, ImageOp, ImageOpKind, LodMode, TexelType};

/// Most result rows an operation has: four texel components of 64 bits and a residency code.
pub const MAX_RESULT_ROWS: usize = 9;

impl ImageOp {
    /// Whether a sampler descriptor follows the image descriptor.
    pub fn has_sampler(&self) -> bool {
        matches!(
            self.kind,
            ImageOpKind::Sample | ImageOpKind::Gather(_) | ImageOpKind::QueryLod
        )
    }

    /// Queries that take no coordinates.
    pub fn is_size_query(&self) -> bool {
        matches!(
            self.kind,
            ImageOpKind::QuerySize | ImageOpKind::QueryLevels | ImageOpKind::QuerySamples
        )
    }

    /// Rows of 32-bit words that an operation reads: all operands but the descriptors, 64-bit ones
    /// as two rows.
    pub fn operand_rows(&self) -> usize {
        let words = if self.texel == TexelType::I64 { 2 } else { 1 };
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

    /// Rows of 32-bit words that an operation produces.
    pub fn result_rows(&self) -> usize {
        let words = if self.texel == TexelType::I64 { 2 } else { 1 };
        let rows = match self.kind {
            ImageOpKind::Sample if self.depth_compare => 1,
            ImageOpKind::Sample
            | ImageOpKind::Fetch
            | ImageOpKind::Gather(_)
            | ImageOpKind::Read => 4 * words,
            ImageOpKind::Write => 0,
            ImageOpKind::Atomic(AtomicOp::Store) => 0,
            ImageOpKind::Atomic(_) => words,
            ImageOpKind::QuerySize => self.size_components(),
            ImageOpKind::QueryLevels | ImageOpKind::QuerySamples => 1,
            ImageOpKind::QueryLod => 2,
        };
        rows + self.residency as usize
    }

    /// Operand rows before those of the level of detail.
    pub fn rows_before_lod(&self) -> usize {
        self.coordinate_count() + self.depth_compare as usize
    }

    /// Components of a size query: a cube has two.
    pub(super) fn size_components(&self) -> usize {
        let spatial = match self.dim {
            super::Dim::Cube => 2,
            _ => self.spatial_count(),
        };
        spatial + self.arrayed as usize
    }
}

/// Texel operands of an atomic.
fn atomic_operands(op: AtomicOp) -> usize {
    match op {
        AtomicOp::Load => 0,
        AtomicOp::CompareExchange => 2,
        _ => 1,
    }
}

/// An image that is there, and its format.
#[inline(always)]
pub fn usable(image: Option<&ImageDescriptor>) -> Option<(&ImageDescriptor, &'static FormatInfo)> {
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
    /// Collects the lanes that read texels without memory, for operations with a residency code.
    pub residency: Option<&'a Residency<'a>>,
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
            residency: None,
        }
    }
}

/// A 64-bit operand of two rows.
pub(super) fn read_64(low: &Row, high: &Row, lane: usize) -> u64 {
    low[lane] as u64 | (high[lane] as u64) << 32
}

/// Texel components to result rows, widened where the operation's texels are 64-bit.
#[inline(always)]
pub(super) fn put_texels(op: &ImageOp, info: &FormatInfo, texels: &Texels, results: &mut [Row]) {
    if op.texel != TexelType::I64 {
        results[..4].copy_from_slice(texels);
        return;
    }
    for (component, row) in texels.iter().enumerate() {
        results[2 * component] = *row;
        results[2 * component + 1] = match info.numeric {
            Numeric::Sint => row.map(|word| (word as i32 >> 31) as u32),
            _ => [0; LANES],
        };
    }
}

/// The view's component mapping.
#[inline(always)]
pub(super) fn swizzle(image: &ImageDescriptor, info: &FormatInfo, texels: &mut Texels) {
    if image.swizzle == [0, 1, 2, 3] {
        return;
    }
    let source = *texels;
    for (row, from) in texels.iter_mut().zip(image.swizzle) {
        *row = match from {
            0..=3 => source[from as usize],
            4 => [0; LANES],
            _ => [info.missing(3); LANES],
        };
    }
}
