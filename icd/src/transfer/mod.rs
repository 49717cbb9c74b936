//! Transfers: copies, blits, clears and resolves of buffers and images.

pub mod blit;
pub mod buffer;
pub mod clear;
pub mod copy;
pub mod matrix;
pub mod pattern;
pub mod resolve;
mod rows;
pub mod surface;
#[cfg(test)]
mod tests;
