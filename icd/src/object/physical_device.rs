//! The physical device: this machine.

use std::sync::Arc;

use spirv_jit::interp::TierKind;

use super::instance::Messengers;
use super::memory;
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
}

impl PhysicalDevice {
    /// Looks at the machine.
    pub fn new(
        api_version: u32,
        messengers: Arc<Messengers>,
        instance_extensions: ExtensionSet,
    ) -> Self {
        Self {
            api_version,
            messengers,
            instance_extensions,
            thread_count: thread_count(),
            heap_bytes: heap_bytes(),
        }
    }

    /// Bytes of the heap that this process can use: what it uses, and what the system has free, up to the heap's size.
    pub fn budget_bytes(&self) -> u64 {
        // SAFETY: plain system calls.
        let (pages, page_bytes) = unsafe {
            (
                libc::sysconf(libc::_SC_AVPHYS_PAGES),
                libc::sysconf(libc::_SC_PAGESIZE),
            )
        };
        let free = u64::try_from(pages).unwrap_or(0) * u64::try_from(page_bytes).unwrap_or(0);
        (memory::used_bytes() + free).min(self.heap_bytes)
    }

    /// What its properties say of this machine.
    pub fn machine(&self) -> Machine {
        Machine {
            device_name: self.name(),
            heap_bytes: self.heap_bytes,
        }
    }

    /// The device's name, with what decides its speed.
    fn name(&self) -> String {
        // The environment's limit, if it is a good one, binds from now on.
        let _ = settings::checked();
        let threads = self.thread_count;
        let plural = if threads == 1 { "" } else { "s" };
        format!(
            "Tuff ({threads} thread{plural}, {})",
            TierKind::best().instruction_set()
        )
    }
}

/// `TUFF_THREADS`, or what the system has.
fn thread_count() -> usize {
    std::env::var("TUFF_THREADS")
        .ok()
        .and_then(|text| text.parse().ok())
        .filter(|&count: &usize| (1..=1024).contains(&count))
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Three quarters of the machine's memory.
fn heap_bytes() -> u64 {
    // SAFETY: plain system calls.
    let (pages, page_bytes) = unsafe {
        (
            libc::sysconf(libc::_SC_PHYS_PAGES),
            libc::sysconf(libc::_SC_PAGESIZE),
        )
    };
    let total = u64::try_from(pages).unwrap_or(0) * u64::try_from(page_bytes).unwrap_or(0);
    (total / 4 * 3).max(256 << 20) & !((1 << 20) - 1)
}
