//! The one definition of what each operation computes, on scalars. Tiers are tested against it.
//!
//! Integers are `u8`, `u16`, `u32`, `u64` (signedness is the operation's), booleans `bool`, floats
//! [`f16`], `f32`, `f64`. Everything is `#[inline(always)]` and as free of branches as it can be,
//! so that a loop over lanes compiles to vector code under whatever target features its caller has;
//! the results do not depend on those.

#![forbid(unsafe_code)]

mod convert;
mod fast;
mod float;
pub mod float8;
mod int;
pub mod matrix;
pub(crate) mod narrow;
pub mod quad;
pub mod subgroup;
mod transcendental;
mod wide;

pub use convert::*;
pub use float::*;
pub use half::f16;
pub use int::*;

/// `(i1, T, T) -> T`.
#[inline(always)]
pub fn select<T>(condition: bool, a: T, b: T) -> T {
    if condition { a } else { b }
}

#[cfg(test)]
mod tests;
