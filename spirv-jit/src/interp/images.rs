//! Image operations: operands gathered into rows for [`crate::image::execute`].

use super::machine::{Instr, Machine, Operand};
use crate::SUBGROUP_SIZE;
use crate::image::execute::{MAX_RESULT_ROWS, execute};
use crate::program::Row;

/// Most operand rows: coordinates, derivatives, offsets and texels of the widest operation, with room.
const MAX_OPERAND_ROWS: usize = 32;

/// Whether the rows of an operation fit what [`image`] sets aside.
pub(super) fn fits(operand_rows: usize, result_rows: usize) -> bool {
    operand_rows <= MAX_OPERAND_ROWS && result_rows <= MAX_RESULT_ROWS
}

/// The image operation by plan `x`.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs.
pub(super) unsafe fn image(m: &mut Machine<'_>, i: &Instr) {
    let plan = &m.program.code.images[i.x as usize];
    for &offset in m.listed() {
        let mask = m.active[offset as usize / 64];
        let mut words = [[0u32; SUBGROUP_SIZE]; MAX_OPERAND_ROWS];
        let mut count = 0;
        let mut results = [[0u32; SUBGROUP_SIZE]; MAX_RESULT_ROWS];
        // SAFETY: as the caller promises; active lanes hold addresses of descriptors.
        unsafe {
            for &(operand, wide) in &plan.operands {
                if wide {
                    let (low, high) = split(&*m.block::<u64>(operand, offset));
                    words[count] = low;
                    words[count + 1] = high;
                    count += 2;
                } else {
                    words[count] = *m.block::<u32>(operand, offset);
                    count += 1;
                }
            }
            let rows: [&Row; MAX_OPERAND_ROWS] = std::array::from_fn(|k| &words[k]);
            let images = &*m.block::<u64>(plan.image, offset);
            let samplers = match plan.sampler == Operand::NONE {
                true => &[0; SUBGROUP_SIZE],
                false => &*m.block::<u64>(plan.sampler, offset),
            };
            execute(
                &plan.op,
                images,
                samplers,
                mask,
                &rows[..count],
                &mut results,
            );
            let mut row = 0;
            for &(result, wide) in &plan.results {
                if wide {
                    *m.block::<u64>(result, offset) = join(&results[row], &results[row + 1]);
                    row += 2;
                } else {
                    *m.block::<u32>(result, offset) = results[row];
                    row += 1;
                }
            }
        }
    }
}

fn split(lanes: &[u64; SUBGROUP_SIZE]) -> (Row, Row) {
    (
        std::array::from_fn(|k| lanes[k] as u32),
        std::array::from_fn(|k| (lanes[k] >> 32) as u32),
    )
}

fn join(low: &Row, high: &Row) -> [u64; SUBGROUP_SIZE] {
    std::array::from_fn(|k| low[k] as u64 | (high[k] as u64) << 32)
}
