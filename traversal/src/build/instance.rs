//! Instances: reading their records, inverting their transforms, bounding them in world space.

use crate::input::{InstanceArray, InstanceSource};
use crate::layout::{
    Bounds, InstanceRecord, InstanceWords, Motion, MotionInstanceRecord, instance_state,
    motion_type,
};
use crate::live::Live;
use crate::motion::{invert, srt_bounds, transform_at};
use crate::structure::Structure;

/// An instance as the application wrote it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instance {
    pub object_to_world: [f32; 12],
    pub custom_index_and_mask: u32,
    pub sbt_offset_and_flags: u32,
    /// Address of the bottom level; 0: inactive.
    pub reference: u64,
    /// The motion, if any; the transform is that of time 0.
    pub motion: Option<Motion>,
}

/// The position of an active instance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    pub world_to_object: [f32; 12],
    /// World-space box, with a margin for the rounding of the transform.
    pub bounds: Bounds,
    /// See `Header::origin_error`.
    pub origin_error: f32,
}

/// Reads an instance; `None` outside the memory.
///
/// # Safety
/// The memory of `source` must be readable and unchanged, and so must records behind pointers.
pub(crate) unsafe fn read(source: &InstanceSource<'_>, index: u32) -> Option<Instance> {
    let offset = u64::from(index) * source.array.stride_bytes();
    // SAFETY: the caller guarantees that the memory of `source` is readable and unchanged, and so
    // are records behind pointers.
    let pointer = || unsafe { source.memory.read(offset) }.map(u64::from_le_bytes);
    match source.array {
        InstanceArray::Records => {
            // SAFETY: the caller guarantees that the memory of `source` is readable and unchanged,
            // and so are records behind pointers.
            let bytes: [u8; 64] = unsafe { source.memory.read(offset) }?;
            Some(static_instance(&bytes))
        }
        InstanceArray::Pointers => {
            // SAFETY: the caller guarantees that the memory of `source` is readable and unchanged,
            // and so are records behind pointers.
            let bytes: [u8; 64] = unsafe { read_behind(pointer()?, source.live) }?;
            Some(static_instance(&bytes))
        }
        InstanceArray::MotionRecords => {
            // SAFETY: the caller guarantees that the memory of `source` is readable and unchanged,
            // and so are records behind pointers.
            let bytes: [u8; MOTION_BYTES] = unsafe { source.memory.read(offset) }?;
            let ty = u32::from_le_bytes(bytes[..4].try_into().expect("four bytes"));
            Some(motion_instance(ty, &bytes[8..]))
        }
        InstanceArray::MotionPointers => {
            let pointer = pointer()?;
            let (address, ty) = (pointer & !0xF, (pointer & 0xF) as u32);
            // SAFETY: the caller guarantees that records behind pointers are readable and
            // unchanged.
            unsafe {
                match ty {
                    motion_type::MATRIX => {
                        let bytes: [u8; 112] = read_behind(address, source.live)?;
                        Some(motion_instance(ty, &bytes))
                    }
                    motion_type::SRT => {
                        let bytes: [u8; 144] = read_behind(address, source.live)?;
                        Some(motion_instance(ty, &bytes))
                    }
                    _ => {
                        let bytes: [u8; 64] = read_behind(address, source.live)?;
                        Some(static_instance(&bytes))
                    }
                }
            }
        }
    }
}

/// Bytes of `VkAccelerationStructureMotionInstanceNV`, less the padding to its stride.
const MOTION_BYTES: usize = 152;

/// # Safety
/// `live` is readable, and nothing writes the record.
unsafe fn read_behind<const N: usize>(address: u64, live: &Live) -> Option<[u8; N]> {
    let record = std::ptr::with_exposed_provenance::<[u8; N]>(address as usize);
    // SAFETY: the caller guarantees that `live` is readable, and nothing writes the record;
    // pointers need not be aligned.
    (live.contains(address, N as u64)).then(|| unsafe { record.read_unaligned() })
}

fn word(bytes: &[u8], index: usize) -> u32 {
    u32::from_le_bytes(
        bytes[4 * index..4 * index + 4]
            .try_into()
            .expect("four bytes"),
    )
}

/// The four words after the transform in every kind of record.
fn with_transform(object_to_world: [f32; 12], words: &[u8]) -> Instance {
    Instance {
        object_to_world,
        custom_index_and_mask: word(words, 0),
        sbt_offset_and_flags: word(words, 1),
        reference: u64::from(word(words, 2)) | u64::from(word(words, 3)) << 32,
        motion: None,
    }
}

/// `VkAccelerationStructureInstanceKHR`.
fn static_instance(bytes: &[u8]) -> Instance {
    let transform = std::array::from_fn(|i| f32::from_bits(word(bytes, i)));
    with_transform(transform, &bytes[48..])
}

/// A record of a `VkAccelerationStructureMotionInstanceTypeNV`.
fn motion_instance(ty: u32, bytes: &[u8]) -> Instance {
    let count = match ty {
        motion_type::MATRIX => 12,
        motion_type::SRT => 16,
        _ => return static_instance(bytes),
    };
    let mut motion = Motion {
        ty,
        reserved: [0; 3],
        transforms: [[0.0; 16]; 2],
    };
    for (i, transform) in motion.transforms.iter_mut().enumerate() {
        for (k, number) in transform[..count].iter_mut().enumerate() {
            *number = f32::from_bits(word(bytes, i * count + k));
        }
    }
    Instance {
        motion: Some(motion),
        ..with_transform(transform_at(&motion, 0.0), &bytes[8 * count..])
    }
}

impl Instance {
    /// The position of the instance; `None` if it is inactive: no bottom level in `live` or an
    /// empty one, or a transform that is not finite or has no inverse.
    ///
    /// # Safety
    /// As for [`Structure::at`].
    pub unsafe fn place(&self, live: &Live) -> Option<Placed> {
        // SAFETY: the caller keeps the promises of `Structure::at`.
        let (bottom, header) =
            unsafe { Structure::inside(self.reference, live.bytes_from(self.reference)) }?;
        if bottom.kind().is_top() {
            return None;
        }
        let bounds = &header.bounds;
        let start = place(&self.object_to_world, bounds)?;
        let Some(motion) = &self.motion else {
            return Some(start);
        };
        let end = place(&transform_at(motion, 1.0), bounds)?;
        let mut all = start.bounds.union(end.bounds);
        if motion.ty == motion_type::SRT {
            all = all.union(srt_bounds(motion, bounds));
        }
        Some(Placed {
            world_to_object: start.world_to_object,
            bounds: all,
            // The condition number may be larger between the ends.
            origin_error: 4.0 * start.origin_error.max(end.origin_error),
        })
    }

    /// The record to store if instances may move.
    pub fn motion_record(&self, record: InstanceRecord) -> MotionInstanceRecord {
        let active = record.words.state & instance_state::ACTIVE != 0;
        let mut out = MotionInstanceRecord {
            record,
            motion: self.motion.unwrap_or(Motion {
                ty: motion_type::STATIC,
                reserved: [0; 3],
                transforms: [[0.0; 16]; 2],
            }),
            reserved: [0; 12],
        };
        if self.motion.is_some() && active {
            out.record.words.state = instance_state::ACTIVE | instance_state::MOVING;
        }
        out
    }

    /// The record to store.
    pub fn record(&self, placed: Option<&Placed>) -> InstanceRecord {
        InstanceRecord {
            object_to_world: self.object_to_world,
            world_to_object: placed.map_or([0.0; 12], |placed| placed.world_to_object),
            words: InstanceWords {
                custom_index_and_mask: self.custom_index_and_mask,
                sbt_offset_and_flags: self.sbt_offset_and_flags,
                state: match placed {
                    Some(_) if self.object_to_world == IDENTITY => {
                        instance_state::ACTIVE | instance_state::IDENTITY
                    }
                    Some(_) => instance_state::ACTIVE,
                    None => 0,
                },
                reserved: 0,
            },
            reserved: [0; 4],
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
/// many of `|A⁻¹||t d|`; seen from world space, by `5 · 2⁻²⁴ · K · (2|o| + |T| + |B|)` with `K =
/// ‖|A||A⁻¹|‖∞` and B the box, as `|t d| ≤ |o| + |B|` where the box is hit. The walk adds the part
/// with `|o|` (`origin_error`); the rest is a margin of the box. 16 stands for 10 plus what
/// second-order terms need. The identity is exact.
fn place(object_to_world: &[f32; 12], object_bounds: &Bounds) -> Option<Placed> {
    if object_bounds.is_empty() || !object_to_world.iter().all(|m| m.is_finite()) {
        return None;
    }
    let m: [[f64; 4]; 3] = std::array::from_fn(|row| {
        std::array::from_fn(|column| f64::from(object_to_world[4 * row + column]))
    });
    let (world_to_object, inverse) = invert(object_to_world)?;

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
            // Zero times an infinite box must be zero, not NaN.
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
