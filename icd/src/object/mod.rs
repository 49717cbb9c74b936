//! What lies behind the handles.

pub mod acceleration_structure;
pub mod buffer;
pub mod descriptor;
pub mod device;
pub mod image;
pub mod instance;
pub mod memory;
pub mod micromap;
pub mod physical_device;
pub mod pipeline;
pub mod private_data;
pub mod query;
pub mod ray_tracing_pipeline;
pub mod sampler;
pub mod shader_stage;
pub mod sparse;
pub mod sync;

pub use acceleration_structure::AccelerationStructure;
pub use buffer::{Buffer, BufferView};
pub use descriptor::{
    DescriptorPool, DescriptorSet, DescriptorSetLayout, DescriptorUpdateTemplate,
};
pub use device::Device;
pub use image::{Image, ImageView};
pub use instance::{Instance, Messenger};
pub use memory::DeviceMemory;
pub use micromap::Micromap;
pub use physical_device::PhysicalDevice;
pub use pipeline::{Pipeline, PipelineCache, PipelineLayout, ShaderModule};
pub use private_data::PrivateDataSlot;
pub use query::QueryPool;
pub use sampler::Sampler;
pub use sync::{Event, Fence, Semaphore};

use crate::handle::handled;

/// `VkDeferredOperationKHR`.
pub struct DeferredOperation;

handled!(
    AccelerationStructure => AccelerationStructureKHR,
    Buffer => Buffer,
    BufferView => BufferView,
    DeferredOperation => DeferredOperationKHR,
    DescriptorPool => DescriptorPool,
    DescriptorSet => DescriptorSet,
    DescriptorSetLayout => DescriptorSetLayout,
    DescriptorUpdateTemplate => DescriptorUpdateTemplate,
    Device => Device,
    DeviceMemory => DeviceMemory,
    Event => Event,
    Fence => Fence,
    Image => Image,
    ImageView => ImageView,
    Instance => Instance,
    Messenger => DebugUtilsMessengerEXT,
    Micromap => MicromapEXT,
    PhysicalDevice => PhysicalDevice,
    Pipeline => Pipeline,
    PipelineCache => PipelineCache,
    PipelineLayout => PipelineLayout,
    PrivateDataSlot => PrivateDataSlot,
    QueryPool => QueryPool,
    Sampler => Sampler,
    Semaphore => Semaphore,
    ShaderModule => ShaderModule,
    crate::queue::Queue => Queue,
    crate::command::CommandBuffer => CommandBuffer,
    crate::command::CommandPool => CommandPool,
);
