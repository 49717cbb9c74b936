//! Decoders for entry points: C structures of the application to owned values of `command` and
//! `object`.

pub mod acceleration_structure;
mod descriptor_heap;
pub mod descriptor_update;
pub mod geometries;
pub mod graphics;
pub mod image;
mod index_type;
pub mod matrix;
pub mod micromap;
pub mod nv_ray_tracing;
pub mod pipeline;
pub mod ray_tracing;
pub mod render_pass;
pub mod sampler;
