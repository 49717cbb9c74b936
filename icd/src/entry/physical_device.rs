//! Queries of the physical device.

use std::ffi::c_char;

use ash::vk;

use super::instance::extension_properties;
use super::system;
use crate::capabilities::extensions::{self, Kind};
use crate::capabilities::{cooperative_matrices, features, limits, properties};
use crate::decode::image::{described_image, resident_usage};
use crate::ffi::enumerate::enumerate_with;
use crate::ffi::{chain, enumerate, vk as newer};
use crate::format;
use crate::guard::{guard, guard_result};
use crate::handle::from_handle;
use crate::object::PhysicalDevice;
use crate::object::image::supported_image;
use crate::object::memory::used_bytes;
use crate::object::resident;
use crate::object::shading_rate::RATES;
use crate::queue::MAX_QUEUES;

fn queue_family() -> vk::QueueFamilyProperties {
    vk::QueueFamilyProperties {
        queue_flags: vk::QueueFlags::GRAPHICS
            | vk::QueueFlags::COMPUTE
            | vk::QueueFlags::TRANSFER
            | vk::QueueFlags::SPARSE_BINDING,
        queue_count: MAX_QUEUES,
        timestamp_valid_bits: 64,
        min_image_transfer_granularity: vk::Extent3D {
            width: 1,
            height: 1,
            depth: 1,
        },
    }
}

/// One heap and one memory type, because a device address is a host address.
fn memory_properties(device: &PhysicalDevice) -> vk::PhysicalDeviceMemoryProperties {
    let mut properties = vk::PhysicalDeviceMemoryProperties {
        memory_type_count: 1,
        memory_heap_count: 1,
        ..Default::default()
    };
    properties.memory_types[0].property_flags = vk::MemoryPropertyFlags::DEVICE_LOCAL
        | vk::MemoryPropertyFlags::HOST_VISIBLE
        | vk::MemoryPropertyFlags::HOST_COHERENT
        | vk::MemoryPropertyFlags::HOST_CACHED;
    properties.memory_heaps[0] = vk::MemoryHeap {
        size: device.heap_bytes,
        flags: vk::MemoryHeapFlags::DEVICE_LOCAL,
    };
    properties
}

/// The features of a format for images as the 32-bit flags of Vulkan 1.0.
fn format_properties(format: vk::Format) -> vk::FormatProperties {
    let features = format::features(format);
    let narrow = |flags: vk::FormatFeatureFlags2| {
        vk::FormatFeatureFlags::from_raw(flags.as_raw() as u32 & 0x7fff_ffff)
    };
    vk::FormatProperties {
        linear_tiling_features: narrow(features.image),
        optimal_tiling_features: narrow(features.image),
        buffer_features: narrow(features.buffer),
    }
}

/// `VkExternalMemoryProperties` of a handle type.
fn external_memory(ty: vk::ExternalMemoryHandleTypeFlags) -> vk::ExternalMemoryProperties {
    let features = match ty {
        system::MEMORY_HANDLES => {
            vk::ExternalMemoryFeatureFlags::EXPORTABLE | vk::ExternalMemoryFeatureFlags::IMPORTABLE
        }
        vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT => {
            vk::ExternalMemoryFeatureFlags::IMPORTABLE
        }
        _ => return vk::ExternalMemoryProperties::default(),
    };
    vk::ExternalMemoryProperties {
        external_memory_features: features,
        export_from_imported_handle_types: if features
            .contains(vk::ExternalMemoryFeatureFlags::EXPORTABLE)
        {
            ty
        } else {
            vk::ExternalMemoryHandleTypeFlags::empty()
        },
        compatible_handle_types: ty,
    }
}

/// The planes of partially resident images; none if such images are not supported.
fn resident_planes(
    format: vk::Format,
    ty: vk::ImageType,
    samples: vk::SampleCountFlags,
    usage: vk::ImageUsageFlags,
    tiling: vk::ImageTiling,
) -> Vec<vk::SparseImageFormatProperties> {
    let flags = vk::ImageCreateFlags::SPARSE_BINDING | vk::ImageCreateFlags::SPARSE_RESIDENCY;
    match supported_image(format, ty, tiling, usage, flags) {
        Ok(_) if samples == vk::SampleCountFlags::TYPE_1 => resident::properties(format),
        _ => Vec::new(),
    }
}

pub(crate) unsafe extern "system" fn vkEnumerateDeviceExtensionProperties(
    _device: vk::PhysicalDevice,
    layer: *const c_char,
    count: *mut u32,
    out: *mut vk::ExtensionProperties,
) -> vk::Result {
    guard_result("vkEnumerateDeviceExtensionProperties", move || {
        if !layer.is_null() {
            return Err(vk::Result::ERROR_LAYER_NOT_PRESENT);
        }
        let all: Vec<_> = extensions::of_kind(Kind::Device).collect();
        enumerate(count, out, all.into_iter().map(extension_properties))
    })
}

pub(crate) unsafe extern "system" fn vkEnumerateDeviceLayerProperties(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::LayerProperties,
) -> vk::Result {
    guard_result("vkEnumerateDeviceLayerProperties", move || {
        enumerate(count, out, [].into_iter())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceProperties(
    device: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceProperties,
) {
    guard("vkGetPhysicalDeviceProperties", move || {
        *out = properties::core(&from_handle::<PhysicalDevice>(device).machine());
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceProperties2(
    device: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceProperties2,
) {
    guard("vkGetPhysicalDeviceProperties2", move || {
        let machine = from_handle::<PhysicalDevice>(device).machine();
        (*out).properties = properties::core(&machine);
        properties::fill_chain(&machine, (*out).p_next);
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceFeatures(
    _device: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceFeatures,
) {
    guard("vkGetPhysicalDeviceFeatures", move || {
        *out = features::core_features();
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceFeatures2(
    _device: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceFeatures2,
) {
    guard("vkGetPhysicalDeviceFeatures2", move || {
        (*out).features = features::core_features();
        features::fill_chain((*out).p_next);
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceQueueFamilyProperties(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::QueueFamilyProperties,
) {
    guard("vkGetPhysicalDeviceQueueFamilyProperties", move || {
        // Too few elements are no error, since the function returns nothing.
        let _ = enumerate(count, out, [queue_family()].into_iter());
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceQueueFamilyProperties2(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::QueueFamilyProperties2,
) {
    guard("vkGetPhysicalDeviceQueueFamilyProperties2", move || {
        let _ = enumerate_with(count, out, [queue_family()].into_iter(), |out, family| {
            out.queue_family_properties = family;
            if let Some(priorities) =
                chain::find_mut::<vk::QueueFamilyGlobalPriorityPropertiesKHR>(out.p_next)
            {
                // All queue priorities are equal.
                let all = [
                    vk::QueueGlobalPriorityKHR::LOW,
                    vk::QueueGlobalPriorityKHR::MEDIUM,
                    vk::QueueGlobalPriorityKHR::HIGH,
                    vk::QueueGlobalPriorityKHR::REALTIME,
                ];
                priorities.priority_count = all.len() as u32;
                priorities.priorities[..all.len()].copy_from_slice(&all);
            }
            if let Some(transfer) =
                chain::find_mut::<newer::QueueFamilyOwnershipTransferPropertiesKHR>(out.p_next)
            {
                // No image layout depends on the queue family.
                transfer.optimal_image_transfer_to_queue_families = u32::MAX;
            }
            if let Some(transfer) = chain::find_mut::<
                newer::QueueFamilyOptimalImageTransferGranularityPropertiesKHR<'_>,
            >(out.p_next)
            {
                // Images are linear, so transfers have no granularity.
                transfer.optimal_image_transfer_granularity = family.min_image_transfer_granularity;
            }
        });
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceMemoryProperties(
    device: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceMemoryProperties,
) {
    guard("vkGetPhysicalDeviceMemoryProperties", move || {
        *out = memory_properties(from_handle::<PhysicalDevice>(device));
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceMemoryProperties2(
    device: vk::PhysicalDevice,
    out: *mut vk::PhysicalDeviceMemoryProperties2,
) {
    guard("vkGetPhysicalDeviceMemoryProperties2", move || {
        let device = from_handle::<PhysicalDevice>(device);
        (*out).memory_properties = memory_properties(device);
        if let Some(budget) =
            chain::find_mut::<vk::PhysicalDeviceMemoryBudgetPropertiesEXT>((*out).p_next)
        {
            budget.heap_budget = [0; vk::MAX_MEMORY_HEAPS];
            budget.heap_usage = [0; vk::MAX_MEMORY_HEAPS];
            budget.heap_usage[0] = used_bytes();
            budget.heap_budget[0] = device.budget_bytes();
        }
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceFormatProperties(
    _device: vk::PhysicalDevice,
    format: vk::Format,
    out: *mut vk::FormatProperties,
) {
    guard("vkGetPhysicalDeviceFormatProperties", move || {
        *out = format_properties(format);
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceFormatProperties2(
    _device: vk::PhysicalDevice,
    format: vk::Format,
    out: *mut vk::FormatProperties2,
) {
    guard("vkGetPhysicalDeviceFormatProperties2", move || {
        (*out).format_properties = format_properties(format);
        if let Some(out3) = chain::find_mut::<vk::FormatProperties3>((*out).p_next) {
            let features = format::features(format);
            out3.linear_tiling_features = features.image;
            out3.optimal_tiling_features = features.image;
            out3.buffer_features = features.buffer;
        }
        if let Some(out4) = chain::find_mut::<newer::FormatProperties4KHR<'_>>((*out).p_next) {
            // No members are defined yet.
            out4.linear_tiling_features = 0;
            out4.optimal_tiling_features = 0;
            out4.buffer_features = 0;
        }
        if let Some(out) = chain::find_mut::<vk::SubpassResolvePerformanceQueryEXT>((*out).p_next) {
            // Samples of every format are resolved in the same way as those of other attachments.
            out.optimal = vk::TRUE;
        }
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceImageFormatProperties(
    _device: vk::PhysicalDevice,
    format: vk::Format,
    ty: vk::ImageType,
    tiling: vk::ImageTiling,
    usage: vk::ImageUsageFlags,
    flags: vk::ImageCreateFlags,
    out: *mut vk::ImageFormatProperties,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceImageFormatProperties", move || {
        *out = vk::ImageFormatProperties::default();
        *out = supported_image(format, ty, tiling, usage, flags)?;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceImageFormatProperties2(
    _device: vk::PhysicalDevice,
    info: *const vk::PhysicalDeviceImageFormatInfo2,
    out: *mut vk::ImageFormatProperties2,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceImageFormatProperties2", move || {
        (*out).image_format_properties = vk::ImageFormatProperties::default();
        let external = chain::find::<vk::PhysicalDeviceExternalImageFormatInfo>((*info).p_next)
            .map_or(vk::ExternalMemoryHandleTypeFlags::empty(), |external| {
                external.handle_type
            });
        let external_properties = external_memory(external);
        if !external.is_empty() && external_properties.external_memory_features.is_empty() {
            return Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED);
        }
        (*out).image_format_properties = described_image(&*info)?;
        if let Some(out) =
            chain::find_mut::<vk::SamplerYcbcrConversionImageFormatProperties>((*out).p_next)
        {
            // Descriptors of all combined image samplers have the same size.
            out.combined_image_sampler_descriptor_count = 1;
        }
        if let Some(out) =
            chain::find_mut::<vk::HostImageCopyDevicePerformanceQueryEXT>((*out).p_next)
        {
            out.optimal_device_access = vk::TRUE;
            out.identical_memory_layout = vk::TRUE;
        }
        if let Some(out) = chain::find_mut::<vk::ExternalImageFormatProperties>((*out).p_next) {
            out.external_memory_properties = external_properties;
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSparseImageFormatProperties(
    _device: vk::PhysicalDevice,
    format: vk::Format,
    ty: vk::ImageType,
    samples: vk::SampleCountFlags,
    usage: vk::ImageUsageFlags,
    tiling: vk::ImageTiling,
    count: *mut u32,
    out: *mut vk::SparseImageFormatProperties,
) {
    guard(
        "vkGetPhysicalDeviceSparseImageFormatProperties",
        move || {
            let all = resident_planes(format, ty, samples, usage, tiling);
            let _ = enumerate(count, out, all.into_iter());
        },
    )
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSparseImageFormatProperties2(
    _device: vk::PhysicalDevice,
    info: *const vk::PhysicalDeviceSparseImageFormatInfo2,
    count: *mut u32,
    out: *mut vk::SparseImageFormatProperties2,
) {
    guard(
        "vkGetPhysicalDeviceSparseImageFormatProperties2",
        move || {
            let info = &*info;
            let planes =
                |usage| resident_planes(info.format, info.ty, info.samples, usage, info.tiling);
            let all = resident_usage(info).map_or_else(Vec::new, planes);
            let _ = enumerate_with(count, out, all.into_iter(), |out, it| out.properties = it);
        },
    )
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceMultisamplePropertiesEXT(
    _device: vk::PhysicalDevice,
    samples: vk::SampleCountFlags,
    out: *mut vk::MultisamplePropertiesEXT<'_>,
) {
    guard("vkGetPhysicalDeviceMultisamplePropertiesEXT", move || {
        let side = u32::from(limits::SAMPLE_LOCATION_COUNTS.contains(samples));
        (*out).max_sample_location_grid_size = vk::Extent2D {
            width: side,
            height: side,
        };
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceFragmentShadingRatesKHR(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::PhysicalDeviceFragmentShadingRateKHR<'_>,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceFragmentShadingRatesKHR", move || {
        enumerate_with(count, out, RATES.into_iter(), |out, rate| {
            let [width, height] = rate.pixels().map(|side| side as u32);
            out.sample_counts = rate.samples();
            out.fragment_size = vk::Extent2D { width, height };
        })
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::CooperativeMatrixPropertiesKHR<'_>,
) -> vk::Result {
    guard_result(
        "vkGetPhysicalDeviceCooperativeMatrixPropertiesKHR",
        move || {
            enumerate_with(
                count,
                out,
                cooperative_matrices::products(),
                |out, product| {
                    cooperative_matrices::describe(&product, out);
                },
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceExternalBufferProperties(
    _device: vk::PhysicalDevice,
    info: *const vk::PhysicalDeviceExternalBufferInfo,
    out: *mut vk::ExternalBufferProperties,
) {
    guard("vkGetPhysicalDeviceExternalBufferProperties", move || {
        (*out).external_memory_properties = external_memory((*info).handle_type);
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceExternalFenceProperties(
    _device: vk::PhysicalDevice,
    info: *const vk::PhysicalDeviceExternalFenceInfo,
    out: *mut vk::ExternalFenceProperties,
) {
    guard("vkGetPhysicalDeviceExternalFenceProperties", move || {
        use vk::ExternalFenceFeatureFlags as Feature;
        let all = system::FENCE_HANDLES;
        let (features, own, all) = match (*info).handle_type {
            ty if all.contains(ty) => (Feature::EXPORTABLE | Feature::IMPORTABLE, ty, all),
            _ => Default::default(),
        };
        (*out).export_from_imported_handle_types = own;
        (*out).compatible_handle_types = all;
        (*out).external_fence_features = features;
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceExternalSemaphoreProperties(
    _device: vk::PhysicalDevice,
    info: *const vk::PhysicalDeviceExternalSemaphoreInfo,
    out: *mut vk::ExternalSemaphoreProperties,
) {
    guard(
        "vkGetPhysicalDeviceExternalSemaphoreProperties",
        move || {
            use vk::ExternalSemaphoreFeatureFlags as Feature;
            let all = system::SEMAPHORE_HANDLES;
            let is_timeline = chain::find::<vk::SemaphoreTypeCreateInfo>((*info).p_next)
                .is_some_and(|info| info.semaphore_type == vk::SemaphoreType::TIMELINE);
            let (features, own, all) = match (*info).handle_type {
                ty if all.contains(ty) && !is_timeline => {
                    (Feature::EXPORTABLE | Feature::IMPORTABLE, ty, all)
                }
                _ => Default::default(),
            };
            (*out).export_from_imported_handle_types = own;
            (*out).compatible_handle_types = all;
            (*out).external_semaphore_features = features;
        },
    )
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceToolProperties(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::PhysicalDeviceToolProperties,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceToolProperties", move || {
        enumerate(count, out, [].into_iter())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceCalibrateableTimeDomainsKHR(
    _device: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::TimeDomainKHR,
) -> vk::Result {
    guard_result(
        "vkGetPhysicalDeviceCalibrateableTimeDomainsKHR",
        move || {
            let domains: Vec<_> = [vk::TimeDomainKHR::DEVICE]
                .into_iter()
                .chain(system::TIME_DOMAINS)
                .chain([
                    newer::TIME_DOMAIN_PRESENT_STAGE_LOCAL_EXT,
                    newer::TIME_DOMAIN_SWAPCHAIN_LOCAL_EXT,
                ])
                .collect();
            enumerate(count, out, domains.into_iter())
        },
    )
}
