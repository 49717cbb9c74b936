//! Descriptor set layouts, pools, sets and update templates.

use ash::vk;
use ash::vk::Handle;

use crate::VkResult;
use crate::capabilities::limits::{MAX_DESCRIPTORS, MAX_INLINE_UNIFORM_BYTES};
use crate::ffi::{self, array, chain};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, retain};
use crate::object::descriptor::{Binding, PoolState, pool_bytes};
use crate::object::{
    DescriptorPool, DescriptorSet, DescriptorSetLayout, DescriptorUpdateTemplate, PipelineLayout,
    Sampler,
};

pub(crate) unsafe extern "system" fn vkDestroyDescriptorSetLayout(
    _device: vk::Device,
    handle: vk::DescriptorSetLayout,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyDescriptorSetLayout", move || {
        drop(handle::take::<DescriptorSetLayout>(handle))
    })
}

pub(crate) unsafe extern "system" fn vkDestroyDescriptorUpdateTemplate(
    _device: vk::Device,
    handle: vk::DescriptorUpdateTemplate,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyDescriptorUpdateTemplate", move || {
        drop(handle::take::<DescriptorUpdateTemplate>(handle))
    })
}

/// Decodes a set layout's bindings.
///
/// # Safety
/// `info` is valid usage of `vkCreateDescriptorSetLayout`.
unsafe fn bindings(info: &vk::DescriptorSetLayoutCreateInfo<'_>) -> Vec<Binding> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateDescriptorSetLayout`;
    // immutable samplers are alive, and used for sampler types alone.
    unsafe {
        let flags = chain::find::<vk::DescriptorSetLayoutBindingFlagsCreateInfo>(info.p_next)
            .map_or(&[][..], |flags| {
                ffi::slice(flags.p_binding_flags, flags.binding_count)
            });
        let bindings = ffi::slice(info.p_bindings, info.binding_count);
        let mut decoded = Vec::with_capacity(bindings.len());
        for (index, binding) in bindings.iter().enumerate() {
            // Immutable samplers of a mutable descriptor are ignored, since the list has no meaning
            // there.
            let samples = matches!(
                binding.descriptor_type,
                vk::DescriptorType::SAMPLER | vk::DescriptorType::COMBINED_IMAGE_SAMPLER
            );
            let samplers = if samples {
                ffi::slice(binding.p_immutable_samplers, binding.descriptor_count)
            } else {
                &[]
            };
            decoded.push(Binding {
                binding: binding.binding,
                ty: binding.descriptor_type,
                count: binding.descriptor_count,
                flags: flags.get(index).copied().unwrap_or_default(),
                immutable_samplers: samplers
                    .iter()
                    .map(|&sampler| retain::<Sampler>(sampler))
                    .collect(),
                first: 0,
                inline_offset: 0,
            });
        }
        decoded
    }
}

/// Frees one set of a pool.
///
/// # Safety
/// The set is null or a living one of the pool.
unsafe fn free(state: &mut PoolState, set: vk::DescriptorSet) {
    // SAFETY: the caller guarantees that the set is null or a living one of the pool.
    unsafe {
        if state.sets.remove(&set.as_raw())
            && let Some(set) = handle::take::<DescriptorSet>(set)
        {
            state.used_bytes = state.used_bytes.saturating_sub(set.pool_bytes());
        }
    }
}

/// Frees all sets of a pool.
///
/// # Safety
/// The application does not use the sets again.
unsafe fn reset(pool: &DescriptorPool) {
    let mut state = pool.state.lock();
    for set in std::mem::take(&mut state.sets) {
        // SAFETY: the pool's sets are alive until they are taken out of it.
        drop(unsafe { handle::take::<DescriptorSet>(vk::DescriptorSet::from_raw(set)) });
    }
    state.used_bytes = 0;
}

/// Allocates one set.
///
/// # Safety
/// The layout is alive.
unsafe fn allocate(
    pool: &DescriptorPool,
    layout: vk::DescriptorSetLayout,
    variable_count: u32,
) -> VkResult<vk::DescriptorSet> {
    let mut state = pool.state.lock();
    if state.sets.len() >= pool.max_sets as usize {
        return Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY);
    }
    // SAFETY: the caller guarantees that the layout is alive.
    let layout = unsafe { retain::<DescriptorSetLayout>(layout) };
    let set = DescriptorSet::new(layout, variable_count)?;
    let used_bytes = state.used_bytes.saturating_add(set.pool_bytes());
    if used_bytes > pool.room_bytes {
        return Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY);
    }
    state.used_bytes = used_bytes;
    let set = handle::create(set);
    state.sets.insert(set.as_raw());
    Ok(set)
}

pub(crate) unsafe extern "system" fn vkCreateDescriptorSetLayout(
    _device: vk::Device,
    info: *const vk::DescriptorSetLayoutCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::DescriptorSetLayout,
) -> vk::Result {
    guard_result("vkCreateDescriptorSetLayout", move || {
        let info = &*info;
        *out = handle::create(DescriptorSetLayout::new(bindings(info), info.flags)?);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetDescriptorSetLayoutSupport(
    _device: vk::Device,
    info: *const vk::DescriptorSetLayoutCreateInfo,
    out: *mut vk::DescriptorSetLayoutSupport,
) {
    guard("vkGetDescriptorSetLayoutSupport", move || {
        let bindings = bindings(&*info);
        let variable = bindings.iter().find(|binding| binding.is_variable());
        let fixed: u64 = bindings
            .iter()
            .filter(|binding| !binding.is_variable())
            .map(|b| u64::from(b.entry_count()))
            .sum();
        let rest = u64::from(MAX_DESCRIPTORS).saturating_sub(fixed) as u32;
        let most = |binding: &Binding| {
            if binding.is_inline() {
                MAX_INLINE_UNIFORM_BYTES
            } else {
                rest
            }
        };
        if let Some(out) =
            chain::find_mut::<vk::DescriptorSetVariableDescriptorCountLayoutSupport>((*out).p_next)
        {
            out.max_variable_descriptor_count = variable.map_or(0, most);
        }
        let inline = bindings
            .iter()
            .all(|binding| !binding.is_inline() || binding.count <= MAX_INLINE_UNIFORM_BYTES);
        let total: u64 = bindings
            .iter()
            .map(|binding| u64::from(binding.entry_count()))
            .sum();
        (*out).supported = (inline && total <= u64::from(MAX_DESCRIPTORS)).into();
    })
}

pub(crate) unsafe extern "system" fn vkCreateDescriptorPool(
    _device: vk::Device,
    info: *const vk::DescriptorPoolCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::DescriptorPool,
) -> vk::Result {
    guard_result("vkCreateDescriptorPool", move || {
        let info = &*info;
        let sizes = ffi::slice(info.p_pool_sizes, info.pool_size_count).iter();
        let room = sizes.map(|size| pool_bytes(size.ty, size.descriptor_count));
        *out = handle::create(DescriptorPool {
            max_sets: info.max_sets,
            room_bytes: room.fold(0, u64::saturating_add),
            state: parking_lot::Mutex::default(),
        });
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyDescriptorPool(
    _device: vk::Device,
    pool: vk::DescriptorPool,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyDescriptorPool", move || {
        if let Some(pool) = handle::take::<DescriptorPool>(pool) {
            reset(&pool);
        }
    })
}

pub(crate) unsafe extern "system" fn vkResetDescriptorPool(
    _device: vk::Device,
    pool: vk::DescriptorPool,
    _flags: vk::DescriptorPoolResetFlags,
) -> vk::Result {
    guard_result("vkResetDescriptorPool", move || {
        reset(from_handle::<DescriptorPool>(pool));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkAllocateDescriptorSets(
    _device: vk::Device,
    info: *const vk::DescriptorSetAllocateInfo,
    out: *mut vk::DescriptorSet,
) -> vk::Result {
    guard_result("vkAllocateDescriptorSets", move || {
        let info = &*info;
        let pool = from_handle::<DescriptorPool>(info.descriptor_pool);
        let layouts = ffi::slice(info.p_set_layouts, info.descriptor_set_count);
        let out = array::slice_mut(out, info.descriptor_set_count);
        let counts =
            chain::find::<vk::DescriptorSetVariableDescriptorCountAllocateInfo>(info.p_next)
                .map_or(&[][..], |counts| {
                    ffi::slice(counts.p_descriptor_counts, counts.descriptor_set_count)
                });
        for index in 0..layouts.len() {
            match allocate(
                pool,
                layouts[index],
                counts.get(index).copied().unwrap_or(0),
            ) {
                Ok(set) => out[index] = set,
                Err(code) => {
                    let mut state = pool.state.lock();
                    for &set in &out[..index] {
                        free(&mut state, set);
                    }
                    out.fill(vk::DescriptorSet::null());
                    return Err(code);
                }
            }
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkFreeDescriptorSets(
    _device: vk::Device,
    pool: vk::DescriptorPool,
    count: u32,
    sets: *const vk::DescriptorSet,
) -> vk::Result {
    guard_result("vkFreeDescriptorSets", move || {
        let pool = from_handle::<DescriptorPool>(pool);
        let mut state = pool.state.lock();
        for &set in ffi::slice(sets, count) {
            free(&mut state, set);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateDescriptorUpdateTemplate(
    _device: vk::Device,
    info: *const vk::DescriptorUpdateTemplateCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::DescriptorUpdateTemplate,
) -> vk::Result {
    guard_result("vkCreateDescriptorUpdateTemplate", move || {
        let info = &*info;
        let push = info.template_type == vk::DescriptorUpdateTemplateType::PUSH_DESCRIPTORS_KHR;
        *out = handle::create(DescriptorUpdateTemplate {
            entries: ffi::slice(
                info.p_descriptor_update_entries,
                info.descriptor_update_entry_count,
            )
            .to_vec(),
            bind_point: info.pipeline_bind_point,
            set: info.set,
            layout: push.then(|| retain::<PipelineLayout>(info.pipeline_layout)),
        });
        Ok(())
    })
}
