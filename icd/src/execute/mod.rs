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

pub mod acceleration_structure;
pub mod ray_tracing;
