//! The nearest hits of a packet so far.

use lanes::LaneMask;

use crate::ray::Hit;
use crate::structure::Structure;
use crate::walk::PACKET;
use crate::walk::facts::InstanceFacts;
use crate::walk::rows::{Lanes, RayRows, Words};
use crate::walk::triangle::Intersection;

#[derive(Clone)]
#[repr(C, align(64))]
pub(crate) struct Found {
    pub t: Lanes,
    pub barycentrics: [Lanes; 2],
    pub slots: Words,
    pub instances: Words,
    /// The instance that the packet is in.
    pub instance: u32,
    pub front: LaneMask,
    /// Lanes with an opaque triangle.
    pub hit: LaneMask,
    /// Lanes with a hit that was decided outside: except for `t`, that hit is in the rows of hits.
    pub outside: LaneMask,
}

impl Found {
    /// Nothing, for no rays.
    pub const NOTHING: Found = Found {
        t: [0.0; PACKET],
        barycentrics: [[0.0; PACKET]; 2],
        slots: [0; PACKET],
        instances: [0; PACKET],
        instance: 0,
        front: LaneMask::NONE,
        hit: LaneMask::NONE,
        outside: LaneMask::NONE,
    };

    /// Nothing yet.
    pub fn new(rays: &RayRows) -> Found {
        Found {
            t: rays.t_max,
            ..Found::NOTHING
        }
    }

    /// Takes note of a hit that was decided on outside.
    pub fn set_outside(&mut self, lane: usize, t: f32) {
        self.t[lane] = t;
        self.hit.remove(lane);
        self.outside.insert(lane);
    }

    /// Opaque triangles are nearest now in some lanes.
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub fn mark(&mut self, lanes: LaneMask, front: LaneMask) {
        self.front = (self.front - lanes) | (front & lanes);
        self.hit |= lanes;
        self.outside -= lanes;
    }

    /// The same in one lane.
    #[inline]
    fn mark_one(&mut self, lane: usize, front: bool) {
        self.front.set(lane, front);
        self.hit.insert(lane);
        self.outside.remove(lane);
    }

    /// The hit of a lane that has one, in an instance of this structure.
    pub fn hit(&self, lane: usize, structure: &Structure, instance: &InstanceFacts) -> Hit {
        let slot = self.slots[lane];
        let (geometry, primitive) = structure.identity(slot);
        Hit {
            t: self.t[lane],
            barycentrics: [self.barycentrics[0][lane], self.barycentrics[1][lane]],
            geometry_index: geometry,
            primitive_index: primitive,
            slot,
            hit_kind: instance.hit_kind(self.front.contains(lane)),
            opaque: true,
            triangle: true,
            ..instance.hit()
        }
    }

    /// Stores the hit of a lane's single walk in the instance.
    pub fn set(&mut self, lane: usize, hit: &Hit, instance: &InstanceFacts) {
        self.t[lane] = hit.t;
        for (weights, weight) in self.barycentrics.iter_mut().zip(hit.barycentrics) {
            weights[lane] = weight;
        }
        self.slots[lane] = hit.slot;
        self.instances[lane] = hit.instance_index;
        let front = hit.hit_kind == instance.hit_kind(true);
        self.mark_one(lane, front);
    }

    /// Stores the hit of a lane with a triangle of the instance, if it wins over the hit so far.
    #[inline]
    pub fn offer(&mut self, structure: &Structure, lane: usize, slot: u32, hit: &Intersection) {
        let t_far = self.t[lane];
        let wins = hit.t < t_far
            || hit.t == t_far && {
                let tie = LaneMask::of(lane) & self.hit;
                self.won_ties(structure, slot, tie).contains(lane)
            };
        if wins {
            self.t[lane] = hit.t;
            self.barycentrics[0][lane] = hit.barycentrics[0];
            self.barycentrics[1][lane] = hit.barycentrics[1];
            self.slots[lane] = slot;
            self.instances[lane] = self.instance;
            self.mark_one(lane, hit.front);
        }
    }

    /// In which lanes a triangle of the instance comes before the one that was found at the same
    /// distance.
    #[cold]
    pub fn won_ties(&self, structure: &Structure, slot: u32, ties: LaneMask) -> LaneMask {
        let key = structure.identity(slot);
        let wins = |lane: usize| {
            let other = self.instances[lane];
            self.instance < other
                || self.instance == other && key < structure.identity(self.slots[lane])
        };
        ties.iter().filter(|&lane| wins(lane)).collect()
    }
}
