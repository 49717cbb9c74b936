//! Descriptor heaps (`VK_EXT_descriptor_heap`): the sets that stand for them, and the mappings of
//! bindings onto them.
//!
//! A heap is memory that applications and shaders write. It is a stored set
//! ([`DescriptorSet::stored`](crate::environment::DescriptorSet::stored)), so that what lies in it
//! is checked at each use as descriptors in buffers are.

use crate::environment::StoredDescriptor;
use crate::ir::op::DescriptorBinding;

/// Size and alignment of each descriptor in a heap.
pub const DESCRIPTOR_BYTES: u32 = size_of::<StoredDescriptor>() as u32;

/// A table of descriptors of programs that use heaps: a set of their environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Table {
    /// The resource heap.
    Resources = 0,
    /// The sampler heap.
    Samplers = 1,
    /// The samplers that programs embed ([`Views::embedded`](crate::views::Views::embedded)).
    Embedded = 2,
    /// The resource heap as one buffer.
    Data = 3,
}

impl Table {
    /// All descriptors of the table.
    pub fn binding(self) -> DescriptorBinding {
        DescriptorBinding {
            set: self as u32,
            first: 0,
            count: u32::MAX,
            dynamic: false,
        }
    }
}

/// `VkDescriptorSetAndBindingMappingEXT`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Mapping {
    pub set: u32,
    pub first_binding: u32,
    pub binding_count: u32,
    /// `VkSpirvResourceTypeFlagsEXT`: kinds of resources.
    pub resources: u32,
    pub source: Source,
}

/// Kinds of resources in [`Mapping::resources`].
pub mod resource {
    pub const SAMPLER: u32 = 1 << 0;
    pub const SAMPLED_IMAGE: u32 = 1 << 1;
    pub const READ_ONLY_IMAGE: u32 = 1 << 2;
    pub const READ_WRITE_IMAGE: u32 = 1 << 3;
    pub const COMBINED: u32 = 1 << 4;
    pub const UNIFORM_BUFFER: u32 = 1 << 5;
    pub const READ_ONLY_STORAGE_BUFFER: u32 = 1 << 6;
    pub const READ_WRITE_STORAGE_BUFFER: u32 = 1 << 7;
    pub const ACCELERATION_STRUCTURE: u32 = 1 << 8;
}

/// The memory that backs a resource (`VkDescriptorMappingSourceEXT`).
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// A descriptor in a heap.
    Heap(Box<HeapSource>),
    /// Bytes of a memory, from an offset on.
    Data(Word),
    /// The resource heap's bytes, from a constant plus a word of push data on.
    HeapData { offset_bytes: u32, push: u32 },
    /// The memory at an address.
    Address(Word),
}

/// Descriptors in heaps.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct HeapSource {
    /// The place of the resource, or of a sampler alone.
    pub place: HeapPlace,
    /// The place of a combined image sampler's sampler.
    pub sampler: HeapPlace,
    /// The index of a combined image sampler holds both indices: 20 bits, and 12 bits of the
    /// sampler's (`useCombinedImageSamplerIndex`).
    pub is_packed: bool,
    /// The sampler instead of one in a heap: its number in [`Table::Embedded`].
    pub embedded: Option<u32>,
}

/// The place of a descriptor in a heap: `first` descriptors, plus `stride` descriptors for each
/// number of the resource in the mapping, plus `index_stride_bytes` times an index from memory.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct HeapPlace {
    pub first: u32,
    pub stride: u32,
    pub index_stride_bytes: u32,
    pub index: Option<Word>,
    /// The number of the resource counts words from the index's place on.
    pub is_index_array: bool,
}

/// A place in memory, offsets in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Word {
    Push(u32),
    ShaderRecord(u32),
    /// Behind an address in push data.
    Indirect {
        push: u32,
        offset: u32,
    },
}
