//! The observer of one captured command.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;

use parking_lot::Mutex;
use spirv_jit::program::Stage;

use super::path::Path;
use crate::wave::launch_counts::LaunchCounts;
use crate::wave::observer::{LookupPurpose, Observation, Observer, TableKind};

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
    fn invocation(&self) -> Option<[u32; 3]> {
        Some(self.invocation)
    }

    fn counts(&self) -> Option<&LaunchCounts> {
        None
    }

    fn observe(&self, event: Observation) {
        let stage = |program: u32| self.stages.get(program as usize).copied();
        self.path.lock().add(event, stage);
    }

    fn look_up(&self, table: TableKind, index: u32, purpose: LookupPurpose, rays: u32) {
        let mut lookups = self.lookups.lock();
        let key = (table, index);
        if lookups.len() == MAX_INDICES && !lookups.contains_key(&key) {
            return;
        }
        let found = lookups.entry(key).or_default();
        match purpose {
            LookupPurpose::Candidate => found.candidates += u64::from(rays),
            LookupPurpose::Call => found.calls += u64::from(rays),
        }
    }
}
