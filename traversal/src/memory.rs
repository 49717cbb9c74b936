//! Memory of the caller's, and types of indices in it.

/// Readable memory of the caller.
///
/// Reads outside it are not made: an index or a primitive that would need one is inactive.
#[derive(Clone, Copy, Debug)]
pub struct Memory {
    /// First byte; any alignment.
    pub base: *const u8,
    /// Number of readable bytes.
    pub bytes: usize,
}

// SAFETY: `Memory` is only read, inside functions whose contract says that nothing writes it
// meanwhile.
unsafe impl Send for Memory {}

// SAFETY: `Memory` is only read, inside functions whose contract says that nothing writes it
// meanwhile.
unsafe impl Sync for Memory {}

impl Memory {
    /// The `N` bytes at `offset`, if they are inside.
    ///
    /// # Safety
    /// The memory must be readable and unchanged.
    #[inline]
    pub(crate) unsafe fn read<const N: usize>(&self, offset: u64) -> Option<[u8; N]> {
        // SAFETY: the caller guarantees that the memory is readable and unchanged.
        unsafe { self.read_integers(offset) }
    }

    /// The `N` integers at `offset` bytes, as they lie there, if they are inside.
    ///
    /// # Safety
    /// The memory must be readable and unchanged, and `T` an integer.
    #[inline(always)]
    pub(crate) unsafe fn read_integers<const N: usize, T: Copy>(
        &self,
        offset: u64,
    ) -> Option<[T; N]> {
        let end = offset.checked_add(size_of::<[T; N]>() as u64)?;
        if end > self.bytes as u64 {
            return None;
        }
        // SAFETY: inside the memory.
        Some(unsafe {
            self.base
                .add(offset as usize)
                .cast::<[T; N]>()
                .read_unaligned()
        })
    }
}

/// Type of the indices of a triangle geometry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum IndexType {
    /// Vertices `3 i`, `3 i + 1`, `3 i + 2` form triangle `i`.
    None,
    U8,
    U16,
    U32,
}
