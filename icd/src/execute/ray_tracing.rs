//! Performs dispatches of rays.

use ash::vk;
use lanes::Tier;
use spirv_jit::reach::Reach;

use super::bindings::Bindings;
use super::engine::Engine;
use super::{Failure, check_aborted, prints, show_strays, spans};
use crate::capture::{self, Recording};
use crate::command::RayTracingCommand;
use crate::object::ray_tracing_pipeline::RayTracingPipeline;
use crate::settings::settings;
use crate::timeline::{self, Kind};
use crate::trace::Dispatch;
use crate::trace::stats::Occupancy;
use crate::validate::{Caller, Checks, Traced, invocations};
use crate::wave::binding_table::{Region, Tables};
use crate::wave::mask::{InvocationMask, LiveMask};
use crate::wave::observer::Observer;
use crate::wave::observers::Observers;
use crate::wave::reachable::read;

/// Performs a dispatch, with the device's workers where it is large.
///
/// # Errors
/// A limit stopped it: the device is lost.
pub fn perform(
    engine: &Engine,
    bindings: &mut Bindings<'_>,
    command: &RayTracingCommand,
) -> Result<(), Failure> {
    let reach = engine.memory.reach();
    let checks = engine.checks(match command {
        RayTracingCommand::TraceRays { .. } => Caller::TraceRays,
        RayTracingCommand::TraceRaysNv { .. } => Caller::TraceRaysNv,
        RayTracingCommand::TraceRaysIndirect { .. } => Caller::TraceRaysIndirect,
        RayTracingCommand::TraceRaysIndirect2 { .. } => Caller::TraceRaysIndirect2,
    });
    match parameters(command, &reach, checks.as_ref()) {
        Some((tables, extent)) => trace_rays(engine, bindings, &reach, checks, &tables, extent),
        None => Ok(()),
    }
}

/// The tables and the extent of a dispatch. Those in memory are read when the command executes,
/// since an earlier command may have written them; `None` if their address is invalid.
fn parameters(
    command: &RayTracingCommand,
    reach: &Reach,
    checks: Option<&Checks>,
) -> Option<(Tables, [u32; 3])> {
    match *command {
        RayTracingCommand::TraceRays { tables, extent }
        | RayTracingCommand::TraceRaysNv { tables, extent } => Some((tables, extent)),
        RayTracingCommand::TraceRaysIndirect { tables, address } => {
            if let Some(checks) = checks {
                checks.indirect(address, size_of::<[u32; 3]>() as u64);
            }
            // SAFETY: addresses in reach lead to memory, and the application does not use it
            // otherwise while the command is performed.
            Some((tables, unsafe { read(reach, address) }?))
        }
        RayTracingCommand::TraceRaysIndirect2 { address } => {
            type Parameters = vk::TraceRaysIndirectCommand2KHR;
            if let Some(checks) = checks {
                checks.indirect(address, size_of::<Parameters>() as u64);
            }
            // SAFETY: as for the extent alone.
            unsafe { read::<Parameters>(reach, address) }.map(|command| indirect2(&command))
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

/// Checks the tables, the extent and the mask of a launch. Returns the checks for its execution.
fn check_launch(
    checks: Checks,
    (tables, extent, mask): (&Tables, [u32; 3], Option<&InvocationMask>),
    pipeline: &RayTracingPipeline,
    stack_bytes: Option<u32>,
) -> Traced {
    checks.tables(tables);
    checks.extent(extent);
    if let Some(mask) = mask {
        checks.mask(mask, extent);
    }
    let stack_bytes = stack_bytes.filter(|_| pipeline.facts.has_dynamic_stack);
    Traced::new(checks, pipeline.facts, stack_bytes.map(u64::from))
}

fn trace_rays(
    engine: &Engine,
    bindings: &mut Bindings<'_>,
    reach: &Reach,
    checks: Option<Checks>,
    tables: &Tables,
    extent: [u32; 3],
) -> Result<(), Failure> {
    let limits = &engine.limits();
    let (mask, stack_bytes) = (bindings.invocation_mask, bindings.stack_bytes);
    let bind_point = vk::PipelineBindPoint::RAY_TRACING_KHR;
    let Some((pipeline, mut environment)) = bindings.environment(bind_point, extent, engine) else {
        return Ok(());
    };
    let Some(pipeline) = pipeline.ray_tracing() else {
        return Ok(());
    };
    let launch = (tables, extent, mask.as_ref());
    let checks = checks.map(|it| check_launch(it, launch, pipeline, stack_bytes));
    if invocations(extent).is_none() {
        log::error!("a dispatch of {extent:?} rays is past maxRayDispatchInvocationCount");
        return Ok(());
    }
    let programs = pipeline.shaders.programs.iter();
    if pipeline.shaders.prints {
        environment.prints = prints::of(programs.clone());
    }
    let recording = capture::trace(&pipeline.shaders, extent);
    let occupancy = Occupancy::new(&pipeline.shaders);
    let observers = Observers::new([
        checks.as_ref().map(|checks| checks as &dyn Observer),
        recording.as_ref().map(Recording::observer),
        occupancy.as_ref().map(|counts| counts as &dyn Observer),
        engine.wild_observer(),
    ]);
    let dispatch = Dispatch {
        shaders: &pipeline.shaders,
        tier: Tier::best(),
        // SAFETY: the application keeps its memory until the dispatch is over, and memory that it
        // frees earlier stays mapped.
        tables: unsafe { tables.live(reach) },
        extent,
        environment: &environment,
        pipeline_ray_flags: pipeline.ray_flags,
        // Validation must see every record that is looked up.
        takes_all_hits: settings().opaque_without_any_hit
            && !pipeline.shaders.has_any_hit
            && checks.is_none(),
        // SAFETY: the application keeps its memory until the dispatch is over, and memory that it
        // frees earlier stays mapped.
        mask: mask.and_then(|mask| unsafe { LiveMask::new(mask, reach) }),
        limits,
        observer: observers.all(),
    };
    let _span = timeline::span(Kind::Trace, || spans::trace(pipeline, extent));
    let traced = engine.tracer.trace_rays(&dispatch, &engine.workers);
    let live_tables = dispatch.tables;
    if let Some(strays) = &environment.strays {
        show_strays(&observers, strays, programs.clone());
    }
    drop(observers);
    if let Some(recording) = recording {
        let table = capture::Traced {
            shaders: &pipeline.shaders,
            given: tables,
            live: &live_tables,
        };
        let programs = programs.clone().map(|program| &**program);
        // SAFETY: the application keeps its memory until the dispatch is over, and memory that it
        // frees earlier stays mapped.
        unsafe { recording.finish(programs, Some(table), &limits.live, traced.is_err()) };
    }
    if let Some(prints) = &environment.prints {
        prints::print(engine, prints, programs.clone());
    }
    check_aborted(engine, programs)?;
    traced.map_err(|why| limits.fault(why).into())
}
