//! Counted arrays and strings.

use std::ffi::{CStr, c_char, c_void};

use ash::vk;

/// A counted array as a slice; a null pointer or a count of zero is empty.
///
/// # Safety
/// `data` is null or points to `count` initialised elements that live and stay unwritten for `'a`.
pub unsafe fn slice<'a, T>(data: *const T, count: u32) -> &'a [T] {
    if data.is_null() || count == 0 {
        return &[];
    }
    // SAFETY: the caller guarantees that `data` is null or points to `count` initialised elements
    // that live and stay unwritten for `'a`.
    unsafe { std::slice::from_raw_parts(data, count as usize) }
}

/// Sized opaque data as a slice.
///
/// # Safety
/// `data` is null or points to `size_bytes` bytes that live and stay unwritten for `'a`.
pub unsafe fn bytes<'a>(data: *const c_void, size_bytes: usize) -> &'a [u8] {
    if data.is_null() || size_bytes == 0 {
        return &[];
    }
    // SAFETY: the caller guarantees that `data` is null or points to `size_bytes` bytes that live
    // and stay unwritten for `'a`.
    unsafe { std::slice::from_raw_parts(data.cast(), size_bytes) }
}

/// A counted output array as a slice.
///
/// # Safety
/// `data` is null or points to `count` elements that nothing else uses for `'a`.
pub unsafe fn slice_mut<'a, T>(data: *mut T, count: u32) -> &'a mut [T] {
    if data.is_null() || count == 0 {
        return &mut [];
    }
    // SAFETY: the caller guarantees that `data` is null or points to `count` elements that nothing
    // else uses for `'a`.
    unsafe { std::slice::from_raw_parts_mut(data, count as usize) }
}

/// A C string, or `""` if it is null.
///
/// # Safety
/// `text` is null or a NUL-terminated string that lives for `'a`.
pub unsafe fn string<'a>(text: *const c_char) -> &'a CStr {
    if text.is_null() {
        return c"";
    }
    // SAFETY: the caller guarantees that `text` is null or a NUL-terminated string that lives for
    // `'a`.
    unsafe { CStr::from_ptr(text) }
}

/// Copies text into a fixed C array of UTF-8, cut to fit between characters and NUL-terminated.
pub fn write_text<const N: usize>(out: &mut [c_char; N], text: &str) {
    out.fill(0);
    let end = text.floor_char_boundary(N - 1);
    for (to, from) in out.iter_mut().zip(text[..end].bytes()) {
        *to = from as c_char;
    }
}

/// Writes numbers to the application's memory, one each `stride_bytes`.
///
/// # Safety
/// `data` points to `data_bytes` bytes that may be written.
///
/// # Errors
/// They do not fit; those that do are written.
pub unsafe fn write_strided(
    values: impl Iterator<Item = u64>,
    data: *mut c_void,
    data_bytes: usize,
    stride_bytes: usize,
) -> Result<(), vk::Result> {
    for (index, value) in values.enumerate() {
        let offset = index * stride_bytes;
        if offset + size_of::<u64>() > data_bytes {
            return Err(vk::Result::ERROR_UNKNOWN);
        }
        // SAFETY: inside the bytes that the caller promises.
        unsafe { data.byte_add(offset).cast::<u64>().write_unaligned(value) };
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn null_is_empty() {
        // SAFETY: null pointers are allowed.
        unsafe {
            assert!(slice::<u32>(std::ptr::null(), 3).is_empty());
            assert!(string(std::ptr::null()).is_empty());
        }
    }

    #[test]
    fn long_text_is_cut_and_terminated() {
        let mut out = [1 as c_char; 4];
        write_text(&mut out, "abcdef");
        assert_eq!(out, [97, 98, 99, 0]);
        write_text(&mut out, "abé");
        assert_eq!(out, [97, 98, 0, 0]);
    }
}
