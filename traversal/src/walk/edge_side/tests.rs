//! Decisions and bounds against whole numbers, on rays and triangles that are nearly degenerate by
//! construction.
//!
//! So many of each kind as the environment's TRIPLES says.

use num_bigint::{BigInt, Sign};
use num_traits::{Signed, ToPrimitive, Zero};

use super::*;
use crate::layout::Margin;
use crate::walk::level_ray::LevelRay;
use crate::walk::options::Accuracy;
use crate::walk::triangle::{ShearedTriangle, intersect, rounding};

pub(in crate::walk) fn count() -> usize {
    let given = std::env::var("TRIPLES").ok();
    let usual = || effort::rounds(20_000) as usize;
    given.map_or_else(usual, |count| count.parse().expect("TRIPLES is a number"))
}

/// A number in units of 2⁻¹⁴⁹.
fn whole(value: f32) -> BigInt {
    let bits = value.to_bits();
    let (exponent, fraction) = (bits >> 23 & 0xFF, bits & 0x7F_FFFF);
    let size = match exponent {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 0x80_0000) << (exponent - 1),
    };
    if value < 0.0 { -size } else { size }
}

type Whole = [BigInt; 3];

fn cross(a: &Whole, b: &Whole) -> Whole {
    [(1, 2), (2, 0), (0, 1)].map(|(j, k): (usize, usize)| &a[j] * &b[k] - &a[k] * &b[j])
}

fn dot(a: &Whole, b: &Whole) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

fn less(a: &Whole, b: &Whole) -> Whole {
    std::array::from_fn(|i| &a[i] - &b[i])
}

fn sign(value: &BigInt) -> i32 {
    match value.sign() {
        Sign::Plus => 1,
        Sign::NoSign => 0,
        Sign::Minus => -1,
    }
}

/// A quotient of numbers that may be beyond the range of f64.
fn quotient(above: &BigInt, below: &BigInt) -> f64 {
    let parts = |value: &BigInt| {
        let excess = value.bits().saturating_sub(64);
        ((value >> excess).to_f64().unwrap_or(0.0), excess as i32)
    };
    let ((a, a_power), (b, b_power)) = (parts(above), parts(below));
    let power = a_power - b_power;
    a / b * 2f64.powi(power / 2) * 2f64.powi(power - power / 2)
}

/// xorshift.
pub(in crate::walk) struct Random(pub u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// A power of ten.
    pub fn size(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(low + (high - low) * self.unit())
    }

    pub fn vector(&mut self, size: f64) -> [f32; 3] {
        std::array::from_fn(|_| (self.signed() * size) as f32)
    }
}

/// A ray and a triangle.
#[derive(Debug)]
pub(in crate::walk) struct RayTriangle {
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    pub triangle: [[f32; 3]; 3],
}

/// Cases of several kinds in turn: an edge through the ray as far as f32 can say it, all of the
/// triangle in the ray's plane nearly, whole numbers, all exponents, triangles in front of a ray of
/// ordinary numbers, determinants of one unit.
pub(in crate::walk) fn case(kind: usize, random: &mut Random) -> RayTriangle {
    loop {
        let case = any_case(kind, random);
        let below = |v: [f32; 3]| v.iter().all(|c| c.abs() < 4e37);
        if below(case.origin) && below(case.direction) && case.triangle.into_iter().all(below) {
            return case;
        }
    }
}

fn any_case(kind: usize, random: &mut Random) -> RayTriangle {
    let scale = [1.0, random.size(-3.0, 3.0), random.size(-38.0, 36.0)][random.bits() as usize % 3];
    let mut direction = random.vector(1.0);
    let reach = scale * random.size(-3.0, 1.0);
    let mut origin = random.vector(reach);
    if kind == 2 {
        let mut small = |range: f64| [0; 3].map(|_| (random.signed() * range).round() as f32);
        return RayTriangle {
            origin: small(4.0),
            direction: small(3.0),
            triangle: [small(4.0), small(4.0), small(4.0)],
        };
    }
    if kind == 5 {
        return least(random).unwrap_or_else(|| case(2, random));
    }
    if kind == 3 {
        let mut any = || {
            let bits = random.bits();
            let value = f32::from_bits(bits as u32);
            if value.is_finite() { value } else { 0.0 }
        };
        let mut point = || [any(), any(), any()];
        return RayTriangle {
            origin: point(),
            direction: point(),
            triangle: [point(), point(), point()],
        };
    }
    if random.bits().is_multiple_of(4) {
        direction[random.bits() as usize % 3] *= random.size(-30.0, 0.0) as f32;
    }
    if random.bits().is_multiple_of(4) {
        direction[random.bits() as usize % 3] = 0.0;
    }
    if random.bits().is_multiple_of(8) {
        origin[random.bits() as usize % 3] = 0.0;
    }
    let on_ray = |t: f64| -> [f64; 3] {
        std::array::from_fn(|i| f64::from(origin[i]) + t * f64::from(direction[i]))
    };
    let size = scale * random.size(-5.0, 1.0);
    let t = scale * random.size(-4.0, 1.0);
    let p = random.vector(size).map(f64::from);
    let hit = on_ray(t);
    let p: [f64; 3] = std::array::from_fn(|i| hit[i] + p[i]);
    let narrow = |v: [f64; 3]| v.map(|c| c as f32);
    let beyond = -random.size(-4.0, 4.0);
    let q = match kind {
        // On the other side of the ray, somewhere along it.
        0 | 1 => {
            let other = on_ray(t * (1.0 + random.signed() * random.size(-6.0, 0.5)));
            std::array::from_fn(|i| other[i] + beyond * (p[i] - hit[i]))
        }
        _ => {
            let v = random.vector(size);
            std::array::from_fn(|i| hit[i] + f64::from(v[i]))
        }
    };
    let r = match kind {
        1 => {
            let along = on_ray(t * random.signed() * 2.0);
            let factor = random.signed();
            std::array::from_fn(|i| along[i] + factor * (q[i] - hit[i]))
        }
        _ => {
            let v = random.vector(size);
            std::array::from_fn(|i| hit[i] + f64::from(v[i]))
        }
    };
    let mut triangle = [narrow(p), narrow(q), narrow(r)];
    triangle.rotate_left(random.bits() as usize % 3);
    RayTriangle {
        origin,
        direction,
        triangle,
    }
}

pub(in crate::walk) const KINDS: usize = 6;

/// Whole numbers `a`, `b` and the greatest common divisor `a x + b y`.
fn divisor(x: i128, y: i128) -> [i128; 3] {
    let (mut first, mut second) = ([x, 1, 0], [y, 0, 1]);
    while second[0] != 0 {
        let quotient = first[0] / second[0];
        let next = std::array::from_fn(|i| first[i] - quotient * second[i]);
        (first, second) = (second, next);
    }
    [first[1], first[2], first[0]]
}

/// A ray from the origin with a determinant of 1 or little more, though its products have 70 bits:
/// a direction that differs from the plane of two vertices by less than any of its digits.
fn least(random: &mut Random) -> Option<RayTriangle> {
    let mut point = || [0; 3].map(|_| (random.signed() * f64::from(1 << 22)) as i128);
    let (p, q, r) = (point(), point(), point());
    let n = [(1, 2), (2, 0), (0, 1)].map(|(j, k): (usize, usize)| p[j] * q[k] - p[k] * q[j]);
    let [a, b, first] = divisor(n[0], n[1]);
    let [s, t, _] = divisor(first, n[2]);
    let mut d = [s * a, s * b, t];
    // As short as whole multiples of the vertices make it.
    for _ in 0..4 {
        let product =
            |v: [i128; 3], w: [i128; 3]| (0..3).map(|i| v[i] as f64 * w[i] as f64).sum::<f64>();
        let (pp, pq, qq) = (product(p, p), product(p, q), product(q, q));
        let (pd, qd) = (product(p, d), product(q, d));
        let whole = pp * qq - pq * pq;
        let along_p = ((pd * qq - qd * pq) / whole).round() as i128;
        let along_q = ((qd * pp - pd * pq) / whole).round() as i128;
        d = std::array::from_fn(|i| d[i] - along_p * p[i] - along_q * q[i]);
    }
    let sign = [-1, 0, 1][random.bits() as usize % 3];
    if sign == 0 {
        d = std::array::from_fn(|i| p[i] + 2 * q[i]);
    }
    let scale = random.size(-9.0, 9.0).log2().round().exp2() as f32;
    let fits = d.iter().all(|c| c.abs() < 1 << 24);
    let narrow = |v: [i128; 3]| v.map(|c| c as f32 * scale);
    fits.then(|| RayTriangle {
        origin: [0.0; 3],
        direction: d.map(|c| (c * if sign == 0 { 1 } else { sign }) as f32),
        triangle: [narrow(p), narrow(q), narrow(r)],
    })
}

/// The truth about a case.
struct Truth {
    edges: [BigInt; 3],
    whole: BigInt,
    volume: BigInt,
}

impl Truth {
    fn of(case: &RayTriangle) -> Truth {
        let (o, d) = (case.origin.map(whole), case.direction.map(whole));
        let moved = case.triangle.map(|vertex| less(&vertex.map(whole), &o));
        let edges = EDGES.map(|[p, q]| dot(&d, &cross(&moved[p], &moved[q])));
        let [a, b, c] = &moved;
        Truth {
            whole: edges.iter().sum(),
            edges,
            volume: dot(a, &cross(b, c)),
        }
    }

    /// Signs of the edges for an origin that is moved.
    fn owned(&self, case: &RayTriangle) -> [i32; 3] {
        let d = case.direction.map(whole);
        std::array::from_fn(|i| {
            let [p, q] = EDGES[i].map(|vertex| case.triangle[vertex].map(whole));
            let moved = cross(&d, &less(&q, &p));
            let mut signs = [&self.edges[i], &moved[0], &moved[1], &moved[2]]
                .map(sign)
                .into_iter();
            signs.find(|&sign| sign != 0).unwrap_or(0)
        })
    }

    fn faces(&self, case: &RayTriangle, rim: Rim) -> Option<bool> {
        let signs = match rim {
            Rim::Included => self.edges.each_ref().map(sign),
            Rim::Owned => self.owned(case),
        };
        let [front, back] = [1, -1].map(|side| match rim {
            Rim::Included => !signs.contains(&-side) && signs.contains(&side),
            Rim::Owned => signs == [side; 3],
        });
        (front || back).then_some(front)
    }
}

fn is_sound(case: &RayTriangle) -> bool {
    case.direction != [0.0; 3]
}

#[test]
fn signs_are_those_of_whole_numbers() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let [mut zero, mut exact, mut hits] = [0; 3];
    for i in 0..count() {
        let case = case(i % KINDS, &mut random);
        let truth = Truth::of(&case);
        let scene = Scene::new(case.origin, case.direction, &case.triangle);
        for (edge, value) in EDGES.into_iter().zip(&truth.edges) {
            let found = scene.edge(edge);
            if found.is_certain() {
                assert_eq!(found.value > 0.0, value.is_positive(), "{case:?}");
            } else {
                exact += 1;
            }
            let found = scene.edge_exactly(edge).value;
            assert_eq!(found > 0.0, value.is_positive(), "{case:?}");
            assert_eq!(found < 0.0, value.is_negative(), "{case:?}");
            zero += usize::from(value.is_zero());
        }
        let volume = scene.volume_exactly().value;
        assert_eq!(volume > 0.0, truth.volume.is_positive(), "{case:?}");
        assert_eq!(volume < 0.0, truth.volume.is_negative(), "{case:?}");
        for rim in [Rim::Included, Rim::Owned] {
            let found = faces(case.origin, case.direction, &case.triangle, rim);
            assert_eq!(found, truth.faces(&case, rim), "{rim:?} {case:?}");
            hits += usize::from(found.is_some());
        }
    }
    println!("{zero} edges of zero, {exact} beyond f64, {hits} hits");
    assert!(zero > count() / 50 && exact > count() / 10 && hits > count() / 10);
}

/// A shear below the least number there is, times a distance of 10³⁴: what it moves the triangle by
/// is as large as the triangle.
#[test]
fn shears_that_underflow_are_seen() {
    let case = RayTriangle {
        origin: [0.030209808, 7.5756125e-31, 399.14517],
        direction: [1.8067319e-33, -2.758205e-39, 86058110.0],
        triangle: [
            [2.6712572e18, -2.867038e-25, 3.0905693e-31],
            [-1.147825e-30, 8.462255e-21, 1.5686628e34],
            [-7.4187925e18, -2.2577543e-10, 7.252075e-16],
        ],
    };
    let truth = Truth::of(&case);
    let mut level_ray = LevelRay::EMPTY;
    level_ray.set(case.origin, case.direction, 0.0, 0.0);
    let found = intersect(&level_ray, &case.triangle, Rim::Included).expect("it is hit");
    let t = quotient(&-&truth.volume, &truth.whole);
    assert!((f64::from(found.t) / t - 1.0).abs() < 1e-7);
    let weight = quotient(&truth.edges[1], &truth.whole);
    assert!((f64::from(found.barycentrics[0]) - weight).abs() < 1e-6);
}

/// The whole test, as walks do it: which triangles are hit, and the bounds of margins, weights and
/// distances.
#[test]
fn bounds_hold() {
    let mut random = Random(0x0123_4567_89AB_CDEF);
    let [mut decided, mut hits] = [0; 2];
    let (mut t_most, mut weight_most, mut margin_most) = (0f64, 0f64, 0f64);
    let unit = f64::from(1 << 24);
    for i in 0..count() {
        let case = case(i % KINDS, &mut random);
        let truth = Truth::of(&case);
        if !is_sound(&case) {
            continue;
        }
        let mut level_ray = LevelRay::EMPTY;
        level_ray.tolerance = Accuracy::Spec.tolerance();
        level_ray.set(case.origin, case.direction, 0.0, 0.0);

        let flat = ShearedTriangle::new(&level_ray, &case.triangle);
        let edges = [flat.edge(2, 1), flat.edge(0, 2), flat.edge(1, 0)];
        let one_sign = edges.iter().all(|&e| e > 0.0) || edges.iter().all(|&e| e < 0.0);
        let error = Margin::of(&case.triangle).error(flat.z[0].abs());
        let hit = truth.faces(&case, Rim::Included);
        if error.is_finite() && (hit.is_some() || one_sign && edges.iter().sum::<f32>().is_finite())
        {
            let length = whole(level_ray.direction[level_ray.axes()[2]].abs());
            for (found, value) in edges.into_iter().zip(&truth.edges) {
                assert!(found.is_finite(), "{case:?}");
                let off = ((whole(found) * &length) << 149u32) - value;
                let limit = (whole(error) * &length) << 149u32;
                assert!(off.abs() <= limit, "{found} {error} {case:?}");
                margin_most = margin_most.max(quotient(&off.abs(), &limit));
            }
            decided += usize::from(edges.iter().all(|e| e.abs() > error));
        }

        for rim in [Rim::Included, Rim::Owned] {
            let found = intersect(&level_ray, &case.triangle, rim);
            let t = truth
                .faces(&case, rim)
                .map(|_| quotient(&-&truth.volume, &truth.whole));
            // Behind, at the start, and beyond what f32 can say.
            let Some(found) = found.filter(|found| found.t > 0.0) else {
                let none = t.is_none_or(|t| (t as f32) <= 0.0 || !t.is_finite());
                assert!(none, "{t:?} {rim:?} {case:?}");
                continue;
            };
            let t = t.unwrap_or_else(|| panic!("{found:?} {rim:?} {case:?}"));
            assert_eq!(Some(found.front), truth.faces(&case, rim), "{case:?}");
            hits += 1;
            if t > 1e-30 && t < 1e30 {
                let off = (f64::from(found.t) / t - 1.0).abs() * unit;
                assert!(off <= 130.0, "{off} {t} {found:?} {rim:?} {case:?}");
                t_most = t_most.max(off);
            }
            for i in 0..2 {
                let weight = quotient(&truth.edges[i + 1], &truth.whole);
                let off = (f64::from(found.barycentrics[i]) - weight).abs();
                let most = f64::from(rounding::MOST);
                assert!(off <= most, "{off} {found:?} {rim:?} {case:?}");
                weight_most = weight_most.max(off * unit);
            }
        }
    }
    println!(
        "{hits} hits, {decided} decided by bounds; of its bound a margin was {margin_most:.3}; t off by {:.2}, weights by {:.0} of 2⁻²⁴",
        t_most, weight_most
    );
    assert!(decided > count() / 50 && hits > count() / 10);
    assert!(margin_most <= 0.9, "{margin_most}");
}
