//! Rows: one number of each of a subgroup's lanes, side by side.

#![forbid(unsafe_code)]

/// One row of a subgroup's state: a word per lane.
pub type Row = [u32; crate::SUBGROUP_SIZE];

/// A row, aligned to a cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AlignedRow(pub Row);
