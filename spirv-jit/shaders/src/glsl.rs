//! GLSL to modules.

use glsl::{Version, compile_with};
use spirv_jit::program::Stage;

/// Extensions that every test shader may use.
const EXTENSIONS: &[&str] = &[
    "GL_EXT_scalar_block_layout",
    "GL_EXT_nonuniform_qualifier",
    "GL_EXT_buffer_reference",
    "GL_EXT_buffer_reference2",
    "GL_EXT_buffer_reference_uvec2",
    "GL_EXT_shader_explicit_arithmetic_types",
    "GL_EXT_shader_8bit_storage",
    "GL_EXT_shader_16bit_storage",
    "GL_EXT_shader_image_load_formatted",
    "GL_EXT_samplerless_texture_functions",
    "GL_EXT_control_flow_attributes",
    "GL_KHR_shader_subgroup_basic",
    "GL_KHR_shader_subgroup_vote",
    "GL_KHR_shader_subgroup_arithmetic",
    "GL_KHR_shader_subgroup_ballot",
    "GL_KHR_shader_subgroup_shuffle",
    "GL_KHR_shader_subgroup_shuffle_relative",
    "GL_KHR_shader_subgroup_clustered",
    "GL_KHR_shader_subgroup_quad",
    "GL_NV_shader_subgroup_partitioned",
    "GL_EXT_shader_atomic_float",
    "GL_EXT_shader_atomic_float2",
    "GL_EXT_shader_atomic_int64",
    "GL_ARB_shader_clock",
    "GL_EXT_shader_realtime_clock",
];

/// Extensions of the rasterizer's stages.
const RASTER_EXTENSIONS: &[&str] = &[
    "GL_EXT_demote_to_helper_invocation",
    "GL_EXT_terminate_invocation",
    "GL_EXT_fragment_shader_barycentric",
    "GL_EXT_multiview",
    "GL_ARB_fragment_shader_interlock",
    "GL_ARB_shader_stencil_export",
    "GL_ARB_shader_viewport_layer_array",
];

/// The stage as the compiler of GLSL names it.
fn stage_of_glsl(stage: Stage) -> glsl::Stage {
    match stage {
        Stage::Compute => glsl::Stage::Compute,
        Stage::RayGeneration => glsl::Stage::RayGeneration,
        Stage::Miss => glsl::Stage::Miss,
        Stage::ClosestHit => glsl::Stage::ClosestHit,
        Stage::AnyHit => glsl::Stage::AnyHit,
        Stage::Intersection => glsl::Stage::Intersection,
        Stage::Callable => glsl::Stage::Callable,
        Stage::Vertex => glsl::Stage::Vertex,
        Stage::TessellationControl => glsl::Stage::TessellationControl,
        Stage::TessellationEvaluation => glsl::Stage::TessellationEvaluation,
        Stage::Geometry => glsl::Stage::Geometry,
        Stage::Task => glsl::Stage::Task,
        Stage::Mesh => glsl::Stage::Mesh,
        Stage::Fragment => glsl::Stage::Fragment,
    }
}

/// Compiles GLSL without its version line.
pub fn glsl(stage: Stage, source: &str) -> Vec<u32> {
    let stage = stage_of_glsl(stage);
    let mut extensions = EXTENSIONS.to_vec();
    if stage.is_of_draws() {
        extensions.extend(RASTER_EXTENSIONS);
        if stage.is_of_meshes() {
            extensions.push("GL_EXT_mesh_shader");
        }
    } else if stage != glsl::Stage::Compute {
        extensions.push("GL_EXT_ray_tracing");
        extensions.push("GL_EXT_ray_tracing_position_fetch");
    }
    compile_with(stage, Version::V1_6, &extensions, source)
}
