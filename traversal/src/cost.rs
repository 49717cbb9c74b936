//! The cost of a ray by itself: for reports. No walk needs this.
//!
//! The ray is walked once more, alone, from the nearest child to the farthest, without the
//! shortcuts that depend on the machine. Every instruction set visits the same nodes, so the counts
//! are those of the ray and of the structures, and of nothing else.

use lanes::LaneMask;

use crate::layout::{NodeAt, child};
use crate::live::Live;
use crate::ray::{Hit, Ray};
use crate::structure::{Kind, Structure};
use crate::walk::level::Entered;
use crate::walk::meter::Meter;
use crate::walk::{Event, GroupWalk, PACKET, RayRows, Verdict, Walk, Walker};

/// Visits of one ray, at most.
const FUEL: u64 = 1 << 24;

/// Counts of one ray by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCost {
    /// Nodes and leaves that are visited; an instance is a leaf of a top level.
    pub steps: u32,
    /// Boxes of nodes' children that the ray is held against.
    pub box_tests: u32,
    /// Triangles and round primitives of the leaves that are visited.
    pub primitive_tests: u32,
    /// Triangles and round primitives that are not opaque, where the walk stops.
    pub any_hit_candidates: u32,
    /// Boxes of geometries, where the walk stops.
    pub box_candidates: u32,
    /// There were more visits than are counted.
    pub is_cut: bool,
}

/// Walks rays one after the other for their costs. The walker does nothing else meanwhile.
pub struct RayCosts<'a> {
    walker: &'a mut Walker,
    walk: Walk,
    /// By the ray before.
    entered: Entered,
}

impl<'a> RayCosts<'a> {
    /// For structures that may lie in `live`.
    ///
    /// # Safety
    /// That memory is there as long as the walker walks, until another is set.
    pub unsafe fn new(walker: &'a mut Walker, live: &Live) -> Self {
        // SAFETY: the caller keeps the memory of `live` as long as the walker walks.
        unsafe { walker.set_live(live) };
        Self {
            walker,
            walk: Walk::OVER,
            entered: Entered::NOTHING,
        }
    }

    /// Walks a ray, cast at a time in [0, 1], to its hit. Of the candidates that shaders decide on,
    /// the hit is accepted and all others are ignored: those before it were ignored, or it would
    /// not be the hit. So the counts do not depend on the decisions behind it.
    ///
    /// # Safety
    /// As for [`Walk::new`], until the last ray is walked.
    pub unsafe fn of(
        &mut self,
        top_level: u64,
        ray: &Ray,
        time: f32,
        hit: Option<&Hit>,
    ) -> RayCost {
        let mut cost = RayCost::default();
        let Self {
            walker,
            walk,
            entered,
        } = self;
        // SAFETY: the caller keeps the contract of `Walk::new`.
        unsafe { walk.restart(top_level, ray) };
        walk.set_time(time);
        let is_hit = |candidate: &Hit| hit.is_some_and(|hit| key(candidate) == key(hit));
        let (mut verdict, mut fuel) = (Verdict::Continue, FUEL);
        loop {
            let event = walk.resume_metered(walker, entered, verdict, &mut fuel, &mut cost);
            verdict = Verdict::Continue;
            match event {
                Event::Done => break,
                Event::OutOfFuel => {
                    cost.is_cut = true;
                    break;
                }
                Event::AnyHitCandidate => {
                    cost.any_hit_candidates += 1;
                    if is_hit(walk.candidate()) {
                        verdict = Verdict::Accept;
                    }
                }
                Event::ProceduralCandidate => {
                    cost.box_candidates += 1;
                    if let Some(hit) = hit.filter(|_| is_hit(walk.candidate())) {
                        walk.commit_procedural(hit.t, hit.hit_kind);
                    }
                }
            }
        }
        cost
    }
}

impl RayCosts<'_> {
    /// Walks rays of a group that start, one after the other, to their hits. Stops at candidates:
    /// returns the rays that met none and are over. Their costs are those of [`Self::of`], their
    /// hits those of [`Walker::trace`]. The others have not started.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray, until the last one is walked.
    pub unsafe fn walk_to_ends(
        &mut self,
        rays: &RayRows,
        lanes: LaneMask,
        group_walk: &mut GroupWalk,
        costs: &mut [RayCost; PACKET],
    ) -> LaneMask {
        let walker = &mut *self.walker;
        walker.clear_flight(group_walk);
        *costs = [RayCost::default(); PACKET];
        let mut over = lanes;
        let stop = &mut |lane: usize, _: &mut Walk, _: Event| over.remove(lane);
        let (hits, fuel) = (&mut group_walk.hits, &mut { FUEL });
        // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
        unsafe { walker.meter_in_turn(rays, lanes, hits, fuel, costs, stop) };
        over
    }
}

/// The primitive of a hit.
fn key(hit: &Hit) -> (u32, u32, u32, bool) {
    (
        hit.instance_index,
        hit.geometry_index,
        hit.primitive_index,
        hit.is_built_in(),
    )
}

impl Meter for RayCost {
    const COUNTS: bool = true;

    #[inline(always)]
    fn visit_node(&mut self, node: NodeAt<'_>) {
        self.steps += 1;
        self.box_tests += node.child_count();
    }

    #[inline(always)]
    fn visit_leaf(&mut self, structure: &Structure, word: u32) {
        if word & child::LEAF == 0 || word == child::NONE {
            return;
        }
        self.steps += 1;
        self.primitive_tests += match structure.kind() {
            Kind::Triangles => {
                let mut room = None;
                let groups = structure.leaf_groups(word, &mut room, |block, _| block.lanes());
                groups.map_or(0, |(_, lanes)| lanes.count_ones())
            }
            Kind::Swept | Kind::Motion => 1,
            // The box was tested where its leaf's node was.
            Kind::Aabbs | Kind::Instances | Kind::MotionInstances => 0,
        };
    }

    #[inline(always)]
    fn visit_triangles(&mut self, count: u32) {
        self.steps += 1;
        self.primitive_tests += count;
    }
}
