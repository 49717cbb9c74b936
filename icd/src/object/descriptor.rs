//! Descriptor set layouts, pools and sets.
//!
//! A set is two flat arrays: the plain entries, in the form that shader accesses use, and the
//! dynamic buffers, whose offsets are applied at binding. Both are plain data: an update is a
//! store.

use std::collections::HashSet;

use ash::vk;
use parking_lot::Mutex;
use spirv_jit::environment::Descriptor;

use super::Sampler;
use crate::VkResult;
use crate::handle::Ref;

/// A binding of a set layout.
pub struct Binding {
    pub binding: u32,
    pub ty: vk::DescriptorType,
    /// Number of descriptors, or bytes of an inline uniform block.
    pub count: u32,
    pub flags: vk::DescriptorBindingFlags,
    pub immutable_samplers: Vec<Ref<Sampler>>,
    /// First entry in the set's plain array, or in its dynamic array.
    pub first: u32,
    /// Inline uniform blocks: first byte in the set's inline data.
    pub inline_offset: u32,
}

impl Binding {
    pub fn is_dynamic(&self) -> bool {
        matches!(
            self.ty,
            vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC | vk::DescriptorType::STORAGE_BUFFER_DYNAMIC
        )
    }

    pub fn is_inline(&self) -> bool {
        self.ty == vk::DescriptorType::INLINE_UNIFORM_BLOCK
    }

    pub fn is_variable(&self) -> bool {
        self.flags
            .contains(vk::DescriptorBindingFlags::VARIABLE_DESCRIPTOR_COUNT)
    }

    /// Number of entries in the set; an inline uniform block is one.
    pub fn entry_count(&self) -> u32 {
        if self.is_inline() { 1 } else { self.count }
    }
}

/// A descriptor set layout.
pub struct DescriptorSetLayout {
    /// The bindings by number.
    pub bindings: Vec<Binding>,
    /// Number of entries in the plain and the dynamic array, with the variable-count binding at its
    /// largest.
    pub entry_count: u32,
    pub dynamic_count: u32,
    pub inline_bytes: u32,
    pub flags: vk::DescriptorSetLayoutCreateFlags,
}

impl DescriptorSetLayout {
    /// Lays bindings out.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` if they are 2³² entries or more.
    pub fn new(
        mut bindings: Vec<Binding>,
        flags: vk::DescriptorSetLayoutCreateFlags,
    ) -> VkResult<Self> {
        bindings.sort_by_key(|binding| binding.binding);
        let (mut entry_count, mut dynamic_count, mut inline_bytes) = (0u32, 0u32, 0u32);
        for binding in &mut bindings {
            let counter = if binding.is_dynamic() {
                &mut dynamic_count
            } else {
                &mut entry_count
            };
            binding.first = *counter;
            binding.inline_offset = inline_bytes;
            let too_many = vk::Result::ERROR_OUT_OF_HOST_MEMORY;
            *counter = counter.checked_add(binding.entry_count()).ok_or(too_many)?;
            if binding.is_inline() {
                inline_bytes = inline_bytes
                    .checked_add(binding.count)
                    .and_then(|sum| sum.checked_next_multiple_of(16))
                    .ok_or(too_many)?;
            }
        }
        // Together they have indices of 32 bits, too.
        let all = entry_count.checked_add(dynamic_count);
        all.ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        Ok(Self {
            bindings,
            entry_count,
            dynamic_count,
            inline_bytes,
            flags,
        })
    }

    /// Offsets for a set in a descriptor buffer.
    pub fn buffer_layout(&self) -> BufferLayout {
        let entries_bytes = u64::from(self.entry_count) * size_of::<Descriptor>() as u64;
        let inline_bytes =
            u64::from(self.inline_bytes).next_multiple_of(size_of::<Descriptor>() as u64);
        let inline_is_last = self
            .bindings
            .iter()
            .any(|binding| binding.is_variable() && binding.is_inline());
        BufferLayout {
            entries_offset_bytes: if inline_is_last { 0 } else { inline_bytes },
            inline_offset_bytes: if inline_is_last { entries_bytes } else { 0 },
            size_bytes: entries_bytes + inline_bytes,
        }
    }

    /// A binding by its number.
    pub fn binding(&self, binding: u32) -> Option<&Binding> {
        let index = self
            .bindings
            .binary_search_by_key(&binding, |b| b.binding)
            .ok()?;
        Some(&self.bindings[index])
    }
}

/// The layout of a set in a descriptor buffer: the plain entries and the bytes of inline uniform
/// blocks. The part with the variable-count binding is last.
#[derive(Clone, Copy, Debug)]
pub struct BufferLayout {
    pub entries_offset_bytes: u64,
    pub inline_offset_bytes: u64,
    pub size_bytes: u64,
}

impl BufferLayout {
    /// Offset of a binding's descriptors, or of an inline uniform block's bytes.
    pub fn offset_of(&self, binding: &Binding) -> u64 {
        if binding.is_inline() {
            self.inline_offset_bytes + u64::from(binding.inline_offset)
        } else {
            self.entries_offset_bytes + u64::from(binding.first) * size_of::<Descriptor>() as u64
        }
    }
}

/// A dynamic buffer in a set, before its offset is known. The default is the null descriptor.
#[derive(Clone, Copy, Debug, Default)]
pub struct DynamicBuffer {
    pub address: u64,
    /// `VK_WHOLE_SIZE`: to the end of the buffer.
    pub range: u64,
    /// Bytes from the address to the end of the buffer, which bound every offset.
    pub rest: u64,
}

impl DynamicBuffer {
    /// The descriptor that programs read: the null descriptor without a buffer, or past its end.
    pub fn at(&self, offset: u32) -> Descriptor {
        let offset = u64::from(offset);
        let size_bytes = self.range.min(self.rest.saturating_sub(offset));
        if size_bytes == 0 {
            return Descriptor::NULL;
        }
        Descriptor {
            address: self.address + offset,
            size_bytes,
            ..Descriptor::NULL
        }
    }
}

/// An entry of a set, to read or write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    Plain(*mut Descriptor),
    Dynamic(*mut DynamicBuffer),
}

/// A descriptor set.
pub struct DescriptorSet {
    pub layout: Ref<DescriptorSetLayout>,
    /// Number of entries in the plain array: fewer than the layout's with a smaller variable count.
    pub entry_count: u32,
    /// Number of descriptors, or bytes, in the variable-count binding.
    pub variable_count: u32,
    storage: Storage,
}

/// The set's memory. Updates may come from several threads while others read, to different entries:
/// all access is by pointer.
struct Storage {
    entries: *mut Descriptor,
    len: usize,
    dynamic: *mut DynamicBuffer,
    dynamic_len: usize,
    inline: *mut u8,
    inline_len: usize,
}

// SAFETY: descriptors are plain data; the application orders updates and uses (chapter Resource
// Descriptors).
unsafe impl Send for Storage {}
// SAFETY: as for `Send`.
unsafe impl Sync for Storage {}

impl Drop for Storage {
    fn drop(&mut self) {
        // SAFETY: `DescriptorSet::new` made the pointers from boxes of these lengths.
        unsafe {
            drop(Box::from_raw(std::ptr::slice_from_raw_parts_mut(
                self.entries,
                self.len,
            )));
            drop(Box::from_raw(std::ptr::slice_from_raw_parts_mut(
                self.dynamic,
                self.dynamic_len,
            )));
            drop(Box::from_raw(std::ptr::slice_from_raw_parts_mut(
                self.inline.cast::<Inline>(),
                self.inline_len,
            )));
        }
    }
}

/// Inline uniform data, aligned for any scalar.
#[derive(Clone, Copy)]
#[repr(align(16))]
struct Inline(#[allow(dead_code)] [u8; 16]);

fn fallible_box<T: Copy>(value: T, len: usize) -> VkResult<*mut T> {
    let mut items = Vec::new();
    items
        .try_reserve_exact(len)
        .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
    items.resize(len, value);
    Ok(Box::into_raw(items.into_boxed_slice()).cast())
}

impl DescriptorSet {
    /// A set of null descriptors and of its layout's immutable samplers.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn new(layout: Ref<DescriptorSetLayout>, variable_count: u32) -> VkResult<Self> {
        let cut = match layout.bindings.last() {
            Some(last) if last.is_variable() && !last.is_inline() => {
                last.count - variable_count.min(last.count)
            }
            _ => 0,
        };
        let entry_count = layout.entry_count - cut;
        let (len, dynamic_len) = (entry_count as usize, layout.dynamic_count as usize);
        let inline_len = layout.inline_bytes as usize / 16;
        let storage = Storage {
            entries: fallible_box(Descriptor::NULL, len)?,
            len,
            dynamic: fallible_box(DynamicBuffer::default(), dynamic_len)?,
            dynamic_len,
            inline: fallible_box(Inline([0; 16]), inline_len)?.cast(),
            inline_len,
        };
        let set = Self {
            layout,
            entry_count,
            variable_count,
            storage,
        };
        set.write_fixed();
        Ok(set)
    }

    /// Writes the constant entries: immutable samplers, and the addresses of inline uniform blocks.
    fn write_fixed(&self) {
        for binding in &self.layout.bindings {
            for (index, sampler) in binding.immutable_samplers.iter().enumerate() {
                if let Some(Entry::Plain(entry)) = self.entry(binding, index as u32) {
                    // SAFETY: the index is one of this new set, which no other thread has yet.
                    unsafe { (*entry).sampler = sampler.descriptor.as_ptr() };
                }
            }
            if binding.is_inline()
                && let Some(Entry::Plain(entry)) = self.entry(binding, 0)
            {
                // SAFETY: as for the sampler; the offset is inside the inline data.
                unsafe {
                    (*entry).address =
                        self.storage.inline.add(binding.inline_offset as usize) as u64;
                    (*entry).size_bytes = u64::from(binding.count);
                }
            }
        }
    }

    /// The plain entries, for shaders.
    pub fn entries(&self) -> *const Descriptor {
        self.storage.entries
    }

    /// The dynamic buffers, without offsets.
    pub fn dynamic(&self) -> *const DynamicBuffer {
        self.storage.dynamic
    }

    /// An entry of a binding; `None` past the end.
    pub fn entry(&self, binding: &Binding, index: u32) -> Option<Entry> {
        if index >= binding.entry_count() {
            return None;
        }
        let index = binding.first.checked_add(index)?;
        if binding.is_dynamic() {
            return Some(Entry::Dynamic(
                self.storage.dynamic.wrapping_add(index as usize),
            ));
        }
        (index < self.entry_count)
            .then(|| Entry::Plain(self.storage.entries.wrapping_add(index as usize)))
    }

    /// A copy with its own memory.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn duplicate(&self) -> VkResult<Self> {
        let copy = Self::new(Ref::clone(&self.layout), self.variable_count)?;
        // SAFETY: both have the same lengths.
        unsafe {
            copy.storage
                .entries
                .copy_from_nonoverlapping(self.storage.entries, self.storage.len);
            copy.storage
                .dynamic
                .copy_from_nonoverlapping(self.storage.dynamic, self.storage.dynamic_len);
            copy.storage
                .inline
                .copy_from_nonoverlapping(self.storage.inline, self.storage.inline_len * 16);
        }
        copy.write_fixed();
        Ok(copy)
    }

    /// The bytes of an inline uniform block at `offset`; `None` if they are not inside.
    pub fn inline_bytes(&self, binding: &Binding, offset: u32, count: u32) -> Option<*mut u8> {
        let end = offset.checked_add(count)?;
        (binding.is_inline() && end <= binding.count).then(|| {
            self.storage
                .inline
                .wrapping_add((binding.inline_offset + offset) as usize)
        })
    }
}

/// A descriptor pool. It counts descriptors, and destroys its sets with itself. Its space serves
/// descriptors of any type, since applications allocate types that they have not declared.
pub struct DescriptorPool {
    pub max_sets: u32,
    /// Space for descriptors of all types and for inline uniform blocks.
    pub room_bytes: u64,
    pub state: Mutex<PoolState>,
}

/// The parts of a pool that are in use.
#[derive(Default)]
pub struct PoolState {
    /// Handles of the living sets.
    pub sets: HashSet<u64>,
    pub used_bytes: u64,
}

/// Pool space that descriptors take; bytes for inline uniform blocks.
pub fn pool_bytes(ty: vk::DescriptorType, count: u32) -> u64 {
    match ty {
        vk::DescriptorType::INLINE_UNIFORM_BLOCK => u64::from(count),
        _ => u64::from(count) * size_of::<Descriptor>() as u64,
    }
}

impl DescriptorSet {
    /// Pool space that the set takes.
    pub fn pool_bytes(&self) -> u64 {
        let bytes = |binding: &Binding| match binding.is_variable() {
            true => pool_bytes(binding.ty, self.variable_count),
            false => pool_bytes(binding.ty, binding.count),
        };
        self.layout
            .bindings
            .iter()
            .map(bytes)
            .fold(0, u64::saturating_add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn binding(binding: u32, ty: vk::DescriptorType, count: u32) -> Binding {
        Binding {
            binding,
            ty,
            count,
            flags: vk::DescriptorBindingFlags::empty(),
            immutable_samplers: Vec::new(),
            first: 0,
            inline_offset: 0,
        }
    }

    #[test]
    fn dynamic_and_plain_entries_are_apart() {
        let layout = DescriptorSetLayout::new(
            vec![
                binding(5, vk::DescriptorType::STORAGE_BUFFER, 3),
                binding(1, vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC, 2),
                binding(2, vk::DescriptorType::STORAGE_IMAGE, 4),
                binding(3, vk::DescriptorType::INLINE_UNIFORM_BLOCK, 20),
            ],
            vk::DescriptorSetLayoutCreateFlags::empty(),
        )
        .ok()
        .unwrap();
        assert_eq!(
            (
                layout.entry_count,
                layout.dynamic_count,
                layout.inline_bytes
            ),
            (8, 2, 32)
        );
        assert_eq!(layout.binding(5).unwrap().first, 5);
        assert_eq!(layout.binding(1).unwrap().first, 0);
        let set = DescriptorSet::new(crate::handle::new(layout), 0)
            .ok()
            .unwrap();
        let last = set.layout.binding(5).unwrap();
        assert_eq!(
            set.entry(last, 2),
            Some(Entry::Plain(set.entries().wrapping_add(7).cast_mut()))
        );
        assert!(set.entry(last, 3).is_none());
        let dynamic = set.layout.binding(1).unwrap();
        assert_eq!(
            set.entry(dynamic, 1),
            Some(Entry::Dynamic(set.dynamic().wrapping_add(1).cast_mut()))
        );
        let inline = set.layout.binding(3).unwrap();
        assert!(set.inline_bytes(inline, 16, 4).is_some());
        assert!(set.inline_bytes(inline, 16, 8).is_none());
    }

    #[test]
    fn dynamic_offsets_lead_no_further_than_the_buffer() {
        let found = |range, rest, offset| {
            let buffer = DynamicBuffer {
                address: 0x1000,
                range,
                rest,
            };
            let found = buffer.at(offset);
            assert!(found.image.is_null() && found.sampler.is_null());
            (found.address, found.size_bytes)
        };
        assert_eq!(found(64, 256, 0), (0x1000, 64));
        assert_eq!(found(64, 256, 192), (0x10C0, 64));
        assert_eq!(found(64, 256, 224), (0x10E0, 32));
        assert_eq!(found(64, 256, 256), (0, 0));
        assert_eq!(found(64, 256, u32::MAX), (0, 0));
        assert_eq!(found(vk::WHOLE_SIZE, 256, 16), (0x1010, 240));
        assert_eq!(found(vk::WHOLE_SIZE, 256, 1 << 31), (0, 0));
        let null = DynamicBuffer::default().at(u32::MAX);
        assert_eq!((null.address, null.size_bytes), (0, 0));
    }
}
