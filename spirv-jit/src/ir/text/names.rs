//! The words of the text form for enumerations: a table each, used in both directions.

use images::{Dim, LodMode};

use crate::ir::Type;
use crate::ir::op::{
    AtomicOp, Component, MatrixProduct, ReduceOp, Space, SubgroupOp, VectorProduct,
};
use crate::ir::stage::{Builtin, Stage};

macro_rules! names {
    ($type:ident, $to_text:ident, $from_text:ident: $($variant:ident = $text:literal),* $(,)?) => {
        pub fn $to_text(value: $type) -> &'static str {
            match value {
                $($type::$variant => $text,)*
            }
        }

        pub fn $from_text(text: &str) -> Option<$type> {
            match text {
                $($text => Some($type::$variant),)*
                _ => None,
            }
        }
    };
}

names!(Type, type_text, type_from_text:
    I1 = "i1", I8 = "i8", I16 = "i16", I32 = "i32", I64 = "i64", F16 = "f16", F32 = "f32", F64 = "f64",
    Descriptor = "descriptor");

names!(Space, space_text, space_from_text:
    Private = "private", Shared = "shared", Buffer = "buffer", Buffer64 = "buffer64", Global = "global");

names!(Stage, stage_text, stage_from_text:
    Compute = "compute", RayGeneration = "ray_generation", Intersection = "intersection", AnyHit = "any_hit",
    ClosestHit = "closest_hit", Miss = "miss", Callable = "callable", Vertex = "vertex",
    TessellationControl = "tessellation_control", TessellationEvaluation = "tessellation_evaluation",
    Geometry = "geometry", Task = "task", Mesh = "mesh", Fragment = "fragment");

names!(Builtin, builtin_text, builtin_from_text:
    LaunchId = "launch_id", WorkgroupId = "workgroup_id", LocalInvocationId = "local_invocation_id",
    LocalInvocationIndex = "local_invocation_index", GlobalInvocationId = "global_invocation_id",
    SubgroupId = "subgroup_id", NumSubgroups = "num_subgroups", NumWorkgroups = "num_workgroups", PrimitiveId = "primitive_id",
    InstanceId = "instance_id", InstanceCustomIndex = "instance_custom_index", GeometryIndex = "geometry_index",
    WorldRayOrigin = "world_ray_origin", WorldRayDirection = "world_ray_direction",
    ObjectRayOrigin = "object_ray_origin", ObjectRayDirection = "object_ray_direction",
    RayTmin = "ray_tmin", RayTmax = "ray_tmax", IncomingRayFlags = "incoming_ray_flags", CullMask = "cull_mask",
    HitKind = "hit_kind", ObjectToWorld = "object_to_world", WorldToObject = "world_to_object",
    HitTriangleVertexPositions = "hit_triangle_vertex_positions", HitIsSphere = "hit_is_sphere",
    HitIsLss = "hit_is_lss", HitSpherePosition = "hit_sphere_position", HitSphereRadius = "hit_sphere_radius",
    HitLssPositions = "hit_lss_positions", HitLssRadii = "hit_lss_radii",
    CurrentRayTime = "current_ray_time", ShaderRecordAddress = "shader_record_address",
    VertexIndex = "vertex_index", InstanceIndex = "instance_index", BaseVertex = "base_vertex",
    BaseInstance = "base_instance", DrawIndex = "draw_index", ViewIndex = "view_index", InvocationId = "invocation_id",
    PatchVertices = "patch_vertices", PatchOffset = "patch_offset", TessCoord = "tess_coord",
    FragCoord = "frag_coord",
    FrontFacing = "front_facing", PointCoord = "point_coord", SampleId = "sample_id",
    SamplePosition = "sample_position", SampleMask = "sample_mask", Layer = "layer",
    ViewportIndex = "viewport_index", AttachmentLayer = "attachment_layer", SampleLocations = "sample_locations",
    ShadingRate = "shading_rate",
    PerspectivePlanes = "perspective_planes", LinearPlanes = "linear_planes");

names!(AtomicOp, atomic_text, atomic_from_text:
    Load = "load", Store = "store", Exchange = "exchange", CompareExchange = "compare_exchange",
    IAdd = "iadd", ISub = "isub", SMin = "smin", SMax = "smax", UMin = "umin", UMax = "umax",
    And = "and", Or = "or", Xor = "xor", FAdd = "fadd", FMin = "fmin", FMax = "fmax",
    FAddFlushed = "fadd_flushed", FMinFlushed = "fmin_flushed", FMaxFlushed = "fmax_flushed");

names!(ReduceOp, reduce_text, reduce_from_text:
    IAdd = "iadd", FAdd = "fadd", IMul = "imul", FMul = "fmul", SMin = "smin", UMin = "umin", FMin = "fmin",
    SMax = "smax", UMax = "umax", FMax = "fmax", And = "and", Or = "or", Xor = "xor");

names!(Dim, dim_text, dim_from_text:
    D1 = "1d", D2 = "2d", D3 = "3d", Cube = "cube", Buffer = "texel_buffer");

names!(LodMode, lod_text, lod_from_text:
    Implicit = "implicit", Bias = "bias", Lod = "lod", Grad = "grad");

names!(Component, component_text, component_from_text:
    F16 = "f16", BFloat16 = "bfloat16", F32 = "f32", S8 = "s8", U8 = "u8", S32 = "s32", U32 = "u32",
    E4M3 = "e4m3", E5M2 = "e5m2");

/// The contents of a product's brackets.
pub fn product_text(product: &MatrixProduct) -> String {
    let [a, b, sum] = [product.a, product.b, product.sum].map(component_text);
    let saturates = if product.saturates {
        ", saturating"
    } else {
        ""
    };
    format!("{a}, {b}, {sum}{saturates}")
}

/// The inverse of [`product_text`], for split words.
pub fn product_from_text(words: &[&str]) -> Option<MatrixProduct> {
    let (&[a, b, sum], rest) = words.split_first_chunk::<3>()?;
    Some(MatrixProduct {
        a: component_from_text(a)?,
        b: component_from_text(b)?,
        sum: component_from_text(sum)?,
        saturates: match rest {
            [] => false,
            ["saturating"] => true,
            _ => return None,
        },
    })
}

/// The contents of the brackets of a product with a vector.
pub fn vector_product_text(product: &VectorProduct) -> String {
    let [matrix, vector, sum] = [product.matrix, product.vector, product.sum].map(component_text);
    let by_columns = if product.by_columns {
        ", by_columns"
    } else {
        ""
    };
    let adds = if product.adds { ", adds" } else { "" };
    format!("{matrix}, {vector}, {sum}{by_columns}{adds}")
}

/// The inverse of [`vector_product_text`], for split words.
pub fn vector_product_from_text(words: &[&str]) -> Option<VectorProduct> {
    let (&[matrix, vector, sum], rest) = words.split_first_chunk::<3>()?;
    let (by_columns, adds) = match rest {
        [] => (false, false),
        ["by_columns"] => (true, false),
        ["adds"] => (false, true),
        ["by_columns", "adds"] => (true, true),
        _ => return None,
    };
    Some(VectorProduct {
        matrix: component_from_text(matrix)?,
        vector: component_from_text(vector)?,
        sum: component_from_text(sum)?,
        by_columns,
        adds,
    })
}

/// A subgroup operation's name after `subgroup.`, and the text in its brackets.
pub fn subgroup_text(op: SubgroupOp) -> (&'static str, String) {
    match op {
        SubgroupOp::Elect => ("elect", String::new()),
        SubgroupOp::All => ("all", String::new()),
        SubgroupOp::Any => ("any", String::new()),
        SubgroupOp::AllEqual => ("all_equal", String::new()),
        SubgroupOp::Ballot => ("ballot", String::new()),
        SubgroupOp::Shuffle => ("shuffle", String::new()),
        SubgroupOp::QuadShuffle => ("quad_shuffle", String::new()),
        SubgroupOp::BroadcastFirst => ("broadcast_first", String::new()),
        SubgroupOp::Reduce { op, cluster } => ("reduce", format!("{}, {cluster}", reduce_text(op))),
        SubgroupOp::InclusiveScan(op) => ("inclusive_scan", reduce_text(op).into()),
        SubgroupOp::ExclusiveScan(op) => ("exclusive_scan", reduce_text(op).into()),
        SubgroupOp::Match => ("match", String::new()),
        SubgroupOp::PartitionedReduce(op) => ("partitioned_reduce", reduce_text(op).into()),
        SubgroupOp::PartitionedInclusiveScan(op) => {
            ("partitioned_inclusive_scan", reduce_text(op).into())
        }
        SubgroupOp::PartitionedExclusiveScan(op) => {
            ("partitioned_exclusive_scan", reduce_text(op).into())
        }
    }
}

/// The inverse of [`subgroup_text`], for split words of the brackets.
pub fn subgroup_from_text(name: &str, words: &[&str]) -> Option<SubgroupOp> {
    let plain = |op| words.is_empty().then_some(op);
    let scan = || match words {
        [op] => reduce_from_text(op),
        _ => None,
    };
    match name {
        "elect" => plain(SubgroupOp::Elect),
        "all" => plain(SubgroupOp::All),
        "any" => plain(SubgroupOp::Any),
        "all_equal" => plain(SubgroupOp::AllEqual),
        "ballot" => plain(SubgroupOp::Ballot),
        "shuffle" => plain(SubgroupOp::Shuffle),
        "quad_shuffle" => plain(SubgroupOp::QuadShuffle),
        "broadcast_first" => plain(SubgroupOp::BroadcastFirst),
        "reduce" => match words {
            [op, cluster] => Some(SubgroupOp::Reduce {
                op: reduce_from_text(op)?,
                cluster: cluster.parse().ok()?,
            }),
            _ => None,
        },
        "inclusive_scan" => scan().map(SubgroupOp::InclusiveScan),
        "exclusive_scan" => scan().map(SubgroupOp::ExclusiveScan),
        "match" => plain(SubgroupOp::Match),
        "partitioned_reduce" => scan().map(SubgroupOp::PartitionedReduce),
        "partitioned_inclusive_scan" => scan().map(SubgroupOp::PartitionedInclusiveScan),
        "partitioned_exclusive_scan" => scan().map(SubgroupOp::PartitionedExclusiveScan),
        _ => None,
    }
}
