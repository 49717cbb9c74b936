//! Instances: reading their records, inverting their transforms, bounding them in world space.

use crate::input::{InstanceArray, InstanceSource};
use crate::layout::{Bounds, InstanceRecord, instance_state};
use crate::structure::{Kind, Structure};

/// An instance as the application wrote it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instance {
    pub object_to_world: [f32; 12],
    pub custom_index_and_mask: u32,
    pub sbt_offset_and_flags: u32,
    /// Address of the bottom level; 0: inactive.
    pub reference: u64,
}

/// Where an active instance is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    pub world_to_object: [f32; 12],
    /// World-space box, with a margin for the rounding of the transform.
    pub bounds: Bounds,
    /// See `Header::origin_error`.
    pub origin_error: f32,
}

/// Reads a 64-byte `VkAccelerationStructureInstanceKHR` record; `None` outside the memory.
///
/// # Safety
/// The memory of `source` must be readable and unchanged, and so must records behind pointers.
pub(crate) unsafe fn read(source: &InstanceSource, index: u32) -> Option<Instance> {
    let i = u64::from(index);
    let bytes: [u8; 64] = match source.array {
        // SAFETY: the caller's promise.
        InstanceArray::Records => unsafe { source.memory.read(64 * i) }?,
        InstanceArray::Pointers => {
            // SAFETY: the caller's promise.
            let address = u64::from_le_bytes(unsafe { source.memory.read(8 * i) }?);
            if address == 0 {
                return None;
            }
            let record = std::ptr::with_exposed_provenance::<[u8; 64]>(address as usize);
            // SAFETY: the caller's promise; pointers need not be aligned.
            unsafe { record.read_unaligned() }
        }
    };
    let word = |i: usize| u32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap());
    Some(Instance {
        object_to_world: std::array::from_fn(|i| f32::from_bits(word(i))),
        custom_index_and_mask: word(12),
        sbt_offset_and_flags: word(13),
        reference: u64::from(word(14)) | u64::from(word(15)) << 32,
    })
}

impl Instance {
    /// Where the instance is; `None` if it is inactive: no bottom level or an empty one, or a
    /// transform that is not finite or has no inverse.
    ///
    /// # Safety
    /// The reference must be 0 or the address of a built bottom level.
    pub unsafe fn place(&self) -> Option<Placed> {
        // SAFETY: the caller's promise.
        let bottom = unsafe { Structure::at(self.reference) }?;
        if bottom.kind() == Kind::Instances {
            return None;
        }
        place(&self.object_to_world, &bottom.header().bounds)
    }

    /// The record to store.
    pub fn record(&self, placed: Option<&Placed>) -> InstanceRecord {
        InstanceRecord {
            object_to_world: self.object_to_world,
            world_to_object: placed.map_or([0.0; 12], |placed| placed.world_to_object),
            custom_index_and_mask: self.custom_index_and_mask,
            sbt_offset_and_flags: self.sbt_offset_and_flags,
            state: match placed {
                Some(_) if self.object_to_world == IDENTITY => {
                    instance_state::ACTIVE | instance_state::IDENTITY
                }
                Some(_) => instance_state::ACTIVE,
                None => 0,
            },
            reserved: [0; 5],
        }
    }
}

const IDENTITY: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// Half an ULP of 1: the relative error of one rounding.
const ROUNDING: f64 = 1.0 / (1 << 24) as f64;

/// Inverts the transform and bounds the transformed box.
///
/// The walk computes an object-space ray as `o' = A⁻¹(o − T)`, `d' = A⁻¹d` in f32, with a rounded
/// `A⁻¹`. Each component of `o'` is off by at most 5 roundings of `|A⁻¹||o − T|`, and `t d'` by as
/// many of `|A⁻¹||t d|`; seen from world space, by `5 · 2⁻²⁴ · K · (2|o| + |T| + |B|)` with
/// `K = ‖|A||A⁻¹|‖∞` and B the box, as `|t d| ≤ |o| + |B|` where the box is hit. The part with `|o|`
/// is the walk's to add (`origin_error`), the rest is a margin of the box here. 16 stands for
/// 10 plus what second-order terms need. The identity is exact.
fn place(object_to_world: &[f32; 12], object_bounds: &Bounds) -> Option<Placed> {
    if object_bounds.is_empty() || !object_to_world.iter().all(|m| m.is_finite()) {
        return None;
    }
    let m: [[f64; 4]; 3] = std::array::from_fn(|row| {
        std::array::from_fn(|column| f64::from(object_to_world[4 * row + column]))
    });
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    let mut world_to_object = [0f32; 12];
    let mut inverse = [[0f64; 3]; 3];
    for (row, inverse_row) in inverse.iter_mut().enumerate() {
        for (column, element) in inverse_row.iter_mut().enumerate() {
            *element = cofactor(column, row) / determinant;
            world_to_object[4 * row + column] = *element as f32;
        }
        let translation: f64 = (0..3).map(|i| inverse_row[i] * m[i][3]).sum();
        world_to_object[4 * row + 3] = -translation as f32;
    }
    if !world_to_object.iter().all(|m| m.is_finite()) {
        return None;
    }

    let condition = (0..3)
        .map(|row| {
            (0..3)
                .map(|column| {
                    (0..3)
                        .map(|i| m[row][i].abs() * inverse[i][column].abs())
                        .sum::<f64>()
                })
                .sum::<f64>()
        })
        .fold(1.0, f64::max);
    let relative_error = if *object_to_world == IDENTITY {
        0.0
    } else {
        16.0 * ROUNDING * condition
    };

    let mut min = [0f64; 3];
    let mut max = [0f64; 3];
    let mut reach = 0f64;
    for (row, terms) in m.iter().enumerate() {
        (min[row], max[row]) = (terms[3], terms[3]);
        for (axis, &factor) in terms[..3].iter().enumerate() {
            // Zero times an infinite box is nothing, not NaN.
            if factor != 0.0 {
                let a = factor * f64::from(object_bounds.min[axis]);
                let b = factor * f64::from(object_bounds.max[axis]);
                min[row] += a.min(b);
                max[row] += a.max(b);
            }
        }
        for bound in [min[row], max[row], terms[3]] {
            if bound.is_finite() {
                reach = reach.max(bound.abs());
            }
        }
    }
    let margin = relative_error * 2.0 * reach;
    Some(Placed {
        world_to_object,
        bounds: Bounds {
            min: min.map(|bound| round_down(bound - margin)),
            max: max.map(|bound| round_up(bound + margin)),
        },
        origin_error: relative_error as f32,
    })
}

/// The largest f32 not above `value`.
fn round_down(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) > value {
        nearest.next_down()
    } else {
        nearest
    }
}

/// The smallest f32 not below `value`.
fn round_up(value: f64) -> f32 {
    -round_down(-value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_of_scale_and_translation() {
        let transform = [
            2.0, 0.0, 0.0, 10.0, 0.0, -4.0, 0.0, 20.0, 0.0, 0.0, 0.5, 30.0,
        ];
        let bounds = Bounds {
            min: [-1.0; 3],
            max: [1.0; 3],
        };
        let placed = place(&transform, &bounds).unwrap();
        assert_eq!(
            placed.world_to_object,
            [
                0.5, 0.0, 0.0, -5.0, 0.0, -0.25, 0.0, 5.0, 0.0, 0.0, 2.0, -60.0
            ]
        );
        for (axis, (low, high)) in [(8.0, 12.0), (16.0, 24.0), (29.5, 30.5)].iter().enumerate() {
            assert!(placed.bounds.min[axis] <= *low && placed.bounds.min[axis] > low - 1e-3);
            assert!(placed.bounds.max[axis] >= *high && placed.bounds.max[axis] < high + 1e-3);
        }
    }

    #[test]
    fn no_inverse_is_inactive() {
        let bounds = Bounds {
            min: [-1.0; 3],
            max: [1.0; 3],
        };
        assert!(place(&[0.0; 12], &bounds).is_none());
        assert!(place(&[f32::NAN; 12], &bounds).is_none());
        assert!(
            place(
                &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
                &bounds
            )
            .is_none()
        );
    }
}
