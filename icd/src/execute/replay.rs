//! The replay: one exhaustive `match` over commands.

use std::sync::Arc;

use super::bindings::Bindings;
use super::{Engine, dispatch, memory, query};
use crate::command::Command;

/// Executes command buffers in order.
///
/// # Errors
/// Why the device is lost.
pub fn replay(engine: &Engine, command_buffers: &[Arc<Vec<Command>>]) -> Result<(), String> {
    command_buffers.iter().try_for_each(|commands| {
        // Nothing bound in one command buffer is seen in another.
        let mut bindings = Bindings::default();
        commands
            .iter()
            .try_for_each(|command| perform(engine, &mut bindings, command))
    })
}

fn perform<'a>(
    engine: &Engine,
    bindings: &mut Bindings<'a>,
    command: &'a Command,
) -> Result<(), String> {
    match command {
        Command::BindPipeline(pipeline) => {
            bindings.bind_point(pipeline.bind_point()).pipeline = Some(pipeline)
        }
        Command::BindDescriptorSets {
            bind_point,
            layout,
            first_set,
            sets,
            dynamic_offsets,
        } => bindings
            .bind_point(*bind_point)
            .bind_sets(layout, *first_set, sets, dynamic_offsets),
        Command::PushConstants { offset, bytes } => {
            bindings.push_constants[*offset as usize..][..bytes.len()].copy_from_slice(bytes);
        }
        Command::Dispatch { base, count } => {
            dispatch::dispatch(engine, bindings, *base, *count)
                .map_err(|stopped| format!("dispatch: {stopped:?}"))?;
        }
        Command::DispatchIndirect { address } => {
            // SAFETY: the address is that of three words inside a bound buffer, which the recording has checked.
            let count = unsafe { std::ptr::read_unaligned(*address as *const [u32; 3]) };
            dispatch::dispatch(engine, bindings, [0; 3], count)
                .map_err(|stopped| format!("dispatch: {stopped:?}"))?;
        }
        Command::CopyBuffer {
            source,
            destination,
            size_bytes,
        } => memory::copy_buffer(engine, *source, *destination, *size_bytes),
        Command::FillBuffer {
            address,
            size_bytes,
            word,
        } => memory::fill_buffer(engine, *address, *size_bytes, *word),
        Command::UpdateBuffer { address, bytes } => memory::update_buffer(*address, bytes),
        Command::ResetQueryPool { pool, first, count } => pool.reset(*first, *count),
        Command::WriteTimestamp { pool, query } => {
            pool.write(*query, query::timestamp());
            engine.waiting.notify();
        }
        Command::CopyQueryPoolResults {
            pool,
            first,
            count,
            address,
            stride_bytes,
            flags,
        } => {
            // SAFETY: the recording has checked that the results are inside a bound buffer.
            unsafe {
                query::write_results(
                    pool,
                    &engine.waiting,
                    *first,
                    *count,
                    *address as *mut u8,
                    *stride_bytes,
                    *flags,
                );
            }
        }
        Command::SetEvent(event) => {
            event.set(true);
            engine.waiting.notify();
        }
        Command::ResetEvent(event) => event.set(false),
        Command::WaitEvents(events) => {
            // A lost device ends the wait; what follows is dropped.
            if engine
                .waiting
                .wait_until(u64::MAX, || events.iter().all(|event| event.is_set()))
                .is_err()
            {
                return Err("lost while waiting for an event".to_owned());
            }
        }
        Command::ExecuteCommands(secondaries) => replay(engine, secondaries)?,
    }
    Ok(())
}
