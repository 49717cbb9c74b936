//! The walk: one ray through a top level and its bottom levels, as a state machine.
//!
//! ```text
//! let mut walk = Walk::new(top_level, &ray);
//! let mut verdict = Verdict::Continue;
//! loop {
//!     match walk.resume(&mut walker, verdict, &mut fuel) {
//!         Event::Done => break,                      // walk.committed(): closest hit, or None: miss
//!         Event::AnyHitCandidate => {                // a triangle that is not opaque
//!             verdict = any_hit(walk.candidate());   // Continue (ignore), Accept, AcceptAndTerminate
//!         }
//!         Event::ProceduralCandidate => {
//!             // run the intersection shader; for each ReportIntersection(t, hit_kind):
//!             if walk.t_min() <= t && t <= walk.t_max() {
//!                 // unless walk.candidate().opaque: run any-hit; ignored ones are not committed
//!                 let over = walk.commit_procedural(t, hit_kind); // true: end the shader now
//!             }
//!             verdict = Verdict::Continue;           // or Terminate if an any-hit shader said so
//!         }
//!         Event::OutOfFuel => { fuel = more; verdict = Verdict::Continue }
//!     }
//! }
//! ```

mod any_box;
#[cfg(target_arch = "x86_64")]
mod avx;
#[cfg(target_arch = "x86_64")]
mod block;
mod boxes;
mod children;
mod descend;
mod edge_side;
mod entry;
mod expansion;
pub(crate) mod facts;
mod found;
#[cfg(target_arch = "x86_64")]
mod group;
mod group_hits;
mod group_walks;
mod kernel;
mod leaf;
pub(crate) mod level;
mod level_ray;
mod level_rays;
mod list;
pub(crate) mod meter;
mod micromap;
mod motion;
mod opaque;
mod options;
mod packet;
mod portable;
mod probe;
mod rows;
mod run;
mod slabs;
#[cfg(target_arch = "x86_64")]
mod stream;
mod streaming;
mod suspended;
mod swept_sphere;
mod test_leaf;
mod triangle;
#[cfg(target_arch = "x86_64")]
mod triangle_ray;
mod walk_opaque;
mod walker;

use crate::ray::{Hit, Ray, ray_flags};
use entry::Entry;
pub use group_walks::{GroupWalk, GroupWalks, Start};
use level::Entered;
use level_ray::MODEST;
use meter::Meter;
pub use options::{Accuracy, Options, Specialisation, Switches};
pub use probe::TriangleTest;
pub use rows::{HitRows, Lanes, RayRows, Words};
pub use walker::{Counts, Walker};

/// Rays that [`Walker::trace`] takes, at most.
pub const PACKET: usize = 16;

/// The caller's decision about the last event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Verdict {
    /// Go on; a triangle candidate is ignored.
    #[default]
    Continue,
    /// Commit the triangle candidate and go on (or end, if the ray terminates on its first hit).
    Accept,
    /// Commit the triangle candidate and end.
    AcceptAndTerminate,
    /// End with what is committed.
    Terminate,
}

/// Why [`Walk::resume`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The walk is over: [`Walk::committed`] is the hit, if any.
    Done,
    /// [`Walk::candidate`] is a non-opaque triangle, nearer than the committed hit.
    AnyHitCandidate,
    /// The ray may meet the box [`Walk::candidate`].
    ProceduralCandidate,
    /// The fuel ran dry; resume with [`Verdict::Continue`].
    OutOfFuel,
}

/// One ray's way through a scene. Small: the live part of the stack is kept beside it only while
/// the walk is suspended.
///
/// Groups of rays go through [`Walker::trace`]. This is the interface for one ray, step by step. It
/// defines the results of groups, and tests, searches and measurements compare them with it.
#[derive(Clone, Debug)]
pub struct Walk {
    ray: Ray,
    top_level: u64,
    /// The committed hit; before there is one, its `t` is the ray's `t_max`.
    hit: Hit,
    candidate: Hit,
    /// When the ray is cast, for what moves.
    time: f32,
    has_hit: bool,
    state: WalkState,
    /// The instance that the walk is in.
    instance: u32,
    /// Entries of `pending` that belong to the top level.
    floor: u32,
    /// The leaf at which the walk stopped, and its first primitive to look at.
    leaf: Option<(u32, u32)>,
    pending: Vec<Entry>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WalkState {
    Fresh,
    /// Waiting for a verdict on the candidate.
    AnyHit,
    Procedural,
    OutOfFuel,
    Done,
}

impl WalkState {
    #[inline(always)]
    fn after(event: Event) -> WalkState {
        match event {
            Event::Done => WalkState::Done,
            Event::AnyHitCandidate => WalkState::AnyHit,
            Event::ProceduralCandidate => WalkState::Procedural,
            Event::OutOfFuel => WalkState::OutOfFuel,
        }
    }
}

impl Default for Walk {
    /// A walk that is over.
    fn default() -> Walk {
        Walk::OVER
    }
}

impl Walk {
    pub(crate) const NO_INSTANCE: u32 = u32::MAX;

    /// A walk that has not started. `top_level` is the address of a top-level structure; with 0
    /// the ray misses.
    ///
    /// # Safety
    /// `top_level` and the bottom levels it refers to must be 0 or built structures, and stay
    /// unchanged until the walk is dropped or done.
    #[inline]
    pub unsafe fn new(top_level: u64, ray: &Ray) -> Walk {
        Walk {
            ray: *ray,
            top_level,
            hit: Hit {
                t: ray.t_max,
                ..Hit::default()
            },
            candidate: Hit::default(),
            time: 0.0,
            has_hit: false,
            state: WalkState::Fresh,
            instance: Self::NO_INSTANCE,
            floor: 0,
            leaf: None,
            pending: Vec::new(),
        }
    }

    /// Starts over with another ray, keeping memory.
    ///
    /// # Safety
    /// As for [`Self::new`].
    #[inline]
    pub unsafe fn restart(&mut self, top_level: u64, ray: &Ray) {
        self.ray = *ray;
        self.top_level = top_level;
        self.time = 0.0;
        self.hit.t = ray.t_max;
        self.has_hit = false;
        self.state = WalkState::Fresh;
        self.instance = Self::NO_INSTANCE;
        self.floor = 0;
        self.leaf = None;
        self.pending.clear();
    }

    /// Goes on until something has to be decided outside. Each visited node and each leaf costs one
    /// unit of `fuel`.
    pub fn resume(&mut self, walker: &mut Walker, verdict: Verdict, fuel: &mut u64) -> Event {
        run::run(self, verdict, walker, &mut { Entered::NOTHING }, fuel)
    }

    /// The same, with each visit told to a meter. What the walk before entered may be in `entered`.
    pub(crate) fn resume_metered(
        &mut self,
        walker: &mut Walker,
        entered: &mut Entered,
        verdict: Verdict,
        fuel: &mut u64,
        meter: &mut impl Meter,
    ) -> Event {
        run::run_metered(self, verdict, walker, entered, fuel, meter)
    }

    /// Applies a verdict; whether that ends the walk.
    #[inline(always)]
    fn is_over(&mut self, verdict: Verdict) -> bool {
        let accepts = matches!(verdict, Verdict::Accept | Verdict::AcceptAndTerminate);
        let ends = matches!(verdict, Verdict::Terminate | Verdict::AcceptAndTerminate);
        let over = match self.state {
            WalkState::Fresh => !walker::is_sound(&self.ray),
            WalkState::AnyHit if accepts => self.commit(self.candidate),
            // An intersection shader's hit may have ended the walk already.
            WalkState::Procedural => self.has_hit && self.terminates_on_first_hit(),
            WalkState::AnyHit | WalkState::OutOfFuel => false,
            WalkState::Done => true,
        };
        over || ends
    }

    /// Casts the ray at another time than 0, in [0, 1]; before the first step.
    #[inline]
    pub fn set_time(&mut self, time: f32) {
        self.time = time;
    }

    /// When the ray is cast.
    #[inline]
    pub fn time(&self) -> f32 {
        self.time
    }

    /// The address of the top level.
    #[inline]
    pub fn top_level(&self) -> u64 {
        self.top_level
    }

    /// The ray this walk was made for.
    #[inline]
    pub fn ray(&self) -> &Ray {
        &self.ray
    }

    /// Lower end of the ray's interval.
    #[inline]
    pub fn t_min(&self) -> f32 {
        self.ray.t_min
    }

    /// Upper end of the interval now: the committed hit's `t`, or the ray's `t_max`.
    #[inline]
    pub fn t_max(&self) -> f32 {
        self.hit.t
    }

    /// The subject of the last event.
    #[inline]
    pub fn candidate(&self) -> &Hit {
        &self.candidate
    }

    /// The committed hit.
    #[inline]
    pub fn committed(&self) -> Option<&Hit> {
        self.has_hit.then_some(&self.hit)
    }

    /// Commits a hit that an intersection shader reported for the current box candidate, at
    /// `t_min() <= t <= t_max()`. Returns whether the walk is over by it (the ray terminates on
    /// its first hit), so that the intersection shader ends at once.
    #[inline]
    pub fn commit_procedural(&mut self, t: f32, hit_kind: u8) -> bool {
        self.commit(Hit {
            t,
            hit_kind,
            ..self.candidate
        })
    }

    /// A walk that is over.
    pub(crate) const OVER: Walk = Walk {
        ray: Ray::NONE,
        top_level: 0,
        hit: Hit::NONE,
        candidate: Hit::NONE,
        time: 0.0,
        has_hit: false,
        state: WalkState::Done,
        instance: Self::NO_INSTANCE,
        floor: 0,
        leaf: None,
        pending: Vec::new(),
    };

    /// Goes on with what was found, and what is to be visited: of the top level, and of an
    /// instance.
    fn go_on_from(
        &mut self,
        found: Option<Hit>,
        top: impl Iterator<Item = Entry>,
        instance: Option<u32>,
        bottom: impl Iterator<Item = Entry>,
    ) {
        if let Some(hit) = found {
            (self.hit, self.has_hit) = (hit, true);
        }
        self.state = WalkState::OutOfFuel;
        self.pending.extend(top);
        if let Some(index) = instance {
            self.instance = index;
            self.floor = self.pending.len() as u32;
            self.pending.extend(bottom);
        }
    }

    /// Leaves an instance: with what is pending in the top level.
    fn go_up(&mut self, top: &[Entry]) {
        self.pending.clear();
        self.pending.extend_from_slice(top);
        (self.instance, self.floor, self.leaf) = (Self::NO_INSTANCE, 0, None);
        self.state = WalkState::OutOfFuel;
    }

    /// Whether something in the top level is known to be beyond the ray's end.
    fn is_beyond(&self, entry: Entry) -> bool {
        let [x, y, z] = self.ray.direction.map(f32::abs);
        // Of other lengths, distances are scaled.
        MODEST.contains(&x.max(y).max(z)) && entry.near() > self.hit.t
    }

    fn is_fresh(&self) -> bool {
        self.state == WalkState::Fresh
    }

    #[inline(always)]
    fn terminates_on_first_hit(&self) -> bool {
        self.ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0
    }

    /// Returns whether the walk is over.
    #[inline(always)]
    fn commit(&mut self, hit: Hit) -> bool {
        self.hit = hit;
        self.has_hit = true;
        self.terminates_on_first_hit()
    }

    /// Whether a triangle is to be preferred to what is committed. Among opaque triangles at the
    /// same distance the one with the least instance, geometry and primitive is, so that the order
    /// of the walk does not show.
    #[inline(always)]
    fn is_nearer(&self, hit: &Hit) -> bool {
        hit.t < self.hit.t || self.has_hit && hit.t == self.hit.t && hit.wins_tie(&self.hit)
    }
}
