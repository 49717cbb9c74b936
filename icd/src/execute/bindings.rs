//! What is bound while commands are replayed, and the environment that programs see of it.

use ash::vk;
use spirv_jit::environment::{self, Descriptor, Environment, MAX_SETS};

use crate::handle::Ref;
use crate::object::{DescriptorSet, Pipeline, PipelineLayout};
use crate::table::limits::MAX_PUSH_CONSTANTS_BYTES;

/// In a dynamic buffer's stored size: the range reaches to the end of the buffer, so it shrinks by the dynamic offset.
pub const SHRINKS_WITH_OFFSET: u64 = 1 << 63;

/// What is bound to a pipeline bind point.
pub struct BindPoint<'a> {
    pub pipeline: Option<&'a Pipeline>,
    sets: [Option<&'a DescriptorSet>; MAX_SETS],
    /// Dynamic buffers of all sets with their offsets applied.
    dynamic: Vec<Descriptor>,
}

impl Default for BindPoint<'_> {
    fn default() -> Self {
        Self {
            pipeline: None,
            sets: [None; MAX_SETS],
            dynamic: Vec::new(),
        }
    }
}

impl<'a> BindPoint<'a> {
    /// Binds sets from `first_set` on; dynamic offsets are taken in the order of sets, bindings and elements.
    pub fn bind_sets(
        &mut self,
        layout: &PipelineLayout,
        first_set: u32,
        sets: &'a [Option<Ref<DescriptorSet>>],
        dynamic_offsets: &[u32],
    ) {
        let mut offsets = dynamic_offsets.iter().copied();
        self.dynamic.resize(
            self.dynamic.len().max(layout.dynamic_count as usize),
            Descriptor::NULL,
        );
        for (index, set) in (first_set as usize..).zip(sets) {
            let (Some(slot), Some(&first)) =
                (self.sets.get_mut(index), layout.dynamic_first.get(index))
            else {
                return;
            };
            *slot = set.as_ref().map(|set| &***set);
            let Some(set) = set else { continue };
            for dynamic in 0..set.layout.dynamic_count as usize {
                // SAFETY: the set has that many dynamic entries; they are not written while bound (no update after bind for them).
                let mut descriptor = unsafe { *set.dynamic().add(dynamic) };
                apply_offset(&mut descriptor, u64::from(offsets.next().unwrap_or(0)));
                if let Some(slot) = self.dynamic.get_mut(first as usize + dynamic) {
                    *slot = descriptor;
                }
            }
        }
    }
}

fn apply_offset(descriptor: &mut Descriptor, offset: u64) {
    if descriptor.address == 0 {
        return;
    }
    descriptor.address = descriptor.address.wrapping_add(offset);
    if descriptor.size_bytes & SHRINKS_WITH_OFFSET != 0 {
        descriptor.size_bytes =
            (descriptor.size_bytes & !SHRINKS_WITH_OFFSET).saturating_sub(offset);
    }
}

/// All that is bound.
pub struct Bindings<'a> {
    pub compute: BindPoint<'a>,
    pub ray_tracing: BindPoint<'a>,
    pub push_constants: Box<[u8; MAX_PUSH_CONSTANTS_BYTES as usize]>,
}

impl Default for Bindings<'_> {
    fn default() -> Self {
        Self {
            compute: BindPoint::default(),
            ray_tracing: BindPoint::default(),
            push_constants: Box::new([0; MAX_PUSH_CONSTANTS_BYTES as usize]),
        }
    }
}

impl<'a> Bindings<'a> {
    /// A bind point by its name; graphics pipelines do not exist.
    pub fn bind_point(&mut self, bind_point: vk::PipelineBindPoint) -> &mut BindPoint<'a> {
        if bind_point == vk::PipelineBindPoint::RAY_TRACING_KHR {
            &mut self.ray_tracing
        } else {
            &mut self.compute
        }
    }

    /// What a program that runs now sees. It points into `self`, which stays as it is while the program runs.
    pub fn environment(&self, bind_point: vk::PipelineBindPoint) -> Environment {
        let bound = if bind_point == vk::PipelineBindPoint::RAY_TRACING_KHR {
            &self.ray_tracing
        } else {
            &self.compute
        };
        let sets = bound.sets.map(|set| match set {
            Some(set) => environment::DescriptorSet {
                entries: set.entries(),
                count: set.entry_count,
            },
            None => environment::DescriptorSet {
                entries: std::ptr::null(),
                count: 0,
            },
        });
        Environment {
            sets,
            dynamic: bound.dynamic.as_ptr(),
            dynamic_count: bound.dynamic.len() as u32,
            push_constants: Descriptor {
                address: self.push_constants.as_ptr() as u64,
                size_bytes: self.push_constants.len() as u64,
                ..Descriptor::NULL
            },
            uniforms: [0; environment::uniform::COUNT],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_size_ranges_end_with_their_buffer() {
        let mut fixed = Descriptor {
            address: 1000,
            size_bytes: 64,
            ..Descriptor::NULL
        };
        let mut whole = Descriptor {
            size_bytes: 64 | SHRINKS_WITH_OFFSET,
            ..fixed
        };
        apply_offset(&mut fixed, 16);
        apply_offset(&mut whole, 16);
        assert_eq!((fixed.address, fixed.size_bytes), (1016, 64));
        assert_eq!((whole.address, whole.size_bytes), (1016, 48));
        let mut null = Descriptor::NULL;
        apply_offset(&mut null, 16);
        assert_eq!(null.address, 0);
    }
}
