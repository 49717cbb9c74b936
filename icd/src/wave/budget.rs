//! The memory budget of all invocations in flight on a device: endless recursion loses the device
//! instead of exhausting the machine's memory.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes for all workers together.
pub struct Budget {
    left: AtomicUsize,
}

impl Budget {
    /// So many bytes.
    pub fn new(bytes: usize) -> Self {
        Self {
            left: AtomicUsize::new(bytes),
        }
    }

    /// Takes bytes, all of them or none.
    #[must_use]
    pub fn take(&self, bytes: usize) -> bool {
        let less = |left: usize| left.checked_sub(bytes);
        let taken = self
            .left
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
        taken.is_ok()
    }

    /// Gives back what was taken.
    pub fn give_back(&self, bytes: usize) {
        self.left.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// Gives freed memory back to the system, which the allocator would keep.
pub fn trim_heap() {
    // SAFETY: the call takes no pointer; it locks what it works on.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::malloc_trim(0);
    }
}

impl Default for Budget {
    /// Two gibibytes, on a small machine a quarter of its memory.
    fn default() -> Self {
        const MOST: usize = 2 << 30;
        // SAFETY: plain system calls.
        let [pages, page_bytes] =
            [libc::_SC_PHYS_PAGES, libc::_SC_PAGESIZE].map(|name| unsafe { libc::sysconf(name) });
        let bytes = usize::try_from(pages)
            .ok()
            .zip(usize::try_from(page_bytes).ok())
            .map_or(MOST, |(pages, page_bytes)| {
                pages.saturating_mul(page_bytes) / 4
            });
        Self::new(bytes.min(MOST))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_or_nothing() {
        let budget = Budget::new(10);
        assert!(budget.take(6));
        assert!(!budget.take(5));
        assert!(budget.take(4));
        budget.give_back(10);
        assert!(budget.take(10));
    }
}
