//! Cube maps (spec, "Cube Map Face Selection and Transformations", "Cube Map Edge Handling").
#![forbid(unsafe_code)]

use lanes::LANES;
use lanes::vector::Vector;

use super::address::{Floats, Ints};

/// A direction's place on the cube: the face and the coordinates on it, in 0..1, and their
/// derivatives if the direction has some.
pub(super) struct CubeCoordinates {
    pub face: Ints,
    pub s: Floats,
    pub t: Floats,
}

/// Which component of the direction is `s_c`, `t_c`, `r_c`, with which sign: the spec's table, one
/// row a face.
const FACES: [[(usize, f32); 3]; 6] = [
    [(2, -1.0), (1, -1.0), (0, 1.0)],
    [(2, 1.0), (1, -1.0), (0, -1.0)],
    [(0, 1.0), (2, 1.0), (1, 1.0)],
    [(0, 1.0), (2, -1.0), (1, -1.0)],
    [(0, 1.0), (1, -1.0), (2, 1.0)],
    [(0, -1.0), (1, -1.0), (2, -1.0)],
];

/// Face of a direction: the largest magnitude; z before y before x where they are equal.
#[inline(always)]
fn major_face(x: f32, y: f32, z: f32) -> i32 {
    let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
    let is_z = az >= ax && az >= ay;
    let is_y = !is_z && ay >= ax;
    if is_z {
        4 + (z < 0.0) as i32
    } else if is_y {
        2 + (y < 0.0) as i32
    } else {
        (x < 0.0) as i32
    }
}

/// Selects the face per lane.
#[inline(always)]
pub(super) fn place(direction: [&Floats; 3]) -> CubeCoordinates {
    let mut face = [0; LANES];
    let (mut s, mut t) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let (x, y, z) = (direction[0][lane], direction[1][lane], direction[2][lane]);
        let f = major_face(x, y, z);
        // The table above as selections, so that the loop vectorises.
        let (sc, tc, rc) = match f >> 1 {
            0 => (if f & 1 == 0 { -z } else { z }, -y, x),
            1 => (x, if f & 1 == 0 { z } else { -z }, y),
            _ => (if f & 1 == 0 { x } else { -x }, -y, z),
        };
        // Half of a quotient and a half: exact at the edges.
        let magnitude = rc.abs();
        face[lane] = f;
        s[lane] = 0.5 * (sc / magnitude) + 0.5;
        t[lane] = 0.5 * (tc / magnitude) + 0.5;
    }
    CubeCoordinates { face, s, t }
}

/// Derivatives of a face's (s, t) for a derivative of the direction ("Cube Map Derivative
/// Transformation").
pub(super) fn face_derivative(face: i32, direction: [f32; 3], derivative: [f32; 3]) -> [f32; 2] {
    let [(si, ss), (ti, ts), (ri, rs)] = FACES[face as usize & 7];
    let (sc, tc, rc) = (ss * direction[si], ts * direction[ti], rs * direction[ri]);
    let (ds, dt, dr) = (
        ss * derivative[si],
        ts * derivative[ti],
        rs * derivative[ri],
    );
    let square = rc * rc;
    [
        0.5 * (rc * ds - sc * dr) / square,
        0.5 * (rc * dt - tc * dr) / square,
    ]
}

/// Where a texel past one edge of a face is: on the neighbouring face, in its first row. `(x, y)`
/// may be -1 or `size`, but only one of them.
fn across_edge(face: i32, x: i32, y: i32, size: i32) -> (i32, i32, i32) {
    // Texel centres in half texels on the cube of half side `size`.
    let centre = |i: i32| 2 * i + 1 - size;
    let mut position = [0; 3];
    let [(si, ss), (ti, ts), (ri, rs)] = FACES[face as usize];
    position[si] = ss as i32 * centre(x);
    position[ti] = ts as i32 * centre(y);
    position[ri] = rs as i32 * size;
    // Fold over the edge: what stands out by one texel centre becomes the face's own plane, and the
    // old plane one texel centre below it.
    let out = if x < 0 || x >= size { si } else { ti };
    position[out] = size * position[out].signum();
    position[ri] = (size - 1) * position[ri].signum();
    let new_face = 2 * out as i32 + (position[out] < 0) as i32;
    let [(si, ss), (ti, ts), _] = FACES[new_face as usize];
    let index = |c: i32| (c + size - 1) / 2;
    (
        new_face,
        index(ss as i32 * position[si]),
        index(ts as i32 * position[ti]),
    )
}

/// Moves texels that lie past an edge to the neighbouring face, lane by lane. Returns the lanes
/// whose texel lies past a corner: it does not exist, and the caller averages its three neighbours;
/// its indices are left in range.
#[inline(always)]
pub(super) fn wrap_edges(x: &mut Ints, y: &mut Ints, face: &mut Ints, sizes: &Ints) -> u16 {
    let mut outside = 0u16;
    for lane in 0..LANES {
        let is_out = x[lane] < 0 || y[lane] < 0 || x[lane] >= sizes[lane] || y[lane] >= sizes[lane];
        outside |= (is_out as u16) << lane;
    }
    let mut corners = 0;
    super::format::block::each_lane(outside, |lane| {
        let size = sizes[lane];
        let in_range = |i: i32| i >= 0 && i < size;
        if in_range(x[lane]) || in_range(y[lane]) {
            (face[lane], x[lane], y[lane]) = across_edge(face[lane], x[lane], y[lane], size);
        } else {
            corners |= 1 << lane;
            x[lane] = x[lane].clamp(0, size - 1);
            y[lane] = y[lane].clamp(0, size - 1);
        }
    });
    corners
}

/// The greatest number below zero.
const BELOW_ZERO: f32 = f32::from_bits(0x8000_0001);

/// [`place`] in vectors: s, t, and the face.
#[inline(always)]
pub(super) fn place_in_vectors<V: Vector>(v: V, [x, y, z]: [V::F; 3]) -> ([V::F; 2], V::I) {
    let sign_bit = v.splat_i(i32::MIN);
    let rest = v.splat_i(i32::MAX);
    let bits = [v.bits_of(x), v.bits_of(y), v.bits_of(z)];
    let [ax, ay, az] = [
        v.bits_to_f(v.and_i(bits[0], rest)),
        v.bits_to_f(v.and_i(bits[1], rest)),
        v.bits_to_f(v.and_i(bits[2], rest)),
    ];
    let is_z = v.and_i(v.at_least(az, ax), v.at_least(az, ay));
    let y_over_x = v.at_least(ay, ax);
    let [x, y, z] = bits;
    let major = v.pick(is_z, z, v.pick(y_over_x, y, x));
    let is_negative = v.at_least(v.splat(BELOW_ZERO), v.bits_to_f(major));
    // Negations change the sign's bit.
    let sign = v.and_i(is_negative, sign_bit);
    let (minus_y, kept) = (v.xor_i(y, sign_bit), v.xor_i(sign, sign_bit));
    let of_x = v.xor_i(z, kept);
    let s = v.pick(is_z, v.xor_i(x, sign), v.pick(y_over_x, x, of_x));
    let is_y = v.and_i(y_over_x, v.xor_i(is_z, v.splat_i(-1)));
    let t = v.pick(is_y, v.xor_i(z, sign), minus_y);
    let axis = v.pick(is_z, v.splat_i(4), v.and_i(y_over_x, v.splat_i(2)));
    let face = v.sub_i(axis, is_negative);
    let magnitude = v.bits_to_f(v.and_i(major, rest));
    // Half of a quotient and a half: exact at the edges.
    let half = v.splat(0.5);
    let s = v.div(v.bits_to_f(s), magnitude);
    let t = v.div(v.bits_to_f(t), magnitude);
    let on_face = [v.add(v.mul(half, s), half), v.add(v.mul(half, t), half)];
    (on_face, face)
}

/// [`wrap_edges`] of sixteen texels in vectors.
#[inline(always)]
pub(super) fn wrap_edges_in_vectors<V: Vector>(
    v: V,
    [x, y, face]: [V::I; 3],
    size: V::I,
) -> ([V::I; 3], u16) {
    let (zero, one) = (v.splat_i(0), v.splat_i(1));
    let last = v.sub_i(size, one);
    let (in_x, in_y) = (v.lt_u(x, size), v.lt_u(y, size));
    let clamped_x = v.max_i(v.min_i(x, last), zero);
    let clamped_y = v.max_i(v.min_i(y, last), zero);
    let corners = !in_x & !in_y;
    let edges = !(in_x & in_y) & !corners;
    if edges == 0 {
        return ([clamped_x, clamped_y, face], corners);
    }
    // As `across_edge`: centres in half texels on the cube of half side `size`.
    let s = v.sub_i(v.add_i(v.add_i(x, x), one), size);
    let t = v.sub_i(v.add_i(v.add_i(y, y), one), size);
    let axis = v.right_u(face, 1);
    let (is_x, is_y) = (!v.ne_i(axis, zero), !v.ne_i(axis, one));
    let is_negative = v.sub_i(zero, v.and_i(face, one));
    let is_positive = v.sub_i(v.and_i(face, one), one);
    let plane = negated(v, size, is_negative);
    let minus_t = v.sub_i(zero, t);
    let position = [
        select3(v, is_x, is_y, [plane, s, negated(v, s, is_negative)]),
        v.select(is_y, plane, minus_t),
        select3(
            v,
            is_x,
            is_y,
            [
                negated(v, s, is_positive),
                negated(v, t, is_negative),
                plane,
            ],
        ),
    ];
    let mut folded = position;
    let mut out = [0; 3];
    let old_plane = [is_x, is_y, !(is_x | is_y)];
    for i in 0..3 {
        let sign = v.sign_i(position[i]);
        out[i] = v.lt_u(size, negated(v, position[i], sign));
        let inner = v.select(old_plane[i], negated(v, last, sign), position[i]);
        folded[i] = v.select(out[i], negated(v, size, sign), inner);
    }
    let [x3, y3, z3] = folded;
    let is_negative = v.sign_i(select3(v, out[0], out[1], position));
    let is_positive = v.xor_i(is_negative, v.splat_i(-1));
    let axis = select3(v, out[0], out[1], [zero, v.splat_i(2), v.splat_i(4)]);
    let new_face = v.add_i(axis, v.and_i(is_negative, one));
    let minus_y = v.sub_i(zero, y3);
    let new_s = select3(
        v,
        out[0],
        out[1],
        [negated(v, z3, is_positive), x3, negated(v, x3, is_negative)],
    );
    let new_t = v.select(out[1], negated(v, z3, is_negative), minus_y);
    let new_x = v.right_i(v.add_i(new_s, last), 1);
    let new_y = v.right_i(v.add_i(new_t, last), 1);
    let wrapped = [
        v.select(edges, new_x, clamped_x),
        v.select(edges, new_y, clamped_y),
        v.select(edges, new_face, face),
    ];
    (wrapped, corners)
}

/// `-a` where all bits are set, `a` where none is.
#[inline(always)]
fn negated<V: Vector>(v: V, a: V::I, is_negated: V::I) -> V::I {
    v.sub_i(v.xor_i(a, is_negated), is_negated)
}

/// The first in the lanes of the first mask, the second in those of the second, else the third.
#[inline(always)]
fn select3<V: Vector>(v: V, first: u16, second: u16, [a, b, c]: [V::I; 3]) -> V::I {
    v.select(first, a, v.select(second, b, c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lanes::Row;
    use lanes::vector::Portable;

    /// Direction of a point of a face, from the spec's table read backwards.
    fn direction(face: i32, x: i32, y: i32, size: i32) -> [f64; 3] {
        let mut d = [0.0; 3];
        let [(si, ss), (ti, ts), (ri, rs)] = FACES[face as usize];
        d[si] = ss as f64 * ((2 * x + 1) as f64 / size as f64 - 1.0);
        d[ti] = ts as f64 * ((2 * y + 1) as f64 / size as f64 - 1.0);
        d[ri] = rs as f64;
        d
    }

    #[test]
    fn centres_of_texels_select_their_face_and_place() {
        let size = 8;
        for face in 0..6 {
            for (x, y) in (0..8).flat_map(|x| (0..8).map(move |y| (x, y))) {
                let d = direction(face, x, y, size).map(|c| [c as f32; 16]);
                let place = place([&d[0], &d[1], &d[2]]);
                assert_eq!(place.face[3], face);
                assert_eq!(place.s[3], (2 * x + 1) as f32 / 16.0);
                assert_eq!(place.t[3], (2 * y + 1) as f32 / 16.0);
            }
        }
    }

    /// The texel across an edge is the one whose centre is nearest to the first face's edge texel,
    /// and crossing back returns to it.
    #[test]
    fn edges_lead_to_the_nearest_texel_and_back() {
        let size = 4;
        for face in 0..6 {
            for along in 0..size {
                for (x, y, inner) in [
                    (-1, along, (0, along)),
                    (size, along, (size - 1, along)),
                    (along, -1, (along, 0)),
                    (along, size, (along, size - 1)),
                ] {
                    let (other, ox, oy) = across_edge(face, x, y, size);
                    let from = direction(face, inner.0, inner.1, size);
                    let distance = |face: i32, x: i32, y: i32| {
                        let to = direction(face, x, y, size);
                        (0..3).map(|i| (to[i] - from[i]).powi(2)).sum::<f64>()
                    };
                    let mut best = (f64::MAX, 0, 0, 0);
                    for candidate in (0..6).filter(|&candidate| candidate != face) {
                        for (cx, cy) in (0..4).flat_map(|x| (0..4).map(move |y| (x, y))) {
                            let d = distance(candidate, cx, cy);
                            if d < best.0 - 1e-9 {
                                best = (d, candidate, cx, cy);
                            }
                        }
                    }
                    // At a corner two faces are equally near.
                    assert!((distance(other, ox, oy) - best.0).abs() < 1e-9);
                    assert_ne!(other, face);
                    let back = [(-1, oy), (size, oy), (ox, -1), (ox, size)]
                        .into_iter()
                        .any(|(bx, by)| {
                            across_edge(other, bx, by, size) == (face, inner.0, inner.1)
                        });
                    assert!(back);
                }
            }
        }
    }

    #[test]
    fn derivatives_are_difference_quotients() {
        let d = [0.3f32, -0.9, 0.2];
        let step = [0.5f32, 0.25, -1.0];
        let h = 1e-3;
        let at = |h: f32| {
            let moved: [Floats; 3] = std::array::from_fn(|i| [d[i] + h * step[i]; 16]);
            let place = place([&moved[0], &moved[1], &moved[2]]);
            (place.face[0], place.s[0], place.t[0])
        };
        let ((face, s0, t0), (_, s1, t1)) = (at(-h), at(h));
        let [ds, dt] = face_derivative(face, d, step);
        assert!((ds - (s1 - s0) / (2.0 * h)).abs() < 1e-3);
        assert!((dt - (t1 - t0) / (2.0 * h)).abs() < 1e-3);
    }

    /// Directions of all kinds in vectors and one by one: equal magnitudes, zeros of both signs,
    /// infinities, denormal numbers and NaN.
    #[test]
    fn vectors_place_as_lanes_do() {
        let v = Portable;
        let numbers = [
            0.0,
            -0.0,
            1.0,
            -1.0,
            0.25,
            -3.5,
            1e-42,
            -1e-42,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::NAN,
            -f32::NAN,
        ];
        let count = numbers.len();
        let directions: Vec<[f32; 3]> = (0..count.pow(3))
            .map(|i| [i % count, i / count % count, i / count / count].map(|i| numbers[i]))
            .collect();
        for sixteen in directions.chunks_exact(16) {
            let [x, y, z]: [Floats; 3] =
                std::array::from_fn(|axis| std::array::from_fn(|lane| sixteen[lane][axis]));
            let expected = place([&x, &y, &z]);
            let loaded = [x, y, z].map(|row| v.load(&row.map(f32::to_bits)));
            let ([s, t], face) = place_in_vectors(v, loaded);
            let mut rows = [[0; LANES]; 3];
            v.store(s, &mut rows[0]);
            v.store(t, &mut rows[1]);
            v.store_i(face, &mut rows[2]);
            for lane in 0..LANES {
                let same = |found: u32, expected: f32| {
                    let found = f32::from_bits(found);
                    found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan()
                };
                let direction = sixteen[lane];
                assert_eq!(rows[2][lane] as i32, expected.face[lane], "{direction:?}");
                assert!(same(rows[0][lane], expected.s[lane]), "{direction:?}");
                assert!(same(rows[1][lane], expected.t[lane]), "{direction:?}");
            }
        }
    }

    /// Texels around each face, in vectors and one by one: every edge and corner, in every lane.
    #[test]
    fn vectors_wrap_as_texels_do() {
        let v = Portable;
        for size in [1, 2, 3, 8] {
            let texels: Vec<[i32; 3]> = (0..6)
                .flat_map(|face| {
                    (-1..=size).flat_map(move |x| (-1..=size).map(move |y| [x, y, face]))
                })
                .collect();
            for sixteen in texels.chunks(16) {
                let lane = |k: usize| sixteen[k.min(sixteen.len() - 1)];
                let rows: [Row; 3] =
                    std::array::from_fn(|i| std::array::from_fn(|k| lane(k)[i] as u32));
                let loaded = [v.load_i(&rows[0]), v.load_i(&rows[1]), v.load_i(&rows[2])];
                let (wrapped, corners) = wrap_edges_in_vectors(v, loaded, v.splat_i(size));
                let [mut x, mut y, mut face]: [Ints; 3] = rows.map(|row| row.map(|w| w as i32));
                assert_eq!(wrap_edges(&mut x, &mut y, &mut face, &[size; 16]), corners);
                for (vector, ints) in wrapped.into_iter().zip([x, y, face]) {
                    let mut row = [0; LANES];
                    v.store_i(vector, &mut row);
                    assert_eq!(row.map(|w| w as i32), ints);
                }
            }
        }
    }
}
