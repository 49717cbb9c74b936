//! `VK_KHR_push_descriptor`: each push binds a new set, so that earlier commands keep theirs.

use std::ffi::c_void;

use ash::vk;
use smallvec::SmallVec;

use super::record::record;
use crate::VkResult;
use crate::command::{BindDescriptorSets, Command, Recording};
use crate::decode::descriptor_update::{apply_template, apply_write};
use crate::ffi;
use crate::handle::{Ref, from_handle};
use crate::object::{DescriptorSet, DescriptorUpdateTemplate, PipelineLayout};

/// The bind points that stages belong to (`VkBindDescriptorSetsInfo::stageFlags`).
pub(super) fn bind_points(
    stages: vk::ShaderStageFlags,
) -> impl Iterator<Item = vk::PipelineBindPoint> {
    use vk::ShaderStageFlags as Stage;
    let tracing = Stage::RAYGEN_KHR
        | Stage::ANY_HIT_KHR
        | Stage::CLOSEST_HIT_KHR
        | Stage::MISS_KHR
        | Stage::INTERSECTION_KHR
        | Stage::CALLABLE_KHR;
    [
        (Stage::COMPUTE, vk::PipelineBindPoint::COMPUTE),
        (tracing, vk::PipelineBindPoint::RAY_TRACING_KHR),
        (Stage::ALL_GRAPHICS, vk::PipelineBindPoint::GRAPHICS),
    ]
    .into_iter()
    .filter(move |(of, _)| stages.intersects(*of))
    .map(|(_, point)| point)
}

/// Records a push.
fn push(
    recording: &mut Recording,
    bind_point: vk::PipelineBindPoint,
    layout: &PipelineLayout,
    set: u32,
    update: impl FnOnce(&DescriptorSet),
) -> VkResult {
    let set_layout = layout.sets.get(set as usize).and_then(Option::as_ref);
    let pushed = recording.pushed_set(
        bind_point,
        set,
        set_layout.ok_or(vk::Result::ERROR_UNKNOWN)?,
    )?;
    update(&pushed);
    recording.push(Command::BindDescriptorSets(BindDescriptorSets {
        bind_point,
        first_set: set,
        sets: SmallVec::from_elem(Some(Ref::clone(&pushed)), 1),
        dynamic_offsets: SmallVec::new(),
    }))
}

pub(crate) unsafe extern "system" fn vkCmdPushDescriptorSetKHR(
    commands: vk::CommandBuffer,
    bind_point: vk::PipelineBindPoint,
    layout: vk::PipelineLayout,
    set: u32,
    count: u32,
    writes: *const vk::WriteDescriptorSet,
) {
    record("vkCmdPushDescriptorSetKHR", commands, move |commands| {
        push(
            commands,
            bind_point,
            from_handle::<PipelineLayout>(layout),
            set,
            |pushed| {
                for write in ffi::slice(writes, count) {
                    apply_write(pushed, write);
                }
            },
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdPushDescriptorSetWithTemplateKHR(
    commands: vk::CommandBuffer,
    template: vk::DescriptorUpdateTemplate,
    layout: vk::PipelineLayout,
    set: u32,
    data: *const c_void,
) {
    record(
        "vkCmdPushDescriptorSetWithTemplateKHR",
        commands,
        move |commands| {
            let template = from_handle::<DescriptorUpdateTemplate>(template);
            push(
                commands,
                template.bind_point,
                from_handle::<PipelineLayout>(layout),
                set,
                |pushed| {
                    apply_template(pushed, template, data);
                },
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdPushDescriptorSet2KHR(
    commands: vk::CommandBuffer,
    info: *const vk::PushDescriptorSetInfoKHR<'_>,
) {
    record("vkCmdPushDescriptorSet2KHR", commands, move |commands| {
        let info = &*info;
        let layout = from_handle::<PipelineLayout>(info.layout);
        for point in bind_points(info.stage_flags) {
            push(commands, point, layout, info.set, |pushed| {
                for write in ffi::slice(info.p_descriptor_writes, info.descriptor_write_count) {
                    apply_write(pushed, write);
                }
            })?;
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCmdPushDescriptorSetWithTemplate2KHR(
    commands: vk::CommandBuffer,
    info: *const vk::PushDescriptorSetWithTemplateInfoKHR<'_>,
) {
    record(
        "vkCmdPushDescriptorSetWithTemplate2KHR",
        commands,
        move |commands| {
            let info = &*info;
            let template = from_handle::<DescriptorUpdateTemplate>(info.descriptor_update_template);
            let layout = from_handle::<PipelineLayout>(info.layout);
            push(commands, template.bind_point, layout, info.set, |pushed| {
                apply_template(pushed, template, info.p_data);
            })
        },
    )
}
