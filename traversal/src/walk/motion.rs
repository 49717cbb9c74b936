//! Triangles that move: the test of those that do not, where they are at the ray's time.
#![forbid(unsafe_code)]

use super::edge_side::Rim;
use super::facts::InstanceFacts;
use super::leaf::Leaf;
use super::level::Level;
use super::triangle::intersect;
use super::{Event, Walk, micromap};
use crate::layout::{child, geometry_word};
use crate::motion::triangle_at;
use crate::ray::{HIT_KIND_BACK_FACING_TRIANGLE, HIT_KIND_FRONT_FACING_TRIANGLE, Hit};

/// Tests the one triangle of a leaf; lowers `t_far` to what is found.
pub(crate) fn test_leaf(
    walk: &mut Walk,
    level: &Level,
    instance: &InstanceFacts,
    word: u32,
    t_far: &mut f32,
) -> Leaf {
    let Some(hit) = intersect_moving(walk, level, instance, word & child::INDEX) else {
        return Leaf::Finished;
    };
    if !hit.opaque {
        walk.candidate = hit;
        return Leaf::Ask(Event::AnyHitCandidate, 0);
    }
    if walk.commit(hit) {
        return Leaf::Over;
    }
    *t_far = level.ray.scaled_up(hit.t);
    Leaf::Finished
}

fn intersect_moving(
    walk: &Walk,
    level: &Level,
    instance: &InstanceFacts,
    slot: u32,
) -> Option<Hit> {
    let entry = level.structure.motion_entry(slot)?;
    let triangle = triangle_at(&entry.triangles, walk.time);
    let (opaque, found) = if instance.uses_micromap(entry.geometry) {
        micromap::intersect_micromap(
            level,
            &level.ray,
            instance,
            &triangle,
            entry.geometry,
            entry.primitive,
        )?
    } else {
        let opaque = instance.opacity(entry.geometry)?;
        let rim = if opaque { Rim::Included } else { Rim::Owned };
        (opaque, intersect(&level.ray, &triangle, rim)?)
    };
    let front = instance.facing(found.front)?;
    let hit = Hit {
        t: found.t,
        barycentrics: found.barycentrics,
        geometry_index: entry.geometry & geometry_word::INDEX,
        primitive_index: entry.primitive,
        slot,
        hit_kind: if front {
            HIT_KIND_FRONT_FACING_TRIANGLE
        } else {
            HIT_KIND_BACK_FACING_TRIANGLE
        },
        opaque,
        triangle: true,
        ..instance.hit()
    };
    (walk.ray.t_min < hit.t && walk.is_nearer(&hit)).then_some(hit)
}
