//! Messages of `OpAbortKHR`, which end the work of a device.
//!
//! An invocation reserves room for its message, writes the message there as to a storage buffer,
//! and commits it. From the first commit on, [`Aborts::happened`] tells schedulers to stop.
//!
//! Each reservation is committed: an invocation that finds no room ends without a commit, and those
//! that took the room stop the device.

use std::cell::UnsafeCell;
use std::collections::TryReserveError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard};

use crate::descriptor::Descriptor;

/// Size of a message, at most (`maxShaderAbortMessageSize`).
pub const MAX_MESSAGE_BYTES: u64 = 1 << 16;

/// Room for messages. Those of one subgroup may fill it.
const POOL_BYTES: usize = 1 << 20;

/// A message's size in bytes stands before it in as many bytes, and it begins at a multiple of
/// them (`VkDeviceFaultShaderAbortMessageInfoKHR`).
const UNIT: usize = size_of::<u64>();

/// A place that no message has: see [`Aborts::reserve`].
pub const NO_PLACE: u32 = u32::MAX;

/// Bytes of the first messages of `all` that fit into so many bytes together.
pub fn whole_messages(all: &[u8], room_bytes: u64) -> usize {
    let mut end = 0usize;
    loop {
        let start = end.next_multiple_of(UNIT);
        let Some(&size) = all.get(start..).and_then(|rest| rest.first_chunk()) else {
            return end;
        };
        let next = (start + UNIT).saturating_add(u64::from_ne_bytes(size) as usize);
        if next > all.len() || next as u64 > room_bytes {
            return end;
        }
        end = next;
    }
}

/// The instruction that aborted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AbortedAt {
    /// The program, by its number.
    pub program: u64,
    /// Word offset of the instruction.
    pub source: u32,
}

/// The abort messages of a device.
pub struct Aborts {
    pool: Box<[UnsafeCell<u64>]>,
    /// Covers the pool.
    pub descriptor: Descriptor,
    happened: AtomicBool,
    state: Mutex<AbortState>,
}

#[derive(Default)]
struct AbortState {
    /// Units of the pool.
    used: usize,
    /// Committed messages as the application gets them. There is capacity for all of the pool.
    messages: Vec<u8>,
    first: Option<AbortedAt>,
    closed: bool,
}

// SAFETY: the pool is written at reserved places, each by one invocation, and as all memory of a
// device by whatever a shader forges; it is read at a commit.
unsafe impl Send for Aborts {}
// SAFETY: the pool is written at reserved places, each by one invocation, and as all memory of a
// device by whatever a shader forges; it is read at a commit.
unsafe impl Sync for Aborts {}

impl Aborts {
    /// Room for messages.
    ///
    /// # Errors
    /// There is no memory.
    pub fn new() -> Result<Self, TryReserveError> {
        let mut pool: Vec<UnsafeCell<u64>> = Vec::new();
        pool.try_reserve_exact(POOL_BYTES / UNIT)?;
        pool.resize_with(POOL_BYTES / UNIT, UnsafeCell::default);
        let pool = pool.into_boxed_slice();
        let mut state = AbortState::default();
        state.messages.try_reserve_exact(POOL_BYTES)?;
        let descriptor = Descriptor {
            address: pool.as_ptr() as u64,
            size_bytes: POOL_BYTES as u64,
            ..Descriptor::NULL
        };
        Ok(Self {
            pool,
            descriptor,
            happened: AtomicBool::new(false),
            state: Mutex::new(state),
        })
    }

    fn state(&self) -> MutexGuard<'_, AbortState> {
        self.state.lock().unwrap_or_else(|it| it.into_inner())
    }

    /// Reserves room for a message: its place in the pool in bytes, or [`NO_PLACE`].
    pub fn reserve(&self, size_bytes: u32) -> u32 {
        let units = 1 + (size_bytes as usize).div_ceil(UNIT);
        let mut state = self.state();
        let place = state.used;
        if units > self.pool.len() - place {
            return NO_PLACE;
        }
        state.used += units;
        // SAFETY: a unit of the pool, which this call alone has now.
        unsafe { self.pool[place].get().write(size_bytes.into()) };
        ((place + 1) * UNIT) as u32
    }

    /// Takes the message at a reserved place, which is complete.
    pub fn commit(&self, place: u32, at: AbortedAt) {
        let mut state = self.state();
        let Some(first) = (place as usize / UNIT).checked_sub(1) else {
            return;
        };
        let Some(pool) = self.pool.get(first..state.used).filter(|it| !it.is_empty()) else {
            return;
        };
        if !state.closed {
            // SAFETY: units of the pool; others are written meanwhile, not these.
            let size = unsafe { pool[0].get().read_volatile() };
            let bytes = size.min(((pool.len() - 1) * UNIT) as u64) as usize;
            let end = state.messages.len().next_multiple_of(UNIT);
            state.messages.resize(end, 0);
            state.messages.extend((bytes as u64).to_ne_bytes());
            let units = bytes.div_ceil(UNIT);
            for unit in &pool[1..1 + units] {
                // SAFETY: units of the pool; others are written meanwhile, not these.
                let word = unsafe { unit.get().read_volatile() };
                state.messages.extend(word.to_ne_bytes());
            }
            state.messages.truncate(end + UNIT + bytes);
            state.first.get_or_insert(at);
        }
        self.happened.store(true, Ordering::Release);
    }

    /// Whether a shader has aborted.
    #[inline]
    pub fn happened(&self) -> bool {
        self.happened.load(Ordering::Acquire)
    }

    /// The instruction of the first message.
    pub fn first(&self) -> Option<AbortedAt> {
        self.state().first
    }

    /// Takes no more messages: the device is lost.
    pub fn close(&self) {
        self.state().closed = true;
    }

    /// Calls a function with the messages so far: each with its size before it, from a multiple of
    /// 8 bytes on.
    pub fn with_messages<R>(&self, take: impl FnOnce(&[u8]) -> R) -> R {
        take(&self.state().messages)
    }
}

impl std::fmt::Debug for Aborts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Aborts")
            .field("happened", &self.happened())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: AbortedAt = AbortedAt {
        program: 3,
        source: 5,
    };

    fn write(aborts: &Aborts, place: u32, bytes: &[u8]) {
        let start = aborts.descriptor.address as *mut u8;
        // SAFETY: the place was reserved for as many bytes.
        unsafe {
            let to = start.add(place as usize);
            to.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
        }
    }

    #[test]
    fn messages_stand_behind_their_sizes() {
        let aborts = Aborts::new().unwrap();
        let places = [5, 0, 8].map(|size| aborts.reserve(size));
        write(&aborts, places[0], b"first");
        write(&aborts, places[2], b"a second");
        assert!(!aborts.happened());
        let after = AbortedAt { source: 9, ..AT };
        for (place, at) in [(places[2], AT), (places[1], after), (places[0], after)] {
            aborts.commit(place, at);
        }
        assert!(aborts.happened());
        assert_eq!(aborts.first(), Some(AT));
        let expected = [
            &8u64.to_ne_bytes()[..],
            b"a second",
            &0u64.to_ne_bytes(),
            &5u64.to_ne_bytes(),
            b"first",
        ]
        .concat();
        aborts.with_messages(|found| assert_eq!(found, expected));
        let fitting = [0, 15, 16, 24, 36, 37, 99].map(|room| whole_messages(&expected, room));
        assert_eq!(fitting, [0, 0, 16, 24, 24, 37, 37]);
    }

    #[test]
    fn the_pool_ends() {
        let aborts = Aborts::new().unwrap();
        let most = MAX_MESSAGE_BYTES as u32;
        let places: Vec<u32> = (0..20).map(|_| aborts.reserve(most)).collect();
        let there = places.iter().filter(|&&place| place != NO_PLACE).count();
        assert_eq!(there, POOL_BYTES / (MAX_MESSAGE_BYTES as usize + UNIT));
        for place in places {
            aborts.commit(place, AT);
        }
        for forged in [0, 7, u32::MAX - 1] {
            aborts.commit(forged, AT);
        }
        aborts.with_messages(|found| assert_eq!(found.len(), there * (most as usize + UNIT)));
    }

    #[test]
    fn a_lost_device_takes_no_more() {
        let aborts = Aborts::new().unwrap();
        aborts.close();
        aborts.commit(aborts.reserve(4), AT);
        aborts.with_messages(|found| assert!(found.is_empty()));
        assert!(aborts.happened());
    }
}
