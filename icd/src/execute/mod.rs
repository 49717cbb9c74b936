//! Performs recorded commands, in order, on a queue's thread. What is worth it fans out over the device's workers.
//!
//! **Barriers, pipeline stages and access masks are not recorded.** A queue performs one command after the other, and each is complete, its
//! writes visible to every thread, before the next begins: workers join at the end of a command, and memory is the host's own coherent
//! memory. That is more than any `vkCmdPipelineBarrier` asks for. Image layouts mean nothing, since images are stored one way only, and with
//! one queue family there is no ownership to transfer. What is left of the synchronization commands are events, which can be waited for
//! across queues and from the host.

mod bindings;
pub mod buffer;
pub mod dispatch;
mod engine;
mod query;

use ash::vk;

use crate::command::Command;
use crate::object::pipeline::PipelineKind;
use crate::trace::Stopped;

pub use bindings::Bindings;
pub use engine::Engine;
pub use query::{timestamp_ns, write_results};

/// Why replay ended early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// A command was stopped: the device is to be lost.
    Stopped(Stopped),
    /// The device was lost, or is being destroyed, while a command waited.
    AlreadyLost,
}

impl From<Stopped> for Failure {
    fn from(why: Stopped) -> Self {
        Self::Stopped(why)
    }
}

/// Performs a command buffer. It starts with nothing bound, as the specification has it for primary and secondary ones alike (chapter
/// Command Buffers, "Command Buffer Lifecycle" and `vkCmdExecuteCommands`).
///
/// # Errors
/// See [`Failure`]; what was done so far stays done.
pub fn replay(engine: &Engine, commands: &[Command]) -> Result<(), Failure> {
    let mut bindings = Bindings::default();
    commands
        .iter()
        .try_for_each(|command| perform(engine, &mut bindings, command))
}

/// Performs one command. The table of commands: a row each, the work in named functions.
fn perform<'a>(
    engine: &Engine,
    bindings: &mut Bindings<'a>,
    command: &'a Command,
) -> Result<(), Failure> {
    match command {
        Command::BindPipeline(pipeline) => bindings.bind_pipeline(pipeline),
        Command::BindDescriptorSets(bind) => bindings.bind_descriptor_sets(bind),
        Command::PushConstants { offset, bytes } => bindings.push_constants(*offset, bytes),
        &Command::Dispatch { base, count } => run_dispatch(engine, bindings, base, count)?,
        &Command::DispatchIndirect { address } => {
            let count = buffer::read_dispatch_size(address);
            run_dispatch(engine, bindings, [0; 3], count)?;
        }
        &Command::CopyBuffer {
            source,
            destination,
            size_bytes,
        } => buffer::copy(source, destination, size_bytes),
        &Command::FillBuffer {
            address,
            size_bytes,
            word,
        } => buffer::fill(address, size_bytes, word),
        Command::UpdateBuffer { address, bytes } => buffer::update(*address, bytes),
        Command::ResetQueryPool { pool, first, count } => pool.reset(*first, *count),
        Command::WriteTimestamp { pool, query } => pool.write(*query, timestamp_ns()),
        Command::CopyQueryPoolResults(copy) => query::copy_results(copy)?,
        Command::SetEvent(event) => event.set(),
        Command::ResetEvent(event) => event.reset(),
        Command::WaitEvents(events) => engine
            .waiting
            .wait_until(u64::MAX, || events.iter().all(|event| event.is_set()))
            .map_err(|_| Failure::AlreadyLost)?,
        Command::ExecuteCommands(buffers) => {
            buffers.iter().try_for_each(|list| replay(engine, list))?;
        }
    }
    Ok(())
}

fn run_dispatch(
    engine: &Engine,
    bindings: &mut Bindings<'_>,
    base: [u32; 3],
    count: [u32; 3],
) -> Result<(), Failure> {
    let Some((pipeline, environment)) = bindings.environment(vk::PipelineBindPoint::COMPUTE, count)
    else {
        return Ok(());
    };
    let PipelineKind::Compute(program) = &pipeline.kind;
    engine.dispatcher.run(
        &engine.workers,
        &dispatch::Dispatch {
            program,
            base,
            count,
            environment: &environment,
            limits: &engine.limits(),
        },
    )?;
    Ok(())
}
