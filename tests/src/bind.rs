//! Descriptor sets from lists of the resources to bind.

use ash::vk;

use crate::gpu::Made;
use crate::{Buffer, Gpu};

/// Something to bind. Binding numbers are given beside it.
#[derive(Clone, Copy, Debug)]
pub enum Bound {
    Storage(Buffer),
    Uniform(Buffer),
    /// With a window of this many bytes, to be moved by an offset at binding time.
    StorageDynamic(Buffer, u64),
    UniformDynamic(Buffer, u64),
    Sampled(vk::ImageView, vk::Sampler),
    SampledImage(vk::ImageView),
    Sampler(vk::Sampler),
    StorageImage(vk::ImageView),
    UniformTexels(vk::BufferView),
    StorageTexels(vk::BufferView),
    Structure(vk::AccelerationStructureKHR),
    StructureNv(vk::AccelerationStructureNV),
}

impl Bound {
    pub fn kind(&self) -> vk::DescriptorType {
        use vk::DescriptorType as Kind;
        match self {
            Bound::Storage(_) => Kind::STORAGE_BUFFER,
            Bound::Uniform(_) => Kind::UNIFORM_BUFFER,
            Bound::StorageDynamic(..) => Kind::STORAGE_BUFFER_DYNAMIC,
            Bound::UniformDynamic(..) => Kind::UNIFORM_BUFFER_DYNAMIC,
            Bound::Sampled(..) => Kind::COMBINED_IMAGE_SAMPLER,
            Bound::SampledImage(_) => Kind::SAMPLED_IMAGE,
            Bound::Sampler(_) => Kind::SAMPLER,
            Bound::StorageImage(_) => Kind::STORAGE_IMAGE,
            Bound::UniformTexels(_) => Kind::UNIFORM_TEXEL_BUFFER,
            Bound::StorageTexels(_) => Kind::STORAGE_TEXEL_BUFFER,
            Bound::Structure(_) => Kind::ACCELERATION_STRUCTURE_KHR,
            Bound::StructureNv(_) => Kind::ACCELERATION_STRUCTURE_NV,
        }
    }

    fn buffer_info(&self) -> Option<vk::DescriptorBufferInfo> {
        let (buffer, range) = match self {
            Bound::Storage(buffer) | Bound::Uniform(buffer) => (buffer, vk::WHOLE_SIZE),
            Bound::StorageDynamic(buffer, range) | Bound::UniformDynamic(buffer, range) => {
                (buffer, *range)
            }
            _ => return None,
        };
        Some(
            vk::DescriptorBufferInfo::default()
                .buffer(buffer.handle)
                .range(range),
        )
    }

    fn image_info(&self) -> Option<vk::DescriptorImageInfo> {
        let info = vk::DescriptorImageInfo::default().image_layout(vk::ImageLayout::GENERAL);
        Some(match self {
            Bound::Sampled(view, sampler) => info.image_view(*view).sampler(*sampler),
            Bound::SampledImage(view) | Bound::StorageImage(view) => info.image_view(*view),
            Bound::Sampler(sampler) => info.sampler(*sampler),
            _ => return None,
        })
    }
}

/// A descriptor set with its layout.
#[derive(Clone, Copy, Debug)]
pub struct Set {
    pub layout: vk::DescriptorSetLayout,
    pub handle: vk::DescriptorSet,
}

impl Gpu {
    /// A set whose bindings are numbered from 0, with one thing each.
    pub fn set_of(&self, things: &[Bound]) -> Set {
        let bindings: Vec<(u32, &[Bound])> = (0..).zip(things.chunks(1)).collect();
        self.set(&bindings)
    }

    /// A set that holds, for each binding number, an array of things of one kind.
    pub fn set(&self, bindings: &[(u32, &[Bound])]) -> Set {
        let layout = self.set_layout(bindings, vk::DescriptorSetLayoutCreateFlags::empty());
        let mut sizes: Vec<vk::DescriptorPoolSize> = bindings
            .iter()
            .map(|(_, things)| vk::DescriptorPoolSize {
                ty: things[0].kind(),
                descriptor_count: things.len() as u32,
            })
            .collect();
        if sizes.is_empty() {
            sizes.push(vk::DescriptorPoolSize {
                ty: vk::DescriptorType::STORAGE_BUFFER,
                descriptor_count: 1,
            });
        }
        let handle = self.allocate_set(layout, &sizes);
        for (binding, things) in bindings {
            for (element, thing) in things.iter().enumerate() {
                self.write(handle, *binding, element as u32, thing);
            }
        }
        Set { layout, handle }
    }

    /// A set of a pool of its own.
    pub fn allocate_set(
        &self,
        layout: vk::DescriptorSetLayout,
        sizes: &[vk::DescriptorPoolSize],
    ) -> vk::DescriptorSet {
        let pool = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(sizes);
        let layouts = [layout];
        // SAFETY: the structures outlive the calls.
        unsafe {
            let pool = self
                .device
                .create_descriptor_pool(&pool, None)
                .expect("a pool");
            self.keep(Made::Pool(pool));
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(pool)
                .set_layouts(&layouts);
            self.device.allocate_descriptor_sets(&info).expect("a set")[0]
        }
    }

    /// The layout that [`Gpu::set`] makes.
    pub fn set_layout(
        &self,
        bindings: &[(u32, &[Bound])],
        flags: vk::DescriptorSetLayoutCreateFlags,
    ) -> vk::DescriptorSetLayout {
        let kinds: Vec<(u32, vk::DescriptorType, u32)> = bindings
            .iter()
            .map(|(binding, things)| (*binding, things[0].kind(), things.len() as u32))
            .collect();
        self.set_layout_of(&kinds, flags)
    }

    /// A layout of these bindings: number, kind and count.
    pub fn set_layout_of(
        &self,
        bindings: &[(u32, vk::DescriptorType, u32)],
        flags: vk::DescriptorSetLayoutCreateFlags,
    ) -> vk::DescriptorSetLayout {
        let entries: Vec<vk::DescriptorSetLayoutBinding> = bindings
            .iter()
            .map(|&(binding, kind, count)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(kind)
                    .descriptor_count(count)
                    .stage_flags(match kind {
                        vk::DescriptorType::INPUT_ATTACHMENT => vk::ShaderStageFlags::FRAGMENT,
                        _ => vk::ShaderStageFlags::ALL,
                    })
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default()
            .flags(flags)
            .bindings(&entries);
        self.set_layout_from(&info)
    }

    /// A layout as described.
    pub fn set_layout_from(
        &self,
        info: &vk::DescriptorSetLayoutCreateInfo,
    ) -> vk::DescriptorSetLayout {
        // SAFETY: `info` outlives the call.
        let layout = unsafe { self.device.create_descriptor_set_layout(info, None) };
        let layout = layout.expect("vkCreateDescriptorSetLayout");
        self.keep(Made::SetLayout(layout));
        layout
    }

    /// Writes one descriptor.
    pub fn write(&self, set: vk::DescriptorSet, binding: u32, element: u32, thing: &Bound) {
        let buffers: Vec<_> = thing.buffer_info().into_iter().collect();
        let images: Vec<_> = thing.image_info().into_iter().collect();
        let mut write = vk::WriteDescriptorSet::default()
            .dst_set(set)
            .dst_binding(binding)
            .dst_array_element(element)
            .descriptor_count(1)
            .descriptor_type(thing.kind());
        let (views, structures, structures_nv);
        let (mut structure_write, mut structure_write_nv);
        match thing {
            Bound::UniformTexels(view) | Bound::StorageTexels(view) => {
                views = [*view];
                write = write.texel_buffer_view(&views);
            }
            Bound::Structure(structure) => {
                structures = [*structure];
                structure_write = vk::WriteDescriptorSetAccelerationStructureKHR::default()
                    .acceleration_structures(&structures);
                write = write.push_next(&mut structure_write);
            }
            Bound::StructureNv(structure) => {
                structures_nv = [*structure];
                structure_write_nv = vk::WriteDescriptorSetAccelerationStructureNV::default()
                    .acceleration_structures(&structures_nv);
                write = write.push_next(&mut structure_write_nv);
            }
            _ if !buffers.is_empty() => write = write.buffer_info(&buffers),
            _ => write = write.image_info(&images),
        }
        // SAFETY: the handles are of this device, and the set is not in use.
        unsafe { self.device.update_descriptor_sets(&[write], &[]) };
    }

    /// A pipeline layout for these sets, with 128 bytes of push constants for all stages.
    pub fn layout(&self, sets: &[vk::DescriptorSetLayout]) -> vk::PipelineLayout {
        self.layout_with(vk::PipelineLayoutCreateFlags::empty(), sets)
    }

    /// The same, with flags.
    pub fn layout_with(
        &self,
        flags: vk::PipelineLayoutCreateFlags,
        sets: &[vk::DescriptorSetLayout],
    ) -> vk::PipelineLayout {
        let push = [vk::PushConstantRange::default()
            .stage_flags(vk::ShaderStageFlags::ALL)
            .size(128)];
        let info = vk::PipelineLayoutCreateInfo::default()
            .flags(flags)
            .set_layouts(sets)
            .push_constant_ranges(&push);
        // SAFETY: `info` outlives the call.
        let layout = unsafe { self.device.create_pipeline_layout(&info, None) };
        let layout = layout.expect("vkCreatePipelineLayout");
        self.keep(Made::Layout(layout));
        layout
    }

    /// A shader module.
    pub fn module(&self, words: &[u32]) -> vk::ShaderModule {
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: `info` outlives the call.
        let module = unsafe { self.device.create_shader_module(&info, None) };
        let module = module.expect("vkCreateShaderModule");
        self.keep(Made::Module(module));
        module
    }
}
