//! As much Vulkan as one path tracer needs.

mod acceleration;
mod context;
mod memory;
mod pipeline;

pub use acceleration::{AccelerationStructure, BlasInput, build_blas, build_tlas};
pub use context::{Context, PATIENCE_NS};
pub use memory::{Buffer, Image, upload_images};
pub use pipeline::{HitGroup, Pipeline, PipelineCache, PipelineInput};
