//! Entries that are still to be visited.
#![forbid(unsafe_code)]

use crate::layout::{MAX_DEPTH, WIDTH};

/// A child still to be visited: its [`child`] word, and above that the bits of the scaled distance
/// to its box, which is not negative; so entries are in the order of distances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(transparent)]
pub(crate) struct Entry(u64);

impl Entry {
    /// The root, wherever it is entered.
    pub const ROOT: Entry = Entry(0);

    #[inline(always)]
    pub fn new(word: u32, near: f32) -> Entry {
        Entry(u64::from(word) | u64::from(near.to_bits()) << 32)
    }

    /// A [`child`] word.
    #[inline(always)]
    pub fn word(self) -> u32 {
        self.0 as u32
    }

    /// Scaled distance to its box.
    #[inline(always)]
    pub fn near(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    /// The last of all entries that are not beyond a distance.
    #[inline(always)]
    pub fn last_at(t: f32) -> Entry {
        Entry::new(u32::MAX, t)
    }

    /// The nearer and the farther of two.
    #[inline(always)]
    pub fn ordered(self, other: Entry) -> (Entry, Entry) {
        (self.min(other), self.max(other))
    }
}

/// Each level of a structure leaves seven siblings at most; two structures, and the eight of the
/// node at hand.
pub(crate) const STACK: usize = 2 * MAX_DEPTH as usize * (WIDTH - 1) + WIDTH + 1;
