//! Performs recorded commands, in order, on a queue's thread. What is worth it fans out over the
//! device's workers.
//!
//! **Barriers, pipeline stages and access masks are not recorded,** except barriers inside passes
//! that shaders wait for. A queue performs one command after the other. Each command is complete,
//! and its writes are visible to every thread, before the next begins: workers join at the end of a
//! command, and memory is the host's own coherent memory. That is more than any
//! `vkCmdPipelineBarrier` requires. Image layouts have no meaning, since images have one storage
//! layout, and one queue family needs no ownership transfers. Of the synchronization commands only
//! events remain, which queues and the host can wait for.
//!
//! Each kind of work is a function of what the command holds. Those on images take the objects and
//! the regions as recorded:
//!
//! ```text
//! copy::copy_image(workers: &Workers, source: &Image, destination: &Image, region: &vk::ImageCopy)
//! copy::copy_buffer_to_image(workers: &Workers, source: u64, destination: &Image, region: &vk::BufferImageCopy)
//! copy::copy_image_to_buffer(workers: &Workers, source: &Image, destination: u64, region: &vk::BufferImageCopy)
//! blit::blit_image(workers: &Workers, source: &Image, destination: &Image, region: &vk::ImageBlit, filter: vk::Filter)
//! resolve::resolve_image(source: &Image, destination: &Image, region: &vk::ImageResolve)
//! clear::clear_color_image(image: &Image, value: &vk::ClearColorValue, range: &vk::ImageSubresourceRange)
//! clear::clear_depth_stencil_image(image: &Image, value: &vk::ClearDepthStencilValue, range: &vk::ImageSubresourceRange)
//! ```
//!
//! Buffers are device addresses of their first byte.

pub mod bindings;
mod capture;
mod engine;
mod graphics;
mod pass;
mod prints;
pub mod query;
pub mod ray_tracing;
mod samples;
mod spans;

use std::sync::Arc;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::reach::Strays;

use crate::capture::{self as recording, Recording};
use crate::command::{Command, MatrixConversion, Parameters, RayTracingCommand};
use crate::compute;
use crate::object::Image;
use crate::object::pipeline::PipelineKind;
use crate::timeline::{self, Kind};
use crate::transfer::{blit, buffer, clear, copy, matrix, resolve};
use crate::validate::{Caller, Checks};
use crate::wave::{Fault, Stopped, StoppedAt, reachable};
use graphics::{Current, DrawContext, Drawing};
use ray_tracing::Access;

pub use bindings::Bindings;
pub use engine::{Engine, Watch};
pub use query::{timestamp_ns, write_results};

/// Why replay ended early.
#[derive(Debug, PartialEq, Eq)]
pub enum Failure {
    /// A command was stopped: the device is to be lost.
    Stopped(Box<Fault>),
    /// The device was lost, or is being destroyed, while a command waited; or a shader of another
    /// command aborted, which loses the device.
    AlreadyLost,
}

impl From<Stopped> for Failure {
    fn from(why: Stopped) -> Self {
        match why {
            // The command whose shader it was reports it.
            Stopped::Aborted => Self::AlreadyLost,
            why => Fault::from(why).into(),
        }
    }
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Self {
        Self::Stopped(Box::new(fault))
    }
}

/// Waits within a command for what the host or another queue does: no longer than a command may
/// run.
fn wait_for(engine: &Engine, done: impl FnMut() -> bool) -> Result<(), Failure> {
    match engine.waiting.wait_until(engine.patience_ns(), done) {
        Err(vk::Result::TIMEOUT) => Err(Stopped::TimedOut.into()),
        waited => waited.map_err(|_| Failure::AlreadyLost),
    }
}

/// Performs the command buffers of a submission, one after the other.
///
/// # Errors
/// See [`Failure`]; what was done so far stays done.
pub fn replay_all<'a>(
    engine: &Engine,
    lists: impl IntoIterator<Item = &'a [Command]>,
) -> Result<(), Failure> {
    let mut drawing = Drawing::default();
    lists
        .into_iter()
        .try_for_each(|list| replay(engine, &mut drawing, list))
}

/// Performs a command buffer. It starts with nothing bound, as the specification has it for primary
/// and secondary ones alike (chapter Command Buffers, "Command Buffer Lifecycle" and
/// `vkCmdExecuteCommands`), but in the pass that it is executed in.
fn replay<'a>(
    engine: &Engine,
    drawing: &mut Drawing<'a>,
    commands: &'a [Command],
) -> Result<(), Failure> {
    let (mut bindings, mut current) = (Bindings::default(), Current::default());
    let depth = drawing.spans.depth();
    (drawing.spans).begin(Kind::CommandBuffer, || spans::command_buffer(commands));
    let performed = commands.iter().try_for_each(|command| {
        let painter = DrawContext {
            engine,
            bindings: &mut bindings,
            current: &mut current,
            drawing: &mut *drawing,
        };
        perform(painter, command)
    });
    if drawing.spans.depth() > depth {
        // Draws that wait belong to the command buffer that they are in.
        let flushed = performed.and_then(|()| drawing.flush(engine));
        drawing.spans.close_from(depth);
        return flushed;
    }
    performed
}

/// Whether a command finds what was drawn before it: all but those that only change what is bound,
/// and those that draw.
fn sees_pictures(command: &Command) -> bool {
    !matches!(
        command,
        Command::BindPipeline(_)
            | Command::BindDescriptorSets(_)
            | Command::BindDescriptorBuffer(_)
            | Command::BindHeap(_)
            | Command::BindInvocationMask(_)
            | Command::SetRayTracingStackSize(_)
            | Command::PushConstants { .. }
            | Command::ExecuteCommands(_)
            | Command::Graphics(_)
    )
}

/// Performs one command. The table of commands: a row each, the work in named functions.
fn perform<'a>(mut painter: DrawContext<'_, 'a>, command: &'a Command) -> Result<(), Failure> {
    if sees_pictures(command) {
        painter.drawing.flush(painter.engine)?;
    }
    let (engine, bindings) = (painter.engine, &mut *painter.bindings);
    match command {
        Command::Mark(mark) => spans::mark(&mut painter.drawing.spans, mark),
        Command::BindPipeline(pipeline) => {
            bindings.bind_pipeline(pipeline);
            if let PipelineKind::Graphics(pipeline) = &pipeline.kind {
                painter.current.bind_pipeline(pipeline);
            }
        }
        Command::BindDescriptorSets(bind) => bindings.bind_descriptor_sets(bind),
        Command::BindDescriptorBuffer(bind) => bindings.bind_descriptor_buffer(bind),
        Command::BindHeap(bind) => bindings.bind_heap(bind, engine.heap_samplers.embedded()),
        &Command::BindInvocationMask(mask) => bindings.invocation_mask = mask,
        &Command::SetRayTracingStackSize(bytes) => bindings.stack_bytes = Some(bytes),
        Command::PushConstants { offset, bytes } => bindings.push_constants(*offset, bytes),
        &Command::Dispatch { base, count } => run_dispatch(&mut painter, base, count)?,
        &Command::DispatchIndirect { address } => {
            // SAFETY: the queue's commands are performed one after the other: nothing writes the
            // parameters now.
            if let Some(count) = unsafe { reachable::read(&engine.memory.reach(), address) } {
                run_dispatch(&mut painter, [0; 3], count)?;
            }
        }
        &Command::CopyBuffer {
            source,
            destination,
            size_bytes,
        } => buffer::copy(&engine.memory.reach(), source, destination, size_bytes),
        &Command::FillBuffer {
            address,
            size_bytes,
            word,
        } => buffer::fill(&engine.memory.reach(), address, size_bytes, word),
        Command::UpdateBuffer { address, bytes } => {
            buffer::update(&engine.memory.reach(), *address, bytes);
        }
        Command::CopyImage {
            source,
            destination,
            regions,
        } => regions
            .iter()
            .for_each(|region| copy::copy_image(&engine.workers, source, destination, region)),
        Command::CopyBufferToImage {
            source,
            destination,
            regions,
        } => regions
            .iter()
            .filter(|region| has_bytes(engine, *source, destination, region))
            .for_each(|region| {
                copy::copy_buffer_to_image(&engine.workers, *source, destination, region);
            }),
        Command::ConvertMatrices(conversions) => convert_matrices(engine, conversions)?,
        &Command::CopyMemoryIndirect { parameters, count } => {
            copy_indirect(engine, parameters, count)?;
        }
        Command::CopyMemoryToImageIndirect {
            parameters,
            destination,
            layers,
        } => copy_to_image_indirect(engine, *parameters, destination, layers),
        Command::CopyImageToBuffer {
            source,
            destination,
            regions,
        } => regions
            .iter()
            .filter(|region| has_bytes(engine, *destination, source, region))
            .for_each(|region| {
                copy::copy_image_to_buffer(&engine.workers, source, *destination, region);
            }),
        Command::BlitImage {
            source,
            destination,
            regions,
            filter,
        } => regions.iter().for_each(|region| {
            blit::blit_image(&engine.workers, source, destination, region, *filter);
        }),
        Command::ResolveImage {
            source,
            destination,
            regions,
            stencil,
            other,
        } => engine.workers.install(|| {
            for region in regions {
                resolve::resolve_image(source, destination, region, *stencil, *other);
            }
        }),
        Command::ClearColorImage {
            image,
            value,
            ranges,
        } => ranges
            .iter()
            .for_each(|range| clear::clear_color_image(image, value, range)),
        Command::ClearDepthStencilImage {
            image,
            value,
            ranges,
        } => ranges
            .iter()
            .for_each(|range| clear::clear_depth_stencil_image(image, value, range)),
        Command::ResetQueryPool { pool, first, count } => pool.reset(*first, *count),
        Command::WriteTimestamp { pool, query } => {
            painter
                .drawing
                .write_timestamp(pool, *query, timestamp_ns());
        }
        Command::CopyQueryPoolResults(copy) => {
            if copy.flags.contains(vk::QueryResultFlags::WAIT) {
                wait_for(engine, || copy.pool.is_available(copy.first, copy.count))?;
            }
            query::copy_results(copy, &engine.memory.reach());
        }
        Command::SetEvent(event) => event.set(),
        Command::ResetEvent(event) => event.reset(),
        Command::WaitEvents(events) => {
            wait_for(engine, || events.iter().all(|event| event.is_set()))?;
        }
        Command::ExecuteCommands(buffers) => {
            let drawing = &mut *painter.drawing;
            buffers
                .iter()
                .try_for_each(|list| replay(engine, drawing, list))?;
        }
        Command::RayTracing(command) => run_ray_tracing(engine, bindings, command)?,
        Command::Graphics(command) => painter.perform(command)?,
    }
    Ok(())
}

/// Whether there is memory for what a region touches of a buffer.
fn has_bytes(engine: &Engine, buffer: u64, image: &Image, region: &vk::BufferImageCopy) -> bool {
    let start = buffer.wrapping_add(region.buffer_offset);
    copy::buffer_size_bytes(image, region)
        .is_some_and(|bytes| bytes == 0 || engine.memory.reach().contains(start, bytes))
}

fn run_dispatch(
    painter: &mut DrawContext<'_, '_>,
    base: [u32; 3],
    count: [u32; 3],
) -> Result<(), Failure> {
    if painter.drawing.skips {
        return Ok(());
    }
    let (engine, bindings) = (painter.engine, &mut *painter.bindings);
    let surroundings = engine.surroundings();
    let bind_point = vk::PipelineBindPoint::COMPUTE;
    let Some((pipeline, mut environment)) = bindings.environment(bind_point, count, &surroundings)
    else {
        return Ok(());
    };
    let PipelineKind::Compute(program) = &pipeline.kind else {
        return Ok(());
    };
    environment.prints = prints::of(std::iter::once(program));
    let _span = timeline::span(Kind::Dispatch, || spans::dispatch(program, count));
    let limits = engine.limits();
    let recording = recording::dispatch(program, base, count);
    let ran = engine.dispatcher.run(
        &engine.workers,
        &compute::Dispatch {
            program,
            base,
            count,
            environment: &environment,
            limits: &limits,
            observer: recording.as_ref().map(Recording::observer),
        },
    );
    if let Some(recording) = recording {
        let programs = std::iter::once(&**program);
        // SAFETY: the application keeps the structures that shaders name until the command is
        // complete.
        unsafe { recording.finish(programs, None, &surroundings.live, ran.is_err()) };
    }
    if let Some(strays) = &surroundings.strays {
        let checks = engine.checks(Caller::Other);
        note_strays(engine, checks.as_ref(), strays, std::iter::once(program));
    }
    if let Some(prints) = &environment.prints {
        prints::print(engine, prints, std::iter::once(program));
    }
    check_aborted(engine, std::iter::once(program))?;
    ran.map_err(|why| limits.fault(why))?;
    if !painter.drawing.queries.is_empty() {
        let sizes = count.into_iter().chain(program.local_size());
        let invocations = sizes.fold(1u64, |product, size| {
            product.saturating_mul(u64::from(size))
        });
        for query in &mut painter.drawing.queries {
            query.compute_invocations = query.compute_invocations.saturating_add(invocations);
        }
    }
    Ok(())
}

/// Notes where shaders of a command went astray.
fn note_strays<'a>(
    engine: &Engine,
    checks: Option<&Checks>,
    strays: &Strays,
    programs: impl Iterator<Item = &'a Arc<Program>> + Clone,
) {
    let strays = strays.take();
    if let Some(checks) = checks {
        checks.strays(&strays);
    }
    if let Some(wild) = &engine.wild {
        wild.add(&strays, programs);
    }
}

/// Ends a command after which the device is lost because a shader aborted.
///
/// # Errors
/// With a report if the shader is one of these programs. If not, its own command has the report.
fn check_aborted<'a>(
    engine: &Engine,
    mut programs: impl Iterator<Item = &'a Arc<Program>>,
) -> Result<(), Failure> {
    let Some(aborts) = engine.aborts.as_ref().filter(|it| it.happened()) else {
        return Ok(());
    };
    let Some(at) = aborts.first() else {
        return Err(Failure::AlreadyLost);
    };
    let program = programs.find(|program| program.number() == at.program);
    let program = program.ok_or(Failure::AlreadyLost)?;
    let at = StoppedAt {
        place: program.place_in_source(at.source),
        depth: 0,
    };
    Err(Fault {
        at: Some(at),
        ..Stopped::Aborted.into()
    }
    .into())
}

fn convert_matrices(engine: &Engine, conversions: &[MatrixConversion]) -> Result<(), Failure> {
    let limits = engine.limits();
    for conversion in conversions {
        limits.check()?;
        // SAFETY: what is in reach is memory; the queue's commands are performed one after the
        // other.
        unsafe { matrix::convert(conversion, &engine.memory.reach()) };
    }
    Ok(())
}

/// Copies whose parameters (`VkCopyMemoryIndirectCommandKHR`) are in memory. Those that are not
/// there copy nothing.
fn copy_indirect(engine: &Engine, parameters: Parameters, count: u32) -> Result<(), Failure> {
    let limits = engine.limits();
    for index in 0..count {
        limits.check()?;
        let reach = engine.memory.reach();
        // SAFETY: the queue's commands are performed one after the other; any bytes are numbers.
        let copy = unsafe { reachable::read::<[u64; 3]>(&reach, parameters.of(index)) };
        if let Some([source, destination, size_bytes]) = copy {
            buffer::copy(&reach, source, destination, size_bytes);
        }
    }
    Ok(())
}

/// The same, to an image (`VkCopyMemoryToImageIndirectCommandKHR`). The recorded layers name the
/// slices of a 3D image, in place of the offset and extent in memory
/// (`vkCmdCopyMemoryToImageIndirectKHR`).
fn copy_to_image_indirect(
    engine: &Engine,
    parameters: Parameters,
    destination: &Image,
    layers: &[vk::ImageSubresourceLayers],
) {
    /// A copy within memory, for any purpose.
    #[repr(C)]
    #[derive(Clone, Copy)]
    struct Copy {
        source: u64,
        row_length: u32,
        image_height: u32,
        layers: [u32; 4],
        offset: [i32; 3],
        extent: [u32; 3],
    }
    for (&layers, index) in layers.iter().zip(0..) {
        // SAFETY: as above.
        let copy = unsafe { reachable::read::<Copy>(&engine.memory.reach(), parameters.of(index)) };
        let Some(copy) = copy else { continue };
        let ([x, y, mut z], [width, height, mut depth]) = (copy.offset, copy.extent);
        if destination.image_type == vk::ImageType::TYPE_3D {
            z = layers.base_array_layer as i32;
            depth = destination.slice_count(&layers);
        }
        let region = vk::BufferImageCopy {
            buffer_offset: 0,
            buffer_row_length: copy.row_length,
            buffer_image_height: copy.image_height,
            image_subresource: layers,
            image_offset: vk::Offset3D { x, y, z },
            image_extent: vk::Extent3D {
                width,
                height,
                depth,
            },
        };
        if has_bytes(engine, copy.source, destination, &region) {
            copy::copy_buffer_to_image(&engine.workers, copy.source, destination, &region);
        }
    }
}

/// Commands of the ray tracing extensions.
fn run_ray_tracing(
    engine: &Engine,
    bindings: &mut Bindings<'_>,
    command: &RayTracingCommand,
) -> Result<(), Failure> {
    let limits = engine.limits();
    let surroundings = engine.surroundings();
    let checks = engine.checks(match command {
        RayTracingCommand::TraceRays { .. } => Caller::TraceRays,
        RayTracingCommand::TraceRaysNv { .. } => Caller::TraceRaysNv,
        RayTracingCommand::TraceRaysIndirect { .. } => Caller::TraceRaysIndirect,
        RayTracingCommand::TraceRaysIndirect2 { .. } => Caller::TraceRaysIndirect2,
        _ => Caller::Other,
    });
    // The size of the launch may be in memory: who reads it puts it into the environment.
    let mask = bindings.invocation_mask;
    let stack_bytes = bindings.stack_bytes;
    let bind_point = vk::PipelineBindPoint::RAY_TRACING_KHR;
    let bound = bindings.environment(bind_point, [0; 3], &surroundings);
    let bound = bound.map(|(pipeline, environment)| ray_tracing::Bound {
        pipeline: pipeline.ray_tracing(),
        environment,
        mask,
        stack_bytes,
        limits: &limits,
    });
    let access = Access {
        surroundings: &surroundings,
        checks,
    };
    ray_tracing::execute(command, access, bound, engine)
}
