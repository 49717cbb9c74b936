//! Running waves, for drawing, dispatches and rays: the loop over a program's subgroups, ray
//! queries, workers, limits, reachable memory, shader tables.

pub mod binding_table;
mod budget;
pub mod costs;
mod fault;
pub mod hit_facts;
pub mod launch_counts;
mod lent_thread;
mod limits;
pub mod mask;
pub mod observer;
pub mod observers;
pub mod queries;
pub mod reachable;
pub mod rows;
pub mod runner;
mod workers;
pub mod workgroups;

pub use budget::{Budget, Share};
pub use fault::{Cause, Fault, Returned, Stopped, StoppedAt, WildAddress, WildAddresses};
pub use limits::Limits;
pub use workers::Workers;
