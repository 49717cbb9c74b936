//! A progressive path tracer and a rasterizer of the same scene, on any Vulkan device that traces
//! rays.
//!
//! [`scene`] makes a scene or reads one, [`render`] uploads it and traces its paths, [`raster`]
//! draws it, and [`picture`] turns sums of radiance into colors. The program `demo` writes a
//! picture; the window is a crate of its own.

pub use demo_limits as limits;

pub mod picture;
pub mod raster;
pub mod render;
pub mod scene;
pub mod structures;
pub mod vulkan;
