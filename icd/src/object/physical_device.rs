//! The physical device: this machine.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::instance::Messengers;

/// The one physical device of an instance.
pub struct PhysicalDevice {
    pub messengers: Arc<Messengers>,
    /// Threads that a device's commands fan out over.
    pub thread_count: usize,
    /// Size of the memory heap.
    pub heap_bytes: u64,
    /// What the devices' allocations take together.
    pub used: Arc<AtomicU64>,
}

impl PhysicalDevice {
    /// Looks at the machine.
    pub fn new(messengers: Arc<Messengers>) -> Self {
        Self {
            messengers,
            thread_count: thread_count(),
            heap_bytes: heap_bytes(),
            used: Arc::default(),
        }
    }

    /// Bytes of the heap in use (`VK_EXT_memory_budget`).
    pub fn used_bytes(&self) -> u64 {
        self.used.load(Ordering::Relaxed)
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
        (self.used_bytes() + free).min(self.heap_bytes)
    }

    /// The device's name, with what decides its speed.
    pub fn name(&self) -> String {
        let threads = self.thread_count;
        let plural = if threads == 1 { "" } else { "s" };
        format!("Tuff ({threads} thread{plural}, {})", simd_level())
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

/// The vector instructions that programs run with.
fn simd_level() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
        {
            return "AVX-512";
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return "AVX2";
        }
        "SSE2"
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        if cfg!(target_arch = "aarch64") {
            "NEON"
        } else {
            "scalar"
        }
    }
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
