//! Descriptors that change their type.

use tuff_tests::*;

const TYPES: [vk::DescriptorType; 4] = [
    vk::DescriptorType::STORAGE_BUFFER,
    vk::DescriptorType::UNIFORM_BUFFER,
    vk::DescriptorType::STORAGE_TEXEL_BUFFER,
    vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
];

/// A layout of one binding of `count` mutable descriptors, and `sets` sets of it.
fn mutable_sets(
    gpu: &Gpu,
    count: u32,
    sets: u32,
) -> (
    vk::DescriptorSetLayout,
    vk::DescriptorPool,
    Vec<vk::DescriptorSet>,
) {
    let mutable = vk::DescriptorType::MUTABLE_EXT;
    let bindings = [vk::DescriptorSetLayoutBinding::default()
        .descriptor_type(mutable)
        .descriptor_count(count)
        .stage_flags(vk::ShaderStageFlags::ALL)];
    let lists = [vk::MutableDescriptorTypeListEXT::default().descriptor_types(&TYPES)];
    let mut for_layout =
        vk::MutableDescriptorTypeCreateInfoEXT::default().mutable_descriptor_type_lists(&lists);
    let mut for_pool = for_layout;
    let flags = [vk::DescriptorBindingFlags::PARTIALLY_BOUND];
    let mut flags = vk::DescriptorSetLayoutBindingFlagsCreateInfo::default().binding_flags(&flags);
    let layout = vk::DescriptorSetLayoutCreateInfo::default()
        .bindings(&bindings)
        .push_next(&mut flags)
        .push_next(&mut for_layout);
    let sizes = [vk::DescriptorPoolSize {
        ty: mutable,
        descriptor_count: count * sets,
    }];
    let pool = vk::DescriptorPoolCreateInfo::default()
        .max_sets(sets)
        .pool_sizes(&sizes)
        .push_next(&mut for_pool);
    // SAFETY: the structures outlive the calls.
    unsafe {
        let mut support = vk::DescriptorSetLayoutSupport::default();
        gpu.device
            .get_descriptor_set_layout_support(&layout, &mut support);
        assert_eq!(support.supported, vk::TRUE);
        let layout = gpu.device.create_descriptor_set_layout(&layout, None);
        let layout = layout.expect("vkCreateDescriptorSetLayout");
        let pool = gpu.device.create_descriptor_pool(&pool, None);
        let pool = pool.expect("vkCreateDescriptorPool");
        let layouts = vec![layout; sets as usize];
        let info = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(pool)
            .set_layouts(&layouts);
        let sets = gpu.device.allocate_descriptor_sets(&info);
        (layout, pool, sets.expect("vkAllocateDescriptorSets"))
    }
}

#[test]
fn a_descriptor_is_what_was_written_last() {
    let gpu = Gpu::new();
    let partially = gpu.features12.descriptor_binding_partially_bound;
    let there = gpu.optional.mutable.mutable_descriptor_type * partially == vk::TRUE;
    if !has("VK_EXT_mutable_descriptor_type", there) {
        return;
    }
    let (layout, pool, sets) = mutable_sets(&gpu, 4, 2);
    let results = gpu.buffer(64);
    let numbers = gpu.buffer_with(&[11u32, 12, 13, 14]);
    let others = gpu.buffer_with(&[21u32, 22, 23, 24]);
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0, std430) buffer Storage { uint words[]; } storage[4];
    layout(set = 0, binding = 0, std140) uniform Uniform { uvec4 words; } uniforms[4];
    layout(push_constant) uniform Push { uint which; uint at; };
    void main() {
        storage[0].words[at] = which == 0 ? storage[1].words[1]
            : which == 1 ? uniforms[1].words.z : storage[2].words[3];
    }";
    let kernel = gpu.kernel(source, &[layout]);
    let run = |set: vk::DescriptorSet, which: u32, at: u32| {
        let set = Set {
            layout,
            handle: set,
        };
        gpu.dispatch(kernel, &[set], &[which, at], [1, 1, 1]);
    };
    // A buffer that is a storage buffer first, then another one that is a uniform buffer, then
    // copied with its type.
    gpu.write(sets[0], 0, 0, &Bound::Storage(results));
    gpu.write(sets[0], 0, 1, &Bound::Storage(numbers));
    run(sets[0], 0, 0);
    gpu.write(sets[0], 0, 1, &Bound::Uniform(others));
    gpu.write(sets[0], 0, 2, &Bound::Storage(numbers));
    run(sets[0], 1, 1);
    let copy = vk::CopyDescriptorSet::default()
        .src_set(sets[0])
        .dst_set(sets[1])
        .descriptor_count(3);
    // SAFETY: the sets are of this device and not in use.
    unsafe { gpu.device.update_descriptor_sets(&[], &[copy]) };
    run(sets[1], 1, 2);
    run(sets[1], 2, 3);
    // A structure's descriptor becomes a buffer's.
    let world = gpu.scene(&[Geometry::opaque(&[
        [0.0; 3],
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
    ])]);
    gpu.write(sets[1], 0, 2, &Bound::Structure(world.handle));
    gpu.write(sets[1], 0, 2, &Bound::Storage(others));
    run(sets[1], 2, 4);
    let words: Vec<u32> = results.read();
    assert_eq!(words[..5], [12, 23, 23, 14, 24]);
    // SAFETY: nothing uses them any more.
    unsafe {
        gpu.device.destroy_descriptor_pool(pool, None);
        gpu.device.destroy_descriptor_set_layout(layout, None);
    }
}
