//! Where a ray meets the triangles of a leaf.

use super::edge_side::Rim;
use super::level_ray::LevelRay;
use super::triangle::{Intersection, intersect};
use crate::layout::{GROUP, LEAF_TRIANGLES, TriangleGroup};

/// Where a ray meets the triangles of a leaf.
#[repr(C, align(32))]
pub(crate) struct GroupHits {
    pub t: [f32; LEAF_TRIANGLES],
    /// Weights of the second and the third vertex.
    pub barycentrics: [[f32; LEAF_TRIANGLES]; 2],
    /// Bit i: lane i is seen from its front; see [`Intersection::front`].
    pub front: u32,
}

impl GroupHits {
    pub const NONE: GroupHits = GroupHits {
        t: [0.0; LEAF_TRIANGLES],
        barycentrics: [[0.0; LEAF_TRIANGLES]; 2],
        front: 0,
    };

    /// Sets a lane.
    pub fn set(&mut self, lane: usize, hit: &Intersection) {
        self.t[lane] = hit.t;
        for (weights, weight) in self.barycentrics.iter_mut().zip(hit.barycentrics) {
            weights[lane] = weight;
        }
        self.front = self.front & !(1 << lane) | u32::from(hit.front) << lane;
    }

    /// Intersects the lanes in `mask` one by one; returns those that are hit in the interval.
    #[inline(always)]
    pub fn intersect_each(
        &mut self,
        level_ray: &LevelRay,
        groups: [&TriangleGroup; 2],
        mask: u32,
        [t_min, t_far]: [f32; 2],
    ) -> u32 {
        let mut hits = 0;
        let mut rest = mask;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
            rest &= rest - 1;
            let triangle = groups[lane / GROUP].triangle(lane % GROUP);
            if let Some(hit) = intersect(level_ray, &triangle, Rim::Included)
                && t_min < hit.t
                && hit.t <= t_far
            {
                self.set(lane, &hit);
                hits |= 1 << lane;
            }
        }
        hits
    }
}
