//! Everything C about Vulkan: pointers, `pNext` chains, the enumerate-twice idiom. Nothing of the
//! driver's own.

pub mod array;
pub mod chain;
pub mod enumerate;
pub mod vk;

pub use array::{slice, string, write_strided};
pub use chain::{find, find_mut};
pub use enumerate::enumerate;
