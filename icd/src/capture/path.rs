//! The path of one invocation: its rays, what they met, and the shaders that they called, made of
//! the events of an [`Observer`](crate::wave::observer::Observer).

#![forbid(unsafe_code)]

use std::collections::HashMap;

use spirv_jit::program::Stage;
use traversal::Hit;

use crate::wave::binding_table::ProgramIndex;
use crate::wave::observer::{
    Instruction, Observation, QueryDecision, RayStart, ReportVerdict, Reported,
};

/// Rays of one command that are kept, at most; likewise calls of callables.
pub const MAX_RAYS: usize = 1024;
/// Candidates of one ray that are kept, at most.
const MAX_ASKED: usize = 256;
/// Reports on one candidate that are kept, at most.
const MAX_REPORTS: usize = 16;

/// A shader that ran.
#[derive(Debug)]
pub struct Ran {
    pub program: ProgramIndex,
    /// Address of its record.
    pub record: u64,
    /// Words of the payload or callable data.
    pub before: Vec<u32>,
    /// Unknown of one that did not end.
    pub after: Option<Vec<u32>>,
    /// Of any-hit shaders: 0 accepts, 1 ignores, others accept and end the ray.
    pub decision: u32,
}

/// A hit that an intersection shader reported.
#[derive(Debug)]
pub struct ReportedHit {
    pub reported: Reported,
    /// The any-hit shader.
    pub ran: Option<Ran>,
}

impl ReportedHit {
    /// Whether it counted.
    pub fn is_committed(&self) -> bool {
        match self.reported.verdict {
            ReportVerdict::OutsideInterval => false,
            ReportVerdict::Committed => true,
            ReportVerdict::Asked => self.ran.as_ref().is_some_and(|ran| ran.accepts()),
        }
    }
}

impl Ran {
    /// An any-hit shader that has accepted its candidate.
    pub fn accepts(&self) -> bool {
        self.after.is_some() && self.decision != 1
    }
}

/// A candidate at which traversal stopped.
#[derive(Debug)]
pub struct Asked {
    pub hit: Hit,
    /// None of ray queries.
    pub record: Option<u32>,
    /// The record's group has a shader that decides.
    pub has_shader: bool,
    pub ran: Option<Ran>,
    pub reports: Vec<ReportedHit>,
    pub decision: Option<QueryDecision>,
}

impl Asked {
    fn new(hit: Hit, record: Option<u32>, has_shader: bool) -> Self {
        Self {
            hit,
            record,
            has_shader,
            ran: None,
            reports: Vec::new(),
            decision: None,
        }
    }
}

/// The end of a ray's traversal.
#[derive(Debug)]
pub struct Settled {
    pub hit: Option<Hit>,
    /// Words, of hits that an intersection shader reported.
    pub attributes: Vec<u32>,
    /// None of ray queries.
    pub record: Option<u32>,
}

/// A ray.
#[derive(Debug)]
pub struct PathRay {
    pub start: RayStart,
    /// The ray whose closest-hit or miss shader traced it.
    pub parent: Option<usize>,
    /// 1 for rays of the invocation itself.
    pub depth: usize,
    /// In the order in which traversal stopped at them.
    pub asked: Vec<Asked>,
    /// Candidates past those that are kept.
    pub dropped: u64,
    pub settled: Option<Settled>,
    /// The closest-hit or miss shader.
    pub shader: Option<Ran>,
}

impl PathRay {
    /// Whether traversal was done for it.
    pub fn is_traversed(&self) -> bool {
        self.start.instruction != Instruction::HitObjectExecute
    }
}

/// A call of a callable.
#[derive(Debug)]
pub struct Call {
    pub index: u32,
    /// The ray whose shader called; none: the invocation itself, or a callable of its own.
    pub by: Option<usize>,
    pub ran: Option<Ran>,
}

/// A ray or a shader that the invocation waits for.
#[derive(Clone, Copy, Debug)]
enum Frame {
    /// A ray; none that is not kept.
    Ray(Option<usize>),
    /// The shader that decides on the last candidate of the ray.
    Decider,
    /// The any-hit shader of the last report on that.
    OfReport,
    /// The last shader of the ray.
    Last(Option<usize>),
    /// A callable.
    Callable(Option<usize>),
}

/// The path of an invocation so far.
#[derive(Debug, Default)]
pub struct Path {
    pub rays: Vec<PathRay>,
    pub calls: Vec<Call>,
    /// Rays and calls past those that are kept.
    pub dropped_rays: u64,
    pub dropped_calls: u64,
    stack: Vec<Frame>,
    /// The call whose shader begins next.
    called: Option<usize>,
    /// Rays of queries, by their objects.
    queries: HashMap<u32, usize>,
}

impl Path {
    /// Adds an event; `stage` tells the stages of programs.
    pub fn add(&mut self, event: Observation, stage: impl Fn(ProgramIndex) -> Option<Stage>) {
        match event {
            Observation::Ray(start) => self.begin_ray(*start),
            Observation::Candidate {
                hit,
                record,
                shader,
            } => self.ask(Asked::new(hit, Some(record), shader.is_some())),
            Observation::Report(reported) => {
                if let Some(asked) = self.last_asked()
                    && asked.reports.len() < MAX_REPORTS
                {
                    let (reported, ran) = (*reported, None);
                    asked.reports.push(ReportedHit { reported, ran });
                }
            }
            Observation::Settled {
                hit,
                attributes,
                record,
                shader,
            } => {
                if let Some(ray) = self.ray() {
                    ray.settled = Some(Settled {
                        hit,
                        attributes,
                        record: Some(record),
                    });
                }
                if shader.is_none() {
                    self.leave_ray();
                }
            }
            Observation::Callable { index, .. } => self.begin_call(index),
            Observation::Begin {
                program,
                record,
                data,
            } => self.begin_shader(
                stage(program),
                Ran {
                    program,
                    record,
                    before: data,
                    after: None,
                    decision: 0,
                },
            ),
            Observation::End { data, decision } => self.end_shader(data, decision),
            Observation::QueryCandidate { object, hit } => {
                if let Some(ray) = self.query(object) {
                    keep(ray, Asked::new(hit, None, false));
                }
            }
            Observation::QueryDecision { object, decision } => {
                let asked = self.query(object).and_then(|ray| ray.asked.last_mut());
                if let Some(asked) = asked {
                    asked.decision = Some(decision);
                }
            }
            Observation::QueryOver { object, hit } => {
                if let Some(ray) = self.query(object) {
                    ray.settled = Some(Settled {
                        hit,
                        attributes: Vec::new(),
                        record: None,
                    });
                }
            }
        }
    }

    fn begin_call(&mut self, index: u32) {
        self.called = None;
        let by = self.innermost();
        match self.calls.len() < MAX_RAYS {
            true => {
                self.called = Some(self.calls.len());
                let ran = None;
                self.calls.push(Call { index, by, ran });
            }
            false => self.dropped_calls += 1,
        }
    }

    fn begin_ray(&mut self, start: RayStart) {
        let query = match start.instruction {
            Instruction::RayQuery(object) => Some(object),
            _ => None,
        };
        let index = (self.rays.len() < MAX_RAYS).then_some(self.rays.len());
        match index {
            Some(_) => {
                let is_ray = |frame: &&Frame| matches!(frame, Frame::Ray(_));
                self.rays.push(PathRay {
                    start,
                    parent: self.innermost(),
                    depth: self.stack.iter().filter(is_ray).count() + 1,
                    asked: Vec::new(),
                    dropped: 0,
                    settled: None,
                    shader: None,
                });
            }
            None => self.dropped_rays += 1,
        }
        match (query, index) {
            (Some(object), Some(index)) => {
                self.queries.insert(object, index);
            }
            (Some(object), None) => {
                self.queries.remove(&object);
            }
            (None, index) => self.stack.push(Frame::Ray(index)),
        }
    }

    /// The ray whose shaders run.
    fn innermost(&self) -> Option<usize> {
        (self.stack.iter().rev()).find_map(|frame| match frame {
            Frame::Ray(index) => Some(*index),
            _ => None,
        })?
    }

    fn ray(&mut self) -> Option<&mut PathRay> {
        let index = self.innermost()?;
        self.rays.get_mut(index)
    }

    fn query(&mut self, object: u32) -> Option<&mut PathRay> {
        let index = *self.queries.get(&object)?;
        self.rays.get_mut(index)
    }

    fn ask(&mut self, asked: Asked) {
        if let Some(ray) = self.ray() {
            keep(ray, asked);
        }
    }

    /// The candidate on which shaders decide; none that is not kept.
    fn last_asked(&mut self) -> Option<&mut Asked> {
        let ray = self.ray()?;
        match ray.dropped {
            0 => ray.asked.last_mut(),
            _ => None,
        }
    }

    fn leave_ray(&mut self) {
        if let Some(Frame::Ray(_)) = self.stack.last() {
            self.stack.pop();
        }
    }

    fn begin_shader(&mut self, stage: Option<Stage>, ran: Ran) {
        let ray = self.innermost();
        let frame = match (stage, self.stack.last()) {
            (Some(Stage::AnyHit), Some(Frame::Decider)) => {
                if let Some(report) = self.last_asked().and_then(|asked| asked.reports.last_mut()) {
                    report.ran = Some(ran);
                }
                Frame::OfReport
            }
            (Some(Stage::AnyHit | Stage::Intersection), _) => {
                if let Some(asked) = self.last_asked() {
                    asked.ran = Some(ran);
                }
                Frame::Decider
            }
            (Some(Stage::Callable), _) => {
                let called = self.called.take();
                if let Some(call) = called.and_then(|index| self.calls.get_mut(index)) {
                    call.ran = Some(ran);
                }
                Frame::Callable(called)
            }
            _ => {
                if let Some(ray) = self.ray() {
                    ray.shader = Some(ran);
                }
                Frame::Last(ray)
            }
        };
        self.stack.push(frame);
    }

    fn end_shader(&mut self, data: Vec<u32>, decision: u32) {
        let Some(frame) = self.stack.pop() else {
            return;
        };
        let ran = match frame {
            Frame::Ray(_) => {
                self.stack.push(frame);
                None
            }
            Frame::Decider => self.last_asked().and_then(|asked| asked.ran.as_mut()),
            Frame::OfReport => (self.last_asked())
                .and_then(|asked| asked.reports.last_mut())
                .and_then(|report| report.ran.as_mut()),
            Frame::Last(ray) => {
                self.leave_ray();
                let ray = ray.and_then(|index| self.rays.get_mut(index));
                ray.and_then(|ray| ray.shader.as_mut())
            }
            Frame::Callable(call) => {
                let call = call.and_then(|index| self.calls.get_mut(index));
                call.and_then(|call| call.ran.as_mut())
            }
        };
        if let Some(ran) = ran {
            ran.after = Some(data);
            ran.decision = decision;
        }
    }
}

fn keep(ray: &mut PathRay, asked: Asked) {
    match ray.asked.len() < MAX_ASKED {
        true => ray.asked.push(asked),
        false => ray.dropped += 1,
    }
}

/// The start of a ray, for tests.
#[cfg(test)]
pub fn start_of(instruction: Instruction) -> RayStart {
    RayStart {
        instruction,
        place: spirv_jit::origin::CodeLocation {
            stage: Stage::RayGeneration,
            entry_point: None,
            name: None,
            pipeline: None,
            line: None,
        },
        ray: traversal::Ray::default(),
        pipeline_flags: 0,
        time: 0.0,
        structure: 0,
        operands: None,
        payload: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGES: [Stage; 6] = [
        Stage::RayGeneration,
        Stage::AnyHit,
        Stage::Intersection,
        Stage::ClosestHit,
        Stage::Miss,
        Stage::Callable,
    ];

    fn path(events: impl IntoIterator<Item = Observation>) -> Path {
        let mut path = Path::default();
        for event in events {
            path.add(event, |program| STAGES.get(program as usize).copied());
        }
        path
    }

    fn ray(instruction: Instruction) -> Observation {
        Observation::Ray(Box::new(start_of(instruction)))
    }

    fn begin(program: u32) -> Observation {
        Observation::Begin {
            program,
            record: 0,
            data: vec![program],
        }
    }

    fn end(decision: u32) -> Observation {
        let data = vec![77];
        Observation::End { data, decision }
    }

    fn settled(shader: Option<u32>) -> Observation {
        Observation::Settled {
            hit: shader.map(|_| Hit::default()),
            attributes: Vec::new(),
            record: 5,
            shader,
        }
    }

    fn candidate(shader: Option<u32>) -> Observation {
        Observation::Candidate {
            hit: Hit::default(),
            record: 2,
            shader,
        }
    }

    #[test]
    fn rays_of_hit_shaders_have_their_parents() {
        let trace = || ray(Instruction::TraceRay);
        let path = path([
            trace(),
            candidate(Some(1)),
            begin(1),
            end(1),
            candidate(None),
            settled(Some(3)),
            begin(3),
            trace(),
            settled(Some(4)),
            begin(4),
            end(0),
            Observation::Callable {
                index: 9,
                shader: Some(5),
            },
            begin(5),
            end(0),
            end(0),
            trace(),
            settled(None),
            trace(),
        ]);
        let places: Vec<_> = (path.rays.iter())
            .map(|ray| (ray.parent, ray.depth))
            .collect();
        assert_eq!(places, [(None, 1), (Some(0), 2), (None, 1), (None, 1)]);
        let first = &path.rays[0];
        let asked: Vec<_> = (first.asked.iter())
            .map(|asked| {
                (
                    asked.has_shader,
                    asked.ran.as_ref().map(|ran| ran.accepts()),
                )
            })
            .collect();
        assert_eq!(asked, [(true, Some(false)), (false, None)]);
        let shader = first.shader.as_ref().expect("a closest-hit shader");
        assert_eq!(
            (shader.before.clone(), shader.after.clone()),
            (vec![3], Some(vec![77]))
        );
        assert!(path.rays[3].settled.is_none(), "it is still on its way");
        let [call] = &path.calls[..] else {
            panic!("{path:?}");
        };
        assert_eq!((call.index, call.by), (9, Some(0)));
        assert!(call.ran.is_some());
    }

    #[test]
    fn reports_have_their_any_hit_shaders() {
        let report = |verdict| {
            Observation::Report(Box::new(Reported {
                t: 1.0,
                hit_kind: 3,
                attributes: Vec::new(),
                verdict,
            }))
        };
        let path = path([
            ray(Instruction::TraceRay),
            candidate(Some(2)),
            begin(2),
            report(ReportVerdict::OutsideInterval),
            report(ReportVerdict::Asked),
            begin(1),
            end(0),
            report(ReportVerdict::Asked),
            begin(1),
            end(1),
            end(0),
            settled(None),
        ]);
        let reports = &path.rays[0].asked[0].reports;
        let committed: Vec<bool> = reports.iter().map(ReportedHit::is_committed).collect();
        assert_eq!(committed, [false, true, false]);
        assert!(
            path.rays[0].asked[0]
                .ran
                .as_ref()
                .is_some_and(|ran| ran.after.is_some())
        );
    }

    #[test]
    fn past_the_limit_rays_are_counted_and_their_shaders_left_out() {
        let one = || {
            [
                ray(Instruction::TraceRay),
                settled(Some(3)),
                begin(3),
                ray(Instruction::RayQuery(4)),
                Observation::QueryOver {
                    object: 4,
                    hit: None,
                },
                end(0),
            ]
        };
        let path = path((0..MAX_RAYS).flat_map(|_| one()));
        assert_eq!(path.rays.len(), MAX_RAYS);
        assert_eq!(path.dropped_rays as usize, MAX_RAYS);
        assert!(path.stack.is_empty());
        let queries = path.rays.iter().filter(|ray| ray.parent.is_some());
        assert!(
            queries
                .clone()
                .all(|ray| ray.settled.is_some() && ray.shader.is_none())
        );
        assert_eq!(queries.count(), MAX_RAYS / 2);
    }

    #[test]
    fn events_out_of_order_do_no_harm() {
        let path = path([
            end(0),
            settled(None),
            begin(5),
            candidate(None),
            end(3),
            Observation::QueryCandidate {
                object: 1,
                hit: Hit::default(),
            },
            begin(3),
            end(0),
        ]);
        assert!(path.rays.is_empty() && path.stack.is_empty());
    }
}
