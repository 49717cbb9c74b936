//! Work that applications leave to their own threads, and data that they keep between runs:
//! deferred operations and pipeline caches.

use std::sync::Mutex;
use std::thread;

use ash::khr;
use tuff_tests::*;

/// Joins an operation from several threads until it is complete, and takes its result.
fn join(gpu: &Gpu, operation: vk::DeferredOperationKHR, threads: usize) -> Result<(), vk::Result> {
    let host = khr::deferred_host_operations::Device::new(&gpu.instance, &gpu.device);
    // SAFETY: the operation outlives the threads.
    unsafe {
        thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    loop {
                        match host.deferred_operation_join(operation) {
                            Err(vk::Result::THREAD_IDLE_KHR) => thread::yield_now(),
                            Ok(()) | Err(vk::Result::THREAD_DONE_KHR) => break,
                            Err(other) => panic!("{other}"),
                        }
                    }
                });
            }
        });
        // A thread that came late may have gone before the others had finished; all are through
        // now.
        assert_eq!(host.get_deferred_operation_max_concurrency(operation), 0);
        host.get_deferred_operation_result(operation)
    }
}

/// Performs a command that may defer, and joins as many threads as it has work for.
fn perform(
    gpu: &Gpu,
    command: impl FnOnce(vk::DeferredOperationKHR) -> vk::Result,
) -> Result<(), vk::Result> {
    let host = khr::deferred_host_operations::Device::new(&gpu.instance, &gpu.device);
    // SAFETY: the operation is used by this function alone.
    unsafe {
        let operation = host.create_deferred_operation(None)?;
        let result = match command(operation) {
            vk::Result::SUCCESS | vk::Result::OPERATION_NOT_DEFERRED_KHR => Ok(()),
            vk::Result::OPERATION_DEFERRED_KHR => {
                let most = host.get_deferred_operation_max_concurrency(operation);
                let pending = host.get_deferred_operation_result(operation);
                assert!(most > 0 && pending == Err(vk::Result::NOT_READY));
                join(gpu, operation, (most as usize).clamp(2, 5))
            }
            other => Err(other),
        };
        host.destroy_deferred_operation(operation, None);
        result
    }
}

const RAYGEN: &str = r"
layout(set = 0, binding = 0, std430) buffer R { uint results[]; };
layout(location = 0) callableDataEXT uint data;
void main() {
    data = 5u;
    executeCallableEXT(gl_LaunchIDEXT.x % 3u, 0);
    results[gl_LaunchIDEXT.x] = data;
}";

/// A shader that adds a number.
fn callable(number: u32) -> String {
    format!(
        "layout(location = 0) callableDataInEXT uint data; void main() {{ data += {number}u; }}"
    )
}

/// The parts of pipelines: a ray generation shader and three callables.
struct Parts {
    modules: Vec<(Stage, vk::ShaderModule)>,
    set: Set,
    layout: vk::PipelineLayout,
    output: Buffer,
}

impl Parts {
    fn new(gpu: &Gpu) -> Parts {
        let mut modules = vec![(Stage::RayGeneration, glsl(Stage::RayGeneration, RAYGEN))];
        for number in [100, 200, 300] {
            modules.push((Stage::Callable, glsl(Stage::Callable, &callable(number))));
        }
        let module = |(stage, words): &(Stage, Vec<u32>)| (*stage, gpu.module(words));
        let output = gpu.buffer(4 * 6);
        let set = gpu.set_of(&[output.into()]);
        let layout = gpu.layout(&[set.layout]);
        Parts {
            modules: modules.iter().map(module).collect(),
            set,
            layout,
            output,
        }
    }

    /// Creates a pipeline with a cache, through an operation.
    fn create(
        &self,
        gpu: &Gpu,
        operation: vk::DeferredOperationKHR,
        cache: vk::PipelineCache,
        flags: vk::PipelineCreateFlags,
        run: impl FnOnce(vk::Result) -> Result<(), vk::Result>,
    ) -> Result<vk::Pipeline, vk::Result> {
        let stage = |(stage, module): &(Stage, vk::ShaderModule)| {
            vk::PipelineShaderStageCreateInfo::default()
                .stage(stage_flag(*stage))
                .module(*module)
                .name(c"main")
        };
        let stages: Vec<_> = self.modules.iter().map(stage).collect();
        let group = |index| {
            vk::RayTracingShaderGroupCreateInfoKHR::default()
                .ty(vk::RayTracingShaderGroupTypeKHR::GENERAL)
                .general_shader(index)
                .closest_hit_shader(vk::SHADER_UNUSED_KHR)
                .any_hit_shader(vk::SHADER_UNUSED_KHR)
                .intersection_shader(vk::SHADER_UNUSED_KHR)
        };
        let groups: Vec<_> = (0..4).map(group).collect();
        let info = [vk::RayTracingPipelineCreateInfoKHR::default()
            .flags(flags)
            .stages(&stages)
            .groups(&groups)
            .max_pipeline_ray_recursion_depth(1)
            .layout(self.layout)];
        let mut pipeline = vk::Pipeline::null();
        let create = gpu.ray_tracing.fp().create_ray_tracing_pipelines_khr;
        // SAFETY: everything lives until the operation is complete.
        let result = unsafe {
            let device = gpu.device.handle();
            create(
                device,
                operation,
                cache,
                1,
                info.as_ptr(),
                std::ptr::null(),
                &mut pipeline,
            )
        };
        run(result).map(|()| pipeline)
    }

    fn plain(
        &self,
        gpu: &Gpu,
        cache: vk::PipelineCache,
        flags: vk::PipelineCreateFlags,
    ) -> Result<vk::Pipeline, vk::Result> {
        self.create(
            gpu,
            vk::DeferredOperationKHR::null(),
            cache,
            flags,
            vk::Result::result,
        )
    }

    /// Runs the pipeline, and destroys it.
    fn check(&self, gpu: &Gpu, pipeline: vk::Pipeline) {
        let rays = gpu.rays_of(pipeline, self.layout, self.set, 4);
        let table = Table {
            raygen: Record::of(0),
            callable: (1..4).map(Record::of).collect(),
            ..Table::default()
        };
        self.output.write(0, &[0u32; 6]);
        gpu.trace(&rays, &table, [6, 1, 1]);
        let results: Vec<u32> = self.output.read();
        assert_eq!(results, [105, 205, 305, 105, 205, 305]);
        // SAFETY: its work is done.
        unsafe { gpu.device.destroy_pipeline(pipeline, None) };
    }
}

#[test]
fn pipelines_come_out_of_deferred_operations() {
    let gpu = Gpu::new();
    let parts = Parts::new(&gpu);
    let none = vk::PipelineCache::null();
    let host = khr::deferred_host_operations::Device::new(&gpu.instance, &gpu.device);
    // SAFETY: the operation is complete before it is used again or destroyed.
    unsafe {
        let operation = host.create_deferred_operation(None).unwrap();
        // An operation may be used again.
        for threads in [1, 4] {
            let flags = vk::PipelineCreateFlags::empty();
            let pipeline = parts.create(&gpu, operation, none, flags, |result| match result {
                vk::Result::SUCCESS | vk::Result::OPERATION_NOT_DEFERRED_KHR => Ok(()),
                vk::Result::OPERATION_DEFERRED_KHR => join(&gpu, operation, threads),
                other => Err(other),
            });
            parts.check(&gpu, pipeline.expect("a pipeline"));
        }
        host.destroy_deferred_operation(operation, None);
    }
}

#[test]
fn structures_are_built_by_the_threads_that_join() {
    let gpu = Gpu::new();
    if !has("host commands", gpu.has_host_commands) {
        return;
    }
    let count = 12_000;
    let triangle = |i: u32| {
        let (x, z) = (i as f32, 1.0 + (i % 7) as f32);
        [[x, 0.0, z], [x + 1.0, 0.0, z], [x, 1.0, z]]
    };
    let corners: Vec<[f32; 3]> = (0..count).flat_map(triangle).collect();
    let at = vk::DeviceOrHostAddressConstKHR {
        host_address: corners.as_ptr().cast(),
    };
    let geometry = [geometry_of(triangles_at(at, 3 * count)).flags(vk::GeometryFlagsKHR::OPAQUE)];
    let level = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
    let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(level)
        .geometries(&geometry);
    let on_host = vk::AccelerationStructureBuildTypeKHR::HOST;
    let sizes = gpu.build_sizes(on_host, &info, &[count]);
    let structure = gpu.empty_structure(level, sizes.acceleration_structure_size);
    let mut scratch = vec![0u8; sizes.build_scratch_size as usize];
    info.scratch_data.host_address = scratch.as_mut_ptr().cast();
    info = info.dst_acceleration_structure(structure.handle);
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
    let ranges = [std::ptr::from_ref(&range)];
    let build = gpu.acceleration.fp().build_acceleration_structures_khr;
    // SAFETY: what the build reads and writes lives until it is complete.
    let built = perform(&gpu, |operation| unsafe {
        build(gpu.device.handle(), operation, 1, &info, ranges.as_ptr())
    });
    built.expect("the build succeeds");

    let copied = gpu.empty_structure(level, sizes.acceleration_structure_size);
    let copy = vk::CopyAccelerationStructureInfoKHR::default()
        .src(structure.handle)
        .dst(copied.handle)
        .mode(vk::CopyAccelerationStructureModeKHR::CLONE);
    let run = gpu.acceleration.fp().copy_acceleration_structure_khr;
    // SAFETY: the structures outlive the copy.
    let done = perform(&gpu, |operation| unsafe {
        run(gpu.device.handle(), operation, &copy)
    });
    done.expect("the copy succeeds");
    for structure in [structure, copied] {
        let world = gpu.top(&[Instance::of(structure)]);
        let expected: Vec<f32> = (0..count).map(|i| 1.0 + (i % 7) as f32).collect();
        assert_eq!(gpu.depths(world, count), expected);
    }
}

/// A cache that starts with data.
fn cache_of(gpu: &Gpu, data: &[u8]) -> vk::PipelineCache {
    let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
    // SAFETY: `info` outlives the call.
    unsafe { gpu.device.create_pipeline_cache(&info, None) }.expect("vkCreatePipelineCache")
}

#[test]
fn caches_carry_programs_from_one_to_the_next() {
    let gpu = Gpu::new();
    let parts = Parts::new(&gpu);
    let (any, only_cached) = (
        vk::PipelineCreateFlags::empty(),
        vk::PipelineCreateFlags::FAIL_ON_PIPELINE_COMPILE_REQUIRED,
    );
    let can_require = gpu.features13.pipeline_creation_cache_control == vk::TRUE;
    // SAFETY: caches and pipelines are of this device, and destroyed once.
    unsafe {
        let first = cache_of(&gpu, &[]);
        // Whether a pipeline of an empty cache needs compiling is the driver's to say.
        if can_require && gpu.is_tuff() {
            let refused = parts.plain(&gpu, first, only_cached);
            assert_eq!(refused, Err(vk::Result::PIPELINE_COMPILE_REQUIRED));
        }
        parts.check(&gpu, parts.plain(&gpu, first, any).unwrap());
        let data = gpu.device.get_pipeline_cache_data(first).unwrap();
        unless_known(&gpu, "llvmpipe", "the header is cut off", || {
            // VkPipelineCacheHeaderVersionOne.
            let word = |at: usize| u32::from_le_bytes(data[at..at + 4].try_into().unwrap());
            let properties = gpu.instance.get_physical_device_properties(gpu.physical);
            assert_eq!(word(0), 32);
            assert_eq!(word(4), 1);
            assert_eq!(word(8), properties.vendor_id);
            assert_eq!(word(12), properties.device_id);
            assert_eq!(data[16..32], properties.pipeline_cache_uuid);
        });

        let second = cache_of(&gpu, &data);
        let merged = cache_of(&gpu, &[]);
        gpu.device.merge_pipeline_caches(merged, &[second]).unwrap();
        for cache in [second, merged] {
            // A cached program need not be compiled; drivers may keep less, but Tuff keeps all.
            let flags = if can_require && gpu.is_tuff() {
                only_cached
            } else {
                any
            };
            parts.check(&gpu, parts.plain(&gpu, cache, flags).unwrap());
        }
        for cache in [first, second, merged] {
            gpu.device.destroy_pipeline_cache(cache, None);
        }
    }
}

#[test]
fn damaged_cache_data_is_survived() {
    // Such data is not what a call returned, so that only this driver promises anything.
    let gpu = Gpu::without_validation();
    if !has("a driver that promises this", gpu.is_tuff()) {
        return;
    }
    let parts = Parts::new(&gpu);
    let any = vk::PipelineCreateFlags::empty();
    // SAFETY: caches and pipelines are of this device, and destroyed once.
    unsafe {
        let cache = cache_of(&gpu, &[]);
        parts.check(&gpu, parts.plain(&gpu, cache, any).unwrap());
        let whole = gpu.device.get_pipeline_cache_data(cache).unwrap();
        gpu.device.destroy_pipeline_cache(cache, None);
        let mut random = Rng::with_seed(7);
        for round in 0..40 {
            let mut data = whole.clone();
            for _ in 0..1 + round % 3 {
                let at = random.usize(..data.len());
                data[at] ^= 1 << random.u32(..8);
            }
            if round % 2 == 0 {
                data.truncate(random.usize(..=data.len()));
            }
            let cache = cache_of(&gpu, &data);
            parts.check(&gpu, parts.plain(&gpu, cache, any).unwrap());
            gpu.device.destroy_pipeline_cache(cache, None);
        }
    }
}

/// Devices of one process have nothing to do with one another. Making and destroying them takes
/// turns: the loader's list of devices has no lock (Vulkan-Loader issue 2018), nor has the table of
/// handles of older validation layers (Vulkan-ValidationLayers issue 4391).
#[test]
fn devices_of_several_threads_work_side_by_side() {
    const RAYS: u32 = 256;
    let turn = Mutex::new(());
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        uint i = gl_LaunchIDEXT.x;
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0, 0, (float(i) + 0.5) / 16.0), 0.0, vec3(0, 0, 1), 100.0, 0);
        results[i] = payload;
    }";
    let closest = r"
    layout(location = 0) rayPayloadInEXT uint payload;
    void main() { payload = gl_PrimitiveID; }";
    let work = |layer_count: u32| {
        let alone = turn.lock().unwrap();
        let gpu = Gpu::without_validation();
        drop(alone);
        for _ in 0..8 {
            let world = gpu.scene(&[Geometry::triangles(
                &layers(layer_count),
                vk::GeometryFlagsKHR::OPAQUE,
            )]);
            let got = Case::with_words(raygen).hit(closest).words(
                &gpu,
                world,
                [RAYS, 1, 1],
                RAYS as usize,
            );
            for (i, got) in got.into_iter().enumerate() {
                // The layers stand at 1, 2, 3, ….
                let next = i as u32 / 16;
                let expected = if next < layer_count { next } else { u32::MAX };
                assert_eq!(
                    got, expected,
                    "ray {i} of the device with {layer_count} layers"
                );
            }
        }
        let _alone = turn.lock();
        drop(gpu);
    };
    thread::scope(|scope| {
        for layer_count in [3, 6, 9, 12] {
            scope.spawn({
                let work = &work;
                move || work(layer_count)
            });
        }
    });
}
