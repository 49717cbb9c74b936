//! The nearest hits of a packet so far.

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
    pub front: u16,
    /// Lanes with an opaque triangle.
    pub hit: u16,
    /// Lanes with what was decided on outside: but for `t`, that hit is in the rows of hits.
    pub outside: u16,
}

impl Found {
    /// Nothing, for no rays.
    pub const NOTHING: Found = Found {
        t: [0.0; PACKET],
        barycentrics: [[0.0; PACKET]; 2],
        slots: [0; PACKET],
        instances: [0; PACKET],
        instance: 0,
        front: 0,
        hit: 0,
        outside: 0,
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
        self.hit &= !(1 << lane);
        self.outside |= 1 << lane;
    }

    /// Opaque triangles are nearest now in some lanes.
    #[inline]
    pub fn mark(&mut self, lanes: u16, front: u16) {
        self.front = self.front & !lanes | front & lanes;
        self.hit |= lanes;
        self.outside &= !lanes;
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
            hit_kind: instance.hit_kind(self.front >> lane & 1 != 0),
            opaque: true,
            triangle: true,
            ..instance.hit()
        }
    }

    /// Takes over what a lane's walk has found by itself in the instance.
    pub fn set(&mut self, lane: usize, hit: &Hit, instance: &InstanceFacts) {
        self.t[lane] = hit.t;
        for (weights, weight) in self.barycentrics.iter_mut().zip(hit.barycentrics) {
            weights[lane] = weight;
        }
        self.slots[lane] = hit.slot;
        self.instances[lane] = hit.instance_index;
        let front = hit.hit_kind == instance.hit_kind(true);
        self.mark(1 << lane, u16::from(front) << lane);
    }

    /// Takes a hit in a lane, a triangle of the instance, if it is to be preferred to what there is.
    #[inline]
    pub fn offer(&mut self, structure: &Structure, lane: usize, slot: u32, hit: &Intersection) {
        let t_far = self.t[lane];
        let wins = hit.t < t_far
            || hit.t == t_far && self.won_ties(structure, slot, (1 << lane) & self.hit) != 0;
        if wins {
            self.t[lane] = hit.t;
            self.barycentrics[0][lane] = hit.barycentrics[0];
            self.barycentrics[1][lane] = hit.barycentrics[1];
            self.slots[lane] = slot;
            self.instances[lane] = self.instance;
            self.mark(1 << lane, u16::from(hit.front) << lane);
        }
    }

    /// In which lanes a triangle of the instance comes before the one that was found at the same distance.
    #[cold]
    pub fn won_ties(&self, structure: &Structure, slot: u32, ties: u16) -> u16 {
        let key = structure.identity(slot);
        let wins = |lane: usize| {
            let other = self.instances[lane];
            self.instance < other
                || self.instance == other && key < structure.identity(self.slots[lane])
        };
        (0..PACKET)
            .filter(|&lane| ties >> lane & 1 != 0 && wins(lane))
            .fold(0, |mask, lane| mask | 1 << lane)
    }
}
