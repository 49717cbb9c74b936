//! Decisions of simulated shaders about candidates. It follows from the ray and the candidate
//! alone, so the order does not matter.

use crate::{Bytes, apply, wide};
use traversal::{EVERYWHERE, Hit, Ray, Structure};

/// A number for each candidate.
pub fn lot(hit: &Hit) -> u32 {
    let word = hit.primitive_index * 31 + hit.geometry_index * 7 + hit.instance_index * 3;
    (word ^ word >> 7).wrapping_mul(0x7FEB_352D) >> 8
}

/// Whether a triangle counts.
pub fn counts(hit: &Hit) -> bool {
    lot(hit).is_multiple_of(3)
}

/// Where a ray is taken to meet what is in a box, if it does: after it has entered the box, so that
/// no walk may lose it.
pub fn inside(top: &Bytes, bounds: &[f32; 6], ray: &Ray, time: f32, hit: &Hit) -> Option<f32> {
    // SAFETY: the structures are alive.
    let top = unsafe { Structure::at(top.address(), &EVERYWHERE) }.expect("it was built");
    let m = top.world_to_object_at(hit.instance_index, time);
    let (o, d) = (
        apply(&m, wide(ray.origin), 1.0),
        apply(&m, wide(ray.direction), 0.0),
    );
    let bounds = bounds.map(f64::from);
    let (mut near, mut far) = (0f64, f64::INFINITY);
    for axis in 0..3 {
        let [a, b] = [bounds[axis], bounds[axis + 3]].map(|plane| (plane - o[axis]) / d[axis]);
        (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
    }
    // Far from edges, where a wider test would find it as well.
    let part = (f64::from(lot(hit) % 65_536) + 0.5) / 65_536.0;
    (far - near > 1e-3 && !lot(hit).is_multiple_of(4))
        .then_some((near + part * (far - near)) as f32)
}
