//! Everything C about Vulkan: pointers, `pNext` chains, the enumerate-twice idiom, and the guard around each entry point.

pub mod acceleration_structure;
pub mod array;
pub mod chain;
pub mod enumerate;
pub mod guard;
pub mod micromap;
pub mod nv_ray_tracing;
pub mod pipeline;
pub mod ray_tracing;
pub mod vk;

pub use array::{slice, string};
pub use chain::{find, find_mut};
pub use enumerate::enumerate;
pub(crate) use guard::{commands, entry};
