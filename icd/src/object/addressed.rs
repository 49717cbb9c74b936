//! `VK_EXT_device_address_binding_report`: objects that have device addresses, and who hears of
//! them.

use std::ffi::CString;
use std::sync::Arc;

use ash::vk::{self, Handle};
use smallvec::SmallVec;
use spirv_jit::reach::Range;

use super::acceleration_structure::Storage;
use super::messenger::Messengers;
use super::{
    AccelerationStructure, AccelerationStructureNv, Buffer, DeviceMemory, Image, Micromap,
};

/// An object that has device addresses. Shaders cannot reach other objects by address.
pub trait Addressed {
    /// The object's current ranges; a disjoint image has one for each bound plane.
    fn ranges(&self) -> SmallVec<[Range; 1]>;
}

impl From<Storage> for Range {
    fn from(storage: Storage) -> Self {
        Self {
            start: storage.address,
            size_bytes: storage.size_bytes,
        }
    }
}

/// The range, unless the object is unbound.
fn bound(range: Range) -> SmallVec<[Range; 1]> {
    (range.start != 0).then_some(range).into_iter().collect()
}

impl Addressed for DeviceMemory {
    fn ranges(&self) -> SmallVec<[Range; 1]> {
        bound(Range {
            start: self.address,
            size_bytes: self.size_bytes,
        })
    }
}

impl Addressed for Buffer {
    fn ranges(&self) -> SmallVec<[Range; 1]> {
        bound(Range {
            start: self.address(),
            size_bytes: self.size_bytes,
        })
    }
}

impl Addressed for Image {
    fn ranges(&self) -> SmallVec<[Range; 1]> {
        self.bound_ranges().collect()
    }
}

impl Addressed for AccelerationStructure {
    fn ranges(&self) -> SmallVec<[Range; 1]> {
        bound(self.storage().into())
    }
}

impl Addressed for AccelerationStructureNv {
    fn ranges(&self) -> SmallVec<[Range; 1]> {
        self.structure.ranges()
    }
}

impl Addressed for Micromap {
    fn ranges(&self) -> SmallVec<[Range; 1]> {
        bound(self.storage().into())
    }
}

/// An event of an object's addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AddressEvent {
    /// Reported at creation, before the application has the handle.
    Created,
    Bound,
    /// Reported before the object is destroyed.
    Unbound,
}

/// The callbacks that are notified of the addresses of objects.
pub struct AddressReport(Arc<Messengers>);

impl AddressReport {
    pub fn new(messengers: Arc<Messengers>) -> Self {
        Self(messengers)
    }

    /// Reports an object's ranges, with one message for each
    /// (`VkDeviceAddressBindingCallbackDataEXT`).
    pub fn tell<H: Handle + Copy>(
        &self,
        object: H,
        event: AddressEvent,
        ranges: impl IntoIterator<Item = Range>,
    ) {
        let severity = vk::DebugUtilsMessageSeverityFlagsEXT::INFO;
        let types = vk::DebugUtilsMessageTypeFlagsEXT::DEVICE_ADDRESS_BINDING;
        if !self.0.hear(severity, types) {
            return;
        }
        let (binding_type, flags) = match event {
            AddressEvent::Created => (
                vk::DeviceAddressBindingTypeEXT::BIND,
                vk::DeviceAddressBindingFlagsEXT::INTERNAL_OBJECT,
            ),
            AddressEvent::Bound => (
                vk::DeviceAddressBindingTypeEXT::BIND,
                vk::DeviceAddressBindingFlagsEXT::empty(),
            ),
            AddressEvent::Unbound => (
                vk::DeviceAddressBindingTypeEXT::UNBIND,
                vk::DeviceAddressBindingFlagsEXT::empty(),
            ),
        };
        let handle = object.as_raw();
        let objects = [vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object)];
        for Range { start, size_bytes } in ranges {
            let verb = match event {
                AddressEvent::Created | AddressEvent::Bound => "gets",
                AddressEvent::Unbound => "loses",
            };
            let text = format!(
                "{:?} {handle:#x} {verb} the addresses {start:#x} to {:#x}",
                H::TYPE,
                start + size_bytes
            );
            let text = CString::new(text).unwrap_or_default();
            let mut binding = vk::DeviceAddressBindingCallbackDataEXT::default()
                .flags(flags)
                .base_address(start)
                .size(size_bytes)
                .binding_type(binding_type);
            let data = vk::DebugUtilsMessengerCallbackDataEXT::default()
                .message_id_name(c"TUFF-address-binding")
                .message(&text)
                .objects(&objects)
                .push_next(&mut binding);
            self.0.forward(severity, types, &data);
        }
    }
}
