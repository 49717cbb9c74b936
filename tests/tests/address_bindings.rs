//! `VK_EXT_device_address_binding_report`: debug messengers hear which addresses objects get and
//! lose.

use std::ffi::c_void;
use std::sync::Mutex;

use ash::ext;
use ash::vk::Handle;
use tuff_tests::*;

/// A region of addresses of an object, as a message has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct BindingReport {
    binds: bool,
    flags: vk::DeviceAddressBindingFlagsEXT,
    object: (vk::ObjectType, u64),
    address: u64,
    size_bytes: u64,
}

const NO_FLAGS: vk::DeviceAddressBindingFlagsEXT = vk::DeviceAddressBindingFlagsEXT::empty();
/// The object was told of before its creation returned.
const INTERNAL: vk::DeviceAddressBindingFlagsEXT =
    vk::DeviceAddressBindingFlagsEXT::INTERNAL_OBJECT;

/// A messenger for address bindings.
struct Listener {
    api: ext::debug_utils::Instance,
    messenger: vk::DebugUtilsMessengerEXT,
    told: Box<Mutex<Vec<BindingReport>>>,
}

impl Listener {
    fn new(entry: &ash::Entry, instance: &ash::Instance) -> Listener {
        let api = ext::debug_utils::Instance::new(entry, instance);
        let told = Box::<Mutex<Vec<BindingReport>>>::default();
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::INFO)
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::DEVICE_ADDRESS_BINDING)
            .pfn_user_callback(Some(hear))
            .user_data((&raw const *told).cast_mut().cast());
        // SAFETY: the callback keeps to its signature, and its data outlives the messenger.
        let messenger = unsafe { api.create_debug_utils_messenger(&info, None) };
        Listener {
            api,
            messenger: messenger.expect("vkCreateDebugUtilsMessengerEXT"),
            told,
        }
    }

    /// Takes the reports so far; the list is empty afterwards.
    fn take(&self) -> Vec<BindingReport> {
        std::mem::take(&mut *self.told.lock().unwrap())
    }

    /// The same, of one object.
    fn take_of<T: Handle>(&self, object: T) -> Vec<BindingReport> {
        let object = (T::TYPE, object.as_raw());
        let told = self.take();
        told.into_iter().filter(|it| it.object == object).collect()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        // SAFETY: the messenger is of this instance, which is still there.
        unsafe {
            self.api.destroy_debug_utils_messenger(self.messenger, None);
        }
    }
}

unsafe extern "system" fn hear(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    list: *mut c_void,
) -> vk::Bool32 {
    assert_eq!(severity, vk::DebugUtilsMessageSeverityFlagsEXT::INFO);
    assert_eq!(
        types,
        vk::DebugUtilsMessageTypeFlagsEXT::DEVICE_ADDRESS_BINDING
    );
    // SAFETY: the chain is that of a message of this type, and `list` is the listener's.
    unsafe {
        let data = &*data;
        let binding = &*data
            .p_next
            .cast::<vk::DeviceAddressBindingCallbackDataEXT<'_>>();
        assert_eq!(
            binding.s_type,
            vk::StructureType::DEVICE_ADDRESS_BINDING_CALLBACK_DATA_EXT
        );
        assert!(data.object_count >= 1);
        let object = &*data.p_objects;
        let told = BindingReport {
            binds: binding.binding_type == vk::DeviceAddressBindingTypeEXT::BIND,
            flags: binding.flags,
            object: (object.object_type, object.object_handle),
            address: binding.base_address,
            size_bytes: binding.size,
        };
        let list = &*list.cast::<Mutex<Vec<BindingReport>>>();
        if let Ok(mut list) = list.lock() {
            list.push(told);
        }
    }
    vk::FALSE
}

fn open() -> Option<(Gpu, Listener)> {
    // The validation layer gives out handles of its own, and drivers do not know those.
    let gpu = Gpu::without_validation().with("VK_EXT_device_address_binding_report", |gpu| {
        gpu.optional.address_report.report_address_binding == vk::TRUE
    })?;
    // The messenger goes first: the device takes its instance along.
    let listener = Listener::new(&gpu.entry, &gpu.instance);
    Some((gpu, listener))
}

/// Fails unless what got addresses lost the same.
#[track_caller]
fn all_lost(told: &[BindingReport]) {
    for (at, bound) in told.iter().enumerate() {
        let of = |it: &&BindingReport| {
            it.binds != bound.binds
                && (it.object, it.address, it.size_bytes)
                    == (bound.object, bound.address, bound.size_bytes)
        };
        let pair = match bound.binds {
            true => told[at..].iter().find(of),
            false => told[..at].iter().find(of),
        };
        assert!(pair.is_some(), "{bound:?} alone");
    }
}

/// Fails unless an object got this region, and lost it at its end. The region may be larger:
/// drivers round.
#[track_caller]
fn got_and_lost(
    gpu: &Gpu,
    told: &[BindingReport],
    flags: vk::DeviceAddressBindingFlagsEXT,
    address: u64,
    size_bytes: u64,
) {
    all_lost(told);
    let covers = |it: &&BindingReport| {
        it.address <= address && address + size_bytes <= it.address + it.size_bytes
    };
    let binding = told.iter().filter(|it| it.binds).find(covers);
    let binding = binding.unwrap_or_else(|| panic!("no {address:#x} in {told:?}"));
    assert_eq!(binding.flags, flags);
    if gpu.is_tuff() {
        assert_eq!((binding.address, binding.size_bytes), (address, size_bytes));
        assert_eq!(told.len(), 2);
    }
}

fn allocate(gpu: &Gpu, needs: vk::MemoryRequirements) -> vk::DeviceMemory {
    let mut flags =
        vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
    let info = vk::MemoryAllocateInfo::default()
        .allocation_size(needs.size)
        .memory_type_index(needs.memory_type_bits.trailing_zeros())
        .push_next(&mut flags);
    // SAFETY: `info` outlives the call.
    unsafe { gpu.device.allocate_memory(&info, None) }.expect("vkAllocateMemory")
}

#[test]
fn memory_and_buffers_are_told() {
    let Some((gpu, listener)) = open() else {
        return;
    };
    let info = vk::BufferCreateInfo::default()
        .size(1000)
        .usage(vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS);
    // SAFETY: the handles are of this device, and destroyed once.
    unsafe {
        let buffer = gpu.device.create_buffer(&info, None).unwrap();
        let needs = gpu.device.get_buffer_memory_requirements(buffer);
        listener.take();
        let memory = allocate(&gpu, needs);
        let mut of_memory = listener.take();
        assert!(
            of_memory
                .iter()
                .any(|it| it.binds && it.size_bytes >= needs.size)
        );
        assert!(of_memory.iter().all(|it| it.flags == INTERNAL));
        gpu.device.bind_buffer_memory(buffer, memory, 0).unwrap();
        let address = vk::BufferDeviceAddressInfo::default().buffer(buffer);
        let address = gpu.device.get_buffer_device_address(&address);
        gpu.device.destroy_buffer(buffer, None);
        got_and_lost(&gpu, &listener.take_of(buffer), NO_FLAGS, address, 1000);
        gpu.device.free_memory(memory, None);
        of_memory.extend(listener.take());
        all_lost(&of_memory);
        if gpu.is_tuff() {
            let object = (vk::ObjectType::DEVICE_MEMORY, memory.as_raw());
            got_and_lost(&gpu, &of_memory, INTERNAL, address, needs.size);
            assert!(of_memory.iter().all(|it| it.object == object));
        }
    }
}

/// Buffers that are never bound have no addresses, and sparse ones have theirs before they are
/// bound.
#[test]
fn sparse_and_unbound_buffers() {
    let Some((gpu, listener)) = open() else {
        return;
    };
    let info = vk::BufferCreateInfo::default()
        .size(1 << 20)
        .usage(vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS);
    // SAFETY: the handles are of this device, and destroyed once.
    unsafe {
        let buffer = gpu.device.create_buffer(&info, None).unwrap();
        gpu.device.destroy_buffer(buffer, None);
        gpu.device.destroy_buffer(vk::Buffer::null(), None);
        assert_eq!(listener.take(), []);
        if !has("sparseBinding", gpu.features.sparse_binding == vk::TRUE) {
            return;
        }
        let info = info.flags(vk::BufferCreateFlags::SPARSE_BINDING);
        let buffer = gpu.device.create_buffer(&info, None).unwrap();
        let address = vk::BufferDeviceAddressInfo::default().buffer(buffer);
        let address = gpu.device.get_buffer_device_address(&address);
        gpu.device.destroy_buffer(buffer, None);
        got_and_lost(&gpu, &listener.take_of(buffer), INTERNAL, address, 1 << 20);
    }
}

fn image_info<'a>(format: vk::Format) -> vk::ImageCreateInfo<'a> {
    flat_info(format, 64, 32).usage(vk::ImageUsageFlags::SAMPLED)
}

#[test]
fn images_are_told() {
    let Some((gpu, listener)) = open() else {
        return;
    };
    let info = image_info(vk::Format::R8G8B8A8_UNORM);
    // SAFETY: the handles are of this device, and destroyed once.
    unsafe {
        let image = gpu.device.create_image(&info, None).unwrap();
        let needs = gpu.device.get_image_memory_requirements(image);
        let memory = allocate(&gpu, needs);
        listener.take();
        gpu.device.bind_image_memory(image, memory, 0).unwrap();
        gpu.device.destroy_image(image, None);
        let told = listener.take_of(image);
        gpu.device.free_memory(memory, None);
        let of_memory = listener.take();
        all_lost(&told);
        let bound = told.iter().find(|it| it.binds).expect("it was bound");
        assert!(bound.size_bytes >= 64 * 32 * 4 && bound.flags == NO_FLAGS);
        if gpu.is_tuff() {
            assert_eq!(bound.address, of_memory[0].address);
        }
    }
}

/// Each plane of a disjoint image has addresses of its own.
#[test]
fn disjoint_planes_are_told() {
    let Some((gpu, listener)) = open() else {
        return;
    };
    let format = vk::Format::G8_B8R8_2PLANE_420_UNORM;
    // SAFETY: the handles are of this device, and destroyed once.
    unsafe {
        let properties = gpu
            .instance
            .get_physical_device_format_properties(gpu.physical, format);
        let features = properties.optimal_tiling_features;
        if !has(
            "disjoint planes",
            features.contains(vk::FormatFeatureFlags::DISJOINT),
        ) {
            return;
        }
        let info = image_info(format).flags(vk::ImageCreateFlags::DISJOINT);
        let image = gpu.device.create_image(&info, None).unwrap();
        let aspects = [vk::ImageAspectFlags::PLANE_0, vk::ImageAspectFlags::PLANE_1];
        let mut memories = Vec::new();
        for aspect in aspects {
            let mut plane = vk::ImagePlaneMemoryRequirementsInfo::default().plane_aspect(aspect);
            let of = vk::ImageMemoryRequirementsInfo2::default()
                .image(image)
                .push_next(&mut plane);
            let mut needs = vk::MemoryRequirements2::default();
            gpu.device.get_image_memory_requirements2(&of, &mut needs);
            memories.push(allocate(&gpu, needs.memory_requirements));
        }
        listener.take();
        let mut planes =
            aspects.map(|aspect| vk::BindImagePlaneMemoryInfo::default().plane_aspect(aspect));
        let binds: Vec<_> = (planes.iter_mut().zip(&memories))
            .map(|(plane, &memory)| {
                vk::BindImageMemoryInfo::default()
                    .image(image)
                    .memory(memory)
                    .push_next(plane)
            })
            .collect();
        gpu.device.bind_image_memory2(&binds).unwrap();
        gpu.device.destroy_image(image, None);
        let told = listener.take_of(image);
        all_lost(&told);
        let bound: Vec<_> = told.iter().filter(|it| it.binds).collect();
        assert_eq!(bound.len(), 2);
        assert!(bound[0].size_bytes >= 64 * 32 && bound[1].size_bytes >= 64 * 32 / 2);
        assert_ne!(bound[0].address, bound[1].address);
        for memory in memories {
            gpu.device.free_memory(memory, None);
        }
    }
}

/// Objects in buffers: whether those are told of is left open, but what is told must be right.
#[test]
fn structures_are_told() {
    let Some((gpu, listener)) = open() else {
        return;
    };
    let there = gpu.structure_properties.max_instance_count > 0;
    if !has("VK_KHR_acceleration_structure", there) {
        return;
    }
    let level = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
    let structure = gpu.empty_structure(level, 4096);
    gpu.destroy(structure);
    let told = listener.take_of(structure.handle);
    all_lost(&told);
    if gpu.is_tuff() {
        got_and_lost(&gpu, &told, INTERNAL, structure.address, 4096);
    }
    if has(
        "VK_EXT_opacity_micromap",
        gpu.optional.micromap.micromap == vk::TRUE,
    ) {
        let micromap = gpu.empty_micromap(4096);
        let told = listener.take_of(micromap);
        assert!(
            told.iter()
                .all(|it| it.binds && it.flags == INTERNAL && it.size_bytes == 4096)
        );
        assert_eq!(told.len(), gpu.is_tuff() as usize);
    }
}

#[test]
fn structures_with_memory_of_their_own_are_told() {
    let Some((gpu, listener)) = open() else {
        return;
    };
    if !has("VK_NV_ray_tracing", gpu.nv_ray_tracing.is_some()) {
        return;
    }
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let structure = gpu.bottom_nv(&[Geometry::opaque(&corners)]);
    let told = listener.take_of(structure.handle);
    assert!(told.iter().all(|it| it.binds && it.flags == NO_FLAGS));
    assert_eq!(told.len(), 1);
}

/// Images of swapchains have addresses before the application has their handles.
#[test]
fn swapchain_images_are_told() {
    let presenter = Presenter::new(ext::headless_surface::NAME, |entry, instance| {
        let surfaces = ext::headless_surface::Instance::new(entry, instance);
        let info = vk::HeadlessSurfaceCreateInfoEXT::default();
        // SAFETY: `info` outlives the call.
        unsafe { surfaces.create_headless_surface(&info, None) }.unwrap()
    });
    let Some(presenter) = presenter else { return };
    if !presenter.extends(ext::device_address_binding_report::NAME) {
        return;
    }
    let listener = Listener::new(&presenter.entry, &presenter.instance);
    let swapchain = presenter.swapchain(&Chain::of(64, 32)).unwrap();
    // SAFETY: the swapchain is of this device.
    let images = unsafe { presenter.swapchains.get_swapchain_images(swapchain) }.unwrap();
    presenter.destroy(swapchain);
    let told = listener.take();
    all_lost(&told);
    for image in images {
        let object = (vk::ObjectType::IMAGE, image.as_raw());
        let of = |it: &&BindingReport| it.object == object && it.binds;
        let bound = told.iter().find(of).expect("it has memory");
        assert!(bound.flags == INTERNAL && bound.size_bytes >= 64 * 32 * 4);
    }
}

/// A device without the feature tells nothing.
#[test]
fn silent_without_the_feature() {
    let Some((gpu, listener)) = open() else {
        return;
    };
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(gpu.family)
        .queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
    // SAFETY: the handles are of this device, and destroyed once.
    unsafe {
        let device = gpu
            .instance
            .create_device(gpu.physical, &info, None)
            .unwrap();
        listener.take();
        let info = vk::MemoryAllocateInfo::default().allocation_size(4096);
        let memory = device.allocate_memory(&info, None).unwrap();
        device.free_memory(memory, None);
        device.destroy_device(None);
    }
    assert_eq!(listener.take(), []);
}
