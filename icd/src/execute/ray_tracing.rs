//! Performing the commands of the ray tracing extensions.

use ash::vk;
use rayon::prelude::*;
use spirv_jit::environment::{Environment, uniform};
use spirv_jit::reach::Reach;

use super::acceleration_structure::{self, Build, Range};
use super::engine::Surroundings;
use super::reachable::read;
use crate::command::RayTracingCommand;
use crate::command::ray_tracing::IndirectBuild;
use crate::log::{self, Level};
use crate::object::ray_tracing_pipeline::RayTracingPipeline;
use crate::settings::settings;
use crate::table::limits;
use crate::trace::mask::InvocationMask;
use crate::trace::table::{Region, Tables};
use crate::trace::{Dispatch, Limits, Stopped};
use crate::validate::{Checks, Traced, invocations};

/// What is bound at the ray tracing bind point.
pub struct Bound<'a> {
    pub pipeline: Option<&'a RayTracingPipeline>,
    pub environment: Environment,
    pub limits: &'a Limits,
    pub mask: Option<InvocationMask>,
    pub stack_bytes: Option<u32>,
}

/// What a command's addresses may lead to, and who wants to know where they lead elsewhere.
pub struct Access<'a> {
    pub surroundings: &'a Surroundings,
    /// Validation, where it is on.
    pub checks: Option<Checks>,
}

/// Performs a command. What fans out does so over `workers`.
///
/// # Errors
/// A dispatch that was stopped: the device is lost.
pub fn execute(
    command: &RayTracingCommand,
    access: Access<'_>,
    bound: Option<Bound<'_>>,
    workers: &rayon::ThreadPool,
) -> Result<(), Stopped> {
    let reach = &*access.surroundings.reach;
    let checks = access.checks.as_ref();
    // SAFETY, for each block: what an address leads to is memory, which the application does not use otherwise while the command is performed.
    match *command {
        RayTracingCommand::TraceRays { ref tables, extent }
        | RayTracingCommand::TraceRaysNv { ref tables, extent } => {
            trace_rays(tables, extent, access, bound, workers)
        }
        RayTracingCommand::TraceRaysIndirect {
            ref tables,
            address,
        } => {
            if let Some(checks) = checks {
                checks.indirect(address, size_of::<[u32; 3]>() as u64);
            }
            // SAFETY: as above; the three words are read when the command is executed, since an earlier one may have written them.
            match unsafe { read(reach, address) } {
                Some(extent) => trace_rays(tables, extent, access, bound, workers),
                None => Ok(()),
            }
        }
        RayTracingCommand::TraceRaysIndirect2 { address } => {
            type Parameters = vk::TraceRaysIndirectCommand2KHR;
            if let Some(checks) = checks {
                checks.indirect(address, size_of::<Parameters>() as u64);
            }
            // SAFETY: as above.
            match unsafe { read::<Parameters>(reach, address) } {
                Some(command) => {
                    let (tables, extent) = indirect2(&command);
                    trace_rays(&tables, extent, access, bound, workers)
                }
                None => Ok(()),
            }
        }
        _ => {
            workers.install(|| on_structures(command, reach, checks));
            Ok(())
        }
    }
}

/// Performs a command on structures, on the current rayon pool.
fn on_structures(command: &RayTracingCommand, reach: &Reach, checks: Option<&Checks>) {
    // SAFETY, for each block: as in `execute`.
    match command {
        RayTracingCommand::Build(builds) => build(builds, reach, checks),
        RayTracingCommand::BuildIndirect(builds) => {
            // SAFETY: as above.
            let with_ranges = |build| unsafe { with_ranges(build, reach, checks) };
            build(
                &builds.iter().map(with_ranges).collect::<Vec<_>>(),
                reach,
                checks,
            );
        }
        RayTracingCommand::Copy {
            source,
            destination,
            mode,
        } => {
            // SAFETY: as above.
            unsafe { acceleration_structure::copy(*source, *destination, *mode, reach) };
        }
        RayTracingCommand::Serialize {
            source,
            destination,
        } => {
            let uuids = limits::serialization_uuids();
            // SAFETY: as above.
            unsafe { acceleration_structure::serialize(*source, *destination, &uuids, reach) };
        }
        RayTracingCommand::Deserialize {
            source,
            destination,
        } => {
            // SAFETY: as above.
            unsafe { acceleration_structure::deserialize(*source, *destination, reach) };
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
                    acceleration_structure::property(address, *query_type, reach)
                });
            }
        }
        // SAFETY: as above.
        RayTracingCommand::Micromap(command) => unsafe {
            super::micromap::execute(command, reach, checks)
        },
        RayTracingCommand::TraceRays { .. }
        | RayTracingCommand::TraceRaysNv { .. }
        | RayTracingCommand::TraceRaysIndirect { .. }
        | RayTracingCommand::TraceRaysIndirect2 { .. } => {}
    }
}

/// Builds side by side: the specification forbids that builds of one command depend on each other.
pub fn build(builds: &[Build], reach: &Reach, checks: Option<&Checks>) {
    let run = |build: &Build| {
        if let Some(checks) = checks {
            // SAFETY: as in `execute`.
            unsafe { checks.build(build, reach) };
        }
        // SAFETY: as in `execute`.
        if let Err(error) = unsafe { build.execute(reach) } {
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
/// Nothing writes the ranges meanwhile.
unsafe fn with_ranges(indirect: &IndirectBuild, reach: &Reach, checks: Option<&Checks>) -> Build {
    let mut build = indirect.build.clone();
    for (index, &max) in indirect.max_primitive_counts.iter().enumerate() {
        let offset = index as u64 * u64::from(indirect.stride_bytes);
        let address = indirect.ranges.wrapping_add(offset);
        // SAFETY: the caller's promise. What is not there is a range of nothing.
        let range = unsafe { read::<Range>(reach, address) }.unwrap_or_default();
        if let Some(checks) = checks {
            checks.ranges(address, size_of::<Range>() as u64);
            checks.range_count(address, range.primitive_count, max);
        }
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
    access: Access<'_>,
    bound: Option<Bound<'_>>,
    workers: &rayon::ThreadPool,
) -> Result<(), Stopped> {
    let Some(Bound {
        pipeline: Some(pipeline),
        mut environment,
        mask,
        stack_bytes,
        limits,
    }) = bound
    else {
        return Ok(());
    };
    let surroundings = access.surroundings;
    let checks = access.checks.map(|checks| {
        checks.tables(tables);
        checks.extent(extent);
        if let Some(mask) = &mask {
            checks.mask(mask, extent);
        }
        let stack_bytes = stack_bytes.filter(|_| pipeline.facts.has_dynamic_stack);
        Traced::new(checks, pipeline.facts, stack_bytes.map(u64::from))
    });
    if invocations(extent).is_none() {
        let message =
            format!("a dispatch of {extent:?} rays is past maxRayDispatchInvocationCount");
        log::write(Level::Error, &message);
        return Ok(());
    }
    let launch = uniform::LAUNCH_SIZE as usize;
    environment.uniforms[launch..launch + 3].copy_from_slice(&extent);
    let dispatch = Dispatch {
        shaders: &pipeline.shaders,
        tables: confined(tables, &surroundings.reach),
        extent,
        environment: &environment,
        pipeline_ray_flags: pipeline.ray_flags,
        // Validation is to see every record that is looked up.
        takes_all_hits: settings().opaque_without_any_hit
            && !pipeline.shaders.has_any_hit
            && checks.is_none(),
        mask: mask.filter(|mask| surroundings.reach.contains(mask.address, mask.size_bytes())),
        limits,
        checks: checks.as_ref(),
    };
    let traced = pipeline.tracer.trace_rays(&dispatch, workers);
    if let Some(traced) = &checks {
        traced.checks.strays(surroundings);
    }
    traced
}

/// Tables as far as there is memory.
fn confined(tables: &Tables, reach: &Reach) -> Tables {
    let confined = |region: &Region| Region {
        size_bytes: reach.clip(region.address, region.size_bytes),
        ..*region
    };
    Tables {
        raygen: confined(&tables.raygen),
        miss: confined(&tables.miss),
        hit: confined(&tables.hit),
        callable: confined(&tables.callable),
    }
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
