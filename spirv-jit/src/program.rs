//! Compiled shaders, and how they are run: the seam between the compiler and the scheduler.
//!
//! A *subgroup state* is one contiguous, 64-byte-aligned block of rows, each row 16 lanes of one 32-bit word:
//!
//! ```text
//! [ control | inputs | io: a yield's operands and results, or outputs | private memory | live values ]
//! ```
//!
//! The scheduler owns the block, fills `inputs`, calls [`Program::start`], then [`Program::run`] with one or more subgroups
//! that stand at the same [`ResumePoint`]. At a yield it reads operands from the `io` rows and writes results over them; at the end it reads outputs there.
//! Nothing else in the block is its business, and no other crate knows which tier ran.

use std::sync::Arc;

use crate::accuracy::Accuracy;
use crate::environment::Environment;
use crate::error::Error;
use crate::hit_object::HitFact;
use crate::ir;

pub use crate::ir::interface::{
    Barycentric, DepthMode, FragmentFacts, Interlock, OutputRow, Position, Varying, VaryingMode,
    VaryingPlace,
};
pub use crate::ir::module::InputRow;
pub use crate::ir::passed::Passed;

/// Shader stages (SPIR-V execution models) that exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    Compute,
    RayGeneration,
    Intersection,
    AnyHit,
    ClosestHit,
    Miss,
    Callable,
    Vertex,
    Fragment,
}

/// Built-in inputs that arrive per lane in the input record. 32-bit words each; vectors and matrices (column-major) by component.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Builtin {
    /// 3 words.
    LaunchId,
    /// 3 words each: compute.
    WorkgroupId,
    LocalInvocationId,
    /// 1 word: compute.
    LocalInvocationIndex,
    /// 3 words: compute.
    GlobalInvocationId,
    /// 1 word each: compute.
    SubgroupId,
    NumSubgroups,
    PrimitiveId,
    InstanceId,
    InstanceCustomIndex,
    GeometryIndex,
    /// 3 f32 each.
    WorldRayOrigin,
    WorldRayDirection,
    ObjectRayOrigin,
    ObjectRayDirection,
    RayTmin,
    RayTmax,
    IncomingRayFlags,
    CullMask,
    HitKind,
    /// 4 columns of 3 f32.
    ObjectToWorld,
    WorldToObject,
    /// 3 vertices of 3 f32 (`HitTriangleVertexPositionsKHR`).
    HitTriangleVertexPositions,
    /// 1 f32 (`CurrentRayTimeNV`).
    CurrentRayTime,
    /// 1 word each, not 0 for true (`HitIsSphereNV`, `HitIsLSSNV`).
    HitIsSphere,
    HitIsLss,
    /// 3 f32 and 1 f32 (`HitSpherePositionNV`, `HitSphereRadiusNV`).
    HitSpherePosition,
    HitSphereRadius,
    /// 2 positions of 3 f32, and 2 f32 (`HitLSSPositionsNV`, `HitLSSRadiiNV`).
    HitLssPositions,
    HitLssRadii,
    /// 2 words: device address of the shader record (after the handle).
    ShaderRecordAddress,
    /// 1 word each: vertex.
    VertexIndex,
    InstanceIndex,
    BaseVertex,
    BaseInstance,
    DrawIndex,
    /// 1 word: vertex and fragment.
    ViewIndex,
    /// 4 f32: fragment, as all that follow.
    FragCoord,
    /// 1 word, not 0 for true.
    FrontFacing,
    /// 2 f32.
    PointCoord,
    /// 1 word.
    SampleId,
    /// 2 f32.
    SamplePosition,
    /// 1 word: the covered samples of the invocation.
    SampleMask,
    /// 1 word each.
    Layer,
    ViewportIndex,
    /// 1 word: the layer of input attachments, which is the one that is drawn to.
    AttachmentLayer,
    /// 1 word: samples of the attachments.
    SampleCount,
    /// 9 f32 each: at the pixel's centre, the three planes whose quotients by their sum are perspective-correct barycentric coordinates, or
    /// that are the linear ones; then their derivatives in x, then in y.
    PerspectivePlanes,
    LinearPlanes,
}

/// What is needed to turn a module's entry point into a program.
pub struct CompileRequest<'a> {
    pub words: &'a [u32],
    pub entry_point: &'a str,
    pub stage: Stage,
    /// `SpecId` and its bytes (`VkSpecializationMapEntry`; booleans as `VkBool32`).
    pub specialization: &'a [(u32, &'a [u8])],
    /// Where each (set, binding) lies in the pipeline layout; a pair that gives `None` is a null descriptor.
    pub bindings: &'a dyn Fn(u32, u32) -> Option<ir::op::DescriptorBinding>,
    /// What the device has enabled; anything a module declares beyond it is refused.
    pub capabilities: &'a [rspirv::spirv::Capability],
    pub accuracy: Accuracy,
    /// Whether accesses through physical pointers say when those are less aligned than the module promises.
    pub checks_alignment: bool,
}

/// Compiles one entry point.
///
/// # Errors
/// See [`ErrorKind`](crate::error::ErrorKind). Never panics, whatever the words are; time and memory are bounded in proportion to the module.
pub fn compile(request: &CompileRequest<'_>) -> Result<Arc<Program>, Error> {
    Program::new(&compile_module(request)?).map(Arc::new)
}

/// Compiles one entry point as far as [`compile`] does without looking at the machine: what a cache keeps.
///
/// # Errors
/// As [`compile`].
pub fn compile_module(request: &CompileRequest<'_>) -> Result<ir::Module, Error> {
    let parsed = crate::parse::parse(request.words)?;
    let mut module = crate::lower::lower_module(&parsed, request)?;
    crate::pass::optimize(&mut module)?;
    Ok(module)
}

/// A program from the bytes of an optimised module ([`ir::binary::encode`]).
///
/// # Errors
/// Bytes that are no valid module. Never panics.
pub fn from_bytes(bytes: &[u8]) -> Result<Arc<Program>, Error> {
    let module = ir::binary::decode(bytes).map_err(Error::not_a_module)?;
    ir::verify(&module).map_err(Error::not_a_module)?;
    Program::new(&module).map(Arc::new)
}

/// Where subgroups go on: subgroups of one program at equal points may run in one wave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ResumePoint(pub u32);

/// Why a run came back. All subgroups of the run stand at `site`/the end; lanes that take part in the event are those of
/// [`Program::event_mask`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// All lanes of all subgroups have ended; outputs stand in the `io` rows.
    End,
    /// Suspended at a yield.
    Yield(SiteId),
    /// Fuel ran out at a loop back-edge: run again to go on.
    OutOfFuel,
    /// The frame's memory was refused; nothing was run.
    OutOfMemory,
}

/// A yield in the program text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SiteId(pub u32);

/// What a yield asks for. Rows count from the start of the `io` rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SiteKind {
    /// Rows 0..15: the ray (see `Op::TraceRay`); row 15: unused; rows 16..16+n: payload, in and out.
    TraceRay { payload_words: u32 },
    /// Row 0: t; row 1: hit kind; rows 16..16+n: attribute. The verdict goes to row 0: 0 rejected, 1 accepted,
    /// 2 accepted and the search is over: the invocation ends here instead of going on (as after `OpTerminateRayKHR` in its any-hit shader).
    ReportIntersection { attribute_words: u32 },
    /// Row 0: callable index; rows 16..16+n: data, in and out.
    ExecuteCallable { data_words: u32 },
    /// As `TraceRay`, with the time in row 15.
    TraceRayMotion { payload_words: u32 },
    /// As `TraceRay`, up to the hit or miss: rows 0..16 of the answer are the words that [`TRACED`](crate::hit_object::TRACED) lists.
    HitObjectTraceRay { payload_words: u32 },
    /// As `HitObjectTraceRay`, with the time in row 15.
    HitObjectTraceRayMotion { payload_words: u32 },
    /// Rows 0..16: the first words of the hit object; rows 16..16+n: payload, in and out; then the hit object's other words.
    HitObjectExecute { payload_words: u32 },
    /// Rows 0..9: the words that [`IDENTITY`](crate::hit_object::IDENTITY) lists; the answer goes to the rows from 0 on.
    HitObjectGet { fact: HitFact },
    /// Row 0: hint; row 1: its bits; row 2: kind of the hit object, or all ones without one; row 3: its record index.
    ReorderThread,
    /// Workgroup barrier.
    Barrier,
    /// Row 0: the first private row of a ray query's object ([`crate::query`]), which is read and rewritten there; then, over it, 1 if the
    /// query stands at a candidate, or 0. The lanes' memory is [`Program::private_rows`].
    RayQueryProceed,
}

/// First `io` row of payload, attribute and callable data at every site.
pub const IO_DATA_ROW: usize = 16;

/// Sizes, in rows of 16 × 32 bits, of the parts of a subgroup's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct StateLayout {
    /// First input row.
    pub inputs: usize,
    /// First `io` row.
    pub io: usize,
    /// Total.
    pub rows: usize,
}

pub use crate::interp::{Frame, Program};

/// One row of a subgroup's state: a word per lane.
pub type Row = [u32; crate::SUBGROUP_SIZE];

/// A wave to run: the states of its subgroups, and what its workgroup shares.
pub struct Wave<'a> {
    /// Each has [`StateLayout::rows`] rows. At most [`Program::max_wave_subgroups`].
    pub states: &'a mut [&'a mut [AlignedRow]],
    /// Compute: workgroup memory.
    pub shared: *mut u8,
    pub environment: &'a Environment,
}

/// A row, aligned to a cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AlignedRow(pub Row);
