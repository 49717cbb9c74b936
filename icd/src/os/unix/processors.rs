//! Processor count and thread affinity (sched_setaffinity(2)).

/// The number of processors that the process can use: those of its affinity mask, limited by its
/// quota of processor time. At least one.
pub fn count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// A bit for each processor, as in `cpu_set_t`.
type Processors = [u64; size_of::<libc::cpu_set_t>() / 8];

/// The processors on which a thread may run. Empty on machines with more processors than the
/// system's type has bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Affinity(Option<Processors>);

impl Affinity {
    /// The affinity of the calling thread.
    pub fn of_this_thread() -> Self {
        let mut processors: Processors = Default::default();
        // SAFETY: the call writes at most the given number of bytes, and any bits are valid.
        let found = unsafe {
            let set = (&raw mut processors).cast();
            libc::sched_getaffinity(0, size_of::<Processors>(), set)
        };
        Self((found == 0).then_some(processors))
    }

    /// Applies the affinity to the calling thread, if it differs. If the system refuses, the thread
    /// keeps its affinity.
    pub fn apply(&self) {
        let Some(processors) = &self.0 else { return };
        if *self != Self::of_this_thread() {
            // SAFETY: the call reads the given number of bytes.
            unsafe {
                let set = std::ptr::from_ref(processors).cast();
                libc::sched_setaffinity(0, size_of::<Processors>(), set);
            }
        }
    }

    /// The affinity with only its first processor.
    #[cfg(test)]
    pub fn first(&self) -> Self {
        let mut is_found = false;
        Self(self.0.map(|processors| {
            processors.map(|bits| {
                let first = if is_found {
                    0
                } else {
                    bits & bits.wrapping_neg()
                };
                is_found |= bits != 0;
                first
            })
        }))
    }
}
