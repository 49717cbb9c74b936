//! Addresses that commands are given, as far as there is memory at them: one that leads nowhere
//! gets no bytes, not a fault.

use spirv_jit::reach::Reach;
use traversal::{Live, Memory};

/// The bytes at an address that there are, of those that are wanted.
pub fn readable(reach: &Reach, address: u64, size_bytes: u64) -> Memory {
    Memory {
        base: address as *const u8,
        bytes: reach.clip(address, size_bytes) as usize,
    }
}

/// All of the bytes at an address, or none.
///
/// # Safety
/// The range is used by nothing else for `'a`.
pub unsafe fn writable<'a>(reach: &Reach, address: u64, size_bytes: u64) -> &'a mut [u8] {
    if size_bytes == 0 || !reach.contains(address, size_bytes) {
        return &mut [];
    }
    // SAFETY: there is memory, and the caller guarantees that the range is used by nothing else for
    // `'a`.
    unsafe { std::slice::from_raw_parts_mut(address as *mut u8, size_bytes as usize) }
}

/// As [`writable`], to read.
///
/// # Safety
/// Nothing writes the range for `'a`.
pub unsafe fn bytes<'a>(reach: &Reach, address: u64, size_bytes: u64) -> &'a [u8] {
    if size_bytes == 0 || !reach.contains(address, size_bytes) {
        return &[];
    }
    // SAFETY: there is memory, and the caller guarantees that nothing writes the range for `'a`.
    unsafe { std::slice::from_raw_parts(address as *const u8, size_bytes as usize) }
}

/// The reachable memory around an address, for a search in it.
///
/// # Safety
/// Reachable memory stays reachable during the look-up.
pub unsafe fn around(reach: &Reach, address: u64) -> Live {
    let range = reach.find(address);
    // SAFETY: the caller guarantees that reachable memory stays reachable during the look-up.
    unsafe { Live::new(range.map(|range| (range.start, range.size_bytes))) }
}

/// A value at an address of any alignment, if it is there.
///
/// # Safety
/// Any bytes will do for `T`, and nothing writes them meanwhile.
pub unsafe fn read<T: Copy>(reach: &Reach, address: u64) -> Option<T> {
    // SAFETY: there is memory, and the caller guarantees that any bytes are a valid `T`, and
    // nothing writes them meanwhile.
    reach
        .contains(address, size_of::<T>() as u64)
        .then(|| unsafe { std::ptr::read_unaligned(address as *const T) })
}
