//! GLSL to SPIR-V.

use ash::vk;
pub use glsl::Stage;
use glsl::{Version, compile_with};

/// The stage as Vulkan names it.
pub fn stage_flag(stage: Stage) -> vk::ShaderStageFlags {
    match stage {
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
    if stage.is_of_draws() {
        extensions.push("GL_EXT_multiview");
        extensions.push("GL_ARB_shader_viewport_layer_array");
        extensions.push("GL_EXT_demote_to_helper_invocation");
        extensions.push("GL_EXT_fragment_shading_rate");
    }
    if stage.is_of_meshes() {
        extensions.push("GL_EXT_mesh_shader");
        extensions.push("GL_KHR_shader_subgroup_arithmetic");
    }
    if stage != Stage::Compute && !stage.is_of_draws() {
        extensions.push("GL_EXT_ray_tracing");
        extensions.push("GL_EXT_ray_cull_mask");
        extensions.push("GL_EXT_opacity_micromap");
    }
    compile_with(stage, Version::V1_6, &extensions, source)
}

/// Compiles GLSL with `GL_NV_ray_tracing` in place of the newer extensions.
pub fn glsl_nv(stage: Stage, source: &str) -> Vec<u32> {
    let extensions = ["GL_NV_ray_tracing", "GL_EXT_scalar_block_layout"];
    compile_with(stage, Version::V1_4, &extensions, source)
}
