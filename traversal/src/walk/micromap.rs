//! Triangles whose opacity depends on where they are met.
#![forbid(unsafe_code)]

use super::edge_side::Rim;
use super::facts::InstanceFacts;
use super::level::Level;
use super::level_ray::LevelRay;
use super::triangle::{Intersection, intersect};
use crate::layout::geometry_word;
use crate::micromap::{TriangleOpacity, TriangleStates};

/// A triangle as the rays of an instance meet it.
pub(crate) enum Seen {
    /// It is no candidate.
    Not,
    Opaque,
    /// A shader is asked.
    Candidate,
    /// That differs from point to point: see [`opacity_at`].
    ByParts(TriangleStates),
}

impl Seen {
    /// A triangle by the words of its geometry and primitive.
    #[inline(always)]
    pub fn of(level: &Level, instance: &InstanceFacts, geometry: u32, primitive: u32) -> Seen {
        match instance.uses_micromap(geometry) {
            false => instance.opacity(geometry).into(),
            true => Seen::by_micromap(level, instance, geometry, primitive),
        }
    }

    fn by_micromap(level: &Level, instance: &InstanceFacts, geometry: u32, primitive: u32) -> Seen {
        let geometry = geometry & geometry_word::INDEX;
        let opacity = level
            .structure
            .micromap_opacity(geometry, primitive, level.live());
        match opacity {
            TriangleOpacity::Everywhere(opacity) => instance.micromap_opacity(opacity).into(),
            TriangleOpacity::ByParts(states) => Seen::ByParts(states),
        }
    }
}

impl From<Option<bool>> for Seen {
    fn from(opacity: Option<bool>) -> Seen {
        match opacity {
            None => Seen::Not,
            Some(true) => Seen::Opaque,
            Some(false) => Seen::Candidate,
        }
    }
}

/// Whether a triangle is opaque to a ray at a point; `None` if it is no candidate there.
#[inline(always)]
pub(crate) fn opacity_at(
    states: &TriangleStates,
    instance: &InstanceFacts,
    barycentrics: [f32; 2],
) -> Option<bool> {
    instance.micromap_opacity(states.opacity(barycentrics))
}

/// Intersects a ray with a triangle of a geometry with a micromap. Returns whether the triangle is
/// opaque there. Opaque parts include the rim; elsewhere the point must be the triangle's own.
#[cold]
#[inline(never)]
pub(crate) fn intersect_micromap(
    level: &Level,
    level_ray: &LevelRay,
    instance: &InstanceFacts,
    triangle: &[[f32; 3]; 3],
    geometry: u32,
    primitive: u32,
) -> Option<(bool, Intersection)> {
    let found = intersect(level_ray, triangle, Rim::Included)?;
    let opaque = match Seen::of(level, instance, geometry, primitive) {
        Seen::Not => return None,
        Seen::Opaque => true,
        Seen::Candidate => false,
        Seen::ByParts(states) => opacity_at(&states, instance, found.barycentrics)?,
    };
    if opaque {
        return Some((true, found));
    }
    Some((false, intersect(level_ray, triangle, Rim::Owned)?))
}
