//! The order of the parts of a triangle.

/// Position on the curve through the parts of a triangle (chapter Ray Traversal, "Ray Opacity
/// Micromap") of the part at a point, given by the weights of the second and third vertex; as in
/// the specification's own code, without branches.
#[inline(always)]
pub(super) fn part_index([u, v]: [f32; 2], level: u32) -> u32 {
    let side = 1u32 << level;
    let last = side - 1;
    let [scaled_u, scaled_v] = [u, v].map(|weight| weight.clamp(0.0, 1.0) * side as f32);
    let [whole_u, whole_v] = [scaled_u, scaled_v].map(|weight| (weight as u32).min(last));
    let fractions = (scaled_u - scaled_u.trunc()) + (scaled_v - scaled_v.trunc());
    // Rows along the edge between these vertices have upright parts only at their ends.
    let inverted = fractions >= 1.0 && whole_u + whole_v < last;
    let whole_u = whole_u.min(last - whole_v);
    let whole_w = !(whole_u + whole_v + u32::from(inverted));
    // Each pair of bits says which of four parts: where the first two distances from the edges
    // have the same bit, the lower one is set; flips of the parts before are a running parity.
    let low = !(whole_u ^ whole_w) & last;
    let flips = (whole_u ^ whole_v) & low;
    let high = ((parities(flips) ^ whole_u) & !low) | flips;
    apart(low) | apart(high) << 1
}

/// Each bit becomes the parity of those from it up; for 16 bits.
#[inline(always)]
fn parities(mut bits: u32) -> u32 {
    for shift in [1, 2, 4, 8] {
        bits ^= bits >> shift;
    }
    bits
}

/// Puts a zero before each of 16 bits.
#[inline(always)]
fn apart(mut bits: u32) -> u32 {
    for (shift, mask) in [
        (8, 0x00FF_00FF),
        (4, 0x0F0F_0F0F),
        (2, 0x3333_3333),
        (1, 0x5555_5555),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::super::MAX_LEVEL;
    use super::*;

    /// Every part's middle, by dividing the triangle as the specification draws it: near vertex 0,
    /// the middle, near vertex 1, near vertex 2, each second one flipped.
    fn middles(corners: [[f64; 2]; 3], level: u32, out: &mut Vec<[f32; 2]>) {
        let [a, b, c] = corners;
        let mean = |points: &[[f64; 2]]| -> [f64; 2] {
            std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / points.len() as f64)
        };
        if level == 0 {
            out.push(mean(&corners).map(|c| c as f32));
            return;
        }
        let (ab, bc, ca) = (mean(&[a, b]), mean(&[b, c]), mean(&[c, a]));
        middles([a, ab, ca], level - 1, out);
        middles([ca, bc, ab], level - 1, out);
        middles([ab, b, bc], level - 1, out);
        middles([bc, ca, c], level - 1, out);
    }

    /// The same by going down level by level: the distances from the three edges, in parts, say in
    /// which quarter a part lies.
    fn by_descent([u, v]: [f32; 2], level: u32) -> u32 {
        let side = 1u32 << level;
        let [scaled_u, scaled_v] = [u, v].map(|weight| weight.clamp(0.0, 1.0) * side as f32);
        let [whole_u, whole_v] = [scaled_u, scaled_v].map(|it| (it as u32).min(side - 1));
        let fractions = (scaled_u - scaled_u.trunc()) + (scaled_v - scaled_v.trunc());
        let inverted = fractions >= 1.0 && whole_u + whole_v < side - 1;
        let whole_u = whole_u.min(side - 1 - whole_v);
        // Their sum is one less than the side, or two in an inverted part.
        let mut at = [
            side - 1 - whole_u - whole_v - u32::from(inverted),
            whole_u,
            whole_v,
        ];
        let mut index = 0;
        for half in (0..level).rev().map(|bit| 1 << bit) {
            let child = if at[0] >= half {
                at[0] -= half;
                0
            } else if at[1] >= half {
                at[1] -= half;
                2
            } else if at[2] >= half {
                at[2] -= half;
                3
            } else {
                // The one in the middle stands on its head.
                at = at.map(|distance| half - 1 - distance);
                1
            };
            if child % 2 == 1 {
                at.swap(0, 1);
            }
            index = 4 * index + child;
        }
        index
    }

    #[test]
    fn the_curve_is_that_of_a_descent() {
        let mut word = 1u32;
        let mut unit = || {
            word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (word >> 8) as f32 / (1u32 << 24) as f32
        };
        for level in 0..=MAX_LEVEL {
            for i in 0..4000 {
                let (u, share) = (unit(), unit());
                // Corners and edges of parts, and beyond the triangle.
                let point = match i % 4 {
                    0 => [u, (1.0 - u) * share],
                    1 => [u, 1.0 - u],
                    2 => [(16.0 * u).floor() / 16.0, (16.0 * share).floor() / 16.0],
                    _ => [2.0 * u - 0.5, 2.0 * share - 0.5],
                };
                assert_eq!(
                    part_index(point, level),
                    by_descent(point, level),
                    "{point:?} at {level}"
                );
            }
        }
    }

    #[test]
    fn parts_are_ordered_along_the_curve() {
        for level in 0..=6 {
            let mut points = Vec::new();
            middles([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], level, &mut points);
            for (index, &point) in points.iter().enumerate() {
                assert_eq!(
                    part_index(point, level),
                    index as u32,
                    "{point:?} at {level}"
                );
            }
        }
    }

    #[test]
    fn every_point_has_a_part() {
        for level in 0..=MAX_LEVEL {
            let parts = 1u32 << (2 * level);
            for u in 0..=64 {
                for v in 0..=64 {
                    let point = [u as f32 / 63.0, v as f32 / 61.0];
                    assert!(part_index(point, level) < parts);
                }
            }
            for point in [[f32::NAN, 0.5], [-1.0, 2.0], [1.0, 1.0]] {
                assert!(part_index(point, level) < parts);
            }
        }
    }
}
