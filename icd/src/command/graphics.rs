//! Commands of graphics: passes, state, buffers, draws, queries.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::program::Stage;

use super::pass::{AttachmentClears, Pass};
use crate::handle::Ref;
use crate::object::setting::Setting;
use crate::object::{QueryPool, ShaderObject};

/// A recorded command of graphics.
pub enum GraphicsCommand {
    /// `vkCmdBeginRendering`, or a subpass begins.
    BeginPass(Box<Pass>),
    /// `vkCmdEndRendering`, or a subpass ends.
    EndPass,
    /// A barrier inside a pass whose destination includes a vertex stage.
    VertexBarrier,
    /// A barrier inside a pass whose destination includes the fragment shader, and no vertex stage.
    FragmentBarrier,
    ClearAttachments(Box<AttachmentClears>),
    Set(Setting),
    /// `vkCmdBindShadersEXT`, one stage of drawing.
    BindShader(Stage, Option<Ref<ShaderObject>>),
    /// `vkCmdBindVertexBuffers2`.
    BindVertexBuffers(Box<BindVertexBuffers>),
    /// `vkCmdBindIndexBuffer2`.
    BindIndexBuffer(IndexBinding),
    /// `vkCmdSetPrimitiveRestartIndexEXT`: until an index buffer is bound.
    RestartIndex(u32),
    /// `vkCmdDraw`, `vkCmdDrawIndexed`.
    Draw(Draw),
    /// `vkCmdDrawMultiEXT`, `vkCmdDrawMultiIndexedEXT`.
    DrawMulti(Box<DrawMulti>),
    /// `vkCmdDrawMeshTasksEXT`: workgroups per dimension.
    DrawMeshes([u32; 3]),
    /// `vkCmdDraw*Indirect*`.
    DrawIndirect(DrawIndirect),
    /// `vkCmdBeginConditionalRenderingEXT`.
    BeginConditional {
        /// Device address of a word.
        address: u64,
        inverted: bool,
    },
    EndConditional,
    /// `vkCmdBindTransformFeedbackBuffersEXT`.
    BindCaptureBuffers(Box<CaptureBinding>),
    /// `vkCmdBeginTransformFeedbackEXT`: addresses of counters, 0 for none, from a buffer on.
    BeginCapture(u32, SmallVec<[u64; 4]>),
    EndCapture(u32, SmallVec<[u64; 4]>),
    /// `vkCmdDrawIndirectByteCountEXT`.
    DrawByteCount(DrawByteCount),
    BeginQuery {
        pool: Ref<QueryPool>,
        query: u32,
        /// The vertex stream whose primitives it counts.
        stream: u32,
    },
    EndQuery {
        pool: Ref<QueryPool>,
        query: u32,
    },
}

/// Where vertices come from.
pub struct BindVertexBuffers {
    pub first: u32,
    pub buffers: SmallVec<[VertexBinding; 4]>,
}

/// A bound vertex buffer.
#[derive(Clone, Copy, Debug, Default)]
pub struct VertexBinding {
    /// Device address at its offset; 0 for none.
    pub address: u64,
    /// From there on.
    pub size_bytes: u64,
    /// Where the command has one.
    pub stride_bytes: Option<u64>,
}

/// A bound index buffer.
#[derive(Clone, Copy, Debug)]
pub struct IndexBinding {
    /// Device address at its offset; 0 for none.
    pub address: u64,
    /// From there on.
    pub size_bytes: u64,
    pub ty: vk::IndexType,
}

/// Buffers for transform feedback.
pub struct CaptureBinding {
    pub first: u32,
    /// Device addresses, and bytes from there on.
    pub buffers: SmallVec<[(u64, u64); 4]>,
}

/// A draw of as many vertices as were captured.
#[derive(Clone, Copy, Debug)]
pub struct DrawByteCount {
    pub first_instance: u32,
    pub instances: u32,
    /// Device address of the counter; 0 for none.
    pub counter: u64,
    /// Subtracted from the counter.
    pub offset_bytes: u32,
    pub stride_bytes: u32,
}

/// A draw whose numbers stand in the command.
#[derive(Clone, Copy, Debug)]
pub struct Draw {
    pub indexed: bool,
    /// First vertex, or first index.
    pub first: u32,
    /// Vertices, or indices.
    pub count: u32,
    /// Of an indexed draw.
    pub vertex_offset: i32,
    pub first_instance: u32,
    pub instances: u32,
}

/// Several draws with one command.
pub struct DrawMulti {
    pub indexed: bool,
    /// First, count, vertex offset.
    pub draws: Box<[(u32, u32, i32)]>,
    pub first_instance: u32,
    pub instances: u32,
}

/// The structure in which the numbers of a draw stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Numbers {
    /// `VkDrawIndirectCommand`.
    Vertices,
    /// `VkDrawIndexedIndirectCommand`.
    Indices,
    /// `VkDrawMeshTasksIndirectCommandEXT`.
    Workgroups,
}

/// Draws whose numbers stand in memory.
#[derive(Clone, Copy, Debug)]
pub struct DrawIndirect {
    pub numbers: Numbers,
    /// Device address of the first structure.
    pub address: u64,
    pub stride_bytes: u32,
    /// At most.
    pub draws: u32,
    /// Device address of their number, if that stands in memory, too.
    pub count: Option<u64>,
}
