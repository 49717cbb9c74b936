//! Walks through triangles that all count: opaque, not culled, in a space that is not scaled.
//! Nothing there suspends a walk but want of fuel, so the loop is small.

use super::entry::{Entry, STACK};
use super::facts::InstanceFacts;
use super::level_rays::LevelRays;
use crate::ray::Hit;
use crate::structure::Structure;

/// Why a walk left a bottom level.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// All of it is done.
    Finished,
    /// The walk ends.
    Over,
    OutOfFuel,
}

/// Entries that are still to be visited: those from `floor` on belong to this bottom level.
pub(crate) struct Pending<'a> {
    pub stack: &'a mut [Entry; STACK],
    pub floor: usize,
    pub length: usize,
}

/// A ray in a bottom level.
pub(crate) struct Opaque<'a> {
    pub structure: &'a Structure,
    pub instance: &'a InstanceFacts,
    pub level_rays: &'a LevelRays,
    pub lane: usize,
    /// The hit so far.
    pub committed: Option<&'a Hit>,
    pub fetches_ahead: bool,
}

impl Opaque<'_> {
    /// The hit; `None` if there is none.
    #[inline(always)]
    pub fn hit(&self, nearest: &Nearest) -> Option<Hit> {
        if nearest.slot == Hit::UNKNOWN_SLOT {
            return None;
        }
        Some(nearest.hit(self.instance, self.structure))
    }

    /// Whether a triangle wins a tie with the nearest one, with an earlier hit, or with the end of
    /// the ray. By value: the walk keeps its nearest in registers.
    #[cold]
    #[inline(never)]
    pub fn wins_tie(&self, nearest: Nearest, slot: u32) -> bool {
        if nearest.slot != Hit::UNKNOWN_SLOT {
            return self.structure.identity(slot) < self.structure.identity(nearest.slot);
        }
        let hit = self.hit(&Nearest { slot, ..nearest });
        (hit.zip(self.committed)).is_some_and(|(hit, committed)| hit.wins_tie(committed))
    }
}

/// The nearest triangle so far.
#[derive(Clone, Copy)]
pub(crate) struct Nearest {
    /// The ray's interval; `t` is the distance of what was found.
    pub t_min: f32,
    pub t: f32,
    /// Where it lies, as in [`Hit::slot`]; [`Hit::UNKNOWN_SLOT`] if there is none.
    pub slot: u32,
    pub barycentrics: [f32; 2],
    pub front: bool,
}

impl Nearest {
    /// None yet in an interval.
    pub const fn none_in(t_min: f32, t_max: f32) -> Nearest {
        Nearest {
            t_min,
            t: t_max,
            slot: Hit::UNKNOWN_SLOT,
            barycentrics: [0.0; 2],
            front: false,
        }
    }

    /// As a hit; there is one.
    #[inline(always)]
    pub fn hit(&self, instance: &InstanceFacts, structure: &Structure) -> Hit {
        let (geometry_index, primitive_index) = structure.identity(self.slot);
        Hit {
            t: self.t,
            barycentrics: self.barycentrics,
            geometry_index,
            primitive_index,
            slot: self.slot,
            hit_kind: instance.hit_kind(self.front),
            opaque: true,
            triangle: true,
            ..instance.hit()
        }
    }
}
