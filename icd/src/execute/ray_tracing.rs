//! Performs the commands of the ray tracing extensions.

use ash::vk;
use lanes::Tier;
use spirv_jit::environment::{Environment, uniform};

use super::engine::Engine;
use super::{Failure, check_aborted, note_strays, prints, spans};
use crate::capture::{self, Recording};
use crate::command::RayTracingCommand;
use crate::object::ray_tracing_pipeline::RayTracingPipeline;
use crate::settings::settings;
use crate::structures;
use crate::timeline::{self, Kind};
use crate::trace::Dispatch;
use crate::validate::{Checks, Traced, invocations};
use crate::wave::Limits;
use crate::wave::Surroundings;
use crate::wave::mask::{InvocationMask, LiveMask};
use crate::wave::reachable::read;
use crate::wave::table::{Region, Tables};

/// The bindings of the ray tracing bind point.
pub struct Bound<'a> {
    pub pipeline: Option<&'a RayTracingPipeline>,
    pub environment: Environment,
    pub limits: &'a Limits,
    pub mask: Option<InvocationMask>,
    pub stack_bytes: Option<u32>,
}

/// The memory that a command's addresses may point into, and the reporter of invalid addresses.
pub struct Access<'a> {
    pub surroundings: &'a Surroundings,
    /// Validation, if it is enabled.
    pub checks: Option<Checks>,
}

/// Performs a command, with the device's workers where it is large.
///
/// # Errors
/// A limit stopped a dispatch: the device is lost.
pub fn execute(
    command: &RayTracingCommand,
    access: Access<'_>,
    bound: Option<Bound<'_>>,
    engine: &Engine,
) -> Result<(), Failure> {
    let reach = &*access.surroundings.reach;
    let live = &access.surroundings.live;
    let checks = access.checks.as_ref();
    // SAFETY, for each block: addresses in reach lead to memory, and the application does not use
    // it otherwise while the command is performed.
    match *command {
        RayTracingCommand::TraceRays { ref tables, extent }
        | RayTracingCommand::TraceRaysNv { ref tables, extent } => {
            trace_rays(tables, extent, access, bound, engine)
        }
        RayTracingCommand::TraceRaysIndirect {
            ref tables,
            address,
        } => {
            if let Some(checks) = checks {
                checks.indirect(address, size_of::<[u32; 3]>() as u64);
            }
            // SAFETY: as for the first block. The words are read when the command executes, since
            // an earlier command may have written them.
            match unsafe { read(reach, address) } {
                Some(extent) => trace_rays(tables, extent, access, bound, engine),
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
                    trace_rays(&tables, extent, access, bound, engine)
                }
                None => Ok(()),
            }
        }
        _ => {
            let _span = timeline::span(Kind::Build, || spans::build(command));
            engine.workers.install(|| {
                structures::execute(command, engine.serializes_blocks, reach, live, checks)
            });
            Ok(())
        }
    }
}

/// The tables and the extent of a `VkTraceRaysIndirectCommand2KHR`. The ray generation table is one
/// record.
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
    engine: &Engine,
) -> Result<(), Failure> {
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
        log::error!("a dispatch of {extent:?} rays is past maxRayDispatchInvocationCount");
        return Ok(());
    }
    let launch = uniform::LAUNCH_SIZE as usize;
    environment.uniforms[launch..launch + 3].copy_from_slice(&extent);
    let programs = pipeline.shaders.programs.iter();
    if pipeline.shaders.prints {
        environment.prints = prints::of(programs.clone());
    }
    let recording = capture::trace(&pipeline.shaders, extent);
    let dispatch = Dispatch {
        shaders: &pipeline.shaders,
        tier: Tier::best(),
        // SAFETY: the application keeps its memory until the dispatch is over, and memory that it
        // frees earlier stays mapped.
        tables: unsafe { tables.live(&surroundings.reach) },
        extent,
        environment: &environment,
        pipeline_ray_flags: pipeline.ray_flags,
        // Validation must see every record that is looked up.
        takes_all_hits: settings().opaque_without_any_hit
            && !pipeline.shaders.has_any_hit
            && checks.is_none(),
        // SAFETY: as above.
        mask: mask.and_then(|mask| unsafe { LiveMask::new(mask, &surroundings.reach) }),
        limits,
        checks: checks.as_ref(),
        observer: recording.as_ref().map(Recording::observer),
    };
    let _span = timeline::span(Kind::Trace, || spans::trace(pipeline, extent));
    let traced = engine.tracer.trace_rays(&dispatch, &engine.workers);
    let live_tables = dispatch.tables;
    if let Some(recording) = recording {
        let table = capture::Traced {
            shaders: &pipeline.shaders,
            given: tables,
            live: &live_tables,
        };
        let programs = programs.clone().map(|program| &**program);
        // SAFETY: as above.
        unsafe { recording.finish(programs, Some(table), &surroundings.live, traced.is_err()) };
    }
    if let Some(strays) = &surroundings.strays {
        let checks = checks.as_ref().map(|traced| &traced.checks);
        note_strays(engine, checks, strays, programs.clone());
    }
    if let Some(prints) = &environment.prints {
        prints::print(engine, prints, programs.clone());
    }
    check_aborted(engine, programs)?;
    traced.map_err(|why| limits.fault(why).into())
}
