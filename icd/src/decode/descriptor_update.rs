//! Descriptor updates: decodes Vulkan's structures to entries that shaders read.

use std::ffi::c_void;

use ash::vk;
use spirv_jit::environment::Descriptor;

use crate::ffi::chain;
use crate::handle::{from_handle, optional};
use crate::object::descriptor::{Binding, DynamicBuffer, Entry};
use crate::object::{
    AccelerationStructure, AccelerationStructureNv, Buffer, BufferView, DescriptorSet,
    DescriptorUpdateTemplate, ImageView, Sampler,
};

/// The address of a buffer's bytes from an offset on, and their number. `None` if the buffer has no
/// memory or the offset is past its end.
fn bytes_from(buffer: &Buffer, offset: u64) -> Option<(u64, u64)> {
    let rest = buffer.size_bytes.saturating_sub(offset);
    let has_bytes = buffer.address() != 0 && rest != 0;
    has_bytes.then(|| (buffer.address() + offset, rest))
}

/// Whether `VkDescriptorBufferInfo` describes descriptors of a type.
fn is_buffer(ty: vk::DescriptorType) -> bool {
    use vk::DescriptorType as Ty;
    matches!(
        ty,
        Ty::UNIFORM_BUFFER
            | Ty::STORAGE_BUFFER
            | Ty::UNIFORM_BUFFER_DYNAMIC
            | Ty::STORAGE_BUFFER_DYNAMIC
    )
}

/// Writes a dynamic buffer's entry from a `VkDescriptorBufferInfo`.
///
/// # Safety
/// `source` points to that structure, and its buffer is alive or null. `entry` belongs to a set
/// that nothing else updates.
unsafe fn write_dynamic(entry: *mut DynamicBuffer, source: *const u8) {
    // SAFETY: the caller guarantees that `source` points to the structure, that its buffer is alive
    // or null, and that nothing else updates the set.
    unsafe {
        let info = source.cast::<vk::DescriptorBufferInfo>().read_unaligned();
        let found = optional::<Buffer>(info.buffer)
            .and_then(|buffer| bytes_from(buffer, info.offset))
            .map(|(address, rest)| DynamicBuffer {
                address,
                range: info.range,
                rest,
            });
        *entry = found.unwrap_or_default();
    }
}

/// Writes one plain entry from the structure or handle for its type: `VkDescriptorImageInfo`,
/// `VkDescriptorBufferInfo`, `VkBufferView`, `VkAccelerationStructureKHR` or
/// `VkAccelerationStructureNV`.
///
/// # Safety
/// `source` points to that structure or handle, and the objects in it are alive or null. `entry`
/// belongs to a set that nothing else updates.
unsafe fn write_entry(
    entry: *mut Descriptor,
    binding: &Binding,
    ty: vk::DescriptorType,
    source: *const u8,
) {
    use vk::DescriptorType as Ty;
    // SAFETY: the caller guarantees that `source` points to it, and what it names is alive or null.
    unsafe {
        if binding.ty == Ty::MUTABLE_EXT {
            // The entry's old descriptor may have used other fields.
            *entry = Descriptor::NULL;
        }
        match ty {
            Ty::SAMPLER
            | Ty::COMBINED_IMAGE_SAMPLER
            | Ty::SAMPLED_IMAGE
            | Ty::STORAGE_IMAGE
            | Ty::INPUT_ATTACHMENT => {
                let info = source.cast::<vk::DescriptorImageInfo>().read_unaligned();
                if ty != Ty::SAMPLER {
                    (*entry).image = optional::<ImageView>(info.image_view)
                        .map_or(std::ptr::null(), |view| view.entry(ty).as_ptr().cast());
                }
                let sampled = matches!(ty, Ty::SAMPLER | Ty::COMBINED_IMAGE_SAMPLER);
                if sampled && binding.immutable_samplers.is_empty() {
                    (*entry).sampler = optional::<Sampler>(info.sampler)
                        .map_or(std::ptr::null(), |sampler| sampler.descriptor.as_ptr());
                }
            }
            Ty::UNIFORM_TEXEL_BUFFER | Ty::STORAGE_TEXEL_BUFFER => {
                let view = source.cast::<vk::BufferView>().read_unaligned();
                (*entry).image = optional::<BufferView>(view)
                    .map_or(std::ptr::null(), |view| view.descriptor.as_ptr().cast());
            }
            Ty::ACCELERATION_STRUCTURE_KHR => {
                let structure = source
                    .cast::<vk::AccelerationStructureKHR>()
                    .read_unaligned();
                (*entry).address = optional::<AccelerationStructure>(structure)
                    .map_or(0, |structure| structure.address());
            }
            Ty::ACCELERATION_STRUCTURE_NV => {
                let structure = source
                    .cast::<vk::AccelerationStructureNV>()
                    .read_unaligned();
                (*entry).address = optional::<AccelerationStructureNv>(structure)
                    .map_or(0, |structure| structure.structure.address());
            }
            _ => {
                let info = source.cast::<vk::DescriptorBufferInfo>().read_unaligned();
                *entry = optional::<Buffer>(info.buffer)
                    .and_then(|buffer| bytes_from(buffer, info.offset))
                    .map_or(Descriptor::NULL, |(address, rest)| Descriptor {
                        address,
                        size_bytes: info.range.min(rest),
                        ..Descriptor::NULL
                    });
            }
        }
    }
}

/// The entries from (`binding`, `element`) on. Past a binding's end they continue in the next
/// nonempty one ("consecutive binding updates").
fn consecutive(
    set: &DescriptorSet,
    binding: u32,
    element: u32,
) -> impl Iterator<Item = (&Binding, Entry)> {
    let bindings = &set.layout.bindings;
    let mut index = bindings.partition_point(|other| other.binding < binding);
    let mut element = element;
    std::iter::from_fn(move || {
        while bindings.get(index)?.entry_count() <= element {
            element -= bindings[index].entry_count();
            index += 1;
        }
        let found = &bindings[index];
        element += 1;
        Some((found, set.entry(found, element - 1)?))
    })
}

/// Writes `count` descriptors of a type, or bytes of an inline uniform block. `source` returns the
/// address of each.
///
/// # Safety
/// As [`write_entry`], for each; for inline uniform blocks `source(0)` points to all bytes.
unsafe fn write(
    set: &DescriptorSet,
    (binding, element): (u32, u32),
    ty: vk::DescriptorType,
    count: u32,
    source: impl Fn(u32) -> *const u8,
) {
    // SAFETY: the caller keeps the promises of `write_entry` for each; for inline uniform blocks
    // `source(0)` points to all bytes; the set says where its memory ends.
    unsafe {
        if let Some(inline) = set
            .layout
            .binding(binding)
            .filter(|binding| binding.is_inline())
        {
            if let Some(bytes) = set.inline_bytes(inline, element, count) {
                bytes.copy_from(source(0), count as usize);
            }
            return;
        }
        for (index, (binding, entry)) in (0..count).zip(consecutive(set, binding, element)) {
            match entry {
                Entry::Plain(entry) => write_entry(entry, binding, ty, source(index)),
                Entry::Dynamic(entry) if is_buffer(ty) => write_dynamic(entry, source(index)),
                Entry::Dynamic(_) => {}
            }
        }
    }
}

/// Performs a `VkWriteDescriptorSet` on a set.
///
/// # Safety
/// Valid usage of `vkUpdateDescriptorSets`.
pub unsafe fn apply_write(set: &DescriptorSet, info: &vk::WriteDescriptorSet<'_>) {
    use vk::DescriptorType as Ty;
    // SAFETY: the caller guarantees valid usage of `vkUpdateDescriptorSets`; the array that the
    // type takes has as many elements as are written.
    unsafe {
        let (start, stride): (*const u8, usize) = match info.descriptor_type {
            Ty::SAMPLER
            | Ty::COMBINED_IMAGE_SAMPLER
            | Ty::SAMPLED_IMAGE
            | Ty::STORAGE_IMAGE
            | Ty::INPUT_ATTACHMENT => (
                info.p_image_info.cast(),
                size_of::<vk::DescriptorImageInfo>(),
            ),
            Ty::UNIFORM_TEXEL_BUFFER | Ty::STORAGE_TEXEL_BUFFER => {
                (info.p_texel_buffer_view.cast(), size_of::<vk::BufferView>())
            }
            Ty::ACCELERATION_STRUCTURE_KHR => {
                let structures =
                    chain::find::<vk::WriteDescriptorSetAccelerationStructureKHR>(info.p_next);
                (
                    structures.map_or(std::ptr::null(), |info| {
                        info.p_acceleration_structures.cast()
                    }),
                    size_of::<vk::AccelerationStructureKHR>(),
                )
            }
            Ty::ACCELERATION_STRUCTURE_NV => {
                let structures =
                    chain::find::<vk::WriteDescriptorSetAccelerationStructureNV>(info.p_next);
                (
                    structures.map_or(std::ptr::null(), |info| {
                        info.p_acceleration_structures.cast()
                    }),
                    size_of::<vk::AccelerationStructureNV>(),
                )
            }
            Ty::INLINE_UNIFORM_BLOCK => {
                let block = chain::find::<vk::WriteDescriptorSetInlineUniformBlock>(info.p_next);
                (
                    block.map_or(std::ptr::null(), |block| block.p_data.cast()),
                    0,
                )
            }
            _ => (
                info.p_buffer_info.cast(),
                size_of::<vk::DescriptorBufferInfo>(),
            ),
        };
        if start.is_null() {
            return;
        }
        write(
            set,
            (info.dst_binding, info.dst_array_element),
            info.descriptor_type,
            info.descriptor_count,
            |index| start.wrapping_add(index as usize * stride),
        );
    }
}

/// Performs an update template on a set.
///
/// # Safety
/// Valid usage of `vkUpdateDescriptorSetWithTemplate`.
pub unsafe fn apply_template(
    set: &DescriptorSet,
    template: &DescriptorUpdateTemplate,
    data: *const c_void,
) {
    for entry in &template.entries {
        let start = data.cast::<u8>().wrapping_add(entry.offset);
        // SAFETY: the caller guarantees valid usage of `vkUpdateDescriptorSetWithTemplate`; the
        // data is laid out as the template says.
        unsafe {
            write(
                set,
                (entry.dst_binding, entry.dst_array_element),
                entry.descriptor_type,
                entry.descriptor_count,
                |index| start.wrapping_add(index as usize * entry.stride),
            );
        }
    }
}

/// Performs a `VkCopyDescriptorSet`.
///
/// # Safety
/// Valid usage of `vkUpdateDescriptorSets`.
pub unsafe fn apply_copy(info: &vk::CopyDescriptorSet<'_>) {
    // SAFETY: the caller guarantees valid usage of `vkUpdateDescriptorSets`.
    unsafe {
        let source = from_handle::<DescriptorSet>(info.src_set);
        let destination = from_handle::<DescriptorSet>(info.dst_set);
        if let (Some(from), Some(to)) = (
            source
                .layout
                .binding(info.src_binding)
                .filter(|binding| binding.is_inline()),
            destination
                .layout
                .binding(info.dst_binding)
                .filter(|binding| binding.is_inline()),
        ) {
            let count = info.descriptor_count;
            if let (Some(from), Some(to)) = (
                source.inline_bytes(from, info.src_array_element, count),
                destination.inline_bytes(to, info.dst_array_element, count),
            ) {
                to.copy_from(from, count as usize);
            }
            return;
        }
        let from = consecutive(source, info.src_binding, info.src_array_element);
        let to = consecutive(destination, info.dst_binding, info.dst_array_element);
        for ((_, from), (binding, to)) in from.zip(to).take(info.descriptor_count as usize) {
            match (from, to) {
                (Entry::Plain(from), Entry::Plain(to)) => {
                    let kept = (*to).sampler;
                    *to = *from;
                    if !binding.immutable_samplers.is_empty() {
                        (*to).sampler = kept;
                    }
                }
                (Entry::Dynamic(from), Entry::Dynamic(to)) => *to = *from,
                // Valid usage copies between bindings of one type.
                _ => {}
            }
        }
    }
}
