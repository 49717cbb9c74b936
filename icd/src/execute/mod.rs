//! Performs recorded commands, in order, on a queue's thread.
//!
//! Each kind of work is a function of what the command holds. Those on images take the objects and the regions as recorded:
//!
//! ```text
//! copy::copy_image(source: &Image, destination: &Image, region: &vk::ImageCopy)
//! copy::copy_buffer_to_image(source: u64, destination: &Image, region: &vk::BufferImageCopy)
//! copy::copy_image_to_buffer(source: &Image, destination: u64, region: &vk::BufferImageCopy)
//! blit::blit_image(source: &Image, destination: &Image, region: &vk::ImageBlit, filter: vk::Filter)
//! resolve::resolve_image(source: &Image, destination: &Image, region: &vk::ImageResolve)
//! clear::clear_color_image(image: &Image, value: &vk::ClearColorValue, range: &vk::ImageSubresourceRange)
//! clear::clear_depth_stencil_image(image: &Image, value: &vk::ClearDepthStencilValue, range: &vk::ImageSubresourceRange)
//! ```
//!
//! Buffers are device addresses of their first byte.
//!
//! Commands of one queue run to their end one after the other, and memory is the host's own and coherent. Execution and memory
//! dependencies inside a queue therefore hold by themselves: pipeline barriers and image layout transitions are not even recorded.
//! Between queues, and to the host, the locks of semaphores and fences order memory.

pub mod bindings;
mod dispatch;
mod engine;
mod memory;
pub mod query;
mod replay;

pub use bindings::Bindings;
pub use engine::Engine;
pub use query::timestamp;
pub use replay::replay;
