//! Bindings during the replay of a command buffer, and the environment that programs see.

use std::sync::Arc;

use ash::vk;
use spirv_jit::descriptor_heap::Table;
use spirv_jit::environment::{
    Descriptor, DescriptorSet, Environment, InlineBlock, MAX_SETS, StoredDescriptor, uniform,
};
use spirv_jit::reach::Reach;

use super::engine::Engine;
use crate::command::{BindDescriptorBuffer, BindDescriptorSets, BindHeap};
use crate::object::Pipeline;
use crate::object::pipeline_layout::DYNAMIC_OF_SET;
use crate::wave::mask::InvocationMask;

/// `maxPushConstantsSize`.
const PUSH_CONSTANT_BYTES: usize = 256;

/// Bound pipelines and descriptor sets by bind point, and the push constants, which all bind points
/// share.
#[derive(Default)]
pub struct Bindings<'a> {
    compute: BindPoint<'a>,
    ray_tracing: BindPoint<'a>,
    graphics: BindPoint<'a>,
    push_constants: Box<PushConstants>,
    /// The bound descriptor heaps, which all bind points share; none while a set is bound.
    heaps: Option<Box<Heaps>>,
    /// The bindings of draws until the next change, with their epoch.
    snapshot: Option<(u64, Snapshot)>,
    /// `vkCmdBindInvocationMaskHUAWEI`.
    pub invocation_mask: Option<InvocationMask>,
    /// `vkCmdSetRayTracingPipelineStackSizeKHR`.
    pub stack_bytes: Option<u32>,
}

/// The bound heaps.
#[derive(Clone)]
struct Heaps {
    resources: HeapRange,
    samplers: HeapRange,
    embedded: DescriptorSet,
    /// The resource heap as a buffer.
    data: Descriptor,
}

#[derive(Clone, Copy, Default)]
struct HeapRange {
    address: u64,
    size_bytes: u64,
}

impl HeapRange {
    /// The descriptors of a heap, cut to its reachable memory.
    fn entries(&self, reach: &Reach) -> DescriptorSet {
        let size_bytes = size_of::<StoredDescriptor>() as u64;
        // Valid usage aligns the address to the heap's alignment.
        let start = self.address & !(align_of::<StoredDescriptor>() as u64 - 1);
        DescriptorSet {
            entries: start as *const Descriptor,
            count: (reach.clip(start, self.size_bytes) / size_bytes) as u32,
            stored: true,
            ..DescriptorSet::NONE
        }
    }
}

impl Heaps {
    /// The tables of programs that use heaps, which point into `self`.
    fn place(&mut self, sets: &mut [DescriptorSet; MAX_SETS], reach: &Reach) {
        self.data = Descriptor {
            address: self.resources.address,
            size_bytes: reach.clip(self.resources.address, self.resources.size_bytes),
            ..Descriptor::NULL
        };
        sets[Table::Resources as usize] = self.resources.entries(reach);
        sets[Table::Samplers as usize] = self.samplers.entries(reach);
        sets[Table::Embedded as usize] = self.embedded;
        sets[Table::Data as usize] = DescriptorSet {
            entries: &raw const self.data,
            count: 1,
            ..DescriptorSet::NONE
        };
    }
}

/// A copy of the bindings of a draw, since they may change before the draw executes.
#[derive(Clone)]
pub struct Snapshot {
    pub environment: Arc<Environment>,
    /// Owns the data that the environment points to.
    pub keep: Arc<Kept>,
}

/// Copies of the data that an environment points to, except the sets, which the recorded commands
/// hold.
pub struct Kept {
    push_constants: PushConstants,
    dynamic: Vec<Descriptor>,
    blocks: Vec<Vec<InlineBlock>>,
    #[allow(dead_code, reason = "the environment points to it")]
    heaps: Option<Box<Heaps>>,
}

// SAFETY: inline blocks are plain data, as descriptors are.
unsafe impl Send for Kept {}
// SAFETY: as for the impl before.
unsafe impl Sync for Kept {}

/// Aligned like the offsets of uniform buffers. An alignment above the allocator's default would
/// triple the cost of each draw's copy.
#[derive(Clone)]
#[repr(align(16))]
struct PushConstants([u8; PUSH_CONSTANT_BYTES]);

impl Default for PushConstants {
    fn default() -> Self {
        Self([0; PUSH_CONSTANT_BYTES])
    }
}

struct BindPoint<'a> {
    pipeline: Option<&'a Pipeline>,
    sets: [DescriptorSet; MAX_SETS],
    /// Sets in descriptor buffers, which take precedence over the others.
    stored: [Option<&'a BindDescriptorBuffer>; MAX_SETS],
    /// The inline uniform blocks of the sets in descriptor buffers.
    blocks: [Vec<InlineBlock>; MAX_SETS],
    /// The dynamic buffers of each set, with offsets applied.
    dynamic_of_set: Vec<Vec<Descriptor>>,
    /// The dynamic buffers of all sets, in the order of the bound pipeline's layout.
    dynamic: Vec<Descriptor>,
}

impl Default for BindPoint<'_> {
    fn default() -> Self {
        Self {
            pipeline: None,
            sets: [DescriptorSet::NONE; MAX_SETS],
            stored: [None; MAX_SETS],
            blocks: std::array::from_fn(|_| Vec::new()),
            dynamic_of_set: Vec::new(),
            dynamic: Vec::new(),
        }
    }
}

impl<'a> Bindings<'a> {
    fn bind_point(&mut self, bind_point: vk::PipelineBindPoint) -> &mut BindPoint<'a> {
        match bind_point {
            vk::PipelineBindPoint::RAY_TRACING_KHR => &mut self.ray_tracing,
            vk::PipelineBindPoint::GRAPHICS => {
                self.snapshot = None;
                &mut self.graphics
            }
            _ => &mut self.compute,
        }
    }

    /// `vkCmdBindPipeline`. The snapshot of a draw's bindings does not depend on it.
    pub fn bind_pipeline(&mut self, pipeline: &'a Pipeline) {
        let bound = match pipeline.bind_point() {
            vk::PipelineBindPoint::RAY_TRACING_KHR => &mut self.ray_tracing,
            vk::PipelineBindPoint::GRAPHICS => &mut self.graphics,
            _ => &mut self.compute,
        };
        bound.pipeline = Some(pipeline);
    }

    /// `vkCmdBindDescriptorSets`, and pushed descriptors.
    pub fn bind_descriptor_sets(&mut self, bind: &'a BindDescriptorSets) {
        self.heaps = None;
        self.bind_point(bind.bind_point).bind(bind);
    }

    /// One set of `vkCmdSetDescriptorBufferOffsetsEXT`.
    pub fn bind_descriptor_buffer(&mut self, bind: &'a BindDescriptorBuffer) {
        self.heaps = None;
        let bound = self.bind_point(bind.bind_point);
        let number = bind.set as usize;
        if number < MAX_SETS {
            bound.stored[number] = Some(bind);
            // Removes the dynamic buffers of the set that was bound here before.
            if let Some(dynamic) = bound.dynamic_of_set.get_mut(number) {
                dynamic.clear();
            }
        }
    }

    /// Binds a heap, and unbinds all sets. `embedded` are the samplers that programs embed.
    pub fn bind_heap(&mut self, bind: &BindHeap, embedded: DescriptorSet) {
        self.snapshot = None;
        let heaps = self.heaps.get_or_insert_with(|| {
            Box::new(Heaps {
                resources: HeapRange::default(),
                samplers: HeapRange::default(),
                embedded,
                data: Descriptor::NULL,
            })
        });
        let range = match bind.table {
            Table::Samplers => &mut heaps.samplers,
            _ => &mut heaps.resources,
        };
        *range = HeapRange {
            address: bind.address,
            size_bytes: bind.size_bytes,
        };
    }

    /// `vkCmdPushConstants` and `vkCmdPushDataEXT`.
    pub fn push_constants(&mut self, offset: u32, bytes: &[u8]) {
        self.snapshot = None;
        let start = (offset as usize).min(PUSH_CONSTANT_BYTES);
        let room = &mut self.push_constants.0[start..];
        let count = bytes.len().min(room.len());
        room[..count].copy_from_slice(&bytes[..count]);
    }

    /// The bound pipeline and the environment of its programs; `None` if nothing is bound. `extent`
    /// is the number of workgroups, or the size of the launch. The environment points into these
    /// bindings and must be used before they change.
    pub fn environment(
        &mut self,
        bind_point: vk::PipelineBindPoint,
        extent: [u32; 3],
        engine: &Engine,
    ) -> Option<(&'a Pipeline, Environment)> {
        let push_constants = Descriptor {
            address: self.push_constants.0.as_ptr() as u64,
            size_bytes: PUSH_CONSTANT_BYTES as u64,
            ..Descriptor::NULL
        };
        let first_uniform = match bind_point {
            vk::PipelineBindPoint::RAY_TRACING_KHR => uniform::LAUNCH_SIZE,
            _ => uniform::NUM_WORKGROUPS,
        } as usize;
        let bound = self.bind_point(bind_point);
        let pipeline = bound.pipeline?;
        let reach = engine.memory.reach();
        bound.place_dynamic();
        bound.place_stored(&reach);
        let mut sets = bound.sets;
        let (dynamic, dynamic_count) = (bound.dynamic.as_ptr(), bound.dynamic.len() as u32);
        if let Some(heaps) = &mut self.heaps {
            heaps.place(&mut sets, &reach);
        }
        let mut uniforms = [0; uniform::COUNT];
        uniforms[first_uniform..first_uniform + 3].copy_from_slice(&extent);
        let environment = Environment {
            sets,
            dynamic,
            dynamic_count,
            push_constants,
            uniforms,
            ..engine.environment()
        };
        Some((pipeline, environment))
    }

    /// A copy of the bindings for the next draw. A new epoch gets a new environment number, because
    /// memory may have changed and data cached by that number must be computed again.
    pub fn snapshot(&mut self, epoch: u64, engine: &Engine) -> Snapshot {
        if let Some((seen, snapshot)) = &self.snapshot
            && *seen == epoch
        {
            return snapshot.clone();
        }
        let reach = engine.memory.reach();
        let bound = &mut self.graphics;
        bound.place_dynamic();
        bound.place_stored(&reach);
        let stored = bound.stored.iter().any(Option::is_some);
        let mut sets = bound.sets;
        let mut heaps = self.heaps.clone();
        if let Some(heaps) = &mut heaps {
            heaps.place(&mut sets, &reach);
        }
        let keep = Arc::new(Kept {
            heaps,
            push_constants: (*self.push_constants).clone(),
            dynamic: bound.dynamic.clone(),
            blocks: if stored {
                bound.blocks.to_vec()
            } else {
                Vec::new()
            },
        });
        for (set, blocks) in sets.iter_mut().zip(&keep.blocks) {
            set.blocks = blocks.as_ptr();
        }
        let environment = Environment {
            sets,
            dynamic: keep.dynamic.as_ptr(),
            dynamic_count: keep.dynamic.len() as u32,
            push_constants: Descriptor {
                address: keep.push_constants.0.as_ptr() as u64,
                size_bytes: PUSH_CONSTANT_BYTES as u64,
                ..Descriptor::NULL
            },
            ..engine.environment()
        };
        let environment = Arc::new(environment);
        let snapshot = Snapshot { environment, keep };
        self.snapshot = Some((epoch, snapshot.clone()));
        snapshot
    }
}

impl BindPoint<'_> {
    fn bind(&mut self, bind: &BindDescriptorSets) {
        let mut offsets = bind.dynamic_offsets.iter();
        for (index, set) in bind.sets.iter().enumerate() {
            let number = bind.first_set as usize + index;
            let (Some(set), true) = (set, number < MAX_SETS) else {
                continue;
            };
            self.sets[number] = DescriptorSet {
                entries: set.entries(),
                count: set.entry_count,
                ..DescriptorSet::NONE
            };
            self.stored[number] = None;
            if self.dynamic_of_set.len() <= number {
                self.dynamic_of_set.resize_with(number + 1, Vec::new);
            }
            let dynamic = &mut self.dynamic_of_set[number];
            dynamic.clear();
            for entry in 0..set.layout.dynamic_count as usize {
                // SAFETY: the set has as many dynamic entries as its layout says, and the
                // application does not update it while it is in use.
                let buffer = unsafe { *set.dynamic().add(entry) };
                let offset = offsets.next().copied().unwrap_or(0);
                dynamic.push(buffer.at(offset));
            }
        }
    }

    /// Finds the sets in descriptor buffers. Sets outside of reachable memory are left out.
    fn place_stored(&mut self, reach: &Reach) {
        for (number, bind) in self.stored.iter().enumerate() {
            let Some(bind) = bind else {
                continue;
            };
            let place = bind.layout.buffer_layout();
            // Valid usage aligns the address to `descriptorBufferOffsetAlignment`.
            let start = bind.address & !(align_of::<StoredDescriptor>() as u64 - 1);
            let entries = start.wrapping_add(place.entries_offset_bytes);
            let size_bytes = size_of::<StoredDescriptor>() as u64;
            let whole = size_bytes * u64::from(bind.layout.entry_count);
            let blocks = &mut self.blocks[number];
            blocks.clear();
            for binding in bind.layout.bindings.iter().filter(|b| b.is_inline()) {
                let address = start.wrapping_add(place.offset_of(binding));
                blocks.push(InlineBlock {
                    entry: binding.first,
                    descriptor: Descriptor {
                        address,
                        size_bytes: reach.clip(address, u64::from(binding.count)),
                        ..Descriptor::NULL
                    },
                });
            }
            self.sets[number] = DescriptorSet {
                entries: entries as *const Descriptor,
                count: (reach.clip(entries, whole) / size_bytes) as u32,
                stored: true,
                blocks: blocks.as_ptr(),
                block_count: blocks.len() as u32,
            };
        }
    }

    /// Orders the dynamic buffers of the sets as pipeline layouts number them.
    fn place_dynamic(&mut self) {
        self.dynamic.clear();
        for (number, dynamic) in self.dynamic_of_set.iter().enumerate() {
            if dynamic.is_empty() {
                continue;
            }
            self.dynamic
                .resize(number * DYNAMIC_OF_SET as usize, Descriptor::NULL);
            self.dynamic.extend_from_slice(dynamic);
        }
    }
}
