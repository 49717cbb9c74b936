//! Render passes, dynamic rendering, and clears inside of them.

use ash::vk;

use super::define::commands;
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

commands! {
    fn vkCmdBeginRenderPass(commands, info: *const vk::RenderPassBeginInfo<'_>, _contents: vk::SubpassContents) {
        begin_pass(commands, begin(&*info))
    }

    fn vkCmdBeginRenderPass2(
        commands,
        info: *const vk::RenderPassBeginInfo<'_>,
        _begin: *const vk::SubpassBeginInfo<'_>,
    ) {
        begin_pass(commands, begin(&*info))
    }

    fn vkCmdNextSubpass(commands, _contents: vk::SubpassContents) {
        next_subpass(commands)
    }

    fn vkCmdNextSubpass2(
        commands,
        _begin: *const vk::SubpassBeginInfo<'_>,
        _end: *const vk::SubpassEndInfo<'_>,
    ) {
        next_subpass(commands)
    }

    fn vkCmdEndRenderPass(commands) {
        end_pass(commands)
    }

    fn vkCmdEndRenderPass2(commands, _info: *const vk::SubpassEndInfo<'_>) {
        end_pass(commands)
    }

    fn vkCmdBeginRendering(commands, info: *const vk::RenderingInfo<'_>) {
        let pass = Box::new(rendering(&*info));
        commands.push(Command::Graphics(GraphicsCommand::BeginPass(pass)))
    }

    fn vkCmdEndRendering(commands) {
        commands.push(Command::Graphics(GraphicsCommand::EndPass))
    }

    fn vkCmdEndRendering2KHR(commands, _info: *const std::ffi::c_void) {
        commands.push(Command::Graphics(GraphicsCommand::EndPass))
    }

    fn vkCmdSetRenderingAttachmentLocationsKHR(
        commands,
        info: *const vk::RenderingAttachmentLocationInfoKHR<'_>,
    ) {
        let locations = Setting::ColorLocations(color_locations(&*info));
        commands.push(Command::Graphics(GraphicsCommand::Set(locations)))
    }

    /// Input attachments are ordinary descriptors, so the application's indices need no mapping.
    fn vkCmdSetRenderingInputAttachmentIndicesKHR(
        _commands,
        _info: *const vk::RenderingInputAttachmentIndexInfoKHR<'_>,
    ) {
        Ok(())
    }

    fn vkCmdClearAttachments(
        commands,
        count: u32,
        attachments: *const vk::ClearAttachment,
        rect_count: u32,
        rects: *const vk::ClearRect,
    ) {
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
    }
}
