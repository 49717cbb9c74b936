//! Graphics commands: passes, state, buffers, draws, queries.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::program::Stage;

use super::pass::{AttachmentClears, Pass};
use crate::handle::Ref;
use crate::object::setting::Setting;
use crate::object::{QueryPool, ShaderObject};

/// A recorded graphics command.
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
    /// `vkCmdSetPrimitiveRestartIndexEXT`, in effect until an index buffer is bound.
    RestartIndex(u32),
    /// `vkCmdDraw`, `vkCmdDrawIndexed`, `vkCmdDrawMeshTasksEXT`.
    Draw {
        indexed: bool,
        call: DrawCall,
    },
    /// `vkCmdDrawMultiEXT`, `vkCmdDrawMultiIndexedEXT`.
    DrawMulti(Box<DrawMulti>),
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
    BindFeedbackBuffers(Box<FeedbackBinding>),
    /// `vkCmdBeginTransformFeedbackEXT`: the first buffer, and device addresses of counters, 0 for
    /// none.
    BeginFeedback(u32, SmallVec<[u64; 4]>),
    EndFeedback(u32, SmallVec<[u64; 4]>),
    /// `vkCmdDrawIndirectByteCountEXT`.
    DrawByteCount(DrawByteCount),
    BeginQuery {
        pool: Ref<QueryPool>,
        query: u32,
        /// The vertex stream whose primitives the query counts.
        stream: u32,
    },
    EndQuery {
        pool: Ref<QueryPool>,
        query: u32,
    },
}

/// The vertex buffers to bind.
pub struct BindVertexBuffers {
    pub first: u32,
    pub buffers: SmallVec<[VertexBinding; 4]>,
}

/// A bound vertex buffer.
#[derive(Clone, Copy, Debug, Default)]
pub struct VertexBinding {
    /// Device address at the offset; 0 for none.
    pub address: u64,
    /// Size from that address.
    pub size_bytes: u64,
    /// The stride, if the command sets one.
    pub stride_bytes: Option<u64>,
}

/// A bound index buffer.
#[derive(Clone, Copy, Debug)]
pub struct IndexBinding {
    /// Device address at the offset; 0 for none.
    pub address: u64,
    /// Size from that address.
    pub size_bytes: u64,
    pub ty: vk::IndexType,
}

/// Buffers for transform feedback.
pub struct FeedbackBinding {
    pub first: u32,
    /// Device addresses and sizes.
    pub buffers: SmallVec<[(u64, u64); 4]>,
}

/// A draw of all captured vertices.
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

/// The parameters of a draw, from its command or from an indirect buffer.
#[derive(Clone, Copy, Debug)]
pub struct DrawCall {
    /// First vertex, or first index.
    pub first: u32,
    /// Vertices, indices or workgroups.
    pub count: u32,
    /// Added to each index.
    pub vertex_offset: i32,
    pub first_instance: u32,
    pub instances: u32,
    /// `DrawIndex`.
    pub draw_index: u32,
    /// Of a draw of workgroups: how many per dimension; `count` is their product.
    pub groups: [u32; 3],
}

impl DrawCall {
    /// A call of workgroups.
    pub fn of_groups(groups: [u32; 3], draw_index: u32) -> Self {
        Self {
            first: 0,
            count: groups
                .iter()
                .fold(1, |all, &count| all.saturating_mul(count)),
            vertex_offset: 0,
            first_instance: 0,
            instances: 1,
            draw_index,
            groups,
        }
    }
}

/// Several draws with one command.
pub struct DrawMulti {
    pub indexed: bool,
    /// First, count, vertex offset.
    pub draws: Box<[(u32, u32, i32)]>,
    pub first_instance: u32,
    pub instances: u32,
}

/// The structure of a draw's parameters in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Numbers {
    /// `VkDrawIndirectCommand`.
    Vertices,
    /// `VkDrawIndexedIndirectCommand`.
    Indices,
    /// `VkDrawMeshTasksIndirectCommandEXT`.
    Workgroups,
}

/// Draws with parameters in memory.
#[derive(Clone, Copy, Debug)]
pub struct DrawIndirect {
    pub numbers: Numbers,
    /// Device address of the first structure.
    pub address: u64,
    pub stride_bytes: u32,
    /// The largest number of draws.
    pub draws: u32,
    /// Device address of the draw count, if it is in memory, too.
    pub count: Option<u64>,
}
