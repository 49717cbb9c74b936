//! Shared infrastructure of running waves: workers, limits, reachable memory, shader tables.

mod budget;
mod fault;
pub mod launch_counts;
mod lent_thread;
mod limits;
pub mod mask;
pub mod observer;
pub mod reachable;
pub mod table;
mod workers;

pub use budget::{Budget, Share};
pub use fault::{Cause, Fault, Returned, Stopped, StoppedAt, WildAddress, WildAddresses};
pub use limits::{Limits, QueryObserver, Surroundings};
pub use workers::Workers;
