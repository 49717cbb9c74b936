//! GLSL to modules.

use glsl::Version;
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

/// The name that glslang's program gives the files of a stage.
fn name(stage: Stage) -> &'static str {
    match stage {
        Stage::Compute => "comp",
        Stage::RayGeneration => "rgen",
        Stage::Miss => "rmiss",
        Stage::ClosestHit => "rchit",
        Stage::AnyHit => "rahit",
        Stage::Intersection => "rint",
        Stage::Callable => "rcall",
        Stage::Vertex => "vert",
        Stage::TessellationControl => "tesc",
        Stage::TessellationEvaluation => "tese",
        Stage::Geometry => "geom",
        Stage::Task => "task",
        Stage::Mesh => "mesh",
        Stage::Fragment => "frag",
    }
}

/// Compiles GLSL without its version line.
pub fn glsl(stage: Stage, source: &str) -> Vec<u32> {
    let mut text = String::from("#version 460\n");
    for extension in EXTENSIONS {
        text += &format!("#extension {extension} : enable\n");
    }
    let draws = matches!(
        stage,
        Stage::Vertex
            | Stage::TessellationControl
            | Stage::TessellationEvaluation
            | Stage::Geometry
            | Stage::Task
            | Stage::Mesh
            | Stage::Fragment
    );
    if draws {
        for extension in RASTER_EXTENSIONS {
            text += &format!("#extension {extension} : enable\n");
        }
        if matches!(stage, Stage::Task | Stage::Mesh | Stage::Fragment) {
            text += "#extension GL_EXT_mesh_shader : enable\n";
        }
    } else if stage != Stage::Compute {
        text += "#extension GL_EXT_ray_tracing : enable\n";
        text += "#extension GL_EXT_ray_tracing_position_fetch : enable\n";
    }
    text += source;
    glsl::compile(name(stage), Version::V1_6, &text)
        .unwrap_or_else(|error| panic!("{error}\n{text}"))
}
