//! Linux.

pub mod clock;
pub mod event;
pub mod handle;
pub mod memory;
pub mod processors;
pub mod quota;
