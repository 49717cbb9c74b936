//! Operations across a [quad](lanes::quad).

use super::float::{Float, fsub};
use crate::SUBGROUP_SIZE;

/// In each lane, the difference between the two lanes of its quad that differ in the bit `AXIS`
/// ([`lanes::quad`]) of their index (and agree with it in the other): the second's value less the
/// first's. Zero unless both are `active`.
#[inline(always)]
pub fn derivative<T: Float, const AXIS: usize>(
    values: &[T; SUBGROUP_SIZE],
    active: u16,
) -> [T; SUBGROUP_SIZE] {
    let both = active & active >> AXIS;
    let zero = T::from_f64(0.0);
    std::array::from_fn(|lane| {
        let (first, second) = (lane & !AXIS, lane | AXIS);
        match both >> first & 1 {
            0 => zero,
            _ => fsub(values[second], values[first]),
        }
    })
}
