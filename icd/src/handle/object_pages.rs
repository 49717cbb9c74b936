//! Which pages of memory hold objects of handles: a number can be looked up before it is followed.

use std::alloc::{Layout, alloc_zeroed, dealloc};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicPtr, AtomicU8, Ordering};

/// Bits of an address within a page. Where the system's pages are larger, theirs are several of
/// these.
const PAGE_BITS: u32 = 12;
/// Bits of an address within a span, a gibibyte.
const SPAN_BITS: u32 = 30;
/// Bits of the addresses that a process has.
const ADDRESS_BITS: u32 = 48;

/// The number of objects that begin in each page of a span. A page has no room for as many as a
/// byte could not count: each has two counts, a head and the allocator's word.
type Span = [AtomicU8; 1 << (SPAN_BITS - PAGE_BITS)];

/// The spans that ever held an object; they stay.
static SPANS: [AtomicPtr<Span>; 1 << (ADDRESS_BITS - SPAN_BITS)] =
    [const { AtomicPtr::new(std::ptr::null_mut()) }; 1 << (ADDRESS_BITS - SPAN_BITS)];

/// A placeholder for a span that could not be allocated: all of its pages may hold objects.
fn uncounted() -> *mut Span {
    NonNull::dangling().as_ptr()
}

fn place(address: usize) -> (Option<&'static AtomicPtr<Span>>, usize) {
    let page = address >> PAGE_BITS & ((1 << (SPAN_BITS - PAGE_BITS)) - 1);
    (SPANS.get(address >> SPAN_BITS), page)
}

/// The count of a page whose span has counts.
fn count(address: usize) -> Option<&'static AtomicU8> {
    let (span, page) = place(address);
    let span = span?.load(Ordering::Acquire);
    if span.is_null() || span == uncounted() {
        return None;
    }
    // SAFETY: spans that are neither were made by `note` and are never freed.
    Some(unsafe { &(*span)[page] })
}

/// An object begins at the address.
pub fn note(address: usize) {
    let (Some(span), _) = place(address) else {
        return;
    };
    if span.load(Ordering::Acquire).is_null() {
        let layout = Layout::new::<Span>();
        // SAFETY: the layout has a size, and zeros are counts.
        let new = unsafe { alloc_zeroed(layout) }.cast::<Span>();
        let found = if new.is_null() { uncounted() } else { new };
        let raced = (span.compare_exchange(
            std::ptr::null_mut(),
            found,
            Ordering::AcqRel,
            Ordering::Acquire,
        ))
        .is_err();
        if raced && !new.is_null() {
            // SAFETY: allocated above, and no other thread has seen it.
            unsafe { dealloc(new.cast(), layout) };
        }
    }
    if let Some(count) = count(address) {
        count.fetch_add(1, Ordering::Relaxed);
    }
}

/// The object that began at the address ends.
pub fn forget(address: usize) {
    if let Some(count) = count(address) {
        count.fetch_sub(1, Ordering::Relaxed);
    }
}

/// False where no object is: such a page may not even be mapped.
pub fn may_hold(address: usize) -> bool {
    match count(address) {
        Some(count) => count.load(Ordering::Relaxed) != 0,
        None => {
            let span = place(address).0.map(|span| span.load(Ordering::Relaxed));
            span == Some(uncounted())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_objects_as_long_as_they_were_noted() {
        // A span that no allocator uses: the second page of memory.
        let page = 1 << PAGE_BITS;
        assert!(!may_hold(page));
        note(page);
        note(page + 48);
        assert!(may_hold(page + 4095) && !may_hold(page - 1) && !may_hold(page + 4096));
        forget(page);
        assert!(may_hold(page));
        forget(page + 48);
        assert!(!may_hold(page));
        assert!(!may_hold(usize::MAX) && !may_hold(1 << ADDRESS_BITS));
    }
}
