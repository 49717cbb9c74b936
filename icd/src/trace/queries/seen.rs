//! An observer's view of one lane's ray queries. Nothing here runs without an observer.

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::origin::CodeLocation;
use spirv_jit::query::{row, state};
use traversal::{Flight, RayRows};

use super::{Object, load};
use crate::wave::observer::{Instruction, Observation, Observer, QueryDecision, RayStart};

/// The lane of a subgroup that an observer sees.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    pub observer: &'a dyn Observer,
    pub lane: usize,
}

impl Seen<'_> {
    /// A query's ray starts.
    #[cold]
    pub(super) fn start(&self, place: &CodeLocation, object: &Object<'_>, lanes: LaneMask) {
        if !lanes.contains(self.lane) {
            return;
        }
        let mut rays = RayRows::NONE;
        load(object.rows, &mut rays);
        self.observer.observe(Observation::Ray(Box::new(RayStart {
            instruction: Instruction::RayQuery(object.first),
            place: place.clone(),
            ray: rays.ray(self.lane),
            pipeline_flags: 0,
            time: 0.0,
            structure: rays.top_level[self.lane],
            operands: None,
            payload: Vec::new(),
        })));
    }

    /// The shader has decided about a candidate, which is still there.
    #[cold]
    pub(super) fn decision(&self, object: &Object<'_>, flight: &Flight, lanes: LaneMask) {
        if !lanes.contains(self.lane) {
            return;
        }
        let is_built_in = flight.candidates().built_in().contains(self.lane);
        let decision = match object.rows[row::STATE].0[self.lane] {
            state::CONFIRMED if is_built_in => QueryDecision::Confirmed,
            state::GENERATED if !is_built_in => {
                let t = f32::from_bits(object.rows[row::GENERATED_T].0[self.lane]);
                let counts = flight.counts(LaneMask::of(self.lane), &[t; SUBGROUP_SIZE]);
                QueryDecision::Generated(t, !counts.is_empty())
            }
            _ => QueryDecision::Ignored,
        };
        let object = object.first;
        self.observer
            .observe(Observation::QueryDecision { object, decision });
    }

    /// The ray stands at a candidate, or has ended.
    #[cold]
    pub(super) fn settled(&self, object: &Object<'_>, flight: &Flight, lanes: LaneMask) {
        if !lanes.contains(self.lane) {
            return;
        }
        let object = object.first;
        self.observer
            .observe(match flight.candidates().get(self.lane) {
                Some(hit) => Observation::QueryCandidate { object, hit },
                None => Observation::QueryOver {
                    object,
                    hit: flight.hits.get(self.lane),
                },
            });
    }
}
