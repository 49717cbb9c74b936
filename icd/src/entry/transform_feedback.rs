//! Transform feedback, and queries of vertex streams.

use std::ffi::c_void;

use smallvec::SmallVec;

use super::graphics_draw::place;
use super::record::record;
use crate::VkResult;
use crate::command::graphics::{DrawByteCount, FeedbackBinding};
use crate::command::{Command, GraphicsCommand, Recording};
use crate::ffi::{slice, vk};
use crate::handle::retain;
use crate::object::QueryPool;

/// Bytes of a counter.
const COUNTER_BYTES: u64 = 4;

fn push(commands: &mut Recording, command: GraphicsCommand) -> VkResult {
    commands.push(Command::Graphics(command))
}

/// The address of a counter in a buffer; 0 if there is no counter, or it does not fit.
///
/// # Safety
/// The handle is null or alive.
unsafe fn counter(buffer: vk::Buffer, offset: u64) -> u64 {
    // SAFETY: the caller guarantees that the handle is null or alive.
    match unsafe { place(buffer, offset, COUNTER_BYTES) } {
        (address, COUNTER_BYTES) => address,
        _ => 0,
    }
}

/// # Safety
/// The arrays are null or have `count` elements; the handles are null or alive.
unsafe fn counters(
    count: u32,
    buffers: *const vk::Buffer,
    offsets: *const vk::DeviceSize,
) -> SmallVec<[u64; 4]> {
    // SAFETY: the caller guarantees that the arrays are null or have `count` elements; the handles
    // are null or alive.
    let (buffers, offsets) = unsafe { (slice(buffers, count), slice(offsets, count)) };
    let address = |(index, &buffer): (usize, &vk::Buffer)| {
        let offset = offsets.get(index).copied().unwrap_or(0);
        // SAFETY: the caller guarantees that the arrays are null or have `count` elements; the
        // handles are null or alive.
        unsafe { counter(buffer, offset) }
    };
    buffers.iter().enumerate().map(address).collect()
}

/// Like [`counter`], for an address.
fn counter_at(info: &vk::BindTransformFeedbackBuffer2InfoEXT<'_>) -> u64 {
    match info.address_range.size >= COUNTER_BYTES {
        true => info.address_range.address,
        false => 0,
    }
}

/// # Safety
/// The array is null or has `count` elements.
unsafe fn counters_at(count: u32, infos: *const c_void) -> SmallVec<[u64; 4]> {
    // SAFETY: the caller guarantees that the array is null or has `count` elements.
    let infos = unsafe { slice(infos.cast(), count) };
    infos.iter().map(counter_at).collect()
}

pub(crate) unsafe extern "system" fn vkCmdBindTransformFeedbackBuffersEXT(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    buffers: *const vk::Buffer,
    offsets: *const vk::DeviceSize,
    sizes: *const vk::DeviceSize,
) {
    record(
        "vkCmdBindTransformFeedbackBuffersEXT",
        commands,
        move |commands| {
            let sizes = slice(sizes, count);
            let bound = slice(buffers, count)
                .iter()
                .zip(slice(offsets, count))
                .enumerate();
            let buffers = bound.map(|(index, (&buffer, &offset))| {
                place(
                    buffer,
                    offset,
                    sizes.get(index).copied().unwrap_or(vk::WHOLE_SIZE),
                )
            });
            let binding = FeedbackBinding {
                first,
                buffers: buffers.collect(),
            };
            push(
                commands,
                GraphicsCommand::BindFeedbackBuffers(Box::new(binding)),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdBeginTransformFeedbackEXT(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    buffers: *const vk::Buffer,
    offsets: *const vk::DeviceSize,
) {
    record(
        "vkCmdBeginTransformFeedbackEXT",
        commands,
        move |commands| {
            push(
                commands,
                GraphicsCommand::BeginFeedback(first, counters(count, buffers, offsets)),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdEndTransformFeedbackEXT(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    buffers: *const vk::Buffer,
    offsets: *const vk::DeviceSize,
) {
    record("vkCmdEndTransformFeedbackEXT", commands, move |commands| {
        push(
            commands,
            GraphicsCommand::EndFeedback(first, counters(count, buffers, offsets)),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndirectByteCountEXT(
    commands: vk::CommandBuffer,
    instances: u32,
    first_instance: u32,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    offset_bytes: u32,
    stride_bytes: u32,
) {
    record("vkCmdDrawIndirectByteCountEXT", commands, move |commands| {
        let counter = counter(buffer, offset);
        let draw = DrawByteCount {
            first_instance,
            instances,
            counter,
            offset_bytes,
            stride_bytes,
        };
        push(commands, GraphicsCommand::DrawByteCount(draw))
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindTransformFeedbackBuffers2EXT(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    infos: *const c_void,
) {
    record(
        "vkCmdBindTransformFeedbackBuffers2EXT",
        commands,
        move |commands| {
            let infos = slice(
                infos.cast::<vk::BindTransformFeedbackBuffer2InfoEXT<'_>>(),
                count,
            );
            let range = |info: &vk::BindTransformFeedbackBuffer2InfoEXT<'_>| {
                (info.address_range.address, info.address_range.size)
            };
            let binding = FeedbackBinding {
                first,
                buffers: infos.iter().map(range).collect(),
            };
            push(
                commands,
                GraphicsCommand::BindFeedbackBuffers(Box::new(binding)),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdBeginTransformFeedback2EXT(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    infos: *const c_void,
) {
    record(
        "vkCmdBeginTransformFeedback2EXT",
        commands,
        move |commands| {
            push(
                commands,
                GraphicsCommand::BeginFeedback(first, counters_at(count, infos)),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdEndTransformFeedback2EXT(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    infos: *const c_void,
) {
    record("vkCmdEndTransformFeedback2EXT", commands, move |commands| {
        push(
            commands,
            GraphicsCommand::EndFeedback(first, counters_at(count, infos)),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndirectByteCount2EXT(
    commands: vk::CommandBuffer,
    instances: u32,
    first_instance: u32,
    info: *const c_void,
    offset_bytes: u32,
    stride_bytes: u32,
) {
    record(
        "vkCmdDrawIndirectByteCount2EXT",
        commands,
        move |commands| {
            let counter = counter_at(&*info.cast());
            let draw = DrawByteCount {
                first_instance,
                instances,
                counter,
                offset_bytes,
                stride_bytes,
            };
            push(commands, GraphicsCommand::DrawByteCount(draw))
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdBeginQueryIndexedEXT(
    commands: vk::CommandBuffer,
    pool: vk::QueryPool,
    query: u32,
    _flags: vk::QueryControlFlags,
    stream: u32,
) {
    record("vkCmdBeginQueryIndexedEXT", commands, move |commands| {
        let pool = retain::<QueryPool>(pool);
        push(
            commands,
            GraphicsCommand::BeginQuery {
                pool,
                query,
                stream,
            },
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdEndQueryIndexedEXT(
    commands: vk::CommandBuffer,
    pool: vk::QueryPool,
    query: u32,
    _stream: u32,
) {
    record("vkCmdEndQueryIndexedEXT", commands, move |commands| {
        let pool = retain::<QueryPool>(pool);
        push(commands, GraphicsCommand::EndQuery { pool, query })
    })
}
