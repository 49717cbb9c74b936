//! Shader stages and the inputs of their invocations.

#![forbid(unsafe_code)]

use crate::facts::Fact;

/// The supported shader stages (SPIR-V execution models).
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
    TessellationControl,
    TessellationEvaluation,
    Geometry,
    Task,
    Mesh,
    Fragment,
}

impl Stage {
    /// Whether invocations form workgroups of the shader's size.
    pub fn has_workgroups(self) -> bool {
        matches!(self, Stage::Compute | Stage::Task | Stage::Mesh)
    }

    /// The integer input words that identify and sort the stage's invocations, the most significant
    /// first. Positions use the integral part.
    pub fn key(self) -> &'static [(Builtin, u8)] {
        use Builtin::*;
        match self {
            Stage::Compute => &[
                (GlobalInvocationId, 2),
                (GlobalInvocationId, 1),
                (GlobalInvocationId, 0),
            ],
            Stage::Vertex => &[
                (DrawIndex, 0),
                (ViewIndex, 0),
                (InstanceIndex, 0),
                (VertexIndex, 0),
            ],
            Stage::Task | Stage::Mesh => &[
                (DrawIndex, 0),
                (ViewIndex, 0),
                (GlobalInvocationId, 2),
                (GlobalInvocationId, 1),
                (GlobalInvocationId, 0),
            ],
            // Samples of a pixel that are shaded separately differ in their masks.
            Stage::Fragment => &[
                (AttachmentLayer, 0),
                (FragCoord, 1),
                (FragCoord, 0),
                (PrimitiveId, 0),
                (SampleMask, 0),
            ],
            _ => &[(LaunchId, 2), (LaunchId, 1), (LaunchId, 0)],
        }
    }

    /// The name of an invocation, from the words of its [`Self::key`].
    pub fn name_invocation(self, key: &[u32]) -> String {
        match (self, key) {
            (Stage::Compute, [z, y, x, ..]) => format!("invocation ({x}, {y}, {z})"),
            (Stage::Vertex, [draw, view, instance, vertex, ..]) => {
                in_draw(format!("vertex {vertex}, instance {instance}"), draw, view)
            }
            (Stage::Task | Stage::Mesh, [draw, view, z, y, x]) => {
                in_draw(format!("invocation ({x}, {y}, {z})"), draw, view)
            }
            (Stage::Fragment, [layer, y, x, primitive, ..]) => {
                let layer = match layer {
                    0 => String::new(),
                    layer => format!(", layer {layer}"),
                };
                format!("fragment ({x}, {y}){layer}, primitive {primitive}")
            }
            (_, [z, y, x, ..]) => format!("launch ({x}, {y}, {z})"),
            _ => String::new(),
        }
    }
}

/// Adds the draw and the view to the name of an invocation, where they are not the first.
fn in_draw(mut name: String, draw: &u32, view: &u32) -> String {
    for (what, number) in [("draw", draw), ("view", view)] {
        if *number > 0 {
            name += &format!(", {what} {number}");
        }
    }
    name
}

/// Built-in inputs in the input record of each lane, as 32-bit words; vectors and matrices
/// (column-major) by component.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Builtin {
    /// 3 words.
    LaunchId,
    /// 3 words each: compute, task and mesh, as all up to `NumSubgroups`.
    WorkgroupId,
    LocalInvocationId,
    /// 1 word.
    LocalInvocationIndex,
    /// 3 words.
    GlobalInvocationId,
    /// 1 word each.
    SubgroupId,
    NumSubgroups,
    /// 3 words: task and mesh. Those of a dispatch are the same for all its invocations.
    NumWorkgroups,
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
    /// 1 word each: vertex; `DrawIndex` also task and mesh.
    VertexIndex,
    InstanceIndex,
    BaseVertex,
    BaseInstance,
    DrawIndex,
    /// 1 word: all stages of drawing.
    ViewIndex,
    /// 1 word: tessellation control and geometry.
    InvocationId,
    /// 1 word: tessellation.
    PatchVertices,
    /// 1 word: tessellation control. Where the memory of the invocation's patch starts, in bytes.
    PatchOffset,
    /// 3 f32: tessellation evaluation.
    TessCoord,
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
    /// 1 word: the size of the fragment (`ShadingRateKHR`).
    ShadingRate,
    /// 1 word each: the locations of the pixel's samples along x and y, in sixteenths of a pixel,
    /// four bits a sample.
    SampleLocations,
    /// 9 f32 each: at the fragment's centre, the three planes whose quotients by their sum are
    /// perspective-correct barycentric coordinates, or that are the linear ones; then their
    /// derivatives in x, then in y.
    PerspectivePlanes,
    LinearPlanes,
}

impl Builtin {
    /// Number of words in the input record.
    pub fn words(self) -> u8 {
        match self {
            Builtin::ObjectToWorld | Builtin::WorldToObject => 12,
            Builtin::HitTriangleVertexPositions => 9,
            Builtin::HitLssPositions => 6,
            Builtin::PerspectivePlanes | Builtin::LinearPlanes => 9,
            Builtin::FragCoord => 4,
            Builtin::PointCoord | Builtin::SamplePosition | Builtin::SampleLocations => 2,
            Builtin::LaunchId
            | Builtin::TessCoord
            | Builtin::WorkgroupId
            | Builtin::LocalInvocationId
            | Builtin::GlobalInvocationId
            | Builtin::NumWorkgroups
            | Builtin::WorldRayOrigin
            | Builtin::WorldRayDirection
            | Builtin::ObjectRayOrigin
            | Builtin::ObjectRayDirection
            | Builtin::HitSpherePosition => 3,
            Builtin::ShaderRecordAddress | Builtin::HitLssRadii => 2,
            _ => 1,
        }
    }

    /// The fact of a built-in of hit shaders, which has as many words as it needs.
    pub fn fact(self) -> Option<Fact> {
        Some(match self {
            Builtin::PrimitiveId => Fact::PrimitiveIndex,
            Builtin::InstanceId => Fact::InstanceId,
            Builtin::InstanceCustomIndex => Fact::InstanceCustomIndex,
            Builtin::GeometryIndex => Fact::GeometryIndex,
            Builtin::HitKind => Fact::HitKind,
            Builtin::RayTmax => Fact::T,
            Builtin::ObjectToWorld => Fact::ObjectToWorld,
            Builtin::WorldToObject => Fact::WorldToObject,
            Builtin::ObjectRayOrigin => Fact::ObjectRayOrigin,
            Builtin::ObjectRayDirection => Fact::ObjectRayDirection,
            Builtin::HitTriangleVertexPositions => Fact::TriangleVertexPositions,
            Builtin::HitIsSphere => Fact::IsSphere,
            Builtin::HitIsLss => Fact::IsLss,
            Builtin::HitSpherePosition | Builtin::HitLssPositions => Fact::SweptPositions,
            Builtin::HitSphereRadius | Builtin::HitLssRadii => Fact::SweptRadii,
            _ => return None,
        })
    }
}
