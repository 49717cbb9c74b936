//! Threads.

/// The name that the system has for the calling thread; `None` if it does not say.
pub fn name() -> Option<String> {
    std::fs::read_to_string("/proc/thread-self/comm").ok()
}
