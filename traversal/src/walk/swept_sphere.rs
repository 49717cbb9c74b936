//! Spheres and linear swept spheres.
//!
//! All of it is in f64, from the ray's point that is nearest to the primitive on: the squares then
//! are of the primitive's size, whatever the ray's distance. What a line enters is the convex hull
//! of the two spheres: the sphere or the tangent cone that it meets first. Only that point counts
//! (chapter Ray Traversal: nothing is reported from inside, or through an end cap that is not
//! there).

use super::facts::InstanceFacts;
use super::level::Level;
use super::{Event, Walk};
use crate::layout::{SweptEntry, child, geometry_word, swept_flags};
use crate::ray::{HIT_KIND_LINEAR_SWEPT_SPHERE, HIT_KIND_SPHERE, Hit, Swept};

use super::leaf::Leaf;

/// Where a ray meets a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SweptHit {
    pub t: f32,
    /// Position along the axis: 0 and 1 are the end caps.
    pub u: f32,
}

type Point = [f64; 3];

fn dot(a: &Point, b: &Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: &Point, b: &Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn along(a: &Point, d: &Point, t: f64) -> Point {
    [a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]]
}

/// The smaller root of `a t² + 2 b t + c`, without cancellation; where `a` is not positive, the one
/// at which the value turns negative.
fn entry(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    if discriminant.is_nan() || discriminant < 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    let t = if b < 0.0 {
        c / (root - b)
    } else {
        (-b - root) / a
    };
    t.is_finite().then_some(t)
}

/// Where the line enters a sphere.
fn enter_sphere(origin: &Point, direction: &Point, center: &Point, radius: f64) -> Option<f64> {
    let from = minus(origin, center);
    let aa = dot(direction, direction);
    // From the nearest point on, where the linear term vanishes.
    let nearest = -dot(&from, direction) / aa;
    let offset = along(&from, direction, nearest);
    let room = radius * radius - dot(&offset, &offset);
    (room >= 0.0).then(|| nearest - (room / aa).sqrt())
}

/// Where the line enters the frustum that touches both spheres, and the position along the axis of
/// the sphere that it touches there.
fn enter_cone(
    origin: &Point,
    direction: &Point,
    ends: &[Point; 2],
    radii: [f64; 2],
) -> Option<(f64, f64)> {
    let axis = minus(&ends[1], &ends[0]);
    let length_squared = dot(&axis, &axis);
    let length = length_squared.sqrt();
    let sine = (radii[0] - radii[1]) / length;
    let cosine_squared = 1.0 - sine * sine;
    let unit = axis.map(|c| c / length);
    let from = minus(origin, &ends[0]);
    let (z, dz) = (dot(&from, &unit), dot(direction, &unit));
    // With ρ the distance from the axis and z the way along it: ρ² cos² = (r₀ − z sin)².
    let a = cosine_squared * dot(direction, direction) - dz * dz;
    let b = cosine_squared * dot(&from, direction) - z * dz + radii[0] * sine * dz;
    let c = cosine_squared * dot(&from, &from) - z * z + 2.0 * radii[0] * sine * z
        - radii[0] * radii[0];
    let t = entry(a, b, c)?;
    let center = (z + t * dz - radii[0] * sine) / cosine_squared;
    let u = center / length;
    (0.0..=1.0).contains(&u).then_some((t, u))
}

/// Where the line enters a primitive, if it does through a part that is there.
pub(crate) fn intersect(
    origin: [f32; 3],
    direction: [f32; 3],
    entry: &SweptEntry,
) -> Option<SweptHit> {
    let origin = origin.map(f64::from);
    let direction = direction.map(f64::from);
    let ends = entry.positions.map(|position| position.map(f64::from));
    let radii = entry.radii.map(f64::from);
    let aa = dot(&direction, &direction);
    if aa == 0.0 || radii == [0.0; 2] {
        return None;
    }
    // Start from where the line is nearest to the first end.
    let shift = dot(&minus(&ends[0], &origin), &direction) / aa;
    let start = along(&origin, &direction, shift);
    let has = |flag: u32| entry.flags & flag != 0;
    let found = if has(swept_flags::SPHERE) {
        (
            enter_sphere(&start, &direction, &ends[0], radii[0])?,
            0.0,
            true,
        )
    } else {
        let caps = [has(swept_flags::FIRST_CAP), has(swept_flags::SECOND_CAP)];
        let axis = minus(&ends[1], &ends[0]);
        let difference = radii[0] - radii[1];
        let sphere = |i: usize| {
            enter_sphere(&start, &direction, &ends[i], radii[i]).map(|t| (t, i as f64, caps[i]))
        };
        if difference * difference >= dot(&axis, &axis) {
            // One sphere holds the other: there is nothing between them.
            sphere(usize::from(difference < 0.0))?
        } else {
            let cone = enter_cone(&start, &direction, &ends, radii);
            // Strictly between the ends, so that it reads as the midsection.
            let cone = cone.map(|(t, u)| {
                let inside = (u as f32).clamp(f32::MIN_POSITIVE, 1.0f32.next_down());
                (t, f64::from(inside), true)
            });
            [cone, sphere(0), sphere(1)]
                .into_iter()
                .flatten()
                .reduce(|best, other| if other.0 < best.0 { other } else { best })?
        }
    };
    let (t, u, is_there) = found;
    is_there.then_some(SweptHit {
        t: (t + shift) as f32,
        u: u as f32,
    })
}

/// Tests the one primitive of a leaf; lowers `t_far` to what is found.
pub(crate) fn test_leaf(
    walk: &mut Walk,
    level: &Level,
    instance: &InstanceFacts,
    word: u32,
    t_far: &mut f32,
) -> Leaf {
    let Some(entry) = level.structure.swept_entry(word & child::INDEX) else {
        return Leaf::Finished;
    };
    let Some(opaque) = instance.opacity(entry.geometry) else {
        return Leaf::Finished;
    };
    let [x, y, z, _] = level.ray.origin;
    let [dx, dy, dz, _] = level.ray.direction;
    let Some(meeting) = intersect([x, y, z], [dx, dy, dz], &entry) else {
        return Leaf::Finished;
    };
    let is_sphere = entry.flags & swept_flags::SPHERE != 0;
    let hit = Hit {
        t: meeting.t,
        barycentrics: [meeting.u, 0.0],
        geometry_index: entry.geometry & geometry_word::INDEX,
        primitive_index: entry.primitive,
        slot: word & child::INDEX,
        hit_kind: if is_sphere {
            HIT_KIND_SPHERE
        } else {
            HIT_KIND_LINEAR_SWEPT_SPHERE
        },
        opaque,
        swept: if is_sphere {
            Swept::Sphere
        } else {
            Swept::LinearSweptSphere
        },
        ..instance.hit()
    };
    if !(walk.ray.t_min < hit.t && walk.is_nearer(&hit)) {
        return Leaf::Finished;
    }
    if !opaque {
        walk.candidate = hit;
        return Leaf::Ask(Event::AnyHitCandidate, 0);
    }
    if walk.commit(hit) {
        return Leaf::Over;
    }
    *t_far = level.ray.scaled_up(hit.t);
    Leaf::Finished
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry_of(positions: [[f32; 3]; 2], radii: [f32; 2], flags: u32) -> SweptEntry {
        SweptEntry {
            positions,
            radii,
            primitive: 0,
            geometry: 0,
            flags,
            reserved: [0; 5],
        }
    }

    const CAPS: u32 = swept_flags::FIRST_CAP | swept_flags::SECOND_CAP;

    #[test]
    fn a_sphere_is_met_in_front() {
        let sphere = entry_of([[0.0, 0.0, 5.0]; 2], [2.0; 2], swept_flags::SPHERE);
        let intersect = |origin: [f32; 3], direction| intersect(origin, direction, &sphere);
        let front = intersect([0.0; 3], [0.0, 0.0, 0.5]).expect("it is there");
        assert_eq!((front.t, front.u), (6.0, 0.0));
        // From inside, the entry lies behind.
        assert_eq!(
            intersect([0.0, 0.0, 5.0], [0.0, 0.0, 1.0]).map(|m| m.t),
            Some(-2.0)
        );
        assert_eq!(intersect([2.1, 0.0, 0.0], [0.0, 0.0, 1.0]), None);
        // From far away, to the last bit.
        assert_eq!(
            intersect([1.0e7, 0.0, 5.0], [-1.0, 0.0, 0.0]).map(|m| m.t),
            Some(1.0e7 - 2.0)
        );
    }

    #[test]
    fn caps_are_there_or_not() {
        let ends = [[2.0, 0.0, -15.0], [6.0, 0.0, -15.0]];
        for (caps, x, expected) in [
            (0, 1.0, None),
            (0, 4.0, Some((13.0, 0.5))),
            (0, 7.0, None),
            (swept_flags::FIRST_CAP, 2.0 - 1.2, Some((13.4, 0.0))),
            (swept_flags::FIRST_CAP, 7.2, None),
            (swept_flags::SECOND_CAP, 7.2, Some((13.4, 1.0))),
            (CAPS, 9.0, None),
        ] {
            let it = entry_of(ends, [2.0; 2], caps);
            let met = intersect([x, 0.0, 0.0], [0.0, 0.0, -1.0], &it);
            let close = match (met, expected) {
                (Some(met), Some((t, u))) => (met.t - t).abs() < 1e-5 && (met.u - u).abs() < 1e-6,
                (None, None) => true,
                _ => false,
            };
            assert!(close, "{caps} {x}: {met:?}");
        }
    }

    #[test]
    fn the_larger_end_hides_the_smaller() {
        let it = entry_of([[0.0; 3], [1.0, 0.0, 0.0]], [3.0, 0.5], CAPS);
        let met = intersect([0.0, 0.0, 9.0], [0.0, 0.0, -1.0], &it);
        assert_eq!(met, Some(SweptHit { t: 6.0, u: 0.0 }));
        let it = entry_of([[1.0, 0.0, 0.0], [0.0; 3]], [0.5, 3.0], CAPS);
        let met = intersect([0.0, 0.0, 9.0], [0.0, 0.0, -1.0], &it);
        assert_eq!(met, Some(SweptHit { t: 6.0, u: 1.0 }));
    }

    /// The hull of the spheres against spheres in small steps along the axis.
    #[test]
    fn swept_is_the_union_of_its_spheres() {
        let it = entry_of([[1.0, 2.0, 3.0], [4.0, 1.0, 5.0]], [0.5, 1.5], CAPS);
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(747796405).wrapping_add(2891336453);
            (state >> 8) as f32 / 16_777_216.0 * 12.0 - 4.0
        };
        let mut hits = 0;
        for _ in 0..2000 {
            let origin = [random(), random(), random() - 20.0];
            let target = [random(), random(), random()];
            let direction: [f32; 3] = std::array::from_fn(|i| target[i] - origin[i]);
            let steps = 20_000;
            let nearest = (0..=steps)
                .filter_map(|k| {
                    let u = k as f64 / steps as f64;
                    let at = |i: usize| {
                        f64::from(it.positions[0][i]) * (1.0 - u)
                            + f64::from(it.positions[1][i]) * u
                    };
                    let center = [at(0), at(1), at(2)];
                    enter_sphere(
                        &origin.map(f64::from),
                        &direction.map(f64::from),
                        &center,
                        0.5 + u,
                    )
                })
                .reduce(f64::min);
            match (intersect(origin, direction, &it), nearest) {
                (Some(met), Some(nearest)) => {
                    assert!(
                        (f64::from(met.t) - nearest).abs() < 1e-4,
                        "{met:?} {nearest}"
                    );
                    hits += 1;
                }
                (None, None) => {}
                // Grazing rays may slip between the steps.
                (Some(met), None) => assert!(met.t.is_finite()),
                (None, Some(nearest)) => panic!("missed at {nearest}"),
            }
        }
        assert!(hits > 100, "{hits}");
    }
}
