//! Groups of rays that are to walk.

#![forbid(unsafe_code)]

/// The groups of a batch whose walks can go on.
#[derive(Default)]
pub struct WalkLists {
    /// Groups whose walks begin.
    pub starting: Vec<u32>,
    /// The same, of rays that are known not to go together.
    pub apart: Vec<u32>,
    /// Groups about all of whose candidates shaders have decided.
    pub going_on: Vec<u32>,
}

impl WalkLists {
    pub fn is_empty(&self) -> bool {
        self.starting.is_empty() && self.apart.is_empty() && self.going_on.is_empty()
    }
}
