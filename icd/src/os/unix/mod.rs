//! Linux.

pub mod clock;
pub mod memory;
pub mod processors;
pub mod quota;
