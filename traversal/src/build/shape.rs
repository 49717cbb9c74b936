//! The shape of a structure before it is built.

use super::{BuildError, MAX_GEOMETRIES, MAX_PRIMITIVES};
use crate::input::Geometries;
use crate::layout::micromap_part_bytes;
use crate::structure::Kind;

/// The kind and size of an input's structure.
pub(crate) struct Shape {
    pub kind: Kind,
    pub geometries: u64,
    pub primitives: u64,
    /// Of the part for micromaps; 0 without.
    pub micromap_bytes: u64,
}

impl Shape {
    pub fn of(geometries: &Geometries<'_>) -> Result<Shape, BuildError> {
        let count = |counts: &mut dyn Iterator<Item = u32>| counts.map(u64::from).sum();
        let mut shape = match geometries {
            Geometries::Triangles(list) => Shape {
                kind: Kind::Triangles,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Aabbs(list) => Shape {
                kind: Kind::Aabbs,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Swept(list) => Shape {
                kind: Kind::Swept,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Motion(list) => Shape {
                kind: Kind::Motion,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.start.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Instances(source) => Shape {
                kind: match source.array.is_motion() {
                    true => Kind::MotionInstances,
                    false => Kind::Instances,
                },
                geometries: 1,
                primitives: source.count.into(),
                micromap_bytes: 0,
            },
        };
        let most = match shape.kind {
            kind if kind.is_top() => MAX_GEOMETRIES,
            _ => MAX_PRIMITIVES,
        };
        if shape.geometries > MAX_GEOMETRIES || shape.primitives > most {
            return Err(BuildError::TooLarge);
        }
        if geometries
            .triangle_lists()
            .any(|list| list.micromap.is_some())
        {
            shape.micromap_bytes = micromap_part_bytes(shape.geometries, shape.primitives);
        }
        Ok(shape)
    }
}
