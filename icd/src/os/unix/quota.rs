//! The process's limits: control groups (cgroups(7)).

use std::os::unix::fs::FileExt;

use control_group::Groups;
pub use control_group::Memory;

/// The limits of the process, and its use of them.
#[derive(Debug)]
pub struct Quota(Groups);

impl Quota {
    /// Finds the limits and keeps their files open: [`Self::memory`] opens none, so that a sandbox
    /// may refuse it.
    pub fn open() -> Self {
        Self(Groups::open(FileExt::read_at))
    }

    /// The limit of memory and what is left of it; `None` where there is no limit.
    pub fn memory(&self) -> Option<Memory> {
        self.0.memory()
    }
}
