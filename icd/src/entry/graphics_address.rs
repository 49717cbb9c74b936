//! Drawing from device addresses (`VK_KHR_device_address_commands`).

use std::ffi::c_void;

use super::record::record;
use crate::VkResult;
use crate::command::graphics::{
    BindVertexBuffers, DrawIndirect, IndexBinding, Numbers, VertexBinding,
};
use crate::command::{Command, GraphicsCommand, Recording};
use crate::ffi::{slice, vk};

fn push(commands: &mut Recording, command: GraphicsCommand) -> VkResult {
    commands.push(Command::Graphics(command))
}

fn draw_indirect(
    commands: &mut Recording,
    numbers: Numbers,
    info: &vk::DrawIndirect2InfoKHR<'_>,
) -> VkResult {
    let draw = DrawIndirect {
        numbers,
        address: info.address_range.address,
        stride_bytes: info.address_range.stride as u32,
        draws: info.draw_count,
        count: None,
    };
    push(commands, GraphicsCommand::DrawIndirect(draw))
}

fn draw_indirect_count(
    commands: &mut Recording,
    numbers: Numbers,
    info: &vk::DrawIndirectCount2InfoKHR<'_>,
) -> VkResult {
    let draw = DrawIndirect {
        numbers,
        address: info.address_range.address,
        stride_bytes: info.address_range.stride as u32,
        draws: info.max_draw_count,
        count: Some(info.count_address_range.address),
    };
    push(commands, GraphicsCommand::DrawIndirect(draw))
}

pub(crate) unsafe extern "system" fn vkCmdBindIndexBuffer3KHR(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record("vkCmdBindIndexBuffer3KHR", commands, move |commands| {
        let info = &*info.cast::<vk::BindIndexBuffer3InfoKHR<'_>>();
        let binding = IndexBinding {
            address: info.address_range.address,
            size_bytes: info.address_range.size,
            ty: info.index_type,
        };
        push(commands, GraphicsCommand::BindIndexBuffer(binding))
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindVertexBuffers3KHR(
    commands: vk::CommandBuffer,
    first: u32,
    count: u32,
    infos: *const c_void,
) {
    record("vkCmdBindVertexBuffers3KHR", commands, move |commands| {
        let infos = slice(infos.cast::<vk::BindVertexBuffer3InfoKHR<'_>>(), count);
        let buffers = infos.iter().map(|info| VertexBinding {
            address: info.address_range.address,
            size_bytes: info.address_range.size,
            stride_bytes: (info.set_stride != vk::FALSE).then_some(info.address_range.stride),
        });
        let bind = Box::new(BindVertexBuffers {
            first,
            buffers: buffers.collect(),
        });
        push(commands, GraphicsCommand::BindVertexBuffers(bind))
    })
}

pub(crate) unsafe extern "system" fn vkCmdBeginConditionalRendering2EXT(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record(
        "vkCmdBeginConditionalRendering2EXT",
        commands,
        move |commands| {
            let info = &*info.cast::<vk::ConditionalRenderingBeginInfo2EXT<'_>>();
            let inverted = info
                .flags
                .contains(vk::ConditionalRenderingFlagsEXT::INVERTED);
            let address = info.address_range.address;
            push(
                commands,
                GraphicsCommand::BeginConditional { address, inverted },
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndirect2KHR(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record("vkCmdDrawIndirect2KHR", commands, move |commands| {
        draw_indirect(commands, Numbers::Vertices, &*info.cast())
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndexedIndirect2KHR(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record("vkCmdDrawIndexedIndirect2KHR", commands, move |commands| {
        draw_indirect(commands, Numbers::Indices, &*info.cast())
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndirectCount2KHR(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record("vkCmdDrawIndirectCount2KHR", commands, move |commands| {
        draw_indirect_count(commands, Numbers::Vertices, &*info.cast())
    })
}

pub(crate) unsafe extern "system" fn vkCmdDrawIndexedIndirectCount2KHR(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record(
        "vkCmdDrawIndexedIndirectCount2KHR",
        commands,
        move |commands| draw_indirect_count(commands, Numbers::Indices, &*info.cast()),
    )
}

pub(crate) unsafe extern "system" fn vkCmdDrawMeshTasksIndirect2EXT(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record(
        "vkCmdDrawMeshTasksIndirect2EXT",
        commands,
        move |commands| draw_indirect(commands, Numbers::Workgroups, &*info.cast()),
    )
}

pub(crate) unsafe extern "system" fn vkCmdDrawMeshTasksIndirectCount2EXT(
    commands: vk::CommandBuffer,
    info: *const c_void,
) {
    record(
        "vkCmdDrawMeshTasksIndirectCount2EXT",
        commands,
        move |commands| draw_indirect_count(commands, Numbers::Workgroups, &*info.cast()),
    )
}
