//! Performing an [`ImageOp`] for a block of 16 lanes: the entry for interpreters and for blits.

use lanes::Row;

use super::block::execute_plain;
use super::operands::usable;
use super::residency::Residency;
use super::{ImageDescriptor, ImageOp, ImageOpKind, SamplerDescriptor, ycbcr};

/// Performs `op` in the lanes of `mask` on one image and with one sampler; `None` is the null
/// descriptor.
///
/// * `operands`: the operands after the descriptors, in [`ImageOp`]'s order, one row each; a 64-bit
///   operand is two rows, low word first ([`ImageOp::operand_rows`] in all).
/// * `results`: [`ImageOp::result_rows`] rows, 64-bit results as two rows, low word first. Inactive
///   lanes get unspecified values.
///
/// Null descriptors and accesses outside the image follow robustness2: reads give (0, 0, 0, 1)
/// where the format lacks components and zero elsewhere, writes are dropped. Lanes are performed in
/// order of their index, so that writes and atomics of one block are deterministic.
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
    // SAFETY: the caller guarantees that the image's memory stays allocated during the call.
    unsafe { execute_resident(op, image, sampler, mask, operands, None, results) };
}

/// As [`execute_block`], and the lanes that read texels without memory. Residency codes are left to
/// the caller.
///
/// # Safety
/// As there.
pub unsafe fn execute_resident(
    op: &ImageOp,
    image: Option<&ImageDescriptor>,
    sampler: Option<&SamplerDescriptor>,
    mask: u16,
    operands: &[&Row],
    residency: Option<&Residency<'_>>,
    results: &mut [Row],
) {
    if op.kind == ImageOpKind::Sample
        && !op.depth_compare
        && let Some((image, _)) = usable(image)
        && let (Some(conversion), Some(sampler)) = (&image.conversion, sampler)
    {
        // SAFETY: the caller keeps the contract of this function.
        return unsafe {
            ycbcr::sample(
                op, image, conversion, sampler, mask, operands, residency, results,
            )
        };
    }
    // SAFETY: the caller keeps the contract of this function.
    unsafe { execute_plain(op, image, sampler, mask, operands, residency, results) };
}
