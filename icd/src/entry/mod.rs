//! Entry points, by what they act on. Each decodes its C structures, calls one method and encodes the result.

pub mod acceleration_structure;
pub mod command;
pub mod command_transfer;
pub mod instance;
pub mod query;
pub mod queue;
pub mod ray_tracing;
pub mod sync;
