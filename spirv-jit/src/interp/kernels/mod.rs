//! Kernels of the pure operations: a function of `eval` over the lanes of each subgroup that has
//! any active.
//!
//! They also compute inactive lanes of those subgroups; slots are allocated so that this is
//! harmless.

mod elementwise;
mod fused;
mod half;
mod lane;
pub(super) mod ops;
mod quad;
mod remainder;

pub(super) use elementwise::{Copy, MaskedCopy, Unpack64, elementwise};
pub(super) use fused::{Side, fused};
pub(super) use lane::{Binary, Lane, sign_bits};
pub(super) use quad::derivative;
