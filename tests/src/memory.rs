//! Buffers in host-visible memory.

use ash::vk;
use bytemuck::Pod;

use crate::Gpu;
use crate::gpu::Made;

/// A buffer, mapped for as long as its [`Gpu`] lives.
#[derive(Clone, Copy, Debug)]
pub struct Buffer {
    pub handle: vk::Buffer,
    pub size_bytes: u64,
    /// Its device address.
    pub address: u64,
    mapped: *mut u8,
}

/// Every use that the tests make of buffers.
const ANY_USE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw()
        | vk::BufferUsageFlags::UNIFORM_BUFFER.as_raw()
        | vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER.as_raw()
        | vk::BufferUsageFlags::STORAGE_TEXEL_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDIRECT_BUFFER.as_raw()
        | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS.as_raw()
        | vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR.as_raw()
        | vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR.as_raw()
        | vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR.as_raw(),
);

impl Gpu {
    /// The usage of buffers.
    pub fn usual_uses(&self) -> vk::BufferUsageFlags {
        let mut usage = ANY_USE;
        if self.has_graphics() {
            usage |= vk::BufferUsageFlags::VERTEX_BUFFER | vk::BufferUsageFlags::INDEX_BUFFER;
        }
        if self.optional.conditional_rendering.conditional_rendering != 0 {
            usage |= vk::BufferUsageFlags::CONDITIONAL_RENDERING_EXT;
        }
        if self.optional.transform_feedback.transform_feedback != 0 {
            usage |= vk::BufferUsageFlags::TRANSFORM_FEEDBACK_BUFFER_EXT
                | vk::BufferUsageFlags::TRANSFORM_FEEDBACK_COUNTER_BUFFER_EXT;
        }
        if self.optional.micromap.micromap != 0 {
            usage |= vk::BufferUsageFlags::MICROMAP_STORAGE_EXT
                | vk::BufferUsageFlags::MICROMAP_BUILD_INPUT_READ_ONLY_EXT;
        }
        usage
    }

    /// A zeroed buffer for any usual use.
    pub fn buffer(&self, size_bytes: u64) -> Buffer {
        self.buffer_for(size_bytes, vk::BufferUsageFlags::empty())
    }

    /// A large buffer for any usual use. Its contents are undefined and its pages are not touched.
    /// `None` if the device lacks the memory.
    pub fn untouched_buffer(&self, size_bytes: u64) -> Option<Buffer> {
        let mut limits = vk::PhysicalDeviceVulkan11Properties::default();
        let mut limits4 = vk::PhysicalDeviceVulkan13Properties::default();
        let mut all = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut limits)
            .push_next(&mut limits4);
        // SAFETY: the physical device is of this instance.
        unsafe {
            (self.instance).get_physical_device_properties2(self.physical, &mut all);
        }
        let largest = limits
            .max_memory_allocation_size
            .min(limits4.max_buffer_size);
        let info = vk::BufferCreateInfo::default()
            .size(size_bytes)
            .usage(self.usual_uses());
        // SAFETY: the handles are of this device.
        let (handle, needs) = unsafe {
            if size_bytes > largest {
                return None;
            }
            let handle = self.device.create_buffer(&info, None).ok()?;
            self.keep(Made::Buffer(handle));
            (handle, self.device.get_buffer_memory_requirements(handle))
        };
        if needs.size > limits.max_memory_allocation_size {
            return None;
        }
        let memory = self.try_allocate(needs, true)?;
        Some(self.bind_and_map(handle, size_bytes, memory))
    }

    fn bind_and_map(
        &self,
        handle: vk::Buffer,
        size_bytes: u64,
        memory: vk::DeviceMemory,
    ) -> Buffer {
        // SAFETY: the handles are of this device, and the memory is as long as the buffer.
        unsafe {
            self.device
                .bind_buffer_memory(handle, memory, 0)
                .expect("vkBindBufferMemory");
            let mapped = self
                .device
                .map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                .expect("vkMapMemory")
                .cast::<u8>();
            let address = vk::BufferDeviceAddressInfo::default().buffer(handle);
            let address = self.device.get_buffer_device_address(&address);
            Buffer {
                handle,
                size_bytes,
                address,
                mapped,
            }
        }
    }

    /// A zeroed buffer for uses that not every device knows, besides the usual ones.
    pub fn buffer_for(&self, size_bytes: u64, uses: vk::BufferUsageFlags) -> Buffer {
        let size_bytes = size_bytes.max(4);
        let info = vk::BufferCreateInfo::default()
            .size(size_bytes)
            .usage(self.usual_uses() | uses);
        // SAFETY: the handles are of this device, and the memory is mapped whole.
        unsafe {
            let handle = self
                .device
                .create_buffer(&info, None)
                .expect("vkCreateBuffer");
            let needs = self.device.get_buffer_memory_requirements(handle);
            let memory = self.allocate(needs, true);
            self.keep(Made::Buffer(handle));
            let buffer = self.bind_and_map(handle, size_bytes, memory);
            buffer.mapped.write_bytes(0, size_bytes as usize);
            buffer
        }
    }

    /// A buffer that holds a copy of `items`.
    pub fn buffer_with<T: Pod>(&self, items: &[T]) -> Buffer {
        let buffer = self.buffer(size_of_val(items) as u64);
        buffer.write(0, items);
        buffer
    }

    /// Memory for a buffer or an image: visible and coherent for buffers.
    pub fn allocate(&self, needs: vk::MemoryRequirements, is_buffer: bool) -> vk::DeviceMemory {
        self.try_allocate(needs, is_buffer).expect("memory")
    }

    fn try_allocate(
        &self,
        needs: vk::MemoryRequirements,
        is_buffer: bool,
    ) -> Option<vk::DeviceMemory> {
        let wish = match is_buffer {
            true => vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT,
            false => vk::MemoryPropertyFlags::empty(),
        };
        let kind = self
            .memory
            .memory_types_as_slice()
            .iter()
            .enumerate()
            .position(|(i, kind)| {
                needs.memory_type_bits >> i & 1 == 1 && kind.property_flags.contains(wish)
            })
            .expect("a fitting type of memory");
        let mut flags = vk::MemoryAllocateFlagsInfo::default();
        if is_buffer {
            flags = flags.flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        }
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(kind as u32)
            .push_next(&mut flags);
        // SAFETY: `info` outlives the call.
        let memory = unsafe { self.device.allocate_memory(&info, None) }.ok()?;
        self.keep(Made::Memory(memory));
        Some(memory)
    }

    /// A view of a buffer's texels.
    pub fn buffer_view(&self, buffer: &Buffer, format: vk::Format) -> vk::BufferView {
        self.buffer_view_of(buffer, format, 0, vk::WHOLE_SIZE)
    }

    /// A view of some of them.
    pub fn buffer_view_of(
        &self,
        buffer: &Buffer,
        format: vk::Format,
        offset: u64,
        range: u64,
    ) -> vk::BufferView {
        let info = vk::BufferViewCreateInfo::default()
            .buffer(buffer.handle)
            .format(format)
            .offset(offset)
            .range(range);
        // SAFETY: the buffer is of this device.
        let view = unsafe { self.device.create_buffer_view(&info, None) };
        let view = view.expect("vkCreateBufferView");
        self.keep(Made::BufferView(view));
        view
    }
}

impl Buffer {
    /// Its first byte, as a build takes it.
    pub fn at(&self) -> vk::DeviceOrHostAddressConstKHR {
        vk::DeviceOrHostAddressConstKHR {
            device_address: self.address,
        }
    }

    /// Copies `count` items out from a byte offset on.
    pub fn read_at<T: Pod>(&self, offset: u64, count: usize) -> Vec<T> {
        let mut items = vec![T::zeroed(); count];
        let target: &mut [u8] = bytemuck::cast_slice_mut(&mut items);
        let end = offset.checked_add(target.len() as u64);
        assert!(end.is_some_and(|end| end <= self.size_bytes));
        // SAFETY: the range lies inside the mapping.
        unsafe {
            let from = self.mapped.add(offset as usize);
            from.copy_to_nonoverlapping(target.as_mut_ptr(), target.len());
        }
        items
    }

    /// Copies items in at a byte offset; the device must not be using the buffer.
    pub fn write<T: Pod>(&self, offset: usize, items: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(items);
        assert!(offset + bytes.len() <= self.size_bytes as usize);
        // SAFETY: the range lies inside the mapping, and nothing else refers to it.
        unsafe {
            self.mapped
                .add(offset)
                .copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
        }
    }

    /// Copies the whole buffer out.
    pub fn read<T: Pod>(&self) -> Vec<T> {
        self.read_at(0, self.size_bytes as usize / size_of::<T>())
    }
}
