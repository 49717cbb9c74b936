//! Operations on rows in packets, in plain Rust.

use lanes::LaneMask;

use crate::walk::level_ray::{max, min};
use crate::walk::rows::Lanes;

/// Which numbers are not greater than others.
#[inline(always)]
fn not_greater<const N: usize>(numbers: &[f32; N], others: &[f32; N]) -> u32 {
    let mut lanes = 0;
    for i in 0..N {
        lanes |= u32::from(numbers[i] <= others[i]) << i;
    }
    lanes
}

/// Which of eight numbers are not greater than others.
#[inline(always)]
pub(super) fn eight_not_greater(numbers: &[f32; 8], others: &[f32; 8]) -> u32 {
    not_greater(numbers, others)
}

/// The numbers of some lanes, and something else in the others.
#[inline(always)]
fn pick(row: Lanes, lanes: LaneMask, other: f32) -> Lanes {
    std::array::from_fn(|lane| match lanes.contains(lane) {
        true => row[lane],
        false => other,
    })
}

/// All numbers in one, halves by halves.
#[inline(always)]
fn reduce(mut row: Lanes, join: impl Fn(f32, f32) -> f32) -> f32 {
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            row[lane] = join(row[lane], row[lane + half]);
        }
    }
    row[0]
}

/// The least number of some lanes.
#[inline(always)]
pub(super) fn least(row: Lanes, lanes: LaneMask) -> f32 {
    reduce(pick(row, lanes, f32::INFINITY), min)
}

/// The greatest number of some lanes.
#[inline(always)]
pub(super) fn greatest(row: Lanes, lanes: LaneMask) -> f32 {
    reduce(pick(row, lanes, f32::NEG_INFINITY), max)
}
