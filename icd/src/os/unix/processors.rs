//! Processor count and thread affinity (sched_setaffinity(2)).

/// Processors that the process can keep busy: those of its affinity mask, and no more than its
/// quota of processor time pays for. At least one.
pub fn count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// A bit for each processor: as many as `cpu_set_t` has room for.
type Processors = [u64; size_of::<libc::cpu_set_t>() / 8];

/// The processors that a thread may run on. Nothing on machines that have more of them than the
/// system's type has bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Affinity(Option<Processors>);

impl Affinity {
    /// That of the calling thread.
    pub fn of_this_thread() -> Self {
        let mut processors: Processors = Default::default();
        // SAFETY: the call writes no more bytes than it is told that there are, and any bits are a
        // number.
        let found = unsafe {
            let set = (&raw mut processors).cast();
            libc::sched_getaffinity(0, size_of::<Processors>(), set)
        };
        Self((found == 0).then_some(processors))
    }

    /// Gives it to the calling thread, if that has another one. A thread stays where it is if the
    /// system refuses.
    pub fn apply(&self) {
        let Some(processors) = &self.0 else { return };
        if *self != Self::of_this_thread() {
            // SAFETY: the call reads as many bytes as it is told that there are.
            unsafe {
                let set = std::ptr::from_ref(processors).cast();
                libc::sched_setaffinity(0, size_of::<Processors>(), set);
            }
        }
    }

    /// The first of its processors alone.
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
