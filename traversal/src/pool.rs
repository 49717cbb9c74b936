//! The thread pool that a caller may have.
#![forbid(unsafe_code)]

/// Whether work may be spread: never start the global pool.
pub(crate) fn in_pool() -> bool {
    rayon::current_thread_index().is_some()
}
