//! "Call twice": first for the count, then for the elements.

use ash::vk;

use crate::VkResult;

/// Answers an enumeration: the count if `out` is null, else as many elements as fit.
///
/// # Errors
/// `VK_INCOMPLETE` if not all fit.
///
/// # Safety
/// `count` is valid; `out` is null or has room for `*count` elements.
pub unsafe fn enumerate<T>(
    count: *mut u32,
    out: *mut T,
    items: impl ExactSizeIterator<Item = T>,
) -> VkResult {
    // SAFETY: the caller guarantees that `count` is valid; `out` is null or has room for `*count`
    // elements. Elements are written whole, over memory that may be uninitialised.
    unsafe {
        if out.is_null() {
            *count = items.len() as u32;
            return Ok(());
        }
        let total = items.len() as u32;
        let fit = total.min(*count);
        for (index, item) in items.take(fit as usize).enumerate() {
            out.add(index).write(item);
        }
        *count = fit;
        if fit < total {
            Err(vk::Result::INCOMPLETE)
        } else {
            Ok(())
        }
    }
}

/// As [`enumerate`], for structures that carry a `pNext` chain of the caller's: `fill` writes each
/// in place.
///
/// # Errors
/// `VK_INCOMPLETE` if not all fit.
///
/// # Safety
/// As [`enumerate`]; the elements are initialised.
pub unsafe fn enumerate_with<T, I>(
    count: *mut u32,
    out: *mut T,
    items: impl ExactSizeIterator<Item = I>,
    mut fill: impl FnMut(&mut T, I),
) -> VkResult {
    // SAFETY: the caller keeps the promises of `enumerate`, and guarantees that the elements are
    // initialised.
    unsafe {
        let total = items.len() as u32;
        if out.is_null() {
            *count = total;
            return Ok(());
        }
        let fit = total.min(*count);
        for (index, item) in items.take(fit as usize).enumerate() {
            fill(&mut *out.add(index), item);
        }
        *count = fit;
        if fit < total {
            Err(vk::Result::INCOMPLETE)
        } else {
            Ok(())
        }
    }
}

/// Answers a query for opaque bytes (`vkGetPipelineCacheData`): the size if `out` is null, else
/// what `data` gives for the room there is, and whether that is all.
///
/// # Errors
/// `VK_INCOMPLETE` if it is not.
///
/// # Safety
/// `size` is valid; `out` is null or has room for `*size` bytes.
pub unsafe fn enumerate_bytes(
    size: *mut usize,
    out: *mut u8,
    data: impl FnOnce(usize) -> (Vec<u8>, bool),
) -> VkResult {
    // SAFETY: the caller guarantees that `size` is valid; `out` is null or has room for `*size`
    // bytes.
    unsafe {
        if out.is_null() {
            *size = data(usize::MAX).0.len();
            return Ok(());
        }
        let (bytes, all) = data(*size);
        out.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len().min(*size));
        *size = bytes.len();
        if all {
            Ok(())
        } else {
            Err(vk::Result::INCOMPLETE)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_then_fills_then_truncates() {
        let items = [7u32, 8, 9];
        let mut count = 0;
        let mut out = [0u32; 3];
        // SAFETY: `out` has room for `count` elements each time.
        unsafe {
            assert!(enumerate(&mut count, std::ptr::null_mut(), items.iter().copied()).is_ok());
            assert_eq!(count, 3);
            assert!(enumerate(&mut count, out.as_mut_ptr(), items.iter().copied()).is_ok());
            assert_eq!(out, items);
            count = 2;
            assert!(
                enumerate(&mut count, out.as_mut_ptr(), items.iter().copied())
                    == Err(vk::Result::INCOMPLETE)
            );
            assert_eq!(count, 2);
        }
    }
}
