//! This library in its process.

/// Keeps the library loaded until the process ends: threads and destructors of thread-local values
/// may outlive the last `dlclose`. The linker's option `-z nodelete` does it (`build.rs`).
pub fn keep_loaded() {}
