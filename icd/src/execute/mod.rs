//! Performs recorded commands, in order, on a queue's thread. Large commands use the device's
//! workers.
//!
//! **Barriers, pipeline stages and access masks are not recorded,** except barriers inside passes
//! that shaders wait for. A queue performs one command after the other. Each command is complete,
//! and its writes are visible to every thread, before the next begins: workers join at the end of a
//! command, and memory is the host's own coherent memory. That is more than any
//! `vkCmdPipelineBarrier` requires. Image layouts have no meaning, since images have one storage
//! layout, and one queue family needs no ownership transfers. Of the synchronization commands only
//! events remain, which queues and the host can wait for.

pub mod bindings;
mod engine;
mod graphics;
mod pass;
mod prints;
pub mod query;
mod ray_tracing;
mod recorded;
mod samples;
mod spans;
mod structures;
mod transfer;
mod transform_feedback;

use std::sync::Arc;

use ash::vk;
use spirv_jit::Program;
use spirv_jit::reach::Strays;

use crate::capture::{self as recording, Recording};
use crate::command::Command;
use crate::compute;
use crate::object::pipeline::PipelineKind;
use crate::timeline::{self, Kind};
use crate::wave::observer::Observer;
use crate::wave::observers::Observers;
use crate::wave::{Fault, Stopped, StoppedAt, reachable};
use graphics::{Current, DrawContext, Drawing};

pub use bindings::Bindings;
pub use engine::{Engine, EngineOptions};
pub use query::{timestamp_ns, write_results};

/// The reason why replay ended early.
#[derive(Debug, PartialEq, Eq)]
pub enum Failure {
    /// A command was stopped: the device must be lost.
    Stopped(Box<Fault>),
    /// The device was lost, or is being destroyed, while a command waited; or a shader of another
    /// command aborted, which loses the device.
    AlreadyLost,
}

impl From<Stopped> for Failure {
    fn from(why: Stopped) -> Self {
        match why {
            // The command of the aborted shader reports it.
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

/// Waits within a command for the host or another queue, for as long as a command may run.
fn wait_for(engine: &Engine, done: impl FnMut() -> bool) -> Result<(), Failure> {
    match engine.waiting.wait_until(engine.patience_ns(), done) {
        Err(vk::Result::TIMEOUT) => Err(Stopped::TimedOut.into()),
        waited => waited.map_err(|_| Failure::AlreadyLost),
    }
}

/// Performs the command buffers of a submission, one after the other.
///
/// # Errors
/// See [`Failure`]. Commands that were performed before keep their effects.
pub fn replay_all<'a>(
    engine: &Engine,
    lists: impl IntoIterator<Item = &'a [Command]>,
) -> Result<(), Failure> {
    let mut drawing = Drawing::default();
    lists
        .into_iter()
        .try_for_each(|list| replay(engine, &mut drawing, list))
}

/// Performs a command buffer. It starts with nothing bound, primary or secondary (chapter Command
/// Buffers, "Command Buffer Lifecycle" and `vkCmdExecuteCommands`). A secondary one continues the
/// current pass.
fn replay<'a>(
    engine: &Engine,
    drawing: &mut Drawing<'a>,
    commands: &'a [Command],
) -> Result<(), Failure> {
    let (mut bindings, mut current) = (Bindings::default(), Current::default());
    let depth = drawing.spans.depth();
    (drawing.spans).begin(Kind::CommandBuffer, || spans::command_buffer(commands));
    let performed = commands.iter().try_for_each(|command| {
        let context = DrawContext {
            engine,
            bindings: &mut bindings,
            current: &mut current,
            drawing: &mut *drawing,
        };
        perform(context, command)
    });
    if drawing.spans.depth() > depth {
        // Pending draws belong to the span of their command buffer.
        let flushed = performed.and_then(|()| drawing.flush(engine));
        drawing.spans.close_from(depth);
        return flushed;
    }
    performed
}

/// Whether a command can see the results of earlier draws: all commands except those that draw or
/// only change bindings.
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
fn perform<'a>(mut context: DrawContext<'_, 'a>, command: &'a Command) -> Result<(), Failure> {
    if sees_pictures(command) {
        context.drawing.flush(context.engine)?;
    }
    let (engine, bindings) = (context.engine, &mut *context.bindings);
    match command {
        Command::Mark(mark) => spans::mark(&mut context.drawing.spans, mark),
        Command::BindPipeline(pipeline) => {
            bindings.bind_pipeline(pipeline);
            if let PipelineKind::Graphics(pipeline) = &pipeline.kind {
                context.current.bind_pipeline(pipeline);
            }
        }
        Command::BindDescriptorSets(bind) => bindings.bind_descriptor_sets(bind),
        Command::BindDescriptorBuffer(bind) => bindings.bind_descriptor_buffer(bind),
        Command::BindHeap(bind) => bindings.bind_heap(bind, engine.heap_samplers.embedded()),
        &Command::BindInvocationMask(mask) => bindings.invocation_mask = mask,
        &Command::SetRayTracingStackSize(bytes) => bindings.stack_bytes = Some(bytes),
        Command::PushConstants { offset, bytes } => bindings.push_constants(*offset, bytes),
        &Command::Dispatch { base, count } => run_dispatch(&mut context, base, count)?,
        &Command::DispatchIndirect { address } => {
            // SAFETY: the queue performs one command at a time: no earlier command still writes the
            // parameters.
            if let Some(count) = unsafe { reachable::read(&engine.memory.reach(), address) } {
                run_dispatch(&mut context, [0; 3], count)?;
            }
        }
        Command::Transfer(command) => transfer::perform(engine, command)?,
        Command::ResetQueryPool { pool, first, count } => pool.reset(*first, *count),
        Command::WriteTimestamp { pool, query } => {
            context
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
            let drawing = &mut *context.drawing;
            buffers
                .iter()
                .try_for_each(|list| replay(engine, drawing, list))?;
        }
        Command::Structure(command) => structures::perform(engine, command),
        Command::RayTracing(command) => ray_tracing::perform(engine, bindings, command)?,
        Command::Graphics(command) => context.perform(command)?,
    }
    Ok(())
}

fn run_dispatch(
    context: &mut DrawContext<'_, '_>,
    base: [u32; 3],
    count: [u32; 3],
) -> Result<(), Failure> {
    if context.drawing.skips {
        return Ok(());
    }
    let (engine, bindings) = (context.engine, &mut *context.bindings);
    let bind_point = vk::PipelineBindPoint::COMPUTE;
    let Some((pipeline, mut environment)) = bindings.environment(bind_point, count, engine) else {
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
        // SAFETY: the application keeps the structures that shaders use until the command is
        // complete.
        unsafe { recording.finish(programs, None, &limits.live, ran.is_err()) };
    }
    if let Some(strays) = &environment.strays {
        let observers = [limits.query_observer.as_deref(), engine.wild_observer()];
        show_strays(&Observers::new(observers), strays, std::iter::once(program));
    }
    if let Some(prints) = &environment.prints {
        prints::print(engine, prints, std::iter::once(program));
    }
    check_aborted(engine, std::iter::once(program))?;
    ran.map_err(|why| limits.fault(why))?;
    if !context.drawing.queries.is_empty() {
        let sizes = count.into_iter().chain(program.local_size());
        let invocations = sizes.fold(1u64, |product, size| {
            product.saturating_mul(u64::from(size))
        });
        for query in &mut context.drawing.queries {
            query.compute_invocations = query.compute_invocations.saturating_add(invocations);
        }
    }
    Ok(())
}

/// Shows invalid addresses that a command's shaders used to its observers.
fn show_strays<'a>(
    observers: &dyn Observer,
    strays: &Strays,
    programs: impl Iterator<Item = &'a Arc<Program>>,
) {
    let strays = strays.take();
    if !strays.is_empty() {
        let programs: Vec<&Program> = programs.map(|program| &**program).collect();
        observers.strays(&strays, &programs);
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
    let Some(aborts) = engine.options.aborts.as_ref().filter(|it| it.happened()) else {
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
