//! What ends a dispatch that does not end by itself, and what keeps it from going astray.
#![forbid(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use spirv_jit::reach::{Reach, Strays};
use traversal::{Kind, Ray, Structure};

/// What a command's addresses may lead to.
pub struct Surroundings {
    pub reach: Arc<Reach>,
    /// For physical pointers of shaders: with validation, buffers of that usage alone.
    pub shader_reach: Arc<Reach>,
    /// Counts what shaders do wrong, where there is validation.
    pub strays: Option<Arc<Strays>>,
}

/// Who wants to see the rays of a dispatch's queries: validation, where it is on.
pub trait QueryObserver: Send + Sync {
    /// The ray that a query starts with, the address of a structure that it names, and what lies there. `place` tells programs apart.
    fn ray(&self, place: u64, ray: &Ray, structure: u64, kind: Option<Kind>);
}

/// What ends a dispatch that does not end by itself, and what keeps it from going astray.
pub struct Limits {
    /// Set from outside to make every worker stop at its next budget check.
    pub cancelled: Arc<AtomicBool>,
    /// When the dispatch counts as hanging (`TUFF_TIMEOUT`).
    pub deadline: Option<Instant>,
    /// Where structures may lie.
    pub reach: Arc<Reach>,
    /// Validation of ray queries, where it is on.
    pub queried: Option<Arc<dyn QueryObserver>>,
}

impl Default for Limits {
    /// No limit.
    fn default() -> Self {
        Self {
            cancelled: Arc::default(),
            deadline: None,
            reach: Arc::new(Reach::everywhere()),
            queried: None,
        }
    }
}

impl Limits {
    /// The address of a structure that a shader names: 0, which is none, if it leads nowhere.
    pub fn structure(&self, address: u64) -> u64 {
        const SIZE: u64 = Structure::HEADER_BYTES;
        // Nearly all are in one range: no search.
        let is_there =
            self.reach.likely().bytes_from(address) >= SIZE || self.reach.contains(address, SIZE);
        if is_there { address } else { 0 }
    }

    /// Called when fuel runs dry.
    ///
    /// # Errors
    /// When a limit is reached.
    pub fn check(&self) -> Result<(), Stopped> {
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

/// Why a dispatch was given up: the device is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
    TimedOut,
    /// Invocations in flight would need more memory than a batch may have.
    OutOfMemory,
}
