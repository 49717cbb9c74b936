//! Descriptor heaps.

use std::ffi::{CStr, c_void};
use std::ptr::from_ref;

use bytemuck::Pod;

use crate::newer as vk;
use crate::{Buffer, Gpu, Group, Picture, Rays, Set, Stage, Structure, all_of, glsl};
use vk::DescriptorType as Ty;

/// `VK_DESCRIPTOR_MAPPING_SOURCE_HEAP_WITH_CONSTANT_OFFSET_EXT`, and others.
pub const HEAP_WITH_CONSTANT_OFFSET: i32 = 0;
pub const HEAP_WITH_PUSH_INDEX: i32 = 1;
pub const PUSH_DATA: i32 = 5;
pub const PUSH_ADDRESS: i32 = 6;

/// `VK_SPIRV_RESOURCE_TYPE_ALL_EXT`.
const ALL: u32 = 0x7fff_ffff;

/// `VK_PIPELINE_CREATE_2_DESCRIPTOR_HEAP_BIT_EXT`.
pub const WITH_HEAPS: vk::PipelineCreateFlags2KHR = vk::PipelineCreateFlags2KHR::from_raw(1 << 36);

type WriteSamplers = unsafe extern "system" fn(
    vk::Device,
    u32,
    *const vk::SamplerCreateInfo<'_>,
    *const vk::HostAddressRangeEXT,
) -> vk::Result;
type WriteResources = unsafe extern "system" fn(
    vk::Device,
    u32,
    *const vk::ResourceDescriptorInfoEXT,
    *const vk::HostAddressRangeEXT,
) -> vk::Result;
type BindHeap = unsafe extern "system" fn(vk::CommandBuffer, *const vk::BindHeapInfoEXT);
type PushData = unsafe extern "system" fn(vk::CommandBuffer, *const vk::PushDataInfoEXT);

/// Two heaps of `VK_EXT_descriptor_heap`, and the extension's commands.
pub struct Heaps<'a> {
    pub gpu: &'a Gpu,
    write_samplers: WriteSamplers,
    write_resources: WriteResources,
    bind_resources: BindHeap,
    bind_samplers: BindHeap,
    push: PushData,
    pub resources: Buffer,
    pub samplers: Buffer,
    /// Bytes from one place to the next in either heap, and before the first.
    pub stride: u64,
    first: u64,
}

impl<'a> Heaps<'a> {
    /// Heaps with room for so many descriptors each. The device must have the feature.
    pub fn new(gpu: &'a Gpu, places: u64) -> Self {
        let mut p = vk::PhysicalDeviceDescriptorHeapPropertiesEXT::default();
        let mut all = vk::PhysicalDeviceProperties2 {
            p_next: (&raw mut p).cast(),
            ..Default::default()
        };
        // SAFETY: the physical device is of the instance; the chain outlives the call.
        unsafe {
            gpu.instance
                .get_physical_device_properties2(gpu.physical, &mut all);
        }
        assert!(p.sampler_descriptor_size <= 32 && p.max_push_data_size >= 256);
        let sizes = [
            p.sampler_descriptor_size,
            p.image_descriptor_size,
            p.buffer_descriptor_size,
        ];
        let stride = sizes.into_iter().max().unwrap().next_power_of_two();
        let reserved = [
            p.min_sampler_heap_reserved_range_with_embedded,
            p.min_resource_heap_reserved_range,
        ];
        let reserved = reserved.into_iter().max().unwrap();
        let first = reserved.next_multiple_of(stride);
        let heap = |_| {
            let usage = vk::BufferUsageFlags::from_raw(1 << 28);
            gpu.buffer_for(first + places * stride, usage)
        };
        let [resources, samplers] = [0, 1].map(heap);
        let find = |name: &CStr| {
            let device = gpu.device.handle();
            // SAFETY: the device is of the instance.
            unsafe { gpu.instance.get_device_proc_addr(device, name.as_ptr()) }
        };
        // SAFETY: the commands have these types.
        unsafe {
            Self {
                gpu,
                write_samplers: std::mem::transmute::<vk::PFN_vkVoidFunction, _>(find(
                    c"vkWriteSamplerDescriptorsEXT",
                )),
                write_resources: std::mem::transmute::<vk::PFN_vkVoidFunction, _>(find(
                    c"vkWriteResourceDescriptorsEXT",
                )),
                bind_resources: std::mem::transmute::<vk::PFN_vkVoidFunction, _>(find(
                    c"vkCmdBindResourceHeapEXT",
                )),
                bind_samplers: std::mem::transmute::<vk::PFN_vkVoidFunction, _>(find(
                    c"vkCmdBindSamplerHeapEXT",
                )),
                push: std::mem::transmute::<vk::PFN_vkVoidFunction, _>(find(c"vkCmdPushDataEXT")),
                resources,
                samplers,
                stride,
                first,
            }
        }
    }

    /// A mapping of a binding onto a place, and the next ones for the elements of an array.
    pub fn constant(&self, binding: u32, place: u64) -> vk::DescriptorSetAndBindingMappingEXT {
        let constant_offset = vk::ConstantOffset {
            heap_offset: self.at(place),
            heap_array_stride: self.stride as u32,
            p_embedded_sampler: std::ptr::null(),
            sampler_heap_offset: self.at(place),
            sampler_heap_array_stride: self.stride as u32,
        };
        let data = vk::DescriptorMappingSourceDataEXT { constant_offset };
        mapping(binding, HEAP_WITH_CONSTANT_OFFSET, data)
    }

    /// A mapping of a binding onto an image's place, with a sampler that programs embed.
    pub fn embedding(
        &self,
        binding: u32,
        place: u64,
        sampler: &vk::SamplerCreateInfo<'static>,
    ) -> vk::DescriptorSetAndBindingMappingEXT {
        let constant_offset = vk::ConstantOffset {
            heap_offset: self.at(place),
            heap_array_stride: 0,
            p_embedded_sampler: sampler,
            sampler_heap_offset: 0,
            sampler_heap_array_stride: 0,
        };
        let data = vk::DescriptorMappingSourceDataEXT { constant_offset };
        mapping(binding, HEAP_WITH_CONSTANT_OFFSET, data)
    }

    /// Writes the descriptor of all of an image into the heap of resources.
    pub fn put_picture(&self, place: u64, ty: Ty, picture: &Picture) {
        let shape = picture.shape;
        let view = vk::ImageViewCreateInfo::default()
            .image(picture.handle)
            .view_type(shape.kind)
            .format(shape.format)
            .subresource_range(all_of(shape));
        let image = vk::ImageDescriptorInfoEXT {
            p_view: &view,
            layout: vk::ImageLayout::GENERAL,
            ..Default::default()
        };
        let bytes = self.resource(ty, &image);
        self.resources.write(self.at(place) as usize, &bytes);
    }

    /// Writes the descriptor of a structure into the heap of resources.
    pub fn put_structure(&self, place: u64, structure: &Structure) {
        let range = vk::DeviceAddressRangeKHR {
            address: structure.address,
            size: 0,
        };
        let bytes = self.resource(Ty::ACCELERATION_STRUCTURE_KHR, &range);
        self.resources.write(self.at(place) as usize, &bytes);
    }

    /// Writes the descriptor of a sampler into the heap of samplers.
    pub fn put_sampler(&self, place: u64, info: &vk::SamplerCreateInfo<'_>) {
        let bytes = self.sampler(info);
        self.samplers.write(self.at(place) as usize, &bytes);
    }

    /// The offset of a place in either heap.
    pub fn at(&self, place: u64) -> u32 {
        (self.first + place * self.stride) as u32
    }

    fn bytes(&self, write: impl FnOnce(&vk::HostAddressRangeEXT) -> vk::Result) -> Vec<u8> {
        let mut bytes = vec![0u8; self.stride as usize];
        let range = vk::HostAddressRangeEXT {
            address: bytes.as_mut_ptr().cast(),
            size: bytes.len(),
        };
        assert_eq!(write(&range), vk::Result::SUCCESS);
        bytes
    }

    /// The descriptor of a sampler.
    pub fn sampler(&self, info: &vk::SamplerCreateInfo<'_>) -> Vec<u8> {
        let device = self.gpu.device.handle();
        // SAFETY: the info and the range are valid.
        self.bytes(|range| unsafe { (self.write_samplers)(device, 1, info, range) })
    }

    /// The descriptor of a resource; `data` is what the type asks for.
    pub fn resource<T>(&self, ty: Ty, data: &T) -> Vec<u8> {
        let info = vk::ResourceDescriptorInfoEXT {
            ty,
            data: from_ref(data).cast(),
            ..Default::default()
        };
        let device = self.gpu.device.handle();
        // SAFETY: the data is of the type; the range is valid.
        self.bytes(|range| unsafe { (self.write_resources)(device, 1, &info, range) })
    }

    /// Writes the descriptor of a buffer into the heap of resources.
    pub fn put_buffer(&self, place: u64, ty: Ty, buffer: &Buffer) {
        let range = range_of(buffer);
        let bytes = self.resource(ty, &range);
        self.resources.write(self.at(place) as usize, &bytes);
    }

    /// Binds both heaps.
    pub fn bind(&self, commands: vk::CommandBuffer) {
        self.bind_ranges(commands, [&self.resources, &self.samplers].map(range_of));
    }

    /// Binds memory as the heaps of resources and of samplers.
    pub fn bind_ranges(&self, commands: vk::CommandBuffer, ranges: [vk::DeviceAddressRangeKHR; 2]) {
        let [resources, samplers] = ranges.map(|range| self.binding_of(range));
        // SAFETY: the heaps outlive the commands.
        unsafe {
            (self.bind_resources)(commands, &resources);
            (self.bind_samplers)(commands, &samplers);
        }
    }

    /// The binding of all of a heap.
    pub fn binding(&self, heap: &Buffer) -> vk::BindHeapInfoEXT {
        self.binding_of(range_of(heap))
    }

    fn binding_of(&self, heap_range: vk::DeviceAddressRangeKHR) -> vk::BindHeapInfoEXT {
        vk::BindHeapInfoEXT {
            heap_range,
            reserved_range_size: self.first,
            ..Default::default()
        }
    }

    /// Pushes data.
    pub fn push<T: Pod>(&self, commands: vk::CommandBuffer, data: &[T]) {
        let info = vk::PushDataInfoEXT {
            data: vk::HostAddressRangeEXT {
                address: data.as_ptr().cast::<c_void>().cast_mut(),
                size: size_of_val(data),
            },
            ..Default::default()
        };
        // SAFETY: the data outlives the call.
        unsafe { (self.push)(commands, &info) };
    }

    /// A compute pipeline of mapped bindings.
    pub fn kernel(
        &self,
        source: &str,
        mappings: &[vk::DescriptorSetAndBindingMappingEXT],
    ) -> vk::Pipeline {
        let pipeline = self.kernel_of(&glsl(Stage::Compute, source), mappings);
        self.gpu.keep_pipeline(pipeline);
        pipeline
    }

    /// The same of SPIR-V, which the caller destroys.
    pub fn kernel_of(
        &self,
        words: &[u32],
        mappings: &[vk::DescriptorSetAndBindingMappingEXT],
    ) -> vk::Pipeline {
        let device = &self.gpu.device;
        let module = vk::ShaderModuleCreateInfo::default().code(words);
        let info = chained(mappings);
        // SAFETY: the structures outlive the calls.
        unsafe {
            let module = device
                .create_shader_module(&module, None)
                .expect("a module");
            let mut stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(c"main");
            stage.p_next = from_ref(&info).cast();
            let mut flags = vk::PipelineCreateFlags2CreateInfoKHR::default().flags(WITH_HEAPS);
            let info = vk::ComputePipelineCreateInfo::default()
                .stage(stage)
                .push_next(&mut flags);
            let made = device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
            device.destroy_shader_module(module, None);
            made.expect("a pipeline")[0]
        }
    }

    /// A ray tracing pipeline of mapped bindings.
    pub fn rays(
        &self,
        shaders: &[(Stage, Vec<u32>)],
        groups: &[Group],
        recursion: u32,
        mappings: &[vk::DescriptorSetAndBindingMappingEXT],
    ) -> Rays {
        let mappings = chained(mappings);
        let mut flags = vk::PipelineCreateFlags2CreateInfoKHR::default().flags(WITH_HEAPS);
        let info = vk::RayTracingPipelineCreateInfoKHR::default()
            .max_pipeline_ray_recursion_depth(recursion)
            .push_next(&mut flags);
        let next = from_ref(&mappings).cast();
        let no_cache = vk::PipelineCache::null();
        let made = self.gpu.try_rays_of(shaders, groups, info, next, no_cache);
        let pipeline = made.expect("vkCreateRayTracingPipelinesKHR");
        let none = Set {
            layout: vk::DescriptorSetLayout::null(),
            handle: vk::DescriptorSet::null(),
        };
        let layout = vk::PipelineLayout::null();
        self.gpu.rays_of(pipeline, layout, none, groups.len())
    }

    /// Binds both heaps, and traces a grid of rays.
    pub fn record_trace(
        &self,
        commands: vk::CommandBuffer,
        rays: &Rays,
        [raygen, miss, hit, callable]: &[vk::StridedDeviceAddressRegionKHR; 4],
        [width, height, depth]: [u32; 3],
    ) {
        self.bind(commands);
        let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
        let gpu = self.gpu;
        // SAFETY: the regions lie in buffers that live as long as the device.
        unsafe {
            gpu.device.cmd_bind_pipeline(commands, point, rays.pipeline);
            gpu.ray_tracing
                .cmd_trace_rays(commands, raygen, miss, hit, callable, width, height, depth);
        }
    }

    /// Binds a kernel and dispatches one workgroup.
    pub fn dispatch(&self, commands: vk::CommandBuffer, kernel: vk::Pipeline) {
        // SAFETY: the pipeline outlives the commands.
        unsafe {
            let device = &self.gpu.device;
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, kernel);
            device.cmd_dispatch(commands, 1, 1, 1);
        }
    }
}

/// The mappings in the chain of a stage.
pub fn chained(
    mappings: &[vk::DescriptorSetAndBindingMappingEXT],
) -> vk::ShaderDescriptorSetAndBindingMappingInfoEXT {
    vk::ShaderDescriptorSetAndBindingMappingInfoEXT {
        mapping_count: mappings.len() as u32,
        p_mappings: mappings.as_ptr(),
        ..Default::default()
    }
}

/// All of a buffer.
pub fn range_of(buffer: &Buffer) -> vk::DeviceAddressRangeKHR {
    vk::DeviceAddressRangeKHR {
        address: buffer.address,
        size: buffer.size_bytes,
    }
}

/// A mapping of one binding of set 0.
pub fn mapping(
    binding: u32,
    source: i32,
    data: vk::DescriptorMappingSourceDataEXT,
) -> vk::DescriptorSetAndBindingMappingEXT {
    vk::DescriptorSetAndBindingMappingEXT {
        first_binding: binding,
        binding_count: 1,
        resource_mask: ALL,
        source,
        source_data: data,
        ..Default::default()
    }
}
