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

use crate::ray::{Hit, Ray};

/// What the caller decided about the last event.
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
    /// [`Walk::candidate`] is a triangle that is not opaque, nearer than what is committed.
    AnyHitCandidate,
    /// The ray may meet the box [`Walk::candidate`].
    ProceduralCandidate,
    /// The fuel ran dry; resume with [`Verdict::Continue`].
    OutOfFuel,
}

/// What a thread needs to run walks: the stack and the set-up of the ray being walked. Large
/// (some kilobytes), reused for every walk of the thread; holds nothing between calls that a
/// suspended walk needs.
pub struct Walker {
    _private: (),
}

impl Walker {
    /// A walker for one thread.
    pub fn new() -> Box<Walker> {
        Box::new(Walker { _private: () })
    }
}

/// One ray's way through a scene. Small: the live part of the stack is kept beside it only while
/// the walk is suspended.
#[derive(Clone, Debug)]
pub struct Walk {
    ray: Ray,
    hit: Hit,
    candidate: Hit,
}

impl Walk {
    /// A walk that has not started. `top_level` is the address of a top-level structure; with 0
    /// the ray misses.
    ///
    /// # Safety
    /// `top_level` and the bottom levels it refers to must be 0 or built structures, and stay
    /// unchanged until the walk is dropped or done.
    pub unsafe fn new(top_level: u64, ray: &Ray) -> Walk {
        unimplemented!("{top_level} {ray:?}")
    }

    /// Starts over with another ray, keeping memory.
    ///
    /// # Safety
    /// As for [`Self::new`].
    pub unsafe fn restart(&mut self, top_level: u64, ray: &Ray) {
        unimplemented!("{top_level} {ray:?}")
    }

    /// Goes on until something has to be decided outside. Each visited node and each leaf costs one
    /// unit of `fuel`.
    pub fn resume(&mut self, walker: &mut Walker, verdict: Verdict, fuel: &mut u64) -> Event {
        let _ = walker;
        unimplemented!("{verdict:?} {fuel}")
    }

    /// The ray this walk was made for.
    pub fn ray(&self) -> &Ray {
        &self.ray
    }

    /// Lower end of the ray's interval.
    pub fn t_min(&self) -> f32 {
        self.ray.t_min
    }

    /// Upper end of the interval now: the committed hit's `t`, or the ray's `t_max`.
    pub fn t_max(&self) -> f32 {
        self.hit.t
    }

    /// What the last event is about.
    pub fn candidate(&self) -> &Hit {
        &self.candidate
    }

    /// The committed hit.
    pub fn committed(&self) -> Option<&Hit> {
        unimplemented!()
    }

    /// Commits a hit that an intersection shader reported for the current box candidate, at
    /// `t_min() <= t <= t_max()`. Returns whether the walk is over by it (the ray terminates on
    /// its first hit), so that the intersection shader ends at once.
    pub fn commit_procedural(&mut self, t: f32, hit_kind: u8) -> bool {
        unimplemented!("{t} {hit_kind}")
    }
}
