//! `VkShaderDescriptorSetAndBindingMappingInfoEXT` to owned mappings.

use std::ffi::c_void;

use images::SamplerDescriptor;
use spirv_jit::descriptor_heap::{DESCRIPTOR_BYTES, HeapPlace, HeapSource, Mapping, Source, Word};

use super::sampler::decode_sampler;
use crate::ffi::{find, slice, vk};

/// Mappings of a stage, and their embedded samplers. A mapping names a sampler by its index here.
#[derive(Default)]
pub struct Mappings {
    pub mappings: Vec<Mapping>,
    pub embedded: Vec<SamplerDescriptor>,
}

/// Copies the mappings in a stage's chain. A mapping of an unknown source is left out, so that its
/// resources are null descriptors.
///
/// # Safety
/// The chain is valid.
pub unsafe fn decode_mappings(next: *const c_void) -> Mappings {
    let mut out = Mappings::default();
    // SAFETY: the caller's chain is valid, and so are the arrays that it points to.
    unsafe {
        let Some(info) = find::<vk::ShaderDescriptorSetAndBindingMappingInfoEXT<'_>>(next) else {
            return out;
        };
        for mapping in slice(info.p_mappings, info.mapping_count) {
            if let Some(source) = source(mapping, &mut out.embedded) {
                out.mappings.push(Mapping {
                    set: mapping.descriptor_set,
                    first_binding: mapping.first_binding,
                    binding_count: mapping.binding_count,
                    resources: mapping.resource_mask,
                    source,
                });
            }
        }
    }
    out
}

/// A place in a heap from values in bytes. The offset and the stride are multiples of a
/// descriptor's size.
fn place(
    [offset, stride, index_stride_bytes]: [u32; 3],
    index: Option<Word>,
    is_index_array: bool,
) -> HeapPlace {
    HeapPlace {
        first: offset / DESCRIPTOR_BYTES,
        stride: stride / DESCRIPTOR_BYTES,
        index_stride_bytes,
        index,
        is_index_array,
    }
}

/// # Safety
/// The mapping is valid.
unsafe fn source(
    mapping: &vk::DescriptorSetAndBindingMappingEXT<'_>,
    embedded: &mut Vec<SamplerDescriptor>,
) -> Option<Source> {
    let data = &mapping.source_data;
    let mut embed = |info: *const vk::SamplerCreateInfo<'_>| {
        // SAFETY: the caller's mapping is valid: its sampler is null or valid.
        let sampler = unsafe { info.as_ref().map(|info| decode_sampler(info)) }?;
        embedded.push(sampler);
        Some(embedded.len() as u32 - 1)
    };
    let push_or_record = |at| match mapping.source {
        1 => Word::Push(at),
        _ => Word::ShaderRecord(at),
    };
    // SAFETY: the mapping is valid, so that its source says which member of the union is set.
    Some(unsafe {
        match mapping.source {
            0 => {
                let it = &data.constant_offset;
                constant_offset(it, embed(it.p_embedded_sampler))
            }
            1 | 8 => {
                let it = &data.index;
                index(it, push_or_record, embed(it.p_embedded_sampler))
            }
            2 => {
                let it = &data.indirect_index;
                indirect_index(it, embed(it.p_embedded_sampler))
            }
            3 => {
                let it = &data.indirect_index_array;
                indirect_index_array(it, embed(it.p_embedded_sampler))
            }
            4 => Source::HeapData {
                offset_bytes: data.words[0],
                push: data.words[1],
            },
            5 => Source::Data(Word::Push(data.words[0])),
            6 => Source::Address(Word::Push(data.words[0])),
            7 => Source::Address(Word::Indirect {
                push: data.words[0],
                offset: data.words[1],
            }),
            9 => Source::Data(Word::ShaderRecord(data.words[0])),
            10 => Source::Address(Word::ShaderRecord(data.words[0])),
            _ => return None,
        }
    })
}

fn heap(place: HeapPlace, sampler: HeapPlace, is_packed: bool, embedded: Option<u32>) -> Source {
    Source::Heap(Box::new(HeapSource {
        place,
        sampler,
        is_packed,
        embedded,
    }))
}

fn constant_offset(
    it: &vk::DescriptorMappingSourceConstantOffsetEXT<'_>,
    embedded: Option<u32>,
) -> Source {
    heap(
        place([it.heap_offset, it.heap_array_stride, 0], None, false),
        place(
            [it.sampler_heap_offset, it.sampler_heap_array_stride, 0],
            None,
            false,
        ),
        false,
        embedded,
    )
}

/// `word` says where the index of an offset is.
fn index(
    it: &vk::DescriptorMappingSourceIndexEXT<'_>,
    word: impl Fn(u32) -> Word,
    embedded: Option<u32>,
) -> Source {
    heap(
        place(
            [it.heap_offset, it.heap_array_stride, it.heap_index_stride],
            Some(word(it.index_offset)),
            false,
        ),
        place(
            [
                it.sampler_heap_offset,
                it.sampler_heap_array_stride,
                it.sampler_heap_index_stride,
            ],
            Some(word(it.sampler_index_offset)),
            false,
        ),
        it.use_combined_image_sampler_index != vk::FALSE,
        embedded,
    )
}

fn indirect_index(
    it: &vk::DescriptorMappingSourceIndirectIndexEXT<'_>,
    embedded: Option<u32>,
) -> Source {
    let word = |push, offset| Some(Word::Indirect { push, offset });
    heap(
        place(
            [it.heap_offset, it.heap_array_stride, it.heap_index_stride],
            word(it.push_offset, it.address_offset),
            false,
        ),
        place(
            [
                it.sampler_heap_offset,
                it.sampler_heap_array_stride,
                it.sampler_heap_index_stride,
            ],
            word(it.sampler_push_offset, it.sampler_address_offset),
            false,
        ),
        it.use_combined_image_sampler_index != vk::FALSE,
        embedded,
    )
}

fn indirect_index_array(
    it: &vk::DescriptorMappingSourceIndirectIndexArrayEXT<'_>,
    embedded: Option<u32>,
) -> Source {
    let word = |push, offset| Some(Word::Indirect { push, offset });
    heap(
        place(
            [it.heap_offset, 0, it.heap_index_stride],
            word(it.push_offset, it.address_offset),
            true,
        ),
        place(
            [it.sampler_heap_offset, 0, it.sampler_heap_index_stride],
            word(it.sampler_push_offset, it.sampler_address_offset),
            true,
        ),
        it.use_combined_image_sampler_index != vk::FALSE,
        embedded,
    )
}
