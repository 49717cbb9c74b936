//! The physical device: this machine.

use std::sync::Arc;

use control_group::Groups;
use lanes::Tier;

use super::memory;
use super::messenger::Messengers;
use crate::settings;
use crate::table::extensions::ExtensionSet;
use crate::table::properties::Machine;

/// The one physical device of an instance.
pub struct PhysicalDevice {
    /// The version of Vulkan that the application asked for.
    pub api_version: u32,
    pub messengers: Arc<Messengers>,
    pub instance_extensions: ExtensionSet,
    /// Threads that a device's commands fan out over.
    pub thread_count: usize,
    /// Size of the memory heap.
    pub heap_bytes: u64,
    /// The limits of the process's memory.
    groups: Groups,
}

impl PhysicalDevice {
    /// Looks at the machine. After this and the creation of a device, no file is opened any more: a
    /// sandbox may refuse it.
    pub fn new(
        api_version: u32,
        messengers: Arc<Messengers>,
        instance_extensions: ExtensionSet,
    ) -> Self {
        let groups = Groups::open();
        Self {
            api_version,
            messengers,
            instance_extensions,
            thread_count: thread_count(),
            heap_bytes: heap_bytes(&groups),
            groups,
        }
    }

    /// Bytes of the heap that this process can use: what it uses, and what the system and its
    /// control group have free, up to the heap's size.
    pub fn budget_bytes(&self) -> u64 {
        let free = pages_bytes(libc::_SC_AVPHYS_PAGES);
        let free = self
            .groups
            .memory()
            .map_or(free, |group| free.min(group.free_bytes));
        (memory::used_bytes() + free).min(self.heap_bytes)
    }

    /// Facts about this machine that the properties report.
    pub fn machine(&self) -> Machine {
        Machine {
            device_name: self.name(),
            heap_bytes: self.heap_bytes,
        }
    }

    /// The device's name, with what decides its speed.
    pub fn name(&self) -> String {
        // The environment's limit, if it is a good one, binds from now on.
        let _ = settings::checked();
        let threads = self.thread_count;
        let plural = if threads == 1 { "" } else { "s" };
        format!(
            "Tuff ({threads} thread{plural}, {})",
            Tier::best().instruction_set()
        )
    }
}

/// `TUFF_THREADS`, or what the process may use: the processors of its affinity mask, and no more
/// than its control group's CPU quota pays for.
fn thread_count() -> usize {
    let asked = settings::checked()
        .ok()
        .and_then(|settings| settings.threads);
    asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Three quarters of the memory that the process may use: the machine's, or its control group's
/// where that has less.
fn heap_bytes(groups: &Groups) -> u64 {
    let total = pages_bytes(libc::_SC_PHYS_PAGES);
    let total = groups
        .memory()
        .map_or(total, |group| total.min(group.limit_bytes));
    (total / 4 * 3).max(1 << 20) & !((1 << 20) - 1)
}

/// The bytes of so many pages as the system answers to `name`.
fn pages_bytes(name: libc::c_int) -> u64 {
    // SAFETY: plain system calls.
    let (pages, page_bytes) = unsafe { (libc::sysconf(name), libc::sysconf(libc::_SC_PAGESIZE)) };
    u64::try_from(pages).unwrap_or(0) * u64::try_from(page_bytes).unwrap_or(0)
}
