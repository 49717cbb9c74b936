//! Descriptor updates.

use std::ffi::c_void;

use ash::vk;

use crate::decode::descriptor_update::{apply_copy, apply_template, apply_write};
use crate::ffi;
use crate::guard::guard;
use crate::handle::from_handle;
use crate::object::{DescriptorSet, DescriptorUpdateTemplate};

pub(crate) unsafe extern "system" fn vkUpdateDescriptorSets(
    _device: vk::Device,
    write_count: u32,
    writes: *const vk::WriteDescriptorSet,
    copy_count: u32,
    copies: *const vk::CopyDescriptorSet,
) {
    guard("vkUpdateDescriptorSets", move || {
        for info in ffi::slice(writes, write_count) {
            apply_write(from_handle::<DescriptorSet>(info.dst_set), info);
        }
        for info in ffi::slice(copies, copy_count) {
            apply_copy(info);
        }
    })
}

pub(crate) unsafe extern "system" fn vkUpdateDescriptorSetWithTemplate(
    _device: vk::Device,
    set: vk::DescriptorSet,
    template: vk::DescriptorUpdateTemplate,
    data: *const c_void,
) {
    guard("vkUpdateDescriptorSetWithTemplate", move || {
        apply_template(
            from_handle::<DescriptorSet>(set),
            from_handle::<DescriptorUpdateTemplate>(template),
            data,
        );
    })
}
