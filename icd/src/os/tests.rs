//! The contract of every system.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::address_space::{
    commit, discard, is_mapped, release, replace_by_zeros, reserve, reserve_at,
};
use super::clock::Clock;
use super::event::Event;
use super::handle::Sharing;
use super::section::Section;

/// At least a page of the system.
const SIZE: u64 = 64 << 10;

fn word(address: u64) -> *mut u64 {
    address as *mut u64
}

#[test]
fn used_addresses_are_not_reserved_again() {
    let address = reserve(4 * SIZE, SIZE).unwrap();
    assert_eq!(reserve_at(address + SIZE, SIZE), None);
    assert!(is_mapped(address, 4 * SIZE));
    // SAFETY: the test's own mapping, which nothing else uses.
    unsafe { release(address, 4 * SIZE) };
    assert_eq!(reserve_at(address, 4 * SIZE), Some(address));
    // SAFETY: the test's own mapping, which nothing else uses.
    unsafe { release(address, 4 * SIZE) };
}

#[test]
fn alignments_larger_than_a_page_are_kept() {
    let address = reserve(SIZE, 16 * SIZE).unwrap();
    assert!(address.is_multiple_of(16 * SIZE), "{address:#x}");
    // SAFETY: the test's own mapping, which nothing else uses.
    unsafe { release(address, SIZE) };
}

#[test]
fn discarded_and_replaced_pages_read_as_zeros() {
    let address = reserve(4 * SIZE, SIZE).unwrap();
    let second = word(address + SIZE);
    // SAFETY: the test's own mapping, which nothing else uses.
    unsafe {
        // Memory that nothing was promised for.
        assert_eq!(second.read_volatile(), 0);
        second.write_volatile(7);
        assert_eq!(second.read_volatile(), 7);
        discard(address, 4 * SIZE);
        assert_eq!(second.read_volatile(), 0);
        assert!(commit(address, 3 * SIZE));
        second.write_volatile(7);
        discard(address, 3 * SIZE);
        assert_eq!(second.read_volatile(), 0);
        second.write_volatile(7);
        assert!(replace_by_zeros(address + SIZE, SIZE));
        assert_eq!(second.read_volatile(), 0);
        release(address, 4 * SIZE);
    }
}

#[test]
fn a_part_shows_at_several_addresses() {
    let places = reserve(4 * SIZE, SIZE).unwrap();
    let exportable = Section::exportable(2 * SIZE, &Sharing::default()).unwrap();
    for section in [Section::private(), exportable] {
        let alias = places + 3 * SIZE;
        // SAFETY: the test's own reservation, which nothing else uses.
        unsafe {
            assert!(section.map(places, 2 * SIZE));
            word(places + SIZE).write_volatile(7);
            assert!(section.alias(places, SIZE, SIZE, alias));
            assert_eq!(word(alias).read_volatile(), 7);
            word(alias).write_volatile(8);
            assert_eq!(word(places + SIZE).read_volatile(), 8);
            assert!(replace_by_zeros(alias, SIZE));
            assert_eq!(word(alias).read_volatile(), 0);
            assert_eq!(word(places + SIZE).read_volatile(), 8);
            assert!(replace_by_zeros(places, 2 * SIZE));
        }
    }
    // SAFETY: the test's own reservation, which nothing else uses.
    unsafe { release(places, 4 * SIZE) };
}

/// The parts around a replaced one keep what they show.
#[test]
fn a_mapping_is_replaced_in_parts() {
    let places = reserve(8 * SIZE, SIZE).unwrap();
    let (section, other) = (Section::private(), Section::private());
    let at = |part: u64| word(places + part * SIZE);
    // SAFETY: the test's own reservation, which nothing else uses.
    unsafe {
        assert!(section.map(places, 3 * SIZE) && other.map(places + 3 * SIZE, SIZE));
        (0..4).for_each(|part| at(part).write_volatile(part + 1));
        assert!(section.alias(places, 0, 3 * SIZE, places + 4 * SIZE));
        assert!(other.alias(places + 3 * SIZE, 0, SIZE, places + 5 * SIZE));
        let found = [4, 5, 6, 7].map(|part| at(part).read_volatile());
        assert_eq!(found, [1, 4, 3, 0]);
        assert!(replace_by_zeros(places + 4 * SIZE, SIZE));
        at(6).write_volatile(9);
        let found = [2, 4, 5, 6].map(|part| at(part).read_volatile());
        assert_eq!(found, [9, 0, 4, 9]);
        release(places, 8 * SIZE);
    }
}

/// Sparse binding replaces pages that running shaders read.
#[test]
fn accesses_to_a_range_that_is_replaced_meet_old_pages_or_new_ones() {
    let places = reserve(2 * SIZE, SIZE).unwrap();
    let section = Section::private();
    let alias = places + SIZE;
    let (is_over, reads) = (AtomicBool::new(false), AtomicU64::new(0));
    // SAFETY: the test's own reservation.
    unsafe {
        assert!(section.map(places, SIZE));
        word(places + 8).write_volatile(7);
    }
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                // SAFETY: mapped all the time.
                let found = unsafe { word(alias + 8).read_volatile() };
                assert!(found == 0 || found == 7, "{found}");
                reads.fetch_add(1, Ordering::Relaxed);
            }
        });
        let mut rounds = 0;
        while rounds < 500 || reads.load(Ordering::Relaxed) < 500 {
            // SAFETY: the test's own reservation; the thread bears it.
            unsafe {
                assert!(section.alias(places, 0, SIZE, alias));
                assert!(replace_by_zeros(alias, SIZE));
            }
            rounds += 1;
        }
        is_over.store(true, Ordering::Relaxed);
    });
    // SAFETY: the test's own reservation; the thread bears it.
    unsafe { release(places, 2 * SIZE) };
}

#[test]
fn a_signal_before_the_wait_is_heard_once() {
    let event = Event::new(false).unwrap();
    event.signal();
    assert!(!event.wait(None, None));
    let start = Instant::now();
    let deadline = start + Duration::from_millis(20);
    event.wait(Some(deadline), None);
    assert!(Instant::now() >= deadline);
}

#[test]
fn the_flag_is_shared_by_its_handles() {
    let event = Event::exportable(true, &Sharing::default()).unwrap();
    let other = Event::from_handle(event.export().unwrap());
    assert!(other.is_signaled());
    other.clear();
    assert!(!event.is_signaled());
    other.signal();
    other.signal();
    assert!(event.is_signaled());
    // A signaled event beside the wait ends it, and stays as it is.
    let bell = Event::new(false).unwrap();
    assert!(bell.wait(None, Some(event.handle().borrow())));
    assert!(event.is_signaled());
}

#[test]
fn the_clock_counts_nanoseconds() {
    let (start, instant) = (Clock::Monotonic.now_ns(), Instant::now());
    std::thread::sleep(Duration::from_millis(20));
    let passed = Clock::Monotonic.now_ns() - start;
    assert!(passed >= 19_000_000, "{passed}");
    assert!(u128::from(passed) <= instant.elapsed().as_nanos() + 1_000_000_000);
}
