//! Where things are at a time: vertices on a line, transforms as matrices or by scale, rotation and
//! translation (chapter Acceleration Structures, "Motion Instances").
#![forbid(unsafe_code)]

use crate::layout::{Bounds, Motion, motion_type};

/// Object to world, and its inverse; row-major 3 × 4.
pub(crate) type Transforms = ([f32; 12], [f32; 12]);

/// A number between two, in the interval that they span whatever the rounding.
#[inline]
fn between(a: f32, b: f32, time: f32) -> f32 {
    let value = f64::from(a) * (1.0 - f64::from(time)) + f64::from(b) * f64::from(time);
    (value as f32).clamp(a.min(b), a.max(b))
}

/// A triangle at a time in [0, 1]. A vertex that two triangles share is at the same place in both.
#[inline]
pub(crate) fn triangle_at(triangles: &[[[f32; 3]; 3]; 2], time: f32) -> [[f32; 3]; 3] {
    if triangles
        .as_flattened()
        .as_flattened()
        .iter()
        .any(|c| c.is_nan())
    {
        return [[f32::NAN; 3]; 3];
    }
    let time = clamped(time);
    std::array::from_fn(|vertex| {
        std::array::from_fn(|axis| {
            between(triangles[0][vertex][axis], triangles[1][vertex][axis], time)
        })
    })
}

/// Times outside [0, 1] count as its ends, NaN as 0.
fn clamped(time: f32) -> f32 {
    if time > 0.0 { time.min(1.0) } else { 0.0 }
}

/// An instance's transform at a time in [0, 1].
pub(crate) fn transform_at(motion: &Motion, time: f32) -> [f32; 12] {
    let time = f64::from(clamped(time));
    let [start, end] = &motion.transforms;
    let at: [f64; 16] =
        std::array::from_fn(|i| f64::from(start[i]) * (1.0 - time) + f64::from(end[i]) * time);
    match motion.ty {
        motion_type::SRT => {
            let [rotated, moved] = srt(&at);
            std::array::from_fn(|i| {
                let translation = if i % 4 == 3 { moved[i / 4] } else { 0.0 };
                (rotated[i] + translation) as f32
            })
        }
        _ => std::array::from_fn(|i| at[i] as f32),
    }
}

/// `R × S` as a 3 × 4 matrix, and (in the first three places) the translation after it.
fn srt(parameters: &[f64; 16]) -> [[f64; 12]; 2] {
    let [
        sx,
        a,
        b,
        pvx,
        sy,
        c,
        pvy,
        sz,
        pvz,
        qx,
        qy,
        qz,
        qw,
        tx,
        ty,
        tz,
    ] = *parameters;
    let scale = [[sx, a, b, pvx], [0.0, sy, c, pvy], [0.0, 0.0, sz, pvz]];
    let length = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
    let [x, y, z, w] = [qx, qy, qz, qw].map(|q| q / length);
    let rotation = [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ];
    let product = std::array::from_fn(|i| {
        let (row, column) = (i / 4, i % 4);
        (0..3).map(|k| rotation[row][k] * scale[k][column]).sum()
    });
    let mut translation = [0.0; 12];
    translation[..3].copy_from_slice(&[tx, ty, tz]);
    [product, translation]
}

/// The reach of a box under a transform by scale, rotation and translation between times 0 and 1: a
/// rotation keeps the distance from the pivot, and everything else moves on lines.
pub(crate) fn srt_bounds(motion: &Motion, object: &Bounds) -> Bounds {
    let mut reach = 0f64;
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for transform in &motion.transforms {
        let p = transform.map(f64::from);
        let scale = [
            [p[0], p[1], p[2], p[3]],
            [0.0, p[4], p[5], p[6]],
            [0.0, 0.0, p[7], p[8]],
        ];
        for corner in 0..8 {
            let point: [f64; 3] = std::array::from_fn(|axis| {
                let sides = [object.min[axis], object.max[axis]];
                f64::from(sides[corner >> axis & 1])
            });
            let squared: f64 = scale
                .iter()
                .map(|row| {
                    let sum = row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3];
                    sum * sum
                })
                .sum();
            reach = reach.max(squared.sqrt());
        }
        for axis in 0..3 {
            min[axis] = min[axis].min(p[13 + axis]);
            max[axis] = max[axis].max(p[13 + axis]);
        }
    }
    // A little more than rounding can lose.
    let reach = reach * (1.0 + 1e-6);
    Bounds {
        min: min.map(|m| ((m - reach) as f32).next_down()),
        max: max.map(|m| ((m + reach) as f32).next_up()),
    }
}

/// The inverse of a transform, rounded, and that of its linear part; `None` if there is none.
pub(crate) fn invert(object_to_world: &[f32; 12]) -> Option<([f32; 12], [[f64; 3]; 3])> {
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
    let finite = world_to_object.iter().all(|m| m.is_finite());
    finite.then_some((world_to_object, inverse))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(ty: u32, transforms: [[f32; 16]; 2]) -> Motion {
        Motion {
            ty,
            reserved: [0; 3],
            transforms,
        }
    }

    const STILL: [f32; 16] = [
        1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0,
    ];

    #[test]
    fn rotations_turn_about_their_axis() {
        // Half a turn about z, by a quaternion from (0, 0, 0, 1) to (0, 0, 1, 0): a quarter in the
        // middle.
        let mut end = STILL;
        (end[11], end[12]) = (1.0, 0.0);
        (end[13], end[14]) = (4.0, 6.0);
        let it = motion(motion_type::SRT, [STILL, end]);
        let middle = transform_at(&it, 0.5);
        let expected = [0.0, -1.0, 0.0, 2.0, 1.0, 0.0, 0.0, 3.0, 0.0, 0.0, 1.0, 0.0];
        for (a, b) in middle.iter().zip(expected) {
            assert!((a - b).abs() < 1e-6, "{middle:?}");
        }
        let object = Bounds {
            min: [0.0; 3],
            max: [1.0, 0.0, 0.0],
        };
        let all = srt_bounds(&it, &object);
        assert!(all.min[0] <= -1.0 && all.max[0] >= 5.0 && all.max[1] >= 7.0);
    }

    #[test]
    fn inverses_are_inverse() {
        let m = [2.0, 0.0, 0.0, 1.0, 0.0, 0.0, -4.0, 2.0, 0.0, 1.0, 0.0, 3.0];
        let (inverse, _) = invert(&m).expect("it has one");
        assert_eq!(
            inverse,
            [
                0.5, 0.0, 0.0, -0.5, 0.0, 0.0, 1.0, -3.0, 0.0, -0.25, 0.0, 0.5
            ]
        );
        assert!(invert(&[0.0; 12]).is_none());
    }
}
