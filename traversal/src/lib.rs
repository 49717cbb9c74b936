//! Acceleration structures for ray tracing on the CPU: build, lay out, intersect, walk.
//!
//! An acceleration structure is one contiguous, relocatable blob in memory that the caller owns
//! (see [`structure`]). A *bottom level* holds triangles or boxes, a *top level* holds instances:
//! a transform, a mask, and the address of a bottom level. [`build_sizes`] says how much memory a
//! build needs at most, [`build`] fills it, and a [`Walk`] takes one ray through it.
//!
//! The crate knows no graphics API: addresses are host addresses, formats and flags are its own
//! types with the values and the meaning that Vulkan gives them.
//!
//! Builds run on the rayon pool that they are called from and are serial outside any pool; the
//! global pool is never started. The result does not depend on the number of threads.

pub mod build;
pub mod input;
mod layout;
pub mod ray;
pub mod structure;
pub mod transfer;
pub mod walk;

pub use build::{BuildError, BuildSizes, build, build_sizes, update};
pub use input::{
    AabbGeometry, BuildFlags, BuildInput, Geometries, GeometryFlags, IndexType, InstanceArray,
    InstanceSource, Memory, TriangleGeometry, VertexFormat,
};
pub use ray::{Hit, Ray, ray_flags};
pub use structure::{Kind, Structure, StructureError, validate};
pub use transfer::{
    Serialized, compact_into, compacted_size, copy_into, deserialize, serialize, serialized_size,
};
pub use walk::{Event, Tier, Verdict, Walk, Walker};
