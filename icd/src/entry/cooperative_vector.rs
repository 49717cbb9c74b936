//! `VK_NV_cooperative_vector`: products, and conversions of matrices on the host and on the device.

use spirv_jit::reach::Reach;

use super::record::record;
use crate::capabilities::cooperative_vectors;
use crate::command::{Command, TransferCommand};
use crate::decode::matrix::{conversion, destination};
use crate::ffi::enumerate::enumerate_with;
use crate::ffi::{slice, vk};
use crate::guard::guard_result;
use crate::transfer::matrix;

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceCooperativeVectorPropertiesNV(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::CooperativeVectorPropertiesNV<'_>,
) -> vk::Result {
    guard_result(
        "vkGetPhysicalDeviceCooperativeVectorPropertiesNV",
        move || {
            enumerate_with(
                count,
                out,
                cooperative_vectors::products(),
                |out, product| {
                    cooperative_vectors::describe(product, out);
                },
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkConvertCooperativeVectorMatrixNV(
    _device: vk::Device,
    info: *const vk::ConvertCooperativeVectorMatrixInfoNV<'_>,
) -> vk::Result {
    guard_result("vkConvertCooperativeVectorMatrixNV", move || {
        let info = &*info;
        let size_bytes = &mut *info.p_dst_size;
        let to = destination(info, info.dst_data.device_address);
        let to = to.ok_or(vk::Result::ERROR_FEATURE_NOT_PRESENT)?;
        if to.address == 0 {
            *size_bytes = to.size_bytes() as usize;
            return Ok(());
        }
        if (*size_bytes as u64) < to.size_bytes() {
            return Err(vk::Result::INCOMPLETE);
        }
        let conversion = conversion(info, info.src_data.device_address, to);
        let conversion = conversion.ok_or(vk::Result::ERROR_FEATURE_NOT_PRESENT)?;
        matrix::convert(&conversion, &Reach::everywhere());
        *size_bytes = to.size_bytes() as usize;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCmdConvertCooperativeVectorMatrixNV(
    commands: vk::CommandBuffer,
    count: u32,
    infos: *const vk::ConvertCooperativeVectorMatrixInfoNV<'_>,
) {
    record(
        "vkCmdConvertCooperativeVectorMatrixNV",
        commands,
        move |commands| {
            let conversions = slice(infos, count).iter().filter_map(|info| {
                let to = destination(info, info.dst_data.device_address)?;
                let fits = to.size_bytes() <= *info.p_dst_size as u64;
                conversion(info, info.src_data.device_address, to).filter(|_| fits)
            });
            commands.push(Command::Transfer(TransferCommand::ConvertMatrices(
                conversions.collect(),
            )))
        },
    )
}
