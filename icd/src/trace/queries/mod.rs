//! Ray queries: walks whose driver is the shader. A wave that proceeds suspends, its lanes' walks are advanced here, and it goes on at once;
//! no lane moves.
//!
//! The shader's side of a query is its object in per-lane memory (`spirv_jit::query`). This side, the walk, is kept only while it is
//! suspended at a candidate: opaque triangles never are.

mod arena;
mod describe;

use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::AlignedRow;
use spirv_jit::query::{row, state};
use traversal::{Event, HitRows, RayRows, Verdict, Walk, Walker, ray_flags};

use super::lanes::lanes_of;
use crate::wave::{Limits, Stopped};
use arena::Arena;
pub use arena::Owned;
use describe::{describe_candidates, describe_committed, describe_rows, shows_committed};

/// Fuel of a walk between two looks at the limits.
const FUEL: u64 = 1 << 16;

/// The ray queries of a worker.
pub struct Queries {
    arena: Arena,
    /// The rays that are being started, and their hits.
    rays: RayRows,
    hits: HitRows,
}

impl Default for Queries {
    fn default() -> Self {
        Self {
            arena: Arena::default(),
            rays: RayRows::NONE,
            hits: HitRows::default(),
        }
    }
}

/// What queries are answered with.
struct Context<'a> {
    walker: &'a mut Walker,
    program: &'a Program,
    limits: &'a Limits,
    owned: &'a mut Owned,
}

impl Queries {
    /// Answers a `RayQueryProceed` at which a subgroup stands. Whatever memory the shader has spoilt, the answer is an answer.
    ///
    /// # Errors
    /// A limit was reached.
    pub fn proceed(
        &mut self,
        walker: &mut Walker,
        program: &Program,
        rows: &mut [AlignedRow],
        owned: &mut Owned,
        limits: &Limits,
    ) -> Result<(), Stopped> {
        // SAFETY: the memory is there until the dispatch is complete, and no walk goes on after it.
        unsafe { walker.set_live(&limits.live) };
        let io = program.layout().io;
        let mask = program.event_mask(rows);
        let first = rows[io].0;
        let private = program.private_rows(rows);
        let mut context = Context {
            walker,
            program,
            limits,
            owned,
        };
        // Lanes that stand at a candidate.
        let (mut rest, mut stand) = (mask, 0);
        while rest != 0 {
            let place = first[rest.trailing_zeros() as usize];
            let lanes = lanes_of(rest)
                .filter(|&lane| first[lane] == place)
                .fold(0, |lanes, lane| lanes | 1 << lane);
            rest &= !lanes;
            let size = row::WORDS + program.query_words().len();
            if let Some(object) = private.get_mut(place as usize..place as usize + size) {
                stand |= self.proceed_together(&mut context, object, lanes)?;
            }
        }
        for lane in lanes_of(mask) {
            rows[io].0[lane] = u32::from(stand >> lane & 1 != 0);
        }
        Ok(())
    }

    /// The queries of lanes that lie in the same rows; returns which of them stand at a candidate now.
    fn proceed_together(
        &mut self,
        context: &mut Context<'_>,
        object: &mut [AlignedRow],
        lanes: u16,
    ) -> Result<u16, Stopped> {
        let mut ready = 0;
        for (lane, &state) in object[row::STATE].0.iter().enumerate() {
            ready |= u16::from(state == state::READY) << lane;
        }
        ready &= lanes;
        let mut stand = 0;
        if ready != 0 {
            stand = self.start(context, object, ready)?;
        }
        if lanes & !ready != 0 {
            stand |= self.advance(context, object, lanes & !ready)?;
        }
        Ok(stand)
    }

    /// Begins the walks of queries; returns which of them stand at a candidate.
    fn start(
        &mut self,
        context: &mut Context<'_>,
        object: &mut [AlignedRow],
        lanes: u16,
    ) -> Result<u16, Stopped> {
        for lane in lanes_of(lanes) {
            let handle = std::mem::take(&mut object[row::HANDLE].0[lane]);
            self.arena.remove(handle, context.owned);
            object[row::STATE].0[lane] = state::OVER;
        }
        self.load(object, lanes);
        if context.limits.queried.is_some() {
            self.check(context, object, lanes);
        }
        let Self { arena, rays, hits } = self;
        let Context { walker, owned, .. } = context;
        let mut events: SmallVec<[(usize, u32, Event); SUBGROUP_SIZE]> = SmallVec::new();
        let mut result = Ok(());
        let mut keep = |lane, walk: &mut Walk, event| match arena.add(lane, owned) {
            Ok(handle) => {
                if let Some(suspended) = arena.find(handle, owned) {
                    std::mem::swap(&mut suspended.walk, walk);
                }
                events.push((lane, handle, event));
            }
            Err(stopped) => result = Err(stopped),
        };
        let words = context.program.query_words();
        // Together, rays that their first hit ends may find another one: nothing is to show which.
        let in_turn = shows_committed(words) && ends_with_first_hit(rays, lanes);
        // SAFETY: the memory where the walker looks is there until the dispatch is complete.
        unsafe {
            match in_turn {
                true => walker.trace_in_turn(rays, lanes, hits, &mut { FUEL }, &mut keep),
                false => walker.trace_rows(rays, lanes, hits, &mut { FUEL }, &mut keep),
            }
        }
        result?;
        let suspended = (events.iter()).fold(0, |suspended, event| suspended | 1 << event.0);
        let done = lanes & !suspended;
        describe_rows(rays, hits, done, object, words, context.limits);
        for &(lane, handle, _) in &events {
            object[row::HANDLE].0[lane] = handle;
        }
        let events: SmallVec<[_; SUBGROUP_SIZE]> = (events.iter())
            .map(|&(lane, _, event)| (lane, event, true))
            .collect();
        self.settle(context, object, &events)
    }

    /// Reads the rays of queries.
    fn load(&mut self, object: &[AlignedRow], lanes: u16) {
        let rays = &mut self.rays;
        let floats = |row: usize| object[row].0.map(f32::from_bits);
        for axis in 0..3 {
            rays.origin[axis] = floats(row::ORIGIN + axis);
            rays.direction[axis] = floats(row::DIRECTION + axis);
        }
        rays.t_min = floats(row::T_MIN);
        rays.t_max = floats(row::T_MAX);
        rays.flags = object[row::FLAGS].0;
        rays.cull_mask = object[row::CULL_MASK].0;
        for lane in lanes_of(lanes) {
            rays.top_level[lane] = structure_in(object, lane);
        }
    }

    #[cold]
    fn check(&self, context: &Context<'_>, object: &[AlignedRow], lanes: u16) {
        let Some(queried) = &context.limits.queried else {
            return;
        };
        for lane in lanes_of(lanes) {
            let structure = context.limits.structure(self.rays.top_level[lane]);
            let kind = structure.map(|structure| structure.kind());
            let named = structure_in(object, lane);
            queried.ray(context.program.number(), &self.rays.ray(lane), named, kind);
        }
    }

    /// Goes on with the walks of queries that the shader has decided about; returns which of them stand at a candidate now.
    fn advance(
        &mut self,
        context: &mut Context<'_>,
        object: &mut [AlignedRow],
        lanes: u16,
    ) -> Result<u16, Stopped> {
        let mut events: SmallVec<[(usize, Event, bool); SUBGROUP_SIZE]> = SmallVec::new();
        // SAFETY: as for their start.
        let mut list = unsafe { context.walker.list() };
        for lane in lanes_of(lanes) {
            let mut query = Object { rows: object, lane };
            let (stands, handle) = (query.word(row::STATE), query.word(row::HANDLE));
            if !matches!(
                stands,
                state::CANDIDATE | state::CONFIRMED | state::GENERATED
            ) {
                self.arena.remove(handle, context.owned);
                query.set(row::HANDLE, 0);
                continue;
            }
            let Some(suspended) = self.arena.find(handle, context.owned) else {
                query.set(row::STATE, state::OVER);
                continue;
            };
            let walk = &mut suspended.walk;
            let before = walk.committed().copied();
            let verdict = decide(walk, &query, stands);
            let event = list.resume(walk, verdict, &mut { FUEL });
            events.push((lane, event, walk.committed() != before.as_ref()));
        }
        self.settle(context, object, &events)
    }

    /// Puts down what has become of the walks of queries: lanes, the events where they stopped, and whether there may be another
    /// committed hit than the shader knows. Goes on where only fuel was missing. Returns which of them stand at a candidate.
    fn settle(
        &mut self,
        context: &mut Context<'_>,
        object: &mut [AlignedRow],
        events: &[(usize, Event, bool)],
    ) -> Result<u16, Stopped> {
        let words = context.program.query_words();
        let mut stand = 0;
        for &(lane, mut event, mut commits) in events {
            let mut query = Object { rows: object, lane };
            let handle = query.word(row::HANDLE);
            let Some(suspended) = self.arena.find(handle, context.owned) else {
                query.set(row::STATE, state::OVER);
                continue;
            };
            let walk = &mut suspended.walk;
            while event == Event::OutOfFuel {
                context.limits.check()?;
                event = walk.resume(context.walker, Verdict::Continue, &mut { FUEL });
                commits = true;
            }
            if commits {
                describe_committed(walk, lane, query.rows, words, context.limits);
            }
            if event != Event::Done {
                query.set(row::STATE, state::CANDIDATE);
                stand |= 1 << lane;
                continue;
            }
            self.arena.remove(handle, context.owned);
            query.set(row::HANDLE, 0);
            query.set(row::STATE, state::OVER);
        }
        let walks: SmallVec<[(usize, &Walk); SUBGROUP_SIZE]> = lanes_of(stand)
            .filter_map(|lane| Some((lane, self.arena.walk(object[row::HANDLE].0[lane])?)))
            .collect();
        describe_candidates(&walks, object, words, context.limits);
        Ok(stand)
    }

    /// Forgets the walks that an owner has left.
    #[inline]
    pub fn release(&mut self, owned: &mut Owned) {
        self.arena.release(owned);
    }

    /// See [`Arena::move_lane`].
    pub fn move_lane(&mut self, from: (&mut Owned, usize), to: (&mut Owned, usize)) {
        self.arena.move_lane(from, to);
    }

    /// Forgets all walks; their owners are cleared before they are used again.
    pub fn clear(&mut self) {
        self.arena.clear();
    }
}

/// Whether the first hit of one of some rays ends it.
fn ends_with_first_hit(rays: &RayRows, lanes: u16) -> bool {
    lanes_of(lanes).any(|lane| rays.flags[lane] & ray_flags::TERMINATE_ON_FIRST_HIT != 0)
}

/// What the shader has decided about the candidate; nonsense counts as nothing.
fn decide(walk: &mut Walk, query: &Object<'_>, stands: u32) -> Verdict {
    let candidate = *walk.candidate();
    match stands {
        state::CONFIRMED if candidate.is_built_in() => Verdict::Accept,
        state::GENERATED if !candidate.is_built_in() => {
            let t = f32::from_bits(query.word(row::GENERATED_T));
            if walk.t_min() <= t && t <= walk.t_max() {
                walk.commit_procedural(t, 0);
            }
            Verdict::Continue
        }
        _ => Verdict::Continue,
    }
}

/// The object of a query in one lane.
struct Object<'a> {
    rows: &'a mut [AlignedRow],
    lane: usize,
}

impl Object<'_> {
    fn word(&self, row: usize) -> u32 {
        self.rows[row].0[self.lane]
    }

    fn set(&mut self, row: usize, word: u32) {
        self.rows[row].0[self.lane] = word;
    }
}

/// The address that a lane names for its top level.
fn structure_in(object: &[AlignedRow], lane: usize) -> u64 {
    let word = |row: usize| u64::from(object[row].0[lane]);
    word(row::STRUCTURE) | word(row::STRUCTURE + 1) << 32
}
