//! The process's limits: control groups (cgroups(7)).

use std::os::unix::fs::FileExt;

use cgroup::Groups;
pub use cgroup::Memory;

/// The limits and the usage of the process.
#[derive(Debug)]
pub struct Quota(Groups);

impl Quota {
    /// Finds the limits and keeps their files open: [`Self::memory`] opens none, so that a sandbox
    /// may refuse it.
    pub fn open() -> Self {
        Self(Groups::open(FileExt::read_at))
    }

    /// The memory limit and the part that is left; `None` without a limit.
    pub fn memory(&self) -> Option<Memory> {
        self.0.memory()
    }
}
