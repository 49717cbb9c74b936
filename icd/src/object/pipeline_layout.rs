//! Pipeline layouts: the locations of shaders' descriptors.

#![forbid(unsafe_code)]

use spirv_jit::ir::op::DescriptorBinding;

use super::DescriptorSetLayout;
use crate::capabilities::limits::MAX_DYNAMIC_BUFFERS;
use crate::handle::Ref;

/// Number range of a set's dynamic buffers: those of set n begin at n times this. So a program's
/// numbers depend only on the layouts of the sets that it uses (pipeline libraries, shader
/// objects). Twice the limit, for uniform and storage buffers.
pub const DYNAMIC_OF_SET: u32 = 2 * MAX_DYNAMIC_BUFFERS;

/// A pipeline layout.
pub struct PipelineLayout {
    /// Set layouts by set number; `None` for `VK_NULL_HANDLE`.
    pub sets: Vec<Option<Ref<DescriptorSetLayout>>>,
    pub push_constant_bytes: u32,
}

impl PipelineLayout {
    pub fn new(sets: Vec<Option<Ref<DescriptorSetLayout>>>, push_constant_bytes: u32) -> Self {
        Self {
            sets,
            push_constant_bytes,
        }
    }

    /// The location of the descriptors of (`set`, `binding`).
    pub fn descriptor_binding(&self, set: u32, binding: u32) -> Option<DescriptorBinding> {
        let layout = self.sets.get(set as usize)?.as_ref()?;
        let binding = layout.binding(binding)?;
        let dynamic = binding.is_dynamic();
        let base = if dynamic { set * DYNAMIC_OF_SET } else { 0 };
        Some(DescriptorBinding {
            set,
            first: base + binding.first,
            count: if binding.is_variable() {
                u32::MAX
            } else {
                binding.entry_count()
            },
            dynamic,
        })
    }
}
