//! An observer's view of a subgroup's ray queries. Nothing here runs without an observer.

use std::time::Instant;

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::origin::CodeLocation;
use spirv_jit::query::{row, state};
use traversal::{GroupWalk, RayCosts, RayRows, Walker};

use super::{QueryRows, load};
use crate::wave::Limits;
use crate::wave::launch_counts::{Cells, LaunchCounts, WalkedRay};
use crate::wave::observer::{Instruction, Observation, Observer, QueryDecision, RayStart};

/// An observer's view of a subgroup.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    /// The observed lane.
    pub one: Option<(&'a dyn Observer, usize)>,
    pub counted: Option<Counted<'a>>,
}

/// Counts of invocations, and where a subgroup's lanes are among them.
#[derive(Clone, Copy)]
pub struct Counted<'a> {
    pub counts: &'a LaunchCounts,
    pub cells: Cells,
}

/// A view of queries that proceed.
pub(super) struct View<'a> {
    one: Option<(&'a dyn Observer, usize, CodeLocation)>,
    counted: Option<Counted<'a>>,
    started: Option<Instant>,
    walked: Vec<WalkedRay>,
}

impl<'a> View<'a> {
    /// `None` where nothing is seen. `place`: where the shader stands.
    #[cold]
    pub fn new(seen: Seen<'a>, place: impl FnOnce() -> CodeLocation) -> Option<Self> {
        if seen.one.is_none() && seen.counted.is_none() {
            return None;
        }
        Some(Self {
            one: seen.one.map(|(observer, lane)| (observer, lane, place())),
            counted: seen.counted,
            started: seen.counted.map(|_| Instant::now()),
            walked: Vec::new(),
        })
    }

    /// A query's rays start.
    #[cold]
    pub fn start(&self, object: &QueryRows<'_>, lanes: LaneMask) {
        let mut rays = RayRows::NONE;
        load(object.rows, &mut rays);
        if let Some(Counted { counts, cells }) = &self.counted {
            counts.note_structures(lanes.iter().map(|lane| rays.top_level[lane]));
            counts.start_rays(cells, lanes, &rays, |_| 0);
        }
        let Some((observer, lane, place)) = &self.one else {
            return;
        };
        if !lanes.contains(*lane) {
            return;
        }
        observer.observe(Observation::Ray(Box::new(RayStart {
            instruction: Instruction::RayQuery(object.first),
            place: place.clone(),
            ray: rays.ray(*lane),
            pipeline_flags: 0,
            time: 0.0,
            structure: rays.top_level[*lane],
            operands: None,
            payload: Vec::new(),
        })));
    }

    /// The shader has decided about a candidate, which is still there.
    #[cold]
    pub fn decision(&self, object: &QueryRows<'_>, group_walk: &GroupWalk, lanes: LaneMask) {
        let Some((observer, lane)) = self.observed(lanes) else {
            return;
        };
        let is_built_in = group_walk.candidates().built_in().contains(lane);
        let decision = match object.rows[row::STATE].0[lane] {
            state::CONFIRMED if is_built_in => QueryDecision::Confirmed,
            state::GENERATED if !is_built_in => {
                let t = f32::from_bits(object.rows[row::GENERATED_T].0[lane]);
                let counts = group_walk.counts(LaneMask::of(lane), &[t; SUBGROUP_SIZE]);
                QueryDecision::Generated(t, !counts.is_empty())
            }
            _ => QueryDecision::Ignored,
        };
        let object = object.first;
        observer.observe(Observation::QueryDecision { object, decision });
    }

    /// Rays stand at candidates, or have ended.
    #[cold]
    pub fn settled(&mut self, object: &QueryRows<'_>, group_walk: &GroupWalk, lanes: LaneMask) {
        if let Some(Counted { cells, .. }) = &self.counted {
            let mut rays = RayRows::NONE;
            load(object.rows, &mut rays);
            for lane in lanes - group_walk.candidates().found {
                self.walked.extend(cells[lane].map(|cell| WalkedRay {
                    cell,
                    structure: rays.top_level[lane],
                    ray: rays.ray(lane),
                    time: 0.0,
                    hit: group_walk.hits.get(lane),
                }));
            }
        }
        let Some((observer, lane)) = self.observed(lanes) else {
            return;
        };
        let object = object.first;
        observer.observe(match group_walk.candidates().get(lane) {
            Some(hit) => Observation::QueryCandidate { object, hit },
            None => Observation::QueryOver {
                object,
                hit: group_walk.hits.get(lane),
            },
        });
    }

    fn observed(&self, lanes: LaneMask) -> Option<(&'a dyn Observer, usize)> {
        let &(observer, lane, _) = self.one.as_ref()?;
        lanes.contains(lane).then_some((observer, lane))
    }

    /// The queries of lanes have proceeded: they share the time, and those that are over are walked
    /// once more.
    #[cold]
    pub fn finish(self, walker: &mut Walker, limits: &Limits, lanes: LaneMask) {
        let (Some(Counted { counts, cells }), Some(started)) = (self.counted, self.started) else {
            return;
        };
        let time = started.elapsed();
        counts.add_time(time, lanes.count(), |add| add(&cells, lanes));
        // SAFETY: the memory is there until the dispatch is complete, and no walk goes on after it.
        let mut costs = unsafe { RayCosts::new(walker, &limits.live) };
        for walked in &self.walked {
            // SAFETY: structures stay until the dispatch is complete, as for the first walk.
            unsafe { counts.add_walk(walked, &mut costs) };
        }
    }
}
