//! The physical device: this machine.

use std::sync::Arc;

use lanes::Tier;

use super::memory;
use super::messenger::Messengers;
use crate::capabilities::extensions::ExtensionSet;
use crate::capabilities::properties::Machine;
use crate::os::{self, quota::Quota};
use crate::settings;

/// The one physical device of an instance.
pub struct PhysicalDevice {
    /// The version of Vulkan that the application asked for.
    pub api_version: u32,
    pub messengers: Arc<Messengers>,
    pub instance_extensions: ExtensionSet,
    /// Worker threads of a device.
    pub thread_count: usize,
    /// Size of the memory heap.
    pub heap_bytes: u64,
    /// The limits of the process's memory.
    quota: Quota,
}

impl PhysicalDevice {
    /// Inspects the machine. After this and the creation of a device the driver opens no more
    /// files, since a sandbox may refuse that.
    pub fn new(
        api_version: u32,
        messengers: Arc<Messengers>,
        instance_extensions: ExtensionSet,
    ) -> Self {
        let quota = Quota::open();
        Self {
            api_version,
            messengers,
            instance_extensions,
            thread_count: thread_count(),
            heap_bytes: heap_bytes(&quota),
            quota,
        }
    }

    /// The heap budget of this process: its used bytes plus the free bytes of the system and its
    /// control group, up to the heap's size.
    pub fn budget_bytes(&self) -> u64 {
        let free = os::memory::free_bytes().unwrap_or(0);
        let free = self
            .quota
            .memory()
            .map_or(free, |quota| free.min(quota.free_bytes));
        (memory::used_bytes() + free).min(self.heap_bytes)
    }

    /// Facts about this machine that the properties report.
    pub fn machine(&self) -> Machine {
        Machine {
            device_name: self.name(),
            heap_bytes: self.heap_bytes,
        }
    }

    /// The device's name, with the properties that determine its speed.
    pub fn name(&self) -> String {
        // A valid limit from the environment applies from now on.
        let _ = settings::checked();
        let threads = self.thread_count;
        let plural = if threads == 1 { "" } else { "s" };
        format!(
            "Tuff ({threads} thread{plural}, {})",
            Tier::best().instruction_set()
        )
    }
}

/// `TUFF_THREADS`, or the processors that the process can keep busy.
fn thread_count() -> usize {
    let asked = settings::checked()
        .ok()
        .and_then(|settings| settings.threads);
    asked.unwrap_or_else(os::processors::count)
}

/// Three quarters of the memory that the process may use: the machine's, or its control group's
/// where that has less.
fn heap_bytes(quota: &Quota) -> u64 {
    let total = os::memory::total_bytes().unwrap_or(0);
    let total = quota
        .memory()
        .map_or(total, |quota| total.min(quota.limit_bytes));
    (total / 4 * 3).max(1 << 20) & !((1 << 20) - 1)
}
