//! GLSL to SPIR-V.

use ash::vk;
use glsl::Version;

/// The stages that the tests use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    Compute,
    RayGeneration,
    Miss,
    ClosestHit,
    AnyHit,
    Intersection,
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
    pub fn flag(self) -> vk::ShaderStageFlags {
        match self {
            Stage::Compute => vk::ShaderStageFlags::COMPUTE,
            Stage::RayGeneration => vk::ShaderStageFlags::RAYGEN_KHR,
            Stage::Miss => vk::ShaderStageFlags::MISS_KHR,
            Stage::ClosestHit => vk::ShaderStageFlags::CLOSEST_HIT_KHR,
            Stage::AnyHit => vk::ShaderStageFlags::ANY_HIT_KHR,
            Stage::Intersection => vk::ShaderStageFlags::INTERSECTION_KHR,
            Stage::Callable => vk::ShaderStageFlags::CALLABLE_KHR,
            Stage::Vertex => vk::ShaderStageFlags::VERTEX,
            Stage::TessellationControl => vk::ShaderStageFlags::TESSELLATION_CONTROL,
            Stage::TessellationEvaluation => vk::ShaderStageFlags::TESSELLATION_EVALUATION,
            Stage::Geometry => vk::ShaderStageFlags::GEOMETRY,
            Stage::Task => vk::ShaderStageFlags::TASK_EXT,
            Stage::Mesh => vk::ShaderStageFlags::MESH_EXT,
            Stage::Fragment => vk::ShaderStageFlags::FRAGMENT,
        }
    }

    /// The name that glslang's program gives the files of this stage.
    fn name(self) -> &'static str {
        match self {
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
}

/// Compiles GLSL; the version line and the extensions that the tests use are put before it.
pub fn glsl(stage: Stage, source: &str) -> Vec<u32> {
    let mut extensions = vec![
        "GL_EXT_scalar_block_layout",
        "GL_EXT_nonuniform_qualifier",
        "GL_EXT_buffer_reference",
        "GL_EXT_shader_explicit_arithmetic_types",
        "GL_EXT_ray_query",
        "GL_EXT_ray_flags_primitive_culling",
        "GL_NV_cooperative_vector",
    ];
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
        extensions.push("GL_EXT_multiview");
        extensions.push("GL_ARB_shader_viewport_layer_array");
        extensions.push("GL_EXT_demote_to_helper_invocation");
        extensions.push("GL_EXT_fragment_shading_rate");
    }
    if matches!(stage, Stage::Task | Stage::Mesh | Stage::Fragment) {
        extensions.push("GL_EXT_mesh_shader");
        extensions.push("GL_KHR_shader_subgroup_arithmetic");
    }
    if stage != Stage::Compute && !draws {
        extensions.push("GL_EXT_ray_tracing");
        extensions.push("GL_EXT_ray_cull_mask");
        extensions.push("GL_EXT_opacity_micromap");
    }
    compile(stage, &extensions, source, Version::V1_6)
}

/// Compiles GLSL with `GL_NV_ray_tracing` in place of the newer extensions.
pub fn glsl_nv(stage: Stage, source: &str) -> Vec<u32> {
    let extensions = ["GL_NV_ray_tracing", "GL_EXT_scalar_block_layout"];
    compile(stage, &extensions, source, Version::V1_4)
}

fn compile(stage: Stage, extensions: &[&str], source: &str, version: Version) -> Vec<u32> {
    let mut text = String::from("#version 460\n");
    for extension in extensions {
        text += &format!("#extension {extension} : enable\n");
    }
    text += source;
    glsl::compile(stage.name(), version, &text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}
