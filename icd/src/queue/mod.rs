//! Queues: each has a thread that waits, executes, signals.

/// `VkQueue`.
pub struct Queue {
    pub index: u32,
}
