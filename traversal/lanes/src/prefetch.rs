//! Hints to fetch memory ahead of its use.

/// Bytes of a cache line.
const LINE_BYTES: usize = 64;

/// Asks for the cache lines of a value that is read soon.
#[inline(always)]
pub fn prefetch<T>(value: &T) {
    let address = std::ptr::from_ref(value).cast::<i8>();
    for offset in (0..size_of::<T>()).step_by(LINE_BYTES) {
        prefetch_line(address.wrapping_add(offset));
    }
    // A value that does not start at a line's start may end in one line more.
    if size_of::<T>() > align_of::<T>() {
        prefetch_line(address.wrapping_add(size_of::<T>() - 1));
    }
}

/// Asks for a number of cache lines from an address on, which need not be valid.
#[inline(always)]
pub fn prefetch_lines<T>(address: *const T, count: usize) {
    let address = address.cast::<i8>();
    for line in 0..count {
        prefetch_line(address.wrapping_add(LINE_BYTES * line));
    }
}

/// Asks for the cache line of an address that is read or written soon. The address need not be
/// valid.
#[inline(always)]
pub fn prefetch_line<T>(address: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a hint; addresses need not be valid.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(address.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}
