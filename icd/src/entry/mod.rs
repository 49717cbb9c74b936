//! Entry points, by what they act on. Each decodes its C structures, calls one method and encodes the result.

pub mod acceleration_structure;
pub mod instance;
pub mod ray_tracing;
