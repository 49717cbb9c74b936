//! Drawing: points, lines and triangles into the attachments of a pass.
//!
//! ```text
//! draw, clear ──> batch ──(flush)──> front: chunks of primitives ──> tiles: coverage, tests, fragments, output
//!                                      any worker, any chunk            one worker a tile, chunks in order
//! ```
//!
//! Inside a pass work is deferred: draws and clears of attachments gather in a [`Batch`] until a
//! flush. Then the *front end* turns draws into [`Chunk`]s side by side, and after all of them the
//! *tiles* are worked off side by side, each of them through all chunks in order, straight into the
//! images. So the order of primitives holds at every sample by construction, whatever the number of
//! threads.
//!
//! Who flushes: the end of the pass, a barrier whose destination includes a vertex stage, the end
//! of a query, a timestamp, and a batch that has grown to [`BATCH_DRAWS`]. A draw of many
//! primitives is worked off in several rounds of up to [`ROUND_CHUNKS`] chunks.

pub mod front;
pub mod primitive;
pub mod tile;
pub mod transform_feedback;

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::environment::Environment;

pub use crate::command::graphics::DrawCall;
use crate::object::graphics_pipeline::Stages;
use crate::object::graphics_state::{
    GraphicsState, MAX_COLOR_ATTACHMENTS, MAX_VERTEX_INPUTS, UsedAttachments,
};
use crate::transfer::surface::Surface;
use crate::wave::launch_counts::LaunchCounts;
use crate::wave::{Limits, Stopped, Workers};
pub use primitive::Chunk;
pub use transform_feedback::TransformFeedback;

/// Draws and clears of a batch, at most.
pub const BATCH_DRAWS: usize = 4096;

/// Primitives of a job, at most. Its chunk has no more, except where a geometry shader makes them.
pub const CHUNK_PRIMITIVES: usize = 1024;

/// Chunks between two phases of tiles, at most: what bins may take follows from the count alone.
pub const ROUND_CHUNKS: usize = 128;

/// Pixels of a tile's side.
pub const TILE: u32 = 64;

/// An attachment as tiles see it.
#[derive(Clone, Copy)]
pub struct Target {
    /// The level of the view, with the view's format in the place of the image's.
    pub surface: Surface,
    /// The view's first layer (or slice).
    pub first_layer: u32,
    pub layers: u32,
}

/// The attachments of a pass. All have the same number of samples, except resolve attachments,
/// which the caller handles.
pub struct Targets {
    /// Drawing stays inside; already within all attachments.
    pub area: vk::Rect2D,
    /// Layers that can be drawn to; with views, at least the highest view's number plus one.
    pub layers: u32,
    /// Views to draw to (`viewMask`), or 0.
    pub view_mask: u32,
    pub samples: u32,
    /// Depths of floating-point attachments are clamped to 0 to 1, too (`depthClampZeroOne`).
    pub clamps_to_one: bool,
    pub colors: [Option<Target>; MAX_COLOR_ATTACHMENTS],
    pub depth: Option<Target>,
    pub stencil: Option<Target>,
    /// Of fragment shading rates: a byte for each square of pixels (`RATE_TEXEL`). The pass only
    /// reads it.
    pub rates: Option<Target>,
}

impl Targets {
    /// The same without the attachments that a pipeline has no format for.
    pub fn used_by(&self, used: &UsedAttachments) -> Targets {
        Targets {
            colors: std::array::from_fn(|index| {
                self.colors[index].filter(|_| used.colors >> index & 1 != 0)
            }),
            depth: self.depth.filter(|_| used.depth),
            stencil: self.stencil.filter(|_| used.stencil),
            ..*self
        }
    }
}

/// A bound vertex buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VertexBuffer {
    /// Device address of its first byte at its offset; 0: null, reads give zeros.
    pub address: u64,
    /// Bytes from there on. Attributes that reach past it read zeros (`robustBufferAccess`).
    pub size_bytes: u64,
    /// In the place of
    /// [`VertexBinding::stride_bytes`](crate::object::graphics_state::VertexBinding), where that is
    /// dynamic.
    pub stride_bytes: Option<u64>,
}

/// A bound index buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IndexBuffer {
    pub address: u64,
    /// Indices past it read 0.
    pub size_bytes: u64,
    pub ty: vk::IndexType,
    /// In the place of the type's largest number (`VK_EXT_primitive_restart_index`).
    pub restart: Option<u32>,
}

/// The counters of active queries, shared by all draws of a pass.
#[derive(Default)]
pub struct Counters {
    /// Samples that passed all tests.
    pub samples: AtomicU64,
    pub input_vertices: AtomicU64,
    pub input_primitives: AtomicU64,
    pub vertex_invocations: AtomicU64,
    pub control_patches: AtomicU64,
    pub evaluation_invocations: AtomicU64,
    pub geometry_invocations: AtomicU64,
    pub geometry_primitives: AtomicU64,
    pub task_invocations: AtomicU64,
    pub mesh_invocations: AtomicU64,
    /// Primitives of mesh shaders.
    pub mesh_primitives: AtomicU64,
    pub clipping_invocations: AtomicU64,
    pub clipping_primitives: AtomicU64,
    pub fragment_invocations: AtomicU64,
    /// The stream that the counters below are of.
    pub stream: u32,
    /// Primitives of the last stage before rasterization.
    pub generated: AtomicU64,
    /// Those that were to be captured while transform feedback was active, and those that were.
    pub needed: AtomicU64,
    pub written: AtomicU64,
}

/// Draws that share all state. Everything that it points to stays as it is until the next flush.
pub struct Draw {
    /// With a vertex or mesh program.
    pub stages: Arc<Stages>,
    pub state: Arc<GraphicsState>,
    /// Sets, dynamic buffers and push constants, kept by `keep`.
    pub environment: Arc<Environment>,
    /// Owns the data that the environment points to.
    pub keep: Arc<dyn std::any::Any + Send + Sync>,
    pub vertex_buffers: Arc<[VertexBuffer; MAX_VERTEX_INPUTS]>,
    /// Of an indexed draw.
    pub indices: Option<IndexBuffer>,
    pub calls: SmallVec<[DrawCall; 1]>,
    /// Of each active query.
    pub counters: SmallVec<[Arc<Counters>; 1]>,
    /// Transform feedback, if it is active and the last stage before rasterization has the mode.
    pub feedback: Option<Arc<TransformFeedback>>,
}

/// One attachment's part of `vkCmdClearAttachments`, or a load operation.
#[derive(Clone, Copy)]
pub enum ClearValue {
    /// Index of the colour attachment.
    Color(usize, vk::ClearColorValue),
    Depth(f32),
    Stencil(u32),
}

/// A clear inside a pass.
#[derive(Clone)]
pub struct Clear {
    pub value: ClearValue,
    /// Inside the render area.
    pub rects: SmallVec<[vk::ClearRect; 1]>,
}

/// A piece of work of a pass, in order.
pub enum Work {
    Draw(Draw),
    Clear(Clear),
}

/// Work that waits for a flush.
#[derive(Default)]
pub struct Batch {
    pub work: Vec<Work>,
}

impl Batch {
    /// The environments of its draws, which hold what shaders did, and whose those are.
    pub fn watched(&self) -> Vec<(Arc<Environment>, Arc<Stages>)> {
        let watched = self.work.iter().filter_map(|work| match work {
            Work::Draw(draw) => Some((Arc::clone(&draw.environment), Arc::clone(&draw.stages))),
            Work::Clear(_) => None,
        });
        watched.collect()
    }
}

/// The engine and state that a flush uses.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    pub workers: &'a Workers,
    pub limits: &'a Limits,
    /// Where vertex and index buffers may lie.
    pub reach: &'a spirv_jit::reach::Reach,
    /// Counts of each pixel, where a capture keeps them.
    pub counts: Option<&'a LaunchCounts>,
}

/// The device's memory for drawing, kept from one flush to the next.
#[derive(Default)]
pub struct Rasterizer {
    pub front: front::FrontEnd,
    pub tiles: tile::Tiles,
}

impl Rasterizer {
    /// Does all work of a batch, and leaves it empty.
    ///
    /// # Errors
    /// When a limit stopped it; what was drawn so far stays drawn.
    pub fn flush(
        &self,
        context: Context<'_>,
        targets: &Targets,
        batch: &mut Batch,
    ) -> Result<(), Stopped> {
        let work = std::mem::take(&mut batch.work);
        let mut rounds = front::Rounds::new(targets, context.workers.current_num_threads());
        let mut number = 0;
        while let Some(chunks) = self
            .front
            .next_round(context, targets, &work, &mut rounds)?
        {
            self.tiles.run(context, targets, &work, &chunks, number)?;
            self.front.give_back(chunks);
            number += 1;
        }
        Ok(())
    }
}
