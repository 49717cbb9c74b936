//! Quads: four consecutive lanes, (0, 0), (1, 0), (0, 1) and (1, 1) of two by two neighbours.

#![forbid(unsafe_code)]

/// Bit of the lane's index by which the two lanes of a derivative in x differ.
pub const X: usize = 1;

/// The same in y.
pub const Y: usize = 2;
