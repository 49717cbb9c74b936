//! The rays of a batch that met candidates and whose walks are over, where a capture counts them:
//! each is walked once more, by itself.

use std::time::Duration;

use traversal::{RayCosts, Walker};

use crate::wave::launch_counts::{Counter, LaunchCounts, WalkedRay};
use crate::wave::observer::Observer;
use crate::wave::{Limits, Stopped};

/// Rays that are walked once more between two looks at the limits.
const RAYS_BETWEEN_LOOKS: usize = 256;

/// The counts of a batch, and the rays that are to be walked once more.
pub struct Counting<'a> {
    pub counts: &'a LaunchCounts,
    pub walked: Vec<WalkedRay>,
    /// Time of walks that no ray has ended in.
    unshared: Duration,
}

impl<'a> Counting<'a> {
    /// For a batch, if its observer keeps counts.
    pub fn new(observer: Option<&'a dyn Observer>) -> Option<Self> {
        let counts = observer?.counts()?;
        Some(Self {
            counts,
            walked: Vec::new(),
            unshared: Duration::ZERO,
        })
    }

    /// Counts the walks that are over. Their time is shared by their steps.
    ///
    /// # Errors
    /// A limit was reached.
    pub fn count_walks(
        &mut self,
        time: Duration,
        walker: &mut Walker,
        limits: &Limits,
    ) -> Result<(), Stopped> {
        self.unshared += time;
        if self.walked.is_empty() {
            return Ok(());
        }
        let mut steps = Vec::with_capacity(self.walked.len());
        // SAFETY: the memory is there until the dispatch is complete, and no walk goes on after it.
        let mut costs = unsafe { RayCosts::new(walker, &limits.live) };
        for rays in self.walked.chunks(RAYS_BETWEEN_LOOKS) {
            limits.check()?;
            for walked in rays {
                // SAFETY: structures stay until the dispatch is complete, as for the first walk.
                let cost = unsafe { self.counts.add_walk(walked, &mut costs) };
                // Each takes the time of a step at least.
                steps.push(f64::from(cost) + 1.0);
            }
        }
        let all: f64 = steps.iter().sum();
        let each = self.unshared.as_nanos() as f64 / all;
        for (walked, steps) in self.walked.drain(..).zip(steps) {
            (self.counts).add(Counter::Nanoseconds, walked.cell, (each * steps) as u32);
        }
        self.unshared = Duration::ZERO;
        Ok(())
    }
}
