//! Threads.

/// The system's name of the calling thread; `None` if it is unknown.
pub fn name() -> Option<String> {
    std::fs::read_to_string("/proc/thread-self/comm").ok()
}
