//! Copies, fills, clears, blits and resolves of buffers and images.

#![forbid(unsafe_code)]

use ash::vk;

use super::matrix::MatrixConversion;
use crate::handle::Ref;
use crate::object::Image;
use crate::object::render_pass::ResolveMode;

/// A recorded transfer command. Buffers are device addresses of their first byte.
pub enum TransferCommand {
    CopyBuffer {
        source: u64,
        destination: u64,
        size_bytes: u64,
    },
    FillBuffer {
        address: u64,
        size_bytes: u64,
        word: u32,
    },
    UpdateBuffer {
        address: u64,
        bytes: Box<[u8]>,
    },
    CopyImage {
        source: Ref<Image>,
        destination: Ref<Image>,
        regions: Vec<vk::ImageCopy>,
    },
    CopyBufferToImage {
        /// Device address of the buffer's first byte.
        source: u64,
        destination: Ref<Image>,
        regions: Vec<vk::BufferImageCopy>,
    },
    /// `vkCmdConvertCooperativeVectorMatrixNV`.
    ConvertMatrices(Vec<MatrixConversion>),
    /// `vkCmdCopyMemoryIndirectKHR`.
    CopyMemoryIndirect {
        parameters: Parameters,
        count: u32,
    },
    /// `vkCmdCopyMemoryToImageIndirectKHR`.
    CopyMemoryToImageIndirect {
        parameters: Parameters,
        destination: Ref<Image>,
        /// One element a copy: its destination layers, as recorded.
        layers: Vec<vk::ImageSubresourceLayers>,
    },
    CopyImageToBuffer {
        source: Ref<Image>,
        /// Device address of the buffer's first byte.
        destination: u64,
        regions: Vec<vk::BufferImageCopy>,
    },
    BlitImage {
        source: Ref<Image>,
        destination: Ref<Image>,
        regions: Vec<vk::ImageBlit>,
        filter: vk::Filter,
    },
    ResolveImage {
        source: Ref<Image>,
        destination: Ref<Image>,
        regions: Vec<vk::ImageResolve>,
        /// How stencil values are resolved.
        stencil: ResolveMode,
        /// How colors and depths are resolved.
        other: ResolveMode,
    },
    ClearColorImage {
        image: Ref<Image>,
        value: vk::ClearColorValue,
        ranges: Vec<vk::ImageSubresourceRange>,
    },
    ClearDepthStencilImage {
        image: Ref<Image>,
        value: vk::ClearDepthStencilValue,
        ranges: Vec<vk::ImageSubresourceRange>,
    },
}

/// Parameters of copies in memory, evenly spaced.
#[derive(Clone, Copy, Debug)]
pub struct Parameters {
    /// Device address of the first copy's parameters.
    pub address: u64,
    pub stride_bytes: u64,
}

impl Parameters {
    /// The device address of one copy's parameters.
    pub fn of(&self, index: u32) -> u64 {
        self.address
            .wrapping_add(self.stride_bytes.wrapping_mul(index.into()))
    }
}
