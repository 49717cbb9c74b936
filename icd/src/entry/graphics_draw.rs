//! Vertex and index buffers, draws, and the queries around them.

use ash::vk;

use super::record::record;
use crate::VkResult;
use crate::command::graphics::{
    BindVertexBuffers, DrawCall, DrawIndirect, DrawMulti, IndexBinding, Numbers, VertexBinding,
};
use crate::command::{Command, GraphicsCommand, Recording, copied};
use crate::ffi::slice;
use crate::handle::{optional, retain};
use crate::object::{Buffer, QueryPool};

/// The address of an offset in a buffer, and the size from there, at most `size_bytes`
/// (`VK_WHOLE_SIZE`: all). Zeros for a null handle.
///
/// # Safety
/// The handle is null or alive.
pub unsafe fn place(buffer: vk::Buffer, offset: u64, size_bytes: u64) -> (u64, u64) {
    // SAFETY: the caller guarantees that the handle is null or alive.
    match unsafe { optional::<Buffer>(buffer) } {
        Some(buffer) if buffer.address() != 0 => {
            let rest = buffer.size_bytes.saturating_sub(offset);
            (buffer.address().wrapping_add(offset), size_bytes.min(rest))
        }
        _ => (0, 0),
    }
}

fn push(commands: &mut Recording, command: GraphicsCommand) -> VkResult {
    commands.push(Command::Graphics(command))
}

/// # Safety
/// The arrays are null or have `count` elements; the handles are null or alive.
unsafe fn bind_vertex_buffers(
    commands: &mut Recording,
    first: u32,
    count: u32,
    buffers: *const vk::Buffer,
    offsets: *const vk::DeviceSize,
    sizes: *const vk::DeviceSize,
    strides: *const vk::DeviceSize,
) -> VkResult {
    // SAFETY: the caller guarantees that the arrays are null or have `count` elements; the handles
    // are null or alive.
    let (buffers, offsets, sizes, strides) = unsafe {
        let (sizes, strides) = (slice(sizes, count), slice(strides, count));
        (slice(buffers, count), slice(offsets, count), sizes, strides)
    };
    let binding = |(index, &buffer): (usize, &vk::Buffer)| {
        let offset = offsets.get(index).copied().unwrap_or(0);
        let size_bytes = sizes.get(index).copied().unwrap_or(vk::WHOLE_SIZE);
        // SAFETY: the caller guarantees that the arrays are null or have `count` elements; the
        // handles are null or alive.
        let (address, size_bytes) = unsafe { place(buffer, offset, size_bytes) };
        VertexBinding {
            address,
            size_bytes,
            stride_bytes: strides.get(index).copied(),
        }
    };
    let buffers = buffers.iter().enumerate().map(binding).collect();
    let bind = Box::new(BindVertexBuffers { first, buffers });
    push(commands, GraphicsCommand::BindVertexBuffers(bind))
}

/// # Safety
/// The handle is null or alive.
unsafe fn bind_index_buffer(
    commands: &mut Recording,
    buffer: vk::Buffer,
    offset: u64,
    size_bytes: u64,
    ty: vk::IndexType,
) -> VkResult {
    // SAFETY: the caller guarantees that the handle is null or alive.
    let (address, size_bytes) = unsafe { place(buffer, offset, size_bytes) };
    let binding = IndexBinding {
        address,
        size_bytes,
        ty,
    };
    push(commands, GraphicsCommand::BindIndexBuffer(binding))
}

/// # Safety
/// The handles are alive.
unsafe fn draw_indirect(
    commands: &mut Recording,
    numbers: Numbers,
    (buffer, offset): (vk::Buffer, u64),
    count: Option<(vk::Buffer, u64)>,
    draws: u32,
    stride_bytes: u32,
) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive.
    let at = |(buffer, offset)| unsafe { place(buffer, offset, vk::WHOLE_SIZE) }.0;
    let draw = DrawIndirect {
        numbers,
        address: at((buffer, offset)),
        stride_bytes,
        draws,
        count: count.map(at),
    };
    push(commands, GraphicsCommand::DrawIndirect(draw))
}

pub(crate) unsafe extern "system" fn vkCmdBindVertexBuffers(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    buffers: *const vk::Buffer,
    offsets: *const vk::DeviceSize,
) {
    record("vkCmdBindVertexBuffers", commands, move |commands| {
        let none = std::ptr::null();
        bind_vertex_buffers(commands, first, count, buffers, offsets, none, none)
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindVertexBuffers2(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    buffers: *const vk::Buffer,
    offsets: *const vk::DeviceSize,
    sizes: *const vk::DeviceSize,
    strides: *const vk::DeviceSize,
) {
    record("vkCmdBindVertexBuffers2", commands, move |commands| {
        bind_vertex_buffers(commands, first, count, buffers, offsets, sizes, strides)
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindIndexBuffer(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    ty: vk::IndexType,
) {
    record("vkCmdBindIndexBuffer", commands, move |commands| {
        bind_index_buffer(commands, buffer, offset, vk::WHOLE_SIZE, ty)
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetPrimitiveRestartIndexEXT(
    commands: vk::CommandBuffer,
    index: u32,
) {
    record(
        "vkCmdSetPrimitiveRestartIndexEXT",
        commands,
        move |commands| push(commands, GraphicsCommand::RestartIndex(index)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdBindIndexBuffer2KHR(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    size: vk::DeviceSize,
    ty: vk::IndexType,
) {
    record("vkCmdBindIndexBuffer2KHR", commands, move |commands| {
        bind_index_buffer(commands, buffer, offset, size, ty)
    })
}

pub(crate) unsafe extern "system" fn vkCmdDraw(
    commands: vk::CommandBuffer,
    count: u32,
    instances: u32,
    first: u32,
    first_instance: u32,
) {
    record("vkCmdDraw", commands, move |commands| {
        let call = DrawCall {
            first,
            count,
            vertex_offset: 0,
            first_instance,
            instances,
            draw_index: 0,
            groups: [0; 3],
        };
        let indexed = false;
        push(commands, GraphicsCommand::Draw { indexed, call })
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndexed(
    commands: vk::CommandBuffer,
    count: u32,
    instances: u32,
    first: u32,
    vertex_offset: i32,
    first_instance: u32,
) {
    record("vkCmdDrawIndexed", commands, move |commands| {
        let call = DrawCall {
            first,
            count,
            vertex_offset,
            first_instance,
            instances,
            draw_index: 0,
            groups: [0; 3],
        };
        let indexed = true;
        push(commands, GraphicsCommand::Draw { indexed, call })
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawMultiEXT(
    commands: vk::CommandBuffer,
    count: u32,
    infos: *const vk::MultiDrawInfoEXT,
    instances: u32,
    first_instance: u32,
    stride: u32,
) {
    record("vkCmdDrawMultiEXT", commands, move |commands| {
        let info = |index: &u32| {
            let info = &*infos.byte_add(*index as usize * stride as usize);
            (info.first_vertex, info.vertex_count, 0)
        };
        let indices: Vec<u32> = (0..count).collect();
        let draws = copied(&indices, info)?.into();
        let draw = Box::new(DrawMulti {
            indexed: false,
            draws,
            first_instance,
            instances,
        });
        push(commands, GraphicsCommand::DrawMulti(draw))
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawMultiIndexedEXT(
    commands: vk::CommandBuffer,
    count: u32,
    infos: *const vk::MultiDrawIndexedInfoEXT,
    instances: u32,
    first_instance: u32,
    stride: u32,
    vertex_offset: *const i32,
) {
    record("vkCmdDrawMultiIndexedEXT", commands, move |commands| {
        let common = vertex_offset.as_ref().copied();
        let info = |index: &u32| {
            let info = &*infos.byte_add(*index as usize * stride as usize);
            (
                info.first_index,
                info.index_count,
                common.unwrap_or(info.vertex_offset),
            )
        };
        let indices: Vec<u32> = (0..count).collect();
        let draws = copied(&indices, info)?.into();
        let draw = Box::new(DrawMulti {
            indexed: true,
            draws,
            first_instance,
            instances,
        });
        push(commands, GraphicsCommand::DrawMulti(draw))
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndirect(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    draws: u32,
    stride: u32,
) {
    record("vkCmdDrawIndirect", commands, move |commands| {
        draw_indirect(
            commands,
            Numbers::Vertices,
            (buffer, offset),
            None,
            draws,
            stride,
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndexedIndirect(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    draws: u32,
    stride: u32,
) {
    record("vkCmdDrawIndexedIndirect", commands, move |commands| {
        draw_indirect(
            commands,
            Numbers::Indices,
            (buffer, offset),
            None,
            draws,
            stride,
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndirectCount(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    count_buffer: vk::Buffer,
    count_offset: vk::DeviceSize,
    draws: u32,
    stride: u32,
) {
    record("vkCmdDrawIndirectCount", commands, move |commands| {
        let count = Some((count_buffer, count_offset));
        draw_indirect(
            commands,
            Numbers::Vertices,
            (buffer, offset),
            count,
            draws,
            stride,
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndexedIndirectCount(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    count_buffer: vk::Buffer,
    count_offset: vk::DeviceSize,
    draws: u32,
    stride: u32,
) {
    record("vkCmdDrawIndexedIndirectCount", commands, move |commands| {
        let count = Some((count_buffer, count_offset));
        draw_indirect(
            commands,
            Numbers::Indices,
            (buffer, offset),
            count,
            draws,
            stride,
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawMeshTasksEXT(
    commands: vk::CommandBuffer,
    x: u32,
    y: u32,
    z: u32,
) {
    record("vkCmdDrawMeshTasksEXT", commands, move |commands| {
        let (indexed, call) = (false, DrawCall::of_groups([x, y, z], 0));
        push(commands, GraphicsCommand::Draw { indexed, call })
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawMeshTasksIndirectEXT(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    draws: u32,
    stride: u32,
) {
    record("vkCmdDrawMeshTasksIndirectEXT", commands, move |commands| {
        draw_indirect(
            commands,
            Numbers::Workgroups,
            (buffer, offset),
            None,
            draws,
            stride,
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawMeshTasksIndirectCountEXT(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    count_buffer: vk::Buffer,
    count_offset: vk::DeviceSize,
    draws: u32,
    stride: u32,
) {
    record(
        "vkCmdDrawMeshTasksIndirectCountEXT",
        commands,
        move |commands| {
            let count = Some((count_buffer, count_offset));
            draw_indirect(
                commands,
                Numbers::Workgroups,
                (buffer, offset),
                count,
                draws,
                stride,
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdBeginConditionalRenderingEXT(
    commands: vk::CommandBuffer,
    info: *const vk::ConditionalRenderingBeginInfoEXT<'_>,
) {
    record(
        "vkCmdBeginConditionalRenderingEXT",
        commands,
        move |commands| {
            let info = &*info;
            let (address, _) = place(info.buffer, info.offset, vk::WHOLE_SIZE);
            let inverted = info
                .flags
                .contains(vk::ConditionalRenderingFlagsEXT::INVERTED);
            push(
                commands,
                GraphicsCommand::BeginConditional { address, inverted },
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdEndConditionalRenderingEXT(commands: vk::CommandBuffer) {
    record(
        "vkCmdEndConditionalRenderingEXT",
        commands,
        move |commands| push(commands, GraphicsCommand::EndConditional),
    )
}

/// Occlusion queries count samples exactly, precise or not.
pub(crate) unsafe extern "system" fn vkCmdBeginQuery(
    commands: vk::CommandBuffer,
    pool: vk::QueryPool,
    query: u32,
    _flags: vk::QueryControlFlags,
) {
    record("vkCmdBeginQuery", commands, move |commands| {
        let pool = retain::<QueryPool>(pool);
        push(
            commands,
            GraphicsCommand::BeginQuery {
                pool,
                query,
                stream: 0,
            },
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdEndQuery(
    commands: vk::CommandBuffer,
    pool: vk::QueryPool,
    query: u32,
) {
    record("vkCmdEndQuery", commands, move |commands| {
        let pool = retain::<QueryPool>(pool);
        push(commands, GraphicsCommand::EndQuery { pool, query })
    })
}
