//! The tables: each the only place where its kind of thing is listed.

pub mod cooperative_matrices;
pub mod cooperative_vectors;
pub mod extensions;
pub mod features;
pub mod limits;
pub mod properties;
