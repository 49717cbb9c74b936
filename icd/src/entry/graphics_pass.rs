//! Render passes, dynamic rendering, and clears inside of them.

use ash::vk;

use super::record::record;
use crate::VkResult;
use crate::command::pass::{AttachmentClear, AttachmentClears, PassRecorder};
use crate::command::{Command, GraphicsCommand, Recording};
use crate::decode::graphics::color_locations;
use crate::decode::render_pass::{begin, rendering};
use crate::ffi::slice;
use crate::object::setting::Setting;

/// Begins the first subpass of a recorded render pass.
fn begin_pass(commands: &mut Recording, recorder: PassRecorder) -> VkResult {
    commands.render_pass = Some(recorder);
    begin_subpass(commands)
}

fn begin_subpass(commands: &mut Recording) -> VkResult {
    let pass = commands.render_pass.as_mut().and_then(PassRecorder::pass);
    let pass = Box::new(pass.ok_or(vk::Result::ERROR_UNKNOWN)?);
    commands.push(Command::Graphics(GraphicsCommand::BeginPass(pass)))
}

fn end_subpass(commands: &mut Recording) -> VkResult {
    commands.push(Command::Graphics(GraphicsCommand::EndPass))
}

fn next_subpass(commands: &mut Recording) -> VkResult {
    end_subpass(commands)?;
    if let Some(recorder) = &mut commands.render_pass {
        recorder.advance();
    }
    begin_subpass(commands)
}

fn end_pass(commands: &mut Recording) -> VkResult {
    commands.render_pass = None;
    end_subpass(commands)
}

pub(crate) unsafe extern "system" fn vkCmdBeginRenderPass(
    commands: vk::CommandBuffer,
    info: *const vk::RenderPassBeginInfo<'_>,
    _contents: vk::SubpassContents,
) {
    record("vkCmdBeginRenderPass", commands, move |commands| {
        begin_pass(commands, begin(&*info))
    })
}

pub(crate) unsafe extern "system" fn vkCmdBeginRenderPass2(
    commands: vk::CommandBuffer,
    info: *const vk::RenderPassBeginInfo<'_>,
    _begin: *const vk::SubpassBeginInfo<'_>,
) {
    record("vkCmdBeginRenderPass2", commands, move |commands| {
        begin_pass(commands, begin(&*info))
    })
}

pub(crate) unsafe extern "system" fn vkCmdNextSubpass(
    commands: vk::CommandBuffer,
    _contents: vk::SubpassContents,
) {
    record("vkCmdNextSubpass", commands, move |commands| {
        next_subpass(commands)
    })
}

pub(crate) unsafe extern "system" fn vkCmdNextSubpass2(
    commands: vk::CommandBuffer,
    _begin: *const vk::SubpassBeginInfo<'_>,
    _end: *const vk::SubpassEndInfo<'_>,
) {
    record("vkCmdNextSubpass2", commands, move |commands| {
        next_subpass(commands)
    })
}

pub(crate) unsafe extern "system" fn vkCmdEndRenderPass(commands: vk::CommandBuffer) {
    record("vkCmdEndRenderPass", commands, move |commands| {
        end_pass(commands)
    })
}

pub(crate) unsafe extern "system" fn vkCmdEndRenderPass2(
    commands: vk::CommandBuffer,
    _info: *const vk::SubpassEndInfo<'_>,
) {
    record("vkCmdEndRenderPass2", commands, move |commands| {
        end_pass(commands)
    })
}

pub(crate) unsafe extern "system" fn vkCmdBeginRendering(
    commands: vk::CommandBuffer,
    info: *const vk::RenderingInfo<'_>,
) {
    record("vkCmdBeginRendering", commands, move |commands| {
        let pass = Box::new(rendering(&*info));
        commands.push(Command::Graphics(GraphicsCommand::BeginPass(pass)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdEndRendering(commands: vk::CommandBuffer) {
    record("vkCmdEndRendering", commands, move |commands| {
        commands.push(Command::Graphics(GraphicsCommand::EndPass))
    })
}

pub(crate) unsafe extern "system" fn vkCmdEndRendering2KHR(
    commands: vk::CommandBuffer,
    _info: *const std::ffi::c_void,
) {
    record("vkCmdEndRendering2KHR", commands, move |commands| {
        commands.push(Command::Graphics(GraphicsCommand::EndPass))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetRenderingAttachmentLocationsKHR(
    commands: vk::CommandBuffer,
    info: *const vk::RenderingAttachmentLocationInfoKHR<'_>,
) {
    record(
        "vkCmdSetRenderingAttachmentLocationsKHR",
        commands,
        move |commands| {
            let locations = Setting::ColorLocations(color_locations(&*info));
            commands.push(Command::Graphics(GraphicsCommand::Set(locations)))
        },
    )
}

/// Input attachments are ordinary descriptors, so the application's indices need no mapping.
pub(crate) unsafe extern "system" fn vkCmdSetRenderingInputAttachmentIndicesKHR(
    commands: vk::CommandBuffer,
    _info: *const vk::RenderingInputAttachmentIndexInfoKHR<'_>,
) {
    record(
        "vkCmdSetRenderingInputAttachmentIndicesKHR",
        commands,
        move |_| Ok(()),
    )
}

pub(crate) unsafe extern "system" fn vkCmdClearAttachments(
    commands: vk::CommandBuffer,
    count: u32,
    attachments: *const vk::ClearAttachment,
    rect_count: u32,
    rects: *const vk::ClearRect,
) {
    record("vkCmdClearAttachments", commands, move |commands| {
        let clears = slice(attachments, count).iter().map(|it| AttachmentClear {
            aspects: it.aspect_mask,
            attachment: it.color_attachment,
            value: it.clear_value,
        });
        let clears = Box::new(AttachmentClears {
            clears: clears.collect(),
            rects: slice(rects, rect_count).iter().copied().collect(),
        });
        commands.push(Command::Graphics(GraphicsCommand::ClearAttachments(clears)))
    })
}
