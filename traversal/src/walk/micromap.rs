//! Triangles whose opacity depends on where they are met.
#![forbid(unsafe_code)]

use super::decide::Rim;
use super::facts::InstanceFacts;
use super::level::Level;
use super::space::Space;
use super::triangle::{Intersection, intersect};
use crate::layout::geometry_word;

/// Intersects a ray with a triangle of a geometry with a micromap. Returns whether the triangle is
/// opaque there. Opaque parts include the rim; elsewhere the point must be the triangle's own.
#[cold]
#[inline(never)]
pub(crate) fn intersect_micromap(
    level: &Level,
    space: &Space,
    instance: &InstanceFacts,
    triangle: &[[f32; 3]; 3],
    geometry: u32,
    primitive: u32,
) -> Option<(bool, Intersection)> {
    let found = intersect(space, triangle, Rim::Included)?;
    let opacity = level.structure.micromap_opacity(
        geometry & geometry_word::INDEX,
        primitive,
        found.barycentrics,
        level.live(),
    );
    if instance.micromap_opacity(opacity)? {
        return Some((true, found));
    }
    Some((false, intersect(space, triangle, Rim::Owned)?))
}
