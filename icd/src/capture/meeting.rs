//! Primitives that a captured ray met, in the order along the ray, each with its outcome: the
//! report of its line, joined with the shaders' decisions of the run.

#![forbid(unsafe_code)]

use std::cmp::Ordering;

use traversal::{Hit, Opacity, RayReport, Reason, ReportedPrimitive};

use super::path::{Asked, PathRay};
use crate::wave::observer::QueryDecision;

/// Primitives of one ray that are listed, at most, besides those that shaders decided on and the
/// hit.
const MAX_LISTED: usize = 64;

/// The outcome for a primitive on a ray's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It is the ray's hit.
    Committed,
    /// It was committed; a nearer hit took its place.
    Replaced,
    /// The any-hit shader, or the shader of the ray query, has ignored it.
    Ignored,
    /// No intersection that counts was reported.
    NotReported,
    /// The record's group has no intersection shader.
    NoIntersectionShader,
    /// The shader has not decided: the command was stopped, or the ray query was left.
    Undecided,
    /// A nearer hit was committed before traversal came here.
    BehindTheHit,
    /// The ray had ended before.
    NotReached,
    /// It is no candidate.
    Rejected(Reason),
}

impl Outcome {
    /// As in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Committed => "committed",
            Self::Replaced => "replaced",
            Self::Ignored => "ignored",
            Self::NotReported => "not reported",
            Self::NoIntersectionShader => "no intersection shader",
            Self::Undecided => "undecided",
            Self::BehindTheHit => "behind the hit",
            Self::NotReached | Self::Rejected(Reason::Candidate) => "not reached",
            Self::Rejected(Reason::BeforeStart) => "before t_min",
            Self::Rejected(Reason::BeyondEnd) => "beyond t_max",
            Self::Rejected(Reason::Masked) => "culled by mask",
            Self::Rejected(Reason::Skipped) => "skipped by flag",
            Self::Rejected(Reason::FrontCulled) => "culled as front facing",
            Self::Rejected(Reason::BackCulled) => "culled as back facing",
            Self::Rejected(Reason::OpaqueCulled) => "culled as opaque",
            Self::Rejected(Reason::NoOpaqueCulled) => "culled as not opaque",
            Self::Rejected(Reason::MicromapTransparent) => "transparent by micromap",
        }
    }
}

/// A primitive that a ray met.
#[derive(Debug)]
pub struct Meeting {
    pub hit: Hit,
    /// The instance's mask; unknown where the report has not found it.
    pub mask: Option<u8>,
    pub micromap: Option<Opacity>,
    pub outcome: Outcome,
    /// Its place in [`PathRay::asked`], in the order in which traversal stopped.
    pub asked: Option<usize>,
}

/// All that a ray met.
#[derive(Debug, Default)]
pub struct Meetings {
    pub listed: Vec<Meeting>,
    /// Primitives that are not listed.
    pub more: u64,
    /// The report was cut: there is more than is counted.
    pub is_cut: bool,
}

fn is_same(a: &Hit, b: &Hit) -> bool {
    let key = |hit: &Hit| (hit.instance_index, hit.geometry_index, hit.primitive_index);
    key(a) == key(b)
}

/// Joins a report and what happened.
pub fn meetings(ray: &PathRay, report: RayReport) -> Meetings {
    let found = ray.settled.as_ref().and_then(|settled| settled.hit);
    let is_hit = |hit: &Hit| found.is_some_and(|found| is_same(&found, hit));
    let asked_of = |hit: &Hit| ray.asked.iter().position(|asked| is_same(&asked.hit, hit));
    let mut all: Vec<Meeting> = Vec::new();
    for ReportedPrimitive {
        hit,
        mask,
        micromap,
        reason,
    } in report.met
    {
        let asked = asked_of(&hit);
        all.push(Meeting {
            hit,
            mask: Some(mask),
            micromap,
            outcome: match (asked, reason) {
                _ if is_hit(&hit) => Outcome::Committed,
                (Some(index), _) => of_decision(&ray.asked[index]),
                (None, Reason::Candidate) => of_silence(&hit, found.as_ref()),
                (None, reason) => Outcome::Rejected(reason),
            },
            asked,
        });
    }
    // At edges, and where the report was cut, traversal may have found others.
    let others = (ray.asked.iter())
        .map(|asked| asked.hit)
        .chain(found.filter(|_| ray.is_traversed()));
    for hit in others {
        if all.iter().any(|meeting| is_same(&meeting.hit, &hit)) {
            continue;
        }
        let asked = asked_of(&hit);
        all.push(Meeting {
            hit,
            mask: None,
            micromap: None,
            outcome: match asked {
                _ if is_hit(&hit) => Outcome::Committed,
                Some(index) => of_decision(&ray.asked[index]),
                None => Outcome::NotReached,
            },
            asked,
        });
    }
    all.sort_by(by_distance);
    let count = all.len();
    let mut place = 0;
    all.retain(|meeting| {
        place += 1;
        place <= MAX_LISTED || meeting.asked.is_some() || meeting.outcome == Outcome::Committed
    });
    Meetings {
        more: (count - all.len()) as u64 + ray.dropped,
        listed: all,
        is_cut: report.is_cut,
    }
}

/// Boxes, then the others by distance.
fn by_distance(a: &Meeting, b: &Meeting) -> Ordering {
    let (a, b) = (&a.hit, &b.hit);
    (a.is_built_in().cmp(&b.is_built_in())).then(a.t.total_cmp(&b.t))
}

/// The outcome of a candidate at which traversal stopped, and which is not the hit.
fn of_decision(asked: &Asked) -> Outcome {
    let is_box = !asked.hit.is_built_in();
    match asked.decision {
        Some(QueryDecision::Confirmed | QueryDecision::Generated(_, true)) => {
            return Outcome::Replaced;
        }
        Some(QueryDecision::Generated(_, false)) => return Outcome::NotReported,
        Some(QueryDecision::Ignored) if is_box => return Outcome::NotReported,
        Some(QueryDecision::Ignored) => return Outcome::Ignored,
        None if asked.record.is_none() => return Outcome::Undecided,
        None => {}
    }
    match (&asked.ran, is_box) {
        (None, true) if !asked.has_shader => Outcome::NoIntersectionShader,
        (None, false) if !asked.has_shader => Outcome::Replaced,
        (None, _) => Outcome::Undecided,
        (Some(_), true) if asked.reports.iter().any(|report| report.is_committed()) => {
            Outcome::Replaced
        }
        (Some(ran), _) if ran.after.is_none() => Outcome::Undecided,
        (Some(_), true) => Outcome::NotReported,
        (Some(ran), false) if ran.accepts() => Outcome::Replaced,
        (Some(_), false) => Outcome::Ignored,
    }
}

/// The outcome of a candidate at which traversal did not stop, and which is not the hit.
fn of_silence(hit: &Hit, found: Option<&Hit>) -> Outcome {
    match found {
        Some(found) if hit.is_built_in() && hit.t >= found.t => Outcome::BehindTheHit,
        _ => Outcome::NotReached,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::path::{Ran, Settled, start_of};
    use crate::wave::observer::Instruction;

    fn hit(primitive_index: u32, t: f32) -> Hit {
        Hit {
            t,
            primitive_index,
            triangle: true,
            ..Hit::default()
        }
    }

    fn ray(asked: Vec<Asked>, hit: Option<Hit>) -> PathRay {
        PathRay {
            start: start_of(Instruction::TraceRay),
            parent: None,
            depth: 1,
            asked,
            dropped: 0,
            settled: Some(Settled {
                hit,
                attributes: Vec::new(),
                record: Some(0),
            }),
            shader: None,
        }
    }

    fn asked(hit: Hit, decision: Option<u32>) -> Asked {
        Asked {
            hit,
            record: Some(0),
            has_shader: decision.is_some(),
            ran: decision.map(|decision| Ran {
                program: 0,
                record: 0,
                before: Vec::new(),
                after: Some(Vec::new()),
                decision,
            }),
            reports: Vec::new(),
            decision: None,
        }
    }

    fn met(hit: Hit, reason: Reason) -> ReportedPrimitive {
        ReportedPrimitive {
            hit,
            mask: 0xFF,
            micromap: None,
            reason,
        }
    }

    #[test]
    fn each_primitive_has_its_outcome() {
        let found = hit(3, 3.0);
        let ray = ray(
            vec![
                asked(hit(4, 4.0), Some(0)),
                asked(hit(2, 2.0), Some(1)),
                asked(found, None),
                // The report has another triangle of the same edge.
                asked(hit(7, 2.5), Some(1)),
            ],
            Some(found),
        );
        let report = RayReport {
            met: vec![
                met(hit(1, 1.0), Reason::BackCulled),
                met(hit(2, 2.0), Reason::Candidate),
                met(found, Reason::Candidate),
                met(hit(4, 4.0), Reason::Candidate),
                met(hit(5, 5.0), Reason::Candidate),
                met(hit(0, 0.5), Reason::Candidate),
            ],
            is_cut: false,
        };
        let all = meetings(&ray, report);
        let outcomes: Vec<_> = (all.listed.iter())
            .map(|it| (it.hit.primitive_index, it.outcome, it.asked))
            .collect();
        assert_eq!(
            outcomes,
            [
                (0, Outcome::NotReached, None),
                (1, Outcome::Rejected(Reason::BackCulled), None),
                (2, Outcome::Ignored, Some(1)),
                (7, Outcome::Ignored, Some(3)),
                (3, Outcome::Committed, Some(2)),
                (4, Outcome::Replaced, Some(0)),
                (5, Outcome::BehindTheHit, None),
            ]
        );
        assert_eq!(all.more, 0);
    }

    #[test]
    fn long_lists_keep_the_hit() {
        let found = hit(1000, 1000.0);
        let list = (0..=1000).map(|i| met(hit(i, i as f32), Reason::BeforeStart));
        let report = RayReport {
            met: list.collect(),
            is_cut: true,
        };
        let all = meetings(&ray(Vec::new(), Some(found)), report);
        assert_eq!(all.listed.len(), MAX_LISTED + 1);
        assert_eq!(all.more as usize, 1000 - MAX_LISTED);
        let last = all.listed.last().map(|it| it.outcome);
        assert_eq!((last, all.is_cut), (Some(Outcome::Committed), true));
    }
}
