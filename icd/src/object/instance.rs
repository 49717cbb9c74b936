//! Instances.

use std::sync::Arc;

use super::PhysicalDevice;
use super::messenger::Messengers;
use crate::capabilities::extensions::ExtensionSet;
use crate::handle::Ref;

/// An instance. It has one physical device.
pub struct Instance {
    pub extensions: ExtensionSet,
    pub messengers: Arc<Messengers>,
    pub physical_device: Ref<PhysicalDevice>,
}
