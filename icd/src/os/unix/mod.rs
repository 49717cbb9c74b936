//! Linux.

pub mod address_space;
pub mod clock;
pub mod event;
pub mod executable;
pub mod handle;
pub mod memory;
pub mod processors;
pub mod quota;
pub mod section;
pub mod thread;
pub mod window_server;
