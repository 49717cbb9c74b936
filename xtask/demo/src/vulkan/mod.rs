//! As much Vulkan as one path tracer needs.

mod acceleration;
mod context;
mod graphics;
mod memory;
mod pipeline;

pub use acceleration::{AccelerationStructure, BlasInput, build_blas, build_tlas};
pub use context::{Context, PATIENCE_NS, Wish};
pub use graphics::{DrawInput, DrawPipeline, Target, change_layout, viewport};
pub use memory::{Buffer, Image, upload_images};
pub use pipeline::{HitGroup, Pipeline, PipelineCache, PipelineInput};
