//! Performing an [`ImageOp`] on an image without a conversion.

use lanes::{Row, Tier};

use super::fast::Fast;
use super::format::block::each_lane;
use super::operands::{Operands, usable};
use super::residency::Residency;
use super::{Dim, ImageDescriptor, ImageOp, ImageOpKind, Level, SamplerDescriptor};
use super::{access, sample, wave};

/// As [`execute_block`](super::execute::execute_block), whatever the image's conversion says.
///
/// # Safety
/// As there.
pub(super) unsafe fn execute_plain(
    op: &ImageOp,
    image: Option<&ImageDescriptor>,
    sampler: Option<&SamplerDescriptor>,
    mask: u16,
    rows: &[&Row],
    residency: Option<&Residency<'_>>,
    results: &mut [Row],
) {
    let Some((image, info)) = usable(image) else {
        return put_null(op, mask, results);
    };
    let operands = Operands {
        residency,
        ..Operands::new(op, rows)
    };
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match op.kind {
            // The base level is outside of the view ("Integer Texel Coordinate Operations").
            ImageOpKind::Gather(_) if !image.has_level(0) => put_null(op, mask, results),
            ImageOpKind::Sample | ImageOpKind::Gather(_) => match sampler {
                Some(sampler) => match Fast::new(op, image, info, sampler, 0xf) {
                    Some(fast) => {
                        let results = &mut results[..op.result_rows()];
                        wave::of_one(rows, mask, results, |one| {
                            wave::sample(Tier::best(), &fast, one);
                        })
                    }
                    None => {
                        sample::sample(
                            Tier::best(),
                            op,
                            &operands,
                            image,
                            info,
                            sampler,
                            mask,
                            results,
                        );
                    }
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

fn put(mask: u16, row: &mut Row, value: u32) {
    each_lane(mask, |lane| row[lane] = value);
}

/// Results of the null descriptor.
fn put_null(op: &ImageOp, mask: u16, results: &mut [Row]) {
    for row in &mut results[..op.result_rows()] {
        put(mask, row, 0);
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
