//! Limits that end a dispatch which does not end by itself, and that bound its memory accesses.
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use spirv_jit::abort::Aborts;
use traversal::{EVERYWHERE, Live, Structure};

use super::budget::Budget;
use super::fault::{Fault, Stopped, StoppedAt};
use super::observer::Observer;

/// Limits that end a dispatch which does not end by itself, and that bound its memory accesses.
#[derive(Clone)]
pub struct Limits {
    /// Set from outside to make every worker stop at its next budget check.
    pub cancelled: Arc<AtomicBool>,
    /// Stops every worker at its next budget check when a shader has aborted.
    pub aborts: Option<Arc<Aborts>>,
    /// When the dispatch counts as hanging (`TUFF_TIMEOUT`).
    pub deadline: Option<Instant>,
    /// Where structures may lie.
    pub live: Live,
    /// The memory budget of invocations in flight, shared with other dispatches.
    pub memory: Arc<Budget>,
    /// The observer of ray queries in all stages: validation, where it is on.
    pub query_observer: Option<Arc<dyn Observer>>,
    /// Where it was stopped, as the first to notice says.
    pub stopped_at: OnceLock<StoppedAt>,
}

impl Default for Limits {
    /// No limit.
    fn default() -> Self {
        Self {
            cancelled: Arc::default(),
            aborts: None,
            deadline: None,
            live: EVERYWHERE.clone(),
            memory: Arc::default(),
            query_observer: None,
            stopped_at: OnceLock::new(),
        }
    }
}

impl Limits {
    /// Says where an invocation stood when a limit was reached. The first one counts.
    pub fn note(&self, at: impl FnOnce() -> StoppedAt) {
        self.stopped_at.get_or_init(at);
    }

    /// The report of a stop within these limits.
    pub fn fault(&self, why: Stopped) -> Fault {
        Fault {
            at: self.stopped_at.get().cloned(),
            ..why.into()
        }
    }

    /// The structure at an address that a shader names; none where that leads nowhere.
    pub fn structure(&self, address: u64) -> Option<Structure> {
        // SAFETY: the memory is there until the dispatch is complete.
        unsafe { Structure::at(address, &self.live) }
    }

    /// Called when fuel runs dry.
    ///
    /// # Errors
    /// When a limit is reached.
    pub fn check(&self) -> Result<(), Stopped> {
        if self.aborts.as_ref().is_some_and(|aborts| aborts.happened()) {
            return Err(Stopped::Aborted);
        }
        let late = self
            .deadline
            .is_some_and(|deadline| Instant::now() >= deadline);
        if late || self.cancelled.load(Ordering::Relaxed) {
            Err(Stopped::TimedOut)
        } else {
            Ok(())
        }
    }
}
