//! The observer of one captured command.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;

use parking_lot::Mutex;
use spirv_jit::program::Stage;

use super::path::Path;
use crate::wave::observer::{
    Interests, LookupPurpose, Observation, Observer, RecordLookup, TableKind,
};

/// How often rays have looked up each record, by table and index.
pub type Lookups = BTreeMap<(TableKind, u32), RecordUse>;

/// How often a record was looked up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordUse {
    /// For shaders that decide on candidates.
    pub candidates: u64,
    /// For shaders at the ends of rays, and for callables.
    pub calls: u64,
}

/// Indices that are told apart, at most: a shader may look up any number of them.
const MAX_INDICES: usize = 1 << 16;

/// Collects what happens to one invocation, and what all look up.
#[derive(Debug)]
pub struct Recorder {
    invocation: [u32; 3],
    /// Of the programs.
    stages: Vec<Stage>,
    path: Mutex<Path>,
    lookups: Mutex<Lookups>,
}

impl Recorder {
    /// An observer of an invocation, for a command with programs of these stages.
    pub fn new(invocation: [u32; 3], stages: Vec<Stage>) -> Self {
        Self {
            invocation,
            stages,
            path: Mutex::default(),
            lookups: Mutex::default(),
        }
    }

    /// The observed invocation.
    pub fn observed(&self) -> [u32; 3] {
        self.invocation
    }

    /// The path and the lookups that it has seen.
    pub fn finish(self) -> (Path, Lookups) {
        (self.path.into_inner(), self.lookups.into_inner())
    }
}

impl Observer for Recorder {
    fn interests(&self) -> Interests {
        Interests {
            lookups: true,
            ..Interests::default()
        }
    }

    fn invocation(&self) -> Option<[u32; 3]> {
        Some(self.invocation)
    }

    fn observe(&self, event: Observation) {
        let stage = |program: u32| self.stages.get(program as usize).copied();
        self.path.lock().add(event, stage);
    }

    fn look_up(&self, lookup: &RecordLookup<'_>) {
        let mut lookups = self.lookups.lock();
        let key = (lookup.purpose.table(), lookup.index);
        if lookups.len() == MAX_INDICES && !lookups.contains_key(&key) {
            return;
        }
        let (found, rays) = (lookups.entry(key).or_default(), u64::from(lookup.rays));
        match lookup.purpose {
            LookupPurpose::AnyHit | LookupPurpose::Intersection => found.candidates += rays,
            // The record of the candidate, once more.
            LookupPurpose::AnyHitOfReport => {}
            LookupPurpose::ClosestHit
            | LookupPurpose::SkippedClosestHit
            | LookupPurpose::Miss
            | LookupPurpose::Callable => found.calls += rays,
        }
    }
}
