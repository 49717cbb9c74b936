//! Private data: a 64-bit word of the application for each object and slot.

#![forbid(unsafe_code)]

use std::collections::HashMap;

/// `VkPrivateDataSlot`: identifies one word of every object.
pub struct PrivateDataSlot {
    pub index: u64,
}

/// The words of a device's objects, by slot and object handle.
#[derive(Default)]
pub struct PrivateData {
    words: HashMap<(u64, u64), u64>,
    next_slot: u64,
}

impl PrivateData {
    /// Creates a slot with all words zero.
    pub fn new_slot(&mut self) -> PrivateDataSlot {
        self.next_slot += 1;
        PrivateDataSlot {
            index: self.next_slot,
        }
    }

    /// Removes a slot's words.
    pub fn remove_slot(&mut self, slot: &PrivateDataSlot) {
        self.words.retain(|key, _| key.0 != slot.index);
    }

    pub fn set(&mut self, slot: &PrivateDataSlot, object: u64, word: u64) {
        self.words.insert((slot.index, object), word);
    }

    /// The word of an object; zero if none was set.
    pub fn word(&self, slot: &PrivateDataSlot, object: u64) -> u64 {
        self.words.get(&(slot.index, object)).copied().unwrap_or(0)
    }
}
