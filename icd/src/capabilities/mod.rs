//! The tables of the driver's capabilities. Each is the only list of its kind.

pub mod cooperative_matrices;
pub mod cooperative_vectors;
pub mod extensions;
pub mod features;
pub mod limits;
pub mod properties;
