//! Performing the commands of the ray tracing extensions.

use ash::vk;
use rayon::prelude::*;
use spirv_jit::environment::{Environment, uniform};

use super::acceleration_structure::{self, Build, Range};
use crate::command::RayTracingCommand;
use crate::command::ray_tracing::IndirectBuild;
use crate::log::{self, Level};
use crate::object::ray_tracing_pipeline::RayTracingPipeline;
use crate::table::limits;
use crate::trace::mask::InvocationMask;
use crate::trace::table::{Region, Tables};
use crate::trace::{Dispatch, Limits, Stopped};

/// What is bound at the ray tracing bind point.
pub struct Bound<'a> {
    pub pipeline: Option<&'a RayTracingPipeline>,
    pub environment: Environment,
    pub limits: &'a Limits,
    pub mask: Option<InvocationMask>,
}

/// Performs a command. What fans out does so over `workers`.
///
/// # Errors
/// A dispatch that was stopped: the device is lost.
pub fn execute(
    command: &RayTracingCommand,
    bound: Option<Bound<'_>>,
    workers: &rayon::ThreadPool,
) -> Result<(), Stopped> {
    // SAFETY, for each block: the application keeps the valid usage of the command; the addresses were taken from live objects and
    // stay mapped for the device's life.
    match command {
        RayTracingCommand::TraceRays { tables, extent } => {
            trace_rays(tables, *extent, bound, workers)
        }
        RayTracingCommand::TraceRaysIndirect { tables, address } => {
            // SAFETY: as above; the three words are read when the command is executed, since an earlier one may have written them.
            let extent = unsafe { std::ptr::read_unaligned(*address as *const [u32; 3]) };
            trace_rays(tables, extent, bound, workers)
        }
        RayTracingCommand::TraceRaysIndirect2 { address } => {
            let command = *address as *const vk::TraceRaysIndirectCommand2KHR;
            // SAFETY: as above.
            let (tables, extent) = indirect2(&unsafe { command.read_unaligned() });
            trace_rays(&tables, extent, bound, workers)
        }
        _ => {
            workers.install(|| on_structures(command));
            Ok(())
        }
    }
}

/// Performs a command on structures, on the current rayon pool.
fn on_structures(command: &RayTracingCommand) {
    // SAFETY, for each block: as in `execute`.
    match command {
        RayTracingCommand::Build(builds) => build(builds),
        RayTracingCommand::BuildIndirect(builds) => {
            // SAFETY: as above.
            build(
                &builds
                    .iter()
                    .map(|build| unsafe { with_ranges(build) })
                    .collect::<Vec<_>>(),
            );
        }
        RayTracingCommand::Copy {
            source,
            destination,
            mode,
        } => {
            // SAFETY: as above.
            unsafe { acceleration_structure::copy(*source, *destination, *mode) };
        }
        RayTracingCommand::Serialize {
            source,
            destination,
        } => {
            // SAFETY: as above.
            unsafe {
                acceleration_structure::serialize(
                    *source,
                    *destination,
                    &limits::serialization_uuids(),
                )
            };
        }
        RayTracingCommand::Deserialize {
            source,
            destination,
        } => {
            // SAFETY: as above.
            unsafe { acceleration_structure::deserialize(*source, *destination) };
        }
        RayTracingCommand::WriteProperties {
            structures,
            query_type,
            pool,
            first,
        } => {
            for (index, &address) in (*first..).zip(structures) {
                // SAFETY: as above.
                pool.write(index, unsafe {
                    acceleration_structure::property(address, *query_type)
                });
            }
        }
        // SAFETY: as above.
        RayTracingCommand::Micromap(command) => unsafe { super::micromap::execute(command) },
        RayTracingCommand::TraceRays { .. }
        | RayTracingCommand::TraceRaysIndirect { .. }
        | RayTracingCommand::TraceRaysIndirect2 { .. } => {}
    }
}

/// Builds side by side: the specification forbids that builds of one command depend on each other.
pub fn build(builds: &[Build]) {
    let run = |build: &Build| {
        // SAFETY: as in `execute`.
        if let Err(error) = unsafe { build.execute() } {
            log::write(
                Level::Error,
                &format!("acceleration structure build: {error:?}"),
            );
        }
    };
    match builds {
        [one] => run(one),
        _ => builds.par_iter().for_each(run),
    }
}

/// How many threads have something to do in these builds.
pub fn build_concurrency(builds: &[Build]) -> usize {
    /// Primitives that are worth a thread.
    const SHARE: u64 = 4096;
    let shares = |build: &Build| build.geometries.primitive_count().div_ceil(SHARE).max(1);
    usize::try_from(builds.iter().map(shares).sum::<u64>()).unwrap_or(usize::MAX)
}

/// Reads an indirect build's ranges.
///
/// # Safety
/// There is a readable range for each geometry.
unsafe fn with_ranges(indirect: &IndirectBuild) -> Build {
    let mut build = indirect.build.clone();
    for (index, &max) in indirect.max_primitive_counts.iter().enumerate() {
        let address = indirect.ranges + index as u64 * u64::from(indirect.stride_bytes);
        // SAFETY: the caller's promise.
        let range = unsafe { std::ptr::read_unaligned(address as *const Range) };
        let primitive_count = range.primitive_count.min(max);
        build.geometries.apply_range(
            index,
            &Range {
                primitive_count,
                ..range
            },
        );
    }
    build
}

/// The tables and the extent of a `VkTraceRaysIndirectCommand2KHR`. The ray generation table is one record.
fn indirect2(command: &vk::TraceRaysIndirectCommand2KHR) -> (Tables, [u32; 3]) {
    let region = |address, stride_bytes, size_bytes| Region {
        address,
        stride_bytes,
        size_bytes,
    };
    let tables = Tables {
        raygen: region(
            command.raygen_shader_record_address,
            command.raygen_shader_record_size,
            command.raygen_shader_record_size,
        ),
        miss: region(
            command.miss_shader_binding_table_address,
            command.miss_shader_binding_table_stride,
            command.miss_shader_binding_table_size,
        ),
        hit: region(
            command.hit_shader_binding_table_address,
            command.hit_shader_binding_table_stride,
            command.hit_shader_binding_table_size,
        ),
        callable: region(
            command.callable_shader_binding_table_address,
            command.callable_shader_binding_table_stride,
            command.callable_shader_binding_table_size,
        ),
    };
    (tables, [command.width, command.height, command.depth])
}

fn trace_rays(
    tables: &Tables,
    extent: [u32; 3],
    bound: Option<Bound<'_>>,
    workers: &rayon::ThreadPool,
) -> Result<(), Stopped> {
    let Some(Bound {
        pipeline: Some(pipeline),
        mut environment,
        mask,
        limits,
    }) = bound
    else {
        return Ok(());
    };
    let invocations = extent.iter().map(|&n| u64::from(n)).product::<u64>();
    if invocations > u64::from(limits::MAX_RAY_DISPATCH_INVOCATIONS) {
        log::write(
            Level::Error,
            &format!("a dispatch of {invocations} rays is past maxRayDispatchInvocationCount"),
        );
        return Ok(());
    }
    let launch = uniform::LAUNCH_SIZE as usize;
    environment.uniforms[launch..launch + 3].copy_from_slice(&extent);
    let dispatch = Dispatch {
        shaders: &pipeline.shaders,
        tables: *tables,
        extent,
        environment: &environment,
        pipeline_ray_flags: pipeline.ray_flags,
        mask,
        limits,
    };
    pipeline.tracer.trace_rays(&dispatch, workers)
}

/// `vkGetDeviceAccelerationStructureCompatibilityKHR`: whether serialized data can be deserialized here.
///
/// # Safety
/// `data` points to the two identifiers at the head of serialized data.
pub unsafe fn compatibility(data: *const u8) -> vk::AccelerationStructureCompatibilityKHR {
    // SAFETY: the caller's promise.
    let uuids = unsafe { std::ptr::read_unaligned(data.cast::<acceleration_structure::Uuids>()) };
    if uuids == limits::serialization_uuids() {
        vk::AccelerationStructureCompatibilityKHR::COMPATIBLE
    } else {
        vk::AccelerationStructureCompatibilityKHR::INCOMPATIBLE
    }
}
