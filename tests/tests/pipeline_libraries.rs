//! Pipeline libraries: what is linked of them traces, and thousands of groups are no matter.

use std::time::{Duration, Instant};

use tuff_tests::*;
use vk::PipelineCreateFlags as Flags;

const RAYGEN: &str = r"
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) buffer R { uint results[]; };
layout(location = 0) rayPayloadEXT uint word;
void main() {
    uint x = gl_LaunchIDEXT.x;
    traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(float(x) + 0.25, 0.25, 0), 0.0, vec3(0, 0, 1), 9.0, 0);
    results[x] = word;
}";
const MISS: &str = "layout(location = 0) rayPayloadInEXT uint word; void main() { word = 7u; }";
const HIT: &str = r"
layout(location = 0) rayPayloadInEXT uint word;
layout(shaderRecordEXT, std430) buffer Record { uint number; };
void main() { word = ADDED + number; }";

/// Parts of pipelines that share an interface.
struct Parts<'a> {
    gpu: &'a Gpu,
    layout: vk::PipelineLayout,
}

impl Parts<'_> {
    /// A pipeline or library of these shaders, groups and libraries.
    fn link(
        &self,
        shaders: &[(Stage, &str)],
        groups: &[vk::RayTracingShaderGroupCreateInfoKHR],
        libraries: &[vk::Pipeline],
        flags: Flags,
    ) -> (vk::Pipeline, Duration) {
        let stages: Vec<_> = shaders
            .iter()
            .map(|&(stage, source)| {
                vk::PipelineShaderStageCreateInfo::default()
                    .stage(stage_flag(stage))
                    .module(self.gpu.module(&glsl(stage, source)))
                    .name(c"main")
            })
            .collect();
        let interface = vk::RayTracingPipelineInterfaceCreateInfoKHR::default()
            .max_pipeline_ray_payload_size(4)
            .max_pipeline_ray_hit_attribute_size(8);
        let linked = vk::PipelineLibraryCreateInfoKHR::default().libraries(libraries);
        let info = vk::RayTracingPipelineCreateInfoKHR::default()
            .flags(flags)
            .stages(&stages)
            .groups(groups)
            .max_pipeline_ray_recursion_depth(1)
            .library_info(&linked)
            .library_interface(&interface)
            .layout(self.layout);
        let start = Instant::now();
        // SAFETY: the structures outlive the call.
        let made = unsafe {
            self.gpu.ray_tracing.create_ray_tracing_pipelines(
                vk::DeferredOperationKHR::null(),
                vk::PipelineCache::null(),
                &[info],
                None,
            )
        };
        let took = start.elapsed();
        let pipeline = made.expect("vkCreateRayTracingPipelinesKHR")[0];
        self.gpu.keep_pipeline(pipeline);
        (pipeline, took)
    }
}

fn group(
    ty: vk::RayTracingShaderGroupTypeKHR,
    general: u32,
    closest_hit: u32,
) -> vk::RayTracingShaderGroupCreateInfoKHR<'static> {
    vk::RayTracingShaderGroupCreateInfoKHR::default()
        .ty(ty)
        .general_shader(general)
        .closest_hit_shader(closest_hit)
        .any_hit_shader(vk::SHADER_UNUSED_KHR)
        .intersection_shader(vk::SHADER_UNUSED_KHR)
}

fn hit_group(shader: u32) -> vk::RayTracingShaderGroupCreateInfoKHR<'static> {
    let ty = vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP;
    group(ty, vk::SHADER_UNUSED_KHR, shader)
}

fn general_group(shader: u32) -> vk::RayTracingShaderGroupCreateInfoKHR<'static> {
    let ty = vk::RayTracingShaderGroupTypeKHR::GENERAL;
    group(ty, shader, vk::SHADER_UNUSED_KHR)
}

#[test]
fn thousands_of_groups_are_linked() {
    let gpu = Gpu::new();
    // Some drivers take their time: lavapipe minutes for as many.
    let count = if gpu.is_tuff() { 5000 } else { 20 };
    let triangle = |x: f32| [[x, 0.0, 1.0], [x + 1.0, 0.0, 1.0], [x, 1.0, 1.0]];
    let bottom = gpu.bottom(&[Geometry::opaque(&triangle(0.0))]);
    // The first, one in the middle, the last of the first library; then of the second one.
    let offsets = [0, count / 2, count - 1, count, 2 * count - 1];
    let instances: Vec<Instance> = (offsets.iter().enumerate())
        .map(|(i, &table_offset)| Instance {
            transform: translated([i as f32, 0.0, 0.0]),
            table_offset,
            ..Instance::of(bottom)
        })
        .collect();
    let world = gpu.top(&instances);
    let results = gpu.buffer(4 * 6);
    let set = gpu.set_of(&[world.into(), results.into()]);
    let layout = gpu.layout(&[set.layout]);
    let parts = Parts { gpu: &gpu, layout };
    // The first library's groups are all of one shader, as materials are; the second's
    // alternate between two.
    let [thousand, million, more] =
        ["1000u", "1000000u", "2000000u"].map(|added| HIT.replace("ADDED", added));
    let groups = vec![hit_group(0); count as usize];
    let shaders = [(Stage::ClosestHit, &thousand[..])];
    let (first, _) = parts.link(&shaders, &groups, &[], Flags::LIBRARY_KHR);
    let groups: Vec<_> = (0..count).map(|i| hit_group(i % 2)).collect();
    let shaders = [
        (Stage::ClosestHit, &million[..]),
        (Stage::ClosestHit, &more),
    ];
    let (second, _) = parts.link(&shaders, &groups, &[], Flags::LIBRARY_KHR);
    let shaders = [(Stage::RayGeneration, RAYGEN), (Stage::Miss, MISS)];
    let groups = [general_group(0), general_group(1)];
    let libraries = [first, second];
    let (pipeline, _) = parts.link(&shaders, &groups, &libraries, Flags::empty());
    let rays = gpu.rays_of(pipeline, layout, set, 2 + 2 * count as usize);
    let table = Table {
        raygen: Record::of(0),
        miss: vec![Record::of(1)],
        hit: (0..2 * count).map(|i| Record::with(2 + i, &[i])).collect(),
        ..Table::default()
    };
    gpu.trace(&rays, &table, [6, 1, 1]);
    let last = 2 * count - 1;
    let expected = [
        1000,
        1000 + count / 2,
        1000 + count - 1,
        1_000_000 + count,
        2_000_000 + last,
        7,
    ];
    assert_eq!(results.read::<u32>(), expected);

    // Once its parts are compiled a pipeline costs what its groups cost to copy.
    let all = [
        first,
        second,
        pipeline_of_general_groups(&parts, &shaders, &groups),
    ];
    let mut fastest = Duration::MAX;
    let is_fast = enough(1, 100, || {
        fastest = fastest.min(parts.link(&[], &[], &all, Flags::empty()).1);
        fastest < Duration::from_millis(10)
    });
    println!("{} groups are linked in {fastest:?}", 2 * count + 2);
    assert!(is_fast || !gpu.is_tuff(), "{fastest:?}");
}

fn pipeline_of_general_groups(
    parts: &Parts,
    shaders: &[(Stage, &str)],
    groups: &[vk::RayTracingShaderGroupCreateInfoKHR],
) -> vk::Pipeline {
    parts.link(shaders, groups, &[], Flags::LIBRARY_KHR).0
}
