//! Entry points, by the object that they act on. Each decodes its C structures, calls one method
//! and encodes the result. Bodies run inside [`guard`](crate::guard::guard), which stops panics at
//! the C boundary, or inside [`record`](record::record); [`commands`] is the table of all.
//!
//! # Safety
//! The application keeps each command's valid usage: handles are alive and of their type, pointers
//! are valid for their counts, chains are well formed, and externally synchronized objects are not
//! used elsewhere. Entry points rely on nothing else, so they need no blocks of their own.

#![allow(unsafe_op_in_unsafe_fn, non_snake_case)]

pub mod acceleration_structure;
pub mod address_report;
pub mod buffer;
mod built;
pub mod command;
pub mod command_image;
pub mod command_transfer;
pub mod commands;
pub mod cooperative_vector;
pub mod debug;
pub mod deferred;
pub mod descriptor;
pub mod descriptor_buffer;
pub mod descriptor_heap;
pub mod descriptor_set;
pub mod device;
pub mod device_address;
pub mod device_fault;
pub mod graphics;
pub mod graphics_address;
pub mod graphics_draw;
pub mod graphics_pass;
pub mod graphics_state;
pub mod host_image_copy;
pub mod image;
pub mod instance;
pub mod loader;
pub mod maintenance5;
pub mod memory;
pub mod micromap;
pub mod nv_ray_tracing;
pub mod physical_device;
pub mod pipeline;
pub mod pipeline_binary;
pub mod pipeline_executable;
pub mod present_timing;
pub mod push_descriptor;
pub mod query;
pub mod queue;
pub mod ray_tracing;
mod record;
mod row;
pub mod shader_object;
pub mod surface;
pub mod swapchain;
pub mod sync;
pub mod system;
pub mod transform_feedback;
