//! Graphics commands. A device without a graphics queue has their entry points all the same, because its Vulkan version has them
//! (`vkGetDeviceProcAddr`), but every use is invalid: pipelines need a graphics queue family (VUID-vkCreateGraphicsPipelines-device-09662),
//! commands a command pool of one. They are answered with `VK_ERROR_VALIDATION_FAILED` and one message.

use ash::vk;

use super::define::entry;
use super::destroy;
use crate::command::CommandBuffer;
use crate::decode::render_pass::{framebuffer, render_pass, render_pass2};
use crate::device::Device;
use crate::ffi::array::slice_mut;
use crate::guard::guard;
use crate::handle::{self, from_handle};
use crate::object::{Framebuffer, RenderPass};

destroy! {
    vkDestroyFramebuffer: Framebuffer, Framebuffer;
    vkDestroyRenderPass: RenderPass, RenderPass;
}

/// Defines recorded commands that only command buffers for graphics queues may have: by name and the types of their further arguments.
macro_rules! refused {
    ($because:literal: $($name:ident($($ty:ty),*);)+) => {$(
        #[allow(non_snake_case, reason = "entry points keep their C names")]
        pub(crate) unsafe extern "system" fn $name(buffer: vk::CommandBuffer $(, _: $ty)*) {
            guard(stringify!($name), || {
                // SAFETY: the handle is a live command buffer.
                let buffer = unsafe { from_handle::<CommandBuffer>(buffer) };
                buffer.refuse(stringify!($name), $because);
            });
        }
    )+};
}

refused! {
    "no queue family of this device supports graphics":
    vkCmdBeginRenderPass(*const vk::RenderPassBeginInfo<'_>, vk::SubpassContents);
    vkCmdBeginRenderPass2(*const vk::RenderPassBeginInfo<'_>, *const vk::SubpassBeginInfo<'_>);
    vkCmdBeginRendering(*const vk::RenderingInfo<'_>);
    vkCmdBindIndexBuffer(vk::Buffer, vk::DeviceSize, vk::IndexType);
    vkCmdBindIndexBuffer2KHR(vk::Buffer, vk::DeviceSize, vk::DeviceSize, vk::IndexType);
    vkCmdBindIndexBuffer3KHR(*const std::ffi::c_void);
    vkCmdBindVertexBuffers3KHR(u32, u32, *const std::ffi::c_void);
    vkCmdDrawIndexedIndirect2KHR(*const std::ffi::c_void);
    vkCmdDrawIndexedIndirectCount2KHR(*const std::ffi::c_void);
    vkCmdDrawIndirect2KHR(*const std::ffi::c_void);
    vkCmdDrawIndirectCount2KHR(*const std::ffi::c_void);
    vkCmdBindVertexBuffers(u32, u32, *const vk::Buffer, *const vk::DeviceSize);
    vkCmdBindVertexBuffers2(u32, u32, *const vk::Buffer, *const vk::DeviceSize, *const vk::DeviceSize, *const vk::DeviceSize);
    vkCmdClearAttachments(u32, *const vk::ClearAttachment, u32, *const vk::ClearRect);
    vkCmdDraw(u32, u32, u32, u32);
    vkCmdDrawIndexed(u32, u32, u32, i32, u32);
    vkCmdDrawIndexedIndirect(vk::Buffer, vk::DeviceSize, u32, u32);
    vkCmdDrawIndexedIndirectCount(vk::Buffer, vk::DeviceSize, vk::Buffer, vk::DeviceSize, u32, u32);
    vkCmdDrawIndirect(vk::Buffer, vk::DeviceSize, u32, u32);
    vkCmdDrawIndirectCount(vk::Buffer, vk::DeviceSize, vk::Buffer, vk::DeviceSize, u32, u32);
    vkCmdEndRenderPass();
    vkCmdEndRenderPass2(*const vk::SubpassEndInfo<'_>);
    vkCmdEndRendering();
    vkCmdNextSubpass(vk::SubpassContents);
    vkCmdNextSubpass2(*const vk::SubpassBeginInfo<'_>, *const vk::SubpassEndInfo<'_>);
    vkCmdSetBlendConstants(*const [f32; 4]);
    vkCmdSetCullMode(vk::CullModeFlags);
    vkCmdSetDepthBias(f32, f32, f32);
    vkCmdSetDepthBiasEnable(vk::Bool32);
    vkCmdSetDepthBounds(f32, f32);
    vkCmdSetDepthBoundsTestEnable(vk::Bool32);
    vkCmdSetDepthCompareOp(vk::CompareOp);
    vkCmdSetDepthTestEnable(vk::Bool32);
    vkCmdSetDepthWriteEnable(vk::Bool32);
    vkCmdSetFrontFace(vk::FrontFace);
    vkCmdSetLineWidth(f32);
    vkCmdSetPrimitiveRestartEnable(vk::Bool32);
    vkCmdSetPrimitiveTopology(vk::PrimitiveTopology);
    vkCmdSetRasterizerDiscardEnable(vk::Bool32);
    vkCmdSetScissor(u32, u32, *const vk::Rect2D);
    vkCmdSetScissorWithCount(u32, *const vk::Rect2D);
    vkCmdSetStencilCompareMask(vk::StencilFaceFlags, u32);
    vkCmdSetStencilOp(vk::StencilFaceFlags, vk::StencilOp, vk::StencilOp, vk::StencilOp, vk::CompareOp);
    vkCmdSetStencilReference(vk::StencilFaceFlags, u32);
    vkCmdSetStencilTestEnable(vk::Bool32);
    vkCmdSetStencilWriteMask(vk::StencilFaceFlags, u32);
    vkCmdSetViewport(u32, u32, *const vk::Viewport);
    vkCmdSetViewportWithCount(u32, *const vk::Viewport);
}

refused! {
    "there are no queries here that begin and end":
    vkCmdBeginQuery(vk::QueryPool, u32, vk::QueryControlFlags);
    vkCmdEndQuery(vk::QueryPool, u32);
}

entry! {
    fn vkCreateGraphicsPipelines(
        device: vk::Device,
        _cache: vk::PipelineCache,
        count: u32,
        _infos: *const vk::GraphicsPipelineCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Pipeline,
    ) -> vk::Result {
        slice_mut(out, count).fill(vk::Pipeline::null());
        let device = from_handle::<Device>(device);
        device.messengers.error(
            c"TUFF-no-graphics",
            "vkCreateGraphicsPipelines: no queue family of this device supports graphics",
        );
        Err(vk::Result::ERROR_VALIDATION_FAILED_EXT)
    }

    fn vkCreateRenderPass(
        _device: vk::Device,
        info: *const vk::RenderPassCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::RenderPass,
    ) -> vk::Result {
        *out = handle::create(render_pass(&*info));
        Ok(())
    }

    fn vkCreateRenderPass2(
        _device: vk::Device,
        info: *const vk::RenderPassCreateInfo2,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::RenderPass,
    ) -> vk::Result {
        *out = handle::create(render_pass2(&*info));
        Ok(())
    }

    fn vkCreateFramebuffer(
        _device: vk::Device,
        info: *const vk::FramebufferCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Framebuffer,
    ) -> vk::Result {
        *out = handle::create(framebuffer(&*info));
        Ok(())
    }

    fn vkGetRenderAreaGranularity(_device: vk::Device, _render_pass: vk::RenderPass, out: *mut vk::Extent2D) {
        *out = vk::Extent2D { width: 1, height: 1 };
    }

    /// `samplerYcbcrConversion` is not a feature here.
    fn vkCreateSamplerYcbcrConversion(
        device: vk::Device,
        _info: *const vk::SamplerYcbcrConversionCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::SamplerYcbcrConversion,
    ) -> vk::Result {
        *out = vk::SamplerYcbcrConversion::null();
        let device = from_handle::<Device>(device);
        device.messengers.error(
            c"TUFF-no-ycbcr",
            "vkCreateSamplerYcbcrConversion: the feature samplerYcbcrConversion is not there",
        );
        Err(vk::Result::ERROR_VALIDATION_FAILED_EXT)
    }

    /// None exist, so the handle is null.
    fn vkDestroySamplerYcbcrConversion(
        _device: vk::Device,
        _conversion: vk::SamplerYcbcrConversion,
        _allocator: *const vk::AllocationCallbacks,
    ) {
    }
}
