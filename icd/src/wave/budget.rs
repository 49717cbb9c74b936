//! The memory budget of all invocations in flight on a device: endless recursion loses the device
//! instead of exhausting the machine's memory.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::fault::Stopped;
use crate::os::memory;

/// Bytes that a share grows by, at the least: the counter that all workers use is touched seldom.
const SHARE_STEP: usize = 1 << 20;

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

    /// Returns bytes to the budget.
    pub fn give_back(&self, bytes: usize) {
        self.left.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// Bytes of a device's budget that one worker holds for its invocations in flight. They go back
/// when it is dropped.
#[derive(Default)]
pub struct Share {
    /// Where the bytes come from; `None` while there are none.
    budget: Option<Arc<Budget>>,
    bytes: usize,
}

impl Share {
    /// Makes the share at least `bytes` large.
    ///
    /// # Errors
    /// `OutOfMemory` when the budget has not that much left; the share stays as it is.
    #[inline]
    pub fn grow_to(&mut self, bytes: usize, budget: &Arc<Budget>) -> Result<(), Stopped> {
        match bytes.checked_sub(self.bytes) {
            None | Some(0) => Ok(()),
            Some(missing) => self.grow_by(missing.next_multiple_of(SHARE_STEP), budget),
        }
    }

    #[cold]
    fn grow_by(&mut self, bytes: usize, budget: &Arc<Budget>) -> Result<(), Stopped> {
        let from = self.budget.get_or_insert_with(|| Arc::clone(budget));
        debug_assert!(Arc::ptr_eq(from, budget), "a share of two devices");
        if !from.take(bytes) {
            return Err(Stopped::OutOfMemory);
        }
        self.bytes += bytes;
        Ok(())
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Gives all bytes back.
    pub fn give_back(&mut self) {
        if let Some(budget) = self.budget.take() {
            budget.give_back(std::mem::take(&mut self.bytes));
        }
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.give_back();
    }
}

impl Default for Budget {
    /// Two gibibytes, on a small machine a quarter of its memory.
    fn default() -> Self {
        const MOST: usize = 2 << 30;
        let bytes = memory::total_bytes().and_then(|total| usize::try_from(total / 4).ok());
        Self::new(bytes.unwrap_or(MOST).min(MOST))
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

    #[test]
    fn a_share_takes_steps_and_gives_all_back() {
        let budget = Arc::new(Budget::new(3 * SHARE_STEP));
        let mut first = Share::default();
        assert_eq!(first.grow_to(1, &budget), Ok(()));
        assert_eq!(first.grow_to(SHARE_STEP, &budget), Ok(()));
        assert_eq!(first.bytes(), SHARE_STEP);
        let mut second = Share::default();
        let too_much = second.grow_to(2 * SHARE_STEP + 1, &budget);
        assert_eq!(too_much, Err(Stopped::OutOfMemory));
        assert_eq!(second.bytes(), 0);
        assert_eq!(second.grow_to(2 * SHARE_STEP, &budget), Ok(()));
        first.give_back();
        assert!(budget.take(SHARE_STEP) && !budget.take(1));
        drop(second);
        assert!(budget.take(2 * SHARE_STEP) && !budget.take(1));
    }
}
