//! Ray queries: rays whose driver is the shader. A wave that proceeds suspends, its lanes' rays are
//! walked on here, and it goes on at once; no lane moves.
//!
//! The shader's side of a query is its object in per-lane memory (`spirv_jit::query`). This side,
//! the ray on its way, is kept only while it waits at a candidate: opaque triangles never are.

mod describe;
mod seen;
mod waiting;

use lanes::{LaneMask, Tier};
use spirv_jit::Program;
use spirv_jit::program::AlignedRow;
use spirv_jit::query::{row, state};
use traversal::{GroupWalk, GroupWalks, RayRows, Start, Walker, ray_flags};

use super::fault::Stopped;
use super::hit_facts::{Lanes, addresses};
use super::limits::Limits;
use super::observer::{Instruction, StartedRay};
use super::rows::put_word;
use describe::{describe_candidates, describe_committed, shows_committed};
use seen::View;
pub use seen::{Counted, Seen};
pub use waiting::Owned;
use waiting::Waiting;

/// The ray queries of a worker.
pub struct Queries {
    tier: Tier,
    waiting: Waiting,
}

impl Default for Queries {
    fn default() -> Self {
        Self {
            tier: Tier::best(),
            waiting: Waiting::default(),
        }
    }
}

/// The resources for answering queries.
struct Context<'a> {
    tier: Tier,
    walker: &'a mut Walker,
    program: &'a Program,
    limits: &'a Limits,
    owned: &'a mut Owned,
    view: Option<View<'a>>,
}

/// The queries of lanes whose query objects are in the same rows.
struct QueryRows<'a> {
    /// Its first row, among the private ones.
    first: u32,
    rows: &'a mut [AlignedRow],
}

impl Queries {
    /// Answers a `RayQueryProceed` at which a subgroup stands. Whatever memory the shader has
    /// spoilt, the answer is an answer.
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
        seen: Option<Seen<'_>>,
    ) -> Result<(), Stopped> {
        // SAFETY: the memory is there until the dispatch is complete, and no walk goes on after it.
        unsafe { walker.set_live(&limits.live) };
        let io = program.layout().io;
        let mask = program.event_mask(rows);
        let first = rows[io].0;
        let view = seen.and_then(|seen| View::new(seen, || program.place_of(rows)));
        let private = program.private_rows(rows);
        let tier = self.tier;
        let mut context = Context {
            tier,
            walker,
            program,
            limits,
            owned,
            view,
        };
        // Lanes that stand at a candidate.
        let (mut rest, mut stand) = (mask, LaneMask::NONE);
        while !rest.is_empty() {
            let place = first[rest.first()];
            let lanes = rest & LaneMask::holding(&first, place);
            rest -= lanes;
            let size = row::WORDS + program.query_words().len();
            if let Some(rows) = private.get_mut(place as usize..place as usize + size) {
                let mut object = QueryRows { first: place, rows };
                stand |= self.proceed_together(&mut context, &mut object, lanes)?;
            }
        }
        if let Some(view) = context.view {
            view.finish(context.walker, limits, mask);
        }
        put_word(tier, &mut rows[io].0, 0, mask);
        put_word(tier, &mut rows[io].0, 1, mask & stand);
        Ok(())
    }

    /// Advances the queries of lanes that lie in the same rows; returns the lanes that now stand at
    /// a candidate.
    fn proceed_together(
        &mut self,
        context: &mut Context<'_>,
        object: &mut QueryRows<'_>,
        lanes: LaneMask,
    ) -> Result<LaneMask, Stopped> {
        let ready = lanes & object.lanes_at(state::READY);
        let mut stand = LaneMask::NONE;
        if !ready.is_empty() {
            stand = self.start(context, object, ready)?;
        }
        if ready != lanes {
            stand |= self.advance(context, object, lanes - ready)?;
        }
        Ok(stand)
    }

    /// Starts the rays of queries; returns the lanes that stand at a candidate.
    fn start(
        &mut self,
        context: &mut Context<'_>,
        object: &mut QueryRows<'_>,
        lanes: LaneMask,
    ) -> Result<LaneMask, Stopped> {
        self.waiting.forget(object.first, lanes, context.owned);
        if context.limits.query_observer.is_some() {
            show_rays(context, object, lanes);
        }
        if let Some(view) = &context.view {
            view.start(object, lanes);
        }
        // Together, rays that their first hit ends may find another one: nothing is to show which.
        let ends =
            |lane: usize| object.rows[row::FLAGS].0[lane] & ray_flags::TERMINATE_ON_FIRST_HIT;
        let shows_first_hit = shows_committed(context.program.query_words())
            && lanes.iter().any(|lane| ends(lane) != 0);
        let group_walk = &mut *self.waiting.starting;
        let mut one = One {
            group_walk: &mut *group_walk,
            rows: object.rows,
            start: Start {
                lanes,
                are_alike: false,
                shows_first_hit,
                shows_order: true,
            },
            limits: context.limits,
        };
        // SAFETY: the memory where the walker looks is there until the dispatch is complete.
        unsafe { context.walker.trace(&[0], &[], &mut one)? };
        let stand = settle(
            (context.tier, context.program, context.limits),
            object,
            group_walk,
            lanes,
        );
        if let Some(view) = &mut context.view {
            view.settled(object, group_walk, lanes);
        }
        self.waiting.keep(object.first, context.owned)?;
        Ok(stand)
    }

    /// Resumes the rays of queries that the shader has decided about; returns the lanes that now
    /// stand at a candidate.
    fn advance(
        &mut self,
        context: &mut Context<'_>,
        object: &mut QueryRows<'_>,
        lanes: LaneMask,
    ) -> Result<LaneMask, Stopped> {
        let asked = [state::CANDIDATE, state::CONFIRMED, state::GENERATED];
        let asked = asked
            .iter()
            .fold(LaneMask::NONE, |asked, &at| asked | object.lanes_at(at));
        let going = lanes & asked;
        let Some(group_walk) = context.owned.find(object.first) else {
            object.set_state(context.tier, going, state::OVER);
            return Ok(LaneMask::NONE);
        };
        let waiting = group_walk.candidates().found;
        object.set_state(context.tier, going - waiting, state::OVER);
        let going = going & waiting;
        group_walk.hold(waiting - going);
        if let Some(view) = &context.view {
            view.decision(object, group_walk, going);
        }
        decide(group_walk, object, going);
        let mut one = One {
            group_walk: &mut *group_walk,
            rows: object.rows,
            start: Start {
                lanes: going,
                are_alike: false,
                shows_first_hit: true,
                shows_order: true,
            },
            limits: context.limits,
        };
        // SAFETY: as for their start.
        unsafe { context.walker.resume(&[0], &mut one)? };
        let stand = settle(
            (context.tier, context.program, context.limits),
            object,
            group_walk,
            going,
        );
        if let Some(view) = &mut context.view {
            view.settled(object, group_walk, going);
        }
        // Also of lanes that are over, which the shader may have ended.
        let over = lanes - stand;
        self.waiting.forget(object.first, over, context.owned);
        Ok(stand)
    }

    /// Forgets the rays of a subgroup's queries.
    #[inline]
    pub fn release(&mut self, owned: &mut Owned) {
        self.waiting.release(owned);
    }

    /// See [`Waiting::move_lane`].
    ///
    /// # Errors
    /// There is no memory for it.
    pub fn move_lane(
        &mut self,
        from: (&mut Owned, usize),
        to: (&mut Owned, usize),
    ) -> Result<(), Stopped> {
        self.waiting.move_lane(from, to)
    }

    /// Forgets all rays; their subgroups' are cleared before they are used again.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}

/// Records the results of queries' rays; returns the lanes that stand at a candidate.
fn settle(
    (tier, program, limits): (Tier, &Program, &Limits),
    object: &mut QueryRows<'_>,
    group_walk: &mut GroupWalk,
    lanes: LaneMask,
) -> LaneMask {
    let words = program.query_words();
    group_walk.update_hits();
    describe_committed(tier, &group_walk.hits, lanes, object.rows, words, limits);
    let stand = group_walk.candidates().found & lanes;
    describe_candidates(
        tier,
        group_walk.candidates(),
        stand,
        object.rows,
        words,
        limits,
    );
    object.set_state(tier, lanes, state::OVER);
    if !stand.is_empty() {
        object.set_state(tier, stand, state::CANDIDATE);
    }
    stand
}

/// Applies the shader's decisions about candidates; invalid ones are ignored.
fn decide(group_walk: &mut GroupWalk, object: &QueryRows<'_>, lanes: LaneMask) {
    let built_in = group_walk.candidates().built_in();
    let confirmed = object.lanes_at(state::CONFIRMED) & lanes & built_in;
    if !confirmed.is_empty() {
        group_walk.accept(confirmed);
    }
    let generated = object.lanes_at(state::GENERATED) & (lanes - built_in);
    if !generated.is_empty() {
        let t = floats(object.rows, row::GENERATED_T);
        let counts = group_walk.counts(generated, &t);
        group_walk.report(counts, &t, &[0; _]);
    }
}

/// Rays of queries start, for the observer of queries.
#[cold]
fn show_rays(context: &Context<'_>, object: &QueryRows<'_>, lanes: LaneMask) {
    let Some(observer) = &context.limits.query_observer else {
        return;
    };
    let mut rays = RayRows::NONE;
    load(object.rows, &mut rays);
    for lane in lanes {
        let structure = rays.top_level[lane];
        let found = context.limits.structure(structure);
        observer.ray(&StartedRay {
            instruction: Instruction::RayQuery(object.first),
            has_time: false,
            place: context.program.number(),
            ray: rays.ray(lane),
            time: 0.0,
            structure,
            kind: found.map(|structure| structure.kind()),
        });
    }
}

/// One query's rays at the seam: their group is the only one.
struct One<'a> {
    group_walk: &'a mut GroupWalk,
    rows: &'a [AlignedRow],
    start: Start,
    limits: &'a Limits,
}

impl GroupWalks for One<'_> {
    type Stop = Stopped;

    fn rays(&self, _: u32, rays: &mut RayRows) -> Start {
        load(self.rows, rays);
        self.start
    }

    fn group_walk(&mut self, _: u32) -> &mut GroupWalk {
        self.group_walk
    }

    fn settled(&mut self, _: u32) -> Result<(), Stopped> {
        Ok(())
    }

    fn out_of_fuel(&mut self, _: u32) -> Result<(), Stopped> {
        self.limits.check()
    }
}

const _: () =
    assert!(spirv_jit::query::IGNORE_OPACITY_MICROMAPS == ray_flags::IGNORE_OPACITY_MICROMAPS);

/// Reads the rays of queries.
fn load(object: &[AlignedRow], rays: &mut RayRows) {
    for axis in 0..3 {
        rays.origin[axis] = floats(object, row::ORIGIN + axis);
        rays.direction[axis] = floats(object, row::DIRECTION + axis);
    }
    rays.t_min = floats(object, row::T_MIN);
    rays.t_max = floats(object, row::T_MAX);
    rays.flags = object[row::FLAGS].0;
    rays.cull_mask = object[row::CULL_MASK].0;
    rays.top_level = addresses(&[0, 1].map(|word| object[row::STRUCTURE + word].0));
}

/// A row of an object as floats.
fn floats(object: &[AlignedRow], row: usize) -> Lanes<f32> {
    super::rows::floats(&object[row].0)
}

impl QueryRows<'_> {
    /// Lanes whose query stands at a state.
    #[inline]
    fn lanes_at(&self, state: u32) -> LaneMask {
        LaneMask::holding(&self.rows[row::STATE].0, state)
    }

    #[inline]
    fn set_state(&mut self, tier: Tier, lanes: LaneMask, state: u32) {
        put_word(tier, &mut self.rows[row::STATE].0, state, lanes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenes::groups::Groups;
    use scenes::{Mesh, Scene, ray};

    /// Sixteen rays that wait at a triangle of a scene.
    fn group_walk(scene: &Scene) -> Box<GroupWalk> {
        let rays = [ray([0.125, 0.25, 2.0], [0.0, 0.0, -1.0]); 16];
        let mut groups = Groups::new(&scene.top, &rays, |_, _| ());
        groups.rounds = 0;
        // SAFETY: the scene is alive.
        unsafe { groups.trace(&mut Walker::new(), 1) };
        let group_walk = groups.group_walks.pop().expect("there is one group");
        assert_eq!(group_walk.candidates().found, LaneMask::ALL);
        Box::new(group_walk)
    }

    #[test]
    fn memory_of_released_subgroups_has_no_rays() {
        let scene = Scene::new(&[Mesh::icosphere(0, false, |point| point)], 0);
        let mut waiting = Waiting::default();
        let mut keep = |object| {
            let mut owned = Owned::default();
            waiting.starting = group_walk(&scene);
            waiting.keep(object, &mut owned).expect("there is room");
            owned
        };
        let (mut released, mut moving, mut moved) = (keep(0), keep(8), Owned::default());
        waiting.release(&mut released);
        // A ray that moves gets the released memory, where the other lanes have none.
        let moves = waiting.move_lane((&mut moving, 3), (&mut moved, 5));
        moves.expect("there is room");
        let group_walk = moved.find(8).expect("the ray moved with its query");
        assert_eq!(group_walk.candidates().found, LaneMask::of(5));
    }
}
