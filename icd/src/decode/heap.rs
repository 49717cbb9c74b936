//! `VkShaderDescriptorSetAndBindingMappingInfoEXT` to owned mappings.

use std::ffi::c_void;

use images::SamplerDescriptor;
use spirv_jit::heap::{DESCRIPTOR_BYTES, HeapPlace, HeapSource, Mapping, Source, Word};

use super::sampler::decode_sampler;
use crate::ffi::{find, slice, vk};

/// Mappings of a stage, and the samplers that they embed, which they name by their places here.
#[derive(Default)]
pub struct Mappings {
    pub mappings: Vec<Mapping>,
    pub embedded: Vec<SamplerDescriptor>,
}

/// Copies the mappings in a stage's chain. One of an unknown source is left out: its resources are
/// null descriptors.
///
/// # Safety
/// The chain is valid.
pub unsafe fn decode_mappings(next: *const c_void) -> Mappings {
    let mut out = Mappings::default();
    // SAFETY: the caller's promise.
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

/// A place, given in bytes: the offset and the stride are multiples of a descriptor's size.
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
    let mut embed = |info: *const vk::SamplerCreateInfo<'_>| {
        // SAFETY: the caller's promise: null or valid.
        let sampler = unsafe { info.as_ref().map(|info| decode_sampler(info)) }?;
        embedded.push(sampler);
        Some(embedded.len() as u32 - 1)
    };
    let data = &mapping.source_data;
    // SAFETY: the caller's promise: the source says which part of the union there is.
    Some(unsafe {
        match mapping.source {
            0 => {
                let it = &data.constant_offset;
                Source::Heap(Box::new(HeapSource {
                    place: place([it.heap_offset, it.heap_array_stride, 0], None, false),
                    sampler: place(
                        [it.sampler_heap_offset, it.sampler_heap_array_stride, 0],
                        None,
                        false,
                    ),
                    is_packed: false,
                    embedded: embed(it.p_embedded_sampler),
                }))
            }
            1 | 8 => {
                let it = &data.index;
                let word = |at| match mapping.source {
                    1 => Word::Push(at),
                    _ => Word::ShaderRecord(at),
                };
                Source::Heap(Box::new(HeapSource {
                    place: place(
                        [it.heap_offset, it.heap_array_stride, it.heap_index_stride],
                        Some(word(it.index_offset)),
                        false,
                    ),
                    sampler: place(
                        [
                            it.sampler_heap_offset,
                            it.sampler_heap_array_stride,
                            it.sampler_heap_index_stride,
                        ],
                        Some(word(it.sampler_index_offset)),
                        false,
                    ),
                    is_packed: it.use_combined_image_sampler_index != vk::FALSE,
                    embedded: embed(it.p_embedded_sampler),
                }))
            }
            2 => {
                let it = &data.indirect_index;
                let word = |push, offset| Some(Word::Indirect { push, offset });
                Source::Heap(Box::new(HeapSource {
                    place: place(
                        [it.heap_offset, it.heap_array_stride, it.heap_index_stride],
                        word(it.push_offset, it.address_offset),
                        false,
                    ),
                    sampler: place(
                        [
                            it.sampler_heap_offset,
                            it.sampler_heap_array_stride,
                            it.sampler_heap_index_stride,
                        ],
                        word(it.sampler_push_offset, it.sampler_address_offset),
                        false,
                    ),
                    is_packed: it.use_combined_image_sampler_index != vk::FALSE,
                    embedded: embed(it.p_embedded_sampler),
                }))
            }
            3 => {
                let it = &data.indirect_index_array;
                let word = |push, offset| Some(Word::Indirect { push, offset });
                Source::Heap(Box::new(HeapSource {
                    place: place(
                        [it.heap_offset, 0, it.heap_index_stride],
                        word(it.push_offset, it.address_offset),
                        true,
                    ),
                    sampler: place(
                        [it.sampler_heap_offset, 0, it.sampler_heap_index_stride],
                        word(it.sampler_push_offset, it.sampler_address_offset),
                        true,
                    ),
                    is_packed: it.use_combined_image_sampler_index != vk::FALSE,
                    embedded: embed(it.p_embedded_sampler),
                }))
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
