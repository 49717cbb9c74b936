//! Ray tracing pipelines and pipeline libraries: programs, groups, and the handles for shader
//! binding tables.

#![forbid(unsafe_code)]

use std::sync::Arc;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::program::Stage;
use xxhash_rust::xxh3::xxh3_128_with_seed;

use super::stage_program::{ProgramKey, StageProgram};
use crate::wave::binding_table::{Group, GroupKind, HANDLE_SIZE, Handle, ProgramIndex, Shaders};

/// A ray tracing pipeline, or a library to link into one.
pub struct RayTracingPipeline {
    pub shaders: Shaders,
    /// The key of the source of each program, by program index.
    pub keys: Vec<ProgramKey>,
    /// Ray flags added to every trace (`SKIP_TRIANGLES`, `SKIP_AABBS`).
    pub ray_flags: u32,
    pub facts: PipelineFacts,
}

/// Guarantees of a pipeline about its execution.
#[derive(Clone, Copy, Debug)]
pub struct PipelineFacts {
    pub flags: vk::PipelineCreateFlags,
    /// `maxPipelineRayRecursionDepth`.
    pub max_recursion_depth: u32,
    /// `VK_DYNAMIC_STATE_RAY_TRACING_PIPELINE_STACK_SIZE_KHR`: the command buffer sets the stack
    /// size.
    pub has_dynamic_stack: bool,
    /// The default stack size (chapter Pipelines, "Ray Tracing Pipeline Stack").
    pub default_stack_bytes: u64,
}

/// `VkRayTracingShaderGroupCreateInfoKHR`, decoded: stage indices count the pipeline's own stages,
/// then those of its libraries.
#[derive(Clone, Copy, Debug)]
pub struct GroupInfo {
    pub ty: vk::RayTracingShaderGroupTypeKHR,
    pub general: Option<u32>,
    pub closest_hit: Option<u32>,
    pub any_hit: Option<u32>,
    pub intersection: Option<u32>,
}

impl RayTracingPipeline {
    /// Links stages and groups, then the groups of libraries in order.
    pub fn link(
        stages: Vec<StageProgram>,
        groups: &[GroupInfo],
        libraries: &[&RayTracingPipeline],
        max_recursion_depth: u32,
        flags: vk::PipelineCreateFlags,
        has_dynamic_stack: bool,
    ) -> Self {
        let mut programs = Vec::new();
        let mut keys = Vec::new();
        for stage in stages {
            programs.push(stage.program);
            keys.push(stage.key);
        }
        let mut firsts = Vec::new();
        for library in libraries {
            firsts.push(programs.len() as u32);
            programs.extend(library.shaders.programs.iter().cloned());
            keys.extend_from_slice(&library.keys);
        }
        let mut all = new_groups(groups, &keys);
        for (library, first) in libraries.iter().zip(firsts) {
            all.extend(
                library
                    .shaders
                    .groups
                    .iter()
                    .map(|group| shifted(group, first)),
            );
        }
        Self {
            facts: PipelineFacts {
                flags,
                max_recursion_depth,
                has_dynamic_stack,
                default_stack_bytes: default_stack_bytes(&programs, max_recursion_depth),
            },
            shaders: Shaders::new(programs, all),
            keys,
            ray_flags: ray_flags(flags),
        }
    }

    /// A shader's stack size in bytes (`vkGetRayTracingShaderGroupStackSizeKHR`); 0 if the group
    /// lacks the shader.
    pub fn stack_size_bytes(&self, group: u32, shader: vk::ShaderGroupShaderKHR) -> u64 {
        let Some(group) = self.shaders.groups.get(group as usize) else {
            return 0;
        };
        let program = match shader {
            vk::ShaderGroupShaderKHR::GENERAL => group.general,
            vk::ShaderGroupShaderKHR::CLOSEST_HIT => group.closest_hit,
            vk::ShaderGroupShaderKHR::ANY_HIT => group.any_hit,
            vk::ShaderGroupShaderKHR::INTERSECTION => group.intersection,
            _ => None,
        };
        program.map_or(0, |index| {
            u64::from(self.shaders.programs[index as usize].stack_size_bytes())
        })
    }
}

/// Groups of shaders with these keys of their sources.
pub fn new_groups(infos: &[GroupInfo], keys: &[ProgramKey]) -> Vec<Group> {
    infos.iter().map(|info| new_group(info, keys)).collect()
}

fn new_group(info: &GroupInfo, keys: &[ProgramKey]) -> Group {
    let known = |index: Option<u32>| index.filter(|&index| (index as usize) < keys.len());
    let mut group = Group {
        handle: [0; HANDLE_SIZE],
        kind: match info.ty {
            vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP => GroupKind::Triangles,
            vk::RayTracingShaderGroupTypeKHR::PROCEDURAL_HIT_GROUP => GroupKind::Procedural,
            _ => GroupKind::General,
        },
        general: known(info.general),
        closest_hit: known(info.closest_hit),
        any_hit: known(info.any_hit),
        intersection: known(info.intersection),
    };
    group.handle = handle(info.ty, &group, keys);
    group
}

fn shifted(group: &Group, first: ProgramIndex) -> Group {
    let shift = |index: Option<ProgramIndex>| index.map(|index| index + first);
    Group {
        handle: group.handle,
        kind: group.kind,
        general: shift(group.general),
        closest_hit: shift(group.closest_hit),
        any_hit: shift(group.any_hit),
        intersection: shift(group.intersection),
    }
}

/// A group's handle: a hash of its type and of the sources of its shaders. The same group has the
/// same handle in any process, as replay requires, and in a library and the pipeline that links it.
fn handle(ty: vk::RayTracingShaderGroupTypeKHR, group: &Group, keys: &[ProgramKey]) -> Handle {
    let mut content = ty.as_raw().to_le_bytes().to_vec();
    for program in [
        group.general,
        group.closest_hit,
        group.any_hit,
        group.intersection,
    ] {
        match program {
            Some(index) => {
                content.push(1);
                content.extend_from_slice(&keys[index as usize]);
            }
            None => content.push(0),
        }
    }
    let mut handle = [0; HANDLE_SIZE];
    handle[..16].copy_from_slice(&xxh3_128_with_seed(&content, 1).to_le_bytes());
    handle[16..].copy_from_slice(&xxh3_128_with_seed(&content, 2).to_le_bytes());
    handle
}

/// The default stack size, by the rule that the specification suggests.
fn default_stack_bytes(programs: &[Arc<Program>], max_recursion_depth: u32) -> u64 {
    let most = |stage| {
        let of_stage = programs.iter().filter(|program| program.stage() == stage);
        let sizes = of_stage.map(|program| u64::from(program.stack_size_bytes()));
        sizes.max().unwrap_or(0)
    };
    let depth = u64::from(max_recursion_depth);
    let traced = most(Stage::ClosestHit).max(most(Stage::Miss));
    let first = traced.max(most(Stage::Intersection) + most(Stage::AnyHit));
    most(Stage::RayGeneration)
        + depth.min(1) * first
        + depth.saturating_sub(1) * traced
        + 2 * most(Stage::Callable)
}

fn ray_flags(flags: vk::PipelineCreateFlags) -> u32 {
    let mut ray_flags = 0;
    if flags.contains(vk::PipelineCreateFlags::RAY_TRACING_SKIP_TRIANGLES_KHR) {
        ray_flags |= traversal::ray_flags::SKIP_TRIANGLES;
    }
    if flags.contains(vk::PipelineCreateFlags::RAY_TRACING_SKIP_AABBS_KHR) {
        ray_flags |= traversal::ray_flags::SKIP_AABBS;
    }
    ray_flags
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOSEST_HIT: GroupInfo = GroupInfo {
        ty: vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP,
        general: None,
        closest_hit: Some(0),
        any_hit: None,
        intersection: None,
    };

    #[test]
    fn handles_follow_from_content() {
        let keys = [[1; 16], [2; 16], [1; 16]];
        let of = |info: GroupInfo| new_group(&info, &keys).handle;
        let other = |closest_hit| {
            of(GroupInfo {
                closest_hit,
                ..CLOSEST_HIT
            })
        };
        assert_eq!(of(CLOSEST_HIT), other(Some(2)));
        assert_ne!(of(CLOSEST_HIT), other(Some(1)));
        assert_ne!(of(CLOSEST_HIT), other(None));
        let any_hit = GroupInfo {
            closest_hit: None,
            any_hit: Some(0),
            ..CLOSEST_HIT
        };
        assert_ne!(of(CLOSEST_HIT), of(any_hit));
        assert_ne!(of(CLOSEST_HIT), [0; HANDLE_SIZE]);
    }
}
