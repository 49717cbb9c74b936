//! The objects behind the handles.

pub mod acceleration_structure;
pub mod address_space;
pub mod addressed;
pub mod buffer;
pub mod captured;
pub mod deferred;
pub mod deferred_pipeline;
pub mod descriptor;
pub mod descriptor_heap;
pub mod descriptor_heap_replay;
pub mod dynamic_state;
pub mod embedded_sampler;
pub mod external_sync;
pub mod graphics_pipeline;
pub mod graphics_state;
pub mod image;
pub mod image_view;
pub mod instance;
pub mod live_memory;
pub mod memory;
pub mod messenger;
pub mod micromap;
pub mod page_binds;
pub mod physical_device;
pub mod pipeline;
pub mod pipeline_binary;
pub mod pipeline_cache;
pub mod pipeline_layout;
pub mod private_data;
pub mod query;
pub mod ranges;
pub mod ray_tracing_pipeline;
pub mod render_pass;
pub mod resident;
pub mod sampler;
pub mod setting;
pub mod shader_object;
pub mod shader_stage;
pub mod shading_rate;
pub mod sparse;
pub mod stage_program;
pub mod sync;
mod update_template;
pub mod view_entry;
pub mod ycbcr;

pub use acceleration_structure::{AccelerationStructure, AccelerationStructureNv};
pub use buffer::{Buffer, BufferView};
pub use deferred::DeferredOperation;
pub use descriptor::{DescriptorPool, DescriptorSet, DescriptorSetLayout};
pub use image::Image;
pub use image_view::ImageView;
pub use instance::Instance;
pub use memory::DeviceMemory;
pub use messenger::Messenger;
pub use micromap::Micromap;
pub use physical_device::PhysicalDevice;
pub use pipeline::{Pipeline, ShaderModule};
pub use pipeline_binary::PipelineBinary;
pub use pipeline_cache::PipelineCache;
pub use pipeline_layout::PipelineLayout;
pub use private_data::PrivateDataSlot;
pub use query::QueryPool;
pub use render_pass::{Framebuffer, RenderPass};
pub use sampler::Sampler;
pub use shader_object::ShaderObject;
pub use sync::{Event, Fence, Semaphore};
pub use update_template::DescriptorUpdateTemplate;
pub use ycbcr::YcbcrConversion;

use crate::handle::handled;

handled!(
    AccelerationStructure => AccelerationStructureKHR,
    AccelerationStructureNv => AccelerationStructureNV,
    Buffer => Buffer,
    BufferView => BufferView,
    DeferredOperation => DeferredOperationKHR,
    DescriptorPool => DescriptorPool,
    DescriptorSet => DescriptorSet,
    DescriptorSetLayout => DescriptorSetLayout,
    DescriptorUpdateTemplate => DescriptorUpdateTemplate,
    DeviceMemory => DeviceMemory,
    Event => Event,
    Fence => Fence,
    Framebuffer => Framebuffer,
    Image => Image,
    ImageView => ImageView,
    Instance => Instance,
    Messenger => DebugUtilsMessengerEXT,
    Micromap => MicromapEXT,
    PhysicalDevice => PhysicalDevice,
    Pipeline => Pipeline,
    PipelineBinary => PipelineBinaryKHR,
    PipelineCache => PipelineCache,
    PipelineLayout => PipelineLayout,
    PrivateDataSlot => PrivateDataSlot,
    QueryPool => QueryPool,
    RenderPass => RenderPass,
    Sampler => Sampler,
    Semaphore => Semaphore,
    ShaderModule => ShaderModule,
    ShaderObject => ShaderEXT,
    YcbcrConversion => SamplerYcbcrConversion,
);
